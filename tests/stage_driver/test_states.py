"""The state machine against a table written out by hand, and its latched faults."""

import itertools

import pytest

from stage_core.errors import StageError
from stage_driver.states import TRANSITIONS, Event, State, StateMachine

EXPECTED = """
state     enable  disable   move    done   fail   reset_fault
disabled  ready   disabled  -       -      fault  disabled
ready     ready   disabled  moving  ready  fault  ready
moving    moving  disabled  moving  ready  fault  moving
fault     -       fault     -       fault  fault  disabled
"""
HEAD, *ROWS = (line.split() for line in EXPECTED.strip().splitlines())


@pytest.mark.parametrize(
    ('state', 'event'), itertools.product(State, Event), ids=lambda value: value.value
)
def test_every_pair_of_the_table(state, event):
    row = next(row for row in ROWS if row[0] == state.value)
    expected = row[HEAD.index(event.value)]
    machine = StateMachine()
    machine.state = state
    if expected == '-':
        assert (state, event) not in TRANSITIONS
        with pytest.raises(StageError, match=r'~/|refused'):
            machine.handle(event)
        assert machine.state is state
    else:
        assert machine.handle(event, 'why') is State(expected)


def test_the_first_reason_of_a_fault_stays_until_the_reset():
    seen = []
    machine = StateMachine(lambda before, after, reason: seen.append((before, after, reason)))
    machine.handle(Event.ENABLE)
    machine.handle(Event.FAIL, 'following error')
    machine.handle(Event.FAIL, 'drive lost')
    machine.handle(Event.DISABLE)
    assert machine.reason == 'following error'
    assert 'following error' in (machine.refusal(Event.MOVE) or '')
    machine.handle(Event.RESET)
    assert machine.state is State.DISABLED and machine.reason == ''
    assert seen == [
        (State.DISABLED, State.READY, ''),
        (State.READY, State.FAULT, 'following error'),
        (State.FAULT, State.DISABLED, ''),
    ]


def test_nothing_starts_enabled():
    assert StateMachine().state is State.DISABLED
    assert StateMachine().refusal(Event.MOVE) is not None
