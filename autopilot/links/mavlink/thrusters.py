"""What SERVO_OUTPUT_RAW shows of the thrust: the two outputs of a skid-steered frame, or the one throttle. Pure.

The firmware mixes steering and throttle (`autopilot.models.two_thrusters`), and the throttle is not ours. From
the two outputs both are worked out again: steering that was taken as it was asked for shows as it was sent. Where an
output is at its limit less of it was taken: then it must be of the same sign, and no more than was asked for.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

from autopilot.links.mavlink.codec import Message
from autopilot.links.mavlink.requests import SERVO_SUFFIXES, VehicleParameters
from autopilot.links.mavlink.steering import SteeringChannel, SteeringOutput, share_from_servo
from autopilot.models.two_thrusters import moment, reach, unmixed

STEERING_TOLERANCE = 0.02
"""Of full steering: pulses are whole microseconds, and each output is rounded by itself."""


class Shown(NamedTuple):
    """What the outputs show: steering and throttle as shares of full, whether less was taken than was asked for, and
    the moment that the thrust makes, a share of full."""

    steering: float
    throttle: float
    is_limited: bool
    moment: float


def output_channel(parameters: VehicleParameters, number: int) -> SteeringChannel | None:
    """Return the end points of an output; None while they are not known, or are none."""
    found = [parameters.get(f"SERVO{number}_{suffix}") for suffix in SERVO_SUFFIXES]
    values = [round(value) for value in found if value is not None]
    if len(values) < len(SERVO_SUFFIXES) or not values[0] < values[1] < values[2]:
        return None
    low, trim, high, is_reversed = values
    return SteeringChannel(servo_min=low, servo_trim=trim, servo_max=high, servo_reversed=bool(is_reversed))


def share_of_output(parameters: VehicleParameters, number: int, message: Message) -> float | None:
    """Return what an output is at, -1 to 1; None without pulses or end points."""
    channel, pulse = output_channel(parameters, number), getattr(message, f"servo{number}_raw")
    return share_from_servo(channel, pulse) if channel is not None and pulse else None


def shown_by(parameters: VehicleParameters, output: SteeringOutput, message: Message) -> Shown | None:
    """Return what the two outputs of a skid-steered frame show; None while one of them is not known."""
    shares = [share_of_output(parameters, number, message) for number in parameters.steering_servos]
    found = [share for share in shares if share is not None]
    if len(found) != 2:
        return None
    left, right = found
    return Shown(*unmixed(output.mixing, left, right), moment(output.mixing, left, right))


def asked_throttle(shown: Shown, asked: Iterable[float]) -> float:
    """Return the throttle, -1 to 1, that a hand asks for: where the mixer has taken less of both, the steering that was
    `asked`, the newest last, tells how much less."""
    if not shown.is_limited or abs(shown.steering) < STEERING_TOLERANCE:
        return min(max(shown.throttle, -1.0), 1.0)
    sizes = [abs(each) for each in asked if each * shown.steering > 0.0]
    more = max(sizes[-1] / abs(shown.steering), 1.0) if sizes else 1.0
    return min(max(shown.throttle * more, -1.0), 1.0)


def is_taken(shown: Shown, asked: Iterable[float]) -> bool:
    """Return whether the outputs show one of the steerings that were `asked` for."""
    for each in asked:
        if abs(shown.steering - each) <= STEERING_TOLERANCE:
            return True
        less = abs(shown.steering) <= abs(each) + STEERING_TOLERANCE
        if shown.is_limited and less and shown.steering * each > -STEERING_TOLERANCE * abs(each):
            return True
    return False


def reach_of(output: SteeringOutput, throttle: float) -> float:
    """Return the largest rudder [rad] that the difference of the thrusts is worth beside a throttle."""
    return reach(output.mixing, throttle) / abs(output.share_per_radian)
