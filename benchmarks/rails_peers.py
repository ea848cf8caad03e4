"""ArduRover's two ways along a route, behind the same readings as the pilot, and the search for their numbers.

Both ask for an acceleration across the boat, a = r V, and hand the rate of turn r to the rate loop of `front_peers`.

L1 (AP_L1_Control, ArduRover up to 4.1; Park, Deyst and How 2004), with the speed over the ground V, the error y to
starboard of the leg A to B and the angle Nu2 of the velocity from it:

    L1 = zeta P V/pi,   Nu1 = asin(-y/L1) within 45 deg, and an integral of it up to 0.1 rad
    a = 4 zeta^2 V^2/L1 sin(Nu1 + integral - Nu2)

The next leg begins within a radius of the waypoint, or across it.

Position controller (AR_WPNav and AR_PosControl, ArduRover from 4.2 on): a target runs along the legs, through a corner
on both at once, so that one speed falls by a cosine as the other grows; it is paced by the boat. The position's error
asks for a velocity, with a square root far off; the velocity's error goes through a PID, and the acceleration of the
path itself is added.

What is more favourable here than in the firmware, which works the throttle, too: the engine is left alone, and the
target is as quick as the boat, so that no error along the track turns the boat that crabs; no least speed of 1 m/s;
corners as long as is asked for. Position and velocity come from a filter of two time constants that knows the
acceleration across the boat, r times the log's speed, as accelerometers would show it.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from front_peers import ARDUROVER_BEGINS, ArduRover, ArduRoverMemory, Rudder, ardurover_turns
from front_runs import plant_step
from pareto_front import explore

from autopilot.angles import wrap
from sitl.boat import BoatState, Disturbance, step_of
from sitl.compiled import compiled

Floats = npt.NDArray[np.float64]

TICK, FIX_TICKS, LOG_TICKS = 0.05, 4, 20
"""From heading to heading [s]; ticks from fix to fix and from log to log."""
TICK_STEPS = 2
"""Steps of the plant in a tick while numbers are searched."""
HEADING_TIME = 1.0
CAPTURE = 0.7071
INTEGRATED_WITHIN = math.radians(5.0)
INTEGRAL_MOST = 0.1
CREEPS, PACE_MOST, PACE_TIME = 0.05, 5.0, 1.0
"""The target is let run ahead by this share, is never quicker than so many speeds, and changes its pace in [s]."""
SLOWEST = 0.1
"""In units of the service speed: what an acceleration is divided by, at least."""
PIECES = 24
LOST = 20.0
"""Lengths off the path at which a run is given up."""


class Sight(NamedTuple):
    """What the instruments show: heading [rad], rate [rad/s]; log's speed, place and velocity over the ground [m, m/s],
    nan where there is no news of it."""

    heading: float
    rate: float
    speed: float
    north: float
    east: float
    north_speed: float
    east_speed: float


class Known(NamedTuple):
    """Heading, log's speed, place and velocity over the ground, as far as they are known."""

    heading: float
    speed: float
    north: float
    east: float
    north_speed: float
    east_speed: float


class Route(NamedTuple):
    """Where legs begin and end [m north, m east]; speed [m/s] of the boat at work; radius [m] it can turn on."""

    north: Floats
    east: Floats
    speed: float
    turn_radius: float


class L1(NamedTuple):
    """Period [s], damping, gain of the integral, radius [m] of a waypoint; time constants [s] of place and velocity."""

    period: float
    damping: float
    integral: float
    radius: float
    place_time: float
    velocity_time: float
    steering: ArduRover


class PositionControl(NamedTuple):
    """POS_P [1/s], acceleration [m/s^2] of its square root; VEL_P, VEL_I, filter of the error [s], IMAX [m/s^2]; length
    of corners, in units of the arc's tangent; time constants [s] of place and velocity."""

    place_p: float
    acceleration: float
    velocity_p: float
    velocity_i: float
    error_time: float
    integral_most: float
    corner: float
    place_time: float
    velocity_time: float
    steering: ArduRover


class Memory(NamedTuple):
    """What is known and steered; the leg's end, and whether the last one is reached. Of L1 the integral; of the
    position controller how far [m] along the leg its target is, the share of a corner it has turned (or less than 0),
    its pace, and error and integral of the velocity, north and east."""

    known: Known
    steering: ArduRoverMemory
    target: int
    done: bool
    integral: float
    along: float
    turned: float
    pace: float
    error_north: float
    error_east: float
    integral_north: float
    integral_east: float


