"""Wave forces by strips, extra resistance and the speed it costs: closed forms, symmetries and energy."""

from __future__ import annotations

import math

import naval_vessel as naval
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from naval_vessel import NAVAL_STRIPS, Sea, sea_forces, sections, strip_damping, strip_load, water_acceleration

from autopilot.models.weather import GRAVITY
from sitl.roll_ship import NAVAL_HULL, NAVAL_RUDDERS, SERVICE_SPEED, drag_coefficient

FREQUENCY = np.linspace(0.35, 2.2, 60)
QUARTER = math.radians(135.0)


def amplitudes(frequency: float, angle: float) -> np.ndarray:
    return strip_load(NAVAL_STRIPS, water_acceleration(NAVAL_STRIPS, np.array([frequency]), angle))[0]


def test_long_waves_push_with_the_slope_of_the_sea() -> None:
    """k to 0: Y = 1.585 m g k sin(beta), a quarter of a period ahead of the elevation."""
    k = 1.0e-6
    sway, roll, yaw = amplitudes(math.sqrt(GRAVITY * k), QUARTER)
    expected = 1.585 * NAVAL_HULL.mass * GRAVITY * k * math.sin(QUARTER)
    assert sway == pytest.approx(1j * expected, rel=1e-4)
    assert roll / sway == pytest.approx(1.78 / 1.585, rel=1e-9)
    assert yaw / sway == pytest.approx(-2.0, rel=1e-2)


def test_parabolic_sections_against_the_closed_form() -> None:
    """Mean of exp(-j q x) over a parabola of half length a: 3 (sin c - c cos c)/c^3 with c = q a."""
    frequency, angle = 1.3, QUARTER
    k = frequency**2 / GRAVITY
    a, q = NAVAL_STRIPS.length / 2.0, k * math.cos(angle)
    c = q * a
    b = 0.5 * k * NAVAL_STRIPS.beam * abs(math.sin(angle))
    shape = 3.0 * (math.sin(c) - c * math.cos(c)) / c**3 * np.exp(-1j * q * NAVAL_STRIPS.middle)
    local = 1j * GRAVITY * k * math.sin(angle) * math.exp(-k * NAVAL_STRIPS.draught / 2.0) * math.sin(b) / b
    assert amplitudes(frequency, angle)[0] == pytest.approx(1.585 * NAVAL_STRIPS.mass * local * shape, rel=5e-3)


@given(frequency=st.floats(0.35, 2.2), angle=st.floats(0.01, 3.1))
def test_waves_from_the_other_side_push_the_other_way(frequency: float, angle: float) -> None:
    np.testing.assert_allclose(amplitudes(frequency, -angle), -amplitudes(frequency, angle), rtol=1e-12)


def test_head_seas_push_nothing_sideways() -> None:
    assert np.max(np.abs(amplitudes(0.9, math.pi))) < 1e-6


def test_a_realisation_has_the_power_of_its_spectrum_and_its_phases() -> None:
    generator = np.random.default_rng(3)
    phase = generator.uniform(0.0, 2.0 * math.pi, len(FREQUENCY))
    sea, time = Sea(4.0, 7.0, QUARTER), np.arange(0.0, 4000.0, 0.25)
    forces = sea_forces(NAVAL_STRIPS, sea, SERVICE_SPEED, FREQUENCY, phase, time)
    again = sea_forces(NAVAL_STRIPS, sea, SERVICE_SPEED, FREQUENCY, phase, time)
    np.testing.assert_array_equal(forces.load, again.load)
    from autopilot.models.weather import component_amplitudes

    elevation = component_amplitudes(FREQUENCY, 4.0, 7.0)
    lines = strip_load(NAVAL_STRIPS, water_acceleration(NAVAL_STRIPS, FREQUENCY, QUARTER)) * elevation[:, None]
    expected = np.sqrt(0.5 * np.sum(np.abs(lines) ** 2, axis=0))
    np.testing.assert_allclose(forces.load.std(axis=0), expected, rtol=0.03)


