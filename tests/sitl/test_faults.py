"""Every fault of the simulated boat does what its name says, for as long as it is ordered to, and no longer."""

from __future__ import annotations

import dataclasses
import math
import select
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect
from two_processes import free_port

from autopilot.angles import wrap
from autopilot.errors import InputError
from autopilot.files.printable import aligned
from autopilot.files.strict_yaml import parse_document
from autopilot.links.base import LinkError
from autopilot.links.mavlink.codec import MavlinkCodec
from autopilot.vessel.file import load_vessel
from sitl.cli import main
from sitl.faults import Fault, FaultBoard, FaultService, kinds_table, obey
from sitl.firmware import Firmware, FirmwareMode
from sitl.registry import KINDS, FaultKind, Source
from sitl.scenario import FaultSection, load_scenario, scenario_from
from sitl.sensors import Reading
from sitl.wire_mavlink import MavlinkVehicle
from sitl.wire_nmea import NmeaInstruments
from sitl.world import Orders, World

BEGIN, END = 2.0, 4.0


class Hand:
    """A helm that holds the rudder at an angle that changes."""

    def __init__(self, rudder: Callable[[float], float]) -> None:
        self._rudder = rudder

    def orders(self, time: float) -> Orders:
        return Orders(self._rudder(time))


def world_with(*faults: FaultSection, hand: Callable[[float], float] | None = None) -> World:
    world = World(load_vessel("lanxin"), dataclasses.replace(load_scenario("calm"), faults=faults))
    if hand is not None:
        world.helms.append(Hand(hand))
    return world


def readings(kind: FaultKind, size: float | None = None, **more: float) -> tuple[list[Reading], list[Reading]]:
    """The same run without and with the fault, ten readings a second for 6 s."""
    runs = []
    for faults in ((), (FaultSection(kind, BEGIN, END, size, **more),)):
        world = world_with(*faults, hand=lambda time: 0.2 * math.sin(time))
        run = []
        for step in range(1, 61):
            world.advance(0.1 * step)
            reading = world.sensors.latest(world.time)
            assert reading is not None
            run.append(reading)
        runs.append(run)
    return runs[0], runs[1]


def between(run: list[Reading], first: float, last: float) -> list[Reading]:
    return [reading for reading in run if first <= reading.time < last]


def test_the_table_and_the_names_agree_and_the_docs_show_it() -> None:
    assert set(get_args(FaultKind)) == set(KINDS)
    assert all(kind.low <= kind.size <= kind.high for kind in KINDS.values())
    docs = Path(__file__).parents[2] / "docs" / "faults.md"
    head, *rows = kinds_table()
    lines = [head, ("---",) * 4, *((f"`{name}`", *rest) for name, *rest in rows)]
    table = "\n".join(f"| {' | '.join(row)} |" for row in lines).replace("| ---", "|---").replace("--- |", "---|")
    assert table in docs.read_text(encoding="utf-8")
    assert max(map(len, "\n".join(aligned([head, *rows])).splitlines())) <= 80


def test_nothing_changes_before_and_after_a_fault_of_a_sensor() -> None:
    for kind in ("heading_jump", "rate_bias", "feedback_offset", "speed_wrong", "position_jump", "heading_frozen"):
        clean, faulty = readings(kind)
        assert between(clean, 0.0, BEGIN) == between(faulty, 0.0, BEGIN), kind
        assert between(clean, END + 0.01, 9.0) == between(faulty, END + 0.01, 9.0), kind
        assert between(clean, BEGIN, END) != between(faulty, BEGIN, END), kind


def test_headings_jump_drift_freeze_and_scatter() -> None:
    clean, faulty = readings("heading_jump", 30.0)
    offsets = [wrap(bad.heading - good.heading) for good, bad in zip(clean, faulty, strict=True)]
    assert max(offsets) == pytest.approx(math.radians(30.0))
    clean, faulty = readings("heading_drift", -5.0)
    last = between(faulty, 0.0, END)[-1]
    good = between(clean, 0.0, END)[-1]
    assert math.degrees(wrap(last.heading - good.heading)) == pytest.approx(-5.0 * (last.time - BEGIN))
    _, faulty = readings("heading_frozen")
    assert len({reading.heading for reading in between(faulty, BEGIN, END)}) == 1
    clean, faulty = readings("heading_noise", 10.0)
    pairs = zip(between(clean, BEGIN, END), between(faulty, BEGIN, END), strict=True)
    assert 5.0 < np.std([math.degrees(wrap(bad.heading - good.heading)) for good, bad in pairs]) < 15.0
    clean, faulty = readings("heading_spikes", 0.5)
    changed = sum(good != bad for good, bad in zip(clean, faulty, strict=True))
    assert 3 <= changed <= 17


