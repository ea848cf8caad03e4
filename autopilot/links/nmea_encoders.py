"""Values to NMEA 0183 sentences: instruments (for the simulator) and the rudder order. SI and radians in.

Field layouts: IEC 61162-1, as tabulated in E. S. Raymond, "NMEA Revealed",
https://gpsd.gitlab.io/gpsd/NMEA.html.
"""

from __future__ import annotations

import math

from autopilot.angles import compass_deg
from autopilot.links.nmea0183 import format_sentence

KNOT_M_S = 1852.0 / 3600.0
KMH_M_S = 1000.0 / 3600.0


def encode_hdt(heading: float, talker: str = "HE", decimals: int = 1) -> bytes:
    """Return HDT: true heading [rad]."""
    return format_sentence(talker, "HDT", [_compass(heading, decimals), "T"])


def encode_hdm(heading: float, talker: str = "HC", decimals: int = 1) -> bytes:
    """Return HDM: magnetic heading [rad]."""
    return format_sentence(talker, "HDM", [_compass(heading, decimals), "M"])


def encode_hdg(
    heading: float,
    deviation: float | None = None,
    variation: float | None = None,
    talker: str = "HC",
    decimals: int = 1,
) -> bytes:
    """Return HDG: what the compass shows [rad], its deviation and the variation [rad], east positive, or None."""
    fields = [_compass(heading, decimals), *_east_west(deviation), *_east_west(variation)]
    return format_sentence(talker, "HDG", fields)


def encode_ths(heading: float, mode: str = "A", talker: str = "HE", decimals: int = 1) -> bytes:
    """Return THS: true heading [rad] and mode (A autonomous, E estimated, M manual, S simulator, V not valid)."""
    return format_sentence(talker, "THS", [_compass(heading, decimals), mode])


def encode_rot(rate: float, valid: bool = True, talker: str = "TI", decimals: int = 1) -> bytes:
    """Return ROT: yaw rate [rad/s], starboard positive, sent in degrees a minute."""
    return format_sentence(talker, "ROT", [_number(math.degrees(rate) * 60.0, decimals), _status(valid)])


def encode_rsa(
    starboard: float, valid: bool = True, port: float | None = None, talker: str = "II", decimals: int = 1
) -> bytes:
    """Return RSA: measured rudder angle [rad] of the starboard (or only) rudder, and of the port one if any."""
    fields = [_number(math.degrees(starboard), decimals), _status(valid)]
    fields += ["", "V"] if port is None else [_number(math.degrees(port), decimals), _status(valid)]
    return format_sentence(talker, "RSA", fields)


def encode_ror(rudder: float, engaged: bool, talker: str = "AG", decimals: int = 2) -> bytes:
    """Return ROR: rudder order [rad], starboard positive, from the bridge; status V gives the rudder back."""
    return format_sentence(talker, "ROR", [_number(math.degrees(rudder), decimals), _status(engaged), "", "V", "B"])


def encode_vhw(
    speed: float, heading_true: float | None = None, heading_magnetic: float | None = None, talker: str = "VW"
) -> bytes:
    """Return VHW: speed through the water [m/s], with headings [rad] where known."""
    fields = [_optional_compass(heading_true), "T", _optional_compass(heading_magnetic), "M"]
    fields += [_number(speed / KNOT_M_S, 2), "N", _number(speed / KMH_M_S, 2), "K"]
    return format_sentence(talker, "VHW", fields)


def encode_vtg(
    course: float, speed: float, course_magnetic: float | None = None, mode: str = "A", talker: str = "GP"
) -> bytes:
    """Return VTG: course [rad] and speed [m/s] over the ground, mode A, D, E, M, S or N (no data)."""
    fields = [_compass(course, 1), "T", _optional_compass(course_magnetic), "M"]
    fields += [_number(speed / KNOT_M_S, 2), "N", _number(speed / KMH_M_S, 2), "K", mode]
    return format_sentence(talker, "VTG", fields)


def encode_rmc(
    course: float,
    speed: float,
    latitude_deg: float,
    longitude_deg: float,
    seconds_of_day: float = 0.0,
    day_month_year: tuple[int, int, int] = (1, 1, 2026),
    variation: float | None = None,
    valid: bool = True,
    talker: str = "GP",
) -> bytes:
    """Return RMC: position, course [rad] and speed [m/s] over the ground, UTC, variation [rad] east positive."""
    day, month, year = day_month_year
    fields = [
        _clock(seconds_of_day),
        _status(valid),
        _degrees_minutes(abs(latitude_deg), 2),
        "N" if latitude_deg >= 0.0 else "S",
        _degrees_minutes(abs(longitude_deg), 3),
        "E" if longitude_deg >= 0.0 else "W",
        _number(speed / KNOT_M_S, 2),
        _compass(course, 1),
        f"{day:02d}{month:02d}{year % 100:02d}",
        *_east_west(variation),
        "A" if valid else "N",
    ]
    return format_sentence(talker, "RMC", fields)


def _compass(angle: float, decimals: int) -> str:
    degrees = round(compass_deg(angle), decimals)
    return f"{0.0 if degrees >= 360.0 else degrees:0{4 + decimals}.{decimals}f}"


def _optional_compass(angle: float | None) -> str:
    return "" if angle is None else _compass(angle, 1)


def _number(value: float, decimals: int) -> str:
    # Adding zero turns -0.0 into 0.0.
    return f"{round(value, decimals) + 0.0:.{decimals}f}"


def _east_west(angle: float | None) -> list[str]:
    if angle is None:
        return ["", ""]
    return [_number(abs(math.degrees(angle)), 1), "E" if angle >= 0.0 else "W"]


def _status(valid: bool) -> str:
    return "A" if valid else "V"


def _clock(seconds_of_day: float) -> str:
    hundredths = round(seconds_of_day * 100.0) % 8640000
    minutes, rest = divmod(hundredths, 6000)
    hours, minute = divmod(minutes, 60)
    return f"{hours:02d}{minute:02d}{rest // 100:02d}.{rest % 100:02d}"


def _degrees_minutes(degrees: float, width: int) -> str:
    ten_thousandths = round(degrees * 600000.0)
    whole, rest = divmod(ten_thousandths, 600000)
    return f"{whole:0{width}d}{rest // 10000:02d}.{rest % 10000:04d}"
