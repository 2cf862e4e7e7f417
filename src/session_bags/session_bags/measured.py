"""Real measurements as sessions: what the converters share."""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
from scipy.signal import savgol_filter

from session_bags.writer import write_session
from stage_core import topics
from stage_core.arrays import Array
from stage_core.clocks import to_stamps
from stage_core.errors import StageError, command_line
from stage_core.session import Series, Session, by_topic

#: The files give no date: sessions begin near zero [ns], and no report takes that for a date.
EPOCH = 1_000_000_000
DAY = 86_400 * 1_000_000_000
MINUTE = 60 * 1_000_000_000
#: Rows of which a second derivative is made.
FEWEST = 41


def data_folder() -> Path:
    """Folder of the measurements: ``STAGE_DATA``, or ``../shared/data`` beside the checkout.

    Raises
    ------
    StageError
        If it is absent; the measurements' licences do not let the project ship them.
    """
    beside = Path(__file__).resolve().parents[4] / 'shared' / 'data'
    folder = Path(os.environ.get('STAGE_DATA', beside))
    if not folder.is_dir():
        raise StageError(
            f'the real measurements are not at {folder}: set STAGE_DATA to their folder '
            '(docs/concepts/bags.md names the public sources)'
        )
    return folder


def derivative(values: Array, seconds: Array, window: int = 21, order: int = 1) -> Array:
    """Derivative of each column of `values` (n, k) on nearly even `seconds` (n,).

    Savitzky-Golay, third order: no phase lag, and noise of one sample does not swamp it.
    """
    step = float(np.median(np.diff(seconds)))
    return savgol_filter(values, window, 3, deriv=order, delta=step, axis=0)


def second_derivative(values: Array, seconds: Array, window: int = FEWEST) -> Array:
    """Second derivative, as :func:`derivative`."""
    return derivative(values, seconds, window, 2)


def fit_force(effort: Array, speed: Array, acceleration: Array) -> tuple[float, float]:
    """Mass and viscous coefficient of one axis, in units of `effort` (n,): least squares.

    effort = mass · acceleration + viscous · speed + Coulomb · sign(speed) + constant. The last two
    keep the first two unbiased; a nominal twin does not hold them.
    """
    columns = np.column_stack([acceleration, speed, np.sign(speed), np.ones_like(speed)])
    found, *_ = np.linalg.lstsq(columns, effort, rcond=None)
    return float(found[0]), float(found[1])


def drive_session(
    name: str,
    seconds: Array,
    start: int,
    reference: Array,
    encoder: Array,
    effort: Array,
    velocity_command: Array | None = None,
) -> Session:
    """A session of reference, encoder and drive effort, each of shape (n, axes)."""
    command = {'effort': effort}
    if velocity_command is not None:
        command = {'velocity': velocity_command, **command}
    stamps = to_stamps(seconds, start)
    motion = {'position': reference, 'velocity': derivative(reference, seconds)}
    measured = {'position': encoder, 'velocity': derivative(encoder, seconds)}
    found = by_topic(
        Series.per_axis(topics.REFERENCE, stamps, **motion),
        Series.per_axis(topics.JOINT_STATES, stamps, **measured),
        Series.per_axis(topics.COMMAND, stamps, **command),
    )
    return Session(name, found)


def converter(title: str, sessions: Callable[[Path], Mapping[str, Session]]) -> Callable[..., int]:
    """Command of a converter: ``--out DIR`` gets one bag per session of the measurements."""

    @command_line
    def main(arguments: Sequence[str] | None = None) -> int:
        parser = argparse.ArgumentParser(description=title)
        parser.add_argument('--out', type=Path, required=True, help='folder for the bags')
        parser.add_argument('--data', type=Path, help='folder of the measurements')
        parsed = parser.parse_args(arguments)
        folder = parsed.data or data_folder()
        try:
            found = sessions(folder)
        except (ValueError, IndexError, ZeroDivisionError, np.linalg.LinAlgError) as error:
            raise StageError(
                f'{folder} holds other arrays than those that this converter is for ({error}): '
                'see docs/concepts/bags.md'
            ) from error
        for name, session in found.items():
            path = write_session(parsed.out / name, session)
            print(f'{path}: {sum(len(s) for s in session.series.values())} messages')
            for warning in session.warnings:
                print(f'{path}: {warning}')
        return 0

    return main


def load(
    path: Path, needed: Sequence[str], timed: Mapping[str, Sequence[str]] | None = None
) -> dict[str, Array]:
    """Arrays of an ``.npz`` or ``.mat`` file, those of the names `needed` among them.

    `timed` names arrays of one row per time, by the array of these times [s].

    Raises
    ------
    StageError
        If the file is absent or unreadable, lacks an array, or if one is empty or not finite, has
        another number of rows than its times, or times that do not increase.
    """
    try:
        numbers = {k: v for k, v in _content(path).items() if v.dtype.kind in 'fiub'}
        arrays = {k: np.asarray(v, float) for k, v in numbers.items()}
    except Exception as error:  # whatever a parser raises on what it was not written for
        raise StageError(f'cannot read {path} ({error}): name the folder of the data') from error
    missing = [name for name in needed if name not in arrays]
    if missing:
        raise StageError(f'{path} lacks {", ".join(missing)}: it needs {", ".join(needed)}')
    for name in needed:
        if not arrays[name].size or not np.all(np.isfinite(arrays[name])):
            raise StageError(f'{path}: {name} is empty or holds what is no finite number')
    for time, names in (timed or {}).items():
        seconds = arrays[time].ravel()
        if len(seconds) < FEWEST or not np.all(np.diff(seconds) > 0.0):
            raise StageError(f'{path}: {time} must hold {FEWEST} or more times that increase')
        for name in names:
            if len(arrays[name]) != len(seconds):
                raise StageError(
                    f'{path}: {name} has {len(arrays[name])} rows, its times {time} '
                    f'have {len(seconds)}'
                )
    return arrays


def _content(path: Path) -> Mapping[str, Array]:
    if path.suffix == '.mat':
        from scipy.io import loadmat

        return {k: v for k, v in loadmat(path).items() if not k.startswith('__')}
    found = np.load(path)
    if not isinstance(found, np.lib.npyio.NpzFile):
        raise ValueError('no archive of arrays')
    return dict(found)
