"""Peers of the steering study, each with its tuned numbers, behind the same readings as the pilot.

ArduRover's steering, as its parameter reference and AR_AttitudeControl describe it, in our own words: an angle P asks
for a rate of turn, limited in rate, in acceleration and by what can be stopped in time; a PID with feed-forward on the
rate, its target, error and derivative low-passed, its integrator limited and held while the rudder is at its stop.
Eleven numbers: ATC_STR_ANG_P, RAT_P, RAT_I, RAT_D, RAT_FF, RAT_IMAX, RAT_FLTT, RAT_FLTE, RAT_FLTD, RAT_MAX, ACC_MAX.
Without a gyro it is given the derivative of its heading, low-passed, as a twelfth.

The study's PID: a PID on a low-passed heading and derivative, with a weather band and a dead band.

The Kalman PID: heading, rate and bias by an observer of constant gains on the linear model, gains on all three.

The LQG law: it knows boat, gear, path, noise, the steady wind and the spectrum of what else pushes. Travel is the mean
of |u'|, so that no linear law is the best: it is given a play, and moves the rudder no further than to the edge of a
band about its wish. Play and gains are searched about those of the linear law.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.linalg import expm, solve_discrete_are

from autopilot.angles import wrap
from autopilot.models.norrbin import Norrbin

Floats = npt.NDArray[np.float64]


class Rudder(NamedTuple):
    """angle_max [rad], rate_max [rad/s]."""

    angle_max: float
    rate_max: float


def _limited(rudder: Rudder, before: float, wanted: float, dt: float) -> float:
    reach = rudder.rate_max * dt
    wanted = min(max(wanted, -rudder.angle_max), rudder.angle_max)
    return min(max(wanted, before - reach), before + reach)


def _share(dt: float, time: float) -> float:
    return 1.0 - math.exp(-dt / time) if time > 0.0 else 1.0


class ArduRover(NamedTuple):
    """angle_p [1/s]; p, i [1/s], d [s], ff: full steering per rad/s; imax: share of full steering; time constants [s]
    of the filters on target, error, derivative; rate_max [rad/s], acceleration_max [rad/s^2]; rate_time [s]: the
    filter on the heading's derivative."""

    angle_p: float
    p: float
    i: float
    d: float
    ff: float
    imax: float
    target_time: float
    error_time: float
    derivative_time: float
    rate_max: float
    acceleration_max: float
    rate_time: float
    rudder: Rudder


class ArduRoverMemory(NamedTuple):
    """Desired rate, filtered target, error and derivative, integrator, last heading, its rate, the order."""

    desired: float
    target: float
    error: float
    derivative: float
    integral: float
    heading: float
    rate: float
    order: float


