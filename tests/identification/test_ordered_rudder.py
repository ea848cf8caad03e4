"""A rudder known by its orders alone: its rate as the boat's turning shows it, and none where it is merely late."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pytest
from boat_recordings import zigzag_boat
from identification_intervals import FULL_RAD, PLANTS, SEAS, reported
from independent_boat import SPEED_M_S, zigzags

import autopilot
from autopilot.errors import InputError
from autopilot.identification import likelihood_fit
from autopilot.identification.identified import Identified, Question, Ratios
from autopilot.identification.identify import identify
from autopilot.identification.likelihood_model import doubt_of_change
from autopilot.identification.marginal_likelihood import Rates, Weather
from autopilot.identification.ordered_rudder import (
    identified_behind,
    rate_limited,
    slower_rudder,
    with_doubt_of_rate,
    with_rate,
    with_rudder_of,
    with_unsure_rate,
)
from autopilot.identification.residuals import Noise
from autopilot.identification.rudder_path import RudderRate, RudderTrain
from autopilot.identification.runs import MOMENTS, Run, Segment
from autopilot.identification.verdict import verdict_of
from autopilot.logs.series import HEADING, SHARE, SPEED, Recording, Series
from autopilot.logs.table import RudderSettings, table_of, through_gear
from autopilot.models.norrbin import Norrbin
from autopilot.models.steering_gear import SteeringGear

FILED = math.radians(20.0)


def ordered(
    rate_deg_s: float, late: float = 0.0, lag: float = 0.0, noise_deg: float = 0.0, gyro: bool = True, seed: int = 1
) -> Run:
    """Return a zigzag as a log has it: orders through a gear of the filed rate, ten a second."""
    boat = zigzag_boat(seconds=120.0, rudder_rate=math.radians(rate_deg_s))
    random, dt = np.random.default_rng(seed), 0.02
    heading, rate = boat.heading, boat.rate
    if late > 0.0 or lag > 0.0:
        seen = boat.time - late
        heading, rate = np.interp(seen, boat.time, heading), np.interp(seen, boat.time, rate)
        share, lagging = -math.expm1(-dt / lag) if lag > 0.0 else 1.0, np.empty_like(rate)
        slow = 0.0
        for index, value in enumerate(rate):
            slow += share * (value - slow)
            lagging[index] = slow
        heading, rate = heading[0] + np.cumsum(lagging) * dt, lagging
    rudder = rate_limited(boat.time, boat.order, FILED)
    heading = heading + math.radians(noise_deg) * random.standard_normal(heading.size)
    rate = rate + math.radians(noise_deg) * random.standard_normal(rate.size)
    if not gyro:
        rate = np.full_like(rate, math.nan)
    rows = slice(None, None, 5)
    columns = (boat.time, heading, rate, rudder, boat.speed)
    return Run("zigzag", (Segment(*(each[rows] for each in columns)),), rudder="ordered")


@pytest.mark.parametrize(
    ("rate_deg_s", "noise_deg", "gyro"),
    [(2.3, 0.0, True), (10.0, 0.0, True), (2.3, 0.2, True), (10.0, 0.2, True), (2.3, 0.2, False), (5.0, 0.2, False)],
)
def test_a_rudder_slower_than_filed_is_found_by_how_the_boat_turns(
    rate_deg_s: float, noise_deg: float, gyro: bool
) -> None:
    found = slower_rudder([ordered(rate_deg_s, noise_deg=noise_deg, gyro=gyro)], FILED)
    assert found is not None
    off = abs(math.degrees(found.rate) - rate_deg_s)
    assert off < max(0.05 * rate_deg_s, 3.0 * math.degrees(found.standard_error))
    assert off < 0.2 * rate_deg_s


@pytest.mark.parametrize(("late", "lag"), [(0.0, 0.0), (0.3, 0.0), (0.0, 0.4), (0.2, 0.3)])
@pytest.mark.parametrize("noise_deg", [0.05])
def test_a_rudder_that_is_merely_late_is_not_called_slow(late: float, lag: float, noise_deg: float) -> None:
    found = slower_rudder([ordered(20.0, late, lag, noise_deg)], FILED)
    assert found is None or not found.is_sure


@pytest.mark.parametrize("rate_deg_s", [2.3, 10.0])
def test_the_rate_shows_in_stretches_that_begin_in_turns(rate_deg_s: float) -> None:
    """Nobody knows how the boat turned before a gap ended: taken to turn as its rudder stood, it showed no rate."""
    run = ordered(rate_deg_s, noise_deg=0.2, seed=2026112961)
    whole = run.segments[0]
    kept = [(whole.time >= first) & (whole.time < last) for first, last in ((0.0, 38.0), (42.0, 75.0), (76.5, 120.0))]
    segments = tuple(Segment(*(each[rows] if each.size else each for each in whole)) for rows in kept)
    found = slower_rudder([run._replace(segments=segments)], FILED)
    assert found is not None
    off = abs(math.degrees(found.rate) - rate_deg_s)
    assert off < 3.0 * math.degrees(found.standard_error) and off < 0.2 * rate_deg_s


@pytest.mark.parametrize("rate_deg_s", [5.0, 10.0])
def test_a_rudder_that_moved_when_a_gap_ended_is_as_slow(rate_deg_s: float) -> None:
    """Taken to stand where it was ordered, it seemed quicker."""
    run = ordered(rate_deg_s, noise_deg=0.1, seed=2026112971)
    whole = run.segments[0]
    there = np.flatnonzero(np.diff(np.sign(whole.rudder)) != 0)[[1, 3]]
    ends = [float(whole.time[at]) + 1.2 for at in there]
    kept = [(0.0, ends[0] - 4.0), (ends[0], ends[1] - 4.0), (ends[1], 120.0)]
    rows = [(whole.time >= first) & (whole.time < last) for first, last in kept]
    segments = tuple(Segment(*(each[here] if each.size else each for each in whole)) for here in rows)
    found = slower_rudder([run._replace(segments=segments)], FILED)
    assert found is not None and found.is_sure
    off = abs(math.degrees(found.rate) - rate_deg_s)
    assert off < 3.0 * math.degrees(found.standard_error) and off < 0.1 * rate_deg_s


@pytest.mark.parametrize("late", [0.05, 0.15, 0.25, 0.3])
def test_a_lateness_between_those_tried_is_no_part_of_the_rate(late: float) -> None:
    found = slower_rudder([ordered(5.0, late, noise_deg=0.1, seed=2026112962)], FILED)
    assert found is not None
    assert abs(math.degrees(found.rate) - 5.0) < max(0.05 * 5.0, 3.0 * math.degrees(found.standard_error))
    assert abs(math.degrees(found.rate) - 5.0) < 0.5


def test_the_rudder_of_a_run_goes_no_faster_than_found_and_comes_where_it_was_ordered() -> None:
    run = ordered(5.0)
    found = slower_rudder([run], FILED)
    assert found is not None
    segment = with_rudder_of(run, found).segments[0]
    slew = np.diff(segment.rudder) / np.diff(segment.time)
    assert np.max(np.abs(slew)) <= found.rate * (1.0 + 1.0e-9)
    assert np.max(segment.rudder) == pytest.approx(np.max(run.segments[0].rudder))


def test_each_rate_that_is_tried_is_progress() -> None:
    shown = list[tuple[int, int]]()
    slower_rudder([ordered(5.0)], FILED, progress=lambda done, total: shown.append((done, total)))
    done, totals = zip(*shown, strict=True)
    assert list(done) == list(range(totals[0] + 1)) and set(totals) == {totals[0]}


def test_orders_that_never_move_show_no_rate() -> None:
    run = ordered(5.0)
    still = run.segments[0]._replace(rudder=np.zeros_like(run.segments[0].rudder))
    assert slower_rudder([run._replace(segments=(still,))], FILED) is None


def test_the_doubt_about_a_rate_that_turning_shows_is_in_gain_and_time_constant() -> None:
    """Intervals of 95 % hold nine of ten; fewer by chance in one case of twelve."""
    inside, question = [], Question(reference_speed=3.0)
    for seed in (2026112760, *range(20261128, 20261132)):
        run = ordered(5.0, noise_deg=0.2, seed=seed)
        rate = slower_rudder([run], FILED)
        assert rate is not None
        first = identify([with_rudder_of(run, rate)], question)
        found = with_doubt_of_rate(first, [run], rate, lambda runs: identify(runs, question))
        assert found.rudder_rate is not None
        held = identify([with_rudder_of(run, found.rudder_rate)], question)
        assert found.model == held.model
        for name, truth in (("gain", 0.2), ("time_constant", 5.0)):
            error, before = found.standard_errors[name], held.standard_errors[name]
            assert error is not None and before is not None and error > before
            inside.append(abs(getattr(found.model, name) - truth) < 1.96 * error)
        assert found.covariance is not None
        assert math.sqrt(found.covariance[1, 1]) == pytest.approx(found.standard_errors["time_constant"])
        assert found.ratios is not None and held.ratios is not None
        ratios = zip(found.ratios.errors[:2], held.ratios.errors[:2], strict=True)
        assert all(after > before for after, before in ratios)
    assert sum(inside) >= 9


@pytest.mark.parametrize("seed", [1795900407, 1796000004])
def test_a_boat_is_no_likelier_for_waves_that_are_looked_for_elsewhere(
    seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What weather without waves is likeliest in a calm is chance: the waves that are tried must not go by it alone."""
    run, question = ordered(5.0, noise_deg=0.2, seed=seed), Question(reference_speed=3.0)
    rate = slower_rudder([run], FILED)
    assert rate is not None
    losses = []
    for frequency in (None, 0.36, 0.52):
        if frequency is not None:
            shown = {"wave": math.radians(0.02), "wave_frequency": frequency, "wave_damping": 0.1}
            monkeypatch.setattr(likelihood_fit, "_wave_start", lambda space, z, weather: weather._replace(**shown))  # noqa: B023
        likely = identify([with_rudder_of(run, rate)], question).likely
        assert likely is not None
        losses.append(likely.loss)
    assert losses[0] < min(losses[1:]) + 0.1


