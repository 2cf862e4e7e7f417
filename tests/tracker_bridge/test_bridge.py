"""Clock offset, checks of the stream, rests and the registration, without sockets."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from tracker_bridge.bridge import Bridge, Limits
from tracker_bridge.offset import MAXIMUM_WAITING, ClockOffset
from tracker_bridge.rest import RestPairs, RestRules
from tracker_bridge.samples import Sample

MS = 1_000_000
SECOND = 1_000_000_000


def stream(count, delays_ms=(5,), offset_ns=-7 * SECOND, step_ns=10 * MS, start_ns=100 * SECOND):
    """Samples of a source whose clock is `offset_ns` ahead, with a cycle of delays."""
    return [
        Sample(
            (1e-3 * k, 0.0, 0.0),
            start_ns + k * step_ns + delays_ms[k % len(delays_ms)] * MS,
            start_ns + k * step_ns + offset_ns,
        )
        for k in range(count)
    ]


def test_offset_is_the_minimum_over_two_seconds_and_stays():
    offset = ClockOffset()
    samples = stream(400, delays_ms=(9, 5, 7))
    out = [pair for sample in samples for pair in offset.feed(sample)]
    assert offset.offset_ns == 7 * SECOND + 5 * MS
    assert [stamp for stamp, _ in out] == [s.source_ns + offset.offset_ns for s in samples]
    # A faster packet later changes nothing.
    early = Sample((0.0, 0.0, 0.0), samples[-1].receive_ns, samples[-1].receive_ns - 6 * SECOND)
    assert offset.feed(early)[0][0] == early.source_ns + 7 * SECOND + 5 * MS


def test_points_wait_until_the_offset_is_known_and_none_is_lost():
    offset = ClockOffset()
    counts = [len(offset.feed(sample)) for sample in stream(300)]
    assert set(counts[:200]) == {0}
    assert sum(counts) == 300


def test_offset_memory_is_bounded():
    offset = ClockOffset()
    flood = [Sample((0.0, 0.0, 0.0), 0, k) for k in range(MAXIMUM_WAITING)]
    assert sum(len(offset.feed(sample)) for sample in flood) == MAXIMUM_WAITING


def test_ros_stamps_pass_and_a_source_without_clock_gets_the_receive_time():
    assert ClockOffset(0).feed(Sample((0.0, 0.0, 0.0), 9, 5))[0][0] == 5
    assert ClockOffset().feed(Sample((0.0, 0.0, 0.0), 9))[0][0] == 9


def run(bridge, samples):
    return [pair for sample in samples for pair in bridge.process(sample)]


def ros(stamp_ms, x=0.0, **other):
    return Sample((x, 0.0, 0.0), 0, stamp_ms * MS, **other)


def test_stamps_increase_strictly_whatever_comes():
    bridge = Bridge(source_clock='ros')
    out = run(bridge, [ros(10), ros(20), ros(20), ros(15), ros(30), ros(25), ros(40)])
    assert [stamp // MS for stamp, _ in out] == [10, 20, 30, 40]
    counters = bridge.counters
    assert (counters.duplicates, counters.out_of_order, counters.published) == (1, 2, 4)


def test_bad_points_are_dropped_and_counted():
    bridge = Bridge(source_clock='ros')
    out = run(bridge, [ros(10), ros(20, status=3), ros(30, x=math.nan), ros(40, x=math.inf)])
    assert len(out) == 1
    assert (bridge.counters.bad_status, bridge.counters.not_finite) == (1, 2)
    assert 'not finite' in bridge.complaints()[0]


@pytest.mark.parametrize('jump_ns', [5 * SECOND, -5 * SECOND])
def test_a_jump_of_the_clock_stops_the_points_until_reset(jump_ns):
    bridge = Bridge()
    samples = stream(1000)
    good = run(bridge, samples[:500])
    assert len(good) == 500
    jumped = [s._replace(source_ns=s.source_ns + jump_ns) for s in samples[500:]]
    assert run(bridge, jumped[:200]) == []
    assert bridge.counters.time_jumps == 200
    assert '~/reset' in bridge.complaints()[0]
    bridge.reset()
    assert bridge.complaints() == []
    again = run(bridge, jumped[200:])
    assert len(again) == 300
    late = samples[-1].receive_ns - again[-1][0]
    assert late == 0


@pytest.mark.parametrize('jump_ns', [4000 * SECOND, -4000 * SECOND])
@pytest.mark.parametrize('jumped', [range(100, 600), range(50, 51)])
def test_a_clock_that_jumps_before_its_offset_is_known_gives_no_wrong_stamp(jump_ns, jumped):
    bridge = Bridge()
    samples = [
        s._replace(source_ns=s.source_ns + jump_ns) if k in jumped else s
        for k, s in enumerate(stream(600))
    ]
    measured = {s.point: s.receive_ns for s in samples}
    out = run(bridge, samples)
    assert len(out) + bridge.counters.time_jumps == 600 and len(out) >= 500
    assert all(stamp == measured[point] for stamp, point in out)


def test_a_tracker_that_was_started_again_has_another_clock_also_after_a_long_pause():
    bridge = Bridge()
    first = stream(600)
    assert len(run(bridge, first)) == 600
    # Half an hour later, with a clock that stands 1000 s further back than the time that passed.
    opened = 1899 * SECOND
    later = stream(300, start_ns=1900 * SECOND)
    restarted = [s._replace(source_ns=s.source_ns - 1000 * SECOND) for s in later]
    assert run(bridge, [s._replace(opened_ns=opened) for s in restarted]) == []
    assert '~/reset' in bridge.complaints()[0]
    # A stall of the network is no jump: points may be old, but not older than their connection.
    sound = Bridge()
    run(sound, first)
    late = [s._replace(receive_ns=s.receive_ns + 30 * SECOND, opened_ns=opened) for s in later]
    assert len(run(sound, late)) == 300


def test_reset_keeps_the_offset_of_a_sound_clock():
    bridge = Bridge()
    run(bridge, stream(300))
    before = bridge.offset_ns
    bridge.reset()
    assert bridge.offset_ns == before is not None


def test_gap_leap_identical_run_rate_and_age_are_told():
    bridge = Bridge(Limits(rate=1000.0, gap=0.05, jump=0.01, identical=5, age=0.1))
    samples = stream(300, delays_ms=(5,))
    samples += [
        samples[-1]._replace(source_ns=samples[-1].source_ns + k * MS) for k in range(1, 9)
    ]
    for sample in samples:
        bridge.process(sample)
    far = samples[-1]._replace(
        point=(1.0, 0.0, 0.0),
        source_ns=samples[-1].source_ns + 200 * MS,
        receive_ns=samples[-1].receive_ns + SECOND,
    )
    told = ' '.join(bridge.complaints())
    assert '8 identical points' in told
    bridge.process(far)
    told = ' '.join(bridge.complaints())
    assert bridge.counters.gaps == 1 and bridge.longest_gap == pytest.approx(0.2)
    assert 'leaps of more than 0.01 m' in told
    assert 'points per second, expected 1000' in told
    assert 's old on arrival' in told


@settings(max_examples=100, deadline=None)
@given(
    st.lists(
        st.tuples(st.integers(-(2**62), 2**62), st.integers(-1, 5), st.floats(width=32)),
        max_size=50,
    ),
    st.sampled_from(['own', 'ros']),
)
def test_nothing_breaks_the_order_of_stamps(raw, clock):
    bridge = Bridge(source_clock=clock)
    out = run(bridge, [Sample((x, x, x), 3, stamp, status) for stamp, status, x in raw])
    stamps = [stamp for stamp, _ in out]
    assert stamps == sorted(set(stamps))
    assert all(math.isfinite(x) for _, point in out for x in point)
    assert bridge.counters.received == len(raw)


# Rests


def stage_path(places, rest_ms=300, move_ms=100):
    """1 kHz encoder stamps [ms] and positions: rest, straight move, rest, ..."""
    positions = []
    for begin, end in zip(places, [*places[1:], None], strict=True):
        positions += [begin] * rest_ms
        if end is not None:
            s = (np.arange(move_ms) + 1.0) / (move_ms + 1.0)
            positions += [tuple(np.add(begin, f * np.subtract(end, begin))) for f in s]
    return list(enumerate(positions))


PLACES = [(0.0, 0.0), (0.02, 0.0), (0.02, 0.03), (-0.01, 0.01)]


def fill(pairs, interleave):
    path = stage_path(PLACES)
    rotation = Rotation.from_euler('z', 0.4).as_matrix()
    random = np.random.default_rng(1)
    points = [
        (k * MS, tuple(rotation @ np.array([*q, 0.0]) + 1e-6 * random.standard_normal(3)))
        for k, q in path[::10]
    ]
    streams = [('stage', k * MS, q) for k, q in path], [('point', k, p) for k, p in points]
    for kind, stamp, value in interleave(*streams):
        (pairs.add_stage if kind == 'stage' else pairs.add_point)(stamp, value)
    return pairs.pairs()


def test_pairs_do_not_depend_on_how_the_streams_arrive():
    orders = [
        lambda a, b: sorted([*a, *b], key=lambda item: item[1]),
        lambda a, b: [*a, *b],
        lambda a, b: [*b, *a],
        lambda a, b: [*a[:700], *b[:30], *a[700:], *b[30:]],
    ]
    results = [fill(RestPairs(), order) for order in orders]
    for pairs in results:
        assert [p.begin for p in pairs] == [p.begin for p in results[0]]
        assert all(
            np.array_equal(p.tracker, q.tracker) and np.array_equal(p.stage, q.stage)
            for p, q in zip(pairs, results[0], strict=True)
        )
    assert np.allclose([p.stage[:2] for p in results[0]], PLACES, atol=0.0)


def test_unused_parts_and_short_rests():
    rules = RestRules(shortest=0.15, settle=0.05, guard=0.02)
    pairs = RestPairs(rules)
    (first, *_) = fill(pairs, lambda a, b: [*a, *b])
    assert (first.begin, first.end) == (50 * MS, (299 - 20) * MS)
    assert first.count == 23
    short = RestPairs(rules)
    for k in range(140):
        short.add_stage(k * MS, (0.0, 0.0))
        short.add_point(k * MS, (0.0, 0.0, 0.0))
    assert short.pairs() == []


def test_a_rest_without_points_gives_no_pair():
    pairs = RestPairs()
    for k, q in stage_path(PLACES[:2]):
        pairs.add_stage(k * MS, q)
    pairs.add_point(100 * SECOND, (0.0, 0.0, 0.0))
    assert pairs.pairs() == []
    assert pairs.without_points == 1
    pairs.clear()
    assert pairs.without_points == 0


def test_long_rest_is_used_up_to_its_limit_and_memory_is_bounded():
    pairs = RestPairs(RestRules(longest=0.5), capacity=3)
    for k in range(5000):
        pairs.add_stage(k * MS, (0.0, 0.0))
        pairs.add_point(k * MS, (0.0, 0.0, 0.0))
    (only,) = pairs.pairs()
    assert only.end == 480 * MS
    for k in range(5000, 30_000):
        pairs.add_stage(k * MS, (0.01 * (k // 400), 0.0))
        pairs.add_point(k * MS, (0.0, 0.0, 0.0))
    assert len(pairs) == 3


def test_a_stage_whose_clock_begins_anew_and_one_with_other_axes_give_pairs_again():
    pairs = RestPairs()
    for begin in (500 * SECOND, 0):
        # Another publisher's single message, far ahead and with another number of axes.
        pairs.add_stage(begin + 900 * SECOND, (0.0,))
        for k, q in stage_path(PLACES):
            pairs.add_stage(begin + k * MS, q)
            pairs.add_point(begin + k * MS, (0.0, 0.0, 0.0))
        pairs.add_stage(begin + 2000 * MS, (0.0,))
        newest = [pair for pair in pairs.pairs() if begin <= pair.begin < begin + 10 * SECOND]
        assert np.allclose([pair.stage[:2] for pair in newest], PLACES, atol=0.0)


# Registration


def test_joint_states_of_another_machine_leave_the_pairs_alone():
    pairs = RestPairs()
    for k in range(1000):
        pairs.add_stage(k * MS, (1e-3, 2e-3))
        pairs.add_stage(k * MS + 1, (0.0,) * 6)
        pairs.add_point(k * MS, (1e-3, 2e-3, 0.0))
    (pair,) = pairs.pairs()
    assert pair.stage == pytest.approx([1e-3, 2e-3, 0.0])


def test_a_silence_is_told_and_its_end():
    bridge = Bridge()
    bridge.look(0, connected=False)
    bridge.look(20 * SECOND, connected=False)
    assert bridge.complaints() == []
    bridge.look(21 * SECOND, connected=True)
    assert bridge.complaints() == ['no point for 1.0 s: check the tracker and its beam']
    bridge.process(stream(1)[0])
    bridge.look(22 * SECOND, connected=True)
    # A world that waits in lockstep sends nothing.
    bridge.look(22 * SECOND, connected=True)
    assert bridge.complaints() == []


@pytest.mark.parametrize('bad', [{'status': 3}, {'source_ns': 95_990_000_000}])
def test_points_of_which_none_is_good_are_a_silence(bad):
    bridge = Bridge()
    run(bridge, stream(300))
    bridge.look(103 * SECOND, connected=True)
    run(bridge, [s._replace(**bad) for s in stream(100, start_ns=103 * SECOND)])
    bridge.look(104 * SECOND, connected=True)
    told = bridge.complaints()[0]
    assert told == 'no point for 1.0 s (100 were refused): check the tracker and its beam'
