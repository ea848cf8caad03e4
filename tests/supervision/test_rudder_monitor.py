"""The monitor of a measured rudder, angle by angle: stuck anywhere, slow, going the wrong way, or right."""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise
from random import Random

import pytest
from watches import Following

from autopilot.models.norrbin import Norrbin
from autopilot.signals import NavState, RudderSample
from autopilot.supervision.monitor_input import AlarmLimits, MonitorInput
from autopilot.supervision.tuning import ASSUMED_RATE, PROGRESS_SHARE

LIMITS = AlarmLimits(rudder_tolerance=math.radians(5.0), rudder_rate=math.radians(20.0), rudder_delay=0.1)
BOAT = Norrbin(0.2, 2.0, reference_speed=4.0)
STATE = NavState(0.0, 0.0, 0.0, 4.6, 0.0, 0.0, 0.0, True)


def seen(order: Callable[[float], float], angle: Callable[[float], float], seconds: float = 8.0) -> tuple[str, float]:
    """What was found, and when [s]; orders and angles in degrees."""
    monitor = Following(LIMITS)
    for step in range(round(seconds / 0.1)):
        now = 0.1 * step
        monitor.on_sample(RudderSample(now, math.radians(angle(now)), False, "RSA"))
        commanded = math.radians(order(now))
        monitor.update(MonitorInput(now, BOAT, STATE, True, True, 0.0, commanded, 0.6, True))
        if monitor.found:
            return monitor.found, now
    return "", math.inf


@pytest.mark.parametrize("at", [-25.0, -10.0, 0.0, 10.0, 25.0])
@pytest.mark.parametrize("away", [-12.0, 12.0])
def test_a_rudder_that_stands_is_stuck_wherever_it_stands_and_said_within_three_seconds(at: float, away: float) -> None:
    kind, when = seen(lambda now: at + away if now > 1.0 else at, lambda now: at)
    assert kind == "rudder_stuck"
    assert when - 1.0 <= 3.0


@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.parametrize("offset", [-15.0, 0.0, 15.0])
def test_a_rudder_that_goes_to_the_other_side_is_reversed(side: float, offset: float) -> None:
    kind, when = seen(
        lambda now: offset + (side * 12.0 if now > 1.0 else 0.0),
        lambda now: offset - side * min(max(now - 1.1, 0.0) * 20.0, 12.0),
    )
    assert kind == "rudder_reversed"
    assert when - 1.0 <= 1.5


@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.parametrize("pace", [0.5, 1.0, 1.5])
def test_a_sensor_that_is_off_goes_with_its_orders_and_is_not_reversed(pace: float, side: float) -> None:
    def order(now: float) -> float:
        return side * 10.0 * math.sin(pace * now)

    assert seen(order, lambda now: 8.0 + order(max(now - 0.1, 0.0)), 12.0)[0] == "rudder_not_following"
    assert seen(order, lambda now: 8.0 - order(max(now - 0.1, 0.0)), 12.0)[0] != ""


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_rudder_that_creeps_does_not_follow(side: float) -> None:
    kind, _ = seen(lambda now: side * 20.0, lambda now: side * 0.8 * now)
    assert kind == "rudder_not_following"


@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.parametrize("start", [-20.0, 0.0, 20.0])
def test_a_rudder_on_its_way_is_none_of_them(side: float, start: float) -> None:
    order = start + side * 25.0
    assert seen(lambda now: order, lambda now: start + side * min(8.0 * now, 25.0)) == ("", math.inf)
    assert seen(lambda now: start + 4.0 * side, lambda now: start) == ("", math.inf), "within what the file tolerates"


