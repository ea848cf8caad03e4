"""Pilot.step: one tick, pure. Samples and an order in, a rudder command out.

No clock, file, socket or log here or below: the same inputs give the same outputs, so that a log replays to
the same commands, bit for bit.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

from autopilot.control.law import NO_ROLL, LawInForce, LawInput, RollInput
from autopilot.control.limits import Rest, RudderLimits, limit, rested
from autopilot.control.met_waves import NOT_MET, Corners
from autopilot.control.roll_damping import RollDamper, RollDamping
from autopilot.estimation.estimator import (
    Beliefs,
    EstimatorConfig,
    believing,
    estimated,
    first_state,
    is_rudder,
    nav_state,
    reconfigured,
    speeds_apart,
    without_bias,
    without_disturbances,
)
from autopilot.estimation.fusion import noises_of
from autopilot.estimation.heading_ekf import FilterNoise
from autopilot.estimation.rudder_observer import is_fed_back, ordered
from autopilot.guidance.reference import Guide, heading_ordered, started, zigzag, zigzag_divergence
from autopilot.guidance.turn import TurnLimits, is_turning, reference_of
from autopilot.models.norrbin import Norrbin
from autopilot.models.steering_gear import SteeringGear, clip
from autopilot.signals import (
    AcknowledgeSample,
    AlarmEvent,
    AlarmSample,
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
    Tick,
)
from autopilot.supervision.alarms import kind_of
from autopilot.supervision.envelope import Envelope, Picture
from autopilot.supervision.failsafe import FailsafeSteering, error_of
from autopilot.supervision.monitor_input import AlarmLimits, MonitorInput
from autopilot.supervision.monitors import Monitors
from autopilot.supervision.panel import AlarmPanel
from autopilot.supervision.supervisor import STEERING_ACTIONS, FailsafeAction, Supervisor
from autopilot.tick import LONGEST_STEP, NOT_TURNING, Config, Moved, referred, steered_by, turning_at, wave_rudder

if TYPE_CHECKING:
    # learning brings numpy along, which a pilot that does not learn need not load
    from autopilot.identification.learning import Learner

CALM = 10.0
"""Time constants over which the bias is averaged where the boat is steered softly."""
STEERAGE_AGAIN = 1.2
"""Steering begins again at this many times the speed at which it ended."""
EVENTS = (HelmSample, AlarmSample, ConditionSample, AcknowledgeSample)
"""Samples of what happened: nothing depends on when."""


def _envelope_of(config: PilotConfig) -> Envelope:
    failsafe = config.failsafe
    reckoned = failsafe.release_after + LONGEST_STEP if failsafe.action in STEERING_ACTIONS else 0.0
    return Envelope(*config.limits, failsafe.heading_timeout + reckoned)


def steering_of(config: PilotConfig, law: LawInForce) -> Config:
    """Return what steering with the `law` goes by, in numbers."""
    return Config(
        estimator=EstimatorConfig(config.model, config.gear, noises_of(config.noise), config.steerage),
        limits=config.limits,
        dead_band=config.dead_band,
        rudder_share=config.rudder_share,
        turn_rate_max=config.turn_rate_max,
        turn_curvature_max=config.turn_curvature_max,
        wave_corners=config.wave_corners,
        rudder_is_ours=config.rudder_is_ours,
        uses_bias=law.kind.uses_bias,
    )


def timely_of(now: float, samples: tuple[Sample, ...]) -> tuple[Sample, ...]:
    """Return what may be believed at `now` [s]: a measurement without a finite time is none, and one from a clock ahead
    of ours is of now. What is no measurement counts whenever it happened."""
    return tuple(
        sample if isinstance(sample, EVENTS) or sample.time <= now else sample._replace(time=now)
        for sample in samples
        if isinstance(sample, EVENTS) or math.isfinite(sample.time)
    )


class PilotConfig(NamedTuple):
    """Everything the pilot knows of the boat; `build` makes it from a vessel file.

    rudder_share [-], turn_rate_max [rad/s] and turn_curvature_max [1/m] bound the planned turns. rudder_is_ours: False
    where the other side steers by itself to the reference heading, so that only what it reports says where the rudder
    is. wave_corners hold at the model's speed: which waves are kept from the rudder, steered against, or undone, see
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
    wave_corners: Corners = Corners(0.0)
    steerage: float = 0.0
    steerage_over_ground: bool = False
    roll: RollDamping | None = None
    dead_band: float = 0.0
    alarms: AlarmLimits = AlarmLimits()


