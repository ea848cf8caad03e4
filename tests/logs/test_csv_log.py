"""Recordings that cannot be used: one sentence, with file, line, column, and what to do."""

from __future__ import annotations

import math
import tracemalloc
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from boat_recordings import every, zigzag_boat
from hypothesis import given
from hypothesis import strategies as st
from zigzag_trials import zigzag

from autopilot.errors import InputError
from autopilot.files import outside
from autopilot.files.outside import BLOCK
from autopilot.identification.identified import Question
from autopilot.identification.identify import identify
from autopilot.identification.runs import run_from_columns
from autopilot.logs.csv_log import COLUMNS, STEADY_TURN_NEEDS, load_column_map, read_csv
from autopilot.logs.reading import LogOptions, info_of, load_run, read_recording
from autopilot.logs.series import FARTHEST_S, PAUSE_S, clock_of, duration
from autopilot.logs.table import RudderChoice, RudderSettings

HEADER = "time_s,heading_deg,yaw_rate_deg_s,rudder_deg,speed_kn"
GOOD = "\n".join([HEADER, *(f"{0.1 * i:.1f},350,1.5,-10,9" for i in range(20))]) + "\n"


def table_at(time: Callable[[int], float], count: int = 20) -> str:
    return "\n".join([HEADER, *(f"{time(i)!r},350,1.5,-10,9" for i in range(count))]) + "\n"


def written(folder: Path, text: str, name: str = "log.csv") -> str:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return str(path)


def test_units_come_from_the_names(tmp_path: Path) -> None:
    table, _ = read_csv(written(tmp_path, "# a trial\n" + GOOD))
    assert table["heading_rad"][0] == pytest.approx(math.radians(350.0))
    assert table["yaw_rate_rad_s"][0] == pytest.approx(math.radians(1.5))
    assert table["rudder_rad"][0] == pytest.approx(math.radians(-10.0))
    assert table["speed_m_s"][0] == pytest.approx(9.0 * 1852.0 / 3600.0)
    assert table["time_s"][-1] == pytest.approx(1.9)


@pytest.mark.parametrize("separator", [";", "\t"])
@pytest.mark.parametrize("point", [".", ","])
def test_a_spreadsheet_of_another_country_is_the_same_table(tmp_path: Path, separator: str, point: str) -> None:
    there = GOOD.replace(",", separator).replace(".", point)
    ours, theirs = read_csv(written(tmp_path, GOOD)), read_csv(written(tmp_path, there))
    assert ours.columns.keys() == theirs.columns.keys()
    assert all((ours.columns[name] == theirs.columns[name]).all() for name in ours.columns)


def test_points_of_a_date_are_none_of_a_number(tmp_path: Path) -> None:
    head, *rows = GOOD.replace(",", ";").replace(".", ",").splitlines()
    dated = "\n".join([f"date;{head}", *(f"27.11.2026;{row}" for row in rows)]) + "\n"
    ours, theirs = read_csv(written(tmp_path, GOOD)), read_csv(written(tmp_path, dated))
    assert all((ours.columns[name] == theirs.columns[name]).all() for name in ours.columns)
    with pytest.raises(InputError, match=r"'1\.350,5' in column 'heading_deg' is not a number"):
        read_csv(written(tmp_path, dated.replace(";350", ";1.350,5", 1)))


@pytest.mark.parametrize("separator", [",", ";", "\t"])
def test_separators_in_a_quoted_name_part_no_cells(tmp_path: Path, separator: str) -> None:
    head, *rows = GOOD.replace(",", separator).splitlines()
    name = f'"a{9 * (";" if separator == "," else ",")}"'
    named = "\n".join([head + separator + name, *(f"{row}{separator}x" for row in rows)]) + "\n"
    ours, theirs = read_csv(written(tmp_path, GOOD)), read_csv(written(tmp_path, named))
    assert all((ours.columns[name] == theirs.columns[name]).all() for name in ours.columns)


def test_points_and_commas_in_one_table_are_not_guessed_at(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"line 2: '1\.350,5' in column 'heading_deg' is not a number"):
        read_csv(written(tmp_path, GOOD.replace(",", ";").replace("350", "1.350,5")))


