"""`--steer guided` in lockstep with the simulated firmware: proof, turn, human, silence, and what leaves the link."""

from __future__ import annotations

import dataclasses
import itertools
import math
from typing import Any

import pytest
from alarm_texts import words_of
from lockstep import BadLine, Lockstep, goes_guided, keep_packets
from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.angles import wrap
from autopilot.control.registry import TRIAL_LAW
from autopilot.links.mavlink.codec import MavlinkCodec
from autopilot.signals import Mode, Order, OrderKind, RudderSample
from autopilot.vessel.file import load_vessel
from autopilot.vessel.schema import Vessel
from sitl.faults import Fault

GAINS = {"ATC_STR_RAT_FF": 12.0, "ATC_STR_RAT_P": 1.0, "ATC_STR_RAT_I": 1.0, "ATC_STR_ANG_P": 1.0}


def guided_vessel(**failsafe: Any) -> Vessel:
    boat = load_vessel("lanxin")
    return dataclasses.replace(
        boat,
        helm=dataclasses.replace(boat.helm, method="guided"),
        failsafe=dataclasses.replace(boat.failsafe, **failsafe),
    )


def guided(vessel: Vessel | None = None, mode: str = "", **options: Any) -> Lockstep:
    """A boat that a hand drives in MANUAL and hands over to GUIDED after a moment, or in a mode from the start."""
    parameters = {**GAINS, **options.pop("parameters", {})}
    section = {"mode": mode or "MANUAL", **options.pop("section", {})}
    boat = Lockstep(vessel or guided_vessel(), law=TRIAL_LAW, vehicle=section, parameters=parameters, **options)
    if not mode:
        boat.hooks.append(goes_guided)
    return boat


def targets(kept: list[Any]) -> list[tuple[float, Any]]:
    return [(time, message) for time, message in kept if message.get_type() == "SET_ATTITUDE_TARGET"]


def test_a_turn_is_led_and_the_heading_held_with_no_rudder_command_sent() -> None:
    boat = guided()
    kept = keep_packets(boat)
    boat.engage(60.0)
    assert boat.run(8.0, until=boat.engaged), words_of(boat.tick)
    boat.run(20.0)
    assert boat.tick.mode is Mode.ENGAGED
    assert words_of(boat.tick) == ()
    assert math.degrees(boat.world.boat.state.heading) == pytest.approx(60.0, abs=1.5)
    assert boat.world.boat.state.speed == pytest.approx(boat.world.cruise_speed, rel=0.1), "the stick has the throttle"
    kinds = {message.get_type() for _, message in kept if message.get_srcComponent() == 191}
    assert not kinds & {"RC_CHANNELS_OVERRIDE", "MANUAL_CONTROL"}
    sent = targets(kept)
    assert {(m.target_system, m.target_component, m.type_mask, m.thrust) for _, m in sent} == {(1, 1, 7, 0.0)}
    engaged = [time for time, _ in sent if time > 3.0]
    gaps = [later - sooner for sooner, later in itertools.pairwise(engaged)]
    assert min(gaps) > 0.05
    assert max(gaps) < 0.3


def test_the_estimator_knows_the_rudder_by_the_firmware_s_word_alone() -> None:
    boat = guided()
    boat.engage(60.0)
    worst = 0.0
    for _ in range(80):
        boat.run(0.1)
        worst = max(worst, abs(boat.tick.state.rudder - boat.world.boat.state.rudder))
    assert max(abs(tick.state.rudder) for tick in boat.ticks) > math.radians(10.0)
    assert math.degrees(worst) < 3.0
    assert any(isinstance(sample, RudderSample) for tick in boat.ticks for sample in tick.samples)


def test_not_engaged_before_the_vehicle_shows_our_heading() -> None:
    boat = guided()
    takes = boat.vehicle._handlers.pop(dialect.MAVLINK_MSG_ID_SET_ATTITUDE_TARGET)
    boat.engage(60.0)
    boat.run(8.0)
    assert all(tick.mode is Mode.STANDBY for tick in boat.ticks)
    assert "does not take our heading targets" in words_of(boat.tick)[0]
    boat.vehicle._handlers[dialect.MAVLINK_MSG_ID_SET_ATTITUDE_TARGET] = takes
    boat.firmware.sticks[2] = 1500
    assert boat.run(16.0, until=boat.engaged), "tried again"


