"""What the residuals of a fit still say: whether they are white, and whether the rudder is still in them.

White residuals are the instruments' noise, and the model explains all the rest. Residuals that remember come from
gusts or from what the model leaves out; residuals that follow the rudder come from the model. Source: Ljung and Box
1978 for whiteness; Ljung 1999, section 16.6, for the correlation with the input.

How well a model predicts a run: open loop over its whole length, from rudder and speed alone.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from scipy.fft import irfft, next_fast_len, rfft
from scipy.special import chdtrc, ndtri

from autopilot.identification.residuals import initial_state
from autopilot.identification.rudder_path import DIRECT, RudderTrain
from autopilot.identification.runs import FloatArray, Run, Segment, seconds
from autopilot.identification.simulation import motions_at_samples
from autopilot.models.norrbin import Norrbin
from autopilot.models.weather import RaceAndWind

STEPS_PER_TIME_CONSTANT = 20.0
LONGEST_STEP_S = 0.5


class Prediction(NamedTuple):
    """seconds: length of the run. yaw_rate_r2: share of the measured yaw rate's variance that was predicted, None
    where none was measured. heading_rms: root mean square heading error [rad], None likewise."""

    seconds: float
    yaw_rate_r2: float | None
    heading_rms: float | None


class Simulation(NamedTuple):
    """What `simulate_run` returned for a model, run, surroundings and train."""

    model: Norrbin
    run: Run
    around: RaceAndWind | None
    train: RudderTrain
    motion: list[FloatArray]


def predict(
    model: Norrbin,
    run: Run,
    around: RaceAndWind | None = None,
    train: RudderTrain = DIRECT,
    made: Sequence[Simulation] = (),
) -> Prediction:
    """Return how well `model`, with what propeller and wind add where given and behind `train`, predicts the run.

    It starts each segment from the first measured heading and rate and sees nothing but rudder and speed, propeller
    and wind afterwards; only a gap in the recording starts it anew. made: simulations that need not be made again.
    """
    simulated = one_of(made, model, run, around, train)
    rate = np.concatenate([segment.rate for segment in run.segments])
    heading = np.concatenate([segment.heading for segment in run.segments])
    rate_error = np.concatenate([values[:, 0] for values in simulated]) - rate
    heading_error = np.concatenate([values[:, 1] for values in simulated]) - heading
    return Prediction(seconds(run), _r2(rate, rate_error), _rms(heading_error))


def one_of(
    made: Sequence[Simulation], model: Norrbin, run: Run, around: RaceAndWind | None, train: RudderTrain
) -> list[FloatArray]:
    """Return what `simulate_run` does, from those `made` where it is among them."""
    for each in made:
        if each.run is run and (each.model, each.around, each.train) == (model, around, train):
            return each.motion
    return simulate_run(model, run, around, train)


def simulate_run(
    model: Norrbin, run: Run, around: RaceAndWind | None = None, train: RudderTrain = DIRECT
) -> list[FloatArray]:
    """Return per segment the simulated rate [rad/s] and heading [rad, unwrapped] at its samples: shape (N, 2)."""
    longest = min(model.time_constant / STEPS_PER_TIME_CONSTANT, LONGEST_STEP_S)
    states = [initial_state(segment) for segment in run.segments]
    found = motions_at_samples(model, run.segments, longest, [rate for rate, _ in states], around, train)
    for motion, (_, heading) in zip(found, states, strict=True):
        motion[:, 1] += heading
    return found


def _r2(measured: FloatArray, error: FloatArray) -> float | None:
    known = np.isfinite(measured)
    if np.count_nonzero(known) < 2:
        return None
    spread = float(np.sum((measured[known] - np.mean(measured[known])) ** 2))
    return 1.0 - float(np.sum(error[known] ** 2)) / spread if spread > 0.0 else None


def _rms(error: FloatArray) -> float | None:
    known = error[np.isfinite(error)]
    return float(np.sqrt(np.mean(known**2))) if known.size else None


ANSWERS_WITHIN = (0.0, 0.1, 0.2, 0.4, 0.8, 1.6)
"""So many time constants later, at most, a pilot or a hand answers ..."""
LARGEST_GAIN = 5.0
"""... with so much rudder for each angle off, at most."""


def answered_share(model: Norrbin, runs: Sequence[Run], simulated: Sequence[list[FloatArray]]) -> float:
    """Return the share of the rudder's motion that is an answer to what pushed the boat; simulated: per run and segment
    rate [rad/s] and heading [rad] from rudder and speed alone, shape (N, 2).

    Least squares of the rudder on what the simulation leaves of heading and rate, then and before. In a loop that
    nothing but pushes moves, the rudder is wholly explained by them, whatever the model; a zigzag's is not, nor that of
    course changes (Ljung 1999, section 13.4: such a loop tells of the boat only what is known of the pushes). What a
    model misses of a large manoeuvre goes with the rudder too, but is too small to have been answered by so much.
    """
    left = whole = pushes = 0.0
    for run, of_segments in zip(runs, simulated, strict=True):
        for segment, values in zip(run.segments, of_segments, strict=True):
            off = np.stack([segment.heading, segment.rate], axis=1) - values[:, ::-1]
            known = np.isfinite(off[:, 0])
            if np.count_nonzero(known) < LEAST_SAMPLES:
                continue
            spacing = float(np.median(np.diff(segment.time)))
            heading = np.interp(segment.time, segment.time[known], off[known, 0])
            rated = np.isfinite(off[:, 1])
            if rated.any():
                rate = np.interp(segment.time, segment.time[rated], off[rated, 1])
            else:
                within = max(round(ANSWERS_WITHIN[2] * model.time_constant / spacing), 1)
                rate = np.convolve(np.gradient(heading, segment.time), np.full(within, 1.0 / within), mode="same")
            lags = [round(share * model.time_constant / spacing) for share in ANSWERS_WITHIN]
            before = [np.maximum(np.arange(heading.size) - lag, 0) for lag in lags]
            terms = np.array([pushed[rows] for rows in before for pushed in (heading, rate)])
            terms = (terms - terms.mean(axis=1, keepdims=True)).T
            rudder = segment.rudder - np.mean(segment.rudder)
            rest = rudder - terms @ np.linalg.lstsq(terms, rudder, rcond=None)[0]
            left, whole = left + float(rest @ rest), whole + float(rudder @ rudder)
            pushes += float(np.sum((heading - np.mean(heading)) ** 2))
    return min(1.0 - left / whole, LARGEST_GAIN**2 * pushes / whole) if whole > 0.0 else 0.0


LEAST_SAMPLES = 100
"""A segment of fewer samples tells nothing of who answers whom."""
WHITENESS_LAGS = 20
RUDDER_LAGS = 40
REACH_TIME_CONSTANTS = 5.0
"""The rudder is looked for in the residuals this many time constants later."""
SURE = 0.01
"""Probability below which chance is not believed."""
QUANTILE = 2.58
"""Normal deviate that chance exceeds in `SURE` of all cases."""
NOTEWORTHY, MATTERS = 0.1, 0.06
"""A correlation with the rudder smaller than the one, or what goes with it of the motion smaller than the other, root
mean squares, changes no prediction that matters, however sure it is."""


class ResidualTest(NamedTuple):
    """Of yaw rate or heading (`signal`): Ljung and Box's probability of residuals as correlated as these if they were
    white; `memory` [s] after which their correlation is below chance; and their largest correlation with the rudder,
    `rudder_lag` [s] before, beside what chance would give at most; size: of the residuals, as a share of the signal."""

    signal: str
    whiteness: float
    lag_one: float
    memory: float
    rudder: float
    rudder_lag: float
    by_chance: float
    size: float = 1.0

    @property
    def is_white(self) -> bool:
        """Return whether chance explains the residuals' correlation."""
        return self.whiteness > SURE

    @property
    def follows_rudder(self) -> bool:
        """Return whether the rudder is in the residuals, more than chance would and enough to matter."""
        return abs(self.rudder) > max(self.by_chance, NOTEWORTHY, MATTERS / max(self.size, MATTERS))

    def sentences(self) -> list[str]:
        """Return what this means for whoever uses the model."""
        if self.is_white:
            said = [f"The residuals of the {self.signal} are white: noise of the instruments explains them."]
        else:
            said = [
                f"The residuals of the {self.signal} remember {self.memory:.3g} s: gusts, or what the model leaves "
                "out; the standard errors allow for it."
            ]
        if self.follows_rudder:
            said.append(
                f"They follow the rudder of {self.rudder_lag:.3g} s before (correlation {self.rudder:+.2f}, chance "
                f"gives {self.by_chance:.2f}): the model misses part of what the rudder does; look at the rudder's "
                "calibration and the speed column, fit its lag (--fit-rudder lag,delay), and add propeller and wind "
                "where they are recorded."
            )
        return said


