"""The boat's instruments and rudder drive on one NMEA 0183 line, at the pace of its baud rate.

Out: compass, rate gyro, rudder sensor, log, GPS and wind vane. In: the rudder order `$--ROR` (IEC 61162-1): starboard
rudder order in degrees with status A; status V, or no order for a while, releases the rudder.

A chart plotter stands beside the instruments: a route, and APB, RMB, XTE and HTD about the leg being sailed. It knows
the boat's position from the GPS, and switches to the next leg within `ARRIVAL_M` of the waypoint or once abeam of it.
Field layouts: IEC 61162-1 as tabulated in E. S. Raymond, "NMEA Revealed".
"""

from __future__ import annotations

import datetime
import functools
import itertools
import math
from collections.abc import Callable, Mapping

from autopilot.angles import wrap
from autopilot.errors import InputError
from autopilot.files.outside import typed_number
from autopilot.links.nmea import sentences as encode
from autopilot.links.nmea.sentences import NmeaFramer, Sentence, format_sentence
from sitl.boat import EARTH_RADIUS
from sitl.drives import BoatSide
from sitl.scenario import Scenario
from sitl.sensors import Reading
from sitl.world import Orders, World

ARRIVAL_M = 20.0
MILE = 1852.0
TALKER = "EC"
DECIMALS = 3
"""Of the cross-track error in nautical miles: 1.85 m."""


class ChartPlotter:
    """Follows the scenario's route; leg n leads from waypoint n to waypoint n + 1."""

    def __init__(self, scenario: Scenario) -> None:
        self._start = scenario.start
        # a route of one waypoint leads there from the start
        self._route = scenario.route if len(scenario.route) > 1 else ((0.0, 0.0), *scenario.route)
        self.leg = 0

    @property
    def count(self) -> int:
        """How many waypoints the route has."""
        return len(self._route)

    def waypoint(self, number: int) -> tuple[float, float]:
        """Return latitude and longitude of a waypoint [deg]."""
        north, east = self._route[number]
        parallel = EARTH_RADIUS * math.cos(math.radians(self._start.latitude_deg))
        return (
            self._start.latitude_deg + math.degrees(north / EARTH_RADIUS),
            math.remainder(self._start.longitude_deg + math.degrees(east / parallel), 360.0),
        )

    @property
    def is_over(self) -> bool:
        """Whether the last waypoint has been passed."""
        return self.leg + 1 >= len(self._route)

    def update(self, reading: Reading) -> None:
        """Take the newest position and switch legs."""
        north, east = self._position(reading)
        while not self.is_over:
            along, _, length = self._along(north, east)
            end_north, end_east = self._route[self.leg + 1]
            if along < length and math.hypot(north - end_north, east - end_east) > ARRIVAL_M:
                return
            self.leg += 1

    def sentence(self, kind: str, reading: Reading) -> bytes:
        """Return the sentence of `kind`; status V where the route is over."""
        if self.is_over:
            return format_sentence(TALKER, kind, ["V"] * (2 if kind != "HTD" else 1))
        fields = {"APB": self._apb, "RMB": self._rmb, "XTE": self._xte, "HTD": self._htd}[kind](reading)
        return format_sentence(TALKER, kind, fields)

    def _position(self, reading: Reading) -> tuple[float, float]:
        north = math.radians(reading.latitude - self._start.latitude_deg) * EARTH_RADIUS
        parallel = EARTH_RADIUS * math.cos(math.radians(self._start.latitude_deg))
        return north, wrap(math.radians(reading.longitude - self._start.longitude_deg)) * parallel

    def _along(self, north: float, east: float) -> tuple[float, float, float]:
        """Distance along the leg, to starboard of it, and its length [m]."""
        (from_north, from_east), (to_north, to_east) = self._route[self.leg], self._route[self.leg + 1]
        d_north, d_east = to_north - from_north, to_east - from_east
        length = math.hypot(d_north, d_east)
        a, b = north - from_north, east - from_east
        return (a * d_north + b * d_east) / length, (b * d_north - a * d_east) / length, length

    def bearings(self, reading: Reading) -> tuple[float, float, float, float]:
        """Bearing of the leg and of the waypoint [deg], its distance and the error to starboard [m]."""
        north, east = self._position(reading)
        (from_north, from_east), (to_north, to_east) = self._route[self.leg], self._route[self.leg + 1]
        track = math.degrees(math.atan2(to_east - from_east, to_north - from_north)) % 360.0
        bearing = math.degrees(math.atan2(to_east - east, to_north - north)) % 360.0
        return track, bearing, math.hypot(to_north - north, to_east - east), self._along(north, east)[1]

    def _error(self, starboard: float) -> list[str]:
        return [f"{abs(starboard) / MILE:.{DECIMALS}f}", "L" if starboard > 0.0 else "R"]

    def _apb(self, reading: Reading) -> list[str]:
        track, bearing, _, error = self.bearings(reading)
        to = f"WP{self.leg + 1}"
        ahead = [f"{bearing:.1f}", "T"]
        return ["A", "A", *self._error(error), "N", "V", "V", f"{track:.1f}", "T", to, *ahead, *ahead, "A"]

    def _xte(self, reading: Reading) -> list[str]:
        return ["A", "A", *self._error(self.bearings(reading)[3]), "N", "A"]

    def _rmb(self, reading: Reading) -> list[str]:
        _, bearing, distance, error = self.bearings(reading)
        names = [f"WP{self.leg}", f"WP{self.leg + 1}"]
        place = [*names, "", "", "", "", f"{distance / MILE:.3f}", f"{bearing:.1f}", ""]
        return ["A", *self._error(error), *place, "V", "A"]

    def _htd(self, reading: Reading) -> list[str]:
        bearing = self.bearings(reading)[1]
        return ["V", "", "", "H", "N", "", "", "", "", f"{bearing:.1f}", "", "", "T", "A", "A", "A", ""]