@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.parametrize(
    ("share", "seconds", "is_slow"),
    [(0.45, 2.4, True), (0.45, 2.0, False), (0.48, 4.0, True), (0.52, 4.0, False), (1.0, 4.0, False)],
)
def test_less_than_half_of_the_filed_rate_for_two_seconds_is_slow(
    side: float, share: float, seconds: float, is_slow: bool
) -> None:
    monitor = Following(LIMITS)
    for step in range(round(seconds / 0.1) + 1):
        now = 0.1 * step
        monitor.on_sample(RudderSample(now, side * share * LIMITS.rudder_rate * now, False, "RSA"))
        monitor.update(MonitorInput(now, BOAT, STATE, True, True, 0.0, side * math.radians(200.0), 0.6, True))
    assert monitor.found == ""
    assert monitor.is_slow is is_slow


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_rudder_is_slow_by_the_rate_that_is_filed_to_that_side(side: float) -> None:
    """To port it is filed twice as quick: what half of the slower rate is to starboard is a quarter to port."""
    monitor, share = Following(LIMITS._replace(rudder_sides=(2.0, 1.0))), 0.6
    for step in range(41):
        now = 0.1 * step
        monitor.on_sample(RudderSample(now, side * share * LIMITS.rudder_rate * now, False, "RSA"))
        monitor.update(MonitorInput(now, BOAT, STATE, True, True, 0.0, side * math.radians(200.0), 0.6, True))
    measured = pytest.approx(share * LIMITS.rudder_rate, rel=0.06)
    assert monitor.value.following.slow == ((measured, math.inf) if side < 0.0 else (math.inf, math.inf))


@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.parametrize("pace", [0.7, 1.0, 1.5])
def test_no_turn_is_planned_with_less_than_a_rudder_s_progress(side: float, pace: float) -> None:
    """A sensor that is off by more than is tolerated comes and goes with the sea's orders, and gains nothing."""
    monitor, slow = Following(LIMITS), math.inf
    for step in range(600):
        now = 0.1 * step
        order = 8.0 * math.sin(pace * now)
        shown = 8.0 * math.sin(pace * (now - 0.1)) + side * 6.0 if now > 0.1 else side * 6.0
        monitor.on_sample(RudderSample(now, math.radians(shown), False, "RSA"))
        monitor.update(MonitorInput(now, BOAT, STATE, True, True, 0.0, math.radians(order), 0.6, True))
        slow = min(slow, *monitor.value.following.slow)
    assert slow < 0.5 * LIMITS.rudder_rate
    assert slow >= PROGRESS_SHARE * ASSUMED_RATE


@pytest.mark.parametrize(("seconds", "is_slow"), [(2.0, False), (2.4, True)])
def test_what_a_rudder_did_before_it_was_where_it_was_ordered_says_nothing(seconds: float, is_slow: bool) -> None:
    """Four seconds on its order, then slowly to another."""
    monitor = Following(LIMITS)
    for step in range(41 + round(seconds / 0.1)):
        now, since = 0.1 * step, max(0.1 * (step - 40), 0.0)
        monitor.on_sample(RudderSample(now, 0.3 * LIMITS.rudder_rate * since, False, "RSA"))
        order = 0.0 if step < 40 else math.radians(200.0)
        monitor.update(MonitorInput(now, BOAT, STATE, True, True, 0.0, order, 0.6, True))
    assert monitor.is_slow is is_slow


def test_a_rudder_of_unknown_rate_is_never_slow() -> None:
    monitor = Following(LIMITS._replace(rudder_rate=math.inf))
    for step in range(60):
        monitor.on_sample(RudderSample(0.1 * step, math.radians(0.3 * step), False, "RSA"))
        at = MonitorInput(0.1 * step, BOAT, STATE, True, True, 0.0, math.radians(100.0), 0.6, True)
        monitor.update(at)
    assert not monitor.is_slow


@pytest.mark.parametrize(("late", "name"), [(True, ""), (False, "rudder_reversed")])
def test_a_rudder_that_ran_on_past_its_order_in_a_late_tick_is_not_reversed(late: bool, name: str) -> None:
    """A motor whose speed is ordered: it runs until the next order comes, and is brought back then."""
    monitor = Following(LIMITS)
    for now, angle in [(0.1, 0.0), (0.2, 2.0), (0.3, 4.0), (0.8, 14.0), (0.85, 15.0), (0.95, 13.0), (1.05, 11.0)]:
        monitor.on_sample(RudderSample(now, math.radians(angle), False, "pypilot"))
        at = MonitorInput(now, BOAT, STATE, True, True, 0.0, math.radians(2.0), 0.6, True)
        monitor.update(at._replace(is_late=late and now == 0.8))
    assert monitor.found == name


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_reversed_rudder_is_found_when_a_late_tick_is_over(side: float) -> None:
    monitor = Following(LIMITS)
    for now in (0.1, 0.2, 0.7, 0.8, 0.9, 1.0, 1.1, 1.2, 1.3, 1.4, 1.5, 1.6, 1.7, 1.8, 1.9, 2.0, 2.1):
        monitor.on_sample(RudderSample(now, -side * math.radians(min(10.0 * now, 30.0)), False, "RSA"))
        at = MonitorInput(now, BOAT, STATE, True, True, 0.0, side * math.radians(30.0), 0.6, True)
        monitor.update(at._replace(is_late=now == 0.7))
    assert monitor.found in ("rudder_reversed", "rudder_not_following")


