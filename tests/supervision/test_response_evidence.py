"""The evidence about the rudder's answer, against matrices and normal densities, and what is concluded from it."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from scipy.stats import multivariate_normal
from watches import BOAT, DT, NOISE, Answering, MatrixFilter, RudderHistory

from autopilot.estimation.disturbance import slide_step
from autopilot.models.norrbin import Norrbin, rate_step
from autopilot.signals import HeadingSample, NavState, RudderSample
from autopilot.supervision import rudder_watch
from autopilot.supervision.monitor_input import AlarmLimits, Measured, MonitorInput
from autopilot.supervision.response_filter import (
    NOTHING,
    SEA_KNOWN_S,
    Covariance,
    Noise,
    all_moved,
    foreseen,
    transition_of,
)
from autopilot.supervision.rudder_answer import (
    FILED,
    LIVELIER,
    NO_SEAWAY,
    NOTHING_KNOWN,
    QUICKER,
    SLOW_RUDDER,
    Evidence,
    acquitted,
    carried_on,
    counts_as_course,
    enough,
    is_doubtful,
    other_verdict,
    push_at_least,
    seaway_noise,
    seaway_step,
    since_turning,
    verdict,
    verdict_at,
)
from autopilot.supervision.rudder_response import (
    NO_OTHERS,
    NOTHING_ADDED,
    Others,
    ResponseState,
    begun_gust,
    first_response,
    gust_likelier,
    gust_moved,
    gust_step,
    response_step,
    without_evidence,
)
from autopilot.supervision.tuning import GUST_SIZE, SEA_FIRST, SEA_FIRST_TIME, WORKED_TIME
from sitl.compiled import compiled

Matrix = npt.NDArray[np.float64]
SURE = 10.4
ON_COURSE, IN_A_TURN = (14.0, 6.0, 3.0), (11.0, 10.4, 1.0)


class Judge(MatrixFilter):
    """The same by matrices."""

    def __init__(self, heading: float) -> None:
        super().__init__(heading, NOISE.sea, NOISE.pace, ("in time", "late", "slow"))
        self.sums = dict.fromkeys(("silent", "silent_late", "opposite", "opposite_late"), 0.0)
        self.sums |= dict.fromkeys(("weak", "right", "strong", "late"), 0.0)
        self.pairs = {"lively": [0.0, 0.0], "quick": [0.0, 0.0]}
        self.usual, self.shown, self.misfit, self.misfit_slow = 45.0, 60.0, 0.5, 1.0
        self.past: list[tuple[float, float, float]] = []
        self.left, self.colour = 0.0, 1.0

    def on_sample(self, heading: float, rate: float, rudders: dict[str, float]) -> None:
        off, sigma = self.predict(heading, rate, rudders)
        s, late, slow = (float(self.answers[name][0]) for name in ("in time", "late", "slow"))
        self._weigh(off, sigma, s, late, slow)
        self.correct(off)

    def _weigh(self, off: float, sigma: float, s: float, late: float, slow: float) -> None:
        def more(one: float, other: float, most: float) -> float:
            """How much likelier, as a logarithm, `other` is than `one`."""
            return min(max(log_density((off - other) / sigma) - log_density((off - one) / sigma), -0.8), most)

        least = float(np.clip(0.75 * self.usual / self.shown, 0.5, 0.85))
        most, fades = (0.0 if self.odd > 3.0 else 0.8), math.exp(-DT / 20.0)
        learns = 0.0
        shares = np.linspace(-1.0, 1.6, 20001)
        left = min(((off - shares * s) ** 2).min(), (off - slow) ** 2) / sigma**2
        before = dict(self.sums)
        for name, answer, other in (
            ("silent", s, 0.0),
            ("silent_late", late, 0.0),
            ("opposite", s, -0.7 * s),
            ("opposite_late", late, -0.7 * late),
        ):
            self.sums[name] = max(fades * self.sums[name] + more(least * answer, other, most), 0.0)
        if max(self.sums["silent"], before["opposite"]) < 2.0:
            learns = 1.0 / sigma**2
        remembered = math.exp(-DT / 900.0)
        self.usual = 45.0 + remembered * (self.usual - 45.0) + learns * off * s
        self.shown = 60.0 + remembered * (self.shown - 60.0) + learns * s * s
        self.odd += (1.0 - math.exp(-DT / 0.25)) * (min(left, 36.0) - self.odd)
        # time constant 4 s: what is strange over 4 s, what fades over 8 of it
        share, kept = 1.0 - math.exp(-DT / 4.0), math.exp(-DT / 32.0)
        self._colour(off, sigma, s, kept)
        against = min(off * math.copysign(1.0, s), 0.0)
        self.misfit += share * (min((against / sigma) ** 2, 36.0) - self.misfit)
        self.misfit_slow += share * (min(((off - slow) / sigma) ** 2, 36.0) - self.misfit_slow)
        most, most_slow = (0.8 if x < 3.0 else 0.0 for x in (self.misfit, self.misfit_slow))
        for name, (low, high) in (("lively", (1.6, 3.5)), ("quick", (2.4, 6.0))):
            side = 0 if s > 0.0 else 1
            self.pairs[name] = [kept * value for value in self.pairs[name]]
            self.pairs[name][side] = max(self.pairs[name][side] + more(low * s, high * s, most), 0.0)
        for name, answer in (("weak", 0.5 * s), ("right", s), ("strong", 1.6 * s), ("late", late)):
            self.sums[name] = max(kept * self.sums[name] + more(answer, slow, most_slow), 0.0)

    def _colour(self, off: float, sigma: float, s: float, kept: float) -> None:
        """The best share by weighed least squares over all that was, and what it leaves, averaged over 0.5 s."""
        self.past.append((off / sigma, s / sigma, sigma))
        offs, answers, _ = np.array(self.past).T
        weights = kept ** np.arange(len(offs))[::-1]
        best = max(float(weights @ (offs * answers)) / float(weights @ answers**2), 1.0)
        share = 1.0 - math.exp(-DT / 0.5)
        self.left += share * ((off - best * s) / sigma - self.left)
        self.colour = kept * self.colour + (1.0 - kept) * self.left**2 * (2.0 - share) / share


def log_density(deviations: float) -> float:
    """Of the normal distribution."""
    return -0.5 * deviations * deviations - 0.5 * math.log(2.0 * math.pi)


def are_close(found: Sequence[float], wanted: Sequence[float] | Matrix, most: float) -> bool:
    return len(found) == len(wanted) and all(abs(a - b) <= most for a, b in zip(found, wanted, strict=True))


def sailed(share: float, slowness: float, usual: float, seconds: float = 40.0) -> list[tuple[ResponseState, Judge]]:
    """A boat that answers by `share` of the model to a rudder that trails by `slowness` [s]; both judges of it."""
    random = np.random.default_rng(5)
    memory, judge = first_response(NOISE, 0.0, 0.1)._replace(usual=60.0 * usual), Judge(0.1)
    judge.usual = 60.0 * usual
    heading, rate, moves, trail, found = 0.1, 0.0, 0.0, 0.0, []
    for tick in range(1, round(seconds / DT)):
        now = DT * tick
        order = 0.25 * math.copysign(1.0, math.sin(0.5 * now)) + 0.05 * math.sin(1.7 * now)
        late = 0.25 * math.copysign(1.0, math.sin(0.5 * (now - 0.4)))
        trail += 0.1 * (order - trail)
        moves += (order - moves) * (1.0 if slowness == 0.0 else DT / slowness)
        for _ in range(10):
            rate += 0.1 * DT * (0.3 * share * moves - rate - rate**3) / 4.0
            heading += 0.1 * DT * rate
        shown = heading + 0.005 * random.standard_normal()
        memory = response_step(memory, BOAT, NOISE, rate, (now, shown), (order, late, trail, 0.0, 1.0))
        judge.on_sample(shown, rate, {"in time": order, "late": late, "slow": trail})
        found.append((memory, judge_copy(judge)))
    return found


def judge_copy(judge: Judge) -> Judge:
    kept = Judge(0.0)
    kept.__dict__.update({key: value.copy() if hasattr(value, "copy") else value for key, value in vars(judge).items()})
    kept.pairs = {name: list(values) for name, values in judge.pairs.items()}
    return kept


@pytest.mark.parametrize(
    ("share", "slowness", "usual"),
    [(1.0, 0.0, 0.75), (1.0, 2.0, 1.5), (0.0, 0.0, 0.4), (-1.0, 0.0, 1.0), (2.0, 0.0, 1.0)],
)
def test_the_evidence_is_the_difference_of_log_likelihoods(share: float, slowness: float, usual: float) -> None:
    for memory, judge in sailed(share, slowness, usual):
        others, sums = memory.others, judge.sums
        mean, answer, late, _, slow = memory.means
        means = [*mean, *answer, *late, *slow]
        names = ("in time", "late", "slow")
        assert are_close(means, np.concatenate([judge.x, *(judge.answers[name] for name in names)]), 1e-9)
        evidence = [memory.stuck, memory.stuck_late, memory.reversed, memory.reversed_late]
        evidence += [others.weak, others.right, others.strong, others.late, *others.lively, *others.quick]
        assert are_close(evidence, [*sums.values(), *judge.pairs["lively"], *judge.pairs["quick"]], 1e-6)
        assert are_close([others.misfit, others.misfit_slow], [judge.misfit, judge.misfit_slow], 1e-9)
        assert are_close([memory.usual / judge.usual, memory.shown / judge.shown], [1.0, 1.0], 1e-9)
        assert are_close([others.left, others.colour / judge.colour], [judge.left, 1.0], 1e-6)
        assert are_close([memory.unexplained], [judge.odd], 1e-5)
        assert memory.outliers == 0


@pytest.mark.parametrize("wild_so_far", range(6))
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_wild_heading_is_left_out_four_times_in_a_row(wild_so_far: int, side: float) -> None:
    before = first_response(NOISE, 0.0, 0.0)
    for tick in range(1, 50):
        before = response_step(before, BOAT, NOISE, 0.0, (DT * tick, 0.0), (0.0, 0.0, 0.0, 0.0, 1.0))
    before = before._replace(outliers=wild_so_far, stuck=3.0, usual=50.0)
    after = response_step(before, BOAT, NOISE, 0.0, (before.time + DT, side * 1.0), (0.1, 0.1, 0.1, 0.0, 1.0))
    if wild_so_far < 4:
        assert after.outliers == wild_so_far + 1
        assert after.means[0] == pytest.approx((before.means[0][0], 0.0, 0.0, 0.0), abs=1e-3)
        assert (after.stuck, after.usual, after.unexplained) == (3.0, 50.0, before.unexplained)
        assert after.means[1][0] > 0.0 and after.covariance[0] > before.covariance[0]
    else:
        assert after.outliers == 0
        assert side * after.means[0][0] > 0.1


def in_waves(heading: float, deviation: float = 0.0, frequency: float = 0.0) -> NavState:
    return NavState(0.0, heading, 0.0, 1.0, 0.0, 0.0, 0.0, True, 0.0, 0.0, deviation, frequency)


def noise_of(deviation: float, frequency: float) -> Noise:
    """The noise in a sea as it is estimated, on a course on which it was."""
    return seaway_noise(BOAT, 2.0e-4, in_waves(0.0, deviation, frequency), NO_SEAWAY, 0.0, 0.0)


def test_the_noise_of_a_boat_in_a_sea() -> None:
    """K = 0.3, T = 4 s; the sea yaws by w psi, for which the rudder would be worth w psi sqrt(1 + (w T)^2)/K."""
    noise = noise_of(0.05, 0.8)
    assert noise.heading == 2.0e-4
    assert noise.acceleration == pytest.approx((0.3 / 4.0) ** 2 * math.radians(0.5) ** 2 * 0.2)
    assert noise.push == pytest.approx(math.radians(0.6) ** 2)
    assert noise.sea == pytest.approx((0.05 * 0.8 / 0.3) ** 2 * (1.0 + (0.8 * 4.0) ** 2))
    assert noise.pace == 0.8
    calm = noise_of(0.0, 0.1)
    assert (calm.sea, calm.pace) == (pytest.approx(math.radians(1.0) ** 2), 0.5)


@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.parametrize(
    ("turned_deg", "age", "swing", "is_met"),
    [(10.5, 0, 0.08, True), (9.5, 0, 0.08, False), (90.0, 3590, 0.08, True), (90.0, 3610, 0.08, False)],
)
def test_after_a_turn_the_largest_sea_of_late_may_come(
    side: float, turned_deg: float, age: int, swing: float, is_met: bool
) -> None:
    """The launch and the coaster came from a following sea that hardly turned them; a wave held them against the
    rudder, and it was called reversed. What is met fades with an hour, the headings with 15.7 s."""
    seaway = seaway_step(NO_SEAWAY, 0.0, 1.0, swing)
    for tick in range(age):
        seaway = seaway_step(seaway, tick + 1.0, 1.0, 0.0)
    assert seaway.swing == pytest.approx(swing * math.exp(-age / 3600.0))
    # the sea that is estimated turns the boat as much as what was met an hour ago, at the slowest pace
    noise = noise_of(swing / math.e, 0.5)
    state = in_waves(1.0 + side * math.radians(turned_deg), swing / math.e, 0.5)
    met = seaway_noise(BOAT, 2.0e-4, state, seaway, 0.0, 0.0)
    assert met == (noise_of(seaway.swing, 0.5) if is_met else noise)
    seaway = seaway_step(seaway._replace(time=0.0), 2.0 * math.pi / 0.4, 1.0 + side * math.radians(25.0), 0.0)
    assert math.atan2(seaway.east, seaway.north) == pytest.approx(1.0 + side * 0.2767, abs=1e-4)


def test_a_sea_that_nobody_has_met_may_come_on_a_new_course_only() -> None:
    """A launch that had held a course right before the sea for minutes, without a yaw, turned by 20 deg into waves that
    swung it by 12: its rudder was called slow, then stuck, and let go."""
    noise, calm = noise_of(0.0, 0.0), seaway_step(NO_SEAWAY, 0.0, 0.0, 0.0)
    assert seaway_noise(BOAT, 2.0e-4, in_waves(math.radians(9.5)), calm, 0.0, 0.0) == noise
    assert seaway_noise(BOAT, 2.0e-4, in_waves(2.0), calm, 0.0, 0.0) == noise_of(math.radians(1.0), 0.5)


def accused(stuck: float, stuck_too: float, wrong: float = 0.0, wrong_too: float = 0.0) -> ResponseState:
    """Evidence by headings, and by blocks, that the rudder is stuck, and reversed, in time and late."""
    plain = first_response(NOISE, 0.0, 0.0)
    blocks = plain.blocks._replace(stuck=stuck_too, stuck_late=stuck_too, reversed=wrong_too, reversed_late=wrong_too)
    return plain._replace(stuck=stuck, stuck_late=stuck, reversed=wrong, reversed_late=wrong, blocks=blocks)


@pytest.mark.parametrize(
    ("silent", "opposite", "wanted"),
    [
        ((11.0, 3.0), (0.0, 0.0), 1),
        ((10.9, 3.0), (0.0, 0.0), 0),
        ((99.0, 2.9), (0.0, 0.0), 0),
        ((6.0, 8.0), (0.0, 0.0), 1),
        ((5.9, 99.0), (0.0, 0.0), 0),
        ((0.0, 0.0), (6.0, 8.0), -1),
        ((0.0, 0.0), (6.0, 7.9), 0),
        ((0.0, 0.0), (99.0, 2.9), 0),
    ],
)
def test_a_verdict_takes_both_seas_in_time_and_late(
    silent: tuple[float, float], opposite: tuple[float, float], wanted: int
) -> None:
    memory = accused(*silent, *opposite)._replace(since=(-1.0 if max(opposite) > 0.0 else 0.0, 1.0))
    assert verdict(memory, ON_COURSE) == wanted
    assert verdict(memory._replace(usual_colour=2.5), ON_COURSE) == wanted
    for name, less in (("stuck", 0), ("stuck_late", 0), ("reversed", -1), ("reversed_late", -1)):
        if wanted == (1 if less == 0 else -1):
            assert verdict(memory._replace(**{name: 0.0}), ON_COURSE) != wanted
            assert verdict(memory._replace(blocks=memory.blocks._replace(**{name: 0.0})), ON_COURSE) != wanted


@pytest.mark.parametrize("evidence", [(99.0, 99.0, 0.0, 0.0), (0.0, 0.0, 99.0, 99.0), (99.0, 99.0, 99.0, 99.0)])
@pytest.mark.parametrize(("share", "wanted"), [(-1.7, -1), (-0.51, -1), (-0.49, 1), (0.4, 1)])
def test_which_fault_it_is_the_share_of_the_answer_since_it_began_tells(
    evidence: tuple[float, float, float, float], share: float, wanted: int
) -> None:
    """Midway between a rudder that does nothing and one that does the opposite."""
    assert verdict(accused(*evidence)._replace(since=(30.0 * share, 30.0)), ON_COURSE) == wanted


def test_the_share_is_that_of_the_headings_since_there_was_no_evidence() -> None:
    memory, heading, rate, begun = first_response(NOISE, 0.0, 0.0), 0.0, 0.0, []
    for number in range(1, 400):
        rudder = math.copysign(0.3, math.sin(0.4 * number * DT))
        rate = rate_step(BOAT, rate, rudder if number < 200 else -rudder, DT)
        heading += rate * DT
        memory = response_step(memory, BOAT, NOISE, rate, (number * DT, heading), (rudder, rudder, rudder, 0.0, 1.0))
        begun.append(max(memory.stuck, memory.reversed) >= 1.0)
        assert (memory.since[1] > 0.0) is begun[-1]
    assert not any(begun[:198]) and all(begun[250:])
    assert memory.since[0] == pytest.approx(-memory.since[1], rel=0.4)


def test_how_likely_a_gust_is_by_normal_densities() -> None:
    """Of a boat that is pushed evenly since, against one that is not: its headings have one covariance more."""
    random, filtered = np.random.default_rng(3), MatrixFilter(0.1, NOISE.sea, NOISE.pace, ("push",))
    gust, number, unmoved = begun_gust(3.0), 12, (0.0, 0.0, 0.0, 0.0)
    left, sigmas, shows = np.zeros(number), np.zeros(number), np.zeros(number)
    covariance = first_response(NOISE, 0.0, 0.1).covariance
    for place in range(number):
        _, sigmas[place] = filtered.predict(0.0, 0.02, {"push": 1.0})
        shows[place] = filtered.answers["push"][0]
        left[place] = 0.004 * place + 0.01 * random.standard_normal()
        filtered.correct(0.0)
        step = transition_of(BOAT, 0.02, NOISE.pace, DT)
        _, gains, covariance, _ = foreseen(step, covariance, (NOTHING,) * 5, unmoved, NOISE[:4], DT)
        gust = gust_step(gust_moved(gust, step), gains, (left[place], 0.0, 0.0, left[place]), gains[0], 9.0)
    alone = np.diag(sigmas**2)
    pushed_too = alone + GUST_SIZE**2 * np.outer(shows, shows)
    likelier = multivariate_normal(cov=pushed_too).logpdf(left) - multivariate_normal(cov=alone).logpdf(left)
    assert gust_likelier(gust[1], gust[2]) == pytest.approx(likelier, rel=1e-6)
    assert gust[3] == 3.0


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_push_that_ends_as_the_rudder_comes_off_its_stop_accuses_no_rudder(side: float) -> None:
    """The boat goes to where the push has held it off, and the rudder to the other side: 1 s later it was reversed."""
    boat = Norrbin(0.7, 0.33)
    noise = Noise(math.radians(0.3) ** 2, NOISE.acceleration, NOISE.push, math.radians(1.0) ** 2, 0.5, 0.0)
    memory, heading, rate, accused = first_response(noise, 0.0, 0.0), 0.0, 0.0, []
    for tick in range(1, 440):
        now = 0.05 * tick
        rudder = math.radians(max(min(30.0, 30.0 - 20.0 * (now - 19.8)), 10.0))
        push = math.radians(-32.0 if now < 20.0 else 0.0)
        for _ in range(5):
            rate += 0.01 / boat.time_constant * (0.7 * boat.gain * side * (rudder + push) - rate)
            heading += 0.01 * rate
        at = side * rudder
        memory = response_step(memory, boat, noise, rate, (now, heading), (at, at, at, 0.0, 1.0))
        accused.append(verdict(memory, ON_COURSE) or other_verdict(memory.others))
    assert not any(accused[390:])


def test_a_turn_asks_for_less_evidence_but_for_what_was_carried_into_it() -> None:
    """14 on a course, 11 in a turn; what was four fifths of a verdict on the course is as much as the turn begins, and
    fades in 20 s."""
    assert (enough(0.0, True), enough(1.0, True)) == (ON_COURSE, ON_COURSE)
    assert (enough(0.0, False), enough(1.0, False)) == (IN_A_TURN, ON_COURSE)
    nearly = accused(8.2, 3.0)
    carried = carried_on(0.0, nearly, True, 0.1)
    assert carried == pytest.approx(0.8)
    assert carried_on(0.3, accused(99.0, 9.0), True, 0.1) == 1.0
    assert carried_on(0.3, accused(0.0, 0.0, 4.0, 3.0), True, 0.1) == pytest.approx(0.5)
    turning = carried_on(carried, nearly, False, 0.1)
    assert enough(turning, False)[0] == pytest.approx(11.0 + 3.0 * 0.8 * math.exp(-0.1 / 20.0))
    assert verdict(nearly, enough(turning, False)) == 0
    for _ in range(200):
        turning = carried_on(turning, nearly, False, 0.1)
    assert enough(turning, False)[1:] == pytest.approx(
        (10.4 - 4.4 * 0.8 * math.exp(-20.1 / 20.0), 1.0 + 2.0 * 0.8 * math.exp(-20.1 / 20.0))
    )
    turned = accused(10.5, 1.5)
    assert (verdict(turned, enough(0.0, False)), verdict(turned, enough(0.0, True))) == (1, 0)


def test_until_the_sea_is_known_a_turn_counts_as_a_course() -> None:
    """The longest wave that is estimated lasts 15.7 s."""
    begun = NO_SEAWAY._replace(begun=100.0)
    assert [counts_as_course(begun, now, False) for now in (100.0, 115.6, 115.8)] == [True, True, False]
    assert counts_as_course(NO_SEAWAY, 115.8, False)
    assert counts_as_course(begun, 115.8, True)


def test_a_sea_that_is_not_the_one_estimated_asks_for_as_much_more_evidence() -> None:
    """Of a sea eight times as coloured as noise; what is suspect is not the sea's."""
    for share, wanted in ((1.01, -1), (0.99, 0)):
        memory = accused(0.0, 0.0, share * 8.0 / 2.5 * 6.0, 8.0)._replace(usual_colour=8.0, since=(-1.0, 1.0))
        assert verdict(memory, ON_COURSE) == wanted
    for opposite, learns in ((0.0, True), (5.0, False)):
        memory = first_response(NOISE, 0.0, 0.0)._replace(reversed=opposite)
        memory = memory._replace(others=NO_OTHERS._replace(left=8.0, colour=8.0))
        after = response_step(memory, BOAT, NOISE, 0.0, (DT, 0.0), (0.1, 0.1, 0.1, 0.0, 1.0))
        assert after.usual_colour == (after.others.colour if learns else 1.0)
        assert after.others.colour > 7.0