def at_rest(**options: Any) -> Lockstep:
    """A boat in GUIDED that keeps its place, the throttle stick neutral."""
    boat = guided(mode="GUIDED", **options)
    boat.firmware.sticks[2] = 1500
    boat.run(25.0)
    assert boat.world.boat.state.speed < 0.2
    return boat


@pytest.mark.parametrize("firmware", ["4.5", "4.6", "4.7", "4.8"])
def test_the_rudder_proves_it_at_rest_and_the_boat_is_not_started(firmware: str) -> None:
    boat = at_rest(section={"firmware": firmware})
    throttles: set[int] = set()
    boat.hooks.append(lambda bench: throttles.add(bench.firmware.throttle))
    boat.engage(60.0)
    assert boat.run(8.0, until=boat.engaged), words_of(boat.tick)
    boat.run(2.0)
    assert throttles == {0}
    boat.firmware.sticks[2] = boat.ahead_us
    boat.run(40.0)
    assert boat.tick.mode is Mode.ENGAGED
    assert math.degrees(boat.world.boat.state.heading) == pytest.approx(60.0, abs=2.0)


@pytest.mark.parametrize("share", [0.0, 0.6])
def test_a_firmware_that_ignores_headings_is_refused_again_and_again_and_never_started(share: float) -> None:
    boat = at_rest(settings={"guided_speed_share": share})
    boat.world.faults.add(Fault("overrides_ignored", boat.now, math.inf, 1.0))
    throttles: set[int] = set()
    boat.hooks.append(lambda bench: throttles.add(bench.firmware.throttle))
    boat.engage(60.0)
    boat.run(25.0)
    assert {tick.mode for tick in boat.ticks} == {Mode.STANDBY}
    assert "its steering servo does not move to their side" in words_of(boat.tick)[0]
    assert throttles == {0}


def test_a_proof_that_fails_though_the_firmware_listens_does_not_start_the_boat_either() -> None:
    """The servo reports stay away half way: nothing may be believed, and nothing may have moved but the rudder."""
    boat = at_rest(settings={"guided_speed_share": 0.6})
    throttles: set[int] = set()
    boat.hooks.append(lambda bench: throttles.add(bench.firmware.throttle))
    boat.engage(60.0)
    boat.run(1.0)
    boat.world.faults.add(Fault("feedback_lost", boat.now, math.inf, 1.0))
    boat.run(25.0)
    assert {tick.mode for tick in boat.ticks} == {Mode.STANDBY}
    assert throttles == {0}


def test_a_throttle_stick_ahead_at_rest_is_refused_before_anything_is_sent() -> None:
    boat = guided(mode="GUIDED")
    boat.run(25.0)
    kept = keep_packets(boat)
    boat.engage(60.0)
    boat.run(8.0)
    assert boat.tick.mode is Mode.STANDBY
    assert "put the stick to neutral" in words_of(boat.tick)[0]
    assert not targets(kept)
    assert boat.world.boat.state.speed < 0.2


def test_a_boat_handed_over_under_way_is_neither_stopped_nor_slowed_by_the_proof() -> None:
    boat = guided()
    speeds: list[float] = []
    boat.hooks.append(lambda bench: speeds.append(bench.world.boat.state.speed))
    boat.engage(0.0)
    assert boat.run(8.0, until=boat.engaged), words_of(boat.tick)
    boat.run(5.0)
    assert min(speeds) > 0.6 * max(speeds)
    assert not [text for _, text in boat.firmware.notices if "stopping" in text]