def judged(
    rate_deg_s: float, ticks: int, dt: float = 0.125, order_deg: float = 60.0, side: float = 1.0, age: float = 0.0
) -> Following:
    """The monitor of a rudder that is off its order from the beginning and moves at a rate, after so many ticks."""
    monitor = Following(LIMITS)
    for tick in range(ticks + 1):
        now = dt * tick
        monitor.on_sample(RudderSample(now - age, side * math.radians(rate_deg_s) * now, False, "RSA"))
        monitor.update(MonitorInput(now, BOAT, STATE, True, True, 0.0, side * math.radians(order_deg), 0.6, True))
    return monitor


@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.parametrize(
    ("rate_deg_s", "ticks", "order_deg", "name"),
    [
        (0.0, 10, 60.0, ""),
        (0.0, 11, 60.0, "rudder_stuck"),
        (1.45, 11, 60.0, "rudder_not_following"),
        (1.55, 80, 60.0, ""),
        (0.38, 11, 60.0, "rudder_stuck"),
        (0.42, 11, 60.0, "rudder_not_following"),
        (-11.0, 3, 60.0, ""),
        (-11.0, 4, 60.0, "rudder_reversed"),
        (0.0, 40, 4.99, ""),
        (0.0, 40, 5.01, "rudder_stuck"),
    ],
)
def test_the_limits_of_a_rudder_that_does_not_follow_in_numbers(
    side: float, rate_deg_s: float, ticks: int, order_deg: float, name: str
) -> None:
    """Of 20 deg/s and 0.1 s of delay, with 5 deg tolerated: 1.3 s without progress, which is 30 % of 5 deg/s; 0.5 deg
    from the second angle on is no movement; reversed beyond 5 deg, as no order was another when the delay began."""
    assert judged(rate_deg_s, ticks, order_deg=order_deg, side=side).found == name


@pytest.mark.parametrize(("late", "name"), [(0.1, ""), (0.3, ""), (0.5, "rudder_reversed")])
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_rudder_that_goes_on_to_an_order_of_before_is_reversed_beyond_the_tolerance(
    side: float, late: float, name: str
) -> None:
    """At 20 deg/s, an order to the other side under way: 0.1 s of going on are filed, and 5 deg more are tolerated."""
    found, _ = seen(
        lambda now: side * (30.0 if now < 0.95 else -30.0),
        lambda now: side * (20.0 * min(now, 0.95 + late) - 20.0 * max(now - 0.95 - late, 0.0)),
        2.0,
    )
    assert found == name


@pytest.mark.parametrize(("dt", "is_found"), [(1.0, True), (1.0625, False)])
def test_angles_more_than_a_second_apart_prove_nothing(dt: float, is_found: bool) -> None:
    assert bool(judged(0.0, 9, dt).found) is is_found


def test_angles_that_come_half_a_second_late_prove_as_much() -> None:
    assert judged(0.0, 20, age=0.5).found == "rudder_stuck"


@pytest.mark.parametrize(("rate_deg_s", "is_slow"), [(0.0, False), (0.1, False), (1.0, True), (-1.0, False)])
def test_a_rudder_that_does_not_move_at_all_is_not_slow(rate_deg_s: float, is_slow: bool) -> None:
    assert judged(rate_deg_s, 24).is_slow is is_slow


