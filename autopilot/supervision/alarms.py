"""Every alarm in one table: what it says, what to do about it, what the pilot does, and where its limit stands.

The pages docs/alarms.md and the pilot both come from it (`python -m autopilot.report.supervisor`). What happens travels
as an `AlarmEvent` with a name of this table; all that follows is looked up here, and nothing from words, which
`autopilot.supervision.panel` makes where they are shown. Who watches for something outside of the pilot says so with a
`ConditionSample` of the alarm's name. Pure.
"""

from __future__ import annotations

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


class Response(Enum):
    """What the pilot does about an alarm; the value says what it is."""

    TELL = "steers on"
    DEGRADE = "steers on, degraded"
    FAILSAFE = "fail-safe of the vessel file"
    LET_GO = "fail-safe, rudder released at once"
    FAULT = "fault: rudder held, then released"
    OVERRIDE = "override: rudder released"
    WAIT = "does not engage"


class Watcher(Enum):
    """Who watches for it; the value says so in words."""

    PILOT = "the pilot, every tick"
    LINK = "the link to the vehicle or the rudder drive"
    LOOP = "the loop around the pilot"
    VEHICLE = "the vehicle, in SYS_STATUS, BATTERY_STATUS or STATUSTEXT"


OVERRIDDEN, AT_STOP, APART, FAILED, VERBATIM = "overridden", "at_stop", "apart", "failed", "verbatim"
"""Forms of an `AlarmEvent`: the helm is taken; off course, hard over; compasses far apart, one that has failed; and
the detail as it stands, where that is the whole sentence."""
OTHER = "other"
"""The kind of what has none: no more than its words is known."""
PLAIN = "{text}{bracketed}: {remedy}"
"""How an alarm is said where its row says nothing else: what is the case, the detail in brackets, what to do."""


class AlarmKind(NamedTuple):
    """One alarm. text: what is the case; remedy: what to do; limit: when it is raised; key: where the file says so.

    sentence: how it is said, see `autopilot.supervision.panel`. is_heard: it sounds though it is no more than a notice.
    is_borne: a trial goes on under it: its rudder may stand at the stop, it is sailed because the model is in doubt, it
    holds no course, and a record has its times even where the loop runs late or is sent too much, and whoever looks on.
    """

    name: str
    text: str
    remedy: str
    response: Response
    severity: Severity
    watcher: Watcher
    limit: str
    key: str = ""
    sentence: str = PLAIN
    is_heard: bool = False
    is_borne: bool = False

    @property
    def sounds(self) -> bool:
        """Whether it is to be acknowledged: notices make no noise and never escalate."""
        return self.is_heard or (self.severity <= Severity.WARNING and self.response is not Response.WAIT)

    @property
    def ends_steering(self) -> bool:
        """Whether it ends the engagement, and forbids another while it lasts."""
        return self.response in (Response.FAULT, Response.LET_GO, Response.FAILSAFE)

    @property
    def is_doubt(self) -> bool:
        """Whether it puts in doubt what steering rests on: the pilot steers on, degraded."""
        return self.response is Response.DEGRADE

    @property
    def ends_trials(self) -> bool:
        """Whether a trial ends where it begins."""
        return self.severity <= Severity.WARNING and self.response is not Response.WAIT and not self.is_borne


_PILOT, _LINK, _LOOP, _VEHICLE = Watcher.PILOT, Watcher.LINK, Watcher.LOOP, Watcher.VEHICLE
_TELL, _DEGRADE, _FAILSAFE, _LET_GO = Response.TELL, Response.DEGRADE, Response.FAILSAFE, Response.LET_GO
_ALERT, _CRITICAL, _ERROR, _WARNING = Severity.ALERT, Severity.CRITICAL, Severity.ERROR, Severity.WARNING

