"""Drive protocols on their bytes, against the simulated drives in lockstep, and against noise."""

from __future__ import annotations

import dataclasses
import math
import struct
from collections.abc import Sequence

import pytest
from alarm_texts import words
from hypothesis import given
from hypothesis import strategies as st
from manual_clock import ManualClock

from autopilot.links.drives import DriveLink, DriveLinkSettings, DriveSettings, JumpGate
from autopilot.links.drives.jrk import HEALTH, MOTION, JrkG2
from autopilot.links.drives.maestro import Maestro
from autopilot.links.drives.pypilot_motor import PypilotMotor, crc8, packet
from autopilot.links.rudder_order import Release, ReleaseState
from autopilot.links.transports import loopback_pair
from autopilot.models.steering_gear import Valve
from autopilot.runtime.build import follow_of
from autopilot.runtime.build_links import DRIVES, drive_of, drive_settings_of
from autopilot.runtime.session import Session
from autopilot.signals import AlarmSample, HelmSample, Order, RudderCommand, RudderSample
from autopilot.vessel.file import load_vessel
from autopilot.vessel.schema import Drive, Vessel
from sitl.scenario import FaultSection, load_scenario
from sitl.serve import DRIVES as TWINS
from sitl.world import World

FULL = math.radians(40.0)
VALVE = Valve(math.radians(4.0), math.radians(6.0), 0.08, 0.1, 0.1)
SETTINGS = DriveSettings(
    angle_at_full=FULL, stop=math.radians(35.0), rate=math.radians(20.0), valve=VALVE, sensor_channel=5
)
ODD = Drive(angle_at_full_deg=45.0, amidships=0.1, reversed=True, device=33, channel=3)


def boat(drive: Drive) -> Vessel:
    return dataclasses.replace(load_vessel("lanxin"), drive=drive)


class Bench:
    """A drive link and the simulated drive, 20 ms at a time."""

    def __init__(self, kind: str, drive: Drive = Drive(), faults: tuple[FaultSection, ...] = ()) -> None:  # noqa: B008
        vessel = boat(drive)
        self.world = World(vessel, dataclasses.replace(load_scenario("calm"), faults=faults))
        self.twin = TWINS[kind](self.world, 38400)
        self.near, self.far = loopback_pair()
        settings = DriveLinkSettings(38400, 20.0, follow_of(vessel))
        self.link = DriveLink(self.near, drive_of(kind, drive_settings_of(vessel)), settings)
        self.now = 0.0
        self.samples: list[object] = []

    def sail(self, seconds: float, order_deg: float | None, deaf: bool = False) -> None:
        for _ in range(round(seconds / 0.02)):
            self.now += 0.02
            for data in self.far.receive():
                if not deaf:
                    self.twin.receive(self.now, data)
            for data in self.twin.transmit(self.now):
                if not deaf:
                    self.far.send(data)
            self.samples += self.link.receive(self.now)
            order = math.radians(order_deg or 0.0)
            self.link.send(self.now, RudderCommand(self.now, order, order_deg is not None))
            self.link.poll(self.now)

    @property
    def rudder_deg(self) -> float:
        return math.degrees(self.world.boat.state.rudder)

    @property
    def helm(self) -> HelmSample:
        return [sample for sample in self.samples if isinstance(sample, HelmSample)][-1]


@pytest.mark.parametrize("drive", [Drive(), ODD], ids=["plain", "odd"])
@pytest.mark.parametrize("kind", ["jrk", "maestro", "pypilot"])
def test_a_drive_goes_where_it_is_ordered_and_says_so(kind: str, drive: Drive) -> None:
    bench = Bench(kind, drive)
    bench.sail(1.0, None)
    assert bench.helm.available, bench.helm.reason
    for order in (15.0, -20.0, 3.0, -30.0):
        bench.sail(4.0, order)
        assert bench.rudder_deg == pytest.approx(order, abs=0.6)
        seen = [sample for sample in bench.samples if isinstance(sample, RudderSample)][-1]
        assert math.degrees(seen.angle) == pytest.approx(order, abs=0.8)
        assert seen.ordered is (kind == "maestro"), "a Maestro knows its pulse, not the rudder"
    assert bench.helm.available
    bench.sail(3.0, None)
    assert (bench.rudder_deg == pytest.approx(-30.0, abs=0.6)) is (kind == "jrk"), "a Jrk brakes, the others let go"
    bench.sail(3.0, 10.0)
    assert bench.rudder_deg == pytest.approx(10.0, abs=0.6), "engaged anew"


@pytest.mark.parametrize("kind", sorted(DRIVES))
def test_a_drive_that_falls_silent_takes_the_helm_away_and_gives_it_back(kind: str) -> None:
    bench = Bench(kind)
    bench.sail(2.0, 5.0)
    bench.sail(3.0, 5.0, deaf=True)
    assert not bench.helm.available
    assert "does not answer; check its power" in bench.helm.reason
    bench.sail(2.0, None)
    assert bench.helm.available