def over_a_line(
    order: Callable[[float], float],
    stall: tuple[float, float],
    drained: float,
    held: str = "orders",
    reversed_at: float = math.inf,
    per_second: float = 10.0,
    delay: float = 0.1,
) -> tuple[str, float]:
    """What was found, and when [s], of a rudder of 20 deg/s in 30 s over a line that holds orders, the angles shown, or
    both, from a time on for so long [s] and then delivers what it held so many times as fast. Degrees."""
    monitor, angle, dt = Following(LIMITS._replace(rudder_delay=delay)), 0.0, 0.1
    (begun, lasts), shown, next_shown = stall, [0.0], 0.0
    for step in range(300):
        now = dt * step
        late = max(min(now - begun, lasts - (drained - 1.0) * (now - begun - lasts)), 0.0) if now > begun else 0.0
        wanted = order(max(now - (0.0 if held == "angles" else late) - (delay - 0.1), 0.0))
        wanted = wanted if now < reversed_at else -wanted
        angle += min(max(wanted - angle, -2.0), 2.0)
        shown.append(angle)
        is_shown, next_shown = (
            now > next_shown - 1e-9,
            next_shown + (now > next_shown - 1e-9) / per_second,
        )
        if is_shown and (held == "orders" or not begun < now < begun + lasts):
            seen = angle if held == "orders" else shown[max(step + 1 - round(late / dt), 0)]
            monitor.on_sample(RudderSample(now, math.radians(seen), False, "RSA"))
        monitor.update(MonitorInput(now, BOAT, STATE, True, True, 0.0, math.radians(order(now)), 0.6, True))
        if monitor.found:
            return monitor.found, now
    return "", math.inf


def wandering(seed: int) -> Callable[[float], float]:
    """Orders [deg] that go from one angle to the next at 20 deg/s and stay there for a while, or not."""
    random, legs = Random(seed), [(0.0, 0.0)]
    while legs[-1][0] < 30.0:
        begun, angle = legs[-1]
        to = random.uniform(-25.0, 25.0)
        legs.append((begun + abs(to - angle) / 20.0 + random.choice([0.05, 0.05, random.uniform(0.0, 2.0)]), to))

    def order(now: float) -> float:
        (begun, angle), (_, to) = next(pair for pair in pairwise(legs) if pair[1][0] > now)
        return angle + math.copysign(min(abs(to - angle), 20.0 * (now - begun)), to - angle)

    return order


@pytest.mark.parametrize(
    ("seed", "lasts", "drained", "held"),
    [
        *((seed, 2.0, drained, "orders") for seed in (8, 12, 13) for drained in (1.3, 2.0)),
        *((seed, 2.9, 2.0, "orders") for seed in (0, 35)),
        *((seed, 2.0, drained, "angles") for seed in (5, 8) for drained in (1.3, 2.0, 5.0)),
        *((seed, 2.9, 1.3, "both") for seed in (24, 37)),
    ],
)
def test_a_rudder_that_does_what_a_line_has_held_goes_no_wrong_way(
    seed: int, lasts: float, drained: float, held: str
) -> None:
    assert over_a_line(wandering(seed), (6.0, lasts), drained, held)[0] != "rudder_reversed"


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize("lasts", [0.0, 0.6, 1.0])
def test_a_rudder_that_leaves_every_order_of_late_is_reversed_though_its_line_stalls(seed: int, lasts: float) -> None:
    assert over_a_line(wandering(seed), (6.0, lasts), 2.0, reversed_at=0.0)[0] == "rudder_reversed"


@pytest.mark.parametrize(
    ("per_second", "size", "period", "reversed_at", "stalled", "delay"),
    [
        *((per_second, 12.0, 4.0, 20.3, 0.0, 0.1) for per_second in (1.0, 1.8)),
        *((10.0, 25.0, 5.0, reversed_at, 0.0, 0.3) for reversed_at in (20.0, 21.5)),
        *((per_second, 12.0, 4.0, 4.0, 1.0, 0.1) for per_second in (1.0, 1.8, 10.0)),
    ],
)
def test_a_reversed_rudder_is_named_within_a_swing_of_its_orders_as_seldom_as_its_sensor_may_come(
    per_second: float, size: float, period: float, reversed_at: float, stalled: float, delay: float
) -> None:
    """It stands at each turn of its order, and seldom seen it does what was ordered half a swing ago: no excuse."""
    kind, when = over_a_line(
        lambda now: size * math.sin(2.0 * math.pi * now / period),
        (reversed_at - stalled, stalled),
        2.0,
        reversed_at=reversed_at,
        per_second=per_second,
        delay=delay,
    )
    assert kind == "rudder_reversed"
    assert when - reversed_at <= period
