"""The one sentence first: how well a boat was steered, what a trial was good for, and two runs beside each other."""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from boat_at_sea import SPEED, Sea
from lockstep import Lockstep
from memory import measured

from autopilot.angles import wrap
from autopilot.cli.main import main
from autopilot.files.printable import json_text
from autopilot.report.log_pages import compared, document_of_runs, measures_of_run, run_of, table_of_runs
from autopilot.report.steered import Steered, Turn, trial_verdict
from autopilot.signals import Mode, OrderKind, Tick
from autopilot.vessel.file import dump_vessel, load_vessel


def sailed(seconds: float, turns: tuple[str, ...] = ()) -> list[Tick]:
    """Return the ticks of a boat that holds its heading, then turns as typed, 40 s apart."""
    sea = Sea()
    sea.skipper.engage(None)
    sea.sail(seconds)
    for turn in turns:
        sea.skipper.type_line(turn)
        sea.sail(40.0)
    return sea.ticks


def worse(ticks: list[Tick], swing_deg: float) -> list[Tick]:
    """Return the same run with the boat swinging about its course, once in 8 s."""
    return [
        tick._replace(
            state=tick.state._replace(
                heading=tick.state.heading + math.radians(swing_deg) * math.sin(math.tau * tick.now / 8.0)
            )
        )
        for tick in ticks
    ]


def test_a_good_run_says_how_it_turned_and_held() -> None:
    steered = run_of("a", sailed(60.0, ("+90", "-30"))).steered
    assert steered.verdict is not None and steered.verdict.grade == "good"
    assert [round(math.degrees(turn.angle)) for turn in steered.turns] == [90, -30]
    assert "turned 90 deg in" in steered.verdict.sentence and "in 2 turns" in steered.verdict.sentence
    assert steered.past_deg < 2.0 and 5.0 < steered.turns[0].settled < 20.0
    assert 80.0 < steered.on_course < steered.seconds < 141.0
    assert steered.words.startswith("steered 14") and "deg rms off" in steered.words


def test_engaging_on_another_course_is_judged_as_a_turn() -> None:
    sea = Sea()
    sea.skipper.engage(math.radians(90.0))
    sea.sail(30.0)
    steered = run_of("a", sea.ticks).steered
    assert steered.verdict is not None and steered.verdict.grade == "good"
    assert [round(math.degrees(turn.angle)) for turn in steered.turns] == [90]


def engaged_in_a_turn() -> list[Tick]:
    """Return the ticks of a boat that is engaged on its heading while it turns, and goes past."""
    sea = Sea()
    sea.skipper.engage(None)
    sea.sail(1.0)
    sea.skipper.type_line("r 25")
    sea.sail(10.0)
    sea.skipper.engage(None)
    sea.sail(60.0)
    held = [tick for tick in sea.ticks if tick.now > 2.0 and tick.order.kind is OrderKind.HEADING]
    assert math.degrees(abs(held[0].state.rate)) > 10.0
    assert math.degrees(max(abs(wrap(tick.state.heading - held[-1].order.heading)) for tick in held)) > 6.0
    return held


def test_to_be_engaged_in_a_turn_is_no_course_badly_held() -> None:
    held = engaged_in_a_turn()
    steered = run_of("a", held).steered
    assert steered.verdict is not None and steered.verdict.grade == "good"
    assert 40.0 < steered.on_course < 58.0 and not steered.turns


def test_a_boat_that_swings_after_a_turn_is_still_called_so() -> None:
    held = engaged_in_a_turn()
    from_then = [tick._replace(now=tick.now - held[0].now) for tick in held]
    steered = run_of("a", worse(from_then, 10.0)).steered
    assert steered.verdict is not None and steered.verdict.grade == "poor"


def test_a_boat_that_never_comes_out_of_its_turn_is_not_judged_good() -> None:
    held = engaged_in_a_turn()
    away = [
        tick._replace(
            state=tick.state._replace(heading=held[0].state.heading + 0.01 * (tick.now - held[0].now), rate=0.01)
        )
        for tick in held
    ]
    verdict = run_of("a", away).steered.verdict
    assert verdict is not None and verdict.sentence == "too short to judge: the turn to the course was not over"


