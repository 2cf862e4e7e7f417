"""Ten laws that no effect of the library has, with exponents and periods drawn from seeds.

Five are forces on x, which the twin runs as the effect `planted_force` of this file
(`STAGE_EFFECTS`; without a term it is no candidate of the diagnosis). Five are errors of the
table, added to the points that the tracker measures. The file was written before the search,
which has not been tuned on it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from stage_core.arrays import Array
from stage_twin.effects.definition import Effect, Parameter

#: Number of a law -> what it is, and whether its number to find is an exponent or a period.
LAWS = {
    0: ('force.x', '-a * sign(v) * |v / 0.1 m/s|^n, n in 0.4 to 0.7', 'exponent'),
    1: ('force.x', '-a * sign(v) * |v / 0.1 m/s|^n, n in 1.6 to 2.6', 'exponent'),
    2: ('force.x', '-a * sign(v) * sin(2 pi p / b), b in 4 to 9 mm', 'period'),
    3: ('force.x', '-a * v / 0.1 m/s * sin(2 pi p / b), b in 3 to 8 mm', 'period'),
    4: ('force.x', 'a * sin(2 pi t / b), b in 0.1 to 0.6 s', 'period'),
    5: ('error.x', 'a * sign(p) * |p / 0.03 m|^n, n in 2 to 3.5', 'exponent'),
    6: ('error.x', 'a * |q / 0.03 m|^n of the other axis q, n in 1.3 to 3', 'exponent'),
    7: ('error.x', 'a * sin(2 pi q / b) of the other axis q, b in 2 to 7 mm', 'period'),
    8: ('error.x', 'a * sin(2 pi t / b), b in 0.5 to 3 s', 'period'),
    9: ('error.x', 'a * q / 0.03 m * sin(2 pi p / b), b in 4 to 12 mm', 'period'),
}
RANGES = ((0.4, 0.7), (1.6, 2.6), (4e-3, 9e-3), (3e-3, 8e-3), (0.1, 0.6),
          (2.0, 3.5), (1.3, 3.0), (2e-3, 7e-3), (0.5, 3.0), (4e-3, 12e-3))  # fmt: skip
#: An exponent is recovered within this, a period within this share of itself.
EXPONENT, PERIOD = 0.15, 0.01
#: Speed within which a direction is rounded off [m/s].
ROUNDED = 5e-4


@dataclass(frozen=True)
class Planted:
    """A law with its amplitude [N or m] and the number that is to be found."""

    law: int
    amplitude: float
    number: float

    def recovered(self, found: float) -> bool:
        """Whether a number found is that of the law."""
        if LAWS[self.law][2] == 'exponent':
            return abs(found - self.number) <= EXPONENT
        return abs(found / self.number - 1.0) <= PERIOD


def draw(law: int, seed: int) -> Planted:
    """The law of a seed."""
    generator = np.random.default_rng([seed, law])
    size = generator.uniform(6.0, 15.0)
    number = float(generator.uniform(*RANGES[law]))
    return Planted(law, float(size if law < 5 else 1e-6 * size), number)


EFFECT = Effect(
    name='planted_force',
    link='servo',
    parameters=(
        Parameter('amplitude', 'N', -100.0, 100.0, 8.0, 'amplitude'),
        Parameter('law', '', 0.0, 4.0, 0.0, 'number of the law', neutral=None),
        Parameter('number', '', 0.0, 10.0, 0.5, 'exponent or period', neutral=None),
    ),
    model='A law of benchmarks/laws/planted.py (2026).',
    sentence='a planted force of {amplitude}',
    excited_by='anything',
)


def force(
    position: float, velocity: float, time: float, amplitude: float, law: float, number: float
) -> float:
    """Force on the moving mass [N]."""
    way = math.tanh(velocity / ROUNDED)
    if law < 2.0:
        return -amplitude * way * math.exp(number * math.log(abs(velocity) / 0.1 + 1e-9))
    if law < 3.0:
        return -amplitude * way * math.sin(2.0 * math.pi * position / number)
    if law < 4.0:
        return -amplitude * velocity / 0.1 * math.sin(2.0 * math.pi * position / number)
    return amplitude * math.sin(2.0 * math.pi * time / number)


def error(planted: Planted, position: Array, other: Array, time: Array) -> Array:
    """Error of the table along x (n,) [m] at positions of both axes [m] and times [s]."""
    a, n = planted.amplitude, planted.number
    if planted.law == 5:
        return np.asarray(a * np.sign(position) * np.abs(position / 0.03) ** n)
    if planted.law == 6:
        return np.asarray(a * np.abs(other / 0.03) ** n)
    if planted.law == 7:
        return np.asarray(a * np.sin(2.0 * np.pi * other / n))
    if planted.law == 8:
        return np.asarray(a * np.sin(2.0 * np.pi * time / n))
    return np.asarray(a * other / 0.03 * np.sin(2.0 * np.pi * position / n))
