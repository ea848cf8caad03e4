"""Learning while sailing: it finds the boat, proves what it found, and moves no rudder until it is adopted."""

from __future__ import annotations

import dataclasses
import math
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
from autopilot.identification.learning import CHANCE, Learner, Outcome, PredictionTest, Proposal, _Candidate
from autopilot.models.norrbin import Norrbin
from autopilot.pilot import Pilot
from autopilot.runtime.build import build_pilot, gear_of, learner_of, model_of
from autopilot.runtime.record import Recorder, read_log, replay
from autopilot.runtime.session import Session
from autopilot.runtime.tuning import (
    GainRequest,
    LearningService,
    VesselStore,
    bandwidths_of,
    designed,
    holding_bandwidth,
    with_learnt,
)
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
    seconds: float, path: Path | None = None, *, learns: bool = True, typed: dict[float, str] | None = None
) -> Sailed:
    """Sail a vessel file that is off; `typed` are the lines that the skipper types at these times."""
    pilot, boat, saved = build_pilot(off(), learns=learns), Boat(), []
    store = VesselStore(off(), pilot, None, Path("x.tuned.yaml"), lambda path, text: saved.append(text))
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


def test_nothing_is_learnt_where_nobody_tells_the_rudder() -> None:
    pilot = build_pilot(off(), learns=True)
    for i in range(600):
        now = 0.1 * i
        heading = 0.3 * math.sin(0.5 * now)
        pilot.learn(pilot.step(now, (HeadingSample(now, heading, 0.15 * math.cos(0.5 * now)),), Order()))
    assert pilot.learner is not None
    assert pilot.learner.moved == 0.0
    assert pilot.learner.estimate == pytest.approx(model_of(off()))


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
    wide = proposal._replace(standard_errors={**errors, "gain": 0.15})
    assert wide.verdict.startswith("good for a start") is is_proved


def stretches_of(learner: Learner, outcomes: list[Outcome]) -> bool:
    """Judge a candidate by these errors; return whether it is ever called proved."""
    learner._candidate = _Candidate(Norrbin(0.6, 0.4), {"gain": 0.05, "time_constant": 0.03, "n3": 1.0}, 60.0)
    learner._prediction_test = PredictionTest(learner.present, learner._candidate.model)
    learner._candidates += 1
    for outcome in outcomes:
        learner._judge(outcome)
    proposal = learner.proposal()
    return proposal is not None and proposal.is_proved


def test_a_candidate_that_halves_the_error_is_hardly_ever_called_proved_however_often_one_looks() -> None:
    """It may be worse in other weather. Fewer than CHANCE of 1000 series of 300 stretches."""
    random = np.random.default_rng(20261124)
    proved = 0
    for _ in range(1000):
        errors = np.radians(random.standard_normal((300, 2)) * [6.0, 3.0])
        proved += stretches_of(Learner(model_of(off())), [Outcome(*pair) for pair in errors.tolist()])
    assert proved <= 1000 * CHANCE


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
