"""The reference says what the code says."""

from __future__ import annotations

from pathlib import Path

from stage_bringup.reference import NODES, interfaces, render

ROOT = Path(__file__).resolve().parents[2]


def test_reference_is_of_this_code() -> None:
    """Run ``make reference`` after a change of parameters, topics or services."""
    assert (ROOT / 'docs' / 'reference' / 'reference.md').read_text() == render()


def test_every_service_is_found() -> None:
    text = render()
    for service in ('home', 'stop', 'reset_fault', 'enable', 'align', 'reset', 'retrain'):
        assert f'`~/{service}`' in text
    for service in ('activate', 'run', 'abort', 'start', 'diagnose'):
        assert f'`~/{service}`' in text
    assert set(NODES) == {line[3:] for line in text.split('\n') if line.startswith('## ')} - {
        'Topics'
    }


def test_interfaces_of_a_source() -> None:
    found = interfaces(
        'from stage_core import topics\n'
        'node.create_publisher(JointState, topics.SETPOINT, 1)\n'
        "node.create_service(Trigger, '~/home', f)\n"
    )
    assert found == {'publishes': {'/stage/setpoint'}, 'subscribes': set(), 'services': {'~/home'}}
