"""Of two compasses the one that stands still or jumps alone is not believed; the other steers, and nothing bumps."""

from __future__ import annotations

import math
from collections.abc import Callable

import pytest

from autopilot.angles import wrap
from autopilot.estimation.source_priority import MONITOR, PrioritySettings, SourcePriority, SourceRule
from autopilot.signals import AlarmSample, HeadingSample, Sample

GYRO, FLUXGATE = "HEHDT", "HCHDG"
SETTINGS = PrioritySettings(
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

    def __init__(self, priority: SourcePriority | None = None) -> None:
        self.priority = priority or SourcePriority(SETTINGS)
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
                        self.said.append(sample.text)
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
    assert heard.said[-1].startswith("two compasses disagree: HEHDT stands still, HCHDG steers")
    # what passes never is further from the truth than the sea moved it meanwhile
    assert max(abs(wrap(sample.heading - swinging(sample.time))) for sample in heard.passed) < math.radians(4.5)
    heard.run(6.0, swinging, swinging)
    assert heard.sources_since(heard.now - 1.0) == {GYRO}, "well again, and settled"
    assert heard.said[-1] == ""


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
