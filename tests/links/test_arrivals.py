"""What is said where no heading came: what did come, from where, and what to do."""

from __future__ import annotations

import os
import pty
import socket
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.cli.main import main
from autopilot.links.mavlink.codec import MavlinkCodec
from autopilot.links.transports import loopback_pair
from autopilot.links.url import SCHEMES, RecordingTransport, open_transport, sentence_names

KEPT_BYTES = 30_000


def mavlink(*messages: dialect.MAVLink_message) -> bytes:
    codec = MavlinkCodec(1, 1)
    return b"".join(codec.encode(message) for message in messages)


def heartbeat() -> dialect.MAVLink_message:
    return dialect.MAVLink_heartbeat_message(
        dialect.MAV_TYPE_SURFACE_BOAT, dialect.MAV_AUTOPILOT_ARDUPILOTMEGA, 0, 0, dialect.MAV_STATE_ACTIVE, 3
    )


def sentence(body: str) -> bytes:
    check = 0
    for each in body.encode():
        check ^= each
    return f"${body}*{check:02X}\r\n".encode()


GPS = dialect.MAVLink_gps_raw_int_message(0, 3, 0, 0, 0, 0, 0, 0, 0, 9)
WIND = sentence("WIMWV,45.0,R,5.0,N,A")
YDWG = b"17:33:21.107 R %s FF FF FF FF FF FF FF FF\r\n"


@pytest.fixture
def port() -> Iterator[tuple[int, socket.socket]]:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        number = probe.getsockname()[1]
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        sender.connect(("127.0.0.1", number))
        yield number, sender


@pytest.mark.parametrize(
    ("scheme", "data", "parts"),
    [
        ("udpin", b"", ["nothing came over udpin:127.0.0.1:", "check that the other side is on and sends here"]),
        (
            "udpin",
            mavlink(heartbeat(), GPS),
            ["MAVLink from 127.0", "(HEARTBEAT, GPS_RAW_INT)", "no ATTITUDE"],
        ),
        ("udpin", WIND, ["NMEA 0183 (MWV) came over", "from 127.0.0.1:", "write --link nmea-udp:127.0.0.1:"]),
        ("udpin", b"\x00\x01garbage" * 9, ["81 bytes that mean nothing came", "check which program sends there"]),
        ("nmea-udp", mavlink(heartbeat()), ["MAVLink (HEARTBEAT) came over", "write --link udpin:127.0.0.1:"]),
        ("nmea-udp", WIND + WIND, ["2 messages of NMEA 0183", "(MWV), no heading", "send HDG, HDM, HDT, THS"]),
        ("nmea-udp", sentence("HCHDM,90.0,M"), ["(HDM), no heading", "set sensors.variation_deg"]),
        ("n2k:ydwg-udp", YDWG % b"09F80203", ["1 messages of NMEA 2000", "(129026), no heading", "send 127250"]),
        ("n2k:ydwg-udp", YDWG % b"09F11223", ["(127250), no heading", "the GPS send 127258"]),
        ("n2k:ydwg-udp", WIND + WIND, ["NMEA 0183 (MWV) came over", "write --link nmea-udp:127.0.0.1:"]),
    ],
)
def test_what_arrived_over_udp_is_described_in_parts(
    port: tuple[int, socket.socket], scheme: str, data: bytes, parts: list[str]
) -> None:
    number, sender = port
    line = RecordingTransport(open_transport(f"{scheme}:127.0.0.1:{number}"), SCHEMES[scheme][0])
    if data:
        sender.send(data)
    time.sleep(0.05)
    line.receive()
    for part in parts:
        assert part in line.words
    assert not data or f"127.0.0.1:{sender.getsockname()[1]}" in line.words
    line.close()


@pytest.mark.parametrize(
    ("scheme", "data", "part"),
    [
        ("nmea", b"\xf0\x83\x00\xfe" * 50, "200 bytes that mean nothing came over {}: check the baud rate"),
        ("nmea", b"", "nothing came over {}: check that the other side is on and sends here, and the wiring"),
        ("serial", WIND * 3, "NMEA 0183 (MWV) came over {}: write --link nmea:"),
    ],
)
def test_over_a_serial_line(scheme: str, data: bytes, part: str) -> None:
    ours, theirs = pty.openpty()
    url = f"{scheme}:{os.ttyname(theirs)}:4800"
    line = RecordingTransport(open_transport(url), "mavlink" if scheme == "serial" else "nmea")
    os.write(ours, data)
    line.receive()
    assert part.format(url) in line.words
    line.close()
    os.close(ours)
    os.close(theirs)


def test_a_connection_has_no_baud_rate_and_no_wiring() -> None:
    near, far = loopback_pair()
    near.is_stream = True
    line = RecordingTransport(near, "nmea")
    assert "wiring" not in line.words
    far.send(b"\xf0\x83\x00\xfe" * 50)
    line.receive()
    assert "check which program sends there" in line.words


def test_no_more_than_a_beginning_is_kept() -> None:
    near, far = loopback_pair()
    line = RecordingTransport(near, "nmea")
    for _ in range(100):
        far.send(bytes(1000))
        assert line.receive() == [bytes(1000)]
    assert sum(map(len, line.kept)) <= KEPT_BYTES + 1000
    line.forget()
    far.send(b"more")
    line.receive()
    assert line.kept == []


def test_the_command_says_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", "lanxin", "--link", "udpin:127.0.0.1:0", "--wait", "0.3"]) == 3
    said = capsys.readouterr()
    assert "no heading came over udpin:127.0.0.1:0 in 0 s: nothing came over udpin:127.0.0.1:0: check" in said.err
    assert said.out.splitlines()[-1] == (
        "ended, the link does not bring what is needed: rudder not held; nothing was steered; no log was kept"
    )


@pytest.mark.parametrize(
    ("data", "names"),
    [
        (b"", {}),
        (b"$HEHDT,1.0,T*00\r\n", {"HDT": 1}),
        (b"$HEHDT,1.0,T*00\r\n$\xff\xfe", {}),
        (b"$HEHDT,1.0,T*00\r\n$HCHDM,1.0,M\r\n$\xff\xfe$", {"HDT": 1, "HDM": 1}),
        (b"$PHDT,1\r\n!AIVDM,1\r\n", {"HDT": 1, "VDM": 1}),
        (b"$hehdt,1\r\n$HEHD,1\r\n$HEHDTT,1\r\n", {}),
    ],
)
def test_one_sentence_is_text_where_nothing_else_begins_like_one_and_two_are_anyway(
    data: bytes, names: dict[str, int]
) -> None:
    assert dict(sentence_names(data)) == names


def test_eight_names_are_listed_the_commonest_first() -> None:
    near, far = loopback_pair()
    heard = RecordingTransport(near, "nmea")
    for number in range(9):
        far.send(b"".join(sentence(f"GPAA{chr(65 + number)},1") for _ in range(20 - number)))
    heard.receive()
    assert "(AAA, AAB, AAC, AAD, AAE, AAF, AAG, AAH, ...)" in heard.words
    assert heard.words.startswith(f"{sum(range(12, 21))} messages of NMEA 0183")
