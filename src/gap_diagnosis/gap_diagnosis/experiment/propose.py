"""From a diagnosis to its experiment: noise, limits and candidates are those of the session."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from copy import copy
from dataclasses import replace

import numpy as np

from gap_diagnosis.experiment.design import Experiment, design
from gap_diagnosis.experiment.library import left_open
from gap_diagnosis.experiment.motions import Limits, boldest, sample
from gap_diagnosis.experiment.prediction import Noise, Predictor
from gap_diagnosis.experiment.questions import open_pairs
from gap_diagnosis.experiment.scene import PIECE, Scene
from gap_diagnosis.residuals.force_rows import ATTENUATION, CUTS, ForceRows
from gap_diagnosis.result import Diagnosis

Travel = Mapping[str, tuple[float, float]]

#: Of a session [s], that is simulated with every effect that may be.
LONGEST = 30.0


def propose(
    found: Diagnosis,
    travel: Travel | None = None,
    duration: float = 60.0,
    seed: int = 0,
    progress: Callable[[str], None] = lambda _: None,
) -> Experiment | None:
    """The motion that would decide what a diagnosis leaves open; None where nothing is.

    None, too, where no axis moves enough to tell the noise of its forces. `travel` is what each
    axis may use [m]; that of the session where it is not named.
    """
    balances = any(p.name.startswith('servo') for p in found.parts)
    if found.twin.kind != 'servo' or found.drives or not balances:
        return None
    predictor = predictor_of(found)
    limits = replace(limits_of(found, travel or {}), duration=duration)
    sessions = [r.reference[: round(LONGEST / r.period)] for r in found.records]
    bold = sample(boldest('strokes', len(limits.low)), limits, PIECE, found.twin.control_period)
    library = left_open(
        found,
        [Scene(predictor, limits).shower(s, ran=True) for s in sessions],
        Scene(predictor, limits).shower(bold, ran=True),
    )
    return design(open_pairs(found), predictor, limits, sessions, seed, progress, library)


def limits_of(found: Diagnosis, travel: Travel) -> Limits:
    """Travel of the sessions or wider, and each axis' force."""
    axes = found.records[0].axes
    encoder = np.concatenate([record.encoder for record in found.records])
    ends = [
        travel.get(axis, (float(q.min()), float(q.max())))
        for axis, q in zip(axes, encoder.T, strict=True)
    ]
    low, high = np.array(ends).T
    force = np.array([found.twin.servo(axis).force_limit for axis in axes])
    # An axis that stood still stays where it was.
    return Limits(low, np.maximum(high, low + 1e-6), force)


def predictor_of(found: Diagnosis) -> Predictor:
    """The nominal twin with the axes and the noise of the session."""
    record = found.records[0]
    axes = record.axes
    tracker = record.tracker is not None
    warm = record.temperature
    reference = found.twin.temperature_reference
    rise = np.zeros(len(axes)) if warm is None else warm[-1] - reference
    machine = replace(found.twin, axes={a: found.twin.axes[a] for a in axes})
    return Predictor(machine, _noise(found), np.nan_to_num(rise), tracker)


def _noise(found: Diagnosis) -> Noise:
    """Noise of the balance below each cut, by the encoder noise of the session."""
    own = {p.name: p for p in found.parts}
    acceleration, force, record = [], [], found.records[0]
    for axis in record.axes:
        part = own.get(f'servo.{axis}') or next(p for n, p in own.items() if n != 'tracker')
        assert isinstance(part.rows, ForceRows)
        rows, machine = copy(part.rows), found.twin.servo(axis)
        for cut in CUTS:
            rows.cut = cut
            acceleration.append(rows.encoder_noise() * rows.response(1.0, 0.0))
            force.append(rows.encoder_noise() * rows.response(machine.mass, machine.viscous))
    shape = (-1, len(CUTS))
    tracker = own['tracker'].problem.floor if 'tracker' in own else 1.0
    return Noise(
        CUTS,
        np.reshape(acceleration, shape).T,
        np.reshape(force, shape).T,
        ATTENUATION,
        np.mean(np.diff(record.reference, 2, axis=0) ** 2, axis=0) / record.period**4,
        tracker,
    )
