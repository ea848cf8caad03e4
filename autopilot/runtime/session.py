"""The real-time loop around the pilot: receive, step, send, record, wait.

A tick is due when a heading has arrived, or when the control period has passed without one, so that silence
is noticed and fail-safes act.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from typing import TYPE_CHECKING

from autopilot.links.base import ConfirmsRelease, Link
from autopilot.links.rudder_order import LONGEST_S, Release, ReleaseState
from autopilot.pilot import Pilot
from autopilot.runtime.machine import Clock
from autopilot.signals import (
    MOST_SAMPLES,
    AcknowledgeSample,
    AlarmSample,
    CompassSample,
    ConditionSample,
    HeadingSample,
    HelmSample,
    Order,
    Sample,
    Tick,
)

if TYPE_CHECKING:
    from autopilot.runtime.record import Recorder

SHORTEST_PERIOD = 0.4
"""Headings that come quicker than this share of the control period wait for the next tick."""
PATIENCE = 1.5
"""After a tick that a heading caused, the timer waits this many control periods for the next heading."""
RELEASE_TURN_S = 0.02
"""How often the links are looked at while they wait for the rudder to be shown free."""
SPARE = 1 << 20
"""Memory [bytes] that is given up to give the rudder back in, where there is no other left."""
NEVER_DROPPED = (HelmSample, AlarmSample, ConditionSample, AcknowledgeSample, CompassSample)

Orders = Callable[[float, Tick | None], Order]
"""What the skipper wants at a time [s], in view of the tick before."""


def newest(samples: Sequence[Sample]) -> tuple[Sample, ...]:
    """Return at most MOST_SAMPLES of `samples`, the newest, in their order.

    Who has the helm and what is wrong are never dropped.

    After a suspended machine or a stalled link thousands may wait; the old ones say nothing about now.
    """
    surplus = len(samples) - MOST_SAMPLES
    if surplus <= 0:
        return tuple(samples)
    kept = []
    for sample in samples:
        if surplus > 0 and not isinstance(sample, NEVER_DROPPED):
            surplus -= 1
        else:
            kept.append(sample)
    return tuple(kept[-MOST_SAMPLES:])


class Session:
    """One run of the pilot over its links. Use it as a context: leaving it releases the rudder, whatever happened."""

    def __init__(
        self,
        pilot: Pilot,
        links: Sequence[Link],
        clock: Clock,
        rate_hz: float,
        orders: Orders,
        recorder: Recorder | None = None,
    ) -> None:
        self._pilot = pilot
        self._use(links)
        self._clock = clock
        self._period = 1.0 / rate_hz
        self._orders = orders
        self._recorder = recorder
        self._samples: list[Sample] = []
        self._last = -self._period
        self._fresh = False
        self._driven = False
        self._spare = bytes(SPARE)
        self.tick: Tick | None = None
        self.releases: tuple[Release, ...] = ()
        """What became of the rudder on each link that moves one; known when the session is closed."""

    def _use(self, links: Sequence[Link]) -> None:
        """Take the links, and which of them do something where: a link to nobody is not called in vain."""

        def doing(*names: str) -> tuple[Link, ...]:
            return tuple(
                link
                for link in links
                if any(getattr(type(link), name, None) is not getattr(Link, name) for name in names)
            )

        self._links = tuple(links)
        self._waiting, self._receiving, self._sending = doing("fileno"), doing("receive"), doing("send")
        self._served, self._carrying = doing("publish_tick", "poll"), doing("take_packets")

    def __enter__(self) -> Session:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Release the rudder on every link, wait a moment until that is shown, then close links and log."""
        self._spare = b""
        now = self._clock.now()
        with ExitStack() as leaving:
            # run in reverse, and each even if another fails: no broken link keeps the rudder of a sound one
            if self._recorder is not None:
                leaving.callback(self._recorder.close)
            for link in self._links:
                leaving.callback(link.close)
            if (recorder := self._recorder) is not None and self.tick is not None:
                leaving.callback(lambda: recorder.keep_packets(self._packets()))
            leaving.callback(self._await_releases)
            for link in reversed(self._links):
                leaving.callback(link.release, now)

    def _await_releases(self) -> None:
        """Keep the links open until each has shown what became of its rudder, or time is over."""
        found: dict[int, Release] = {}
        waiting = {number: link for number, link in enumerate(self._links) if isinstance(link, ConfirmsRelease)}
        begun = now = self._clock.now()
        while waiting:
            for number, link in list(waiting.items()):
                release = self._release_of(link, now)
                if release is None and now - begun > LONGEST_S:
                    release = Release(link.name, ReleaseState.UNCONFIRMED, waited=now - begun)
                if release is not None:
                    found[number] = release
                    del waiting[number]
            if waiting:
                # a descriptor of a broken line can be read for ever: only the sound ones wake the loop
                descriptors = [fd for fd in (link.fileno() for link in waiting.values()) if fd >= 0]
                self._clock.wait(descriptors, now + RELEASE_TURN_S)
                now = self._clock.now()
        self.releases = tuple(found[number] for number in sorted(found))

    def _release_of(self, link: Link, now: float) -> Release | None:
        """Return what became of the rudder of one link; a line that is gone keeps no other from being looked at."""
        assert isinstance(link, ConfirmsRelease)
        with contextlib.suppress(Exception):
            link.receive(now)
        return link.release_result(now)

    def run(self, until: float, watch: Callable[[Tick], bool] | None = None) -> None:
        """Run to `until` [s], or until `watch`, called after every tick, returns True. Raises LinkError."""
        while True:
            now = self._clock.now()
            if now >= until:
                return
            if self.poll(now) and watch is not None and self.tick is not None and watch(self.tick):
                return
            now = self._clock.now()
            self._clock.wait([fd for link in self._waiting if (fd := link.fileno()) >= 0], min(self._due(), until))

    def poll(self, now: float) -> bool:
        """Take what has arrived by `now` [s] and tick where it is time to; return whether it ticked."""
        for link in self._receiving:
            arrived = link.receive(now)
            self._samples += arrived
            for sample in arrived:
                if sample.__class__ is HeadingSample:
                    self._fresh = True
        if now < self._due():
            for link in self._served:
                link.poll(now)
            return False
        self._step(now)
        return True

    def _due(self) -> float:
        """Return when the next tick is due: soon with a heading in hand; else after patience for the next one.

        A compass that has set the pace is given half a period more, or timer and headings would race.
        """
        if self._fresh:
            return self._last + SHORTEST_PERIOD * self._period
        return self._last + (PATIENCE if self._driven else 1.0) * self._period

    def _step(self, now: float) -> None:
        samples, self._samples = newest(self._samples), []
        self._driven, self._fresh = self._fresh, False
        tick = self._pilot.step(now, samples, self._orders(now, self.tick))
        self._last = now
        self.tick = tick
        try:
            for link in self._sending:
                link.send(now, tick.command)
            for link in self._served:
                link.publish_tick(tick)
                link.poll(now)
        finally:
            # the tick whose command met a broken link is the one worth reading afterwards
            packets = self._packets()
            if self._recorder is not None:
                self._recorder.record(tick, packets)
        if self._pilot.learner is not None:
            self._pilot.learn(tick)

    def _packets(self) -> list[tuple[float, bytes]]:
        packets: list[tuple[float, bytes]] = []
        for link in self._carrying:
            packets += link.take_packets()
        return packets
