"""One tick: samples and an order in, a rudder command out. A pure function: `step(config, state, inputs)`.

No clock, file, socket or log here or below: the same inputs give the same outputs, so that a log replays to the same
commands, bit for bit. All that is remembered is one value, `State`, to be printed, saved, compared and restored; only
the rings of the rudder observer are written in place (`State.copied` has rings of its own).

The stages that steer are scalar functions (`autopilot.steering`, `autopilot.estimation`, `autopilot.control`), which
campaigns compile as they are.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

from autopilot.control.law import NO_ROLL, LawInForce, LawInput, RollInput
from autopilot.control.limits import Rest, RudderLimits, limit
from autopilot.control.roll_damping import RollDamper, RollDamping, damped, rolled
from autopilot.control.wave_feedforward import CornerFrequencies, WaveFeedforward
from autopilot.estimation import estimator
from autopilot.estimation.estimator import (
    Beliefs,
    EstimatorConfig,
    EstimatorState,
    believing,
    estimated,
    is_rudder,
    nav_state,
    noises_of,
    with_order,
    without_bias,
    without_disturbances,
)
from autopilot.estimation.heading_ekf import FilterNoise
from autopilot.estimation.rudder_observer import is_fed_back
from autopilot.estimation.speeds import speeds_apart
from autopilot.guidance.reference import Guide, heading_ordered, started, zigzag, zigzag_divergence
from autopilot.guidance.turn import TurnLimits, is_turning, reference_of
from autopilot.models.norrbin import Norrbin
from autopilot.models.steering_gear import SteeringGear, clip
from autopilot.signals import (
    AcknowledgeSample,
    AlarmEvent,
    AlarmSample,
    AlarmState,
    ConditionSample,
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
    NOT_TURNING,
    Moved,
    SteeringConfig,
    Turning,
    limited,
    referred,
    steered_by,
    turning_at,
    wave_rudder,
)
from autopilot.supervision import failsafe, panel, supervisor
from autopilot.supervision.alarms import kind_of
from autopilot.supervision.envelope import Envelope, Picture
from autopilot.supervision.failsafe import FailsafeSteering, error_of
from autopilot.supervision.monitor_input import AlarmLimits, MonitorInput
from autopilot.supervision.monitors import Monitors
from autopilot.supervision.monitors import State as MonitorState
from autopilot.supervision.panel import AlarmPanel
from autopilot.supervision.supervisor import STEERING_ACTIONS, FailsafeAction, Supervisor

CALM = 10.0
"""Time constants over which the bias is averaged where the boat is steered softly."""
STEERAGE_AGAIN = 1.2
"""Steering begins again at this many times the speed at which it ended."""
EVENTS = (HelmSample, AlarmSample, ConditionSample, AcknowledgeSample)
"""Samples of what happened: nothing depends on when."""


class PilotConfig(NamedTuple):
    """Everything the pilot knows of the boat; `build` makes it from a vessel file.

    rudder_share [-], turn_rate_max [rad/s] and turn_curvature_max [1/m] bound the planned turns. rudder_is_ours: False
    where the other side steers by itself to the reference heading, so that only what it reports says where the rudder
    is. wave_corners hold at the model's speed: which waves are filtered out, steered against, or cancelled, see
    `met_waves`. Below `steerage` [m/s], and astern, the rudder waits amidships; a speed over the ground counts
    for this where steerage_over_ground says so. roll: the rudder damps roll too, while that helps; None: it does not.
    dead_band [rad]: on a course the rudder rests until it is wrong by more.
    """

    model: Norrbin
    gear: SteeringGear
    noise: FilterNoise
    limits: RudderLimits
    failsafe: FailsafeAction
    rudder_share: float = 0.7
    turn_rate_max: float = math.inf
    turn_curvature_max: float = math.inf
    rudder_is_ours: bool = True
    corner_frequencies: CornerFrequencies = CornerFrequencies(0.0)
    steerage: float = 0.0
    steerage_over_ground: bool = False
    roll: RollDamping | None = None
    dead_band: float = 0.0
    alarms: AlarmLimits = AlarmLimits()


class Config(NamedTuple):
    """The pilot's config, its law, and what follows from both."""

    boat: PilotConfig
    law: LawInForce
    steering: SteeringConfig
    envelope: Envelope


