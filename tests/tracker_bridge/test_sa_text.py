"""SpatialAnalyzer text against hand-written lines and a formatter written separately."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tracker_bridge.sa_text import (
    SaFormat,
    SaTextDecoder,
    SaTextError,
    format_script_line,
    parse_script_line,
    parse_watch_window,
)

SEEN = '... | X,    3744.50, | Y,    1309.42, | Z,      54.65, | ... Units: (mm) ...'


def test_the_form_seen_in_public():
    point, unit = parse_watch_window(SEEN, SaFormat(unit=''))
    assert point == pytest.approx((3.7445, 1.30942, 0.05465), abs=1e-12)
    assert unit == 'mm'


def test_labels_match_exactly_in_any_order():
    text = 'Rx, 1.0, | dX, 5.0, | Z, 3, | Mag, 9, | XX, 7, | Y, -2e0, | X, 1,| Units: (Inches)'
    point, _ = parse_watch_window(text, SaFormat())
    assert point == pytest.approx((0.0254, -0.0508, 0.0762))


def test_decimal_comma_and_other_labels():
    form = SaFormat(labels=('Px', 'Py', 'Pz'), decimal_comma=True, unit='m')
    point, _ = parse_watch_window('Px, 1,25, | Py, -0,5, | Pz,3,', form)
    assert point == (1.25, -0.5, 3.0)


@pytest.mark.parametrize(
    ('text', 'comma', 'reason'),
    [
        ('X, 1, | Y, 2,', False, 'no Z'),
        ('X, 1, | X, 2, | Y, 2, | Z, 3,', False, 'twice'),
        ('X, 1,5, | Y, 2, | Z, 3,', False, 'decimal_comma'),
        ('X, 1.000,5, | Y, 2, | Z, 3,', True, 'locale'),
        ('X, nan, | Y, 2, | Z, 3,', False, 'no number'),
        ('X, inf, | Y, 2, | Z, 3,', False, 'no number'),
        ('X, 1e999, | Y, 2, | Z, 3,', False, 'too large'),
        ('X, ٣, | Y, 2, | Z, 3,', False, 'no number'),
        ('X, 1, | Y, 2, | Z, 3, | Units: (furlong)', False, 'not known'),
    ],
)
def test_what_cannot_be_read_is_refused_with_the_reason(text, comma, reason):
    with pytest.raises(SaTextError, match=reason):
        parse_watch_window(text, SaFormat(decimal_comma=comma))


def test_a_datagram_without_unit_needs_the_parameter():
    with pytest.raises(SaTextError, match='unit'):
        parse_watch_window('X, 1, | Y, 2, | Z, 3,', SaFormat(unit=''))


def test_unit_change_is_refused_until_reset():
    decoder = SaTextDecoder()
    decoder.decode(b'X, 1, | Y, 2, | Z, 3, | Units: (mm)', 0)
    with pytest.raises(SaTextError, match='from mm to in'):
        decoder.decode(b'X, 1, | Y, 2, | Z, 3, | Units: (in)', 1)


def test_quantum():
    decoder = SaTextDecoder()
    for index, x in enumerate(('1.00', '1.00', '1.00', '1.03', '1.02', '1.06')):
        decoder.decode(f'X, {x}, | Y, 2.00, | Z, 3.00,'.encode(), index)
    assert decoder.quantum == pytest.approx(1e-5)
    assert math.isinf(SaTextDecoder().quantum)


def test_latin_1_is_read():
    decoder = SaTextDecoder()
    datagram = 'Größe | X, 1, | Y, 2, | Z, 3, | Units: (µm)'.encode('latin-1')
    assert decoder.decode(datagram, 5).point == pytest.approx((1e-6, 2e-6, 3e-6))


finite = st.floats(-1e5, 1e5).map(lambda v: round(v, 4))


@settings(max_examples=100, deadline=None)
@given(st.tuples(finite, finite, finite), st.permutations(['X', 'Y', 'Z']), st.booleans())
def test_round_trip(values, order, comma):
    named = dict(zip('XYZ', values, strict=True))
    text = ' | '.join(f'{label}, {named[label]:12.4f},' for label in order)
    if comma:
        text = text.replace('.', ',')
    point, _ = parse_watch_window(text, SaFormat(decimal_comma=comma, unit='mm'))
    assert point == pytest.approx(tuple(v * 1e-3 for v in values), abs=1e-12)


@settings(max_examples=60, deadline=None)
@given(st.tuples(finite, finite, finite), st.integers(0, 10**9), st.integers(0, 10**15))
def test_script_line_round_trip(values, sequence, time_ns):
    point = tuple(v * 1e-4 for v in values)
    sample, _ = parse_script_line(
        format_script_line(sequence, time_ns, point, 'mm', 2).decode(), 7
    )
    assert sample.point == pytest.approx(point, abs=1e-9)
    assert abs(sample.source_ns - time_ns) <= 200
    assert (sample.status, sample.receive_ns) == (2, 7)


def test_a_datagram_of_any_size_is_bounded():
    with pytest.raises(SaTextError, match='bytes'):
        SaTextDecoder().decode(b'X' * 70000, 0)