SENTENCES: Mapping[str, tuple[float, int]] = {
    "HDG": (10.0, 26),
    "HDM": (10.0, 19),
    "HDT": (10.0, 19),
    "THS": (10.0, 19),
    "ROT": (10.0, 20),
    "RSA": (5.0, 22),
    "VHW": (1.0, 46),
    "VTG": (1.0, 48),
    "RMC": (1.0, 76),
    "MWV": (2.0, 27),
    "APB": (1.0, 66),
    "RMB": (1.0, 60),
    "XTE": (1.0, 26),
    "HTD": (1.0, 48),
}
"""Sentences that can be chosen: how often [Hz] each leaves unless its rate is given, and its bytes with the line end,
for sharing out a slow line."""
PLOTTER = ("APB", "RMB", "XTE", "HTD")
"""What a chart plotter says; it needs a route in the scenario."""

FULLEST_LINE = 0.8
"""Default rates are lowered until the line is this full at most: a full line makes every heading late."""

BACKLOG_MAX_S = 0.5
"""With more than this still to be sent, an instrument skips its turn."""


def chosen_rates(text: str, baud: int) -> dict[str, float]:
    """Return the rate [Hz] of each sentence in a list such as `HDG,ROT:5`; InputError for what is not known.

    Rates that are written are kept; the others are the defaults, lowered together where the line is too slow.
    """
    fixed: dict[str, float] = {}
    free: dict[str, float] = {}
    for item in text.split(","):
        name, colon, rate = item.strip().partition(":")
        if name not in SENTENCES or name in fixed or name in free:
            raise InputError(f"--sentences: {name!r} is unknown or named twice, allowed are {', '.join(SENTENCES)}.")
        if colon:
            fixed[name] = _rate(name, rate)
        else:
            free[name] = SENTENCES[name][0]
    room = FULLEST_LINE * baud / 10.0 - sum(SENTENCES[name][1] * rate for name, rate in fixed.items())
    wanted = sum(SENTENCES[name][1] * rate for name, rate in free.items())
    share = min(1.0, max(room, 0.05 * baud / 10.0) / wanted) if wanted else 1.0
    return fixed | {name: rate * share for name, rate in free.items()}


