"""Vessel files of boats that others measured or modelled: `firmware_params/vessels/` holds what this prints.

    python benchmarks/published_boats.py NAME FOLDER      the vessel file, and of a simulated boat its recordings

Two kinds. Where K, T and n3 are printed, they are taken as printed. Where a hull's forces are printed, the hull is
simulated here, sails zigzags, and `autopilot identify` makes the model, as a skipper's recordings would; the hull's
equations are nowhere Norrbin's. Rudder positive to starboard.
"""

from __future__ import annotations

import argparse
import csv
import math
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
import zoo_vessels

from autopilot.vessel.file import load_vessel

DATE = "2026-11-24"
STEP_S, EVERY = 0.05, 20
HEADING_NOISE_DEG, RATE_NOISE_DEG_S, SPEED_NOISE_M_S = 0.1, 0.01, 0.02
"""Of a ship's gyrocompass with rate output and a log, for the recordings."""

State = tuple[float, ...]
Forces = Callable[[State, float], State]
"""The derivatives of surge, sway [m/s], yaw rate [rad/s], and what else the hull knows, at a rudder [rad]."""


def mariner(state: State, rudder: float) -> State:
    """Mariner class, 160.93 m, 15 kn: surge, sway and yaw by a Taylor series.

    Chislett and Stroem-Tejsen 1965, Hydro- and Aerodynamics Laboratory report Hy-5; coefficients as printed in the
    Marine Systems Simulator's `mariner.m`.
    """
    service, L = 7.7175, 160.93
    U = math.hypot(state[0], state[1])
    u, v, r, d = (state[0] - service) / U, state[1] / U, state[2] * L / U, -rudder
    m, inertia, centre = 798e-5, 39.2e-5, -0.023
    m11, m22, m23 = m + 42e-5, m + 748e-5, m * centre + 9.354e-5
    m32, m33 = m * centre - 4.646e-5, inertia + 43.8e-5
    X = u * (-184e-5 + u * (-110e-5 - 215e-5 * u)) - 899e-5 * v * v + 18e-5 * r * r + 798e-5 * r * v
    X += d * d * (-95e-5 - 190e-5 * u) + 93e-5 * v * d * (1.0 + u)
    Y = -1160e-5 * v * (1.0 + u) - 499e-5 * r * (1.0 + u) - 8078e-5 * v**3 + 15356e-5 * v * v * r
    Y += 278e-5 * d * (1.0 + u) ** 2 - 90e-5 * d**3 - 4e-5 * v * d * d + 1190e-5 * v * v * d - 4e-5 * (1.0 + u) ** 2
    N = -264e-5 * v * (1.0 + u) - 166e-5 * r * (1.0 + u) + 1636e-5 * v**3 - 5483e-5 * v * v * r
    N += -139e-5 * d * (1.0 + u) ** 2 + 45e-5 * d**3 + 13e-5 * v * d * d - 489e-5 * v * v * d + 3e-5 * (1.0 + u) ** 2
    det = m22 * m33 - m23 * m32
    return X * U * U / L / m11, (m33 * Y - m23 * N) * U * U / L / det, (m22 * N - m32 * Y) * (U / L) ** 2 / det


def tanker(state: State, rudder: float) -> State:
    """Esso tanker of 190,000 dwt, 304.8 m, in deep water, propeller at 80 rpm.

    Van Berlekom and Goddard 1972, Transactions of SNAME 80, appendix A; coefficients as printed in the Marine Systems
    Simulator's `tanker.m`.
    """
    L, n = 304.8, 80.0 / 60.0
    u, v, r = state
    d, drift = -rudder, math.atan2(v, u)
    pull = -0.00695 * u * u / L - 0.00063 * u * n + L * 0.0000354 * n * n
    square = 0.605 * u * n + 38.2 * n * n
    bent = square * abs(drift) * drift * abs(d)
    X = (-0.0377 * u * u + 2.020 * L * v * r + 0.3 * v * v - 0.093 * square * d * d + 0.152 * square * drift * d) / L
    Y = (-1.205 * u * v - 2.400 * abs(v) * v + 0.208 * square * d - 0.752 * L * u * r - 2.16 * bent) / L
    N = -0.451 * u * v - 0.300 * L * abs(v) * r - 0.098 * square * d - 0.231 * L * u * r + 0.688 * bent
    return (
        (X + 0.78 * pull) / 1.050,
        (Y + 0.04 * pull) / 2.020,
        (N - 0.02 * L * pull) / (L * L * 0.1232),
    )