def test_a_ramp_grows_from_nothing() -> None:
    clean, faulty = readings("rate_bias", 10.0, ramp_s=2.0)
    for good, bad in zip(between(clean, BEGIN, END), between(faulty, BEGIN, END), strict=True):
        assert math.degrees(bad.rate - good.rate) == pytest.approx(10.0 * (good.time - BEGIN) / 2.0)


def test_rates_and_speeds_are_wrong_as_set() -> None:
    clean, faulty = readings("rate_reversed")
    for good, bad in zip(between(clean, BEGIN, END), between(faulty, BEGIN, END), strict=True):
        assert bad.rate == -good.rate
    clean, faulty = readings("speed_wrong", 0.5)
    good, bad = between(clean, BEGIN, END)[3], between(faulty, BEGIN, END)[3]
    assert bad.water_speed == pytest.approx(0.5 * good.water_speed)
    assert bad.ground_speed == pytest.approx(math.hypot(bad.north_speed, bad.east_speed))
    assert bad.ground_speed == pytest.approx(0.5 * good.ground_speed)
    _, faulty = readings("speed_frozen")
    frozen = between(faulty, BEGIN, END)
    assert len({(each.ground_speed, each.north_speed, each.east_speed) for each in frozen}) == 1
    clean, faulty = readings("position_jump", 100.0)
    good, bad = between(clean, BEGIN, END)[3], between(faulty, BEGIN, END)[3]
    assert math.radians(bad.latitude - good.latitude) * 6371008.8 == pytest.approx(100.0)
    for kind in ("rate_frozen", "speed_frozen", "feedback_frozen"):
        _, faulty = readings(kind)
        values = {
            {"rate_frozen": each.rate, "speed_frozen": each.water_speed, "feedback_frozen": each.rudder}[kind]
            for each in between(faulty, BEGIN, END)
        }
        assert len(values) == 1, kind


def test_late_readings_are_late_and_come_back() -> None:
    world = world_with(FaultSection("heading_late", 1.0, 3.0, 0.5))
    ages = []
    for step in range(1, 41):
        world.advance(0.1 * step)
        reading = world.sensors.latest(world.time)
        assert reading is not None
        ages.append(world.time - reading.time)
    assert max(ages[:9]) < 0.2
    assert ages[20] == pytest.approx(ages[5] + 0.5, abs=0.011)
    assert max(ages[30:]) < 0.2


def rudder_track(kind: FaultKind, size: float | None, hand: Callable[[float], float]) -> list[float]:
    """The rudder [deg] at each tenth of a second, the fault from 2 s to 4 s."""
    world = world_with(FaultSection(kind, BEGIN, END, size), hand=hand)
    track = []
    for step in range(1, 61):
        world.advance(0.1 * step)
        track.append(math.degrees(world.boat.state.rudder))
    return track


def test_the_rudder_sticks_reverses_slips_and_meets_its_stop() -> None:
    ten = math.radians(10.0)
    stuck = rudder_track("rudder_stuck", None, lambda time: ten if time < 2.5 else -ten)
    assert stuck[20:39] == [stuck[20]] * 19
    assert stuck[-1] == pytest.approx(-10.0, abs=0.2)
    assert rudder_track("rudder_reversed", None, lambda time: ten)[38] == pytest.approx(-10.0, abs=0.2)
    assert rudder_track("rudder_offset", 4.0, lambda time: ten)[38] == pytest.approx(14.0, abs=0.2)
    assert rudder_track("rudder_hard_over", -1.0, lambda time: 0.0)[38] == pytest.approx(-30.0, abs=0.2)
    assert rudder_track("rudder_limited", 6.0, lambda time: ten)[38] == pytest.approx(6.0, abs=0.2)
    assert abs(rudder_track("rudder_free", None, lambda time: ten)[38]) < 0.5
    slow = rudder_track("rudder_slow", 0.1, lambda time: ten if time > BEGIN else 0.0)
    assert slow[29] - slow[24] == pytest.approx(0.1 * 20.0 * 0.5, abs=0.2)
    loose = rudder_track("rudder_play", 3.0, lambda time: ten if time < BEGIN else math.radians(8.0))
    assert loose[38] == pytest.approx(10.0, abs=0.2), "within the play nothing moves"


