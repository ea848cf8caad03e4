"""`python -m autopilot` is the `autopilot` command."""

from autopilot.entry import autopilot

autopilot()
