"""NMEA 0183 sentences: bytes to checked sentences and back. Pure; what the fields mean is in `samples`.

    $ttsss,field,field,...*hh<CR><LF>      tt talker, sss type, hh exclusive or of all between $ and *

Values to sentences, instruments (for the simulator) and the rudder order, SI and radians in; and the fields of
sentences, read strictly.

Source: framing and field layouts of IEC 61162-1 as described in E. S. Raymond, "NMEA Revealed",
https://gpsd.gitlab.io/gpsd/NMEA.html.
"""

from __future__ import annotations

import math
import re
from typing import NamedTuple

from autopilot.angles import compass_text

LENGTH_MAX = 102
"""The standard says 82 characters with `$` and line end; some instruments are longer, none should be by this."""
START = (0x24, 0x21)
"""`$`, and `!` of encapsulated sentences (AIS), which are counted as ignored."""
LINE_END = (0x0D, 0x0A)
_BEGIN = re.compile(rb"[$!]")
_END = re.compile(rb"[^\x20\x22\x23\x25-\x7e]")
"""What ends the printable run of a sentence: its line end, another beginning, or a byte that cannot be."""


class Sentence(NamedTuple):
    """A sentence whose checksum was right: `GP`, `RMC`, and the fields between the commas."""

    talker: str
    type: str
    fields: tuple[str, ...]
    start: int
    """Bytes of the stream before this sentence's `$`: from it the time of arrival is reckoned."""


class Counts(NamedTuple):
    """What a line has brought: sentences with a right checksum, and what was dropped and why."""

    sentences: int = 0
    checksum_errors: int = 0
    malformed: int = 0
    ignored: int = 0


class NmeaFramer:
    """Cuts a byte stream, split anywhere, into sentences. Memory: at most one unfinished sentence.

    A sentence needs its checksum: a compass that sends none cannot be distinguished from noise and must not steer.
    Proprietary (`$P...`) and encapsulated (`!...`) sentences are counted as ignored.
    """

    def __init__(self) -> None:
        self._line = bytearray()
        self._inside = False
        self._taken = 0
        self._sentences = 0
        self._checksum_errors = 0
        self._malformed = 0
        self._ignored = 0

    @property
    def counts(self) -> Counts:
        """What has come so far."""
        return Counts(self._sentences, self._checksum_errors, self._malformed, self._ignored)

    @property
    def taken(self) -> int:
        """Bytes taken since the beginning."""
        return self._taken

    def reset(self) -> None:
        """Forget an unfinished sentence."""
        self._line.clear()
        self._inside = False

    def feed(self, data: bytes) -> list[Sentence]:
        """Return the sentences completed by `data`; never raises."""
        found: list[Sentence] = []
        place = 0
        while place < len(data):
            if not self._inside:
                start = _BEGIN.search(data, place)
                if start is None:
                    break
                place = start.start()
                self._begin(place)
                self._line.append(data[place])
                place += 1
            place = self._continue(data, place, found)
        self._taken += len(data)
        return found

    def _begin(self, place: int) -> None:
        self._line.clear()
        self._inside = True
        self._start = self._taken + place

    def _continue(self, data: bytes, place: int, found: list[Sentence]) -> int:
        """Take what belongs to the sentence begun, from `place` on; return where to go on."""
        stop = _END.search(data, place)
        end = len(data) if stop is None else stop.start()
        if end - place > LENGTH_MAX - len(self._line):
            self._inside = False
            self._malformed += 1
            return end
        self._line += data[place:end]
        if stop is None:
            return end
        self._inside = False
        if data[end] not in LINE_END:
            # a new sentence or a byte that cannot be cuts this one off; the `$` itself begins the next
            self._malformed += 1
            return end if data[end] in START else end + 1
        sentence = self._check(bytes(self._line))
        if sentence is not None:
            found.append(sentence)
        return end + 1

    def _check(self, line: bytes) -> Sentence | None:
        body, star, given = line[1:].partition(b"*")
        if not star or len(given) != 2:
            self._malformed += 1
            return None
        if given.upper() != f"{checksum(body):02X}".encode():
            self._checksum_errors += 1
            return None
        address, *fields = body.decode("ascii").split(",")
        if line[0] != START[0] or address.startswith("P"):
            self._ignored += 1
            return None
        if len(address) != 5 or not address.isalnum() or not address.isupper():
            self._malformed += 1
            return None
        self._sentences += 1
        return Sentence(address[:2], address[2:], tuple(fields), self._start)