def test_the_boat_stops_backs_heels_and_is_pushed() -> None:
    world = world_with(FaultSection("engine_stopped", 0.0, 20.0))
    world.advance(20.0)
    assert world.boat.state.speed < 0.1 * world.cruise_speed
    world = world_with(FaultSection("engine_astern", 0.0, size=0.5))
    world.advance(20.0)
    assert world.boat.state.speed == pytest.approx(-0.5 * world.cruise_speed, rel=0.05)
    world = world_with(FaultSection("heel", 0.0, size=30.0))
    world.advance(10.0)
    assert math.degrees(world.boat.state.roll) == pytest.approx(30.0, abs=2.0)
    world = world_with(FaultSection("yaw_push", 0.0, size=5.0))
    world.advance(3.0)
    assert world.boat.state.heading > 0.05


@pytest.mark.parametrize("kind", ["heading_lag", "rate_lag"])
def test_values_of_some_time_ago_come_under_the_time_stamp_of_now(kind: FaultKind) -> None:
    clean, faulty = readings(kind, 0.3)
    shown, other = ("heading", "rate") if kind == "heading_lag" else ("rate", "heading")
    assert [reading.time for reading in faulty] == [reading.time for reading in clean]
    assert [getattr(reading, other) for reading in faulty] == [getattr(reading, other) for reading in clean]
    # a sample every 0.1 s: 0.3 s ago is three of them
    late = [getattr(reading, shown) for reading in between(faulty, BEGIN + 0.35, END)]
    first = next(index for index, reading in enumerate(clean) if reading.time >= BEGIN + 0.35)
    assert late == [getattr(reading, shown) for reading in clean[first - 3 : first - 3 + len(late)]]
    assert between(clean, END + 0.01, 9.0) == between(faulty, END + 0.01, 9.0)


def test_orders_reach_the_steering_gear_late_and_soon_again() -> None:
    ten = math.radians(10.0)

    def hand(time: float) -> float:
        return ten if 2.5 <= time < 5.0 else 0.0

    late, prompt = rudder_track("rudder_late", 0.8, hand), rudder_track("rudder_late", 0.0, hand)
    moved, due = (next(step for step, angle in enumerate(track) if angle > 1.0) for track in (late, prompt))
    assert moved - due == 8
    assert late[45:] == pytest.approx(prompt[45:], abs=0.01), "the fault ends at 4 s"


def test_a_stream_sets_the_boat_along_the_heading_that_was_and_only_the_ground_shows_it() -> None:
    world = world_with(FaultSection("stream", 2.0, 60.0, -2.0, ramp_s=5.0), hand=lambda time: 0.2)
    world.advance(1.9)
    assert world.boat.state.heading > 0.1
    world.advance(2.0)
    towards = world.boat.state.heading
    world.advance(30.0)
    state, reading = world.boat.state, world.sensors.latest(30.0)
    assert reading is not None
    assert abs(wrap(state.heading - towards)) > 0.5
    through_water = complex(state.speed, state.sway) * complex(math.cos(state.heading), math.sin(state.heading))
    stream = complex(state.north_speed, state.east_speed) - through_water
    assert abs(stream - -2.0 * complex(math.cos(towards), math.sin(towards))) < 0.01
    assert reading.water_speed == pytest.approx(state.speed, abs=0.3)
    assert reading.ground_speed == pytest.approx(abs(stream + through_water), abs=0.3)


def test_a_log_that_is_lost_leaves_the_speed_over_the_ground() -> None:
    world = world_with(FaultSection("log_lost", 1.0, 2.0))
    instruments = NmeaInstruments(world, {"VHW": 10.0, "RMC": 5.0}, 38400)
    said: dict[str, list[float]] = {"VHW": [], "RMC": []}
    for step in range(1, 31):
        for line in b"".join(instruments.transmit(0.1 * step)).splitlines():
            said[line.split(b",")[0].decode()[3:]].append(0.1 * step)
    assert not [time for time in said["VHW"] if 1.15 < time < 2.0]
    assert [time for time in said["VHW"] if time < 1.0]
    assert [time for time in said["VHW"] if time > 2.1]
    assert len([time for time in said["RMC"] if 1.1 < time < 2.0]) >= 3


