"""The integral method: windows, and the fit with instruments."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from zigzag_trials import LANXIN, noisy, run_of, zigzag

from autopilot.identification.identified import Question
from autopilot.identification.integral_fit import FitSettings, IntegralFit, window_length
from autopilot.identification.integral_method import integral
from autopilot.identification.integral_window import (
    Integrals,
    IntegralWindow,
)
from autopilot.identification.registry import method_named
from autopilot.models.norrbin import Norrbin

TRUE = Norrbin(LANXIN["K"], LANXIN["T"], LANXIN["n3"])
NOISE = {"rate": math.radians(0.1), "heading": math.radians(0.2)}
TWENTY_SECONDS = zigzag(math.radians(15.0), 20.0, 0.1)

Sample = tuple[float, float, float, float, float]


def samples(table: dict[str, np.ndarray], speed: float = 5.0) -> Iterator[Sample]:
    """Time, rudder, ratio, heading, rate."""
    names = ("time_s", "rudder_rad", "speed_m_s", "heading_rad", "yaw_rate_rad_s")
    for time, rudder, now, heading, rate in zip(*(table[name].tolist() for name in names), strict=True):
        yield time, rudder, now / speed, heading, rate


def windows(table: dict[str, np.ndarray], length: float = 3.0, **options: bool) -> list[Integrals]:
    window = IntegralWindow(length, longest_gap=2.0, **options)
    found = [window.update(*sample) for sample in samples(table)]
    return [each for each in found if each is not None]


def error(model: Norrbin, window: Integrals) -> float:
    return (
        model.n1 * window.turned
        + model.time_constant * window.rate_change
        + model.n3 * window.cubed
        + model.n0 * window.elapsed
        - model.gain * window.driven
    )


@pytest.mark.parametrize("from_mean", [False, True])
def test_the_true_boat_satisfies_the_equation_of_every_window(from_mean: bool) -> None:
    found = windows(TWENTY_SECONDS, from_mean=from_mean)
    assert len(found) > 50
    size = max(abs(each.turned) for each in found)
    assert max(abs(error(TRUE, each)) for each in found) < 0.005 * size
    assert max(abs(error(TRUE._replace(gain=1.1 * TRUE.gain), each)) for each in found) > 0.05 * size


def test_heading_alone_or_rate_alone_give_the_same_equations() -> None:
    both = windows(TWENTY_SECONDS)
    for missing in ("heading_rad", "yaw_rate_rad_s"):
        alone = windows({**TWENTY_SECONDS, missing: np.full(200, np.nan)})
        for one, other in zip(both, alone, strict=True):
            assert one.turned == pytest.approx(other.turned, abs=2.0e-3)
            assert one.rate_change == pytest.approx(other.rate_change, abs=5.0e-3)


def test_trim_and_a_changing_speed_are_part_of_the_equation() -> None:
    """T r' + s r + n3 r^3/s + n0 s^2 = K s^2 delta with the speed ratio s going from 1.5 to 0.5 and back."""
    table = zigzag(0.25, 60.0, 0.1, K=0.5, T=2.0, n3=0.0)
    dt, rate, heading, rows = 0.01, 0.0, 0.0, []
    rudder = np.interp(np.arange(0.0, 60.0, dt), table["time_s"], table["rudder_rad"])
    for i in range(6000):
        s = 1.0 + 0.5 * math.cos(0.2 * i * dt)
        if i % 10 == 0:
            rows.append((heading, rate, 5.0 * s))
        rate += dt * (0.5 * s * s * rudder[i] - s * rate - 20.0 * rate**3 / s - 0.02 * s * s) / 2.0
        heading += dt * rate
    moved = np.array(rows)
    record = {**table, "heading_rad": moved[:, 0], "yaw_rate_rad_s": moved[:, 1], "speed_m_s": moved[:, 2]}
    boat = Norrbin(0.5, 2.0, 20.0, n0=0.02)
    found = windows(record, 8.0)
    assert max(abs(error(boat, each)) for each in found) < 0.01 * max(abs(each.turned) for each in found)


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=15, deadline=None)
def test_irregular_sampling_changes_the_equation_little(seed: int) -> None:
    dense = zigzag(0.25, 12.0, 0.02)
    keep = np.sort(np.random.default_rng(seed).choice(600, size=220, replace=False))
    kept = {name: values[keep] for name, values in dense.items()}
    found = windows(kept)
    assert found
    assert max(abs(error(TRUE, each)) for each in found) < 0.02 * max(abs(each.turned) for each in found)


def test_a_gap_begins_a_new_window_and_so_does_rest() -> None:
    record = list(samples(TWENTY_SECONDS))
    for break_up in (
        [s for s in record if not 8.0 < s[0] < 11.0],
        [(*s[:2], 0.0 if s[0] == 9.0 else 1.0, *s[3:]) for s in record],
    ):
        window = IntegralWindow(3.0, longest_gap=1.0)
        ends = [each.time for each in (window.update(*sample) for sample in break_up) if each is not None]
        assert any(7.5 < end <= 9.0 for end in ends)
        assert not any(9.1 < end < 12.0 for end in ends)
        assert any(end > 14.0 for end in ends)


