"""Planted parameters as a report states them."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from stage_core.quantities import split_effect
from stage_core.twin_file import ServoAxis, TwinFile
from stage_twin.effects import EFFECTS

Values = dict[str, float]

#: Effect -> what the machines call a parameter -> what a report calls it.
NAMES: dict[str, dict[str, str]] = {
    'viscous_friction': {'viscous_positive': 'viscous'},
    'coulomb_friction': {'coulomb_positive': 'coulomb'},
    'stribeck_friction': {'coulomb_positive': 'coulomb', 'breakaway_extra': 'breakaway'},
    'force_ripple': {'ripple': 'amplitude', 'ripple_phase': 'phase'},
    'cable_force': {'cable_stiffness': 'stiffness', 'cable_centre': 'centre'},
    'force_saturation': {'saturation': 'limit'},
    'scale_error': {'scale': 'error'},
    'thermal_expansion': {'fixed': 'fixed_point', 'alpha': 'coefficient'},
}
GAINS = ('position_gain', 'velocity_gain', 'integral_gain', 'velocity_filter')


def in_report_terms(truth: dict[str, Any], twin: TwinFile) -> dict[str, Any]:
    """The truth with its parameters named and referred as interfaces.md, "Effects" does.

    What the machine gave in those terms stays.
    """
    planted = [
        {**p, 'parameters': _parameters(p['name'], p['parameters'], twin)}
        for p in truth['planted']
    ]
    return {**truth, 'planted': planted}


def _parameters(name: str, values: Values, twin: TwinFile) -> Values:
    effect, axis = split_effect(name)
    out = {NAMES.get(effect, {}).get(key, key): value for key, value in values.items()}
    if effect in REFERRED and axis in twin.axes:
        out |= REFERRED[effect](values, twin.servo(str(axis)))
    return out


def _inertia(values: Values, axis: ServoAxis) -> Values:
    return {'ratio': values['mass'] / axis.mass} if 'mass' in values else {}


def _gain(values: Values, axis: ServoAxis) -> Values:
    gain = values.get('gain', values.get('drive_gain'))
    return {} if gain is None else {'error': gain - 1.0}


def _breakaway(values: Values, axis: ServoAxis) -> Values:
    return {'breakaway': values['static'] - values['coulomb']} if 'static' in values else {}


def _resonance(values: Values, axis: ServoAxis) -> Values:
    """Of the load with the motor held."""
    if 'payload_mass' not in values:
        return {'frequency': values.get('antiresonance', values['frequency'])}
    return {
        'frequency': values['payload_frequency'],
        'damping': values['payload_damping'],
        'mass_ratio': values['payload_mass'] / axis.mass,
    }


def _base(values: Values, axis: ServoAxis) -> Values:
    """Of the base together with the held axis; without the base's mass they are that already."""
    if 'mass' not in values:
        return {}
    share = axis.mass / (values['mass'] + axis.mass)
    lower = math.sqrt(1.0 - share)
    return {
        'frequency': values['frequency'] * lower,
        'damping': values['damping'] * lower,
        'mass_ratio': share,
    }


def _controller(values: Values, axis: ServoAxis) -> Values:
    out = {
        f'{gain}_error': values[gain] / getattr(axis, gain) - 1.0
        for gain in GAINS
        if gain in values
    }
    if 'velocity_feedforward' in values:
        out['velocity_feedforward_error'] = (
            values['velocity_feedforward'] - axis.velocity_feedforward
        )
    return out


REFERRED: dict[str, Callable[[Values, ServoAxis], Values]] = {
    'inertia_mismatch': _inertia,
    'drive_gain': _gain,
    'stribeck_friction': _breakaway,
    'structural_resonance': _resonance,
    'base_resonance': _base,
    'controller_mismatch': _controller,
}


def belongs_to_machine(name: str, parameter: str) -> bool:
    """Whether a parameter is one of the machine and not a phase or offset of the session."""
    effect = EFFECTS.get(split_effect(name)[0])
    known = [p for p in effect.parameters if p.name == parameter] if effect else []
    return bool(known) and not known[0].nuisance
