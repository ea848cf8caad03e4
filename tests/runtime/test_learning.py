"""Learning while sailing: it finds the boat, proves what it found, and moves no rudder until it is adopted."""

from __future__ import annotations

import copy
import dataclasses
import math
import re
from collections.abc import Callable
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import cast

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from manual_clock import ManualClock
from plant import Plant

from autopilot.errors import InputError, RefusedError
from autopilot.identification.learning import (
    CHANCE,
    HARD_TURNS,
    TRIED,
    Learner,
    Outcome,
    PredictionTest,
    Proposal,
    _Candidate,
    is_better_in_hard_turns,
)
from autopilot.identification.live_filter import LiveFilter
from autopilot.models.norrbin import Norrbin, rate_step
from autopilot.pilot import Pilot
from autopilot.runtime.build import build_pilot, gear_of, learner_of, model_of
from autopilot.runtime.record import Recorder, read_log, replay
from autopilot.runtime.session import Session
from autopilot.runtime.tuning import (
    GainRequest,
    LearningService,
    bandwidths_of,
    designed,
    holding_bandwidth,
    with_learnt,
)
from autopilot.runtime.vessel_store import VesselStore
from autopilot.signals import (
    HeadingSample,
    NavState,
    Order,
    OrderKind,
    Reference,
    RudderCommand,
    RudderSample,
    Sample,
    SpeedSample,
    Tick,
)
from autopilot.signals import Mode as PilotMode
from autopilot.vessel.file import dump_vessel, load_vessel
from autopilot.vessel.schema import Vessel

LANXIN = load_vessel("lanxin")
DT = 0.1
SPEED = LANXIN.model.reference_speed_m_s
ZIGZAG = Order(OrderKind.ZIGZAG, 0.0, math.radians(15.0), math.radians(15.0), serial=2)


@cache
def off() -> Vessel:
    """Return a file whose model is well off the boat, with the gains for it."""
    return designed(
        dataclasses.replace(LANXIN, model=dataclasses.replace(LANXIN.model, K_1_s=0.45, T_s=0.5, n3_s2_rad2=0.0))
    )


def order_at(now: float) -> Order:
    """Engage, zigzag for half a minute, then turns to and fro."""
    if now < 3.0:
        return Order(OrderKind.HEADING, 0.0, serial=1)
    if now < 35.0:
        return ZIGZAG
    return Order(OrderKind.HEADING, 0.8 if int(now / 10.0) % 2 else -0.8, serial=3)


class Boat:
    """The boat in a box as a link, with rudder feedback and a log."""

    name = "boat"

    def __init__(self, seed: int = 1) -> None:
        noise = math.radians(0.2), math.radians(0.1)
        self.plant = Plant(model_of(LANXIN), gear_of(LANXIN), heading_noise=noise[0], rate_noise=noise[1], seed=seed)
        self.commands: list[RudderCommand] = []

    def fileno(self) -> int:
        return -1

    def receive(self, now: float) -> list[Sample]:
        if now > self.plant.time:
            last = self.commands[-1] if self.commands else RudderCommand(0.0, 0.0, False)
            self.plant.step(last.angle if last.engaged else 0.0, now - self.plant.time)
        return [*self.plant.sense(), RudderSample(now, self.plant.rudder), SpeedSample(now, SPEED)]

    def send(self, now: float, command: RudderCommand) -> None:
        self.commands.append(command)

    def publish_tick(self, tick: Tick) -> None:
        pass

    def poll(self, now: float) -> None:
        pass

    def release(self, now: float) -> None:
        pass

    def take_packets(self) -> list[tuple[float, bytes]]:
        return []

    def close(self) -> None:
        pass


@dataclasses.dataclass
class Sailed:
    pilot: Pilot
    boat: Boat
    service: LearningService
    store: VesselStore
    saved: list[str]
    answers: list[str]