def test_a_map_names_the_columns(tmp_path: Path) -> None:
    path = written(tmp_path, GOOD.replace("rudder_deg", "delta [deg]").replace("heading_deg", "psi"))
    lines = ['rudder_deg: "delta [deg]"', "heading_deg: psi", "time_s: time_s", "speed_kn: speed_kn"]
    column_map = load_column_map(written(tmp_path, "\n".join(lines), "map.yaml"))
    table, _ = read_csv(path, column_map)
    assert set(table) == {"time_s", "heading_rad", "rudder_rad", "speed_m_s"}
    assert table["rudder_rad"][3] == pytest.approx(math.radians(-10.0))


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "is empty"),
        ("# only a remark\n", "is empty"),
        (HEADER + "\n", "has a header but no rows"),
        (GOOD.replace("rudder_deg", "ruder_deg"), r"no column rudder_rad or rudder_deg \(nearest: 'ruder_deg'\)"),
        (GOOD.replace("speed_kn", "sog"), "no column speed_m_s or speed_kn.*its columns are time_s, .*--columns"),
        (GOOD + "2.0,350,1.\n", r"line 22: has 3 cells where the header has 5\."),
        (GOOD + "2.0,350,1,-10,9,7", r"line 22: has 6 cells where the header has 5\."),
        (GOOD + "2.0,350,abc,-10,9", r"line 22: 'abc' in column 'yaw_rate_deg_s' is not a number"),
        (HEADER + "\n2.0,350,1", "has a header but no rows"),
        (GOOD + "2.0,350,abc,-10,9\n", r"line 22: 'abc' in column 'yaw_rate_deg_s' is not a number"),
        (GOOD + "2.0,350,inf,-10,9\n", r"line 22: 'inf' in column 'yaw_rate_deg_s' is not a finite number"),
        (GOOD + "2.0,350,1_0,-10,9\n", "line 22: '1_0' .* is not a finite number"),
        (GOOD + "0.5,350,1,-10,9\n", r"line 22: time 0.5 s does not come after 1.9 s of line 21"),
        (
            "\n".join([HEADER, *(f"{i // 5},350,{i},-10,9" for i in range(20))]),
            "line 3: time 0 s is that of line 2 too, and so in 16 of 20 rows: .* more digits",
        ),
        (
            "\n".join([HEADER, *(f"{0.1 * (i % 10):g},350,{i},-10,9" for i in range(20))]),
            "line 12: time 0 s does not come after 0.9 s of line 11: the clock went back",
        ),
        (table_at(lambda i: 0.1 * (i - 10.5 * (i > 15))), "line 18: time 0.55 s does not come .*the clock went back"),
        (GOOD + "2.0,350,1e12,-10,9\n", "line 22: '1e12' in column 'yaw_rate_deg_s' is not a finite number of at most"),
        (
            table_at(lambda i: i * 1e-300),
            "cannot be those of a recording: 20 samples in 1.9e-299 s, 1e-300 s apart .* and 1e-300 s at least",
        ),
        (table_at(lambda i: 1e-9 * i), "20 samples in 1.9e-08 s, 1e-09 s apart"),
        (table_at(lambda i: 1e5 * i), r"20 samples in 1.9e\+06 s, 1e\+05 s apart"),
        (table_at(lambda i: max(i, 2.5e5 * (i - 24)), 40), "it is 43.4 days long, and 30 are the most; cut out"),
        (GOOD.replace("speed_kn", "rudder_deg"), "2 columns named 'rudder_deg'"),
        (GOOD.replace("yaw_rate_deg_s", "rudder_rad"), "hold the same quantity"),
        ('"' + GOOD, "has|is not CSV|columns"),
    ],
)
def test_a_table_that_cannot_be_used_is_refused_in_one_sentence(tmp_path: Path, text: str, sentence: str) -> None:
    path = written(tmp_path, text)
    with pytest.raises(InputError, match=sentence) as refusal:
        read_csv(path)
    assert str(refusal.value).startswith(path)
    assert str(refusal.value).endswith(".")
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize(
    "end", ["2.0,350,1.", "2.0,350,1,-10,", "2.0,350,1,-10,-", "2", "2.0,350,1\0\0\0", "\0\0\0\0\0"]
)
def test_a_last_line_that_is_cut_off_is_left_out_and_said(tmp_path: Path, end: str) -> None:
    whole, _ = read_csv(written(tmp_path, GOOD))
    path = written(tmp_path, GOOD + end, "cut.csv")
    table, notes = read_csv(path)
    if end.endswith(","):  # a blank is a cell
        assert notes == () and table["time_s"].size == 21
        return
    assert notes and all(note.startswith(f"{path}: ") and note.endswith("its end is missing.") for note in notes)
    assert all((table[name] == whole[name]).all() for name in whole)


