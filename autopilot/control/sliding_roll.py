"""Heading and roll with the rudder alone, as the pilot steers: Liu and Jin 2017 behind the heading laws' interface.

The laws of `rudder_roll` and `sliding_heading` on x = (v, p, r, phi, psi) become, about the reference psi_d and r_d,

    delta = delta_d + (1 - w) delta_quiet(x - x_d) + w delta_roll(x - x_d) - b

with delta_d the rudder that the identified model asks for in a planned turn, v_d and phi_d those of a steady turn at
r_d by the linear model, b the rudder angle that wind, current and trim are worth, and w the weight of `RollSchedule`,
worked out anew at every tick. phi is measured from the boat's list, the mean roll over LIST_TIME. Sway is not measured:
v counts as v_d (measured: benchmarks/results/liu2017.md). The shadows' gear has the rate that the rudder shows.

At `ratio` times the reference speed the model has A's columns of v and r times ratio and b times ratio^2; those of p
and phi stay, since a hull's damping and righting moment in roll hardly know the speed. The gains k go with 1/ratio and
eta with ratio, as the gains of the other laws do; the surfaces are those of the model at that speed.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from autopilot.angles import wrap
from autopilot.control.limits import RATE_UNSEEN, seen
from autopilot.control.roll_damping import OLD
from autopilot.control.rudder_roll import (
    LinearStep,
    Proof,
    RollGains,
    RollLaw,
    ScheduleParts,
    ScheduleSettings,
    begin_schedule,
    blended_rudder,
    linear_step_of,
    roll_law,
    roll_rudder,
    schedule_step,
)
from autopilot.control.sliding_heading import (
    SMALL,
    SPEED_RANGE,
    SwayYawGains,
    SwayYawLaw,
    sway_yaw_law,
    sway_yaw_rudder,
)
from autopilot.models.naval_vessel import LinearMotion, Motion
from autopilot.models.norrbin import Norrbin, liveliness, rudder_for
from autopilot.models.steering_gear import SteeringGear, clip
from autopilot.signals import NavState, Reference, RollSample

Array = NDArray[np.float64]

SETTINGS = ScheduleSettings()
STEERING = [0, 2, 4]
"""Places of v, r and psi among the five states."""
SPEED_STEP = 0.05
"""The laws are made ready for speeds this share apart."""
LIST_TIME = 15.0
"""Time [s] over which the list is averaged."""
ROLL_RATE_MOST = math.pi
"""No ship rolls faster [rad/s]."""
HEADING_OLD = 2.0
"""Age [s] of the heading at which the quiet law steers alone: what is reckoned is no ground to work the rudder hard."""
LONGEST_STEP = 0.5
"""After a longer silence between two updates [s], as while a trial steers, the schedule begins anew."""
STEP_PLACES = 3
"""Decimals of the shadows' step [s]: few differ, and their matrices are kept; the rest of a step goes to the next."""
STEPS_KEPT = 128


class RollShip(NamedTuple):
    """What the law knows of the boat: linear model at `reference_speed` [m/s], steering gear as far as it may be used,
    dead time [s] from measurement to rudder, K/U [1/m] of the boat; None: the law orders alike for any boat."""

    model: LinearMotion
    reference_speed: float
    gear: SteeringGear
    delay: float = 0.0
    gain_per_speed: float | None = None


class AtSpeed(NamedTuple):
    """The laws made ready for one speed: the linear model, both laws, and v_d [m/s] and phi_d [rad] per r_d [rad/s]."""

    model: LinearMotion
    quiet: SwayYawLaw
    roll: RollLaw
    sway_per_rate: float
    roll_per_rate: float


def scaled_model(model: LinearMotion, ratio: float) -> LinearMotion:
    """Return the linear model at `ratio` times the speed at which `model` holds."""
    A = model.A.copy()
    A[:3, [0, 2]] *= ratio
    return LinearMotion(A, model.b * ratio * ratio)


def linear_model(rows: tuple[tuple[float, ...], tuple[float, ...], tuple[float, ...]]) -> LinearMotion:
    """Return the model whose `rows` are v', p' and r' over v, p, r, phi and the rudder [SI, rad]."""
    table = np.array(rows)
    A, b = np.zeros((5, 5)), np.zeros(5)
    A[:3, :4], b[:3] = table[:, :4], table[:, 4]
    A[3, 1] = A[4, 2] = 1.0
    return LinearMotion(A, b)


def steady_turn(model: LinearMotion) -> tuple[float, float]:
    """Return sway [m/s] and roll [rad] for each rad/s of a steady turn. ValueError where the model has none."""
    # v, phi and the rudder from v' = p' = r' = 0 with p = 0 and r = 1
    left = np.column_stack((model.A[:3, 0], model.A[:3, 3], model.b[:3]))
    if abs(np.linalg.det(left)) < SMALL:
        raise ValueError(
            "the linear model has no steady turn: its columns of v, phi and the rudder depend on each other"
        )
    sway, roll, _ = np.linalg.solve(left, -model.A[:3, 2])
    return float(sway), float(roll)


