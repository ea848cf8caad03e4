"""Boats, seas and one simulated run for the steering studies in this folder.

The boat is `sitl`'s (steering gear with lag, delay and rate, speed lost in turns), the sea its ITTC sea with wind and
gusts from the same side, the pilot the product's. No links and no clock: a run depends on its arguments alone.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.signal import butter, sosfiltfilt

from autopilot.angles import wrap
from autopilot.control.backstepping import Backstepping
from autopilot.control.design import design_backstepping
from autopilot.control.pid import Pid, equivalent_pid
from autopilot.models.norrbin import Norrbin
from autopilot.models.steering_gear import SteeringGear
from autopilot.runtime.build import build_pilot, gear_of, model_of
from autopilot.signals import HeadingSample, Order, OrderKind, Sample, SpeedSample
from autopilot.vessel.schema import Control, Model, Rudder, Sensors, Vessel
from sitl.boat import Boat, BoatState, Hull, Plant
from sitl.scenario import IttcSection, Scenario, WavesSection, WindSection
from sitl.sea import Sea

CONTROL_HZ, COMPASS_HZ, PLANT_HZ = 20, 10, 40
SLOW_RAD_S = 0.25
"""Below this frequency a heading error counts as the course's, not the waves'."""

Floats = npt.NDArray[np.float64]


Helmsman = Callable[[float, tuple[Sample, ...]], float]
"""Time [s] and the samples that arrived -> rudder order [rad]."""


class StudyBoat(NamedTuple):
    """A vessel file's contents and the hull around it."""

    vessel: Vessel
    hull: Hull


class StudySea(NamedTuple):
    """Significant height [m], peak period [s], mean wind and gusts [m/s]."""

    height: float
    period: float
    wind: float
    gust: float


SEAS = {
    # WMO-No. 306, code table 3700, middles of the ranges; peak periods and winds of the open ocean, Bales 1982
    "calm": StudySea(0.0, 1.0, 0.0, 0.0),
    "state 3": StudySea(0.88, 7.5, 7.0, 1.0),
    "state 5": StudySea(3.25, 9.7, 12.0, 1.5),
}


class Record(NamedTuple):
    """Columns by control tick: time [s], true heading [rad], rudder order [rad]."""

    time: Floats
    heading: Floats
    order: Floats


class Figures(NamedTuple):
    """rms of the whole true heading error, of its part below SLOW_RAD_S [deg], and rudder travel [deg/s]."""

    heading_deg: float
    slow_deg: float
    travel_deg_s: float


def _boat(name: str, model: Norrbin, rudder_deg_s: float, hull: Hull) -> StudyBoat:
    gear = SteeringGear(math.radians(30.0), math.radians(rudder_deg_s), 0.1, 0.0, 0.05)
    gains = design_backstepping(model, gear, gear.rate_max, 0.05)
    pid = equivalent_pid(model, gains, 10.0 + 3.0 * model.time_constant)
    vessel = Vessel(
        2,
        name,
        Model(model.gain, model.time_constant, model.reference_speed, model.n1, model.n3),
        Rudder(30.0, rudder_deg_s, 0.1, 0.05),
        sensors=Sensors(heading_noise_deg=0.3, rate_noise_deg_s=0.2),
        control=Control(backstepping=Backstepping(*gains), pid=Pid(*pid)),
    )
    return StudyBoat(vessel, hull)


