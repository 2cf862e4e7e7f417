"""One diagnosis from bags to report files; the command line and the node share it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryFile

from gap_diagnosis.diagnose import diagnose, silent, to_stderr
from gap_diagnosis.experiment.propose import Travel, propose
from gap_diagnosis.experiment.travel import FILE
from gap_diagnosis.passes import Progress
from gap_diagnosis.report import document as report
from gap_diagnosis.report import experiment as motion
from gap_diagnosis.report import model as own_model
from gap_diagnosis.result import Diagnosis
from session_bags.reader import read_session
from stage_core import topics
from stage_core.errors import StageError
from stage_core.names import nearest
from stage_core.quantities import AXES, split_effect
from stage_core.session import Session
from stage_core.twin_file import TwinFile
from stage_twin.effects import EFFECTS
from stage_twin.models import is_model, read_model
from stage_twin.models.plant import as_twin

TOPICS = (
    topics.SETPOINT,
    topics.REFERENCE,
    topics.COMMAND,
    topics.JOINT_STATES,
    topics.TEMPERATURE,
    topics.TRACKER_POINT,
    topics.ALIGNMENT,
)


def run(
    bags: Sequence[str],
    holdout: Sequence[str],
    twin_path: str,
    out: Path,
    seed: int = 0,
    quiet: bool = False,
    without: Sequence[str] = (),
    with_page: bool = True,
    controller: str | None = None,
    sim_bags: Sequence[str] = (),
    travel: Travel | None = None,
) -> str:
    """Diagnose, write the report into `out`, and return the verdict line.

    `without` takes effects out of the library; `with_page` false leaves out report.html;
    `controller` is the twin file beside a `twin_path` that is a model file; `sim_bags` are a
    simulator's runs of `bags` and `holdout`, in this order; `travel` is what the experiment may
    use of each axis [m].

    Raises
    ------
    StageError
        For input that cannot be diagnosed; then no report is left in `out`.
    """
    progress = silent if quiet else to_stderr
    # A report of an earlier run must not stand for an input that fails.
    empty(out, ('report.json', 'report.html', 'corrected_twin.yaml', FILE,
                own_model.MODEL, own_model.PATCH))  # fmt: skip
    _refuse_mismatch(twin_path, controller, len(bags) + len(holdout), len(sim_bags))
    _refuse_twice((*bags, *holdout))
    _refuse_unknown(without)
    rig = TwinFile.load(controller or twin_path)
    _refuse_axes(travel or {}, rig)
    model = read_model(twin_path) if controller else None
    twin = rig if model is None else as_twin(model.plants, rig)
    sessions = [_read(path, progress) for path in (*bags, *holdout, *sim_bags)]
    found = diagnose(
        sessions[: len(bags)],
        sessions[len(bags) : len(bags) + len(holdout)],
        twin,
        twin_name=str(twin_path),
        seed=seed,
        progress=progress,
        without=without,
        simulated=sessions[len(bags) + len(holdout) :],
    )
    if model is not None:
        progress('mending the model')
        try:
            found.model = own_model.mend(model, rig, found, out)
        except StageError as error:
            # The diagnosis stands, whatever the file can hold of it.
            found.warnings.append(str(error))
    if not sim_bags and model is None:
        found.experiment = propose(found, travel, seed=seed, progress=progress)
    progress('writing the report')
    _write(found, out, with_page)
    return report.sentence(found)


def empty(out: Path, names: Sequence[str] = ()) -> None:
    """Make the folder of a report, and take these files out of it.

    Raises
    ------
    StageError
        If nothing can be written there: it is said before the diagnosis, not after it.
    """
    try:
        out.mkdir(parents=True, exist_ok=True)
        for name in names:
            (out / name).unlink(missing_ok=True)
        with TemporaryFile(dir=out):
            pass
    except OSError as error:
        raise StageError(
            f'cannot write into {out} ({error.strerror}): give another folder as --out'
        ) from error


def _refuse_twice(bags: Sequence[str]) -> None:
    """A session that a fit has seen cannot judge it, nor count as two."""
    paths = [Path(bag).resolve() for bag in bags]
    for bag, path in zip(bags, paths, strict=True):
        if paths.count(path) > 1:
            raise StageError(
                f'{bag} is given twice: give each session once, as --bag or as --holdout'
            )


def _refuse_unknown(without: Sequence[str]) -> None:
    for name in without:
        effect, axis = split_effect(name)
        if effect not in EFFECTS:
            raise StageError(f'--without {name}: no such effect; {nearest(effect, EFFECTS)}')
        known = [f'{effect}.{a}' for a in AXES] if EFFECTS[effect].per_axis else []
        if axis and name not in known:
            raise StageError(f'--without {name}: name it {" or ".join([effect, *known])}')


def _refuse_axes(travel: Travel, rig: TwinFile) -> None:
    for axis in travel:
        if axis not in rig.axes:
            raise StageError(f'--travel {axis}: the twin has the axes {", ".join(rig.axes)} only')


def _write(found: Diagnosis, out: Path, with_page: bool) -> None:
    report.write(found, out)
    if found.experiment is not None:
        motion.write(found.experiment, out)
    if with_page:
        # Plotting takes seconds to import and to draw: only who wants a page waits for it.
        from gap_diagnosis.report import page

        page.write(found, out)


def _refuse_mismatch(twin_path: str, controller: str | None, bags: int, sim_bags: int) -> None:
    """A model file has no controller, and a twin file has its own; a run goes with each bag."""
    if is_model(twin_path) and not controller:
        raise StageError(
            f'--twin {twin_path} is a model, which has no controller: name its twin file with '
            '--controller'
        )
    if controller and not is_model(twin_path):
        raise StageError('--controller goes with a model: give --twin MODEL.xml')
    if sim_bags and (controller or sim_bags != bags):
        raise StageError(
            'give one --sim-bag for each --bag and --holdout, in their order, beside a twin '
            'file as --twin'
        )


def _read(path: str, progress: Progress) -> Session:
    if not Path(path).exists():
        raise StageError(f'there is no bag {path}: give the directory of a recorded session')
    progress(f'reading {path}')
    return read_session(path, topics=TOPICS)
