"""`--signing-key`: one option for every command that speaks MAVLink."""

from __future__ import annotations

import argparse

from autopilot.links.mavlink.signing import Signing

HELP = "sign MAVLink messages with the key in FILE (mode 0600: 64 hex digits or a passphrase), and refuse unsigned ones"


def add_signing_option(parser: argparse.ArgumentParser) -> None:
    """Add `--signing-key`."""
    parser.add_argument("--signing-key", metavar="FILE", help=HELP)


def signing_of(arguments: argparse.Namespace) -> Signing | None:
    """Return signing with the key that was given, None without one. Raises InputError."""
    if arguments.signing_key is None:
        return None
    from autopilot.links.mavlink.signing_key import open_signing

    return open_signing(arguments.signing_key)
