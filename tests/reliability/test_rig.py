"""What the rig says of nodes that a test waits for in vain, and of those that have ended."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from .rig import NodeEnded


def test_a_wait_in_vain_says_what_nodes_said_and_one_for_an_ended_node_is_no_wait(
    graph: Callable[..., Any], tmp_path: Path
) -> None:
    with graph('stage_twin') as (nodes, watch):
        watch.wait(lambda: watch.heard('stage_twin'), 'the plant')
        with pytest.raises(AssertionError, match=r'(?s)in vain for rain.*--- stage_twin:.*lockst'):
            watch.wait(lambda: False, 'rain', 0.1)
        nodes.kill('stage_twin')
        # A test that kills a node may wait for what others do without it.
        with pytest.raises(AssertionError, match='in vain for rain'):
            watch.wait(lambda: False, 'rain', 0.1)
        plant = nodes.commands['stage_twin']
        absent = {**plant.parameters, 'twin': tmp_path / 'absent.yaml'}
        nodes.commands['stage_twin'] = replace(plant, parameters=absent)
        nodes.run('stage_twin')
        with pytest.raises(NodeEnded, match=r'(?s)stage_twin ended with status 2:.*absent\.yaml'):
            watch.wait(lambda: False, 'the plant')
        with pytest.raises(NodeEnded):
            watch.home()
