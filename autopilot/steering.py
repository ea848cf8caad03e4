"""What steers, stage by stage: waves, order and reference, limits. Functions over NamedTuples.

The pilot calls them as they are, and campaigns compile those that steer to a heading (`sitl.campaign.compiled_tick`):
there is one truth about what a state and an order come to. What goes before, the samples' way to a state, is
`autopilot.estimation`'s; what stands beside, monitors and supervisor, is `autopilot.supervision`'s.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from autopilot.angles import PI, wrap
from autopilot.control.limits import RudderLimits
from autopilot.control.wave_feedforward import CornerFrequencies, Waves, wave_shares
from autopilot.estimation.estimator import EstimatorConfig
from autopilot.guidance.reference import Guide, Steering, heading_ordered, led, started, zigzag
from autopilot.guidance.stop import TurnLimits, preset_rate, turn_limits
from autopilot.guidance.turn import reference_of, reset_reference, side_hard_over
from autopilot.models.norrbin import Norrbin
from autopilot.models.steering_gear import SteeringGear
from autopilot.signals import NavState, Order, OrderKind, Reference

LONGEST_STEP = 0.5
"""A longer silence between ticks [s] counts as this much for limits and reference."""
SPEED_CHANGE = 0.02
"""Turn limits are worked out anew when the speed has changed by this share."""


class SteeringConfig(NamedTuple):
    """What steering goes by, in numbers.

    rudder_share [-], turn_rate_max [rad/s] and turn_curvature_max [1/m] bound the planned turns. rudder_is_ours: False
    where the other side steers by itself to the reference heading. corner_frequencies hold at the model's speed: which
    waves the law is shown, see `wave_feedforward`. dead_band [rad]: on a course the rudder rests until it is wrong by
    more. uses_bias: whether the law goes by the estimated bias. estimator.gear is the gear that is gone by: turns are
    planned with its rate, whatever rate the rudder is commanded at. loop_delay [s]: so late an order comes to the gear.
    """

    estimator: EstimatorConfig
    limits: RudderLimits
    dead_band: float
    rudder_share: float
    turn_rate_max: float
    turn_curvature_max: float
    corner_frequencies: CornerFrequencies
    rudder_is_ours: bool
    uses_bias: bool
    loop_delay: float


class Turning(NamedTuple):
    """What planned turns keep to, and the speed [m/s], nan: it never was, gain [1/s], largest rudder [rad] and rudder's
    rate [rad/s] that it was worked out for."""

    limits: TurnLimits
    speed: float
    gain: float = 0.0
    angle_max: float = 0.0
    rudder_rate: float = 0.0


NOT_TURNING = Turning(TurnLimits(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, False), math.nan)


def turning_at(config: SteeringConfig, turning: Turning, model: Norrbin) -> Turning:
    """Return what turns keep to with the `model` at the speed that is."""
    speed, limits, gear = model.reference_speed, config.limits, config.estimator.gear
    rate = limits.rate_max if limits.rate_max < gear.rate_max else gear.rate_max
    near = SPEED_CHANGE * turning.speed
    is_near = -near <= speed - turning.speed <= near and rate == turning.rudder_rate
    if is_near and (
        config.estimator.law.is_rudder
        or (
            abs(model.gain - turning.gain) <= SPEED_CHANGE * turning.gain
            and abs(limits.angle_max - turning.angle_max) <= SPEED_CHANGE * turning.angle_max
        )
    ):
        return turning
    preset = preset_rate(config.turn_rate_max, config.turn_curvature_max, speed)
    steered = SteeringGear(limits.angle_max, rate, gear.lag, gear.dead_band, gear.delay + config.loop_delay)
    planned = turn_limits(model, steered, config.rudder_share, preset)
    return Turning(planned, speed, model.gain, limits.angle_max, rate)


class Way(NamedTuple):
    """The order in force, the guide to its heading, what turns keep to, and whether the boat waits for way."""

    order: Order = Order()
    guide: Guide = Guide()
    turning: Turning = NOT_TURNING
    waits: bool = False


def with_turning(config: SteeringConfig, way: Way, model: Norrbin) -> Way:
    """Return the way with what turns keep to at the speed that is."""
    turning = turning_at(config, way.turning, model)
    return way if turning is way.turning else way._replace(turning=turning)


def planned_anew(config: SteeringConfig, way: Way, model: Norrbin, steady: NavState) -> Way:
    """Return the way with a plan from where the boat is."""
    way = with_turning(config, way, model)
    return way._replace(guide=started(way.guide, way.turning.limits, steady))


def replanned(config: SteeringConfig, way: Way, model: Norrbin, steady: NavState) -> Way:
    """Return the way with the rest of the turn planned from where the boat and its rudder are."""
    way = with_turning(config, way, model)
    boat = reset_reference(model, way.turning.limits, steady.heading, steady.rate, steady.rudder + steady.bias)
    return way._replace(guide=way.guide._replace(boat=boat))


def steered_by(config: SteeringConfig, model: Norrbin, state: NavState, ratio: float) -> NavState:
    """Return the state to be steered by: without the share of the waves that the law is not shown, and with waves as
    it is shown them. ratio: how many times as quick as in the trial the loop is, see `quickness`."""
    time, heading, rate, speed, rudder, bias, age, valid, wave, wave_rate, deviation, frequency = state
    if deviation == 0.0:
        return state
    own, corners = config.estimator, config.corner_frequencies
    filtered, shown = 0.0, 0.0
    if corners.weighted > 0.0 or corners.seen < math.inf:
        waves = Waves(wave, wave_rate, deviation, frequency)
        filtered, shown = wave_shares(model, own.gear, config.limits, corners, ratio, waves)
    heading -= filtered * wave
    return NavState(
        time,
        heading if -PI < heading <= PI else wrap(heading),
        rate - filtered * wave_rate,
        speed,
        rudder,
        bias,
        age,
        valid,
        shown * wave,
        shown * wave_rate,
        deviation,
        frequency,
    )


Moved = tuple[float, float]
"""The rudder [rad] that was commanded last, and the time [s] since."""


def referred(
    config: SteeringConfig, guide: Guide, turning: Turning, model: Norrbin, state: NavState, moved: Moved
) -> Guide:
    """Return the guide one tick on, towards the heading that is ordered."""
    command, dt = moved
    steering = Steering(side_hard_over(command, config.limits.angle_max), config.rudder_is_ours, config.uses_bias)
    return led(guide, model, turning.limits, state, steering, dt)


def adopted(config: SteeringConfig, way: Way, order: Order, model: Norrbin, steady: NavState) -> Way:
    """Return the way of the order that is given: a new one begins from where the boat is."""
    if order is way.order or order.is_same(way.order):
        return way
    way = with_turning(config, way, model)
    limits, guide = way.turning.limits, way.guide
    if way.order.kind is not OrderKind.HEADING:
        guide = started(guide, limits, steady)
    return way._replace(order=order, guide=heading_ordered(guide, model, limits, steady, order.heading))


def refer(
    config: SteeringConfig, way: Way, order: Order, model: Norrbin, steady: NavState, moved: Moved
) -> tuple[Way, Reference]:
    """Return the way one tick on, and the heading, rate and acceleration to be followed."""
    way = adopted(config, way, order, model, steady)
    turning = turning_at(config, way.turning, model)
    guide = referred(config, way.guide, turning, model, steady, moved)
    return Way(way.order, guide, turning, way.waits), reference_of(model, turning.limits, guide.boat)


def obey(
    config: SteeringConfig, way: Way, order: Order, model: Norrbin, steady: NavState
) -> tuple[Way, Reference, float]:
    """Return way, reference and demand [rad] of an order that no law carries out: a rudder, a zigzag, or a course for
    which the boat has no way."""
    way = adopted(config, way, order, model, steady)
    if order.kind is OrderKind.HEADING:
        return way, Reference(way.guide.heading), 0.0
    _, reference, demand = idle(way, steady)
    if order.kind is OrderKind.RUDDER:
        demand = order.rudder
    elif order.kind is OrderKind.ZIGZAG:
        way = way._replace(guide=zigzag(way.guide, order, steady.heading))
        demand = way.guide.side * order.rudder
    return way, reference, demand


def idle(way: Way, steady: NavState) -> tuple[Way, Reference, float]:
    """Return way, reference and demand [rad] where nobody steers by us."""
    return way, Reference(steady.heading, steady.rate, 0.0), 0.0
