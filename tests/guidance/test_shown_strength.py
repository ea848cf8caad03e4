"""How strong a boat shows its rudder to be: against a boat simulated with another K, and a push that nobody knows."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from autopilot.guidance.turn import NOTHING_SHOWN, STRONGEST, WEAKEST, Shown, strength, watched
from autopilot.models.norrbin import Norrbin, rate_step

RUDDER, DT = math.radians(20.0), 0.05
BOATS = (
    Norrbin(0.2, 5.0, 20.0, n1=-1.0),
    Norrbin(0.12, 12.0, 60.0, n1=-0.5),
    Norrbin(0.5, 2.0, 3.0, n1=-0.6, n0=0.01),
)


def after_a_turn(
    model: Norrbin, share: float, push: float = 0.0, noise: float = 0.0, side: float = 1.0, counter: bool = True
) -> Shown:
    """Return what a boat shows in a turn of three time constants, half of it, where asked, with counter-rudder."""
    true, random = model._replace(gain=share * model.gain), np.random.default_rng(1)
    shown, rate, rudder, steps = NOTHING_SHOWN, 0.0, 0.0, round(3.0 * model.time_constant / DT)
    for step in range(steps):
        over = side * 0.5 * RUDDER * (1.0 if 2 * step < steps or not counter else -1.0)
        rudder += min(max(over - rudder, -0.1 * DT), 0.1 * DT)
        rate = rate_step(true, rate, rudder + push / share, DT)
        shown = watched(model, shown, rate + noise * random.standard_normal(), rudder, DT)
    return shown


@pytest.mark.parametrize("model", BOATS)
@given(share=st.floats(WEAKEST, STRONGEST), side=st.sampled_from((-1.0, 1.0)))
def test_a_turn_shows_the_strength_whatever_was_believed(model: Norrbin, share: float, side: float) -> None:
    shown = after_a_turn(model, share, side=side)
    assert strength(model, RUDDER, shown) == pytest.approx(share, abs=0.07)
    assert 0.0 <= strength(model, RUDDER, shown) - strength(model, RUDDER, shown, 0.3) < 0.1


@pytest.mark.parametrize("model", BOATS[:2])
@pytest.mark.parametrize("share", [0.7, 1.0, 1.3])
def test_a_push_of_two_degrees_of_rudder_is_told_from_strength_by_counter_rudder(model: Norrbin, share: float) -> None:
    found, one_sided = (
        strength(model, RUDDER, after_a_turn(model, share, push=math.radians(2.0), counter=counter))
        for counter in (True, False)
    )
    assert found == pytest.approx(share, abs=0.07)
    assert one_sided > found + 0.05


@pytest.mark.parametrize("model", BOATS)
def test_the_noise_of_a_filtered_gyro_matters_little(model: Norrbin) -> None:
    shown = after_a_turn(model, 0.8, noise=math.radians(0.05))
    assert strength(model, RUDDER, shown) == pytest.approx(0.8, abs=0.03)


@pytest.mark.parametrize("model", BOATS)
def test_what_is_seen_through_noise_is_believed_less(model: Norrbin) -> None:
    found = [strength(model, RUDDER, after_a_turn(model, 0.7, noise=math.radians(deg))) for deg in (0.05, 1.0, 10.0)]
    assert 0.7 <= found[0] < found[1] < found[2] == pytest.approx(1.0, abs=0.15)


@given(care=st.floats(0.0, 0.3))
def test_the_model_is_believed_less_the_care_until_something_is_shown(care: float) -> None:
    assert strength(BOATS[0], RUDDER, NOTHING_SHOWN, care) == pytest.approx(1.0 - care)
    resting = NOTHING_SHOWN
    for _ in range(400):
        resting = watched(BOATS[0], resting, 0.0, 0.0, DT)
    assert strength(BOATS[0], RUDDER, resting, care) == pytest.approx(1.0 - care)


@given(
    rates=st.lists(st.floats(-10.0, 10.0), min_size=1, max_size=30),
    rudder=st.floats(-1.6, 1.6),
    dt=st.floats(0.0, 0.5),
)
def test_whatever_comes_it_stays_between_the_weakest_and_the_strongest(
    rates: list[float], rudder: float, dt: float
) -> None:
    shown = NOTHING_SHOWN
    for rate in rates:
        shown = watched(BOATS[1], shown, rate, rudder, dt)
        assert WEAKEST <= strength(BOATS[1], RUDDER, shown) <= STRONGEST
