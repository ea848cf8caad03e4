"""Recordings that cannot be used: one sentence, with file, line, column, and what to do."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from zigzag_trials import zigzag

from autopilot.errors import InputError
from autopilot.identification.runs import run_from_columns
from autopilot.loop.csv_log import COLUMNS, STEADY_TURN_NEEDS, load_column_map, read_csv
from autopilot.loop.recordings import load_run

HEADER = "time_s,heading_deg,yaw_rate_deg_s,rudder_deg,speed_kn"
GOOD = "\n".join([HEADER, *(f"{0.1 * i:.1f},350,1.5,-10,9" for i in range(20))]) + "\n"


def written(folder: Path, text: str, name: str = "log.csv") -> str:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return str(path)


def test_units_come_from_the_names(tmp_path: Path) -> None:
    table = read_csv(written(tmp_path, "# a trial\n" + GOOD))
    assert table["heading_rad"][0] == pytest.approx(math.radians(350.0))
    assert table["yaw_rate_rad_s"][0] == pytest.approx(math.radians(1.5))
    assert table["rudder_rad"][0] == pytest.approx(math.radians(-10.0))
    assert table["speed_m_s"][0] == pytest.approx(9.0 * 1852.0 / 3600.0)
    assert table["time_s"][-1] == pytest.approx(1.9)


def test_a_map_names_the_columns(tmp_path: Path) -> None:
    path = written(tmp_path, GOOD.replace("rudder_deg", "delta [deg]").replace("heading_deg", "psi"))
    lines = ['rudder_deg: "delta [deg]"', "heading_deg: psi", "time_s: time_s", "speed_kn: speed_kn"]
    column_map = load_column_map(written(tmp_path, "\n".join(lines), "map.yaml"))
    table = read_csv(path, column_map)
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
        (
            GOOD + "2.0,350,1.",
            r"line 22: has 3 cells where the header has 5 \(the last line: was the recording cut off",
        ),
        (GOOD + "2.0,350,abc,-10,9\n", r"line 22: 'abc' in column 'yaw_rate_deg_s' is not a number"),
        (GOOD + "2.0,350,inf,-10,9\n", r"line 22: 'inf' in column 'yaw_rate_deg_s' is not a finite number"),
        (GOOD + "2.0,350,1_0,-10,9\n", "line 22: '1_0' .* is not a finite number"),
        (GOOD + "0.5,350,1,-10,9\n", r"line 22: time 0.5 s does not come after 1.9 s of line 21"),
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
    table = read_csv(written(tmp_path, "rudder_deg,yaw_rate_deg_s\n5,3.38\n"), None, STEADY_TURN_NEEDS)
    assert set(table) == {"rudder_rad", "yaw_rate_rad_s"}


def test_every_known_column_has_its_unit_in_its_name() -> None:
    assert all(name.endswith(("_s", "_rad", "_deg", "_m_s", "_kn", "_rps", "_n", "_m")) for name in COLUMNS)


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


def test_columns_that_never_overlap_are_refused() -> None:
    table = {k: v.copy() for k, v in zigzag(0.2, 20.0, 0.1).items()}
    table["rudder_rad"][:100] = np.nan
    table["speed_m_s"][100:] = np.nan
    with pytest.raises(InputError, match="no stretch of 8 samples"):
        run_from_columns("halves", table)
    with pytest.raises(InputError, match="no row has a time"):
        run_from_columns("timeless", {**table, "time_s": np.full(table["time_s"].size, np.nan)})
