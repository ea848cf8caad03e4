"""The likelihood of what is being sailed, sample by sample: boat and disturbance in one filter, in constant memory.

    r' = s^2 a delta - s b r - d r^3/s - s^2 e + g + h + w,    psi' = r,    s = U/U0
    g' = -g/tau + white,    h'' + 2 z W h' + W^2 h = white

as in `marginal_likelihood`: a = K/T, b = n1/T of either sign, d = n3/T, e = n0/T; g a gust that lasts, h a wave, w
white. Rate, gust, wave and the four rates are one state of an extended Kalman filter, linear in the four where the rate
is known. That the rudder answers the gusts, as every hand and law makes it, is no matter: rudder and gust stand in the
same equation, and nothing is left out that both go with (prediction errors in closed loop, Ljung 1999, section 13.4).

How rough it is, nobody says, and it changes: a filter runs for each kind of weather, and their estimates are taken
together, weighted with the likelihood of what each has seen; now and then each begins anew from what those that the
weather may have come from hold (interacting multiple models, Bar-Shalom 2001, section 11.6). So one that has not fitted
the weather for long holds what the others have learnt. The covariance is theirs together. Where nothing moves the boat,
nothing is learnt; a, b and d drift a little, only while the rudder moves.

What pushes the boat is felt as what the model leaves, and a first model that is far off leaves as much as a gale. So
the push is that of a second group of the same filters, which learn all the time and serve for nothing else.

No sea is of one of these kinds. The waves' size and frequency and the strongest gust follow what is felt, and what is
left of the misfit counts as doubt: where the noise is another than the model of it, the rudder that answers it biases
what is learnt, and that goes with the ratio of noise to rudder (section 13.4 again). So nothing is learnt unless the
rudder does WORKS times as much as what else pushes the boat (in rudder of the weaker boat, the first model's or theirs,
unless theirs is the stronger one for certain); and the ratio of both, over the time in which something was learnt, is a
standard error of K, T and n3 that no time makes smaller. Another is that of the rudder's time: a rudder that comes
LATE_S later looks like a T that is longer by as much.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from autopilot.angles import wrap
from autopilot.identification.interval import SURE_OF_IT
from autopilot.models.norrbin import SPEED_FLOOR_RATIO, Norrbin, at_speed_ratio, rate_step

Array = NDArray[np.float64]

GUST_DEG = (0.1, 0.7, 4.0)
WHITE_DEG = (0.05, 0.7)
WAVE_RAD_S = (0.0, 0.7, 1.6, 3.5)
"""Gusts, rms, and what is white [deg sqrt(s)], in degrees of the first model's rudder, and the waves' frequency; each
with each. Waves of frequency 0 are none."""
GUST_TIME_S = 6.0
WAVE_DEG, WAVE_DAMPING = 1.0, 0.2
LEAST_WAVE, MOST_WAVE, BAND, FOLLOWS_S = 0.3, 200.0, 1.5, 40.0
"""So many times WAVE_DEG waves are at least, waves and gusts at most; waves' frequencies stay within the factor BAND of
those above; what is felt is followed in this time."""
WORKS, WORKS_S, LATE_S = 2.0, 20.0, 0.05
"""See above; the rudder's work is that of the last WORKS_S. LATE_S: what an order's way and a servo's model leave."""
FIRST_S = 10.0
"""Nothing is learnt before what pushes the boat was felt for so long: one of the longest waves."""
EXPECTED = (0.7, 1.0, 0.5)
"""Deviations of what the first model is expected to be off by: of a and b, as shares of a and 1/T, and of d, as a share
of the cubic damping that holds LARGE degrees of rudder."""
LARGE, TRIM = math.radians(20.0), math.radians(3.0)
CHANGES_S, MIXES_S = 120.0, 2.0
"""Time in which the weather is expected to have changed; seconds between minglings of the filters."""
DRIFT_S, TRIM_DRIFT_S = 72.0e3, 600.0
"""Time of moved rudder in which a, b and d, and time in which e, may come to differ by what was expected at first."""
MOVES = math.radians(2.0)
"""The rudder moves while it is so far from its mean over a minute."""
LONGEST_GAP_S = 2.0
LEAST_RATIO, MOST_RATIO = 0.2, 5.0
"""Slower or quicker than these shares of the reference speed nothing is learnt."""
RATE_BOUND_RAD_S = 3.0
SUBSTEP = 0.3
USUAL_COMPASS, USUAL_GYRO, USUAL_SAMPLES = math.radians(0.5), math.radians(0.3), 30
"""Noise of compass [rad] and gyro [rad/s] before they are known, and what that is worth in samples."""
LEAST_COMPASS, LEAST_GYRO = math.radians(0.03), math.radians(0.01)
ROUGHNESS_SAMPLES = 300
"""Over about so many samples the instruments' noise is found, from third differences."""
PSI, R, G, H, V, A, B, D, E = range(9)
STATES = 9