_HEADING = [
    AlarmKind(
        "heading_lost",
        "heading lost",
        "steer by hand, check the compass and its link",
        _FAILSAFE,
        _CRITICAL,
        _PILOT,
        "no heading for the time in the file",
        "failsafe.heading_timeout_s",
    ),
    AlarmKind(
        "heading_frozen",
        "heading frozen: the compass stands still while the boat turns",
        "steer by hand, restart the compass",
        _FAILSAFE,
        _CRITICAL,
        _PILOT,
        "the same to the last digit while the rate of turn spans 5 deg, the rudder is worth 15 deg of turn, or a sea "
        "that moved it until then goes on for 3 s",
        "alarms.frozen_heading",
    ),
    AlarmKind(
        "heading_jumping",
        "the heading jumps further than the boat can turn",
        "steer by hand, look for iron, loose plugs or a second compass at the same line",
        _FAILSAFE,
        _CRITICAL,
        _PILOT,
        "this far between two headings, three times within 10 s, or once and for good",
        "alarms.heading_jump_deg",
    ),
    AlarmKind(
        "heading_disagrees",
        "two compasses disagree",
        "compare both with the hand-bearing compass, take the wrong one out of sensors.priority",
        _DEGRADE,
        _WARNING,
        _LINK,
        "further apart than the file says for several seconds",
        "sensors.heading_monitor_deg",
    ),
    AlarmKind(
        "variation_unknown",
        "headings come that take the magnetic variation, and it is not known",
        "set sensors.variation_deg, or sensors.magnetic: true to steer magnetic courses",
        _TELL,
        Severity.NOTICE,
        _LINK,
        "for 3 s, and no other headings on the same link",
        "sensors.variation_deg",
    ),
    AlarmKind(
        "rate_disagrees",
        "the rate of turn and the heading do not go together",
        "check the rate sensor's sign and scale, and the compass for iron nearby",
        _DEGRADE,
        _WARNING,
        _PILOT,
        "the turn that the rate adds up to in 5 s is so far from the heading's, or to the other side; as long as it is "
        "said, the boat is steered by heading alone",
        "alarms.rate_disagrees_deg",
    ),
    AlarmKind(
        "innovation",
        "the boat does not move as its model says",
        "look for a fouled propeller, a tow or a shifted load; identify the boat anew if it stays",
        _DEGRADE,
        _WARNING,
        _PILOT,
        "measurements off to one side by so many standard deviations for 20 s",
        "alarms.innovation_sigmas",
        is_borne=True,
    ),
]

_STANDS = "off its order by more than the tolerance and standing for 1.2 s and the gear's delay and lag"
_RUDDER = [
    AlarmKind(
        "rudder_stuck",
        "the rudder does not move",
        "steer by hand, check drive, clutch and fuse",
        _LET_GO,
        _CRITICAL,
        _PILOT,
        f"{_STANDS}, or the boat does not answer to it",
        "rudder.follow_tolerance_deg, alarms.reversed_rudder",
    ),
    AlarmKind(
        "rudder_not_following",
        "the rudder does not follow its orders",
        "steer by hand, check drive, clutch and rudder sensor",
        _LET_GO,
        _CRITICAL,
        _PILOT,
        "off its order by more than the tolerance and not on its way for 1.2 s and the gear's delay and lag; a rudder "
        "a quarter as quick as filed, with a course-unstable boat",
        "rudder.follow_tolerance_deg",
    ),
    AlarmKind(
        "rudder_reversed",
        "the rudder moves the wrong way",
        "steer by hand, check drive.reversed or helm.reversed and the rudder sensor's sign",
        _LET_GO,
        _CRITICAL,
        _PILOT,
        "its sensor shows it going away from its order, or the boat answers as to the opposite rudder",
        "alarms.reversed_rudder",
    ),
    AlarmKind(
        "runaway",
        "the boat turns against its rudder",
        "steer by hand, check that the rudder moves, its sign, and the way through the water",
        _LET_GO,
        _CRITICAL,
        _PILOT,
        "rudder hard over for three time constants, the boat turning to the other side as fast, on average too, by "
        "20 deg and twice the waves' yaw since the rudder came over; or a zigzag turning against its "
        "rudder, 45 deg beyond",
        "",
    ),
    AlarmKind(
        "rudder_at_stop",
        "the rudder stands at its stop",
        "slow down or ease sheets: there is no rudder left to steer with",
        _DEGRADE,
        _WARNING,
        _PILOT,
        "nine tenths of the limit for 15 s, turns apart",
        "limits.angle_max_deg",
        is_borne=True,
    ),
]

