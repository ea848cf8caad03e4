"""Vessel files of the simulator's own plants with a rudder, as a skipper makes one: sail, identify, design the gains.

    python benchmarks/zoo_vessels.py KIND FOLDER      the vessel file of a plant of the simulator, and its recordings

The plant's equations are nowhere looked at: compass, rate gyro, log and rudder sensor of the simulated boat go into the
recordings, and `autopilot identify` and `autopilot gains` do the rest.
"""

from __future__ import annotations

import argparse
import csv
import dataclasses
import math
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

from autopilot.angles import wrap
from autopilot.vessel.file import load_vessel
from autopilot.vessel.schema import Vessel
from sitl.registry import PLANTS
from sitl.scenario import Scenario
from sitl.world import Orders, World

DATE = "2026-11-24"
EVERY = 10
"""Steps of the simulator from one row of a recording to the next."""


class Trial(NamedTuple):
    """name and description for the file, service speed [m/s], zigzags as (rudder, heading) [deg] and their length [s],
    the other options of `autopilot identify`."""

    name: str
    description: str
    speed: float
    zigzags: tuple[tuple[float, float], ...]
    lasts: float
    options: tuple[str, ...] = ()


TRIALS = {
    "mmg_tanker": Trial(
        "KVLCC2 model of 7 m",
        "The simulated plant mmg_tanker, a tanker by the MMG method, Yasukawa and Yoshimura 2015",
        1.179,
        ((10.0, 10.0), (-10.0, 10.0), (20.0, 20.0), (-20.0, 20.0)),
        240.0,
    ),
    "roll_ship": Trial(
        "Naval vessel of 51.5 m, free to roll",
        "The simulated plant roll_ship, after Blanke and Christensen 1993, Perez 2005, and Liu and Jin 2017",
        7.717,
        ((10.0, 10.0), (-10.0, 10.0), (20.0, 20.0), (-20.0, 20.0)),
        120.0,
    ),
    "small_craft": Trial(
        "CyberShip II",
        "The simulated plant small_craft, a supply vessel of 1.26 m after Skjetne, Smogeli and Fossen 2004",
        0.5,
        ((10.0, 10.0), (-10.0, 10.0), (20.0, 20.0), (-20.0, 20.0)),
        150.0,
        # what --model auto chooses, and the boat itself shows: it does not go straight
        ("--course-unstable",),
    ),
}


class Zigzag:
    """A hand at the helm: the rudder over each time the compass shows the angle."""

    def __init__(self, world: World, rudder_deg: float, heading_deg: float) -> None:
        self._world, self._angle = world, math.radians(heading_deg)
        self._order = math.radians(rudder_deg)

    def orders(self, time: float) -> Orders:
        reading = self._world.sensors.latest(time)
        if reading is not None and wrap(reading.heading) * math.copysign(1.0, self._order) >= self._angle:
            self._order = -self._order
        return Orders(rudder=self._order)


def boat_of(kind: str, speed: float) -> Vessel:
    """Return a vessel whose file knows nothing but the speed and the steering gear of a plant."""
    usual = load_vessel("lanxin")
    gear = PLANTS[kind].of(usual, Scenario(1, kind, plant=kind)).gear
    rudder = dataclasses.replace(
        usual.rudder,
        angle_max_deg=round(math.degrees(gear.angle_max), 3),
        rate_max_deg_s=round(math.degrees(gear.rate_max), 3),
        lag_s=gear.lag,
        delay_s=0.0,
    )
    model = dataclasses.replace(usual.model, reference_speed_m_s=speed)
    return dataclasses.replace(usual, rudder=rudder, model=model)


def recorded(kind: str, trial: Trial, number: int, path: Path) -> None:
    """Sail a zigzag and write what the instruments show."""
    rudder, heading = trial.zigzags[number]
    world = World(boat_of(kind, trial.speed), Scenario(1, kind, plant=kind), seed=100 + number)
    world.helms.append(Zigzag(world, rudder, heading))
    with path.open("w", newline="", encoding="utf-8") as file:
        rows = csv.writer(file)
        rows.writerow(("time_s", "heading_deg", "yaw_rate_deg_s", "rudder_deg", "speed_m_s"))
        for step in range(round(trial.lasts * 100 / EVERY)):
            world.advance((step + 1) * EVERY * 0.01)
            shown = world.sensors.latest(world.time)
            assert shown is not None
            angles = (math.degrees(angle) for angle in (shown.heading, shown.rate, shown.rudder))
            rows.writerow([f"{value:.6g}" for value in (shown.time, *angles, shown.water_speed)])