def test_another_boat_shows_on_both_sides_and_a_slow_rudder_against_every_answer() -> None:
    for sides in itertools.product((10.3, SURE), repeat=2):
        both = min(sides) >= SURE
        assert other_verdict(NO_OTHERS._replace(lively=sides)) == (LIVELIER if both else FILED)
        assert other_verdict(NO_OTHERS._replace(quick=sides, lively=(99.0, 99.0))) == (QUICKER if both else LIVELIER)
    # what is left over lies to one side for long: one heading tells a third of what it seems to
    coloured = NO_OTHERS._replace(colour=3.0)
    assert other_verdict(coloured._replace(lively=(3.0 * SURE, 31.0), quick=(31.0, 99.0))) == FILED
    assert other_verdict(coloured._replace(lively=(3.0 * SURE, 99.0), quick=(31.0, 99.0))) == LIVELIER
    assert other_verdict(coloured._replace(lively=(3.0 * SURE, 99.0), quick=(32.0, 99.0))) == QUICKER
    for four in itertools.product((10.3, SURE), repeat=4):
        names = dict(zip(("weak", "right", "strong", "late"), four, strict=True))
        found = other_verdict(NO_OTHERS._replace(quick=(99.0, 99.0), **names))
        assert found == (SLOW_RUDDER if min(four) >= SURE else QUICKER)


