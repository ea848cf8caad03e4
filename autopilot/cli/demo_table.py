"""The demo's result as a table and as JSON."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from autopilot.cli.demo_legs import DemoResult

PARAMETERS = (("K", "gain", "1/s"), ("T", "time_constant", "s"), ("n3", "n3", "s2/rad2"), ("n0", "n0", "rad/s"))
TURNS = {
    "turn-backstepping": "backstepping, UDP",
    "turn-pid": "PID, UDP",
    "turn-serial": "backstepping, serial compass",
}
MODEL_FORM = (
    "Standard errors know the instruments' noise alone. The speed in the log is that over the ground, slip included; "
    "it makes K 1 % and n3 10 % too large, more than they say."
)
HOLDS = {"sea-backstepping": "backstepping", "sea-pid": "PID"}


def as_json(result: DemoResult) -> dict[str, Any]:
    """Return the result in SI units and degrees where the key says so."""
    found = result.identified
    return {
        "seed": result.seed,
        "parameters": {
            symbol: {
                "true": getattr(result.true, name),
                "identified": getattr(found.model, name),
                "std": found.standard_errors.get(name),
                "unit": unit,
            }
            for symbol, name, unit in PARAMETERS
        },
        "rudder_delay_s": found.train.delay,
        "unidentifiable": found.unidentifiable,
        "model_form": MODEL_FORM,
        "turn_90_deg_calm": {
            TURNS[name]: {
                "overshoot_deg": math.degrees(turn.overshoot),
                "settling_s": turn.settling if math.isfinite(turn.settling) else None,
                "rudder_travel_deg": math.degrees(turn.travel),
            }
            for name, turn in result.turns.items()
        },
        "hold_sea_state_5": {
            HOLDS[name]: {
                "heading_rms_deg": math.degrees(hold.rms),
                "rudder_travel_deg_s": math.degrees(hold.travel),
            }
            for name, hold in result.holds.items()
        },
    }


def as_text(result: DemoResult) -> str:
    """Return the table."""
    found = result.identified
    lines = [f"{'identified':24}{'true':>12}{'found':>12}{'std error':>12}{'off by':>10}"]
    for symbol, name, unit in PARAMETERS:
        true, value, error = getattr(result.true, name), getattr(found.model, name), found.standard_errors.get(name)
        off = f"{100.0 * (value / true - 1.0):+.1f} %" if true else "-"
        shown = "-" if error is None else f"{error:.4f}"
        lines.append(f"  {symbol:3} {unit:18}{true:12.4f}{value:12.4f}{shown:>12}{off:>10}")
    if found.train.delay > 0.0:
        error = found.standard_errors.get("delay") or 0.0
        lines.append(
            f"  rudder's delay {found.train.delay:.3f} s +- {error:.3f} s: orders on their way, at four times the pace"
        )
    lines += [f"  {reason}" for reason in found.unidentifiable.values()]
    lines.append(f"  {MODEL_FORM}")
    lines += ["", f"{'turn of 90 deg, calm':32}{'overshoot':>12}{'settling':>12}{'rudder travel':>16}"]
    for name, turn in result.turns.items():
        settling = f"{turn.settling:.1f} s" if math.isfinite(turn.settling) else "never"
        lines.append(
            f"  {TURNS[name]:30}{math.degrees(turn.overshoot):8.2f} deg{settling:>12}"
            f"{math.degrees(turn.travel):12.1f} deg"
        )
    lines += ["", f"{'hold, sea state 5':32}{'heading rms':>12}{'':12}{'rudder travel':>16}"]
    for name, hold in result.holds.items():
        lines.append(
            f"  {HOLDS[name]:30}{math.degrees(hold.rms):8.2f} deg{'':12}{math.degrees(hold.travel):10.2f} deg/s"
        )
    return "\n".join(lines)
