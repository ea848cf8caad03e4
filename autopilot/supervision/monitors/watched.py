"""What the monitors are given: their limits, and what a tick shows them."""

from __future__ import annotations

import math
from typing import NamedTuple

from autopilot.signals import NavState

LATE_PERIODS = 3.0
"""A tick this many control periods after the one before it is late: a heading that is waited for may take half that."""
NEWS = math.radians(10.0)
"""An alarm is said anew when its angle has changed by more than this [rad]: each degree would be a new text."""


class AlarmLimits(NamedTuple):
    """off_course [rad] for off_course_time [s]; roll [rad]; heading_jump [rad]; rate_disagrees [rad]; innovation in
    standard deviations; inf: not watched. frozen_heading, rudder_answer: watched or not. wind_wanted: whether a wind
    that is not known is to be said. rudder_tolerance [rad], rudder_rate [rad/s] and rudder_delay [s]: how closely a
    rudder whose angle is measured must follow. heading_noise [rad^2]: the compass's variance.
    """

    off_course: float = math.inf
    off_course_time: float = 10.0
    roll: float = math.inf
    frozen_heading: bool = True
    heading_jump: float = math.inf
    rate_disagrees: float = math.inf
    innovation: float = math.inf
    rudder_answer: bool = False
    rudder_tolerance: float = math.inf
    rudder_rate: float = math.inf
    rudder_delay: float = 0.0
    wind_wanted: bool = False
    heading_noise: float = math.radians(0.5) ** 2
    late: float = math.inf


class Watched(NamedTuple):
    """What the monitors look at in a tick: whether we move the rudder; whether a course is being held, turns to it
    being over; the heading ordered [rad], the rudder that was told [rad] and its end stop [rad]; whether there is
    way enough for the rudder to count; how far measurements have lain to one side of late [standard deviations];
    whether the rudder waits for way; how far a zigzag is off to the wrong side [rad]; what wind, current and trim are
    worth [rad of rudder], however much that is; whether this tick came late; whether a heading is followed, in turns
    too; how far log and ground lie apart without a stream that explains it [m/s]; the trial's speed [m/s], 0 where the
    model is the trial's; whether the rudder's angle is measured; and whether it works against roll too."""

    now: float
    state: NavState
    steers: bool
    holds_course: bool
    wanted: float
    rudder: float
    angle_max: float
    has_way: bool
    surprise: float = 0.0
    waits: bool = False
    astray: float = 0.0
    push: float = 0.0
    is_late: bool = False
    follows: bool = False
    speeds_apart: float = 0.0
    trial_speed: float = 0.0
    rudder_is_measured: bool = False
    damps_roll: bool = False
