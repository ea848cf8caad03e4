"""Faults of compass, rate gyro, speed log and GPS.

Those of one instrument act one after the other: what is late or frozen first, then what is added to it.
"""

from __future__ import annotations

import math
from collections import deque
from typing import TYPE_CHECKING

from autopilot.angles import wrap, wrap_positive
from sitl.boat import EARTH_RADIUS
from sitl.fault_kind import COMPASS, GPS, Acting, Dice, Kind
from sitl.faults_of_the_boat import delayed

if TYPE_CHECKING:
    from sitl.sensors import Reading


def _off(reading: Reading, angle: float) -> Reading:
    return reading._replace(heading=wrap_positive(reading.heading + angle)) if angle else reading


def heading_lag(fault: Acting, reading: Reading, dice: Dice) -> Reading:
    """Show the heading of some time ago, under the time stamp of now."""
    waiting = fault.memory.setdefault("waiting", deque())
    return reading._replace(heading=delayed(waiting, fault.time, reading.heading, fault.size))


def heading_frozen(fault: Acting, reading: Reading, dice: Dice) -> Reading:
    """Show the heading of the moment when it began."""
    return reading._replace(heading=fault.memory.setdefault("heading", reading.heading))


def heading_jump(fault: Acting, reading: Reading, dice: Dice) -> Reading:
    """Show a heading beside the true one."""
    return _off(reading, math.radians(fault.size))


def heading_drift(fault: Acting, reading: Reading, dice: Dice) -> Reading:
    """Show a heading that goes away from the true one."""
    return _off(reading, math.radians(fault.size * fault.lasted))


def heading_noise(fault: Acting, reading: Reading, dice: Dice) -> Reading:
    """Show a heading with noise."""
    return _off(reading, math.radians(fault.size) * dice.deviate())


def heading_spikes(fault: Acting, reading: Reading, dice: Dice) -> Reading:
    """Show anything now and then."""
    return _off(reading, 2.0 * math.pi * dice.share()) if dice.share() < fault.size else reading


def rate_lag(fault: Acting, reading: Reading, dice: Dice) -> Reading:
    """Show the rate of turn of some time ago, under the time stamp of now."""
    waiting = fault.memory.setdefault("waiting", deque())
    return reading._replace(rate=delayed(waiting, fault.time, reading.rate, fault.size))


def rate_frozen(fault: Acting, reading: Reading, dice: Dice) -> Reading:
    """Show the rates of the moment when it began."""
    rate, roll_rate = fault.memory.setdefault("rates", (reading.rate, reading.roll_rate))
    return reading._replace(rate=rate, roll_rate=roll_rate)


def rate_reversed(fault: Acting, reading: Reading, dice: Dice) -> Reading:
    """Show a turn to the other side."""
    return reading._replace(rate=-reading.rate)


def rate_bias(fault: Acting, reading: Reading, dice: Dice) -> Reading:
    """Show a rate beside the true one."""
    return reading._replace(rate=reading.rate + math.radians(fault.size))


def rate_noise(fault: Acting, reading: Reading, dice: Dice) -> Reading:
    """Show a rate with noise."""
    return reading._replace(rate=reading.rate + math.radians(fault.size) * dice.deviate())


SPEEDS = ("water_speed", "ground_speed", "north_speed", "east_speed")
"""Through the water, over the ground, and that one's parts: a GPS is wrong in all of them at once."""


def speed_frozen(fault: Acting, reading: Reading, dice: Dice) -> Reading:
    """Show the speeds of the moment when it began."""
    return reading._replace(**fault.memory.setdefault("speeds", {name: getattr(reading, name) for name in SPEEDS}))


def speed_wrong(fault: Acting, reading: Reading, dice: Dice) -> Reading:
    """Show so many times the speeds."""
    return reading._replace(**{name: getattr(reading, name) * fault.size for name in SPEEDS})


def position_jump(fault: Acting, reading: Reading, dice: Dice) -> Reading:
    """Show a place to the north."""
    return reading._replace(latitude=reading.latitude + math.degrees(fault.size / EARTH_RADIUS))


