"""Boats that steer by thrust, from the trial to the course that is held, in lockstep through the simulated ArduRover.

    python benchmarks/drives.py trial KIND FOLDER      zigzags at several throttles, identified, gains designed
    python benchmarks/drives.py hold VESSEL KIND       turns, zigzag and hold at 0.5 to 3 times the trial's speed
    python benchmarks/drives.py thrust VESSEL KIND     turns at a third and three times the trial's thrust
    python benchmarks/drives.py pivot VESSEL KIND      a turn where the boat lies, without throttle
    python benchmarks/drives.py faults VESSEL KIND     a thruster that is dead, weed on one, in calm water and in waves
    python benchmarks/drives.py alarms VESSEL KIND     what is said of healthy thrusters in waves and a stream
    python benchmarks/drives.py swing VESSEL KIND      what a boat makes good on one thruster, held and by swings
    python benchmarks/drives.py rover VESSEL KIND      the same turns and zigzag by ArduRover's own steering
    python benchmarks/drives.py steps VESSEL KIND      how turns settle with the wave filter and without, any boat

The plants' equations (`sitl/twin_thruster.py`) are not those of the model.
"""

from __future__ import annotations

import argparse
import dataclasses
import itertools
import math
import subprocess
import sys
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))

import boat_at_sea
from lockstep import Lockstep

from autopilot.angles import wrap
from autopilot.guidance.manoeuvres import OneThruster
from autopilot.signals import Order, OrderKind
from autopilot.vessel.file import load_vessel
from autopilot.vessel.schema import Vessel
from sitl.firmware_parameters import ParameterTable, default_parameters
from sitl.firmware_setup import motor_setup, skid_outputs
from sitl.guided import GuidedGains, GuidedHelm, Target, gains_of
from sitl.registry import PLANTS
from sitl.scenario import CurrentSection, FaultSection, Scenario, SecondOrderSection, Start, WavesSection
from sitl.world import Orders, World

LENGTH = 2.0
"""[m] of the Otter's hull."""
TRIAL_SPEED = 0.9
SHARES = (0.6, 1.0, 1.9)
"""Of the trial's speed, at which zigzags are sailed."""
ZIGZAGS = {"twin_thruster": (6.0, 10.0), "outboard": (10.0, 10.0)}
"""Rudder and change of heading [deg]."""


def sailed(vessel: Vessel, kind: str, *, seed: int = 1, speed: float | None = None, **more: Any) -> Lockstep:
    """Return boat, firmware and pilot, under way at a speed [m/s]; null: the model's."""
    scenario = Scenario(1, kind, plant=kind, seed=seed, start=Start(speed_m_s=speed))
    return Lockstep(vessel, scenario=scenario, **more)


def give(boat: Lockstep, throttle: float) -> None:
    """Put the throttle stick where it gives a share of full."""
    channel = boat.firmware.setup.throttle_input
    above, below = channel.trim + channel.dead_zone, channel.trim - channel.dead_zone
    pulse = above + throttle * (channel.high - above) if throttle > 0.0 else below + throttle * (below - channel.low)
    boat.firmware.sticks[2] = channel.trim if throttle == 0.0 else math.ceil(pulse)


def throttle_for(kind: str, speed: float) -> float:
    """Return the throttle for a speed [m/s] on a straight course."""
    motors = PLANTS[kind].motors
    assert motors is not None
    return motors.throttle_of(speed)


def zigzag(vessel: Vessel, kind: str, speed: float, path: Path, seed: int) -> None:
    """Sail a zigzag at a speed [m/s], and log it."""
    boat = sailed(vessel, kind, seed=seed, speed=speed, log=path, measured_every=5)
    rudder, change = ZIGZAGS[kind]
    boat.engage(0.0)
    assert boat.run(20.0, boat.engaged), boat.tick.alarms
    boat.run(4.0)
    order = Order(OrderKind.ZIGZAG, 0.0, math.radians(rudder), math.radians(change), serial=99)
    boat.order = order
    boat.run(60.0)
    boat.session.close()


