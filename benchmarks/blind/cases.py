"""What is planted in each case: drawn from a seed, in the blind machine's own parameters."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from benchmarks.blind.planted import hidden, parameters

Truth = dict[str, dict[str, float]]

#: Offset of the seeds of cases that are reported; development cases start at zero.
REPORT_SEEDS = 1_000_000

#: Mechanisms that no library effect describes.
OUTSIDE = (
    'hidden_drift.x',
    'hidden_drift.y',
    'hidden_grating.x',
    'hidden_grating.y',
    'hidden_vibration.x',
    'hidden_twist',
    'hidden_shake.x',
    'hidden_bump.x',
    'hidden_bump.y',
)
SERVO = (
    'inertia_mismatch',
    'viscous_friction',
    'coulomb_friction',
    'asymmetric_friction',
    'stribeck_friction',
    'force_offset',
    'force_ripple',
    'cable_force',
    'actuation_delay',
    'structural_resonance',
    'force_saturation',
    'drive_gain',
)
GEOMETRY = (
    'scale_error',
    'cyclic_pitch_error',
    'straightness',
    'backlash',
    'thermal_expansion',
    'encoder_quantisation',
)
COMMON = (
    'nonorthogonality',
    'tracker_misalignment',
    'tracker_latency',
    'tracker_clock_drift',
)


@dataclass(frozen=True)
class Case:
    """One sealed case: how the session is made, what is planted, what the answer must be."""

    number: int
    seed: int
    kind: str  # none, single, pair, triple, outside, mixed, small
    axes: tuple[str, ...]
    duration: float
    rate: float
    noise: float
    truth: Truth
    planted: tuple[str, ...] = field(default=())
    suite: str = 'main'
    tracker: bool = True
    temperature: bool = True
    without: tuple[str, ...] = ()  # effects taken out of the library

    @property
    def folder(self) -> str:
        """Name of the case's folder."""
        return f'{self.suite}_{self.number:04d}'

    @property
    def expected(self) -> tuple[str, ...]:
        """Names that the verdict must hold; what the library cannot say is `unknown`."""
        named = tuple(sorted(n for n in self.planted if self._sayable(n)))
        return (*named, 'unknown') if len(named) < len(self.planted) else named

    def _sayable(self, name: str) -> bool:
        effect = name.partition('.')[0]
        if effect == 'thermal_expansion' and not self.temperature:
            return False
        return not effect.startswith('hidden') and effect not in self.without


def draw(
    number: int, seed: int, duration: float = 30.0, axes: tuple[str, ...] | None = None
) -> Case:
    """Draw the case of a seed; `axes` where they are not left to chance."""
    g = np.random.default_rng(seed)
    kind = str(
        g.choice(
            ['none', 'single', 'pair', 'triple', 'outside', 'mixed', 'small'],
            p=[0.10, 0.34, 0.18, 0.12, 0.13, 0.09, 0.04],
        )
    )
    drawn = ('x',) if g.random() < 0.15 else ('x', 'y')
    axes = axes or drawn
    rate = float(g.choice([100.0, 100.0, 200.0, 1000.0]))
    noise = float(g.uniform(0.7e-6, 1.0e-6))
    count = {'none': 0, 'single': 1, 'pair': 2, 'triple': 3, 'outside': 0, 'mixed': 1, 'small': 1}
    names: list[str] = []
    truth: Truth = {}
    for _ in range(200):
        if len(names) == count[kind]:
            break
        name = _name(g, axes)
        if name in names or _clash(name, names):
            continue
        names.append(name)
        truth[name] = parameters(g, name, small=kind == 'small')
    if kind in ('outside', 'mixed'):
        allowed = [n for n in OUTSIDE if len(axes) == 2 or n.endswith('.x')]
        name = str(g.choice(allowed))
        names.append(name)
        truth[name] = hidden(g, name)
    planted = () if kind == 'small' else tuple(names)
    return Case(number, seed, kind, axes, duration, rate, noise, truth, planted)


def draw_single(number: int, seed: int, effect: str) -> Case:
    """A 30 s case of both axes with one given effect, on an axis that the seed draws."""
    g = np.random.default_rng(seed)
    joint = effect in COMMON
    name = effect if joint else f'{effect}.{g.choice(["x", "y"])}'
    noise = float(g.uniform(0.7e-6, 1.0e-6))
    truth = {name: parameters(g, name, small=False)}
    return Case(number, seed, 'single', ('x', 'y'), 30.0, 100.0, noise, truth, (name,))


def _name(g: np.random.Generator, axes: tuple[str, ...]) -> str:
    group = int(g.choice(3, p=[0.5, 0.34, 0.16]))
    if group == 2:
        allowed = COMMON if len(axes) == 2 else COMMON[2:]
        return str(g.choice(list(allowed)))
    effect = str(g.choice(SERVO if group == 0 else GEOMETRY))
    if effect == 'straightness' and len(axes) == 1:
        effect = 'backlash'
    return f'{effect}.{g.choice(list(axes))}'


def _clash(name: str, names: list[str]) -> bool:
    """Two frictions on one axis are one effect; so are two that cannot be told apart by design."""
    effect, _, axis = name.partition('.')
    families = (
        {'coulomb_friction', 'asymmetric_friction', 'stribeck_friction', 'viscous_friction'},
        {'inertia_mismatch', 'drive_gain'},
        {'force_offset', 'cable_force'},
        {'actuation_delay', 'structural_resonance'},
        {'scale_error', 'thermal_expansion'},
        {'tracker_latency', 'tracker_clock_drift'},
        {'encoder_quantisation', 'structural_resonance', 'force_saturation'},
    )
    for family in families:
        for other in names:
            other_effect, _, other_axis = other.partition('.')
            if effect in family and other_effect in family and axis == other_axis:
                return True
    return False
