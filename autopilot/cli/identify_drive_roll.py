"""What `autopilot identify` does beside the rudder: a boat that steers by thrust, and how a boat rolls.

By thrust: its model, and how it goes with speed and throttle. `--roll`: how a boat rolls under its rudder, and the
section of the law that damps it.
"""

from __future__ import annotations

import argparse
import dataclasses
import datetime
import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from autopilot.errors import InputError, RefusedError
from autopilot.files.printable import aligned, json_text
from autopilot.identification.runs import Run, seconds

if TYPE_CHECKING:
    from autopilot.identification.drive_effect import DriveFit, Prediction
    from autopilot.identification.prediction_bands import Forecast
    from autopilot.identification.roll import RollModel
    from autopilot.identification.verdict import Verdict
    from autopilot.vessel.schema import Vessel

NOT_HERE = ("steady_turns", "course_unstable", "fit_rudder", "report")
"""Options of the fit for a rudder."""


def identified_by_thrust(
    arguments: argparse.Namespace, vessel: Vessel | None, fitted: Sequence[Run], held_out: Sequence[Run]
) -> tuple[str, Verdict] | None:
    """Return what is found, as text or JSON, and what it is good for; None for a boat with a rudder.

    The file is written where the model is as good as --at-least asks. Raises InputError; where no command could read
    the file what is found is printed before.
    """
    from autopilot.models.drives import DRIVES
    from autopilot.vessel.file import load_vessel, parse_vessel

    header = next((run.vessel for run in fitted if run.vessel), "")
    if arguments.out and Path(arguments.out).exists():
        vessel = load_vessel(arguments.out)
    elif vessel is None and header:
        vessel = parse_vessel(header, f"{fitted[0].source} (header)")
    kind = DRIVES["rudder" if vessel is None else vessel.drive.kind]
    if vessel is None or kind.usual.is_rudder:
        return None
    for name in NOT_HERE:
        if getattr(arguments, name):
            raise InputError(
                f"--{name.replace('_', '-')} is for a rudder, and drive.kind is {kind.name}; leave it out."
            )
    from autopilot.identification.drive_effect import fit_drive, predict_drive
    from autopilot.identification.verdict import verdict_by_thrust

    _check_thrusters(vessel, (*fitted, *held_out))
    fit = fit_drive(fitted, kind.usual, kind.needs)
    ahead = _forecast(fitted, fit, vessel)
    rows = [
        (run, role, predict_drive(run, fit)) for role, runs in (("fit", fitted), ("holdout", held_out)) for run in runs
    ]
    verdict = verdict_by_thrust(fit, [found for _, _, found in rows], sum(map(seconds, fitted)))
    shown = _document(fit, rows, ahead, verdict) if arguments.json else _lines(kind.name, fit, rows, ahead, verdict)
    text = "\n".join(shown) if isinstance(shown, list) else json_text(shown)
    if not (arguments.out and verdict.serves(arguments.at_least)):
        return text, verdict
    try:
        _write(arguments.out, vessel, fit, fitted)
    except InputError:
        print(text)
        raise  # as of a boat with a rudder
    return text if arguments.json else f"{text}\n\nWrote the model to {arguments.out}.", verdict


def _check_thrusters(vessel: Vessel, runs: Sequence[Run]) -> None:
    """Raise InputError where a log of ours was sailed by another thrust curve of two thrusters than the file's: it
    holds the moment that was ordered, and nothing tells what the outputs were."""
    from autopilot.vessel.file import parse_vessel

    filed = vessel.drive.thrust_exponent, vessel.drive.astern_share
    for run in runs:
        if not run.vessel:
            continue
        drive = parse_vessel(run.vessel, f"{run.source} (header)").drive
        if (drive.thrust_exponent, drive.astern_share) != filed:
            raise InputError(
                f"{run.source}: sailed with another drive.thrust_exponent or astern_share than the file's, and its "
                "steering holds for those; give the file that it was sailed with, or sail the trial anew."
            )


def _forecast(runs: Sequence[Run], fit: DriveFit, vessel: Vessel) -> Forecast | None:
    """Return what the boat will do, at the mean speed and throttle; None where the runs do not tell."""
    from autopilot.identification.drive_effect import at_one_throttle, likely_drive
    from autopilot.identification.likelihood_model import ordered
    from autopilot.identification.prediction_bands import forecast
    from autopilot.runtime.build import gear_of

    likely = likely_drive(runs, fit)
    if likely is None:
        return None
    gear = gear_of(vessel)
    # behind orders the gear's lag is fitted with the boat
    gear = gear._replace(lag=0.0) if ordered(runs) else gear
    return forecast(likely, at_one_throttle(runs, fit.law), fit.model.reference_speed, gear)


