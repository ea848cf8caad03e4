"""What ArduPilot's DataFlash messages mean for a boat: heading, yaw rate, speed, position, steering, propeller, wind.

ATT.Yaw [deg], STER.TurnRate [deg/s], RATE.Y [deg/s], IMU.GyrZ [rad/s], GPS.Spd [m/s], POS and GPS positions, RCOU
pulses [us] through the servo's parameters in PARM, STER.SteerOut as a share of 4500, RPM [1/min], WIND off the bow.
Times are TimeUS since boot; GPS week and time of week give the date. Source: ArduPilot, Rover/Log.cpp,
libraries/AP_Logger/LogStructure.h, libraries/AP_GPS and AP_RPM/LogStructure.h, libraries/AP_WindVane/AP_WindVane.cpp.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from autopilot.errors import InputError
from autopilot.links.steering_pwm import FULL
from autopilot.loop.logs.dataflash import DataFlash
from autopilot.loop.logs.series import (
    HEADING,
    LATITUDE,
    LONGITUDE,
    PROPELLER,
    RATE,
    SHARE,
    SPEED,
    WIND_DIRECTION,
    WIND_SPEED,
    FloatArray,
    Recording,
    Series,
    on_one_clock,
    series_of,
)
from autopilot.loop.logs.servo import Servo, ServoScale, steering_servo

DEG = math.pi / 180.0
FIRST = 0.0
FIX_2D = 2
MEANINGS = (
    (HEADING, "ATT", "Yaw", DEG),
    (RATE, "STER", "TurnRate", DEG),
    (RATE, "RATE", "Y", DEG),
    (RATE, "IMU", "GyrZ", 1.0),
    (SPEED, "GPS", "Spd", 1.0),
    (SPEED, "THR", "Speed", 1.0),
    (LATITUDE, "POS", "Lat", DEG),
    (LONGITUDE, "POS", "Lng", DEG),
    (LATITUDE, "GPS", "Lat", DEG),
    (LONGITUDE, "GPS", "Lng", DEG),
    (PROPELLER, "RPM", "rpm1", 1.0 / 60.0),
    (PROPELLER, "RPM", "RPM", 1.0 / 60.0),
    (WIND_SPEED, "WIND", "SpdApp", 1.0),
    (WIND_DIRECTION, "WIND", "DrApp", DEG),
)
"""Quantity, message, field, factor; those of a quantity in order of preference."""
WANTED = (*{message for _, message, _, _ in MEANINGS}, "PARM", "RCOU")
GPS_EPOCH_S = 315_964_800.0
GPS_AHEAD_S = 18.0
"""GPS time is ahead of UTC by the leap seconds since 1980: 18 since 2017 (IERS Bulletin C)."""
WEEK_S = 604_800.0


def read_dataflash(path: str, data: bytes, servo: Servo | ServoScale | None = None) -> Recording:
    """Return the recording in a .BIN. servo: the steering servo, instead of what PARM says. Raises InputError."""
    log = DataFlash(path, data, WANTED)
    with np.errstate(all="ignore"):  # a damaged number may be anything; what is not finite is left out
        return _recording(path, log, servo)


def _recording(path: str, log: DataFlash, servo: Servo | ServoScale | None) -> Recording:
    series = [found for meaning in MEANINGS for found in _series(log, *meaning)]
    if not any(s.quantity in (HEADING, RATE) for s in series):
        raise InputError(
            f"{path}: holds no ATT, so no heading; set LOG_BITMASK so that attitude is logged, and LOG_DISARMED 1 "
            "where the boat is not armed."
        )
    notes = _damage(path, log)
    steering = _steering(path, log, servo, notes)
    return on_one_clock(Recording(path, "ArduPilot DataFlash log", (*series, *steering), _began(log), tuple(notes)))


def _series(log: DataFlash, quantity: str, message: str, field: str, factor: float) -> tuple[Series, ...]:
    values, time = log.column(message, field), _time(log, message)
    if values is None or time is None:
        return ()
    keep = _first_instance(log, message)
    if message == "GPS":
        fix = log.column(message, "Status")
        keep = keep if fix is None else keep & (fix >= FIX_2D)
    return series_of(quantity, f"{message}.{field}", time[keep], values[keep] * factor)


def _time(log: DataFlash, message: str) -> FloatArray | None:
    micros, millis = log.column(message, "TimeUS"), log.column(message, "TimeMS")
    if micros is not None:
        return micros * 1.0e-6
    return None if millis is None else millis * 1.0e-3


def _first_instance(log: DataFlash, message: str) -> NDArray[np.bool_]:
    """Return which messages are those of the first instrument of several."""
    instance = log.column(message, "I", "Instance", "C")
    time = _time(log, message)
    assert time is not None
    return np.ones(time.size, dtype=bool) if instance is None else instance == FIRST


def _steering(path: str, log: DataFlash, servo: Servo | ServoScale | None, notes: list[str]) -> tuple[Series, ...]:
    names, values = log.texts("PARM", "Name"), log.column("PARM", "Value")
    # a damaged FMT may have left one of the two without its field
    parameters = dict(zip(names, values.tolist(), strict=True)) if names and values is not None else {}
    known = steering_servo(path, parameters, servo)
    if known is not None:
        pulses, time = log.column("RCOU", f"C{known.number}", f"Ch{known.number}"), _time(log, "RCOU")
        if pulses is not None and time is not None:
            return series_of(SHARE, f"RCOU servo {known.number}", time, known.share(pulses))
    elif "RCOU" in log:
        notes.append(
            f"{path}: no PARM says which servo steers (SERVOn_FUNCTION 26); the firmware's steering output is taken "
            "instead where it is logged (STER), or say it with --servo NUMBER:MIN:TRIM:MAX."
        )
    return _series(log, SHARE, "STER", "SteerOut", 1.0 / FULL)


def _began(log: DataFlash) -> float | None:
    """Return the Unix time of the boot by the first fix that knows the week, None where there is none."""
    week, of_week, time = log.column("GPS", "GWk", "Week"), log.column("GPS", "GMS", "TimeMS"), _time(log, "GPS")
    fix = log.column("GPS", "Status")
    if week is None or of_week is None or time is None or fix is None:
        return None
    known = np.flatnonzero((week > 0.0) & (fix > FIX_2D))
    if known.size == 0:
        return None
    at = known[0]
    return float(GPS_EPOCH_S + week[at] * WEEK_S + of_week[at] * 1.0e-3 - GPS_AHEAD_S - time[at])


def _damage(path: str, log: DataFlash) -> list[str]:
    notes = []
    if log.skipped:
        notes.append(f"{path}: {log.skipped} bytes are damaged and left out; the rest of the log is used.")
    if log.torn:
        notes.append(f"{path}: the last {log.torn} bytes are a torn message and left out.")
    return notes
