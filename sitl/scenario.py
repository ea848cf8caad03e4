"""Scenario files: the sea, the sensors, the faults and the start of one simulated run. Read strictly."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

from autopilot.files import typed
from autopilot.files.strict_yaml import Node, check_version
from autopilot.files.typed import Bounds, Shipped
from sitl.registry import USUAL, FaultKind, PlantName, Source, wrong_size, wrong_source

SCHEMA_VERSION = 1
SCENARIOS = Shipped("sitl", "scenarios", "a shipped scenario")

Degrees = Annotated[float, Bounds(-360.0, 360.0, "direction, clockwise from north")]
Seconds = Annotated[float, Bounds(0.0, 1.0e6, "simulated time since the start")]


@dataclass(frozen=True)
class Start:
    """Where and how the boat starts; speed null: the reference speed of the vessel's model."""

    latitude_deg: Annotated[float, Bounds(-89.0, 89.0, "latitude")] = 57.6900
    longitude_deg: Annotated[float, Bounds(-180.0, 180.0, "longitude")] = 11.8400
    heading_deg: Degrees = 0.0
    speed_m_s: Annotated[float, Bounds(0.0, 50.0, "speed through the water, also what the throttle holds")] | None = (
        None
    )
    unix_time_s: Annotated[int, Bounds(0, 4102444800, "date and time of the start")] = 1780308000


@dataclass(frozen=True)
class HullSection:
    """What the identified model leaves out; the numbers are those of `sitl.boat.Hull`."""

    length_m: Annotated[float, Bounds(0.2, 500.0, "length")] = 7.0
    beam_m: Annotated[float, Bounds(0.1, 80.0, "beam")] = 2.5
    draught_m: Annotated[float, Bounds(0.02, 30.0, "draught")] = 0.5
    speed_time_s: Annotated[float, Bounds(0.1, 1000.0, "time in which the speed settles")] = 4.0
    turn_speed_loss: Annotated[float, Bounds(0.0, 10.0, "c in U = U0/(1 + c (r L/U)^2)")] = 0.3
    drift_lever_m: Annotated[float, Bounds(0.0, 200.0, "sway speed per yaw rate")] = 2.0
    sway_time_s: Annotated[float, Bounds(0.01, 1000.0, "time in which the drift settles")] = 1.0
    roll_period_s: Annotated[float, Bounds(0.5, 60.0, "natural roll period")] = 2.5
    roll_damping: Annotated[float, Bounds(0.01, 1.0, "damping ratio in roll")] = 0.15
    roll_lever: Annotated[float, Bounds(-5.0, 5.0, "outward heel = lever r U/g")] = 0.3


@dataclass(frozen=True)
class GearSection:
    """The steering gear of a plant that has its own; null: as it is. The usual plant's is that of the vessel file."""

    rate_deg_s: Annotated[float, Bounds(0.01, 1000.0, "rate")] | None = None
    lag_s: Annotated[float, Bounds(0.0, 100.0, "lag")] | None = None
    dead_band_deg: Annotated[float, Bounds(0.0, 20.0, "no movement within it, each way")] | None = None
    play_deg: Annotated[float, Bounds(0.0, 20.0, "backlash of the linkage, each way")] = 0.0
    on_off: bool = False
    """A valve or relay: the rudder runs at its full rate or stands still; give it a dead band."""


@dataclass(frozen=True)
class SecondOrderSection:
    """Waves as white noise through 2 xi w0 sigma s/(s^2 + 2 xi w0 s + w0^2), an equivalent rudder in degrees."""

    frequency_rad_s: Annotated[float, Bounds(0.01, 20.0, "w0")]
    damping: Annotated[float, Bounds(0.001, 0.999, "xi")]
    sigma_deg: Annotated[float, Bounds(0.0, 1000.0, "sigma of the numerator, output in degrees of rudder")]
    noise_power: Annotated[float, Bounds(0.0, 1000.0, "intensity of the white noise")] = 0.1


