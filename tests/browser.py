"""A page as a browser without a window draws it."""

from __future__ import annotations

import asyncio
import json
import shutil
import subprocess
from collections.abc import Awaitable, Callable
from html import unescape
from pathlib import Path
from typing import Any

import pytest

from .patience import wait

CHROMIUM = next(filter(None, map(shutil.which, ('chromium', 'google-chrome', 'chrome'))), None)
needs_chromium = pytest.mark.skipif(CHROMIUM is None, reason='no Chromium on PATH')


def command(profile: Path, *words: str) -> list[str]:
    """Command line of the browser, its profile in a folder of its own."""
    options = ['--headless=new', '--no-sandbox', '--disable-gpu', '--hide-scrollbars']
    return [str(CHROMIUM), *options, f'--user-data-dir={profile}', *words]


def browse(page: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """Show a page with some options."""
    return subprocess.run(
        command(page.parent / 'profile', *words, page.as_uri()),
        check=True, timeout=120, capture_output=True, text=True,
    )  # fmt: skip


def told(page: Path, *words: str) -> Any:
    """What a script of a page has put into its title, as JSON."""
    text = browse(page, '--dump-dom', *words).stdout
    return json.loads(unescape(text.split('title>')[1].removesuffix('</')))


class Tab:
    """An open page, driven by the browser's DevTools protocol as a person drives it."""

    def __init__(self, wire: Any) -> None:
        self._wire = wire

    async def call(self, method: str, **parameters: Any) -> Any:
        """Result of a command of the protocol."""
        await self._wire.write_message(
            json.dumps({'id': 1, 'method': method, 'params': parameters})
        )
        while (message := json.loads(await self._wire.read_message())).get('id') != 1:
            pass
        return message['result']

    async def evaluate(self, expression: str) -> Any:
        """Value of an expression in the page."""
        found = await self.call('Runtime.evaluate', expression=expression, returnByValue=True)
        assert 'exceptionDetails' not in found, found
        return found['result'].get('value')

    async def mouse(self, kind: str, x: float, y: float, **more: Any) -> None:
        """`mouseMoved`, `mousePressed` or `mouseReleased` at a place of the window [px]."""
        button = 'none' if kind == 'mouseMoved' else 'left'
        place = {'type': kind, 'x': x, 'y': y, 'button': button}
        await self.call('Input.dispatchMouseEvent', **place, **more)


def visit(profile: Path, address: str, act: Callable[[Tab], Awaitable[Any]], *words: str) -> Any:
    """What `act` finds in a page, in a browser that ends afterwards."""
    pytest.importorskip('tornado', reason='comes with Dask, an optional extra')
    browser = subprocess.Popen(
        command(profile, '--remote-debugging-port=0', *words, address),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    try:
        # The browser writes the port that it took into its profile.
        place = profile / 'DevToolsActivePort'
        wait(lambda: place.exists() and '\n' in place.read_text(), 'the port of the browser')
        port = int(place.read_text().split()[0])
        return asyncio.run(asyncio.wait_for(_visited(port, act), 60.0))
    finally:
        browser.terminate()
        browser.wait(timeout=30.0)


async def _visited(port: int, act: Callable[[Tab], Awaitable[Any]]) -> Any:
    from tornado.httpclient import AsyncHTTPClient
    from tornado.websocket import websocket_connect

    listed = await AsyncHTTPClient().fetch(f'http://127.0.0.1:{port}/json')
    target = next(t for t in json.loads(listed.body) if t['type'] == 'page')
    wire = await websocket_connect(target['webSocketDebuggerUrl'])
    try:
        return await act(Tab(wire))
    finally:
        wire.close()
