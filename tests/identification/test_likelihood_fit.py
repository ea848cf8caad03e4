"""The likelihood of a boat in gusts: intervals that hold, boats of either stability, and what is said of them.

The boats are those of `benchmarks/independent_boat.py`, which imports nothing of the project.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Literal

import numpy as np
import pytest
from identification_bad_logs import Damage, Table, blank, lost
from identification_intervals import PLANTS, SEAS
from independent_boat import SPEED_M_S, Plant, Sea, zigzags
from scipy.linalg import expm

from autopilot.cli.identify_vessel import Given, write_vessel
from autopilot.cli.main import main
from autopilot.errors import InputError
from autopilot.identification import likelihood_fit as likelihood_fit_module
from autopilot.identification import likelihood_record
from autopilot.identification.compass_and_gyro import compass_late, in_time
from autopilot.identification.identified import Identified, Question, Ratios
from autopilot.identification.identify import at_least_as_doubtful, identify
from autopilot.identification.interval import interval_of
from autopilot.identification.likelihood_fit import likelihood_fit, memory_of, scales
from autopilot.identification.likelihood_record import Form, record_of, rudder_on, without_noise
from autopilot.identification.likelihood_search import Space, approached, settled
from autopilot.identification.marginal_likelihood import Rates, Weather, begin_path, best_path, wave_noise
from autopilot.identification.model_choice import filed_model, ridge_model
from autopilot.identification.rudder_path import DIRECT, RudderTrain, rudder_rate_of
from autopilot.identification.runs import FloatArray, Run, Segment, run_from_columns
from autopilot.identification.verdict import verdict_of, verdict_on_runs
from autopilot.identification.weather_average import Known, mixed, truncated
from autopilot.models.weather import RaceAndWind, inflow_ratio
from autopilot.report.identification import Result, as_text, document_of
from autopilot.vessel.file import load_vessel

QUESTION = Question(reference_speed=SPEED_M_S)
PLANT = {plant.name: plant for plant in PLANTS}
SEA = {sea.name: sea for sea in SEAS}


def runs_of(plant: Plant, sea: Sea, seed: int) -> list[Run]:
    return [run_from_columns(f"{side:+d}.csv", zigzags(plant, sea, [seed], side)[0]) for side in (1, -1)]


@pytest.fixture(scope="module")
def unstable() -> Identified:
    return identify(runs_of(PLANT["unstable"], SEA["calm"], 100), QUESTION)


@pytest.fixture(scope="module")
def ridge() -> Identified:
    neutral = PLANT["neutral"]._replace(b=0.0)
    return identify(runs_of(neutral, SEA["gusts and waves"], 101), QUESTION)


def test_a_course_unstable_boat_is_found_without_an_option(unstable: Identified) -> None:
    assert unstable.ratios is not None
    assert unstable.ratios.values[:3] == pytest.approx((0.2, -0.5, 10.0), rel=0.03)
    assert unstable.model.n1 == -1.0
    assert unstable.model.gain == pytest.approx(0.4, rel=0.03)


def whole(table: Table, random: np.random.Generator) -> Table:
    return table


@pytest.mark.parametrize(
    ("name", "damage", "first"),
    [
        ("K 0.43, T 3.5", whole, 200),
        ("K 0.43, T 3.5", lost(0.2, 0.0), 2026113080),
        ("K 0.43, T 3.5", lost(0.2, 2.0), 2026113085),
        ("neutral", whole, 2026113090),
    ],
    ids=["whole", "a fifth of the rows lost", "a fifth lost, 2 s at a time", "neutral"],
)
def test_in_gusts_and_waves_the_intervals_hold_the_truth(name: str, damage: Damage, first: int) -> None:
    plant, sea, inside = PLANT[name], SEA["gusts and waves"], []
    for seed in range(first, first + 5):
        tables = [damage(zigzags(plant, sea, [seed], side)[0], np.random.default_rng([seed, 7])) for side in (1, -1)]
        ratios = identify([run_from_columns("zigzag.csv", table) for table in tables], QUESTION).ratios
        assert ratios is not None
        truth = (plant.a, plant.b, plant.d, plant.e)
        inside += [
            abs(value - true) < 1.96 * error
            for value, true, error in zip(ratios.values, truth, ratios.errors, strict=True)
        ]
    # 95 % of 20; 16 or fewer by chance in one case of 400
    assert sum(inside) >= 16


def test_beside_waves_lasting_gusts_keep_their_doubt_about_the_rudders_zero() -> None:
    """White ones in their place would leave less than half of it, and a zero 4.5 standard errors off."""
    plant = PLANT["unstable"]
    ratios = identify(runs_of(plant, SEA["gusts and waves"], 3017), QUESTION).ratios
    assert ratios is not None
    assert abs(ratios.values[3] - plant.e) < 3.0 * ratios.errors[3]


@pytest.mark.parametrize("pushes", [False, True])
def test_whether_waves_push_the_boat_or_only_move_its_heading_is_what_the_record_says(pushes: bool) -> None:
    """Waves that push leave as much at the zigzag's slow frequency as gusts do; those that move the heading nothing."""
    gusts = Sea("gusts", gust_deg=0.5, wave_deg=2.0 if pushes else 0.0)
    runs = runs_of(PLANT["neutral"]._replace(seconds=120.0), gusts, 400)
    if not pushes:
        runs = [_moved(run, side) for side, run in enumerate(runs)]
    fit = identify(runs, QUESTION).likely
    assert fit is not None and fit.weather.wave > 0.0
    assert fit.weather.wave_pushes == pushes
    assert fit.weather.wave_frequency == pytest.approx(2.0 * math.pi / 5.0, rel=0.2)