def configured(boat: PilotConfig, law: LawInForce) -> Config:
    """Return what a boat is steered by with a law."""
    return Config(boat, law, steering_of(boat, law), _envelope_of(boat))


def _envelope_of(config: PilotConfig) -> Envelope:
    failsafe = config.failsafe
    reckoned = failsafe.release_after + LONGEST_STEP if failsafe.action in STEERING_ACTIONS else 0.0
    return Envelope(*config.limits, failsafe.heading_timeout + reckoned)


def steering_of(config: PilotConfig, law: LawInForce) -> SteeringConfig:
    """Return what steering with the `law` goes by, in numbers."""
    return SteeringConfig(
        estimator=EstimatorConfig(config.model, config.gear, noises_of(config.noise), config.steerage),
        limits=config.limits,
        dead_band=config.dead_band,
        rudder_share=config.rudder_share,
        turn_rate_max=config.turn_rate_max,
        turn_curvature_max=config.turn_curvature_max,
        corner_frequencies=config.corner_frequencies,
        rudder_is_ours=config.rudder_is_ours,
        uses_bias=law.kind.uses_bias,
    )


class Inputs(NamedTuple):
    """What a tick is given: the time [s], the samples that have arrived since the last, and what the skipper wants."""

    now: float
    samples: tuple[Sample, ...]
    order: Order


NO_FINDINGS: Mapping[str, AlarmEvent] = {}


class State(NamedTuple):
    """All that is remembered from tick to tick.

    now [s]: of the last tick, nan before the first, which was the number-th. order: the order in force, and guide and
    turning the way to it. law: the law's own memory; roll: the roll that it goes by; damper and roll_rudder [rad]: the
    roll damping beside it, damps_roll whether one of them works. rest: what the dead band left; wave_rudder [rad]: what
    was set against waves on top of the law. mean_bias [rad]: the bias of late. waits: for way. is_reckoned: a fail-safe
    reckons the heading. command: the last one. findings: of the
    monitors at the last tick, by their names in the catalogue.
    """

    estimate: EstimatorState
    monitors: MonitorState
    supervisor: supervisor.Memory
    panel: panel.Memory
    failsafe: failsafe.Memory
    law: Any
    number: int = 0
    now: float = math.nan
    order: Order = Order()
    guide: Guide = Guide()
    turning: Turning = NOT_TURNING
    roll: RollSample | None = None
    damper: RollDamper = RollDamper()
    roll_rudder: float = 0.0
    damps_roll: bool = False
    rest: Rest = Rest()
    wave_rudder: float = 0.0
    mean_bias: float = 0.0
    waits: bool = False
    is_reckoned: bool = False
    command: RudderCommand = RudderCommand(0.0, 0.0, False)
    findings: Mapping[str, AlarmEvent] = NO_FINDINGS

    @property
    def copied(self) -> State:
        """The same with rings of its own: what is kept while another goes on from this one."""
        estimate = self.estimate
        return self._replace(estimate=estimate._replace(memory=estimate.memory.copied))


def first_state(config: Config) -> State:
    """Return the state at power-on: nothing is known."""
    return State(
        estimate=estimator.first_state(config.steering.estimator),
        monitors=MonitorState(),
        supervisor=supervisor.NOTHING_SEEN,
        panel=panel.QUIET,
        failsafe=failsafe.NO_MEMORY,
        law=config.law.first(0.0),
    )


def reconfigured(before: Config, config: Config, state: State) -> State:
    """Return the state under other numbers: memory is kept, the law starts at the rudder that was commanded.

    ValueError where that lies outside the new limits: it would have to jump.
    """
    angle = state.command.angle
    if abs(angle) > config.boat.limits.angle_max:
        raise ValueError("reconfigure: the rudder stands outside the new limits")
    if config.boat.roll != before.boat.roll:
        state = state._replace(damper=RollDamper(), roll_rudder=0.0)
    return state._replace(
        estimate=estimator.reconfigured(before.steering.estimator, config.steering.estimator, state.estimate),
        law=config.law.first(angle),
        roll=None,
        turning=NOT_TURNING,
    )


