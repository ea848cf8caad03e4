"""`autopilot identify` as a user calls it: the published table, the real recordings, and files that are wrong."""

from __future__ import annotations

import errno
import json
import math
import os
from pathlib import Path
from typing import Any

import pytest
from zigzag_trials import zigzag

from autopilot.cli.main import main
from autopilot.errors import RefusedError
from autopilot.runtime import tuning
from autopilot.vessel import file
from autopilot.vessel.file import dump_vessel, load_vessel
from autopilot.vessel.schema import Vessel

DATA = Path(os.environ.get("NORRBIN_DATA", Path(__file__).parents[3] / "shared" / "data"))
ESSO = DATA / "frt_ds_esso"
needs_recordings = pytest.mark.skipif(not ESSO.is_dir(), reason=f"no recordings at {ESSO}: set NORRBIN_DATA")
TABLE_2 = "rudder_deg,yaw_rate_deg_s\n5,3.38\n8,3.461\n10,6.043\n15,9.774\n20,12.203\n25,14.486\n35,18.351\n"
MAP = """time_s: "t [s]"
heading_rad: "psi_hat [rad]"
yaw_rate_rad_s: "r_angvelo [rad/s]"
rudder_rad: "delta_rudder [rad]"
speed_m_s: "u_velo [m/s]"
"""


def run(capsys: pytest.CaptureFixture[str], *arguments: str) -> dict[str, Any]:
    assert main(["identify", *arguments, "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def test_the_published_steady_turns_give_n3_in_both_units(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    table = tmp_path / "table2.csv"
    table.write_text("# as printed\n" + TABLE_2)
    n3 = run(capsys, "--steady-turns", str(table), "--gain-1-s", "0.701")["parameters"]["n3"]
    assert n3["value_deg"] == pytest.approx(0.0010019, abs=5e-8)
    assert n3["value"] == pytest.approx(3.2890, abs=2e-4)
    assert n3["unit"] == "s^2/rad^2"


@needs_recordings
def test_the_real_boat_fitted_on_zigzags_predicts_its_turns(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "map.yaml").write_text(MAP)
    zigzags = [str(path) for path in sorted(ESSO.glob("zigzag*.csv"))]
    turns = [str(path) for path in sorted(ESSO.glob("turn*.csv"))]
    out = tmp_path / "esso.yaml"
    options = ["--columns", str(tmp_path / "map.yaml"), "--rudder-max-deg", "35", "--out", str(out)]
    found = run(capsys, *zigzags, *options, "--holdout", *turns)
    fitted = sorted(row["yaw_rate_r2"] for row in found["runs"] if row["role"] == "fit")
    held_out = [row["yaw_rate_r2"] for row in found["runs"] if row["role"] == "holdout"]
    assert len(fitted) == 4
    assert fitted[0] >= 0.78
    assert fitted[2] >= 0.92
    assert len(held_out) == 2
    assert min(held_out) >= 0.8
    # it cannot be determined, and is never negative
    assert found["parameters"]["n3"]["value"] >= 0.0
    assert "n3" in found["unidentifiable"]
    vessel = load_vessel(out)
    assert vessel.model.K_1_s == pytest.approx(found["parameters"]["K"]["value"], rel=1e-4)
    assert vessel.model.reference_speed_m_s == pytest.approx(found["reference_speed_m_s"], rel=1e-4)
    assert vessel.rudder.angle_max_deg == vessel.helm.rudder_at_full_pwm_deg == 35.0


GOOD = "time_s,rudder_deg,speed_m_s,heading_deg\n" + "".join(f"{i / 10},{i % 7},4.6,{i}\n" for i in range(50))


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        ("", "empty"),
        ("time_s,rudder_deg,speed_m_s\n0,1,2\n1,1,2\n", "heading"),
        ("time_s,rudder,speed_m_s,heading_deg\n0,1,2,3\n", "rudder_deg"),
        (GOOD.replace("1.0,3,4.6,10", "1.0,three,4.6,10"), "three"),
        (GOOD.replace("1.0,3,4.6,10", "0.1,3,4.6,10"), "time"),
        ("time_s,rudder_deg,speed_m_s,heading_deg\n", "row"),
        ("time_s,rudder_deg,speed_m_s,heading_deg\n0,1,2,3\n1,1,2,3\n", "samples"),
    ],
)
def test_a_wrong_table_is_one_sentence_that_names_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], content: str, sentence: str
) -> None:
    path = tmp_path / "run.csv"
    path.write_text(content)
    assert main(["identify", str(path)]) == 2
    complaint = capsys.readouterr().err.strip()
    assert "run.csv" in complaint
    assert sentence in complaint
    assert "\n" not in complaint
    assert "Traceback" not in complaint


def test_a_missing_table_is_named(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["identify", "nowhere.csv"]) == 2
    assert "nowhere.csv" in capsys.readouterr().err


