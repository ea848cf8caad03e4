"""Every alarm and what follows from it: what the pilot does, how bad it is, whether it sounds, whether a trial goes on.

What happens travels as an `AlarmEvent` with a name of this table; all that follows is looked up here, and nothing from
words: those stand in `autopilot.supervision.panel`, which makes sentences of them where they are shown. The page
docs/alarms.md is drawn from both (`docs/supervisor_pages.py`). Who watches for something outside of the pilot says so
with a `ConditionSample` of the alarm's name. Pure.
"""

from __future__ import annotations

import zlib
from enum import Enum, IntEnum
from typing import NamedTuple

from autopilot.signals import AlarmEvent


class Severity(IntEnum):
    """How bad it is, in the numbers of MAV_SEVERITY (MAVLink, common.xml)."""

    ALERT = 1
    CRITICAL = 2
    ERROR = 3
    WARNING = 4
    NOTICE = 5


class Priority(IntEnum):
    """How soon people must act, in the words of IMO MSC.302(87) and IEC 62923; the highest comes first.

    EMERGENCY: nobody steers and the rudder is not free. ALARM: act at once. WARNING: nothing is lost yet, and may be.
    CAUTION: to be read, not to be acknowledged.
    """

    EMERGENCY = 1
    ALARM = 2
    WARNING = 3
    CAUTION = 4


class Sound(NamedTuple):
    """What is heard of an alarm that nobody has acknowledged: so many short tones, again every so many seconds."""

    tones: int
    every: float


SOUNDS = {Priority.EMERGENCY: Sound(6, 2.5), Priority.ALARM: Sound(3, 7.0), Priority.WARNING: Sound(2, 20.0)}
"""Three tones are an alarm and two a warning, as on a ship's bridge (IEC 62923-1); a caution is silent."""


class Response(Enum):
    """What the pilot does about an alarm; the value says what it is."""

    NOTIFY = "steers on"
    DEGRADE = "steers on, degraded"
    FAILSAFE = "fail-safe of the vessel file"
    LET_GO = "fail-safe, rudder released at once"
    FAULT = "fault: rudder held, then released"
    OVERRIDE = "override: rudder released"
    WAIT = "does not engage"


OVERRIDDEN, AT_STOP, APART, FAILED, VERBATIM = "overridden", "at_stop", "apart", "failed", "verbatim"
"""Forms of an `AlarmEvent`: the helm is taken; off heading, hard over; compasses far apart, one that has failed; and
the detail as it stands, where that is the whole sentence."""
OTHER = "other"
"""The kind of what has none: no more than its words is known."""


class AlarmKind(NamedTuple):
    """What follows from one alarm. is_heard: it sounds though it is no more than a notice.

    is_borne: a trial goes on under it: its rudder may stand at the stop, it is sailed because model and rate of the
    rudder are in doubt, it holds no course, and a record has its times even where the loop runs late or is sent too
    much, and whoever looks on.
    """

    name: str
    response: Response
    severity: Severity
    is_audible: bool = False
    is_borne: bool = False

    @property
    def sounds(self) -> bool:
        """Whether it is to be acknowledged: notices make no noise and never escalate."""
        return self.is_audible or (self.severity <= Severity.WARNING and self.response is not Response.WAIT)

    @property
    def priority(self) -> Priority:
        """How soon people must act."""
        if not self.sounds:
            return Priority.CAUTION
        if self.severity is Severity.ALERT:
            return Priority.EMERGENCY
        return Priority.ALARM if self.severity <= Severity.ERROR else Priority.WARNING

    @property
    def number(self) -> int:
        """What stands for it where only a number travels: 24 bits, which a float of MAVLink holds exactly."""
        return zlib.crc32(self.name.encode()) & 0xFFFFFF

    @property
    def is_doubt(self) -> bool:
        """Whether it puts in doubt what steering rests on: the pilot steers on, degraded."""
        return self.response is Response.DEGRADE

    @property
    def ends_trials(self) -> bool:
        """Whether a trial ends where it begins."""
        return self.severity <= Severity.WARNING and self.response is not Response.WAIT and not self.is_borne


def _notice(name: str) -> AlarmKind:
    """Return what is shown as no more than a notice, and heard all the same."""
    return AlarmKind(name, Response.NOTIFY, Severity.NOTICE, is_audible=True)


