"""One tick: samples and an order in, a rudder command out. A pure function: `step(config, state, inputs)`.

No clock, file, socket or log here or below: the same inputs give the same outputs, so that a log replays to the same
commands, bit for bit. All that is remembered is one value, `autopilot.pilot_state.State`.

The stages that steer are scalar functions (`autopilot.steering`, `autopilot.estimation`, `autopilot.control`), which
campaigns compile as they are.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from autopilot.angles import PI, wrap
from autopilot.control.bow_thruster import bow_look, turns_boat, with_bow, with_bow_found
from autopilot.control.law import NO_ROLL, LawInput, RollInput
from autopilot.control.limits import Rest, limited, limited_at_once
from autopilot.control.roll_damping import RollDamping, damped, rolled
from autopilot.estimation import estimator
from autopilot.estimation.estimator import (
    Beliefs,
    EstimatorConfig,
    EstimatorState,
    believing,
    estimated,
    is_rudder,
    nav_state,
    with_bias,
    with_command,
    with_order,
    without_bias,
    without_disturbances,
)
from autopilot.estimation.fusion import bias_unknown
from autopilot.estimation.instruments import speeds_apart
from autopilot.estimation.path_delay import PathDelay, is_other_path, when_heard
from autopilot.estimation.rudder_observer import (
    RudderRate,
    angle_of,
    begun_at,
    is_fed_back,
    measured_at,
    rudder_rate_step,
)
from autopilot.estimation.tuning import BIAS_MOST, GEAR_SEA, WAVE_DEVIATION_FIRST
from autopilot.guidance.turn import is_turning
from autopilot.models.drives import THROTTLE_FLOOR, Needs
from autopilot.models.norrbin import Norrbin
from autopilot.models.steering_gear import clip
from autopilot.pilot_state import Config, Control, PilotConfig, Rudder, State, begun, steering_with
from autopilot.signals import (
    AcknowledgeSample,
    AlarmEvent,
    AlarmSample,
    AlarmState,
    CompassSample,
    ConditionSample,
    HeadingSample,
    HelmCause,
    HelmSample,
    Mode,
    NavState,
    Order,
    OrderKind,
    Reference,
    RollSample,
    RudderCommand,
    RudderSample,
    Sample,
    Siren,
    Tick,
)
from autopilot.steering import (
    LONGEST_STEP,
    SteeringConfig,
    Way,
    idle,
    leads_gear,
    obey,
    paced,
    planned_anew,
    refer,
    reset_turn,
    steered_by,
    with_slide,
    with_turning,
    zigzag_divergence,
)
from autopilot.supervision import failsafe, panel
from autopilot.supervision.alarms import kind_of
from autopilot.supervision.compass_watch import is_stale
from autopilot.supervision.envelope import Picture
from autopilot.supervision.failsafe import FailsafeSteering
from autopilot.supervision.heading_and_rate import followed, handed_over, is_looked_at
from autopilot.supervision.monitor_input import MonitorInput
from autopilot.supervision.monitors import (
    NO_THRUST_SEEN,
    ThrusterLook,
    ThrusterMemory,
    by_other_path,
    judged,
    on_samples,
    thruster_step,
    with_weak_thruster,
    without_past,
)
from autopilot.supervision.monitors import State as MonitorState
from autopilot.supervision.panel import AlarmPanel
from autopilot.supervision.states import ENGAGED, MODES
from autopilot.supervision.supervisor import HEADING_LOST, STEERING_ACTIONS, Memory, Supervisor
from autopilot.supervision.tuning import FROZEN_SAMPLES, RATE_OFF_KNOWN

CALM = 10.0
"""Time constants over which the bias is averaged where the boat is steered softly."""
LEAST_REACH = 0.02
"""Share of the rudder that counts as there where thrust leaves none."""
THRUSTER_HEARD = 3.0
"""[s]: a link that has not said for so long that it commands the bow thruster does not."""
STEERAGE_AGAIN = 1.2
"""Steering begins again at this many times the speed at which it ended."""
MAY_HAVE_JUMPED = "it may have jumped, which shows soon"
"""Why an order to engage waits though headings come."""
EVENTS = (HelmSample, AlarmSample, ConditionSample, AcknowledgeSample, CompassSample)
"""Samples of what happened: nothing depends on when."""


Inputs = tuple[float, tuple[Sample, ...], Order]
"""What a tick is given: the time [s], the samples that have arrived since the last, and what the skipper wants."""


def timely_of(now: float, samples: tuple[Sample, ...]) -> tuple[Sample, ...]:
    """Return what may be believed at `now` [s]: a measurement without a finite time is none, and one from a clock ahead
    of ours is of now. What is no measurement counts whenever it happened."""
    for sample in samples:
        if not -math.inf < sample.time <= now:
            break
    else:
        return samples
    return tuple(
        sample if isinstance(sample, EVENTS) or sample.time <= now else sample._replace(time=now)
        for sample in samples
        if isinstance(sample, EVENTS) or math.isfinite(sample.time)
    )


def by_other_compass(
    config: EstimatorConfig, state: State, samples: tuple[Sample, ...]
) -> tuple[State, tuple[Sample, ...]]:
    """Return the state as the compass sees it that steers now, and the samples without the headings of the
    one before: the boat has not turned, so it is on course as it was. The order is the skipper's to turn."""
    for number, sample in enumerate(samples):
        if type(sample) is CompassSample and math.isfinite(sample.turn):
            guide, (consistency, offset) = state.way.guide, handed_over(state.monitors.consistency)
            turn = wrap(sample.turn + offset) if offset else sample.turn
            boat = guide.boat._replace(heading=wrap(guide.boat.heading + turn))
            guide = guide._replace(heading=wrap(guide.heading + turn), boat=boat)
            estimate = estimator.by_other_compass(state.estimate, turn)
            shown = next((each for each in samples[number:] if type(each) is HeadingSample), None)
            if estimate.has_begun and shown is not None and math.isfinite(shown.heading):
                estimate = estimator.checked_by(config, estimate, shown)
            state = state._replace(
                estimate=estimate,
                way=state.way._replace(guide=guide),
                monitors=without_past(state.monitors)._replace(consistency=consistency),
            )
            others = tuple(each for each in samples[:number] if type(each) is not HeadingSample)
            return by_other_compass(config, state, (*others, *samples[number + 1 :]))
    return state, samples


