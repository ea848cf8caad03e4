"""Decoding of NMEA 2000 without a bus, against the package nmea2000; fast packets with frames that are lost."""

from __future__ import annotations

import math
import random
from datetime import date, time

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

pytest.importorskip("nmea2000", reason="nmea2000 is not installed (extra n2k)")

from n2k_boat import Sent

from autopilot.links.n2k.packets import (
    FAST,
    LAYOUTS,
    FastPackets,
    Frame,
    Framing,
    Message,
    decoded,
    encoded,
    group_and_source,
)
from autopilot.links.n2k.samples import INSTRUMENTS, moment, rudder_order, sample_of
from autopilot.links.n2k.samples import Compass as Variation
from autopilot.signals import PositionSample, SpeedSample

ANGLE = st.floats(-3.14, 3.14)
BEARING = st.floats(0.0, 6.28)
SPEED = st.floats(0.0, 90.0)
FIELDS = {
    127250: {
        "heading": BEARING,
        "deviation": st.floats(-1.5, 1.5),
        "variation": ANGLE,
        "reference": st.sampled_from(["True", "Magnetic"]),
    },
    127251: {"rate": st.floats(-60.0, 60.0)},
    127245: {
        "instance": st.integers(0, 250),
        "directionOrder": st.sampled_from(["No Order", "Move to starboard", "Move to port"]),
        "angleOrder": ANGLE,
        "position": ANGLE,
    },
    127257: {"yaw": ANGLE, "pitch": ANGLE, "roll": ANGLE},
    127258: {"variation": ANGLE},
    128259: {"speedWaterReferenced": SPEED},
    129025: {"latitude": st.floats(-90.0, 90.0), "longitude": st.floats(-180.0, 180.0)},
    129026: {"cogReference": st.sampled_from(["True", "Magnetic"]), "cog": BEARING, "sog": SPEED},
    129029: {
        "latitude": st.floats(-90.0, 90.0),
        "longitude": st.floats(-180.0, 180.0),
        "method": st.sampled_from(["no GNSS", "GNSS fix", "DGNSS fix"]),
    },
    130306: {"windSpeed": SPEED, "windAngle": BEARING, "reference": st.just("Apparent")},
}
STEP = {"rate": 3.2e-8, "latitude": 1e-9, "longitude": 1e-9}


@pytest.mark.parametrize("group", FIELDS)
@settings(max_examples=25, deadline=None)
@given(data=st.data())
def test_what_the_package_encodes_is_decoded_by_ours(group: int, data: st.DataObject) -> None:
    """Each field may be absent; what the package leaves out is none to us."""
    chosen = data.draw(st.fixed_dictionaries({}, optional=FIELDS[group]))
    if not chosen:
        return
    found = decoded(group, Sent(0.0, group, 35, dict(chosen)).payload())
    assert set(found) == set(chosen)
    for name, value in chosen.items():
        if isinstance(value, float):
            value = math.radians(value) if name in ("latitude", "longitude") else value
            step = STEP.get(name, 0.011 if "peed" in name or name == "sog" else 1.01e-4)
            assert found[name] == pytest.approx(value, abs=step)
        else:
            assert found[name] == value


def test_every_group_that_is_read_is_tried() -> None:
    assert set(FIELDS) | {126992} == set(INSTRUMENTS)


def test_date_and_time_are_one_moment() -> None:
    fields = {"date": date(2024, 5, 4), "time": time(10, 15, 30, 250_000)}
    for group in (126992, 129029):
        found = decoded(group, Sent(0.0, group, 1, dict(fields)).payload())
        assert moment(found) == pytest.approx(1714817730.25, abs=1e-3)
    assert moment(decoded(126992, Sent(0.0, 126992, 1, {"time": time(1, 2, 3)}).payload())) is None
    unset = {"date": date(1970, 1, 1), "time": time(0, 2, 11)}
    assert moment(decoded(126992, Sent(0.0, 126992, 1, dict(unset)).payload())) is None, "no satellite yet"


@pytest.mark.parametrize("group", sorted(LAYOUTS))
@given(payload=st.binary(max_size=60))
@settings(max_examples=30, deadline=None)
def test_any_bytes_give_only_numbers_and_words(group: int, payload: bytes) -> None:
    for value in decoded(group, payload).values():
        assert isinstance(value, str) or math.isfinite(float(str(value)))
    assert decoded(group, b"") == {}
    assert decoded(130312, payload) == {}, "none of ours"


