"""Every service, parameter and topic of the running graph in any order: hypothesis' machine."""

from __future__ import annotations

import contextlib
import math
import os
import time
from collections import deque
from pathlib import Path
from typing import Any

from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule
from rcl_interfaces.srv import GetParameters, ListParameters
from std_msgs.msg import String

from stage_core import topics
from stage_core.errors import StageError
from stage_core.ros.node import LATCHED_QOS, joint_state

from .rig import Nodes, Watch

#: The travel of `stage_driver_servo.yaml` [m] and what a controlled stop may overrun.
TRAVEL = 0.15 + 1e-3
#: A training and a contour grow a process by some 40 MiB once; what goes on growing is a leak.
GROWTH = 150 * 2**20
#: Patience for a plan that nobody takes any more to end [s].
GIVEN_BACK = 60.0
#: Not the project's: rclpy's own switch between two clocks ends the virtual time of a node.
FOREIGN = 'use_sim_time'
ANSWER = 2.0
NUMBERS = st.one_of(
    st.floats(-0.3, 0.3),
    st.sampled_from([0.0, -1.0, 1e-12, 1e300, float('nan'), float('inf')]),
)
TEXTS = st.sampled_from(['', 'x', '../x', '/no/such', '{"active": true}', '[' * 5000, 'circle'])


class World:
    """The running graph: what it offers, how large its processes were, what was done last."""

    def __init__(self, nodes: Nodes, watch: Watch) -> None:
        self.nodes, self.watch = nodes, watch
        client = watch.client
        self.settled()
        found = client.node.get_service_names_and_types()
        self.services = sorted(
            (name, kinds[0].rpartition('/')[2])
            for name, kinds in found
            if kinds[0] in ('std_srvs/srv/Trigger', 'std_srvs/srv/SetBool')
        )
        self.parameters = sorted(p for name in nodes.commands for p in self._parameters(name))
        self.sizes = {name: self.memory(name) for name in nodes.commands}
        self.curve = client.node.create_publisher(String, '/contour_ctrl/curve', LATCHED_QOS)
        self.calls = self.answers = 0
        self.steps: deque[str] = deque(maxlen=30)
        #: Nothing is done any more after this time, or when something is broken.
        self.end = math.inf
        #: What must not happen, and the steps before it. It is not raised within the machine:
        #: the world cannot be set back, and hypothesis takes a run that stops earlier than one
        #: with the same draws for an error of the strategies, and tells that instead.
        self.broken = ''

    def _parameters(self, node: str) -> list[tuple[str, str, str]]:
        call = self.watch.client.call
        listed = call(ListParameters, f'/{node}/list_parameters', ListParameters.Request(), 30.0)
        names = [n for n in listed.result.names if n != FOREIGN and not n.startswith('qos_')]
        request = GetParameters.Request(names=names)
        values = call(GetParameters, f'/{node}/get_parameters', request, 30.0).values
        kinds = {1: 'bool', 2: 'int', 3: 'float', 4: 'text'}
        return [
            (node, n, kinds[v.type]) for n, v in zip(names, values, strict=True) if v.type in kinds
        ]

    def memory(self, node: str) -> int:
        """Resident memory of a node [bytes]."""
        pages = Path(f'/proc/{self.nodes.running[node].pid}/statm').read_text().split()[1]
        return int(pages) * os.sysconf('SC_PAGE_SIZE')

    def over(self) -> bool:
        """Whether nothing is to be done any more."""
        return bool(self.broken) or time.monotonic() > self.end

    def abort(self) -> None:
        """End what is under way."""
        for service in ('/contour_ctrl/abort', '/calibrator/abort'):
            with contextlib.suppress(StageError):
                self.watch.client.trigger(service, ANSWER)

    def at_rest(self, name: str, limit: float) -> int:
        """Memory of a node [bytes]; beyond `limit`, when what it does has been aborted.

        A contour of 628,000 ticks holds 160 MiB and gives them back (the longest has 2,000,000).
        """
        if self.memory(name) >= limit:
            self.abort()
            deadline = time.monotonic() + GIVEN_BACK
            while self.memory(name) >= limit and time.monotonic() < deadline:
                time.sleep(0.1)
        return self.memory(name)

    def ask(self, what: Any, *arguments: Any, **named: Any) -> None:
        """Call something that may refuse, or may still be busy with an earlier call."""
        if self.over():
            return
        self.calls += 1
        self.steps.append(f'{what.__name__} {arguments} {named}')
        try:
            what(*arguments, **named)
        except StageError as refusal:
            self.answers += 'did not answer' not in str(refusal)
        except Exception as error:
            self.demand(False, repr(error))
        else:
            self.answers += 1

    def demand(self, true: bool, what: str) -> None:
        """Keep the first that is not true, with the last steps before it."""
        if not true and not self.broken:
            self.broken = '\n'.join((*self.steps, what))

    def settled(self) -> None:
        """Every node lives and speaks."""
        now = time.monotonic()
        for name in self.nodes.commands:
            self.watch.wait(
                lambda name=name: any(  # type: ignore[misc]
                    key.startswith(f'{name}:') and state[3] > now
                    for key, state in list(self.watch.states.items())
                ),
                f'{name} on /diagnostics',
            )


