"""Where a log's bytes go: one file, or a folder of parts that never grows beyond a size; written by a thread or not.

A part is one file that can be read alone. Whoever writes says where a part may begin, for only he knows its header.
"""

from __future__ import annotations

import contextlib
import errno
import fcntl
import os
import queue
import re
import stat
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple, TypeAlias

from autopilot.errors import InputError
from autopilot.files.saving import FULL, TOO_BIG, create_unused, is_in_use, lock, why_not

RETRY_S = 5.0
"""A disk that would not take the log is asked again after this time."""
SYNC_S = 5.0
"""A power cut costs at most about this much of the log."""
WAITING_MAX = 200
"""Writes that may wait for the disk: ten seconds of a 20 Hz loop."""
CLOSING_S = 5.0
"""A disk that does not answer is left alone after this time when the log is closed."""
MEGABYTE = 1_000_000
NOT_SYNCED = (errno.EINVAL, errno.EROFS, errno.ENOTSUP)
"""How a pipe or a device answers that has nothing to put on a disk."""
TOO_SLOW = "log has a gap: the disk is too slow; use a faster card, or log elsewhere"
REMOVED = "log stopped: its file was removed or cut while it was written; a new one is begun"
OUT_OF_MEMORY = "log stopped: out of memory; end other programs"
PART_NAME = re.compile(r"(?P<run>.*\.)(?P<part>\d{3,})\.tlog")
RUN_NAME = re.compile(r"norrbin-(?P<number>\d{5,})-\d{8}T\d{6}Z\.\d{3,}\.tlog")


class _OpenFile:
    """What is written into one file after the other. A full disk is waited for.

    refusal: what is said where the first cannot be opened for another reason, before and behind the system's words.

    Attributes, of every sink:
        path: the file that is written now, or was last.  trouble: why nothing is written now, '' while all is well.
        part_bytes: size of a part, None for one file.  dropped: ticks that were lost with writes.
        lost: writes that were. When it has grown, what is written next must begin with a header again.
    """

    part_bytes: int | None = None

    def __init__(self, path: Path, refusal: tuple[str, str]) -> None:
        self.trouble = ""
        self.lost = self.dropped = 0
        self.path = path
        self._file = -1
        self._size = 0
        self._closed = False
        try:
            self._open()
        except OSError as error:
            if error.errno not in FULL:
                raise InputError(f"{refusal[0]}: {why_not(error)}; {refusal[1]}") from error
            self.trouble = f"log stopped: {error.strerror}; free the disk"

    def write(self, data: bytes, ticks: int = 1) -> None:
        """Append, in a new file where there is none open, or where the disk of the one before is gone."""
        self.trouble = self._opened()
        if not self.trouble and (error := appended(self._file, data)) is not None:
            self._failed(error)
        if self.trouble:
            self.lost, self.dropped = self.lost + 1, self.dropped + ticks
        else:
            self._size += len(data)

    def sync(self) -> None:
        """Have what was written on the disk itself. A file that somebody has removed or cut is left, with trouble."""
        if self._file < 0:
            return
        try:
            os.fdatasync(self._file)
        except OSError as error:
            if error.errno not in NOT_SYNCED:
                self._failed(error)
                return
        about = os.fstat(self._file)
        if stat.S_ISREG(about.st_mode) and (about.st_nlink == 0 or about.st_size < self._size):
            self._end_part()
            self.trouble = REMOVED

    def close(self) -> None:
        """Close the file."""
        self._closed = True
        self._end_part()

    def _failed(self, error: OSError) -> None:
        """Take that the disk would not: a stick that was pulled comes back as another disk, with files of its own."""
        is_pipe, is_full = error.errno == errno.EPIPE, error.errno in FULL
        what = "nobody reads the pipe any more" if is_pipe else error.strerror
        is_too_big = error.errno == errno.EFBIG
        cure = "start its reader again" if is_pipe else "free the disk" if is_full else "look after the disk"
        cure = TOO_BIG if is_too_big else cure
        self.trouble = f"log stopped: {what}; {cure}"
        # what does not fit into an empty file fits into no further one
        if not (is_pipe or is_full or (is_too_big and not self._size)):
            self._end_part()

    def _end_part(self) -> None:
        if self._file >= 0:
            with contextlib.suppress(OSError):
                os.close(self._file)
            self._file, self._size = -1, 0

    def _opened(self) -> str:
        """Have a file open; return why there is none."""
        if self._file >= 0 or self._closed:
            return ""
        try:
            self._open()
        except OSError as error:
            return f"log stopped: {error.strerror}; free the disk, or log elsewhere"
        return ""

    def _open(self) -> None:
        """Open the next file. Raises OSError."""
        raise NotImplementedError


