"""Pure equations of motion: no clock, no I/O, SI units and radians."""
