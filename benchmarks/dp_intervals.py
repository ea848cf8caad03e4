"""Whether the intervals of `autopilot identify-dp` hold, with and without current, wind and a lag of the thrusters.

    python benchmarks/dp_intervals.py [--seeds 40] [--first-seed 20261124] [--into FILE] [--json]

The ship of the trials is written out here and shares nothing with the identification: it is moved in SI units, over the
ground's axes, the current by relative speeds, the wind by its pressure on hull areas at the angle of the moment with
gusts of its speed, the thrusters by a lag of their own, by Euler's method at a fiftieth of the sample spacing.

Three kinds of log of 600 s at 1 Hz, position noise 0.1 m and heading noise 0.1 deg: `surge` (x alone, main thrusters),
`sway-yaw` (position and heading, side thruster) and `all` (all thrusters at once). `--into FILE` writes each seed as it
ends and goes on where it was left; `--seeds 0 --into FILE` shows what FILE holds.
"""

from __future__ import annotations

import argparse
import json
import math
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np

from autopilot.identification.dynamic_positioning import (
    Hull,
    Thruster,
    Trial,
    identify_dp,
    usual_beliefs,
)

LENGTH, MASS, G = 128.0, 1.9413e7, 9.81
MASSES = (1.05, 1.642, 0.0375, 0.0977)
DAMPING = {"Xu": 0.0112, "Yv": 2.764e-2, "Yr": -2.9e-3, "Nv": -9.6e-4, "Nr": 7.2e-3}
GAINS = (1.0011, 1.0031, 1.0152)
ARMS = ((1.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 50.0))
HULL = Hull(LENGTH, MASS, *MASSES, tuple(Thruster(a, s, m / LENGTH) for a, s, m in ARMS))
FRONT, SIDE = 300.0, 1100.0
"""Areas in the wind [m^2]."""
CONDITIONS: dict[str, dict[str, float]] = {
    "calm, lag 0 s given": {},
    "current": {"current": 0.2, "lag": 3.0},
    "wind": {"wind": 8.0, "gust": 1.0, "lag": 3.0},
    "both": {"current": 0.2, "wind": 8.0, "gust": 1.0, "lag": 5.0},
}
"""Current and mean wind [m/s], deviation of its gusts [m/s]; lag of the thrusters [s], not given where it is not 0."""
SECONDS, SUBSTEPS = 600, 50


