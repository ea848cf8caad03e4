"""Parameters that are not settings: what a firmware moves by itself, what names its devices, what it calibrated.

A file that holds a whole vehicle holds these too. Written back, they would never agree (a counter has gone on),
describe another board (device ids), undo a calibration, or erase the vehicle (FORMAT_VERSION).

PX4 serves metadata that mark what it moves by itself and what is read only: `Marks`, which `vehicle_metadata` fetches.
ArduPilot marks them in the metadata of its sources, which no vehicle sends: `@ReadOnly`, `@Volatile`, `@Calibration`
and AP_PARAM_FLAG_INTERNAL_USE_ONLY in AP_Stats, AP_Baro, AP_Mission, AP_InertialSensor, AP_Compass, AP_Airspeed
(apm.pdef of Rover 4.5 and 4.6). FORMAT_VERSION is unmarked there: Rover erases every parameter at the next boot where
it is not the firmware's own. PX4 keeps calibration in CAL_ and TC_. RULES is all of that in one table.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterable, Sequence
from enum import StrEnum
from typing import NamedTuple

from autopilot.params.firmware_file import Wanted

NUMBER = re.compile(r"([0-9]+)")


class Kept(StrEnum):
    """Why a parameter is left to the firmware."""

    FORMAT = "erases the vehicle's parameters"
    STATE = "moves by itself"
    READ_ONLY = "read only"
    DEVICE = "names a device of the board"
    CALIBRATION = "calibration"


RULES: dict[str, tuple[tuple[Kept, str], ...]] = {
    "ardurover": (
        (Kept.FORMAT, r"FORMAT_VERSION|SYSID_SW_(MREV|TYPE)"),
        (Kept.STATE, r"STAT_\w+|SYS_NUM_RESETS|LOG_LASTFILE|CMD_(TOTAL|INDEX)|(MIS|FENCE|RALLY)_TOTAL"),
        (Kept.STATE, r"BARO\d?_GND_(PRESS|TEMP)|BARO_ALT_OFFSET|GND_(ABS_PRESS\d?|TEMP|ALT_OFFSET)"),
        (Kept.DEVICE, r"\w+_DEV_?ID\d?|INS\d?_(ACC|GYR)\d?_ID|COMPASS_PRIO\d_ID|GPS\d?_CAN_NODEID\d?"),
        (Kept.CALIBRATION, r"INS\d?_(ACC|GYRO?)\d?(OFFS|SCAL)_[XYZ]|INS\d?_(ACC|GYR)\d?_CALTEMP"),
        (Kept.CALIBRATION, r"INS_?\w*TCAL\d?_(TMIN|TMAX|(ACC|GYR)\d_[XYZ])"),
        (Kept.CALIBRATION, r"COMPASS\d?_?(OFS|DIA|ODI|MOT)\d?_[XYZ]|COMPASS_SCALE\d?|COMPASS_PMOT\d_[XYZ]"),
        (Kept.CALIBRATION, r"AHRS_TRIM_[XYZ]|ARSPD\d?_(OFFSET|RATIO)"),
    ),
    "px4": (
        (Kept.FORMAT, r"SYS_PARAM_VER|SYS_AUTOCONFIG"),
        (Kept.STATE, r"LND_FLIGHT_T_(HI|LO)|COM_FLIGHT_UUID|EKF2_MAGBIAS_[XYZ]|_HASH_CHECK"),
        (Kept.DEVICE, r"(CAL|TC)_\w+_ID"),
        (Kept.CALIBRATION, r"CAL_\w+|TC_\w+|SENS_BOARD_[XYZ]_OFF|SENS_DPRES_OFF"),
    ),
}
"""By firmware: the first row whose expression is the whole name counts. Norrbin's own parameters are all settings."""

_COMPILED = {
    firmware: tuple((kept, re.compile(expression)) for kept, expression in rows) for firmware, rows in RULES.items()
}


class Marks(NamedTuple):
    """What the vehicle itself says is `volatile` or `read_only`; FOO{n}_BAR there stands for FOO1_BAR and so on."""

    volatile: frozenset[str] = frozenset()
    read_only: frozenset[str] = frozenset()


NO_MARKS = Marks()


def kept_by_firmware(firmware: str, name: str, marks: Marks = NO_MARKS) -> Kept | None:
    """Return why parameter `name` is left to the firmware, None where it is a setting.

    The table goes before the mark: PX4 marks calibration as volatile, which `--with-calibration` writes all the same.
    """
    rows = _COMPILED.get(firmware, ())
    by_table = next((kept for kept, expression in rows if expression.fullmatch(name)), None)
    if by_table not in (None, Kept.CALIBRATION):
        return by_table
    if _is_among(marks.read_only, name):
        return Kept.READ_ONLY
    return Kept.STATE if by_table is None and _is_among(marks.volatile, name) else by_table


def _is_among(names: frozenset[str], name: str) -> bool:
    if not names or name in names:
        return name in names
    parts = [(part, "{n}") if part.isdigit() else (part,) for part in NUMBER.split(name)]
    return any("".join(spelling) in names for spelling in itertools.product(*parts))


class LeftOut(NamedTuple):
    """A parameter of a file that is not written, and why."""

    name: str
    why: Kept


def settings_of(
    wanted: Iterable[Wanted], firmware: str, *, calibration: bool = False, marks: Marks = NO_MARKS
) -> tuple[list[Wanted], list[LeftOut]]:
    """Return what of a file is to be written, and what is left to the firmware.

    calibration: calibration is written too; device ids never are, a board finds its own.
    """
    settings: list[Wanted] = []
    left: list[LeftOut] = []
    for each in wanted:
        kept = next(filter(None, (kept_by_firmware(firmware, name, marks) for name in each.names)), None)
        if kept is None or (calibration and kept is Kept.CALIBRATION):
            settings.append(each)
        else:
            left.append(LeftOut(each.name, kept))
    return settings, left


NAMED_MAX = 3
"""So many names of a kind are said."""


def sentence_of(left: Sequence[LeftOut]) -> str:
    """Return one line that says what was left out and why, '' where nothing was."""
    if not left:
        return ""
    parts = []
    for kept in Kept:
        names = [each.name for each in left if each.why is kept]
        if names:
            more = f" and {len(names) - NAMED_MAX} more" if len(names) > NAMED_MAX else ""
            parts.append(f"{kept} ({', '.join(names[:NAMED_MAX])}{more})")
    hint = ""
    if any(each.why is Kept.CALIBRATION for each in left):
        hint = "; --with-calibration writes calibration too"
    return f"{len(left)} left to the firmware: {', '.join(parts)}{hint}"
