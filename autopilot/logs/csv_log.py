"""Recordings as CSV tables: strict reading, columns named by quantity and unit, SI and radians out.

A column name states its unit (`rudder_deg`); a column map in YAML (`rudder_rad: delta_rudder [rad]`) names the
columns of files that call them otherwise. Lines that begin with # are comments.
"""

from __future__ import annotations

import csv
import difflib
import math
import re
from array import array
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import chain, islice
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from autopilot.errors import InputError
from autopilot.files.outside import utf8_blocks, whole_lines
from autopilot.files.printable import printable
from autopilot.files.strict_yaml import read_document
from autopilot.logs.series import (
    LARGEST,
    SHOWN_SHARE,
    STEPS_S,
    LogFormat,
    Progress,
    Recording,
    check_steps,
    clock_of,
    from_zero,
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


class Place(NamedTuple):
    """A column that is to be read: its SI name, where it stands in a row, and its factor."""

    name: str
    at: int
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
            raise node.key_fault(_unknown(key))
        if not isinstance(node.value, str):
            raise node.fault(f"{key} must be the name of a column; put the name in quotes.")
        other = taken.setdefault(COLUMNS[key].si_name, key)
        if other != key:
            raise node.key_fault(f"{other} and {key} name the same quantity; keep one of them.")
    return {key: str(node.value) for key, node in root.value.items()}


def _unknown(key: str) -> str:
    return f"{key} is not a quantity with its unit{_nearest(key, list(COLUMNS))}; known are {', '.join(COLUMNS)}."


FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


class Columns(NamedTuple):
    """Columns of one length under their SI names (`time_s`, `heading_rad`, `yaw_rate_rad_s`, `rudder_rad`,
    `speed_m_s`, ...), nan where a cell is blank; notes: sentences about rows out of order, times that jump, and a last
    line that is cut off."""

    columns: dict[str, FloatArray]
    notes: tuple[str, ...] = ()


def read_csv(
    path: str, column_map: Mapping[str, str] | None = None, needs: Need = RUN_NEEDS, progress: Progress = silent
) -> Columns:
    """Return the columns of a CSV file, their times on one clock.

    Without a map the columns that are named by quantity and unit are taken. Raises InputError, naming file,
    line and column, where the file cannot be read, is empty, lacks a column, has text where a number
    belongs, or has times of which the order is not understood or that cannot be those of a recording.
    """
    table = _Table(path, progress, column_map, needs)
    lines, columns, notes = table.read()
    if "time_s" not in columns:
        return Columns(columns, tuple(notes))
    ordered, said = _in_order(path, lines, columns)
    notes += said
    if not (time := ordered["time_s"]).size:
        return Columns(columns, tuple(notes))
    clock = clock_of(path, time)
    return Columns({**ordered, "time_s": clock.read(time)}, (*notes, *clock.notes))


Row = tuple[int, list[str]]
"""A row's line number and cells."""
LEAST_BLOCK = 1024
TOGETHER = 4096
"""Rows that are turned into numbers together."""
SIGNED_NAN = re.compile("[-+]nan", re.IGNORECASE)


class _Table:
    """A table that is read block by block, so that only its numbers are held. Raises InputError.

    Plain lines of numbers are read at once; what is not certain to be that, cell by cell, by the rules of CSV.
    """

    def __init__(self, path: str, progress: Progress, column_map: Mapping[str, str] | None, needs: Need) -> None:
        self._path, self._progress = path, progress
        self._number = 0
        """Lines before those that are looked at."""
        self._is_cut = False
        self._notes: list[str] = []
        self._blocks = self._read_blocks()
        self._separator, self._header, rest = self._opening()
        self._blocks = chain((rest,), self._blocks)
        rows = (cells for block in self._blocks for _, cells in self._rows(block))
        if column_map is None and not _is_table(self._header, rows):
            head = printable(self._separator.join(self._header), NAME_MOST)
            raise InputError(
                f"{path}: is text of no kind known here: its first line, '{head}', names none of a table's columns "
                "(time_s, heading_deg, rudder_deg, speed_m_s, ...); `autopilot log -h` lists what is read."
            )
        self._places = _places(path, self._header, column_map, needs)
        self._has_points = self._separator == ","
        self._comma: tuple[int, str, str] | None = None
        """Where the first number with a comma stands: line, column, cell."""

    def read(self) -> tuple[IntArray, dict[str, FloatArray], list[str]]:
        """Return the line number of each row, the columns that are to be read, and what is to be said of the file."""
        lines, columns = array("q"), [array("d") for _ in self._places]

        def take(numbers: IntArray, values: Sequence[FloatArray]) -> None:
            lines.frombytes(numbers.tobytes())
            for column, more in zip(columns, values, strict=True):
                column.frombytes(more.tobytes())

        for block in self._blocks:
            found = self._at_once(block)
            if found is not None:
                take(np.arange(self._number + 1, self._number + 1 + found.shape[0]), [*found.T])
                self._number += found.shape[0]
                continue
            rows = self._rows(block)
            while part := list(islice(rows, TOGETHER)):
                part = self._checked(part)
                take(np.array([line for line, _ in part], dtype=np.int64), self._cell_by_cell(part))
        if not lines:
            raise InputError(f"{self._path}: has a header but no rows.")
        # views, no copies
        numbers = {place.name: np.frombuffer(column) for place, column in zip(self._places, columns, strict=True)}
        return np.frombuffer(lines, dtype=np.int64), numbers, self._notes

    def _read_blocks(self) -> Iterator[str]:
        path, place = self._path, 0
        try:
            size = Path(path).stat().st_size
            for block in whole_lines(utf8_blocks(path, max(size // SHOWN_SHARE, LEAST_BLOCK))):
                self._progress(min(place, size), size)
                text = block.decode()
                place += len(block)
                if not block.endswith((b"\n", b"\r")):
                    self._is_cut = True
                    if text.endswith("\0"):
                        self._notes.append(f"{path}: ends in zeros, as a power cut leaves them; its end is missing.")
                    text = text.rstrip("\0")
                yield text
        except OSError as error:
            raise InputError(f"{path}: cannot be read: {error.strerror}; check the name and the rights.") from error
        except UnicodeDecodeError as error:
            raise InputError(
                f"{path}: is not a text file in UTF-8 (byte {place + error.start}); save a table as CSV in UTF-8."
            ) from error

    def _opening(self) -> tuple[str, list[str], str]:
        """Return the separator, the names in the first row, and what follows it in its block."""
        for block in self._blocks:
            lines = block.splitlines(keepends=True)
            named = (at for at, each in enumerate(lines) if each.strip() and not each.lstrip().startswith("#"))
            if (at := next(named, None)) is not None:
                # one in quotes is of a name
                separator = max(SEPARATORS, key=re.sub('"[^"]*"', "", lines[at]).count)
                reader = csv.reader((line.rstrip("\r\n") for line in lines[at:]), delimiter=separator)
                try:
                    header = next(reader)
                except csv.Error as error:
                    raise InputError(f"{self._path}, line {at + reader.line_num}: is not CSV: {error}.") from error
                self._number += at + reader.line_num
                return separator, [name.strip() for name in header], "".join(lines[at + reader.line_num :])
            self._number += len(lines)
        raise InputError(f"{self._path}: is empty; a CSV table with a header line is needed.")

    def _at_once(self, block: str) -> NDArray[np.float64] | None:
        """Return the numbers in a block of plain lines, a row each; None where it holds anything else."""
        separator = self._separator
        if self._is_cut or '"' in block or "#" in block or SIGNED_NAN.search(block) is not None:
            return None
        if not self._has_points:
            if "." in block or (self._comma is None and "," in block):
                return None
            block = block.replace(",", ".")
        block = block.replace("\r\n", "\n")
        marks = np.frombuffer(block.encode(), np.uint8)
        ends = np.flatnonzero(marks == ord("\n"))
        before = np.cumsum(marks == ord(separator), dtype=np.int32)[ends]
        if not ends.size or np.any(np.diff(before, prepend=np.int32(0)) != len(self._header) - 1):
            return None
        for _ in range(2):  # neighbours share a separator
            block = block.replace(separator + separator, f"{separator}nan{separator}")
        block = f"\n{block}".replace(f"\n{separator}", f"\nnan{separator}").replace(
            f"{separator}\n", f"{separator}nan\n"
        )
        lines = block.splitlines()[1:]
        if len(lines) != ends.size:
            return None
        wanted = [place.at for place in self._places]
        try:
            found = np.loadtxt(lines, delimiter=separator, comments=None, usecols=wanted, ndmin=2)
        except ValueError:
            return None
        if len(found) != len(lines) or np.any(np.abs(found) > LARGEST):
            return None
        return np.asarray(found * np.array([place.factor for place in self._places]))

    def _rows(self, block: str) -> Iterator[Row]:
        """Yield the rows in a block but blank ones and comments, and where something is in quotes, which may go on
        behind its end, those of all that follow."""
        before = self._number
        blocks = chain((block,), self._blocks) if '"' in block else (block,)
        reader = csv.reader((line for each in blocks for line in each.splitlines()), delimiter=self._separator)
        try:
            for row in reader:
                if row and not row[0].lstrip().startswith("#"):
                    yield before + reader.line_num, row
        except csv.Error as error:
            raise InputError(f"{self._path}, line {before + reader.line_num}: is not CSV: {error}.") from error
        self._number = before + reader.line_num

    def _checked(self, rows: list[Row]) -> list[Row]:
        """Return rows of as many cells as the header, numbers with points, without a last one that is cut off."""
        wanted = len(self._header)
        if self._is_cut and self._is_torn(*rows[-1]):
            self._notes.append(
                f"{self._path}: its last line, {rows[-1][0]}, is cut off and left out; its end is missing."
            )
            rows = rows[:-1]
        for line, cells in rows:
            if len(cells) != wanted:
                raise InputError(f"{self._path}, line {line}: has {len(cells)} cells where the header has {wanted}.")
        if not self._has_points:
            # a date like 27.11.2026 has no say
            self._has_points = any("." in cell and POINT.fullmatch(cell) for _, cells in rows for cell in cells)
            if self._has_points and self._comma is not None:
                _number(self._path, *self._comma)
        if self._has_points:
            return rows
        if self._comma is None:
            places = ((line, self._header[at], cells[at]) for line, cells in rows for _, at, _ in self._places)
            self._comma = next((each for each in places if "," in each[2]), None)
        return [(line, [cell if "." in cell else cell.replace(",", ".") for cell in cells]) for line, cells in rows]

    def _is_torn(self, line: int, cells: Sequence[str]) -> bool:
        """Return whether a row lacks cells, or ends in the midst of a number."""
        at = len(cells) - 1
        if at + 1 == len(self._header) and at in [place.at for place in self._places]:
            try:
                _number(self._path, line, self._header[at], cells[at].replace(",", "."))
            except InputError:
                return True
        return at + 1 < len(self._header)

    def _cell_by_cell(self, rows: Sequence[Row]) -> list[FloatArray]:
        """Return the numbers in rows, column by column."""
        found = []
        for _, at, factor in self._places:
            values = _plain_numbers([row[at] for _, row in rows])
            if values is None:
                break
            found.append(values * factor)
        if len(found) == len(self._places):
            return found
        # one by one, so that the first that is none is named
        numbers = [
            [_number(self._path, line, self._header[at], row[at]) for _, at, _ in self._places] for line, row in rows
        ]
        return [
            np.array(column) * place.factor
            for column, place in zip(zip(*numbers, strict=True), self._places, strict=True)
        ]


def _plain_numbers(cells: Sequence[str]) -> FloatArray | None:
    """Return the numbers in cells as `_number` has them, nan where one is empty; None where that is not certain."""
    try:
        values = np.array([float(cell) if cell else math.nan for cell in cells])
    except ValueError:
        return None
    odd = np.flatnonzero(~(np.abs(values) <= LARGEST))
    if "_" in "".join(cells) or any(cells[at].lower() not in ("", "nan") for at in odd.tolist()):
        return None
    return values


def _is_table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> bool:
    """Return whether text is a table: it has a column that is known, or nearly, or several cells in all its lines."""
    if any(name in COLUMNS or _nearest(name, list(COLUMNS)) for name in header[:NAMED_MOST]):
        return True
    return len(header) > 1 and {len(cells) for cells in rows} == {len(header)}


def _places(path: str, header: Sequence[str], column_map: Mapping[str, str] | None, needs: Need) -> list[Place]:
    """Return every column that is to be read."""
    wanted = column_map if column_map is not None else {name: name for name in COLUMNS if name in header}
    places: dict[str, Place] = {}
    for quantity, name in wanted.items():
        if quantity not in COLUMNS:
            raise InputError(f"{path}: {_unknown(quantity)}")
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
            other = header[places[column.si_name].at]
            raise InputError(f"{path}: '{other}' and '{name}' hold the same quantity; choose one with --columns.")
        places[column.si_name] = Place(column.si_name, header.index(name), column.factor)
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


def _in_order(path: str, lines: IntArray, columns: dict[str, FloatArray]) -> Columns:
    """Return the rows that have a time, in its order, and what was done for that, a sentence each.

    A row that is there twice is taken once. Rows out of order are sorted where they fill holes between the others:
    where they lie between rows that are close enough already, the clock went back, and nobody knows which is when. Of
    the rows of one moment the last is taken, while they are few: many are stamps coarser than the rows.
    """
    if np.all(np.diff(columns["time_s"]) >= STEPS_S[0]) and np.isfinite(columns["time_s"][0]):
        check_steps(path, columns["time_s"])
        return Columns(columns)
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
        _check_order(path, lines[rows], time, order, late)
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


def _check_order(path: str, lines: IntArray, time: FloatArray, order: IntArray, late: IntArray) -> None:
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
    return from_zero(Recording(path, "CSV table", tuple(series), None, notes))


FORMAT = LogFormat(
    "a CSV table",
    lambda data: True,
    lambda path, data, options: read_table(path, options.columns, options.progress),
    is_text=True,
    is_streamed=True,
    run=lambda path, options: read_csv(path, options.columns, RUN_NEEDS, options.progress),
)
"""What is text and nothing else: the last to be asked."""
