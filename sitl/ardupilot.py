"""Serving the physics to ArduPilot's simulator over UDP, in lock-step with it.

The boat as the physics behind a real ArduRover: ArduPilot's JSON simulator interface, without sockets.

ArduPilot sends a servo packet for each of its frames and waits for one line of JSON: lock-step. Packet and reply
are those of libraries/SITL/SIM_JSON.h and SIM_JSON.cpp: little-endian uint16 magic (18458 with 16 channels, 29569 with
32), uint16 frame rate [Hz], uint32 frame count, uint16 pulses [us]; the reply is set between line feeds.
"""

from __future__ import annotations

import json
import math
import socket
import struct
import sys
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from autopilot.angles import wrap
from autopilot.errors import InputError
from autopilot.links.base import LinkError
from autopilot.links.transports.medium import is_everywhere
from autopilot.models.weather import GRAVITY
from autopilot.vessel.schema import Vessel
from sitl.boat import STILL, Boat, BoatState
from sitl.firmware_setup import SERVO_US, travel
from sitl.registry import kind_of
from sitl.scenario import Scenario
from sitl.sea import Sea
from sitl.world import STEP

CHANNELS_OF_MAGIC = {18458: 16, 29569: 32}
HEAD = struct.Struct("<HHI")
RATE_MAX_HZ = 20000
FINEST_STEP = 0.01
"""Slower frames than this [s] are taken in several steps of the physics."""
CRUISE_SHARE = 0.5
"""Throttle at which the boat runs at its cruise speed."""


class Outputs(NamedTuple):
    """Servo outputs, from 1, that steer and drive: SERVOn_FUNCTION 26 (GroundSteering) and 70 (Throttle)."""

    steering: int = 1
    throttle: int = 3


class ServoPacket(NamedTuple):
    """rate_hz: frames a second; frame: their count since ArduPilot started; pulses [us], 0 where none go out."""

    rate_hz: int
    frame: int
    pulses: tuple[int, ...]


def read_packet(data: bytes) -> ServoPacket | None:
    """Return the servo packet in a datagram, None where it is none."""
    if len(data) < HEAD.size:
        return None
    magic, rate_hz, frame = HEAD.unpack_from(data)
    channels = CHANNELS_OF_MAGIC.get(magic, 0)
    if not channels or len(data) != HEAD.size + 2 * channels or not 1 <= rate_hz <= RATE_MAX_HZ:
        return None
    return ServoPacket(rate_hz, frame, struct.unpack_from(f"<{channels}H", data, HEAD.size))


class ArdupilotPhysics:
    """The boat of a vessel file in the sea of a scenario, moved on by each new servo packet.

    Attributes:
        state, time: of the boat, since ArduPilot's (re)start.  frames, repeated, restarts, bad: packets by kind.
    """

    def __init__(
        self, vessel: Vessel, scenario: Scenario, seed: int | None = None, outputs: Outputs | None = None
    ) -> None:
        self._vessel, self._scenario = vessel, scenario
        self._seed = scenario.seed if seed is None else seed
        self._outputs = outputs or Outputs()
        full_deg = vessel.helm.rudder_at_full_pwm_deg or vessel.rudder.angle_max_deg
        self._rudder_at_full = math.radians(-full_deg if vessel.helm.reversed else full_deg)
        self._full_pulses = vessel.helm.servo_us or SERVO_US
        self._cruise_speed = vessel.model.reference_speed_m_s
        self.frames = self.repeated = self.restarts = self.bad = 0
        self._last: ServoPacket | None = None
        self._reply = b""
        self._begin()

    def _begin(self) -> None:
        kind = kind_of(self._scenario)
        plant, start = kind.of(self._vessel, self._scenario), self._scenario.start
        self._boat = Boat(plant, BoatState(heading=math.radians(start.heading_deg)), kind.step)
        self._sea = Sea(self._scenario, plant.hull, np.random.SeedSequence(self._seed), STEP)
        self._disturbance, self._sea_steps = STILL, 0
        self.time = 0.0

    @property
    def state(self) -> BoatState:
        """The boat as it is."""
        return self._boat.state

    def answer(self, data: bytes) -> bytes:
        """Return the reply to a datagram; b"" where it is no servo packet.

        A frame count that is repeated (ArduPilot asks again after a second without a reply) is answered as before
        and moves nothing; one that goes back is a restart, and the boat starts anew.
        """
        packet = read_packet(data)
        if packet is None:
            self.bad += 1
            return b""
        if self._last is not None and packet.frame == self._last.frame:
            self.repeated += 1
            return self._reply
        if self._last is not None and packet.frame < self._last.frame:
            self.restarts += 1
            self._begin()
        self._last = packet
        self.frames += 1
        self._advance(packet)
        return self._reply

    def _advance(self, packet: ServoPacket) -> None:
        period = 1.0 / packet.rate_hz
        steps = math.ceil(period / FINEST_STEP - 1.0e-9)
        before = self._boat.state
        for _ in range(steps):
            self._step(packet, period / steps)
        self._reply = _reply(self.time, before, self._boat.state, period)

    def _step(self, packet: ServoPacket, dt: float) -> None:
        # the sea has a grid of its own, whatever the frame rate
        while self._sea_steps * STEP <= self.time + 1.0e-9:
            self._disturbance = self._sea.step(self._sea_steps * STEP, self._boat.state)
            self._sea_steps += 1
        rudder = _share(packet, self._outputs.steering, self._full_pulses) * self._rudder_at_full
        speed = _share(packet, self._outputs.throttle, SERVO_US) / CRUISE_SHARE * self._cruise_speed
        self._boat.step(self.time, rudder, speed, self._disturbance, dt)
        self.time += dt