@pytest.mark.parametrize("kind", ["pypilot", "jrk"])
def test_a_jammed_rudder_is_found_by_the_drive_s_own_sensor(kind: str) -> None:
    bench = Bench(kind, Drive(), (FaultSection("rudder_stuck", 3.0, 100.0),))
    bench.sail(6.0, 15.0)
    bench.sail(6.0, -15.0)
    assert not bench.helm.available
    assert "the rudder does not follow" in bench.helm.reason


def test_a_jammed_motor_trips_the_controller_and_the_reason_is_passed_on() -> None:
    bench = Bench("pypilot", Drive(current_max_a=8.0), (FaultSection("rudder_stuck", 3.0, 5.0),))
    bench.sail(3.0, 0.0)
    bench.sail(1.0, 15.0)
    assert not bench.helm.available
    assert "its motor drew too much current; look whether the rudder is jammed" in bench.helm.reason
    bench.sail(3.0, None)
    assert bench.helm.available
    bench.sail(3.0, 10.0)
    assert bench.rudder_deg == pytest.approx(10.0, abs=0.6), "engaging anew resets the overcurrent"


def test_a_stall_is_an_alarm_that_is_taken_back() -> None:
    bench = Bench("jrk", Drive(current_max_a=8.0), (FaultSection("rudder_stuck", 1.0, 3.5),))
    bench.sail(1.0, 0.0)
    bench.sail(6.0, 15.0)
    alarms = [words(sample.event) for sample in bench.samples if isinstance(sample, AlarmSample)]
    assert len(alarms) == 2
    assert "A, more than drive.current_max_a (8): look whether the rudder is jammed" in alarms[0]
    assert alarms[1] == ""


def test_a_controller_without_rudder_sensor_cannot_steer() -> None:
    bench = Bench("pypilot")
    transmit = bench.twin.transmit

    def without_angle(now: float) -> list[bytes]:
        """The controller's telegrams of four bytes, the rudder angle as it says that it has none."""
        said = b"".join(transmit(now))
        telegrams = [said[at : at + 4] for at in range(0, len(said), 4)]
        return [packet(0xA7, 65535) if telegram[0] == 0xA7 else telegram for telegram in telegrams]

    bench.twin.transmit = without_angle
    bench.sail(2.0, 15.0)
    assert not bench.helm.available
    assert "reports no rudder angle; it cannot" in bench.helm.reason
    assert bench.rudder_deg == pytest.approx(0.0, abs=0.01)


def test_the_pypilot_controller_holds_the_end_stops_itself() -> None:
    bench = Bench("pypilot")
    bench.sail(1.0, 0.0)
    # a host gone mad that asks for full speed for ever: the limits sent before still hold
    for _ in range(200):
        bench.now += 0.02
        bench.twin.receive(bench.now, packet(0xC7, 0))
    assert bench.rudder_deg == pytest.approx(30.0, abs=1.0)


def test_one_wild_angle_is_dropped_two_that_agree_are_believed() -> None:
    motor = PypilotMotor(SETTINGS)
    middle, wild = 32736, 60000
    heard = [
        motor.feed(step * 0.1, packet(0xA7, raw)) for step, raw in enumerate([0, 0, middle, wild, middle, wild, wild])
    ]
    assert [len(angles) for angles in heard] == [0, 0, 1, 0, 1, 0, 1]
    assert motor.rejected == 2


def test_drive_protocols_encode_known_bytes() -> None:
    assert crc8(b"123456789") == 0xF7, "check value of CRC-8/NRSC-5"
    assert packet(0xC7, 1000).hex() == bytes((0xC7, 0xE8, 0x03, crc8(b"\xc7\xe8\x03"))).hex()
    third = math.radians(40.0)
    maestro = Maestro(DriveSettings(angle_at_full=third, channel=2))
    assert maestro.order(0.0, 0.0) == bytes((0x84, 0x02, 0x70, 0x2E)), "1500 us, the guide's example"
    assert maestro.release(0.0) == bytes((0x84, 0x02, 0x00, 0x00))
    maestro = Maestro(DriveSettings(angle_at_full=third, channel=2, device=12))
    assert maestro.order(0.0, 0.0) == bytes((0xAA, 12, 0x04, 0x02, 0x70, 0x2E))
    jrk = JrkG2(DriveSettings(angle_at_full=1.0))
    assert jrk.order(0.0, 0.0) == bytes((0xC0, 64)), "target 2048"
    assert jrk.order(0.0, (3229 - 2048) / 2047.0) == bytes((0xDD, 0x64)), "target 3229"
    assert jrk.order(0.0, 5.0) == bytes((0xDF, 127)), "not beyond 4095"
    assert jrk.release(0.0) == b"\xff"
    assert JrkG2(DriveSettings(1.0, device=11)).release(0.0) == bytes((0xAA, 11, 0x7F))


