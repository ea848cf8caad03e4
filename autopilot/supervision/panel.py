"""What people hear and read of alarms: which of them sound, until when, and what is the case and what to do, in words.

An alarm sounds until it is acknowledged or over, and louder when nobody has for half a minute. Its words are read where
people read: on a screen, in a STATUSTEXT, in a report.

Nothing is decided by words: what follows from an alarm stands in the table of `autopilot.supervision.alarms`; when each
is raised stands in docs/alarms.md. Pure.
"""

from __future__ import annotations

from collections.abc import Container, Iterable, Mapping
from typing import NamedTuple

from autopilot.signals import AcknowledgeSample, AlarmEvent, AlarmState, Order, OrderKind, Sample, Siren
from autopilot.supervision.alarms import APART, AT_STOP, FAILED, OVERRIDDEN, VERBATIM, kind_of

PLAIN = "{text}{bracketed}: {remedy}"
"""How an alarm is said where its words say nothing else: what is the case, the detail in brackets, what to do."""


class Words(NamedTuple):
    """Of one alarm. text: what is the case; remedy: what to do; sentence: how it is said, see `_said`."""

    text: str
    remedy: str
    sentence: str = PLAIN


WORDS = {
    "heading_lost": Words("heading lost", "steer by hand, check the compass and its link"),
    "heading_frozen": Words(
        "heading frozen: the compass stands still while the boat turns", "steer by hand, restart the compass"
    ),
    "heading_jumping": Words(
        "the heading jumps further than the boat can turn",
        "steer by hand, look for iron, loose plugs or a second compass at the same line",
    ),
    "compass_jumped": Words(
        "the compass jumps and the boat does not turn",
        "look for iron, a loose plug or two compasses on one line; it is followed slowly from 30 s on: steer by hand "
        "if it is wrong",
    ),
    "heading_disagrees": Words(
        "heading monitor: two compasses disagree",
        "compare both with the hand-bearing compass, take the wrong one out of sensors.priority",
    ),
    "variation_unknown": Words(
        "the headings need the magnetic variation, which is not known",
        "set sensors.variation_deg, or sensors.magnetic: true to steer magnetic courses",
    ),
    "variation_jumped": Words(
        "an instrument's magnetic variation has jumped; the old one is used while we steer",
        "check the instrument's place and date; if the new one is right, release for 10 s and engage again",
    ),
    "rate_disagrees": Words(
        "the rate of turn and the heading do not agree",
        "check the rate sensor's sign, scale and zero, and the heading by a second compass",
    ),
    "innovation": Words(
        "the boat does not move as its model says",
        "look for a fouled propeller, a tow or a shifted load; identify the boat anew if it stays",
    ),
    "rudder_stuck": Words("steering gear: rudder not responding", "steer by hand, check drive, clutch and fuse"),
    "rudder_not_following": Words(
        "steering gear: rudder does not follow its orders", "steer by hand, check drive, clutch and rudder sensor"
    ),
    "rudder_reversed": Words(
        "steering gear: rudder moves the wrong way",
        "steer by hand; if it followed until now, check drive, valves and rudder sensor, else drive.reversed or "
        "helm.reversed and the sensor's sign",
    ),
    "runaway": Words(
        "the boat turns against its rudder",
        "steer by hand, check that the rudder moves, its sign, and the way through the water",
    ),
    "rudder_at_stop": Words(
        "rudder limit: the rudder stands at its stop", "slow down or ease sheets: there is no rudder left to steer with"
    ),
    "off_course": Words(
        "off heading", "check rudder, speed and wind, or order another course", sentence="{text} {detail}: {remedy}"
    ),
    "overpowered": Words(
        "the boat is pushed harder than its rudder can hold",
        "take way off, ease sheets, cut what the boat tows or has in its rudder",
    ),
    "trial_doubtful": Words(
        "the boat does not turn as the trial's rudder should turn it",
        "the trial ends: see whether the heading is held; wait for the gust to pass, or look at the rudder",
    ),
    "low_speed": Words("too slow to steer, or astern", "make way ahead; until then the rudder waits amidships"),
    "hunting": Words(
        "the boat swings from side to side by its own rudder",
        "slow down; check the speed log, the rudder's rate and play; stand by and engage again for the full gains",
    ),
    "swinging": Words(
        "the boat swings from side to side however softly it is steered",
        "steer by hand; check speed log, rudder rate and rudder angle, then identify the boat anew",
    ),
    "circling": Words(
        "the boat goes round in circles",
        "steer by hand; check that the rudder moves, its sign, the speed log and the compass",
    ),
    "too_quick": Words(
        "the boat turns much faster than its file says",
        "steer by hand; check that the vessel file is this boat's, and the rudder angle at full PWM",
    ),
    "lively": Words(
        "the boat answers its rudder more strongly than its file says",
        "check the vessel file, the load and the rudder angle at full PWM; the boat is steered softly",
    ),
    "rudder_slow": Words(
        "the rudder is much slower than its file says",
        "check the drive's supply and oil, and rudder.rate_max_deg_s; the boat turns more slowly",
    ),
    "path_late": Words(
        "orders reach the rudder later than the file says",
        "use a faster line, or give this one, or the computer, less to do; steering goes by the measured delay",
    ),
    "speed_doubtful": Words(
        "the speed does not match the way the boat turns",
        "check the speed log; the boat is steered as at the speed of its trial",
    ),
    "thruster_weak": Words(
        "one of two thrusters gives less thrust than it is asked for",
        "look for weed, a rope or a motor that stands still on that side; the other one holds the boat, and drives it "
        "by swings: type swing",
    ),
    "bow_thruster_off": Words(
        "the bow thruster is not used", "put right what is said here; the boat is steered by its rudder alone"
    ),
    "bow_thruster_not_following": Words(
        "the bow thruster's output does not follow its orders",
        "stop what else overrides its channel; look at its SERVOn_FUNCTION; engage again to try it anew",
    ),
    "bow_thruster_hot": Words(
        "the bow thruster has run for as long as it may and is cooling down",
        "make way, or let the boat lie; it runs again when it has half cooled",
    ),
    "bow_thruster_weak": Words(
        "the bow thruster does not turn the boat",
        "look for weed, a rope, its fuse or battery, or, where it pushes the wrong way, at "
        "drive.bow_thruster.reversed; make way; engage to try it anew",
    ),
    "speeds_disagree": Words(
        "the speed log and the speed over ground do not agree",
        "clean or check the log's impeller; the boat is steered as for the mean of both",
    ),
    "roll": Words("heeling", "ease sheets, slow down, or change course", sentence="{text} {detail}: {remedy}"),
    "no_wind": Words(
        "the wind is not known, so the fail-safe cannot turn to windward: rudder amidships",
        "steer by hand, check the wind vane and its link",
    ),
    "not_finite": Words("a value was not finite", "steer by hand, keep the log and report it"),
    "envelope": Words("a command was outside its envelope", "steer by hand, keep the log and report it"),
    "deadline_missed": Words("the loop runs late", "stop other programs on this machine, run autopilot doctor"),
    "clock_stepped": Words(
        "the machine's clock was set while steering",
        "check the log's times; steering goes by a clock that cannot be set",
    ),
    "disk_full": Words("the disk is full and the log has stopped", "free space; steering goes on without a log"),
    "human_override": Words("overridden", "the helm is yours; order the course again when you want to give it back"),
    "link_silent": Words("the vehicle is silent", "steer by hand, check its power and the line to it"),
    "radio_lost": Words(
        "the radio is lost",
        "steer by hand or from the ground station, switch the transmitter on; the vehicle acts on the loss by itself",
    ),
    "firmware_rebooted": Words("the vehicle has rebooted", "steer by hand, arm it and order the course again"),
    "stood_still": Words(
        "this computer stood still", "steer by hand, find out what stopped it, and order the course again"
    ),
    "link_flooded": Words(
        "more comes in over a link than can be read in time", "find out who sends so much, and take them off the line"
    ),
    "station_silent": Words(
        "a ground station is silent",
        "check its link and that its program runs; as soon as it sends again, from any port, it is heard",
    ),
    "handback_refused": Words(
        "the vehicle did not take over in the mode of the fail-safe",
        "steer by hand, or set the vehicle's mode from the ground station",
    ),
    "attitude_unhealthy": Words(
        "the vehicle says that its compass or attitude is not healthy",
        "compare the heading with a compass, and steer by hand where it drifts",
    ),
    "compass_doubtful": Words(
        "the vehicle's compass does not match its motion",
        "compare the heading with a compass, and steer by hand where it differs; look for iron, a current or a loose "
        "compass, and calibrate it anew",
    ),
    "vehicle_failsafe": Words(
        "the vehicle says that it is in a fail-safe",
        "read its messages; be ready at the helm, for it may change its mode",
    ),
    "vehicle_failed": Words(
        "the vehicle says that it has failed", "take the helm by hand, and stop the engine if it does not obey"
    ),
    "geofence": Words(
        "the vehicle says that its fence is breached", "turn back inside the fence, or change it in the vehicle"
    ),
    "shallow": Words("shallow water", "slow down and turn to deeper water"),
    "battery_low": Words("the vehicle's battery is low", "make for harbour, switch off what is not needed"),
    "waiting_heading": Words(
        "waiting for a heading", "check that the compass or the vehicle sends one, and that it does not jump"
    ),
    "cannot_engage": Words(
        "not engaged", "put right what is said here; the order waits for it 30 s", sentence="{text}: {detail}"
    ),
    "order_dropped": Words(
        "the order to engage was dropped",
        "put right what is said here and order again",
        sentence="{text}: {because}; order again",
    ),
    "route_ended": Words(
        "the route has ended", "give a heading or take the helm", sentence="{text}: {detail}; {remedy}"
    ),
    "place_reached": Words(
        "the place has been reached", "give a heading or take the helm", sentence="{text}: {detail}; {remedy}"
    ),
    "man_overboard": Words(
        "man overboard",
        "keep pointing at them and turn back, by hand if in doubt; mob off ends this",
        sentence="{text} at {detail}: {remedy}",
    ),
    "position_lost": Words(
        "position lost, the route is not followed", "check the GPS and its link", sentence="{text}: {detail}; {remedy}"
    ),
    "position_jumped": Words(
        "position jumped", "check the GPS, then begin the route again", sentence="{text} by {detail}; {remedy}"
    ),
    "off_track": Words(
        "off the track",
        "check the current, the rudder and the speed",
        sentence="more than {detail} of the track: {remedy}",
    ),
    "current_too_strong": Words(
        "the current is too strong for the route",
        "go faster, wait for slack water or choose another route",
        sentence="{text}, {detail}: {remedy}",
    ),
    "plotter_turn": Words(
        "the chart plotter wants a turn", "not turning; type f to turn", sentence="{text} to {detail}: {remedy}"
    ),
    "plotter_invalid": Words("the chart plotter does not lead", "check its route", sentence="{text} {detail}"),
    "plotter_silent": Words(
        "the chart plotter has been silent", "check its route and its link", sentence="{text} {detail}; {remedy}"
    ),
    "plotter_arrived": Words(
        "the chart plotter leads no further",
        "give a heading or take the helm",
        sentence="{text} than {detail}; {remedy}",
    ),
    "wind_awaited": Words(
        "no wind is heard",
        "engaging when it is; check the wind vane and its link (MWV, 130306; ArduRover: WNDVN_TYPE, WNDVN_SPEED_TYPE)",
    ),
    "wind_lost": Words(
        "wind lost",
        "check the wind vane and its link, or wait where it is calm; then order the wind hold again",
        sentence="{text}: {detail}; {remedy}",
    ),
    "wind_shifted": Words(
        "the wind has shifted", "check the course", sentence="{text} by more than {detail}: {remedy}"
    ),
    "wind_turn_asked": Words(
        "a turn is waiting to be confirmed", "confirm it within 10 s, or it is cancelled", sentence="{detail}: {remedy}"
    ),
    "wind_turn_stalled": Words(
        "the tack or gybe has stalled",
        "back the jib or bear away by hand, and begin it again with more way",
        sentence="{text}, {detail} are left: {remedy}",
    ),
    "compass_silent": Words(
        "one of two compasses is silent",
        "check its plug and power, or choose another",
        sentence="{text}: {detail}: {remedy}",
    ),
    "headings_slow": Words(
        "headings come more slowly than asked for",
        "raise the link's baud rate (SERIALn_BAUD), let ground stations ask for less (SRn_ parameters), or lower "
        "control.rate_hz",
        sentence="headings (ATTITUDE) come at {detail} were asked for again and again: {remedy}",
    ),
    "headings_late": Words(
        "headings come late by the vehicle's clock",
        "raise the link's baud rate (SERIALn_BAUD) or ask for less; where the line has room, that clock runs slow: "
        "mend it",
        sentence="{text} ({detail} old): {remedy}",
    ),
    "line_narrow": Words(
        "the line to the vehicle has no room for all that was asked for",
        "raise its baud rate (SERIALn_BAUD), or let ground stations ask for less (SRn_ parameters)",
        sentence="{text} ({detail}): {remedy}",
    ),
    "targets_lag": Words(
        "the vehicle takes our headings but does not turn",
        "check that it makes way (throttle stick, helm.guided_speed_share) and its steering gains (ATC_STR_RAT_FF, "
        "ATC_STR_ANG_P)",
    ),
    "other_pilot": Words("another pilot steers this boat too", "two helms fight: put one in standby"),
    "other_pilot_waits": Words("another pilot wants to engage on this boat", "put one in standby", sentence="{text}"),
    "input_shared": Words(
        "another pilot or ground station overrides the steering input now and then",
        "put one in standby",
        sentence="{text}",
    ),
    "servo_changed": Words(
        "the end points of a servo that steers were changed while we steered",
        "set that back, or start again to steer by the new ones",
        sentence="{detail} while we steered: {remedy}",
    ),
    "motor_current": Words(
        "the rudder motor draws too much",
        "look whether the rudder is jammed",
        sentence="the rudder motor draws {detail}: {remedy}",
    ),
    "drive_warning": Words("the rudder drive warns", "as it says", sentence="{detail}"),
    "line_lost": Words(
        "a line is lost", "check plug and adapter; it is opened again as soon as it is there", sentence="{detail}"
    ),
    "station_lost": Words(
        "ground station lost, steering goes on", "check its link, as it says", sentence="{text}: {detail}"
    ),
    "station_stopped": Words(
        "a ground station without a key has put the pilot in standby",
        "steer by hand, or order the course again",
        sentence="{text}{bracketed}: steer by hand",
    ),
    "stop_refused": Words(
        "a ground station without a key wants the pilot in standby",
        "look around and, if it is right, go to standby at the helm: so soon after engaging it is not obeyed again",
    ),
    "forwarding_ended": Words(
        "forwarding to a ground station ended, steering goes on",
        "check its link, as it says",
        sentence="{text}: {detail}",
    ),
    "output_failed": Words("the alarm output cannot be written", "check alarms.outputs and its permissions"),
    "change_not_kept": Words(
        "a change counts, but is not written yet, and would be lost at the end of this run",
        "free the disk, or look after it: it is tried again by itself, at least once a minute",
    ),
    "other": Words("what has no kind of its own", "as it says", sentence="{detail}"),
}
"""By the alarms' names."""


