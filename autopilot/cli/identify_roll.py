"""`autopilot identify --roll`: how a boat rolls under its rudder, and the section of the law that damps it."""

from __future__ import annotations

import argparse
import dataclasses
import datetime
import json
import math
from pathlib import Path

from autopilot.errors import InputError, RefusedError
from autopilot.identification.roll import PARAMETERS, RollModel, identify_roll

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
    from autopilot.files.saving import check_folder
    from autopilot.logs.reading import load_recording
    from autopilot.logs.table import table_of
    from autopilot.vessel.file import load_vessel, refuse_bare_name

    if len(arguments.logs) != 1:
        raise InputError("--roll takes one LOG; merge several of one run with LOG+LOG.")
    for name in ("holdout", "report", "steady_turns", "method", "fit_rudder", "course_unstable"):
        if getattr(arguments, name):
            raise InputError(f"--roll and --{name.replace('_', '-')} exclude each other; leave one of them out.")
    (log,) = arguments.logs
    vessel = vessel_of(arguments)
    if arguments.out:
        check_folder(arguments.out)
        refuse_bare_name(arguments.out)
        if Path(arguments.out).exists():
            vessel = load_vessel(arguments.out)
        elif vessel is None:
            raise InputError(
                f"{arguments.out}: give --vessel FILE with the boat's model and rudder; roll alone steers none."
            )
    print_newer([log])
    recording = load_recording(log, log_options(arguments, vessel_of(arguments)).reading)
    columns = dict(table_of(recording, log_options(arguments, vessel).rudder).columns)
    if arguments.reverse_rudder and "rudder_rad" in columns:
        columns["rudder_rad"] = -columns["rudder_rad"]
    speed = arguments.reference_speed_m_s if vessel is None else vessel.model.reference_speed_m_s
    model = identify_roll(log, columns, speed)
    text = as_json(model) if arguments.json else as_text(log, model)
    if not arguments.out or vessel is None:
        return text
    words = _write(arguments.out, model, vessel, log)
    return text if arguments.json else f"{text}\n\n{words}"


def as_text(log: str, model: RollModel) -> str:
    """Return the model for people, with 95 % intervals."""
    lines = [f"Roll of {log}: {model.seconds:.0f} s, at {model.reference_speed:.2f} m/s", ""]
    lines.append(f"{'':26s} {'value':>10s}   95 % interval")
    for name in PARAMETERS:
        words, unit = NAMES[name]
        low, high = model.interval(name)
        lines.append(f"{words:26s} {getattr(model, name):10.4g}   {low:.4g} to {high:.4g} {unit}")
    period = 2.0 * math.pi / model.frequency
    lines += ["", f"Period {period:.1f} s; {math.degrees(model.left_rms):.1f} deg rms of roll are not the rudder's."]
    return "\n".join(lines)


def as_json(model: RollModel) -> str:
    """Return the model as JSON, in SI units and radians."""
    found = {name: getattr(model, name) for name in (*PARAMETERS, "reference_speed", "left_rms", "seconds")}
    intervals = {name: model.interval(name) for name in PARAMETERS}
    return json.dumps({**found, "intervals": intervals, "roll_row": model.row()}, indent=2)


def _write(path: str, model: RollModel, vessel: object, log: str) -> str:
    from autopilot.control.roll_design import roll_section
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