def _document(
    fit: DriveFit, rows: Sequence[tuple[Run, str, Prediction]], ahead: Forecast | None, verdict: Verdict
) -> dict[str, Any]:
    from autopilot.report.identification import forecast_document

    model, law = fit.model, fit.law
    return {
        "verdict": verdict._asdict(),
        "parameters": {
            "K_1_s": model.gain,
            "T_s": model.time_constant,
            "n1": model.n1,
            "n3_s2_rad2": model.n3,
            "n0_rad_s": model.n0,
        },
        "reference_speed_m_s": model.reference_speed,
        "law": law._asdict(),
        "standard_errors": fit.errors,
        "runs": [
            {"source": run.source, "role": role, "yaw_rate_r2": found.r2, "rms_deg_s": math.degrees(found.rms)}
            for run, role, found in rows
        ],
        "forecast": forecast_document(ahead),
        "notes": [*fit.sentences, *(note for run, _, _ in rows for note in run.notes)],
    }


def _lines(
    kind: str, fit: DriveFit, rows: Sequence[tuple[Run, str, Prediction]], ahead: Forecast | None, verdict: Verdict
) -> list[str]:
    from autopilot.report.identification import FORECAST, forecast_rows

    model, errors = fit.model, fit.errors
    lines = [
        verdict.sentence[0].upper() + verdict.sentence[1:],
        "",
        f"Drive {kind}, at {model.reference_speed:.2f} m/s"
        + ("" if math.isnan(fit.law.throttle) else f" and {100.0 * fit.law.throttle:.0f} % throttle")
        + ":",
        f"  K   {model.gain:.4g} +- {1.96 * errors['gain']:.2g} 1/s",
        f"  T   {model.time_constant:.4g} +- {1.96 * errors['time_constant']:.2g} s",
        f"  n1  {model.n1:+g}",
        f"  n3  {model.n3:.4g} s^2/rad^2",
        f"  n0  {math.degrees(model.n0):.3g} deg/s",
        *fit.sentences,
        "",
        "Prediction of the yaw rate from rudder, speed and throttle alone:",
    ]
    lines += [
        f"  {role:8} R2 {'-' if found.r2 is None else f'{found.r2:.3f}'}, {math.degrees(found.rms):.2f} deg/s rms  "
        f"{run.source}"
        for run, role, found in rows
    ]
    if ahead is not None:
        lines += ["", f"{FORECAST}:", *aligned(forecast_rows(ahead))]
    return [*lines, *(note for run, _, _ in rows for note in run.notes)]


def _write(path: str, vessel: Vessel, fit: DriveFit, runs: Sequence[Run]) -> None:
    """Write the model into the vessel file at `path`; of a new file the gains are left out, which are another model's.

    Raises InputError where no command could read it.
    """
    from autopilot.files.saving import save_text
    from autopilot.vessel.file import model_section, rounded, text_for
    from autopilot.vessel.schema import Control

    errors: dict[str, float | None] = {name: fit.errors.get(name) for name in ("gain", "time_constant")}
    log = tuple(Path(run.source).name for run in runs)
    section = model_section(fit.model, errors, "identified", datetime.date.today().isoformat(), log)
    law, fitted = fit.law, fit.errors
    model = dataclasses.replace(
        section,
        speed_exponent=rounded(law.speed_exponent),
        throttle_exponent=rounded(law.throttle_exponent),
        damping_share=rounded(law.damping_share) if "damping_share" in fitted else None,
        way_exponent=None if math.isnan(law.throttle) else rounded(law.way_exponent),
        slowest_m_s=rounded(law.slowest * fit.model.reference_speed),
        fastest_m_s=rounded(law.fastest * fit.model.reference_speed),
        reference_throttle=None if math.isnan(law.throttle) else rounded(law.throttle),
        standard_errors=dataclasses.replace(
            section.standard_errors,
            **{
                name: float(f"{fitted[name]:.3g}")
                for name in ("speed_exponent", "throttle_exponent", "damping_share")
                if name in fitted
            },
        ),
    )
    made = dataclasses.replace(vessel, model=model)
    if not Path(path).exists():
        control = Control(rate_hz=vessel.control.rate_hz, loop_delay_s=vessel.control.loop_delay_s)
        made = dataclasses.replace(made, name=Path(path).stem, description="", control=control)
    save_text(path, text_for(path, made))


NAMES = {
    "frequency": ("natural frequency", "rad/s"),
    "damping": ("damping ratio", "-"),
    "rudder": ("b_delta, roll by rudder", "1/s^2"),
    "yaw": ("b_r, roll by yaw rate", "1/s"),
}