def test_without_evidence_nothing_grows_and_what_speaks_for_the_boat_counts() -> None:
    def memory(value: float) -> ResponseState:
        others = NO_OTHERS._replace(lively=(value, value + 1), quick=(value + 2, value + 3))
        others = others._replace(**dict.fromkeys(("misfit", "misfit_slow", "weak", "right", "strong", "late"), value))
        plain = first_response(NOISE, value, value)._replace(others=others)
        return plain._replace(stuck=value, stuck_late=value, reversed=value, reversed_late=value)

    low, high = memory(2.0), memory(5.0)
    assert without_evidence(high, low) == low
    kept = without_evidence(low, high)
    assert kept.time == 5.0 and kept.means == high.means
    assert (kept.others.misfit, kept.others.misfit_slow) == (5.0, 5.0)
    assert kept.blocks.means == high.blocks.means
    assert kept._replace(time=2.0, means=low.means, others=low.others, blocks=low.blocks) == low
    assert kept.others[:2] == low.others[:2] and kept.others[4:] == low.others[4:]


def pushed(variance: float) -> Covariance:
    """The first covariance, with a push that is known to a variance [rad^2]."""
    before = first_response(NOISE, 0.0, 0.0).covariance
    return *before[:7], variance, *before[8:]


def test_a_push_counts_beyond_two_deviations_and_beside_the_usual_answer() -> None:
    """To either side; the share of the answer that is usual here is 0.5."""
    before = first_response(NOISE, 0.0, 0.0)
    for side in (-1.0, 1.0):
        memory = before._replace(
            means=((9.0, 9.0, side * 0.5, 9.0), (9.0, 9.0, side * 0.2, 9.0), *before.means[2:]),
            covariance=pushed(0.04),
            usual=30.0,
            shown=60.0,
        )
        assert push_at_least(memory) == pytest.approx(side * (0.5 + 0.5 * 0.2 - 2.0 * 0.2))
        assert push_at_least(memory._replace(covariance=pushed(0.1))) == 0.0
        assert push_at_least(memory._replace(covariance=pushed(-1e-9))) == pytest.approx(side * 0.6)