def checksum(body: bytes) -> int:
    """Return the exclusive or of all bytes between `$` and `*`."""
    # halves are folded on each other as whole numbers, which is several times faster than byte by byte
    total = int.from_bytes(body, "little")
    bits = 8 << len(body).bit_length()
    while bits > 8:
        bits >>= 1
        total ^= total >> bits
    return total & 0xFF


def format_sentence(talker: str, sentence_type: str, fields: list[str] | tuple[str, ...]) -> bytes:
    """Return the sentence with checksum and line end; ValueError where a field would break the framing."""
    text = ",".join([talker + sentence_type, *fields])
    if not text.isascii() or not text.isprintable() or any(mark in text for mark in "$!*"):
        raise ValueError(f"NMEA sentence {text!r}: only printable ASCII without $, ! and * can be sent")
    body = text.encode("ascii")
    return b"$%s*%02X\r\n" % (body, checksum(body))


def is_nmea(data: bytes) -> bool:
    """Return whether a datagram holds at least one sentence with a right checksum."""
    framer = NmeaFramer()
    framer.feed(data + b"\r\n")
    return framer.counts.sentences > 0 or framer.counts.ignored > 0


KNOT_M_S = 1852.0 / 3600.0
KMH_M_S = 1000.0 / 3600.0


def encode_hdt(heading: float, talker: str = "HE", decimals: int = 1) -> bytes:
    """Return HDT: true heading [rad]."""
    return format_sentence(talker, "HDT", [compass_text(heading, decimals), "T"])


def encode_hdm(heading: float, talker: str = "HC", decimals: int = 1) -> bytes:
    """Return HDM: magnetic heading [rad]."""
    return format_sentence(talker, "HDM", [compass_text(heading, decimals), "M"])


def encode_hdg(
    heading: float,
    deviation: float | None = None,
    variation: float | None = None,
    talker: str = "HC",
    decimals: int = 1,
) -> bytes:
    """Return HDG: what the compass shows [rad], its deviation and the variation [rad], east positive, or None."""
    fields = [compass_text(heading, decimals), *_east_west(deviation), *_east_west(variation)]
    return format_sentence(talker, "HDG", fields)


def encode_ths(heading: float, mode: str = "A", talker: str = "HE", decimals: int = 1) -> bytes:
    """Return THS: true heading [rad] and mode (A autonomous, E estimated, M manual, S simulator, V not valid)."""
    return format_sentence(talker, "THS", [compass_text(heading, decimals), mode])


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


def encode_mwv(angle: float, speed: float, talker: str = "WI") -> bytes:
    """Return MWV: the apparent wind's angle [rad], clockwise from the bow, and speed [m/s]."""
    return format_sentence(talker, "MWV", [compass_text(angle, 1), "R", _number(speed / KNOT_M_S, 1), "N", "A"])


def encode_vtg(
    course: float, speed: float, course_magnetic: float | None = None, mode: str = "A", talker: str = "GP"
) -> bytes:
    """Return VTG: course [rad] and speed [m/s] over the ground, mode A, D, E, M, S or N (no data)."""
    fields = [compass_text(course, 1), "T", _optional_compass(course_magnetic), "M"]
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
        compass_text(course, 1),
        f"{day:02d}{month:02d}{year % 100:02d}",
        *_east_west(variation),
        "A" if valid else "N",
    ]
    return format_sentence(talker, "RMC", fields)