_MOTION = [
    AlarmKind(
        "off_course",
        "off course",
        "check rudder, speed and wind, or order another course",
        _TELL,
        _WARNING,
        _PILOT,
        "this angle for this time, not while a turn may last",
        "alarms.off_course_deg, alarms.off_course_s",
        sentence="{text} {detail}: {remedy}",
        is_borne=True,
    ),
    AlarmKind(
        "overpowered",
        "the boat is pushed harder than its rudder can hold",
        "take way off, ease sheets, cut what the boat tows or has in its rudder",
        _TELL,
        _ERROR,
        _PILOT,
        "what turns the boat beside rudder and waves, by the model, is worth more than the rudder's limit for 2 s, the "
        "rudder hard over against it or held by a trial; or, rudder hard over for a time constant, it turns to the "
        "other side by 20 deg and twice the waves' yaw",
        "alarms.reversed_rudder",
        is_borne=True,
    ),
    AlarmKind(
        "trial_doubtful",
        "the boat does not turn as the trial's rudder should turn it",
        "the trial ends: see whether the heading is held; wait for the gust to pass, or look at the rudder",
        _TELL,
        _WARNING,
        _PILOT,
        "in a trial, two thirds of the evidence that tells a rudder that does not answer; or a push to the other side "
        "that is heavier than the trial's rudder for 0.3 s",
        "alarms.reversed_rudder",
    ),
    AlarmKind(
        "low_speed",
        "too slow to steer, or astern",
        "make way ahead; until then the rudder waits amidships",
        _DEGRADE,
        _WARNING,
        _PILOT,
        "slower than this",
        "control.steerage_m_s",
    ),
    AlarmKind(
        "hunting",
        "the boat swings from side to side by its own rudder",
        "slow down; check the speed log, the rudder's rate and play; stand by and engage again for the full gains",
        _DEGRADE,
        _WARNING,
        _PILOT,
        "four like or growing sweeps of the rudder in a row by half its limit, each with 10 deg of heading and the "
        "rate of turn to 98 % the rudder's, or two of 8 s or more that swing the boat three times as far as its model, "
        "or twice the rate that the rudder hard over gives; then a quarter of the gain, and a sixteenth if need be; a "
        "speed below the trial's is doubted first",
    ),
    AlarmKind(
        "swinging",
        "the boat swings from side to side however softly it is steered",
        "steer by hand; check speed log, rudder rate and rudder angle, then identify the boat anew",
        _LET_GO,
        _CRITICAL,
        _PILOT,
        "six such sweeps by its whole limit under the soft law, or four with a sixteenth of the gain; at once with a "
        "course-unstable boat",
    ),
    AlarmKind(
        "circling",
        "the boat goes round in circles",
        "steer by hand; check that the rudder moves, its sign, the speed log and the compass",
        _LET_GO,
        _CRITICAL,
        _PILOT,
        "390 deg away from the heading ordered, on balance; 300 deg where the speed is doubted",
    ),
    AlarmKind(
        "too_quick",
        "the boat turns much faster than its file says",
        "steer by hand; check that the vessel file is this boat's, and the rudder angle at full PWM",
        _LET_GO,
        _CRITICAL,
        _PILOT,
        "three times the rate that the rudder hard over gives by the model, for a second or 0.3 time constants, or "
        "twice with a sixteenth of the gain; or an answer to the rudder of more than four times the model's, to both "
        "sides",
        "model.K_1_s, helm.rudder_at_full_pwm_deg",
    ),
    AlarmKind(
        "lively",
        "the boat answers its rudder more than its file says",
        "check the vessel file, the load and the rudder angle at full PWM; the boat is steered softly",
        _DEGRADE,
        _WARNING,
        _PILOT,
        "two and a half to four times the model's answer, to both sides; the law has a quarter of the gain then",
        "model.K_1_s, helm.rudder_at_full_pwm_deg",
    ),
    AlarmKind(
        "rudder_slow",
        "the rudder is much slower than its file says",
        "check the drive's supply and oil, and rudder.rate_max_deg_s; the boat is steered softly",
        _DEGRADE,
        _WARNING,
        _PILOT,
        "its sensor, or the boat's answer, shows a quarter of the rate; the law has a quarter of the gain then",
        "rudder.rate_max_deg_s",
    ),
    AlarmKind(
        "speed_doubtful",
        "the speed does not go with the way the boat turns",
        "check the speed log; the boat is steered as at the speed of its trial",
        _DEGRADE,
        _WARNING,
        _PILOT,
        "the answer to the rudder is two and a half times that of the model at this speed, or the rate of turn half "
        "again what the rudder hard over gives at it, or the answer is missing at a speed above the trial's",
        "model.reference_speed_m_s",
    ),
    AlarmKind(
        "speeds_disagree",
        "the speed log and the speed over ground do not go together",
        "clean or check the log's impeller; the boat is steered as for the mean of both",
        _DEGRADE,
        _WARNING,
        _PILOT,
        "one more than twice the other, and 5 kn apart",
    ),
    AlarmKind(
        "roll",
        "heeling",
        "ease sheets, slow down, or change course",
        _TELL,
        _WARNING,
        _PILOT,
        "this angle for 2 s",
        "alarms.roll_deg",
        sentence="{text} {detail}: {remedy}",
    ),
    AlarmKind(
        "no_wind",
        "the wind is not known, so the fail-safe cannot turn to windward: rudder amidships",
        "steer by hand, check the wind vane and its link",
        _TELL,
        _ERROR,
        _PILOT,
        "no wind for 5 s while failsafe.action is windward",
        "failsafe.action",
    ),
]

