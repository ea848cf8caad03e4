"""Thrust that is turned: an outboard, a sterndrive, a jet's nozzle, a vectored propeller.

The moment is the thrust's times its lever and the sine of the angle. Thrust of a propeller or a jet goes with the
square of its revolutions: q = 2, unless the flight controller or the motor's own control makes it linear.
In MANUAL mode ArduRover does with a vectored frame (MOT_VEC_ANGLEMAX) what it does with a rudder: the servo follows the
stick. Only its own modes reckon with the thrust (libraries/AR_Motors/AP_MotorsUGV.cpp, output_regular).
"""

from autopilot.models.drive_law import DriveLaw
from autopilot.models.drives.kind import DriveKind, Needs
from autopilot.models.drives.rudder import GROUND_STEERING

USUAL = DriveLaw(speed_exponent=0.0, throttle_exponent=2.0, damping_share=0.0)
ADVICE = "set SERVOn_FUNCTION of what turns the thrust to 26"
DRIVES = tuple(
    DriveKind(name, Needs.THRUST, USUAL, (GROUND_STEERING,), ADVICE) for name in ("outboard", "jet", "vectored")
)