class LiveEstimate(NamedTuple):
    """a, b, d, e at the reference speed and their covariance, shape (4, 4)."""

    values: Array
    covariance: Array


class _Roughness:
    """Noise of an instrument: third differences of white noise have twenty times its square."""

    def __init__(self, usual: float, least: float) -> None:
        self._least = least
        self._last: list[float] = []
        self._square, self._count = usual**2, USUAL_SAMPLES

    def update(self, value: float) -> None:
        """Take a sample."""
        self._last.append(value)
        if len(self._last) == 4:
            a, b, c, d = self._last
            third = wrap(d - c) - 2.0 * wrap(c - b) + wrap(b - a)
            self._count = min(self._count + 1, ROUGHNESS_SAMPLES)
            self._square += (third * third / 20.0 - self._square) / self._count
            self._last.pop(0)

    def begin(self) -> None:
        """Forget the last samples, not the noise."""
        self._last.clear()

    @property
    def variance(self) -> float:
        """Square of the noise."""
        return max(self._square, self._least**2)


class _Weather:
    """What pushes the boat, of M kinds, and how its size follows what is felt.

    frequency [rad/s] of the waves, 0 for none, wave_square and gust_square [rad^2/s^4], shape (M,). The kinds of one
    frequency share their waves, and those of one gust the gust. By the law of total expectation the mean of a
    posterior second moment is the prior's where that is right: sizes and frequencies are moved towards it.
    """

    def __init__(self, frequency: Array, wave: float, gust: Array) -> None:
        self.frequency, self.gust_square = frequency.copy(), gust**2
        self.wave_square = np.where(frequency > 0.0, wave**2, 0.0)
        self._bands = [(W, frequency == W) for W in np.unique(frequency) if W > 0.0]
        self._none = np.zeros((frequency.size, 2, 2))
        self._strong = gust == gust.max()
        self._least_wave, self._least_gust = (LEAST_WAVE * wave) ** 2, gust.max() ** 2
        self._most = (MOST_WAVE * wave) ** 2

    def over(self, dt: float) -> tuple[Array, Array]:
        """Return the waves' transition over `dt` [s] and the covariance of what drives them, shape (M, 2, 2) each."""
        if not self._bands:
            return self._none, self._none
        W, z = np.maximum(self.frequency, 1.0e-3), WAVE_DAMPING
        own = W * math.sqrt(1.0 - z * z)
        fade, cosine, sine = np.exp(-z * W * dt), np.cos(own * dt), np.sin(own * dt) / own
        # where there are no waves, what the others' filters bring along is gone at once
        fade = np.where(self.frequency > 0.0, fade, 0.0)
        rows = [[cosine + z * W * sine, sine], [-W * W * sine, cosine - z * W * sine]]
        moved = fade[:, None, None] * np.array(rows).transpose(2, 0, 1)
        still = self.wave_square[:, None, None] * np.eye(2)
        still[:, 1, 1] *= W**2
        return moved, still - moved @ still @ moved.transpose(0, 2, 1)

    def follow(self, dt: float, weight: Array, x: Array, P: Array) -> None:
        """Move sizes and frequencies towards what the last `dt` [s] showed."""
        share = min(dt / FOLLOWS_S, 1.0)
        gust, wave, swing = (x[:, i] ** 2 + P[:, i, i] for i in (G, H, V))
        for usual, band in self._bands:
            by = weight[band] / max(weight[band].sum(), 1.0e-300)
            h, v = float(by @ wave[band]), float(by @ swing[band])
            square = self.wave_square[band][0]
            speed = square * self.frequency[band][0] ** 2
            square, speed = square + share * (h - square), speed + share * (v - speed)
            W = min(max(math.sqrt(speed / square), usual / BAND), usual * BAND)
            self.frequency[band] = W
            self.wave_square[band] = min(max(square, self._least_wave), self._most)
        by = weight[self._strong] / max(weight[self._strong].sum(), 1.0e-300)
        square = self.gust_square[self._strong][0]
        square += share * (float(by @ gust[self._strong]) - square)
        self.gust_square[self._strong] = min(max(square, self._least_gust), self._most)


class Push(NamedTuple):
    """What pushes the boat at the reference speed [rad/s^2]: a gust, and what stays."""

    gust: float
    trim: float


