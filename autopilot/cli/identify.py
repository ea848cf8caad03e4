"""`autopilot identify`: a boat's model, with its uncertainty, from recordings of rudder, speed and motion."""

from __future__ import annotations

import argparse
import math
import shlex
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from autopilot.errors import ExitCode, InputError, RefusedError

if TYPE_CHECKING:
    from autopilot.identification.boat_prior import BoatPrior
    from autopilot.identification.identified import Identified, ModelKind, Question, SteadyTurns
    from autopilot.identification.methods import Method
    from autopilot.identification.model_choice import Choice
    from autopilot.identification.rudder_path import RudderRate
    from autopilot.identification.runs import Run
    from autopilot.identification.verdict import Verdict
    from autopilot.report.identification import Result
    from autopilot.vessel.schema import Vessel

DESCRIPTION = """\
Fits Norrbin's model  T r' + n3 r^3 + n1 r + n0 = K delta,  K ~ U, T ~ 1/U, n3 ~ 1/U^2,  to all LOG files together,
and predicts every LOG and every --holdout LOG from its rudder and speed alone. A LOG is of any kind that
`autopilot log` reads: .tlog, .BIN, .ulg, NMEA 0183 and 2000, MCAP, CSV.
"""

COLUMNS_HELP = """\
columns of a CSV table, by quantity and unit (rudder positive to starboard, heading clockwise):
  time_s   rudder_deg|rudder_rad   speed_m_s|speed_kn   heading_deg|heading_rad   yaw_rate_deg_s|yaw_rate_rad_s
Heading or yaw rate may be absent. Where the table calls them otherwise, MAP.yaml says how, a line for each:
  rudder_rad: delta_rudder [rad]
"""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the `identify` subcommand."""
    from autopilot.cli.log import add_log_options
    from autopilot.cli.options import number

    parser.description = DESCRIPTION
    parser.epilog = COLUMNS_HELP
    parser.add_argument("logs", nargs="*", metavar="LOG", help="logs to fit (for the kinds see `autopilot log -h`)")
    parser.add_argument("--holdout", nargs="+", default=[], metavar="LOG", help="recordings to predict, not to fit")
    parser.add_argument("--steady-turns", metavar="FILE", help="CSV of steady turns (rudder, yaw rate): gives n3")
    parser.add_argument(
        "--gain-1-s", action=number(1.0e-5, 100.0), metavar="K", help="hold K [1/s] in the steady-turn stage"
    )
    parser.add_argument(
        "--model",
        choices=("auto", "nomoto", "nomoto2", "norrbin", "norrbin-n2"),
        default="norrbin",
        help="nomoto: n3 = 0; nomoto2: with lag and lead; norrbin-n2: n2 r^2 too; auto: what predicts best, "
        "with the table of candidates (default norrbin)",
    )
    parser.add_argument(
        "--trim",
        choices=("common", "per-run"),
        default="common",
        help="per-run: an n0 for each LOG, where wind and current differed (default common)",
    )
    parser.add_argument(
        "--method",
        metavar="METHOD",
        help="output-error (default), two-stage, ...; `--method list` says what each does",
    )
    parser.add_argument(
        "--forgetting",
        action=number(0.001, 1.0),
        default=1.0,
        metavar="F",
        help="forgetting of recursive least squares (default 1)",
    )
    parser.add_argument(
        "--fit-rudder",
        default="",
        metavar="LIST",
        help="fit these of what lies between the recorded rudder and the boat: delay,lag,lead,dead-band (default: "
        "delay,lag of a rudder that was ordered, a delay behind one that was measured where the LOGs show it); "
        "lag,lead together make Nomoto's second order",
    )
    parser.add_argument(
        "--weighting",
        choices=("likelihood", "residuals"),
        default="likelihood",
        help="likelihood (default): gusts, waves and noise are found with the boat; residuals: simulated and compared",
    )
    parser.add_argument(
        "--reference-speed-m-s", action=number(0.01, 100.0), metavar="U", help="default: mean speed of the LOGs"
    )
    parser.add_argument(
        "--length-m",
        action=number(0.2, 500.0),
        metavar="L",
        help="length of the boat (default: the vessel file's): where the LOGs tell little, other boats of that length "
        "and speed help, and it is said how much",
    )
    parser.add_argument(
        "--course-unstable",
        action="store_true",
        help="the boat will not go straight (found by itself by output-error; other methods need it)",
    )
    parser.add_argument("--reverse-rudder", action="store_true", help="the recorded rudder is positive to port")
    parser.add_argument(
        "--roll",
        action="store_true",
        help="how the boat rolls under its rudder, from one LOG with roll (docs/roll_damping.md)",
    )
    parser.add_argument("--out", metavar="VESSEL.yaml", help="write the model into this vessel file")
    parser.add_argument(
        "--at-least",
        choices=("start", "good"),
        help="write nothing, and end with exit code 4, where the model is not good for a start, or not good",
    )
    parser.add_argument(
        "--rudder-max-deg",
        action=number(1.0, 90.0),
        metavar="DEG",
        help="end stop of the rudder, each side, for a new --out file",
    )
    parser.add_argument("--report", metavar="FILE.html", help="write figures and tables into one page")
    parser.add_argument("--json", action="store_true", help="print JSON")
    add_log_options(parser)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Identify, print, and write the vessel file; return the exit code."""
    if arguments.method == "list":
        from autopilot.files.printable import aligned
        from autopilot.identification.registry import METHODS

        print(*aligned([(method.name, method.summary) for method in METHODS], has_head=False), sep="\n")
        return int(ExitCode.OK)
    if arguments.roll:
        from autopilot.cli.identify_drive_roll import identified_roll

        print(identified_roll(arguments))
        return int(ExitCode.OK)
    from autopilot.cli.options import check_places
    from autopilot.identification.registry import method_named

    method = method_named(arguments.method)  # said before the logs are read
    _check(arguments, method)
    check_places(arguments.report, arguments.out)
    return _of_logs(arguments, _steady_turns(arguments.steady_turns) if arguments.steady_turns else None)


