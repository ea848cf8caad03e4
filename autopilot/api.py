"""The public Python interface: read a log, identify, design, step a pilot, run it on links.

What stands in `__all__` here, and `sitl.simulate`, is kept stable as docs/support.md says; everything else may change.
Each name is also to be had from `autopilot` itself: `from autopilot import identify`. All of it raises `InputError`
where a file or a number cannot be used, and `LinkError` where a link fails.
"""

from __future__ import annotations

import dataclasses
import datetime
import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from autopilot.angles import wrap
from autopilot.control.registry import LAWS, filed_laws
from autopilot.errors import InputError
from autopilot.identification.identified import Identified, Question
from autopilot.identification.model_choice import filed_model
from autopilot.identification.ordered_rudder import identified_behind, slower_rudder, with_rate
from autopilot.identification.registry import method_named
from autopilot.identification.runs import Run
from autopilot.identification.verdict import Verdict, verdict_on_runs
from autopilot.links.base import LinkError
from autopilot.logs.reading import LogOptions, ReadOptions, load_run
from autopilot.pilot import Pilot
from autopilot.runtime.app import App, Plan
from autopilot.runtime.build import build_pilot
from autopilot.runtime.build_links import LinkOptions
from autopilot.runtime.log_files import log_file
from autopilot.runtime.machine import MonotonicClock
from autopilot.runtime.record import read_log as _read_own_log
from autopilot.runtime.tuning import GainRequest, designed
from autopilot.signals import HeadingSample, Mode, Order, OrderKind, RateSample, RudderSample, SpeedSample, Tick
from autopilot.vessel.file import boats_prior, dump_vessel, load_vessel, model_section, recorded_vessel, rounded
from autopilot.vessel.schema import Vessel

__all__ = [
    "HeadingSample",
    "Identified",
    "InputError",
    "LinkError",
    "Mode",
    "Order",
    "OrderKind",
    "Pilot",
    "RateSample",
    "RudderSample",
    "Run",
    "SpeedSample",
    "Tick",
    "Verdict",
    "Vessel",
    "design",
    "heading_order",
    "identify",
    "load_vessel",
    "pilot_for",
    "read_log",
    "read_ticks",
    "run",
    "save_vessel",
    "verdict",
    "with_model",
]

Orders = Callable[[float, Tick | None], Order]
"""What moves the order: given the time [s] and the last tick, it returns the order in force."""


def read_log(path: str | Path, *, vessel: Vessel | None = None, columns: Mapping[str, str] | None = None) -> Run:
    """Return what identification uses of a log of any kind that `autopilot log` reads: columns over time, in SI units
    and radians, heading unwrapped, rudder positive to starboard.

    vessel: whose servo, gear or thrusters make angles of the orders in a log that has no angle of the rudder. columns:
    what a CSV table calls them, by their names here: {"rudder_deg": "helm"}.
    """
    options = LogOptions(ReadOptions(columns))
    return load_run(str(path), options=options if vessel is None else options.of_vessel(vessel))


def read_ticks(path: str | Path) -> list[Tick]:
    """Return every tick of a log that Norrbin wrote: samples, order, estimate, reference, command, mode, alarms."""
    return [*_read_own_log(Path(path)).ticks]


def identify(*logs: Run | str | Path, vessel: Vessel | None = None, reference_speed: float | None = None) -> Identified:
    """Return Norrbin's model of the boat that sailed the `logs`, with its covariance and what the logs cannot tell: the
    answer of the command `identify`.

    vessel: the boat as its file says, for its length, its rudder's rate, and how `read_log` reads the logs; None: the
    one inside the logs, where there is one. reference_speed [m/s]: at which K, T and n3 hold; None: the logs' mean
    speed. What it is good for says `verdict`.
    """
    runs, boat = _recorded(logs, vessel, "identify")
    method = method_named(None)
    prior = None if boat is None or boat.length_m is None else boats_prior(boat.length_m, (boat.name,))
    question = Question(reference_speed=reference_speed, prior=prior)
    by_thrust = boat is not None and boat.drive.kind != "rudder"
    rate = slower_rudder(runs, _filed_rate(boat), by_thrust=by_thrust)
    if rate is None:
        return method.identify(runs, question)
    found, rate = identified_behind(runs, rate, lambda moved: method.identify(moved, question))
    if rate is None:
        return found
    at_speed = question._replace(reference_speed=found.model.reference_speed)
    return with_rate(found, runs, rate, lambda moved: method.identify(moved, at_speed))


