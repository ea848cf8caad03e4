"""The route that ground stations have uploaded, and how far it has been followed: one for all links. Pure.

It engages nothing: a route is followed when mode AUTO is ordered. A new route ends the following of the old one; the
course is held meanwhile.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.guidance.track import TrackGuide, Waypoint
from autopilot.links.boat.mission_items import MissionItem
from autopilot.links.north import MAGNETIC_LEADS

NO_POSITION = "no position: check the GPS and its link"
FOLLOWED, SUSPENDED = 1, 2
"""mission_mode of MISSION_CURRENT."""


class Mission:
    """The items, and the guide that leads along them.

    Args:
        guide: leads the boat; the skipper asks it for courses while it is followed.

    Attributes:
        keep: takes the items whenever they have changed, to be kept over a restart.
        items: as uploaded.  route: the same as waypoints.  uploader: who is uploading now, None for nobody.
    """

    def __init__(self, guide: TrackGuide, items: Sequence[MissionItem] = ()) -> None:
        self.guide = guide
        self.items: tuple[MissionItem, ...] = ()
        self.route: tuple[Waypoint, ...] = ()
        self.uploader: object | None = None
        self.keep: Callable[[tuple[MissionItem, ...]], None] = lambda _: None
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
        self.keep(self.items)
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
        # a list of its own, so that it is told from another route with the same places
        self.route = tuple([item.waypoint for item in items])
        self._current = 0
        self._begun = self._complete = False