def begins(speed: float) -> Memory:
    """Return the memory of a boat at the origin, on the course 0 at `speed` [m/s]."""
    known = Known(0.0, speed, 0.0, 0.0, speed, 0.0)
    return Memory(known, ARDUROVER_BEGINS, 1, False, 0.0, 0.0, -1.0, 1.0, 0.0, 0.0, 0.0, 0.0)


def _share(dt: float, time: float) -> float:
    return 1.0 - math.exp(-dt / time) if time > 0.0 else 1.0


def known_next(known: Known, seen: Sight, place_time: float, velocity_time: float, dt: float) -> Known:
    """Return what is known a tick later."""
    heading = known.heading + seen.rate * dt
    heading += _share(dt, HEADING_TIME) * wrap(seen.heading - heading)
    speed = known.speed if math.isnan(seen.speed) else seen.speed
    across = seen.rate * speed * dt
    north_speed = known.north_speed - across * math.sin(heading)
    east_speed = known.east_speed + across * math.cos(heading)
    north, east = known.north + north_speed * dt, known.east + east_speed * dt
    if not math.isnan(seen.north):
        share = _share(FIX_TICKS * dt, velocity_time)
        north_speed += share * (seen.north_speed - north_speed)
        east_speed += share * (seen.east_speed - east_speed)
        share = _share(FIX_TICKS * dt, place_time)
        north, east = north + share * (seen.north - north), east + share * (seen.east - east)
    return Known(heading, speed, north, east, north_speed, east_speed)


def leg_of(route: Route, target: int) -> tuple[float, float, float]:
    """Return course as cosine and sine, and length [m], of the leg to a waypoint."""
    north = route.north[target] - route.north[target - 1]
    east = route.east[target] - route.east[target - 1]
    length = math.sqrt(north * north + east * east)
    return north / length, east / length, length


def l1_step(helm: L1, memory: Memory, route: Route, seen: Sight, dt: float) -> tuple[float, Memory]:
    """Return the order [rad] and the memory."""
    known = known_next(memory.known, seen, helm.place_time, helm.velocity_time, dt)
    target, done = memory.target, memory.done
    cosine, sine, length = leg_of(route, target)
    north, east = known.north - route.north[target - 1], known.east - route.east[target - 1]
    off = math.sqrt((known.north - route.north[target]) ** 2 + (known.east - route.east[target]) ** 2)
    if off <= helm.radius or north * cosine + east * sine >= length:
        if target + 1 == len(route.north):
            done = True
        else:
            target += 1
            cosine, sine, length = leg_of(route, target)
            north, east = known.north - route.north[target - 1], known.east - route.east[target - 1]
    ground = math.sqrt(known.north_speed**2 + known.east_speed**2)
    v_north, v_east = known.north_speed, known.east_speed
    if ground < SLOWEST * route.speed:
        ground = SLOWEST * route.speed
        v_north, v_east = ground * math.cos(known.heading), ground * math.sin(known.heading)
    distance = max(helm.damping * helm.period * ground / math.pi, 0.01)
    cross_track = east * cosine - north * sine
    nu1 = math.asin(min(max(-cross_track / distance, -CAPTURE), CAPTURE))
    integral = memory.integral
    if abs(nu1) < INTEGRATED_WITHIN:
        integral = min(max(integral + helm.integral * nu1 * dt, -INTEGRAL_MOST), INTEGRAL_MOST)
    across, along = v_east * cosine - v_north * sine, v_north * cosine + v_east * sine
    nu = min(max(nu1 + integral - math.atan2(across, along), -0.5 * math.pi), 0.5 * math.pi)
    acceleration = 4.0 * helm.damping**2 * ground * ground / distance * math.sin(nu)
    forward = v_north * math.cos(known.heading) + v_east * math.sin(known.heading)
    rate = acceleration / max(forward, SLOWEST * route.speed)
    order, steering = ardurover_turns(helm.steering, memory.steering, (seen.heading, seen.rate), rate, dt)
    return order, Memory(known, steering, target, done, integral, 0.0, -1.0, 1.0, 0.0, 0.0, 0.0, 0.0)


