"""The parameters of the simulated ArduRover boat: names, types and values as firmware 4.6 has them.

Defaults from ArduPilot's Rover/Parameters.cpp and the libraries it names, with the pulse widths of its own
simulator (Tools/autotest/default_params/rover.parm: 1000 to 2000 us). A subset: what a companion, a ground
station or this simulator looks at.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator
from enum import IntEnum
from typing import NamedTuple


class Kind(IntEnum):
    """MAV_PARAM_TYPE of a parameter."""

    INT8 = 2
    INT16 = 4
    INT32 = 6
    REAL32 = 9


_LIMITS = {Kind.INT8: (-128, 127), Kind.INT16: (-32768, 32767), Kind.INT32: (-2147483648, 2147483647)}


class Parameter(NamedTuple):
    """One parameter; a read-only one (AP_PARAM_FLAG_INTERNAL_USE_ONLY) keeps its value whoever sets it by message."""

    name: str
    kind: Kind
    value: float
    is_read_only: bool = False


def _rows(text: str, kind: Kind) -> list[Parameter]:
    words = text.split()
    return [Parameter(name, kind, float(value)) for name, value in zip(words[::2], words[1::2], strict=True)]


def _channels() -> Iterator[Parameter]:
    for channel in range(1, 17):
        trims = (1000, 1500, 2000) if channel in (1, 3) else (1100, 1500, 1900)
        for suffix, value in zip(("MIN", "TRIM", "MAX"), trims, strict=True):
            yield Parameter(f"RC{channel}_{suffix}", Kind.INT16, value)
        yield Parameter(f"RC{channel}_REVERSED", Kind.INT8, 0)
        yield Parameter(f"RC{channel}_DZ", Kind.INT16, 30 if channel in (1, 3) else 0)
        yield Parameter(f"RC{channel}_OPTION", Kind.INT16, 0)
    for channel in range(1, 17):
        trims = (1000, 1500, 2000) if channel in (1, 3) else (1100, 1500, 1900)
        for suffix, value in zip(("MIN", "TRIM", "MAX"), trims, strict=True):
            yield Parameter(f"SERVO{channel}_{suffix}", Kind.INT16, value)
        yield Parameter(f"SERVO{channel}_REVERSED", Kind.INT8, 0)
        yield Parameter(f"SERVO{channel}_FUNCTION", Kind.INT16, {1: 26, 3: 70}.get(channel, 0))


def _stream_rates() -> Iterator[Parameter]:
    streams = "RAW_SENS EXT_STAT RC_CHAN RAW_CTRL POSITION EXTRA1 EXTRA2 EXTRA3 PARAMS"
    for link in range(3):
        for stream in streams.split():
            yield Parameter(f"SR{link}_{stream}", Kind.INT16, 10 if stream == "PARAMS" else 1)


FORMAT_VERSION = 16
"""Rover's k_format_version: a board that boots with another one forgets every parameter."""
GROUND_PRESSURE = 101325.0


def _sensors() -> Iterator[Parameter]:
    """Device ids, calibration and what moves by itself, of two of each sensor, as the simulated board has them."""
    for number, middle, gyro in ((1, "", "INS_GYROFFS"), (2, "2", "INS_GYR2OFFS")):
        yield Parameter(f"INS_ACC{middle}_ID", Kind.INT32, 2753028.0 + 8 * number)
        yield Parameter(f"INS_GYR{middle}_ID", Kind.INT32, 2752772.0 + 8 * number)
        for axis, offset in zip("XYZ", (0.011, -0.007, 0.003), strict=True):
            yield Parameter(f"{gyro}_{axis}", Kind.REAL32, single(offset))
            yield Parameter(f"INS_ACC{middle}OFFS_{axis}", Kind.REAL32, single(3.0 * offset))
            yield Parameter(f"INS_ACC{middle}SCAL_{axis}", Kind.REAL32, single(1.0 + offset))
        yield Parameter(f"INS_ACC{number}_CALTEMP", Kind.REAL32, 45.0)
        yield Parameter(f"INS_GYR{number}_CALTEMP", Kind.REAL32, 45.0)
        yield Parameter(f"BARO{number}_GND_PRESS", Kind.REAL32, GROUND_PRESSURE, is_read_only=True)
        yield Parameter(f"BARO{number}_DEVID", Kind.INT32, 65540.0 + number, is_read_only=True)
        yield Parameter(f"COMPASS_DEV_ID{middle}", Kind.INT32, 97539.0 + number)
        for axis, offset in zip("XYZ", (5.0, 13.0, -18.0), strict=True):
            yield Parameter(f"COMPASS_OFS{middle}_{axis}", Kind.REAL32, offset)
    yield Parameter("MIS_TOTAL", Kind.INT16, 0.0, is_read_only=True)
    yield Parameter("FENCE_TOTAL", Kind.INT8, 0.0)
    yield from _rows("BARO_GND_TEMP 0 BARO_ALT_OFFSET 0", Kind.REAL32)
    yield from _rows("STAT_BOOTCNT 1", Kind.INT16)
    yield from _rows("STAT_FLTTIME 0 STAT_RUNTIME 0 STAT_RESET 1", Kind.INT32)


