"""The link to instruments and a rudder drive on NMEA 0183: samples in, the rudder order out as ROR.

A sentence is as old as its first byte: at 4800 baud a heading of 20 characters has been 42 ms on the line by the
time it ends. So the time of a sample is reckoned back from its arrival:

    time = arrival - (bytes of this batch from the sentence's `$` on) * 10 / baud - latency of the instrument
"""

from __future__ import annotations

import math
from collections import deque
from typing import NamedTuple

from autopilot.guidance.plotter import PlotterGuide
from autopilot.links.base import LinkError, Transport
from autopilot.links.nmea.repeater import NmeaRepeater
from autopilot.links.nmea.samples import OWN_TALKER, Deviation, NmeaReader
from autopilot.links.nmea.sentences import Counts, NmeaFramer, Sentence, encode_ror
from autopilot.links.north import UnusableHeadings
from autopilot.links.release import Release, UnshownRelease
from autopilot.links.rudder_follow import ORDER_AGE_S, RELEASE_SPACING_S, RELEASES, FollowSettings, RudderFollow
from autopilot.signals import (
    AlarmEvent,
    AlarmSample,
    HeadingSample,
    HelmSample,
    Mode,
    RudderCommand,
    RudderSample,
    Sample,
    Tick,
)

BITS_PER_BYTE = 10
SILENT_PEER_S = 5.0
"""Time without a sentence after which another peer may take the place on a listening socket."""
"""Start bit, eight data bits, stop bit."""
REPEAT_S = 0.5
"""A drive releases the rudder when no order has come for 2 s or so: the last one is repeated at least this often."""
REPEATED_WAITING = 12
"""Repeated sentences that wait for a slow line; of more, the oldest go unsent."""
ORDERS_IN_ROW = 3
"""On a line that cannot carry all, a repeated sentence leaves after so many orders."""
PLOTTER = "chart plotter"
LAPSE = "no NMEA 0183 sentence confirms it; the drive lets go by itself when no more orders come"


