"""A program as it is started: signals first, then all the rest; `python -m autopilot` is the `autopilot` command."""

import errno
import os
import sys
from collections.abc import Callable

from autopilot.interruption import Interrupted, end, take_signals

DISK = {
    **dict.fromkeys((errno.ENOSPC, errno.EDQUOT, errno.EIO), "free the disk"),
    errno.EFBIG: "raise the limit of a file's size (ulimit -f)",
}
"""What to do where what is printed goes into a file that takes no more."""


def autopilot() -> None:
    """Run `autopilot` and end with its exit code."""
    start("autopilot", _autopilot)


def _autopilot() -> int:
    from autopilot.cli.main import main

    return main()


def start(program: str, run: Callable[[], int]) -> None:
    """Run a program, which imports what it needs when it is called, and end with its exit code."""
    open_standard_streams()
    take_signals(program, next((word for word in sys.argv[1:] if not word.startswith("-")), ""))
    try:
        code = run()
        sys.stdout.flush()
    except Interrupted as signal:
        end(signal.number)
    except BrokenPipeError:
        # the reader of our output went away (head, less): nothing left to tell anybody
        _silence()
        code = 0
    except OSError as error:
        if error.errno not in DISK:
            raise
        _silence()
        where = f"{error.filename}: " if error.filename else ""
        os.write(2, f"{program}: {where}{error.strerror}; {DISK[error.errno]} and start again\n".encode())
        code = 2
    sys.exit(code)


def open_standard_streams() -> None:
    """Open onto the null device what the starter has closed of 0, 1 and 2, or the next file or link would get them."""
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        try:
            os.fstat(number)
        except OSError:
            opened = os.open(os.devnull, os.O_RDWR)  # the lowest descriptor that is free
            os.set_inheritable(opened, True)
            setattr(sys, name, open(opened, "w" if number else "r", encoding="utf-8", closefd=False))  # noqa: SIM115


def _silence() -> None:
    """What still waits to be printed goes nowhere: at the end of the program it would fail again."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


if __name__ == "__main__":
    autopilot()
