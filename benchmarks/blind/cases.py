"""What is planted in each case: drawn from a seed, in the blind machine's own parameters."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

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
        truth[name] = _parameters(g, name, small=kind == 'small')
    if kind in ('outside', 'mixed'):
        allowed = [n for n in OUTSIDE if len(axes) == 2 or n.endswith('.x')]
        name = str(g.choice(allowed))
        names.append(name)
        truth[name] = _hidden(g, name)
    planted = () if kind == 'small' else tuple(names)
    return Case(number, seed, kind, axes, duration, rate, noise, truth, planted)


def draw_single(number: int, seed: int, effect: str) -> Case:
    """A 30 s case of both axes with one given effect, on an axis that the seed draws."""
    g = np.random.default_rng(seed)
    joint = effect in COMMON
    name = effect if joint else f'{effect}.{g.choice(["x", "y"])}'
    noise = float(g.uniform(0.7e-6, 1.0e-6))
    truth = {name: _parameters(g, name, small=False)}
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


def _log(g: np.random.Generator, low: float, high: float) -> float:
    return float(math.exp(g.uniform(math.log(low), math.log(high))))


def _parameters(g: np.random.Generator, name: str, small: bool) -> dict[str, float]:
    effect, _, axis = name.partition('.')
    mass = {'x': 18.0, 'y': 8.0}.get(axis, 1.0)
    sign = float(g.choice([-1.0, 1.0]))
    size = 0.002 if small else 1.0
    level = _log(g, 3.0, 25.0) * size
    presliding = _log(g, 1e-6, 15e-6)
    if effect == 'inertia_mismatch':
        return {
            'mass': mass * size * (g.uniform(0.08, 0.5) if sign > 0 else -g.uniform(0.08, 0.3))
        }
    if effect == 'viscous_friction':
        value = _log(g, 25.0, 250.0) * size
        return {'viscous_positive': value, 'viscous_negative': value}
    if effect == 'coulomb_friction':
        return {
            'coulomb_positive': level, 'coulomb_negative': level, 'presliding': presliding,
        }  # fmt: skip
    if effect == 'asymmetric_friction':
        ratio = g.uniform(1.3, 2.0) ** sign
        return {
            'coulomb_positive': level * ratio, 'coulomb_negative': level / ratio,
            'presliding': presliding, 'viscous_positive': float(g.uniform(0, 40)) * size,
            'viscous_negative': float(g.uniform(0, 40)) * size,
        }  # fmt: skip
    if effect == 'stribeck_friction':
        return {
            'coulomb_positive': level, 'coulomb_negative': level, 'presliding': presliding,
            'breakaway_extra': level * float(g.uniform(0.5, 1.2)),
            'stribeck_velocity': _log(g, 3e-3, 2e-2),
        }  # fmt: skip
    if effect == 'force_offset':
        return {'offset': sign * _log(g, 2.0, 20.0) * size}
    if effect == 'force_ripple':
        return {'ripple': _log(g, 1.5, 12.0) * size, 'ripple_phase': g.uniform(-3, 3)}
    if effect == 'cable_force':
        return {
            'cable_stiffness': _log(g, 150.0, 1500.0) * size,
            'cable_centre': g.uniform(-0.02, 0.02),
        }
    if effect == 'actuation_delay':
        return {'delay': _log(g, 1e-3, 4e-3) * size}
    if effect == 'structural_resonance':
        return {
            'payload_mass': mass * float(g.uniform(0.2, 0.5)) * size,
            'payload_frequency': _log(g, 15.0, 60.0),
            'payload_damping': float(g.uniform(0.01, 0.06)),
        }
    if effect == 'force_saturation':
        return {'saturation': 1e9 if small else mass * float(g.uniform(0.6, 1.1))}
    if effect == 'drive_gain':
        return {'drive_gain': 1.0 + size * sign * float(g.uniform(0.08, 0.3))}
    if effect == 'scale_error':
        return {'scale': sign * _log(g, 40e-6, 400e-6) * size}
    if effect == 'cyclic_pitch_error':
        return {'amplitude': _log(g, 1.5e-6, 12e-6) * size, 'phase': float(g.uniform(-3, 3))}
    if effect == 'straightness':
        return {
            'bow': sign * _log(g, 5e-6, 25e-6) * size, 'middle': float(g.uniform(-0.008, 0.008)),
        }  # fmt: skip
    if effect == 'backlash':
        return {'width': _log(g, 3e-6, 40e-6) * size}
    if effect == 'thermal_expansion':
        return {
            'coefficient': float(g.uniform(8e-6, 24e-6)) * size,
            'fixed': float(g.uniform(-0.3, 0.3)),
        }
    if effect == 'encoder_quantisation':
        return {'resolution': 1e-6 if small else float(g.choice([2e-6, 4e-6, 5e-6, 8e-6]))}
    if effect == 'angular_error':
        return {'yaw': sign * _log(g, 5e-4, 3e-3) * size}
    if effect == 'nonorthogonality':
        return {'angle': sign * _log(g, 40e-6, 500e-6) * size}
    if effect == 'tracker_misalignment':
        return {
            'angle': sign * _log(g, 40e-6, 1e-3) * size,
            'offset_x': float(g.uniform(-2e-5, 2e-5)) * size,
            'offset_y': float(g.uniform(-2e-5, 2e-5)) * size,
        }
    if effect == 'tracker_latency':
        return {'latency': sign * _log(g, 3e-4, 5e-3) * size}
    return {'drift': sign * _log(g, 2e-5, 4e-4) * size}


def _hidden(g: np.random.Generator, name: str) -> dict[str, float]:
    effect = name.partition('.')[0]
    if effect == 'hidden_drift':
        return {'size': _log(g, 1.5e-6, 6e-6)}
    if effect == 'hidden_grating':
        return {'size': _log(g, 2e-6, 8e-6), 'period': float(g.choice([0.0013, 0.0037, 0.0173]))}
    if effect == 'hidden_vibration':
        return {'size': _log(g, 2e-6, 8e-6), 'frequency': float(g.uniform(3.0, 30.0))}
    if effect == 'hidden_twist':
        return {'size': _log(g, 5e-6, 20e-6)}
    if effect == 'hidden_shake':
        return {
            'disturbance': _log(g, 4.0, 15.0),
            'disturbance_frequency': float(g.uniform(4, 40)),
        }
    return {'position_bump': _log(g, 6.0, 30.0)}
