"""What the monitors are given: their limits, and what a tick shows them."""

from __future__ import annotations

import math
from typing import NamedTuple

from autopilot.estimation.rudder_observer import Ring
from autopilot.models.norrbin import Norrbin
from autopilot.signals import HeadingSample, NavState, RateSample, RudderSample
from autopilot.supervision.tuning import AT_THE_STOP, SPEED_DOUBT

History = tuple[Ring, Ring, Ring, int]
"""The rudder of late, in rings as `rudder_observer.RudderPast` has them: times [s], where it was then, and what we had
commanded until then [rad], nan where somebody else steered; how many ticks there were."""


class AlarmLimits(NamedTuple):
    """off_course [rad] for off_course_time [s]; roll [rad]; heading_jump [rad]; rate_disagrees [rad]; innovation in
    standard deviations; inf: not watched. frozen_heading, rudder_response: watched or not. wind_wanted: whether a wind
    that is not known is to be said. rudder_tolerance [rad], rudder_rate [rad/s] and rudder_delay [s]: how closely a
    rudder whose angle is measured must follow; rudder_sides: how many times that rate it moves to port and starboard,
    the slower side once. heading_noise [rad^2]: the compass's variance. late [s]: the time between two ticks beyond
    which the second is late.
    """

    off_course: float = math.inf
    off_course_time: float = 10.0
    roll: float = math.inf
    frozen_heading: bool = True
    heading_jump: float = math.inf
    rate_disagrees: float = math.inf
    innovation: float = math.inf
    rudder_response: bool = False
    rudder_tolerance: float = math.inf
    rudder_rate: float = math.inf
    rudder_delay: float = 0.0
    wind_wanted: bool = False
    heading_noise: float = math.radians(0.5) ** 2
    late: float = math.inf
    rudder_sides: tuple[float, float] = (1.0, 1.0)


class MonitorInput(NamedTuple):
    """What a tick shows the monitors.

    model: of the boat at the present speed. steers: whether we move the rudder; holds_course: whether a course is held,
    turns to it being over; follows: whether a heading is followed, in turns too. wanted [rad]: the heading ordered;
    rudder [rad]: the command of the tick before; angle_max [rad]: its stop. has_way: enough for the rudder to count;
    waits: the rudder waits for way. innovation: the normalised innovation's mean of late [standard deviations].
    zigzag_divergence [rad]: how far a zigzag is off to the wrong side. push [rad of rudder]: what wind, current and
    trim are worth, however much that is. is_late: this tick came late. speeds_apart [m/s]: how far log and ground lie
    apart without a stream that explains it. trial_speed [m/s]: of the vessel file's trial, 0 where the model is the
    trial's. rudder_is_measured: there is a sensor of its angle. damps_roll: the rudder works against roll too.
    rudder_is_slow: it has turned out to be slower than filed, and turns are planned with that. rate_bias [rad/s]: the
    standing error of the rate sensor, 0 where it is not known; rate_unknown [(rad/s)^2]: its variance, inf: it is not.
    weaker: the share of the model's answer that drift leaves, where only the ground tells the speed. sea_watched [s]:
    for how long the sea has been learnt, since it was forgotten last. unknown [rad^2]: the variance of the heading as
    it is estimated.
    """

    now: float
    model: Norrbin
    state: NavState
    steers: bool
    holds_course: bool
    wanted: float
    rudder: float
    angle_max: float
    has_way: bool
    innovation: float = 0.0
    waits: bool = False
    zigzag_divergence: float = 0.0
    push: float = 0.0
    is_late: bool = False
    follows: bool = False
    speeds_apart: float = 0.0
    trial_speed: float = 0.0
    rudder_is_measured: bool = False
    damps_roll: bool = False
    rudder_is_slow: bool = False
    rate_bias: float = 0.0
    weaker: float = 1.0
    sea_watched: float = math.inf
    unknown: float = 0.0
    rate_unknown: float = math.inf


class Measured(NamedTuple):
    """What a tick's samples tell the watches: its headings and measured rudder angles; what the steering gear says it
    was commanded, the newest; what the rate of turn contradicts, '' for nothing; and the newest rate of an instrument
    of its own, None without one."""

    headings: tuple[HeadingSample, ...] = ()
    angles: tuple[RudderSample, ...] = ()
    report: RudderSample | None = None
    rate_disagrees: str = ""
    rate: RateSample | None = None


def is_hard_over(seen: MonitorInput) -> bool:
    """Return whether the rudder is commanded to be at its stop, nearly."""
    return abs(seen.rudder) >= AT_THE_STOP * seen.angle_max


def speed_ratio(seen: MonitorInput) -> float:
    """Return the speed that the model is for over the trial's."""
    return seen.model.reference_speed / seen.trial_speed if seen.trial_speed > 0.0 else 1.0


def reads_low(seen: MonitorInput) -> bool:
    """Return whether the speed is so far below the trial's that it may be what is wrong."""
    return speed_ratio(seen) < 1.0 / SPEED_DOUBT
