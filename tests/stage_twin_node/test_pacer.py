"""Deadlines of the emulated drive: a short lag is caught up, a long one is lost time."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from stage_twin.emulators import drive
from stage_twin.emulators.drive import Pacer

PERIOD = 1e-3


class Clock:
    """Time that passes only where somebody sleeps or works."""

    def __init__(self):
        self.now = 100.0

    def monotonic(self):
        return self.now

    def sleep(self, duration):
        self.now += duration


@pytest.fixture
def clock(monkeypatch):
    clock = Clock()
    monkeypatch.setattr(drive, 'time', clock)
    return clock


def test_deadlines_are_a_period_apart_whatever_the_work_takes(clock):
    pacer = Pacer(PERIOD)
    pacer.start()
    for tick in range(1, 1000):
        assert pacer.next() == pytest.approx(100.0 + tick * PERIOD, abs=1e-9)
        assert clock.now == pytest.approx(pacer.deadline, abs=1e-9)
        clock.now += 0.9 * PERIOD
    assert (pacer.missed, pacer.pauses) == (0, 0)


def test_a_short_lag_is_caught_up_at_twice_the_speed(clock):
    pacer = Pacer(PERIOD)
    pacer.start()
    clock.now += 0.03
    begin, woken = clock.now, []
    for tick in range(1, 80):
        assert pacer.next() == pytest.approx(100.0 + tick * PERIOD, abs=1e-9)
        woken.append(clock.now)
    steps = [b - a for a, b in zip(woken, woken[1:], strict=False)]
    assert min(steps) == pytest.approx(0.5 * PERIOD, abs=1e-9)
    on_time = next(
        k for k, now in enumerate(woken) if now == pytest.approx(100.0 + (k + 1) * PERIOD)
    )
    assert woken[on_time] - begin == pytest.approx(0.03, abs=0.002)
    assert pacer.pauses == 0 and 50 < pacer.missed < 60
    assert pacer.worst == pytest.approx(0.029, abs=1e-6)


def test_what_exceeds_the_longest_lag_is_lost(clock):
    pacer = Pacer(PERIOD, longest_lag=0.05)
    pacer.start()
    clock.now += 0.2
    pacer.next()
    assert clock.now - pacer.deadline == pytest.approx(0.05, abs=1e-9)
    assert pacer.pauses == 1
    for _ in range(200):
        pacer.next()
    assert clock.now == pytest.approx(pacer.deadline, abs=1e-9)
    assert pacer.pauses == 1


@given(st.lists(st.floats(0.0, 0.3), max_size=50), st.floats(1e-3, 0.1))
def test_no_deadline_comes_early_and_none_lags_by_more(work, longest):
    with pytest.MonkeyPatch.context() as patch:
        clock = Clock()
        patch.setattr(drive, 'time', clock)
        pacer = Pacer(PERIOD, longest_lag=longest)
        pacer.start()
        for duration in work:
            clock.now += duration
            before = pacer.deadline
            lag = clock.now - before - PERIOD
            after = pacer.next()
            assert after - before >= PERIOD - 1e-9
            assert after <= clock.now + 1e-9
            assert clock.now - after <= longest + 1e-9
            # Nothing is lost that could be caught up.
            if lag <= longest - 0.5 * PERIOD:
                assert after - before == pytest.approx(PERIOD, abs=1e-9)
