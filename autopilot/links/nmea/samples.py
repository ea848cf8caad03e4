"""What NMEA 0183 sentences mean: instruments to samples. Pure.

HDG, HDM, HDT, THS, ROT, RSA, MWV, VWR, RMC, VTG and VHW are samples; another's ROR is remembered; APB, RMB, BWC, XTE,
HTC and HTD go to the guide that follows a chart plotter, where there is one; the rest is counted as ignored, and so is
what we send ourselves. A field that says "not valid" (status V, mode N, an empty field), "manual" or "simulator" (mode
M, S) is no data, and a value outside its range makes the sentence malformed.

    HDG: true heading = sensor + deviation + variation;  HDM: true heading = magnetic + variation

Where the boat steers magnetic courses a magnetic heading is taken as it is, and a true one less the variation.

Deviation is HDG's own, else the configured table's; variation is HDG's own, else the configured one, else that of the
first RMC or HDG that brings one and goes on to, else that of a model of the earth's field.

What a chart plotter's sentences mean: APB, RMB, BWC, XTE, HTC, HTD to legs and headings to steer. Pure.

    APB, APA: track, cross-track error y and waypoint in one sentence: a leg.
    RMB: y, range R and bearing b to the waypoint: track = b + asin(y/R), a leg too, without APB.
    BWC, BWR: range and bearing: with y from XTE a leg like RMB's, where neither APB nor RMB comes.
    XTE: a newer y for the leg that APB named.        HTC, HTD: a heading to steer, or a track.

Where APB speaks, the others are not used: two sentences of one plotter switch waypoints at different moments.
Status V and a mode without a fix say that the plotter does not lead: simulated and dead-reckoned tracks steer no boat.
Two devices on a line, by their talkers, are two plotters: one without a route does not speak for the other.

Source: IEC 61162-1 sentence layouts as tabulated in E. S. Raymond, "NMEA Revealed",
https://gpsd.gitlab.io/gpsd/NMEA.html.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise

from autopilot.angles import wrap
from autopilot.guidance.plotter import (
    NO_VARIATION,
    TIMEOUT_S,
    PlotterGuide,
    PlotterHeading,
    PlotterInvalid,
    PlotterLeg,
    PlotterMessage,
)
from autopilot.links.nmea.sentences import (
    KMH_M_S,
    KNOT_M_S,
    SPEED_LIMIT,
    NoDataError,
    Sentence,
    angle,
    degrees_minutes,
    east_west,
    field,
    letter,
    mode_indicator,
    number,
    speed_of,
    status,
)
from autopilot.links.north import NeedsVariationError, Variation, known_as, steered
from autopilot.signals import (
    AlarmEvent,
    CourseSample,
    HeadingSample,
    PositionSample,
    RateSample,
    RudderSample,
    Sample,
    SpeedSample,
    WindSample,
)

NAUTICAL_MILE = 1852.0
CROSS_TRACK_MOST_NM = 100.0
RANGE_MOST_NM = 999.9
LEADING_MODES = ("", "A", "D", "F", "P", "R")
"""Before NMEA 2.3 there was no mode field: empty counts as autonomous. F, P and R are better fixes than A and D."""
LEGS, ERRORS = ("APB", "APA"), "XTE"
PARTS = (ERRORS, "BWC", "BWR")
"""Of a leg: one alone leads nowhere."""
PLOTTER_SENTENCES = frozenset((*LEGS, ERRORS, "RMB", "BWC", "BWR", "HTC", "HTD"))
ARRIVED_WITHIN = 1.0
"""Nearer to the waypoint than this many times the error, RMB's geometry says nothing of the track."""

NOISE_M, CROSS_SPEED = 3.0, 5.0
"""An error may have changed by so much [m] since the leg's own, and by this for each second [m/s]."""
ERROR_AGE_S = 3.0