def _share(packet: ServoPacket, output: int, full: tuple[float, float, float]) -> float:
    """Return the share -1..1 of full travel that an output asks for; without pulses it rests."""
    pulse = packet.pulses[output - 1] if output <= len(packet.pulses) else 0
    return min(max(travel(full, pulse), -1.0), 1.0)


def _reply(time: float, before: BoatState, state: BoatState, period: float) -> bytes:
    """Return the state as ArduPilot reads it: SI, north-east-down, angles [rad], specific force in the body's axes."""
    north, east = (state.north_speed - before.north_speed) / period, (state.east_speed - before.east_speed) / period
    cosine, sine = math.cos(state.heading), math.sin(state.heading)
    across, down = east * cosine - north * sine, -GRAVITY
    roll_cosine, roll_sine = math.cos(state.roll), math.sin(state.roll)
    document = {
        "timestamp": round(time, 9),
        "imu": {
            "gyro": [state.roll_rate, state.rate * roll_sine, state.rate * roll_cosine],
            "accel_body": [
                north * cosine + east * sine,
                across * roll_cosine + down * roll_sine,
                down * roll_cosine - across * roll_sine,
            ],
        },
        "position": [state.north, state.east, 0.0],
        "attitude": [state.roll, 0.0, wrap(state.heading)],
        "velocity": [state.north_speed, state.east_speed, 0.0],
    }
    return b"\n" + json.dumps(document, separators=(",", ":")).encode() + b"\n"


DATAGRAM_LIMIT = 4096
WAIT_S = 0.2
"""How long a stop may have to wait for a packet."""


def open_socket(address: str) -> socket.socket:
    """Return a UDP socket listening at HOST:PORT. Raises InputError and LinkError."""
    host, _, digits = address.rpartition(":")
    port = int(digits) if digits.isascii() and digits.isdigit() and len(digits) <= 5 else -1
    if not host or not 0 <= port <= 65535:
        raise InputError(f"--listen {address}: write HOST:PORT, such as 127.0.0.1:9002.")
    line = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        line.bind((host, port))
    except OSError as error:
        line.close()
        raise LinkError(
            f"--listen {address}: cannot listen there: {error.strerror or error}; stop what uses the port, or choose "
            "another and give ArduPilot the same (--sim-port-out)"
        ) from error
    if is_everywhere(host):
        print(f"--listen {address} listens on every network of this machine; name one address instead", file=sys.stderr)
    line.settimeout(WAIT_S)
    return line


def serve_physics(
    line: socket.socket, physics: ArdupilotPhysics, duration: float | None, should_stop: Callable[[], bool]
) -> None:
    """Answer servo packets until `should_stop` or for `duration` simulated seconds; complain once of other packets."""
    while not should_stop() and (duration is None or physics.time < duration):
        try:
            data, sender = line.recvfrom(DATAGRAM_LIMIT)
        except (TimeoutError, ConnectionRefusedError):
            continue
        reply = physics.answer(data)
        if reply:
            line.sendto(reply, sender)
            if physics.frames == 1 and not physics.repeated:
                print(f"ArduPilot at {sender[0]}:{sender[1]} has connected", flush=True)
        elif physics.bad == 1:
            print(
                f"sitl: a datagram of {len(data)} bytes is no servo packet of ArduPilot; start ArduPilot with "
                "--model JSON:127.0.0.1",
                file=sys.stderr,
            )
