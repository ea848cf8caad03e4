"""`autopilot gains`: gains from model, rudder and delay, and the margins they and the file's own leave.

With `--tune`: gains optimised in simulation for a weight between heading error and rudder travel; what the simulator
proposes is judged here before anything is written. And `autopilot envelope`: how wrong the vessel file may be before
the pilot does not hold the boat any more. The simulator does both in a process of its own, `sitl tune` and `sitl
envelope`, since the autopilot itself knows no simulator.
"""

from __future__ import annotations

import argparse
import json
import shlex
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from autopilot.cli.options import NumberOption, check_places, named_vessel, number, whole_number
from autopilot.control.registry import designed_laws, filed_laws
from autopilot.errors import ExitCode, InputError, RefusedError
from autopilot.files.printable import json_text
from autopilot.interruption import Interrupted, run_child

if TYPE_CHECKING:
    from autopilot.report.gains import Judged
    from autopilot.report.steered import Verdict
    from autopilot.runtime.tuning import GainRequest, LevelCost
    from autopilot.vessel.schema import Vessel


WEIGHT = number(0.0, 1.0e6)
"""0: the heading alone."""
GENERATIONS = whole_number(1, 10_000)


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.description = (
        "Design gains for the vessel's model, rudder, delay and instruments, and print the front they are "
        "chosen from, heading rms against rudder travel, and the file's own gains beside them."
    )
    parser.add_argument("vessel", metavar="VESSEL.yaml", help="vessel file, or the name of a shipped one (lanxin)")
    parser.add_argument("--out", metavar="FILE.yaml", help="write the vessel with the designed gains")
    parser.add_argument("--overwrite", action="store_true", help="replace another vessel file that --out names")
    parser.add_argument(
        "--level",
        action=whole_number(1, 9),
        metavar="1..9",
        help="1 spares the rudder, 9 holds the course; what each costs is printed (5)",
    )
    parser.add_argument(
        "--bandwidth-rad-s", action=NumberOption, metavar="W", help="the regulator's bandwidth instead of a level"
    )
    parser.add_argument("--report", metavar="FILE.html", help="write curves and tables into one page")
    parser.add_argument("--json", action="store_true", help="print JSON")
    _add_tuning(parser)
    parser.set_defaults(run=run)


def in_hand(vessel: Vessel, request: GainRequest, is_chosen: bool) -> Vessel:
    """Return a course-unstable boat's vessel with designed gains whose turns bear a rudder weaker than the model's.

    Where the level is not chosen, the next quicker one that does is taken. Raises RefusedError where none does.
    """
    from autopilot.report.gains import bearing_level, survives
    from autopilot.runtime.tuning import designed

    lost = "a turn of 90 deg with a rudder 30 % weaker than the model's is lost or leads far past"
    if request.bandwidth is not None:
        if survives(better := designed(vessel, request)):
            return better
        raise RefusedError(
            f"vessel {vessel.name!r}: with these gains {lost}; ask for more --bandwidth-rad-s or a --level"
        )
    found = bearing_level(vessel, request.level)
    if found is None:
        raise RefusedError(
            f"vessel {vessel.name!r}: at level {request.level}, and at any quicker one, {lost}; ask for a calmer "
            "--level, or give the boat a quicker rudder"
        )
    level, better = found
    if level != request.level:
        if is_chosen:
            raise RefusedError(f"vessel {vessel.name!r}: at level {request.level} {lost}; --level {level} bears it")
        print(f"level {level} in place of {request.level}, at which {lost}", file=sys.stderr)
    return better