class PlotterReader:
    """Turns a plotter's sentences into messages; ValueError, NoDataError and NeedsVariationError go to the caller."""

    def __init__(self, variation: Variation, magnetic: bool = False) -> None:
        """magnetic: whether the boat steers magnetic courses."""
        self._variation, self._magnetic = variation, magnetic
        self._leg: PlotterLeg | None = None
        self._rmb_time = -math.inf
        self._error: tuple[float, float, float] | None = None
        self._heard: dict[str, float] = {}
        self._readers: dict[str, Callable[[float, tuple[str, ...]], PlotterMessage | None]] = {
            **dict.fromkeys(LEGS, self._apb),
            "RMB": self._rmb,
            **dict.fromkeys(("BWC", "BWR"), self._bwc),
            ERRORS: self._xte,
            **dict.fromkeys(("HTC", "HTD"), self._htc),
        }

    def read(self, time: float, kind: str, fields: tuple[str, ...]) -> PlotterMessage | None:
        """Return the message in a sentence of `kind`; None where it adds nothing."""
        self._heard[kind] = time
        try:
            return self._readers[kind](time, fields)
        except NoDataError:
            return PlotterInvalid(time, f"{kind} holds no valid data")

    def _steered(self, bearing: float, reference: str) -> float:
        if reference not in ("T", "M"):
            raise ValueError(reference)
        return self._variation.steered(bearing, is_magnetic=reference == "M", by_compass=self._magnetic)

    def _apb(self, time: float, fields: tuple[str, ...]) -> PlotterMessage | None:
        _leads(fields, (0, 1), 14)
        cross_track, step = _cross_track(fields, 2)
        track = self._steered(angle(fields, 7), field(fields, 8))
        name = field(fields, 9)
        self._leg = PlotterLeg(time, track, cross_track, step, name, name, field(fields, 6) == "A")
        return self._leg

    def _xte(self, time: float, fields: tuple[str, ...]) -> PlotterMessage | None:
        _leads(fields, (0, 1), 5)
        cross_track, step = _cross_track(fields, 2)
        leg, self._error = self._leg, (time, cross_track, step)
        if leg is None or time - leg.time > TIMEOUT_S:
            return None
        # an error that jumps belongs to a leg that APB has not named yet: with it the boat would turn to the wrong side
        if abs(cross_track - leg.cross_track) > step + leg.step + NOISE_M + CROSS_SPEED * (time - leg.time):
            return None
        # the age of the leg is that of its bearing
        return leg._replace(cross_track=cross_track, step=step)

    def _rmb(self, time: float, fields: tuple[str, ...]) -> PlotterMessage | None:
        _leads(fields, (0,), 13)
        # RMB has no field for the unit: nautical miles
        cross_track, step = _cross_track((*fields[:3], "N"), 1)
        distance = number(fields, 9, 0.0, RANGE_MOST_NM) * NAUTICAL_MILE
        self._rmb_time = time
        bearing = self._steered(angle(fields, 10), "T")
        is_going_away = field(fields, 11).startswith("-") and number(fields, 11, -SPEED_LIMIT, SPEED_LIMIT) < 0.0
        leg = _straight(time, bearing, distance, (cross_track, step), field(fields, 4))
        return None if leg is None else leg._replace(passed=field(fields, 12) == "A" and is_going_away)

    def _bwc(self, time: float, fields: tuple[str, ...]) -> PlotterMessage | None:
        error = self._error
        if time - self._rmb_time <= TIMEOUT_S:
            return None
        mode_indicator(fields, 12)
        if error is None or time - error[0] > ERROR_AGE_S or not field(fields, 9):
            return None
        letter(fields, 10, "N")
        distance = number(fields, 9, 0.0, RANGE_MOST_NM) * NAUTICAL_MILE
        # the true bearing, or else the magnetic one
        bearing = self._steered(angle(fields, 5), "T") if field(fields, 5) else self._steered(angle(fields, 7), "M")
        return _straight(time, bearing, distance, error[1:], field(fields, 11))

    def says_only(self, time: float, kind: str) -> bool:
        """Return whether it has sent no other kind of sentence of late."""
        return all(each == kind or time - heard > TIMEOUT_S for each, heard in self._heard.items())

    def is_led_by_apb(self, time: float) -> bool:
        """Return whether APB has named a leg of late."""
        return self._leg is not None and time - self._leg.time <= TIMEOUT_S

    def _htc(self, time: float, fields: tuple[str, ...]) -> PlotterMessage | None:
        if field(fields, 0) == "A":
            return PlotterInvalid(time, "its override is in use")
        letter(fields, 0, "V")
        mode = field(fields, 3)
        if mode in ("M", "R"):
            return PlotterInvalid(time, "its steering mode is manual or rudder control")
        if mode not in ("S", "H", "T"):
            raise ValueError(mode)
        index = 11 if mode == "T" and field(fields, 11) and not field(fields, 9) else 9
        return PlotterHeading(time, self._steered(angle(fields, index), field(fields, 12)))


