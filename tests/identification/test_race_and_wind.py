"""Propeller race and wind moment: recovered where the trials show them, named and left out where they do not."""

from __future__ import annotations

import math

import esso_crossvalidation
import numpy as np
import pytest
from slopes import check_slope
from surroundings_intervals import errors_of
from zigzag_trials import RECORDINGS

from autopilot.identification.identified import Question
from autopilot.identification.identify import identify
from autopilot.identification.likelihood_fit import memory_of, scales
from autopilot.identification.likelihood_record import NORRBIN, Surroundings, beside_of, blur_of, record_of
from autopilot.identification.likelihood_search import Space, approached
from autopilot.identification.marginal_likelihood import Rates, Weather
from autopilot.identification.model_choice import _least_shown, steering_errors, steering_model
from autopilot.identification.output_error import Solution
from autopilot.identification.residuals import Fitted, Noise
from autopilot.identification.rudder_path import DIRECT
from autopilot.identification.runs import FloatArray, Run, Segment, run_from_columns
from autopilot.models.norrbin import Norrbin
from autopilot.models.weather import RaceAndWind, inflow_ratio, without_drift

U0, N0, L2 = 0.25, 10.0, 8.0e-4
COLUMNS = ("time_s", "heading_rad", "yaw_rate_rad_s", "rudder_rad", "speed_m_s", "propeller_rps")


def trial(
    seed: int,
    propeller: float,
    race: float,
    wind: float,
    angle: float = 0.35,
    seconds: float = 150.0,
    slide: float = 0.0,
) -> Run:
    """A boat getting under way and zigzagging in a gusty wind, Euler steps of 10 ms written out from the forces.

    slide: how much the boat's sideways motion, which follows turn and wind within 8 s at U0, turns it further."""
    dt, random = 0.01, np.random.default_rng(seed)
    rate = heading = rudder = speed = sway = 0.0
    order, gust, rows = angle, 3.0, []
    for i, pushed in enumerate(random.normal(size=int(seconds / dt)).tolist()):
        gust += dt / 10.0 * (3.0 - gust) + math.sqrt(dt) * 0.3 * pushed
        off_bow = 2.0 - heading
        if i % 10 == 0:
            rows.append((i * dt, heading, rate, rudder, speed, propeller, abs(gust), off_bow % (2.0 * math.pi)))
        if heading * math.copysign(1.0, order) >= abs(angle) and speed > 0.1:
            order = -order
        rudder += min(max(order - rudder, -0.4 * dt), 0.4 * dt)
        # K/T = 0.01 1/s^2 and 1/T = 1/12 1/s at U0 and N0; the force on the rudder goes with the inflow squared, the
        # damping with the inflow
        inflow = max((speed**2 + race * propeller**2) / (U0**2 + race * N0**2), 0.0025)
        turning = 0.01 * inflow * rudder - (rate / 12.0) * inflow**0.5 - 20.0 * rate**3 / inflow**0.5
        blown = wind * (math.sin(off_bow) - 0.5 * math.sin(2.0 * off_bow)) * gust**2
        rate += dt * (turning + blown + slide * speed * sway)
        sway += dt * (-speed / U0 / 8.0 * sway + speed * rate + 2.0 * wind * gust**2 * math.sin(off_bow))
        heading += dt * rate
        speed += dt * 0.2 * (0.025 * propeller - speed - 3.0 * abs(rate))
    table = np.array(rows)
    table[:, 2] += 0.001 * random.standard_normal(len(table))
    names = (*COLUMNS, "wind_speed_m_s", "wind_direction_rad")
    return run_from_columns(f"trial {seed}", dict(zip(names, table.T, strict=True)))


def without(run: Run, *names: str) -> Run:
    nothing: FloatArray = np.empty(0)
    return run._replace(segments=tuple(s._replace(**dict.fromkeys(names, nothing)) for s in run.segments))


