"""The NMEA link on a manual clock: sample times, rudder orders on a slow line, and the way out."""

from __future__ import annotations

import math
import os
import pty
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from autopilot.links.base import LinkError
from autopilot.links.nmea import sentences as encoders
from autopilot.links.nmea.link import NmeaLink, NmeaSettings
from autopilot.links.transports import loopback_pair
from autopilot.links.url import open_transport
from autopilot.signals import HeadingSample, HelmSample, PositionSample, RudderCommand, Sample, SpeedSample


def orders(transport) -> list[tuple[float, str]]:
    """Return (order [deg], status) of every ROR that has arrived."""
    found = []
    for data in transport.receive():
        for line in data.decode().split():
            fields = line.split("*")[0].split(",")
            assert fields[0] == "$AGROR"
            found.append((float(fields[1]), fields[2]))
    return found


def test_a_sample_is_as_old_as_its_first_byte() -> None:
    line = encoders.encode_hdt(1.0)
    near, far = loopback_pair()
    near.is_stream = True
    link = NmeaLink(near, NmeaSettings(baud=4800, heading_latency=0.1))
    far.send(line + line)
    headings = [sample for sample in link.receive(10.0) if isinstance(sample, HeadingSample)]
    seconds = len(line) * 10 / 4800.0
    assert [sample.time for sample in headings] == pytest.approx([10.0 - 2 * seconds - 0.1, 10.0 - seconds - 0.1])
    assert seconds == pytest.approx(0.0396, abs=0.0001), "19 characters at 480 a second"


def test_a_sentence_split_between_chunks_counts_from_its_beginning() -> None:
    line = encoders.encode_hdt(1.0)
    near, far = loopback_pair()
    near.is_stream = True
    link = NmeaLink(near, NmeaSettings(baud=4800))
    far.send(line[:5])
    far.send(line[5:])
    (heading,) = (sample for sample in link.receive(1.0) if isinstance(sample, HeadingSample))
    assert heading.time == pytest.approx(1.0 - len(line) * 10 / 4800.0)


def test_datagrams_need_no_line_end_and_do_not_run_together() -> None:
    near, far = loopback_pair()
    link = NmeaLink(near)
    far.send(encoders.encode_hdt(1.0).strip())
    far.send(b"$HEHDT,1")
    far.send(encoders.encode_hdt(0.5))
    headings = [sample.heading for sample in link.receive(0.0) if isinstance(sample, HeadingSample)]
    assert headings == pytest.approx([1.0, 0.5], abs=1e-3)


def test_the_helm_is_announced_once_and_only_where_a_drive_listens() -> None:
    near, _ = loopback_pair()
    link = NmeaLink(near)
    assert [type(sample) for sample in link.receive(0.0)] == [HelmSample]
    assert link.receive(0.1) == []
    assert NmeaLink(near, NmeaSettings(steers=False)).receive(0.0) == []


def test_on_a_slow_line_the_newest_command_wins() -> None:
    near, far = loopback_pair()
    link = NmeaLink(near, NmeaSettings(baud=4800))
    for step in range(100):
        now = step * 0.01
        link.send(now, RudderCommand(now, math.radians(step / 10.0), True))
        link.poll(now)
    got = orders(far)
    each = len(encoders.encode_ror(math.radians(5.0), True)) * 10 / 4800.0
    assert len(got) == pytest.approx(1.0 / each, abs=3), "no more than the line can carry"
    link.poll(1.2)
    assert orders(far)[-1] == (9.9, "A"), "what waited last leaves as soon as the line is free"


def test_release_says_status_v_several_times_and_then_nothing() -> None:
    near, far = loopback_pair()
    link = NmeaLink(near, NmeaSettings(baud=38400))
    link.send(0.0, RudderCommand(0.0, 0.2, False))
    assert orders(far) == [], "what was never taken is not given back"
    link.send(0.1, RudderCommand(0.1, 0.2, True))
    for step in range(20, 120):
        link.send(step * 0.02, RudderCommand(0.0, 0.2, False))
        link.poll(step * 0.02)
    assert orders(far) == [(11.46, "A")] + [(0.0, "V")] * 5


def test_a_command_that_is_no_number_is_a_release() -> None:
    near, far = loopback_pair()
    link = NmeaLink(near)
    link.send(0.0, RudderCommand(0.0, 0.2, True))
    link.send(1.0, RudderCommand(1.0, math.nan, True))
    assert [status for _, status in orders(far)] == ["A", "V"]


def test_a_command_is_repeated_for_a_while_only() -> None:
    near, far = loopback_pair()
    link = NmeaLink(near)
    link.send(0.0, RudderCommand(0.0, 0.1, True))
    for step in range(1, 60):
        link.poll(step * 0.1)
    assert 2 <= len(orders(far)) <= 4


