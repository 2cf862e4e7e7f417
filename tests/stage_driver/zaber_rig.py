"""The Zaber backend with the emulated chain on a pseudo-terminal, and how it is moved."""

from contextlib import contextmanager

from stage_core.twin_file import StepperAxis, TwinFile
from stage_driver.config import ZaberConfig
from stage_driver.limits import AxisLimits
from stage_driver.states import State
from stage_driver.zaber import ZaberBackend
from stage_twin.emulators.zaber import ZaberChain
from stage_twin.emulators.zaber_pty import ZaberPty
from stage_twin.stepper import StepperPlant

from ..patience import wait
from .driver_rig import Recorder

STEPPER = TwinFile(kind='stepper', axes={'x': StepperAxis(), 'y': StepperAxis()})
LIMITS = AxisLimits(0.0, 0.05, 0.1, 1.0, 1.0)
STEP = 0.047625e-6
#: For a rig whose wire loses or delays what was said. A busy machine holds up both ends of it,
#: which live in one process.
IMPATIENT = {'reply_timeout': 0.5, 'link_timeout': 2.0}


def chain(*start):
    """Two emulated devices whose axes stand at these steps."""
    plant = StepperPlant(STEPPER)
    plant.reset(start)
    return ZaberChain(plant)


@contextmanager
def rig(tmp_path, start=(3000, 2000), **options):
    recorder, link = Recorder(), tmp_path / 'zaber'
    with ZaberPty(chain(*start), link=link) as server:
        # A busy machine is late with its answers.
        options = {'reply_timeout': 5.0, 'link_timeout': 60.0, **options}
        config = ZaberConfig(('x', 'y'), (LIMITS, LIMITS), str(link), **options)
        backend = ZaberBackend(config, recorder)
        backend.start()
        try:
            yield server, backend, recorder
        finally:
            backend.close()


def move(backend, recorder, x, y):
    backend.submit(0, ['x', 'y'], [x, y], [])
    wait(lambda: backend.status().state is State.MOVING)
    wait(lambda: backend.status().state is not State.MOVING)


def position(server):
    return [server.chain.plant.position_steps(axis) * STEP for axis in range(2)]