def trial(kind: str, folder: Path, first: int = 0) -> None:
    """Sail, identify and design; print R2 of runs that were held out."""
    folder.mkdir(parents=True, exist_ok=True)
    shipped = load_vessel(kind)
    usual = dataclasses.replace(shipped.model, speed_exponent=None, throttle_exponent=None, damping_share=None)
    model = dataclasses.replace(usual, reference_throttle=throttle_for(kind, shipped.model.reference_speed_m_s))
    base = dataclasses.replace(shipped, model=model)
    logs: dict[str, list[Path]] = {"fit": [], "held": []}
    for place, share in enumerate((*SHARES, 0.8, 1.4)):
        path = folder / f"{kind}_{share}.tlog"
        path.unlink(missing_ok=True)
        zigzag(base, kind, share * TRIAL_SPEED, path, seed=first + 10 * place)
        logs["fit" if place < len(SHARES) else "held"].append(path)
    out = folder / f"{kind}.yaml"
    out.unlink(missing_ok=True)
    autopilot = [sys.executable, "-m", "autopilot"]
    identify = [*autopilot, "identify", *map(str, logs["fit"]), "--holdout", *map(str, logs["held"])]
    text = subprocess.run([*identify, "--vessel", kind, "--out", str(out)], check=True, capture_output=True, text=True)
    print(text.stdout)
    subprocess.run([*autopilot, "gains", str(out), "--out", str(out), "--overwrite"], check=True)


def turn(boat: Lockstep, course: float, lasts: float) -> tuple[float, float]:
    """Order a course [deg]; return the time [s] until the boat is within 2 deg for good, and the overshoot [deg]."""
    begun, start = boat.now, boat.world.boat.state.heading
    change = math.degrees(wrap(math.radians(course) - start))
    boat.engage(course)
    settled, over = math.nan, 0.0
    while boat.now < begun + lasts:
        boat.run(0.1)
        error = math.degrees(wrap(boat.world.boat.state.heading - math.radians(course)))
        # a turn of 180 deg may go either way round
        over = max(over, error * math.copysign(1.0, change) if abs(error) < 90.0 else 0.0)
        if abs(error) > 2.0:
            settled = math.nan
        elif math.isnan(settled):
            settled = boat.now - begun
    return settled, over


def hold(vessel: Vessel, kind: str, first: int = 7, count: int = 1) -> None:
    """Print turns and the course at several speeds."""
    for share, seed in itertools.product((0.5, 0.7, 1.0, 1.5, 2.0, 3.0), range(first, first + count)):
        speed = share * vessel.model.reference_speed_m_s
        boat = sailed(vessel, kind, speed=speed, seed=seed)
        boat.engage(0.0)
        assert boat.run(20.0, boat.engaged), boat.tick.alarms
        boat.run(8.0)
        found = [turn(boat, course, 25.0) for course in (30.0, 0.0, 90.0)]
        errors = []
        for _ in range(300):
            boat.run(0.1)
            errors.append(math.degrees(wrap(boat.world.boat.state.heading - math.radians(90.0))))
        rms = math.sqrt(sum(each * each for each in errors) / len(errors))
        words = ", ".join(f"{time:.1f} s over {over:.1f}" for time, over in found)
        alarms = sorted({alarm.name for tick in boat.ticks for alarm in tick.alarms})
        print(
            f"{share} x, {boat.world.boat.state.speed:.2f} m/s: 30, -30, 90 deg: {words}; rms {rms:.2f} deg {alarms}",
            flush=True,
        )


def steps(vessel: Vessel, kind: str, first: int = 1, count: int = 2) -> None:
    """Print how steps settle at one and two times the trial's speed, and how much the rudder works in the last two
    thirds of the time, with the wave filter and without."""
    for share, waves in itertools.product((1.0, 2.0), ("auto", "off")):
        filtered = dataclasses.replace(vessel, estimator=dataclasses.replace(vessel.estimator, wave_filter=waves))
        for seed in range(first, first + count):
            boat = sailed(filtered, kind, speed=share * vessel.model.reference_speed_m_s, seed=seed)
            boat.engage(0.0)
            assert boat.run(20.0, boat.engaged), boat.tick.alarms
            boat.run(5.0)
            words = []
            for course in (*COURSES, 0.0):
                begun = boat.now
                time, over = turn(boat, course, STEP_LASTS)
                late = [tick.command.angle for tick in boat.ticks if tick.now > begun + STEP_LASTS / 3.0]
                travel = math.degrees(sum(abs(after - before) for before, after in itertools.pairwise(late)))
                words.append(f"{time:.1f} s over {over:.2f}, {travel * 1.5 / STEP_LASTS:.1f} deg/s")
            print(f"{share} x, filter {waves}, seed {seed}: steps 30, -30, 90, -90 deg: {'; '.join(words)}", flush=True)


