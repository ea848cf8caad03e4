"""What is known of a boat when the weather of its recording is not: averages over all that the record allows."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.special import log_ndtr

from autopilot.identification.likelihood_record import IntArray
from autopilot.identification.likelihood_search import Space, inverse
from autopilot.identification.runs import FloatArray


class Known(NamedTuple):
    """Mean and covariance of what moves the boat, rates and train; how many draws of the weather they are worth; and
    the logarithm of the likelihood of the record in such weather, whatever its size, but for a constant."""

    mean: FloatArray
    covariance: FloatArray
    worth: float
    evidence: float


def mixed(found: Sequence[Known]) -> Known:
    """Return what is known where one of several kinds of weather, none likelier than another before, was there."""
    most = max(known.evidence for known in found)
    if len(found) == 1 or not math.isfinite(most):
        return found[0]
    weight = np.exp(np.array([known.evidence for known in found]) - most)
    return _mixture(
        weight, np.array([known.mean for known in found]), np.array([known.covariance for known in found])
    )._replace(evidence=most + math.log(float(weight.sum())))


def _mixture(weight: FloatArray, means: FloatArray, spreads: FloatArray) -> Known:
    share = weight / weight.sum()
    middle = share @ means
    apart = means - middle
    spread = np.tensordot(share, spreads, axes=1) + (apart * share[:, None]).T @ apart
    return Known(middle, spread, 1.0 / float(share @ share), math.log(float(weight.mean())))


class _Drawn(NamedTuple):
    """Of one weather: what was drawn, the boat's mean and covariance there, and the logarithm of its likelihood."""

    sky: FloatArray
    mean: FloatArray
    spread: FloatArray
    log: float


