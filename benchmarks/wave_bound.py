"""What any wave filter could spare the rudder in sea state 5, beside what the pilot's does; printed as a table.

    python benchmarks/wave_bound.py [--seeds 10] [--sides 25,45,60,100,135,160]

Measured by the campaign's loop: heading rms and rudder travel with `wave_filter` off and auto, medians over the seeds.
Beside it the bound. Whatever filter and law lie between instruments and rudder, they are a controller; for a linear
boat in Gaussian waves of a spectrum that the controller knows, none has less rms of heading for the same rms of rudder
rate than the linear-quadratic-Gaussian one. It knows boat, sea, gusts and noise, and its rudder has neither lag, delay
nor limits, so that the real loop can only be worse. Of a Gaussian rudder rate the travel is sqrt(2/pi) times its rms.

The sea as met on a straight course is fitted by oscillators whose powers are not negative (least squares on its
covariance), the boat's cubic damping by its slope in the mean, n1 + 3 n3 E[r^2]; the wind's moment goes with the
heading too. The bound is the least travel at 1.1 times the heading rms without the filter. Worth: the rms of the waves'
push as a rudder angle; of what goes beyond the rudder's stops the bound knows nothing.
"""

from __future__ import annotations

import argparse
import dataclasses
import math
import statistics
import tempfile
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from pareto_study import BOATS as PARETO_BOATS
from scipy.linalg import expm, solve_discrete_are, solve_discrete_lyapunov
from scipy.optimize import nnls
from study_boats import SEAS, StudyBoat, StudySea
from wave_filter import boat_of as wave_filter_boat

from autopilot.build_laws import model_of
from autopilot.models import wind
from autopilot.models.waves import encounter_frequency
from autopilot.params.vessel import Estimator
from autopilot.params.vessel_file import dump_vessel, load_vessel
from sitl.boat import Hull
from sitl.campaign.cases import Job
from sitl.campaign.score import figures
from sitl.campaign.setting import rooms_of, setting_of
from sitl.campaign.study import BoatSection, SeaSection, Study
from sitl.campaign.swift import run_swiftly
from sitl.campaign.work import swift
from sitl.scenario import HullSection, IttcSection, WavesSection, WindSection
from sitl.sea import ittc_waves, wave_forces

Floats = npt.NDArray[np.float64]

NAMES = ("lanxin", "launch", "coaster", "tanker", "esso")
SIDES_DEG = (25.0, 45.0, 60.0, 100.0, 135.0, 160.0)
SECONDS = {"esso": (600.0, 300.0)}
SECONDS_ELSE = (300.0, 120.0)
"""How long [s] a run lasts, and from when on it counts."""
HELD_DEG = 10.0
ALLOWED = 1.1
HZ = 10
REALISATIONS = 100
LAGS_S = np.arange(0.0, 60.0, 0.2)
WEIGHTS = np.logspace(-2.0, 3.0, 26)
TRAVEL_OF_RMS = math.sqrt(2.0 / math.pi)


class Point(NamedTuple):
    """Heading rms [deg] and rudder travel [deg/s]."""

    rms_deg: float
    travel_deg_s: float


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


def measured(name: str, boat: StudyBoat, side: float, wave_filter: bool, seeds: int) -> Point:
    """Return the medians over the seeds of what the pilot does."""
    seconds, since = SECONDS.get(name, SECONDS_ELSE)
    vessel = dataclasses.replace(boat.vessel, estimator=Estimator(wave_filter="auto" if wave_filter else "off"))
    run, found = swift() or run_swiftly, []
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
            score, _ = run(setting._replace(is_watched=False), rooms_of(setting))
            found.append(figures(score, 1.0 / HZ, 1.0))
    return Point(
        statistics.median(one.heading_rms_deg for one in found), statistics.median(one.travel_deg_s for one in found)
    )