RATE = RudderRate(math.radians(5.0), math.radians(0.2), 6, True)


@pytest.mark.parametrize("begun_deg_s", [4.6, 5.4])
def test_a_rate_that_is_off_ends_where_the_fit_is_likeliest(begun_deg_s: float) -> None:
    run, question = ordered(5.0, noise_deg=0.2, seed=2026112964), Question(reference_speed=3.0)
    begun = RATE._replace(rate=math.radians(begun_deg_s))
    held = identify([with_rudder_of(run, begun)], question)
    found = with_doubt_of_rate(held, [run], begun, lambda runs: identify(runs, question))
    assert found.rudder_rate is not None
    rate, error = (math.degrees(each) for each in found.rudder_rate[:2])
    assert abs(rate - 5.0) < 3.0 * error < 0.5
    T_error = found.standard_errors["time_constant"]
    assert T_error is not None and abs(found.model.time_constant - 5.0) < 3.0 * T_error


def fitted(time_constant: float, error: float = 0.03, b_error: float = 0.001) -> Identified:
    """Return a fit of K 0.2 1/s and that T."""
    ratios = Ratios((0.2 / time_constant, 1.0 / time_constant, 1.0, 0.0), (0.001, b_error, 0.1, 0.001))
    errors = {"gain": 0.001, "time_constant": error, "n3": 0.5, "n0": None, "delay": None}
    noise = (Noise(0.0, 0.0), Noise(0.0, 0.0))
    model = Norrbin(0.2, time_constant, 5.0)
    names, covariance = ("gain", "time_constant"), np.diag([0.001**2, error**2])
    return Identified(model, errors, {}, noise, free=names, covariance=covariance, ratios=ratios)