def test_a_wrong_unit_in_the_column_map_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "map.yaml").write_text('rudder_grad: "delta"\n')
    (tmp_path / "run.csv").write_text(GOOD)
    assert main(["identify", str(tmp_path / "run.csv"), "--columns", str(tmp_path / "map.yaml")]) == 2
    complaint = capsys.readouterr().err
    assert "rudder_grad" in complaint
    assert "rudder_rad" in complaint


def test_no_log_at_all_says_what_is_needed(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["identify"]) == 2
    assert "LOG" in capsys.readouterr().err


def zigzag_table(path: Path) -> Path:
    rows, heading, rate, rudder = ["time_s,rudder_deg,speed_m_s,yaw_rate_deg_s"], 0.0, 0.0, 15.0
    for step in range(600):
        if heading * rudder > 225.0:
            rudder = -rudder
        rate += 0.1 * (0.4 * rudder - rate) / 2.0
        heading += 0.1 * rate
        rows.append(f"{0.1 * step:.1f},{rudder},2.0,{rate:.4f}")
    path.write_text("\n".join(rows) + "\n")
    return path


def test_the_vessel_file_is_read_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    log, read = zigzag_table(tmp_path / "zigzag.csv"), []

    def counted(path: str) -> Any:
        read.append(path)
        return load_vessel(path)

    monkeypatch.setattr(file, "load_vessel", counted)
    out = tmp_path / "out.yaml"
    assert main(["identify", str(log), "--holdout", str(log), "--vessel", "lanxin", "--out", str(out)]) == 0
    assert read == ["lanxin"]


def test_an_older_log_is_read_as_named_and_the_newest_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = zigzag_table(tmp_path / "zigzag.csv")
    for number, age in (("-2", 20.0), ("-3", 10.0)):
        newer = zigzag_table(tmp_path / f"zigzag{number}.csv")
        os.utime(newer, (newer.stat().st_mtime - age,) * 2)
    os.utime(log, (log.stat().st_mtime - 30.0,) * 2)
    assert main(["log", "info", str(log)]) == 0
    assert capsys.readouterr().err == f"{log} is read; the newest log of that name is {tmp_path / 'zigzag-3.csv'}\n"
    assert main(["identify", str(log), "--json"]) == 0
    said = capsys.readouterr()
    assert said.err == f"{log} is read; the newest log of that name is {tmp_path / 'zigzag-3.csv'}\n"
    json.loads(said.out)
    assert main(["log", "info", str(tmp_path / "zigzag-3.csv")]) == 0
    assert capsys.readouterr().err == ""


def zigzag_in(folder: Path) -> Path:
    log, table = folder / "trial.csv", zigzag(math.radians(15.0), 10.0, 0.1)
    rows = zip(*table.values(), strict=True)
    log.write_text("\n".join([",".join(table), *(",".join(map(str, row)) for row in rows)]))
    return log


def test_what_was_found_is_shown_also_where_the_disk_takes_no_file(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    log, out = zigzag_in(tmp_path), tmp_path / "boat.yaml"
    out.write_text(dump_vessel(load_vessel("lanxin")))
    before = out.read_text()

    def full(_: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", full)
    assert main(["identify", str(log), "--out", str(out), "--json"]) == 2
    printed = capsys.readouterr()
    assert "No space left on device" in printed.err
    assert json.loads(printed.out)["parameters"]["K"]["value"] == pytest.approx(0.7, rel=0.1)
    assert out.read_text() == before
    assert sorted(each.name for each in tmp_path.iterdir()) == ["boat.yaml", "trial.csv"]


def test_no_model_is_called_good_that_no_gains_serve(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    log, out = zigzag_in(tmp_path), tmp_path / "boat.yaml"

    def none(vessel: Vessel) -> Vessel:
        raise RefusedError("too slow a rudder")

    monkeypatch.setattr(tuning, "designed", none)
    assert main(["identify", str(log), "--out", str(out), "--rudder-max-deg", "35", "--json"]) == 2
    printed = capsys.readouterr()
    assert "is not written, for no gains serve such a boat: too slow a rudder" in printed.err
    verdict = json.loads(printed.out)["verdict"]
    assert verdict["grade"] == "not enough"
    assert verdict["sentence"].startswith("not enough: no gains serve such a boat: too slow a rudder; sail ")
    assert not out.exists()


@pytest.mark.parametrize(
    "given", [["a.csv", "a.csv"], ["a.csv", "./a.csv"], ["a.csv", "b.csv"], ["a.csv", "--holdout", "b.csv", "a.csv"]]
)
def test_a_log_given_twice_is_refused(
    given: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("a.csv").write_text("time_s,heading_rad,yaw_rate_rad_s,rudder_rad,speed_m_s\n")
    Path("b.csv").symlink_to("a.csv")
    assert main(["identify", *given]) == 2
    assert "is given twice" in capsys.readouterr().err
