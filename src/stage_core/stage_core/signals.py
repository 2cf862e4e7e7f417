"""The signals that end a process in an orderly way."""

from __future__ import annotations

import signal


def ending() -> tuple[signal.Signals, ...]:
    """Ctrl-C, SIGTERM, and the hang-up of a terminal, unless `nohup` has this ignored."""
    ignored = signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    always = (signal.SIGINT, signal.SIGTERM)
    return always if ignored else (*always, signal.SIGHUP)
