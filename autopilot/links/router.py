"""Where a MAVLink frame goes: by the addresses that were heard at each endpoint. Pure, but for the senders given to it.

Rules of https://mavlink.io/en/guide/routing.html and of ArduPilot's libraries/GCS_MAVLink/MAVLink_routing.cpp: what is
for everybody goes to every other endpoint; what has an address goes where that address has been heard; nothing goes
back where it came from. Frames pass unchanged.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable

from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.links.mavlink_frames import Address, source_of, target_of
from autopilot.links.signing import identity_of

OURSELVES = -1
"""Stands for an endpoint where our own addresses live."""
REMEMBERED = 512
"""So many frames are remembered, to know one that comes round by another way."""
ROUND_S = 2.0
"""Within this time the same bytes at another endpoint have come round."""
AGAIN_S = 0.25
"""Within this time at the same endpoint too; later they are from a sender that does not count its packets."""
MOST_ADDRESSES = 64
"""Addresses learnt at one endpoint: a flood of invented ones fills no memory."""
STAYS = frozenset(
    {
        int(dialect.MAVLINK_MSG_ID_RADIO_STATUS),
        int(dialect.MAVLINK_MSG_ID_RADIO),
        int(dialect.MAVLINK_MSG_ID_SETUP_SIGNING),
    }
)
"""Never passed on: what a radio says of its own link, and a key that may have come over a safe one."""
AUTOPILOT_COMPONENT = 1
OWN_COMPONENT = 191
"""MAV_COMP_ID_ONBOARD_COMPUTER: what we send as a ground station (`--as-gcs`) is shown to no other one."""

Sender = Callable[[bytes], bool]


class Router:
    """Passes frames between the endpoints that have joined.

    Attributes:
        now: the time [s], kept by whoever turns the loop.
        counts: frames passed on, and those that were not, by reason.
    """

    def __init__(self) -> None:
        self.now = 0.0
        self.counts: Counter[str] = Counter()
        self._senders: list[Sender] = []
        self._left: list[int] = []
        self._vehicles: set[int] = set()
        self._heard: dict[int, set[Address]] = {OURSELVES: set()}
        self._order: deque[bytes] = deque()
        self._recent: dict[bytes, tuple[int, float]] = {}

    def join(self, send: Sender, has_vehicle: bool = False) -> int:
        """Add an endpoint; return its number. `send` sends a frame without ever blocking, False where it cannot.

        `has_vehicle`: the flight controller is there, and nobody elsewhere may speak in its name.
        """
        if self._left:
            number = self._left.pop()
            self._senders[number] = send
        else:
            number = len(self._senders)
            self._senders.append(send)
        self._heard[number] = set()
        if has_vehicle:
            self._vehicles.add(number)
        return number

    def leave(self, number: int) -> None:
        """Send nothing more to an endpoint, and forget who was there: its line is closed."""
        if number not in self._left:
            self._left.append(number)
        self._senders[number] = lambda _: False
        self._heard[number] = set()
        self._vehicles.discard(number)

    def take(self, endpoint: int, frame: bytes) -> None:
        """Pass on a frame that arrived at `endpoint`."""
        source = source_of(frame)
        if not self._may_come(endpoint, source):
            self.counts["pretended to be the vehicle or us"] += 1
            return
        if self._has_come_round(endpoint, frame):
            self.counts["came round in a loop"] += 1
            return
        self._remember(endpoint, frame)
        heard = self._heard[endpoint]
        if source.system != 0 and len(heard) < MOST_ADDRESSES:
            heard.add(source)
        if identity_of(frame) in STAYS:
            self.counts["not for other links"] += 1
            return
        places = self._places_of(target_of(frame))
        # two links to flight controllers are no bridge between them
        self._pass_on(endpoint, frame, places - self._vehicles if endpoint in self._vehicles else places)

    def show_own(self, sent_to: int, frame: bytes) -> None:
        """Show what we have just sent to endpoint `sent_to` to the others too, where it is for everybody."""
        self._heard[OURSELVES].add(source_of(frame))
        self._remember(OURSELVES, frame)
        if target_of(frame).system == 0:
            self._pass_on(sent_to, frame, set(range(len(self._senders))) - self._vehicles)

    def _may_come(self, endpoint: int, source: Address) -> bool:
        if endpoint in self._vehicles:
            return True
        if source in self._heard[OURSELVES]:
            return False
        return source.component != AUTOPILOT_COMPONENT or not any(
            source in self._heard[vehicle] for vehicle in self._vehicles
        )

    def _places_of(self, target: Address) -> set[int]:
        if target.system == 0:
            return set(range(len(self._senders)))
        if target.component != 0 and (exact := self._where(lambda address: address == target)):
            return exact
        return self._where(lambda address: address.system == target.system) - {OURSELVES}

    def _where(self, fits: Callable[[Address], bool]) -> set[int]:
        return {endpoint for endpoint, heard in self._heard.items() if any(map(fits, heard))}

    def _pass_on(self, source: int, frame: bytes, places: set[int]) -> None:
        places = places - {source}
        if not places:
            self.counts["for nobody we know"] += 1
        for place in sorted(places - {OURSELVES}):
            self.counts["passed on" if self._senders[place](frame) else "dropped: endpoint full or away"] += 1

    def _has_come_round(self, endpoint: int, frame: bytes) -> bool:
        if frame not in self._recent:
            return False
        before, when = self._recent[frame]
        return self.now - when < (AGAIN_S if before == endpoint else ROUND_S)

    def _remember(self, endpoint: int, frame: bytes) -> None:
        if frame not in self._recent:
            if len(self._order) >= REMEMBERED:
                del self._recent[self._order.popleft()]
            self._order.append(frame)
        self._recent[frame] = (endpoint, self.now)
