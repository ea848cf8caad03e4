"""What a run is judged by, summed up tick by tick; the same function scores compiled and full runs."""

from __future__ import annotations

import math
from typing import NamedTuple

from autopilot.angles import wrap

SETTLED = math.radians(1.0)
"""A turn is over when the true heading stays within this [rad] of the one ordered."""


class Course(NamedTuple):
    """What is ordered: heading [rad] at first, and `turn` [rad] on top of it from `turn_at` [s] on. Ticks before
    `measured_from` [s] do not count."""

    heading: float
    turn: float
    turn_at: float
    measured_from: float


class Score(NamedTuple):
    """Sums over the ticks that count; overshoot [rad] beyond the new heading, settled [s] after the turn's order."""

    ticks: int = 0
    error: float = 0.0
    error_square: float = 0.0
    error_most: float = 0.0
    travel: float = 0.0
    rudder_square: float = 0.0
    speed: float = 0.0
    overshoot: float = 0.0
    settled: float = 0.0


NOTHING = Score()


def ordered(course: Course, now: float) -> float:
    """Return the heading [rad] ordered at `now` [s]."""
    return wrap(course.heading + course.turn) if now >= course.turn_at else course.heading


def scored(
    score: Score, course: Course, now: float, heading: float, speed: float, told_before: float, told: float
) -> Score:
    """Return the score after a tick at `now` [s]: true `heading` [rad] and `speed` [m/s], rudder orders [rad]."""
    error = wrap(heading - ordered(course, now))
    overshoot, settled = score.overshoot, score.settled
    if course.turn != 0.0 and now >= course.turn_at:
        beyond = error if course.turn > 0.0 else -error
        # what lies half a circle off is on its way, not beyond
        overshoot = max(overshoot, beyond) if beyond < 0.5 * math.pi else overshoot
        settled = now - course.turn_at if abs(error) > SETTLED else settled
    if now < course.measured_from:
        return Score(
            score.ticks,
            score.error,
            score.error_square,
            score.error_most,
            score.travel,
            score.rudder_square,
            score.speed,
            overshoot,
            settled,
        )
    return Score(
        score.ticks + 1,
        score.error + error,
        score.error_square + error * error,
        max(score.error_most, abs(error)),
        score.travel + abs(told - told_before),
        score.rudder_square + told * told,
        score.speed + speed,
        overshoot,
        settled,
    )


class Figures(NamedTuple):
    """A run in numbers: heading error's rms, mean and most [deg], rudder travel [deg/s] and rms [deg], mean speed
    [m/s]; of a turn the overshoot [deg] and the time until it was over [s]; the share of ticks engaged."""

    heading_rms_deg: float
    heading_mean_deg: float
    heading_most_deg: float
    travel_deg_s: float
    rudder_rms_deg: float
    speed_m_s: float
    overshoot_deg: float
    settled_s: float
    engaged: float


def figures(score: Score, tick_s: float, engaged: float) -> Figures:
    """Return the figures of a score with a tick every `tick_s` [s], engaged for this share of them."""
    count = max(score.ticks, 1)
    return Figures(
        math.degrees(math.sqrt(score.error_square / count)),
        math.degrees(score.error / count),
        math.degrees(score.error_most),
        math.degrees(score.travel / (count * tick_s)),
        math.degrees(math.sqrt(score.rudder_square / count)),
        score.speed / count,
        math.degrees(score.overshoot),
        score.settled,
        engaged,
    )