def machine(world: World) -> type[RuleBasedStateMachine]:
    """A state machine over the world; the world goes on from one example to the next."""
    client = world.watch.client

    class Exploration(RuleBasedStateMachine):
        @rule(service=st.sampled_from(world.services), value=st.booleans())
        def call(self, service: tuple[str, str], value: bool) -> None:
            name, kind = service
            if kind == 'Trigger':
                world.ask(client.trigger, name, ANSWER)
            else:
                world.ask(client.set_bool, name, value, ANSWER)

        @rule(data=st.data(), which=st.sampled_from(world.parameters))
        def parameter(self, data: Any, which: tuple[str, str, str]) -> None:
            node, name, kind = which
            values = {'bool': st.booleans(), 'int': st.integers(-5, 2**33), 'float': NUMBERS}
            value = data.draw(values.get(kind, TEXTS))
            named = {name.replace('.', '__'): value}
            world.ask(client.set_parameters, f'/{node}', ANSWER, **named)

        @rule(x=NUMBERS, y=NUMBERS, corrected=st.booleans(), speed=st.none() | NUMBERS)
        def move(self, x: float, y: float, corrected: bool, speed: float | None) -> None:
            if world.over():
                return
            stamp = max(client.node.get_clock().now().nanoseconds, 0)
            velocity = None if speed is None else (speed, 0.0)
            message = joint_state(stamp, ('x', 'y'), (x, y), velocity)
            world.steps.append(f'move {x} {y} {speed} {corrected}')
            (world.watch.targets if corrected else world.watch.setpoints).publish(message)

        @rule(text=TEXTS)
        def curve(self, text: str) -> None:
            if world.over():
                return
            world.steps.append(f'curve {text[:20]}')
            world.curve.publish(String(data=text))

        @rule()
        def usable_again(self) -> None:
            world.ask(client.trigger, '/stage_driver/reset_fault', ANSWER)
            world.ask(client.set_bool, '/stage_driver/enable', True, ANSWER)
            world.ask(client.trigger, '/stage_driver/home', ANSWER)

        @rule()
        def rest(self) -> None:
            # The simplest rule: the first example of each exploration has no other.
            time.sleep(0.1)

        @invariant()
        def nobody_ended_and_nothing_is_outside(self) -> None:
            dead = world.nodes.dead()
            world.demand(not dead, f'{dead} ended')
            if world.broken:
                return
            for name, size in world.sizes.items():
                now = world.at_rest(name, size + GROWTH)
                world.demand(now < size + GROWTH, f'{name} grew from {size} to {now} bytes')
            if world.watch.encoder:
                row = world.watch.encoder[-1]
                inside = max(abs(row[1]), abs(row[2])) <= TRAVEL
                world.demand(inside, f'{topics.JOINT_STATES}: {row}')

    return Exploration