def engaged_while_it_turns(
    seconds: float, error_deg: Callable[[float], float], rate_deg_s: Callable[[float], float], *, is_led: bool = False
) -> Steered:
    """Return what is measured of a boat so far off its course, and turning so fast, at each second since engaged."""
    held, steered = sailed(1.0)[-1], Steered()
    for now in (0.1 * step for step in range(round(10.0 * seconds))):
        heading = held.order.heading + math.radians(error_deg(now))
        state = held.state._replace(heading=heading, rate=math.radians(rate_deg_s(now)))
        order = held.order._replace(is_led=is_led)
        reference = held.reference._replace(heading=held.order.heading)
        steered(held._replace(now=now, state=state, order=order, reference=reference))
    return steered


def test_how_far_it_went_before_it_came_back_is_said() -> None:
    steered = engaged_while_it_turns(
        300.0, lambda now: max(0.0, 80.0 - abs(now - 80.0)), lambda now: (now < 80.0) - (now < 160.0) * (now > 80.0)
    )
    assert steered.verdict is not None and steered.verdict.grade == "good"
    assert "engaged in a turn, it went 80 deg past and was back in 157 s" in steered.verdict.sentence


def test_a_boat_not_back_in_three_minutes_is_poor() -> None:
    steered = engaged_while_it_turns(
        1200.0, lambda now: min(now, max(200.0 - now, 0.0)), lambda now: 1.0 if now < 100.0 else -1.0
    )
    assert steered.off_deg < 2.0, "the rest of it was held"
    assert steered.verdict is not None and steered.verdict.grade == "poor"
    assert "it went 100 deg past and was not back in 180 s" in steered.verdict.sentence


@pytest.mark.parametrize(("across_deg", "grade"), [(1.0, "good"), (4.0, "fair"), (15.0, "poor")])
def test_one_that_crosses_its_course_on_the_way_back_is_past_it(across_deg: float, grade: str) -> None:
    def error_deg(now: float) -> float:
        back = 20.0 - 10.0 * (now - 2.0)
        return min(10.0 * now, max(back, min(-2.0 * across_deg - back, 0.0)))

    def rate_deg_s(now: float) -> float:
        return 10.0 * (error_deg(now + 0.1) - error_deg(now))

    steered = engaged_while_it_turns(300.0, error_deg, rate_deg_s)
    assert steered.off_deg < 1.0 and steered.verdict is not None and steered.verdict.grade == grade
    assert ("to the other side" in steered.verdict.sentence) is (grade != "good")


def test_off_to_the_side_it_did_not_turn_to_is_badly_held() -> None:
    steered = engaged_while_it_turns(60.0, lambda now: -20.0 if now > 1.0 else 0.0, lambda now: 0.5)
    assert steered.verdict is not None and steered.verdict.grade == "poor"


def test_a_hold_is_judged_though_its_rate_sensor_shows_too_much() -> None:
    steered = engaged_while_it_turns(60.0, lambda now: 0.0, lambda now: 0.5)
    assert steered.verdict is not None and steered.verdict.grade == "good"


def test_led_from_far_off_its_course_it_is_judged_by_the_plan() -> None:
    steered = engaged_while_it_turns(
        60.0, lambda now: min(4.0 * now - 90.0, max(60.0 - now, 0.0)), lambda now: 4.0, is_led=True
    )
    assert steered.verdict is not None and steered.verdict.grade == "poor"


def test_a_fail_safe_on_the_way_back_is_lost_steering() -> None:
    held = engaged_in_a_turn()
    lost = [tick._replace(mode=Mode.FAILSAFE) if 2.0 < tick.now - held[0].now < 4.0 else tick for tick in held]
    steered = run_of("a", lost).steered
    assert steered.verdict is not None and steered.verdict.sentence.startswith("poor: steering was lost once")


def test_a_run_that_ends_in_its_first_turn_has_a_verdict_too() -> None:
    sea = Sea()
    sea.skipper.engage(math.radians(90.0))
    sea.sail(5.0)
    verdict = run_of("a", sea.ticks).steered.verdict
    assert verdict is not None and verdict.sentence == "too short to judge: the turn to the course was not over"
    lost = [*sea.ticks, sea.ticks[-1]._replace(mode=Mode.FAILSAFE, now=sea.ticks[-1].now + 0.1)]
    verdict = run_of("a", lost).steered.verdict
    assert verdict is not None and verdict.sentence.startswith("poor: steering was lost once; rudder ")


