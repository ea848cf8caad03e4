"""Files that are either old or new, never half: written beside, flushed to disk, renamed.

A link stays and what it leads to is replaced; a pipe, a terminal or another device stays too, and is written into. What
replaces a file has its owner, group and mode, where this user may give them.
A file that may not be had again (a recording, a backup) never replaces another: it takes the next free name,
run.tlog, run-2.tlog, run-3.tlog. While it is written it is locked (flock), and nothing here replaces or removes a file
that is locked.
"""

from __future__ import annotations

import contextlib
import errno
import fcntl
import itertools
import math
import os
import shutil
import stat
import sys
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from autopilot.errors import InputError, RefusedError
from autopilot.files.outside import read_regular
from autopilot.signals import AlarmEvent

if TYPE_CHECKING:
    from concurrent.futures import Future, ThreadPoolExecutor

Result = TypeVar("Result")

MOST_NUMBERS = 100_000
PAGE_BEGINNINGS = (b"<!doctypehtml", b"<html")
SCHEMA_BEGINNINGS = (b'{"$schema"',)
"""How a file of the kind begins, in small letters and without spaces."""
FULL = (errno.ENOSPC, errno.EDQUOT)
"""Why a disk takes nothing more, which may pass."""
TOO_BIG = "no file may be so big here: raise the limit (ulimit -f), or use a disk that takes bigger ones"


def save_text(path: str | Path, text: str, *, overwrite: bool = True) -> None:
    """Write `text` to `path` atomically; raises InputError with the sentence why it cannot be written."""
    path = Path(path)
    if not overwrite:
        refuse_existing(path)
    try:
        replace_file(path, text)
    except OSError as error:
        raise _unwritable(path, error) from None


class Worker:
    """A thread for work that takes longer than a tick, started with the first piece of it."""

    def __init__(self, name: str) -> None:
        self._name = name
        self._pool: ThreadPoolExecutor | None = None

    def submit(self, work: Callable[..., Result], *arguments: Any) -> Future[Result]:
        """Do a piece of work behind those before it."""
        if self._pool is None:
            from concurrent.futures import ThreadPoolExecutor

            self._pool = ThreadPoolExecutor(1, thread_name_prefix=self._name)
        return self._pool.submit(work, *arguments)

    def shutdown(self) -> None:
        """Wait until all is done."""
        if self._pool is not None:
            self._pool.shutdown()


RETRY_FIRST_S, RETRY_MOST_S = 1.0, 60.0
"""So long [s] after a file could not be written it is tried again: at first, twice as long each time, at most."""


class BackgroundSaver:
    """Saves files from a thread of its own: flushing to a memory card takes longer than a tick. Call it to save.

    What cannot be written is kept, the newest of each file, and tried again by `retry` and once more by `close`.

    warn: is called with what went wrong, once for each file until it is saved again, and then with that.

    Attributes:
        alarm: why what was to be saved is not, None while all is.
    """

    def __init__(self, warn: Callable[[str], None]) -> None:
        self._warn, self._worker = warn, Worker("save")
        self._newest: dict[Path, str] = {}
        self._unsaved: dict[Path, str] = {}
        self._wait, self._due = RETRY_FIRST_S, math.inf
        self.alarm: AlarmEvent | None = None

    def __call__(self, path: Path, text: str) -> None:
        self._newest[path] = text
        self._submit(path)

    def retry(self, now: float) -> None:
        """Try again what could not be written, where that is due at `now` [s]; call it often while `alarm` is set."""
        if self._due == math.inf:
            self._due = now + self._wait
        elif now >= self._due:
            self._wait = min(2.0 * self._wait, RETRY_MOST_S)
            self._due = now + self._wait
            for path in [*self._newest]:
                self._submit(path)

    def close(self) -> None:
        """Try what is left once more, wait until all is done, and say what is lost."""
        for path in [*self._newest]:
            self._submit(path)
        self._worker.shutdown()
        for reason in self._unsaved.values():
            # the rudder is given back behind this, and what is said may go to the same full disk
            with contextlib.suppress(OSError, ValueError):
                self._warn(f"a change is lost: {reason}")

    def _submit(self, path: Path) -> None:
        self._worker.submit(self._write, path).add_done_callback(partial(self._note, path))

    def _write(self, path: Path) -> None:
        text = self._newest.pop(path, None)
        if text is None:
            return  # written with a piece of work before this one
        try:
            save_text(path, text)
        except BaseException:
            self._newest.setdefault(path, text)  # a newer one that came meanwhile stays
            raise

    def _note(self, path: Path, done: Future[None]) -> None:
        error, is_known = done.exception(), path in self._unsaved
        if error is not None:
            self._unsaved[path] = str(error)
        else:
            self._unsaved.pop(path, None)
        unsaved = (*self._unsaved.values(),)
        if not unsaved:
            self._wait, self._due = RETRY_FIRST_S, math.inf
        self.alarm = AlarmEvent("change_not_kept", unsaved[0].partition("; ")[0]) if unsaved else None
        # last: what is said may go to the same full disk, and be refused there
        if error is not None and not is_known:
            self._warn(f"a change is not kept, and tried again: {error}")
        elif error is None and is_known:
            self._warn(f"kept now: {path}")