def corner_of(helm: PositionControl, route: Route, target: int) -> float:
    """Return how far [m] before and after a waypoint its corner reaches; 0 at the last one."""
    if target + 1 >= len(route.north):
        return 0.0
    cosine, sine, length = leg_of(route, target)
    cosine2, sine2, length2 = leg_of(route, target + 1)
    turn = abs(math.atan2(cosine * sine2 - sine * cosine2, cosine * cosine2 + sine * sine2))
    wanted = helm.corner * route.turn_radius * math.tan(0.5 * turn)
    return float(min(wanted, 0.5 * length, 0.5 * length2))


def position_step(helm: PositionControl, memory: Memory, route: Route, seen: Sight, dt: float) -> tuple[float, Memory]:
    """Return the order [rad] and the memory."""
    known = known_next(memory.known, seen, helm.place_time, helm.velocity_time, dt)
    target, done, along, turned = memory.target, memory.done, memory.along, memory.turned
    speed, moved = route.speed, memory.pace * route.speed * dt
    cosine, sine, length = leg_of(route, target)
    corner = corner_of(helm, route, target)
    if turned < 0.0:
        along += moved
        if corner > 0.0 and along >= length - corner:
            turned = 0.0
        done = done or along >= length
    else:
        turned += 0.5 * moved / corner
        if turned >= 1.0:
            along, turned, target = corner, -1.0, target + 1
            cosine, sine, length = leg_of(route, target)
    # where the target is, its velocity and acceleration at the pace of the boat
    north, east = cosine * along, sine * along
    v_north, v_east, a_north, a_east = cosine, sine, 0.0, 0.0
    if turned >= 0.0:
        cosine2, sine2, _ = leg_of(route, target + 1)
        wave = math.sin(math.pi * turned) / math.pi
        before, after = corner * (1.0 - turned - wave), corner * (turned - wave)
        north = cosine * (length - before) + cosine2 * after
        east = sine * (length - before) + sine2 * after
        other = 0.5 * (1.0 - math.cos(math.pi * turned))
        v_north, v_east = cosine + other * (cosine2 - cosine), sine + other * (sine2 - sine)
        bend = 0.25 * math.pi * math.sin(math.pi * turned) * (memory.pace * speed) ** 2 / corner
        a_north, a_east = bend * (cosine2 - cosine), bend * (sine2 - sine)
    north, east = north + route.north[target - 1], east + route.east[target - 1]
    heft = math.sqrt(v_north * v_north + v_east * v_east)
    unit_north, unit_east = v_north / heft, v_east / heft
    off_north, off_east = north - known.north, east - known.east
    # the target is paced by the boat
    ahead = off_north * unit_north + off_east * unit_east
    way = known.north_speed * unit_north + known.east_speed * unit_east
    paced = min(max(CREEPS + (way - helm.place_p * ahead) / (heft * speed), 0.0), PACE_MOST)
    pace = memory.pace + min(dt / PACE_TIME, 1.0) * (paced - memory.pace)
    # position to velocity, velocity to acceleration
    off = math.sqrt(off_north * off_north + off_east * off_east)
    linear = helm.acceleration / helm.place_p**2
    wanted = helm.place_p * off
    if off > linear:
        wanted = math.sqrt(2.0 * helm.acceleration * (off - 0.5 * linear))
    share = wanted / off if off > 1.0e-9 else 0.0
    wanted_north = share * off_north + pace * speed * v_north
    wanted_east = share * off_east + pace * speed * v_east
    smoothed = _share(dt, helm.error_time)
    error_north = memory.error_north + smoothed * (wanted_north - known.north_speed - memory.error_north)
    error_east = memory.error_east + smoothed * (wanted_east - known.east_speed - memory.error_east)
    integral_north, integral_east = memory.integral_north, memory.integral_east
    if abs(memory.steering.order) < 0.999 * helm.steering.rudder.angle_max:
        integral_north += helm.velocity_i * error_north * dt
        integral_east += helm.velocity_i * error_east * dt
        size = math.sqrt(integral_north**2 + integral_east**2)
        if size > helm.integral_most:
            integral_north *= helm.integral_most / size
            integral_east *= helm.integral_most / size
    a_north += helm.velocity_p * error_north + integral_north
    a_east += helm.velocity_p * error_east + integral_east
    bow_north, bow_east = math.cos(known.heading), math.sin(known.heading)
    forward = max(wanted_north * bow_north + wanted_east * bow_east, SLOWEST * speed)
    rate = (a_east * bow_north - a_north * bow_east) / forward
    order, steering = ardurover_turns(helm.steering, memory.steering, (seen.heading, seen.rate), rate, dt)
    kept = error_north, error_east, integral_north, integral_east
    return order, Memory(known, steering, target, done, 0.0, along, turned, pace, *kept)


