"""Thrusters of an ArduRover boat: what the two outputs of a skid-steered frame, or the one throttle, show in
SERVO_OUTPUT_RAW; and a bow thruster, and whether it stops when nobody commands it. Pure.

The firmware mixes steering and throttle (`autopilot.models.drives`), and the throttle is not ours. From
the two outputs both are worked out again: steering that was taken as it was asked for shows as it was sent. Where an
output is at its limit less of it was taken: then it must be of the same sign, and no more than was asked for.

A bow thruster's output passes a channel of the radio on. It has SERVOn_FUNCTION 139 + channel
(RCINnScaled): the firmware holds the channel against RCn_MIN, _TRIM, _MAX and _DZ and sends as much of SERVOn_MIN,
_TRIM, _MAX. The channel's pulse travels in the RC_CHANNELS_OVERRIDE that steers. When that stops, for whatever reason,

    a radio is heard      the override lapses after RC_OVERRIDE_TIME, and the channel is the radio's again
    none is heard         the firmware keeps the last input. Its radio fail-safe (FS_THR_ENABLE) comes after
                          RC_FS_TIMEOUT, and sends the output to its trim where SERVO_RC_FS_MSK says so

Both must be in order, or the thruster is left alone. The mask counts channels of the radio in some descriptions and
outputs in others, so both bits are asked for; one too many does nothing. MAV_CMD_DO_SET_SERVO and DO_SET_RELAY have no
end: with them the thruster of a pilot that has died runs on, so they are not used.

Source: ArduPilot, libraries/SRV_Channel/SRV_Channel_aux.cpp (output_ch), libraries/RC_Channel/RC_Channel.cpp (update,
has_override), Rover/radio.cpp (read_radio, radio_failsafe_check), libraries/AP_ServoRelayEvents, 4.6. Pure.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable
from typing import NamedTuple

from autopilot.links.mavlink.codec import Message
from autopilot.links.mavlink.overrides import OverrideEcho, OverrideRelease
from autopilot.links.mavlink.requests import OVERRIDE_TIME, RADIO_TIMEOUT, SAFE_MASK, SCALED, VehicleParameters
from autopilot.links.mavlink.steering import (
    FIRST_HIGH,
    LEAVE_ALONE,
    OUTPUT_FIELDS,
    InputTable,
    ServoPulses,
    SteeringChannel,
    SteeringOutput,
    calibration,
    pulse_table,
    released,
    share_from_servo,
    way_through,
)
from autopilot.models.drives import moment, reach, unmixed

STEERING_TOLERANCE = 0.02
"""Of full steering: pulses are whole microseconds, and each output is rounded by itself."""


class Shown(NamedTuple):
    """What the outputs show: steering and throttle as shares of full, whether less was taken than was asked for, and
    the moment that the thrust makes, a share of full."""

    steering: float
    throttle: float
    is_limited: bool
    moment: float


def output_channel(parameters: VehicleParameters, number: int) -> SteeringChannel | None:
    """Return the end points of an output; None while they are not known, or are none."""
    found = calibration(parameters, f"SERVO{number}", OUTPUT_FIELDS)
    channel = SteeringChannel(**found)
    return channel if found and channel.servo_min < channel.servo_trim < channel.servo_max else None


def share_of_output(parameters: VehicleParameters, number: int, message: Message) -> float | None:
    """Return what an output is at, -1 to 1; None without pulses or end points."""
    channel, pulse = output_channel(parameters, number), getattr(message, f"servo{number}_raw")
    return share_from_servo(channel, pulse) if channel is not None and pulse else None


def shown_by(parameters: VehicleParameters, output: SteeringOutput, message: Message) -> Shown | None:
    """Return what the two outputs of a skid-steered frame show; None while one of them is not known."""
    shares = [share_of_output(parameters, number, message) for number in parameters.steering_servos]
    found = [share for share in shares if share is not None]
    if len(found) != 2:
        return None
    left, right = found
    return Shown(*unmixed(output.mixing, left, right), moment(output.mixing, left, right))


def asked_throttle(shown: Shown, asked: Iterable[float]) -> float:
    """Return the throttle, -1 to 1, that a hand asks for: where the mixer has taken less of both, the steering that was
    `asked`, the newest last, tells how much less."""
    if not shown.is_limited or abs(shown.steering) < STEERING_TOLERANCE:
        return min(max(shown.throttle, -1.0), 1.0)
    sizes = [abs(each) for each in asked if each * shown.steering > 0.0]
    more = max(sizes[-1] / abs(shown.steering), 1.0) if sizes else 1.0
    return min(max(shown.throttle * more, -1.0), 1.0)


def is_taken(shown: Shown, asked: Iterable[float]) -> bool:
    """Return whether the outputs show one of the steerings that were `asked` for."""
    for each in asked:
        if abs(shown.steering - each) <= STEERING_TOLERANCE:
            return True
        less = abs(shown.steering) <= abs(each) + STEERING_TOLERANCE
        if shown.is_limited and less and shown.steering * each > -STEERING_TOLERANCE * abs(each):
            return True
    return False


def reach_of(output: SteeringOutput, throttle: float) -> float:
    """Return the largest rudder [rad] that the difference of the thrusts is worth beside a throttle."""
    return reach(output.mixing, throttle) / abs(output.share_per_radian)


STICK_DISARMS = 2.0
"""ARMING_RUDDER: the steering held hard to port without throttle disarms the boat, ours too."""
LONGEST_OVERRIDE_S = 3.0
"""RC_OVERRIDE_TIME, as by default: so long a thruster may run on when its pilot has died."""
NEUTRALS = 3
"""Times that the channel is sent to its middle before it is released where no radio is heard: there it stays."""
LEAVINGS = 3
AT_REST_US = 20
"""A lever this near the middle, beyond the dead zone, is not in somebody's hand."""


