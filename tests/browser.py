"""A page as a browser without a window draws it."""

from __future__ import annotations

import json
import shutil
import subprocess
from html import unescape
from pathlib import Path
from typing import Any

import pytest

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