def wind_frozen(fault: Acting, reading: Reading, dice: Dice) -> Reading:
    """Show the apparent wind of the moment when it began."""
    angle, speed = fault.memory.setdefault("wind", (reading.wind_angle, reading.wind_speed))
    return reading._replace(wind_angle=angle, wind_speed=speed)


def wind_jump(fault: Acting, reading: Reading, dice: Dice) -> Reading:
    """Show an apparent wind beside the true one."""
    return reading._replace(wind_angle=wrap(reading.wind_angle + math.radians(fault.size)))


def late(fault: Acting, latency: float) -> float:
    """Return the time [s] to the sensor's end, longer."""
    return latency + fault.size


def no_number(fault: Acting, heading: float) -> float:
    """Return what is no number."""
    return math.nan


KINDS = {
    "heading_dropout": Kind("the compass sends nothing", silences=("ATTITUDE", COMPASS), of_a_compass=True),
    "rate_lag": Kind(
        "rates of turn are older than their time stamps say", "s", 0.3, 0.0, 10.0, of_a_compass=True, reads=rate_lag
    ),
    "rate_frozen": Kind("the rate gyro repeats its last value", of_a_compass=True, reads=rate_frozen),
    "rate_reversed": Kind("the rate gyro has the wrong sign", of_a_compass=True, reads=rate_reversed),
    "rate_bias": Kind(
        "the rate gyro is off by a constant", "deg/s", 5.0, -90.0, 90.0, of_a_compass=True, reads=rate_bias
    ),
    "rate_noise": Kind(
        "the rate gyro is noisy, standard deviation", "deg/s", 5.0, 0.0, 90.0, of_a_compass=True, reads=rate_noise
    ),
    "heading_late": Kind("heading, rate and roll leave the sensor late", "s", 1.0, 0.0, 10.0, latency=late),
    "heading_lag": Kind(
        "headings are older than their time stamps say", "s", 0.3, 0.0, 10.0, of_a_compass=True, reads=heading_lag
    ),
    "heading_frozen": Kind("the compass repeats its last heading", of_a_compass=True, reads=heading_frozen),
    "heading_jump": Kind(
        "the compass is off by a constant", "deg", 40.0, -180.0, 180.0, of_a_compass=True, reads=heading_jump
    ),
    "heading_drift": Kind("the compass wanders off", "deg/s", 1.0, -30.0, 30.0, of_a_compass=True, reads=heading_drift),
    "heading_noise": Kind(
        "the compass is noisy, standard deviation", "deg", 10.0, 0.0, 180.0, of_a_compass=True, reads=heading_noise
    ),
    "heading_spikes": Kind(
        "single headings are anything at all",
        "share of headings",
        0.1,
        0.0,
        1.0,
        of_a_compass=True,
        reads=heading_spikes,
    ),
    "heading_nan": Kind("the flight controller sends a heading that is no number", attitude=no_number),
    "speed_lost": Kind(
        "no speed, through the water or over the ground, is sent",
        silences=(
            "GLOBAL_POSITION_INT",
            "LOCAL_POSITION_NED",
            "VFR_HUD",
            "VHW",
            "VTG",
        ),
    ),
    "log_lost": Kind("no speed through the water is sent; that over the ground remains", silences=("VHW",)),
    "speed_frozen": Kind("speeds repeat their last values", reads=speed_frozen),
    "speed_wrong": Kind("speeds are multiplied", "times", 3.0, 0.0, 100.0, reads=speed_wrong),
    "position_lost": Kind("the GPS has no position", silences=("RMC", GPS)),
    "wind_lost": Kind("no wind is sent", silences=("MWV",)),
    "wind_frozen": Kind("the wind vane repeats its last wind", reads=wind_frozen),
    "wind_jump": Kind("the wind vane is off by a constant", "deg", 40.0, -180.0, 180.0, reads=wind_jump),
    "position_jump": Kind("the GPS shows a place to the north", "m", 200.0, -20000.0, 20000.0, reads=position_jump),
}