def _moved(run: Run, seed: int) -> Run:
    """Return the run with waves of 5 s and 0.4 deg, rms, in its heading."""
    (segment,) = run.segments
    random, frequency = np.random.default_rng(seed), 2.0 * math.pi / 5.0
    moved, drives = wave_noise(Weather(1.0, 1.0, 1.0, 1.0, 1.0, 1.0, frequency), np.diff(segment.time))[0][:2]
    roots = np.linalg.cholesky(np.linalg.inv(drives.T.reshape(-1, 2, 2)))
    state, waves = random.normal(size=2) * [1.0, frequency], []
    for step, root in zip(moved.T.reshape(-1, 2, 2), roots, strict=True):
        waves.append(state[0])
        state = step @ state + root @ random.normal(size=2)
    heading = segment.heading + math.radians(0.4) * np.array([*waves, state[0]])
    return run._replace(segments=(segment._replace(heading=heading),))


@pytest.mark.parametrize("name", ["gain", "time_constant", "race"])
def test_intervals_of_gain_time_constant_and_race_are_those_of_their_inverses(name: str) -> None:
    low, high = interval_of(name, 10.0, 2.0)
    rate, error = 1.0 / 10.0, 2.0 / 10.0**2
    assert (1.0 / high, 1.0 / low) == pytest.approx((rate - 1.96 * error, rate + 1.96 * error))


def test_an_interval_says_what_is_not_known_of_the_sign() -> None:
    assert interval_of("time_constant", 10.0, 6.0)[1] == interval_of("gain", 10.0, 6.0)[1] == math.inf
    # a race that may be none
    assert interval_of("race", 10.0, 6.0) == pytest.approx((10.0 - 1.96 * 6.0, 10.0 + 1.96 * 6.0))
    assert interval_of("race", 0.0, 6.0) == pytest.approx((-1.96 * 6.0, 1.96 * 6.0))
    assert interval_of("n3", 10.0, 2.0) == pytest.approx((10.0 - 1.96 * 2.0, 10.0 + 1.96 * 2.0))


@pytest.mark.parametrize(
    ("error", "grade", "said"),
    [(0.1, "good", "T +- 5 %"), (0.5, "start", "T -20 %, +32 %"), (1.6, "not enough", "T -44 %, +363 %")],
)
def test_the_verdict_goes_by_the_longer_side(ridge: Identified, error: float, grade: str, said: str) -> None:
    known = {**ridge.standard_errors, "gain": 0.001, "time_constant": error}
    model = ridge.model._replace(gain=0.2, time_constant=4.0)
    found = ridge._replace(model=model, standard_errors=known, ratios=None, unidentifiable={})
    verdict = verdict_of(found)
    assert verdict.grade == grade and said in verdict.sentence


def test_a_fit_that_takes_too_little_of_the_gusts_into_its_doubt_is_not_called_good() -> None:
    runs = runs_of(PLANT["K 0.43, T 3.5"], SEA["gusts and waves"], 200)
    blind = identify(runs, QUESTION._replace(weighting="residuals"))
    assert blind.is_blind and not identify(runs, QUESTION).is_blind
    verdict = verdict_on_runs(blind, runs, math.inf)
    assert verdict.grade == "start" and "gusts" in verdict.sentence
    assert verdict_on_runs(blind._replace(is_blind=False), runs, math.inf).grade == "good"


def test_what_is_fitted_beside_makes_nothing_better_known() -> None:
    runs = runs_of(PLANT["K 0.43, T 3.5"], SEA["gusts and waves"], 200)[:1]
    likely = identify(runs, QUESTION)
    errors = {name: None if error is None else 0.1 * error for name, error in likely.standard_errors.items()}
    assert likely.covariance is not None
    more = likely._replace(standard_errors=errors, covariance=0.01 * likely.covariance, is_blind=True)
    found = at_least_as_doubtful(more, likely)
    assert not found.is_blind
    assert found.covariance is not None and found.covariance == pytest.approx(likely.covariance)
    assert found.standard_errors == pytest.approx(likely.standard_errors)
    # half of what was left is explained by what is fitted beside
    halved = more._replace(noise=(more.noise[0], more.noise[1]._replace(size=0.5 * more.noise[1].size)))
    half = at_least_as_doubtful(halved, likely).standard_errors["gain"]
    assert half == pytest.approx(0.5 * (likely.standard_errors["gain"] or 0.0))


def test_samples_too_far_apart_for_the_boat_are_not_enough() -> None:
    """A compass every second for a boat of T 0.33 s: the fit that takes gusts for noise called 22 of 24 such good, and
    20 of these were wrong."""
    table = zigzags(PLANT["Lanxin"], SEA["calm"], [300], 1)[0]
    run = run_from_columns("seldom.csv", {name: values[::10] for name, values in table.items()})
    found = identify([run], QUESTION)
    assert "half of the time between two samples" in found.unidentifiable["T"]
    assert verdict_of(found).grade == "not enough"


