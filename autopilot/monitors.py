"""What is watched while we steer: a compass that froze, a boat off its course or running away, too much heel.

A monitor never moves the rudder. It raises an alarm, and steering goes on, or it names a trouble, and the supervisor
goes into the fail-safe that the vessel file asks for. Pure: memory is a few numbers, `reset` forgets them.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from autopilot.alarms import CATALOGUE, Response, text_of
from autopilot.angles import shortest_turn
from autopilot.models.norrbin import Norrbin, rate_step, steady_rudder
from autopilot.models.steering_gear import clip
from autopilot.signals import ConditionSample, HeadingSample, NavState, RollSample, Sample

LONGEST_STEP_S = 0.5
FROZEN_SAMPLES = 10
"""So many headings that are the same to the last digit are worth a second look."""
FROZEN_BY_RATE = math.radians(5.0)
FROZEN_BY_RUDDER = math.radians(15.0)
"""The rate that an instrument measured, or that the rudder must have made, adds up to this while the heading stood."""
STEERAGE_SHARE = 0.2
"""Below this share of the reference speed there is no way for the rudder to count on."""
BACK_ON_COURSE = 0.7
"""An off-course alarm ends when the error is back within this share of its limit."""
AT_THE_STOP = 0.9
AGAINST_SHARE = 0.8
"""A boat that turns against a rudder hard over, as a rudder of this share to the other side would turn it."""
SETTLED = 3.0
"""Time constants after which what the rudder did before is forgotten."""
ROLL_SECONDS = 2.0

FROZEN = text_of("heading_frozen")
RUNAWAY = text_of("runaway")


class AlarmLimits(NamedTuple):
    """off_course [rad] for off_course_time [s]; roll [rad]; inf: not watched. frozen_heading: watched or not."""

    off_course: float = math.inf
    off_course_time: float = 10.0
    roll: float = math.inf
    frozen_heading: bool = True


class Watched(NamedTuple):
    """What the monitors look at in a tick: whether we move the rudder; whether a course is being held, turns to it
    being over; the heading ordered [rad], the rudder that was told [rad] and its end stop [rad]; and whether there is
    way enough for the rudder to count."""

    now: float
    state: NavState
    steers: bool
    holds_course: bool
    wanted: float
    rudder: float
    angle_max: float
    has_way: bool


class Monitors:
    """All of them. `look` every tick; then `trouble` is a reason to leave off steering, and `alarms` are to be said."""

    def __init__(self, limits: AlarmLimits) -> None:
        self.limits = limits
        self._frozen = FrozenHeading()
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        self._frozen.reset()
        self.findings: dict[str, str] = {}
        """What is the case now: the texts by the names of the catalogue of alarms."""
        self._conditions: dict[tuple[str, str], str] = {}
        self._off_since: float | None = None
        self._off = ""
        self._against_since: float | None = None
        self._roll_since: float | None = None
        self._roll = ""

    @property
    def trouble(self) -> str:
        """Return the text of what is a reason to leave off steering, "" where nothing is."""
        return next((text for name, text in self.findings.items() if _ends_steering(name)), "")

    def alarms(self) -> tuple[str, ...]:
        """Return what is to be said now though steering goes on."""
        return tuple(text for name, text in self.findings.items() if not _ends_steering(name))

    def hear(self, samples: tuple[Sample, ...]) -> None:
        """Take the instruments' samples of this tick."""
        for sample in samples:
            if isinstance(sample, HeadingSample) and self.limits.frozen_heading:
                self._frozen.hear(sample)
            elif isinstance(sample, RollSample):
                self._hear_roll(sample)
            elif isinstance(sample, ConditionSample):
                self._hear_condition(sample)

    def look(self, model: Norrbin, watched: Watched) -> None:
        """Judge a tick; `model` at the present speed."""
        found = {name: text for (name, _), text in self._conditions.items()}
        if self.limits.frozen_heading and self._frozen.is_frozen(model, watched):
            found["heading_frozen"] = FROZEN
        self._look_at_course(watched)
        if self._runs_away(model, watched):
            found["runaway"] = RUNAWAY
        if self._off:
            found["off_course"] = self._off
        if self._roll:
            found["roll"] = self._roll
        self.findings = found

    def _hear_condition(self, sample: ConditionSample) -> None:
        key = (sample.name, sample.source)
        if sample.present and sample.name in CATALOGUE:
            self._conditions[key] = text_of(sample.name, sample.detail)
        else:
            self._conditions.pop(key, None)

    def _hear_roll(self, sample: RollSample) -> None:
        if abs(sample.roll) <= self.limits.roll:
            self._roll_since, self._roll = None, ""
        elif self._roll_since is None:
            self._roll_since = sample.time
        elif sample.time - self._roll_since >= ROLL_SECONDS:
            heel = math.degrees(abs(sample.roll))
            self._roll = f"heeling {heel:.0f} deg: ease sheets, slow down, or change course"

    def _look_at_course(self, watched: Watched) -> None:
        if not watched.holds_course or math.isinf(self.limits.off_course):
            self._off_since, self._off = None, ""
            return
        error = shortest_turn(watched.wanted, watched.state.heading)
        limit = self.limits.off_course * (BACK_ON_COURSE if self._off else 1.0)
        if abs(error) <= limit:
            self._off_since, self._off = None, ""
        elif self._off_since is None:
            self._off_since = watched.now
        elif watched.now - self._off_since >= self.limits.off_course_time:
            self._off = self._off_course_text(error, watched)

    def _off_course_text(self, error: float, watched: Watched) -> str:
        off = f"off course by {math.degrees(abs(error)):.0f} deg to {'starboard' if error > 0.0 else 'port'}"
        if _is_hard_over(watched):
            return f"{off}, the rudder at its stop: more way or less sail, check that the rudder moves"
        return f"{off}: check rudder, speed and wind, or order another course"

    def _runs_away(self, model: Norrbin, watched: Watched) -> bool:
        """Rudder hard over, and the boat turns to the other side nearly as it would for a rudder hard over there.

        A gust heavier than the rudder turns it more slowly, or not for long: that is fought, not given up.
        """
        if not _is_hard_over(watched) or not _turns_against(model, watched):
            self._against_since = None
            return False
        if self._against_since is None:
            self._against_since = watched.now
        return watched.now - self._against_since >= self.limits.off_course_time + SETTLED * model.time_constant


