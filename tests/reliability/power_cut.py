"""Killed at each write, by itself or the kernel: a file is old or new, a bag loses one chunk."""

from __future__ import annotations

import json
import os
import resource
import signal
import sys
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple, cast

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.image import imread

from calibrator import model_file, restarts
from calibrator.live_buffer import load_session, save_session
from calibrator.models import make_model
from calibrator.samples import Samples
from calibrator.training_job import Job
from contour_ctrl import storage
from gap_diagnosis.closed_loop import own_model
from gap_diagnosis.diagnose import Diagnosis
from gap_diagnosis.experiment.design import Experiment
from gap_diagnosis.report import document, experiment
from session_bags import archive, metadata
from session_bags.bulk import session_blocks
from session_bags.reader import read_session
from session_bags.records import read_index
from session_bags.repair import repair
from session_bags.writer import SessionWriter
from stage_bringup import rerun_view
from stage_core import topics
from stage_core.pages import Page
from stage_core.session import Series, Session
from stage_core.twin_file import TwinFile
from stage_core.whole_file import replacing, write_whole

#: Calls that change a folder; the kernel kills at the writes.
EVENTS = ('open', 'os.rename', 'os.link', 'os.remove')


def dies(work: Callable[[], object], at_byte: int | None = None, at_event: int = -1) -> bool:
    """Run `work` in a child that is killed where a file passes `at_byte`, or at an event."""
    child = os.fork()
    if child == 0:
        try:
            if at_byte is not None:
                signal.signal(signal.SIGXFSZ, signal.SIG_DFL)
                resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
                resource.setrlimit(resource.RLIMIT_FSIZE, (at_byte, at_byte))
            seen = [0]

            def count(name: str, _: tuple[Any, ...]) -> None:
                seen[0] += name in EVENTS
                if name in EVENTS and seen[0] == at_event:
                    os.kill(os.getpid(), signal.SIGKILL)

            if at_event > 0:
                sys.addaudithook(count)
            work()
        except BaseException:
            os._exit(1)
        os._exit(0)
    _, status = os.waitpid(child, 0)
    assert os.WIFSIGNALED(status) or os.WEXITSTATUS(status) == 0, 'the writer raised'
    return os.WIFSIGNALED(status)