def test_race_and_wind_are_recovered_and_predict_another_trial() -> None:
    runs = [trial(seed, propeller, L2, 4.0e-4) for seed, propeller in enumerate((8.0, 12.0, 16.0))]
    found = identify(runs, Question(reference_speed=U0))
    assert found.around is not None and not found.around.drifts
    assert found.around.race == pytest.approx(L2, rel=0.25)
    assert found.around.wind_beam == pytest.approx(4.0e-4, rel=0.1)
    assert found.around.wind_quarter == pytest.approx(-2.0e-4, rel=0.15)
    still = U0**2 + L2 * found.around.reference_propeller**2
    assert found.model.gain / found.model.time_constant == pytest.approx(0.01 * still / (U0**2 + L2 * N0**2), rel=0.05)
    other = trial(9, 14.0, L2, 4.0e-4, angle=-0.25)
    score = found.predict(other).yaw_rate_r2
    assert score is not None and score > 0.95
    assert found.plain is not None
    alone = found.predict(without(other, "propeller", "beam_wind", "quarter_wind")).yaw_rate_r2
    assert alone is not None and alone < score


def test_the_slope_of_the_loss_by_race_and_wind_is_that_of_its_differences() -> None:
    """With gusts of their own strength in each run."""
    segments = [s for k, n in enumerate((8.0, 16.0)) for s in trial(k, n, L2, 4.0e-4, seconds=60.0).segments]
    guess = Rates(0.008, 0.07, 15.0, 1.0e-4)
    record = record_of(segments, U0, memory_of(guess, segments))._replace(blur=1.0e-8)
    scale = scales(segments, guess)
    start = RaceAndWind(6.0e-4, 12.0, 3.0e-4, -2.5e-4)
    beside = beside_of(
        record, segments, Surroundings(("race", "wind_beam", "wind_quarter"), start), U0, scale.e, NORRBIN
    )
    weather = Weather(5.0e-4, 6.0, 1.0e-4, 1.0e-3, 5.0e-3)
    space = Space(record, guess, weather, DIRECT, (), scale, beside, np.array([0, 1]))
    assert space.beside_at(space.start).start == pytest.approx(start)
    space.start[-2:] = -0.7, 0.4
    _, _, known = space.slope(space.start)
    assert known.shape == (7, 7)
    assert np.linalg.eigvalsh(known).min() > 0.0
    check_slope(space)


def test_each_runs_gusts_are_as_strong_as_they_were() -> None:
    """Two runs on the straight, pushed by gusts of which those of the second are four times as strong."""
    segments, random, dt, keep = [], np.random.default_rng(3), 0.5, math.exp(-0.5 / 6.0)
    for size in (2.0e-4, 8.0e-4):
        gust, rate, heading, rows = size * random.normal(), 0.0, 0.0, []
        for k in range(800):
            rows.append((k * dt, heading, rate, 0.02 * math.sin(0.1 * k), U0))
            gust = keep * gust + size * math.sqrt(1.0 - keep * keep) * random.normal()
            rate += dt * (0.01 * rows[-1][3] - rate / 12.0 + gust)
            heading += dt * rate
        table = np.array(rows)
        table[:, 1:3] += np.array([2.0e-3, 1.0e-3]) * random.normal(size=(800, 2))
        segments += run_from_columns("straight", dict(zip(COLUMNS[:5], table.T, strict=True))).segments
    truth = Rates(0.01, 1.0 / 12.0)
    record = record_of(segments, U0, 12.0)
    weather, scale = Weather(4.0e-4, 6.0, 1.0e-5, 1.0e-3, 2.0e-3), scales(segments, truth)
    space = Space(record, truth, weather, DIRECT, (), scale, None, np.array([0, 1]))
    best, _ = approached(space, space.start)
    sizes = space.opened(best)[1].gust * space.record_at(best).rough[record.first]
    assert sizes == pytest.approx([2.0e-4, 8.0e-4], rel=0.3)


