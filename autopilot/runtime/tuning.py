"""The gains of a running pilot, changed by ground stations, by design and by learning.

Gains go by a response level or a bandwidth. Designing them takes some hundred milliseconds, which is several ticks: it
is done beside the loop, in a thread, and what comes out is put in force between two ticks, by the loop itself. What was
learnt (`run --learn`) is reported, and adopted or taken back only when the skipper says so.
"""

from __future__ import annotations

import datetime
import math
from collections.abc import Callable
from dataclasses import astuple, replace
from typing import TYPE_CHECKING, Any, NamedTuple

from autopilot.control.backstepping import gains_at, linear_gains_backstepping, lqr_gains
from autopilot.control.design import (
    DESIGNED,
    MIDDLE_LEVEL,
    SENSITIVITY_MOST,
    Spread,
    design_backstepping,
    worst_margins,
)
from autopilot.control.registry import LAWS, designed_laws
from autopilot.errors import InputError, RefusedError
from autopilot.files.saving import Worker
from autopilot.models.drives import BEYOND, at_point, quickness
from autopilot.models.norrbin import Norrbin
from autopilot.runtime.build import gear_of, law_boat_of, limits_of, model_at_ratio, model_of, noise_of
from autopilot.runtime.vessel_store import VesselStore
from autopilot.signals import Tick
from autopilot.vessel.file import model_section, rounded
from autopilot.vessel.schema import Vessel, drive_law_of

if TYPE_CHECKING:
    from concurrent.futures import Executor, Future

    from autopilot.control.front import Afloat, Bandwidths, Cost, Off
    from autopilot.identification.learning import Learner, Proposal


LOOK_PERIOD = 2.0
"""Seconds between looks at the learner for something to tell."""


class GainRequest(NamedTuple):
    """What the loop is to be like: a response level, or the regulator's bandwidth [rad/s]."""

    level: int = 5
    bandwidth: float | None = None


def designed(vessel: Vessel, request: GainRequest = GainRequest()) -> Vessel:  # noqa: B008 - nobody can change it
    """Return the vessel with gains designed for it: those of planned turns, which take what rudder they need, and the
    regulator that holds a course. Raises RefusedError where no gain serves."""
    bandwidth, rate_max = request.bandwidth, limits_of(vessel).rate_max
    # a calm course is no reason to turn badly; a boat that is lost in turns at the middle level is asked for more
    level = max(request.level, MIDDLE_LEVEL)
    try:
        bandwidth = course_bandwidth(vessel, request.level) if bandwidth is None else bandwidth
        loop = design_backstepping(model_of(vessel), gear_of(vessel), rate_max, vessel.control.loop_delay_s, level)
    except ValueError as error:
        raise RefusedError(f"vessel {vessel.name!r}: {error}") from error
    boat = law_boat_of(vessel)
    sections = {name: _rounded(law.design.of(boat, loop)) for name, law in LAWS.items() if law.design}
    sections[DESIGNED] = replace(sections[DESIGNED], course_rad_s=rounded(bandwidth))
    return replace(vessel, control=replace(vessel.control, **sections))


def course_bandwidth(vessel: Vessel, level: int) -> float:
    """Return the bandwidth [rad/s] of the regulator that holds a course at a response level.

    What makes a calm one worth its errors is the wear of a gear. Where steering wears nothing a level has as much as
    the quickest that `bears_speeds`, four levels up at most: so the middle level comes to what the quickest may have.
    Raises ValueError as `bandwidths_of` does, and for another level.
    """
    from autopilot.control.front import LEVELS, bandwidth_of

    most = bandwidths_of(vessel)
    asked = bandwidth_of(level, most)
    if not law_boat_of(vessel).wears:
        for quicker in range(min(level + LEVELS[-1] - MIDDLE_LEVEL, LEVELS[-1]), level, -1):
            bandwidth = bandwidth_of(quicker, most)
            if bears_speeds(vessel, bandwidth):
                return bandwidth
    return asked