def sail(
    seconds: float,
    path: Path | None = None,
    *,
    learns: bool = True,
    typed: dict[float, str] | None = None,
    vessel: Vessel | None = None,
) -> Sailed:
    """Sail a vessel file, by default one that is off; `typed` are the lines that the skipper types at these times."""
    vessel = off() if vessel is None else vessel
    pilot, boat, saved = build_pilot(vessel, learns=learns), Boat(), []
    store = VesselStore(vessel, pilot, None, Path("x.tuned.yaml"), lambda path, text: saved.append(text))
    # where nothing learns nothing is typed to it
    service, answers, left = LearningService(cast(Learner, pilot.learner), store), [], sorted((typed or {}).items())
    recorder = None
    if path is not None:
        store.log = recorder = Recorder(path, {"vessel": dump_vessel(off()), "law": None}, 0.0)

    def watch(tick: Tick) -> bool:
        while left and tick.now >= left[0][0]:
            try:
                answers.append(service.type_line(left.pop(0)[1]) or "")
            except InputError as error:
                answers.append(f"error: {error}")
        return False

    with Session(pilot, [boat], ManualClock(), 1.0 / DT, lambda now, tick: order_at(now), recorder) as session:
        session.run(seconds, watch)
    return Sailed(pilot, boat, service, store, saved, answers)


@pytest.fixture(scope="module")
def sailed() -> Sailed:
    return sail(130.0)


def test_the_boat_is_learnt_and_the_model_proves_itself(sailed: Sailed) -> None:
    learner = sailed.pilot.learner
    assert learner is not None
    proposal = learner.proposal()
    assert proposal is not None and proposal.is_proved
    assert proposal.model.gain == pytest.approx(LANXIN.model.K_1_s, rel=0.05)
    assert proposal.model.time_constant == pytest.approx(LANXIN.model.T_s, rel=0.1)
    assert proposal.proposed_error < 0.5 * proposal.present_error


def test_learning_changes_no_command_until_adoption(sailed: Sailed) -> None:
    without = sail(130.0, learns=False)
    assert sailed.boat.commands == without.boat.commands
    assert not sailed.saved


def test_adopted_and_taken_back_on_a_word_logged_and_replayed(tmp_path: Path) -> None:
    log = tmp_path / "a.tlog"
    found = sail(150.0, log, typed={5.0: "adopt", 135.0: "adopt", 138.0: "learn", 142.0: "revert", 144.0: "revert"})
    early, adopted, report, reverted, nothing = found.answers
    assert early.startswith("error: nothing to adopt yet")
    assert adopted.startswith("adopted; K 0.45 -> 0.")
    assert "gains k1" in adopted
    assert "in force" in report
    assert reverted.startswith("reverted; K 0.")
    assert nothing.startswith("error: nothing to revert")
    assert len(found.saved) == 2
    assert "learnt while sailing" in found.saved[0]
    assert found.saved[1] == dump_vessel(off())
    assert len(read_log(log).changes) == 2
    result = replay(log)
    assert result.identical, result.detail
    assert found.pilot.config.model == model_of(off())


def test_adoption_moves_the_rudder_no_faster_than_its_limit() -> None:
    found = sail(145.0, typed={135.0: "adopt"})
    assert found.answers[0].startswith("adopted")
    angles = [command.angle for command in found.boat.commands]
    fastest = max(abs(now - before) for before, now in pairwise(angles))
    assert fastest <= math.radians(LANXIN.rudder.rate_max_deg_s or math.inf) * 0.5 + 1.0e-9


def test_what_has_not_proved_itself_is_not_adopted(monkeypatch: pytest.MonkeyPatch, sailed: Sailed) -> None:
    learner = sailed.pilot.learner
    assert learner is not None
    worse = [Outcome(0.01, 0.02)] * 10
    monkeypatch.setattr(learner, "_proved", None)
    monkeypatch.setattr(learner, "_wealth", np.full(5, 0.5))
    monkeypatch.setattr(learner, "_outcomes", worse)
    with pytest.raises(InputError, match="must predict better"):
        sailed.service.adopt()
    monkeypatch.setattr(learner, "_outcomes", [])
    with pytest.raises(InputError, match="no manoeuvre since"):
        sailed.service.adopt()