class Pilot:
    """The brain as one object: estimator, guidance, law, limits and supervisor, each with its small memory."""

    def __init__(self, config: PilotConfig, law: LawInForce, learner: Learner | None = None) -> None:
        self.config = config
        self.law = law
        self.learner = learner
        self._steering = steering_of(config, law)
        self.supervisor = Supervisor(_envelope_of(config), config.failsafe)
        self.damper = RollDamper(config.roll) if config.roll is not None else None
        self.monitors = Monitors(config.alarms)
        self._failsafe = FailsafeSteering()
        self._panel = AlarmPanel()
        self.reset()

    def reset(self) -> None:
        """Forget everything since power-on."""
        self.estimate = first_state(self._steering.estimator)
        self.supervisor.reset()
        self.monitors.reset()
        self._failsafe.reset()
        self._panel.reset()
        self._guide, self._order = Guide(), Order()
        self._is_reckoned = False
        self.law_memory: Any
        self._roll: RollSample | None
        self._begin_law(0.0)
        self._roll_rudder, self._damps_roll = 0.0, False
        self._met, self._undoing = NOT_MET, 0.0
        if self.damper is not None:
            self.damper.reset()
        self._number = 0
        self._now: float | None = None
        self._told = RudderCommand(0.0, 0.0, False)
        self._mean_bias = 0.0
        self._rest = Rest()
        self._turning = NOT_TURNING
        self._waits = False

    @property
    def told(self) -> RudderCommand:
        """What the rudder was told last."""
        return self._told

    def reconfigure(self, config: PilotConfig, law: LawInForce) -> None:
        """Go on with other numbers from the next tick: memory is kept, the law starts at the rudder that was told.

        ValueError where the rudder told lies outside the new limits: it would have to jump.
        """
        if abs(self._told.angle) > config.limits.angle_max:
            raise ValueError("reconfigure: the rudder stands outside the new limits")
        if config.roll != self.config.roll:
            self.damper = RollDamper(config.roll) if config.roll is not None else None
            self._roll_rudder = 0.0
        # who moves the rudder is settled when the links are opened
        self.config, self.law = config._replace(rudder_is_ours=self.config.rudder_is_ours), law
        self._begin_law(self._told.angle)
        before, self._steering = self._steering, steering_of(self.config, law)
        self.estimate = reconfigured(before.estimator, self._steering.estimator, self.estimate)
        self.supervisor.reconfigure(_envelope_of(config), config.failsafe)
        self.monitors.limits = config.alarms
        self._turning = NOT_TURNING
        if self.learner is not None and config.model != self.learner.present:
            self.learner.begin(config.model)

    def learn(self, tick: Tick) -> None:
        """Learn from a tick in the slack after it, where there is a learner. No command ever depends on it: what it
        proposes counts when it is adopted, by `reconfigure`."""
        if self.learner is not None:
            self.learner.learn(tick, steered=tick.command.engaged and self.config.rudder_is_ours)

    def step(self, now: float, samples: tuple[Sample, ...], order: Order) -> Tick:
        """Return the tick at `now` [s]: what the samples say, what the order asks, what the rudder is told."""
        gap = 0.0 if self._now is None else now - self._now
        dt, self._now = clip(gap, 0.0, LONGEST_STEP), now
        timely = timely_of(now, samples)
        self._listen(now, timely)
        is_other_boat = self._suppose_what_was_found(now)
        self.estimate = estimated(self._steering.estimator, self.estimate, now, timely)
        state = nav_state(self._steering.estimator, self.estimate, now)
        was = self.supervisor.mode
        self.monitors.update(self._monitor_input(now, state, gap))
        doubts = {event.name: event for event in self.supervisor.noted.values() if kind_of(event).is_doubt}
        found = {**self.monitors.findings, **doubts}
        mode = self.supervisor.decide(now, order, state, found)
        if mode is Mode.ENGAGED and was is not Mode.ENGAGED:
            state = self._engage(now, state)
        steady = self._calm(self._steady(state), dt)
        if is_other_boat and mode is Mode.ENGAGED:
            # the turn that was planned is another boat's
            self._guide = started(self._guide, self._limits_at(self.estimate.model), steady)
        self._watch_steerage(now, mode, order, steady)
        if mode is Mode.FAILSAFE and self.supervisor.law_steers:
            steady, reference, demand = self._steer_blindly(now, steady, dt)
        else:
            self._is_reckoned = False
            reference = self._lead(mode, order, steady, dt)
            demand = self._demand(mode, order, reference, steady, dt) + self._against_roll(now, dt, mode, order)
        previous = self._told.angle if self._told.engaged else state.rudder
        limited = limit(self.config.limits, previous, demand, dt)
        rest = self._rested(mode, order, previous, demand, limited)
        picture = self._picture(order, reference, steady)
        command = self.supervisor.check(now, order, previous, demand, rest.told, dt, picture)
        self._rest = rest if command.angle == rest.told else Rest(command.angle, command.angle)
        if command.engaged and self.config.rudder_is_ours:
            self._note_rudder_order(now, command.angle)
        self._told = command
        self._number += 1
        ended = self.supervisor.alarm
        past = (ended.name,) if ended is not None and self.supervisor.is_over else ()
        alarms, siren = self._panel.update(now, self._raised(), samples, order, past)
        return Tick(
            number=self._number,
            now=now,
            samples=samples,
            order=order,
            state=state,
            reference=reference,
            demand=demand,
            command=command,
            mode=self.supervisor.mode,
            alarms=alarms,
            supervisor=self.supervisor.state,
            siren=siren,
            heard=self._panel.states,
        )

    def _suppose_what_was_found(self, now: float) -> bool:
        """Go by what monitors and guidance say of the samples; return whether the boat turned out to be another."""
        found, before = self.monitors, self.estimate.beliefs
        model = self.estimate.model
        turns = not self._guide.is_late(now) and is_turning(model, self._limits_at(model), self._guide.boat)
        beliefs = Beliefs(not found.doubts_rate, found.doubts_speed, found.softer, turns)
        self.estimate = believing(self.estimate, beliefs)
        if (beliefs.doubts_speed, beliefs.liveliness) == (before.doubts_speed, before.liveliness):
            return False
        self.estimate = without_disturbances(self.estimate)
        self._mean_bias = 0.0
        return True

    def _note_rudder_order(self, now: float, angle: float) -> None:
        state = self.estimate
        self.estimate = state._replace(rudder=ordered(state.rudder, state.memory, now, angle))

    def _raised(self) -> dict[str, AlarmEvent]:
        """Return what is to be said, by name: what ended steering or keeps it from beginning, then the rest."""
        alarm = self.supervisor.alarm
        raised = {alarm.name: alarm} if alarm is not None else {}
        raised.update(self.supervisor.noted)
        for name, event in self.monitors.findings.items():
            raised.setdefault(name, event)
        return raised

    def _steer_blindly(self, now: float, state: NavState, dt: float) -> tuple[NavState, Reference, float]:
        """Return the state that the fail-safe reckons with, what it holds, and its demand [rad]: no heading counts."""
        self._against_roll(now, dt, Mode.FAILSAFE, self._order)
        self._undoing = 0.0
        if not self._is_reckoned:
            self._is_reckoned = True
            self._failsafe.begin(state)
            self._begin_law(self._told.angle)
        model = self.estimate.model
        reckoned, reference = self._failsafe.reckon(now, model, state.rudder)
        if self.config.failsafe.action == "windward":
            rudder = self._failsafe.windward(now, self.config.failsafe.windward_rudder)
            return (
                reckoned,
                Reference(reckoned.heading, reckoned.rate),
                0.0 if rudder is None else rudder - reckoned.bias,
            )
        return reckoned, reference, self._ask_law(model, reference, reckoned, self._told.angle, dt)

    def _picture(self, order: Order, reference: Reference, state: NavState) -> Picture:
        """Return what the command was worked out from, for the check that shares no code with the law."""
        follows = order.kind is OrderKind.HEADING and not self._waits and self.config.rudder_is_ours
        error = error_of(state, reference) if follows else math.nan
        return Picture(state.time, state.heading_age, error, state.rate, state.bias)

    def _monitor_input(self, now: float, state: NavState, gap: float) -> MonitorInput:
        """Return what the monitors look at: the course that was being held until this tick, and how.

        `gap` [s] is the time since the tick before.
        """
        is_engaged = self.supervisor.mode is Mode.ENGAGED
        ours = is_engaged and self.config.rudder_is_ours
        is_turned = self._guide.is_late(now) and not self._waits
        holds = is_engaged and self._order.kind is OrderKind.HEADING and is_turned
        return MonitorInput(
            now,
            self.estimate.model,
            state,
            ours,
            holds,
            self._guide.heading,
            self._told.angle if ours else 0.0,
            self.config.limits.angle_max,
            abs(state.speed) >= self.config.steerage,
            self.estimate.fusion.surprise,
            self._waits,
            zigzag_divergence(self._guide, self._order, state.heading) if is_engaged else 0.0,
            push=self.estimate.push,
            is_late=gap > self.config.alarms.late,
            follows=ours and self._order.kind is OrderKind.HEADING and not self._waits,
            speeds_apart=speeds_apart(self.estimate.speeds),
            trial_speed=self.config.model.reference_speed,
            rudder_is_measured=is_fed_back(self.estimate.rudder, now),
            damps_roll=self._damps_roll,
        )

    def _listen(self, now: float, samples: tuple[Sample, ...]) -> None:
        self.monitors.on_samples(samples)
        if any(isinstance(sample, HelmSample) and sample.cause is HelmCause.STOOD_STILL for sample in samples):
            self.monitors.forget_past()
        if self.config.failsafe.action in STEERING_ACTIONS:
            # which of two that are far apart is wrong nobody can tell; no compass turns to the other side
            self._failsafe.hear(samples, takes_rates=not self.monitors.rate_is_reversed)
        for sample in samples:
            if isinstance(sample, HelmSample):
                self.supervisor.hear(sample)
            elif isinstance(sample, AlarmSample):
                self.supervisor.note(sample)
            elif isinstance(sample, RollSample):
                self._hear_roll(sample)
            elif isinstance(sample, RudderSample) and self._moved_by_others(sample):
                # the steering gear follows somebody else's orders
                self._note_rudder_order(now, sample.angle)

    def _hear_roll(self, sample: RollSample) -> None:
        if self.monitors.softer > 1.0 or self.monitors.rests_roll:
            # neither boat nor rudder is what the damping was worked out for
            return
        takes_roll = self.law.kind.takes_roll
        self._damps_roll = self.damper is not None or takes_roll
        if self.damper is not None:
            self.damper.hear(sample)
        if takes_roll and sample.rate is not None:
            self._roll = sample

    def _moved_by_others(self, sample: RudderSample) -> bool:
        ours = self._told.engaged and self.config.rudder_is_ours
        return sample.ordered and not ours and is_rudder(sample.angle)

    def _engage(self, now: float, state: NavState) -> NavState:
        """Take the helm without a bump: from the heading, rate and rudder that are."""
        if not is_fed_back(self.estimate.rudder, now):
            self.estimate = without_bias(self.estimate)
            state = state._replace(bias=0.0)
        # a fail-safe that still holds the rudder hands over what it told it
        there = self._told.angle if self._told.engaged else state.rudder
        start = clip(there, -self.config.limits.angle_max, self.config.limits.angle_max)
        self._begin_law(start)
        self._guide = started(self._guide, self._limits_at(self.estimate.model), self._steady(state))
        self._order = Order()
        self._told = RudderCommand(now, start, True)
        self._rest = Rest(start, start)
        return state

    def _steady(self, state: NavState) -> NavState:
        """Meet the waves: return what is steered by, the state without those that are left alone."""
        self._met = wave_rudder(self._steering, self.estimate.model, state)
        return steered_by(state, self._met.alone)

    def _calm(self, state: NavState, dt: float) -> NavState:
        """Return what is steered softly by: the mean bias of late. What a boat does that is not its model is taken for
        wind that comes and goes with each swing, and steering against that keeps it swinging."""
        share = -math.expm1(-dt / (CALM * self.estimate.model.time_constant))
        self._mean_bias += share * (state.bias - self._mean_bias)
        return state._replace(bias=self._mean_bias) if self.monitors.softer > 1.0 else state

    def _watch_steerage(self, now: float, mode: Mode, order: Order, state: NavState) -> None:
        """Notice when there is too little speed to hold a heading with, and when there is enough again."""
        counts = self.config.steerage_over_ground or not self.estimate.speeds.is_over_ground
        least = self.config.steerage * (STEERAGE_AGAIN if self._waits else 1.0)
        waits = mode is Mode.ENGAGED and order.kind is OrderKind.HEADING and counts and state.speed < least
        if waits == self._waits:
            return
        self._waits = waits
        if mode is Mode.ENGAGED:
            # the turn is planned anew, from where the boat has drifted to
            self._guide = started(self._guide, self._limits_at(self.estimate.model), state)
            self._begin_law(self._told.angle)

    def _lead(self, mode: Mode, order: Order, state: NavState, dt: float) -> Reference:
        if mode is not Mode.ENGAGED:
            return Reference(state.heading, state.rate, 0.0)
        model = self.estimate.model
        if not order.is_same(self._order):
            limits = self._limits_at(model)
            if self._order.kind is not OrderKind.HEADING:
                self._guide = started(self._guide, limits, state)
            self._guide = heading_ordered(self._guide, model, limits, state, order.heading)
            self._order = order
        if order.kind is not OrderKind.HEADING:
            return Reference(state.heading, state.rate, 0.0)
        if self._waits:
            return Reference(self._guide.heading)
        limits = self._limits_at(model)
        self._guide = referred(self._steering, self._guide, self._turning, model, state, Moved(self._told.angle, dt))
        return reference_of(model, limits, self._guide.boat)

    def _limits_at(self, model: Norrbin) -> TurnLimits:
        self._turning = turning_at(self._steering, self._turning, model)
        return self._turning.limits

    def _against_roll(self, now: float, dt: float, mode: Mode, order: Order) -> float:
        """Rudder against roll on top of the heading law's; trials keep the rudder they order."""
        if self.damper is None:
            return 0.0
        steers = mode is Mode.ENGAGED and order.kind is OrderKind.HEADING and self.config.rudder_is_ours
        self._roll_rudder = self.damper.update(now, dt, engaged=steers and not self._waits)
        return self._roll_rudder

    def _rested(self, mode: Mode, order: Order, previous: float, demand: float, limited: float) -> Rest:
        """Return what the dead band leaves of an order; only a course that is held has one."""
        if mode is not Mode.ENGAGED or order.kind is not OrderKind.HEADING or self._waits:
            return Rest(limited, limited)
        return rested(self.config.limits, self.config.dead_band, self._rest._replace(told=previous), demand, limited)

    def _demand(self, mode: Mode, order: Order, reference: Reference, state: NavState, dt: float) -> float:
        undoing, self._undoing = self._undoing, 0.0
        if mode is not Mode.ENGAGED:
            return 0.0
        if order.kind is OrderKind.RUDDER:
            return order.rudder
        if order.kind is OrderKind.ZIGZAG:
            self._guide = zigzag(self._guide, order, state.heading)
            return self._guide.side * order.rudder
        if self._waits:
            return 0.0
        # the law's memory is of its own rudder, not of what was set against waves and roll on top of it
        own, self._undoing = self._rest.allowed - self._roll_rudder - undoing, self._met.rudder
        model = self.estimate.model
        if self.monitors.softer > 1.0:
            model = model._replace(gain=model.gain * self.monitors.softer)
        return self._ask_law(model, reference, state, own, dt) + self._met.rudder

    def _begin_law(self, rudder: float) -> None:
        """Have the law begin anew at `rudder` [rad]; of the roll from before nothing counts."""
        self.law_memory, self._roll = self.law.first(rudder), None

    def _ask_law(self, model: Norrbin, reference: Reference, state: NavState, last_rudder: float, dt: float) -> float:
        """Return the law's demand [rad], and keep what it remembers."""
        config, roll = self.config, NO_ROLL if self._roll is None else self._roll_at(state.time)
        ratio = model.reference_speed / config.model.reference_speed
        given = LawInput(model, ratio, reference, state, roll, last_rudder, config.limits.angle_max, dt)
        kind, gains = self.law
        demand, self.law_memory = kind.step(gains, self.law_memory, given)
        return demand

    def _roll_at(self, now: float) -> RollInput:
        sample = self._roll
        if sample is None or sample.rate is None:
            return NO_ROLL
        return RollInput(sample.roll, sample.rate, now - sample.time)
