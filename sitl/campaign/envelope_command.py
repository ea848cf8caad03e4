"""`sitl envelope`: what `autopilot envelope` calls, since the autopilot itself knows no simulator."""

from __future__ import annotations

import argparse
import json
import shlex
from collections import Counter
from collections.abc import Iterator
from itertools import pairwise
from typing import TYPE_CHECKING, Any

from autopilot.cli.envelope import add_options
from autopilot.errors import ExitCode
from autopilot.files.printable import aligned
from autopilot.interruption import as_exceptions

if TYPE_CHECKING:
    from autopilot.vessel.schema import Vessel
    from sitl.campaign.envelope import Found

BINS = 4
FIRST_PANELS = 3
"""Shares of a range that the table counts runs in, to each side."""
SHOWN = 10


def add_parser(commands: argparse._SubParsersAction[Any]) -> None:
    """Add the subcommand."""
    parser = commands.add_parser(
        "envelope",
        help="how wrong the vessel file may be before the boat is not held (autopilot envelope)",
        description="Sail drawn runs with boats, gears, logs and seas that are not the file's.",
    )
    add_options(parser)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Sail, print, write; exit code 6 where a boat left its course without an alarm within 5 s."""
    from autopilot.cli.terminal import ProgressBar
    from autopilot.vessel.file import load_vessel
    from sitl.campaign.envelope import UNSAID, box_of, check_vessel, ranges_of
    from sitl.campaign.work import default_workers

    if arguments.report:
        from autopilot.report import require_extra

        require_extra("by leaving out --report")
    vessel = load_vessel(arguments.vessel)
    check_vessel(vessel)
    found: list[Found] = []
    with as_exceptions(), ProgressBar("runs") as bar:
        bar.update(0, arguments.runs)
        for part in _sailed(vessel, arguments, arguments.workers or default_workers()):
            found += part
            bar.update(len(found), arguments.runs)
    found.sort(key=lambda each: each.run)
    ranges, counts = ranges_of(vessel), Counter(each.outcome for each in found)
    box, inside = box_of(found, len(ranges))
    unsaid = [each for each in found if each.outcome == UNSAID]
    rows: list[tuple[str, ...]] = [("", "unit", "file", "held from", "to", "searched from", "to")]
    bounds = {}
    for each, bound in zip(ranges, box, strict=True):
        low, high = each.at(bound.low), each.at(bound.high)
        rows.append((each.name, each.unit, *(f"{value:.3g}" for value in (each.filed, low, high, each.low, each.high))))
        bounds[each.name] = {"unit": each.unit, "low": low, "high": high, "searched": [each.low, each.high]}
    said = (
        f"{len(found)} runs: {counts['held']} held; {counts['back']} led past and were back within 5 s, "
        f"{counts['alarmed']} left with an alarm within 5 s, {len(unsaid)} without. {inside} lie within the bounds, "
        "and all of these were held."
    )
    if arguments.report:
        _report(vessel, arguments, found, rows, said)
    if arguments.json:
        values = [
            {each.name: each.at(share) for each, share in zip(ranges, one.drawn, strict=True)}
            | {"run": one.run, "left_s": one.left_s, "overshoot_deg": one.overshoot_deg}
            for one in unsaid
        ]
        figures = {"vessel": vessel.name, "seed": arguments.seed, "runs": len(found), **counts}
        print(json.dumps({**figures, "within_bounds": inside, "bounds": bounds, "unsaid": values}))
    else:
        print(*aligned(rows), said, sep="\n")
        for one in unsaid[:SHOWN]:
            values_ = ", ".join(
                f"{each.name} {each.at(share):.2g}" for each, share in zip(ranges, one.drawn, strict=True)
            )
            print(f"run {one.run}: left at {one.left_s:.0f} s, no alarm by then: {values_}")
    return int(ExitCode.DIFFERENT if unsaid else ExitCode.OK)


def _sailed(vessel: Vessel, arguments: argparse.Namespace, workers: int) -> Iterator[list[Found]]:
    """Yield the runs in parts, as they are done."""
    from sitl.campaign.envelope import chunks, found_by
    from sitl.campaign.work import pool_of

    gyro = not arguments.compass_only
    # compiled, or loaded from disk, once before there are many
    first = [found_by(vessel, arguments.seed, 0, gyro=gyro)]
    yield first
    parts = [part for part in chunks(arguments.runs, workers) if part]
    tasks = [(vessel, arguments.seed, part, gyro) for part in parts]
    with pool_of(workers) as pool:
        for done in pool.map(_part, tasks):
            yield [each for each in done if each.run != 0]


def _part(task: tuple[Vessel, int, range, bool]) -> list[Found]:
    from sitl.campaign.envelope import found_by

    vessel, seed, numbers, gyro = task
    return [found_by(vessel, seed, number, gyro=gyro) for number in numbers]


def _report(
    vessel: Vessel, arguments: argparse.Namespace, found: list[Found], rows: list[tuple[str, ...]], said: str
) -> None:
    """Write a page with how many runs were held at each distance from the file."""
    import numpy as np

    from autopilot import __version__
    from autopilot.files.saving import save_page
    from autopilot.report.page import Line, Opening, Panel, Section, render, time_figure
    from sitl.campaign.envelope import ALARMED, BACK, HELD, UNSAID, ranges_of

    edges = np.linspace(-1.0, 1.0, 2 * BINS + 1)
    middles = 0.5 * (edges[:-1] + edges[1:])
    panels = []
    for place, each in enumerate(ranges_of(vessel)):
        lines = []
        for outcome in (HELD, BACK, ALARMED, UNSAID):
            counts = [
                [one.outcome == outcome for one in found if low <= one.drawn[place] <= high]
                for low, high in pairwise(edges)
            ]
            # where nothing was drawn there is nothing to show
            shares = [100.0 * sum(bin_) / len(bin_) if bin_ else np.nan for bin_ in counts]
            lines.append(Line(outcome, middles, np.array(shares)))
        panels.append(Panel(f"{each.name}\n[% of runs]", lines))
    axis = "share of the way from the file's value to the ends of the range"
    caption = "held: within the off-course limit; back: beyond it for less than 5 s; alarmed: said within 5 s"
    hero = Section(
        "", figure=time_figure(panels[:FIRST_PANELS], axis), caption=f"runs by distance from the file; {caption}"
    )
    others = Section("Further ranges", figure=time_figure(panels[FIRST_PANELS:], axis), caption=caption)
    grade = "poor" if any(one.outcome == UNSAID for one in found) else "good"
    page = render(
        Opening(
            f"Envelope: {vessel.name}",
            "Boats, gears, logs and seas that are not the file's.",
            hero,
            (grade, f"{grade}: {said}"),
        ),
        [Section("Bounds", [list(row) for row in rows]), others],
        shlex.join(arguments.typed),
        __version__,
    )
    save_page(arguments.report, page)
