"""The part of ArduRover that a companion meets: modes, arming, radio, overrides, fail-safes, servo outputs.

Behaviour after ArduPilot's Rover/radio.cpp, Rover/failsafe.cpp, Rover/mode.cpp, Rover/AP_MotorsUGV.cpp and
libraries/RC_Channel, firmware 4.6; what 4.8 adds for who asks for 4.8. Knows no message: the wire does.
"""

from __future__ import annotations

import math
from enum import IntEnum
from typing import TYPE_CHECKING

from pymavlink.dialects.v20 import ardupilotmega as dialect

from sitl.fault_table import GPS
from sitl.faults import VehicleFaults
from sitl.firmware_parameters import FORMAT_VERSION, GROUND_PRESSURE, ParameterTable, default_parameters
from sitl.firmware_setup import (
    BOW_US,
    CHANNELS,
    SCALED_FUNCTION,
    SERVO_US,
    STEERING_FULL,
    THROTTLE_FULL,
    Calibration,
    OverridePermit,
    Overrides,
    Setup,
    StickArming,
    by_hand,
    curved,
    input_angle,
    input_calibration,
    output_pulse,
    skid_outputs,
    slewed,
    to_rudder,
    travel,
)
from sitl.guided import GuidedHelm, Target
from sitl.world import Orders, World

if TYPE_CHECKING:
    from sitl.wire_mavlink import MavlinkVehicle

MODE_SWITCH_S = 1.0
"""So long after the start the radio's mode switch is read, and whatever mode was set in between is overwritten."""
HOUSEKEEPING_S = 1.0
"""So often the firmware writes what it keeps in parameters by itself: ground pressure while disarmed, run time."""
STATISTICS_S = 10.0
"""AP_Stats writes its counters so often."""
PRESSURE_SWING_PA = 12.0
PRESSURE_PERIOD_S = 37.0
"""The ground pressure of the simulated board swings by so much, in so long."""
GYRO_DRIFT_RAD_S = 1.0e-4
"""Every boot calibrates the gyros anew and finds offsets that differ by this much."""
CRUISE_SHARE = 0.5
"""Throttle at which the boat runs at its cruise speed (CRUISE_THROTTLE)."""


MIXED_FULL = 1000
"""Full output of one of two thrusters."""
SKID_STEERED = {
    "SERVO1_FUNCTION": 73.0,
    "SERVO3_FUNCTION": 74.0,
    "PILOT_STEER_TYPE": 3.0,
    "MOT_SPD_SCA_BASE": 0.0,
    "MOT_THST_ASYM": 1.34,
}
"""What the owner of a boat with two thrusters has set."""


BOW_OUTPUT = 5
"""The output that a bow thruster is wired to."""


def _bow_set_up(channel: int) -> dict[str, float]:
    """Return what the owner of a boat with a bow thruster on this channel of the radio has set."""
    return {
        f"SERVO{BOW_OUTPUT}_FUNCTION": float(SCALED_FUNCTION - 1 + channel),
        "SERVO_RC_FS_MSK": float(1 << (channel - 1) | 1 << (BOW_OUTPUT - 1)),
        "ARMING_RUDDER": 0.0,
    }


class FirmwareMode(IntEnum):
    """The modes of ArduRover that are simulated, by their numbers."""

    MANUAL = 0
    HOLD = 4
    GUIDED = 15
    INITIALISING = 16


