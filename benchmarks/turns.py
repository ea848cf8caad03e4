"""Changes of heading by 90 deg: overshoot and settling beside the quickest turn that the rudder allows; a table.

    python benchmarks/turns.py [--seeds 40] [--levels 3,5,8] [--boats unstable,unstable2] [--no-gyro] [--gusts-deg 1]
    python benchmarks/turns.py --summary --seeds 20 --boats unstable,unstable2,unstable3,unstable4,unstable5
    python benchmarks/turns.py --summary --seeds 20 --drawn 10

The pilot with gains of level 5 (the course-unstable boats: 7) and the turn it plans by itself, 10 Hz compass with
noise and gyro, rudder with 0.1 s lag and 0.1 s of delay in all; the boat turns as its model says (K 1.0), or as if K
were 30 % less or more. Settled: within 1 deg of the new heading, to stay; past: how far beyond it the boat goes;
medians over the seeds, the worst of them, and how many go past by more than 3 deg. Quickest: `time_optimal.bang_bang`,
which knows of no lag and no delay. Reserve: the quickest turn that is ended with RESERVED of the rudder's angle and
rate, so that a rudder which is as much weaker than the model's would still end it, and the same up to 1 deg from its
end. By the pilot's tick as campaigns have it, compiled (`norrbin[fast]`); `turned` does the same by `Pilot.step`. The
numbers of the plan were tuned on other seeds.

`--drawn` turns course-unstable boats that are drawn by a rule (`drawn`) in place of those named, so that what was tuned
on the named ones is seen on boats that nobody tuned for. `--summary` prints the boats together: with a gyro, without,
and in gusts, for K from 0.7 to 1.3 times the model's, the mean over the boats of the median settling time over the
quickest, how many turns go past by more than 3 deg, and how many are lost, that is, go past by more than 30 deg.
"""

from __future__ import annotations

import argparse
import functools
import math
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from time_optimal import bang_bang, settled

from autopilot.angles import wrap
from autopilot.control.backstepping import Backstepping
from autopilot.control.design import design_backstepping
from autopilot.control.registry import own_step
from autopilot.estimation.fusion import Measured
from autopilot.estimation.heading_ekf import initial
from autopilot.estimation.rudder_observer import RudderMemory
from autopilot.models.norrbin import Norrbin, rate_step
from autopilot.models.steering_gear import DelayLine, SteeringGear, gear_step
from autopilot.runtime.build import build_pilot, gear_of, limits_of, model_of
from autopilot.signals import HeadingSample, Order, OrderKind, Sample
from autopilot.vessel.schema import Control, Model, Rudder, Sensors, Vessel
from sitl.campaign.compiled_tick import CampaignConfig, Measurement, State, initial_state, tick
from sitl.campaign.setting import campaign_of
from sitl.compiled import compiled

CONTROL_S, STEPS_A_TICK = 0.05, 5
TURN = math.radians(90.0)
BEFORE_S = 20.0
SETTLED = math.radians(1.0)
RESERVED = 0.7
WEAKER, STRONGER = 0.7, 1.3
WATCHED = 3.0
"""A turn is watched for so many times the least time."""
FAR_DEG = 3.0
GYRO, GUST_TIME = math.radians(0.2), 10.0
RING = 64

Floats = npt.NDArray[np.float64]


class Boat(NamedTuple):
    """Model, rudder angle [deg] and rate [deg/s], response level."""

    model: Norrbin
    angle_deg: float
    rate_deg_s: float
    level: int = 5


BOATS = {
    "lanxin": Boat(Norrbin(0.701, 0.332, 3.2828, reference_speed=4.63), 30.0, 15.0),
    # as `autopilot identify` finds it from the six recordings (results/identification.md), rudder as recorded
    "esso": Boat(Norrbin(0.10405, 11.871, n0=0.0027844, reference_speed=0.23307), 35.0, 5.9),
    "coaster": Boat(Norrbin(0.1, 20.0, 50.0, reference_speed=6.0), 30.0, 2.5),
    "unstable": Boat(Norrbin(0.2, 5.0, 20.0, n1=-1.0, reference_speed=3.0), 30.0, 5.0, 7),
}


