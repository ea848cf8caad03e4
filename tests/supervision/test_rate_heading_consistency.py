"""Which way heading and rate of turn tell of: where they go together, opposite ways, or where nothing is shown."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from autopilot.angles import wrap
from autopilot.signals import HeadingSample, RateSample
from autopilot.supervision.heading_and_rate import (
    NO_TURNS,
    NOT_HELD,
    Consistency,
    Turns,
    are_consistent,
    are_opposite,
    consistency_step,
    followed,
    handed_over,
    held_events,
    turns_step,
)

DT = 0.1


def swings(
    seconds: float,
    swing_deg: float,
    frequency: float,
    scale: float = 1.0,
    bias_deg_s: float = 0.0,
    late_s: float = 0.0,
) -> Iterator[Turns]:
    """A boat that swings by a sine; its gyro has a scale and a bias, its compass is late."""
    turns, swing = NO_TURNS, math.radians(swing_deg)
    for k in range(1, round(seconds / DT)):
        now = k * DT - late_s
        by_heading = swing * (math.sin(frequency * now) - math.sin(frequency * (now - DT)))
        rate = scale * swing * frequency * math.cos(frequency * k * DT) + math.radians(bias_deg_s)
        turns = turns_step(turns, by_heading, rate * DT, DT)
        yield turns


@given(swing=st.floats(6.0, 60.0), frequency=st.floats(0.5, 3.0), scale=st.floats(0.6, 1.6))
def test_a_gyro_of_the_wrong_sign_shows_in_any_swing_worth_the_name(
    swing: float, frequency: float, scale: float
) -> None:
    *_, last = swings(20.0, swing, frequency, -scale)
    assert are_opposite(last)
    *_, right = swings(20.0, swing, frequency, scale)
    assert are_consistent(right)


@given(
    swing=st.floats(0.0, 60.0),
    frequency=st.floats(0.2, 3.0),
    scale=st.floats(0.3, 3.0),
    bias=st.floats(-1.0, 1.0),
    phase=st.floats(0.0, 1.0),
)
def test_a_gyro_that_is_a_little_off_and_a_compass_that_lags_go_the_same_way(
    swing: float, frequency: float, scale: float, bias: float, phase: float
) -> None:
    late = phase / frequency
    # one that tells too little of each turn, too, may be off by so much less: 2 bias (1 + (1 - k)/(1 + k)) <= 2 deg
    bias *= min(1.0, 0.5 * (1.0 + scale))
    # a lag of more than half a radian of the swing turns the difference, and leaves the bias as much less of the sum
    bias *= min(1.0, 1.5 - phase)
    assert not any(map(are_opposite, swings(40.0, swing, frequency, scale, bias, late)))


@given(turns=st.builds(Turns, *[st.floats(-9.0, 9.0)] * 3, *[st.floats(0.0, 9.0)] * 2))
def test_rate_and_heading_are_never_opposite_and_consistent_at_once(turns: Turns) -> None:
    assert not (are_opposite(turns) and are_consistent(turns))


@given(
    steps=st.lists(st.tuples(st.floats(-1.0, 1.0), st.floats(-1.0, 1.0), st.floats(0.01, 2.0)), max_size=30),
)
def test_port_is_as_starboard(steps: list[tuple[float, float, float]]) -> None:
    one, other = NO_TURNS, NO_TURNS
    for by_heading, by_rate, step in steps:
        one, other = turns_step(one, by_heading, by_rate, step), turns_step(other, -by_heading, -by_rate, step)
    assert other == Turns(-one.apart, -one.heading, -one.rate, one.difference, one.sum)


def test_a_boat_that_lies_still_shows_nothing() -> None:
    *_, last = swings(60.0, 0.0, 1.0)
    assert not are_opposite(last)
    assert not are_consistent(last)


@pytest.mark.parametrize("step", [0.05, 0.1, 0.5])
def test_a_steady_turn_is_judged_alike_at_any_pace(step: float) -> None:
    turns = NO_TURNS
    for _ in range(round(20.0 / step)):
        turns = turns_step(turns, 0.1 * step, -0.1 * step, step)
    # the leaky sum of a steady rate: rate times time, but for the step
    assert turns.heading == pytest.approx(0.1 * 2.0, rel=0.5 * step)
    assert turns.apart == pytest.approx(0.2 * 5.0, rel=0.2 * step + 0.02)
    assert are_opposite(turns)


def test_turn_evidence_fades_and_impossible_rates_are_capped() -> None:
    """apart over 5 s, each turn over 2 s, their squares over 4 s."""
    once = turns_step(NO_TURNS, 0.2, -0.1, 0.0)
    assert once[:3] == pytest.approx((0.3, 0.2, -0.1)) and once[3:] == (0.0, 0.0)
    later = turns_step(once, 0.0, 0.0, 1.0)
    assert later.apart == pytest.approx(0.3 * math.exp(-1.0 / 5.0))
    assert (later.heading, later.rate) == pytest.approx((0.2 * math.exp(-0.5), -0.1 * math.exp(-0.5)))
    share = 1.0 - math.exp(-1.0 / 4.0)
    assert later.difference == pytest.approx(share * (0.3 * math.exp(-0.5)) ** 2)
    assert later.sum == pytest.approx(share * (0.1 * math.exp(-0.5)) ** 2)
    faded = turns_step(Turns(0.0, 0.0, 0.0, 1.0, 2.0), 0.0, 0.0, 4.0)
    assert (faded.difference, faded.sum) == pytest.approx((math.exp(-1.0), 2.0 * math.exp(-1.0)))
    assert turns_step(NO_TURNS, 0.0, 99.0, 0.1).rate == math.pi == -turns_step(NO_TURNS, 0.0, -99.0, 0.1).rate


@pytest.mark.parametrize(("more", "holds"), [(0.99, False), (1.01, True)])
@pytest.mark.parametrize("other", [0.0, 0.001, 0.1])
def test_opposite_is_four_times_the_other_and_two_degrees_squared_more(more: float, holds: bool, other: float) -> None:
    size = (4.0 * other + math.radians(2.0) ** 2) * more
    assert are_opposite(Turns(0.0, 0.0, 0.0, size, other)) is holds
    assert are_consistent(Turns(0.0, 0.0, 0.0, other, size)) is holds


def judged(
    seconds: float, swing_deg: float, frequency: float, *, scale: float = 1.0, late_s: float = 0.0, begin: float = 0.0
) -> Iterator[Consistency]:
    """The watch of a boat whose rudder makes 4 deg/s by its model, so that 8 are no turn of it, from `begin` [s] on."""
    known, swing = Consistency(), math.radians(swing_deg)
    for k in range(round(begin / DT), round((begin + seconds) / DT)):
        now = k * DT
        heading, rate = swing * math.sin(frequency * (now - late_s)), swing * frequency * math.cos(frequency * now)
        sample = HeadingSample(now, math.remainder(heading, math.tau), scale * rate)
        known = consistency_step(known, sample, math.radians(15.0), math.radians(8.0))
        yield known


@given(swing=st.floats(1.0, 20.0), frequency=st.floats(0.5, 2.0))
def test_a_rate_in_other_units_is_refused_at_once_and_called_what_it_is(swing: float, frequency: float) -> None:
    found = [each.found for each in judged(3.0, swing, frequency, scale=57.3)]
    first = next(k for k, text in enumerate(found) if text)
    assert first * DT <= 1.5
    assert found[first].endswith("deg/s is no turn of this boat")
    known = list(judged(40.0, swing, frequency, scale=57.3))
    assert known[-1].is_refused and known[-1].found == found[first], "it stays so, in the same words"


@given(swing=st.floats(0.0, 90.0), frequency=st.floats(0.1, 1.5), late=st.floats(0.0, 0.4), begin=st.floats(0.0, 9.0))
def test_a_gyro_is_believed_however_a_sea_or_a_thruster_turns_the_boat(
    swing: float, frequency: float, late: float, begin: float
) -> None:
    swing = min(swing, 32.0 / frequency)  # four times as quick as the limit
    assert not any(each.is_refused for each in judged(30.0, swing, frequency, late_s=late, begin=begin))


def beside(
    seconds: float, period: float, rates_deg_s: Callable[[float], float], turn: Callable[[float], float] = lambda _: 0.0
) -> Iterator[tuple[float, Consistency]]:
    """The watch of that boat, whose headings `turn` [deg] come at 10 Hz and whose rates every `period` [s]."""
    known, most, rate_most = Consistency(), math.radians(15.0), math.radians(8.0)
    for k in range(round(seconds / DT)):
        now = k * DT
        if k % round(period / DT) == 0:
            known = consistency_step(known, RateSample(now, math.radians(rates_deg_s(now))), most, rate_most)
        known = consistency_step(known, HeadingSample(now, math.radians(turn(now))), most, rate_most)
        yield now, known


@pytest.mark.parametrize("period", [0.1, 0.5, 1.0])
@pytest.mark.parametrize("rate_deg_s", [0.0, 3.0])
def test_a_rate_that_stands_still_while_the_heading_turns_on_is_refused_until_it_moves(
    period: float, rate_deg_s: float
) -> None:
    """It is as right as it was when it began to stand, until the heading goes 5 deg further in 5 s than the rate."""
    known, most, rate_most = Consistency(), math.radians(15.0), math.radians(8.0)
    refused: dict[float, bool] = {}
    heading = 0.0
    for k in range(900):
        now = k * DT
        heading += math.radians(rate_deg_s + (6.0 if 20.0 <= now < 27.0 else 0.0)) * DT
        if k % round(period / DT) == 0:
            rate = rate_deg_s if now < 60.0 else rate_deg_s + (0.1 if k % 2 else -0.1)
            known = consistency_step(known, RateSample(now, math.radians(rate)), most, rate_most)
        shown = HeadingSample(now, math.remainder(heading, math.tau))
        known = consistency_step(known, shown, most, rate_most)
        refused[round(now, 1)] = known.is_refused
    first = next(now for now, is_refused in refused.items() if is_refused)
    # 6 deg/s apart from 20 s on: 5 deg after 0.8 s, a little more as it fades, and 1 s and four rates more
    assert 21.8 <= first <= 22.0 + 4.0 * period
    assert all(is_refused for now, is_refused in refused.items() if first <= now < 60.0), "a dead one stays refused"
    assert not refused[89.0]


def stood(
    stands_s: float,
    turn_deg_s: float,
    *,
    period: float = DT,
    noise_deg: float = 0.3,
    rate_noise_deg_s: float = 0.2,
    digit_deg_s: float = 0.0,
    own: bool = True,
    held: bool = True,
    seed: int = 20261129,
) -> float:
    """After how long [s] a rate is refused that worked for 60 s in a swell, and then repeats its last one, or 0 where
    it is not `held`, while the boat turns; nan: never. own: by the instrument of the headings."""
    random, known, most, rate_most = np.random.default_rng(seed), Consistency(), math.radians(15.0), math.radians(20.0)
    heading, shown = 0.0, 0.0
    for k in range(round((60.0 + stands_s) / period)):
        now = k * period
        rate = turn_deg_s if now >= 60.0 else math.sin(now)
        heading += rate * period
        if now < 60.0:
            shown = rate + rate_noise_deg_s * float(random.standard_normal())
            shown = digit_deg_s * round(shown / digit_deg_s) if digit_deg_s else shown
        elif not held:
            shown = 0.0
        at = math.remainder(math.radians(heading + noise_deg * float(random.standard_normal())), math.tau)
        if not own:
            known = consistency_step(known, RateSample(now, math.radians(shown), "gyro"), most, rate_most)
        sample = HeadingSample(now, at, math.radians(shown) if own else None, "compass")
        known = consistency_step(known, sample, most, rate_most, math.radians(25.0))
        if known.is_refused:
            assert known.found == "the rate stands still"
            return now - 60.0
    return math.nan


@pytest.mark.parametrize("own", [True, False])
@pytest.mark.parametrize("held", [True, False])
@pytest.mark.parametrize(("period", "within"), [(0.1, 1.6), (0.2, 1.8), (0.5, 2.5)])
def test_a_rate_that_never_stood_is_refused_by_a_small_turn(
    own: bool, held: bool, period: float, within: float
) -> None:
    """By 2.5 deg and its noise, not by 5 deg that last for a second; no sooner than what is sent again, 1.2 s."""
    assert 1.19 - period <= stood(10.0, 4.0, period=period, own=own, held=held) <= within


@pytest.mark.parametrize("noise_deg", [0.1, 0.3, 1.0])
@pytest.mark.parametrize("digit_deg_s", [0.1, 0.5])
def test_a_gyro_that_comes_to_rest_within_a_digit_is_believed(noise_deg: float, digit_deg_s: float) -> None:
    """Its habits are those of a swell and a running engine; the boat may turn by half a digit and nobody sees it."""
    for seed in range(5):
        turn = 0.45 * digit_deg_s
        refused = stood(120.0, turn, noise_deg=noise_deg, digit_deg_s=digit_deg_s, held=False, seed=seed)
        assert math.isnan(refused), (seed, refused)


def test_a_rate_sensor_s_habits_are_known_before_it_is_steered_by() -> None:
    """A compass with a gyro of its own steers; then it falls silent, and the other gyro has long stood."""
    random, known, most, rate_most = np.random.default_rng(20261129), Consistency(), math.radians(15.0), 1.0
    heading, refused = 0.0, math.nan
    for k in range(800):
        now = k * DT
        rate = math.sin(now) if now < 65.0 else 4.0
        heading += rate * DT
        noise = random.standard_normal(3)
        beside = math.radians(rate + 0.2 * noise[0]) if now < 60.0 else 0.01
        known = consistency_step(known, RateSample(now, beside, "gyro"), most, rate_most)
        at = math.remainder(math.radians(heading + 0.3 * noise[1]), math.tau)
        own = math.radians(rate + 0.2 * noise[2])
        if now < 64.95:
            sample = HeadingSample(now, at, own, "first")
        else:
            if sample.source == "first":
                known, _ = handed_over(known)
            sample = HeadingSample(now, at, None, "second")
        known = consistency_step(known, sample, most, rate_most, math.radians(25.0))
        if known.is_refused:
            refused = now - 65.0
            break
    assert refused <= 1.2


@pytest.mark.parametrize("digit_deg_s", [0.1, 0.5])
@pytest.mark.parametrize("noise_deg", [0.3, 1.0])
@pytest.mark.parametrize("yaw_deg_s", [0.0, 0.2, 3.0])
def test_a_gyro_of_coarse_digits_is_believed(digit_deg_s: float, noise_deg: float, yaw_deg_s: float) -> None:
    """At rest it shows the very same for minutes, and a slow yaw is less than its digits."""
    random, heading = np.random.default_rng(1), 0.0
    known, most, rate_most = Consistency(), math.radians(15.0), math.radians(8.0)
    for k in range(12000):
        now, yaw = k * DT, yaw_deg_s * math.sin(0.05 * k * DT)
        heading += yaw * DT
        shown = math.radians(heading + noise_deg * float(random.standard_normal()))
        rate = math.radians(digit_deg_s * round(yaw / digit_deg_s))
        known = consistency_step(known, HeadingSample(now, math.remainder(shown, math.tau), rate), most, rate_most)
        assert not known.is_refused


@pytest.mark.parametrize(("period", "wild"), [(1.0, 1), (1.0, 2), (0.5, 1), (0.5, 2), (0.5, 3), (0.2, 5), (0.1, 10)])
@pytest.mark.parametrize("rate_deg_s", [40.0, -60.0, 200.0])
def test_a_gyro_of_a_few_wild_rates_is_believed_again_soon(period: float, wild: int, rate_deg_s: float) -> None:
    last = 30.0 + period * wild
    said = list(beside(90.0, period, lambda now: rate_deg_s if 30.0 <= now < last - 0.01 else 0.1))
    assert not any(known.is_refused for now, known in said if wild < 2 or now > last + 31.0)
    # as long as what differs by so much is said of any rate: it fades over 5 s to the limit, and is said 20 s more
    assert not any(known.found for now, known in said if now > last + 36.0)


@pytest.mark.parametrize(("period", "within"), [(0.1, 1.5), (0.5, 1.5), (1.0, 2.2)])
def test_rates_in_other_units_stay_refused_on_a_course_where_they_are_small(period: float, within: float) -> None:
    def heading(now: float) -> float:
        # a turn of 20 deg, and then so small a swing that the rate times 57.3 lies below what no boat turns by
        return 2.0 * now if now < 10.0 else 20.0 + 0.1 * math.sin(now)

    def rate(now: float) -> float:
        return 57.3 * (2.0 if now < 10.0 else 0.1 * math.cos(now))

    said = list(beside(200.0, period, rate, heading))
    first = next(now for now, known in said if known.is_refused)
    assert first <= within
    texts = {known.found for now, known in said if now >= first}
    assert texts == {"115 deg/s is no turn of this boat"}
    assert all(known.is_refused for now, known in said if now >= first)


def after_each(samples: Iterable[HeadingSample], rate_most: float) -> Iterator[tuple[Consistency, list[str]]]:
    """What is known after each heading of a boat that turns by `rate_most` [rad/s] at most, and what was said by it."""
    watch, said = Consistency(), list[str]()
    for sample in samples:
        watch = consistency_step(watch, sample, math.radians(15.0), rate_most, math.radians(25.0))
        said += [event.detail for event in held_events(watch.held, sample.time) if event.detail not in said]
        yield watch, said


def heard(
    shown: Callable[[float], float],
    rate: Callable[[float], float] = lambda _: 0.0,
    seconds: float = 6.0,
    dt: float = DT,
    noise_deg: float = 0.2,
    seed: int = 3,
    most_deg_s: float = 57.3,
) -> tuple[float, list[str]]:
    """How far headings `shown` [deg] beside rates [deg/s] are held to be off in the end, and what is said by then."""
    random = np.random.default_rng(seed)

    def sample(now: float) -> HeadingSample:
        heading, noise = math.radians(shown(now)), math.radians(noise_deg) * random.standard_normal(2)
        turning = math.radians(rate(now)) + 0.5 * float(noise[1])
        return HeadingSample(now, (heading + float(noise[0]) + math.pi) % (2.0 * math.pi) - math.pi, turning, "c")

    *_, (watch, said) = after_each((sample(k * dt) for k in range(round(seconds / dt))), math.radians(most_deg_s))
    return math.degrees(watch.held.offset), said


@pytest.mark.parametrize("north", [0.0, 176.0, 90.0])
@pytest.mark.parametrize("dt", [0.05, 0.1, 0.5, 1.0])
@pytest.mark.parametrize("jump", [9.0, -9.0, 24.0])
def test_a_heading_that_comes_to_rest_elsewhere_is_held(jump: float, dt: float, north: float) -> None:
    offset, said = heard(lambda now: north + (jump if now >= 2.0 else 0.0), dt=dt)
    assert offset == pytest.approx(jump, abs=1.5)
    assert len(said) == 1


@pytest.mark.parametrize("damped", [0.3, 0.6])
def test_behind_a_damped_compass_a_jump_is_held_too(damped: float) -> None:
    offset, _ = heard(lambda now: 15.0 * (1.0 - math.exp(-max(now - 6.0, 0.0) / damped)), seconds=10.0)
    assert offset == pytest.approx(15.0, abs=1.5)


@pytest.mark.parametrize("jump", [3.0, -4.0, 32.0])
def test_what_is_less_is_followed_and_what_is_more_ends_steering(jump: float) -> None:
    assert heard(lambda now: jump if now >= 2.0 else 0.0) == (0.0, [])


@pytest.mark.parametrize("rate", [4.0, 10.0, 30.0])
def test_a_turn_that_no_rate_shows_is_a_turn(rate: float) -> None:
    """A gyro that shows noise alone: what is held of the heading is given back."""
    offset, _ = heard(lambda now: rate * max(now - 2.0, 0.0), seconds=12.0)
    assert offset == 0.0


@pytest.mark.parametrize("lag", [0.0, 1.0, 2.0])
@pytest.mark.parametrize("rate", [5.0, 20.0])
def test_a_turn_behind_a_compass_that_lags_is_no_jump(rate: float, lag: float) -> None:
    def turned(now: float) -> float:
        return rate * min(max(now - 2.0, 0.0), 6.0)

    assert heard(lambda now: turned(now - lag), lambda now: rate if 2.0 <= now < 8.0 else 0.0, 15.0) == (0.0, [])


def test_in_a_turn_a_jump_is_held_by_its_suddenness() -> None:
    offset, said = heard(lambda now: 20.0 * now + (14.0 if now >= 3.0 else 0.0), lambda _: 20.0)
    assert offset == pytest.approx(14.0, abs=1.5)
    assert said == ["by +14 deg"]


def test_spikes_are_said_when_they_come_the_third_time() -> None:
    assert heard(lambda now: 12.0 if 2.0 <= now < 2.15 else 0.0) == (0.0, [])
    offset, said = heard(lambda now: 12.0 if now >= 2.0 and now % 3.0 < 0.15 else 0.0, seconds=12.0)
    assert (offset, said) == (0.0, ["to and fro by 12 deg"])


def test_a_magnet_that_is_taken_away_leaves_nothing_held() -> None:
    offset, said = heard(lambda now: 12.0 if 2.0 <= now < 12.0 else 0.0, seconds=20.0)
    assert (offset, said) == (0.0, ["by +12 deg"])


@pytest.mark.parametrize("noise", [4.0, 10.0])
def test_a_compass_that_trembles_is_not_held_for_long(noise: float) -> None:
    offset, _ = heard(lambda _: 0.0, seconds=60.0, noise_deg=noise)
    assert offset == 0.0


def test_a_jump_behind_another_is_held_beside_it() -> None:
    """Together beyond what is ours, neither was held, and the boat turned by both."""
    offset, said = heard(lambda now: 20.0 * ((now >= 2.0) + (now >= 12.0)), seconds=20.0)
    assert offset == pytest.approx(40.0, abs=1.5)
    assert said == ["by +20 deg"]


@pytest.mark.parametrize("dt", [0.05, 0.1])
@pytest.mark.parametrize("apart_s", [0.3, 1.0])
@pytest.mark.parametrize("jump", [16.0, -20.0])
def test_two_jumps_right_after_one_another_are_both_held(jump: float, apart_s: float, dt: float) -> None:
    """Together beyond what is ours, they were taken for a turn, and the boat turned by both."""
    offset, said = heard(lambda now: jump * ((now >= 2.0) + (now >= 2.0 + apart_s)), dt=dt)
    assert offset == pytest.approx(2.0 * jump, abs=1.5)
    assert said == [f"by {jump:+.0f} deg"]


@pytest.mark.parametrize("dt", [0.05, 0.1])
@pytest.mark.parametrize("apart_s", [0.8, 1.4, 2.0, 4.0])
@pytest.mark.parametrize(("first", "second"), [(14.0, 14.0), (14.0, -24.0), (-20.0, -20.0), (10.0, 15.0)])
def test_a_jump_from_rest_is_one_however_soon_it_follows_another(
    first: float, second: float, apart_s: float, dt: float
) -> None:
    """To the same side it was taken for a turn that the gyro does not show, and the boat turned by both."""
    offset, said = heard(lambda now: first * (now >= 2.0) + second * (now >= 2.0 + apart_s), seconds=9.0, dt=dt)
    assert offset == pytest.approx(first + second, abs=1.5)
    assert len(said) == 1


@pytest.mark.parametrize(("step", "each_s"), [(15.0, 1.0), (-14.0, 1.7), (20.0, 2.5), (13.0, 0.6)])
def test_a_compass_that_jumps_on_and_on_turns_no_boat(step: float, each_s: float) -> None:
    """The gyro was accused."""
    offset, said = heard(lambda now: step * max((now - 2.0) // each_s + 1.0, 0.0), seconds=40.0)
    turned = step * (38.0 // each_s + 1.0)
    assert offset == pytest.approx(turned, abs=abs(step) + 1.5)
    assert said


@pytest.mark.parametrize(
    ("repeated_s", "share"), [(0.25, 0.0), (0.5, 0.0), (0.5, 0.33), (0.5, 0.5), (0.5, 1.0), (1.0, 1.0), (2.0, 1.0)]
)
@pytest.mark.parametrize("rate_deg_s", [4.0, 8.0, 12.0])
def test_a_turn_in_the_steps_of_a_compass_that_is_repeated_is_no_jump(
    rate_deg_s: float, share: float, repeated_s: float
) -> None:
    """A gateway repeats each heading at 20 Hz until the next comes, and the gyro shows a share of the turn. Each step
    comes from rest; held, it had the boat go round. Beside a gyro that is right up to 120 deg were held."""
    random, watch, shown = np.random.default_rng(5), Consistency(), 0.0
    for k in range(800):
        now = 0.05 * k
        turned = math.radians(rate_deg_s * (min(max(now, 20.0), 32.0) - 20.0))
        if k % round(repeated_s / 0.05) == 0:
            shown = wrap(turned + math.radians(0.3) * float(random.standard_normal()))
        rate = math.radians(share * rate_deg_s if 20.0 <= now < 32.0 else 0.0)
        sample = HeadingSample(now, shown, rate + 0.002 * float(random.standard_normal()), "c")
        watch = consistency_step(watch, sample, math.radians(15.0), math.radians(20.0), math.radians(25.0))
    assert watch.held.offset == 0.0


def beside_no_rate(
    shown: Callable[[float], float],
    *,
    refused: bool,
    seconds: float = 40.0,
    dt: float = 0.1,
    noise_deg: float = 0.2,
    seed: int = 3,
    most_deg_s: float = 30.0,
) -> tuple[float, list[str]]:
    """As `heard`, the boat turning by `most_deg_s` at most, without a rate or beside one that was found to be wrong."""
    random = np.random.default_rng(seed)

    def sample(now: float) -> HeadingSample:
        rate = math.radians(10.0 if now >= 2.0 else 0.0) if refused else None
        heading = math.radians(shown(now) + noise_deg * float(random.standard_normal()))
        return HeadingSample(now, wrap(heading), rate, "c")

    *_, (watch, said) = after_each((sample(k * dt) for k in range(round(seconds / dt))), math.radians(most_deg_s))
    assert bool(watch.found) is refused
    return math.degrees(watch.held.offset), said


@pytest.mark.parametrize("refused", [False, True])
@pytest.mark.parametrize("jump", [12.0, -12.0, 20.0, 24.0])
def test_without_a_rate_what_no_boat_turns_at_once_is_held(jump: float, refused: bool) -> None:
    """A compass alone, or beside a gyro that was found wrong, was followed without a word."""
    offset, said = beside_no_rate(lambda now: 3.0 * math.sin(now) + (jump if now >= 30.0 else 0.0), refused=refused)
    assert offset == pytest.approx(jump, abs=1.5)
    assert said == [f"by {math.degrees(math.radians(offset)):+.0f} deg"]


@pytest.mark.parametrize("refused", [False, True])
def test_without_a_rate_a_spike_is_none_and_a_magnet_taken_away_leaves_nothing(refused: bool) -> None:
    assert beside_no_rate(lambda now: 12.0 if 30.0 <= now < 30.25 else 0.0, refused=refused) == (0.0, [])
    offset, said = beside_no_rate(lambda now: 12.0 if 20.0 <= now < 30.0 else 0.0, refused=refused)
    assert (offset, len(said)) == (0.0, 1)
    offset, said = beside_no_rate(lambda now: 12.0 * (now >= 20.0 and now % 3.0 < 0.25), refused=refused, seconds=41.0)
    assert offset == 0.0
    assert len(said) == 1
    assert said[0].startswith("to and fro by ")


@pytest.mark.parametrize("refused", [False, True])
@pytest.mark.parametrize(("step", "each_s"), [(15.0, 1.0), (-12.0, 0.8), (20.0, 1.2)])
def test_without_a_rate_too_a_compass_that_jumps_on_and_on_turns_no_boat(
    step: float, each_s: float, refused: bool
) -> None:
    offset, said = beside_no_rate(lambda now: step * max((now - 20.0) // each_s + 1.0, 0.0), refused=refused)
    turned = step * (20.0 // each_s + 1.0)
    assert math.degrees(abs(wrap(math.radians(offset - turned)))) < abs(step) + 1.5
    assert said


def five_jumps(step: float, each_s: float) -> Callable[[float], float]:
    """Headings [deg] that jump five times by a `step`, from 20 s on."""
    return lambda now: step * min(max((now - 20.0) // each_s + 1.0, 0.0), 5.0)


@pytest.mark.parametrize("refused", [False, True])
@pytest.mark.parametrize("most", [5.4, 30.0, 144.0])
@pytest.mark.parametrize(("step", "each_s"), [(12.0, 0.4), (-12.0, 0.4), (12.0, 1.7)])
def test_without_a_rate_no_boat_gains_a_turn_at_once(step: float, each_s: float, most: float, refused: bool) -> None:
    """A lively boat's 12 deg between two headings, and jumps soon after one another, were taken for a turn."""
    offset, said = beside_no_rate(five_jumps(step, each_s), refused=refused, most_deg_s=most)
    assert offset == pytest.approx(5.0 * step, abs=2.5)
    assert said


