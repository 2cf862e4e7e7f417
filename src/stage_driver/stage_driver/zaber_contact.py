"""Finding a Zaber stage whose port is not there yet, or not there any more."""

from __future__ import annotations

import time

from stage_core.errors import StageError
from stage_driver.config import ZaberConfig
from stage_driver.zaber_clock import WallClock
from stage_driver.zaber_link import LinkLost, NoAnswer, PortAbsent, ZaberLink, advice
from stage_driver.zaber_stage import ZaberStage

#: A stage that is not there is looked for this often [s].
RECONNECT_PERIOD = 1.0


class ZaberContact:
    """Opens the stage; `met` says whether it was ever there, `absence` why it is not there now."""

    def __init__(self, config: ZaberConfig, clock: WallClock) -> None:
        self._config, self._clock = config, clock
        self._retry_at = 0.0
        self.met = False
        self.absence = ''
        #: Why nothing can be asked of a stage that is not there.
        self.lost = f'no contact with {config.port}: check power and cable'
        #: What a stop says that nobody may have heard.
        self.unheard = (
            f'no contact with {config.port}: the stage may still move, use the emergency stop'
        )
        #: The port that was opened last, also while its devices have not answered yet.
        self.link: ZaberLink | None = None

    def first(self) -> ZaberStage | None:
        """The stage, stopped; None where its port may still come.

        Raises
        ------
        StageError
            If it cannot be opened, or nobody answers.
        """
        try:
            return ZaberStage(self._config, self._clock, self._keep_and_stop)
        except PortAbsent as error:
            self.absence = str(error)
            return None
        except (NoAnswer, LinkLost) as error:
            raise StageError(advice(error)) from error

    def look(self) -> ZaberStage | None:
        """The stage, stopped, where it is there by now; asked as often as one likes."""
        if time.monotonic() < self._retry_at:
            return None
        try:
            return ZaberStage(self._config, self._clock, self._keep_and_stop)
        except (StageError, NoAnswer, LinkLost) as error:
            self.absence = str(error)
            return None
        finally:
            self._retry_at = time.monotonic() + RECONNECT_PERIOD

    def details(self) -> dict[str, str]:
        """What `/diagnostics` shows of the line."""
        details = {'port': self._config.port}
        if self.link is not None:
            counts = dict(self.link.counts)  # the reader goes on counting
            details.update({f'line_{name}': str(count) for name, count in counts.items()})
        if self.absence:
            details['waits'] = self.absence
        return details

    def found(self) -> bool:
        """Note that the stage has told its state; whether it was the first time."""
        first, self.met, self.absence = not self.met, True, ''
        return first

    def _keep_and_stop(self, link: ZaberLink) -> None:
        """Stop whatever hears it: an axis may run on from before, or beside a silent one."""
        self.link = link
        link.stop()
