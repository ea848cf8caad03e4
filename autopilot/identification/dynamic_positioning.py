"""A ship under its thrusters at low speed: thrust, damping and lag from a log, with current and wind unknown.

    p' = R(psi) nu + c,   psi' = r,   M nu' = -D nu - C(nu) nu + k F + f(R(psi)' (b + g)) + w
    M = [[M11, 0, 0], [0, M22, M26], [0, M26, M66]],   D = [[Xu, 0, 0], [0, Yv, Yr], [0, Nv, Nr]]

nu = (u, v, r) is the speed through the water. The current c is constant; the wind is a constant force b of the beam
wind, north and east, with gusts g, Ornstein and Uhlenbeck's process; w is white. On board the wind's force (a, s) ahead
and to starboard is f = (rho a, s, (l + q a/|(a, s)|) s): a ship meets less of it from ahead, and is turned by what
comes from abeam at a lever that goes with the wind's angle, not with its strength (Fossen 2021, chapter 10). A moment
b_M with its gusts is added. A thruster i pushes with k_i F_i, F_i its order through a first-order lag, which has
settled at the first row. Everything is in the bis system (Norrbin 1970): lengths by L, times by sqrt(L/g), forces by
m g. The water's part of C(nu) is that of an irrotational current (Fossen 2021, chapter 10).

Motion, c, b and g are the states of an extended Kalman filter. What is left, theta = (D, k, lag, intensities of w, of g
and of the measurements' noise), minimises

    1/2 sum (e_i^2/S_i + log S_i) + 1/2 (theta - theta_0)' P_0^-1 (theta - theta_0)

over the innovations e_i of variance S_i, by Fisher's scoring: the information is sum de de'/S + 1/2 sum dS dS'/S^2
(Ljung 1999, chapter 7; Gupta and Mehra 1974), its inverse the covariance of theta. Ten minutes hardly tell how strong w
and g are, and what is least for both theta and them takes them for too weak. So their common intensity is integrated
over: at each of NODES of it the rest is found anew, a Gaussian whose weight is the likelihood there times the root of
its covariance's determinant (Laplace's approximation), and the answer is mean and covariance of the mixture.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

GRAVITY_M_S2 = 9.81
DAMPING = ("Xu", "Yv", "Yr", "Nv", "Nr")
WIND = ("wind_ahead", "wind_lever", "wind_turn")
"""Logarithm of rho; l and q in lengths."""
CALM = 0.03
"""Of the largest thrust: a wind's force below this has no angle."""
NOISES = ("force", "lever", "gust", "gust_lever", "gust_time", "position", "heading")
"""Logarithms of: intensity of w and the lever that makes its moment; deviation of g by that of w, its lever and
correlation time; deviations of the measurements."""
NODES = (-0.5, 0.5, -1.5, 1.5, 2.5, 3.5)
"""Intensities of w and g at which the rest is found: from where everything is least, in deviations of its logarithm."""
LAG = "lag"

CURRENT_M_S = 0.5
"""Standard deviation of each component of the current before a log is known; 1 m/s is a strong one."""
SPEED_M_S = 0.5
"""The same of the speed with which the log begins."""
MOST_STEPS = 900
LONGEST_STEP = 1.0
"""Rows are taken together to this length of the filter's steps, in units of sqrt(L/g), for a ship answers in tens of
them; of a long log into so many at most. What was measured around a step's end is averaged."""
FINER_STEP, SETTLED = 0.3, 0.01
"""While a thruster is this share of the largest thrust from its order, it is followed in finer steps."""
NUDGE = 1.0e-4
"""Part of a prior's deviation over which slopes are taken."""
LONGEST_MOVE = 0.7
"""Of any parameter in a round of the search, in its prior's deviations: variances are far from quadratic."""
MOST_ROUNDS, ENOUGH = 60, 5.0e-3
"""Rounds of the search, which ends where a step promises less than this of the objective."""


