"""The declared basis of a law: which products of shapes of which variables may stand in it.

A candidate is `shape(first) * shape(second)`, perhaps behind a memory. Its exponents, periods,
widths and time constants are nonlinear parameters θ; what stands before it is linear. The shapes
are those that the twin runs (`stage_twin.effects.law_terms`).
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from gap_diagnosis.law.signals import Signal, Signals, remembered, shaped
from stage_core.arrays import Array
from stage_twin.effects import law_terms as lt
from stage_twin.effects.term import Term, Theta

EXPONENTS = (0.3, 0.6, 1.5, 2.0, 3.0)  # starts; 1 is the linear shape
EXPONENT_BOUNDS = (0.15, 5.0)
REACHES = ((1e-6,), (5e-6,), (2e-5,))
REACH_BOUNDS = (5e-7, 2e-4)
#: Of a variable's range: finest period and bump, and starts of the width of a bump.
FINEST, NARROWEST, WIDTHS = 200.0, 0.02, (0.05, 0.15, 0.4)
FASTEST = 25.0  # Hz, of a law of the time: the rows are low-passed at 30 Hz
MEMORIES = (0.01, 0.05, 0.3, 2.0, 10.0)  # s, starts
MEMORY_BOUNDS = (0.003, 100.0)
PEAKS = 3  # of a periodogram that become starts


@dataclass(frozen=True)
class Shape:
    """One shape of one variable with what is free in it.

    `grid` holds starts for its share of θ; `numbers` makes its scale and bend of it.
    """

    variable: str
    kind: int
    grid: tuple[Theta, ...] = ((),)
    lower: Theta = ()
    upper: Theta = ()
    numbers: Callable[[Theta], tuple[float, float]] = lambda theta: (1.0, 0.0)


@dataclass(frozen=True)
class Candidate:
    """One product of the basis; `memory` is 1 behind a memory, -1 without what it remembers."""

    first: Shape
    second: Shape | None = None
    memory: int = 0

    @property
    def name(self) -> str:
        """A key, and in an order of the plainest first."""
        parts = [f'{s.variable}:{s.kind}' for s in self.shapes]
        return '*'.join(parts) + ('', ' behind', ' without')[self.memory]

    @property
    def shapes(self) -> tuple[Shape, ...]:
        """The one or two factors."""
        return (self.first,) if self.second is None else (self.first, self.second)

    @property
    def waves(self) -> bool:
        """Whether it is a sine, whose phase is linear in two columns."""
        return any(s.kind == lt.SINE for s in self.shapes)

    @property
    def turning(self) -> bool:
        """Whether it asks for the direction of the motion."""
        return any(s.variable == 's' for s in self.shapes)

    def split(self, theta: Theta) -> tuple[list[tuple[float, float]], float, float]:
        """Scale and bend of each factor, reach of the direction, signed memory."""
        numbers, at = [], 0
        for one in self.shapes:
            count = len(one.lower)
            numbers.append(one.numbers(theta[at : at + count]))
            at += count
        reach = 0.0
        if self.turning:
            reach, at = theta[at], at + 1
        memory = self.memory * float(np.exp(theta[at])) if self.memory else 0.0
        return numbers, reach, memory


def signal(one: Candidate, signals: Signals, theta: Theta, quarter: bool = False) -> Signal:
    """The candidate at every tick; `quarter` turns its sine by 90°."""
    numbers, reach, memory = one.split(theta)
    ticks = dict(signals.ticks)
    if one.turning and signals.direction is not None:
        ticks['s'] = signals.direction(reach)
    out = []
    for session, period in enumerate(signals.periods):
        value = np.ones(len(ticks['t'][session]))
        for shape, (scale, bend) in zip(one.shapes, numbers, strict=True):
            turn = 0.5 * np.pi if quarter and shape.kind == lt.SINE else 0.0
            if shape.variable != '1':
                value = value * shaped(
                    ticks[shape.variable][session], shape.kind, scale, bend + turn
                )
        out.append(remembered(value, memory, period))
    return out


def term(one: Candidate, signals: Signals) -> Term:
    """The candidate as columns of a regression."""
    turning = ((1e-6,), (5e-6,), (2e-5,)) if one.second is None else ((2e-6,), (2e-5,))
    grids = [s.grid for s in one.shapes]
    lower = [v for s in one.shapes for v in s.lower]
    upper = [v for s in one.shapes for v in s.upper]
    if one.turning:
        grids, lower, upper = (
            [*grids, turning],
            [*lower, REACH_BOUNDS[0]],
            [*upper, REACH_BOUNDS[1]],
        )
    if one.memory:
        grids = [*grids, tuple((float(np.log(m)),) for m in MEMORIES)]
        lower, upper = [*lower, np.log(MEMORY_BOUNDS[0])], [*upper, np.log(MEMORY_BOUNDS[1])]
    waves = (False, True) if one.waves else (False,)

    def columns(theta: Theta) -> Array:
        return signals.columns(*(signal(one, signals, theta, quarter) for quarter in waves))

    grid = tuple(tuple(itertools.chain(*parts)) for parts in itertools.product(*grids))
    return Term(
        columns,
        lambda theta, c: {},
        grid=grid,
        propose=_proposer(one, signals) if one.waves else None,
        lower=tuple(float(v) for v in lower),
        upper=tuple(float(v) for v in upper),
        steps=tuple(
            _step(lo, hi, s) for s in one.shapes for lo, hi in zip(s.lower, s.upper, strict=True)
        )
        + ((1e-7,) if one.turning else ())
        + ((1e-3,) if one.memory else ()),
    )


def _step(low: float, high: float, shape: Shape) -> float:
    """A change of θ that moves a column by a little: of a frequency, by a hundredth of a turn."""
    return 0.01 * low if shape.kind == lt.SINE else 1e-3 * (high - low)


def _proposer(one: Candidate, signals: Signals) -> Callable[[Array], tuple[Theta, ...]]:
    """Frequencies at which a residual, times the other factor, has its highest peaks."""
    wave = next(s for s in one.shapes if s.kind == lt.SINE)
    others = [s for s in one.shapes if s.kind != lt.SINE]
    x = signals.used(signals.ticks[wave.variable])
    beside = np.ones(len(x))
    for other in others:
        part = Candidate(other)
        theta = other.grid[0] + ((REACHES[1]) if other.variable == 's' else ())
        beside = beside * signals.used(signal(part, signals, theta))
    low, high = wave.lower[0], wave.upper[0]
    size = 2 ** int(np.ceil(np.log2(8.0 * high * np.ptp(x) + 16)))
    width = np.ptp(x) / (size - 1)
    bins = np.rint((x - x.min()) / width).astype(np.int64)

    def propose(residual: Array) -> tuple[Theta, ...]:
        weighted = (residual - residual.mean()) * beside
        power = np.abs(np.fft.rfft(np.bincount(bins, weights=weighted, minlength=size), 4 * size))
        frequency = np.arange(len(power)) / (4 * size * width)
        inner = np.zeros(len(power), dtype=bool)
        inner[1:-1] = (power[1:-1] >= power[:-2]) & (power[1:-1] > power[2:])
        inner &= (frequency >= low) & (frequency <= high)
        peaks = np.flatnonzero(inner)
        best = peaks[np.argsort(-power[peaks], kind='stable')][:PEAKS]
        starts = [float(f) for f in frequency[best]]
        if wave.variable == 'p':
            starts += [k / signals.lead for k in (1, 2) if low <= k / signals.lead <= high]
        rest = [s.grid for s in one.shapes]
        where = one.shapes.index(wave)
        rest[where] = tuple((f,) for f in starts) or ((low,),)
        if one.turning:
            rest.append((REACHES[1],))
        return tuple(tuple(itertools.chain(*parts)) for parts in itertools.product(*rest))

    return propose


def _shapes(name: str, signals: Signals) -> dict[str, Shape]:
    """Every shape of a variable, by a short word."""
    low, high = signals.range(name)
    span, scale = max(high - low, 1e-12), signals.scale(name)
    powers = tuple((e,) for e in EXPONENTS)
    bounds = ((EXPONENT_BOUNDS[0],), (EXPONENT_BOUNDS[1],))
    finest = FINEST / span if name != 't' else FASTEST
    centres = low + span * np.linspace(0.05, 0.95, 10)
    bumps = tuple((float(c), w * span) for c in centres for w in WIDTHS)
    widths = tuple((w * scale,) for w in (0.02, 0.05, 0.15, 0.4))
    # A limit is where values heap up, which may be far below the largest one.
    limits = np.quantile(np.abs(signals.used(signals.ticks[name])), (0.3, 0.5, 0.7, 0.85, 0.95))
    return {
        'linear': Shape(name, lt.LINEAR, numbers=lambda theta: (scale, 0.0)),
        'even': Shape(name, lt.EVEN, powers, *bounds, lambda theta: (scale, theta[0])),
        'odd': Shape(name, lt.ODD, powers, *bounds, lambda theta: (scale, theta[0])),
        'sine': Shape(
            name, lt.SINE, ((1.0 / span,),), (1.0 / span,), (finest,),
            lambda theta: (1.0 / theta[0], 0.0),
        ),
        'bump': Shape(
            name, lt.BUMP, bumps, (low, NARROWEST * span), (high, 2.0 * span),
            lambda theta: (theta[1], theta[0]),
        ),
        'fading': Shape(
            name, lt.BUMP, widths, (0.002 * scale,), (scale,), lambda theta: (theta[0], 0.0)
        ),
        'excess': Shape(
            name, lt.EXCESS, tuple((float(v),) for v in limits), (0.002 * scale,), (scale,),
            lambda theta: (theta[0], scale),
        ),
    }  # fmt: skip


#: Words of the basis: `variable:shape`, products with `*`, memories with `~` (behind) and `^`
#: (without). The first ten of each are every variable by itself.
FORCE = (
    '1 s a:linear p:linear v:linear F:linear t:linear u:linear w:linear '
    'p:odd p:even v:odd v:even F:odd u:odd u:even t:even '
    'p:sine t:sine p:bump F:excess '
    's*p:linear s*p:even s*p:odd s*p:sine s*p:bump s*v:fading s*t:linear s*t:even '
    'v:linear*p:linear v:linear*p:even v:linear*p:sine v:linear*t:linear '
    'F:linear*v:even F:linear*p:sine F:linear*p:linear F:linear*t:linear '
    '~v:linear ~v:even ~F:linear ^F:linear ^p:linear ~s'
)
ERROR = (
    '1 s p:linear v:linear t:linear q:linear T:linear '
    'p:odd p:even v:odd v:even q:odd q:even t:even T:even '
    'p:sine q:sine t:sine p:bump q:bump '
    's*p:linear s*p:even s*p:sine v:linear*t:linear v:linear*p:linear '
    'p:linear*q:linear q:linear*p:sine q:linear*p:even p:linear*q:even p:linear*q:sine '
    'p:linear*T:linear p:linear*t:linear q:linear*T:linear T:linear*p:sine '
    '~v:linear ~v:even'
)


def candidates(words: str, signals: Signals) -> list[Candidate]:
    """Candidates of a basis for the variables that there are."""
    there = {*signals.ticks, '1', *(['s'] if signals.direction is not None else [])}
    shapes = {name: _shapes(name, signals) for name in sorted(there - {'1', 's'})}
    plain = {'1': Shape('1', lt.PLAIN), 's': Shape('s', lt.LINEAR)}
    found = []
    for word in words.split():
        memory = {'~': 1, '^': -1}.get(word[0], 0)
        parts = [part.split(':') for part in word.lstrip('~^').split('*')]
        if all(variable in there for variable, *_ in parts):
            made = [plain[v] if v in plain else shapes[v][kind[0]] for v, *kind in parts]
            found.append(Candidate(made[0], made[1] if len(made) > 1 else None, memory))
    return found
