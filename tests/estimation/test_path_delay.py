"""How late orders come to the steering gear, by their echo: found to a few hundredths of a second, and nothing else."""

from __future__ import annotations

import math
from collections.abc import Callable
from random import Random

import pytest

from autopilot.estimation.path_delay import NOT_ECHOED, Motion, PathDelay, lateness, path_step, rudder_step, when_heard
from autopilot.estimation.rudder_observer import RudderObserver, ordered, rudder_memory
from autopilot.estimation.tuning import PATH_FOLLOWS, PATH_GRAIN, PATH_GRID, PATH_MOVED
from autopilot.models.norrbin import Norrbin
from autopilot.models.steering_gear import SteeringGear, gear_step
from autopilot.pilot_state import configured
from autopilot.runtime.build import law_of, pilot_config
from autopilot.runtime.tuning import designed
from autopilot.signals import NavState
from autopilot.steering import PACED, paced, with_slide
from autopilot.vessel.file import load_vessel

FILED = 0.05


def order_at(time: float) -> float:
    """A rudder at work: a swell, and turns begun and met."""
    return math.radians(3.0 * math.sin(1.1 * time) + 12.0 * math.tanh(5.0 * math.sin(0.43 * time)))


def learnt(
    delay_at: Callable[[float], float],
    hz: float = 20.0,
    seconds: float = 60.0,
    moves: Callable[[float], float] = order_at,
    anothers: float = 0.0,
    steered_by: list[float] | None = None,
) -> PathDelay:
    """Return what is known of a path after so many seconds: its delay is asked anew for each order, and the gear shows
    the newest that has come some ten times a second, in microseconds of pulse. steered_by: takes what each echo leaves
    to steer by."""
    times, commands, path = [0.0] * 256, [math.nan] * 256, NOT_ECHOED
    on_way: list[tuple[float, float]] = []
    shown, grain = 0.0, math.radians(0.07)
    due = 0.0
    for tick in range(round(seconds * hz)):
        now = tick / hz
        if now >= due:
            echo, due = due, due + 0.103
            came = [each for each in on_way if each[0] <= echo]
            on_way = [each for each in on_way if each[0] > echo]
            shown = max(came)[1] if came else shown
            angle = grain * round((shown + anothers * math.sin(0.7 * echo)) / grain)
            if not -PATH_MOVED < angle - path.echoed < PATH_MOVED:
                path = path_step(path, (times, commands, tick), (echo, angle), FILED)
                if steered_by is not None:
                    steered_by.append(path.late)
        times[tick & 255], commands[(tick + 1) & 255] = now, moves(now)
        on_way.append((now + delay_at(now), moves(now)))
    return path


@pytest.mark.parametrize("hz", [10.0, 20.0, 50.0])
@pytest.mark.parametrize("delay", [0.0, 0.12, 0.3, 0.55, 0.8])
def test_a_delay_is_found_to_a_part_of_a_tick(delay: float, hz: float) -> None:
    found = learnt(lambda now: delay, hz)
    near = 0.01 + 0.2 / hz
    assert found.delay == pytest.approx(delay, abs=near)
    assert found.late == pytest.approx(delay - FILED if delay else 0.0, abs=near + PATH_FOLLOWS)


def test_a_delay_as_filed_is_nothing_to_steer_by() -> None:
    for delay in (0.03, FILED, 0.07):
        assert learnt(lambda now, delay=delay: delay).late == 0.0


@pytest.mark.parametrize("delay", [0.02, 0.3, 0.8])
def test_the_first_echoes_that_fit_by_chance_are_no_delay(delay: float) -> None:
    for seed in range(20261130, 20261170):
        random = Random(seed)
        parts = [(random.gauss(0.0, 1.0), random.uniform(0.3, 6.0), random.uniform(0.0, 6.28)) for _ in range(12)]

        def moves(time: float, parts: list[tuple[float, float, float]] = parts) -> float:
            return math.radians(2.3 * sum(high * math.sin(w * time + phase) for high, w, phase in parts))

        for seconds in (1.4, 1.6, 1.8, 2.0, 2.5):
            found = learnt(lambda now: delay, seconds=seconds, moves=moves).delay
            assert math.isnan(found) or found == pytest.approx(delay, abs=0.1), (seed, seconds)


