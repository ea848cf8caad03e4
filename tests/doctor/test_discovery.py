"""What sends here is found by its own bytes, at the rate at which they mean something."""

from __future__ import annotations

import socket
import threading
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect
from two_processes import free_port

from autopilot.doctor.vehicle import candidates, discover, listened, sender_of
from autopilot.links.mavlink.codec import MavlinkCodec

COMPASS = b"$HCHDG,101.1,,,7.1,W*3C\r\n$TIROT,1.0,A*30\r\n" * 3
SPEED = b"$VWVHW,,T,,M,5.0,N,,K*53\r\n" * 3


def attitude() -> bytes:
    codec = MavlinkCodec(1, 1)
    message = dialect.MAVLink_attitude_message(0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    return b"".join(codec.encode(message) for _ in range(3))


def test_serial_lines_are_tried_at_the_usual_rates() -> None:
    tried = candidates([Path("/dev/ttyUSB0")])
    assert tried[2:] == [
        "serial:/dev/ttyUSB0:115200",
        "serial:/dev/ttyUSB0:57600",
        "nmea:/dev/ttyUSB0:4800",
        "nmea:/dev/ttyUSB0:38400",
    ]
    assert all("127.0.0.1" in url for url in tried[:2])


def test_a_compass_is_found_with_its_sentences() -> None:
    found = sender_of("nmea:/dev/ttyUSB0:4800", COMPASS)
    assert found is not None and found.has_heading and found.names == ("HDG", "ROT")
    assert found.words == "nmea:/dev/ttyUSB0:4800: NMEA 0183 (HDG, ROT), with a heading"


def test_what_brings_no_heading_says_so() -> None:
    found = sender_of("nmea:/dev/ttyUSB0:4800", SPEED)
    assert found is not None and not found.has_heading and "NO heading" in found.words


@pytest.mark.parametrize("noise", [b"", b"\x00\xff" * 400, COMPASS[:5], bytes(range(256)) * 4])
def test_noise_is_nobody(noise: bytes) -> None:
    assert sender_of("nmea:/dev/ttyUSB0:38400", noise) is None
    assert sender_of("serial:/dev/ttyUSB0:57600", noise) is None


def test_a_device_that_was_understood_is_not_tried_again() -> None:
    tried: list[str] = []
    sends = {"serial:/dev/ttyUSB0:57600": attitude(), "nmea:/dev/ttyUSB1:4800": COMPASS}

    def listen(url: str) -> bytes:
        tried.append(url)
        return sends.get(url, b"")

    found = discover(candidates([Path("/dev/ttyUSB0"), Path("/dev/ttyUSB1")]), listen)
    assert [sender.url for sender in found] == list(sends)
    assert all(sender.has_heading for sender in found)
    assert "nmea:/dev/ttyUSB0:4800" not in tried and "nmea:/dev/ttyUSB1:38400" not in tried


def test_a_sender_on_the_loopback_is_heard() -> None:
    port = free_port()

    is_heard = threading.Event()

    def send() -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            while not is_heard.wait(0.02):
                sender.sendto(COMPASS, ("127.0.0.1", port))

    sending = threading.Thread(target=send, daemon=True)
    sending.start()
    came = listened(f"nmea-udp:127.0.0.1:{port}", 60.0)
    is_heard.set()
    sending.join()
    assert sender_of(f"nmea-udp:127.0.0.1:{port}", came) is not None


def test_a_line_that_is_not_there_says_nothing() -> None:
    assert listened("serial:/dev/nowhere:57600", 0.1) == b""