def step(config: Config, state: State, inputs: Inputs) -> tuple[State, Tick]:
    """Return the state after a tick, and the tick: what samples say, what the order asks, what the rudder is given."""
    now, samples, order = inputs
    config, steering = in_force(config, state, now)
    boat, rudder, bow = config.boat, state.rudder, state.bow
    gap = now - state.now if state.now == state.now else 0.0  # what is no number is not itself
    dt = 0.0 if gap < 0.0 else LONGEST_STEP if gap > LONGEST_STEP else gap
    supervisor = Supervisor(config.envelope, boat.failsafe, state.supervisor)
    was, timely = MODES[state.supervisor.state], timely_of(now, samples)
    state, timely = by_other_compass(steering.estimator, state, timely)

    monitors, estimate, control, failsafe = select(config, state, supervisor, now, timely)
    is_ours = was is Mode.ENGAGED and boat.rudder_is_ours
    if monitors.consistency.held.offset:
        monitors, estimate, timely = held_course(monitors, estimate, timely, (now, dt, is_ours))
    estimate, way, is_other_boat = believe(steering, state, monitors, estimate, now)
    estimate = estimated(steering.estimator, estimate, now, timely)
    standing = monitors.compass.standing
    if standing.samples >= FROZEN_SAMPLES and is_stale(standing, monitors.compass.sea):
        # a rudder that turns no boat looks like a disturbance as large as the rudder, and is laid harder against it
        estimate = with_bias(estimate, standing.bias)
    seen, is_measured = nav_state(steering.estimator, estimate, now), is_fed_back(estimate.rudder, now)
    view = view_of(config, state, control.damps_roll, estimate, seen, is_measured)
    path, before = estimate.path, state.estimate.path
    is_new_path = path is not before and is_other_path(before, path)
    monitors = by_other_path(monitors) if is_new_path else monitors
    monitors, thrusters, found = monitored(config, state, monitors, estimate, view, dt)

    noted = supervisor.memory.notes
    is_open = was is not Mode.ENGAGED and is_looked_at(monitors.consistency.held)
    mode = supervisor.decide(now, order, seen, with_doubts(found, noted, is_open) if noted or is_open else found)
    is_engaged, model = mode is Mode.ENGAGED, estimate.model
    if is_engaged and was is not Mode.ENGAGED:
        estimate, seen = with_known_rudder(estimate, seen, now)
        way, rudder = taken_over(steering, way, rudder, estimate, seen)
        control = begun(config, control, rudder.command.angle)

    lead = leads_gear(steering, model) if is_engaged and now < state.way.guide.turning_until else 0.0
    at = dt, is_engaged, is_other_boat, lead
    present, steady, ratio, mean_bias = steered_from(steering, state, monitors, estimate, seen, at)
    on_course = is_engaged and order.kind is OrderKind.HEADING
    waits = on_course and lacks_way(boat, way, estimate, steady.speed)
    if is_engaged and (is_other_boat or waits != way.waits):
        # the turn that was planned is another boat's, or not from where the boat has drifted to
        way = planned_anew(steering, way, model, steady)
        control = control if waits == way.waits else begun(config, control, rudder.command.angle)
    steers, way = on_course and not waits, way if waits == way.waits else way._replace(waits=waits)

    # the law's memory is of its own rudder, not of what was set against roll on top of it
    own = rudder.rest.allowed - control.roll_rudder
    if boat.roll is not None:
        control = against_roll(boat.roll, control, now, dt, engaged=steers and boat.rudder_is_ours)
    reckons = mode is Mode.FAILSAFE and supervisor.law_steers
    if reckons:
        failsafe, control, steady, reference, demand = reckon(config, failsafe, control, rudder, (estimate, steady), dt)
        present = steady
    elif steers:
        way, reference = refer(steering, way, order, model, steady, (rudder.command.angle, dt))
        asked = answering(boat, model, monitors.course.softer), ratio
        control, demand = ask_law(config, control, asked, reference, steady, (own, dt, lead > 0.0))
        demand += control.roll_rudder
    else:
        way, reference, demand = obey(steering, way, order, model, steady) if is_engaged else idle(way, steady)
        demand += control.roll_rudder

    moved = rudder.command.angle if rudder.command.engaged else seen.rudder, dt
    if steers:
        rest = limited(steering.limits, steering.dead_band, rudder.rest, moved, demand)
    else:
        rest = limited_at_once(steering.limits, moved, demand)
    command = supervisor.check(now, moved[0], demand, rest.command, dt, picture(boat, way, order, reference, steady))
    rest = rest if command.angle == rest.command else Rest(command.angle, command.angle)
    if boat.thruster is not None:
        law = None if waits else (model, demand, steering.limits.angle_max)
        look = bow_look(reference, seen, estimate.ahead, law) if on_course else None
        bow, command = with_bow(boat.thruster, bow, (gap, seen), samples, look, command)
    is_ours = command.engaged and boat.rudder_is_ours
    memory = supervisor.memory
    steers_on = boat.rudder_is_ours and memory.state in ENGAGED
    estimate = with_command(estimate, now, command.angle, is_ours, steers_on)
    # thrusts that come later than filed turn a boat as a slow gear does, and swing it for good if nobody plans with it
    if is_ours and not is_measured:
        known = begun_at(present.rudder) if is_new_path else state.rudder.rate
        if turns_boat(boat.thruster, bow):
            known = begun_at(present.rudder, known.slower if known.is_sure else 1.0)
        estimate, way, rate = with_gear_found(config.steering, (estimate, way), known, dt, present, found)
    else:
        slowest = min(monitors.rudder.following.slow) if is_ours and model.n1 > 0.0 else math.inf
        # a plan keeps to a share of the rate, as a file may be wrong: one that was measured is used whole
        rate = measured_at(present.rudder, steering.timed_gear.rate_max, slowest / steering.rudder_share)

    panel, alarms, siren, states = update_panel(state.panel, memory, now, samples, order, found)
    number, helm, given = state.number + 1, memory.state, Rudder(command, rest, reckons, rate)
    tick = Tick(number, now, samples, order, seen, reference, demand, command, MODES[helm], alarms, helm, siren, states)
    after = State(
        estimate, monitors, memory, panel, failsafe, control, way, given, mean_bias, number, now, found, thrusters, bow
    )
    return after, tick


