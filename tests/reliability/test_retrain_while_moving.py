"""A training beside a contour leaves the motion alone: in lockstep to the last digit."""

from __future__ import annotations

from pathlib import Path

import pytest

pytest.importorskip('rclpy')

from benchmarks.retrain_while_moving import follow, training_bag


def test_a_retrain_leaves_the_contour_alone(ros_env: dict[str, str], tmp_path: Path) -> None:
    bag = training_bag(tmp_path)
    alone, _, _ = follow(tmp_path / 'alone', bag, 'lockstep', 1, retrain=False)
    during, _, (first, last) = follow(tmp_path / 'during', bag, 'lockstep', 1, retrain=True)
    assert last > first > 0, 'the training did not last through the motion'
    assert 'tracking RMS' in alone
    assert during == alone