@pytest.mark.parametrize("silent", [(7.0, 7.0), (6.9, 99.0), (99.0, 6.9)])
@pytest.mark.parametrize("opposite", [(7.0, 7.0), (6.9, 99.0), (99.0, 6.9)])
def test_a_doubt_is_evidence_of_seven_and_what_was_doubted_begins_with_half_a_verdict(
    silent: tuple[float, float], opposite: tuple[float, float]
) -> None:
    memory = first_response(NOISE, 0.0, 0.0)._replace(stuck=silent[0], stuck_late=silent[1])
    memory = memory._replace(reversed=opposite[0], reversed_late=opposite[1])
    assert is_doubtful(memory) is (min(silent) >= 7.0 or min(opposite) >= 7.0)
    # a doubt more makes a verdict: on the course that is held then, and by headings in a turn, where 11 were enough
    most = pytest.approx(0.5 * (14.0 - 7.0))
    found = acquitted(memory._replace(blocks=accused(0.0, 9.0, 0.0, 9.0).blocks))
    for each in (found, found.blocks):
        assert (each.stuck, each.stuck_late, each.reversed, each.reversed_late) == (most, most, most, most)
    for sure, more in ((ON_COURSE, (3.5, 3.5)), (IN_A_TURN, (7.0, 0.0))):
        again = found._replace(stuck=found.stuck + more[0], stuck_late=99.0, reversed=0.0)
        again = again._replace(blocks=found.blocks._replace(stuck=found.blocks.stuck + more[1], stuck_late=99.0))
        assert verdict(again, sure) == 1
        assert verdict(again._replace(stuck=again.stuck - 0.2), sure) == 0
    little = memory._replace(stuck=1.0, stuck_late=2.0, reversed=2.0, reversed_late=0.5)
    assert acquitted(little) == little


