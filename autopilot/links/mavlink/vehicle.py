"""What a flight controller's messages say: samples for the pilot, and what steering it depends on. Pure."""

from __future__ import annotations

import math
from collections.abc import Sequence
from operator import attrgetter
from typing import Literal, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.angles import wrap
from autopilot.links.mavlink.authority import GUIDED_MODE, ControlAuthority, RadioWatch
from autopilot.links.mavlink.codec import Message
from autopilot.links.mavlink.conditions import BATTERY, FENCING, FILTER, SYSTEM, TEXT, VehicleHealth
from autopilot.links.mavlink.guided import GuidedTargets, OffboardTargets
from autopilot.links.mavlink.overrides import OverrideProbe, OverrideRelease
from autopilot.links.mavlink.requests import MessageStreams, VehicleParameters, obstacle_of
from autopilot.links.mavlink.steering import MIXED_US, SteeringOutput, share_from_servo
from autopilot.links.mavlink.thrusters import (
    BowThrusterOutput,
    asked_throttle,
    is_taken,
    reach_of,
    share_of_output,
    shown_by,
)
from autopilot.links.mavlink.vehicle_clock import WRAP_S, Belongs, VehicleClock
from autopilot.models.drives import DRIVES
from autopilot.signals import (
    CourseSample,
    HeadingSample,
    PositionSample,
    RollSample,
    RudderSample,
    Sample,
    SpeedSample,
    ThrustSample,
    WindSample,
)

NO_CHANNEL = 0xFFFF
"""What RC_CHANNELS shows of a channel that is not there (MAVLink common, RC_CHANNELS)."""
INPUTS_OF = attrgetter("chancount", *(f"chan{number}_raw" for number in range(1, 19)))
"""How many channels RC_CHANNELS shows, and behind it their pulses [us], each at its number."""


SPEED_PREFERENCE_S = 2.0
"""A lesser source of speed is used only when the better one has been silent this long."""
LONG_SILENCE_S = 10.0
"""A vehicle back after this much silence may be another one, or have other parameters: it is asked anew."""
OVERTAKEN_S = 2.5
"""A report older than the newest was overtaken by it, however late it comes; where nothing newer has come for so long,
the vehicle's clock began anew."""
CHANNELS_TIMEOUT_S = 1.0
"""Without RC_CHANNELS for this long the servo must show whether a release arrived."""
SERVO_SOURCE = "servo_output_raw"
SHOWN_OUTPUTS = 16
"""As many outputs has a SERVO_OUTPUT_RAW."""
OUTPUTS = dialect.MAV_SYS_STATUS_SENSOR_MOTOR_OUTPUTS
"""There, healthy and not enabled in SYS_STATUS where the safety switch is on (libraries/GCS_MAVLink/GCS.cpp)."""
OVERTAKEN = 128
"""A message whose number lies so far ahead is one that came behind another."""
FIX_2D = 2
CLEARED_BY_STICK = "RC overrides cleared by pilot input"
"""ArduPilot since 4.8, where RC_OPTIONS has bit 14 (libraries/RC_Channel/RC_Channels.cpp)."""
USEC_WRAP_S = 2.0**32 * 1.0e-6
ANGLE_LIMIT = 7.0
RATE_LIMIT = 100.0
SPEED_LIMIT = 200.0

ATTITUDE = dialect.MAVLINK_MSG_ID_ATTITUDE
POSITION = dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT
HUD = dialect.MAVLINK_MSG_ID_VFR_HUD
GPS = dialect.MAVLINK_MSG_ID_GPS_RAW_INT
SERVOS = dialect.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW
CHANNELS = dialect.MAVLINK_MSG_ID_RC_CHANNELS
NAVIGATION = dialect.MAVLINK_MSG_ID_NAV_CONTROLLER_OUTPUT
WIND = dialect.MAVLINK_MSG_ID_WIND
"""With it ArduPilot's vane says its apparent wind, in named values (libraries/AP_WindVane, send_wind)."""
HEARTBEAT = dialect.MAVLINK_MSG_ID_HEARTBEAT
PARAMETER = dialect.MAVLINK_MSG_ID_PARAM_VALUE
NAMED = dialect.MAVLINK_MSG_ID_NAMED_VALUE_FLOAT
WIND_SPEED, WIND_ANGLE = "AppWndSpd", "AppWndDir"
"""The apparent wind of ArduPilot's vane [m/s], [deg], one after the other."""


