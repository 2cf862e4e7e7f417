"""The log names a tracker that does not answer, and not one that starts with the bridge."""

from __future__ import annotations

from tracker_bridge.complaints import AGAIN, PASSING, STARTING, Complaints

MISSING = 'no tracker at 127.0.0.1:700: check the cable'


def test_a_tracker_that_starts_with_the_bridge_is_no_trouble() -> None:
    complaints = Complaints(0.0)
    said = [complaints.due(MISSING if t < 7 else '', t >= 7, float(t)) for t in range(12)]
    assert said == [''] * 12


def test_a_tracker_that_stays_away_is_named_again_and_again_until_it_comes() -> None:
    complaints = Complaints(0.0)
    said = [complaints.due(MISSING, False, t) for t in (1.0, STARTING, STARTING + 1.0)]
    assert said == ['', MISSING, '']
    assert complaints.due(MISSING, False, STARTING + AGAIN) == MISSING
    assert complaints.due('', True, STARTING + AGAIN + 1.0) == 'the tracker is connected now'
    assert complaints.due('', True, STARTING + AGAIN + 2.0) == ''


def test_a_beam_that_comes_back_at_once_is_no_trouble() -> None:
    complaints, begin = Complaints(0.0), 2.0 * STARTING
    assert complaints.due('', True, begin) == ''
    assert complaints.due('beam lost', False, begin + 0.5 * PASSING) == ''
    assert complaints.due('beam lost', False, begin + PASSING) == 'beam lost'
