"""Which faults are at work at a given time, how large they are, and since when; and where those act that do something
to boat and vehicle.

Faults by command while the boat sails: `sitl fault` sends a line of text, the served boat answers with one.

    rudder_slow size=0.2 for=10 ramp=2    begins now, and ends after 10 simulated seconds; without `for`, never
    heading_frozen source=first           of one of two compasses alone, first or second
    clear [KIND]                          ends what is at work and what is to come
    list                                  names what is at work

UDP on the loopback interface alone: whoever may start processes on this machine may break the simulated boat.
"""

from __future__ import annotations

import difflib
import math
import socket
from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from autopilot.errors import InputError
from autopilot.files.outside import typed_number
from autopilot.links.base import LinkError, NotThereError
from autopilot.models.steering_gear import SteeringGear
from sitl.boat import Disturbance
from sitl.fault_table import RECEIVER, Acting, Moved, Ordered
from sitl.registry import KINDS, SOURCES, FaultKind, Source, that_act_at, that_silence, wrong_size, wrong_source
from sitl.scenario import FaultSection

if TYPE_CHECKING:
    from sitl.firmware import Firmware
    from sitl.firmware_setup import Propulsion
    from sitl.world import World

MOST_OCCURRENCES = 10000
"""Of one fault that comes and goes at random."""


class Fault(NamedTuple):
    """One fault from `begin` to before `end` [s since the start]; its size grows from 0 over `ramp` [s].

    source: which of two compasses has it.
    """

    kind: FaultKind
    begin: float
    end: float
    size: float
    ramp: float = 0.0
    source: Source = "both"

    def hits(self, source: Source) -> bool:
        """Return whether it is a fault of `source`."""
        return self.source in ("both", source)

    def size_at(self, time: float) -> float | None:
        """Return the size at `time` [s], None where the fault is not at work."""
        if not self.begin <= time < self.end:
            return None
        return self.size if self.ramp <= 0.0 else self.size * min((time - self.begin) / self.ramp, 1.0)


