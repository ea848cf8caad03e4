"""Gains of the feedback particle filter that follow the density: Galerkin, in polynomials, and kernel, from a diffusion
map. div(p grad phi) = -g p solved for p known only by its particles.

Each works in the particles' own coordinates y = L^-1 (x - mean), covariance L L', so that units do not matter; carried
back, K = L grad_y phi solves the same equation. No gain brings the identification of a boat nearer than the constant
one (results/identification.md); they serve densities that are not Gaussian.
"""

from __future__ import annotations

from functools import lru_cache
from itertools import combinations_with_replacement
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from autopilot.identification.feedback_particle import FloatArray, Moved, damped

ISOLATED = 1.0e-6
"""Share of phi that a particle forgets: far below any error of the gain."""


class Gain(Protocol):
    """A way to solve the gain's equation."""

    def steer(self, particles: FloatArray, g: FloatArray, innovation: FloatArray) -> FloatArray:
        """Return sum_j K_j innovation_j, shape (N, d): K_j solves the equation for g_j, zero mean, shape (N, m)."""


class GalerkinGain(NamedTuple):
    """phi as a polynomial in the particles' own coordinates, of total degree `degree` and with at most `mixed`
    coordinates in a term: mean(grad psi_k . grad psi_l) c_l = mean(psi_k g). Degree 1 is the constant gain.

    Source: Yang, Mehta and Meyn 2013, section on the Galerkin approximation.
    """

    degree: int = 2
    mixed: int = 2

    def steer(self, particles: FloatArray, g: FloatArray, innovation: FloatArray) -> FloatArray:
        """Return sum_j K_j innovation_j, shape (N, d)."""
        y, L = own_coordinates(particles)
        N, d = y.shape
        values, slopes = _polynomials(y, _growths(d, self.degree, self.mixed))
        A = np.sum(slopes @ slopes.transpose(0, 2, 1), axis=0) / N
        A[np.diag_indices_from(A)] *= 1.0 + 1.0e-9
        coefficients = np.linalg.solve(A, values @ g / (N - 1))
        along = np.einsum("ekn,kn->en", slopes, coefficients @ innovation.T)
        return np.asarray((L @ along).T)


class KernelGain(NamedTuple):
    """phi by the diffusion map of a Gaussian kernel exp(-|y - y'|^2/(4 eps)): phi = T phi + eps g, T the kernel's
    Markov matrix, and grad phi from T's own differences. A wide kernel gives the constant gain.

    bandwidth: eps, in the square of the particles' own standard deviation. Source: Taghvaei, Mehta and Meyn 2020,
    "Diffusion map-based algorithm for gain function approximation in the feedback particle filter".
    """

    bandwidth: float = 0.3

    def steer(self, particles: FloatArray, g: FloatArray, innovation: FloatArray) -> FloatArray:
        """Return sum_j K_j innovation_j, shape (N, d)."""
        y, L = own_coordinates(particles)
        T, stationary = _markov(y, self.bandwidth)
        source = self.bandwidth * (g - stationary @ g)
        # a particle that none is near has no neighbours to tell its phi from: the small share keeps it solvable
        system = (1.0 + ISOLATED) * np.eye(y.shape[0]) - T + stationary[None, :]
        r = np.linalg.solve(system, source) + source
        around, pulled = T @ y, T @ r
        velocity = np.zeros_like(y)
        for j in range(g.shape[1]):
            slope = T @ (r[:, [j]] * y) - around * pulled[:, [j]]
            velocity += slope * innovation[:, [j]] / (2.0 * self.bandwidth)
        return np.asarray(velocity @ L.T)