@pytest.mark.parametrize(("swing_deg", "grade"), [(0.2, "good"), (4.0, "fair"), (10.0, "poor")])
def test_a_boat_that_swings_is_called_so(swing_deg: float, grade: str) -> None:
    steered = run_of("a", worse(sailed(80.0), swing_deg)).steered
    assert steered.verdict is not None and steered.verdict.grade == grade
    assert steered.off_deg == pytest.approx(swing_deg, rel=0.1, abs=0.15)
    assert steered.rms_deg == pytest.approx(swing_deg / math.sqrt(2.0), rel=0.1)


@pytest.mark.parametrize(("travel_deg_s", "grade"), [(0.5, "good"), (1.5, "good"), (1.7, "fair"), (6.0, "fair")])
def test_a_rudder_that_hunts_holds_no_course_well(travel_deg_s: float, grade: str) -> None:
    ticks, angle, moved = sailed(80.0), 0.0, []
    for before, tick in itertools.pairwise(ticks):
        to = 1.0 if tick.now % 4.0 < 2.0 else -1.0
        angle += to * math.radians(travel_deg_s) * (tick.now - before.now)
        moved.append(tick._replace(command=tick.command._replace(angle=angle)))
    steered = run_of("a", moved).steered
    assert steered.held_travel_deg_s == pytest.approx(travel_deg_s, rel=0.02)
    assert steered.verdict is not None and steered.verdict.grade == grade
    assert ("which is busy" in steered.verdict.sentence) is (grade == "fair")
    by_thrust = Steered("two_thrusters")
    for tick in moved:
        by_thrust(tick)
    assert by_thrust.verdict is not None and by_thrust.verdict.grade == "good", "two thrusts wear no gear"


def test_lost_steering_and_short_runs_are_not_called_good() -> None:
    ticks = sailed(40.0)
    lost = [*ticks, ticks[-1]._replace(mode=Mode.FAILSAFE, now=ticks[-1].now + 0.1)]
    steered = run_of("a", lost).steered
    assert steered.lost == 1
    assert steered.verdict is not None and steered.verdict.sentence.startswith("poor: steering was lost once")
    short = run_of("a", sailed(10.0)).steered.verdict
    assert short is not None and short.grade == "too short"
    assert Steered().verdict is None and Steered().words == "nothing was steered"
    assert math.isnan(Steered().off_deg) and math.isnan(Steered().travel_deg_s)


def test_a_turn_that_does_not_settle_is_poor() -> None:
    steered = run_of("a", sailed(40.0)).steered
    steered.turns.append(Turn(1.0, math.inf, 0.1))
    assert steered.verdict is not None and "without settling" in steered.verdict.sentence


def test_a_trial_is_good_for_identification_or_not() -> None:
    sea = Sea()
    sea.skipper.engage(None)
    sea.sail(3.0)
    run = sea.skipper.zigzag(math.radians(10.0), math.radians(10.0), 30.0)
    sea.sail(31.0)
    assert run.is_over
    steered = run_of("a", sea.ticks).steered
    assert steered.executes >= 4 and math.degrees(steered.swing[1]) > 10.0 > -10.0 > math.degrees(steered.swing[0])
    good = trial_verdict(steered, "")
    assert good.grade == "good" and "autopilot identify" in good.sentence
    assert trial_verdict(steered, "the helm was taken").sentence.startswith("not enough: it ended early (the helm")
    assert trial_verdict(Steered(), "").grade == "not enough"
    steered.executes = 2
    assert trial_verdict(steered, "").grade == "start"
    steered.swing = (0.0, 0.02)
    tied_up = trial_verdict(steered, "")
    assert tied_up.grade == "not enough" and "--at-dock" in tied_up.sentence


def test_at_the_dock_the_rudder_alone_is_proved_and_no_boat_identified() -> None:
    sea = Sea()
    sea.skipper.engage(None)
    sea.sail(3.0)
    sea.skipper.zigzag(math.radians(10.0), math.radians(10.0), 30.0)
    sea.sail(31.0)
    untied = run_of("a", sea.ticks).steered
    said = trial_verdict(untied, "", at_dock=True)
    assert said.grade == "start" and "did not lie still: tie it up" in said.sentence
    assert "identify" not in said.sentence
    assert untied.way == pytest.approx(SPEED, rel=0.05)
    drifting = trial_verdict(untied, "", least_way=1.1 * SPEED)
    assert drifting.grade == "not enough" and "made no way" in drifting.sentence
    untied.swing = (0.0, 0.02)
    tied = trial_verdict(untied, "", at_dock=True).sentence
    assert tied.startswith("good for the rudder alone") and "lay still" in tied
    assert trial_verdict(untied, "the helm was taken", at_dock=True).grade == "not enough"


