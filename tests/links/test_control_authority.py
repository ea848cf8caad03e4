"""Whether the helm is ours: each reason with its time limits, from what the vehicle shows; and the proof before it."""

from __future__ import annotations

import math

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.links.mavlink.authority import ControlAuthority
from autopilot.links.mavlink.overrides import OverrideProbe
from autopilot.links.mavlink.requests import TOO_SLOW, WAITING, MessageStreams, VehicleParameters
from autopilot.links.mavlink.steering import SteeringChannel, SteeringOutput
from autopilot.signals import AlarmEvent

KNOWN = {
    "MAV_GCS_SYSID": 255.0,
    "RCMAP_ROLL": 1.0,
    "MANUAL_STR_EXPO": 0.0,
    "SERVO1_FUNCTION": 26.0,
    **{f"RC1_{name}": 1500.0 for name in ("MIN", "TRIM", "MAX", "DZ", "REVERSED")},
    **{f"SERVO1_{name}": 1500.0 for name in ("MIN", "TRIM", "MAX", "REVERSED")},
}


def parameters(*, without: str = "", **values: float) -> VehicleParameters:
    known = VehicleParameters()
    for name, value in {**KNOWN, **values}.items():
        if name != without:
            known.take(name, value)
    return known


def watch(guided: bool = False) -> ControlAuthority:
    """A boat that may be steered at 0 s."""
    found = ControlAuthority(guided)
    found.obstacle = ""
    found.heartbeat(0.0, 15 if guided else 0, True, 4)
    found.received_time = 0.0
    return found


def test_before_a_heartbeat_there_is_nobody_to_steer() -> None:
    fresh = ControlAuthority()
    assert fresh.reason(0.0, parameters(), 255) == "waiting for the heartbeat of a vehicle"
    assert (fresh.booted, fresh.armed, fresh.steering, fresh.steers_by_hand, fresh.mode) == (False,) * 4 + (-1,)
    fresh.obstacle = ""
    assert fresh.reason(0.0, parameters(), 255)


@pytest.mark.parametrize(("state", "booted"), [(0, False), (2, False), (3, True), (4, True), (5, True)])
def test_a_vehicle_takes_commands_from_standby_on(state: int, booted: bool) -> None:
    found = watch()
    found.heartbeat(0.0, 0, True, state)
    assert found.booted is booted


@pytest.mark.parametrize(("state", "name"), [(0, "UNINIT"), (1, "BOOT"), (2, "CALIBRATING")])
@pytest.mark.parametrize("known", [False, True])
def test_a_vehicle_that_still_starts_up_is_named_with_what_to_do(state: int, name: str, known: bool) -> None:
    found = watch()
    found.heartbeat(0.0, 0, True, state)
    reason = found.reason(0.0, parameters() if known else VehicleParameters(), 255)
    assert f"(MAV_STATE {name})" in reason and "restart it" in reason
    assert ("still starts up" in reason) is (state != 2), "PX4 calibrates a compass while it is turned"
    assert ("end that at the ground station" in reason) is (state == 2)
    found.heartbeat(1.0, 0, True, 3)
    assert "starts up" not in found.reason(1.0, VehicleParameters(), 255)


def test_silence_of_three_seconds_or_no_heartbeat_for_eight_ends_it() -> None:
    found = watch()
    assert found.reason(3.0, parameters(), 255) == ""
    assert found.reason(3.1, parameters(), 255).endswith("for 3 s")
    found.received_time = 7.0
    assert found.reason(8.0, parameters(), 255) == ""
    assert found.reason(8.1, parameters(), 255).endswith("for 8 s")


@pytest.mark.parametrize("guided", [False, True])
@pytest.mark.parametrize(
    ("mode", "name"),
    [(0, "MANUAL"), (1, "ACRO"), (3, "STEERING"), (4, "HOLD"), (5, "LOITER"), (6, "FOLLOW"), (7, "SIMPLE"),
     (8, "DOCK"), (9, "CIRCLE"), (10, "AUTO"), (11, "RTL"), (12, "SMART_RTL"), (15, "GUIDED"),
     (16, "INITIALISING"), (2, "2, which is not known here"), (14, "14, which is not known here"),
     (0x00030000, "Position"), (0x06040000, "Land"), (0x12040000, "External 8"), (0x000A0000, "Termination"),
     (0x01060000, "17170432, which is not known here")],
)  # fmt: skip
def test_one_mode_alone_is_steered_in_and_any_other_is_named(mode: int, name: str, guided: bool) -> None:
    found = watch(guided)
    found.heartbeat(0.0, mode, True, 4)
    reason = found.reason(0.0, parameters(), 255)
    needed, ours = ("GUIDED", "heading targets") if guided else ("MANUAL", "rudder commands")
    if name == needed:
        assert reason == ""
    else:
        expected = f"the vehicle is in mode {name}, where {ours} are not obeyed; switch it to {needed}"
        assert reason == expected
    assert found.steers_by_hand is (mode == 0)