ESCALATES_AFTER = 30.0
REMEMBERED = 10.0
"""An alarm that comes back within this time [s] is the same one."""


class Entry(NamedTuple):
    """An alarm since when, and when last, it was the case [s]; whether it was acknowledged; since when it is past."""

    since: float
    last: float
    is_acknowledged: bool = False
    past_since: float | None = None


NO_ENTRIES: Mapping[str, Entry] = {}


class Memory(NamedTuple):
    """What the panel remembers: the alarms by name, and the order that was given last."""

    entries: Mapping[str, Entry] = NO_ENTRIES
    order: tuple[OrderKind, int] | None = None


QUIET = Memory()


class AlarmPanel:
    """`update` every tick with what is the case; an order of the skipper's acknowledges what sounds by then. For as
    long as a tick lasts: what it remembers is `memory`.

    Attributes:
        states: of the events that `update` returned last.
    """

    def __init__(self, memory: Memory = QUIET) -> None:
        self.memory = memory
        self.states: tuple[AlarmState, ...] = ()

    def update(
        self,
        now: float,
        raised: Mapping[str, AlarmEvent],
        samples: tuple[Sample, ...],
        order: Order,
        past: Container[str] = (),
    ) -> tuple[tuple[AlarmEvent, ...], Siren]:
        """Return the alarms to be shown at `now` [s], and what is to be heard.

        raised: the alarms by their names, or by who says them.
        past: names that are the case no more: said as ended until they are acknowledged, then gone.
        """
        given, before = (order.kind, order.serial), self.memory
        if not raised and not before.entries:
            self.states = ()
            if before.order != given:
                self.memory = Memory(before.entries, given)
            return (), Siren.QUIET
        entries = {name: entry for name, entry in before.entries.items() if now - entry.last <= REMEMBERED}
        for sample in samples:
            if isinstance(sample, AcknowledgeSample):
                alike = {key for key, event in raised.items() if event.name == sample.name}
                entries = acknowledged(entries, {*alike, sample.name} if sample.name else entries.keys())
        if before.order is not None and given != before.order:
            entries = acknowledged(entries, entries.keys())
        shown, states, siren = [], [], Siren.QUIET
        for name, event in raised.items():
            entry = entries[name] = raised_at(entries.get(name, Entry(now, now)), now, is_past=name in past)
            if entry.past_since is not None:
                if entry.is_acknowledged:
                    continue
                event = event._replace(is_past=True)
            audible = AlarmState.ACKNOWLEDGED if entry.is_acknowledged else AlarmState.SOUNDING
            state = audible if kind_of(event).sounds else AlarmState.NOTICE
            sounds = state is AlarmState.SOUNDING
            states.append(state)
            escalated = sounds and now - entry.since >= ESCALATES_AFTER
            shown.append(event._replace(is_escalated=True) if escalated else event)
            if sounds:
                siren = max(siren, Siren.ESCALATED if escalated else Siren.SOUNDING)
        self.states, self.memory = tuple(states), Memory(entries, given)
        return tuple(shown), siren


