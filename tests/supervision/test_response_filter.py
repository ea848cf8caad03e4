"""The filter behind the watch over the rudder's answer, against one written with matrices."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import pytest
from scipy.linalg import expm

from autopilot.models.norrbin import Norrbin
from autopilot.supervision.response_filter import (
    NOTHING,
    PUSH_UNKNOWN,
    RATE_UNKNOWN,
    STEEPEST,
    Covariance,
    Noise,
    all_corrected,
    all_moved,
    foreseen,
    transition_of,
)
from autopilot.supervision.rudder_response import NO_SLIDE, Slide, first_response, slide_learnt, slide_share

Matrix = npt.NDArray[np.float64]
NOISE = Noise(heading=2.0e-4, acceleration=3.0e-5, push=4.0e-6, sea=5.0e-3, pace=0.7, unmet=0.0)
X = (0.1, -0.05, 0.02, 0.03)
BOATS = [
    Norrbin(0.2, 5.0),
    Norrbin(0.3, 4.0, n1=-0.5, n3=2.0),
    Norrbin(0.5, 2.0, n1=1.0, n2=0.3, n3=3.0),
]


class Step(NamedTuple):
    """A transition by the names of its entries."""

    turn: float
    drift: float
    decay: float
    gain: float
    kept: float


def step_of(model: Norrbin, rate: float, noise: Noise, dt: float) -> Step:
    return Step(*transition_of(model, rate, noise.pace, dt))


ROWS, COLUMNS = np.triu_indices(4)


def matrix_of(covariance: Covariance) -> Matrix:
    p = np.zeros((4, 4))
    p[ROWS, COLUMNS] = p[COLUMNS, ROWS] = covariance
    return p


def covariance_of(p: Matrix) -> Covariance:
    a, b, c, d, e, f, g, h, i, j = map(float, p[ROWS, COLUMNS])
    return a, b, c, d, e, f, g, h, i, j


def transition(step: Step) -> Matrix:
    """F of the module's equations: (psi, r, p, w) with p + w on the rudder."""
    return np.array(
        [
            [1.0, step.turn, step.drift, step.drift],
            [0.0, step.decay, step.gain, step.gain],
            [0.0, 0.0, 1.0, 0.0],
            [0.0, 0.0, 0.0, step.kept],
        ]
    )


def some_covariance(seed: int) -> Matrix:
    root = np.random.default_rng(seed).normal(size=(4, 4)) * np.array([[0.1], [0.2], [0.3], [0.4]])
    return np.asarray(root @ root.T)


def test_the_first_heading_tells_of_the_heading_alone() -> None:
    p = matrix_of(first_response(NOISE, 0.0, 0.1).covariance)
    assert np.array_equal(p, np.diag([NOISE.heading, RATE_UNKNOWN, PUSH_UNKNOWN, NOISE.sea]))
    assert math.sqrt(RATE_UNKNOWN) == pytest.approx(0.2)
    assert math.degrees(math.sqrt(PUSH_UNKNOWN)) == pytest.approx(20.0)
    assert NOTHING == (0.0, 0.0, 0.0, 0.0)


@pytest.mark.parametrize("model", BOATS)
@pytest.mark.parametrize("rate", [-0.3, 0.0, 0.2])
@pytest.mark.parametrize("dt", [1.0e-4, 0.05, 1.0, 6.0])
def test_a_step_is_the_boat_linearised_by_the_secant_and_solved_exactly(model: Norrbin, rate: float, dt: float) -> None:
    damping = model.n1 + model.n2 * rate + model.n3 * rate**2
    a = np.zeros((4, 4))
    a[0, 1] = 1.0
    a[1, :3] = 0.0, -damping / model.time_constant, model.gain / model.time_constant
    a[3, 3] = -NOISE.pace
    wanted = expm(a * dt)
    step = step_of(model, rate, NOISE, dt)
    assert step.turn == pytest.approx(wanted[0, 1], rel=1e-6)
    assert step.drift == pytest.approx(wanted[0, 2], rel=1e-3)
    assert step.decay == pytest.approx(wanted[1, 1], rel=1e-9)
    assert step.gain == pytest.approx(wanted[1, 2], rel=1e-6)
    assert step.kept == pytest.approx(wanted[3, 3], rel=1e-9)


@pytest.mark.parametrize("share", [-1.02e-3, -0.98e-3, -1.0e-3, 0.0, 0.98e-3, 1.0e-3, 1.02e-3])
def test_where_the_series_takes_over_nothing_jumps(share: float) -> None:
    dt = 0.5
    x = share
    model = Norrbin(1.0, 1.0, n1=x / dt)
    step = step_of(model, 0.0, NOISE, dt)
    assert step.turn == pytest.approx(dt * (1.0 - x / 2.0 + x * x / 6.0), rel=1.0e-6)
    assert step.drift == pytest.approx(dt * dt * (0.5 - x / 6.0), rel=1.0e-3)


def test_the_growth_of_an_unstable_boat_is_cut() -> None:
    step = step_of(Norrbin(1.0, 1.0, n1=-1000.0), 0.0, NOISE, 1.0)
    assert step.decay == pytest.approx(math.exp(STEEPEST))
    steep = step_of(Norrbin(1.0, 1.0, n1=-19.0), 0.0, NOISE, 1.0)
    assert steep.decay == pytest.approx(math.exp(19.0))
    assert step_of(Norrbin(1.0, 1.0, n1=1000.0), 0.0, NOISE, 1.0).decay == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("model", BOATS)
