"""The values that travel: samples in, orders, state, reference and command, and the tick that holds them all.

SI units and radians. Heading psi is clockwise from north, rudder is positive when it turns the boat to
starboard, roll is positive starboard down. `time` is seconds of the loop's monotonic clock, and on a sample
it is when the value was *measured*, not when it was read.
"""

from __future__ import annotations

import math
from enum import IntEnum
from typing import NamedTuple

MOST_SAMPLES = 255
"""Samples one tick can hold: the log counts them in one byte."""


class HeadingSample(NamedTuple):
    """True heading [rad], with the yaw rate [rad/s] where the same instrument measures it."""

    time: float
    heading: float
    rate: float | None = None
    source: str = ""


class RateSample(NamedTuple):
    """Yaw rate [rad/s] from an instrument that knows no heading (NMEA ROT)."""

    time: float
    rate: float
    source: str = ""


class RudderSample(NamedTuple):
    """Rudder angle [rad]: measured, or, where `ordered`, the command to the steering gear (SERVO_OUTPUT_RAW)."""

    time: float
    angle: float
    ordered: bool = False
    source: str = ""


class SpeedSample(NamedTuple):
    """Speed [m/s], through the water or, where `over_ground`, over the ground."""

    time: float
    speed: float
    over_ground: bool = False
    source: str = ""


class ThrustSample(NamedTuple):
    """What the engine is given: `throttle` as a share of full, astern negative, and `reach` [rad], the largest rudder
    that the drive has beside it, inf where the throttle takes nothing from it."""

    time: float
    throttle: float
    reach: float = math.inf
    source: str = ""


class ThrusterSample(NamedTuple):
    """Whether the link can command a bow thruster, and knows that it stops when nobody commands it any more; disobeyed:
    what did not follow its orders, '' where all did."""

    time: float
    available: bool
    source: str = ""
    disobeyed: str = ""


class RollSample(NamedTuple):
    """Roll angle [rad] and, where known, roll rate [rad/s]."""

    time: float
    roll: float
    rate: float | None = None
    source: str = ""


class HelmCause(IntEnum):
    """Why the helm is not ours: the supervisor goes by this, people by the reason's words."""

    TAKEN = 0
    """A human, or the firmware, has it, or something is not in order."""
    REBOOTED = 1
    SILENT = 2
    RADIO_LOST = 3
    UNPROVEN = 4
    """Nobody has it: whether it can be had is being found out, or will be when an order to engage waits."""
    STOOD_STILL = 5
    """No order left for longer than vehicle or drive waits for one: our own process, or its computer, stood still."""
    UNREADY = 6
    """Nobody has it: what has to come before we may engage has not, or comes too slowly to steer by."""


class HelmSample(NamedTuple):
    """Whether the other side lets us steer: False with reason and cause when a human or the firmware has the helm."""

    time: float
    available: bool
    reason: str = ""
    source: str = ""
    cause: HelmCause = HelmCause.TAKEN


class PositionSample(NamedTuple):
    """Where the boat is: latitude, north positive, and longitude, east positive [rad], WGS 84."""

    time: float
    latitude: float
    longitude: float
    source: str = ""


class CourseSample(NamedTuple):
    """The course over the ground [rad], true; the speed along it is that of a `SpeedSample` of the same time."""

    time: float
    course: float
    source: str = ""


class CompassSample(NamedTuple):
    """Another compass steers, `source`: headings that come behind this are further by `turn` [rad] than
    those before, though the boat has not turned, and so are all that are held."""

    time: float
    turn: float
    source: str = ""


class AlarmEvent(NamedTuple):
    """Something the skipper should know, as it travels. What follows from it stands under `name` in the table of
    `autopilot.supervision.alarms`; `autopilot.supervision.panel` makes the sentence where it is shown.

    `detail` is what is known of the case, for people: nothing follows from its words. `form`: which of the alarm's
    sentences it is, where it has several. `because`: the alarm that stands behind it. `is_past`: it is the case no
    more, and nobody has acknowledged it yet. `is_escalated`: nobody has acknowledged it for long.
    """

    name: str
    detail: str = ""
    form: str = ""
    because: AlarmEvent | None = None
    is_past: bool = False
    is_escalated: bool = False


class AlarmSample(NamedTuple):
    """What the skipper should know though steering goes on; None takes back what `source` said before."""

    time: float
    event: AlarmEvent | None
    source: str = ""


class ConditionSample(NamedTuple):
    """Whether something from outside of the pilot is the case that its alarms know by `name`
    (`autopilot.supervision.alarms`).

    A battery that runs low, a full disk, a missed deadline: who sees it says so when it begins and when it ends, and
    what follows from it stands in the catalogue of alarms. `detail` is shown behind the alarm's text.
    """

    time: float
    name: str
    present: bool
    detail: str = ""
    source: str = ""