def default_parameters() -> list[Parameter]:
    """Return the table in the order in which it is listed."""
    return [
        Parameter("FORMAT_VERSION", Kind.INT16, FORMAT_VERSION),
        *_rows("SYSID_THISMAV 1 SYSID_MYGCS 255", Kind.INT16),
        *_rows("TELEM_DELAY 0 INITIAL_MODE 0 MODE_CH 8 MODE1 0 MODE2 0 MODE3 11 MODE4 10 MODE5 2 MODE6 0", Kind.INT8),
        *_rows("LOG_BITMASK 65535", Kind.INT32),
        *_rows("FRAME_CLASS 2 FRAME_TYPE 0 PILOT_STEER_TYPE 0 STICK_MIXING 0 CRUISE_THROTTLE 50", Kind.INT8),
        *_rows("CRUISE_SPEED 4.6 TURN_RADIUS 0.9 ACRO_TURN_RATE 180 MANUAL_STR_EXPO 0 SPEED_MAX 0", Kind.REAL32),
        *_rows("LOIT_TYPE 0 LOIT_RADIUS 2 MIS_DONE_BEHAVE 0", Kind.REAL32),
        *_rows("FS_ACTION 2 FS_THR_ENABLE 1 FS_GCS_ENABLE 0 FS_CRASH_CHECK 0 FS_EKF_ACTION 1", Kind.INT8),
        *_rows("FS_TIMEOUT 1.5 FS_GCS_TIMEOUT 5 FS_EKF_THRESH 0.8", Kind.REAL32),
        *_rows("FS_THR_VALUE 910", Kind.INT16),
        *_rows("RSSI_TYPE 0", Kind.INT8),
        *_rows("MANUAL_OPTIONS 0 GUID_OPTIONS 0 RC_OPTIONS 32 RC_PROTOCOLS 1 FS_OPTIONS 0 ARMING_CHECK 1", Kind.INT32),
        *_rows("RC_OVERRIDE_TIME 3 RC_FS_TIMEOUT 0.5", Kind.REAL32),
        *_rows("RCMAP_ROLL 1 RCMAP_PITCH 2 RCMAP_THROTTLE 3 RCMAP_YAW 4", Kind.INT8),
        *_channels(),
        *_rows("SERVO_RATE 50", Kind.INT16),
        *_rows("SERVO_RC_FS_MSK 0", Kind.INT32),
        *_rows("ATC_STR_RAT_P 0.2 ATC_STR_RAT_I 0.2 ATC_STR_RAT_D 0 ATC_STR_RAT_FF 0.2", Kind.REAL32),
        *_rows("ATC_STR_RAT_IMAX 1 ATC_STR_RAT_FLTT 10 ATC_STR_RAT_FLTE 0 ATC_STR_RAT_FLTD 0", Kind.REAL32),
        *_rows("ATC_STR_ANG_P 2 ATC_STR_ACC_MAX 120 ATC_STR_RAT_MAX 120 ATC_STR_DEC_MAX 0", Kind.REAL32),
        *_rows("ATC_SPEED_P 0.2 ATC_SPEED_I 0.2 ATC_SPEED_D 0 ATC_SPEED_FF 0 ATC_SPEED_IMAX 1", Kind.REAL32),
        *_rows("ATC_ACCEL_MAX 1 ATC_DECEL_MAX 0 ATC_STOP_SPEED 0.1 ATC_TURN_MAX_G 0.6", Kind.REAL32),
        *_rows("ATC_BRAKE 1 ARMING_REQUIRE 1 ARMING_RUDDER 2", Kind.INT8),
        *_rows("MOT_PWM_TYPE 0 MOT_SAFE_DISARM 0 MOT_THR_MIN 0 MOT_THR_MAX 100 MOT_SLEWRATE 100", Kind.INT8),
        *_rows("MOT_SPD_SCA_BASE 1 MOT_STR_THR_MIX 0.5 MOT_THST_EXPO 0 MOT_VEC_ANGLEMAX 0", Kind.REAL32),
        *_rows("MOT_THST_ASYM 1", Kind.REAL32),
        *_rows("WP_SPEED 0 WP_RADIUS 3 WP_ACCEL 0 WP_JERK 0 PSC_POS_P 0.2 PSC_VEL_P 1", Kind.REAL32),
        *_rows("SCHED_LOOP_RATE 100", Kind.INT16),
        *_rows("SERIAL0_BAUD 115 SERIAL1_BAUD 57 SERIAL2_BAUD 57", Kind.INT32),
        *_rows("SERIAL0_PROTOCOL 2 SERIAL1_PROTOCOL 2 SERIAL2_PROTOCOL 2", Kind.INT8),
        *_stream_rates(),
        *_rows("BATT_MONITOR 4 AHRS_EKF_TYPE 3 EK3_ENABLE 1 COMPASS_USE 1 COMPASS_AUTODEC 1", Kind.INT8),
        *_rows("COMPASS_DEC 0 AHRS_TRIM_X 0 AHRS_TRIM_Y 0 AHRS_TRIM_Z 0", Kind.REAL32),
        *_rows("GPS1_TYPE 1 GPS_TYPE 1 BRD_SAFETY_DEFLT 0 SYSID_ENFORCE 0 WNDVN_TYPE 0 WNDVN_SPEED_TYPE 0", Kind.INT8),
        *_sensors(),
    ]


