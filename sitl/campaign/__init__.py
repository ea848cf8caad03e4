"""Thousands of seeded runs of the whole closed loop: boat, sea, sensors and the pilot's own functions.

The one room of `sitl` that may use the pilot: what it studies is the pilot and the boat together.
"""