class Firmware:
    """The simulated flight controller. It is a helm of the world: each step of the world is one of its loops.

    autopilot: MAV_AUTOPILOT of its heartbeat.  mode_refusal: MAV_RESULT of a mode that it does not take.
    """

    autopilot = int(dialect.MAV_AUTOPILOT_ARDUPILOTMEGA)
    mode_refusal = int(dialect.MAV_RESULT_FAILED)

    def __init__(self, world: World) -> None:
        self.world = world
        vehicle = world.scenario.vehicle
        vessel = world.vessel
        major, minor = vehicle.firmware.rpartition("-")[2].split(".")
        self.version = (int(major), int(minor))
        self.parameters = ParameterTable(default_parameters())
        self.parameters.set("CRUISE_SPEED", world.cruise_speed)
        self._motors = world.motors
        self._cruise_share = CRUISE_SHARE
        if self._motors is not None:
            self._cruise_share = self._motors.throttle_of(world.cruise_speed)
            self.parameters.set("CRUISE_THROTTLE", round(100.0 * self._cruise_share))
            if self._motors.full:
                for name, value in SKID_STEERED.items():
                    self.parameters.set(name, value)
        if world.bow is not None and vessel.drive.bow_thruster is not None:
            for name, value in _bow_set_up(vessel.drive.bow_thruster.channel).items():
                self.parameters.set(name, value)
        full_deg = vessel.helm.rudder_at_full_pwm_deg or vessel.rudder.angle_max_deg
        # how the servo is linked to the rudder does not change with the parameters
        self._full_rudder = math.radians(-full_deg if vessel.helm.reversed else full_deg)
        self._full_pulses = vessel.helm.servo_us or SERVO_US
        self._setup = Setup(self.parameters, self.version)
        self._setup_changes = self.parameters.changes
        self._housekeeping_time = self._statistics_time = -math.inf
        self._run_time = 0.0
        self.overrides = Overrides()
        self.guided = GuidedHelm()
        self.receiver = self.has_receiver = vehicle.receiver
        self.sticks = self._resting_sticks()
        self.notices: list[tuple[int, str]] = []
        self.ports: list[MavlinkVehicle] = []
        """The MAVLink ports, for what passes from one to the others."""
        self._wanted_mode = FirmwareMode[vehicle.mode]
        self._wants_arming = vehicle.armed
        self._faults = VehicleFaults(self)
        self.reboots = 0
        self._boot(world.time, vehicle.boot_s)
        world.helms.append(self)

    def _boot(self, time: float, boot_s: float) -> None:
        self.boot_time = time
        self._ready_time = time + boot_s
        self._switch_time = self._ready_time + MODE_SWITCH_S if boot_s > 0.0 and self.receiver else math.inf
        self.mode = FirmwareMode.INITIALISING
        self.armed = False
        self.overrides.clear()
        self.guided.clear()
        self._permit = OverridePermit()
        self._stick_arming = StickArming()
        self.channels = [0] * CHANNELS
        self.servos = [0] * CHANNELS
        self._has_received_radio = False
        self._last_radio_time = time
        self._radio_failed_since: float | None = None
        self._station_time: float | None = None
        self._station_lost_since: float | None = None
        self.failsafe = ""
        self.throttle = 0
        self._thrust, self._loop_time = 0.0, time
        self._is_new_thrust = self._wants_arming
        if boot_s <= 0.0:
            self._become_ready()

    def reboot(self, time: float) -> None:
        """Start again: time since boot from zero, disarmed, in the first mode, parameters kept."""
        self._wants_arming = False
        self.reboots += 1
        self._load_parameters()
        self._boot(time, max(self.world.scenario.vehicle.boot_s, 1.0))

    def _load_parameters(self) -> None:
        """Read what is stored; another format than the firmware's own erases it. Count the boot, zero the gyros."""
        table = self.parameters
        if table["FORMAT_VERSION"] != FORMAT_VERSION:
            table.erase()
            self.notices.append((4, "Resetting parameters: format changed"))
        table.move("STAT_BOOTCNT", table["STAT_BOOTCNT"] + 1.0)
        for name in ("INS_GYROFFS_X", "INS_GYR2OFFS_X"):
            table.move(name, table[name] + GYRO_DRIFT_RAD_S)

    def _housekeeping(self, time: float) -> None:
        """Move the parameters that move by themselves; nothing of how the boat steers follows from them."""
        if time - self._housekeeping_time < HOUSEKEEPING_S:
            return
        if math.isfinite(self._housekeeping_time):
            self._run_time += time - self._housekeeping_time
        self._housekeeping_time = time
        if not self.armed:
            swing = PRESSURE_SWING_PA * math.sin(math.tau * time / PRESSURE_PERIOD_S)
            for number, of in ((1, 1.0), (2, 0.5)):
                self.parameters.move(f"BARO{number}_GND_PRESS", GROUND_PRESSURE + of * swing)
        if time - self._statistics_time >= STATISTICS_S:
            self._statistics_time = time
            self.parameters.move("STAT_RUNTIME", math.floor(self._run_time))

    def _become_ready(self) -> None:
        self.mode = self._wanted_mode
        self.armed = self._wants_arming

    def time_since_boot(self, time: float) -> float:
        """Return the seconds since the firmware started."""
        return max(time - self.boot_time, 0.0)

    def has_position(self, time: float) -> bool:
        """Return whether the firmware knows where it is."""
        late = self.time_since_boot(time) >= self.world.scenario.vehicle.position_after_s
        return late and not self.world.faults.silences(GPS, time)

    @property
    def has_received_radio(self) -> bool:
        """Whether a radio receiver has sent anything since the start."""
        return self._has_received_radio

    @property
    def setup(self) -> Setup:
        """What the parameters say at this moment."""
        if self._setup_changes != self.parameters.changes:
            self._setup_changes = self.parameters.changes
            self._setup = Setup(self.parameters, self.version)
        return self._setup

    def set_mode(self, number: int) -> bool:
        """Change the mode; False where the number is none of ours, the firmware is still starting, or, armed, it
        knows no position and GUIDED needs one."""
        if self.mode is FirmwareMode.INITIALISING or number not in (0, 4, 15):
            return False
        if number == FirmwareMode.GUIDED and self.armed and not self.has_position(self.world.time):
            return False
        if number != self.mode:
            self.guided.clear()
        self.mode = FirmwareMode(number)
        return True

    @property
    def custom_mode(self) -> int:
        """What the heartbeat says of the mode."""
        return int(self.mode)

    def mode_of(self, main: int, sub: int) -> int:
        """Return the custom_mode that parameters 2 and 3 of MAV_CMD_DO_SET_MODE mean."""
        return main

    def go(self, north: float, east: float, time: float) -> None:
        """Take a velocity [m/s] in the place of a heading; not simulated here."""

    def guide(self, target: Target) -> None:
        """Take a target for GUIDED mode; in any other it is ignored in silence, from whomever it comes."""
        if self.mode is FirmwareMode.GUIDED:
            self.guided.take(target)

    def set_armed(self, armed: bool) -> bool:
        """Arm or disarm; False while the firmware is still starting."""
        if self.mode is FirmwareMode.INITIALISING:
            return False
        if armed != self.armed:
            self.notices.append((6, "Throttle armed" if armed else "Throttle disarmed"))
        self.armed = armed
        return True

    def on_station(self, time: float) -> None:
        """Note a sign of life from the ground station (SYSID_MYGCS)."""
        self._station_time = time

    def orders(self, time: float) -> Orders:
        """Run one loop of the firmware; return where the servos put the rudder and the engine."""
        self._faults.work(time)
        self._housekeeping(time)
        if self.mode is FirmwareMode.INITIALISING:
            if time < self._ready_time:
                return Orders(0.0, 0.0)
            self._become_ready()
        if time >= self._switch_time:
            self._switch_time = math.inf
            self.set_mode(self._wanted_mode)
        setup = self.setup
        steering, throttle = self._read_radio(time, setup)
        self._check_station(time, setup)
        is_manual = self.mode is FirmwareMode.MANUAL and self._radio_failed_since is None
        if self.mode is FirmwareMode.GUIDED:
            stick = 0.0 if self._radio_failed_since is not None else throttle / THROTTLE_FULL
            steering, throttle = self._follow_target(time, setup, stick)
        elif not is_manual:
            steering = throttle = 0
        if self._motors is not None:
            return self._driven(time, setup, (steering / STEERING_FULL, throttle / THROTTLE_FULL), is_manual=is_manual)
        if is_manual:
            turned, ahead = by_hand(setup.motors, steering / STEERING_FULL, throttle / THROTTLE_FULL, is_skid=False)
            if self.armed:
                turned = to_rudder(setup.motors, turned, ahead, self.world.boat.state.speed)
            steering, throttle = round(turned * STEERING_FULL), round(ahead * THROTTLE_FULL)
        self.throttle = throttle if self.armed else 0
        self._drive_servos(setup, steering, self.throttle / THROTTLE_FULL)
        speed = self.world.cruise_speed * self.throttle / THROTTLE_FULL / CRUISE_SHARE
        return Orders(self._rudder_of_servo(), speed, self._bow_of_servo())

    def _driven(self, time: float, setup: Setup, asked: tuple[float, float], *, is_manual: bool) -> Orders:
        """Orders of a boat with motors of its own: what the outputs give them, a share of full."""
        assert self._motors is not None
        motors, (steering, throttle) = setup.motors, asked
        if is_manual:
            steering, throttle = by_hand(motors, steering, throttle, is_skid=setup.is_skid)
            if not setup.is_skid and self.armed:
                steering = to_rudder(motors, steering, throttle, self.world.boat.state.speed)
        throttle = throttle if self.armed else 0.0
        # a boat that is armed from the start is under way: its throttle was there before
        dt = math.inf if self._is_new_thrust else time - self._loop_time
        self._thrust, self._loop_time = slewed(motors, self._thrust, throttle, dt), time
        self._is_new_thrust = False
        self.throttle = round(self._thrust * THROTTLE_FULL)
        if not setup.is_skid:
            self._drive_servos(setup, round(steering * STEERING_FULL), curved(motors, self._thrust))
            outputs = setup.throttle_outputs
            share = _share_of(outputs[0][1], self.servos[outputs[0][0] - 1]) if outputs else 0.0
            return Orders(self._rudder_of_servo(), self._motors.speed_of(share))
        pair = skid_outputs(motors, steering, self._thrust) if self.armed else (0.0, 0.0)
        servos, turned = [0] * CHANNELS, []
        for outputs, share in zip((setup.left_outputs, setup.right_outputs), pair, strict=True):
            for channel, servo in outputs:
                servos[channel - 1] = output_pulse(servo, share * MIXED_FULL, MIXED_FULL)
            turned.append(_share_of(outputs[0][1], servos[outputs[0][0] - 1]))
        self.servos = servos
        left, right = turned
        return Orders(0.5 * (left - right) * self._motors.full, self._motors.speed_of(0.5 * (left + right)))

    def _follow_target(self, time: float, setup: Setup, stick: float) -> tuple[int, int]:
        """Steering and throttle of GUIDED mode, with the throttle stick at `stick` in -1..1."""
        guided, gains = self.guided, setup.guided
        if guided.has_expired(time):
            self.notices.append((4, guided.stopping_text(self.version)))
        reading = self.world.sensors.latest(time)
        if reading is None:
            return 0, 0
        if guided.target is None and guided.loiter is None:
            guided.loiter = reading.heading
        steering = guided.steering(gains, time, reading.heading, reading.rate, self.world.boat.state.speed)
        full = guided.fastest(gains)
        throttle = guided.speed(gains, stick) / full if full > 0.0 else 0.0
        return round(steering * STEERING_FULL), round(min(max(throttle, -1.0), 1.0) * THROTTLE_FULL)

    def _read_radio(self, time: float, setup: Setup) -> tuple[int, int]:
        """Sticks or overrides into the channels; without either for RC_FS_TIMEOUT the radio has failed. Return the
        steering and the throttle that they hold."""
        has_news = self.receiver or self.overrides.are_new
        self.overrides.are_new = False
        self._has_received_radio = self._has_received_radio or self.receiver
        is_updated = has_news and self._update_channels(time, setup)
        steering, throttle = self._held(setup)
        if is_updated:
            self._last_radio_time = time
            self._arm_by_stick(time, setup, steering, throttle)
        pulse = self.channels[setup.throttle_channel - 1]
        is_low = self._has_received_radio and pulse < setup.radio_failsafe_pulse
        has_failed = setup.radio_failsafe and (is_low or time - self._last_radio_time > setup.radio_timeout)
        self._radio_failed_since = self._watch("Radio", has_failed, self._radio_failed_since, time, setup)
        return steering, throttle

    def _held(self, setup: Setup) -> tuple[int, int]:
        """Return the steering and the throttle that the channels hold."""
        return (
            input_angle(setup.steering_input, self.channels[setup.steering_channel - 1], STEERING_FULL),
            input_angle(setup.throttle_input, self.channels[setup.throttle_channel - 1], THROTTLE_FULL),
        )

    def _update_channels(self, time: float, setup: Setup) -> bool:
        overrides = self.overrides.active(time, setup.override_time)
        if self._has_received_radio:
            self.channels = list(self.sticks)
            is_taken = self._permit.update(setup, self.sticks, bool(overrides))
            if is_taken:
                self.notices.append((5, "RC overrides cleared by pilot input"))
            if not self._permit.is_given:
                self.overrides.clear()
                overrides = {}
        for channel, pulse in overrides.items():
            self.channels[channel - 1] = pulse
        return self._has_received_radio or bool(overrides)

    def _arm_by_stick(self, time: float, setup: Setup, steering: int, throttle: int) -> None:
        """ARMING_RUDDER: an override of the steering counts as the stick."""
        arming_wanted = self._stick_arming.arming_wanted(time, setup, steering, throttle)
        if arming_wanted and self.mode is not FirmwareMode.GUIDED:
            self.set_armed(True)
        elif arming_wanted is False and not self.throttle:
            self.set_armed(False)

    def _check_station(self, time: float, setup: Setup) -> None:
        """FS_GCS_ENABLE: a ground station that was there and has fallen silent."""
        is_lost = (
            setup.station_failsafe
            and self._station_time is not None
            and time - self._station_time > setup.station_timeout
        )
        self._station_lost_since = self._watch("GCS", is_lost, self._station_lost_since, time, setup)

    def _watch(self, name: str, is_lost: bool, since: float | None, time: float, setup: Setup) -> float | None:
        """Fail-safe of one kind: FS_ACTION after FS_TIMEOUT, cleared when what was lost is back."""
        if not is_lost:
            if self.failsafe == name:
                self.failsafe = ""
                self.notices.append((6, f"{name} Failsafe Cleared"))
            return None
        start = time if since is None else since
        if time - start > setup.failsafe_time and not self.failsafe and self.mode is not FirmwareMode.HOLD:
            self.failsafe = name
            self.overrides.clear()
            self.notices.append((4, f"{name} Failsafe"))
            if setup.failsafe_holds:
                self.mode = FirmwareMode.HOLD
        return start

    def _drive_servos(self, setup: Setup, steering: int, throttle: float) -> None:
        """Each output follows its SERVOn_FUNCTION; outputs without one have no pulses."""
        servos = [0] * CHANNELS
        for channel, servo in setup.steering_outputs:
            servos[channel - 1] = output_pulse(servo, steering, STEERING_FULL)
        for channel, servo in setup.throttle_outputs:
            servos[channel - 1] = output_pulse(servo, throttle * THROTTLE_FULL, THROTTLE_FULL)
        for channel, servo, number in setup.passed_outputs:
            servos[channel - 1] = self._passed(setup, channel, servo, number)
        self.servos = servos

    def _passed(self, setup: Setup, channel: int, servo: Calibration, number: int) -> int:
        """Pulse [us] of an output that passes channel `number` of the radio on: in the radio's fail-safe its trim where
        SERVO_RC_FS_MSK says so, else the last. While nothing has come it is at its trim."""
        if self._radio_failed_since is not None:
            kept = self.servos[channel - 1] or servo.trim
            return servo.trim if setup.safe_mask & 1 << (number - 1) else kept
        pulse = self.channels[number - 1]
        if not pulse:
            return servo.trim
        position = input_angle(input_calibration(self.parameters, number), pulse, STEERING_FULL)
        return output_pulse(servo, position, STEERING_FULL)

    def _bow_of_servo(self) -> float:
        """What the bow thruster that is fitted is given, -1 to 1: it knows the end points that its output came with."""
        if self.world.bow is None:
            return 0.0
        bow = self.world.vessel.drive.bow_thruster
        share = travel(BOW_US, self.servos[BOW_OUTPUT - 1])
        return -share if bow is not None and bow.reversed else share

    def _rudder_of_servo(self) -> float:
        """The servo that is fitted stands on output 1; without pulses it stays amidships."""
        return travel(self._full_pulses, self.servos[0]) * self._full_rudder

    def _resting_sticks(self) -> list[int]:
        """Steering centred, throttle where the boat runs at its cruise speed, mode switch in its first position."""
        sticks = [1500] * CHANNELS
        throttle = self.setup.throttle_input
        above = throttle.trim + throttle.dead_zone
        # one more microsecond than the exact share, so that truncation does not lose one per cent
        sticks[self.setup.throttle_channel - 1] = above + math.ceil(self._cruise_share * (throttle.high - above))
        sticks[7] = 1000
        return sticks


def _share_of(servo: Calibration, pulse: int) -> float:
    """Return what a motor that was fitted for the end points of its output makes of a pulse [us]: -1 to 1."""
    share = travel((servo.low, servo.trim, servo.high), pulse)
    return -share if servo.is_reversed else share
