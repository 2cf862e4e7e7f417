"""A law in words of algebra, with units, and as the parameters of a twin's effect."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable

import numpy as np

from gap_diagnosis.law.library import Candidate
from stage_core.arrays import Array
from stage_twin.effects import law_terms as lt
from stage_twin.effects.term import Theta

#: Name -> value, standard deviation (0: chosen, not fitted) and unit.
Parameters = dict[str, tuple[float, float, str]]

#: Of the acceleration, which the twin takes as a mass.
ACCELERATION = 'm/s^2'


def unit_of(variable: str) -> str:
    """Unit of a variable of the basis."""
    return ACCELERATION if variable == 'a' else lt.VARIABLES[variable][1]


def per(unit: str, divisors: Iterable[str]) -> str:
    """A unit divided by others: ``per('N', ['m/s'])`` is N·s/m."""
    powers = Counter({unit: 1})
    for divisor in divisors:
        top, _, below = divisor.partition('/')
        for name, sign in ((top, -1), (below, 1)):
            base, _, power = name.partition('^')
            if base:
                powers[base] += sign * int(power or 1)
    above = [_power(n, p) for n, p in powers.items() if p > 0]
    under = [_power(n, -p) for n, p in powers.items() if p < 0]
    text = '·'.join(above) or '1'
    return f'{text}/({"·".join(under)})' if len(under) > 1 else '/'.join([text, *under])


def _power(name: str, power: int) -> str:
    return name if power == 1 else f'{name}{"⁰¹²³⁴⁵⁶⁷⁸⁹"[power]}'


def written(
    k: int,
    one: Candidate,
    theta: Theta,
    c: Array,
    spread: tuple[Array, Array],
    unit: str,
) -> tuple[str, Parameters]:
    """Expression and parameters of one term, each name with the term's number k.

    Parameters
    ----------
    spread : standard deviations of θ and of the coefficients
    """
    numbers, reach, memory = one.split(theta)
    free = list(spread[0])
    size, deviation, phase = _amplitude(one, c, spread[1])
    parts, parameters, divisors, divided = [], Parameters(), [], 1.0
    for shape, (scale, bend) in zip(one.shapes, numbers, strict=True):
        x = shape.variable
        own = [free.pop(0) for _ in shape.lower]
        if shape.kind == lt.LINEAR:
            parts.append(x)
            if x != 's':
                divisors.append(unit_of(x))
                divided *= scale
        elif shape.kind != lt.PLAIN:
            text, more = _shape(k, x, shape.kind, scale, bend, own, phase, size, deviation)
            parts.append(text)
            parameters |= more
    if one.turning:
        parameters[f'reach{k}'] = (reach, free.pop(0), 'm')
    text = '*'.join(parts)
    if one.memory:
        parameters[f'tau{k}'] = (abs(memory), abs(memory) * free.pop(0), 's')
        text = f'lag({text}, tau{k})' if one.memory > 0 else f'({text} - lag({text}, tau{k}))'
    first = {f'a{k}': (size / divided, deviation / abs(divided), per(unit, divisors))}
    return '*'.join(filter(None, [f'a{k}', text])), {**first, **parameters}


def _amplitude(
    one: Candidate, c: Array, spread: Array
) -> tuple[float, float, tuple[float, float]]:
    """Size with its deviation; phase of a sine with its deviation."""
    if not one.waves:
        return float(c[0]), float(spread[0]), (0.0, 0.0)
    size = float(np.hypot(*c))
    share = c / max(size, 1e-300)
    deviation = float(np.hypot(*(share * spread)))
    across = float(np.hypot(share[1] * spread[0], share[0] * spread[1])) / max(size, 1e-300)
    return size, deviation, (float(np.arctan2(c[1], c[0])), across)


def _shape(
    k: int,
    x: str,
    kind: int,
    scale: float,
    bend: float,
    own: list[float],
    phase: tuple[float, float],
    size: float,
    deviation: float,
) -> tuple[str, Parameters]:
    unit = unit_of(x)
    if kind == lt.SINE:
        text = f'sin(2*pi*{x}/b{k} + f{k})'
        return text, {f'b{k}': (scale, own[0] * scale**2, unit), f'f{k}': (*phase, 'rad')}
    if kind == lt.BUMP and len(own) == 2:
        text = f'exp(-(({x} - m{k})/w{k})^2)'
        return text, {f'm{k}': (bend, own[0], unit), f'w{k}': (scale, own[1], unit)}
    if kind == lt.BUMP:
        return f'exp(-({x}/w{k})^2)', {f'w{k}': (scale, own[0], unit)}
    if kind == lt.EXCESS:
        text = f'sign({x})*max(abs({x}) - l{k}, 0)/{x}{k}'
        return text, {f'l{k}': (scale, own[0], unit), f'{x}{k}': (bend, 0.0, unit)}
    sign = f'sign({x})*' if kind == lt.ODD else ''
    power = {f'{x}{k}': (scale, 0.0, unit), f'n{k}': (bend, own[0], '')}
    return f'{sign}abs({x}/{x}{k})^n{k}', power


def twin_values(k: int, one: Candidate, theta: Theta, c: Array) -> dict[str, float]:
    """Parameters of term k of `learned_force` or `learned_error`."""
    if one.first.variable == 'a':
        return {'mass': -float(c[0]) / one.first.numbers(())[0]}
    numbers, reach, memory = one.split(theta)
    size, _, phase = _amplitude(one, c, np.zeros(len(c)))
    shapes = list(zip(one.shapes, numbers, strict=True))
    out = {f'size{k}': size, f'reach{k}': reach, f'memory{k}': memory, f'second{k}': 0.0}
    out |= {f'form{k}': 0.0, f'length{k}': 1.0, f'turn{k}': 0.0}
    names = (('first', 'shape', 'scale', 'bend'), ('second', 'form', 'length', 'turn'))
    for own, (shape, (scale, bend)) in zip(names, shapes, strict=False):
        turned = bend + (phase[0] if shape.kind == lt.SINE else 0.0)
        values = (lt.VARIABLES[shape.variable][0], shape.kind, scale, turned)
        out |= {f'{name}{k}': float(v) for name, v in zip(own, values, strict=True)}
    return out


def map_values(one: Candidate, theta: Theta, knots: Array, size: float) -> dict[str, float]:
    """Parameters of the effect that is a curve through knots [target's unit]."""
    out = twin_values(0, one, theta, np.array([size]))
    return out | {f'knot{k}': float(value / size) for k, value in enumerate(knots)}