MORE = {
    "unstable2": Boat(Norrbin(0.12, 12.0, 60.0, n1=-0.5, reference_speed=5.0), 35.0, 3.5, 7),
    "unstable3": Boat(Norrbin(0.5, 2.0, 3.0, n1=-0.6, reference_speed=3.0), 30.0, 10.0, 7),
    "unstable4": Boat(Norrbin(0.2, 8.0, 20.0, n1=-1.0, reference_speed=3.0), 30.0, 5.0, 7),
    "unstable5": Boat(Norrbin(0.0434, 14.2, 31.0, n1=-0.5, reference_speed=5.0), 30.0, 3.0, 7),
}
"""Course-unstable boats made up to tune the plan with, beside the one above."""

DRAWN_SEED = 20261124
FACTORS = (0.7, 0.85, 1.0, 1.15, 1.3)
"""K of the boat in units of the model's, as `--summary` has it."""
LOST_DEG = 30.0
WATCHED_SUMMARY = 4.0
"""A turn of the summary is watched for so many times the least time, and counts as that where it never settles."""


class Sailed(NamedTuple):
    """Noise of the compass [deg], whether there is a gyro, gusts [deg] of rudder, and the turn [deg]."""

    noise_deg: float = 0.3
    has_gyro: bool = True
    gusts_deg: float = 0.0
    turn_deg: float = 90.0


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


def drawn(count: int, seed: int = DRAWN_SEED) -> dict[str, Boat]:
    """Return `count` course-unstable boats, drawn anew with every `seed`, level 7.

    T from 2 to 20 s and K T from 0.5 to 2 (both log-uniform), n1 from -1.1 to -0.3, and n3 such that the largest moment
    that the boat has against its rudder is 0.2 to 1 times what the rudder hard over gives; the rudder goes to 25 to 35
    deg, in 0.6 to 1.5 T (log-uniform) from amidships. A boat for which there are no gains is drawn again.
    """
    random, found = np.random.default_rng(seed), dict[str, Boat]()
    while len(found) < count:
        time_constant, turning = 2.0 * 10.0 ** random.random(), 0.5 * 4.0 ** random.random()
        n1, against = -random.uniform(0.3, 1.1), random.uniform(0.2, 1.0)
        angle_deg, over = float(round(random.uniform(25.0, 35.0))), 0.6 * 2.5 ** random.random()
        gain = turning / time_constant
        largest = against * gain * math.radians(angle_deg)
        n3 = -n1 / 3.0 * (2.0 / 3.0 * n1 / largest) ** 2
        model = Norrbin(*(_short(number) for number in (gain, time_constant, n3)), n1=_short(n1), reference_speed=4.0)
        boat = Boat(model, angle_deg, _short(angle_deg / (over * time_constant)), 7)
        try:
            vessel_of(boat)
        except ValueError:
            continue
        found[f"drawn{len(found) + 1}"] = boat
    return found


def _short(number: float) -> float:
    return float(f"{number:.3g}")


def quickest(boat: Boat, braked: float = 1.0) -> float:
    """Return the least time [s] of the turn, as the model has it, its trim aside; `braked` as in `bang_bang`."""
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
        command = pilot.step(now, samples, order).command.angle
        assert abs(command) <= limits.angle_max
        line.give(now, command)
        for step in range(STEPS_A_TICK):
            rudder = gear_step(gear, rudder, line.effective(now + step * h), h)
            before, rate = rate, rate_step(true, rate, rudder, h)
            heading += 0.5 * h * (before + rate)
        if now >= BEFORE_S:
            errors.append(heading - TURN)
    return judged(np.array(errors))


def swiftly(vessel: Vessel, factor: float, targets: Floats, noise: Floats, pushed: Floats) -> Floats:
    """Return the true heading [rad] tick by tick, by the campaigns' tick, compiled (`norrbin[fast]`): backstepping.

    targets: the heading ordered [rad], noise: of heading [rad] and rate [rad/s], nan: there is no gyro, pushed: rudder
    [rad], all tick by tick. K is `factor` times the model's.
    """
    campaign, gear = campaign_of(vessel, "backstepping"), gear_of(vessel)
    assert campaign is not None
    memory = RudderMemory(*np.zeros((6, RING)))
    filtered = initial(0.0, *seen_first(noise[0]), campaign.config.estimator.noises.usual)
    measurement = Measurement(Measured(0.0, filtered.psi, math.nan), math.nan)
    pilot_state = initial_state(campaign, filtered, 0.0, measurement, memory)
    model = campaign.config.estimator.model
    true = model._replace(gain=model.gain * factor)
    delayed = round(gear.delay * STEPS_A_TICK / CONTROL_S)
    return np.asarray(_compiled()(campaign, pilot_state, memory, true, gear, delayed, targets, noise, pushed))


