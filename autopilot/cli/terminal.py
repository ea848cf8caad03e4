"""The terminal of a program that steers: a status line that fits it, lines typed below it, output that never waits.

Nothing here can hold up or end the steering: a terminal that is stopped (Ctrl-S), a pipe that nobody empties and a full
disk lose what is said to them.

A progress bar on the terminal's error output; silent where that is no terminal.
"""

from __future__ import annotations

import contextlib
import io
import math
import os
import select
import shutil
import sys
import termios
from collections.abc import Callable, Iterator
from typing import Any, TextIO, cast

from autopilot.angles import compass_text
from autopilot.files.printable import PrintableStream, folded, printable, rewrite_line
from autopilot.signals import AlarmEvent, Mode, OrderKind, RudderSample, Tick
from autopilot.supervision.panel import sentences_of

WIDTH = 30


class ProgressBar:
    """Shows `label [####      ] 12/40` and wipes itself away at the end. Use it as a context manager."""

    def __init__(self, label: str) -> None:
        self._label = label
        self._is_terminal = sys.stderr.isatty()
        self._line = ""

    def __enter__(self) -> ProgressBar:
        return self

    def update(self, done: int, total: int) -> None:
        """Draw the bar; `total` 0 means that it is not known yet."""
        if not self._is_terminal:
            return
        filled = WIDTH * done // total if total else 0
        self._show(f"{self._label} [{'#' * filled}{' ' * (WIDTH - filled)}] {done}/{total or '?'}")

    def update_share(self, done: int, total: int) -> None:
        """Draw the bar with the share that is done in per cent, for bytes and ticks, which nobody counts."""
        if self._is_terminal and total:
            filled, share = WIDTH * done // total, 100 * done // total
            self._show(f"{self._label} [{'#' * filled}{' ' * (WIDTH - filled)}] {share} %")

    def _show(self, line: str) -> None:
        if line != self._line:
            self._line = line
            rewrite_line(sys.stderr, line)

    def __exit__(self, *_: object) -> None:
        if self._line:
            rewrite_line(sys.stderr, "")


STATUS_PERIOD = 0.5
ALARM_CHARACTERS = 400
CHUNK = 512
MEASURED_S = 3.0
"""So long after its last word a rudder sensor counts as one."""
NARROWEST = 20
HANGING = 12
"""Blanks before what goes on from a line that begins with the time."""
WIDEST_TYPED = 30
TYPED_MOST = 200
"""Characters of a typed line; what a held key or a pasted file brings beyond them is dropped."""
BACKSPACE = "\b\x7f"
KILL = "\x15"
"""Ctrl-U: the line is begun anew."""


class Steady(io.TextIOBase):
    """Output to a descriptor that neither waits nor fails: what cannot be written now is lost."""

    def __init__(self, descriptor: int) -> None:
        self._descriptor = self._unwaiting = descriptor
        self._blocks_again = False
        if os.isatty(descriptor):
            # that there is room says nothing of a terminal: one that is stopped a moment later, or has room for a part
            # alone, keeps who writes until somebody takes it
            self._unwaiting = _opened_anew(descriptor, os.O_WRONLY)
            self._blocks_again = self._unwaiting == descriptor and os.get_blocking(descriptor)
        if self._blocks_again:
            os.set_blocking(descriptor, False)

    def give_back(self) -> None:
        """Leave the descriptor as it was found."""
        if self._blocks_again:
            os.set_blocking(self._descriptor, True)
        elif self._unwaiting != self._descriptor:
            os.close(self._unwaiting)
        self._unwaiting, self._blocks_again = self._descriptor, False

    @property
    def encoding(self) -> str:  # type: ignore[override]
        """UTF-8."""
        return "utf-8"

    def fileno(self) -> int:
        """Return the descriptor."""
        return self._descriptor

    def isatty(self) -> bool:
        """Return whether it is a terminal."""
        return os.isatty(self._descriptor)

    def writable(self) -> bool:
        """Return True."""
        return True

    def write(self, text: str) -> int:
        """Write what there is room for."""
        data = text.encode(errors="replace")
        with contextlib.suppress(OSError, ValueError):
            for at in range(0, len(data), CHUNK):
                if not select.select((), (self._unwaiting,), (), 0.0)[1]:
                    break
                os.write(self._unwaiting, data[at : at + CHUNK])
        return len(text)


