"""What a chart plotter's sentences mean: APB, RMB, XTE, HTC, HTD to legs and headings to steer. Pure.

    APB: track, cross-track error and waypoint in one sentence: a leg.
    RMB: cross-track error, range R and bearing b to the waypoint: track = b + asin(y/R), a leg too, without APB.
    XTE: a newer error for the leg that APB told.        HTC, HTD: a heading to steer, or a track.

Where APB speaks, RMB, HTC and HTD are not used: two sentences of one plotter switch waypoints at different moments.
Status V and a mode other than A or D (autonomous, differential) say that the plotter does not lead: simulated and
dead-reckoned tracks steer no boat.

Source: IEC 61162-1 sentence layouts as tabulated in E. S. Raymond, "NMEA Revealed",
https://gpsd.gitlab.io/gpsd/NMEA.html.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from autopilot.angles import wrap
from autopilot.guidance.plotter import TIMEOUT_S, PlotterHeading, PlotterInvalid, PlotterLeg, PlotterMessage
from autopilot.links.nmea_fields import NoDataError, angle, field, letter, number
from autopilot.links.north import steered

NAUTICAL_MILE = 1852.0
CROSS_TRACK_MOST_NM = 100.0
RANGE_MOST_NM = 999.9
LEADING_MODES = ("", "A", "D")
"""Before NMEA 2.3 there was no mode field: empty counts as autonomous."""
ARRIVED_WITHIN = 1.0
"""Nearer to the waypoint than this many times the error, RMB's geometry says nothing of the track."""

Variation = Callable[[], float | None]


class NeedsVariationError(Exception):
    """A bearing from the north that is not steered by, and no variation is known."""


class PlotterReader:
    """Turns a plotter's sentences into messages; ValueError, NoDataError and NeedsVariationError go to the caller."""

    def __init__(self, variation: Variation, magnetic: bool = False) -> None:
        """magnetic: whether the boat steers magnetic courses."""
        self._variation, self._magnetic = variation, magnetic
        self._leg: PlotterLeg | None = None
        self.readers: dict[str, Callable[[float, tuple[str, ...]], PlotterMessage | None]] = {
            "APB": self._apb,
            "RMB": self._rmb,
            "XTE": self._xte,
            "HTC": self._htc,
            "HTD": self._htc,
        }

    def read(self, time: float, kind: str, fields: tuple[str, ...]) -> PlotterMessage | None:
        """Return the message in a sentence of `kind`; None where it adds nothing."""
        try:
            return self.readers[kind](time, fields)
        except NoDataError:
            return PlotterInvalid(time, f"{kind} holds no valid data")

    def _steered(self, bearing: float, reference: str) -> float:
        if reference not in ("T", "M"):
            raise ValueError(reference)
        found = steered(bearing, is_magnetic=reference == "M", by_compass=self._magnetic, variation=self._variation())
        if found is None:
            raise NeedsVariationError
        return found

    def _apb(self, time: float, fields: tuple[str, ...]) -> PlotterMessage | None:
        _leads(fields, (0, 1), 14)
        cross_track, step = _cross_track(fields, 2)
        track = self._steered(angle(fields, 7), field(fields, 8))
        self._leg = PlotterLeg(time, track, cross_track, step, field(fields, 9))
        return self._leg

    def _xte(self, time: float, fields: tuple[str, ...]) -> PlotterMessage | None:
        _leads(fields, (0, 1), 5)
        cross_track, step = _cross_track(fields, 2)
        leg = self._leg
        if leg is None or time - leg.time > TIMEOUT_S:
            return None
        # an error that jumps belongs to a leg that APB has not told yet
        if abs(cross_track - leg.cross_track) > 3.0 * max(step, leg.step) + 0.1 * abs(leg.cross_track) + 20.0:
            return None
        # the age of the leg is that of its bearing
        return leg._replace(cross_track=cross_track, step=step)

    def _rmb(self, time: float, fields: tuple[str, ...]) -> PlotterMessage | None:
        if self._is_told_by_apb(time):
            return None
        _leads(fields, (0,), 13)
        # RMB has no field for the unit: nautical miles
        cross_track, step = _cross_track((*fields[:3], "N"), 1)
        distance = number(fields, 9, 0.0, RANGE_MOST_NM) * NAUTICAL_MILE
        bearing = self._steered(angle(fields, 10), "T")
        if distance <= ARRIVED_WITHIN * abs(cross_track) or distance <= step:
            return None
        track = wrap(bearing + math.asin(cross_track / distance))
        return PlotterLeg(time, track, cross_track, step, field(fields, 4))

    def _is_told_by_apb(self, time: float) -> bool:
        return self._leg is not None and time - self._leg.time <= TIMEOUT_S

    def _htc(self, time: float, fields: tuple[str, ...]) -> PlotterMessage | None:
        if self._is_told_by_apb(time):
            return None
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
    if side not in ("L", "R"):
        raise ValueError(side)
    decimals = len(field(fields, index).partition(".")[2])
    return (size if side == "L" else -size) * scale, 10.0**-decimals * scale
