"""Several logs of one run: their offset is found where it can be, never guessed, and the rudder comes from either."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from boat_recordings import EPOCH, Boat, dataflash, every, tlog, tlog_events, zigzag_boat
from scipy.integrate import solve_ivp

from autopilot.cli.main import main
from autopilot.errors import InputError
from autopilot.identification.identified import Question
from autopilot.identification.identify import identify
from autopilot.logs.merge import best_match, sources_of
from autopilot.logs.reading import LogOptions, load_recording, load_run
from autopilot.logs.series import RUDDER, Recording, Series
from autopilot.logs.table import RudderSettings, between, table_of, through_gear
from autopilot.models.steering_gear import SteeringGear

BOAT = zigzag_boat()


def part(boat: Boat, start: float, end: float) -> Boat:
    """Return the boat from `start` to `end` [s], on its own clock from zero."""
    kept = (boat.time >= start) & (boat.time <= end)
    cut = Boat(*(column[kept] for column in boat))
    return cut._replace(time=cut.time - cut.time[0])


def csv(folder: Path, name: str, boat: Boat, columns: str, clock: float = 0.0, noise: float = 0.0) -> str:
    """Write a table of the boat at 10 Hz with `columns` of: heading_rad rudder_rad speed_m_s."""
    random = np.random.default_rng(3)
    fields = {
        "heading_rad": boat.heading,
        "yaw_rate_rad_s": boat.rate,
        "rudder_rad": boat.rudder,
        "speed_m_s": boat.speed,
    }
    rows = every(boat, 10.0)
    noisy = noise * random.normal(size=len(rows))
    lines = ["time_s," + ",".join(columns.split())]
    for at, i in enumerate(rows):
        values = [fields[name][i] + (noisy[at] if name == "heading_rad" else 0.0) for name in columns.split()]
        lines.append(",".join(f"{value:.6f}" for value in (boat.time[i] + clock, *values)))
    path = folder / name
    path.write_text("\n".join(lines) + "\n")
    return str(path)


@pytest.mark.parametrize("begins", [-6.0, 13.37, 40.0])
def test_the_offset_is_found_where_the_boat_turned_alike(tmp_path: Path, begins: float) -> None:
    """The flight controller knows the attitude; another logger the rudder, and a compass by which they fit."""
    flight = tmp_path / "flight.BIN"
    flight.write_bytes(dataflash(part(BOAT, max(0.0, -begins), 120.0), with_parameters=False))
    rudder = csv(tmp_path, "rudder.csv", part(BOAT, max(0.0, begins), 100.0), "heading_rad rudder_rad", 777.0, 0.003)
    run = load_run(f"{flight}+{rudder}", options=LogOptions(rudder=RudderSettings("measured")))
    remark = next(note for note in run.notes if "begins" in note)
    found = float(remark.split("begins ")[1].split(" s after")[0])
    assert found == pytest.approx(begins, abs=0.05)
    assert "where the yaw rates fit best" in remark
    model = identify([run], Question("nomoto")).model
    assert (model.gain, model.time_constant) == pytest.approx((0.2, 5.0), rel=0.02)


def test_a_given_offset_is_taken(tmp_path: Path) -> None:
    flight = tmp_path / "flight.tlog"
    flight.write_bytes(tlog(tlog_events(BOAT)))
    rudder = csv(tmp_path, "rudder.csv", part(BOAT, 20.0, 110.0), "rudder_rad")
    run = load_run(f"{flight}+{rudder}@20")
    assert identify([run], Question("nomoto")).model.time_constant == pytest.approx(5.0, rel=0.02)
    with pytest.raises(InputError, match=r"\(one of them has neither heading nor yaw rate\).*rudder.csv@SEC"):
        load_run(f"{flight}+{rudder}")


def test_the_dates_in_both_do_where_nothing_else_does(tmp_path: Path) -> None:
    flight, other = tmp_path / "a.tlog", tmp_path / "b.tlog"
    flight.write_bytes(tlog(tlog_events(part(BOAT, 0.0, 60.0))))
    other.write_bytes(tlog(tlog_events(part(BOAT, 90.0, 120.0)), began=EPOCH + 90.0))
    recording = load_recording(f"{flight}+{other}")
    assert any("begins +90.0" in note and "by the dates in both" in note for note in recording.notes)


def test_a_zigzag_without_beginning_or_end_is_ambiguous_and_refused(tmp_path: Path) -> None:
    long = csv(tmp_path, "long.csv", part(BOAT, 30.0, 118.0), "heading_rad speed_m_s")
    short = csv(tmp_path, "short.csv", part(BOAT, 60.0, 80.0), "heading_rad rudder_rad")
    with pytest.raises(InputError, match="their yaw rates fit nowhere, or in several places"):
        load_run(f"{long}+{short}")


def test_random_turning_is_matched_to_within_its_spacing_or_not_at_all() -> None:
    """200 random courses, 20 s before to 60 s after: none is put in the wrong place, and nearly all are found."""
    first, other = np.arange(0.0, 90.0, 0.1), np.arange(0.0, 50.0, 0.25)
    found = []
    for seed in range(200):
        random = np.random.default_rng(seed)
        begins = random.uniform(-20.0, 60.0)
        knots = np.arange(-40.0, 160.0, 4.0)
        rates = 0.05 * random.normal(size=knots.size)
        match = best_match((first, np.interp(first, knots, rates)), (other, np.interp(other + begins, knots, rates)))
        if match is not None:
            assert match.offset == pytest.approx(begins, abs=0.25)
        found.append(match is not None)
    assert np.mean(found) > 0.9


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("a.BIN@3+b.csv", "the first file sets the clock"),
        ("a.BIN+b.csv@soon", "'soon' is no offset"),
        ("a.BIN+b.csv@nan", "'nan' is no offset"),
        ("a.BIN+b.csv@1e9", "is no offset"),
        ("a.BIN+", r"write FILE\+FILE"),
    ],
)
def test_sources_written_wrongly_are_one_sentence(text: str, expected: str) -> None:
    with pytest.raises(InputError, match=expected):
        sources_of(text)


def test_a_file_whose_name_has_a_plus_is_one_file(tmp_path: Path) -> None:
    path = tmp_path / "sea+wind@3.csv"
    path.write_text("time_s\n0\n")
    assert [source.path for source in sources_of(str(path))] == [str(path)]


def test_the_merged_table_is_written(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    flight = tmp_path / "flight.BIN"
    flight.write_bytes(dataflash(BOAT, with_parameters=False))
    rudder = csv(tmp_path, "rudder.csv", part(BOAT, 0.0, 110.0), "heading_rad rudder_rad")
    out = tmp_path / "both.csv"
    assert main(["log", "csv", f"{flight}+{rudder}", "--rudder", "measured", "--out", str(out)]) == 0
    assert "begins" in capsys.readouterr().out
    assert "# rudder_rad: measured (rudder.csv: table)" in out.read_text()


def test_the_steering_gear_moves_as_its_equation_says() -> None:
    """Lag, rate limit and delay against scipy's integration of the same equation."""
    gear = SteeringGear(angle_max=0.6, rate_max=0.1, lag=0.4, delay=0.3)
    times = np.arange(0.0, 20.0, 0.1)
    orders = 0.3 * np.sign(np.sin(0.7 * times))
    moved = through_gear(Series("x", "orders", times, orders), gear)

    def slope(t: float, angle: np.ndarray) -> np.ndarray:
        order = orders[max(0, int(np.floor((t - 0.3) / 0.1 + 1e-9)))]
        return np.clip((order - angle) / 0.4, -0.1, 0.1)

    exact = solve_ivp(slope, (0.0, 20.0), [orders[0]], max_step=0.01, t_eval=times, rtol=1e-8)
    np.testing.assert_allclose(np.interp(times, moved.time, moved.values), exact.y[0], atol=2e-3)


