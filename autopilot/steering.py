"""What steers, stage by stage: waves, order and reference, limits. Functions over NamedTuples.

The pilot calls them as they are, and campaigns compile those that steer to a heading (`sitl.campaign.compiled_tick`):
there is one truth about what a state and an order come to. What goes before, the samples' way to a state, is
`autopilot.estimation`'s; what stands beside, monitors and supervisor, is `autopilot.supervision`'s.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from autopilot.angles import PI, shortest_turn, wrap
from autopilot.control.limits import RudderLimits
from autopilot.estimation.disturbance import EXTREME_LEAST_SQUARED, EXTREME_SQUARED, slide_planned, sliding
from autopilot.estimation.estimator import EstimatorConfig
from autopilot.estimation.tuning import WAVE_SHARPNESS, WAVE_STIFFENING
from autopilot.guidance.manoeuvres import zigzag_side
from autopilot.guidance.stop import TurnLimits, preset_rate, turn_limits
from autopilot.guidance.tuning import HARD_OVER, RESET_BEYOND_EARLY
from autopilot.guidance.turn import (
    NO_EVIDENCE,
    VirtualBoat,
    advance,
    couple,
    hold_back,
    reference_of,
    reset_reference,
    reset_threshold,
    turn_step,
    turning_time,
)
from autopilot.models.norrbin import Norrbin
from autopilot.models.steering_gear import SteeringGear, clip
from autopilot.signals import NavState, Order, OrderKind, Reference

LONGEST_STEP = 0.5
"""A longer silence between ticks [s] counts as this much for limits and reference."""
SPEED_CHANGE = 0.02
"""Turn limits are worked out anew when the speed has changed by this share."""
RESET_BEYOND_GUIDED = math.radians(90.0)
"""A firmware that steers by itself turns in its own time: it is only never led the wrong way round."""
REACHED = math.sqrt(2.0)
"""A swing reaches so many times its deviation."""


class CornerFrequencies(NamedTuple):
    """Frequencies [rad/s]: waves quicker than `seen` a law without a weight on the rudder's rate is not shown, inf: it
    goes by the whole heading; weighted: the bandwidth c^(1/3) of one with such a weight, 0: it has none."""

    seen: float
    weighted: float = 0.0


def wave_shares(
    model: Norrbin,
    gear: SteeringGear,
    limits: RudderLimits,
    corners: CornerFrequencies,
    quickness: float,
    waves: tuple[float, float, float],
) -> tuple[float, float]:
    """Return the share of the waves that the law is not shown, and the share that it is shown as waves. waves: their
    heading [rad] now, deviation [rad] and frequency [rad/s]. Both corners go with the speed, `quickness` times that at
    which they hold.

    A law without a weight on the rudder's rate would fight every wave: it is shown slow ones alone. One with a weight
    is shown all of them, but no more than a gear that is too slow or a rudder that is too small can follow.
    """
    (seen, weighted), (heading, deviation, frequency) = corners, waves
    if deviation == 0.0 or (weighted <= 0.0 and seen == math.inf):
        return 0.0, 0.0
    share = plausible_share(deviation, heading)
    if weighted == 0.0:
        return share * filtered_share(frequency, seen * quickness), 0.0
    shown = share * followed_share(model, gear, limits, weighted * quickness, (deviation, frequency))
    return share - shown, shown


def plausible_share(deviation: float, wave: float) -> float:
    """Return which share of a heading `wave` [rad] put down to waves of this standard deviation [rad] is one: all of it
    up to where it is too much for them, and no more than that."""
    most = EXTREME_SQUARED * (deviation * deviation) + EXTREME_LEAST_SQUARED
    return 1.0 if wave * wave <= most else math.sqrt(most) / abs(wave)


def filtered_share(frequency: float, corner: float) -> float:
    """Return which share of waves of `frequency` [rad/s] is kept from the rudder: half of it at `corner` [rad/s].

    A boat whose loop is quicker than the waves holds its heading against them; a slower one only wears its rudder.
    """
    if corner <= 0.0:
        return 1.0
    if corner == math.inf:
        return 0.0
    ratio = frequency / corner
    ratio = (1.0e3 if ratio > 1.0e3 else ratio) ** WAVE_SHARPNESS
    return ratio / (1.0 + ratio)


def followed_share(
    model: Norrbin, gear: SteeringGear, limits: RudderLimits, corner: float, waves: tuple[float, float]
) -> float:
    """Return how much of waves, 1: all, a regulator of the bandwidth `corner` [rad/s] can follow with this rudder.
    waves: their deviation [rad] and frequency [rad/s]."""
    deviation, frequency = waves
    n, square = model.n1 / model.time_constant, frequency * frequency * WAVE_STIFFENING
    swing = math.sqrt(square)
    share = 1.0 / (1.0 + square * square * (square + n * n) / corner**6)
    most = share * REACHED * deviation * model.time_constant / model.gain * swing * math.sqrt(square + n * n)
    angle, rate = min(gear.angle_max, limits.angle_max), min(gear.rate_max, limits.rate_max)
    followed = 1.0
    if most > angle:
        followed = angle / most
    if most * swing * followed > rate:
        followed = rate / (most * swing)
    return followed


PACED = 1.25
"""On a course the path's delay is longer than filed by at most so many times the delay margin of the law: a loop too
quick for it is slowed, as the boat is reckoned ahead by a model that is not quite its own. With twice as many an
outboard whose file has T 60 % too long swings for ever behind 0.8 s, by 3 deg to either side. A loop that is slow
enough must not be slowed: it holds its course the worse for it, in a sea, and where K or T are not the boat's."""


