"""What NMEA 0183 sentences mean: instruments to samples. Pure.

HDG, HDM, HDT, THS, ROT, RSA, RMC, VTG and VHW; the rest is counted as ignored. A field that says "not valid"
(status V, mode N, an empty field) is no data, and a value outside its range makes the sentence malformed.

    HDG: true heading = sensor + deviation + variation;  HDM: true heading = magnetic + variation

Deviation is HDG's own, else the configured table's; variation is HDG's own, else the configured one, else the
last that RMC or HDG brought.

Source: IEC 61162-1 sentence layouts as tabulated in E. S. Raymond, "NMEA Revealed",
https://gpsd.gitlab.io/gpsd/NMEA.html.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise

from autopilot.angles import wrap
from autopilot.links.nmea0183 import Sentence
from autopilot.links.nmea_encoders import KMH_M_S, KNOT_M_S
from autopilot.signals import HeadingSample, RateSample, RudderSample, Sample, SpeedSample

ROT_LIMIT_DEG_MIN = 10000.0
RUDDER_LIMIT_DEG = 90.0
SPEED_LIMIT = 1000.0
VARIATION_LIMIT_DEG = 180.0
DEVIATION_LIMIT_DEG = 90.0
NO_DATA_MODES = ("N", "V")
"""Mode indicators (NMEA 2.3 and later) that say: not valid. E, M and S, estimated or simulated, are accepted."""


class Deviation:
    """Deviation table of a magnetic compass: (compass heading [rad], deviation [rad], east positive) pairs.

    Interpolated linearly round the card. ValueError where two entries name the same heading.
    """

    def __init__(self, table: tuple[tuple[float, float], ...] = ()) -> None:
        entries = sorted((heading % math.tau, deviation) for heading, deviation in table)
        headings = [heading for heading, _ in entries]
        if len(set(headings)) != len(headings):
            raise ValueError("the deviation table names a compass heading twice; keep one entry for each heading")
        if entries:
            first, last = entries[0], entries[-1]
            entries = [(last[0] - math.tau, last[1]), *entries, (first[0] + math.tau, first[1])]
        self._entries = entries

    def at(self, compass: float) -> float:
        """Return the deviation [rad] at `compass` heading [rad]; 0 for an empty table."""
        compass %= math.tau
        for (low, before), (high, after) in pairwise(self._entries):
            if low <= compass <= high:
                return before + (after - before) * (compass - low) / (high - low)
        return 0.0


class NmeaReader:
    """Turns sentences into samples.

    Args:
        variation [rad], east positive: configured magnetic variation, None to take it from HDG or RMC.
        deviation: the compass's table, used where HDG carries no deviation of its own.

    Attributes:
        malformed: sentences with a value that cannot be.  ignored: of types not used here.
        invalid: sentences that said of themselves that they hold no data.
        waiting_for_variation: magnetic headings dropped because no variation is known.
    """

    def __init__(self, variation: float | None = None, deviation: Deviation | None = None) -> None:
        self.malformed = 0
        self.ignored = 0
        self.invalid = 0
        self.waiting_for_variation = 0
        self._configured_variation = variation
        self._received_variation: float | None = None
        self._deviation = deviation or Deviation()
        self._readers: dict[str, Callable[[float, tuple[str, ...]], Sample | None]] = {
            "HDG": self._hdg,
            "HDM": self._hdm,
            "HDT": self._hdt,
            "THS": self._ths,
            "ROT": self._rot,
            "RSA": self._rsa,
            "RMC": self._rmc,
            "VTG": self._vtg,
            "VHW": self._vhw,
        }

    def read(self, time: float, sentence: Sentence) -> Sample | None:
        """Return the sample in `sentence`, measured at `time` [s]; None where it holds none. Never raises."""
        reader = self._readers.get(sentence.type)
        if reader is None:
            self.ignored += 1
            return None
        try:
            sample = reader(time, sentence.fields)
        except ValueError:
            self.malformed += 1
            return None
        except _NoDataError:
            self.invalid += 1
            return None
        return None if sample is None else sample._replace(source=sentence.talker + sentence.type)

    def _hdg(self, time: float, fields: tuple[str, ...]) -> Sample | None:
        compass = _angle(fields, 0)
        deviation = _east_west(fields, 1, DEVIATION_LIMIT_DEG)
        variation = _east_west(fields, 3, VARIATION_LIMIT_DEG)
        if variation is not None:
            self._received_variation = variation
        magnetic = compass + (self._deviation.at(compass) if deviation is None else deviation)
        return self._from_magnetic(time, magnetic, variation)

    def _hdm(self, time: float, fields: tuple[str, ...]) -> Sample | None:
        _letter(fields, 1, "M")
        return self._from_magnetic(time, _angle(fields, 0), None)

    def _from_magnetic(self, time: float, magnetic: float, own_variation: float | None) -> Sample | None:
        for variation in (own_variation, self._configured_variation, self._received_variation):
            if variation is not None:
                return HeadingSample(time, wrap(magnetic + variation))
        self.waiting_for_variation += 1
        return None

    def _hdt(self, time: float, fields: tuple[str, ...]) -> Sample:
        _letter(fields, 1, "T")
        return HeadingSample(time, wrap(_angle(fields, 0)))

    def _ths(self, time: float, fields: tuple[str, ...]) -> Sample:
        _mode(fields, 1, required=True)
        return HeadingSample(time, wrap(_angle(fields, 0)))

    def _rot(self, time: float, fields: tuple[str, ...]) -> Sample:
        _status(fields, 1)
        return RateSample(time, math.radians(_number(fields, 0, -ROT_LIMIT_DEG_MIN, ROT_LIMIT_DEG_MIN)) / 60.0)

    def _rsa(self, time: float, fields: tuple[str, ...]) -> Sample:
        _status(fields, 1)
        return RudderSample(time, math.radians(_number(fields, 0, -RUDDER_LIMIT_DEG, RUDDER_LIMIT_DEG)))

    def _rmc(self, time: float, fields: tuple[str, ...]) -> Sample:
        _status(fields, 1)
        _mode(fields, 11)
        speed = _number(fields, 6, 0.0, SPEED_LIMIT) * KNOT_M_S
        variation = _east_west(fields, 9, VARIATION_LIMIT_DEG)
        if variation is not None:
            self._received_variation = variation
        return SpeedSample(time, speed, True)

    def _vtg(self, time: float, fields: tuple[str, ...]) -> Sample:
        _mode(fields, 8)
        return SpeedSample(time, _speed(fields, 4, 0.0), True)

    def _vhw(self, time: float, fields: tuple[str, ...]) -> Sample:
        # A paddle wheel that turns backwards is sent as a negative speed.
        return SpeedSample(time, _speed(fields, 4, -SPEED_LIMIT), False)


class _NoDataError(Exception):
    """The sentence says of itself that it holds no data."""


def _field(fields: tuple[str, ...], index: int) -> str:
    return fields[index] if index < len(fields) else ""


def _number(fields: tuple[str, ...], index: int, low: float, high: float) -> float:
    text = _field(fields, index)
    if not text:
        raise _NoDataError
    # float() would also take "nan", "1_0", " 1" and "1e3".
    if text.strip("0123456789.+-"):
        raise ValueError(text)
    value = float(text)
    if not low <= value <= high:
        raise ValueError(text)
    return value


def _angle(fields: tuple[str, ...], index: int) -> float:
    return math.radians(_number(fields, index, 0.0, 360.0))


def _east_west(fields: tuple[str, ...], index: int, limit_deg: float) -> float | None:
    if not _field(fields, index):
        return None
    side = _field(fields, index + 1)
    if side not in ("E", "W"):
        raise ValueError(side)
    value = math.radians(_number(fields, index, 0.0, limit_deg))
    return value if side == "E" else -value


def _letter(fields: tuple[str, ...], index: int, expected: str) -> None:
    if _field(fields, index) != expected:
        raise ValueError(_field(fields, index))


def _status(fields: tuple[str, ...], index: int) -> None:
    if _field(fields, index) == "V":
        raise _NoDataError
    _letter(fields, index, "A")


def _mode(fields: tuple[str, ...], index: int, required: bool = False) -> None:
    mode = _field(fields, index)
    if mode in NO_DATA_MODES:
        raise _NoDataError
    if (required or mode) and mode not in ("A", "D", "E", "F", "M", "P", "R", "S"):
        raise ValueError(mode)


def _speed(fields: tuple[str, ...], index: int, low: float) -> float:
    """Speed [m/s] from a pair of fields: knots with N, or else km/h with K."""
    if _field(fields, index):
        _letter(fields, index + 1, "N")
        return _number(fields, index, low, SPEED_LIMIT) * KNOT_M_S
    if _field(fields, index + 2):
        _letter(fields, index + 3, "K")
    return _number(fields, index + 2, low, SPEED_LIMIT) * KMH_M_S
