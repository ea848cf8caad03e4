"""Rudder angles to what ArduRover makes of them: the way from steering input to servo, and the messages that steer.

In MANUAL mode the steering channel's pulse goes through the channel's dead zone and end points to -4500..4500,
through the steering exponent, and through the servo's end points to a pulse again, in whole numbers each time.
Here that whole way is computed once for every possible input, and the wanted rudder is looked up backwards:
dead zone, rounding, asymmetric trims and reversals are all inverted exactly.

RC_CHANNELS_OVERRIDE touches the steering channel alone (65535 leaves channels 1 to 8 alone, 0 the others);
MANUAL_CONTROL carries steering in `y` and INT16_MAX, "not this axis", elsewhere, as ArduRover reads it
(Rover/GCS_MAVLink_Rover.cpp, handle_manual_control_axes).

Source: ArduPilot, libraries/RC_Channel/RC_Channel.cpp (pwm_to_angle_dz_trim), Rover/mode_manual.cpp,
libraries/SRV_Channel/SRV_Channel.cpp (pwm_from_angle), libraries/GCS_MAVLink/GCS_Common.cpp (manual_override).
Measured on ArduRover 4.6: 1560 in gives 1531 out with 1000/1500/2000 and a dead zone of 30. Pure.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Callable, Iterable, Mapping
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.links.mavlink.codec import Message, packed
from autopilot.links.mavlink.requests import EXPO, RC_SUFFIXES, SERVO_SUFFIXES, VehicleParameters
from autopilot.links.rudder_order import ORDER_AGE_S, RELEASE_SPACING_S, RELEASES
from autopilot.models.drives import PLAIN, Mixing, steering_for

if TYPE_CHECKING:
    from autopilot.links.mavlink.thrusters import BowThrusterOutput

FULL = 4500
"""ArduRover's steering runs from -4500 to 4500, positive turns clockwise."""
EXPO_LIMIT = 0.95
MIXED_US = (500, 1500, 2500)
"""Pulses [us] of full steering to port, none and to starboard where it is mixed with the throttle and has no servo of
its own: a scale of ours, to a thousandth."""
SHORTEST_US, LONGEST_US = 500, 2500
"""Pulse widths [us] beyond these are no calibration of a servo or a radio."""


class SteeringChannel(NamedTuple):
    """The firmware's parameters on the way from steering input to rudder servo, pulses in microseconds."""

    rc_min: int = 1100
    rc_trim: int = 1500
    rc_max: int = 1900
    rc_dead_zone: int = 30
    rc_reversed: bool = False
    servo_min: int = 1100
    servo_trim: int = 1500
    servo_max: int = 1900
    servo_reversed: bool = False
    expo: float = 0.0
    scale: tuple[float, float, float] | None = None
    """Pulses [us] at -1, 0 and 1 of full rudder; None: the servo's own end points and trim."""

    def check(self) -> None:
        """Raise ValueError where the end points are no pulse widths, or leave no room to steer."""
        pulses = (self.rc_min, self.rc_trim, self.rc_max, self.servo_min, self.servo_trim, self.servo_max)
        if not all(SHORTEST_US <= pulse <= LONGEST_US for pulse in pulses) or not 0 <= self.rc_dead_zone <= LONGEST_US:
            given = ", ".join(map(str, (*pulses, self.rc_dead_zone)))
            raise ValueError(f"pulses go from {SHORTEST_US} to {LONGEST_US} us, not {given}")
        left, right = self.rc_min + self.rc_dead_zone, self.rc_max - self.rc_dead_zone
        for name, low, trim, high in (
            ("steering input less its dead zone", left, self.rc_trim, right),
            ("steering servo", self.servo_min, self.servo_trim, self.servo_max),
            ("helm.servo_us", *(self.scale or (SHORTEST_US, SHORTEST_US + 1, LONGEST_US))),
        ):
            if not low < trim < high:
                raise ValueError(f"{name}: minimum, trim and maximum do not rise: {low:g}, {trim:g}, {high:g} us")