class BowThrusterOutput:
    """What a channel of RC_CHANNELS_OVERRIDE carries for a thruster, message by message.

    Attributes:
        channel: the radio's, from 1.
        output: the first that passes it on, from 1; 0 while none is known.
        reason: why the thruster must not be commanded; '' where it may.
        pulse: what was asked for last [us], 0 where nothing is.
        disobeyed: what does not follow its orders, '' where all does; until the pilot lets the boat go.
        release: learns from the reports whether a release arrived.
    """

    def __init__(self, channel: int, *, is_reversed: bool = False) -> None:
        self.channel = channel
        self.reason = UNKNOWN
        self.pulse = self.output = 0
        self.disobeyed = ""
        self.release = OverrideRelease()
        self._echo = OverrideEcho()
        self._side = -1.0 if is_reversed else 1.0
        self._way: SteeringChannel | None = None
        self._servo_pulses = ServoPulses(SteeringChannel())
        self._table: InputTable | None = None
        self._neutrals = self._leavings = 0
        self._is_held = self._lacks_receiver = False

    def use(self, parameters: VehicleParameters) -> None:
        """Take the vehicle's parameters as known so far."""
        way, self.reason = thruster_way(parameters, self.channel)
        if way == self._way:
            return
        self._way, self._table = way, None
        if way is not None:
            self.output, self._servo_pulses = parameters.functions[SCALED + self.channel][0], ServoPulses(way)
            try:
                self._table = pulse_table(way)
            except ValueError as error:
                self._way, self.reason = None, f"the thruster's pulses leave no room ({error})"

    def report(self, now: float, pulse: int) -> None:
        """Take what RC_CHANNELS shows of the channel [us]: while it is not ours, where its lever is."""
        # once overridden, a vehicle without a radio goes on to show the last override
        self._lacks_receiver = pulse == 0 or (self._lacks_receiver and self.release.has_ordered)
        self.release.report(now, pulse, "RC_CHANNELS")
        self._compare(now, f"RC channel {self.channel}", pulse, self._echo.pulses)
        if self._way is None or self._neutrals or self._leavings:
            return
        if not self.pulse:
            reach = self._way.rc_dead_zone + AT_REST_US
            self._is_held = bool(pulse) and abs(pulse - self._way.rc_trim) > reach

    def report_output(self, now: float, pulse: int) -> None:
        """Take what SERVO_OUTPUT_RAW shows of the output [us]."""
        if pulses := self._echo.pulses:
            self._compare(now, f"servo {self.output}", pulse, [self._servo_pulses[sent] for sent in pulses])

    def _compare(self, now: float, what: str, pulse: int, expected: Collection[int]) -> None:
        if expected and not self.disobeyed:
            self.disobeyed = self._echo.shows(now, what, pulse, expected)

    @property
    def obstacle(self) -> str:
        """Why the thruster is not commanded, but for what does not follow; '' where it is."""
        return self.reason or (HELD.format(channel=self.channel) if self._is_held else "")

    def forget(self) -> None:
        """Forget the vehicle's parameters, as after a reboot; not what is to be released."""
        self.reason, self.disobeyed = UNKNOWN, ""

    def sent(self, now: float) -> None:
        """Take that the message with the last `value` has left."""
        if self.pulse:
            self._echo.commanded(now, self.pulse)
            self.release.ordered(now, self.pulse)
        else:
            self._echo.released()
            self.release.asked(now)

    def leave(self, acts_again: bool = False) -> None:
        """Say the release again, where nothing has shown yet that it arrived, or an old order may act again."""
        if self.release.has_ordered and (acts_again or not self.release.shown_by):
            self._leavings = LEAVINGS

    def let_go(self, now: float) -> None:
        """Take that the pilot has let the boat go, and what it said of it: what did not follow is tried anew."""
        self.sent(now)
        self.disobeyed = ""

    def value(self, share: float) -> int:
        """Return what the channel carries in the next message: a `share` of full thrust, -1 to 1; with 0 its release,
        behind its middle where no radio is heard, and then nothing."""
        if share and self._table is not None and not (self.obstacle or self.disobeyed):
            self.pulse = self._table.nearest(min(max(share * self._side, -1.0), 1.0))
            self._neutrals, self._leavings = NEUTRALS if self._lacks_receiver else 0, LEAVINGS
            return self.pulse
        if self._neutrals and self._table is not None:
            self._neutrals -= 1
            self.pulse = self._table.nearest(0.0)
            return self.pulse
        self._neutrals, self.pulse = 0, 0
        if self._leavings:
            self._leavings -= 1
            return released(self.channel)
        return LEAVE_ALONE if self.channel < FIRST_HIGH else 0


