"""MAVLink 2 message signing: 13 bytes behind each packet that only a holder of the key can have written.

signature = first 48 bits of SHA-256(key + packet + link id + timestamp), timestamp in units of 10 microseconds since
2015-01-01, never used twice. Rules and layout: https://mavlink.io/en/guide/message_signing.html

`Signing` is pure. The key and its timestamps on disk: a key file that is yours alone, and blocks of timestamps beside
it. A companion computer has no clock battery, and a power cut must never make it use a timestamp twice. So a block of
timestamps is reserved on disk before the first of them is used, under a lock, so that several programs may share a key.
"""

from __future__ import annotations

import contextlib
import fcntl
import hashlib
import hmac
import os
import re
import stat
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Protocol

from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.errors import InputError
from autopilot.files.outside import open_regular, read_regular
from autopilot.files.saving import replace_file
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
    """Timestamps, each greater than any that was ever used with the key."""

    @property
    def current(self) -> int:
        """The greatest timestamp used or seen so far."""

    def next(self) -> int:
        """Use a new timestamp and return it."""

    def saw(self, timestamp: int) -> None:
        """Take note of a timestamp that a correctly signed packet carried: ours go on from there."""


class CountingTimestamps:
    """`Timestamps` that begin at a number and are kept nowhere: for one process that never restarts, and for tests."""

    def __init__(self, start: int = 1) -> None:
        self.current = start

    def next(self) -> int:
        """See `Timestamps`."""
        self.current += 1
        return self.current

    def saw(self, timestamp: int) -> None:
        """See `Timestamps`."""
        self.current = max(self.current, timestamp)


class Signing:
    """One key in this process, shared by all its links: a packet recorded on one cannot be replayed on another.

    Args:
        key: 32 bytes.  timestamps: used by all its links.
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


EPOCH_S = 1_420_070_400
"""2015-01-01 in seconds since 1970."""
UNITS_PER_S = 100_000
BLOCK = 100_000
"""Timestamps reserved at a time: a second of them, so that many restarts do not run ahead of the clock."""
RENEWAL_S = 10.0
"""So often a new block is taken, which also brings the timestamps up to the clock."""
KEY_FILE_MAX = 1024
CHANGED = "another key is in the file since the start, and the one before is still used; start again to use the new one"
OTHERS = stat.S_IRWXG | stat.S_IRWXO


def read_key(path: str | Path) -> bytes:
    """Return the 32 bytes of a key file: 64 hexadecimal digits, or the SHA-256 of a passphrase.

    Raises InputError where it cannot be read, others may read it, or it holds neither.
    """
    path = Path(path)
    try:
        with open(open_regular(path), "rb") as file:  # noqa: PTH123 - a descriptor, not a path
            mode = os.fstat(file.fileno()).st_mode
            if mode & OTHERS:
                raise InputError(
                    f"signing key {path}: others may use it (mode {stat.S_IMODE(mode):04o}); run: chmod 600 {path}"
                )
            content = file.read(KEY_FILE_MAX + 1)
    except OSError as error:
        raise InputError(f"signing key {path}: {error.strerror}; give a file that you can read") from error
    return key_of(content, path)


def key_of(content: bytes, path: Path) -> bytes:
    """Return the key that a file's `content` stands for. Raises InputError."""
    how = "write one line: 64 hexadecimal digits, or the passphrase that the ground station uses"
    try:
        text = content.decode()
    except UnicodeDecodeError:
        raise InputError(f"signing key {path}: not text; {how}") from None
    line = text.removesuffix("\n").removesuffix("\r")
    if len(content) > KEY_FILE_MAX or "\n" in line or not line.strip():
        raise InputError(f"signing key {path}: empty, longer than {KEY_FILE_MAX} bytes or of several lines; {how}")
    if not re.fullmatch("[0-9a-fA-F]{64}", line):
        return hashlib.sha256(line.encode()).digest()
    key = bytes.fromhex(line)
    if key == bytes(KEY_SIZE):
        raise InputError(f"signing key {path}: a key of zeros means no signing; {how}")
    return key


def clock_timestamp() -> int:
    """Return the timestamp of this moment by the system clock, 0 where it stands before 2015."""
    return max(0, int((time.time() - EPOCH_S) * UNITS_PER_S))


