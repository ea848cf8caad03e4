"""The physics behind ArduPilot's JSON interface, against a client written from SIM_JSON.cpp's side of the wire."""

from __future__ import annotations

import json
import math
import socket
import struct
import subprocess
import sys
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from autopilot.models.norrbin import at_speed, steady_rate
from autopilot.vessel.file import load_vessel
from sitl.ardupilot import ArdupilotPhysics, read_packet
from sitl.boat import plant_of
from sitl.scenario import load_scenario

LANXIN = load_vessel("lanxin")


def packet(frame: int, steering: int = 1500, throttle: int = 1500, rate_hz: int = 400, channels: int = 16) -> bytes:
    pulses = [0] * channels
    pulses[0], pulses[2] = steering, throttle
    magic = {16: 18458, 32: 29569}[channels]
    return struct.pack(f"<HHI{channels}H", magic, rate_hz, frame, *pulses)


def read(reply: bytes) -> dict[str, Any]:
    """ArduPilot looks for the text between two line feeds."""
    assert reply[:1] == b"\n" and reply[-1:] == b"\n" and reply.count(b"\n") == 2
    document: dict[str, Any] = json.loads(reply)
    return document


def physics(scenario: str = "calm") -> ArdupilotPhysics:
    return ArdupilotPhysics(LANXIN, load_scenario(scenario))


@pytest.mark.parametrize("channels", [16, 32])
@pytest.mark.parametrize("rate_hz", [30, 50, 400, 1200])
def test_half_throttle_is_the_cruise_speed_and_time_goes_with_the_frames(channels: int, rate_hz: int) -> None:
    boat, last = physics(), {}
    for frame in range(30 * rate_hz if rate_hz < 400 else 12 * rate_hz):
        last = read(boat.answer(packet(frame, throttle=1750, rate_hz=rate_hz, channels=channels)))
    assert last["timestamp"] == pytest.approx(boat.frames / rate_hz)
    settled = 1.0 - math.exp(-last["timestamp"] / load_scenario("calm").hull.speed_time_s)
    assert math.hypot(*last["velocity"][:2]) == pytest.approx(LANXIN.model.reference_speed_m_s * settled, rel=0.01)
    assert last["velocity"][2] == last["position"][2] == 0.0


def test_full_starboard_turns_to_starboard_at_the_model_s_rate() -> None:
    boat = physics()
    for frame in range(40 * 100):
        last = read(boat.answer(packet(frame, 2000, 1750, rate_hz=100)))
    model = plant_of(LANXIN, load_scenario("calm")).model
    speed = boat.state.speed
    full = math.radians(LANXIN.helm.rudder_at_full_pwm_deg or LANXIN.rudder.angle_max_deg)
    assert boat.state.rate == pytest.approx(steady_rate(at_speed(model, speed), full), rel=0.01)
    assert last["imu"]["gyro"][2] == pytest.approx(boat.state.rate, rel=0.05)
    # heeling outwards in the turn, and pressed outwards: to port
    assert last["attitude"][0] < 0.0


@pytest.mark.parametrize(("pulses", "share"), [((1000.0, 1500.0, 2000.0), 0.8), ((1100.0, 1500.0, 1900.0), 1.0)])
def test_a_pulse_is_as_much_rudder_as_the_vessel_file_says(pulses: tuple[float, float, float], share: float) -> None:
    vessel = replace(LANXIN, helm=replace(LANXIN.helm, servo_us=pulses))
    boat = ArdupilotPhysics(vessel, load_scenario("calm"))
    for frame in range(3 * 100):
        boat.answer(packet(frame, 1900, 1750, rate_hz=100))
    assert math.degrees(boat.state.rudder) == pytest.approx(share * 30.0, abs=0.1)


def test_at_rest_only_gravity_is_felt() -> None:
    last = read(physics().answer(packet(0)))
    assert last["imu"]["accel_body"] == pytest.approx([0.0, 0.0, -9.80665], abs=1e-3)
    assert last["imu"]["gyro"] == [0.0, 0.0, 0.0]


