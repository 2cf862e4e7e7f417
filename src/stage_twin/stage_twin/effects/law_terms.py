"""A learned law as numbers of a twin file: a sum of terms, each a product of two shapes.

term = size * shape(first variable) * shape(second variable), remembered with a time constant or
freed of what is remembered. The twin runs the functions that the search fits
(`gap_diagnosis.law`).
"""

from __future__ import annotations

import math

from numba import njit

from stage_core.arrays import Array
from stage_twin.effects.definition import Parameter
from stage_twin.effects.knots import smooth

TERMS, KNOTS = 4, 13

#: Variable -> its number in a twin file, its unit, what it is.
VARIABLES: dict[str, tuple[int, str, str]] = {
    '1': (0, '', 'nothing'),
    'p': (1, 'm', 'position of the axis'),
    'v': (2, 'm/s', 'its velocity'),
    's': (3, '', 'its direction, -1 to 1; in an error its side in a play `reach` wide'),
    'F': (4, 'N', 'force of the drive'),
    't': (5, 's', 'time since the session began'),
    'q': (6, 'm', 'position of the other axis'),
    'u': (7, 'm/s', 'velocity of the other axis'),
    'w': (8, 'm/s^2', 'acceleration of the other axis'),
    'T': (9, 'K', 'screw temperature above the reference'),
}
VELOCITY, DIRECTION, OTHER_POSITION, RISE = (VARIABLES[name][0] for name in 'vsqT')
#: States of each term: direction and memory.
STATES = tuple(f'{name}{i}' for name in ('direction', 'memory') for i in range(TERMS))
#: Numbers of the shapes of a variable x with its `scale` b and its `bend` c.
PLAIN, LINEAR, EVEN, ODD, SINE, BUMP, EXCESS, CURVE = range(8)
#: Numbers of a term, in their order in a law: the sizes of all terms, then their first variables
#: and so on; the knots of the curve come last.
SIZE, FIRST, SHAPE, SCALE, BEND, SECOND, FORM, LENGTH, TURN, REACH, MEMORY = range(11)
KNOT = 11 * TERMS
SHAPES = (
    '0 one, 1 x / b, 2 abs(x / b)^c, 3 sign(x) abs(x / b)^c, 4 sin(2 pi x / b + c), '
    '5 exp(-((x - c) / b)^2), 6 sign(x) max(abs(x) - b, 0) / c, 7 the knots from b to c'
)


@njit(cache=True, error_model='numpy')
def factor(x: float, shape: float, scale: float, bend: float) -> float:
    """One shape of one variable; all but the knots."""
    kind = int(shape)
    if kind == PLAIN:
        return 1.0
    if kind == LINEAR:
        return x / scale
    if kind == SINE:
        return math.sin(2.0 * math.pi * x / scale + bend)
    if kind == BUMP:
        return math.exp(-(((x - bend) / scale) ** 2))
    size = abs(x)
    if kind == EXCESS:
        size = max(size - scale, 0.0) / bend
    elif size > 0.0:
        size = math.exp(bend * math.log(size / abs(scale)))
    return -size if x < 0.0 and kind != EVEN else size


@njit(cache=True)
def group(first: float, second: float) -> int:
    """Where an error of the table acts: 0 on the axis, 1 beside the other one, 2 by heat."""
    if first == RISE or second == RISE:
        return 2
    return 1 if first == OTHER_POSITION or second == OTHER_POSITION else 0


@njit(cache=True)
def direction(before: float, travelled: float, reach: float) -> float:
    """Direction of the motion after some travel [m]: Dahl's exact step (1968)."""
    towards = 1.0 if travelled > 0.0 else -1.0
    if travelled == 0.0:
        return before
    return towards + (before - towards) * math.exp(-abs(travelled) / max(reach, 1e-9))


@njit(cache=True)
def side(before: float, travelled: float, width: float) -> float:
    """Side on which an axis lies in a play of some width [m], -1 to 1, after some travel [m]."""
    return min(max(before + 2.0 * travelled / max(width, 1e-9), -1.0), 1.0)


@njit(cache=True)
def rubs(term: Array) -> bool:
    """Whether a term of a force is friction: the direction, by what goes with place and speed."""
    first, second = term[FIRST], term[SECOND]
    own, other = (term[SHAPE], second) if first == DIRECTION else (term[FORM], first)
    turns = first == DIRECTION or second == DIRECTION
    return turns and own == LINEAR and other <= VELOCITY and term[MEMORY] == 0.0


@njit(cache=True)
def product(term: Array, x: tuple[float, ...], way: float, law: Array) -> float:
    """Both shapes of a term at the variables `x` and a direction."""
    first, second = int(term[FIRST]), int(term[SECOND])
    one = way if first == DIRECTION else x[first]
    two = way if second == DIRECTION else x[second]
    value = 1.0
    if int(term[SHAPE]) == CURVE:
        value = smooth(one, term[SCALE], term[BEND], law[KNOT:])
    elif first != 0:
        value = factor(one, term[SHAPE], term[SCALE], term[BEND])
    if second != 0:
        value *= factor(two, term[FORM], term[LENGTH], term[TURN])
    return value