def _markov(y: FloatArray, bandwidth: float) -> tuple[FloatArray, FloatArray]:
    """Return the diffusion map's Markov matrix T, shape (N, N), and its stationary distribution, shape (N,)."""
    squares = np.sum(y * y, axis=1)
    distance = np.maximum(squares[:, None] + squares[None, :] - 2.0 * (y @ y.T), 0.0)
    kernel = np.exp(-distance / (4.0 * bandwidth))
    weight = 1.0 / np.sqrt(kernel.sum(axis=1))
    kernel *= weight[:, None] * weight[None, :]
    mass = kernel.sum(axis=1)
    return kernel / mass[:, None], np.asarray(mass / mass.sum())


def own_coordinates(particles: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the particles with zero mean and unit covariance, shape (N, d), and L with x = mean + L y."""
    around = particles - particles.mean(axis=0)
    covariance = np.atleast_2d(around.T @ around) / (particles.shape[0] - 1)
    size = np.sqrt(np.diag(covariance)) + 1.0e-300
    # scaled first: standard deviations may be orders of magnitude apart, and some particles may lie on a plane
    values, vectors = np.linalg.eigh(covariance / np.outer(size, size))
    root = np.sqrt(np.maximum(values, 1.0e-12 * values[-1]))
    return (around / size) @ (vectors / root), np.asarray(size[:, None] * vectors * root)


class _Growth(NamedTuple):
    """How the monomials of one total degree come from those of the degree below: by which of them, shape (k,), is
    multiplied with which coordinate, shape (k,)."""

    parent: NDArray[np.intp]
    by: NDArray[np.intp]


@lru_cache
def _growths(d: int, degree: int, mixed: int) -> tuple[_Growth, ...]:
    """Return the growths up to `degree` from 1, of monomials with at most `mixed` different coordinates."""
    below: list[tuple[int, ...]] = [()]
    growths = []
    for total in range(1, degree + 1):
        terms = [t for t in combinations_with_replacement(range(d), total) if len(set(t)) <= mixed]
        places = {term: place for place, term in enumerate(below)}
        parents = np.array([places[term[:-1]] for term in terms], dtype=np.intp)
        growths.append(_Growth(parents, np.array([term[-1] for term in terms], dtype=np.intp)))
        below = terms
    return tuple(growths)


def _polynomials(y: FloatArray, growths: tuple[_Growth, ...]) -> tuple[FloatArray, FloatArray]:
    """Return the monomials at the particles, shape (k, N), and their gradients, shape (d, k, N)."""
    across = np.ascontiguousarray(y.T)
    d, N = across.shape
    value, slope = np.ones((1, N)), np.zeros((d, 1, N))
    values, slopes = [], []
    for parent, by in growths:
        factor, before = across[by], value[parent]
        slope = slope[:, parent] * factor
        slope[by, np.arange(by.size)] += before
        value = before * factor
        values.append(value)
        slopes.append(slope)
    return np.concatenate(values), np.concatenate(slopes, axis=1)


LARGEST_MOVE = 0.25
"""The gain is found anew after moves of this many standard deviations, root mean square."""


def moved_by(gain: Gain) -> Moved:
    """Return what moves the particles by a gain: it is found anew after moves of `LARGEST_MOVE`."""

    def moved(particles: FloatArray, h: FloatArray, z: FloatArray, step: float) -> tuple[float, FloatArray]:
        return _held_back(particles, gain.steer(particles, *damped(h, z, step)), step)

    return moved


def _held_back(particles: FloatArray, velocity: FloatArray, step: float) -> tuple[float, FloatArray]:
    """Return a step in which the particles move `LARGEST_MOVE` standard deviations rms at most, and velocities of
    which none goes beyond twice that: where there are few particles their gain is mostly chance."""
    speed = np.sqrt(np.mean((velocity / (particles.std(axis=0) + 1.0e-300)) ** 2, axis=1))
    step = min(step, LARGEST_MOVE / max(float(np.sqrt(np.mean(speed**2))), 1.0e-300))
    allowed = 2.0 * LARGEST_MOVE / step
    return step, velocity * np.minimum(1.0, allowed / np.maximum(speed, 1.0e-300))[:, None]
