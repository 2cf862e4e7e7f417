"""LuGre parameters of an axis from a recorded session.

Force balance: effort = m a + sigma_2 v + F_c f(v) + offset, with f the bristle force of
eqs. 6 and 7 over F_c. For given F_s/F_c, v_s and presliding distance F_c/sigma_0 it is linear in
the rest, so a search over few numbers remains (variable projection; Golub and Pereyra,
Inverse Problems 19, 2003). The presliding distance comes from slow reversals, see
`_presliding`. sigma_1 stays zero: a millisecond of encoder counts does not show it.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d, minimum_filter1d
from scipy.optimize import least_squares, minimize_scalar

from contour_ctrl.friction import LuGre, lugre_force
from contour_ctrl.friction_estimate import (
    FrictionEstimate,
    NoFriction,
    refuse_noise,
    refuse_useless,
)
from stage_core import topics
from stage_core.arrays import Array
from stage_core.errors import StageError, command_line
from stage_core.metrics import Metrics
from stage_core.session import Session

#: Bounds of F_s/F_c - 1 and v_s [m/s], and of the presliding distance [m].
LOWER, UPPER = np.array([1e-3, 1e-4]), np.array([4.0, 0.1])
PRESLIDING = np.array([1e-7, 2e-4])
#: Starts of the search, (F_s/F_c - 1, v_s).
STARTS = ((0.3, 2e-3), (0.3, 2e-2), (1.0, 5e-3))
#: Presliding while the sliding force is fitted: nothing that it acts on takes part in that fit.
TYPICAL_PRESLIDING = 3e-6
#: Slower than this the axis counts as standing [m/s].
STANDING = 3e-4
#: A reversal is read between these shares of the static force: a larger share needs that force
#: more exactly.
REVERSAL = 0.6
#: A reversal counts as slow where it takes this many lengths of the smoothing, and where it stays
#: below this share of v_s; so many are needed.
SLOW_LENGTHS, SLOW_SPEED, SLOW_COUNT = 10.0, 0.1, 4

#: The parameters that the controller takes, with their units.
UNITS = {'coulomb': 'N', 'static': 'N', 'stribeck_velocity': 'm/s', 'stiffness': 'N/m'}


def identify(
    position: Array,
    effort: Array,
    period: float,
    smoothing: float = 0.005,
    extra: Array | None = None,
) -> FrictionEstimate:
    """Fit the force balance to one axis.

    First everything that acts while sliding, from ticks whose neighbourhood neither stands nor
    reverses; then the presliding distance alone, from slow reversals, or roughly from all ticks
    where the record has too few.

    Parameters
    ----------
    position, effort
        (n,) encoder [m] and force of each tick, equally spaced; the force is held from its
        tick to the next.
    period
        Of the record [s].
    smoothing
        Standard deviation of the Gaussian that every signal of the balance passes [s]: one
        filter for all, so that it biases no coefficient.
    extra
        (n, k) further forces known up to a factor, such as a measured contact force.

    Raises
    ------
    StageError
        A record that is too short, holds gaps, or never reverses; `NoFriction` where none can be
        told from noise.
    """
    balance = _balance(position, effort, period, smoothing, extra)
    inside, sliding, target = balance.inside, balance.sliding, balance.target
    shape = _shape_of_sliding(balance)
    matrix = balance.design(shape, TYPICAL_PRESLIDING, sliding)
    solution = _solve(matrix, target[sliding])
    spreads = _spreads(matrix, target[sliding] - matrix @ solution, balance.width)
    coulomb = float(solution[-1])
    refuse_noise(coulomb, spreads['coulomb'])

    def left_over(log_presliding: float) -> float:
        design = balance.design(shape, np.exp(log_presliding), inside)
        return Metrics.of(target[inside] - design @ solution).rms

    excess, stribeck = np.exp(shape).tolist()
    static = coulomb * (1.0 + excess)
    friction = target - balance.base @ solution[:-1]
    ways = _presliding(balance, friction, static, SLOW_SPEED * stribeck * period)
    stiffness, share = _stiffness(ways, static, coulomb, left_over)
    estimate = FrictionEstimate(
        LuGre(coulomb, static, stribeck, stiffness, 0.0, max(float(solution[1]), 0.0)),
        float(solution[0]),
        float(solution[2]),
        spreads | {'stiffness': share * stiffness},
        left_over(np.log(coulomb / stiffness)),
        _left_without(balance),
    )
    return refuse_useless(estimate)


def _left_without(balance: _Balance) -> float:
    """RMS of the force that mass and viscous part alone leave [N]."""
    plain = _solve(balance.base[balance.sliding], balance.target[balance.sliding])
    return Metrics.of(balance.target[balance.inside] - balance.base[balance.inside] @ plain).rms


def _stiffness(
    ways: Array, static: float, coulomb: float, left_over: Callable[[float], float]
) -> tuple[float, float]:
    """Stiffness of the bristle, and its standard deviation as a share of it.

    From the presliding distances `ways` (k,), or, where they are few, from the distance that
    leaves the least force of the record.
    """
    if len(ways) >= SLOW_COUNT and np.mean(ways) > 0.0:
        share = float(np.std(ways, ddof=1) / np.mean(ways)) / np.sqrt(len(ways))
        return static / float(np.mean(ways)), share
    found = minimize_scalar(
        left_over, bounds=np.log(PRESLIDING), method='bounded', options={'xatol': 0.02}
    )
    return coulomb / float(np.exp(found.x)), float('inf')


@dataclass(frozen=True)
class _Balance:
    """The force balance of a record, every signal smoothed alike.

    `place` (n,) [m], `velocity` (n,) [m/s], `target` (n,) the force; `base` (n, 3 + k) columns of
    mass, viscous part, offset and the extra forces; `inside`, `sliding` (n,) the ticks that are
    read at all, and those that neither stand nor reverse; `width` [ticks] of the smoothing.
    """

    place: Array
    velocity: Array
    target: Array
    base: Array
    inside: NDArray[np.bool_]
    sliding: NDArray[np.bool_]
    period: float
    width: float

    def design(self, shape: Array, presliding: float, used: NDArray[np.bool_]) -> Array:
        """Columns of the balance with friction of Coulomb force one; rows of the ticks `used`.

        `shape` holds the logarithms of F_s/F_c - 1 and v_s.
        """
        excess, stribeck = np.exp(shape)
        unit = np.array([1.0, 1.0 + excess, stribeck, 1.0 / presliding, 0.0, 0.0])
        friction = gaussian_filter1d(lugre_force(unit, self.velocity, self.period), self.width)
        return np.column_stack([self.base, friction])[used]


def _balance(
    position: Array,
    effort: Array,
    period: float,
    smoothing: float,
    extra: Array | None,
) -> _Balance:
    """The balance of a record; arguments and errors of `identify`."""
    width = max(smoothing / period, 1.0)
    reach = int(np.ceil(6.0 * width))
    if len(position) != len(effort) or len(position) < 20 * reach:
        raise StageError('the record is too short to identify friction: record some seconds')
    if not (np.all(np.isfinite(position)) and np.all(np.isfinite(effort))):
        raise StageError('the record holds values that are not finite: cut them out')
    place = np.asarray(gaussian_filter1d(position, width))
    velocity = np.gradient(place, period)
    span = float(np.ptp(velocity))
    if not np.min(velocity) < -0.02 * span < 0.02 * span < np.max(velocity):
        raise StageError(
            'the axis never reverses in this record: friction and offset cannot be told apart; '
            'record `ros2 run contour_ctrl excite`'
        )
    # The mean of two held forces belongs to the tick between them.
    held = 0.5 * (effort + np.concatenate([effort[:1], effort[:-1]]))
    columns = [np.gradient(velocity, period), velocity, np.ones_like(velocity)]
    if extra is not None:
        columns += [gaussian_filter1d(column, width) for column in np.asarray(extra).T]
    inside = np.zeros(len(position), dtype=bool)
    inside[reach:-reach] = True
    sliding = inside & (minimum_filter1d(np.abs(velocity), 2 * reach + 1) > STANDING)
    if sliding.sum() < 10 * reach:
        raise StageError('the axis hardly moves in this record: record a longer or faster one')
    target = np.asarray(gaussian_filter1d(held, width))
    base = np.column_stack(columns)
    return _Balance(place, velocity, target, base, inside, sliding, period, width)


def _shape_of_sliding(balance: _Balance) -> Array:
    """Logarithms of F_s/F_c - 1 and v_s that leave the least force while sliding."""
    target = balance.target[balance.sliding]

    def residual(shape: Array) -> Array:
        matrix = balance.design(shape, TYPICAL_PRESLIDING, balance.sliding)
        return np.asarray(target - matrix @ _solve(matrix, target))

    # A Stribeck velocity near the top speed cannot be told apart from viscous friction.
    upper = np.minimum(UPPER, [UPPER[0], 0.25 * np.max(np.abs(balance.velocity))])
    bounds = np.log(LOWER), np.log(upper)
    fits = [
        least_squares(
            residual,
            np.clip(np.log(start), bounds[0] + 1e-6, bounds[1] - 1e-6),
            bounds=bounds,
            diff_step=1e-3,
            max_nfev=30,
        )
        for start in STARTS
    ]
    return np.asarray(min(fits, key=lambda fit: float(fit.cost)).x)


def _spreads(matrix: Array, left: Array, width: float) -> dict[str, float]:
    """Standard deviations of mass, viscous part, offset and Coulomb force."""
    # Smoothing leaves about one independent residual per filter length.
    spread = np.sqrt(np.diag(np.linalg.pinv(matrix.T @ matrix)) * np.var(left) * 3.5 * width)
    names = {'mass': 0, 'viscous': 1, 'offset': 2, 'coulomb': -1}
    return {name: float(spread[index]) for name, index in names.items()}


def _presliding(balance: _Balance, friction: Array, static: float, speed: float) -> Array:
    """Presliding distances F_s / sigma_0 (k,) [m] of the slow reversals of a record.

    While the friction goes from -a F_s to a F_s, eq. 6 with v << v_s gives the way
    (F_s / sigma_0) ln((1 + a) / (1 - a)). Only the encoder's difference enters, never its
    rate: a presliding distance of a few counts shows as long as the reversals differ.
    `speed` [m per tick] bounds the mean speed.
    """
    zone = np.sign(friction) * (np.abs(friction) > REVERSAL * static)
    outside = np.flatnonzero(zone)
    turn = np.flatnonzero(np.diff(zone[outside]))
    start, stop = outside[turn], outside[turn + 1]
    way = (balance.place[stop] - balance.place[start]) * zone[stop]
    time = stop - start
    slow = (time >= SLOW_LENGTHS * balance.width) & (np.abs(way) < speed * time)
    return np.asarray(way[slow] / np.log((1.0 + REVERSAL) / (1.0 - REVERSAL)))


def identify_session(session: Session) -> dict[str, FrictionEstimate | NoFriction]:
    """Fit every axis of a session; needs /stage/joint_states and the effort of /stage/command.

    An axis whose friction cannot be told gets the reason in its place.

    Raises
    ------
    StageError
        A topic or the effort that is missing, or see `identify`.
    """
    states = session.require(topics.JOINT_STATES, 'holds the encoder')
    command = session.require(topics.COMMAND, 'holds the force')
    stamps, here, there = np.intersect1d(states.stamps, command.stamps, return_indices=True)
    if len(stamps) < 100:
        raise StageError(f'{session.path}: encoder and force share no stamps: record it again')
    steps = np.diff(stamps)
    period_ns = int(np.median(steps))
    grid = np.arange(stamps[0], stamps[-1] + 1, period_ns)
    if np.max(steps) > 50 * period_ns:
        raise StageError(f'{session.path}: {np.max(steps) / 1e9:.2f} s without force: cut it out')
    position = states.columns('position', session.axes)[here]
    effort = command.columns('effort', session.axes)[there]
    times, wanted = (stamps - stamps[0]) * 1e-9, (grid - stamps[0]) * 1e-9
    found: dict[str, FrictionEstimate | NoFriction] = {}
    for index, axis in enumerate(session.axes):
        place = np.interp(wanted, times, position[:, index])
        force = np.interp(wanted, times, effort[:, index])
        try:
            found[axis] = identify(place, force, period_ns * 1e-9)
        except NoFriction as reason:
            found[axis] = reason
    return found


def _solve(matrix: Array, target: Array) -> Array:
    """Least squares with scaled columns: accelerations and offsets differ by decades."""
    scale = np.linalg.norm(matrix, axis=0)
    scale[scale == 0.0] = 1.0
    gram = (matrix / scale).T @ (matrix / scale)
    return np.asarray(np.linalg.lstsq(gram, (matrix / scale).T @ target, rcond=1e-12)[0] / scale)


@command_line
def main(arguments: Sequence[str] | None = None) -> int:
    """Print the friction of each axis of a session bag, and the parameters it gives."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument('--bag', required=True, help='session bag, best of `excite`')
    given = parser.parse_args(arguments)
    from session_bags.reader import read_session

    session = read_session(given.bag, (topics.JOINT_STATES, topics.COMMAND, topics.REFERENCE))
    for axis, estimate in identify_session(session).items():
        if isinstance(estimate, NoFriction):
            print(f'{axis}: {estimate}')
            continue
        print(f'{axis}: {estimate.sentence()}')
        for name, unit in UNITS.items():
            print(f'    {axis}.{name}: {getattr(estimate.model, name):.4g}  # {unit}')
    return 0


if __name__ == '__main__':
    raise SystemExit(main())
