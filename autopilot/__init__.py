"""Norrbin: a MAVLink-connected autopilot bridge for boats."""

import sys

__version__ = "0.1.0"

if sys.version_info < (3, 11):  # noqa: UP036 - said before any newer syntax is met
    sys.exit(
        "Norrbin needs Python 3.11 or newer; this is {} of version {}.{}".format(sys.executable, *sys.version_info)
    )