def test_a_boat_that_answers_between_two_samples_is_good_for_a_start_at_most() -> None:
    """T 0.33 s, a sample every 0.5 s. Of others with T 0.8 s once a second K came out 21 % too large, said 8 %."""
    table = zigzags(PLANT["Lanxin"], SEA["calm"], [300], 1)[0]
    run = run_from_columns("seldom.csv", {name: values[::5] for name, values in table.items()})
    found = identify([run], QUESTION)
    verdict = verdict_of(found)
    assert verdict.grade == "start" and "between two samples" in verdict.sentence, verdict
    assert verdict_of(found._replace(spacing=0.1)).grade == "good"


def test_where_stability_is_not_known_the_ratios_are_and_a_sentence_says_so(ridge: Identified) -> None:
    assert ridge.ratios is not None and ridge.ratios.on_ridge
    assert {"K", "T"} <= set(ridge.unidentifiable)
    assert "K/T 0.2" in ridge.unidentifiable["K"] and "n3/T" in ridge.unidentifiable["K"]
    verdict = verdict_of(ridge)
    assert verdict.grade == "start" and "course-stable" in verdict.sentence
    values, errors = ridge.ratios
    wide = ridge._replace(ratios=Ratios(values, (0.4 * values[0], *errors[1:])))
    assert verdict_of(wide).grade == "not enough", "K/T is what steering is designed from"
    document = document_of(Result("norrbin", ridge, None, []))
    assert document["parameters"]["K"]["value"] is None
    low, high = document["ratios"]["K/T"]["interval_95"]
    assert low < 0.2 < high
    assert as_text(Result("norrbin", ridge, None, [])).startswith("Good for a start (K/T ")


def test_a_file_of_either_stability_has_the_doubt_of_its_turning(ridge: Identified) -> None:
    assert ridge.ratios is not None and ridge.likely is not None
    (a, b, _, _), (a_error, b_error, _, _) = ridge.ratios
    model, errors = filed_model(ridge)
    assert model.time_constant == pytest.approx(1.0 / max(abs(b), b_error)), "no longer than the runs could tell"
    assert errors["time_constant"] is None and errors["gain"] is not None
    assert errors["gain"] / model.gain <= 1.01 * a_error / a, "K at this T is as well known as K/T"
    for rate in (b - 2.0 * b_error, b + 2.0 * b_error):
        end, _ = ridge_model(ridge.ratios, ridge.likely.covariance, SPEED_M_S, rate)
        assert end.n1 / end.time_constant == pytest.approx(rate)
        assert abs(end.gain / end.time_constant - a) <= 2.0 * a_error + 1.0e-9


@pytest.mark.parametrize("which", ["unstable", "ridge"])
def test_a_file_that_is_written_can_be_designed_for(
    which: str, tmp_path: Path, unstable: Identified, ridge: Identified
) -> None:
    found = unstable if which == "unstable" else ridge
    run = runs_of(PLANT["unstable"], SEA["calm"], 100)[0]
    path = tmp_path / "boat.yaml"
    result = Result("norrbin", found, None, [(run, "fit", found.predict(run))], rudder_rate=rudder_rate_of([run]))
    try:
        write_vessel(str(path), result, None, Given(end_stop_deg=35.0))
    except InputError as refused:
        assert "is not written" in str(refused) and not path.exists()
        return
    assert load_vessel(path).model.n1 in (-1.0, 1.0)
    assert main(["gains", str(path), "--json"]) == 0


def test_a_model_nobody_can_steer_by_is_not_written(tmp_path: Path, unstable: Identified) -> None:
    run = runs_of(PLANT["unstable"], SEA["calm"], 100)[0]
    wild = unstable._replace(
        model=unstable.model._replace(gain=0.01, time_constant=0.05, n3=1.0e-3), ratios=None, unidentifiable={}
    )
    path = tmp_path / "boat.yaml"
    with pytest.raises(InputError, match="is not written"):
        write_vessel(
            str(path), Result("norrbin", wild, None, [(run, "fit", wild.predict(run))]), None, Given(None, 35.0)
        )
    assert not path.exists()


@pytest.mark.parametrize("origin", ["ordered", "measured"])
def test_a_boat_that_follows_the_recorded_rudder_late_is_found_with_its_delay(
    origin: Literal["ordered", "measured"],
) -> None:
    late = [
        run._replace(rudder=origin, segments=tuple(s._replace(rudder=_ahead(s, 0.3)) for s in run.segments))
        for run in runs_of(PLANT["K 0.43, T 3.5"], SEA["calm"], 102)
    ]
    found = identify(late, QUESTION)
    assert found.train.delay + found.train.lag == pytest.approx(0.3, abs=0.05)
    assert found.model.gain == pytest.approx(0.43, rel=0.03)
    assert found.model.time_constant == pytest.approx(3.5, rel=0.03)
    # a servo is late by nature; of a measured rudder it is said
    assert any("late" in note for note in found.notes) == (origin == "measured")


@pytest.mark.parametrize("late", [2, 4])
@pytest.mark.parametrize("sea", ["calm", "gusts, noise, gyro"])
def test_late_compass_and_gyro_are_no_play_and_no_stop(sea: str, late: int) -> None:
    runs = []
    for side in (1, -1):
        table = zigzags(PLANT["Lanxin"], SEA[sea]._replace(gyro_deg_s=0.1), [2026112970], side)[0]
        for name in ("heading_rad", "yaw_rate_rad_s"):
            table[name] = np.concatenate([np.full(late, table[name][0]), table[name][:-late]])
        runs.append(run_from_columns(f"{side:+d}.csv", table))
    found = identify(runs, QUESTION)
    assert found.train.delay == pytest.approx(0.1 * late, abs=0.03)
    # taken for play or a stop, T was 0.46 to 1.9 s
    assert found.model.time_constant == pytest.approx(0.332, rel=0.15)
    assert found.likely is not None and found.train.dead_band == 0.0 and not found.likely.unseen.stops