TICK = 0.125
STOP = 0.5


class Looks:
    """Ticks of an eighth of a second; what the watch hands on to its filter is written down."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, speed: float = math.inf, **memory: Any) -> None:
        self.watch, self.number, self.taken = Answering(2.0e-4, speed), 0, list[tuple[Any, ...]]()
        self.memory, self.doubts = memory, list[float]()
        monkeypatch.setattr("autopilot.supervision.rudder_answer.response_step", self.step)

    def step(self, memory: ResponseState, *given: Any) -> ResponseState:
        self.taken.append(given)
        return memory._replace(time=given[3][0], **self.memory)

    def update(self, rudder: float, rate: float = 0.0, heard: bool = True, **change: Any) -> str:
        now = TICK * self.number
        if heard:
            self.watch.on_sample(HeadingSample(now, 1.0e-3 * self.number, None, change.pop("source", "compass")))
        state = NavState(now, 0.0, rate, 4.0, rudder, 0.0, 0.0, True, wave_deviation=0.03, wave_frequency=0.9)
        seen = MonitorInput(now, BOAT, state, True, True, 0.0, rudder, STOP, True, follows=True)._replace(**change)
        found = self.watch.found(seen)
        if self.watch.doubts_trial:
            self.doubts.append(now)
        self.number += 1
        return found


def test_the_prediction_uses_the_rudder_midway_and_0_4_s_before(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Of headings at every other tick the middle is the tick between; 0.4 s before that the later of two counts."""
    looks = Looks(monkeypatch)
    for number in range(41):
        looks.update(0.01 * number, heard=number % 2 == 0, holds_course=False)
    assert len(looks.taken) == 20
    for number, (model, noise, _, heard, (rudder, late, slow, *_)) in enumerate(looks.taken, 1):
        assert (model, slow) == (BOAT, rudder), "a slow rudder is out of question"
        assert noise == noise_of(0.03, 0.9)
        assert heard == (2 * number * TICK, 2.0e-3 * number)
        assert rudder == pytest.approx(0.01 * (2 * number - 1))
        assert late == pytest.approx(0.01 * max(2 * number - 1 - 3, 0))


@pytest.mark.parametrize(("rate", "taken"), [(0.299, 0.299), (0.301, 0.3), (-9.0, -0.3), (-0.299, -0.299)])
def test_no_boat_turns_more_than_twice_as_fast_as_the_rudder_turns_it(
    monkeypatch: pytest.MonkeyPatch, rate: float, taken: float
) -> None:
    """K 0.3 1/s and 0.5 rad of rudder: 0.15 rad/s."""
    looks = Looks(monkeypatch)
    for _ in range(3):
        looks.update(0.1, rate)
    assert [given[2] for given in looks.taken] == pytest.approx([taken, taken])


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_slow_rudder_would_go_a_quarter_as_fast(monkeypatch: pytest.MonkeyPatch, side: float) -> None:
    """From amidships to 0.03 rad at 0.08/4 rad/s: 0.0025 rad a tick."""
    looks = Looks(monkeypatch, 0.08)
    looks.update(0.0)
    for _ in range(20):
        looks.update(side * 0.03)
    assert [given[4][2] for given in looks.taken] == pytest.approx([side * min(0.0025 * n, 0.03) for n in range(1, 21)])
    looks.update(side * 0.03, rudder_is_measured=True)
    assert looks.taken[-1][4][2] == looks.taken[-1][4][0]
    looks.update(side * 0.2)
    assert looks.taken[-1][4][2] == side * 0.2, "where it is known to stand"


@pytest.mark.parametrize(
    ("ticks", "change", "is_taken"),
    [(7, {}, True), (8, {}, True), (9, {}, False), (1, {"source": "gyro"}, False)],
)
def test_after_a_second_without_a_heading_and_with_another_compass_it_begins_anew(
    monkeypatch: pytest.MonkeyPatch, ticks: int, change: dict[str, Any], is_taken: bool
) -> None:
    looks = Looks(monkeypatch)
    looks.update(0.1)
    for _ in range(ticks - 1):
        looks.update(0.1, heard=False)
    looks.update(0.1, **change)
    assert len(looks.taken) == is_taken


