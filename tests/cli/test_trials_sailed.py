"""Each trial sailed by the pilot on a boat in a box: what was ordered happens, is measured, and ends when it must."""

from __future__ import annotations

import argparse
import itertools
import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from alarm_texts import other
from plant import Plant

from autopilot.angles import wrap
from autopilot.cli.main import main
from autopilot.control.registry import TRIAL_LAW
from autopilot.guidance.manoeuvres import (
    BinaryHelm,
    SteadyRate,
    TrialLimits,
    TrialWatch,
    Turned,
    binary_sequence,
    spiral_angles,
)
from autopilot.identification.trial_measures import Measures, TrialRecord, measures_of, record_of
from autopilot.operators.trial_script import TrialScript, steps_of
from autopilot.report.log_pages import trials_page
from autopilot.runtime.build import build_pilot, gear_of, limits_of, model_of
from autopilot.signals import AlarmEvent, AlarmSample, HelmSample, Mode, PositionSample, Sample, SpeedSample, Tick
from autopilot.supervision.panel import WORDS
from autopilot.vessel.file import load_vessel

VESSEL = load_vessel("lanxin")
SPEED = VESSEL.model.reference_speed_m_s
DT = 0.05


def options(kind: str, **changed: object) -> argparse.Namespace:
    """Return the options of a trial as the command line gives them by default."""
    from autopilot.cli.main import build_parser

    parsed = build_parser().parse_args(["trial", kind, "lanxin", "--link", "udpin:127.0.0.1:0"])
    for name, value in changed.items():
        assert hasattr(parsed, name)
        setattr(parsed, name, value)
    return parsed


def script_of(kind: str, limits: TrialLimits | None = None, **changed: object) -> TrialScript:
    return TrialScript(steps_of(options(kind, **changed), VESSEL.rudder.angle_max_deg, model_of(VESSEL)), limits)


def sail(
    script: TrialScript, seconds: float = 600.0, extra: Callable[[float], list[Sample]] = lambda _: []
) -> tuple[list[Tick], Plant]:
    """Sail the script to its end on a noise-free boat at constant speed."""
    plant = Plant(model_of(VESSEL), gear_of(VESSEL), heading=3.0)
    pilot = build_pilot(VESSEL, TRIAL_LAW)
    ticks: list[Tick] = []
    while plant.time < seconds and not script.is_over:
        samples = (*plant.sense(), SpeedSample(plant.time, SPEED, source="log"), *extra(plant.time))
        tick = pilot.step(plant.time, samples, script(plant.time, ticks[-1] if ticks else None))
        ticks.append(tick)
        plant.step(tick.command.angle if tick.command.engaged else 0.0, DT)
    return ticks, plant


def record(ticks: list[Tick]) -> TrialRecord:
    columns = {
        "time_s": np.array([tick.now for tick in ticks]),
        "heading_rad": np.array([tick.state.heading for tick in ticks]),
        "yaw_rate_rad_s": np.array([tick.state.rate for tick in ticks]),
        "rudder_rad": np.array([tick.state.rudder for tick in ticks]),
        "speed_m_s": np.array([tick.state.speed for tick in ticks]),
    }
    return record_of("sailed", columns)


def measured(ticks: list[Tick]) -> Measures:
    return measures_of(record(ticks))


def steady_rate(rudder: float) -> float:
    """Return the rate [rad/s] at which n3 r^3 + r = K d, by numpy's roots."""
    model = model_of(VESSEL)
    roots = np.roots([model.n3, 0.0, 1.0, -model.gain * rudder])
    return float(roots[np.abs(roots.imag) < 1e-9].real[0])


def test_a_turning_circle_turns_540_degrees_to_both_sides() -> None:
    script = script_of("turning-circle")
    ticks, _ = sail(script)
    assert script.is_complete
    first, second = measured(ticks).circles
    assert math.degrees(first.turned) == pytest.approx(540.0, abs=10.0)
    assert (math.degrees(first.rudder), math.degrees(second.rudder)) == pytest.approx((30.0, -30.0), abs=0.1)
    assert first.radius == pytest.approx(SPEED / steady_rate(math.radians(30.0)), rel=0.01)
    assert second.tactical_diameter == pytest.approx(first.tactical_diameter, rel=0.02)


