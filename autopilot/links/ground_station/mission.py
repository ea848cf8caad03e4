"""The route that ground stations have uploaded, and how far it has been followed: one for all links. Pure.

It engages nothing: a route is followed when mode AUTO is ordered. A new route ends the following of the old one; the
course is held meanwhile.

Mission items: which of them a boat can follow, as waypoints, and as the text that ground stations keep. Pure.

The text is the waypoint file of QGroundControl, Mission Planner and MAVProxy ("QGC WPL 110"), one item a line:
index, current, frame, command, parameters 1 to 4, latitude, longitude [deg], altitude, autocontinue, split by tabs.
Source: https://mavlink.io/en/file_formats/#mission_plain_text_file

The mission protocol's vehicle side, for one link: upload, download, clear, choice of the current item. Pure.

Source: https://mavlink.io/en/services/mission.html. A new route takes the place of the old one only when all of it has
arrived and can be followed; what cannot be followed is refused whole. Only items of the mission itself are kept:
lists of fence and rally points are empty.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.errors import InputError
from autopilot.guidance.current import ROUTE_LATITUDE_MOST_DEG, Overboard
from autopilot.guidance.track import TrackGuide, Waypoint
from autopilot.links.mavlink.codec import Message
from autopilot.links.north import MAGNETIC_LEADS

MOST_ITEMS = 500
HOLD_MOST_S = 1.0
"""A boat whose throttle is not ours cannot wait at a waypoint; some senders mean "pass it" by half a second."""
RADIUS_MOST = 5000.0
LATITUDE_MOST_E7 = round(ROUTE_LATITUDE_MOST_DEG * 1.0e7)
LONGITUDE_MOST_E7 = 1_800_000_000
FRAMES = frozenset(
    {
        dialect.MAV_FRAME_GLOBAL,
        dialect.MAV_FRAME_GLOBAL_INT,
        dialect.MAV_FRAME_GLOBAL_RELATIVE_ALT,
        dialect.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT,
        dialect.MAV_FRAME_GLOBAL_TERRAIN_ALT,
        dialect.MAV_FRAME_GLOBAL_TERRAIN_ALT_INT,
    }
)
FIRST_LINE = "QGC WPL 110"
COLUMNS = 12


class MissionItem(NamedTuple):
    """An item as it was uploaded; x and y are latitude and longitude [1e-7 deg], z is an altitude [m], not used."""

    frame: int
    command: int
    parameters: tuple[float, float, float, float]
    x: int
    y: int
    z: float
    autocontinue: int = 1

    @property
    def waypoint(self) -> Waypoint:
        """The place it leads to."""
        radius = self.parameters[1]
        return Waypoint(
            math.radians(self.x * 1.0e-7),
            math.radians(self.y * 1.0e-7),
            radius if math.isfinite(radius) and radius > 0.0 else math.nan,
        )


def problem(number: int, item: MissionItem) -> tuple[int, str]:
    """Return the MAV_MISSION_RESULT of an item and, where it is not ACCEPTED, the sentence why."""
    if item.command != dialect.MAV_CMD_NAV_WAYPOINT:
        kind = dialect.enums["MAV_CMD"].get(item.command)
        name = kind.name.removeprefix("MAV_CMD_") if kind is not None else str(item.command)
        return dialect.MAV_MISSION_UNSUPPORTED, f"item {number} is {name}: only NAV_WAYPOINT is followed"
    if item.frame not in FRAMES:
        return dialect.MAV_MISSION_UNSUPPORTED_FRAME, f"item {number} is in frame {item.frame}: use a global one"
    hold, radius = item.parameters[:2]
    if hold > HOLD_MOST_S:
        return dialect.MAV_MISSION_INVALID_PARAM1, f"item {number} waits {hold:g} s: the boat cannot, set it to 0"
    if radius > RADIUS_MOST:
        return (
            dialect.MAV_MISSION_INVALID_PARAM2,
            f"item {number}: radius {radius:g} m, allowed is {RADIUS_MOST:g}",
        )
    if not abs(item.x) <= LATITUDE_MOST_E7:
        most = f"up to {ROUTE_LATITUDE_MOST_DEG:g} is allowed"
        return dialect.MAV_MISSION_INVALID_PARAM5_X, f"item {number}: latitude {item.x * 1e-7:g}, {most}"
    if not abs(item.y) <= LONGITUDE_MOST_E7:
        return dialect.MAV_MISSION_INVALID_PARAM6_Y, f"item {number}: longitude {item.y * 1e-7:g}, allowed is up to 180"
    if item.x == item.y == 0:
        return dialect.MAV_MISSION_INVALID_PARAM5_X, f"item {number} lies at 0 N 0 E: give it a place"
    return dialect.MAV_MISSION_ACCEPTED, ""


def from_message(message: object) -> MissionItem:
    """Return the item of a MISSION_ITEM_INT or MISSION_ITEM message; what is not finite becomes a place off the map."""
    fields = {name: getattr(message, name) for name in ("frame", "command", "x", "y", "z", "autocontinue")}
    if isinstance(fields["x"], float):
        fields["x"], fields["y"] = _e7(fields["x"]), _e7(fields["y"])
    parameters = tuple(float(getattr(message, f"param{number}")) for number in range(1, 5))
    return MissionItem(parameters=parameters, **fields)  # type: ignore[arg-type]


def _e7(degrees: float) -> int:
    return round(degrees * 1.0e7) if abs(degrees) <= 200.0 else LONGITUDE_MOST_E7 + 1


def dump_items(items: Sequence[MissionItem]) -> str:
    """Return items as the text of a waypoint file."""
    lines = [FIRST_LINE]
    for number, item in enumerate(items):
        parameters = (repr(float(value)) for value in item.parameters)
        place = (f"{item.x * 1e-7:.7f}", f"{item.y * 1e-7:.7f}", repr(float(item.z)))
        fields = (str(number), "0", str(item.frame), str(item.command), *parameters, *place, str(item.autocontinue))
        lines.append("\t".join(fields))
    return "\n".join(lines) + "\n"


def parse_items(text: str, name: str) -> tuple[MissionItem, ...]:
    """Return the items of a waypoint file's text; InputError names the file, the line and what is wrong."""
    lines = [line.strip() for line in text.splitlines()]
    if not lines or lines[0] != FIRST_LINE:
        raise InputError(f"{name}: line 1 must be {FIRST_LINE!r}; save the route as a waypoint file")
    items: list[MissionItem] = []
    for number, line in enumerate(lines[1:], 2):
        if line and not line.startswith("#"):
            item = _item_of(line, f"{name}, line {number}")
            sentence = problem(len(items), item)[1]
            if sentence:
                raise InputError(f"{name}, line {number}: {sentence}")
            items.append(item)
    if len(items) > MOST_ITEMS:
        raise InputError(f"{name}: holds {len(items)} items, up to {MOST_ITEMS} are allowed")
    return tuple(items)


