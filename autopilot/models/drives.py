"""What steers the boat: the kinds of drive, by name, and how a yaw model goes with speed and thrust under each.

A rudder's force goes with the square of the flow past it, so K ~ U and T ~ 1/U (`autopilot.models.norrbin`). Thrust
that is turned, or differs between two sides, turns the boat whatever its speed. The hull damps yaw at rest, too, and
its damping grows with the speed or, of a hull that wants to lie across its way, shrinks until it goes straight no more:

    r' = b (K0/T0) delta - a r/T0 - (n3/T0) r^3 - (n2/T0) r^2 - b n0/T0
    b = (U/U0)^p (n/n0)^q,   a = n1 (1 - w + w U/U0)

with the speed U, the throttle n as a share of full, and the trial's U0 and n0: K = K0 b and n1 = a; T and n3 stay. The
trim as an angle, n0/K, does not change. The loop is kept as quick as rudder or thrust can follow: a bandwidth that
goes with sqrt(K/T) asks for the same angle at each heading error.

p, q and w are identified (`autopilot.identification.drive_effect`). Until then a kind's usual ones stand: thrust of a
propeller or a jet goes with the square of its revolutions, q = 2, unless the flight controller or the motor's own
control makes it linear. In MANUAL mode ArduRover does with a vectored frame (MOT_VEC_ANGLEMAX) what it does with a
rudder: the servo follows the stick. Only its own modes reckon with the thrust (libraries/AR_Motors/AP_MotorsUGV.cpp,
output_regular). Pure; numba compiles it.

Two thrusters side by side are mixed by ArduRover as a skid-steered frame's (SERVOn_FUNCTION 73 and 74). The steering
stick s and the throttle t, both -1 to 1, are first held to |s| + |t| <= 1. With A = MOT_THST_ASYM and the lowest output
L = -1/A, steering may take (1 - L)/2 at most, where the throttle is (1 + L)/2; what still does not fit is shared by
MOT_STR_THR_MIX. Then left = t + s, right = t - s, what is negative times A, and

    out = sgn(x) (e - 1 + sqrt((1 - e)^2 + 4 e |x|))/(2 e),   e = MOT_THST_EXPO.

The firmware so takes the thrust of an output to be (1 - e) out + e out^2 ahead, and 1/A of that astern. What the boat
is steered by is the difference of the two thrusts, half of it as a share m of one thruster's full thrust ahead:

    m = (g(left) - g(right))/2,   rudder = m times the angle that full steering stands for

so that K does not go with the throttle. g is the firmware's thrust, or, where `drive.thrust_exponent` k says what these
thrusters do, |out|^k ahead and `drive.astern_share` of it astern, or A^-k, with which the firmware's two sides balance.
`steering_for` inverts all this.

Source: ArduPilot, libraries/AR_Motors/AP_MotorsUGV.cpp (output_skid_steering, get_scaled_throttle), Rover/mode.cpp
(get_pilot_desired_steering_and_throttle), 4.6.
"""

from __future__ import annotations

import math
from enum import Enum
from typing import TYPE_CHECKING, Literal, NamedTuple

from autopilot.models.norrbin import SPEED_FLOOR_RATIO, Norrbin

LEFT, RIGHT = 73, 74
"""SERVOn_FUNCTION: ThrottleLeft and ThrottleRight."""
HALVINGS = 12
"""Steps of a search for the steering: to 1/4096 of full, less than a microsecond of a pulse."""
LEAST_EXPO = 1.0e-6
"""Less is none to the firmware, which works in single precision."""
AT_LIMIT = 0.985
"""An output beyond this share of full is held there."""


class Mixing(NamedTuple):
    """How steering and throttle become thrust.

    asymmetry: MOT_THST_ASYM; expo: MOT_THST_EXPO; priority: MOT_STR_THR_MIX. exponent: thrust goes with this power of
    the output, nan: as the firmware takes it to; astern_share: thrust astern over that ahead, nan: as its mixer has it.
    """

    asymmetry: float = 1.0
    expo: float = 0.0
    priority: float = 0.5
    exponent: float = math.nan
    astern_share: float = math.nan


PLAIN = Mixing()
"""What an ArduRover of which nothing is known does."""


