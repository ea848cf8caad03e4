"""All monitors together: fed with the samples of a tick, then asked what is the case."""

from __future__ import annotations

import math

from autopilot.models.norrbin import Norrbin
from autopilot.signals import (
    AlarmEvent,
    ConditionSample,
    HeadingSample,
    RateSample,
    RollSample,
    RudderSample,
    Sample,
    WindSample,
)
from autopilot.supervision.alarms import CATALOGUE, kind_of
from autopilot.supervision.monitors.answer import RudderAnswer
from autopilot.supervision.monitors.compass import FrozenHeading, JumpingHeading, RateAgainstHeading
from autopilot.supervision.monitors.course import (
    HALF_SWINGS,
    SOFTER,
    SOFTEST,
    SPEED_DOUBT,
    SUSPECT_SWINGS,
    SWEEP,
    THROW,
    Circles,
    OffCourse,
    Runaway,
    Spinning,
    Swings,
    reads_low,
    speed_ratio,
)
from autopilot.supervision.monitors.rudder import AtTheStop, Overpowered, RudderFollows, ShownOrder
from autopilot.supervision.monitors.watched import NEWS, AlarmLimits, Watched

ROLL_SECONDS = 2.0
INNOVATION_TIME = 20.0
WIND_STALE = 5.0
TRIAL_SAID = 10.0
"""That a trial does not turn the boat is said for this time [s]: it is over by then."""


