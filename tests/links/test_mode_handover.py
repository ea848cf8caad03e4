"""Handing the helm back to a mode of the flight controller: how often, how long, and what is said of a refusal."""

from __future__ import annotations

import pytest

from autopilot.links.mavlink.conditions import ModeHandover
from autopilot.signals import Mode

GIVE_UP_S = 30.0
PATIENCE_S = 3.0
REPEAT_S = 0.5

HOLD = 4


def begun() -> ModeHandover:
    handover = ModeHandover(HOLD)
    handover.publish_status(10.0, Mode.FAILSAFE)
    return handover


@pytest.mark.parametrize("mode", [Mode.STANDBY, Mode.ENGAGED, Mode.OVERRIDE])
def test_nothing_is_ordered_while_nothing_is_wrong(mode: Mode) -> None:
    handover = ModeHandover(HOLD)
    handover.publish_status(10.0, mode)
    assert handover.due(10.0, 1) == []
    assert handover.seen(99.0, 0, "link") == []


@pytest.mark.parametrize("mode", [Mode.FAILSAFE, Mode.FAULT])
def test_the_mode_is_ordered_again_until_the_vehicle_is_in_it(mode: Mode) -> None:
    handover = ModeHandover(HOLD)
    handover.publish_status(10.0, mode)
    (command,) = handover.due(10.0, 7)
    assert (command.target_system, command.param1, command.param2) == (7, 1, HOLD)
    assert [getattr(command, f"param{number}") for number in range(3, 8)] == [0] * 5
    assert handover.due(10.0 + 0.9 * REPEAT_S, 7) == []
    assert len(handover.due(10.0 + REPEAT_S, 7)) == 1
    handover.seen(12.0, HOLD, "link")
    assert handover.due(12.0 + REPEAT_S, 7) == []


def test_after_half_a_minute_it_gives_up_and_a_new_fail_safe_begins_anew() -> None:
    handover = begun()
    assert len(handover.due(10.0 + GIVE_UP_S, 1)) == 1
    assert handover.due(10.0 + GIVE_UP_S + REPEAT_S, 1) == []
    handover.publish_status(60.0, Mode.STANDBY)
    handover.publish_status(61.0, Mode.FAULT)
    assert len(handover.due(61.0, 1)) == 1


def test_a_refusal_is_said_once_and_taken_back_once() -> None:
    handover = begun()
    assert handover.seen(10.0 + PATIENCE_S, 0, "link") == []
    (sample,) = handover.seen(10.1 + PATIENCE_S, 0, "link")
    assert (sample.name, sample.present, sample.detail) == ("handback_refused", True, "still in mode 0")
    assert sample.source == "link"
    assert handover.seen(10.2 + PATIENCE_S, 0, "link") == []
    (over,) = handover.seen(10.3 + PATIENCE_S, HOLD, "link")
    assert (over.present, over.detail) == (False, "")
    assert handover.seen(10.4 + PATIENCE_S, HOLD, "link") == []