@pytest.mark.parametrize(("which", "late"), [("heading_rad", 3), ("yaw_rate_rad_s", 2), ("heading_rad", 0)])
def test_a_compass_and_a_gyro_of_other_times_are_brought_together(which: str, late: int) -> None:
    sea = SEA["gusts, noise, gyro"]
    tables = [zigzags(PLANT["K 0.43, T 3.5"], sea, [2026112971], side)[0] for side in (1, -1)]
    prompt = identify([run_from_columns("prompt.csv", table) for table in tables], QUESTION)
    for table in tables:
        table[which] = np.concatenate([np.full(late, table[which][0]), table[which][: table[which].size - late]])
    runs = [in_time(run_from_columns("late.csv", table)) for table in tables]
    by = 0.1 * late if which == "heading_rad" else -0.1 * late
    for run in runs:
        assert run.compass_late == pytest.approx(by, abs=0.02)
        assert len(run.notes) == (late > 0)
    found = identify(runs, QUESTION)
    # untouched, K was 0.51 to 0.56 with a standard error of 0.017
    for name in ("gain", "time_constant"):
        off = getattr(found.model, name) - getattr(prompt.model, name)
        assert abs(off) < (prompt.standard_errors[name] or 0.0)
    assert found.train.delay == pytest.approx(max(-by, 0.0), abs=0.05)


@pytest.mark.parametrize(
    "damage",
    [whole, lost(0.2, 0.0), lost(0.2, 2.0), blank(0.8, ("heading_rad",), 0.0)],
    ids=["whole", "a fifth of the rows lost", "a fifth lost, 2 s at a time", "a heading in five"],
)
@pytest.mark.parametrize("which", ["heading_rad", "yaw_rate_rad_s"])
def test_how_late_an_instrument_is_shows_in_spite_of_lost_rows(which: str, damage: Damage) -> None:
    sea, side = SEA["gusts and waves"]._replace(gyro_deg_s=0.1), 1 if which == "heading_rad" else -1
    for seed, table in enumerate(zigzags(PLANT["K 0.43, T 3.5"], sea, list(range(2026113095, 2026113100)), 1)):
        for rows in (0, 1, 3, 5):
            values = np.concatenate([np.full(rows, table[which][0]), table[which][: table[which].size - rows]])
            damaged = damage({**table, which: values}, np.random.default_rng(seed))
            late = compass_late(run_from_columns("late.csv", damaged).segments)
            if rows == 0:
                assert late is None
            else:
                # half of a sample
                assert late is not None and late.by == pytest.approx(side * 0.1 * rows, abs=0.05)


def test_a_late_compass_of_a_log_is_in_the_new_vessel_file(tmp_path: Path) -> None:
    table = zigzags(PLANT["K 0.43, T 3.5"], SEA["calm"]._replace(gyro_deg_s=0.1), [2026112972], 1)[0]
    table["heading_rad"] = np.concatenate([np.full(3, table["heading_rad"][0]), table["heading_rad"][:-3]])
    log, boat = tmp_path / "late.csv", tmp_path / "boat.yaml"
    rows = "\n".join(",".join(f"{value:.9g}" for value in row) for row in zip(*table.values(), strict=True))
    log.write_text(f"{','.join(table)}\n{rows}\n")
    assert main(["identify", str(log), "--out", str(boat), "--rudder-max-deg", "35"]) == 0
    assert load_vessel(boat).sensors.heading_latency_s == pytest.approx(0.3, abs=0.02)


def test_a_delay_shorter_than_half_a_sample_is_not_taken_for_a_part_of_the_time_constant() -> None:
    late = [
        run._replace(rudder="ordered", segments=tuple(s._replace(rudder=_ahead(s, 0.04)) for s in run.segments))
        for run in runs_of(PLANT["Lanxin"], SEA["calm"]._replace(gyro_deg_s=0.1), 104)
    ]
    found = identify(late, QUESTION)
    # held at 0 it makes T 0.37 s
    assert found.train.delay + found.train.lag == pytest.approx(0.04, abs=0.02)
    assert found.model.time_constant == pytest.approx(0.332, rel=0.05)


def test_no_delay_is_found_of_a_rudder_that_was_measured_in_time() -> None:
    assert identify(runs_of(PLANT["K 0.43, T 3.5"], SEA["gusts and waves"], 102), QUESTION).train == DIRECT


def _ahead(segment: Segment, by: float) -> FloatArray:
    return np.interp(segment.time + by, segment.time, segment.rudder)


