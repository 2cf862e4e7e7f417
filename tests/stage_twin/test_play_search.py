"""A play in the drive is found from the force and the path alone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from stage_twin.effects.drive_play import term
from stage_twin.effects.play_search import Crossing

from .one_axis import MASS, PERIOD, VISCOUS, one_axis, open_loop, swing

SHARE, WIDTH = 0.3, 40e-6


@dataclass
class Rows:
    """Rows of a force balance at every tick, as the search asks for them."""

    force: np.ndarray
    path: np.ndarray
    mass: float = MASS
    periods: tuple[float, ...] = (PERIOD,)

    def applied(self):
        return [0.5 * (self.force + np.concatenate([self.force[:1], self.force[:-1]]))]

    def position(self):
        return [self.path]

    def columns(self, *signals):
        slow = np.exp(-0.5 * (np.arange(-15, 16) / 5.0) ** 2)
        return np.column_stack([np.convolve(s, slow / slow.sum(), 'same') for (s,) in signals])

    def residual(self):
        needed = np.zeros_like(self.path)
        needed[1:-1] = MASS * np.diff(self.path, 2) / PERIOD**2
        needed += VISCOUS * np.gradient(self.path, PERIOD)
        return self.columns([self.applied()[0] - needed])[:, 0]


def rows_of(effects, force):
    return Rows(force, open_loop(one_axis(effects), force))


@pytest.mark.parametrize('contact', [0.2, 1.0])
def test_what_the_drive_needs_to_cross_its_play_is_what_the_balance_misses(contact):
    values = {'width': WIDTH, 'mass_ratio': SHARE, 'contact_damping': contact}
    rows = rows_of({'drive_play.x': values}, swing(15.0, 20.0, 2000))
    residual = rows.residual()
    ((moment, share, *_),) = Crossing(rows).propose(residual)
    assert moment == pytest.approx(SHARE * WIDTH, rel=0.2)
    assert 0.5 * WIDTH < moment / share < 2.0 * WIDTH
    left = residual - Crossing(rows).columns((moment, share, contact, 300.0))[:, 0]
    assert np.sum(left**2) < 0.2 * np.sum(residual**2)


def test_a_soft_base_is_no_play():
    values = {'frequency': 9.0, 'damping': 0.05, 'mass_ratio': 0.2}
    rows = rows_of({'base_resonance.x': values}, swing(15.0, 20.0, 2000))
    residual = rows.residual()
    ((moment, *_),) = Crossing(rows).propose(residual)
    assert moment == 0.0


@pytest.mark.parametrize(
    ('damping', 'is_play'),
    [(0.35, True), (0.02, False), (9.0, False)],
    ids=['an edge that stops', 'a load on a spring', 'a wave that the encoder misreads'],
)
def test_an_edge_of_a_play_neither_rings_nor_creeps(damping, is_play):
    play = term(rows_of({}, swing(15.0, 20.0, 2000)))
    assert play.admissible((SHARE * WIDTH, SHARE, damping, 300.0), np.ones(1)) is is_play
