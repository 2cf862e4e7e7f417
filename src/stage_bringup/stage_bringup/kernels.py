"""Compiles the kernels before anything waits for them: ``python -m stage_bringup.kernels``.

Numba keeps what it compiled in NUMBA_CACHE_DIR, or beside the sources; the nodes then load it.

What compiles is imported by the process that compiles, so that this one speaks at once.
"""

from __future__ import annotations

import hashlib
import multiprocessing
import os
import signal
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import contextmanager, suppress
from importlib.metadata import version
from multiprocessing.resource_tracker import ensure_running
from pathlib import Path

SENTENCE = 'compiling the kernels (about 40 s, once)'
_SOURCES = Path(__file__).resolve().parents[2]


def _machine() -> None:
    from stage_core.twin_file import TwinFile
    from stage_twin.plant import ServoPlant

    ServoPlant(TwinFile.nominal_servo()).warm_up()


def _driver() -> None:
    from stage_core.twin_file import TwinFile
    from stage_driver.config import ServoConfig
    from stage_driver.limits import AxisLimits
    from stage_driver.servo_axes import ServoAxes

    limits = tuple(AxisLimits(-0.1, 0.1, 0.1, 1.0, 1.0) for _ in 'xy')
    ServoAxes(ServoConfig(twin=TwinFile.nominal_servo(), axes=('x', 'y'), limits=limits))


def _contour() -> None:
    from contour_ctrl.sequence import compile_kernels

    compile_kernels()


def _calibration() -> None:
    import numpy as np

    from calibrator.samples import Samples
    from calibrator.training import train

    places = np.random.default_rng(0).uniform(0.0, 0.1, (40, 2))
    times, one_way, no_sensor = np.arange(40.0), np.ones((40, 2)), np.empty((40, 0))
    measured = (places, 1.001 * places, one_way, no_sensor, times)
    train(
        Samples(*measured, (), ('x', 'y'), 0.0, True), 'it2fls', {'particles': 2, 'iterations': 1}
    )


def _diagnosis() -> None:
    import numpy as np

    from gap_diagnosis.residuals import low_pass, operators
    from gap_diagnosis.residuals.stands import Stands
    from stage_twin.effects import backlash, friction, play_search

    path, one = np.zeros(1 << 14), np.ones(1)  # so long that a low-pass cuts it
    low_pass.smooth(path, 1e-3, 50.0)
    low_pass.band_limited(path, 1e-3)
    operators.sure_turns(path, 1e-6)
    backlash.slack(path, 1e-6)
    friction.presliding_state(path, 1e-6)
    play_search.crossed(path, path, 1e-3, one, one, one, 200.0)
    Stands(np.zeros(1, int), np.full(1, 9), one).freed(path)


def _simulation() -> None:
    import numpy as np

    from stage_core.twin_file import TwinFile
    from stage_twin.kinematics import carry, motor_path
    from stage_twin.measured_force import required_force
    from stage_twin.simulate import simulate

    twin, still = TwinFile.nominal_servo(), np.zeros((4, 2))
    simulate(twin, still, still)
    carry(twin, motor_path(twin, still))
    required_force(twin, np.zeros((64, 2)))


#: What is compiled, with the name that a person reads.
PARTS: dict[str, Callable[[], None]] = {
    'the emulated machine': _machine,
    'the servo driver': _driver,
    'the contour controller': _contour,
    'the simulation of the diagnosis': _simulation,
    'the filters of the diagnosis': _diagnosis,
    'the training of the calibration': _calibration,
}


def marker() -> Path:
    """File that says that these sources were compiled by this Numba."""
    state = hashlib.sha256(version('numba').encode())
    for source in sorted(_SOURCES.glob('*/*/**/*.py')):
        text = source.read_bytes()
        if b'njit' in text:
            state.update(text)
    folder = os.environ.get('NUMBA_CACHE_DIR') or Path(__file__).parent / '__pycache__'
    return Path(folder) / f'compiled-{sys.implementation.cache_tag}-{state.hexdigest()[:12]}'


@contextmanager
def _deaf_to_ctrl_c() -> Iterator[None]:
    """Processes that are started here do not hear Ctrl-C, and end without a traceback each."""
    # Blocked, not ignored: one that comes meanwhile waits for this process.
    ensure_running()  # The start of multiprocessing's own helper would unblock it.
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def compile_missing() -> bool:
    """Compile every part and say how far it is; False, without a word, where all is compiled."""
    if marker().exists():
        return False
    print(SENTENCE, flush=True)
    workers, context = min(len(PARTS), os.cpu_count() or 1), multiprocessing.get_context('spawn')
    with ProcessPoolExecutor(workers, context) as pool:
        try:
            with _deaf_to_ctrl_c():
                waiting = {pool.submit(part): name for name, part in PARTS.items()}
            for number, done in enumerate(as_completed(waiting), 1):
                done.result()
                share = 100 * number / len(PARTS)
                print(f'  {share:3.0f} % compiled {waiting[done]}', flush=True)
        except KeyboardInterrupt:
            for worker in multiprocessing.active_children():
                worker.terminate()
            raise
    # A cache that cannot be written is compiled anew each time, as Numba itself does.
    with suppress(OSError):
        place = marker()
        place.parent.mkdir(parents=True, exist_ok=True)
        place.touch()
    return True


def main() -> int:
    """Compile what is not compiled yet."""
    compile_missing()
    return 0


if __name__ == '__main__':
    sys.exit(main())