def container(state: State, rudder: float) -> State:
    """Container ship of 175 m (S-175), free to roll, propeller at 80 rpm.

    Son and Nomoto 1982, Naval Architecture and Ocean Engineering 20; coefficients as printed in the Marine Systems
    Simulator's `container.m`. Roll rate and roll follow the yaw rate.
    """
    L, g, n_rps = 175.0, 9.81, 80.0 / 60.0
    U = math.hypot(state[0], state[1])
    u, v, r, p, f = state[0] / U, state[1] / U, state[2] * L / U, state[3] * L / U, state[4]
    m, mx, my = 0.00792, 0.000238, 0.007049
    D, area, aspect = 6.533, 33.0376 / L**2, 6.13 * 1.8219 / (1.8219 + 2.25)
    inflow = 0.088 * v - 0.156 * r - 0.275 * r**3 + 1.96 * r * r * v
    uP = u * ((1.0 - 0.184) + 1.09 * (v - 0.526 * r) ** 2)
    J = uP * U / (n_rps * D)
    KT = 0.527 - 0.455 * J
    uR = uP * 0.921 * math.sqrt(1.0 + 8.0 * 0.631 * KT / (math.pi * J * J))
    FN = -aspect * area * (uR * uR + inflow * inflow) * math.sin(rudder + math.atan(inflow / uR))
    thrust = 2.0 * D**4 * KT * n_rps * n_rps / (U * L) ** 2
    weight = g * 21222.0 / (0.5 * L * L * U * U)
    X = -0.0004226 * u * u + 0.825 * thrust - 0.00311 * v * r - 0.00386 * v * v + 0.0002 * r * r - 0.0002 * f * f
    X += 0.71 * FN * math.sin(rudder) + (m + my) * v * r
    Y = -0.0116 * v + 0.00242 * r - 0.000063 * f - 0.109 * v**3 + 0.00177 * r**3 + 0.0214 * v * v * r
    Y += -0.0405 * v * r * r + 0.04605 * v * v * f + 0.00304 * v * f * f + 0.009325 * r * r * f - 0.001368 * r * f * f
    Y += 1.237 * FN * math.cos(rudder) - (m + mx) * u * r
    K = 0.0003026 * v - 0.000063 * r - 0.0000075 * p - 0.000021 * f + 0.002843 * v**3 - 0.0000462 * r**3
    K += -0.000588 * v * v * r + 0.0010565 * v * r * r - 0.0012012 * v * v * f - 0.0000793 * v * f * f
    K += -0.000243 * r * r * f + 0.00003569 * r * f * f
    K += -1.237 * 0.033 * FN * math.cos(rudder) + mx * 0.0313 * u * r - weight * 0.3 / L * f
    N = -0.0038545 * v - 0.00222 * r + 0.000213 * p - 0.0001424 * f + 0.001492 * v**3 - 0.00229 * r**3
    N += -0.0424 * v * v * r + 0.00156 * v * r * r - 0.019058 * v * v * f - 0.0053766 * v * f * f
    N += -0.0038592 * r * r * f + 0.0024195 * r * f * f + (-0.5 - 0.237 * 0.48) * FN * math.cos(rudder)
    m22, m32, m42 = m + my, -my * 0.0313, my * 0.05
    m33, m44 = 0.0000176 + 0.0000034, 0.000456 + 0.000419
    # sway, roll and yaw pull at one another as the simulator's mass matrix has it
    det = m22 * m33 * m44 - m32**2 * m44 - m42**2 * m33
    scale = U * U / L
    sway = (m33 * m44 * Y - m32 * m44 * K - m42 * m33 * N) / det
    yaw = (-m42 * m33 * Y + m32 * m42 * K + N * m22 * m33 - N * m32**2) / det
    roll = (-m32 * m44 * Y + K * m22 * m44 - K * m42**2 + m32 * m42 * N) / det
    return X * scale / (m + mx), sway * scale, yaw * scale / L, roll * scale / L, state[3]


class Boat(NamedTuple):
    """name, description and length [m] for the file; rudder: end stop [deg], rate [deg/s], lag [s]. Either printed:
    the lines of the model and where they come from; or forces, the state to begin with, and how long each of the
    zigzags lasts [s]. gear: where the rudder's numbers come from."""

    name: str
    description: str
    length: float
    rudder: tuple[float, float, float]
    gear: str
    printed: str = ""
    forces: Forces | None = None
    start: State = ()
    lasts: float = 0.0


PRINTED = """\
  K_1_s: {K}
  T_s: {T}
  n1: 1
  # {note}
  n3_s2_rad2: {n3:.1f}
  reference_speed_m_s: {U}
  source: {source}
  date: "1982\""""


