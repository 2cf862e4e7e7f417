"""The pictures show the figures that they are given."""

from __future__ import annotations

import numpy as np
import pytest

from stage_core.errors import StageError
from stage_reports import circular, figures, positioning


def test_error_maps_share_a_scale_and_state_the_rms() -> None:
    grid = np.array([[x, y] for x in (0.0, 0.01) for y in (0.0, 0.01)])
    before = np.tile([3e-6, 4e-6], (4, 1))
    figure = figures.error_map(grid, before, before / 10.0)
    titles = [axes.get_title(loc='left') for axes in figure.axes]
    assert titles == ['before: RMS 5.00 µm', 'after: RMS 0.50 µm']
    scales = {axes.collections[0].scale for axes in figure.axes}
    assert len(scales) == 1
    np.testing.assert_allclose(figure.axes[0].collections[0].U, 3.0)
    alone = figures.error_map(grid, before)
    assert [axes.get_title(loc='left') for axes in alone.axes] == ['errors: RMS 5.00 µm']
    with pytest.raises(StageError, match='each point'):
        figures.error_map(grid, before[:2])
    with pytest.raises(StageError, match='finite'):
        figures.error_map(grid, before * np.nan)


def test_positioning_and_circular_plots_show_their_figures() -> None:
    result = positioning([0.0, 0.1], [[1e-6, 1e-6], [2e-6, 2e-6]], [[0.0, 0.0], [0.0, 0.0]])
    uncertain = {'A': 2e-7, 'R': 3e-7, 'E': 1e-7, 'B': 1e-7}
    axes = figures.positioning_plot(result, uncertain, 'axis x').axes[0]
    title = axes.get_title(loc='left')
    assert 'A 2.0 ± 0.2 µm' in title and 'B 2.00 ± 0.10 µm' in title
    # U of A, at the upper end of the bracket.
    (bar,) = axes.containers[0].lines[2]
    assert bar.get_segments()[0][:, 1] == pytest.approx([1.8, 2.2])
    angle = np.linspace(0.0, 2.0 * np.pi, 400)
    path = 0.010001 * np.column_stack([np.cos(angle), np.sin(angle)])
    outcome = circular(path, path[::-1], 0.01, (0.0, 0.0))
    axes = figures.circular_plot(outcome, path, path[::-1]).axes[0]
    assert 'G(b)' in axes.get_title()
    drawn = axes.lines[0].get_ydata()
    np.testing.assert_allclose(drawn[np.isfinite(drawn)], 1.0, rtol=1e-6)
    # One gap, where the angle's branch changes.
    assert np.isnan(drawn).sum() == 1


def test_learning_pictures_and_spectra() -> None:
    curve = figures.convergence({'RMS': [1e-5, 5e-6, 1e-6]}).axes[0]
    np.testing.assert_allclose(curve.lines[0].get_ydata(), [10.0, 5.0, 1.0])
    assert curve.get_yscale() == 'log'
    rate = 1000.0
    tone = np.sin(2.0 * np.pi * 50.0 * np.arange(8192) / rate)
    line = figures.spectrum({'tone': tone}, rate, 'µm').axes[0].lines[0]
    peak = line.get_xdata()[np.argmax(line.get_ydata())]
    assert peak == pytest.approx(50.0, abs=0.5)
    for bad in (
        lambda: figures.convergence({}),
        lambda: figures.spectrum({'a': [1.0]}, 1.0, 'm'),
        lambda: figures.spectrum({'a': np.ones(16)}, 0.0, 'm'),
        lambda: figures.time_series([0.0], {'a': [1.0, 2.0]}, 'm'),
        lambda: figures.histogram({'a': [1.0]}),
        lambda: figures.error_over_path([], 'angle'),
        lambda: figures.error_over_axis([0.0], [0.0, 1.0], [1.0], 'x'),
    ):
        with pytest.raises(StageError):
            bad()
