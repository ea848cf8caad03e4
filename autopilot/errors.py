"""What goes wrong, in one sentence each, and the exit code that says so."""

from __future__ import annotations

from enum import IntEnum


class ExitCode(IntEnum):
    """Exit codes of the commands; documented in the README."""

    OK = 0
    USAGE = 2
    LINK = 3
    REFUSED = 4
    FAILSAFE = 5
    DIFFERENT = 6


class InputError(ValueError):
    """A file, option or record that cannot be used. The message names it, the value, and what is allowed."""


class RefusedError(Exception):
    """The pilot will not do what was asked. The message says why and what would change that."""