def test_for_a_second_after_a_late_tick_nothing_is_evidence(monkeypatch: pytest.MonkeyPatch) -> None:
    looks = Looks(
        monkeypatch, reversed=99.0, reversed_late=99.0, blocks=accused(0.0, 0.0, 0.0, 9.0).blocks, since=(-1.0, 1.0)
    )
    looks.update(0.1, is_late=True)
    assert [looks.update(0.1) for _ in range(10)] == [""] * 8 + ["rudder_reversed"] * 2


@pytest.mark.parametrize(
    ("learns", "change", "memory"),
    [
        (True, {}, {}),
        (False, {"holds_course": False}, {}),
        (True, {"wanted": math.radians(9.0)}, {}),
        (False, {"wanted": math.radians(11.0)}, {}),
        (False, {}, {"stuck": 3.0}),
        (False, {}, {"reversed": 3.0}),
        (False, {}, {"blocks": accused(0.0, 3.0).blocks}),
        (False, {}, {"blocks": accused(0.0, 0.0, 0.0, 3.0).blocks}),
    ],
)
def test_a_sea_that_the_rudder_works_against_is_larger_than_what_it_leaves(
    monkeypatch: pytest.MonkeyPatch, learns: bool, change: dict[str, Any], memory: dict[str, float]
) -> None:
    """By the rudder's own mean square, learnt near a course, while nothing is suspect."""
    looks = Looks(monkeypatch, **memory)
    for number in range(400):
        looks.update(0.1 * math.sin(0.9 * TICK * number), **change)
    noise = looks.taken[-1][1]
    worked = noise.sea - noise_of(0.03, 0.9).sea
    share = -math.expm1(-400 * TICK / WORKED_TIME)
    assert worked == pytest.approx(0.5 * 0.1**2 * share if learns else 0.0, rel=0.15, abs=1e-6)


@pytest.mark.parametrize(
    ("before", "is_known"),
    [({"steers": False}, True), ({"has_way": False}, True), ({"steers": False, "state": in_waves(0.0)}, False)],
)
def test_a_sea_may_be_larger_on_a_course_until_it_was_estimated_for_a_while(
    monkeypatch: pytest.MonkeyPatch, before: dict[str, Any], is_known: bool
) -> None:
    """Engaged, or without way, or not yet: it is estimated where there are headings."""
    looks, known = Looks(monkeypatch), noise_of(0.03, 0.9)
    before = {**before, "state": before["state"]._replace(valid=False)} if "state" in before else before
    for _ in range(240):
        looks.update(0.0, **before)
    for _ in range(2):
        looks.update(0.0)
    begun = 0 if is_known else 240
    more = SEA_FIRST * math.exp(-(looks.number - 1 - begun) * TICK / SEA_FIRST_TIME)
    noise = looks.taken[-1][1]
    assert noise.unmet == pytest.approx(more)
    assert noise._replace(unmet=0.0) == known, "the filter supposes the sea that is estimated"
    looks.update(0.0, holds_course=False)
    assert looks.taken[-1][1] == known


def test_a_sea_that_may_be_larger_takes_from_the_evidence_and_from_nothing_else() -> None:
    """To more than a quarter, where three times as much may come beside the sea: there is the push, too. What is learnt
    of boat and sea is the same."""
    surely, perhaps = first_response(NOISE, 0.0, 0.0), first_response(NOISE, 0.0, 0.0)
    for number in range(1, 7):
        newest, at = (number * DT, -1.0e-3 * number**2), (0.2, 0.2, 0.2, 0.0, 1.0)
        surely = response_step(surely, BOAT, NOISE, 0.0, newest, at)
        perhaps = response_step(perhaps, BOAT, NOISE._replace(unmet=3.0 * NOISE.sea), 0.0, newest, at)
    sums = ("stuck", "stuck_late", "reversed", "reversed_late")
    for name in sums:
        assert 0.25 * getattr(surely, name) < getattr(perhaps, name) < 0.99 * getattr(surely, name)
    for more, less in zip((*surely.gust[1:], *surely.added), (*perhaps.gust[1:], *perhaps.added), strict=True):
        assert 0.25 * abs(more) < abs(less) < 0.99 * abs(more)
    assert perhaps._replace(**{name: getattr(surely, name) for name in (*sums, "gust", "added")}) == surely


@pytest.mark.parametrize("share", [1.0, 0.0])
def test_what_a_turn_tells_is_neither_forgotten_nor_begun_anew(share: float) -> None:
    added, sums, summed = NOTHING_ADDED, [0.0, 0.0, 0.0], 0.0
    for memory, _ in sailed(share, 0.0, 0.75, seconds=20.0):
        added = since_turning(added, memory, True)
        sums = [total + more for total, more in zip(sums, memory.added, strict=True)]
        summed = max(math.exp(-DT / 20.0) * summed + memory.added[0], 0.0)
        assert memory.stuck == pytest.approx(summed), "that which is forgotten"
    assert added == pytest.approx(sums)
    # no more than 13.5 of it are left of a fault that may begin at any time
    assert min(added) > 18.0 if share == 0.0 else max(added) < -25.0
    assert since_turning(added, memory, False) == NOTHING_ADDED


def test_a_late_tick_tells_a_turn_nothing_against_the_rudder() -> None:
    after = first_response(NOISE, 0.0, 0.0)._replace(added=(0.5, -0.5, 0.3))
    assert without_evidence(first_response(NOISE, 0.0, 0.0), after).added == (0.0, -0.5, 0.0)


def test_a_turn_tells_of_a_stuck_rudder_whatever_the_sea_is() -> None:
    response = first_response(NOISE, 0.0, 0.0)
    for added, wanted in (((8.0, 8.0, 8.0), 1), ((7.9, 8.0, 8.0), 0), ((8.0, 7.9, 8.0), 0), ((8.0, 8.0, 7.9), 0)):
        assert verdict_at(Evidence(response=response, added=added), 1.0, False) == wanted
    opposite = response._replace(since=(-1.0, 1.0))
    assert verdict_at(Evidence(response=opposite, added=(8.0, 8.0, 8.0)), 1.0, False) == -1


def test_a_turn_that_was_answered_accuses_no_rudder_until_the_sea_is_known() -> None:
    begun, known = NO_SEAWAY._replace(begun=0.0), 15.8
    evidence = Evidence(response=accused(99.0, 99.0), seaway=begun)
    for added in ((-0.1, 1.0, 1.0), (1.0, -0.1, 1.0), (1.0, 1.0, -0.1)):
        answered = evidence._replace(added=added)
        found = [verdict_at(answered, *at) for at in ((1.0, False), (1.0, True), (known, False))]
        assert found == [0, 1, 1]
    assert verdict_at(evidence._replace(added=(0.1, 0.1, 0.1)), 1.0, False) == 1


