"""The running pilot as a MAVLink surface boat, for ground stations: telemetry, parameters, modes and commands."""
