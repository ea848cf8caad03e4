"""What goes wrong, in one sentence each, and the exit code that says so."""

from __future__ import annotations

import errno
from enum import IntEnum

from autopilot.files.printable import brief


class ExitCode(IntEnum):
    """Exit codes of the commands; documented in docs/safety.md."""

    OK = 0
    USAGE = 2
    LINK = 3
    REFUSED = 4
    FAILSAFE = 5
    DIFFERENT = 6


class InputError(ValueError):
    """A file, option or record that cannot be used. The message names it, the value, and what is allowed.

    However long what it quotes, the message is short.
    """

    def __init__(self, message: str = "") -> None:
        super().__init__(brief(message))

    def each(self) -> list[InputError]:
        """Return the mistakes one by one: this one, where it is not a collection."""
        return [self]


class LinkError(Exception):
    """A link could not be opened or has been lost. The message, which is short, names it, what happened, what to do."""

    def __init__(self, message: str = "") -> None:
        super().__init__(brief(message))


UNREACHABLE = (errno.EACCES, errno.ENAMETOOLONG)


def unreachable(error: OSError) -> InputError:
    """Return the sentence for a path that cannot even be looked at; raises any other error as it is."""
    if error.filename is None or error.errno not in UNREACHABLE:
        raise error
    return InputError(f"{error.filename}: {error.strerror}; give another file, which you may read or write.")


class NotYetError(InputError):
    """A file or folder that is not there, but may come."""


class SeveralInputError(InputError):
    """Several mistakes in one file: its message is that of the first, and says how many more there are."""

    def __init__(self, errors: list[InputError]) -> None:
        more = f"{len(errors) - 1} more mistake{'s' if len(errors) > 2 else ''}"
        super().__init__(f"{errors[0]} ({more}; autopilot params check lists all.)")
        self._errors = errors

    def each(self) -> list[InputError]:
        """Return the mistakes one by one."""
        return list(self._errors)


class RefusedError(Exception):
    """The pilot will not do what was asked. The message says why and what would change that."""
