"""The monitors' steps with the value that they go on from, for tests that show them one tick after the other; and the
filter of the rudder watch once more, by matrices, for tests that reckon its evidence again."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from autopilot.angles import shortest_turn
from autopilot.models.norrbin import Norrbin
from autopilot.signals import AlarmEvent, HeadingSample, RateSample, RudderSample, Sample
from autopilot.supervision import (
    compass_watch,
    course_watch,
    heading_and_rate,
    rudder_answer,
    rudder_watch,
)
from autopilot.supervision.alarms import Response, kind_of
from autopilot.supervision.monitor_input import AlarmLimits, History, Measured, MonitorInput
from autopilot.supervision.monitors import NOTHING_SEEN, State, judged, on_samples, without_past
from autopilot.supervision.panel import sentences_of
from autopilot.supervision.response_filter import Noise, transition_of
from autopilot.supervision.supervisor import Supervisor


class Stepped:
    """A step and its value."""

    def __init__(self, step: Callable[..., Any], value: Any) -> None:
        self.step, self.value = step, value

    def update(self, *given: Any) -> Any:
        """Go on to the next value, and return it."""
        self.value = self.step(self.value, *given)
        return self.value

    def __getattr__(self, name: str) -> Any:
        return getattr(self.value, name)


def overpowered() -> Stepped:
    """Return the monitor of a push that is heavier than the rudder."""
    return Stepped(rudder_watch.overpowered_step, rudder_watch.NOT_OVERPOWERED)


def runaway() -> Stepped:
    """Return the monitor of a boat that turns against its rudder."""
    return Stepped(rudder_watch.runaway_step, rudder_watch.NO_RUNAWAY)


def off_course(limits: AlarmLimits, side: float = 1.0) -> Stepped:
    """Return the off-course alarm; side: to which the boat turned."""
    step, wanted = course_watch.off_course_step, math.nan

    def judged(before: course_watch.OffCourse, seen: MonitorInput) -> course_watch.OffCourse:
        nonlocal wanted
        is_new, wanted = seen.wanted != wanted, seen.wanted
        return step(limits, before, seen, (shortest_turn(seen.wanted, seen.state.heading), is_new), side)

    return Stepped(judged, course_watch.ON_ITS_COURSE)


def consistency(most: float) -> Stepped:
    """Return the monitor of rate and heading, which may be `most` [rad] apart."""
    step = heading_and_rate.consistency_step
    return Stepped(lambda before, sample: step(before, sample, most), heading_and_rate.Consistency())


class RudderHistory:
    """The rudder's rings, as the estimator would have written them."""

    def __init__(self) -> None:
        self.times, self.angles, self.commands, self.ticks = [0.0] * 1024, [0.0] * 1024, [math.nan] * 1024, 0

    def until(self, seen: MonitorInput) -> History:
        """Return the history with a tick more."""
        place, self.ticks = self.ticks % 1024, self.ticks + 1
        self.times[place], self.angles[place] = seen.now, seen.state.rudder
        self.commands[place] = seen.rudder if seen.steers else math.nan
        return self.times, self.angles, self.commands, self.ticks


class Following(Stepped):
    """The monitor of a measured rudder: angles are heard, then a tick is seen."""

    def __init__(self, limits: AlarmLimits) -> None:
        super().__init__(self._seen, rudder_watch.State())
        self.limits, self.angles = limits._replace(rudder_response=False), list[RudderSample]()
        self.history = RudderHistory()

    def on_sample(self, sample: RudderSample) -> None:
        """Take an angle."""
        self.angles.append(sample)

    def _seen(self, before: rudder_watch.State, seen: MonitorInput) -> rudder_watch.State:
        angles, self.angles = tuple(self.angles), []
        return rudder_watch.update(self.limits, before, seen, Measured(angles=angles), self.history.until(seen))[0]

    @property
    def found(self) -> str:
        """The alarm's name, '' for none."""
        return str(self.value.following.name)

    @property
    def is_slow(self) -> bool:
        """Whether it goes to its orders, and much slower than filed."""
        return bool(self.value.following.is_slow)


