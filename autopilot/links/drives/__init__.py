"""Rudder drives on serial lines of their own: one line each in DRIVES.

A drive is its protocol, without the line itself: bytes and times in, bytes and what the drive reports out, pure.
`DriveLink` is the link to one on its line: orders out at the drive's rate, its reports in.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from importlib import import_module
from typing import NamedTuple, cast

from autopilot.links.base import AlarmNews, CarriedLink, HelmNews, LinkError, Transport
from autopilot.links.rudder_order import (
    LONGEST_GAP_S,
    PATIENCE_S,
    RELEASE_SPACING_S,
    FollowSettings,
    Release,
    ReleaseState,
    RudderFollow,
    StandingOrder,
    not_held,
)
from autopilot.models.steering_gear import Valve
from autopilot.signals import AlarmEvent, HelmCause, RudderCommand, RudderSample, Sample

SILENT_S = 1.5
"""A drive that answers requests and has not been heard for this long is gone."""
EXCUSED_S = 0.5
"""So long a drive has to answer again when this computer has stood still."""
JUMP_LEAST = math.radians(2.0)
JUMP_RATES = 1.5
WAIT_S = 0.3
"""An answer later than this is none; what comes after it is dropped until the next request."""
QUIET_S = 0.05
POLOLU = 0xAA
"""The first byte of a command in the Pololu protocol."""
STALL_S = 1.0
"""Current above the limit for this long is a stall, not the start of the motor."""


class DriveSettings(NamedTuple):
    """What the drive's scale means, and what it may draw.

    angle_at_full [rad]: rudder angle from amidships to the end of the scale -1 ... 1.  amidships: where the rudder
    is amidships on that scale.  reversed: the scale rises to the other side.  rate [rad/s]: of the steering gear.
    stop [rad]: end stop each side.  current_max [A], None: unknown.  channel: servo output of a Maestro.
    device: number in the Pololu protocol, None: compact protocol.  dead_band [rad]: least error that the gear is moved
    for.  order_rate_hz: how often it is ordered.  valve, sensor_channel: of on/off valves, None: no sensor.
    """

    angle_at_full: float
    amidships: float = 0.0
    reversed: bool = False
    rate: float = math.inf
    stop: float = math.inf
    current_max: float | None = None
    channel: int = 0
    device: int | None = None
    dead_band: float = 0.0
    order_rate_hz: float = 20.0
    valve: Valve | None = None
    sensor_channel: int | None = None

    def place(self, angle: float) -> float:
        """Return the place on the scale -1 ... 1 of a rudder angle [rad], not beyond its end stop."""
        angle = min(max(angle, -self.stop), self.stop)
        share = angle / self.angle_at_full
        return min(max(self.amidships + (-share if self.reversed else share), -1.0), 1.0)

    def angle(self, place: float) -> float:
        """Return the rudder angle [rad] at a place on the scale."""
        share = place - self.amidships
        return (-share if self.reversed else share) * self.angle_at_full

    def pololu(self, command: int, *data: int) -> bytes:
        """Return a command of Pololu's controllers; with a device number, the byte loses its top bit behind it."""
        if self.device is None:
            return bytes((command, *data))
        return bytes((POLOLU, self.device, command & 0x7F, *data))


class JumpGate:
    """Angles of a rudder that cannot jump: one further off than the gear can have moved needs a second that agrees.

    A checksum of eight bits, or none, lets wrong values through; two in a row that agree are rare.
    """

    def __init__(self, settings: DriveSettings) -> None:
        self._rate = JUMP_RATES * (settings.rate if math.isfinite(settings.rate) else settings.angle_at_full)
        self._last: tuple[float, float] | None = None
        self._jumps: tuple[float, float] | None = None

    def passes(self, now: float, angle: float) -> bool:
        """Return whether `angle` [rad], seen at `now` [s], may be believed."""
        if self._last is None or self._is_near(self._last, now, angle):
            accepted = True
        else:
            accepted = self._jumps is not None and self._is_near(self._jumps, now, angle)
        if accepted:
            self._last, self._jumps = (now, angle), None
        else:
            self._jumps = (now, angle)
        return accepted

    def _is_near(self, before: tuple[float, float], now: float, angle: float) -> bool:
        return abs(angle - before[1]) <= JUMP_LEAST + self._rate * max(now - before[0], 0.0)


