"""A line that damages what it carries: loss, delay, jitter, doubling, overtaking, changed bytes, cut packets, noise,
and a connection that is open on one side only. Seeded, on whatever clock is given, in front of any endpoint."""

from __future__ import annotations

import heapq
import math
from collections.abc import Iterable
from random import Random
from typing import NamedTuple

import numpy as np

from autopilot.errors import InputError
from autopilot.order_values import typed_number
from sitl.fault_kinds import KINDS, FaultKind
from sitl.faults import Fault, FaultBoard
from sitl.serve import Endpoint
from sitl.world import World

NAMES: dict[str, FaultKind] = {
    "loss": "link_loss",
    "delay": "link_delay",
    "jitter": "link_jitter",
    "duplicate": "link_duplicate",
    "reorder": "link_reorder",
    "corrupt": "link_corrupt",
    "truncate": "link_truncate",
    "flood": "link_flood",
    "half_open": "link_half_open",
}
"""Names of `--chaos`, and the faults that they stand for: one works all the time, the other when it is told to."""
REORDER_S = 0.1
"""A packet that is overtaken waits so long."""
NOISE_MOST = 64
MOST_UNDER_WAY = 20000


class Damage(NamedTuple):
    """How bad a line is: shares of packets, seconds, and packets of noise a second; still: nothing passes."""

    loss: float = 0.0
    delay: float = 0.0
    jitter: float = 0.0
    duplicate: float = 0.0
    reorder: float = 0.0
    corrupt: float = 0.0
    truncate: float = 0.0
    flood: float = 0.0
    still: bool = False


class ChaosLine:
    """One direction. What is put in comes out of `take`, or not, or later, or something else.

    is_stream: the bytes belong to a stream: they are lost and damaged, but never overtake each other.
    """

    def __init__(self, seed: int = 0, is_stream: bool = False) -> None:
        self._random = Random(seed)
        self._is_stream = is_stream
        self._under_way: list[tuple[float, int, bytes]] = []
        self._number = 0
        self._latest = -math.inf
        self._noise_due: float | None = None
        self.lost = self.damaged = 0

    def put(self, time: float, data: bytes, damage: Damage) -> None:
        """Send a packet at `time` [s] over a line that is so bad."""
        chance = self._random.random
        if damage.still or chance() < damage.loss or len(self._under_way) >= MOST_UNDER_WAY:
            self.lost += 1
            return
        if data and chance() < damage.truncate:
            data = data[: self._random.randrange(len(data))]
            self.damaged += 1
        if data and chance() < damage.corrupt:
            data = self._corrupted(data)
            self.damaged += 1
        for _ in range(2 if chance() < damage.duplicate else 1):
            late = damage.delay + damage.jitter * chance() + (REORDER_S if chance() < damage.reorder else 0.0)
            self._send(time + late, data)

    def make_noise(self, time: float, damage: Damage) -> None:
        """Put in the packets of noise that are due by `time` [s]."""
        if damage.flood <= 0.0 or damage.still:
            self._noise_due = None
            return
        due = time if self._noise_due is None else self._noise_due
        while due <= time:
            self._send(due, self._random.randbytes(self._random.randrange(1, NOISE_MOST)))
            due += 1.0 / damage.flood
        self._noise_due = due

    def take(self, time: float) -> list[bytes]:
        """Return what has arrived by `time` [s], in the order of arrival."""
        arrived = []
        while self._under_way and self._under_way[0][0] <= time + 1.0e-9:
            arrived.append(heapq.heappop(self._under_way)[2])
        return arrived

    def _send(self, arrival: float, data: bytes) -> None:
        if self._is_stream:
            arrival = self._latest = max(arrival, self._latest)
        self._number += 1
        heapq.heappush(self._under_way, (arrival, self._number, data))

    def _corrupted(self, data: bytes) -> bytes:
        changed = bytearray(data)
        for _ in range(self._random.randrange(1, 4)):
            changed[self._random.randrange(len(changed))] ^= self._random.randrange(1, 256)
        return bytes(changed)


class ChaosPort:
    """An `Endpoint` with a bad line on either way, as bad as the faults of the moment say; without any, clear."""

    def __init__(self, endpoint: Endpoint, world: World, is_stream: bool, seed: np.random.SeedSequence) -> None:
        self._endpoint = endpoint
        self._world = world
        to_boat, from_boat = seed.generate_state(2)
        self.to_boat = ChaosLine(int(to_boat), is_stream)
        self.from_boat = ChaosLine(int(from_boat), is_stream)

    def receive(self, now: float, data: bytes) -> None:
        """Take bytes that set out for the boat at `now` [s]."""
        faults, time = self._world.faults, self._world.time_at(now)
        damage = damage_at(faults, time)
        if faults.is_on("link_deaf", time):
            damage = damage._replace(still=True)
        self._pass_on(now)
        self.to_boat.put(time, data, damage)
        self._pass_on(now)

    def advance(self, now: float) -> None:
        """Move the world on to `now` [s]."""
        self._world.advance(now)

    def transmit(self, now: float) -> list[bytes]:
        """Return what has come through by `now` [s]."""
        time = self._world.time_at(now)
        damage = damage_at(self._world.faults, time)
        self._pass_on(now)
        for data in self._endpoint.transmit(now):
            self.from_boat.put(time, data, damage)
        self.to_boat.make_noise(time, damage)
        self.from_boat.make_noise(time, damage)
        return self.from_boat.take(time)

    def _pass_on(self, now: float) -> None:
        for data in self.to_boat.take(self._world.time_at(now)):
            self._endpoint.receive(now, data)


def damage_at(faults: FaultBoard, time: float) -> Damage:
    """Return how bad the line is at `time` [s]."""
    if not faults:
        return Damage()
    sizes = {name: faults.size(kind, time) for name, kind in NAMES.items()}
    still = sizes.pop("half_open") is not None
    return Damage(**{name: size for name, size in sizes.items() if size is not None}, still=still)


def chaos_faults(text: str) -> Iterable[Fault]:
    """Return the faults, from the start to the end, that `loss=0.05,delay=0.1` stands for. Raises InputError."""
    found: dict[str, Fault] = {}
    for item in text.split(","):
        name, equals, value = (part.strip() for part in item.partition("="))
        if name not in NAMES or name in found:
            raise InputError(f"--chaos {text}: {name!r} is unknown or named twice, allowed are {', '.join(NAMES)}.")
        kind = KINDS[NAMES[name]]
        size, begin = (_number(text, name, value, kind.low, kind.high), 0.0) if kind.unit else (1.0, 0.0)
        if name == "half_open":
            # nothing to say about its size, but when it begins
            begin = _number(text, name, value, 0.0, 1.0e6) if equals else 0.0
        found[name] = Fault(NAMES[name], begin, math.inf, size)
    return found.values()


def _number(text: str, name: str, value: str, low: float, high: float) -> float:
    try:
        number = typed_number(value)
    except ValueError:
        number = math.nan
    if not low <= number <= high:
        raise InputError(f"--chaos {text}: {name} is {value!r}, it must be a number from {low:g} to {high:g}.")
    return number