UNKNOWN = "the flight controller's parameters have not come yet"
HELD = "the lever of channel {channel} is not in its middle: a hand has the thruster"


def thruster_way(parameters: VehicleParameters, channel: int) -> tuple[SteeringChannel | None, str]:
    """Return the way from the channel's input to the thruster's output, None where it is not known, and why the
    thruster must not be commanded by it, '' where it may."""
    found = parameters.functions.get(SCALED + channel, ())
    if not found:
        wanted = f"set SERVOn_FUNCTION of the thruster's output to {SCALED + channel}: it passes channel {channel} on"
        return None, wanted if parameters.has_functions else UNKNOWN
    if channel in (parameters.steering_input, parameters.throttle_input, *parameters.free_sticks):
        return None, f"channel {channel} is a stick; give the thruster another one"
    way = way_through(parameters, channel, found[0])
    return way, UNKNOWN if way is None else unsafe(parameters, channel, found)


def unsafe(parameters: VehicleParameters, channel: int, outputs: tuple[int, ...]) -> str:
    """Return what keeps the firmware from stopping the thruster when nobody commands it; '' where it does."""
    lapse, failsafe, mask = (parameters.get(name) for name in (OVERRIDE_TIME, "FS_THR_ENABLE", SAFE_MASK))
    if lapse is None or failsafe is None or mask is None:
        return f"{OVERRIDE_TIME}, FS_THR_ENABLE or {SAFE_MASK} has not come: firmware without them would not stop it"
    if not 0.0 < lapse <= LONGEST_OVERRIDE_S:
        return f"{OVERRIDE_TIME} is {lapse:g}: a thruster could run on for so long; set it to {LONGEST_OVERRIDE_S:g} s"
    silence = parameters.get(RADIO_TIMEOUT)
    if silence is not None and silence > LONGEST_OVERRIDE_S:
        return f"{RADIO_TIMEOUT} is {silence:g}: a thruster could run on for so long; set it to 1 s"
    if failsafe == 0.0:
        return "FS_THR_ENABLE is 0: without a radio nothing would stop the thruster; set it to 1"
    if parameters.get("ARMING_RUDDER") == STICK_DISARMS:
        return (
            "ARMING_RUDDER is 2: hard port rudder without throttle would disarm the boat that lies still; set it to 0"
        )
    bits = {number - 1 for number in (channel, *outputs)}
    wanted = sum(1 << bit for bit in bits)
    if int(mask) & wanted != wanted:
        more = int(mask) | wanted
        return f"{SAFE_MASK} is {mask:g}: the radio's fail-safe would not stop the thruster; set it to {more}"
    return ""