def text_of(kind: str, trial: Trial, model: str, control: str) -> str:
    """Return the vessel file with these two sections."""
    rudder = boat_of(kind, trial.speed).rudder
    return f"""# yaml-language-server: $schema=../schemas/vessel.schema.json
# A simulated boat, `sitl serve {kind}`. `python benchmarks/zoo_vessels.py {kind} FOLDER` writes this file again.
schema_version: 2
name: {trial.name}
description: {trial.description}
length_m: {PLANTS[kind].of(load_vessel("lanxin"), Scenario(1, kind, plant=kind)).hull.length:g}

model:
{model}

rudder:
  angle_max_deg: {rudder.angle_max_deg:g}
  rate_max_deg_s: {rudder.rate_max_deg_s:g}
  lag_s: {rudder.lag_s:g}
  source: the plant's own steering gear, sitl/{kind}.py
  date: {DATE}

helm:
  rudder_at_full_pwm_deg: {rudder.angle_max_deg:g}
  servo_us: [1000, 1500, 2000]
  source: the simulated servo
  date: {DATE}

sensors:
  heading_noise_deg: 0.3
  rate_noise_deg_s: 0.2
  variation_deg: null       # set your chart's, or magnetic: true; a magnetic compass is not used else
  source: the simulated instruments
  date: {DATE}

control:
  law: backstepping
  rate_hz: 20.0
  loop_delay_s: 0.05
{control}

failsafe:
  heading_timeout_s: 0.9
  action: amidships
  release_after_s: 10.0
  source: chosen, not measured
  date: {DATE}
"""


def unknown_model(trial: Trial) -> str:
    """Return a model that is replaced before anybody uses it."""
    return f"  K_1_s: 0.1\n  T_s: 10.0\n  reference_speed_m_s: {trial.speed}\n  source: to be identified"


def model_of(kind: str, vessel: Vessel) -> str:
    """Return the lines of an identified model."""
    model, errors = vessel.model, vessel.model.standard_errors
    lines = [
        f"  # Identified from zigzags of sitl/{kind}.py, whose equations are not these, as its compass, rate gyro, log",
        "  # and rudder sensor show them.",
        f"  K_1_s: {model.K_1_s:.4g}",
        f"  T_s: {model.T_s:.4g}",
        f"  n1: {model.n1:g}",
        f"  n3_s2_rad2: {model.n3_s2_rad2:.4g}",
        f"  n0_rad_s: {model.n0_rad_s:.3g}",
        f"  reference_speed_m_s: {model.reference_speed_m_s:.4g}",
        "  standard_errors:",
    ]
    known = {key: value for key, value in dataclasses.asdict(errors).items() if value} if errors else {}
    lines += [f"    {key}: {value:.2g}" for key, value in known.items()]
    return "\n".join([*lines, f"  source: identified from zigzags of the simulated plant {kind}", f"  date: {DATE}"])


def control_of(vessel: Vessel) -> str:
    """Return the lines of designed gains."""
    lines = []
    for law in ("backstepping", "pid", "sliding"):
        lines.append(f"  {law}:")
        gains = dataclasses.asdict(getattr(vessel.control, law))
        lines += [f"    {key}: {value:.5g}" for key, value in gains.items() if value]
    return "\n".join([*lines, "  source: autopilot gains, level 5", f"  date: {DATE}"])


def main() -> None:
    """Sail, identify and design."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("kind", choices=sorted(TRIALS))
    parser.add_argument("folder", type=Path)
    given = parser.parse_args()
    kind, folder, trial = given.kind, given.folder, TRIALS[given.kind]
    folder.mkdir(parents=True, exist_ok=True)
    base, vessel = folder / f"{kind}_base.yaml", folder / f"{kind}.yaml"
    to_design = "  backstepping:\n    k1_1_s: 0.1\n    k2_1_s: 0.1\n  source: to be designed"
    base.write_text(text_of(kind, trial, unknown_model(trial), to_design), encoding="utf-8")
    logs = [folder / f"{kind}_{number}.csv" for number in range(len(trial.zigzags))]
    for number, log in enumerate(logs):
        recorded(kind, trial, number, log)
    autopilot = [sys.executable, "-m", "autopilot"]
    identify = [*autopilot, "identify", *map(str, logs), "--vessel", str(base), "--out", str(vessel), *trial.options]
    vessel.unlink(missing_ok=True)
    subprocess.run(identify, check=True)
    subprocess.run([*autopilot, "gains", str(vessel), "--out", str(vessel), "--overwrite"], check=True)
    made = load_vessel(str(vessel))
    vessel.write_text(text_of(kind, trial, model_of(kind, made), control_of(made)), encoding="utf-8")
    load_vessel(str(vessel))


if __name__ == "__main__":
    main()
