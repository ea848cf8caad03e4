"""A rudder without a sensor that is stuck, trails or works the wrong way is found by the boat alone; nothing else
is."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import pytest
from watches import Answering, RudderHistory

from autopilot.angles import wrap
from autopilot.models.norrbin import Norrbin, rate_step
from autopilot.signals import HeadingSample, NavState
from autopilot.supervision import rudder_answer, rudder_watch
from autopilot.supervision.monitor_input import AlarmLimits, Measured, MonitorInput
from autopilot.supervision.rudder_response import NO_RESPONSE

MODEL = Norrbin(0.4, 1.5, n3=2.0, reference_speed=4.0)
STOP = math.radians(30.0)
DT = 0.05
NOISE = math.radians(0.3)
TEN = math.radians(10.0)


def calm(_: float) -> float:
    return 0.0


def seaway(now: float) -> float:
    return math.radians(2.5 * math.sin(0.9 * now) + 1.5 * math.sin(1.3 * now + 1.0))


@dataclass
class Helm:
    """A boat steered by angle and rate; `gear` is what its rudder makes of an order, `push` [rad] acts beside it."""

    boat: Norrbin = MODEL
    push: Callable[[float], float] = calm
    gear: Callable[[float, float], float] = lambda order, before: order
    late: float = 0.0
    seed: int = 1
    watch: Answering = field(default_factory=lambda: Answering(NOISE**2))
    heading: float = 0.0
    rate: float = 0.0
    rudder: float = 0.0
    now: float = 0.0
    wave: tuple[float, float] = (math.radians(1.0), 1.0)
    trial: bool = False
    """A zigzag of 10 deg by 10 deg about north is sailed, not a course."""
    side: float = 1.0

    def __post_init__(self) -> None:
        self.random = np.random.default_rng(self.seed)
        self.orders = [0.0] * 20
        self.commanded = 0.0

    def steer(self, seconds: float, course: float) -> str:
        """Return the first alarm in `seconds` on a `course` [rad]."""
        for _ in range(round(seconds / DT)):
            self.now += DT
            seen = wrap(self.heading + NOISE * self.random.standard_normal())
            wanted = self.zigzag(seen) if self.trial else -1.5 * wrap(seen - course) - 1.0 * self.rate
            self.commanded += max(-0.3 * DT, min(0.3 * DT, wanted - self.commanded))
            self.commanded = max(-STOP, min(STOP, self.commanded))
            self.orders.append(self.commanded)
            self.rudder = self.gear(self.orders[-1 - round(self.late / DT)], self.rudder)
            self.rate = rate_step(self.boat, self.rate, self.rudder + self.push(self.now), DT)
            self.heading += self.rate * DT
            state = NavState(self.now, seen, self.rate, 4.0, self.commanded, 0.0, 0.0, True, 0.0, 0.0, *self.wave)
            self.watch.on_sample(HeadingSample(self.now, seen, None, "compass"))
            holds = not self.trial
            seen_now = MonitorInput(
                self.now, MODEL, state, True, holds, course, self.commanded, STOP, True, follows=holds
            )
            found = self.watch.found(seen_now)
            if found:
                return found
            if self.watch.doubts_trial:
                return "trial_doubtful"
        return ""

    def zigzag(self, seen: float) -> float:
        """Return the rudder of the zigzag."""
        if self.side * seen >= TEN:
            self.side = -self.side
        return self.side * TEN

    def steer_late(self, seconds: float, courses: tuple[float, ...], latest: float, share: float) -> str:
        """The same with ticks of which a `share` sends its order up to `latest` [s] late, the next one coming then."""
        random, queue, next_tick, last, leaving = np.random.default_rng(self.seed), [], 0.0, 0.0, 0.0
        for _ in range(round(seconds / DT)):
            self.now += DT
            seen = wrap(self.heading + NOISE * self.random.standard_normal())
            queue.append(HeadingSample(self.now, seen, None, "compass"))
            if self.now >= next_tick:
                gap, last, leaving = self.now - last, self.now, self.commanded
                course = courses[int(self.now / 20.0) % len(courses)]
                reach = 0.3 * min(gap, 0.5)
                wanted = -1.5 * wrap(seen - course) - 1.0 * self.rate
                self.commanded += max(-reach, min(reach, wanted - self.commanded))
                self.commanded = max(-STOP, min(STOP, self.commanded))
                state = NavState(self.now, seen, self.rate, 4.0, leaving, 0.0, 0.0, True, 0.0, 0.0, *self.wave)
                for sample in queue:
                    self.watch.on_sample(sample)
                queue = []
                is_late = gap > 0.15
                seen_now = MonitorInput(
                    self.now, MODEL, state, True, True, course, leaving, STOP, True, is_late=is_late, follows=True
                )
                found = self.watch.found(seen_now)
                if found:
                    return found
                if random.random() < share:
                    next_tick = self.now + random.uniform(0.1, latest)
                else:
                    leaving = self.commanded
            self.rudder = self.gear(leaving, self.rudder)
            self.rate = rate_step(self.boat, self.rate, self.rudder + self.push(self.now), DT)
            self.heading += self.rate * DT
        return ""


COURSES = (0.0, 0.5, 0.2, 1.5, 1.2, -1.0, 0.0, 1.0)


def stuck(_: float, before: float) -> float:
    return before


def reversed_gear(order: float, _: float) -> float:
    return -order


def trailing(_: float, before: float) -> float:
    return 0.9 * before


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize(
    ("gear", "says", "within"),
    [(stuck, "rudder_stuck", 14.0), (trailing, "rudder_stuck", 14.0), (reversed_gear, "rudder_reversed", 6.0)],
)
def test_a_rudder_that_fails_before_a_turn_is_seen(
    gear: Callable[[float, float], float], says: str, within: float, seed: int
) -> None:
    helm = Helm(push=seaway, seed=seed)
    assert helm.steer(30.0, 0.0) == ""
    helm.gear, begins = gear, helm.now
    name = helm.steer(30.0, 1.0)
    assert name == says
    assert helm.now - begins < within


@pytest.mark.parametrize("gear", [stuck, reversed_gear])
def test_on_a_course_it_is_seen_once_wind_or_sea_call_for_it(gear: Callable[[float, float], float]) -> None:
    helm = Helm(push=lambda now: seaway(now) + (math.radians(9.0) if now > 32.0 else 0.0))
    helm.steer(30.0, 0.0)
    helm.gear = gear
    assert helm.steer(60.0, 0.0)
    assert abs(helm.heading) < math.radians(30.0)


def test_a_rudder_that_is_stuck_where_it_should_be_tells_nothing_and_does_nothing() -> None:
    helm = Helm(gear=trailing, wave=(0.0, 0.0))
    assert helm.steer(120.0, 0.0) == ""
    assert abs(helm.heading) < math.radians(1.0)


@pytest.mark.parametrize("gain", [0.7, 1.0, 1.4])
@pytest.mark.parametrize("late", [0.0, 0.3])
def test_a_wrong_gain_or_delay_is_no_rudder_fault(gain: float, late: float) -> None:
    helm = Helm(boat=MODEL._replace(gain=gain * MODEL.gain), push=seaway, late=late)
    for course in (0.0, 0.5, 0.2, 1.5, 1.2, -1.0):
        assert helm.steer(20.0, course) == ""


@pytest.mark.parametrize("share", [0.2, 0.5, 1.0])
@pytest.mark.parametrize("latest", [0.7, 4.2])
@pytest.mark.parametrize("seed", [2, 4])
def test_orders_that_leave_late_accuse_no_rudder(latest: float, share: float, seed: int) -> None:
    """0.7 s, and as much at six times real time."""
    assert Helm(push=seaway, seed=seed).steer_late(300.0, COURSES, latest, share) == ""


def test_a_loop_that_is_late_all_the_time_has_no_evidence_and_one_in_time_has() -> None:
    for is_late in (True, False):
        helm = Helm(push=seaway, gear=reversed_gear)
        step = helm.watch.step
        helm.watch.step = lambda before, seen, step=step, is_late=is_late: step(before, seen._replace(is_late=is_late))
        assert helm.steer(60.0, 0.5) == ("" if is_late else "rudder_reversed")


def test_a_rudder_that_fails_is_seen_though_ticks_are_late_at_times() -> None:
    helm = Helm(push=seaway)
    assert helm.steer_late(60.0, COURSES, 0.7, 0.01) == ""
    helm.gear = reversed_gear
    assert helm.steer_late(60.0, COURSES, 0.7, 0.01) == "rudder_reversed"


@pytest.mark.parametrize("gust_deg", [15.0, -25.0, 45.0])
def test_a_gust_is_none_even_one_heavier_than_the_rudder(gust_deg: float) -> None:
    helm = Helm(push=lambda now: seaway(now) + (math.radians(gust_deg) if 30.0 < now < 45.0 else 0.0))
    assert helm.steer(60.0, 0.0) == ""


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_gust_in_a_trial_ends_it_and_accuses_no_rudder(seed: int) -> None:
    begins = 30.0
    helm = Helm(push=lambda now: seaway(now) + (math.radians(20.0) if now >= begins else 0.0), seed=seed, trial=True)
    assert helm.steer(begins, 0.0) == ""
    assert helm.steer(10.0, 0.0) == "trial_doubtful"
    assert abs(helm.heading) < math.radians(40.0)
    helm.trial = False
    assert helm.steer(30.0, 0.0) == ""
    assert abs(helm.heading) < math.radians(20.0), "this helm does not learn the push"


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_rudder_that_fails_in_a_trial_is_detected_on_the_course_after_it(seed: int) -> None:
    helm = Helm(push=seaway, seed=seed, trial=True)
    assert helm.steer(30.0, 0.0) == ""
    helm.gear = reversed_gear
    assert helm.steer(10.0, 0.0) == "trial_doubtful"
    helm.trial = False
    assert helm.steer(10.0, 0.0) == "rudder_reversed"


@pytest.mark.parametrize(("since", "is_accused"), [(5.0, True), (11.0, False)])
def test_what_a_trial_made_doubtful_counts_until_the_helm_is_let_go(
    monkeypatch: pytest.MonkeyPatch, since: float, is_accused: bool
) -> None:
    """Less evidence is enough on the course behind a trial; who engages anew begins a course as any other."""
    blocks = NO_RESPONSE.blocks._replace(stuck=2.0, stuck_late=2.0)
    known = NO_RESPONSE._replace(time=12.0, stuck=10.9, stuck_late=10.9, blocks=blocks)
    response = rudder_answer.Response(rudder_answer.NOTHING_KNOWN._replace(response=known))
    monkeypatch.setattr(rudder_watch, "judge_response", lambda *given: response)
    state = NavState(12.0, 0.0, 0.0, 4.0, 0.0, 0.0, 0.0, True)
    seen = MonitorInput(12.0, MODEL, state, True, True, 0.0, 0.0, STOP, True, follows=True)
    before = rudder_watch.State(since=since, trial_doubted=10.0)
    limits, history = AlarmLimits(rudder_response=True), RudderHistory().until(seen)
    _, found = rudder_watch.update(limits, before, seen, Measured(), history)
    assert [event.name for event in found] == ["rudder_stuck"] * is_accused + ["trial_doubtful"]


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_first_waves_are_no_push_before_the_sea_is_known(seed: int) -> None:
    helm = Helm(push=lambda now: math.radians(40.0) * math.sin(now + seed), seed=seed, trial=True)
    assert helm.steer(12.0, 0.0) == ""


def test_a_compass_that_stands_still_is_left_to_who_watches_for_that() -> None:
    helm = Helm(push=seaway)
    helm.steer(20.0, 0.0)
    held = helm.watch
    for k in range(200):
        now, order = helm.now + (k + 1) * DT, math.radians(0.2 * k)
        state = NavState(now, 0.1, 0.0, 4.0, order, 0.0, 0.0, True)
        held.on_sample(HeadingSample(now, 0.1, None, "compass"))
        assert held.found(MonitorInput(now, MODEL, state, True, True, 0.0, order, STOP, True)) == ""


def test_single_wild_headings_and_a_jump_for_good_are_not_the_rudder_s() -> None:
    helm = Helm(push=seaway)
    helm.steer(20.0, 0.0)
    for k in range(400):
        now = helm.now + (k + 1) * DT
        order = math.radians(10.0 * math.sin(0.8 * now))
        wild = 2.0 if k % 10 == 0 else 0.7 if k > 200 else 0.0
        helm.rate = rate_step(MODEL, helm.rate, order, DT)
        helm.heading += helm.rate * DT
        seen = wrap(helm.heading + wild)
        state = NavState(now, seen, helm.rate, 4.0, order, 0.0, 0.0, True, 0.0, 0.0, *helm.wave)
        helm.watch.on_sample(HeadingSample(now, seen, None, "compass"))
        assert helm.watch.found(MonitorInput(now, MODEL, state, True, True, 0.0, order, STOP, True)) == ""


def test_nothing_is_known_while_another_steers_or_without_way() -> None:
    for excluded in ({"steers": False}, {"has_way": False}):
        watch = Answering(NOISE**2)
        for k in range(400):
            now, order = k * DT, math.radians(20.0 * math.sin(0.1 * k))
            state = NavState(now, 0.001 * (k % 7), 0.0, 4.0, order, 0.0, 0.0, True)
            watch.on_sample(HeadingSample(now, 0.001 * (k % 7), None, "compass"))
            seen = MonitorInput(now, MODEL, state, True, True, 0.0, order, STOP, True)._replace(**excluded)
            assert watch.found(seen) == ""