def test_an_order_stays_inside_the_end_stops() -> None:
    jrk = JrkG2(SETTINGS)
    low, high = (jrk.order(0.0, side * 2.0) for side in (-1.0, 1.0))
    targets = [(data[0] & 0x1F) | data[1] << 5 for data in (low, high)]
    assert targets == [2048 - round(2047 * 35 / 40), 2048 + round(2047 * 35 / 40)]


@given(st.lists(st.binary(max_size=40), max_size=30), st.sampled_from(sorted(DRIVES)))
def test_noise_is_survived_and_moves_nothing(chunks: list[bytes], kind: str) -> None:
    drive = drive_of(kind, SETTINGS)
    drive.order(0.0, 0.1)
    for step, chunk in enumerate(chunks):
        now = step * 0.05
        drive.ask(now)
        for angle in drive.feed(now, chunk):
            assert abs(angle) <= FULL * 1.001
        drive.fault(now)
        drive.warning(now)
    assert len(drive._buffer) <= 40


@given(st.binary(min_size=1, max_size=3), st.integers(0, 59), st.integers(1, 255))
def test_a_damaged_pypilot_stream_yields_only_what_was_sent(noise: bytes, place: int, flip: int) -> None:
    raws = [100 * step for step in range(15)]
    stream = bytearray(b"".join(packet(0xA7, raw) for raw in raws))
    stream[place] ^= flip
    # the controller's own packets, right before and behind, and noise between
    clean = PypilotMotor(SETTINGS)
    sent = set(clean.feed(0.0, b"".join(packet(0xA7, raw) for raw in [0, 0, *raws])))
    got = PypilotMotor(SETTINGS).feed(0.0, bytes(stream[:20]) + noise + bytes(stream[20:]))
    strangers = set(got) - sent
    assert not strangers
    assert len(got) >= 3


@given(st.binary(min_size=MOTION[1].size, max_size=MOTION[1].size))
def test_a_jrk_answer_is_believed_only_with_a_target_of_ours(answer: bytes) -> None:
    jrk = JrkG2(SETTINGS)
    jrk.order(0.0, 0.1)
    jrk.ask(0.0)
    target = struct.unpack_from("<H", answer)[0]
    angles = jrk.feed(0.1, answer)
    assert not angles or target == 2048 + round(SETTINGS.place(0.1) * 2047)


def test_a_late_or_long_jrk_answer_is_dropped() -> None:
    jrk = JrkG2(SETTINGS)
    right = MOTION[1].pack(2048, 2048, 2048, 0, 0, 0)
    jrk.ask(0.0)
    assert jrk.feed(0.1, right) == [0.0]
    jrk.ask(0.2)
    assert jrk.feed(0.9, right) == []
    assert jrk.ask(1.0)
    assert jrk.feed(1.1, right + b"\x00") == []
    assert jrk.rejected == 3


def test_a_jrk_says_why_it_has_stopped() -> None:
    jrk = JrkG2(SETTINGS)
    jrk.order(0.0, 0.1)
    for turn in range(8):
        if jrk.ask(2.0 + turn) == bytes((0xE5, HEALTH[0], HEALTH[1].size)):
            jrk.feed(2.0 + turn, HEALTH[1].pack(0x0042, 0x0042, 0, 12600, 500))
    assert "has no motor power" in jrk.fault(9.5)


def test_the_line_never_carries_more_than_it_can() -> None:
    near, far = loopback_pair()
    link = DriveLink(near, PypilotMotor(SETTINGS), DriveLinkSettings(baud=1200, rate=50.0))
    sent = 0
    for step in range(500):
        link.send(step * 0.01, RudderCommand(step * 0.01, 0.1, True))
        link.poll(step * 0.01)
        sent += sum(len(data) for data in far.receive())
    assert 300 < sent <= 600 + 20, "5 s at 120 bytes a second"


def test_the_way_out_releases_and_never_raises() -> None:
    near, far = loopback_pair()
    link = DriveLink(near, JrkG2(SETTINGS))
    link.release(0.0)
    assert far.receive() == [], "what was never taken is not given back"
    link.send(0.0, RudderCommand(0.0, 0.1, True))
    far.receive()
    link.release(0.1)
    assert set(far.receive()) == {b"\xff"}
    link.send(0.2, RudderCommand(0.2, 0.1, True))
    far.close()
    link.release(0.3)
    link.close()


