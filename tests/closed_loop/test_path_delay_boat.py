"""A path to the vehicle that is slower than its file says: learnt from the echo of the orders, and steered by."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from unittest.mock import Mock

import pytest
from lockstep import Lockstep, SlowLine

from autopilot.angles import wrap
from autopilot.cli.identify_vessel import with_path
from autopilot.cli.main import main
from autopilot.cli.steering import path_words
from autopilot.control.registry import TRIAL_LAW
from autopilot.errors import InputError
from autopilot.estimation.path_delay import NOT_ECHOED
from autopilot.identification.runs import Run
from autopilot.logs.own_log import path_in, path_of, read_own
from autopilot.logs.reading import LogOptions, ReadOptions, load_run
from autopilot.runtime.record import Recorder, read_logs, replay
from autopilot.runtime.tuning import designed
from autopilot.vessel.file import dump_vessel, load_vessel
from autopilot.vessel.schema import Control
from sitl.scenario import load_scenario
from sitl.serve import afloat
from sitl.world import World


def turned(delay: float, log: Path | None = None) -> tuple[Lockstep, float]:
    """Return the boat after a turn of 30 deg in which the path shows itself, and one back of 20, and by how much the
    second went too far [deg]."""
    boat = Lockstep(load_vessel("lanxin"), lines=(SlowLine(delay), SlowLine(delay)), log=log)
    boat.engage(30.0)
    boat.run(10.0)
    boat.engage(10.0)
    headings: list[float] = []
    boat.hooks.append(lambda boat: headings.append(math.degrees(wrap(boat.world.boat.state.heading))))
    boat.run(8.0)
    boat.session.close()
    return boat, 10.0 - min(headings)


def test_a_slow_line_is_learnt_and_turns_do_not_go_too_far() -> None:
    boat, over = turned(0.4)
    path = boat.pilot.state.estimate.path
    assert path.delay == pytest.approx(0.8, abs=0.05)
    assert over < 3.0
    assert [each.name for each in boat.tick.alarms] == ["path_late"]
    assert boat.tick.alarms[0].detail == f"measured {0.05 + path.late:.1f} s, filed 0.05 s"
    assert path_words(path, 0.05).startswith(f"path delay measured {path.delay:.2f} s, filed 0.05 s; ")


def test_what_was_learnt_replays_bit_for_bit_and_is_read_from_the_log(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    log = tmp_path / "a.tlog"
    boat, over = turned(0.15, log)
    path = boat.pilot.state.estimate.path
    assert path.late > 0.2
    assert over < 3.0
    assert replay(log).identical
    assert path_of(str(log)) == (path.delay, 0.05)
    with monkeypatch.context() as once:
        reads = Mock(wraps=read_logs)
        once.setattr("autopilot.logs.own_log.read_logs", reads)
        asked = LogOptions(ReadOptions(path_delay=True))
        vessel, (said,) = with_path("boat.yaml", load_vessel("lanxin"), [load_run(str(log), options=asked)])
    reads.assert_called_once()
    assert vessel.control.path_delay_s == round(path.delay, 2)
    assert said.startswith(f"Orders came to the rudder {round(path.delay, 2):g} s after their headings: ")
    main(["doctor", "--log", str(log)])
    assert (
        f"orders came {path.delay:.2f} s after their headings, control.loop_delay_s is 0.05" in capsys.readouterr().out
    )


def test_a_log_of_a_boat_without_gains_is_read_and_one_that_is_not_understood_holds_nothing_up(tmp_path: Path) -> None:
    lanxin = load_vessel("lanxin")
    boat = replace(lanxin, control=Control())
    for name, text in (("new", dump_vessel(boat)), ("old", "schema_version: 1\n")):
        Recorder(tmp_path / name, {"vessel": text, "law": TRIAL_LAW}, 0.0).close()
    assert math.isnan(path_of(str(tmp_path / "new")).measured)
    asked = ReadOptions(path_delay=True)
    runs = [Run(name, (), late=read_own(str(tmp_path / name), asked).late) for name in ("old", "new")]
    assert with_path("boat.yaml", boat, runs) == (boat, [])


def test_a_path_is_reckoned_only_where_somebody_wants_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    log = str(tmp_path / "a.tlog")
    Recorder(Path(log), {"vessel": dump_vessel(load_vessel("lanxin")), "law": TRIAL_LAW}, 0.0).close()
    reckoned, load = Mock(wraps=path_in), Mock(side_effect=InputError("that is all"))
    monkeypatch.setattr("autopilot.logs.own_log.path_in", reckoned)
    read_own(log)
    assert not reckoned.called
    monkeypatch.setattr("autopilot.logs.reading.load_run", load)
    for out in ([], ["--out", str(tmp_path / "boat.yaml")]):
        main(["identify", log, *out])
        assert load.call_args.args[-1].reading.path_delay == bool(out)


def test_what_was_made_of_the_rudder_before_its_path_was_known_does_not_count(monkeypatch: pytest.MonkeyPatch) -> None:
    """A boat 30 % weaker than its file behind 0.4 s each way: its first answer passed for a slow rudder's, and the law
    was softened for it until the boat swung by 12 deg."""
    true = load_vessel("lanxin")
    filed = designed(replace(true, model=replace(true.model, K_1_s=1.4 * true.model.K_1_s)))
    monkeypatch.setattr("lockstep.World", lambda _, *given, **named: World(true, *given, **named))
    boat = Lockstep(filed, lines=(SlowLine(0.4), SlowLine(0.4)))
    boat.engage(0.0)
    boat.run(8.0)
    boat.engage(30.0)
    boat.run(20.0)
    boat.session.close()
    assert [each.name for each in boat.tick.alarms] == ["path_late"]
    assert math.degrees(boat.world.boat.state.heading) == pytest.approx(30.0, abs=1.5)


def test_a_path_that_is_as_filed_changes_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    boat, _ = turned(0.0)
    path = boat.pilot.state.estimate.path
    assert path.delay < 0.1
    assert path_words(path, 0.05) == f"path delay measured {path.delay:.2f} s, filed 0.05 s"
    assert path_words(NOT_ECHOED, 0.05) == ""
    monkeypatch.setattr("autopilot.estimation.estimator.path_step", lambda *_: NOT_ECHOED)
    without, _ = turned(0.0)
    assert [tick.command for tick in without.ticks] == [tick.command for tick in boat.ticks]


def test_a_course_in_a_sea_is_held_no_worse_for_knowing_that_the_line_is_slow(monkeypatch: pytest.MonkeyPatch) -> None:
    """An outboard whose wind wants a third of its rudder, and gusts: what was reckoned ahead left out what its bias had
    not learnt, and waves that the slowed loop was not shown hid the gusts: 6.0 deg rms for 4.5."""
    vessel, scenario = load_vessel("outboard"), replace(load_scenario("sea-state-5"), seed=739947100)
    scenario, rms = afloat("outboard", scenario, vessel.drive.kind), []
    for is_measured in (True, False):
        if not is_measured:
            monkeypatch.setattr("autopilot.estimation.estimator.path_step", lambda *_: NOT_ECHOED)
        boat = Lockstep(vessel, lines=(SlowLine(0.4), SlowLine(0.4)), scenario=scenario)
        for heading in (0.0, 30.0, 10.0, 70.0):
            boat.engage(heading)
            boat.run(12.0)
        off: list[float] = []
        boat.hooks.append(lambda boat, off=off: off.append(wrap(boat.world.boat.state.heading - math.radians(70.0))))
        boat.run(60.0)
        boat.session.close()
        rms.append(math.degrees(math.sqrt(sum(each * each for each in off) / len(off))))
    known, unknown = rms
    assert known < unknown