@pytest.mark.parametrize("most", [20.0, 144.0])
@pytest.mark.parametrize("each_s", [0.4, 1.0])
def test_beside_a_gyro_no_jump_is_a_lively_boats_turn(each_s: float, most: float) -> None:
    offset, said = heard(five_jumps(12.0, each_s), seconds=40.0, dt=0.05, most_deg_s=most)
    assert offset == pytest.approx(60.0, abs=2.5)
    assert said


@pytest.mark.parametrize("refused", [False, True])
@pytest.mark.parametrize("dt", [0.1, 0.5, 1.0])
def test_without_a_rate_no_turn_of_the_boat_is_a_jump(dt: float, refused: bool) -> None:
    """Ramps of 28 deg/s to both sides."""

    def swung(now: float) -> float:
        return 28.0 * abs((now % 4.0) - 2.0)

    assert beside_no_rate(swung, refused=refused, dt=dt, seconds=120.0) == (0.0, [])


@pytest.mark.parametrize("noise_deg", [1.0, 2.0, 4.0])
@pytest.mark.parametrize("dt", [0.05, 0.1, 1.0])
def test_without_a_rate_noise_is_no_jump(noise_deg: float, dt: float) -> None:
    for seed in range(10):
        found = beside_no_rate(lambda _: 0.0, refused=False, seconds=120.0, dt=dt, noise_deg=noise_deg, seed=seed)
        assert found == (0.0, []), seed


