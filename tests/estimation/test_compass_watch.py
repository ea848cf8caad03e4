"""Of two compasses the one that stands still, jumps or trembles alone is not selected; and the other steers."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from alarm_texts import words

from autopilot.angles import wrap
from autopilot.estimation.compass_peers import CompassWatch
from autopilot.estimation.sensor_selection import MONITOR, SelectionSettings, SensorSelection, SourceRule
from autopilot.signals import AlarmSample, CompassSample, HeadingSample, Sample

GYRO, FLUXGATE = "HEHDT", "HCHDG"
SETTINGS = SelectionSettings(
    rules=(SourceRule(GYRO, 2.0), SourceRule("*", 2.0)),
    heading_stale=0.5,
    disagree=math.radians(15.0),
    jump=math.radians(25.0),
    frozen=True,
)


def swinging(now: float) -> float:
    """Two degrees to either side, as a sea does it."""
    return 1.0 + math.radians(2.0) * math.sin(now)


Compass = Callable[[float], float | None]


class Heard:
    """What passes of two compasses, ten headings a second each."""

    def __init__(self, priority: SensorSelection | None = None) -> None:
        self.priority = priority or SensorSelection(SETTINGS)
        self.now = 0.0
        self.passed: list[HeadingSample] = []
        self.said: list[str] = []

    def run(self, seconds: float, gyro: Compass, fluxgate: Compass) -> Heard:
        for _ in range(round(seconds / 0.1)):
            self.now = round(self.now + 0.1, 9)
            for source, compass, late in ((GYRO, gyro, 0.0), (FLUXGATE, fluxgate, 0.03)):
                heading = compass(self.now + late)
                samples: list[Sample] = []
                if heading is not None:
                    samples.append(HeadingSample(self.now + late, wrap(heading), None, source))
                for sample in self.priority.admit(self.now + late, samples, "line"):
                    if isinstance(sample, HeadingSample):
                        self.passed.append(sample)
                    elif isinstance(sample, AlarmSample):
                        assert sample.source == MONITOR
                        self.said.append(words(sample.event))
        return self

    def sources_since(self, begin: float) -> set[str]:
        return {sample.source for sample in self.passed if sample.time > begin}


def test_while_both_are_well_the_first_steers_and_nothing_is_said() -> None:
    heard = Heard().run(60.0, swinging, lambda now: swinging(now) + 0.05)
    assert heard.sources_since(0.0) == {GYRO}
    assert heard.said == []


def test_one_that_stands_still_while_the_other_turns_is_left() -> None:
    heard = Heard().run(10.0, swinging, swinging)
    held = swinging(10.0)
    heard.run(6.0, lambda now: held, swinging)
    assert heard.sources_since(15.0) == {FLUXGATE}
    assert heard.said[-1].startswith("heading monitor: two compasses disagree: HEHDT stands still, HCHDG steers")
    # what passes never is further from the truth than the sea moved it meanwhile
    assert max(abs(wrap(sample.heading - swinging(sample.time))) for sample in heard.passed) < math.radians(4.5)
    heard.run(6.0, swinging, swinging)
    assert heard.sources_since(heard.now - 1.0) == {GYRO}, "well again, and settled"
    assert heard.said[-1] == ""


def in_flat_water(noise_deg: float, digit_deg: float, seed: int) -> Compass:
    """On a course."""
    random = np.random.default_rng(seed)
    return lambda _: math.radians(digit_deg * round((57.0 + noise_deg * float(random.standard_normal())) / digit_deg))


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_in_flat_water_one_that_stands_though_it_trembled_is_left_before_the_fail_safe(seed: int) -> None:
    """The other has not turned, which shows nothing; the pilot's own watch ends steering after 3 s."""
    other = in_flat_water(0.3, 0.1, seed + 10)
    heard = Heard().run(30.0, in_flat_water(0.3, 0.1, seed), other)
    held = math.radians(57.1)
    heard.run(3.0, lambda now: held, other)
    assert heard.sources_since(32.3) == {FLUXGATE}
    assert "HEHDT stands still, HCHDG steers" in heard.said[-1]


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_of_two_that_freeze_together_in_flat_water_neither_is_left_for_the_other(seed: int) -> None:
    """They are not in step: the second says one new heading more, and then the same for ever."""
    heard = Heard().run(30.0, in_flat_water(0.3, 0.1, seed), in_flat_water(0.3, 0.1, seed + 10))
    last = iter([math.radians(56.8)])
    heard.run(6.0, lambda now: math.radians(57.1), lambda now: next(last, math.radians(57.4)))
    assert heard.said == []