@pytest.mark.parametrize(("wave", "pushes"), [(0.0, False), (0.01, False), (0.01, True)])
def test_the_loss_is_that_of_a_kalman_filter(wave: float, pushes: bool) -> None:
    """Of a linear boat the likelihood is the product of a Kalman filter's innovations, reckoned here one by one."""
    run = runs_of(Plant("linear", 0.1, 0.3, 0.0, 0.0, 15.0, 12.0), Sea("calm", gyro_deg_s=0.1), 7)[0]
    record = record_of(run.segments, SPEED_M_S, 1.0)
    rudder, start = rudder_on(record), begin_path(record)

    def filtered(b: float, weather: Weather) -> float:
        h, N = float(record.step[0]), record.nodes
        m = math.exp(-b * h)
        keep = math.exp(-h / weather.gust_time)
        s = (1.0 - m) / b
        A = np.eye(5)
        A[:3, :3] = [[1.0, s, (h - s) / b], [0.0, m, s], [0.0, 0.0, keep]]
        q, W = weather.white**2, weather.wave_frequency
        A[3:, 3:] = expm(np.array([[0.0, 1.0], [-W * W, -2.0 * weather.wave_damping * W]]) * h)
        Q = np.diag([0.0, 0.0, weather.gust**2 * (1.0 - keep**2), 0.0, 0.0])
        Q[:2, :2] = q * np.array([[h**3 / 3.0, h**2 / 2.0], [h**2 / 2.0, h]])
        still = np.diag([1.0, W * W]) * (weather.wave * (W * W if pushes else 1.0)) ** 2
        Q[3:, 3:] = still - A[3:, 3:] @ still @ A[3:, 3:].T
        x, P, total = np.zeros(5), np.diag([1.0e6, 1.0e6, weather.gust**2, *np.diag(still)]), 0.0
        R = np.diag([weather.compass**2, weather.gyro**2])
        H = np.eye(5)[:2]
        if pushes:
            A[:2, 3] = A[:2, 2]
        else:
            H[:, 3:] = np.eye(2)
        for k in range(N):
            S = H @ P @ H.T + R
            e = np.array([record.heading[k], record.rate[k]]) - H @ x
            total += 0.5 * float(e @ np.linalg.solve(S, e)) + 0.5 * float(np.linalg.slogdet(S)[1])
            gain = P @ H.T @ np.linalg.inv(S)
            x, P = x + gain @ e, (np.eye(5) - gain @ H) @ P
            if k < N - 1:
                drive = 0.1 * float(rudder[0][:, k].mean())
                x = A @ x + drive * np.array([(h - s) / b, s, 0.0, 0.0, 0.0])
                P = A @ P @ A.T + Q
        return total

    start = start if wave == 0.0 else np.append(start, np.zeros((record.nodes, 2)), axis=1)
    one = Weather(0.01, 4.0, 0.003, math.radians(0.1), math.radians(0.3), wave, 1.2, 0.12, pushes)
    other = one._replace(gust=0.02, white=0.002, compass=math.radians(0.4), wave=2.0 * wave, wave_frequency=1.5)
    ours = [best_path(Rates(0.1, b), weather, record, rudder, start).loss for b, weather in ((0.3, one), (0.4, other))]
    theirs = [filtered(b, weather) for b, weather in ((0.3, one), (0.4, other))]
    assert ours[1] - ours[0] == pytest.approx(theirs[1] - theirs[0], abs=0.3)
    assert abs(theirs[1] - theirs[0]) > 10.0


@pytest.mark.parametrize(("wave", "pushes"), [(0.0, False), (0.01, False), (0.01, True)])
def test_the_slope_of_the_loss_is_that_of_its_differences(wave: float, pushes: bool) -> None:
    """Of a boat with cubic damping too, where the curvature changes with the path."""
    plant = PLANT["unstable"]
    run = runs_of(plant, SEA["gusts, noise, gyro"], 8)[0]
    guess = Rates(1.05 * plant.a, 0.9 * plant.b, 1.1 * plant.d, plant.e)
    record = record_of(run.segments, SPEED_M_S, memory_of(guess, run.segments))
    weather = Weather(0.5 * plant.a, 5.0, 0.1 * plant.a, 0.002, 0.006, wave, 1.2, 0.12, pushes)
    train = RudderTrain(delay=0.15, lag=0.15)
    space = Space(record, guess, weather, train, ("delay", "lag"), scales(run.segments, guess))
    space.keep(space.start)
    z, path = space.start, space.path
    slope = space.slope(z)[1]
    for i in range(z.size):
        by = 1.0e-4 if i < 4 else 1.0e-3
        losses = []
        for sign in (1.0, -1.0):
            at = z.copy()
            at[i] += sign * by
            space.path = path
            losses.append(space.found(at).loss)
        assert slope[i] == pytest.approx((losses[0] - losses[1]) / (2.0 * by), rel=2.0e-3, abs=0.02), space.names[i]


