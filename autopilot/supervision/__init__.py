"""What the pilot may do: states, alarms, monitors, fail-safe steering and the last look at a command."""