@pytest.mark.parametrize(("noise_deg", "digit_deg"), [(0.05, 0.1), (0.1, 0.1), (0.3, 1.0), (0.2, 0.5)])
def test_in_flat_water_one_whose_digits_hide_its_noise_may_stand(noise_deg: float, digit_deg: float) -> None:
    other = in_flat_water(0.3, 0.1, 2)
    assert Heard().run(200.0, in_flat_water(noise_deg, digit_deg, 1), other).said == []


def test_one_that_jumps_alone_is_left_before_its_first_jump_passes() -> None:
    heard = Heard().run(10.0, swinging, swinging)
    heard.run(12.0, lambda now: swinging(now) + 0.7, swinging)
    assert heard.sources_since(10.15) == {FLUXGATE}
    assert max(abs(wrap(sample.heading - swinging(sample.time))) for sample in heard.passed) < 1.0e-6
    assert "HEHDT jumps" in heard.said[-1]


def test_one_that_is_lost_is_followed_by_the_other() -> None:
    heard = Heard().run(10.0, swinging, swinging).run(3.0, lambda now: None, swinging)
    assert heard.sources_since(10.7) == {FLUXGATE}
    assert heard.said[-1].startswith("one of two compasses is silent: HEHDT; HCHDG steers")
    heard.run(1.0, swinging, swinging)
    assert heard.said[-1] == ""


def test_the_second_that_fails_is_said_and_not_gone_over_to() -> None:
    heard = Heard().run(10.0, swinging, swinging).run(6.0, swinging, lambda now: 1.0)
    assert heard.sources_since(0.0) == {GYRO}
    assert "HCHDG stands still, HEHDT steers" in heard.said[-1]
    heard.run(3.0, lambda now: None, lambda now: 1.0)
    assert heard.sources_since(16.1) == set(), "a compass that stands still is none"


@pytest.mark.parametrize("digit_deg", [0.1, 1.0, 5.0])
def test_two_coarse_ones_on_a_straight_course_are_well(digit_deg: float) -> None:
    def coarse(now: float) -> float:
        return math.radians(round(math.degrees(1.0 + 0.004 * math.sin(0.2 * now)) / digit_deg) * digit_deg)

    heard = Heard().run(60.0, coarse, lambda now: 1.0 + 0.004 * math.sin(0.2 * now))
    assert heard.said == []


def test_a_boat_that_turns_fast_is_not_one_compass_s_fault() -> None:
    heard = Heard().run(20.0, lambda now: 0.8 * now, lambda now: 0.8 * now)
    assert heard.said == []


def test_one_that_was_switched_off_and_on_begins_anew() -> None:
    heard = Heard().run(10.0, swinging, swinging).run(5.0, lambda now: swinging(now) + 0.7, swinging)
    heard.run(3.0, lambda now: None, swinging).run(6.0, swinging, swinging)
    assert heard.sources_since(heard.now - 1.0) == {GYRO}


def heard_by(jump: float = 0.4, *, frozen: bool = True) -> CompassWatch:
    """Two compasses that have swung together for three seconds, ten headings a second, the second 0.05 s later."""
    watch = CompassWatch(jump, frozen=frozen)
    for step in range(31):
        watch.on_sample(0.1 * step, "a", 0.001 * (step % 2))
        watch.on_sample(0.1 * step + 0.05, "b", 0.001 * (step % 2))
    return watch


@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.parametrize(("by", "is_left"), [(0.399, False), (0.4, False), (0.402, True), (3.0, True)])
def test_a_compass_jumps_that_goes_further_than_a_boat_while_the_other_stays(
    side: float, by: float, is_left: bool
) -> None:
    watch = heard_by()
    watch.on_sample(3.1, "a", side * by)
    assert watch.reason("a") == ("jumps" if is_left else "") and watch.reason("b") == ""
    assert watch.doubted(3.1) == ([("a", "jumps")] if is_left else [])


