"""The cube of the yaw rate from headings alone, for blocks so long that the boat turns round inside them.

A block is divided into parts; the differences of the parts' mean headings are the rates between them, taken to change
in straight lines. Their noise s makes the mean of a cube too large by 3 r s^2: that is taken off, s^2 coming from the
headings' second differences.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

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