class Wire:
    """A flight controller and what it says, a step of 0.1 s at a time."""

    def __init__(self, *faults: FaultSection, parameters: dict[str, float] | None = None) -> None:
        self.world = world_with(*faults)
        self.firmware = Firmware(self.world)
        for name, value in (parameters or {}).items():
            self.firmware.parameters.set(name, value)
        self.vehicle = MavlinkVehicle(self.firmware)
        self.codec, self.ears = MavlinkCodec(255, 190), MavlinkCodec(255, 190)
        for stream in ("EXTRA1", "POSITION", "RC_CHAN", "EXTRA2", "EXT_STAT"):
            self.firmware.parameters.set(f"SR0_{stream}", 10)
            self.vehicle.streams.set_group(f"SR0_{stream}", 0.0)
        self.heard: list[tuple[float, Any]] = []

    def run(self, until: float, *messages: Any) -> Wire:
        while self.world.time + 1e-6 < until:
            now = round(self.world.time + 0.1, 6)
            for message in messages:
                self.vehicle.receive(now, self.codec.encode(message))
            for data in self.vehicle.transmit(now):
                self.heard += [(now, message) for message in self.ears.decode(data)]
        return self

    def times(self, kind: str) -> list[float]:
        return [time for time, message in self.heard if message.get_type() == kind]

    def texts(self) -> list[str]:
        return [message.text for _, message in self.heard if message.get_type() == "STATUSTEXT"]


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        ("heading_dropout", "ATTITUDE"),
        ("speed_lost", "VFR_HUD"),
        ("speed_lost", "GLOBAL_POSITION_INT"),
        ("feedback_lost", "SERVO_OUTPUT_RAW"),
        ("feedback_lost", "RC_CHANNELS"),
        ("heartbeat_lost", "HEARTBEAT"),
        ("position_lost", "GLOBAL_POSITION_INT"),
        ("silence", "HEARTBEAT"),
    ],
)
def test_a_message_stays_away_and_comes_back(kind: FaultKind, message: str) -> None:
    heard = Wire(FaultSection(kind, 1.95, 4.05)).run(6.0).times(message)
    assert not [time for time in heard if 2.0 <= time <= 4.0]
    assert [time for time in heard if time < 1.95]
    assert [time for time in heard if time > 4.05]


def test_a_heading_that_is_no_number() -> None:
    wire = Wire(FaultSection("heading_nan", 1.0, 2.0)).run(3.0)
    yaws = [(time, message.yaw) for time, message in wire.heard if message.get_type() == "ATTITUDE"]
    assert {math.isnan(yaw) for time, yaw in yaws if 1.1 < time < 1.9} == {True}
    assert not any(math.isnan(yaw) for time, yaw in yaws if time < 1.0 or time > 2.1)


def test_the_vehicle_warns_reboots_and_is_taken_in_hand() -> None:
    wire = Wire(FaultSection("geofence", 1.0), FaultSection("shallow", 1.0, size=0.8), FaultSection("battery_low", 1.0))
    wire.run(2.0)
    assert sorted(wire.texts()) == [
        "Battery 1 is low 10.71V used 9000 mAh",
        "Polygon fence breached",
        "Shallow water 0.8 m",
    ]
    status = [message for _, message in wire.heard if message.get_type() == "SYS_STATUS"]
    assert (status[0].battery_remaining, status[-1].battery_remaining) == (90, 10)
    battery = dialect.MAV_SYS_STATUS_SENSOR_BATTERY
    assert status[0].onboard_control_sensors_health & battery
    assert not status[-1].onboard_control_sensors_health & battery
    assert Wire(FaultSection("mode", 1.0, size=4.0)).run(2.0).firmware.mode is FirmwareMode.HOLD
    assert not Wire(FaultSection("disarm", 1.0)).run(2.0).firmware.armed
    rebooted = Wire(FaultSection("reboot", 2.0)).run(2.5)
    assert rebooted.firmware.time_since_boot(rebooted.world.time) == pytest.approx(0.5, abs=0.02)
    assert not rebooted.firmware.armed
    stepped = Wire(FaultSection("clock_step", 1.0, size=7.0)).run(2.0)
    assert stepped.firmware.time_since_boot(stepped.world.time) == pytest.approx(9.0, abs=0.02)


