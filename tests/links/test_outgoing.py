"""What leaves over a link that is passed on to: how often each stream, whose messages, and what a station may ask."""

from __future__ import annotations

import itertools
import random
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.errors import InputError
from autopilot.links.ground_station.access import AccessPolicy
from autopilot.links.mavlink.codec import MavlinkCodec
from autopilot.links.mavlink.frames import Address, instance_of
from autopilot.links.mavlink.router import (
    MOST_STREAMS,
    ForwardLink,
    OutgoingFilter,
    Router,
    asks_for_streams,
    budget_for,
    filter_of,
)
from autopilot.links.transports import loopback_pair
from autopilot.links.url import FORWARD_OPTIONS, parse_url
from autopilot.runtime.build_links import LinkOptions, build_links
from autopilot.vessel.file import load_vessel

ATTITUDE = dialect.MAVLink_attitude_message(1, 0.5, 0.0, 0.25, 0.0, 0.0, 0.0)
BEAT = dialect.MAVLink_heartbeat_message(11, 3, 0, 0, 4, 3)
TEXT = dialect.MAVLink_statustext_message(4, b"hello")
HUD = dialect.MAVLink_vfr_hud_message(1.0, 1.0, 0, 0, 0.0, 0.0)


def frame_of(message: Any, system: int = 1, component: int = 1, version_1: bool = False) -> bytes:
    return bytes(message.pack(dialect.MAVLink(None, system, component), force_mavlink1=version_1))


def of_url(options: str) -> OutgoingFilter:
    found = filter_of(parse_url(f"udpout:127.0.0.1:1?{options}", FORWARD_OPTIONS))
    assert found is not None
    return found


def passed(outgoing: OutgoingFilter, times: list[float], frame: bytes) -> list[float]:
    return [now for now in times if outgoing.passes(now, frame)]


@pytest.mark.parametrize("rate", [0.5, 2.0, 5.0, 20.0, 33.0])
@given(seed=st.integers(0, 1 << 30), jitter=st.sampled_from([0.0, 0.002, 0.008]))
@settings(max_examples=20)
def test_of_fifty_a_second_as_many_leave_as_the_rate_says(rate: float, seed: int, jitter: float) -> None:
    noise = random.Random(seed)
    times = [100.0 + 0.02 * number + noise.uniform(-jitter, jitter) for number in range(3000)]
    left = passed(of_url(f"rate=ATTITUDE:{rate:g}"), times, frame_of(ATTITUDE))
    assert abs(len(left) - 60.0 * rate) <= 2.0
    gaps = [later - earlier for earlier, later in itertools.pairwise(left[1:])]
    assert max(gaps) <= 1.0 / rate + 0.04, "they are spread evenly"


@given(st.lists(st.floats(-0.2, 0.2), min_size=200, max_size=200))
def test_a_stream_that_comes_at_its_rate_loses_nothing_to_jitter_of_a_fifth(late: list[float]) -> None:
    """Late by up to a fifth of a period, never later and later."""
    times = [0.5 * (number + share) for number, share in enumerate(late)]
    assert passed(of_url("rate=ATTITUDE:2"), times, frame_of(ATTITUDE)) == times


def test_every_sender_and_every_name_is_a_stream_of_its_own() -> None:
    outgoing = of_url("rate=ATTITUDE:1,NAMED_VALUE_FLOAT:1")
    assert outgoing.passes(0.0, frame_of(ATTITUDE)) and not outgoing.passes(0.1, frame_of(ATTITUDE))
    assert outgoing.passes(0.1, frame_of(ATTITUDE, 2))
    names = [dialect.MAVLink_named_value_float_message(5, name, 1.0) for name in (b"rudder", b"bias", b"rudder_dem")]
    assert [outgoing.passes(0.2, frame_of(name)) for name in names] == [True] * 3
    assert [outgoing.passes(0.3, frame_of(name)) for name in names] == [False] * 3


@pytest.mark.parametrize("version_1", [False, True])
def test_the_instance_is_read_where_it_stands(version_1: bool) -> None:
    name = dialect.MAVLink_named_value_float_message(5, b"rudder", 1.0)
    assert instance_of(frame_of(name, version_1=version_1)) == b"rudder"
    full = dialect.MAVLink_named_value_float_message(5, b"rudder_dem", 1.0)
    assert instance_of(frame_of(full, version_1=version_1)) == b"rudder_dem"
    batteries = [
        dialect.MAVLink_battery_status_message(number, 0, 0, 0, [0] * 10, 0, 0, 0, 50, 0, 0, [0] * 4)
        for number in (0, 1, 200)
    ]
    assert [instance_of(frame_of(battery, version_1=version_1)) for battery in batteries] == [b"", b"\1", b"\xc8"]
    assert instance_of(frame_of(ATTITUDE, version_1=version_1)) == b""


def test_others_are_streams_and_what_counts_singly_passes() -> None:
    outgoing = of_url("rate=ATTITUDE:2,others:0")
    parameter = dialect.MAVLink_param_value_message(b"RC1_TRIM", 1.0, 9, 100, 1)
    mission = dialect.MAVLink_mission_count_message(255, 190, 3, 0)
    for _ in range(5):
        assert all(outgoing.passes(0.0, frame_of(message)) for message in (BEAT, TEXT, parameter, mission))
        assert not outgoing.passes(0.0, frame_of(HUD))
    assert outgoing.passes(0.0, frame_of(ATTITUDE))
    assert not of_url("rate=HEARTBEAT:0").passes(0.0, frame_of(BEAT)), "by its name even this"
    assert not of_url("rate=30:0").passes(0.0, frame_of(ATTITUDE)), "a number is as good as a name"
    assert of_url("rate=VFR_HUD:0").passes(0.0, frame_of(ATTITUDE))