def covariance_met(boat: StudyBoat, side: float, sea: StudySea = SEAS["state 5"]) -> Floats:
    """Return E[a(t) a(t + lag)] [rad^2/s^4] of the waves' yaw acceleration on a straight course, by LAGS_S."""
    speed = boat.vessel.model.reference_speed_m_s
    total = np.zeros(len(LAGS_S))
    for seed in range(REALISATIONS):
        waves = ittc_waves(IttcSection(sea.height, sea.period, side), boat.hull, np.random.default_rng(seed))
        yaw, _ = wave_forces(waves, 0.0)
        met = encounter_frequency(waves.frequency, speed, waves.towards)
        total += 0.5 * (yaw**2) @ np.cos(np.outer(met, LAGS_S))
    return np.asarray(total / REALISATIONS)


def worth_of(boat: StudyBoat, covariance: Floats) -> float:
    """Return the rms [deg] of the rudder angle that would push her as the waves do."""
    model = model_of(boat.vessel)
    return math.degrees(math.sqrt(covariance[0]) * model.time_constant / model.gain)


class Oscillator(NamedTuple):
    """x'' + 2 damping frequency x' + frequency^2 x = noise; what it gives is x', of this `power` E[x'^2] [rad^2/s^4].

    x' has no spectrum at zero frequency, where waves have none either and a slow ship would feel it most.
    """

    frequency: float
    damping: float
    power: float


def oscillators(covariance: Floats) -> list[Oscillator]:
    """Return oscillators whose covariances add up to this one."""
    kinds = [(w, z) for w in np.geomspace(0.05, 3.0, 80) for z in (0.01, 0.03, 0.06, 0.1, 0.2, 0.4)]
    columns = []
    for w, z in kinds:
        ringing = w * math.sqrt(1.0 - z * z)
        swing = np.cos(ringing * LAGS_S) - z * w / ringing * np.sin(ringing * LAGS_S)
        columns.append(np.exp(-z * w * LAGS_S) * swing)
    powers, _ = nnls(np.array(columns).T, covariance / covariance[0], maxiter=20_000)
    return [Oscillator(w, z, float(p * covariance[0])) for (w, z), p in zip(kinds, powers, strict=True) if p > 1.0e-3]


def bound(
    boat: StudyBoat,
    side: float,
    waves: list[Oscillator],
    rate_variance: float,
    sea: StudySea = SEAS["state 5"],
    has_gyro: bool = True,
) -> tuple[list[Point], float]:
    """Return the best that can be, by weight, and the largest E[r^2] [rad^2/s^2] on the way.

    States: psi, r, rudder, gust [m/s], and two of each oscillator, scaled.
    """
    model, sensors = model_of(boat.vessel), boat.vessel.sensors
    n, dt, time = 4 + 2 * len(waves), 1.0 / HZ, model.time_constant
    load, speed, start = wind.WindLoad(math.radians(0.003)), model.reference_speed, math.radians(side)

    def moment(gust: float, heading: float) -> float:
        return wind.rudder_equivalent(load, wind.apparent_wind(sea.wind + gust, start, heading, speed, 0.0))

    a, noise = np.zeros((n, n)), np.zeros((n, n))
    a[0, 1] = 1.0
    # the speed is held towards the bow: what turns with the boat is the wind about her alone
    a[1, 0] = model.gain / time * (moment(0.0, 1.0e-3) - moment(0.0, -1.0e-3)) / 2.0e-3
    a[1, 1] = -(model.n1 + 3.0 * model.n3 * rate_variance) / time
    a[1, 2] = model.gain / time
    a[1, 3] = model.gain / time * (moment(1.0e-3, 0.0) - moment(-1.0e-3, 0.0)) / 2.0e-3
    a[3, 3], noise[3, 3] = -0.1, 0.2 * sea.gust**2
    for place, one in enumerate(waves):
        # frequency x and x', both scaled to a variance of 1
        y = 4 + 2 * place
        a[1, y + 1] = math.sqrt(one.power)
        a[y, y + 1], a[y + 1, y] = one.frequency, -one.frequency
        a[y + 1, y + 1] = -2.0 * one.damping * one.frequency
        noise[y + 1, y + 1] = 4.0 * one.damping * one.frequency
    # van Loan: transition and noise of a step
    both = expm(dt * np.block([[-a, noise], [np.zeros((n, n)), a.T]]))
    f = both[n:, n:].T
    q = f @ both[:n, n:]
    q = 0.5 * (q + q.T)
    q[:3, :3] += 1.0e-18 * np.eye(3)
    move = f[:, 2:3]  # the rudder jumps at the beginning of a step
    shown = np.eye(2 if has_gyro else 1, n)
    noises = sensors.heading_noise_deg, sensors.rate_noise_deg_s
    r = np.diag(np.radians(noises[: len(shown)]) ** 2)
    before = solve_discrete_are(f.T, shown.T, q, r)
    total = shown @ before @ shown.T + r
    gain = before @ shown.T @ np.linalg.inv(total)
    left = before - gain @ shown @ before
    found, most = [], 0.0
    for weight in WEIGHTS:
        cost = np.zeros((n, n))
        cost[0, 0] = 1.0
        # a rudder nobody needs goes amidships, which the equation must be told to have a solution
        cost[2, 2] = 1.0e-9
        input_cost = np.array([[(weight / dt) ** 2]])
        try:
            riccati = solve_discrete_are(f, move, cost, input_cost)
        except ValueError:  # so heavy or light that the equation is too ill-conditioned
            continue
        feedback = np.linalg.solve(input_cost + move.T @ riccati @ move, move.T @ riccati @ f)
        closed = f - move @ feedback
        known = solve_discrete_lyapunov(closed, gain @ total @ gain.T)
        moved = math.sqrt((feedback @ known @ feedback.T).item()) / dt
        found.append(Point(math.degrees(math.sqrt(known[0, 0] + left[0, 0])), math.degrees(TRAVEL_OF_RMS * moved)))
        most = max(most, float(known[1, 1] + left[1, 1]))
    return found, most


