"""The gap diagnosis on real machines: EMPS (twice as a twin) and the XY stage on its circle.

    python benchmarks/real_gap.py emps_force emps_servo xy_circle

The data are read from `STAGE_DATA` (or ../shared/data); docs/diagnosis.md names their sources.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Any

import numpy as np
from scipy.io import loadmat

from gap_diagnosis.closed_loop.replay import replay
from gap_diagnosis.diagnose import Diagnosis, diagnose
from gap_diagnosis.report import document as report
from stage_core import topics
from stage_core.session import Series, Session
from stage_core.twin_file import TwinFile

DATA = Path(os.environ.get('STAGE_DATA', Path(__file__).resolve().parents[2] / 'shared/data'))
AXES = ('x', 'y')
EMPS_MASS = 95.1  # kg, the mass alone: everything else is for the diagnosis to find


def session(
    name: str, period: float, reference: np.ndarray, encoder: np.ndarray, **command: np.ndarray
) -> Session:
    """Arrays (n, a) as a session with stamps of the control period."""
    stamps = np.rint(np.arange(len(encoder)) * period * 1e9).astype(np.int64)

    def joints(topic: str, **columns: np.ndarray) -> Series:
        values = {
            f'{key}.{axis}': column[:, i]
            for key, column in columns.items()
            for i, axis in enumerate(AXES[: encoder.shape[1]])
        }
        return Series(topic, stamps, values)

    rate = np.gradient(reference, period, axis=0)
    return Session(
        name,
        {
            topics.REFERENCE: joints(topics.REFERENCE, position=reference, velocity=rate),
            topics.COMMAND: joints(topics.COMMAND, **command),
            topics.JOINT_STATES: joints(topics.JOINT_STATES, position=encoder),
        },
    )


def emps(file: str) -> tuple[Session, dict[str, float]]:
    """One EMPS file and its controller; the force is gtau · vir [N].

    `vir` holds the pulses already, so that they belong to the velocity command [m/s] too. (The
    recorded ones are larger than `pulses_N`: the replay takes what the force holds beyond the law
    as an input.)
    """
    data = loadmat(DATA / 'emps' / f'{file}.mat')
    gain, kp, kv = (float(data[k][0, 0]) for k in ('gtau', 'kp', 'kv'))
    wanted, measured, volts = data['qg'], data['qm'], data['vir']
    velocity = kp * (wanted - measured)
    if 'pulses_N' in data:
        velocity = velocity + data['pulses_N'] / kv
    found = session(file, 1e-3, wanted, measured, velocity=velocity, effort=gain * volts)
    return found, {'kp': kp, 'kv': kv * gain}


def emps_twin(kind: str, constants: dict[str, float]) -> TwinFile:
    """The nominal EMPS: its mass, no friction, in servo form with its known controller."""
    axis: dict[str, float] = {
        'mass': EMPS_MASS,
        'viscous': 0.0,
        'encoder_resolution': 5e-8,
        'lead': 2.5e-3,
    }
    if kind == 'servo':
        axis.update(
            position_gain=constants['kp'],
            velocity_gain=constants['kv'],
            integral_gain=0.0,
            velocity_filter=1e4,
            force_limit=1e4,
        )
    content: dict[str, Any] = {'kind': kind, 'control_period': 1e-3, 'axes': {'x': axis}}
    return TwinFile.from_dict(content)


def circle(name: str) -> Session:
    """One record of the XY stage; the command [V] is taken as the force."""
    data = np.load(DATA / 'xy_circle' / f'{name}.npz')
    centre = data['reference'].mean(axis=0)
    return session(
        name, 1e-3, data['reference'] - centre, data['encoder'] - centre, effort=data['command']
    )


def circle_twin(record: Session) -> TwinFile:
    """No nominal parameters are published: mass and viscous friction fitted on one record."""
    from scipy.signal import savgol_filter

    axes = {}
    for axis in AXES:
        q = record.series[topics.JOINT_STATES].values[f'position.{axis}']
        force = record.series[topics.COMMAND].values[f'effort.{axis}']
        v = savgol_filter(q, 101, 3, deriv=1, delta=1e-3)
        a = savgol_filter(q, 101, 3, deriv=2, delta=1e-3)
        matrix = np.column_stack([a, v, np.sign(v), np.ones(len(v))])
        solution = np.linalg.lstsq(matrix, force, rcond=None)[0]
        axes[axis] = {
            'mass': float(max(solution[0], 1e-3)),
            'viscous': float(max(solution[1], 0.0)),
            'encoder_resolution': 1e-6,
        }
    return TwinFile.from_dict({'kind': 'measured_force', 'control_period': 1e-3, 'axes': axes})


def show(title: str, found: Diagnosis) -> None:
    """Print what the diagnosis says."""
    print(f'\n## {title}\n{report.sentence(found)}')
    for name, channel in found.channels.items():
        factor = 1.0 if channel.unit == 'N' else 1e6
        unit = 'N' if channel.unit == 'N' else 'µm'
        print(
            f'  {name:10s} {factor * channel.rms("before"):8.3f} -> '
            f'{factor * channel.rms("after"):8.3f} {unit}'
        )
    for record in found.records if found.twin.kind == 'servo' else []:
        whole = {
            n: float(np.sqrt(np.mean(g**2)))
            for n, g in replay(record, found.twin, found.effects).items()
        }
        gaps = f'{1e6 * whole["encoder.x"]:.3f} µm, {whole["force.x"]:.3f} N'
        print(f'  the whole of {record.name}: {gaps}')
    for cause in found.causes:
        if cause.status == 'accepted' and cause.parameters:
            values = ', '.join(f'{k} {v:.4g} ± {s:.1g}' for k, (v, s) in cause.parameters.items())
            print(f'  {cause.effect}: {values}; not to be told from {cause.alternatives}')
            for rung in cause.contains:
                values = ', '.join(
                    f'{k} {v:.4g} ± {s:.1g}' for k, (v, s) in rung.parameters.items()
                )
                low, high = (100.0 * share for share in rung.interval)
                gain = f'{100.0 * rung.shrink:.1f} % [{low:.1f}, {high:.1f}]'
                print(f'    {rung.effect}: {gain} of the force residual; {values}')
    for part in found.parts:
        # An axis of which nothing is named: what came nearest, and why that is not enough.
        nearest = sorted(part.selection.rejected.values(), key=lambda e: -e.gain)[:3]
        for evidence in nearest if not part.selection.accepted else []:
            low, high = evidence.interval
            print(
                f'  not named: {evidence.name}, {100.0 * evidence.share:.0f} % of the mean '
                f'square, gain of the RMS per block [{low:.3f}, {high:.3f}] N'
            )
    where = [(c.name, c.axis, round(c.share, 2), c.p_value) for c in found.conditions[:4]]
    print(f'  where: {where}\n  unexplained: {found.unexplained:.3f}, {found.structured}')


def main() -> int:
    """Entry point."""
    if not DATA.is_dir():
        print(f'no data at {DATA}: set STAGE_DATA', file=sys.stderr)
        return 2
    for what in sys.argv[1:] or ['emps_force', 'emps_servo', 'xy_circle']:
        if what.startswith('emps'):
            fit, constants = emps('DATA_EMPS')
            test, _ = emps('DATA_EMPS_PULSES')
            kind = 'servo' if what == 'emps_servo' else 'measured_force'
            twin = emps_twin(kind, constants)
            show(f'EMPS as {kind}, held out: pulses', diagnose([fit], [test], twin, 'emps'))
        else:
            fit = circle('day1_a')
            twin = circle_twin(fit)
            found = diagnose([fit, circle('day1_b')], [circle('day2_a')], twin, 'xy_circle')
            show('XY circle as measured_force, held out: day 2', found)
    return 0


if __name__ == '__main__':
    sys.exit(main())