def test_sixty_components_carry_the_significant_height() -> None:
    from autopilot.models.weather import component_amplitudes

    elevation = component_amplitudes(FREQUENCY, 4.0, 7.0)
    assert 4.0 * math.sqrt(0.5 * float(np.sum(elevation**2))) == pytest.approx(4.0, rel=0.03)


def test_a_strip_radiates_what_it_feels() -> None:
    """b = |X|^2 w/(rho g^2): at best half of the power of a beam sea, 0.5 rho g c_g, can be absorbed, |X|^2/(8 b)."""
    frequency = 1.2
    x, share = sections(NAVAL_STRIPS)
    force = (
        1.585
        * NAVAL_STRIPS.mass
        * share
        * np.abs(water_acceleration(NAVAL_STRIPS, np.array([frequency]), math.pi / 2.0)[0])
    )
    step = NAVAL_STRIPS.length / len(x)
    absorbed = force**2 / (8.0 * strip_damping(NAVAL_STRIPS, frequency))
    arriving = 0.5 * 1014.0 * GRAVITY * GRAVITY / (2.0 * frequency) * step
    np.testing.assert_allclose(absorbed, 0.5 * arriving, rtol=1e-12)


@given(extra=st.floats(-0.9, 50.0))
def test_speed_at_constant_power(extra: float) -> None:
    """(R_t(y U) + dR) y U = R_t(U) U, and the printed formula overstates every loss."""
    y = naval.true_speed_ratio(extra)
    assert (y * y + extra) * y == pytest.approx(1.0, rel=1e-12)
    if extra > 1e-9:
        assert 1.0 - naval.printed_speed_ratio(extra) > 1.0 - y > 0.0


def test_the_papers_own_loss_shrinks_to_a_third() -> None:
    """The paper's 12.93 kn of 15: by eq. (26) dR/R_t is 0.160, which really costs 5 %, 2.6 to 3 times less."""
    extra = 15.0 / 12.93 - 1.0
    assert naval.printed_speed_ratio(extra) == pytest.approx(12.93 / 15.0)
    ratio = (1.0 - 12.93 / 15.0) / (1.0 - naval.true_speed_ratio(extra))
    assert 2.4 < ratio < 3.0


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_a_resistance_that_is_no_number_is_refused(bad: float) -> None:
    with pytest.raises(ValueError, match="finite"):
        naval.true_speed_ratio(bad)


def test_each_part_of_the_extra_resistance_by_hand() -> None:
    ten = np.full(7, drag_coefficient(NAVAL_RUDDERS, math.radians(10.0)))
    drag = 0.5 * 1014.0 * 3.0 * 0.54**2 / (2.7 * math.pi) * SERVICE_SPEED**2
    assert naval.rudder_resistance(NAVAL_RUDDERS, SERVICE_SPEED, ten) == pytest.approx(drag)
    sway, rate = np.array([-1.0, -1.0]), np.array([0.05, 0.05])
    expected = (NAVAL_HULL.mass + 393e3) * (1.0 + 3.38 * 0.05) * 0.05
    assert naval.centrifugal_resistance(NAVAL_HULL, sway, rate) == pytest.approx(expected)


def test_a_hull_that_goes_with_the_water_radiates_nothing() -> None:
    x, _ = sections(NAVAL_STRIPS)
    generator = np.random.default_rng(1)
    motion = generator.standard_normal((50, 3))
    motion[:, 1] = 0.0
    water = motion[:, :1] + motion[:, 2:] * x
    assert naval.radiated_power(NAVAL_STRIPS, 1.2, motion, water) == pytest.approx(0.0, abs=1e-9)
    still = naval.radiated_power(NAVAL_STRIPS, 1.2, motion, 0.0 * water)
    assert still > 0.0
    assert naval.radiated_power(NAVAL_STRIPS, 1.2, 2.0 * motion, 0.0 * water) == pytest.approx(4.0 * still)
    assert naval.radiated_resistance(NAVAL_STRIPS, Sea(4.0, 7.0, math.pi / 2.0), 5.0, still) == pytest.approx(
        0.0, abs=1e-9
    )
