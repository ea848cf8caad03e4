"""The options of every command that reads logs, and what they make of the vessel file."""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from autopilot.cli.option_numbers import SYSTEM_ID, number
from autopilot.errors import InputError
from autopilot.params.saving import newer_numbered

if TYPE_CHECKING:
    from autopilot.loop.recordings import LogOptions
    from autopilot.params.vessel import Vessel

KINDS_HELP = """\
a LOG is a .tlog (any MAVLink vehicle, or our own), an ArduPilot .BIN, a PX4 .ulg (extra `ulog`), NMEA 0183 sentences in
text, or a CSV table, known by its content. Several logs of one run: FILE+FILE, or FILE+FILE@SECONDS where the second
begins so much later than the first; without @ the offset is found from how the boat turned, or from the dates.
"""


def add_log_options(parser: argparse.ArgumentParser) -> None:
    """Add the options that say how to read logs and where the rudder comes from."""
    group = parser.add_argument_group("reading logs")
    group.add_argument("--columns", metavar="MAP.yaml", help="how CSV tables call their columns")
    group.add_argument(
        "--system", action=SYSTEM_ID, metavar="ID", help="MAVLink system to read (default: most attitudes)"
    )
    group.add_argument("--vessel", metavar="VESSEL.yaml", help="its steering gear moves a rudder known by orders only")
    group.add_argument(
        "--rudder",
        choices=("auto", "measured", "commands", "servo"),
        default="auto",
        help="where the rudder comes from",
    )
    group.add_argument(
        "--rudder-at-full-deg",
        action=number(-90.0, 90.0),
        metavar="DEG",
        help="rudder at full steering (default: the vessel file's)",
    )
    group.add_argument(
        "--servo", metavar="N:MIN:TRIM:MAX", help="the steering servo, where no parameter in the log says it"
    )
    group.add_argument(
        "--variation-deg",
        action=number(-180.0, 180.0),
        metavar="DEG",
        help="magnetic variation, east positive, for NMEA compasses",
    )


def vessel_of(arguments: argparse.Namespace) -> Vessel | None:
    """Return the vessel of `--vessel`, None without one. Raises InputError."""
    from autopilot.params.vessel_file import load_vessel

    return load_vessel(arguments.vessel) if arguments.vessel else None


def refuse_twice(logs: Iterable[str]) -> None:
    """Raise InputError where a file is given more than once, whatever it is called: it would count so many times."""
    from autopilot.loop.logs.merge import sources_of

    seen: dict[Path, str] = {}
    for log in logs:
        for source in sources_of(log):
            file = Path(source.path).resolve()
            if file in seen:
                also = "" if seen[file] == source.path else f", once as {seen[file]}"
                raise InputError(f"{source.path} is given twice{also}; a log counts once, leave one of them out.")
            seen[file] = source.path


def say_newer(logs: Iterable[str]) -> None:
    """Say on standard error which of `logs` an earlier run wrote: `--log` leaves what exists, and takes a new name."""
    for log in logs:
        newer = newer_numbered(Path(log))
        if newer is not None:
            print(f"{log} is read; the newest log of that name is {newer}", file=sys.stderr)


def log_options(arguments: argparse.Namespace, vessel: Vessel | None) -> LogOptions:
    """Return the options as the readers take them; `vessel`: of `--vessel`. Raises InputError."""
    from autopilot.build_laws import gear_of
    from autopilot.loop.csv_log import load_column_map
    from autopilot.loop.logs.reading import ReadOptions
    from autopilot.loop.logs.rudder import RudderSettings
    from autopilot.loop.logs.servo import Servo, ServoScale, servo_from_text
    from autopilot.loop.recordings import LogOptions

    variation = arguments.variation_deg
    full = arguments.rudder_at_full_deg
    if full is not None and not 1.0 <= abs(full) <= 90.0:
        raise InputError(f"--rudder-at-full-deg {full:g}: allowed is 1 to 90, negative where the servo is reversed")
    if full is None and vessel is not None:
        full = vessel.helm.rudder_at_full_pwm_deg or vessel.rudder.angle_max_deg
        full = -full if vessel.helm.reversed else full
    servo: Servo | ServoScale | None = servo_from_text(arguments.servo) if arguments.servo else None
    if servo is None and vessel is not None and vessel.helm.servo_us is not None:
        servo = ServoScale(*vessel.helm.servo_us)
    reading = ReadOptions(
        load_column_map(arguments.columns) if arguments.columns else None,
        arguments.system,
        servo,
        None if variation is None else math.radians(variation),
    )
    gear = None if vessel is None else gear_of(vessel)
    return LogOptions(reading, RudderSettings(arguments.rudder, None if full is None else math.radians(full), gear))
