"""On/off valves: the switching rule alone, the drive against the simulated oil, and a course held with them."""

from __future__ import annotations

import dataclasses
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from autopilot.angles import wrap
from autopilot.api import design
from autopilot.errors import InputError
from autopilot.links.drives import DriveLink, DriveLinkSettings, DriveSettings
from autopilot.links.drives.maestro import ValveDrive
from autopilot.links.nmea.link import NmeaLink
from autopilot.links.rudder_order import ReleaseState
from autopilot.links.transports import loopback_pair
from autopilot.links.url import parse_url
from autopilot.models.steering_gear import Gate, Reckoned, Swing, Valve, reckoned, switched, swung, zone_in
from autopilot.runtime.build import build_pilot, follow_of, gear_of, limits_of
from autopilot.runtime.build_links import drive_settings_of, nmea_settings_of
from autopilot.signals import HelmSample, Mode, Order, OrderKind, RudderCommand, RudderSample
from autopilot.vessel.file import load_vessel, parse_vessel
from autopilot.vessel.schema import Drive, Valves, Vessel
from sitl.drives import ValveController
from sitl.scenario import FaultSection, load_scenario
from sitl.wire_nmea import NmeaInstruments
from sitl.world import World

TURN = 0.05
STEP = 0.02
STOP = math.radians(30.0)
RAM = Valve(math.radians(4.0), math.radians(6.0), 0.08, 0.1, 0.1)


def boat(sensor: int | None = 5, **drive: object) -> Vessel:
    """A boat with a hydraulic ram: 4 deg/s to port, 6 to starboard."""
    vessel = load_vessel("lanxin")
    rudder = dataclasses.replace(vessel.rudder, rate_max_deg_s=6.0, rate_port_deg_s=4.0, lag_s=0.0, delay_s=0.0)
    model = dataclasses.replace(vessel.model, K_1_s=0.25, T_s=3.0, n3_s2_rad2=20.0, n0_rad_s=0.0)
    valves = Drive(valve=Valves(sensor_channel=sensor), **drive)  # type: ignore[arg-type]
    return dataclasses.replace(vessel, rudder=rudder, model=model, drive=valves)


class Bench:
    """The drive's link and the simulated board with its oil, 20 ms at a time."""

    def __init__(self, vessel: Vessel, faults: tuple[FaultSection, ...] = ()) -> None:
        self.vessel = vessel
        self.world = World(vessel, dataclasses.replace(load_scenario("calm"), faults=faults))
        self.board = ValveController(self.world, 115200)
        self.near, self.far = loopback_pair()
        self.drive = ValveDrive(drive_settings_of(vessel))
        self.link = DriveLink(self.near, self.drive, DriveLinkSettings(115200, 20.0, follow_of(vessel)))
        self.now, self.samples = 0.0, [HelmSample(0.0, True, "")]
        self.angles: list[RudderSample] = []

    def carry(self) -> list[object]:
        """Let a step pass; return what the link has reported."""
        self.now += STEP
        for data in self.far.receive():
            self.board.receive(self.now, data)
        for data in self.board.transmit(self.now):
            self.far.send(data)
        samples = self.link.receive(self.now)
        self.samples += [sample for sample in samples if isinstance(sample, HelmSample)]
        self.angles += [sample for sample in samples if isinstance(sample, RudderSample)]
        return list(samples)

    def sail(self, seconds: float, order_deg: float | None) -> None:
        for _ in range(round(seconds / STEP)):
            self.carry()
            order = math.radians(order_deg or 0.0)
            self.link.send(self.now, RudderCommand(self.now, order, order_deg is not None))
            self.link.poll(self.now)

    @property
    def rudder_deg(self) -> float:
        return math.degrees(self.world.boat.state.rudder)


angles = st.floats(-0.5, 0.5)


@given(angles, angles, st.floats(1.0, 15.0), st.floats(1.0, 15.0), st.floats(0.0, 0.3), st.floats(0.0, 0.5))
def test_a_still_order_is_reached_by_one_pulse_and_no_more(
    start: float, order: float, port: float, starboard: float, opening: float, coasting: float
) -> None:
    valve = Valve(math.radians(port), math.radians(starboard), opening, coasting, opening + 0.05)
    zone = valve.zone(TURN, 0.0)
    gate, rudder, opened = Gate(), Reckoned(start, 0.0, 0.0), 0
    for number in range(1, 2000):
        rudder = reckoned(valve, STOP, gate, rudder, TURN * number)
        before, gate = gate, switched(valve, zone, TURN, gate, rudder, order)
        assert before.side * gate.side >= 0, "never from one side to the other at once"
        opened += gate.side != 0 and before.side == 0
    assert gate.side == 0 and opened <= 1
    assert abs(rudder.angle - min(max(order, -STOP), STOP)) <= zone + 1.0e-9 or abs(order) > STOP


