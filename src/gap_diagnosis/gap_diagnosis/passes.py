"""From records to fitted parts, for as many passes as the acceptance asks for."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from gap_diagnosis.closed_loop.axis_loop import AxisLoop
from gap_diagnosis.closed_loop.creep import creep_notes, with_creep
from gap_diagnosis.closed_loop.encoder_waves import motion_beside, waves_read, with_waves_of_loop
from gap_diagnosis.closed_loop.held_out import with_windows
from gap_diagnosis.closed_loop.rests import with_rests
from gap_diagnosis.closed_loop.simulated import beside, of_simulator, with_simulated
from gap_diagnosis.evidence import judgement as judge
from gap_diagnosis.input.checks import EXCITATION_HINT, check_duration
from gap_diagnosis.input.data import Record, load_record
from gap_diagnosis.input.reading_wave import MISREADS
from gap_diagnosis.input.stepper import UNSEEN_BY_ENCODER, by_encoder, load_stepper_record
from gap_diagnosis.input.windows import moves_while_judged
from gap_diagnosis.memory import Memory
from gap_diagnosis.parameters import Parameters
from gap_diagnosis.residuals.commands import controller_findings, declared_terms
from gap_diagnosis.residuals.controller import with_read_gains
from gap_diagnosis.residuals.drive_law import DriveLaw
from gap_diagnosis.residuals.measured_noise import with_mean_points, with_noise, with_steps
from gap_diagnosis.residuals.nominal import with_counted_steps
from gap_diagnosis.residuals.recording import in_newtons
from gap_diagnosis.residuals.servo import Servo
from gap_diagnosis.residuals.unrecorded import with_laws
from gap_diagnosis.residuals.without_forces import NOT_TOLD, lost_drive
from gap_diagnosis.selection.parts import LEAST_ROWS, Part
from gap_diagnosis.selection.servo_part import fit_servo
from stage_core import topics
from stage_core.errors import StageError
from stage_core.quantities import split_effect
from stage_core.session import Session
from stage_core.twin_file import TwinFile

#: Relative difference of a fitted velocity gain that counts as none. The gain is up to 12 % off
#: where a filter of the speed and the mass are hardly told apart (a machine without friction).
SAME_GAIN = 0.15

Progress = Callable[[str], None]


@dataclass(frozen=True)
class Prepared:
    """What every pass starts from.

    Attributes
    ----------
    records : arrays of all sessions
    stated : the nominal twin as its file states it
    twin : that twin, whose stated frictions give way as the machine's do
    stepped : the twin with the encoder steps that the records have
    seen : the twin with all the noise that they have
    direct : effects read from the record itself; no residual has to be explained for them
    laws : by axis, what stands for the forces where none are recorded
    without : effects taken out of the library
    apart : notes where a machine without forces and its simulator have other gains
    unlike : axes whose controller does more than other gains explain
    loops : what was refined in the loops of these records, however they rest
    """

    records: list[Record]
    stated: TwinFile
    twin: TwinFile
    stepped: TwinFile
    seen: TwinFile
    direct: Parameters
    laws: dict[str, DriveLaw] = field(default_factory=dict)
    without: tuple[str, ...] = ()
    apart: tuple[str, ...] = ()
    unlike: tuple[str, ...] = ()
    loops: Memory = field(default_factory=Memory)

    @property
    def stepper(self) -> bool:
        """Whether the twin is that of a stepper."""
        return self.twin.kind == 'stepper'

    @property
    def notes(self) -> list[str]:
        """What a reader has to know of the forces and the motion."""
        still = [
            f'axis {axis} hardly moves in the windows that judge it: its forces are not judged; '
            'record a longer session with `ros2 run contour_ctrl excite`'
            for i, axis in enumerate(self.records[0].axes)
            if any(np.ptp(r.reference[:, i]) > 0.0 for r in self.records) and not self.stepper
            if axis not in self.moves
        ]
        still += [
            f'axis {axis}: its controller does more than gains explain; those named come nearest'
            for axis in self.unlike
        ]
        still += creep_notes(self.stated, self.twin)
        if not self.laws:
            return still
        lost = [axis for axis, law in self.laws.items() if not law.known]
        return [
            'no effort is recorded: the controller was fitted to the motion, and newtons are '
            "those for the twin's mass",
            *(
                f'axis {axis}: {lost_drive(self.records)}; its servo link is not judged and has '
                f'no figures. Record the effort of {topics.COMMAND}'
                for axis in lost
            ),
            *self.apart,
            *still,
        ]

    @property
    def rests_as_stated(self) -> bool:
        """Whether the stated frictions of the twin hold and give way as its file says."""
        noises = [own for r in self.records if r.noise is not None for own in r.noise.axes]
        return self.twin == self.stated and not any(own.dry for own in noises)

    def with_frictions(self, twin: TwinFile) -> Prepared:
        """The same with the stated effects of another twin."""
        stepped = replace(self.stepped, effects=twin.effects)
        return replace(
            self, twin=twin, stepped=stepped, seen=replace(self.seen, effects=twin.effects)
        )

    @property
    def laws_known(self) -> bool:
        """Whether gains explain every controller, recorded in its forces or without them."""
        return not self.unlike and all(law.known for law in self.laws.values())

    @property
    def moving_axes(self) -> list[str]:
        """Axes whose force balance can be judged."""
        return [a for a in self.moves if a not in self.laws or self.laws[a].known]

    @cached_property
    def moves(self) -> list[str]:
        """Axes that move, and slide often enough to judge their forces."""
        axes = [] if self.stepper else self.records[0].axes
        moving = [a for i, a in enumerate(axes) if moves_while_judged(self.records, i)]
        return [a for a in moving if self._slides(a)]

    def _slides(self, axis: str) -> bool:
        """Whether a force balance has enough rows in which the axis slides."""
        rows = Servo(self.records, self.stepped, axis).split()
        return all(own.sum() >= least for own, least in zip(rows, LEAST_ROWS, strict=True))


def prepare(
    sessions: Sequence[Session],
    holdout: Sequence[Session],
    twin: TwinFile,
    without: Sequence[str],
    simulated: Sequence[Session] = (),
) -> Prepared:
    """Load the sessions and read from them what needs no fit.

    With runs of a simulator beside them the twin is the rig that it simulates.

    Raises
    ------
    StageError
        If a session cannot be diagnosed, or the sessions have different axes.
    """
    if simulated:
        twin = of_simulator(twin, simulated)
    if twin.kind == 'stepper' and any(by_encoder(s) for s in (*sessions, *holdout)):
        without = (*without, *UNSEEN_BY_ENCODER)
    records = declared_terms(_load(sessions, twin) + _load(holdout, twin, held_out=True), twin)
    if twin.kind == 'servo' and twin.gains_stated and not simulated:
        records = [with_windows(r, twin) for r in records]
    _check_records(records, twin)
    laws: dict[str, DriveLaw] = {}
    apart: list[str] = []
    if not all(r.effort_recorded for r in records):
        _check_without_forces(records)
        without, stated = (*without, *NOT_TOLD), twin
        records, twin, laws = with_laws(records, twin)
        known = [axis for axis, law in laws.items() if law.known and simulated]
        apart = [note for axis in known if (note := _apart(axis, twin, stated))]
        _check_told(records, laws)
    elif twin.kind == 'servo' and not twin.gains_stated:
        without = (*without, 'controller_mismatch', 'effort_convention')
        twin = with_read_gains(records, twin)
    records, conventions = in_newtons(records, twin, without)
    if simulated:
        runs = [_checked(run) for run in _load(simulated, twin)]
        records = [beside(r, run, twin) for r, run in zip(records, runs, strict=True)]
    stated, twin = twin, with_creep(records, twin)
    counted_twin = with_counted_steps(twin)
    records = with_waves_of_loop(with_rests(records, twin, {}), twin)
    counted = twin.kind == 'stepper' or 'encoder_quantisation' in without
    quantisation = {} if counted else judge.encoder_steps(records, counted_twin)
    stepped = with_steps(counted_twin, quantisation)
    seen = with_simulated(with_mean_points(with_noise(stepped, records), records), records)
    commanded, unlike = controller_findings(records, twin)
    direct = {**quantisation, **conventions, **commanded, **waves_read(records, twin)}
    told = tuple(without), tuple(apart), unlike
    return _moving(Prepared(records, stated, twin, stepped, seen, direct, laws, *told))


def _check_records(records: list[Record], twin: TwinFile) -> None:
    """Refuse records that are too short, of a machine at rest, or of different axes."""
    check_duration(records)
    if twin.kind != 'stepper' and not any(
        moves_while_judged(records, i) for i in range(len(records[0].axes))
    ):
        raise StageError(
            f'{records[0].name}: no axis moves in the windows that judge it; {EXCITATION_HINT}'
        )
    if any(r.axes != records[0].axes for r in records):
        raise StageError('the sessions have different axes: diagnose them one by one')


def _moving(before: Prepared) -> Prepared:
    """Refuse sessions that show neither forces nor, to a tracker, positions."""
    unseen = any(r.tracker is None for r in before.records)
    if unseen and not (before.stepper or before.moves):
        name = before.records[0].name
        raise StageError(f'{name}: hardly any sample is in motion; {EXCITATION_HINT}')
    return before


def _load(sessions: Sequence[Session], twin: TwinFile, held_out: bool = False) -> list[Record]:
    """Arrays of some sessions, by the kind of their machine."""
    load = load_stepper_record if twin.kind == 'stepper' else load_record
    return [load(s, twin, held_out=held_out) for s in sessions]


def _check_without_forces(records: list[Record]) -> None:
    some = next((r.name for r in records if r.effort_recorded), None)
    if some is not None:
        raise StageError(
            f'{some} holds the effort and another session does not: diagnose them one by one'
        )


def _checked(run: Record) -> Record:
    """The run of a simulator, if it has forces."""
    if not run.effort_recorded:
        raise StageError(
            f'{run.name} holds no effort: a simulator knows its forces, record them as the effort '
            f'of {topics.COMMAND}'
        )
    return run


def _apart(axis: str, machine: TwinFile, simulator: TwinFile) -> str:
    """A note where machine and simulator differ in what gains and mass make together."""
    ratio = machine.servo(axis).velocity_gain / simulator.servo(axis).velocity_gain
    if abs(ratio - 1.0) < SAME_GAIN:
        return ''
    return (
        f'axis {axis}: velocity gain over mass is {ratio:.2f} times that of the simulator; which '
        'of the two differs cannot be told without forces'
    )


def _check_told(records: list[Record], laws: dict[str, DriveLaw]) -> None:
    """Refuse sessions of which neither a force balance nor a tracker is left."""
    if any(law.known for law in laws.values()) or all(r.tracker is not None for r in records):
        return
    raise StageError(
        f'{records[0].name} holds no effort, and {lost_drive(records)}: record the effort of '
        f'{topics.COMMAND}'
    )


def servo_part(
    before: Prepared,
    axis: str,
    direct: Parameters,
    seed: int,
    without: Sequence[str],
    memory: Memory,
    progress: Progress,
) -> Part:
    """The force balance of one axis; of an encoder that is known to misread it is the motion's."""
    wave = f'{MISREADS}.{axis}'
    misreads = wave in direct

    def motion() -> Servo:
        read = [motion_beside(r, axis) if misreads else r for r in before.records]
        return Servo(read, before.stepped, axis)

    key = (axis, repr([r.waves[wave] for r in before.records]) if misreads else '')
    rows = memory.once(('rows', *key), motion)
    problem = memory.once(('servo', *key), rows.problem)
    barred = tuple(sorted(n for n in without if _concerns(n, list(problem.terms))))

    def fit() -> Part:
        progress(f'command -> encoder of axis {axis}: reading the equation of motion backwards')
        own = replace(problem, terms=dict(problem.terms))
        loop = AxisLoop(before.records, before.twin, axis, direct, before.loops)
        part = fit_servo(rows, own, loop, seed, barred)
        column = before.records[0].column(axis)
        return replace(part, row_axis=np.full(len(part.problem.target), column), rows=rows)

    return memory.once(('servo', *key, barred, repr(direct)), fit)


def _concerns(barred: str, terms: list[str]) -> bool:
    """Whether an effect that is taken out, of one axis or of all, is among the candidates."""
    return any(barred in (term, split_effect(term)[0]) for term in terms)
