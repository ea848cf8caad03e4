"""Gains judged from every side: margins, the worst boat within the model's uncertainty, and large errors."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    from autopilot.control.design import Margins, Spread, Verdict
    from autopilot.control.large_errors import Loop, Recovery
    from autopilot.control.observed_margins import ObservedMargins
    from autopilot.params.vessel import Vessel

ASSUMED_SPREAD = 0.2
"""How far K and T may be off, to either side, where the file holds no standard errors."""
SIGMAS = 2.0
LARGE_ERRORS_DEG = (5.0, 20.0, 45.0, 90.0)


class Judged(NamedTuple):
    """A vessel's law: its verdict, the worst margins within `spread`, said in words, what large errors do, and the
    margins with the heading filter in the loop, in calm water and in the strongest gusts that it learns."""

    vessel: Vessel
    law: str
    verdict: Verdict
    worst: Margins
    spread: str
    recoveries: list[Recovery]
    observed: ObservedMargins
    in_gusts: ObservedMargins


def judged(vessel: Vessel, law: str) -> Judged:
    """Return the gains of the vessel's `law` judged."""
    from autopilot.build import observed_of, verdict_of
    from autopilot.build_laws import gear_of, law_of, limits_of, loop_gains_of, model_of
    from autopilot.control.design import worst_margins
    from autopilot.control.large_errors import recoveries
    from autopilot.control.observed_margins import observed_margins

    verdict = verdict_of(vessel, law)
    spread, words = spread_of(vessel)
    gains = loop_gains_of(vessel, law)
    worst = worst_margins(
        model_of(vessel), gear_of(vessel), limits_of(vessel).rate_max, vessel.control.loop_delay_s, gains, spread
    )
    errors = [math.radians(error) for error in LARGE_ERRORS_DEG]
    found = recoveries(loop_of(vessel), law_of(vessel, law), verdict.margins.crossover, errors)
    calm, gusty = (observed_margins(observed_of(vessel, law, in_gusts=in_gusts)) for in_gusts in (False, True))
    return Judged(vessel, law, verdict, worst, words, found, calm, gusty)


def loop_of(vessel: Vessel) -> Loop:
    """Return the vessel's boat and rudder as the simulation of large errors takes them."""
    from autopilot.build_laws import gear_of, limits_of, model_of
    from autopilot.control.large_errors import Loop

    control = vessel.control
    return Loop(model_of(vessel), gear_of(vessel), limits_of(vessel), control.loop_delay_s, control.rate_hz)


def spread_of(vessel: Vessel) -> tuple[Spread, str]:
    """Return how far K and T may be off, relative, and that in words."""
    from autopilot.control.design import Spread

    model, errors = vessel.model, vessel.model.standard_errors
    if errors.K_1_s is None or errors.T_s is None:
        words = f"K and T off by {100.0 * ASSUMED_SPREAD:.0f} %, assumed: the file holds no standard errors"
        return Spread(ASSUMED_SPREAD, ASSUMED_SPREAD), words
    # a boat of no gain or no time constant is none
    gain, time = (min(SIGMAS * e / v, 0.9) for e, v in ((errors.K_1_s, model.K_1_s), (errors.T_s, model.T_s)))
    words = f"K off by {100.0 * gain:.1f} % and T by {100.0 * time:.1f} %, {SIGMAS:.0f} standard errors"
    return Spread(gain, time), words


def gains_of(each: Judged) -> dict[str, float]:
    """Return the gains by their keys in the file; of the heading and roll law those that its quiet law comes to."""
    from dataclasses import asdict

    from autopilot.build_laws import ROLL_LAW, gains_in_force

    if each.law == ROLL_LAW:
        heading, rate = gains_in_force(each.vessel, each.law)
        return {"quiet_rudder_per_heading": heading, "quiet_rudder_per_rate_s": rate}
    gains = getattr(each.vessel.control, each.law)
    return {key: float(value) for key, value in asdict(gains).items()}