def thrust(vessel: Vessel, kind: str, first: int = 3, count: int = 1) -> None:
    """Print turns at a third and three times the trial's thrust: settled, and just after the throttle has moved."""
    motors = PLANTS[kind].motors
    assert motors is not None
    of_trial = vessel.model.reference_speed_m_s
    for times, seed in itertools.product((1.0 / 3.0, 1.0, 2.0, 3.0), range(first, first + count)):
        # the hull's drag goes with the speed, so thrust does
        speed = times * of_trial
        for begins in ("settled", "at once"):
            boat = sailed(vessel, kind, speed=speed if begins == "settled" else of_trial, seed=seed)
            boat.engage(0.0)
            assert boat.run(20.0, boat.engaged), boat.tick.alarms
            boat.run(8.0)
            give(boat, motors.throttle_of(speed))
            boat.run(0.5)
            found = [turn(boat, course, 30.0) for course in (60.0, -30.0)]
            words = ", ".join(f"{time:.1f} s over {over:.1f}" for time, over in found)
            alarms = sorted({alarm.name for tick in boat.ticks for alarm in tick.alarms})
            print(f"{times:.2f} x thrust, {begins}: {words} {alarms}", flush=True)


def pivot(vessel: Vessel, kind: str, first: int = 5, count: int = 1) -> None:
    """Print how far a boat without throttle goes while it turns."""
    for seed in range(first, first + count):
        boat = sailed(vessel, kind, speed=0.0, seed=seed)
        give(boat, 0.0)
        boat.engage(0.0)
        assert boat.run(20.0, boat.engaged), boat.tick.alarms
        boat.run(10.0)
        for course in (90.0, -90.0, 80.0):
            start = boat.world.boat.state
            time, over = turn(boat, course, 30.0)
            state = boat.world.boat.state
            moved = math.hypot(state.north - start.north, state.east - start.east)
            print(f"to {course:.0f}: {time:.1f} s, over {over:.1f} deg, moved {moved / LENGTH:.3f} L", flush=True)


class Rover:
    """ArduRover's own steering of a skid-steered frame, from heading to both outputs, as one helm of the world."""

    def __init__(self, world: World, gains: GuidedGains, throttle: float) -> None:
        self._world, self._gains, self._throttle = world, gains, throttle
        self._guided = GuidedHelm()
        self._motors = motor_setup(ParameterTable(default_parameters()))._replace(asymmetry=ASYMMETRY)
        self.course = 0.0

    def order(self, course: float) -> None:
        """Order a course [deg]."""
        self.course = math.radians(course)

    def orders(self, time: float) -> Orders:
        """One loop of the firmware, with the attitude of its own board."""
        reading, motors = self._world.sensors.latest(time), self._world.motors
        assert reading is not None and motors is not None
        self._guided.take(Target(self.course, 0.0, 1.0, time))
        steering = self._guided.steering(self._gains, time, reading.heading, reading.rate, self._world.boat.state.speed)
        left, right = skid_outputs(self._motors, steering, self._throttle)
        return Orders(0.5 * (left - right) * motors.full, motors.speed_of(0.5 * (left + right)))


ASYMMETRY = 1.34
COURSES = (30.0, 0.0, 90.0)
LASTS, STEP_LASTS = 15.0, 30.0
SWING, SWINGS = 20.0, 6
"""Courses of the zigzag [deg], and how often the boat goes over."""


