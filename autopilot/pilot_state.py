"""What the pilot knows of the boat, and what it remembers from tick to tick: two values of plain numbers.

They can be printed, saved, compared and restored; only the rings of the rudder observer are written in place
(`State.copied` has rings of its own). Pure.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

from autopilot.control.bow_thruster import Bow, BowThruster
from autopilot.control.law import LawInForce
from autopilot.control.limits import Rest, RudderLimits
from autopilot.control.roll_damping import RollDamper, RollDamping
from autopilot.estimation import estimator
from autopilot.estimation.disturbance import FilterNoise, noises_of
from autopilot.estimation.estimator import EstimatorConfig, EstimatorState
from autopilot.estimation.path_delay import behind
from autopilot.estimation.rudder_observer import AS_FILED, RudderRate, gone_by
from autopilot.estimation.tuning import RATE_BEYOND
from autopilot.models.drives import RUDDER_LAW, DriveLaw, Needs
from autopilot.models.norrbin import Norrbin, quickest_turn
from autopilot.models.steering_gear import SteeringGear
from autopilot.signals import AlarmEvent, RollSample, RudderCommand
from autopilot.steering import LONGEST_STEP, NOT_TURNING, CornerFrequencies, SteeringConfig, Way
from autopilot.supervision import failsafe, panel, supervisor
from autopilot.supervision.envelope import Envelope
from autopilot.supervision.monitor_input import AlarmLimits
from autopilot.supervision.monitors import NO_THRUST_SEEN, ThrusterMemory
from autopilot.supervision.monitors import State as MonitorState
from autopilot.supervision.supervisor import STEERING_ACTIONS, FailsafeAction


class PilotConfig(NamedTuple):
    """Everything the pilot knows of the boat; `build` makes it from a vessel file.

    rudder_share [-], turn_rate_max [rad/s] and turn_curvature_max [1/m] bound the planned turns. rudder_is_ours: False
    where the other side steers by itself to the reference heading, so that only what it reports says where the rudder
    is. corner_frequencies hold at the model's speed: which waves the law is shown, see
    `backstepping`. Below `steerage` [m/s], and astern, the rudder waits amidships; a speed over the ground counts
    for this where steerage_over_ground says so. law: how the model goes with speed and thrust; drive: what it needs to
    steer, and what throttle leaves it. roll: the rudder damps roll too, while that helps; None: it does not.
    dead_band [rad]: on a course the rudder rests until it is wrong by more. loop_delay [s]: so late an order comes to
    the gear by the file, and path_delay [s], nan: not known, as it was measured before; shows_path: whether
    the rudder tells it; delay_margin [s]: the law's. thruster: a bow thruster that holds
    the heading where the rudder waits; None: there is none.
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
    law: DriveLaw = RUDDER_LAW
    steers_by: Needs = Needs.WAY
    loop_delay: float = 0.0
    path_delay: float = math.nan
    shows_path: bool = True
    delay_margin: float = math.inf
    thruster: BowThruster | None = None


class Config(NamedTuple):
    """The pilot's config, its law, and what follows from both. has_thrusters: it turns by two, or by one at the bow."""

    boat: PilotConfig
    law: LawInForce
    steering: SteeringConfig
    envelope: Envelope
    has_thrusters: bool


def configured(boat: PilotConfig, law: LawInForce) -> Config:
    """Return what a boat is steered by with a law."""
    has_thrusters = boat.thruster is not None or boat.steers_by is Needs.NOTHING
    return Config(boat, law, steering_of(boat, law), _envelope_of(boat), has_thrusters)


def _envelope_of(config: PilotConfig) -> Envelope:
    failsafe = config.failsafe
    reckoned = failsafe.release_after + LONGEST_STEP if failsafe.action in STEERING_ACTIONS else 0.0
    angle_max, rate_max, to_port, to_starboard = config.limits
    return Envelope(angle_max, rate_max * max(to_port, to_starboard), failsafe.heading_timeout + reckoned)