@pytest.mark.parametrize("side", [-1, 1])
def test_no_pulse_is_shorter_than_the_least_one(side: int) -> None:
    gate = switched(RAM, 0.01, TURN, Gate(), Reckoned(0.0, 0.0, 1.0), side * 0.012)
    assert gate == Gate(side, 1.0, side)
    assert switched(RAM, 0.01, TURN, gate, Reckoned(0.0, 0.0, 1.09), -side * 0.3) == gate
    assert switched(RAM, 0.01, TURN, gate, Reckoned(0.0, 0.0, 1.11), -side * 0.3).side == 0


def test_a_valve_waits_until_a_rudder_that_runs_on_to_the_other_side_rests() -> None:
    shut = Gate(0, 2.0, 1)
    assert switched(RAM, 0.01, TURN, shut, Reckoned(0.1, 0.0, 2.25), -0.1).side == 0
    assert switched(RAM, 0.01, TURN, shut, Reckoned(0.1, 0.0, 2.31), -0.1).side == -1


def test_the_zone_grows_in_a_sea_and_not_by_more_in_a_turn() -> None:
    zone = math.radians(0.5)
    sea = swell = Swing()
    for number in range(4000):
        sea = swung(sea, zone, math.radians(3.0) * math.sin(number * TURN), TURN)
        swell = swung(swell, zone, 0.1, TURN)
    assert math.degrees(zone_in(sea, zone)) == pytest.approx(1.6, abs=0.2), "half of 3 deg"
    assert zone_in(swell, zone) == zone
    turn = swung(Swing(0.0, 0.0), zone, 0.5, 1.0)
    assert zone_in(turn, zone) < math.radians(1.0)


@pytest.mark.parametrize("odd", [False, True])
@pytest.mark.parametrize("sensor", [5, None])
def test_valves_bring_the_rudder_to_its_order(sensor: int | None, odd: bool) -> None:
    more = {"angle_at_full_deg": 45.0, "amidships": 0.1, "reversed": True, "device": 33, "channel": 2}
    bench = Bench(boat(sensor, **(more if odd else {})))
    bench.sail(1.0, None)
    assert bench.samples[-1].available, bench.samples[-1].reason
    for order in (15.0, -20.0, 3.0):
        bench.sail(12.0, order)
        assert bench.rudder_deg == pytest.approx(order, abs=1.0)
        assert math.degrees(bench.angles[-1].angle) == pytest.approx(bench.rudder_deg, abs=1.0)
        assert bench.angles[-1].ordered is (sensor is None)
    assert 3 <= bench.board.openings <= 6, "three moves, and a sensor's noise"
    assert bench.drive.rejected == 0


def test_both_outputs_are_off_after_a_release_and_the_openings_are_said() -> None:
    bench = Bench(boat())
    bench.sail(1.0, 0.0)
    bench.sail(1.0, 20.0)
    bench.link.release(bench.now)
    for _ in range(40):
        bench.carry()
        release = bench.link.release_result(bench.now)
        if release is not None:
            break
    assert release is not None and release.state is ReleaseState.CONFIRMED
    assert "valves opened 1 times" in release.sentence
    resting = bench.rudder_deg
    for _ in range(100):
        bench.carry()
    assert bench.rudder_deg == pytest.approx(resting, abs=0.1)


def test_the_board_shuts_the_valves_when_the_pilot_is_silent() -> None:
    bench = Bench(boat())
    bench.sail(1.0, 25.0)
    # nothing but the board goes on
    bench.world.advance(bench.now + 8.0)
    assert bench.rudder_deg < 12.0


@pytest.mark.parametrize(("kind", "size"), [("rudder_hard_over", 1.0), ("rudder_one_way", -1.0), ("rudder_stuck", 1.0)])
def test_a_valve_that_sticks_takes_the_helm_away_where_a_sensor_shows_it(kind: str, size: float) -> None:
    bench = Bench(boat(), (FaultSection(kind, 3.0, size=size),))  # type: ignore[arg-type]
    bench.sail(3.0, 0.0)
    bench.sail(5.0, 15.0 if kind != "rudder_hard_over" else -10.0)
    assert not bench.samples[-1].available
    assert "the rudder does not follow" in bench.samples[-1].reason


def test_a_leaking_valve_is_worked_against() -> None:
    bench = Bench(boat(), (FaultSection("rudder_creeps", 3.0, size=0.3),))
    bench.sail(40.0, 5.0)
    assert bench.rudder_deg == pytest.approx(5.0, abs=1.2)
    assert bench.board.openings >= 3