def measured(boat: World, order: Callable[[float], None], move: Callable[[float], None]) -> list[tuple[float, float]]:
    """Return settling time [s] within 2 deg and overshoot [deg] of a step to each of COURSES."""
    found = []
    for course in COURSES:
        begun, start = boat.time, boat.boat.state.heading
        side = math.copysign(1.0, wrap(math.radians(course) - start))
        order(course)
        settled, over = LASTS, 0.0
        for _ in range(round(LASTS / 0.1)):
            move(0.1)
            error = math.degrees(wrap(boat.boat.state.heading - math.radians(course)))
            over = max(over, error * side)
            if abs(error) > 2.0:
                settled = LASTS
            elif settled == LASTS:
                settled = boat.time - begun
        found.append((settled, over))
    return found


def swung(boat: World, order: Callable[[float], None], move: Callable[[float], None]) -> tuple[float, float]:
    """Return the mean time [s] of legs of a zigzag from course to course, and the most that one goes past [deg].

    The other course is ordered as soon as the boat is within 2 deg of the one before.
    """
    begun, over, side = boat.time, 0.0, 1.0
    for _ in range(SWINGS):
        order(side * SWING)
        leg = boat.time
        while boat.time < leg + LASTS:
            move(0.05)
            off = side * math.degrees(boat.boat.state.heading)
            over = max(over, -off - SWING)
            if off > SWING - 2.0:
                break
        side = -side
    return (boat.time - begun) / SWINGS, over


def rover_boat(vessel: Vessel, gains: GuidedGains, seed: int, share: float) -> tuple[World, Rover]:
    """Return the boat under ArduRover's own steering at a share of the trial's speed, and its helm."""
    speed = share * vessel.model.reference_speed_m_s
    world = World(vessel, Scenario(1, "rover", plant="twin_thruster", seed=seed, start=Start(speed_m_s=speed)))
    helm = Rover(world, gains, throttle_for("twin_thruster", speed))
    world.helms.append(helm)
    world.advance(3.0)
    return world, helm


def rover_steps(vessel: Vessel, gains: GuidedGains, seed: int, share: float = 1.0) -> list[tuple[float, float]]:
    """Return the steps of ArduRover's own steering at a share of the trial's speed."""
    world, helm = rover_boat(vessel, gains, seed, share)
    return measured(world, helm.order, lambda dt: world.advance(world.time + dt))


def tuned(vessel: Vessel, evaluations: int, seed: int) -> GuidedGains:
    """Return the best gains of a search: random at first, then about the best so far; time and overshoot count alike,
    a second for a degree."""
    rng = np.random.default_rng(seed)
    low, high = np.array([0.05, 0.02, 0.0, 0.0, 0.5, 0.3]), np.array([3.0, 3.0, 1.0, 0.3, 6.0, 6.0])
    usual = gains_of(ParameterTable(default_parameters()))._replace(scale_speed=0.0, lateral_max=100.0, rate_max=0.0)
    best, least = usual, math.inf
    centre = low + 0.3 * (high - low)
    for number in range(evaluations):
        spread = 1.0 if number < evaluations // 3 else 0.25
        tried = rng.uniform(low, high) if spread == 1.0 else centre * np.exp(spread * rng.normal(size=low.size))
        ff, p, i, d, angle, acceleration = (float(each) for each in np.clip(tried, low, high))
        gains = usual._replace(rate_ff=ff, rate_p=p, rate_i=i, rate_d=d, angle_p=angle, acceleration_max=acceleration)
        cost = sum(time + over for time, over in rover_steps(vessel, gains, 1))
        if cost < least:
            best, least, centre = gains, cost, tried
    return best


def rover(vessel: Vessel, kind: str, first: int = 7, count: int = 2) -> None:
    """Print steps and a zigzag of both at three speeds, the peer tuned on this boat at the trial's."""
    gains = tuned(vessel, 120, 20261124)
    print("ArduRover, tuned:", gains)
    for share, seed in itertools.product((0.5, 1.0, 2.0), range(first, first + count)):
        world, helm = rover_boat(vessel, gains, seed, share)
        boat = sailed(vessel, kind, seed=seed, speed=share * vessel.model.reference_speed_m_s)
        boat.engage(0.0)
        assert boat.run(20.0, boat.engaged), boat.tick.alarms
        boat.run(5.0)
        movers: tuple[tuple[str, World, Callable[[float], None], Callable[[float], None]], ...] = (
            ("ArduRover", world, helm.order, lambda dt, world=world: world.advance(world.time + dt)),
            ("Norrbin", boat.world, boat.engage, lambda dt, boat=boat: boat.run(dt) and None),
        )
        for name, sea, order, move in movers:
            words = ", ".join(f"{time:.1f} s over {over:.2f}" for time, over in measured(sea, order, move))
            order(0.0)
            move(LASTS)
            time, over = swung(sea, order, move)
            swings = f"zigzag {SWING:.0f}/{SWING:.0f} deg: {time:.2f} s a leg, past by {over:.1f}"
            print(f"{share} x speed, seed {seed} {name:9} steps 30, -30, 90 deg: {words}; {swings}", flush=True)