class Drive(ABC):
    """Speaks to one kind of drive. Time is an argument, nothing here waits or raises.

    Attributes:
        name: for messages.  lapse: what ends the last order without us, a clause.  measures: whether the angles it
        returns are those of the rudder, or only the command to the drive.  rejected: packets and answers dropped
        because they could not be right.
    """

    name: str
    lapse: str
    measures = True

    def __init__(self, settings: DriveSettings) -> None:
        self.rejected = 0
        self._settings = settings
        self._buffer = b""
        self._received = -math.inf
        self._has_released = False

    @abstractmethod
    def feed(self, now: float, data: bytes) -> list[float]:
        """Return the rudder angles [rad] that `data` reports."""

    @abstractmethod
    def order(self, now: float, angle: float) -> bytes:
        """Return the bytes that order `angle` [rad]; called at the drive's rate while it is ours."""

    @abstractmethod
    def release(self, now: float) -> bytes:
        """Return the bytes that give the rudder back."""

    def has_released(self) -> bool:
        """Return whether the drive has reported, since the last `release`, that it has let the rudder go."""
        return self._has_released

    def ask(self, now: float) -> bytes:
        """Return the request that falls due at `now` [s]; nothing where none does."""
        return b""

    def fault(self, now: float) -> str:
        """Return why the drive cannot turn the rudder; empty where it can."""
        if now - self._received > SILENT_S:
            return f"the {self.name} does not answer; check its power, line, baud rate and drive.device"
        return ""

    def warning(self, now: float) -> AlarmEvent | None:
        """Return what the skipper should know of the drive though it steers; None when all is well."""
        return None

    def usage(self) -> str:
        """Return what the drive counts that wears it out, a clause; empty where there is nothing to say."""
        return ""


class AskedDrive(Drive):
    """A `Drive` of Pololu's, as far as it is asked: one request at a time, whose answer has neither frame nor checksum,
    so that it is believed by its length, its time and what it says."""

    def __init__(self, settings: DriveSettings) -> None:
        super().__init__(settings)
        self._expected = 0
        """Bytes of the answer that is waited for."""
        self._asked_time = math.nan

    @abstractmethod
    def _request(self) -> tuple[bytes, int]:
        """Return the next request, and how many bytes answer it."""

    @abstractmethod
    def _answered(self, now: float, answer: bytes) -> list[float] | None:
        """Return the rudder angles [rad] in the answer to the last request; None where it cannot be right."""

    def feed(self, now: float, data: bytes) -> list[float]:
        """Return the rudder angles [rad] in the answer that `data` completes."""
        if not self._expected or now - self._asked_time > WAIT_S:
            self.rejected += bool(data)
            self._buffer = b""
            return []
        self._buffer += data
        size = self._expected
        if len(self._buffer) < size:
            return []
        answer, self._buffer, self._expected = self._buffer, b"", 0
        angles = self._answered(now, answer) if len(answer) == size else None
        if angles is None:
            self.rejected += 1
            return []
        self._received = now
        return angles

    def ask(self, now: float) -> bytes:
        """Return the next request once the last was answered or is overdue."""
        if self._expected and now - self._asked_time <= WAIT_S + QUIET_S:
            return b""
        self.rejected += bool(self._expected)
        self._buffer, self._asked_time = b"", now
        request, self._expected = self._request()
        return request


