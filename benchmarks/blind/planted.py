"""How large each planted effect is: drawn in the blind machine's own parameters."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np


def _log(g: np.random.Generator, low: float, high: float) -> float:
    return float(math.exp(g.uniform(math.log(low), math.log(high))))


@dataclass(frozen=True)
class _Draw:
    """What the parameters of every effect are drawn with; `size` is 0.002 for a small one."""

    g: np.random.Generator
    mass: float
    sign: float
    size: float
    level: float
    presliding: float

    @staticmethod
    def of(g: np.random.Generator, axis: str, small: bool) -> _Draw:
        """The draws that stand first in every case, whatever its effect needs."""
        mass = {'x': 18.0, 'y': 8.0}.get(axis, 1.0)
        sign = float(g.choice([-1.0, 1.0]))
        size = 0.002 if small else 1.0
        return _Draw(g, mass, sign, size, _log(g, 3.0, 25.0) * size, _log(g, 1e-6, 15e-6))

    def log(self, low: float, high: float) -> float:
        """Log-uniform between two ends, times the size."""
        return _log(self.g, low, high) * self.size

    def flat(self, low: float, high: float) -> float:
        """Uniform between two ends."""
        return float(self.g.uniform(low, high))

    def friction(self, ratio: float = 1.0) -> dict[str, float]:
        """Levels of Coulomb's friction in both directions, and its presliding."""
        return {
            'coulomb_positive': self.level * ratio,
            'coulomb_negative': self.level / ratio,
            'presliding': self.presliding,
        }


def _inertia(d: _Draw) -> dict[str, float]:
    share = d.flat(0.08, 0.5) if d.sign > 0 else -d.flat(0.08, 0.3)
    return {'mass': d.mass * d.size * share}


def _viscous(d: _Draw) -> dict[str, float]:
    value = d.log(25.0, 250.0)
    return {'viscous_positive': value, 'viscous_negative': value}


def _asymmetric(d: _Draw) -> dict[str, float]:
    ratio = d.flat(1.3, 2.0) ** d.sign
    return d.friction(ratio) | {
        'viscous_positive': d.flat(0, 40) * d.size,
        'viscous_negative': d.flat(0, 40) * d.size,
    }


def _stribeck(d: _Draw) -> dict[str, float]:
    return d.friction() | {
        'breakaway_extra': d.level * d.flat(0.5, 1.2),
        'stribeck_velocity': _log(d.g, 3e-3, 2e-2),
    }


def _resonance(d: _Draw) -> dict[str, float]:
    return {
        'payload_mass': d.mass * d.flat(0.2, 0.5) * d.size,
        'payload_frequency': _log(d.g, 15.0, 60.0),
        'payload_damping': d.flat(0.01, 0.06),
    }


def _misalignment(d: _Draw) -> dict[str, float]:
    return {
        'angle': d.sign * d.log(40e-6, 1e-3),
        'offset_x': d.flat(-2e-5, 2e-5) * d.size,
        'offset_y': d.flat(-2e-5, 2e-5) * d.size,
    }


_PLANTED: dict[str, Callable[[_Draw], dict[str, float]]] = {
    'inertia_mismatch': _inertia,
    'viscous_friction': _viscous,
    'coulomb_friction': _Draw.friction,
    'asymmetric_friction': _asymmetric,
    'stribeck_friction': _stribeck,
    'force_offset': lambda d: {'offset': d.sign * d.log(2.0, 20.0)},
    'force_ripple': lambda d: {'ripple': d.log(1.5, 12.0), 'ripple_phase': d.flat(-3, 3)},
    'cable_force': lambda d: {
        'cable_stiffness': d.log(150.0, 1500.0), 'cable_centre': d.flat(-0.02, 0.02),
    },
    'actuation_delay': lambda d: {'delay': d.log(1e-3, 4e-3)},
    'structural_resonance': _resonance,
    'force_saturation': lambda d: {
        'saturation': 1e9 if d.size < 1.0 else d.mass * d.flat(0.6, 1.1),
    },
    'drive_gain': lambda d: {'drive_gain': 1.0 + d.size * d.sign * d.flat(0.08, 0.3)},
    'scale_error': lambda d: {'scale': d.sign * d.log(40e-6, 400e-6)},
    'cyclic_pitch_error': lambda d: {'amplitude': d.log(1.5e-6, 12e-6), 'phase': d.flat(-3, 3)},
    'straightness': lambda d: {
        'bow': d.sign * d.log(5e-6, 25e-6), 'middle': d.flat(-0.008, 0.008),
    },
    'backlash': lambda d: {'width': d.log(3e-6, 40e-6)},
    'thermal_expansion': lambda d: {
        'coefficient': d.flat(8e-6, 24e-6) * d.size, 'fixed': d.flat(-0.3, 0.3),
    },
    'encoder_quantisation': lambda d: {
        'resolution': 1e-6 if d.size < 1.0 else float(d.g.choice([2e-6, 4e-6, 5e-6, 8e-6])),
    },
    'angular_error': lambda d: {'yaw': d.sign * d.log(5e-4, 3e-3)},
    'nonorthogonality': lambda d: {'angle': d.sign * d.log(40e-6, 500e-6)},
    'tracker_misalignment': _misalignment,
    'tracker_latency': lambda d: {'latency': d.sign * d.log(3e-4, 5e-3)},
    'tracker_clock_drift': lambda d: {'drift': d.sign * d.log(2e-5, 4e-4)},
}  # fmt: skip


def parameters(g: np.random.Generator, name: str, small: bool) -> dict[str, float]:
    """Parameters of an effect such as `backlash.x`; a small one hides in the noise."""
    effect, _, axis = name.partition('.')
    return _PLANTED[effect](_Draw.of(g, axis, small))


def hidden(g: np.random.Generator, name: str) -> dict[str, float]:
    """Parameters of a mechanism that no library effect describes."""
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
