"""The law of heading and roll with the rudder alone: Liu and Jin 2017 as the pilot steers by it, and its gains.

The laws of `rudder_roll` and `sliding_heading` on x = (v, p, r, phi, psi) become, about the reference psi_d and r_d,

    delta = delta_d + (1 - w) delta_quiet(x - x_d) + w delta_roll(x - x_d) - b

with delta_d the rudder that the identified model asks for in a planned turn, v_d and phi_d those of a steady turn at
r_d by the linear model, b the rudder angle that wind, current and trim are worth, and w the weight of `RollSchedule`
times its strength in this sea and the share that the gear's rate allows, worked out anew at every tick. phi is measured
from the boat's list, the mean roll over LIST_TIME. Sway is not measured: v counts as v_d (measured:
benchmarks/results/liu2017.md). The shadows' gear has the rate that the rudder shows.

At `ratio` times the reference speed the model has A's columns of v and r times ratio and b times ratio^2; those of p
and phi stay, since a hull's damping and righting moment in roll hardly know the speed. The gains k go with 1/ratio and
eta with ratio, as the gains of the other laws do; the surfaces are those of the model at that speed.

`roll_section` makes the gains for a boat whose roll was identified. The model is the row of roll, the yaw of the vessel
file's model, and a sway that nothing hangs on:

    v' = -v/T,   p' = a_p p + a_r r + a_phi phi + b_p delta,   r' = -(n1 r - K delta)/T

The feedback k on p, r and phi minimises the integral of q p^2 + delta^2 (Riccati), with the least q that gives the roll
the damping asked for; less is asked for where the law is not stable from 20 to 150 % of the reference speed, with the
rudder's lag and the loop's dead time. The surfaces are reached with time constants of several T: a slack course, as
docs/roll_damping.md says of the law.
"""

from __future__ import annotations

import math
from dataclasses import astuple, dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Annotated, NamedTuple