@dataclass(frozen=True)
class IttcSection:
    """A long-crested sea of the ITTC two-parameter spectrum; it comes from `from_deg`."""

    significant_height_m: Annotated[float, Bounds(0.0, 30.0, "significant wave height")]
    peak_period_s: Annotated[float, Bounds(0.5, 40.0, "period of the spectrum's peak")]
    from_deg: Degrees = 0.0
    components: Annotated[int, Bounds(2, 500, "number of sine waves")] = 60


@dataclass(frozen=True)
class WavesSection:
    """Either kind of waves, both, or none."""

    second_order: SecondOrderSection | None = None
    ittc: IttcSection | None = None


@dataclass(frozen=True)
class WindSection:
    """Wind over the ground and how the boat answers to it."""

    speed_m_s: Annotated[float, Bounds(0.0, 60.0, "mean wind speed")] = 0.0
    from_deg: Degrees = 0.0
    gust_m_s: Annotated[float, Bounds(0.0, 30.0, "standard deviation of the gusts")] = 0.0
    gust_time_s: Annotated[float, Bounds(0.1, 1000.0, "correlation time of the gusts")] = 10.0
    rudder_deg_per_m2_s2: Annotated[float, Bounds(-1.0, 1.0, "equivalent rudder c in c V^2 sin(2 gamma)")] = 0.003
    leeway: Annotated[float, Bounds(0.0, 0.2, "drift speed per wind speed abeam")] = 0.01


@dataclass(frozen=True)
class CurrentSection:
    """A uniform current."""

    speed_m_s: Annotated[float, Bounds(0.0, 10.0, "speed of the current")] = 0.0
    towards_deg: Degrees = 0.0


@dataclass(frozen=True)
class SensorsSection:
    """What the instruments make of the truth; null: as the vessel file says."""

    heading_noise_deg: Annotated[float, Bounds(0.0, 30.0, "standard deviation of the heading")] | None = None
    rate_noise_deg_s: Annotated[float, Bounds(0.0, 30.0, "standard deviation of the yaw rate")] | None = None
    latency_s: Annotated[float, Bounds(0.0, 5.0, "age of heading, rate and roll when they leave the sensor")] | None = (
        None
    )
    heading_offset_deg: Annotated[float, Bounds(-180.0, 180.0, "constant error of the heading")] = 0.0
    heading_step_deg: Annotated[float, Bounds(0.0, 10.0, "resolution of the heading, 0: unlimited")] = 0.0
    roll_noise_deg: Annotated[float, Bounds(0.0, 10.0, "standard deviation of the roll")] = 0.1
    rudder_noise_deg: Annotated[float, Bounds(0.0, 10.0, "standard deviation of the rudder feedback")] = 0.05
    speed_noise_m_s: Annotated[float, Bounds(0.0, 5.0, "standard deviation of speeds")] = 0.05
    position_noise_m: Annotated[float, Bounds(0.0, 100.0, "standard deviation of positions")] = 0.5
    wind_angle_noise_deg: Annotated[float, Bounds(0.0, 90.0, "standard deviation of the wind vane")] = 3.0
    wind_speed_noise_m_s: Annotated[float, Bounds(0.0, 10.0, "standard deviation of the anemometer")] = 0.3
    variation_deg: Annotated[float, Bounds(-180.0, 180.0, "magnetic variation, east positive")] | None = None
    compass_sends_variation: bool = True
    """Whether HDG carries the variation; many a compass leaves the field empty."""


@dataclass(frozen=True)
class FaultSection:
    """One fault and when it lasts, in simulated seconds since the start; to_s null: to the end of the run."""

    kind: FaultKind
    from_s: Seconds
    to_s: Seconds | None = None
    size: Annotated[float, Bounds(None, None, "its unit is that of its kind")] | None = None
    """Null: as large as its kind is by default."""
    ramp_s: Annotated[float, Bounds(0.0, 1.0e6, "time in which the size grows from 0")] = 0.0
    every_s: Annotated[float, Bounds(0.01, 1.0e6, "mean time without it, for a fault that comes and goes")] | None = (
        None
    )
    lasts_s: Annotated[float, Bounds(0.01, 1.0e6, "how long it stays when it comes and goes")] = 1.0
    source: Source = "both"
    """Of a compass and its rate gyro: the flight controller's is the first, that on the NMEA line the second."""