def test_noise_left_in_rudder_and_wind_stands_as_a_push_of_known_size() -> None:
    """Of a rudder its noise, of a wind that walks what lies between two samples; nothing where all is exact."""
    time, random, dt = np.arange(3000) * 0.1, np.random.default_rng(4), 0.1
    rudder, walk = 0.3 * np.sign(np.sin(0.2 * time)), 9.0 + np.cumsum(0.2 * random.normal(size=time.size))
    noisy = rudder + math.radians(0.2) * random.normal(size=time.size)
    exact = Segment(time, 0.0 * time, 0.0 * time, rudder, np.full(time.size, U0))
    around = RaceAndWind(wind_beam=4.0e-4)
    assert blur_of([exact], 0.01, U0, NORRBIN, None) == 0.0
    by_rudder = blur_of([exact._replace(rudder=noisy)], 0.01, U0, NORRBIN, None)
    assert by_rudder == pytest.approx((0.01 * math.radians(0.2)) ** 2 * dt, rel=0.3)
    by_wind = blur_of([exact._replace(beam_wind=walk, quarter_wind=0.0 * walk)], 0.01, U0, NORRBIN, around)
    assert by_wind == pytest.approx((4.0e-4 * 0.2) ** 2 / 12.0 * dt, rel=0.3)


@pytest.mark.parametrize("seed", [1127, 1128, 1795829219])
def test_intervals_hold_the_boat_the_race_and_the_wind_in_gusts_that_nobody_recorded(seed: int) -> None:
    """The last looks by its residuals as if the boat drifted, which it does not."""
    errors = errors_of(seed, 1.0, 0.2)
    assert {"gain", "time_constant", "n3", "n0", "race", "wind_beam", "wind_quarter"} <= set(errors)
    assert max(abs(error) for error, _, _ in errors.values()) < 3.0


def test_what_is_not_there_is_not_found() -> None:
    runs = [trial(seed, propeller, 0.0, 0.0) for seed, propeller in enumerate((8.0, 12.0, 16.0))]
    found = identify(runs, Question(reference_speed=U0))
    if found.around is not None:
        # noise may leave a trace that is distinguished from zero, but never one that matters
        assert found.around.race * N0**2 < 0.1 * U0**2
        assert abs(found.around.wind_beam) < 2.0e-5
    else:
        assert {"race", "wind_beam"} & set(found.unidentifiable)


def test_without_columns_neither_propeller_nor_wind_counts() -> None:
    around = identify([without(trial(1, 12.0, L2, 4.0e-4), "propeller", "beam_wind", "quarter_wind")]).around
    assert around is None or around.race == around.wind_beam == around.wind_quarter == around.drift == 0.0


def test_the_inflow_is_one_at_the_reference() -> None:
    around = RaceAndWind(L2, N0)
    assert inflow_ratio(around, U0, np.array([1.0]), np.array([N0]))[0] == pytest.approx(1.0)
    bollard = inflow_ratio(around, U0, np.array([0.05]), np.array([N0]))[0]
    assert bollard**2 == pytest.approx((0.05**2 * U0**2 + L2 * N0**2) / (U0**2 + L2 * N0**2))
    assert inflow_ratio(RaceAndWind(), U0, np.array([0.4]), np.array([N0]))[0] == pytest.approx(0.4)


def test_drift_is_found_where_the_boat_slides_and_what_steers_is_what_it_comes_to() -> None:
    runs = [trial(seed, propeller, L2, 4.0e-4, slide=0.07) for seed, propeller in enumerate((8.0, 12.0, 16.0))]
    found = identify(runs, Question(reference_speed=U0))
    assert found.around is not None and found.around.drifts
    # at U0: x = T slide U0 sway, sway settles at 8 s U0 rate
    assert found.around.drift == pytest.approx(found.model.time_constant * U0 * 8.0 * U0 * 0.07, rel=0.3)
    assert found.around.drift_time == pytest.approx(8.0, rel=0.5)
    other = trial(9, 14.0, L2, 4.0e-4, angle=-0.25, slide=0.07)
    rigid = identify(runs, Question("nomoto", U0)).predict(other).yaw_rate_r2
    score = found.predict(other).yaw_rate_r2
    assert score is not None and rigid is not None and score > 0.97 > rigid
    steering, errors = steering_model(found), steering_errors(found)
    left = 1.0 - found.around.drift
    assert steering.gain == pytest.approx(found.model.gain / left)
    assert steering.time_constant > found.model.time_constant
    assert errors["gain"] is not None and 0.0 < errors["gain"] < 0.3 * steering.gain
    assert any(note.startswith("drift") for note in found.notes)


