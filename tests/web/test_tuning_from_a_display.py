"""Response level, and what was learnt, as a display orders them: in force between ticks, refused in words."""

from __future__ import annotations

from concurrent.futures import Future
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from boats import BOATS, vessel_of
from monitored_boat import AtOnce, Watched
from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.errors import InputError, RefusedError
from autopilot.runtime.tuning import GainRequest, designed


class NoGains(AtOnce):
    def submit(self, work: Any, /, *arguments: Any, **named: Any) -> Future[Any]:
        refused: Future[Any] = Future()
        refused.set_exception(RefusedError("no gains serve this boat"))
        return refused


def test_a_response_level_is_designed_and_put_in_force_while_steering(sea: Watched) -> None:
    sea.order(do="engage")
    assert sea.order(do="level", level=3) == (True, "")
    sea.watch(4.0)
    control, wanted = sea.store.running.control, designed(sea.store.running, GainRequest(3)).control
    assert control == wanted and control != vessel_of(BOATS["lanxin"]).control
    assert sea.station.view.snapshot(sea.now)["level"] == 3.0
    assert sea.station.view.texts.kept[-1].words == "response level 3"
    assert sea.tick is not None and sea.tick.mode.name == "ENGAGED"
    assert sea.order(do="level", level=8)[0]
    sea.watch(4.0)
    assert sea.station.view.snapshot(sea.now)["level"] == 8.0


def test_a_level_that_no_gains_serve_is_refused_and_all_stays(sea: Watched) -> None:
    before = sea.store.running
    sea.tuner._worker = NoGains()
    assert sea.order(do="level", level=9)[0]
    sea.watch(3.0)
    assert sea.station.view.snapshot(sea.now)["level"] is None
    assert sea.station.view.texts.kept[-1].words == "not changed: no gains serve this boat"
    assert sea.store.running == before and sea.commands.running is not None
    assert sea.commands.running.result == dialect.MAV_RESULT_FAILED


def test_without_learning_there_is_nothing_to_adopt(sea: Watched) -> None:
    assert sea.station.view.learning() == {}
    taken, words = sea.order(do="adopt")
    assert not taken and words == "nothing is learnt in this run: start with --learn"
    sea.watch(2.0)
    assert "start with --learn" in sea.station.view.texts.kept[-1].words


def test_a_learnt_model_is_seen_adopted_and_taken_back(tmp_path: Path) -> None:
    real = vessel_of(BOATS["lanxin"])
    wrong = replace(real, model=replace(real.model, K_1_s=0.6 * real.model.K_1_s, T_s=1.3 * real.model.T_s))
    sea = Watched(tmp_path, learns=True, vessel=wrong)
    sea.watch(3.0)
    learnt = sea.station.view.learning()
    assert learnt["lrn_state"] == 0.0 and learnt["lrn_K_in"] == pytest.approx(wrong.model.K_1_s, rel=1e-4)
    assert sea.order(do="adopt")[0] is False
    assert sea.order(do="zigzag", rudder=20, change=20, duration=200)[0]
    sea.until(lambda: sea.station.view.learning()["lrn_state"] == 2.0, 300.0)
    learnt = sea.station.view.learning()
    assert learnt["lrn_pK"] == pytest.approx(real.model.K_1_s, rel=0.1)
    assert learnt["lrn_new"] < learnt["lrn_old"]
    sea.order(do="cancel")
    sea.watch(2.0)
    assert sea.order(do="adopt") == (True, "")
    sea.watch(3.0)
    assert sea.store.running.model.K_1_s == pytest.approx(real.model.K_1_s, rel=0.1)
    assert sea.station.view.texts.kept[-1].words.startswith("adopted; K ")
    assert sea.order(do="revert") == (True, "")
    sea.watch(3.0)
    assert sea.store.running.model == wrong.model
    assert sea.order(do="revert")[0] is False


def test_one_change_at_a_time_and_only_known_ones(sea: Watched) -> None:
    assert sea.commands.execute(int(dialect.MAV_CMD_USER_5), (2.5,), sea.tick) == dialect.MAV_RESULT_DENIED
    assert sea.commands.execute(int(dialect.MAV_CMD_USER_5), (12.0,), sea.tick) == dialect.MAV_RESULT_DENIED
    assert sea.commands.execute(int(dialect.MAV_CMD_USER_4), (3.0,), sea.tick) == dialect.MAV_RESULT_UNSUPPORTED
    first = sea.tuner.set_level(4)
    with pytest.raises(InputError, match="another change"):
        sea.tuner.set_level(5)
    sea.tuner.turn()
    assert first.is_complete and sea.tuner.level == 4.0