def as_json(each: Judged) -> dict[str, Any]:
    """Return everything with the unit in the key; null for what is infinite."""
    found = each.verdict.margins
    return {
        "gains": gains_of(each),
        "stable": found.stable,
        "gain_margin": _finite(found.gain),
        "phase_margin_deg": math.degrees(found.phase),
        "delay_margin_s": _finite(found.delay),
        "worst_sensitivity": found.sensitivity,
        "with_heading_filter": _observed(each.observed),
        "with_heading_filter_in_gusts": _observed(each.in_gusts),
        "crossover_rad_s": found.crossover,
        "rudder_rate_saturates_at_heading_error_deg": _finite(math.degrees(found.saturation)),
        "worst_boat": {
            "spread": each.spread,
            "stable": each.worst.stable,
            "worst_sensitivity": each.worst.sensitivity,
            "phase_margin_deg": math.degrees(each.worst.phase),
        },
        "large_errors": [
            {
                "error_deg": math.degrees(row.error),
                "corrected": row.corrected,
                "overshoot_deg": math.degrees(row.overshoot),
                "settling_s": _finite(row.settling),
                "swings_at_the_end_deg": math.degrees(row.swing),
            }
            for row in each.recoveries
        ],
        "refusal": each.verdict.refusal or None,
    }


def _observed(found: ObservedMargins) -> dict[str, Any]:
    return {
        "stable": found.stable,
        "delay_margin_s": _finite(found.delay),
        "worst_sensitivity": _finite(found.sensitivity),
        "K_may_be_smaller_by_factor": found.gain_down,
        "K_may_be_larger_by_factor": _finite(found.gain_up),
    }


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def as_text(rows: dict[str, Judged]) -> str:
    """Return the table, a few lines for each."""
    lines = [
        f"{'':24}{'gain':>8}{'phase':>9}{'delay':>9}{'worst':>13}{'crossover':>12}{'rate saturates':>16}",
        f"{'':24}{'margin':>8}{'margin':>9}{'margin':>9}{'sensitivity':>13}{'rad/s':>12}{'at error':>16}",
    ]
    for name, each in rows.items():
        found = each.verdict.margins
        if found.stable:
            lines.append(
                f"{name:24}{found.gain:8.2f}{math.degrees(found.phase):5.0f} deg{found.delay:7.2f} s"
                f"{found.sensitivity:13.2f}{found.crossover:12.3f}{math.degrees(found.saturation):12.2f} deg"
            )
        else:
            lines.append(f"{name:24}unstable")
        lines.append("    " + "  ".join(f"{key} {value:g}" for key, value in gains_of(each).items()))
        lines += [f"    {sentence}" for sentence in sentences(each)]
    return "\n".join(lines)


def sentences(each: Judged) -> list[str]:
    """Return what the worst boat and large errors do, and why the gains are refused where they are."""
    said = []
    if each.verdict.margins.stable:
        said.append(f"with the heading filter: {_observed_in_words(each.observed)}")
        if each.in_gusts != each.observed:
            said.append(f"in the strongest gusts: {_observed_in_words(each.in_gusts)}")
        outcome = f"worst sensitivity {each.worst.sensitivity:.2f}" if each.worst.stable else "UNSTABLE"
        said.append(f"worst boat ({each.spread}): {outcome}")
    good = [row for row in each.recoveries if row.corrected]
    bad = [row for row in each.recoveries if not row.corrected]
    if good:
        past = ", ".join(
            f"{math.degrees(row.error):.0f} deg: {math.degrees(row.overshoot):.1f} deg past in {row.settling:.1f} s"
            for row in good
        )
        said.append(f"large errors, without a planned turn: {past}")
    if bad:
        said.append(
            f"from {math.degrees(bad[0].error):.0f} deg the rudder's limits leave it swinging by "
            f"{max(math.degrees(row.swing) for row in bad):.1f} deg"
        )
    return [*said, each.verdict.refusal] if each.verdict.refusal else said


def _observed_in_words(found: ObservedMargins) -> str:
    if not found.stable:
        return "UNSTABLE"
    least = f"{found.gain_down:.2f}" if found.gain_down > 0.0 else "next to nothing"
    most = f"{found.gain_up:.1f}" if math.isfinite(found.gain_up) else "any"
    return (
        f"delay margin {found.delay:.2f} s, worst sensitivity {found.sensitivity:.2f}, "
        f"K from {least} to {most} times the model's"
    )