def printed(K: float, T: float, n3_degrees: float, U: float, *, source: str) -> str:
    """Return the lines of a printed model; n3 [(s/deg)^2] as van Amerongen's rates in degrees have it."""
    note = f"{n3_degrees} (s/deg)^2 * (180/pi)^2: read in radians, 30 deg of rudder would turn it within a length."
    n3 = n3_degrees * math.degrees(1.0) ** 2
    return PRINTED.format(K=K, T=T, n3=n3, U=U, note=note, source=source)


AMERONGEN = "van Amerongen 1982, Adaptive Steering of Ships, as tabled in the Marine Systems Simulator's"
BOATS = {
    "zeefakkel": Boat(
        "Zeefakkel",
        "Training ship of the Dutch navy, 45 m, at 5 m/s; van Amerongen 1982",
        45.0,
        (30.0, 10.0, 0.0),
        "Marine Systems Simulator, zeefakkel.m",
        printed=printed(0.5, 31.0, 0.4, 5.0, source=f"{AMERONGEN} zeefakkel.m"),
    ),
    "frigate": Boat(
        "Frigate of 100 m",
        "Frigate of van Amerongen 1982, 100 m, at 9 m/s",
        100.0,
        (30.0, 10.0, 1.0),
        "Marine Systems Simulator, frigate.m",
        printed=printed(0.18, 27.0, 0.6, 9.0, source=f"{AMERONGEN} frigate.m"),
    ),
    "mariner": Boat(
        "Mariner class",
        "Cargo ship of 160.9 m at 15 kn, planar motion mechanism tests of Chislett and Stroem-Tejsen 1965",
        160.93,
        (40.0, 5.0, 0.0),
        "Marine Systems Simulator, mariner.m",
        forces=mariner,
        start=(7.7175, 0.0, 0.0),
        lasts=900.0,
    ),
    "container_ship": Boat(
        "Container ship S-175",
        "Container ship of 175 m, free to roll, Son and Nomoto 1982",
        175.0,
        (35.0, 5.0, 0.0),
        "rate of the Marine Systems Simulator, container.m; angle of SOLAS, assumed",
        forces=container,
        start=(8.0, 0.0, 0.0, 0.0, 0.0),
        lasts=900.0,
    ),
    "esso_tanker": Boat(
        "Esso tanker of 190,000 dwt",
        "Tanker of 304.8 m in deep water, van Berlekom and Goddard 1972",
        304.8,
        (35.0, 2.33, 0.0),
        "rate of the Marine Systems Simulator, tanker.m; angle of SOLAS, assumed",
        forces=tanker,
        start=(8.23, 0.0, 0.0),
        lasts=1800.0,
    ),
}
ESSO_OSAKA = """\
  # `autopilot identify` of four zigzags and two turns on an outdoor pond, in wind, from rudder, speed, heading and
  # rate, --reference-speed-m-s 0.5; the wind's n0 of those days is left out.
  K_1_s: 0.211
  T_s: 6.302
  n1: 1
  n3_s2_rad2: 29.99
  reference_speed_m_s: 0.5
  standard_errors:
    K_1_s: 0.024
    T_s: 1.2
    n3_s2_rad2: 26
  source: identified from recordings of NAOE-5thLab/FRT-DS-ESSO, Wakita 2022, Miyauchi 2022
  date: 2026-11-24"""
BOATS["esso_osaka"] = Boat(
    "Esso Osaka, model of 3 m",
    "Free-running model of the tanker Esso Osaka, 3.0 m; Wakita 2022, doi 10.1007/s00773-021-00867-1",
    3.0,
    (35.0, 11.6, 0.0),
    "angle and rate as recorded there",
    printed=ESSO_OSAKA,
)
ZIGZAGS = ((10.0, 10.0), (-10.0, 10.0), (20.0, 20.0), (-20.0, 20.0))
SETTLED_S = 1200.0
"""The engine's speed on a straight course is waited for."""


def stepped(forces: Forces, state: State, rudder: float) -> State:
    """Return the state a step later, by Runge and Kutta."""

    def along(slope: State, share: float) -> State:
        return tuple(x + share * STEP_S * dx for x, dx in zip(state, slope, strict=True))

    k1 = forces(state, rudder)
    k2 = forces(along(k1, 0.5), rudder)
    k3 = forces(along(k2, 0.5), rudder)
    k4 = forces(along(k3, 1.0), rudder)
    return along(tuple((a + 2.0 * b + 2.0 * c + d) / 6.0 for a, b, c, d in zip(k1, k2, k3, k4, strict=True)), 1.0)