class NmeaSettings(NamedTuple):
    """How to read and steer an NMEA boat.

    baud: of the line, 0 where there is none (UDP).  heading_latency [s]: age of a heading when its sentence
    begins.  variation [rad], east positive, None to take it from the instruments.  deviation: (compass heading,
    deviation) pairs [rad].  steers: whether a rudder drive listens on this link.  follow: how closely the
    rudder must follow its orders where a sensor on this link shows it.  sends: sentences to repeat, with rates [Hz],
    under the name `talker`, which is then not read on this link.  magnetic: whether magnetic courses are steered.
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


class NmeaLink:
    """A `Link` over NMEA 0183. ValueError where the settings cannot be.

    Attributes:
        replaced: commands not sent because the line was still busy with an earlier one; the newest is sent.
    """

    def __init__(
        self,
        transport: Transport,
        settings: NmeaSettings = NmeaSettings(),  # noqa: B008 - immutable
        guide: PlotterGuide | None = None,
    ) -> None:
        self.name = transport.name
        self.replaced = 0
        self._transport = transport
        self._settings = settings
        self._framer = NmeaFramer()
        self._reader = NmeaReader(
            settings.variation, Deviation(settings.deviation), guide, settings.talker, settings.magnetic
        )
        self._unusable = UnusableHeadings(self.name)
        self._guide = guide
        self._guide_alarm: AlarmEvent | None = None
        self._heard = -math.inf
        self._repeater = NmeaRepeater(settings.sends, settings.variation, settings.talker, settings.magnetic)
        self._repeated: deque[bytes] = deque(maxlen=REPEATED_WAITING)
        self._seconds_per_byte = BITS_PER_BYTE / settings.baud if settings.baud else 0.0
        self._line_free = -math.inf
        self._command: RudderCommand | None = None
        self._given = math.nan
        self._last_sent = math.nan
        self._pending = False
        self._releases_left = 0
        self._orders_in_row = 0
        self._follow = RudderFollow(settings.follow)
        self._helm_reason: str | None = None
        self._release = UnshownRelease(self.name, LAPSE)

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

    @property
    def waiting_for_variation(self) -> int:
        """Magnetic headings dropped because no variation is known; configure one where this grows."""
        return self._reader.waiting_for_variation

    def fileno(self) -> int:
        """Return the transport's descriptor, or -1."""
        return self._transport.fileno()

    def receive(self, now: float) -> list[Sample]:
        """Return the samples that have arrived by `now` [s]; LinkError when the transport is gone."""
        samples: list[Sample] = []
        chunks = self._transport.receive()
        if chunks:
            known = self._framer.counts
            self._read(now, chunks, samples)
            if (self._framer.counts.sentences, self._framer.counts.ignored) != (known.sentences, known.ignored):
                self._heard = now
        if now - self._heard > SILENT_PEER_S:
            # an instrument that starts again speaks from another port
            self._heard = now
            self._transport.forget_peer()
        reason = self._follow.reason(now)
        if reason != self._helm_reason and (self._settings.steers or reason or self._helm_reason):
            self._helm_reason = reason
            samples.append(HelmSample(now, not reason, reason, self.name, self._follow.cause))
        samples += self._unusable.news(now, samples, self._reader.unusable)
        if self._guide is not None and self._guide.alarm != self._guide_alarm:
            self._guide_alarm = self._guide.alarm
            samples.append(AlarmSample(now, self._guide_alarm, PLOTTER))
        return samples

    def _read(self, now: float, chunks: list[bytes], samples: list[Sample]) -> None:
        if not self._transport.is_stream:
            self._framer.reset()
            chunks = [chunk if chunk.endswith(b"\n") else chunk + b"\r\n" for chunk in chunks]
        sentences = self._framer.feed(b"".join(chunks))
        for sentence in sentences:
            sample = self._reader.read(self._measured(now, sentence), sentence)
            if isinstance(sample, HeadingSample):
                sample = sample._replace(time=sample.time - self._settings.heading_latency)
            elif isinstance(sample, RudderSample) and not sample.ordered:
                self._follow.measured(sample.time, sample.angle, sample.source)
            if sample is not None:
                samples.append(sample)
                position = self._reader.take_position()
                if position is not None:
                    samples.append(position._replace(source=sample.source))

    def send(self, now: float, command: RudderCommand) -> None:
        """Send the rudder order; a line still busy takes the newest one as soon as it is free.

        A command that is not engaged, or not finite, is sent as a release: status V, several times.
        """
        engaged = command.engaged and math.isfinite(command.angle)
        if engaged:
            self._follow.ordered(now, command.angle)
        else:
            self._follow.released()
        if not self._settings.steers:
            return
        if engaged:
            if self._pending:
                self.replaced += 1
            self._command, self._pending, self._given = command, True, now
            self._release.has_ordered = True
            self._releases_left = RELEASES
        else:
            self._command, self._pending = None, False
        self._push(now)

    def tell(self, now: float, mode: Mode, alarms: tuple[AlarmEvent, ...]) -> None:
        """Nothing: a rudder drive knows no modes."""

    def keep(self, now: float) -> None:
        """Send what waits: the newest command, its repetition, or the releases that are left."""
        if self._command is not None and now - self._last_sent >= REPEAT_S and now - self._given <= ORDER_AGE_S:
            self._pending = True
        self._push(now)

    def show(self, tick: Tick) -> None:
        """Queue the sentences that fall due with `tick`; they leave when the line has no rudder order to carry."""
        self._repeated.extend(self._repeater.due(tick))
        self._push(tick.now)

    def release(self, now: float) -> None:
        """Give the rudder back, several times over; never raises."""
        if self._settings.steers and (self._command is not None or self._releases_left):
            self._command, self._pending = None, False
            is_gone = False
            for _ in range(max(self._releases_left, 1)):
                try:
                    self._transport.send(encode_ror(0.0, False))
                except LinkError:
                    is_gone = True  # the drive releases by its own timeout
                    break
            self._releases_left = 0
            self._release.asked(now, is_gone)

    def release_result(self, now: float) -> Release | None:
        """Return what became of the rudder after `release`, None while it is on its way."""
        return self._release.result(now)

    def take_packets(self) -> list[tuple[float, bytes]]:
        """Return []: NMEA carries no MAVLink packets."""
        return []

    def close(self) -> None:
        """Close the transport; call `release` first."""
        self._transport.close()

    def _measured(self, now: float, sentence: Sentence) -> float:
        return now - (self._framer.taken - sentence.start) * self._seconds_per_byte

    def _push(self, now: float) -> None:
        if now < self._line_free:
            return
        if self._command is not None and self._orders_in_row < ORDERS_IN_ROW:
            if self._pending:
                self._pending = not self._write(now, encode_ror(self._command.angle, True))
                self._orders_in_row += bool(self._repeated)
        elif (
            self._command is None
            and self._releases_left
            and (now - self._last_sent >= RELEASE_SPACING_S or self._releases_left == RELEASES)
        ):
            self._releases_left -= self._write(now, encode_ror(0.0, False))
        while self._repeated and now >= self._line_free and self._write_one(now, self._repeated[0]):
            self._repeated.popleft()
            self._orders_in_row = 0

    def _write_one(self, now: float, sentence: bytes) -> bool:
        """Send a sentence that is no order: it does not count as one."""
        last_order = self._last_sent
        sent = self._write(now, sentence)
        self._last_sent = last_order
        return sent

    def _write(self, now: float, sentence: bytes) -> bool:
        if not self._transport.send(sentence):
            return False
        self._last_sent = now
        self._line_free = now + len(sentence) * self._seconds_per_byte
        return True