def alone(
    shown: Callable[[float], float], most_deg_s: float, dt: float, noise_deg: float, seed: int
) -> tuple[float, list[str]]:
    """As `beside_no_rate`, of a boat that turns by `most_deg_s` at most: how far it is held to be off at the most, once
    it is known, and what is said."""
    random = np.random.default_rng(seed)

    def sample(now: float) -> HeadingSample:
        heading = math.radians(shown(now) + noise_deg * float(random.standard_normal()))
        return HeadingSample(now, wrap(heading), None, "c")

    known = list(after_each((sample(k * dt) for k in range(round(50.0 / dt))), math.radians(most_deg_s)))
    worst = max((abs(watch.held.offset) for watch, _ in known if math.isnan(watch.held.onset)), default=0.0)
    return math.degrees(worst), known[-1][1]


@pytest.mark.parametrize("most", [5.4, 11.4, 33.0])
@pytest.mark.parametrize("dt", [0.1, 0.2])
def test_without_a_rate_a_spike_of_any_size_leaves_nothing_held(dt: float, most: float) -> None:
    """What came back by a little less than it had jumped by was held for half a minute."""
    for seed in range(40):
        spike = 6.0 + 0.4 * seed

        def shown(now: float, spike: float = spike) -> float:
            return spike if 29.95 < now < 29.95 + dt else 0.0

        assert alone(shown, most, dt, 0.5, seed) == (0.0, []), spike


