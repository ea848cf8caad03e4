"""Sea, wind and current as one boat meets them: random realisations of a scenario from a seed."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from autopilot.models import waves, wind
from autopilot.models.waves import GRAVITY, SecondOrderWaves
from sitl.boat import BoatState, Disturbance, Hull
from sitl.scenario import CurrentSection, IttcSection, Scenario, SecondOrderSection, WindSection


class Deviates:
    """Standard normal deviates one by one, drawn in blocks: a scalar draw costs more than the wave step it drives."""

    def __init__(self, generator: np.random.Generator, block: int = 1024) -> None:
        self._generator = generator
        self._block = block
        self._waiting: list[float] = []

    def next(self) -> float:
        """Return the next deviate."""
        if not self._waiting:
            self._waiting = self._generator.standard_normal(self._block).tolist()
            self._waiting.reverse()
        return self._waiting.pop()


def second_order_waves(section: SecondOrderSection) -> SecondOrderWaves:
    """Return the shaping filter of a scenario's section."""
    gain_deg = 2.0 * section.damping * section.frequency_rad_s * section.sigma_deg
    return SecondOrderWaves(section.frequency_rad_s, section.damping, math.radians(gain_deg), section.noise_power)


class SecondOrderSea:
    """Waves of `autopilot.models.waves.SecondOrderWaves`, as an equivalent rudder angle [rad]."""

    def __init__(self, section: SecondOrderSection, deviates: Deviates, dt: float) -> None:
        model = second_order_waves(section)
        self._deviates = deviates
        self._transition = waves.discretise(model, dt)
        self._state = waves.stationary_state(model, deviates.next(), deviates.next())

    def step(self) -> float:
        """Move one step on and return the equivalent rudder [rad]."""
        self._state = waves.wave_step(self._transition, self._state, self._deviates.next(), self._deviates.next())
        return self._state.value


class IttcWaves(NamedTuple):
    """Wave components, arrays (n,): frequency [rad/s] ascending, number [1/m], slope [rad] at the hull, phase [rad].

    towards [rad]: where they travel; length and beam [m] of the hull they meet; drift [m/s] of the water they run in
    along their way.
    """

    frequency: waves.Array
    number: waves.Array
    slope: waves.Array
    phase: waves.Array
    towards: float
    length: float
    beam: float
    drift: float = 0.0


STILL_WATER = CurrentSection()


def ittc_waves(
    section: IttcSection, hull: Hull, generator: np.random.Generator, current: CurrentSection = STILL_WATER
) -> IttcWaves:
    """Return a random realisation of the sea for this hull."""
    peak = 2.0 * math.pi / section.peak_period_s
    # one frequency somewhere in each band: evenly spaced ones would repeat the sea every few minutes
    band = 2.5 * peak / section.components
    edges = 0.5 * peak + band * np.arange(section.components)
    frequency = edges + band * generator.uniform(0.0, 1.0, section.components)
    number = waves.wave_number(frequency)
    period = waves.mean_period_of(section.peak_period_s)
    amplitude = waves.component_amplitudes(frequency, section.significant_height_m, period)
    slope = amplitude * number * np.exp(-0.5 * number * hull.draught)
    phase = generator.uniform(0.0, 2.0 * math.pi, section.components)
    towards = math.radians(section.from_deg) + math.pi
    drift = current.speed_m_s * math.cos(math.radians(current.towards_deg) - towards)
    return IttcWaves(frequency, number, slope, phase, towards, hull.length, hull.beam, drift)


def way_along(components: IttcWaves, time: float, state: BoatState) -> float:
    """Return the way [m] of a boat along the waves, in the water that the current takes along with them."""
    along = state.north * math.cos(components.towards) + state.east * math.sin(components.towards)
    return along - components.drift * time


def wave_forces(components: IttcWaves, heading: float) -> tuple[waves.Array, waves.Array]:
    """Return the amplitudes of yaw acceleration [rad/s^2] and effective roll slope [rad] (n,) at `heading` [rad]."""
    beta = components.towards - heading
    half = 0.5 * components.number * components.length * math.cos(beta)
    across = 0.5 * components.number * components.beam * math.sin(beta)
    roll = components.slope * math.sin(beta) * np.sinc(across / math.pi)
    return (6.0 / components.length) * GRAVITY * roll * _spherical_bessel_1(half), roll


def whole_degree(heading: float) -> int:
    """Return the whole degree in 0 to 359 that is next to `heading` [rad], the upper one half way."""
    return math.floor(math.degrees(heading) + 0.5) % 360