def _optional_compass(angle: float | None) -> str:
    return "" if angle is None else compass_text(angle, 1)


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


SPEED_LIMIT = 200.0
NO_DATA_MODES = ("N", "V", "M", "S")
"""Mode indicators (NMEA 2.3 and later) that say: not valid, typed in by hand, simulated. Nobody measured that; an
instrument left in its simulator would steer the boat. E, dead reckoned, is accepted."""


class NoDataError(Exception):
    """The sentence says of itself that it holds no data."""


def field(fields: tuple[str, ...], index: int) -> str:
    """Return the field, empty where the sentence has none there."""
    return fields[index] if index < len(fields) else ""


def number(fields: tuple[str, ...], index: int, low: float, high: float) -> float:
    """Return the number in a field; NoDataError where it is empty, ValueError where it is none or out of range."""
    text = field(fields, index)
    if not text:
        raise NoDataError
    # float() would also take "nan", "1_0", " 1" and "1e3".
    if text.strip("0123456789.+-"):
        raise ValueError(text)
    value = float(text)
    if not low <= value <= high:
        raise ValueError(text)
    return value


def angle(fields: tuple[str, ...], index: int) -> float:
    """Return the angle [rad] in a field of 0 to 360 degrees."""
    return math.radians(number(fields, index, 0.0, 360.0))


def east_west(fields: tuple[str, ...], index: int, limit_deg: float) -> float | None:
    """Return the angle [rad] of a number and its E or W, east positive; None where the field is empty, or 0 without a
    side, as some say that they do not know."""
    if not field(fields, index):
        return None
    side, value = field(fields, index + 1), math.radians(number(fields, index, 0.0, limit_deg))
    if not side and value == 0.0:
        return None
    if side not in ("E", "W"):
        raise ValueError(side)
    return value if side == "E" else -value


def degrees_minutes(fields: tuple[str, ...], index: int, positive: str, negative: str, limit_deg: int) -> float:
    """Return the angle [rad] of a field of degrees and minutes (ddmm.mm or dddmm.mm) and its side in the next.

    ValueError where it is none, or beyond `limit_deg`.
    """
    text, side = field(fields, index), field(fields, index + 1)
    if side not in (positive, negative):
        raise ValueError(side)
    width = len(str(limit_deg))
    whole, minutes = text[:width], text[width:]
    if not whole.isdecimal() or len(whole) != width or not minutes[:2].isdecimal() or minutes.strip("0123456789."):
        raise ValueError(text)
    minute = float(minutes)
    degrees = int(whole) + minute / 60.0
    if not minute < 60.0 or degrees > limit_deg:
        raise ValueError(text)
    return math.radians(degrees if side == positive else -degrees)


def letter(fields: tuple[str, ...], index: int, expected: str) -> None:
    """Raise ValueError unless the field holds just that."""
    if field(fields, index) != expected:
        raise ValueError(field(fields, index))


def status(fields: tuple[str, ...], index: int) -> None:
    """Raise NoDataError at status V, ValueError unless it is A."""
    if field(fields, index) == "V":
        raise NoDataError
    letter(fields, index, "A")


def mode_indicator(fields: tuple[str, ...], index: int, required: bool = False) -> None:
    """Raise NoDataError at a mode that says not valid, ValueError at one that is unknown."""
    mode = field(fields, index)
    if mode in NO_DATA_MODES:
        raise NoDataError
    if (required or mode) and mode not in ("A", "D", "E", "F", "P", "R"):
        raise ValueError(mode)


def speed_of(fields: tuple[str, ...], index: int, low: float) -> float:
    """Speed [m/s] from a pair of fields: knots with N, or else km/h with K."""
    if field(fields, index):
        letter(fields, index + 1, "N")
        return number(fields, index, low, SPEED_LIMIT) * KNOT_M_S
    if field(fields, index + 2):
        letter(fields, index + 3, "K")
    return number(fields, index + 2, low, SPEED_LIMIT) * KMH_M_S