FAULTS = {
    "one dead": ("thruster_dead", 1.0),
    "weed takes half of one": ("thruster_weed", 0.5),
    "steering stuck": ("rudder_stuck", None),
}
SEAS_DEG = (0.0, 2.0, 4.0)
"""Waves [deg rms of rudder]."""
PACE, DAMPING = 0.8, 0.15
WATCHED_S = 40.0


def waves(deg: float) -> WavesSection:
    """Return waves that push as so many degrees of rudder, rms."""
    if deg == 0.0:
        return WavesSection()
    return WavesSection(second_order=SecondOrderSection(PACE, DAMPING, deg / math.sqrt(0.1 * DAMPING * PACE)))


def failing(
    vessel: Vessel, kind: str, fault: str, deg: float, turn: float, seed: int
) -> tuple[float, str, float, float]:
    """Return when [s] a failing thruster is said, and as what; when [s] the boat is 5 deg from where it should be, and
    how far [deg] it goes from there before it is said. turn [deg]: ordered as the fault begins."""
    random = np.random.default_rng((20261127, seed))
    begins = float(random.uniform(40.0, 55.0))
    name, size = FAULTS[fault]
    given = Scenario(
        1, kind, plant=kind, seed=seed, waves=waves(deg), faults=(FaultSection(name, begins, size=size),)
    )  # fmt: skip
    boat = Lockstep(vessel, scenario=given, measured_every=5)
    boat.engage(0.0)
    assert boat.run(12.0, boat.engaged), boat.tick.alarms
    while boat.now < begins:
        boat.run(0.1)
    known = {alarm.name for tick in boat.ticks for alarm in tick.alarms} & SAID
    if turn:
        boat.engage(turn)
    shown, most = math.nan, 0.0
    while boat.now < begins + WATCHED_S:
        boat.run(0.1)
        names = {alarm.name for alarm in boat.tick.alarms} & SAID - known
        off = abs(math.degrees(wrap(boat.world.boat.state.heading - math.radians(turn))))
        if math.isnan(shown) and off > 5.0 and (not turn or boat.now > begins + TURN_S):
            shown = boat.now - begins
        most = max(most, off) if not turn or boat.now > begins + TURN_S else most
        if names:
            return boat.now - begins, min(names), shown, most
    return math.inf, "", shown, most


SAID = {"thruster_weak", "rudder_stuck", "rudder_reversed", "overpowered", "off_course", "runaway", "rudder_at_stop"}
TURN_S = 6.0
"""After this time [s] the turn is over."""


def faults(vessel: Vessel, kind: str, first: int = 1, count: int = 4) -> None:
    """Print when a failing thruster is said, by what, and how far the boat is off by then."""
    print("| fault | waves | on a course: said after, s | by | most off, deg | in a turn: said after, s | by |")
    print("|---|---|---|---|---|---|---|")
    for fault in FAULTS:
        for deg in SEAS_DEG:
            cells = []
            for turn in (0.0, 60.0):
                found = [failing(vessel, kind, fault, deg, turn, seed) for seed in range(first, first + count)]
                times = ", ".join("not" if math.isinf(each[0]) else f"{each[0]:.1f}" for each in found)
                names = ", ".join(
                    f"{names} {many}" for names, many in Counter(each[1] for each in found if each[1]).items()
                )
                cells += [times, names] + ([f"{max(each[3] for each in found):.0f}"] if not turn else [])
            print(f"| {fault} | {deg:g} deg | {' | '.join(cells)} |", flush=True)


