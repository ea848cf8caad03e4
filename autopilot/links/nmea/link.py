"""The link to instruments and a rudder drive on NMEA 0183: samples in, the rudder order out as ROR.

A sentence is as old as its first byte: at 4800 baud a heading of 20 characters has been 42 ms on the line by the
time it ends. So the time of a sample is reckoned back from its arrival:

    time = arrival - (bytes of this batch from the sentence's `$` on) * 10 / baud - latency of the instrument

The repeater: what the pilot knows as sentences, each at its rate, for plotters and displays.

HDT true heading; HDG magnetic heading with the variation, where one is known; ROT yaw rate; RSA measured rudder;
HTD heading control data; XDR rudder order and bias, and heel where something measures it. A value nobody has measured
for `FRESH_S` is not sent, or sent with status V.

Source: IEC 61162-1 field layouts as tabulated in E. S. Raymond, "NMEA Revealed", https://gpsd.gitlab.io/gpsd/NMEA.html.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from typing import NamedTuple

from autopilot.angles import compass_text, shortest_turn
from autopilot.guidance.plotter import PlotterGuide
from autopilot.links.base import OFF_HEADING, OTHER_PILOT_S, PLOTTER, AlarmNews, HelmNews, SessionLink, Transport
from autopilot.links.nmea.samples import OWN_TALKER, Deviation, NmeaReader
from autopilot.links.nmea.sentences import (
    Counts,
    NmeaFramer,
    encode_hdg,
    encode_hdt,
    encode_ror,
    encode_rot,
    encode_rsa,
    format_sentence,
)
from autopilot.links.north import UnusableHeadings, Variation, known_as, steered
from autopilot.links.rudder_order import (
    ORDER_AGE_S,
    RELEASE_SPACING_S,
    RELEASES,
    FollowSettings,
    Release,
    RudderFollow,
    UnshownRelease,
)
from autopilot.signals import HeadingSample, Mode, OrderKind, RollSample, RudderCommand, RudderSample, Sample, Tick

TALKER = "AG"
"""General autopilot; the reader drops it, so that our own words never come back as a compass."""
FRESH_S = 2.0
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
        compass_text(tick.order.heading, 1) if heads and math.isfinite(tick.order.heading) else "",
        *("", ""),
        "M" if magnetic else "T",
        "A" if engaged else "V",
        "V" if heads and off else "A",
        "V",
        compass_text(tick.state.heading, 1),
    ]
    return format_sentence(talker, "HTD", fields)


def _angle(angle: float, name: str) -> tuple[str, str, str, str]:
    return ("A", f"{math.degrees(angle) + 0.0:.1f}", "D", name)


BITS_PER_BYTE = 10
"""Start bit, eight data bits, stop bit."""
REPEAT_S = 0.5
"""A drive releases the rudder when no order has come for 2 s or so: the last one is repeated at least this often."""
REPEATED_WAITING = 12
"""Repeated sentences that wait for a slow line; of more, the oldest go unsent."""
ORDERS_IN_ROW = 3
"""On a line that cannot carry all, a repeated sentence leaves after so many orders."""
LAPSE = "no NMEA 0183 sentence confirms it; the drive lets go by itself when no more orders come"


class NmeaSettings(NamedTuple):
    """How to read and steer an NMEA boat.

    baud: of the line, 0 where there is none (UDP).  heading_latency [s]: age of a heading when its sentence
    begins.  variation [rad], east positive, None to take it from the instruments.  deviation: (compass heading,
    deviation) pairs [rad].  steers: whether a rudder drive listens on this link.  follow: how closely the
    rudder must follow its orders where a sensor on this link shows it.  sends: sentences to repeat, with rates [Hz],
    under the name `talker`, which is then not read on this link.  magnetic: whether magnetic courses are steered.
    with_other_pilot: steer although another autopilot orders the rudder on this line.
    """

    baud: int = 0
    heading_latency: float = 0.0
    variation: float | None = None
    deviation: tuple[tuple[float, float], ...] = ()
    steers: bool = True
    follow: FollowSettings = FollowSettings()
    sends: tuple[tuple[str, float], ...] = ()
    talker: str = OWN_TALKER
    magnetic: bool = False
    with_other_pilot: bool = False


class NmeaSession:
    """What is said over one NMEA 0183 line: bytes in, samples out; rudder orders and ticks in, sentences out.

    It owns no transport and no clock, and never raises. ValueError where the settings cannot be. What `due` returns is
    said to be on its way by `sent`: a line that is busy, or takes nothing, keeps it waiting.

    Attributes:
        received_time: when a sentence last came [s], -inf before the first.
    """

    def __init__(
        self,
        name: str,
        settings: NmeaSettings = NmeaSettings(),  # noqa: B008 - immutable
        is_stream: bool = True,
        guide: PlotterGuide | None = None,
        variation: Variation | None = None,
    ) -> None:
        known = self._known = variation or known_as(settings.variation)
        self.name = name
        self.received_time = -math.inf
        self.settings = settings
        self._is_stream = is_stream
        self._framer = NmeaFramer()
        self._reader = NmeaReader(known, Deviation(settings.deviation), guide, settings.talker, settings.magnetic)
        self._reader.line = name
        self._unusable = UnusableHeadings(name)
        self._jumped = AlarmNews(f"{name}, jumped variation")
        self._guide = guide
        self._guide_alarm = AlarmNews(PLOTTER)
        self._repeater = NmeaRepeater(settings.sends, known, settings.talker, settings.magnetic)
        self._repeated: deque[bytes] = deque(maxlen=REPEATED_WAITING)
        self._seconds_per_byte = BITS_PER_BYTE / settings.baud if settings.baud else 0.0
        self._line_free = -math.inf
        self._command: RudderCommand | None = None
        self._given = math.nan
        self._last_sent = math.nan
        self._pending = False
        self._releases_left = 0
        self._orders_in_row = 0
        self._offered = 0
        self._follow = RudderFollow(settings.follow)
        self._helm = HelmNews(name, settings.steers)
        self._release = UnshownRelease(name, LAPSE)

    @property
    def counts(self) -> Counts:
        """Sentences, checksum errors, malformed and ignored ones so far."""
        framed = self._framer.counts
        return Counts(
            framed.sentences,
            framed.checksum_errors,
            framed.malformed + self._reader.malformed,
            framed.ignored + self._reader.ignored,
        )

    def receive(self, now: float, chunks: list[bytes]) -> list[Sample]:
        """Take what has arrived by `now` [s], datagrams or pieces of a stream, and return the samples in it."""
        samples: list[Sample] = []
        if chunks:
            known = self._framer.counts
            self._read(now, chunks, samples)
            if (self._framer.counts.sentences, self._framer.counts.ignored) != (known.sentences, known.ignored):
                self.received_time = now
        samples += self._helm.of(now, self._follow.reason(now) or self._barred(now), self._follow.cause)
        samples += self._unusable.news(now, samples, self._reader.unusable)
        samples += self._jumped.of(now, self._reader.alarm)
        if self._guide is not None:
            samples += self._guide_alarm.of(now, self._guide.alarm)
        return samples

    def _barred(self, now: float) -> str:
        """Return why the line does not let us steer; empty where it does."""
        when, talker = self._reader.other_order
        if now - when > OTHER_PILOT_S or self.settings.with_other_pilot or not self.settings.steers:
            return ""
        return (
            f"another autopilot on this line orders the rudder ({talker}ROR): put it in standby, or start with "
            "--with-other-pilot"
        )

    def _read(self, now: float, chunks: list[bytes], samples: list[Sample]) -> None:
        if not self._is_stream:
            self._framer.reset()
            chunks = [chunk if chunk.endswith(b"\n") else chunk + b"\r\n" for chunk in chunks]
        for sentence in self._framer.feed(b"".join(chunks)):
            measured = now - (self._framer.taken - sentence.start) * self._seconds_per_byte
            sample = self._reader.read(measured, sentence)
            if sample is None:
                continue
            if isinstance(sample, HeadingSample):
                sample = sample._replace(time=sample.time - self.settings.heading_latency)
            elif isinstance(sample, RudderSample) and not sample.ordered:
                self._follow.measured(sample.time, sample.angle, sample.source)
            samples.append(sample)
            samples += [other._replace(source=sample.source) for other in self._reader.take_others()]

    def send(self, now: float, command: RudderCommand) -> None:
        """Take the rudder order of `now` [s].

        A command that is not engaged, or not finite, is a release: status V, several times.
        """
        engaged = command.engaged and math.isfinite(command.angle)
        if engaged:
            self._follow.ordered(now, command.angle)
        else:
            self._follow.released()
        if not self.settings.steers:
            return
        if engaged:
            self._command, self._pending, self._given = command, True, now
            self._release.has_ordered = True
            self._releases_left = RELEASES
        else:
            self._command, self._pending = None, False

    def poll(self, now: float) -> None:
        """Have the newest command repeated where that falls due at `now` [s]."""
        if self._command is not None and now - self._last_sent >= REPEAT_S and now - self._given <= ORDER_AGE_S:
            self._pending = True

    def on_tick(self, tick: Tick) -> None:
        """Queue the sentences that fall due with `tick`; they leave when the line has no rudder order to carry."""
        self._known.on_tick(tick.now, tick.command.engaged)
        self._repeated.extend(self._repeater.due(tick))

    def due(self, now: float) -> list[bytes]:
        """Return the sentences that may leave at `now` [s], the order or release first: one on a line with a baud rate,
        which is then busy with it."""
        self._offered = 0
        if now < self._line_free:
            return []
        orders = []
        if self._command is not None and self._orders_in_row < ORDERS_IN_ROW:
            if self._pending:
                orders = [encode_ror(self._command.angle, True)]
        elif (
            self._command is None
            and self._releases_left
            and (now - self._last_sent >= RELEASE_SPACING_S or self._releases_left == RELEASES)
        ):
            orders = [encode_ror(0.0, False)]
        self._offered = len(orders)
        offered = [*orders, *self._repeated]
        return offered[:1] if self._seconds_per_byte else offered

    def sent(self, now: float, sentences: list[bytes]) -> None:
        """Take that the first of what was `due` have left at `now` [s]."""
        for number, sentence in enumerate(sentences):
            self._line_free = now + len(sentence) * self._seconds_per_byte
            if number >= self._offered:
                self._repeated.popleft()
                self._orders_in_row = 0
                continue
            self._last_sent = now
            if self._command is not None:
                self._pending = False
                self._orders_in_row += bool(self._repeated)
            else:
                self._releases_left -= 1

    def release(self, now: float) -> list[bytes]:
        """Return the sentences that give the rudder back at once; none where it was never taken."""
        if not self.settings.steers or (self._command is None and not self._releases_left):
            return []
        releases = [encode_ror(0.0, False)] * max(self._releases_left, 1)
        self._command, self._pending, self._releases_left = None, False, 0
        return releases

    def released(self, now: float, is_gone: bool) -> None:
        """Take that the releases have left at `now` [s]; `is_gone`: they could not."""
        self._release.asked(now, is_gone)

    def release_result(self, now: float) -> Release | None:
        """Return what became of the rudder after `release`, None while it is on its way."""
        return self._release.result(now)


class NmeaLink(SessionLink[bytes]):
    """A `Link` over NMEA 0183, on any transport. ValueError where the settings cannot be."""

    def __init__(
        self,
        transport: Transport,
        settings: NmeaSettings = NmeaSettings(),  # noqa: B008 - immutable
        guide: PlotterGuide | None = None,
        variation: Variation | None = None,
    ) -> None:
        self.session = NmeaSession(transport.name, settings, transport.is_stream, guide, variation)
        super().__init__(transport, self.session, lambda _: transport.receive())
