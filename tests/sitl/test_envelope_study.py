"""The search of runs that are not the file's: what is drawn, what counts as held, and the box of what was."""

from __future__ import annotations

import json
import math
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from autopilot.angles import wrap
from autopilot.cli.main import main
from autopilot.vessel.file import load_vessel
from autopilot.vessel.schema import StandardErrors
from sitl.campaign import envelope
from sitl.campaign.envelope import (
    ALARMED,
    HELD,
    UNSAID,
    Found,
    Range,
    box_of,
    drawn_of,
    found_by,
    prepared_for,
    ranges_of,
    study_of,
    watched,
)

LANXIN = load_vessel("lanxin")
THRUSTERS = load_vessel("twin_thruster")
FILED = (0.0,) * 9


def test_a_share_of_a_range_is_of_its_logarithm_where_it_is_a_ratio() -> None:
    ratio, plain = Range("K", "x", 0.25, 1.0, 4.0), Range("delay", "s", 0.0, 0.0, 0.3)
    assert [ratio.at(share) for share in (-1.0, -0.5, 0.0, 0.5, 1.0)] == pytest.approx([0.25, 0.5, 1.0, 2.0, 4.0])
    assert [plain.at(share) for share in (-1.0, 0.0, 0.5)] == pytest.approx([0.0, 0.0, 0.15])


def test_what_the_file_knows_well_is_searched_narrowly() -> None:
    unknown = replace(LANXIN, model=replace(LANXIN.model, standard_errors=StandardErrors()))
    usual = ranges_of(unknown)[0]
    assert (usual.low, usual.high) == pytest.approx((0.6, 1.4))
    errors = StandardErrors(K_1_s=0.05 * LANXIN.model.K_1_s)
    known = ranges_of(replace(LANXIN, model=replace(LANXIN.model, standard_errors=errors)))[0]
    assert (known.low, known.high) == pytest.approx((0.9, 1.1))


def test_a_run_is_the_same_whoever_draws_it() -> None:
    ranges = ranges_of(LANXIN)
    assert drawn_of(3, 17, ranges) == drawn_of(3, 17, ranges) != drawn_of(3, 18, ranges)
    shares = [drawn_of(1, run, ranges)[0] for run in range(300)]
    assert all(-1.0 <= share <= 1.0 for each in shares for share in each)
    assert max(max(map(abs, each)) for each in shares) > 0.95
    assert all(each[4] >= 0.0 for each in shares), "no delay is less than none"


def test_the_box_holds_no_run_that_was_lost() -> None:
    lost = [(0.9, 0.1), (-0.2, 0.8), (0.5, -0.6)]
    found = [Found(0, drawn, ALARMED, 1.0, 1.0, 30.0) for drawn in lost]
    found += [Found(0, (0.1, 0.1), HELD, math.nan, math.nan, 1.0), Found(0, (0.95, 0.9), HELD, math.nan, math.nan, 1.0)]
    box, inside = box_of(found, 2)
    for drawn in lost:
        assert not all(bound.low < share < bound.high for bound, share in zip(box, drawn, strict=True))
    assert inside == 1
    assert box[0].high == pytest.approx(0.9)


def sailed(drawn: tuple[float, ...], turn: float = 60.0) -> Found:
    study, until = study_of(LANXIN, turn, ranges_of(LANXIN)[6].at(drawn[6]), gyro=True)
    return watched(LANXIN, prepared_for(LANXIN, study, ranges_of(LANXIN), drawn), study, (0, 5, until), drawn)


def test_a_boat_that_is_its_file_is_held() -> None:
    found = sailed(FILED)
    assert found.outcome == HELD
    assert found.overshoot_deg < 1.0


@pytest.mark.parametrize("run", [885, 1906])
def test_a_rudder_that_goes_from_stop_to_stop_by_a_log_that_reads_low_shows_it(run: int) -> None:
    """A course-unstable model boat; the log reads 0.51 and 0.40 of its speed. It swung, irregularly, for 70 s."""
    boat, ranges = load_vessel("small_craft"), ranges_of(load_vessel("small_craft"))
    drawn, turn = drawn_of(992001, run, ranges)
    study, until = study_of(boat, turn, ranges[6].at(drawn[6]), gyro=True)
    key = int(np.random.SeedSequence((992001, run)).generate_state(1)[0])
    said, off = math.inf, 0.0
    for tick, world, _ in envelope.sailed(prepared_for(boat, study, ranges, drawn), study, key):
        if any(event.name == "speed_doubtful" for event in tick.alarms):
            said = min(said, world.time)
        if world.time > until:
            off = max(off, abs(math.degrees(wrap(world.boat.state.heading - math.radians(turn)))))
    assert said < 20.0, "before the turn"
    assert off < 6.0