def least_travel(points: list[Point], rms_deg: float) -> float:
    """Return the least travel [deg/s] at this rms [deg], between the points by logarithms; nan: there is none."""
    points = sorted(points)
    if rms_deg < points[0].rms_deg:
        return math.nan
    rms, travel = np.log([p.rms_deg for p in points]), np.log([max(p.travel_deg_s, 1.0e-9) for p in points])
    return float(math.exp(np.interp(math.log(rms_deg), rms, travel)))


def main() -> None:
    """Measure, work out and print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--sides", default=",".join(f"{side:g}" for side in SIDES_DEG))
    parser.add_argument("--boats", default=",".join(NAMES))
    asked = parser.parse_args()
    print(
        "boat      from   heading rms [deg]  rudder travel [deg/s]     ratios       least travel of any filter   worth"
    )
    print(
        "          [deg]     off     auto         off     auto      rms  travel     at 1.1 x rms off   of off    [deg]"
    )
    for name in asked.boats.split(","):
        boat = boat_of(name)
        for side in (float(text) for text in asked.sides.split(",")):
            off, auto = (measured(name, boat, side, filtered, asked.seeds) for filtered in (False, True))
            covariance, rate_variance = covariance_met(boat, side), 0.0
            waves, worth = oscillators(covariance), worth_of(boat, covariance)
            for _ in range(2):
                points, most = bound(boat, side, waves, rate_variance)
                rate_variance = 0.5 * (rate_variance + most)
            least = least_travel(points, ALLOWED * off.rms_deg)
            held = "" if min(off.rms_deg, auto.rms_deg) < HELD_DEG else "   not held"
            print(
                f"{name:9s}{side:6.0f}{off.rms_deg:9.2f}{auto.rms_deg:9.2f}{off.travel_deg_s:12.2f}"
                f"{auto.travel_deg_s:9.2f}{auto.rms_deg / off.rms_deg:9.2f}{auto.travel_deg_s / off.travel_deg_s:8.2f}"
                f"{least:17.2f}{least / off.travel_deg_s:11.2f}{worth:10.0f}{held}",
                flush=True,
            )


if __name__ == "__main__":
    main()