def by_rate(run: Run, time_constant: float, slope: float) -> Identified:
    """Return a fit whose T [s] goes with the rate [deg/s] of the rudder."""
    rate = float(np.max(np.abs(np.diff(run.segments[0].rudder) / np.diff(run.segments[0].time))))
    return fitted(time_constant + slope * (math.degrees(rate) - 5.0))


def test_covariances_add_as_far_as_the_fit_goes_with_the_rate() -> None:
    run = ordered(5.0)
    found = with_doubt_of_rate(fitted(5.0), [run], RATE, lambda runs: by_rate(runs[0], 5.0, 0.2))
    assert found.standard_errors["time_constant"] == pytest.approx(math.hypot(0.03, 0.2 * 0.2))
    assert found.standard_errors["gain"] == pytest.approx(0.001)
    assert found.standard_errors["n0"] is None
    assert found.covariance == pytest.approx(np.diag([0.001**2, 0.03**2 + 0.04**2]))


def test_a_rate_in_doubt_may_leave_open_whether_the_boat_is_stable() -> None:
    run = ordered(5.0)
    found = with_doubt_of_rate(fitted(5.0), [run], RATE, lambda runs: by_rate(runs[0], 5.0, 20.0))
    assert found.ratios is not None and found.ratios.on_ridge
    assert {"K", "T"} <= set(found.unidentifiable)