def test_a_boat_that_another_guides_is_not_engaged() -> None:
    boat = at_rest()
    other = MavlinkCodec(200, 191)

    def guide(bench: Lockstep) -> None:
        message = dialect.MAVLink_set_attitude_target_message(0, 1, 1, 7, [1.0, 0.0, 0.0, 0.0], 0.0, 0.0, 0.0, 0.5)
        bench.vehicle.receive(bench.now, other.encode(message))

    boat.hooks.append(guide)
    boat.run(5.0)
    boat.engage(90.0)
    boat.run(10.0)
    assert {tick.mode for tick in boat.ticks} == {Mode.STANDBY}
    assert "another companion or ground station guides the vehicle already" in words_of(boat.tick)[0]


def test_a_vehicle_that_hears_only_its_ground_station_is_steered_in_that_one_s_name() -> None:
    boat = guided(parameters={"SYSID_ENFORCE": 1})
    boat.engage(60.0)
    boat.run(8.0)
    assert all(tick.mode is Mode.STANDBY for tick in boat.ticks)
    assert "SYSID_ENFORCE" in words_of(boat.tick)[0]
    boat = guided(parameters={"SYSID_ENFORCE": 1}, settings={"as_gcs": True})
    boat.engage(60.0)
    assert boat.run(8.0, until=boat.engaged)


def test_nothing_is_sent_before_an_order_and_then_a_heading_to_each_side() -> None:
    boat = guided()
    kept = keep_packets(boat)
    boat.run(2.0)
    assert not targets(kept), "nothing is sent before an order: a boat that keeps its station stays there"
    boat.engage(0.0)
    assert boat.run(8.0, until=boat.engaged)
    asked = {round(math.degrees(2.0 * math.atan2(each.q[3], each.q[0]))) for _, each in targets(kept)}
    assert max(asked) in range(8, 18)
    assert min(asked) in range(-17, -7)


@pytest.mark.parametrize("mode", [0, 4])
def test_the_human_s_change_of_mode_takes_the_helm_and_keeps_it(mode: int) -> None:
    boat = guided()
    boat.engage(60.0)
    assert boat.run(8.0, until=boat.engaged), words_of(boat.tick)
    boat.run(2.0)
    kept = keep_packets(boat)
    assert boat.firmware.set_mode(mode)
    assert boat.run(1.5, until=lambda tick: tick.mode is Mode.OVERRIDE)
    assert "switch it to GUIDED" in words_of(boat.tick)[0]
    boat.firmware.set_mode(15)
    kept.clear()
    boat.run(6.0)
    assert boat.tick.mode is Mode.OVERRIDE
    assert not targets(kept)
    assert boat.firmware.guided.target is None
    boat.firmware.sticks[2] = 1500
    boat.engage(30.0)
    assert boat.run(8.0, until=boat.engaged), words_of(boat.tick)


def test_a_hand_on_the_steering_stick_takes_the_helm() -> None:
    boat = guided()
    boat.engage(60.0)
    assert boat.run(8.0, until=boat.engaged), words_of(boat.tick)
    boat.run(2.0)
    boat.firmware.sticks[0] = 1750
    assert boat.run(0.5, until=lambda tick: tick.mode is Mode.OVERRIDE)
    assert "stick on RC channel 1" in words_of(boat.tick)[0]


def test_wrong_mode_is_a_sentence_and_nothing_is_sent() -> None:
    boat = guided(mode="MANUAL")
    kept = keep_packets(boat)
    boat.engage(60.0)
    boat.run(5.0)
    assert boat.tick.mode is Mode.STANDBY
    assert "mode MANUAL, where heading targets are not obeyed; switch it to GUIDED" in words_of(boat.tick)[0]
    assert not targets(kept)


def test_another_s_targets_take_the_helm() -> None:
    boat = guided()
    boat.engage(60.0)
    boat.run(12.0)
    assert boat.tick.mode is Mode.ENGAGED
    other = MavlinkCodec(200, 191)
    half = math.radians(-45.0)

    def steal(bench: Lockstep) -> None:
        turn = [math.cos(half), 0.0, 0.0, math.sin(half)]
        message = dialect.MAVLink_set_attitude_target_message(0, 1, 1, 7, turn, 0.0, 0.0, 0.0, 0.0)
        bench.vehicle.receive(bench.now, other.encode(message))

    boat.hooks.append(steal)
    assert boat.run(8.0, until=lambda tick: tick.mode is Mode.OVERRIDE)
    assert "another companion or ground station guides it" in words_of(boat.tick)[0]