def mixed(mixing: Mixing, steering: float, throttle: float) -> tuple[float, float]:
    """Return what the left and the right output are at, -1 to 1, of stick and throttle, -1 to 1."""
    over = abs(steering) + abs(throttle)
    if over > 1.0:
        steering, throttle = steering / over, throttle / over
    lowest = -1.0 / max(mixing.asymmetry, 1.0)
    best = 0.5 * (1.0 + lowest)
    room = max(throttle, 0.0) - lowest if throttle < best else 1.0 - best
    steering, throttle = min(max(steering, -room), room), min(max(throttle, lowest), 1.0)
    over = max(throttle + abs(steering), (throttle - abs(steering)) / lowest)
    if over > 1.0:
        side = 1.0 if steering > 0.0 else -1.0
        if mixing.priority >= 0.5:
            steering *= 1.0 / over + (1.0 - 1.0 / over) * min(2.0 * mixing.priority - 1.0, 1.0)
            throttle = 1.0 - abs(steering) if throttle >= best else abs(steering) + lowest
        else:
            throttle *= 1.0 / over + (1.0 - 1.0 / over) * min(1.0 - 2.0 * mixing.priority, 1.0)
            steering = side * (1.0 - throttle if throttle >= best else throttle - lowest)
    return _output(mixing, throttle + steering), _output(mixing, throttle - steering)


def _output(mixing: Mixing, asked: float) -> float:
    asked = asked * max(mixing.asymmetry, 1.0) if asked < 0.0 else asked
    expo, size = mixing.expo, min(abs(asked), 1.0)
    if LEAST_EXPO <= abs(expo) <= 1.0:
        size = (expo - 1.0 + math.sqrt((1.0 - expo) ** 2 + 4.0 * expo * size)) / (2.0 * expo)
    return math.copysign(size, asked)


def unmixed(mixing: Mixing, left: float, right: float) -> tuple[float, float, bool]:
    """Return steering and throttle, -1 to 1, as they were mixed into the outputs, and whether one of these is at its
    limit: then less was taken than was asked for."""
    asked = [_asked(mixing, each) for each in (left, right)]
    return 0.5 * (asked[0] - asked[1]), 0.5 * (asked[0] + asked[1]), max(abs(left), abs(right)) >= AT_LIMIT


def _asked(mixing: Mixing, output: float) -> float:
    expo, size = mixing.expo, min(abs(output), 1.0)
    if LEAST_EXPO <= abs(expo) <= 1.0:
        size = (1.0 - expo) * size + expo * size * size
    return size if output >= 0.0 else -size / max(mixing.asymmetry, 1.0)


def thrust(mixing: Mixing, output: float) -> float:
    """Return the thrust at an output, -1 to 1, over the full thrust ahead."""
    if math.isnan(mixing.exponent):
        return _asked(mixing, output)
    size = min(abs(output), 1.0) ** mixing.exponent
    if output >= 0.0:
        return float(size)
    share, asymmetry = mixing.astern_share, max(mixing.asymmetry, 1.0)
    astern = asymmetry**-mixing.exponent if math.isnan(share) else share
    return -astern * float(size)


def moment(mixing: Mixing, left: float, right: float) -> float:
    """Return half the difference of the thrusts of two outputs, starboard positive."""
    return 0.5 * (thrust(mixing, left) - thrust(mixing, right))


def steering_for(mixing: Mixing, share: float, throttle: float) -> float:
    """Return the steering, -1 to 1, that makes the moment `share` beside a throttle; full where none does."""
    size, side = abs(share), 1.0 if share >= 0.0 else -1.0
    low, high = 0.0, 1.0
    if moment(mixing, *mixed(mixing, 1.0, throttle)) <= size:
        return side
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        if moment(mixing, *mixed(mixing, middle, throttle)) < size:
            low = middle
        else:
            high = middle
    return side * 0.5 * (low + high)


def reach(mixing: Mixing, throttle: float) -> float:
    """Return the largest moment that full steering makes beside a throttle: the headroom that it leaves."""
    return moment(mixing, *mixed(mixing, 1.0, throttle))


THROTTLE_FLOOR = 0.05
"""Throttle [share of full] below which thrust that is turned does not steer: the scaling is held there."""


LEAST_DAMPING = 0.05
"""n1 of a boat that goes straight only just."""


BEYOND = 1.75
"""How far beyond the fastest run the law goes on: what makes a hull leave its course grows with the speed, and to stop
short of it leaves the boat swinging."""


class DriveLaw(NamedTuple):
    """p: `speed_exponent`; q: `throttle_exponent`; w: `damping_share`; n0: `throttle` of the trial, share of full, nan
    where the law knows no throttle. way_exponent: the speed through the water goes with this power of the throttle, in
    steady running. slowest, fastest: U/U0 between which it goes on. is_rudder: the scaling of
    `autopilot.models.norrbin.at_speed` stands instead."""

    speed_exponent: float = 0.0
    throttle_exponent: float = 0.0
    damping_share: float = 0.0
    throttle: float = math.nan
    way_exponent: float = 1.0
    slowest: float = 0.5
    fastest: float = 2.0
    is_rudder: bool = False


RUDDER_LAW = DriveLaw(2.0, 0.0, 1.0, is_rudder=True)