def big_table(rows: int, blanks: bool = False) -> str:
    lines = (
        f"{0.1 * i:.1f},{'' if blanks and i % 4 else round(0.103 * i % 360, 3)},1.0{i % 7},-10,9" for i in range(rows)
    )
    return "\n".join([HEADER, *lines]) + "\n"


@pytest.mark.parametrize("blanks", [False, True])
def test_a_table_takes_three_times_the_memory_of_its_numbers_at_most(tmp_path: Path, blanks: bool) -> None:
    rows = 200_000
    path = written(tmp_path, big_table(rows, blanks))
    tracemalloc.start()
    try:
        run = load_run(path)
        read_and_made = tracemalloc.get_traced_memory()[1]
        del run
        tracemalloc.reset_peak()
        recording = read_recording(path)
        info_of(recording, RudderSettings())
        described = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    numbers = rows * 5 * 8
    # beside the numbers a few blocks of a megabyte, which a larger table does not have more of
    assert max(read_and_made, described) < 3 * numbers + 12 * BLOCK


@pytest.mark.parametrize("block", [16, 61, 1 << 20])
@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_blocks_of_any_size_make_the_same_table(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, block: int, end: str
) -> None:
    """Rows read at once and cell by cell, over the ends of blocks: a number is that of `float`, to the last bit."""
    random = np.random.default_rng(7)
    cells = [[f"{0.1 * i:.1f}", *(repr(value) for value in random.normal(size=4).tolist())] for i in range(60)]
    cells[11][2], cells[12][2], cells[30][4], cells[41][1] = "", "NaN", " 5 ", ""
    rows = [",".join(row) for row in cells]
    rows[50] = ",".join(f'"{cell}"' for cell in cells[50])
    monkeypatch.setattr(outside, "BLOCK", block)
    table, _ = read_csv(written(tmp_path, end.join([HEADER, "# remark", *rows[:25], "", *rows[25:], ""])))
    for at, name in enumerate(("time_s", "heading_deg", "yaw_rate_deg_s", "rudder_deg", "speed_kn")):
        expected = [float(row[at] or "nan") * COLUMNS[name].factor for row in cells]
        np.testing.assert_array_equal(table[COLUMNS[name].si_name], expected)


def test_a_number_that_is_none_is_named_in_any_block(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(outside, "BLOCK", 64)
    with pytest.raises(InputError, match=r"line 22: '-nan' in column 'heading_deg' is not a finite number"):
        read_csv(written(tmp_path, GOOD + "2.0,-nan,1,-10,9\n2.1,1,1,-10,9\n"))
    commas = GOOD.replace(",", ";").replace(".", ",")
    with pytest.raises(InputError, match=r"line 2: '0,0' in column 'time_s' is not a number"):
        read_csv(written(tmp_path, commas + "2.0;1;1;-10;9\n"))


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "utf-32", "utf-16-le", "utf-16-be"])
def test_a_table_in_another_encoding_of_unicode_is_the_same(tmp_path: Path, encoding: str) -> None:
    path = tmp_path / "wide.csv"
    path.write_bytes(GOOD.replace("speed_kn", "speed_kn,\u03b4 [\u00b0]").replace(",9\n", ",9,1\n").encode(encoding))
    ours, theirs = read_csv(written(tmp_path, GOOD)), read_csv(str(path))
    assert all((ours.columns[name] == theirs.columns[name]).all() for name in ours.columns)
    assert load_run(str(path)).segments[0].time.size == 20


