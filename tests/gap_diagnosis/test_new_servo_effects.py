"""Effects of the drive and of the machine around it are named with their parameters."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from gap_diagnosis.diagnose import diagnose
from stage_core.session import Session
from stage_core.twin_file import TwinFile
from stage_twin.effects import EFFECTS

Maker = Callable[..., Session]


@pytest.mark.parametrize(
    ('effect', 'planted_values', 'tolerance'),
    [
        ('axis_crosstalk.x', {'mass': 1.5, 'viscous': 20.0}, 0.1),
        ('current_loop_lag.x', {'time_constant': 2e-3}, 0.1),
        ('torque_sag.x', {'sag_force': 2e-3}, 0.1),
        ('torque_sag.x', {'sag_force': 0.0, 'sag_speed': 1.0}, 0.1),
    ],
)
def test_a_planted_effect_is_named(
    planted: Maker, effect: str, planted_values: dict[str, float], tolerance: float
) -> None:
    coupled = effect.startswith('axis_crosstalk')
    axes = ('x', 'y') if coupled else ('x',)
    session = planted({effect: planted_values}, axes=axes, duration=12.0)
    twin = TwinFile.nominal_servo()
    if not coupled:
        twin = TwinFile.from_dict({**twin.to_dict(), 'axes': {'x': twin.to_dict()['axes']['x']}})
    found = diagnose([session], [], twin)
    assert found.verdict == [effect]
    for name, value in planted_values.items():
        estimate, deviation = found.parameters[effect][name]
        near = pytest.approx(value, rel=tolerance, abs=2.0 * deviation)
        assert estimate == near, EFFECTS[effect.partition('.')[0]].parameter(name).meaning
