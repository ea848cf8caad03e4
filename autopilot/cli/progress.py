"""A progress bar on the terminal's error output; silent where that is no terminal."""

from __future__ import annotations

import sys
from types import TracebackType

from autopilot.printable import rewrite_line

WIDTH = 30


class ProgressBar:
    """Shows `label [####      ] 12/40` and wipes itself away at the end. Use it as a context manager."""

    def __init__(self, label: str) -> None:
        self._label = label
        self._is_shown = sys.stderr.isatty()
        self._line = ""

    def __enter__(self) -> ProgressBar:
        return self

    def show(self, done: int, total: int) -> None:
        """Draw the bar; `total` 0 means that it is not known yet."""
        if not self._is_shown:
            return
        filled = WIDTH * done // total if total else 0
        line = f"{self._label} [{'#' * filled}{' ' * (WIDTH - filled)}] {done}/{total or '?'}"
        if line != self._line:
            self._line = line
            rewrite_line(sys.stderr, line)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._line:
            rewrite_line(sys.stderr, "")