ARDUROVER_BEGINS = ArduRoverMemory(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def ardurover_step(
    helm: ArduRover, memory: ArduRoverMemory, heading: float, rate: float, dt: float
) -> tuple[float, ArduRoverMemory]:
    """Return the order [rad] and the memory."""
    seen = memory.rate
    if math.isnan(rate):
        seen += _share(dt, helm.rate_time) * (wrap(heading - memory.heading) / dt - seen)
    else:
        seen = rate
    off = wrap(-heading)
    stopping = math.sqrt(2.0 * abs(off) * helm.acceleration_max)
    wanted = min(max(helm.angle_p * off, -helm.rate_max), helm.rate_max)
    wanted = min(max(wanted, -stopping), stopping)
    return ardurover_turns(helm, memory, (heading, seen), wanted, dt)


def ardurover_turns(
    helm: ArduRover, memory: ArduRoverMemory, shown: tuple[float, float], wanted: float, dt: float
) -> tuple[float, ArduRoverMemory]:
    """Return the order [rad] for a rate of turn [rad/s] that is wanted, and the memory; `shown`: heading and rate."""
    heading, seen = shown
    change = helm.acceleration_max * dt
    desired = min(max(wanted, memory.desired - change), memory.desired + change)
    desired = min(max(desired, -helm.rate_max), helm.rate_max)
    target = memory.target + _share(dt, helm.target_time) * (desired - memory.target)
    error = memory.error + _share(dt, helm.error_time) * (target - seen - memory.error)
    slope = (error - memory.error) / dt
    derivative = memory.derivative + _share(dt, helm.derivative_time) * (slope - memory.derivative)
    full, integral = helm.rudder.angle_max, memory.integral
    grown = integral + helm.i * error * dt
    at_stop = abs(memory.order) >= 0.999 * full
    if not at_stop or abs(grown) < abs(integral):
        integral = min(max(grown, -helm.imax), helm.imax)
    steering = helm.p * error + integral + helm.d * derivative + helm.ff * target
    order = _limited(helm.rudder, memory.order, full * steering, dt)
    return order, ArduRoverMemory(desired, target, error, derivative, integral, heading, seen, order)


class Pid(NamedTuple):
    """kp, ki [1/s], kd [s]; time constants [s] of the filters on heading and rate; weather and dead band [rad]."""

    kp: float
    ki: float
    kd: float
    heading_time: float
    rate_time: float
    weather: float
    dead_band: float
    rudder: Rudder


class PidMemory(NamedTuple):
    """Filtered heading, rate, integrator, order."""

    heading: float
    rate: float
    integral: float
    order: float


PID_BEGINS = PidMemory(0.0, 0.0, 0.0, 0.0)


def pid_step(helm: Pid, memory: PidMemory, heading: float, rate: float, dt: float) -> tuple[float, PidMemory]:
    """Return the order [rad] and the memory."""
    moved = _share(dt, helm.heading_time) * wrap(heading - memory.heading)
    filtered = wrap(memory.heading + moved)
    shown = moved / dt if math.isnan(rate) else rate
    turning = memory.rate + _share(dt, helm.rate_time) * (shown - memory.rate)
    off = filtered - min(max(filtered, -helm.weather), helm.weather)
    integral = memory.integral - helm.ki * off * dt
    wanted = integral - helm.kp * off - helm.kd * turning
    order = memory.order
    if abs(wanted - order) > helm.dead_band:
        order = _limited(helm.rudder, order, wanted, dt)
    if abs(wanted) > helm.rudder.angle_max:
        integral = memory.integral
    return order, PidMemory(filtered, turning, integral, order)


class KalmanPid(NamedTuple):
    """The observer's model (K/T, n1/T, a step), gains on the innovation of the heading, of the rate and their bias, and
    feedback kp, kd, with a low-pass [s] on the order."""

    drive: float
    decay: float
    on_heading: float
    on_rate: float
    on_bias: float
    rate_weight: float
    kp: float
    kd: float
    smoothing: float
    rudder: Rudder


class KalmanPidMemory(NamedTuple):
    """psi, r, bias, order."""

    heading: float
    rate: float
    bias: float
    order: float


KALMAN_PID_BEGINS = KalmanPidMemory(0.0, 0.0, 0.0, 0.0)


def kalman_pid_step(
    helm: KalmanPid, memory: KalmanPidMemory, heading: float, rate: float, dt: float
) -> tuple[float, KalmanPidMemory]:
    """Return the order [rad] and the memory."""
    psi = memory.heading + dt * memory.rate
    r = memory.rate + dt * (helm.drive * (memory.order + memory.bias) - helm.decay * memory.rate)
    off = wrap(heading - psi)
    turned = 0.0 if math.isnan(rate) else rate - r
    psi = wrap(psi + helm.on_heading * off)
    r += helm.on_rate * off + helm.rate_weight * turned
    bias = min(max(memory.bias + helm.on_bias * (off + turned), -0.5), 0.5)
    wanted = -helm.kp * psi - helm.kd * r - bias
    order = _limited(helm.rudder, memory.order, memory.order + _share(dt, helm.smoothing) * (wanted - memory.order), dt)
    return order, KalmanPidMemory(psi, r, bias, order)


RUDDER, ORDER = 2, 6
"""Places of the rudder and of the order in the LQG law's state, both beyond those that hold against the steady wind;
from ORDER on the orders under way."""


class Lqg(NamedTuple):
    """x' = transition x + move u, Kalman gain on what instruments show, feedback [1 a step], and the play [rad], 0: the
    linear law."""

    transition: Floats
    move: Floats
    gain: Floats
    feedback: Floats
    has_rate: bool
    play: float
    rudder: Rudder


def lqg_step(helm: Lqg, memory: tuple[Floats, Floats], heading: float, rate: float, dt: float) -> Any:
    """Return the order [rad] and the memory, which is written in place: x, and (order, what it was moved by)."""
    x, order = memory
    n = len(x)
    ahead = np.zeros(n)
    for i in range(n):
        for j in range(n):
            ahead[i] += helm.transition[i, j] * x[j]
        ahead[i] += helm.move[i] * order[1]
    off = wrap(heading - ahead[0])
    turned = rate - ahead[1] if helm.has_rate else 0.0
    change = 0.0
    for i in range(n):
        x[i] = ahead[i] + helm.gain[i, 0] * off + helm.gain[i, 1] * turned
    for i in range(n):
        change -= helm.feedback[i] * x[i]
    if helm.play > 0.0:
        # what the order is off the wish, of which the linear law makes up a share each step
        change /= helm.feedback[ORDER]
        change -= min(max(change, -helm.play), helm.play)
    new = _limited(helm.rudder, order[0], order[0] + change, dt)
    order[1] = new - order[0]
    order[0] = new
    return new, (x, order)


class Beliefs(NamedTuple):
    """What the pilot takes a sea for: waves that are a heading of their own, an oscillator of a `damping` [-], and a
    `doubt` of its model [(rad/s)^2/s]."""

    damping: float
    doubt: float


def lqg_laws(
    boat: tuple[Norrbin, float, float], sea: Any, instruments: Any, rudder: Rudder, beliefs: Beliefs | None = None
) -> list[Lqg]:
    """Return the linear laws of a boat (model, lag of its rudder [s], path [s]) by weight on the rudder's rate;
    everything is known to them but the deviates, or taken for what the `beliefs` say."""
    model, lag, path = boat
    dt = 1.0 / instruments.hz
    f, g, q = lqg_system(lag, round(path / dt), pushed(model, sea, beliefs), dt)
    n = len(f)
    h = np.eye(2 if instruments.has_rate else 1, n)
    noises = np.radians([max(instruments.heading_deg, 1.0e-3), max(instruments.rate_deg_s, 1.0e-3)])
    r = np.diag(noises[: len(h)] ** 2)
    p = solve_discrete_are(f.T, h.T, q + 1.0e-14 * np.eye(n), r)
    gain = p @ h.T @ np.linalg.inv(h @ p @ h.T + r)
    found = []
    for weight in np.logspace(-2.5, 1.5, 12):
        cost = np.zeros((n, n))
        cost[0, 0] = 1.0
        for i, j in ((6, 6), (5, 5), (5, 6), (6, 5)):
            cost[i, j] = 1.0e-9
        w = np.array([[(weight * instruments.hz) ** 2]])
        x = solve_discrete_are(f, g, cost, w)
        k = np.linalg.solve(w + g.T @ x @ g, g.T @ x @ f)[0]
        both = np.zeros((n, 2))
        both[:, : len(h)] = gain
        found.append(Lqg(f, g[:, 0].copy(), both, k, bool(instruments.has_rate), 0.0, rudder))
    return found


def lqg_between(laws: list[Lqg], numbers: Floats) -> Lqg:
    """Return the law at the place numbers[0] among `laws`: what it wants of heading, rate and both states of the waves
    times exp of the next four numbers, with the play exp(numbers[5]) [deg]."""
    place = min(max(float(numbers[0]), 0.0), len(laws) - 1.001)
    share, wants = place % 1.0, [law.feedback / law.feedback[ORDER] for law in laws]
    wish = (1.0 - share) * wants[int(place)] + share * wants[int(place) + 1]
    wish[[0, 1, 3, 4]] *= np.exp(numbers[1:5])
    return laws[0]._replace(feedback=wish, play=math.radians(math.exp(numbers[5])))


def pushed(model: Norrbin, sea: Any, beliefs: Beliefs | None) -> tuple[Floats, Floats]:
    """Return slopes and noise of (psi, r, rudder, two of the waves, gusts), those of the rudder aside."""
    a, q = np.zeros((6, 6)), np.zeros((6, 6))
    drive, n, w = model.gain / model.time_constant, model.n1 / model.time_constant, sea.frequency
    a[0, 1], a[1, 1] = 1.0, -n
    a[1, 2] = a[1, 5] = drive
    a[5, 5] = -1.0 / sea.gust_time
    q[5, 5] = 2.0 / sea.gust_time * math.radians(sea.gusts) ** 2
    if beliefs is None:
        a[1, 4] = drive
        a[3, 4], a[4, 3], a[4, 4] = w, -w, -2.0 * sea.damping * w
        q[4, 4] = 4.0 * sea.damping * w * math.radians(sea.waves) ** 2
    else:
        # waves of the heading that the true ones make, in psi and r as well
        ringing, size = 2.0 * beliefs.damping * w, (drive * math.radians(sea.waves)) ** 2 / (w * w * (w * w + n * n))
        a[1, 3], a[1, 4] = -w * w, n - ringing
        a[3, 4], a[4, 3], a[4, 4] = 1.0, -w * w, -ringing
        q[np.ix_((1, 4), (1, 4))] = 2.0 * ringing * w * w * size
        q[1, 1] += beliefs.doubt
    return a, q


def lqg_system(lag: float, late: int, moves: tuple[Floats, Floats], dt: float) -> tuple[Floats, Floats, Floats]:
    """Return transition, move and noise of (psi, r, rudder, two of the waves, gusts, the order and the `late` orders
    before it) over `dt` [s] where the boat is `pushed` as `moves` say; a step's command moves the order."""
    (a, q), n = moves, 6
    a[2, 2] = -1.0 / max(lag, 1.0e-3)
    b = np.zeros((n, 1))
    b[2, 0] = 1.0 / max(lag, 1.0e-3)
    both = expm(dt * np.block([[a, b], [np.zeros((1, n + 1))]]))
    f, g = both[:n, :n], both[:n, n:]
    van = expm(dt * np.block([[-a, q], [np.zeros((n, n)), a.T]]))
    noise = van[n:, n:].T @ van[:n, n:]
    whole, move, driven = np.zeros((n + 1 + late,) * 2), np.zeros((n + 1 + late, 1)), np.zeros((n + 1 + late,) * 2)
    whole[:n, :n], driven[:n, :n] = f, 0.5 * (noise + noise.T)
    whole[n, n] = move[n, 0] = 1.0
    for i in range(late):
        whole[n + 1 + i, n + i] = 1.0
    if late:
        whole[:n, n + late - 1 : n + late] = g
    else:
        whole[:n, n : n + 1], move[:n] = g, g
    return whole, move, driven
