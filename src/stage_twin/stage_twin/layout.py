"""Where each parameter and state sits in the kernel's arrays.

Numba freezes these module constants into the compiled code. Per axis one row of `AXIS_WIDTH`
numbers: the fields of the twin file as the effects have changed them, then per effect a switch
and its parameters, then per hook a switch. `COMMON_WIDTH` numbers hold the same for the effects
of the machine as a whole. Zero everywhere switches every effect off.
"""

from __future__ import annotations

from stage_twin.effects.registry import EFFECTS

#: Fields of a row: those of the twin file, and from `viscous_positive` on what effects add to the
#: linear plant: viscous friction of one direction [N·s/m]; a mass behind a spring [kg], its
#: natural frequency [rad/s], damping ratio, and share of its deflection that the table makes.
AXIS_FIELDS = (
    'mass',
    'viscous',
    'encoder_resolution',
    'lead',
    'position_gain',
    'velocity_feedforward',
    'velocity_gain',
    'integral_gain',
    'velocity_filter',
    'force_limit',
    'delay',
    'viscous_positive',
    'viscous_negative',
    'carried',
    'natural',
    'damping',
    'table_share',
)

(
    MASS,
    VISCOUS,
    ENCODER_RESOLUTION,
    LEAD,
    POSITION_GAIN,
    VELOCITY_FEEDFORWARD,
    VELOCITY_GAIN,
    INTEGRAL_GAIN,
    VELOCITY_FILTER,
    FORCE_LIMIT,
    DELAY,
    VISCOUS_POSITIVE,
    VISCOUS_NEGATIVE,
    CARRIED,
    NATURAL,
    DAMPING,
    TABLE_SHARE,
) = range(len(AXIS_FIELDS))

#: Name of the column that is 1 where an effect is on whose force changes within a tick.
FINE = 'fine'
#: The same for an effect whose force depends on the motion of the other axis.
COUPLED = 'coupled'

#: Compiled hooks that effects of an axis, and of the machine as a whole, may have; see
#: :mod:`stage_twin.hooks`.
AXIS_HOOKS = (
    'read',
    'drive',
    'force',
    'sliding',
    'start',
    'follow',
    'heat',
    'along',
    'across',
    'turn',
)
COMMON_HOOKS = ('plane',)


def _number(per_axis: bool, first: int, hooks: tuple[str, ...]) -> dict[tuple[str, str], int]:
    """(effect, parameter), (effect, '') for its switch and ('', hook) -> column."""
    keys: list[tuple[str, str]] = []
    for effect in EFFECTS.values():
        if effect.per_axis == per_axis:
            keys += [(effect.name, ''), *((effect.name, p.name) for p in effect.parameters)]
    keys += [('', hook) for hook in (*hooks, FINE, COUPLED)]
    return {key: first + index for index, key in enumerate(keys)}


AXIS_SLOTS = _number(True, len(AXIS_FIELDS), AXIS_HOOKS)
COMMON_SLOTS = _number(False, 0, COMMON_HOOKS)
AXIS_WIDTH = len(AXIS_FIELDS) + len(AXIS_SLOTS)
COMMON_WIDTH = len(COMMON_SLOTS)
FINE_COLUMN = AXIS_SLOTS['', FINE]
COUPLED_COLUMN = AXIS_SLOTS['', COUPLED]
DRIVE_COLUMN = AXIS_SLOTS['', 'drive']
FORCE_COLUMN = AXIS_SLOTS['', 'force']
FOLLOW_COLUMN = AXIS_SLOTS['', 'follow']
HEAT_COLUMN = AXIS_SLOTS['', 'heat']

# State of one axis of the plant; then come the effects' own states. `PLAYED` is the position
# behind the play, the last one is the mean acceleration of the tick before.
(
    POSITION,
    VELOCITY,
    DEFLECTION,
    DEFLECTION_RATE,
    BRISTLE,
    PLAYED,
    RISE,
    ACCELERATION,
) = range(8)
_OWN = 8


def _states() -> tuple[dict[str, tuple[int, int]], int]:
    where, first = {}, _OWN
    for effect in EFFECTS.values():
        where[effect.name] = (first, first + len(effect.states))
        first += len(effect.states)
    return where, first


#: Effect -> first and last but one entry of its own states; and the width of a state.
STATES, STATE_WIDTH = _states()
# State of one axis of the controller.
LAST_ENCODER, FILTERED, INTEGRAL = range(3)
CONTROLLER_WIDTH = 3

# Pieces of a tick: the force before and after the delay's fraction takes effect.
PIECES = 2
# Directions with their own viscous coefficient: 0 for v < 0, 1 for v >= 0.
DIRECTIONS = 2
# Rows of a transition: motor position, motor velocity, deflection, its rate.
MOTION = 4
# Entries of a schedule: whole ticks of delay, stiffness of the bristles, speed below which they
# give way; then, per piece, the number of its substeps and their length.
DELAY_TICKS, BRISTLES, CREEP, FIRST_PIECE = range(4)
SCHEDULE_WIDTH = FIRST_PIECE + 2 * PIECES