def _of_logs(arguments: argparse.Namespace, steady: SteadyTurns | None) -> int:
    from autopilot.report import identification as report

    if not arguments.logs:
        assert steady is not None
        print(report.steady_report(steady, arguments.gain_1_s, as_json=arguments.json))
        return int(ExitCode.OK)
    from autopilot.cli.identify_drive_roll import identified_by_thrust
    from autopilot.cli.log import log_options, print_newer, refuse_twice, vessel_of
    from autopilot.cli.terminal import ProgressBar
    from autopilot.identification.ordered_rudder import slower_rudder, with_rudder_of
    from autopilot.identification.verdict import gear_check
    from autopilot.logs.reading import load_run
    from autopilot.vessel.file import recorded_vessel

    vessel = vessel_of(arguments)
    options = log_options(arguments, vessel)
    refuse_twice(arguments.logs)
    refuse_twice(arguments.holdout)
    print_newer([*arguments.logs, *arguments.holdout])
    with ProgressBar("reading") as bar:
        counted = options.reading._replace(progress=bar.update_share)
        asked = counted._replace(path_delay=bool(arguments.out))
        fitted, held_out = (
            [load_run(path, None, arguments.reverse_rudder, options._replace(reading=reading)) for path in paths]
            for paths, reading in ((arguments.logs, asked), (arguments.holdout, counted))
        )
    known = recorded_vessel(fitted) if vessel is None else vessel
    filed = math.inf if known is None else known.rudder.slower_rate
    by_thrust = known is not None and known.drive.kind != "rudder"
    with ProgressBar("rudder's rate") as bar:
        ordered = slower_rudder(fitted, filed, by_thrust=by_thrust, progress=bar.update)
    as_ordered = fitted, held_out
    if ordered is not None and ordered.is_sure:
        fitted, held_out = ([with_rudder_of(run, ordered) for run in runs] for runs in (fitted, held_out))
    driven = identified_by_thrust(arguments, vessel, fitted, held_out)
    if driven is not None:
        text, verdict = driven
        print(text)
        _refuse_below(arguments, verdict)
        return int(ExitCode.OK)
    if arguments.out:
        from autopilot.cli.identify_vessel import Given, boat_for

        given = Given(vessel, arguments.rudder_max_deg, arguments.rudder_at_full_deg)
        boat = boat_for(arguments.out, fitted, given)
    doubt = None if ordered is None else (as_ordered, ordered)
    result = _identify(arguments, steady, _prior(arguments.length_m, known), fitted, held_out, doubt)
    result = result._replace(gear=gear_check(as_ordered[0], filed, result.rudder_rate))
    shown = report.as_json if arguments.json else report.as_text
    if not (verdict := report.verdict_on(result)).serves(arguments.at_least):
        print(shown(result))
        _refuse_below(arguments, verdict)
    if arguments.out:
        from autopilot.cli.identify_vessel import NoGainsError, write_vessel

        try:
            result = result._replace(remarks=tuple(write_vessel(arguments.out, result, boat, given)))
        except NoGainsError as error:
            print(shown(result._replace(no_gains=error.why)))
            raise
        except InputError:
            print(shown(result))
            raise  # a fit of minutes is shown even where its file cannot be
    print(shown(result))
    if arguments.report:
        _write_report(arguments, result, steady)
    if arguments.out and not arguments.json:
        print(f"\nWrote the model to {arguments.out}; look over its rudder section before you design gains for it.")
    if arguments.report and not arguments.json:
        print(f"\nWrote the report to {arguments.report}.")
    return int(ExitCode.OK)