def bears_speeds(vessel: Vessel, bandwidth: float) -> bool:
    """Return whether a regulator of that bandwidth [rad/s] keeps usual margins at the trial's speed, and holds the boat
    at the slowest and the fastest that the file goes on to, on every boat within the uncertainty."""
    law, model, gear, (spread, _) = drive_law_of(vessel), model_of(vessel), gear_of(vessel), spread_of(vessel)
    regulator, rate_max, delay = lqr_gains(model, bandwidth), limits_of(vessel).rate_max, vessel.control.loop_delay_s
    for ratio, most in ((1.0, SENSITIVITY_MOST), (law.slowest, math.inf), (BEYOND * law.fastest, math.inf)):
        here = model_at_ratio(vessel, ratio)
        gains = linear_gains_backstepping(here, gains_at(regulator, quickness(law, model, here)))
        found = worst_margins(here, gear, rate_max, delay, gains._replace(ahead=gear.delay + gear.lag), spread)
        if not (found.stable and found.sensitivity <= most):
            return False
    return True


FALLS_OFF = 2.0
"""A regulator holds a boat that falls off its course by itself where its bandwidth is so many times that rate."""


def holding_bandwidth(vessel: Vessel) -> float:
    """Return the bandwidth [rad/s] at the trial's speed below which a course is not held at every speed that the file
    knows: a boat steered by thrust may go straight less and less as it goes faster, and its loop grows no quicker."""
    law, model = drive_law_of(vessel), model_of(vessel)
    if law.is_rudder:
        return 0.0
    fast = at_point(law, model, BEYOND * law.fastest * model.reference_speed, math.nan)
    return FALLS_OFF * max(-fast.n1, 0.0) / fast.time_constant / quickness(law, model, fast)


def _rounded(section: Any) -> Any:
    return type(section)(*(rounded(gain) for gain in astuple(section)))


ASSUMED_SPREAD = 0.2
"""How far K and T may be off, to either side, where the file holds no standard errors."""
SIGMAS = 2.0
NO_GYRO = 100.0**2
"""Variance of a rate of turn that tells nothing [(rad/s)^2]."""
MORE_DELAY = 0.1
"""A design must hold with so much more delay [s] than the file has."""


def spread_of(vessel: Vessel) -> tuple[Spread, str]:
    """Return how far K and T may be off, relative, and that in words."""
    model, errors = vessel.model, vessel.model.standard_errors
    if errors.K_1_s is None:
        words = f"K and T off by {100.0 * ASSUMED_SPREAD:.0f} %, assumed: the file holds no standard errors"
        return Spread(ASSUMED_SPREAD, ASSUMED_SPREAD), words
    # a boat of no gain or no time constant is none
    gain = min(SIGMAS * errors.K_1_s / model.K_1_s, 0.9)
    if errors.T_s is None:
        return Spread(gain, ASSUMED_SPREAD), f"K off by {100.0 * gain:.1f} % at this T, which may be any"
    time = min(SIGMAS * errors.T_s / model.T_s, 0.9)
    words = f"K off by {100.0 * gain:.1f} % and T by {100.0 * time:.1f} %, {SIGMAS:.0f} standard errors"
    return Spread(gain, time), words


def holds(vessel: Vessel, other: Vessel) -> bool:
    """Return whether the regulator of the `vessel` holds a course of another boat too, of the other stability as well.

    At the end of what is left open of n1/T the likeliest K is the edge of what is left open of both; K's own edge is
    that of the vessel's design.
    """
    from autopilot.control.front import USUAL, Off, cost

    control, model, real = vessel.control.backstepping, vessel.model, other.model
    assert control is not None
    # T of the other sign is n1 of the other sign, with K/T as it is
    time = real.T_s * real.n1 / (model.T_s * model.n1)
    gain = real.K_1_s / real.T_s * time * model.T_s / model.K_1_s
    afloat = afloat_of(vessel)
    return math.isfinite(cost(afloat, lqr_gains(afloat.model, control.course_rad_s), USUAL, Off(gain, time)).heading)


def afloat_of(vessel: Vessel) -> Afloat:
    """Return the vessel as its designs are worked out for; the age of its headings counts as delay."""
    from autopilot.control.front import Afloat

    path = vessel.control.loop_delay_s + vessel.sensors.heading_latency_s
    dt, noise = 1.0 / vessel.control.rate_hz, noise_of(vessel, DESIGNED)
    if not vessel.sensors.gyro:
        noise = noise._replace(rate=NO_GYRO)
    return Afloat(model_of(vessel), gear_of(vessel), path, dt, noise)