@pytest.mark.parametrize("most", [1.0, 5.4, 11.4, 33.0])
@pytest.mark.parametrize("dt", [0.1, 0.2, 0.5, 1.0])
@pytest.mark.parametrize("rate", [20.0, 25.0])
def test_without_a_rate_a_boat_that_is_swung_by_hand_is_not_held(rate: float, dt: float, most: float) -> None:
    """By a wave, too: it was taken for jumps, one on the other, and held by up to 179 deg."""
    for seed in range(8):
        begins = 30.0 + seed / 8.0

        def swung(now: float, begins: float = begins) -> float:
            return rate * min(max(now - begins, 0.0), 7.0)

        assert alone(swung, most, dt, 0.5, seed)[0] == 0.0, begins


@pytest.mark.parametrize("dt", [0.5, 1.0])
def test_without_a_rate_a_wake_is_not_held(dt: float) -> None:
    for seed in range(16):
        begins = 30.0 + seed / 16.0

        def rolled(now: float, begins: float = begins) -> float:
            return 8.0 * math.sin(1.8 * (now - begins)) if begins <= now < begins + 10.0 else 0.0

        assert alone(rolled, 1.0, dt, 0.3, seed)[0] == 0.0, begins


def test_a_turn_beside_a_rate_that_died_long_ago_is_given_back_soon() -> None:
    """What was held of the turn proved nothing against the rate, and the boat was carried 30 deg past its course."""
    limits, watch, most, random = (
        (math.radians(15.0), 0.6, math.radians(25.0)),
        Consistency(),
        0.0,
        np.random.default_rng(3),
    )
    for k in range(500):
        now = 0.1 * k
        rate = 0.01 * float(random.standard_normal()) if now < 20.0 else 0.0
        watch = consistency_step(watch, RateSample(now, rate, "gyro"), *limits)
        heading = math.radians(15.0 * min(max(now - 40.0, 0.0), 4.0) + 0.2 * float(random.standard_normal()))
        watch = consistency_step(watch, HeadingSample(now, heading, None, "c"), *limits)
        most = max(most, abs(watch.held.offset))
    assert math.degrees(most) < 15.0
    assert watch.found