_KINDS = (
    # of the heading
    AlarmKind("heading_lost", Response.FAILSAFE, Severity.CRITICAL),
    AlarmKind("heading_frozen", Response.FAILSAFE, Severity.CRITICAL),
    AlarmKind("heading_jumping", Response.FAILSAFE, Severity.CRITICAL),
    AlarmKind("compass_jumped", Response.DEGRADE, Severity.ERROR),
    AlarmKind("heading_disagrees", Response.DEGRADE, Severity.WARNING),
    AlarmKind("variation_unknown", Response.NOTIFY, Severity.NOTICE),
    AlarmKind("variation_jumped", Response.NOTIFY, Severity.WARNING),
    AlarmKind("rate_disagrees", Response.DEGRADE, Severity.WARNING),
    AlarmKind("innovation", Response.DEGRADE, Severity.WARNING, is_borne=True),
    # of the rudder
    AlarmKind("rudder_stuck", Response.LET_GO, Severity.CRITICAL),
    AlarmKind("rudder_not_following", Response.LET_GO, Severity.CRITICAL),
    AlarmKind("rudder_reversed", Response.LET_GO, Severity.CRITICAL),
    AlarmKind("runaway", Response.LET_GO, Severity.CRITICAL),
    AlarmKind("rudder_at_stop", Response.DEGRADE, Severity.WARNING, is_borne=True),
    # of the boat's motion
    AlarmKind("off_course", Response.NOTIFY, Severity.WARNING, is_borne=True),
    AlarmKind("overpowered", Response.NOTIFY, Severity.ERROR, is_borne=True),
    AlarmKind("trial_doubtful", Response.NOTIFY, Severity.WARNING),
    AlarmKind("low_speed", Response.DEGRADE, Severity.WARNING),
    AlarmKind("hunting", Response.DEGRADE, Severity.WARNING),
    AlarmKind("swinging", Response.LET_GO, Severity.CRITICAL),
    AlarmKind("circling", Response.LET_GO, Severity.CRITICAL),
    AlarmKind("too_quick", Response.LET_GO, Severity.CRITICAL),
    AlarmKind("lively", Response.DEGRADE, Severity.WARNING),
    AlarmKind("thruster_weak", Response.DEGRADE, Severity.WARNING),
    AlarmKind("bow_thruster_off", Response.NOTIFY, Severity.NOTICE),
    AlarmKind("bow_thruster_not_following", Response.NOTIFY, Severity.WARNING),
    AlarmKind("bow_thruster_hot", Response.NOTIFY, Severity.WARNING),
    AlarmKind("bow_thruster_weak", Response.NOTIFY, Severity.WARNING),
    AlarmKind("rudder_slow", Response.DEGRADE, Severity.WARNING, is_borne=True),
    AlarmKind("path_late", Response.NOTIFY, Severity.NOTICE, is_borne=True),
    AlarmKind("speed_doubtful", Response.DEGRADE, Severity.WARNING),
    AlarmKind("speeds_disagree", Response.DEGRADE, Severity.WARNING),
    AlarmKind("roll", Response.NOTIFY, Severity.WARNING),
    AlarmKind("no_wind", Response.NOTIFY, Severity.ERROR),
    # of the pilot itself and its machine
    AlarmKind("not_finite", Response.FAULT, Severity.ALERT),
    AlarmKind("envelope", Response.FAULT, Severity.ALERT),
    AlarmKind("deadline_missed", Response.DEGRADE, Severity.WARNING, is_borne=True),
    AlarmKind("clock_stepped", Response.NOTIFY, Severity.NOTICE),
    AlarmKind("disk_full", Response.NOTIFY, Severity.WARNING),
    # from outside
    AlarmKind("human_override", Response.OVERRIDE, Severity.WARNING),
    AlarmKind("link_silent", Response.OVERRIDE, Severity.CRITICAL),
    AlarmKind("radio_lost", Response.OVERRIDE, Severity.CRITICAL),
    AlarmKind("firmware_rebooted", Response.OVERRIDE, Severity.CRITICAL),
    AlarmKind("stood_still", Response.OVERRIDE, Severity.CRITICAL),
    AlarmKind("link_flooded", Response.DEGRADE, Severity.WARNING, is_borne=True),
    AlarmKind("station_silent", Response.NOTIFY, Severity.NOTICE, is_borne=True),
    AlarmKind("handback_refused", Response.NOTIFY, Severity.ALERT),
    AlarmKind("man_overboard", Response.NOTIFY, Severity.ALERT, is_borne=True),
    AlarmKind("attitude_unhealthy", Response.NOTIFY, Severity.WARNING),
    AlarmKind("compass_doubtful", Response.NOTIFY, Severity.WARNING),
    AlarmKind("vehicle_failsafe", Response.NOTIFY, Severity.ERROR),
    AlarmKind("vehicle_failed", Response.NOTIFY, Severity.ALERT),
    AlarmKind("geofence", Response.NOTIFY, Severity.ERROR),
    AlarmKind("shallow", Response.NOTIFY, Severity.ERROR),
    AlarmKind("battery_low", Response.NOTIFY, Severity.ERROR),
    # of orders that wait
    AlarmKind("waiting_heading", Response.WAIT, Severity.NOTICE),
    AlarmKind("cannot_engage", Response.WAIT, Severity.WARNING),
    AlarmKind("order_dropped", Response.WAIT, Severity.WARNING),
    # of journeys that end
    AlarmKind("route_ended", Response.NOTIFY, Severity.NOTICE),
    AlarmKind("place_reached", Response.NOTIFY, Severity.NOTICE),
    # of who leads
    _notice("position_lost"),
    _notice("position_jumped"),
    _notice("off_track"),
    _notice("current_too_strong"),
    _notice("plotter_turn"),
    _notice("plotter_invalid"),
    _notice("plotter_silent"),
    _notice("plotter_arrived"),
    _notice("wind_awaited"),
    _notice("wind_lost"),
    _notice("wind_shifted"),
    _notice("wind_turn_asked"),
    _notice("wind_turn_stalled"),
    # of the lines to others
    _notice("compass_silent"),
    _notice("headings_slow"),
    _notice("headings_late"),
    AlarmKind("line_narrow", Response.NOTIFY, Severity.NOTICE),
    _notice("targets_lag"),
    _notice("other_pilot"),
    _notice("other_pilot_waits"),
    _notice("input_shared"),
    _notice("servo_changed"),
    _notice("motor_current"),
    _notice("drive_warning"),
    _notice("line_lost"),
    _notice("station_lost"),
    _notice("station_stopped"),
    _notice("stop_refused"),
    _notice("forwarding_ended"),
    _notice("output_failed"),
    _notice("change_not_kept"),
    _notice("other"),
)
CATALOGUE = {kind.name: kind for kind in _KINDS}
"""Every alarm by its name."""
BY_NUMBER = {kind.number: kind for kind in _KINDS}

assert len(CATALOGUE) == len(BY_NUMBER) == len(_KINDS)


def kind_of(event: AlarmEvent) -> AlarmKind:
    """Return the row that an event is of; KeyError for a name that is not in the table."""
    return CATALOGUE[event.name]