def test_the_way_out_never_raises() -> None:
    near, far = loopback_pair()
    link = NmeaLink(near)
    link.send(0.0, RudderCommand(0.0, 0.2, True))
    orders(far)
    link.release(0.1)
    assert set(orders(far)) == {(0.0, "V")}
    link.send(0.2, RudderCommand(0.2, 0.2, True))
    far.close()
    link.release(0.3)


def test_a_real_pseudo_terminal_both_ways_and_unplugged() -> None:
    master, slave = pty.openpty()
    link = NmeaLink(open_transport(f"nmea:{os.ttyname(slave)}:4800"), NmeaSettings(baud=4800))
    os.close(slave)
    os.write(master, encoders.encode_hdg(1.0, 0.0, 0.0))
    headings = [sample for sample in link.receive(1.0) if isinstance(sample, HeadingSample)]
    assert headings[0].heading == pytest.approx(1.0, abs=1e-3)
    link.send(1.0, RudderCommand(1.0, math.radians(3.0), True))
    assert os.read(master, 100).startswith(b"$AGROR,3.00,A,,V,B*")
    os.close(master)
    with pytest.raises(LinkError, match="unplugged"):
        link.receive(2.0)
    link.release(2.0)
    link.close()


def test_each_sentence_is_counted_as_read_ignored_invalid_or_damaged() -> None:
    near, far = loopback_pair()
    link = NmeaLink(near)
    far.send(b"$HEHDT,41.87,T*25\r\n$HEHDT,400.0,T*15\r\n$GPGSV,1,1,00*79\r\n")
    far.send(b"$HEHDT,400.0,T*" + b"%02X\r\n" % 0x2B)
    link.receive(0.0)
    counts = link.session.counts
    assert counts.sentences == 3 - (counts.checksum_errors - 1)
    assert counts.ignored == 1
    assert counts.checksum_errors + counts.malformed == 2


def read_rmc(place: str) -> list[Sample]:
    near, far = loopback_pair()
    body = f"GPRMC,120000,A,{place},5.0,90.0,010126,,,A"
    checksum = 0
    for character in body:
        checksum ^= ord(character)
    far.send(f"${body}*{checksum:02X}\r\n".encode())
    return [sample for sample in NmeaLink(near).receive(0.0) if isinstance(sample, PositionSample | SpeedSample)]


@given(st.floats(-90.0, 90.0), st.floats(-180.0, 180.0))
def test_rmc_gives_position_and_speed(latitude_deg: float, longitude_deg: float) -> None:
    near, far = loopback_pair()
    far.send(encoders.encode_rmc(1.0, 3.0, latitude_deg, longitude_deg))
    samples = NmeaLink(near).receive(0.0)
    (position,) = (sample for sample in samples if isinstance(sample, PositionSample))
    (speed,) = (sample for sample in samples if isinstance(sample, SpeedSample))
    assert math.degrees(position.latitude) == pytest.approx(latitude_deg, abs=2e-6)
    assert math.degrees(position.longitude) == pytest.approx(longitude_deg, abs=2e-6)
    assert (position.source, speed.source) == ("GPRMC", "GPRMC")
    assert speed.speed == pytest.approx(3.0, abs=0.01)


@pytest.mark.parametrize(
    "place",
    ["5960.0,N,01800.0,E", "5900.0,X,01800.0,E", "9001.0,N,01800.0,E", "59x0.0,N,01800.0,E", "5900.0,N,1800.0,E"],
)
def test_a_position_that_cannot_be_voids_its_sentence(place: str) -> None:
    assert read_rmc(place) == []


def test_rmc_without_a_position_still_gives_the_speed() -> None:
    assert [type(sample) for sample in read_rmc(",,,")] == [SpeedSample]
    assert [type(sample) for sample in read_rmc("5900.0,N,01800.0,E")] == [SpeedSample, PositionSample]


def left(link: NmeaLink, far, until: float, since: float, step: float = 0.01) -> list[float]:
    """Return when an order leaves while the link is only kept."""
    times = []
    for number in range(round((until - since) / step)):
        now = since + step * number + 1e-6
        link.poll(now)
        times += [round(now, 2)] * len(orders(far))
    return times


def spaces(times: list[float]) -> list[float]:
    return [round(after - before, 2) for before, after in pairwise(times)]


def test_an_order_is_repeated_each_half_second_and_not_after_the_first() -> None:
    near, far = loopback_pair()
    link = NmeaLink(near)
    link.send(10.0, RudderCommand(10.0, 0.1, True))
    assert len(orders(far)) == 1
    times = left(link, far, 15.0, 10.0)
    assert times[0] in (10.5, 10.51) and len(times) in (1, 2) and times[-1] <= 11.01


