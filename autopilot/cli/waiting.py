"""What is not there yet may come: a device that is being plugged in, a program that is being started."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from typing import TypeVar

from autopilot.cli.option_numbers import WAITING
from autopilot.errors import NotYetError
from autopilot.links.base import NotThereError, parted

LINK_WAIT_S = 10.0
PAUSE_S = 0.1

Opened = TypeVar("Opened")


def add_waiting_option(parser: argparse.ArgumentParser) -> None:
    """Add `--link-wait`."""
    parser.add_argument(
        "--link-wait",
        action=WAITING,
        default=LINK_WAIT_S,
        metavar="S",
        help="wait this long for a device or connection that is not there yet (%(default)g; 0: do not wait)",
    )


class Patience:
    """Opens what may not be there yet, for so long [s] altogether; says once what it waits for."""

    def __init__(self, seconds: float) -> None:
        self._seconds = seconds
        self._until: float | None = None

    def __call__(self, opener: Callable[[], Opened]) -> Opened:
        """Return what `opener` opens, tried again while that is not there. Raises LinkError, InputError."""
        is_said = False
        while True:
            try:
                return opener()
            except (NotThereError, NotYetError) as error:
                now = time.monotonic()
                self._until = now + self._seconds if self._until is None else self._until
                if now >= self._until:
                    raise
                if not is_said:
                    is_said = True
                    left = self._until - now
                    what, _ = parted(str(error))
                    print(f"{what}: waiting up to {left:.0f} s for it (--link-wait)", file=sys.stderr, flush=True)
            time.sleep(PAUSE_S)


def patience_of(arguments: argparse.Namespace) -> Patience:
    """Return the patience that the options ask for."""
    return Patience(getattr(arguments, "link_wait", 0.0))