def test_a_rate_that_ends_behind_a_jump_leaves_it_held() -> None:
    """Half a second after a jump the gyro fell silent, and the boat turned by the jump."""
    limits, watch = (math.radians(15.0), 2.0, math.radians(25.0)), Consistency()
    for k in range(100):
        now = 0.1 * k
        shown = math.radians(12.0 if now > 4.95 else 0.0)
        rate = 0.001 * (-1.0) ** k if now < 5.5 else None
        watch = consistency_step(watch, HeadingSample(now, shown, rate, "c"), *limits)
    assert math.degrees(watch.held.offset) == pytest.approx(12.0, abs=0.5)
    assert held_events(watch.held, now)


@pytest.mark.parametrize("odd", [math.nan, math.inf])
def test_a_heading_that_is_no_number_ends_no_hold(odd: float) -> None:
    offset, said = heard(lambda now: odd if abs(now - 5.0) < 0.01 else 20.0 if now >= 2.0 else 0.0, seconds=8.0)
    assert offset == pytest.approx(20.0, abs=1.5)
    assert len(said) == 1


@pytest.mark.parametrize("noise_deg", [1.0, 2.0, 3.0])
def test_noise_is_no_jump_from_the_first_minute_on(noise_deg: float) -> None:
    """What is usual was taken for nought at first: held by 12 deg for good behind noise of 2 deg."""
    for seed in range(20):
        assert heard(lambda _: 0.0, seconds=60.0, noise_deg=noise_deg, seed=seed) == (0.0, []), seed


