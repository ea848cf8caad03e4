"""What is watched while we steer. A monitor never moves the rudder: it names an alarm, and `autopilot.alarms` has what
follows from it. Pure: memory is a few numbers, `reset` forgets them."""

from autopilot.monitors.watch import FROZEN, RUNAWAY, Monitors
from autopilot.monitors.watched import AlarmLimits, Watched

__all__ = ["FROZEN", "RUNAWAY", "AlarmLimits", "Monitors", "Watched"]