def test_a_model_that_no_gains_serve_is_refused(monkeypatch: pytest.MonkeyPatch, sailed: Sailed) -> None:
    def impossible(vessel: Vessel) -> Vessel:
        raise RefusedError("no gain gives a stable loop")

    learner = sailed.pilot.learner
    assert learner is not None
    monkeypatch.setattr("autopilot.runtime.tuning.designed", impossible)
    with pytest.raises(InputError, match="not adopted: no gain"):
        sailed.service.adopt()
    assert sailed.pilot.config.model == model_of(off())


def test_a_learning_result_is_announced_once(sailed: Sailed) -> None:
    assert sailed.pilot.learner is not None
    service = LearningService(sailed.pilot.learner, sailed.store)
    tick = Tick(
        1,
        100.0,
        (),
        Order(),
        NavState(0.0, 0, 0, 0, 0, 0, 0, True),
        Reference(0.0),
        0.0,
        RudderCommand(0, 0, False),
        PilotMode.STANDBY,
        (),
    )
    assert "learnt and proved (type adopt): K 0." in service.news(tick)
    assert service.news(tick._replace(now=200.0)) == ""
    assert service.type_line("e 90") is None
    tried = re.search(r"with up to (\d+) deg of rudder; good", service.type_line("learn") or "")
    assert tried is not None and 8 <= int(tried[1]) <= 35, "what it was not tried in nobody knows"


def test_nothing_is_learnt_where_nobody_tells_the_rudder() -> None:
    pilot = build_pilot(off(), learns=True)
    for i in range(600):
        now = 0.1 * i
        heading = 0.3 * math.sin(0.5 * now)
        pilot.learn(pilot.step(now, (HeadingSample(now, heading, 0.15 * math.cos(0.5 * now)),), Order()))
    assert pilot.learner is not None
    assert pilot.learner.moved == 0.0
    assert pilot.learner.estimate == pytest.approx(model_of(off()))


@pytest.mark.parametrize("taken_over_deg", [-25.0, 0.0, 25.0])
def test_a_rudder_that_lay_anywhere_at_takeover_spoils_nothing(taken_over_deg: float) -> None:
    """No feedback, another's rudder: it was taken to lie amidships, and the zigzag to be answered by a wave."""
    pilot, boat = build_pilot(off(), learns=True), Boat()
    boat.plant.rudder = math.radians(taken_over_deg)
    zigzag = Order(OrderKind.ZIGZAG, 0.0, math.radians(20.0), math.radians(20.0), serial=1)
    for i in range(int(40.0 / DT)):
        samples = tuple(each for each in boat.receive(DT * i) if not isinstance(each, RudderSample))
        tick = pilot.step(DT * i, samples, zigzag)
        boat.send(DT * i, tick.command)
        pilot.learn(tick)
    assert pilot.learner is not None and pilot.learner._fit.learns
    proposal = pilot.learner.proposal()
    assert proposal is not None
    assert proposal.model.gain == pytest.approx(LANXIN.model.K_1_s, rel=0.15)


def gusty(vessel: Vessel, heading: Callable[[float], float], seconds: float, seed: int = 1) -> Pilot:
    """Sail under the law in gusts worth 3 deg of rudder that last about 3 s."""
    random = np.random.default_rng(seed)
    disturbance = [0.0]
    for _ in range(int(seconds / DT) + 2):
        disturbance.append(
            0.967 * disturbance[-1] + math.radians(3.0) * math.sqrt(1.0 - 0.967**2) * random.standard_normal()
        )
    pilot, boat = build_pilot(vessel, learns=True), Boat()
    boat.plant.disturbance = lambda time: disturbance[int(time / DT)]
    for i in range(int(seconds / DT)):
        now = DT * i
        tick = pilot.step(now, tuple(boat.receive(now)), Order(OrderKind.HEADING, heading(now), serial=1))
        boat.send(now, tick.command)
        pilot.learn(tick)
    return pilot


def test_steering_against_gusts_is_not_taken_for_a_boat_that_hardly_turns() -> None:
    pilot = gusty(LANXIN, lambda now: 0.0, 120.0)
    learner = pilot.learner
    assert learner is not None
    rudder = [angle for _, angle in learner._rudders]
    assert max(rudder) - min(rudder) > math.radians(0.8), "the law works against the gusts"
    assert learner.proposal() is None or not cast(Proposal, learner.proposal()).is_proved
    assert learner.estimate.gain == pytest.approx(LANXIN.model.K_1_s, rel=0.35)


