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
"""

from __future__ import annotations

import math
from enum import Enum
from typing import TYPE_CHECKING, Literal, NamedTuple

from autopilot.models.norrbin import SPEED_FLOOR_RATIO, Norrbin
from autopilot.models.two_thrusters import LEFT, RIGHT

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