def _rate(name: str, text: str) -> float:
    try:
        rate = typed_number(text)
    except ValueError:
        rate = math.nan
    if not 0.01 <= rate <= 100.0:
        raise InputError(f"--sentences: the rate {text!r} of {name} is not a number from 0.01 to 100 (Hz).")
    return rate


class RudderDrive:
    """The rudder drive that listens on the line: a helm that goes before the flight controller."""

    def __init__(self, world: World) -> None:
        self._world = world
        self._section = world.scenario.drive
        self._order: float | None = None
        self._order_time = -math.inf
        self._held: float | None = None
        self.accepted = 0
        self.refused = 0
        world.helms.insert(0, self)

    def take(self, sentence: Sentence, time: float) -> None:
        """Take a rudder order; anything else on the line is not for the drive."""
        if sentence.type != "ROR":
            return
        order = _rudder_order(sentence)
        if order is None:
            self.refused += 1
            return
        self.accepted += 1
        angle, is_valid = order
        self.order(angle if is_valid else None, time)

    def order(self, angle: float | None, time: float) -> None:
        """Take an angle [rad], or None for a release, ordered at `time` [s]."""
        self._order_time = time
        if angle is None:
            self._release()
        else:
            self._order = angle

    def orders(self, time: float) -> Orders:
        """Return the order in force; without one the rudder goes amidships or stays, as the scenario says."""
        if self._order is not None and time - self._order_time > self._section.silence_s:
            self._release()
        return Orders(rudder=self._held if self._order is None else self._order)

    def _release(self) -> None:
        if self._order is not None and self._section.released == "hold":
            self._held = self._world.boat.state.rudder
        self._order = None


def _rudder_order(sentence: Sentence) -> tuple[float, bool] | None:
    """Starboard rudder order [rad] and whether its status is A; None where the sentence cannot be used."""
    if len(sentence.fields) < 2 or sentence.fields[1] not in ("A", "V"):
        return None
    if sentence.fields[1] == "V":
        return 0.0, False
    try:
        degrees = float(sentence.fields[0])
    except ValueError:
        return None
    return (math.radians(degrees), True) if -90.0 <= degrees <= 90.0 else None