@njit(cache=True)
def level(x: tuple[float, ...], law: Array) -> float:
    """Level of the friction that the terms are together [N]; one below zero drives the axis."""
    out = 0.0
    for i in range(TERMS):
        term = law[i:KNOT:TERMS]
        if term[SIZE] != 0.0 and rubs(term):
            out -= term[SIZE] * product(term, x, 1.0, law)
    return out


@njit(cache=True)
def remembered(state: Array, at: int, value: float, memory: float, step: float) -> float:
    """A value behind a first-order memory [s]; of a negative one, what it has not remembered."""
    if memory == 0.0:
        return value
    state[at] += (value - state[at]) * (1.0 - math.exp(-step / abs(memory)))
    return state[at] if memory > 0.0 else value - state[at]


@njit(cache=True)
def total(
    x: tuple[float, ...], part: int, state: Array, travelled: float, step: float, law: Array
) -> float:
    """Sum of the terms of group 0 at the variables `x`; all terms of a force, group -1.

    `state` holds each term's direction, then what it remembers; both move on by a step [s] in
    which the axis has `travelled` [m]. `law` holds the parameters in their order. Of a force, the
    terms that rub are left to the solver of the friction where they brake.
    """
    out = 0.0
    brakes = part < 0 and level(x, law) >= 0.0
    for i in range(TERMS):
        term = law[i:KNOT:TERMS]
        if term[SIZE] == 0.0 or (part == 0 and group(term[FIRST], term[SECOND]) != part):
            continue
        if part < 0:
            state[i] = direction(state[i], travelled, term[REACH])
        else:
            state[i] = side(state[i], travelled, term[REACH])
        if brakes and rubs(term):
            continue
        value = product(term, x, state[i], law)
        out += term[SIZE] * remembered(state, TERMS + i, value, term[MEMORY], step)
    return out


@njit(cache=True)
def stateless(x: tuple[float, ...], part: int, law: Array) -> float:
    """Sum of the terms of group 1 or 2 at the variables `x`: they have no direction, no memory."""
    out = 0.0
    for i in range(TERMS):
        term = law[i:KNOT:TERMS]
        if term[SIZE] != 0.0 and group(term[FIRST], term[SECOND]) == part:
            out += term[SIZE] * product(term, x, 0.0, law)
    return out


def parameters(unit: str, largest: float, variables: tuple[str, ...]) -> tuple[Parameter, ...]:
    """Parameters of an effect that is a law of some variables, in the unit of its target."""
    numbers = ', '.join(f'{VARIABLES[name][0]} {VARIABLES[name][2]}' for name in variables)
    most, last = float(max(VARIABLES[name][0] for name in variables)), float(CURVE)
    #: Name, unit, range, value when on of an ordinary term and of the one with a curve, meaning.
    meanings = (
        ('size', unit, -largest, largest, (0.0, 0.0), 'size of a term'),
        ('first', '', 0.0, most, (1.0, 1.0), f'its first variable: {numbers}'),
        ('shape', '', 0.0, last, (0.0, last), f'shape of it: {SHAPES}'),
        ('scale', '', -1e4, 1e4, (0.1, 1e-3), 'b of it, in its unit'),
        ('bend', '', -1e4, 1e4, (0.5, 0.04), 'c of it'),
        ('second', '', 0.0, most, (3.0, 3.0), 'its second variable'),
        ('form', '', 0.0, last - 1.0, (SINE, SINE), 'shape of it'),
        ('length', '', -1e4, 1e4, (0.5, 0.5), 'b of it, in its unit'),
        ('turn', '', -1e4, 1e4, (0.5, 0.5), 'c of it'),
        ('reach', 'm', 0.0, 1e-3, (1e-5, 1e-5), 'travel that turns its direction'),
        ('memory', 's', -1e3, 1e3, (0.1, 0.1), 'time constant behind it; negative: without it'),
    )
    out = []
    # The order of `total`: those of one name stand together.
    for name, of, low, high, when_on, meaning in meanings:
        for i in range(TERMS):
            value = float(when_on[i == TERMS - 1])
            if name == 'shape' and i < TERMS - 1:
                value = float((SINE, EVEN, ODD)[i])
            neutral = 0.0 if name == 'size' else None
            out.append(Parameter(f'{name}{i}', of, low, high, value, meaning, neutral))
    for k in range(KNOTS):
        words = 'knots of the curve, in sizes'
        out.append(Parameter(f'knot{k}', '', -1e3, 1e3, 0.1 * (k - 6), words, None))
    return tuple(out)