@pytest.mark.parametrize("power", [3, 2])
def test_the_slope_of_a_calm_is_right_to_a_thousandth_of_a_standard_error(
    power: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of a boat that is quick beside the nodes, and known so well that rounding counts."""
    plant = PLANT["Lanxin"]
    segments = [segment for run in runs_of(plant, SEA["calm"], 10) for segment in run.segments]
    guess = Rates(plant.a, plant.b, plant.d * 0.2 ** (3 - power), plant.e)
    monkeypatch.setattr("autopilot.identification.likelihood_record.MOST_NODES", 100)
    record = record_of(segments, SPEED_M_S, memory_of(guess, segments, power), Form(power=power))
    assert record.substeps > 4
    weather = Weather(1.0e-5 * plant.a, 5.0, 1.0e-5 * plant.a, 1.0, math.radians(0.3))
    space = Space(record, guess, weather, DIRECT, (), scales(segments, guess, power))
    space.keep(space.start)
    z, path = space.start, space.path
    _, slope, known = space.slope(z)
    error = np.diag(known) ** -0.5
    for i in range(4):
        losses = []
        for sign in (1.0, -1.0):
            at = z.copy()
            at[i] += sign * 0.03 * error[i]
            space.path = path
            losses.append(space.found(at).loss)
        differences = (losses[0] - losses[1]) / 0.06
        assert slope[i] * error[i] == pytest.approx(differences, rel=1.0e-3, abs=1.0e-3), space.names[i]


def space_in_waves() -> Space:
    """Return where a boat in gusts and waves is searched for, beginning at the truth."""
    plant = PLANT["Lanxin"]
    segments = [segment for run in runs_of(plant, SEA["gusts and waves"], 31) for segment in run.segments]
    truth = Rates(plant.a, plant.b, plant.d, plant.e)
    record = record_of(segments, SPEED_M_S, memory_of(truth, segments))
    weather = Weather(0.02 * plant.a, 5.0, 1.0e-3 * plant.a, 1.0, math.radians(0.3), 0.01, 1.2, 0.1)
    return Space(record, truth, weather, DIRECT, (), scales(segments, truth))


def test_a_boat_that_changed_places_with_its_rudders_lag_is_found() -> None:
    """Two lags in a row answer a rudder alike in either order; a sea not yet known leads a search to either."""
    plant, sea = PLANT["K 0.43, T 3.5"], SEA["gusts and waves"]
    run = runs_of(plant, sea, 2026112963)[0]
    truth = Rates(plant.a, plant.b, plant.d, plant.e)
    record, parts = record_of(run.segments, SPEED_M_S, memory_of(truth, run.segments)), ("delay", "lag")
    push = plant.a * math.radians(1.0)
    weather, scale = (
        Weather(push, 5.0, 1.0e-3 * push, 1.0e-3, 0.005, push, 1.26, 0.1, True),
        scales(run.segments, truth),
    )
    wrong = Rates(*(7.0 * rate for rate in truth))
    space = Space(record, wrong, weather, RudderTrain(delay=0.1, lag=3.0), parts, scale)
    exchanged, loss = approached(space, space.start)
    assert space.opened(exchanged)[2].lag > 1.0  # the search alone stays there
    (other, best, less), *_ = likelihood_fit_module._with_own_lags([(space, exchanged)])
    rates, _, train = other.opened(best)
    assert less < loss and train.lag < 1.0 and 1.0 / rates.b == pytest.approx(3.5, rel=0.5)


def test_boats_of_other_time_constants_are_compared_alike_in_time() -> None:
    """A boat n times as quick has n^4 times the room in a, b, d and e for the same doubt of K, T, n3 and n0."""
    slow, quick = (Known(np.full(4, rate), np.eye(4), 1.0, math.log(rate**4)) for rate in (0.1, 2.0))
    same, other = likelihood_fit_module._alike_in_time([slow, quick])
    assert same.evidence == pytest.approx(other.evidence)


def test_the_search_ends_at_one_place_from_wherever_it_begins() -> None:
    space = space_in_waves()
    begin = space.path
    end, loss, _ = settled(space, *approached(space, space.start))
    errors = np.sqrt(np.diag(np.linalg.inv(space.slope(end, whole=True)[2])))
    start = space.start.copy()
    start[:2] *= 1.5
    start[4:] += np.where(np.arange(start.size - 4) % 2, 0.7, -0.7)
    space.path = begin
    other, its_loss, _ = settled(space, *approached(space, start))
    assert its_loss == pytest.approx(loss, abs=1.0e-5)
    assert np.max(np.abs(other - end) / errors) < 3.0e-3


def test_a_fit_in_waves_does_not_follow_the_last_digits_of_the_rudder() -> None:
    (run, _), random = runs_of(PLANT["Lanxin"], SEA["gusts and waves"], 31), np.random.default_rng(1)
    guess = Rates(*PLANT["Lanxin"][1:5])
    moved = tuple(
        segment._replace(rudder=segment.rudder * (1.0 + 1.0e-15 * random.normal(size=segment.rudder.size)))
        for segment in run.segments
    )
    found, beside = (likelihood_fit(segments, SPEED_M_S, guess) for segments in (run.segments, moved))
    assert found is not None and beside is not None
    errors = np.sqrt(np.diag(found.covariance))
    assert np.max(np.abs(np.array(beside.rates) - found.rates) / errors) < 2.0e-3
    assert np.sqrt(np.diag(beside.covariance)) == pytest.approx(errors, rel=5.0e-3)


def test_what_a_record_tells_of_the_weather_is_near_the_curvature_of_the_loss() -> None:
    space = space_in_waves()
    end, _, curvature = settled(space, *approached(space, space.start))
    known = space.slope(end, whole=True)[2]
    for i in space.sky:
        assert 0.4 < known[i, i] / curvature[i, i] < 2.5, space.names[i]
    assert np.all(np.linalg.eigvalsh(known) > 0.0)


def test_the_worth_of_a_late_or_clipped_rudder_is_that_of_a_boat_fitted_to_it() -> None:
    space = space_in_waves()
    end, loss, _ = settled(space, *approached(space, space.start))
    rates, weather, train = space.opened(end)
    short = space.record._replace(
        paths=tuple((time, np.clip(angle, -0.33, 0.33)) for time, angle in space.record.paths)
    )
    tried = [(space.record, train._replace(delay=0.03)), (space.record, train._replace(delay=0.1)), (short, train)]
    worths = space.worths_behind(end, [rudder_on(record, behind) for record, behind in tried])
    for (record, behind), worth in zip(tried, worths, strict=True):
        trial = Space(record, rates, weather, behind, (), space.scale)
        trial.priors, trial.path = space.priors, space.path
        z = trial.start.copy()
        for _ in range(4):
            there, slope, known = trial.slope(z, boat_only=True)
            z[:4] -= np.linalg.solve(known, slope[:4])
        assert loss - there == pytest.approx(worth, rel=0.1, abs=1.0)


def test_what_the_record_tells_of_the_boat_is_the_curvature_of_the_loss() -> None:
    plant = PLANT["unstable"]
    segments = [segment for run in runs_of(plant, SEA["calm"], 9) for segment in run.segments]
    truth = Rates(plant.a, plant.b, plant.d, plant.e)
    record = record_of(segments, SPEED_M_S, memory_of(truth, segments))
    weather = Weather(1.0e-3 * plant.a, 5.0, 1.0e-4 * plant.a, 1.0, math.radians(0.3))
    space = Space(record, truth, weather, DIRECT, (), scales(segments, truth))
    space.keep(space.start)
    z, path = space.start, space.path
    known = space.slope(z)[2]
    error = np.sqrt(np.diag(np.linalg.inv(known)))
    curvature = np.empty((4, 4))
    for i in range(4):
        slopes = []
        for sign in (1.0, -1.0):
            at = z.copy()
            at[i] += sign * 0.1 * error[i]
            space.path = path
            slopes.append(space.slope(at)[1][:4])
        curvature[i] = (slopes[0] - slopes[1]) / (0.2 * error[i])
    assert np.sqrt(np.diag(np.linalg.inv(curvature))) == pytest.approx(error, rel=0.05)


def test_kinds_of_weather_that_the_record_suits_alike_share_in_the_answer() -> None:
    one = Known(np.array([0.0]), np.array([[1.0]]), 1.0, -3.0)
    other = one._replace(mean=np.array([2.0]))
    both = mixed([one, other])
    assert both.mean == pytest.approx([1.0]) and both.covariance == pytest.approx(np.array([[2.0]]))
    assert mixed([one, other._replace(evidence=-30.0)]).mean == pytest.approx([0.0], abs=1.0e-9)


def test_a_normal_distribution_that_cannot_be_negative() -> None:
    random = np.random.default_rng(3)
    mean, covariance = np.array([1.0, 0.2]), np.array([[1.0, 0.6], [0.6, 0.8]])
    drawn = random.multivariate_normal(mean, covariance, 400_000)
    share = (drawn[:, 1] > 0.0).mean()
    drawn = drawn[drawn[:, 1] > 0.0]
    found, spread, log_share = truncated(mean, covariance, 1)
    assert math.exp(log_share) == pytest.approx(share, abs=0.003)
    assert found == pytest.approx(drawn.mean(axis=0), abs=0.01)
    assert spread == pytest.approx(np.cov(drawn.T), abs=0.01)


def test_the_noise_of_a_log_goes_and_its_changes_stay() -> None:
    time = np.arange(0.0, 120.0, 0.1)
    truth = 5.0 - 0.5 * (np.sin(time / 8.0) > 0.0) * np.sin(time / 8.0)
    seen = truth + 0.1 * np.random.default_rng(5).normal(size=time.size)
    off = without_noise(seen) - truth
    assert np.sqrt(np.mean(off**2)) < 0.05


@pytest.mark.parametrize("size", [1.0e-2, 1.0e-60])
@pytest.mark.parametrize("frequency", [1.0e-5, 0.99e-2, 1.01e-2, 0.05])
def test_waves_however_long_and_small_are_driven_by_white_noise(frequency: float, size: float) -> None:
    """In a short step what is new of heading and rate has the determinant (q h^2)^2 / 12, q = 4 z W^3 size^2."""
    h, z = np.full(3, 0.1), 0.1
    weather = Weather(0.01, 6.0, 1.0e-5, 1.0e-3, 1.0e-3, size, frequency, z)
    (_, inverse, _, _), log = wave_noise(weather, h)
    q = math.log(4.0 * z) + 3.0 * math.log(frequency) + 2.0 * math.log(size)
    short = 2.0 * q + 4.0 * math.log(0.1) - math.log(12.0) - 2.0 * z * frequency * 0.1
    assert log / 3.0 == pytest.approx(short, abs=1.0e-4)
    assert np.log(inverse[3]) == pytest.approx(math.log(4.0 / 0.1) - q, abs=0.01)


@pytest.mark.parametrize("seed", [739949000, 739949001])
def test_a_rate_that_was_smoothed_does_not_make_the_rudder_nothing_beside_waves(seed: int) -> None:
    """Means over some 1 s of a gyro's rates, and a compass that wanders by 5 deg: taken for exact, such rates made K/T
    a quarter of what it is, with an interval of 15 % of that to either side."""
    plant, random = PLANT["K 0.43, T 3.5"]._replace(seconds=100.0), np.random.default_rng(seed)
    table = zigzags(plant, Sea("gusts", gust_deg=1.0, gyro_deg_s=0.1), [seed], 1)[0]
    wander = [0.0]
    while len(wander) < table["time_s"].size:
        wander.append(math.exp(-0.01) * wander[-1] + math.radians(5.0 * 0.14) * random.normal())
    weights = np.exp(-0.5 * np.square(np.arange(-20, 21) / 5.0))

    def smooth(values: FloatArray) -> FloatArray:
        return np.convolve(np.pad(values, 20, mode="edge"), weights / weights.sum(), mode="valid")

    rate, heading = smooth(table["yaw_rate_rad_s"]), table["heading_rad"] + smooth(np.array(wander))
    run = run_from_columns("smoothed", {**table, "yaw_rate_rad_s": rate, "heading_rad": heading})
    found = identify([run], QUESTION)
    assert found.ratios is not None and found.ratios.values[0] == pytest.approx(plant.a, rel=0.1)
    assert (found.predict(run).yaw_rate_r2 or 0.0) > 0.95


@pytest.mark.parametrize("seed", [739949000, 739949001])
def test_the_noise_of_a_log_at_a_constant_speed_tells_of_no_power_of_it(seed: int) -> None:
    found = identify(runs_of(PLANT["K 0.43, T 3.5"], SEA["noisy rudder and log"], seed), QUESTION)
    assert found.likely is not None and found.likely.power is not None
    assert found.likely.power.mean == 0.0 and found.likely.power.deviation > 0.5


def test_a_turn_is_not_flattened_by_the_mean_over_a_node() -> None:
    """A swing of 21 s, of which means over 0.9 s leave 0.3 % less."""
    time = 0.1 * np.arange(1200)
    swing = 0.5 * np.sin(0.3 * time)
    segment = Segment(time, swing, np.gradient(swing, time), np.zeros(1200), np.full(1200, SPEED_M_S))
    record = record_of([segment], SPEED_M_S, 20.0)
    at = np.cumsum(np.append(time[: round(10.0 * record.step[0])].mean(), record.step))
    assert record.step[0] > 0.8
    assert record.heading[1:-1] == pytest.approx(0.5 * np.sin(0.3 * at)[1:-1], abs=1.0e-4)
    assert record.rate[1:-1] == pytest.approx(0.15 * np.cos(0.3 * at)[1:-1], abs=1.0e-4)


def test_beside_a_gap_no_mean_is_corrected_by_what_nobody_measured() -> None:
    """The straight line over a gap bends where the gap begins, the boat does not."""
    time = 0.1 * np.arange(1200)
    swing = 0.5 * np.sin(0.3 * time)
    rate = 0.15 * np.cos(0.3 * time)
    gone = (time > 20.0) & (time < 40.5)
    swing[gone] = rate[gone] = math.nan
    record = record_of([Segment(time, swing, rate, np.zeros(1200), np.full(1200, SPEED_M_S))], SPEED_M_S, 20.0)
    at = np.cumsum(np.append(time[: round(10.0 * record.step[0])].mean(), record.step))
    off = np.abs(record.heading - 0.5 * np.sin(0.3 * at))[record.heading_count > 0.0]
    off_rate = np.abs(record.rate - 0.15 * np.cos(0.3 * at))[record.rate_count > 0.0]
    # a mean flattens by no more than w^2 (n dt)^2/24
    most = (0.3 * 0.9) ** 2 / 24.0
    assert max(off.max() / 0.5, off_rate.max() / 0.15) < most


def test_a_propeller_astern_makes_no_race() -> None:
    around = RaceAndWind(race=1.0e-3, reference_propeller=10.0)
    ratio = np.array([1.0, 1.0])
    astern, stopped = inflow_ratio(around, 0.25, ratio, np.array([-12.0, 0.0]))
    assert astern == stopped


def test_a_rudder_without_its_noise_turns_the_boat_no_less() -> None:
    """White noise in what drives a boat draws its answer towards 0; the best estimate of it does not."""
    random, truth = np.random.default_rng(4), zigzags(PLANT["Lanxin"], SEA["calm"], [300], 1)[0]["rudder_rad"]
    for noise in np.radians([0.1, 0.3]):
        seen = truth + noise * random.normal(size=truth.size)
        slopes = [
            float(np.diff(driven) @ np.diff(truth)) / float(np.diff(driven) @ np.diff(driven))
            for driven in (seen, without_noise(seen))
        ]
        assert slopes[0] < 0.99 and slopes[1] == pytest.approx(1.0, abs=0.01)
    np.testing.assert_array_equal(without_noise(truth), truth)


def test_nodes_many_time_constants_apart_lead_to_the_boat(monkeypatch: pytest.MonkeyPatch) -> None:
    """A quick boat's log of ten hours: on steps of more than 2.8 of its time constants no motion is found at all."""
    plant = PLANT["Lanxin"]._replace(seconds=300.0)
    segments = [segment for run in runs_of(plant, SEA["calm"], 31) for segment in run.segments]
    monkeypatch.setattr(likelihood_record, "MOST_NODES", 60)
    truth = np.array([plant.a, plant.b, plant.d, plant.e])
    found = likelihood_fit(segments, SPEED_M_S, Rates(*(1.1 * truth)))
    assert found is not None
    assert (np.abs(np.array(found.rates) - truth) < 3.0 * np.sqrt(np.diag(found.covariance))).all()
