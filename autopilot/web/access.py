"""Who may give orders over the page: who has the token. Everybody else only looks."""

from __future__ import annotations

import hashlib
import hmac
import secrets
import stat
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import TypeVar

from autopilot.errors import InputError
from autopilot.order_values import is_same_token
from autopilot.params.saving import replace_file
from autopilot.regular_file import read_regular

TOKEN_BYTES = 18
SHORTEST = 16
TOKEN_FILE_MOST = 1024
TICKET_S = 120.0

Client = TypeVar("Client")


class Access:
    """Compares tokens in constant time, and gives out tickets for one download each of which a link can carry."""

    def __init__(self, token: str) -> None:
        if len(token) < SHORTEST:
            raise ValueError(f"a token has at least {SHORTEST} characters")
        self.token = token

    def allows(self, authorization: str) -> bool:
        """Return whether a request's Authorization header carries the token."""
        scheme, _, given = authorization.partition(" ")
        return scheme.lower() == "bearer" and is_same_token(given.strip(), self.token)

    def ticket(self, name: str, now: float) -> str:
        """Return a ticket for the file `name`, good for two minutes from `now` [s]."""
        until = f"{now + TICKET_S:.0f}"
        return f"{until}.{self._sign(name, until)}"

    def admits(self, ticket: str, name: str, now: float) -> bool:
        """Return whether a ticket is for this file and still good at `now` [s]."""
        until, _, signature = ticket.partition(".")
        if not (until.isascii() and until.isdecimal() and len(until) < 16) or now > float(until):
            return False
        return is_same_token(signature, self._sign(name, until))

    def _sign(self, name: str, until: str) -> str:
        return hmac.new(self.token.encode(), f"{until}\n{name}".encode(), hashlib.sha256).hexdigest()


def makes_room(strangers: Mapping[Client, str]) -> Client | None:
    """Return which client goes where the places are full and another comes; None: the newcomer has to.

    strangers: the address of each client that has not shown the token, the oldest first. The oldest of the address from
    which most come goes; who has shown the token keeps its place.
    """
    crowd = Counter(strangers.values())
    return max(strangers, key=lambda client: crowd[strangers[client]], default=None)


def token_of(path: Path | None) -> str:
    """Return the token kept in a file, made at first use and for its owner alone; without a file a new one.

    Raises InputError where the file cannot be used.
    """
    if path is None:
        return secrets.token_urlsafe(TOKEN_BYTES)
    try:
        if not path.exists():
            token = secrets.token_urlsafe(TOKEN_BYTES)
            replace_file(path, token + "\n", private=True)
            return token
        if stat.S_IMODE(path.stat().st_mode) & 0o077:
            raise InputError(f"--token-file {path}: others can read it; run chmod 600 {path}")
        token = read_regular(path, TOKEN_FILE_MOST).decode("ascii").strip()
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "not a text in ASCII"
        raise InputError(f"--token-file {path}: {reason}; give a file that only you can read and write") from error
    if len(token) < SHORTEST or any(not (character.isalnum() or character in "-_") for character in token):
        raise InputError(
            f"--token-file {path}: a token is one word of at least {SHORTEST} letters, digits, - and _; "
            "delete the file and a new one is made"
        )
    return token
