"""Live mode: bands of the gap per channel, and the warning when something changes."""

from __future__ import annotations

from collections.abc import Callable

from gap_diagnosis.live import Band, LiveMonitor
from stage_core import topics
from stage_core.session import Session
from stage_core.twin_file import TwinFile

Maker = Callable[..., Session]


def feed(monitor: LiveMonitor, session: Session) -> int:
    """Feed a session message by message; the number of windows that were judged."""
    judged = 0
    fields = {
        topics.REFERENCE: ('position.x', 'velocity.x'),
        topics.COMMAND: ('velocity.x', 'effort.x'),
        topics.JOINT_STATES: ('position.x',),
    }
    points = session.series[topics.TRACKER_POINT]
    for p, stamp in enumerate(points.stamps.tolist()):
        monitor.add_point(stamp, *(float(points.values[k][p]) for k in 'xyz'))
        for topic, keys in fields.items():
            series = session.series[topic]
            for k in range(10 * p, min(10 * p + 10, len(series))):
                values = tuple(float(series.values[key][k]) for key in keys)
                monitor.add(topic, int(series.stamps[k]), ('x',), values)
        judged += int(monitor.judge())
    return judged


def test_a_machine_that_changes_leaves_its_band(planted: Maker) -> None:
    monitor = LiveMonitor(TwinFile.nominal_servo(), window=3.0, learn=3)
    assert feed(monitor, planted({}, duration=20.0)) >= 4
    assert set(monitor.bands) == {'encoder.x', 'tracker.x'}
    assert all(band.ready and not band.left for band in monitor.bands.values())
    feed(
        monitor,
        planted(
            {'backlash.x': {'width': 20e-6}, 'coulomb_friction.x': {'coulomb': 9}}, duration=20.0
        ),
    )
    assert monitor.bands['tracker.x'].left
    assert monitor.bands['encoder.x'].left


def test_a_band_is_known_after_its_windows() -> None:
    band = Band(learn=3, width=5.0, floor=1e-6)
    for rms in (2.0e-6, 2.1e-6):
        band.take(rms)
        assert not band.ready and not band.left
    band.take(1.9e-6)
    assert band.ready and not band.left
    band.take(9.0e-6)
    assert band.left
    band.take(2.0e-6)
    assert not band.left


def test_a_machine_that_starts_again_begins_a_window(planted: Maker) -> None:
    monitor = LiveMonitor(TwinFile.nominal_servo(), window=3.0, learn=3)
    session = planted({}, duration=20.0)
    feed(monitor, session)
    judged = len(monitor.bands['encoder.x'].values)
    assert judged == 3
    # The same stamps again, as of an emulated machine in lockstep that was started anew.
    assert feed(monitor, session) >= 4
    assert not any(band.left for band in monitor.bands.values())


def test_what_waits_for_a_silent_topic_is_forgotten() -> None:
    monitor = LiveMonitor(TwinFile.nominal_servo(), window=2.0)
    for second in range(60):
        for k in range(1000):
            stamp = 10**9 * second + 10**6 * k
            if second < 30:
                monitor.add(topics.JOINT_STATES, stamp, ('x', 'y'), (0.0, 0.0))
                monitor.add(topics.COMMAND, stamp, ('x', 'y'), (0.0, 0.0, 0.0, 0.0))
            if second < 1:
                monitor.add(topics.REFERENCE, stamp, ('x', 'y'), (0.0, 0.0, 0.0, 0.0))
            monitor.add_point(stamp, 0.0, 0.0, 0.0)
        assert not monitor.judge()
        assert max(map(len, (monitor._points, *monitor._topics.values())), default=0) <= 5000
