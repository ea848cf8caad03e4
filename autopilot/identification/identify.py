"""From recorded runs to a model with its standard errors, and to a plain statement of what they cannot tell."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from autopilot.errors import InputError
from autopilot.identification.beside_rudder import CUBIC, with_extras
from autopilot.identification.identified import (
    LARGEST_RELATIVE_ERROR,
    Identified,
    ModelKind,
    Progress,
    SteadyTurns,
    Steps,
    identified_from,
)
from autopilot.identification.output_error import NOISE_ROUNDS, Solution, Weighting, solve
from autopilot.identification.runs import Run, has_propeller, has_wind
from autopilot.identification.starting_point import StartingPoint, starting_point, unstable_starting_point
from autopilot.identification.two_stage import CubicDamping, cubic_damping_stage

LINEAR = ("gain", "time_constant", "n0")
STEADY_ROUNDS = 3
"""K and the n3 that the steady turns give for it settle within a per cent in as many rounds."""

LEAST_RUDDER_MOVEMENT_RAD = 0.005
LEAST_SPEED_M_S = 0.02
LEAST_EXPLAINED = 0.05
"""Share of the motion that the rudder must explain before anything is fitted to it."""

CLEARLY_BACKWARDS = 0.3
"""Share of the motion that a rudder of opposite sign must explain before the sign is called wrong."""


def mean_speed(runs: Sequence[Run]) -> float:
    """Return the mean speed [m/s] over the runs' recorded time: the reference at which parameters are stated."""
    way = [float(np.trapezoid(np.abs(s.speed), s.time)) for run in runs for s in run.segments]
    time = [float(s.time[-1] - s.time[0]) for run in runs for s in run.segments]
    return sum(way) / sum(time)


def identify(
    runs: Sequence[Run],
    kind: ModelKind = "norrbin",
    reference_speed: float | None = None,
    *,
    steady_turns: SteadyTurns | None = None,
    gain: float | None = None,
    course_unstable: bool = False,
    rudder_train: Sequence[str] = (),
    weighting: Weighting = "residuals",
    progress: Progress = lambda done, total: None,
) -> Identified:
    """Return the output-error estimate from all runs together, scaled with speed.

    A "norrbin" has n3: from `steady_turns` where given (with K held at `gain` [1/s], or else at the fitted K),
    otherwise fitted with the rest and dropped again, with the reason, where it ends on its bound or cannot be
    told from zero: the linear model that is left is stable everywhere. reference_speed [m/s]: default the mean.

    course_unstable: the boat will not go straight by itself, n1 = -1; then n3 is what bounds its turning, is always
    fitted, and there is no smaller model to fall back to.

    rudder_train: names of RudderTrain to be fitted too, what lies between the recorded rudder and the water; those that
    cannot be told from 0 are left out again. Of a Norrbin without `steady_turns` only.

    weighting: "prediction-error" knows gusts from instrument noise; K, T, n3 and n0 alone, of a course-stable boat.

    Raises InputError where the rudder never moves, the boat makes no way, the motion does not follow the
    rudder, or follows it backwards.
    """
    speed = mean_speed(runs) if reference_speed is None else reference_speed
    check_excitation(runs, speed)
    fits = 1 if kind == "nomoto" else 3 if has_propeller(runs) or has_wind(runs) or rudder_train else 2
    steps = Steps(progress, total=1 + NOISE_ROUNDS * fits)
    start = starting_point(runs, speed)
    check_response(runs, start)
    steps.next()
    if course_unstable:
        unstable = unstable_starting_point(runs, start.model)
        return _unstable(solve(runs, unstable, CUBIC, steps.next), runs)
    if kind == "nomoto":
        return identified_from(solve(runs, start.model, LINEAR, steps.next, weighting=weighting), {})
    if steady_turns is not None:
        linear = solve(runs, start.model, LINEAR, steps.next, weighting=weighting)
        return _with_steady_turns(runs, linear, steady_turns, gain, steps)
    cubic = solve(runs, start.model, CUBIC, steps.next, weighting=weighting)
    plain = identified_from(cubic, {})
    if reason := _why_no_cubic(cubic):
        linear = solve(runs, cubic.model._replace(n3=0.0), LINEAR, steps.next, weighting=weighting)
        plain = identified_from(linear, {"n3": reason})
    return plain if weighting == "prediction-error" else with_extras(runs, plain, rudder_train, steps)