def timely_of(now: float, samples: tuple[Sample, ...]) -> tuple[Sample, ...]:
    """Return what may be believed at `now` [s]: a measurement without a finite time is none, and one from a clock ahead
    of ours is of now. What is no measurement counts whenever it happened."""
    return tuple(
        sample if isinstance(sample, EVENTS) or sample.time <= now else sample._replace(time=now)
        for sample in samples
        if isinstance(sample, EVENTS) or math.isfinite(sample.time)
    )


def step(config: Config, state: State, inputs: Inputs) -> tuple[State, Tick]:
    """Return the state after a tick, and the tick: what samples say, what the order asks, what the rudder is given."""
    now, samples, order = inputs
    timely = timely_of(now, samples)
    work = _Work(config, state, now)
    work.select(timely)
    is_other_boat = work.believe()
    seen = work.estimate_at(timely)
    found = work.monitor(seen)
    mode, seen = work.supervise(order, seen, found)
    steady = work.steady(seen)
    work.watch_course(order, steady, is_other_boat=is_other_boat)
    if mode is Mode.FAILSAFE and work.supervisor.law_steers:
        steady, reference, demand = work.reckon(steady)
    else:
        reference = work.refer(order, steady)
        demand = work.demand(order, reference, steady)
    command = work.limit(order, seen, demand, work.picture(order, reference, steady))
    alarms, siren, alarm_states = work.show(samples, order)
    tick = Tick(
        number=state.number + 1,
        now=now,
        samples=samples,
        order=order,
        state=seen,
        reference=reference,
        demand=demand,
        command=command,
        mode=work.supervisor.mode,
        alarms=alarms,
        supervisor=work.supervisor.state,
        siren=siren,
        alarm_states=alarm_states,
    )
    return work.state(tick), tick


