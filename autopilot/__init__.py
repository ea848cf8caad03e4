"""Norrbin: a MAVLink-connected autopilot bridge for boats."""

__version__ = "0.1.0"
