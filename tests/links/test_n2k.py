"""NMEA 2000 on python-can's virtual bus; the frames of the other side are packed here by hand."""

from __future__ import annotations

import builtins
import math
import struct
from collections.abc import Iterator
from typing import Any

import pytest
from alarm_texts import words
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from autopilot.errors import InputError
from autopilot.links.base import LinkError
from autopilot.links.n2k.link import BusLine, N2kLink, open_bus
from autopilot.links.n2k.packets import group_and_source, identifier
from autopilot.links.n2k.samples import Compass, sample_of
from autopilot.links.n2k.session import N2kSettings
from autopilot.links.north import UnusableHeadings
from autopilot.links.url import parse_url
from autopilot.models.steering_gear import SteeringGear, gear_step
from autopilot.runtime.build_links import LinkOptions, build_link
from autopilot.signals import (
    AlarmSample,
    HeadingSample,
    HelmSample,
    Mode,
    NavState,
    Order,
    OrderKind,
    RateSample,
    Reference,
    RollSample,
    RudderCommand,
    RudderSample,
    Sample,
    Tick,
)
from autopilot.vessel.file import load_vessel

can = pytest.importorskip("can", reason="python-can is not installed (extra n2k)")


class Bus:
    """The other nodes, and our link on the same virtual bus."""

    def __init__(self, name: str, **changes: Any) -> None:
        self.far = can.Bus(interface="virtual", channel=name)
        self.line = BusLine(f"n2k:virtual:{name}", open_bus("x", "virtual", name))
        self.link = N2kLink(self.line, N2kSettings(**changes))
        self.link.poll(-1.0)
        self.link.poll(-0.7)
        self.claim = self.heard()

    def put(self, group: int, data: bytes, source: int = 35) -> None:
        self.far.send(can.Message(arbitration_id=2 << 26 | group << 8 | source, data=data, is_extended_id=True))

    def heard(self) -> list[tuple[int, int, bytes]]:
        found = []
        while (frame := self.far.recv(timeout=0.0)) is not None:
            found.append((*group_and_source(frame.arbitration_id), bytes(frame.data)))
        return found

    def samples(self, now: float) -> list[Sample]:
        return [sample for sample in self.link.receive(now) if not isinstance(sample, HelmSample)]


@pytest.fixture
def bus(request: pytest.FixtureRequest) -> Iterator[Bus]:
    made = Bus(request.node.name)
    yield made
    made.link.close()
    made.far.shutdown()


def heading(value: float, deviation: int = 0x7FFF, variation: int = 0x7FFF, reference: int = 0) -> bytes:
    return struct.pack("<BHhhB", 1, round(value * 1e4), deviation, variation, 0xFC | reference)


def test_heading_rate_and_rudder_become_samples(bus: Bus) -> None:
    bus.put(127250, heading(6.0))
    bus.put(127251, struct.pack("<BihB", 1, round(-0.05 / 3.125e-8), -1, 255))
    bus.put(127245, struct.pack("<BBhhH", 0, 0xF8, 0x7FFF, -1500, 0xFFFF))
    got = bus.samples(5.0)
    assert got[0] == HeadingSample(5.0, pytest.approx(6.0 - math.tau), None, "N2K127250.35")
    assert got[1] == RateSample(5.0, pytest.approx(-0.05, abs=1e-6), "N2K127251.35")
    assert got[2] == RudderSample(5.0, pytest.approx(-0.15), False, "N2K127245.35")


def test_the_roll_of_an_attitude_becomes_a_sample_and_an_unknown_one_none(bus: Bus) -> None:
    bus.put(127257, struct.pack("<BhhhB", 1, 0x7FFF, 0x7FFF, -1234, 255), source=7)
    bus.put(127257, struct.pack("<BhhhB", 1, 0x7FFF, 200, 0x7FFF, 255), source=7)
    assert bus.samples(5.0) == [RollSample(5.0, pytest.approx(-0.1234), None, "N2K127257.7")]


