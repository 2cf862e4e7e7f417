"""What a model file cannot say of the effects that a diagnosis names, and why."""

from __future__ import annotations

from stage_core.quantities import split_effect
from stage_twin.effects import link_of
from stage_twin.models.plant import Effects

#: Effects that a file says by a number of its own.
FRICTION = ('viscous_friction', 'coulomb_friction')
SAID = {
    'MJCF': (
        *FRICTION, 'inertia_mismatch', 'cable_force', 'force_offset', 'drive_gain',
        'force_saturation', 'current_loop_lag', 'actuation_delay',
    ),
    'URDF': (*FRICTION, 'inertia_mismatch', 'force_saturation'),
}  # fmt: skip

#: Effects of which a file says a part, or that need more than a number.
WHY = {
    'stribeck_friction': 'one level at every speed; the level at high speed is written',
    'asymmetric_friction': 'one friction for both directions; the means are written',
    'structural_resonance': 'it takes a second body on a spring; add it by hand',
    'drive_play': 'it takes a motor body tied to the carriage by a limited tendon; add it by hand',
    'base_resonance': 'it takes a body of the base on a spring; add it by hand',
    'axis_crosstalk': 'it takes bodies whose joints are not square; turn the joint axes by hand',
    'controller_mismatch': 'it belongs to the controller; see `corrected_twin.yaml`',
    'encoder_quantisation': 'a sensor of the model has no steps',
}
BY_LINK = {
    'servo': 'there is no element for it; apply the force in the loop around the model',
    'kinematic': 'the joint is the encoder; the way to the table has no element',
    'sensor': 'it belongs to the measurement',
}


def unsaid(effects: Effects, form: str) -> dict[str, str]:
    """Effects of these that a file of a form ('MJCF', 'URDF') does not say -> the reason."""
    out = {}
    for name, values in effects.items():
        effect = split_effect(name)[0]
        if effect == 'force_saturation' and values.get('known', 0.0) > 0.5:
            out[name] = 'the controller itself is limited; see `corrected_twin.yaml`'
        elif effect not in SAID[form]:
            out[name] = WHY.get(effect, BY_LINK[link_of(name)])
        elif values.get('presliding', 0.0) > SHORT or values.get('creep_velocity', 0.0) > 0.0:
            out[name] = f'the level is written, how it gives way has no number ({START[form]})'
        elif abs(values.get('hardening', 0.0)) * FAR**2 > LITTLE * values.get('stiffness', 0.0):
            out[name] = 'the stiffness at the centre is written, its growth is not'
    return out


#: A spring that stiffens by less than this share so far [m] from its centre is a plain one.
LITTLE, FAR = 0.02, 0.1
#: Pre-sliding below a step of a common encoder [m] is none.
SHORT = 1e-6
START = {
    'MJCF': '`solreffriction` of the joint softens the start',
    'URDF': 'the simulator decides how friction starts',
}