ROWS = [f"{0.1 * i:.1f},350,{i},-10,9" for i in range(60)]


@pytest.mark.parametrize(
    ("rows", "note"),
    [
        ([*ROWS[:30], ROWS[29], *ROWS[30:]], "1 of 61 rows are there twice and taken once (first line 32)."),
        ([row for row in ROWS for _ in range(2)], "60 of 120 rows are there twice and taken once (first line 3)."),
        ([*ROWS[:20], *ROWS[23:30], *ROWS[20:23], *ROWS[30:]], "3 of 60 rows were out of order and are sorted by"),
        (ROWS[::-1], "59 of 60 rows were out of order and are sorted by their time (first line 3)."),
        ([*ROWS[:30], "2.9,350,99,-10,9", *ROWS[30:]], "1 of 61 rows have the time of the next one: the later is"),
    ],
)
def test_rows_twice_and_out_of_order_are_put_right_and_said(tmp_path: Path, rows: list[str], note: str) -> None:
    path = written(tmp_path, "\n".join([HEADER, *rows]))
    table, notes = read_csv(path)
    assert len(notes) == 1 and notes[0].startswith(f"{path}: {note}")
    np.testing.assert_allclose(table["time_s"], 0.1 * np.arange(60))
    rates = [99 if i == 29 and "later" in note else i for i in range(60)]
    np.testing.assert_allclose(np.degrees(table["yaw_rate_rad_s"]), rates)


def zigzag_csv(path: Path, clock: Callable[[int, float], float]) -> str:
    """Write a minute of a boat's zigzag at 10 Hz by the time clock(row, time) and return where."""
    boat = zigzag_boat(60.0, straight=2.0)
    rows = [
        f"{clock(row, float(boat.time[i]))!r},{math.degrees(boat.heading[i]):.3f},{math.degrees(boat.rudder[i]):.3f},3"
        for row, i in enumerate(every(boat, 10.0))
    ]
    path.write_text("\n".join(["time_s,heading_deg,rudder_deg,speed_m_s", *rows]))
    return str(path)


@pytest.mark.parametrize("rows_before", [300, 301, 200, 500])
def test_both_parts_of_a_recording_whose_clock_was_set_are_used(tmp_path: Path, rows_before: int) -> None:
    """A board without a clock of its own counts from 0 until the network tells it the time."""
    path = zigzag_csv(tmp_path / "set.csv", lambda row, t: t if row < rows_before else 1.78e9 + t)
    run, recording = load_run(path), read_recording(path)
    end, begin = (rows_before - 1) / 10, 1.78e9 + rows_before / 10
    for notes in (run.notes, recording.notes):
        (note,) = notes
        assert note.startswith(f"{path}: its clock jumps by 20602 days, from {end:.10g} s to {begin:.10g} s (")
    assert [segment.time.size for segment in run.segments] == [rows_before, 601 - rows_before]
    info = info_of(recording, RudderSettings())
    assert info.missing == "" and info.segments == 2 and info.usable == pytest.approx(59.9)
    assert info.duration == pytest.approx(59.9 + PAUSE_S)
    model = identify([run], Question("nomoto")).model
    assert (model.gain, model.time_constant) == pytest.approx((0.2, 5.0), rel=0.01)


def test_a_clock_that_was_set_twice_is_said_to_be(tmp_path: Path) -> None:
    path = zigzag_csv(tmp_path / "set.csv", lambda row, t: t + 4e5 * (row >= 100) + 1e9 * (row >= 400))
    run = load_run(path)
    assert [segment.time.size for segment in run.segments] == [100, 300, 201]
    assert "by 4.6296 days, from 9.9 s to 400010 s, and 1 times more (" in run.notes[0]