def killed_everywhere(write: Callable[[], object], size: int, check: Callable[[], None]) -> None:
    for byte in sorted({0, 1, size // 3, size // 2, size - 1}):
        assert dies(write, at_byte=byte)
        check()
    event = 1
    while dies(write, at_event=event):
        check()
        event += 1
    assert event > 2, 'nothing was opened and replaced'


def model(shift: float) -> model_file.StoredModel:
    rng = np.random.default_rng(1)
    points = rng.uniform(-0.1, 0.1, (60, 2))
    fitted = make_model('affine').fit(points, (1.0 + shift) * points)
    return model_file.StoredModel(fitted, version=round(1e6 * shift))


def twin(number: int) -> TwinFile:
    return TwinFile.nominal_servo().with_effects({'inertia_mismatch.x': {'ratio': 0.1 * number}})


def session(count: int = 4000) -> Session:
    stamps = 10**18 + 1_000_000 * np.arange(count)
    values = {
        f'{quantity}.{axis}': np.random.default_rng(2).normal(size=count)
        for quantity in ('position', 'velocity')
        for axis in 'xy'
    }
    return Session('', {topics.JOINT_STATES: Series(topics.JOINT_STATES, stamps, values)})


class Kind(NamedTuple):
    """A kind of file that the project writes: into a folder, with a number that it tells."""

    name: str
    write: Callable[[Path, int], object]
    read: Callable[[Path], int]


def report(folder: Path, number: int) -> None:
    document.write(cast(Diagnosis, SimpleNamespace(corrected_twin=twin(number))), folder)


def motion(folder: Path, number: int) -> None:
    where = np.full((4000, 2), 1e-3 * number)
    asked = SimpleNamespace(position=where, period=1e-3, axes=('x', 'y'))
    experiment.write(cast(Experiment, asked), folder)


def motion_number(path: Path) -> int:
    rows = np.loadtxt(path, delimiter=',', skiprows=1)
    assert len(rows) == 1000
    return round(1e3 * rows[-1, 2])


def page(folder: Path, number: int) -> None:
    made = Page('Kill')
    made.text(f'number {number} ' * 500)
    made.save(folder / 'page')


def page_number(path: Path) -> int:
    text = path.read_text()
    assert text.endswith('</html>\n') and text.count('number') == 500
    return int(text.rpartition('number ')[2].partition('</p>')[0])


def pictures(folder: Path, number: int) -> None:
    made = Page('Kill')
    made.figures.append(('', Figure(figsize=(number, 1.0))))
    made.save_pictures(folder, 'picture')


def description(folder: Path, number: int) -> None:
    filled = [metadata.FileRecord('bag_0.mcap', start=1, end=2, count=number)]
    metadata.BagMetadata(files=filled).save(folder)


def described(path: Path) -> int:
    found = metadata.load(path.parent)
    assert found is not None
    return found.files[0].count


def learned(folder: Path, number: int) -> None:
    taught = storage.Learned('c', 'm', np.full((500, 2), float(number)), np.zeros((1, 2, 2)))
    storage.save(folder / 'learned', taught)


def live(folder: Path, number: int) -> None:
    save_session(session(1000 * number), folder / 'live')


def text(path: Path) -> int:
    content = path.read_text()
    assert len(content) == 500
    return int(content[-1])


KINDS = (
    Kind(
        'model',
        lambda folder, n: model_file.save(model(1e-6 * n), folder / 'model'),
        lambda path: model_file.load(path).version,
    ),
    Kind('learned', learned, lambda path: int(storage.load(path, 'c', 'm').signal[-1, -1])),
    Kind(
        'twin',
        lambda folder, n: twin(n).save(folder / 'twin'),
        lambda path: round(10 * TwinFile.load(path).effects['inertia_mismatch.x']['ratio']),
    ),
    Kind('page', page, page_number),
    Kind('picture_01.png', pictures, lambda path: round(imread(path).shape[1] / 110)),
    Kind('metadata.yaml', description, described),
    Kind('report.json', report, lambda path: json.loads(path.read_text())['number']),
    Kind('experiment.csv', motion, motion_number),
    Kind(
        'model.xml',
        lambda folder, n: own_model.save(folder / 'model.xml', f'{n}' * 500),
        text,
    ),
    Kind(
        'kept result',
        lambda folder, n: archive._keep(folder / 'kept result', archive.Outcome('bag', n)),
        lambda path: cast(archive.Outcome, archive._kept('bag', path)).result,
    ),
    Kind('live', live, lambda path: len(load_session(path).series[topics.JOINT_STATES]) // 1000),
    Kind(
        'job',
        lambda folder, n: Job(out='', version=n).save(folder / 'job'),
        lambda path: Job.load(path).version,
    ),
    # What has no writer of its own: session.json, summary.json, a patch, the reference.
    Kind('text', lambda folder, n: write_whole(folder / 'text', f'{n}' * 500), text),
)


@pytest.mark.parametrize('kind', KINDS, ids=lambda kind: kind.name)
def test_a_file_is_old_or_new(kind: Kind, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(document, 'as_dict', lambda found: {'number': number_of(found)})
    path = tmp_path / kind.name
    kind.write(tmp_path, 1)
    seen = set()

    def check() -> None:
        seen.add(kind.read(path))
        assert seen <= {1, 2}

    killed_everywhere(lambda: kind.write(tmp_path, 2), path.stat().st_size, check)
    kind.write(tmp_path, 2)
    assert kind.read(path) == 2 and 1 in seen


def test_samples_of_a_training_are_whole_or_absent(tmp_path: Path) -> None:
    where = np.random.default_rng(3).normal(size=(4000, 2))
    none = np.empty((4000, 0))
    samples = Samples(where, where, where, none, where[:, 0], (), ('x', 'y'), 0.0, True)
    # Their file is named by what it holds.
    size = restarts._save(samples, tmp_path / 'whole').stat().st_size

    def check() -> None:
        for path in tmp_path.glob('samples-*.npz'):
            with np.load(path) as content:
                assert np.array_equal(content['command'], where)

    killed_everywhere(lambda: restarts._save(samples, tmp_path), size, check)
    assert restarts._save(samples, tmp_path).stat().st_size == size


def test_a_recording_for_rerun_is_old_or_new(tmp_path: Path) -> None:
    sdk = pytest.importorskip('rerun', reason='rerun-sdk is an optional extra')
    chunk = pytest.importorskip('rerun.chunk')
    path = tmp_path / 'session.rrd'

    def write(count: int) -> Callable[[], object]:
        bag = tmp_path / f'{count}'
        with SessionWriter(bag, TwinFile.nominal_servo()) as writer:
            writer.write_blocks(session_blocks(session(count)))
        return lambda: rerun_view.main(['--bag', str(bag), '--out', str(path)])

    def complete() -> None:
        reader = chunk.RrdReader(path)
        rows = sum(
            part.to_record_batch().num_rows
            for part in reader.stream(store=reader.recordings()[0])
            if part.entity_path == '/position_mm/encoder/x'
        )
        assert rows == 8000

    def check() -> None:
        # The threads of Rerun do not outlive a fork: here it is used in children alone.
        assert path.read_bytes() == old or not dies(complete)

    assert not dies(write(4000))
    old = path.read_bytes()
    new = write(8000)
    # Imports are calls of `open` too.
    rerun_view.layout(sdk, rerun_view.read_recorded(tmp_path / '8000'))
    killed_everywhere(new, len(old), check)
    assert not dies(new)
    assert path.read_bytes() != old
    check()


def number_of(found: Diagnosis) -> int:
    """The number of `twin`; a report of any other content is written alike."""
    return round(10 * found.corrected_twin.effects['inertia_mismatch.x']['ratio'])


def test_a_growing_bag_keeps_each_complete_chunk(tmp_path: Path) -> None:
    def record(name: str) -> None:
        with SessionWriter(tmp_path / name, TwinFile.nominal_servo()) as writer:
            writer.write_blocks(session_blocks(session()), chunk_bytes=16_384)

    record('whole')
    file = tmp_path / 'whole' / 'whole_0.mcap'
    ends = [place.offset + place.length for place in read_index(file).chunks]
    assert len(ends) > 5
    for number, byte in enumerate((ends[0] + 1, ends[2] - 1, ends[2] + 40, ends[-1] + 1)):
        name = f'cut{number}'
        assert dies(lambda name=name: record(name), at_byte=byte)
        complete = sum(end <= byte for end in ends)
        repair(tmp_path / name)
        stamps = read_session(tmp_path / name).series[topics.JOINT_STATES].stamps
        assert np.array_equal(stamps, session().series[topics.JOINT_STATES].stamps[: len(stamps)])
        assert len(read_index(tmp_path / name / f'{name}_0.mcap').chunks) >= complete
        # Repair itself may be killed: what it has not finished it does again.
        assert read_session(tmp_path / name).series[topics.JOINT_STATES].stamps.size == len(stamps)


def test_repair_that_is_killed_is_done_again(tmp_path: Path) -> None:
    bag = tmp_path / 'bag'
    with SessionWriter(bag, TwinFile.nominal_servo()) as writer:
        writer.write_blocks(session_blocks(session()), chunk_bytes=16_384)
    file = bag / 'bag_0.mcap'
    broken = file.read_bytes()[:-3000]
    event = 1
    while True:
        file.write_bytes(broken)
        died = dies(lambda: repair(bag), at_event=event)
        repair(bag)
        assert len(read_session(bag).series[topics.JOINT_STATES].stamps) > 3000
        if not died:
            break
        event += 1
    assert event > 4


def test_a_failed_write_leaves_the_old_file_and_nothing_else(tmp_path: Path) -> None:
    path = tmp_path / 'a.txt'
    write_whole(path, 'old')
    with pytest.raises(ValueError, match='in the middle'), replacing(path) as stream:
        stream.write(b'new')
        raise ValueError('in the middle')
    assert [entry.name for entry in tmp_path.iterdir()] == ['a.txt']
    assert path.read_text() == 'old'
    (tmp_path / 'link').symlink_to(path)
    write_whole(tmp_path / 'link', 'new')
    assert (tmp_path / 'link').is_symlink() and path.read_text() == 'new'
    write_whole('/dev/null', 'nothing')
    assert Path('/dev/null').is_char_device()
