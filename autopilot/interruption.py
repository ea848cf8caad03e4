"""Ctrl-C and termination, from the first moment on: one line, one exit code, never a trace.

Imported before all else and importing next to nothing: most of the time from a key to a prompt goes into imports, and
an exception thrown into one of them comes out as anything. So at first a signal ends the process at once: nothing has
begun. What has begun and must be brought to an end (a rudder, a transaction, a table) takes the signals itself, or
asks for them as exceptions with `as_exceptions`.
"""

from __future__ import annotations

import contextlib
import os
import signal
import sys
from collections.abc import Callable, Iterator, Sequence

NAMES = {
    signal.SIGINT: "Ctrl-C",
    signal.SIGQUIT: "Ctrl-\\",
    signal.SIGTERM: "a termination signal",
    signal.SIGHUP: "the terminal's end",
}
STRAY = tuple(
    getattr(signal, name)
    for name in ("SIGUSR1", "SIGUSR2", "SIGALRM", "SIGVTALRM", "SIGPROF", "SIGIO", "SIGPWR", "SIGSTKFLT", "SIGXCPU")
    if hasattr(signal, name)
)
"""Signals that nobody is expected to send (a log rotation, a power monitor, a limit of processor time do), and whose
default is the death of the process: whoever holds a rudder takes them, too."""
REAL_TIME = tuple(range(signal.SIGRTMIN, signal.SIGRTMAX + 1)) if hasattr(signal, "SIGRTMIN") else ()
"""The same, by number: most of these have no name."""
STAYING = ("run", "trial", "web", "signalk", "helm", "serve", "ardupilot-physics")
"""Commands that go on until they are ended: for them a signal is the way it is meant to be."""
LEFT: list[Callable[[], None]] = []
"""What ends things outside this process (simulators, folders) when it is ended at once."""
AGAIN_S = 0.02
_owner = 0
_command = ("", "")


class Interrupted(KeyboardInterrupt):
    """A signal, where `as_exceptions` is in force."""

    def __init__(self, number: int) -> None:
        super().__init__(number)
        self.number = number


def take_signals(program: str, command: str) -> None:
    """Let the signals of NAMES end this process at once, with one line."""
    global _owner, _command
    _owner, _command = os.getpid(), (program, command)
    for number in NAMES:
        # who started us may have had a signal ignored: nohup, a shell's background job
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, _end)


def ended_by(number: int) -> str:
    """Return the name of a signal as a skipper knows it."""
    if number in REAL_TIME:
        return f"signal {number}"
    return NAMES.get(signal.Signals(number), signal.Signals(number).name)


def print_end(number: int) -> None:
    """Say in one line that a signal has ended the program."""
    with contextlib.suppress(BaseException):
        sys.stdout.flush()
    line_end = "\n" if os.isatty(2) else ""  # behind the ^C that the terminal shows
    with contextlib.suppress(OSError):
        os.write(2, f"{line_end}{_command[0] or 'norrbin'}: ended by {ended_by(number)}\n".encode())


def stop_on_signal() -> Callable[[], bool]:
    """Take Ctrl-C and termination, the first of which is said at once; return what tells whether one has come."""
    came: list[int] = []

    def take(number: int, _frame: object) -> None:
        if not came:
            print_end(number)
        came.append(number)

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, take)
    return lambda: bool(came)


def end(number: int) -> None:
    """Say that a signal has ended the program and leave, without waiting for threads. Does not return."""
    print_end(number)
    os._exit(0 if _command[1] in STAYING else 128 + number)


@contextlib.contextmanager
def _handled_by(handler: Callable[[int, object], None]) -> Iterator[None]:
    """Give every signal that is not ignored to the handler within the block."""
    before = {number: signal.getsignal(number) for number in NAMES}
    if os.getpid() != _owner:  # called as a function: the signals are the caller's
        before = {}
    for number, usual in before.items():
        if usual is not signal.SIG_IGN:
            signal.signal(number, handler)
    try:
        yield
    finally:
        for number, usual in before.items():
            signal.signal(number, usual)


@contextlib.contextmanager
def as_exceptions() -> Iterator[None]:
    """Raise Interrupted for every signal within the block.

    Where Python drops what is raised (a callback of a fork, a destructor) it is raised again a little later.
    """

    def throw(number: int, _frame: object) -> None:
        if os.getpid() != _owner:
            os._exit(128 + number)
        raise Interrupted(number)

    def dropped(unraisable: sys.UnraisableHookArgs) -> None:
        error = unraisable.exc_value
        if not isinstance(error, Interrupted):
            hook(unraisable)
            return
        signal.signal(signal.SIGALRM, lambda _, frame: throw(error.number, frame))
        signal.setitimer(signal.ITIMER_REAL, AGAIN_S)

    with _handled_by(throw):
        hook, sys.unraisablehook = sys.unraisablehook, dropped
        try:
            yield
        finally:
            sys.unraisablehook = hook


def run_child(command: Sequence[str]) -> int:
    """Run a command to its own end and return its exit code. Raises Interrupted where a signal came meanwhile.

    Who presses Ctrl-C reaches both: the command lets its rudder go, and this process waits for that.
    """
    import subprocess

    came: list[int] = []
    child: subprocess.Popen[bytes] | None = None

    def take(number: int, _frame: object) -> None:
        came.append(number)
        if child is not None and number == signal.SIGTERM:  # no terminal sends it to both
            child.send_signal(number)

    # handlers, not SIG_IGN, which the command would inherit
    with _handled_by(take):
        child = subprocess.Popen(command)
        code = child.wait()
    if came:
        raise Interrupted(came[0])
    return code


def _end(number: int, _frame: object) -> None:
    if os.getpid() != _owner:  # a process of a pool: its owner speaks
        os._exit(128 + number)
    for leave in LEFT:
        with contextlib.suppress(BaseException):
            leave()
    end(number)