def test_a_few_rows_of_another_time_are_left_out_and_counted(tmp_path: Path) -> None:
    path = zigzag_csv(tmp_path / "boot.csv", lambda row, t: t if row < 5 else 1.78e9 + t)
    run, recording = load_run(path), read_recording(path)
    assert run.notes == (f"{path}: 5 of 601 samples are left out: their times are days off the rest.",)
    assert len(run.segments) == 1 and run.segments[0].time.size == 596
    assert recording.notes == (run.notes[0],)
    assert duration(recording) == pytest.approx(59.5)


def test_a_pause_of_a_day_is_a_gap_and_no_jump(tmp_path: Path) -> None:
    path = zigzag_csv(tmp_path / "pause.csv", lambda row, t: t + 86400.0 * (row >= 300))
    run = load_run(path)
    assert run.notes == () and len(run.segments) == 2
    assert read_recording(path).series[0].longest_gap == pytest.approx(86400.1)


@given(
    st.lists(st.tuples(st.floats(-1e11, 1e11), st.integers(1, 60)), min_size=1, max_size=6),
    st.floats(1e-3, 10.0),
)
def test_times_on_one_clock_keep_their_order_and_their_steps(parts: list[tuple[float, int]], step: float) -> None:
    times = np.unique(np.concatenate([begin + step * np.arange(count) for begin, count in parts]))
    try:
        clock = clock_of("x", times)
    except InputError as error:
        assert "days long" in str(error)
        return
    read = clock.read(times)
    kept = np.isfinite(read)
    assert kept.any()
    before, after = np.diff(times[kept]), np.diff(read[kept])
    near = before <= FARTHEST_S
    np.testing.assert_allclose(after[near], before[near], atol=1e-4)
    np.testing.assert_allclose(after[~near], PAUSE_S, atol=1e-4)
    assert len(clock.notes) == (not near.all()) + (not kept.all())