class ParameterTable:
    """Values by name and by index; the list does not change after the start."""

    def __init__(self, parameters: list[Parameter]) -> None:
        self._rows = {parameter.name: parameter for parameter in parameters}
        self._names = [parameter.name for parameter in parameters]
        self.changes = 0
        """How often a value has been set: who keeps something worked out from the values looks here."""
        if len(self._rows) != len(parameters):
            raise ValueError("a parameter is listed twice")

    def __len__(self) -> int:
        return len(self._names)

    def __getitem__(self, name: str) -> float:
        return self._rows[name].value

    def find(self, name: str) -> Parameter | None:
        """Return the parameter of that name."""
        return self._rows.get(name)

    def at(self, index: int) -> Parameter | None:
        """Return the parameter at `index`, from 0."""
        return self._rows[self._names[index]] if 0 <= index < len(self._names) else None

    def index_of(self, name: str) -> int:
        """Return the index of a parameter that exists."""
        return self._names.index(name)

    def set(self, name: str, value: float) -> Parameter | None:
        """Set a parameter and return it as it is then: integers rounded and held to their type, read-only unchanged.

        None where there is no such parameter.
        """
        parameter = self._rows.get(name)
        if parameter is None:
            return None
        if not parameter.is_read_only and math.isfinite(value):
            parameter = parameter._replace(value=_stored(parameter.kind, value))
            self._rows[name] = parameter
            self.changes += 1
        return parameter

    def erase(self) -> None:
        """Forget every value: what stands in `default_parameters` is there again."""
        self._rows = {parameter.name: parameter for parameter in default_parameters()}
        self.changes += 1

    def move(self, name: str, value: float) -> None:
        """The firmware itself gives a parameter another value; nothing is worked out from those that move so."""
        self._rows[name] = self._rows[name]._replace(value=_stored(self._rows[name].kind, value))


def _stored(kind: Kind, value: float) -> float:
    if kind is Kind.REAL32:
        return single(value)
    low, high = _LIMITS[kind]
    return float(int(min(max(value, low), high) + (0.5 if value > 0.0 else -0.5)))


def single(value: float) -> float:
    """Return `value` rounded to single precision; beyond its range, the largest single."""
    largest = 3.4028234663852886e38
    return float(struct.unpack("<f", struct.pack("<f", min(max(value, -largest), largest)))[0])