def log_file(path: Path) -> FileSink:
    """Return the sink of a new log. Raises InputError also where its name is that of another kind of file."""
    if path.suffix[1:].isalpha() and path.suffix.lower() != ".tlog":
        raise InputError(
            f"log {path}: a log is a .tlog; name it so, and `autopilot log export` makes other kinds of it."
        )
    return FileSink(path)


class FileSink(_OpenFile):
    """One new file, written at once, locked as long as it is open; where `path` exists, its next free name.

    On a full disk it is made as soon as there is room. Raises InputError where it cannot be written.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path, (f"log {path}", "give another place with --log"))

    def next_part(self) -> None:
        """There is one file."""

    def _open(self) -> None:
        self.path.parent.mkdir(parents=True, exist_ok=True)
        self._file, self.path = create_unused(self.path)


class FolderLimits(NamedTuple):
    """Sizes [bytes] of all logs of a folder together and of one part, and what is left free on its disk."""

    total: int = 2000 * MEGABYTE
    part: int = 64 * MEGABYTE
    free: int = 100 * MEGABYTE


class FolderSink(_OpenFile):
    """Parts in a folder: norrbin-00012-20260504T101500Z.001.tlog is part 1 of the folder's 12th run.

    The number orders the runs where the clock cannot: many boards know no time before the network or the GPS has set
    them. Before a part begins the oldest parts are removed until it fits; another program's files, and what another
    run is writing, are left alone. A full disk is waited for. Raises InputError where the folder cannot be written.
    """

    def __init__(self, folder: Path, limits: FolderLimits = FolderLimits()) -> None:  # noqa: B008 - immutable
        self.part_bytes = limits.part
        self._folder, self._limits = folder, limits
        self._run = ""
        self._part = 0
        super().__init__(folder, (f"log folder {folder}", "give another one with --log-dir"))

    def next_part(self) -> None:
        """Begin another file with the next write."""
        self.sync()
        self._end_part()

    def _open(self) -> None:
        """Open the next part, of a run that has its number since the first one. Raises OSError."""
        if self._run:
            self._make_room()
            self._file, self.path, self._part = *self._created(self._run, self._part + 1), self._part + 1
            return
        self._folder.mkdir(parents=True, exist_ok=True)
        with _one_at_a_time(self._folder):  # of two runs that begin together each has a number of its own
            number = 1 + max((run_number(path) for path in self._folder.iterdir()), default=0)
            run = f"norrbin-{number:05d}-{time.strftime('%Y%m%dT%H%M%SZ', time.gmtime())}"
            self._make_room()
            self._file, self.path, self._part = *self._created(run, 1), 1
            self._run = run

    def _created(self, run: str, part: int) -> tuple[int, Path]:
        path = self._folder / f"{run}.{part:03d}.tlog"
        descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND | os.O_EXCL, 0o644)
        lock(descriptor)
        return descriptor, path

    def _make_room(self) -> None:
        """Remove the oldest parts until the next one fits into the folder's size and onto the disk."""
        parts = sorted(
            (path for path in self._folder.iterdir() if RUN_NAME.fullmatch(path.name)),
            key=lambda path: (run_number(path), part_number(path)),
        )
        sizes = {path: path.lstat().st_size for path in parts}
        total = sum(sizes.values())
        for path in parts:
            disk = os.statvfs(self._folder)
            fits = disk.f_bavail * disk.f_frsize >= self._limits.free + self._limits.part
            if total + self._limits.part <= self._limits.total and fits:
                return
            if is_in_use(path):
                continue
            path.unlink(missing_ok=True)
            total -= sizes[path]


