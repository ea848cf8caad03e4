"""The link to an NMEA 2000 bus: heading, rate, roll and rudder in, rudder order and heading control out.

Needs the extra `n2k`: python-can moves the frames, the package nmea2000 encodes ours; `n2k_messages` reads the others'.

    127250 vessel heading   127251 rate of turn   127245 rudder   127237 heading/track control   127257 attitude
     60928 ISO address claim: the node with the lower name keeps a contested address

Source: field names of the canboat project's PGN database (https://canboat.github.io/canboat/), which the encoder uses;
address claim after SAE J1939-81.
"""

from __future__ import annotations

import logging
import math
import struct
from collections.abc import Callable
from typing import Any, NamedTuple

from autopilot.links.base import LinkError, SilentLink
from autopilot.links.n2k_messages import (
    ATTITUDE,
    HEADING,
    RATE_OF_TURN,
    RUDDER,
    Compass,
    decoded,
    group_and_source,
    identifier,
    is_heading,
    own_variation,
    sample_of,
)
from autopilot.links.north import UnusableHeadings
from autopilot.links.release import Release, UnshownRelease
from autopilot.links.rudder_follow import FollowSettings, RudderFollow, StandingOrder
from autopilot.signals import (
    HeadingSample,
    HelmSample,
    Mode,
    OrderKind,
    RudderCommand,
    RudderSample,
    Sample,
    Tick,
)

CONTROL = 127237
ADDRESS_CLAIM, REQUEST = 60928, 59904
READ = (HEADING, RATE_OF_TURN, RUDDER, ATTITUDE)
ADDRESS_LAST = 251
NO_ADDRESS = 254
NAME = 1 << 63 | 4 << 60 | 40 << 49 | 150 << 40 | 2046 << 21
"""Arbitrary address capable, marine, class 40 "steering and control surfaces", function 150 "autopilot", maker 2046
(none of the registered ones); the unique number comes below."""


class NodeAddress:
    """Our address on the bus: claimed at the start, defended against higher names, left to lower ones.

    `current` is NO_ADDRESS where every address was taken: then nothing may be sent but that.
    """

    def __init__(self, first: int = 204, unique: int = 1) -> None:
        self.current = first
        self.name = NAME | unique & 0x1FFFFF
        self._refused: set[int] = set()

    def claim(self) -> tuple[int, bytes]:
        """Return identifier and data of our claim."""
        return identifier(ADDRESS_CLAIM, self.current, 6), struct.pack("<Q", self.name)

    def on_frame(self, group: int, source: int, data: bytes) -> bool:
        """Take a claim or request of another node; return whether we have to claim (again)."""
        if group == REQUEST and len(data) >= 3:
            return int.from_bytes(data[:3], "little") == ADDRESS_CLAIM
        if group != ADDRESS_CLAIM or source != self.current or len(data) != 8:
            return False
        (name,) = struct.unpack("<Q", data)
        if name > self.name:
            return True
        self._refused.add(self.current)
        free = [address for address in range(128, ADDRESS_LAST + 1) if address not in self._refused]
        self.current = free[0] if free else NO_ADDRESS
        return True


FRAMES_MOST = 500
"""Frames taken in one `receive`, so that a busy bus cannot hold the loop."""
ORDER_PERIOD_S = 0.1
CONTROL_PERIOD_S = 0.25
LAPSE = "nothing on the bus confirms it; the drive lets go by itself when no more orders come"
EXTRA = "install Norrbin with its extra n2k: pip install '.[n2k]'"


class N2kSettings(NamedTuple):
    """heading_latency [s]; variation [rad], None to take it from the bus; whether rudder orders leave; follow;
    magnetic: whether magnetic courses are steered."""

    heading_latency: float = 0.0
    variation: float | None = None
    steers: bool = True
    follow: FollowSettings = FollowSettings()
    magnetic: bool = False


def open_bus(text: str, interface: str, channel: str) -> Any:
    """Return python-can's bus of `interface` and `channel`. Raises LinkError with one sentence."""
    try:
        import can
    except ImportError as error:
        raise LinkError(f"link {text!r}: NMEA 2000 needs the package python-can; {EXTRA}") from error
    try:
        return can.Bus(interface=interface, channel=channel)
    except (can.CanError, OSError, ValueError, ImportError) as error:
        known = ", ".join(sorted(can.VALID_INTERFACES))
        raise LinkError(
            f"link {text!r}: the CAN bus cannot be opened: {error}; check that it is up "
            f"(ip link set {channel} up type can bitrate 250000) and that {interface} is one of {known}"
        ) from error


def encoder(name: str) -> tuple[Callable[[Any], Any], Any]:
    """Return encode and the message class of the package nmea2000. Raises LinkError."""
    try:
        import nmea2000
        from nmea2000.input_formats import N2KFormat
    except ImportError as error:
        raise LinkError(f"link {name!r}: NMEA 2000 needs the package nmea2000; {EXTRA}") from error
    logging.getLogger("nmea2000").setLevel(logging.CRITICAL)
    return nmea2000.create_encoder(N2KFormat.PYTHON_CAN).encode, nmea2000


