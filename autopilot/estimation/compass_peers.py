"""Which of several compasses has failed by the word of the others: it stands, jumps, trembles or drifts alone. Pure.

One compass alone is judged by the pilot's own monitors, with what they know of rudder, rate and sea. Two judge each
other sooner and more surely: where one does so and the other does not, the pilot need not fail, it goes on with the one
that is well.
"""

from __future__ import annotations

import math

from autopilot.angles import shortest_turn
from autopilot.estimation.tuning import RATE_BIAS_UNKNOWN

STANDS_S = 0.3
STANDS_SAMPLES = 4
STANDS_TURN = math.radians(2.5)
STANDS_DIGITS = 2.0
STANDS_SIGMAS = 5.0
"""A compass that says the very same for so long [s] and so often while another has turned by this [rad], by so many of
its own digits, and by so many standard deviations of what noise puts between two headings of the other, is frozen."""
HABIT = 4
HABIT_KNOWN = 50
HABIT_S = 1.2
HABIT_TURN = math.radians(1.0)
"""Or one that has never before said the same so often: HABIT times the longest that it did in HABIT_KNOWN headings and
more, and so long [s], for which a heading is sent on as it was, while another has turned by this [rad]. Where lengths
are random, as noise makes them, that is as rare as the cube of one in all that were, 8e-6. One short of HABIT, and as
much rarer by what the other must have turned, is enough beside a turn of STANDS_TURN."""
TREMBLES_DIGITS = 1.5
"""Where it trembled until then by so many of its digits nobody need have turned: it has failed, in flat water too, as
long as another shows something new: its last change is no older than FRESH_S, which two that froze together, their
headings out of step, have not."""
NOISY, QUIET = math.radians(4.0), math.radians(2.0)
NOISY_S, NOISY_SHARE = 1.5, 1.0 / 15.0
WILDEST = math.radians(20.0)
"""A compass with white noise of more than NOISY [rad] beside one with less than QUIET is noisy: 0.5 to 1 deg are usual.
Over so long [s], a heading at most a share of it, each counting as WILDEST [rad] at most: one of 2 deg was never called
noisy in three hours, and one of 10 deg in 1.0 s on average, 2.4 s at most; a single jump or spike never is."""
USUAL_TIMES = 8.0
"""A mean of 15 headings is off by a fifth, and now and then by half; one of so many times as many by a twentieth."""
AGREES = math.radians(10.0)
AGREES_S, AGREES_MOST = 3.0, 60.0
"""It is well again when it moves and is no further from the other than this [rad] for this time [s]: for twice as long
each time that it fails, up to the second [s], or one that freezes time and again would be gone back to each time."""
DOUBLINGS = math.log2(AGREES_MOST / AGREES_S)
TURNS_S = 20.0
"""What two compasses have turned further than the gyro of one of them is compared over this time [s]."""
DRIFTS = 2.0 * math.log(100.0)
"""Two compasses that part have one gyro between them, whose standing error g is the same for both. The one with the
gyro drifts where (x^2 - y^2)/(sigma TURNS_S)^2 is more than this: that g makes y, what the other has turned further, is
a hundred times likelier than that it makes x, its own. Where y^2 is more than that too no sound gyro makes either: it
has failed, and says nothing. Nor does it say anything against the other: a heading that is carried on by its gyro goes
with it, however wrong."""
SILENT_S = 2.0
"""Or when it was silent for so long [s]: it has been switched off and on."""
FRESH_S = 1.0


DRIFTING = "drifts"


class _Noise:
    """The standard deviation [rad] of an angle's white noise, from its second differences, which a steady turn has not:
    they have the variance 6 sigma^2, and their size the mean sigma sqrt(12/pi). usual: over USUAL_TIMES as long."""

    __slots__ = ("_last", "_step", "_taken", "deviation", "usual")

    def __init__(self, angle: float) -> None:
        self._last, self._step, self._taken, self.deviation, self.usual = angle, 0.0, 0, 0.0, 0.0

    def take(self, angle: float, share: float) -> None:
        """Take the next angle [rad], which counts for a `share` of the mean."""
        step = shortest_turn(self._last, angle)
        size = abs(shortest_turn(self._step, step)) / math.sqrt(12.0 / math.pi)
        self._taken += 1
        self.deviation += share * (min(size, WILDEST) - self.deviation)
        self.usual += max(share / USUAL_TIMES, 1.0 / self._taken) * (min(size, WILDEST) - self.usual)
        self._last, self._step = angle, step