_OWN = [
    AlarmKind(
        "not_finite",
        "a value was not finite",
        "steer by hand, keep the log and report it",
        Response.FAULT,
        _ALERT,
        _PILOT,
        "a state, demand or command that is no number",
    ),
    AlarmKind(
        "envelope",
        "a command was outside its envelope",
        "steer by hand, keep the log and report it",
        Response.FAULT,
        _ALERT,
        _PILOT,
        "angle, rate, age or side of a command, by the second implementation",
        "limits.angle_max_deg, limits.rate_max_deg_s",
    ),
    AlarmKind(
        "deadline_missed",
        "the loop runs late",
        "stop other programs on this machine, run autopilot doctor",
        _DEGRADE,
        _WARNING,
        _LOOP,
        "three ticks within 10 s that come three control periods after the one before, or one a second after it",
        "control.rate_hz",
        is_borne=True,
    ),
    AlarmKind(
        "clock_stepped",
        "the machine's clock was set while steering",
        "check the log's times; steering goes by a clock that cannot be set",
        _TELL,
        Severity.NOTICE,
        _LOOP,
        "wall clock and monotonic clock apart by more than 1 s",
    ),
    AlarmKind(
        "disk_full",
        "the disk is full and the log has stopped",
        "free space; steering goes on without a log",
        _TELL,
        _WARNING,
        _LOOP,
        "a write to the log fails (said in the words of what failed)",
    ),
]

_OUTSIDE = [
    AlarmKind(
        "human_override",
        "overridden",
        "the helm is yours; order the course again when you want to give it back",
        Response.OVERRIDE,
        _WARNING,
        _LINK,
        "another mode, disarmed, a stick moved that is not overridden, or a rudder that somebody else moves",
    ),
    AlarmKind(
        "link_silent",
        "the vehicle is silent",
        "steer by hand, check its power and the line to it",
        Response.OVERRIDE,
        _CRITICAL,
        _LINK,
        "nothing for 3 s, or no heartbeat for 8 s",
    ),
    AlarmKind(
        "radio_lost",
        "the radio is lost",
        "steer by hand or from the ground station, switch the transmitter on; the vehicle acts on the loss by itself",
        Response.OVERRIDE,
        _CRITICAL,
        _LINK,
        "RC_CHANNELS shows a throttle below FS_THR_VALUE, an rssi fallen to 0 or no channels left; or SYS_STATUS or "
        "STATUSTEXT (Radio Failsafe) says so; not where FS_THR_ENABLE is 0",
    ),
    AlarmKind(
        "firmware_rebooted",
        "the vehicle has rebooted",
        "steer by hand, arm it and order the course again",
        Response.OVERRIDE,
        _CRITICAL,
        _LINK,
        "its clock goes backwards",
        "failsafe.reengage_after_reboot",
    ),
    AlarmKind(
        "stood_still",
        "this computer stood still",
        "steer by hand, find out what stopped it, and order the course again",
        Response.OVERRIDE,
        _CRITICAL,
        _LINK,
        "no order left for longer than the vehicle waits for one (RC_OVERRIDE_TIME, 3 s in GUIDED); on other rudder "
        "drives for longer than 3 s and than a heading may stay away",
        "failsafe.heading_timeout_s",
    ),
    AlarmKind(
        "link_flooded",
        "more comes in over a link than can be read",
        "find out who sends so much, and take them off the line",
        _DEGRADE,
        _WARNING,
        _LINK,
        "a ground station's messages dropped to keep the loop in time",
        is_borne=True,
    ),
    AlarmKind(
        "station_silent",
        "a ground station is silent",
        "check its link and that its program runs; as soon as it sends again, from any port, it is heard",
        _TELL,
        Severity.NOTICE,
        _LINK,
        "a ground station that was heard sends nothing for 5 s: its place is free for another",
        is_borne=True,
    ),
    AlarmKind(
        "handback_refused",
        "the vehicle did not take over in the mode of the fail-safe",
        "steer by hand, or set the vehicle's mode from the ground station",
        _TELL,
        _ALERT,
        _LINK,
        "the mode is not seen within 3 s",
        "failsafe.firmware_mode",
    ),
    AlarmKind(
        "geofence",
        "the vehicle says that its fence is breached",
        "turn back inside the fence, or change it in the vehicle",
        _TELL,
        _ERROR,
        _VEHICLE,
        "FENCE_STATUS, or the fence in SYS_STATUS enabled and unhealthy",
    ),
    AlarmKind(
        "shallow",
        "shallow water",
        "slow down and turn to deeper water",
        _TELL,
        _ERROR,
        _VEHICLE,
        "the vehicle's STATUSTEXT says so",
    ),
    AlarmKind(
        "battery_low",
        "the vehicle's battery is low",
        "make for harbour, switch off what is not needed",
        _TELL,
        _ERROR,
        _VEHICLE,
        "what remains in SYS_STATUS or BATTERY_STATUS, or its charge state",
        "alarms.battery_percent",
    ),
]