@pytest.mark.parametrize("sensor", [5, None])
def test_a_course_is_held_and_turned_to_with_valves(sensor: int | None) -> None:
    vessel = boat(sensor)
    sensors = dataclasses.replace(vessel.sensors, variation_deg=0.0)
    bench = Bench(design(dataclasses.replace(vessel, sensors=sensors)))
    compass = NmeaInstruments(bench.world, {"HDT": 10.0, "ROT": 10.0}, 38400)
    near, far = loopback_pair()
    instruments = NmeaLink(near, nmea_settings_of(bench.vessel, parse_url("nmea:/dev/x:38400?steer=no")))
    pilot = build_pilot(bench.vessel)
    worst, opened, alarms = 0.0, 0, set()
    for number in range(round(120.0 / STEP)):
        samples = bench.carry()
        for data in compass.transmit(bench.now):
            far.send(data)
        samples += instruments.receive(bench.now)
        course = math.radians(20.0 if number * STEP < 60.0 else -20.0)
        tick = pilot.step(bench.now, tuple(samples), Order(OrderKind.HEADING, course, serial=int(course > 0)))  # type: ignore[arg-type]
        bench.link.send(bench.now, tick.command)
        bench.link.poll(bench.now)
        alarms.update(alarm.name for alarm in tick.alarms)
        if number * STEP % 60.0 > 40.0:
            worst = max(worst, abs(math.degrees(wrap(bench.world.boat.state.heading - course))))
        else:
            opened = bench.board.openings
    assert tick.mode is Mode.ENGAGED
    assert worst < 2.0
    assert alarms == {"cannot_engage"}, "a rudder that rests in its dead zone is no late line"
    assert bench.board.openings - opened < 15, "in 20 s"


def test_the_limits_know_both_sides() -> None:
    gear, limits = gear_of(boat()), limits_of(boat())
    assert math.degrees(gear.rate_max) == pytest.approx(4.0) and gear.to_starboard == pytest.approx(1.5)
    assert limits.to_port == 1.0 and limits.to_starboard == pytest.approx(1.5)
    assert gear.delay == pytest.approx(0.08)
    slow = dataclasses.replace(boat(), limits=dataclasses.replace(boat().limits, rate_max_deg_s=5.0))
    assert limits_of(slow).to_starboard == pytest.approx(1.25)


def test_a_vessel_without_a_rate_or_with_too_short_a_pulse_is_refused() -> None:
    with pytest.raises(InputError, match=r"rudder.rate_max_deg_s is null"):
        ValveDrive(DriveSettings(1.0))
    text = (
        "schema_version: 2\nname: x\nmodel: {K_1_s: 0.2, T_s: 3, reference_speed_m_s: 4}\n"
        "rudder: {angle_max_deg: 30, rate_max_deg_s: 5}\ndrive: {valve: {least_pulse_s: 0.05}}\n"
    )
    with pytest.raises(InputError, match="a pulse that is over before the rudder moves"):
        parse_vessel(text, "x.yaml")


@pytest.mark.parametrize(("creep_deg_s", "side"), [(0.6, "starboard"), (-0.6, "port"), (0.0, "")])
def test_a_rudder_that_moves_behind_shut_valves_is_said(creep_deg_s: float, side: str) -> None:
    """The limit is 0.2 deg/s, a twentieth of the slower valve's rate; the order swings as on a course."""
    bench, said = Bench(boat()), set[str]()
    for step in range(round(60.0 / STEP)):
        bench.board._place += math.radians(creep_deg_s) * STEP
        bench.sail(STEP, 4.0 * math.sin(0.3 * step * STEP))
        warning = bench.drive.warning(bench.now)
        said |= {warning.detail} if warning is not None else set()
    words = f"with both valves shut the rudder moves to {side}: a valve that does not close, or a leak"
    assert said == ({words} if side else set())


@pytest.mark.parametrize("pulse", [0.3, 0.6, 2.0])
def test_oil_that_comes_up_to_its_rate_is_reckoned_by_the_whole_way_of_a_pulse(pulse: float) -> None:
    """The rudder begins to move after 0.08 s, and follows with a lag of 0.1 s: with the former for `opening` a pulse of
    0.3 s counts for 1.45 times its way."""
    rate, begins, lag, dt = math.radians(4.0), 0.08, 0.1, 0.0005

    def way(lasts: float) -> float:
        speed = moved = 0.0
        for step in range(round((lasts + 20.0 * lag) / dt)):
            speed += ((rate if begins < step * dt < lasts else 0.0) - speed) * dt / lag
            moved += speed * dt
        return moved

    valve = RAM._replace(port=rate, opening=1.0 + lag - way(1.0) / rate, coasting=lag)
    assert valve.opening == pytest.approx(begins + lag, abs=0.002)
    opened = reckoned(valve, STOP, Gate(-1, 0.0, 0), Reckoned(0.0, 0.0, 0.0), pulse)
    shut = reckoned(valve, STOP, Gate(0, pulse, -1), opened, pulse + 5.0)
    assert -shut.angle == pytest.approx(way(pulse), rel=0.02)


def test_a_rudder_moved_by_hand_is_no_leak() -> None:
    bench = Bench(boat())
    for _ in range(round(60.0 / STEP)):
        bench.board._place += math.radians(0.4) * STEP
        bench.sail(STEP, None)
    assert bench.drive.warning(bench.now) is None
