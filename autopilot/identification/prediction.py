"""How well a model foretells a run: open loop over its whole length, from rudder and speed alone."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from autopilot.identification.forcing import at_samples, forcing, rudder_behind
from autopilot.identification.residuals import initial_state
from autopilot.identification.rudder_path import DIRECT, RudderTrain
from autopilot.identification.runs import FloatArray, Run, seconds
from autopilot.identification.simulation import simulate
from autopilot.models.norrbin import Norrbin
from autopilot.models.race_and_wind import RaceAndWind

STEPS_PER_TIME_CONSTANT = 20.0
LONGEST_STEP_S = 0.5


class Prediction(NamedTuple):
    """seconds: length of the run. yaw_rate_r2: share of the measured yaw rate's variance that was foretold, None
    where none was measured. heading_rms: root mean square heading error [rad], None likewise."""

    seconds: float
    yaw_rate_r2: float | None
    heading_rms: float | None


def predict(model: Norrbin, run: Run, around: RaceAndWind | None = None, train: RudderTrain = DIRECT) -> Prediction:
    """Return how well `model`, with what propeller and wind add where given and behind `train`, foretells the run.

    It starts each segment from the first measured heading and rate and sees nothing but rudder and speed, propeller
    and wind afterwards; only a gap in the recording starts it anew.
    """
    simulated = simulate_run(model, run, around, train)
    rate = np.concatenate([segment.rate for segment in run.segments])
    heading = np.concatenate([segment.heading for segment in run.segments])
    rate_error = np.concatenate([values[:, 0] for values in simulated]) - rate
    heading_error = np.concatenate([values[:, 1] for values in simulated]) - heading
    return Prediction(seconds(run), _r2(rate, rate_error), _rms(heading_error))


def simulate_run(
    model: Norrbin, run: Run, around: RaceAndWind | None = None, train: RudderTrain = DIRECT
) -> list[FloatArray]:
    """Return per segment the simulated rate [rad/s] and heading [rad, unwrapped] at its samples: shape (N, 2)."""
    longest = min(model.time_constant / STEPS_PER_TIME_CONSTANT, LONGEST_STEP_S)
    steps = forcing(run.segments, longest)
    steps = steps._replace(rudder=rudder_behind(train, steps))
    states = [initial_state(segment) for segment in run.segments]
    motion = simulate(model, steps, np.array([rate for rate, _ in states]), around)
    return [
        np.stack([at_samples(motion.rate, steps, s), at_samples(motion.turned, steps, s) + heading], axis=1)
        for s, (_, heading) in enumerate(states)
    ]


def _r2(measured: FloatArray, error: FloatArray) -> float | None:
    known = np.isfinite(measured)
    if np.count_nonzero(known) < 2:
        return None
    spread = float(np.sum((measured[known] - np.mean(measured[known])) ** 2))
    return 1.0 - float(np.sum(error[known] ** 2)) / spread if spread > 0.0 else None


def _rms(error: FloatArray) -> float | None:
    known = error[np.isfinite(error)]
    return float(np.sqrt(np.mean(known**2))) if known.size else None
