"""The force constant falls with force, with speed and as the machine warms."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache
from itertools import combinations

import numpy as np

from stage_core.arrays import Array
from stage_twin.effects.definition import Effect, Parameter
from stage_twin.effects.rows import ForceRows
from stage_twin.effects.shared import filtered
from stage_twin.effects.term import Term, Theta

#: Least share of the force constant that is left, however strong the force.
LEAST = 0.2
#: Steps of Newton's method for the force to command; it rises to the root from below.
NEWTON, HEATINGS = 8, 3
#: The shares imitate one another: of four right ones of foreign simulators two missed by 12 and
#: 37 %.
DOUBT = 0.15


def _share(name: str, unit: str, maximum: float, when_on: float, meaning: str) -> Parameter:
    return Parameter(name, unit, 0.0, maximum, when_on, meaning, doubt=DOUBT)


EFFECT = Effect(
    name='torque_sag',
    link='servo',
    parameters=(
        Parameter(
            'sag_force', '1/N', 0.0, 1.0, 5e-4, 'share of the force lost per force', doubt=DOUBT
        ),
        Parameter(
            'sag_square', '1/N^2', 0.0, 1.0, 0.0, 'share lost per squared force', doubt=DOUBT
        ),
        Parameter(
            'sag_speed', 's/m', 0.0, 100.0, 0.0, 'share of the force lost per speed', doubt=DOUBT
        ),
        Parameter(
            'sag_heat', '1/N^2', 0.0, 1.0, 0.0, 'share lost per mean squared force', doubt=DOUBT
        ),
        Parameter('sag_time', '', 0.0, 0.75, 0.0, 'share lost once what runs by itself is warm'),
        Parameter('heat_time', 's', 1.0, 300.0, 15.0, 'in which both warm', neutral=None),
    ),
    model='Acting force F * (1 - sag_force |F| - sag_square F^2 - sag_speed |v| - h), at least '
    '0.2 F; h follows sag_heat F^2 + sag_time within heat_time, zero at the start: iron that '
    'saturates, a voltage that the counter-voltage takes up, magnets and copper that warm by the '
    'force and by what runs beside it. Krishnan, "Electric motor drives" (2001).',
    sentence='the drive gives less force than it is asked for: by {sag_force} and {sag_square} of '
    'the force, by {sag_speed} of the speed, by {sag_heat} of the squared force and by '
    '{sag_time} once warm',
    excited_by='strokes at several accelerations and speeds',
    by_shape=True,
    by_ratio=True,
    order=1,
    states=('heat',),
    scales=True,
    needs_effort='a force that falls with the speed cannot be told from the gains',
)


def drive(
    force: float,
    velocity: float,
    step: float,
    state: Array,
    sag_force: float,
    sag_square: float,
    sag_speed: float,
    sag_heat: float,
    sag_time: float,
    heat_time: float,
) -> float:
    """Force that the motor gives [N]."""
    size = abs(force)
    lost = (sag_force + sag_square * size) * size
    lost += sag_speed * abs(velocity) + state[0]
    warm = sag_heat * size * size + sag_time
    state[0] += (warm - state[0]) * (1.0 - math.exp(-step / heat_time))
    return force * max(LEAST, 1.0 - lost)


def command(
    force: Array,
    velocity: Array,
    step: float,
    sag_force: float,
    sag_square: float,
    sag_speed: float,
    sag_heat: float,
    sag_time: float,
    heat_time: float,
) -> Array:
    """Force to command for a force that acts, (n,) [N]; none beyond the least share."""
    wanted, given = np.abs(force), np.abs(force)
    for _ in range(HEATINGS if sag_heat > 0.0 else 1):
        warm = _warmed(sag_heat * given**2 + sag_time, step, heat_time)
        whole = 1.0 - sag_speed * np.abs(velocity) - warm
        given = wanted.copy()
        for _ in range(NEWTON):
            acting = given * (whole - (sag_force + sag_square * given) * given)
            slope = whole - (2.0 * sag_force + 3.0 * sag_square * given) * given
            given = np.where(slope > 0.0, given + (wanted - acting) / slope, np.inf)
            given = np.clip(given, wanted, wanted / LEAST)
    return np.sign(force) * given


def _warmed(heating: Array, step: float, heat_time: float) -> Array:
    """What a heating (n,) has warmed before each tick, from cold."""
    keep = math.exp(-step / heat_time)
    return filtered([0.0, 1.0 - keep], [1.0, -keep], heating)


#: Ways to sag: of those without a memory two neighbours may be mixed.
NAMES = ('sag_square', 'sag_force', 'sag_speed', 'sag_heat', 'sag_time')
COLD = 3
#: Ways that may sag together in the richer shape, each with a factor of its own.
TOGETHER = tuple(
    ways for number in range(2, len(NAMES) + 1) for ways in combinations(range(len(NAMES)), number)
)
#: Highest numbers (the first θ) of ways alone, and of sets of them.
ALONE, HIGHEST = len(NAMES) - 1, len(NAMES) - 1 + len(TOGETHER)
TIMES = (4.0, 12.0, 36.0)  # s, starts for that of the warming
LEAST_TIME, MOST_TIME = 1.5, 250.0  # s
#: Shares of the largest loss beyond which no more is lost: that of `LEAST`, starts where it shows.
WHOLE, KNEES = 1.0, (0.1, 0.3, 0.6)
#: Share of the force by which the loss at a knee may miss that of `LEAST`.
NEAR = 0.1
#: Starts (θ): ways alone, those without a memory and the heat down to a knee, and sets of ways.
_LOGS = [math.log(time) for time in TIMES]
COLD_WAYS: tuple[Theta, ...] = tuple((k, _LOGS[1], WHOLE) for k in (0.0, 0.5, 1.0, 1.5, 1.95))
DEEP_WAYS = tuple(
    (way, log, knee)
    for way, logs in (*((k, _LOGS[1:2]) for k in (0.0, 0.5, 1.0, 1.95)), (float(COLD), _LOGS))
    for log in logs
    for knee in KNEES
)
WARM_WAYS = tuple((float(way), log, WHOLE) for way in (COLD, COLD + 1) for log in _LOGS)
SEVERAL = tuple((float(k), log, WHOLE) for k in range(ALONE + 1, HIGHEST + 1) for log in _LOGS)
#: Starts of sags that reach the least share: ways alone, two of them and all, with what they lose
#: together; those that warm with each time.
MOST_LOST = 20.0
TO_THE_LEAST: tuple[Theta, ...] = tuple(
    (*(most / len(ways) * float(way in ways) for way in range(4)), log)
    for ways in (*((k,) for k in range(4)), *combinations(range(4), 2), tuple(range(4)))
    for log in (_LOGS if COLD in ways else _LOGS[1:2])
    for most in (0.7, 1.5, 3.0)
)


def term(rows: ForceRows) -> Term | None:
    """The force times what it loses.

    θ says by which ways, the log time of the warming, and the knee beyond which no more is lost.
    """
    speed = [np.abs(v) for v in rows.smooth_velocity()]
    strongest = max(float(np.abs(f).max()) for f in rows.applied())
    fastest = max(float(v.max()) for v in speed)
    if strongest <= 0.0 or fastest <= 0.0:
        return None
    relative = [np.abs(f) / strongest for f in rows.applied()]
    shares = [[r * r for r in relative], relative, [v / fastest for v in speed]]
    cold = rows.columns(
        *([f * s for f, s in zip(rows.applied(), own, strict=True)] for own in shares)
    )
    scale = np.array([strongest**2, strongest, fastest, strongest**2, 1.0])
    force = rows.columns(rows.applied())[:, 0]
    heating = [(f / strongest) ** 2 for f in rows.commanded()]

    @lru_cache(maxsize=2 * len(TIMES))
    def ways(log_time: float) -> Array:
        """Force (n, 5) that each way loses whose share is one at the strongest force."""
        once = [np.ones_like(f) for f in relative]
        warm = [
            [f * share for f, share in zip(rows.applied(), own, strict=True)]
            for own in (_warmths(heating, rows, log_time), _warmths(once, rows, log_time))
        ]
        return np.column_stack([cold, rows.columns(*warm)])

    def columns(theta: Theta) -> Array:
        if _knees(theta):
            heat = _warmths(heating, rows, theta[1])
            return _deep(rows, [*shares, heat], theta)
        return np.asarray(ways(theta[1]) @ _mixed(theta[0]))

    def parameters(theta: Theta, c: Array) -> dict[str, float]:
        values = (_mixed(theta[0]) @ c / scale).tolist()
        return {**dict(zip(NAMES, values, strict=True)), 'heat_time': math.exp(theta[1])}

    def admissible(theta: Theta, c: Array) -> bool:
        if np.min(c) <= 0.0:
            return False
        lost = float(np.abs(columns(theta) @ c).max()) / strongest
        return abs(lost - (1.0 - LEAST)) < NEAR if _knees(theta) else lost < 1.0 - LEAST

    def acting(theta: Theta, c: Array) -> float:
        return 1.0 - float(force @ columns(theta) @ c) / float(force @ force)

    plain = Term(
        columns,
        parameters,
        grid=COLD_WAYS + DEEP_WAYS + WARM_WAYS,
        lower=(0.0, math.log(LEAST_TIME), 0.01),
        upper=(float(ALONE), math.log(MOST_TIME), WHOLE),
        admissible=admissible,
        acting=acting,
    )
    several = replace(plain, grid=SEVERAL, upper=(float(HIGHEST), *plain.upper[1:]), own=True)
    deep = _to_the_least(rows, shares, heating, scale)
    return replace(plain, richer=lambda: replace(several, richer=lambda: deep))


def _to_the_least(
    rows: ForceRows, shares: list[list[Array]], heating: list[Array], scale: Array
) -> Term:
    """The force times what several ways lose, down to the least share that is left.

    θ is what each way loses of the strongest force, the heat of a mean one, and the log time of
    the warming.
    """
    mean = max(float(np.mean(np.concatenate(heating))), 1e-12)
    warming = [own / mean for own in heating]

    def lost(theta: Theta) -> list[Array]:
        ways = [*shares, _warmths(warming, rows, theta[-1])]
        sessions = zip(*ways, strict=True)
        return [sum(w * own for w, own in zip(theta, s, strict=False)) for s in sessions]

    def columns(theta: Theta) -> Array:
        forces = zip(rows.applied(), lost(theta), strict=True)
        return rows.columns([force * np.minimum(own, 1.0 - LEAST) for force, own in forces])

    def parameters(theta: Theta, c: Array) -> dict[str, float]:
        whole = scale * np.array([1.0, 1.0, 1.0, mean, 1.0])
        values = (np.array([*theta[:-1], 0.0]) / whole).tolist()
        return {**dict(zip(NAMES, values, strict=True)), 'heat_time': math.exp(theta[-1])}

    def admissible(theta: Theta, c: Array) -> bool:
        return max(float(own.max()) for own in lost(theta)) > 1.0 - LEAST

    def acting(theta: Theta, c: Array) -> float:
        force = rows.columns(rows.applied())[:, 0]
        return 1.0 - float(force @ columns(theta)[:, 0]) / float(force @ force)

    return Term(
        columns,
        parameters,
        grid=TO_THE_LEAST[:1],
        propose=lambda residual: TO_THE_LEAST,
        lower=(*(0.0,) * 4, math.log(LEAST_TIME)),
        upper=(*(MOST_LOST,) * 4, math.log(MOST_TIME)),
        fixed=True,
        admissible=admissible,
        acting=acting,
    )


def _warmths(heating: list[Array], rows: ForceRows, log_time: float) -> list[Array]:
    """What each session's heating (n,) has warmed before each tick."""
    sessions = zip(heating, rows.periods, strict=True)
    return [_warmed(own, period, math.exp(log_time)) for own, period in sessions]


