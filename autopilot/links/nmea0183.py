"""NMEA 0183 sentences: bytes to checked sentences and back. Pure; what the fields mean is in `nmea_samples`.

    $ttsss,field,field,...*hh<CR><LF>      tt talker, sss type, hh exclusive or of all between $ and *

Source: the framing of IEC 61162-1 as described in E. S. Raymond, "NMEA Revealed",
https://gpsd.gitlab.io/gpsd/NMEA.html.
"""

from __future__ import annotations

import re
from typing import NamedTuple

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

    A sentence needs its checksum: a compass that sends none cannot be told from noise and must not steer.
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