def _refuse_below(arguments: argparse.Namespace, verdict: Verdict) -> None:
    """Raise RefusedError where the model is not as good as --at-least asks."""
    if not verdict.serves(arguments.at_least):
        raise RefusedError(f"{arguments.out or 'the model'} is not written: {verdict.sentence}")


def _check(arguments: argparse.Namespace, method: Method) -> None:
    _check_model(arguments, method)
    if arguments.course_unstable and (arguments.model.startswith("nomoto") or arguments.steady_turns):
        raise InputError(
            "--course-unstable needs n3 fitted from the LOGs: leave out --model nomoto and --steady-turns."
        )
    if arguments.logs:
        return
    if not arguments.steady_turns:
        raise InputError("identify needs a LOG, or --steady-turns FILE with --gain-1-s K.")
    if arguments.gain_1_s is None:
        raise InputError("--steady-turns without a LOG needs --gain-1-s K: steady turns tell n3 only for a known K.")
    for name in ("holdout", "out", "report"):
        if getattr(arguments, name):
            raise InputError(f"--{name} needs a LOG to fit: steady turns alone give no time constant.")


def _steady_turns(path: str) -> SteadyTurns:
    from autopilot.identification.identified import SteadyTurns
    from autopilot.logs.csv_log import STEADY_TURN_NEEDS, read_csv

    table, _ = read_csv(path, None, STEADY_TURN_NEEDS)
    return SteadyTurns(table["rudder_rad"], table["yaw_rate_rad_s"], table.get("speed_m_s"))


def _identify(
    arguments: argparse.Namespace,
    steady: SteadyTurns | None,
    prior: BoatPrior | None,
    fitted: list[Run],
    held_out: list[Run],
    rudder: tuple[tuple[list[Run], list[Run]], RudderRate] | None,
) -> Result:
    """Return the answer; rudder: fitted runs and others as they were ordered, and a rate found by turning, whose doubt
    goes in."""
    from autopilot.cli.terminal import ProgressBar
    from autopilot.identification import ordered_rudder as by_turning
    from autopilot.identification.registry import METHODS, method_named

    method = method_named(arguments.method)
    with ProgressBar("identifying") as bar:
        question = _form_of(arguments)._replace(
            reference_speed=arguments.reference_speed_m_s,
            steady_turns=steady,
            gain=arguments.gain_1_s,
            forgetting=arguments.forgetting,
            weighting=arguments.weighting,
            progress=bar.update,
            prior=prior if method.name == METHODS[0].name else None,
        )
        choice = _chosen(fitted, question, bar.update) if arguments.model == "auto" else None
        rate = None if rudder is None else rudder[1]
        if choice is not None and choice.chosen not in ("norrbin", "norrbin unstable"):
            found = choice.found
            question = choice.form._replace(reference_speed=found.model.reference_speed, progress=bar.update)
        elif rudder is None:
            found = method.identify(fitted, question)
        else:
            found, rate = by_turning.identified_behind(
                rudder[0][0], rudder[1], lambda runs: method.identify(runs, question)
            )
        if rudder is not None:
            at_speed = question._replace(reference_speed=found.model.reference_speed)
            as_ordered, others = rudder[0]
            if rate is not None:
                found = by_turning.with_rate(found, as_ordered, rate, lambda runs: method.identify(runs, at_speed))
            fitted, held_out = as_ordered, others
            if (moved := found.rudder_rate) is not None:
                fitted, held_out = (
                    [by_turning.with_rudder_of(run, moved) for run in runs] for runs in (fitted, held_out)
                )
    result = _result(choice.chosen if choice else arguments.model, found, fitted, held_out)
    return result._replace(residual_tests=found.residual_tests(fitted), choice=choice)


def _prior(length: float | None, vessel: Vessel | None) -> BoatPrior | None:
    """Return what other boats say of one of this `length` [m], or of that of `vessel`; None where neither is known."""
    from autopilot.vessel.file import boats_prior

    if length is None and vessel is not None:
        length = vessel.length_m
    return None if length is None else boats_prior(length, (vessel.name,) if vessel is not None else ())


def _form_of(arguments: argparse.Namespace) -> Question:
    """Return the form that --model, --course-unstable, --fit-rudder and --trim ask for; of auto, that of norrbin."""
    from autopilot.identification.model_choice import FORMS

    named = FORMS[arguments.model if arguments.model in FORMS else "norrbin"]
    train = (*named.rudder_train, *(name for name in _rudder_train(arguments) if name not in named.rudder_train))
    own = {"course_unstable": arguments.course_unstable, "rudder_train": train, "trim": arguments.trim}
    return named._replace(weighting=arguments.weighting, **own)


