"""From parameters to contours, gains and settings; the configuration files of the workspace."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from contour_ctrl import contour_parameters as parameters
from stage_core.errors import StageError

from ..config_files import section


def values(**changes: Any) -> Callable[[str], Any]:
    known = {p.name: p.default for p in parameters.PARAMETERS}
    assert set(changes) <= set(known)
    return {**known, **changes}.__getitem__


@pytest.mark.parametrize('name', ['contour_ctrl', 'contour_ctrl_zaber'])
def test_configuration_files_make_a_run(name: str) -> None:
    _, given = section(name)
    value = given.__getitem__
    reference = parameters.make_reference(value, parameters.make_curve(value))
    assert reference.feed == pytest.approx(given['feed'])
    assert parameters.make_gains(value).cross_coupling == given['cross_coupling']
    assert parameters.make_learning(value) is not None


@pytest.mark.parametrize('kind', ['circle', 'square', 'star', 'eight'])
def test_contours_with_default_sizes_can_be_followed(kind: str) -> None:
    value = values(contour=kind, centre_x=0.01, reduce_feed=True)
    reference = parameters.make_reference(value, parameters.make_curve(value))
    assert reference.position.mean(axis=0) == pytest.approx([0.01, 0.0], abs=2e-3)


def test_contours_from_text_and_files(tmp_path: Path) -> None:
    points = '[[0, 0], [0.02, 0.0], [0.03, 0.02], [0.01, 0.03], [-0.01, 0.015]]'
    file = tmp_path / 'points.yaml'
    file.write_text(f'points: {points}')
    curve = parameters.make_curve(values(contour='freeform', curve_file=str(file)))
    assert curve.closed
    assert curve.derivatives(curve.domain[0], 0)[0, 0] == pytest.approx([0.0, 0.0])
    hra = parameters.make_curve(values(contour='hra'), f'points: {points}')
    assert not hra.closed
    ends = hra.derivatives(np.array(hra.domain), 0)[0]
    assert ends == pytest.approx(np.array([[0.0, 0.0], [-0.01, 0.015]]), abs=1e-9)
    reference = parameters.make_reference(values(reduce_feed=True), hra)
    assert reference.position[-1] == pytest.approx([-0.01, 0.015], abs=1e-6)
    with pytest.raises(StageError, match='set curve_file or publish'):
        parameters.make_curve(values(contour='nurbs'))
    with pytest.raises(StageError, match='cannot read the curve'):
        parameters.make_curve(values(contour='nurbs', curve_file=str(tmp_path / 'none')))
    with pytest.raises(StageError, match='under the key points'):
        parameters.make_curve(values(contour='freeform'), 'points: 7 x')


@pytest.mark.parametrize(
    ('kind', 'text', 'words'),
    [
        ('freeform', 'points: [[0, 0], [1, 2, 3]]', 'point 2 of 2 must be two finite'),
        ('freeform', 'points: [[0, 0], [1, .nan]]', 'point 2 of 2'),
        ('freeform', 'point: [[0, 0], [1, 1]]', 'did you mean points?'),
        ('freeform', 'points: [[0, 0], [1, 1]]\nclosed: 7', 'closed must be true or false'),
        ('hra', 'points: [x, [1, 1]]', 'point 1 of 2'),
    ],
)
def test_a_curve_file_is_checked_whole(kind: str, text: str, words: str) -> None:
    with pytest.raises(StageError, match=words.replace('?', '.')):
        parameters.make_curve(values(contour=kind), text)


def test_a_curve_is_checked_when_it_is_loaded(tmp_path: Path) -> None:
    file = tmp_path / 'points.yaml'
    file.write_text('points:\n - [0.0, 0.0]\n - [0.01, 0.0\n - [0.02, 0.0]\n')
    with pytest.raises(StageError, match='line 4'):
        parameters.check_curve(values(contour='freeform', curve_file=str(file)))
    # A circle takes no curve, and there may be one for another contour.
    parameters.check_curve(values(curve_file=str(file)))
    parameters.check_curve(values(contour='freeform'))


@pytest.mark.parametrize(
    ('line', 'words'),
    [
        ('0.1,0.001,abc', "line 4: '0.1,0.001,abc' is not three finite numbers"),
        ('0.1,0.001,nan', 'line 4: .* is not three finite'),
        ('0.1,0.001', 'line 4: .* is not three finite'),
        ('0.0,0.001,0.0', 'line 4: the time 0 s must be above'),
    ],
)
def test_a_timed_motion_is_checked_when_it_is_loaded(
    tmp_path: Path, line: str, words: str
) -> None:
    rows = [f'{0.1 * k:.1f},{1e-4 * k**2:.6f},0.0' for k in range(9)]
    file = tmp_path / 'motion.csv'
    file.write_text('\n'.join(['t,x,y', *rows]))
    parameters.check_curve(values(contour='timed', curve_file=str(file)))
    file.write_text('\n'.join(['t,x,y', *rows[:2], line, *rows[3:]]))
    with pytest.raises(StageError, match=words):
        parameters.check_curve(values(contour='timed', curve_file=str(file)))


def test_scheme_names_select_their_terms() -> None:
    plain = parameters.make_gains(values(scheme='p_ff'))
    assert plain.cross_coupling == 0.0 and plain.cmac is None and plain.friction is None
    assert parameters.make_learning(values(scheme='p_ff')) is None
    full = {'scheme': 'cccmac+rilc', 'x.coulomb': 20.0, 'y.coulomb': 8.0, 'x.static': 25.0}
    gains = parameters.make_gains(values(**full))
    assert gains.cmac is not None and gains.friction is not None
    assert gains.friction[0].static == 25.0 and gains.friction[1].static == 8.0
    with pytest.raises(StageError, match='x.coulomb and y.coulomb above zero'):
        parameters.make_gains(values(**{**full, 'y.coulomb': 0.0}))
    learning = parameters.make_learning(values(**full))
    assert learning is not None and learning.reinforced
    fixed = parameters.make_learning(values(scheme='ccc+ilc'))
    assert fixed is not None and not fixed.reinforced