def test_a_compass_that_is_late_measured_before_its_heading_came() -> None:
    late = Bus("late compass", heading_latency=0.3)
    late.put(127250, heading(1.0))
    late.put(127251, struct.pack("<BihB", 1, 0, -1, 255))
    first, second = late.samples(5.0)
    assert (first.time, second.time) == (pytest.approx(4.7), 5.0)
    late.link.close()
    late.far.shutdown()


def test_magnetic_courses_take_magnetic_headings_as_they_are_and_say_so_on_the_bus(
    request: pytest.FixtureRequest,
) -> None:
    bus = Bus(request.node.name, magnetic=True)
    bus.put(127250, heading(1.0, deviation=200, reference=1))
    bus.put(127250, heading(1.0, reference=0))
    (sample,) = bus.samples(0.0)
    assert isinstance(sample, HeadingSample) and sample.heading == pytest.approx(1.02)
    bus.put(127250, heading(1.0, variation=500, reference=0))
    (sample,) = bus.samples(1.0)
    assert isinstance(sample, HeadingSample) and sample.heading == pytest.approx(0.95)
    bus.link.close()
    bus.far.shutdown()


def test_headings_that_take_an_unknown_variation_are_reported(bus: Bus) -> None:
    reported: list[str] = []
    for second in range(12):
        bus.put(127250, heading(1.0, reference=1 if second < 8 else 0))
        reported += [
            words(sample.event).split(":")[0]
            for sample in bus.samples(float(second))
            if isinstance(sample, AlarmSample)
        ]
    assert reported == ["the headings need the magnetic variation, which is not known", ""]


def test_headings_that_cannot_be_used_are_reported_after_three_seconds() -> None:
    found = UnusableHeadings("line")
    assert [len(found.news(now, [], 1)) for now in (0.0, 2.999, 3.0, 9.0)] == [0, 0, 1, 0]
    assert found.news(10.0, [HeadingSample(10.0, 1.0)], 1) == [AlarmSample(10.0, None, "line, variation")]
    assert found.news(20.0, [], 1) == [], "none has come since"


def test_a_magnetic_heading_needs_a_variation_and_keeps_the_last_one_heard(bus: Bus) -> None:
    bus.put(127250, heading(1.0, reference=1))
    assert bus.samples(0.0) == []
    bus.put(127250, heading(1.0, deviation=200, variation=-500, reference=1))
    bus.put(127250, heading(1.0, reference=1))
    first, second = bus.samples(1.0)
    assert isinstance(first, HeadingSample)
    assert isinstance(second, HeadingSample)
    assert first.heading == pytest.approx(1.0 + 0.02 - 0.05)
    assert second.heading == pytest.approx(1.0 - 0.05)


@pytest.mark.parametrize(
    ("group", "data"),
    [
        (127250, b"\xff" * 8),
        (127250, b""),
        (127250, b"\x01\x00"),
        (127250, heading(6.5)),
        (127250, heading(1.0, reference=2)),
        (127251, struct.pack("<BihB", 1, 0x7FFFFFFF, -1, 255)),
        (127245, struct.pack("<BBhhH", 0, 0xF8, 1000, 0x7FFF, 0xFFFF)),
        (127245, struct.pack("<BBhhH", 0, 0xF8, 1000, 30000, 0xFFFF)),
        (129025, b"\xff\xff\xff\x7f" * 2),
        (129026, b"\x00\xfc\xff\xff\xff\xff\xff\xff"),
        (130306, b"\x00\x64\x00\x10\x00\xf8\xff\xff"),
        (130306, b"\x00\xff\xff\x10\x00\xfa\xff\xff"),
    ],
)
def test_no_data_short_frames_and_impossible_values_are_no_samples(bus: Bus, group: int, data: bytes) -> None:
    bus.put(group, data)
    assert bus.samples(0.0) == []