def test_turns_in_gusts_tell_the_gain_and_no_worse_model_is_proved() -> None:
    pilot = gusty(off(), lambda now: 0.6 if int(now / 15.0) % 2 else -0.6, 240.0)
    assert pilot.learner is not None
    assert pilot.learner.moved > 50.0
    assert pilot.learner.estimate.gain == pytest.approx(LANXIN.model.K_1_s, rel=0.2)
    right = gusty(LANXIN, lambda now: 0.6 if int(now / 15.0) % 2 else -0.6, 120.0)
    assert right.learner is not None
    proposal = right.learner.proposal()
    assert (
        proposal is None or not proposal.is_proved or proposal.model.gain == pytest.approx(LANXIN.model.K_1_s, rel=0.15)
    )


def test_a_changed_model_begins_the_learning_anew_and_changed_gains_do_not(sailed: Sailed) -> None:
    learner = learner_of(off())
    learner.begin(Norrbin(1.0, 1.0))
    assert learner.moved == 0.0 and learner.estimate == pytest.approx(Norrbin(1.0, 1.0))
    pilot = sailed.pilot
    moved = pilot.learner.moved if pilot.learner else 0.0
    pilot.reconfigure(pilot.config, pilot.law)
    assert pilot.learner is not None and pilot.learner.moved == moved > 0.0


@pytest.mark.parametrize("wrong", [np.linalg.LinAlgError("not positive"), ZeroDivisionError(), OverflowError()])
def test_a_learner_whose_numbers_come_to_nothing_begins_anew_and_steering_goes_on(
    monkeypatch: pytest.MonkeyPatch, wrong: Exception
) -> None:
    pilot = build_pilot(off(), learns=True)
    assert pilot.learner is not None
    before = pilot.learner._fit

    def fails(tick: Tick, *, steered: bool) -> None:
        raise wrong

    monkeypatch.setattr(pilot.learner, "learn", fails)
    pilot.learn(pilot.step(0.0, [], Order()))
    assert pilot.learner._fit is not before


def test_a_model_with_n2_is_not_learnt() -> None:
    vessel = dataclasses.replace(off(), model=dataclasses.replace(off().model, n2_s_rad=0.1))
    with pytest.raises(RefusedError, match="n2_s_rad"):
        build_pilot(vessel, learns=True)


def test_the_learnt_vessel_survives_its_file(sailed: Sailed) -> None:
    assert sailed.pilot.learner is not None
    proposal = sailed.pilot.learner.proposal()
    assert proposal is not None
    from autopilot.vessel.file import parse_vessel

    learnt = designed(with_learnt(off(), proposal))
    assert parse_vessel(dump_vessel(learnt), "x") == learnt


samples = st.one_of(
    st.builds(HeadingSample, st.floats(0.0, 30.0), st.floats(allow_nan=True), st.none() | st.floats()),
    st.builds(RudderSample, st.floats(0.0, 30.0), st.floats(), st.booleans()),
    st.builds(SpeedSample, st.floats(0.0, 30.0), st.floats()),
)


@given(st.lists(st.lists(samples, max_size=3), max_size=40))
@example([[], [HeadingSample(5.0e-324, 0.0, None)]])
@settings(max_examples=20, deadline=None)
def test_learned_estimates_stay_finite_whatever_samples_come(ticks: list[list[Sample]]) -> None:
    pilot = build_pilot(off(), learns=True)
    for i, given_samples in enumerate(ticks):
        now = 0.5 * i
        pilot.learn(pilot.step(now, (HeadingSample(now, 0.0, 0.0), *given_samples), order_at(now)))
    assert pilot.learner is not None
    assert all(math.isfinite(value) for value in pilot.learner.estimate)