@dataclass(frozen=True)
class VehicleSection:
    """How the simulated flight controller starts."""

    armed: bool = True
    mode: Literal["MANUAL", "HOLD", "GUIDED"] = "MANUAL"
    receiver: bool = True
    """Whether a radio receiver is fitted, whose sticks stand still: steering centred, throttle at the start speed."""
    firmware: Literal["4.5", "4.6", "4.7", "4.8", "px4-1.17"] = "4.6"
    """ArduRover of this version, or PX4's rover, whose Offboard mode is then GUIDED. From 4.8 on RC_OPTIONS bit 14 lets
    a stick that moves end overrides, and in GUIDED the heading of a target is reported."""
    boot_s: Annotated[float, Bounds(0.0, 120.0, "time after power-up before the firmware is ready")] = 0.0
    position_after_s: Annotated[float, Bounds(0.0, 600.0, "time after power-up before there is a position")] = 0.0


@dataclass(frozen=True)
class DriveSection:
    """The rudder drive on the NMEA line."""

    silence_s: Annotated[float, Bounds(0.1, 60.0, "orders older than this are released")] = 2.0
    released: Literal["amidships", "hold"] = "amidships"


@dataclass(frozen=True)
class Scenario:
    """One simulated run; everything has a default: a calm sea."""

    schema_version: int
    name: str
    description: str = ""
    seed: Annotated[int, Bounds(0, 2**63 - 1, "seed of all random numbers")] = 1
    start: Start = field(default_factory=Start)
    plant: PlantName = USUAL
    """Whose equations move the boat. The usual plant takes its numbers from the vessel file and `hull`; the others have
    their own, and `scale` and `gear`."""
    hull: HullSection = field(default_factory=HullSection)
    scale: Annotated[float, Bounds(0.01, 1000.0, "lengths of a plant that has its own, by Froude's law")] = 1.0
    depth_draughts: Annotated[float, Bounds(1.2, 100.0, "depth of the water in draughts")] | None = None
    """Of a plant that knows shallow water; null: deep."""
    gear: GearSection = field(default_factory=GearSection)
    waves: WavesSection = field(default_factory=WavesSection)
    wind: WindSection = field(default_factory=WindSection)
    current: CurrentSection = field(default_factory=CurrentSection)
    sensors: SensorsSection = field(default_factory=SensorsSection)
    faults: tuple[FaultSection, ...] = ()
    vehicle: VehicleSection = field(default_factory=VehicleSection)
    drive: DriveSection = field(default_factory=DriveSection)
    route: tuple[tuple[float, float], ...] = ()
    """Waypoints of the chart plotter, [north m, east m] of the start; it speaks APB, RMB, XTE and HTD about them."""


def shipped_scenarios() -> list[str]:
    """Return the names of the scenarios that come with the product."""
    return SCENARIOS.names()


def load_scenario(path_or_name: str | Path) -> Scenario:
    """Return the scenario of a YAML file, or the shipped one of that name (`calm`). Raises InputError."""
    return scenario_from(SCENARIOS.document(path_or_name))


def check_faults(root: Node, key: str, faults: Sequence[FaultSection]) -> None:
    """Raise InputError where one of the faults, which stand at `key`, cannot be."""
    for index, fault in enumerate(faults):
        if fault.to_s is not None and fault.to_s <= fault.from_s:
            raise root.at("faults").fault(
                f"{key}[{index}] ends at to_s {fault.to_s:g}, it must end after from_s ({fault.from_s:g})."
            )
        if wrong := wrong_size(fault.kind, fault.size) or wrong_source(fault.kind, fault.source):
            raise root.at("faults").fault(f"{key}[{index}]: {wrong}")


def scenario_from(root: Node) -> Scenario:
    """Return the scenario that a document holds, checked across its fields. Raises InputError."""
    check_version(root, SCHEMA_VERSION, "scenario")
    scenario = typed.read(root, Scenario)
    check_faults(root, "faults", scenario.faults)
    for index, (one, other) in enumerate(itertools.pairwise(scenario.route)):
        if math.hypot(other[0] - one[0], other[1] - one[1]) < 1.0:
            raise root.at("route").fault(f"route[{index + 1}] is the place of the waypoint before it; leave one out.")
    return scenario