class CompanionSettings(NamedTuple):
    """How to steer one vehicle.

    rudder_at_full [rad]: rudder angle at full servo travel.  reversed: full positive steering is port.
    method: RC_CHANNELS_OVERRIDE or MANUAL_CONTROL, or headings for the firmware's own controller (guided), to PX4 as
    velocities (offboard) of offboard_speed [m/s].
    command_rate_hz: least rate at which commands are repeated.
    guided_speed_share: thrust in each heading target, a share of the vehicle's default speed.
    attitude_rate_hz: rate asked of ATTITUDE.  heading_latency [s]: age of an attitude when the vehicle stamps it.
    vehicle_system: the system id to latch on to, None for the first autopilot heard.
    as_gcs: send steering from the ground station's id; gcs_system: that id, None for what the vehicle's
    parameter says (255 until it is known).
    handover_mode: the vehicle's mode number that a fail-safe orders it into; None: none. battery_percent: a charge
    below it is an alarm.
    servo_us: servo pulses at full rudder to one side, amidships, to the other, where they are not the vehicle's end
    points and trim.  angle_max [rad]: what the rudder can do.
    drive: what steers. thrust_exponent, astern_share: what two thrusters do, nan: as the firmware takes them to.
    bow_channel: the radio's channel that a bow thruster's output passes on, None: none is commanded; bow_reversed: the
    longer pulse turns the bow to port.
    with_other_pilot: engage though another pilot steers the boat.  heading_timeout [s]: age at which a heading counts
    as lost; slower ones are not engaged on.
    """

    rudder_at_full: float
    reversed: bool = False
    method: Literal["rc_override", "manual_control", "guided", "offboard"] = "rc_override"
    command_rate_hz: float = 10.0
    attitude_rate_hz: float = 20.0
    heading_latency: float = 0.0
    vehicle_system: int | None = None
    as_gcs: bool = False
    gcs_system: int | None = None
    guided_speed_share: float = 0.0
    offboard_speed: float = math.nan
    handover_mode: int | None = None
    battery_percent: float = -math.inf
    servo_us: tuple[float, float, float] | None = None
    angle_max: float = 0.0
    with_other_pilot: bool = False
    heading_timeout: float = math.inf
    drive: str = "rudder"
    thrust_exponent: float = math.nan
    astern_share: float = math.nan
    bow_channel: int | None = None
    bow_reversed: bool = False