class Answering(Stepped):
    """The rudder-response monitor: headings are heard, then a tick is seen."""

    def __init__(self, noise: float, rudder_rate: float = math.inf) -> None:
        super().__init__(self._seen, rudder_answer.UNJUDGED)
        self.limits = AlarmLimits(heading_noise=noise, rudder_rate=rudder_rate)
        self.headings, self.history = list[HeadingSample](), RudderHistory()

    def on_sample(self, sample: HeadingSample) -> None:
        """Take a heading."""
        self.headings.append(sample)

    def _seen(self, before: rudder_answer.Response, seen: MonitorInput) -> rudder_answer.Response:
        headings, self.headings = tuple(self.headings), []
        return rudder_answer.judge_response(before, self.limits, seen, headings, self.history.until(seen))

    def found(self, seen: MonitorInput) -> str:
        """Return the alarm's name after a tick, '' for none."""
        verdict = self.update(seen).verdict
        return rudder_watch.VERDICTS[verdict].name if verdict else ""


class Frozen(Stepped):
    """The monitor of a heading that stands still."""

    def __init__(self) -> None:
        super().__init__(self._seen, (compass_watch.Standing(), compass_watch.Sea()))
        self.headings = list[HeadingSample]()

    def on_sample(self, sample: HeadingSample) -> None:
        """Take a heading."""
        self.headings.append(sample)

    def _seen(self, before: Any, seen: MonitorInput) -> Any:
        headings, self.headings = tuple(self.headings), []
        return compass_watch.frozen_step(*before, seen, headings)

    def is_frozen(self, seen: MonitorInput) -> bool:
        """Return whether it stands still."""
        return bool(self.update(seen)[0].is_frozen)


class Jumping(Stepped):
    """The monitor of a heading that may jump by `most` [rad]."""

    def __init__(self, most: float) -> None:
        super().__init__(self._seen, compass_watch.State())
        self.limits, self.headings = AlarmLimits(heading_jump=most), list[HeadingSample]()

    def on_sample(self, sample: HeadingSample) -> None:
        """Take a heading."""
        self.headings.append(sample)

    def _seen(self, before: Any, seen: MonitorInput) -> Any:
        headings, self.headings = tuple(self.headings), []
        return compass_watch.update(self.limits, before, seen, Measured(headings))[0]

    def found(self, seen: MonitorInput) -> str:
        """Return how far it jumped, where it has of late; empty where not."""
        return str(self.update(seen).jumping.text)


class Turning(Stepped):
    """A step of the course watch, which knows what the boat has done since the tick before."""

    def __init__(self, step: Callable[..., Any], value: Any) -> None:
        super().__init__(step, value)
        self.last: MonitorInput | None = None
        self.given: list[tuple[float, float]] = []

    def update(self, seen: MonitorInput) -> Any:
        """Go on to the next value, and return it."""
        last, self.last = self.last, seen
        before = (math.nan,) * 3 if last is None else (last.now, last.state.heading, last.wanted)
        self.given.append((before[0], seen.rudder))
        given = tuple(
            next((order for then, order in reversed(self.given) if then <= before[0] - later + 1e-9), seen.rudder)
            for later in course_watch.LATER
        )
        turn = course_watch.turn_since(before, seen, course_watch.quickest_model(seen), given)
        self.value = self.step(self.value, seen, turn)
        return self.value


def swings(sweep: float) -> Turning:
    """Return the count of sweeps of at least so many of the rudder's limits."""
    step = course_watch.swings_step
    return Turning(lambda before, seen, turn: step(before, sweep, seen, turn), course_watch.NO_SWINGS)


def circles() -> Turning:
    """Return the sum of turns away from the heading ordered."""
    return Turning(course_watch.circles_step, course_watch.NO_CIRCLES)


def spin() -> Turning:
    """Return the monitor of a rate of turn."""
    return Turning(course_watch.spin_step, course_watch.Spin())


