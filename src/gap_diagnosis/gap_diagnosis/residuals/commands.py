"""What the recorded commands of a controller tell: a law of its own, a limit of its force."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d

from gap_diagnosis.input.data import Record
from gap_diagnosis.input.noise import GAUSS
from gap_diagnosis.parameters import Estimates, Parameters
from gap_diagnosis.residuals.control_law import EDGE, force_increments, quiet, velocity_law
from gap_diagnosis.residuals.controller import MISMATCH, follows, is_plain, mismatch, with_found
from stage_core.arrays import Array
from stage_core.twin_file import ServoAxis, TwinFile

Mask = NDArray[np.bool_]

#: Ticks at the largest force that make a limit: by chance a peak lasts one or two.
PLATEAU = 5
#: Ticks over which the noise of an effort is averaged, and its deviations below the largest such
#: average from which on an effort may stand at a limit.
AVERAGED, BELOW = 9, 2.0
#: Mean square of what the law leaves of the increments of an effort, over that of the increments:
#: at a limit at least, and away from it at most. At limits it was 4 to 900, at other peaks 0.003,
#: away from limits 0.0005.
HELD, FOLLOWED = 1.5, 0.5
#: Deviations of the effort's own noise that hold a plateau of some hundred ticks.
ON_TOP = 5.0
#: The share HELD where the noise of the effort is known without the controller's answer to that of
#: the encoder: 5 and 2200 on two plateaus, about 1 on a smooth peak, which holds that noise alone.
STANDS = 3.0
#: Share of the largest force from which on ticks are those of a plateau, if there is one.
NEAR_THE_TOP = 0.9


def declared_terms(records: list[Record], twin: TwinFile) -> list[Record]:
    """The records, in which set-points declare what goes beyond a position loop of any gains.

    A controller that streams such a loop is a controller: its gains are findings. The terms of a
    contour controller, cross-coupled or learned, are inputs, and its gains with them.
    """
    moving = [i for i in range(len(records[0].axes)) if any(r.moving[i] for r in records)]
    if twin.kind != 'servo' or not any(r.declared.any() for r in records):
        return records
    if all(is_plain(records, i, twin.servo(records[0].axes[i])) for i in moving):
        return [replace(r, setpoint_velocity=None) for r in records]
    return records


def controller_findings(
    records: list[Record], twin: TwinFile
) -> tuple[Parameters, tuple[str, ...]]:
    """`controller_mismatch` and `force_saturation` of each axis, read from the commands.

    Returns
    -------
    found : empty where the recorded commands follow the twin's law
    unlike : axes whose controller does more than the gains that were found explain
    """
    found: Parameters = {}
    unlike: list[str] = []
    for i, name in enumerate(records[0].axes if twin.kind == 'servo' else []):
        if not any(r.moving[i] for r in records):
            continue
        limit, other, like = _told(records, i, twin.servo(name))
        if limit is not None:
            found[f'force_saturation.{name}'] = {'limit': (limit, 1e-3 * limit), 'known': (1, 0.0)}
        if other:
            found[f'controller_mismatch.{name}'] = other
        if not like:
            unlike.append(name)
    return found, tuple(unlike)


def _told(records: list[Record], i: int, axis: ServoAxis) -> tuple[float | None, Estimates, bool]:
    """Limit [N] at which the force of an axis stands, other gains, whether they explain it."""
    limit = _plateau(records, i, axis)
    axis = axis if limit is None else replace(axis, force_limit=limit)
    if not all(r.effort_recorded for r in records):
        return limit, {}, True
    other, like = _other_gains(records, i, axis)
    # What other gains explain, each tick, stands at no limit.
    explained = other and like and _follows(records, i, with_found(axis, MISMATCH, other))
    if limit is None and not explained:
        noise = max(_effort_noise(r, i) for r in records)
        # The mean of a plateau is what a loop without the noise needs: it is below the limit.
        limit = _noisy_plateau(records, i, axis, noise)
        if limit is None:
            limit, noise = _standing(records, i, axis)
        if limit is not None:
            axis = replace(axis, force_limit=limit - 3.0 * noise)
            other, like = _other_gains(records, i, axis)
    return limit, other, like


def _other_gains(records: list[Record], i: int, axis: ServoAxis) -> tuple[Estimates, bool]:
    """`controller_mismatch` of an axis, and whether its commands follow the law with it."""
    other = mismatch(records, i, axis)
    return other, not other or follows(records, i, axis, other)


def _follows(records: list[Record], i: int, axis: ServoAxis) -> bool:
    """Whether the law of an axis is most of what its effort does from tick to tick."""
    law, own = _increments(records, i, axis)
    return _left(law, own, np.ones(len(own), np.bool_)) <= FOLLOWED


def _increments(records: list[Record], i: int, axis: ServoAxis) -> tuple[Array, Array]:
    """Increments (n,) of the law of an axis, and those of its effort [N]."""
    law = [force_increments(r, i, axis, velocity_law(r, i, axis)) for r in records]
    return np.concatenate(law), np.concatenate([np.diff(r.force[:, i]) for r in records])


def _plateau(records: list[Record], i: int, axis: ServoAxis) -> float | None:
    """Force at which the recorded commands are clipped, below the twin's limit; else None."""
    force = np.abs(np.concatenate([r.force[:, i] for r in records]))
    peak = float(force.max())
    at_peak = force > peak * (1.0 - 1e-9)
    if peak >= 0.999 * axis.force_limit or np.count_nonzero(at_peak) < PLATEAU:
        return None
    runs = np.convolve(at_peak, np.ones(3), 'valid')
    return peak if runs.max() >= 3.0 else None


