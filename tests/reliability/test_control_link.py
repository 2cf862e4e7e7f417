"""What keeps the servo loop stable: fresh forces, and a following error that is judged fairly."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stage_core.twin_file import TwinFile
from stage_driver.config import ServoConfig
from stage_driver.limits import AxisLimits, Setpoint, SetpointKind
from stage_driver.servo_axes import ServoAxes

LIMITS = (AxisLimits(-0.15, 0.15, 0.2, 2.0, 4.0),) * 2
PERIOD = 1e-3
SPEED = 0.1


def follow(
    skip: int,
    blocked_at: int | None = None,
    speed: float = SPEED,
    gain: float = 40.0,
    frozen: bool = False,
) -> tuple[str | None, float]:
    """Follow a stream of positions and velocities of which only every `skip`-th tick arrives.

    The plant is the one of interfaces.md, "Servo plant". From tick 300 on a `frozen` stream
    repeats its position while its velocity goes on. Returns the fault, if any, and the last
    position [m].
    """
    twin = TwinFile.nominal_servo()
    axes = ServoAxes(replace(ServoConfig(('x', 'y'), LIMITS, twin)))
    axes.begin((0.0, 0.0))
    position, velocity = np.zeros(2), np.zeros(2)
    mass = np.array([twin.servo(axis).mass for axis in 'xy'])
    viscous = np.array([twin.servo(axis).viscous for axis in 'xy'])
    fault = None
    for tick in range(600):
        axes.measure((np.round(position / 1e-6) * 1e-6).tolist())
        if tick % skip == 0:
            wanted = speed * PERIOD * (min(tick, 300) if frozen else tick)
            rate = speed if frozen else speed + gain * (wanted - position[0] - speed / 40.0)
            axes.motion.take(
                Setpoint(SetpointKind.BOTH, tick + 1, (wanted, 0.0), (float(rate), 0.0)),
                axes.encoder,
            )
        axes.control()
        if blocked_at is not None and tick >= blocked_at:
            velocity[:] = 0.0
        else:
            velocity += PERIOD * (axes.force - viscous * velocity) / mass
            position += PERIOD * velocity
        fault = fault or axes.following_fault()
    return fault, float(position[0])


@pytest.mark.parametrize('skip', [1, 5, 20])
def test_a_stream_that_skips_ticks_is_no_following_error(skip: int) -> None:
    fault, reached = follow(skip)
    assert fault is None
    assert reached == pytest.approx(SPEED * 0.6 - SPEED / 40.0, abs=3e-3)


@pytest.mark.parametrize('skip', [20, 90])
def test_a_fast_stream_that_is_late_is_no_following_error(skip: int) -> None:
    # The gain of a controller that is stable at this rate.
    fault, _ = follow(skip, speed=0.19, gain=5.0)
    assert fault is None


def test_positions_that_stand_still_while_their_velocity_goes_on_are_one() -> None:
    fault, reached = follow(5, frozen=True)
    assert fault is not None and reached > 0.03


@pytest.mark.parametrize('skip', [1, 5, 20])
def test_a_blocked_axis_is_one_whatever_the_stream_skips(skip: int) -> None:
    fault, _ = follow(skip, blocked_at=300)
    assert fault is not None and 'following error of x' in fault