def in_force(config: Config, state: State, now: float) -> tuple[Config, SteeringConfig]:
    """Return the config as thrust limits the rudder, and what steering goes by: the rudder's rate and the slide of the
    hull as they were found."""
    if state.estimate.speeds.reach < config.boat.limits.angle_max:
        config = limited_by_thrust(config, state, now)
    steering = config.steering if state.rudder.rate.slower == 1.0 else steering_with(config.steering, state.rudder.rate)
    unknown, path = state.way.guide.unknown, state.estimate.path
    steering = with_slide(steering, unknown, path.late / state.estimate.model.time_constant) if unknown else steering
    return config, steering


def steered_from(
    config: SteeringConfig,
    state: State,
    monitors: MonitorState,
    estimate: EstimatorState,
    seen: NavState,
    at: tuple[float, bool, bool, float],
) -> tuple[NavState, NavState, float, float]:
    """Return the boat as it is steered now, and as it will be when the order comes; how many times as quick as in the
    trial its course is held; and its mean bias [rad].

    state: that from before the tick. at: the time since [s], whether the boat is steered, whether it turned out to be
    another, and what `leads_gear` says.
    """
    (dt, is_engaged, is_other_boat, lead), model, ratio = at, estimate.model, estimate.quickness
    late, holds = estimate.path.late, seen.time >= state.way.guide.turning_until
    present = steered_by(config, model, seen, ratio)
    ratio = paced(config, model, ratio, late) if late and holds else ratio
    mean_bias = 0.0 if is_other_boat else state.mean_bias
    mean_bias -= math.expm1(-dt / (CALM * model.time_constant)) * (present.bias - mean_bias)
    if monitors.course.softer > 1.0:
        # what a boat does that is not its model is taken for wind that comes and goes with each swing, and steering
        # against that keeps it swinging
        present = present._replace(bias=mean_bias)
    ahead = late + lead
    if not (is_engaged and ahead > 0.0):
        return present, present, ratio, mean_bias
    # an order of now finds the boat where it will be when it comes
    lively, gear, on_way = estimate.lively_model, config.estimator.gear, (estimate.rudder, estimate.memory)
    there = when_heard(lively, gear, present, on_way, (late, ahead), estimate.fusion.unlearnt if holds else 0.0)
    return present, there, ratio, mean_bias


