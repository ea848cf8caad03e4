"""Reading whole files that somebody else has made: never a pipe or a device, whose end may never come, nor without a
limit.
"""

from __future__ import annotations

import errno
import os
import stat
from pathlib import Path

SIZE_MOST = 4 << 30
"""Bytes of the largest file that is read whole: days of any log."""
UNTOLD = 1 << 20
"""Bytes that are asked for of a file that tells no size, as those of /proc."""


def open_regular(path: str | Path) -> int:
    """Return a descriptor to read a regular file. Raises OSError for what is none; waits for nobody."""
    descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    mode = os.fstat(descriptor).st_mode
    if stat.S_ISREG(mode):
        return descriptor
    os.close(descriptor)
    if stat.S_ISDIR(mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
    raise OSError(errno.EINVAL, "Not a file but a pipe, socket or device")


def read_regular(path: str | Path, most: int = SIZE_MOST) -> bytes:
    """Return what a regular file holds as it is opened, at most `most` bytes of it.

    Raises OSError, also beyond SIZE_MOST and where the memory is too small for it.
    """
    with open(open_regular(path), "rb") as file:
        size = os.fstat(file.fileno()).st_size
        if most >= SIZE_MOST and size > SIZE_MOST:
            raise OSError(errno.EFBIG, os.strerror(errno.EFBIG))
        try:
            # no more than there is: all that is asked for is reserved before anything is read
            return file.read(min(most, size or UNTOLD))
        except MemoryError:
            raise OSError(errno.ENOMEM, os.strerror(errno.ENOMEM)) from None