def test_a_delay_that_changes_from_order_to_order_leaves_its_mean() -> None:
    random = Random(20261127)
    found = learnt(lambda now: 0.2 * random.random(), 50.0, 120.0)
    assert 0.05 < found.delay < 0.15


def test_a_line_that_becomes_slower_is_followed_and_back() -> None:
    found = learnt(lambda now: 0.1 if now < 60.0 else 0.5, seconds=180.0)
    assert found.delay == pytest.approx(0.5, abs=0.02)
    assert found.late == pytest.approx(0.45, abs=0.03)
    assert learnt(lambda now: 0.5 if now < 60.0 else 0.05, seconds=180.0).late == 0.0


@pytest.mark.parametrize(("before", "after"), [(1.0, FILED), (FILED, 1.0), (0.5, FILED), (FILED, 0.5), (0.5, 0.3)])
def test_a_line_that_becomes_another_is_followed_within_seconds(before: float, after: float) -> None:
    found = learnt(lambda now: before if now < 40.0 else after, seconds=50.0)
    assert found.late == pytest.approx(after - FILED, abs=0.05)


def test_orders_that_a_stall_holds_up_are_no_other_line() -> None:
    for seed in range(20261130, 20261154):
        random, until, steered_by = Random(seed), [0.0], list[float]()

        def stalls(now: float, random: Random = random, until: list[float] = until) -> float:
            if random.random() < 0.05:
                until[0] = now + random.uniform(0.1, 0.7)
            return max(0.02 + 0.02 * random.random(), until[0] - now)

        learnt(stalls, steered_by=steered_by)
        # one stall a second holds orders up by 0.1 s on the mean
        assert max(steered_by) < 0.1, seed


def test_a_rudder_that_somebody_else_moves_says_nothing() -> None:
    found = learnt(lambda now: 0.3, anothers=math.radians(10.0))
    assert math.isnan(found.delay)
    assert found.late == 0.0


def test_a_rudder_that_rests_or_moves_evenly_to_and_fro_at_once_says_nothing() -> None:
    assert learnt(lambda now: 0.3, moves=lambda now: 0.0).weight <= 1.0
    # as quick as the grid is coarse: any delay would do
    assert learnt(lambda now: 0.3, 50.0, moves=lambda now: 0.1 * math.sin(62.8 * now)).late == 0.0


def test_echoes_of_before_we_steered_do_not_count() -> None:
    times, commands = [0.05 * tick for tick in range(256)], [math.nan] * 256
    commands[101:] = [0.0] * 155
    assert path_step(NOT_ECHOED, (times, commands, 110), (5.45, 0.1), FILED).weight == 0.0
    assert path_step(NOT_ECHOED, (times, commands, 140), (6.95, 0.1), FILED).weight == 1.0
    assert len(NOT_ECHOED.costs) == PATH_GRID


def test_the_boat_is_reckoned_under_the_orders_that_are_on_their_way() -> None:
    model, gear, late = Norrbin(0.5, 1.0), SteeringGear(0.6, math.inf), 0.4
    observer, memory = RudderObserver(), rudder_memory()
    for tick in range(9):
        observer = ordered(observer, memory, 0.05 * tick, 0.1 if tick >= 4 else 0.0)
    now = NavState(0.4, 0.0, 0.0, 1.0, 0.0, 0.02, 0.0, True)
    then = when_heard(model, gear, now, (observer, memory), (late, late), 0.0)
    # at rest but for the bias, and from 0.2 s on under the order, half a step later: r = K (delta + b)(1 - e^-t)
    rest = 0.5 * 0.02 * (1.0 - math.exp(-0.4))
    assert 0.05 * (1.0 - math.exp(-0.15)) < then.rate - rest < 0.05 * (1.0 - math.exp(-0.2))
    assert then.time == now.time
    assert then.rudder == pytest.approx(0.1)
    pushed = when_heard(model, gear, now, (observer, memory), (late, late), 0.03)
    assert pushed.rate - then.rate == pytest.approx(0.5 * 0.03 * (1.0 - math.exp(-0.4)))
    assert pushed.bias == now.bias, "only what is reckoned ahead goes by it"