def test_orders_leave_ten_times_a_second_and_end_with_releases(bus: Bus) -> None:
    orders = []
    for step in range(200):
        now = step * 0.01
        bus.link.send(now, RudderCommand(now, math.radians(-12.0), now < 1.0))
        bus.link.poll(now)
        orders += [data for group, source, data in bus.heard() if group == 127245 and source == 204]
    steered = [data for data in orders if data[1] & 7 == 2]
    assert len(steered) == pytest.approx(10, abs=1), "move to port"
    assert {struct.unpack_from("<h", data, 2)[0] for data in steered} == {round(math.radians(-12.0) * 1e4)}
    released = orders[len(steered) :]
    assert [(data[1] & 7, struct.unpack_from("<h", data, 2)[0]) for data in released] == [(0, 0x7FFF)] * 5


def test_the_heading_control_group_says_what_is_steered(bus: Bus) -> None:
    tick = Tick(
        number=0,
        now=1.0,
        samples=(),
        order=Order(OrderKind.HEADING, -0.5),
        state=NavState(1.0, 0.25, 0.0, 4.0, 0.0, 0.0, 0.1, True),
        reference=Reference(0.0),
        demand=0.0,
        command=RudderCommand(1.0, 0.2, True),
        mode=Mode.ENGAGED,
        alarms=(),
    )
    bus.link.publish_tick(tick)
    bus.link.publish_tick(tick._replace(now=1.1))
    frames = [data for group, _, data in bus.heard() if group == 127237]
    assert len(frames) == 4, "21 bytes in four frames, once in 250 ms"
    assert frames[0][1] == 21
    payload = frames[0][2:] + b"".join(data[1:] for data in frames[1:])
    assert payload[1] & 0x07 == 4, "heading control"
    rudder, course = struct.unpack_from("<hH", payload, 3)
    assert (rudder, course) == (2000, round((math.tau - 0.5) * 1e4))
    assert struct.unpack_from("<H", payload, 19)[0] == 2500


def test_who_only_listens_claims_no_address() -> None:
    bus = Bus("listens", steers=False)
    bus.far.send(can.Message(arbitration_id=identifier(59904, 35, 6, 255), data=b"\x00\xee\x00", is_extended_id=True))
    bus.link.receive(0.1)
    bus.link.send(0.1, RudderCommand(0.1, 0.2, True))
    assert (bus.claim, bus.heard()) == ([], [])
    bus.link.close()
    bus.far.shutdown()


def test_a_rudder_that_does_not_follow_on_the_bus_gives_the_helm_up(bus: Bus) -> None:
    helm = []
    for step in range(50):
        now = step * 0.1
        bus.put(127245, struct.pack("<BBhhH", 0, 0xF8, 0x7FFF, 0, 0xFFFF))
        helm += [sample for sample in bus.link.receive(now) if isinstance(sample, HelmSample)]
        bus.link.send(now, RudderCommand(now, 0.3, True))
    assert [sample.available for sample in helm] == [True, False]
    assert "the rudder does not follow: N2K127245.35 shows 0.0 deg while 17.2 deg" in helm[-1].reason


def test_a_drive_on_the_bus_obeys_our_frames(bus: Bus) -> None:
    """The other side reads the order's bytes itself, moves a rudder and reports its position."""
    gear = SteeringGear(math.radians(30.0), math.radians(20.0), 0.1, 0.0, 0.0)
    rudder, order = 0.0, 0.0
    for step in range(300):
        now = step * 0.02
        for group, source, data in bus.heard():
            if group == 127245 and source == 204:
                order = struct.unpack_from("<h", data, 2)[0] * 1e-4 if data[1] & 7 else 0.0
        rudder = gear_step(gear, rudder, order, 0.02)
        bus.put(127245, struct.pack("<BBhhH", 0, 0xF8, 0x7FFF, round(rudder * 1e4), 0xFFFF))
        seen = [s for s in bus.link.receive(now) if isinstance(s, RudderSample | HelmSample)]
        bus.link.send(now, RudderCommand(now, 0.2, True))
        bus.link.poll(now)
    assert rudder == pytest.approx(0.2, abs=0.002)
    assert all(isinstance(sample, RudderSample) for sample in seen)


