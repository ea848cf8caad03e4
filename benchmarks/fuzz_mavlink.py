"""A million inputs for everything that reads MAVLink, and for ArduPilot's servo packets.

    python benchmarks/fuzz_mavlink.py [--inputs 1000000] [--seed 1] [--only NAME]

Each input is noise, sound frames cut, joined, doubled, with bytes changed, put in or taken out, or a forged frame: any
message with any payload and the right checksum. Counted are what was accepted; "strangers", accepted though nobody sent
it (a checksum of 16 bits lets one in 65536 damaged frames pass); "wrong", values that no reader may hand on. Exit code
1 at an exception, a wrong value, more than `HELD_MOST` bytes held between inputs, or memory that grows.
"""

from __future__ import annotations

import json
import math
import random
import sys
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

from fuzz_instruments import Fuzzer, Result, print_table
from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.guidance.plotter import PlotterGuide
from autopilot.guidance.track import TrackGuide
from autopilot.links.ground_station.boat_link import BoatLink
from autopilot.links.ground_station.commands import Commands
from autopilot.links.ground_station.mission import Mission
from autopilot.links.ground_station.station_service import ParameterServer
from autopilot.links.mavlink.authority import GUIDED_MODE, MANUAL_MODE
from autopilot.links.mavlink.codec import MavlinkCodec, message_id
from autopilot.links.mavlink.companion import CompanionLink
from autopilot.links.mavlink.requests import RELEVANT
from autopilot.links.mavlink.signing import CountingTimestamps, Signing
from autopilot.links.mavlink.vehicle import CompanionSettings
from autopilot.links.transports import LoopbackTransport, loopback_pair
from autopilot.operators.skipper import Skipper
from autopilot.runtime.build import build_pilot
from autopilot.runtime.vessel_store import VesselStore
from autopilot.signals import (
    AlarmEvent,
    HeadingSample,
    HelmSample,
    Mode,
    NavState,
    Order,
    OrderKind,
    PositionSample,
    Reference,
    RollSample,
    RudderCommand,
    RudderSample,
    Sample,
    SpeedSample,
    Tick,
)
from autopilot.vessel.file import load_vessel, problems
from sitl.ardupilot import HEAD, ArdupilotPhysics, read_packet
from sitl.firmware import Firmware
from sitl.firmware_parameters import default_parameters
from sitl.scenario import load_scenario
from sitl.wire_mavlink import MavlinkVehicle
from sitl.world import World

GROWTH_MOST_MIB = 24.0
FULL = math.radians(30.0)
HEADINGS = tuple(round(0.1 * step, 1) for step in range(-30, 31, 3))
KINDS = tuple(dialect.mavlink_map.values())
SPECIAL = tuple(
    bytes.fromhex(word)
    for word in ("0000c07f", "0000807f", "000080ff", "ffff7f7f", "01000000", "00000080", "01010101", "ffffffff")
)
"""Not a number, infinite both ways, the largest float, the smallest, nought with a sign, our own ids, all bits."""
BOAT_HEARS = ("COMMAND_", "SET_MODE", "TIMESYNC", "MISSION_", "FILE_TRANSFER_PROTOCOL", "PARAM_REQUEST_")


def forged(rng: random.Random, identities: tuple[int, ...], systems: tuple[int, ...], component: int) -> bytes:
    """Return a frame with the right checksum and any payload, of one of `identities` (all messages where empty)."""
    kind = dialect.mavlink_map[rng.choice(identities)] if identities and rng.random() < 0.8 else rng.choice(KINDS)
    payload = rng.randbytes(kind.unpacker.size) if rng.random() < 0.8 else bytes(kind.unpacker.size)
    if rng.random() < 0.3:
        payload = payload[: rng.randint(1, len(payload))]
    if rng.random() < 0.5 and len(payload) >= 8:
        # to us, or what looks like a float at its limits
        place = rng.randrange(len(payload) - 3)
        special = rng.choice(SPECIAL)
        payload = payload[:place] + special + payload[place + 4 :]
    head = bytes([0xFD, len(payload), 0, 0, rng.randrange(256), rng.choice(systems), component])
    frame = head + kind.id.to_bytes(3, "little") + payload
    return frame + dialect.x25crc(frame[1:] + bytes([kind.crc_extra])).crc.to_bytes(2, "little")


