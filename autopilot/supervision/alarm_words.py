"""The words of every alarm: what is the case, what to do about it, when it is raised, and who watches for it.

Nothing is decided by them: what follows from an alarm stands in `autopilot.supervision.alarms`. They are read where
people read, by `autopilot.supervision.panel` and the page docs/alarms.md. Pure.
"""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple


class Watcher(Enum):
    """Who watches for it; the value says so in words."""

    PILOT = "the pilot, every tick"
    LINK = "the link to the vehicle or the rudder drive"
    LOOP = "the loop around the pilot"
    VEHICLE = "the vehicle, in what it says of itself"


PLAIN = "{text}{bracketed}: {remedy}"
"""How an alarm is said where its words say nothing else: what is the case, the detail in brackets, what to do."""


class Words(NamedTuple):
    """Of one alarm. text: what is the case; remedy: what to do; limit: when it is raised; key: where the file says so;
    sentence: how it is said, see `autopilot.supervision.panel`."""

    text: str
    remedy: str
    limit: str
    key: str = ""
    sentence: str = PLAIN
    watcher: Watcher = Watcher.PILOT


WORDS = {
    "heading_lost": Words(
        "heading lost",
        "steer by hand, check the compass and its link",
        "no heading for the time in the file",
        key="failsafe.heading_timeout_s",
    ),
    "heading_frozen": Words(
        "heading frozen: the compass stands still while the boat turns",
        "steer by hand, restart the compass",
        "the heading stays the same to the last digit while the rate of turn spans 5 deg, the rudder is worth 15 deg "
        "of turn, or a sea that moved it before goes on for 3 s",
        key="alarms.frozen_heading",
    ),
    "heading_jumping": Words(
        "the heading jumps further than the boat can turn",
        "steer by hand, look for iron, loose plugs or a second compass at the same line",
        "two headings in a row differ by this angle three times within 10 s, or once for good",
        key="alarms.heading_jump_deg",
    ),
    "heading_disagrees": Words(
        "heading monitor: two compasses disagree",
        "compare both with the hand-bearing compass, take the wrong one out of sensors.priority",
        "the two headings differ by more than the file's limit for several seconds",
        key="sensors.heading_monitor_deg",
        watcher=Watcher.LINK,
    ),
    "variation_unknown": Words(
        "headings come that take the magnetic variation, and it is not known",
        "set sensors.variation_deg, or sensors.magnetic: true to steer magnetic courses",
        "for 3 s, while no other headings come over the same link",
        key="sensors.variation_deg",
        watcher=Watcher.LINK,
    ),
    "variation_jumped": Words(
        "an instrument's magnetic variation has jumped; the old one is used while we steer",
        "check the instrument's place and date; if the new one is right, release for 10 s and engage again",
        "it differs by more than 2 deg from what the same instrument gave before; the new value is taken after 10 s "
        "in standby, at once where the old one was 0; a value of 0 is never taken",
        key="sensors.variation_deg",
        watcher=Watcher.LINK,
    ),
    "rate_disagrees": Words(
        "the rate of turn and the heading do not go together",
        "check the rate sensor's sign, scale and zero, and the heading by a second compass",
        "over 5 s the rate of turn adds up to an angle that differs by this much from the change of heading, or goes "
        "to the other side; or two rates within 5 s are each more than twice what the rudder gives hard over, and the "
        "heading shows no such turn: the boat is then steered by heading alone; or both drift apart by more than "
        "0.75 deg/s, which is then subtracted from the rate",
        key="alarms.rate_disagrees_deg",
    ),
    "innovation": Words(
        "the boat does not move as its model says",
        "look for a fouled propeller, a tow or a shifted load; identify the boat anew if it stays",
        "the measurements are off the model's forecast, to one side, by this many standard deviations for 20 s",
        key="alarms.innovation_sigmas",
    ),
    "rudder_stuck": Words(
        "steering gear: rudder not responding",
        "steer by hand, check drive, clutch and fuse",
        "off its order by more than the tolerance, and standing still, for 1.2 s plus the gear's delay and lag; or "
        "the boat does not answer its rudder",
        key="rudder.follow_tolerance_deg, alarms.reversed_rudder",
    ),
    "rudder_not_following": Words(
        "steering gear: rudder does not follow its orders",
        "steer by hand, check drive, clutch and rudder sensor",
        "off its order by more than the tolerance, and not moving towards it, for 1.2 s plus the gear's delay and "
        "lag; on a course-unstable boat also a rudder at a quarter of its filed rate",
        key="rudder.follow_tolerance_deg",
    ),
    "rudder_reversed": Words(
        "steering gear: rudder moves the wrong way",
        "steer by hand, check drive.reversed or helm.reversed and the rudder sensor's sign",
        "the rudder sensor shows it moving away from its order, or the boat answers as if the rudder were on the "
        "other side",
        key="alarms.reversed_rudder",
    ),
    "runaway": Words(
        "the boat turns against its rudder",
        "steer by hand, check that the rudder moves, its sign, and the way through the water",
        "with the rudder hard over for three time constants, the boat turns to the other side nearly as fast as a "
        "rudder hard over there would turn it, on average too, and by 20 deg and twice the waves' yaw since the rudder "
        "came over; or in a zigzag it turns against its rudder, 45 deg beyond",
    ),
    "rudder_at_stop": Words(
        "rudder limit: the rudder stands at its stop",
        "slow down or ease sheets: there is no rudder left to steer with",
        "beyond nine tenths of the limit for 15 s, turns not counted",
        key="limits.angle_max_deg",
    ),
    "off_course": Words(
        "off heading",
        "check rudder, speed and wind, or order another course",
        "off the course by this angle for this time; in a turn, past the new course for 2 s",
        key="alarms.off_course_deg, alarms.off_course_s",
        sentence="{text} {detail}: {remedy}",
    ),
    "overpowered": Words(
        "the boat is pushed harder than its rudder can hold",
        "take way off, ease sheets, cut what the boat tows or has in its rudder",
        "by the model, what turns the boat besides rudder and waves exceeds the rudder's limit for 2 s, with the "
        "rudder hard over against it or held by a trial; or, with the rudder hard over for a time constant, the boat "
        "turns to the other side by 20 deg and twice the waves' yaw",
        key="alarms.reversed_rudder",
    ),
    "trial_doubtful": Words(
        "the boat does not turn as the trial's rudder should turn it",
        "the trial ends: see whether the heading is held; wait for the gust to pass, or look at the rudder",
        "in a trial, the evidence that the rudder does not answer reaches two thirds of that alarm's limit; or for "
        "0.3 s something pushes the boat to the other side harder than the trial's rudder does",
        key="alarms.reversed_rudder",
    ),
    "low_speed": Words(
        "too slow to steer, or astern",
        "make way ahead; until then the rudder waits amidships",
        "the speed is below this",
        key="control.steerage_m_s",
    ),
    "hunting": Words(
        "the boat swings from side to side by its own rudder",
        "slow down; check the speed log, the rudder's rate and play; stand by and engage again for the full gains",
        "four sweeps of the rudder in a row, alike or growing, by half its limit, each with 10 deg of heading; or "
        "four from stop to stop, where the rudder makes 98 % of the rate of turn; or two of 8 s or more that swing "
        "the boat three times as far as its model; or twice the rate that the rudder hard over gives. The law then "
        "uses a quarter of the gain, and a sixteenth if need be; a speed below the trial's is doubted first",
    ),
    "swinging": Words(
        "the boat swings from side to side however softly it is steered",
        "steer by hand; check speed log, rudder rate and rudder angle, then identify the boat anew",
        "six such sweeps from stop to stop under the soft law, or four of any size with a sixteenth of the gain; at "
        "once on a course-unstable boat",
    ),
    "circling": Words(
        "the boat goes round in circles",
        "steer by hand; check that the rudder moves, its sign, the speed log and the compass",
        "a net turn of 390 deg away from the heading ordered; 300 deg where the speed is doubted",
    ),
    "too_quick": Words(
        "the boat turns much faster than its file says",
        "steer by hand; check that the vessel file is this boat's, and the rudder angle at full PWM",
        "the boat turns at three times the rate that the model gives for the rudder hard over, for a second or 0.3 "
        "time constants, or at twice that rate with a sixteenth of the gain; or it answers its rudder more than four "
        "times as strongly as the model, to both sides",
        key="model.K_1_s, helm.rudder_at_full_pwm_deg",
    ),
    "lively": Words(
        "the boat answers its rudder more than its file says",
        "check the vessel file, the load and the rudder angle at full PWM; the boat is steered softly",
        "the answer to the rudder is 2.5 to 4 times the model's, to both sides; the law then uses a quarter of the "
        "gain",
        key="model.K_1_s, helm.rudder_at_full_pwm_deg",
    ),
    "rudder_slow": Words(
        "the rudder is much slower than its file says",
        "check the drive's supply and oil, and rudder.rate_max_deg_s; the boat is steered softly",
        "the rudder sensor, or the boat's answer, shows a quarter of the filed rate; the law then uses a quarter of "
        "the gain",
        key="rudder.rate_max_deg_s",
    ),
    "path_late": Words(
        "orders come to the rudder later than the file says",
        "use a quicker line, or let this one, or the computer, do less; the boat is steered by what is measured",
        "the echo of the orders, or a rudder sensor, shows that they arrive at least 0.05 s later than filed",
        key="control.loop_delay_s",
    ),
    "speed_doubtful": Words(
        "the speed does not go with the way the boat turns",
        "check the speed log; the boat is steered as at the speed of its trial",
        "the answer to the rudder is two and a half times that of the model at this speed, or the rate of turn "
        "half again what the rudder hard over gives at it, or the boat answers rather as at the trial's speed in three "
        "sweeps from stop to stop, or the answer is missing at a speed above the trial's",
        key="model.reference_speed_m_s",
    ),
    "thruster_weak": Words(
        "one of two thrusters gives less thrust than it is asked for",
        "look for weed, a rope or a motor that stands still on that side; without it the boat is held, but not driven",
        "at the same throttle, for 0.6 s, the boat is pushed to that side by 0.3 of the thruster's moment and is a "
        "tenth slower",
        key="drive.kind",
    ),
    "bow_thruster_off": Words(
        "the bow thruster is not used",
        "do what stands behind it; the boat is steered by its rudder alone",
        "the flight controller's set-up would not stop it, or a hand has its lever",
        key="drive.bow_thruster",
    ),
    "bow_thruster_not_following": Words(
        "the bow thruster's output does not follow its orders",
        "stop what else overrides its channel; look at its SERVOn_FUNCTION; engage again to try it anew",
        "the channel, or the output behind it, shows another pulse than ordered for 1 s; said where it is needed",
        key="drive.bow_thruster.channel",
    ),
    "bow_thruster_hot": Words(
        "the bow thruster has run for as long as it may, and cools",
        "make way, or let the boat lie; it runs again when it has half cooled",
        "it has run at full for this long, less the time it has rested",
        key="drive.bow_thruster.run_s",
    ),
    "bow_thruster_weak": Words(
        "the boat does not turn for its bow thruster",
        "look for weed, a rope, its fuse or its battery; make way; engage again to have it tried anew",
        "less than a quarter of the turn that the thruster makes, after its dead time and 3 s or rate_time_s, and no "
        "falling back when it is stopped then",
        key="drive.bow_thruster",
    ),
    "speeds_disagree": Words(
        "the speed log and the speed over ground do not go together",
        "clean or check the log's impeller; the boat is steered as for the mean of both",
        "one is more than twice the other, and they differ by 5 kn",
    ),
    "roll": Words(
        "heeling",
        "ease sheets, slow down, or change course",
        "this angle for 2 s",
        key="alarms.roll_deg",
        sentence="{text} {detail}: {remedy}",
    ),
    "no_wind": Words(
        "the wind is not known, so the fail-safe cannot turn to windward: rudder amidships",
        "steer by hand, check the wind vane and its link",
        "no wind for 5 s while failsafe.action is windward",
        key="failsafe.action",
    ),
    "not_finite": Words(
        "a value was not finite",
        "steer by hand, keep the log and report it",
        "a state, demand or command is not a finite number",
    ),
    "envelope": Words(
        "a command was outside its envelope",
        "steer by hand, keep the log and report it",
        "angle, rate, age or side of a command, as a second, independent check computes it",
        key="limits.angle_max_deg, limits.rate_max_deg_s",
    ),
    "deadline_missed": Words(
        "the loop runs late",
        "stop other programs on this machine, run autopilot doctor",
        "within 10 s, three ticks come three control periods after the tick before, or one comes a second after it",
        key="control.rate_hz",
        watcher=Watcher.LOOP,
    ),
    "clock_stepped": Words(
        "the machine's clock was set while steering",
        "check the log's times; steering goes by a clock that cannot be set",
        "wall clock and monotonic clock apart by more than 1 s",
        watcher=Watcher.LOOP,
    ),
    "disk_full": Words(
        "the disk is full and the log has stopped",
        "free space; steering goes on without a log",
        "a write to the log fails (said in the words of what failed)",
        watcher=Watcher.LOOP,
    ),
    "human_override": Words(
        "overridden",
        "the helm is yours; order the course again when you want to give it back",
        "another mode, disarmed, a stick moved that is not overridden, or a rudder that somebody else moves",
        watcher=Watcher.LINK,
    ),
    "link_silent": Words(
        "the vehicle is silent",
        "steer by hand, check its power and the line to it",
        "nothing for 3 s, or no heartbeat for 8 s",
        watcher=Watcher.LINK,
    ),
    "radio_lost": Words(
        "the radio is lost",
        "steer by hand or from the ground station, switch the transmitter on; the vehicle acts on the loss by itself",
        "RC_CHANNELS shows a throttle below FS_THR_VALUE, an rssi fallen to 0 or no channels left; or SYS_STATUS "
        "or STATUSTEXT (Radio Failsafe) says so; not where FS_THR_ENABLE is 0",
        watcher=Watcher.LINK,
    ),
    "firmware_rebooted": Words(
        "the vehicle has rebooted",
        "steer by hand, arm it and order the course again",
        "its clock goes backwards",
        key="failsafe.reengage_after_reboot",
        watcher=Watcher.LINK,
    ),
    "stood_still": Words(
        "this computer stood still",
        "steer by hand, find out what stopped it, and order the course again",
        "no order left for longer than the vehicle waits for one (RC_OVERRIDE_TIME, 3 s in GUIDED); on other "
        "rudder drives for longer than 3 s and than a heading may stay away",
        key="failsafe.heading_timeout_s",
        watcher=Watcher.LINK,
    ),
    "link_flooded": Words(
        "more comes in over a link than can be read",
        "find out who sends so much, and take them off the line",
        "a ground station's messages dropped to keep the loop in time",
        watcher=Watcher.LINK,
    ),
    "station_silent": Words(
        "a ground station is silent",
        "check its link and that its program runs; as soon as it sends again, from any port, it is heard",
        "a ground station that was heard sends nothing for 5 s: its place is free for another",
        watcher=Watcher.LINK,
    ),
    "handback_refused": Words(
        "the vehicle did not take over in the mode of the fail-safe",
        "steer by hand, or set the vehicle's mode from the ground station",
        "the mode is not seen within 3 s",
        key="failsafe.firmware_mode",
        watcher=Watcher.LINK,
    ),
    "attitude_unhealthy": Words(
        "the vehicle says that its compass or attitude is not healthy",
        "compare the heading with a compass, and steer by hand where it drifts",
        "the compass or AHRS in SYS_STATUS is enabled and unhealthy",
        watcher=Watcher.VEHICLE,
    ),
    "compass_doubtful": Words(
        "the vehicle's compass does not go with how it moves",
        "compare the heading with a compass, and steer by hand where it differs; look for iron, a current or a loose "
        "compass, and calibrate it anew",
        "compass_variance in EKF_STATUS_REPORT is 0.8 or more for 3 s, until below 0.5; or its filter has no attitude",
        watcher=Watcher.VEHICLE,
    ),
    "vehicle_failsafe": Words(
        "the vehicle says that it is in a fail-safe",
        "read its texts; be ready at the helm, for it may change its mode",
        "MAV_STATE in its heartbeat is critical",
        watcher=Watcher.VEHICLE,
    ),
    "vehicle_failed": Words(
        "the vehicle says that it has failed",
        "take the helm by hand, and stop the engine if it does not obey",
        "MAV_STATE in its heartbeat is emergency, power off or flight termination",
        watcher=Watcher.VEHICLE,
    ),
    "geofence": Words(
        "the vehicle says that its fence is breached",
        "turn back inside the fence, or change it in the vehicle",
        "FENCE_STATUS, or the fence in SYS_STATUS enabled and unhealthy",
        watcher=Watcher.VEHICLE,
    ),
    "shallow": Words(
        "shallow water",
        "slow down and turn to deeper water",
        "the vehicle's STATUSTEXT says so",
        watcher=Watcher.VEHICLE,
    ),
    "battery_low": Words(
        "the vehicle's battery is low",
        "make for harbour, switch off what is not needed",
        "what remains in SYS_STATUS or BATTERY_STATUS, or its charge state",
        key="alarms.battery_percent",
        watcher=Watcher.VEHICLE,
    ),
    "waiting_heading": Words(
        "waiting for a heading",
        "check that the compass or the vehicle sends one",
        "an order to engage before a heading",
    ),
    "cannot_engage": Words(
        "not engaged",
        "put right what is said here; the order waits for it 30 s",
        "an order to engage comes while somebody else has the helm, or a fault lasts",
        sentence="{text}: {detail}",
    ),
    "order_dropped": Words(
        "the order to engage was dropped",
        "put right what is said here and order again",
        "such an order has waited 30 s",
        sentence="{text}: {because}; order again",
    ),
    "route_ended": Words(
        "the route has ended",
        "give a heading or take the helm",
        "the last waypoint is passed: the last course is held",
        sentence="{text}: {detail}; {remedy}",
        watcher=Watcher.LOOP,
    ),
    "place_reached": Words(
        "the place has been reached",
        "give a heading or take the helm",
        "the place that a ground station sent the boat to: the last course is held",
        sentence="{text}: {detail}; {remedy}",
        watcher=Watcher.LOOP,
    ),
    "man_overboard": Words(
        "man overboard",
        "point at them, turn back under the helm that you trust; mob off ends this",
        "the skipper has said so",
        sentence="{text} at {detail}: {remedy}",
        watcher=Watcher.LOOP,
    ),
    "position_lost": Words(
        "position lost, the route is not followed",
        "check the GPS and its link",
        "no position for the time in the file while a route leads",
        sentence="{text}: {detail}; {remedy}",
        watcher=Watcher.LOOP,
    ),
    "position_jumped": Words(
        "position jumped",
        "check the GPS, then begin the route again",
        "the position moves further than the boat can have gone, while a route leads",
        sentence="{text} by {detail}; {remedy}",
        watcher=Watcher.LOOP,
    ),
    "off_track": Words(
        "off the track",
        "check the current, the rudder and the speed",
        "further off the leg than the file says",
        sentence="more than {detail} of the track: {remedy}",
        watcher=Watcher.LOOP,
    ),
    "current_too_strong": Words(
        "the current is too strong for the route",
        "go faster, wait for slack water or choose another route",
        "on this leg or a later one, the current across or against is more than the boat can hold at its speed",
        sentence="{text}, {detail}: {remedy}",
        watcher=Watcher.LOOP,
    ),
    "plotter_turn": Words(
        "the chart plotter wants a turn",
        "not turning; type f to turn",
        "its new leg needs a turn of more than 100 deg",
        sentence="{text} to {detail}: {remedy}",
        watcher=Watcher.LOOP,
    ),
    "plotter_invalid": Words(
        "the chart plotter does not lead",
        "check its route",
        "its sentences say that they are not valid",
        sentence="{text} {detail}",
        watcher=Watcher.LOOP,
    ),
    "plotter_silent": Words(
        "the chart plotter has been silent",
        "check its route and its link",
        "no sentence for 8 s",
        sentence="{text} {detail}; {remedy}",
        watcher=Watcher.LOOP,
    ),
    "plotter_arrived": Words(
        "the chart plotter leads no further",
        "give a heading or take the helm",
        "its last waypoint is passed by for 5 s: the leg is held on",
        sentence="{text} than {detail}; {remedy}",
        watcher=Watcher.LOOP,
    ),
    "wind_awaited": Words(
        "no wind is heard",
        "engaging when it is; check the wind vane and its link (MWV, 130306; ArduRover: WNDVN_TYPE, WNDVN_SPEED_TYPE)",
        "the wind hold is ordered before a wind is known",
        watcher=Watcher.LOOP,
    ),
    "wind_lost": Words(
        "wind lost",
        "check the wind vane and its link, then order the wind hold again",
        "while it leads, no wind for 5 s, a vane that repeats itself for 30 s or through a turn of 10 deg, or a true "
        "wind without a speed",
        sentence="{text}: {detail}; {remedy}",
        watcher=Watcher.LOOP,
    ),
    "wind_shifted": Words(
        "the wind has shifted",
        "check the course",
        "alarms.wind_shift_deg from the heading held, or from the course that the wind hold led along",
        sentence="{text} by more than {detail}: {remedy}",
        watcher=Watcher.LOOP,
    ),
    "wind_turn_asked": Words(
        "a turn waits to be confirmed",
        "confirm it within 10 s, or it is cancelled",
        "a tack or gybe is ordered",
        sentence="{detail}: {remedy}",
        watcher=Watcher.LOOP,
    ),
    "wind_turn_stalled": Words(
        "the tack or gybe does not go on",
        "back the jib or bear away by hand, and begin it again with more way",
        "in a tack or gybe no 5 deg nearer to the other side for 12 s: in irons, for instance",
        sentence="{text}, {detail} are left: {remedy}",
        watcher=Watcher.LOOP,
    ),
    "compass_silent": Words(
        "one of two compasses is silent",
        "check its plug and power",
        "while another steers, for a minute",
        sentence="{text}: {detail}: {remedy}",
        watcher=Watcher.LINK,
    ),
    "headings_slow": Words(
        "headings come more slowly than asked for",
        "raise the link's baud rate (SERIALn_BAUD), let ground stations ask for less (SRn_ parameters), or lower "
        "control.rate_hz",
        "asked for repeatedly, and still too slow",
        sentence="headings (ATTITUDE) come at {detail} were asked for again and again: {remedy}",
        watcher=Watcher.LINK,
    ),
    "targets_lag": Words(
        "the vehicle takes our headings but does not turn",
        "check that it makes way (throttle stick, helm.guided_speed_share) and its steering gains (ATC_STR_RAT_FF, "
        "ATC_STR_ANG_P)",
        "far off the heading ordered for long, and no nearer",
        watcher=Watcher.LINK,
    ),
    "other_pilot": Words(
        "another pilot steers this boat too",
        "two helms fight, let one stand by",
        "it says so while we steer",
        watcher=Watcher.LINK,
    ),
    "other_pilot_waits": Words(
        "another pilot wants to engage on this boat",
        "let one stand by",
        "it says so while we steer",
        sentence="{text}",
        watcher=Watcher.LINK,
    ),
    "input_shared": Words(
        "another pilot or ground station overrides the steering input now and then",
        "let one stand by",
        "the steering input shows pulses that are none of ours",
        sentence="{text}",
        watcher=Watcher.LINK,
    ),
    "motor_current": Words(
        "the rudder motor draws too much",
        "look whether the rudder is jammed",
        "more than drive.current_max_a for longer than a motor takes to start",
        sentence="the rudder motor draws {detail}: {remedy}",
        watcher=Watcher.LINK,
    ),
    "drive_warning": Words(
        "the rudder drive warns",
        "as it says",
        "the drive reports it",
        sentence="{detail}",
        watcher=Watcher.LINK,
    ),
    "line_lost": Words(
        "a line is lost",
        "check plug and adapter; it is opened again as soon as it is there",
        "an adapter is pulled, or a connection closed",
        sentence="{detail}",
        watcher=Watcher.LINK,
    ),
    "station_lost": Words(
        "ground station lost, steering goes on",
        "check its link, as it says",
        "the line to a ground station fails",
        sentence="{text}: {detail}",
        watcher=Watcher.LINK,
    ),
    "station_stopped": Words(
        "a ground station without a key has let the pilot stand by",
        "steer by hand, or order the course again",
        "an order to stand by from a station that only looks, while an order to steer was in force",
        sentence="{text}{bracketed}: steer by hand",
        watcher=Watcher.LINK,
    ),
    "stop_refused": Words(
        "a ground station without a key wants the pilot to stand by",
        "look around; it is not obeyed again so soon after you have engaged anew: stand by at the helm if it is right",
        "an order to stand by from a station that only looks, within 1 to 60 min of engaging anew after such an order",
        watcher=Watcher.LINK,
    ),
    "forwarding_ended": Words(
        "forwarding to a ground station ended, steering goes on",
        "check its link, as it says",
        "the line to a ground station behind the router fails",
        sentence="{text}: {detail}",
        watcher=Watcher.LINK,
    ),
    "output_failed": Words(
        "the alarm output cannot be written",
        "check alarms.outputs and its permissions",
        "a write to the file of an alarm output fails",
        watcher=Watcher.LOOP,
    ),
    "other": Words(
        "what has no kind of its own",
        "as it says",
        "only in logs of other versions, whose kinds are not known here",
        sentence="{detail}",
        watcher=Watcher.LINK,
    ),
}
"""By the alarms' names."""