class StallWatch:
    """Motor current above a limit for longer than a motor takes to start."""

    def __init__(self, limit: float | None) -> None:
        self._limit = limit
        self._since: float | None = None
        self._reported: AlarmEvent | None = None
        self.current = 0.0

    def take(self, now: float, current: float) -> None:
        """Take a measured current [A]."""
        self.current = current
        if self._limit is None or current <= self._limit:
            self._since, self._reported = None, None
        elif self._since is None:
            self._since = now

    def warning(self, now: float) -> AlarmEvent | None:
        """Return the alarm of a stalled motor, or None."""
        if self._since is not None and now - self._since >= STALL_S and not self._reported:
            # said once with one figure: a detail that changes with every reading is a new alarm each time
            drawn = f"{self.current:.1f} A, more than drive.current_max_a ({self._limit:g})"
            self._reported = AlarmEvent("motor_current", drawn)
        return self._reported


BITS_PER_BYTE = 10


class DriveLinkSettings(NamedTuple):
    """baud of the line, rate [Hz] of orders and requests, and how closely the rudder must follow."""

    baud: int = 38400
    rate: float = 20.0
    follow: FollowSettings = FollowSettings()


class DriveLink(CarriedLink):
    """A `Link` that steers and, where the drive has feedback, sees the rudder; it knows no heading."""

    def __init__(self, transport: Transport, drive: Drive, settings: DriveLinkSettings = DriveLinkSettings()) -> None:  # noqa: B008
        super().__init__(transport)
        self.drive = drive
        self._settings = settings
        self._seconds_per_byte = BITS_PER_BYTE / settings.baud
        self._follow = RudderFollow(settings.follow)
        self._order = StandingOrder(1.0 / settings.rate, RELEASE_SPACING_S)
        self._line_free = -math.inf
        self._helm, self._warning = HelmNews(self.name), AlarmNews(self.name)
        self._leaving, self._patient_until = math.nan, math.nan
        self._looked, self._excused_until, self._said = math.nan, -math.inf, ""
        self._has_ordered = self._is_gone = False

    def receive(self, now: float) -> list[Sample]:
        """Return what the drive reports; LinkError when the transport is gone."""
        samples: list[Sample] = []
        if now - self._looked > LONGEST_GAP_S and now > self._excused_until + SILENT_S:
            self._excused_until = now + EXCUSED_S
        self._looked = now
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
        """Return why the drive cannot steer; one that has just been spoken to for the first time may yet answer, and
        one that nobody spoke to for a while has had nothing to answer: what it said last stands."""
        if math.isnan(self._patient_until):
            self._patient_until = now + SILENT_S
        fault = self.drive.fault(now)
        if not fault:
            self._patient_until = -math.inf
        if self._patient_until == -math.inf and now <= self._excused_until:
            return self._said
        self._said = fault
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
        usage = self.drive.usage()
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

    def _arrived(self) -> list[bytes]:
        try:
            return self._transport.receive()
        except LinkError:
            self._is_gone = True
            raise

    def _push(self, now: float) -> None:
        def write(angle: float | None) -> bool:
            return self._write(now, self.drive.release(now) if angle is None else self.drive.order(now, angle))

        if now >= self._line_free:
            self._order.send(now, write)

    def _write(self, now: float, data: bytes) -> bool:
        if not data or not self._transport.send(data):
            return False
        self._line_free = now + len(data) * self._seconds_per_byte
        return True


class DriveKind(NamedTuple):
    """A kind of drive: its module in this room and its class, and an example of its URLs."""

    place: str
    example: str


DRIVES = {
    "pypilot": DriveKind("pypilot_motor.PypilotMotor", "pypilot:/dev/ttyUSB2:38400"),
    "jrk": DriveKind("jrk.JrkG2", "jrk:/dev/ttyACM0:115200"),
    "maestro": DriveKind("maestro.Maestro", "maestro:/dev/ttyACM0:115200"),
    "valve": DriveKind("maestro.ValveDrive", "valve:/dev/ttyACM0:115200"),
}
"""Kinds of drives by the beginning of their URLs; only the one that is used is loaded."""


def drive_of(kind: str, settings: DriveSettings) -> Drive:
    """Return the protocol of a kind of drive."""
    module, _, name = DRIVES[kind].place.partition(".")
    return cast(Drive, getattr(import_module(f"{__name__}.{module}"), name)(settings))
