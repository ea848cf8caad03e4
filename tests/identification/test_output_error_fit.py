"""The two stages and the output-error fit on boats that are known."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from zigzag_trials import LANXIN, noisy, run_of, zigzag

from autopilot.errors import InputError
from autopilot.identification import output_error
from autopilot.identification.identified import Question, SteadyTurns
from autopilot.identification.identify import identify
from autopilot.identification.residual_tests import predict
from autopilot.identification.runs import mean_speed
from autopilot.identification.simulation import Forcing, at_samples, forcing, simulate
from autopilot.identification.two_stage import cubic_damping_stage, nomoto_stage
from autopilot.models.norrbin import Norrbin, steady_rate

COARSE = zigzag(np.radians(15.0), 40.0, 0.5)
FINE = zigzag(np.radians(15.0), 20.0, 0.1)
RATE_NOISE, HEADING_NOISE = np.radians(0.3), np.radians(0.3)


def steady_turns() -> SteadyTurns:
    truth = Norrbin(LANXIN["K"], LANXIN["T"], LANXIN["n3"])
    rudder = np.radians([10.0, 20.0, 30.0, 35.0])
    return SteadyTurns(rudder, np.array([steady_rate(truth, float(angle)) for angle in rudder]))


def test_at_the_paper_s_sampling_only_two_stage_is_biased() -> None:
    """Zigzag and steady turns, as in the paper."""
    run = run_of(noisy(COARSE, RATE_NOISE, HEADING_NOISE, seed=3))
    stage = nomoto_stage([run], reference_speed=5.0)
    assert stage is not None
    assert stage.gain < 0.95 * LANXIN["K"]
    assert stage.time_constant < 0.95 * LANXIN["T"]
    found = identify([run], Question(steady_turns=steady_turns()))
    assert found.unidentifiable == {}
    assert found.model.gain == pytest.approx(LANXIN["K"], rel=0.05)
    assert found.model.time_constant == pytest.approx(LANXIN["T"], rel=0.05)
    assert found.model.n3 == pytest.approx(LANXIN["n3"], rel=0.10)


@pytest.mark.parametrize("seed", range(3))
def test_at_the_papers_sampling_a_zigzag_alone_gives_gain_and_time_constant(seed: int) -> None:
    """The rudder turns round between samples; carried round its corners it biases nothing any more."""
    table = zigzag(np.radians(15.0), 120.0, 0.5)
    found = identify([run_of(noisy(table, RATE_NOISE, HEADING_NOISE, seed))])
    assert found.model.gain == pytest.approx(LANXIN["K"], rel=0.05)
    assert found.model.time_constant == pytest.approx(LANXIN["T"], rel=0.05)
    error = found.standard_errors["n3"]
    assert error is not None
    assert abs(found.model.n3 - LANXIN["n3"]) < 3.0 * error


def test_a_zero_order_hold_regression_has_no_time_constant_at_the_papers_sampling() -> None:
    rate, rudder = COARSE["yaw_rate_rad_s"], COARSE["rudder_rad"]
    memory, _ = np.linalg.lstsq(np.stack([rate[:-1], rudder[:-1]], axis=1), rate[1:], rcond=None)[0]
    assert memory < 0.2  # exp(-0.5/0.332) is 0.22: the moving rudder has taken all of it


def test_the_model_is_identified_from_heading_without_a_rate() -> None:
    table = {k: v for k, v in noisy(FINE, 0.0, np.radians(0.2), seed=5).items() if k != "yaw_rate_rad_s"}
    found = identify([run_of(table)])
    assert found.model.gain == pytest.approx(LANXIN["K"], rel=0.05)
    assert found.model.time_constant == pytest.approx(LANXIN["T"], rel=0.10)
    assert predict(found.model, run_of(table)).yaw_rate_r2 is None


def test_rate_alone_is_enough() -> None:
    table = {k: v for k, v in noisy(FINE, RATE_NOISE, 0.0, seed=6).items() if k != "heading_rad"}
    found = identify([run_of(table)])
    assert found.model.gain == pytest.approx(LANXIN["K"], rel=0.05)
    assert predict(found.model, run_of(table)).heading_rms is None


def test_blanks_and_a_gap_change_the_estimate_little_and_cut_the_run() -> None:
    table = {key: values.copy() for key, values in noisy(FINE, RATE_NOISE, HEADING_NOISE, seed=7).items()}
    whole = identify([run_of(table)]).model
    table["yaw_rate_rad_s"][::3] = np.nan
    table["heading_rad"][1::4] = np.nan
    table["rudder_rad"][100:130] = np.nan
    run = run_of(table)
    assert len(run.segments) == 2
    broken = identify([run]).model
    assert broken.gain == pytest.approx(whole.gain, rel=0.05)
    assert broken.time_constant == pytest.approx(whole.time_constant, rel=0.10)


def test_runs_at_two_speeds_give_one_model() -> None:
    ratio = 2.0
    fast = zigzag(np.radians(15.0), 20.0, 0.1, K=0.701 * ratio, T=0.332 / ratio, n3=3.2828 / ratio**2, speed=10.0)
    runs = [
        run_of(noisy(FINE, RATE_NOISE, HEADING_NOISE, 8), "slow"),
        run_of(noisy(fast, RATE_NOISE, 0.005, 9), "fast"),
    ]
    found = identify(runs, Question(reference_speed=5.0))
    assert found.model.gain == pytest.approx(0.701, rel=0.05)
    assert found.model.time_constant == pytest.approx(0.332, rel=0.05)
    assert 5.0 < mean_speed(runs) < 10.0


def test_the_bias_is_found() -> None:
    table = noisy(zigzag(np.radians(15.0), 20.0, 0.1, n0=0.02), RATE_NOISE, HEADING_NOISE, seed=10)
    found = identify([run_of(table)])
    error = found.standard_errors["n0"]
    assert error is not None
    assert abs(found.model.n0 - 0.02) < 4.0 * error < 0.01


def test_a_linear_boat_has_no_cubic_damping_and_the_fit_says_so() -> None:
    table = noisy(zigzag(np.radians(10.0), 20.0, 0.1, n3=0.0), RATE_NOISE, HEADING_NOISE, seed=11)
    dropped = identify([run_of(table)], Question(weighting="residuals"))
    assert dropped.model.n3 == 0.0
    assert dropped.standard_errors["n3"] is None
    assert dropped.unidentifiable["n3"].startswith("n3: ")
    kept = identify([run_of(table)])
    assert kept.unidentifiable["n3"].startswith("n3: ") and "kept with its doubt" in kept.unidentifiable["n3"]
    for name, truth in (("gain", LANXIN["K"]), ("time_constant", LANXIN["T"]), ("n3", 0.0)):
        error = kept.standard_errors[name]
        assert error is not None and abs(getattr(kept.model, name) - truth) < 3.0 * error, name


def test_a_course_unstable_boat_is_found_when_it_is_said_to_be_one() -> None:
    table = zigzag(np.radians(20.0), 60.0, 0.2, K=0.4, T=1.0, n3=20.0, n1=-1.0)
    run = run_of(noisy(table, RATE_NOISE, HEADING_NOISE, seed=14))
    found = identify([run], Question(course_unstable=True))
    assert found.model.n1 == -1.0
    assert found.model.gain == pytest.approx(0.4, rel=0.05)
    assert found.model.time_constant == pytest.approx(1.0, rel=0.05)
    assert found.model.n3 == pytest.approx(20.0, rel=0.05)
    prediction = predict(found.model, run).yaw_rate_r2
    assert prediction is not None
    assert prediction > 0.95


def test_nomoto_leaves_the_cubic_out_without_complaint() -> None:
    found = identify([run_of(FINE)], Question("nomoto"))
    assert found.model.n3 == 0.0
    assert found.unidentifiable == {}


def test_steady_turns_give_the_cubic_that_a_gentle_zigzag_cannot() -> None:
    turns = steady_turns()
    gentle = noisy(zigzag(np.radians(3.0), 20.0, 0.1), RATE_NOISE, HEADING_NOISE, seed=12)
    found = identify([run_of(gentle)], Question(steady_turns=turns))
    assert found.model.n3 == pytest.approx(LANXIN["n3"], rel=0.25)
    held = cubic_damping_stage(turns.rudder, turns.rate, LANXIN["K"])
    assert held.n3 == pytest.approx(LANXIN["n3"], rel=1e-6)


def test_steady_turns_of_a_faster_boat_are_scaled() -> None:
    turns = SteadyTurns(np.radians([20.0]), np.array([0.1 * 2.0]), np.array([10.0]))
    at_reference = SteadyTurns(np.radians([20.0]), np.array([0.1]))
    from autopilot.identification.identify import steady_damping

    assert steady_damping(turns, 0.701, 5.0).n3 == pytest.approx(steady_damping(at_reference, 0.701, 5.0).n3)


def test_a_reversed_rudder_is_named_as_such() -> None:
    table = {**FINE, "rudder_rad": -FINE["rudder_rad"]}
    with pytest.raises(InputError, match=r"turns against its rudder.*--reverse-rudder"):
        identify([run_of(table, "zigzag.csv")])


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_pilot_that_steers_against_waves_is_not_taken_for_a_boat_that_turns_against_its_rudder(side: float) -> None:
    random, phases, step = np.random.default_rng(7), np.linspace(0.0, 20.0, 8), 0.1
    swells = 2.0 * np.pi * np.linspace(0.085, 0.15, 8)
    heading, rate, rudder = 0.0, 0.0, 0.0
    table: dict[str, list[float]] = {name: [] for name in ("time_s", "heading_rad", "rudder_rad", "speed_m_s")}
    for time in step * np.arange(1200):
        rolling = (
            0.0175 * np.sum(np.sin(swells * time + phases)),
            0.0175 * np.sum(swells * np.cos(swells * time + phases)),
        )
        rudder = float(np.clip(-1.2 * (heading + rolling[0]) - 3.0 * (rate + rolling[1]), -0.5, 0.5))
        rate += step * (0.25 * (rudder + 0.01 * random.normal()) - rate) / 4.0
        heading += step * rate
        row = (time, heading + rolling[0] + 0.005 * random.normal(), side * rudder, 3.0)
        for name, value in zip(table, row, strict=True):
            table[name].append(float(value))
    with pytest.raises(InputError, match="a pilot or a hand moves it against waves"):
        identify([run_of({name: np.array(values) for name, values in table.items()}, "held.csv")])


def test_a_rudder_that_never_moves_is_refused() -> None:
    table = {**FINE, "rudder_rad": np.zeros_like(FINE["rudder_rad"])}
    with pytest.raises(InputError, match=r"zigzag\.csv: the rudder never moves"):
        identify([run_of(table, "zigzag.csv")])


def test_a_motion_that_has_nothing_to_do_with_the_rudder_is_refused() -> None:
    random = np.random.default_rng(13)
    noise = random.normal(size=FINE["time_s"].size) * 0.05
    with pytest.raises(InputError, match="does not follow the rudder"):
        identify([run_of({**FINE, "yaw_rate_rad_s": noise, "heading_rad": noise})])


def test_a_boat_that_makes_no_way_is_refused() -> None:
    with pytest.raises(InputError, match="makes no way"):
        identify([run_of({**FINE, "speed_m_s": np.zeros_like(FINE["time_s"])})])


@pytest.mark.parametrize("longest", [0.01, 0.05, 0.25])
def test_the_simulation_follows_an_independent_integration(longest: float) -> None:
    run = run_of(FINE)
    steps = forcing(run.segments, longest)
    truth = Norrbin(LANXIN["K"], LANXIN["T"], LANXIN["n3"], reference_speed=5.0)
    trajectory = simulate(truth, steps, np.array([0.0]))
    rate = at_samples(trajectory.rate, steps, 0)
    turned = at_samples(trajectory.turned, steps, 0)
    tolerance = 2.0e-3 if longest < 0.1 else 2.0e-2
    np.testing.assert_allclose(rate, FINE["yaw_rate_rad_s"], atol=tolerance)
    np.testing.assert_allclose(turned, FINE["heading_rad"], atol=4.0 * tolerance)


def test_standard_errors_cover_the_truth_under_gusts_that_last() -> None:
    """Gusts with a memory of seconds make the residuals correlated; white-noise errors would be far too small."""
    inside = []
    for seed in range(8):
        table = zigzag(np.radians(15.0), 60.0, 0.3, n3=0.0, T=1.5, gust=0.04, gust_memory=2.0, seed=seed)
        found = identify([run_of(noisy(table, 0.002, 0.002, seed))], Question("nomoto"))
        for name, truth in (("gain", LANXIN["K"]), ("time_constant", 1.5)):
            error = found.standard_errors[name]
            assert error is not None
            inside.append(abs(getattr(found.model, name) - truth) < 1.96 * error)
    # 95 % intended; 16 draws, correlated by twos, of an estimator with a small-sample bias
    assert np.mean(inside) >= 0.75


def spinning_boat(seed: int) -> dict[str, np.ndarray]:
    """A boat of K 10.75 1/s and T 0.1 s at 10 Hz for 43 s: straight on, then spun at 28 deg of rudder."""
    dt, random = 0.001, np.random.default_rng(seed)
    rate = heading = rudder = 0.0
    rows = []
    for i in range(43_000):
        order = np.radians(28.0) if i >= 12_000 else 0.0
        rudder += min(order - rudder, np.radians(60.0) * dt)
        rate += dt * (10.75 * rudder - rate - 0.3 * rate**3) / 0.1
        heading += dt * rate
        if i % 100 == 0:
            rows.append((i * dt, heading, rate, rudder))
    table = np.array(rows)
    table[:, 1] += random.normal(0.0, HEADING_NOISE, len(rows))
    table[:, 2] += random.normal(0.0, RATE_NOISE, len(rows))
    names = ("time_s", "heading_rad", "yaw_rate_rad_s", "rudder_rad")
    return {**dict(zip(names, table.T, strict=True)), "speed_m_s": 3.0 + 0.3 * np.sin(table[:, 0] / 3.0)}


@pytest.mark.parametrize("seed", range(2))
def test_a_boat_quicker_than_its_samples_ends_in_a_sentence_and_not_in_ever_smaller_steps(
    seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    steps: list[int] = []

    def counted(*arguments: Any) -> Forcing:
        found = fit_steps(*arguments)
        steps.append(found.step.size)
        assert steps[-1] < 21 * 430, "four steps in a fifth of the time between samples are enough"
        return found

    fit_steps = output_error.fit_steps
    monkeypatch.setattr(output_error, "fit_steps", counted)
    found = identify([run_of(spinning_boat(seed))], Question(weighting="residuals"))
    assert steps
    assert "T" not in found.unidentifiable or "faster than these runs can show" in found.unidentifiable["T"]
    assert found.model.time_constant >= 0.02 * (1.0 - 1.0e-6)


@pytest.mark.parametrize("seed", range(2))
def test_a_quick_motorboat_is_identified_from_43_seconds(seed: int) -> None:
    found = identify([run_of(spinning_boat(seed))])
    assert found.model.gain == pytest.approx(10.75, rel=0.1) or "T" in found.unidentifiable


def test_a_time_constant_far_below_the_samples_is_not_given() -> None:
    table = zigzag(np.radians(15.0), 60.0, 0.1, T=0.004, n3=0.0, rudder_rate=np.radians(60.0))
    found = identify([run_of(noisy(table, RATE_NOISE, HEADING_NOISE, 1))], Question("nomoto"))
    assert (
        "faster than these runs can show; record a zigzag, with heading and rate more often"
        in found.unidentifiable["T"]
    )
    assert found.model.gain == pytest.approx(LANXIN["K"], rel=0.05)