class Thruster(NamedTuple):
    """A unit of its thrust ahead, to starboard, and its moment about midships in lengths."""

    ahead: float
    starboard: float
    moment: float


class Hull(NamedTuple):
    """Length [m], mass [kg], and bis masses with what they carry of the water."""

    length: float
    mass: float
    surge_mass: float
    sway_mass: float
    coupling_mass: float
    yaw_mass: float
    thrusters: tuple[Thruster, ...]

    @property
    def time_unit(self) -> float:
        """sqrt(L/g) [s]."""
        return math.sqrt(self.length / GRAVITY_M_S2)

    @property
    def speed_unit(self) -> float:
        """sqrt(L g) [m/s]."""
        return math.sqrt(self.length * GRAVITY_M_S2)

    @property
    def force_unit(self) -> float:
        """m g [N]."""
        return self.mass * GRAVITY_M_S2


class Trial(NamedTuple):
    """A log: time [s], shape (n,); orders [N], held to the next row, shape (n, thrusters); north, east [m] and heading
    [rad, continuous], shape (n, 3), nan where not measured."""

    time: Floats
    orders: Floats
    measured: Floats


class Belief(NamedTuple):
    """A parameter before or after a log: value and standard deviation, bis; of a lag in seconds, of noises as
    logarithms."""

    value: float
    deviation: float


class DpFit(NamedTuple):
    """What a log says.

    names and beliefs of D, k and lag; covariance of them, shape (p, p); noises by name; drift: current north, east
    [m/s], wind force north, east [N] and moment [N m] at the log's end; correlation: the largest one of successive
    innovations, in its standard deviations; converged: whether the search came to its end.
    """

    names: tuple[str, ...]
    found: tuple[Belief, ...]
    prior: tuple[Belief, ...]
    covariance: Floats
    noises: dict[str, float]
    drift: tuple[Belief, ...]
    correlation: float
    converged: bool


class _Steps(NamedTuple):
    """A log as the filter takes it, bis: steps' lengths, mean orders, what is measured at their ends; first row."""

    dt: Floats
    orders: Floats
    measured: Floats
    first: Floats


def usual_beliefs(hull: Hull, trial: Trial, lag: float | None) -> dict[str, Belief]:
    """Return what is believed of every parameter that the log may tell of, before it is known.

    Damping: time constants of about 20 units, none below 2 by much. A thruster gives what is ordered, within half.
    lag [s]: None where it is to be found, about 2 s within a factor of 3.
    """
    masses = dict(zip(DAMPING, (hull.surge_mass, hull.sway_mass, 0.0, 0.0, hull.yaw_mass), strict=True))
    both = math.sqrt(hull.sway_mass * hull.yaw_mass)
    beliefs = {
        name: Belief(mass / 20.0, 0.5 * (mass or both))
        for name, mass in masses.items()
        if _is_planar(trial) or name == "Xu"
    }
    for index in range(trial.orders.shape[1]):
        if np.ptp(trial.orders[:, index]) > 0.0 or trial.orders[0, index] != 0.0:
            beliefs[f"k{index + 1}"] = Belief(1.0, 0.5)
    if lag is None:
        beliefs[LAG] = Belief(math.log(2.0), 1.1)
    return beliefs


def noise_beliefs(hull: Hull, trial: Trial) -> dict[str, Belief]:
    """Return the logarithms of the noises before a log is known: a metre and a degree, a tenth of the thrust; each
    may be wrong ten times over."""
    push = 0.1 * _most_thrust(trial) / hull.force_unit
    wind = dict(zip(WIND, (Belief(math.log(0.3), 0.7), Belief(0.0, 0.07), Belief(0.0, 0.15)), strict=True))
    values = (
        0.3 * push,
        0.1,
        1.0,
        0.1,
        20.0 / hull.time_unit,
        0.5 / hull.length,
        math.radians(0.3),
    )
    spread = (2.3, 0.7, 1.5, 0.7, 0.7, 1.5, 1.5)
    noises = {name: Belief(math.log(v), d) for name, v, d in zip(NOISES, values, spread, strict=True)}
    return {**noises, **wind} if _is_planar(trial) else noises