def test_fits_beside_the_rate_that_fail_are_made_up_for_or_refused() -> None:
    run = ordered(5.0)

    def quicker_only(runs: object) -> Identified:
        calls.append(runs)
        if len(calls) == 1:
            raise InputError("too slow")
        return fitted(5.04)

    def never(runs: object) -> Identified:
        raise InputError("no")

    calls: list[object] = []
    found = with_doubt_of_rate(fitted(5.0), [run], RATE, quicker_only)
    assert found.standard_errors["time_constant"] == pytest.approx(math.hypot(0.03, 0.04))
    with pytest.raises(InputError, match="record the rudder's angle"):
        with_doubt_of_rate(fitted(5.0), [run], RATE, never)


LIKELY = likelihood_fit.LikelihoodFit(
    Rates(0.04, 0.2), np.eye(4), RudderTrain(), {}, Weather(1.0, 1.0, 1.0, 1.0, 1.0), 0.0
)


@pytest.mark.parametrize(("gain", "time_constant"), [(12.0, 5.5), (4.0, 5.5), (-1.0, 5.0), (-40.0, 5.0)])
def test_a_rate_that_turning_calls_sure_counts_where_the_fit_agrees(gain: float, time_constant: float) -> None:
    direct = fitted(5.0)._replace(likely=LIKELY._replace(loss=gain))
    behind = fitted(5.5)._replace(likely=LIKELY)

    def of(runs: Sequence[Run]) -> Identified:
        return direct if runs[0] is run else behind

    run = ordered(5.0)
    found = with_rate(behind, [run], RATE, of)
    assert found.model.time_constant == time_constant and (found.rudder_rate is not None) == (time_constant == 5.5)


@pytest.mark.parametrize("refused", ["behind", "both", ""])
def test_a_sure_rate_behind_which_no_boat_is_found_is_left_out(refused: str) -> None:
    run, direct, behind = ordered(5.0), fitted(5.0), fitted(5.5)

    def of(runs: Sequence[Run]) -> Identified:
        if refused == "both" or (refused and runs[0] is not run):
            raise InputError("rudder and motion go together at once")
        return direct if runs[0] is run else behind

    if refused == "both":
        with pytest.raises(InputError, match="at once"):
            identified_behind([run], RATE, of)
    else:
        assert identified_behind([run], RATE, of) == ((direct, None) if refused else (behind, RATE))
        assert identified_behind([run], RATE._replace(is_sure=False), of) == (direct, RATE._replace(is_sure=False))


@pytest.mark.parametrize(
    ("spacing", "T", "lag", "tells"),
    [
        (0.5, 0.24, 0.5, False),
        (0.5, 0.42, 0.72, False),
        (0.5, 0.8, 0.45, False),
        (0.2, 0.55, 0.2, True),
        (0.5, 3.5, 0.1, True),
        (0.5, 0.9, 0.6, True),
        (0.0, 0.24, 0.5, True),
    ],
)
def test_reports_that_are_too_seldom_do_not_tell_boat_from_lag(
    spacing: float, T: float, lag: float, tells: bool
) -> None:
    time, jump = np.arange(0.0, 60.0, 0.1), math.radians(40.0)
    turns = np.floor(time / 6.0)
    rudder = np.interp(time, 6.0 * np.arange(11.0), jump * (np.arange(11) % 2 - 0.5), left=0.0)
    moments = turns * (jump * spacing) ** 2 / 12.0 if spacing > 0.0 else np.empty(0)
    still = np.zeros_like(time)
    segment = Segment(time, still, still, rudder, still + 4.0, moments=moments)
    train = RudderTrain(lag=lag)
    likely = LIKELY._replace(rates=Rates(0.7 / T, 1.0 / T, 2.0 / T), train=train, train_errors={"lag": 0.05})
    doubt = doubt_of_change(likely, [Run("zigzag", (segment,), rudder="ordered")])
    assert (doubt is None) == tells
    if doubt is not None:
        assert 1.0 / (1.0 / T - math.sqrt(doubt[1, 1])) == pytest.approx(T + lag)