def identified_roll(arguments: argparse.Namespace) -> str:
    """Identify the roll of the one LOG, write the section where --out is given, and return what to print.

    Raises InputError where the log has no roll or its rudder does not move it, or where no law can be made of it.
    """
    from autopilot.cli.log import log_options, print_newer, vessel_of
    from autopilot.cli.options import check_places
    from autopilot.cli.terminal import ProgressBar
    from autopilot.identification.roll import identify_roll  # scipy.signal is slow to load
    from autopilot.logs.reading import load_recording
    from autopilot.logs.table import table_of
    from autopilot.vessel.file import load_vessel

    if len(arguments.logs) != 1:
        raise InputError("--roll takes one LOG; merge several of one run with LOG+LOG.")
    for name in ("holdout", "report", "steady_turns", "method", "fit_rudder", "course_unstable"):
        if getattr(arguments, name):
            raise InputError(f"--roll and --{name.replace('_', '-')} exclude each other; leave one of them out.")
    (log,) = arguments.logs
    vessel = vessel_of(arguments)
    if arguments.out:
        check_places(None, arguments.out)
        if Path(arguments.out).exists():
            vessel = load_vessel(arguments.out)
        elif vessel is None:
            raise InputError(
                f"{arguments.out}: give --vessel FILE with the boat's model and rudder; roll alone steers none."
            )
    print_newer([log])
    with ProgressBar("reading") as bar:
        reading = log_options(arguments, vessel_of(arguments)).reading
        recording = load_recording(log, reading._replace(progress=bar.update_share))
    columns = dict(table_of(recording, log_options(arguments, vessel).rudder).columns)
    if arguments.reverse_rudder and "rudder_rad" in columns:
        columns["rudder_rad"] = -columns["rudder_rad"]
    speed = arguments.reference_speed_m_s if vessel is None else vessel.model.reference_speed_m_s
    model = identify_roll(log, columns, speed)
    text = as_json(model) if arguments.json else as_text(log, model)
    if not arguments.out or vessel is None:
        return text
    words = _write_roll(arguments.out, model, vessel, log)
    return text if arguments.json else f"{text}\n\n{words}"


def as_text(log: str, model: RollModel) -> str:
    """Return the model for people, with 95 % intervals."""
    lines = [f"Roll of {log}: {model.seconds:.0f} s, at {model.reference_speed:.2f} m/s", ""]
    lines.append(f"{'':26s} {'value':>10s}   95 % interval")
    for name in NAMES:
        words, unit = NAMES[name]
        low, high = model.interval(name)
        lines.append(f"{words:26s} {getattr(model, name):10.4g}   {low:.4g} to {high:.4g} {unit}")
    period = 2.0 * math.pi / model.frequency
    lines += ["", f"Period {period:.1f} s; {math.degrees(model.left_rms):.1f} deg rms of roll are not the rudder's."]
    return "\n".join(lines)


def as_json(model: RollModel) -> str:
    """Return the model as JSON, in SI units and radians."""
    found = {name: getattr(model, name) for name in (*NAMES, "reference_speed", "left_rms", "seconds")}
    intervals = {name: model.interval(name) for name in NAMES}
    return json_text({**found, "intervals": intervals, "roll_row": model.row()})


def _write_roll(path: str, model: RollModel, vessel: object, log: str) -> str:
    from autopilot.control.sliding_roll import roll_section
    from autopilot.files.saving import save_text
    from autopilot.runtime.build import law_boat_of, law_of
    from autopilot.vessel.file import text_for
    from autopilot.vessel.schema import Vessel

    assert isinstance(vessel, Vessel)
    low, high = model.interval("rudder")
    if low <= 0.0 <= high:
        raise InputError(
            f"{path} is not written: b_delta may be 0 ({low:.3g} to {high:.3g} 1/s^2); record a longer trial."
        )
    today = datetime.date.today().isoformat()
    try:
        section = roll_section(model.row(), law_boat_of(vessel), f"roll identified from {Path(log).name}", today)
        control = dataclasses.replace(vessel.control, law="sliding_roll", roll=None)
        # the sections of laws are made of the registry, which no type checker sees
        control = dataclasses.replace(control, sliding_roll=section)  # type: ignore[call-arg]
        changed = dataclasses.replace(vessel, control=control)
        law_of(changed)
    except (ValueError, RefusedError) as error:
        raise InputError(f"{path} is not written, for no gains follow from this model: {error}") from None
    save_text(path, text_for(path, changed))
    return f"Wrote control.sliding_roll to {path}, and made it the law that steers; control.roll is left out."