class FaultBoard:
    """The faults of one run: those of the scenario, and those that are added while it runs."""

    def __init__(self, sections: Iterable[FaultSection] = (), seed: np.random.SeedSequence | None = None) -> None:
        rng = np.random.default_rng(np.random.SeedSequence(0) if seed is None else seed)
        self._faults: dict[FaultKind, list[Fault]] = {}
        self._memories: dict[tuple[str, Source], dict[FaultKind, dict[str, Any]]] = {}
        self._spans: dict[tuple[FaultKind, Source], tuple[float, float, Fault | None]] = {}
        """Which fault of a kind is at work from one time to before another [s]; empty where that must be found anew."""
        self._placed: dict[str, list[tuple[FaultKind, Callable[..., Any]]]] = {}
        """Those of this board that act at a place."""
        for section in sections:
            for fault in _occurrences(section, rng):
                self.add(fault)

    def __bool__(self) -> bool:
        return bool(self._faults)

    def add(self, fault: Fault) -> None:
        """Add a fault, now or later."""
        self._faults.setdefault(fault.kind, []).append(fault)
        self._spans.clear()
        self._placed.clear()

    def clear(self, time: float, kind: FaultKind | None = None) -> int:
        """End every fault of `kind`, or of any, that is at work or to come; return how many."""
        ended = 0
        for each in list(self._faults) if kind is None else [kind]:
            kept = []
            for fault in self._faults.get(each, ()):
                ended += fault.end > time
                if fault.begin < time:
                    kept.append(fault._replace(end=min(fault.end, time)))
            self._faults[each] = kept
        self._spans.clear()
        return ended

    def size(self, kind: FaultKind, time: float, source: Source = "first") -> float | None:
        """Return the size of the fault of `source` at `time` [s], of several the last added; None where it has none."""
        fault = self._newest(kind, time, source)
        return None if fault is None else fault.size_at(time)

    def _newest(self, kind: FaultKind, time: float, source: Source) -> Fault | None:
        since, until, found = self._spans.get((kind, source), (math.inf, math.inf, None))
        if since <= time < until:
            return found
        since, until, found = -math.inf, math.inf, None
        for fault in self._faults.get(kind, ()):
            if not fault.hits(source):
                continue
            for edge in (fault.begin, fault.end):
                since, until = (max(since, edge), until) if edge <= time else (since, min(until, edge))
            if fault.begin <= time < fault.end:
                found = fault
        self._spans[kind, source] = since, until, found
        return found

    def is_on(self, kind: FaultKind, time: float, source: Source = "first") -> bool:
        """Return whether a fault of `kind` is at work in `source` at `time` [s]."""
        return self._newest(kind, time, source) is not None

    def silences(self, what: str, time: float, source: Source = "first") -> bool:
        """Return whether a fault at work in `source` at `time` [s] silences a message, a sentence or an instrument."""
        return bool(self._faults) and any(self.is_on(kind, time, source) for kind in that_silence(what))

    def acting(self, place: str, time: float, source: Source = "first") -> Sequence[tuple[Acting, Callable[..., Any]]]:
        """Return the faults at work in `source` at `time` [s] that act at a place, a field of `Kind`, in the order of
        their kinds, and what each does there. Memory: what each remembers there while it lasts."""
        if not self._faults:
            return ()
        placed = self._placed.get(place)
        if placed is None:
            placed = self._placed[place] = [each for each in that_act_at(place) if each[0] in self._faults]
        found = []
        for kind, effect in placed:
            memories, fault = self._memories.setdefault((place, source), {}), self._newest(kind, time, source)
            if fault is None or (size := fault.size_at(time)) is None:
                memories.pop(kind, None)
            else:
                found.append((Acting(size, time, memories.setdefault(kind, {}), time - fault.begin), effect))
        return found

    def at_work(self, time: float) -> list[Fault]:
        """Return the faults at work at `time` [s], by the order of their kinds."""
        every = [fault for kind in KINDS for fault in self._faults.get(kind, ())]
        return [fault for fault in every if fault.size_at(time) is not None]


def fault_of(section: FaultSection) -> Fault:
    """Return the fault of a section that does not come and go."""
    size = KINDS[section.kind].size if section.size is None else section.size
    end = math.inf if section.to_s is None else section.to_s
    return Fault(section.kind, section.from_s, end, size, section.ramp_s, section.source)


def _occurrences(section: FaultSection, rng: np.random.Generator) -> list[Fault]:
    """The fault itself, or, where it comes and goes, its occurrences: a Poisson process of `every_s`."""
    whole = fault_of(section)
    if section.every_s is None:
        return [whole]
    found: list[Fault] = []
    time = whole.begin + rng.exponential(section.every_s)
    while time < whole.end and len(found) < MOST_OCCURRENCES:
        end = min(time + section.lasts_s, whole.end)
        found.append(whole._replace(begin=float(time), end=float(end)))
        time = end + rng.exponential(section.every_s)
    return found


