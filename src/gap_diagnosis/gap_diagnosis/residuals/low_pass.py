"""Low-passes without phase: a recursive filter runs over a signal forwards and then backwards.

Each step of such a filter waits for the last one. So a signal is cut into stretches that go side
by side: as many as a vector of the processor holds take the time of one. Each begins so early and
ends so late that nothing is left in it of where it was cut.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache

import numpy as np
from numba import njit

from stage_core.arrays import Array

#: Added to what a recursive filter takes in: after an input of zeros its state fades below what a
#: processor computes at full speed (2e-308), and each later step takes twelve times as long.
TINY = 1e-100
PADDING = 15  # rows by which a signal is mirrored at its ends, as SciPy does for two sections
#: Stretches of a signal, of how few columns it is cut (four take longer so), and share of a state
#: that is nothing.
STRETCHES, FEW, NOTHING = 8, 2, 1e-17


def smooth(signal: Array, period: float, corner: float) -> Array:
    """Zero-phase low-pass 1 / (1 + (f / corner)²): a first-order filter forwards and backwards.

    Its roll-off of f⁻² makes the noise of a twice differentiated position white above the
    corner [Hz]. `signal` has shape (n,) or (n, k).
    """
    decay = math.exp(-2.0 * math.pi * corner * period)
    out = np.array(signal, dtype=np.float64, order='C')
    _both_ways(out, decay, lambda r, *of: _smooth(r, decay, *of))
    return out


def band_limited(signal: Array, period: float, corner: float = 90.0) -> Array:
    """Zero-phase Butterworth low-pass (n,) or (n, k), flat to about 0.8 of the corner [Hz].

    Keeps the encoder's noise out of a regressor that the target shares it with. It is SciPy's
    `sosfiltfilt`, compiled for all columns at once.
    """
    sections, start, slowest = _sections(min(2.0 * corner * period, 0.9))
    before, after = signal[PADDING:0:-1], signal[-2 : -PADDING - 2 : -1]
    padded = np.concatenate([2.0 * signal[:1] - before, signal, 2.0 * signal[-1:] - after])
    _both_ways(padded, slowest, lambda r, *of: _pass_sections(r, sections, start, *of))
    return padded[len(before) : len(before) + len(signal)]


@lru_cache
def _sections(corner: float) -> tuple[Array, Array, float]:
    """Two second-order sections (2, 6), their states (2, 2) at rest on a one, slowest decay."""
    # Only here: it takes half a second to import, which the start of a node need not pay.
    from scipy.signal import butter, sosfilt_zi

    sections = np.asarray(butter(4, corner, output='sos'))
    decay = max(float(np.abs(np.roots(section[3:])).max()) for section in sections)
    return sections, np.asarray(sosfilt_zi(sections)), decay


def _both_ways(signal: Array, decay: float, run: Callable[[Array, int, int], None]) -> None:
    """Filter a signal (n,) or (n, k) in place; the filter forgets by the factor `decay` a row.

    `run` filters columns (n, k) in place; the last so many columns have so many rows of signal.
    """
    columns = signal.reshape(len(signal), -1)
    count, width = columns.shape
    reach = math.ceil(math.log(NOTHING) / math.log(max(decay, NOTHING)))
    if width > FEW or count < 4 * STRETCHES * reach:
        run(columns, count, width)
        return
    length = -(-count // STRETCHES)
    wide = np.empty((length + 2 * reach, STRETCHES * width))
    _cut(columns, length, reach, wide)
    run(wide, count - (STRETCHES - 1) * length + reach, width)
    _join(wide, length, reach, columns)


@njit(cache=True, error_model='numpy')
def _cut(columns: Array, length: int, reach: int, wide: Array) -> None:
    """Stretches of columns (n, k), one beside another; each holds `reach` rows of its neighbours.

    What lies before the first is its first value, what lies behind the last one its last.
    """
    count, width = columns.shape
    for s in range(wide.shape[1] // width):
        for i in range(len(wide)):
            row = min(max(s * length + i - reach, 0), count - 1)
            for j in range(width):
                wide[i, s * width + j] = columns[row, j]


@njit(cache=True, error_model='numpy')
def _join(wide: Array, length: int, reach: int, out: Array) -> None:
    """Put columns (n, k) together of their stretches."""
    count, width = out.shape
    for s in range(wide.shape[1] // width):
        for i in range(min(length, count - s * length)):
            for j in range(width):
                out[s * length + i, j] = wide[i + reach, s * width + j]


@njit(cache=True)
def _hold(columns: Array, last: int, width: int) -> None:
    """Keep the value of the last row of signal in all rows behind it, of the last columns.

    A filter that runs back begins at rest on what the signal has become at its end.
    """
    for i in range(last, len(columns)):
        for j in range(columns.shape[1] - width, columns.shape[1]):
            columns[i, j] = columns[last - 1, j]


@njit(cache=True, fastmath={'contract'})
def _smooth(columns: Array, decay: float, last: int, width: int) -> None:
    """Run both ways with new = decay · old + (1 - decay) · input, each from its first value."""
    new, (count, many) = 1.0 - decay, columns.shape
    for i in range(1, count):
        for j in range(many):
            columns[i, j] = decay * columns[i - 1, j] + (new * columns[i, j] + TINY)
    _hold(columns, last, width)
    for i in range(count - 2, -1, -1):
        for j in range(many):
            columns[i, j] = decay * columns[i + 1, j] + (new * columns[i, j] + TINY)


@njit(cache=True, fastmath={'contract'})
def _pass_sections(columns: Array, sections: Array, start: Array, last: int, width: int) -> None:
    """Run both ways with two sections of second order, each from its first value."""
    state = np.empty((4, columns.shape[1]))
    _rest(columns[0], start, state)
    for i in range(len(columns)):
        _next(columns, i, sections, state)
    _hold(columns, last, width)
    _rest(columns[-1], start, state)
    for i in range(len(columns) - 1, -1, -1):
        _next(columns, i, sections, state)


@njit(cache=True)
def _rest(row: Array, start: Array, state: Array) -> None:
    """The states (4, k) at rest on the values (k,) of a row."""
    for k in range(4):
        state[k] = start[k // 2, k % 2] * row


@njit(cache=True, fastmath={'contract'}, inline='always')
def _next(columns: Array, i: int, sections: Array, state: Array) -> None:
    """A row after two sections with the states (4, k)."""
    b0, b1, b2, _, a1, a2 = sections[0]
    d0, d1, d2, _, c1, c2 = sections[1]
    for j in range(columns.shape[1]):
        u = columns[i, j] + TINY
        v = b0 * u + state[0, j]
        state[0, j] = (b1 * u + state[1, j]) - a1 * v
        state[1, j] = b2 * u - a2 * v
        w = d0 * v + state[2, j]
        state[2, j] = (d1 * v + state[3, j]) - c1 * w
        state[3, j] = d2 * v - c2 * w
        columns[i, j] = w