def identify_dp(
    hull: Hull,
    trial: Trial,
    beliefs: dict[str, Belief],
    lag: float = 0.0,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> DpFit:
    """Return what the log says of the parameters in `beliefs`; lag [s] of the thrusters where `beliefs` have none.

    progress: called with rounds done and in all.
    """
    noises = noise_beliefs(hull, trial)
    prior = {**beliefs, **noises}
    names, centre = tuple(prior), np.array([each.value for each in prior.values()])
    spread = np.array([each.deviation for each in prior.values()])
    problem = _Problem(
        hull, names, _steps(hull, trial), _most_thrust(trial) / hull.force_unit, lag / hull.time_unit, centre, spread
    )
    known, place = len(beliefs), names.index("force")
    progress(0, len(NODES) + 1)
    least = _searched(problem, centre, np.ones(centre.size, dtype=bool))
    free = np.arange(centre.size) != place
    nodes: list[_Least] = []
    own = math.sqrt(np.linalg.inv(least.information)[place, place]) * spread[place]
    for offset in own * np.array(NODES):
        near = min(nodes, key=lambda node: abs(node.theta[place] - least.theta[place] - offset), default=least)
        start = near.theta.copy()
        start[place] = least.theta[place] + offset
        nodes.append(_searched(problem, start, free))
        progress(len(nodes), len(NODES) + 1)
    depth = np.array([node.value + 0.5 * np.linalg.slogdet(node.information[np.ix_(free, free)])[1] for node in nodes])
    weight = np.exp(depth.min() - depth)
    weight /= weight.sum()
    theta = sum(w * node.theta for w, node in zip(weight, nodes, strict=True))
    covariance = np.zeros((known, known))
    for w, node in zip(weight, nodes, strict=True):
        inner = np.linalg.inv(node.information[np.ix_(free, free)]) * np.outer(spread[free], spread[free])
        off = node.theta[:known] - theta[:known]
        covariance += w * (inner[:known, :known] + np.outer(off, off))
    run = _filtered(problem, theta[None])
    return DpFit(
        names[:known],
        tuple(Belief(float(v), math.sqrt(c)) for v, c in zip(theta[:known], np.diag(covariance), strict=True)),
        tuple(beliefs.values()),
        covariance,
        {name: math.exp(value) for name, value in zip(names[known:], theta[known:], strict=True) if name in NOISES},
        _drift(hull, run),
        _correlation(run),
        least.converged,
    )


class _Problem(NamedTuple):
    """Hull, names of theta, the log, the largest thrust in m g, the lag where theta has none, bis; what is believed of
    theta before."""

    hull: Hull
    names: tuple[str, ...]
    steps: _Steps
    scale: float
    lag: float
    centre: Floats
    spread: Floats


class _Least(NamedTuple):
    """Where a search ended: theta, objective, information by deviations of the prior, and whether it was at its end."""

    theta: Floats
    value: float
    information: Floats
    converged: bool


def _searched(problem: _Problem, start: Floats, free: NDArray[np.bool_]) -> _Least:
    """Return where the objective is least of what is `free`, by Fisher's scoring with Levenberg's damping."""
    theta, damping = start.copy(), 1.0e-2
    value, slope, information = _scored(problem, theta)
    for _ in range(MOST_ROUNDS):
        own = information[np.ix_(free, free)]
        step = -np.linalg.solve(own + damping * np.diag(np.diag(own)), slope[free])
        if 0.5 * float(-slope[free] @ step) < ENOUGH and damping < 1.0:
            return _Least(theta, value, information, True)
        step *= min(1.0, LONGEST_MOVE / float(np.max(np.abs(step))))
        moved = theta.copy()
        moved[free] += problem.spread[free] * step
        there = _scored(problem, moved)
        if there[0] < value:
            theta, (value, slope, information) = moved, there
            damping *= 0.2
        else:
            damping = max(6.0 * damping, 0.1)
    return _Least(theta, value, information, False)


def _is_planar(trial: Trial) -> bool:
    return bool(np.isfinite(trial.measured[:, 1:]).any())


def _most_thrust(trial: Trial) -> float:
    return float(np.max(np.abs(trial.orders)))


def _steps(hull: Hull, trial: Trial) -> _Steps:
    """Return the log in bis units, rows taken together where they are closer than it needs."""
    time = (trial.time - trial.time[0]) / hull.time_unit
    length = max(LONGEST_STEP, time[-1] / MOST_STEPS)
    ends = _ends(time, trial.orders, length)
    held = np.diff(time, append=time[-1])[:, None] * trial.orders / hull.force_unit
    total = np.vstack([np.zeros(held.shape[1]), np.cumsum(held, axis=0)])
    dt = np.diff(time[ends])
    orders = np.diff(total[ends], axis=0) / dt[:, None]
    rows = np.diff(ends, prepend=0, append=time.size)
    beside = np.maximum(np.minimum(rows[:-1], rows[1:]) - 1, 0) // 2
    scale = np.array([hull.length, hull.length, 1.0])
    with warnings.catch_warnings():
        # of nothing but blanks the mean is blank
        warnings.simplefilter("ignore", RuntimeWarning)
        around = [
            np.nanmean(trial.measured[max(end - few, 0) : end + few + 1], axis=0)
            for end, few in zip(ends, beside, strict=True)
        ]
    return _Steps(dt, orders, np.array(around[1:]) / scale, trial.measured[0] / scale)


def _ends(time: Floats, orders: Floats, length: float) -> NDArray[np.int64]:
    """Return the rows at which steps of at most `length` end: also where an order changes, for a push that comes half a
    second late turns the ship for good. Where orders change all the time, at the length alone."""
    changes = np.flatnonzero(np.any(np.diff(orders, axis=0) != 0.0, axis=1)) + 1
    changed = np.zeros(time.size, dtype=bool)
    changed[changes] = changes.size < 0.25 * time.size
    ends = [0]
    for row in range(1, time.size):
        is_full = row + 1 < time.size and time[row + 1] - time[ends[-1]] > length + 1.0e-6
        if changed[row] or is_full or row + 1 == time.size:
            ends.append(row)
    return np.array(ends)


class _Run(NamedTuple):
    """Innovations and variances, shape (B, n, 3), nan where nothing was measured; mean and covariance at the end."""

    innovation: Floats
    variance: Floats
    mean: Floats
    covariance: Floats


def _scored(problem: _Problem, theta: Floats) -> tuple[float, Floats, Floats]:
    """Return the objective at theta, its slope and the information, by deviations of the prior; infinite where the
    filter of such a ship ends in what is no number."""
    p, spread = theta.size, problem.spread
    points = theta + spread * NUDGE * np.vstack([np.zeros(p), np.eye(p)])
    with np.errstate(all="ignore"):
        run = _filtered(problem, points)
    there = np.isfinite(run.innovation[0])
    e, S = run.innovation[:, there], run.variance[:, there]
    if not (np.isfinite(e).all() and (S > 0.0).all()):
        return math.inf, np.zeros(p), np.eye(p)
    off = (theta - problem.centre) / spread
    value = 0.5 * float(np.sum(e[0] ** 2 / S[0] + np.log(S[0]))) + 0.5 * float(off @ off)
    de, dS = (e[1:] - e[0]) / NUDGE, (S[1:] - S[0]) / NUDGE
    slope = de @ (e[0] / S[0]) + 0.5 * dS @ ((1.0 - e[0] ** 2 / S[0]) / S[0]) + off
    information = (de / S[0]) @ de.T + 0.5 * (dS / S[0] ** 2) @ dS.T + np.eye(p)
    return value, slope, information


X, Y, PSI, U, V, R, CN, CE, BN, BE, BM, GN, GE, GM = range(14)


class _Ships(NamedTuple):
    """B ships, each with parameters of its own: gains of the thrusters (B, thrusters) and their pushes (thrusters, 3);
    damping numbers (5, B); masses; the inverse of M (3, 3); rho, l and q (3, B); the force below which the wind has no
    angle.

    is_planar: they move across and turn, too.
    """

    gain: Floats
    push: Floats
    damping: Floats
    masses: tuple[float, float, float]
    inverse: Floats
    wind: Floats
    calm: float
    is_planar: bool

    def driven(self, thrust: Floats) -> Floats:
        """Return what thrusts (B, thrusters) push: ahead, to starboard, to turn."""
        pushed = (self.gain * thrust) @ self.push
        if not self.is_planar:
            pushed[:, 1:] = 0.0
        return pushed


def _ships(problem: _Problem, of: dict[str, Floats], B: int) -> _Ships:
    hull, count = problem.hull, problem.steps.orders.shape[1]
    zero = np.zeros(B)
    M22, M26, M66 = hull.sway_mass, hull.coupling_mass, hull.yaw_mass
    M = np.array([[hull.surge_mass, 0.0, 0.0], [0.0, M22, M26], [0.0, M26, M66]])
    return _Ships(
        np.stack([of.get(f"k{i + 1}", zero) for i in range(count)], axis=1),
        np.array(hull.thrusters),
        np.stack([of.get(name, zero) for name in DAMPING]),
        (hull.surge_mass, M22, M26),
        np.linalg.inv(M),
        np.stack([np.exp(of.get("wind_ahead", zero)), of.get("wind_lever", zero), of.get("wind_turn", zero)]),
        CALM * problem.scale,
        "Yv" in of,
    )


def _wind_felt(x: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    """Return cosine and sine of the heading, and the beam wind's force as it comes from ahead and from abeam."""
    c, s = np.cos(x[:, PSI]), np.sin(x[:, PSI])
    north, east = x[:, BN] + x[:, GN], x[:, BE] + x[:, GE]
    return c, s, north * c + east * s, east * c - north * s


def _rates(ships: _Ships, x: Floats, driven: Floats) -> Floats:
    """Return the rates of the states x, shape (B, 14), gusts apart."""
    c, s, ahead, side = _wind_felt(x)
    u, v, r = x[:, U], x[:, V], x[:, R]
    M11, M22, M26 = ships.masses
    Xu, Yv, Yr, Nv, Nr = ships.damping
    rho, lever, turn = ships.wind
    momentum = M22 * v + M26 * r
    force = np.empty((x.shape[0], 3))
    force[:, 0] = driven[:, 0] - Xu * u + momentum * r + rho * ahead
    force[:, 1] = driven[:, 1] - Yv * v - Yr * r - M11 * u * r + side
    force[:, 2] = driven[:, 2] - Nv * v - Nr * r - momentum * u + M11 * u * v + x[:, BM] + x[:, GM]
    force[:, 2] += (lever + turn * ahead / np.sqrt(ahead**2 + side**2 + ships.calm**2)) * side
    out = np.zeros_like(x)
    out[:, X] = u * c - v * s + x[:, CN]
    out[:, Y] = u * s + v * c + x[:, CE]
    out[:, PSI] = r
    out[:, U:CN] = force @ ships.inverse
    return out


def _slopes(ships: _Ships, x: Floats, A: Floats, J: Floats) -> None:
    """Write the derivatives of `_rates` into A, shape (B, 14, 14), by those of the force J, shape (B, 3, 14)."""
    c, s, ahead, side = _wind_felt(x)
    u, v, r = x[:, U], x[:, V], x[:, R]
    M11, M22, M26 = ships.masses
    Xu, Yv, Yr, Nv, Nr = ships.damping
    A[:, X, PSI], A[:, X, U], A[:, X, V] = -u * s - v * c, c, -s
    A[:, Y, PSI], A[:, Y, U], A[:, Y, V] = u * c - v * s, s, c
    rho, lever, turn = ships.wind
    calm = ships.calm**2
    per = turn * (ahead**2 + side**2 + calm) ** -1.5
    by_ahead, by_side = per * side * (side**2 + calm), lever + per * ahead * (ahead**2 + calm)
    J[:, 0, PSI], J[:, 0, U], J[:, 0, V], J[:, 0, R] = rho * side, -Xu, M22 * r, M22 * v + 2.0 * M26 * r
    J[:, 1, PSI], J[:, 1, U], J[:, 1, V], J[:, 1, R] = -ahead, -M11 * r, -Yv, -Yr - M11 * u
    J[:, 2, PSI] = by_ahead * side - by_side * ahead
    J[:, 2, U], J[:, 2, V], J[:, 2, R] = -(M22 - M11) * v - M26 * r, -Nv - (M22 - M11) * u, -Nr - M26 * u
    for wind in (BN, GN):
        J[:, 0, wind], J[:, 1, wind], J[:, 2, wind] = rho * c, -s, by_ahead * c - by_side * s
        J[:, 0, wind + 1], J[:, 1, wind + 1], J[:, 2, wind + 1] = rho * s, c, by_ahead * s + by_side * c
    A[:, U:CN] = ships.inverse @ J
    if not ships.is_planar:
        A[:, V : R + 1] = 0.0


def _start(problem: _Problem, gust: Floats, is_planar: bool) -> tuple[Floats, Floats]:
    """Return mean and covariance before the first row is known."""
    hull, first, B = problem.hull, problem.steps.first, gust.shape[0]
    mean, P = np.zeros((B, 14)), np.zeros((B, 14, 14))
    mean[:, :3] = np.where(np.isfinite(first), first, 0.0)
    speed, current = SPEED_M_S / hull.speed_unit, CURRENT_M_S / hull.speed_unit
    wind = (problem.scale, problem.scale, 0.25 * problem.scale)
    for i, deviation in enumerate((1.0, 1.0, 0.1, speed, speed, 2.0 * speed, current, current, *wind)):
        P[:, i, i] = deviation**2
    P[:, [GN, GE, GM], [GN, GE, GM]] = gust**2
    if not is_planar:
        still = [Y, PSI, V, R, CE, BE, BM, GE, GM]
        P[:, still, :] = 0.0
        P[:, :, still] = 0.0
    return mean, P


def _filtered(problem: _Problem, thetas: Floats) -> _Run:
    """Run B extended Kalman filters side by side, each with parameters of its own, shape (B, p)."""
    steps, B, n = problem.steps, thetas.shape[0], problem.steps.dt.size
    of = {name: thetas[:, i] for i, name in enumerate(problem.names)}
    noise = {name: np.exp(of[name]) for name in NOISES}
    ships, one = _ships(problem, of, B), np.ones(B)
    lag = np.exp(of[LAG]) / problem.hull.time_unit if LAG in of else np.full(B, problem.lag)
    R_ = np.stack([noise["position"], noise["position"], noise["heading"]], axis=1) ** 2
    white = noise["force"][:, None] * np.stack([one, one, noise["lever"]], axis=1)
    gust = (noise["force"] * noise["gust"])[:, None] * np.stack([one, one, noise["gust_lever"]], axis=1)
    if not ships.is_planar:
        white[:, 1:] = gust[:, 1:] = 0.0
    shaken = ships.inverse * white[:, None, :]
    Qv = shaken @ shaken.transpose(0, 2, 1)

    mean, P = _start(problem, gust, ships.is_planar)
    mean, P, _, _ = _corrected(mean, P, steps.first, R_)
    thrust = np.tile(steps.orders[0], (B, 1))
    innovation, variance = np.full((B, n, 3), np.nan), np.full((B, n, 3), np.nan)
    A, J, Q, eye = np.zeros((B, 14, 14)), np.zeros((B, 3, 14)), np.zeros((B, 14, 14)), np.eye(14)
    A[:, X, CN] = A[:, Y, CE] = A[:, PSI, R] = 1.0
    J[:, 2, BM] = J[:, 2, GM] = 1.0
    for k in range(n):
        is_settled = bool((np.abs(thrust - steps.orders[k]) < SETTLED * problem.scale).all())
        parts = max(math.ceil(float(steps.dt[k]) / (LONGEST_STEP if is_settled else FINER_STEP)), 1)
        h = float(steps.dt[k]) / parts
        kept = np.where(lag > 0.0, np.exp(-h / np.maximum(lag, 1.0e-9)), 0.0)
        fade = np.exp(-h / noise["gust_time"])
        Q[:, U:CN, U:CN] = 0.5 * h * Qv
        Q[:, [GN, GE, GM], [GN, GE, GM]] = 0.5 * gust**2 * (1.0 - fade**2)[:, None]
        for _ in range(parts):
            behind = thrust - steps.orders[k]
            driven = ships.driven(steps.orders[k] + behind * (lag * (1.0 - kept) / h)[:, None])
            thrust = steps.orders[k] + behind * kept[:, None]
            middle = mean + 0.5 * h * _rates(ships, mean, driven)
            _slopes(ships, middle, A, J)
            mean = mean + h * _rates(ships, middle, driven)
            mean[:, GN:] *= fade[:, None]
            Ah = h * A
            Phi = eye + Ah + 0.5 * (Ah @ Ah)
            Phi[:, :, GN:] *= fade[:, None, None]
            P = Phi @ (P + Q) @ Phi.transpose(0, 2, 1) + Q
        mean, P, innovation[:, k], variance[:, k] = _corrected(mean, P, steps.measured[k], R_)
    return _Run(innovation, variance, mean, P)


def _corrected(mean: Floats, P: Floats, z: Floats, R_: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    """Return mean and covariance after north, east and heading, one after another, with innovations and variances."""
    e, S = np.full((mean.shape[0], 3), np.nan), np.full((mean.shape[0], 3), np.nan)
    for i in np.flatnonzero(np.isfinite(z)):
        S[:, i] = P[:, i, i] + R_[:, i]
        e[:, i] = z[i] - mean[:, i]
        gain = P[:, :, i] / S[:, i, None]
        mean = mean + gain * e[:, i, None]
        P = P - gain[:, :, None] * P[:, None, i, :]
    return mean, 0.5 * (P + P.transpose(0, 2, 1)), e, S


def _drift(hull: Hull, run: _Run) -> tuple[Belief, ...]:
    units = (*[hull.speed_unit] * 2, *[hull.force_unit] * 2, hull.force_unit * hull.length)
    deviation = np.sqrt(np.maximum(np.diag(run.covariance[0]), 0.0))
    return tuple(
        Belief(float(run.mean[0, i]) * unit, float(deviation[i]) * unit)
        for i, unit in zip((CN, CE, BN, BE, BM), units, strict=True)
    )


def _correlation(run: _Run) -> float:
    """Return the largest correlation of successive innovations of a measurement, in its standard deviations."""
    worst = 0.0
    for i in range(3):
        e = run.innovation[0, :, i] / np.sqrt(run.variance[0, :, i])
        e = e[np.isfinite(e)]
        if e.size > 10:
            worst = max(worst, abs(float(e[1:] @ e[:-1]) / float(e @ e)) * math.sqrt(e.size))
    return worst