def save_page(path: str | Path, page: str) -> None:
    """Write an HTML page atomically, over an older page alone: a report is made again, a log is not. InputError."""
    _save_again(path, page, PAGE_BEGINNINGS, "page of a report; give another name, such as a .html")


def save_schema(path: str | Path, schema: str) -> None:
    """Write a JSON Schema atomically, over an older one alone: never over the file it describes. InputError."""
    _save_again(path, schema, SCHEMA_BEGINNINGS, "JSON Schema; give another name, such as a .schema.json")


def _save_again(path: str | Path, text: str, beginnings: tuple[bytes, ...], kind: str) -> None:
    try:
        before = read_regular(path, 64) if os.path.isfile(path) else b""  # noqa: PTH113
    except OSError as error:
        raise _unwritable(path, error) from None
    if before and not b"".join(before.lower().split()).startswith(beginnings):
        raise InputError(f"{path}: exists already and is no {kind}.")
    save_text(path, text)


def save_unused(path: Path, text: str) -> Path:
    """Write `text` whole to `path`, or to its next free name; return where. Raises InputError."""
    try:
        descriptor, found = create_unused(path)
        is_new = stat.S_ISREG(os.fstat(descriptor).st_mode) and not is_standard_output(found)
        with open(descriptor, "w", encoding="utf-8") as file:  # noqa: PTH123 - a descriptor, not a path
            try:
                file.write(text)
                file.flush()
                if is_new:
                    os.fsync(descriptor)
            except OSError:
                if is_new:
                    found.unlink()
                raise
        sync_folder(found.parent)
    except OSError as error:
        raise _unwritable(path, error) from None
    return found


def refuse_existing(path: str | Path) -> None:
    """Raise InputError where a file or a folder is at `path`: said before the work, not after it. An empty file, as a
    program that was killed at its start leaves one, holds nothing to lose."""
    _refuse_folder(path)
    if os.path.isfile(path) and os.path.getsize(path) and not is_standard_output(path):  # noqa: PTH113, PTH202
        raise InputError(f"{path}: exists already; give another name, or --overwrite to replace it.")


def _refuse_folder(path: str | Path) -> None:
    if os.path.isdir(path):  # noqa: PTH112 - of what must not be looked at nothing is known here
        raise InputError(f"{path}: is a folder; give the name of a file.")


def numbered(path: Path) -> Iterator[Path]:
    """Yield `path`, then run-2.tlog, run-3.tlog and so on for run.tlog; what has no name (., /) alone."""
    yield path
    if not path.name:
        return
    for number in range(2, MOST_NUMBERS):
        yield path.with_name(f"{path.stem}-{number}{path.suffix}")


def create_unused(path: Path) -> tuple[int, Path]:
    """Return a descriptor to append to a new, locked file, and its name: `path`, or its next free one.

    A device, or a pipe that somebody reads, is opened as it is; one that nobody reads is OSError ENXIO. Raises OSError.
    """
    for name in numbered(path):
        try:
            descriptor = os.open(name, os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_EXCL, 0o644)
        except FileExistsError:
            if name.is_dir():
                raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR)) from None
            if (name.is_file() and not is_standard_output(name)) or not name.exists():
                continue
            return _open_as_it_is(name), name
        lock(descriptor)
        return descriptor, name
    raise FileExistsError(errno.EEXIST, "is not empty, and all names beside it are taken")