def test_the_model_without_drift_has_the_same_answer_to_a_slow_rudder() -> None:
    model, around = Norrbin(0.1, 7.0, reference_speed=U0), RaceAndWind(drift=0.4, drift_time=10.0)
    steering = without_drift(model, around)
    w = 1.0e-3j
    exact = model.gain * (1.0 + 10.0 * w) / ((1.0 + 7.0 * w) * (1.0 + 10.0 * w) - 0.4)
    assert steering.gain / (1.0 + steering.time_constant * w) == pytest.approx(exact, rel=1.0e-3)
    with pytest.raises(ValueError, match="course-unstable"):
        without_drift(model, around._replace(drift=1.0))


def test_a_race_of_revolutions_that_nobody_recorded_is_found() -> None:
    runs = [without(trial(seed, 10.0, L2, 0.0), "propeller", "beam_wind", "quarter_wind") for seed in range(3)]
    found = identify(runs, Question(reference_speed=U0))
    assert found.around is not None
    assert found.around.steady_race == pytest.approx(L2 * 10.0**2, rel=0.3)
    score = found.predict(without(trial(9, 10.0, L2, 0.0, -0.25), "propeller", "beam_wind", "quarter_wind")).yaw_rate_r2
    assert score is not None and score > 0.97


def test_a_race_that_ends_at_nothing_does_not_stand_by_the_cubic_damping_beside_it() -> None:
    # way lost in turns takes more from this rudder than its square: a race would have to be less than none
    runs = [without(trial(seed, 10.0, -0.3 * L2, 0.0), "propeller", "beam_wind", "quarter_wind") for seed in range(3)]
    found = identify(runs, Question(reference_speed=U0))
    assert found.around is None
    assert found.unidentifiable["steady_race"].startswith("steady_race: ")


@pytest.mark.parametrize(
    ("at_bound", "weakest"),
    [((), ""), (("steady_race",), "steady_race"), (("n3",), "n3"), (("steady_race", "n3"), "n3")],
)
def test_what_ended_at_its_bound_is_least_shown_whatever_stands_beside_it(
    at_bound: tuple[str, ...], weakest: str
) -> None:
    model, around = Norrbin(0.12, 12.0, 240.0), RaceAndWind(race=0.0, reference_propeller=0.0, steady_race=0.08)
    free = ("n3", "steady_race")
    found = Solution(
        Fitted(model, around), free, np.diag([1.0, 1.0e-4]), (Noise(0.01, 0.0), Noise(0.01, 0.0)), at_bound
    )
    assert _least_shown(found, free) == weakest


@pytest.mark.skipif(not (RECORDINGS / "frt_ds_esso").is_dir(), reason="the recordings are not part of the project")
@pytest.mark.parametrize(("left_out", "least"), [("turn_14-Sep", 0.94), ("13_50_28", 0.93)])
def test_on_a_real_ship_propeller_and_wind_predict_what_was_not_fitted(left_out: str, least: float) -> None:
    """A turn from all other runs; without propeller and wind R2 is 0.87 to 0.94 there."""
    from autopilot.logs.reading import load_run

    paths = sorted((RECORDINGS / "frt_ds_esso").glob("*.csv"))
    unseen = next(path for path in paths if left_out in path.name)
    found = identify([load_run(str(path), esso_crossvalidation.WITH_WIND) for path in paths if path != unseen])
    assert found.around is not None and found.around.race > 0.0 and found.model.n3 > 0.0
    assert found.around.drifts
    score = found.predict(load_run(str(unseen), esso_crossvalidation.WITH_WIND)).yaw_rate_r2
    assert score is not None and score > least


@pytest.mark.skipif(not (RECORDINGS / "frt_ds_esso").is_dir(), reason="the recordings are not part of the project")
def test_one_zigzag_of_a_real_ship_whose_rates_were_smoothed_is_a_boats() -> None:
    from autopilot.logs.reading import load_run

    run = load_run(str(next((RECORDINGS / "frt_ds_esso").glob("zigzag*13_50_28.csv"))), esso_crossvalidation.COLUMNS)
    found = identify([run])
    assert found.ratios is not None and found.ratios.values[0] > 10.0 * found.ratios.errors[0]
    assert (found.predict(run).yaw_rate_r2 or 0.0) > 0.93
