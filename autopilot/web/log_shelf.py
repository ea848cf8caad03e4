"""The logs that can be downloaded: the files of one folder, by their plain names."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from autopilot.errors import NotYetError

SUFFIXES = (".tlog", ".html", ".csv", ".yaml")
SHOWN_MOST = 200
PIECE = 65536


class LogShelf:
    """`listing` and `path_of` see nothing outside of the folder. None: no folder was given, nothing is listed."""

    def __init__(self, folder: Path | None) -> None:
        if folder is not None and not folder.is_dir():
            raise NotYetError(f"--logs {folder}: no folder there; give the folder that `autopilot run --log` writes to")
        self._folder = folder

    @property
    def is_there(self) -> bool:
        """Whether a folder was given."""
        return self._folder is not None

    def listing(self) -> list[dict[str, Any]]:
        """Return name, size [bytes] and time of change [s since 1970] of each log, the newest first."""
        if self._folder is None:
            return []
        rows: list[dict[str, Any]] = []
        for path in self._folder.iterdir():
            if self._is_log(path):
                about = path.stat()
                rows.append({"name": path.name, "bytes": about.st_size, "changed": round(about.st_mtime)})
        rows.sort(key=lambda row: row["changed"], reverse=True)
        return rows[:SHOWN_MOST]

    def path_of(self, name: str) -> Path | None:
        """Return the path of a log by its name, None where there is no such log."""
        if self._folder is None or "/" in name or "\0" in name or name.startswith("."):
            return None
        path = self._folder / name
        return path if self._is_log(path) else None

    def read(self, path: Path) -> tuple[int, Iterator[bytes]]:
        """Return the size [bytes] that a log has now and that much of it, piece by piece: a run may be writing on."""
        size = path.stat().st_size

        def pieces() -> Iterator[bytes]:
            left = size
            with path.open("rb") as file:
                while left > 0 and (piece := file.read(min(left, PIECE))):
                    left -= len(piece)
                    yield piece

        return size, pieces()

    def _is_log(self, path: Path) -> bool:
        # a name that is no text cannot be told, nor asked for
        is_name = path.suffix in SUFFIXES and path.name.isprintable() and not path.name.startswith(".")
        return is_name and not path.is_symlink() and path.is_file()
