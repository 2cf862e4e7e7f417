"""Bags in the official JavaScript reader, @mcap/core, which Foxglove uses.

Skipped without node and the reader's packages; `tools/read_bag.mjs` says how to get them.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest
from mcap.reader import make_reader

from session_bags import repair

ROOT = Path(__file__).resolve().parents[2]


def node_has_the_reader() -> bool:
    packages = "require('@mcap/core'); require('@foxglove/wasm-zstd')"
    if shutil.which('node') is None:
        return False
    return subprocess.run(['node', '-e', packages], capture_output=True).returncode == 0


pytestmark = pytest.mark.skipif(
    not node_has_the_reader(), reason='needs node and NODE_PATH with @mcap/core'
)


def read_with_javascript(path: Path) -> dict[str, Any]:
    done = subprocess.run(
        ['node', str(ROOT / 'tools' / 'read_bag.mjs'), str(path)],
        capture_output=True,
        text=True,
        env=os.environ,
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def check_against_python(path: Path) -> None:
    """Same topics, schemas and numbers of messages as Python's official reader finds."""
    found = read_with_javascript(path)
    with open(path, 'rb') as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None and summary.statistics is not None
    for number, channel in summary.channels.items():
        shown = found['topics'][channel.topic]
        assert shown['schema'] == summary.schemas[channel.schema_id].name
        assert (shown['schemaEncoding'], shown['messageEncoding']) == ('ros2msg', 'cdr')
        assert shown['messages'] == summary.statistics.channel_message_counts.get(number, 0)
    assert found['total'] == summary.statistics.message_count > 0
    assert found['compressions'] == ['zstd'] and found['schemaBytes'] > 0


def test_a_bag_that_was_cut_and_repaired(bag: Path) -> None:
    file = bag / 'bag_0.mcap'
    file.write_bytes(file.read_bytes()[:-3000])
    repair.repair(bag)
    check_against_python(file)