def run(arguments: argparse.Namespace) -> int:
    """Design, print, write; exit code 4 where no gains serve, or those asked for must not be engaged."""
    from autopilot.cli.terminal import ProgressBar
    from autopilot.control.design import DESIGNED
    from autopilot.report.gains import (
        as_json,
        as_text,
        front_as_json,
        front_as_text,
        judged,
        speeds_as_json,
        speeds_as_text,
        verdict_of_gains,
    )
    from autopilot.runtime.tuning import designed, front_of

    _check_tuning(arguments)
    check_place(arguments)
    if arguments.tune:
        return _tuned(arguments)
    request = _request(arguments)
    vessel = named_vessel(arguments.vessel)
    _check_bandwidth(vessel, request)
    better = (
        designed(vessel, request) if vessel.model.n1 > 0.0 else in_hand(vessel, request, arguments.level is not None)
    )
    of_file = [law for law in filed_laws() if getattr(vessel.control, law) is not None]
    wanted = [("designed", better, law) for law in designed_laws()] + [("file's", vessel, law) for law in of_file]
    rows: dict[str, Judged] = {}
    with ProgressBar("designing") as bar:
        for whose, of, law in wanted:
            bar.update(len(rows), len(wanted) + 2)
            rows[f"{whose} {law}"] = judged(of, law)
        asked_for = rows[f"designed {DESIGNED}"].verdict.refusal
        if request.bandwidth is not None and asked_for:
            raise RefusedError(f"vessel {vessel.name!r}: {asked_for}")
        bar.update(len(wanted), len(wanted) + 2)
        front = front_of(vessel)
        bar.update(len(wanted) + 1, len(wanted) + 2)
        level = level_of(vessel, better, front, request.level)
    cost = next((row for row in front if row.level == level), None)
    verdict = verdict_of_gains(rows[f"designed {DESIGNED}"], cost)
    if arguments.json:
        found: dict[str, Any] = {"verdict": verdict._asdict()}
        found |= {name: {**as_json(each), **speeds_as_json(each)} for name, each in rows.items()}
        found[f"designed {DESIGNED}"]["front"] = front_as_json(front)
        print(json_text(found))
    else:
        parts = front_as_text(vessel, front, level), as_text(said_once(rows)), speeds_as_text(said_once(rows))
        print(f"{vessel.name}: {verdict.sentence}", *parts, sep="\n\n")
    if arguments.report:
        _write_report(arguments, (vessel, front, level), said_once(rows), verdict)
    if arguments.out:
        write_vessel(arguments, better)
    return int(ExitCode.OK)


def said_once(rows: dict[str, Judged]) -> dict[str, Judged]:
    """Return the rows, those of the file that are the designed ones in one row with them."""
    shown: dict[str, Judged] = {}
    filed = {each.law: each for name, each in rows.items() if name.startswith("file's ")}
    alike = {
        law
        for law, each in filed.items()
        if (twin := rows.get(f"designed {law}")) is not None
        and getattr(twin.vessel.control, law) == getattr(each.vessel.control, law)
    }
    for name, each in rows.items():
        if each.law in alike and name.startswith("file's "):
            continue
        shown[f"{name}, the file's" if each.law in alike and name.startswith("designed ") else name] = each
    return shown


def level_of(vessel: Vessel, better: Vessel, front: list[LevelCost], asked: int) -> int | None:
    """Return the level that the gains of `better` are, that asked for where more than one has them; None where they are
    of none."""
    from autopilot.control.design import DESIGNED
    from autopilot.runtime.tuning import GainRequest, designed

    gains = getattr(better.control, DESIGNED)
    for row in sorted(front, key=lambda row: row.level != asked):
        if getattr(designed(vessel, GainRequest(row.level)).control, DESIGNED) == gains:
            return row.level
    return None


def _request(arguments: argparse.Namespace) -> GainRequest:
    from autopilot.runtime.tuning import GainRequest

    level, bandwidth = arguments.level, arguments.bandwidth_rad_s
    if level is not None and bandwidth is not None:
        raise InputError("--level and --bandwidth-rad-s exclude each other")
    return GainRequest(5 if level is None else level, bandwidth)


def _check_bandwidth(vessel: Vessel, request: GainRequest) -> None:
    from autopilot.control.design import BANDWIDTHS, bandwidths_of
    from autopilot.runtime.build import model_of

    low, high = bandwidths_of(model_of(vessel))
    if request.bandwidth is not None and not low <= request.bandwidth <= high:
        raise InputError(
            f"--bandwidth-rad-s {request.bandwidth:g}: allowed for {vessel.name!r} is {low:.3g} to {high:.3g}, which "
            f"is {BANDWIDTHS[0]:g} to {BANDWIDTHS[1]:g} over its T of {vessel.model.T_s:g} s"
        )


def check_place(arguments: argparse.Namespace) -> None:
    """Raise InputError where --out names another vessel's file, or nothing can be written: said before the work."""
    check_places(arguments.report, arguments.out)
    out, vessel = arguments.out and Path(arguments.out), Path(arguments.vessel)
    if out and out.is_file() and not arguments.overwrite and not (vessel.exists() and out.samefile(vessel)):
        raise InputError(f"{out}: exists already, with another boat; give another name, or --overwrite to replace it.")


def write_vessel(arguments: argparse.Namespace, better: Vessel) -> None:
    """Write the vessel where --out says; in the file's own place its comments stay.

    Raises InputError where that is another boat's file and --overwrite does not say that it may go, and where no
    command could read what is written.
    """
    from autopilot.files.saving import save_text
    from autopilot.vessel.file import text_for

    paths = Path(arguments.out), Path(arguments.vessel)
    is_same = all(path.exists() for path in paths) and paths[0].samefile(paths[1])
    text = text_for(arguments.out, better, in_place=is_same)
    save_text(arguments.out, text, overwrite=is_same or arguments.overwrite)
    if not arguments.json:
        print(f"\nWrote {arguments.out}.")