def _item_of(line: str, where: str) -> MissionItem:
    fields = line.split()
    if len(fields) != COLUMNS:
        raise InputError(f"{where}: holds {len(fields)} values, {COLUMNS} are needed")
    try:
        frame, command, autocontinue = int(fields[2]), int(fields[3]), int(fields[11])
        p1, p2, p3, p4, latitude, longitude, z = (float(field) for field in fields[4:11])
    except ValueError:
        raise InputError(f"{where}: holds a value that is not a number") from None
    return MissionItem(frame, command, (p1, p2, p3, p4), _e7(latitude), _e7(longitude), z, autocontinue)


NO_POSITION = "no position: check the GPS and its link"
FOLLOWED, SUSPENDED = 1, 2
"""mission_mode of MISSION_CURRENT."""


class Mission:
    """The items, and the guide that leads along them.

    Args:
        guide: leads the boat; the skipper asks it for courses while it is followed.

    Attributes:
        keep: takes the items whenever they have changed, to be kept over a restart.
        overboard: where somebody went overboard.
        items: as uploaded.  route: the same as waypoints.  uploader: who is uploading now, None for nobody.
    """

    def __init__(self, guide: TrackGuide, items: Sequence[MissionItem] = ()) -> None:
        self.guide = guide
        self.overboard = Overboard()
        self.items: tuple[MissionItem, ...] = ()
        self.route: tuple[Waypoint, ...] = ()
        self.uploader: object | None = None
        self.save_route: Callable[[tuple[MissionItem, ...]], None] = lambda _: None
        self._put(items)

    @property
    def is_followed(self) -> bool:
        """Whether the guide leads along this route, rather than to a single place or not at all."""
        return self.guide.following and self.guide.route is self.route and bool(self.route)

    @property
    def current(self) -> int:
        """The item that is, or would be, steered for."""
        if self.is_followed:
            self._current = self.guide.target
            self._complete = self.guide.is_complete
        return self._current

    @property
    def state(self) -> int:
        """MISSION_STATE."""
        _ = self.current
        if not self.items:
            return int(dialect.MISSION_STATE_NO_MISSION)
        if self._complete:
            return int(dialect.MISSION_STATE_COMPLETE)
        if self.is_followed:
            return int(dialect.MISSION_STATE_ACTIVE)
        return int(dialect.MISSION_STATE_PAUSED if self._begun else dialect.MISSION_STATE_NOT_STARTED)

    def replace(self, items: Sequence[MissionItem]) -> bool:
        """Put another route in the place of this one; return whether this one was being followed, and is no more."""
        was_followed = self.is_followed
        if was_followed:
            self.guide.leave()
        self._put(items)
        self.save_route(self.items)
        return was_followed

    def set_current(self, number: int) -> bool:
        """Go on with an item, from where the boat is; return False where there is none of that number."""
        if not 0 <= number < len(self.items):
            return False
        if self.is_followed:
            self.guide.follow(self.route, number)
        self._current, self._complete = number, False
        return True

    def obstacle(self, now: float, number: int | None = None) -> str:
        """Return why the route cannot be followed at `now` [s], to the item `number` or the current one; or ''."""
        if self.guide.settings.magnetic:
            return MAGNETIC_LEADS
        if not self.items:
            return "there is no route: upload one first"
        if number is not None and not 0 <= number < len(self.items):
            return f"there is no waypoint {number} in a route of {len(self.items)}"
        if number is None and self.state == dialect.MISSION_STATE_COMPLETE:
            return "the route has been followed to its end: choose a waypoint to go on with"
        return "" if self.guide.fix.is_fresh(now) else NO_POSITION

    def follow(self) -> None:
        """Have the guide lead along the route from the current item on."""
        self._begun = True
        self.guide.follow(self.route, self.current)

    def message(self) -> dialect.MAVLink_mission_current_message:
        """Return MISSION_CURRENT."""
        mode = FOLLOWED if self.is_followed else SUSPENDED
        return dialect.MAVLink_mission_current_message(self.current, len(self.items), self.state, mode)

    def _put(self, items: Sequence[MissionItem]) -> None:
        self.items = tuple(items)
        # a list of its own, so that it is distinguished from another route with the same places
        self.route = tuple([item.waypoint for item in items])
        self._current = 0
        self._begun = self._complete = False


AGAIN_S = 0.8
TRIES = 6
"""An item that does not come is asked for this many times, this long [s] apart."""
NEVER_FINISHED: tuple[tuple[int, int], int, float] = ((0, 0), -1, -math.inf)
"""Whose upload ended with which item, and when [s]."""
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
        self._finished = NEVER_FINISHED
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
        # an item of the route before this one, overtaken by its count, is none of a route that was taken
        self._upload, self._finished = Upload(peer, message.count, asked=now), NEVER_FINISHED
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