class AcknowledgeSample(NamedTuple):
    """The skipper has heard the alarms of a `name`, or with "" all that sound: silent, shown while they last."""

    time: float
    name: str = ""
    source: str = ""


class WindSample(NamedTuple):
    """Apparent wind: the angle [rad] it comes from, clockwise from the bow, and its speed [m/s]."""

    time: float
    angle: float
    speed: float
    source: str = ""


Sample = (
    HeadingSample
    | RateSample
    | RudderSample
    | SpeedSample
    | ThrustSample
    | ThrusterSample
    | RollSample
    | PositionSample
    | CourseSample
    | CompassSample
    | HelmSample
    | AlarmSample
    | ConditionSample
    | AcknowledgeSample
    | WindSample
)


class OrderKind(IntEnum):
    """What the pilot is asked to do."""

    STANDBY = 0
    HEADING = 1
    RUDDER = 2
    ZIGZAG = 3


class Order(NamedTuple):
    """What the skipper wants.

    `heading` [rad] is the course for HEADING (nan: adopt the present heading on engagement) and the base
    course for ZIGZAG; `rudder` [rad] is the angle for RUDDER and ZIGZAG; `heading_change` [rad] is the
    deviation at which a zigzag reverses. Every intended action raises `serial`: after an override or a
    fail-safe the pilot engages again only for an order with a new one. `is_led`: a route or a pattern moves the
    heading.
    """

    kind: OrderKind = OrderKind.STANDBY
    heading: float = 0.0
    rudder: float = 0.0
    heading_change: float = 0.0
    serial: int = 0
    is_led: bool = False

    def is_same(self, other: Order) -> bool:
        """Return whether both ask for the same: two headings that are nan are the same request."""
        both_present = self.heading != self.heading and other.heading != other.heading
        return self == (other._replace(heading=self.heading) if both_present else other)


class NavState(NamedTuple):
    """Best knowledge of the boat at `time`.

    heading [rad], rate [rad/s], speed [m/s], rudder [rad] (fed back, or from the steering-gear model), bias
    [rad] (the rudder angle that wind, current and trim are worth), heading_age [s] since the newest heading
    was measured. `valid` is False until a heading has been seen.

    wave_heading [rad] and wave_rate [rad/s] are what waves have in heading and rate at the moment; wave_deviation [rad]
    is the standard deviation of wave_heading and wave_frequency [rad/s] the frequency of encounter; 0 where waves are
    not estimated.
    """

    time: float
    heading: float
    rate: float
    speed: float
    rudder: float
    bias: float
    heading_age: float
    valid: bool
    wave_heading: float = 0.0
    wave_rate: float = 0.0
    wave_deviation: float = 0.0
    wave_frequency: float = 0.0


class Reference(NamedTuple):
    """Desired heading psi_d [rad], its rate [rad/s] and acceleration [rad/s^2]."""

    heading: float
    rate: float = 0.0
    acceleration: float = 0.0


class Mode(IntEnum):
    """Who has the rudder, in few words: what the states of the supervisor come to."""

    STANDBY = 0
    ENGAGED = 1
    OVERRIDE = 2
    FAILSAFE = 3
    FAULT = 4


class SupervisorState(IntEnum):
    """State of the supervisor; `autopilot.supervision.states` has the table."""

    STANDBY = 0
    HEADING = 1
    TRACK = 2
    TRIAL = 3
    DEGRADED = 4
    OVERRIDE = 5
    FAILSAFE = 6
    FAULT = 7


class Siren(IntEnum):
    """What is to be heard: nothing, an alarm that nobody has acknowledged, one that nobody has for long."""

    QUIET = 0
    SOUNDING = 1
    ESCALATED = 2


class AlarmState(IntEnum):
    """What an alarm that is on asks of people: nothing but to be read, to be acknowledged, or no more."""

    NOTICE = 0
    SOUNDING = 1
    ACKNOWLEDGED = 2


class RudderCommand(NamedTuple):
    """Rudder angle [rad] to be set at `time`; where `engaged` is False the rudder is released instead.

    thruster: share of a bow thruster's full thrust, -1 to 1, starboard positive; 0: it stands still.
    """

    time: float
    angle: float
    engaged: bool
    thruster: float = 0.0


class Tick(NamedTuple):
    """One tick, whole. Replaying its inputs gives the same outputs, bit for bit."""

    number: int
    now: float
    samples: tuple[Sample, ...]
    order: Order
    state: NavState
    reference: Reference
    demand: float
    command: RudderCommand
    mode: Mode
    alarms: tuple[AlarmEvent, ...]
    supervisor: SupervisorState = SupervisorState.STANDBY
    siren: Siren = Siren.QUIET
    alarm_states: tuple[AlarmState, ...] = ()
    """The state of each of `alarms`; empty where it is not known, as in old logs."""