class LiveFilter:
    """Feed it with `update`; read `estimate`. `first` is the model it begins with; `held`: it
    stays so, and only weather and trim are found, waves left out."""

    def __init__(self, first: Norrbin, *, held: bool = False) -> None:
        self.first, self._held = first, held
        self.forget()

    def forget(self) -> None:
        """Begin with the first model."""
        first = self.first
        a, T = first.gain / first.time_constant, first.time_constant
        rate = _turn(first)
        self._unit = np.array([a, 1.0 / T, a * LARGE / rate**3, a])
        spread = np.array([*EXPECTED, TRIM]) * self._unit
        if self._held:
            spread[:3] = 0.0
        self._mean = np.array([a, first.n1 / T, first.n3 / T, first.n0 / T])
        waves = WAVE_RAD_S[:1] if self._held else WAVE_RAD_S
        kinds = [(g, w, W) for g in GUST_DEG for w in WHITE_DEG for W in waves]
        # the first group learns where the rudder does enough, a second always, by which that is judged
        self._groups = [slice(0, len(kinds))] if self._held else [slice(0, len(kinds)), slice(len(kinds), None)]
        self._own, self._free = self._groups[0], self._groups[-1]
        weather = np.array(kinds * len(self._groups))
        gust, self._white = np.radians(weather[:, :2].T) * a
        self._weather = _Weather(weather[:, 2], math.radians(WAVE_DEG) * a, gust)
        M = weather.shape[0]
        self._x = np.zeros((M, STATES))
        self._P = np.zeros((M, STATES, STATES))
        self._x[:, A:] = self._mean
        self._P[:, range(A, STATES), range(A, STATES)] = spread**2
        drift = np.array([DRIFT_S, DRIFT_S, DRIFT_S, TRIM_DRIFT_S])
        self._drift = spread**2 / drift
        self._logs = np.zeros(M)
        self._pushed = self._worked = self._felt_s = 0.0
        self._learnt_by = self._clear = 0.0
        self._weaker = a
        self._mixed = -math.inf
        self._compass = _Roughness(USUAL_COMPASS, LEAST_COMPASS)
        self._gyro = _Roughness(USUAL_GYRO, LEAST_GYRO)
        self._at, self._rudder, self._usual, self._turns = -math.inf, 0.0, 0.0, 0.0
        self._heading = 0.0
        self.moved_s = 0.0

    @property
    def estimate(self) -> LiveEstimate:
        """The estimates of all kinds of weather together."""
        weight, x, P = self._weights(self._own), self._x[self._own, A:], self._P[self._own, A:, A:]
        values = weight @ x
        off = x - values
        spread = np.einsum("m,mij->ij", weight, P) + np.einsum("m,mi,mj->ij", weight, off, off)
        if self._clear > 0.0:
            # K, T and n3 each by itself; T goes through all three
            share, late = self._learnt_by / self._clear, (LATE_S * values[1]) ** 2
            rates = values[:3]
            spread[:3, :3] += (share + late) * np.outer(rates, rates) + share * np.diag(
                [rates[0] ** 2, 0.0, rates[2] ** 2]
            )
        return LiveEstimate(values, spread)

    @property
    def rate(self) -> float:
        """The rate [rad/s] as all that was measured so far shows it."""
        return float(self._weights(self._own) @ self._x[self._own, R])

    @property
    def push(self) -> Push:
        """What pushes the boat now."""
        weight, x = self._weights(self._own), self._x[self._own]
        return Push(float(weight @ x[:, G]), -float(weight @ x[:, E]))

    def _weights(self, group: slice) -> Array:
        logs = self._logs[group]
        weight = np.exp(logs - logs.max())
        return np.asarray(weight / weight.sum())

    def update(
        self, time: float, rudder: float, ratio: float, heading: float | None = None, rate: float | None = None
    ) -> None:
        """Take what is known at `time` [s]: rudder [rad], speed over the reference speed, heading [rad], rate [rad/s].

        Times that do not increase are ignored; after a gap, and where the rudder was not known (nan), the motion begins
        anew, what was learnt stays.
        """
        dt = time - self._at
        if not dt > 0.0:
            return
        if not (abs(rudder) <= math.pi and LEAST_RATIO <= ratio <= MOST_RATIO):
            self._at = -math.inf
            return
        if dt > LONGEST_GAP_S:
            self._begin(time, rudder, heading, rate)
            return
        self._predict(dt, 0.5 * (rudder + self._rudder), ratio)
        moved = rudder - self._usual
        self._usual += min(dt / 60.0, 1.0) * moved
        if abs(moved) > MOVES:
            self.moved_s += dt
            self._P[:, range(A, E), range(A, E)] += self._drift[:3] * dt
        self._P[:, E, E] += self._drift[3] * dt
        self._at, self._rudder = time, rudder
        if heading is not None and math.isfinite(heading):
            self._compass.update(heading)
            self._turns += wrap(heading - self._heading)
            self._heading = heading
            self._see(PSI, self._turns, self._compass.variance)
        if rate is not None and abs(rate) <= RATE_BOUND_RAD_S:
            self._gyro.update(rate)
            self._see(R, rate, self._gyro.variance)
        weight = np.zeros(self._logs.size)
        weight[self._free] = self._weights(self._free)
        if not self._held:
            self._weigh(dt, moved, weight)
        self._weather.follow(dt, weight, self._x, self._P)
        if time - self._mixed >= MIXES_S:
            self._mixed = time
            for group in self._groups:
                self._mix(group)
        if not (np.isfinite(self._x).all() and np.isfinite(self._P).all()):
            self.forget()

    @property
    def learns(self) -> bool:
        """Whether the rudder does WORKS times as much as what else pushes the boat."""
        return self._felt_s >= FIRST_S and self._worked * self._weaker**2 > WORKS**2 * self._pushed

    @property
    def is_blown(self) -> bool:
        """Whether the rudder moves, and does too little beside what else pushes the boat for anything to be learnt."""
        return self._felt_s >= FIRST_S and self._worked > MOVES**2 and not self.learns

    def _weigh(self, dt: float, moved: float, weight: Array) -> None:
        """Compare what the rudder did in `dt` [s], `moved` [rad] from its mean, with what else pushed."""
        x, P = self._x, self._P
        a = float(weight @ x[:, A])
        push = float(weight @ (x[:, G] ** 2 + P[:, G, G] + x[:, H] ** 2 + P[:, H, H]))
        self._felt_s = min(self._felt_s + dt, WORKS_S)
        self._pushed += dt / self._felt_s * (push - self._pushed)
        self._worked += min(dt / WORKS_S, 1.0) * (moved * moved - self._worked)
        # in rudder of the weaker boat: where the rudder answers a gust, a boat that hardly turns has neither of them.
        # But a file that is surely too weak, by the doubt of `estimate`, would shut out the boat that needs it most
        by_push = 2.0 * self._pushed / max(self._worked, 1.0e-300)
        doubt = math.sqrt(float(weight @ (P[:, A, A] + (x[:, A] - a) ** 2)) + by_push)
        self._weaker = min(a, max(self._unit[0], a - SURE_OF_IT * doubt))
        if self.learns:
            # moments count as much as they tell: rudder over push, squared
            self._learnt_by += dt * moved * moved
            self._clear += dt * moved * moved * self._worked * self._weaker**2 / self._pushed

    def _mix(self, group: slice) -> None:
        """Let the weather have changed: each filter begins with what all hold, as likely as each led to its weather."""
        weight, x = self._weights(group), self._x[group]
        M, changed = weight.size, MIXES_S / CHANGES_S
        led = weight[:, None] * ((1.0 - changed) * np.eye(M) + changed / M)
        total = led.sum(axis=0)
        led = led / total
        # about the mean of all, so that what is taken off again is small
        middle = weight @ x
        off = x - middle
        mean = led.T @ off
        spread = np.tensordot(led, self._P[group] + off[:, :, None] * off[:, None, :], axes=(0, 0))
        spread -= mean[:, :, None] * mean[:, None, :]
        self._x[group], self._P[group], self._logs[group] = middle + mean, spread, np.log(total)

    def _begin(self, time: float, rudder: float, heading: float | None, rate: float | None) -> None:
        self._at, self._rudder, self._turns = time, rudder, 0.0
        self._heading = heading if heading is not None and math.isfinite(heading) else 0.0
        self._compass.begin()
        self._gyro.begin()
        self._x[:, :A] = 0.0
        self._x[:, R] = rate if rate is not None and abs(rate) <= RATE_BOUND_RAD_S else 0.0
        self._P[:, :A, :] = self._P[:, :, :A] = 0.0
        self._P[:, PSI, PSI] = self._compass.variance
        self._P[:, R, R] = (0.5 * _turn(self.first)) ** 2
        self._P[:, G, G] = self._weather.gust_square
        square = self._weather.wave_square
        self._P[:, H, H], self._P[:, V, V] = square, square * self._weather.frequency**2

    def _predict(self, span: float, rudder: float, s: float) -> None:
        quick = float(np.max(np.abs(self._x[:, B]) * s + 3.0 * np.abs(self._x[:, D]) * self._x[:, R] ** 2 / s))
        steps = min(max(1, math.ceil(span * quick / SUBSTEP)), 20)
        dt = span / steps
        keep = math.exp(-dt / GUST_TIME_S)
        moved, driven = self._weather.over(dt)
        q = self._white**2
        for _ in range(steps):
            x = self._x
            r, a, b, d, e = x[:, R], x[:, A], x[:, B], x[:, D], x[:, E]
            pushed = s * s * (a * rudder - e) + x[:, G] + x[:, H]
            middle = r + 0.5 * dt * (pushed - s * b * r - d * r**3 / s)
            slope = -(s * b + 3.0 * d * middle**2 / s)
            by = np.stack(
                [np.full_like(r, s * s * rudder), -s * middle, -(middle**3) / s, np.full_like(r, -s * s)], axis=1
            )
            half = 1.0 + 0.5 * dt * slope
            F = np.zeros_like(self._P)
            F[:, range(STATES), range(STATES)] = 1.0
            F[:, PSI, R], F[:, PSI, G], F[:, PSI, H] = dt * half, 0.5 * dt * dt, 0.5 * dt * dt
            F[:, PSI, A:] = 0.5 * dt * dt * by
            F[:, R, R], F[:, R, G], F[:, R, H] = 1.0 + dt * slope * half, dt * half, dt * half
            F[:, R, A:] = dt * half[:, None] * by
            F[:, G, G] = keep
            F[:, H:A, H:A] = moved
            x[:, PSI] += dt * middle
            turned = r + dt * (pushed - s * b * middle - d * middle**3 / s)
            x[:, R] = np.clip(turned, -RATE_BOUND_RAD_S, RATE_BOUND_RAD_S)
            x[:, G] *= keep
            x[:, H:A] = np.einsum("mij,mj->mi", moved, x[:, H:A])
            P = F @ self._P @ F.transpose(0, 2, 1)
            P[:, PSI, PSI] += q * dt**3 / 3.0
            P[:, PSI, R] += q * dt**2 / 2.0
            P[:, R, PSI] += q * dt**2 / 2.0
            P[:, R, R] += q * dt
            P[:, G, G] += self._weather.gust_square * (1.0 - keep * keep)
            P[:, H:A, H:A] += driven
            self._P = P

    def _see(self, row: int, value: float, variance: float) -> None:
        column = self._P[:, :, row]
        size = column[:, row] + variance
        off = value - self._x[:, row]
        self._logs += -0.5 * (off * off / size + np.log(size))
        gain = column / size[:, None]
        # of a model that is held there is no doubt, and nothing to keep from learning
        learns = self._held or self.learns
        if not learns:
            # their doubt counts in what is seen of the motion, and stays (Schmidt 1966)
            gain[self._own, A:E] = 0.0
        self._x += gain * off[:, None]
        both = gain[:, :, None] * column[:, None, :]
        P = self._P - both
        if not learns:
            own = self._own
            P[own] += (size[own, None] * gain[own])[:, :, None] * gain[own, None, :] - both[own].transpose(0, 2, 1)
        self._P = 0.5 * (P + P.transpose(0, 2, 1))
        # a boat that does not follow its rudder, or that nothing bounds, is no boat
        np.maximum(self._x[:, A], 0.02 * self._unit[0], out=self._x[:, A])
        np.maximum(self._x[:, D], 0.0, out=self._x[:, D])


