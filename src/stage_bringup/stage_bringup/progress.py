"""Progress of one step: a bar on a terminal, now and then a line in a log."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable
from types import TracebackType

from tqdm import tqdm

#: What ends sooner shows nothing [s].
PATIENCE = 2.0
#: A log gets a line this often [s], a terminal a new bar.
LINE_PERIOD = 10.0
BAR_PERIOD = 0.2

#: How far a step is (0 ... 1, None where that cannot be known) and what it does now.
State = tuple[float | None, str]


class Progress:
    """Shows how far a step is, from a thread of its own, until the `with` block ends.

    Parameters
    ----------
    watch
        Asked for the state again and again; without it the newest `show` counts.
    """

    def __init__(self, watch: Callable[[], State] | None = None) -> None:
        self._state: State = (None, '')
        self._watch = watch or (lambda: self._state)
        self._begin = time.monotonic()
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, name='progress', daemon=True)

    def __enter__(self) -> Progress:
        self._begin = time.monotonic()
        self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._ended.set()
        self._thread.join(timeout=5.0)

    def show(self, fraction: float | None, text: str) -> None:
        """Say how far the step is."""
        self._state = (fraction, text)

    def _run(self) -> None:
        if self._ended.wait(PATIENCE):
            return
        if sys.stderr.isatty():
            self._draw_bar()
            return
        while not self._ended.wait(LINE_PERIOD):
            print(self.line(), flush=True)

    def line(self) -> str:
        """The state as a line of a log."""
        fraction, text = self._watch()
        share = '' if fraction is None else f'{100.0 * fraction:.0f} % '
        return f'     {share}{text} ({time.monotonic() - self._begin:.0f} s)'.replace('  (', ' (')

    def _draw_bar(self) -> None:
        known, unknown = (
            '     {percentage:3.0f}%|{bar:30}| {elapsed} {desc}',
            '     {elapsed} {desc}',
        )
        with tqdm(total=1.0, leave=False, bar_format=unknown, file=sys.stderr) as bar:
            bar.start_t -= time.monotonic() - self._begin
            while not self._ended.wait(BAR_PERIOD):
                fraction, text = self._watch()
                bar.bar_format = unknown if fraction is None else known
                bar.n = fraction or 0.0
                bar.set_description_str(text)