def paced(config: SteeringConfig, model: Norrbin, ratio: float, late: float) -> float:
    """Return how many times as quick as in the trial a course is held, `ratio` at most, where orders come so much later
    [s] than filed. A course-unstable boat cannot wait."""
    quickest = PACED * config.delay_margin / late
    return quickest if 0.0 < quickest < ratio and model.n1 > 0.0 else ratio


class SteeringConfig(NamedTuple):
    """What steering goes by, in numbers.

    rudder_share [-], turn_rate_max [rad/s] and turn_curvature_max [1/m] bound the planned turns. rudder_is_ours: False
    where the other side steers by itself to the reference heading. corner_frequencies hold at the model's speed: which
    waves the law is shown, see `backstepping`; so does delay_margin [s], the law's. dead_band [rad]: on a course
    the rudder rests until it is wrong by more. uses_bias: whether the law goes by the estimated bias. estimator.gear is
    the gear that is gone by: turns are planned with its rate, whatever rate the rudder is commanded at. timed_gear:
    what slower ones are compared with. has_gear: whether steering moves one, or is the difference of two thrusts.
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
    delay_margin: float
    timed_gear: SteeringGear
    has_gear: bool = True


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
    late = gear.delay + (config.estimator.loop_delay if config.has_gear else 0.0)
    steered = SteeringGear(limits.angle_max, rate, gear.lag, gear.dead_band, late)
    planned = turn_limits(model, steered, config.rudder_share, preset)
    return Turning(planned, speed, model.gain, limits.angle_max, rate)


SLIDE_WITHIN = 0.5
"""Orders come later than filed by at most so many time constants where a slide is learnt. It comes and goes with the
turn, and is learnt in a fraction of the time constant: acted on later it drives the boat to and fro. A BlueBoat whose
file is no trial's goes 12 deg past its course behind 0.8 s with it, and 2 without."""


def with_slide(config: SteeringConfig, unknown: float, late: float) -> SteeringConfig:
    """Return what steering goes by while a planned turn adds so much `unknown` slide [rad^2/s], and orders come `late`,
    in time constants."""
    if late > SLIDE_WITHIN:
        return config
    estimator = config.estimator
    return config._replace(estimator=estimator._replace(noises=sliding(estimator.noises, unknown)))


Moved = tuple[float, float]
"""The rudder [rad] that was commanded last, and the time [s] since."""


class Guide(NamedTuple):
    """The turn to the heading that is ordered: heading [rad], the virtual boat that leads there, and a zigzag's side.

    turning_until [s]: an ordered turn may last so long. free_time [s]: when the rudder was last not at its stop. slide
    [rad of rudder]: what the hull's slide in the planned turns may brake the boat by, with a share of 1 (`slide_step`),
    and unknown [rad^2/s]: what of that the turn is adding (`slide_planned`).
    """

    heading: float = 0.0
    boat: VirtualBoat = VirtualBoat(0.0)
    side: int = 1
    turning_until: float = -math.inf
    free_time: float = -math.inf
    slide: float = 0.0
    unknown: float = 0.0


def started(guide: Guide, limits: TurnLimits, state: NavState) -> Guide:
    """Return the guide with a plan from where the boat is, turning no faster than it may."""
    boat = VirtualBoat(state.heading, clip(state.rate, -limits.rate_max, limits.rate_max), 0.0, NO_EVIDENCE)
    return Guide(guide.heading, boat, guide.side, guide.turning_until, state.time, 0.0, 0.0)


def heading_ordered(guide: Guide, model: Norrbin, limits: TurnLimits, state: NavState, heading: float) -> Guide:
    """Return the guide on its way to another `heading` [rad]; nan adopts the present one."""
    adopted = heading if math.isfinite(heading) else state.heading
    may_take = turning_time(model, limits, shortest_turn(state.heading, adopted))
    until = max(guide.turning_until, state.time + may_take)
    return Guide(adopted, guide.boat, 1, until, guide.free_time, guide.slide, guide.unknown)