def test_a_spiral_stays_until_each_turn_is_steady() -> None:
    script = script_of("spiral")
    ticks, _ = sail(script)
    assert script.is_complete
    spiral = measured(ticks).spiral
    assert spiral is not None
    assert len(spiral.down) == len(spiral.up) == 13
    for angle, rate in spiral.down:
        assert rate == pytest.approx(steady_rate(angle), abs=0.03 * steady_rate(math.radians(15.0)))
    assert math.degrees(spiral.width) < 0.5


def test_a_pull_out_of_a_stable_boat_leaves_nothing() -> None:
    script = script_of("pull-out")
    ticks, _ = sail(script)
    found = measured(ticks).pull_outs
    assert [round(math.degrees(one.rudder)) for one in found] == [20, -20]
    for one in found:
        assert abs(one.turn_rate) == pytest.approx(steady_rate(math.radians(20.0)), rel=0.03)
        assert abs(one.residual_rate) < 0.03 * abs(one.turn_rate)


def test_a_zigzag_after_an_approach_swings_about_the_course_it_came_on() -> None:
    script = script_of("zigzag", approach=8.0, duration=40.0)
    ticks, _ = sail(script)
    assert all(tick.command.angle == 0.0 for tick in ticks if 1.0 < tick.now < 7.9)
    (one,) = measured(ticks).zigzags
    assert one.begins == pytest.approx(8.0, abs=0.3)
    assert len(one.overshoots) >= 3


def test_a_binary_sequence_is_led_back_when_it_strays() -> None:
    script = script_of("prbs", hold=2.0, swing_deg=40.0, duration=200.0)
    ticks, _ = sail(script)
    assert script.is_complete
    swings = np.degrees([wrap(tick.state.heading - 3.0) for tick in ticks])
    assert np.max(np.abs(swings)) < 90.0
    assert np.max(np.abs(swings)) > 40.0, "it does stray"
    sides = [tick.demand for tick in ticks if tick.now > 1.0]
    assert set(np.round(np.degrees(sides), 6)) <= {-10.0, 10.0, 0.0}
    assert sum(a != b for a, b in itertools.pairwise(sides)) > 20


def test_the_sequence_is_of_full_length_and_repeats() -> None:
    """A maximum-length sequence of 9 bits: period 511, 256 of one side, and its autocorrelation is -1/511."""
    sides = np.array(list(itertools.islice(binary_sequence(7), 2 * 511)))
    np.testing.assert_array_equal(sides[:511], sides[511:])
    assert abs(int(sides[:511].sum())) == 1
    for lag in (1, 2, 37, 255):
        assert int(np.sum(sides[:511] * np.roll(sides[:511], lag))) == -1
    assert list(itertools.islice(binary_sequence(1), 20)) != list(itertools.islice(binary_sequence(2), 20))


def test_a_helm_that_has_strayed_leads_back_until_half_way() -> None:
    helm = BinaryHelm(hold=1000.0, corridor=1.0, seed=3)
    own = helm.side(0.0, 0.0)
    assert [helm.side(1.0, 1.1), helm.side(2.0, 0.8), helm.side(3.0, 0.51)] == [-1, -1, -1]
    assert helm.side(4.0, 0.49) == own
    assert helm.side(5.0, -1.2) == 1


@pytest.mark.parametrize(
    ("largest", "coarse", "fine", "down"),
    [
        (15.0, 5.0, 2.0, [15, 10, 8, 6, 4, 2, 0, -2, -4, -6, -8, -10, -15]),
        (20.0, 5.0, 5.0, [20, 15, 10, 5, 0, -5, -10, -15, -20]),
        (3.0, 2.0, 2.0, [3, 1, 0, -1, -3]),
    ],
)
def test_a_spiral_goes_to_port_and_back(largest: float, coarse: float, fine: float, down: list[float]) -> None:
    angles = np.degrees(spiral_angles(*np.radians([largest, coarse, fine])))
    np.testing.assert_allclose(angles, [*down, *down[-2::-1]], atol=1e-9)


def test_a_rate_is_steady_only_after_a_whole_window_without_change() -> None:
    watch = SteadyRate(window=4.0, tolerance=0.001)
    times = np.arange(0.0, 30.0, 0.1)
    steady = [watch.take(float(t), 0.1 * (1.0 - math.exp(-t / 2.0))) for t in times]
    at = float(times[steady.index(True)])
    # halves 2 s apart differ by 0.1 e^(-t/2) times (e - 1)^2: below 0.001 from 10.7 s on
    assert at == pytest.approx(2.0 * math.log(0.1 * (math.e - 1.0) ** 2 / 0.001), abs=0.5)
    assert all(steady[steady.index(True) :])