def test_a_trial_that_is_not_good_enough_is_refused_where_that_is_asked(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def nothing_moved(arguments: Any, plan: Any, voyage: Any) -> int:
        print(voyage.verdict(Steered()).sentence)
        return 0

    monkeypatch.setattr("autopilot.cli.steering.steer", nothing_moved)
    given = ["trial", "zigzag", "lanxin", "--link", "udpin:127.0.0.1:1"]
    assert main(given) == 0
    assert main([*given, "--at-least", "start"]) == 4
    assert "--at-least start" in capsys.readouterr().err


def test_to_compare_two_logs_takes_no_memory_for_their_ticks(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    logs = [tmp_path / "one.tlog", tmp_path / "two.tlog"]
    for log in logs:
        steps = Lockstep(load_vessel("lanxin"), log=log)
        steps.engage(90.0)
        steps.run(60.0)
        steps.session.close()
    words = ["log", "compare", *map(str, logs)]
    assert main(words) == 0
    _, taken = measured(lambda: main(words))
    assert taken.peak < 2.0 * sum(log.stat().st_size for log in logs), "decoded they take ten times a file"


def test_two_runs_are_compared_by_course_and_rudder() -> None:
    ticks = sailed(60.0, ("+40",))
    calm, wild = run_of("calm", worse(ticks, 0.5)), run_of("wild", worse(ticks, 5.0))
    assert compared(calm, wild).grade == "worse" and compared(wild, calm).grade == "better"
    turning = run_of("turning", worse(sailed(60.0, ("+40", "-60", "+60")), 0.5))
    assert turning.steered.travel_deg_s > 1.5 * calm.steered.travel_deg_s
    assert "rudder travel alike" in compared(calm, turning).sentence, "a turn's rudder is no unquiet one"
    assert compared(calm, calm).grade == "alike" and compared(calm, run_of("no", [])).grade == "not enough"
    short = run_of("short", worse(sailed(5.0), 0.5))
    assert compared(calm, short).sentence == "not enough: both runs must hold a course for 20 s; short has 5 s of it"
    head, *rows = table_of_runs(calm, wild)
    assert head == ("", "calm", "wild", "second, of the first")
    assert {len(row) for row in rows} == {4} and len(rows) == len(measures_of_run(calm))
    nothing = json.loads(json_text(document_of_runs(calm, run_of("no", []))))["runs"][1]
    assert nothing["heading_rms_deg"] is None and table_of_runs(calm, run_of("no", []))[3][2:] == ("-", "")


def test_gains_begin_with_the_verdict(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    assert main(["gains", "lanxin", "--json", "--report", str(tmp_path / "gains.html")]) == 0
    found: dict[str, Any] = json.loads(capsys.readouterr().out)
    assert next(iter(found)) == "verdict" and found["verdict"]["sentence"].startswith("good: turns 90 deg in ")
    assert found["designed backstepping"]["stable"]
    page = (tmp_path / "gains.html").read_text()
    assert page.index("<svg") < page.index('class="verdict good"') < page.index("<table")
    assert page.count(", chosen<") == 1


def test_gains_for_a_model_that_is_not_enough_are_not_called_good(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    vessel = load_vessel("lanxin")
    path = tmp_path / "unknown.yaml"
    for share, grade in ((0.05, "good"), (0.25, "doubtful")):
        errors = replace(vessel.model.standard_errors, K_1_s=0.02, T_s=share * vessel.model.T_s)
        path.write_text(dump_vessel(replace(vessel, model=replace(vessel.model, standard_errors=errors))))
        assert main(["gains", str(path), "--json"]) == 0
        verdict = json.loads(capsys.readouterr().out)["verdict"]
        assert verdict["grade"] == grade, verdict
        assert ("a model known too little (K off by " in verdict["sentence"]) is (grade == "doubtful")