def residual_tests(
    runs: Sequence[Run],
    model: Norrbin,
    around: RaceAndWind | None = None,
    train: RudderTrain = DIRECT,
    trims: Mapping[str, float] = MappingProxyType({}),
    made: Sequence[Simulation] = (),
) -> list[ResidualTest]:
    """Return the tests of yaw rate and heading, of those that were measured, over all runs together. trims: n0 [rad/s]
    of the runs that have their own, by source. made: simulations that need not be made again."""
    segments = [segment for run in runs for segment in run.segments]
    own = [model._replace(n0=trims.get(run.source, model.n0)) for run in runs]
    simulated = [
        values for of_run, run in zip(own, runs, strict=True) for values in one_of(made, of_run, run, around, train)
    ]
    spacing = float(np.median(np.concatenate([np.diff(segment.time) for segment in segments])))
    result = []
    for column, signal in enumerate(("yaw rate", "heading")):
        measured = [segment.rate if column == 0 else segment.heading for segment in segments]
        residuals = [_centred(m - s[:, column]) for m, s in zip(measured, simulated, strict=True)]
        if sum(int(np.count_nonzero(np.isfinite(e))) for e in residuals) > 2 * WHITENESS_LAGS:
            size = math.sqrt(_power(residuals) / max(_power([_centred(values) for values in measured]), 1.0e-300))
            result.append(_test(signal, residuals, segments, spacing, model.time_constant)._replace(size=size))
    return result