class _Compass:
    """What one compass said last, since when it stands, and where the others were when it began to, with the noise of
    each; the noise of its headings, and of what lies between them and another's; how often it has failed; the rate
    [rad/s] of its own gyro, and how much further [rad] it has turned than that of each other."""

    __slots__ = (
        *("agrees_since", "apart", "digit", "failed", "heading", "heard", "last", "longest", "noise", "others"),
        *("rate", "reason", "same", "since", "trembled", "unturned"),
    )

    def __init__(self, now: float, heading: float) -> None:
        self.heading, self.last = heading, now
        self.reason, self.digit = "", math.inf
        self.heard, self.longest, self.failed = 0, 1, 0
        self.agrees_since: float | None = None
        self.noise = _Noise(heading)
        self.apart: dict[str, _Noise] = {}
        self.rate: float | None = None
        self.unturned: dict[str, float] = {}
        self.stand(now, {})

    def stand(self, now: float, others: dict[str, tuple[float, float]]) -> None:
        """Begin to stand where it is, the others being where they are, (heading, noise [rad])."""
        self.since, self.same, self.others = now, 1, others
        self.trembled = self.noise.deviation


class CompassWatch:
    """`on_sample` every heading; `reason` has what is wrong with a compass, '' where nothing is.

    jump [rad]: no boat turns further between two headings; inf: not watched. frozen: watched or not.
    """

    def __init__(self, jump: float, *, frozen: bool) -> None:
        self._jump, self._frozen = jump, frozen
        self.reset()

    def reset(self) -> None:
        """Forget every compass."""
        self._compasses: dict[str, _Compass] = {}

    def reason(self, name: str) -> str:
        """Return what is wrong with a compass."""
        compass = self._compasses.get(name)
        return compass.reason if compass is not None else ""

    def doubted(self, now: float) -> list[tuple[str, str]]:
        """Return the compasses that are heard and not selected, and why."""
        return [(name, it.reason) for name, it in self._compasses.items() if it.reason and now - it.last <= SILENT_S]

    def drifts(self, name: str, other: str) -> bool:
        """Return whether a compass drifts beside another one, by the word of its own gyro."""
        of, beside = self._compasses.get(name), self._compasses.get(other)
        if of is None or beside is None or not (name in of.unturned and name in beside.unturned):
            return False
        own, others = of.unturned[name] ** 2, beside.unturned[name] ** 2
        most = DRIFTS * RATE_BIAS_UNKNOWN * TURNS_S * TURNS_S
        return others <= most < own - others

    def accuse(self, name: str) -> None:
        """Take it that a compass drifts."""
        compass = self._compasses[name]
        compass.failed += not compass.reason
        compass.reason = compass.reason or DRIFTING

    def on_sample(self, now: float, name: str, heading: float, rate: float | None = None) -> None:
        """Take a heading [rad] that arrived at `now` [s], and the rate of turn [rad/s] that came with it."""
        compass = self._compasses.get(name)
        if compass is None or now - compass.last > SILENT_S:
            self._compasses[name] = _Compass(now, heading)
            return
        others, was = self._others(now, name), compass.reason
        compass.rate = rate if rate is not None and math.isfinite(rate) else None
        self._turn(now, compass, heading)
        if not compass.reason:
            compass.reason = self._jumped(compass, heading, others)
        is_noisy = self._is_noisy(now, compass, heading, others)
        if is_noisy and not compass.reason:
            compass.reason = "is noisy"
        compass.heard += 1
        if heading != compass.heading:
            if not compass.reason:
                compass.longest = max(compass.longest, compass.same)
            compass.digit = min(compass.digit, abs(shortest_turn(compass.heading, heading)))
            # the boat's own motion is in the noise of each, and not in what lies between them
            noises = {each: min(self._compasses[each].noise.usual, compass.apart[each].usual) for each in others}
            compass.stand(now, {each: (at, noises[each]) for each, at in others.items()})
        else:
            compass.same += 1
            # one that trembles shows no turn
            quiet = {each: at for each, at in others.items() if self._compasses[each].noise.deviation < QUIET}
            if not compass.reason and self._frozen and self._stands(now, compass, quiet):
                compass.reason = "stands still"
        compass.failed += bool(compass.reason and not was)
        compass.heading, compass.last = heading, now
        self._forgive(now, compass, {} if is_noisy else others)

    def _others(self, now: float, name: str) -> dict[str, float]:
        return {
            other: compass.heading
            for other, compass in self._compasses.items()
            if other != name and not compass.reason and now - compass.last <= FRESH_S
        }

    def _turn(self, now: float, compass: _Compass, heading: float) -> None:
        """Add up how much further it turned since its last heading than each gyro that is heard."""
        step, turn = now - compass.last, shortest_turn(compass.heading, heading)
        fades = math.exp(-step / TURNS_S)
        compass.unturned = {
            name: fades * compass.unturned.get(name, 0.0) + turn - each.rate * step
            for name, each in self._compasses.items()
            if each.rate is not None and now - each.last <= FRESH_S
        }

    def _jumped(self, compass: _Compass, heading: float, others: dict[str, float]) -> str:
        """A jump alone is none of the boat's: the others lie where the compass came from, not where it went to."""
        if abs(shortest_turn(compass.heading, heading)) <= self._jump:
            return ""
        stayed = any(
            abs(shortest_turn(other, compass.heading)) < abs(shortest_turn(other, heading)) for other in others.values()
        )
        return "jumps" if stayed else ""

    def _is_noisy(self, now: float, compass: _Compass, heading: float, others: dict[str, float]) -> bool:
        """What the boat does is no noise: both show it, and nothing of it lies between them."""
        share = min(-math.expm1(-(now - compass.last) / NOISY_S), NOISY_SHARE)
        compass.noise.take(heading, share)
        off = {name: shortest_turn(other, heading) for name, other in others.items()}
        compass.apart = {name: compass.apart.get(name, _Noise(angle)) for name, angle in off.items()}
        for name, angle in off.items():
            compass.apart[name].take(angle, share)
        if not math.isfinite(self._jump) or compass.noise.deviation <= NOISY:
            return False
        return any(
            apart.deviation > NOISY and self._compasses[name].noise.deviation < QUIET
            for name, apart in compass.apart.items()
        )

    def _stands(self, now: float, compass: _Compass, others: dict[str, float]) -> bool:
        if now - compass.since < STANDS_S or compass.same < HABIT - 1:
            return False
        turns = {
            name: (abs(shortest_turn(compass.others[name][0], heading)), compass.others[name][1])
            for name, heading in others.items()
            if name in compass.others
        }
        is_known, most = compass.heard - compass.same >= HABIT_KNOWN, STANDS_DIGITS * compass.digit
        never = is_known and compass.same >= HABIT * compass.longest
        is_unusual = compass.same >= STANDS_SAMPLES or (is_known and compass.same >= (HABIT - 1) * compass.longest)
        if is_unusual and any(
            turn > max(STANDS_TURN, most, STANDS_SIGMAS * math.sqrt(2.0) * noise) for turn, noise in turns.values()
        ):
            return True
        if not never or now - compass.since < HABIT_S:
            return False
        if any(turn > max(HABIT_TURN, most) for turn, _ in turns.values()):
            return True
        trembled = compass.trembled >= TREMBLES_DIGITS * compass.digit
        return trembled and any(
            turn and now - self._compasses[name].since < FRESH_S for name, (turn, _) in turns.items()
        )

    @staticmethod
    def _forgive(now: float, compass: _Compass, others: dict[str, float]) -> None:
        near = any(abs(shortest_turn(other, compass.heading)) <= AGREES for other in others.values())
        if not compass.reason or not near or compass.same >= STANDS_SAMPLES:
            compass.agrees_since = None
        elif compass.agrees_since is None:
            compass.agrees_since = now
        elif now - compass.agrees_since >= AGREES_S * 2.0 ** min(compass.failed - 1.0, DOUBLINGS):
            compass.reason = ""
