"""Graphs that are started once per module; every process is ended by its pid."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip('rclpy')

from stage_bringup.graph import Options, commands

from ..domains import own_domain
from .rig import Nodes, Watch


@pytest.fixture(scope='module')
def graph(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Callable[..., Any]]:
    """Maker of a graph: names of its nodes, clock, parameters per node."""
    folder = tmp_path_factory.mktemp('graph')

    @contextmanager
    def make(
        *names: str, clock: str = 'lockstep', **parameters: dict[str, object]
    ) -> Iterator[tuple[Nodes, Watch]]:
        chosen = []
        for command in commands(Options(clock=clock, out=folder / 'out')):
            if not names or command.name in names:
                extra = parameters.get(command.name, {})
                chosen.append(replace(command, parameters={**command.parameters, **extra}))
        nodes = Nodes(chosen, Path(folder) / 'log')
        watch = None
        try:
            nodes.run()
            watch = Watch(clock == 'lockstep')
            yield nodes, watch
        finally:
            if watch is not None:
                watch.close()
            nodes.end()

    # Nothing in the environment asks for this machine alone: the nodes choose it themselves.
    with own_domain(ROS_AUTOMATIC_DISCOVERY_RANGE=None):
        yield make
