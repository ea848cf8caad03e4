"""Norrbin: a MAVLink-connected autopilot bridge for boats."""