def raised_at(entry: Entry, now: float, *, is_past: bool) -> Entry:
    """Return the alarm that is raised at `now` [s], or said as ended."""
    if is_past:
        past_since = now if entry.past_since is None else entry.past_since
        return Entry(entry.since, now, entry.is_acknowledged, past_since)
    if entry.past_since is not None and now - entry.past_since > REMEMBERED:
        return Entry(now, now)
    return Entry(entry.since, now, entry.is_acknowledged)


def acknowledged(entries: dict[str, Entry], keys: Container[str]) -> dict[str, Entry]:
    """Return the alarms after the skipper has heard those of `keys`."""
    return {key: entry._replace(is_acknowledged=True) if key in keys else entry for key, entry in entries.items()}


UNACKNOWLEDGED = "NOT ACKNOWLEDGED: "
"""Before an alarm that has escalated: it is said again."""
FORMS = {
    OVERRIDDEN: "overridden: {detail}; {remedy}",
    AT_STOP: "{text} {detail}, the rudder at its stop: more way or less sail, check that the rudder moves",
    APART: (
        "{text} by {detail}; compare with a bearing, then put the right one first in sensors.priority, check deviation "
        "and variation"
    ),
    FAILED: "{text}: {detail}; restart the one that failed, and compare both with a bearing",
    VERBATIM: "{detail}",
}
"""The sentences beside an alarm's own."""


def sentence_of(event: AlarmEvent) -> str:
    """Return what is said of an alarm: what is the case, and what to do. KeyError for a name not in the table."""
    said = _said(event)
    return f"{UNACKNOWLEDGED}{said}" if event.is_escalated else said


def sentences_of(events: Iterable[AlarmEvent]) -> tuple[str, ...]:
    """Return what is said of each."""
    return tuple(sentence_of(event) for event in events)


def _said(event: AlarmEvent) -> str:
    words = WORDS[event.name]
    pattern = FORMS[event.form] if event.form else words.sentence
    names_it = "{text}" in pattern
    said = pattern.format(
        text=f"{words.text} (ended)" if event.is_past else words.text,
        detail=event.detail,
        bracketed=f" ({event.detail})" if event.detail else "",
        remedy=words.remedy,
        because="" if event.because is None else _reason(event.because),
    )
    return said if names_it or not event.is_past else f"ended: {said}"


def _reason(event: AlarmEvent) -> str:
    """Return why an order was dropped: what was against it, without saying once more that it cannot be done."""
    return event.detail if event.name == "cannot_engage" and event.detail else _said(event)
