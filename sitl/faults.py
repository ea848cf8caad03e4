"""Which faults are at work at a given time, how large they are, and since when; and where those act that do something
to boat and vehicle."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from autopilot.models.steering_gear import SteeringGear
from sitl.boat import Disturbance
from sitl.fault_kind import RECEIVER, Acting, Moved, Ordered
from sitl.registry import KINDS, FaultKind, Source, that_act_at, that_silence
from sitl.scenario import FaultSection

if TYPE_CHECKING:
    from sitl.firmware import Firmware
    from sitl.firmware_setup import Propulsion

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
        for section in sections:
            for fault in _occurrences(section, rng):
                self.add(fault)

    def __bool__(self) -> bool:
        return bool(self._faults)

    def add(self, fault: Fault) -> None:
        """Add a fault, now or later."""
        self._faults.setdefault(fault.kind, []).append(fault)
        self._spans.clear()

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

    def acting(self, place: str, time: float, source: Source = "first") -> Iterator[tuple[Acting, Callable[..., Any]]]:
        """Yield the faults at work in `source` at `time` [s] that act at a place, a field of `Kind`, in the order of
        their kinds, and what each does there. Memory: what each remembers there while it lasts."""
        if not self._faults:
            return
        memories = self._memories.setdefault((place, source), {})
        for kind, effect in that_act_at(place):
            fault = self._newest(kind, time, source)
            size = None if fault is None else fault.size_at(time)
            if fault is None or size is None:
                memories.pop(kind, None)
            else:
                yield Acting(size, time, memories.setdefault(kind, {}), time - fault.begin), effect

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
