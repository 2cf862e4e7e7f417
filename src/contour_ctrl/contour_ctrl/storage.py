"""Learned signals on disk: an npz without pickles, bound to a contour and a machine."""

from __future__ import annotations

import hashlib
import json
import zipfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from stage_core.arrays import Array
from stage_core.errors import StageError
from stage_core.untrusted import json_object
from stage_core.whole_file import replacing

FORMAT = 'contour-learning/1'
#: What a file that is no archive of arrays raises.
_UNREADABLE = (OSError, ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile)


@dataclass(frozen=True)
class Learned:
    """What a contour has taught on one machine: signal (n, 2) [m/s] and CMAC weights."""

    contour: str
    machine: str
    signal: Array
    weights: Array


def file_of(folder: str | Path, contour: str, machine: str, scheme: str) -> Path:
    """Where a contour's learning on a machine is kept: no other one takes its place."""
    key = hashlib.sha256(f'{contour} {machine}'.encode()).hexdigest()[:12]
    return Path(folder) / f'learned_{scheme.replace("+", "_")}_{key}.npz'


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
        No file, an unreadable one, or one of another contour or machine.
    """
    if not Path(path).exists():
        raise StageError(
            f'nothing is learned yet of this contour, feed, rate, scheme and machine in '
            f'{Path(path).parent}: set reuse_learned to false for a first run'
        )
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
    if known[1:] != (contour, machine):
        raise StageError(f'{path} was learned on another contour or machine: delete it')
    if not (np.all(np.isfinite(signal)) and np.all(np.isfinite(weights))):
        raise StageError(f'{path} holds values that are not finite: delete it')
    return Learned(contour, machine, signal, weights)