@pytest.mark.parametrize("guided", [False, True])
def test_arming_and_the_switch_for_overrides(guided: bool) -> None:
    found = watch(guided)
    found.switched_off = True
    assert bool(found.reason(0.0, parameters(), 255)) is not guided
    found.heartbeat(0.0, found.mode, False, 3)
    assert found.reason(0.0, parameters(), 255) == "the vehicle is disarmed; arm it"
    assert not found.steers_by_hand


@pytest.mark.parametrize("what", ["mode", "arming", "switch"])
def test_a_helm_that_is_taken_and_given_back_before_anybody_looks_was_taken(what: str) -> None:
    found = watch()
    found.commanded(0.0, 1500)
    if what == "switch":
        found.switch(True)
        found.switch(False)
    else:
        found.heartbeat(0.1, 4 if what == "mode" else 0, what != "arming", 4)
        found.heartbeat(0.1, 0, True, 4)
    assert found.reason(0.1, parameters(), 255).endswith("changed back")
    found.released()
    assert found.reason(2.1, parameters(), 255) == "", "an order to engage counts again"


@pytest.mark.parametrize("guided", [False, True])
@pytest.mark.parametrize(
    ("without", "values", "said", "guided_too"),
    [
        ("", {"MAV_GCS_SYSID": 254.0}, "the vehicle obeys only system id 254; start with --as-gcs or set", False),
        ("", {"MAV_GCS_SYSID": 0.0}, "the vehicle's MAV_GCS_SYSID is no system id; set it to 255", True),
        ("SERVO1_TRIM", {}, "reading the vehicle's parameters", True),
        ("", {"RCMAP_ROLL": 17.0}, "the vehicle's RCMAP_ROLL names no input channel from 1 to 16; correct it", False),
        ("", {"RCMAP_THROTTLE": 1.0}, "RCMAP_ROLL and RCMAP_THROTTLE are both 1: to steer would work", False),
        ("", {"RCMAP_PITCH": 1.0, "RCMAP_YAW": 1.0}, "", False),
        ("", {"RC_OVERRIDE_TIME": 0.0}, "the vehicle's RC_OVERRIDE_TIME is 0, which forbids overrides", False),
        ("", {"RC_OVERRIDE_TIME": -1.0}, "the vehicle's RC_OVERRIDE_TIME is -1, which would keep the rudder", False),
        ("", {"RC_OVERRIDE_TIME": 0.4}, "the vehicle's RC_OVERRIDE_TIME is 0.4, which takes the rudder back", False),
        (
            "",
            {"RC_OVERRIDE_TIME": 60.0},
            "the vehicle's RC_OVERRIDE_TIME is 60, which would keep the rudder",
            False,
        ),
        ("", {"RC_OVERRIDE_TIME": 3.0}, "", False),
        ("", {"RC_OVERRIDE_TIME": 10.0, "PILOT_STEER_TYPE": 3.0, "MANUAL_OPTIONS": 6.0}, "", False),
        (
            "",
            {"PILOT_STEER_TYPE": 1.0},
            "PILOT_STEER_TYPE is 1 (two paddles), which takes no steering",
            False,
        ),
        ("", {"MANUAL_OPTIONS": 3.0}, "MANUAL_OPTIONS has bit 0 set, so the firmware steers by less the faster", False),
    ],
)
def test_parameters_that_forbid_steering(
    without: str, values: dict[str, float], said: str, guided_too: bool, guided: bool
) -> None:
    reason = watch(guided).reason(0.0, parameters(without=without, **values), 255)
    if said and (guided_too or not guided):
        assert reason.startswith(said)
    else:
        assert reason == ""


def test_without_a_steering_servo_only_heading_targets_steer() -> None:
    known = parameters(without="SERVO1_FUNCTION")
    for step in range(120):
        known.due(0.1 * step)
    assert known.complete
    assert watch().reason(0.0, known, 255).startswith("no servo outputs have the function 26 that drive.kind rudder")
    assert watch(guided=True).reason(0.0, known, 255) == ""


