"""The force constant falls with force, with speed and with heat."""

from __future__ import annotations

import math

import numpy as np
from scipy.signal import lfilter

from stage_twin.effects.definition import Effect, Parameter
from stage_twin.effects.rows import ForceRows
from stage_twin.effects.term import Array, Term, Theta

#: Least share of the force constant that is left, however strong the force.
LEAST = 0.2
#: Steps of Newton's method for the force to command; it rises to the root from below.
NEWTON, HEATINGS = 8, 3

EFFECT = Effect(
    name='torque_sag',
    link='servo',
    parameters=(
        Parameter('sag_force', '1/N', 0.0, 0.1, 5e-4, 'share of the force lost per force'),
        Parameter('sag_square', '1/N^2', 0.0, 0.1, 0.0, 'share lost per squared force'),
        Parameter('sag_speed', 's/m', 0.0, 10.0, 0.0, 'share of the force lost per speed'),
        Parameter('sag_heat', '1/N^2', 0.0, 1.0, 0.0, 'share lost per mean squared force'),
        Parameter('heat_time', 's', 1.0, 300.0, 15.0, 'over which that mean goes', neutral=None),
    ),
    model='Acting force F * (1 - sag_force |F| - sag_square F^2 - sag_speed |v| - sag_heat h), at '
    'least 0.2 F, h the mean of F^2 over heat_time, zero at the start: iron that saturates, a '
    'voltage that the counter-voltage takes up, magnets and copper that warm. Krishnan, "Electric '
    'motor drives" (2001).',
    sentence='the drive gives less force than it is asked for: by {sag_force} and {sag_square} of '
    'the force, by {sag_speed} of the speed, by {sag_heat} of the heat',
    excited_by='strokes at several accelerations and speeds',
    order=1,
    states=('heat',),
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
    heat_time: float,
) -> float:
    """Force that the motor gives [N]."""
    size = abs(force)
    lost = (sag_force + sag_square * size) * size
    lost += sag_speed * abs(velocity) + sag_heat * state[0]
    state[0] += (size * size - state[0]) * (1.0 - math.exp(-step / heat_time))
    return force * max(LEAST, 1.0 - lost)


def command(
    force: Array,
    velocity: Array,
    step: float,
    sag_force: float,
    sag_square: float,
    sag_speed: float,
    sag_heat: float,
    heat_time: float,
) -> Array:
    """Force to command for a force that acts, (n,) [N]; none beyond the least share."""
    wanted, given = np.abs(force), np.abs(force)
    for _ in range(HEATINGS if sag_heat > 0.0 else 1):
        whole = 1.0 - sag_speed * np.abs(velocity)
        if sag_heat > 0.0:
            whole -= sag_heat * _heat(given, step, heat_time)
        given = wanted.copy()
        for _ in range(NEWTON):
            acting = given * (whole - (sag_force + sag_square * given) * given)
            slope = whole - (2.0 * sag_force + 3.0 * sag_square * given) * given
            given = np.where(slope > 0.0, given + (wanted - acting) / slope, np.inf)
            given = np.clip(given, wanted, wanted / LEAST)
    return np.sign(force) * given


def _heat(force: Array, step: float, heat_time: float) -> Array:
    """Mean of the squared force (n,) over the time before each tick, zero at the start [N²]."""
    keep = math.exp(-step / heat_time)
    return np.asarray(lfilter([0.0, 1.0 - keep], [1.0, -keep], force**2))


#: Ways to sag: of those before the heat two neighbours may be mixed.
NAMES = ('sag_square', 'sag_force', 'sag_speed', 'sag_heat')
HEAT = NAMES.index('sag_heat')
TIMES = (4.0, 12.0, 36.0)  # s, starts for that of the heat
LEAST_TIME, MOST_TIME = 1.5, 250.0  # s


def term(rows: ForceRows) -> Term | None:
    """The force times what it loses; θ says which two ways are mixed, and the heat's log time."""
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
    scale = np.array([strongest**2, strongest, fastest, strongest**2])

    def columns(theta: Theta) -> Array:
        weights = _weights(theta[0])
        column = cold @ weights[:HEAT]
        if weights[HEAT] > 0.0:
            forces = zip(rows.commanded(), rows.applied(), rows.periods, strict=True)
            heated = [a * _heat(c, t, math.exp(theta[1])) / scale[HEAT] for c, a, t in forces]
            column = column + weights[HEAT] * rows.columns(heated)[:, 0]
        return np.asarray(column)[:, None]

    def parameters(theta: Theta, c: Array) -> dict[str, float]:
        values = _weights(theta[0]) * float(c[0]) / scale
        return {**dict(zip(NAMES, values.tolist(), strict=True)), 'heat_time': math.exp(theta[1])}

    def admissible(theta: Theta, c: Array) -> bool:
        lost = float(np.abs(columns(theta)[:, 0] * c[0]).max())
        return bool(c[0] > 0.0) and lost < (1.0 - LEAST) * strongest

    middle = math.log(TIMES[1])
    hot = tuple((float(HEAT), math.log(time)) for time in TIMES)
    return Term(
        columns,
        parameters,
        grid=(*((k, middle) for k in (0.0, 0.5, 1.0, 1.5, 1.95)), *hot),
        lower=(0.0, math.log(LEAST_TIME)),
        upper=(float(HEAT), math.log(MOST_TIME)),
        admissible=admissible,
    )


def _weights(way: float) -> Array:
    """Shares (4,) of the ways to sag: of the two around a number, of the heat alone beyond them.

    Beside another way the heat would follow any slow error of the other models. A small step of
    the number never leads to it. Beyond the ends the number is that of the end: its deviation may
    be larger than its range.
    """
    out, way = np.zeros(4), max(way, 0.0)
    if way >= HEAT - 1:
        out[HEAT if way > HEAT - 0.5 else HEAT - 1] = 1.0
        return out
    first = int(way)
    angle = 0.5 * math.pi * (way - first)
    out[first], out[first + 1] = math.cos(angle), math.sin(angle)
    return out