GROUPS = st.sampled_from([127250, 127251, 127245, 127237, 60928, 59904])


@given(st.lists(st.tuples(GROUPS, st.binary(max_size=8)), max_size=20))
@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
def test_any_frames_are_survived_and_give_only_what_can_be(bus: Bus, frames: list[tuple[int, bytes]]) -> None:
    for group, data in frames:
        bus.put(group, data)
    for sample in bus.samples(0.0):
        if isinstance(sample, HeadingSample):
            assert -math.pi <= sample.heading <= math.pi
        elif isinstance(sample, RudderSample):
            assert abs(sample.angle) <= 0.5 * math.pi
        elif isinstance(sample, RateSample):
            assert abs(sample.rate) <= 10.0
    bus.heard()


def test_the_url_builds_the_link() -> None:
    link = build_link(load_vessel("lanxin"), "n2k:virtual:built?steer=no", LinkOptions())
    assert isinstance(link, N2kLink)
    link.send(0.0, RudderCommand(0.0, 0.2, True))
    link.poll(0.0)
    assert link.fileno() == -1
    link.release(0.0)
    link.close()
    assert parse_url("n2k:slcan:/dev/ttyACM0").path == "/dev/ttyACM0"


def test_no_bus_and_no_package_are_one_sentence_each(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(
        LinkError, match=r"link 'n2k:nosuch:can0': the CAN bus cannot be opened: .* is one of .*socketcan"
    ):
        open_bus("n2k:nosuch:can0", "nosuch", "can0")
    with pytest.raises(InputError, match="incomplete; write it like n2k:socketcan:can0"):
        parse_url("n2k:socketcan:")
    real = builtins.__import__

    def missing(name: str, *rest: Any, **more: Any) -> Any:
        if name.split(".")[0] == "can":
            raise ImportError(name)
        return real(name, *rest, **more)

    monkeypatch.setattr(builtins, "__import__", missing)
    with pytest.raises(LinkError, match=r"needs the package python-can; install .* pip install '\.\[n2k\]'"):
        build_link(load_vessel("lanxin"), "n2k:socketcan:can0", LinkOptions())


@pytest.mark.parametrize(
    ("group", "source", "priority", "destination", "identity"),
    [
        (127250, 35, 2, 255, 0x09F11223),
        (127245, 204, 2, 255, 0x09F10DCC),
        (60928, 204, 6, 255, 0x18EEFFCC),
        (59904, 35, 6, 204, 0x18EACC23),
        (61440, 1, 7, 9, 0x1CF00001),
        (61184, 1, 0, 9, 0x00EF0901),
    ],
)
def test_can_identifiers_are_those_worked_out_by_hand(
    group: int, source: int, priority: int, destination: int, identity: int
) -> None:
    assert identifier(group, source, priority, destination) == identity
    assert group_and_source(identity) == (group, source)


@pytest.mark.parametrize(
    ("group", "fields", "value"),
    [
        (127250, {"heading": 0.0, "reference": "True"}, 0.0),
        (127250, {"heading": math.tau, "reference": "True"}, 0.0),
        (127250, {"heading": 6.2832, "reference": "True"}, None),
        (127250, {"heading": -0.001, "reference": "True"}, None),
        (127250, {"heading": 1.0, "reference": "Magnetic", "variation": math.pi}, 1.0 - math.pi),
        (127250, {"heading": 1.0, "reference": "Magnetic", "variation": 3.15}, 1.25),
        (127250, {"heading": 1.0, "reference": "Magnetic", "deviation": -1.57}, -0.32),
        (127250, {"heading": 1.0, "reference": "Magnetic", "deviation": -1.58}, 1.25),
        (127250, {"heading": True, "reference": "True"}, None),
        (127250, {"heading": "1", "reference": "True"}, None),
        (127251, {"rate": -10.0}, -10.0),
        (127251, {"rate": 10.01}, None),
        (127251, {"rate": math.nan}, None),
        (127245, {"position": math.pi / 2}, math.pi / 2),
        (127245, {"position": -1.571}, None),
        (127237, {"heading": 1.0}, None),
    ],
)
def test_a_value_is_taken_up_to_its_limit(group: int, fields: dict[str, object], value: float | None) -> None:
    sample = sample_of(group, 3.0, fields, Compass(0.25), "s")
    assert (sample is None) is (value is None)
    if sample is not None and value is not None:
        assert sample[:2] == (3.0, pytest.approx(value, abs=1e-9))


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_the_order_s_direction_is_its_side(bus: Bus, side: float) -> None:
    bus.link.send(0.0, RudderCommand(0.0, side * 0.25, True))
    bus.link.release(0.1)
    orders = [data for group, _, data in bus.heard() if group == 127245]
    assert [(data[0], data[1] & 7, struct.unpack_from("<h", data, 2)[0]) for data in orders] == [
        (0, 1 if side > 0 else 2, round(side * 2500)),
        *[(0, 0, 0x7FFF)] * 5,
    ]
    assert bus.link.release_result(0.3) is None
    assert "released" in bus.link.release_result(0.5).sentence  # type: ignore[union-attr]


def control(bus: Bus, tick: Tick) -> bytes:
    bus.link.publish_tick(tick)
    frames = [data for group, _, data in bus.heard() if group == 127237]
    return frames[0][2:] + b"".join(data[1:] for data in frames[1:]) if frames else b""


def test_heading_control_leaves_four_times_a_second_and_says_who_steers_by_what(bus: Bus) -> None:
    state = NavState(1.0, -0.25, 0.0, 4.0, 0.0, 0.0, 0.1, True)
    order, command = Order(OrderKind.HEADING, 0.5), RudderCommand(1.0, 0.2, True)
    tick = Tick(0, 1.0, (), order, state, Reference(0.0), 0.0, command, Mode.ENGAGED, ())
    times = [step for step in range(64) if control(bus, tick._replace(now=1.0 + step / 64.0))]
    assert times == [0, 16, 32, 48]
    by_rudder = control(bus, tick._replace(now=5.0, order=Order(OrderKind.RUDDER)))
    assert by_rudder[1] & 7 != 4 and struct.unpack_from("<hH", by_rudder, 3) == (2000, 0xFFFF)
    by_hand = control(bus, tick._replace(now=6.0, mode=Mode.STANDBY))
    assert by_hand[1] & 7 != 4 and struct.unpack_from("<hH", by_hand, 3) == (0x7FFF, 0xFFFF)
    assert struct.unpack_from("<H", by_hand, 19)[0] == round((math.tau - 0.25) * 1e4)
    assert control(bus, tick._replace(now=7.0, state=state._replace(valid=False))) == b""


@pytest.mark.parametrize("kind", [{"is_extended_id": False}, {"is_error_frame": True}, {"is_remote_frame": True}])
def test_no_other_frames_than_data_with_long_identifiers_are_read(bus: Bus, kind: dict[str, bool]) -> None:
    identity = identifier(127250, 35, 2)
    bus.far.send(can.Message(**{"arbitration_id": identity, "data": heading(1.0), "is_extended_id": True, **kind}))
    assert bus.samples(0.0) == []
    bus.far.send(can.Message(arbitration_id=identity, data=heading(1.0), is_extended_id=True))
    assert len(bus.samples(0.1)) == 1


@pytest.mark.parametrize("error", [can.CanError("full"), OSError("no buffer space"), ValueError("the driver's own")])
def test_bus_write_errors_are_counted_and_read_errors_end_the_link(bus: Bus, error: Exception) -> None:
    def fail(*_: Any, **__: Any) -> None:
        raise error

    bus.line._bus.send = bus.line._bus.recv = fail
    for step in range(3):
        bus.link.send(step * 1.0, RudderCommand(step * 1.0, 0.1, True))
    assert bus.line.unsent == 3
    with pytest.raises(LinkError, match="the CAN bus is gone"):
        bus.link.receive(3.0)
