"""The feedback particle filter with constant gain, compiled by numba (extra `fast`): the same particles, far sooner.

The model's own functions are compiled as they are, so that there is no second copy of any equation. Random numbers are
drawn from the same generator in the same order, so the particles are those of `feedback_particle` to rounding.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from types import FunctionType
from typing import Any

import numpy as np

from autopilot.errors import InputError
from autopilot.filters.feedback_particle import LARGEST_STEP, MOST_STEPS, fpf_belief, fpf_start, fpf_update
from autopilot.filters.kalman import Drift, FloatArray, Gaussian, Observe
from autopilot.identification.augmented_state import Case, Found, Steps

REORDERED = {"reassoc", "contract", "nsz", "arcp"}
"""What the compiler may assume of arithmetic: sums in any order, but nan stays nan."""


class CompiledParticleFilter:
    """Predict and update in place. Compiling takes some seconds, once for each model in a process.

    Particles have shape (N, d) as everywhere, but in Fortran's order, each component of all of them side by side in
    memory; `start` gives such.
    """

    def __init__(
        self, drift: Drift, observe: Observe, noise: FloatArray, R: FloatArray, moving: int | None = None
    ) -> None:
        """noise, shape (d, q), and R, shape (m, m), as in `fpf_predict` and `fpf_update`. moving: how many of the
        components move; those after them are parameters, have no rate and no noise, and cost nothing to predict.

        Raises InputError where numba is not installed, ValueError where there is noise on what does not move or where
        more than two values are measured.
        """
        d, q = noise.shape
        if R.shape[0] > 2:
            raise ValueError(f"CompiledParticleFilter: at most 2 measured values, got {R.shape[0]}")
        moving = d if moving is None else moving
        if np.any(noise[moving:] != 0.0):
            raise ValueError(f"CompiledParticleFilter: noise on a component beyond the first {moving}, which move")
        self._predict = _compiled_predict(drift, d, q, moving)
        self._update = _compiled_update(observe, d, R.shape[0])
        self._noise = np.ascontiguousarray(noise, dtype=np.float64)
        self._observe, self._R = observe, R
        self._whiten = np.ascontiguousarray(np.linalg.inv(np.linalg.cholesky(R)))

    def start(self, belief: Gaussian, count: int, random: np.random.Generator) -> FloatArray:
        """Return particles as `fpf_start` draws them, shape (count, d), in the order that this filter needs."""
        return np.asfortranarray(fpf_start(belief, count, random))

    def predict(
        self, particles: FloatArray, inputs: Any, dt: float, random: np.random.Generator, substeps: int = 1
    ) -> None:
        """Move `particles`, shape (N, d), by `dt` [s] in place: `fpf_predict`."""
        drawn = random.standard_normal((particles.shape[0], self._noise.shape[1]))
        self._predict(_components(particles), inputs, self._noise, dt, substeps, drawn)

    def update(self, particles: FloatArray, measured: FloatArray) -> None:
        """Move `particles`, shape (N, d), through the measurement, shape (m,), in place: `fpf_update`.

        Where some of its values are missing, the particles move by `fpf_update` itself.
        """
        if np.isfinite(measured).all():
            self._update(_components(particles), measured, self._whiten)
        else:
            particles[:] = fpf_update(particles, self._observe, measured, self._R)


def by_compiled_particles(case: Case, steps: Steps, count: int, random: np.random.Generator) -> Found:
    """Return what `by_particle_filter` with the constant gain does. Raises InputError where numba is not installed."""
    filter_ = CompiledParticleFilter(case.drift, case.observe, case.noise, case.R, case.states)
    particles, first, means, variances = filter_.start(case.prior, count, random), case.states, [], []
    for dt, inputs, z in zip(steps.dt, steps.inputs, steps.measured, strict=True):
        filter_.predict(particles, inputs, float(dt), random, case.substeps)
        filter_.update(particles, z)
        means.append(particles.mean(axis=0)[first:])
        variances.append(particles.var(axis=0, ddof=1)[first:])
    covariance = fpf_belief(particles).covariance[first:, first:]
    return Found(case.names, np.array(means), np.sqrt(np.array(variances)), covariance)


def _components(particles: FloatArray) -> FloatArray:
    """Return the particles by component, shape (d, N), without copying. Raises ValueError where that cannot be."""
    if not particles.flags.f_contiguous:
        raise ValueError("CompiledParticleFilter: particles must be in Fortran's order; begin with start()")
    return particles.T


@lru_cache(maxsize=16)
def _compiled_predict(drift: Drift, d: int, q: int, moving: int) -> Callable[..., None]:
    compile_ = _compiler()
    rates = compile_(drift)

    @compile_
    def predict(x: Any, inputs: Any, noise: Any, dt: float, substeps: int, drawn: Any) -> None:
        h, root = dt / substeps, np.sqrt(dt) / substeps
        push, here, middle = np.empty(moving), np.empty(d), np.empty(d)
        for i in range(x.shape[1]):
            for k in range(d):
                middle[k] = here[k] = x[k, i]
            for k in range(moving):
                push[k] = 0.0
                for c in range(q):
                    push[k] += noise[k, c] * drawn[i, c] * root
            for _ in range(substeps):
                slope = rates(here, inputs)
                for k in range(moving):
                    middle[k] = here[k] + 0.5 * (h * slope[k] + push[k])
                slope = rates(middle, inputs)
                for k in range(moving):
                    here[k] += h * slope[k] + push[k]
            for k in range(moving):
                x[k, i] = here[k]

    return predict  # type: ignore[no-any-return]


@lru_cache(maxsize=16)
def _compiled_update(observe: Observe, d: int, m: int) -> Callable[..., None]:
    compile_ = _compiler()
    shown, moments, move, grow = compile_(observe), compile_(_moments), compile_(_move), compile_(_grow)
    damped = compile_(_damped_by_one if m == 1 else _damped_by_two)

    @compile_
    def observed(x: Any, whiten: Any, h: Any) -> None:
        for i in range(x.shape[1]):
            values = shown(x[:, i])
            for j in range(m):
                h[j, i] = 0.0
                for c in range(j + 1):
                    h[j, i] += whiten[j, c] * values[c]

    @compile_
    def update(x: Any, measured: Any, whiten: Any) -> None:
        h, S, gain = np.empty((m, x.shape[1])), np.empty((m, m)), np.empty((d, m))
        mean, towards, back = np.empty(m), np.empty(d), np.empty((d, m))
        done, taken, lost = 0.0, 0, 0.0
        while done < 1.0:
            observed(x, whiten, h)
            moments(x, h, mean, S, gain)
            trace = 0.0
            for j in range(m):
                trace += S[j, j]
                # from here on how far the measurement is from the mean
                mean[j] = -mean[j]
                for c in range(j + 1):
                    mean[j] += whiten[j, c] * measured[c]
            taken += 1
            step = 1.0 - done
            if taken < MOST_STEPS:
                step = min(LARGEST_STEP / max(trace, 1.0e-300), step)
            if taken == 1:
                lost = 0.5 * damped(S, 1.0, gain, mean, towards, back) / (x.shape[1] - 1)
            damped(S, step, gain, mean, towards, back)
            move(x, h, towards, back)
            done = 1.0 if step >= 1.0 - done else done + step
        grow(x, lost)

    return update  # type: ignore[no-any-return]


def _damped_by_one(S: Any, step: float, gain: Any, off: Any, towards: Any, back: Any) -> float:
    """Write step K pull off and step K shrink, with the `damping_matrices` of one measured value; return the sum of
    s/(1 + s) over the eigenvalues s of step S, which is trace(I - (I + step S)^-1)."""
    a = 1.0 + step * S[0, 0]
    for k in range(gain.shape[0]):
        towards[k] = step * gain[k, 0] * off[0] / a
        back[k, 0] = step * gain[k, 0] / (a + np.sqrt(a))
    return float(1.0 - 1.0 / a)


def _damped_by_two(S: Any, step: float, gain: Any, off: Any, towards: Any, back: Any) -> float:
    """The same of two: the root of a 2 x 2 matrix A is (A + s I)/sqrt(trace A + 2 s), s the root of det A."""
    a, b, c = 1.0 + step * S[0, 0], step * S[0, 1], 1.0 + step * S[1, 1]
    det = a * c - b * b
    s = np.sqrt(det)
    t = np.sqrt(a + c + 2.0 * s)
    p, q, r = a + (a + s) / t, b + b / t, c + (c + s) / t
    size = p * r - q * q
    first, second = (c * off[0] - b * off[1]) / det, (a * off[1] - b * off[0]) / det
    for k in range(gain.shape[0]):
        towards[k] = step * (gain[k, 0] * first + gain[k, 1] * second)
        back[k, 0] = step * (gain[k, 0] * r - gain[k, 1] * q) / size
        back[k, 1] = step * (gain[k, 1] * p - gain[k, 0] * q) / size
    return float(2.0 - (a + c) / det)


def _moments(x: Any, h: Any, mean: Any, S: Any, gain: Any) -> None:
    """Write the mean of h, shape (m, N), take it from h, and write the covariances of h and of x with h."""
    m, N = h.shape
    for j in range(m):
        total = 0.0
        for i in range(N):
            total += h[j, i]
        mean[j] = total / N
        for i in range(N):
            h[j, i] -= mean[j]
    for j in range(m):
        for c in range(m):
            total = 0.0
            for i in range(N):
                total += h[j, i] * h[c, i]
            S[j, c] = total / (N - 1)
        for k in range(x.shape[0]):
            # about its first particle: h has no mean, so any origin near the particles will do
            total, origin = 0.0, x[k, 0]
            for i in range(N):
                total += h[j, i] * (x[k, i] - origin)
            gain[k, j] = total / (N - 1)


def _move(x: Any, h: Any, towards: Any, back: Any) -> None:
    """Move every particle by `towards`, shape (d,), and back towards the others, `back` of shape (d, m)."""
    for k in range(x.shape[0]):
        for i in range(x.shape[1]):
            x[k, i] += towards[k]
        for j in range(h.shape[0]):
            share = back[k, j]
            for i in range(x.shape[1]):
                x[k, i] -= share * h[j, i]


def _grow(x: Any, share: float) -> None:
    """Let the particles' spread grow by a share: what chance took off it, as in `fpf_update`."""
    N = x.shape[1]
    for k in range(x.shape[0]):
        total, origin = 0.0, x[k, 0]
        for i in range(N):
            total += x[k, i] - origin
        middle = origin + total / N
        for i in range(N):
            x[k, i] += share * (x[k, i] - middle)


def _compiler() -> Callable[[Callable[..., Any]], Any]:
    """Return what compiles a function, and with it the functions that it calls, just as they are."""
    try:
        from numba import njit
    except ImportError as error:
        raise InputError("The compiled particle filter needs numba: pip install '.[fast]'.") from error

    def compiled(function: Any) -> Any:
        """Numba calls only what it has compiled, so the models' functions that this one calls come first."""
        known = dict(function.__globals__)
        for name in function.__code__.co_names:
            if isinstance(known.get(name), FunctionType):
                known[name] = compiled(known[name])
        copy = FunctionType(function.__code__, known, function.__name__, function.__defaults__, function.__closure__)
        return njit(error_model="numpy", fastmath=REORDERED)(copy)

    return compiled
