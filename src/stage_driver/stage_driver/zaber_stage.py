"""The axes of a Zaber stage as one: polls, motions, warnings, and what silence means."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from stage_driver.config import ZaberConfig
from stage_driver.limits import AxisLimits
from stage_driver.protocol import ProtocolError, Reply, warning_list
from stage_driver.zaber_clock import WallClock
from stage_driver.zaber_link import AnswersLate, LinkLost, NoAnswer, Query, ZaberLink
from stage_driver.zaber_setup import connect, integer
from stage_driver.zaber_words import FLAGS, describe_flag, describe_rejection

#: How many control cycles a streamed move reaches ahead of the next one.
LOOKAHEAD_CYCLES = 3


@dataclass(frozen=True)
class Poll:
    """Positions [microsteps], busy and highest flag of every axis at `stamp` [ns]."""

    stamp: int
    steps: list[int]
    busy: list[bool]
    flags: tuple[str, ...]


class ZaberStage:
    """Talks to the devices behind one open port. All calls may raise LinkLost.

    `opened` is called with the port before its devices are asked anything.
    """

    def __init__(
        self,
        config: ZaberConfig,
        clock: WallClock | None = None,
        opened: Callable[[ZaberLink], object] = lambda link: None,
    ) -> None:
        self.config = config
        self._clock = clock or WallClock()
        self.link, self.handles = connect(config, self._clock, opened)
        self.limits: list[AxisLimits] = [
            handle.narrowed(limits)
            for handle, limits in zip(self.handles, config.limits, strict=True)
        ]
        self._silent, self._late = 0.0, self.link.counts['late']

    def close(self) -> None:
        """Stop the axes, give knobs and settings back, close the port."""
        with contextlib.suppress(LinkLost, NoAnswer):
            for device in sorted(set(self.config.devices)):
                self.link.ask('stop', device)
                self.link.ask('set knob.enable 1', device)
            for handle in self.handles:
                words = f'set {handle.braking} {handle.former_braking}'
                self.link.ask(words, handle.device, handle.axis)
        self.link.close()

    def metres(self, steps: Sequence[float]) -> list[float]:
        """Microsteps of every axis in m."""
        return [h.units.metres(step) for h, step in zip(self.handles, steps, strict=True)]

    def steps(self, metres: Sequence[float]) -> list[int]:
        """Positions of every axis [m] in microsteps."""
        return [h.units.steps(value) for h, value in zip(self.handles, metres, strict=True)]

    def velocities(self, before: Poll | None, poll: Poll) -> list[float]:
        """Difference of two polls [m/s]; zero where the first is missing or too long ago."""
        elapsed = (poll.stamp - before.stamp) * 1e-9 if before is not None else 0.0
        if before is None or not 0.0 < elapsed < 1.0:
            return [0.0] * len(self.handles)
        then = self.metres(before.steps)
        return [(a - b) / elapsed for a, b in zip(self.metres(poll.steps), then, strict=True)]

    def poll(self) -> Poll | None:
        """Ask every axis for its position; None where one did not answer this time.

        Raises
        ------
        LinkLost
            If it has not for `link_timeout`.
        AnswersLate
            If it has by then, but always after `reply_timeout`.
        """
        sent = self._clock.now()
        replies = self.link.ask_all([Query('get pos', h.device, h.axis) for h in self.handles])
        # The devices answer at once: half the round trip is the best guess of "when".
        stamp = (sent + self._clock.now()) // 2
        answered = [reply for reply in replies if reply is not None]
        if len(answered) < len(replies):
            self._count_silence()
            return None
        self._silent, self._late = 0.0, self.link.counts['late']
        return Poll(
            stamp,
            [integer(reply, h.name) for reply, h in zip(answered, self.handles, strict=True)],
            [reply.busy for reply in answered],
            tuple(reply.flag for reply in answered),
        )

    def _count_silence(self) -> None:
        """Add a poll's wait; time in which nobody was asked is no silence of the devices."""
        self._silent += self.config.reply_timeout
        if self._silent > self.config.link_timeout:
            silent, self._silent = self._silent, 0.0
            before, self._late = self._late, self.link.counts['late']
            self.link.refuse_late(before)
            raise LinkLost(f'no answer at {self.config.port} for {silent:.1f} s')

    def warnings(self, clear: bool = False) -> tuple[str, ...]:
        """Flags of all axes, each once; with `clear` those that stay after clearing."""
        found: dict[str, None] = {}
        for handle in self.handles:
            if clear:
                self.link.ask('warnings clear', handle.device, handle.axis)
            reply = self.link.ask('warnings', handle.device, handle.axis)
            try:
                listed = warning_list(reply.data)
            except ProtocolError:
                listed = () if reply.flag == '--' else (reply.flag,)
            found.update(dict.fromkeys(listed))
        return tuple(found)

    def temperatures(self) -> dict[str, float]:
        """Controller temperatures [degC] by sensor name, of the devices that have the sensor."""
        queries = [Query('get system.temperature', h.device) for h in self.handles]
        values = {}
        for handle, reply in zip(self.handles, self.link.ask_all(queries), strict=True):
            if reply is not None and reply.accepted:
                with contextlib.suppress(ValueError):
                    values[f'controller_{handle.name}'] = float(reply.data)
        return values

    def switch_drivers(self, on: bool) -> None:
        """Enable or disable the motor drivers."""
        for handle in self.handles:
            self.link.ask('driver enable' if on else 'driver disable', handle.device, handle.axis)

    def home(self) -> str | None:
        """Start homing on every axis; what went wrong, or None."""
        return self._motion(['home'] * len(self.handles), [None] * len(self.handles))

    def move(self, targets: Sequence[int | None]) -> str | None:
        """Start moves to `targets` [microsteps], None for a stop; what went wrong, or None."""
        words = [
            'stop' if target is None else self._move_words(index, target, limits.max_velocity)
            for index, (target, limits) in enumerate(zip(targets, self.limits, strict=True))
        ]
        return self._motion(words, targets)

    def stream(self, velocities: Sequence[float], steps: Sequence[int]) -> str | None:
        """Send velocities [m/s] as moves to points just ahead of `steps`; what was refused.

        At a limit or beyond it an axis stops: none moves against its velocity. An unanswered move
        is not repeated: the next cycle sends a fresher one.
        """
        reach = LOOKAHEAD_CYCLES / self.config.rate
        queries = []
        for index, handle in enumerate(self.handles):
            velocity = velocities[index]
            ahead = steps[index] + handle.units.steps(velocity * reach)
            # Only the limit ahead counts: the one behind would draw the axis back.
            target = min(ahead, handle.upper) if velocity > 0.0 else max(ahead, handle.lower)
            words = 'stop'
            if (target - steps[index]) * velocity > 0.0:
                words = self._move_words(index, target, velocity)
            queries.append(Query(words, handle.device, handle.axis))
        return self._refused(self.link.ask_all(queries))

    def _motion(self, words: Sequence[str], targets: Sequence[int | None]) -> str | None:
        queries = [
            Query(text, handle.device, handle.axis)
            for text, handle in zip(words, self.handles, strict=True)
        ]
        stops = self.link.stops
        replies = self.link.ask_all(queries)
        for index, reply in enumerate(replies):
            if reply is not None:
                continue
            replies[index] = self._after_silence(queries[index], targets[index], stops)
            if replies[index] is None:
                return (
                    f'axis {self.handles[index].name} does not confirm a motion: check the cable'
                )
        return self._refused(replies)

    def _after_silence(self, query: Query, target: int | None, stops: int) -> Reply | None:
        """Look whether an unanswered motion was taken; only one that was not is sent again.

        With more than `stops` the motion is over by now, and is not sent again either.
        """
        try:
            state = self.link.ask('get pos', query.device, query.axis)
        except AnswersLate:
            raise
        except NoAnswer:
            return None
        taken = state.busy or (target is not None and state.data == str(target))
        if taken or self.link.stops != stops:
            return state
        return self.link.ask_all([query])[0]

    def _refused(self, replies: Sequence[Reply | None]) -> str | None:
        for reply, handle in zip(replies, self.handles, strict=True):
            if reply is not None and not reply.accepted:
                return f'axis {handle.name} refused a motion: {describe_rejection(reply.data)}'
        return None

    def _move_words(self, index: int, target: int, velocity: float) -> str:
        units = self.handles[index].units
        acceleration = units.acceleration(self.limits[index].max_acceleration)
        return f'move abs {target} {units.speed(velocity)} {acceleration}'


def first_fault(flags: Sequence[str], ignored: Sequence[str] = ()) -> str | None:
    """Plain words of the first fault among `flags`, or None."""
    for flag in flags:
        if flag in FLAGS and FLAGS[flag].severity == 'fault' and flag not in ignored:
            return describe_flag(flag)
    return None