class _Work:
    """A tick in hand: what is remembered, taken out of its value and put back at the end."""

    def __init__(self, config: Config, state: State, now: float) -> None:
        self.config, self.boat, self.now = config, config.boat, now
        self.gap = 0.0 if math.isnan(state.now) else now - state.now
        self.dt = clip(self.gap, 0.0, LONGEST_STEP)
        self.supervisor = Supervisor(config.envelope, config.boat.failsafe, state.supervisor)
        self.monitors = Monitors(config.boat.alarms, state.monitors)
        self.failsafe = FailsafeSteering(state.failsafe)
        self.panel = AlarmPanel(state.panel)
        self.estimate, self.law, self.order_in_force = state.estimate, state.law, state.order
        self.guide, self.turning, self.rest, self.command = state.guide, state.turning, state.rest, state.command
        self.roll, self.damper, self.roll_rudder, self.damps_roll = (
            state.roll,
            state.damper,
            state.roll_rudder,
            state.damps_roll,
        )
        self.wave_rudder, self.mean_bias = state.wave_rudder, state.mean_bias
        self.waits, self.is_reckoned = state.waits, state.is_reckoned
        self.waves = WaveFeedforward(0.0, 0.0)

    def state(self, tick: Tick) -> State:
        """Return what is to be remembered."""
        return State(
            self.estimate,
            self.monitors.state,
            self.supervisor.memory,
            self.panel.memory,
            self.failsafe.memory,
            self.law,
            tick.number,
            self.now,
            self.order_in_force,
            self.guide,
            self.turning,
            self.roll,
            self.damper,
            self.roll_rudder,
            self.damps_roll,
            self.rest,
            self.wave_rudder,
            self.mean_bias,
            self.waits,
            self.is_reckoned,
            self.command,
            self.monitors.findings,
        )

    def select(self, samples: tuple[Sample, ...]) -> None:
        """Give each block the samples that are for it; those of the boat's motion are the estimator's."""
        self.monitors.on_samples(samples)
        steers_blindly = self.boat.failsafe.action in STEERING_ACTIONS
        for sample in samples:
            if isinstance(sample, HelmSample):
                self.supervisor.on_sample(sample)
                if sample.cause is HelmCause.STOOD_STILL:
                    self.monitors.forget_past()
            elif isinstance(sample, AlarmSample):
                self.supervisor.note(sample)
            elif isinstance(sample, RollSample):
                self._take_roll(sample)
            elif isinstance(sample, RudderSample) and self._moved_by_others(sample):
                # the steering gear follows somebody else's orders
                self._note_rudder_order(sample.angle)
        if steers_blindly:
            # which of two that are far apart is wrong nobody can tell; no compass turns to the other side
            self.failsafe.on_sample(samples, takes_rates=not self.monitors.rate_is_reversed)

    def _take_roll(self, sample: RollSample) -> None:
        if self.monitors.softer > 1.0 or self.monitors.rests_roll:
            # neither boat nor rudder is what the damping was worked out for
            return
        takes_roll, damps = self.config.law.kind.takes_roll, self.boat.roll is not None
        self.damps_roll = damps or takes_roll
        if damps:
            self.damper = rolled(self.damper, sample)
        if takes_roll and sample.rate is not None:
            self.roll = sample

    def _moved_by_others(self, sample: RudderSample) -> bool:
        ours = self.command.engaged and self.boat.rudder_is_ours
        return sample.ordered and not ours and is_rudder(sample.angle)

    def _note_rudder_order(self, angle: float) -> None:
        self.estimate = with_order(self.estimate, self.now, angle)

    def believe(self) -> bool:
        """Go by what monitors and guidance say of the samples; return whether the boat turned out to be another."""
        found, before, model = self.monitors, self.estimate.beliefs, self.estimate.model
        turns = not self.guide.is_late(self.now) and is_turning(model, self._limits_at(model), self.guide.boat)
        beliefs = Beliefs(not found.doubts_rate, found.doubts_speed, found.softer, turns)
        self.estimate = believing(self.config.steering.estimator, self.estimate, beliefs)
        if (beliefs.doubts_speed, beliefs.liveliness) == (before.doubts_speed, before.liveliness):
            return False
        self.estimate = without_disturbances(self.estimate)
        self.mean_bias = 0.0
        return True

    def estimate_at(self, samples: tuple[Sample, ...]) -> NavState:
        """Take the samples in, and return what is known of the boat."""
        self.estimate = estimated(self.config.steering.estimator, self.estimate, self.now, samples)
        return nav_state(self.config.steering.estimator, self.estimate, self.now)

    def monitor(self, seen: NavState) -> dict[str, AlarmEvent]:
        """Return what the monitors and the links find, by its names in the catalogue."""
        boat, estimate, is_engaged = self.boat, self.estimate, self.supervisor.mode is Mode.ENGAGED
        ours, on_heading = is_engaged and boat.rudder_is_ours, self.order_in_force.kind is OrderKind.HEADING
        is_turned = self.guide.is_late(self.now) and not self.waits
        self.monitors.update(
            MonitorInput(
                self.now,
                estimate.model,
                seen,
                ours,
                is_engaged and on_heading and is_turned,
                self.guide.heading,
                self.command.angle if ours else 0.0,
                boat.limits.angle_max,
                abs(seen.speed) >= boat.steerage,
                estimate.fusion.innovation_mean,
                self.waits,
                zigzag_divergence(self.guide, self.order_in_force, seen.heading) if is_engaged else 0.0,
                push=estimate.push,
                is_late=self.gap > boat.alarms.late,
                follows=ours and on_heading and not self.waits,
                speeds_apart=speeds_apart(estimate.speeds),
                trial_speed=boat.model.reference_speed,
                rudder_is_measured=is_fed_back(estimate.rudder, self.now),
                damps_roll=self.damps_roll,
            )
        )
        found = self.monitors.findings
        doubts = {event.name: event for event in self.supervisor.noted.values() if kind_of(event).is_doubt}
        return {**found, **doubts} if doubts else found

    def supervise(self, order: Order, seen: NavState, found: dict[str, AlarmEvent]) -> tuple[Mode, NavState]:
        """Return the mode, and what is known of the boat, whose helm may have been taken just now."""
        was = self.supervisor.mode
        mode = self.supervisor.decide(self.now, order, seen, found)
        if mode is not Mode.ENGAGED or was is Mode.ENGAGED:
            return mode, seen
        return mode, self._engage(seen)

    def _engage(self, seen: NavState) -> NavState:
        """Take the helm without a bump: from the heading, rate and rudder that are."""
        if not is_fed_back(self.estimate.rudder, self.now):
            self.estimate = without_bias(self.estimate)
            seen = seen._replace(bias=0.0)
        # a fail-safe that still holds the rudder hands over what it commanded
        there = self.command.angle if self.command.engaged else seen.rudder
        start = clip(there, -self.boat.limits.angle_max, self.boat.limits.angle_max)
        self._begin_law(start)
        waves = wave_rudder(self.config.steering, self.estimate.model, seen)
        self._plan_anew(steered_by(seen, waves.filtered))
        self.order_in_force = Order()
        self.command = RudderCommand(self.now, start, True)
        self.rest = Rest(start, start)
        return seen

    def steady(self, seen: NavState) -> NavState:
        """Return what is steered by: without the waves that are left alone, and where the boat is steered softly with
        the mean bias of late. What a boat does that is not its model is taken for wind that comes and goes with each
        swing, and steering against that keeps it swinging."""
        self.waves = wave_rudder(self.config.steering, self.estimate.model, seen)
        state = steered_by(seen, self.waves.filtered)
        share = -math.expm1(-self.dt / (CALM * self.estimate.model.time_constant))
        self.mean_bias += share * (state.bias - self.mean_bias)
        return state._replace(bias=self.mean_bias) if self.monitors.softer > 1.0 else state

    def watch_course(self, order: Order, steady: NavState, *, is_other_boat: bool) -> None:
        """Plan anew where the boat turns out to be another, or has lost or found the way that a rudder needs."""
        is_engaged = self.supervisor.mode is Mode.ENGAGED
        if is_other_boat and is_engaged:
            # the turn that was planned is another boat's
            self._plan_anew(steady)
        counts = self.boat.steerage_over_ground or not self.estimate.speeds.is_over_ground
        least = self.boat.steerage * (STEERAGE_AGAIN if self.waits else 1.0)
        waits = is_engaged and order.kind is OrderKind.HEADING and counts and steady.speed < least
        if waits == self.waits:
            return
        self.waits = waits
        if is_engaged:
            # from where the boat has drifted to
            self._plan_anew(steady)
            self._begin_law(self.command.angle)

    def reckon(self, steady: NavState) -> tuple[NavState, Reference, float]:
        """Return the state that the fail-safe reckons with, what it holds, and its demand [rad]: no heading counts."""
        self._against_roll(engaged=False)
        self.wave_rudder = 0.0
        if not self.is_reckoned:
            self.is_reckoned = True
            self.failsafe.begin(steady)
            self._begin_law(self.command.angle)
        model, action = self.estimate.model, self.boat.failsafe
        reckoned, reference = self.failsafe.reckon(self.now, model, steady.rudder)
        if action.action == "windward":
            rudder = self.failsafe.windward(self.now, action.windward_rudder)
            held = Reference(reckoned.heading, reckoned.rate)
            return reckoned, held, 0.0 if rudder is None else rudder - reckoned.bias
        return reckoned, reference, self._ask_law(model, reference, reckoned, self.command.angle)

    def refer(self, order: Order, steady: NavState) -> Reference:
        """Return the heading, rate and acceleration to be followed."""
        self.is_reckoned = False
        if self.supervisor.mode is not Mode.ENGAGED:
            return Reference(steady.heading, steady.rate, 0.0)
        model = self.estimate.model
        if not order.is_same(self.order_in_force):
            limits = self._limits_at(model)
            if self.order_in_force.kind is not OrderKind.HEADING:
                self.guide = started(self.guide, limits, steady)
            self.guide = heading_ordered(self.guide, model, limits, steady, order.heading)
            self.order_in_force = order
        if order.kind is not OrderKind.HEADING:
            return Reference(steady.heading, steady.rate, 0.0)
        if self.waits:
            return Reference(self.guide.heading)
        limits, moved = self._limits_at(model), Moved(self.command.angle, self.dt)
        self.guide = referred(self.config.steering, self.guide, self.turning, model, steady, moved)
        return reference_of(model, limits, self.guide.boat)

    def demand(self, order: Order, reference: Reference, steady: NavState) -> float:
        """Return the rudder [rad] that is wanted: the law's or the order's, with what works against waves and roll."""
        mode, kind = self.supervisor.mode, order.kind
        before, self.wave_rudder = self.wave_rudder, 0.0
        steers = mode is Mode.ENGAGED and kind is OrderKind.HEADING and not self.waits
        demand = 0.0
        if steers:
            # the law's memory is of its own rudder, not of what was set against waves and roll on top of it
            own, self.wave_rudder = self.rest.allowed - self.roll_rudder - before, self.waves.rudder
            model = self.estimate.model
            if self.monitors.softer > 1.0:
                model = model._replace(gain=model.gain * self.monitors.softer)
            demand = self._ask_law(model, reference, steady, own) + self.waves.rudder
        elif mode is Mode.ENGAGED and kind is OrderKind.RUDDER:
            demand = order.rudder
        elif mode is Mode.ENGAGED and kind is OrderKind.ZIGZAG:
            self.guide = zigzag(self.guide, order, steady.heading)
            demand = self.guide.side * order.rudder
        return demand + self._against_roll(engaged=steers and self.boat.rudder_is_ours)

    def _against_roll(self, *, engaged: bool) -> float:
        """Return the rudder against roll on top of the heading law's; trials keep the rudder they order."""
        if self.boat.roll is None:
            return 0.0
        self.damper, self.roll_rudder = damped(self.boat.roll, self.damper, self.now, self.dt, engaged=engaged)
        return self.roll_rudder

    def _begin_law(self, rudder: float) -> None:
        """Have the law begin anew at `rudder` [rad]; of the roll from before nothing counts."""
        self.law, self.roll = self.config.law.first(rudder), None

    def _ask_law(self, model: Norrbin, reference: Reference, state: NavState, last_rudder: float) -> float:
        """Return the law's demand [rad], and keep what it remembers."""
        boat, roll = self.boat, NO_ROLL if self.roll is None else self._roll_at(state.time)
        ratio = model.reference_speed / boat.model.reference_speed
        given = LawInput(model, ratio, reference, state, roll, last_rudder, boat.limits.angle_max, self.dt)
        kind, gains = self.config.law
        demand, self.law = kind.step(gains, self.law, given)
        return demand

    def _roll_at(self, now: float) -> RollInput:
        sample = self.roll
        if sample is None or sample.rate is None:
            return NO_ROLL
        return RollInput(sample.roll, sample.rate, now - sample.time)

    def _limits_at(self, model: Norrbin) -> TurnLimits:
        self.turning = turning_at(self.config.steering, self.turning, model)
        return self.turning.limits

    def _plan_anew(self, steady: NavState) -> None:
        self.guide = started(self.guide, self._limits_at(self.estimate.model), steady)

    def picture(self, order: Order, reference: Reference, steady: NavState) -> Picture:
        """Return what the command was worked out from, for the check that shares no code with the law."""
        follows = order.kind is OrderKind.HEADING and not self.waits and self.boat.rudder_is_ours
        error = error_of(steady, reference) if follows else math.nan
        return Picture(steady.time, steady.heading_age, error, steady.rate, steady.bias)

    def limit(self, order: Order, seen: NavState, demand: float, picture: Picture) -> RudderCommand:
        """Return the command: the demand within limits and dead band, checked once more by the supervisor."""
        dt = self.dt
        previous = self.command.angle if self.command.engaged else seen.rudder
        if self.supervisor.mode is Mode.ENGAGED and order.kind is OrderKind.HEADING and not self.waits:
            # only a course that is held has a dead band
            before = self.rest._replace(command=previous)
            rest = limited(self.config.steering, before, Moved(previous, dt), demand)
        else:
            allowed = limit(self.boat.limits, previous, demand, dt)
            rest = Rest(allowed, allowed)
        command = self.supervisor.check(self.now, previous, demand, rest.command, dt, picture)
        self.rest = rest if command.angle == rest.command else Rest(command.angle, command.angle)
        if command.engaged and self.boat.rudder_is_ours:
            self._note_rudder_order(command.angle)
        self.command = command
        return command

    def show(self, samples: tuple[Sample, ...], order: Order) -> Shown:
        """Return what is to be said, what is to be heard, and the state of each alarm: what ended steering or keeps it
        from beginning comes first."""
        ended = self.supervisor.alarm
        raised = {ended.name: ended} if ended is not None else {}
        raised.update(self.supervisor.noted)
        for name, event in self.monitors.findings.items():
            raised.setdefault(name, event)
        past = (ended.name,) if ended is not None and self.supervisor.is_over else ()
        alarms, siren = self.panel.update(self.now, raised, samples, order, past)
        return Shown(alarms, siren, self.panel.states)


class Shown(NamedTuple):
    """The alarms, what is to be heard, and the state of each alarm."""

    alarms: tuple[AlarmEvent, ...]
    siren: Siren
    states: tuple[AlarmState, ...]
