"""Rudder roll stabilisation that keeps speed (Liu and Jin 2017), measured with the product's own functions.

    python benchmarks/liu2017_roll.py [--json] [--seeds 20]      the tables of results/liu2017.md, on fresh seeds
    python benchmarks/liu2017_roll.py --tune NAME                finds the gains NAME again, on the training seeds

Each run: 600 s at 15 knots, the first 120 s left out; plant, steering gear and law at 20 Hz; 60 wave components with
random phases. With numba installed (extra `fast`) the loop is compiled, otherwise it runs as plain Python.
"""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Callable
from functools import cache, lru_cache
from typing import Any, NamedTuple

import numpy as np
from naval_vessel import (
    NAVAL_STRIPS,
    InverseMass,
    Sea,
    calm_resistance,
    extra_resistance,
    inverse_mass,
    linear_motion,
    motion_step,
    printed_speed_ratio,
    sea_forces,
    true_speed_ratio,
)
from numpy.typing import NDArray
from scipy.optimize import differential_evolution

from autopilot.control.rudder_roll import (
    PAPER_ROLL,
    Motion,
    RateGain,
    RollGains,
    ScheduleParts,
    ScheduleSettings,
    begin_schedule,
    blended_rudder,
    damping_rudder,
    linear_step_of,
    roll_law,
    roll_rudder,
    schedule_step,
)
from autopilot.control.sliding_heading import (
    PAPER_SWAY_YAW,
    SwayYawGains,
    sway_yaw_rudder,
)
from autopilot.control.sliding_roll import STEERING, quiet_at
from autopilot.errors import InputError
from autopilot.models.steering_gear import SteeringGear, gear_step
from autopilot.vessel.file import load_vessel
from sitl.compiled import compiled
from sitl.roll_ship import NAVAL_HULL, NAVAL_RUDDERS, SERVICE_SPEED, Hull, Load, Rudders, drag_coefficient, rudder_load

Array = NDArray[np.float64]

DT, SECONDS, SETTLED_S, KEEP = 0.05, 600.0, 120.0, 4
"""Step [s], length of a run, what is left out [s]; one step in KEEP is measured."""
FREQUENCY = np.linspace(0.35, 2.2, 60)
MEAN_PERIOD = 7.0
FRESH, TRAINING = 9_000, 1_000
"""First seeds of the runs that are shown and of those that gains are tuned on."""
TRAINING_RUNS = 6
MODEL = linear_motion(NAVAL_HULL, NAVAL_RUDDERS, SERVICE_SPEED)
FILED = load_vessel("naval_vessel").control.sliding_roll
assert FILED is not None
SETTINGS = ScheduleSettings(budget=math.radians(FILED.rudder_rms_deg), roll_time=-2.0 / FILED.roll_row[1])
"""The schedule of the vessel file."""
NOISE_DEG = (0.2, 0.2, 0.3, 0.3)
"""Standard deviation of p, r [deg/s], phi and psi [deg] as instruments show them, white at 20 Hz."""


class Ship(NamedTuple):
    """The plant of a run."""

    hull: Hull
    inverse: InverseMass
    rudders: Rudders
    gear: SteeringGear
    speed: float


class Laws(NamedTuple):
    """What steers: share [-] of the roll law (below 0: by the schedule), and whether anything steers at all."""

    parts: ScheduleParts
    share: float
    steers: bool


class Case(NamedTuple):
    """One row: a name, its gains and how they are used. instruments: noise on p, r, phi and psi, and no sway speed."""

    name: str
    heading: SwayYawGains
    roll: RollGains | None = None
    scheduled: bool = False
    rate_deg_s: float = 20.0
    steers: bool = True
    instruments: bool = False


class Result(NamedTuple):
    """Of one run: roll and heading rms [deg], true and printed speed ratio, rudder rms [deg], travel [deg/s],
    mean weight of the roll law [-]."""

    roll: float
    heading: float
    speed: float
    printed_speed: float
    rudder: float
    travel: float
    weight: float


