"""Vessel and firmware files, and the MAVLink parameter protocol."""