def test_standing_by_stops_the_targets_and_the_firmware_stops_the_boat() -> None:
    boat = guided()
    boat.engage(60.0)
    assert boat.run(8.0, until=boat.engaged), words_of(boat.tick)
    boat.run(2.0)
    boat.order = Order(serial=9)
    boat.run(4.0)
    assert boat.tick.mode is Mode.STANDBY
    assert boat.firmware.guided.target is None
    assert "target not received" in boat.firmware.notices[-1][1]


def test_a_silent_line_ends_in_the_firmware_s_own_timeout_and_no_belief_in_being_engaged() -> None:
    up, down = BadLine(), BadLine()
    boat = guided(lines=(up, down))
    boat.engage(60.0)
    assert boat.run(8.0, until=boat.engaged), words_of(boat.tick)
    boat.run(2.0)
    up.put = down.put = lambda now, data: None  # type: ignore[method-assign]
    boat.run(1.6)
    assert boat.tick.mode is Mode.FAILSAFE
    boat.run(6.0)
    assert boat.tick.mode is Mode.OVERRIDE
    assert "no heartbeat from the vehicle" in words_of(boat.tick)[0]
    assert boat.firmware.guided.target is None
    assert boat.firmware.throttle == 0


def test_a_lost_heading_is_bridged_by_the_firmware_s_compass_for_the_fail_safe_s_time() -> None:
    """Only ATTITUDE stays away: the vehicle goes on to its last heading, then it is let go."""
    boat = guided(guided_vessel(release_after_s=4.0))
    boat.engage(60.0)
    boat.run(12.0)
    boat.vehicle.streams.set_interval(dialect.MAVLINK_MSG_ID_ATTITUDE, 0.0, boat.now)
    boat.vehicle._handlers.pop(dialect.MAVLINK_MSG_ID_COMMAND_LONG)
    assert boat.run(2.0, until=lambda tick: tick.mode is Mode.FAILSAFE)
    boat.run(3.5)
    assert boat.firmware.guided.target is not None
    boat.run(5.0)
    assert boat.firmware.guided.target is None


def test_rudder_orders_are_refused_with_a_sentence() -> None:
    boat = guided()
    boat.order = Order(OrderKind.RUDDER, rudder=0.1, serial=3)
    boat.run(3.0)
    assert boat.tick.mode is Mode.STANDBY
    assert "only headings can be ordered" in words_of(boat.tick)[0]
    boat.engage(20.0)
    assert boat.run(8.0, until=boat.engaged), words_of(boat.tick)
    boat.run(2.0)
    boat.order = boat.order._replace(kind=OrderKind.ZIGZAG, rudder=0.1, heading_change=0.1)
    boat.run(0.5)
    assert boat.tick.mode is Mode.OVERRIDE


def test_a_boat_without_way_on_is_said() -> None:
    boat = guided()
    boat.firmware.sticks[2] = 1530
    boat.engage(90.0)
    boat.run(55.0)
    assert boat.tick.mode is Mode.ENGAGED
    assert "makes way" in words_of(boat.tick)[0]
    boat.firmware.sticks[2] = 1765
    boat.run(25.0)
    assert words_of(boat.tick) == ()
    assert math.degrees(wrap(boat.world.boat.state.heading)) == pytest.approx(90.0, abs=2.0)


def test_the_share_of_speed_drives_a_boat_without_a_hand_on_the_throttle() -> None:
    boat = guided(settings={"guided_speed_share": 0.5})
    boat.firmware.sticks[2] = 1530
    boat.engage(0.0)
    boat.run(30.0)
    assert boat.world.boat.state.speed == pytest.approx(0.5 * boat.world.cruise_speed, rel=0.05)