def averaged(space: Space, z: FloatArray, curvature: FloatArray, draws: int) -> Known:
    """Return mean and covariance of what moves the boat, over all weathers that the record allows.

    Given the weather, the boat is normally distributed about one step of Newton's from where the curvature puts it
    (Laplace). Weathers are drawn from Student's distribution about the best one, then about what those drawn say, and
    weighed by their likelihood over the density that they were drawn from (Geweke 1989; Cappe et al. 2004; nested as by
    Rue, Martino and Chopin 2009). That the size of gusts is itself in doubt, or that there may be none, is in the
    result.
    """
    boat = np.array(space.boat)
    sky = np.array(space.sky)
    width = np.array([space.priors[space.names[i]].width for i in sky])
    space.keep(z)
    follows = -inverse(space.slope(z, boat_only=True)[2]) @ curvature[np.ix_(boat, sky)]
    root = _sky_root(width, curvature[np.ix_(sky, sky)] + curvature[np.ix_(sky, boat)] @ follows)
    random, path, found, proposals = np.random.default_rng(SEED), space.path, list[_Drawn](), []
    middle = z[sky]
    for _ in range(ROUNDS):
        proposals.append((middle, root))
        normal = random.normal(size=(draws // (2 * ROUNDS), sky.size))
        stretch = np.sqrt(FREEDOM / random.chisquare(FREEDOM, size=normal.shape[0]))[:, None]
        for u in np.concatenate([np.zeros((1, sky.size)), normal * stretch, -normal * stretch]):
            at = z.copy()
            at[sky] = middle + root @ u
            at[boat] += follows @ (at[sky] - z[sky])
            space.path = path
            drawn = _boat_in(space, at, sky)
            if drawn is not None:
                found.append(drawn)
        if not found:
            mean, spread, _ = truncated(z[boat], inverse(space.slope(z, boat_only=True)[2]), space.boat.index(2))
            return Known(mean, spread, 1.0, -math.inf)
        logs = np.array([each.log for each in found])
        points = np.array([each.sky for each in found])
        density = _density(points, proposals)
        weight = np.exp(logs - density - np.max(logs - density))
        middle, root = _moved(points, weight, middle, root)
    space.path = path
    result = _mixture(weight, np.array([each.mean for each in found]), np.array([each.spread for each in found]))
    # of the widths of what was known before of the weather, and of what was drawn in vain
    scale = 0.5 * sky.size * math.log(2.0 * math.pi) + float(np.log(width).sum())
    share = len(found) / (ROUNDS * (2 * (draws // (2 * ROUNDS)) + 1))
    return result._replace(
        evidence=result.evidence + float(np.max(logs - density)) - scale + math.log(share),
    )


@np.errstate(over="ignore", invalid="ignore")
def _boat_in(space: Space, at: FloatArray, sky: IntArray) -> _Drawn | None:
    """Return the boat in the weather of `at`, looked for near the one there; None where it is nowhere near."""
    boat, cubic = np.array(space.boat), space.boat.index(2)
    for _ in range(NEWTON):
        loss, slope, known = space.slope(at, boat_only=True)
        if not (math.isfinite(loss) and np.isfinite(known).all() and float(np.min(np.diag(known))) > NOTHING_KNOWN):
            return None
        spread = inverse(known)
        step = -spread @ slope[boat]
        gained = -0.5 * float(step @ slope[boat])
        if gained < FAR:
            break
        at[boat] += step
    if not gained < FAR:
        return None
    volume = 0.5 * float(np.linalg.slogdet(spread)[1])
    mean, spread, share = truncated(at[boat] + step, spread, cubic)
    if not (math.isfinite(share) and np.isfinite(spread).all()):
        return None
    return _Drawn(at[sky], mean, spread, -loss + gained + volume + share)


def _density(points: FloatArray, proposals: Sequence[tuple[FloatArray, FloatArray]]) -> FloatArray:
    """Return the logarithm of the density that points were drawn from, shape (K,), all proposals alike."""
    count = points.shape[1]
    unit = math.lgamma(0.5 * (FREEDOM + count)) - math.lgamma(0.5 * FREEDOM) - 0.5 * count * math.log(FREEDOM * math.pi)
    logs = []
    for middle, root in proposals:
        u = np.linalg.solve(root, (points - middle).T)
        bent = -0.5 * (FREEDOM + count) * np.log1p((u * u).sum(axis=0) / FREEDOM)
        logs.append(unit + bent - float(np.linalg.slogdet(root)[1]))
    return np.asarray(np.logaddexp.reduce(np.array(logs), axis=0) - math.log(len(proposals)))


def _moved(
    points: FloatArray, weight: FloatArray, middle: FloatArray, root: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return middle and root of what to draw from next: half of what the draws say, half of what was believed.

    Weights are made more alike until they are worth more draws than there are numbers to tell.
    """
    tempered = weight
    for _ in range(MOST_TEMPER):
        tempered = tempered / tempered.sum()
        if 1.0 / float(tempered @ tempered) > points.shape[1] + 2.0:
            break
        tempered = np.sqrt(tempered)
    tempered = tempered / tempered.sum()
    found = tempered @ points
    off = points - found
    spread = 0.5 * ((off * tempered[:, None]).T @ off + root @ root.T)
    return found, np.linalg.cholesky(spread)


def _sky_root(width: FloatArray, curvature: FloatArray) -> FloatArray:
    """Return a root of the weather's covariance; what the record does not tell is as wide as it was before."""
    values, vectors = np.linalg.eigh(curvature * np.outer(width, width))
    return np.asarray(width[:, None] * vectors / np.sqrt(np.maximum(values, 1.0)))


NOTHING_KNOWN = 1.0e-100
NEWTON, FAR = 3, 2.0
"""Steps at most to the boat that suits a weather; one step may gain so much, in the likelihood's logarithm."""
SEED, FREEDOM = 1, 6.0
"""Of the draws: the generator's seed, and of Student's distribution."""
ROUNDS, MOST_TEMPER = 2, 10
"""So often draws are made, each time about what those before say; roots of the weights at most."""


def truncated(mean: FloatArray, covariance: FloatArray, index: int) -> tuple[FloatArray, FloatArray, float]:
    """Return mean and covariance of a normal distribution of which one component cannot be below 0, and the logarithm
    of its share above."""
    sigma = math.sqrt(max(float(covariance[index, index]), 1.0e-300))
    alpha = float(mean[index]) / sigma
    # phi(alpha)/Phi(alpha), without dividing nothing by nothing
    ratio = math.exp(-0.5 * alpha * alpha - 0.5 * math.log(2.0 * math.pi) - float(log_ndtr(alpha)))
    column = covariance[:, index] / sigma
    narrower = ratio * (ratio + alpha)
    return mean + column * ratio, covariance - np.outer(column, column) * narrower, float(log_ndtr(alpha))