@pytest.mark.parametrize("kind", ["pypilot", "jrk", "maestro"])
def test_a_drive_confirms_by_what_it_reports(kind: str) -> None:
    bench = Bench(kind)
    bench.sail(1.0, None)
    bench.sail(2.0, 15.0)
    assert _left(bench, deaf=False).sentence == f"rudder released, confirmed by the {bench.link.drive.name}"


@pytest.mark.parametrize("kind", ["pypilot", "jrk", "maestro"])
def test_a_drive_that_does_not_hear_is_not_called_released(kind: str) -> None:
    bench = Bench(kind)
    bench.sail(1.0, None)
    bench.sail(2.0, 15.0)
    release = _left(bench, deaf=True)
    assert release.state is ReleaseState.UNCONFIRMED
    assert release.sentence.endswith(bench.link.drive.lapse)


class _Sailing(ManualClock):
    """Waiting lets the drive work; deaf, it neither hears nor speaks."""

    def __init__(self, bench: Bench, deaf: bool) -> None:
        super().__init__(bench.now)
        self._bench, self._deaf = bench, deaf

    def wait(self, descriptors: Sequence[int], until: float) -> None:
        super().wait(descriptors, until)
        bench = self._bench
        for data in bench.far.receive():
            if not self._deaf:
                bench.twin.receive(until, data)
        for data in bench.twin.transmit(until):
            if not self._deaf:
                bench.far.send(data)


def _left(bench: Bench, deaf: bool) -> Release:
    link: DriveLink = bench.link
    session = Session(None, [link], _Sailing(bench, deaf), 20.0, lambda *_: Order())  # type: ignore[arg-type]
    session.close()
    (release,) = session.releases
    return release


def test_a_jrk_has_released_when_it_waits_for_a_command_and_not_before() -> None:
    jrk = JrkG2(SETTINGS)
    awaiting, other = HEALTH[1].pack(0x0001, 0x0001, 0, 12600, 0), HEALTH[1].pack(0x0010, 0x0010, 0, 12600, 0)

    def answered(now: float, health: bytes) -> bool:
        for turn in range(20):
            if jrk.ask(now + turn)[-1] == HEALTH[1].size:
                jrk.feed(now + turn + 0.1, health)
                return jrk.has_released()
        raise AssertionError("its health is never asked for")

    jrk.order(0.0, 0.1)
    assert not answered(1.0, awaiting), "a command has been given since"
    jrk.release(50.0)
    assert not jrk.has_released(), "what was said before the release counts for nothing"
    assert not answered(51.0, other)
    assert answered(100.0, awaiting)


def test_a_pypilot_controller_is_given_its_limits_at_first_and_every_twentieth_order() -> None:
    motor = PypilotMotor(SETTINGS)
    alone = len(packet(0xC7, 1000))
    longer = [number for number in range(61) if len(motor.order(0.05 * number, 0.0)) > alone]
    assert longer == [0, 20, 40, 60]


def test_a_maestro_is_asked_for_its_errors_every_eighth_time() -> None:
    maestro = Maestro(SETTINGS)
    asked = [maestro.ask(float(number))[0] for number in range(1, 25)]
    assert [number for number, command in enumerate(asked, 1) if command == 0xA1] == [8, 16, 24]


@given(st.floats(-1.5, 1.5), st.floats(-0.3, 0.3), st.booleans())
def test_the_scale_of_a_drive_and_its_angle_are_each_others_inverse(
    angle: float, amidships: float, is_reversed: bool
) -> None:
    settings = DriveSettings(angle_at_full=1.0, amidships=amidships, reversed=is_reversed, stop=0.9)
    place = settings.place(angle)
    held = min(max(angle, -0.9), 0.9)
    wanted = amidships + (-held if is_reversed else held)
    assert place == pytest.approx(min(max(wanted, -1.0), 1.0), abs=1e-12)
    if abs(wanted) <= 1.0:
        assert settings.angle(place) == pytest.approx(held, abs=1e-12)


@pytest.mark.parametrize(("moved_deg", "is_near"), [(4.9, True), (5.1, False), (-4.9, True), (-5.1, False)])
def test_a_rudder_moves_one_and_a_half_times_its_rate_and_two_degrees_at_most(moved_deg: float, is_near: bool) -> None:
    gate = JumpGate(DriveSettings(angle_at_full=1.0, rate=math.radians(10.0)))
    assert gate.passes(0.0, 0.1)
    assert gate.passes(0.2, 0.1 + math.radians(moved_deg)) is is_near
    assert gate.passes(0.2, 0.1) is not is_near, "the last that was believed counts"
    free = JumpGate(DriveSettings(angle_at_full=math.radians(10.0)))
    free.passes(0.0, 0.0)
    assert free.passes(0.2, math.radians(moved_deg)) is is_near, "without a known rate: its scale in a second"
