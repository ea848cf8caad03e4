"""A rudder on on/off valves: how well a course is held, and how often a valve is opened for it.

    python benchmarks/valves.py [--seeds 2] [--seconds 160] [--boat yacht]

In lockstep: compass and rate gyro over NMEA, valves on a simulated Maestro (`sitl.drives.ValveController`, whose oil is
not that of `autopilot.models.steering_gear`), gains designed for each boat. The peer is a plain three-point controller
behind the same pilot: a valve opens where the rudder is wrong by more than a dead band and shuts within half of it. Its
band is tuned on each boat and sea: of all BANDS those whose heading is within a twentieth of Norrbin's or better, and
of these the one with the fewest openings; where none is, the one with the best heading. A third row gives it Norrbin's
zone of a still order.
"""

from __future__ import annotations

import argparse
import dataclasses
import math
from typing import NamedTuple

from autopilot.angles import wrap
from autopilot.api import design
from autopilot.links.drives import DriveLink, DriveLinkSettings, DriveSettings
from autopilot.links.drives.maestro import ValveDrive
from autopilot.links.nmea.link import NmeaLink
from autopilot.links.transports import loopback_pair
from autopilot.links.url import parse_url
from autopilot.models.steering_gear import Gate, Valve
from autopilot.runtime.build import build_pilot, follow_of
from autopilot.runtime.build_links import drive_settings_of, nmea_settings_of
from autopilot.signals import Order, OrderKind
from autopilot.vessel.file import load_vessel
from autopilot.vessel.schema import Drive, Vessel
from autopilot.vessel.schema import Valves as ValvesSection
from sitl.drives import ValveController
from sitl.scenario import HullSection, Scenario, load_scenario
from sitl.wire_nmea import NmeaInstruments
from sitl.world import World

STEP = 0.02
SETTLES_S = 40.0
BANDS = (0.5, 0.7, 1.0, 1.4, 2.0, 2.8)
"""Dead bands [deg] that the peer is tried with."""
COURSE = math.radians(20.0)
PORT, STARBOARD = 3.7, 5.0
"""Rates [deg/s]: a ram whose rod takes a quarter of its area."""


class Held(NamedTuple):
    """rms of the heading error [deg], openings a minute, share of the time that a valve was open, greatest error."""

    rms: float
    openings: float
    duty: float
    worst: float


class ThreePoint(ValveDrive):
    """The peer: a dead band, and nothing known of opening, running on and least pulse."""

    def __init__(self, settings: DriveSettings, band: float) -> None:
        super().__init__(settings)
        self.band = band
        rates = self._valve.port, self._valve.starboard
        self._valve = Valve(*rates, 0.0, 0.0, 0.0)

    def order(self, now: float, angle: float) -> bytes:
        """Open beyond the band, shut within half of it or beyond the order."""
        before = self._gate
        super().order(now, self._rudder.angle)  # keeps time and reckoning; opens nothing
        error = min(max(angle, -self._settings.stop), self._settings.stop) - self._rudder.angle
        side = before.side
        if side and side * error <= 0.5 * self.band:
            side = 0
        elif not side and abs(error) > self.band:
            side = 1 if error > 0.0 else -1
        self._gate = before if side == before.side else Gate(side, now, side)
        self.openings += side != 0 and before.side == 0
        return self._outputs()


def yacht() -> tuple[Vessel, dict[str, Scenario]]:
    """Return a motor yacht of 12 m at 4 m/s, and its seas."""
    base = load_vessel("lanxin")
    model = dataclasses.replace(
        base.model, K_1_s=0.25, T_s=3.0, n3_s2_rad2=20.0, n0_rad_s=0.0, reference_speed_m_s=4.0, n1=1.0
    )
    hull = HullSection(length_m=12.0, beam_m=3.8, draught_m=1.0, drift_lever_m=3.0, roll_period_s=4.0)
    seas = {"calm": load_scenario("calm"), "1 m, 4 s": load_scenario("ittc")}
    vessel = dataclasses.replace(base, model=model, length_m=12.0)
    return vessel, {name: dataclasses.replace(sea, hull=hull) for name, sea in seas.items()}


def training_ship() -> tuple[Vessel, dict[str, Scenario]]:
    """Return the Zeefakkel, 45 m, and its seas."""
    hull = HullSection(length_m=45.0, beam_m=8.0, draught_m=2.5, drift_lever_m=12.0, roll_period_s=8.0)
    seas = {"calm": load_scenario("calm"), "sea state 5": load_scenario("sea-state-5")}
    return load_vessel("zeefakkel"), {name: dataclasses.replace(sea, hull=hull) for name, sea in seas.items()}


