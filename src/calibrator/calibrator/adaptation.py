"""Adapting the model in use from the rests that the live buffer has heard."""

from __future__ import annotations

import copy
from dataclasses import replace

import numpy as np

from calibrator.live_buffer import LiveBuffer
from calibrator.model_file import StoredModel
from calibrator.online import OnlineAdapter
from calibrator.prepare import rest_samples
from stage_core import topics

NEWEST = 20_000
"""Messages per topic that are looked through for new rests."""


class LiveAdaptation:
    """Feeds each new rest once to an `OnlineAdapter`.

    Parameters
    ----------
    stored
        The model in use.
    drift, noise
        Size of the drift to follow and deviation of a measured point [m].
    forgetting
        Of the recursive least squares.

    Raises
    ------
    StageError
        If the method has no linear weights.
    """

    def __init__(self, stored: StoredModel, drift: float, noise: float, forgetting: float) -> None:
        self._stored = stored
        self.adapter = OnlineAdapter(stored.model, drift, noise, forgetting)
        self._seen_until = 0

    @property
    def stored(self) -> StoredModel:
        """The adapted model where it is proven, with the provenance of the one it came from.

        It is a copy: what is learned later is in use only when it is asked for again.
        """
        if not self.adapter.proven:
            return self._stored
        return replace(self._stored, model=copy.deepcopy(self.adapter.model))

    def step(self, buffer: LiveBuffer) -> int:
        """Learn the rests that ended since the last call; how many there were.

        Raises
        ------
        StageError
            If the buffer holds no pair of reference and tracker point, or a sensor of the model
            was not heard.
        """
        # A sensor that the model does not use may fall silent.
        session = buffer.session(NEWEST, self._stored.sensors)
        samples, ended = rest_samples(session)
        # Before an axis' first move its play is open to either side.
        known = np.all(samples.direction != 0.0, axis=1)
        # Of a clock that was set back nothing has been seen.
        newest = int(session.series[topics.REFERENCE].stamps[-1])
        self._seen_until = min(self._seen_until, newest)
        fresh = samples.take((ended > self._seen_until) & known)
        if len(fresh):
            fresh = fresh.only(self._stored.sensors)
        for k in range(len(fresh)):
            row = slice(k, k + 1)
            heat = None if fresh.heat is None else fresh.heat[row]
            self.adapter.update(
                fresh.command[row], fresh.measured[row], fresh.direction[row], heat
            )
        self._seen_until = int(ended.max(initial=self._seen_until))
        return len(fresh)
