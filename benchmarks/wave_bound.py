"""What any wave filter could spare the rudder in sea state 5, beside what the pilot's does; printed as a table.

    python benchmarks/wave_bound.py [--seeds 10] [--sides 25,45,60,100,135,160] [--spare-rudder LEVEL] [--held]

Measured by the campaign's loop: heading rms and rudder travel with `wave_filter` off, auto and meet, over the seeds.
Beside them the least travel at 1.1 times the heading rms without the filter: of the bound of `lqg_bound.py`, and of the
same law sailed in the very same runs (`lqg_sailed.py`), where it meets the rudder's stops and rate and waves that push
otherwise as the boat yaws. Worth: the rms of the waves' push as a rudder angle.

--held: another table, in how many of the runs the boat strays by more than 10 deg rms; median and worst rms; travel.
"""

from __future__ import annotations

import argparse
import dataclasses
import statistics
import tempfile
from pathlib import Path

from lqg_bound import HZ, Point, covariance_met, least_travel, oscillators, settled, worth_of
from lqg_sailed import sailed
from pareto_study import BOATS as PARETO_BOATS
from study_boats import SEAS, StudyBoat, StudySea
from wave_filter import boat_of as wave_filter_boat
from wave_filter import that_spares

from autopilot.control.design import DESIGNED
from autopilot.vessel.file import dump_vessel, load_vessel
from autopilot.vessel.schema import Estimator
from sitl.boat import Hull
from sitl.campaign.compiled_run import Setting, Workspace, figures, run_compiled
from sitl.campaign.setting import setting_of, workspace_of
from sitl.campaign.study import BoatSection, Job, SeaSection, Study
from sitl.campaign.work import compiled_loop
from sitl.scenario import HullSection, IttcSection, WavesSection, WindSection

NAMES = ("lanxin", "launch", "coaster", "tanker", "esso")
SIDES_DEG = (25.0, 45.0, 60.0, 100.0, 135.0, 160.0)
SECONDS = {"esso": (600.0, 300.0)}
SECONDS_ELSE = (300.0, 120.0)
"""How long [s] a run lasts, and from when on it counts."""
HELD_DEG = 10.0
ALLOWED = 1.1


def boat_of(name: str) -> StudyBoat:
    """Return a boat of the wave filter's study, or ESSO as identified and scaled to the ship."""
    if name != "esso":
        return wave_filter_boat(name)
    section = PARETO_BOATS["esso"].hull
    values = [getattr(section, field.name) for field in dataclasses.fields(section)]
    return StudyBoat(load_vessel(str(Path(__file__).parent / "pareto_boats" / "esso.yaml")), Hull(*values))


def sea_of(sea: StudySea) -> SeaSection:
    """Return the sea as a study has it."""
    return SeaSection(WavesSection(ittc=IttcSection(sea.height, sea.period)), WindSection(sea.wind, gust_m_s=sea.gust))


def runs_of(name: str, boat: StudyBoat, side: float, wave_filter: str, seeds: int) -> list[tuple[Setting, Workspace]]:
    """Return a run for each seed."""
    seconds, since = SECONDS.get(name, SECONDS_ELSE)
    vessel = dataclasses.replace(boat.vessel, estimator=Estimator(wave_filter=wave_filter))  # type: ignore[arg-type]
    found = []
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "boat.yaml").write_text(dump_vessel(vessel))
        study = Study(
            1,
            f"{name} {side} {wave_filter}",
            {name: BoatSection("boat.yaml", HullSection(*boat.hull))},
            seed=9000,
            runs=seeds,
            seconds=seconds,
            measured_from_s=since,
            heading_hz=HZ,
            seas={"sea": sea_of(SEAS["state 5"])},
            sides_deg=(side,),
        )
        for number in range(seeds):
            setting = setting_of(Job(study, folder), number)
            assert setting is not None
            found.append((setting._replace(is_watched=False), workspace_of(setting)))
    return found


def points_of(runs: list[tuple[Setting, Workspace]]) -> list[Point]:
    """Return what the pilot does in each run."""
    run = compiled_loop(DESIGNED) or run_compiled
    found = [figures(run(setting, workspace)[0], 1.0 / HZ, 1.0) for setting, workspace in runs]
    return [Point(one.heading_rms_deg, one.travel_deg_s) for one in found]


def middle_of(found: list[Point]) -> Point:
    """Return the medians over the runs."""
    return Point(statistics.median(one.rms_deg for one in found), statistics.median(one.travel_deg_s for one in found))


def held_row(name: str, boat: StudyBoat, side: float, seeds: int) -> str:
    """Return a boat's row of the table of runs in which it is not held."""
    text = f"{name:9s}{side:6.0f}"
    for mode in ("off", "auto"):
        found = points_of(runs_of(name, boat, side, mode, seeds))
        middle, worst = middle_of(found), max(one.rms_deg for one in found)
        lost = sum(one.rms_deg > HELD_DEG for one in found)
        text += f"{lost:10d}{middle.rms_deg:8.1f}{worst:8.1f}{middle.travel_deg_s:8.2f}"
    return text


def row(name: str, boat: StudyBoat, side: float, seeds: int) -> str:
    """Return a boat's row of the table."""
    runs = {mode: runs_of(name, boat, side, mode, seeds) for mode in ("off", "auto", "meet")}
    off, auto, meet = (middle_of(points_of(found)) for found in runs.values())
    covariance = covariance_met(boat, side)
    linear, points = settled(boat, side, SEAS["state 5"], oscillators(covariance), has_gyro=True)
    allowed = ALLOWED * off.rms_deg
    least = [least_travel(found, allowed) / off.travel_deg_s for found in (points, sailed(linear, runs["off"]))]
    held = "" if min(off.rms_deg, auto.rms_deg, meet.rms_deg) < HELD_DEG else "   not held"
    text = f"{name:9s}{side:6.0f}{off.rms_deg:9.2f}{off.travel_deg_s:7.2f}"
    for one in (auto, meet):
        text += f"{one.rms_deg / off.rms_deg:11.2f}{one.travel_deg_s / off.travel_deg_s:8.2f}"
    return text + "".join(f"{value:9.2f}" for value in least) + f"{worth_of(boat, covariance):9.0f}{held}"


def main() -> None:
    """Measure, work out and print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--sides", default=",".join(f"{side:g}" for side in SIDES_DEG))
    parser.add_argument("--boats", default=",".join(NAMES))
    parser.add_argument("--spare-rudder", type=int, metavar="LEVEL", help="gains that spare the rudder, of this level")
    parser.add_argument("--held", action="store_true", help="in how many runs the boat strays by more than 10 deg rms")
    asked = parser.parse_args()
    if asked.held:
        of = f"of {asked.seeds}"
        print(f"boat      from   off: {'lost':>4s}  median   worst  travel auto: {'lost':>4s}  median   worst  travel")
        print(f"          [deg]{of:>10s}   [deg]   [deg] [deg/s]{of:>10s}   [deg]   [deg] [deg/s]")
    else:
        print_heads()
    for name in asked.boats.split(","):
        boat = boat_of(name)
        if asked.spare_rudder is not None:
            boat = that_spares(boat, asked.spare_rudder)
        for side in (float(text) for text in asked.sides.split(",")):
            print((held_row if asked.held else row)(name, boat, side, asked.seeds), flush=True)


def print_heads() -> None:
    """Print the heads of the table of bounds."""
    print("boat      from         off          auto of off         meet of off      least of off    worth")
    print("          [deg]  [deg] [deg/s]      rms  travel         rms  travel    bound   sailed    [deg]")


if __name__ == "__main__":
    main()
