"""`autopilot gains`: gains from model, rudder and delay, and the margins they and the file's own leave."""

from __future__ import annotations

import argparse
import json
import math
from typing import TYPE_CHECKING, Any

from autopilot.errors import ExitCode, RefusedError

if TYPE_CHECKING:
    from autopilot.control.design import Verdict
    from autopilot.params.vessel import Vessel

PID_INTEGRAL_TIME = 10.0
"""Integral time [s] of the PID beside it, or three time constants if that is longer."""


def add_parser(subparsers: argparse._SubParsersAction[Any]) -> None:
    """Add the subcommand."""
    parser = subparsers.add_parser(
        "gains",
        help="design gains for a vessel's model and rudder, and show the margins",
        description="Design k1, k2 and gamma for the vessel's model, rudder and delay, beside the file's own gains.",
    )
    parser.add_argument("vessel", metavar="VESSEL.yaml", help="vessel file, or the name of a shipped one (lanxin)")
    parser.add_argument("--out", metavar="FILE.yaml", help="write the vessel with the designed gains")
    parser.add_argument("--json", action="store_true", help="print JSON")
    parser.set_defaults(run=run)


def designed(vessel: Vessel) -> Vessel:
    """Return the vessel with gains designed for it. Raises RefusedError where no gain serves."""
    from dataclasses import replace

    from autopilot.build import gear_of, limits_of, model_of
    from autopilot.control.design import design_backstepping, equivalent_pid
    from autopilot.params.vessel import Backstepping, Pid

    model = model_of(vessel)
    try:
        gains = design_backstepping(model, gear_of(vessel), limits_of(vessel).rate_max, vessel.control.loop_delay_s)
    except ValueError as error:
        raise RefusedError(f"vessel {vessel.name!r}: {error}") from error
    pid = equivalent_pid(model, gains, max(PID_INTEGRAL_TIME, 3.0 * model.time_constant))
    control = replace(
        vessel.control,
        backstepping=Backstepping(*(round(gain, 5) for gain in gains)),
        pid=Pid(*(round(gain, 5) for gain in pid)),
    )
    return replace(vessel, control=control)


def run(arguments: argparse.Namespace) -> int:
    """Design, print, write; exit code 4 where the file's own gains must not be engaged and none were asked for."""
    from pathlib import Path

    from autopilot.build import verdict_of
    from autopilot.params.editing import updated_vessel_text
    from autopilot.params.saving import save_text
    from autopilot.params.vessel_file import dump_vessel, load_vessel

    vessel = load_vessel(arguments.vessel)
    better = designed(vessel)
    rows = {
        "designed backstepping": (better, verdict_of(better, "backstepping")),
        "designed pid": (better, verdict_of(better, "pid")),
    }
    for law in ("backstepping", "pid"):
        if getattr(vessel.control, law) is not None:
            rows[f"file's {law}"] = (vessel, verdict_of(vessel, law))
    if arguments.json:
        print(json.dumps({name: _as_json(holder, name, verdict) for name, (holder, verdict) in rows.items()}, indent=2))
    else:
        print(_as_text(rows))
    if arguments.out:
        paths = Path(arguments.out), Path(arguments.vessel)
        is_same = all(path.exists() for path in paths) and paths[0].samefile(paths[1])
        before = paths[0].read_text(encoding="utf-8-sig") if is_same else None
        save_text(arguments.out, updated_vessel_text(before, better, arguments.out) if before else dump_vessel(better))
        if not arguments.json:
            print(f"\nWrote {arguments.out}.")
    return int(ExitCode.OK)


def _gains(vessel: Vessel, name: str) -> dict[str, float]:
    from dataclasses import asdict

    law = vessel.control.pid if name.endswith("pid") else vessel.control.backstepping
    assert law is not None
    return asdict(law)


def _as_json(vessel: Vessel, name: str, verdict: Verdict) -> dict[str, Any]:
    found = verdict.margins
    return {
        "gains": _gains(vessel, name),
        "stable": found.stable,
        "gain_margin": _finite(found.gain),
        "phase_margin_deg": math.degrees(found.phase),
        "delay_margin_s": _finite(found.delay),
        "worst_sensitivity": found.sensitivity,
        "crossover_rad_s": found.crossover,
        "rudder_rate_saturates_at_heading_error_deg": _finite(math.degrees(found.saturation)),
        "refusal": verdict.refusal or None,
    }


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _as_text(rows: dict[str, tuple[Vessel, Verdict]]) -> str:
    lines = [
        f"{'':24}{'gain':>8}{'phase':>9}{'delay':>9}{'worst':>13}{'crossover':>12}{'rate saturates':>16}",
        f"{'':24}{'margin':>8}{'margin':>9}{'margin':>9}{'sensitivity':>13}{'rad/s':>12}{'at error':>16}",
    ]
    for name, (vessel, verdict) in rows.items():
        found = verdict.margins
        if found.stable:
            lines.append(
                f"{name:24}{found.gain:8.2f}{math.degrees(found.phase):5.0f} deg{found.delay:7.2f} s"
                f"{found.sensitivity:13.2f}{found.crossover:12.3f}{math.degrees(found.saturation):12.2f} deg"
            )
        else:
            lines.append(f"{name:24}unstable")
        lines.append("    " + "  ".join(f"{key} {value:g}" for key, value in _gains(vessel, name).items()))
        if verdict.refusal:
            lines.append(f"    {verdict.refusal}")
    return "\n".join(lines)
