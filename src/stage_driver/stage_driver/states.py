"""The driver's states as one explicit table.

DISABLED  no force, no moves        READY  at rest, held
MOVING    a move, a stream, homing  FAULT  latched with its reason until `~/reset_fault`
"""

from __future__ import annotations

from collections.abc import Callable
from enum import Enum

from stage_core.errors import StageError


class State(Enum):
    """What the stage may do now."""

    DISABLED = 'disabled'
    READY = 'ready'
    MOVING = 'moving'
    FAULT = 'fault'


class Event(Enum):
    """What changes the state."""

    ENABLE = 'enable'
    DISABLE = 'disable'
    MOVE = 'move'
    DONE = 'done'
    FAIL = 'fail'
    RESET = 'reset_fault'


TRANSITIONS: dict[tuple[State, Event], State] = {
    (State.DISABLED, Event.ENABLE): State.READY,
    (State.DISABLED, Event.DISABLE): State.DISABLED,
    (State.DISABLED, Event.RESET): State.DISABLED,
    (State.DISABLED, Event.FAIL): State.FAULT,
    (State.READY, Event.ENABLE): State.READY,
    (State.READY, Event.DISABLE): State.DISABLED,
    (State.READY, Event.MOVE): State.MOVING,
    (State.READY, Event.DONE): State.READY,
    (State.READY, Event.RESET): State.READY,
    (State.READY, Event.FAIL): State.FAULT,
    (State.MOVING, Event.ENABLE): State.MOVING,
    (State.MOVING, Event.DISABLE): State.DISABLED,
    (State.MOVING, Event.MOVE): State.MOVING,
    (State.MOVING, Event.DONE): State.READY,
    (State.MOVING, Event.RESET): State.MOVING,
    (State.MOVING, Event.FAIL): State.FAULT,
    (State.FAULT, Event.DISABLE): State.FAULT,
    (State.FAULT, Event.DONE): State.FAULT,
    (State.FAULT, Event.FAIL): State.FAULT,
    (State.FAULT, Event.RESET): State.DISABLED,
}
"""Every pair that is absent is refused: a move or enabling in FAULT, a move in DISABLED."""

REMEDIES = {
    State.DISABLED: 'the stage is disabled: call ~/enable with data true',
    State.FAULT: 'the stage is in fault ({reason}): remove the cause and call ~/reset_fault, then '
    '~/enable with data true if the stage is still disabled',
}


class StateMachine:
    """Current state, and the reason of the latched fault."""

    def __init__(self, changed: Callable[[State, State, str], None] | None = None) -> None:
        self.state = State.DISABLED
        self.reason = ''
        self._changed = changed

    def refusal(self, event: Event) -> str | None:
        """Why an event is refused now and what to do, or None where the table allows it."""
        if (self.state, event) in TRANSITIONS:
            return None
        template = REMEDIES.get(self.state, f'{event.value} is refused in {self.state.value}')
        return template.format(reason=self.reason)

    def handle(self, event: Event, reason: str = '') -> State:
        """Take a transition; the first reason of a fault stays until the reset.

        Raises
        ------
        StageError
            If the table has no such transition; the state stays as it was.
        """
        refused = self.refusal(event)
        if refused is not None:
            raise StageError(refused)
        before, self.state = self.state, TRANSITIONS[self.state, event]
        if self.state is not State.FAULT:
            self.reason = ''
        elif before is not State.FAULT:
            self.reason = reason
        if self._changed is not None and before is not self.state:
            self._changed(before, self.state, self.reason)
        return self.state