def held_course(
    monitors: MonitorState,
    estimate: EstimatorState,
    samples: tuple[Sample, ...],
    at: tuple[float, float, bool],
) -> tuple[MonitorState, EstimatorState, tuple[Sample, ...]]:
    """Return the samples with headings as the rate of turn carries them past a jump of the compass, and the state as
    far as the compass is followed. at: see `followed`."""
    held, (now, dt, is_ours) = monitors.consistency.held, at
    # a compass that stands where it jumped to is not followed
    stands = is_ours and monitors.compass.standing.samples >= FROZEN_SAMPLES
    held, turn = followed(held, now, 0.0 if stands else dt, is_ours)
    if turn:
        # no boat turned there, and no gyro is off
        estimate = estimator.by_other_compass(estimate, turn)
        monitors = monitors._replace(consistency=monitors.consistency._replace(held=held))
    if held.offset == 0.0:
        return monitors, estimate, samples
    offset = held.offset
    samples = tuple(
        each._replace(heading=wrap(each.heading - offset)) if type(each) is HeadingSample else each for each in samples
    )
    return monitors, estimate, samples


def monitored(
    config: Config, state: State, monitors: MonitorState, estimate: EstimatorState, view: MonitorInput, dt: float
) -> tuple[MonitorState, ThrusterMemory, Mapping[str, AlarmEvent]]:
    """Return what monitors and the watch of thrusters remember, and what is the case; view: what they are shown."""
    times, angles, _, _, _, commands = estimate.memory
    history = times, angles, commands, estimate.rudder.ticks
    monitors, found = judged(config.boat.alarms, monitors, view, history)
    found = {**found, "path_late": path_event(estimate.path, config.boat.loop_delay)} if estimate.path.late else found
    if not config.has_thrusters:
        return monitors, state.thrusters, found
    return monitors, *watch_thrusters(config.boat, state, estimate, view, dt, found)