def _check_model(arguments: argparse.Namespace, method: Method) -> None:
    """Raise InputError where --model or --trim do not go with the other options."""
    from autopilot.identification.registry import that_take

    asked = f"--model {arguments.model}" if arguments.model in ("auto", "nomoto2", "norrbin-n2") else ""
    asked, option = (asked, "models") if asked else ("--trim per-run" if arguments.trim == "per-run" else "", "trim")
    if asked and option not in method.takes:
        raise InputError(
            f"{asked} goes with --method {that_take(option)}, not with {method.name}; leave one of them out."
        )
    if arguments.model == "auto" and (
        arguments.course_unstable or arguments.steady_turns or arguments.fit_rudder or arguments.trim == "per-run"
    ):
        raise InputError(
            "--model auto chooses by itself: leave out --course-unstable, --steady-turns, --fit-rudder and --trim."
        )


def _chosen(runs: Sequence[Run], question: Question, progress: Callable[[int, int], None]) -> Choice:
    """Return the candidates fitted to the runs, stated at one speed, and the one to take."""
    from autopilot.identification.identify import identify
    from autopilot.identification.model_choice import choose
    from autopilot.identification.runs import mean_speed

    speed = mean_speed(runs) if question.reference_speed is None else question.reference_speed

    def fit(some: Sequence[Run], form: Question) -> Identified:
        return identify(some, form._replace(reference_speed=speed))

    return choose(runs, fit, progress)


def _rudder_train(arguments: argparse.Namespace) -> tuple[str, ...]:
    """Return the fields of RudderTrain that are asked for. Raises InputError."""
    from autopilot.identification.registry import method_named, that_take
    from autopilot.identification.rudder_path import RudderTrain

    can_fit = "rudder" in method_named(arguments.method).takes
    names = tuple(part.strip().replace("-", "_") for part in arguments.fit_rudder.split(",") if part.strip())
    unknown = [name for name in names if name not in RudderTrain._fields]
    if unknown:
        raise InputError(f"--fit-rudder {unknown[0].replace('_', '-')}: write some of delay,lag,lead,dead-band.")
    if names and (not can_fit or arguments.model != "norrbin" or arguments.course_unstable):
        raise InputError(
            f"--fit-rudder goes with --method {that_take('rudder')} and --model norrbin, without --course-unstable."
        )
    if names and arguments.steady_turns:
        raise InputError("--fit-rudder and --steady-turns exclude each other: turns tell nothing of a lag.")
    return names


def _write_report(arguments: argparse.Namespace, result: Result, steady: SteadyTurns | None) -> None:
    """Write the page; the recursive methods run once more beside, for how they converged."""
    from autopilot.cli.terminal import ProgressBar
    from autopilot.files.saving import save_page
    from autopilot.identification.identified import Question
    from autopilot.identification.registry import METHODS, method_named
    from autopilot.report.identification_page import identification_page

    fitted, asked = [run for run, role, _ in result.predictions if role == "fit"], method_named(arguments.method)
    convergence = {}
    with ProgressBar("reporting") as bar:
        for number, method in enumerate(METHODS):
            bar.update(number, len(METHODS))
            try:
                found = result.found
                if method.name != asked.name:
                    kind: ModelKind = "nomoto" if result.kind.startswith("nomoto") else "norrbin"
                    question = Question(kind, found.model.reference_speed, found.model.n1 < 0.0)
                    found = method.identify(fitted, question._replace(forgetting=arguments.forgetting))
            except InputError:
                continue  # a method that these runs do not suit has nothing to show
            if found.convergence is not None:
                convergence[method.name] = found.convergence
    page = identification_page(result, asked.name, shlex.join(arguments.typed), steady, convergence)
    save_page(arguments.report, page)


def _result(kind: str, found: Identified, fitted: Sequence[Run], held_out: Sequence[Run]) -> Result:
    from autopilot.identification.prediction_bands import forecast, gear_at, in_the_race
    from autopilot.identification.rudder_path import rudder_rate_of
    from autopilot.identification.two_stage import nomoto_stage
    from autopilot.report.identification import Result, undetermined

    predictions = [(run, "fit", found.predict(run)) for run in fitted]
    predictions += [(run, "holdout", found.predict(run)) for run in held_out]
    speed, measured, expected = found.model.reference_speed, rudder_rate_of(fitted), None
    if found.predictor is not None and not undetermined(found):
        expected = forecast(found.predictor, *in_the_race(found.around, fitted, speed), gear_at(measured, fitted))
    stage_one = nomoto_stage(fitted, speed)
    return Result(kind, found, stage_one, predictions, rudder_rate=found.rudder_rate or measured, forecast=expected)
