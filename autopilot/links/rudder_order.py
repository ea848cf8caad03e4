"""A rudder order on a link: renewed, followed by the rudder, and given back. Pure.

Time in which the rudder is off its order by more than `tolerance` and does not move towards it fills a bucket;
time in which it is right, or on its way, empties it. A full bucket is a rudder that does not follow:

    bucket' = 1 while |order - angle| > tolerance and the rudder moves slower towards it than a third of its rate
    bucket' = -1 otherwise, never below 0;  disobeyed at bucket > FOLLOW_PATIENCE + delay

A bucket, not a timer: a stuck rudder is right for an instant whenever a swinging order crosses it. An order may reach
the gear at any time until the next one is sent, so an angle is held against that of the last two which explains it
better; of a burst of angles that was read at once, and has one time, the last counts.

What is still to be said to a rudder drive: the newest order while it is renewed, or the releases that are left.

What became of the rudder when it was given back: the result as a value, and its sentence.
A release that was sent is not yet one that arrived: a socket that closes at once loses what the other side has not
worked off. So the way out keeps each link open until the vehicle or drive shows that it has let go, or time is over.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from enum import Enum
from typing import NamedTuple

from autopilot.signals import HelmCause, RudderCommand

FOLLOW_PATIENCE_S = 2.5
"""Beyond that of the pilot's own rudder watch by more than this computer can stand still between two of its looks, so
that a rudder that sticks is the fail-safe. A link's watch is for what that one does not see: the sensors that are not
selected, and the rudder while a fail-safe steers."""
PROGRESS_SHARE = 0.3
ASSUMED_RATE = math.radians(5.0)
"""A steering gear of unknown rate is asked for a share of this [rad/s]."""
LONGEST_GAP_S = 1.0
"""Between two reports further apart than this nobody can say what the rudder did."""
FORGIVEN_S = 2.0
"""This long after our last order a rudder that did not obey may be tried again."""


class FollowSettings(NamedTuple):
    """tolerance [rad]; rate [rad/s] of the gear, inf where unlimited; delay [s]: dead time and lag together.

    patience [s]: how long the drive may be left without an order while we steer.
    """

    tolerance: float = math.radians(5.0)
    rate: float = math.inf
    delay: float = 0.0
    patience: float = math.inf


class RudderFollow:
    """Compares orders with measured angles; `reason` gives the sentence, or nothing where the rudder obeys."""

    def __init__(self, settings: FollowSettings = FollowSettings()) -> None:  # noqa: B008
        self._settings = settings
        rate = settings.rate if math.isfinite(settings.rate) else ASSUMED_RATE
        self._progress = PROGRESS_SHARE * min(rate, ASSUMED_RATE)
        self._order: float | None = None
        self._before_it = 0.0
        self._order_time = math.nan
        self._seen: tuple[float, float] | None = None
        self._bucket = 0.0
        self._earlier: tuple[tuple[float, float] | None, float] = None, 0.0
        """What was seen, and in the bucket, before the newest time."""
        self._shown = ""
        self._disobeyed = ""
        self._stood_still = 0.0

    def ordered(self, now: float, angle: float) -> None:
        """Take an order [rad] as it was sent at `now` [s]."""
        self._before_it = angle if self._order is None else self._order
        self._order, self._order_time = angle, now

    def released(self) -> None:
        """Take note that the rudder is not ours now."""
        self._order, self._seen, self._bucket, self._stood_still = None, None, 0.0, 0.0

    @property
    def cause(self) -> HelmCause:
        """What kind the reason given last is of."""
        return HelmCause.STOOD_STILL if self._stood_still else HelmCause.TAKEN

    def measured(self, now: float, angle: float, source: str) -> None:
        """Compare an `angle` [rad] of `source`, measured at `now` [s], with the order in force."""
        if self._seen is None or now != self._seen[0]:
            self._earlier = self._seen, self._bucket
        before, self._bucket = self._earlier
        self._seen = (now, angle)
        if self._order is None or before is None:
            return
        elapsed = now - before[0]
        if not 0.0 < elapsed <= LONGEST_GAP_S:
            return
        is_right = False
        for each in (self._before_it, self._order):
            moved = math.copysign(1.0, each - angle) * (angle - before[1])
            is_right = is_right or abs(each - angle) <= self._settings.tolerance or moved >= self._progress * elapsed
        self._bucket = max(self._bucket + (-elapsed if is_right else elapsed), 0.0)
        self._shown = (
            f"{source} shows {math.degrees(angle):.1f} deg while {math.degrees(self._order):.1f} deg is ordered"
        )

    def reason(self, now: float) -> str:
        """Return why the rudder cannot be steered at `now` [s]; empty where it obeys or nobody shows its angle.

        Orders that stayed away for too long stay a reason until the rudder is released.
        """
        gap = now - self._order_time
        if self._order is not None and not self._stood_still and gap > self._settings.patience:
            self._stood_still, self._bucket = gap, 0.0
        if self._stood_still:
            return f"this computer stood still for {self._stood_still:.1f} s: nobody looked after the rudder"
        if self._bucket > FOLLOW_PATIENCE_S + self._settings.delay and not self._disobeyed:
            self._disobeyed = f"the rudder does not follow: {self._shown}; check drive, clutch, fuse and rudder sensor"
        if self._disobeyed and self._order is None and now - self._order_time > FORGIVEN_S:
            self._disobeyed = ""
        return self._disobeyed


RELEASES = 5
"""A release is said so often: one telegram may be lost, and nothing follows that would mend it."""
RELEASE_SPACING_S = 0.1
ORDER_AGE_S = 1.0
"""An order that is not renewed for this long is no longer repeated: whoever gave it has stopped, and the drive stops by
its own timeout."""


class StandingOrder:
    """The order of a drive link, said every `order_period` [s]; after it a release, every `release_period` [s]."""

    def __init__(self, order_period: float, release_period: float) -> None:
        self._order_period, self._release_period = order_period, release_period
        self._angle: float | None = None
        self._given = math.nan
        self._next_order = self._next_release = -math.inf
        self._releases_left = 0

    @property
    def angle(self) -> float | None:
        """The rudder ordered [rad], or None after a release."""
        return self._angle

    def take(self, now: float, command: RudderCommand) -> float | None:
        """Take the newest command and return `angle`; one that is not engaged, or not finite, is a release."""
        if command.engaged and math.isfinite(command.angle):
            self._angle, self._given, self._releases_left = command.angle, now, RELEASES
        else:
            self._angle = None
        return self._angle

    def send(self, now: float, write: Callable[[float | None], bool]) -> None:
        """Call `write` with the order, or with None for a release, where one is due.

        A release that `write` could not pass on (False) stays to be said; an order does not, a newer one follows.
        """
        if self._angle is not None and now - self._given <= ORDER_AGE_S:
            if now >= self._next_order:
                self._next_order = now + self._order_period
                write(self._angle)
        elif self._angle is None and self._releases_left and now >= self._next_release:
            self._next_release = now + self._release_period
            self._releases_left -= write(None)

    def end(self) -> int:
        """Forget the order and return how many releases are to be said at once: none where none is owed."""
        owed = max(self._releases_left, 1) if self._angle is not None or self._releases_left else 0
        self._angle, self._releases_left = None, 0
        return owed


PATIENCE_S = 1.0
"""What is shown at all is shown within this time, and a few reports more."""
REPORTS = 5
LONGEST_PERIOD_S = 0.5
"""Reports that come more seldom are not waited for."""
WAYS = 3
"""Where a stick stands as the last order did, the release goes the way to the vehicle and back, then a mark that tells
the two apart, then its release."""
SLOWEST_WAY_S = 1.0
"""Over a slower one nobody steers."""
LONGEST_S = PATIENCE_S + REPORTS * LONGEST_PERIOD_S + WAYS * SLOWEST_WAY_S
LEAVING_S = 0.3
"""What was sent has left, and was worked off at the other end, after this."""


class ReleaseState(Enum):
    """How far it is known that the rudder is free."""

    NOT_HELD = "not held"
    CONFIRMED = "confirmed"
    UNCONFIRMED = "unconfirmed"
    UNSHOWN = "nothing on this link shows it"
    LOST = "the line is gone"


class Release(NamedTuple):
    """What became of the rudder of one link.

    link: its URL.  shown_by: the report that confirmed it.  waited [s]: for a report that did not come.
    lapse: what ends the last order without us, a clause such as "the flight controller lets go by itself ...".
    usage: what the drive has done, a clause.
    """

    link: str
    state: ReleaseState
    shown_by: str = ""
    waited: float = 0.0
    lapse: str = ""
    usage: str = ""

    @property
    def sentence(self) -> str:
        """Return what a person reads, without a full stop."""
        return f"{self._state_words}; {self.usage}" if self.usage else self._state_words

    @property
    def _state_words(self) -> str:
        behind = f": {self.lapse}" if self.lapse else ""
        if self.state is ReleaseState.NOT_HELD:
            return "rudder not held"
        if self.state is ReleaseState.CONFIRMED:
            return f"rudder released, confirmed by {self.shown_by}"
        if self.state is ReleaseState.UNCONFIRMED:
            return f"rudder released, not confirmed in {self.waited:.1f} s{behind}"
        if self.state is ReleaseState.UNSHOWN:
            return f"rudder released{behind}"
        return f"rudder not released, the line is gone{behind}"


def release_sentence(releases: Iterable[Release]) -> str:
    """Return one sentence for all links of a run; each is named where more than one held a rudder."""
    held = [release for release in releases if release.state is not ReleaseState.NOT_HELD]
    if len(held) == 1:
        return held[0].sentence
    return "; ".join(f"{release.link}: {release.sentence}" for release in held) or "rudder not held"


class UnshownRelease:
    """The release of a rudder that no report on the link shows, only that it left. Times in seconds.

    lapse: what ends the last order without us, a clause.
    """

    def __init__(self, link: str, lapse: str) -> None:
        self._link, self._lapse = link, lapse
        self._leaving = -math.inf
        self._is_gone = False
        self.has_ordered = False

    def asked(self, now: float, is_gone: bool) -> None:
        """Take the releases as they were sent; `is_gone`: they could not be."""
        self._leaving, self._is_gone = now, is_gone

    def result(self, now: float) -> Release | None:
        """Return what became of the rudder, None while what was sent is still on its way."""
        if not self.has_ordered:
            return not_held(self._link)
        if self._is_gone:
            return Release(self._link, ReleaseState.LOST, lapse=self._lapse)
        if now - self._leaving < LEAVING_S:
            return None
        return Release(self._link, ReleaseState.UNSHOWN, lapse=self._lapse)


def not_held(link: str) -> Release:
    """Return what a link says that had no rudder in its hand."""
    return Release(link, ReleaseState.NOT_HELD)
