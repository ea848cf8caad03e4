"""The way out: what each link says became of the rudder, and that it says so only when it was shown."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import pytest
from alarm_texts import words_of
from lockstep import BadLine, Lockstep, SlowLine
from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.links.mavlink.codec import MavlinkCodec
from autopilot.links.mavlink.overrides import OverrideRelease
from autopilot.links.reconnect import ReconnectingLink
from autopilot.links.rudder_order import (
    LONGEST_S,
    Release,
    ReleaseState,
    UnshownRelease,
    release_sentence,
)
from autopilot.signals import Mode, Order, OrderKind
from autopilot.vessel.file import load_vessel
from sitl.faults import Fault

VESSEL = load_vessel("lanxin")
LAPSE = "the flight controller lets go by itself after RC_OVERRIDE_TIME 3 s"


def steering(rudder_deg: float, **options: Any) -> Lockstep:
    """A boat whose rudder the pilot holds at an angle."""
    boat = Lockstep(VESSEL, **options)
    boat.order = Order(OrderKind.RUDDER, rudder=math.radians(rudder_deg), serial=1)
    assert boat.run(12.0, until=boat.engaged), words_of(boat.tick)
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


def test_a_stick_that_stands_where_the_rudder_was_ordered_is_distinguished_from_an_override() -> None:
    boat = steering(12.0)
    boat.firmware.sticks[0] = boat.firmware.channels[0]
    assert leave(boat).state is ReleaseState.CONFIRMED
    assert not is_held(boat)


@pytest.mark.parametrize("stands", [False, True])
@pytest.mark.parametrize("seconds", [0.2, 0.4])
def test_over_a_slow_line_the_release_is_waited_for(seconds: float, stands: bool) -> None:
    boat = steering(12.0, lines=(SlowLine(seconds), SlowLine(seconds)))
    if stands:
        boat.firmware.sticks[0] = boat.firmware.channels[0]
    assert leave(boat).sentence == "rudder released, confirmed by RC_CHANNELS"
    assert not is_held(boat)


def test_the_servo_shows_it_where_no_input_is_reported() -> None:
    boat = steering(20.0)
    take = boat.link.session._reader.handlers
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
    boat = steering(20.0)
    boat.link.session.parameters.take("RC_OVERRIDE_TIME", -1.0)
    boat.up = BadLine(1, loss=1.0)
    assert "RC_OVERRIDE_TIME is -1, so the flight controller keeps it" in leave(boat).sentence


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("RC1_MIN", 1600.0),
        ("RC1_DZ", 700.0),
        ("SERVO1_MIN", 1700.0),
        ("SERVO1_FUNCTION", 0.0),
        ("RCMAP_ROLL", 2.0),
        ("RCMAP_ROLL", 17.0),
        ("RC_OVERRIDE_TIME", -1.0),
    ],
)
def test_a_parameter_that_ends_the_steering_leaves_no_override_behind(name: str, value: float) -> None:
    """As somebody calibrates the radio, or changes the mapping of channels, under way."""
    boat = steering(20.0)
    report = dialect.MAVLink_param_value_message(name.encode(), value, dialect.MAV_PARAM_TYPE_REAL32, 900, 65535)
    boat.inject(MavlinkCodec(1, 1).encode(report))
    boat.run(0.3)
    assert boat.tick.mode is Mode.OVERRIDE and words_of(boat.tick)
    assert not is_held(boat)


@pytest.mark.parametrize(
    ("name", "value", "said"),
    [
        ("RCMAP_ROLL", 2.0, "RCMAP_ROLL was changed from 1 to 2 while we steered"),
        ("SERVO1_FUNCTION", 0.0, "SERVO1_FUNCTION was changed from 26 to 0 while we steered"),
        ("RCMAP_THROTTLE", 1.0, "RCMAP_ROLL and RCMAP_THROTTLE are both 1: to steer would work the throttle"),
    ],
)
def test_a_mapping_that_is_changed_while_we_steer_is_named(name: str, value: float, said: str) -> None:
    boat = steering(20.0)
    boat.vehicle.receive(
        boat.now, MavlinkCodec(255, 190).encode(dialect.MAVLink_param_set_message(1, 1, name.encode(), value, 9))
    )
    boat.run(0.3)
    assert boat.tick.mode is Mode.OVERRIDE and said in words_of(boat.tick)[0]
    assert not is_held(boat)


@pytest.mark.parametrize(("name", "value"), [("SYSID_MYGCS", 250.0), ("RC1_TRIM", 1600.0), ("MANUAL_STR_EXPO", 0.6)])
def test_a_parameter_that_is_changed_without_a_word_costs_no_helm(name: str, value: float) -> None:
    boat = steering(20.0, settings={"as_gcs": True})
    boat.firmware.parameters.set(name, value)
    for number in range(20):
        angle = math.radians((20.0, -15.0)[number % 2])
        boat.order = Order(OrderKind.RUDDER, rudder=angle, serial=number + 2)
        boat.run(3.0)
        assert boat.tick.mode is Mode.ENGAGED, words_of(boat.tick)
    assert boat.link.session.parameters.get(name) == pytest.approx(value) and is_held(boat)


def test_after_the_steering_is_mapped_to_another_input_that_one_is_proved_and_steers() -> None:
    boat = steering(20.0)
    boat.vehicle.receive(
        boat.now, MavlinkCodec(255, 190).encode(dialect.MAVLink_param_set_message(1, 1, b"RCMAP_ROLL", 2.0, 9))
    )
    boat.run(2.0)
    assert boat.tick.mode is Mode.OVERRIDE and boat.firmware.channels[:2] == [1500, 1500]
    boat.engage(60.0)
    assert boat.run(3.0, boat.engaged)
    boat.run(0.5)
    assert boat.firmware.channels[0] == 1500 and boat.firmware.channels[1] > 1600


@pytest.mark.parametrize("off", [-1.2, -2.0, 3600.0])
def test_a_straggler_of_the_vehicle_takes_no_rudder_out_of_our_hand(off: float) -> None:
    boat = steering(20.0)
    heading, boot = boat.tick.state.heading, boat.firmware.time_since_boot(boat.world.time)
    late = dialect.MAVLink_attitude_message(round((boot + off) * 1000.0), 0.0, 0.0, heading, 0.0, 0.0, 0.0)
    boat.inject(MavlinkCodec(1, 1).encode(late))
    boat.run(1.0)
    assert boat.tick.mode is Mode.ENGAGED and is_held(boat)


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
    kept = ReconnectingLink("line", True, lambda: boat.link, lambda work: None)
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


def watch_of(*orders: tuple[float, int], asked: float) -> OverrideRelease:
    watch = OverrideRelease()
    for when, pulse in orders:
        watch.ordered(when, pulse)
    watch.asked(asked)
    return watch


@pytest.mark.parametrize(
    ("pulse", "is_free"), [(1700, False), (1703, False), (1697, False), (1704, True), (1696, True)]
)
def test_an_input_within_three_microseconds_of_the_order_is_the_order(pulse: int, is_free: bool) -> None:
    watch = watch_of((0.0, 1700), asked=0.1)
    for now in (0.2, 0.3):
        watch.report(now, pulse, "RC_CHANNELS")
    assert (watch.shown_by == "RC_CHANNELS") is is_free
    assert watch.is_held(0.4, 3.0) is not is_free


def test_a_report_may_show_any_order_of_the_last_second_and_none_older() -> None:
    for age, is_free in ((0.5, False), (1.0, False), (1.01, True)):
        watch = watch_of((10.0 - age, 1600), (9.9, 1700), asked=10.0)
        for now in (10.1, 10.2):
            watch.report(now, 1600, "RC_CHANNELS")
        assert bool(watch.shown_by) is is_free, age


def test_an_order_that_is_repeated_stays_young() -> None:
    watch = watch_of(*((0.1 * step, 1600) for step in range(100)), (9.95, 1700), asked=10.0)
    for now in (10.1, 10.2):
        watch.report(now, 1600, "RC_CHANNELS")
    assert not watch.shown_by


def test_an_order_that_comes_again_does_not_displace_the_one_between() -> None:
    watch = watch_of((9.6, 1600), (9.7, 1700), (9.8, 1600), asked=10.0)
    for now in (10.1, 10.2):
        watch.report(now, 1700, "RC_CHANNELS")
    assert not watch.shown_by


def test_reports_from_before_the_release_confirm_nothing_and_an_order_takes_the_confirmation_back() -> None:
    watch = watch_of((0.0, 1700), asked=1.0)
    for _ in range(5):
        watch.report(1.0, 1500, "RC_CHANNELS")
    assert not watch.shown_by
    watch.asked(9.0)  # the same release said again
    for now in (1.1, 1.2):
        watch.report(now, 1500, "RC_CHANNELS")
    assert watch.shown_by and not watch.is_held(1.3, 3.0)
    watch.ordered(2.0, 1600)
    assert not watch.is_asked and watch.is_held(2.0, 3.0)
    for now in (2.1, 2.2, 2.3):
        watch.report(now, 1500, "RC_CHANNELS")
    assert watch.is_held(2.4, 3.0), "nothing has been released since"


def test_one_that_never_ordered_holds_nothing_whatever_is_reported() -> None:
    watch = OverrideRelease()
    watch.asked(0.0)
    watch.report(1.0, 1500, "RC_CHANNELS")
    watch.report(1.1, 1500, "RC_CHANNELS")
    assert not watch.has_ordered and not watch.shown_by and not watch.is_held(1.2, -1.0)
    watch.ordered(2.0, 1600)
    assert watch.has_ordered


@pytest.mark.parametrize(
    ("later", "override_time", "is_held"),
    [(3.5, 3.0, True), (3.51, 3.0, False), (0.5, 0.0, True), (0.51, 0.0, False), (9999.0, -1.0, True)],
)
def test_an_override_lasts_for_the_vehicle_s_time_and_half_a_second_of_the_line(
    later: float, override_time: float, is_held: bool
) -> None:
    assert watch_of((0.0, 1500), (100.0, 1700), asked=100.1).is_held(100.0 + later, override_time) is is_held


def test_patience_is_a_second_and_five_reports_of_half_a_second_at_most() -> None:
    watch = watch_of((0.0, 1700), asked=0.0)
    assert watch.patience == pytest.approx(1.5), "ten reports a second are supposed"
    for step in range(200):
        watch.report(0.2 * step, 1700, "RC_CHANNELS")
    assert watch.patience == pytest.approx(2.0, abs=0.001)
    for step in range(100):
        watch.report(100.0 + 7.0 * step, 1700, "RC_CHANNELS")
    assert watch.patience == pytest.approx(3.5, abs=0.001) and LONGEST_S >= 3.4 + 5 * 0.5
    watch.way = 1.0
    assert watch.patience == pytest.approx(3.4 + 5 * 0.5, abs=0.001), "three ways, and what is waited for the first"
    watch.way = 0.0
    watch.report(800.0, 1700, "RC_CHANNELS")
    watch.report(800.1, 1700, "RC_CHANNELS")
    assert watch.patience == pytest.approx(1.0 + 5.0 * (0.5 - 0.2 * 0.4), abs=0.001), "a fifth of the way at a time"


def test_the_release_marker_is_sent_if_reports_show_the_order_after_0_4_s() -> None:
    watch = watch_of((0.0, 1700), asked=1.0)
    assert watch.wants_mark(5.0) is None, "nothing is reported"
    watch.report(1.1, 1701, "RC_CHANNELS")
    assert [watch.wants_mark(1.0 + after) for after in (0.3, 0.39)] == [None, None]
    assert watch.wants_mark(1.0 + 0.41) == 1701
    watch.report(1.5, 1400, "RC_CHANNELS")
    assert watch.wants_mark(1.6) is None, "it differs"
    watch.report(1.7, 1700, "RC_CHANNELS")
    watch.mark(1.8, 1710)
    assert watch.wants_mark(1.9) is None and watch.wants_mark(9.0) is None, "once"
    watch.ordered(10.0, 1700)
    watch.asked(11.0)
    watch.report(11.1, 1700, "RC_CHANNELS")
    assert watch.wants_mark(12.0) == 1700, "at the next release again"


def test_a_servo_that_stands_as_ordered_finds_no_mark_and_one_that_does_not_confirms() -> None:
    mirrored = {sent: 3000 - sent for sent in range(1000, 2001)}

    watch = watch_of((0.0, 1700), asked=1.0)
    watch.report(1.1, 1300, "SERVO_OUTPUT_RAW", mirrored)
    assert watch.wants_mark(9.0) is None and not watch.shown_by
    watch.report(1.2, 1700, "SERVO_OUTPUT_RAW", mirrored)
    watch.report(1.3, 1700, "SERVO_OUTPUT_RAW", mirrored)
    assert watch.shown_by == "SERVO_OUTPUT_RAW"


def test_a_mark_is_sent_ten_times_a_second_for_six_tenths_until_it_is_seen() -> None:
    watch = watch_of((0.0, 1700), asked=1.0)
    assert not watch.mark_due(1.0) and not watch.is_marking(1.0)
    watch.mark(2.0, 1710)
    sent = [step for step in range(100) if watch.mark_due(2.0 + 0.01 * step + 1.0e-6)]
    assert sent[0] == 0 and len(sent) == 6 and {b - a for a, b in pairwise(sent)} <= {10, 11}
    assert watch.is_marking(2.59) and not watch.is_marking(2.6)
    assert watch.is_held(2.5 + 3.45, 3.0) and not watch.is_held(2.55 + 3.5, 3.0), "a mark is an override too"
    watch.mark(20.0, 1710)
    assert watch.mark_due(20.0)
    watch.report(20.05, 1712, "RC_CHANNELS")
    assert not watch.is_marking(20.06) and not watch.mark_due(20.2), "it is seen"


def test_times_of_a_release_to_the_bit() -> None:
    watch = watch_of((-0.5, 1700), asked=0.0)
    watch.report(0.1, 1700, "RC_CHANNELS")
    assert watch.wants_mark(0.3999) is None and watch.wants_mark(0.4) == 1700
    watch.mark(0.0, 1710)
    assert [watch.mark_due(now) for now in (0.0, 0.0999, 0.1)] == [True, False, True]
    assert watch.is_marking(0.5999) and not watch.is_marking(0.6)
    assert not watch.mark_due(0.6)
    line = UnshownRelease("line", "")
    line.has_ordered = True
    line.asked(0.0, False)
    assert line.result(0.2999) is None and line.result(0.3) is not None


def test_what_was_marked_is_free_when_the_mark_was_seen_and_is_gone() -> None:
    for reports, is_shown in (
        ([1700, 1700, 1700], False),
        ([1500, 1500], False),  # never seen: another hand may have moved the stick
        ([1710, 1710], False),
        ([1713, 1707, 1706], True),
        ([1714, 1706, 1500], False),
        ([1710, 1500], True),
    ):
        watch = watch_of((0.0, 1700), asked=1.0)
        watch.mark(2.0, 1710)
        for place, pulse in enumerate(reports):
            watch.report(2.1 + 0.1 * place, pulse, "RC_CHANNELS")
        assert (watch.shown_by == "RC_CHANNELS") is is_shown, reports


def test_what_left_over_a_line_without_reports_is_said_three_tenths_of_a_second_later() -> None:
    line = UnshownRelease("line", "it stops by itself")
    line.asked(5.0, False)
    assert line.result(5.0) == Release("line", ReleaseState.NOT_HELD)
    line.has_ordered = True
    assert line.result(5.29) is None
    assert line.result(5.31) == Release("line", ReleaseState.UNSHOWN, lapse="it stops by itself")
    line.asked(6.0, True)
    assert line.result(6.0) == Release("line", ReleaseState.LOST, lapse="it stops by itself")


def test_every_end_of_a_release_in_its_words() -> None:
    states = {
        ReleaseState.NOT_HELD: "rudder not held",
        ReleaseState.CONFIRMED: "rudder released, confirmed by SERVO_OUTPUT_RAW",
        ReleaseState.UNCONFIRMED: "rudder released, not confirmed in 1.3 s",
        ReleaseState.UNSHOWN: "rudder released",
        ReleaseState.LOST: "rudder not released, the line is gone",
    }
    assert set(states) == set(ReleaseState)
    for state, sentence in states.items():
        assert Release("a", state, "SERVO_OUTPUT_RAW", 1.26).sentence == sentence
        has_lapse = state in (ReleaseState.UNCONFIRMED, ReleaseState.UNSHOWN, ReleaseState.LOST)
        behind = ": it ends by itself" if has_lapse else ""
        assert Release("a", state, "SERVO_OUTPUT_RAW", 1.26, "it ends by itself").sentence == sentence + behind
