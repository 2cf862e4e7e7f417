"""Where a session goes, and how its table is made."""

from __future__ import annotations

import numpy as np
import pytest

from stage_bringup.plan import (
    alignment_points,
    calibration_grid,
    heldout_points,
    positioning_points,
)
from stage_bringup.session import parse
from stage_bringup.table import heldout_rows, render
from stage_core.errors import StageError
from stage_core.metrics import Metrics


def test_grid_approaches_from_both_sides() -> None:
    points = calibration_grid(0.04, 5)
    assert len(points) == 50 and np.abs(points).max() <= 0.04
    steps = np.diff(points, axis=0)
    for axis in range(2):
        assert (steps[:, axis] > 1e-3).sum() >= 15 and (steps[:, axis] < -1e-3).sum() >= 15
    # Fractions of a 10 mm lead spread over the whole turn: a grid on the lead would see one.
    phase = np.sort(np.mod(points[:, 1], 0.01) / 0.01)
    assert np.diff(np.concatenate([phase, [phase[0] + 1.0]])).max() < 0.2


def test_heldout_points_are_seeded_and_inside() -> None:
    first, again, other = (heldout_points(0.04, 20, seed) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first, again)
    assert np.abs(first - other).max() > 1e-3 and np.abs(first).max() < 0.04
    assert len(np.unique(alignment_points(0.04), axis=0)) == 6


def test_table_states_micrometres() -> None:
    before = np.array([[3e-6, 4e-6], [-3e-6, -4e-6]])
    rows = heldout_rows(before, before / 10)
    assert rows[2].before.rms == pytest.approx(5e-6)
    text = render(rows)
    assert text.splitlines()[-1].split()[2:] == [
        *['5.00', '5.00', '5.00', '0.00'],
        *['0.50', '0.50', '0.50', '0.00'],
    ]


def test_figures_against_definition() -> None:
    figures = Metrics.of([1.0, -3.0])
    assert (figures.rms, figures.mae, figures.max) == (pytest.approx(5**0.5), 2.0, 3.0)
    assert figures.sigma == 2.0
    for bad in ([], [np.nan]):
        with pytest.raises(StageError):
            Metrics.of(bad)


@pytest.mark.parametrize(
    ('arguments', 'words'),
    [
        (['--iterations', '0'], '--iterations'),
        (['--grid', '1'], '--grid'),
    ],
)
def test_options_that_cannot_be_met(arguments: list, words: str) -> None:
    with pytest.raises(StageError, match=words):
        parse(arguments)


def test_a_session_is_never_overwritten(tmp_path: object) -> None:
    (tmp_path / 'session.json').write_text('{}')  # type: ignore[attr-defined]
    with pytest.raises(StageError, match='not empty'):
        parse(['--out', str(tmp_path)])


def test_a_positioning_test_approaches_each_target_from_both_sides() -> None:
    points = positioning_points(0.04, 1)
    assert points.shape == (60, 2) and not points[:, 0].any()
    steps = np.diff(points[:, 1])
    targets = np.unique(np.round(points[:, 1], 9))[1:-1]
    assert len(targets) == 5 and np.ptp(np.diff(targets)) > 1e-4
    for target in targets:
        arrived = np.isclose(points[1:, 1], target)
        assert (steps[arrived] > 0).sum() == (steps[arrived] < 0).sum() == 5