def test_whose_messages_leave() -> None:
    outgoing = of_url("from=1:191,2")
    who = [(1, 191), (1, 1), (2, 1), (2, 9), (3, 191)]
    assert [outgoing.passes(0.0, frame_of(ATTITUDE, *each)) for each in who] == [True, False, True, True, False]
    assert not outgoing.sets_rates
    assert filter_of(parse_url("udpout:127.0.0.1:1")) is None
    assert OutgoingFilter({}, sources=frozenset([Address(1, 1)])).passes(0.0, frame_of(ATTITUDE))


def test_a_flood_of_invented_streams_fills_no_memory() -> None:
    outgoing = of_url("rate=others:1")
    for system in range(1, 256):
        for component in range(1, 10):
            outgoing.passes(0.0, frame_of(ATTITUDE, system, component))
    assert len(outgoing._streams) == MOST_STREAMS


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ("rate=ATTITUDES:2", "there is no MAVLink message 'ATTITUDES'; write a name such as ATTITUDE"),
        ("rate=attitude:2", "there is no MAVLink message 'attitude'; write a name such as ATTITUDE"),
        ("rate=ATTITUDE", "'ATTITUDE' is no message with its rate, or is named twice"),
        ("rate=ATTITUDE:-1", "'ATTITUDE:-1' is no message with its rate"),
        ("rate=ATTITUDE:2000", "with 0 (never) or 0.01 to 1000 Hz"),
        ("rate=ATTITUDE:nan", "with 0 (never) or 0.01 to 1000 Hz"),
        ("rate=ATTITUDE:2,ATTITUDE:3", "is named twice"),
        ("rate=99999999:1", "there is no MAVLink message '99999999'"),
        ("from=0", "'0' is no sender"),
        ("from=1:", "'1:' is no sender"),
        ("from=1:256", "'1:256' is no sender"),
        ("from=1.5", "'1.5' is no sender"),
        ("speed=2", "allowed here, once each, are rate, from"),
    ],
)
def test_what_cannot_be_meant_is_refused_in_a_sentence(options: str, sentence: str) -> None:
    with pytest.raises(InputError) as error:
        build_links(
            load_vessel("lanxin"), ["udpin:127.0.0.1:0"], LinkOptions(forward=(f"udpout:127.0.0.1:1?{options}",))
        )
    assert sentence in str(error.value) and "\n" not in str(error.value)


def test_rates_are_for_what_is_passed_on_alone() -> None:
    with pytest.raises(InputError, match="unknown or repeated"):
        build_links(load_vessel("lanxin"), ["udpin:127.0.0.1:0?rate=ATTITUDE:2"])
    with pytest.raises(InputError, match="ground stations speak MAVLink"):
        options = LinkOptions(forward=("nmea-udpout:127.0.0.1:1?rate=ATTITUDE:2",))
        build_links(load_vessel("lanxin"), ["udpin:127.0.0.1:0"], options)


def interval() -> Any:
    return dialect.MAVLink_command_long_message(1, 1, dialect.MAV_CMD_SET_MESSAGE_INTERVAL, 0, 30, 500_000, *[0] * 5)


@pytest.mark.parametrize("has_rates", [True, False])
def test_behind_a_link_with_rates_nobody_changes_the_rates_of_our_own_line(has_rates: bool) -> None:
    router, (behind, station) = Router(), loopback_pair()
    sent: list[bytes] = []
    router.join(lambda frame: sent.append(frame) or True, has_vehicle=True)
    outgoing = of_url("rate=ATTITUDE:2" if has_rates else "from=1")
    access = AccessPolicy().link()
    link = ForwardLink(behind, router, budget_for(0), access=access, outgoing=outgoing)
    router.take(0, frame_of(BEAT))
    station.receive()
    codec = MavlinkCodec(255, 190)
    streams = dialect.MAVLink_request_data_stream_message(1, 1, 10, 2, 1)
    other = dialect.MAVLink_command_long_message(1, 1, dialect.MAV_CMD_REQUEST_MESSAGE, 0, 148, *[0] * 6)
    whole = dialect.MAVLink_command_int_message(
        1, 1, 0, dialect.MAV_CMD_SET_MESSAGE_INTERVAL, 0, 0, 30, 0, 0, 0, 0, 0, 0
    )
    frames = [codec.encode(message) for message in (interval(), streams, whole, other)]
    assert [asks_for_streams(frame) for frame in frames] == [True, True, True, False]
    for frame in frames:
        station.send(frame)
    link.receive(0.1)
    assert sent == (frames[3:] if has_rates else frames)
    assert len(link.take_packets()) == 4, "the log has them all"


def test_the_station_at_a_slow_link_gets_two_a_second_and_the_other_all() -> None:
    router = Router()
    slow: list[bytes] = []
    fast: list[bytes] = []
    router.join(lambda frame: True, has_vehicle=True)
    router.join(lambda frame: slow.append(frame) or True, outgoing=of_url("rate=ATTITUDE:2,others:1"))
    router.join(lambda frame: fast.append(frame) or True)
    for number in range(500):
        router.now = 0.02 * number
        router.take(0, frame_of(dialect.MAVLink_attitude_message(20 * number, 0.5, 0.0, 0.25, 0.0, 0.0, 0.0)))
    assert len(fast) == 500 and 20 <= len(slow) <= 21
    assert router.counts["held back by the filter of a link"] == 500 - len(slow)
