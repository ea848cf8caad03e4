"""A day of steering in lockstep, of which every tick is looked at: over a direct link, or with a flight controller."""

from __future__ import annotations

import gc
import math
import sys
import time
from array import array
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from endurance_page import Reading, reading_of
from lockstep import STEP, Lockstep
from manual_clock import ManualClock
from plant import Plant

from autopilot.links.base import Link
from autopilot.runtime.app import App, Plan
from autopilot.runtime.build import gear_of, model_of
from autopilot.runtime.log_files import FolderLimits, FolderSink
from autopilot.runtime.record import Recorder
from autopilot.signals import HelmSample, Mode, Order, OrderKind, RudderCommand, Sample, Tick
from autopilot.vessel.file import dump_vessel, load_vessel
from sitl.sea import Deviates

EVERY_S, FIRST_S = 600.0, 300.0
"""Readings, always in the middle of a leg: nothing of a turn, a fail-safe or a standby is held then."""
TURN_S, SILENT_S, STANDBY_S = 600.0, 1800.0, 3600.0
LIMITS = FolderLimits(total=40_000_000, part=4_000_000, free=0)
RELEASED_S = 1.0
"""A rudder that nobody steers is free after this time, or the release is missed."""
PERIODS_MISSED = 2.0
"""A tick so many control periods after the one before has missed its deadline."""


class DirectLink(Link):
    """A boat without a wire: its compass goes silent for five seconds every half hour."""

    name = "direct"

    def __init__(self) -> None:
        vessel = load_vessel("lanxin")
        self.plant = Plant(model_of(vessel), gear_of(vessel), heading_noise=0.005, rate_noise=0.003, step_max=0.025)
        self._command = RudderCommand(0.0, 0.0, False)

    @property
    def is_held(self) -> bool:
        """Whether the rudder is ours."""
        return self._command.engaged

    def receive(self, now: float) -> list[Sample]:
        if now > self.plant.time:
            self.plant.step(self._command.angle if self._command.engaged else 0.0, now - self.plant.time)
        seen = self.plant.sense()
        return [] if now % SILENT_S > SILENT_S - 5.0 else [*seen, HelmSample(now, True, "", self.name)]

    def send(self, now: float, command: RudderCommand) -> None:
        self._command = command


class Skipper:
    """A new heading every ten minutes, standby for the last minute of every hour, engaged anew after every trouble."""

    def __init__(self) -> None:
        self._serial = 0

    def __call__(self, now: float, tick: Tick | None) -> Order:
        if now % STANDBY_S > STANDBY_S - 60.0:
            return Order(serial=self._serial)
        if tick is not None and tick.mode in (Mode.FAILSAFE, Mode.OVERRIDE, Mode.STANDBY) and now % 10.0 < 0.1:
            self._serial += 1
        turn = int(now // TURN_S)
        return Order(
            OrderKind.HEADING, math.radians(40.0 * (turn % 3) - 60.0 * (turn % 2)), serial=max(1, self._serial)
        )


class Day:
    """Simulated hours of one session, whose log goes into a folder that is kept below its size."""

    def __init__(self, folder: Path, with_mavlink: bool) -> None:
        vessel = load_vessel("lanxin")
        self.folder = folder
        self.recorder = Recorder(FolderSink(folder, LIMITS), {"vessel": dump_vessel(vessel), "law": None}, 0.0)
        # numbers in one piece: a list of readings would itself be 30 blocks more every hour
        self._read = array("d")
        self.modes: dict[str, int] = {}
        self.sailed_s = 0.0
        self.ticks = self.missed = self.releases = self.kept_hold = 0
        self._wire = Lockstep(vessel, measured_every=5) if with_mavlink else None
        self._clock = ManualClock()
        self._last_mode, self._since, self._is_judged, self._last_tick = Mode.STANDBY, 0.0, True, 0.0
        if self._wire is not None:
            self.session = self._wire.session
            self.session._orders = Skipper()
        else:
            self._link = DirectLink()
            plan = Plan(vessel, Skipper(), links=(self._link,))
            self.session = App(plan, self._clock).session
        self.session._recorder = self.recorder

    @property
    def readings(self) -> list[Reading]:
        """What has been read so far."""
        width = len(Reading._fields)
        return [Reading(*self._read[at : at + width]) for at in range(0, len(self._read), width)]

    def sail(self, hours: float) -> None:
        """Sail so far."""
        step, started, due, now = (STEP if self._wire else 0.05), time.monotonic(), FIRST_S, 0.0
        while now < 3600.0 * hours:
            now = round(now + step, 9)
            self._advance(now)
            self.sailed_s = now
            if self.session.poll(now):
                self._look(now)
            if now >= due:
                due += EVERY_S
                gc.collect()
                blocks = sys.getallocatedblocks() - _random_numbers_in_stock()
                reading = reading_of(now / 3600.0, blocks=blocks)
                self._read.extend(reading)
                print(f"{reading}, {time.monotonic() - started:.0f} s", file=sys.stderr, flush=True)

    def _look(self, now: float) -> None:
        """Count what a tick shows."""
        tick = self.session.tick
        assert tick is not None
        self.ticks += 1
        self.missed += now - self._last_tick > PERIODS_MISSED / 20.0 + 1.0e-6
        self._last_tick = now
        if tick.mode is not self._last_mode:
            self._last_mode, self._since = tick.mode, now
            self.modes[tick.mode.name] = self.modes.get(tick.mode.name, 0) + 1
            self.releases += tick.mode is Mode.STANDBY
            self._is_judged = False
        if tick.mode is Mode.STANDBY and now - self._since >= RELEASED_S and not self._is_judged:
            self._is_judged = True
            self.kept_hold += self._is_held(now)

    def _is_held(self, now: float) -> bool:
        if self._wire is None:
            return self._link.is_held
        return bool(self._wire.firmware.overrides.active(now, 3.0))

    def _advance(self, now: float) -> None:
        if self._wire is None:
            self._clock.advance(now - self._clock.now())
        else:
            self._wire.clock.time = now
            self._wire.carry(now)


def _random_numbers_in_stock() -> int:
    """Return how many the simulator has drawn and not used: up to 1024 blocks that say nothing of the pilot."""
    return sum(len(each._waiting) for each in gc.get_objects() if isinstance(each, Deviates))