def _ends_steering(name: str) -> bool:
    return CATALOGUE[name].response in (Response.FAILSAFE, Response.LET_GO, Response.FAULT)


def _is_hard_over(watched: Watched) -> bool:
    return abs(watched.rudder) >= AT_THE_STOP * watched.angle_max


def _turns_against(model: Norrbin, watched: Watched) -> bool:
    answers_to = steady_rudder(model, watched.state.rate)
    return answers_to * watched.rudder < 0.0 and abs(answers_to) >= AGAINST_SHARE * abs(watched.rudder)


class FrozenHeading:
    """A heading that stays the very same number while the boat must be turning.

    Judged by the yaw rate that came with it where there is one, else by the turn that the model makes of the rudder,
    the bias being what it was when the heading began to stand: the estimator has learnt the wrong one since.
    """

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        self._heading = math.nan
        self._proven = False
        self._same = 0
        self._time = math.nan
        self._measured: float | None = None
        self._now = math.nan
        self._bias = 0.0
        self._rate = 0.0
        self._turned = 0.0

    def hear(self, sample: HeadingSample) -> None:
        """Take a heading as it was measured."""
        if sample.heading != self._heading:
            self.reset()
            self._heading = sample.heading
        elif sample.rate is not None and math.isfinite(self._time):
            step = clip(sample.time - self._time, 0.0, LONGEST_STEP_S)
            self._measured = (self._measured or 0.0) + sample.rate * step
        self._same += 1
        self._time = sample.time

    def is_frozen(self, model: Norrbin, watched: Watched) -> bool:
        """Return whether the heading has stood still while the boat turned; once it has, until it moves again."""
        self._proven = self._proven or self._is_proven(model, watched)
        return self._proven

    def _is_proven(self, model: Norrbin, watched: Watched) -> bool:
        if self._same < 2 or not math.isfinite(self._now) or not (watched.steers or self._measured is not None):
            # what somebody else does with the rudder proves nothing
            self._begin(watched)
            return False
        step = clip(watched.now - self._now, 0.0, LONGEST_STEP_S)
        self._now = watched.now
        self._rate = rate_step(model, self._rate, watched.state.rudder + self._bias, step)
        self._turned += self._rate * step
        if self._same < FROZEN_SAMPLES:
            return False
        if self._measured is not None:
            return abs(self._measured) > FROZEN_BY_RATE
        return watched.has_way and abs(self._turned) > FROZEN_BY_RUDDER

    def _begin(self, watched: Watched) -> None:
        self._now, self._bias = watched.now, watched.state.bias
        self._rate, self._turned = watched.state.rate, 0.0
