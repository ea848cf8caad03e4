"""When each alarm is raised, the keys of the vessel file that say so, and who watches for it: for docs/alarms.md."""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple


class Watcher(Enum):
    """Who watches for it; the value says so in words."""

    PILOT = "the pilot, every tick"
    LINK = "the link to the vehicle or the rudder drive"
    LOOP = "the loop around the pilot"
    VEHICLE = "the vehicle, in what it says of itself"


class Condition(NamedTuple):
    """Of one alarm. limit: when it is raised; key: where the file says so."""

    limit: str
    key: str = ""
    watcher: Watcher = Watcher.PILOT


CONDITIONS = {
    "heading_lost": Condition("no heading for the time in the file", key="failsafe.heading_timeout_s"),
    "heading_frozen": Condition(
        "the heading stays the same to the last digit while the rate of turn spans 5 deg, or the rudder is worth 15 "
        "deg of turn, for 1.2 s, or by more than a third of that and what the boat turns in 1.2 s; or for 3 s "
        "where a sea moved it before, where its digits are finer than 0.002 deg, or where its own noise moved it by "
        "1.5 digits and more and it is further than a digit and two standard deviations from the heading that the "
        "boat had and the rudder since makes of it",
        key="alarms.frozen_heading",
    ),
    "heading_jumping": Condition(
        "two headings in a row differ by this angle three times within 10 s, or once for good, and the rate of turn "
        "beside both does not show that turn",
        key="alarms.heading_jump_deg",
    ),
    "compass_jumped": Condition(
        "the heading is off what the rate of turn carries on by 6 deg, by five times what usually lies between the "
        "two, and by what the boat turns in 1 s and the time between two headings, or at once by 6 deg, by five times "
        "what it usually changes by, and by what the boat turns in twice that time; where no rate is believed, by "
        "more at once than a boat like this turns, and no more than half of it before or after; and has come to "
        "rest there, or comes and goes three times within 20 s; by less than `heading_jumping` takes. While we steer "
        "the course is held for 30 s and the compass then followed by 0.25 deg/s; else it is followed at once",
        key="alarms.heading_jump_deg",
    ),
    "heading_disagrees": Condition(
        "the two headings differ by more than the file's limit for several seconds",
        key="sensors.heading_monitor_deg",
        watcher=Watcher.LINK,
    ),
    "variation_unknown": Condition(
        "for 3 s, while no other headings come over the same link", key="sensors.variation_deg", watcher=Watcher.LINK
    ),
    "variation_jumped": Condition(
        "it differs by more than 2 deg from what the same instrument gave before; the new value is taken after 10 s "
        "in standby, at once where the old one was 0; a value of 0 is never taken",
        key="sensors.variation_deg",
        watcher=Watcher.LINK,
    ),
    "rate_disagrees": Condition(
        "over 5 s the rate of turn adds up to an angle that differs by this much from the change of heading, or goes "
        "to the other side; or two rates within 5 s are each more than twice what the rudder gives hard over, and the "
        "heading shows no such turn; or it stays the same to the last digit for 1 s while the heading is 5 deg further "
        "on than it says, or for 1.2 s and longer than it ever did while that is 2.5 deg and more than its digits and "
        "noise allow: the boat is then steered by heading alone; or both drift apart by more than 0.75 deg/s, as far "
        "as the noise of both lets that be known, which is then subtracted from the rate",
        key="alarms.rate_disagrees_deg",
    ),
    "innovation": Condition(
        "the measurements are off the model's forecast, to one side, by this many standard deviations for 20 s",
        key="alarms.innovation_sigmas",
    ),
    "rudder_stuck": Condition(
        "off its order by more than the tolerance, and standing still, for 1.2 s plus the gear's delay and lag; or "
        "the boat does not answer its rudder",
        key="rudder.follow_tolerance_deg, alarms.reversed_rudder",
    ),
    "rudder_not_following": Condition(
        "off its order by more than the tolerance, and not moving towards it, for 1.2 s plus the gear's delay and "
        "lag; on a course-unstable boat also a rudder at a quarter of its filed rate",
        key="rudder.follow_tolerance_deg",
    ),
    "rudder_reversed": Condition(
        "the rudder sensor shows it moving away from its orders, those of the gear's delay and lag before included, by "
        "more than the tolerance, while these do not move that way; or the boat answers as if the rudder were on the "
        "other side",
        key="alarms.reversed_rudder",
    ),
    "runaway": Condition(
        "with the rudder hard over for three time constants, the boat turns to the other side nearly as fast as a "
        "rudder hard over there would turn it, on average too, and by 20 deg and twice the waves' yaw since the rudder "
        "came over; or in a zigzag it turns against its rudder, 45 deg beyond, and no slower than on average over a "
        "time constant"
    ),
    "rudder_at_stop": Condition(
        "beyond nine tenths of the limit for 15 s, turns not counted", key="limits.angle_max_deg"
    ),
    "off_course": Condition(
        "off the course by this angle for this time, or to one side and then the other; in a turn, past the new "
        "course for 2 s; until it has been within the angle, and where it was said within seven tenths of it, for 4 s "
        "or four time constants, and for no longer than this time",
        key="alarms.off_course_deg, alarms.off_course_s",
    ),
    "overpowered": Condition(
        "by the model, what turns the boat besides rudder and waves is twice the rudder's limit for 1.5 s, or beyond "
        "it by less for as much longer, with the rudder hard over against it or held by a trial; or, with the rudder "
        "hard over for a time constant, the boat turns to the other side by 20 deg and twice the waves' yaw",
        key="alarms.reversed_rudder",
    ),
    "trial_doubtful": Condition(
        "in a trial, the evidence that the rudder does not answer reaches two thirds of that alarm's limit; or for "
        "0.3 s something pushes the boat to the other side harder than the trial's rudder does",
        key="alarms.reversed_rudder",
    ),
    "low_speed": Condition("the speed is below this", key="control.steerage_m_s"),
    "hunting": Condition(
        "four sweeps of the rudder in a row, alike or growing, by half its limit, each with 10 deg of heading; or "
        "four from stop to stop, where the rudder makes 98 % of the rate of turn, or 99.5 % by orders of up to 1.2 s "
        "before; or two of 8 s or more that swing the boat three times as far as its model; or twice the rate that the "
        "rudder hard over gives. The law then uses a quarter of the gain, and a sixteenth if need be; a speed below "
        "the trial's is doubted first"
    ),
    "swinging": Condition(
        "six such sweeps from stop to stop under the soft law, or four of any size with a sixteenth of the gain; at "
        "once on a course-unstable boat"
    ),
    "circling": Condition("a net turn of 390 deg away from the heading ordered; 300 deg where the speed is doubted"),
    "too_quick": Condition(
        "the boat turns at three times the rate that the model gives for the rudder hard over, for a second or 0.3 "
        "time constants, or at twice that rate with a sixteenth of the gain; or it answers its rudder more than four "
        "times as strongly as the model, to both sides",
        key="model.K_1_s, helm.rudder_at_full_pwm_deg",
    ),
    "lively": Condition(
        "the answer to the rudder is 2.5 to 4 times the model's, to both sides; the law then uses a quarter of the "
        "gain",
        key="model.K_1_s, helm.rudder_at_full_pwm_deg",
    ),
    "rudder_slow": Condition(
        "the rudder sensor shows less than half of the filed rate to a side, or the boat's answer a quarter; turns are "
        "then planned with what was found; where the answer tells no rate, the law uses a quarter of the gain",
        key="rudder.rate_max_deg_s",
    ),
    "path_late": Condition(
        "the echo of the orders, or a rudder sensor, shows that they arrive at least 0.05 s later than filed",
        key="control.loop_delay_s",
    ),
    "speed_doubtful": Condition(
        "the answer to the rudder is two and a half times that of the model at this speed, or the rate of turn "
        "half again what the rudder hard over gives at it, or the boat answers rather as at the trial's speed in three "
        "sweeps from stop to stop, or the answer is missing at a speed above the trial's",
        key="model.reference_speed_m_s",
    ),
    "thruster_weak": Condition(
        "at the same throttle, for 0.6 s, the boat is pushed to that side by 0.3 of the moment that the thruster is "
        "asked for, in a turn and for 6 s behind it by 0.6, and is slower than before by a tenth more than a stream "
        "and less steering explain",
        key="drive.kind",
    ),
    "bow_thruster_off": Condition(
        "the flight controller's set-up would not stop it, or a hand has its lever", key="drive.bow_thruster"
    ),
    "bow_thruster_not_following": Condition(
        "the channel, or the output behind it, shows another pulse than ordered for 1 s; said where it is needed",
        key="drive.bow_thruster.channel",
    ),
    "bow_thruster_hot": Condition(
        "it has run at full for this long, less the time it has rested", key="drive.bow_thruster.run_s"
    ),
    "bow_thruster_weak": Condition(
        "less than a quarter of the turn that the thruster makes, after its dead time and 3 s or rate_time_s, and no "
        "falling back when it is stopped then",
        key="drive.bow_thruster",
    ),
    "speeds_disagree": Condition("one is more than twice the other, and they differ by 5 kn"),
    "roll": Condition("this angle for 2 s", key="alarms.roll_deg"),
    "no_wind": Condition("no wind for 5 s while failsafe.action is windward", key="failsafe.action"),
    "not_finite": Condition("a state, demand or command is not a finite number"),
    "envelope": Condition(
        "angle, rate, age or side of a command, as a second, independent check computes it",
        key="limits.angle_max_deg, limits.rate_max_deg_s",
    ),
    "deadline_missed": Condition(
        "within 10 s, three ticks come three control periods after the tick before, or one comes a second after it",
        key="control.rate_hz",
        watcher=Watcher.LOOP,
    ),
    "clock_stepped": Condition("wall clock and monotonic clock apart by more than 1 s", watcher=Watcher.LOOP),
    "disk_full": Condition("a write to the log fails (said in the words of what failed)", watcher=Watcher.LOOP),
    "human_override": Condition(
        "another mode, disarmed, a stick moved that is not overridden, a rudder that somebody else moves, or an input "
        "that somebody else overrides too, with no pause of 2.5 s, for 3 s",
        watcher=Watcher.LINK,
    ),
    "link_silent": Condition("nothing for 3 s, or no heartbeat for 8 s", watcher=Watcher.LINK),
    "radio_lost": Condition(
        "RC_CHANNELS shows a throttle below FS_THR_VALUE, an rssi fallen to 0 or no channels left; or SYS_STATUS "
        "or STATUSTEXT (Radio Failsafe) says so; not where FS_THR_ENABLE is 0",
        watcher=Watcher.LINK,
    ),
    "firmware_rebooted": Condition(
        "its clock goes backwards", key="failsafe.reengage_after_reboot", watcher=Watcher.LINK
    ),
    "stood_still": Condition(
        "no order left for longer than the vehicle waits for one (RC_OVERRIDE_TIME, 3 s in GUIDED); on other "
        "rudder drives for longer than 3 s and than a heading may stay away",
        key="failsafe.heading_timeout_s",
        watcher=Watcher.LINK,
    ),
    "link_flooded": Condition("a ground station's messages dropped to keep the loop in time", watcher=Watcher.LINK),
    "station_silent": Condition(
        "a ground station that was heard sends nothing for 5 s: its place is free for another", watcher=Watcher.LINK
    ),
    "handback_refused": Condition(
        "the mode is not seen within 3 s", key="failsafe.firmware_mode", watcher=Watcher.LINK
    ),
    "attitude_unhealthy": Condition(
        "the compass or AHRS in SYS_STATUS is enabled and unhealthy", watcher=Watcher.VEHICLE
    ),
    "compass_doubtful": Condition(
        "compass_variance in EKF_STATUS_REPORT is 0.8 or more for 3 s, until below 0.5; or its filter has no attitude",
        watcher=Watcher.VEHICLE,
    ),
    "vehicle_failsafe": Condition("MAV_STATE in its heartbeat is critical", watcher=Watcher.VEHICLE),
    "vehicle_failed": Condition(
        "MAV_STATE in its heartbeat is emergency, power off or flight termination", watcher=Watcher.VEHICLE
    ),
    "geofence": Condition("FENCE_STATUS, or the fence in SYS_STATUS enabled and unhealthy", watcher=Watcher.VEHICLE),
    "shallow": Condition("the vehicle's STATUSTEXT says so", watcher=Watcher.VEHICLE),
    "battery_low": Condition(
        "what remains in SYS_STATUS or BATTERY_STATUS, or its charge state",
        key="alarms.battery_percent",
        watcher=Watcher.VEHICLE,
    ),
    "waiting_heading": Condition(
        "an order to engage before a heading, or for the 1.5 s in which it shows whether a heading has jumped"
    ),
    "cannot_engage": Condition("an order to engage comes while somebody else has the helm, or a fault lasts"),
    "order_dropped": Condition("such an order has waited 30 s"),
    "route_ended": Condition("the last waypoint is passed: the last course is held", watcher=Watcher.LOOP),
    "place_reached": Condition(
        "the place that a ground station sent the boat to: the last course is held", watcher=Watcher.LOOP
    ),
    "man_overboard": Condition("the skipper has said so", watcher=Watcher.LOOP),
    "position_lost": Condition("no position for the time in the file while a route leads", watcher=Watcher.LOOP),
    "position_jumped": Condition(
        "the position moves further than the boat can have gone, while a route leads", watcher=Watcher.LOOP
    ),
    "off_track": Condition("further off the leg than the file says", watcher=Watcher.LOOP),
    "current_too_strong": Condition(
        "on this leg or a later one, the current across or against is more than the boat can hold at its speed",
        watcher=Watcher.LOOP,
    ),
    "plotter_turn": Condition("its new leg needs a turn of more than 100 deg", watcher=Watcher.LOOP),
    "plotter_invalid": Condition(
        "its sentences say that they are not valid, no two in a row name the same leg for 8 s, or its error grows "
        "faster than the boat goes",
        watcher=Watcher.LOOP,
    ),
    "plotter_silent": Condition("no sentence for 8 s", watcher=Watcher.LOOP),
    "plotter_arrived": Condition("its last waypoint is passed by for 5 s: the leg is held on", watcher=Watcher.LOOP),
    "wind_awaited": Condition("the wind hold is ordered before a wind is known", watcher=Watcher.LOOP),
    "wind_lost": Condition(
        "while it leads, none above 0.5 m/s for 5 s, a vane that repeats itself for 30 s or through a turn of 10 deg, "
        "or a true wind without a speed",
        watcher=Watcher.LOOP,
    ),
    "wind_shifted": Condition(
        "alarms.wind_shift_deg from the heading held, or from the course that the wind hold led along",
        watcher=Watcher.LOOP,
    ),
    "wind_turn_asked": Condition("a tack or gybe is ordered", watcher=Watcher.LOOP),
    "wind_turn_stalled": Condition(
        "in a tack or gybe no 5 deg nearer to the other side for 12 s: in irons, for instance", watcher=Watcher.LOOP
    ),
    "compass_silent": Condition(
        "while another steers, for a minute; for a minute since the last time, where one does so again within one; "
        "the chosen one, while it is not heard for 10 s",
        watcher=Watcher.LINK,
    ),
    "headings_slow": Condition("asked for repeatedly, and still too slow", watcher=Watcher.LINK),
    "headings_late": Condition(
        "for 2 s none was younger than half the time in the file as it came",
        key="failsafe.heading_timeout_s",
        watcher=Watcher.LINK,
    ),
    "line_narrow": Condition(
        "by its baud rate, or as three checks of 2 s find all streams slow and next to none of them lost",
        watcher=Watcher.LINK,
    ),
    "targets_lag": Condition("far off the heading ordered for long, and no nearer", watcher=Watcher.LINK),
    "other_pilot": Condition("it says so while we steer", watcher=Watcher.LINK),
    "other_pilot_waits": Condition("it says so while we steer", watcher=Watcher.LINK),
    "input_shared": Condition(
        "the steering input shows pulses that are none of ours, three in 10 s", watcher=Watcher.LINK
    ),
    "servo_changed": Condition("SERVOn_MIN, _TRIM or _MAX of what steers changes while we steer", watcher=Watcher.LINK),
    "motor_current": Condition(
        "more than drive.current_max_a for longer than a motor takes to start", watcher=Watcher.LINK
    ),
    "drive_warning": Condition("the drive reports it", watcher=Watcher.LINK),
    "line_lost": Condition("an adapter is pulled, or a connection closed", watcher=Watcher.LINK),
    "station_lost": Condition("the line to a ground station fails", watcher=Watcher.LINK),
    "station_stopped": Condition(
        "an order to stand by from a station that only looks, while an order to steer was in force",
        watcher=Watcher.LINK,
    ),
    "stop_refused": Condition(
        "an order to stand by from a station that only looks, within 1 to 60 min of engaging anew after such an order",
        watcher=Watcher.LINK,
    ),
    "forwarding_ended": Condition("the line to a ground station behind the router fails", watcher=Watcher.LINK),
    "output_failed": Condition("a write to the file of an alarm output fails", watcher=Watcher.LOOP),
    "change_not_kept": Condition(
        "a parameter, a route or a note could not be written to its file, until it is written", watcher=Watcher.LOOP
    ),
    "other": Condition("only in logs of other versions, whose kinds are not known here", watcher=Watcher.LINK),
}
"""By the alarms' names."""
