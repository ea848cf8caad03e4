"""Gains of the feedback particle filter: div(p grad phi) = -g p solved for p known only by its particles.

Each gain works in the particles' own coordinates y = L^-1 (x - mean), covariance L L', so that units do not matter;
carried back, K = L grad_y phi solves the same equation.
"""

from __future__ import annotations

from itertools import combinations_with_replacement
from typing import NamedTuple, Protocol

import numpy as np

from autopilot.filters.midpoint import FloatArray

ISOLATED = 1.0e-6
"""Share of phi that a particle forgets: far below any error of the gain."""


class Gain(Protocol):
    """A way to solve the gain's equation. varies: whether the gain differs from particle to particle."""

    @property
    def varies(self) -> bool:
        """Whether the gain differs from particle to particle."""

    def steer(self, particles: FloatArray, g: FloatArray, innovation: FloatArray) -> FloatArray:
        """Return sum_j K_j innovation_j, shape (N, d): K_j solves the equation for g_j, zero mean, shape (N, m)."""


class ConstantGain(NamedTuple):
    """K = cov(x, g): the best gain that is the same for all particles; Zheng et al. 2019, eq. (8)."""

    @property
    def varies(self) -> bool:
        """One gain for all."""
        return False

    def steer(self, particles: FloatArray, g: FloatArray, innovation: FloatArray) -> FloatArray:
        """Return sum_j K_j innovation_j, shape (N, d)."""
        around = particles - particles.mean(axis=0)
        return np.asarray(innovation @ (around.T @ g / (particles.shape[0] - 1)).T)


class GalerkinGain(NamedTuple):
    """phi as a polynomial in the particles' own coordinates, of total degree `degree` and with at most `mixed`
    coordinates in a term: mean(grad psi_k . grad psi_l) c_l = mean(psi_k g). Degree 1 is the constant gain.

    Source: Yang, Mehta and Meyn 2013, section on the Galerkin approximation.
    """

    degree: int = 2
    mixed: int = 2

    @property
    def varies(self) -> bool:
        """A linear phi has a constant gradient."""
        return self.degree > 1

    def steer(self, particles: FloatArray, g: FloatArray, innovation: FloatArray) -> FloatArray:
        """Return sum_j K_j innovation_j, shape (N, d)."""
        y, L = own_coordinates(particles)
        N, d = y.shape
        powers = _powers(d, self.degree, self.mixed)
        values, slopes = _polynomials(y, powers)
        flat = slopes.reshape(-1, len(powers))
        A = flat.T @ flat / N
        A[np.diag_indices_from(A)] *= 1.0 + 1.0e-9
        coefficients = np.linalg.solve(A, values.T @ g / (N - 1))
        return np.asarray(np.einsum("nek,nk->ne", slopes, innovation @ coefficients.T) @ L.T)


class KernelGain(NamedTuple):
    """phi by the diffusion map of a Gaussian kernel exp(-|y - y'|^2/(4 eps)): phi = T phi + eps g, T the kernel's
    Markov matrix, and grad phi from T's own differences. A wide kernel gives the constant gain.

    bandwidth: eps, in the square of the particles' own standard deviation. Source: Taghvaei, Mehta and Meyn 2020,
    "Diffusion map-based algorithm for gain function approximation in the feedback particle filter".
    """

    bandwidth: float = 0.3

    @property
    def varies(self) -> bool:
        """It follows the density."""
        return True

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


GAINS: dict[str, Gain] = {"constant": ConstantGain(), "galerkin": GalerkinGain(), "kernel": KernelGain()}
"""Every gain by the name that the command line has for it."""


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


def _powers(d: int, degree: int, mixed: int) -> tuple[tuple[int, ...], ...]:
    """Return the exponents of every monomial up to `degree` with at most `mixed` different coordinates."""
    chosen = (
        term
        for total in range(1, degree + 1)
        for term in combinations_with_replacement(range(d), total)
        if len(set(term)) <= mixed
    )
    return tuple(tuple(term.count(i) for i in range(d)) for term in chosen)


def _polynomials(y: FloatArray, powers: tuple[tuple[int, ...], ...]) -> tuple[FloatArray, FloatArray]:
    """Return the monomials at the particles, shape (N, k), and their gradients, shape (N, d, k)."""
    N, d = y.shape
    values = np.ones((N, len(powers)))
    slopes = np.zeros((N, d, len(powers)))
    for k, exponents in enumerate(powers):
        used = [i for i, e in enumerate(exponents) if e]
        factors = {i: y[:, i] ** exponents[i] for i in used}
        for i in used:
            values[:, k] *= factors[i]
            slope = exponents[i] * y[:, i] ** (exponents[i] - 1)
            for other in used:
                if other != i:
                    slope = slope * factors[other]
            slopes[:, i, k] = slope
    return values, slopes