class TimestampBlocks:
    """`Timestamps` from blocks reserved on disk beside the key. Raises InputError where none can be.

    `next` never waits: blocks are taken by `renew`, in a thread of its own once `keep_renewing` is called. Should the
    disk fail, timestamps go on past what is reserved and `complaint` says so. `key`: what the file held at the start.
    """

    def __init__(
        self, key_path: str | Path, clock: Callable[[], int] = clock_timestamp, key: bytes | None = None
    ) -> None:
        self._key_path, self._key = Path(key_path), key
        self._path = self._key_path.with_name(self._key_path.name + ".timestamp")
        self._clock = clock
        self.complaint = ""
        self._wanted = threading.Event()
        self._fresh: tuple[int, int] | None = None
        self._used = self._end = self._seen = 0
        self.renew()
        if self.complaint:
            raise InputError(self.complaint)

    @property
    def current(self) -> int:
        """See `Timestamps`; where none was used or seen, the one reserved first."""
        return max(self._used, self._seen, self._fresh[0] if self._fresh else 0)

    def next(self) -> int:
        """See `Timestamps`."""
        fresh = self._fresh
        if fresh is not None:
            self._fresh = None
            self._used, self._end = max(self._used, fresh[0]), fresh[1]
        self._used += 1
        if self._used > self._end - BLOCK // 2:
            self._wanted.set()
        return self._used

    def saw(self, timestamp: int) -> None:
        """Take note of `timestamp`: the next block begins behind it, and is taken at once where we are far behind."""
        if timestamp > self._seen:
            self._seen = timestamp
            if timestamp > self._used + MINUTE // 2:
                self._wanted.set()

    def renew(self) -> None:
        """Reserve a block on disk that begins at what was used, seen or reserved, or at the clock."""
        try:
            with _locked(self._key_path):
                start = max(self._used, self._seen, self._clock(), self._reserved())
                if start + BLOCK > TIMESTAMP_MAX:
                    raise InputError(f"{self._path}: the timestamps of this key are used up; make a new key")
                replace_file(self._path, f"{start + BLOCK}\n", private=True)
        except OSError as error:
            self.complaint = (
                f"signing timestamps cannot be kept in {self._path} ({error.strerror}); "
                "put the key into a folder that you may write to"
            )
            return
        except InputError as error:
            self.complaint = str(error)
            return
        self.complaint = ""
        self._fresh = (start, start + BLOCK)

    @property
    def is_changed(self) -> bool:
        """Whether the file holds another key now; one that cannot be read is no other."""
        with contextlib.suppress(InputError):
            return self._key is not None and read_key(self._key_path) != self._key
        return False

    def keep_renewing(self, complain: Callable[[str], None]) -> None:
        """Take blocks from a thread of its own from now on: flushing to a memory card takes longer than a tick.

        `complain` is called once when the disk begins to fail, and when the file holds another key than at the start.
        """
        threading.Thread(target=self._renewing, args=(complain,), name="signing timestamps", daemon=True).start()

    def _renewing(self, complain: Callable[[str], None]) -> None:
        is_changed = False
        while True:
            if self._wanted.wait(RENEWAL_S) and self.complaint:
                time.sleep(1.0)  # a broken disk is not asked without end
            self._wanted.clear()
            before, was_changed = self.complaint, is_changed
            self.renew()
            is_changed = self.is_changed
            said = [self.complaint] if self.complaint and not before else []
            said += [f"signing key {self._key_path}: {CHANGED}"] if is_changed and not was_changed else []
            for sentence in said:
                with contextlib.suppress(OSError, ValueError):  # a full terminal must not end the renewing
                    complain(sentence)

    def _reserved(self) -> int:
        try:
            text = read_regular(self._path, len(str(TIMESTAMP_MAX)) + 2).decode("ascii", "replace").strip()
        except FileNotFoundError:
            return 0
        if not (text.isdigit() and text.isascii() and int(text) <= TIMESTAMP_MAX):
            raise InputError(
                f"{self._path}: holds no timestamp; give the key a new name, and change it on all sides if this "
                "machine's clock may have been wrong"
            )
        return int(text)


def open_signing(path: str | Path) -> Signing:
    """Return signing with the key in a file, its timestamps kept beside it. Raises InputError.

    A disk that fails later is reported on the terminal.
    """
    key = read_key(path)
    blocks = TimestampBlocks(path, key=key)
    blocks.keep_renewing(lambda complaint: print(complaint, file=sys.stderr))
    # two of our processes with the same ids and a key in common must not seem to repeat each other's timestamps
    return Signing(key, blocks, FIRST_LINK + os.getpid() % OUR_LINKS)


@contextlib.contextmanager
def _locked(path: Path) -> Iterator[None]:
    with path.open("rb") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield
