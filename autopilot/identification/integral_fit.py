"""K, T, n3 and n0 from the integrated equation of all windows together, recursively and in constant memory.

Least squares over the windows (zeta = phi, the terms themselves) is biased: the yaw rate on the equation's right side
is measured too, and its noise lowers every estimate, the more so the less n3 can be distinguished from K. So as soon as
K and T are known well enough to simulate a boat with, each equation is multiplied by instruments in place of its own
terms: the same integrals of a boat that is simulated beside, under the recorded rudder and with the present estimate,
whose motion knows nothing of the noise (the refined instrumental variable of Young, 1976). Sums with instruments from
the beginning are kept beside, and are taken once they are about as sure: in wind least squares may never be sure of
anything.

Where a law holds the course, the rudder answers to wind and waves, and whoever takes its movements for causes finds a
boat that hardly turns. There the boat beside follows the law's reference, whose turns nobody but the skipper caused,
with the rudder that they take in calm water: running straight tells nothing then, turning does. The sums

    R = sum zeta phi'/s^2,   f = sum zeta (y - phi' theta_0)/s^2,   theta = theta_0 + (R + Lambda)^-1 f

fade with what is excited only, so that straight running forgets nothing. Lambda holds theta near the model it began
with as far as the windows say nothing; s is the error that an equation is expected to have.

The sums over windows from which the integral method takes its estimate: three small matrices, whatever the time.

The boat that is simulated beside the real one: its motion is what the integral method takes for instruments.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from autopilot.identification.integral_window import BLOCKS, Integrals, IntegralWindow
from autopilot.models.norrbin import SPEED_FLOOR_RATIO, Norrbin, at_speed_ratio, rate_step, rudder_for
from autopilot.signals import Reference

Array = NDArray[np.float64]


class WindowSums:
    """R = sum zeta phi'/s^2, S = sum zeta zeta'/s^2 and f = sum zeta missing/s^2 over the windows, fading.

    size: number of parameters.  expected_error: s [rad], what an equation's error is expected to be.
    """

    def __init__(self, size: int, expected_error: float) -> None:
        self._weight = expected_error**-2
        self._one = np.eye(size)
        self.R: Array = np.zeros((size, size))
        self.S: Array = np.zeros((size, size))
        self.f: Array = np.zeros(size)

    def add(self, fading: float, instruments: Array, terms: Array, missing: float) -> None:
        """Fade what is there by the factor `fading` and add a window: its instruments zeta, its terms phi, and what
        the terms times the first parameters lack of its left side."""
        weighted = self._weight * instruments
        self.R = fading * self.R + np.outer(weighted, terms)
        self.S = fading * self.S + np.outer(weighted, instruments)
        self.f = fading * self.f + weighted * missing

    def step(self, spread: Array, square: float) -> Array:
        """Return theta - theta_0, held by `spread`, its expected size; `square` is the equations' mean square error in
        units of s^2. nan where the sums do not determine it."""
        whole = spread[:, None] * self.R * spread / square + self._one
        try:
            return np.asarray(spread * np.linalg.solve(whole, spread * self.f / square))
        except np.linalg.LinAlgError:
            return np.full(spread.size, np.nan)

    def errors(self, spread: Array, square: float) -> Array:
        """Return the standard errors of `step`; infinite where the sums do not determine it."""
        try:
            inverse = np.linalg.inv(spread[:, None] * self.R * spread / square + self._one)
        except np.linalg.LinAlgError:
            return np.full(spread.size, np.inf)
        scores = spread[:, None] * self.S * spread / square + self._one
        return np.asarray(spread * np.sqrt(np.maximum(np.diag(inverse @ scores @ inverse.T), 0.0)))


RATE_BOUND_RAD_S = 3.0


def moved_on(
    model: Norrbin, ratio: float, motion: tuple[float, float], dt: float, rudder: tuple[float, float]
) -> tuple[float, float]:
    """Return rate [rad/s] and heading [rad] of a boat `dt` [s] later, at `ratio` times the reference speed, while the
    rudder goes from one angle [rad] to the other; a rate that runs away is bounded."""
    (rate, heading), (before, after) = motion, rudder
    scaled = at_speed_ratio(model, max(ratio, SPEED_FLOOR_RATIO))
    steps = math.ceil(2.0 * dt / scaled.time_constant)
    for step in range(steps):
        was, angle = rate, before + (after - before) * (step + 0.5) / steps
        moved = rate_step(scaled, was, angle, dt / steps)
        rate = min(max(moved, -RATE_BOUND_RAD_S), RATE_BOUND_RAD_S) if moved == moved else 0.0
        heading += 0.5 * dt / steps * (was + rate)
    return rate, heading


class SimulatedBoat:
    """Heading [rad] and rate [rad/s] of a boat that knows the rudder and no noise.

    Args:
        longest_gap: after a silence longer than this [s] it begins anew.  led_back: a course-unstable boat left to
        itself would soon turn the other way than the real one, so it is led back to it.

    Attributes: moved_by, the rudder [rad] as far as nothing that disturbs the boat moves it; followed, when it followed
    a reference last [s]; lead_time, the time constant [s] of leading it back.
    """

    def __init__(self, longest_gap: float, *, drawn_back: bool) -> None:
        self._longest_gap, self._drawn_back = longest_gap, drawn_back
        self.return_time = 1.0
        self.heading = self.rate = self.moved_by = 0.0
        self.followed = self._at = -math.inf
        self._rudder, self._measured = 0.0, math.nan

    def simulate(
        self, model: Norrbin, time: float, rudder: float, ratio: float, heading: float | None, rate: float | None
    ) -> None:
        """Carry it on to `time` [s] under the rudder [rad] at `ratio` times the reference speed; heading [rad] and rate
        [rad/s] are the real boat's. Where the samples begin anew, it begins with the measured rate."""
        dt = time - self._at
        if dt > self._longest_gap:
            self.rate = 0.0 if rate is None or not math.isfinite(rate) else rate
            self._measured = math.nan
        elif dt > 0.0 and math.isfinite(rudder):
            self.rate, self.heading = moved_on(model, ratio, (self.rate, self.heading), dt, (self._rudder, rudder))
            if self._drawn_back:
                self._draw_back(dt, heading, rate)
        self._at = max(time, self._at)
        self._rudder = self.moved_by = rudder if math.isfinite(rudder) else self._rudder
        self._measured = math.nan if heading is None else heading

    def _draw_back(self, dt: float, heading: float | None, rate: float | None) -> None:
        share = min(dt / self.return_time, 1.0)
        if rate is not None and math.isfinite(rate):
            self.rate += share * (rate - self.rate)
        elif heading is not None and math.isfinite(heading - self._measured):
            turned = math.remainder(heading - self._measured, 2.0 * math.pi)
            self.rate += share * (turned / dt - self.rate)

    def follow(self, model: Norrbin, time: float, ratio: float, reference: Reference) -> None:
        """Go where a law is ordered to go; its rudder is what that takes without any waves."""
        dt = time - self._at
        if 0.0 < dt <= self._longest_gap:
            self.heading += 0.5 * dt * (self.rate + reference.rate)
        self.rate = reference.rate
        scaled = at_speed_ratio(model, max(ratio, SPEED_FLOOR_RATIO))
        self.moved_by = rudder_for(scaled, reference.rate, reference.acceleration)
        self._at = self.followed = max(time, self._at)
        self._rudder, self._measured = self.moved_by, math.nan


NAMES = ("gain", "time_constant", "n3", "n0")

WINDOW_TIME_CONSTANTS, WINDOW_SHORTEST_S, WINDOW_LONGEST_S = 4.0, 3.0, 120.0
"""A window is this many time constants long, within these limits."""

CAUTION, PATIENCE = 1.5, 0.75
"""The first windows are that much shorter: where the first T is too long, it takes no long window to find out. Without
measured rates they are longer instead, for short ones drown in the heading's noise."""

EXPECTED_ERROR_RAD = math.radians(0.1)
"""s, for weighing the windows against the first model."""

LEAST_ERROR_RAD = math.radians(0.02)
"""For the standard errors, the equations' error is taken to be at least this."""

LEAST_WEIGHT = 1.0e-3
"""What keeps plain least squares solvable where the windows say nothing of a parameter."""

TRIM_RAD = math.radians(3.0)
"""n0 is expected to be worth a rudder of this size."""

CUBIC_SHARE = 0.3
"""n3 is expected to be so large that it makes this share of the damping at the typical rate, or as large as it was."""

RATE_MEMORY = 200
ENOUGH = 2 * BLOCKS
"""Windows before which no standard error is believed."""

EXCITES_BELOW = 0.1
"""The simulated boat's motion serves from when K and T are known to this share; until then the measured one does."""

UNBIASED_WORTH, UNBIASED_WORTH_HEADINGS = 1.25, 4.0
"""Sums with the simulated boat's motion throughout are taken where their standard errors are below this many times
those of the sums that began with the measured motion; more where only headings are measured, which bias those more."""

REFIT, REFIT_FACTOR = 0.25, 1.6
"""When K and T are known to this share, the boat beside is simulated with them, and windows are fitted anew where the
length is off by this factor."""
"""Windows over which the typical rate is taken."""


class FitSettings(NamedTuple):
    """length L [s] of the window, None: fitted to T.  memory [s] of excited sailing after which the past has faded to
    a third.  rudder_range [rad]: windows in which the rudder moves less are left out.  longest_gap [s] between
    samples.  bound: K and T stay within this factor of the model it begins with.  cubic: whether n3 is estimated."""

    length: float | None = None
    memory: float = 300.0
    rudder_range: float = math.radians(4.0)
    longest_gap: float = 2.0
    bound: float = 10.0
    cubic: bool = True


def window_length(time_constant: float) -> float:
    """Return a length [s] for the windows of a boat with T = `time_constant` [s]."""
    return min(max(WINDOW_TIME_CONSTANTS * time_constant, WINDOW_SHORTEST_S), WINDOW_LONGEST_S)