def test_a_rate_that_comes_each_second_shows_a_quick_turn_late() -> None:
    """A boat that turns by 50 deg/s between two rates had jumped by 23 deg, and was held there."""
    limits, watch = (math.radians(15.0), 2.0, math.radians(25.0)), Consistency()
    for k in range(100):
        now = 0.1 * k
        rate = math.radians(50.0) if 5.45 < now < 7.0 else 0.0
        turned = math.radians(50.0 * (min(max(now, 5.45), 7.0) - 5.45))
        if k % 10 == 0:
            watch = consistency_step(watch, RateSample(now, rate, "gyro"), *limits)
        watch = consistency_step(watch, HeadingSample(now, turned, None, "c"), *limits)
        assert not held_events(watch.held, now)
        assert now < 6.0 or watch.held.offset == 0.0


@pytest.mark.parametrize("jump", [12.0, -20.0])
def test_a_jump_beside_a_rate_that_comes_each_second_is_held(jump: float) -> None:
    limits, watch = (math.radians(15.0), 2.0, math.radians(25.0)), Consistency()
    for k in range(100):
        now, rate = 0.1 * k, math.radians(2.0 * math.sin(0.08 * k))
        if k % 10 == 0:
            watch = consistency_step(watch, RateSample(now, rate, "gyro"), *limits)
        heading = math.radians(2.5 * (1.0 - math.cos(0.08 * k)) + (jump if now > 5.45 else 0.0))
        watch = consistency_step(watch, HeadingSample(now, heading, None, "c"), *limits)
    assert math.degrees(watch.held.offset) == pytest.approx(jump, abs=2.5)