def _test(
    signal: str, residuals: list[FloatArray], segments: list[Segment], spacing: float, time_constant: float
) -> ResidualTest:
    longest = min(max(segment.time.size for segment in segments) - 1, 2000)
    N = sum(int(np.count_nonzero(np.isfinite(e))) for e in residuals)
    chance = QUANTILE / np.sqrt(N)
    own = correlations(residuals, residuals, longest)[1:]
    within = np.flatnonzero(np.abs(own) < chance)
    remembered = int(within[0]) if within.size else longest
    first = own[:WHITENESS_LAGS]
    box = N * (N + 2.0) * float(np.sum(first**2 / (N - np.arange(1, first.size + 1))))
    memory = float(remembered) * spacing
    rudders = [_centred(segment.rudder) for segment in segments]
    step = max(1, round(REACH_TIME_CONSTANTS * time_constant / RUDDER_LAGS / spacing))
    lags = [lag for lag in range(0, step * RUDDER_LAGS, step) if lag < longest] or [0]
    crossed = correlations(rudders, residuals, longest)[lags]
    rudder_own = correlations(rudders, rudders, remembered)[1:]
    # two signals that both remember are alike by chance more often than white ones
    spread = np.sqrt(max(1.0 + 2.0 * float(np.sum(own[:remembered] * rudder_own)), 1.0) / N)
    # the largest of many is larger by chance than one of them
    quantile = -float(ndtri(SURE / 2.0 / len(lags)))
    at = int(np.argmax(np.abs(crossed)))
    return ResidualTest(
        signal,
        float(chdtrc(first.size, box)),
        float(own[0]),
        memory,
        float(crossed[at]),
        lags[at] * spacing,
        float(quantile * spread),
    )


def _centred(values: FloatArray) -> FloatArray:
    """Return the values less their mean, exact zeros where they are constant: rounding errors go with all else."""
    known = values[np.isfinite(values)]
    if not known.size:
        return values
    off = values - known[0]
    return np.asarray(off - np.nanmean(off))


def correlations(earlier: Sequence[FloatArray], later: Sequence[FloatArray], longest: int) -> FloatArray:
    """Return the correlations of `later` with `earlier` a number of samples before, from 0 to `longest`, over all
    segments: by their spectra, for thousands of lags of a long log would take minutes one by one."""
    together, count = np.zeros(longest + 1), np.zeros(longest + 1)
    for before, after in zip(earlier, later, strict=True):
        lags = slice(0, min(longest + 1, after.size))
        known = np.isfinite(before), np.isfinite(after)
        together[lags] += _products(np.where(known[0], before, 0.0), np.where(known[1], after, 0.0), lags.stop)
        if known[0].all() and known[1].all():
            count[lags] += after.size - np.arange(lags.stop)
        else:
            count[lags] += np.rint(_products(known[0].astype(float), known[1].astype(float), lags.stop))
    power = math.sqrt(_power(earlier) * _power(later))
    return together / np.maximum(count, 1.0) / power if power > 0.0 else np.zeros(longest + 1)


def _products(before: FloatArray, after: FloatArray, lags: int) -> FloatArray:
    """Return the sums of `after` times `before` so many samples earlier, shape (lags,); zeros behind the end keep it
    from coming round."""
    size = next_fast_len(after.size + lags - 1, real=True)
    return np.asarray(irfft(rfft(after, size) * np.conj(rfft(before, size)), size)[:lags])


def _power(signals: Sequence[FloatArray]) -> float:
    known = np.concatenate([values[np.isfinite(values)] for values in signals])
    return float(np.mean(known**2)) if known.size else 0.0