@pytest.mark.parametrize("group", sorted(LAYOUTS))
@settings(max_examples=60, deadline=None)
@given(data=st.data())
def test_what_is_encoded_is_decoded_and_the_rest_is_not_available(group: int, data: st.DataObject) -> None:
    chosen = {}
    for name, _, bits, unit, signed, words in LAYOUTS[group]:
        # 64 bits hold more digits than a float
        most = (1 << min(bits - signed, 62)) - 4
        low = -most - 4 if signed else 0
        value = st.sampled_from(words) if words else st.integers(low, most).map(lambda raw, unit=unit: raw * unit)
        if data.draw(st.booleans()):
            chosen[name] = data.draw(value)
    found = decoded(group, encoded(group, chosen))
    assert {name: value for name, value in found.items() if isinstance(value, str)} == {
        name: value for name, value in chosen.items() if isinstance(value, str)
    }
    assert found == pytest.approx(chosen, rel=1e-15) if not any(isinstance(v, str) for v in chosen.values()) else True
    assert set(found) == set(chosen)


@pytest.mark.parametrize(
    ("group", "fields", "said"),
    [
        (127245, {"angleOrder": 4.0}, "127245, angleOrder: 4.0 cannot be said"),
        (127245, {"angleOrder": math.nan}, "nan cannot be said"),
        (127237, {"steeringMode": "By hand"}, "'By hand' cannot be said"),
        (127237, {"headingToSteerCourse": -0.1}, "headingToSteerCourse"),
        (127237, {"heading": 0.1}, "group 127237 has no field 'heading'"),
    ],
)
def test_what_cannot_be_said_is_refused_by_name(group: int, fields: dict[str, object], said: str) -> None:
    with pytest.raises(ValueError, match=said):
        encoded(group, fields)


@pytest.mark.parametrize("group", sorted(LAYOUTS))
@pytest.mark.parametrize("below", [0, 1, 2])
def test_the_highest_numbers_of_every_field_are_no_data(group: int, below: int) -> None:
    whole = 0
    for _, start, bits, _, signed, words in LAYOUTS[group]:
        whole |= (1 << bits - signed) - 1 - (0 if words else below) << start
    assert decoded(group, whole.to_bytes(50, "little")) == {}


def test_errors_and_reserved_numbers_are_no_data_and_zero_is() -> None:
    for raw, has_heading in ((0xFFFC, True), (0xFFFD, False), (0xFFFE, False), (0xFFFF, False), (0, True)):
        data = bytes([1, *raw.to_bytes(2, "little"), 0xFF, 0x7F, 0xFF, 0x7F, 0xFC])
        assert ("heading" in decoded(127250, data)) is has_heading
    for raw, has_rate in ((0x7FFFFFFC, True), (0x7FFFFFFD, False), (0x7FFFFFFF, False), (0x80000000, True)):
        assert ("rate" in decoded(127251, bytes([1, *raw.to_bytes(4, "little")]))) is has_rate


def test_speeds_and_positions_are_samples() -> None:
    water = decoded(128259, bytes([1, 0x2C, 0x01, 0xFF, 0xFF, 0]))
    ground = decoded(129026, bytes([1, 0xFC, 0, 0, 0x2C, 0x01, 0xFF, 0xFF]))
    assert sample_of(128259, 1.0, water, Variation(), "a") == SpeedSample(1.0, 3.0, False, "a")
    assert sample_of(129026, 1.0, ground, Variation(), "a") == SpeedSample(1.0, 3.0, True, "a")
    place = decoded(129025, (576900000).to_bytes(4, "little") + (-118400000 & 0xFFFFFFFF).to_bytes(4, "little"))
    found = sample_of(129025, 1.0, place, Variation(), "a")
    assert found == PositionSample(1.0, pytest.approx(math.radians(57.69)), pytest.approx(math.radians(-11.84)), "a")
    assert sample_of(129029, 1.0, {**place, "method": "no GNSS"}, Variation(), "a") is None
    assert sample_of(129025, 1.0, {**place, "latitude": 2.0}, Variation(), "a") is None


def test_fast_packets_of_several_sources_and_groups_are_put_together() -> None:
    one, two = (Sent(0.0, 129029, source, {"latitude": lat, "longitude": 1.0}) for source, lat in ((7, 1.0), (8, 2.0)))
    packets, whole = FastPackets(), []
    for pair in zip(one.frames(), two.frames(), strict=True):
        for identity, data in pair:
            group, source = group_and_source(identity)
            if (found := packets.add(0.0, group, source, data)) is not None:
                whole.append((source, found[:43]))
    assert whole == [(7, one.payload()[:43]), (8, two.payload()[:43])]
    assert packets.lost == 0


def test_frames_that_come_by_two_ways_make_whole_packets() -> None:
    sent = Sent(0.0, 129029, 7, {"latitude": 1.0, "longitude": 1.0})
    packets = FastPackets()
    found = [packets.add(0.0, 129029, 7, data) for _, data in sent.frames() for _ in range(2)]
    assert [each[:43] for each in found if each is not None] == [sent.payload()[:43]]