def test_a_boat_that_may_be_lag_is_never_good() -> None:
    verdict = verdict_of(fitted(5.0)._replace(may_be_lag=True))
    assert verdict.grade == "start" and "record the orders more often" in verdict.sentence
    verdict = verdict_of(fitted(5.0, 3.0, 0.2)._replace(may_be_lag=True))
    assert verdict.grade == "not enough" and "record the orders more often" in verdict.sentence


@pytest.mark.parametrize(("gain", "time_constant"), [(12.0, 5.5), (4.0, 5.0), (1.0, 5.0), (-4.0, 5.0)])
def test_an_unsure_rate_leaves_both_boats_in_doubt_by_their_likelihoods(gain: float, time_constant: float) -> None:
    run = ordered(5.0)

    def by(loss: float, fit: Identified) -> Identified:
        return fit._replace(likely=LIKELY._replace(loss=loss))

    filed = by(gain, fitted(5.0))
    found = with_unsure_rate(filed, [run], RATE._replace(is_sure=False), lambda runs: by(0.0, fitted(5.5)))
    assert found.model.time_constant == time_constant and (found.rudder_rate is not None) == (time_constant == 5.5)
    other = 1.0 / (1.0 + math.exp(gain - 1.0 if time_constant == 5.5 else 1.0 - gain))
    error = math.sqrt(0.03**2 + other * 0.5**2)
    assert found.standard_errors["time_constant"] == pytest.approx(error)
    assert found.covariance is not None and math.sqrt(found.covariance[1, 1]) == pytest.approx(error)


def test_an_unsure_rate_that_is_out_of_the_question_is_fitted_no_more() -> None:
    def never(runs: object) -> Identified:
        raise AssertionError("fitted")

    run = ordered(20.0, noise_deg=0.2, seed=2026112965)
    held = identify([run], Question(reference_speed=3.0))
    slow = RudderRate(math.radians(2.5), math.radians(0.05), 6, True, False)
    assert with_unsure_rate(held, [run], slow, never) is held


def test_an_unsure_rate_behind_which_nothing_is_found_stays_out() -> None:
    def never(runs: object) -> Identified:
        raise InputError("no")

    held = fitted(5.0)
    assert with_unsure_rate(held, [ordered(5.0)], RATE, never) is held
    assert with_unsure_rate(held, [ordered(5.0)], RATE, lambda runs: fitted(6.0)) is held


def test_a_rudder_slower_than_its_file_is_noticed_and_taken_over() -> None:
    run, filed = ordered(3.0, noise_deg=0.2), autopilot.load_vessel("lanxin")
    assert filed.rudder.rate_max_deg_s == 20.0
    found = autopilot.identify(run, vessel=filed)
    assert "its rudder turns out to move at 3" in autopilot.verdict(found, run, vessel=filed).sentence
    taken = autopilot.with_model(filed, found)
    assert taken.rudder.rate_max_deg_s == pytest.approx(3.0, rel=0.1)
    # the model says whose it is and how sure, not whose the file's was
    assert (taken.model.source, taken.model.log) == ("identified", ())
    error = found.standard_errors["time_constant"]
    assert error is not None and taken.model.standard_errors.T_s == pytest.approx(error, rel=0.01)


@pytest.mark.parametrize("rate_deg_s", [math.inf, 60.0, 15.0])
def test_the_doubt_of_a_reported_rudder_is_how_its_moments_scatter(rate_deg_s: float) -> None:
    """An order that jumps at any moment between two reports half a second apart, by 40 deg."""
    time, at, (low, high) = np.arange(0.0, 10.0, 0.1), np.arange(0.0, 10.0, 0.5), np.radians([-20.0, 20.0])
    still = 0.0 * time
    logged = (Series(HEADING, "log", time, still), Series(SPEED, "log", time, still + SPEED_M_S))
    orders = Series(SHARE, "servo", at, np.where(at > 3.2, high, low) / FULL_RAD)
    rate = math.radians(rate_deg_s)
    gear = None if math.isinf(rate) else SteeringGear(1.0, rate)
    recording, settings = Recording("log", "zigzag", (*logged, orders)), RudderSettings(at_full=FULL_RAD, gear=gear)
    columns = table_of(recording, settings, between_motions=True).columns
    fine, turned = np.arange(0.0, 9.0, 0.002), []
    for jump in 3.0 + 0.5 * (np.arange(100) + 0.5) / 100.0:
        rudder = rate_limited(fine, np.where(fine > jump, high, low), rate)
        turned.append(float(np.trapezoid(rudder, fine)))
    inside = time <= 9.0
    assert np.trapezoid(columns["rudder_rad"][inside], time[inside]) == pytest.approx(np.mean(turned), abs=0.01)
    assert float(np.ptp(columns[MOMENTS])) == pytest.approx(np.var(turned), rel=0.03)
    # none before the order may have come
    assert float(columns[MOMENTS][time < 2.95].max()) == float(columns[MOMENTS].min())