def by_sensor(
    delay: float, rate: float, offset: float = 0.0, anothers: float = 0.0, moves: Callable[[float], float] = order_at
) -> PathDelay:
    """Return what is known of a path after a minute of a rudder that goes at this share of its filed 15 deg/s, its
    sensor ten times a second, in tenths of a degree, 0.05 deg noisy."""
    filed = SteeringGear(math.radians(30.0), math.radians(15.0), 0.1, delay=0.05)
    gear, random, path = filed._replace(rate_max=rate * filed.rate_max), Random(20261129), NOT_ECHOED
    times, commands, orders = [0.0] * 256, [math.nan] * 256, list[tuple[float, float]]()
    rudder, tick, came, shown_at, shown = 0.0, 0, 0, math.nan, math.nan
    for step in range(6000):
        now = 0.01 * step
        while came < len(orders) and orders[came][0] <= now:
            came += 1
        rudder = gear_step(gear, rudder, orders[came - 1][1] if came else 0.0, 0.01)
        if step % 10 == 0:
            seen = math.degrees(rudder + anothers * math.sin(0.7 * now)) + offset + random.gauss(0.0, 0.05)
            angle = math.radians(round(seen, 1))
            if step and (abs(angle - shown) > PATH_GRAIN or abs(commands[tick & 255] - angle) > PATH_MOVED):
                motion = Motion(now, shown, angle, now - shown_at)
                path = rudder_step(path, (times, commands, tick), motion, filed, FILED)
            shown_at, shown = now, angle
        if step % 5 == 0:
            times[tick & 255], commands[(tick + 1) & 255] = now, moves(now)
            orders.append((now + delay + filed.delay, moves(now)))
            tick += 1
    return path


@pytest.mark.parametrize("rate", [1.0, 0.5, 0.25])
@pytest.mark.parametrize("delay", [0.05, 0.4, 0.7])
def test_a_sensor_tells_a_late_rudder_from_a_slow_one(delay: float, rate: float) -> None:
    found = by_sensor(delay, rate)
    assert found.delay == pytest.approx(delay, abs=0.06)
    assert found.late == pytest.approx(delay - FILED, abs=0.06 + PATH_FOLLOWS)


def test_a_rudder_quicker_than_its_file_is_held_for_no_later_than_it_is() -> None:
    assert 0.3 < by_sensor(0.4, 1.5).delay < 0.42


def test_a_sensor_that_stands_askew_shows_it_too() -> None:
    assert by_sensor(0.4, 1.0, offset=1.0).delay == pytest.approx(0.4, abs=0.08)


def test_a_sensor_of_a_rudder_that_rests_or_that_somebody_else_moves_says_nothing() -> None:
    assert by_sensor(0.4, 1.0, anothers=math.radians(10.0)).late == 0.0
    assert by_sensor(0.4, 1.0, moves=lambda now: 0.0).weight == 0.0


def test_what_an_earlier_run_measured_counts_until_it_is_measured_anew() -> None:
    assert lateness(0.0, 0.4 - FILED) == pytest.approx(0.35)
    assert lateness(0.0, 0.06 - FILED) == lateness(0.0, math.nan) == 0.0
    assert lateness(0.35, 0.0) == 0.0


def test_a_course_is_held_more_slowly_only_by_a_law_that_is_too_quick_for_the_delay() -> None:
    """A boat in sea state 5 held its course a fifth worse with a loop that was slowed though it was slow enough."""
    outboard, small = load_vessel("outboard"), load_vessel("small_craft")
    slow, quick = (configured(pilot_config(each), law_of(each)) for each in (designed(outboard), outboard))
    model = quick.boat.model
    assert paced(slow.steering, model, 1.0, 0.7) == 1.0
    assert paced(quick.steering, model, 1.0, 0.7) == pytest.approx(PACED * quick.boat.delay_margin / 0.7)
    assert paced(quick.steering, model, 0.4, 0.7) == 0.4, "at a low speed it is slow enough"
    unstable = configured(pilot_config(small), law_of(small))
    assert paced(unstable.steering, unstable.boat.model, 1.0, 5.0) == 1.0


def test_a_slide_is_learnt_only_where_it_can_be_acted_on_in_time() -> None:
    """BlueBoat behind 0.4 s each way went 12 deg past its course in calm water, with a slide that came and went."""
    boat = load_vessel("blueboat")
    steering = configured(pilot_config(boat), law_of(boat)).steering
    assert with_slide(steering, 1.0e-4, 0.1).estimator.noises.usual.slide == 1.0e-4
    assert with_slide(steering, 1.0e-4, 0.8) is steering
