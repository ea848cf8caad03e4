"""Changes of heading by 90 deg: overshoot and settling beside the quickest turn that the rudder allows; a table.

    python benchmarks/turns.py [--noise-deg 0.3]

The pilot with gains of level 5 (the course-unstable boat: 7) and the turn it plans by itself, 10 Hz compass with noise
and gyro, rudder with 0.1 s lag and 0.1 s of delay in all; the boat turns as her model says (K 1.0), or as if K were
30 % less or more. Settled: within 1 deg of the new heading, to stay. Quickest: `time_optimal.bang_bang`, which knows of
no lag and no delay. Reserve: the quickest turn that is ended with RESERVED of the rudder's angle and rate, so that a
rudder which is as much weaker than the model's would still end it, and the same up to 1 deg from its end.
"""

from __future__ import annotations

import argparse
import math
from typing import NamedTuple

import numpy as np
from time_optimal import bang_bang, settled

from autopilot.angles import wrap
from autopilot.build import build_pilot
from autopilot.build_laws import gear_of, limits_of, model_of
from autopilot.control.design import design_backstepping
from autopilot.models.norrbin import Norrbin, rate_step
from autopilot.models.steering_gear import DelayLine, SteeringGear, gear_step
from autopilot.params.vessel import Backstepping, Control, Model, Rudder, Sensors, Vessel
from autopilot.signals import HeadingSample, Order, OrderKind, Sample

CONTROL_S, STEPS_A_TICK = 0.05, 5
TURN = math.radians(90.0)
BEFORE_S = 20.0
SETTLED = math.radians(1.0)
RESERVED = 0.7


class Boat(NamedTuple):
    """Model, rudder angle [deg] and rate [deg/s], response level."""

    model: Norrbin
    angle_deg: float
    rate_deg_s: float
    level: int = 5


BOATS = {
    "lanxin": Boat(Norrbin(0.701, 0.332, 3.2828, reference_speed=4.63), 30.0, 15.0),
    # as `autopilot identify` finds it from the six recordings (docs/identification.md), rudder as recorded
    "esso": Boat(Norrbin(0.10405, 11.871, n0=0.0027844, reference_speed=0.23307), 35.0, 5.9),
    "coaster": Boat(Norrbin(0.1, 20.0, 50.0, reference_speed=6.0), 30.0, 2.5),
    "unstable": Boat(Norrbin(0.2, 5.0, 20.0, n1=-1.0, reference_speed=3.0), 30.0, 5.0, 7),
}


class Turned(NamedTuple):
    """overshoot [deg] and settling [s] of a turn; inf: not settled."""

    overshoot_deg: float
    settling_s: float


def vessel_of(boat: Boat) -> Vessel:
    """Return the boat's vessel, gains designed from its model."""
    model, rate = boat.model, boat.rate_deg_s
    gear = SteeringGear(math.radians(boat.angle_deg), math.radians(rate), 0.1, 0.0, 0.05)
    gains = design_backstepping(model, gear, gear.rate_max, 0.05, boat.level)
    return Vessel(
        2,
        "turning boat",
        Model(model.gain, model.time_constant, model.reference_speed, model.n1, model.n3, n0_rad_s=model.n0),
        Rudder(boat.angle_deg, rate, 0.1, 0.05),
        sensors=Sensors(heading_noise_deg=0.3, rate_noise_deg_s=0.2),
        control=Control(backstepping=Backstepping(*gains)),
    )


def quickest(boat: Boat, braked: float = 1.0) -> float:
    """Return the least time [s] of the turn, as the model has it, her trim aside; `braked` as in `bang_bang`."""
    return bang_bang(
        boat.model._replace(n0=0.0), math.radians(boat.angle_deg), math.radians(boat.rate_deg_s), TURN, braked
    )


def settled_with_reserve(boat: Boat) -> float:
    """Return when [s] the turn with reserve is within 1 deg of its end."""
    model, limits = boat.model._replace(n0=0.0), (math.radians(boat.angle_deg), math.radians(boat.rate_deg_s))
    return settled(model, *limits, TURN, RESERVED, SETTLED)


def turned(boat: Boat, gain_factor: float, noise_deg: float, seconds: float, seed: int = 1) -> Turned:
    """Return how the pilot turns a boat whose K is `gain_factor` times the model's, watched for `seconds`."""
    vessel = vessel_of(boat)
    true, gear, limits = model_of(vessel), gear_of(vessel), limits_of(vessel)
    true = true._replace(gain=true.gain * gain_factor)
    pilot, random, line = build_pilot(vessel), np.random.default_rng(seed), DelayLine(gear.delay)
    heading = rate = rudder = 0.0
    errors = []
    h = CONTROL_S / STEPS_A_TICK
    for index in range(round((BEFORE_S + seconds) / CONTROL_S)):
        now = index * CONTROL_S
        samples: tuple[Sample, ...] = ()
        if index % 2 == 0:
            noise = math.radians(noise_deg) * random.standard_normal(2) * (1.0, 2.0 / 3.0)
            samples = (HeadingSample(now, wrap(heading + noise[0]), rate + noise[1]),)
        order = Order(OrderKind.HEADING, 0.0 if now < BEFORE_S else TURN, serial=1)
        told = pilot.step(now, samples, order).command.angle
        assert abs(told) <= limits.angle_max
        line.give(now, told)
        for step in range(STEPS_A_TICK):
            rudder = gear_step(gear, rudder, line.effective(now + step * h), h)
            before, rate = rate, rate_step(true, rate, rudder, h)
            heading += 0.5 * h * (before + rate)
        if now >= BEFORE_S:
            errors.append(heading - TURN)
    outside = np.flatnonzero(np.abs(errors) > SETTLED)
    settling = float(outside[-1] + 1) * CONTROL_S if outside[-1] + 1 < len(errors) else math.inf
    return Turned(math.degrees(max(errors)), settling)


def main() -> None:
    """Turn every boat and print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--noise-deg", type=float, default=0.3)
    noise = parser.parse_args().noise_deg
    print("boat      quickest    settling/quickest      overshoot [deg]      with reserve/quickest")
    print("            [s]      K 1.0   0.7   1.3     K 1.0   0.7   1.3      at rest   within 1 deg")
    for name, boat in BOATS.items():
        least = quickest(boat)
        found = [turned(boat, factor, noise, 8.0 * least) for factor in (1.0, 0.7, 1.3)]
        settling = "".join(f"{one.settling_s / least:6.2f}" for one in found)
        overshoot = "".join(f"{one.overshoot_deg:6.2f}" for one in found)
        reserve = f"{quickest(boat, RESERVED) / least:9.2f}{settled_with_reserve(boat) / least:12.2f}"
        print(f"{name:9s} {least:7.1f}    {settling}    {overshoot}     {reserve}", flush=True)


if __name__ == "__main__":
    main()