@pytest.mark.parametrize(("silence", "is_left"), [(0.9, True), (1.1, False)])
def test_nobody_who_was_silent_for_a_second_says_that_another_jumps(silence: float, is_left: bool) -> None:
    watch = heard_by()
    for step in range(1, 20):
        if 0.1 * step < silence:
            watch.on_sample(3.05 + 0.1 * step, "a", 0.001 * (step % 2))
    watch.on_sample(3.05 + silence, "a", 0.8)
    assert bool(watch.reason("a")) is is_left


def test_a_compass_that_jumps_to_the_others_is_no_fault() -> None:
    watch = heard_by()
    watch.on_sample(3.1, "a", 0.8)
    assert watch.reason("a") == "jumps"
    watch.on_sample(3.15, "b", 0.8)
    assert watch.reason("b") == "", "there is no other to select"
    other = CompassWatch(0.4, frozen=True)
    for step in range(5):
        other.on_sample(0.1 * step, "a", 0.9)
        other.on_sample(0.1 * step + 0.05, "b", 0.0)
    other.on_sample(0.5, "b", 0.85)
    assert other.reason("b") == "", "it came to where the other is"


@pytest.mark.parametrize(("turned_deg", "is_left"), [(2.4, False), (2.6, True)])
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_compass_stands_that_does_not_go_with_a_turn_of_two_and_a_half_degrees(
    side: float, turned_deg: float, is_left: bool
) -> None:
    for frozen in (True, False):
        watch = heard_by(frozen=frozen)
        for step in range(1, 21):
            watch.on_sample(3.0 + 0.1 * step, "a", 0.0)
            watch.on_sample(3.05 + 0.1 * step, "b", side * math.radians(turned_deg) * step / 20)
        watch.on_sample(5.1, "a", 0.0)
        assert watch.reason("a") == ("stands still" if is_left and frozen else "")
        assert watch.reason("b") == ""


@pytest.mark.parametrize(
    ("gap", "headings", "is_left"),
    [(0.2, 3, False), (0.2, 4, True), (0.09, 4, False), (0.09, 5, True), (0.02, 14, False), (0.02, 17, True)],
)
def test_it_stands_with_four_headings_alike_and_over_three_tenths_of_a_second(
    gap: float, headings: int, is_left: bool
) -> None:
    watch = CompassWatch(math.inf, frozen=True)
    watch.on_sample(0.0, "a", 1.0)
    watch.on_sample(0.01, "b", 1.0)
    watch.on_sample(0.1, "a", 1.001)
    for step in range(headings):
        watch.on_sample(0.15 + gap * step, "b", 1.0 + 0.2 * step)
        watch.on_sample(0.16 + gap * step, "a", 1.002)
    assert bool(watch.reason("a")) is is_left


@pytest.mark.parametrize(("turned_deg", "is_left"), [(9.8, False), (10.2, True)])
def test_a_compass_of_five_degree_steps_may_stand_while_the_boat_turns_by_two_of_them(
    turned_deg: float, is_left: bool
) -> None:
    watch = CompassWatch(math.inf, frozen=True)
    for step in range(6):
        watch.on_sample(0.1 * step, "a", math.radians(5.0 * (step % 2)))
        watch.on_sample(0.1 * step + 0.05, "b", 0.0001 * step)
    for step in range(6, 30):
        watch.on_sample(0.1 * step, "a", math.radians(5.0))
        watch.on_sample(0.1 * step + 0.05, "b", math.radians(turned_deg) * (step - 6) / 23)
    watch.on_sample(3.0, "a", math.radians(5.0))
    assert bool(watch.reason("a")) is is_left


@pytest.mark.parametrize(("apart_deg", "seconds", "is_well"), [(9.9, 3.3, True), (9.9, 2.8, False), (10.1, 9.0, False)])
def test_it_is_well_again_within_ten_degrees_of_the_other_for_three_seconds(
    apart_deg: float, seconds: float, is_well: bool
) -> None:
    watch = heard_by()
    watch.on_sample(3.1, "a", 0.8)
    for step in range(1, round(seconds * 10) + 1):
        watch.on_sample(3.05 + 0.1 * step, "b", 0.001 * (step % 2))
        watch.on_sample(3.1 + 0.1 * step, "a", math.radians(apart_deg) + 0.001 * (step % 2))
    assert (watch.reason("a") == "") is is_well