def zigzag_divergence(guide: Guide, order: Order, heading: float) -> float:
    """Return how far [rad] beyond its swing a zigzag is off to the side that its rudder turns away from.

    0 or less where the boat sails it, and where no zigzag is sailed.
    """
    if order.kind is not OrderKind.ZIGZAG:
        return 0.0
    return -guide.side * wrap(heading - guide.heading) - order.heading_change


def zigzag(guide: Guide, order: Order, heading: float) -> Guide:
    """Return the guide on the zigzag's side at this `heading` [rad], about the heading that was adopted."""
    return guide._replace(side=zigzag_side(guide.side, guide.heading, heading, order.heading_change))


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


def reset_turn(config: SteeringConfig, way: Way, model: Norrbin, steady: NavState) -> Way:
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
    waves = wave, deviation, frequency
    filtered, shown = wave_shares(model, config.estimator.gear, config.limits, config.corner_frequencies, ratio, waves)
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


def leads_gear(config: SteeringConfig, model: Norrbin) -> float:
    """Return how long [s] after an order the rudder is where it says, where a planned turn is one of the boat as it
    will be then, else 0.

    What is planned is then what the boat does when the order has come, and the law sees no lag that it would catch up
    with, and lead past by. Two thrusts turn a boat by so much meanwhile: a catamaran of 80 deg/s by 16 deg in 0.2 s.
    With a gear it is a degree or two, and a share of the rudder is kept for that; a course-unstable boat's reference is
    that of so much earlier (`reference_of`).
    """
    gear = config.estimator.gear
    if config.has_gear or not config.rudder_is_ours or model.n1 <= 0.0:
        return 0.0
    return gear.delay + gear.lag


def referred(
    config: SteeringConfig, guide: Guide, turning: Turning, model: Norrbin, state: NavState, moved: Moved
) -> Guide:
    """Return the guide one tick on, towards the heading that is ordered."""
    boat, heading, rate, now, limits = guide.boat, state.heading, state.rate, state.time, turning.limits
    (command, dt), is_ours, stop = moved, config.rudder_is_ours, HARD_OVER * config.limits.angle_max
    # the side on which the rudder is at its stop
    hard_over = 0 if -stop < command < stop else 1 if command > 0.0 else -1
    is_late = now >= guide.turning_until
    free_time = now if hard_over == 0 else guide.free_time
    off = heading - boat.heading
    off = off if -PI < off <= PI else wrap(off)
    if off > RESET_BEYOND_EARLY or off < -RESET_BEYOND_EARLY:  # no threshold is less
        beyond = reset_threshold(model, limits, is_late, now - free_time) if is_ours else RESET_BEYOND_GUIDED
        if off > beyond or off < -beyond:
            boat = reset_reference(model, limits, heading, rate, state.rudder + state.bias)
    # an integrator needs the error that a plan keeps from it
    if is_ours and config.uses_bias and is_late and boat.rate != 0.0:
        boat = advance(model, limits, boat, heading, guide.heading)
    if is_ours and hard_over and (config.uses_bias or not is_late):
        boat = hold_back(boat, heading, rate, hard_over)
    if limits.watches and is_ours:
        boat = couple(model, limits, boat, state, dt)
    boat = turn_step(model, limits, boat, guide.heading, dt, is_late)
    if not -math.inf < boat.heading + boat.rate + boat.rudder < math.inf:
        # far quicker than the model of a boat that has lost its way allows: the turn is planned anew
        return started(guide, limits, state)
    planned = 0.0 if is_late else boat.rate
    slide, unknown = slide_planned(model, guide.slide, planned, config.limits.angle_max, dt)
    return Guide(guide.heading, boat, guide.side, guide.turning_until, free_time, slide, unknown)


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
    way = way if order is way.order else adopted(config, way, order, model, steady)
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
    way, reference, demand = idle(way, steady)
    if order.kind is OrderKind.RUDDER:
        demand = order.rudder
    elif order.kind is OrderKind.ZIGZAG:
        way = way._replace(guide=zigzag(way.guide, order, steady.heading))
        demand = way.guide.side * order.rudder
    return way, reference, demand


def idle(way: Way, steady: NavState) -> tuple[Way, Reference, float]:
    """Return way, reference and demand [rad] where nobody steers by us."""
    if way.guide.slide:
        way = way._replace(guide=way.guide._replace(slide=0.0, unknown=0.0))
    return way, Reference(steady.heading, steady.rate, 0.0), 0.0