class BoatFaults:
    """What faults do to rudder, engine and boat, between the orders and the physics; called once a step each."""

    def __init__(self, faults: FaultBoard, gear: SteeringGear) -> None:
        self._faults, self._gear = faults, gear

    def order(self, time: float, order: float, rudder: float) -> float:
        """Return what the gear makes of the `order` [rad], the rudder being at `rudder` [rad]."""
        for fault, effect in self._faults.acting("order", time):
            order = effect(fault, Ordered(self._gear, order, rudder))
        return order

    def reached(self, time: float, before: float, after: float, dt: float) -> float:
        """Return where the rudder [rad] really is after a step of `dt` [s] from `before` to `after`."""
        for fault, effect in self._faults.acting("reached", time):
            after = effect(fault, Moved(self._gear, before, after, dt))
        return after

    def thrust(self, time: float, thrust_speed: float, cruise_speed: float) -> float:
        """Return the speed [m/s] that the engine would reach."""
        for fault, effect in self._faults.acting("thrust", time):
            thrust_speed = effect(fault, thrust_speed, cruise_speed)
        return thrust_speed

    def motors(self, time: float, motors: Propulsion, order: float, thrust_speed: float) -> tuple[float, float]:
        """Return the steering order [rad] and the speed [m/s] that two thrusters come to, of those asked for."""
        steering, throttle = order / motors.full, motors.throttle_of(thrust_speed)
        pair = (throttle + steering, throttle - steering)
        for fault, effect in self._faults.acting("motors", time):
            pair = effect(fault, pair)
        left, right = pair
        return 0.5 * (left - right) * motors.full, motors.speed_of(0.5 * (left + right))

    def bow(self, time: float, share: float) -> float:
        """Return what a bow thruster runs at, -1 to 1, for a `share` of full that is asked of it."""
        for fault, effect in self._faults.acting("bow", time):
            share = effect(fault, share)
        return share

    def pushed(self, time: float, heading: float, disturbance: Disturbance) -> Disturbance:
        """Return the `disturbance` of a boat that heads for `heading` [rad], and the pushes on top of it."""
        for fault, effect in self._faults.acting("push", time):
            disturbance = effect(fault, heading, disturbance)
        return disturbance


SWITCH_HIGH_US = 2000


class VehicleFaults:
    """Called once a step, before the firmware reads its sticks. Memory: what had begun, and the sticks at rest."""

    def __init__(self, firmware: Firmware) -> None:
        self._firmware = firmware
        self._faults = firmware.world.faults
        self._rest: dict[int, int] = {}

    def work(self, time: float) -> None:
        """Do what the faults do at `time` [s]."""
        if not self._faults and not self._rest:
            return
        for fault, happen in self._faults.acting("happens", time):
            if not fault.memory.get("has_happened"):
                fault.memory["has_happened"] = True
                happen(fault, self._firmware)
        self._move_sticks(time)
        self._firmware.receiver = self._firmware.has_receiver and not self._faults.silences(RECEIVER, time)

    def _move_sticks(self, time: float) -> None:
        """Put the sticks where the faults have them, and back to where they were."""
        wanted: dict[int, int] = {}
        for fault, moved in self._faults.acting("sticks", time):
            wanted.update(moved(fault, self._firmware))
        sticks = self._firmware.sticks
        for channel in [channel for channel in self._rest if channel not in wanted]:
            sticks[channel - 1] = self._rest.pop(channel)
        for channel, pulse in wanted.items():
            # a switch that was never touched rests in between, where it allows nothing anew
            is_switch = channel == self._firmware.setup.override_switch
            self._rest.setdefault(channel, SWITCH_HIGH_US if is_switch else sticks[channel - 1])
            sticks[channel - 1] = pulse


ANSWER_S = 3.0
LONGEST = 4096
WORDS = ("size", "for", "ramp", "after")


def service_address(text: str) -> tuple[str, int]:
    """Return host and port of `HOST:PORT`, a loopback address. Raises InputError."""
    host, _, digits = text.rpartition(":")
    is_port = digits.isascii() and digits.isdigit() and len(digits) <= 5 and 1 <= int(digits) <= 65535
    if host not in ("127.0.0.1", "localhost") or not is_port:
        raise InputError(f"--control {text}: write 127.0.0.1:PORT, with a port from 1 to 65535.")
    return "127.0.0.1", int(digits)


class FaultService:
    """Listens for faults at a loopback address. Raises LinkError where it cannot."""

    def __init__(self, world: World, address: str) -> None:
        self._world = world
        place = service_address(address)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        try:
            self._socket.bind(place)
        except OSError as error:
            self._socket.close()
            raise LinkError(f"--control {address}: {error.strerror}; choose another port") from error

    def fileno(self) -> int:
        """Return the descriptor to wait on."""
        return self._socket.fileno()

    def serve(self) -> None:
        """Answer every line that waits."""
        while True:
            try:
                data, sender = self._socket.recvfrom(LONGEST)
            except (BlockingIOError, ConnectionError):
                return
            answer = obey(self._world, data.decode("utf-8", "replace"))
            try:
                self._socket.sendto(answer.encode(), sender)
            except OSError:
                continue  # who asked does not wait for the answer

    def close(self) -> None:
        """Give the port back."""
        self._socket.close()


