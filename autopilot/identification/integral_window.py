"""The yaw equation integrated over the last L seconds, in constant memory, from samples at any times.

Norrbin's equation at the speed ratio s = U/U0, multiplied by s and integrated over a window, is linear in the
parameters at U0 and needs no yaw acceleration:

    n1 A = K D - T B - n3 C - n0 E
    A = int s dpsi,   B = change of r,   C = int r^3/s dt,   D = int s^2 delta dt,   E = int s^2 dt

At s = 1 that is the integrated equation of Liao et al., patent application of Harbin Engineering University (2019).
The window is a ring of means, and the equation is taken between means instead of between two instants: every term goes
through the same average, so it stays exact for the linear part, and the sensors' noise is averaged. Each mean is over
two neighbouring blocks, weighted like a tent (0 at the ends, 1 in the middle), for then the mean of the yaw rate is the
difference of the two blocks' mean headings: a rate from headings alone, without differencing single samples. From the
first mean to the last it is the equation over one window; from the mean of all of them to the last it is the mean of
the equations over all windows up to that length, which has less noise still, and does not vanish where the window is as
long as a zigzag's period.

The cube of the yaw rate from headings alone, for blocks so long that the boat turns round inside them.

A block is divided into parts; the differences of the parts' mean headings are the rates between them, taken to change
in straight lines. Their noise s makes the mean of a cube too large by 3 r s^2: that is taken off, s^2 coming from the
headings' second differences.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Collection, Sequence
from itertools import pairwise
from typing import NamedTuple

from autopilot.angles import wrap

PART_S = 0.75
"""Parts are of this length or up to twice it: shorter ones have more noise, longer ones do not follow the turns of a
zigzag."""

ROUGH_SAMPLES = 200
"""Over about so many samples the heading's noise is taken."""


class HeadingParts:
    """Means of the heading over the parts of blocks of `block` [s].

    roughness [rad^2 s]: the square of the headings' noise times their spacing, what a mean over a second keeps of it.
    """

    def __init__(self, block: float) -> None:
        self._count = max(int(block / PART_S), 1)
        self._length = block / self._count
        self.roughness = self._last_turned = self._last_dt = 0.0
        self._samples = 0
        self.begin()

    def begin(self) -> None:
        """Start a block."""
        self._angles, self._times = [0.0] * self._count, [0.0] * self._count

    def take(self, since: float, dt: float, before: float, turned: float) -> None:
        """Take an interval of `dt` [s] that begins `since` [s] after the block: from the heading `before` [rad] it has
        turned by `turned` [rad]."""
        if abs(dt - self._last_dt) < 0.1 * dt:
            # second differences of white noise have six times its square
            self._samples = min(self._samples + 1, ROUGH_SAMPLES)
            self.roughness += (dt * (turned - self._last_turned) ** 2 / 6.0 - self.roughness) / self._samples
        self._last_turned, self._last_dt = turned, dt
        slope, at, end = turned / dt, since, since + dt
        while at < end:
            part = min(int(at / self._length + 1.0e-9), self._count - 1)
            until = end if part == self._count - 1 else min(end, (part + 1) * self._length)
            self._angles[part] += (until - at) * (before + slope * (0.5 * (at + until) - since))
            self._times[part] += until - at
            at = until if until > at else end

    def means(self) -> tuple[float, ...]:
        """Return the mean heading [rad] of each part, none where a part has no sample or there is but one."""
        if self._count < 2 or not all(time > 0.0 for time in self._times):
            return ()
        return tuple(angle / time for angle, time in zip(self._angles, self._times, strict=True))