def test_the_compass_is_followed_after_half_a_minute_slowly_and_at_once_where_nobody_steers() -> None:
    held = NOT_HELD._replace(offset=0.2, jumped=10.0, is_said=True)
    assert followed(held, 39.9, 0.1, True) == (held, 0.0)
    after, turn = followed(held, 40.0, 0.1, True)
    assert turn == pytest.approx(math.radians(0.025))
    assert after.offset == pytest.approx(0.2 - turn)
    assert followed(held, 11.0, 0.1, False) == (held._replace(offset=0.0), 0.2)
    settling = held._replace(onset=10.5, before=0.1)
    assert followed(settling, 11.0, 0.1, False) == (settling, 0.0)


def test_where_another_compass_takes_over_nothing_is_held_and_what_may_be_a_spike_counts_for_nothing() -> None:
    held = NOT_HELD._replace(offset=0.2, before=0.1, jumped=10.0, is_said=True)
    assert handed_over(Consistency(held=held)) == (Consistency(held=held._replace(offset=0.0)), 0.2)
    known, offset = handed_over(Consistency(held=held._replace(onset=10.5)))
    assert offset == 0.1
    assert known.held.offset == 0.0
    assert math.isnan(known.held.onset)


@pytest.mark.parametrize("rate_deg_s", [10.0, 0.5])
def test_a_rate_found_wrong_stays_so_by_another_compass_until_it_goes_with_the_headings(rate_deg_s: float) -> None:
    known, _ = handed_over(Consistency(found="20 deg apart", seen=100.0))
    rate, said = math.radians(rate_deg_s), []
    for number in range(250):
        time = 100.0 + 0.1 * number
        known = consistency_step(known, HeadingSample(time, 0.01 * (-1) ** number, rate, "other"), math.radians(10.0))
        said.append(bool(known.found))
    assert all(said[:190])
    assert said[-1] == (rate_deg_s == 10.0)


@pytest.mark.parametrize(("gap", "source"), [(2.5, "compass"), (0.1, "other")])
def test_for_how_long_headings_stood_is_forgotten_behind_a_gap(gap: float, source: str) -> None:
    """What stands there is another matter: as much wider was what a boat may have turned between two headings."""
    state = Consistency()
    for tick in range(50):
        state = consistency_step(state, HeadingSample(0.1 * tick, 0.3, 0.0, "compass"), 0.3, 1.0, 0.4)
    assert state.held.stood == pytest.approx(4.9)
    state = consistency_step(state, HeadingSample(4.9 + gap, 0.3, 0.0, source), 0.3, 1.0, 0.4)
    assert state.held.stood == 0.0