def _unstable(solution: Solution, runs: Sequence[Run]) -> Identified:
    if "n3" in solution.at_bound:
        raise InputError(
            f"{sources_of(runs)}: a course-unstable model (n1 = -1) does not fit: n3 ends at 0, and nothing would "
            "bound its turning; leave --course-unstable out."
        )
    return identified_from(solution, {})


def steady_damping(turns: SteadyTurns, gain: float, reference_speed: float) -> CubicDamping:
    """Return n3 at the reference speed [m/s] from steady turns, K [1/s] held at that speed."""
    ratio = np.ones(turns.rate.size) if turns.speed is None else turns.speed / reference_speed
    # with the rate in units of the speed ratio every turn obeys the equation of the reference speed
    return cubic_damping_stage(turns.rudder, turns.rate / ratio, gain)


def _with_steady_turns(
    runs: Sequence[Run], linear: Solution, turns: SteadyTurns, gain: float | None, steps: Steps
) -> Identified:
    """Fit the rest with n3 held at what the steady turns give for the K of the round before."""
    solution = linear
    for _ in range(STEADY_ROUNDS):
        K = solution.model.gain if gain is None else gain
        cubic = steady_damping(turns, K, solution.model.reference_speed)
        if cubic.n3 <= 0.0:
            reason = (
                f"n3: the steady turns give {cubic.n3:.3g} s^2/rad^2 with K = {K:.3g} 1/s, which would let the boat "
                "turn without bound, so it is held at 0; check the signs and units of the steady turns."
            )
            return identified_from(linear, {"n3": reason})._replace(steady=cubic)
        solution = solve(runs, solution.model._replace(n3=cubic.n3), LINEAR, lambda: None, rounds=2)
        steps.next()
    found = identified_from(solution, {})
    return found._replace(standard_errors={**found.standard_errors, "n3": cubic.standard_error}, steady=cubic)


def _why_no_cubic(solution: Solution) -> str:
    n3, error = solution.model.n3, solution.standard_error("n3") or 0.0
    remedy = "steady turns at large rudder angles would tell it (--steady-turns)."
    if "n3" in solution.at_bound:
        return (
            "n3: the fit ends at its bound 0 (left alone it would turn negative and the simulation diverge), so it "
            f"is held at 0; {remedy}"
        )
    if error > LARGEST_RELATIVE_ERROR * n3:
        return (
            f"n3: {n3:.3g} with a standard error of {error:.2g} s^2/rad^2 cannot be told from 0, so it is held at 0; "
            f"{remedy}"
        )
    return ""


def sources_of(runs: Sequence[Run]) -> str:
    """Return where the runs came from, in words."""
    return ", ".join(run.source for run in runs)


def check_excitation(runs: Sequence[Run], speed: float) -> None:
    """Raise InputError where the rudder never moves or the boat makes no way at a mean `speed` [m/s]."""
    movement = max(float(np.ptp(segment.rudder)) for run in runs for segment in run.segments)
    if movement < LEAST_RUDDER_MOVEMENT_RAD:
        raise InputError(
            f"{sources_of(runs)}: the rudder never moves (by {np.degrees(movement):.2f} deg in all), so nothing can be "
            "identified; record a zigzag."
        )
    if speed < LEAST_SPEED_M_S:
        raise InputError(
            f"{sources_of(runs)}: the boat makes no way (mean speed {speed:.3f} m/s), so its rudder has nothing to "
            "steer with; check the speed column and its unit."
        )


def check_response(runs: Sequence[Run], start: StartingPoint) -> None:
    """Raise InputError where the motion does not follow the rudder, or follows it backwards."""
    if start.model.gain < 0.0 and start.explained > CLEARLY_BACKWARDS:
        raise InputError(
            f"{sources_of(runs)}: the boat turns against its rudder (K = {start.model.gain:.3g} 1/s explains "
            f"{100.0 * start.explained:.0f} % of the motion); rudder must be positive to starboard and heading "
            "clockwise: pass --reverse-rudder if the recorded rudder has the opposite sign."
        )
    if start.model.gain <= 0.0 or start.explained < LEAST_EXPLAINED:
        raise InputError(
            f"{sources_of(runs)}: the motion does not follow the rudder (it explains "
            f"{100.0 * max(start.explained, 0.0):.0f} % of it), so nothing can be identified; check that heading, "
            "yaw rate and rudder are the right columns and share one clock."
        )