def cubed(first: Sequence[float], second: Sequence[float], span: float, roughness: float) -> tuple[float, float]:
    """Return int r^3 dt [rad^3/s^2] from the middle of the first of two blocks, which take `span` [s] together, to that
    of the second, and the mean of that integral with a weight which rises over the first and falls over the second;
    both blocks by the means of as many parts."""
    parts = [*first, *second]
    step, count = span / len(parts), len(first)
    noise = 3.0 * 2.0 * roughness / step**3
    inner = [(later - now) / step for now, later in pairwise(parts)]
    # at the ends, where the weight is next to nothing, the rate goes on as it did
    rates = [2.0 * inner[0] - inner[1], *inner, 2.0 * inner[-1] - inner[-2]]
    totals, mean = [0.0], 0.0
    for k, (now, later) in enumerate(pairwise(rates)):
        # the cube of a straight line
        whole = 0.25 * (now + later) * (now * now + later * later - 2.0 * noise) * step
        mean += min(k + 0.5, len(parts) - k - 0.5) * (totals[-1] + 0.5 * whole)
        totals.append(totals[-1] + whole)
    begun, ended = _between(totals, 0.5 * count), _between(totals, 1.5 * count)
    return ended - begun, mean / count**2 - begun


def _between(totals: Sequence[float], place: float) -> float:
    left = int(place)
    return totals[left] + (place - left) * (totals[left + 1] - totals[left])


BLOCKS = 12
"""Blocks in a window; more would follow the window's end closer, fewer average more."""

QUIETER_S = 3.0
"""Over blocks longer than this the mean headings' difference tells the mean rate better than measured rates do, at the
usual 0.2 deg and 0.1 deg/s of noise; and it knows no drift of a gyro."""

RATIO_LEAST = 0.2
"""Below this share of the reference speed nothing is learnt: the scaling with speed has no sense near rest."""


class Integrals(NamedTuple):
    """The terms of the integrated equation over one window that ends at `time` [s].

    turned A [rad], rate_change B [rad/s], cubed C [rad^3/s^2], driven D [rad s], elapsed E [s]. Beside them the range
    [rad] over which the rudder moved, and the mean square of the rate [rad^2/s^2].
    """

    time: float
    turned: float
    rate_change: float
    cubed: float
    driven: float
    elapsed: float
    rudder_range: float
    rate_square: float


class _Moments:
    """Mean over a block of something that moves in straight lines, and its mean with a weight that rises 0 to 1."""

    __slots__ = ("rising", "whole")

    def __init__(self) -> None:
        self.whole = self.rising = 0.0

    def add(self, since: float, dt: float, before: float, now: float) -> None:
        """Integrate from `since` [s] after the block's beginning over `dt` [s], from one value to the other."""
        part = 0.5 * dt * (before + now)
        self.whole += part
        self.rising += part * since + dt * dt * (before + 2.0 * now) / 6.0


class _Block(NamedTuple):
    span: float
    a: _Moments
    c: _Moments
    d: _Moments
    n: _Moments
    rate: _Moments | None
    mean: float
    headed: bool
    heading: float
    parts: tuple[float, ...]
    rudder: float
    ratio: float


class _Tent(NamedTuple):
    """Means of the integrals since the beginning and of the rate, and the rudder."""

    a: float
    b: float
    c: float
    d: float
    n: float
    rudder: float