def test_a_pause_in_the_orders_is_a_pause_in_the_rudder() -> None:
    times = np.concatenate((np.arange(0.0, 5.0, 0.1), np.arange(30.0, 35.0, 0.1)))
    moved = through_gear(Series("x", "orders", times, np.full(times.size, 0.1)), SteeringGear(0.6, 0.1))
    known = np.isfinite(between(moved, np.array([4.0, 20.0, 31.0])))
    np.testing.assert_array_equal(known, [True, False, True])


def test_headings_are_interpolated_across_the_end_of_the_circle() -> None:
    heading = Series("heading_rad", "compass", np.array([0.0, 1.0, 2.0]), np.radians([170.0, -170.0, -150.0]))
    np.testing.assert_allclose(np.degrees(between(heading, np.array([0.25, 0.75, 1.5]))), [175.0, -175.0, -160.0])
    rudder = Series(RUDDER, "x", np.array([0.0, 1.0, 2.0, 30.0]), np.zeros(4))
    assert np.isnan(between(rudder, np.array([-1.0, 15.0, 31.0]))).all()


def test_headings_between_seldom_rudder_angles_stay_as_they_were_recorded() -> None:
    """A heading laid on the rows of a rudder beside it is a straight line between two, and what it tells is less."""
    time = np.arange(0.0, 60.0, 0.5)
    rudder = Series("rudder_rad", "gear", time, 0.2 * np.sign(np.sin(0.3 * time)))
    seen = np.arange(0.25, 59.0, 1.0)
    heading = Series("heading_rad", "compass", seen, 0.5 * np.sin(0.3 * seen))
    columns = table_of(Recording("x", "log", (rudder, heading)), RudderSettings(), between_motions=True).columns
    known = np.isfinite(columns["heading_rad"])
    np.testing.assert_array_equal(columns["time_s"][known], seen)
    np.testing.assert_array_equal(columns["heading_rad"][known], heading.values)
    assert columns["time_s"].size > 1.5 * seen.size