_WAITING = [
    AlarmKind(
        "waiting_heading",
        "waiting for a heading",
        "check that the compass or the vehicle sends one",
        Response.WAIT,
        Severity.NOTICE,
        _PILOT,
        "an order to engage before a heading",
    ),
    AlarmKind(
        "cannot_engage",
        "cannot engage",
        "put right what is said here; the order waits for it 30 s",
        Response.WAIT,
        _WARNING,
        _PILOT,
        "an order to engage while the helm is taken or a trouble lasts",
        sentence="{text}: {detail}",
    ),
    AlarmKind(
        "order_dropped",
        "the order to engage was dropped",
        "put right what is said here and order again",
        Response.WAIT,
        _WARNING,
        _PILOT,
        "such an order has waited 30 s",
        sentence="{text}: {because}; order again",
    ),
]

_ARRIVED = [
    AlarmKind(
        "route_ended",
        "the route has ended",
        "give a heading or take the helm",
        _TELL,
        Severity.NOTICE,
        _LOOP,
        "the last waypoint is passed: the last course is held",
        sentence="{text}: {detail}; {remedy}",
    ),
    AlarmKind(
        "place_reached",
        "the place has been reached",
        "give a heading or take the helm",
        _TELL,
        Severity.NOTICE,
        _LOOP,
        "the place that a ground station sent the boat to: the last course is held",
        sentence="{text}: {detail}; {remedy}",
    ),
]


def _notice(name: str, text: str, remedy: str, watcher: Watcher, limit: str, sentence: str = PLAIN) -> AlarmKind:
    """Return what is shown as no more than a notice, and heard all the same."""
    return AlarmKind(
        name, text, remedy, _TELL, Severity.NOTICE, watcher, limit, key="", sentence=sentence, is_heard=True
    )


_GUIDES = [
    _notice(
        "position_lost",
        "position lost, the route is not followed",
        "check the GPS and its link",
        _LOOP,
        "no position for the time in the file while a route leads",
        "{text}: {detail}; {remedy}",
    ),
    _notice(
        "position_jumped",
        "position jumped",
        "check the GPS, then begin the route again",
        _LOOP,
        "further than the boat can have gone, while a route leads",
        "{text} by {detail}; {remedy}",
    ),
    _notice(
        "off_track",
        "off the track",
        "check the current, the rudder and the speed",
        _LOOP,
        "further off the leg than the file says",
        "more than {detail} of the track: {remedy}",
    ),
    _notice(
        "plotter_turn",
        "the chart plotter wants a turn",
        "not turning; type f to turn",
        _LOOP,
        "its new leg turns the boat further than 100 deg",
        "{text} to {detail}: {remedy}",
    ),
    _notice(
        "plotter_invalid",
        "the chart plotter does not lead",
        "check its route",
        _LOOP,
        "its sentences say that they are not valid",
        "{text} {detail}",
    ),
    _notice(
        "plotter_silent",
        "the chart plotter has been silent",
        "check its route and its link",
        _LOOP,
        "no sentence for 8 s",
        "{text} {detail}; {remedy}",
    ),
    _notice(
        "wind_awaited",
        "no wind is heard",
        "engaging when it is; check the wind vane and its link (MWV)",
        _LOOP,
        "the wind hold is ordered before a wind is known",
    ),
    _notice(
        "wind_lost",
        "wind lost",
        "check the wind vane and its link, then order the wind hold again",
        _LOOP,
        "no wind for 5 s while it leads",
        "{text}: {detail}; {remedy}",
    ),
    _notice(
        "wind_shifted",
        "the wind has shifted",
        "check the course",
        _LOOP,
        "30 deg from where the boat went when the wind hold began",
        "{text} by more than {detail}: {remedy}",
    ),
]

