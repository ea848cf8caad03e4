"""`sitl campaign`: run a study, write its results and its page, or run one of its runs again in full.

`sitl tune` and `sitl envelope`: what `autopilot gains --tune` and `autopilot envelope` call, since the autopilot itself
knows no simulator.
"""

from __future__ import annotations

import argparse
import functools
import shlex
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import asdict, replace
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

from autopilot.cli.gains import GENERATIONS, WEIGHT, add_envelope_options
from autopilot.cli.options import check_places, whole_number
from autopilot.control.design import DESIGNED
from autopilot.control.registry import designed_laws
from autopilot.errors import ExitCode, InputError
from autopilot.files.printable import aligned, json_text
from autopilot.interruption import as_exceptions

if TYPE_CHECKING:
    from autopilot.vessel.schema import Vessel
    from sitl.campaign.envelope import Found
    from sitl.campaign.results import Tally
    from sitl.campaign.study import Job

ENGINES = ("local", "dask")
SAME = 1.0e-9
COUNT = whole_number(1, 2**31 - 1)
WORKERS = whole_number(1, 1024)


def add_parser(commands: argparse._SubParsersAction[Any]) -> None:
    """Add the subcommand."""
    parser = commands.add_parser(
        "campaign",
        help="thousands of seeded runs of boat, sea and pilot, from a study file",
        description="Run every case of a study on all cores, the pilot's own functions compiled by numba "
        "(norrbin[fast]); without it in plain Python, slower.",
    )
    parser.add_argument("study", metavar="STUDY.yaml", help="study file, or the name of a shipped one (front)")
    parser.add_argument("--out", metavar="FILE", type=Path, help="results, one row a run: .csv or .parquet")
    parser.add_argument("--overwrite", action="store_true", help="replace the results of --out if they exist")
    parser.add_argument("--report", metavar="FILE.html", type=Path, help="summary and Pareto plot in one page")
    parser.add_argument("--runs", metavar="N", action=COUNT, help="runs of every case (default: the study's)")
    parser.add_argument("--seed", metavar="N", action=COUNT, help="seed of the first run (default: the study's)")
    parser.add_argument("--engine", choices=ENGINES, default="local", help="who computes the runs (default local)")
    parser.add_argument("--workers", metavar="N", action=WORKERS, help="processes (default: one for each core)")
    parser.add_argument("--address", metavar="HOST:PORT", help="of a running dask cluster (default: one here)")
    parser.add_argument("--plain", action="store_true", help="compile nothing: every run in the full simulator")
    parser.add_argument(
        "--replay",
        metavar="RUN",
        action=whole_number(0, 2**31 - 1),
        help="only this run, compiled and in the full simulator",
    )
    parser.add_argument("--json", action="store_true", help="print JSON")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Run the study, or replay one of its runs."""
    job = _job(arguments)
    if arguments.address and arguments.engine == "local":
        raise InputError("--address goes with --engine dask")
    if arguments.replay is not None:
        return _replay(job, arguments)
    return _campaign(job, arguments)


def _job(arguments: argparse.Namespace) -> Job:
    from sitl.campaign.study import Job, cases_of, filed_vessel, load_study

    study, folder = load_study(arguments.study)
    study = replace(study, runs=arguments.runs or study.runs, seed=arguments.seed or study.seed)
    job = Job(study, folder)
    for boat in study.boats.values():
        filed_vessel(boat.vessel, folder)
    cases_of(job)
    return job


def _campaign(job: Job, arguments: argparse.Namespace) -> int:
    from autopilot.cli.terminal import ProgressBar
    from autopilot.files.saving import refuse_existing
    from sitl.campaign.results import Tally, open_results
    from sitl.campaign.study import number_of_runs
    from sitl.campaign.work import batches_of, default_workers, engine_of, in_order

    check_places(arguments.report)
    workers, runs = arguments.workers or default_workers(), number_of_runs(job)
    engine = engine_of(arguments.engine, arguments.address)
    if arguments.out and not arguments.overwrite:
        refuse_existing(arguments.out)
    results = open_results(arguments.out, job) if arguments.out else None
    tally, begun = Tally(job), time.perf_counter()
    try:
        with as_exceptions(), ProgressBar("runs") as bar:
            bar.update(0, runs)
            for rows in in_order(engine(job, batches_of(job, runs), workers, not arguments.plain)):
                tally.add(rows)
                if results is not None:
                    results.write(rows)
                bar.update(rows[-1].run + 1, runs)
    finally:
        if results is not None:
            results.close()
    _print_summary(job, arguments, tally, time.perf_counter() - begun)
    return int(ExitCode.OK)


def _print_summary(job: Job, arguments: argparse.Namespace, tally: Tally, seconds: float) -> None:
    from sitl.campaign.results import as_json, table
    from sitl.campaign.study import steps_of
    from sitl.world import STEP

    summaries, study = tally.cases(), job.study
    steps = steps_of(study, STEP) * (tally.done["compiled"] + tally.done["full"])
    counts = ", ".join(f"{count} {how}" for how, count in tally.done.items() if count)
    pace = f"{seconds:.1f} s: {steps / seconds:,.0f} steps a second."
    summary = f"{len(summaries)} cases, {counts}, seed {study.seed}, in {pace}"
    if not tally.done["compiled"] and not arguments.plain:
        summary += " Nothing was compiled: with numba it is far quicker, pip install '.[fast]'."
    if arguments.report:
        from autopilot.files.saving import save_page
        from sitl.campaign.results import campaign_page

        page = campaign_page(study.name, study.description, summaries, summary, shlex.join(arguments.typed))
        save_page(arguments.report, page)
    if arguments.json:
        found = {"study": study.name, "done": tally.done, "seconds": seconds, "cases": as_json(summaries)}
        print(json_text(found, indent=None))
        return
    print(*aligned(table(summaries)), summary, sep="\n")
    for path in (arguments.out, arguments.report):
        if path:
            print(f"Wrote {path}.")


def _replay(job: Job, arguments: argparse.Namespace) -> int:
    """Do one run in the full simulator, and compiled where that can be; exit code 6 where they differ."""
    from sitl.campaign.setting import run_reference
    from sitl.campaign.study import case_and_seed, number_of_runs
    from sitl.campaign.work import done_compiled

    number, runs = arguments.replay, number_of_runs(job)
    if not 0 <= number < runs:
        raise InputError(f"--replay {number}: the study has runs 0 to {runs - 1}")
    case, seed = case_and_seed(job, number)
    full = run_reference(job, number)
    quick = None if arguments.plain else done_compiled(job, number)
    off = 0.0 if quick is None else max(abs(one - other) for one, other in zip(full, quick, strict=True))
    if arguments.json:
        found = {"run": number, "seed": seed, **case._asdict(), **full._asdict()}
        print(json_text({**found, "compiled": quick is not None, "difference": off}, indent=None))
    else:
        print(f"run {number}, seed {seed}: " + ", ".join(f"{name} {value}" for name, value in case._asdict().items()))
        for name, value in full._asdict().items():
            print(f"  {name:18s} {value:.12g}")
        print(
            "not compiled: this run is one for the full simulator"
            if quick is None
            else f"compiled it differs by {off:.1e} at most"
        )
    return int(ExitCode.OK if off <= SAME else ExitCode.DIFFERENT)


def add_tune_parser(commands: argparse._SubParsersAction[Any]) -> None:
    """Add `sitl tune`."""
    parser = commands.add_parser(
        "tune",
        help="tune a law's gains over a campaign (autopilot gains --tune shows and writes them)",
        description="Tune a law's gains over a campaign and print them, with what held-out seeds say, as JSON.",
    )
    parser.add_argument("vessel", metavar="VESSEL.yaml", help="vessel file, or the name of a shipped one (lanxin)")
    parser.add_argument("--law", choices=designed_laws(), default=DESIGNED)
    parser.add_argument(
        "--weight", action=WEIGHT, metavar="W", default=1.0, help="deg of rms a deg/s of travel is worth"
    )
    parser.add_argument("--study", metavar="STUDY.yaml", default="tuning", help="seas and mismatches (default tuning)")
    parser.add_argument("--generations", action=GENERATIONS, metavar="N", default=10, help="of the search (default 10)")
    parser.add_argument("--workers", action=WORKERS, metavar="N", help="processes (default: one for each core)")
    parser.set_defaults(run=run_tune)


def run_tune(arguments: argparse.Namespace) -> int:
    """Tune and print JSON."""
    from autopilot.cli.terminal import ProgressBar
    from autopilot.vessel.file import load_vessel
    from sitl.campaign.study import Job, load_study
    from sitl.campaign.tuning import Search, tune
    from sitl.campaign.work import default_workers

    vessel = load_vessel(arguments.vessel)
    study, _ = load_study(arguments.study)
    path = str(Path(arguments.vessel).resolve()) if Path(arguments.vessel).exists() else arguments.vessel
    boats = {vessel.name: replace(next(iter(study.boats.values())), vessel=path)}
    job = Job(replace(study, boats=boats), ".")
    with ProgressBar("generations") as bar:
        bar.update(0, arguments.generations)
        found = tune(
            job,
            vessel,
            Search(arguments.law, arguments.weight, arguments.generations),
            arguments.workers or default_workers(),
            bar.update,
        )
    document = {
        "law": arguments.law,
        "weight": arguments.weight,
        "gains": asdict(getattr(found.vessel.control, arguments.law)),
        "candidates": found.candidates,
        "training": found.training._asdict(),
        "held_out": {"tuned": found.tuned._asdict(), "before": found.before._asdict()},
    }
    print(json_text(document, indent=None))
    return int(ExitCode.OK)


BINS = 4
"""Shares of a range that the table counts runs in, to each side."""
FIRST_PANELS = 3
SHOWN = 10


def add_envelope_parser(commands: argparse._SubParsersAction[Any]) -> None:
    """Add the subcommand."""
    parser = commands.add_parser(
        "envelope",
        help="how wrong the vessel file may be before the boat is not held (autopilot envelope)",
        description="Sail drawn runs with boats, gears, logs and seas that are not the file's.",
    )
    add_envelope_options(parser)
    parser.set_defaults(run=run_envelope)


def run_envelope(arguments: argparse.Namespace) -> int:
    """Sail, print, write; exit code 6 where a boat left its course without an alarm within 5 s."""
    from autopilot.cli.terminal import ProgressBar
    from autopilot.vessel.file import load_vessel
    from sitl.campaign.envelope import UNSAID, box_of, check_vessel, ranges_of
    from sitl.campaign.work import default_workers

    check_places(arguments.report)
    vessel = load_vessel(arguments.vessel)
    check_vessel(vessel)
    found: list[Found] = []
    with as_exceptions(), ProgressBar("runs") as bar:
        bar.update(0, arguments.runs)
        for one in _sailed(vessel, arguments, arguments.workers or default_workers()):
            found.append(one)
            bar.update(len(found), arguments.runs)
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
        _report_envelope(vessel, arguments, found, rows, said)
    if arguments.json:
        values = [
            {each.name: each.at(share) for each, share in zip(ranges, one.drawn, strict=True)}
            | {"run": one.run, "left_s": one.left_s, "overshoot_deg": one.overshoot_deg}
            for one in unsaid
        ]
        figures = {"vessel": vessel.name, "seed": arguments.seed, "runs": len(found), **counts}
        print(json_text({**figures, "within_bounds": inside, "bounds": bounds, "unsaid": values}, indent=None))
    else:
        print(*aligned(rows), said, sep="\n")
        for one in unsaid[:SHOWN]:
            values_ = ", ".join(
                f"{each.name} {each.at(share):.2g}" for each, share in zip(ranges, one.drawn, strict=True)
            )
            print(f"run {one.run}: left at {one.left_s:.0f} s, no alarm by then: {values_}")
    return int(ExitCode.DIFFERENT if unsaid else ExitCode.OK)


def _sailed(vessel: Vessel, arguments: argparse.Namespace, workers: int) -> Iterator[Found]:
    """Yield the runs as they are done."""
    from sitl.campaign.envelope import found_by
    from sitl.campaign.work import pool_of

    sail = functools.partial(found_by, vessel, arguments.seed, gyro=not arguments.compass_only)
    # compiled, or loaded from disk, once before there are many
    yield sail(0)
    with pool_of(workers) as pool:
        yield from pool.map(sail, range(1, arguments.runs), chunksize=max(1, min(50, arguments.runs // (4 * workers))))


def _report_envelope(
    vessel: Vessel, arguments: argparse.Namespace, found: list[Found], rows: list[tuple[str, ...]], said: str
) -> None:
    """Write a page with how many runs were held at each distance from the file."""
    import numpy as np

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
    )
    save_page(arguments.report, page)
