"""Norrbin's own log as a recording: the samples that the pilot had, what it made of them, and what it commanded."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterable
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.control.registry import TRIAL_LAW
from autopilot.errors import InputError
from autopilot.estimation.estimator import estimated, first_state, with_command
from autopilot.links.mavlink.frames import MAGIC_V2, source_of
from autopilot.logs.series import (
    HEADING,
    ORDER,
    PILOT,
    RATE,
    RUDDER,
    SPEED,
    Gathered,
    LogFormat,
    ReadOptions,
    Recording,
    Series,
    on_one_clock,
    quantities_of,
    series_of,
)
from autopilot.logs.table import between, through_gear
from autopilot.logs.tlog import is_tlog
from autopilot.pilot_state import configured
from autopilot.runtime.build import gear_of, law_of, pilot_config
from autopilot.runtime.record import PAYLOAD_TYPE, Log, read_logs, read_packets
from autopilot.signals import RudderSample, Tick
from autopilot.vessel.file import parse_vessel


def is_own(data: bytes) -> bool:
    """Return whether a .tlog begins with a record of ours."""
    tunnel = dialect.MAVLINK_MSG_ID_TUNNEL.to_bytes(3, "little") + PAYLOAD_TYPE.to_bytes(2, "little")
    return data[8:9] == bytes([MAGIC_V2]) and data[15:20] == tunnel


def read_own(path: str, options: ReadOptions = ReadOptions()) -> Recording:  # noqa: B008 - immutable
    """Return the first run in a file that `--log` wrote, over the gaps that a full disk left. Raises InputError."""
    _check_system(path, options.system)
    logs = read_logs(Path(path), progress=options.progress)
    log: Log = logs[0]
    began = began_of(path, log)
    run = log.header.get("run")
    parts = [log]
    for each in logs[1:]:
        before = parts[-1].ticks.last
        follows = before is not None and each.ticks and each.ticks[0].number > before.number
        if run is not None and each.header.get("run") == run and follows:
            parts.append(each)
    notes = []
    if len(parts) > 1:
        missing = sum(b.ticks[0].number - a.ticks[-1].number - 1 for a, b in pairwise(parts))
        notes.append(f"{path}: ticks missing in it: {missing}; the disk did not take them, or it is damaged there.")
    if len(parts) < len(logs):
        notes.append(f"{path}: holds other runs too; the first is read.")
    series = _series(tick for part in parts for tick in part.ticks)
    late = math.nan
    if options.path_delay:
        # a header that is not understood any more holds nothing else up
        with contextlib.suppress(InputError):
            late = path_in(path, log).measured
    vessel = log.header.get("vessel", "")
    as_filed = _by_filed_gear(path, series, str(vessel))
    if as_filed is not None:
        series = as_filed
        notes.append(f"{path}: {BY_FILED_GEAR}")
    return on_one_clock(Recording(path, "Norrbin log", series, began, tuple(notes), vessel, late))


OTHER_GEAR = math.radians(2.0)
"""An estimate of the rudder that lies so far [rad] from where the filed gear takes it, rms, is of another gear. A pilot
that takes the filed one is as far off as a tick is long, 1 deg at 20 deg/s; another gear, half of an order."""
BY_FILED_GEAR = (
    "the pilot took the rudder for slower than its file says, by the file's model of the boat; here it is as it was "
    "ordered, through the file's steering gear."
)


def _by_filed_gear(path: str, series: tuple[Series, ...], vessel: str) -> tuple[Series, ...] | None:
    """Return the series with the rudder where the filed gear takes it under its orders; None where that is where the
    pilot believed it to be, or a sensor shows it, or nothing says what the gear is.

    A pilot that sees its boat turn late believes in a slower gear, by the model in its file. Where that is a guess, so
    is the rudder, and a boat that is identified by it is the guess again.
    """
    orders = next((each for each in series if each.quantity == ORDER), None)
    believed = next((each for each in series if each.quantity == RUDDER and each.source == PILOT), None)
    if orders is None or believed is None or any(each.quantity == RUDDER and each is not believed for each in series):
        return None
    try:
        filed = parse_vessel(vessel, f"{path} (header)")
    except InputError:
        return None
    gear = gear_of(filed)
    if filed.drive.kind != "rudder" or not math.isfinite(gear.rate_max):
        return None
    moved = through_gear(orders, gear)
    off = between(moved, believed.time) - believed.values
    known = off[np.isfinite(off)]
    if not known.size or float(np.sqrt(np.mean(known * known))) < OTHER_GEAR:
        return None
    as_filed = moved._replace(quantity=RUDDER, source=PILOT)
    return tuple(as_filed if each is believed else each for each in series)


def _check_system(path: str, system: int | None) -> None:
    """Raise InputError where a system is asked for that has sent nothing of what is in the log."""
    if system is None:
        return
    heard = {source_of(packet).system for _, packet in read_packets(Path(path))}
    if system not in heard:
        known = ", ".join(map(str, sorted(heard)))
        raise InputError(f"{path}: holds no message of system {system}; it has them of {known}.")


def began_of(path: str, log: Log) -> float | None:
    """Return the Unix time of the loop clock's zero: from the tick's own record, stamped when it was made; None where
    no tick says."""
    if not log.ticks:
        return None
    stamp = next(stamp for stamp, _ in read_packets(Path(path)))
    began = stamp - log.ticks[0].now
    return began if math.isfinite(began) else None


def _series(ticks: Iterable[Tick]) -> tuple[Series, ...]:
    """Return the estimates, and the samples by source; headings and rates together, because the pilot hears one compass
    at a time."""
    estimates, found = Gathered[tuple[str, str]](), Gathered[tuple[str, str]]()
    compasses: dict[str, dict[str, None]] = {HEADING: {}, RATE: {}}
    for tick in ticks:
        estimates.put((RUDDER, PILOT), tick.now, tick.state.rudder)
        estimates.put((SPEED, PILOT), tick.now, tick.state.speed)
        estimates.put((ORDER, "commands"), tick.now, tick.command.angle if tick.command.engaged else math.nan)
        for sample in tick.samples:
            for quantity, value in quantities_of(sample):
                source = sample.source
                if quantity in compasses:
                    compasses[quantity][source] = None
                    source = ""
                found.put((quantity, source), sample.time, value)
    named = (
        (quantity, source or "+".join(compasses.get(quantity, {})), pairs)
        for (quantity, source), pairs in (*estimates.items(), *found.items())
    )
    return tuple(one for quantity, source, pairs in named for one in series_of(quantity, source, *pairs))


FORMAT = LogFormat(
    "",
    lambda data: is_tlog(data) and is_own(data),
    lambda path, data, options: read_own(path, options),
    packets=True,
    ticks=True,
    is_streamed=True,
)


class LoggedPath(NamedTuple):
    """How late orders came to the rudder in a recorded run [s]: measured, nan where it was not, and as filed."""

    measured: float
    filed: float


def path_of(path: str) -> LoggedPath:
    """Return how late orders came to the rudder in the first run of a file that `--log` wrote, by echo or sensor.

    Raises InputError.
    """
    return path_in(path, read_logs(Path(path))[0])


def path_in(path: str, log: Log) -> LoggedPath:
    """Return how late orders came to the rudder in a log that was read from `path`. Raises InputError."""
    vessel = parse_vessel(str(log.header.get("vessel", "")), f"{path} (header)")
    config = configured(pilot_config(vessel, TRIAL_LAW), law_of(vessel, TRIAL_LAW)).steering.estimator
    state = first_state(config)
    for tick in log.ticks:
        shown = tuple(sample for sample in tick.samples if isinstance(sample, RudderSample) and sample.time <= tick.now)
        state = estimated(config, state, tick.now, shown)
        with_command(state, tick.now, tick.command.angle, False, tick.command.engaged)
    return LoggedPath(state.path.delay, config.loop_delay)
