"""Graphs that are started once per module; every process is ended by its pid."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from typing import Any

import pytest

pytest.importorskip('rclpy')

from stage_bringup.graph import Options

from ..domains import own_domain
from .rig import Nodes, Watch, running


@pytest.fixture(scope='module')
def graph(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Callable[..., Any]]:
    """Maker of a graph: names of its nodes, clock, parameters per node."""
    out = tmp_path_factory.mktemp('graph') / 'out'

    def make(
        *names: str, clock: str = 'lockstep', **parameters: dict[str, object]
    ) -> AbstractContextManager[tuple[Nodes, Watch]]:
        return running(Options(clock=clock, out=out), *names, **parameters)

    # Nothing in the environment asks for this machine alone: the nodes choose it themselves.
    with own_domain(ROS_AUTOMATIC_DISCOVERY_RANGE=None):
        yield make
