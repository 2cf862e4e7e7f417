"""The whole session in real processes: small, deterministic, nothing left running."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

from session_bags.check import OK, check_bag
from session_bags.reader import read_session
from stage_core import topics

from ..domains import own_domain
from ..stage_reports.reading import seen

#: Words of files and of programs, and numbers with an exponent.
UNREADABLE = (
    r'\b(?:um|below_noise|screw_phase|coulomb_friction|cyclic_pitch_error)\b|\d[eE][-+]?\d'
)
#: The fewest places with which the correction reaches every held-out point.
SMALL = ['--grid', '4', '--heldout', '3', '--iterations', '1']


def start(out: Path, environment: dict[str, str], *options: str) -> subprocess.Popen:
    return subprocess.Popen(
        [sys.executable, '-m', 'stage_bringup.session', '--out', str(out), *SMALL, *options],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        stdin=subprocess.DEVNULL,
        text=True,
        env=environment,
    )


def left_running(out: Path) -> list[str]:
    """Processes that still name the session's folder in their command line."""
    found = []
    for folder in Path('/proc').iterdir():
        if folder.name.isdigit() and int(folder.name) != os.getpid():
            try:
                line = (folder / 'cmdline').read_bytes().replace(b'\0', b' ').decode()
            except OSError:
                continue
            if str(out) in line:
                found.append(line)
    return found


def test_a_session_refuses_to_start_beside_a_graph(
    tmp_path: Path, ros_env: dict[str, str]
) -> None:
    from stage_core.ros.client_node import GraphClient

    with GraphClient('calibrator'):
        process = start(tmp_path / 'out', ros_env)
        output, _ = process.communicate()
    assert process.returncode == 2
    assert f'calibrator runs on ROS_DOMAIN_ID {ros_env["ROS_DOMAIN_ID"]} already' in output
    assert not (tmp_path / 'out').exists()


def check_page(page: Path, folder: Path) -> None:
    """The page shows pictures, its links lead to pages, it does not tell where it was made, and
    it writes names and numbers as a person does.
    """
    text = page.read_text()
    assert re.findall(UNREADABLE, seen(text)) == []
    assert 'data:image/svg+xml' in text
    links = re.findall(r'href="([^"]+)"', text)
    assert len(links) >= 3
    assert all((page.parent / link).is_file() for link in links), links
    assert str(folder) not in text and str(folder.parent) not in text


def test_session_twice(tmp_path: Path, ros_env: dict[str, str]) -> None:
    """Every step passes, the correction helps; with driver and contour controller in one process
    a second run prints the same table and follows the same contour, tick by tick.
    """
    tables = []
    # Lockstep waits more than it computes: both run at once, each in a domain of its own.
    with own_domain():
        runs = {
            tmp_path / 'first': start(tmp_path / 'first', ros_env),
            tmp_path / 'second': start(
                tmp_path / 'second', dict(os.environ), '--no-diagnosis', '--composed'
            ),
        }
        try:
            for out, process in runs.items():
                output, _ = process.communicate()
                assert process.returncode == 0, output
                assert not left_running(out)
                tables.append(json.loads((out / 'session.json').read_text())['rows'])
        finally:
            for process in runs.values():
                process.kill()
    assert tables[0] == tables[1]
    apart, composed = (read_session(out / 'circle').series for out in runs)
    for topic in (topics.REFERENCE, topics.COMMAND, topics.JOINT_STATES):
        assert len(apart[topic]) > 1500
        np.testing.assert_array_equal(composed[topic].stamps, apart[topic].stamps)
        for name, values in apart[topic].values.items():
            np.testing.assert_array_equal(composed[topic].values[name], values)
    distance = tables[0]['held-out distance']
    assert distance['after']['rms'] < 0.8 * distance['before']['rms']
    first = tmp_path / 'first'
    pages = [first / 'report.html', first / 'diagnosis' / 'report.html']
    pages += [first / f'{bag}.html' for bag in ('calibration', 'circle')]
    for page in pages:
        check_page(page, first)
    verdict = json.loads((first / 'diagnosis' / 'report.json').read_text())['verdict']
    assert {'coulomb_friction.x', 'backlash.x', 'cyclic_pitch_error.y'} <= set(verdict)
    session = read_session(first / 'calibration')
    assert session.twin is not None and 'effects' not in session.twin
    for topic in (topics.REFERENCE, topics.COMMAND, topics.JOINT_STATES, topics.TRACKER_POINT):
        assert session.has(topic)
    assert session.alignment is not None
    for bag in ('calibration', 'circle'):
        assert [str(f) for f in check_bag(first / bag) if f.level != OK] == []


def test_interrupted_session_leaves_nothing(tmp_path: Path, ros_env: dict[str, str]) -> None:
    out = tmp_path / 'interrupted'
    process = start(out, ros_env)
    try:
        while not (out / 'log' / 'gap_diagnosis.log').exists():
            assert process.poll() is None
            time.sleep(0.2)
        process.send_signal(signal.SIGINT)
        output, _ = process.communicate()
    finally:
        process.kill()
    assert process.returncode == 130, output
    assert 'interrupted' in output and not left_running(out)