class N2kLink(SilentLink):
    """A `Link` over NMEA 2000.

    Attributes:
        unsent: frames that the bus did not take.
    """

    def __init__(self, name: str, bus: Any, settings: N2kSettings = N2kSettings()) -> None:  # noqa: B008 - immutable
        self.name = name
        self.unsent = 0
        self.address = NodeAddress()
        self._bus = bus
        self._settings = settings
        self._encode, self._package = encoder(name)
        self._follow = RudderFollow(settings.follow)
        self._variation = settings.variation
        self._unusable = 0
        self._unusable_headings = UnusableHeadings(name)
        self._helm_reason: str | None = None
        self._order = StandingOrder(ORDER_PERIOD_S, ORDER_PERIOD_S)
        self._next_control = -math.inf
        self._is_claimed = False
        self._release = UnshownRelease(name, LAPSE)

    def fileno(self) -> int:
        """Return the bus's descriptor, or -1 where it has none (virtual)."""
        try:
            return int(self._bus.fileno())
        except (NotImplementedError, OSError):
            return -1

    def receive(self, now: float) -> list[Sample]:
        """Return the samples that have arrived; LinkError when the bus is gone."""
        samples: list[Sample] = []
        for _ in range(FRAMES_MOST):
            try:
                frame = self._bus.recv(timeout=0.0)
            except Exception as error:
                # python-can's drivers raise errors of their own beside its CanError
                raise LinkError(f"{self.name}: the CAN bus is gone: {error}; plug it in and start again") from error
            if frame is None:
                break
            if frame.is_extended_id and not frame.is_error_frame and not frame.is_remote_frame:
                self._take(now, frame, samples)
        samples += self._unusable_headings.news(now, samples, self._unusable)
        reason = self._follow.reason(now)
        if reason != self._helm_reason and (self._settings.steers or reason or self._helm_reason):
            self._helm_reason = reason
            samples.append(HelmSample(now, not reason, reason, self.name, self._follow.cause))
        return samples

    def _take(self, now: float, frame: Any, samples: list[Sample]) -> None:
        group, source = group_and_source(frame.arbitration_id)
        if group in (ADDRESS_CLAIM, REQUEST):
            if self.address.on_frame(group, source, bytes(frame.data)) and self._settings.steers:
                self._claim()
            return
        if group not in READ or source == self.address.current:
            return
        fields = decoded(group, bytes(frame.data))
        if group == HEADING and self._settings.variation is None:
            heard = own_variation(fields)
            self._variation = self._variation if heard is None else heard
        compass = Compass(self._variation, self._settings.magnetic)
        sample = sample_of(group, now, fields, compass, f"N2K{group}.{source}")
        self._unusable += sample is None and is_heading(group, fields)
        if isinstance(sample, HeadingSample):
            sample = sample._replace(time=now - self._settings.heading_latency)
        elif isinstance(sample, RudderSample):
            self._follow.measured(now, sample.angle, sample.source)
        if sample is not None:
            samples.append(sample)

    def send(self, now: float, command: RudderCommand) -> None:
        """Send the rudder order at its rate; one that is not engaged is a release."""
        angle = self._order.take(now, command)
        if angle is None:
            self._follow.released()
        else:
            self._follow.ordered(now, angle)
            self._release.has_ordered = self._release.has_ordered or self._settings.steers
        self._push(now)

    def poll(self, now: float) -> None:
        """Claim our address at the start, and send what is due."""
        if not self._is_claimed and self._settings.steers:
            self._is_claimed = True
            self._claim()
        self._push(now)

    def publish_tick(self, tick: Tick) -> None:
        """Send heading/track control at its rate."""
        if not self._settings.steers or tick.now < self._next_control or not tick.state.valid:
            return
        self._next_control = tick.now + CONTROL_PERIOD_S
        engaged = tick.mode is Mode.ENGAGED
        heads = engaged and tick.order.kind is OrderKind.HEADING and math.isfinite(tick.order.heading)
        fields: dict[str, object] = {
            "steeringMode": "Heading Control" if heads else "Main Steering",
            "headingReference": "Magnetic" if self._settings.magnetic else "True",
            "vesselHeading": tick.state.heading % math.tau,
        }
        if engaged:
            fields["commandedRudderAngle"] = tick.command.angle
        if heads:
            fields["headingToSteerCourse"] = tick.order.heading % math.tau
        self._transmit(CONTROL, fields)

    def release(self, now: float) -> None:
        """Give the rudder back, several times over; never raises."""
        for _ in range(self._order.end()):
            self._send_order(None)
        self._release.asked(now, is_gone=False)

    def release_result(self, now: float) -> Release | None:
        """Return what became of the rudder after `release`, None while it is on its way."""
        return self._release.result(now)

    def close(self) -> None:
        """Close the bus; call `release` first."""
        self._bus.shutdown()

    def _push(self, now: float) -> None:
        if self._settings.steers:
            self._order.send(now, self._send_order)

    def _send_order(self, angle: float | None) -> bool:
        fields: dict[str, object] = {"instance": 0, "directionOrder": "No Order"}
        if angle is not None:
            fields["directionOrder"] = "Move to starboard" if angle >= 0.0 else "Move to port"
            fields["angleOrder"] = angle
        self._transmit(RUDDER, fields)
        return True

    def _transmit(self, group: int, fields: dict[str, object]) -> None:
        if not self._settings.steers or self.address.current == NO_ADDRESS:
            return
        values = [self._package.NMEA2000Field(id=name, value=value) for name, value in fields.items()]
        message = self._package.NMEA2000Message(
            PGN=group, source=self.address.current, destination=255, priority=2, fields=values
        )
        for frame in self._encode(message):
            self._put(frame)

    def _claim(self) -> None:
        import can

        identity, data = self.address.claim()
        self._put(can.Message(arbitration_id=identity, data=data, is_extended_id=True))

    def _put(self, frame: Any) -> None:
        try:
            self._bus.send(frame, timeout=0.0)
        except Exception:
            # a full queue or a bus without another node: counted, and seen by a rudder that does not follow
            self.unsent += 1
