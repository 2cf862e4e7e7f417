"""What the plant asks of the effects: hooks, each composed of the functions of one name.

An effect's file takes part in a hook by a function of the hook's name. The function asks by the
names of its arguments: for signals of the hook (below), for its effect's parameters, for fields
of the axis (:data:`stage_twin.layout.AXIS_FIELDS`), for `state`, the effect's own states, which it
may change, for an array of parameters `c0`, `c1`, … as `c`, and for all of them in their order
as `parameters`. It runs only where its effect is on. Units are m, s, N, K, rad.

Compiled, of an axis, in scalars:

=============  =================================================  ===============================
hook           signals                                            gives
=============  =================================================  ===============================
``read``       position                                           what the encoder reads of it
``drive``      force, position, velocity, step, time              the force that acts
``force``      position, velocity, acting, step, time,            force on the moving mass, a sum
               other_velocity, other_acceleration
``sliding``    position, velocity, positive                       level of friction, a sum
``start``      position                                           nothing: sets the states
``follow``     position, velocity, step, time                     the position behind it
``heat``       velocity, step                                     rise of the screw, a sum
``along``      motor, played, rise                                displacement, a sum
``across``     position                                           that of the other axis, a sum
``turn``       position, other, side                              displacement along, a sum
=============  =================================================  ===============================

`drive` and `force` are asked once per substep. `velocity` is that of its start, `position` that of
its start (`drive`) or middle (`force`), `acting` the force of the drive. `side` is -1 on the first
axis and 1 on the second. `read`, `drive` and `follow` pass through the effects in turn. `along`,
`across` and `turn` have no `state`.

Compiled, of the machine: ``plane`` takes x and y and gives the table's x and y.

In Python: ``prepare(axis)`` changes the fields of an axis; ``stiffness()`` is that of a friction
before it slides, ``creep()`` the speed below which it gives way; ``command(force, velocity,
step)`` inverts ``drive`` for forces (n,); ``recorded(force)`` is the effort that is recorded of
forces (n,), ``tick_stamp(times)`` the stamps of ticks, ``point_stamp(times)`` those of tracker
points that scatter; ``stamp(times)`` and ``true_time(stamps)`` carry times (n,) to the tracker's
stamps and back; ``seen(points)`` carries table positions (m, 3) to its frame.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Mapping
from functools import cache
from types import ModuleType
from typing import Any

import numpy as np
from numba import njit

from stage_twin import layout
from stage_twin.effects.definition import Effect
from stage_twin.effects.registry import MODULES

#: Signals of a hook of `drive` and `force` that change within a tick.
CHANGING = frozenset({'position', 'velocity', 'acting', 'state', 'step', 'time'})


@cache
def _asked(function: Callable[..., Any]) -> tuple[str, ...]:
    return tuple(inspect.signature(function).parameters)


def _taking_part(hook: str) -> list[tuple[Effect, Callable[..., Any]]]:
    modules: list[ModuleType] = sorted(MODULES.values(), key=lambda m: m.EFFECT.order)
    return [(m.EFFECT, getattr(m, hook)) for m in modules if hasattr(m, hook)]


def _argument(effect: Effect, name: str, signals: tuple[str, ...], hook: str) -> str:
    """Source text of what a function is handed for one of its arguments."""
    slots = layout.AXIS_SLOTS if effect.per_axis else layout.COMMON_SLOTS
    if (effect.name, name) in slots:
        return f'row[{slots[effect.name, name]}]'
    if name in signals:
        return name
    if name == 'state' and effect.states:
        first, last = layout.STATES[effect.name]
        return f'state[{first}:{last}]'
    if effect.per_axis and name in layout.AXIS_FIELDS:
        return f'row[{layout.AXIS_FIELDS.index(name)}]'
    many = [slots[effect.name, parameter] for parameter in _many(effect, name)]
    if many:
        return f'row[{many[0]}:{many[-1] + 1}]'
    raise TypeError(
        f'effect {effect.name}: {hook} asks for {name}: there are its parameters, the fields of '
        f'the axis and {", ".join(signals)}'
    )


def _many(effect: Effect, name: str) -> list[str]:
    """Parameters of an effect that are this name and an index; all for `parameters`."""
    if name == 'parameters':
        return [p.name for p in effect.parameters]
    return [p.name for p in effect.parameters if re.fullmatch(rf'{name}\d+', p.name)]


def _compose(hook: str, signals: tuple[str, ...], body: str, start: str, end: str) -> Any:
    """One compiled function (row, state, *signals) of all that take part in a hook."""
    namespace: dict[str, Any] = {}
    lines = [f'def {hook}({", ".join(("row", "state", *signals))}):', f'    {start}']
    slots = layout.AXIS_SLOTS if hook in layout.AXIS_HOOKS else layout.COMMON_SLOTS
    lines += [f'    if row[{slots["", hook]}] == 0.0:', f'        return {end}']
    for effect, function in _taking_part(hook):
        own = f'{effect.name}_{hook}'
        namespace[own] = njit(function, inline='always', _nrt=False)
        call = ', '.join(_argument(effect, n, signals, hook) for n in _asked(function))
        lines.append(f'    if row[{slots[effect.name, ""]}] != 0.0:')
        lines.append('        ' + body.format(f'{own}({call})'))
    lines.append(f'    return {end}')
    exec(compile('\n'.join(lines), f'<effects: {hook}>', 'exec'), namespace)
    # No division raises: a function that cannot fail is taken into its caller.
    return njit(namespace[hook], error_model='numpy', _nrt=False)


def _sum(hook: str, *signals: str) -> Any:
    return _compose(hook, signals, 'total += {}', 'total = 0.0', 'total')


def _chain(hook: str, *signals: str) -> Any:
    return _compose(hook, signals, f'{signals[0]} = {{}}', 'pass', signals[0])


read = _chain('read', 'position')
drive = _chain('drive', 'force', 'position', 'velocity', 'step', 'time')
force = _sum(
    'force',
    *('position', 'velocity', 'acting', 'step', 'time', 'other_velocity', 'other_acceleration'),
)
sliding = _sum('sliding', 'position', 'velocity', 'positive')
start = _compose('start', ('position',), '{}', 'pass', 'None')
follow = _chain('follow', 'position', 'velocity', 'step', 'time')
heat = _sum('heat', 'velocity', 'step')
along = _sum('along', 'motor', 'played', 'rise')
across = _sum('across', 'position')
turn = _sum('turn', 'position', 'other', 'side')
plane = _compose('plane', ('x', 'y'), 'x, y = {}', 'pass', 'x, y')


def switch(effect: Effect, row: np.ndarray) -> None:
    """Switch an effect on in its row, and the hooks that it takes part in."""
    slots = layout.AXIS_SLOTS if effect.per_axis else layout.COMMON_SLOTS
    row[slots[effect.name, '']] = 1.0
    module = MODULES[effect.name]
    for hook in layout.AXIS_HOOKS if effect.per_axis else layout.COMMON_HOOKS:
        if hasattr(module, hook):
            row[slots['', hook]] = 1.0
            if hook in ('drive', 'force') and CHANGING.intersection(_asked(getattr(module, hook))):
                row[layout.FINE_COLUMN] = 1.0
    if couples(effect.name):
        row[layout.COUPLED_COLUMN] = 1.0


def prepare(effect: Effect, axis: dict[str, float], values: Mapping[str, float]) -> None:
    """Let an effect change the fields of an axis."""
    change = getattr(MODULES[effect.name], 'prepare', None)
    if change is not None:
        change(axis, **{name: values[name] for name in _asked(change)[1:]})


def _on(effect: Effect, row: np.ndarray) -> bool:
    slots = layout.AXIS_SLOTS if effect.per_axis else layout.COMMON_SLOTS
    return bool(row[slots[effect.name, '']] != 0.0)


def _own(
    effect: Effect, function: Callable[..., Any], row: np.ndarray, given: tuple[str, ...] = ()
) -> dict[str, Any]:
    """Parameters that a function asks for beside what it is given."""
    return {n: _value(effect, n, row) for n in _asked(function) if n not in given}


def _value(effect: Effect, name: str, row: np.ndarray) -> Any:
    """A parameter of an effect, an array of those with an index, or a field of the axis."""
    slots = layout.AXIS_SLOTS if effect.per_axis else layout.COMMON_SLOTS
    if (effect.name, name) in slots:
        return row[slots[effect.name, name]]
    if effect.per_axis and name in layout.AXIS_FIELDS:
        return row[layout.AXIS_FIELDS.index(name)]
    return np.array([row[slots[effect.name, n]] for n in _many(effect, name)])


def stiffness(row: np.ndarray) -> float:
    """Stiffness before sliding [N/m] of all frictions of an axis together."""
    parts = _taking_part('stiffness')
    return float(sum(function(**_own(e, function, row)) for e, function in parts if _on(e, row)))


def creep(row: np.ndarray) -> float:
    """Speed [m/s] below which the frictions of an axis give way; 0 where they hold."""
    parts = _taking_part('creep')
    speeds = [function(**_own(e, function, row)) for e, function in parts if _on(e, row)]
    return float(max(speeds, default=0.0))


def command(row: np.ndarray, force: np.ndarray, velocity: np.ndarray, step: float) -> np.ndarray:
    """Force (n,) [N] to command, every `step` [s], for a force that acts: `drive` backwards."""
    signals = {'force': force, 'velocity': velocity, 'step': step}
    for effect, function in reversed(_taking_part('command')):
        if _on(effect, row):
            given = {name: signals[name] for name in _asked(function) if name in signals}
            own = _own(effect, function, row, tuple(signals))
            signals['force'] = function(**given, **own)
    return np.asarray(signals['force'])


def couples(effect: str) -> bool:
    """Whether an effect's force depends on the motion of the other axis."""
    asked = getattr(MODULES[effect], 'force', None)
    return asked is not None and any(name.startswith('other_') for name in _asked(asked))


def _through(hook: str, signal: str) -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
    """What is handed a row and values (n,) or (n, 3), and passes them through a hook in Python."""

    def passed(row: np.ndarray, values: np.ndarray) -> np.ndarray:
        for effect, function in _taking_part(hook):
            if _on(effect, row):
                values = function(values, **_own(effect, function, row, (signal,)))
        return np.asarray(values)

    return passed


recorded = _through('recorded', 'force')
tick_stamp = _through('tick_stamp', 'times')
point_stamp = _through('point_stamp', 'times')
stamp = _through('stamp', 'times')
true_time = _through('true_time', 'stamps')
seen = _through('seen', 'points')
