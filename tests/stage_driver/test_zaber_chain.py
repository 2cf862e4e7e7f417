"""The emulated Zaber chain as a pure object: lines in, lines out, time given by the test."""

import pytest

from stage_core.errors import StageError
from stage_driver.protocol import Assembler, Info, LineSplitter, checksum, decode_answer
from stage_twin.emulators.zaber_faults import KINDS

from . import zaber_rig


@pytest.fixture
def chain():
    return zaber_rig.chain(1000, 2000)


def ask(chain, command, time=0.0):
    """Answer lines without their ends."""
    return chain.feed(command.encode() + b'\n', time).decode().splitlines()


def home(chain, time=0.0):
    ask(chain, '/home', time)
    chain.poll(time + 30.0)
    return time + 30.0


def test_broadcast_is_answered_by_every_device_in_cable_order(chain):
    assert ask(chain, '/') == ['@01 0 OK IDLE WR 0', '@02 0 OK IDLE WR 0']
    assert ask(chain, '/2 get pos') == ['@02 0 OK IDLE WR 0']
    assert ask(chain, '/7 get pos') == []


def test_ids_come_back_and_two_dashes_silence(chain):
    assert ask(chain, '/1 1 07 get pos') == ['@01 1 07 OK IDLE WR 0']
    assert ask(chain, '/1 1 7 get pos') == ['@01 1 07 OK IDLE WR 0']
    assert ask(chain, '/1 1 -- get pos') == []
    assert ask(chain, '/1 1 100 get pos') == ['@01 1 RJ IDLE WR BADMESSAGEID']


def test_checksums_are_verified_and_sent_when_switched_on(chain):
    assert ask(chain, '/1 0 05 get pos:28') == ['@01 0 05 OK IDLE WR 0']
    assert ask(chain, '/1 0 05 get pos:29') == []
    ask(chain, '/set comm.checksum 1')
    line = chain.feed(b'/1 0 get comm.address\n', 0.0)
    assert line.startswith(b'@01 0 OK IDLE WR 1:')
    assert decode_answer(line).data == '1'


def test_home_gives_the_reference_and_moves_take_their_trapezoid_time(chain):
    assert ask(chain, '/1 1 home') == ['@01 1 OK BUSY WR 0']
    chain.poll(30.0)
    time = home(chain, 30.0)
    assert ask(chain, '/', time) == ['@01 0 OK IDLE -- 0', '@02 0 OK IDLE -- 0']
    # 20000 steps at 10000 steps/s and 20000 steps/s^2: 0.5 s up, 1.5 s even, 0.5 s down.
    speed, acceleration = 16384, round(20000 * 1.6384 / 10000 * 1000) / 1000
    ask(chain, f'/1 1 move abs 20000 {speed} {acceleration}', time)
    halfway = ask(chain, '/1 1 get pos', time + 1.25)[0].split()
    assert halfway[3] == 'BUSY' and int(halfway[5]) == pytest.approx(10000, abs=20)
    assert ask(chain, '/1 1', time + 2.45)[0].split()[3] == 'BUSY'
    assert ask(chain, '/1 1 get pos', time + 2.55) == ['@01 1 OK IDLE -- 20000']
    assert ask(chain, '/2 1 get pos', time + 2.55) == ['@02 1 OK IDLE -- 0']


def test_interrupted_moves_note_it_until_the_next_move_from_rest(chain):
    time = home(chain)
    ask(chain, '/1 1 move abs 100000', time)
    assert ask(chain, '/1 1 stop', time + 0.1) == ['@01 1 OK BUSY NI 0']
    assert ask(chain, '/1 1 warnings', time + 20) == ['@01 1 OK IDLE NI 01 NI']
    assert ask(chain, '/1 1 move rel 10', time + 20) == ['@01 1 OK BUSY -- 0']


@pytest.mark.parametrize(
    ('command', 'reason'),
    [
        ('/1 1 move abs 99999999', 'BADDATA'),
        ('/1 1 move abs -1', 'BADDATA'),
        ('/1 1 move abs x', 'BADDATA'),
        ('/1 1 move abs 10 0', 'BADDATA'),
        ('/1 1 move', 'BADCOMMAND'),
        ('/1 1 dance', 'BADCOMMAND'),
        ('/1 1 get nothing', 'BADCOMMAND'),
        ('/1 1 get system.serial', 'DEVICEONLY'),
        ('/1 1 set resolution 5', 'NOACCESS'),
        ('/1 0 set comm.checksum 2', 'BADDATA'),
        ('/1 0 set system.serial 2', 'NOACCESS'),
        ('/1 0 storage get zaber.label', 'BADDATA'),
        ('/1 2 get pos', 'BADAXIS'),
        ('/1 1 system reset', 'DEVICEONLY'),
    ],
)
def test_rejections(chain, command, reason):
    assert ask(chain, command)[0].split()[-4:] == ['RJ', 'IDLE', 'WR', reason]


