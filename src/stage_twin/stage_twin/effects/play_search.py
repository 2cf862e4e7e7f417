"""How a drive crosses its play between a recorded force and a recorded path.

While the drive touches no edge the recorded force accelerates it alone. So it is followed from
edge to edge; what its own mass needs beyond the carriage's motion is the force that a balance of
both as one mass misses. Twice integrated that force is (mass · width) from edge to edge: of both
only the product shows well, so that the search has it in its first place.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numba import njit

from stage_core.arrays import Array
from stage_twin.effects.rows import ForceRows
from stage_twin.effects.term import Theta

#: Contact where nothing is said of it: natural frequency [Hz] and damping ratio.
FREQUENCY, DAMPING = 300.0, 0.2
#: Frequencies [Hz] that an edge may have. From 900 Hz on the plant's steps feed the edge of a
#: light carriage in a play of less than 0.4 µm, until the stage flies away.
SOFTEST, STIFFEST = 50.0, 800.0
#: Frequencies [Hz] that a search tries of an edge: of soft and of firm ones from the start, as the
#: best width beside one is not that beside the other.
STARTS = (75.0, 120.0, FREQUENCY)
#: Radians of the contact's oscillation that a substep of the search may cover.
REACH = 0.3
#: Starts that are followed side by side; 16 take less time than 14.
WIDE = 16
#: Starts of a search: share of the mass times width [m], damping ratios, and that share.
MOMENTS, DAMPINGS, SHARE = np.geomspace(3e-7, 4e-5, 14), (0.1, 0.2, 0.35, 1.5), 0.25
#: Factors that a search tries of each parameter in turn, how often at most, and within what.
FACTORS, ROUNDS = (0.5, 0.7, 0.85, 0.93, 1.07, 1.18, 1.4, 2.0), 4
WITHIN = ((1e-8, 2e-4), (0.03, 0.7), (0.02, 2.0), (SOFTEST, STIFFEST))
#: Least share of the residual that the best of them explains where a play is searched further.
LEAST = 0.03


@njit(cache=True, fastmath={'contract'})
def push(apart: float, rate: float, width: float, stiffness: float, damping: float) -> float:
    """Force [N] of the edge that a drive touches `apart` [m] from the middle; it never pulls."""
    if abs(apart) <= 0.5 * width:
        return 0.0
    pressed = stiffness * (apart - math.copysign(0.5 * width, apart)) + damping * rate
    return max(pressed, 0.0) if apart > 0.0 else min(pressed, 0.0)


@njit(cache=True, fastmath={'contract'}, error_model='numpy')
def crossed(
    force: Array,
    path: Array,
    period: float,
    mass: Array,
    width: Array,
    contact: Array,
    frequency: float,
) -> Array:
    """Where drives of some masses (k,) [kg] are in their plays, (n, k) [m], from the middle on.

    A force (n,) [N] at the ticks drives each beside a carriage on a path (n,) [m]; `contact` (k,)
    and `frequency` [Hz] are the damping ratio of the edges and the frequency of the drive on them.
    The drives go side by side: as many as a vector of the processor holds take the time of one.
    """
    natural = 2.0 * math.pi * frequency
    stiffness, damping, half = mass * natural**2, 2.0 * contact * mass * natural, 0.5 * width
    count = int(period * natural / REACH) + 1
    short = period / count
    moves, many = short / mass, len(mass)
    out = np.zeros((len(force), many))
    place, rate = np.full(many, path[0]), np.zeros(many)
    for k in range(len(force) - 1):
        speed = (path[k + 1] - path[k]) / period
        slope = (force[k + 1] - force[k]) / count
        for i in range(count):
            carriage, driving = path[k] + speed * short * i, force[k] + slope * (i + 0.5)
            for j in range(many):
                # As `push`, without branches.
                apart, slips = place[j] - carriage, damping[j] * (rate[j] - speed)
                above = max(stiffness[j] * (apart - half[j]) + slips, 0.0)
                below = min(stiffness[j] * (apart + half[j]) + slips, 0.0)
                edge = (above if apart > half[j] else 0.0) + (below if apart < -half[j] else 0.0)
                rate[j] += moves[j] * (driving - edge)
                place[j] += short * rate[j]
        for j in range(many):
            out[k + 1, j] = place[j] - path[k + 1]
    return out


class Crossing:
    """Columns of a play in the drive.

    θ is share of the mass · width [m], that share, and damping ratio and frequency of the edges.
    """

    def __init__(self, rows: ForceRows) -> None:
        self.rows = rows
        self._runs = list(zip(rows.applied(), rows.position(), rows.periods, strict=True))
        self._kept: dict[float, Array] = {}

    def columns(self, theta: Theta) -> Array:
        """Force [N] that the drive's mass needs beside the carriage's motion, (n, 1)."""
        return self._side_by_side([theta])

    def _side_by_side(self, thetas: Sequence[Theta]) -> Array:
        """Columns (n, k) of k parameters with edges of one frequency."""
        moment, share, contact, frequency = np.array(thetas).T.copy()
        own, signals = share * self.rows.mass, []
        for force, path, period in self._runs:
            place = crossed(force, path, period, own, moment / share, contact, frequency[0])
            needed = np.zeros_like(place)
            needed[1:-1] = own * np.diff(place, 2, axis=0) / period**2
            signals.append(needed)
        return self.rows.columns(*([one[:, j] for one in signals] for j in range(len(own))))

    def propose(self, residual: Array) -> tuple[Theta, ...]:
        """The start that explains most of a residual (n,); no width where none explains any."""
        found = [start for f in STARTS if (start := self._near(residual, f))]
        if not found:
            return ((0.0, SHARE, DAMPING, FREQUENCY),)
        return (max(found, key=lambda start: self._gains(self.columns(start), residual)[0]),)

    def _near(self, residual: Array, frequency: float) -> Theta:
        """The best start with edges of one frequency [Hz]; none where it explains too little."""
        starts = [(float(m), SHARE, d, frequency) for d in DAMPINGS for m in MOMENTS]
        if frequency not in self._kept:
            found = [self._side_by_side(starts[i : i + WIDE]) for i in range(0, len(starts), WIDE)]
            self._kept[frequency] = np.hstack([some.astype(np.float32) for some in found])
        gains = self._gains(self._kept[frequency], residual)
        if max(gains) < LEAST * float(residual @ residual):
            return ()
        return self._descended(starts[int(np.argmax(gains))], residual)

    def _descended(self, start: Theta, residual: Array) -> Theta:
        """The best start in turn along each parameter; the moments of impacts make it rough."""
        most = self._gains(self.columns(start), residual)[0]
        for _ in range(ROUNDS):
            before = start
            for i, (low, high) in enumerate(WITHIN):
                tried = {min(max(start[i] * f, low), high) for f in FACTORS} - {start[i]}
                others = [(*start[:i], value, *start[i + 1 :]) for value in sorted(tried)]
                # The substeps hang on the frequency of the edges.
                groups = [others] if i < 3 else [[other] for other in others]
                gains = [g for o in groups for g in self._gains(self._side_by_side(o), residual)]
                if max(gains) > most:
                    most, start = max(gains), others[int(np.argmax(gains))]
            if start == before:
                break
        return start

    @staticmethod
    def _gains(columns: Array, residual: Array) -> list[float]:
        """By how much the sum of squares of a residual falls with each column taken out."""
        gains = 2.0 * residual @ columns - np.einsum('nk,nk->k', columns, columns)
        return [float(gain) for gain in gains]
