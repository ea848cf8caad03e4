"""A boat that shares nothing with the project: it imports none of it. Many recordings of zigzags side by side, or one
of a boat that changes on the way.

    r' = a delta - b r - d r^3 - e + a g(t),    psi' = r

a = K/T, b = n1/T, d = n3/T, e = n0/T. Runge and Kutta's fourth order in steps of 10 ms; the rudder follows its order at
a limited rate and angle; g is what gusts (first-order, coloured) and waves (a lightly damped oscillator driven by
noise) are worth in rudder angle.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

FINE_S, EVERY = 0.01, 10
"""Steps of 10 ms; a record at 10 Hz."""
SPEED_M_S = 5.0


class Plant(NamedTuple):
    """The boat's own coefficients (see above), its rudder's rate [deg/s], and how long each zigzag lasts [s]."""

    name: str
    a: float
    b: float
    d: float
    e: float
    rudder_rate_deg_s: float
    seconds: float


class Sea(NamedTuple):
    """Gusts and waves [deg of rudder, rms], their time [s] and period [s]; noise of compass [deg], gyro [deg/s, none
    where it is not recorded], rudder [deg] and speed [share]."""

    name: str
    gust_deg: float = 0.0
    gust_time_s: float = 5.0
    wave_deg: float = 0.0
    wave_period_s: float = 5.0
    compass_deg: float = 0.3
    gyro_deg_s: float | None = None
    rudder_deg: float = 0.0
    speed_share: float = 0.0


def zigzags(
    plant: Plant, sea: Sea, seeds: list[int], side: int, angle_deg: float = 20.0, with_orders: bool = False
) -> list[dict[str, FloatArray]]:
    """Return a 20/20 zigzag for each seed, the rudder put over to `side` (+1 starboard) first: columns in SI units, if
    asked for with `order_rad`, what was ordered of the rudder in each step of FINE_S."""
    count, steps = len(seeds), round(plant.seconds / FINE_S)
    randoms = [np.random.default_rng([seed, 0 if side > 0 else 1]) for seed in seeds]
    pushes = np.array([_pushes(sea, random, steps) for random in randoms])
    angle, rate_max = math.radians(angle_deg), math.radians(plant.rudder_rate_deg_s) * FINE_S
    order = np.full(count, side * angle)
    psi, r, rudder = np.zeros(count), np.zeros(count), np.zeros(count)
    rows, orders = np.empty((count, steps // EVERY, 3)), np.empty((count, steps))

    def turning(rate: FloatArray, angle_: FloatArray) -> FloatArray:
        return plant.a * angle_ - (plant.b + plant.d * rate * rate) * rate - plant.e

    for i in range(steps):
        if i % EVERY == 0:
            rows[:, i // EVERY] = np.stack([psi, r, rudder], axis=1)
        order = orders[:, i] = np.where(psi * np.sign(order) >= angle, -order, order)
        moved = np.clip(rudder + np.clip(order - rudder, -rate_max, rate_max), -0.61, 0.61)
        begin, end = rudder + pushes[:, i], moved + pushes[:, i]
        middle, h = 0.5 * (begin + end), FINE_S
        k1 = turning(r, begin)
        k2 = turning(r + 0.5 * h * k1, middle)
        k3 = turning(r + 0.5 * h * k2, middle)
        k4 = turning(r + h * k3, end)
        psi = psi + h * (r + h / 6.0 * (k1 + k2 + k3))
        r = r + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
        rudder = moved
    tables = [_recorded(row, sea, random) for row, random in zip(rows, randoms, strict=True)]
    if with_orders:
        tables = [{**table, "order_rad": order} for table, order in zip(tables, orders, strict=True)]
    return tables


class Boat(NamedTuple):
    """The boat's own coefficients at SPEED_M_S (see above)."""

    a: float
    b: float
    d: float
    e: float


