"""Draws the pages of the newest session of bags/, its live view and Rerun: ``make screenshots``.

Needs Chromium. The live view shows the session's contour, which the player replays; the viewer of
Rerun, where rerun-sdk is installed, shows its bag.
"""

from __future__ import annotations

import asyncio
import base64
import contextlib
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from tornado.httpclient import AsyncHTTPClient
from tornado.websocket import websocket_connect

from stage_bringup import rerun_view

ROOT = Path(__file__).resolve().parents[1]
IMAGES = ROOT / 'docs' / 'images'
PORT = 18766
#: States of the live page with an error, at 10 Hz: its curves then fill half of their width.
STATES = 100
#: A canvas does not say that it is drawn: it is, once pictures this far apart [s] are equal. The
#: viewer of Rerun changes at least every 2 s while it loads.
STILL = 5.0
#: WebGL without a graphics card, and nothing from outside of this machine.
CHROMIUM = (
    '--use-angle=swiftshader',
    '--enable-unsafe-swiftshader',
    '--host-resolver-rules=MAP * ~NOTFOUND , EXCLUDE 127.0.0.1',
)
NODE = 'import sys; from {module} import main; sys.exit(main())'


@contextlib.contextmanager
def running(command: list[str], **more: Any) -> Iterator[subprocess.Popen[bytes]]:
    """A process that ends with the block, as does what it has started."""
    process = subprocess.Popen(
        command,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.STDOUT,
        start_new_session=True,
        **more,
    )
    try:
        yield process
    finally:
        os.killpg(process.pid, signal.SIGTERM)
        process.wait()


def node(module: str, **parameters: Any) -> contextlib.AbstractContextManager[Any]:
    """A node of the workspace on a graph of its own."""
    words = [word for name, value in parameters.items() for word in ('-p', f'{name}:={value}')]
    command = [sys.executable, '-c', NODE.format(module=module), '--ros-args', *words]
    alone = {'ROS_DOMAIN_ID': '93', 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}
    return running(command, env={**os.environ, **alone})


async def picture(port: int, address: str, ready: str, height: int, still: float) -> bytes:
    """WebP of a page once `ready` is true there and nothing has changed for `still` seconds."""
    listed = await AsyncHTTPClient().fetch(f'http://127.0.0.1:{port}/json')
    target = next(t for t in json.loads(listed.body) if t['type'] == 'page')
    wire = await websocket_connect(target['webSocketDebuggerUrl'], max_message_size=1 << 26)

    async def call(method: str, **parameters: Any) -> Any:
        await wire.write_message(json.dumps({'id': 1, 'method': method, 'params': parameters}))
        while (message := json.loads(str(await wire.read_message()))).get('id') != 1:
            pass
        return message.get('result', {})

    size = {'width': 1200, 'height': height, 'deviceScaleFactor': 1, 'mobile': False}
    await call('Emulation.setDeviceMetricsOverride', **size)
    value: Any = None
    while not value:
        # An address that does not answer yet is asked again.
        if (await call('Runtime.evaluate', expression='location.protocol'))['result'].get(
            'value'
        ) not in ('http:', 'file:'):
            await call('Page.navigate', url=address)
        await asyncio.sleep(0.2)
        value = (await call('Runtime.evaluate', expression=ready))['result'].get('value')
    shot = before = None
    while shot is None or (still and shot != before):
        before = shot
        await asyncio.sleep(still)
        shot = (await call('Page.captureScreenshot', format='webp', quality=70))['data']
    wire.close()
    return base64.b64decode(shot)


def draw(name: str, address: str, ready: str, height: int, still: float = 0.0) -> None:
    """Save one page as docs/images/NAME.webp."""
    browser = shutil.which('chromium') or shutil.which('google-chrome')
    if browser is None:
        raise SystemExit('error: no Chromium on PATH: install it to draw the pages')
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        options = ['--headless=new', '--no-sandbox', '--hide-scrollbars', *CHROMIUM]
        options += ['--remote-debugging-port=0', f'--user-data-dir={profile}', 'about:blank']
        with running([browser, *options]) as process:
            place = Path(profile) / 'DevToolsActivePort'
            while not place.exists() or '\n' not in place.read_text():
                if process.poll() is not None:
                    raise SystemExit(f'error: {browser} ended with status {process.returncode}')
            port = int(place.read_text().split()[0])
            data = asyncio.run(picture(port, address, ready, height, still))
    (IMAGES / f'{name}.webp').write_bytes(data)
    print(f'docs/images/{name}.webp: {len(data) / 1024:.0f} KiB', flush=True)


def draw_rerun(bag: Path) -> None:
    """Save the viewer of Rerun with a bag as docs/images/rerun.webp."""
    viewer = Path(sys.executable).with_name('rerun')
    if not viewer.exists():
        print(f'docs/images/rerun.webp stays as it is: pip install {rerun_view.PINNED}')
        return
    ports = ['--port', str(PORT + 1), '--web-viewer-port', str(PORT + 2)]
    serve = ['--serve-web', '--bind', '127.0.0.1', '--renderer', 'webgl', *ports]
    source = f'rerun%2Bhttp://127.0.0.1:{PORT + 1}/proxy'
    address = f'http://127.0.0.1:{PORT + 2}/?url={source}&renderer=webgl&theme=light'
    drawn = '!!document.querySelector("canvas")?.width'
    with tempfile.TemporaryDirectory() as scratch:
        recording = str(Path(scratch) / 'session.rrd')
        rerun_view.main(['--bag', str(bag), '--out', recording])
        with running([str(viewer), recording, *serve]):
            draw('rerun', address, drawn, 900, STILL)


def main() -> None:
    """Draw all pages of the newest session, or of the one that is named."""
    sessions = sorted((ROOT / 'bags').glob('*/session.json'), key=lambda p: p.stat().st_mtime)
    if len(sys.argv) < 2 and not sessions:
        raise SystemExit('error: bags/ holds no session: run make session first')
    folder = Path(sys.argv[1]).resolve() if len(sys.argv) > 1 else sessions[-1].parent
    loaded = 'document.readyState === "complete"'
    draw('session_page', (folder / 'report.html').as_uri(), loaded, 1000)
    draw('diagnosis', (folder / 'diagnosis' / 'report.html').as_uri(), loaded, 1250)
    live = {'page_port': PORT, 'port': PORT - 1}
    with (
        node('stage_bringup.live_view_node', **live),
        node('session_bags.player_node', bag=folder / 'circle', loop='true'),
    ):
        followed = f'past.filter(s => s.error && s.contour !== null).length > {STATES}'
        draw('live_view', f'http://127.0.0.1:{PORT}/', followed, 900)
    draw_rerun(folder / 'circle')


if __name__ == '__main__':
    main()
