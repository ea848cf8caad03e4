"""`autopilot identify-dp`: a ship's thrust and damping coefficients from trials under its thrusters."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from autopilot.cli.options import SEED, whole_number
from autopilot.errors import ExitCode, InputError

if TYPE_CHECKING:
    import numpy as np

    from autopilot.cli.identify_dp_files import Answers, ShipTrial

DESCRIPTION = """\
Identifies thrust coefficients and damping of a ship at low speed with an extended Kalman filter, a feedback particle
filter and a batch fit, from a TRIAL recorded under its thrusters alone, or from a simulated one (--scenario).
"""

COLUMNS_HELP = """\
columns of TRIAL.csv; a thrust holds from its row to the next, the first row is taken at rest:
  surge, main thrusters only:         time_s  thrust_1_n  thrust_2_n  position_x_m
  sway and yaw, side thruster only:   time_s  thrust_3_n  position_y_m  heading_deg|heading_rad
x is along, y to starboard of the ship's heading in the first row. SHIP.yaml: see docs/dynamic_positioning.md.
"""


def add_parser(subparsers: Any) -> None:
    """Add the `identify-dp` subcommand."""
    parser = subparsers.add_parser(
        "identify-dp",
        help="identify a ship's thrust and damping from trials under its thrusters",
        description=DESCRIPTION,
        epilog=COLUMNS_HELP,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("trial", nargs="?", metavar="TRIAL.csv", help="recorded trial")
    parser.add_argument("--ship", metavar="SHIP.yaml", help="ship, noise and prior; default: Zheng's dredger")
    parser.add_argument("--scenario", choices=("S1", "S2", "S3", "S4"), help="simulate a trial of Zheng's dredger")
    parser.add_argument("--record", metavar="FILE.csv", help="write the simulated trial as a CSV table")
    parser.add_argument("--gain", choices=("constant", "galerkin", "kernel"), default="constant", help="of the FPF")
    parser.add_argument(
        "--particles", action=whole_number(10, 100_000), default=500, metavar="N", help="of the FPF (default 500)"
    )
    parser.add_argument("--seed", action=SEED, default=0, metavar="S", help="of noise, prior and particles (default 0)")
    parser.add_argument("--json", action="store_true", help="print JSON")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Identify and print; return the exit code."""
    _check(arguments)
    import numpy as np

    from autopilot.cli import identify_dp_files as report

    random = np.random.default_rng(arguments.seed)
    trial = _simulated(arguments, random) if arguments.scenario else _recorded(arguments)
    answers = _answers(arguments, trial, random)
    print(report.as_json(answers) if arguments.json else report.as_text(answers))
    return int(ExitCode.OK)


def _check(arguments: argparse.Namespace) -> None:
    if (arguments.trial is None) == (arguments.scenario is None):
        raise InputError("identify-dp needs either a TRIAL.csv or --scenario, one of the two.")
    if arguments.scenario and arguments.ship:
        raise InputError("--scenario simulates Zheng's dredger; --ship goes with a TRIAL.csv.")
    if arguments.record and not arguments.scenario:
        raise InputError("--record writes the trial that --scenario simulates; there is none.")
    if arguments.gain == "kernel" and arguments.particles > 2000:
        raise InputError("--gain kernel takes N x N matrices: at most 2000 --particles.")


def _simulated(arguments: argparse.Namespace, random: np.random.Generator) -> ShipTrial:
    from autopilot.cli.identify_dp_files import ShipTrial, write_trial
    from autopilot.identification.dynamic_positioning import SCENARIOS, simulate_scenario
    from autopilot.models.dynamic_positioning import DREDGER

    scenario = SCENARIOS[arguments.scenario]
    simulated = simulate_scenario(scenario, random)
    if arguments.record:
        kept = write_trial(arguments.record, simulated.trial, f"{scenario.name}: {scenario.summary}, simulated")
        if kept != Path(arguments.record):
            print(f"{arguments.record} exists and is kept: this trial is {kept}", file=sys.stderr)
    source = f"{scenario.name} ({scenario.summary}), simulated, seed {arguments.seed}"
    return ShipTrial(source, DREDGER, simulated.case, simulated.trial, tuple(scenario.truth))


def _recorded(arguments: argparse.Namespace) -> ShipTrial:
    from autopilot.cli.identify_dp_files import default_ship, load_ship, load_trial

    ship = load_ship(arguments.ship) if arguments.ship else default_ship()
    return load_trial(arguments.trial, ship)


def _answers(arguments: argparse.Namespace, ship_trial: ShipTrial, random: np.random.Generator) -> Answers:
    from autopilot.cli.identify_dp_files import Answers
    from autopilot.cli.terminal import ProgressBar
    from autopilot.filters.feedback_particle import GAINS
    from autopilot.identification.augmented_state import by_kalman_filter, by_particle_filter, by_prediction_errors
    from autopilot.identification.dynamic_positioning import trial_steps

    case, steps = ship_trial.case, trial_steps(ship_trial.hull, ship_trial.trial)
    with ProgressBar("identifying") as bar:
        bar.update(0, 3)
        kalman = by_kalman_filter(case, steps)
        bar.update(1, 3)
        particles = by_particle_filter(case, steps, arguments.particles, random, GAINS[arguments.gain])
        bar.update(2, 3)
        batch = by_prediction_errors(case, steps, kalman.estimate[-1])
    return Answers(ship_trial.source, case, steps, kalman, particles, batch, arguments.gain, ship_trial.truth)