@pytest.mark.parametrize("seed", range(3))
def test_the_mean_and_the_covariance_move_by_the_same_matrix(model: Norrbin, seed: int) -> None:
    dt, rudder = 0.4, 0.15
    step, p = step_of(model, 0.1, NOISE, dt), some_covariance(seed)
    f = transition(step)
    x = np.array(X)
    driven = np.array([step.drift, step.gain, 0.0, 0.0]) * rudder
    means = all_moved(step, (X, X, NOTHING, X, NOTHING), (rudder, rudder, 0.0, -rudder))
    wanted = f @ x, f @ x + driven, driven, f @ x, -driven
    for mean, of in zip(means, wanted, strict=True):
        assert np.allclose(mean, of, rtol=1e-12)
    noise = np.zeros((4, 4))
    noise[:2, :2] = NOISE.acceleration * np.array([[dt**3 / 3.0, dt**2 / 2.0], [dt**2 / 2.0, dt]])
    noise[2, 2] = NOISE.push * dt
    noise[3, 3] = (1.0 - math.exp(-2.0 * NOISE.pace * dt)) * NOISE.sea
    before, *_, moved = foreseen(step, covariance_of(p), (X,) * 5, (rudder, 0.0, 0.0, -rudder), NOISE[:4], dt)
    assert moved == all_moved(step, (X,) * 5, (rudder, 0.0, 0.0, -rudder))
    assert np.allclose(matrix_of(before), f @ p @ f.T + noise, rtol=1e-10, atol=1e-14)


@pytest.mark.parametrize("seed", range(4))
def test_a_heading_is_taken_in_as_a_kalman_filter_takes_it(seed: int) -> None:
    p = some_covariance(seed)
    h = np.array([[1.0, 0.0, 0.0, 0.0]])
    total = float((h @ p @ h.T)[0, 0]) + NOISE.heading
    gain = p @ h.T / total
    kept = np.eye(4) - gain @ h
    before, gains, known, _ = foreseen(
        (0.0, 0.0, 1.0, 0.0, 1.0), covariance_of(p), (X,) * 5, (0.0,) * 4, NOISE[:4], 0.0
    )
    assert before == covariance_of(p)
    assert gains[0] == pytest.approx(total)
    assert np.allclose(gains[1:], gain.ravel(), rtol=1e-12)
    after = kept @ p @ kept.T + NOISE.heading * gain @ gain.T
    assert np.allclose(matrix_of(known), after, rtol=1e-9, atol=1e-14)
    means = all_corrected(gains, (X, X, NOTHING, NOTHING, X), -0.05)
    for mean, was, innovation in zip(means, (X, X, NOTHING, NOTHING, X), (-0.05, -0.1, 0.0, 0.0, -0.1), strict=True):
        assert np.allclose(mean, np.array(was) + innovation * gain.ravel(), rtol=1e-12)


def slid(share: float, seconds: float, before: Slide = NO_SLIDE, learns: bool = True) -> Slide:
    """What is known of a boat that swings in turns of 20 s and is braked by so much of its own damping."""
    random, slide = np.random.default_rng(5), before
    for tick in range(round(seconds / 0.1)):
        answer = 2.0 * math.sin(0.3 * 0.1 * tick)
        seen = share * answer + random.standard_normal(), answer, 1.0
        slide = slide_learnt(slide, BOATS[1], seen, 0.1, learns)
    return slide


@pytest.mark.parametrize("share", [0.0, 0.5, 2.0])
def test_what_a_boat_has_shown_of_its_slide_is_its_mean_square(share: float) -> None:
    *_, shown, sure = slid(share, 2000.0)
    assert shown / sure == pytest.approx(share * share, abs=0.03 + 0.05 * share)


def test_a_boat_that_has_turned_without_a_slide_explains_nothing_by_one() -> None:
    """Before that it may be any; and what may be a fault teaches nothing."""
    known, fault = slid(0.0, 60.0), (2.0, 2.0, 1.0)
    for before, learns, explains in ((NO_SLIDE, True, True), (known, False, False), (slid(1.0, 60.0), False, True)):
        slide = before
        for _ in range(20):
            slide = slide_learnt(slide, BOATS[1], fault, 0.1, learns)
        assert (slide_share(slide) > 0.7) is explains
        if not learns:
            assert slide[2:] == before[2:]
    assert slide_share(known) < 0.05


def test_a_course_in_a_slight_sea_teaches_nothing_of_turns() -> None:
    slide, random = NO_SLIDE, np.random.default_rng(8)
    for _ in range(3000):
        slide = slide_learnt(
            slide, BOATS[1], (0.1 * random.standard_normal(), 0.1 * random.standard_normal(), 1.0), 0.1, True
        )
    both, squares = 20.0, 20.0
    fresh = slide_share((both, squares, *NO_SLIDE[2:]))
    assert fresh == pytest.approx(both / (squares + 1.0 / 0.7**2))
    assert slide_share((both, squares, *slide[2:])) == pytest.approx(fresh, rel=0.05)
    assert slide_share((-1.0, 1.0, *NO_SLIDE[2:])) == 0.0
