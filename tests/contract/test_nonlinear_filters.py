"""What every filter for continuous motion and sampled measurements must do, whichever it is."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import pytest
from extended_kalman import ekf_predict, ekf_update
from particle_gains import GalerkinGain, KernelGain, moved_by

from autopilot.identification.feedback_particle import (
    Drift,
    FloatArray,
    Gaussian,
    Motion,
    Moved,
    Observe,
    by_constant_gain,
    fpf_belief,
    fpf_predict,
    fpf_start,
    fpf_update,
)

PARTICLES = 400


class Problem(NamedTuple):
    """A system with its records: one belief to start with, inputs and measurements a step each."""

    drift: Drift
    observe: Observe
    noise: FloatArray
    R: FloatArray
    dt: float
    start: Gaussian
    inputs: list[Any]
    measured: list[FloatArray]


Filter = Callable[[Problem], list[Gaussian]]


def extended_kalman(problem: Problem) -> list[Gaussian]:
    belief, found = problem.start, []
    for inputs, z in zip(problem.inputs, problem.measured, strict=True):
        belief = ekf_predict(belief, Motion(problem.drift, problem.noise), inputs, problem.dt)
        belief = ekf_update(belief, problem.observe, z, problem.R).belief
        found.append(belief)
    return found


def feedback_particles(moved: Moved, count: int = PARTICLES, seed: int = 5) -> Filter:
    def filtered(problem: Problem) -> list[Gaussian]:
        random = np.random.default_rng(seed)
        particles, found = fpf_start(problem.start, count, random), []
        for inputs, z in zip(problem.inputs, problem.measured, strict=True):
            particles = fpf_predict(particles, Motion(problem.drift, problem.noise), inputs, problem.dt, random)
            particles = fpf_update(particles, problem.observe, z, problem.R, moved)
            found.append(fpf_belief(particles))
        return found

    return filtered


FILTERS: dict[str, tuple[Filter, float]] = {
    # the filter, and how far from the Kalman filter chance may carry it, in standard deviations
    "extended Kalman": (extended_kalman, 1.0e-6),
    "constant gain": (feedback_particles(by_constant_gain), 0.25),
    "Galerkin, linear": (feedback_particles(moved_by(GalerkinGain(1))), 0.25),
    "Galerkin, quadratic": (feedback_particles(moved_by(GalerkinGain(2))), 0.35),
    "kernel": (feedback_particles(moved_by(KernelGain(4.0)), count=120), 0.55),
}


@pytest.fixture(params=list(FILTERS))
def contender(request: pytest.FixtureRequest) -> tuple[Filter, float]:
    return FILTERS[request.param]


A = np.array([[0.0, 1.0], [-0.8, -0.3]])
B = np.array([0.0, 0.7])
H = np.array([[1.0, 0.0], [0.5, 1.0]])
DT = 0.2
NOISE = np.array([[0.0], [0.25]])
R = np.array([[0.05, 0.02], [0.02, 0.2]])


def oscillator(state: Any, force: float) -> tuple[Any, Any]:
    return A[0, 0] * state[0] + A[0, 1] * state[1], A[1, 0] * state[0] + A[1, 1] * state[1] + B[1] * force


def both(state: Any) -> tuple[Any, Any]:
    return H[0, 0] * state[0], H[1, 0] * state[0] + H[1, 1] * state[1]


def linear_problem(steps: int = 40, seed: int = 1) -> Problem:
    random = np.random.default_rng(seed)
    start = Gaussian(np.array([0.5, -0.5]), np.array([[1.0, 0.3], [0.3, 0.6]]))
    x = random.multivariate_normal(start.mean, start.covariance)
    Phi, Gamma = np.eye(2) + DT * A + 0.5 * (DT * A) @ (DT * A), np.eye(2) + 0.5 * DT * A
    inputs, measured = [], []
    for k in range(steps):
        force = float(np.sin(0.3 * k))
        x = Phi @ x + Gamma @ (DT * B * force + NOISE[:, 0] * np.sqrt(DT) * random.standard_normal())
        inputs.append(force)
        measured.append(H @ x + random.multivariate_normal([0.0, 0.0], R))
    return Problem(oscillator, both, NOISE, R, DT, start, inputs, measured)


def kalman(problem: Problem) -> list[Gaussian]:
    """The textbook filter of the same discrete system, in matrices of its own."""
    Phi, Gamma = np.eye(2) + DT * A + 0.5 * (DT * A) @ (DT * A), np.eye(2) + 0.5 * DT * A
    Q = Gamma @ NOISE @ NOISE.T @ Gamma.T * DT
    x, P = problem.start
    found = []
    for force, z in zip(problem.inputs, problem.measured, strict=True):
        x, P = Phi @ x + Gamma @ (DT * B * force), Phi @ P @ Phi.T + Q
        there = np.isfinite(z)
        h = H[there]
        K = P @ h.T @ np.linalg.inv(h @ P @ h.T + R[np.ix_(there, there)])
        x, P = x + K @ (z[there] - h @ x), P - K @ h @ P
        found.append(Gaussian(x, P))
    return found


def largest_distance(found: list[Gaussian], reference: list[Gaussian]) -> tuple[float, float]:
    """How far means (in the reference's standard deviations) and covariances (relative) ever are apart."""
    means = max(
        float(np.max(np.abs(a.mean - b.mean) / np.sqrt(np.diag(b.covariance))))
        for a, b in zip(found, reference, strict=True)
    )
    covariances = max(
        float(np.linalg.norm(a.covariance - b.covariance) / np.linalg.norm(b.covariance))
        for a, b in zip(found, reference, strict=True)
    )
    return means, covariances


def test_on_a_linear_gaussian_system_it_is_the_kalman_filter(contender: tuple[Filter, float]) -> None:
    filtered, chance = contender
    problem = linear_problem()
    means, covariances = largest_distance(filtered(problem), kalman(problem))
    assert means < chance
    assert covariances < 2.0 * chance


def test_values_that_are_missing_do_not_count(contender: tuple[Filter, float]) -> None:
    filtered, chance = contender
    problem = linear_problem()
    for k, z in enumerate(problem.measured):
        z[k % 3 :: 2] = np.nan
    assert any(not np.isfinite(z).any() for z in problem.measured) or any(np.isnan(z).any() for z in problem.measured)
    means, covariances = largest_distance(filtered(problem), kalman(problem))
    assert means < chance
    assert covariances < 2.0 * chance


def test_units_do_not_matter(contender: tuple[Filter, float]) -> None:
    """The same system with its second state in thousandths: the same beliefs."""
    filtered, _ = contender
    problem = linear_problem(steps=12)
    s = np.array([1.0, 1.0e-3])

    def drift(state: Any, force: float) -> tuple[Any, Any]:
        first, second = oscillator((state[0] / s[0], state[1] / s[1]), force)
        return first * s[0], second * s[1]

    scaled = problem._replace(
        drift=drift,
        observe=lambda state: both((state[0] / s[0], state[1] / s[1])),
        noise=problem.noise * s[:, None],
        start=Gaussian(problem.start.mean * s, problem.start.covariance * np.outer(s, s)),
    )
    # the particles are drawn along other axes, so that beliefs agree within chance only
    for a, b in zip(filtered(scaled), filtered(problem), strict=True):
        assert np.all(np.abs(a.mean / s - b.mean) < 0.6 * np.sqrt(np.diag(b.covariance)))


def test_one_certain_measurement_of_a_vague_state_is_believed(contender: tuple[Filter, float]) -> None:
    """Prior variance over measurement variance 10^6: a single explicit step of the flow would diverge."""
    filtered, _ = contender
    start = Gaussian(np.zeros(2), np.eye(2))
    exact = np.diag([1.0e-6, 1.0e-6])
    problem = Problem(
        oscillator, lambda x: (x[0], x[1]), 0.0 * NOISE, exact, 1e-9, start, [0.0], [np.array([0.7, -0.4])]
    )
    (belief,) = filtered(problem)
    np.testing.assert_allclose(belief.mean, [0.7, -0.4], atol=0.02)
    assert np.all(np.diag(belief.covariance) < 1.0e-3)


# a particle in two wells: x' = 4 x (1 - x^2) + w, seen through strong noise


def two_wells(state: Any, _: Any) -> tuple[Any]:
    return (4.0 * state[0] * (1.0 - state[0] ** 2),)


WELLS_DT, WELLS_NOISE = 0.05, 0.8


def wells_problem(seed: int, steps: int = 120) -> Problem:
    random = np.random.default_rng(seed)
    x, measured = 1.0, []
    for _ in range(steps):
        for _ in range(10):
            kick = WELLS_NOISE * np.sqrt(WELLS_DT / 10.0) * random.standard_normal()
            x += WELLS_DT / 10.0 * 4.0 * x * (1.0 - x * x) + kick
        measured.append(np.array([x + 2.0 * random.standard_normal()]))
    start = Gaussian(np.zeros(1), np.eye(1))
    noise = np.array([[WELLS_NOISE]])
    return Problem(two_wells, lambda s: (s[0],), noise, np.array([[4.0]]), WELLS_DT, start, [None] * steps, measured)


def bayes_on_a_grid(problem: Problem) -> FloatArray:
    """Mean of the exact posterior at every step: the density itself on a grid, Euler steps a tenth as long."""
    grid = np.linspace(-2.5, 2.5, 401)
    step = WELLS_DT / 10.0
    moved = grid + step * 4.0 * grid * (1.0 - grid**2)
    spread = WELLS_NOISE * np.sqrt(step)
    once = np.exp(-0.5 * ((grid[:, None] - moved[None, :]) / spread) ** 2)
    transition = np.linalg.matrix_power(once / once.sum(axis=0), 10)
    p = np.exp(-0.5 * grid**2)
    means = []
    for z in problem.measured:
        p = transition @ p
        p *= np.exp(-0.5 * (z[0] - grid) ** 2 / problem.R[0, 0])
        p /= p.sum()
        means.append(float(grid @ p))
    return np.array(means)


def distance_from_bayes(filtered: Filter, problems: list[Problem]) -> float:
    distances = [np.array([b.mean[0] for b in filtered(p)]) - bayes_on_a_grid(p) for p in problems]
    return float(np.sqrt(np.mean(np.concatenate(distances) ** 2)))


def test_only_adaptive_gains_follow_bayes_between_two_wells() -> None:
    problems = [wells_problem(seed) for seed in range(4)]
    kalman_distance = distance_from_bayes(extended_kalman, problems)
    constant = distance_from_bayes(feedback_particles(by_constant_gain, 150), problems)
    galerkin = distance_from_bayes(feedback_particles(moved_by(GalerkinGain(5)), 150), problems)
    kernel = distance_from_bayes(feedback_particles(moved_by(KernelGain(0.2)), 150), problems)
    assert kalman_distance > 0.3
    assert constant < 0.2
    assert galerkin < 0.09
    assert kernel < 0.09
    assert max(galerkin, kernel) < 0.8 * constant


def test_the_same_generator_gives_the_same_particles() -> None:
    problem = linear_problem(steps=5)
    once, again = feedback_particles(by_constant_gain)(problem), feedback_particles(by_constant_gain)(problem)
    assert all(np.array_equal(a.mean, b.mean) for a, b in zip(once, again, strict=True))
    other = feedback_particles(by_constant_gain, seed=6)(problem)
    assert not np.array_equal(once[-1].mean, other[-1].mean)


def test_fewer_than_two_particles_are_refused() -> None:
    with pytest.raises(ValueError, match="at least 2 particles"):
        fpf_start(Gaussian(np.zeros(2), np.eye(2)), 1, np.random.default_rng(0))


def steered_by_the_constant_gain(particles: FloatArray, g: FloatArray, innovation: FloatArray) -> FloatArray:
    return by_constant_gain(particles, g, innovation[0], 1.0e-12)[1]


STEERED = (steered_by_the_constant_gain, GalerkinGain(1).steer, GalerkinGain(3).steer, KernelGain(50.0).steer)


@pytest.mark.parametrize("steered", STEERED, ids=("constant", "linear", "cubic", "kernel"))
def test_a_gain_of_a_gaussian_is_its_covariance(steered: Callable[..., FloatArray]) -> None:
    """For g linear in x the equation's solution is cov(x, g), whatever the basis; particles are symmetric pairs."""
    random = np.random.default_rng(3)
    half = random.standard_normal((400, 2)) @ np.array([[1.0, 0.0], [0.6, 0.2]])
    particles = np.vstack([half, -half])
    g = (particles @ np.array([[1.0], [-2.0]])) - (particles @ np.array([[1.0], [-2.0]])).mean(axis=0)
    velocity = steered(particles, g, np.ones((800, 1)))
    expected = np.cov(particles.T) @ np.array([1.0, -2.0])
    np.testing.assert_allclose(velocity.mean(axis=0), expected, rtol=0.06, atol=0.02)


def test_the_kalman_update_keeps_a_covariance_symmetric_and_positive() -> None:
    belief = Gaussian(np.zeros(2), np.diag([1.0e6, 1.0e4]))
    for k in range(30):
        h = np.array([1.0, 1.0 + 0.1 * (k % 3)])
        belief = ekf_update(belief, lambda x, h=h: (h @ x,), np.array([0.0]), np.array([[1.0e-4]])).belief
        assert np.all(np.linalg.eigvalsh(belief.covariance) > 0.0)
        assert np.array_equal(belief.covariance, belief.covariance.T)


def test_thousands_of_updates_leave_what_was_never_measured_as_uncertain_as_it_was() -> None:
    """A parameter that moves nothing: by correlations of chance alone 60 particles would be sure of it."""
    random = np.random.default_rng(8)
    start = Gaussian(np.zeros(2), np.eye(2))
    particles = fpf_start(start, 60, random)
    noise = np.array([[1.0], [0.0]])
    for _ in range(400):
        particles = fpf_predict(particles, Motion(lambda x, _: (-x[0], 0.0 * x[1]), noise), None, 0.5, random)
        particles = fpf_update(particles, lambda x: (x[0],), np.array([0.0]), np.array([[0.1]]))
    assert 0.25 < float(particles[:, 1].std()) < 4.0
