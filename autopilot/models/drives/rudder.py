"""A rudder in the flow: its force goes with the square of the flow past it."""

from autopilot.models.drive_law import RUDDER_LAW
from autopilot.models.drives.kind import DriveKind, Needs

GROUND_STEERING = 26
DRIVES = (
    DriveKind(
        "rudder",
        Needs.WAY,
        RUDDER_LAW,
        (GROUND_STEERING,),
        "set SERVOn_FUNCTION of the rudder to 26",
    ),
)
