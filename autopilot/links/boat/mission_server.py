"""The mission protocol's vehicle side, for one link: upload, download, clear, choice of the current item. Pure.

Source: https://mavlink.io/en/services/mission.html. A new route takes the place of the old one only when all of it has
arrived and can be followed; what cannot be followed is refused whole. Only items of the mission itself are kept:
lists of fence and rally points are empty.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.links.boat.mission import Mission
from autopilot.links.boat.mission_items import MOST_ITEMS, MissionItem, from_message, problem
from autopilot.links.mavlink_codec import Message

AGAIN_S = 0.8
TRIES = 6
"""An item that does not come is asked for this many times, this long [s] apart."""
AFTERWARDS_S = 10.0
"""For this long [s] an upload's last item, sent again, is answered again: our answer was lost."""
MISSION = dialect.MAV_MISSION_TYPE_MISSION
ALL = dialect.MAV_MISSION_TYPE_ALL


class Upload(NamedTuple):
    """What has come so far: who sends (system, component), items wanted and had, when asked last [s], how often."""

    peer: tuple[int, int]
    wanted: int
    items: tuple[MissionItem, ...] = ()
    asked: float = 0.0
    tries: int = 1


class MissionServer:
    """Answers one link's mission messages. `follow_ended`: a new route has ended the following of the old one."""

    def __init__(self, mission: Mission) -> None:
        self.mission = mission
        self.said = ""
        """What people should read of the last message, '' for nothing."""
        self._upload: Upload | None = None
        self._finished: tuple[tuple[int, int], int, float] = ((0, 0), -1, -math.inf)
        self._replies = {
            "MISSION_COUNT": self._count,
            "MISSION_ITEM": self._item,
            "MISSION_ITEM_INT": self._item,
            "MISSION_ACK": self._ended,
            "MISSION_REQUEST_LIST": self._list,
            "MISSION_REQUEST": self._request,
            "MISSION_REQUEST_INT": self._request,
            "MISSION_CLEAR_ALL": self._clear,
            "MISSION_SET_CURRENT": self._set_current,
            "MISSION_WRITE_PARTIAL_LIST": self._partial,
        }

    @property
    def kinds(self) -> tuple[str, ...]:
        """The messages it answers."""
        return tuple(self._replies)

    def take(self, now: float, message: Message) -> list[Message]:
        """Return the answers to a message that came at `now` [s]; `said` is set."""
        self.said = ""
        return self._replies[message.get_type()](now, message, (message.get_srcSystem(), message.get_srcComponent()))

    def denied(self, message: Message) -> list[Message]:
        """Return the answer to a message that would change the route or its current item, and may not."""
        if message.get_type() == "MISSION_SET_CURRENT":
            return [self.mission.message()]
        peer = (message.get_srcSystem(), message.get_srcComponent())
        return [_ack(peer, dialect.MAV_MISSION_DENIED, message.mission_type)]

    def due(self, now: float) -> list[Message]:
        """Return a request again that has not been answered, or the end of an upload that stands still."""
        self.said = ""
        upload = self._upload
        if upload is None or now - upload.asked < AGAIN_S:
            return []
        if upload.tries >= TRIES:
            self._drop()
            self.said = f"upload of the route ended: item {len(upload.items)} did not come; the old route is kept"
            return [_ack(upload.peer, dialect.MAV_MISSION_OPERATION_CANCELLED)]
        self._upload = upload._replace(asked=now, tries=upload.tries + 1)
        return [_wanted(upload)]

    def _count(self, now: float, message: Message, peer: tuple[int, int]) -> list[Message]:
        if message.mission_type != MISSION:
            result = dialect.MAV_MISSION_ACCEPTED if message.count == 0 else dialect.MAV_MISSION_UNSUPPORTED
            return [_ack(peer, result, message.mission_type)]
        if self._is_busy(peer):
            self.said = "another ground station is uploading a route: wait until it has ended"
            return [_ack(peer, dialect.MAV_MISSION_DENIED)]
        self._drop()
        if message.count > MOST_ITEMS:
            self.said = f"a route of {message.count} items: up to {MOST_ITEMS} are taken"
            return [_ack(peer, dialect.MAV_MISSION_NO_SPACE)]
        if message.count == 0:
            return self._clear(now, message, peer)
        self.mission.uploader = self
        self._upload = Upload(peer, message.count, asked=now)
        return [_wanted(self._upload)]

    def _item(self, now: float, message: Message, peer: tuple[int, int]) -> list[Message]:
        upload = self._upload
        if upload is None or peer != upload.peer or message.mission_type != MISSION:
            last_peer, last, when = self._finished
            is_again = peer == last_peer and message.seq == last and now - when <= AFTERWARDS_S
            return [_ack(peer, dialect.MAV_MISSION_ACCEPTED)] if is_again else []
        if message.seq < len(upload.items):
            return []
        if message.seq > len(upload.items):
            return [_wanted(upload)]
        item = from_message(message)
        result, sentence = problem(message.seq, item)
        if sentence:
            self._drop()
            self.said = f"route refused: {sentence}; the old route is kept"
            return [_ack(peer, result)]
        upload = upload._replace(items=(*upload.items, item), asked=now, tries=1)
        if len(upload.items) < upload.wanted:
            self._upload = upload
            return [_wanted(upload)]
        self._drop()
        self._finished = (peer, message.seq, now)
        self._take_over(upload.items)
        return [_ack(peer, dialect.MAV_MISSION_ACCEPTED), self.mission.message()]

    def _take_over(self, items: tuple[MissionItem, ...]) -> None:
        was_followed = self.mission.replace(items)
        self.said = f"route of {len(items)} waypoints taken" if items else "route cleared"
        if was_followed:
            self.said += ": the old one is no longer followed, the course is held"

    def _ended(self, now: float, message: Message, peer: tuple[int, int]) -> list[Message]:
        """The other side has what it wanted, or gives its upload up."""
        if self._upload is not None and peer == self._upload.peer and message.type != dialect.MAV_MISSION_ACCEPTED:
            self._drop()
            self.said = "upload of the route given up; the old route is kept"
        return []

    def _list(self, now: float, message: Message, peer: tuple[int, int]) -> list[Message]:
        count = len(self.mission.items) if message.mission_type == MISSION else 0
        return [dialect.MAVLink_mission_count_message(*peer, count, message.mission_type)]

    def _request(self, now: float, message: Message, peer: tuple[int, int]) -> list[Message]:
        items = self.mission.items if message.mission_type == MISSION else ()
        if not message.seq < len(items):
            return [_ack(peer, dialect.MAV_MISSION_INVALID_SEQUENCE, message.mission_type)]
        item, is_current = items[message.seq], int(message.seq == self.mission.current)
        head = (*peer, message.seq, item.frame, item.command, is_current, item.autocontinue, *item.parameters)
        if message.get_type() == "MISSION_REQUEST":
            return [dialect.MAVLink_mission_item_message(*head, item.x * 1.0e-7, item.y * 1.0e-7, item.z)]
        return [dialect.MAVLink_mission_item_int_message(*head, item.x, item.y, item.z)]

    def _clear(self, now: float, message: Message, peer: tuple[int, int]) -> list[Message]:
        if message.mission_type in (MISSION, ALL):
            if self._is_busy(peer):
                return [_ack(peer, dialect.MAV_MISSION_DENIED, message.mission_type)]
            self._drop()
            self._take_over(())
        return [_ack(peer, dialect.MAV_MISSION_ACCEPTED, message.mission_type), self.mission.message()]

    def _set_current(self, now: float, message: Message, peer: tuple[int, int]) -> list[Message]:
        if not self.mission.set_current(message.seq):
            self.said = f"there is no waypoint {message.seq} in a route of {len(self.mission.items)}"
        return [self.mission.message()]

    def _partial(self, now: float, message: Message, peer: tuple[int, int]) -> list[Message]:
        self.said = "a part of a route cannot be changed: upload the whole route"
        return [_ack(peer, dialect.MAV_MISSION_UNSUPPORTED, message.mission_type)]

    def _is_busy(self, peer: tuple[int, int]) -> bool:
        if self._upload is not None:
            return peer != self._upload.peer
        return self.mission.uploader is not None

    def _drop(self) -> None:
        if self._upload is not None:
            self._upload = self.mission.uploader = None


def _wanted(upload: Upload) -> Message:
    return dialect.MAVLink_mission_request_int_message(*upload.peer, len(upload.items))


def _ack(peer: tuple[int, int], result: int, mission_type: int = MISSION) -> Message:
    return dialect.MAVLink_mission_ack_message(*peer, result, mission_type)
