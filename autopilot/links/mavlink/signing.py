"""MAVLink 2 message signing: 13 bytes behind each packet that only a holder of the key can have written. Pure.

signature = first 48 bits of SHA-256(key + packet + link id + timestamp), timestamp in units of 10 microseconds since
2015-01-01, never used twice. Rules and layout: https://mavlink.io/en/guide/message_signing.html
"""

from __future__ import annotations

import hashlib
import hmac
from collections import Counter
from typing import Protocol

from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.links.mavlink.frames import KNOWN, SIGNATURE, SIGNED, checksum, identity_of, is_signed

MINUTE = 6_000_000
"""A stream not heard before may be this far behind what has been seen."""
KEY_SIZE = 32
MOST_STREAMS = 1024
FIRST_LINK = 64
"""Ground stations number their links from 0: one that shares our system id must not share our streams."""
OUR_LINKS = 256 - FIRST_LINK
TIMESTAMP_MAX = (1 << 48) - 1
UNSIGNED_IDS = frozenset({int(dialect.MAVLINK_MSG_ID_RADIO_STATUS)})
"""Taken without a signature: a telemetry radio puts it into the stream itself and has no key."""

UNSIGNED, WRONG_KEY, OLD = "not signed", "signed with another key", "signed, but sent before (replayed)"
BEHIND = "signed by a clock that is more than a minute behind, or sent long ago"
SAME_KEY = "use the same key on both sides, or none"
CURES = {
    UNSIGNED: SAME_KEY,
    WRONG_KEY: SAME_KEY,
    OLD: "somebody repeats what was sent before: look who else is on this line",
    BEHIND: "set the clock of who sends them, and start it again",
}

Stream = tuple[int, int, int]
"""Link id, system id, component id: each has timestamps of its own that only grow."""


class Timestamps(Protocol):
    """Where timestamps come from: each greater than any that was ever used with the key, over restarts too."""

    @property
    def current(self) -> int:
        """The greatest timestamp used or seen so far."""

    def next(self) -> int:
        """Use a new timestamp and return it."""

    def saw(self, timestamp: int) -> None:
        """Take note of a timestamp that a correctly signed packet carried: ours go on from there."""


class CountingTimestamps:
    """Timestamps that begin at a number and are kept nowhere: for one process that never restarts, and for tests."""

    def __init__(self, start: int = 1) -> None:
        self.current = start

    def next(self) -> int:
        """Return the next number."""
        self.current += 1
        return self.current

    def saw(self, timestamp: int) -> None:
        """Go on from `timestamp` where it is greater."""
        self.current = max(self.current, timestamp)


class Signing:
    """One key in this process, shared by all its links: a packet recorded on one cannot be replayed on another.

    Args:
        key: 32 bytes.  timestamps: see `Timestamps`.
        first_link: number of the first link, another one in each process of a machine that shares the key.

    Attributes:
        refused: how many packets were refused, by reason.  last_refusal: the reason of the newest of them.
    """

    def __init__(self, key: bytes, timestamps: Timestamps, first_link: int = FIRST_LINK) -> None:
        if len(key) != KEY_SIZE:
            raise ValueError(f"a signing key has {KEY_SIZE} bytes, not {len(key)}")
        self.timestamps = timestamps
        self.refused: Counter[str] = Counter()
        self.last_refusal = ""
        self.streams: dict[Stream, int] = {}
        self._keyed = hashlib.sha256(key)
        self._links = first_link - FIRST_LINK

    def __repr__(self) -> str:
        return "Signing(...)"  # the key stays out of every message and log

    def link(self) -> LinkSigning:
        """Return the signing of one more link, with a link id of its own."""
        self._links += 1
        return LinkSigning(self, FIRST_LINK + (self._links - 1) % OUR_LINKS)

    @property
    def summary(self) -> str:
        """Say in half a sentence what was refused; '' where nothing was."""
        counts = (f"{count} {reason}" for reason, count in self.refused.most_common())
        return f"{self.refused.total()} MAVLink messages were refused: " + ", ".join(counts) if self.refused else ""

    def signature(self, signed: bytes) -> bytes:
        """Return the 6 bytes that prove `signed`: a packet with its link id and timestamp."""
        digest = self._keyed.copy()
        digest.update(signed)
        return digest.digest()[:6]


class LinkSigning:
    """Signs what leaves over one link and judges what comes in over it."""

    def __init__(self, signing: Signing, link_id: int, remembers: bool = True) -> None:
        self.signing = signing
        self.link_id = link_id
        self._remembers = remembers

    def observer(self) -> LinkSigning:
        """Return a judge that takes no note of what it accepts: to look at a datagram that will be read again."""
        return LinkSigning(self.signing, self.link_id, remembers=False)

    def sign(self, frame: bytes, crc_extra: int) -> bytes:
        """Return the unsigned MAVLink 2 `frame` signed, its message having the checksum seed `crc_extra`."""
        signing = self.signing
        timestamp = signing.timestamps.next()
        signing.streams[self.link_id, frame[5], frame[6]] = timestamp  # an echo of our own is a replay
        body = frame[:2] + bytes([frame[2] | SIGNED]) + frame[3:-2]
        body += checksum(body[1:], crc_extra) + bytes([self.link_id]) + timestamp.to_bytes(6, "little")
        return body + signing.signature(body)

    def refuses(self, frame: bytes) -> bool:
        """Return whether a whole `frame` with the right checksum is to be refused; counts it where it is."""
        reason = self._reason(frame)
        if reason:
            self.signing.refused[reason] += 1
            self.signing.last_refusal = reason
        return bool(reason)

    def _reason(self, frame: bytes) -> str:
        if not is_signed(frame):
            return "" if identity_of(frame) in UNSIGNED_IDS else UNSIGNED
        signing = self.signing
        if not hmac.compare_digest(signing.signature(frame[:-6]), frame[-6:]):
            return WRONG_KEY
        stream = (frame[-13], frame[5], frame[6])
        timestamp = int.from_bytes(frame[-12:-6], "little")
        last = signing.streams.get(stream)
        if last is None:
            if timestamp + MINUTE < signing.timestamps.current:
                return BEHIND
            if len(signing.streams) >= MOST_STREAMS:
                return OLD
        elif timestamp <= last:
            return BEHIND if timestamp + MINUTE < last else OLD
        if self._remembers:
            signing.streams[stream] = timestamp
            signing.timestamps.saw(timestamp)
        return ""


def hint_of(signing: Signing | None) -> str:
    """Return what to add to the message that nothing was heard: '' unless something was refused."""
    if signing is None or not signing.refused:
        return ""
    cures = dict.fromkeys(CURES[reason] for reason, _ in signing.refused.most_common())
    return f" ({signing.summary}: {'; '.join(cures)})"


def without_signature(frame: bytes) -> bytes:
    """Return `frame` as it would be unsigned, for logs: who collects signatures has something to work on.

    Frames of a message outside the dialect, whose checksum cannot be made anew, come back as they are.
    """
    if not is_signed(frame):
        return frame
    kind = KNOWN.get(identity_of(frame))
    if kind is None:
        return frame
    body = frame[:2] + bytes([frame[2] & ~SIGNED]) + frame[3 : -2 - SIGNATURE]
    return body + checksum(body[1:], kind.crc_extra)