def test_velocity_move_ends_at_the_limit(chain):
    time = home(chain)
    ask(chain, '/1 1 move vel 150000', time)
    assert ask(chain, '/1 1 get pos', time + 60) == ['@01 1 OK IDLE -- 3149606']


def test_alerts_come_at_the_end_of_moves_only(chain):
    time = home(chain)
    ask(chain, '/set comm.alert 1', time)
    ask(chain, '/2 1 move rel 1000', time)
    assert chain.poll(time + 0.001) == b''
    assert chain.poll(time + 10) == b'!02 1 IDLE --\r\n'
    assert chain.poll(time + 11) == b''


def test_long_messages_are_continued_both_ways(chain):
    # As seen on the wire.
    names = [f'w{n:02d}' for n in range(16)]
    command = b'/1 0 10 tools echo w00 w01 w02 w03 w04 w05 w06 w07 w08 w09 w10 w11 w12 w13\\:D9\n'
    rest = b'1 0 10 cont 1 w14 w15'
    received = chain.feed(command + b'/%b:%02X\n' % (rest, checksum(rest)), 0.0)
    lines = LineSplitter().feed(received)
    assert len(lines) > 1 and all(len(line) + 2 <= 80 for line in lines)
    assembler = Assembler()
    whole = [m for line in lines if (m := assembler.add(decode_answer(line)))]
    assert whole[0].data == ' '.join(names)
    assert isinstance(decode_answer(lines[1]), Info)


def test_renumbering_follows_the_cable(chain):
    assert ask(chain, '/renumber 5') == ['@05 0 OK IDLE WR 0', '@06 0 OK IDLE WR 0']
    assert ask(chain, '/6 renumber 9') == ['@09 0 OK IDLE WR 0']
    assert ask(chain, '/5 get comm.address') == ['@05 0 OK IDLE WR 5']
    assert ask(chain, '/renumber 0') == []


def test_warnings_are_listed_by_priority_and_cleared_where_that_is_possible(chain):
    chain.axes[0].raise_flag('FS')
    chain.axes[0].raise_flag('WV')
    assert ask(chain, '/1 1') == ['@01 1 OK IDLE FS 0']
    assert ask(chain, '/1 1 warnings clear') == ['@01 1 OK IDLE WR 03 FS WR WV']
    assert ask(chain, '/1 1 warnings') == ['@01 1 OK IDLE WR 02 WR WV']


def test_disabled_driver_refuses_moves(chain):
    ask(chain, '/1 1 driver disable')
    assert ask(chain, '/1 1 home') == ['@01 1 RJ IDLE FO DRIVERDISABLED']
    ask(chain, '/1 1 driver enable')
    assert ask(chain, '/1 1 home')[0].startswith('@01 1 OK BUSY')


def test_stall_slip_knob_and_power(chain):
    time = home(chain)
    chain.axes[0].stall_at = 5000
    ask(chain, '/1 1 move abs 100000', time)
    for step in range(200):
        chain.poll(time + step * 0.01)
    flags = ask(chain, '/1 1 warnings', time + 5)[0]
    assert ' FS' in flags and 'IDLE' in flags
    chain.axes[0].slip = 7
    position, encoder = (
        int(ask(chain, f'/1 1 get {name}', time + 5)[0].split()[-1])
        for name in ('pos', 'encoder.pos')
    )
    assert 5000 <= position < 20000 and encoder == position + 7
    chain.axes[1].turn_knob(500)
    assert ask(chain, '/2 1 get pos', time + 10) == ['@02 1 OK IDLE NC 500']
    # A hand that turns back to the home sensor does not home the axis.
    ask(chain, '/2 1 set pos 0', time + 10)
    chain.axes[1].turn_knob(-500)
    assert ask(chain, '/2 1 get pos', time + 20) == ['@02 1 OK IDLE NC -500']
    chain.power_cycle()
    assert ask(chain, '/2 1 get pos', time + 10) == ['@02 1 OK IDLE WR 0']


def test_editing_characters_and_unprintables(chain):
    assert chain.feed(b'/1 get poz\x08s\r', 0.0) == b'@01 0 OK IDLE WR 0\r\n'
    assert chain.feed(b'/1 home\x7f/1\n', 0.0) == b'@01 0 OK IDLE WR 0\r\n'
    assert chain.feed(b'/1 get\x01 pos\n', 0.0) == b''


@pytest.mark.parametrize('kind', KINDS)
def test_every_line_fault_changes_exactly_the_next_reply(chain, kind):
    clean = chain.feed(b'/1 0 03 get pos\n', 0.0)
    chain.faults.inject(kind)
    broken = chain.feed(b'/1 0 03 get pos\n', 0.1)
    assert broken != clean
    assert chain.feed(b'/1 0 03 get pos\n', 0.2) == clean
    late = chain.poll(1.0)
    assert late == (clean if kind == 'delay' else b'')


def test_unknown_line_fault_is_an_error(chain):
    with pytest.raises(StageError, match='no line fault'):
        chain.faults.inject('gremlin')
