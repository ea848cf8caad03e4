"""Which faults are at work at a given time, how large they are, and since when.

What faults do to rudder, engine and boat, between the orders and the physics.

What happens to the flight controller: reboots, hands on its sticks and switches, warnings, a clock that steps.

Texts are those of ArduRover 4.6: AC_Fence.cpp ("Polygon fence breached", notice) and AP_BattMonitor.cpp ("Battery 1 is
low ...", warning). ArduRover has no text of its own for shallow water; boats say it from a script.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from autopilot.models.steering_gear import SteeringGear, clip
from sitl.boat import Disturbance
from sitl.fault_kinds import KINDS, FaultKind, Source
from sitl.scenario import FaultSection

if TYPE_CHECKING:
    from sitl.firmware import Firmware

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
        for section in sections:
            for fault in _occurrences(section, rng):
                self.add(fault)

    def __bool__(self) -> bool:
        return bool(self._faults)

    def add(self, fault: Fault) -> None:
        """Add a fault, now or later."""
        self._faults.setdefault(fault.kind, []).append(fault)

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
        return ended

    def size(self, kind: FaultKind, time: float, source: Source = "first") -> float | None:
        """Return the size of the fault of `source` at `time` [s], of several the last added; None where it has none."""
        for fault in reversed(self._faults.get(kind, ())):
            size = fault.size_at(time) if fault.hits(source) else None
            if size is not None:
                return size
        return None

    def is_on(self, kind: FaultKind, time: float, source: Source = "first") -> bool:
        """Return whether a fault of `kind` is at work in `source` at `time` [s]."""
        return kind in self._faults and self.size(kind, time, source) is not None

    def lasted(self, kind: FaultKind, time: float, source: Source = "first") -> float:
        """Return how long [s] the fault has been at work in `source` at `time`; 0 where it is not."""
        faults = self._faults.get(kind, ())
        on = [fault for fault in faults if fault.hits(source) and fault.size_at(time) is not None]
        return time - on[-1].begin if on else 0.0

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


TRAILING_S = 0.5
"""A rudder that nothing holds trails amidships with this time constant; assumed."""


class RudderFaults:
    """The steering gear with its faults. `order` comes before the gear, `reached` after it, once a step each."""

    def __init__(self, faults: FaultBoard, gear: SteeringGear) -> None:
        self._faults = faults
        self._gear = gear
        self._on_their_way: deque[tuple[float, float]] = deque()

    def order(self, time: float, order: float, rudder: float) -> float:
        """Return what the gear makes of the `order` [rad], the rudder being at `rudder` [rad]."""
        faults = self._faults
        if (late := faults.size("rudder_late", time)) is None:
            self._on_their_way.clear()
        else:
            order = delayed(self._on_their_way, time, order, late)
        if faults.is_on("rudder_reversed", time):
            order = -order
        if (offset := faults.size("rudder_offset", time)) is not None:
            order += math.radians(offset)
        if (side := faults.size("rudder_hard_over", time)) is not None:
            order = math.copysign(self._gear.angle_max, side)
        if (play := faults.size("rudder_play", time)) is not None:
            # the gear drags the rudder along at either end of the play
            half = math.radians(play)
            order = clip(rudder, order - half, order + half)
        return order

    def reached(self, time: float, before: float, after: float, dt: float) -> float:
        """Return where the rudder [rad] really is after a step of `dt` [s] from `before` to `after`."""
        faults = self._faults
        if faults.is_on("rudder_stuck", time):
            return before
        if faults.is_on("rudder_free", time):
            return before * math.exp(-dt / TRAILING_S)
        if (share := faults.size("rudder_slow", time)) is not None:
            rate = self._gear.rate_max if math.isfinite(self._gear.rate_max) else math.radians(20.0)
            after = clip(after, before - share * rate * dt, before + share * rate * dt)
        if (stop := faults.size("rudder_limited", time)) is not None:
            after = clip(after, -math.radians(stop), math.radians(stop))
        return after


def thrust_left(faults: FaultBoard, time: float, thrust_speed: float, cruise_speed: float) -> float:
    """Return the speed [m/s] that the engine would reach, with its faults."""
    if faults.is_on("engine_stopped", time):
        return 0.0
    astern = faults.size("engine_astern", time)
    return thrust_speed if astern is None else -astern * cruise_speed


class Pushes:
    """What acts on the boat from outside, with what is injected. Memory: where a stream sets to."""

    def __init__(self, faults: FaultBoard) -> None:
        self._faults = faults
        self._towards: float | None = None

    def on(self, time: float, heading: float, disturbance: Disturbance) -> Disturbance:
        """Return the `disturbance` of a boat that heads for `heading` [rad], and the pushes on top of it."""
        faults = self._faults
        if (push := faults.size("yaw_push", time)) is not None:
            disturbance = disturbance._replace(rudder=disturbance.rudder + math.radians(push))
        if (heel := faults.size("heel", time)) is not None:
            disturbance = disturbance._replace(roll_slope=disturbance.roll_slope + math.radians(heel))
        if (stream := faults.size("stream", time)) is None:
            self._towards = None
            return disturbance
        self._towards = towards = heading if self._towards is None else self._towards
        return disturbance._replace(
            current_north=disturbance.current_north + stream * math.cos(towards),
            current_east=disturbance.current_east + stream * math.sin(towards),
        )


def delayed(waiting: deque[tuple[float, float]], time: float, value: float, delay: float) -> float:
    """Return the value that was `delay` [s] ago, the first of all where `waiting` does not go back so far.

    `waiting` holds (time [s], value), the oldest first; `value` is added to it.
    """
    waiting.append((time, value))
    while len(waiting) > 1 and waiting[1][0] <= time - delay + 1.0e-9:
        waiting.popleft()
    return waiting[0][1]


STICK_FULL_US = 500
SWITCH_LOW_US, SWITCH_HIGH_US = 1000, 2000
EMPTY_MV, FULL_MV = 10500, 12600
CAPACITY_MAH = 10000
ONCE: tuple[FaultKind, ...] = ("reboot", "mode", "disarm", "battery_low", "geofence", "shallow", "clock_step")
"""Faults that happen when they begin; the others last."""


def battery_mv(per_cent: float) -> int:
    """Return the voltage [mV] of a battery that is so full; linear, assumed."""
    return round(EMPTY_MV + (FULL_MV - EMPTY_MV) * per_cent / 100.0)


class VehicleFaults:
    """Called once a step, before the firmware reads its sticks. Memory: what had begun, and the sticks at rest."""

    def __init__(self, firmware: Firmware) -> None:
        self._firmware = firmware
        self._faults = firmware.world.faults
        self._begun: set[FaultKind] = set()
        self._rest: dict[int, int] = {}

    def work(self, time: float) -> None:
        """Do what the faults do at `time` [s]."""
        if not self._faults and not self._rest:
            return
        for kind in ONCE:
            size = self._faults.size(kind, time)
            if size is None:
                self._begun.discard(kind)
            elif kind not in self._begun:
                self._begun.add(kind)
                self._happen(kind, size, time)
        self._move_sticks(time)
        self._firmware.receiver = self._firmware.has_receiver and not self._faults.is_on("receiver_lost", time)

    def _happen(self, kind: FaultKind, size: float, time: float) -> None:
        firmware = self._firmware
        if kind == "reboot":
            firmware.reboot(time)
        elif kind == "mode":
            firmware.set_mode(round(size))
        elif kind == "disarm":
            firmware.set_armed(False)
        elif kind == "clock_step":
            firmware.boot_time -= size
        elif kind == "geofence":
            firmware.notices.append((5, "Polygon fence breached"))
        elif kind == "shallow":
            firmware.notices.append((4, f"Shallow water {size:.1f} m"))
        else:
            volts, used = battery_mv(size) / 1000.0, CAPACITY_MAH * (1.0 - size / 100.0)
            firmware.notices.append((4, f"Battery 1 is low {volts:.2f}V used {used:.0f} mAh"))

    def _move_sticks(self, time: float) -> None:
        """Put the sticks where the faults have them, and back to where they were."""
        setup = self._firmware.setup
        wanted: dict[int, int] = {}
        if (share := self._faults.size("stick", time)) is not None:
            # a hand that grabs a stick moves both of its axes
            for channel in (setup.steering_channel, setup.pitch_channel):
                wanted[channel] = 1500 + round(share * STICK_FULL_US)
        if (share := self._faults.size("steering_stick", time)) is not None:
            wanted[setup.steering_channel] = 1500 + round(share * STICK_FULL_US)
        if (pulse_us := self._faults.size("receiver_low", time)) is not None:
            wanted[setup.throttle_channel] = round(pulse_us)
        if self._faults.is_on("switch", time) and setup.override_switch is not None:
            wanted[setup.override_switch] = SWITCH_LOW_US
        sticks = self._firmware.sticks
        for channel in [channel for channel in self._rest if channel not in wanted]:
            sticks[channel - 1] = self._rest.pop(channel)
        for channel, pulse in wanted.items():
            # a switch that was never touched rests in between, where it allows nothing anew
            is_switch = channel == setup.override_switch
            self._rest.setdefault(channel, SWITCH_HIGH_US if is_switch else sticks[channel - 1])
            sticks[channel - 1] = pulse