def test_a_hand_moves_the_sticks_and_lets_go() -> None:
    wire = Wire(FaultSection("stick", 1.0, 2.0, 0.5)).run(1.5)
    assert (wire.firmware.channels[0], wire.firmware.channels[1]) == (1750, 1750)
    wire.run(3.0)
    assert (wire.firmware.channels[0], wire.firmware.channels[1]) == (1500, 1500)
    override = dialect.MAVLink_rc_channels_override_message(1, 1, 1700, *[65535] * 7)
    switched = Wire(FaultSection("switch", 1.0, 2.0), parameters={"RC7_OPTION": 46.0})
    switched.run(0.9, override)
    assert switched.firmware.channels[0] == 1700
    switched.run(1.9, override)
    assert switched.firmware.channels[0] == 1500
    switched.run(3.0, override)
    assert switched.firmware.channels[0] == 1700
    ignored = Wire(FaultSection("overrides_ignored", 0.0)).run(1.0, override)
    assert ignored.firmware.channels[0] == 1500
    lost = Wire(FaultSection("receiver_lost", 1.0, 6.0)).run(5.0)
    assert "Radio Failsafe" in lost.texts()


def test_a_steering_stick_alone_and_a_receiver_without_its_radio_come_and_go() -> None:
    alone = Wire(FaultSection("steering_stick", 1.0, 2.0)).run(1.5)
    assert (alone.firmware.channels[0], alone.firmware.channels[1]) == (2000, 1500)
    alone.run(3.0)
    assert alone.firmware.channels[0] == 1500
    low = Wire(FaultSection("receiver_low", 1.0, 4.0))
    throttle = low.firmware.sticks[2]
    low.run(3.5)
    assert (low.firmware.channels[2], low.firmware.failsafe) == (900, "Radio")
    low.run(5.0)
    assert (low.firmware.channels[2], low.firmware.failsafe) == (throttle, "")


def test_the_compass_on_the_nmea_line_alone_is_off() -> None:
    world = world_with(FaultSection("heading_jump", 1.0, 2.0, 30.0, source="second"))
    instruments = NmeaInstruments(world, {"HDT": 10.0, "RSA": 5.0}, 38400)
    said: dict[float, float] = {}
    for step in range(1, 31):
        for line in b"".join(instruments.transmit(0.1 * step)).splitlines():
            if b"HDT" in line:
                said[0.1 * step] = float(line.split(b",")[1])
    assert 25.0 < said[1.5] < 35.0
    assert min(said[0.5], 360.0 - said[0.5]) < 5.0
    truth = world.sensors.latest(world.time)
    assert truth is not None
    assert abs(wrap(truth.heading)) < 0.1


@pytest.mark.parametrize(
    ("source", "first_is_well", "second_is_well"),
    [("first", False, True), ("second", True, False), ("both", False, False)],
)
def test_of_two_compasses_one_may_fail(source: Source, first_is_well: bool, second_is_well: bool) -> None:
    world = world_with(hand=lambda time: 0.3)
    world.advance(2.0)
    first, second = world.sensors.latest(2.0), world.sensors.second(2.0)
    assert first is not None
    assert first == second
    assert obey(world, f"heading_frozen source={source}").startswith("ok")
    assert obey(world, f"heading_dropout after=3 source={source}").startswith("ok")
    world.advance(4.0)
    shown = (world.sensors.latest(4.0), world.sensors.second(4.0))
    for reading, is_well in zip(shown, (first_is_well, second_is_well), strict=True):
        assert reading is not None
        assert (abs(wrap(reading.heading - first.heading)) > 0.1) == is_well
    world.advance(6.0)
    assert (world.sensors.has_heading(6.0), world.sensors.has_heading(6.0, "second")) == (first_is_well, second_is_well)


def test_faults_that_come_and_go_do_so_by_the_seed() -> None:
    section = FaultSection("heading_dropout", 10.0, 1000.0, every_s=20.0, lasts_s=2.0)

    def on(seed: int) -> list[bool]:
        board = FaultBoard([section], np.random.SeedSequence(seed))
        return [board.is_on("heading_dropout", float(second)) for second in range(1100)]

    assert on(1) == on(1)
    assert on(1) != on(2)
    share = sum(on(1)) / 990.0
    assert 0.04 < share < 0.16
    assert not any(on(1)[:10])
    assert not any(on(1)[1000:])