def damaged(rng: random.Random, sound: list[bytes]) -> bytes:
    """Return one to three of `sound` in one piece, damaged in one of five ways, or whole."""
    data = bytearray(b"".join(rng.choices(sound, k=rng.randrange(1, 4))))
    damage = rng.randrange(6)
    if damage == 0:
        del data[rng.randrange(len(data)) :]
    elif damage == 1:
        for _ in range(rng.randrange(1, 4)):
            data[rng.randrange(len(data))] = rng.randrange(256)
    elif damage == 2:
        place = rng.randrange(len(data))
        data[place:place] = rng.randbytes(rng.randrange(1, 6))
    elif damage == 3:
        place = rng.randrange(len(data))
        del data[place : place + rng.randrange(1, 5)]
    elif damage == 4:
        del data[: rng.randrange(len(data))]
    return bytes(data)


def inputs(rng: random.Random, sound: list[bytes], forge: Callable[[], bytes] | None, count: int) -> Iterator[bytes]:
    """Yield `count` chunks of all kinds."""
    for _ in range(count):
        what = rng.random()
        if what < 0.15:
            yield rng.randbytes(rng.randrange(64))
        elif what < 0.4 and forge is not None:
            yield forge()
        else:
            yield damaged(rng, sound)


def encoded(system: int, component: int, messages: Iterable[Any]) -> list[bytes]:
    """Return the frames of `messages`, each of MAVLink 2."""
    codec = MavlinkCodec(system, component)
    return [codec.encode(message) for message in messages]


def telemetry(mode: int = 0) -> list[Any]:
    """Return what a vehicle in `mode` sends, with headings that can be recognised."""
    words = [dialect.MAVLink_attitude_message(1000, 0.1, 0.0, heading, 0.0, 0.0, 0.01) for heading in HEADINGS]
    return [
        *words,
        dialect.MAVLink_heartbeat_message(11, 3, 129, mode, 4, 3),
        dialect.MAVLink_global_position_int_message(1000, 10, 10, 0, 0, 100, 100, 0, 0),
        dialect.MAVLink_vfr_hud_message(0.0, 3.0, 10, 50, 0.0, 0.0),
        dialect.MAVLink_gps_raw_int_message(1000, 3, 10, 10, 0, 100, 100, 100, 100, 9),
        dialect.MAVLink_rc_channels_message(1000, 16, *[1500] * 18, 200),
        dialect.MAVLink_servo_output_raw_message(1000, 0, *[1500] * 8),
        dialect.MAVLink_param_value_message(b"RCMAP_ROLL", 1.0, 9, 700, 1),
        dialect.MAVLink_statustext_message(4, b"x" * 50),
    ]


def fuzz_codec(is_stream: bool, key: bytes | None = None) -> Fuzzer:
    """Return the fuzzer of the codec: each accepted frame was sent as it is, and means what pymavlink says it means."""

    def fuzz(rng: random.Random, count: int) -> Result:
        signing = None if key is None else Signing(key, CountingTimestamps())
        codec, reference = MavlinkCodec(is_stream=is_stream, signing=signing and signing.link()), dialect.MAVLink(None)
        plain = encoded(1, 1, telemetry())
        extra = [dialect.mavlink_map[frame[7]].crc_extra for frame in plain]
        signer = Signing(key, CountingTimestamps()).link() if key is not None else None
        known: deque[bytes] = deque(maxlen=64)
        sound = list(plain)
        accepted = strangers = wrong = held = 0

        def forge() -> bytes:
            frame = forged(rng, (), (1, 2, 255), 1)
            known.append(frame)
            return frame

        for number, data in enumerate(inputs(rng, sound, forge, count)):
            if signer is not None and number % 4 == 0:
                place = rng.randrange(len(plain))
                sound[place] = signer.sign(plain[place], extra[place])
                data = sound[place]
                known.append(data)
            for message in codec.decode(data):
                accepted += 1
                frame = bytes(message._msgbuf)
                strangers += frame not in sound and frame not in known
                # what is not signed may pass where the sender, a radio, has no key
                unsigned = signer is not None and not frame[2] & 1
                wrong += unsigned and message_id(message) != dialect.MAVLINK_MSG_ID_RADIO_STATUS
                if accepted % 8 == 0 and not frame[2] & 1:
                    wrong += repr(message.to_dict()) != repr(reference.decode(bytearray(frame)).to_dict())
            held = max(held, len(codec._rest))
        return Result(accepted, strangers, wrong, held)

    return fuzz


