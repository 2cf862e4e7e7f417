"""Hypothesis explores the graph for a few steps; `make soak` does so for ten minutes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from hypothesis import HealthCheck, Phase, settings
from hypothesis.stateful import run_state_machine_as_test

from .exploration import World, machine


def test_any_order_of_calls_ends_no_node_and_keeps_the_limits(graph: Callable[..., Any]) -> None:
    with graph(calibrator={'adapt': True}) as (nodes, watch):
        world = World(nodes, watch)
        assert len(world.services) > 10 and len(world.parameters) > 100
        run_state_machine_as_test(
            machine(world),
            settings=settings(
                max_examples=2,
                stateful_step_count=15,
                deadline=None,
                derandomize=True,
                phases=(Phase.generate,),
                suppress_health_check=tuple(HealthCheck),
            ),
        )
        assert not world.broken, world.broken
        assert len(set(world.steps)) > 5
        world.settled()
        assert nodes.dead() == []