def test_position_and_accelerometers_integrate_to_the_velocity() -> None:
    boat, rate_hz = physics("ittc"), 400
    before = read(boat.answer(packet(0, rate_hz=rate_hz)))
    north, east = before["position"][:2]
    speed_north, speed_east = before["velocity"][:2]
    for frame in range(1, 8000):
        now = read(boat.answer(packet(frame, 1500 + int(300 * math.sin(frame / 900)), 1700, rate_hz=rate_hz)))
        ax, ay, az = now["imu"]["accel_body"]
        roll, _, yaw = now["attitude"]
        level_y = ay * math.cos(roll) - az * math.sin(roll)
        speed_north += (ax * math.cos(yaw) - level_y * math.sin(yaw)) / rate_hz
        speed_east += (ax * math.sin(yaw) + level_y * math.cos(yaw)) / rate_hz
        north += now["velocity"][0] / rate_hz
        east += now["velocity"][1] / rate_hz
    assert (speed_north, speed_east) == pytest.approx(tuple(now["velocity"][:2]), abs=1e-6)
    assert (north, east) == pytest.approx(tuple(now["position"][:2]), abs=0.05)


def test_a_repeated_frame_moves_nothing_and_a_restart_begins_anew() -> None:
    boat = physics()
    for frame in range(500):
        reply = boat.answer(packet(frame, 1700, 1800))
    assert boat.answer(packet(499, 1700, 1800)) == reply
    assert (boat.frames, boat.repeated, boat.restarts) == (500, 1, 0)
    again = read(boat.answer(packet(0, 1700, 1800)))
    assert boat.restarts == 1
    assert again["timestamp"] == pytest.approx(1 / 400)
    assert again == read(physics().answer(packet(0, 1700, 1800)))


def test_outputs_without_pulses_rest() -> None:
    boat = physics()
    for frame in range(400):
        boat.answer(packet(frame, 0, 0))
    assert (boat.state.rudder, boat.state.speed) == (0.0, 0.0)


@pytest.mark.parametrize(
    "wrong",
    [b"", b"\x1a", packet(1)[:-1], packet(1) + b"\0", struct.pack("<HHI16H", 18459, 400, 1, *[1500] * 16),
     struct.pack("<HHI16H", 18458, 0, 1, *[1500] * 16), struct.pack("<HHI16H", 29569, 400, 1, *[1500] * 16)],
)  # fmt: skip
def test_what_is_no_servo_packet_is_counted_and_moves_nothing(wrong: bytes) -> None:
    boat = physics()
    assert boat.answer(wrong) == b""
    assert (boat.bad, boat.frames, boat.time) == (1, 0, 0.0)


@given(st.lists(st.one_of(st.binary(max_size=80), st.builds(packet, st.integers(0, 5), st.integers(0, 65535)))))
def test_any_datagrams_leave_a_finite_boat(datagrams: list[bytes]) -> None:
    boat = physics()
    for data in datagrams:
        reply = boat.answer(data)
        assert bool(reply) == (read_packet(data) is not None)
        if reply:
            read(reply)
    assert all(map(math.isfinite, boat.state))


def test_the_physics_process_answers_servo_packets_over_udp() -> None:
    command = [sys.executable, "-m", "sitl", "ardupilot-physics", "lanxin", "--listen", "127.0.0.1:0"]
    with (
        subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as line,
    ):
        assert process.stdout is not None
        address = process.stdout.readline().split()[-1]
        line.connect(("127.0.0.1", int(address.rpartition(":")[2])))
        line.settimeout(60.0)
        line.send(b"hello")
        for frame in range(200):
            line.send(packet(frame, 1600, 1800))
            last = read(line.recv(4096))
        assert last["timestamp"] == pytest.approx(0.5)
        process.terminate()
        out, err = process.communicate(timeout=60)
    assert process.returncode == 0
    assert "200 frames, 0 repeated, 0 restarts, 1 datagrams" in out
    assert "--model JSON" in err and "Traceback" not in err