def test_releases_are_a_tenth_of_a_second_apart_and_the_first_at_once() -> None:
    near, far = loopback_pair()
    link = NmeaLink(near)
    link.send(10.0, RudderCommand(10.0, 0.1, True))
    link.send(10.02, RudderCommand(10.02, 0.1, False))
    assert [status for _, status in orders(far)] == ["A", "V"]
    times = left(link, far, 15.0, 10.02)
    assert len(times) == 4 and set(spaces([10.02, *times])) <= {0.1, 0.11}


@pytest.mark.parametrize("steps", [0, 1, 3, 8])
def test_the_way_out_sends_the_releases_that_are_left_and_one_at_least(steps: int) -> None:
    near, far = loopback_pair()
    link = NmeaLink(near)
    link.release(0.0)
    assert orders(far) == []
    link.send(10.0, RudderCommand(10.0, 0.1, True))
    for step in range(steps):
        link.send(10.2 + 0.2 * step, RudderCommand(0.0, 0.1, False))
    orders(far)
    link.release(20.0)
    assert [status for _, status in orders(far)] == ["V"] * max(5 - steps, 0)
    assert (link.release_result(20.2) is None) is (steps < 5), "it leaves"
    assert "released" in link.release_result(20.4).sentence  # type: ignore[union-attr]


def test_a_link_without_a_drive_sends_no_order_ever() -> None:
    near, far = loopback_pair()
    link = NmeaLink(near, NmeaSettings(steers=False))
    link.send(0.0, RudderCommand(0.0, 0.1, True))
    link.send(0.1, RudderCommand(0.1, 0.1, False))
    assert left(link, far, 3.0, 0.0) == []
    link.release(3.0)
    assert orders(far) == [] and link.release_result(3.0).sentence == "rudder not held"  # type: ignore[union-attr]


def test_a_peer_silent_for_five_seconds_is_let_go_of_and_noise_is_no_word() -> None:
    near, far = loopback_pair()
    forgotten: list[float] = []
    link = NmeaLink(near)
    link.receive(0.0)
    near.forget_peer = lambda: forgotten.append(now)  # type: ignore[method-assign]
    for step in range(200):
        now = 0.1 * step
        if step == 20:
            far.send(encoders.encode_hdt(1.0))
        if step > 40:
            far.send(b"noise\r\n")
        link.receive(now)
    assert forgotten == pytest.approx([7.1, 12.2, 17.3], abs=0.11)


def test_twelve_repeated_sentences_wait_for_a_slow_line_and_the_oldest_are_left_out() -> None:
    near, far = loopback_pair()
    link = NmeaLink(near, NmeaSettings(baud=4800, steers=False))
    link.session._repeated.extend(b"$%02d\r\n" % number for number in range(20))
    for step in range(100):
        link.poll(0.1 * step)
    assert [int(data[1:3]) for data in far.receive()] == list(range(8, 20))


def test_a_line_is_busy_for_ten_bits_a_byte() -> None:
    near, far = loopback_pair()
    link = NmeaLink(near, NmeaSettings(baud=4800, steers=False))
    link.session._repeated.extend([b"$" + b"x" * 45 + b"\r\n"] * 3)
    times = []
    for step in range(50):
        link.poll(0.01 * step + 1e-6)
        times += [step] * len(far.receive())
    assert times == [0, 10, 20], "48 bytes at 480 a second"


def test_on_a_full_line_a_repeated_sentence_leaves_after_three_orders() -> None:
    near, far = loopback_pair()
    link = NmeaLink(near, NmeaSettings(baud=4800))
    link.session._repeated.extend([b"$R\r\n"] * 9)
    for step in range(100):
        link.send(0.01 * step, RudderCommand(0.01 * step, 0.1, True))
        link.poll(0.01 * step)
    left = "".join("R" if data == b"$R\r\n" else "o" for data in far.receive())
    assert left.startswith("oooRoooRoooR")


def test_times_of_the_line_to_the_bit() -> None:
    """A release 0.1 s after the one before, a repetition after 0.5 s for 1 s, a peer let go of after more than 5 s."""
    near, far = loopback_pair()
    link = NmeaLink(near)
    forgotten: list[float] = []
    near.forget_peer = lambda: forgotten.append(now)  # type: ignore[method-assign]
    for now in (0.0, 5.0, 5.001):
        link.receive(now)
    assert forgotten == [0.0, 5.001]
    for since, kept, leaves in ((10.0, (10.499, 10.5, 11.0), [0, 1, 1]), (20.0, (20.6, 21.001), [1, 0])):
        link.send(since, RudderCommand(since, 0.1, True))
        orders(far)
        for now, count in zip(kept, leaves, strict=True):
            link.poll(now)
            assert len(orders(far)) == count, now
    link.send(-0.5, RudderCommand(-0.5, 0.1, False))
    link = NmeaLink(near)
    link.send(-1.0, RudderCommand(-1.0, 0.1, True))
    for now, count in ((0.0, 2), (0.0999, 0), (0.1, 1)):
        link.send(now, RudderCommand(now, 0.1, False))
        assert len(orders(far)) == count, now