def boats() -> dict[str, StudyBoat]:
    """Return the boats, gains designed from their own models; the first is that of Jiang et al. 2016."""
    return {
        "lanxin": _boat("lanxin", Norrbin(0.701, 0.332, 3.2828, reference_speed=4.63), 15.0, Hull()),
        "launch": _boat(
            "launch",
            Norrbin(0.2, 5.0, 5.0, reference_speed=4.0),
            5.0,
            Hull(length=12.0, beam=3.5, draught=1.0, drift_lever=3.0, roll_period=4.0),
        ),
        "coaster": _boat(
            "coaster",
            Norrbin(0.1, 20.0, 50.0, reference_speed=6.0),
            2.5,
            Hull(length=50.0, beam=9.0, draught=3.0, speed_time=30.0, drift_lever=12.0, sway_time=8.0, roll_period=8.0),
        ),
        "tanker": _boat(
            "tanker",
            Norrbin(0.04, 60.0, 4.0e4, n1=-1.0, reference_speed=7.0),
            2.5,
            Hull(
                length=200.0,
                beam=32.0,
                draught=11.0,
                speed_time=200.0,
                drift_lever=50.0,
                sway_time=40.0,
                roll_period=12.0,
            ),
        ),
    }


def lanxin_as_filed(boat: StudyBoat, filed: Vessel) -> StudyBoat:
    """Return the boat with the shipped file's gains."""
    return boat._replace(vessel=dataclasses.replace(boat.vessel, control=filed.control))


def pilot_of(vessel: Vessel) -> Helmsman:
    """Return the product's pilot, ordered to steer north."""
    pilot, order = build_pilot(vessel), Order(OrderKind.HEADING, 0.0, serial=1)
    return lambda now, samples: pilot.step(now, samples, order).command.angle


def sail(
    boat: StudyBoat,
    sea: StudySea,
    from_deg: float,
    seconds: float,
    seed: int,
    helmsman: Helmsman | None = None,
) -> Record:
    """Return a run on course north in a sea from `from_deg`; a `helmsman` takes the pilot's place."""
    waves = WavesSection(ittc=IttcSection(sea.height, sea.period, from_deg) if sea.height > 0.0 else None)
    scenario = Scenario(1, "study", waves=waves, wind=WindSection(sea.wind, from_deg, sea.gust))
    dt = 1.0 / PLANT_HZ
    water = Sea(scenario, boat.hull, np.random.SeedSequence(seed), dt)
    model, speed = model_of(boat.vessel), boat.vessel.model.reference_speed_m_s
    plant = Plant(model, gear_of(boat.vessel), boat.hull)
    vessel, random = Boat(plant, BoatState(speed=speed)), np.random.default_rng(100_000 + seed)
    steer = helmsman or pilot_of(boat.vessel)
    noise, rate_noise = (
        math.radians(boat.vessel.sensors.heading_noise_deg),
        math.radians(boat.vessel.sensors.rate_noise_deg_s),
    )
    rows = np.zeros((round(seconds * CONTROL_HZ), 3))
    for index in range(len(rows)):
        now, state = index / CONTROL_HZ, vessel.state
        samples: tuple[Sample, ...] = ()
        if index % (CONTROL_HZ // COMPASS_HZ) == 0:
            heading = wrap(state.heading + noise * random.standard_normal())
            samples = (HeadingSample(now, heading, state.rate + rate_noise * random.standard_normal()),)
        if index % CONTROL_HZ == 0:
            samples += (SpeedSample(now, state.speed),)
        command = steer(now, samples)
        rows[index] = now, state.heading, command
        for part in range(PLANT_HZ // CONTROL_HZ):
            vessel.step(now + part * dt, command, speed, water.step(now + part * dt, vessel.state), dt)
    return Record(*rows.T)


def figures(record: Record, since: float) -> Figures:
    """Return what a run on course north is judged by, from `since` [s] on."""
    late = record.time >= since
    error = np.degrees(np.angle(np.exp(1j * record.heading[late])))
    rate = 1.0 / (record.time[1] - record.time[0])
    slow = sosfiltfilt(butter(4, SLOW_RAD_S / math.pi / rate, output="sos"), error)
    travel = np.abs(np.diff(np.degrees(record.order[late]))).sum() * rate / (late.sum() - 1)
    return Figures(float(np.sqrt(np.mean(error**2))), float(np.sqrt(np.mean(slow**2))), float(travel))