_LINES = [
    _notice(
        "compass_silent",
        "one of two compasses is silent",
        "check its plug and power",
        _LINK,
        "while another steers, for a minute",
        "{text}: {detail}: {remedy}",
    ),
    _notice(
        "headings_slow",
        "headings come more slowly than asked for",
        "raise the link's baud rate (SERIALn_BAUD), let ground stations ask for less (SRn_ parameters), or lower "
        "control.rate_hz",
        _LINK,
        "asked for again and again",
        "headings (ATTITUDE) come at {detail} were asked for again and again: {remedy}",
    ),
    _notice(
        "targets_lag",
        "the vehicle takes our headings but does not turn",
        "check that it makes way (throttle stick, helm.guided_speed_share) and its steering gains (ATC_STR_RAT_FF, "
        "ATC_STR_ANG_P)",
        _LINK,
        "far off the heading ordered, and no nearer for long",
    ),
    _notice(
        "other_pilot",
        "another pilot steers this boat too",
        "two helms fight, let one stand by",
        _LINK,
        "it says so while we steer",
    ),
    _notice(
        "other_pilot_waits",
        "another pilot wants to engage on this boat",
        "let one stand by",
        _LINK,
        "it says so while we steer",
        "{text}",
    ),
    _notice(
        "input_shared",
        "another pilot or ground station overrides the steering input now and then",
        "let one stand by",
        _LINK,
        "the steering input shows pulses that are none of ours",
        "{text}",
    ),
    _notice(
        "motor_current",
        "the rudder motor draws too much",
        "look whether the rudder is jammed",
        _LINK,
        "more than drive.current_max_a for longer than a motor takes to start",
        "the rudder motor draws {detail}: {remedy}",
    ),
    _notice("drive_warning", "the rudder drive warns", "as it says", _LINK, "the drive reports it", "{detail}"),
    _notice(
        "line_lost",
        "a line is lost",
        "check plug and adapter; it is opened again as soon as it is there",
        _LINK,
        "an adapter is pulled, or a connection closed",
        "{detail}",
    ),
    _notice(
        "station_lost",
        "ground station lost, steering goes on",
        "check its link, as it says",
        _LINK,
        "the line to a ground station fails",
        "{text}: {detail}",
    ),
    _notice(
        "station_stopped",
        "a ground station without a key has let the pilot stand by",
        "steer by hand, or order the course again",
        _LINK,
        "an order to stand by from a station that only looks, while an order to steer was in force",
        "{text}{bracketed}: steer by hand",
    ),
    _notice(
        "stop_refused",
        "a ground station without a key wants the pilot to stand by",
        "look around; it is not obeyed again so soon after you have engaged anew: stand by at the helm if it is right",
        _LINK,
        "an order to stand by from a station that only looks, within 1 to 60 min of engaging anew after such an order",
    ),
    _notice(
        "forwarding_ended",
        "forwarding to a ground station ended, steering goes on",
        "check its link, as it says",
        _LINK,
        "the line to a ground station behind the router fails",
        "{text}: {detail}",
    ),
    _notice(
        "output_failed",
        "the alarm output cannot be written",
        "check alarms.outputs and its permissions",
        _LOOP,
        "a write to the file of an alarm output fails",
    ),
    _notice(
        OTHER,
        "what has no kind of its own",
        "as it says",
        _LINK,
        "only in logs of other versions, whose kinds are not known here",
        "{detail}",
    ),
]

_GROUPS = (_HEADING, _RUDDER, _MOTION, _OWN, _OUTSIDE, _WAITING, _ARRIVED, _GUIDES, _LINES)
CATALOGUE = {kind.name: kind for group in _GROUPS for kind in group}
"""Every alarm by its name."""

assert len(CATALOGUE) == sum(map(len, _GROUPS))


def kind_of(event: AlarmEvent) -> AlarmKind:
    """Return the row that an event is of; KeyError for a name that is not in the table."""
    return CATALOGUE[event.name]