def is_wrong(sample: Sample, now: float) -> bool:
    """Return whether a sample's value is none that a boat can have, or not of this time."""
    if isinstance(sample, HeadingSample):
        return not (abs(sample.heading) < 7.0 and abs(sample.rate or 0.0) < 100.0 and sample.time <= now)
    if isinstance(sample, RollSample):
        return not (abs(sample.roll) < 7.0 and sample.time <= now)
    if isinstance(sample, RudderSample):
        return not (abs(sample.angle) <= FULL * 1.001 and sample.time <= now)
    if isinstance(sample, SpeedSample):
        return not (0.0 <= sample.speed < 200.0 and sample.time <= now)
    if isinstance(sample, PositionSample):
        return not (abs(sample.latitude) <= 0.5 * math.pi and abs(sample.longitude) <= math.pi)
    return False


def tick_of(now: float, mode: Mode, order: Order) -> Tick:
    """Return a tick that the pilot might make."""
    state = NavState(now, 0.5, 0.0, 3.0, 0.0, 0.0, 0.1, True)
    engaged = mode is Mode.ENGAGED
    alarms = () if engaged else (AlarmEvent("cannot_engage", "waiting"),)
    return Tick(1, now, (), order, state, Reference(0.6), 0.0, RudderCommand(now, 0.1, engaged), mode, alarms)


class Echo:
    """A vehicle that does as it is ordered: reports the steering pulse or the bearing last asked for."""

    def __init__(self) -> None:
        self._reader = MavlinkCodec()
        self._writer = MavlinkCodec(1, 1)
        self._pulse, self._bearing = 1500, 0

    def answer(self, packets: Iterable[bytes]) -> list[bytes]:
        """Return the reports after `packets`."""
        for message in (message for packet in packets for message in self._reader.decode(packet)):
            if message_id(message) == dialect.MAVLINK_MSG_ID_RC_CHANNELS_OVERRIDE:
                self._pulse = message.chan1_raw or 1500
            elif message_id(message) == dialect.MAVLINK_MSG_ID_SET_ATTITUDE_TARGET:
                self._bearing = int(math.degrees(2.0 * math.atan2(message.q[3], message.q[0])))
        reports = (
            dialect.MAVLink_rc_channels_message(1000, 16, self._pulse, *[1500] * 17, 200),
            dialect.MAVLink_nav_controller_output_message(0.0, 0.0, self._bearing, 0, 0, 0.0, 0.0, 0.0),
        )
        return [self._writer.encode(report) for report in reports]