class Over:
    """The file at `path`, to be written anew bit by bit, or the pipe or device there: locked from now on, opened as
    `descriptor`. What it holds stays until `begin`.

    For what cannot be put in place when it is whole. Raises OSError.
    """

    def __init__(self, path: Path) -> None:
        self._is_file, self._made = _is_replaced(path), None
        if not self._is_file:
            self.descriptor = _open_as_it_is(path)
            return
        refuse_in_use(path)
        self._made = None if path.exists() else path.resolve()
        self.descriptor = os.open(path, os.O_WRONLY | os.O_CREAT, 0o666)
        lock(self.descriptor)

    def begin(self) -> None:
        """Empty the file, for what comes now. Raises OSError."""
        if self._is_file:
            os.ftruncate(self.descriptor, 0)
        self._made = None

    def close(self) -> None:
        """End the file; one that was made for what never came goes."""
        if self._made is not None:
            self._made.unlink(missing_ok=True)
        os.close(self.descriptor)


def _open_as_it_is(path: Path) -> int:
    """Return a descriptor to write into the pipe or device at `path`, waiting for nobody. Raises OSError."""
    if is_standard_output(path):
        sys.stdout.flush()
        return os.dup(1)
    mode = path.stat().st_mode
    if stat.S_ISBLK(mode) or stat.S_ISSOCK(mode):
        raise OSError(errno.EINVAL, "a disk or a socket, not a file")
    try:
        # without O_NONBLOCK, opening a pipe waits for its reader
        descriptor = os.open(path, os.O_WRONLY | os.O_APPEND | os.O_NONBLOCK | os.O_NOCTTY)
    except OSError as error:
        if error.errno == errno.ENXIO and stat.S_ISFIFO(mode):
            raise OSError(errno.ENXIO, "nobody reads this pipe") from None
        raise
    os.set_blocking(descriptor, True)
    return descriptor


def is_standard_output(path: str | Path) -> bool:
    """Return whether what is written to `path` goes where this process prints."""
    try:
        return os.path.samestat(Path(path).stat(), os.fstat(1))
    except OSError:
        return False


def _is_replaced(path: Path) -> bool:
    """Return whether `path` is to be replaced by a new file, not written into as it is. Raises OSError."""
    try:
        mode = path.stat().st_mode
    except FileNotFoundError:
        return True
    return stat.S_ISREG(mode) and not is_standard_output(path)


def _write_into(path: Path, write: Callable[[Path], object]) -> None:
    """Let `write` fill a file elsewhere, and pass on what it holds to the pipe or device. Raises OSError."""
    import tempfile

    with open(_open_as_it_is(path), "wb") as into, tempfile.TemporaryDirectory() as folder:
        whole = Path(folder) / "whole"
        write(whole)
        with whole.open("rb") as file:
            shutil.copyfileobj(file, into)


def newer_numbered(path: Path) -> Path | None:
    """Return the newest file that was written because `path` existed, run-2.tlog beside run.tlog; None: none is."""
    newest, newest_time = None, -math.inf
    with contextlib.suppress(OSError, ValueError):
        newest_time = path.stat().st_mtime
        for name in itertools.islice(numbered(path), 1, None):
            written = name.stat().st_mtime
            if written > newest_time:
                newest, newest_time = name, written
    return newest


def unused_folder(path: Path) -> Path:
    """Return an empty folder, made where it is missing: `path`, or its next free name. Raises OSError."""
    for name in numbered(path):
        if name is not path and name.is_file():
            continue
        name.mkdir(parents=True, exist_ok=True)
        if not any(name.iterdir()):
            return name
    raise FileExistsError(errno.EEXIST, "is not empty, and all names beside it are taken")


def lock(descriptor: int) -> None:
    """Keep the open file from being replaced or removed by us elsewhere, where the file system knows locks."""
    with contextlib.suppress(OSError):
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)


def alone(path: Path, refusal: str) -> int:
    """Return the descriptor of a file, made where it is missing, or of a folder, that this process alone holds until it
    closes it or ends. RefusedError with `refusal` where another holds it; OSError where it cannot be opened."""
    flags = os.O_RDONLY if path.is_dir() else os.O_RDWR | os.O_CREAT
    descriptor = os.open(path, flags | os.O_CLOEXEC, 0o666)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(descriptor)
        raise RefusedError(refusal) from None
    except OSError:
        pass  # a file system without locks
    return descriptor


