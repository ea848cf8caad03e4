"""The linear-quadratic-Gaussian law of `lqg_bound.py` at the helm of a real run: what full knowledge is worth there.

It knows the boat, the mean wind to half a degree of rudder, the gusts, the instruments' noise and the spectrum of the
waves on a straight course, and nothing of what makes the run harder than its equations: the rudder's stops, rate, lag
and delay, waves that push otherwise when the boat yaws, damping that grows with the rate. Its filter begins with what
is known before the first reading; it takes in each reading with the Kalman gain of that moment, and starts from the
rudder that was really commanded.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from lqg_bound import WEIGHTS, Linear, Point, regulator
from pareto_peer import afloat_step, set_afloat

from autopilot.angles import wrap
from autopilot.control.limits import limit
from autopilot.errors import InputError
from sitl.campaign.compiled_run import NOTHING, Score, Setting, Workspace, figures, readings, scored
from sitl.compiled import compiled

Floats = npt.NDArray[np.float64]

EVERY_WEIGHT = 2
"""Of the weights every so many is sailed."""


class LqgHelm(NamedTuple):
    """State x' = transition x + move u, the Kalman gains by reading (readings, states, instruments), what instruments
    show of x, the feedback u = -feedback x [rad a step], and the mean wind as a rudder angle [rad]."""

    transition: Floats
    move: Floats
    gains: Floats
    shown: Floats
    feedback: Floats
    steady: float


def kalman_gains(linear: Linear, count: int) -> Floats:
    """Return the gains of the first `count` readings, from a boat at rest on its course in waves of unknown phase."""
    covariance = np.diag([*linear.noise.diagonal()[:1], *np.full(2, 1.0e-9), *linear.spread[3:]])
    found = []
    for _ in range(count):
        covariance = linear.transition @ covariance @ linear.transition.T + linear.driven
        across = covariance @ linear.shown.T
        gain = across @ np.linalg.inv(linear.shown @ across + linear.noise)
        covariance = covariance - gain @ across.T
        covariance = 0.5 * (covariance + covariance.T)
        found.append(gain)
    return np.array(found)


def run_lqg(setting: Setting, workspace: Workspace, helm: LqgHelm) -> Score:
    """Return the score of a run on the course 0 steered by the law."""
    instruments, limits, afloat = setting.instruments, setting.campaign.config.limits, set_afloat(setting)
    every, ticks = instruments.every * setting.dt, 0
    heading, rate, _ = readings(instruments, 0, afloat.state)
    x = np.zeros(len(helm.move))
    score, command, moved = NOTHING, 0.0, 0.0
    for step in range(setting.steps):
        if step % instruments.every == 0:
            time, state = step * setting.dt, afloat.state
            x = helm.transition @ x + moved * helm.move
            gain = helm.gains[min(ticks, len(helm.gains) - 1)]
            off = wrap(heading - x[0])
            turning = rate - x[1]
            for place in range(len(x)):
                x[place] += gain[place, 0] * off
                if len(helm.shown) > 1:
                    x[place] += gain[place, 1] * turning
            x[2] = command + helm.steady
            wanted = command
            for place in range(len(x)):
                wanted -= helm.feedback[place] * x[place]
            next_command = limit(limits, command, wanted, every)
            score = scored(score, setting.course, time, state, command, next_command)
            moved, command, ticks = next_command - command, next_command, ticks + 1
        afloat = afloat_step(setting, workspace, afloat, step, command)
        if (step + 1) % instruments.every == 0:
            heading, rate, _ = readings(instruments, (step + 1) // instruments.every, afloat.state)
    return score


@functools.cache
def _compiled() -> Callable[..., Any]:
    try:
        return compiled(run_lqg, quick=True)
    except InputError:
        return run_lqg


def sailed(linear: Linear, runs: Sequence[tuple[Setting, Workspace]], is_plain: bool = False) -> list[Point]:
    """Return heading rms and rudder travel over all runs together, a point for each weight; without numba where it is
    to be `is_plain`."""
    sail = run_lqg if is_plain else _compiled()
    setting = runs[0][0]
    gains = kalman_gains(linear, setting.steps // setting.instruments.every)
    found = []
    for weight in WEIGHTS[::EVERY_WEIGHT]:
        feedback = regulator(linear, weight)
        if feedback is None:
            continue
        helm = LqgHelm(linear.transition, linear.move[:, 0].copy(), gains, linear.shown, feedback[0], linear.steady)
        scores = [figures(sail(one, workspace, helm), one.instruments.every * one.dt, 1.0) for one, workspace in runs]
        rms = math.sqrt(sum(score.heading_rms_deg**2 for score in scores) / len(scores))
        found.append(Point(rms, sum(score.travel_deg_s for score in scores) / len(scores)))
    return found
