"""The peer of the Pareto study: a PID on the compass alone, with filters, dead bands and anti-windup of its own.

    e = heading, low-passed, less the course;  d = its derivative, low-passed again
    rudder = -kp z - kd d + I,   I' = -ki z + anti-windup,   z = e outside the weather band, 0 inside

It is the step of the product's PID between what commercial pilots put around theirs: a first-order low-pass on the
heading and one on the derivative, a weather band inside which the heading error does not count, and a dead band inside
which the order stays as it was. On a straight course its feed-forward, the rudder of the planned turn, is nought. No
monitor and no fail-safe interferes with it.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from autopilot.angles import wrap
from autopilot.control.law import NO_ROLL, LawInput
from autopilot.control.limits import Rest, RudderLimits, limit, rested
from autopilot.control.pid import BoatPid, PidGains, PidMemory
from autopilot.control.pid import step as pid_step
from autopilot.models.norrbin import Norrbin
from autopilot.models.steering_gear import clip
from autopilot.signals import NavState, Reference
from sitl.boat import BoatState, Disturbance, boat_step
from sitl.campaign.compiled_run import CALM, NOTHING, Score, Setting, Workspace, ordered, readings, scored
from sitl.campaign.environment import WaterState, water_step

ANY_BOAT = Norrbin(1.0, 1.0, 0.0, 0.0, 1.0, 0.0, 1.0)
"""The peer knows no model: on a straight course its feed-forward is nought for any."""


class Peer(NamedTuple):
    """Gains; time constants [s] of the filters on heading and derivative; weather band and dead band [rad]."""

    gains: PidGains
    heading_time: float
    rate_time: float
    weather: float
    dead_band: float


class PeerState(NamedTuple):
    """Filtered heading [rad] and derivative [rad/s], the integrator, the order and the dead band's memory."""

    heading: float
    rate: float
    pid: PidMemory
    rest: Rest


def peer_tick(
    peer: Peer, limits: RudderLimits, pilot_state: PeerState, dt: float, heading: float, target: float
) -> PeerState:
    """Return the state `dt` [s] later, with a `heading` [rad] on the way to the heading `target` [rad]."""
    moved = wrap(heading - pilot_state.heading) * low_pass(dt, peer.heading_time)
    filtered = wrap(pilot_state.heading + moved)
    rate = pilot_state.rate + (moved / dt - pilot_state.rate) * low_pass(dt, peer.rate_time)
    error = wrap(filtered - target)
    seen = target + error - clip(error, -peer.weather, peer.weather)
    state = NavState(0.0, seen, rate, 1.0, 0.0, 0.0, 0.0, True)
    given = LawInput(
        ANY_BOAT, 1.0, Reference(target, 0.0, 0.0), state, NO_ROLL, pilot_state.rest.allowed, limits.angle_max, dt
    )
    wanted, pid = pid_step(BoatPid(peer.gains, math.nan), pilot_state.pid, given)
    limited = limit(limits, pilot_state.rest.command, wanted, dt)
    return PeerState(filtered, rate, pid, rested(limits, peer.dead_band, pilot_state.rest, wanted, limited))


def low_pass(dt: float, time: float) -> float:
    """Return the share of its way that a first-order filter of `time` [s] goes in `dt` [s]."""
    return -math.expm1(-dt / time) if time > 0.0 else 1.0


class Afloat(NamedTuple):
    """Boat and sea on the way, how many orders have been taken to the rudder, and the order [rad] in force."""

    state: BoatState
    water: WaterState
    acting: Disturbance
    taken: int
    order: float


def set_afloat(setting: Setting) -> Afloat:
    """Return boat and sea at the start of a run."""
    return Afloat(setting.start, WaterState(setting.swell, 0.0, 0.0, 0), CALM, 0, 0.0)


def afloat_step(setting: Setting, workspace: Workspace, afloat: Afloat, step: int, command: float) -> Afloat:
    """Return boat and sea after step number `step` with the commanded rudder `command` [rad]; as in
    `sitl.campaign.compiled_run`."""
    dt, taken, order = setting.dt, afloat.taken, afloat.order
    water, acting = afloat.water, afloat.acting
    workspace.orders[step % len(workspace.orders)] = command
    while taken <= step and taken * dt + setting.plant.gear.delay <= step * dt:
        order = workspace.orders[taken % len(workspace.orders)]
        taken += 1
    if step % setting.water_every == 0:
        number, felt_dt = step // setting.water_every, dt * setting.water_every
        water, acting = water_step(setting.water, workspace.surface, water, number, felt_dt, afloat.state)
    state = boat_step(setting.plant, setting.step, afloat.state, order, setting.thrust_speed, acting)
    return Afloat(state, water, acting, taken, order)


def run_peer(setting: Setting, workspace: Workspace, peer: Peer) -> Score:
    """Return the score of a run steered by the peer, compass up to date."""
    instruments, course, afloat = setting.instruments, setting.course, set_afloat(setting)
    every, limits = instruments.every * setting.dt, setting.campaign.config.limits
    heading, _, _ = readings(instruments, 0, afloat.state)
    pilot_state = PeerState(wrap(heading), 0.0, PidMemory(0.0, math.nan), Rest(0.0, 0.0, False))
    score, command = NOTHING, 0.0
    for step in range(setting.steps):
        if step % instruments.every == 0:
            time, state = step * setting.dt, afloat.state
            pilot_state = peer_tick(peer, limits, pilot_state, every, wrap(heading), ordered(course, time))
            score = scored(score, course, time, state, command, pilot_state.rest.command)
            command = pilot_state.rest.command
        afloat = afloat_step(setting, workspace, afloat, step, command)
        if (step + 1) % instruments.every == 0:
            heading, _, _ = readings(instruments, (step + 1) // instruments.every, afloat.state)
    return score
