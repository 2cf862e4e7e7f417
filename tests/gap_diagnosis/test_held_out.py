"""A gap that opens for moments: where the held-out windows lie, and what is said of it."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.experiment.machine import session
from gap_diagnosis.closed_loop.held_out import with_windows
from gap_diagnosis.diagnose import diagnose
from gap_diagnosis.input.data import load_record
from gap_diagnosis.input.windows import LAST_THIRD
from gap_diagnosis.result import Diagnosis

from .conftest import nominal

PERIOD, DURATION = 1e-3, 20.0
LIMIT = {'force_saturation.x': {'limit': 40.0}}


def strokes(hard: tuple[float, ...], back: float = 0.5) -> np.ndarray:
    """A gentle sine, hard strokes at some times and as hard ones back some s later; (n, 1) [m]."""
    t = np.arange(round(DURATION / PERIOD)) * PERIOD
    path = 0.01 * np.sin(2.0 * np.pi * 0.4 * t) * np.minimum(1.0, t)
    for at in hard:
        for begin, size in ((at, 0.03), (at + back, -0.03)):
            s = np.clip((t - begin) / 0.25, 0.0, 1.0)
            path += size * s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
    return path[:, None]


def diagnosed(*paths: np.ndarray) -> Diagnosis:
    """The diagnosis of a machine whose force limit only the hard strokes reach.

    All paths after the first are held out.
    """
    twin = nominal()
    machine, rise = twin.with_effects(LIMIT), np.full(len(paths[0]), 20.0)
    first, *others = [session(machine, twin, path, rise, k) for k, path in enumerate(paths)]
    return diagnose([first], others, twin)


def test_windows_move_to_where_the_gap_is() -> None:
    # Every one of them in the first two thirds of a block of 5 s.
    found = diagnosed(strokes((0.8, 2.0, 5.7, 7.1, 10.8, 12.0, 15.7, 17.1)))
    assert found.verdict == ['force_saturation.x']
    assert found.records[0].windows_at < LAST_THIRD


def test_a_gap_that_opens_once_is_seen_by_the_fit_and_by_the_judge() -> None:
    found = diagnosed(strokes((11.26,), back=DURATION))
    assert found.verdict == ['force_saturation.x']


def test_a_gap_that_only_the_fit_sees_is_unknown() -> None:
    found = diagnosed(strokes((11.26,)), strokes(()))
    assert found.verdict == ['unknown']


@pytest.mark.parametrize('hard', [(), (1.0, 4.0, 7.0, 8.6, 12.0, 13.8, 16.0, 18.6)])
def test_windows_stay_where_they_hold_a_part_of_the_gap(hard: tuple[float, ...]) -> None:
    twin, path = nominal(), strokes(hard)
    made = session(twin.with_effects(LIMIT), twin, path, np.full(len(path), 20.0), 0)
    record = load_record(made, twin)
    assert with_windows(record, twin).windows_at == LAST_THIRD