def quiet_at(model: LinearMotion, gains: SwayYawGains) -> SwayYawLaw:
    """Return the quiet heading law on sway and yaw of the model. ValueError for gains that do not stabilise it."""
    return sway_yaw_law(model.A[np.ix_(STEERING, STEERING)], model.b[STEERING], gains)


def laws_at(ship: RollShip, quiet: SwayYawGains, roll: RollGains, ratio: float) -> AtSpeed:
    """Return the laws at `ratio` times the reference speed. ValueError for gains that are not stable there."""
    try:
        found = _laws_at(ship.model, quiet, roll, ratio)
    except ValueError as error:
        raise ValueError(f"at {ratio:.2g} times the reference speed: {error}") from None
    for name, feedback in (("quiet", near_surface_quiet(found.quiet)), ("roll", near_surface_roll(found.roll))):
        if slowest(ship, found.model, feedback) >= 0.0:
            raise ValueError(
                f"at {ratio:.2g} times the reference speed: the {name} law swings with the rudder's lag of "
                f"{ship.gear.lag:g} s and {ship.delay:g} s of dead time; give smaller gains, or a larger boundary"
            )
    return found


def _laws_at(at_reference: LinearMotion, quiet: SwayYawGains, roll: RollGains, ratio: float) -> AtSpeed:
    model = scaled_model(at_reference, ratio)
    # eta and W are for |h| = 1: counted in heading, eta goes with the speed and W stays
    turned = quiet_at(model, quiet._replace(k_v=quiet.k_v / ratio, k_r=quiet.k_r / ratio))
    share = turned.h_psi / quiet_at(at_reference, quiet).h_psi
    k_v, k_p, k_r, k_phi = (gain / ratio for gain in roll[:4])
    slower = RollGains(k_v, k_p, k_r, k_phi, roll.reach, roll.boundary)
    heeled = roll_law(model, slower)
    other = heeled.h_psi / roll_law(at_reference, roll).h_psi
    return AtSpeed(
        model,
        turned._replace(switching=turned.switching * ratio * share, boundary=turned.boundary * share),
        heeled._replace(switching=heeled.switching * ratio * other, boundary=heeled.boundary * other),
        *steady_turn(model),
    )


def near_surface_quiet(law: SwayYawLaw) -> Array:
    """Return rudder per (v, p, r, phi, psi) of the quiet law near its surface, v counting as that of the turn."""
    slope = law.switching / law.boundary
    return np.array([0.0, 0.0, law.k_r + slope * law.h_r, 0.0, slope * law.h_psi])


def near_surface_roll(law: RollLaw) -> Array:
    """Return the same of the roll law."""
    slope = law.switching / law.boundary
    gains = (law.k_p + slope * law.h_p, law.k_r + slope * law.h_r, law.k_phi + slope * law.h_phi, slope * law.h_psi)
    return np.array([0.0, *gains])


def slowest(ship: RollShip, model: LinearMotion, feedback: Array) -> float:
    """Return the largest real part [1/s] of the loop's poles, rudder lag and dead time (Pade, first order) in it."""
    lag, half = max(ship.gear.lag, 1.0e-3), max(0.5 * ship.delay, 1.0e-3)
    loop = np.zeros((7, 7))
    loop[:5, :5], loop[:5, 5] = model.A, model.b
    loop[5, :5], loop[5, 5], loop[5, 6] = feedback / lag, -1.0 / lag, 2.0 / lag
    loop[6, :5], loop[6, 6] = -feedback / half, -1.0 / half
    return float(np.max(np.linalg.eigvals(loop).real))


def _step_at(ratio: float) -> int:
    """Return the number of speed steps from the reference speed to `ratio` times it."""
    return round(math.log(clip(ratio, *SPEED_RANGE)) / SPEED_STEP)


