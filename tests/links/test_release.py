"""The way out: what each link says became of the rudder, and that it says so only when it was shown."""

from __future__ import annotations

import math
from typing import Any

import pytest
from lockstep import BadLine, Lockstep

from autopilot.links.kept_link import KeptLink
from autopilot.links.release import OverrideRelease, Release, ReleaseState, release_sentence
from autopilot.params.vessel_file import load_vessel
from autopilot.signals import Order, OrderKind
from sitl.faults import Fault

VESSEL = load_vessel("lanxin")
LAPSE = "the flight controller lets go by itself after RC_OVERRIDE_TIME 3 s"


def steering(rudder_deg: float, **options: Any) -> Lockstep:
    """A boat whose rudder the pilot holds at an angle."""
    boat = Lockstep(VESSEL, **options)
    boat.order = Order(OrderKind.RUDDER, rudder=math.radians(rudder_deg), serial=1)
    assert boat.run(12.0, until=boat.engaged), boat.tick.alarms
    boat.run(2.0)
    return boat


def leave(boat: Lockstep) -> Release:
    boat.session.close()
    (release,) = boat.session.releases
    return release


def is_held(boat: Lockstep) -> bool:
    return bool(boat.firmware.overrides.active(boat.now, 3.0))


@pytest.mark.parametrize("method", ["rc_override", "manual_control"])
@pytest.mark.parametrize("rudder_deg", [-20.0, 0.0, 12.0])
def test_a_released_rudder_is_shown_free_wherever_it_stood(rudder_deg: float, method: str) -> None:
    boat = steering(rudder_deg, settings={"method": method})
    begun = boat.now
    assert leave(boat).sentence == "rudder released, confirmed by RC_CHANNELS"
    assert not is_held(boat)
    assert boat.now - begun < 1.2


def test_a_stick_that_stands_where_the_rudder_was_ordered_is_told_from_an_override() -> None:
    boat = steering(12.0)
    boat.firmware.sticks[0] = boat.firmware.channels[0]
    assert leave(boat).state is ReleaseState.CONFIRMED
    assert not is_held(boat)


def test_the_servo_shows_it_where_no_input_is_reported() -> None:
    boat = steering(20.0)
    take = boat.link._reader._handlers
    del take[65]
    boat.run(1.5)
    assert leave(boat).sentence == "rudder released, confirmed by SERVO_OUTPUT_RAW"


def test_releases_that_do_not_arrive_are_not_called_confirmed() -> None:
    boat = steering(20.0)
    boat.up = BadLine(1, loss=1.0)
    release = leave(boat)
    assert release.state is ReleaseState.UNCONFIRMED
    assert release.sentence == f"rudder released, not confirmed in 1.5 s: {LAPSE}"


def test_a_line_that_loses_two_thirds_is_asked_again_and_again() -> None:
    boat = steering(20.0)
    boat.up, boat.down = BadLine(2, loss=0.66), BadLine(3, loss=0.3)
    assert leave(boat).state is ReleaseState.CONFIRMED
    assert not is_held(boat)


def test_a_vehicle_that_keeps_overrides_for_ever_says_so() -> None:
    boat = steering(20.0, parameters={"RC_OVERRIDE_TIME": -1.0})
    boat.up = BadLine(1, loss=1.0)
    assert "RC_OVERRIDE_TIME is -1, so the flight controller keeps it" in leave(boat).sentence


def test_without_a_radio_the_rudder_is_laid_amidships_before_it_is_released() -> None:
    boat = steering(20.0, vehicle={"receiver": False}, parameters={"FS_THR_ENABLE": 0.0})
    release = leave(boat)
    assert release.state is ReleaseState.UNSHOWN
    assert "without a radio receiver the flight controller keeps the last input" in release.sentence
    assert not is_held(boat)
    assert boat.firmware.servos[0] == 1500


def test_a_broken_line_is_no_release() -> None:
    boat = steering(20.0)
    boat.far.close()
    assert leave(boat).sentence == f"rudder not released, the line is gone: {LAPSE}"


def test_a_rudder_that_was_never_ours_or_was_let_go_long_ago_is_not_held() -> None:
    boat = Lockstep(VESSEL)
    boat.run(2.0)
    assert leave(boat).sentence == "rudder not held"


def test_a_release_during_the_run_is_remembered_at_its_end() -> None:
    boat = steering(20.0)
    boat.order = Order(serial=2)
    boat.run(5.0)
    begun = boat.now
    assert leave(boat).sentence == "rudder released, confirmed by RC_CHANNELS"
    assert boat.now == begun, "nothing to wait for"


def test_an_exception_in_the_loop_releases_and_confirms_too() -> None:
    boat = steering(20.0)
    with pytest.raises(ZeroDivisionError), boat.session:
        raise ZeroDivisionError
    assert boat.session.releases[0].state is ReleaseState.CONFIRMED
    assert not is_held(boat)


def test_a_lost_heading_gives_the_rudder_back_and_says_so_at_the_end() -> None:
    boat = steering(20.0)
    boat.world.faults.add(Fault("heading_dropout", boat.now, math.inf, 1.0))
    boat.run(15.0)
    assert not boat.tick.command.engaged
    assert leave(boat).state in (ReleaseState.CONFIRMED, ReleaseState.NOT_HELD)
    assert not is_held(boat)


def test_a_link_that_was_kept_remembers_that_its_line_broke_under_an_order() -> None:
    boat = steering(20.0)
    kept = KeptLink("line", True, lambda: boat.link, lambda work: None)
    boat.far.close()
    kept.receive(boat.now)
    kept.release(boat.now)
    release = kept.release_result(boat.now)
    assert release is not None and release.state is ReleaseState.LOST


def test_one_link_s_sentence_stands_alone_and_several_are_named() -> None:
    free = Release("a", ReleaseState.NOT_HELD)
    one = Release("b", ReleaseState.CONFIRMED, "RC_CHANNELS")
    other = Release("c", ReleaseState.UNSHOWN, lapse="nothing shows it")
    assert release_sentence([]) == release_sentence([free]) == "rudder not held"
    assert release_sentence([free, one]) == "rudder released, confirmed by RC_CHANNELS"
    both = "b: rudder released, confirmed by RC_CHANNELS; c: rudder released: nothing shows it"
    assert release_sentence([one, other]) == both


def test_a_stick_that_passes_by_another_pulse_once_confirms_nothing() -> None:
    watch = OverrideRelease()
    watch.ordered(0.0, 1700)
    watch.asked(0.1)
    for now, pulse in ((0.2, 1500), (0.3, 1700), (0.4, 1500), (0.5, 1701)):
        watch.report(now, pulse, "RC_CHANNELS")
    assert watch.is_held(1.0, 3.0)
    watch.report(0.6, 1500, "RC_CHANNELS")
    watch.report(0.7, 1500, "RC_CHANNELS")
    assert watch.shown_by == "RC_CHANNELS"