class NmeaInstruments(BoatSide):
    """The instruments of one line with the drive on it."""

    def __init__(self, world: World, rates_hz: Mapping[str, float], baud: int = 4800, is_stream: bool = True) -> None:
        super().__init__(world, baud)
        self.drive = RudderDrive(world)
        self.framer = NmeaFramer()
        self.skipped = 0
        self._is_stream = is_stream
        self._unfinished = b""
        self._period = {name: 1.0 / rate for name, rate in rates_hz.items()}
        # instruments are not switched on in the same instant: spread their first sentences
        self._due = {name: world.time + index * 0.03 for index, name in enumerate(self._period)}
        self._compose: dict[str, Callable[[Reading], bytes]] = {
            "HDG": self._hdg,
            "HDM": lambda reading: encode.encode_hdm(reading.heading - world.sensors.variation),
            "HDT": lambda reading: encode.encode_hdt(reading.heading),
            "THS": self._ths,
            "ROT": lambda reading: encode.encode_rot(reading.rate),
            "RSA": lambda reading: encode.encode_rsa(reading.rudder),
            "VHW": lambda reading: encode.encode_vhw(reading.water_speed, reading.heading),
            "VTG": lambda reading: encode.encode_vtg(reading.course, reading.ground_speed),
            "RMC": self._rmc,
            "MWV": lambda reading: encode.encode_mwv(reading.wind_angle, reading.wind_speed),
        }
        self._plotter = ChartPlotter(world.scenario)
        for name in PLOTTER:
            self._compose[name] = functools.partial(self._plotter.sentence, name)

    def transmit(self, now: float) -> list[bytes]:
        """Return the bytes that have passed the line by `now` [s]: one chunk, cut anywhere, or none.

        Where the line is no stream each sentence is a chunk of its own, as in the datagrams of a multiplexer.
        """
        passed = super().transmit(now)
        if self._is_stream:
            return passed
        *whole, self._unfinished = (self._unfinished + b"".join(passed)).split(b"\n")
        return [sentence + b"\n" for sentence in whole]

    def _after_step(self, time: float) -> None:
        for sentence in self.framer.feed(self._to_drive.take(time)):
            self.drive.take(sentence, time)
        for name, due in self._due.items():
            if due <= time + 1.0e-9:
                following = due + self._period[name]
                self._due[name] = following if following > time else time + self._period[name]
                self._send(name, time)

    def _send(self, name: str, time: float) -> None:
        sensors = self.world.sensors
        reading = sensors.second(time)
        if reading is None or sensors.is_silent(time):
            return
        if name in PLOTTER:
            self._plotter.update(reading)
        if name in ("HDG", "HDM", "HDT") and not sensors.has_heading(time, "second"):
            return
        if self.world.faults.silences(name, time):
            return
        if self._to_host.backlog(time) > BACKLOG_MAX_S:
            self.skipped += 1
            return
        self._to_host.put(time, self._compose[name](reading))

    def _hdg(self, reading: Reading) -> bytes:
        shown, variation = compass_of(self.world, reading)
        return encode.encode_hdg(shown, variation=variation)

    def _ths(self, reading: Reading) -> bytes:
        has_heading = self.world.sensors.has_heading(self.world.time, "second")
        return encode.encode_ths(reading.heading, mode="A" if has_heading else "V")

    def _rmc(self, reading: Reading) -> bytes:
        seconds = self.world.scenario.start.unix_time_s + reading.time
        moment = datetime.datetime.fromtimestamp(seconds, tz=datetime.UTC)
        midnight = moment.replace(hour=0, minute=0, second=0, microsecond=0)
        return encode.encode_rmc(
            reading.course,
            reading.ground_speed,
            reading.latitude,
            reading.longitude,
            seconds_of_day=(moment - midnight).total_seconds(),
            day_month_year=(moment.day, moment.month, moment.year),
            variation=self.world.sensors.variation,
        )


def compass_of(world: World, reading: Reading) -> tuple[float, float | None]:
    """Return what the compass shows, and the variation [rad] that it sends, None where it sends none: heading less
    variation and deviation; the deviation card is on board, not sent."""
    variation = world.sensors.variation
    magnetic = reading.heading - variation
    shown = magnetic - deviation_of_magnetic(world.vessel.sensors.deviation_deg, magnetic)
    return shown, variation if world.scenario.sensors.compass_sends_variation else None


def deviation_of_magnetic(table: tuple[tuple[float, float], ...], magnetic: float) -> float:
    """Return the deviation [rad] at a magnetic heading [rad], from a card of (compass heading, deviation) [deg].

    Linear round the card; the card is entered with the compass heading, which is found by iteration.
    """
    if not table:
        return 0.0
    deviation = 0.0
    for _ in range(20):
        deviation = _card(table, math.degrees(magnetic) - deviation)
    return math.radians(deviation)


def _card(table: tuple[tuple[float, float], ...], compass_deg: float) -> float:
    heading = math.degrees(wrap(math.radians(compass_deg))) % 360.0
    around = [(table[-1][0] - 360.0, table[-1][1]), *table, (table[0][0] + 360.0, table[0][1])]
    for (low, at_low), (high, at_high) in itertools.pairwise(around):
        if low <= heading <= high:
            return at_low + (at_high - at_low) * (heading - low) / (high - low) if high > low else at_low
    return table[0][1]
