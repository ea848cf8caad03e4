"""An exception in any block of the tick: the rudder is given back, the links are closed, the log stays whole."""

from __future__ import annotations

import contextlib
import functools
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from lockstep import STEP, Lockstep

from autopilot import steering, tick
from autopilot.control import limits
from autopilot.links.base import LinkError
from autopilot.links.rudder_order import ReleaseState
from autopilot.pilot import Pilot
from autopilot.runtime.build import learner_of
from autopilot.runtime.record import read_log
from autopilot.signals import Mode
from autopilot.vessel.file import load_vessel

VESSEL = load_vessel("lanxin")
BLOCKS: dict[str, Callable[[Lockstep], tuple[Any, str]]] = {
    "receive": lambda run: (run.link, "receive"),
    "transport receive": lambda run: (run.near, "receive"),
    "orders": lambda run: (run.session, "_orders"),
    "estimator": lambda _: (tick, "estimated"),
    "monitors": lambda _: (tick, "judged"),
    "supervisor decides": lambda _: (tick.Supervisor, "decide"),
    "guidance": lambda _: (steering, "turn_step"),
    "law": lambda _: (tick, "ask_law"),
    "limits": lambda _: (limits, "limit"),
    "supervisor checks": lambda _: (tick.Supervisor, "check"),
    "alarms": lambda _: (tick, "update_panel"),
    "send": lambda run: (run.link, "send"),
    "transport send": lambda run: (run.near, "send"),
    "publish_tick": lambda run: (run.link, "publish_tick"),
    "poll": lambda run: (run.link, "poll"),
    "packets": lambda run: (run.link, "take_packets"),
    "record": lambda run: (run.session._recorder, "record"),
    "learn": lambda run: (learning(run.pilot), "learn"),
}


def learning(pilot: Pilot) -> Pilot:
    """The pilot, which learns its model from now on."""
    pilot.learner = learner_of(VESSEL)
    return pilot


class Fails:
    """Stands in a block's place: does what it did, and fails once when ordered to."""

    def __init__(self, block: Callable[..., Any], error: type[BaseException]) -> None:
        self.block, self.error = block, error
        self.now = False
        self.called = 0

    def __get__(self, owner: Any, _: type | None = None) -> Callable[..., Any]:
        return functools.partial(self, owner)

    def __call__(self, *arguments: Any, **named: Any) -> Any:
        self.called += 1
        if self.now:
            self.now = False
            raise self.error("the block failed")
        return self.block(*arguments, **named)


def alone(run: Lockstep, seconds: float) -> None:
    """Let the vehicle go on by itself, with what was sent before the link was closed."""
    with contextlib.suppress(LinkError):
        for data in run.far.receive():
            run.vehicle.receive(run.now, data)
    for _ in range(round(seconds / STEP)):
        run.clock.time += STEP
        run.vehicle.advance(run.now)


@pytest.mark.parametrize("error", [ValueError, MemoryError])
@pytest.mark.parametrize("block", BLOCKS)
def test_the_rudder_is_given_back(
    block: str, error: type[BaseException], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = Lockstep(VESSEL, log=tmp_path / "a.tlog")
    run.engage(90.0)
    assert run.run(20.0, until=run.engaged)
    owner, name = BLOCKS[block](run)
    failing = Fails(getattr(owner, name), error)
    monkeypatch.setattr(owner, name, failing)
    # hard over in the turn: a rudder left there would take the boat round
    assert run.run(5.0, until=lambda tick: abs(tick.command.angle) > math.radians(5.0))
    assert run.firmware.overrides.active(run.now, 3.0)
    before = len(run.ticks)
    assert failing.called
    failing.now = True
    with pytest.raises(error, match="the block failed"), run.session:
        run.run(2.0)
    alone(run, 5.0)
    assert not run.firmware.overrides.active(run.now, math.inf)
    assert abs(run.world.boat.state.rudder) < math.radians(0.5)
    ticks = read_log(tmp_path / "a.tlog").ticks
    assert before - 1 <= len(ticks) <= before + 1
    assert ticks[-1].mode is Mode.ENGAGED


def test_a_release_that_fails_is_made_good_while_the_links_wait_for_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = Lockstep(VESSEL)
    run.engage(90.0)
    assert run.run(20.0, until=lambda tick: abs(tick.command.angle) > math.radians(5.0))
    monkeypatch.setattr(run.link, "release", Fails(run.link.release, ValueError))
    run.link.release.now = True  # type: ignore[attr-defined]
    with pytest.raises(ValueError, match="the block failed"):
        run.session.close()
    assert run.session.releases[0].state is ReleaseState.CONFIRMED
    alone(run, 1.0)
    assert not run.firmware.overrides.active(run.now, 3.0)
    assert abs(run.world.boat.state.rudder) < math.radians(0.5)
