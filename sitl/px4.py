"""PX4's Ackermann rover towards a companion: its modes, and Offboard by a velocity, steered by PX4's own controllers.

After PX4 1.16 to 1.18: commander (UserModeIntention, offboardCheck, failsafe), mavlink_receiver, and of rover_ackermann
the offboard mode and the controllers of speed, attitude and rate. Left out: slew rates, PX4's parameters (the table is
ArduRover's; who asks it for nothing does not notice), and its other modes. Position mode steers as Manual does.
"""

from __future__ import annotations

import math
from enum import IntEnum

from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.angles import wrap
from sitl.firmware import Firmware, FirmwareMode
from sitl.firmware_setup import STEERING_FULL, THROTTLE_FULL, Setup
from sitl.world import Orders, World

PREFIX = "px4"
OFFBOARD_LOSS_S = 1.0
"""COM_OF_LOSS_T: without a setpoint for this long the signal is lost."""
EPSILON = 1.2e-7
"""What PX4 takes for zero (FLT_EPSILON)."""
SPEED_P = 0.1
"""RO_SPEED_P, in shares of full throttle for each m/s."""
YAW_P, YAW_RATE_P, YAW_RATE_I = 1.0, 0.5, 0.3
"""RO_YAW_P, RO_YAW_RATE_P, RO_YAW_RATE_I."""
YAW_RATE_MAX = math.radians(30.0)
"""RO_YAW_RATE_LIM."""


class Px4Mode(IntEnum):
    """The modes that are simulated, by their custom_mode: main mode << 16 | sub mode << 24 (px4_custom_mode.h)."""

    MANUAL = 1 << 16
    POSITION = 3 << 16
    HOLD = 4 << 16 | 3 << 24
    OFFBOARD = 6 << 16


STEERED = {
    Px4Mode.MANUAL: FirmwareMode.MANUAL,
    Px4Mode.POSITION: FirmwareMode.MANUAL,
    Px4Mode.HOLD: FirmwareMode.HOLD,
    Px4Mode.OFFBOARD: FirmwareMode.GUIDED,
}
"""What steers in each: the sticks, nothing, or the firmware itself."""


class Px4(Firmware):
    """The simulated flight controller with PX4.

    Attributes:
        lost_mode: COM_OBL_RC_ACT, the mode that a lost offboard signal leads to; without a radio Hold in the place of
            Position (NAV_RCL_ACT 1).
    """

    autopilot = int(dialect.MAV_AUTOPILOT_PX4)
    mode_refusal = int(dialect.MAV_RESULT_TEMPORARILY_REJECTED)

    def __init__(self, world: World) -> None:
        self.lost_mode = Px4Mode.POSITION
        self._intended = self._flown = Px4Mode.MANUAL
        self._setpoint_time = self._loop = -math.inf
        self._velocity = (0.0, 0.0)
        self._integral = 0.0
        model = world.vessel.model
        self._wheel_base = model.reference_speed_m_s / model.K_1_s
        """RA_WHEEL_BASE as who tunes it for a boat would have it: a rudder turns it as wheels turn so long a car."""
        self._angle_max = math.radians(world.vessel.rudder.angle_max_deg)
        super().__init__(world)

    @property
    def custom_mode(self) -> int:
        """What the heartbeat says of the mode."""
        if self.mode is FirmwareMode.INITIALISING:
            return 0
        return int(self._flown if STEERED[self._flown] is self.mode else Px4Mode.HOLD)

    def mode_of(self, main: int, sub: int) -> int:
        """Return the custom_mode that MAV_CMD_DO_SET_MODE means: it carries main and sub mode apart."""
        return main << 16 | sub << 24

    def set_mode(self, number: int) -> bool:
        """Change the mode, a human's wish; Offboard while armed only with its signal and a position."""
        if self.mode is FirmwareMode.INITIALISING or number not in STEERED:
            return False
        if number == Px4Mode.OFFBOARD and self.armed and not self._can_offboard(self.world.time):
            return False
        self._intended = Px4Mode(number)
        self._enter(self._intended)
        return True

    def go(self, north: float, east: float, time: float) -> None:
        """Take a velocity [m/s]: a sign of life in any mode, and obeyed in Offboard alone."""
        self._setpoint_time = time
        if self._flown is Px4Mode.OFFBOARD:
            self._velocity = north, east

    def orders(self, time: float) -> Orders:
        """Run one loop; a lost signal leads out of Offboard, and one that is back leads in again: nobody changed the
        mode."""
        if self.mode is not FirmwareMode.INITIALISING and self._intended is Px4Mode.OFFBOARD:
            is_lost = self.armed and not self._can_offboard(time)
            holds = self.lost_mode is Px4Mode.POSITION and not self.receiver
            wanted = self._intended if not is_lost else Px4Mode.HOLD if holds else self.lost_mode
            self.failsafe = "Offboard" if is_lost else ""
            if wanted is not self._flown:
                self._enter(wanted)
        return super().orders(time)

    def _read_radio(self, time: float, setup: Setup) -> tuple[int, int]:
        """Sticks into the channels; that a radio may be lost is left out, and so are overrides."""
        self._has_received_radio = self._has_received_radio or self.receiver
        self.channels = list(self.sticks) if self.receiver else self.channels
        return self._held(setup)

    def _become_ready(self) -> None:
        super()._become_ready()
        self._intended = self._flown = next(mode for mode in STEERED if STEERED[mode] is self.mode)

    def _can_offboard(self, time: float) -> bool:
        return time - self._setpoint_time <= OFFBOARD_LOSS_S and self.has_position(time)

    def _enter(self, mode: Px4Mode) -> None:
        self._flown, self.mode = mode, STEERED[mode]
        self._velocity, self._integral = (0.0, 0.0), 0.0

    def _follow_target(self, time: float, setup: Setup, stick: float) -> tuple[int, int]:
        """Steering and throttle of Offboard; the sticks have no say."""
        reading = self.world.sensors.latest(time)
        dt, self._loop = min(time - self._loop, 0.1), time
        if reading is None:
            return 0, 0
        (north, east), full = self._velocity, self.world.cruise_speed / self._cruise_share
        speed = math.hypot(north, east)
        throttle = 0.0
        if speed > EPSILON:
            throttle = min(max(speed / full + SPEED_P * (speed - reading.ground_speed), -1.0), 1.0)
        if abs(throttle * full) < EPSILON:
            self._integral = 0.0
            return 0, 0
        error = wrap(math.atan2(east, north) - reading.heading)
        wanted = min(max(YAW_P * error, -YAW_RATE_MAX), YAW_RATE_MAX)
        angle = math.atan(wanted * self._wheel_base / (throttle * full))
        if throttle > 0.0:
            missing = wanted - reading.rate
            self._integral = min(max(self._integral + YAW_RATE_I * missing * dt, -1.0), 1.0)
            angle += YAW_RATE_P * missing + self._integral
        share = min(max(angle / self._angle_max, -1.0), 1.0)
        return round(share * STEERING_FULL), round(throttle * THROTTLE_FULL)


def firmware_of(world: World) -> Firmware:
    """Return the flight controller that the world's scenario names."""
    is_px4 = world.scenario.vehicle.firmware.startswith(PREFIX)
    return Px4(world) if is_px4 else Firmware(world)