class VehicleReader:
    """Takes the messages of one vehicle.

    Args:
        output: learns the vehicle's steering parameters as they come.
        settings: of the companion.

    Attributes:
        authority, probe: learn whether the vehicle lets us steer, and takes it.
        guided: who hears the bearing of a vehicle that is given headings rather than rudder angles; None: none is.
        is_px4: whether these are velocities for PX4.
        release: learns from the reports whether a release arrived.
        bow: what is sent to a bow thruster, None where none is commanded.
        lacks_receiver: whether no radio has ever put a pulse on the steering input.
    """

    def __init__(self, output: SteeringOutput, settings: CompanionSettings) -> None:
        is_guided, self.is_px4 = settings.method == "guided", settings.method == "offboard"
        self.authority = ControlAuthority(is_guided, self.is_px4, settings.with_other_pilot)
        self.probe = OverrideProbe(output, settings.with_other_pilot)
        self.guided: GuidedTargets | None = None
        if is_guided:
            self.guided = GuidedTargets(self.authority, settings.guided_speed_share)
        elif self.is_px4:
            self.guided = OffboardTargets(self.authority, settings.offboard_speed)
        self.health = VehicleHealth(settings.battery_percent)
        self.radio = RadioWatch()
        self.release = OverrideRelease()
        self.lacks_receiver = False
        self.parameters = VehicleParameters(is_guided, DRIVES[settings.drive], settings.bow_channel, not self.is_px4)
        channel = settings.bow_channel
        self.bow = None if channel is None else BowThrusterOutput(channel, is_reversed=settings.bow_reversed)
        output.bow = self.bow
        self._is_mixed = self.parameters.drive.is_mixed
        rates_hz = {
            ATTITUDE: settings.attitude_rate_hz,
            SERVOS: 10.0,
            CHANNELS: 10.0,
            POSITION: 5.0,
            HUD: 2.0,
            GPS: 1.0,
            SYSTEM: 1.0,
        }
        if is_guided:
            rates_hz[NAVIGATION] = rates_hz[HUD] = 5.0
        self._output = output
        self._latency = settings.heading_latency
        self._clock = VehicleClock()
        self._position_time = self._channels_time = -math.inf
        self._newest: dict[int, tuple[float, float]] = {}
        """Of each kind of report that tells no more once it is old: the newest one's time, and when it came."""
        self._has_fix = True
        self.handlers = {
            ATTITUDE: self._attitude,
            POSITION: self._position,
            HUD: self._hud,
            GPS: self._gps,
            SERVOS: self._servos,
            CHANNELS: self._channels,
            NAVIGATION: self._navigation,
            HEARTBEAT: self._heartbeat,
            PARAMETER: self._parameter,
            SYSTEM: self._system,
            TEXT: self._text,
            BATTERY: self._condition,
            FENCING: self._condition,
            FILTER: self._condition,
            NAMED: self._named,
        }
        if self.is_px4:
            # which output steers, and which stick, is not asked, and no bearing is of our headings
            for identity in (SERVOS, CHANNELS, NAVIGATION):
                rates_hz.pop(identity, None)
                del self.handlers[identity]
        self.streams = MessageStreams(rates_hz, settings.heading_timeout, {WIND: 2.0, FILTER: 1.0})
        self._wind_speed = math.nan
        self._number = 0

    def silence(self) -> None:
        """Take that nobody listened for a while: what comes next has waited, and tells of no silent vehicle."""
        self._clock.silence()

    def another(self) -> None:
        """Take that another vehicle is listened to from now on."""
        self._clock.reset()
        self._ask_anew()

    def take(self, now: float, message: Message, samples: list[Sample]) -> None:
        """Read one message of the vehicle that arrived at `now` [s]; its samples are appended to `samples`."""
        authority = self.authority
        authority.received_time = now
        header, streams = message._header, self.streams
        identity, gap = header.msgId, (header.seq - self._number - 1) & 0xFF
        self._number = header.seq
        streams.came += 1
        if 0 < gap < OVERTAKEN:
            streams.lost += gap
        if identity in self.handlers:
            self.handlers[identity](now, message, samples)
        # PX4 leaves Offboard for a lost radio by itself, where it is set to
        authority.radio = self.radio.reason(self.parameters) if self.radio.found and not self.is_px4 else ""

    def _system(self, now: float, message: Message, samples: list[Sample]) -> None:
        self.streams.counts[SYSTEM] += 1
        healthy = message.onboard_control_sensors_present & message.onboard_control_sensors_health
        self.authority.is_safe = bool(healthy & ~message.onboard_control_sensors_enabled & OUTPUTS)
        self.radio.status(message.onboard_control_sensors_enabled, message.onboard_control_sensors_health)
        samples.extend(self.health.take(now, message))

    def _condition(self, now: float, message: Message, samples: list[Sample]) -> None:
        samples.extend(self.health.take(now, message))

    def _text(self, now: float, message: Message, samples: list[Sample]) -> None:
        self.radio.text(now, message.text)
        if message.text.startswith(CLEARED_BY_STICK):
            self.authority.cleared_by_stick()
        samples.extend(self.health.take(now, message))

    def _heartbeat(self, now: float, message: Message, samples: list[Sample]) -> None:
        if message.autopilot == dialect.MAV_AUTOPILOT_INVALID:
            return  # somebody else's, under the vehicle's ids
        self.authority.obstacle = obstacle_of(message.autopilot, message.type, self.is_px4)
        if LONG_SILENCE_S < now - self.authority.heartbeat_time < math.inf:
            self._ask_anew()
        armed = bool(message.base_mode & dialect.MAV_MODE_FLAG_SAFETY_ARMED)
        self.authority.heartbeat(now, message.custom_mode, armed, message.system_status)
        self.radio.heartbeat(now, message.system_status)
        samples.extend(self.health.take(now, message))

    def _attitude(self, now: float, message: Message, samples: list[Sample]) -> None:
        self.streams.counts[ATTITUDE] += 1
        measured = self._sample_time(now, message.time_boot_ms * 1.0e-3)
        if measured is None:
            return
        if now - measured < self.streams.age:
            self.streams.age = now - measured
        time = measured - self._latency
        yaw, rate, roll, roll_rate = message.yaw, message.yawspeed, message.roll, message.rollspeed
        # These comparisons are also false for nan.
        if -ANGLE_LIMIT < yaw < ANGLE_LIMIT and -RATE_LIMIT < rate < RATE_LIMIT:
            samples.append(HeadingSample(time, yaw, rate, "attitude"))
        if -ANGLE_LIMIT < roll < ANGLE_LIMIT and -RATE_LIMIT < roll_rate < RATE_LIMIT:
            samples.append(RollSample(time, roll, roll_rate, "attitude"))

    def _position(self, now: float, message: Message, samples: list[Sample]) -> None:
        self.streams.counts[POSITION] += 1
        time = self._sample_time(now, message.time_boot_ms * 1.0e-3)
        if self._has_fix and time is not None:
            self._position_time = now
            latitude, longitude = math.radians(message.lat * 1.0e-7), math.radians(message.lon * 1.0e-7)
            if abs(latitude) <= 0.5 * math.pi and abs(longitude) <= math.pi:
                samples.append(PositionSample(time, latitude, longitude, "global_position_int"))
            speed = math.hypot(message.vx, message.vy) * 0.01
            if speed < SPEED_LIMIT:
                samples.append(SpeedSample(time, speed, True, "global_position_int"))
                samples.append(CourseSample(time, math.atan2(message.vy, message.vx), "global_position_int"))

    def _hud(self, now: float, message: Message, samples: list[Sample]) -> None:
        self.streams.counts[HUD] += 1
        if self.guided is not None and not self.is_px4:
            is_guided = self.authority.mode == GUIDED_MODE
            self.guided.outputs(self.parameters.steering_servo is not None)
            self.guided.engine(now, self.authority.armed and message.throttle != 0, is_guided)
        speed = message.groundspeed
        if self._has_fix and now - self._position_time > SPEED_PREFERENCE_S and 0.0 <= speed < SPEED_LIMIT:
            samples.append(SpeedSample(now, speed, True, "vfr_hud"))

    def _named(self, now: float, message: Message, samples: list[Sample]) -> None:
        if message.name == WIND_SPEED:
            self._wind_speed = message.value
        elif message.name == WIND_ANGLE and abs(message.value) <= 360.0 and 0.0 <= self._wind_speed < SPEED_LIMIT:
            samples.append(WindSample(now, wrap(math.radians(message.value)), self._wind_speed, "windvane"))
            self._wind_speed = math.nan

    def _gps(self, now: float, message: Message, samples: list[Sample]) -> None:
        self.streams.counts[GPS] += 1
        # Before the first fix the vehicle sends zeros, which would pass for a boat at rest.
        self._has_fix = message.fix_type >= FIX_2D

    def _servos(self, now: float, message: Message, samples: list[Sample]) -> None:
        self.streams.counts[SERVOS] += 1
        servo, channel = self.parameters.steering_servo, self._output.channel
        if message.port != 0 or self._is_overtaken(now, SERVOS, message.time_usec * 1.0e-6, USEC_WRAP_S):
            return
        if self.bow is not None and 0 < self.bow.output <= SHOWN_OUTPUTS:
            self.bow.report_output(now, getattr(message, f"servo{self.bow.output}_raw"))
        if servo is None or channel is None:
            return
        if self._is_mixed:
            self._thrusters(now, message, samples)
            return
        if self.parameters.throttle_servo is not None:
            self._throttle(now, self.parameters.throttle_servo, message, samples)
        pulse = getattr(message, f"servo{servo}_raw")
        if pulse == 0:
            return
        if self.guided is not None:
            self.guided.rudder(now, share_from_servo(channel, pulse))
        output = self._output
        if now - self._channels_time > CHANNELS_TIMEOUT_S:
            self.release.report(now, pulse, "SERVO_OUTPUT_RAW", output.servo_pulses)
        if recent := self.authority.echo.pulses:
            asked = [output.servo_pulses[sent] for sent in recent]
            self.authority.seen(now, f"servo {servo}", pulse, asked)
        time = self._servo_time(now, message.time_usec)
        samples.append(RudderSample(time, output.servo_angles[pulse], True, SERVO_SOURCE))

    def _throttle(self, now: float, number: int, message: Message, samples: list[Sample]) -> None:
        """Take what the one motor is given at that output, where thrust steers."""
        share = share_of_output(self.parameters, number, message)
        if share is not None:
            samples.append(ThrustSample(self._servo_time(now, message.time_usec), share, math.inf, SERVO_SOURCE))

    def _thrusters(self, now: float, message: Message, samples: list[Sample]) -> None:
        """Take what the two thrusters of a skid-steered frame are given."""
        output, authority, parameters = self._output, self.authority, self.parameters
        shown = shown_by(parameters, output, message)
        if shown is None:
            return
        asked = output.steerings(authority.echo.pulses)
        if now - self._channels_time > CHANNELS_TIMEOUT_S:
            pulse = round(MIXED_US[1] + (MIXED_US[2] - MIXED_US[1]) * shown.steering)
            self.release.report(now, pulse, "SERVO_OUTPUT_RAW", output.servo_pulses)
        left, right = parameters.steering_servos
        if asked and authority.echo.disagrees(now, "thrusters", is_taken(shown, asked)):
            authority.refuse(
                f"the thrusters do not obey: servos {left} and {right} show {100.0 * shown.steering:.0f} % of steering "
                f"while {100.0 * asked[-1]:.0f} % is commanded (radio override switched off, or another ground station "
                "steers)"
            )
        throttle = output.throttle = asked_throttle(shown, asked)
        time = self._servo_time(now, message.time_usec)
        samples.append(ThrustSample(time, throttle, reach_of(output, throttle), SERVO_SOURCE))
        samples.append(RudderSample(time, shown.moment / output.share_per_radian, True, SERVO_SOURCE))

    def _channels(self, now: float, message: Message, samples: list[Sample]) -> None:
        authority, parameters = self.authority, self.parameters
        self.streams.counts[CHANNELS] += 1
        if self._is_overtaken(now, CHANNELS, message.time_boot_ms * 1.0e-3, WRAP_S):
            return
        self._channels_time = now
        shown, number = INPUTS_OF(message), parameters.steering_input
        self.radio.channels(now, shown, message.rssi, parameters)
        if number is None:
            return
        pulses = shown if NO_CHANNEL not in shown else tuple(0 if pulse == NO_CHANNEL else pulse for pulse in shown)
        acts_again = authority.inputs(now, pulses, parameters)
        if self.bow is not None:
            self.bow.report(now, pulses[self.bow.channel])
        if self.guided is not None:
            self.guided.stick(self._throttle_asks(pulses))
            return
        pulse = pulses[number]
        # once overridden, a vehicle without a radio goes on to show the last override
        self.lacks_receiver = pulse == 0 or (self.lacks_receiver and self.release.has_ordered)
        if acts_again:
            self._output.release_again()
        self.release.report(now, pulse, "RC_CHANNELS")
        self.probe.report(now, number, pulse)
        self.release.way = self.probe.way

    def _navigation(self, now: float, message: Message, samples: list[Sample]) -> None:
        if self.guided is not None:
            self.streams.counts[NAVIGATION] += 1
            bearing, target = math.radians(message.nav_bearing), math.radians(message.target_bearing)
            self.guided.report(now, bearing, target, float(message.wp_dist))

    def _throttle_asks(self, pulses: Sequence[int]) -> bool | None:
        """Whether the throttle stick is out of neutral, None where its calibration has not come."""
        neutral = self.parameters.throttle_neutral
        if neutral is None:
            return None
        number, low, high = neutral
        return bool(pulses[number]) and not low <= pulses[number] <= high

    def _parameter(self, now: float, message: Message, samples: list[Sample]) -> None:
        name, parameters, authority = message.param_id, self.parameters, self.authority
        steered, before, was = parameters.steering_input, self._output.channel, parameters.get(name)
        if parameters.take(name, message.param_value):
            authority.misfit = self._output.use(parameters, is_steered=authority.steering)
            if self.bow is not None:
                self.bow.use(parameters)
            after, is_another = self._output.channel, steered != parameters.steering_input
            is_lost = self.guided is None and (is_another or (before is not None and after is None))
            # the same input moves the rudder the other way from now on: who meant it, looks at it first
            turns = before is not None and after is not None and before.servo_reversed != after.servo_reversed
            if authority.steering and was is not None and (is_lost or turns):
                authority.refuse(f"{name} was changed from {was:g} to {message.param_value:g} while we steered")
            if is_another:
                self.probe.reset()  # the input that was proved is another now, and is released first

    def _sample_time(self, now: float, boot: float) -> float | None:
        """Return when a message of `boot` [s] was made; None where it is of no use."""
        if boot == 0.0:
            return now  # the field is not filled in: no vehicle speaks in the first millisecond
        belongs = self._clock.judge(now, boot)
        if belongs is Belongs.STRANGE:
            return None
        if belongs is Belongs.REBOOTED:
            left = self._clock.offset
            self._clock.reset()
            self._ask_anew()
            self.authority.rebooted(now, math.nan if left is None else left, now - boot)
        return self._clock.local(now, boot)

    def _is_overtaken(self, now: float, kind: int, boot: float, wrap_s: float) -> bool:
        """Return whether a report of `boot` [s], by a clock that begins again after `wrap_s`, is no news any more."""
        if kind in self._newest:
            newest, came = self._newest[kind]
            if 0.0 < (newest - boot) % wrap_s < 0.5 * wrap_s and now - came <= OVERTAKEN_S:
                return True
        self._newest[kind] = boot, now
        return False

    def _servo_time(self, now: float, time_usec: int) -> float:
        if (offset := self._clock.offset) is None or time_usec == 0:
            return now
        # 32 bits of microseconds begin again every 71.6 minutes: take the turn that lies nearest.
        boot = time_usec * 1.0e-6
        time = boot + round((now - offset - boot) / USEC_WRAP_S) * USEC_WRAP_S + offset
        return time if time < now else now

    def _ask_anew(self) -> None:
        self.parameters.reset()
        self.streams.reset()
        self._output.restarted()
        if self.bow is not None:
            self.bow.forget()
        self.authority.misfit = self.authority.radio = ""
        self.radio = RadioWatch()
        self.health.restart()
        self.probe.reset()
        self._newest.clear()
        if self.guided is not None:
            self.guided.reset()