def limited_by_thrust(config: Config, state: State, now: float) -> Config:
    """Return what the boat is steered by where thrust leaves it less than all of the rudder: with no more than that.

    One that has none keeps a little, so that every share of it is a number; what was ordered is taken back at the
    rudder's rate.
    """
    limits, reach = config.boat.limits, state.estimate.speeds.reach
    gap = 0.0 if math.isnan(state.now) else min(max(now - state.now, 0.0), LONGEST_STEP)
    moved = limits.rate_max * gap if gap else 0.0
    least = max(LEAST_REACH * limits.angle_max, abs(state.rudder.command.angle) - moved)
    held = limits._replace(angle_max=min(max(reach, least), limits.angle_max))
    return config._replace(boat=config.boat._replace(limits=held), steering=config.steering._replace(limits=held))


def with_gear_found(
    config: SteeringConfig,
    boat: tuple[EstimatorState, Way],
    before: RudderRate,
    dt: float,
    steady: NavState,
    found: Mapping[str, AlarmEvent],
) -> tuple[EstimatorState, Way, RudderRate]:
    """Return what is known of a rudder without a sensor after a tick in which we commanded it; where its gear turns out
    to be another, the rudder is where that would have it, and the rest of the turn is planned with it.

    boat: what is known of the boat, and its way; dt [s]: since the tick before. Nothing that is not sure is known where
    something pushes the boat by more than its rudder can hold, which hides what the rudder does, and lets go at once
    when it is over; nor where on its course it is in a sea that is not known yet.
    """
    (estimate, way), model = boat, boat[0].model
    turns = steady.time < way.guide.turning_until
    is_new = steady.wave_deviation >= WAVE_DEVIATION_FIRST and not estimate.knows_sea
    is_new = is_new and model.time_constant > GEAR_SEA and not turns
    if is_new or "overpowered" in found or not -BIAS_MOST < steady.bias < BIAS_MOST:
        before = begun_at(steady.rudder, before.slower if before.is_sure else 1.0)
    on_course = way.order.kind is OrderKind.HEADING and not turns
    density, gusty = estimate.fusion.state.intensity.density, config.estimator.noises.usual.gusty_bias
    sea, steered = (steady.wave_deviation, density, gusty), (steady.rate, estimate.rudder.effective, on_course)
    rate = rudder_rate_step(model, before, steered, sea, config.timed_gear, dt)
    if rate.slower == before.slower:
        return estimate, way, rate
    estimate = estimate._replace(rudder=estimate.rudder._replace(modelled=angle_of(rate)))
    steady = steady._replace(rudder=angle_of(rate))
    return estimate, reset_turn(steering_with(config, rate), way, model, steady), rate


def select(
    config: Config, state: State, supervisor: Supervisor, now: float, samples: tuple[Sample, ...]
) -> tuple[MonitorState, EstimatorState, Control, failsafe.Memory]:
    """Give each block the samples that are for it; those of the boat's motion are the estimator's."""
    boat, estimate, control, reckoned = config.boat, state.estimate, state.control, state.failsafe
    # a speed that reads too low would make any turn too quick
    quicker = estimate.model.gain / boat.model.gain
    rate_most = (quicker if quicker > 1.0 else 1.0) * config.steering.estimator.noises.rate_most
    monitors = on_samples(boat.alarms, state.monitors, samples, rate_most)
    for sample in samples:
        if type(sample) is HeadingSample:
            continue
        if type(sample) is RollSample:
            # where boat or rudder is not what the damping was worked out for, none is wanted
            takes = config.law.kind.takes_roll or boat.roll is not None or control.damps_roll
            if takes and not (state.monitors.course.softer > 1.0 or state.monitors.rudder.rests_roll):
                control = with_roll(config, control, sample)
        elif type(sample) is RudderSample:
            ours = state.rudder.command.engaged and boat.rudder_is_ours
            if sample.ordered and not ours and is_rudder(sample.angle):
                # the steering gear follows somebody else's orders
                estimate = with_order(estimate, now, sample.angle)
        elif type(sample) is HelmSample:
            supervisor.on_sample(sample)
            if sample.cause is HelmCause.STOOD_STILL:
                monitors = without_past(monitors)
        elif type(sample) is AlarmSample:
            supervisor.note(sample)
    if boat.failsafe.action in STEERING_ACTIONS:
        steering = FailsafeSteering(reckoned)
        # which of two that are far apart is wrong nobody can tell; no compass turns to the other side, nor stands still
        takes_rates, bias = not monitors.consistency.is_refused, estimate.fusion.gyro.bias
        steering.on_sample(samples, takes_rates, bias)
        reckoned = steering.memory
    return monitors, estimate, control, reckoned