def planned(helm: Any, route: Route) -> Route:
    """Return the path that a peer means to sail, corners in short pieces: L1 means to sail the legs."""
    if isinstance(helm, L1):
        return route
    norths, easts = [float(route.north[0])], [float(route.east[0])]
    for target in range(1, len(route.north) - 1):
        corner = corner_of(helm, route, target)
        (cosine, sine, _), (cosine2, sine2, _) = leg_of(route, target), leg_of(route, target + 1)
        for piece in range(PIECES + 1):
            turned = piece / PIECES
            wave = math.sin(math.pi * turned) / math.pi
            before, after = corner * (1.0 - turned - wave), corner * (turned - wave)
            norths.append(float(route.north[target] - before * cosine + after * cosine2))
            easts.append(float(route.east[target] - before * sine + after * sine2))
    return route._replace(
        north=np.array([*norths, float(route.north[-1])]), east=np.array([*easts, float(route.east[-1])])
    )


def off_route(route: Route, north: float, east: float) -> float:
    """Return how far [m] a place is from the nearest leg of a route."""
    least = math.inf
    for target in range(1, len(route.north)):
        cosine, sine, length = leg_of(route, target)
        n, e = north - route.north[target - 1], east - route.east[target - 1]
        gone = min(max(n * cosine + e * sine, 0.0), length)
        least = min(least, math.sqrt((n - gone * cosine) ** 2 + (e - gone * sine) ** 2))
    return least


class Given(NamedTuple):
    """A run: the route, the path that is meant, the current [m/s] to the east, deviates of every tick (heading, rate,
    log, two of the place, two of the velocity), the length [m] of the hull, and steps from order to servo."""

    route: Route
    planned: Route
    current: float
    deviates: Floats
    length: float
    path: int


def peer_step(helm: Any, memory: Any, route: Any, seen: Any, dt: float) -> tuple[float, Any]:
    """Stand for the peer's own step, which is compiled in its place."""
    raise NotImplementedError


def run_peer(plant: Any, step: Any, given: Given, helm: Any, memory: Memory, orders: Floats) -> tuple[float, float]:
    """Return rms of the distance from the peer's own path and from the drawn legs [lengths], from the first leg's
    second third on."""
    speed, current = given.route.speed, given.current
    state = BoatState(0.0, 0.0, 0.0, 0.0, speed, 0.0, 0.0, 0.0, 0.0, speed, current)
    dt = TICK
    acting = Disturbance(0.0, 0.0, 0.0, 0.0, 0.0, current, 0.0, 0.0, 0.0)
    own, drawn, count, command = 0.0, 0.0, 0, 0.0
    joined = 0.3 * leg_of(given.route, 1)[2]
    for tick in range(len(given.deviates)):
        d = given.deviates[tick]
        place = velocity = math.nan
        if tick % FIX_TICKS == 0:
            place = velocity = 0.0
        seen = Sight(
            wrap(state.heading + d[0]),
            state.rate + d[1],
            state.speed + d[2] if tick % LOG_TICKS == 0 else math.nan,
            state.north + d[3] + place,
            state.east + d[4] + place,
            state.north_speed + d[5] + velocity,
            state.east_speed + d[6] + velocity,
        )
        command, memory = peer_step(helm, memory, given.route, seen, dt)
        for substep in range(TICK_STEPS):
            k = tick * TICK_STEPS + substep
            orders[k % len(orders)] = command
            order = orders[(k - given.path) % len(orders)] if k >= given.path else 0.0
            state = plant_step(plant, step, state, order, speed, acting)
        if tick % FIX_TICKS == 0 and (memory.target > 1 or state.north > joined):
            off = off_route(given.planned, state.north, state.east) / given.length
            from_legs = off_route(given.route, state.north, state.east) / given.length
            own, drawn, count = own + off * off, drawn + from_legs * from_legs, count + 1
            if from_legs > LOST:
                return LOST, LOST
        if memory.done:
            break
    if not memory.done or count == 0:
        return LOST, LOST
    return math.sqrt(own / count), math.sqrt(drawn / count)