def test_scenarios_are_refused_in_one_sentence() -> None:
    for text, words in [
        ("{kind: rudder_stuck, from_s: 1, size: 3}", "has no size"),
        ("{kind: heading_jump, from_s: 1, size: 300}", "allowed is -180 to 180 (deg)"),
        ("{kind: heading_jump, from_s: 2, to_s: 1}", "must end after"),
    ]:
        with pytest.raises(InputError, match=words.replace("(", r"\(").replace(")", r"\)")):
            scenario_from(parse_document(f"schema_version: 1\nname: x\nfaults: [{text}]\n", "x.yaml"))


def test_the_desk_takes_faults_and_ends_them() -> None:
    world = world_with()
    world.advance(5.0)
    assert obey(world, "rudder_slow size=0.2 for=10 ramp=2 after=1") == "ok rudder_slow from 6.00 s to 16.00 s"
    assert obey(world, "list") == "ok none"
    world.advance(7.0)
    assert world.faults.size("rudder_slow", 7.0) == pytest.approx(0.1)
    assert obey(world, "list") == "ok rudder_slow since 6.00 s"
    assert obey(world, "heading_frozen") == "ok heading_frozen from 7.00 s until it is cleared"
    assert obey(world, "clear rudder_slow").startswith("ok 1 ended")
    assert obey(world, "list") == "ok heading_frozen since 7.00 s"
    assert obey(world, "clear").startswith("ok 1 ended")
    assert obey(world, "list") == "ok none"


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("", "an empty line"),
        ("rudder_stuk", "did you mean rudder_stuck"),
        ("rudder_stuck size=2", "has no size"),
        ("heading_jump size=1000", "allowed is -180 to 180"),
        ("heading_jump size=nan", "size=NUMBER"),
        ("heading_jump for=-1", "size=NUMBER"),
        ("heading_jump for=1 for=2", "each once"),
        ("clear rudder_stuk", "did you mean"),
        ("heading_jump source=third", "source=first"),
        ("heading_jump source=first source=second", "once"),
        ("rudder_stuck source=first", "no fault of one compass"),
    ],
)
def test_the_desk_refuses_in_one_sentence(line: str, words: str) -> None:
    world = world_with()
    answer = obey(world, line)
    assert answer.startswith("error ")
    assert words in answer
    assert not world.faults.at_work(0.0)


def test_the_desk_answers_on_the_loopback_and_the_command_prints_it(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sitl.faults.ask.__defaults__", (60.0,))  # its thread may wait for its turn
    address = f"127.0.0.1:{free_port()}"
    world = world_with()
    service = FaultService(world, address)
    stop = threading.Event()

    def answer() -> None:
        while not stop.is_set():
            select.select([service.fileno()], [], [], 0.05)
            service.serve()

    thread = threading.Thread(target=answer)
    thread.start()
    try:
        assert main(["fault", "--control", address, "yaw_push", "size=-5"]) == 0
        assert capsys.readouterr().out == "yaw_push from 0.00 s until it is cleared\n"
        assert main(["fault", "--control", address, "yaw_psh"]) == 2
        assert "did you mean yaw_push" in capsys.readouterr().err
        with pytest.raises(LinkError, match="choose another port"):
            FaultService(world, address)
    finally:
        stop.set()
        thread.join()
        service.close()
    assert [fault.size for fault in world.faults.at_work(0.0)] == [-5.0]
    for wrong in ("0.0.0.0:5000", "127.0.0.1:0", "127.0.0.1", "192.168.1.1:80"):
        assert main(["fault", "--control", wrong, "list"]) == 2
        assert "write 127.0.0.1:PORT" in capsys.readouterr().err


def test_of_two_faults_of_a_kind_the_last_counts() -> None:
    board = FaultBoard()
    board.add(Fault("heading_jump", 0.0, 10.0, 10.0))
    board.add(Fault("heading_jump", 5.0, 8.0, 20.0))
    assert [board.size("heading_jump", time) for time in (1.0, 6.0, 9.0, 10.0)] == [10.0, 20.0, 10.0, None]