from autopilot.angles import wrap
from autopilot.control.law import Law, LawBoat, LawInput, LoopGains, RollInput
from autopilot.control.limits import RATE_UNSEEN, ShownRate, seen
from autopilot.control.roll_damping import OLD
from autopilot.control.rudder_roll import (
    AT_REST,
    LinearMotion,
    LinearStep,
    Motion,
    Proof,
    RateGain,
    RollGains,
    RollLaw,
    RollSchedule,
    ScheduleParts,
    ScheduleSettings,
    begin_schedule,
    damping_rudder,
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
from autopilot.files.typed import NOW, Bounds, Positive
from autopilot.models.norrbin import Norrbin, liveliness, rudder_for
from autopilot.models.steering_gear import SteeringGear, clip

if TYPE_CHECKING:
    # numpy works the laws out, before they steer; pilots with other laws do without
    import numpy as np
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

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


Row = tuple[float, float, float, float, float]
"""Over v [m/s], p, r [rad/s], phi and the rudder [rad]."""


@dataclass(frozen=True)
class QuietHeading:
    """The law of sway and yaw that steers where roll is not to be damped; reach and boundary hold for |h| = 1."""

    k_v_s_m: Annotated[float, NOW, Bounds(-1.0e3, 1.0e3, "rudder angle per sway speed")]
    k_r_s: Annotated[float, NOW, Bounds(-1.0e4, 1.0e4, "rudder angle per yaw rate")]
    reach: Annotated[float, NOW, Bounds(Positive, 1.0e6, "eta: speed towards the surface")]
    boundary: Annotated[float, NOW, Bounds(Positive, 1.0e6, "width of the layer where the law is linear")]


@dataclass(frozen=True)
class SlidingRoll:
    """Heading and roll by the rudder alone, with the linear model of sway, roll and yaw at the reference speed.

    Rows: v' [m/s^2], p' and r' [rad/s^2] over v [m/s], p, r [rad/s], phi and the rudder [rad], starboard positive.
    """

    sway_row: Annotated[Row, NOW]
    roll_row: Annotated[Row, NOW]
    yaw_row: Annotated[Row, NOW]
    k_v_s_m: Annotated[float, NOW, Bounds(-1.0e3, 1.0e3, "rudder angle per sway speed; shapes the surface")]
    k_p_s: Annotated[float, NOW, Bounds(-1.0e3, 1.0e3, "rudder angle per roll rate")]
    k_r_s: Annotated[float, NOW, Bounds(-1.0e4, 1.0e4, "rudder angle per yaw rate")]
    k_phi: Annotated[float, NOW, Bounds(-1.0e3, 1.0e3, "rudder angle per roll angle")]
    reach: Annotated[float, NOW, Bounds(Positive, 1.0e6, "eta: speed towards the surface, for |h| = 1")]
    boundary: Annotated[float, NOW, Bounds(Positive, 1.0e6, "width of the layer where the law is linear")]
    quiet: QuietHeading
    rudder_rms_deg: Annotated[
        float, NOW, Bounds(Positive, 90.0, "rms that the rudder may have under this law: what it may cost in speed")
    ] = 7.5
    source: Annotated[str, NOW] = ""
    date: Annotated[str, NOW] = ""


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
    import numpy as np

    table = np.array(rows)
    A, b = np.zeros((5, 5)), np.zeros(5)
    A[:3, :4], b[:3] = table[:, :4], table[:, 4]
    A[3, 1] = A[4, 2] = 1.0
    return LinearMotion(A, b)


def steady_turn(model: LinearMotion) -> tuple[float, float]:
    """Return sway [m/s] and roll [rad] for each rad/s of a steady turn. ValueError where the model has none."""
    import numpy as np

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
    import numpy as np

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
    import numpy as np

    slope = law.switching / law.boundary
    return np.array([0.0, 0.0, law.k_r + slope * law.h_r, 0.0, slope * law.h_psi])


def near_surface_roll(law: RollLaw) -> Array:
    """Return the same of the roll law."""
    import numpy as np

    slope = law.switching / law.boundary
    gains = (law.k_p + slope * law.h_p, law.k_r + slope * law.h_r, law.k_phi + slope * law.h_phi, slope * law.h_psi)
    return np.array([0.0, *gains])


def slowest(ship: RollShip, model: LinearMotion, feedback: Array) -> float:
    """Return the largest real part [1/s] of the loop's poles, rudder lag and dead time (Pade, first order) in it."""
    import numpy as np

    lag, half = max(ship.gear.lag, 1.0e-3), max(0.5 * ship.delay, 1.0e-3)
    loop = np.zeros((7, 7))
    loop[:5, :5], loop[:5, 5] = model.A, model.b
    loop[5, :5], loop[5, 5], loop[5, 6] = feedback / lag, -1.0 / lag, 2.0 / lag
    loop[6, :5], loop[6, 6] = -feedback / half, -1.0 / half
    return float(np.max(np.linalg.eigvals(loop).real))


def _step_at(ratio: float) -> int:
    """Return the number of speed steps from the reference speed to `ratio` times it."""
    return round(math.log(clip(ratio, *SPEED_RANGE)) / SPEED_STEP)


class RollNumbers(NamedTuple):
    """What the law steers by: the boat, the gains of both laws at the reference speed, the laws made ready speed by
    speed, the laws `here`, at the speed for which these numbers were asked, and the exact steps of the linear model
    that were worked out so far, by the place of the speed and the time [s]: a table, nothing that is remembered; and
    what the schedule goes by."""

    ship: RollShip
    quiet: SwayYawGains
    roll: RollGains
    speeds: tuple[AtSpeed, ...]
    here: AtSpeed
    steps: dict[tuple[int, float], LinearStep]
    settings: ScheduleSettings


class RollMemory(NamedTuple):
    """Time [s] of the last tick, the rate that the rudder has shown, the schedule, the part [s] of a step that it is
    still owed, the mean roll [rad], over so long [s], and the rate of the roll law's demand."""

    time: float
    rate: ShownRate
    schedule: RollSchedule
    owed: float = 0.0
    list: float = 0.0
    listed: float = 0.0
    gain: RateGain = AT_REST


def roll_numbers(
    ship: RollShip,
    quiet: SwayYawGains,
    roll: RollGains,
    settings: ScheduleSettings = ScheduleSettings(),  # noqa: B008
) -> RollNumbers:
    """Return what the law steers by.

    ValueError for a linear model that is not stable or has no steady turn, for gains that are not stable with it at a
    speed in SPEED_RANGE, or for a rudder without effect.
    """
    import numpy as np

    growing = float(np.max(np.linalg.eigvals(ship.model.A[:4, :4]).real))
    if growing >= 0.0:
        raise ValueError(
            f"the linear model with the rudder amidships must be stable, it has an eigenvalue of real part "
            f"{growing:.3g} 1/s; the law predicts the boat by it"
        )
    places = range(_step_at(SPEED_RANGE[0]), _step_at(SPEED_RANGE[1]) + 1)
    speeds = tuple(laws_at(ship, quiet, roll, math.exp(SPEED_STEP * place)) for place in places)
    return RollNumbers(ship, quiet, roll, speeds, speeds[place_of(1.0)], {}, settings)


@lru_cache(maxsize=8)
def _numbers_of(section: SlidingRoll, boat: LawBoat) -> RollNumbers:
    """Return the numbers of a vessel file for the boat: ready in a tenth of a second, and asked for again and again."""
    ship = RollShip(
        linear_model((section.sway_row, section.roll_row, section.yaw_row)),
        boat.model.reference_speed,
        boat.gear._replace(angle_max=boat.limits.angle_max, rate_max=boat.limits.rate_max),
        boat.delay,
        boat.model.gain / boat.model.reference_speed,
    )
    k = (section.k_v_s_m, section.k_p_s, section.k_r_s, section.k_phi)
    quiet, roll = SwayYawGains(*astuple(section.quiet)), RollGains(*k, section.reach, section.boundary)
    budget = math.radians(section.rudder_rms_deg)
    return roll_numbers(ship, quiet, roll, ScheduleSettings(budget=budget, roll_time=-2.0 / section.roll_row[1]))


def place_of(ratio: float) -> int:
    """Return the place in `RollNumbers.speeds` of the laws that steer at `ratio` times the reference speed."""
    return _step_at(ratio) - _step_at(SPEED_RANGE[0])


def first(numbers: RollNumbers, rudder: float) -> RollMemory:
    """Return a memory that knows neither roll nor sea: the quiet law steers until it is known what roll damping would
    bring."""
    return RollMemory(math.nan, RATE_UNSEEN, begin_schedule())


def step(numbers: RollNumbers, memory: RollMemory, given: LawInput) -> tuple[float, RollMemory]:
    """Return the rudder demand [rad] of the law, which takes the sway for that of the planned turn."""
    return steered(numbers, memory, given, 0.0)


def steered(numbers: RollNumbers, memory: RollMemory, given: LawInput, sway: float) -> tuple[float, RollMemory]:
    """Return the rudder demand [rad] with so much `sway` [m/s] beside that of the planned turn; without roll that of
    the quiet heading law alone."""
    ship, place, state = numbers.ship, place_of(given.ratio), given.state
    at, model, reference = numbers.speeds[place], given.model, given.reference
    planned = rudder_for(model, reference.rate, reference.acceleration)
    error, rate = wrap(state.heading - reference.heading), state.rate - reference.rate
    is_fresh = _is_fresh(given.roll) and state.heading_age <= HEADING_OLD
    if not is_fresh or not abs(state.time - memory.time) <= LONGEST_STEP:
        # where the law fell short the cause is the boat's, not the sea's
        proof = memory.schedule.proof
        begun = begin_schedule(Proof(failures=proof.failures, barred=proof.barred))
        memory = RollMemory(memory.time, memory.rate._replace(since=0.0), begun)
    shown = seen(memory.rate, ship.gear, state.rudder, given.last_rudder, given.dt)
    memory = memory._replace(time=state.time, rate=shown)
    if not is_fresh:
        quiet = sway_yaw_rudder(at.quiet, 0.0, rate, error)
        known = ship.gain_per_speed
        return planned + (quiet if known is None else quiet / liveliness(model, known)) - state.bias, memory
    heel = given.roll.angle - at.roll_per_rate * reference.rate
    memory = _with_list(memory, heel, given.dt)
    off = Motion(sway, given.roll.rate, rate, heel - memory.list, error)
    owed = clip(memory.owed + given.dt, 0.0, LONGEST_STEP)
    span = round(owed, STEP_PLACES)
    memory = memory._replace(owed=owed - span)
    rate_max = min(ship.gear.rate_max, shown.rate)
    if span > 0.0:
        # the steering gear of the file with the rate that the rudder has shown
        gear = ship.gear._replace(rate_max=rate_max)
        parts = ScheduleParts(numbers.settings, at.quiet, at.roll, gear, _step_of(numbers, place, span))
        beside = state.rudder + state.bias - planned
        memory = memory._replace(schedule=schedule_step(parts, memory.schedule, off, 0.0, beside, span))
    quiet = sway_yaw_rudder(at.quiet, off.v, rate, error)
    damped = roll_rudder(at.roll, off, 0.0)
    shares = memory.schedule.weight, memory.schedule.strength
    rudder, gain = damping_rudder(shares, memory.gain, quiet, damped, (rate_max, given.dt))
    return float(planned + rudder - state.bias), memory._replace(gain=gain)


def _is_fresh(roll: RollInput) -> bool:
    return abs(roll.age) <= OLD and abs(roll.angle) <= math.pi and abs(roll.rate) <= ROLL_RATE_MOST


def _with_list(memory: RollMemory, heel: float, dt: float) -> RollMemory:
    listed = min(memory.listed + dt, LIST_TIME)
    mean = memory.list
    if listed > 0.0:
        mean += min(dt / listed, 1.0) * (heel - mean)
    return memory._replace(list=mean, listed=listed)


def _step_of(numbers: RollNumbers, place: int, span: float) -> LinearStep:
    found = numbers.steps.get((place, span))
    if found is None:
        if len(numbers.steps) >= STEPS_KEPT:
            numbers.steps.clear()
        found = numbers.steps[place, span] = linear_step_of(numbers.speeds[place].model, span)
    return found


def _at(numbers: RollNumbers, ratio: float) -> RollNumbers:
    here = laws_at(numbers.ship, numbers.quiet, numbers.roll, clip(ratio, *SPEED_RANGE))
    return numbers._replace(here=here)


def _linear(numbers: RollNumbers, model: Norrbin) -> LoopGains:
    """Return what the quiet part of the law does about straight running."""
    _, _, rate, _, heading = near_surface_quiet(numbers.here.quiet)
    return LoopGains(float(heading), 0.0, float(rate))


def _shown(section: SlidingRoll, numbers: RollNumbers, ratio: float) -> dict[str, float]:
    _, _, rate, _, heading = near_surface_quiet(_at(numbers, ratio).here.quiet)
    return {"quiet_rudder_per_heading": float(heading), "quiet_rudder_per_rate_s": float(rate)}


LAW = Law(
    name="sliding_roll",
    title="Sliding law for heading and roll",
    prefix="SLR",
    section=SlidingRoll,
    numbers=RollNumbers,
    gains=_numbers_of,
    first=first,
    step=step,
    at=_at,
    linear=_linear,
    shown=_shown,
    takes_roll=True,
    advice="docs/roll_damping.md says how",
)


ASKED = (2.0, 1.7, 1.45, 1.25)
"""The roll's damping ratio under the law, in those of the boat itself; the first that is stable counts. More than twice
has the rudder at its stops in any sea."""
LARGEST = 0.5
"""A boat that damps its roll by more of critical than this needs no law for it."""
QUIET_YAW, QUIET_REACH, ROLL_REACH = 0.85, 0.4, 0.12
"""The quiet law's K k_r, and how quickly its surface and the roll law's are reached, in 1/T; as in the shipped file of
the naval vessel, which sailed (benchmarks/results/liu2017.md): 0.85, 0.38 and 0.11."""
QUIET_BOUNDARY, ROLL_BOUNDARY = 0.5, 1.2
"""Width of the two layers for |h| = 1, as in that file."""
LARGEST_WEIGHT = 1.0e6


def roll_section(row: Row, boat: LawBoat, source: str, date: str) -> SlidingRoll:
    """Return the law's section for the row of roll at the reference speed of `boat`. ValueError where there is none."""
    import numpy as np

    model = boat.model
    if model.n1 <= 0.0:
        raise ValueError("the boat is course-unstable, and this law needs one that runs straight by itself")
    yaw: Row = (0.0, 0.0, -model.n1 / model.time_constant, 0.0, model.gain / model.time_constant)
    sway: Row = (-1.0 / model.time_constant, 0.0, 0.0, 0.0, 0.0)
    linear = linear_model((sway, row, yaw))
    own = _least_damping(linear.A[1:4, 1:4])
    ship = RollShip(
        linear,
        model.reference_speed,
        boat.gear._replace(angle_max=boat.limits.angle_max, rate_max=boat.limits.rate_max),
        boat.delay,
        model.gain / model.reference_speed,
    )
    quiet = SwayYawGains(
        0.0, QUIET_YAW / model.gain, QUIET_REACH / model.time_constant * QUIET_BOUNDARY, QUIET_BOUNDARY
    )
    sway_yaw_law(linear.A[np.ix_(STEERING, STEERING)], linear.b[STEERING], quiet)
    reason = ""
    for asked in ASKED:
        if own > LARGEST:
            break
        try:
            k_p, k_r, k_phi = _feedback(linear.A[1:4, 1:4], linear.b[1:4], asked * own)
            reach = ROLL_REACH / model.time_constant * ROLL_BOUNDARY
            roll_numbers(ship, quiet, RollGains(0.0, k_p, k_r, k_phi, reach, ROLL_BOUNDARY))
        except ValueError as error:
            reason = str(error)
            continue
        return SlidingRoll(
            sway_row=_as_filed(sway),
            roll_row=_as_filed(row),
            yaw_row=_as_filed(yaw),
            k_v_s_m=0.0,
            k_p_s=float(f"{k_p:.4g}"),
            k_r_s=float(f"{k_r:.4g}"),
            k_phi=float(f"{k_phi:.4g}"),
            reach=float(f"{reach:.4g}"),
            boundary=ROLL_BOUNDARY,
            quiet=QuietHeading(*(float(f"{one:.4g}") for one in quiet)),
            source=source,
            date=date,
        )
    raise ValueError(
        reason or f"the boat damps its roll by {own:.2f} of critical by itself; this law adds nothing to that"
    )


def _as_filed(row: Row) -> Row:
    v, p, r, phi, rudder = (float(f"{one:.6g}") for one in row)
    return v, p, r, phi, rudder


def _least_damping(A: Array) -> float:
    """Return the least damping ratio of the modes that swing, 1 where none does."""
    import numpy as np

    poles = np.linalg.eigvals(A)
    return min((float(-pole.real / abs(pole)) for pole in poles if abs(pole.imag) > 1.0e-9), default=1.0)


def _feedback(A: Array, b: Array, asked: float) -> tuple[float, float, float]:
    """Return k on p, r and phi of the least weight q that gives the damping asked for. ValueError where none does."""
    import numpy as np
    from scipy.linalg import solve_continuous_are

    column = b[:, None]

    def gains(log: float) -> Array:
        found = solve_continuous_are(A, column, np.diag([math.exp(log), 1.0e-9, 1.0e-9]), np.eye(1))
        k: Array = (column.T @ found)[0]
        return k

    low, high = math.log(1.0e-8), math.log(LARGEST_WEIGHT)
    if _least_damping(A - np.outer(b, gains(high))) < asked:
        raise ValueError(f"no feedback damps the roll to {asked:g} of critical")
    for _ in range(50):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if _least_damping(A - np.outer(b, gains(middle))) >= asked else (middle, high)
    k = gains(high)
    return float(k[0]), float(k[1]), float(k[2])