def test_a_vehicle_that_does_not_answer_is_said_with_five_of_the_names() -> None:
    known = VehicleParameters()
    for step in range(100):
        known.due(0.1 * step)
    reason = watch().reason(0.0, known, 255)
    assert reason.startswith("the vehicle does not answer when asked for SYSID_MYGCS, MAV_GCS_SYSID, RCMAP_ROLL;")
    for name in KNOWN:
        if name.startswith(("RCMAP", "SERVO1_F")):
            known.take(name, KNOWN[name])
    for step in range(100, 200):
        known.due(0.1 * step)
    reason = watch().reason(0.0, known, 255)
    named = reason.partition("asked for ")[2].partition(";")[0]
    assert named == "SYSID_MYGCS, MAV_GCS_SYSID, RC1_MIN, RC1_TRIM, RC1_MAX"


def test_a_restart_is_said_until_all_that_it_takes_has_come_again() -> None:
    found = watch()
    found.commanded(0.0, 1500)
    found.misfit = found.radio = "something"
    found.rebooted(0.0, math.nan, 0.0)
    assert (found.steering, found.armed, found.booted, found.misfit, found.radio) == (False, False, False, "", "")
    said = found.reason(0.0, VehicleParameters(), 255)
    assert said.endswith("; reading the vehicle's parameters")
    assert found.reason(0.0, parameters(), 255) == "the vehicle is disarmed; arm it"
    assert found.reason(0.0, VehicleParameters(), 255) == "reading the vehicle's parameters", "that is over"


def test_one_vehicle_that_restarts_again_and_again_is_not_taken_for_two() -> None:
    found = watch()
    for start in (10.0, 14.0, 18.0):
        found.rebooted(start + 2.5, start - 4.0, start)
    assert not found.reason(20.5, parameters(), 255).startswith("two vehicles")
    found.rebooted(21.0, 18.0, 14.2)
    assert found.reason(21.0, parameters(), 255).startswith("two vehicles")
    assert found.reason(52.0, parameters(), 255) != found.reason(21.0, parameters(), 255)


def test_a_radio_and_a_misfit_are_reported_as_they_are() -> None:
    found = watch()
    found.radio = "the radio is lost"
    assert found.reason(0.0, parameters(), 255) == "the radio is lost"
    found.misfit = "no room to steer"
    assert found.reason(0.0, parameters(), 255) == "no room to steer"
    guided = watch(guided=True)
    guided.misfit = "no room to steer"
    assert guided.reason(0.0, parameters(), 255) == ""


def disobeyed_at(agreeing: int, of: int, away: int = 0) -> float:
    """Return when the helm is given up where so many of so many reports, ten a second, agree; inf for never."""
    found = watch()
    for step in range(1, 200):
        now = 0.1 * step
        found.commanded(now, 1600)
        pulse = 1600 if step % of < agreeing else 1500 + away
        found.seen(now, "RC channel 1", pulse, found.echo.pulses)
        if found.disobeyed:
            return now
    return math.inf


def test_a_rudder_that_goes_another_way_for_a_second_is_not_ours() -> None:
    assert disobeyed_at(0, 1) == pytest.approx(1.2, abs=0.11)
    assert disobeyed_at(1, 2) == pytest.approx(3.9, abs=0.4), "every other report makes good half as much"
    assert disobeyed_at(2, 3) == math.inf
    assert disobeyed_at(1, 1) == math.inf


@pytest.mark.parametrize(("away", "agrees"), [(97, True), (103, True), (96, False), (104, False)])
def test_a_report_agrees_within_three_microseconds(away: int, agrees: bool) -> None:
    assert (disobeyed_at(0, 1, away) == math.inf) is agrees


def test_a_pause_between_reports_counts_for_a_second_at_most_and_a_second_is_not_enough() -> None:
    found = watch()
    found.commanded(0.0, 1600)
    found.seen(30.0, "servo 1", 1500, [1600])
    assert not found.disobeyed
    found.seen(30.01, "servo 1", 1500, [1550, 1600])
    assert found.disobeyed
    found.received_time = found.heartbeat_time = 30.0
    said = found.reason(1.0, parameters(), 255)
    assert said.startswith("the rudder does not obey: servo 1 is at 1500 us while 1600 is commanded (radio override")


def test_what_was_commanded_within_a_second_may_be_reported() -> None:
    found = watch()
    for step, pulse in enumerate((1500, 1510, 1500, 1520)):
        found.commanded(0.5 * step, pulse)
    assert [*found.echo.pulses] == [1510, 1500, 1520]
    found.commanded(10.0, None)
    assert not found.echo.pulses and found.steering
    found.released()
    assert not found.steering


