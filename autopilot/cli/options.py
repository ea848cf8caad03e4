"""Options of several commands: numbers, how long is waited for a link, the key that signs.

A number is read strictly, and refused in one sentence that says what is allowed. What is not there yet may come: a
device that is being plugged in, a program that is being started.
"""

from __future__ import annotations

import argparse
import math
import re
import sys
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, TypeVar

from autopilot.errors import InputError, NotYetError
from autopilot.files.outside import SHOWN, typed_number
from autopilot.files.printable import printable

if TYPE_CHECKING:
    from autopilot.links.mavlink.signing import Signing

WHOLE = re.compile(r"[+-]?[0-9]{1,20}")


class NumberOption(argparse.Action):
    """An option with a finite number from `low` to `high`, also whole where `is_whole`."""

    low = -math.inf
    high = math.inf
    is_whole = False

    def __call__(
        self,
        parser: argparse.ArgumentParser,
        namespace: argparse.Namespace,
        values: Any,
        option_string: str | None = None,
    ) -> None:
        """Set the number; raises InputError, which argparse passes on."""
        is_given = isinstance(values, str)  # else it is the const of an option without a value
        setattr(namespace, self.dest, self._read(values) if is_given else values)

    def _read(self, text: str) -> float:
        try:
            value = int(text) if self.is_whole and WHOLE.fullmatch(text) else typed_number(text)
        except InputError:
            value = math.nan
        if not self.low <= value <= self.high or (self.is_whole and not isinstance(value, int)):
            shown = printable(text, SHOWN) or repr(text)
            raise InputError(f"{self.option_strings[0]} {shown}: allowed is {self.allowed}")
        return value

    @property
    def allowed(self) -> str:
        """What is allowed, in words."""
        if self.is_whole:
            return f"a whole number from {self.low} to {self.high}"
        return "a number" if math.isinf(self.high) else f"{self.low:.10g} to {self.high:.10g}"


def number(low: float, high: float) -> type[NumberOption]:
    """Return the action of an option with a number; one without bounds, NumberOption itself, is looked at later."""
    return type("Number", (NumberOption,), {"low": low, "high": high})


def whole_number(low: int, high: int) -> type[NumberOption]:
    """Return the action of an option with a whole number."""
    return type("WholeNumber", (NumberOption,), {"low": low, "high": high, "is_whole": True})


SECONDS = number(0.001, 1.0e9)
"""Of a duration: up to thirty years."""
WAITING = number(0.0, 1.0e6)
SPEEDUP = number(0.001, 1.0e6)
SYSTEM_ID = whole_number(1, 255)
SEED = whole_number(0, 2**63 - 1)

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
        from autopilot.links.base import NotThereError, parted

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


SIGNING_HELP = (
    "sign MAVLink messages with the key in FILE (mode 0600: 64 hex digits or a passphrase), and refuse unsigned ones"
)


def add_signing_option(parser: argparse.ArgumentParser) -> None:
    """Add `--signing-key`."""
    parser.add_argument("--signing-key", metavar="FILE", help=SIGNING_HELP)


def signing_of(arguments: argparse.Namespace) -> Signing | None:
    """Return signing with the key that was given, None without one. Raises InputError."""
    if arguments.signing_key is None:
        return None
    from autopilot.links.mavlink.signing_key import open_signing

    return open_signing(arguments.signing_key)