def _straight(
    time: float, bearing: float, distance: float, error: tuple[float, float], waypoint: str
) -> PlotterLeg | None:
    """Return the leg by its geometry: error and its step [m]; None near the waypoint, where that says nothing."""
    cross_track, step = error
    if distance <= ARRIVED_WITHIN * abs(cross_track) or distance <= step:
        return None
    track = wrap(bearing + math.asin(cross_track / distance))
    return PlotterLeg(time, track, cross_track, step, waypoint, waypoint)


def _leads(fields: tuple[str, ...], statuses: tuple[int, ...], mode: int) -> None:
    """Raise where a status field or the mode says that the plotter does not lead."""
    for index in statuses:
        if field(fields, index) == "V":
            raise NoDataError
        letter(fields, index, "A")
    if field(fields, mode) not in LEADING_MODES:
        if field(fields, mode) in ("E", "F", "M", "N", "P", "R", "S", "V"):
            raise NoDataError
        raise ValueError(field(fields, mode))


def _cross_track(fields: tuple[str, ...], index: int) -> tuple[float, float]:
    """Cross-track error [m], positive to starboard of the track, and what its last digit is worth [m].

    The letter says which way to steer: L with the boat to starboard of the track.
    """
    scale = {"N": NAUTICAL_MILE, "K": 1000.0}.get(field(fields, index + 2))
    if scale is None:
        raise ValueError(field(fields, index + 2))
    size = number(fields, index, 0.0, CROSS_TRACK_MOST_NM)
    side = field(fields, index + 1)
    if side not in (("L", "R") if size else ("L", "R", "")):
        raise ValueError(side)
    decimals = len(field(fields, index).partition(".")[2])
    return (size if side == "L" else -size) * scale, 10.0**-decimals * scale


