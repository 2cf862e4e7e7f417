"""While an encoder stands, its rounding error is one number, and its turns may be counts."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from gap_diagnosis.input.data import load_record
from gap_diagnosis.residuals.kinematics import Kinematics
from gap_diagnosis.residuals.operators import sure_turns
from gap_diagnosis.residuals.stands import Stands, stands_of
from gap_diagnosis.selection.parts import KINEMATIC_RULES, LEAST_ROWS, fit_part
from stage_core.session import Session

from .conftest import nominal

Maker = Callable[..., Session]
STEP, NOISE = 5e-6, 1e-6
COARSE = replace(nominal(), axes={'x': replace(nominal().axes['x'], encoder_resolution=STEP)})


def test_rows_of_a_stand_become_white() -> None:
    # σ² I + b² 1 1ᵀ, with the share 1 - √λ of its mean taken away, is σ² I.
    count, own, shared = 40, 1.0, 1.7
    covariance = own**2 * np.eye(count) + shared**2
    share = 1.0 - np.sqrt(own**2 / (own**2 + count * shared**2))
    free = Stands(np.array([3]), np.array([count]), np.array([share])).freed(np.eye(count + 5))
    np.testing.assert_array_equal(free[:3], np.eye(count + 5)[:3])
    free = free[3 : 3 + count, 3 : 3 + count]
    np.testing.assert_allclose(free @ covariance @ free.T, own**2 * np.eye(count), atol=1e-12)


def test_a_turn_counts_from_two_steps_on() -> None:
    counts = np.array([0.0, 1, 2, 1, 2, 1, 2, 3, 1, 0, 1, 0, 2])
    seen = np.array([0.0, 0, 2, 2, 2, 2, 2, 3, 1, 0, 0, 0, 2])
    np.testing.assert_array_equal(sure_turns(STEP * counts, STEP) / STEP, seen)


def creeping_about_counts(session: Session, play: float) -> Kinematics:
    """Rows of a machine that creeps at each stop about the edge of a count, and has a play."""
    record = load_record(session, COARSE)
    time = record.time
    stop = np.floor(time / 2.0)
    move = np.clip((time - 2.0 * stop) / 0.8, 0.0, 1.0)
    lines = np.array([0, 6, 12, 18, 24, 30, 20, 10, 0, 6, 12, 18, 24, 30, 15, 0]) * 1e-3
    lines = lines + STEP * np.random.default_rng(1).random(len(lines))
    # No constant speed: points that are a whole number of steps apart all round alike.
    path = np.interp(stop + 0.5 * (1.0 - np.cos(np.pi * move)), np.arange(len(lines)), lines)
    path += np.where(move == 1.0, 0.4 * STEP * np.sin(2.0 * np.pi * 0.7 * time), 0.0)
    encoder = STEP * np.rint(path / STEP)
    back = np.concatenate([[False], np.diff(np.interp(stop + move, range(16), lines)) < 0.0])
    moving = move < 1.0
    side = np.where(back, 1.0, -1.0)[np.maximum.accumulate(np.where(moving, range(len(time)), 0))]
    at = record.tracker_time
    assert at is not None
    rng = np.random.default_rng(3)
    tracker = np.interp(at, time, path) + 0.5 * play * np.interp(at, time, side)
    record = replace(
        record,
        encoder=encoder[:, None],
        tracker=(tracker + NOISE * rng.standard_normal(len(at)))[:, None],
    )
    return Kinematics([record], COARSE, {})


def test_counts_at_a_stop_are_no_play(planted: Maker) -> None:
    rows = creeping_about_counts(planted({}, duration=30.0), 0.0)
    assert len(stands_of(rows.records, NOISE).first) > 10
    part = fit_part('tracker', rows.problem(), KINEMATIC_RULES, 0, (), LEAST_ROWS)
    assert part.selection.accepted == []


def test_a_play_of_two_counts_is_one(planted: Maker) -> None:
    rows = creeping_about_counts(planted({}, duration=30.0), 2.0 * STEP)
    part = fit_part('tracker', rows.problem(), KINEMATIC_RULES, 0, (), LEAST_ROWS)
    assert part.selection.accepted == ['backlash.x']
    assert abs(part.selection.fit.thetas['backlash.x'][0] - 2.0 * STEP) < 0.1 * STEP
