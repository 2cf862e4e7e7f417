"""The servo backend with a small plant behind the drive link, and how it is moved."""

from contextlib import contextmanager

from stage_core.twin_file import TwinFile
from stage_driver.config import ServoConfig
from stage_driver.limits import AxisLimits
from stage_driver.servo import ServoBackend
from stage_driver.states import State

from ..patience import wait
from .driver_rig import Recorder, SmallPlant

LIMITS = AxisLimits(-0.05, 0.05, 0.2, 2.0, 4.0)


@contextmanager
def rig(lockstep=True, start=(0.0, 0.0), **options):
    plant = SmallPlant(lockstep, start)
    plant.start()
    try:
        options = {'home_required': False, 'settle_time': 0.3, **options}
        with lonely(plant.port, **options) as (backend, recorder):
            recorder.wait(lambda: recorder.states)
            yield plant, backend, recorder
    finally:
        plant.close()


@contextmanager
def lonely(port=9, **options):
    """Backend of both axes whose drive is not there (yet)."""
    recorder = Recorder()
    config = ServoConfig(
        ('x', 'y'), (LIMITS, LIMITS), TwinFile.nominal_servo(), drive_port=port, **options
    )
    backend = ServoBackend(config, recorder)
    backend.start()
    try:
        yield backend, recorder
    finally:
        backend.close()


def quiet(backend, recorder):
    """Wait until the motion has ended."""
    wait(
        lambda: backend.status().state is not State.MOVING and backend._inbox.empty(),
        backend.status,
    )


def move(backend, recorder, x, y):
    before = len(recorder.controls)
    backend.submit(0, ['x', 'y'], [x, y], [])
    recorder.wait(lambda: len(recorder.controls) > before)
    quiet(backend, recorder)


def stream(backend, recorder, count, setpoint):
    """Lockstep stream: each set-point carries the stamp of the newest joint state."""
    for k in range(count):
        stamp, positions, _ = recorder.states[-1]
        position, velocity = setpoint(k, positions)
        backend.submit(stamp, ['x', 'y'], position, velocity)
        recorder.wait(lambda stamp=stamp: recorder.states[-1][0] > stamp)