def _turn(model: Norrbin) -> float:
    """Return the rate [rad/s] at which cubic damping of the first model's size holds LARGE of rudder."""
    K = model.gain
    if model.n3 <= 0.0:
        return K * LARGE
    roots = np.roots([model.n3, 0.0, model.n1, -K * LARGE])
    return float(max(root.real for root in roots if abs(root.imag) < 1.0e-9 * max(abs(root), 1.0)))


def moved_on(
    model: Norrbin, ratio: float, motion: tuple[float, float], dt: float, rudder: tuple[float, float]
) -> tuple[float, float]:
    """Return rate [rad/s] and heading [rad] of a boat `dt` [s] later, at `ratio` times the reference speed, while the
    rudder goes from one angle [rad] to the other; a rate that runs away is bounded."""
    (rate, heading), (before, after) = motion, rudder
    scaled = at_speed_ratio(model, max(ratio, SPEED_FLOOR_RATIO))
    steps = math.ceil(2.0 * dt / scaled.time_constant)
    for step in range(steps):
        was, angle = rate, before + (after - before) * (step + 0.5) / steps
        moved = rate_step(scaled, was, angle, dt / steps)
        rate = min(max(moved, -RATE_BOUND_RAD_S), RATE_BOUND_RAD_S) if moved == moved else 0.0
        heading += 0.5 * dt / steps * (was + rate)
    return rate, heading
