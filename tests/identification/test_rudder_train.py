"""What lies between the recorded rudder and the water: its response against scipy, and whether a fit finds it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import lsim
from zigzag_trials import noisy, run_of, zigzag

from autopilot.cli.main import main
from autopilot.identification.identified import Question
from autopilot.identification.identify import identify
from autopilot.identification.likelihood_fit import LikelihoodFit
from autopilot.identification.likelihood_model import answer_of, follows_surely
from autopilot.identification.likelihood_record import record_of, rudder_on
from autopilot.identification.marginal_likelihood import Rates, Weather
from autopilot.identification.rudder_path import DIRECT, RudderTrain, behind_train, small_swings
from autopilot.identification.runs import FloatArray, Run, Segment
from autopilot.identification.verdict import verdict_of

TIME = np.arange(0.0, 30.0, 0.05)
PATH = 0.3 * np.sin(0.8 * TIME) + 0.1 * np.sign(np.sin(0.3 * TIME))
RATE, HEADING = np.radians(0.1), np.radians(0.2)
QUESTION = Question(reference_speed=5.0)


@pytest.mark.parametrize(("lag", "lead"), [(0.4, 0.0), (2.0, 0.7), (0.05, 0.0)])
def test_lag_and_lead_are_those_of_the_transfer_function(lag: float, lead: float) -> None:
    _, expected, _ = lsim(([lead, 1.0] if lead else [1.0], [lag, 1.0]), PATH - PATH[0], TIME)
    found = behind_train(RudderTrain(lag=lag, lead=lead), TIME, PATH, TIME)
    np.testing.assert_allclose(found - PATH[0], expected, atol=1.0e-9)


def test_a_delay_shifts_and_nothing_changes_nothing() -> None:
    late = behind_train(RudderTrain(delay=0.5), TIME, PATH, TIME)
    np.testing.assert_allclose(late[10:], PATH[:-10], atol=1.0e-12)
    assert np.all(late[:10] == PATH[0])
    np.testing.assert_array_equal(behind_train(DIRECT, TIME, PATH, TIME), PATH)


@pytest.mark.parametrize(
    "train",
    [
        DIRECT,
        RudderTrain(delay=0.13),
        RudderTrain(0.02, 0.13, 0.21),
        RudderTrain(lag=0.7, lead=2.1),
        RudderTrain(lag=2e-6),
    ],
)
def test_the_mean_behind_the_train_is_its_integral_however_coarse_the_record(train: RudderTrain) -> None:
    time, angle = TIME[::8], PATH[::8]
    table = {"time_s": time, "rudder_rad": angle, "speed_m_s": np.full(time.size, 5.0), "yaw_rate_rad_s": angle}
    record = record_of(run_of(table).segments, 5.0, 8.0)
    found = rudder_on(record, train)
    (edges,), (path,) = record.edges, record.paths
    fine = np.union1d(np.union1d(np.linspace(edges[0], edges[-1], 40_001), path[0] + train.delay), edges)
    there = behind_train(train, *path, fine)
    area = np.concatenate([[0.0], np.cumsum(0.5 * (there[1:] + there[:-1]) * np.diff(fine))])
    at = np.searchsorted(fine, edges)
    np.testing.assert_allclose(found[0].T.ravel(), np.diff(area[at]) / np.diff(edges), atol=1.0e-6)
    np.testing.assert_allclose(found[1].T.ravel(), np.diff(there[at]), atol=1.0e-9)


@given(
    dead_band=st.floats(0.001, 0.5),
    angles=st.lists(st.floats(-0.6, 0.6), min_size=2, max_size=30),
)
def test_play_follows_within_the_dead_band_and_only_when_pushed(dead_band: float, angles: list[float]) -> None:
    path = np.array(angles)
    time = np.arange(path.size, dtype=np.float64)
    there = behind_train(RudderTrain(dead_band=dead_band), time, path, time)
    assert np.all(np.abs(there - path) <= dead_band + 1.0e-12)
    moved = np.flatnonzero(np.diff(there) != 0.0) + 1
    # whatever moves is pushed by the edge of the play
    assert np.allclose(np.abs(there[moved] - path[moved]), dead_band)


def commanded_late(lag: float, seed: int) -> dict[str, FloatArray]:
    """A zigzag of which the record holds the orders of a gear with a lag, not the rudder."""
    table = noisy(zigzag(np.radians(15.0), 60.0, 0.1, T=1.0), RATE, HEADING, seed)
    fine = zigzag(np.radians(15.0), 60.0, 0.005, T=1.0)
    # the boat answered to the lagged angle: what was ordered led it by the lag
    ordered = fine["rudder_rad"] + lag * np.gradient(fine["rudder_rad"], fine["time_s"])
    return {**table, "rudder_rad": ordered[::20]}


@pytest.mark.parametrize("seed", [1, 4])
def test_a_lag_that_the_record_does_not_show_is_found(seed: int) -> None:
    run = run_of(commanded_late(0.3, seed))
    found = identify([run], Question(reference_speed=5.0, rudder_train=("lag",)))
    error = found.standard_errors["lag"]
    assert error is not None
    assert found.train.lag == pytest.approx(0.3, abs=0.1)
    # what the record's jumps hide between samples is no play
    assert found.train.dead_band == 0.0
    # without it the lag passes for a part of T
    assert found.model.time_constant == pytest.approx(1.0, abs=0.06)


def test_what_is_not_there_is_left_out_with_the_reason() -> None:
    run = run_of(noisy(zigzag(np.radians(15.0), 60.0, 0.1), RATE, HEADING, 3))._replace(rudder="measured")
    found = identify([run], Question(reference_speed=5.0, rudder_train=("delay", "lag")))
    assert found.train == DIRECT
    assert "cannot be distinguished from 0" in found.unidentifiable["lag"]
    both = "delay and lag: late."
    alike = found._replace(unidentifiable={"delay": both, "lag": both, "n3": "n3: calm."})
    assert alike.why_not == (both, "n3: calm."), "what is the same of two is said once"
    assert found.model == identify([run], Question(reference_speed=5.0)).model


def test_a_rudder_only_ordered_is_late_though_nothing_shows_it_and_t_holds_that_doubt() -> None:
    run = run_of(noisy(zigzag(np.radians(15.0), 25.0, 0.25, T=1.0), 5.0 * RATE, 5.0 * HEADING, 3))
    measured, ordered = (identify([run._replace(rudder=origin)], QUESTION) for origin in ("measured", "ordered"))
    assert measured.train == DIRECT and ordered.train.delay > 0.0 and ordered.train.lag > 0.0
    doubts = [found.standard_errors["time_constant"] or 0.0 for found in (measured, ordered)]
    assert doubts[1] > 1.2 * doubts[0]
    assert "and T, from which they take their part, is as uncertain" in ordered.unidentifiable["delay"]


def test_a_boat_that_hardly_shows_its_rudder_is_in_doubt_and_not_fitted_without_gusts() -> None:
    run = run_of(zigzag(np.radians(15.0), 25.0, 0.25, T=1.0))
    spread = np.diag([0.94, 1.56, 7.2, 0.004]) ** 2
    calm = Weather(0.01, 6.0, 0.001, 0.001, 0.001)
    found = LikelihoodFit(Rates(2.7, 4.1, 9.1, 0.007), spread, DIRECT, {}, calm, 0.0)
    answer = answer_of(found, [run], 5.0, None, {})
    assert answer is not None and not follows_surely(answer)
    assert verdict_of(answer).grade == "not enough"


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--fit-rudder", "wobble"], "delay,lag,lead,dead-band"),
        (["--fit-rudder", "lag", "--model", "nomoto"], "--model norrbin"),
        (["--fit-rudder", "lag", "--method", "two-stage"], "--method output-error"),
    ],
)
def test_what_cannot_be_fitted_is_refused(
    options: list[str], said: str, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    path = tmp_path / "zigzag.csv"
    table = zigzag(np.radians(15.0), 30.0, 0.1)
    np.savetxt(path, np.stack(list(table.values()), axis=1), delimiter=",", header=",".join(table), comments="")
    assert main(["identify", str(path), *options]) == 2
    assert said in capsys.readouterr().err


def with_play(angle: float, play: float, side: int, gust: float = 0.0) -> Run:
    """A zigzag of a boat whose rudder follows its record only after a play [rad] to either side."""
    dt, random, rows = 0.01, np.random.default_rng(round(1.0e6 * angle) + side), []
    rate = heading = rudder = wet = push = 0.0
    order, keep = side * angle, float(np.exp(-dt / 5.0))
    for i in range(6000):
        if i % 10 == 0:
            rows.append((i * dt, heading + HEADING * random.normal(), rudder, 5.0))
        order = -order if heading * np.sign(order) >= angle else order
        rudder += float(np.clip(order - rudder, -0.0026, 0.0026))
        wet = min(max(wet, rudder - play), rudder + play)
        push = keep * push + gust * float(np.sqrt(1.0 - keep**2)) * random.normal()
        slope = (0.43 * (wet + push) - rate - 6.0 * rate**3) / 3.5
        guess = rate + dt * slope
        slope = 0.5 * (slope + (0.43 * (wet + push) - guess - 6.0 * guess**3) / 3.5)
        heading += dt * (rate + 0.5 * dt * slope)
        rate += dt * slope
    names = ("time_s", "heading_rad", "rudder_rad", "speed_m_s")
    return run_of(dict(zip(names, np.array(rows).T, strict=True)), f"{side:+d}")


def shortened(run: Run, seconds: float) -> Run:
    (segment,) = run.segments
    count = int(np.count_nonzero(segment.time < seconds))
    return run._replace(segments=(Segment(*(values[:count] for values in segment)),))


def test_swings_of_a_zigzag_are_large_and_those_of_a_steered_course_small() -> None:
    time = np.arange(0.0, 60.0, 0.1)
    zigzag = np.clip(60.0 * np.sin(0.4 * time), -10.0, 10.0) * (1.0 + (time > 30.0))
    courses = 20.0 * (time % 30.0 > 28.0) + 4.0 * np.sin(1.3 * time)
    known, noise = np.full(time.size, np.nan), np.random.default_rng(1).normal(size=time.size)
    share = [
        small_swings([Segment(time, known, known, np.radians(angle + 0.1 * noise), known)])
        for angle in (zigzag, courses)
    ]
    assert share[0] < 0.1 < 0.4 < share[1]


@pytest.mark.parametrize("play_deg", [0.5, 1.0])
def test_a_play_of_the_rudder_is_found_and_named(play_deg: float) -> None:
    runs = [with_play(np.radians(angle), np.radians(play_deg), side) for angle, side in ((20.0, 1), (10.0, -1))]
    found = identify(runs, Question(reference_speed=5.0))
    assert np.degrees(found.train.dead_band) == pytest.approx(play_deg, abs=0.15)
    assert found.model.gain == pytest.approx(0.43, rel=0.02)
    assert found.model.n3 == pytest.approx(6.0, rel=0.15)
    assert any("of play to either side" in note for note in found.notes)
    assert "play" in verdict_of(found).sentence


def test_a_play_that_is_not_there_is_not_found_but_bounded() -> None:
    calm = identify([with_play(np.radians(20.0), 0.0, 1), with_play(np.radians(10.0), 0.0, -1)])
    assert calm.train == DIRECT and not any("play" in note for note in calm.notes)
    # in gusts, from one short zigzag, a play of half a degree may hide
    gusty = identify([shortened(with_play(np.radians(20.0), 0.0, 1, gust=np.radians(3.0)), 25.0)])
    assert gusty.train.dead_band == 0.0
    assert any("do not exclude a play of the rudder" in note for note in gusty.notes)


def test_a_rudder_whose_zero_is_off_is_named() -> None:
    runs = [with_play(np.radians(20.0), 0.0, side) for side in (1, -1)]
    off = [
        run._replace(segments=tuple(s._replace(rudder=s.rudder + np.radians(3.0)) for s in run.segments))
        for run in runs
    ]
    assert any("straight with 3 +- " in note for note in identify(off).notes)
    assert not any("straight with" in note for note in identify(runs).notes)