def with_roll(config: Config, control: Control, sample: RollSample) -> Control:
    """Return what works the demand out after a sample of the roll."""
    law, roll, damper, roll_rudder, _ = control
    takes_roll, damps = config.law.kind.takes_roll, config.boat.roll is not None
    if damps:
        damper = rolled(damper, sample)
    if takes_roll and sample.rate is not None:
        roll = sample
    return Control(law, roll, damper, roll_rudder, damps or takes_roll)


def believe(
    config: SteeringConfig, state: State, monitors: MonitorState, estimate: EstimatorState, now: float
) -> tuple[EstimatorState, Way, bool]:
    """Go by what monitors and guidance say of the samples; return whether the boat turned out to be another, too.

    state: that from before the tick.
    """
    before, model, way, turns = estimate.beliefs, estimate.model, state.way, False
    if now < way.guide.turning_until:
        way = with_turning(config, way, model)
        turns = is_turning(model, way.turning.limits, way.guide.boat)
    # where rate of turn and heading do not go together the heading is what is steered by
    news = not monitors.consistency.found, monitors.rudder.doubts_speed, monitors.course.softer, turns
    was, known = state.monitors.consistency, monitors.consistency
    is_wild = before.takes_rates and known.found != "" and known.wild != ()
    is_wrong = is_wild or (known.is_refused and not was.is_refused)
    if news == before and not is_wrong:
        return estimate, way, False
    beliefs = Beliefs(*news)
    estimate = believing(config.estimator, estimate, beliefs)
    is_other_boat = (beliefs.doubts_speed, beliefs.liveliness) != (before.doubts_speed, before.liveliness)
    # what a rate that is wrong has made of the sea is none
    return without_disturbances(estimate) if is_other_boat or is_wrong else estimate, way, is_other_boat


def view_of(
    config: Config, state: State, damps_roll: bool, estimate: EstimatorState, seen: NavState, is_measured: bool
) -> MonitorInput:
    """Return what the monitors are shown of a tick.

    state: that from before the tick. damps_roll: the rudder works against roll too. is_measured: there is a sensor of
    its angle.
    """
    boat, (order, guide, _, waits), command, now = config.boat, state.way, state.rudder.command, seen.time
    is_engaged, on_heading = state.supervisor.state in ENGAGED, order.kind is OrderKind.HEADING
    gyro, known = estimate.fusion.gyro, estimate.fusion.state
    ours, speeds, ahead = is_engaged and boat.rudder_is_ours, estimate.speeds, estimate.ahead
    both, noise = speeds.water.value + speeds.ground.value, config.steering.estimator.noises.usual.heading
    unknown = bias_unknown(gyro, max(estimate.fusion.headings[0], noise))
    is_known = unknown < RATE_OFF_KNOWN
    return MonitorInput(
        now,
        estimate.model,
        seen,
        ours,
        is_engaged and on_heading and not waits and now >= guide.turning_until,
        guide.heading,
        command.angle if ours else 0.0,
        boat.limits.angle_max,
        not (-boat.steerage < seen.speed < boat.steerage or turns_boat(boat.thruster, state.bow)),
        estimate.fusion.innovation_mean,
        waits,
        zigzag_divergence(guide, order, seen.heading) if is_engaged and not on_heading else 0.0,
        estimate.push,
        # not so before the first tick, when there was no time
        now - state.now > boat.alarms.late,
        ours and on_heading and not waits,
        speeds_apart(speeds) if both == both else 0.0,
        boat.model.reference_speed,
        is_measured,
        damps_roll,
        state.rudder.rate.is_sure,
        gyro.bias if is_known else 0.0,
        ahead if boat.law.is_rudder and 0.0 < ahead < 1.0 else 1.0,
        known.sea.watched,
        known.p00 + 2.0 * known.p03 + known.p33,
        unknown if is_known else math.inf,
    )