def test_who_did_not_obey_may_be_tried_again_two_seconds_after_our_last_command() -> None:
    found = watch()
    found.received_time = found.heartbeat_time = 11.0
    found.commanded(10.0, 1600)
    found.refuse("no")
    assert found.reason(12.0, parameters(), 255) == "no"
    found.released()
    assert found.reason(12.1, parameters(), 255) == ""


@pytest.mark.parametrize("guided", [False, True])
def test_who_steers_and_sees_no_report_for_three_seconds_is_blind(guided: bool) -> None:
    found = watch(guided)
    found.commanded(0.0, 1600)
    for now, talking, blind in ((3.0, 2.9, False), (3.1, 3.0, True), (3.1, 1.0, False), (3.1, 1.1, True)):
        found.received_time, found.heartbeat_time = talking, talking
        assert bool(found.reason(now, parameters(), 255)) is blind, (now, talking)
    assert ("NAV_CONTROLLER_OUTPUT" in found.reason(3.1, parameters(), 255)) is guided
    assert not found.echo.disagrees(3.0, "any", True)
    assert found.reason(3.1, parameters(), 255) == ""
    found.released()
    found.received_time = found.heartbeat_time = 60.0
    assert found.reason(60.0, parameters(), 255) == "", "nobody steers"


@pytest.mark.parametrize("sign", [1, -1])
def test_a_stick_moved_by_more_than_150_microseconds_takes_the_helm(sign: int) -> None:
    found = watch()
    found.sticks([2], [0, 0, 1100])
    found.commanded(0.0, 1500)
    found.sticks([2], [0, 0, 1500])
    found.sticks([2], [0, 0, 0])
    found.sticks([2], [0, 0, 1500 + sign * 20])
    found.sticks([2], [0, 0, 1500 + sign * 170])
    assert not found.disobeyed
    found.sticks([2], [0, 0, 1500 + sign * 171])
    assert found.reason(0.0, parameters(), 255) == "the stick on RC channel 2 was moved"


def probe(may_share: bool = False) -> OverrideProbe:
    output = SteeringOutput("rc_override", 0.5, False)
    output._number, output.channel = 1, SteeringChannel()
    found = OverrideProbe(output, may_share)
    found.report(0.0, 1, 1500)
    return found


@pytest.mark.parametrize("may_share", [False, True])
def test_the_override_probe_needs_three_matching_reports_in_a_row(may_share: bool) -> None:
    proof = probe(may_share)
    assert proof.message is None and proof.reason.startswith("waiting for the vehicle to report its steering input")
    assert proof.due(0.0) is not None and proof.message is not None
    assert proof.reason == "checking the steering input"
    assert proof.due(0.09) is None
    assert proof.due(0.1) is not None
    assert 3 < abs(proof.pulse - 1500) <= 30, "inside the dead zone, and to be distinguished from the stick"
    for shown in (proof.pulse, proof.pulse, 1500, proof.pulse, proof.pulse):
        proof.report(0.2, 1, shown)
        assert not proof.passed
    proof.report(0.3, 1, proof.pulse)
    assert proof.passed is may_share
    if not may_share:
        for now in (0.4, 0.5, 0.64):
            assert proof.due(now) is None, "nothing is sent, and the pulse must stay"
            proof.report(now, 1, proof.pulse)
            assert not proof.passed and proof.message is not None
        proof.report(0.66, 1, proof.pulse)
    assert proof.passed and proof.message is None
    assert proof.due(1.0) is None


def test_a_proof_that_was_not_passed_yet_does_not_grow_old() -> None:
    proof = probe()
    proof.due(0.0)
    proof.wanted(False)
    assert proof.reason == "checking the steering input"
    proof = paused()
    for now in (2.0, 2.1):
        proof.report(now, 1, proof.pulse)
    assert proof.passed
    proof.wanted(True)
    assert proof.passed
    proof.wanted(False)
    assert not proof.passed and proof.reason != "checking the steering input"


def paused() -> OverrideProbe:
    proof = probe()
    proof.due(0.0)
    for now in (0.1, 0.2, 0.3):
        proof.report(now, 1, proof.pulse)
    return proof


def test_the_pause_takes_two_reports_however_long_it_lasts() -> None:
    proof = paused()
    proof.report(2.0, 1, proof.pulse)
    assert not proof.passed
    proof.report(2.1, 1, proof.pulse)
    assert proof.passed