class IntegralFit:
    """The recursive estimate; feed it with `update`, read `model` and `standard_errors`.

    `first` is the model it begins with and is held to where nothing is learnt; n1, n2 = 0 and the reference speed are
    its own. `simulated` is a model good enough to simulate with throughout, where there is one. Raises ValueError
    for a first model with n2.
    """

    def __init__(
        self,
        first: Norrbin,
        settings: FitSettings = FitSettings(),  # noqa: B008 - immutable
        simulated: Norrbin | None = None,
    ) -> None:
        if first.n2:
            raise ValueError("the integral method knows no n2")
        self.first, self.settings = first, settings
        self._boat = SimulatedBoat(settings.longest_gap, drawn_back=first.n1 < 0.0)
        length = settings.length or window_length(first.time_constant / CAUTION)
        self._open_windows(length)
        self.model = self._guide = simulated or first
        self._is_guided = simulated is not None
        self._excited_since = -math.inf
        self.windows = 0
        size = len(NAMES)
        self._sums = self._trusted = WindowSums(size, EXPECTED_ERROR_RAD)
        self._unbiased = WindowSums(size, EXPECTED_ERROR_RAD)
        self._moments: NDArray[np.float64] = np.zeros((2, size + 1, size + 1))
        self._last: NDArray[np.float64] = np.zeros(size + 1)
        self._counted = 0.0
        self._rate_square = 0.0
        self._excites = simulated is not None
        self._has_rates: bool | None = None

    @property
    def moved_by(self) -> float:
        """The rudder [rad] as far as nothing that disturbs the boat moves it."""
        return self._boat.moved_by

    @property
    def length(self) -> float:
        """L [s] of the window."""
        return self._window.length

    def update(
        self,
        time: float,
        rudder: float,
        ratio: float,
        heading: float | None = None,
        rate: float | None = None,
        reference: Reference | None = None,
    ) -> Integrals | None:
        """Take what is known at `time` [s], as `IntegralWindow.update` does; return the window whose equation was
        added, None where there was none or it tells nothing. `reference` is what a law steers by, where one steers."""
        if self._has_rates is None and heading is not None:
            self._begin_with(rate is not None)
        boat = self._boat
        if reference is None:
            boat.simulate(self._guide, time, rudder, ratio, heading, rate)
        else:
            boat.follow(self._guide, time, ratio, reference)
        window = self._window.update(time, rudder, ratio, heading, rate)
        if heading is None and rate is None:
            self._beside.update(time, boat.moved_by, ratio)
            return None
        beside = self._beside.update(time, boat.moved_by, ratio, boat.heading, boat.rate)
        if window is None or beside is None or beside.rudder_range < self.settings.rudder_range:
            return None
        self._add(window, beside)
        return window

    def _begin_with(self, has_rates: bool) -> None:
        self._has_rates = has_rates
        if not has_rates and self.settings.length is None:
            self._open_windows(window_length(self.first.time_constant / PATIENCE))

    def _add(self, window: Integrals, beside: Integrals) -> None:
        regressors, instruments = _terms(window), _terms(beside)
        first = _values(self.first)
        missing = self.first.n1 * window.turned - float(regressors @ first)
        is_steered = window.time - self._boat.followed <= self.length
        # a window in which the boat beside was given another model is no instrument
        is_whole = is_steered or window.time - self._excited_since > self.length
        if is_whole:
            self._unbiased.add(self._fading, instruments, regressors, missing)
        is_measured = not (self._excites or is_steered) or not is_whole
        self._sums.add(self._fading, regressors if is_measured else instruments, regressors, missing)
        self._count(np.array([self.first.n1 * window.turned, *regressors]))
        self.windows += 1
        self._rate_square += (window.rate_square - self._rate_square) / min(self.windows, RATE_MEMORY)
        self._solve(first)
        if self.windows < ENOUGH:
            return
        errors = self.standard_errors()
        self._excites = self._excites or self._is_settled(errors, EXCITES_BELOW)
        if self._is_settled(errors, REFIT):
            self._excite(window.time)
            if self.settings.length is None:
                self._refit_window()

    def _excite(self, time: float) -> None:
        """Simulate the boat beside with what was found, unless it has been given a model for good."""
        if self._is_guided:
            return
        if self._excited_since == -math.inf:
            self._excited_since = time
            self._unbiased = WindowSums(len(NAMES), EXPECTED_ERROR_RAD)
        self._guide = self.model

    def _is_settled(self, errors: dict[str, float], share: float) -> bool:
        return all(errors[name] < share * getattr(self.model, name) for name in ("gain", "time_constant"))

    def _refit_window(self) -> None:
        """Go on with windows fitted to the T that was found; what has been added stays true."""
        length = window_length(self.model.time_constant)
        if not 1.0 / REFIT_FACTOR < length / self.length < REFIT_FACTOR:
            self._open_windows(length)

    def _open_windows(self, length: float) -> None:
        gap = self.settings.longest_gap
        self._window = IntegralWindow(length, BLOCKS, gap, from_mean=True)
        self._beside = IntegralWindow(length, BLOCKS, gap, from_mean=True)
        self._fading = math.exp(-length / BLOCKS / self.settings.memory)
        self._boat.return_time = 2.0 * length

    def _solve(self, first: NDArray[np.float64]) -> None:
        spread, square = self._spread(), max(self._error_square(self._least_squares()), 1.0)
        if self.windows >= ENOUGH:
            self._trusted = self._which(spread, square)
        gain, time_constant, n3, n0 = (first + self._trusted.step(spread, square)).tolist()
        if not math.isfinite(gain + time_constant + n3 + n0):
            return
        bound = self.settings.bound
        self.model = self.first._replace(
            gain=_within(gain, self.first.gain, bound),
            time_constant=_within(time_constant, self.first.time_constant, bound),
            n3=max(n3, 0.0),
            n0=n0,
        )

    def _which(self, spread: NDArray[np.float64], square: float) -> WindowSums:
        """Return the sums with instruments throughout as soon as they are not much less sure than those without.

        A course-unstable boat simulated with a bad model turns the other way too often to serve from the beginning.
        """
        sure, unbiased = (sums.errors(spread, square)[:2] for sums in (self._sums, self._unbiased))
        worth = UNBIASED_WORTH if self._has_rates else UNBIASED_WORTH_HEADINGS
        is_worth_it = self.first.n1 > 0.0 and bool(np.all(unbiased < worth * sure))
        return self._unbiased if is_worth_it else self._sums

    def _spread(self) -> NDArray[np.float64]:
        """Return how far from the first model each parameter is expected, one standard deviation."""
        first, square = self.first, max(self._rate_square, 1.0e-12)
        n3 = max(first.n3, CUBIC_SHARE / square) if self.settings.cubic else 0.0
        return np.array([first.gain, first.time_constant, n3, first.gain * TRIM_RAD])

    def standard_errors(self) -> dict[str, float]:
        """Return the standard errors of what is estimated, by the parameters' names.

        The expectation that the parameters lie near the first model counts as knowledge, so that nothing known is one
        standard deviation of that: the parameter itself. Neighbouring equations whose errors are alike count less.
        """
        spread, square = self._spread(), self._error_square(_values(self.model))
        errors = self._trusted.errors(spread, square)
        return {name: float(error) for name, error in zip(NAMES, errors, strict=True) if error > 0.0}

    def _count(self, equation: NDArray[np.float64]) -> None:
        """Keep the second moments of the equations, and of neighbours: their errors follow from these for any theta."""
        self._moments[0] = self._fading * self._moments[0] + np.outer(equation, equation)
        self._moments[1] = self._fading * self._moments[1] + np.outer(equation, self._last)
        self._counted = self._fading * self._counted + 1.0
        self._last = equation

    def _least_squares(self) -> NDArray[np.float64]:
        """Return what plain least squares makes of the windows, held by nothing: its errors are the disturbances'."""
        spread = self._spread()
        squares = spread[:, None] * self._moments[0, 1:, 1:] * spread / EXPECTED_ERROR_RAD**2
        target = spread * self._moments[0, 1:, 0] / EXPECTED_ERROR_RAD**2
        return np.asarray(spread * np.linalg.solve(squares + LEAST_WEIGHT * np.eye(len(NAMES)), target))

    def _error_square(self, values: NDArray[np.float64]) -> float:
        """Return the equations' mean square error with these parameters, in units of the expected one; where neighbours
        are alike it is raised, for they say the same."""
        if self._counted <= len(NAMES):
            return 1.0
        contrast = np.array([1.0, *-values])
        square = float(contrast @ self._moments[0] @ contrast) / (self._counted - len(NAMES))
        square = max(square, LEAST_ERROR_RAD**2)
        alike = float(contrast @ self._moments[1] @ contrast) / (square * self._counted)
        alike = min(max(alike, 0.0), 0.95)
        return square / EXPECTED_ERROR_RAD**2 * (1.0 + alike) / (1.0 - alike)


def _terms(window: Integrals) -> NDArray[np.float64]:
    """Return what K, T, n3 and n0 are multiplied by."""
    return np.array([window.driven, -window.rate_change, -window.cubed, -window.elapsed])


def _values(model: Norrbin) -> NDArray[np.float64]:
    return np.array([model.gain, model.time_constant, model.n3, model.n0])


def _within(value: float, first: float, factor: float) -> float:
    return min(max(value, first / factor), first * factor)
