"""Two thrusters side by side, as ArduRover mixes them for a skid-steered frame (SERVOn_FUNCTION 73 and 74).

The steering stick s and the throttle t, both -1 to 1, are first held to |s| + |t| <= 1. With A = MOT_THST_ASYM and the
lowest output L = -1/A, steering may take (1 - L)/2 at most, where the throttle is (1 + L)/2; what still does not fit
is shared by MOT_STR_THR_MIX. Then left = t + s, right = t - s, what is negative times A, and

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
from typing import NamedTuple

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