def on_valves(vessel: Vessel, has_sensor: bool) -> Vessel:
    """Return the vessel steered by valves, its gains designed for their rates."""
    rudder = dataclasses.replace(
        vessel.rudder, rate_max_deg_s=STARBOARD, rate_port_deg_s=PORT, lag_s=0.0, delay_s=0.0, dead_band_deg=0.0
    )
    drive = Drive(valve=ValvesSection(sensor_channel=5 if has_sensor else None), rate_hz=20.0)
    sensors = dataclasses.replace(vessel.sensors, variation_deg=0.0)
    return design(dataclasses.replace(vessel, rudder=rudder, drive=drive, sensors=sensors))


def held(vessel: Vessel, sea: Scenario, seed: int, seconds: float, band: float | None) -> Held:
    """Return how a course was held with the valves, or with the peer's `band` [deg]."""
    world = World(vessel, sea, seed=seed)
    compass = NmeaInstruments(world, {"HDT": 10.0, "ROT": 10.0}, 38400)
    board = ValveController(world, 115200)
    near, far = loopback_pair()
    instruments = NmeaLink(near, nmea_settings_of(vessel, parse_url("nmea:/dev/x:38400?steer=no")))
    drive_near, drive_far = loopback_pair()
    settings = drive_settings_of(vessel)
    drive = ValveDrive(settings) if band is None else ThreePoint(settings, math.radians(band))
    link = DriveLink(drive_near, drive, DriveLinkSettings(115200, 20.0, follow_of(vessel)))
    pilot = build_pilot(vessel)
    order = Order(OrderKind.HEADING, COURSE, serial=1)
    errors, before = [], (0, 0.0)
    for number in range(round((SETTLES_S + seconds) / STEP)):
        now = STEP * number
        compass.receive(now, b"")
        for data in drive_far.receive():
            board.receive(now, data)
        for data in compass.transmit(now):
            far.send(data)
        for data in board.transmit(now):
            drive_far.send(data)
        samples = [*instruments.receive(now), *link.receive(now)]
        if samples or number % 3 == 0:
            tick = pilot.step(now, tuple(samples), order)
            link.send(now, tick.command)
        link.poll(now)
        if now < SETTLES_S:
            before = board.openings, drive.open_s
        else:
            errors.append(math.degrees(wrap(world.boat.state.heading - COURSE)))
    mean = sum(errors) / len(errors)
    rms = math.sqrt(sum(each * each for each in errors) / len(errors))
    opened = (board.openings - before[0]) * 60.0 / seconds
    assert abs(mean) < 20.0, "the course is not held at all"
    return Held(rms, opened, (drive.open_s - before[1]) / seconds, max(abs(each) for each in errors))


def mean_of(runs: list[Held]) -> Held:
    """Return the mean of runs; of the greatest errors the greatest."""
    count = len(runs)
    rms, openings, duty = (sum(run[place] for run in runs) / count for place in range(3))
    return Held(rms, openings, duty, max(run.worst for run in runs))


BOATS = {"yacht": yacht, "Zeefakkel": training_ship}


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--seconds", type=float, default=160.0)
    parser.add_argument("--boat", choices=BOATS, action="append")
    given = parser.parse_args()
    print("| boat | sea | sensor | who | rms deg | most deg | openings/min | duty |\n|---|---|---|---|---|---|---|---|")
    for boat in given.boat or BOATS:
        base, seas = BOATS[boat]()
        for has_sensor in (True, False):
            vessel = on_valves(base, has_sensor)
            zone = math.degrees(ValveDrive(drive_settings_of(vessel)).zone)
            for sea, scenario in seas.items():

                def runs(band: float | None, vessel: Vessel = vessel, scenario: Scenario = scenario) -> Held:
                    seeds = range(1, given.seeds + 1)
                    return mean_of([held(vessel, scenario, seed, given.seconds, band) for seed in seeds])

                ours = runs(None)
                tried = {band: runs(band) for band in BANDS}
                as_good = {band: each for band, each in tried.items() if each.rms <= 1.05 * ours.rms}
                best = min(as_good or tried, key=lambda band: tried[band].openings if as_good else tried[band].rms)
                rows = {
                    f"Norrbin, zone {zone:.2f} deg": ours,
                    f"three-point, tuned, band {best:g} deg": tried[best],
                    "three-point, Norrbin's zone": runs(zone),
                }
                for who, row in rows.items():
                    print(
                        f"| {boat} | {sea} | {'yes' if has_sensor else 'no'} | {who} | {row.rms:.2f} | {row.worst:.1f} "
                        f"| {row.openings:.1f} | {row.duty:.3f} |",
                        flush=True,
                    )


if __name__ == "__main__":
    main()
