"""Records of machines that others built: what their authors name is found, and nothing else."""

from pathlib import Path

import numpy as np
import pytest

from benchmarks.real_records import ROWS, diagnosed
from stage_twin.effects import periodic


def of_record(row: str, data_root: Path) -> dict[str, dict[str, float]]:
    """Accepted effects of a row with their parameters."""
    found = diagnosed(ROWS[row], data_root)
    return {
        c['effect']: {name: value for name, (value, _) in c['parameters'].items()}
        for c in found['causes']
    }


def test_cyclic_error_of_a_rotary_axis(data_root: Path) -> None:
    """The acceptance report of `ess_tank` names a period of 5 to 6 degrees."""
    found = of_record('ess_stroke', data_root)
    assert set(found) == {'cyclic_pitch_error.x', 'unknown'}
    assert 5.0 < np.degrees(found['cyclic_pitch_error.x']['period']) < 6.1


def test_cogging_of_a_motor(data_root: Path) -> None:
    """Seven pole pairs; a drive that gives less force would leave less, and explain nothing."""
    found = of_record('odrive_nocomp', data_root)
    assert set(found) == {'force_ripple.x', 'force_offset.x'}
    turn = 2.0 * np.pi
    assert turn / found['force_ripple.x']['period'] == pytest.approx(7.0, abs=0.05)


def test_wave_of_two_turns_repeats_and_a_bend_does_not() -> None:
    """What is the same in both halves of the travel is a wave."""
    position = np.linspace(0.3, 0.5, 4000)
    frequency = 2.4 / 0.2
    assert periodic.repeats(position, frequency, np.sin(2.0 * np.pi * frequency * position + 1.0))
    bent = np.exp(-20.0 * (position - 0.3)) * np.sin(2.0 * np.pi * frequency * position)
    assert not periodic.repeats(position, frequency, bent)