def is_in_use(path: Path) -> bool:
    """Return whether another writer has the file at `path` locked."""
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
    except OSError:
        return False
    try:
        if not stat.S_ISREG(os.fstat(descriptor).st_mode):
            return False
        fcntl.flock(descriptor, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except OSError as error:
        return error.errno in (errno.EWOULDBLOCK, errno.EACCES)
    finally:
        os.close(descriptor)
    return False


def write_new(path: Path, write: Callable[[Path], object], *, private: bool = False) -> None:
    """Let `write` fill a file beside, flush it to disk, and only then give it the name `path`. Raises OSError.

    private: for its owner alone, and then a file or nothing; else what is no file gets what `write` wrote.
    """
    if not private and not _is_replaced(path):
        _write_into(path, write)
        return
    path = Path(os.path.realpath(path))
    refuse_in_use(path)
    if private and path.exists() and not path.is_file():
        raise OSError(errno.EINVAL, "Not a file but a pipe, socket or device")
    import tempfile

    descriptor, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    try:
        write(Path(temporary))
        os.fsync(descriptor)
        with _where_it_can_be(not private):
            os.fchmod(descriptor, _become(descriptor, path, private=private))
        Path(temporary).replace(path)
        sync_folder(path.parent)
    except BaseException:
        with contextlib.suppress(OSError):
            Path(temporary).unlink()
        raise
    finally:
        os.close(descriptor)


def _become(descriptor: int, path: Path, *, private: bool) -> int:
    """Give the open file to whom the file at `path` is, as far as this user may, and return the mode for it: that
    file's, or 0600 for a private one. That is given to the owner of the folder alone: somebody else who put a file
    there would get to know what is in it.
    """
    try:
        before, folder = path.stat(), path.parent.stat()
    except OSError:
        # mkstemp's 0600 would lock out the user's other programs
        return 0o600 if private else 0o666 & ~_umask()
    if private and before.st_uid != folder.st_uid:
        return 0o600
    for owner in (before.st_uid, -1):
        with contextlib.suppress(OSError):
            os.fchown(descriptor, owner, before.st_gid)
            break
    return 0o600 if private else before.st_mode & 0o777


def refuse_in_use(path: Path) -> None:
    """Raise OSError where a file is being written by another program of ours, such as a running pilot's log."""
    if is_in_use(path):
        raise OSError(errno.EBUSY, "a running program writes it")


def check_folder(path: str | Path) -> None:
    """Raise InputError where `path` is a folder, or in one that is not there or takes none: said before the work."""
    _refuse_folder(path)
    try:
        folder = Path(os.path.realpath(path)).parent
    except OSError as error:
        # the folder in which we were started is gone
        raise _unwritable(path, error) from error
    if not folder.is_dir():
        reason = errno.ENOENT
    elif os.access(folder, os.W_OK) or not _is_replaced(Path(path)):
        return
    else:
        reason = errno.EROFS if os.statvfs(folder).f_flag & os.ST_RDONLY else errno.EACCES
    raise _unwritable(path, OSError(reason, os.strerror(reason)))


def why_not(error: OSError) -> str:
    """Return why a file or a folder cannot be made: in the system's words where these do not mislead."""
    if error.errno == errno.ENOENT and error.filename and Path(error.filename).parent.is_dir():
        return "nothing can be kept there"
    if error.strerror == os.strerror(errno.EEXIST):
        return "a file of that name is there"
    return error.strerror or str(error)


def _unwritable(path: str | Path, error: OSError) -> InputError:
    if error.errno in FULL:
        cure = "free the disk, or give a file on another; what was there before is untouched"
    elif error.errno == errno.EFBIG:
        cure = TOO_BIG
    else:
        cure = "give another file, in a folder that you may write to"
    return InputError(f"{path}: cannot be written ({why_not(error)}); {cure}.")


def replace_file(path: Path, text: str, *, private: bool = False) -> None:
    """Write `text` to `path` atomically, a `private` file for its owner alone. Raises OSError."""
    write_new(path, lambda new: new.write_text(text, encoding="utf-8"), private=private)


def sync_folder(folder: Path) -> None:
    """Flush the folder itself, without which a new or removed name may not outlive a power cut."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        with _where_it_can_be():
            os.fsync(descriptor)
    finally:
        os.close(descriptor)


@contextlib.contextmanager
def _where_it_can_be(able: bool = True) -> Iterator[None]:
    """Do without what the disk does not know: sticks and shares have no modes of their own, and flush no folders."""
    try:
        yield
    except OSError as error:
        if not able or error.errno not in (errno.EINVAL, errno.ENOTSUP, errno.EPERM):
            raise


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