def offs_of(vessel: Vessel) -> tuple[Off, ...]:
    """Return the boats that a design for this vessel must hold."""
    from autopilot.control.front import boats_off

    spread, _ = spread_of(vessel)
    return boats_off(spread.gain, spread.time_constant, MORE_DELAY)


def bandwidths_of(vessel: Vessel) -> Bandwidths:
    """Return the bandwidths of the regulators that may be had. Raises ValueError where there is none."""
    from autopilot.control.front import bandwidths

    most = bandwidths(afloat_of(vessel), limits_of(vessel).rate_max, offs_of(vessel))
    return most._replace(slowest=max(most.slowest, min(holding_bandwidth(vessel), most.quickest)))


class LevelCost(NamedTuple):
    """A level of response, its bandwidth [rad/s], and what it costs in the usual sea, in a calm, and on the worst boat
    within the uncertainty."""

    level: int
    bandwidth: float
    sea: Cost
    calm: Cost
    worst: Cost


def front_of(vessel: Vessel) -> list[LevelCost]:
    """Return the front that `gains` chooses from. Raises RefusedError where no gain serves."""
    from autopilot.control.front import LEVELS, STILL, USUAL, cost, worst

    afloat, offs = afloat_of(vessel), offs_of(vessel)
    try:
        asked = [course_bandwidth(vessel, level) for level in LEVELS]
    except ValueError as error:
        raise RefusedError(f"vessel {vessel.name!r}: {error}") from error
    found = []
    for level, bandwidth in zip(LEVELS, asked, strict=True):
        gains = lqr_gains(afloat.model, bandwidth)
        costs = cost(afloat, gains, USUAL), cost(afloat, gains, STILL), worst(afloat, gains, USUAL, offs)
        found.append(LevelCost(level, bandwidth, *costs))
    return found