INPUT_FIELDS = dict(zip(RC_SUFFIXES, ("rc_min", "rc_trim", "rc_max", "rc_dead_zone", "rc_reversed"), strict=True))
OUTPUT_FIELDS = dict(zip(SERVO_SUFFIXES, ("servo_min", "servo_trim", "servo_max", "servo_reversed"), strict=True))


def channel_of(parameters: VehicleParameters) -> SteeringChannel | None:
    """Return the way from steering input to rudder servo; None while a piece of it is unknown."""
    rc, servo, expo = parameters.steering_input, parameters.steering_servo, parameters.get(EXPO) or 0.0
    if rc is None or servo is None:
        return None
    if not parameters.drive.is_mixed:
        return way_through(parameters, rc, servo, expo)
    low, trim, high = MIXED_US
    read = calibration(parameters, f"RC{rc}", INPUT_FIELDS)
    return SteeringChannel(**read, servo_min=low, servo_trim=trim, servo_max=high, expo=expo) if read else None


def way_through(parameters: VehicleParameters, rc: int, servo: int, expo: float = 0.0) -> SteeringChannel | None:
    """Return the way from input channel `rc` to output `servo`, whose share is bent by `expo`; None while a piece of it
    is unknown."""
    read = calibration(parameters, f"RC{rc}", INPUT_FIELDS)
    sent = calibration(parameters, f"SERVO{servo}", OUTPUT_FIELDS)
    return SteeringChannel(**read, **sent, expo=expo) if read and sent else None


def calibration(parameters: VehicleParameters, channel: str, fields: Mapping[str, str]) -> dict[str, Any]:
    """Return what `SteeringChannel` has of an input or output (`RC1`, `SERVO3`): the pulses [us], and whether it is
    reversed. fields: their names by the parameters' endings. Nothing while one of them is unknown."""
    known = {field: parameters.get(f"{channel}_{suffix}") for suffix, field in fields.items()}
    pulses = {field: round(value) for field, value in known.items() if value is not None}
    if len(pulses) < len(fields):
        return {}
    return {field: bool(pulse) if field.endswith("reversed") else pulse for field, pulse in pulses.items()}


def mixing_of(parameters: VehicleParameters, exponent: float, astern_share: float) -> Mixing:
    """Return how the firmware mixes, and what the thrusters do: the file's `exponent` and `astern_share`, nan: none."""
    usual = Mixing()
    return Mixing(
        _known(parameters, "MOT_THST_ASYM", usual.asymmetry),
        _known(parameters, "MOT_THST_EXPO", usual.expo),
        _known(parameters, "MOT_STR_THR_MIX", usual.priority),
        exponent,
        astern_share,
    )


def _known(parameters: VehicleParameters, name: str, usual: float) -> float:
    value = parameters.get(name)
    return usual if value is None or math.isnan(value) else value


