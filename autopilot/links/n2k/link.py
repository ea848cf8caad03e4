"""The link to an NMEA 2000 network: a session carried over a CAN bus (python-can, extra `n2k`) or through a gateway."""

from __future__ import annotations

from typing import Any

from autopilot.guidance.plotter import PlotterGuide
from autopilot.links.base import LinkError, Transport
from autopilot.links.n2k.fields import FAST
from autopilot.links.n2k.forms import LINE_END, Form
from autopilot.links.n2k.packets import Frame, Framing, Message
from autopilot.links.n2k.session import READ, Helm, N2kSession, N2kSettings
from autopilot.links.north import Variation
from autopilot.links.session_link import SessionLink

FRAMES_MOST = 500
"""Frames taken in one `receive`, so that a busy bus cannot hold the loop."""
EXTRA = "install Norrbin with its extra n2k: pip install '.[n2k]'"


def open_bus(text: str, interface: str, channel: str) -> Any:
    """Return python-can's bus of `interface` and `channel`. Raises LinkError with one sentence."""
    try:
        import can
    except ImportError as error:
        raise LinkError(f"link {text!r}: a CAN bus needs the package python-can; {EXTRA}") from error
    try:
        return can.Bus(interface=interface, channel=channel)
    except (can.CanError, OSError, ValueError, ImportError) as error:
        known = ", ".join(sorted(can.VALID_INTERFACES))
        raise LinkError(
            f"link {text!r}: the CAN bus cannot be opened: {error}; check that it is up "
            f"(ip link set {channel} up type can bitrate 250000) and that {interface} is one of {known}"
        ) from error


class BusLine:
    """A bus of python-can. `unsent`: frames that it did not take: its queue is full, or nobody else is there.

    is_node: whether Norrbin is the node of the network there.
    """

    is_node = True

    def __init__(self, name: str, bus: Any) -> None:
        from can import Message as CanFrame

        self.name, self.unsent = name, 0
        self._bus, self._make = bus, CanFrame
        self._framing = Framing(FAST, READ)

    def fileno(self) -> int:
        """Return the bus's descriptor, or -1 where it has none (virtual)."""
        try:
            return int(self._bus.fileno())
        except (NotImplementedError, OSError):
            return -1

    def receive(self, now: float) -> list[Message]:
        """Return the messages that have arrived by `now` [s]; LinkError when the bus is gone."""
        messages: list[Message] = []
        for _ in range(FRAMES_MOST):
            try:
                frame = self._bus.recv(timeout=0.0)
            except Exception as error:
                # python-can's drivers raise errors of their own beside its CanError
                raise LinkError(f"{self.name}: the CAN bus is gone: {error}; plug it in and start again") from error
            if frame is None:
                break
            if frame.is_extended_id and not frame.is_error_frame and not frame.is_remote_frame:
                message = self._framing.take(now, Frame(frame.arbitration_id, bytes(frame.data)))
                messages += [] if message is None else [message]
        return messages

    def send(self, message: Message) -> bool:
        """Send the frames of a message; False where the bus does not take one."""
        for identifier, data in self._framing.frames(message):
            try:
                self._bus.send(self._make(arbitration_id=identifier, data=data, is_extended_id=True), timeout=0.0)
            except Exception:
                # counted, and seen by a rudder that does not follow
                self.unsent += 1
                return False
        return True

    def forget_peer(self) -> None:
        """Do nothing: a bus is open to all."""

    def close(self) -> None:
        """Close the bus."""
        self._bus.shutdown()


class GatewayLine:
    """A gateway on a transport, in one of `autopilot.links.n2k.forms.FORMS`."""

    def __init__(self, transport: Transport, form: Form) -> None:
        self.name, self.is_node = transport.name, form.is_node
        self.unsent = 0
        self._transport, self._form = transport, form
        self._has_begun = False

    def fileno(self) -> int:
        """Return the transport's descriptor, or -1."""
        return self._transport.fileno()

    def receive(self, now: float) -> list[Message]:
        """Return the messages that have arrived by `now` [s]; LinkError when the transport is gone."""
        if not self._has_begun:
            self._has_begun = not (beginning := self._form.begin()) or self._transport.send(beginning)
        # a datagram ends its line
        ends = b"" if self._transport.is_stream else LINE_END
        return [message for chunk in self._transport.receive() for message in self._form.feed(now, chunk + ends)]

    def send(self, message: Message) -> bool:
        """Send a message."""
        is_sent = self._transport.send(self._form.encode(message))
        self.unsent += not is_sent
        return is_sent

    def forget_peer(self) -> None:
        """Let go of a peer that was latched on to."""
        self._transport.forget_peer()

    def close(self) -> None:
        """Close the transport."""
        self._transport.close()


class N2kLink(SessionLink[Message]):
    """A `Link` over NMEA 2000."""

    def __init__(
        self,
        line: BusLine | GatewayLine,
        settings: N2kSettings = N2kSettings(),  # noqa: B008 - immutable
        guide: PlotterGuide | None = None,
        helm: Helm | None = None,
        variation: Variation | None = None,
    ) -> None:
        self.session = N2kSession(line.name, settings, line.is_node, guide, helm, variation)
        super().__init__(line, self.session)