@settings(max_examples=200, deadline=None)
@given(seed=st.integers(0, 1 << 30), share=st.floats(0.0, 0.6))
def test_a_packet_is_whole_or_none_whatever_frames_are_lost(seed: int, share: float) -> None:
    """The frames are split here by hand; sequence numbers go round, and some packets lose frames."""
    chance, packets = random.Random(seed), FastPackets()
    payloads, got, sound = [], [], 0
    for number in range(60):
        payload = bytes([number]) * chance.randrange(9, 223)
        payloads.append(payload)
        sequence = (number % 8) << 5
        frames = [bytes([sequence, len(payload)]) + payload[:6]]
        frames += [
            bytes([sequence | n + 1]) + payload[6 + 7 * n : 13 + 7 * n] for n in range((len(payload) - 6 + 6) // 7)
        ]
        kept = [frame for frame in frames if chance.random() >= share]
        sound += len(kept) == len(frames)
        got += [whole for f in kept if (whole := packets.add(0.25 * number, 129029, 7, f)) is not None]
    assert all(each in payloads for each in got)
    assert len(got) == sound


@given(st.lists(st.tuples(st.floats(0.0, 10.0), st.binary(max_size=8)), max_size=60))
@settings(deadline=None)
def test_any_frames_are_survived(frames: list[tuple[float, bytes]]) -> None:
    packets = FastPackets()
    for now, frame in frames:
        found = packets.add(now, 129029, 7, frame)
        assert found is None or len(found) <= 255
    assert packets.lost <= len(frames)


GROUPS_SENT = st.sampled_from([126208, 126996, 127237, 129284, 129285])


@settings(max_examples=200, deadline=None)
@given(
    packets=st.lists(st.tuples(GROUPS_SENT, st.integers(0, 251), st.binary(min_size=1, max_size=223)), max_size=12),
    seed=st.integers(0, 1 << 30),
    share=st.floats(0.0, 0.4),
)
def test_packets_interleaved_on_the_bus_come_out_whole_or_not_at_all(
    packets: list[tuple[int, int, bytes]], seed: int, share: float
) -> None:
    """Each sender counts its own sequences; their frames mix, and some are lost."""
    chance = random.Random(seed)
    senders: dict[int, Framing] = {}
    queues, sent, sound = [], [], 0
    for group, source, data in packets:
        framing = senders.setdefault(source, Framing(FAST, FAST))
        message = Message(group, data, source, 77 if group == 126208 else 255, 3)
        frames = framing.frames(message)
        sent.append(message)
        kept = [frame for frame in frames if chance.random() >= share]
        sound += len(kept) == len(frames)
        queues.append(kept)
    ours = Framing(FAST, FAST)
    got = []
    while any(queues):
        queue = chance.choice([each for each in queues if each])
        found = ours.take(0.0, queue.pop(0))
        got += [] if found is None else [found]
    keys = [(each.group, each.source) for each in sent]
    assert all(each in sent for each in got)
    if all(keys.count(key) <= 8 for key in keys):
        assert len(got) >= sound


def test_what_no_frame_can_hold_is_refused() -> None:
    framing = Framing(FAST, FAST)
    with pytest.raises(ValueError, match="group 127245: 9 bytes, a frame holds 8"):
        framing.frames(Message(127245, bytes(9)))
    with pytest.raises(ValueError, match="group 126996: 224 bytes, a fast packet holds 223"):
        framing.frames(Message(126996, bytes(224)))


def test_ever_new_packets_that_nobody_ends_take_no_more_room() -> None:
    packets = FastPackets()
    for source in range(251):
        for sequence in range(8):
            assert packets.add(0.0, 129029, source, bytes([sequence << 5, 43, 1, 2, 3, 4, 5, 6])) is None
    assert len(packets._begun) <= 64
    assert Framing(FAST, frozenset()).take(0.0, Frame(0x09F11223, bytes(8))) is None, "not a group that is read"


@pytest.mark.parametrize(
    ("direction", "angle", "order"),
    [
        ("Move to port", 0.2, -0.2),
        ("Move to port", -0.2, -0.2),
        ("Move to starboard", 0.2, 0.2),
        ("Move to starboard", -0.2, 0.2),
        ("No Order", 0.2, None),
        (None, -0.2, -0.2),
        ("Move to port", None, None),
    ],
)
def test_a_rudder_order_s_side_is_the_one_it_names(
    direction: str | None, angle: float | None, order: float | None
) -> None:
    assert rudder_order({"directionOrder": direction, "angleOrder": angle}) == order
