"""What the pilot knows as NMEA 0183 sentences, each at its rate, for plotters and displays. Pure.

HDT true heading; HDG magnetic heading with the variation, where one is known; ROT yaw rate; RSA measured rudder;
HTD heading control data; XDR rudder order and bias, and heel where something measures it. A value nobody has measured
for `FRESH_S` is not sent, or sent with status V.

Source: IEC 61162-1 field layouts as tabulated in E. S. Raymond, "NMEA Revealed", https://gpsd.gitlab.io/gpsd/NMEA.html.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from autopilot.angles import compass_deg, shortest_turn
from autopilot.links.nmea.sentences import encode_hdg, encode_hdt, encode_rot, encode_rsa, format_sentence
from autopilot.links.north import Variation, known_as, steered
from autopilot.signals import Mode, OrderKind, RollSample, RudderSample, Tick

TALKER = "AG"
"""General autopilot; the reader drops it, so that our own words never come back as a compass."""
FRESH_S = 2.0
OFF_HEADING = math.radians(10.0)
Sentences = Callable[[Tick], list[bytes]]


class NmeaRepeater:
    """Gives the sentences whose turn has come. `sends`: (type, rate [Hz]); variation [rad]: None where unknown.

    talker: the two letters that begin each sentence.  magnetic: whether the headings of the ticks are.
    """

    def __init__(
        self,
        sends: tuple[tuple[str, float], ...],
        variation: Variation | float | None = None,
        talker: str = TALKER,
        magnetic: bool = False,
    ) -> None:
        self._magnetic = magnetic
        self._talker = talker
        self._period = {name: 1.0 / rate for name, rate in sends}
        self._due = dict.fromkeys(self._period, -math.inf)
        self._variation = known_as(variation)
        self._rudder: RudderSample | None = None
        self._roll: RollSample | None = None
        self._make: dict[str, Sentences] = {
            "HDT": self._hdt,
            "HDG": self._hdg,
            "ROT": lambda tick: [encode_rot(tick.state.rate, True, talker)],
            "RSA": self._rsa,
            "HTD": lambda tick: [heading_control(tick, talker, magnetic)],
            "XDR": self._xdr,
        }

    def due(self, tick: Tick) -> list[bytes]:
        """Return the sentences that fall due with `tick`; none while no heading is fresh."""
        for sample in tick.samples:
            if isinstance(sample, RudderSample) and not sample.ordered:
                self._rudder = sample
            elif isinstance(sample, RollSample):
                self._roll = sample
        sentences: list[bytes] = []
        for name, due in self._due.items():
            if tick.now < due:
                continue
            following = due + self._period[name]
            self._due[name] = following if following > tick.now else tick.now + self._period[name]
            if tick.state.valid and tick.state.heading_age <= FRESH_S:
                sentences += self._make[name](tick)
        return sentences

    def _hdt(self, tick: Tick) -> list[bytes]:
        true = self._heading(tick, is_magnetic=False)
        return [] if true is None else [encode_hdt(true, self._talker)]

    def _hdg(self, tick: Tick) -> list[bytes]:
        magnetic = self._heading(tick, is_magnetic=True)
        return [] if magnetic is None else [encode_hdg(magnetic, 0.0, self._variation.value, self._talker)]

    def _heading(self, tick: Tick, *, is_magnetic: bool) -> float | None:
        heading = tick.state.heading
        return steered(heading, is_magnetic=self._magnetic, by_compass=is_magnetic, variation=self._variation.value)

    def _rsa(self, tick: Tick) -> list[bytes]:
        rudder = self._rudder
        is_fresh = rudder is not None and tick.now - rudder.time <= FRESH_S
        return [encode_rsa(rudder.angle if rudder is not None else 0.0, is_fresh, talker=self._talker)]

    def _xdr(self, tick: Tick) -> list[bytes]:
        fields = [*_angle(tick.command.angle, "RUDDER_ORDER"), *_angle(tick.state.bias, "RUDDER_BIAS")]
        if self._roll is not None and tick.now - self._roll.time <= FRESH_S:
            fields += _angle(self._roll.roll, "ROLL")
        return [format_sentence(self._talker, "XDR", fields)]


def heading_control(tick: Tick, talker: str = TALKER, magnetic: bool = False) -> bytes:
    """Return HTD: what is steered, how, and whether the boat is on it. Standby says manual steering."""
    engaged = tick.mode is Mode.ENGAGED
    heads = engaged and tick.order.kind is OrderKind.HEADING
    steering = ("H" if heads else "R") if engaged else "M"
    rudder = tick.command.angle
    off = abs(shortest_turn(tick.reference.heading, tick.state.heading)) > OFF_HEADING
    fields = [
        "V",
        f"{abs(math.degrees(rudder)):.1f}" if engaged else "",
        ("R" if rudder >= 0.0 else "L") if engaged else "",
        steering,
        "N",
        *("", "", "", ""),
        _compass(tick.order.heading) if heads and math.isfinite(tick.order.heading) else "",
        *("", ""),
        "M" if magnetic else "T",
        "A" if engaged else "V",
        "V" if heads and off else "A",
        "V",
        _compass(tick.state.heading),
    ]
    return format_sentence(talker, "HTD", fields)


def _angle(angle: float, name: str) -> tuple[str, str, str, str]:
    return ("A", f"{math.degrees(angle) + 0.0:.1f}", "D", name)


def _compass(heading: float) -> str:
    return f"{round(compass_deg(heading), 1) % 360.0:05.1f}"