@pytest.mark.parametrize(("rudder", "push"), [(0.0, 0.1), (0.1, 0.0), (0.1, -0.05)])
def test_what_pushes_a_boat_that_others_steer_is_known_as_we_engage(rudder: float, push: float) -> None:
    """Where its rudder is reported: nobody knows by whom it was turned otherwise."""
    watch, history, heading, rate = rudder_watch.State(), RudderHistory(), 0.0, 0.0
    limits, report = (
        AlarmLimits(heading_noise=NOISE.heading, rudder_response=True),
        RudderSample(0.0, 0.0, ordered=True),
    )
    for tick in range(1, 160):
        now = DT * tick
        for _ in range(10):
            rate += 0.1 * DT * (BOAT.gain * (rudder + push) - BOAT.n1 * rate - BOAT.n3 * rate**3) / BOAT.time_constant
            heading += 0.1 * DT * rate
        state = NavState(now, heading, rate, 4.0, rudder, 0.0, 0.0, True, wave_deviation=0.01, wave_frequency=0.9)
        seen = MonitorInput(now, BOAT, state, False, False, 0.0, rudder, STOP, True)
        ring = history.until(seen)
        heard = Measured((HeadingSample(now, heading),), report=report._replace(time=now, angle=rudder))
        watch, found = rudder_watch.update(limits, watch, seen, heard, ring)
        assert not found
    response = watch.response.evidence.response
    assert response.means[0][2] == pytest.approx(push, abs=0.3 * abs(rudder) + 0.01)
    assert response.means[1:] == NOTHING_KNOWN.response.means[1:]
    assert (response.stuck, response.reversed, response.since, response.added) == (0.0, 0.0, (0.0, 0.0), NOTHING_ADDED)
    silent, _ = rudder_watch.update(limits, watch, seen._replace(now=now + 2.0), heard._replace(headings=()), ring)
    assert math.isnan(silent.response.evidence.response.time), "the report is old"


@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.parametrize(
    ("rudder", "push", "is_doubted"), [(0.2, 0.21, True), (0.2, 0.19, False), (-0.2, 0.21, False), (0.0, 0.21, False)]
)
def test_a_trial_is_doubted_where_a_push_holds_against_its_rudder_once_the_sea_is_known(
    monkeypatch: pytest.MonkeyPatch, side: float, rudder: float, push: float, is_doubted: bool
) -> None:
    """Known after 2 pi/0.4 = 15.71 s, and then for 0.3 s: at 15.75 s, the first tick after, and 0.375 s later. It is
    said in one tick of a trial."""
    still = pushed(0.0)
    looks = Looks(monkeypatch, means=((0.0, 0.0, -side * push, 0.0), *[NOTHING] * 4), covariance=still)
    for _ in range(160):
        looks.update(side * rudder, follows=False)
    assert looks.doubts == ([16.125] if is_doubted else [])
    looks.update(side * rudder)
    for _ in range(4):
        looks.update(side * rudder, follows=False)
    assert looks.doubts == ([16.125, 164 * TICK] if is_doubted else []), "and in the next one"


def test_a_rudder_on_its_way_from_one_side_to_the_other_is_not_held_off(monkeypatch: pytest.MonkeyPatch) -> None:
    """As far as it was over within the last 2.4 s counts."""
    still = pushed(0.0)
    looks = Looks(monkeypatch, means=((0.0, 0.0, -0.2, 0.0), *[NOTHING] * 4), covariance=still)
    for number in range(200):
        looks.update(0.25 if number <= 144 else 0.1, follows=False)
    # the last of 0.25 rad at 18 s is forgotten at 20.5 s, the first tick more than 2.4 s later
    assert looks.doubts == [20.875]


def test_a_second_heading_of_the_same_instant_says_nothing_of_colour() -> None:
    before = sailed(1.0, 0.0, 0.75, 5.0)[-1][0]
    after = response_step(before, BOAT, NOISE, 0.0, (before.time, before.means[0][0] + 0.01), (0.1, 0.1, 0.1, 0.0, 1.0))
    assert (after.others.fit, after.others.left, after.others.colour) == (
        before.others.fit,
        before.others.left,
        before.others.colour,
    )


def stepped(share: float, seen: float, **change: Any) -> tuple[ResponseState, ResponseState]:
    """What is known before and after a heading that is off by a share of the answer to the rudder, of which `seen`
    [rad] could be seen before."""
    before = sailed(1.0, 0.0, 0.75, 6.0)[-1][0]
    others = {name: change.pop(name) for name in tuple(change) if name in Others._fields}
    mean, _, late, slide, slow = before.means
    means = mean, (seen, 0.0, 0.0, 0.0), late, slide, change.pop("slow", slow)
    before = before._replace(others=before.others._replace(**others), means=means, **change)
    (mean, *_), (answer, *_), *_ = all_moved(transition_of(BOAT, 0.1, NOISE.pace, DT), means, (0.3, 0.0, 0.0, 0.0))
    after = response_step(
        before, BOAT, NOISE, 0.1, (before.time + DT, mean + share * answer), (0.3, 0.3, 0.3, 0.0, 1.0)
    )
    return before, after


@pytest.mark.parametrize(("odd", "is_gust"), [(2.99, False), (3.0, False), (3.01, True)])
def test_a_gust_is_three_times_what_any_answer_explains(odd: float, is_gust: bool) -> None:
    before, after = stepped(0.0, 0.05, unexplained=odd, stuck=1.0)
    grown = (after.covariance[7] - before.covariance[7]) / DT
    assert grown == pytest.approx(math.radians(25.0) ** 2 if is_gust else 0.0, abs=0.1 * math.radians(25.0) ** 2)
    assert (after.stuck > 1.0) is not is_gust, "while it sets in nothing is evidence"


@pytest.mark.parametrize(("sigmas", "is_wild"), [(5.99, False), (6.01, True), (-5.99, False), (-6.01, True)])
def test_six_deviations_beyond_every_answer_are_wild(sigmas: float, is_wild: bool) -> None:
    memory = first_response(NOISE, 0.0, 0.1)
    step = transition_of(BOAT, 0.0, NOISE.pace, DT)
    covariance, *_ = foreseen(step, memory.covariance, memory.means, (0.0, 0.0, 0.0, 0.0), NOISE[:4], DT)
    off = sigmas * math.sqrt(covariance[0] + NOISE.heading)
    after = response_step(memory, BOAT, NOISE, 0.0, (DT, 0.1 + off), (0.0, 0.0, 0.0, 0.0, 1.0))
    assert after.outliers == is_wild


