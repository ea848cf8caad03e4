"""`sitl tune`: what `autopilot gains --tune` calls, since the autopilot itself knows no simulator."""

from __future__ import annotations

import argparse
import json
from dataclasses import asdict, replace
from typing import Any

from autopilot.cli.gains_tune import GENERATIONS, WEIGHT
from autopilot.control.design import DESIGNED
from autopilot.control.registry import designed_laws
from autopilot.errors import ExitCode
from sitl.campaign.command import WORKERS


def add_parser(commands: argparse._SubParsersAction[Any]) -> None:
    """Add the subcommand."""
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
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Tune and print JSON."""
    from pathlib import Path

    from autopilot.cli.terminal import ProgressBar
    from autopilot.vessel.file import load_vessel
    from sitl.campaign.engines import default_workers
    from sitl.campaign.study import Job, load_study
    from sitl.campaign.tuning import Search, tune

    vessel = load_vessel(arguments.vessel)
    study, _ = load_study(arguments.study)
    path = str(Path(arguments.vessel).resolve()) if Path(arguments.vessel).exists() else arguments.vessel
    boats = {vessel.name: replace(next(iter(study.boats.values())), vessel=path)}
    job = Job(replace(study, boats=boats), ".")
    with ProgressBar("generations") as bar:
        bar.show(0, arguments.generations)
        found = tune(
            job,
            vessel,
            Search(arguments.law, arguments.weight, arguments.generations),
            arguments.workers or default_workers(),
            bar.show,
        )
    print(
        json.dumps(
            {
                "law": arguments.law,
                "weight": arguments.weight,
                "gains": asdict(getattr(found.vessel.control, arguments.law)),
                "candidates": found.candidates,
                "training": found.training._asdict(),
                "held_out": {"tuned": found.tuned._asdict(), "before": found.before._asdict()},
            }
        )
    )
    return int(ExitCode.OK)
