"""What became of an upload, as a table for people and as JSON for programs."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Sequence

from autopilot.params.session import Vehicle
from autopilot.params.upload import Outcome, Verdict
from autopilot.params.value_coding import Number


def upload_table(
    outcomes: Sequence[Outcome], file: str, vehicle: Vehicle, backup: str | None, *, finished: bool
) -> str:
    """Return the table name, old, wanted, now, verdict, and a summary in words below it."""
    rows = [("name", "old", "wanted", "now", "verdict")]
    for each in outcomes:
        verdict = f"{each.verdict}: {each.reason}" if each.reason else str(each.verdict)
        rows.append((each.name, _number(each.old), _number(each.wanted), _number(each.now), verdict))
    widths = [max(len(row[column]) for row in rows) for column in range(4)]
    lines = [
        f"{row[0]:<{widths[0]}}  {row[1]:>{widths[1]}}  {row[2]:>{widths[2]}}  {row[3]:>{widths[3]}}  {row[4]}"
        for row in rows
    ]
    counts = Counter(each.verdict for each in outcomes)
    words = ", ".join(f"{counts[verdict]} {verdict}" for verdict in Verdict if counts[verdict])
    lines += ["", f"{file} -> vehicle {vehicle.system} ({vehicle.firmware}): {words}"]
    if not finished:
        lines.append("NOT FINISHED: the vehicle may hold old and new values; run the same command again.")
    if reboot := _reboot_names(outcomes):
        lines.append(f"takes effect after a reboot of the vehicle: {', '.join(reboot)}")
    if backup:
        lines.append(f"old values: {backup} (upload that file to go back)")
    return "\n".join(lines)


def upload_json(outcomes: Sequence[Outcome], file: str, vehicle: Vehicle, backup: str | None, *, finished: bool) -> str:
    """Return the same as a JSON object."""
    report = {
        "file": file,
        "vehicle": {"system": vehicle.system, "firmware": vehicle.firmware, "armed": vehicle.armed},
        "finished": finished,
        "backup": backup,
        "counts": Counter(str(each.verdict) for each in outcomes),
        "reboot": _reboot_names(outcomes),
        "parameters": [each._asdict() for each in outcomes],
    }
    return json.dumps(report, indent=2)


def _reboot_names(outcomes: Sequence[Outcome]) -> list[str]:
    return [each.name for each in outcomes if each.reboot and each.verdict in (Verdict.SET, Verdict.CONSTRAINED)]


def _number(value: Number | None) -> str:
    if value is None:
        return "-"
    return f"{value:.9g}" if isinstance(value, float) else str(value)
