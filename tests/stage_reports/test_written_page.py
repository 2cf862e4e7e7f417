"""The page that the command writes: what it holds, and how it answers a mouse in a browser."""

from __future__ import annotations

import asyncio
import re
from pathlib import Path
from typing import Any

import matplotlib.image
import numpy as np
import pytest

from session_bags.writer import write_session
from stage_reports.command import main

from ..browser import Tab, browse, needs_chromium, visit
from .reading import Page, words
from .sessions import circle_session, rest_session


@pytest.fixture(scope='module')
def circle_page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The page of a recorded contour."""
    folder = tmp_path_factory.mktemp('circle')
    bag = write_session(folder / 'circle', circle_session())
    assert main(['--bag', str(bag), '--out', str(folder / 'out')]) == 0
    return folder / 'out' / 'report.html'


def test_a_report_of_a_recorded_session(circle_page: Path) -> None:
    html = circle_page.read_text(encoding='utf-8')
    page = Page(html)
    assert 'Circular test (ISO 230-4), encoder' in words(html)
    # The curves of the error over the path, and what reads them; nothing is loaded.
    assert page.scripts == 2 and '<script src' not in html
    assert all(source.startswith('data:image/svg+xml;base64,') for source in page.sources)
    assert all(page.alternatives)
    assert len(list(circle_page.parent.glob('figure_*.png'))) == len(page.sources)
    # A page may be sent to somebody else: it says nothing of the disk it was made on.
    assert str(circle_page.parents[1]) not in html


@needs_chromium
def test_a_browser_without_a_network_draws_the_whole_page(tmp_path: Path) -> None:
    bag = write_session(tmp_path / 'bag', rest_session())
    assert main(['--bag', str(bag), '--out', str(tmp_path)]) == 0
    shot = tmp_path / 'page.png'
    run = browse(
        tmp_path / 'report.html',
        '--host-resolver-rules=MAP * ~NOTFOUND',
        '--enable-logging=stderr',
        '--window-size=1200,1600',
        f'--screenshot={shot}',
    )
    assert ':CONSOLE' not in run.stderr, run.stderr
    pixels = matplotlib.image.imread(shot)[:, :, :3]
    assert pixels.shape[:2] == (1600, 1200)
    # Coloured curves are in pictures only: they were decoded and drawn, down the whole page.
    coloured = pixels.max(axis=2) - pixels.min(axis=2) > 0.2
    assert min(part.mean() for part in np.split(coloured, 2)) > 1e-3


#: Brings the first panel with curves into the window, and says where it is [px].
PANEL = """(() => {
const canvas = document.querySelector('.plot canvas');
const [{places}] = JSON.parse(document.querySelector('script.curves').textContent);
const [l, t, w, h] = places[0].box;
scrollBy(0, canvas.getBoundingClientRect().top + t * canvas.clientHeight - 100);
const box = canvas.getBoundingClientRect();
return [box.left + l * box.width, box.top + t * box.height, w * box.width, h * box.height];
})()"""
SAID = 'document.querySelector("output").innerText'
#: How many pixels of the canvas are inked: the zoomed curve, its axes and the page behind them.
INKED = """(() => {
const {width, height} = document.querySelector('.plot canvas');
const pen = document.querySelector('.plot canvas').getContext('2d');
return new Uint32Array(pen.getImageData(0, 0, width, height).data.buffer).filter(v => v).length;
})()"""


async def read_and_zoom(tab: Tab) -> dict[str, Any]:
    """What a person sees who points at a curve, drags over a stretch and double-clicks."""
    # The tab is blank at first.
    ready = 'document.readyState === "complete" && !!document.querySelector(".plot canvas")'
    while not await tab.evaluate(ready):
        await asyncio.sleep(0.1)
    left, top, width, height = await tab.evaluate(PANEL)

    async def mouse(kind: str, share: float, **more: int) -> None:
        await tab.mouse(kind, left + share * width, top + 0.5 * height, **more)

    async def read(share: float) -> str:
        await mouse('mouseMoved', share)
        return str(await tab.evaluate(SAID))

    async def limits() -> list[str]:
        return [await read(0.002), await read(0.998)]

    found: dict[str, Any] = {'hint': await tab.evaluate(SAID), 'middle': await read(0.5)}
    found['whole'], found['ink'] = await limits(), [await tab.evaluate(INKED)]
    await mouse('mouseMoved', 0.25)
    await mouse('mousePressed', 0.25, clickCount=1, buttons=1)
    await mouse('mouseMoved', 0.5, buttons=1)
    await mouse('mouseReleased', 0.5, clickCount=1)
    found['zoomed'] = await limits()
    found['ink'].append(await tab.evaluate(INKED))
    for count in (1, 2):
        await mouse('mousePressed', 0.5, clickCount=count, buttons=1)
        await mouse('mouseReleased', 0.5, clickCount=count)
    found['again'] = await limits()
    await tab.mouse('mouseMoved', 1.0, 1.0)
    found['left'] = await tab.evaluate(SAID)
    return found


@needs_chromium
def test_a_mouse_reads_the_error_of_a_contour_and_zooms(circle_page: Path, tmp_path: Path) -> None:
    found = visit(
        tmp_path / 'profile', circle_page.as_uri(), read_and_zoom, '--window-size=1200,900'
    )
    assert found['hint'] == found['left'] and found['hint'].startswith('Point at a curve')
    # The error of the session is 2 µm everywhere.
    assert re.fullmatch(r'contour error \(µm\) at \d+: run 1 2\s*', found['middle'])
    low, high, *zoomed = (
        float(re.findall(r' at (\S+):', text.replace('\u2212', '-'))[0])
        for text in (*found['whole'], *found['zoomed'])
    )
    # From a quarter to the half of the axis. Measured: 0.2 less, and a pixel is 0.4.
    assert zoomed == pytest.approx([low + s * (high - low) for s in (0.25, 0.5)], abs=1.0)
    assert found['again'] == found['whole']
    # Before, a line at the pointer (640 px); then the zoomed curve over the picture (395,241 px).
    assert found['ink'][1] > 100 * found['ink'][0] > 0