class LearningService:
    """Between the skipper's terminal and a pilot that learns the boat: what was learnt is reported, adopted, taken
    back."""

    def __init__(self, learner: Learner, store: VesselStore) -> None:
        self._learner, self._store = learner, store
        self._before: list[Vessel] = []
        self._looked = -math.inf
        self._last_news: tuple[Norrbin, bool] | None = None

    def news(self, tick: Tick) -> str:
        """Return what the skipper should know unasked: a model put forward, or one that has proved itself; else ''."""
        if tick.now - self._looked < LOOK_PERIOD:
            return ""
        self._looked = tick.now
        proposal = self._learner.proposal()
        now = None if proposal is None else (proposal.model, proposal.is_proved)
        if proposal is None or now == self._last_news:
            return ""
        self._last_news = now
        what = "learnt" if not proposal.is_proved else "learnt and proved (type adopt)"
        return f"{what}: {_numbers(proposal)}; {_check(proposal)}; {proposal.verdict}"

    def type_line(self, line: str) -> str | None:
        """Act on a typed line; return the answer, None where the line is not for it. Raises InputError."""
        word = line.strip()
        if word == "learn":
            return self._report()
        if word == "adopt":
            return self.adopt()
        if word == "revert":
            return self.revert()
        return None

    def adopt(self) -> str:
        """Put the proved model in force, with gains designed for it, and say what changed.

        Raises InputError where there is nothing to adopt, it has not proved itself, or no gains serve it.
        """
        before, wanted = self.wanted()
        try:
            return self.put(before, designed(wanted))
        except RefusedError as error:
            raise InputError(f"not adopted: {error}") from error

    def wanted(self) -> tuple[Vessel, Vessel]:
        """Return the vessel in force, and the same with the proved model, gains not designed for it yet.

        Raises InputError where there is nothing to adopt, or it has not proved itself.
        """
        proposal, running = self._learner.proposal(), self._store.running
        if proposal is None:
            raise InputError(f"nothing to adopt yet: {_progress(self._learner)}")
        if not proposal.is_proved:
            raise InputError(f"not adopted: it must predict better than the present model first; {_check(proposal)}")
        return running, with_learnt(running, proposal)

    def put(self, before: Vessel, after: Vessel) -> str:
        """Put an adopted vessel in force, `before` being what `revert` goes back to. Raises RefusedError."""
        kept = self._store.put(steered_as(self._store.stored, after))
        self._before.append(before)
        self._last_news = None
        return "; ".join(filter(None, ["adopted", _changes(before, after), kept]))

    def revert(self) -> str:
        """Put back in force what was before the latest adoption. Raises InputError where there is none."""
        if not self._before:
            raise InputError("nothing to revert: no model has been adopted in this run")
        store, present = self._store, self._store.running
        try:
            # what was tuned since stays tuned; model and gains go back
            kept = store.put(steered_as(store.stored, self._before[-1]))
        except RefusedError as error:
            raise InputError(f"not reverted: {error}") from error
        self._before.pop()
        return "; ".join(filter(None, ["reverted", _changes(present, store.running), kept]))

    def values(self) -> dict[str, float]:
        """Return model in force, learnt so far and proposed (`lrn_p`, `lrn_s`: standard errors), and how it did.

        Errors of prediction [deg]; `lrn_state` 0 nothing is proposed yet, 1 it is, 2 it has proved itself. `lrn_blown`
        1: nothing is learnt, as the rudder does too little beside what pushes the boat; `lrn_hard`: turns with so much
        rudder [deg] must prove it yet.
        """
        learner, proposal = self._learner, self._learner.proposal()
        values = {"lrn_moved": learner.moved, "lrn_state": 0.0, "lrn_blown": float(learner.is_blown)}
        for suffix, model in (("_in", learner.present), ("", learner.estimate)):
            values |= {f"lrn_K{suffix}": model.gain, f"lrn_T{suffix}": model.time_constant, f"lrn_n3{suffix}": model.n3}
        if proposal is None:
            return values
        model, errors = proposal.model, proposal.standard_errors
        values |= {"lrn_pK": model.gain, "lrn_pT": model.time_constant, "lrn_pn3": model.n3}
        values |= {"lrn_sK": errors["gain"], "lrn_sT": errors["time_constant"], "lrn_sn3": errors["n3"]}
        values |= {"lrn_n": float(proposal.stretches), "lrn_ahead": proposal.ahead}
        values["lrn_hard"] = 0.0 if proposal.is_tried_hard else math.degrees(proposal.hard)
        values |= {"lrn_old": math.degrees(proposal.present_error), "lrn_new": math.degrees(proposal.proposed_error)}
        return values | {"lrn_state": 2.0 if proposal.is_proved else 1.0}

    def _report(self) -> str:
        learner, proposal = self._learner, self._learner.proposal()
        lines = (
            [f"put forward: {_numbers(proposal)}; {_check(proposal)}; {proposal.verdict}"]
            if proposal
            else [_progress(learner)]
        )
        for name, model in (("in force", learner.present), ("now", learner.estimate)):
            lines.append(f"  {name:9} K {model.gain:.4g} 1/s  T {model.time_constant:.4g} s  n3 {model.n3:.4g}")
        return "\n".join(lines)


def steered_as(vessel: Vessel, other: Vessel) -> Vessel:
    """Return the vessel with the model and the designed gains of the other."""
    gains = {law: getattr(other.control, law) for law in designed_laws()}
    return replace(vessel, model=other.model, control=replace(vessel.control, **gains))


def with_learnt(vessel: Vessel, proposal: Proposal) -> Vessel:
    """Return the vessel with the proposed model."""
    source, today = "learnt while sailing", datetime.date.today().isoformat()
    return replace(vessel, model=model_section(proposal.model, proposal.standard_errors, source, today))


def _numbers(proposal: Proposal) -> str:
    model = proposal.model
    K, T, n3 = (
        f"{getattr(model, name):.3g} +- {error:.1g}" if math.isfinite(error) else f"{getattr(model, name):.3g} +- ?"
        for name, error in proposal.standard_errors.items()
    )
    return f"K {K} 1/s, T {T} s, n3 {n3} s^2/rad^2 (standard errors) from {proposal.moved:.0f} s of moved rudder"


def _check(proposal: Proposal) -> str:
    if proposal.stretches == 0:
        return "no manoeuvre since to prove it by; turn or zigzag"
    return (
        f"heading {proposal.ahead:.0f} s ahead off by {math.degrees(proposal.proposed_error):.2g} deg rms, with the "
        f"present model {math.degrees(proposal.present_error):.2g} deg, on {proposal.stretches} stretches since, "
        f"with up to {math.degrees(proposal.rudder):.0f} deg of rudder"
    )