def _standing(records: list[Record], i: int, axis: ServoAxis) -> tuple[float | None, float]:
    """The same of an effort with noise of its own [N], by which it leaves the law tick by tick.

    The noise is returned, too: that of an effort which mostly stands at its limit is not known
    before, because it mostly leaves the law.
    """
    law, own = _increments(records, i, axis)
    force = [np.abs(r.force[:, i]) for r in records]
    peak = max(float(one.max()) for one in force)
    if peak >= 0.999 * axis.force_limit:
        return None, 0.0
    # Where the force mostly stands, its steps there tell the noise.
    near = np.concatenate([np.minimum(one[1:], one[:-1]) > NEAR_THE_TOP * peak for one in force])
    still = np.concatenate([np.diff(one) for one in force])[near]
    for left in (own - law, still):
        noise = GAUSS * float(np.median(np.abs(left))) / math.sqrt(2.0) if len(left) else math.inf
        least = peak - ON_TOP * noise
        high = np.concatenate([(one[1:] >= least) & (one[:-1] >= least) for one in force])
        stands = np.count_nonzero(high) >= PLATEAU and _left(law, own, high) > STANDS
        if stands and _left(law, own, ~high) <= FOLLOWED:
            return float(np.median(np.concatenate([one[1:] for one in force])[high])), noise
    return None, 0.0


def _noisy_plateau(records: list[Record], i: int, axis: ServoAxis, noise: float) -> float | None:
    """The same of an effort with noise [N]: where it is largest it stands, and the law goes on."""
    kept = np.ones(AVERAGED) / AVERAGED
    smooth = [np.convolve(np.abs(r.force[:, i]), kept, 'same') for r in records]
    least = max(float(one.max()) for one in smooth) - BELOW * noise
    if noise == 0.0 or least + BELOW * noise >= 0.999 * axis.force_limit:
        return None
    high = np.concatenate([(one[1:] >= least) & (one[:-1] >= least) for one in smooth])
    laws = [force_increments(r, i, axis, velocity_law(r, i, axis)) for r in records]
    written = [np.diff(r.force[:, i]) for r in records]
    law, own = (
        np.concatenate([quiet(r, i, one) for r, one in zip(records, side, strict=True)])
        for side in (laws, written)
    )
    # `quiet` spreads what follows no law.
    reach = 2 * round(EDGE / records[0].period) + 1
    apart = ~maximum_filter1d(high.astype(np.uint8), reach).astype(bool)
    held = np.count_nonzero(high) >= PLATEAU * AVERAGED and _left(law, own, high) > HELD
    if not (held and apart.any() and _left(law, own, apart) < FOLLOWED):
        return None
    force = np.concatenate([np.abs(r.force[1:, i]) for r in records])
    return float(np.median(force[high]))


def _left(law: Array, own: Array, rows: Mask) -> float:
    """Share of the increments `own` (n,) of an effort that the law's leave at some rows."""
    return float(np.sum((own - law)[rows] ** 2) / max(np.sum(own[rows] ** 2), 1e-300))


def _effort_noise(record: Record, i: int) -> float:
    """Noise of the effort of an axis [N]; 0 where it is not known."""
    return 0.0 if record.noise is None else record.noise.axes[i].effort