def verdict(found: Identified, *logs: Run | str | Path, vessel: Vessel | None = None) -> Verdict:
    """Return what a model is good for: a grade ("good", "start", "not enough") and a sentence with what to do next.

    logs, vessel: those that were given to `identify`. No model is called good whose logs were not looked at: how well
    it predicts them, what is left over, and whether the rudder is the one in the vessel's file.
    """
    runs, boat = _recorded(logs, vessel, "verdict")
    return verdict_on_runs(found, runs, _filed_rate(boat))


def _recorded(logs: Sequence[Run | str | Path], vessel: Vessel | None, asks: str) -> tuple[list[Run], Vessel | None]:
    """Return the runs, and the boat that sailed them where it is known."""
    if not logs:
        raise InputError(f"{asks} needs the logs of the boat: {asks}(..., log)")
    runs = [log if isinstance(log, Run) else read_log(log, vessel=vessel) for log in logs]
    return runs, recorded_vessel(runs) if vessel is None else vessel


def _filed_rate(vessel: Vessel | None) -> float:
    return math.inf if vessel is None else vessel.rudder.slower_rate


def with_model(vessel: Vessel, found: Identified) -> Vessel:
    """Return the vessel with the identified model and no gains, for those of the old model are another boat's. A rudder
    that turned out to be slower than its file says is so in the vessel too."""
    rudder, rate = vessel.rudder, found.rudder_rate
    if rate is not None:
        rudder = dataclasses.replace(rudder, rate_max_deg_s=rounded(math.degrees(rate.rate)), rate_port_deg_s=None)
    no_gains: dict[str, Any] = dict.fromkeys(filed_laws())
    control = dataclasses.replace(vessel.control, **no_gains)
    today = datetime.date.today().isoformat()
    filed = model_section(*filed_model(found), "identified", today)
    return dataclasses.replace(vessel, model=filed, rudder=rudder, control=control)


def design(vessel: Vessel, level: int = 5) -> Vessel:
    """Return the vessel with gains designed for its model, rudder and delays.

    level: 1 keeps the rudder quiet, 9 the course. Raises RefusedError where no gains keep their margins.
    """
    if level not in range(1, 10):
        raise InputError(f"level {level!r}: allowed is 1 to 9")
    return designed(vessel, GainRequest(level))


def save_vessel(vessel: Vessel, path: str | Path) -> None:
    """Write a vessel file; one that is there is replaced."""
    from autopilot.files.saving import save_text

    save_text(path, dump_vessel(vessel))


def pilot_for(vessel: Vessel, law: str | None = None) -> Pilot:
    """Return a pilot: `tick = pilot.step(now, samples, order)`. It has no clock and no link; the same inputs give the
    same commands."""
    if law is not None and law not in LAWS:
        raise InputError(f"law {law!r}: there are {', '.join(filed_laws())}")
    return build_pilot(vessel, law)


def heading_order(heading_deg: float, serial: int = 1) -> Order:
    """Return the order to hold a heading in degrees; a new `serial` is a new intention, which may engage."""
    if not math.isfinite(heading_deg):
        raise InputError(f"heading {heading_deg}: a number of degrees is needed")
    return Order(OrderKind.HEADING, wrap(math.radians(heading_deg)), serial=serial)


def run(
    vessel: Vessel, links: Sequence[str], orders: Orders, duration: float, log: str | Path | None = None
) -> list[Tick]:
    """Steer in real time over `links` (URLs as of `autopilot run`, ArduRover by the ground station's id) for `duration`
    [s]; return the ticks. On every way out the rudder is released. LinkError where no heading has come."""
    if isinstance(links, str):
        raise InputError(f"links {links!r}: several may be given, so write a list: [{links!r}]")
    if not 0.0 < duration < math.inf:
        raise InputError(f"duration {duration}: a number of seconds above 0 is needed")
    sink = None if log is None else (lambda: log_file(Path(log)))
    plan = Plan(vessel, orders, urls=tuple(links), options=LinkOptions(as_gcs=True), log=sink)
    ticks: list[Tick] = []

    def after(tick: Tick) -> bool:
        ticks.append(tick)
        return False

    with App(plan, MonotonicClock(1.0)) as app:
        app.run(duration, after)
    if not any(tick.state.valid for tick in ticks):
        raise LinkError(f"no heading came over {', '.join(links)} in {duration:g} s: is the boat on, and sends here?")
    return ticks
