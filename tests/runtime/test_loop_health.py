"""What the loop says of its own times: late ticks, and a wall clock that was set."""

from __future__ import annotations

from autopilot.runtime.machine import LATE_COUNT, LATE_WITHIN_S, SAID_S, LoopHealth
from autopilot.signals import ConditionSample, Mode, NavState, Order, Reference, RudderCommand, Sample, Tick

PERIOD = 0.05


class Times:
    """Clocks that a test sets."""

    def __init__(self) -> None:
        self.wall, self.running = 1.0e9, 50.0

    def go(self, seconds: float) -> None:
        self.wall += seconds
        self.running += seconds


def tick(now: float) -> Tick:
    state = NavState(now, 0.0, 0.0, 4.0, 0.0, 0.0, 0.0, True)
    return Tick(0, now, (), Order(), state, Reference(0.0), 0.0, RudderCommand(now, 0.0, False), Mode.STANDBY, ())


def conditions(samples: list[Sample]) -> list[tuple[str, bool]]:
    return [(sample.name, sample.present) for sample in samples if isinstance(sample, ConditionSample)]


def health(times: Times) -> LoopHealth:
    return LoopHealth(PERIOD, lambda: times.wall, lambda: times.running)


def test_several_late_ticks_are_reported_and_their_end_after_a_while() -> None:
    tested = health(Times())
    now = 0.0
    for _ in range(LATE_COUNT):
        for gap in (PERIOD, PERIOD, 3.5 * PERIOD):
            assert tested.receive(now) == []
            now += gap
            tested.publish_tick(tick(now))
    (sample,) = tested.receive(now)
    assert isinstance(sample, ConditionSample)
    assert (sample.name, sample.present) == ("deadline_missed", True)
    assert f"{LATE_COUNT} ticks" in sample.detail
    over = []
    while now < 2.0 * LATE_WITHIN_S:
        now += PERIOD
        tested.publish_tick(tick(now))
        over += conditions(tested.receive(now))
    assert over == [("deadline_missed", False)]


def test_a_late_tick_now_and_then_is_no_alarm() -> None:
    tested, now = health(Times()), 0.0
    for number in range(2000):
        now += 10.0 * PERIOD if number % 150 == 0 else PERIOD
        tested.publish_tick(tick(now))
        assert tested.receive(now) == []


def test_a_standstill_is_an_alarm_at_once() -> None:
    tested = health(Times())
    tested.publish_tick(tick(0.0))
    tested.publish_tick(tick(0.5))
    assert tested.receive(0.5) == []
    tested.publish_tick(tick(4.5))  # stopped and continued: the vehicle may have taken its rudder back
    (sample,) = tested.receive(4.5)
    assert isinstance(sample, ConditionSample)
    assert (sample.name, sample.present, sample.detail) == ("deadline_missed", True, "2 ticks late by up to 4.00 s")
    assert tested.receive(5.0) == []
    assert conditions(tested.receive(4.5 + LATE_WITHIN_S + PERIOD)) == [("deadline_missed", False)]


def test_a_clock_that_is_set_is_reported_for_a_minute_and_one_that_runs_is_not() -> None:
    times = Times()
    tested = health(times)
    for _ in range(100):
        times.go(1.0)
        assert tested.receive(0.0) == []
    times.wall += 3600.0
    times.go(1.0)
    (sample,) = tested.receive(0.0)
    assert isinstance(sample, ConditionSample)
    assert (sample.name, sample.present, sample.detail) == ("clock_stepped", True, "by +3600 s")
    over = []
    for _ in range(round(SAID_S) + 5):
        times.go(1.0)
        over += conditions(tested.receive(0.0))
    assert over == [("clock_stepped", False)]
