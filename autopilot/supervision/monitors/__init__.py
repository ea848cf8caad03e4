"""What is watched while we steer. A monitor never moves the rudder: it names an alarm, and
`autopilot.supervision.alarms` has what follows from it. Pure: memory is a few numbers, `reset` forgets them."""

from autopilot.supervision.monitors.compass import FROZEN_SAMPLES
from autopilot.supervision.monitors.rudder import AT_THE_STOP
from autopilot.supervision.monitors.watch import Monitors
from autopilot.supervision.monitors.watched import AlarmLimits, Watched

__all__ = ["AT_THE_STOP", "FROZEN_SAMPLES", "AlarmLimits", "Monitors", "Watched"]
