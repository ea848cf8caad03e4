"""How strong a boat shows its rudder to be: against a boat simulated with another K, and a push that nobody knows."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from autopilot.guidance.tuning import STRONGEST, WEAKEST
from autopilot.guidance.turn import NO_EVIDENCE, Effectiveness, rudder_effectiveness, updated_effectiveness
from autopilot.models.norrbin import Norrbin, rate_step

RUDDER, DT = math.radians(20.0), 0.05
BOATS = (
    Norrbin(0.2, 5.0, 20.0, n1=-1.0),
    Norrbin(0.12, 12.0, 60.0, n1=-0.5),
    Norrbin(0.5, 2.0, 3.0, n1=-0.6, n0=0.01),
)


def after_a_turn(
    model: Norrbin, share: float, push: float = 0.0, noise: float = 0.0, side: float = 1.0, counter: bool = True
) -> Effectiveness:
    """Return what a boat shows in a turn of three time constants, half of it, where asked, with counter-rudder."""
    true, random = model._replace(gain=share * model.gain), np.random.default_rng(1)
    estimate, rate, rudder, steps = NO_EVIDENCE, 0.0, 0.0, round(3.0 * model.time_constant / DT)
    for step in range(steps):
        over = side * 0.5 * RUDDER * (1.0 if 2 * step < steps or not counter else -1.0)
        rudder += min(max(over - rudder, -0.1 * DT), 0.1 * DT)
        rate = rate_step(true, rate, rudder + push / share, DT)
        estimate = updated_effectiveness(model, estimate, rate + noise * random.standard_normal(), rudder, DT)
    return estimate


@pytest.mark.parametrize("model", BOATS)
@given(share=st.floats(WEAKEST, STRONGEST), side=st.sampled_from((-1.0, 1.0)))
def test_a_turn_shows_the_strength_whatever_was_believed(model: Norrbin, share: float, side: float) -> None:
    estimate = after_a_turn(model, share, side=side)
    assert rudder_effectiveness(model, RUDDER, estimate) == pytest.approx(share, abs=0.07)
    assert (
        0.0 <= rudder_effectiveness(model, RUDDER, estimate) - rudder_effectiveness(model, RUDDER, estimate, 0.3) < 0.1
    )


@pytest.mark.parametrize("model", BOATS[:2])
@pytest.mark.parametrize("share", [0.7, 1.0, 1.3])
def test_a_push_of_two_degrees_of_rudder_is_distinguished_from_strength_by_counter_rudder(
    model: Norrbin, share: float
) -> None:
    found, one_sided = (
        rudder_effectiveness(model, RUDDER, after_a_turn(model, share, push=math.radians(2.0), counter=counter))
        for counter in (True, False)
    )
    assert found == pytest.approx(share, abs=0.07)
    assert one_sided > found + 0.05


@pytest.mark.parametrize("model", BOATS)
def test_the_noise_of_a_filtered_gyro_matters_little(model: Norrbin) -> None:
    estimate = after_a_turn(model, 0.8, noise=math.radians(0.05))
    assert rudder_effectiveness(model, RUDDER, estimate) == pytest.approx(0.8, abs=0.03)


@pytest.mark.parametrize("model", BOATS)
def test_what_is_seen_through_noise_is_believed_less(model: Norrbin) -> None:
    found = [
        rudder_effectiveness(model, RUDDER, after_a_turn(model, 0.7, noise=math.radians(deg)))
        for deg in (0.05, 1.0, 10.0)
    ]
    assert 0.7 <= found[0] < found[1] < found[2] == pytest.approx(1.0, abs=0.15)


@given(caution=st.floats(0.0, 0.3))
def test_the_model_is_believed_less_the_care_until_something_is_shown(caution: float) -> None:
    assert rudder_effectiveness(BOATS[0], RUDDER, NO_EVIDENCE, caution) == pytest.approx(1.0 - caution)
    resting = NO_EVIDENCE
    for _ in range(400):
        resting = updated_effectiveness(BOATS[0], resting, 0.0, 0.0, DT)
    assert rudder_effectiveness(BOATS[0], RUDDER, resting, caution) == pytest.approx(1.0 - caution)


@given(
    rates=st.lists(st.floats(-10.0, 10.0), min_size=1, max_size=30),
    rudder=st.floats(-1.6, 1.6),
    dt=st.floats(0.0, 0.5),
)
def test_whatever_comes_it_stays_between_the_weakest_and_the_strongest(
    rates: list[float], rudder: float, dt: float
) -> None:
    estimate = NO_EVIDENCE
    for rate in rates:
        estimate = updated_effectiveness(BOATS[1], estimate, rate, rudder, dt)
        assert WEAKEST <= rudder_effectiveness(BOATS[1], RUDDER, estimate) <= STRONGEST
