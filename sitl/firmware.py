"""The part of ArduRover that a companion meets: modes, arming, radio, overrides, fail-safes, servo outputs.

Behaviour after ArduPilot's Rover/radio.cpp, Rover/failsafe.cpp, Rover/mode.cpp, Rover/AP_MotorsUGV.cpp and
libraries/RC_Channel, firmware 4.6. Knows no message: the wire does.
"""

from __future__ import annotations

import math
from enum import IntEnum

from sitl.firmware_parameters import ParameterTable, default_parameters
from sitl.radio import CHANNELS, STEERING_FULL, THROTTLE_FULL, Calibration, Overrides, input_angle, output_pulse
from sitl.world import Orders, World

CRUISE_SHARE = 0.5
"""Throttle at which the boat runs at its cruise speed (CRUISE_THROTTLE)."""


class FirmwareMode(IntEnum):
    """The modes of ArduRover that are simulated, by their numbers."""

    MANUAL = 0
    HOLD = 4
    GUIDED = 15
    INITIALISING = 16


class Firmware:
    """The simulated flight controller. It is a helm of the world: each step of the world is one of its loops."""

    def __init__(self, world: World) -> None:
        self.world = world
        vehicle = world.scenario.vehicle
        vessel = world.vessel
        self.parameters = ParameterTable(default_parameters())
        self.parameters.set("CRUISE_SPEED", world.cruise_speed)
        full_deg = vessel.helm.rudder_at_full_pwm_deg or vessel.rudder.angle_max_deg
        # how the servo is linked to the rudder does not change with the parameters
        self._linkage = math.radians(-full_deg if vessel.helm.reversed else full_deg) / 500.0
        self.overrides = Overrides()
        self.receiver = vehicle.receiver
        self.sticks = self._resting_sticks()
        self.notices: list[tuple[int, str]] = []
        self._wanted_mode = FirmwareMode[vehicle.mode]
        self._wants_arming = vehicle.armed
        self._boot(world.time, vehicle.boot_s)
        world.helms.append(self)

    def _boot(self, time: float, boot_s: float) -> None:
        self.boot_time = time
        self._ready_time = time + boot_s
        self.mode = FirmwareMode.INITIALISING
        self.armed = False
        self.overrides.clear()
        self.channels = [0] * CHANNELS
        self.servos = [0] * CHANNELS
        self._has_heard_radio = False
        self._last_radio_time = time
        self._radio_failed_since: float | None = None
        self._station_time: float | None = None
        self._station_lost_since: float | None = None
        self.failsafe = ""
        self.throttle = 0
        if boot_s <= 0.0:
            self._become_ready()

    def reboot(self, time: float) -> None:
        """Start again: time since boot from zero, disarmed, in the first mode, parameters kept."""
        self._wants_arming = False
        self._boot(time, max(self.world.scenario.vehicle.boot_s, 1.0))

    def _become_ready(self) -> None:
        self.mode = self._wanted_mode
        self.armed = self._wants_arming

    def time_since_boot(self, time: float) -> float:
        """Return the seconds since the firmware started."""
        return max(time - self.boot_time, 0.0)

    def has_position(self, time: float) -> bool:
        """Return whether the firmware knows where it is."""
        return self.time_since_boot(time) >= self.world.scenario.vehicle.position_after_s

    @property
    def steering_channel(self) -> int:
        """RC channel of the steering (RCMAP_ROLL)."""
        return self._channel("RCMAP_ROLL")

    @property
    def throttle_channel(self) -> int:
        """RC channel of the throttle (RCMAP_THROTTLE)."""
        return self._channel("RCMAP_THROTTLE")

    def _channel(self, name: str) -> int:
        return min(max(int(self.parameters[name]), 1), CHANNELS)

    def input_calibration(self, channel: int) -> Calibration:
        """Return RCn_MIN, _TRIM, _MAX, _DZ and _REVERSED of a channel."""
        value = self.parameters
        prefix = f"RC{channel}_"
        return Calibration(
            int(value[prefix + "MIN"]),
            int(value[prefix + "TRIM"]),
            int(value[prefix + "MAX"]),
            int(value[prefix + "DZ"]),
            value[prefix + "REVERSED"] != 0.0,
        )

    def output_calibration(self, channel: int) -> Calibration:
        """Return SERVOn_MIN, _TRIM, _MAX and _REVERSED of an output."""
        value = self.parameters
        prefix = f"SERVO{channel}_"
        return Calibration(
            int(value[prefix + "MIN"]),
            int(value[prefix + "TRIM"]),
            int(value[prefix + "MAX"]),
            0,
            value[prefix + "REVERSED"] != 0.0,
        )

    def set_mode(self, number: int) -> bool:
        """Change the mode; False where the number is none of ours or the firmware is still starting."""
        if self.mode is FirmwareMode.INITIALISING or number not in (0, 4, 15):
            return False
        mode = FirmwareMode(number)
        if mode is not self.mode:
            self.mode = mode
            self.failsafe = ""
        return True

    def set_armed(self, armed: bool) -> bool:
        """Arm or disarm; False while the firmware is still starting."""
        if self.mode is FirmwareMode.INITIALISING:
            return False
        if armed != self.armed:
            self.notices.append((6, "Throttle armed" if armed else "Throttle disarmed"))
        self.armed = armed
        return True

    def station_heard(self, time: float) -> None:
        """Note a sign of life from the ground station (SYSID_MYGCS)."""
        self._station_time = time

    def orders(self, time: float) -> Orders:
        """Run one loop of the firmware; return where the servos put the rudder and the engine."""
        if self.mode is FirmwareMode.INITIALISING:
            if time < self._ready_time:
                return Orders(0.0, 0.0)
            self._become_ready()
        self._read_radio(time)
        self._check_station(time)
        steering = self._steering() if self.mode is FirmwareMode.MANUAL else 0
        self.throttle = self._pilot_throttle() if self.mode is FirmwareMode.MANUAL and self.armed else 0
        self._drive_servos(steering)
        speed = self.world.cruise_speed * self.throttle / THROTTLE_FULL / CRUISE_SHARE
        return Orders(self._rudder_of_servo(), speed)

    def _read_radio(self, time: float) -> None:
        """Sticks or overrides into the channels; without either for RC_FS_TIMEOUT the radio has failed."""
        has_news = self.receiver or self.overrides.are_new
        self.overrides.are_new = False
        self._has_heard_radio = self._has_heard_radio or self.receiver
        if has_news and self._update_channels(time):
            self._last_radio_time = time
        self._check_radio(time)

    def _update_channels(self, time: float) -> bool:
        timeout = self.parameters["RC_OVERRIDE_TIME"]
        has_updated = False
        for channel in range(1, CHANNELS + 1):
            override = self.overrides.active(channel, time, timeout)
            if override is not None:
                self.channels[channel - 1] = override
            elif self._has_heard_radio:
                self.channels[channel - 1] = self.sticks[channel - 1]
            else:
                continue
            has_updated = True
        return has_updated

    def _check_radio(self, time: float) -> None:
        has_failed = self.parameters["FS_THR_ENABLE"] != 0.0 and (
            (self.channels[self.throttle_channel - 1] < self.parameters["FS_THR_VALUE"] and self._has_heard_radio)
            or time - self._last_radio_time > self.parameters["RC_FS_TIMEOUT"]
        )
        if not has_failed:
            self._radio_failed_since = None
            if self.failsafe == "Radio":
                self.failsafe = ""
                self.notices.append((4, "Radio Failsafe Cleared"))
            return
        if self._radio_failed_since is None:
            self._radio_failed_since = time
        self._trigger("Radio", time - self._radio_failed_since)

    def _check_station(self, time: float) -> None:
        """FS_GCS_ENABLE: a ground station that was there and has fallen silent."""
        is_lost = (
            self.parameters["FS_GCS_ENABLE"] != 0.0
            and self._station_time is not None
            and time - self._station_time > self.parameters["FS_GCS_TIMEOUT"]
        )
        if not is_lost:
            self._station_lost_since = None
            if self.failsafe == "GCS":
                self.failsafe = ""
                self.notices.append((4, "GCS Failsafe Cleared"))
            return
        if self._station_lost_since is None:
            self._station_lost_since = time
        self._trigger("GCS", time - self._station_lost_since)

    def _trigger(self, name: str, lasted: float) -> None:
        if self.failsafe or lasted <= self.parameters["FS_TIMEOUT"] or self.mode is FirmwareMode.HOLD:
            return
        self.failsafe = name
        self.overrides.clear()
        self.notices.append((4, f"{name} Failsafe"))
        if self.parameters["FS_ACTION"] != 0.0:
            self.mode = FirmwareMode.HOLD

    def _steering(self) -> int:
        if self._radio_failed_since is not None:
            return 0
        channel = self.steering_channel
        return input_angle(self.input_calibration(channel), self.channels[channel - 1], STEERING_FULL)

    def _pilot_throttle(self) -> int:
        if self._radio_failed_since is not None:
            return 0
        channel = self.throttle_channel
        return input_angle(self.input_calibration(channel), self.channels[channel - 1], THROTTLE_FULL)

    def _drive_servos(self, steering: int) -> None:
        """Each output follows its SERVOn_FUNCTION: 26 steering, 70 throttle; the rest stays without pulses."""
        for channel in range(1, CHANNELS + 1):
            function = self.parameters[f"SERVO{channel}_FUNCTION"]
            if function == 26.0:
                self.servos[channel - 1] = output_pulse(self.output_calibration(channel), steering, STEERING_FULL)
            elif function == 70.0:
                self.servos[channel - 1] = output_pulse(self.output_calibration(channel), self.throttle, THROTTLE_FULL)
            else:
                self.servos[channel - 1] = 0

    def _rudder_of_servo(self) -> float:
        """The servo that is fitted stands on output 1, amidships at 1500 us; without pulses it stays amidships."""
        pulse = self.servos[0]
        return (pulse - 1500) * self._linkage if pulse else 0.0

    def _resting_sticks(self) -> list[int]:
        """Steering centred, throttle where the boat runs at its cruise speed, mode switch in its first position."""
        sticks = [1500] * CHANNELS
        throttle = self.input_calibration(3)
        above = throttle.trim + throttle.dead_zone
        # one more microsecond than the exact share, so that truncation does not lose a percent
        sticks[2] = above + math.ceil(CRUISE_SHARE * (throttle.high - above))
        sticks[7] = 1000
        return sticks