def zigzag(boat: Boat, rudder_deg: float, heading_deg: float, seed: int) -> list[tuple[float, ...]]:
    """Return rows of time [s], heading [deg], yaw rate [deg/s], rudder [deg] and speed [m/s] of a zigzag."""
    assert boat.forces is not None
    random, state, heading, rudder = np.random.default_rng(seed), boat.start, 0.0, 0.0
    for _ in range(round(SETTLED_S / STEP_S)):
        state = stepped(boat.forces, state, 0.0)
    # a hull that is not quite symmetric has begun to turn
    state = (state[0], 0.0, 0.0, *(0.0 for _ in state[3:]))
    order, most = math.radians(rudder_deg), math.radians(boat.rudder[1]) * STEP_S
    rows = []
    for step in range(round(boat.lasts / STEP_S)):
        if heading * math.copysign(1.0, order) >= math.radians(heading_deg):
            order = -order
        rudder += min(max(order - rudder, -most), most)
        if step % EVERY == 0:
            noise = random.standard_normal(3)
            speed = math.hypot(state[0], state[1]) + SPEED_NOISE_M_S * noise[2]
            rate = math.degrees(state[2]) + RATE_NOISE_DEG_S * noise[1]
            rows.append(
                (step * STEP_S, math.degrees(heading) + HEADING_NOISE_DEG * noise[0], rate, math.degrees(rudder), speed)
            )
        before = state[2]
        state = stepped(boat.forces, state, rudder)
        heading += 0.5 * STEP_S * (before + state[2])
    return rows


def text_of(name: str, boat: Boat, model: str, control: str) -> str:
    """Return the vessel file with these two sections."""
    angle, rate, lag = boat.rudder
    return f"""# yaml-language-server: $schema=../schemas/vessel.schema.json
# A published boat. `python benchmarks/published_boats.py {name} FOLDER` writes this file again.
schema_version: 2
name: {boat.name}
description: {boat.description}
length_m: {boat.length:g}

model:
{model}

rudder:
  angle_max_deg: {angle:g}
  rate_max_deg_s: {rate:g}
  lag_s: {lag:g}
  source: {boat.gear}
  date: {DATE}

sensors:
  # ASSUMED: a ship's gyrocompass with its rate.
  heading_noise_deg: {HEADING_NOISE_DEG}
  rate_noise_deg_s: {RATE_NOISE_DEG_S}
  variation_deg: null       # set your chart's, or magnetic: true; a magnetic compass is not used else
  source: assumed, not measured
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


def model_of(name: str, boat: Boat, folder: Path) -> str:
    """Return the lines of the model: printed, or identified from zigzags."""
    if boat.printed:
        return boat.printed
    logs = []
    for number, (rudder, heading) in enumerate(ZIGZAGS):
        logs.append(folder / f"{name}_{number}.csv")
        with logs[-1].open("w", newline="", encoding="utf-8") as file:
            rows = csv.writer(file)
            rows.writerow(("time_s", "heading_deg", "yaw_rate_deg_s", "rudder_deg", "speed_m_s"))
            for row in zigzag(boat, rudder, heading, 100 + number):
                rows.writerow([f"{value:.6g}" for value in row])
    found = folder / f"{name}_identified.yaml"
    found.unlink(missing_ok=True)
    autopilot = [sys.executable, "-m", "autopilot", "identify", *map(str, logs)]
    subprocess.run([*autopilot, "--out", str(found), "--rudder-max-deg", f"{boat.rudder[0]:g}"], check=True)
    lines = zoo_vessels.model_of(name, load_vessel(str(found))).splitlines()
    lines = [line for line in lines if not line.strip().startswith("#")]
    source = f"  source: identified from zigzags of the published hull, benchmarks/published_boats.py {name}"
    return "\n".join([*(source if line.startswith("  source") else line for line in lines)])


def main() -> None:
    """Sail and identify where needed, and design."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("name", choices=sorted(BOATS))
    parser.add_argument("folder", type=Path)
    given = parser.parse_args()
    name, folder, boat = given.name, given.folder, BOATS[given.name]
    folder.mkdir(parents=True, exist_ok=True)
    vessel, model = folder / f"{name}.yaml", model_of(given.name, boat, folder)
    to_design = "  backstepping:\n    k1_1_s: 0.1\n    k2_1_s: 0.1\n  source: to be designed"
    vessel.write_text(text_of(name, boat, model, to_design), encoding="utf-8")
    gains = [sys.executable, "-m", "autopilot", "gains", str(vessel), "--out", str(vessel), "--overwrite"]
    subprocess.run(gains, check=True)
    control = zoo_vessels.control_of(load_vessel(str(vessel)))
    vessel.write_text(text_of(name, boat, model, control), encoding="utf-8")
    load_vessel(str(vessel))


if __name__ == "__main__":
    main()
