"""The live page over http, in a real browser where there is one."""

from __future__ import annotations

import asyncio
import json
import urllib.error
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from stage_bringup.live_page import LivePage
from stage_core.errors import StageError

from ..browser import Tab, needs_chromium, visit

STATE: dict[str, Any] = {
    'axes': ['x', 'y'],
    'position': [0.0123456, -0.002],
    'error': [1.5e-6, -2.5e-6],
    'tracker': None,
    'contour': None,
    'driver': 'moving',
    'states': [
        {'name': 'tracker_bridge: connection', 'level': 2, 'text': 'beam <b>lost</b>'},
        {'name': 'stage_driver: state', 'level': 0, 'text': 'moving'},
    ],
}


class Stage:
    """What the page asks: a state, and a stop that is counted."""

    def __init__(self) -> None:
        self.stops = 0
        self.page = LivePage('127.0.0.1', 0, lambda: STATE, self.stop)
        self.address = f'http://127.0.0.1:{self.page.port}'

    def stop(self) -> str:
        self.stops += 1
        return 'The driver answers: at rest'


@pytest.fixture
def stage() -> Iterator[Stage]:
    found = Stage()
    yield found
    found.page.close()


def post(address: str, **headers: str) -> str:
    request = urllib.request.Request(f'{address}/stop', method='POST', headers=headers)
    with urllib.request.urlopen(request) as answer:
        return answer.read().decode()


def test_the_stream_carries_the_state(stage: Stage) -> None:
    with urllib.request.urlopen(f'{stage.address}/events') as stream:
        assert stream.headers['Content-Type'] == 'text/event-stream'
        for _ in range(3):
            line = stream.readline().decode()
            assert json.loads(line.removeprefix('data: ')) == STATE
            assert stream.readline() == b'\n'


def test_only_its_own_page_may_stop_the_stage(stage: Stage) -> None:
    assert post(stage.address) == 'The driver answers: at rest'
    assert post(stage.address, Origin=stage.address) == 'The driver answers: at rest'
    assert stage.stops == 2
    for origin in ('http://elsewhere.example', 'null', stage.address + '0'):
        with pytest.raises(urllib.error.HTTPError, match='403'):
            post(stage.address, Origin=origin)
    with pytest.raises(urllib.error.HTTPError, match='404'):
        urllib.request.urlopen(f'{stage.address}/live_page.html')
    assert stage.stops == 2


def test_a_port_that_is_taken_is_one_line(stage: Stage) -> None:
    with pytest.raises(StageError, match='page_port'):
        LivePage('127.0.0.1', stage.page.port, dict, str)


async def in_the_browser(tab: Tab) -> dict[str, Any]:
    """Text of the page after some states, then after a click on stop."""
    while not await tab.evaluate('document.querySelectorAll("#numbers dd").length'):
        await asyncio.sleep(0.1)
    found = {
        'text': await tab.evaluate('document.body.innerText'),
        'markup': await tab.evaluate('document.querySelectorAll("#states b").length'),
        'inked': await tab.evaluate(
            'new Uint32Array(el("map").getContext("2d").getImageData(0, 0, 200, 200).data.buffer)'
            '.some(v => v)'
        ),
    }
    await tab.evaluate('el("stop").click()')
    while 'at rest' not in (answer := await tab.evaluate('el("answer").textContent')):
        await asyncio.sleep(0.1)
    found['answer'] = answer
    return found


@needs_chromium
def test_a_browser_shows_the_state_and_stops_the_stage(stage: Stage, tmp_path: Path) -> None:
    found = visit(tmp_path / 'profile', stage.address, in_the_browser)
    for part in ('12.3456 mm', '−2.0000 mm', '1.5 µm', 'moving', 'fault', 'beam <b>lost</b>'):
        assert part in found['text']
    # What a node says is text and never markup.
    assert found['markup'] == 0
    assert found['inked']
    assert found['answer'] == 'The driver answers: at rest'
    assert stage.stops == 1