def predicted(true: Norrbin, other: Norrbin, wind: float) -> list[tuple[float, Outcome]]:
    """Sail zigzags of the true boat for 40 s, then straight on for 20 s, in a wind worth so much rudder [rad]."""
    prediction_test, heading, rate = PredictionTest(other, true), 0.0, 0.0
    outcomes = []
    for i in range(1200):
        time = 0.05 * i
        rudder = 0.2 * math.sin(time) if i < 800 else -wind
        found = prediction_test.update(time, rudder, 1.0, heading, rate)
        outcomes += [(time, found)] if found else []
        for k in range(50):
            now = time + 0.001 * k
            push = 0.2 * math.sin(now) if i < 799 else rudder
            rate += 0.001 * (true.gain * (push + wind) - rate) / true.time_constant
            heading += 0.001 * rate
    return outcomes


@pytest.mark.parametrize("wind_deg", [0.0, 3.0])
def test_the_right_model_predicts_better_whatever_the_wind_and_stillness_tells_nothing(wind_deg: float) -> None:
    outcomes = predicted(Norrbin(0.5, 1.0), Norrbin(1.0, 1.0), math.radians(wind_deg))
    assert len(outcomes) >= 3
    assert all(time < 46.0 for time, _ in outcomes)
    right, wrong = (math.sqrt(np.mean([found[i] ** 2 for _, found in outcomes])) for i in (1, 0))
    assert right < 0.4 * wrong