def _opened_anew(descriptor: int, to: int) -> int:
    """Return a descriptor of the same terminal that never waits, `to` read or write, for us alone: the shell and what
    it starts share the one that we were given. That one where it may not be opened, as after sudo -u."""
    try:
        return os.open(os.ttyname(descriptor), to | os.O_NOCTTY | os.O_NONBLOCK | os.O_CLOEXEC)
    except OSError:
        return descriptor


@contextlib.contextmanager
def steady_output() -> Iterator[None]:
    """Let standard output and error be `Steady` within the block."""
    with contextlib.ExitStack() as after:
        output, error = _steady(sys.stdout, after), _steady(sys.stderr, after)
        with contextlib.redirect_stdout(output), contextlib.redirect_stderr(error):
            yield


def _steady(stream: TextIO, after: contextlib.ExitStack) -> TextIO:
    try:
        stream.flush()
        descriptor = stream.fileno()
    except (OSError, ValueError, AttributeError):  # a test's, or none
        return stream
    steady: Any = Steady(descriptor)
    after.callback(steady.give_back)
    kept: Any = PrintableStream(steady) if isinstance(stream, PrintableStream) else steady
    return cast("TextIO", kept)


class TypedLines:
    """Lines typed on standard input, key by key, so that the status line and what is typed do not overwrite each other.

    In the background nothing is read: a process that tries is stopped by the system, with the rudder where it is.
    """

    def __init__(self) -> None:
        self.text = ""
        """What has been typed of the next line."""
        self._input = self._unwaiting = sys.stdin.fileno()
        self._before: list[object] | None = None

    def poll(self) -> list[str]:
        """Return the lines that are complete; never waits."""
        if self._input < 0 or not self._is_ours():
            return []
        if self._before is None:
            self._take_keys()
        lines: list[str] = []
        for key in self._keys():
            if key in "\r\n":
                lines.append(self.text)
                self.text = ""
            elif key in BACKSPACE:
                self.text = self.text[:-1]
            elif key == KILL:
                self.text = ""
            elif key.isprintable() and len(self.text) < TYPED_MOST:
                self.text += key
        return lines

    def close(self) -> None:
        """Give the terminal back as it was."""
        if self._before is not None and self._is_ours():
            with contextlib.suppress(termios.error):
                termios.tcsetattr(self._input, termios.TCSANOW, self._before)  # type: ignore[arg-type]
        self._before = None
        if self._unwaiting != self._input >= 0:
            os.close(self._unwaiting)
        self._input = self._unwaiting = -1

    def _is_ours(self) -> bool:
        try:
            return os.tcgetpgrp(self._input) == os.getpgrp()
        except OSError:
            return False

    def _take_keys(self) -> None:
        with contextlib.suppress(termios.error):
            self._before = termios.tcgetattr(self._input)
            self._unwaiting = _opened_anew(self._input, os.O_RDONLY)
            after = termios.tcgetattr(self._input)
            after[3] &= ~(termios.ICANON | termios.ECHO)
            after[6][termios.VMIN], after[6][termios.VTIME] = 0, 0
            termios.tcsetattr(self._input, termios.TCSANOW, after)

    def _keys(self) -> str:
        try:
            if not select.select((self._unwaiting,), (), (), 0.0)[0]:
                return ""
            # nothing where another reader of the terminal, such as a pager behind us, was quicker
            return os.read(self._unwaiting, CHUNK).decode(errors="replace")
        except BlockingIOError:
            return ""
        except OSError:  # the terminal is gone
            self.close()
            return ""