def obey(world: World, line: str) -> str:
    """Do what a line says, now; return the answer, which begins with `ok` or `error`."""
    words = line.split()
    try:
        return f"ok {_obey(world, words)}"
    except InputError as error:
        return f"error {error}"


def _obey(world: World, words: list[str]) -> str:
    time = world.time
    if words == ["list"]:
        return ", ".join(f"{fault.kind} since {fault.begin:.2f} s" for fault in world.faults.at_work(time)) or "none"
    if words[:1] == ["clear"] and len(words) <= 2:
        kind = _kind(words[1]) if len(words) == 2 else None
        return f"{world.faults.clear(time, kind)} ended at {time:.2f} s"
    if not words:
        raise InputError("an empty line; write a fault such as rudder_stuck for=10, or list, or clear.")
    kind = _kind(words[0])
    source, rest = _source(words[1:])
    values = _values(rest)
    size = values.get("size")
    if wrong := wrong_size(kind, size) or wrong_source(kind, source):
        raise InputError(wrong)
    begin = time + values.get("after", 0.0)
    end = begin + values.get("for", math.inf)
    size = KINDS[kind].size if size is None else size
    world.faults.add(Fault(kind, begin, end, size, values.get("ramp", 0.0), source))
    until = f"to {end:.2f} s" if math.isfinite(end) else "until it is cleared"
    return f"{kind} from {begin:.2f} s {until}"


def _kind(name: str) -> FaultKind:
    if name not in KINDS:
        near = difflib.get_close_matches(name, KINDS, 1)
        hint = f"did you mean {near[0]}?" if near else "`sitl fault --kinds` lists them."
        raise InputError(f"{name}: no such fault; {hint}")
    return name


def _source(words: list[str]) -> tuple[Source, list[str]]:
    """Return which compass the words name, and the other words."""
    named = [word for word in words if word.startswith("source=")]
    rest = [word for word in words if not word.startswith("source=")]
    if not named:
        return "both", rest
    name = named[0].removeprefix("source=")
    if len(named) > 1 or name not in SOURCES:
        raise InputError(f"{' '.join(named)}: write source=first, source=second or source=both, once.")
    return name, rest


def _values(words: list[str]) -> dict[str, float]:
    values: dict[str, float] = {}
    for word in words:
        name, _, text = word.partition("=")
        try:
            number = typed_number(text)
        except ValueError:
            number = math.nan
        if name not in WORDS or name in values or not math.isfinite(number) or (name != "size" and number < 0.0):
            raise InputError(
                f"{word}: write {', '.join(f'{each}=NUMBER' for each in WORDS)} or source=NAME, each once."
            )
        values[name] = number
    return values


def kinds_table() -> list[tuple[str, str, str, str]]:
    """Return the table of every fault with its size, its head first."""
    rows = [("fault", "what", "default size", "allowed")]
    for name, kind in KINDS.items():
        size, allowed = (f"{kind.size:g} {kind.unit}", f"{kind.low:g} to {kind.high:g}") if kind.unit else ("", "")
        rows.append((name, kind.what, size, allowed))
    return rows


def ask(address: str, line: str, patience: float = ANSWER_S) -> str:
    """Send a line to the service at `address` and return its answer. LinkError where none comes in `patience` [s]."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as asker:
        asker.settimeout(patience)
        try:
            asker.connect(service_address(address))
            asker.send(line.encode())
            return asker.recv(LONGEST).decode("utf-8", "replace")
        except ConnectionRefusedError as error:
            raise NotThereError(f"{address}: no answer; start `sitl serve` with --control {address}") from error
        except OSError as error:
            raise LinkError(f"{address}: no answer; start `sitl serve` with --control {address}") from error
