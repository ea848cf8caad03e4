"""The evidence in the sea that was learnt: against matrices and Student's t, and what it spares a healthy rudder."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
import pytest
from scipy.linalg import solve_toeplitz
from scipy.stats import t as student
from watches import BOAT, DT, NOISE, MatrixFilter

from autopilot.models.norrbin import Norrbin
from autopilot.signals import NavState
from autopilot.supervision.response_filter import blocks_step, first_blocks, no_more_blocks, transition_of
from autopilot.supervision.rudder_answer import NO_SEAWAY, by_headings, enough, seaway_noise, verdict
from autopilot.supervision.rudder_response import ResponseState, first_response, response_step

Matrix = npt.NDArray[np.float64]
LEAST, USUAL, SLIDES = 0.6, 0.9, 0.3
RUDDERS = ("in time", "late", "braked", "slow")
SEAS = [(31, 5.0, 3), (79, 2.0, 2), (157, 5.0, 3), (162, 5.0, 3)]


class Judge(MatrixFilter):
    """The same by matrices: blocks of four headings at 5 Hz, from the first to the one more than half a second on."""

    def __init__(self, heading: float) -> None:
        super().__init__(heading, math.radians(2.0) ** 2, 0.5, RUDDERS)
        self.sums = dict.fromkeys(("silent", "silent_late", "opposite", "opposite_late"), 0.0)
        self.open: list[Matrix] = []
        self.past = [np.zeros(4)] * 4
        self.apart, self.weight = np.array([20.0, 10.0, 5.0, 2.0, 1.0]), 10.0
        self.lately, self.more = np.zeros(5), 0.0

    def on_sample(self, heading: float, rate: float, rudders: tuple[float, float, float, float]) -> None:
        off, sigma = self.predict(heading, rate, dict(zip(RUDDERS, rudders, strict=True)))
        self._weigh(off, sigma, *(float(self.answers[name][0]) for name in RUDDERS))
        self.correct(off)

    def _weigh(self, off: float, sigma: float, s: float, late: float, braked: float, slow: float) -> None:
        shares = np.linspace(-1.6, 1.6, 20001)
        strength = max((self.apart[0] + 5.0) / (self.weight + 5.0), 1.0)
        left = min(((off - shares * s) ** 2).min(), (off - slow) ** 2) / sigma**2 / strength
        is_gust = self.odd > 3.0
        self.odd += (1.0 - math.exp(-DT / 0.25)) * (min(left, 36.0) - self.odd)
        self.open.append(np.array([off, s, late, SLIDES * braked]) / sigma)
        if len(self.open) == 4:
            now, self.open = np.sum(self.open, axis=0) / 2.0, []
            odd = ((now[0] - shares * now[1]) ** 2).min()
            self._close(now, is_gust or odd > 3.0 * strength)

    def _close(self, now: Matrix, is_gust: bool) -> None:
        r = (self.apart + np.array([5.0, 0.0, 0.0, 0.0, 0.0])) / (self.weight + 5.0)
        weights = solve_toeplitz(r[:4], r[1:])
        sigma = math.sqrt(r[0] - weights @ r[1:])
        z, s, late, braked = now - weights @ np.array(self.past)
        left = [block[0] - USUAL * block[1] - block[3] for block in (now, *self.past)]
        self.lately, self.more = self.lately + left[0] * np.array(left), self.more + 1.0
        self.past = [now, *self.past[:3]]
        for name, answers, other in (
            ("silent", LEAST * s + braked, 0.0),
            ("silent_late", LEAST * late, 0.0),
            ("opposite", LEAST * s + braked, -0.7 * s),
            ("opposite_late", LEAST * late, -0.7 * late),
        ):
            more = student.logpdf(z - other, 6, scale=sigma) - student.logpdf(z - answers, 6, scale=sigma)
            faded = math.exp(-0.5 / 20.0) * self.sums[name]
            self.sums[name] = max(faded + min(more, 0.0 if is_gust else 5.0), 0.0)
        if max(self.sums["silent"], self.sums["opposite"]) < 1.0:
            kept = math.exp(-0.5 * self.more / 60.0)
            self.apart, self.weight = kept * self.apart + self.lately, kept * self.weight + self.more
            self.lately, self.more = np.zeros(5), 0.0


@pytest.mark.parametrize("share", [1.0, 0.0, -1.0, 2.0])
def test_the_evidence_of_blocks_is_the_difference_of_log_likelihoods(share: float) -> None:
    random = np.random.default_rng(8)
    memory, judge = first_blocks(NOISE, 0.1), Judge(0.1)
    heading, rate, trail, slide = 0.1, 0.0, 0.0, 0.0
    for tick in range(1, 200):
        now = DT * tick
        order = 0.25 * math.copysign(1.0, math.sin(0.5 * now)) + 0.05 * math.sin(1.7 * now)
        late = 0.25 * math.copysign(1.0, math.sin(0.5 * (now - 0.4)))
        trail, slide = trail + 0.1 * (order - trail), slide - 0.1 * (rate + slide)
        for _ in range(10):
            rate += 0.1 * DT * (0.3 * share * order - rate - rate**3) / 4.0
            heading += 0.1 * DT * rate
        shown, rudders = heading + 0.005 * random.standard_normal(), (order, late, slide, trail)
        moves = transition_of(BOAT, rate, NOISE.pace, DT)
        memory = blocks_step(memory, moves, NOISE, rudders, (now, DT, shown), (LEAST, USUAL, SLIDES, False))
        judge.on_sample(shown, rate, rudders)
        found = [value for mean in memory.means for value in mean]
        assert found == pytest.approx(np.concatenate([judge.x, *judge.answers.values()]), abs=1e-9)
        found = [memory.stuck, memory.stuck_late, memory.reversed, memory.reversed_late]
        assert found == pytest.approx(list(judge.sums.values()), abs=1e-6)
        assert memory.spectrum[4] == pytest.approx(judge.apart, abs=1e-6)
        assert (memory.unexplained, memory.outliers) == (pytest.approx(judge.odd, abs=1e-5), 0)
    assert (max(memory.stuck, memory.reversed) > 3.0) is (share <= 0.0)


@pytest.mark.parametrize("wild_so_far", [0, 3, 4])
def test_a_wild_heading_is_in_no_block(wild_so_far: int) -> None:
    before, moves = first_blocks(NOISE, 0.0), transition_of(BOAT, 0.0, NOISE.pace, DT)
    for tick in range(1, 50):
        before = blocks_step(before, moves, NOISE, (0.0,) * 4, (DT * tick, DT, 0.0), (LEAST, USUAL, SLIDES, False))
    before = before._replace(outliers=wild_so_far, stuck=3.0)
    after = blocks_step(before, moves, NOISE, (0.1,) * 4, (DT * 50, DT, 1.0), (LEAST, USUAL, SLIDES, False))
    assert (after.spectrum[1] == before.spectrum[1]) is (wild_so_far < 4)
    assert after.outliers == (wild_so_far + 1 if wild_so_far < 4 else 0)
    if wild_so_far < 4:
        assert (after.stuck, after.unexplained) == (3.0, before.unexplained)
        assert after.means[1][0] > 0.0 and after.covariance[0] > before.covariance[0]


def test_without_evidence_no_block_counts() -> None:
    low, high = first_blocks(NOISE, 0.0), first_blocks(NOISE, 0.5)
    four = ("stuck", "stuck_late", "reversed", "reversed_late")
    low, high = low._replace(**dict.fromkeys(four, 2.0)), high._replace(**dict.fromkeys(four, 5.0))
    high = high._replace(spectrum=(1.0, 2.0, *high.spectrum[2:]))
    kept = no_more_blocks(low, high)
    assert (kept.means, kept.spectrum[1]) == (high.means, 0.0)
    assert [getattr(kept, name) for name in four] == [2.0] * 4
    assert [getattr(no_more_blocks(high, low), name) for name in four] == [2.0] * 4


def sailed_in_waves(seed: int, gain: float, late: int, share: float, fails: float = math.inf) -> list[ResponseState]:
    """Half a minute, of 0.1 s each, from engaging a quick boat in waves of 0.1 rad of rudder and gusts of as much, of
    which nothing is known yet; the rudder is `late` by so many tenths, and answers by a share from `fails` [s] on."""
    boat, random = Norrbin(0.4, 0.7), np.random.default_rng(seed)
    calm = NavState(0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, True)
    noise = seaway_noise(boat, 3.0e-5, calm, NO_SEAWAY, 0.0, 0.0)
    paces, phases = 1.2 * (0.7 + 0.7 * random.random(6)), 2.0 * math.pi * random.random(6)
    memory, heading, rate, gust, past, found = first_response(noise, 0.0, 0.0), 0.0, 0.0, 0.0, [0.0] * 9, []
    for tick in range(1, 300):
        now = 0.1 * tick
        gust = 0.1 * random.standard_normal() if random.random() < 0.1 / 15.0 else gust
        past = [max(min(-gain * (heading + rate), 0.5), -0.5), *past[:-1]]
        moves = past[late] if now <= fails else share * past[late]
        for part in range(5):
            push = gust + 0.1 * math.sqrt(2.0 / 6.0) * float(np.sin(paces * (now + 0.02 * part) + phases).sum())
            rate += 0.02 / 0.7 * (0.4 * (moves + push) - rate)
            heading += 0.02 * rate
        shown = heading + 0.005 * random.standard_normal()
        memory = response_step(memory, boat, noise, rate, (now, shown), (past[2], past[6], past[2], 0.0, 1.0))
        found.append(memory)
    return found


@pytest.mark.parametrize(("seed", "gain", "late"), SEAS)
def test_a_healthy_rudder_is_not_accused_by_headings_alone(seed: int, gain: float, late: int) -> None:
    """Each of these boats was, by 10.4 and more."""
    sailed = sailed_in_waves(seed, gain, late, 1.0)
    assert max(max(by_headings(memory)) for memory in sailed) >= 10.4
    assert not any(verdict(memory, enough(0.0, True)) for memory in sailed)


@pytest.mark.parametrize(("seed", "gain", "late"), SEAS)
def test_in_the_same_waves_a_rudder_that_turns_the_wrong_way_is_found_in_5_s(seed: int, gain: float, late: int) -> None:
    sailed = sailed_in_waves(seed, gain, late, -1.0, fails=15.0)
    assert next(number for number, memory in enumerate(sailed) if verdict(memory, enough(0.0, True))) < 200