def orders(kind: str, random: np.random.Generator) -> np.ndarray:
    """Return the thrusts ordered [N], a row a second."""
    out = np.zeros((SECONDS + 1, 3))
    if kind in ("surge", "all"):
        for i in range(2):
            out[:, i] = 200e3 * np.repeat(random.choice([-1.0, 1.0], 13), 50)[: SECONDS + 1]
    if kind in ("sway-yaw", "all"):
        out[:, 2] = np.where(np.arange(SECONDS + 1) // 100 % 2 == 0, 150e3, -150e3)
    # a log begins before the first order
    out[:10] = 0.0
    return out


def sailed(kind: str, seed: int, current: float = 0.0, wind: float = 0.0, gust: float = 0.0, lag: float = 0.0) -> Trial:
    """Return a log of the ship, which lies still over the ground at first."""
    random = np.random.default_rng(seed)
    ordered = orders(kind, random)
    towards, from_ = random.uniform(0.0, 2.0 * math.pi, 2)
    stream = current * np.array([math.cos(towards), math.sin(towards)])
    scale = math.sqrt(G / LENGTH) * MASS
    M = MASS * np.array([[MASSES[0], 0, 0], [0, MASSES[1], MASSES[2] * LENGTH], [0, 0, 0]])
    M[2] = MASS * np.array([0, MASSES[2] * LENGTH, MASSES[3] * LENGTH**2])
    D = np.zeros((3, 3))
    D[0, 0], D[1, 1], D[1, 2] = DAMPING["Xu"] * scale, DAMPING["Yv"] * scale, DAMPING["Yr"] * scale * LENGTH
    D[2, 1], D[2, 2] = DAMPING["Nv"] * scale * LENGTH, DAMPING["Nr"] * scale * LENGTH**2
    inverse, push = np.linalg.inv(M), np.array(ARMS) * np.array(GAINS)[:, None]
    place, heading, blow = np.zeros(2), 0.0, 0.0
    nu = np.array([-stream[0], -stream[1], 0.0])
    if kind == "surge":
        stream[1] = nu[1] = 0.0
        from_ = 0.0 if math.cos(from_) > 0.0 else math.pi
    thrust, h = ordered[0] * (lag == 0.0), 1.0 / SUBSTEPS
    shake = np.array([5e-4, 3.3e-4, 2.5e-5 * LENGTH]) * math.sqrt(h) * MASS
    rows = []
    for second in range(SECONDS + 1):
        rows.append([*place, heading])
        for _ in range(SUBSTEPS):
            thrust = ordered[second] if lag == 0.0 else thrust + h / lag * (ordered[second] - thrust)
            c, s = math.cos(heading), math.sin(heading)
            ground = np.array([c * nu[0] - s * nu[1], s * nu[0] + c * nu[1]]) + stream
            blow += -h / 15.0 * blow + gust * math.sqrt(2.0 * h / 15.0) * random.standard_normal()
            # the wind over the ground, from where it comes
            air = (wind + blow) * np.array([math.cos(from_), math.sin(from_)])
            ahead, side = c * air[0] + s * air[1], c * air[1] - s * air[0]
            q = 0.5 * 1.225 * math.hypot(ahead, side)
            force = np.array([-0.6 * q * ahead * FRONT, -0.8 * q * side * SIDE, 0.0])
            force[2] = 0.08 * LENGTH * force[1] * ahead / max(math.hypot(ahead, side), 1e-9)
            if kind == "surge":
                force[1:] = 0.0
            u, v, r = nu
            p1, p2 = M[0, 0] * u, M[1, 1] * v + M[1, 2] * r
            turn = np.array([p2 * r, -p1 * r, p1 * v - p2 * u])
            nudge = shake * random.standard_normal(3) * (np.array([1.0, 0.0, 0.0]) if kind == "surge" else 1.0)
            change = inverse @ (h * (thrust @ push - D @ nu + turn + force) + nudge)
            place, heading, nu = place + h * ground, heading + h * r, nu + change
    seen = np.array(rows)
    seen[:, :2] += 0.1 * random.standard_normal((SECONDS + 1, 2))
    seen[:, 2] += math.radians(0.1) * random.standard_normal(SECONDS + 1)
    if kind == "surge":
        seen[:, 1:] = np.nan
    return Trial(np.arange(SECONDS + 1.0), ordered, seen)


def truth_of(names: tuple[str, ...], lag: float = 0.0) -> np.ndarray:
    """Return the true values of D, k and the logarithm of a lag [s] by name, nan for a lag that is none."""
    known = {**DAMPING, **{f"k{i + 1}": k for i, k in enumerate(GAINS)}, "lag": math.log(lag) if lag else math.nan}
    return np.array([known.get(name, math.nan) for name in names])


def one(job: tuple[str, str, int]) -> dict[str, list[float]]:
    """Return of each parameter the error in deviations, and the deviation as a share of the truth."""
    kind, condition, seed = job
    trial = sailed(kind, seed, **CONDITIONS[condition])
    lag = CONDITIONS[condition].get("lag", 0.0)
    fit = identify_dp(HULL, trial, usual_beliefs(HULL, trial, None if lag else 0.0))
    truth = truth_of(fit.names, lag)
    return {
        name: [(found.value - true) / found.deviation, found.deviation / abs(true), float(fit.converged)]
        for name, found, true in zip(fit.names, fit.found, truth, strict=True)
        if math.isfinite(true)
    }


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=40, metavar="N")
    parser.add_argument("--first-seed", type=int, default=20261124, metavar="S")
    parser.add_argument("--kinds", nargs="+", default=["surge", "sway-yaw", "all"])
    parser.add_argument("--conditions", nargs="+", choices=list(CONDITIONS), default=list(CONDITIONS))
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--into", type=Path, help="a file of seeds, a line each, to go on with")
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    lines = arguments.into.read_text().splitlines() if arguments.into and arguments.into.exists() else []
    kept = [(tuple(job), found) for job, found in map(json.loads, lines)]
    table: dict[str, dict[str, dict[str, float]]] = {}
    with ProcessPoolExecutor(arguments.workers) as pool:
        for kind in arguments.kinds:
            for condition in arguments.conditions:
                known = {job: each for job, each in kept if job[:2] == (kind, condition)}
                seeds = range(arguments.first_seed, arguments.first_seed + arguments.seeds)
                jobs = [job for seed in seeds if (job := (kind, condition, seed)) not in known]
                for job, each in zip(jobs, pool.map(one, jobs), strict=True):
                    known[job] = each
                    if arguments.into:
                        with arguments.into.open("a") as file:
                            file.write(json.dumps([job, each]) + "\n")
                found = list(known.values())
                if not found:
                    continue
                rows = {name: np.array([each[name] for each in found]) for name in found[0]}
                table[f"{kind}, {condition}"] = {
                    name: {
                        "cover": float(np.mean(np.abs(values[:, 0]) < 1.96)),
                        "rms of error over deviation": float(np.sqrt(np.mean(values[:, 0] ** 2))),
                        "median deviation": float(np.median(values[:, 1])),
                    }
                    for name, values in rows.items()
                }
                if not arguments.json:
                    cells = [
                        f"{name} {100 * c['cover']:.0f} % ({c['rms of error over deviation']:.2f}; "
                        f"{100 * c['median deviation']:.1f} %)"
                        for name, c in table[f"{kind}, {condition}"].items()
                    ]
                    over = sum(1 for each in found if not next(iter(each.values()))[2])
                    print(
                        f"{kind}, {condition}, {len(found)} seeds: "
                        + ", ".join(cells)
                        + (f"; {over} not ended" if over else ""),
                        flush=True,
                    )
    if arguments.json:
        print(json.dumps(table, indent=2))


if __name__ == "__main__":
    main()