def _deep(rows: ForceRows, shares: list[list[Array]], theta: Theta) -> Array:
    """Force that a way loses down to a knee (n, 1)."""
    weights = _mixed(theta[0])[: COLD + 1, 0]
    lost = [
        sum(weight * share for weight, share in zip(weights, own, strict=True))
        for own in zip(*shares, strict=True)
    ]
    most = theta[2] * max(float(one.max()) for one in lost)
    forces = zip(rows.applied(), lost, strict=True)
    return rows.columns([force * np.minimum(one, most) for force, one in forces])


def _knees(theta: Theta) -> bool:
    """Whether so much is lost that the loss ends at that of `LEAST`."""
    return (theta[0] < COLD - 1 or round(theta[0]) == COLD) and theta[2] < 0.99 * WHOLE


def _mixed(way: float) -> Array:
    """Shares (5, k) of the ways to sag: of two neighbours or one that warms, or a set of them.

    Beside another way the heat would follow any slow error of the other models: it is tried there
    only where this shows (`Term.richer`). A small step never leads to another one that warms.
    """
    if way > ALONE + 0.5:
        return np.eye(len(NAMES))[:, list(TOGETHER[round(way) - ALONE - 1])]
    out = np.zeros((len(NAMES), 1))
    if way >= COLD - 1:
        out[round(way)] = 1.0
        return out
    first = int(way)
    angle = 0.5 * math.pi * (way - first)
    out[first], out[first + 1] = math.cos(angle), math.sin(angle)
    return out