def seen_first(noise: Floats) -> tuple[float, float | None]:
    """Return heading [rad] and rate [rad/s] as the instruments see them at rest on course; None: there is no gyro."""
    return wrap(float(noise[0])), None if math.isnan(noise[1]) else float(noise[1])


@functools.cache
def _compiled() -> Any:
    return compiled(_headings, instead=own_step("backstepping"))


def _headings(
    campaign: CampaignConfig,
    pilot_state: State,
    memory: RudderMemory,
    true: Norrbin,
    gear: SteeringGear,
    delayed: int,
    targets: Floats,
    noise: Floats,
    pushed: Floats,
) -> Floats:
    heading, rate, rudder, order, h = 0.0, 0.0, 0.0, 0.0, CONTROL_S / STEPS_A_TICK
    headings, command = np.zeros(len(pushed)), np.zeros(len(pushed))
    for index in range(len(pushed)):
        now = index * CONTROL_S
        if index > 0:
            seen = wrap(heading + noise[index, 0]) if index % 2 == 0 else math.nan
            turning = rate + noise[index, 1] if index % 2 == 0 else math.nan
            pilot_state = tick(
                campaign, pilot_state, memory, now, Measurement(Measured(now, seen, turning), math.nan), targets[index]
            )
        command[index] = pilot_state.command
        for step in range(STEPS_A_TICK):
            effective = index * STEPS_A_TICK + step - delayed
            if effective >= 0:
                order = command[effective // STEPS_A_TICK]
            rudder = gear_step(gear, rudder, order, h)
            before, rate = rate, rate_step(true, rate, rudder + pushed[index], h)
            heading += 0.5 * h * (before + rate)
        headings[index] = heading
    return headings


def judged(errors: Floats) -> Turned:
    """Return what a turn is worth by its heading errors [rad], tick by tick from the order on."""
    outside = np.flatnonzero(np.abs(errors) > SETTLED)
    settling = float(outside[-1] + 1) * CONTROL_S if outside[-1] + 1 < len(errors) else math.inf
    return Turned(math.degrees(float(np.max(errors))), settling)


def turned_compiled(vessel: Vessel, gain_factor: float, sailed: Sailed, seconds: float, seed: int) -> Turned:
    """Return how the campaigns' tick turns a boat whose K is `gain_factor` times the model's, watched for `seconds`."""
    random, ticks = np.random.default_rng(seed), round((BEFORE_S + seconds) / CONTROL_S)
    before = np.arange(ticks) * CONTROL_S < BEFORE_S
    noise = random.standard_normal((ticks, 2)) * (math.radians(sailed.noise_deg), GYRO if sailed.has_gyro else math.nan)
    turn = math.radians(sailed.turn_deg)
    targets = np.where(before, 0.0, wrap(turn))
    errors = swiftly(vessel, gain_factor, targets, noise, gusts(ticks, sailed.gusts_deg, random))[~before] - turn
    return judged(errors)


def gusts(ticks: int, deviation_deg: float, random: np.random.Generator) -> Floats:
    """Return gusts as rudder [rad] tick by tick."""
    share, value, found = math.exp(-CONTROL_S / GUST_TIME), 0.0, np.zeros(ticks)
    for index, blow in enumerate(random.standard_normal(ticks) if deviation_deg > 0.0 else ()):
        value = share * value + math.radians(deviation_deg) * math.sqrt(1.0 - share * share) * blow
        found[index] = value
    return found


def table(boats: list[tuple[str, Boat]], sailed: Sailed, seeds: range) -> None:
    """Turn every boat with each seed and print."""
    three = " K 0.7   1.0   1.3"
    print(
        f"{'boat':10s} level quickest  settling/quickest  past [deg]         worst [deg]        past 3 deg    reserve"
    )
    print(f"{'[s]':>25s} {three} {three} {three}  K .7 1.0 1.3   rest   1 deg")
    for name, boat in boats:
        vessel, least = vessel_of(boat), quickest(boat)
        settling = past = worst = far = ""
        for factor in (WEAKER, 1.0, STRONGER):
            found = np.array([turned_compiled(vessel, factor, sailed, WATCHED * least, seed) for seed in seeds])
            settling += f"{np.median(found[:, 1]) / least:6.2f}"
            past += f"{np.median(found[:, 0]):6.2f}"
            worst += f"{min(np.max(found[:, 0]), 99.9):6.1f}"
            far += f"{np.count_nonzero(found[:, 0] > FAR_DEG):4d}"
        reserve = f"{quickest(boat, RESERVED) / least:6.2f}{settled_with_reserve(boat) / least:8.2f}"
        print(f"{name:10s}{boat.level:6d}{least:9.1f} {settling} {past} {worst}  {far} {reserve}", flush=True)


def summary(boats: list[tuple[str, Boat]], sailed: Sailed, seeds: range) -> None:
    """Turn every boat with each seed, K and kind of day, and print what they come to together."""
    print(f"{'':10s}settling/quickest, K{'':27s}past 3 deg{'':14s}lost")
    print(f"{'':10s}{''.join(f'{factor:6.2f}' for factor in FACTORS)}  mean  most {'   0.7 to 1.3':21s} 0.7 to 1.3")
    known = [(vessel_of(boat), quickest(boat)) for _, boat in boats]
    days = {
        "gyro": sailed,
        "no gyro": sailed._replace(has_gyro=False),
        "gusts 1 deg": sailed._replace(gusts_deg=1.0),
    }
    for day, like in days.items():
        found = np.array(
            [
                [
                    [turned_compiled(vessel, factor, like, WATCHED_SUMMARY * least, seed) for seed in seeds]
                    for factor in FACTORS
                ]
                for vessel, least in known
            ]
        )
        least_times = np.array([least for _, least in known])[:, None, None]
        settling = np.median(np.minimum(found[..., 1] / least_times, WATCHED_SUMMARY), axis=2)
        past, lost = (np.count_nonzero(found[..., 0] > limit, axis=(0, 2)) for limit in (FAR_DEG, LOST_DEG))
        times = "".join(f"{mean:5.2f} " for mean in np.mean(settling, axis=0))
        counts = "  ".join("".join(f"{many:4d}" for many in counted) for counted in (past, lost))
        print(
            f"{day:11s}{times}{np.mean(settling):6.3f}{np.max(settling):6.2f}  {counts}  of {len(known) * len(seeds)}",
            flush=True,
        )


def main() -> None:
    """Turn every boat and print."""
    known = {**BOATS, **MORE}
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--noise-deg", type=float, default=0.3)
    parser.add_argument("--no-gyro", action="store_true")
    parser.add_argument("--gusts-deg", type=float, default=0.0, help="gusts, rms, as rudder")
    parser.add_argument("--turn-deg", type=float, default=90.0)
    parser.add_argument("--seeds", type=int, default=40)
    parser.add_argument("--first-seed", type=int, default=1000)
    parser.add_argument("--boats", default=",".join(BOATS), help=", ".join(known))
    parser.add_argument("--drawn", type=int, default=0, help="so many boats drawn by a rule in place of --boats")
    parser.add_argument("--drawn-seed", type=int, default=DRAWN_SEED)
    parser.add_argument("--summary", action="store_true", help="the boats together, by kind of day and K")
    parser.add_argument("--levels", default="", help="response levels in place of the boats' own")
    asked = parser.parse_args()
    if asked.drawn > 0:
        known = drawn(asked.drawn, asked.drawn_seed)
    names, levels = (
        list(known) if asked.drawn > 0 else asked.boats.split(","),
        asked.levels.split(",") if asked.levels else [],
    )
    if unknown := set(names) - set(known):
        parser.error(f"--boats {','.join(sorted(unknown))}: known are {', '.join(known)}")
    if not set(levels) <= {str(level) for level in range(1, 10)}:
        parser.error(f"--levels {asked.levels}: from 1 to 9, separated by commas")
    boats = [
        (name, known[name]._replace(level=int(level or known[name].level)))
        for name in names
        for level in levels or ("",)
    ]
    sailed = Sailed(asked.noise_deg, not asked.no_gyro, asked.gusts_deg, asked.turn_deg)
    seeds = range(asked.first_seed, asked.first_seed + asked.seeds)
    if asked.summary:
        summary(boats, sailed, seeds)
    else:
        table(boats, sailed, seeds)


if __name__ == "__main__":
    main()
