"""Replay: a log's inputs through a fresh pilot, its outputs compared bit for bit."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import NamedTuple

from autopilot.errors import InputError
from autopilot.runtime.build import build_pilot, law_of, pilot_config
from autopilot.runtime.log_files import following_parts
from autopilot.runtime.record import Log, is_headless, read_logs
from autopilot.signals import RudderCommand
from autopilot.vessel.file import parse_vessel


class ReplayResult(NamedTuple):
    """How many ticks were compared, whether all were identical, and where the first difference is."""

    ticks: int
    identical: bool
    first_difference: int | None
    detail: str


def replay(path: Path) -> ReplayResult:
    """Run every log in the file at `path`, and in the parts that follow it, again, each from its own header.

    What comes behind a gap is left out. Raises InputError.
    """
    count = 0
    logs = read_logs(*following_parts(path))
    if is_headless(logs[0]):
        part = logs[0].header["part"]
        raise InputError(f"{path}: is part {part} of a log; a replay starts with part 1, and needs all of them")
    for log in logs:
        if is_headless(log):
            continue
        count += len(log.ticks)
        difference = _first_difference(path, log)
        if difference is not None:
            return ReplayResult(count, False, *difference)
    return ReplayResult(count, True, None, "")


def _first_difference(path: Path, log: Log) -> tuple[int, str] | None:
    vessel = log.header.get("vessel")
    if not isinstance(vessel, str):
        raise InputError(f"{path}: its header names no vessel; it was written by another version")
    pilot = build_pilot(parse_vessel(vessel, f"{path} (header)"), log.header.get("law"))
    for place, recorded in enumerate(log.ticks):
        if place in log.changes:
            changed = parse_vessel(log.changes[place], f"{path} (change before tick {recorded.number})")
            law = log.header.get("law")
            pilot.reconfigure(pilot_config(changed, law), law_of(changed, law))
        tick = pilot.step(recorded.now, recorded.samples, recorded.order)
        if _bits(tick.command) != _bits(recorded.command) or tick.mode != recorded.mode:
            return recorded.number, (
                f"recorded {recorded.mode.name} {recorded.command.angle!r} rad, "
                f"replayed {tick.mode.name} {tick.command.angle!r} rad"
            )
    return None


def _bits(command: RudderCommand) -> bytes:
    return struct.pack("<dd?", command.time, command.angle, command.engaged)
