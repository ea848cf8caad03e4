"""What became of an upload, and what differs, as tables for people and as JSON for programs."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from autopilot.params.comparison import Difference
from autopilot.params.firmware_owned import LeftOut, sentence_of
from autopilot.params.outcome import Change, Outcome, Verdict
from autopilot.params.session import Vehicle
from autopilot.printable import escaped


class Report(NamedTuple):
    """What is said of an upload besides its outcomes: of which file, where the old values are, what was not written."""

    file: str
    backup: str | None = None
    finished: bool = True
    left_out: tuple[LeftOut, ...] = ()


def upload_table(outcomes: Sequence[Outcome], vehicle: Vehicle, report: Report) -> str:
    """Return the table name, old, wanted, now, verdict, and a summary in words below it."""
    rows = [("name", "old", "wanted", "now", "verdict")]
    for each in outcomes:
        verdict = f"{each.verdict}: {each.reason}" if each.reason else str(each.verdict)
        rows.append((each.name, value_text(each.old), value_text(each.wanted), value_text(each.now), verdict))
    lines = _columns(rows)
    counts = Counter(each.verdict for each in outcomes)
    words = ", ".join(f"{counts[verdict]} {verdict}" for verdict in Verdict if counts[verdict])
    lines += ["", f"{report.file} -> vehicle {vehicle.system} ({vehicle.firmware}): {words or 'nothing'}"]
    if report.left_out:
        lines.append(sentence_of(report.left_out))
    if not report.finished:
        lines.append("NOT FINISHED: the vehicle may hold old and new values.")
    if reboot := _reboot_names(outcomes):
        lines.append(f"takes effect after a reboot of the vehicle: {', '.join(reboot)}")
    if report.backup:
        lines.append(f"old values: {report.backup}")
    return "\n".join(lines)


def settled_table(changes: Sequence[Change], held: Mapping[str, Any]) -> str:
    """Return the table name, old, new, now of an upload that was cut off; `held` is what the vehicle holds now."""
    rows = [("name", "old", "new", "now")]
    rows += [
        (each.name, value_text(each.old), value_text(each.new), value_text(held.get(each.name))) for each in changes
    ]
    return "\n".join(_columns(rows))


def difference_table(found: Sequence[Difference], left: str, right: str) -> str:
    """Return the table name, left, right of everything that differs."""
    rows = [("name", left, right)]
    rows += [(each.name, value_text(each.left), value_text(each.right)) for each in found]
    return "\n".join([*_columns(rows), "", f"{len(found)} differ"])


def _columns(rows: Sequence[tuple[str, ...]]) -> list[str]:
    """Return the rows with the first column flush left, the last as it is and the others flush right; a line each."""
    rows = [tuple(map(escaped, row)) for row in rows]
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]) - 1)]
    lines = []
    for row in rows:
        middle = [f"{text:>{width}}" for text, width in zip(row[1:-1], widths[1:], strict=True)]
        lines.append("  ".join([f"{row[0]:<{widths[0]}}", *middle, row[-1]]).rstrip())
    return lines


def upload_json(outcomes: Sequence[Outcome], vehicle: Vehicle, report: Report) -> str:
    """Return the same as a JSON object."""
    document = {
        "file": report.file,
        "vehicle": {"system": vehicle.system, "firmware": vehicle.firmware, "armed": vehicle.armed},
        "finished": report.finished,
        "backup": report.backup,
        "counts": Counter(str(each.verdict) for each in outcomes),
        "reboot": _reboot_names(outcomes),
        "left_out": [{"name": each.name, "why": str(each.why)} for each in report.left_out],
        "parameters": [each._asdict() for each in outcomes],
    }
    return json.dumps(document, indent=2)


def _reboot_names(outcomes: Sequence[Outcome]) -> list[str]:
    return [each.name for each in outcomes if each.reboot and each.verdict in (Verdict.SET, Verdict.CONSTRAINED)]


def value_text(value: Any) -> str:
    """Return a value as tables show it: `-` for none, floats with the nine digits that 32 bits have."""
    if value is None:
        return "-"
    return f"{value:.9g}" if isinstance(value, float) else str(value)