def with_doubts(
    found: Mapping[str, AlarmEvent], noted: Mapping[str, AlarmEvent], is_open: bool
) -> Mapping[str, AlarmEvent]:
    """Return what is found, and those of the links' alarms that are doubts: for the supervisor, who decides by names.
    Shown they are once, by who says them.

    is_open: nobody steers, and a heading may have jumped. Who engaged by it would have it held as if it had jumped on
    the course: there is none until that shows.
    """
    doubts = {event.name: event for event in noted.values() if kind_of(event).is_doubt}
    return {**found, **doubts, **({HEADING_LOST: AlarmEvent(HEADING_LOST, MAY_HAVE_JUMPED)} if is_open else {})}


def path_event(path: PathDelay, filed: float) -> AlarmEvent:
    """Return that the path's delay is not as `filed` [s], to a tenth: the hundredths of what is learnt are no news."""
    return AlarmEvent("path_late", f"measured {filed + path.late:.1f} s, filed {filed:.2f} s")


def watch_thrusters(
    boat: PilotConfig,
    state: State,
    estimate: EstimatorState,
    view: MonitorInput,
    dt: float,
    found: Mapping[str, AlarmEvent],
) -> tuple[ThrusterMemory, Mapping[str, AlarmEvent]]:
    """Return what the watch of thrusters remembers, and what is found, with what is wrong with them."""
    if boat.thruster is not None:
        return NO_THRUST_SEEN, with_bow_found(state.bow, found)
    seen = view.state
    if not seen.valid:
        return NO_THRUST_SEEN, found
    steers = state.supervisor.state in ENGAGED and state.way.order.kind is OrderKind.HEADING and not state.way.waits
    speeds = estimate.speeds
    look = ThrusterLook(
        estimate.model,
        seen.heading,
        seen.rate,
        seen.rudder,
        speeds.ground_ahead if speeds.is_over_ground else estimate.speed,
        speeds.is_over_ground,
        speeds.throttle.value,
        boat.law.way_exponent,
        boat.gear.angle_max,
        steers,
        steers and not estimate.beliefs.holds_bias,
        dt,
    )
    memory, alarm = thruster_step(state.thrusters, look)
    return memory, with_weak_thruster(found, alarm)


def with_known_rudder(estimate: EstimatorState, seen: NavState, now: float) -> tuple[EstimatorState, NavState]:
    """Return what is known of a boat whose helm was taken just now: where nothing tells where its rudder was, no bias
    was learnt."""
    if is_fed_back(estimate.rudder, now):
        return estimate, seen
    return without_bias(estimate), seen._replace(bias=0.0)


def taken_over(
    config: SteeringConfig, way: Way, rudder: Rudder, estimate: EstimatorState, seen: NavState
) -> tuple[Way, Rudder]:
    """Return the helm taken without a bump: from the heading, rate and rudder that are."""
    # a fail-safe that still holds the rudder hands over what it commanded
    there = rudder.command.angle if rudder.command.engaged else seen.rudder
    start = clip(there, -config.limits.angle_max, config.limits.angle_max)
    model = estimate.model
    way = planned_anew(config, way, model, steered_by(config, model, seen, estimate.quickness))
    command = RudderCommand(seen.time, start, True)
    return way._replace(order=Order()), rudder._replace(command=command, rest=Rest(start, start))


def lacks_way(boat: PilotConfig, way: Way, estimate: EstimatorState, speed: float) -> bool:
    """Return whether the boat lacks what its rudder needs to steer: a `speed` [m/s], or thrust, where it is known."""
    throttle = estimate.speeds.throttle.value
    if boat.steers_by is Needs.NOTHING:
        return False
    if boat.steers_by is Needs.THRUST and not math.isnan(throttle):
        return throttle < THROTTLE_FLOOR * (STEERAGE_AGAIN if way.waits else 1.0)
    is_slow = estimate.ahead * speed < boat.steerage * (STEERAGE_AGAIN if way.waits else 1.0)
    return is_slow and (boat.steerage_over_ground or not estimate.speeds.is_over_ground)