def effect_of(law: DriveLaw, ratio: float, throttle: float) -> float:
    """Return b, K/T over that of the trial, at U/U0 = `ratio` and a `throttle` [share of full, nan: the trial's]."""
    effect: float = seen_ratio(law, ratio) ** law.speed_exponent
    if law.throttle_exponent != 0.0 and law.throttle > 0.0 and not math.isnan(throttle):
        share = abs(throttle)
        share = THROTTLE_FLOOR if share < THROTTLE_FLOOR else share
        effect *= (share / law.throttle) ** law.throttle_exponent
    return effect


def seen_ratio(law: DriveLaw, ratio: float) -> float:
    """Return U/U0 held to what the trials have seen, and BEYOND: nothing tells how K and T go there."""
    most = BEYOND * law.fastest
    return law.slowest if ratio < law.slowest else most if ratio > most else ratio


def at_point(law: DriveLaw, model: Norrbin, speed: float, throttle: float) -> Norrbin:
    """Return the model at `speed` U [m/s] and `throttle` n [share of full, nan: not known, taken for the trial's].

    Its reference speed is U, or the least for which the scaling is not held. What would turn without end, because no n3
    is known to bound it, keeps a little damping.
    """
    ratio = abs(speed) / model.reference_speed
    ratio = SPEED_FLOOR_RATIO if ratio < SPEED_FLOOR_RATIO else ratio
    effect = effect_of(law, ratio, throttle)
    gain, time_constant, n3, n2, n1, n0, reference = model
    n1 = n1 * (1.0 - law.damping_share + law.damping_share * seen_ratio(law, ratio))
    if n3 <= 0.0 and n1 < LEAST_DAMPING:
        n1 = LEAST_DAMPING
    if n1 > 0.0 and n2 * n2 >= 3.0 * n3 * n1:
        n2 = 0.0
    return Norrbin(gain * effect, time_constant, n3, n2, n1, n0 * effect, reference * ratio)


def way_of(law: DriveLaw, reference_speed: float, throttle: float) -> float:
    """Return the speed through the water [m/s] that is to be expected at a `throttle` [share of full, nan: not known];
    the trial's where nothing tells."""
    if not (law.throttle > 0.0 and throttle > 0.0):
        return reference_speed
    way: float = reference_speed * (max(throttle, THROTTLE_FLOOR) / law.throttle) ** law.way_exponent
    return way


def quickness(law: DriveLaw, reference: Norrbin, model: Norrbin) -> float:
    """Return how many times as quick the loop is at the point of `model` as in the trial, `reference`."""
    if law.is_rudder:
        return model.reference_speed / reference.reference_speed
    return math.sqrt(model.gain / model.time_constant / (reference.gain / reference.time_constant))


class Needs(Enum):
    """What must be there before the boat can be steered."""

    WAY = "way through the water"
    THRUST = "thrust"
    NOTHING = "nothing: it turns where it lies"


class DriveKind(NamedTuple):
    """A kind of drive.

    name: the value of `drive.kind` in the vessel file. needs: what it steers by. usual: how K and T go with speed and
    throttle where no trial has shown it. outputs: the servo functions (SERVOn_FUNCTION) of an ArduRover that carry the
    steering, in the order in which they are read. advice: what to set where they are not there.
    """

    name: str
    needs: Needs
    usual: DriveLaw
    outputs: tuple[int, ...]
    advice: str

    @property
    def is_mixed(self) -> bool:
        """Whether the flight controller mixes steering and throttle into the same outputs."""
        return len(self.outputs) > 1


GROUND_STEERING = 26
THRUST_LAW = DriveLaw(speed_exponent=0.0, throttle_exponent=2.0, damping_share=0.0)
TURN_THE_THRUST = "set SERVOn_FUNCTION of what turns the thrust to 26"
DRIVES = {
    kind.name: kind
    for kind in (
        DriveKind("rudder", Needs.WAY, RUDDER_LAW, (GROUND_STEERING,), "set SERVOn_FUNCTION of the rudder to 26"),
        DriveKind("outboard", Needs.THRUST, THRUST_LAW, (GROUND_STEERING,), TURN_THE_THRUST),
        DriveKind("jet", Needs.THRUST, THRUST_LAW, (GROUND_STEERING,), TURN_THE_THRUST),
        DriveKind("vectored", Needs.THRUST, THRUST_LAW, (GROUND_STEERING,), TURN_THE_THRUST),
        DriveKind(
            "two_thrusters",
            Needs.NOTHING,
            DriveLaw(speed_exponent=0.0, throttle_exponent=0.0, damping_share=0.0),
            (LEFT, RIGHT),
            "set SERVOn_FUNCTION of the left thruster to 73 and of the right one to 74",
        ),
    )
}
"""Every kind there is, the usual one first; nobody else asks its name."""
if TYPE_CHECKING:
    DriveName = str
else:
    DriveName = Literal[tuple(DRIVES)]