@pytest.mark.parametrize(("run", "gyro"), [(32, True), (510, False)])
def test_a_boat_that_is_now_on_its_course_and_now_off_it_is_said_to_be_off_it(run: int, gyro: bool) -> None:
    """A rudder at half its rate in gusts: 26 deg short of its turn but for 2 s, and swings by 27 deg to either side."""
    found = found_by(LANXIN, 2911262, run, gyro=gyro, is_compiled=False)
    assert found.outcome == ALARMED
    assert found.alarm_s - found.left_s <= 5.0


@pytest.mark.parametrize("run", [179, 493, 653])
def test_a_boat_that_leads_past_its_course_is_said_to_within_five_seconds(run: int) -> None:
    """It swings to both sides while the turn may last; or is 21 deg off a moment before the turn."""
    found = found_by(load_vessel("blueboat"), 20261129, run, is_compiled=False)
    assert found.outcome == ALARMED
    assert found.alarm_s - found.left_s <= 5.0


def test_a_hull_is_as_long_as_its_file_says() -> None:
    long, usual = envelope.hull_of(28.0), envelope.hull_of(None)
    assert (long.length_m, long.drift_lever_m) == (4.0 * usual.length_m, 4.0 * usual.drift_lever_m)
    assert long.speed_time_s == 2.0 * usual.speed_time_s


def test_a_boat_that_leaves_is_not_one_of_which_nobody_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    """A wind that no rudder holds; the alarms of the pilot's own, and then none of them."""
    blown = (*FILED[:8], 1.0)
    ranges = ranges_of(LANXIN)
    storm = (*ranges[:8], ranges[8]._replace(high=90.0))
    monkeypatch.setattr(envelope, "ranges_of", lambda _: storm)
    study, until = study_of(LANXIN, 60.0, 1.0, gyro=True)
    shared = prepared_for(LANXIN, study, storm, blown)
    assert watched(LANXIN, shared, study, (0, 5, until), blown).outcome == ALARMED
    quiet = envelope.sailed

    def silent(*given: object) -> object:
        return ((tick._replace(alarms=()), world, command) for tick, world, command in quiet(*given))  # type: ignore[arg-type]

    monkeypatch.setattr(envelope, "sailed", silent)
    assert watched(LANXIN, shared, study, (0, 5, until), blown).outcome == UNSAID


def test_compiled_and_full_runs_agree_on_what_is_held() -> None:
    pytest.importorskip("numba", reason="the extra `fast` is not installed")
    for run in (1, 2, 3):
        quick, full = found_by(LANXIN, 11, run), found_by(LANXIN, 11, run, is_compiled=False)
        assert quick.outcome == full.outcome
        assert quick.overshoot_deg == pytest.approx(full.overshoot_deg, abs=0.5)


def test_the_command_prints_bounds_and_a_page(tmp_path: Path) -> None:
    page = tmp_path / "page.html"
    words = [sys.executable, "-m", "autopilot", "envelope", "lanxin", "--runs", "6", "--workers", "1", "--json"]
    done = subprocess.run([*words, "--report", str(page)], capture_output=True, text=True, timeout=300.0, check=False)
    assert done.returncode in (0, 6), done.stderr
    found = json.loads(done.stdout)
    assert found["runs"] == 6
    assert set(found["bounds"]) == {each.name for each in ranges_of(LANXIN)}
    assert "<svg" in page.read_text()


ACCUSED = pytest.mark.xfail(
    strict=True, reason="called stuck 57 s after the start, since turns are planned for when the order has come"
)


@pytest.mark.parametrize("run", [118, pytest.param(228, marks=ACCUSED), 497])
def test_thrusters_that_work_against_waves_are_not_called_stuck(run: int) -> None:
    ranges = ranges_of(THRUSTERS)
    drawn, turn = drawn_of(771001, run, ranges)
    study, until = study_of(THRUSTERS, turn, ranges[envelope.SPEED].at(drawn[envelope.SPEED]), gyro=True)
    key = int(np.random.SeedSequence((771001, run)).generate_state(1)[0])
    found = watched(THRUSTERS, prepared_for(THRUSTERS, study, ranges, drawn), study, (run, key, until), drawn)
    assert found.outcome == HELD


def test_its_errors_are_in_the_name_of_who_was_called(capfd: pytest.CaptureFixture[str]) -> None:
    assert main(["envelope", "nosuch.yaml"]) == 2
    assert capfd.readouterr().err.startswith("autopilot: nosuch.yaml: no such file")