def test_who_overrides_the_input_in_the_pause_is_said_until_the_next_try_is_passed() -> None:
    proof = paused()
    proof.report(0.4, 1, proof.pulse + 1)
    said = proof.reason
    ours = proof.pulse
    assert said.startswith("another pilot or ground station overrides the steering input: RC channel 1 went to")
    assert f"went to {ours + 1} us while {ours} us was sent last" in said
    assert proof.message is None
    proof.report(4.3, 1, 1500)
    assert proof.due(4.39) is None
    assert proof.due(4.41) is not None and proof.reason == said


def test_a_pause_without_reports_for_three_seconds_begins_anew() -> None:
    proof = paused()
    assert proof.due(3.31) is None
    assert proof.message is None
    proof.report(3.4, 1, 1500)
    assert proof.due(3.4) is not None


def test_pulses_of_another_are_said_after_three_in_ten_seconds_for_eight() -> None:
    for spacing, is_other in ((5.0, True), (5.1, False)):
        found = watch()
        for step in range(200):
            now = 0.1 * step
            found.commanded(now, 1600)
            assert not found.others_override(now)
        times = [20.0 + number * spacing for number in range(3)]
        for number, now in enumerate(times):
            found.commanded(now, 1600)
            found.seen(now, "RC channel 1", 1500, [1600], is_input=True)
            found.seen(now, "servo 1", 1500, [1600])
            found.seen(now, "RC channel 1", 1600, [1600], is_input=True)
            assert found.others_override(now) is (is_other and number == 2)
        assert found.others_override(times[2] + 8.0) is is_other
        assert not found.others_override(times[2] + 8.1)
        found.released()
        assert not found.others_override(times[2] + 1.0)
        found.commanded(times[2] + 2.0, 1600)
        assert not found.others_override(times[2] + 2.0), "the proof in between has shown that they are gone"


@pytest.mark.parametrize(
    ("every", "may_share", "is_theirs"), [(5, False, True), (24, False, True), (26, False, False), (5, True, False)]
)
def test_who_overrides_all_the_time_gets_the_rudder_at_however_small_a_share(
    every: int, may_share: bool, is_theirs: bool
) -> None:
    """One report of five at 10 Hz, or of 24, which the rudder makes good in between; one of 26 comes and goes."""
    found = ControlAuthority(may_share=may_share)
    found.obstacle = ""
    taken = None
    for step in range(200):
        now = 0.1 * step
        found.heartbeat(now, 0, True, 4)
        found.received_time = now
        found.commanded(now, 1600)
        is_strange = step >= 100 and step % every == 0
        found.seen(now, "RC channel 1", 1480 if is_strange else 1600, [1600], is_input=True)
        if taken is None and (reason := found.reason(now, parameters(), 255)):
            assert reason.startswith("another ground station steers, or a pilot: RC channel 1 is at 1480 us")
            taken = now
    assert taken is None if not is_theirs else taken is not None and 13.0 <= taken <= 17.0


def test_an_echo_that_a_jittery_line_brings_late_is_nobody_else_s() -> None:
    found = watch()
    for step in range(101):
        now = 0.1 * step
        found.commanded(now, 1500 + 5 * step)
        late = 1500 + 5 * max(step - 10 - step % 14, 0)
        found.seen(now, "RC channel 1", late, found.echo.pulses, is_input=True)
    assert not found.others_override(10.0)
    for _ in range(3):
        found.seen(10.0, "RC channel 1", 1500 + 5 * 100 - 245, found.echo.pulses, is_input=True)
    assert not found.others_override(10.0), "4.9 s ago: one order that came so late"
    for _ in range(3):
        found.seen(10.0, "RC channel 1", 1500 + 5 * 100 - 260, found.echo.pulses, is_input=True)
    assert found.others_override(10.0), "5.2 s ago"


def test_a_proof_that_fails_is_tried_again_after_four_seconds_and_stays_said_meanwhile() -> None:
    proof = probe()
    proof.due(0.0)
    proof.report(2.5, 3, 1500)
    assert proof.message is not None
    proof.report(2.51, 3, 1500)
    failed = proof.reason
    assert failed.startswith(
        f"the vehicle does not take our steering: RC channel 3 stays at 1500 us while {proof.pulse}"
    )
    assert proof.message is None
    proof.report(6.4, 3, 1500)
    assert proof.due(6.5) is None
    assert proof.due(6.51) is not None
    assert proof.reason == failed
    for now in (6.6, 6.7, 6.8, 7.0):
        proof.report(now, 3, proof.pulse)
        assert not proof.passed
    proof.report(7.2, 3, proof.pulse)
    assert proof.passed
    proof.reset()
    assert not proof.passed and proof.due(7.2) is None, "it waits for a report"


