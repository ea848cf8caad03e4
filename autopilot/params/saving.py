"""Files that are either old or new, never half: written beside, flushed to disk, renamed."""

from __future__ import annotations

import contextlib
import errno
import os
import tempfile
from pathlib import Path

from autopilot.errors import InputError


def save_text(path: str | Path, text: str, *, overwrite: bool = True) -> None:
    """Write `text` to `path` atomically; raises InputError with the sentence why it cannot be written."""
    path = Path(path)
    if not overwrite and path.exists():
        raise InputError(f"{path}: exists already; give another name, or --overwrite to replace it.")
    try:
        replace_file(path, text)
    except OSError as error:
        raise _unwritable(path, error.strerror) from None


def check_folder(path: str | Path) -> None:
    """Raise InputError where there is no folder to write `path` into: said before the work, not after it."""
    if not Path(path).absolute().parent.is_dir():
        raise _unwritable(path, os.strerror(errno.ENOENT))


def _unwritable(path: str | Path, why: str | None) -> InputError:
    return InputError(f"{path}: cannot be written ({why}); give a folder that you may write to.")


def replace_file(path: Path, text: str, *, private: bool = False) -> None:
    """Write `text` to `path` atomically, a `private` file for its owner alone. Raises OSError."""
    descriptor, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    try:
        with open(descriptor, "w", encoding="utf-8") as file:  # noqa: PTH123 - a descriptor, not a path
            file.write(text)
            file.flush()
            os.fsync(file.fileno())
        if not private:
            # mkstemp's 0600 would lock out the user's other programs
            Path(temporary).chmod(0o666 & ~_umask())
        Path(temporary).replace(path)
        sync_folder(path.parent)
    except BaseException:
        with contextlib.suppress(OSError):
            Path(temporary).unlink()
        raise


def sync_folder(folder: Path) -> None:
    """Flush the folder itself, without which a new or removed name may not outlive a power cut."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