def steering_from_pulse(channel: SteeringChannel, pulse: int) -> int:
    """Return the steering -4500..4500 that the firmware reads from an input `pulse` [us]."""
    high = channel.rc_trim + channel.rc_dead_zone
    low = channel.rc_trim - channel.rc_dead_zone
    held = min(max(pulse, channel.rc_min), channel.rc_max)
    if held > high:
        steering = FULL * (held - high) // (channel.rc_max - high)
    elif held < low:
        steering = -(FULL * (low - held) // (low - channel.rc_min))
    else:
        steering = 0
    return -steering if channel.rc_reversed else steering


def servo_from_steering(channel: SteeringChannel, steering: int) -> int:
    """Return the servo pulse [us] for `steering` -4500..4500."""
    held = min(max(_with_expo(channel.expo, steering), -FULL), FULL)
    if channel.servo_reversed:
        held = -held
    if held > 0:
        return channel.servo_trim + held * (channel.servo_max - channel.servo_trim) // FULL
    return channel.servo_trim - (-held * (channel.servo_trim - channel.servo_min) // FULL)


def share_from_servo(channel: SteeringChannel, pulse: int) -> float:
    """Return the share of full rudder, starboard positive, that a servo `pulse` [us] stands for.

    It is held to -1..1, unless the channel has a scale of its own: a servo may go beyond it.
    """
    low, trim, high = channel.scale or (channel.servo_min, channel.servo_trim, channel.servo_max)
    away = pulse - trim
    share = away / (high - trim if away > 0 else trim - low)
    if channel.scale is None:
        share = min(max(share, -1.0), 1.0)
    return -share if channel.servo_reversed else share


def reach(channel: SteeringChannel) -> float:
    """Return the share of full rudder that the servo's end points let it reach to both sides."""
    return min(abs(share_from_servo(channel, pulse)) for pulse in (channel.servo_min, channel.servo_max))


def pulse_from_manual(channel: SteeringChannel, y: int) -> int:
    """Return the input pulse [us] that MANUAL_CONTROL's `y`, -1000..1000, is turned into."""
    return int(channel.rc_min + (channel.rc_max - channel.rc_min) * (y + 1000) / 2000.0)


class ServoPulses(dict[int, int]):
    """The servo's pulse [us] for each input pulse [us] that is asked for; worked out once."""

    def __init__(self, channel: SteeringChannel) -> None:
        super().__init__()
        self._channel = channel

    def __missing__(self, pulse: int) -> int:
        servo = self[pulse] = servo_from_steering(self._channel, steering_from_pulse(self._channel, pulse))
        return servo


class ServoAngles(dict[int, float]):
    """The rudder's angle [rad] for each pulse [us] of its servo that is shown; worked out once."""

    def __init__(self, channel: SteeringChannel, share_per_radian: float) -> None:
        super().__init__()
        self._channel, self._share_per_radian = channel, share_per_radian

    def __missing__(self, pulse: int) -> float:
        angle = self[pulse] = share_from_servo(self._channel, pulse) / self._share_per_radian
        return angle


class InputTable:
    """The input, pulse or stick, for every share of full rudder that the servo can show."""

    def __init__(self, inputs: Iterable[int], share_of: Callable[[int], float], neutral: int) -> None:
        by_share: dict[float, list[int]] = {}
        for value in inputs:
            by_share.setdefault(share_of(value), []).append(value)
        self._shares = sorted(by_share)
        self._inputs = [_middle(by_share[share], neutral) for share in self._shares]

    def nearest(self, share: float) -> int:
        """Return the input that brings the servo nearest to `share` of full rudder."""
        shares = self._shares
        place = bisect_left(shares, share)
        if place == 0:
            return self._inputs[0]
        if place == len(shares):
            return self._inputs[-1]
        if shares[place] - share > share - shares[place - 1]:
            place -= 1
        return self._inputs[place]


def pulse_table(channel: SteeringChannel) -> InputTable:
    """Return the table of input pulses [us] for RC_CHANNELS_OVERRIDE; ValueError where the channel cannot steer."""
    channel.check()
    return InputTable(range(channel.rc_min, channel.rc_max + 1), _share_of_pulse(channel), _neutral(channel))


def manual_table(channel: SteeringChannel) -> InputTable:
    """Return the table of MANUAL_CONTROL `y`, -1000..1000; ValueError where the channel cannot steer."""
    channel.check()
    of_pulse = _share_of_pulse(channel)
    neutral = round(2000.0 * (_neutral(channel) - channel.rc_min) / (channel.rc_max - channel.rc_min)) - 1000
    return InputTable(range(-1000, 1001), lambda y: of_pulse(pulse_from_manual(channel, y)), neutral)


def _neutral(channel: SteeringChannel) -> int:
    """Amidships, half a dead zone off the trim: the rudder does not move for it, and RC_CHANNELS can tell it from a
    stick at rest. At the trim itself a vehicle that ignores us would seem to obey for as long as the rudder rests.
    """
    return channel.rc_trim + channel.rc_dead_zone // 2


def _share_of_pulse(channel: SteeringChannel) -> Callable[[int], float]:
    def share(pulse: int) -> float:
        return share_from_servo(channel, servo_from_steering(channel, steering_from_pulse(channel, pulse)))

    return share


def _middle(values: list[int], neutral: int) -> int:
    return neutral if neutral in values else values[len(values) // 2]


def _with_expo(expo: float, steering: int) -> int:
    """Return the steering as the firmware bends it: s -> (1 - e) s / (1 - e |s|) (ArduPilot, AP_Math/control.cpp,
    input_expo)."""
    if expo == 0.0 or expo >= EXPO_LIMIT:
        return steering
    share = steering / FULL
    return int(FULL * (1.0 - expo) * share / (1.0 - expo * abs(share)))


ENDS = ("MIN", "TRIM", "MAX")


def _ends_of(parameters: VehicleParameters) -> dict[str, float | None]:
    """Return the end points and trims [us] of the servos that steer, by their names."""
    names = (f"SERVO{number}_{suffix}" for number in parameters.steering_servos for suffix in ENDS)
    return {name: parameters.get(name) for name in names}


LEAVE_ALONE, RELEASE = 65535, 0
RELEASE_HIGH_CHANNEL, FIRST_HIGH = 65534, 9
"""From this channel of RC_CHANNELS_OVERRIDE on, 0 leaves it alone."""
NOT_THIS_AXIS = 32767
REACH_TOLERANCE_DEG = 0.5
MOST_MADE = 4096
"""Messages that are kept to be sent again."""
DISTINCT_US = 3
"""A radio's own noise; further apart than this two pulses are different."""


def released(channel: int) -> int:
    """Return what gives a channel from 1 back to the radio."""
    return RELEASE if channel < FIRST_HIGH else RELEASE_HIGH_CHANNEL


class SteeringOutput:
    """Makes steering messages for one vehicle.

    Attributes:
        target: the vehicle's system id.
        channel: its way from steering input to rudder servo, None while unknown.
        commanded_pulse: input pulse [us] that the last steering message asks for.
        servo_pulses: the servo's pulse [us] for an input pulse [us], by the channel in force.
        servo_angles: the rudder's angle [rad] for a pulse [us] of the servo.
        share_per_radian: share of full steering for each radian of rudder, negative where full steering is port.
        mixing: how a skid-steered frame mixes, and what its thrusters do.
        throttle: that beside which a skid-steered frame steers, a share of full; whoever sees it sets it.
        bow: what the same messages carry for a bow thruster, on a channel of its own; None: there is none.
        changed: which end points and trims of the servos that steer were changed while we steered; those of before
            are a rudder's scale.
    """

    def __init__(
        self,
        method: Literal["rc_override", "manual_control", "guided", "offboard"],
        rudder_at_full: float,
        reversed_: bool,
        servo_us: tuple[float, float, float] | None = None,
        angle_max: float = 0.0,
        thrusters: Mixing = PLAIN,
    ) -> None:
        if not 0.0 < rudder_at_full < math.inf:
            raise ValueError(f"rudder_at_full must be a positive angle in radians, got {rudder_at_full}")
        self.target = 0
        self.channel: SteeringChannel | None = None
        self.commanded_pulse = 0
        self._by_pulse = method != "manual_control"
        self.share_per_radian = (-1.0 if reversed_ else 1.0) / rudder_at_full
        self.servo_pulses = ServoPulses(SteeringChannel())
        self.servo_angles = ServoAngles(SteeringChannel(), self.share_per_radian)
        self._scale, self._angle_max = servo_us, angle_max
        self.mixing, self.throttle = thrusters, 0.0
        self.bow: BowThrusterOutput | None = None
        self.changed = ""
        self._kept: dict[str, float | None] = {}
        self._is_mixed = False
        self._number = 0
        self._held = 0
        """Number of the input that was overridden last, whatever is known of the vehicle since; 0 before."""
        self._table: InputTable | None = None
        self._made: dict[tuple[int, int, int, int], Message] = {}
        self._last: Message | None = None
        self._last_sent = math.nan
        self._given = math.nan
        self._releases_left = 0

    def use(self, parameters: VehicleParameters, is_steered: bool = False) -> str:
        """Take the vehicle's parameters as known so far; return what makes steering impossible, or ''.

        The same pulse is the same rudder whatever the servo's end points are set to: where they change while the boat
        is steered, the scale stays that of before.
        """
        number, channel, ends = parameters.steering_input, channel_of(parameters), _ends_of(parameters)
        if self._kept.keys() != ends.keys() or not (is_steered or self.changed):
            self._kept = ends
        # what comes first is no change
        self._kept = {name: ends[name] if old is None else old for name, old in self._kept.items()}
        pairs = ((name, old, ends[name]) for name, old in self._kept.items())
        changes = [f"{name} was changed from {old:g} to {new:g}" for name, old, new in pairs if old != new]
        self.changed = "" if self._scale is not None else ", ".join(changes)
        self._is_mixed = parameters.drive.is_mixed
        if self._is_mixed:
            self.mixing = mixing_of(parameters, self.mixing.exponent, self.mixing.astern_share)
        elif channel is not None:
            kept = [self._kept[f"SERVO{parameters.steering_servo}_{suffix}"] or 0.0 for suffix in ENDS]
            channel = channel._replace(scale=self._scale or ((kept[0], kept[1], kept[2]) if self.changed else None))
        if channel == self.channel and number == self._number:
            return "" if channel is None else self._short_of_angle(channel, parameters.steering_servo)
        self.forget()
        if number is None or channel is None:
            return ""
        try:
            self._table = pulse_table(channel) if self._by_pulse else manual_table(channel)
        except ValueError as error:
            return f"the vehicle's parameters leave no room to steer ({error}); correct them"
        self._number, self.channel = number, channel
        self.servo_pulses, self.servo_angles = ServoPulses(channel), ServoAngles(channel, self.share_per_radian)
        return self._short_of_angle(channel, parameters.steering_servo)

    def _short_of_angle(self, channel: SteeringChannel, servo: int | None) -> str:
        """A rudder that stops short of what may be ordered would look as if it did not follow."""
        degrees = math.degrees(abs(reach(channel) / self.share_per_radian))
        ordered = math.degrees(self._angle_max)
        if channel.scale is None or degrees > ordered - REACH_TOLERANCE_DEG:
            return ""
        low, middle, high = (round(pulse) for pulse in channel.scale)
        share = self._angle_max * abs(self.share_per_radian)
        least, most = round(middle - share * (middle - low)), round(middle + share * (high - middle))
        if self.changed:
            return (
                f"{self.changed} while we steered, which leaves {degrees:.0f} deg of rudder, and "
                f"rudder.angle_max_deg is {ordered:.0f}; set it back, or start again to take the new ones for all of it"
            )
        return (
            f"SERVO{servo}_MIN to _MAX, {channel.servo_min} to {channel.servo_max} us, is {degrees:.0f} deg of rudder "
            f"by helm.servo_us [{low}, {middle}, {high}], and rudder.angle_max_deg is {ordered:.0f}; set "
            f"SERVO{servo}_MIN to {least} and SERVO{servo}_MAX to {most}, or rudder.angle_max_deg to "
            f"{math.floor(degrees)}, or correct helm.servo_us"
        )

    def restarted(self) -> None:
        """Forget what was in force before the vehicle restarted."""
        self.forget()
        self._kept, self.changed = {}, ""

    def forget(self) -> None:
        """Forget the vehicle's parameters and the last command, as after a reboot; not what is to be released."""
        self._number, self.channel, self._table, self._last = 0, None, None, None
        self._made = {}

    def steer(self, now: float, angle: float, thruster: float = 0.0) -> Message | None:
        """Return the message for rudder `angle` [rad] and a bow thruster's share of full, -1 to 1; None where the
        vehicle is not known well enough."""
        if self._table is None or self.channel is None or not -math.inf < angle < math.inf:
            return None
        share = angle * self.share_per_radian
        if self._is_mixed:
            share = steering_for(self.mixing, share, self.throttle)
        value = self._table.nearest(1.0 if share > 1.0 else -1.0 if share < -1.0 else share)
        self.commanded_pulse = value if self._by_pulse else pulse_from_manual(self.channel, value)
        self._held = self._number
        self._last = self._asking(value, thruster)
        self._given = self._last_sent = now
        self._releases_left = RELEASES
        return self._last

    def unmoving(self, pulse: int) -> tuple[Message, int] | None:
        """Return a message, and the input [us] it asks for, that leaves the servo where an input `pulse` [us] has it.

        `pulse` shows which input it is; where none such moves nothing, it is the one that moves least. A vehicle
        without a radio receiver shows 0: then it is near the trim. None where the vehicle is not known yet, or another
        input has still to be released.
        """
        channel = self.channel
        if channel is None or (self._releases_left and self._held != self._number):
            return None
        held = min(max(pulse, channel.rc_min), channel.rc_max) if pulse else channel.rc_trim
        inputs = range(channel.rc_min, channel.rc_max + 1) if self._by_pulse else range(-1000, 1001)

        def asked(value: int) -> int:
            return value if self._by_pulse else pulse_from_manual(channel, value)

        def moved(value: int) -> tuple[int, int]:
            there, here = (servo_from_steering(channel, steering_from_pulse(channel, p)) for p in (asked(value), held))
            return abs(there - here), abs(asked(value) - held)

        value = min((value for value in inputs if abs(asked(value) - pulse) > DISTINCT_US), key=moved)
        self._releases_left, self._held = RELEASES, self._number
        return self._asking(value), asked(value)

    def steerings(self, pulses: Iterable[int]) -> list[float]:
        """Return the steering, -1 to 1, that the firmware reads from each input pulse [us]."""
        channel = self.channel
        if channel is None:
            return []
        return [_with_expo(channel.expo, steering_from_pulse(channel, pulse)) / FULL for pulse in pulses]

    def amidships(self) -> tuple[Message, int] | None:
        """Return the message, and its input [us], that leave the servo at its trim; None for an unknown vehicle, and
        where another input is overridden."""
        channel = self.channel
        if channel is None or self._table is None or self._held not in (0, self._number):
            return None
        self._held = self._number
        value = self._table.nearest(0.0)
        return self._asking(value), value if self._by_pulse else pulse_from_manual(channel, value)

    def release(self, now: float) -> Message | None:
        """Return the next of `RELEASES` releases after steering, `RELEASE_SPACING_S` apart; None when done."""
        if self._last is not None:
            self._last = None
        elif now - self._last_sent < RELEASE_SPACING_S:
            return None
        if self._releases_left == 0:
            return None
        self._releases_left -= 1
        self._last_sent = now
        return self._release()

    def release_again(self) -> None:
        """Have one more release sent, where nothing is ordered: an order that a line held came behind the others."""
        if self._last is None and self._held and not self._releases_left:
            self._releases_left = 1
            if self.bow is not None:
                self.bow.leave(acts_again=True)

    def repeat(self, now: float, rate_hz: float) -> Message | None:
        """Return what is due again: the last command at `rate_hz` at least, or a release that is left."""
        if self._last is None:
            return self.release(now) if self._releases_left else None
        if now - self._last_sent < 1.0 / rate_hz or now - self._given > ORDER_AGE_S:
            return None
        self._last_sent = now
        return self._last

    def release_burst(self) -> list[Message]:
        """Return all releases at once, for the way out; none where the rudder was never touched."""
        self._last = None
        self._releases_left = 0
        if self.bow is not None:
            self.bow.leave()
        return [self._release() for _ in range(RELEASES)] if self._held else []

    def _release(self) -> Message:
        if not self._by_pulse:
            return self._asking(NOT_THIS_AXIS)
        return self._asking(released(self._held))

    def _asking(self, value: int, thruster: float = 0.0) -> Message:
        """Return the message that asks for an input and a bow thruster's share, made once for each."""
        beside = LEAVE_ALONE if self.bow is None else self.bow.value(thruster)
        key = self.target, self._held, value, beside
        if key not in self._made:
            if len(self._made) >= MOST_MADE:
                self._made.clear()
            self._made[key] = packed(self._override(value, beside) if self._by_pulse else self._manual(value))
        return self._made[key]

    def _override(self, pulse: int, beside: int) -> Message:
        channels = [LEAVE_ALONE] * 8 + [0] * 10
        if self.bow is not None:
            channels[self.bow.channel - 1] = beside
        channels[self._held - 1] = pulse
        return dialect.MAVLink_rc_channels_override_message(self.target, 1, *channels)

    def _manual(self, y: int) -> Message:
        return dialect.MAVLink_manual_control_message(self.target, NOT_THIS_AXIS, y, NOT_THIS_AXIS, NOT_THIS_AXIS, 0)