class SlidingRollLaw:
    """The law as the pilot holds it. It hears roll; without, it is the quiet heading law alone.

    ValueError for a linear model that is not stable or has no steady turn, for gains that are not stable with it at a
    speed in SPEED_RANGE, or for a rudder without effect.
    """

    name = "sliding_roll"

    def __init__(self, ship: RollShip, quiet: SwayYawGains, roll: RollGains) -> None:
        self.ship = ship
        growing = float(np.max(np.linalg.eigvals(ship.model.A[:4, :4]).real))
        if growing >= 0.0:
            raise ValueError(
                f"the linear model with the rudder amidships must be stable, it has an eigenvalue of real part "
                f"{growing:.3g} 1/s; the law foretells the boat by it"
            )
        places = range(_step_at(SPEED_RANGE[0]), _step_at(SPEED_RANGE[1]) + 1)
        self._speeds = {place: laws_at(ship, quiet, roll, math.exp(SPEED_STEP * place)) for place in places}
        self._steps: dict[tuple[int, float], LinearStep] = {}
        self.reset(0.0)

    @property
    def weight(self) -> float:
        """The roll law's weight [-]; the rest is the quiet law's."""
        return self._schedule.weight

    def at(self, ratio: float) -> AtSpeed:
        """Return the laws in force at `ratio` times the reference speed."""
        return self._speeds[_step_at(ratio)]

    def reset(self, rudder: float) -> None:
        """Forget roll and sea: the quiet law steers until it is known anew what roll damping would bring."""
        self._sample: RollSample | None = None
        self._time = math.nan
        self._rate, self._schedule = RATE_UNSEEN, begin_schedule()
        self._forget()

    def _forget(self) -> None:
        # where the law fell short the cause is the boat's, not the sea's
        proof = self._schedule.proof
        self._schedule = begin_schedule(Proof(failures=proof.failures, barred=proof.barred))
        self._owed = self._list = self._listed = 0.0

    def hear(self, sample: RollSample) -> None:
        """Take a sample that has a rate; one that no boat can show ends roll damping at once."""
        if sample.rate is not None:
            is_roll = abs(sample.roll) <= math.pi and abs(sample.rate) <= ROLL_RATE_MOST
            self._sample = sample if is_roll else None

    def update(self, model: Norrbin, reference: Reference, state: NavState, last_rudder: float, dt: float) -> float:
        """Return the rudder demand [rad]."""
        place = _step_at(model.reference_speed / self.ship.reference_speed)
        at = self._speeds[place]
        planned = rudder_for(model, reference.rate, reference.acceleration)
        error, rate = wrap(state.heading - reference.heading), state.rate - reference.rate
        sample = self._fresh(state)
        if sample is None or not abs(state.time - self._time) <= LONGEST_STEP:
            self._forget()
            self._rate = self._rate._replace(since=0.0)
        self._time = state.time
        self._rate = seen(self._rate, self.ship.gear, state.rudder, last_rudder, dt)
        if sample is None or sample.rate is None:
            quiet = sway_yaw_rudder(at.quiet, 0.0, rate, error)
            known = self.ship.gain_per_speed
            return planned + (quiet if known is None else quiet / liveliness(model, known)) - state.bias
        heel = sample.roll - at.roll_per_rate * reference.rate
        off = Motion(self._sway(), sample.rate, rate, heel - self._list_with(heel, dt), error)
        self._look_on(place, off, state.rudder + state.bias - planned, dt)
        quiet = sway_yaw_rudder(at.quiet, off.v, rate, error)
        return float(planned + blended_rudder(self.weight, quiet, roll_rudder(at.roll, off, 0.0)) - state.bias)

    def _sway(self) -> float:
        """Return the sway [m/s] beside that of the planned turn: what the sea makes of it nobody knows."""
        return 0.0

    def _fresh(self, state: NavState) -> RollSample | None:
        sample = self._sample
        is_fresh = sample is not None and abs(state.time - sample.time) <= OLD and state.heading_age <= HEADING_OLD
        return sample if is_fresh else None

    def _list_with(self, heel: float, dt: float) -> float:
        self._listed = min(self._listed + dt, LIST_TIME)
        if self._listed > 0.0:
            self._list += min(dt / self._listed, 1.0) * (heel - self._list)
        return self._list

    def _look_on(self, place: int, off: Motion, rudder: float, dt: float) -> None:
        """Take the schedule on by `dt` [s] with the boat `off` its course and its `rudder` [rad] beside the planned."""
        owed = clip(self._owed + dt, 0.0, LONGEST_STEP)
        step = round(owed, STEP_PLACES)
        self._owed = owed - step
        if step <= 0.0:
            return
        at = self._speeds[place]
        parts = ScheduleParts(SETTINGS, at.quiet, at.roll, self._gear(), self._step_of(place, step))
        self._schedule = schedule_step(parts, self._schedule, off, 0.0, rudder, step)

    def _gear(self) -> SteeringGear:
        """Return the steering gear of the file with the rate that the rudder has shown."""
        gear = self.ship.gear
        return gear._replace(rate_max=min(gear.rate_max, self._rate.rate))

    def _step_of(self, place: int, step: float) -> LinearStep:
        found = self._steps.get((place, step))
        if found is None:
            if len(self._steps) >= STEPS_KEPT:
                self._steps.clear()
            found = self._steps[place, step] = linear_step_of(self._speeds[place].model, step)
        return found
