"""The line to the boat: opened, read, written, and opened again by itself for as long as it takes."""

from __future__ import annotations

import math
from collections.abc import Callable

from autopilot.errors import InputError
from autopilot.links.base import LinkError, Transport
from autopilot.links.mavlink_codec import MavlinkCodec
from autopilot.links.signing import Signing
from autopilot.links.url import believe_signed, open_transport, parse_url
from autopilot.web.station import COMPONENT, SYSTEM, Station

REOPEN_S = 1.0
SILENCE_S = 3.0
"""After this a listening line lets another peer in: a boat that starts again speaks from another port."""
MESSAGES_PER_TURN = 2000


class BoatLine:
    """Moves bytes between one link and a `Station`. Call `turn` often, `close` at the end.

    Raises InputError for what is no MAVLink link, and LinkError where it cannot be opened at first.

    Attributes:
        trouble: why the line is down, "" while it is up.
    """

    def __init__(
        self,
        url: str,
        station: Station,
        signing: Signing | None = None,
        opens: Callable[[str], Transport] = open_transport,
    ) -> None:
        link = parse_url(url)
        if link.protocol != "mavlink":
            raise InputError(
                f"link {url!r}: a running pilot is watched over MAVLink; write it like udpin:127.0.0.1:14550"
            )
        self._url, self._station, self._signing, self._opens = url, station, signing, opens
        self.trouble = ""
        self._transport: Transport | None = None
        self._codec = MavlinkCodec()
        self._next_open = -math.inf
        self._heard = -math.inf
        self._open()

    @property
    def name(self) -> str:
        """The URL as the user wrote it."""
        return self._url

    def fileno(self) -> int:
        """Return the descriptor to wait on, or -1."""
        return self._transport.fileno() if self._transport is not None else -1

    def turn(self, now: float) -> int:
        """Take what has come by `now` [s], send what is due; return how many messages came."""
        if self._transport is None and now >= self._next_open:
            self._next_open = now + REOPEN_S
            try:
                self._open()
            except LinkError as error:
                self.trouble = str(error)
        if self._transport is None:
            return 0
        try:
            count = self._receive(now, self._transport)
            for message in self._station.due(now):
                # a full line drops it: every question is asked again until it is answered
                self._transport.send(self._codec.encode(message))
        except LinkError as error:
            self.trouble = str(error)
            self.close()
            self._next_open = now + REOPEN_S
            return 0
        if now - self._heard > SILENCE_S:
            self._heard = now
            self._transport.forget_peer()
        return count

    def close(self) -> None:
        """Close the line."""
        if self._transport is not None:
            self._transport.close()
            self._transport = None

    def _open(self) -> None:
        self._transport = self._opens(self._url)
        ours = self._signing.link() if self._signing is not None else None
        believe_signed(self._transport, ours)
        self._codec = MavlinkCodec(SYSTEM, COMPONENT, self._transport.is_stream, ours)
        self._station.view.forget()
        self.trouble = ""

    def _receive(self, now: float, transport: Transport) -> int:
        count = 0
        for chunk in transport.receive():
            for message in self._codec.decode(chunk):
                self._heard = now
                count += 1
                if count <= MESSAGES_PER_TURN:
                    self._station.receive(now, message)
        return count
