"""The signing key and its timestamps on disk: a key file that is yours alone, and blocks of timestamps beside it.

A companion computer has no clock battery, and a power cut must never make it use a timestamp twice. So a block of
timestamps is reserved on disk before the first of them is used, under a lock, so that several programs may share a key.
"""

from __future__ import annotations

import contextlib
import fcntl
import hashlib
import os
import re
import stat
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

from autopilot.errors import InputError
from autopilot.files.outside import open_regular, read_regular
from autopilot.files.saving import replace_file
from autopilot.links.mavlink.signing import FIRST_LINK, KEY_SIZE, MINUTE, OUR_LINKS, TIMESTAMP_MAX, Signing

EPOCH_S = 1_420_070_400
"""2015-01-01 in seconds since 1970."""
UNITS_PER_S = 100_000
BLOCK = 100_000
"""Timestamps reserved at a time: a second of them, so that many restarts do not run ahead of the clock."""
RENEWAL_S = 10.0
"""So often a new block is taken, which also brings the timestamps up to the clock."""
KEY_FILE_MAX = 1024
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
    """Timestamps from blocks reserved on disk beside the key. Raises InputError where none can be.

    `next` never waits: blocks are taken by `renew`, in a thread of its own once `keep_renewing` is called. Should the
    disk fail, timestamps go on past what is reserved and `complaint` says so.
    """

    def __init__(self, key_path: str | Path, clock: Callable[[], int] = clock_timestamp) -> None:
        self._key_path = Path(key_path)
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
        """The greatest timestamp used or seen so far; where none was, the one reserved first."""
        return max(self._used, self._seen, self._fresh[0] if self._fresh else 0)

    def next(self) -> int:
        """Use a new timestamp and return it."""
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

    def keep_renewing(self, complain: Callable[[str], None]) -> None:
        """Take blocks from a thread of its own from now on: flushing to a memory card takes longer than a tick.

        `complain` is called once when the disk begins to fail.
        """
        threading.Thread(target=self._renewing, args=(complain,), name="signing timestamps", daemon=True).start()

    def _renewing(self, complain: Callable[[str], None]) -> None:
        while True:
            if self._wanted.wait(RENEWAL_S) and self.complaint:
                time.sleep(1.0)  # a broken disk is not asked without end
            self._wanted.clear()
            before = self.complaint
            self.renew()
            if self.complaint and not before:
                complain(self.complaint)

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
    blocks = TimestampBlocks(path)
    blocks.keep_renewing(lambda complaint: print(complaint, file=sys.stderr))
    # two of our processes with the same ids and a key in common must not seem to repeat each other's timestamps
    return Signing(key, blocks, FIRST_LINK + os.getpid() % OUR_LINKS)


@contextlib.contextmanager
def _locked(path: Path) -> Iterator[None]:
    with path.open("rb") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield
