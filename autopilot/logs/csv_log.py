"""Recordings as CSV tables: strict reading, columns named by quantity and unit, SI and radians out.

A column name states its unit (`rudder_deg`); a column map in YAML (`rudder_rad: delta_rudder [rad]`) names the
columns of files that call them otherwise. Lines that begin with # are comments.
"""

from __future__ import annotations

import csv
import difflib
import math
import re
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from autopilot.errors import InputError
from autopilot.files.outside import read_regular
from autopilot.files.printable import printable
from autopilot.files.strict_yaml import read_document
from autopilot.logs.series import (
    LARGEST,
    STEPS_S,
    LogFormat,
    Progress,
    Recording,
    check_steps,
    clock_of,
    counted,
    on_one_clock,
    series_of,
    silent,
)

KNOT_M_S = 1852.0 / 3600.0
NAMED_MOST, NAME_MOST, COMPARED_MOST = 30, 40, 1000
"""Columns that a refusal names, characters of each, and columns that are compared with a name that is missing."""


MOST_THRUSTERS = 8
THRUSTERS = range(1, MOST_THRUSTERS + 1)


class Column(NamedTuple):
    """The SI name that a column is read into, and what its numbers are multiplied by to get there."""

    si_name: str
    factor: float


COLUMNS: dict[str, Column] = {
    "time_s": Column("time_s", 1.0),
    "heading_rad": Column("heading_rad", 1.0),
    "heading_deg": Column("heading_rad", math.pi / 180.0),
    "yaw_rate_rad_s": Column("yaw_rate_rad_s", 1.0),
    "yaw_rate_deg_s": Column("yaw_rate_rad_s", math.pi / 180.0),
    "roll_rad": Column("roll_rad", 1.0),
    "roll_deg": Column("roll_rad", math.pi / 180.0),
    "rudder_rad": Column("rudder_rad", 1.0),
    "rudder_deg": Column("rudder_rad", math.pi / 180.0),
    "speed_m_s": Column("speed_m_s", 1.0),
    "speed_kn": Column("speed_m_s", KNOT_M_S),
    "propeller_rps": Column("propeller_rps", 1.0),
    "wind_speed_m_s": Column("wind_speed_m_s", 1.0),
    "wind_direction_rad": Column("wind_direction_rad", 1.0),
    "latitude_deg": Column("latitude_rad", math.pi / 180.0),
    "longitude_deg": Column("longitude_rad", math.pi / 180.0),
    **{f"thrust_{i}_n": Column(f"thrust_{i}_n", 1.0) for i in THRUSTERS},
    **{f"thrust_{i}_percent": Column(f"thrust_{i}_share", 0.01) for i in THRUSTERS},
    "position_x_m": Column("position_x_m", 1.0),
    "position_y_m": Column("position_y_m", 1.0),
    "north_m": Column("north_m", 1.0),
    "east_m": Column("east_m", 1.0),
}

SEPARATORS = ",;\t"
"""What may stand between cells. Where it is no comma, and no number has a point, commas are decimal commas."""
POINT = re.compile(r"\s*[-+]?(\d+\.\d*|\.\d+)([eE][-+]?\d+)?\s*")
"""A number with a point."""
Need = Sequence[Sequence[str]]
"""What a table must have: of each group of SI names, at least one."""

RUN_NEEDS: Need = (("time_s",), ("rudder_rad",), ("speed_m_s",), ("heading_rad", "yaw_rate_rad_s"))
STEADY_TURN_NEEDS: Need = (("rudder_rad",), ("yaw_rate_rad_s",))


def load_column_map(path: str) -> dict[str, str]:
    """Return the column map in a YAML file: quantity with unit -> column name in the CSV.

    Raises InputError where the file cannot be read, is not such a map, names an unknown quantity or unit, or
    names one quantity twice.
    """
    root = read_document(path)
    if not isinstance(root.value, dict):
        raise root.fault("a column map is lines such as 'rudder_rad: delta [rad]'; this is not one.")
    taken: dict[str, str] = {}
    for key, node in root.value.items():
        if key not in COLUMNS:
            raise node.key_fault(
                f"{key} is not a quantity with its unit{_nearest(key, list(COLUMNS))}; known are {', '.join(COLUMNS)}."
            )
        if not isinstance(node.value, str):
            raise node.fault(f"{key} must be the name of a column; put the name in quotes.")
        other = taken.setdefault(COLUMNS[key].si_name, key)
        if other != key:
            raise node.key_fault(f"{other} and {key} name the same quantity; keep one of them.")
    return {key: str(node.value) for key, node in root.value.items()}


FloatArray = NDArray[np.float64]
IntArray = NDArray[np.intp]


class Columns(NamedTuple):
    """Columns of one length under their SI names (`time_s`, `heading_rad`, `yaw_rate_rad_s`, `rudder_rad`,
    `speed_m_s`, ...), nan where a cell is blank; notes: sentences about rows out of order and times that jump."""

    columns: dict[str, FloatArray]
    notes: tuple[str, ...] = ()


def read_csv(
    path: str, column_map: Mapping[str, str] | None = None, needs: Need = RUN_NEEDS, progress: Progress = silent
) -> Columns:
    """Return the columns of a CSV file, their times on one clock.

    Without a map the columns that are named by quantity and unit are taken. Raises InputError, naming file,
    line and column, where the file cannot be read, is empty or cut off, lacks a column, has text where a number
    belongs, or has times of which the order is not understood or that cannot be those of a recording.
    """
    header, lines, rows = _rows(path, column_map is not None)
    places = _places(path, header, column_map, needs)
    columns = {name: np.empty(len(rows)) for name, _, _ in places}
    for row, (line, cells) in enumerate(counted(list(zip(lines, rows, strict=True)), progress)):
        for name, index, factor in places:
            columns[name][row] = _number(path, line, header[index], cells[index]) * factor
    if "time_s" not in columns:
        return Columns(columns)
    ordered, notes = _in_order(path, lines, columns)
    if not (time := ordered["time_s"]).size:
        return Columns(columns)
    clock = clock_of(path, time)
    return Columns({**ordered, "time_s": clock.read(time)}, (*notes, *clock.notes))


def _rows(path: str, is_mapped: bool) -> tuple[list[str], list[int], list[list[str]]]:
    """Return the header, and the line number and cells of every row below it. is_mapped: it is known for a table."""
    try:
        text = read_regular(path).decode("utf-8-sig")
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}; check the name and the rights.") from error
    except UnicodeDecodeError as error:
        raise InputError(
            f"{path}: is not a text file (byte {error.start}); a CSV table or a .tlog is needed."
        ) from error
    table: list[tuple[int, list[str]]] = []
    written = text.splitlines()
    head = next((each for each in written if each.strip() and not each.lstrip().startswith("#")), "")
    separator = max(SEPARATORS, key=re.sub('"[^"]*"', "", head).count)  # one in quotes is of a name
    reader = csv.reader(written, delimiter=separator)
    try:
        table = [(reader.line_num, row) for row in reader if row and not row[0].lstrip().startswith("#")]
    except csv.Error as error:
        raise InputError(f"{path}, line {reader.line_num}: is not CSV: {error}.") from error
    if not table:
        raise InputError(f"{path}: is empty; a CSV table with a header line is needed.")
    header = [name.strip() for name in table[0][1]]
    if not is_mapped and not _is_table(header, [cells for _, cells in table[1:]]):
        raise InputError(
            f"{path}: is text of no kind known here: its first line, '{printable(head.strip(), NAME_MOST)}', names "
            "none of a table's columns (time_s, heading_deg, rudder_deg, speed_m_s, ...); `autopilot log -h` lists "
            "what is read."
        )
    if len(table) == 1:
        raise InputError(f"{path}: has a header but no rows.")
    for line, cells in table[1:]:
        if len(cells) != len(header):
            last = " (the last line: was the recording cut off? delete it)" if line == table[-1][0] else ""
            raise InputError(f"{path}, line {line}: has {len(cells)} cells where the header has {len(header)}{last}.")
    rows = [cells for _, cells in table[1:]]
    if separator != "," and not any(POINT.fullmatch(cell) for cells in rows for cell in cells):
        # a date like 27.11.2026 has no say
        rows = [[cell if "." in cell else cell.replace(",", ".") for cell in cells] for cells in rows]
    return header, [line for line, _ in table[1:]], rows


def _is_table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> bool:
    """Return whether text is a table: it has a column that is known, or nearly, or several cells in all its lines."""
    if any(name in COLUMNS or _nearest(name, list(COLUMNS)) for name in header[:NAMED_MOST]):
        return True
    return len(header) > 1 and bool(rows) and all(len(cells) == len(header) for cells in rows)


def _places(
    path: str, header: Sequence[str], column_map: Mapping[str, str] | None, needs: Need
) -> list[tuple[str, int, float]]:
    """Return SI name, column index and factor of every column that is to be read."""
    wanted = column_map if column_map is not None else {name: name for name in COLUMNS if name in header}
    places: dict[str, tuple[str, int, float]] = {}
    for quantity, name in wanted.items():
        if name not in header:
            raise InputError(
                f"{path}: has no column '{name}' (for {quantity}){_nearest(name, header)}; its columns are "
                f"{_names(header)}."
            )
        if header.count(name) > 1:
            raise InputError(
                f"{path}: has {header.count(name)} columns named '{printable(name)}'; give them different names."
            )
        column = COLUMNS[quantity]
        if column.si_name in places:
            other = header[places[column.si_name][1]]
            raise InputError(f"{path}: '{other}' and '{name}' hold the same quantity; choose one with --columns.")
        places[column.si_name] = (column.si_name, header.index(name), column.factor)
    for group in needs:
        if not any(name in places for name in group):
            raise InputError(_missing(path, header, group, column_map is not None))
    return list(places.values())


def _missing(path: str, header: Sequence[str], group: Sequence[str], mapped: bool) -> str:
    names = [name for name, column in COLUMNS.items() if column.si_name in group]
    if mapped:
        return (
            f"{path}: the column map names none of {', '.join(names)}, and one of them is needed; the columns are "
            f"{_names(header)}."
        )
    near = next((hint for name in names if (hint := _nearest(name, header))), "")
    return (
        f"{path}: has no column {' or '.join(names)}{near}; its columns are {_names(header)}; name the right one "
        "in a map given by --columns."
    )


def _names(header: Sequence[str]) -> str:
    """Return the columns' names, the first of them where there are many."""
    more = f" and {len(header) - NAMED_MOST} more" if len(header) > NAMED_MOST else ""
    return ", ".join(printable(name, NAME_MOST) for name in header[:NAMED_MOST]) + more


def _nearest(name: str, choices: Sequence[str]) -> str:
    likely = [choice for choice in choices[:COMPARED_MOST] if len(choice) <= NAME_MOST]
    found = difflib.get_close_matches(name[:NAME_MOST], likely, n=1, cutoff=0.5)
    return f" (nearest: '{printable(found[0])}')" if found else ""


def _number(path: str, line: int, column: str, cell: str) -> float:
    """Return the number in a cell; a blank or nan is a missing sample."""
    text = cell.strip()
    if not text or text.lower() == "nan":
        return math.nan
    try:
        value = float(text)
    except ValueError as error:
        said = f"'{printable(text, NAME_MOST)}' in column '{printable(column, NAME_MOST)}'"
        raise InputError(f"{path}, line {line}: {said} is not a number.") from error
    if not abs(value) <= LARGEST or "_" in text:
        said = f"'{printable(text, NAME_MOST)}' in column '{printable(column, NAME_MOST)}'"
        raise InputError(f"{path}, line {line}: {said} is not a finite number of at most {LARGEST:g}.")
    return value