class Monitors:
    """`hear` and `look` every tick; then `findings` has what is the case.

    Attributes:
        findings: the alarms by their names in the catalogue.
        softer: the law is to order as for a boat that answers so many times as much.
        doubts_speed: whether the boat's own turns contradict its speed.
        rests_roll: whether the rudder is too slow to work against roll too.
    """

    def __init__(self, limits: AlarmLimits) -> None:
        self.limits = limits
        self._frozen, self._jumping, self._against_rate = FrozenHeading(), JumpingHeading(), RateAgainstHeading()
        self._follows, self._answer = RudderFollows(), RudderAnswer()
        self._stop, self._overpowered = AtTheStop(), Overpowered()
        self._shown = ShownOrder()
        self._course, self._runaway = OffCourse(), Runaway()
        self._swings, self._throws = Swings(SWEEP), Swings(THROW)
        self._circles, self._spinning = Circles(), Spinning()
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        self.forget_past()
        self.softer, self._hunts, self.doubts_speed, self._other = 1.0, False, False, ""
        self.rests_roll = False
        self.findings: dict[str, AlarmEvent] = {}
        self._conditions: dict[tuple[str, str], AlarmEvent] = {}
        self._roll_since: float | None = None
        self._roll, self._told_roll = "", math.nan
        self._wind_time = -math.inf

    def forget_past(self) -> None:
        """Forget what was compared so far: nothing that came before a standstill says anything about now."""
        for monitor in (
            self._frozen,
            self._jumping,
            self._against_rate,
            self._follows,
            self._answer,
            self._shown,
            self._stop,
            self._overpowered,
            self._course,
            self._runaway,
            self._swings,
            self._throws,
            self._circles,
            self._spinning,
        ):
            monitor.reset()
        self._surprised_since: float | None = None
        self._surprise = ""
        self._trial_doubted = math.nan

    @property
    def trouble(self) -> AlarmEvent | None:
        """Return what is a reason to leave off steering, None where nothing is."""
        return next((event for event in self.findings.values() if kind_of(event).ends_steering), None)

    def alarms(self) -> tuple[AlarmEvent, ...]:
        """Return what is to be said though steering goes on."""
        return tuple(event for event in self.findings.values() if not kind_of(event).ends_steering)

    @property
    def doubts_rate(self) -> bool:
        """Return whether the rate of turn and the heading do not go together: the heading is what is steered by."""
        return bool(self._against_rate.found)

    @property
    def rate_is_reversed(self) -> bool:
        """Return whether the rate tells of turns to the other side than the heading."""
        return self._against_rate.is_opposite

    def hear(self, samples: tuple[Sample, ...]) -> None:
        """Take the instruments' samples of this tick."""
        limits = self.limits
        for sample in samples:
            if isinstance(sample, HeadingSample):
                if limits.frozen_heading:
                    self._frozen.hear(sample)
                self._answer.hear(sample)
                self._jumping.hear(sample, limits.heading_jump)
                self._against_rate.hear(sample, limits.rate_disagrees)
            elif isinstance(sample, RateSample):
                self._against_rate.hear(sample, limits.rate_disagrees)
            elif isinstance(sample, RudderSample):
                if sample.ordered:
                    self._shown.hear(sample)
                else:
                    self._follows.hear(sample)
            elif isinstance(sample, RollSample):
                self._hear_roll(sample)
            elif isinstance(sample, WindSample):
                self._wind_time = sample.time
            elif isinstance(sample, ConditionSample):
                self._hear_condition(sample)

    def look(self, model: Norrbin, watched: Watched) -> None:
        """Judge a tick; `model` at the present speed."""
        found = {name: event for (name, _), event in self._conditions.items()}
        self._look_at_heading(model, watched, found)
        self._look_at_rudder(model, watched, found)
        self._look_at_model(model, watched, found)
        self._look_at_swings(model, watched, found)
        self._course.look(self.limits, watched)
        if self._course.found is not None:
            found["off_course"] = self._course.found
        if watched.waits:
            found["low_speed"] = AlarmEvent("low_speed")
        if self._roll:
            found["roll"] = AlarmEvent("roll", self._roll)
        if self.limits.wind_wanted and watched.now - self._wind_time > WIND_STALE:
            found["no_wind"] = AlarmEvent("no_wind")
        self.findings = found

    def _look_at_heading(self, model: Norrbin, watched: Watched, found: dict[str, AlarmEvent]) -> None:
        if self.limits.frozen_heading and self._frozen.is_frozen(model, watched):
            found["heading_frozen"] = AlarmEvent("heading_frozen")
        jumped = self._jumping.found(watched)
        if jumped:
            found["heading_jumping"] = AlarmEvent("heading_jumping", jumped)
        if self._against_rate.found:
            found["rate_disagrees"] = AlarmEvent("rate_disagrees", self._against_rate.found)
        if not (watched.has_way and abs(watched.surprise) > self.limits.innovation):
            self._surprised_since, self._surprise = None, ""
        elif self._surprised_since is None:
            self._surprised_since = watched.now
        elif watched.now - self._surprised_since >= INNOVATION_TIME:
            # as it is at first: each tenth would be a new text
            self._surprise = self._surprise or f"{abs(watched.surprise):.1f} standard deviations"
            found["innovation"] = AlarmEvent("innovation", self._surprise)

    def _look_at_rudder(self, model: Norrbin, watched: Watched, found: dict[str, AlarmEvent]) -> None:
        self._follows.look(watched, self.limits)
        name, shown = self._follows.found
        if name:
            found[name] = AlarmEvent(name, shown)
        if watched.steers and self._shown.is_anothers(watched.now, watched.rudder):
            # a boat that follows somebody else proves nothing; the link finds out who has the helm
            self._answer.reset()
            self._overpowered.reset()
        elif self.limits.rudder_answer and not found.get(name):
            name, shown = self._answer.look(model, watched, self.limits.heading_noise, self.limits.rudder_rate)
            if self._is_for_the_speed(model, watched, name):
                name = ""
            if name:
                found[name] = AlarmEvent(name, shown)
            self._overpowered.look(watched)
            if self._overpowered.found:
                found["overpowered"] = AlarmEvent("overpowered", self._overpowered.found)
            if self._answer.doubts_trial:
                self._trial_doubted = watched.now
        if watched.steers and watched.now - self._trial_doubted < TRIAL_SAID:
            found["trial_doubtful"] = AlarmEvent("trial_doubtful")
        self._runaway.look(model, watched)
        if self._runaway.has_run:
            found["runaway"] = AlarmEvent("runaway")
        if self._runaway.overpowered:
            found["overpowered"] = AlarmEvent("overpowered", self._runaway.overpowered)
        if self._stop.is_there(watched):
            found["rudder_at_stop"] = AlarmEvent("rudder_at_stop")

    def _is_for_the_speed(self, model: Norrbin, watched: Watched, name: str) -> bool:
        """Return whether the answer to the rudder is one that a wrong speed explains: it is doubted then."""
        ratio = speed_ratio(model, watched)
        too_low = self._answer.other in ("quick", "lively") and reads_low(model, watched)
        if not (too_low or (name == "rudder_stuck" and ratio > SPEED_DOUBT)):
            return False
        self._doubt_speed()
        return True

    def _look_at_model(self, model: Norrbin, watched: Watched, found: dict[str, AlarmEvent]) -> None:
        """What the answer to the rudder tells of speed, boat and rudder; what was found counts until we let go."""
        if not watched.steers:
            self.doubts_speed, self.rests_roll, self._other = False, False, ""
        seen = {self._answer.other, self._other, "slow" if self._follows.is_slow else ""}
        self._other = next((other for other in ("quick", "slow", "lively") if other in seen), "")
        if self._other == "quick":
            found["too_quick"] = AlarmEvent("too_quick")
        elif self._other == "slow" and model.n1 <= 0.0:
            # no gain is soft enough for a boat that turns away quicker than its rudder comes
            found["rudder_not_following"] = AlarmEvent("rudder_not_following", "much slower than its file says")
        elif self._other == "slow" and (self.rests_roll or watched.damps_roll):
            # the quick orders are those against roll; a course alone may well be held with this rudder as it is
            self.rests_roll = True
            found["rudder_slow"] = AlarmEvent("rudder_slow")
        elif self._other:
            self.softer = max(self.softer, SOFTER)
            name = "lively" if self._other == "lively" else "rudder_slow"
            found[name] = AlarmEvent(name)
        if self.doubts_speed:
            found["speed_doubtful"] = AlarmEvent("speed_doubtful")

    def _look_at_swings(self, model: Norrbin, watched: Watched, found: dict[str, AlarmEvent]) -> None:
        """What steering itself does to the boat: a soft law is tried first, then steering ends."""
        if not watched.steers:
            self.softer, self._hunts = 1.0, False
        swings, throws = self._swings.look(model, watched), self._throws.look(model, watched)
        fast = self._spinning.too_fast(model, watched)
        if not fast and self.softer >= SOFTEST and self._spinning.rushes:
            # no law is softer, and to try it once more would begin the count of everything anew
            fast = self._spinning.rate
        is_soft = self.softer > 1.0 or model.n1 <= 0.0
        if (is_soft and throws >= HALF_SWINGS) or (self.softer >= SOFTEST and swings >= SUSPECT_SWINGS):
            found["swinging"] = AlarmEvent("swinging")
        elif max(swings, throws) >= SUSPECT_SWINGS or (watched.follows and self._spinning.rushes):
            self._steer_softer(model, watched)
        elif self._spinning.outruns_speed and reads_low(model, watched):
            self._doubt_speed()
        if self._hunts and not self._other:
            found["hunting"] = AlarmEvent("hunting")
        if fast:
            turning = f"turning at {math.degrees(abs(fast)):.0f} deg/s"
            found["too_quick"] = AlarmEvent("too_quick", turning)
        if self._circles.goes_round(model, watched, is_doubted=self.doubts_speed):
            found["circling"] = AlarmEvent("circling")
        if watched.speeds_apart > 0.0:
            found["speeds_disagree"] = AlarmEvent("speeds_disagree")

    def _steer_softer(self, model: Norrbin, watched: Watched) -> None:
        """A speed that is too low is the likeliest cause of swings, the trial's speed the worst that is plausible; then
        less is ordered. A course-unstable boat would be lost with less than it needs against its own wish to turn."""
        if reads_low(model, watched):
            self._doubt_speed()
        elif model.n1 > 0.0:
            self._hunts, self.softer = True, min(SOFTER * self.softer, SOFTEST)
        else:
            self._hunts = True
            return
        self._swings.reset()
        self._throws.reset()
        self._spinning.reset()

    def _doubt_speed(self) -> None:
        # the model is the trial's from the next tick on: what was seen is weighed anew by that
        self.doubts_speed = True
        self._answer.reset()

    def _hear_condition(self, sample: ConditionSample) -> None:
        key = (sample.name, sample.source)
        if sample.present and sample.name in CATALOGUE:
            self._conditions[key] = AlarmEvent(sample.name, sample.detail)
        else:
            self._conditions.pop(key, None)

    def _hear_roll(self, sample: RollSample) -> None:
        if abs(sample.roll) <= self.limits.roll:
            self._roll_since, self._roll = None, ""
        elif self._roll_since is None:
            self._roll_since = sample.time
        elif sample.time - self._roll_since >= ROLL_SECONDS:
            heel = abs(sample.roll)
            if not self._roll or heel - self._told_roll > NEWS:
                self._roll = f"{math.degrees(heel):.0f} deg"
                self._told_roll = heel