def fuzz_companion(method: Any, system: int, is_stream: bool = False) -> Fuzzer:
    """Return the fuzzer of the companion's link; forged frames come from `system`, its vehicle being 1."""

    def fuzz(rng: random.Random, count: int) -> Result:
        near, far = loopback_pair()
        near.is_stream = is_stream
        link = CompanionLink(near, CompanionSettings(FULL, method=method, as_gcs=True))
        sound = encoded(1, 1, telemetry(GUIDED_MODE if method == "guided" else MANUAL_MODE))
        steering = [parameter for parameter in default_parameters() if parameter.name in RELEVANT]
        values = encoded(
            1, 1, [dialect.MAVLink_param_value_message(p.name.encode(), p.value, 9, 700, 1) for p in steering]
        )
        heard = tuple(link.session._reader.handlers)
        echo = Echo()
        order = Order(OrderKind.HEADING, 0.6, serial=1)
        modes = (Mode.STANDBY, Mode.ENGAGED)
        accepted = strangers = wrong = held = steered = 0
        number = 0

        def forge() -> bytes:
            # a vehicle that lies all the time is never steered: every other minute it tells the truth
            if system == 1 and number // 3000 % 2 == 0:
                return rng.choice(sound)
            return forged(rng, heard, (system,), 1 if system == 1 else 191)

        for number, data in enumerate(inputs(rng, sound, forge, count)):
            now = number * 0.02
            far.send(data)
            if number % 7 == 0:
                far.send(values[number // 7 % len(values)])
            for sample in link.receive(now):
                accepted += 1
                steered += isinstance(sample, HelmSample) and sample.available
                wrong += is_wrong(sample, now)
                if system != 1 and isinstance(sample, HeadingSample):
                    strangers += round(sample.heading, 4) not in HEADINGS
            tick = tick_of(now, modes[number // 500 % 2], order)
            link.send(now, tick.command)
            link.publish_tick(tick)
            link.poll(now)
            link.take_packets()
            sent = far.receive()
            if number % 3 == 0:
                for report in echo.answer(sent):
                    far.send(report)
            held = max(held, len(link.session._codec._rest), len(link.session._texts.waiting))
        wrong += count >= 10_000 and not steered  # a link that never had the helm has not been tried
        return Result(accepted, strangers, wrong, held)

    return fuzz


def _drain(end: LoopbackTransport) -> None:
    end._incoming.clear()


def station_words() -> list[Any]:
    """Return what ground stations say to a boat of system id 1."""
    command = dialect.MAVLink_command_long_message
    return [
        dialect.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3),
        dialect.MAVLink_param_request_list_message(1, 1),
        dialect.MAVLink_param_request_read_message(1, 1, b"PID_KP", -1),
        dialect.MAVLink_param_request_read_message(1, 1, b"", 3),
        dialect.MAVLink_timesync_message(0, 1),
        dialect.MAVLink_set_mode_message(1, 1, 15),
        dialect.MAVLink_mission_request_list_message(1, 1, 0),
        dialect.MAVLink_mission_count_message(1, 1, 2, 0),
        dialect.MAVLink_mission_item_int_message(1, 1, 0, 6, 16, 0, 1, 0, 5, 0, 0, 577000000, 118000000, 0, 0),
        dialect.MAVLink_mission_item_int_message(1, 1, 1, 6, 16, 0, 1, 0, 5, 0, 0, 577010000, 118010000, 0, 0),
        dialect.MAVLink_rc_channels_override_message(1, 1, 1600, *[65535] * 7),
        dialect.MAVLink_manual_control_message(1, 32767, 200, 32767, 32767, 0),
        dialect.MAVLink_request_data_stream_message(1, 1, 0, 4, 1),
        *(command(1, 1, number, 0, 1, 15, 0, 0, 0, 0, 0) for number in (400, 176, 511, 512, 519, 246)),
        command(1, 1, 115, 0, 30, 0, 1, 1, 0, 0, 0),
        command(1, 1, 43002, 0, 1, 45, 0, 0, 0, 0, 0),
    ]


def fuzz_boat(rng: random.Random, count: int) -> Result:
    """The boat that ground stations see: orders, parameters and missions are sound whatever they send."""
    near, far = loopback_pair()
    vessel = load_vessel("lanxin")
    skipper = Skipper(FULL, PlotterGuide(), Mission(TrackGuide()))
    store = VesselStore(vessel, build_pilot(vessel), None, Path("never-written.yaml"), lambda _path, _text: None)
    mission = Mission(TrackGuide())
    server = ParameterServer(store)
    link = BoatLink(near, Commands(skipper, True, mission), server, 1)
    heard = tuple(kind.id for kind in KINDS if kind.msgname.startswith(BOAT_HEARS))
    setting = [dialect.MAVLink_param_set_message(1, 1, n.encode(), v, 9) for n in store.names for v in (1.0, -1e9)]
    # under all numbers that a frame may have: an order that comes again is none
    sound = encoded(255, 190, station_words() * 12)
    sets = encoded(255, 190, setting)
    accepted = wrong = held = 0
    before = Order()
    for number, data in enumerate(inputs(rng, sound, lambda: forged(rng, heard, (255, 9), 190), count)):
        now = number * 0.02
        far.send(rng.choice(sets) if number % 400 == 0 else data)
        link.receive(now)
        order = skipper(now, None)
        accepted += not order.is_same(before)
        before = order
        wrong += not (math.isfinite(order.rudder) and abs(order.rudder) <= FULL and not math.isinf(order.heading))
        link.publish_tick(tick_of(now, Mode.ENGAGED if number // 500 % 2 else Mode.STANDBY, order))
        link.poll(now)
        link.take_packets()
        _drain(far)
        if number % 1000 == 0:
            wrong += len(list(problems(store.stored))) + len(list(problems(store.running)))
        held = max(held, len(link._codec._rest), len(server._listing))
    return Result(accepted, 0, wrong, held)


def fuzz_vehicle(rng: random.Random, count: int) -> Result:
    """The simulated flight controller: whatever is set or ordered, servos and boat stay in the world."""
    world = World(load_vessel("lanxin"), load_scenario("calm"))
    firmware = Firmware(world)
    vehicle = MavlinkVehicle(firmware)
    sound = encoded(255, 190, station_words())
    heard = tuple(vehicle._handlers)
    names = [firmware.parameters.at(index) for index in range(len(firmware.parameters))]
    values = (0.0, 1.0, -1.0, 16.0, 1500.0, 1e9, -1e9, math.inf, math.nan)
    setting = [(parameter.name.encode(), value) for parameter in names if parameter for value in values]
    sets = encoded(255, 190, [dialect.MAVLink_param_set_message(1, 1, name, value, 9) for name, value in setting])
    accepted = wrong = held = 0
    for number, data in enumerate(inputs(rng, sound, lambda: forged(rng, heard, (255, 1, 9), 190), count)):
        now = number * 0.002
        vehicle.receive(now, rng.choice(sets) if number % 10 == 0 else data)
        sent = vehicle.transmit(now)
        accepted += len(sent)
        state = world.boat.state
        wrong += not (math.isfinite(state.heading) and math.isfinite(state.speed) and abs(state.rudder) <= FULL * 1.001)
        wrong += any(not 0 <= pulse <= 65535 for pulse in firmware.servos)
        held = max(held, len(vehicle.codec._rest), len(vehicle._parameter_queue))
        if number % 5000 == 0:
            # what a tester would do: parameters as they were, notices read
            firmware.notices.clear()
            vehicle._notices_seen = 0
            for parameter in names:
                assert parameter is not None
                firmware.parameters.set(parameter.name, parameter.value)
            vehicle.codec.system = 1
    return Result(accepted, 0, wrong, held)


def fuzz_servo_packets(rng: random.Random, count: int) -> Result:
    """ArduPilot's servo packets, which carry no checksum: length, magic and rate are all there is to check."""
    physics = ArdupilotPhysics(load_vessel("lanxin"), load_scenario("calm"))
    accepted = strangers = wrong = 0

    def packet(magic: int, channels: int, frame: int) -> bytes:
        pulses = [rng.choice((0, 1000, 1500, 2000, 65535)) for _ in range(channels)]
        return HEAD.pack(magic, 1200, frame) + b"".join(pulse.to_bytes(2, "little") for pulse in pulses)

    for number in range(count):
        sound = [packet(18458, 16, number + 1), packet(29569, 32, number + 1)]
        data = next(inputs(rng, sound, None, 1))
        read = read_packet(data)
        # a rate of a few frames a second makes ArduPilot's frames long, and this study with them
        if read is not None and read.rate_hz < 100:
            continue
        reply = physics.answer(data)
        accepted += bool(reply)
        strangers += bool(reply) and data not in sound
        wrong += bool(reply) != (read is not None)
        if reply and number % 16 == 0:
            document = json.loads(reply)
            numbers = [*document["attitude"], *document["velocity"], *document["position"], document["timestamp"]]
            wrong += not all(math.isfinite(value) for value in numbers)
    return Result(accepted, strangers, wrong, 0)


FUZZERS: dict[str, Fuzzer] = {
    "codec, datagrams": fuzz_codec(is_stream=False),
    "codec, stream": fuzz_codec(is_stream=True),
    "codec, signed stream": fuzz_codec(is_stream=True, key=bytes(range(32))),
    "companion, strangers forge": fuzz_companion("rc_override", 9),
    "companion, the vehicle forges": fuzz_companion("rc_override", 1),
    "companion, guided": fuzz_companion("guided", 1, is_stream=True),
    "boat for ground stations": fuzz_boat,
    "flight controller (sitl)": fuzz_vehicle,
    "servo packets (sitl)": fuzz_servo_packets,
}


def resident_mib() -> float:
    """Return the memory of this process in MiB."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * 4096 / 2**20


def run(fuzz: Fuzzer, rng: random.Random, count: int) -> tuple[Result, tuple[str, ...], bool]:
    """Run a tenth of `count` to warm up and then all of it; memory may grow by so much [MiB] and no more."""
    fuzz(rng, count // 10)
    before = resident_mib()
    result = fuzz(rng, count)
    grown = resident_mib() - before
    return result, (f"{grown:.1f}",), grown > GROWTH_MOST_MIB


def main() -> int:
    """Run the fuzzers and print one line for each; return 1 where one has failed."""
    heads = ("reader", "inputs", "accepted", "strangers", "wrong", "most bytes held", "MiB grown")
    return print_table(FUZZERS, heads, run, share=1.1)


if __name__ == "__main__":
    sys.exit(main())
