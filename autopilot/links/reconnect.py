"""Links around links: one that outlives its line, and one that passes on only what sensor selection admits.

A line is lost where an adapter is pulled, and comes back; where a connection is closed, and opens again. While it is
gone control is not ours and an alarm says why; opening is tried again from a thread, because looking for a host may
take seconds that the loop does not have. What comes back is a new link, which proves anew that it steers.
"""

from __future__ import annotations

import contextlib
import math
import threading
from collections.abc import Callable

from autopilot.estimation.sensor_selection import SensorSelection
from autopilot.links.base import ConfirmsRelease, Link, LinkError, parted
from autopilot.links.rudder_order import Release, ReleaseState, not_held
from autopilot.signals import AlarmEvent, AlarmSample, HelmSample, RudderCommand, Sample, Tick
from autopilot.supervision.panel import sentence_of

RETRY_S = 1.0
"""Pause between tries to open."""


def in_thread(work: Callable[[], None]) -> None:
    """Do `work` in a thread that keeps no process from ending."""
    threading.Thread(target=work, name="open", daemon=True).start()


class ReconnectingLink:
    """A `Link` round the one that `opener` opens, again and again.

    What goes wrong at the first opening is waited for, too: at power-on adapters come when they come.

    Args:
        name: the URL, and so the source of what the link says of the helm.
        steers: whether rudder orders leave here, so that without it nothing may be engaged.
        opener: opens the link; LinkError where it cannot.
        start: does a piece of work that may take long.
    """

    def __init__(
        self,
        name: str,
        steers: bool,
        opener: Callable[[], Link],
        start: Callable[[Callable[[], None]], None] = in_thread,
    ) -> None:
        self.name = name
        self._opener, self._start = opener, start
        self._link: Link | None = None
        self._opened: Link | None = None
        self._opening = False
        self._closed = False
        self._next = -math.inf
        self._helms = {name} if steers else set()
        self._alarmed: set[str] = set()
        self._news: list[Sample] = []
        self._packets: list[tuple[float, bytes]] = []
        self.trouble = ""
        self._left_behind = not_held(name)
        try:
            self._link = opener()
        except LinkError as error:
            self._lost(-math.inf, error)

    def fileno(self) -> int:
        """Return the descriptor of the link inside, -1 while there is none."""
        return -1 if self._link is None else self._link.fileno()

    def receive(self, now: float) -> list[Sample]:
        """Return what has arrived; when the line is lost that the helm is not ours. Raises nothing."""
        if self._link is None:
            self._look_for(now)
        if self._link is not None:
            try:
                self._note(self._link.receive(now))
                if (lost := getattr(self._link, "lost", None)) is not None:
                    raise LinkError(sentence_of(lost))
            except LinkError as error:
                self._lost(now, error)
        # what was said at an unknown time, when the link was made, is said now
        news = [sample._replace(time=now) if sample.time == -math.inf else sample for sample in self._news]
        self._news = []
        return news

    def send(self, now: float, command: RudderCommand) -> None:
        """Pass on."""
        self._do(now, lambda link: link.send(now, command))

    def poll(self, now: float) -> None:
        """Pass on."""
        self._do(now, lambda link: link.poll(now))

    def publish_tick(self, tick: Tick) -> None:
        """Pass on."""
        self._do(tick.now, lambda link: link.publish_tick(tick))

    def release(self, now: float) -> None:
        """Pass on; never raises."""
        if self._link is not None:
            self._link.release(now)

    def release_result(self, now: float) -> Release | None:
        """Pass on; while the line is gone nothing that was ordered over it can be taken back."""
        if isinstance(self._link, ConfirmsRelease):
            return self._link.release_result(now)
        return not_held(self.name) if self._link is not None else self._left_behind

    def take_packets(self) -> list[tuple[float, bytes]]:
        """Return the packets of the link inside, and of those before it."""
        packets, self._packets = self._packets, []
        return packets if self._link is None else packets + self._link.take_packets()

    def close(self) -> None:
        """Close the link inside, and one that is just being opened as soon as it is."""
        self._closed = True
        for link in (self._link, self._opened):
            if link is not None:
                link.close()
        self._link = self._opened = None

    def _do(self, now: float, act: Callable[[Link], None]) -> None:
        if self._link is not None:
            try:
                act(self._link)
            except LinkError as error:
                self._lost(now, error)

    def _note(self, samples: list[Sample]) -> None:
        for sample in samples:
            if sample.__class__ is HelmSample:
                self._helms.add(sample.source)
            elif sample.__class__ is AlarmSample:
                self._alarmed.add(sample.source)
        self._news += samples

    def _lost(self, now: float, error: LinkError) -> None:
        # what the error says behind this is to start anew, which is not needed here
        why, _ = parted(str(error))
        self.trouble = f"{why}; it is opened again as soon as it is there"
        self._next = now + RETRY_S
        link, self._link = self._link, None
        if link is not None:
            if isinstance(link, ConfirmsRelease):
                link.release(now)
                self._left_behind = link.release_result(now) or Release(self.name, ReleaseState.LOST)
            self._packets += link.take_packets()
            with contextlib.suppress(LinkError):
                link.close()
        # the reason of an override stands until the next order, when the line may long be back
        self._news += [HelmSample(now, False, f"line lost: {why}", source) for source in sorted(self._helms)]
        self._news += [AlarmSample(now, None, source) for source in sorted(self._alarmed)]
        self._news.append(AlarmSample(now, AlarmEvent("line_lost", self.trouble), f"{self.name} line"))
        self._alarmed.clear()

    def _look_for(self, now: float) -> None:
        """Take the link that has been opened meanwhile, or have one opened when it is time."""
        if self._opened is not None:
            self._link, self._opened = self._opened, None
            self.trouble = ""
            # under its own name the new link speaks for itself, when it knows
            ours = sorted(self._helms - {self._link.name})
            self._news += [HelmSample(now, True, "", source) for source in ours]
            self._news.append(AlarmSample(now, None, f"{self.name} line"))
        elif not self._opening and now >= self._next:
            self._opening = True
            self._next = now + RETRY_S
            try:
                self._start(self._open)
            except RuntimeError:
                self._opening = False  # no thread to be had at this moment

    def _open(self) -> None:
        """Open the link; whatever goes wrong here ends this try alone, and is asked for again."""
        link = None
        try:
            with contextlib.suppress(Exception):
                link = self._opener()
            if self._closed and link is not None:
                link.close()
            else:
                self._opened = link
        finally:
            self._opening = False


class SelectingLink:
    """A `Link` round another, which passes on the samples that are selected; all else is the other's own.

    All links of a run share one `selection`, which sees the samples of all of them.
    """

    def __init__(self, link: Link, selection: SensorSelection) -> None:
        self.name = link.name
        self.inside = link
        self._selection = selection
        self.fileno, self.send, self.publish_tick, self.poll = link.fileno, link.send, link.publish_tick, link.poll
        self.release, self.take_packets, self.close = link.release, link.take_packets, link.close
        moves = link.release_result if isinstance(link, ConfirmsRelease) else None
        self.release_result = moves or (lambda now: not_held(link.name))

    def receive(self, now: float) -> list[Sample]:
        """Return the samples that are selected. Raises LinkError."""
        return self._selection.admit(now, self.inside.receive(now), self.name)
