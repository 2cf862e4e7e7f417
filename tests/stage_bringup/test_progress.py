"""Progress of the steps: what a log shows, and the contour's share from /diagnostics."""

from __future__ import annotations

import pytest

pytest.importorskip('rclpy')

from stage_bringup import progress
from stage_bringup.progress import Progress
from stage_bringup.steps import contour_state


class Client:
    def __init__(self, sentence: str, tick: str = '') -> None:
        self.newest = (sentence, {'tick': tick} if tick else {})

    def status(self, task: str) -> tuple[str, dict[str, str]]:
        assert task == 'contour_ctrl: contour'
        return self.newest


@pytest.mark.parametrize(
    ('client', 'fraction'),
    [
        (Client('iteration 2 of 4: following the contour', '500 of 1000'), 0.375),
        (Client('iteration 1 of 1: following the contour', '1001 of 1000'), 1.0),
        (Client('idle'), None),
    ],
)
def test_share_of_a_contour(client: Client, fraction: float | None) -> None:
    assert contour_state(client) == (fraction, client.newest[0])  # type: ignore[arg-type]


def test_a_log_gets_lines_after_a_while(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(progress, 'PATIENCE', 0.0)
    monkeypatch.setattr(progress, 'LINE_PERIOD', 0.01)
    asked = []

    def watch() -> progress.State:
        asked.append(1)
        return 0.25, '1 of 4 positions'

    with Progress(watch) as shown:
        while len(asked) < 3:
            shown._ended.wait(0.01)
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) >= 2 and lines[0].startswith('     25 % 1 of 4 positions (')


def test_what_ends_at_once_shows_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    with Progress() as shown:
        shown.show(0.5, 'half')
    assert capsys.readouterr() == ('', '')
    assert shown.line().startswith('     50 % half (')