def test_files_that_are_no_text_or_not_there_are_named(tmp_path: Path) -> None:
    binary = tmp_path / "photo.csv"
    binary.write_bytes(b"\xff\xd8\xff\xe0")
    with pytest.raises(InputError, match=r"photo\.csv: is not a text file"):
        read_csv(str(binary))
    with pytest.raises(InputError, match=r"absent\.csv: cannot be read"):
        read_csv(str(tmp_path / "absent.csv"))
    with pytest.raises(InputError, match="cannot be read"):
        read_csv(str(tmp_path))


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("rudder: delta", r"line 1.*rudder is not a quantity with its unit \(nearest: 'rudder_"),
        ("rudder_rad: a\nrudder_deg: b", "line 2.*rudder_rad and rudder_deg name the same quantity"),
        ("rudder_rad: a\nrudder_rad: b", "twice"),
        ("rudder_rad: 5", "must be the name of a column"),
        ("- rudder_rad", "a column map is lines such as"),
        ("rudder_rad: [", "not valid YAML"),
    ],
)
def test_a_map_that_cannot_be_used_is_refused(tmp_path: Path, text: str, sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        load_column_map(written(tmp_path, text, "map.yaml"))


def test_a_map_to_a_column_that_is_not_there_offers_the_nearest(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"no column 'rudder' \(for rudder_rad\) \(nearest: 'rudder_deg'\)"):
        read_csv(written(tmp_path, GOOD), {"rudder_rad": "rudder"})
    with pytest.raises(InputError, match="the column map names none of rudder_rad, rudder_deg"):
        read_csv(written(tmp_path, GOOD), {"time_s": "time_s"})


def test_steady_turns_need_no_time(tmp_path: Path) -> None:
    table, _ = read_csv(written(tmp_path, "rudder_deg,yaw_rate_deg_s\n5,3.38\n"), None, STEADY_TURN_NEEDS)
    assert set(table) == {"rudder_rad", "yaw_rate_rad_s"}


def test_every_known_column_has_its_unit_in_its_name() -> None:
    assert all(name.endswith(("_s", "_rad", "_deg", "_m_s", "_kn", "_rps", "_n", "_m", "_percent")) for name in COLUMNS)


def test_headings_unwrap_and_blank_tails_fall_away(tmp_path: Path) -> None:
    rows = [f"{0.1 * i:.1f},{(350 + i) % 360},{10},{-5},{9}" for i in range(30)] + [",,,,"] * 5
    run = load_run(written(tmp_path, "\n".join([HEADER, *rows])))
    heading = run.segments[0].heading
    assert len(run.segments) == 1
    assert heading[-1] - heading[0] == pytest.approx(math.radians(29.0))
    reversed_run = load_run(written(tmp_path, "\n".join([HEADER, *rows])), reverse_rudder=True)
    np.testing.assert_array_equal(reversed_run.segments[0].rudder, -run.segments[0].rudder)


def test_inputs_are_bridged_over_short_blanks_only() -> None:
    table = {k: v.copy() for k, v in zigzag(0.2, 20.0, 0.1).items()}
    whole = table["speed_m_s"].size
    table["speed_m_s"][:] = np.where(np.arange(whole) % 4 == 0, 5.0, np.nan)  # a slower instrument
    table["rudder_rad"][80:83] = np.nan
    run = run_from_columns("slow speed", table)
    assert len(run.segments) == 1
    table["rudder_rad"][80:120] = np.nan
    first, second = run_from_columns("gap", table).segments
    assert first.time[-1] < 8.05
    assert second.time[0] > 11.95
    assert np.isfinite(first.rudder).all()


def test_a_table_too_short_or_without_a_rudder_says_so() -> None:
    table = zigzag(0.2, 20.0, 0.1)
    with pytest.raises(InputError, match=r"it has 3 samples in all: record"):
        run_from_columns("short", {name: values[:3] for name, values in table.items()})
    with pytest.raises(InputError, match=r"no sample of rudder_rad is a number"):
        run_from_columns("empty", {**table, "rudder_rad": np.full(table["time_s"].size, np.nan)})


def test_columns_that_never_overlap_are_refused() -> None:
    table = {k: v.copy() for k, v in zigzag(0.2, 20.0, 0.1).items()}
    table["rudder_rad"][:100] = np.nan
    table["speed_m_s"][100:] = np.nan
    with pytest.raises(InputError, match="no stretch of 8 samples"):
        run_from_columns("halves", table)
    with pytest.raises(InputError, match="no row has a time"):
        run_from_columns("timeless", {**table, "time_s": np.full(table["time_s"].size, np.nan)})


@pytest.mark.parametrize(
    ("kind", "choice", "origin"),
    [
        ("order", "auto", "ordered"),
        ("order", "measured", "measured"),
        ("angle", "auto", "measured"),
        ("quick angle", "auto", "measured"),
        ("angle once a second", "auto", "measured"),
        ("quick angle once a second", "auto", "measured"),
    ],
)
def test_a_rudder_that_jumps_and_stands_is_taken_for_ordered(
    tmp_path: Path, kind: str, choice: RudderChoice, origin: str
) -> None:
    """A sensor shows the rudder on its way, be it read less often than the table has rows, or its own noise."""
    boat = zigzag_boat(seconds=60.0, rudder_rate=math.radians(5.0 if kind != "quick angle once a second" else 15.0))
    noise = np.random.default_rng(2026112964)
    read = np.arange(boat.time.size) // 50 * 50
    rudder = {
        "order": boat.order,
        "angle": boat.rudder,
        "quick angle": boat.order,
        "angle once a second": boat.rudder[read],
        "quick angle once a second": boat.rudder[read],
    }[kind]
    if kind in ("angle", "quick angle"):
        rudder = rudder + math.radians(0.1) * noise.standard_normal(rudder.size)
    table = np.stack([boat.time, rudder, boat.heading, boat.speed], axis=1)[::5]
    path = tmp_path / "zigzag.csv"
    np.savetxt(path, table, delimiter=",", header="time_s,rudder_rad,heading_rad,speed_m_s", comments="")
    run = load_run(str(path), None, False, LogOptions(rudder=RudderSettings(choice)))
    assert run.rudder == origin
    assert any("as orders do" in note for note in run.notes) == (origin == "ordered")
