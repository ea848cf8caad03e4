"""Trials of a simulated boat, integrated here on their own: no code is shared with the identification."""

from __future__ import annotations

import math
import os
from pathlib import Path

import numpy as np

from autopilot.identification.runs import FloatArray, Orders, Run, run_from_columns

LANXIN = {"K": 0.701, "T": 0.332, "n3": 3.2828}

RECORDINGS = Path(os.environ.get("NORRBIN_DATA", Path(__file__).resolve().parents[1] / ".." / "shared" / "data"))


def zigzag(
    angle: float,
    seconds: float,
    spacing: float,
    *,
    K: float = LANXIN["K"],
    T: float = LANXIN["T"],
    n3: float = LANXIN["n3"],
    n1: float = 1.0,
    n2: float = 0.0,
    n0: float = 0.0,
    lag: float = 0.0,
    rudder_rate: float = np.radians(20.0),
    speed: float = 5.0,
    gust: float = 0.0,
    gust_memory: float = 1.0,
    seed: int = 0,
) -> dict[str, FloatArray]:
    """Return the record of a zigzag: Heun steps of 5 ms, rudder slewing at `rudder_rate` [rad/s].

    lag [s]: between the rudder that is recorded and the one in the water. gust: standard deviation [rad of rudder] of a
    disturbance that forgets itself in `gust_memory` [s].
    """
    dt, random = 0.005, np.random.default_rng(seed)
    count = int(seconds / dt)
    table = np.empty((count, 4))
    rate = heading = rudder = wind = wet = 0.0
    order = angle
    keep = np.exp(-dt / gust_memory)
    for i in range(count):
        table[i] = i * dt, heading, rate, rudder
        if heading * np.sign(order) >= abs(angle):
            order = -order
        wind = keep * wind + gust * np.sqrt(1.0 - keep**2) * random.normal() if gust else 0.0
        moved = rudder + float(np.clip(order - rudder, -rudder_rate * dt, rudder_rate * dt))
        recorded = 0.5 * (rudder + moved)
        wet = recorded + (wet - recorded) * np.exp(-dt / lag) if lag else recorded
        push = K * (wet + wind) - n0
        slope = (push - n1 * rate - n2 * rate**2 - n3 * rate**3) / T
        guess = rate + dt * slope
        slope = 0.5 * (slope + (push - n1 * guess - n2 * guess**2 - n3 * guess**3) / T)
        heading += dt * (rate + 0.5 * dt * slope)
        rate += dt * slope
        rudder = moved
    every = table[:: round(spacing / dt)]
    return {
        "time_s": every[:, 0],
        "heading_rad": every[:, 1],
        "yaw_rate_rad_s": every[:, 2],
        "rudder_rad": every[:, 3],
        "speed_m_s": np.full(every.shape[0], speed),
    }


def run_of(table: dict[str, FloatArray], source: str = "simulated") -> Run:
    return run_from_columns(source, table)


def noisy(table: dict[str, FloatArray], rate: float, heading: float, seed: int) -> dict[str, FloatArray]:
    """Return the record with white noise on yaw rate [rad/s] and heading [rad]."""
    random = np.random.default_rng(seed)
    size = table["time_s"].size
    return {
        **table,
        "yaw_rate_rad_s": table["yaw_rate_rad_s"] + rate * random.normal(size=size),
        "heading_rad": table["heading_rad"] + heading * random.normal(size=size),
    }


def rudder_with_play(play_deg: float, angles_deg: tuple[float, ...] = (10.0, 20.0), zero_deg: float = 0.0) -> Orders:
    """Return zigzags with those angles at 20 deg/s, and what a sensor behind a play to either side shows of them."""
    random, time, play = np.random.default_rng(2026112711), np.arange(0.0, 64.0, 0.05), math.radians(play_deg)
    half = (time // 8.0).astype(int)
    order = np.radians(np.array(angles_deg)[half // 4 % len(angles_deg)] * np.where(half % 2, -1.0, 1.0))
    ordered, angles = [float(order[0])], [float(order[0]) - play]
    for goal in order[1:].tolist():
        most = math.radians(1.0)
        ordered.append(ordered[-1] + min(max(goal - ordered[-1], -most), most))
        angles.append(min(max(angles[-1], ordered[-1] - play), ordered[-1] + play))
    noise = math.radians(zero_deg) + math.radians(0.2) * random.standard_normal(time.size)
    return Orders(time, np.array(ordered), time, np.array(angles) + noise)