def steering_of(config: PilotConfig, law: LawInForce) -> SteeringConfig:
    """Return what steering with the `law` goes by, in numbers.

    Two thrusts turn a boat by degrees while an order is on its way: what they are is known as behind the loop's delay.
    A gear that must move first turns it by tenths of one; its lag, which slower gears have as well, is left out where
    they are compared: with it a quick boat's rudder at half its rate is not found in turns of 90 and 45 deg.
    """
    has_gear = config.steers_by is not Needs.NOTHING
    gear = config.gear if has_gear else behind(config.gear, config.loop_delay)
    return SteeringConfig(
        estimator=EstimatorConfig(
            config.model,
            gear,
            noises_of(config.noise, RATE_BEYOND * quickest_turn(config.model, config.gear.angle_max)),
            config.steerage,
            config.law,
            config.loop_delay,
            config.shows_path,
        ),
        limits=config.limits,
        dead_band=config.dead_band,
        rudder_share=config.rudder_share,
        turn_rate_max=config.turn_rate_max,
        turn_curvature_max=config.turn_curvature_max,
        corner_frequencies=config.corner_frequencies,
        rudder_is_ours=config.rudder_is_ours,
        uses_bias=law.kind.uses_bias,
        delay_margin=config.delay_margin,
        timed_gear=gear._replace(lag=0.0) if has_gear else gear,
        has_gear=has_gear,
    )


def steering_with(config: SteeringConfig, rate: RudderRate) -> SteeringConfig:
    """Return what steering goes by with the rudder that the boat turns out to have."""
    estimator = config.estimator
    return config._replace(estimator=estimator._replace(gear=gone_by(estimator.gear, rate)))


class Control(NamedTuple):
    """What works the demand out: the law's own memory, and the roll that it goes by; the roll damping beside it and its
    rudder [rad]; damps_roll: whether one of them works against roll."""

    law: Any
    roll: RollSample | None = None
    damper: RollDamper = RollDamper()
    roll_rudder: float = 0.0
    damps_roll: bool = False


class Rudder(NamedTuple):
    """What the rudder was given: the last command; what the dead band left of it; whether a fail-safe reckons the
    heading; and how quick the rudder turns out to be."""

    command: RudderCommand = RudderCommand(0.0, 0.0, False)
    rest: Rest = Rest()
    is_reckoned: bool = False
    rate: RudderRate = AS_FILED


NO_FINDINGS: Mapping[str, AlarmEvent] = {}


class State(NamedTuple):
    """All that is remembered from tick to tick.

    now [s]: of the last tick, nan before the first, which was the number-th. mean_bias [rad]: the bias of late.
    findings: of the monitors at the last tick, by their names in the catalogue.
    """

    estimate: EstimatorState
    monitors: MonitorState
    supervisor: supervisor.Memory
    panel: panel.Memory
    failsafe: failsafe.Memory
    control: Control
    way: Way = Way()
    rudder: Rudder = Rudder()
    mean_bias: float = 0.0
    number: int = 0
    now: float = math.nan
    findings: Mapping[str, AlarmEvent] = NO_FINDINGS
    thrusters: ThrusterMemory = NO_THRUST_SEEN
    bow: Bow = Bow()

    @property
    def copied(self) -> State:
        """The same with rings of its own: what is kept while another goes on from this one."""
        estimate = self.estimate
        return self._replace(estimate=estimate._replace(memory=estimate.memory.copied))


def first_state(config: Config) -> State:
    """Return the state at power-on: nothing is known."""
    return State(
        estimate=estimator.first_state(config.steering.estimator, config.boat.path_delay),
        monitors=MonitorState(),
        supervisor=supervisor.NOTHING_SEEN,
        panel=panel.QUIET,
        failsafe=failsafe.NO_MEMORY,
        control=Control(config.law.first(0.0)),
    )


def reconfigured(before: Config, config: Config, state: State) -> State:
    """Return the state under other numbers: memory is kept, the law starts at the rudder that was commanded.

    ValueError where that lies outside the new limits: it would have to jump.
    """
    angle = state.rudder.command.angle
    if abs(angle) > config.boat.limits.angle_max:
        raise ValueError("reconfigure: the rudder stands outside the new limits")
    control = begun(config, state.control, angle)
    if config.boat.roll != before.boat.roll:
        control = control._replace(damper=RollDamper(), roll_rudder=0.0)
    return state._replace(
        estimate=estimator.reconfigured(before.steering.estimator, config.steering.estimator, state.estimate),
        control=control,
        way=state.way._replace(turning=NOT_TURNING),
    )


def begun(config: Config, control: Control, angle: float) -> Control:
    """Return the law begun anew at the rudder `angle` [rad]; of the roll from before nothing counts."""
    return control._replace(law=config.law.first(angle), roll=None)