@pytest.mark.parametrize(("last", "is_well"), [(2.875, False), (3.0, True)])
def test_ten_degrees_and_three_seconds_to_the_bit_are_enough_to_be_well(last: float, is_well: bool) -> None:
    watch = CompassWatch(0.4, frozen=True)
    for now in (0.0, 0.125, 0.25):
        watch.on_sample(now, "b", 0.0)
        watch.on_sample(now, "a", 0.8 * (now == 0.25))
    for step in range(1, round(last / 0.125) + 2):
        watch.on_sample(0.25 + 0.125 * step, "b", 0.0)
        watch.on_sample(0.25 + 0.125 * step, "a", math.radians(10.0) - 0.001 * (step % 2))
    assert (watch.reason("a") == "") is is_well
    watch.on_sample(0.375 + last + 0.2, "b", 0.0)
    watch.on_sample(0.375 + last + 0.2, "a", 0.1)
    assert watch.reason("a") == ""
    watch.on_sample(4.0, "a", 0.8)
    for step in range(1, 33):
        watch.on_sample(4.0 + 0.125 * step, "b", 0.0)
        watch.on_sample(4.0 + 0.125 * step, "a", 0.001 * (step // 4))
    assert watch.reason("a") == "jumps", "four headings alike are no agreement"


def is_left_standing(first: float, other: float, last: float) -> bool:
    """Whether a compass is left that shows `first`, and from then on 0 until `last` [s], the other one having turned to
    `other` [rad]."""
    watch = CompassWatch(math.inf, frozen=True)
    watch.on_sample(-0.5, "a", first)
    watch.on_sample(-0.1, "b", 0.0)
    for now in (0.0, 0.1, 0.2):
        watch.on_sample(now, "a", 0.0)
    watch.on_sample(0.25, "b", other)
    watch.on_sample(last, "a", 0.0)
    return bool(watch.reason("a"))


def test_a_turn_of_two_and_a_half_degrees_to_the_bit_may_still_be_stood_through() -> None:
    assert not is_left_standing(0.001, math.radians(2.5), 0.5)
    assert is_left_standing(0.001, math.radians(2.5) + 1.0e-9, 0.5)


def test_a_word_of_one_second_age_still_counts_and_the_middle_between_two_headings_is_neither() -> None:
    for other, reason in ((0.0, "jumps"), (0.3, "jumps"), (0.4, ""), (0.5, "")):
        watch = CompassWatch(0.4, frozen=True)
        watch.on_sample(0.0, "b", other)
        watch.on_sample(0.5, "a", 0.0)
        watch.on_sample(1.0, "a", 0.8)
        assert watch.reason("a") == reason


def test_a_compass_that_stands_while_another_turns_is_frozen_after_0_3_s() -> None:
    assert not is_left_standing(0.1, 0.5, 0.2999)
    assert is_left_standing(0.1, 0.5, 0.3)


def test_a_standing_compass_that_agrees_stays_distrusted() -> None:
    watch = heard_by()
    watch.on_sample(3.1, "a", 0.8)
    for step in range(1, 90):
        watch.on_sample(3.05 + 0.1 * step, "b", 0.001 * (step % 2))
        watch.on_sample(3.1 + 0.1 * step, "a", 0.0)
    assert watch.reason("a") == "jumps"


@pytest.mark.parametrize(("silence", "is_new"), [(2.0, False), (2.1, True)])
def test_one_that_was_silent_for_two_seconds_begins_anew_and_is_not_spoken_of(silence: float, is_new: bool) -> None:
    watch = heard_by()
    watch.on_sample(4.0, "a", 0.8)
    assert bool(watch.doubted(4.0 + silence)) is (silence <= 2.0)
    watch.on_sample(4.0 + silence, "a", 0.8)
    assert (watch.reason("a") == "") is is_new
    watch.reset()
    assert watch.reason("a") == watch.reason("nobody") == "" and watch.doubted(4.0) == []


def noisy(sigma_deg: float, begins: float = 0.0, ends: float = math.inf, seed: int = 1) -> Callable[[float], float]:
    random = np.random.default_rng(seed)

    def heading(now: float) -> float:
        noise = math.radians(sigma_deg) * random.standard_normal()
        return swinging(now) + (noise if begins < now < ends else 0.0)

    return heading


def watched(
    seconds: float, step: float, first: Callable[[float], float], second: Callable[[float], float]
) -> list[str]:
    """Return what is wrong with the first compass, a word for each of its headings; of the second nothing ever is."""
    watch, found = CompassWatch(math.radians(60.0), frozen=True), []
    for number in range(round(seconds / step)):
        watch.on_sample(number * step, "first", first(number * step))
        watch.on_sample(number * step + 0.01, "second", second(number * step + 0.01))
        found.append(watch.reason("first"))
        assert watch.reason("second") == ""
    return found


@pytest.mark.parametrize("seed", range(5))
def test_a_compass_that_trembles_alone_is_noisy_within_three_seconds(seed: int) -> None:
    """One of 10 deg was believed until its jumps had added up to a fail-safe, with a good one beside it."""
    found = watched(17.0, 0.1, noisy(10.0, 5.0, 10.0, seed), noisy(0.5, seed=seed + 100))
    assert set(found[:50]) == {""}
    assert set(found[75:100]) == {"is noisy"}
    assert found[128] == "is noisy"
    assert found[-1] == "", "well again when it has agreed for 3 s"


@pytest.mark.parametrize("seed", range(5))
def test_two_degrees_of_noise_are_an_ordinary_compass_s(seed: int) -> None:
    assert set(watched(60.0, 0.1, noisy(2.0, seed=seed), noisy(0.5, seed=seed + 100))) == {""}


def trembling(deg: float) -> Callable[[float], float]:
    """To and fro by so much with each heading: by second differences white noise of 4/sqrt(12/pi) = 2.05 times that."""
    return lambda now: swinging(now) + math.radians(deg) * (-1) ** round(10.0 * now)


@pytest.mark.parametrize(("first", "second", "said"), [(1.9, 0.5, ""), (2.05, 0.5, "is noisy"), (5.0, 0.9, "is noisy")])
def test_noisy_is_more_than_four_degrees_beside_less_than_two(first: float, second: float, said: str) -> None:
    assert watched(30.0, 0.1, trembling(first), trembling(second))[-1] == said
    assert watched(30.0, 0.1, trembling(5.0), trembling(1.05))[-1] == ""


@pytest.mark.parametrize("by_deg", [15.0, -30.0, 50.0])
@pytest.mark.parametrize("lasts", [0.1, 20.0])
def test_one_jump_or_spike_is_no_noise(by_deg: float, lasts: float) -> None:
    def jumps(now: float) -> float:
        return swinging(now) + (math.radians(by_deg) if 4.95 < now < 4.95 + lasts else 0.0)

    assert set(watched(10.0, 0.1, jumps, noisy(0.5))) == {""}


@pytest.mark.parametrize("step", [0.1, 0.5, 1.0])
def test_a_swing_that_both_compasses_show_distrusts_neither(step: float) -> None:
    """A launch in a sea of two seconds: once a second a compass sees it swing to and fro."""

    def swings(now: float) -> float:
        return math.radians(12.0) * math.sin(math.pi * now + 0.7)

    assert set(watched(60.0, step, swings, swings)) == {""}


def test_two_that_tremble_alike_tell_nothing() -> None:
    assert set(watched(30.0, 0.1, noisy(8.0, seed=1), noisy(8.0, seed=2))) == {""}


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(
    ("known", "longest", "turned_deg", "stands", "is_reported"),
    [
        (100, 1, 1.01, 11, True),
        (100, 1, 1.01, 10, False),  # not for 1.2 s
        (100, 1, 0.99, 60, False),  # the other does not turn either
        (50, 1, 1.01, 11, False),  # too little is known of it
        (100, 8, 1.01, 32, True),
        (100, 8, 1.01, 31, False),  # it often stands for as long
        (100, 8, 2.51, 4, True),  # whatever its habits, the other has turned far
    ],
)
def test_a_compass_that_never_stood_so_long_is_frozen_while_another_turns_a_degree(
    sign: float, known: int, longest: int, turned_deg: float, stands: int, is_reported: bool
) -> None:
    watch, now = CompassWatch(math.inf, frozen=True), 0.0
    for number in range(known):
        now += 0.125
        watch.on_sample(now, GYRO, math.radians(0.1) * (number // longest))
        watch.on_sample(now, FLUXGATE, 0.0)
    last = math.radians(0.1) * (known // longest + 1)
    for _ in range(stands):
        now += 0.125
        watch.on_sample(now, GYRO, last)
        # the other is where it was when this one began to stand, and then elsewhere
        watch.on_sample(now, FLUXGATE, sign * math.radians(turned_deg))
    assert watch.reason(GYRO) == ("stands still" if is_reported else "")


@pytest.mark.parametrize(("hz", "within"), [(1.0, 3.1), (2.0, 2.1), (5.0, 1.3), (10.0, 1.3), (20.0, 1.3)])
@pytest.mark.parametrize("seed", range(3))
def test_one_that_freezes_is_left_within_seconds_at_any_pace(hz: float, within: float, seed: int) -> None:
    """The boat turns by 2 deg/s meanwhile; it took up to 3 s at 2 Hz."""
    random = np.random.default_rng((20261129, seed))

    def shown(now: float) -> float:
        turn = math.radians(2.0) * max(now - 90.0, 0.0)
        return turn + math.radians(0.2) * float(random.standard_normal())

    watch, held = CompassWatch(math.inf, frozen=True), 0.0
    for number in range(round(95.0 * hz)):
        now = number / hz
        held = shown(now) if now <= 90.0 else held
        watch.on_sample(now, GYRO, held)
        watch.on_sample(now, FLUXGATE, shown(now))
        if watch.reason(GYRO):
            break
    assert watch.reason(GYRO) == "stands still"
    assert 0.3 <= now - 90.0 <= within


@pytest.mark.parametrize("hz", [1.0, 5.0, 10.0])
@pytest.mark.parametrize(("digit_deg", "noise_deg"), [(0.0, 0.1), (0.1, 0.1), (0.5, 0.2), (1.0, 0.3)])
def test_beside_a_noisy_compass_a_quiet_one_may_repeat_itself(hz: float, digit_deg: float, noise_deg: float) -> None:
    """Each third of a degree of the other is noise: 2.5 deg of it was taken for a turn."""
    random, watch = np.random.default_rng(20261129), CompassWatch(math.inf, frozen=True)
    for number in range(round(1800.0 * hz)):
        now = number / hz
        quiet = 1.0 * math.sin(0.3 * now) + noise_deg * float(random.standard_normal())
        quiet = digit_deg * round(quiet / digit_deg) if digit_deg else quiet
        watch.on_sample(now, GYRO, math.radians(quiet))
        watch.on_sample(now, FLUXGATE, math.radians(math.sin(0.3 * now) + 1.2 * float(random.standard_normal())))
        assert watch.reason(GYRO) == "", now


def test_a_compass_that_freezes_time_and_again_is_gone_back_to_ever_later() -> None:
    heard, back = Heard().run(30.0, noisy(0.2), noisy(0.2, seed=2)), list[float]()
    for _ in range(6):
        held = swinging(heard.now)
        heard.run(3.0, lambda _, held=held: held, noisy(0.2, seed=3))  # type: ignore[misc]
        begin = heard.now
        heard.run(6.0, noisy(0.2, seed=4), noisy(0.2, seed=5))
        back.append(sum(sample.source == GYRO for sample in heard.passed if sample.time > begin))
    assert back[0] > 0, "once is an accident"
    assert back[1:] == [0] * 5
    assert heard.run(70.0, noisy(0.2), noisy(0.2, seed=2)).sources_since(heard.now - 1.0) == {GYRO}


def parted(
    drift_deg_s: float, *, gyro_deg_s: float = 0.0, of: str = GYRO, gyro_of: str = GYRO, seconds: float = 30.0
) -> tuple[list[str], float, set[str]]:
    """What is said of two compasses of which one drifts from 60 s on, and how far [rad] what is held is turned; a gyro,
    off by gyro_deg_s, comes with the headings of one, and a pilot holds the course by the compass that steers."""
    random, priority = np.random.default_rng(20261129), SensorSelection(SETTINGS)
    said, turned, true, steers, course = list[str](), 0.0, 0.0, GYRO, 0.0
    for number in range(round((60.0 + seconds) * 10.0)):
        now = 0.1 * number
        drifted = math.radians(drift_deg_s) * max(now - 60.0, 0.0)
        shows = {name: drifted * (name == of) + (0.05 if name == FLUXGATE else 0.0) for name in (GYRO, FLUXGATE)}
        # the boat is turned until the compass that steers shows the course
        rate = 0.5 * wrap(course - true - shows[steers])
        true += rate * 0.1
        for name in (GYRO, FLUXGATE):
            noise = random.standard_normal(2)
            shown = wrap(true + shows[name] + math.radians(0.3) * float(noise[0]))
            measured = rate + math.radians(gyro_deg_s + 0.2 * float(noise[1]))
            sample = HeadingSample(now, shown, measured if name == gyro_of else None, name)
            for each in priority.admit(now, [sample], "line"):
                if isinstance(each, CompassSample):
                    turned, steers = turned + each.turn, each.source.partition("@")[0]
                    course += each.turn
                elif isinstance(each, AlarmSample):
                    said.append(words(each.event))
    return said, turned, {steers}


@pytest.mark.parametrize("gyro_deg_s", [-0.3, 0.0, 0.3])
@pytest.mark.parametrize("drift_deg_s", [-5.0, -2.0, 2.0, 5.0])
def test_of_two_that_part_the_one_that_contradicts_its_gyro_is_left(drift_deg_s: float, gyro_deg_s: float) -> None:
    """It was followed, 200 deg off, for nobody knew which of the two drifts. The course is that of before."""
    said, turned, steers = parted(drift_deg_s, gyro_deg_s=gyro_deg_s)
    assert any("HEHDT drifts, HCHDG steers" in each for each in said)
    assert steers == {FLUXGATE}
    assert math.degrees(abs(wrap(turned - 0.05))) < 8.0, "not where the compass led to: 15 to 30 deg off"


@pytest.mark.parametrize(("of", "gyro_of"), [(FLUXGATE, GYRO), (GYRO, FLUXGATE)])
def test_a_gyro_says_nothing_against_the_compass_of_another(of: str, gyro_of: str) -> None:
    """A heading that its gyro carries on goes with it, however wrong that is."""
    said, _, steers = parted(2.0, of=of, gyro_of=gyro_of)
    assert steers == {GYRO} and not any("drifts" in each for each in said)
    assert "two compasses disagree" in said[-1]


@pytest.mark.parametrize("gyro_deg_s", [-10.0, 10.0])
@pytest.mark.parametrize("drift_deg_s", [-1.0, 1.0, 2.0, 5.0])
def test_a_gyro_that_contradicts_both_compasses_accuses_neither(drift_deg_s: float, gyro_deg_s: float) -> None:
    """The right one was left for the one that drifts, by the word of a gyro that had been found wrong before."""
    said, _, steers = parted(drift_deg_s, gyro_deg_s=gyro_deg_s, of=FLUXGATE)
    assert steers == {GYRO} and not any("drifts" in each for each in said)
    assert "two compasses disagree" in said[-1]


@pytest.mark.parametrize("gyro_deg_s", [-5.0, 1.0, 5.0])
def test_of_two_that_go_together_none_drifts_whatever_a_gyro_says(gyro_deg_s: float) -> None:
    said, _, steers = parted(0.0, gyro_deg_s=gyro_deg_s, seconds=60.0)
    assert said == [] and steers == {GYRO}


def test_a_compass_that_has_failed_for_days_is_gone_back_to_after_a_minute() -> None:
    watch = CompassWatch(math.inf, frozen=True)
    for name in (GYRO, FLUXGATE):
        watch.on_sample(0.0, name, 0.0)
    watch.accuse(GYRO)
    watch._compasses[GYRO].failed = 2000
    back = 0.0
    for number in range(1, 700):
        for name in (GYRO, FLUXGATE):
            watch.on_sample(0.1 * number, name, 0.001 * (number % 2))
        back = back or (0.1 * number if not watch.reason(GYRO) else 0.0)
    assert 59.0 <= back <= 62.0