def test_a_line_that_shows_our_steering_too_late_is_said_before_the_boat_is_steered_over_it() -> None:
    for late, is_slow in ((1.0, False), (1.1, True)):
        proof = probe()
        proof.due(0.0)
        for step in range(1, round(10 * late)):
            proof.report(0.1 * step, 1, 1500)
        for step in range(8):
            proof.report(late + 0.1 * step, 1, proof.pulse)
        assert proof.passed is not is_slow
        assert ("shows our steering 1.1 s after it was sent (RC channel 1)" in proof.reason) is is_slow


def test_without_reports_for_three_seconds_no_proof_goes_on() -> None:
    proof = probe()
    assert proof.due(3.0) is not None
    assert proof.due(3.11) is None
    assert proof.message is None
    assert OverrideProbe(SteeringOutput("rc_override", 0.5, False)).due(0.0) is None


def test_times_of_the_proof_to_the_bit() -> None:
    for later, is_passed in ((0.3499, False), (0.35, True)):
        proof = probe()
        proof.due(0.0)
        for now in (0.0, 0.0, 0.0, 0.2, later):
            proof.report(now, 1, proof.pulse)
        assert proof.passed is is_passed
    assert probe().due(3.001) is None
    proof = probe()
    proof.due(0.0)
    proof.report(2.5, 1, 1500)
    assert proof.message is not None
    proof.report(2.75, 1, 1500)
    assert proof.message is None and "RC channel 1 stays at 1500 us while" in proof.reason
    proof.report(6.5, 1, 1500)
    assert proof.due(6.749) is None and proof.due(6.75) is not None, "four seconds later"


def asked(streams: MessageStreams, now: float, **counts: int) -> list[int]:
    for name, count in counts.items():
        for _ in range(count):
            streams.counts[int(name[1:])] += 1
    return [identity for identity, _ in streams.due(now)]


def test_streams_are_requested_at_once_and_checked_after_0_7_s() -> None:
    streams = MessageStreams({30: 10.0, 33: 5.0})
    assert streams.due(0.0) == [(30, 100_000), (33, 200_000)]
    assert asked(streams, 0.69) == []
    assert asked(streams, 0.7, m30=5, m33=2) == [33], "0.6 of 7 are 4.2, of 3.5 are 2.1"
    assert streams.waiting == ""
    assert asked(streams, 2.69) == []
    assert asked(streams, 2.7, m30=11, m33=6) == [30]
    assert asked(streams, 4.7, m30=12, m33=6) == []
    streams.reset()
    assert streams.waiting == WAITING
    assert asked(streams, 4.71) == [30, 33]


def test_what_not_every_vehicle_has_is_asked_for_twice_and_anew_after_a_reboot() -> None:
    streams = MessageStreams({30: 10.0}, optional_hz={168: 2.0})
    assert streams.due(0.0) == [(30, 100_000), (168, 500_000)]
    assert asked(streams, 0.7, m30=7) == [168]
    assert asked(streams, 2.7, m30=20) == [] == asked(streams, 4.7, m30=20)
    streams.reset()
    assert asked(streams, 4.8) == [30, 168]


def test_six_tenths_of_a_rate_are_enough_to_the_bit() -> None:
    for count, is_asked_again in ((12, False), (11, True)):
        streams = MessageStreams({30: 10.0})
        streams.due(-0.75)
        streams.due(0.0)
        assert bool(asked(streams, 2.0, m30=count)) is is_asked_again
        assert (streams.waiting == WAITING) is is_asked_again


def test_a_slow_stream_alarms_at_the_third_check_until_it_recovers() -> None:
    streams = MessageStreams({30: 10.0, 33: 5.0})
    streams.due(0.0)
    for number, now in enumerate((0.75, 2.75)):
        asked(streams, now, m30=(4, 11)[number])
        assert (streams.waiting, streams.slow) == (WAITING, None)
    asked(streams, 5.0, m30=9)
    assert (streams.waiting, streams.slow) == ("", AlarmEvent("headings_slow", "4 Hz though 10 Hz"))
    asked(streams, 7.25, m30=13)
    assert streams.slow == AlarmEvent("headings_slow", "4 Hz though 10 Hz"), "said once"
    asked(streams, 9.5, m30=14)
    assert streams.slow is None
    for now in (11.75, 14.0):
        asked(streams, now, m30=8)
        assert streams.slow is None, "counted anew"
    asked(streams, 16.25, m30=1)
    assert streams.slow


def test_a_first_stream_that_does_not_come_at_all_is_said_by_others() -> None:
    streams = MessageStreams({30: 10.0})
    for now in (0.0, 0.7, 2.7, 4.7, 6.7):
        streams.due(now)
        assert streams.slow is None
    assert streams.waiting == ""