def sail(ship: Ship, laws: Laws, load: Array, noise: Array, dt: float, keep: int) -> Array:
    """Return v, p, r, phi, psi, rudder, travel so far, weight and the rudder's drag, a row for every `poll` steps."""
    out = np.empty((load.shape[0] // keep, 9))
    state, schedule = Motion(0.0, 0.0, 0.0, 0.0, 0.0), begin_schedule()
    rudder, travel, gain = 0.0, 0.0, RateGain(0.0, 0.0)
    for i in range(out.shape[0] * keep):
        demand, weight = 0.0, laws.share
        n = noise[i]
        seen = Motion(n[0] * state.v, state.p + n[1], state.r + n[2], state.phi + n[3], state.psi + n[4])
        if laws.steers:
            if laws.share < 0.0:
                schedule = schedule_step(laws.parts, schedule, seen, 0.0, rudder, dt)
                weight = schedule.weight
            quiet = sway_yaw_rudder(laws.parts.quiet, seen.v, seen.r, seen.psi)
            damped = roll_rudder(laws.parts.roll, seen, 0.0)
            if laws.share < 0.0:
                shares, limits = (weight, schedule.strength), (laws.parts.gear.rate_max, dt)
                demand, gain = damping_rudder(shares, gain, quiet, damped, limits)
            else:
                demand = blended_rudder(weight, quiet, damped)
        before = rudder
        rudder = gear_step(ship.gear, rudder, demand, dt)
        travel += abs(rudder - before)
        push = rudder_load(ship.rudders, ship.speed, rudder)
        outside = Load(push.Y + load[i, 0], push.K + load[i, 1], push.N + load[i, 2])
        state = motion_step(ship.hull, ship.inverse, ship.speed, state, outside, dt)
        if (i + 1) % keep == 0:
            row = out[i // keep]
            row[0], row[1], row[2], row[3], row[4] = state.v, state.p, state.r, state.phi, state.psi
            row[5], row[6], row[7] = rudder, travel, weight
            row[8] = drag_coefficient(ship.rudders, rudder)
    return out


@cache
def loop() -> Callable[..., Array]:
    """Return `sail`, compiled where numba is installed."""
    try:
        return compiled(sail)
    except InputError:
        return sail


@lru_cache(maxsize=64)
def realisation(sea: Sea, seed: int) -> tuple[Array, Array]:
    """Return load (n, 3) at every step and the water's drift at every measured one."""
    phase = np.random.default_rng(seed).uniform(0.0, 2.0 * math.pi, len(FREQUENCY))
    time = DT * np.arange(round(SECONDS / DT))
    forces = sea_forces(NAVAL_STRIPS, sea, SERVICE_SPEED, FREQUENCY, phase, time)
    settled = round(SETTLED_S / DT / KEEP)
    return np.ascontiguousarray(forces.load), np.ascontiguousarray(forces.drift[KEEP - 1 :: KEEP][settled:])


def laws_of(case: Case) -> Laws:
    """Return the laws of a case, made ready on the linear model. ValueError for gains that are not stable."""
    quiet = quiet_at(MODEL, case.heading)
    share = -1.0 if case.scheduled else float(case.roll is not None)
    gear = SteeringGear(math.radians(40.0), math.radians(case.rate_deg_s), 0.1)
    roll = roll_law(MODEL, case.roll or PAPER_ROLL)
    parts = ScheduleParts(SETTINGS, quiet, roll, gear, linear_step_of(MODEL, DT))
    return Laws(parts, share, case.steers)


def noise_of(instruments: bool, seed: int, steps: int) -> Array:
    """Return for each step a factor on the sway speed seen and what is added to p, r [rad/s], phi and psi [rad]."""
    if not instruments:
        return np.tile((1.0, 0.0, 0.0, 0.0, 0.0), (steps, 1))
    noise = np.zeros((steps, 5))
    noise[:, 1:] = np.random.default_rng([seed, 1]).normal(0.0, np.radians(NOISE_DEG), (steps, 4))
    return noise


@lru_cache(maxsize=256)
def run(case: Case, sea: Sea, seed: int) -> Result:
    """Return what one run shows."""
    load, water = realisation(sea, seed)
    laws = laws_of(case)
    ship = Ship(NAVAL_HULL, inverse_mass(NAVAL_HULL), NAVAL_RUDDERS, laws.parts.gear, SERVICE_SPEED)
    out = loop()(ship, laws, load, noise_of(case.instruments, seed, len(load)), DT, KEEP)[
        round(SETTLED_S / DT / KEEP) :
    ]
    return result_of(out, sea, water)


def result_of(out: Array, sea: Sea, water: Array) -> Result:
    """Return what the measured rows of a run, as `sail` has them, show with the water's drift at each."""
    extra = extra_resistance(sea, SERVICE_SPEED, out[:, :3], out[:, 8], water).total / calm_resistance(SERVICE_SPEED)
    return Result(
        roll=math.degrees(float(np.sqrt(np.mean(out[:, 3] ** 2)))),
        heading=math.degrees(float(np.sqrt(np.mean(out[:, 4] ** 2)))),
        speed=true_speed_ratio(extra),
        printed_speed=printed_speed_ratio(extra),
        rudder=math.degrees(float(np.sqrt(np.mean(out[:, 5] ** 2)))),
        travel=math.degrees(float(out[-1, 6] - out[0, 6])) / (SECONDS - SETTLED_S),
        weight=float(np.mean(out[:, 7])),
    )


def mean_of(case: Case, sea: Sea, seeds: range) -> Result:
    """Return the mean over the seeds, item by item."""
    return Result(*(float(value) for value in np.mean([run(case, sea, seed) for seed in seeds], axis=0)))


class Against(NamedTuple):
    """A case beside another over the same seeds: roll reduction [%], worst of the seeds, extra speed loss [% of the
    other's speed], true and as printed."""

    reduction: float
    worst: float
    loss: float
    printed_loss: float


def against(case: Case, other: Case, sea: Sea, seeds: range) -> Against:
    """Return what `case` changes against `other`."""
    return beside([run(case, sea, seed) for seed in seeds], [run(other, sea, seed) for seed in seeds])


def beside(ours_each: list[Result], theirs_each: list[Result]) -> Against:
    """Return what runs change against others over the same seeds."""
    pairs = list(zip(ours_each, theirs_each, strict=True))
    ours, theirs = (Result(*np.mean([pair[side] for pair in pairs], axis=0)) for side in (0, 1))
    return Against(
        reduction=100.0 * (1.0 - ours.roll / theirs.roll),
        worst=min(100.0 * (1.0 - a.roll / b.roll) for a, b in pairs),
        loss=100.0 * (1.0 - ours.speed / theirs.speed),
        printed_loss=100.0 * (1.0 - ours.printed_speed / theirs.printed_speed),
    )


def sea_from(degrees: float, height: float) -> Sea:
    """Return the paper's sea met at `degrees`, 180 for head seas."""
    return Sea(height, MEAN_PERIOD, math.radians(degrees))


class Goal(NamedTuple):
    """What gains are tuned for: the sea, the extra speed loss [%] and heading rms [deg] they may reach."""

    sea: Sea
    loss: float
    heading: float


GOALS = {
    "moderate": Goal(sea_from(135.0, 4.0), 0.98, 1.4),
    "strong": Goal(sea_from(135.0, 4.0), 1.40, 1.4),
    "lighter sea": Goal(sea_from(135.0, 2.5), 0.92, 1.4),
}
QUIET_SEAS = (sea_from(45.0, 4.0), sea_from(90.0, 4.0), sea_from(135.0, 4.0))
ROLL_BOUNDS = ((-40, 40), (1.0, 3.0), (-400, 900), (-300, 600), (-3.0, 0.3), (-2.0, 0.7))
"""k_v, log10 k_p, k_r and k_phi in degrees per SI unit; log10 of eta and W."""
QUIET_BOUNDS = ((-20, 20), (-400, 600), (-3.0, 0.5), (-2.0, 1.0))
"""k_v, k_r in degrees per SI unit; log10 of eta and W."""
FASTEST = 8.0
"""Eigenvalues [1/s] beyond this are no law for a 20 Hz loop with a rudder lag of 0.1 s."""


def roll_gains_from(x: Array) -> RollGains:
    """Return the gains at a point of ROLL_BOUNDS."""
    k_v, k_r, k_phi = (math.radians(float(x[i])) for i in (0, 2, 3))
    return RollGains(k_v, math.radians(10.0 ** float(x[1])), k_r, k_phi, 10.0 ** float(x[4]), 10.0 ** float(x[5]))


def quiet_gains_from(x: Array) -> SwayYawGains:
    """Return the gains at a point of QUIET_BOUNDS."""
    return SwayYawGains(math.radians(float(x[0])), math.radians(float(x[1])), 10.0 ** float(x[2]), 10.0 ** float(x[3]))


def is_steerable(case: Case) -> bool:
    """Return whether the law near its surface is stable on the linear model, and no faster than the loop."""
    try:
        laws = laws_of(case)
    except ValueError:
        return False
    feedback = np.zeros(5)
    if case.roll is None:
        q = laws.parts.quiet
        feedback[STEERING] = np.array([q.k_v, q.k_r, 0.0]) + q.switching / q.boundary * np.array(
            [q.h_v, q.h_r, q.h_psi]
        )
    else:
        r = laws.parts.roll
        surface = np.array([r.h_v, r.h_p, r.h_r, r.h_phi, r.h_psi])
        feedback = np.array([r.k_v, r.k_p, r.k_r, r.k_phi, 0.0]) + r.switching / r.boundary * surface
    poles = np.linalg.eigvals(MODEL.A - np.outer(MODEL.b, feedback))
    return bool(np.max(poles.real) < -0.003 and np.max(np.abs(poles)) < FASTEST)


def roll_cost(x: Array, goal: Goal, seeds: range) -> float:
    """Return minus the roll reduction [%], with penalties for speed and heading beyond the goal."""
    case = Case("tuning", PAPER_SWAY_YAW, roll_gains_from(x))
    if not is_steerable(case):
        return 1000.0
    found = against(case, FIXED, goal.sea, seeds)
    heading = mean_of(case, goal.sea, seeds).heading
    return -found.reduction + 50.0 * max(0.0, found.loss - goal.loss) + 20.0 * max(0.0, heading - goal.heading)


def quiet_cost(x: Array, seeds: range) -> float:
    """Return what a quiet autopilot keeps low in three seas: speed loss, heading error, rudder travel, roll."""
    case = Case("tuning", quiet_gains_from(x))
    if not is_steerable(case):
        return 1000.0
    cost = 0.0
    for sea in QUIET_SEAS:
        found = against(case, FIXED, sea, seeds)
        mean = mean_of(case, sea, seeds)
        cost += max(0.0, found.loss) + 0.2 * mean.heading + 0.1 * mean.travel + 2.0 * max(0.0, 0.5 - found.reduction)
    return cost


def tune(name: str, generations: int) -> str:
    """Return the gains for the goal `name` ("quiet" among them), found on the training seeds."""
    seeds = range(TRAINING, TRAINING + TRAINING_RUNS)
    settings: dict[str, Any] = {"maxiter": generations, "popsize": 6, "seed": 1, "polish": False, "init": "sobol"}
    if name == "quiet":
        found = differential_evolution(quiet_cost, QUIET_BOUNDS, (seeds,), **settings)
        return f"cost {found.fun:.3f}: {quiet_gains_from(found.x)}"
    found = differential_evolution(roll_cost, ROLL_BOUNDS, (GOALS[name], seeds), **settings)
    return f"cost {found.fun:.3f}: {roll_gains_from(found.x)}"


FIXED = Case("fixed rudder", PAPER_SWAY_YAW, steers=False)
QUIET_GAINS = SwayYawGains(k_v=0.0741, k_r=3.41, reach=0.0352, boundary=0.536)
TUNED = {
    "moderate": RollGains(k_v=0.0295, k_p=0.939, k_r=4.48, k_phi=1.83, reach=0.0242, boundary=1.222),
    "strong": RollGains(k_v=-0.0770, k_p=1.162, k_r=5.17, k_phi=3.12, reach=0.0147, boundary=1.162),
    "lighter sea": RollGains(k_v=0.0443, k_p=3.071, k_r=9.22, k_phi=6.26, reach=0.0388, boundary=1.625),
    "shipped": RollGains(k_v=-0.296, k_p=2.618, k_r=8.182, k_phi=4.442, reach=0.08, boundary=1.6),
}
"""Found by --tune on the training seeds, without schedule; "shipped" are those of the vessel file."""
QUIET = Case("quiet autopilot", QUIET_GAINS)


def ours(name: str, rate_deg_s: float = 20.0, *, scheduled: bool = True) -> Case:
    """Return the case of tuned gains, with the schedule and the quiet autopilot behind it."""
    label = f"tuned: {name}" + (f", rudder {rate_deg_s:.0f} deg/s" if rate_deg_s != 20.0 else "")
    return Case(label, QUIET_GAINS, TUNED[name], scheduled, rate_deg_s)


CASES = (
    FIXED,
    QUIET,
    Case("paper's heading law", PAPER_SWAY_YAW),
    Case("paper's roll law", PAPER_SWAY_YAW, PAPER_ROLL),
    Case("paper's roll law, rudder 10 deg/s", PAPER_SWAY_YAW, PAPER_ROLL, rate_deg_s=10.0),
    *(ours(name) for name in TUNED),
    *(ours(name, 10.0) for name in TUNED),
    *(ours(name)._replace(name=f"tuned: {name}, instruments", instruments=True) for name in TUNED),
)
ANGLES_DEG = (15, 30, 45, 60, 75, 90, 105, 120, 135, 150, 165)


class Row(NamedTuple):
    """A case in a sea: what it does, and what it changes against a fixed rudder and the quiet autopilot."""

    case: str
    mean: Result
    fixed: Against
    quiet: Against


def rows_at(degrees: float, height: float, cases: tuple[Case, ...], seeds: range) -> list[Row]:
    """Return one row for each case."""
    sea = sea_from(degrees, height)
    return [
        Row(case.name, mean_of(case, sea, seeds), against(case, FIXED, sea, seeds), against(case, QUIET, sea, seeds))
        for case in cases
    ]


TITLES = (
    f"{'':34}{'roll':>6}{'reduction against':>20}{'worst':>7}{'heading':>9}{'extra speed loss against':>26}"
    f"{'rudder':>8}{'travel':>8}",
    f"{'':34}{'deg':>6}{'fixed':>10}{'quiet':>10}{'seed':>7}{'deg':>9}{'fixed':>9}{'quiet':>8}{'printed':>9}"
    f"{'deg':>8}{'deg/s':>8}",
)


def text_of(row: Row) -> str:
    """Return a row of the first tables; all percentages."""
    mean, fixed, quiet = row.mean, row.fixed, row.quiet
    return (
        f"{row.case:34}{mean.roll:6.2f}{fixed.reduction:9.1f}%{quiet.reduction:9.1f}%{fixed.worst:6.0f}%"
        f"{mean.heading:9.2f}{fixed.loss:8.2f}%{quiet.loss:7.2f}%{fixed.printed_loss:8.2f}%"
        f"{mean.rudder:8.2f}{mean.travel:8.2f}"
    )


def sweep(seeds: range) -> list[dict[str, float]]:
    """Return roll at each angle to a sea of 4 m: quiet autopilot, the roll law always on, and under its schedule."""
    found = []
    for degrees in ANGLES_DEG:
        sea = sea_from(degrees, 4.0)
        scheduled, always = ours("shipped"), ours("shipped", scheduled=False)
        on = against(scheduled, FIXED, sea, seeds)
        beside = against(scheduled, QUIET, sea, seeds)
        found.append(
            {
                "angle_deg": degrees,
                "fixed_deg": mean_of(FIXED, sea, seeds).roll,
                "fixed_heading_deg": mean_of(FIXED, sea, seeds).heading,
                "quiet_percent": against(QUIET, FIXED, sea, seeds).reduction,
                "always_percent": against(always, FIXED, sea, seeds).reduction,
                "always_against_quiet_percent": against(always, QUIET, sea, seeds).reduction,
                "scheduled_percent": on.reduction,
                "worst_percent": on.worst,
                "against_quiet_percent": beside.reduction,
                "worst_against_quiet_percent": beside.worst,
                "weight": mean_of(scheduled, sea, seeds).weight,
                "heading_deg": mean_of(scheduled, sea, seeds).heading,
                "loss_percent": on.loss,
            }
        )
    return found


def sweep_text(rows: list[dict[str, float]]) -> list[str]:
    """Return the table over the angles."""
    lines = [
        f"{'':7}{'fixed rudder':>16}{'quiet':>8}{'always on, against':>20}{'scheduled, against':>20}{'worst seed':>16}"
        f"{'':9}{'':9}{'':8}",
        f"{'angle':>7}{'roll':>8}{'heading':>8}{'':>8}{'fixed':>10}{'quiet':>10}{'fixed':>10}{'quiet':>10}"
        f"{'fixed':>8}{'quiet':>8}{'weight':>9}{'heading':>9}{'loss':>8}",
    ]
    lines.extend(
        f"{row['angle_deg']:7.0f}{row['fixed_deg']:8.2f}{row['fixed_heading_deg']:8.1f}{row['quiet_percent']:7.1f}%"
        f"{row['always_percent']:9.1f}%{row['always_against_quiet_percent']:9.1f}%{row['scheduled_percent']:9.1f}%"
        f"{row['against_quiet_percent']:9.1f}%{row['worst_percent']:7.1f}%{row['worst_against_quiet_percent']:7.1f}%"
        f"{row['weight']:9.2f}{row['heading_deg']:9.2f}{row['loss_percent']:7.2f}%"
        for row in rows
    )
    return lines


def show(seeds: range) -> None:
    """Print the tables."""
    for degrees, height in ((135.0, 4.0), (135.0, 2.5), (45.0, 4.0)):
        print(f"Waves of {height} m at {degrees:.0f} deg (180 is head seas), {len(seeds)} seeds")
        print("\n".join(TITLES), flush=True)
        for row in rows_at(degrees, height, CASES, seeds):
            print(text_of(row), flush=True)
        print()
    print("Waves of 4 m: roll reduction by the gains 'shipped' at each angle")
    print("\n".join(sweep_text(sweep(seeds))))


def as_json(seeds: range) -> str:
    """Return the tables for a machine."""
    seas = {
        f"{degrees:.0f} deg, {height} m": [
            {part: value._asdict() if isinstance(value, tuple) else value for part, value in row._asdict().items()}
            for row in rows_at(degrees, height, CASES, seeds)
        ]
        for degrees, height in ((135.0, 4.0), (135.0, 2.5), (45.0, 4.0))
    }
    return json.dumps({"seas": seas, "angles": sweep(seeds)}, indent=2)


def main() -> None:
    """Print the tables, or tune."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--tune", choices=("quiet", *GOALS), help="find these gains again, on the training seeds")
    parser.add_argument("--generations", type=int, default=20, help="of the tuning (default 20)")
    parser.add_argument("--seeds", type=int, default=20, help="fresh seeds of each row (default 20)")
    parser.add_argument("--json", action="store_true", help="print JSON")
    arguments = parser.parse_args()
    fresh = range(FRESH, FRESH + arguments.seeds)
    if arguments.tune:
        print(tune(arguments.tune, arguments.generations))
    elif arguments.json:
        print(as_json(fresh))
    else:
        show(fresh)


if __name__ == "__main__":
    main()