def sailed(
    boat: Boat,
    sea: Sea,
    seed: int | list[int],
    seconds: float,
    side: float = 1.0,
    heading: float = 0.0,
    helm: Callable[[float, float, float], float] | None = None,
    later: Boat | None = None,
    wind: float = 0.0,
    veer: float = 0.0,
    stop: float = 0.61,
    play: float = 0.0,
    slow: float = 1.0,
    slow_from: float = 0.5,
    log_stuck: bool = False,
    anchor: float = 0.0,
) -> dict[str, FloatArray]:
    """Return one record: a 20/20 zigzag to `side` about a `heading` [rad], or what the `helm` orders [rad] by time,
    heading and rate.

    later: the boat from the middle on. wind: its moment abeam in rudder angle [rad], sin of its angle off the bow, from
    90 deg off `heading`, and by how much [rad] it veers until the end. stop, play: from where on the rudder in
    the water stands still, and its play to either side [rad]; the record has neither. slow: the speed's
    share from that part of the record on, which the log does not show where it is stuck. anchor: a moment towards
    `heading` [1/s^2].
    """
    random = np.random.default_rng(seed)
    steps = round(seconds / FINE_S)
    pushes, travel = _pushes(sea, random, steps).tolist(), math.radians(15.0) * FINE_S
    angle, psi, r, rudder, water, steers = math.radians(20.0), heading, 0.0, 0.0, 0.0, 0.0
    over, rows, h, speed = side * angle, [], FINE_S, SPEED_M_S
    for i in range(steps):
        time = i * FINE_S
        aim = SPEED_M_S * (slow if time >= slow_from * seconds else 1.0)
        # a boat loses its way within seconds
        speed = aim if time == 0.0 else speed + (aim - speed) * FINE_S / 5.0
        if i % EVERY == 0:
            rows.append((psi, r, rudder, SPEED_M_S if log_stuck else speed))
        over = -over if (psi - heading) * math.copysign(1.0, over) >= angle else over
        order = over if helm is None else helm(time, psi, r)
        rudder = min(max(rudder + min(max(order - rudder, -travel), travel), -0.61), 0.61)
        water = min(max(water, rudder - play), rudder + play)
        before, steers = steers, min(max(water, -stop), stop)
        a, b, d, e = later if later is not None and time > 0.5 * seconds else boat
        u = speed / SPEED_M_S
        blows = wind * math.sin(0.5 * math.pi + veer * time / seconds - (psi - heading))
        drive = u * u * (a * (0.5 * (before + steers) + pushes[i]) - e) + a * blows - anchor * (psi - heading)
        middle = r + 0.5 * h * (drive - u * b * r - d / u * r * r * r)
        psi, r = psi + h * middle, r + h * (drive - u * b * middle - d / u * middle * middle * middle)
    recorded = np.array(rows)
    table = _recorded(recorded[:, :3], sea, random)
    return {**table, "speed_m_s": table["speed_m_s"] * recorded[:, 3] / SPEED_M_S}


class ThrustBoat(NamedTuple):
    """A boat that thrust steers: r' = beta f^q delta + beta g - (a + c (f - 1)) r - d r^3, at f times the thrust that
    gives 1 m/s, and as many m/s; gusts do not grow with it. rate: of the angle delta [rad/s]."""

    beta: float = 1.6
    q: float = 2.0
    a: float = 0.8
    c: float = 0.5
    d: float = 1.5
    rate: float = 2.0


def thrust_zigzag(
    boat: ThrustBoat, share: float, sea: Sea, seed: list[int], seconds: float = 60.0, answers: bool = True
) -> dict[str, FloatArray]:
    """Return a zigzag of 0.2 rad about 0.3 rad of heading at `share` times the thrust, at 20 Hz: columns in SI units.
    Runge and Kutta's second order. answers: the helm sees what gusts do to the boat, else that boat in a calm."""
    random, h, steps = np.random.default_rng(seed), FINE_S, round(seconds / FINE_S)
    pushes = boat.beta * _pushes(sea, random, steps)
    still, here, angle, order, rows = (0.0, 0.0), (0.0, 0.0), 0.0, 0.2, []
    effect, damping = boat.beta * share**boat.q, boat.a + boat.c * (share - 1.0)

    def moved(heading: float, rate: float, drive: float) -> tuple[float, float]:
        middle = rate + 0.5 * h * (drive - damping * rate - boat.d * rate**3)
        return heading + h * middle, rate + h * (drive - damping * middle - boat.d * middle**3)

    for i, push in enumerate(pushes.tolist()):
        if i % 5 == 0:
            rows.append((*here, angle))
        order = -order if (here if answers else still)[0] * math.copysign(1.0, order) >= 0.3 else order
        before, angle = angle, angle + min(max(order - angle, -boat.rate * h), boat.rate * h)
        drive = 0.5 * effect * (before + angle)
        still, here = moved(*still, drive), moved(*here, drive + push)
    table = _recorded(np.array(rows), sea, random)
    return {**table, "time_s": 0.5 * table["time_s"], "speed_m_s": share / SPEED_M_S * table["speed_m_s"]}


def _recorded(row: FloatArray, sea: Sea, random: np.random.Generator) -> dict[str, FloatArray]:
    size = row.shape[0]
    table = {
        "time_s": np.arange(size) * FINE_S * EVERY,
        "heading_rad": row[:, 0] + math.radians(sea.compass_deg) * random.normal(size=size),
        "rudder_rad": row[:, 2] + math.radians(sea.rudder_deg) * random.normal(size=size),
        "speed_m_s": SPEED_M_S * (1.0 + sea.speed_share * random.normal(size=size)),
    }
    if sea.gyro_deg_s is not None:
        table["yaw_rate_rad_s"] = row[:, 1] + math.radians(sea.gyro_deg_s) * random.normal(size=size)
    return table


def _pushes(sea: Sea, random: np.random.Generator, steps: int) -> FloatArray:
    """Return gusts and waves [rad of rudder] at each step."""
    keep = math.exp(-FINE_S / sea.gust_time_s)
    gust, wave, wave_rate = random.normal(), random.normal(), random.normal()
    omega, damping = 2.0 * math.pi / sea.wave_period_s, 0.1
    drive = math.sqrt(4.0 * damping * omega * FINE_S)  # in units of the frequency: rms 1
    white = random.normal(size=(steps, 2)).tolist()
    result = []
    for first, second in white:
        gust = keep * gust + math.sqrt(1.0 - keep * keep) * first
        wave_rate += -FINE_S * omega * (2.0 * damping * wave_rate + wave) + drive * second
        wave += FINE_S * omega * wave_rate
        result.append(sea.gust_deg * gust + sea.wave_deg * wave)
    return np.radians(result)