def _progress(learner: Learner) -> str:
    if learner.is_blown:
        return (
            "what pushes the boat does too much for this rudder, and nothing is learnt: turn with more rudder, or in "
            "calmer water"
        )
    return (
        f"the rudder was moved for {learner.moved:.0f} s, and nothing is known yet by which turns are predicted better "
        "than by the present model: turn or zigzag"
    )


def _changes(before: Vessel, after: Vessel) -> str:
    old, new = before.model, after.model
    text = f"K {old.K_1_s:.4g} -> {new.K_1_s:.4g} 1/s, T {old.T_s:.4g} -> {new.T_s:.4g} s"
    was, now = (getattr(each.control, DESIGNED) for each in (before, after))
    if was is not None and now is not None:
        text += f", gains k1 {was.k1_1_s:.3g} -> {now.k1_1_s:.3g}, k2 {was.k2_1_s:.3g} -> {now.k2_1_s:.3g} 1/s"
    return text


BUSY = "another change is being worked out: try again in a moment"


class Change:
    """One change under way: a `Tuning`."""

    def __init__(self, work: Future[Vessel] | None, finish: Callable[[Vessel], str]) -> None:
        self._work, self._finish = work, finish
        self.is_over = False
        self.is_complete = False
        self.said = ""

    @property
    def progress(self) -> float:
        """Not known in between."""
        return 1.0 if self.is_over else 0.5

    def turn(self) -> None:
        """Put in force what has been worked out."""
        if self.is_over or self._work is None or not self._work.done():
            return
        try:
            self.end(self._finish(self._work.result()))
        except (InputError, RefusedError) as error:
            self.said = f"not changed: {error}"
            self.is_over = True

    def end(self, said: str) -> None:
        """It is in force."""
        self.said, self.is_over, self.is_complete = said, True, True


class TuningService:
    """A `Tuner` for ground stations. `learning`: what learns in this run, None where nothing does; `worker`: where
    gains are designed.

    Call `turn` after every tick, `close` at the end.
    """

    def __init__(
        self, store: VesselStore, learning: LearningService | None, worker: Worker | Executor | None = None
    ) -> None:
        self.level = math.nan
        self._store, self._learning = store, learning
        self._worker = worker or Worker("design")
        self._change: Change | None = None

    def set_level(self, level: int) -> Change:
        """Begin to put a response level in force. Raises InputError."""
        if not 1 <= level <= 9:
            raise InputError(f"response level {level}: allowed is 1 (calm) to 9 (quick)")
        before = self._store.running

        def finish(vessel: Vessel) -> str:
            present = self._store.running
            if present.model != before.model or present.rudder != before.rudder:
                raise InputError("model or rudder were changed meanwhile; try again")
            kept = self._store.put(steered_as(self._store.stored, replace(vessel, model=present.model)))
            self.level = float(level)
            return "; ".join(filter(None, [f"response level {level}", kept]))

        return self._begin(before, GainRequest(level), finish)

    def adopt(self) -> Change:
        """Begin to put the proved model in force, with gains for it. Raises InputError."""
        learning = self._learns()
        before, wanted = learning.wanted()
        request = GainRequest(int(self.level)) if math.isfinite(self.level) else GainRequest()

        def finish(vessel: Vessel) -> str:
            if self._store.running != before:
                raise InputError("the vessel was changed meanwhile; try again")
            return learning.put(before, vessel)

        return self._begin(wanted, request, finish)

    def revert(self) -> Change:
        """Put back in force what was before the latest adoption. Raises InputError."""
        change = Change(None, lambda _: "")
        change.end(self._learns().revert())
        return change

    def learnt(self) -> dict[str, float]:
        """Return what was learnt by names of at most ten characters."""
        return self._learning.values() if self._learning is not None else {}

    def turn(self) -> None:
        """Put in force what has been worked out since the last tick."""
        if self._change is not None:
            self._change.turn()

    def close(self) -> None:
        """Wait for what is being worked out."""
        self._worker.shutdown()

    def _begin(self, vessel: Vessel, request: GainRequest, finish: Callable[[Vessel], str]) -> Change:
        if self._change is not None and not self._change.is_over:
            raise InputError(BUSY)
        self._change = Change(self._worker.submit(designed, vessel, request), finish)
        return self._change

    def _learns(self) -> LearningService:
        if self._learning is None:
            raise InputError("nothing is learnt in this run: start with --learn")
        return self._learning
