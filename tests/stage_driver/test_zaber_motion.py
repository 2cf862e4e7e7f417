"""The official zaber-motion library as an independent client of the emulator on its terminal."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from stage_core.errors import StageError
from stage_twin.emulators.zaber_pty import ZaberPty

from .zaber_rig import chain


def test_the_official_library_drives_the_emulated_chain(tmp_path):
    # Each exchange lets 20 ms pass: the library's polls, not the wall clock, end the moves.
    with ZaberPty(chain(3000, 5000), exchange_time=0.02) as server:
        session = Path(__file__).with_name('zaber_motion_session.py')
        done = subprocess.run(
            [sys.executable, str(session), server.port],
            env=dict(os.environ, XDG_CACHE_HOME=str(tmp_path)),
            capture_output=True,
            text=True,
        )
    assert done.returncode == 0, done.stderr
    seen = json.loads(done.stdout)
    assert seen['count'] == 2
    assert (seen['homed_before'], seen['homed_after']) == (False, True)
    assert seen['positions'] == [20000, 1500]
    assert seen['busy'] and 'NI' in seen['flags_after_stop']
    assert seen['echo'] == ' '.join(['word'] * 30)
    assert seen['serial'] == 50002 and seen['version'] == '7.38'
    assert seen['rejected'] == 'BADDATA'
    assert seen['disabled'] == 'DriverDisabledException'
    assert seen['renumbered'] == 4


def test_link_follows_the_cable(tmp_path):
    link = tmp_path / 'zaber'
    with ZaberPty(chain(3000, 5000), link=link) as server:
        assert os.path.realpath(link) == server.port
        server.unplug()
        assert not link.exists()
        server.plug()
        assert os.path.realpath(link) == server.port
    assert not link.is_symlink()


def test_link_name_that_is_taken_is_an_error(tmp_path):
    taken = tmp_path / 'file'
    taken.write_text('mine')
    with pytest.raises(StageError, match='cannot make the link'):
        ZaberPty(chain(3000, 5000), link=taken).start()
    assert taken.read_text() == 'mine'