OWN_TALKER = "AG"
"""An autopilot's own sentences, come back through a multiplexer, must not be its compass."""
ROT_LIMIT_DEG_MIN = 10000.0
RUDDER_LIMIT_DEG = 90.0
VARIATION_LIMIT_DEG = 180.0
DEVIATION_LIMIT_DEG = 90.0


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
        variation: as all links know it, or the configured one [rad], east positive, None to take it from HDG or RMC.
        deviation: the compass's table, used where HDG carries no deviation of its own.
        guide: takes what a chart plotter says.
        magnetic: whether the boat steers magnetic courses.

    Attributes:
        line: its name, by which the guide tells a plotter from others.
        malformed: sentences with a value that cannot be.  ignored: of types not used here.
        invalid: sentences that said of themselves that they hold no data.
        waiting_for_variation: headings and bearings dropped because no variation is known.
        unusable: how many of them were headings.
        other_order: when another ordered the rudder last [s], -inf before, and its talker.
    """

    def __init__(
        self,
        variation: Variation | float | None = None,
        deviation: Deviation | None = None,
        guide: PlotterGuide | None = None,
        talker: str = OWN_TALKER,
        magnetic: bool = False,
    ) -> None:
        self._magnetic = magnetic
        self.unusable = 0
        self._ours = (OWN_TALKER, talker)
        self._name = self.line = ""
        self.malformed = 0
        self.ignored = 0
        self.invalid = 0
        self.waiting_for_variation = 0
        self.other_order: tuple[float, str] = (-math.inf, "")
        self._variation = known_as(variation)
        self._others: list[PositionSample | CourseSample] = []
        self._deviation = deviation or Deviation()
        self._guide = guide
        self._plotters: dict[str, PlotterReader] = {}
        self._mwv_time = -math.inf
        self._readers: dict[str, Callable[[float, tuple[str, ...]], Sample | None]] = {
            "HDG": self._hdg,
            "HDM": self._hdm,
            "HDT": self._hdt,
            "THS": self._ths,
            "ROT": self._rot,
            "RSA": self._rsa,
            "ROR": self._ror,
            "MWV": self._mwv,
            "VWR": self._vwr,
            "RMC": self._rmc,
            "VTG": self._vtg,
            "VHW": self._vhw,
        }

    def read(self, time: float, sentence: Sentence) -> Sample | None:
        """Return the sample in `sentence`, measured at `time` [s]; None where it holds none. Never raises."""
        reader = self._readers.get(sentence.type)
        is_plotter = reader is None and sentence.type in PLOTTER_SENTENCES and self._guide is not None
        if (reader is None and not is_plotter) or sentence.talker in self._ours:
            self.ignored += 1
            return None
        try:
            if reader is None:
                self._lead(time, sentence)
                return None
            self._name = sentence.talker + sentence.type
            sample = reader(time, sentence.fields)
        except ValueError:
            self.malformed += 1
            return None
        except NoDataError:
            self.invalid += 1
            return None
        except NeedsVariationError:
            self.waiting_for_variation += 1
            return None
        return None if sample is None else sample._replace(source=self._name)

    @property
    def alarm(self) -> AlarmEvent | None:
        """A variation that has jumped, where the boat is not steered by magnetic courses."""
        return None if self._magnetic else self._variation.alarm(self)

    def take_others(self) -> list[PositionSample | CourseSample]:
        """Return and forget the position, and the course over the ground, that came with the last sentence."""
        others, self._others = self._others, []
        return others

    def _lead(self, time: float, sentence: Sentence) -> None:
        guide, kind = self._guide, sentence.type
        is_beside_apb = any(plotter.is_led_by_apb(time) for plotter in self._plotters.values())
        if guide is None or (is_beside_apb and kind not in (*LEGS, ERRORS)):
            return
        plotter = self._plotters.get(sentence.talker)
        if plotter is None:
            plotter = self._plotters[sentence.talker] = PlotterReader(self._variation, self._magnetic)
        try:
            message = plotter.read(time, kind, sentence.fields)
        except ValueError:
            guide.unread(time, f"{kind} holds what cannot be")
            raise
        except NeedsVariationError:
            guide.unread(time, NO_VARIATION)
            raise
        if message is not None:
            self.invalid += isinstance(message, PlotterInvalid)
            guide.take(message._replace(source=f"{self.line} {sentence.talker}"))
        elif kind in PARTS and not is_beside_apb and plotter.says_only(time, kind):
            guide.unread(time, f"{kind} alone names no leg: let it send APB or RMB")

    def _hdg(self, time: float, fields: tuple[str, ...]) -> Sample | None:
        compass = angle(fields, 0)
        deviation = east_west(fields, 1, DEVIATION_LIMIT_DEG)
        variation = east_west(fields, 3, VARIATION_LIMIT_DEG)
        if variation is not None:
            variation = self._variation.receive(time, variation, self, self._name)
        magnetic = compass + (self._deviation.at(compass) if deviation is None else deviation)
        return self._from_magnetic(time, magnetic, variation)

    def _hdm(self, time: float, fields: tuple[str, ...]) -> Sample | None:
        letter(fields, 1, "M")
        return self._from_magnetic(time, angle(fields, 0), None)

    def _from_magnetic(self, time: float, magnetic: float, own_variation: float | None) -> Sample | None:
        return self._heading(time, magnetic, True, self._variation.value if own_variation is None else own_variation)

    def _heading(self, time: float, heading: float, is_magnetic: bool, variation: float | None) -> Sample | None:
        found = steered(heading, is_magnetic=is_magnetic, by_compass=self._magnetic, variation=variation)
        if found is None:
            self.waiting_for_variation += 1
            self.unusable += 1
        return None if found is None else HeadingSample(time, found)

    def _hdt(self, time: float, fields: tuple[str, ...]) -> Sample | None:
        letter(fields, 1, "T")
        return self._heading(time, angle(fields, 0), False, self._variation.value)

    def _ths(self, time: float, fields: tuple[str, ...]) -> Sample | None:
        mode_indicator(fields, 1, required=True)
        return self._heading(time, angle(fields, 0), False, self._variation.value)

    def _rot(self, time: float, fields: tuple[str, ...]) -> Sample:
        status(fields, 1)
        return RateSample(time, math.radians(number(fields, 0, -ROT_LIMIT_DEG_MIN, ROT_LIMIT_DEG_MIN)) / 60.0)

    def _rsa(self, time: float, fields: tuple[str, ...]) -> Sample:
        status(fields, 1)
        return RudderSample(time, math.radians(number(fields, 0, -RUDDER_LIMIT_DEG, RUDDER_LIMIT_DEG)))

    def _ror(self, time: float, fields: tuple[str, ...]) -> None:
        """What another autopilot orders."""
        status(fields, 1)
        number(fields, 0, -RUDDER_LIMIT_DEG, RUDDER_LIMIT_DEG)
        self.other_order = time, self._name[:2]

    def _mwv(self, time: float, fields: tuple[str, ...]) -> Sample:
        """The wind over the bow; true wind, reckoned by another instrument, is none of it."""
        status(fields, 4)
        if field(fields, 1) != "R":
            raise NoDataError
        units = {"K": KMH_M_S, "N": KNOT_M_S, "M": 1.0}
        unit = field(fields, 3)
        if unit not in units:
            raise ValueError(unit)
        wind = WindSample(time, wrap(angle(fields, 0)), number(fields, 2, 0.0, SPEED_LIMIT) * units[unit])
        self._mwv_time = time
        return wind

    def _vwr(self, time: float, fields: tuple[str, ...]) -> Sample | None:
        """The wind over the bow, as older instruments say it: to L or R of it, in knots, m/s or km/h.

        Beside MWV it is none: one vane, said in two ways that are rounded differently, never seems to stand still.
        """
        if time - self._mwv_time <= TIMEOUT_S:
            return None
        side, off = field(fields, 1), math.radians(number(fields, 0, 0.0, 180.0))
        if side not in ("L", "R"):
            raise ValueError(side)
        for place, (letter_, unit) in zip((2, 4, 6), (("N", KNOT_M_S), ("M", 1.0), ("K", KMH_M_S)), strict=True):
            if field(fields, place):
                letter(fields, place + 1, letter_)
                speed = number(fields, place, 0.0, SPEED_LIMIT) * unit
                return WindSample(time, off if side == "R" else -off, speed)
        raise NoDataError

    def _rmc(self, time: float, fields: tuple[str, ...]) -> Sample:
        status(fields, 1)
        mode_indicator(fields, 11)
        speed = number(fields, 6, 0.0, SPEED_LIMIT) * KNOT_M_S
        if field(fields, 2) and field(fields, 4):
            place = degrees_minutes(fields, 2, "N", "S", 90), degrees_minutes(fields, 4, "E", "W", 180)
            self._others.append(PositionSample(time, *place))
            self._variation.move(*place)
        self._course(time, fields, 7)
        variation = east_west(fields, 9, VARIATION_LIMIT_DEG)
        if variation is not None:
            self._variation.receive(time, variation, self, self._name)
        return SpeedSample(time, speed, True)

    def _course(self, time: float, fields: tuple[str, ...], place: int) -> None:
        """Keep the true course over the ground; a boat that stands still sends none."""
        if field(fields, place):
            self._others.append(CourseSample(time, wrap(angle(fields, place))))

    def _vtg(self, time: float, fields: tuple[str, ...]) -> Sample:
        mode_indicator(fields, 8)
        self._course(time, fields, 0)
        return SpeedSample(time, speed_of(fields, 4, 0.0), True)

    def _vhw(self, time: float, fields: tuple[str, ...]) -> Sample:
        # A paddle wheel that turns backwards is sent as a negative speed.
        return SpeedSample(time, speed_of(fields, 4, -SPEED_LIMIT), False)