class StatusLine:
    """One line that is rewritten on a terminal; elsewhere a line for each change of mode or alarm."""

    def __init__(
        self,
        describe: Callable[[Tick], str] | None = None,
        typed: TypedLines | None = None,
        magnetic: bool = False,
    ) -> None:
        """describe: what stands before the status, such as how far a trial has come.  magnetic: headings are."""
        self._describe = describe
        self._north = "M" if magnetic else ""
        self._typed = typed
        self._live = sys.stdout.isatty()
        self._next = -math.inf
        self._printed: tuple[Mode, tuple[AlarmEvent, ...]] | None = None
        self._printed_text = ""
        self._measured = -math.inf

    def update(self, tick: Tick) -> None:
        """Show the tick where it is time to."""
        if any(isinstance(sample, RudderSample) and not sample.ordered for sample in tick.samples):
            self._measured = tick.now
        text = self._typed.text if self._typed is not None else ""
        if (tick.mode, tick.alarms) != self._printed:
            self._printed = (tick.mode, tick.alarms)
            said = "".join(f"  ! {printable(said, ALARM_CHARACTERS)}" for said in sentences_of(tick.alarms))
            self.print_line(f"{tick.now:8.1f} s  {tick.mode.name}{said}")
        elif self._live and (tick.now >= self._next or text != self._printed_text):
            self._next = tick.now + STATUS_PERIOD
            self._printed_text = text
            ahead = self._describe(tick) if self._describe is not None else ""
            is_measured = tick.now - self._measured <= MEASURED_S
            rewrite_line(sys.stdout, line_of(tick, is_measured, ahead, text, columns(), self._north))

    def end(self) -> None:
        """Leave the line, and give the keys back."""
        if self._typed is not None:
            self._typed.close()
        if self._live:
            rewrite_line(sys.stdout, "")

    def print_line(self, text: str) -> None:
        """Print a text above the line."""
        if self._live:
            rewrite_line(sys.stdout, folded(text, columns(), HANGING if text.startswith(" ") else 0), "\n")
        else:
            print(text, flush=True)
        self._next = -math.inf


def columns() -> int:
    """Return the width of the terminal."""
    try:
        width = os.get_terminal_size(sys.stdout.fileno()).columns
    except (OSError, ValueError):
        width = 0
    return width or shutil.get_terminal_size().columns


def line_of(tick: Tick, is_measured: bool, ahead: str, typed: str, width: int, north: str = "") -> str:
    """Return the status and what is typed in one line that leaves the terminal's last column free."""
    entry = f"  > {typed[-WIDEST_TYPED:]}" if typed else ""
    status = status_text(tick, is_measured, max(width - 1 - len(entry), NARROWEST), ahead, north)
    return f"{status}{entry}"[-max(width - 1, 1) :]


def status_text(tick: Tick, is_measured: bool, width: int, ahead: str = "", north: str = "") -> str:
    """Return the status of a tick within `width` characters: what matters less is left out where it does not fit.

    Course ordered and heading are shown as on a compass, 000 to 359; the rudder as measured where a sensor shows it
    (`is_measured`), else as ordered. north: the letter behind headings that are not true, M.
    """
    state, mode = tick.state, tick.mode.name
    if not state.valid:
        return f"{mode}  no heading yet"[:width]
    rudder = math.degrees(state.rudder if is_measured else tick.command.angle)
    shown = (
        f"{rudder:+.1f} {'measured' if is_measured else 'ordered'}" if is_measured or tick.command.engaged else "free"
    )
    course = course_text(tick)
    parts = [
        (0, ahead),
        (0, mode),
        (5 if ahead and course == "---" else 0, f"course {course}{north}"),
        (0, f"heading {compass_text(state.heading)}{north}"),
        (0, f"rudder {shown}"),
        (1, f"{math.degrees(state.rate):+.1f} deg/s"),
        (2, f"{state.speed * 3600.0 / 1852.0:.1f} kn"),
        (4, f"bias {math.degrees(state.bias):+.1f}"),
    ]
    parts = [part for part in parts if part[1]]
    while len(text := "  ".join(words for _, words in parts)) > width:
        least = max(parts)
        if least[0] == 0:
            return text[:width]
        parts.remove(least)
    return text


def course_text(tick: Tick) -> str:
    """Return the course ordered, --- where none is."""
    order = tick.order
    if order.kind is OrderKind.HEADING and tick.mode is Mode.ENGAGED:
        return compass_text(order.heading if math.isfinite(order.heading) else tick.reference.heading)
    return compass_text(order.heading) if order.kind is OrderKind.HEADING and math.isfinite(order.heading) else "---"
