"""A frozen compass, a boat off its course or running away, too much heel: seen in time, and never without cause."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from watches import Jumping, Monitors, alarms, trouble

from autopilot.angles import wrap
from autopilot.models.norrbin import Norrbin, rate_step, steady_rate
from autopilot.signals import AlarmEvent, ConditionSample, HeadingSample, NavState, RateSample, RollSample, WindSample
from autopilot.supervision.course_watch import Spin, Swings
from autopilot.supervision.monitor_input import AlarmLimits, MonitorInput
from autopilot.supervision.monitors import NO_THRUST_SEEN, State, ThrusterLook, thruster_step, with_weak_thruster
from autopilot.supervision.panel import sentences_of
from autopilot.supervision.rudder_answer import FILED, LIVELIER, NOTHING_KNOWN, QUICKER, SLOW_RUDDER, Response
from autopilot.supervision.rudder_response import NO_RESPONSE
from autopilot.supervision.rudder_watch import VERDICTS
from autopilot.supervision.tuning import SWEEP

BOAT = Norrbin(0.2, 5.0, reference_speed=4.0)
LIMITS = AlarmLimits(off_course=math.radians(20.0), off_course_time=10.0, roll=math.radians(40.0))
STOP = math.radians(30.0)
DT = 0.1
RUDDER_RATE = math.radians(10.0)


def watched(
    now: float,
    heading: float,
    rudder: float = 0.0,
    *,
    wanted: float = 0.0,
    holds: bool = True,
    bias: float = 0.0,
    rate: float = 0.0,
    boat: Norrbin = BOAT,
) -> MonitorInput:
    state = NavState(now, heading, rate, 4.0, rudder, bias, 0.0, True)
    return MonitorInput(now, boat, state, True, holds, wanted, rudder, STOP, True)


class Sailing:
    """A boat with a compass that may freeze; the rudder is whatever the test says."""

    def __init__(self, limits: AlarmLimits = LIMITS, *, has_rate: bool = False) -> None:
        self.monitors, self.now, self.heading, self.rate = Monitors(limits), 0.0, 0.3, 0.0
        self.has_rate, self.shown = has_rate, 0.3

    def sail(
        self, seconds: float, rudder: float, *, frozen: bool = False, bias: float = 0.0, digits: float = 0.0
    ) -> float | None:
        """Return when the compass is called frozen, None where it is not."""
        for _ in range(round(seconds / DT)):
            self.now += DT
            self.rate = rate_step(BOAT, self.rate, rudder + bias, DT)
            self.heading += self.rate * DT
            if not frozen:
                self.shown = round(self.heading / digits) * digits if digits else self.heading
            rate = self.rate if self.has_rate else None
            self.monitors.on_samples((HeadingSample(self.now, wrap(self.shown), rate),))
            self.monitors.update(watched(self.now, wrap(self.shown), rudder, wanted=wrap(self.shown), bias=bias))
            if trouble(self.monitors):
                return self.now
        return None


@pytest.mark.parametrize("has_rate", [True, False])
def test_a_frozen_compass_is_seen_before_the_boat_has_turned_far(has_rate: bool) -> None:
    boat = Sailing(has_rate=has_rate)
    assert boat.sail(20.0, 0.05) is None
    turned = boat.heading
    assert boat.sail(60.0, 0.05, frozen=True) is not None
    assert trouble(boat.monitors) == AlarmEvent("heading_frozen")
    assert abs(boat.heading - turned) < math.radians(25.0)
    boat.sail(0.2, 0.05)
    assert trouble(boat.monitors) is None


def test_a_gyro_of_its_own_tells_that_the_compass_stands() -> None:
    """The boat swings by 4 deg to each side, and the rudder lies amidships."""
    monitors, found = Monitors(LIMITS), math.inf
    for k in range(120):
        now = k * DT
        heading = math.radians(4.0) * math.sin(now) if now < 6.0 else 0.0
        gyro = RateSample(now, math.radians(4.0) * math.cos(now), "gyro")
        monitors.on_samples((HeadingSample(now, heading, None, "compass"), gyro))
        monitors.update(watched(now, heading))
        if trouble(monitors) == AlarmEvent("heading_frozen"):
            found = min(found, now)
    assert found < 11.0


@pytest.mark.parametrize("is_own", [True, False])
@pytest.mark.parametrize("bias_deg_s", [0.7, -0.7])
def test_a_known_gyro_bias_freezes_no_whole_degree_compass(bias_deg_s: float, is_own: bool) -> None:
    """It adds up to 7 deg while a boat in flat water keeps its course to a degree."""
    monitors, bias = Monitors(LIMITS), math.radians(bias_deg_s)
    for k in range(600):
        now = k * DT
        gyro = RateSample(now, bias, "gyro")
        heading = HeadingSample(now, 0.3, bias + 1.0e-4 * (k % 3) if is_own else None, "compass")
        monitors.on_samples((heading, gyro))
        monitors.update(watched(now, 0.3)._replace(rate_bias=bias))
        found = trouble(monitors)
        assert found is None or found.name != "heading_frozen"


def test_a_rate_that_contradicts_the_heading_freezes_none() -> None:
    """A gyro that is off by 8 deg/s, beside a whole-degree compass on a course in flat water."""
    monitors, said = Monitors(LIMITS._replace(rate_disagrees=math.radians(15.0))), set[str]()
    for k in range(900):
        now, swing = k * DT, 0.02 * math.sin(k * DT) if k < 300 else 0.0
        wrong = math.radians(8.0) * min(now / 20.0, 1.0) + 1.0e-4 * (k % 3)
        monitors.on_samples((HeadingSample(now, round(swing, 2), wrong, "compass"),))
        monitors.update(watched(now, swing))
        said |= set(monitors.findings) if now > 30.0 else set()
    assert said == {"rate_disagrees"}


def test_a_coarse_compass_on_a_straight_course_is_not_frozen() -> None:
    """Whole degrees, the same for minutes: wind is held off by a rudder that the bias explains."""
    boat = Sailing()
    assert boat.sail(300.0, -0.06, bias=0.06, digits=math.radians(1.0)) is None


def test_a_slow_turn_read_in_whole_degrees_is_not_frozen() -> None:
    boat = Sailing(has_rate=True)
    assert boat.sail(300.0, 0.004, digits=math.radians(1.0)) is None


@pytest.mark.parametrize("rate_deg_s", [0.0, 0.01, 0.3, -0.4])
def test_a_rate_that_stands_still_too_does_not_speak_for_the_compass(rate_deg_s: float) -> None:
    """Both froze as a turn began: the rate adds up to next to nothing, the rudder is worth more."""
    monitors, turned = Monitors(LIMITS), 0.0
    for k in range(600):
        monitors.on_samples((HeadingSample(k * DT, 0.3, math.radians(rate_deg_s)),))
        monitors.update(watched(k * DT, 0.3, 0.3, wanted=0.3))
        turned += steady_rate(BOAT, 0.3) * DT
        if trouble(monitors):
            break
    assert trouble(monitors) == AlarmEvent("heading_frozen")
    assert turned < math.radians(45.0)


def test_a_rate_of_nought_is_believed_while_the_rudder_turns_the_boat_little() -> None:
    """Whole degrees and no rate for ten minutes, and a rudder that the bias explains all but 1.5 degrees of."""
    monitors = Monitors(LIMITS)
    for k in range(6000):
        monitors.on_samples((HeadingSample(k * DT, 0.3, 0.0),))
        monitors.update(watched(k * DT, 0.3, -0.06, wanted=0.3, bias=0.06 + math.radians(1.5)))
        assert trouble(monitors) is None


@pytest.mark.parametrize("rate", [0.0, None])
def test_what_a_hand_does_with_the_rudder_proves_nothing_of_the_compass(rate: float | None) -> None:
    monitors = Monitors(LIMITS)
    for k in range(600):
        monitors.on_samples((HeadingSample(k * DT, 0.3, rate),))
        monitors.update(watched(k * DT, 0.3, 0.3, wanted=0.3)._replace(steers=False))
        assert trouble(monitors) is None


def test_without_way_the_rudder_proves_nothing() -> None:
    monitors = Monitors(LIMITS)
    for k in range(2000):
        monitors.on_samples((HeadingSample(k * DT, 0.3),))
        monitors.update(watched(k * DT, 0.3, 0.3, wanted=0.3)._replace(has_way=False))
        assert trouble(monitors) is None


def test_what_another_does_with_the_rudder_proves_nothing() -> None:
    monitors = Monitors(LIMITS)
    for k in range(2000):
        monitors.on_samples((HeadingSample(k * DT, 0.3),))
        monitors.update(watched(k * DT, 0.3, 0.3, wanted=0.3)._replace(steers=False))
        assert trouble(monitors) is None


def off_course(seconds: float, error: float, rudder: float = 0.0) -> Monitors:
    monitors = Monitors(LIMITS)
    for k in range(round(seconds / DT) + 1):
        monitors.update(watched(k * DT, error, rudder))
    return monitors


def test_off_course_is_said_after_its_time_and_unsaid_when_back() -> None:
    assert alarms(off_course(9.0, math.radians(25.0))) == ()
    monitors = off_course(10.5, math.radians(-25.0))
    assert "off heading by 25 deg to port" in sentences_of(alarms(monitors))[0]
    monitors.update(watched(11.0, math.radians(-16.0)))
    assert alarms(monitors) != ()
    for now, is_said in ((11.1, True), (21.0, True), (21.2, False)):
        monitors.update(watched(now, math.radians(-10.0)))
        assert (alarms(monitors) != ()) is is_said, "while it settles it may leave again"


def test_at_the_stop_the_advice_is_another() -> None:
    assert "rudder at its stop" in sentences_of(alarms(off_course(11.0, math.radians(25.0), -STOP)))[0]
    assert "check rudder" in sentences_of(alarms(off_course(11.0, math.radians(25.0), -0.1)))[0]


def test_no_course_no_alarm() -> None:
    monitors = off_course(20.0, math.radians(25.0))
    monitors.update(watched(21.0, math.radians(25.0), holds=False))
    assert alarms(monitors) == ()


def helmed(monitors: Monitors, seconds: float, sign: float, gust: float = 0.0) -> float:
    """Steer a boat whose rudder works with `sign` in a gust [rad of rudder]; return how far [rad] it has turned."""
    heading, rate, now = math.radians(5.0), 0.0, 0.0
    while not trouble(monitors) and now < seconds:
        now += DT
        order = max(-STOP, min(STOP, -2.0 * wrap(heading)))
        rate = rate_step(BOAT, rate, sign * order + gust, DT)
        heading += rate * DT
        monitors.update(watched(now, wrap(heading), order, rate=rate))
    return heading


def test_a_boat_that_turns_against_its_rudder_is_given_up() -> None:
    """A rudder wired the wrong way: hard over, and the boat goes round."""
    monitors = Monitors(LIMITS)
    helmed(monitors, 120.0, -1.0)
    assert trouble(monitors) == AlarmEvent("runaway")


def pushed(push: float, *, jammed: bool = False) -> tuple[Monitors, float, float]:
    """Hold a course in a sudden `push` [rad of rudder], or with the rudder jammed there; return, of when steering ends
    or a minute is over, the monitors, and how far off [rad] the boat was when anything was first found, and is."""
    monitors, heading, rate, rudder, now, first = Monitors(LIMITS), 0.0, 0.0, 0.0, 0.0, math.inf
    while not trouble(monitors) and now < 60.0:
        now += DT
        order = max(-STOP, min(STOP, -2.0 * heading - 2.0 * rate))
        rudder += max(-RUDDER_RATE * DT, min(RUDDER_RATE * DT, order - rudder))
        rate = rate_step(BOAT, rate, push if jammed else rudder + push, DT)
        heading += rate * DT
        monitors.update(watched(now, wrap(heading), rudder, rate=rate))
        first = min(first, abs(heading)) if monitors.findings else first
    return monitors, first, abs(heading)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_rudder_at_the_other_stop_is_noticed_and_given_up(side: float) -> None:
    monitors, first, last = pushed(side * STOP, jammed=True)
    assert trouble(monitors) == AlarmEvent("runaway")
    assert first < math.radians(45.0)
    # three time constants of 5 s, and the time in which the rudder comes over
    assert last < math.radians(110.0)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_push_heavier_than_the_rudder_is_said_before_the_boat_has_come_round(side: float) -> None:
    monitors, first, _ = pushed(1.5 * side * STOP)
    assert trouble(monitors) is None
    assert ("starboard" if side > 0.0 else "port") in monitors.findings["overpowered"].detail
    assert first < math.radians(45.0)


@pytest.mark.parametrize("gust", [0.5, 0.7, 0.85])
def test_a_boat_that_is_overpowered_is_not_given_up(gust: float) -> None:
    """Up to 1.6 times what the rudder can do, for two minutes: an alarm, and the pilot keeps at it."""
    monitors = Monitors(LIMITS)
    helmed(monitors, 120.0, 1.0, gust)
    assert trouble(monitors) is None


def in_heavy_waves(boat: Norrbin, push: float, side: float) -> Monitors:
    """Keep the rudder at its stop in waves that turn the boat quicker than the rudder does; the boat is pushed off its
    course, and from 50 deg off on by `push` [share of the rudder's stop]. Return the monitors after ten minutes."""
    monitors, heading, rate, tall, pace = Monitors(LIMITS), 0.0, 0.0, math.radians(5.0), 0.45
    for k in range(6000):
        now, shared = k * DT, push if heading > math.radians(50.0) or k > 3000 else 1.3
        rate = rate_step(boat, rate, (shared - 1.0) * STOP, DT)
        heading += rate * DT
        turned = heading + math.sqrt(2.0) * tall * math.sin(pace * now)
        turns = rate + math.sqrt(2.0) * tall * pace * math.cos(pace * now)
        seen = watched(now, side * turned, -side * STOP, rate=side * turns, boat=boat)
        monitors.update(seen._replace(state=seen.state._replace(wave_deviation=tall, wave_frequency=pace)))
        if trouble(monitors):
            break
    return monitors


SLUGGISH = [Norrbin(0.1, 20.0, 50.0, reference_speed=4.0), Norrbin(0.05, 1.0, reference_speed=4.0)]


@pytest.mark.parametrize("boat", SLUGGISH, ids=["slow", "weak"])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_wave_that_turns_the_boat_against_its_rudder_is_no_runaway(boat: Norrbin, side: float) -> None:
    """Pushed as hard as the rudder can hold, far off: each wave turns the boat to and fro, and none takes it round."""
    monitors = in_heavy_waves(boat, 1.0, side)
    assert trouble(monitors) is None
    assert "overpowered" in monitors.findings


@pytest.mark.parametrize("boat", SLUGGISH, ids=["slow", "weak"])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_rudder_at_the_other_stop_is_given_up_in_heavy_waves_too(boat: Norrbin, side: float) -> None:
    assert trouble(in_heavy_waves(boat, 2.0, side)) == AlarmEvent("runaway")


def test_a_boat_that_comes_back_slowly_is_not_given_up() -> None:
    monitors = Monitors(LIMITS)
    for k in range(1200):
        error = math.radians(120.0) * math.exp(-k * DT / 60.0)
        monitors.update(watched(k * DT, error, -STOP, rate=-error / 60.0))
        assert trouble(monitors) is None


def test_heel_is_said_when_it_lasts() -> None:
    monitors = Monitors(LIMITS)
    for k in range(30):
        monitors.on_samples((RollSample(k * DT, math.radians(-50.0)),))
    monitors.update(watched(3.0, 0.0))
    assert "heeling 50 deg" in sentences_of(alarms(monitors))[0]
    monitors.on_samples((RollSample(4.0, 0.1),))
    monitors.update(watched(4.0, 0.0))
    assert alarms(monitors) == ()


def test_what_goes_on_is_not_said_anew_with_every_degree() -> None:
    limits = LIMITS._replace(heading_jump=0.3, rate_disagrees=math.radians(15.0), innovation=3.0)
    monitors, said = Monitors(limits), set()
    for k in range(900):
        now = 0.1 * k
        # the boat swings slowly by 60 deg, heels by 41 to 49 deg, and its gyro has the wrong sign
        heading, rate = math.radians(60.0) * math.sin(0.3 * now), math.radians(18.0) * math.cos(0.3 * now)
        roll = math.radians(45.0 + 4.0 * math.sin(now))
        monitors.on_samples((HeadingSample(now, heading, -rate), RollSample(now, roll)))
        seen = watched(now, heading, wanted=heading)._replace(innovation=4.0 + math.sin(now))
        monitors.update(seen)
        said |= {text for text in sentences_of(alarms(monitors)) if "go together" in text}
        if now > 30.0:
            names = {"roll", "rate_disagrees", "innovation"}
            assert monitors.findings.keys() == names, "it comes and goes with the swing, and is one alarm"
    assert len(said) < 8
    assert len({event for event in monitors.findings.values() if event.name == "roll"}) == 1


def test_a_gyro_of_the_wrong_sign_is_reported_in_one_swing_until_it_is_put_right() -> None:
    limit = math.radians(15.0)
    monitors, reported = Monitors(LIMITS._replace(rate_disagrees=limit)), []

    def hear(now: float, sign: float, swing: float) -> None:
        heading, rate = swing * math.sin(now), swing * math.cos(now)
        monitors.on_samples((HeadingSample(now, heading, sign * rate),))
        monitors.update(watched(now, heading))
        reported.append(bool(monitors.state.consistency.found))

    for k in range(1, 100):
        hear(0.1 * k, -1.0, math.radians(5.0))
    assert reported.index(True) < 40
    assert "opposite ways" in monitors.findings["rate_disagrees"].detail
    for k in range(100, 700):
        hear(0.1 * k, -1.0, 0.0)
    assert reported[-1], "a boat that lies still shows nothing of its gyro"
    for k in range(700, 1100):
        hear(0.1 * k, 1.0, math.radians(5.0))
    assert not reported[-1]
    assert "rate_disagrees" not in monitors.findings


def test_a_gyro_of_the_wrong_sign_is_nobodys_business_where_that_is_not_watched() -> None:
    monitors = Monitors(LIMITS._replace(rate_disagrees=math.inf))
    for k in range(200):
        monitors.on_samples((HeadingSample(0.1 * k, 0.5 * math.sin(0.1 * k), -0.5 * math.cos(0.1 * k)),))
        assert not monitors.state.consistency.found


def test_a_gyro_that_drifts_from_the_compass_is_reported_by_how_much() -> None:
    monitors, reported = Monitors(LIMITS._replace(rate_disagrees=math.radians(15.0))), []
    for bias_deg_s in (0.4, 0.7, 0.9, 0.6, 0.4, -0.8, -0.2):
        monitors.update(watched(0.0, 0.0)._replace(rate_bias=math.radians(bias_deg_s)))
        event = monitors.findings.get("rate_disagrees")
        reported.append("" if event is None else event.detail)
    assert reported == ["", "", "0.9 deg/s apart", "0.9 deg/s apart", "", "0.8 deg/s apart", ""]


def test_a_gyro_that_is_right_again_is_believed_after_a_while() -> None:
    monitors, disagreed = Monitors(LIMITS._replace(rate_disagrees=math.radians(15.0))), []
    for k in range(500):
        rate = 0.2 if k < 100 else 0.0
        monitors.on_samples((HeadingSample(0.1 * k, 0.0, rate),))
        monitors.update(watched(0.1 * k, 0.0))
        disagreed.append("rate_disagrees" in monitors.findings)
    assert disagreed.index(True) < 40
    assert disagreed[250]
    assert not disagreed[400]


@given(
    st.lists(
        st.tuples(
            st.floats(allow_nan=True, allow_infinity=True), st.floats(allow_nan=True), st.booleans(), st.booleans()
        ),
        max_size=40,
    )
)
def test_monitors_raise_nothing_whatever_samples_come(ticks: list[tuple[float, float, bool, bool]]) -> None:
    monitors = Monitors(LIMITS)
    for k, (heading, rudder, holds, heels) in enumerate(ticks):
        monitors.on_samples((HeadingSample(k * DT, heading, rudder), RollSample(k * DT, heading if heels else 0.0)))
        monitors.update(watched(k * DT, heading, rudder, holds=holds))
        assert all(isinstance(text, str) for text in sentences_of(alarms(monitors)))


def test_a_second_look_at_thrusters_at_the_same_time_tells_nothing() -> None:
    look = ThrusterLook(BOAT, 0.0, 0.0, 0.0, 1.0, True, 0.5, 1.0, 0.6, True, True, DT)
    memory, _ = thruster_step(thruster_step(NO_THRUST_SEEN, look)[0], look)
    assert memory.way is not None
    assert thruster_step(memory, look._replace(heading=1.0, speed=0.5, rudder=0.1, dt=0.0)) == (memory, None)


def test_a_boat_that_answers_by_half_for_a_dead_thruster_is_steered_on() -> None:
    """Steering ended: the boat then circled on the living thruster, where it can be held on its course."""
    weak = AlarmEvent("thruster_weak", "port")
    unanswered, sensed = VERDICTS[1], AlarmEvent("rudder_stuck", "at 3 deg")
    over = AlarmEvent("overpowered", "to port")
    found = {each.name: each for each in (unanswered, over)}
    assert with_weak_thruster(found, None) == found
    assert with_weak_thruster(found, weak) == {"overpowered": over, "thruster_weak": weak}
    assert with_weak_thruster({sensed.name: sensed}, weak)["rudder_stuck"] == sensed, "its sensor knows"


def test_a_boat_that_leaves_its_course_has_no_thruster_that_keeps_it() -> None:
    """Both stood still, and it was steered for 54 s while it turned by 300 deg."""
    weak, off, unanswered = AlarmEvent("thruster_weak", "port"), AlarmEvent("off_course"), VERDICTS[1]
    found = {each.name: each for each in (unanswered, off)}
    assert with_weak_thruster(found, weak) == {**found, "thruster_weak": weak}


def test_what_others_see_is_said_until_they_take_it_back() -> None:
    monitors = Monitors(LIMITS)
    monitors.on_samples((ConditionSample(0.0, "battery_low", True, "11 %", "vehicle"),))
    monitors.on_samples(
        (ConditionSample(0.0, "battery_low", True, "9 %", "second"), ConditionSample(0.0, "no such", True))
    )
    monitors.update(watched(0.0, 0.0))
    assert monitors.findings.keys() == {"battery_low"}
    assert trouble(monitors) is None
    monitors.on_samples((ConditionSample(1.0, "battery_low", False, "", "second"),))
    monitors.update(watched(1.0, 0.0))
    assert "11 %" in sentences_of(alarms(monitors))[0]
    monitors.on_samples((ConditionSample(2.0, "battery_low", False, "", "vehicle"),))
    monitors.update(watched(2.0, 0.0))
    assert alarms(monitors) == ()


def jumped(period: float, seconds: float, back: float = math.inf) -> float:
    """When a compass that jumps by 40 deg after 2 s, and back after so long, is said to jump; inf: never."""
    monitor = Jumping(math.radians(20.0))
    for tick in range(round(seconds / period)):
        now = tick * period
        away = 2.0 - 1e-9 <= now < 2.0 + back - 1e-9
        monitor.on_sample(HeadingSample(now, math.radians(40.0) if away else 0.0))
        if monitor.found(watched(now, 0.0)):
            return now - 2.0
    return math.inf


@pytest.mark.parametrize(("period", "after"), [(0.1, 0.5), (0.05, 0.5), (0.2, 0.6), (0.5, 1.0), (1.0, 2.0)])
def test_a_jump_for_good_is_said_after_half_a_second_and_three_samples(period: float, after: float) -> None:
    assert jumped(period, 10.0) == pytest.approx(after)
    assert jumped(period, 10.0, after) == math.inf, "it was back before"


def test_what_a_sea_turns_a_boat_by_between_slow_headings_is_no_jump_beside_a_rate() -> None:
    """Swept round by 40 deg/s for 3 s, a heading a second, while the boat is estimated not to turn."""
    for rate_deg_s, is_said in ((40.0, False), (None, True), (0.0, True), (-40.0, True)):
        monitor, said = Jumping(math.radians(25.0)), ""
        for second in range(20):
            swept = 10.0 <= second < 13.0
            heading = 40.0 * min(max(second - 10.0, 0.0), 3.0)
            rate = None if rate_deg_s is None else math.radians(rate_deg_s) if swept or second == 13 else 0.0
            monitor.on_sample(HeadingSample(float(second), math.radians(heading), rate))
            said = said or monitor.found(watched(float(second), 0.0))
        assert bool(said) is is_said, rate_deg_s


@pytest.mark.parametrize("period", [0.1, 0.2, 0.5, 1.0])
@pytest.mark.parametrize("smoothing", [1.0, 0.5, 0.2])
@pytest.mark.parametrize("turning_deg_s", [0.0, 5.0, -5.0])
def test_a_rate_that_is_made_of_the_headings_hides_no_jump(
    period: float, smoothing: float, turning_deg_s: float
) -> None:
    """It shows half of the jump, or less, as if the boat had turned so."""
    turning = math.radians(turning_deg_s)
    for jump_deg in (26.0, 35.0, 45.0, 60.0, 90.0):
        monitor, said, last, rate = Jumping(math.radians(25.0)), "", 0.0, turning
        for step in range(round(20.0 / period)):
            time = step * period
            heading = turning * time + (math.radians(jump_deg) if time >= 10.0 else 0.0)
            rate += smoothing * ((heading - last) / period - rate) if step else 0.0
            last = heading
            monitor.on_sample(HeadingSample(time, wrap(heading), rate))
            said = said or monitor.found(watched(time, 0.0, rate=turning))
        assert said, jump_deg


def test_a_jump_is_said_for_five_seconds_with_its_side() -> None:
    for side in (-1.0, 1.0):
        monitor, said = Jumping(0.3), []
        for tick in range(100):
            now = 0.1 * tick
            monitor.on_sample(HeadingSample(now, side * 0.7 if now > 1.95 else 0.0))
            said.append(monitor.found(watched(now, 0.0)))
        assert said[24:26] == ["", f"by {side * 40.0:+.0f} deg"]
        assert said[74] == said[25] and said[75] == ""


def test_three_spikes_within_ten_seconds_are_a_jump_and_two_or_slower_ones_are_not() -> None:
    for apart, count, is_said in ((4.9, 3, True), (4.9, 2, False), (5.1, 6, False)):
        monitor, found = Jumping(0.3), ""
        for tick in range(400):
            now = 0.1 * tick
            is_spike = any(abs(now - 2.0 - apart * number) < 0.04 for number in range(count))
            monitor.on_sample(HeadingSample(now, 1.0 if is_spike else 0.0))
            found = found or monitor.found(watched(now, 0.0))
        assert bool(found) is is_said


@pytest.mark.parametrize(("gap", "is_seen"), [(1.9, True), (2.1, False)])
def test_across_more_than_two_seconds_of_silence_no_jump_is_seen(gap: float, is_seen: bool) -> None:
    monitor, found = Jumping(0.3), ""
    monitor.on_sample(HeadingSample(0.0, 0.0))
    for tick in range(20):
        now = gap + 0.1 * tick
        monitor.on_sample(HeadingSample(now, 1.0))
        found = found or monitor.found(watched(now, 0.0))
    assert bool(found) is is_seen


def test_another_compass_that_shows_another_heading_has_not_jumped() -> None:
    monitor, found = Jumping(0.3), ""
    for tick in range(40):
        monitor.on_sample(HeadingSample(0.1 * tick, 1.0 if tick > 20 else 0.0, None, "b" if tick > 20 else "a"))
        found = found or monitor.found(watched(0.1 * tick, 0.0))
    assert found == ""


def said(monitors: Monitors, name: str) -> str:
    """The sentence of an alarm by its name, empty where it is none."""
    return next(iter(sentences_of(tuple(event for event in monitors.findings.values() if event.name == name))), "")


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_an_innovation_that_lasts_for_twenty_seconds_is_said_in_its_first_number(side: float) -> None:
    monitors = Monitors(LIMITS._replace(innovation=3.0))

    def look(now: float, innovation_mean: float, **change: bool) -> str:
        monitors.update(watched(now, 0.0)._replace(innovation=side * innovation_mean, **change))
        return said(monitors, "innovation")

    assert [look(now, 3.1) for now in (1.0, 10.0, 20.75)] == ["", "", ""]
    first = look(21.0, 3.1)
    assert "3.1 standard deviations" in first
    assert look(22.0, 9.0) == first
    assert look(23.0, 3.0) == "", "at the limit it is over"
    assert [look(now, 4.0) for now in (24.0, 43.75)] == ["", ""]
    assert "4.0" in look(44.0, 4.0)
    assert look(45.0, 4.0, has_way=False) == ""


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_heel_is_said_after_two_seconds_and_anew_with_ten_degrees_more(side: float) -> None:
    monitors = Monitors(LIMITS)

    def heel(now: float, degrees: float) -> str:
        monitors.on_samples((RollSample(now, side * math.radians(degrees)),))
        monitors.update(watched(now, 0.0))
        return said(monitors, "roll")

    assert [heel(now, 40.5) for now in (0.0, 1.0, 1.75)] == ["", "", ""]
    assert heel(2.0, 41.0).startswith("heeling 41 deg")
    assert heel(2.5, 50.75).startswith("heeling 41 deg"), "less than ten degrees more"
    assert heel(3.0, 51.25).startswith("heeling 51 deg")
    assert heel(3.5, 42.0).startswith("heeling 51 deg")
    assert heel(4.0, 39.75) == ""
    assert heel(5.0, 45.0) == "", "it begins anew"


@pytest.mark.parametrize(("age", "is_said"), [(5.0, False), (5.25, True)])
def test_a_wind_that_is_wanted_and_not_heard_for_five_seconds_is_said(age: float, is_said: bool) -> None:
    for is_wanted in (True, False):
        monitors = Monitors(LIMITS._replace(wind_wanted=is_wanted))
        monitors.update(watched(0.0, 0.0))
        assert ("no_wind" in monitors.findings) is is_wanted, "never heard"
        monitors.on_samples((WindSample(1.0, 0.5, 6.0),))
        monitors.update(watched(1.0 + age, 0.0))
        assert ("no_wind" in monitors.findings) is (is_wanted and is_said)


def test_what_waits_for_way_and_speeds_that_no_stream_explains_are_said_while_they_are() -> None:
    monitors = Monitors(LIMITS)
    for change, name in (({"waits": True}, "low_speed"), ({"speeds_apart": 0.1}, "speeds_disagree")):
        monitors.update(watched(0.0, 0.0)._replace(**change))  # type: ignore[arg-type]
        assert monitors.findings.keys() == {name} and trouble(monitors) is None
        monitors.update(watched(0.1, 0.0))
        assert monitors.findings == {}


def test_without_its_state_a_monitor_knows_nothing_of_what_was_found() -> None:
    monitors = Monitors(LIMITS._replace(innovation=3.0, wind_wanted=False))
    monitors.on_samples((ConditionSample(0.0, "battery_low", True, "11 %", "vehicle"),))
    for tick in range(300):
        now = 0.1 * tick
        monitors.on_samples((RollSample(now, 1.0), HeadingSample(now, math.radians(25.0), 0.0)))
        monitors.update(watched(now, math.radians(25.0))._replace(innovation=4.0))
    assert monitors.findings.keys() >= {"battery_low", "roll", "innovation", "off_course"}
    known = Monitors(monitors.limits, monitors.state)
    known.update(watched(30.1, math.radians(25.0))._replace(innovation=4.0))
    assert known.findings.keys() == monitors.findings.keys(), "all that is remembered is the state"
    monitors = Monitors(monitors.limits)
    assert (monitors.findings, monitors.state) == ({}, State())
    monitors.update(watched(30.1, math.radians(25.0))._replace(innovation=4.0))
    assert monitors.findings == {}


OTHERS = {"": FILED, "quick": QUICKER, "slow": SLOW_RUDDER, "lively": LIVELIER}


class Said:
    """What the counts of swings, the rate of turn and the rudder's answer say, whatever the boat does."""

    swings = throws = verdict = 0
    rushes = outruns_speed = doubts_trial = False
    fast, other = 0.0, ""

    @staticmethod
    def of_swings(before: Swings, sweep: float, *_: object) -> Swings:
        return Swings(sweeps=Said.swings if sweep == SWEEP else Said.throws)

    @staticmethod
    def of_spin(*_: object) -> Spin:
        return Spin(
            True, rate=Said.fast or 0.3, is_fast=Said.fast != 0.0, rushes=Said.rushes, outruns_speed=Said.outruns_speed
        )

    @staticmethod
    def of_answer(*_: object) -> Response:
        return Response(other=OTHERS[Said.other], verdict=Said.verdict, doubts_trial=Said.doubts_trial)


def stubbed(monkeypatch: pytest.MonkeyPatch, **words: object) -> None:
    monkeypatch.setattr("autopilot.supervision.course_watch.swings_step", Said.of_swings)
    monkeypatch.setattr("autopilot.supervision.course_watch.spin_step", Said.of_spin)
    monkeypatch.setattr("autopilot.supervision.rudder_watch.judge_response", Said.of_answer)
    for name, value in words.items():
        monkeypatch.setattr(Said, name, value)


STEADY, UNSTEADY = BOAT, BOAT._replace(n1=-1.0, n3=50.0)
LOW = {"trial_speed": 9.0}


@pytest.mark.parametrize(
    ("boat", "before", "words", "change", "names", "softer"),
    [
        (STEADY, 0, {"swings": 3, "throws": 3}, {}, (), 1.0),
        (STEADY, 0, {"swings": 4}, {}, ("hunting",), 4.0),
        (STEADY, 0, {"throws": 4}, {}, ("hunting",), 4.0),
        (STEADY, 0, {"swings": 9, "throws": 9}, {}, ("hunting",), 4.0),
        (STEADY, 1, {"swings": 9}, {}, ("hunting",), 16.0),
        (STEADY, 1, {"throws": 5}, {}, ("hunting",), 16.0),
        (STEADY, 1, {"throws": 6}, {}, ("swinging", "hunting"), 4.0),
        (STEADY, 2, {"swings": 3}, {}, ("hunting",), 16.0),
        (STEADY, 2, {"throws": 5}, {}, ("hunting",), 16.0),
        (STEADY, 2, {"swings": 4}, {}, ("swinging", "hunting"), 16.0),
        (UNSTEADY, 0, {"swings": 9, "throws": 5}, {}, ("hunting",), 1.0),
        (UNSTEADY, 0, {"throws": 6}, {}, ("swinging",), 1.0),
        (BOAT._replace(n1=0.0), 0, {"throws": 6}, {}, ("swinging",), 1.0),
        (STEADY, 0, {"rushes": True}, {}, ("hunting",), 4.0),
        (STEADY, 0, {"rushes": True}, {"follows": False}, (), 1.0),
        (STEADY, 1, {"rushes": True}, {"follows": False}, ("hunting",), 4.0),
        (STEADY, 2, {"rushes": True}, {"follows": False}, ("hunting", "too_quick"), 16.0),
        (STEADY, 0, {"fast": -0.5}, {}, ("too_quick",), 1.0),
        (STEADY, 0, {"swings": 4}, LOW, (), 1.0),
        (UNSTEADY, 0, {"swings": 4}, LOW, (), 1.0),
        (STEADY, 0, {"outruns_speed": True}, LOW, (), 1.0),
        (STEADY, 0, {"outruns_speed": True}, {}, (), 1.0),
        (STEADY, 2, {}, {"steers": False}, (), 1.0),
    ],
)
def test_of_swings_the_law_orders_less_and_where_that_is_not_enough_steering_ends(
    monkeypatch: pytest.MonkeyPatch,
    boat: Norrbin,
    before: int,
    words: dict[str, object],
    change: dict[str, object],
    names: tuple[str, ...],
    softer: float,
) -> None:
    """Four sweeps are suspect and six a cycle; 4 times less is ordered, then 16 times; a speed that reads too low is
    the likelier cause, and doubted first."""
    stubbed(monkeypatch, swings=4)
    monitors = Monitors(LIMITS)
    seen = watched(0.0, 0.0, boat=boat)._replace(follows=True)
    for _ in range(before):
        monitors.update(seen)
    stubbed(monkeypatch, swings=0)
    stubbed(monkeypatch, **words)
    monitors.update(seen._replace(**change))  # type: ignore[arg-type]
    assert (tuple(sorted(monitors.findings)), monitors.state.course.softer) == (tuple(sorted(names)), softer)
    assert monitors.state.rudder.doubts_speed is (change == LOW)


@pytest.mark.parametrize(
    ("boat", "others", "change", "name", "softer", "rests"),
    [
        (STEADY, ("lively",), {}, "lively", 4.0, False),
        (STEADY, ("slow",), {}, "rudder_slow", 4.0, False),
        (STEADY, ("quick",), {}, "too_quick", 1.0, False),
        (STEADY, ("lively", "slow", ""), {}, "rudder_slow", 4.0, False),
        (STEADY, ("slow", "lively", ""), {}, "rudder_slow", 4.0, False),
        (STEADY, ("quick", "slow", "lively"), {}, "too_quick", 1.0, False),
        (STEADY, ("slow", ""), {"damps_roll": True}, "rudder_slow", 1.0, True),
        (STEADY, ("lively",), {"damps_roll": True}, "lively", 4.0, False),
        (UNSTEADY, ("slow",), {}, "rudder_not_following", 1.0, False),
        (BOAT._replace(n1=0.0), ("slow",), {"damps_roll": True}, "rudder_not_following", 1.0, False),
        (UNSTEADY, ("lively",), {}, "lively", 4.0, False),
    ],
)
def test_what_the_answer_tells_of_boat_and_rudder_counts_until_we_let_go(
    monkeypatch: pytest.MonkeyPatch,
    boat: Norrbin,
    others: tuple[str, ...],
    change: dict[str, object],
    name: str,
    softer: float,
    rests: bool,
) -> None:
    monitors = None
    for other in (*others, ""):
        stubbed(monkeypatch, other=other)
        monitors = monitors or Monitors(LIMITS._replace(rudder_response=True))
        monitors.update(watched(0.0, 0.0, boat=boat)._replace(**change))  # type: ignore[arg-type]
    assert monitors is not None
    assert (set(monitors.findings), monitors.state.course.softer, monitors.state.rudder.rests_roll) == (
        {name},
        softer,
        rests,
    )
    monitors.update(watched(0.0, 0.0, boat=boat)._replace(steers=False))
    assert (monitors.findings, monitors.state.course.softer, monitors.state.rudder.rests_roll) == ({}, 1.0, False)


def test_where_the_answer_is_not_watched_nothing_of_it_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    stubbed(monkeypatch, verdict=1)
    for is_watched in (True, False):
        monitors = Monitors(LIMITS._replace(rudder_response=is_watched))
        monitors.update(watched(0.0, 0.0))
        assert ("rudder_stuck" in monitors.findings) is is_watched


def test_a_trial_that_is_doubted_is_said_for_ten_seconds_while_we_steer(monkeypatch: pytest.MonkeyPatch) -> None:
    stubbed(monkeypatch, doubts_trial=True)
    monitors = Monitors(LIMITS._replace(rudder_response=True))
    monitors.update(watched(50.0, 0.0))
    monkeypatch.setattr(Said, "doubts_trial", False)
    for later, steers, is_said in ((0.0, True, True), (9.9, False, False), (9.9, True, True), (10.0, True, False)):
        monitors.update(watched(50.0 + later, 0.0)._replace(steers=steers))
        assert ("trial_doubtful" in monitors.findings) is is_said


def test_for_ten_seconds_behind_a_doubted_trial_what_is_enough_in_a_turn_is_enough(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """11 together, each of the headings' 10.4: on a course it takes 14."""
    blocks = NO_RESPONSE.blocks._replace(stuck=1.1, stuck_late=1.1)
    known = NO_RESPONSE._replace(stuck=10.5, stuck_late=10.5, blocks=blocks)

    def of_answer(*_: object) -> Response:
        return Response(evidence=NOTHING_KNOWN._replace(response=known), doubts_trial=Said.doubts_trial)

    for is_doubted in (False, True):
        stubbed(monkeypatch, doubts_trial=is_doubted)
        monkeypatch.setattr("autopilot.supervision.rudder_watch.judge_response", of_answer)
        monitors = Monitors(LIMITS._replace(rudder_response=True))
        monitors.update(watched(50.0, 0.0, holds=False))
        monkeypatch.setattr(Said, "doubts_trial", False)
        for later in (0.1, 9.9, 10.0):
            monitors.update(watched(50.0 + later, 0.0))
            assert ("rudder_stuck" in monitors.findings) is (is_doubted and later < 10.0)


@pytest.mark.parametrize(
    ("answer", "other", "trial", "is_doubted"),
    [
        ("", "quick", 9.0, True),
        ("rudder_reversed", "lively", 9.0, True),
        ("rudder_reversed", "lively", 5.1, True),
        ("rudder_reversed", "lively", 4.9, False),
        ("rudder_stuck", "slow", 9.0, False),
        ("rudder_stuck", "", 9.0, False),
        ("rudder_stuck", "", 3.1, True),
        ("rudder_stuck", "", 3.2, False),
        ("rudder_stuck", "", 3.3, False),
        ("rudder_reversed", "", 3.1, False),
        ("rudder_stuck", "quick", 4.0, False),
    ],
)
def test_what_a_wrong_speed_explains_is_no_fault_of_the_rudder(
    monkeypatch: pytest.MonkeyPatch, answer: str, other: str, trial: float, is_doubted: bool
) -> None:
    """At 4 m/s: a boat that answers more may be quicker than it reads, one that answers less slower, by a quarter."""
    verdicts = {"": 0, "rudder_stuck": 1, "rudder_reversed": -1}
    stubbed(monkeypatch, verdict=verdicts[answer], other=other)
    monitors = Monitors(LIMITS._replace(rudder_response=True))
    monitors.update(watched(0.0, 0.0)._replace(trial_speed=trial))
    assert monitors.state.rudder.doubts_speed is is_doubted
    assert (answer in monitors.findings) is (answer != "" and not is_doubted)
    assert ("speed_doubtful" in monitors.findings) is is_doubted
