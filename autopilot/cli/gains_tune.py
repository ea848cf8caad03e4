"""`autopilot gains --tune`: gains optimised in simulation for a weight between heading error and rudder travel.

The simulator does it in a process of its own, `sitl tune`; what it proposes is judged here before anything is written.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from dataclasses import replace
from typing import Any

from autopilot.cli.options import number, whole_number
from autopilot.control.registry import designed_laws
from autopilot.errors import ExitCode, InputError, RefusedError

WEIGHT = number(0.0, 1.0e6)
"""0: the heading alone."""
GENERATIONS = whole_number(1, 10_000)


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of tuning."""
    parser.add_argument("--tune", action="store_true", help="optimise the gains of --law over a simulated campaign")
    parser.add_argument("--law", choices=designed_laws(), help="with --tune (default: the file's)")
    parser.add_argument(
        "--weight",
        action=WEIGHT,
        metavar="W",
        help="with --tune: deg of heading rms that a deg/s of rudder is worth (1)",
    )
    parser.add_argument("--study", metavar="STUDY.yaml", help="with --tune: seas and mismatches (default: sitl's own)")
    parser.add_argument("--generations", action=GENERATIONS, metavar="N", help="with --tune: of the search (10)")


def check_options(arguments: argparse.Namespace) -> None:
    """Raise InputError where options of tuning and of designing are mixed."""
    if not arguments.tune:
        for name in ("law", "weight", "study", "generations"):
            if getattr(arguments, name) is not None:
                raise InputError(f"--{name} goes with --tune")
        return
    for name in ("level", "bandwidth_rad_s", "damping", "spare_rudder", "report"):
        if getattr(arguments, name) is not None:
            raise InputError(f"--{name.replace('_', '-')} is for the design and does not go with --tune")


def tuned(arguments: argparse.Namespace) -> int:
    """Tune, print what held-out seeds say, write the vessel where asked; exit code 4 where no gains have margins."""
    from autopilot.cli.gains import write_vessel
    from autopilot.runtime.build import verdict_of
    from autopilot.vessel.file import load_vessel

    vessel = load_vessel(arguments.vessel)
    law = arguments.law or vessel.control.law
    section = getattr(vessel.control, law)
    if law not in designed_laws():
        raise RefusedError(f"vessel {vessel.name!r}: a campaign does not sail the law {law!r}; name another with --law")
    if section is None:
        raise RefusedError(f"vessel {vessel.name!r} has no gains for the law {law!r} to begin with; design them first")
    found = _simulated(arguments, law)
    better = replace(vessel, control=replace(vessel.control, **{law: type(section)(**found["gains"])}))
    if refusal := verdict_of(better, law).refusal:
        raise RefusedError(f"vessel {vessel.name!r}: {refusal}")
    print(json.dumps(found, indent=2) if arguments.json else _as_text(found, law))
    if arguments.out:
        write_vessel(arguments, better)
    return int(ExitCode.OK)


def _simulated(arguments: argparse.Namespace, law: str) -> dict[str, Any]:
    command = [sys.executable, "-m", "sitl", "tune", arguments.vessel, "--law", law]
    for name in ("weight", "study", "generations"):
        value = getattr(arguments, name)
        command += [] if value is None else [f"--{name}", f"{value}"]
    # what it says on its error output, progress and sentences, is for the user as it is
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=False)
    if done.returncode == ExitCode.REFUSED:
        raise RefusedError("no gains were tuned, for the reason above; nothing was written")
    if done.returncode != ExitCode.OK:
        raise InputError("no gains were tuned, for the reason above; nothing was written")
    found: dict[str, Any] = json.loads(done.stdout)
    return found


def _as_text(found: dict[str, Any], law: str) -> str:
    gains = ", ".join(f"{name} {value:g}" for name, value in found["gains"].items())
    lines = [f"control.{law}: {gains}", f"the best of {found['candidates']} candidates", ""]
    lines.append(f"{'on held-out seeds':20s}{'heading rms [deg]':>20s}{'rudder travel [deg/s]':>24s}{'cost':>10s}")
    for title, name in (("tuned", "tuned"), ("the file's own", "before")):
        row = found["held_out"][name]
        numbers = [row["heading_rms_deg"], row["travel_deg_s"]]
        if any(number != number for number in numbers):
            lines.append(f"{title:20s}{'refused: no margins':>20s}")
            continue
        lines.append(f"{title:20s}{numbers[0]:20.3f}{numbers[1]:24.3f}{row['cost']:10.3f}")
    return "\n".join(lines)