def test_headings_that_come_too_seldom_never_engage() -> None:
    streams = MessageStreams({30: 10.0, 33: 5.0}, timeout=1.0)
    streams.due(0.0)
    for now in (0.7, 2.7):
        assert 30 in asked(streams, now, m30=2)
        assert streams.waiting == WAITING
    for now, count in ((4.75, 2), (6.8, 5), (8.85, 1)):
        assert 30 in asked(streams, now, m30=count)
        assert streams.waiting == TOO_SLOW.format(rate=count / 2.05, least=3.0)
    assert 30 in asked(streams, 10.9, m30=7), "slower than asked for, and fast enough"
    assert streams.waiting == ""
    asked(streams, 13.0)
    assert streams.waiting == "", "that none come others say"


WANTED = {30: 20.0, 36: 10.0, 65: 10.0, 33: 5.0, 74: 2.0, 24: 1.0, 1: 1.0}


def bytes_per_s(asked_for: list[tuple[int, int]]) -> float:
    sizes = {identity: 12 + dialect.mavlink_map[identity].unpacker.size for identity in WANTED}
    return sum(sizes[identity] * 1.0e6 / interval for identity, interval in asked_for)


@pytest.mark.parametrize("baud", [9600, 14400, 19200, 28800, 38400, 57600])
def test_no_more_is_asked_for_than_a_line_carries_headings_first(baud: int) -> None:
    streams = MessageStreams(WANTED, timeout=1.0)
    streams.carry(baud / 10.0)
    asked_for = streams.due(0.0)
    rates = {identity: 1.0e6 / interval for identity, interval in asked_for}
    assert bytes_per_s(asked_for) <= 0.75 * baud / 10.0 + 1.0
    assert rates[30] >= 5.0 and all(rates[each] >= 0.249 * wanted for each, wanted in WANTED.items())
    assert rates[30] == pytest.approx(20.0) or rates[36] == pytest.approx(2.5), "what is left goes to the headings"
    assert bool(streams.narrow) is (min(rates[each] / WANTED[each] for each in WANTED) < 0.99)
    assert baud < 38400 or streams.narrow is None


@pytest.mark.parametrize("rate_hz", [20.0, 50.0, 100.0, 200.0])
@pytest.mark.parametrize("baud", [9600, 19200, 57600, 115200])
def test_however_many_headings_are_wanted_the_line_is_not_filled(rate_hz: float, baud: int) -> None:
    streams = MessageStreams(WANTED | {30: rate_hz}, timeout=1.0)
    streams.carry(baud / 10.0)
    asked_for = streams.due(0.0)
    assert bytes_per_s(asked_for) <= 0.75 * baud / 10.0 + 1.0
    assert 1.0e6 / dict(asked_for)[30] >= 5.0


def through(streams: MessageStreams, asked_for: list[tuple[int, int]], line: float, seconds: float) -> None:
    """Bring what was asked for over a line of so many bytes a second; where it is full, what is sent oftenest waits."""
    rates = {identity: 1.0e6 / interval for identity, interval in asked_for}
    low, most = 0.0, max(rates.values())
    for _ in range(40):
        middle = 0.5 * (low + most)
        is_full = bytes_per_s([(each, round(1.0e6 / min(rate, middle))) for each, rate in rates.items()]) > line
        low, most = (low, middle) if is_full else (middle, most)
    for identity, rate in rates.items():
        streams.counts[identity] += round(seconds * min(rate, most))
        streams.came += round(seconds * min(rate, most))


def carry(streams: MessageStreams, asked_for: dict[int, int], line: float, begun: float, until: float) -> None:
    now = begun
    asked_for.update(streams.due(now))
    while now < until:
        passed = streams.pause + 0.01
        now += passed
        through(streams, [*asked_for.items()], line, passed)
        asked_for.update(streams.due(now))


def test_a_line_that_turns_out_narrow_is_asked_for_less_until_all_comes() -> None:
    streams = MessageStreams(WANTED, timeout=1.0)
    asked_for: dict[int, int] = {}
    carry(streams, asked_for, 1100.0, 0.0, 12.0)
    assert bytes_per_s([*asked_for.items()]) < 1100.0
    assert streams.narrow is not None and streams.slow is None and streams.waiting == ""
    assert 1.0e6 / asked_for[30] > 8.0
    carry(streams, asked_for, 1.0e5, 15.0, 400.0)
    assert {each: round(1.0e6 / interval, 1) for each, interval in asked_for.items()} == WANTED
    assert streams.narrow is None


