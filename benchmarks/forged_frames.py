"""An attack on a served boat with a signing key: forged, replayed and damaged MAVLink frames, none of them obeyed.

    python benchmarks/forged_frames.py [--frames N] [--json]

A million frames go into the link of a running boat over a loopback: commands to arm, mode changes and parameter writes,
unsigned, signed with a wrong key, recorded from the true station and sent again, with a timestamp of three minutes
before the start, with changed bytes, cut off, made of beginnings, from wrong ids, and even with the right key from a
system id that is not allowed. Between them the true station asks, to show that it is still heard. The figures are
processor time, so that a busy machine does not change them much. `attacked_loop.py` attacks a whole running process.
"""

from __future__ import annotations

import argparse
import json
import random
import sys
import time
from collections.abc import Callable, Sequence
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.guidance.track import TrackGuide
from autopilot.links.ground_station.access import AccessPolicy, AccessRules
from autopilot.links.ground_station.boat_link import BoatLink
from autopilot.links.ground_station.commands import Commands
from autopilot.links.ground_station.mission import Mission
from autopilot.links.ground_station.station_service import ParameterServer
from autopilot.links.mavlink.codec import MavlinkCodec
from autopilot.links.mavlink.signing import MINUTE, CountingTimestamps, Signing
from autopilot.links.transports import loopback_pair

KEY = bytes(range(32))
NOW = 37 * 10**12
BATCH = 100
MESSAGES = (
    dialect.MAVLink_command_long_message(1, 1, dialect.MAV_CMD_COMPONENT_ARM_DISARM, 0, 1, 0, 0, 0, 0, 0, 0),
    dialect.MAVLink_set_mode_message(1, 1, 15),
    dialect.MAVLink_param_set_message(1, 1, b"GAIN", 9.0, 9),
)
PING = dialect.MAVLink_param_request_read_message(1, 1, b"GAIN", -1)


class Store:
    """One number, and how often it was set."""

    names = ("GAIN",)
    revision = 0
    written = 0

    def get(self, name: str) -> float:
        """Return it."""
        return 1.0

    def set(self, name: str, value: float) -> str:
        """Count."""
        self.written += 1
        return ""


class Nobody:
    """Carries nothing out; counts what is ordered."""

    orders = 0

    def __getattr__(self, name: str) -> Callable[..., None]:
        def order(*_: object) -> None:
            self.orders += 1

        return order


def station(key: bytes, start: int, system: int = 255) -> MavlinkCodec:
    """Return who signs with `key`, its timestamps beginning at `start`."""
    return MavlinkCodec(system, 190, signing=Signing(key, CountingTimestamps(start)).link())


def forgers(
    recorded: list[bytes], rng: random.Random, messages: Sequence[Any] = MESSAGES
) -> dict[str, Callable[[], bytes]]:
    """Return each kind of forged frame with what makes one of `messages`."""
    plain, wrong = MavlinkCodec(255, 190), station(rng.randbytes(32), NOW)
    late = station(KEY, NOW - 3 * MINUTE, system=200)
    stranger, insider = MavlinkCodec(77, 1), station(KEY, NOW, system=78)

    def damaged() -> bytes:
        frame = bytearray(rng.choice(recorded))
        frame[rng.randrange(len(frame))] ^= rng.randrange(1, 256)
        return bytes(frame)

    def cut() -> bytes:
        frame = rng.choice(recorded)
        return frame[: rng.randrange(1, len(frame))]

    return {
        "unsigned": lambda: plain.encode(rng.choice(messages)),
        "wrong key": lambda: wrong.encode(rng.choice(messages)),
        "replayed": lambda: rng.choice(recorded),
        "old timestamp": lambda: late.encode(rng.choice(messages)),
        "damaged": damaged,
        "cut off": cut,
        "beginnings": lambda: rng.choice((b"\xfd", b"\xfe", b"\xfe\x09\x00\x01\x01\x00")) * 12,
        "wrong ids": lambda: stranger.encode(rng.choice(messages)),
        "right key, id not allowed": lambda: insider.encode(rng.choice(messages)),
    }


def main() -> int:
    """Attack and print; 1 where a forged frame was obeyed."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--frames", type=int, default=1_000_000, help="forged frames in all")
    parser.add_argument("--json", action="store_true", help="print JSON instead of the table")
    arguments = parser.parse_args()
    rng = random.Random(5)
    near, far = loopback_pair()
    store, hand = Store(), Nobody()
    commands = Commands(hand, armed=False, mission=Mission(TrackGuide()))  # type: ignore[arg-type]
    access = AccessPolicy(AccessRules(systems=frozenset({255, 200}))).link()
    server, signing = ParameterServer(store), Signing(KEY, CountingTimestamps(NOW)).link()
    boat = BoatLink(near, commands, server, signing=signing, access=access)
    true = station(KEY, NOW)
    recorded = [true.encode(message) for message in MESSAGES * 20]
    for frame in recorded:
        far.send(frame)
    boat.receive(0.0)
    commands.armed, store.written, hand.orders, pings = False, 0, 0, 0
    far.receive()
    kinds = forgers(recorded, rng)
    spent, sent = dict.fromkeys(kinds, 0.0), dict.fromkeys(kinds, 0)
    now = 0.0
    while sum(sent.values()) < arguments.frames:
        for name, make in kinds.items():
            frames = [make() for _ in range(BATCH)]
            for frame in frames:
                far.send(frame)
            now += 0.2
            started = time.process_time()
            boat.receive(now)
            spent[name] += time.process_time() - started
            sent[name] += BATCH
        far.receive()
        far.send(true.encode(PING))
        boat.receive(now)
        pings += sum(m.get_type() == "PARAM_VALUE" for data in far.receive() for m in MavlinkCodec().decode(data))
    obeyed = store.written + hand.orders + commands.armed
    rounds = sum(sent.values()) // (BATCH * len(kinds))
    result = {
        "frames": sum(sent.values()),
        "obeyed": obeyed,
        "true_station_heard": f"{pings} of {rounds}",
        "us_a_frame": {name: round(1e6 * spent[name] / sent[name], 2) for name in kinds},
    }
    if arguments.json:
        print(json.dumps(result, indent=2))
        return int(obeyed > 0)
    print(
        f"{result['frames']} forged frames, {obeyed} obeyed; the true station was heard {result['true_station_heard']}"
    )
    for name in kinds:
        print(f"{name:26s}{1e6 * spent[name] / sent[name]:8.2f} us a frame")
    return int(obeyed > 0)


if __name__ == "__main__":
    sys.exit(main())
