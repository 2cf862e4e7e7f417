"""The pure Zaber ASCII codec: vectors of the protocol, properties, fuzz."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stage_driver.protocol import (
    Alert,
    Assembler,
    Info,
    LineSplitter,
    ProtocolError,
    Reply,
    checksum,
    decode_answer,
    encode_command,
    warning_list,
)
from stage_driver.zaber_words import FLAGS, REJECTIONS, describe_flag, describe_rejection


def sealed(body: bytes) -> bytes:
    return body + b':%02X\r\n' % checksum(body[1:])


@pytest.mark.parametrize(
    ('command', 'expected'),
    [
        (('get pos', 1, 0, 0), b'/1 0 00 get pos:2D\n'),
        (('', 0, 0, 0), b'/0 0 00:00\n'),
        (('get pos', 1, 0, 5), b'/1 0 05 get pos:28\n'),
        (('home', 1, 1, 0), b'/1 1 00 home:35\n'),
        (('set comm.alert 1', 0, 0, None), b'/0 0 set comm.alert 1:B1\n'),
        (('foo bar', 1, 0, 2), b'/1 0 02 foo bar:44\n'),
    ],
)
def test_command_vectors(command, expected):
    assert encode_command(*command) == expected


def test_reply_vector():
    assert decode_answer(b'@01 0 OK IDLE -- 0:8D\r\n') == Reply(1, 0, None, True, False, '--', '0')


@pytest.mark.parametrize(
    ('line', 'expected'),
    [
        (b'@01 1 OK BUSY WR 0', Reply(1, 1, None, True, True, 'WR', '0')),
        (b'@1 0 07 RJ IDLE -- BADDATA', Reply(1, 0, 7, False, False, '--', 'BADDATA')),
        (b'@02 0 99 OK IDLE NI 03 FS WR NI', Reply(2, 0, 99, True, False, 'NI', '03 FS WR NI')),
        (b'!01 1 IDLE --', Alert(1, 1, '')),
        (b'!01 1 IDLE FS limit', Alert(1, 1, 'limit')),
        (b'#02 1 10 cont more of it\\', Info(2, 1, 10, 'more of it', True, True)),
        (b'#02 0 hello', Info(2, 0, None, 'hello')),
    ],
)
def test_answers_with_and_without_checksum(line, expected):
    assert decode_answer(line) == expected
    assert decode_answer(sealed(line)) == expected


@given(st.integers(0, 30), st.integers(1, 255))
@settings(max_examples=200, deadline=None)
def test_one_changed_byte_is_never_taken_for_the_sealed_reply(position, change):
    line = bytearray(sealed(b'@01 1 07 OK BUSY WR 123456')[:-2])
    position %= len(line)
    true = decode_answer(bytes(line))
    line[position] ^= change
    try:
        changed = decode_answer(bytes(line))
    except ProtocolError:
        return
    # Only the checksum digits' case and the lost colon's data text leave a readable line.
    assert changed == true or b':' not in line or line[0] != ord('@')


def test_splitter_takes_any_line_end_and_drops_endless_lines():
    splitter = LineSplitter()
    assert splitter.feed(b'a\r') == [b'a']
    assert splitter.feed(b'\nb\n\nc') == [b'b']
    assert splitter.feed(b'd\r\n') == [b'cd']
    for _ in range(10):
        assert splitter.feed(b'x' * 400) == []
    assert splitter.feed(b'tail\r\ngood\n') == [b'good']


def test_continuations_of_two_devices_and_an_alert_interleave():
    assembler = Assembler()
    lines = [
        b'@01 0 10 OK IDLE -- first\\',
        b'@02 0 10 OK IDLE -- other\\',
        b'!01 1 IDLE --',
        b'#01 0 10 cont second\\',
        b'#02 0 10 cont end',
        b'#01 0 10 cont third',
    ]
    whole = [message for line in lines if (message := assembler.add(decode_answer(line)))]
    assert [message.data for message in whole] == ['', 'other end', 'first second third']


def test_continuation_without_beginning_is_an_error():
    with pytest.raises(ProtocolError, match='without a beginning'):
        Assembler().add(decode_answer(b'#01 0 10 cont lost'))


@pytest.mark.parametrize('words', ['get/pos', 'a:b', 'a\nb', 'caf\u00e9', 'nul\x00', 'x' * 90])
def test_commands_that_cannot_be_sent_are_refused(words):
    with pytest.raises(ProtocolError):
        encode_command(words, 1)


@pytest.mark.parametrize('address', [(100, 0, None), (1, 10, None), (1, 0, 100), (-1, 0, None)])
def test_addresses_out_of_range_are_refused(address):
    with pytest.raises(ProtocolError):
        encode_command('home', *address)


def test_warning_lists():
    assert warning_list('00') == ()
    assert warning_list('02 FS WR') == ('FS', 'WR')
    for wrong in ('', '01', '02 FS', 'x FS', '01 fs'):
        with pytest.raises(ProtocolError):
            warning_list(wrong)


def test_every_flag_and_rejection_has_plain_words():
    for code in FLAGS:
        assert FLAGS[code].severity in ('fault', 'warning', 'note')
        assert code in describe_flag(code) and len(describe_flag(code)) > 20
    for reason in REJECTIONS:
        assert 'unknown reason' not in describe_rejection(reason)
    assert 'unknown' in describe_flag('QQ') and 'unknown' in describe_rejection('WHAT')