def test_turns_are_counted_through_north() -> None:
    count = Turned()
    for degrees in range(0, -720, -50):
        count.take(wrap(math.radians(degrees)))
    assert math.degrees(count.angle) == pytest.approx(-700.0)


@pytest.mark.parametrize(
    ("limits", "expected"),
    [
        (TrialLimits(time=7.0), "the time limit of 7 s is over"),
        (TrialLimits(speed_low=5.0), "the speed of 4.63 m/s is outside 5 to inf m/s; set the throttle"),
        (TrialLimits(speed_high=4.0), "the speed of 4.63 m/s is outside"),
        (TrialLimits(corridor=math.radians(12.0)), "the heading is +12 deg off the course at the beginning, beyond 12"),
        (TrialLimits(radius=30.0), "the boat is 30 m from where the trial began, beyond 30 m"),
    ],
)
def test_a_limit_ends_the_trial_and_releases_the_rudder(limits: TrialLimits, expected: str) -> None:
    script = script_of("zigzag", limits)
    ticks, _ = sail(script)
    assert script.is_over
    assert not script.is_complete
    assert expected in script.reason
    assert script(ticks[-1].now + DT, ticks[-1]).serial == 0, "standby from now on"
    assert script.describe(ticks[-1]) == ""


def test_the_distance_is_that_of_the_positions_where_there_are_any() -> None:
    """A current of 1 m/s to the north: positions see it, dead reckoning would not."""
    watch = TrialWatch(TrialLimits())
    at_rest = sail(script_of("zigzag", duration=2.0))[0][-1]
    for i in range(61):
        now = at_rest.now + 0.5 * i
        place = PositionSample(now, 1.0 + 0.5 * i / 6.371e6, 0.2)
        state = at_rest.state._replace(speed=0.0, heading=1.0)
        assert watch.reason(at_rest._replace(now=now, samples=(place,), state=state)) == ""
    assert watch.distance == pytest.approx(30.0, rel=0.01)


@pytest.mark.parametrize("how", ["override", "failsafe"])
def test_a_supervisor_event_ends_the_trial_with_its_reason(how: str) -> None:
    def taken(now: float) -> list[Sample]:
        return (
            [HelmSample(now, False, "the skipper moved the stick", "radio")] if how == "override" and now > 5.0 else []
        )

    script = script_of("turning-circle")
    if how == "override":
        ticks, _ = sail(script, extra=taken)
        assert "the pilot left the helm (override): " in script.reason
        assert "the skipper moved the stick" in script.reason
    else:
        ticks, _ = sail(script, 5.0)
        pilot_lost = ticks[-1]._replace(mode=Mode.FAILSAFE, alarms=(other("heading lost"),))
        script(pilot_lost.now + DT, pilot_lost)
        assert script.reason == "the pilot left the helm (failsafe): heading lost"
    assert script.is_over
    assert not script.is_complete


@pytest.mark.parametrize("name", ["heading_disagrees", "geofence", "shallow", "disk_full", "rate_disagrees"])
def test_an_alarm_that_comes_up_ends_the_trial(name: str) -> None:
    script = script_of("zigzag", TrialLimits())
    ticks, _ = sail(script, 3.0)
    script(ticks[-1].now + DT, ticks[-1]._replace(alarms=(AlarmEvent(name, "seen just now"),)))
    assert script.is_over
    assert script.reason.startswith(f"alarm: {WORDS[name].text} (seen just now)")


def test_a_trial_that_is_not_logged_from_the_start_is_not_sailed() -> None:
    script = script_of("zigzag", TrialLimits())
    full = AlarmSample(0.0, AlarmEvent("disk_full", "No space left on device"), "log")
    ticks, _ = sail(script, 20.0, lambda now: [full] if now == 0.0 else [])
    assert script.is_over and not script.is_complete
    assert not any(tick.mode is Mode.ENGAGED for tick in ticks[2:])
    assert script.reason.startswith(f"alarm: {WORDS['disk_full'].text}")


@pytest.mark.parametrize("name", ["rudder_at_stop", "innovation", "deadline_missed", "link_flooded"])
def test_what_a_trial_brings_with_it_or_is_sailed_for_does_not_end_it(name: str) -> None:
    script = script_of("zigzag", TrialLimits())
    ticks, _ = sail(script, 3.0)
    script(
        ticks[-1].now + DT, ticks[-1]._replace(alarms=(AlarmEvent(name), other("what a link says in words of its own")))
    )
    assert not script.is_over