@pytest.mark.parametrize("hz", [10.0, 5.0, 2.0])
def test_orders_that_walk_as_fast_as_the_gear_do_not_jump(hz: float) -> None:
    """Taken for stairs they bring the rudder late: it cannot catch up."""
    random, rate = np.random.default_rng(20261129), math.radians(20.0)
    gear = SteeringGear(FULL_RAD, rate, lag=0.1)
    time, fine = np.arange(0.0, 59.0, 0.05), np.arange(0.0, 60.0, 0.01)
    walked = rate_limited(fine, np.radians(15.0) * np.sign(np.sin(fine + 0.3)), rate)
    at = np.arange(0.013, 60.0, 1.0 / hz)
    at += 0.015 * random.uniform(-1.0, 1.0, at.size)
    still = 0.0 * time
    logged = (Series(HEADING, "log", time, still), Series(SPEED, "log", time, still + SPEED_M_S))
    orders = Series(SHARE, "servo", at, np.interp(at, fine, walked) / FULL_RAD)
    recording, settings = Recording("log", "zigzag", (*logged, orders)), RudderSettings(at_full=FULL_RAD, gear=gear)
    columns = table_of(recording, settings, between_motions=True).columns
    known = np.isfinite(columns["rudder_rad"])
    truth = through_gear(Series(SHARE, "pilot", fine, walked), gear)
    late = np.interp(time[known], truth.time, truth.values) - columns["rudder_rad"][known]
    moving = np.sign(np.interp(time[known], fine, np.gradient(walked, fine)))
    longest, reversals = float(np.diff(at).max()), int(60.0 / math.pi)
    # a corner between two reports is known to h^2/8 of the rate, a reversal lasts 1.5 s; the truth comes each 10 ms
    assert abs(float((moving * late).mean() / np.abs(moving).mean()) / rate) < 0.005 + longest**2 / 8.0 / 1.5
    # at each of its two corners at most half of what is walked between two reports may have jumped
    assert float(np.ptp(columns[MOMENTS])) < reversals * 2.0 * (0.5 * rate * longest) ** 2 * longest**2 / 12.0


@pytest.mark.parametrize("rate_deg_s", [300.0, 15.0])
def test_a_boat_is_identified_from_orders_reported_twice_a_second(rate_deg_s: float) -> None:
    """Taken for gusts, the unknown moments left the rudder's zero 0.13 deg off, and T 5 % open."""
    plant, inside, off = PLANTS[0]._replace(rudder_rate_deg_s=rate_deg_s), [], []
    gear = None if rate_deg_s > 100.0 else SteeringGear(0.61, math.radians(rate_deg_s))
    for seed in range(2026113050, 2026113053):
        tables = [zigzags(plant, SEAS[0], [seed], side, with_orders=True)[0] for side in (1, -1)]
        runs = [reported(table, 2.0, 2 * seed + side, gear) for side, table in enumerate(tables)]
        found = identify(runs, Question(reference_speed=SPEED_M_S))
        assert found.ratios is not None
        K, T, zero = plant.a / plant.b, 1.0 / plant.b, plant.e / plant.a
        off.append(
            (
                abs(found.model.gain / K - 1.0),
                abs(found.model.time_constant / T - 1.0),
                abs(math.degrees(found.model.n0 / found.model.gain - zero)),
            )
        )
        for value, error, truth in zip(*found.ratios, (plant.a, plant.b, plant.d, plant.e), strict=True):
            inside.append(abs(value - truth) < 1.96 * error)
    # 95 % of 12: 9 or fewer by chance in one case of 50
    assert sum(inside) >= 9
    # as of a log of ten reports a second: 3 % of K and T, and a tenth of a degree
    assert np.all(np.median(off, axis=0) < (0.03, 0.03, 0.1)), off