class IntegralWindow:
    """Turns samples into `Integrals`, one each time a block is full.

    Args:
        length: L [s].  blocks: in a window.  longest_gap: samples further apart [s] begin a new window.
        from_mean: take the equations over all windows up to L, not over L alone.

    Memory: `blocks` means, whatever the sampling. Raises ValueError for a length that is not positive.
    """

    def __init__(
        self, length: float, blocks: int = BLOCKS, longest_gap: float = math.inf, *, from_mean: bool = False
    ) -> None:
        if not (0.0 < length < math.inf and blocks >= 1):
            raise ValueError(f"integral window: a length above 0 and a block at least, got {length} s and {blocks}")
        self.length = length
        self._blocks, self._block = blocks, length / blocks
        self._longest_gap = min(longest_gap, length)
        self._from_mean = from_mean
        self._ring: deque[_Tent] = deque(maxlen=blocks)
        self.reset()

    def reset(self) -> None:
        """Forget the window."""
        self._ring.clear()
        self._driven_at = self._moved_at = self._begun = -math.inf
        self._rudder = self._ratio = self._heading = self._rate = math.nan
        self._a = self._c = self._d = self._n = self._turned = 0.0
        self._has_rates = False
        self._before: _Block | None = None
        self._parts = HeadingParts(self._block)
        self._begin(0.0)

    def _begin(self, time: float) -> None:
        """Start a block: the running integrals go on, their own integrals over the block start at 0."""
        self._begun = time
        self._sum_a, self._sum_c, self._sum_d = _Moments(), _Moments(), _Moments()
        self._sum_n, self._sum_r = _Moments(), _Moments()
        self._sum_heading = 0.0
        self._parts.begin()
        self._rates_known = self._headings_known = True
        self._d_begun, self._n_begun, self._turned_begun = self._d, self._n, self._turned

    def update(
        self, time: float, rudder: float, ratio: float, heading: float | None = None, rate: float | None = None
    ) -> Integrals | None:
        """Take what is known at `time` [s]; return the equation of the window that a full block ends, else None.

        rudder [rad]; ratio: speed over reference speed; heading [rad], any turn of it; rate [rad/s]. Without both,
        only the rudder is integrated on; with either, the motion is too: by the heading where there is one, else by
        the rate. Times that do not increase are ignored, values that are not finite count as missing.
        """
        if not (math.isfinite(rudder) and ratio >= RATIO_LEAST):
            self.reset()
            return None
        heading, rate = _known(heading), _known(rate)
        if time - self._driven_at > self._longest_gap or time - self._moved_at > self._longest_gap:
            self._start(time, rudder, ratio, heading, rate)
            return None
        if not time > self._driven_at:
            return None
        self._drive(time, rudder, ratio)
        if heading is None and rate is None:
            return None
        self._move(time, ratio, heading, rate)
        return self._close(time) if time - self._begun >= self._block * (1.0 - 1.0e-9) else None

    def _start(self, time: float, rudder: float, ratio: float, heading: float | None, rate: float | None) -> None:
        self.reset()
        if heading is None and rate is None:
            return
        self._driven_at = self._moved_at = time
        self._rudder, self._ratio = rudder, ratio
        self._has_rates = rate is not None
        self._remember(heading, rate)
        self._begin(time)

    def _remember(self, heading: float | None, rate: float | None) -> None:
        self._heading = math.nan if heading is None else heading
        self._rate = math.nan if rate is None else rate

    def _drive(self, time: float, rudder: float, ratio: float) -> None:
        since, dt = self._driven_at - self._begun, time - self._driven_at
        square, squared = ratio * ratio, self._ratio * self._ratio
        d = self._d + 0.5 * dt * (square * rudder + squared * self._rudder)
        n = self._n + 0.5 * dt * (square + squared)
        self._sum_d.add(since, dt, self._d, d)
        self._sum_n.add(since, dt, self._n, n)
        self._d, self._n = d, n
        self._rudder, self._ratio, self._driven_at = rudder, ratio, time

    def _move(self, time: float, ratio: float, heading: float | None, rate: float | None) -> None:
        since, dt = self._moved_at - self._begun, time - self._moved_at
        turned = math.nan if heading is None else wrap(heading - self._heading)
        if math.isnan(turned):
            now = self._rate if rate is None else rate
            self._headings_known = False
            turned = 0.5 * dt * (now + (now if math.isnan(self._rate) else self._rate))
        if rate is None or math.isnan(self._rate):
            self._rates_known = False
        else:
            self._sum_r.add(since, dt, self._rate, rate)
        if self._has_rates:
            self._cube(since, dt, turned, ratio, rate)
        a = self._a + ratio * turned
        self._sum_a.add(since, dt, self._a, a)
        self._sum_heading += dt * (self._turned + 0.5 * turned)
        self._parts.take(since, dt, self._turned, turned)
        self._a, self._turned, self._moved_at = a, self._turned + turned, time
        self._remember(heading, rate)

    def _cube(self, since: float, dt: float, turned: float, ratio: float, rate: float | None) -> None:
        """Integrate the cube of measured rates; where one is missing the heading's slope stands in."""
        now = turned / dt if rate is None else rate
        before = now if math.isnan(self._rate) else self._rate
        c = self._c + 0.5 * dt * (now**3 + before**3) / ratio
        self._sum_c.add(since, dt, self._c, c)
        self._c = c

    def _close(self, time: float) -> Integrals | None:
        """End the block at `time` [s] and return the equation of the window that ends with it."""
        span = time - self._begun
        block = _Block(
            span=span,
            a=self._sum_a,
            c=self._sum_c,
            d=self._sum_d,
            n=self._sum_n,
            rate=self._sum_r if self._rates_known else None,
            mean=(self._turned - self._turned_begun) / span,
            headed=self._headings_known,
            heading=self._sum_heading / span,
            parts=self._parts.means(),
            rudder=(self._d - self._d_begun) / (self._n - self._n_begun),
            ratio=self._ratio,
        )
        before, self._before = self._before, block
        self._begin(time)
        if before is None:
            return None
        self._ring.append(self._tent(before, block))
        return self._window(time) if len(self._ring) == self._blocks else None

    def _tent(self, before: _Block, block: _Block) -> _Tent:
        """Return the means with a weight that rises over the block before and falls over this one."""
        half = 0.5 * (before.span + block.span)
        if before.rate is None or block.rate is None or (half > QUIETER_S and before.headed and block.headed):
            b = (block.heading - before.heading) / half
        else:
            b = _tent_mean(before.rate, block.rate, before.span, block.span)
        if self._has_rates:
            c = _tent_mean(before.c, block.c, before.span, block.span)
        else:
            added, mean = self._cubed(before, block, b)
            c, self._c = self._c + mean, self._c + added
        return _Tent(
            _tent_mean(before.a, block.a, before.span, block.span),
            b,
            c,
            _tent_mean(before.d, block.d, before.span, block.span),
            _tent_mean(before.n, block.n, before.span, block.span),
            block.rudder,
        )

    def _cubed(self, before: _Block, block: _Block, b: float) -> tuple[float, float]:
        """Return int r^3/s dt from the middle of one block to that of the next, and its mean over both."""
        span = before.span + block.span
        if before.parts and block.parts:
            added, mean = cubed(before.parts, block.parts, span, self._parts.roughness)
            return added / block.ratio, mean / block.ratio
        # the mean of the cube is more than the cube of the mean: 3 b times the variance of a straight line
        added = (b**3 + 0.5 * b * (block.mean - before.mean) ** 2) * 0.5 * span / block.ratio
        return added, 0.5 * added

    def _window(self, time: float) -> Integrals:
        last = self._ring[-1]
        pushes = [each.rudder for each in self._ring]
        a, b, c, d, n, _ = _mean(self._ring) if self._from_mean else self._ring[0]
        return Integrals(
            time=time,
            turned=last.a - a,
            rate_change=last.b - b,
            cubed=last.c - c,
            driven=last.d - d,
            elapsed=last.n - n,
            rudder_range=max(pushes) - min(pushes),
            rate_square=sum([each.b * each.b for each in self._ring]) / len(self._ring),
        )


def _tent_mean(before: _Moments, now: _Moments, rise: float, fall: float) -> float:
    return (before.rising / rise + now.whole - now.rising / fall) / (0.5 * (rise + fall))


def _known(value: float | None) -> float | None:
    return value if value is not None and math.isfinite(value) else None


def _mean(tents: Collection[_Tent]) -> _Tent:
    share = 1.0 / len(tents)
    return _Tent(*[share * sum(column) for column in zip(*tents, strict=True)])