@functools.cache
def compiled_run(helm_step: Callable[..., Any], moved: Callable[..., Any]) -> Callable[..., Any]:
    """Return a peer's run with this plant, compiled."""
    return compiled(run_peer, quick=True, instead={peer_step: helm_step, plant_step: moved})


class Kind(NamedTuple):
    """A peer: its step, bounds of its own numbers (before those of the rate loop), and which of the two rms, from its
    own path or from the drawn legs, is searched for; L1 plans no corner."""

    step: Callable[..., Any]
    made: Callable[..., Any]
    low: Callable[[float, float, float], list[float]]
    high: Callable[[float, float, float], list[float]]
    judged: int


class Boat(NamedTuple):
    """The plant, its step, and what the vessel file says: K [1/s], T [s], speed [m/s], length [m], rudder, the turning
    radius [m] of the pilot's own corners."""

    plant: Any
    step: Callable[..., Any]
    gain: float
    time: float
    speed: float
    length: float
    rudder: Rudder
    turn_radius: float


# bounds in units of the boat: u the speed, t the time of a turn
POSITION = (
    position_step,
    PositionControl,
    lambda u, length, t: [0.02 / t, 0.01 * u / t, 0.05 / t, 1.0e-4 / t**2, 0.01, 1.0e-3 * u / t, 0.5, 0.1, 0.1],
    lambda u, length, t: [2.0 / t, 2.0 * u / t, 5.0 / t, 1.0 / t**2, 3.0, 1.0 * u / t, 6.0, 100.0, 10.0],
)
PEERS: dict[str, Kind] = {
    "L1": Kind(
        l1_step,
        L1,
        lambda u, length, t: [2.0 * t, 0.5, 1.0e-4, 0.2 * length, 0.1, 0.1],
        lambda u, length, t: [60.0 * t, 1.5, 0.3, 10.0 * length, 100.0, 10.0],
        1,
    ),
    "position, own corners": Kind(*POSITION, 0),
    "position, drawn legs": Kind(*POSITION, 1),
}


def made(kind: Kind, boat: Boat, numbers: Floats) -> Any:
    """Return the peer of a setting: the logarithms of its numbers."""
    values = np.exp(numbers).tolist()
    own = len(kind.low(1.0, 1.0, 1.0))
    p, i, d, ff, imax, target, error, derivative, rate, acceleration = values[own:]
    steering = ArduRover(0.0, p, i, d, ff, imax, target, error, derivative, rate, acceleration, 0.1, boat.rudder)
    return kind.made(*values[:own], steering)


def bounds(kind: Kind, boat: Boat) -> tuple[Floats, Floats]:
    """Return the bounds of a setting; those of the rate loop are the steering study's."""
    unit, t = 1.0 / (boat.gain * boat.rudder.angle_max), boat.time
    turn = max(min(t, boat.turn_radius / boat.speed), 0.2)
    low = [0.01 * unit, 0.001 * unit, 1e-4 * unit * t, 0.01 * unit, 0.02, 0.002, 0.002, 0.002, 0.02, 0.002]
    high = [10 * unit * max(t, 1), 5 * unit * max(t, 1), 2 * unit * t, 3 * unit, 1.0, 3.0, 3.0, 3.0, 2.0, 5.0]
    sizes = boat.speed, boat.length, turn
    return np.log([*kind.low(*sizes), *low]), np.log([*kind.high(*sizes), *high])


def searched(kind: Kind, boat: Boat, runs: list[Given], count: int, seed: int) -> Any:
    """Return the best peer of `count` settings over the runs."""
    low, high = bounds(kind, boat)
    run, step = compiled_run(kind.step, boat.step), step_of(boat.plant, TICK / TICK_STEPS)
    random = np.random.default_rng(seed)

    def sailed(numbers: Floats) -> Floats:
        helm = made(kind, boat, numbers)
        meant = [each._replace(planned=planned(helm, each.route)) for each in runs]
        return np.array(
            [run(boat.plant, step, each, helm, begins(boat.speed), np.zeros(each.path + 2)) for each in meant]
        )

    def cost(points: Floats) -> Floats:
        return np.array([math.sqrt(float(np.mean(points[:, kind.judged] ** 2)))])

    starts = low + (high - low) * random.uniform(0.3, 0.7, (4, len(low)))
    found = explore(sailed, starts, low, high, cost, count, seed)
    values = [float(cost(points)[0]) for points in found.points]
    best = int(np.argmin(values))
    return made(kind, boat, found.settings[best])
