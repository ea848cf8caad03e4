"""Instruments, plotter and rudder drive over NMEA 0183."""