def _in_order(path: str, lines: Sequence[int], columns: dict[str, FloatArray]) -> Columns:
    """Return the rows that have a time, in its order, and what was done for that, a sentence each.

    A row that is there twice is taken once. Rows out of order are sorted where they fill holes between the others:
    where they lie between rows that are close enough already, the clock went back, and nobody knows which is when. Of
    the rows of one moment the last is taken, while they are few: many are stamps coarser than the rows.
    """
    rows = np.flatnonzero(np.isfinite(columns["time_s"]))
    time, notes = columns["time_s"][rows], []
    if np.any(np.diff(time) < STEPS_S[0]):
        table = np.nan_to_num(np.stack(list(columns.values()), axis=1)[rows], nan=2.0 * LARGEST)
        once = np.sort(np.unique(table, axis=0, return_index=True)[1])
        if repeats := rows.size - once.size:
            first = lines[int(np.setdiff1d(rows, rows[once])[0])]
            notes.append(f"{path}: {repeats} of {rows.size} rows are there twice and taken once (first line {first}).")
            rows, time = rows[once], time[once]
    if (late := np.flatnonzero(time < np.maximum.accumulate(time))).size:
        order = np.argsort(time, kind="stable")
        _check_order(path, [lines[row] for row in rows.tolist()], time, order, late)
        notes.append(
            f"{path}: {late.size} of {rows.size} rows were out of order and are sorted by their time (first line "
            f"{lines[rows[late[0]]]})."
        )
        rows, time = rows[order], time[order]
    if (same := np.flatnonzero(np.diff(time) < STEPS_S[0])).size and same.size <= SAME_SHARE * time.size:
        notes.append(
            f"{path}: {same.size} of {rows.size} rows have the time of the next one: the later is taken (first line "
            f"{lines[rows[same[0]]]})."
        )
        rows, time = np.delete(rows, same), np.delete(time, same)
    elif same.size and np.all(np.diff(time) > 0.0):
        check_steps(path, time)
    if np.any(np.diff(time) < STEPS_S[0]):
        at = int(same[0])
        raise InputError(
            f"{path}, line {lines[rows[at + 1]]}: time {time[at + 1]:g} s is that of line {lines[rows[at]]} too, and "
            f"so in {same.size} of {rows.size} rows: times must increase from row to row; record them with more digits."
        )
    if time.size:
        check_steps(path, time)
    return Columns({name: values[rows] for name, values in columns.items()}, tuple(notes))


SAME_SHARE, HOLE = 0.05, 1.5
"""Rows of one moment that are put up with, as a share of all; what lies around a row out of order must be so many usual
steps long, two where it was the only one there."""


def _check_order(path: str, lines: Sequence[int], time: FloatArray, order: IntArray, late: IntArray) -> None:
    """Raise InputError where the rows that are `late` fill no holes between the others, once all are in `order`."""
    sorted_ = time[order]
    places = np.argsort(order)[late]
    before, after = (sorted_[np.clip(places + step, 0, time.size - 1)] for step in (-1, 1))
    around = np.where((places == 0) | (places == time.size - 1), np.inf, after - before)
    steps = np.diff(sorted_)
    if np.median(around) < HOLE * np.median(steps[steps > 0.0]):
        at = int(late[0])
        raise InputError(
            f"{path}, line {lines[at]}: time {time[at]:g} s does not come after {time[at - 1]:g} s of line "
            f"{lines[at - 1]}: the clock went back, for other rows are as close to that time as rows are; it must "
            "increase from row to row: cut the table there."
        )


def read_table(path: str, column_map: Mapping[str, str] | None, progress: Progress = silent) -> Recording:
    """Return the recording in a CSV table. Raises InputError."""
    columns, notes = read_csv(path, column_map, (("time_s",),), progress)
    time = columns.pop("time_s")
    series = [s for name, values in columns.items() for s in series_of(name, "table", time, values)]
    return on_one_clock(Recording(path, "CSV table", tuple(series), None, notes))


FORMAT = LogFormat(
    "a CSV table",
    lambda data: True,
    lambda path, data, options: read_table(path, options.columns, options.progress),
    is_text=True,
    run=lambda path, options: read_csv(path, options.columns, RUN_NEEDS, options.progress),
)
"""What is text and nothing else: the last to be asked."""
