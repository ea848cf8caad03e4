"""`autopilot demo`: a sea trial, an identification and an engagement on the simulated boat, over real links."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from autopilot.cli.options import SEED
from autopilot.errors import ExitCode, InputError
from autopilot.files.printable import json_text


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.description = (
        "Sail a trial on the simulated Lanxin boat, identify it from the log, design gains, engage, turn "
        "90 deg, hold in sea state 5, beside a PID: over UDP sockets and a pseudo-terminal. Takes about a minute."
    )
    parser.add_argument("--out", type=Path, default=Path("demo"), metavar="DIR", help="new folder (demo, then demo-2)")
    parser.add_argument("--seed", action=SEED, default=1, metavar="N", help="seed of sea and sensors (1)")
    parser.add_argument("--no-report", action="store_true", help="no figures and report.html (needs no extra)")
    parser.add_argument("--json", action="store_true", help="print demo.json instead of the table")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Run the demo, print its table, write its files; return the exit code."""
    if not arguments.no_report:
        from autopilot.report import require_extra

        require_extra()
    from autopilot.cli.demo_legs import as_json, as_text, sail_demo, verdict_of_demo
    from autopilot.cli.terminal import ProgressBar
    from autopilot.files.saving import save_text, unused_folder, why_not

    try:
        out = unused_folder(arguments.out)
    except OSError as error:
        raise InputError(f"--out {arguments.out}: {why_not(error)}; give a folder that can be written") from error
    if out != arguments.out:
        print(f"{arguments.out} is not empty and is kept: this demo is {out}", file=sys.stderr)
    with ProgressBar("demo") as bar:
        result = sail_demo(out, arguments.seed, bar.update)
    summary = as_json(result)
    summary["verdict"] = verdict_of_demo(summary)._asdict()
    save_text(out / "demo.json", json_text(summary) + "\n")
    if not arguments.no_report:
        from autopilot.cli.demo_legs import HOLDS, TURNS, DemoFigures, write_demo_report

        shown = DemoFigures(
            trial=result.legs["trial"].ticks,
            turns={label: result.legs[name].ticks for name, label in TURNS.items()},
            holds={label: result.legs[name].ticks for name, label in HOLDS.items()},
        )
        write_demo_report(out, shown, summary)
    print(json_text(summary) if arguments.json else as_text(summary))
    if not arguments.json:
        print(f"\nWrote {', '.join(sorted(path.name for path in out.iterdir()))} in {out}")
    return int(ExitCode.OK)