def reckon(
    config: Config,
    memory: failsafe.Memory,
    control: Control,
    rudder: Rudder,
    boat: tuple[EstimatorState, NavState],
    dt: float,
) -> tuple[failsafe.Memory, Control, NavState, Reference, float]:
    """Return the state that the fail-safe reckons with, what it holds, and its demand [rad]: no heading counts.

    boat: what is known of it, and its state so far.
    """
    (estimate, steady), angle, action = boat, rudder.command.angle, config.boat.failsafe
    steering, model, now = FailsafeSteering(memory), estimate.model, steady.time
    if not rudder.is_reckoned:
        steering.begin(steady)
        control = begun(config, control, angle)
    reckoned, reference = steering.reckon(now, model, steady.rudder)
    if action.action == "windward":
        wanted = steering.windward(now, action.windward_rudder)
        held = Reference(reckoned.heading, reckoned.rate)
        return steering.memory, control, reckoned, held, 0.0 if wanted is None else wanted - reckoned.bias
    answers = answering(config.boat, model), estimate.quickness
    control, demand = ask_law(config, control, answers, reference, reckoned, (angle, dt, False))
    return steering.memory, control, reckoned, reference, demand


def answering(boat: PilotConfig, model: Norrbin, softer: float = 1.0) -> Norrbin:
    """Return the boat as laws know it, with the `model` at its speed and thrust, steered as if it answered `softer`
    times as much.

    Laws tell how lively a boat is by K over the speed: where K does not go with the speed they are given that at which
    a rudder would do as much.
    """
    if not boat.law.is_rudder:
        model = model._replace(reference_speed=boat.model.reference_speed * model.gain / boat.model.gain)
    return model._replace(gain=model.gain * softer) if softer > 1.0 else model


def ask_law(
    config: Config,
    control: Control,
    boat: tuple[Norrbin, float],
    reference: Reference,
    state: NavState,
    own: tuple[float, float, bool],
) -> tuple[Control, float]:
    """Return the law's demand [rad], and what it remembers. boat: the model as laws know it, and how many times as
    quick as in the trial its loop is; own: the law's part of the last command, the time [s] since, and whether the
    state is that of when the rudder has come to the order."""
    (law, roll, damper, roll_rudder, damps_roll), (model, ratio), (command, dt, is_ahead) = control, boat, own
    measured = NO_ROLL
    if roll is not None and roll.rate is not None:
        measured = RollInput(roll.roll, roll.rate, state.time - roll.time)
    kind, gains = config.law
    given = LawInput(model, ratio, reference, state, measured, command, config.boat.limits.angle_max, dt, is_ahead)
    demand, after = kind.step(gains, law, given)
    return control if after is law else Control(after, roll, damper, roll_rudder, damps_roll), demand


def against_roll(roll: RollDamping, control: Control, now: float, dt: float, *, engaged: bool) -> Control:
    """Return the rudder against roll on top of the heading law's; trials keep the rudder they order."""
    damper, roll_rudder = damped(roll, control.damper, now, dt, engaged=engaged)
    return control._replace(damper=damper, roll_rudder=roll_rudder)


def picture(boat: PilotConfig, way: Way, order: Order, reference: Reference, steady: NavState) -> Picture:
    """Return what the command was worked out from, for the check that shares no code with the law."""
    follows = order.kind is OrderKind.HEADING and not way.waits and boat.rudder_is_ours
    error = reference.heading - steady.heading if follows else math.nan
    error = error if -PI < error <= PI else wrap(error)
    return Picture(steady.time, steady.heading_age, error, steady.rate, steady.bias, reference.rate)


def update_panel(
    before: panel.Memory,
    supervisor: Memory,
    now: float,
    samples: tuple[Sample, ...],
    order: Order,
    found: Mapping[str, AlarmEvent],
) -> tuple[panel.Memory, tuple[AlarmEvent, ...], Siren, tuple[AlarmState, ...]]:
    """Return what is to be said and heard: what ended steering, or keeps it from beginning, comes first."""
    ended, noted = supervisor.alarm, supervisor.notes
    if ended is None and not (noted or found or before.entries) and before.order == (order.kind, order.serial):
        return before, (), Siren.QUIET, ()
    raised = {ended.name: ended, **noted} if ended is not None else dict(noted)
    for name, event in found.items():
        raised.setdefault(name, event)
    past = (ended.name,) if ended is not None and supervisor.is_over else ()
    shown = AlarmPanel(before)
    alarms, siren = shown.update(now, raised, samples, order, past)
    return shown.memory, alarms, siren, shown.states
