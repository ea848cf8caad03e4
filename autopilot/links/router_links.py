"""The router's ends: the flight controller's transport with a tap on it, and links to ground stations behind us."""

from __future__ import annotations

from collections import deque

from pymavlink.dialects.v20.ardupilotmega import MAVLINK_MSG_ID_HEARTBEAT

from autopilot.links.admission import Budget, Door, Doors, Presence, strangers_of
from autopilot.links.base import LinkError, Transport
from autopilot.links.mavlink_codec import is_mavlink
from autopilot.links.mavlink_frames import Framer, source_of
from autopilot.links.router import OWN_COMPONENT, Router
from autopilot.links.signing import LinkSigning, identity_of
from autopilot.links.url import believe_signed
from autopilot.signals import AlarmEvent, AlarmSample, Mode, RudderCommand, Sample

FRAMES_PER_TURN = 200
"""Frames of one ground station passed on in one turn of the loop; what a flood brings beyond them is dropped."""
BYTES_PER_TURN = 16_000
NETWORK_BYTES_S = 200_000.0
BURST_S = 0.5
LINE_SHARE = 0.5
"""Of a serial line to the flight controller, for all ground stations together: our steering needs the rest."""
BITS_A_BYTE = 10
PACKETS_KEPT = 5000


def budget_for(baud: int) -> Budget:
    """Return what ground stations may send to a flight controller on a line of `baud`, 0 for a network."""
    rate = LINE_SHARE * baud / BITS_A_BYTE if baud else NETWORK_BYTES_S
    return Budget(rate, rate * BURST_S)


class RoutedTransport:
    """A flight controller's transport that shows the router what comes in and what we send ourselves.

    signing: what is not signed with our key is not passed on.
    """

    def __init__(self, inside: Transport, router: Router, signing: LinkSigning | None = None) -> None:
        self.inside = inside
        self.name = inside.name
        self.is_stream = inside.is_stream
        self.is_local = inside.is_local
        self._router = router
        self._framer = Framer(inside.is_stream)
        # an observer: whoever reads the transport judges the same frames again
        self._judge = signing.observer() if signing is not None else None
        self._number = router.join(self._forwarded, has_vehicle=True)

    def fileno(self) -> int:
        """Return the descriptor of the transport inside."""
        return self.inside.fileno()

    def receive(self) -> list[bytes]:
        """Return what waits, unchanged; the router has seen it. Raises LinkError."""
        chunks = self.inside.receive()
        for chunk in chunks:
            for frame in self._framer.frames(chunk):
                if self._judge is None or not self._judge.refuses(frame):
                    self._router.take(self._number, frame)
        return chunks

    def send(self, data: bytes) -> bool:
        """Send a packet of our own; what is for everybody the router shows to ground stations. Raises LinkError."""
        sent = self.inside.send(data)
        if source_of(data).component == OWN_COMPONENT:
            self._router.show_own(self._number, data)
        return sent

    def _forwarded(self, frame: bytes) -> bool:
        """A broken line is told by the next `receive` or `send`, not to the ground station's link."""
        try:
            return self.inside.send(frame)
        except LinkError:
            return False

    def forget_peer(self) -> None:
        """Pass on."""
        self.inside.forget_peer()

    def close(self) -> None:
        """Leave the router, and pass on."""
        self._router.leave(self._number)
        self.inside.close()


class ForwardLink:
    """A `Link` to a ground station that sees the flight controller through us. It brings no samples, moves no rudder.

    budget: shared by all such links of a flight controller.  door: which system ids are heard; None: all.

    Attributes:
        takes_orders: whether all that a station says is passed on; else it only looks.
        lost: why the line is gone, '' while it is there; steering goes on without it.
        dropped: frames beyond what a turn or the budget allows.
    """

    def __init__(
        self,
        transport: Transport,
        router: Router,
        budget: Budget,
        signing: LinkSigning | None = None,
        door: Door | None = None,
    ) -> None:
        self.name = transport.name
        self.dropped = 0
        self._transport = transport
        self._router = router
        self._budget = budget
        self._signing = signing
        self._door = door or Doors().link()
        self.takes_orders = self._door.takes_orders(transport, signing is not None)
        self._framer = Framer(transport.is_stream)
        self._number = router.join(self._sent)
        self._packets: deque[tuple[float, bytes]] = deque(maxlen=PACKETS_KEPT)
        self.lost: AlarmEvent | None = None
        self._presence = Presence(transport)
        believe_signed(transport, signing, self._door.hears)

    def fileno(self) -> int:
        """Return the transport's descriptor, or -1."""
        return -1 if self.lost or self._door.crowded else self._transport.fileno()

    def receive(self, now: float) -> list[Sample]:
        """Pass on what has arrived by `now` [s]. Nothing comes of it but word of a station that is lost or silent."""
        self._router.now = now
        if self.lost or self._door.crowded:
            return []
        strangers = strangers_of(self._transport)
        try:
            chunks = self._transport.receive()
        except LinkError as error:
            self.lost = AlarmEvent("forwarding_ended", str(error))
            return [AlarmSample(now, self.lost, self.name), *self._presence.gone(now)]
        taken, room = 0, BYTES_PER_TURN
        for chunk in chunks:
            frames = self._framer.frames(chunk[:room])
            room = max(0, room - len(chunk))
            for frame in frames:
                taken += 1
                if taken > FRAMES_PER_TURN or not self._budget.spend(now, len(frame)):
                    self.dropped += 1
                elif not self._door.lets_in_system(source_of(frame).system):
                    continue
                elif (self._signing is None or not self._signing.refuses(frame)) and (
                    self.takes_orders or self._door.passes_on(frame)
                ):
                    self._presence.heard(now, identity_of(frame) == MAVLINK_MSG_ID_HEARTBEAT)
                    if is_mavlink(frame):  # the log's readers know no other messages
                        self._packets.append((now, frame))
                    self._router.take(self._number, frame)
        self._door.count_strangers(strangers_of(self._transport) - strangers)
        self._door.crowded = self._door.crowded or taken > FRAMES_PER_TURN or not room
        return self._presence.update(now)

    def send(self, now: float, command: RudderCommand) -> None:
        """Do nothing: the rudder is elsewhere."""

    def tell(self, now: float, mode: Mode, alarms: tuple[AlarmEvent, ...]) -> None:
        """Say nothing: what is wrong goes out as STATUSTEXT over the flight controller's link, which is shown here.

        A station that floods us has been looked away from since; a tick has passed, it may wake the loop again.
        """
        self._door.crowded = False

    def keep(self, now: float) -> None:
        """Do nothing: what we say goes out over the flight controller's link."""

    def release(self, now: float) -> None:
        """Do nothing."""

    def take_packets(self) -> list[tuple[float, bytes]]:
        """Return and forget the frames that came from the ground station since the last call."""
        packets = list(self._packets)
        self._packets.clear()
        return packets

    def close(self) -> None:
        """Leave the router, and close the transport."""
        self._router.leave(self._number)
        self._transport.close()

    def _sent(self, frame: bytes) -> bool:
        try:
            return not self.lost and self._transport.send(frame)
        except LinkError:
            return False
