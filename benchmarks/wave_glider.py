"""A worked example: both bodies of a simulated wave glider, identified from one recording.

    python benchmarks/wave_glider.py [--seconds 600] [--seed 1] [--methods output-error integral]

A wave glider is a float on the surface, and a glider below it that pulls it along by a tether.

    glider  T_G r_G' + r_G + n3_G r_G^3 = K_G delta_r
    float   T_F r_F' + r_F + n3_F r_F^3 = K_F delta_F,      delta_F = delta_0 sin(psi_G - psi_F)

The glider has the real rudder delta_r. The float has none: the tether turns it towards the glider, with most effect at
right angles, which acts like a rudder of the equivalent angle delta_F. delta_0 is a fixed angle; only the product
K_F delta_0 is a property of the float. Source: patent application of Harbin Engineering University (Liao et al., 2019).

Beside the two equations there is what they leave out: the tether's pull turns the glider back a little, waves carry the
speed up and down and shake both headings, the rudder follows its orders at a finite rate, and compasses and gyros are
noisy. The numbers are of the size of a small wave glider and belong to no real one.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from autopilot.identification.feedback_particle import FloatArray
from autopilot.identification.identified import Question
from autopilot.identification.registry import method_named
from autopilot.identification.runs import Run, run_from_columns
from autopilot.models.norrbin import Norrbin, at_speed_ratio, yaw_acceleration
from autopilot.models.steering_gear import SteeringGear, gear_step

STEP_S = 0.02


class WaveGlider(NamedTuple):
    """Models of float and glider at their reference speed, and the fixed angle delta_0 [rad]."""

    surface: Norrbin
    glider: Norrbin
    fixed_angle: float


class TwoBodies(NamedTuple):
    """Headings [rad] and rates [rad/s] of float and glider."""

    surface_heading: float = 0.0
    surface_rate: float = 0.0
    glider_heading: float = 0.0
    glider_rate: float = 0.0


def equivalent_rudder(fixed_angle: float, glider_heading: float, surface_heading: float) -> float:
    """Return delta_F = delta_0 sin(psi_G - psi_F) [rad], the rudder angle that the tether is worth to the float."""
    return fixed_angle * math.sin(glider_heading - surface_heading)


def derivative(craft: WaveGlider, bodies: TwoBodies, rudder: float) -> TwoBodies:
    """Return the rates [rad/s] and accelerations [rad/s^2] under the glider's `rudder` [rad]."""
    pull = equivalent_rudder(craft.fixed_angle, bodies.glider_heading, bodies.surface_heading)
    return TwoBodies(
        bodies.surface_rate,
        yaw_acceleration(craft.surface, bodies.surface_rate, pull),
        bodies.glider_rate,
        yaw_acceleration(craft.glider, bodies.glider_rate, rudder),
    )


def step(craft: WaveGlider, bodies: TwoBodies, rudder: float, dt: float) -> TwoBodies:
    """Return the bodies one classical Runge-Kutta step of `dt` [s] later, the rudder [rad] held."""
    k1 = derivative(craft, bodies, rudder)
    k2 = derivative(craft, _moved(bodies, k1, 0.5 * dt), rudder)
    k3 = derivative(craft, _moved(bodies, k2, 0.5 * dt), rudder)
    k4 = derivative(craft, _moved(bodies, k3, dt), rudder)
    mean = TwoBodies(*((a + 2.0 * (b + c) + d) / 6.0 for a, b, c, d in zip(k1, k2, k3, k4, strict=True)))
    return _moved(bodies, mean, dt)


def at_speed(craft: WaveGlider, ratio: float) -> WaveGlider:
    """Return the craft at `ratio` > 0 times its reference speed; both bodies scale like ships."""
    return craft._replace(surface=at_speed_ratio(craft.surface, ratio), glider=at_speed_ratio(craft.glider, ratio))


def _moved(bodies: TwoBodies, slope: TwoBodies, dt: float) -> TwoBodies:
    return TwoBodies(*(value + dt * change for value, change in zip(bodies, slope, strict=True)))


class Setting(NamedTuple):
    """The craft and its surroundings.

    back_pull: share of the float's equivalent rudder that turns the glider back.  wave_speed: amplitude of the speed's
    change, a share, with the period wave_period [s].  shake [rad/s]: amplitude of the waves' yaw rate on the float, on
    the glider a quarter.  zigzag: rudder angle and heading change [rad].
    """

    craft: WaveGlider = WaveGlider(
        surface=Norrbin(0.5, 2.0, 5.0, reference_speed=0.7),
        glider=Norrbin(0.3, 3.0, 20.0, reference_speed=0.7),
        fixed_angle=math.radians(30.0),
    )
    gear: SteeringGear = SteeringGear(math.radians(35.0), math.radians(15.0), 0.2)
    back_pull: float = 0.02
    speed: float = 0.7
    wave_speed: float = 0.15
    wave_period: float = 6.0
    shake: float = math.radians(0.5)
    heading_noise: float = math.radians(0.3)
    rate_noise: float = math.radians(0.1)
    rudder_angle: float = math.radians(25.0)
    heading_change: float = math.radians(40.0)
    rate_hz: float = 5.0