@pytest.mark.parametrize("hours", [0.1, 1.0, 6.0])
def test_a_line_that_was_narrow_for_hours_is_used_in_full_within_minutes(hours: float) -> None:
    streams = MessageStreams(WANTED, timeout=1.0)
    asked_for: dict[int, int] = {}
    carry(streams, asked_for, 1100.0, 0.0, 3600.0 * hours)
    assert streams.narrow is not None
    carry(streams, asked_for, 1.0e5, streams.checked_at, 3600.0 * hours + 360.0)
    assert streams.narrow is None


def test_a_try_that_fails_says_nothing_new() -> None:
    """Each change of the notice is a text to ground stations, over the line that has no room."""
    streams = MessageStreams(WANTED, timeout=1.0)
    asked_for: dict[int, int] = {}
    carry(streams, asked_for, 1100.0, 0.0, 600.0)
    said, tried = streams.narrow, 0
    for _ in range(600):
        carry(streams, asked_for, 1100.0, streams.checked_at, streams.checked_at + 2.0)
        tried += streams._is_tried
        assert streams.narrow == said
    assert tried > 2


def test_once_a_line_has_room_for_all_nothing_is_asked_for_again() -> None:
    streams = MessageStreams(WANTED, timeout=1.0)
    asked_for: dict[int, int] = {}
    carry(streams, asked_for, 1100.0, 0.0, 12.0)
    carry(streams, asked_for, 1.0e5, 15.0, 400.0)
    assert streams.narrow is None
    begun = streams.checked_at
    for step in range(1, 100):
        through(streams, [*asked_for.items()], 1.0e5, 2.0)
        assert streams.due(begun + 2.0 * step) == []


@pytest.mark.parametrize("wanted", [{30: 20.0}, {30: 4.0, 36: 10.0}])
def test_a_narrow_line_s_rest_is_tried_whatever_is_asked_for(wanted: dict[int, float]) -> None:
    streams = MessageStreams(wanted, timeout=1.0)
    streams.due(0.0)
    streams._fit(60.0)
    for step in range(1, 40):
        for identity, rate in streams._rates.items():
            streams.counts[identity] += round(2.0 * rate)
        streams.due(2.0 * step)
    assert streams._rates[30] > 1.2 * (60.0 / 40.0)


def test_what_asking_for_less_does_not_mend_is_asked_for_in_full_again() -> None:
    streams = MessageStreams(WANTED, timeout=1.0)
    streams.due(0.0)
    for step in range(1, 20):
        for identity, rate in WANTED.items():
            streams.counts[identity] += round(2.05 * min(rate, 4.0))
        streams.came = 50
        streams.due(2.05 * step)
    assert streams.narrow is None
    assert streams.slow == AlarmEvent("headings_slow", "4 Hz though 20 Hz")


def test_a_lossy_line_and_a_vehicle_that_sends_no_more_are_not_called_narrow() -> None:
    lossy, unwilling = MessageStreams(WANTED, timeout=1.0), MessageStreams(WANTED, timeout=1.0)
    for streams in (lossy, unwilling):
        streams.due(0.0)
    for step in range(1, 20):
        for identity, rate in WANTED.items():
            lossy.counts[identity] += round(rate)
            unwilling.counts[identity] += round(rate if identity == 30 else 2.05 * rate)
        lossy.came, lossy.lost = 50, 50
        unwilling.came = 90
        for streams in (lossy, unwilling):
            streams.due(2.05 * step)
            assert streams.narrow is None


def test_headings_that_come_back_within_a_check_are_not_called_slow() -> None:
    streams = MessageStreams({30: 10.0}, timeout=1.0)
    streams.due(0.0)
    for now, count, words in ((0.7, 7, ""), (2.75, 0, ""), (4.8, 0, ""), (6.85, 0, ""), (8.9, 4, WAITING)):
        asked(streams, now, m30=count)
        assert (streams.waiting, streams.slow) == (words, None)
        streams.counts[30] = 1
        assert streams.waiting == (words if count else WAITING), "how quickly they come is not known"
        streams.counts[30] = 0
    asked(streams, 10.9, m30=4)
    assert streams.waiting == TOO_SLOW.format(rate=2.0, least=3.0)
    assert streams.slow is not None


def test_a_rate_that_was_asked_for_is_not_too_slow() -> None:
    streams = MessageStreams({30: 2.0}, timeout=0.5)
    streams.due(0.0)
    for now in (0.7, 2.7, 4.7):
        asked(streams, now, m30=3)
    assert streams.waiting == ""
