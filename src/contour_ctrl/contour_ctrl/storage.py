"""Learned signals on disk: an npz without pickles, bound to a contour and a machine."""

from __future__ import annotations

import json
import zipfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from stage_core.errors import StageError
from stage_core.untrusted import json_object
from stage_core.whole_file import replacing

FloatArray = NDArray[np.float64]

FORMAT = 'contour-learning/1'
FILE_NAME = 'learned.npz'
#: What a file that is no archive of arrays raises.
_UNREADABLE = (OSError, ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile)


@dataclass(frozen=True)
class Learned:
    """What a contour has taught on one machine: signal (n, 2) [m/s] and CMAC weights."""

    contour: str
    machine: str
    signal: FloatArray
    weights: FloatArray


def save(path: str | Path, learned: Learned, notes: dict[str, str] | None = None) -> None:
    """Write a learned signal; the header is JSON text in the array `header`."""
    header = {
        'format': FORMAT,
        'contour': learned.contour,
        'machine': learned.machine,
        'notes': notes or {},
    }
    target = Path(path)
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        with replacing(target) as file:
            np.savez(
                file,
                header=np.array(json.dumps(header)),
                signal=learned.signal,
                weights=learned.weights,
            )
    except OSError as error:
        raise StageError(
            f'cannot write the learned signal {path} ({error.strerror}): check session_folder'
        ) from None


def load(path: str | Path, contour: str, machine: str) -> Learned:
    """Read a learned signal for this contour and machine.

    Raises
    ------
    StageError
        An unreadable file, or one of another contour or machine.
    """
    try:
        with np.load(path, allow_pickle=False) as content:
            header = json_object(str(content['header']), 'its header', 'delete the file')
            signal = np.asarray(content['signal'], dtype=float)
            weights = np.asarray(content['weights'], dtype=float)
        known = header['format'], header['contour'], header['machine']
    except (*_UNREADABLE, StageError) as error:
        raise StageError(
            f'{path} holds no learned signal ({type(error).__name__}): '
            'delete it or set reuse_learned to false'
        ) from None
    if known[0] != FORMAT:
        raise StageError(f'{path} has the format {known[0]}, wanted is {FORMAT}: delete it')
    if known[1] != contour:
        raise StageError(
            f'{path} was learned on another contour, feed or rate: '
            'set reuse_learned to false or name another session_folder'
        )
    if known[2] != machine:
        raise StageError(
            f'{path} was learned on the machine {known[2]!r}, this is {machine!r}: '
            'set reuse_learned to false or name another session_folder'
        )
    if not (np.all(np.isfinite(signal)) and np.all(np.isfinite(weights))):
        raise StageError(f'{path} holds values that are not finite: delete it')
    return Learned(contour, machine, signal, weights)
