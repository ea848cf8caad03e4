"""`python -m sitl` is the `sitl` command."""

from autopilot.entry import sitl

sitl()