def test_a_turn_through_north_is_a_small_one() -> None:
    wrapped = {**TWENTY_SECONDS, "heading_rad": np.mod(TWENTY_SECONDS["heading_rad"] - 0.1, 2.0 * math.pi)}
    for one, other in zip(windows(TWENTY_SECONDS), windows(wrapped), strict=True):
        assert one.turned == pytest.approx(other.turned, abs=1.0e-9)


def test_memory_does_not_grow() -> None:
    fit = IntegralFit(TRUE)
    sizes = []
    for lap in range(3):
        for time, *rest in samples(TWENTY_SECONDS):
            fit.update(time + 20.0 * lap, *rest)
        sizes.append((len(fit._window._ring), fit._sums.R.size, fit._moments.size))
    assert sizes[0] == sizes[1] == sizes[2]


@pytest.mark.parametrize("length", [0.0, -1.0, math.inf, math.nan])
def test_a_window_without_length_is_refused(length: float) -> None:
    with pytest.raises(ValueError, match="integral window"):
        IntegralWindow(length)


def test_nan_and_infinity_count_as_missing_samples() -> None:
    nan = math.nan
    broken = [
        (t, d, s, nan if i % 5 == 0 else h, math.inf if i % 7 == 0 else r)
        for i, (t, d, s, h, r) in enumerate(samples(TWENTY_SECONDS))
    ]
    window = IntegralWindow(3.0, longest_gap=2.0)
    found = [each for each in (window.update(*sample) for sample in broken) if each is not None]
    assert found
    assert all(math.isfinite(value) for each in found for value in each)
    assert max(abs(error(TRUE, each)) for each in found) < 0.02 * max(abs(each.turned) for each in found)


@pytest.mark.parametrize("factor", [0.5, 2.0])
def test_the_fit_comes_within_five_per_cent_in_twenty_seconds_and_stays(factor: float) -> None:
    for seed in range(3):
        fit = IntegralFit(Norrbin(factor * TRUE.gain, factor * TRUE.time_constant, factor * TRUE.n3))
        for sample in samples(noisy(TWENTY_SECONDS, NOISE["rate"], NOISE["heading"], seed)):
            fit.update(*sample)
        learnt = fit.model
        assert learnt.gain == pytest.approx(TRUE.gain, rel=0.05)
        assert learnt.time_constant == pytest.approx(TRUE.time_constant, rel=0.05)
        random = np.random.default_rng(seed)
        for i in range(600):
            heading, rate = random.normal(0.0, NOISE["heading"]), random.normal(0.0, NOISE["rate"])
            fit.update(30.0 + 0.1 * i, random.normal(0.0, 0.005), 1.0, heading, rate)
        assert fit.model == learnt


def test_without_excitation_nothing_is_learnt() -> None:
    fit = IntegralFit(TRUE)
    for i in range(1000):
        assert fit.update(0.1 * i, 0.01, 1.0, 0.0, 0.0) is None
    assert fit.model == TRUE
    assert fit.windows == 0


def test_windows_are_fitted_to_the_time_constant_that_was_found() -> None:
    table = zigzag(0.26, 120.0, 0.1, K=0.2, T=5.0, n3=20.0)
    fit = IntegralFit(Norrbin(0.1, 1.0, 10.0))
    begun_with = fit.length
    for sample in samples(table):
        fit.update(*sample)
    assert begun_with == 3.0
    assert fit.length == pytest.approx(window_length(5.0), rel=0.2)
    assert fit.model.time_constant == pytest.approx(5.0, rel=0.05)


def test_n2_is_not_known_to_the_method() -> None:
    with pytest.raises(ValueError, match="n2"):
        IntegralFit(Norrbin(1.0, 1.0, n2=0.1))


def test_the_method_says_that_a_gentle_record_does_not_tell_n3() -> None:
    table = noisy(zigzag(math.radians(6.0), 60.0, 0.1), NOISE["rate"], NOISE["heading"], 3)
    found = integral([run_of(table)], Question())
    assert found.model.n3 == 0.0
    assert "cannot be distinguished from 0" in found.unidentifiable["n3"]


def test_standard_errors_cover_the_truth() -> None:
    inside = 0
    for seed in range(8):
        run = run_of(noisy(zigzag(math.radians(20.0), 30.0, 0.1), NOISE["rate"], NOISE["heading"], seed))
        found = integral([run], Question(start=TRUE._replace(n3=1.0, reference_speed=5.0)))
        error = found.standard_errors["gain"]
        assert error is not None
        inside += abs(found.model.gain - TRUE.gain) < 2.0 * error
    assert inside >= 6


def test_the_way_there_is_kept() -> None:
    found = method_named("integral").identify([run_of(TWENTY_SECONDS)], Question("nomoto"))
    assert found.convergence is not None
    assert found.convergence.names[:2] == ("gain", "time_constant")
    assert found.convergence.values.shape == (found.convergence.time.size, len(found.convergence.names))
    assert np.all(np.diff(found.convergence.time) > 0.0)
    assert FitSettings().memory > 0.0