COLUMNS = ("time_s", "rudder_rad", "speed_m_s", "float_rad", "float_rate_rad_s", "glider_rad", "glider_rate_rad_s")


class Moment(NamedTuple):
    """A time [s], with rudder [rad], speed [m/s], both bodies, and the waves' own yaw -1 ... 1."""

    time: float
    rudder: float
    speed: float
    bodies: TwoBodies
    wave: float


def sail(setting: Setting, duration: float, seed: int) -> dict[str, FloatArray]:
    """Return a zigzag that lasts `duration` [s] as columns by the names of `COLUMNS`."""
    random = np.random.default_rng(seed)
    bodies, rudder, order = TwoBodies(), 0.0, setting.rudder_angle
    rows: list[tuple[float, ...]] = []
    every = max(round(1.0 / (setting.rate_hz * STEP_S)), 1)
    for i in range(int(duration / STEP_S)):
        time = i * STEP_S
        wave = math.sin(2.0 * math.pi * time / setting.wave_period)
        speed = setting.speed * (1.0 + setting.wave_speed * wave)
        if i % every == 0:
            rows.append(_measured(setting, random, Moment(time, rudder, speed, bodies, wave)))
        if bodies.glider_heading * math.copysign(1.0, order) >= setting.heading_change:
            order = -order
        rudder = gear_step(setting.gear, rudder, order, STEP_S)
        craft = at_speed(setting.craft, speed / setting.craft.surface.reference_speed)
        pull = equivalent_rudder(craft.fixed_angle, bodies.glider_heading, bodies.surface_heading)
        bodies = step(craft, bodies, rudder - setting.back_pull * pull, STEP_S)
    return dict(zip(COLUMNS, np.array(rows).T, strict=True))


def _measured(setting: Setting, random: np.random.Generator, now: Moment) -> tuple[float, ...]:
    """Return a row: what the instruments show, the waves' own yaw on top of the equations' motion."""
    omega = 2.0 * math.pi / setting.wave_period
    swing = math.cos(omega * now.time) / omega
    bodies, row = now.bodies, [now.time, now.rudder, now.speed]
    for heading, rate, share in (
        (bodies.surface_heading, bodies.surface_rate, setting.shake),
        (bodies.glider_heading, bodies.glider_rate, 0.25 * setting.shake),
    ):
        seen = heading - share * swing + setting.heading_noise * random.standard_normal()
        row += [seen % math.tau, rate + share * now.wave + setting.rate_noise * random.standard_normal()]
    return tuple(row)


def runs_of(columns: Mapping[str, FloatArray], fixed_angle: float) -> dict[str, Run]:
    """Return the runs of float and glider, each under its own rudder: the equivalent one, with `fixed_angle` [rad] for
    delta_0, and the real one."""
    heading = {"float": columns["float_rad"], "glider": columns["glider_rad"]}
    rudder = {"float": fixed_angle * np.sin(heading["glider"] - heading["float"]), "glider": columns["rudder_rad"]}
    return {
        body: run_from_columns(
            body,
            {
                "time_s": columns["time_s"],
                "speed_m_s": columns["speed_m_s"],
                "rudder_rad": rudder[body],
                "heading_rad": heading[body],
                "yaw_rate_rad_s": columns[f"{body}_rate_rad_s"],
            },
        )
        for body in heading
    }


def identified(setting: Setting, columns: Mapping[str, FloatArray], method: str) -> dict[str, Norrbin]:
    """Return the models of float and glider that a method finds."""
    question = Question("norrbin", setting.craft.surface.reference_speed)
    runs = runs_of(columns, setting.craft.fixed_angle)
    return {body: method_named(method).identify([run], question).model for body, run in runs.items()}


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=600.0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--methods", nargs="+", default=["output-error", "integral", "two-stage"])
    arguments = parser.parse_args()
    setting = Setting()
    columns = sail(setting, arguments.seconds, arguments.seed)
    for name in ("truth", *arguments.methods):
        truth = {"float": setting.craft.surface, "glider": setting.craft.glider}
        bodies = truth if name == "truth" else identified(setting, columns, name)
        found = (f"{body} K {m.gain:.3f} T {m.time_constant:.2f} n3 {m.n3:.1f}" for body, m in bodies.items())
        print(f"{name:14}", "   ".join(found), flush=True)


if __name__ == "__main__":
    main()
