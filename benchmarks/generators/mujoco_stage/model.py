"""MJCF text of a plan.

Each axis is a slide joint `x` or `y`. Its second bodies are a load on a spring (child), the motor
before a play, a follower behind one (bodies of their own, held by a tendon of limited length), a
wiper that carries the friction on a spring (pre-sliding), and a base on mounts (parent).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from .plan import AxisPlan, StagePlan

# Physics steps in a tick of so many seconds.
STEPS = {0.001: 8, 0.0005: 4}
# The follower behind a play weighs and rubs next to nothing: the motor does not feel it.
FOLLOWER = (1e-3, 0.02)
WIPER_SHARE = 0.04
HARD = 'solreflimit="0.0004 1" solimplimit="0.99 0.999 1e-6"'
DRY = 'solreffriction="0.0004 1" solimpfriction="0.9999 0.9999 1e-6"'
DIRECTIONS = ('1 0 0', '0 1 0')


def joint(name: str, axis: str, mass: float, inside: str = '', **values: float) -> str:
    """A body on a slide joint, with what it carries."""
    given = ' '.join(f'{key}="{value:.12g}"' for key, value in values.items() if value)
    return (
        f'<body><joint name="{name}" type="slide" axis="{axis}" {given} {DRY}/>'
        f'<inertial pos="0 0 0" mass="{mass:.12g}" diaginertia="1 1 1"/>{inside}</body>'
    )


def carriage(name: str, axis: str, plan: AxisPlan, inside: str, less: float) -> str:
    """The carriage with its load, wiper and follower; `less` is mass that `inside` brings."""
    mass = plan.mass - plan.armature - less
    others = ''
    if plan.load:
        share, stiffness, damping = plan.load
        inside += joint(f'{name}_load', axis, share, stiffness=stiffness, damping=damping)
        mass -= share
    if plan.drive:
        others += joint(f'{name}_drive', axis, plan.drive[0])
        mass -= plan.drive[0]
    loss = plan.friction(0.0, 0.0, 0.0) if plan.friction else 0.0
    if plan.friction and plan.presliding:
        wiper = WIPER_SHARE * plan.mass
        others += joint(f'{name}_wiper', axis, wiper, frictionloss=loss)
        mass -= wiper
        loss = 0.0
    if plan.table_play:
        others += joint(f'{name}_table', axis, FOLLOWER[0], frictionloss=FOLLOWER[1])
    body = joint(
        name, axis, mass, inside, damping=plan.damping, frictionloss=loss,
        stiffness=plan.stiffness, springref=plan.spring_reference, armature=plan.armature,
    )  # fmt: skip
    if plan.base:
        weight, stiffness, damping = plan.base
        return joint(
            f'{name}_base', axis, weight, body + others, stiffness=stiffness, damping=damping
        )
    return body + others


def tendon(name: str, other: str, width: float = 0.0, stiffness: float = 0.0) -> str:
    """Holds two joints together within a play, or by a spring with a little damping."""
    joints = f'<joint joint="{name}" coef="-1"/><joint joint="{other}" coef="1"/>'
    if width:
        half = 0.5 * width
        return f'<fixed limited="true" range="{-half:.12g} {half:.12g}" {HARD}>{joints}</fixed>'
    damping = 2e-4 * stiffness
    return (
        f'<fixed springlength="0" stiffness="{stiffness:.12g}" damping="{damping:.12g}">'
        f'{joints}</fixed>'
    )


def tendons(name: str, plan: AxisPlan) -> str:
    """All that ties the bodies of an axis."""
    out = ''
    if plan.table_play:
        out += tendon(name, f'{name}_table', width=plan.table_play)
    if plan.drive:
        out += tendon(name, f'{name}_drive', width=plan.drive[1])
    if plan.friction and plan.presliding:
        level = plan.friction(0.0, 0.0, 0.0)
        out += tendon(name, f'{name}_wiper', stiffness=level / plan.presliding)
    return out


def actuator(name: str, plan: AxisPlan) -> str:
    """The motor: gear, range of its force, first-order lag."""
    where = f'{name}_drive' if plan.drive else name
    lag = f'dyntype="filter" dynprm="{plan.lag:.12g}"' if plan.lag else ''
    bound = plan.force_range
    limit = f'forcelimited="true" forcerange="{-bound:.12g} {bound:.12g}"'
    return (
        f'<general name="{name}" joint="{where}" gear="{plan.gear:.12g}" {lag} '
        f'{limit if np.isfinite(bound) else ""}/>'
    )


def mjcf(plan: StagePlan, timestep: float) -> str:
    """The whole model. A skewed stage carries its lighter slide on the heavier one.

    Its masses are those of the axes all the same.
    """
    x, y = plan.axes
    if plan.skew:
        outer = 0 if x.mass >= y.mass else 1
        lean = np.array([1.0, 0.0, 0.0])[[1, 0, 2] if outer else [0, 1, 2]] * plan.skew
        lean[1 - outer] = np.sqrt(1.0 - plan.skew**2)
        inner = plan.axes[1 - outer]
        inner = replace(inner, armature=inner.armature + inner.mass - plan.riding)
        direction = ' '.join(f'{v:.12g}' for v in lean)
        inside = carriage('xy'[1 - outer], direction, inner, '', 0.0)
        bodies = carriage('xy'[outer], DIRECTIONS[outer], plan.axes[outer], inside, plan.riding)
    else:
        bodies = ''.join(
            carriage('xy'[i], DIRECTIONS[i], axis, '', 0.0) for i, axis in enumerate(plan.axes)
        )
    ties = tendons('x', x) + tendons('y', y)
    return (
        f'<mujoco><option timestep="{timestep:.12g}" integrator="implicitfast" '
        f'gravity="{x.tilt:.12g} {y.tilt:.12g} 0"><flag contact="disable"/></option>'
        f'<worldbody>{bodies}</worldbody>'
        f'<tendon>{ties}</tendon>'
        f'<actuator>{actuator("x", x)}{actuator("y", y)}</actuator></mujoco>'
    )