class ThreadedSink:
    """Writes to another sink from a thread: a disk that stalls keeps nobody waiting, and what waits is bounded.

    `write` only puts into a queue. When the queue is full, or the disk refused, writes are dropped and counted.
    """

    def __init__(self, inside: FileSink | FolderSink, waiting_max: int = WAITING_MAX, retry: float = RETRY_S) -> None:
        self.trouble = ""
        self.lost = self.dropped = 0
        self.part_bytes = inside.part_bytes
        self._inside, self._waiting_max, self._retry = inside, waiting_max, retry
        self._queue: queue.SimpleQueue[tuple[bytes, int] | None] = queue.SimpleQueue()
        self._refused_until = 0.0
        self._sync_at = time.monotonic() + SYNC_S
        self._closed = False
        self._thread = threading.Thread(target=self._work, name="log", daemon=True)
        self._thread.start()

    @property
    def path(self) -> Path:
        """The file that is written now, or was last."""
        return self._inside.path

    def write(self, data: bytes, ticks: int = 1) -> None:
        """Put into the queue, where it is not full and the disk has not just refused."""
        if self._closed:
            return
        if self._queue.qsize() >= self._waiting_max:
            self.trouble = TOO_SLOW
            self._lose(ticks)
        elif time.monotonic() < self._refused_until:
            self._lose(ticks)
        else:
            self._queue.put((data, ticks))

    def next_part(self) -> None:
        """Begin another file when the queue has come to here."""
        if self.part_bytes is not None:
            self._queue.put((b"", 0))

    def close(self) -> None:
        """Write what waits; a disk that does not answer is left with it after CLOSING_S."""
        if self._closed:
            return
        self._closed = True
        self._queue.put(None)
        self._thread.join(CLOSING_S)
        if self._thread.is_alive():
            self.dropped += self._queue.qsize()

    def _work(self) -> None:
        while True:
            taken = self._queue.get()
            if taken is None:
                break
            try:
                self._take(*taken)
            except Exception as error:  # steering goes on without its log, and hears why
                self._refuse(f"log stopped: {error}" if str(error) else OUT_OF_MEMORY, taken[1])
        self._inside.sync()
        self._inside.close()

    def _take(self, data: bytes, ticks: int) -> None:
        """Do what has been put into the queue."""
        if not data:
            self._inside.next_part()
            return
        if time.monotonic() < self._refused_until:
            self._lose(ticks)  # it was put here before the refusal; what follows begins with a header
            return
        self._inside.write(data, ticks)
        if self._inside.trouble:
            self._refuse(self._inside.trouble, ticks)
        elif self._queue.qsize() < self._waiting_max // 2:
            self.trouble = ""
        if time.monotonic() >= self._sync_at:
            self._sync_at = time.monotonic() + SYNC_S
            self._inside.sync()
            if self._inside.trouble:
                self._refuse(self._inside.trouble, 0)

    def _lose(self, ticks: int) -> None:
        self.lost, self.dropped = self.lost + 1, self.dropped + ticks

    def _refuse(self, trouble: str, ticks: int) -> None:
        self.trouble = trouble
        self._lose(ticks)
        self._refused_until = time.monotonic() + self._retry


Sink: TypeAlias = FileSink | FolderSink | ThreadedSink
"""Takes a log's bytes in order: `write` appends all that it is given, or nothing of it."""


def appended(file: int, data: bytes) -> OSError | None:
    """Append all of `data` to an open file; where it does not fit nothing of it stays. Return what went wrong.

    A record in two halves would make all behind it unreadable.
    """
    written = 0
    try:
        # only of what is left over does the system say why it does not fit
        while written < len(data):
            written += os.write(file, data[written:])
    except OSError as error:
        if written:
            with contextlib.suppress(OSError):
                os.ftruncate(file, os.fstat(file).st_size - written)
        return error
    return None


def following_parts(path: Path) -> list[Path]:
    """Return the log at `path` and the parts that follow it beside it, in their order."""
    found = PART_NAME.fullmatch(path.name)
    parts = [path]
    while found is not None:
        later = path.with_name(f"{found['run']}{int(found['part']) + len(parts):03d}.tlog")
        if not later.exists():
            break
        parts.append(later)
    return parts


def run_number(path: Path) -> int:
    """Return the number of the run that a log of a folder is of, 0 for any other file."""
    found = RUN_NAME.fullmatch(path.name)
    return int(found["number"]) if found else 0


def part_number(path: Path) -> int:
    """Return the number of a part in its run, 0 for any other file."""
    found = PART_NAME.fullmatch(path.name)
    return int(found["part"]) if found else 0


@contextlib.contextmanager
def _one_at_a_time(folder: Path) -> Iterator[None]:
    """Hold the folder's lock, where its file system knows locks. Raises OSError."""
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        with contextlib.suppress(OSError):
            fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield
    finally:
        os.close(descriptor)