def swing(vessel: Vessel, kind: str, first: int = 1, count: int = 2) -> None:
    """Print what a boat makes good in four minutes on one thruster, and on which course where 000 is ordered."""
    for dead, throttle, swings, seed in itertools.product(
        (1.0, -1.0), (0.3, 0.56), (False, True), range(first, first + count)
    ):
        given = Scenario(
            1, kind, plant=kind, seed=seed, start=Start(speed_m_s=1.0),
            faults=(FaultSection("thruster_dead", 20.0, size=dead),),
        )  # fmt: skip
        boat = Lockstep(vessel, scenario=given, measured_every=5)
        give(boat, throttle)
        boat.engage(0.0)
        assert boat.run(12.0, boat.engaged), boat.tick.alarms
        boat.run(60.0 - boat.now)
        leader, before, side = OneThruster(), boat.order, "starboard" if dead > 0.0 else "port"
        if swings:
            leader.follow(side)
        start, most = boat.world.boat.state, 0.0
        while boat.now < 300.0:
            state = boat.world.boat.state
            if swings:
                swung = leader.order(
                    0.0, math.radians(vessel.rudder.angle_max_deg), boat_at_sea.place(state.north, state.east).place
                )
                boat.order = swung._replace(serial=before.serial)
            boat.run(0.1)
            most = max(most, abs(math.degrees(wrap(state.heading))))
        end = boat.world.boat.state
        north, east = end.north - start.north, end.east - start.east
        said = sorted({alarm.name for tick in boat.ticks if tick.now > 60.0 for alarm in tick.alarms})
        print(
            f"{side} dead, throttle {throttle:g}, {'swings' if swings else 'held'}, seed {seed}: "
            f"{math.hypot(north, east) / 240.0:.3f} m/s at {math.degrees(math.atan2(east, north)):+.0f} deg, "
            f"heading within {most:.0f} deg, {boat.tick.mode.name.lower()} {said}",
            flush=True,
        )


def alarms(vessel: Vessel, kind: str, first: int = 1, count: int = 24) -> None:
    """Print what is said of healthy thrusters in waves and a stream, with a turn every 5 to 30 s, for 90 s each."""
    for seed in range(first, first + count):
        random = np.random.default_rng((20261128, 77, seed))
        deg, every = (2.0, 3.0, 4.0)[seed % 3], (5.0, 10.0, 30.0, 20.0)[seed % 4]
        speed = float(random.uniform(0.6, 1.6)) * vessel.model.reference_speed_m_s
        stream = CurrentSection(float(random.uniform(0.15, 0.4)) * speed, float(random.uniform(-180.0, 180.0)))
        given = Scenario(
            1, kind, plant=kind, seed=seed, waves=waves(deg), current=stream, start=Start(speed_m_s=speed)
        )  # fmt: skip
        boat = Lockstep(vessel, scenario=given, measured_every=5)
        boat.engage(0.0)
        assert boat.run(20.0, boat.engaged), boat.tick.alarms
        course = 0.0
        while boat.now < 90.0:
            boat.run(every * float(random.uniform(0.7, 1.3)))
            course += float(random.choice((-1.0, 1.0)) * random.uniform(10.0, 120.0))
            boat.engage(course)
        names = Counter(name for tick in boat.ticks for name in {alarm.name for alarm in tick.alarms} & SAID)
        print(f"seed {seed}, {deg:g} deg, {speed:.2f} m/s, stream {stream.speed_m_s:.2f}: {dict(names)}", flush=True)


def main() -> None:
    """Run one study."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "study", choices=("trial", "hold", "thrust", "pivot", "faults", "alarms", "swing", "rover", "steps")
    )
    parser.add_argument("first")
    parser.add_argument("second")
    parser.add_argument(
        "--seeds", type=int, nargs=2, metavar=("FIRST", "COUNT"), help="of trial (the first) and all others"
    )
    given = parser.parse_args()
    if given.study == "trial":
        trial(given.first, Path(given.second), *(given.seeds or ())[:1])
        return
    studies = {
        "hold": hold,
        "thrust": thrust,
        "pivot": pivot,
        "faults": faults,
        "alarms": alarms,
        "swing": swing,
        "rover": rover,
        "steps": steps,
    }
    studies[given.study](load_vessel(given.first), given.second, *(given.seeds or ()))


if __name__ == "__main__":
    main()