def _write_report(
    arguments: argparse.Namespace,
    priced: tuple[Vessel, list[LevelCost], int | None],
    rows: dict[str, Judged],
    verdict: Verdict,
) -> None:
    from autopilot.control.design import DESIGNED
    from autopilot.files.saving import save_page
    from autopilot.report.gains import judged
    from autopilot.report.gains_page import gains_page
    from autopilot.runtime.tuning import GainRequest, designed

    levels = {}
    for level in range(1, 10):
        levels[level] = judged(designed(priced[0], GainRequest(level)), DESIGNED)
    save_page(arguments.report, gains_page(priced, rows, levels, verdict, shlex.join(arguments.typed)))
    if not arguments.json:
        print(f"\nWrote the report to {arguments.report}.")


def _add_tuning(parser: argparse.ArgumentParser) -> None:
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


def _check_tuning(arguments: argparse.Namespace) -> None:
    """Raise InputError where options of tuning and of designing are mixed."""
    if not arguments.tune:
        for name in ("law", "weight", "study", "generations"):
            if getattr(arguments, name) is not None:
                raise InputError(f"--{name} goes with --tune")
        return
    for name in ("level", "bandwidth_rad_s", "report"):
        if getattr(arguments, name) is not None:
            raise InputError(f"--{name.replace('_', '-')} is for the design and does not go with --tune")


def _tuned(arguments: argparse.Namespace) -> int:
    """Tune, print what held-out seeds say, write the vessel where asked; exit code 4 where no gains have margins."""
    from autopilot.runtime.build import verdict_of

    vessel = named_vessel(arguments.vessel)
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
    print(json_text(found) if arguments.json else _tuned_text(found, law))
    if arguments.out:
        write_vessel(arguments, better)
    return int(ExitCode.OK)


def _simulated(arguments: argparse.Namespace, law: str) -> dict[str, Any]:
    command = simulator("tune", arguments.vessel, "--law", law)
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


def _tuned_text(found: dict[str, Any], law: str) -> str:
    gains = ", ".join(f"{name} {value:g}" for name, value in found["gains"].items())
    lines = [f"control.{law}: {gains}", f"the best of {found['candidates']} candidates", ""]
    lines.append(f"{'on held-out seeds':20s}{'heading rms [deg]':>20s}{'rudder travel [deg/s]':>24s}{'cost':>10s}")
    for title, name in (("tuned", "tuned"), ("the file's own", "before")):
        row = found["held_out"][name]
        numbers = [row["heading_rms_deg"], row["travel_deg_s"]]
        if None in numbers:
            lines.append(f"{title:20s}{'refused: no margins':>20s}")
            continue
        lines.append(f"{title:20s}{numbers[0]:20.3f}{numbers[1]:24.3f}{row['cost']:10.3f}")
    return "\n".join(lines)


def add_envelope_options(parser: argparse.ArgumentParser) -> None:
    """Add what `autopilot envelope` and `sitl envelope` are given."""
    parser.add_argument("vessel", metavar="VESSEL.yaml", help="vessel file, or the name of a shipped one (lanxin)")
    parser.add_argument(
        "--runs", metavar="N", action=whole_number(1, 10_000_000), default=400, help="runs to sail (default 400)"
    )
    parser.add_argument(
        "--seed",
        metavar="N",
        action=whole_number(0, 2**31 - 1),
        default=1,
        help="the runs are drawn by it (default 1)",
    )
    parser.add_argument("--workers", metavar="N", action=whole_number(1, 1024), help="processes (default: all cores)")
    parser.add_argument("--compass-only", action="store_true", help="without a rate of turn")
    parser.add_argument("--report", metavar="FILE.html", type=Path, help="write tables and figures into one page")
    parser.add_argument("--json", action="store_true", help="print JSON")


def add_envelope(parser: argparse.ArgumentParser) -> None:
    """Add `autopilot envelope`."""
    parser.description = (
        "Sail runs drawn about the vessel file: boat, rudder, delay, backlash, speed and sea that are not "
        "what it says. Prints the bounds within which every run was held; exit code 6 where one was not, and no alarm "
        "said so within 5 s."
    )
    add_envelope_options(parser)
    parser.set_defaults(run=run_envelope)


def run_envelope(arguments: argparse.Namespace) -> int:
    """Have the simulator sail what was asked of us; what it prints is for the user as it is."""
    try:
        return run_child(simulator(*arguments.typed[1:]))
    except Interrupted as signal:  # it has said so
        return 128 + signal.number


def simulator(*words: str) -> list[str]:
    """Return the command line of `sitl`, whose messages are in the name of this program."""
    return [sys.executable, "-c", "from sitl.__main__ import main; main('autopilot')", *words]
