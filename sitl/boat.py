"""The simulated boat: yaw by Norrbin's model at the speed of the moment, with all that the model leaves out.

Richer than what an identifier assumes, on purpose: the steering gear has delay, lag, rate and dead band,
the boat loses speed and drifts in turns, rolls, is set by current and pushed by wind and waves. No clock and
no randomness: disturbances are arguments.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import astuple
from typing import TYPE_CHECKING, Any, NamedTuple

from autopilot.models.drives import RUDDER_LAW, THROTTLE_FLOOR, DriveLaw, at_point
from autopilot.models.norrbin import Norrbin, at_speed, rate_step
from autopilot.models.steering_gear import DelayLine, SteeringGear, gear_step_by, lag_share, sided
from autopilot.models.weather import GRAVITY
from autopilot.vessel.schema import Vessel, drive_law_of, model_of

if TYPE_CHECKING:
    from sitl.firmware_setup import Propulsion
    from sitl.scenario import Scenario


EARTH_RADIUS = 6371008.8
"""Mean radius [m], IUGG."""


class Hull(NamedTuple):
    """What the yaw model leaves out; the defaults suit a planing or semi-displacement boat of 7 m.

    length, beam, draught [m]; speed_time [s] in which the speed settles; turn_speed_loss c in
    U = U0/(1 + c (r L/U)^2) of a steady turn; drift_lever [m], sway speed = -lever x yaw rate; sway_time [s];
    roll_period [s], roll_damping [-]; roll_lever [-], heel = lever x r U/g outwards. windage: the plant has the forces
    of the wind itself, and gets neither leeway nor an equivalent rudder for them.
    """

    length: float = 7.0
    beam: float = 2.5
    draught: float = 0.5
    speed_time: float = 4.0
    turn_speed_loss: float = 0.3
    drift_lever: float = 2.0
    sway_time: float = 1.0
    roll_period: float = 2.5
    roll_damping: float = 0.15
    roll_lever: float = 0.3
    windage: bool = False


class Plant(NamedTuple):
    """Everything about the boat that does not change while it runs; `drive`: how K and T go with speed and thrust."""

    model: Norrbin
    gear: SteeringGear
    hull: Hull = Hull()
    drive: DriveLaw = RUDDER_LAW


class Disturbance(NamedTuple):
    """What sea, wind and current do at one instant.

    rudder [rad]: yaw disturbance as an equivalent rudder; yaw_acceleration [rad/s^2]: what waves would give a
    boat without yaw damping; bow: the share of its full thrust that a bow thruster gives, starboard positive, where the
    plant has one; roll_slope [rad]: effective wave slope athwartships; sway_speed [m/s]: leeway to
    starboard; current_north, current_east [m/s]; wind_ahead, wind_starboard [m/s]: how much of the apparent wind comes
    from there.
    """

    rudder: float = 0.0
    yaw_acceleration: float = 0.0
    roll_slope: float = 0.0
    sway_speed: float = 0.0
    current_north: float = 0.0
    current_east: float = 0.0
    wind_ahead: float = 0.0
    wind_starboard: float = 0.0
    bow: float = 0.0


STILL = Disturbance()


class BoatState(NamedTuple):
    """north, east [m] over the ground; heading [rad], not wrapped; rate [rad/s]; speed and sway [m/s] through
    the water; roll [rad], roll_rate [rad/s]; rudder [rad]; north_speed, east_speed [m/s] over the ground."""

    north: float = 0.0
    east: float = 0.0
    heading: float = 0.0
    rate: float = 0.0
    speed: float = 0.0
    sway: float = 0.0
    roll: float = 0.0
    roll_rate: float = 0.0
    rudder: float = 0.0
    north_speed: float = 0.0
    east_speed: float = 0.0


class Step(NamedTuple):
    """A step of `dt` [s], and the shares of their way that rudder, speed and drift cover in it."""

    dt: float
    rudder: float
    speed: float
    sway: float


PlantStep = Callable[[Any, Step, BoatState, float, float, Disturbance], BoatState]
"""The state a step later: of the plant, the step, the state, the rudder's order [rad] in effect, the speed [m/s] that
the engine would reach on a straight course, and what sea and wind do."""


class BowMotor(NamedTuple):
    """A bow thruster's motor: dead time and first-order lag [s] from order to revolutions, and whether it knows more
    than full and nothing, for which an order beyond half is full."""

    delay: float
    lag: float
    proportional: bool = False


class BowShaft:
    """The revolutions of a bow thruster, a share of full; its thrust goes with their square."""

    def __init__(self, motor: BowMotor) -> None:
        self._motor, self._orders = motor, DelayLine(motor.delay, 0.0)
        self.revolutions = 0.0

    def step(self, now: float, order: float, dt: float) -> float:
        """Give it an order, -1 to 1, at `now` [s]; return the thrust, a share of full, `dt` [s] later."""
        if not self._motor.proportional:
            order = math.copysign(1.0, order) if abs(order) > 0.5 else 0.0
        self._orders.give(now, order)
        wanted = self._orders.effective(now)
        self.revolutions += (wanted - self.revolutions) * -math.expm1(-dt / self._motor.lag)
        return self.revolutions * abs(self.revolutions)


class PlantKind(NamedTuple):
    """A kind of plant.

    of: what does not change while it runs, of vessel and scenario: any NamedTuple with the `gear` and the `hull` of
    `Plant`, which the faults of the rudder and the sea go by. step: see `PlantStep`. motors: what its
    motors make of a flight controller's outputs; None: throttle and speed go together. bow: its bow thruster's motor;
    None: it has none. knows_depth: shallow water changes it.
    """

    name: str
    of: Callable[[Vessel, Scenario], Any]
    step: PlantStep
    motors: Propulsion | None = None
    bow: BowMotor | None = None
    knows_depth: bool = False


def step_of(plant: Plant, dt: float) -> Step:
    """Return a step of `dt` [s]: the same for every step of that length."""
    hull = plant.hull
    return Step(dt, lag_share(plant.gear, dt), -math.expm1(-dt / hull.speed_time), -math.expm1(-dt / hull.sway_time))


def boat_step(
    plant: Plant, step: Step, state: BoatState, order: float, thrust_speed: float, disturbance: Disturbance
) -> BoatState:
    """Return the state a `step` of about 10 ms later, the rudder `order` [rad] and all else held.

    `thrust_speed` [m/s] is the speed that the propulsion would reach on a straight course.
    """
    hull, dt = plant.hull, step.dt
    rudder = gear_step_by(plant.gear, step.rudder, state.rudder, order, dt)
    rate = state.rate
    if abs(state.speed) > 1.0e-3 or not plant.drive.is_rudder:
        model, side = _turned_by(plant, state.speed, thrust_speed)
        steering = side * rudder
        pushed = disturbance.yaw_acceleration * model.time_constant / model.gain
        rate = rate_step(model, rate, steering + disturbance.rudder + pushed, dt)
    else:
        rate *= math.exp(-dt / plant.model.time_constant)
    heading = state.heading + 0.5 * dt * (state.rate + rate)
    speed = _speed_step(hull, step.speed, state.speed, rate, thrust_speed)
    sway = state.sway + (disturbance.sway_speed - hull.drift_lever * rate - state.sway) * step.sway
    # semi-implicit Euler
    slope = disturbance.roll_slope
    roll_rate = state.roll_rate + dt * roll_acceleration(hull, speed, rate, state.roll, state.roll_rate, slope)
    roll = state.roll + dt * roll_rate
    moved = BoatState(state.north, state.east, heading, rate, speed, sway, roll, roll_rate, rudder, 0.0, 0.0)
    return over_ground(state, moved, sway, disturbance, dt)


def over_ground(before: BoatState, after: BoatState, across: float, acting: Disturbance, dt: float) -> BoatState:
    """Return `after`, `dt` [s] later, where it has come to: at its speed through the water, and at `across` [m/s] level
    to starboard, in water that a current carries along."""
    cosine, sine = math.cos(after.heading), math.sin(after.heading)
    north_speed = after.speed * cosine - across * sine + acting.current_north
    east_speed = after.speed * sine + across * cosine + acting.current_east
    return BoatState(
        before.north + 0.5 * dt * (before.north_speed + north_speed),
        before.east + 0.5 * dt * (before.east_speed + east_speed),
        after.heading,
        after.rate,
        after.speed,
        after.sway,
        after.roll,
        after.roll_rate,
        after.rudder,
        north_speed,
        east_speed,
    )


def _turned_by(plant: Plant, speed: float, thrust_speed: float) -> tuple[Norrbin, float]:
    """Return the model at `speed` [m/s] and the engine's `thrust_speed`, and -1 where the rudder works the other way
    round: a rudder astern, and thrust that is turned, where it pulls."""
    law, model = plant.drive, plant.model
    if law.is_rudder:
        return at_speed(model, speed), 1.0 if speed > 0.0 else -1.0
    # by the same power by which the throttle makes way
    throttle = law.throttle * (abs(thrust_speed) / model.reference_speed) ** (1.0 / law.way_exponent)
    backwards = law.throttle_exponent != 0.0 and thrust_speed < 0.0
    throttle = throttle if throttle > THROTTLE_FLOOR else THROTTLE_FLOOR
    return at_point(law, model, speed, throttle), -1.0 if backwards else 1.0


def _speed_step(hull: Hull, share: float, speed: float, rate: float, thrust_speed: float) -> float:
    """Speed settles, with `speed_time`, where thrust balances resistance and the loss in turning."""
    through = abs(speed)
    swing = rate * hull.length / (0.1 if through < 0.1 else through)
    square = swing * swing
    settled = thrust_speed / (1.0 + hull.turn_speed_loss * (100.0 if square > 100.0 else square))
    return speed + (settled - speed) * share


def roll_acceleration(hull: Hull, speed: float, rate: float, roll: float, roll_rate: float, slope: float) -> float:
    """Return phi'' = -w^2 (phi - slope - heel) - 2 zeta w phi' of a hull whose roll does not move it otherwise.

    heel = -lever r U/g is that of a turn, outwards.
    """
    frequency = 2.0 * math.pi / hull.roll_period
    heel = -hull.roll_lever * rate * speed / GRAVITY
    return frequency * (frequency * (slope + heel - roll) - 2.0 * hull.roll_damping * roll_rate)


def plant_of(vessel: Vessel, scenario: Scenario) -> Plant:
    """Return the plant that a vessel and a scenario describe, in radians."""
    rudder, drive = vessel.rudder, drive_law_of(vessel)
    return Plant(
        model=model_of(vessel),
        # a share of the trial's, where that one is not known
        drive=drive if drive.throttle > 0.0 else drive._replace(throttle=1.0),
        gear=sided(
            SteeringGear(
                angle_max=math.radians(rudder.angle_max_deg),
                rate_max=math.inf,
                lag=rudder.lag_s,
                dead_band=math.radians(rudder.dead_band_deg),
                delay=rudder.delay_s,
                play=math.radians(rudder.play_deg),
            ),
            *(math.radians(rate) for rate in rudder.rates_deg_s),
        ),
        # the section has the fields of Hull in the same order, with their units
        hull=Hull(*astuple(scenario.hull)),
    )


PLANTS = (PlantKind("norrbin", plant_of, boat_step),)


class Boat:
    """A plant with its state and the orders that are still on their way to the rudder; `moved` is its equations."""

    def __init__(self, plant: Plant, initial: BoatState | None = None, moved: PlantStep = boat_step) -> None:
        self.plant = plant
        self.state = BoatState() if initial is None else initial
        self._step, self._moved = step_of(plant, 0.0), moved
        self._orders = DelayLine(plant.gear.delay, self.state.rudder)

    def step(self, now: float, order: float, thrust_speed: float, disturbance: Disturbance, dt: float) -> BoatState:
        """Give the rudder `order` [rad] at `now` [s], move `dt` [s] on and return the new state."""
        self._orders.give(now, order)
        effective = self._orders.effective(now)
        if dt != self._step.dt:
            self._step = step_of(self.plant, dt)
        self.state = self._moved(self.plant, self._step, self.state, effective, thrust_speed, disturbance)
        return self.state
