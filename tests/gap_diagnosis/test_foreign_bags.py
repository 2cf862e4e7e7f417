"""Bags of machines and recorders that are not ours: the right diagnosis, or one clear line."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from mcap.writer import CompressionType

from gap_diagnosis.__main__ import main

from .foreign import Shape, machine, messages, twin, write_bag, write_mcap

Capture = pytest.CaptureFixture[str]
PLANTED = ['coulomb_friction.x', 'backlash.y']


def run(bag: Path, folder: Path, content: object = None) -> int:
    """Exit status of the command on a bag and a twin file with some content."""
    text = content if isinstance(content, str) else yaml.safe_dump(content or twin())
    (folder / 'twin.yaml').write_text(text)
    words = ['diagnose', '--bag', str(bag), '--twin', str(folder / 'twin.yaml'), '--quiet']
    return main([*words, '--no-page', '--out', str(folder / 'out')])


def found(folder: Path) -> dict:
    return json.loads((folder / 'out' / 'report.json').read_text())


def refused(status: int, folder: Path, capsys: Capture) -> str:
    """The one line of a refusal; nothing was written."""
    error = capsys.readouterr().err.strip()
    assert status == 2
    assert len(error.splitlines()) == 1, error
    assert not (folder / 'out').exists() or not list((folder / 'out').iterdir())
    return error


def ticks() -> np.ndarray:
    return np.arange(len(machine().time))


def with_gaps() -> np.ndarray:
    rows = ticks()
    return rows[~(((rows > 3000) & (rows < 3200)) | ((rows > 8000) & (rows < 8050)))]


def with_losses() -> np.ndarray:
    rows = ticks()
    return rows[(np.random.default_rng(1).random(len(rows)) > 0.01) | (rows == 0)]


@pytest.mark.parametrize(
    ('shape', 'container', 'more'),
    [
        # Another epoch, the names in another order, topics and types that nobody knows.
        (
            Shape(start=0.0, order=('y', 'x'), extra=True),
            {'compression': CompressionType.ZSTD, 'files': 3},
            [],
        ),
        # Only what a diagnosis needs: no velocities beside the positions, no temperatures.
        (
            Shape(full=False, temperature=False),
            {'compression': CompressionType.LZ4, 'metadata': False, 'files': 2},
            [],
        ),
        (Shape(keep=with_losses()), {'chunked': False}, []),
        (Shape(keep=with_gaps()), {}, []),
        (Shape(tracker_offset=0.0021), {}, ['tracker_latency']),
    ],
    ids=['epoch, order, extra topics', 'least topics', 'lost ticks', 'gaps', 'late tracker'],
)
def test_planted_effects_are_found_however_it_was_recorded(
    tmp_path: Path, shape: Shape, container: dict, more: list[str]
) -> None:
    bag = write_bag(tmp_path / 'bag', messages(machine(), shape), **container)
    assert run(bag, tmp_path) == 0
    assert sorted(found(tmp_path)['verdict']) == sorted(PLANTED + more)


def test_a_bare_file_of_one_axis_with_a_fast_tracker(tmp_path: Path) -> None:
    recording = machine(axes=('y',), rate=333.0)
    bag = write_mcap(tmp_path / 'y.mcap', messages(recording, Shape()))
    assert run(bag, tmp_path) == 0
    assert found(tmp_path)['verdict'] == ['backlash.y']


def test_half_a_bag_is_diagnosed_and_the_report_says_so(tmp_path: Path) -> None:
    content = messages(machine(duration=14.0), Shape())
    bag = write_bag(tmp_path / 'bag', content, compression=CompressionType.ZSTD)
    file = bag / 'bag_0.mcap'
    file.write_bytes(file.read_bytes()[: 3 * file.stat().st_size // 4])
    assert run(bag, tmp_path) == 0
    assert set(found(tmp_path)['verdict']) == set(PLANTED)
    assert any('unfinished' in warning for warning in found(tmp_path)['warnings'])


def changed(**columns: Callable[[np.ndarray], np.ndarray]) -> list:
    """Messages of the recording with some of its arrays changed."""
    plain = machine()
    arrays = {name: change(getattr(plain, name).copy()) for name, change in columns.items()}
    return messages(replace(plain, **arrays), Shape(temperature=False))


def turned(points: np.ndarray, angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return points @ np.array([[c, s], [-s, c]])


def test_a_tracker_anywhere_whose_points_are_late(tmp_path: Path) -> None:
    plain = machine()
    away = replace(plain, tracker=turned(plain.tracker, 0.6) + np.array([1.5, -2.0]))
    bag = write_bag(tmp_path / 'bag', messages(away, Shape(tracker_offset=0.04)))
    assert run(bag, tmp_path) == 0
    report = found(tmp_path)
    assert sorted(report['verdict']) == sorted(
        [*PLANTED, 'tracker_latency', 'tracker_misalignment']
    )
    causes = {cause['effect']: cause for cause in report['causes']}
    place = causes['tracker_misalignment']['parameters']
    assert place['angle']['value'] == pytest.approx(0.6, abs=2e-5)
    assert place['offset_x']['value'] == pytest.approx(1.5, abs=2e-6)
    assert place['offset_y']['value'] == pytest.approx(-2.0, abs=2e-6)
    assert 0.0 < place['angle']['std'] < 1e-4
    assert causes['tracker_latency']['parameters']['latency']['value'] == pytest.approx(
        0.04, abs=2e-4
    )
    # What was taken out first is part of the gap all the same.
    gap = report['gap']
    assert gap['before'] > 1.0 and gap['after'] < 1.2 * gap['noise_floor']
    assert causes['tracker_misalignment']['gap_before'] > 1.0
    assert 1e-4 < causes['tracker_latency']['gap_before'] < 1e-2


def test_a_force_in_another_unit_is_a_finding(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / 'bag', changed(force=lambda a: 1e6 * a))
    assert run(bag, tmp_path) == 0
    report = found(tmp_path)
    units = ['effort_convention.x', 'effort_convention.y']
    assert sorted(report['verdict']) == sorted([*PLANTED, *units])
    for cause in report['causes']:
        if cause['effect'] in units:
            assert cause['parameters']['factor']['value'] == pytest.approx(1e6, rel=1e-3)


def stands_half(points: np.ndarray) -> np.ndarray:
    points[len(points) // 2 :] = points[len(points) // 2]
    return points


@pytest.mark.parametrize(
    ('content', 'words'),
    [
        (lambda: messages(machine(), Shape(stamped=False)), 'same stamp in its header'),
        (lambda: changed(tracker=lambda a: np.full_like(a, np.nan)), 'not a finite number'),
        (lambda: changed(tracker=stands_half), 'frozen 5.0 s after the start'),
        (lambda: changed(tracker=lambda a: 1e3 * a), 'times as far as the encoder'),
        (lambda: changed(tracker=lambda a: a * np.array([1.0, -1.0])), 'is mirrored'),
        (lambda: messages(machine(), Shape(tracker_offset=0.3)), '0.30 s late'),
        (lambda: changed(encoder=lambda a: 1e6 * a), 'times as far as its reference'),
        (lambda: changed(force=lambda a: 0.0 * a), 'the force is not recorded'),
    ],
    ids=[
        'no stamps',
        'NaN',
        'stands',
        'mm',
        'mirror',
        'clock',
        'counts',
        'no force',
    ],
)
def test_a_topic_that_is_wrong_is_named(
    tmp_path: Path, capsys: Capture, content: Callable[[], list], words: str
) -> None:
    status = run(write_bag(tmp_path / 'bag', content()), tmp_path)
    assert words in refused(status, tmp_path, capsys)


def test_what_is_no_bag_is_refused(tmp_path: Path, capsys: Capture) -> None:
    (tmp_path / 'empty').mkdir()
    (tmp_path / 'text').write_text('hello')
    (tmp_path / 'text.mcap').write_text('hello, this is no recording')
    begun = write_mcap(tmp_path / 'begun.mcap', messages(machine(), Shape(temperature=False)))
    begun.write_bytes(begun.read_bytes()[:300])
    for name, words in (
        ('empty', 'holds no bag'),
        ('text', 'is not a bag'),
        ('text.mcap', 'is not an mcap file'),
        ('begun.mcap', 'begun.mcap'),
    ):
        assert words in refused(run(tmp_path / name, tmp_path), tmp_path, capsys)


@pytest.fixture(scope='module')
def bare(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A bag of the machine, for twin files that do not fit."""
    path = tmp_path_factory.mktemp('bare') / 'bag.mcap'
    return write_mcap(path, messages(machine(), Shape(temperature=False)))


@pytest.mark.parametrize(
    ('content', 'words'),
    [
        ('\x00\x01{{{ : [', 'not valid YAML'),
        ('just words', 'no YAML mapping'),
        ('kind: servo\naxes: {x: {mass: .nan, viscous: 1}}', 'axes.x.mass'),
        ({**twin(), 'control_period': 0.002}, 'control period'),
        (twin(('x',)), 'no axis y'),
        ({**twin(), 'effects': {'gremlins.x': {'size': 1.0}}}, 'gremlins.x is unknown'),
    ],
    ids=['garbage', 'words', 'NaN', 'period', 'axes', 'effects'],
)
def test_a_twin_that_is_none_is_refused(
    bare: Path, tmp_path: Path, capsys: Capture, content: object, words: str
) -> None:
    assert words in refused(run(bare, tmp_path, content), tmp_path, capsys)