@pytest.mark.parametrize("off", [0.6, 1.7])
def test_of_a_slow_ship_a_model_that_turns_as_it_does_is_put_forward_before_its_gain_is_known(off: float) -> None:
    """Turns of 40 deg every 240 s in a calm: nothing was put forward in two hours."""
    true, random = Norrbin(0.05, 40.0), np.random.default_rng(7399489100)
    learner, heading, rate, rudder = Learner(true._replace(gain=off * true.gain)), 0.0, 0.0, 0.0
    for second in range(1200):
        course = math.radians(40.0) * (second // 240 % 2)
        seen, felt = random.standard_normal(2) * np.radians([0.3, 0.05]) + [heading, rate]
        order = min(max(course - seen - 20.0 * felt, -0.35), 0.35)
        learner.update(float(second), rudder, 1.0, float(seen), float(felt))
        for _ in range(10):
            rudder += min(max(order - rudder, -0.005), 0.005)
            rate = rate_step(true, rate, rudder, 0.1)
            heading += 0.1 * rate
    proposal = learner.proposal()
    assert proposal is not None
    assert proposal.model.gain / proposal.model.time_constant == pytest.approx(true.gain / true.time_constant, rel=0.15)


@pytest.mark.parametrize(("ratio", "tells"), [(1.0, True), (0.1, False), (math.nan, False)])
def test_a_boat_without_way_tells_nothing_of_either_model(ratio: float, tells: bool) -> None:
    """She lies stopped, the wind turns her, the rudder is over: both models still turn at the least speed they know."""
    prediction_test = PredictionTest(Norrbin(1.0, 1.0), Norrbin(3.0, 1.0))
    found = [
        prediction_test.update(0.1 * k, 0.3 * math.sin(0.05 * k), ratio, 0.05 * k * math.pi / 18.0, None)
        for k in range(600)
    ]
    assert any(each is not None for each in found) is tells


def test_what_rounding_has_left_of_a_doubt_ends_no_tick() -> None:
    learner = Learner(model_of(off()))
    learner._fit.moved_s = 1000.0
    learner._fit._P[:, range(5, 8), range(5, 8)] = -1.0e-30
    learner._put_forward()
    assert learner.proposal() is None


def test_what_no_turn_tells_from_the_file_is_not_put_forward() -> None:
    """The file is right: every model put forward costs a chance, and none can halve its error."""
    found = sail(60.0, vessel=LANXIN)
    assert found.pilot.learner is not None
    assert found.pilot.learner.moved > 20.0
    assert found.pilot.learner.proposal() is None


def test_a_run_that_could_not_learn_says_so_before_it_opens_a_link(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from autopilot.cli.main import main

    path = tmp_path / "bent.yaml"
    path.write_text(dump_vessel(dataclasses.replace(LANXIN, model=dataclasses.replace(LANXIN.model, n2_s_rad=0.1))))
    assert main(["run", str(path), "--link", "udpin:127.0.0.1:0", "--learn"]) == 4
    assert "--learn knows no model.n2_s_rad" in capsys.readouterr().err


@pytest.mark.parametrize(("wealth", "is_proved"), [(99.9, False), (100.1, True)])
def test_a_proposal_is_proved_by_what_its_bets_have_made(wealth: float, is_proved: bool) -> None:
    errors = {"gain": 0.05, "time_constant": 0.03, "n3": 1.0}
    proposal = Proposal(Norrbin(0.7, 0.33), errors, 60.0, 12, 3.0, 0.1, 0.02, wealth, 100.0)
    assert proposal.is_proved is is_proved
    assert proposal.verdict.startswith("good, steer with it" if is_proved else "not proved yet")
    wide, wider = (proposal._replace(standard_errors={**errors, "gain": error}) for error in (0.1, 0.15))
    assert wide.verdict.startswith("good for a start") is is_proved
    assert wider.verdict.startswith("predicts better, though K and T by themselves are hardly known") is is_proved
    assert not proposal._replace(standard_errors={**errors, "gain": math.inf}).is_proved, "which way does it turn?"
    assert not proposal._replace(is_tried_hard=False).is_proved
    assert "turn with 20 deg of rudder" in proposal._replace(is_tried_hard=False).verdict


@pytest.mark.parametrize(
    ("turns", "rudder_deg", "other", "is_better"),
    [
        (5, 20.0, 0.01, True),
        (5, 18.0, 0.01, False),
        (4, 20.0, 0.01, False),
        (5, 20.0, 0.2, False),
    ],
)
def test_a_model_is_proved_only_where_it_was_tried(
    turns: int, rudder_deg: float, other: float, is_better: bool
) -> None:
    """A ship's model learnt with up to 18 deg of rudder predicted a 20/20 zigzag off by 5.5 deg, the file by 0.9."""
    gentle = [Outcome(0.1, 0.01, math.radians(10.0))] * 40
    assert is_better_in_hard_turns([*gentle, *[Outcome(0.1, other, math.radians(rudder_deg))] * turns]) is is_better


def test_a_boat_with_less_rudder_is_tried_with_all_it_has() -> None:
    """With 15 deg at most, no model could ever be proved."""
    little = dataclasses.replace(LANXIN, rudder=dataclasses.replace(LANXIN.rudder, angle_max_deg=15.0))
    for vessel, tried_deg, is_hard in ((little, 14.5, True), (little, 13.5, False), (LANXIN, 14.5, False)):
        learner = learner_of(vessel)
        stretches_of(learner, [Outcome(0.1, 0.01, math.radians(tried_deg))] * HARD_TURNS)
        assert cast(Proposal, learner.proposal()).is_tried_hard is is_hard
        store = VesselStore(vessel, build_pilot(vessel), None, Path("unused.yaml"))
        wanted = LearningService(learner, store).values()["lrn_hard"]
        assert wanted == pytest.approx(0.0 if is_hard else min(vessel.rudder.angle_max_deg, 20.0))


def test_a_rudder_that_does_too_little_for_anything_to_be_learnt_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    learner = learner_of(LANXIN)
    service = LearningService(learner, VesselStore(LANXIN, build_pilot(LANXIN), None, Path("unused.yaml")))
    said = []
    for is_blown in (False, True):
        monkeypatch.setattr(LiveFilter, "is_blown", is_blown)
        assert service.values()["lrn_blown"] == is_blown
        said.append(service.type_line("learn"))
    assert said[0] != said[1]


def stretches_of(learner: Learner, outcomes: list[Outcome]) -> bool:
    """Judge a candidate by these errors; return whether its bets ever prove it."""
    learner._candidate = _Candidate(Norrbin(0.6, 0.4), 60.0, 0.1)
    learner._prediction_test = PredictionTest(learner.present, learner._candidate.model)
    learner._candidates += 1
    wealth = 0.0
    for outcome in outcomes:
        learner._judge(outcome)
        wealth = max(wealth, float(np.mean(learner._wealth)))
    proposal = learner.proposal()
    return proposal is not None and wealth >= proposal.needed


def boat_between(share: float, weather_deg: float, count: int, random: np.random.Generator) -> list[Outcome]:
    """Return what two models that are 6 deg rms apart leave of a boat that is `share` of the way from the candidate to
    the present model, in a weather that turns the boat, and so is in both errors."""
    apart, weather = np.radians(random.standard_normal((2, count)) * [[6.0], [weather_deg]])
    return [Outcome(*pair) for pair in zip((1.0 - share) * apart - weather, -share * apart - weather, strict=True)]


@pytest.mark.parametrize("weather_deg", [0.5, 2.0, 8.0])
def test_a_candidate_that_halves_what_tells_the_models_apart_is_not_called_proved_however_often_one_looks(
    weather_deg: float,
) -> None:
    """It may be worse in other weather. No more than CHANCE of 400 series of 300 stretches, which is none."""
    random, learner = np.random.default_rng(20261124), Learner(model_of(off()))
    proved = 0
    for _ in range(400):
        learner.begin(model_of(off()))
        proved += stretches_of(learner, boat_between(1.0 / 3.0, weather_deg, 300, random))
    assert proved <= 400 * CHANCE


def test_only_a_candidate_that_could_have_been_proved_costs_a_chance(sailed: Sailed) -> None:
    """With three bets nobody makes 2000 of 1, with thirty one might."""
    for bets, candidates in ((3, 1), (30, 2)):
        learner = copy.deepcopy(cast(Learner, sailed.pilot.learner))
        learner._candidates, learner._bets, learner._has_lost = 1, bets, True
        learner._put_forward()
        assert learner._bets == 0, "it was replaced"
        assert learner._candidates == candidates


def test_a_candidate_is_replaced_when_it_has_won_nothing_in_its_last_bets(sailed: Sailed) -> None:
    learner = copy.deepcopy(cast(Learner, sailed.pilot.learner))
    before = learner._candidate
    learner._wealth, learner._bets, learner._wealth_then = np.ones(5), 0, 1.0
    learner._candidate = cast(_Candidate, before)._replace(doubt=1e-6)
    for outcome in boat_between(1.0, 0.5, TRIED - 1, np.random.default_rng(3)):
        learner._judge(outcome)
    learner._put_forward()
    assert learner._bets == TRIED - 1, "not yet"
    learner._judge(Outcome(0.0, 0.1))
    learner._put_forward()
    assert learner._bets == 0
    assert learner._candidate != before


def test_no_bet_is_made_while_the_rudder_only_answers_the_weather(
    monkeypatch: pytest.MonkeyPatch, sailed: Sailed
) -> None:
    learner = copy.deepcopy(cast(Learner, sailed.pilot.learner))
    monkeypatch.setattr(PredictionTest, "update", lambda *_: Outcome(0.2, 0.0))
    before, now = learner._bets, learner._looked + 100.0
    for works in (False, True):
        monkeypatch.setattr(LiveFilter, "learns", works)
        learner.update(now, 0.0, 1.0, 0.0, None)
        assert learner._bets == before + works


def test_weather_that_turns_both_models_boat_does_not_hide_the_right_one() -> None:
    """Gusts of 4 deg in the heading, models 6 deg apart, 100 stretches: it was proved in none of 50 series."""
    random, proved = np.random.default_rng(8), 0
    for _ in range(50):
        proved += stretches_of(Learner(model_of(off())), boat_between(0.0, 4.0, 100, random))
    assert proved >= 25


def test_a_candidate_with_a_quarter_of_the_error_is_proved_within_a_hundred_stretches() -> None:
    random = np.random.default_rng(7)
    proved = 0
    for _ in range(50):
        errors = np.radians(random.standard_normal((100, 2)) * [6.0, 1.5])
        proved += stretches_of(Learner(model_of(off())), [Outcome(*pair) for pair in errors.tolist()])
    assert proved >= 40


def test_a_boat_that_falls_off_at_speed_gets_a_regulator_that_is_quicker_than_that() -> None:
    otter = load_vessel("twin_thruster")
    assert holding_bandwidth(otter) == pytest.approx(2.455, abs=0.01)
    assert designed(otter, GainRequest(level=1)).control.backstepping.course_rad_s > 2.4
    assert bandwidths_of(otter).slowest == pytest.approx(2.455, abs=0.01), "and the table of levels says so"
    assert holding_bandwidth(load_vessel("lanxin")) == holding_bandwidth(load_vessel("blueboat")) == 0.0
