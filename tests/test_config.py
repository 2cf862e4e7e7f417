"""The parameter files of the workspace name the parameters of their node, with good values."""

from __future__ import annotations

import importlib

import pytest

pytest.importorskip('rclpy', reason='ROS 2 is not installed')

from stage_bringup.reference import NODES, parameters_of
from stage_core.parameters import check

from .config_files import CONFIG, section

FILES = sorted(p.stem for p in CONFIG.glob('*.yaml') if not p.stem.startswith('twin_'))
#: Files that set what is not the default.
OWN = ('contour_ctrl', 'contour_ctrl_zaber', 'stage_driver_zaber')
#: Files that leave out what nobody sets.
SHORT = ('calibrator',)


@pytest.mark.parametrize('name', FILES)
def test_a_file_holds_the_parameters_with_good_values(name: str) -> None:
    node, values = section(name)
    declared = {p.name: p for p in parameters_of(importlib.import_module(NODES[node][0]))}
    assert set(values) <= set(declared)
    assert name in SHORT or set(values) == set(declared)
    for key, value in values.items():
        assert check(declared[key], value) is None
        assert name in OWN or value == declared[key].default
    assert all(p.description for p in declared.values())