@pytest.mark.parametrize("name", ["stuck", "reversed"])
@pytest.mark.parametrize(("evidence", "learns"), [(1.9, True), (2.1, False)])
def test_with_evidence_of_two_nothing_is_learnt(name: str, evidence: float, learns: bool) -> None:
    before, after = stepped(1.0, 0.05, **{name: evidence + 0.8 * (name == "stuck")})
    assert (after.shown > before.shown) is learns
    assert (after.usual > before.usual) is learns


@pytest.mark.parametrize("name", ["stuck", "reversed"])
@pytest.mark.parametrize(("evidence", "learns"), [(1.9, True), (2.1, False)])
@pytest.mark.parametrize("is_known", [True, False])
def test_with_evidence_of_two_by_headings_a_known_sea_is_not_learnt_anew(
    name: str, evidence: float, learns: bool, is_known: bool
) -> None:
    """What a rudder that ran hard over did to the boat was learnt in blocks as a sea, 2 s before it was found."""
    known = math.exp(-SEA_KNOWN_S / 60.0) * 10.0 + (1.0 - math.exp(-SEA_KNOWN_S / 60.0)) / (1.0 - math.exp(-0.5 / 60.0))
    memory = first_response(NOISE, 0.0, 0.1)
    begun, many, sums, past, apart, _, lately, more = memory.blocks.spectrum
    spectrum = begun, many, sums, past, apart, known + (0.1 if is_known else -9.0), lately, more
    memory = memory._replace(blocks=memory.blocks._replace(spectrum=spectrum))
    for tick in range(1, 23):
        memory = memory._replace(stuck=evidence * (name == "stuck"), reversed=evidence * (name == "reversed"))
        memory = response_step(memory, BOAT, NOISE, 0.0, (DT * tick, 0.1), (0.0, 0.0, 0.0, 0.0, 1.0))
    assert (memory.blocks.spectrum[4] != spectrum[4]) is (learns or not is_known)
    assert memory.blocks.spectrum[7] == (0.0 if learns or not is_known else 5.0), "it is kept, and learnt behind it"


@pytest.mark.parametrize(("misfit", "counts"), [(2.99, True), (3.01, False)])
def test_what_is_three_times_as_strange_is_not_what_turns_the_boat(misfit: float, counts: bool) -> None:
    """Over a time constant, 4 s; a heading as far to the answer's side as that of a quick boat is not strange."""
    kept = math.exp(-DT / 4.0)
    _, after = stepped(6.0, 0.01, misfit=misfit / kept, lively=(1.0, 1.0), quick=(1.0, 1.0))
    assert (after.others.lively[0] > 1.0, after.others.quick[0] > 1.0) == (counts, counts)
    slow = (0.02, 0.0, 0.0, 0.0)
    _, after = stepped(2.0, 0.01, misfit_slow=misfit / kept, slow=slow, weak=1.0, right=1.0)
    assert (after.others.weak > 1.0, after.others.right > 1.0) == (counts, counts), "nor what a slow rudder explains"


WAVES = noise_of(0.01, 0.6)


def evidence_after(number: int) -> tuple[float, float, float, float, float]:
    """Of a boat that turns beside its rudder, with a wild heading now and then."""
    memory = first_response(NOISE, 0.0, 0.1)
    for tick in range(1, number):
        now = DT * tick
        heading, rudder = 0.1 + 0.3 * math.sin(now) + (2.0 if tick % 50 == 0 else 0.0), 0.1 * math.sin(now)
        memory = response_step(memory, BOAT, WAVES, 0.01, (now, heading), (rudder, 0.9 * rudder, rudder, 0.0, 1.0))
    return memory.stuck, memory.reversed, memory.blocks.stuck, memory.blocks.reversed, memory.others.colour


def test_compiled_evidence_is_the_same() -> None:
    """benchmarks/rudder_response.py compiles it; numba knows no defaults of a record, no `_replace` and no stars."""
    pytest.importorskip("numba")
    assert compiled(evidence_after)(400) == pytest.approx(evidence_after(400), rel=1e-9)


def judged_turn(share: float, drag: float, slides: bool) -> tuple[int, float]:
    """The verdict and when it came [s], over a turn, its counter-rudder and a longer turn, of a boat that answers by a
    share and is braked by so much of its rate as it slides; slides: whether the monitor reckons with that."""
    random = np.random.default_rng(7)
    memory, heading, rate, slid, slide = first_response(NOISE, 0.0, 0.0), 0.0, 0.0, 0.0, 0.0
    for tick in range(1, 150):
        now = DT * tick
        rudder, late = (
            0.0 if at < 2.0 else 0.3 if at < 6.0 else -0.3 if at < 9.0 else 0.3 if at < 16.0 else 0.6
            for at in (now, now - 0.4)
        )
        for _ in range(10):
            slid += 0.1 * DT * (drag * rate - slid) / 6.0
            rate += 0.1 * DT * (0.3 * share * rudder - rate - rate**3 - slid) / 4.0
            heading += 0.1 * DT * rate
        slide = slide_step(BOAT, slide, rate, 0.6, DT) if slides else 0.0
        shown = heading + 0.005 * random.standard_normal()
        memory = response_step(memory, BOAT, NOISE, rate, (now, shown), (rudder, late, rudder, slide, 1.0))
        if verdict(memory, IN_A_TURN):
            return verdict(memory, IN_A_TURN), now
    return 0, math.inf


def test_a_boat_that_slides_in_its_turn_is_not_stuck() -> None:
    assert judged_turn(1.0, 6.0, slides=False)[0] != 0
    assert judged_turn(1.0, 6.0, slides=True)[0] == 0


@pytest.mark.parametrize("share", [0.0, -1.0])
def test_a_rudder_that_is_stuck_or_reversed_is_found_as_soon_though_boats_slide(share: float) -> None:
    found, when = judged_turn(share, 0.0, slides=True)
    assert found != 0
    assert when <= judged_turn(share, 0.0, slides=False)[1]


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_slide_brakes_the_boat_up_to_the_rudders_worth_and_outlasts_the_turn(side: float) -> None:
    own = side * (1.0 + 0.1**2) * 0.1 / 0.3
    assert slide_step(BOAT, 0.0, side * 0.1, 0.6, 1e3) == pytest.approx(-own)
    assert slide_step(BOAT, 0.0, side * 9.0, 0.6, 1e3) == -side * 0.6
    assert slide_step(BOAT, 0.0, side * 0.1, 0.6, 4.0) == pytest.approx(-own * (1.0 - math.exp(-1.0)))
    assert slide_step(BOAT, -0.3 * side, 0.0, 0.6, 16.0) == pytest.approx(-0.3 * side * math.exp(-1.0))