def test_an_alarm_that_was_there_before_is_no_news_even_said_again() -> None:
    watch, (tick,) = TrialWatch(TrialLimits()), sail(script_of("zigzag", duration=2.0))[0][-1:]
    low = AlarmEvent("battery_low")
    assert watch.reason(tick._replace(alarms=(low,))) == ""
    assert watch.reason(tick._replace(alarms=(low._replace(is_escalated=True),))) == ""
    shallow = AlarmEvent("shallow")
    assert watch.reason(tick._replace(alarms=(low._replace(is_escalated=True), shallow))) == shallow


def test_progress_is_reported_in_words() -> None:
    script = script_of("pull-out", TrialLimits(time=1000.0))
    ticks, _ = sail(script, 3.0)
    expected = script.describe(ticks[-1])
    assert expected.startswith("1/4 turn +20 deg  477 s left  ")
    assert expected.endswith("m off")


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["turning-circle", "--rudder-deg", "31"], "--rudder-deg 31: allowed is 1 to 30"),
        (["turning-circle", "--turn-deg", "45"], "--turn-deg 45: allowed is 90 to 3600"),
        (["spiral", "--step-deg", "0.1"], "--step-deg 0.1: allowed is 0.5 to 15"),
        (["spiral", "--fine-step-deg", "7"], "--fine-step-deg 7: allowed is 0.5 to 5"),
        (["pull-out", "--each", "0"], "--each 0: allowed is 1 to 36000"),
        (["prbs", "--hold", "0"], "--hold 0: allowed is 0.2 to 600"),
        (["prbs", "--swing-deg", "nan"], "--swing-deg nan: allowed is 5 to 120"),
        (["zigzag", "--approach", "-1"], "--approach -1: allowed is 0 to 36000"),
        (["zigzag", "--radius-m", "0"], "--radius-m 0: allowed is 0.1 to 1000000"),
        (["zigzag", "--corridor-deg", "200"], "--corridor-deg 200: allowed is 1 to 180"),
        (["zigzag", "--speed-min-m-s", "3", "--speed-max-m-s", "2"], "--speed-min-m-s 3 must be below"),
    ],
)
def test_options_that_cannot_be_are_one_sentence(
    arguments: list[str], expected: str, capsys: pytest.CaptureFixture[str]
) -> None:
    kind, *rest = arguments
    written = [f"{name}={value}" for name, value in zip(rest[::2], rest[1::2], strict=True)]
    assert main(["trial", kind, "lanxin", "--link", "udpin:127.0.0.1:0", *written]) == 2
    said = capsys.readouterr().err.strip().splitlines()
    assert len(said) == 1
    assert expected in said[0]


def test_the_rudder_stays_inside_the_limits_of_the_vessel_file() -> None:
    narrow = replace(VESSEL, limits=replace(VESSEL.limits, angle_max_deg=12.0))
    most = math.degrees(limits_of(narrow).angle_max)
    steps = steps_of(options("turning-circle"), most, model_of(narrow))
    assert max(abs(step.order.rudder) for step in steps) == pytest.approx(math.radians(12.0))


def test_the_page_of_a_spiral_shows_every_angle_the_track_and_the_steady_turns() -> None:
    sailed = record(sail(script_of("spiral"), 3000.0)[0])
    measures = measures_of(sailed)
    assert measures.spiral is not None
    page = trials_page("<spiral>.tlog", sailed, measures, 7.0, "autopilot log measures spiral.tlog")
    assert page.count("<svg") == 3
    assert "&lt;spiral&gt;.tlog" in page
    assert "<spiral>" not in page
    for angle, rate in measures.spiral.down:
        assert f"<td>rudder {math.degrees(angle):+.1f} deg</td><td>{math.degrees(rate):+.2f} deg/s" in page


def test_a_record_without_speed_has_no_track_and_one_without_manoeuvre_says_so() -> None:
    time = np.arange(0.0, 20.0, 0.1)
    columns = {"time_s": time, "heading_rad": 0.0 * time, "rudder_rad": 0.0 * time}
    straight = record_of("straight", columns)
    page = trials_page("straight.tlog", straight, measures_of(straight), None, "autopilot log measures straight.tlog")
    assert page.count("<svg") == 1
    assert "No manoeuvre was found" in page
