"""The link to a rudder drive on a line of its own: orders out at the drive's rate, its reports in."""

from __future__ import annotations

import math
from typing import NamedTuple

from autopilot.links.base import AlarmNews, HelmNews, LinkError, SilentLink, Transport
from autopilot.links.drives.base import SILENT_S, Counted, Drive
from autopilot.links.release import PATIENCE_S, Release, ReleaseState, not_held
from autopilot.links.rudder_follow import RELEASE_SPACING_S, FollowSettings, RudderFollow, StandingOrder
from autopilot.signals import HelmCause, RudderCommand, RudderSample, Sample

BITS_PER_BYTE = 10


class DriveLinkSettings(NamedTuple):
    """baud of the line, rate [Hz] of orders and requests, and how closely the rudder must follow."""

    baud: int = 38400
    rate: float = 20.0
    follow: FollowSettings = FollowSettings()


class DriveLink(SilentLink):
    """A `Link` that steers and, where the drive has feedback, sees the rudder; it knows no heading."""

    def __init__(self, transport: Transport, drive: Drive, settings: DriveLinkSettings = DriveLinkSettings()) -> None:  # noqa: B008
        self.name = transport.name
        self.drive = drive
        self._transport = transport
        self._settings = settings
        self._seconds_per_byte = BITS_PER_BYTE / settings.baud
        self._follow = RudderFollow(settings.follow)
        self._order = StandingOrder(1.0 / settings.rate, RELEASE_SPACING_S)
        self._line_free = -math.inf
        self._helm, self._warning = HelmNews(self.name), AlarmNews(self.name)
        self._leaving, self._patient_until = math.nan, math.nan
        self._has_ordered = self._is_gone = False

    def fileno(self) -> int:
        """Return the transport's descriptor, or -1."""
        return self._transport.fileno()

    def receive(self, now: float) -> list[Sample]:
        """Return what the drive reports; LinkError when the transport is gone."""
        samples: list[Sample] = []
        for chunk in self._arrived():
            for angle in self.drive.feed(now, chunk):
                samples.append(RudderSample(now, angle, not self.drive.measures, self.drive.name))
                if self.drive.measures:
                    self._follow.measured(now, angle, self.drive.name)
        reason = self._follow.reason(now)
        if self._follow.cause is not HelmCause.STOOD_STILL:  # after which a drive has seemed silent
            reason = self._fault(now) or reason
        samples += self._helm.of(now, reason, self._follow.cause)
        return samples + self._warning.of(now, self.drive.warning(now))

    def _fault(self, now: float) -> str:
        """Return why the drive cannot steer; one that has just been spoken to for the first time may yet answer."""
        if math.isnan(self._patient_until):
            self._patient_until = now + SILENT_S
        fault = self.drive.fault(now)
        if not fault:
            self._patient_until = -math.inf
        return f"waiting for the {self.drive.name} to answer" if fault and now <= self._patient_until else fault

    def send(self, now: float, command: RudderCommand) -> None:
        """Take the newest command, and send it when the drive's turn has come; not engaged is a release."""
        angle = self._order.take(now, command)
        if angle is None:
            self._follow.released()
        else:
            self._has_ordered = True
            self._follow.ordered(now, angle)
        self._push(now)

    def poll(self, now: float) -> None:
        """Send what is due: the order, the releases that are left, a request."""
        self._push(now)
        if now >= self._line_free:
            self._write(now, self.drive.ask(now))

    def release(self, now: float) -> None:
        """Give the rudder back, several times over; never raises."""
        self._leaving = now
        for _ in range(self._order.end()):
            try:
                self._transport.send(self.drive.release(now))
            except LinkError:
                self._is_gone = True  # the drive stops by its own timeout
                break

    def release_result(self, now: float) -> Release | None:
        """Return what became of the rudder after `release`, None while the drive may still show it."""
        if not self._has_ordered:
            return not_held(self.name)
        usage = self.drive.usage() if isinstance(self.drive, Counted) else ""
        if self._is_gone:
            return Release(self.name, ReleaseState.LOST, lapse=self.drive.lapse, usage=usage)
        if self.drive.has_released():
            return Release(self.name, ReleaseState.CONFIRMED, f"the {self.drive.name}", usage=usage)
        waited = now - self._leaving
        if waited > PATIENCE_S:
            return Release(self.name, ReleaseState.UNCONFIRMED, waited=waited, lapse=self.drive.lapse, usage=usage)
        if now >= self._line_free:
            try:
                self._write(now, self.drive.ask(now))
            except LinkError:
                self._is_gone = True
        return None

    def close(self) -> None:
        """Close the transport; call `release` first."""
        self._transport.close()

    def _arrived(self) -> list[bytes]:
        try:
            return self._transport.receive()
        except LinkError:
            self._is_gone = True
            raise

    def _push(self, now: float) -> None:
        if now >= self._line_free:
            self._order.send(now, lambda angle: self._write(now, self._telegram(now, angle)))

    def _telegram(self, now: float, angle: float | None) -> bytes:
        return self.drive.release(now) if angle is None else self.drive.order(now, angle)

    def _write(self, now: float, data: bytes) -> bool:
        if not data or not self._transport.send(data):
            return False
        self._line_free = now + len(data) * self._seconds_per_byte
        return True