class IttcSea:
    """A long-crested sea that stands in the water and travels in time, so that the encounter comes by itself.

    The hull is taken along by the water it lies in: the athwartships slope, integrated over length, beam and
    draught (box hull, depth decay at half the draught), gives yaw acceleration and effective roll slope:

        r' = (6/L) g a k sin(beta) j1(u) cos(theta),   u = (k L/2) cos(beta),   j1(u) = (sin u - u cos u)/u^2

    with theta the wave's phase amidships; summed over the components.
    """

    def __init__(
        self, section: IttcSection, hull: Hull, generator: np.random.Generator, current: CurrentSection = STILL_WATER
    ) -> None:
        self._waves = ittc_waves(section, hull, generator, current)
        self._known_degree: int | None = None
        self._yaw_amplitude = np.zeros(section.components)
        self._roll_amplitude = np.zeros(section.components)

    def at(self, time: float, state: BoatState) -> tuple[float, float]:
        """Return yaw acceleration [rad/s^2] and effective roll slope [rad] for a boat at `state`, `time` [s]."""
        degree = whole_degree(state.heading)
        if degree != self._known_degree:
            # a wave force changes little in a degree, and this is the costly part
            self._known_degree = degree
            self._yaw_amplitude, self._roll_amplitude = wave_forces(self._waves, math.radians(degree))
        along = way_along(self._waves, time, state)
        theta = self._waves.number * along - self._waves.frequency * time + self._waves.phase
        yaw = waves.component_sum(self._yaw_amplitude, theta)
        slope = float(np.dot(self._roll_amplitude, np.sin(theta)))
        return yaw, slope


def _spherical_bessel_1(argument: waves.Array) -> waves.Array:
    """(sin u - u cos u)/u^2, by its series u/3 (1 - u^2/10) where the difference would cancel."""
    small = np.abs(argument) < 1.0e-2
    safe = np.where(small, 1.0, argument)
    exact = (np.sin(safe) - safe * np.cos(safe)) / (safe * safe)
    return np.asarray(np.where(small, argument / 3.0 * (1.0 - argument * argument / 10.0), exact))


class Wind:
    """Mean wind and gusts, as equivalent rudder and leeway."""

    def __init__(self, section: WindSection, deviates: Deviates, dt: float) -> None:
        self._section = section
        self._deviates = deviates
        self._dt = dt
        self._from = math.radians(section.from_deg)
        self._gust = wind.Gust(section.gust_m_s, section.gust_time_s)
        self._load = wind.WindLoad(math.radians(section.rudder_deg_per_m2_s2), section.leeway)
        self._value = 0.0

    def step(self, state: BoatState) -> tuple[float, float]:
        """Move one step on; return equivalent rudder [rad] and leeway speed [m/s]."""
        self._value = wind.gust_step(self._gust, self._value, self._dt, self._deviates.next())
        speed = max(self._section.speed_m_s + self._value, 0.0)
        felt = wind.apparent_wind(speed, self._from, state.heading, state.north_speed, state.east_speed)
        return wind.rudder_equivalent(self._load, felt), wind.leeway_speed(self._load, felt)


class Sea:
    """All that a scenario does to the boat; one `step` for each step of the boat."""

    def __init__(self, scenario: Scenario, hull: Hull, seed: np.random.SeedSequence, dt: float) -> None:
        wave_seed, ittc_seed, wind_seed = seed.spawn(3)
        second_order, ittc = scenario.waves.second_order, scenario.waves.ittc
        self._second_order = (
            SecondOrderSea(second_order, Deviates(np.random.default_rng(wave_seed)), dt) if second_order else None
        )
        self._ittc = IttcSea(ittc, hull, np.random.default_rng(ittc_seed), scenario.current) if ittc else None
        is_windy = scenario.wind.speed_m_s > 0.0 or scenario.wind.gust_m_s > 0.0
        self._wind = Wind(scenario.wind, Deviates(np.random.default_rng(wind_seed)), dt) if is_windy else None
        towards = math.radians(scenario.current.towards_deg)
        self._current_north = scenario.current.speed_m_s * math.cos(towards)
        self._current_east = scenario.current.speed_m_s * math.sin(towards)

    def step(self, time: float, state: BoatState) -> Disturbance:
        """Return what acts on the boat at `time` [s] since the start; to be called once a step."""
        rudder = self._second_order.step() if self._second_order else 0.0
        yaw, slope = self._ittc.at(time, state) if self._ittc else (0.0, 0.0)
        push, leeway = self._wind.step(state) if self._wind else (0.0, 0.0)
        return Disturbance(rudder + push, yaw, slope, leeway, self._current_north, self._current_east)