class Monitors:
    """All monitors with the state that they go on from; `findings` has what is the case."""

    def __init__(self, limits: AlarmLimits, state: State = NOTHING_SEEN) -> None:
        self.limits, self.state = limits, state
        self.findings: Mapping[str, AlarmEvent] = {}
        self.history = RudderHistory()

    def forget_past(self) -> None:
        """Forget what was compared so far."""
        self.state = without_past(self.state)

    def on_samples(self, samples: tuple[Sample, ...]) -> None:
        """Take the instruments' samples of a tick."""
        self.state = on_samples(self.limits, self.state, samples)

    def update(self, seen: MonitorInput) -> None:
        """Judge a tick."""
        self.state, self.findings = judged(self.limits, self.state, seen, self.history.until(seen))


def heard_by(monitors: Monitors, seen: MonitorInput, *samples: HeadingSample | RateSample | RudderSample) -> None:
    """Let the monitors take samples and a tick."""
    monitors.on_samples(samples)
    monitors.update(seen)


ENDS_STEERING = (Response.FAULT, Response.LET_GO, Response.FAILSAFE)


def said_by(supervisor: Supervisor) -> tuple[AlarmEvent, ...]:
    """Return what the skipper must hear of a supervisor now."""
    ended, notes = supervisor.memory.alarm, tuple(supervisor.memory.notes.values())
    return (ended, *notes) if ended is not None else notes


def trouble(monitors: Monitors) -> AlarmEvent | None:
    """Return what ends steering, None where nothing does."""
    return next((event for event in monitors.findings.values() if kind_of(event).response in ENDS_STEERING), None)


def alarms(monitors: Monitors) -> tuple[AlarmEvent, ...]:
    """Return what is said though steering goes on."""
    return tuple(event for event in monitors.findings.values() if kind_of(event).response not in ENDS_STEERING)


def said(monitors: Monitors) -> tuple[str, ...]:
    """Return the sentences of that."""
    return sentences_of(alarms(monitors))


BOAT = Norrbin(0.3, 4.0, n3=1.0)
NOISE = Noise(heading=1.0e-4, acceleration=1.0e-5, push=1.0e-4, sea=1.0e-3, pace=0.6, unmet=0.0)
DT = 0.2


class MatrixFilter:
    """A boat without a rudder, BOAT every DT in a sea of so much variance [rad^2] and of that pace, and what it would
    not see of each rudder's answer. odd: squares that nothing explains."""

    def __init__(self, heading: float, sea: float, pace: float, rudders: Sequence[str]) -> None:
        self.p = np.diag([NOISE.heading, 0.2**2, math.radians(20.0) ** 2, sea])
        self.x = np.array([heading, 0.0, 0.0, 0.0])
        self.answers = {name: np.zeros(4) for name in rudders}
        self.odd = 1.0
        self._sea, self._pace = sea, pace

    def predict(self, heading: float, rate: float, rudders: Mapping[str, float]) -> tuple[float, float]:
        """Go on to the next heading, and return its innovation and the standard deviation of that [rad]."""
        turn, drift, decay, gain, kept = transition_of(BOAT, rate, self._pace, DT)
        f = np.eye(4)
        f[0, 1:] = turn, drift, drift
        f[1, 1:] = decay, gain, gain
        f[3, 3] = kept
        q = np.zeros((4, 4))
        q[:2, :2] = NOISE.acceleration * np.array([[DT**3 / 3, DT**2 / 2], [DT**2 / 2, DT]])
        q[2, 2] = (NOISE.push + (math.radians(25.0) ** 2 if self.odd > 3.0 else 0.0)) * DT
        q[3, 3] = (1.0 - kept**2) * self._sea
        self.p, self.x = f @ self.p @ f.T + q, f @ self.x
        for name, rudder in rudders.items():
            self.answers[name] = f @ self.answers[name] + np.array([drift, gain, 0.0, 0.0]) * rudder
        return heading - self.x[0], math.sqrt(self.p[0, 0] + NOISE.heading)

    def correct(self, off: float) -> None:
        """Take the innovation [rad]."""
        gains: npt.NDArray[np.float64] = self.p[:, 0] / (self.p[0, 0] + NOISE.heading)
        self.x = self.x + gains * off
        self.answers = {name: answer - gains * answer[0] for name, answer in self.answers.items()}
        self.p = self.p - np.outer(gains, self.p[0])
