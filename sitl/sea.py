"""Sea, wind and current as one boat meets them: random realisations of a scenario from a seed.

Step by step over arrays, so that numba compiles them, waves and wind follow the same equations. Only the sum of wave
components goes another way: their phases move little in a step, so that sine and cosine are turned on by it,

    cos(a + d) = cos a cos d - sin a sin d,   sin(a + d) = sin a cos d + cos a sin d,

with the series of sin d and cos d to d^11 and d^12, and taken anew every `AFRESH` steps.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from autopilot.models import weather
from autopilot.models.weather import GRAVITY, SecondOrderWaves, WaveState, WaveTransition
from sitl.boat import BoatState, Disturbance, Hull
from sitl.scenario import CurrentSection, IttcSection, Scenario, SecondOrderSection


class Deviates:
    """Standard normal deviates one by one, drawn in blocks: a scalar draw costs more than the wave step it drives."""

    BLOCK = 1024

    def __init__(self, generator: np.random.Generator) -> None:
        self._generator = generator
        self._waiting: list[float] = []

    def next(self) -> float:
        """Return the next deviate."""
        if not self._waiting:
            self._waiting = self._generator.standard_normal(self.BLOCK).tolist()
            self._waiting.reverse()
        return self._waiting.pop()

    def take(self, count: int) -> list[float]:
        """Return the next `count` deviates."""
        if len(self._waiting) < count:
            return [self.next() for _ in range(count)]
        taken = self._waiting[: -count - 1 : -1]
        del self._waiting[-count:]
        return taken


def second_order_waves(section: SecondOrderSection) -> SecondOrderWaves:
    """Return the shaping filter of a scenario's section."""
    gain_deg = 2.0 * section.damping * section.frequency_rad_s * section.sigma_deg
    return SecondOrderWaves(section.frequency_rad_s, section.damping, math.radians(gain_deg), section.noise_power)


class IttcWaves(NamedTuple):
    """Wave components, arrays (n,): frequency [rad/s] ascending, number [1/m], slope [rad] at the hull, phase [rad].

    towards [rad]: where they travel; length and beam [m] of the hull they meet; drift [m/s] of the water they run in
    along their way.
    """

    frequency: weather.Array
    number: weather.Array
    slope: weather.Array
    phase: weather.Array
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
    number = weather.wave_number(frequency)
    period = weather.mean_period_of(section.peak_period_s)
    amplitude = weather.component_amplitudes(frequency, section.significant_height_m, period)
    slope = amplitude * number * np.exp(-0.5 * number * hull.draught)
    phase = generator.uniform(0.0, 2.0 * math.pi, section.components)
    towards = math.radians(section.from_deg) + math.pi
    drift = current.speed_m_s * math.cos(math.radians(current.towards_deg) - towards)
    return IttcWaves(frequency, number, slope, phase, towards, hull.length, hull.beam, drift)


def way_along(components: IttcWaves, time: float, state: BoatState) -> float:
    """Return the way [m] of a boat along the waves, in the water that the current takes along with them."""
    along = state.north * math.cos(components.towards) + state.east * math.sin(components.towards)
    return along - components.drift * time


def wave_forces(components: IttcWaves, heading: float) -> tuple[weather.Array, weather.Array]:
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

    def __init__(self, components: IttcWaves) -> None:
        self._waves = components
        self._known_degree: int | None = None
        self._yaw_amplitude = np.zeros(components.frequency.size)
        self._roll_amplitude = np.zeros(components.frequency.size)

    def at(self, time: float, state: BoatState) -> tuple[float, float]:
        """Return yaw acceleration [rad/s^2] and effective roll slope [rad] for a boat at `state`, `time` [s]."""
        degree = whole_degree(state.heading)
        if degree != self._known_degree:
            # a wave force changes little in a degree, and this is the costly part
            self._known_degree = degree
            self._yaw_amplitude, self._roll_amplitude = wave_forces(self._waves, math.radians(degree))
        along = way_along(self._waves, time, state)
        theta = self._waves.number * along - self._waves.frequency * time + self._waves.phase
        yaw = weather.component_sum(self._yaw_amplitude, theta)
        slope = float(np.dot(self._roll_amplitude, np.sin(theta)))
        return yaw, slope


def _spherical_bessel_1(argument: weather.Array) -> weather.Array:
    """(sin u - u cos u)/u^2, by its series u/3 (1 - u^2/10) where the difference would cancel."""
    small = np.abs(argument) < 1.0e-2
    safe = np.where(small, 1.0, argument)
    exact = (np.sin(safe) - safe * np.cos(safe)) / (safe * safe)
    return np.asarray(np.where(small, argument / 3.0 * (1.0 - argument * argument / 10.0), exact))


NO_NOISE = np.zeros(0)
NO_SWELL = WaveTransition(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
NO_WAVES = IttcWaves(NO_NOISE, NO_NOISE, NO_NOISE, NO_NOISE, 0.0, 1.0, 1.0)


class Water(NamedTuple):
    """Everything about sea, wind and current that does not change; arrays without entries where there are no waves.

    swell_noise, two deviates a step, and wind_noise, one: where they are drawn before the run.
    """

    has_swell: bool
    swell: WaveTransition
    has_waves: bool
    waves: IttcWaves
    has_wind: bool
    wind_speed: float
    wind_from: float
    gust: weather.Gust
    load: weather.WindLoad
    current_north: float
    current_east: float
    swell_noise: weather.Array = NO_NOISE
    wind_noise: weather.Array = NO_NOISE


def water_of(scenario: Scenario, hull: Hull, seed: np.random.SeedSequence, dt: float) -> Water:
    """Return what a scenario has of sea, wind and current, for steps of `dt` [s]; the seed is that of the waves."""
    section, ittc, gusts = scenario.waves.second_order, scenario.waves.ittc, scenario.wind
    towards = math.radians(scenario.current.towards_deg)
    generator = np.random.default_rng(seed)
    return Water(
        has_swell=section is not None,
        swell=weather.discretise(second_order_waves(section), dt) if section else NO_SWELL,
        has_waves=ittc is not None,
        waves=ittc_waves(ittc, hull, generator, scenario.current) if ittc else NO_WAVES,
        has_wind=gusts.speed_m_s > 0.0 or gusts.gust_m_s > 0.0,
        wind_speed=gusts.speed_m_s,
        wind_from=math.radians(gusts.from_deg),
        gust=weather.Gust(gusts.gust_m_s, gusts.gust_time_s),
        load=weather.WindLoad()
        if hull.windage
        else weather.WindLoad(math.radians(gusts.rudder_deg_per_m2_s2), gusts.leeway),
        current_north=scenario.current.speed_m_s * math.cos(towards),
        current_east=scenario.current.speed_m_s * math.sin(towards),
    )


def swell_at_start(scenario: Scenario, first: float, second: float) -> WaveState:
    """Return the swell before the first step, from two deviates."""
    section = scenario.waves.second_order
    return weather.stationary_state(second_order_waves(section), first, second) if section else WaveState()


def acting(water: Water, swell: float, gust: float, yaw: float, slope: float, state: BoatState) -> Disturbance:
    """Return what acts on the boat: swell as a rudder angle [rad], gust [m/s], and what the wave components do to it,
    yaw acceleration [rad/s^2] and effective roll slope [rad]."""
    push, leeway, ahead, starboard = 0.0, 0.0, 0.0, 0.0
    if water.has_wind:
        speed = max(water.wind_speed + gust, 0.0)
        felt = weather.apparent_wind(speed, water.wind_from, state.heading, state.north_speed, state.east_speed)
        push, leeway = weather.rudder_equivalent(water.load, felt), weather.leeway_speed(water.load, felt)
        ahead, starboard = felt.ahead, felt.starboard
    return Disturbance(swell + push, yaw, slope, leeway, water.current_north, water.current_east, ahead, starboard, 0.0)


class Sea:
    """All that a scenario does to the boat; one `step` for each step of the boat."""

    def __init__(self, scenario: Scenario, hull: Hull, seed: np.random.SeedSequence, dt: float) -> None:
        swell_seed, ittc_seed, wind_seed = seed.spawn(3)
        self._water, self._dt = water_of(scenario, hull, ittc_seed, dt), dt
        self._components = IttcSea(self._water.waves) if self._water.has_waves else None
        self._swell_noise = Deviates(np.random.default_rng(swell_seed))
        self._wind_noise = Deviates(np.random.default_rng(wind_seed))
        self._swell, self._gust = WaveState(), 0.0
        self._calm = acting(self._water, 0.0, 0.0, 0.0, 0.0, BoatState())
        if self._water.has_swell:
            self._swell = swell_at_start(scenario, self._swell_noise.next(), self._swell_noise.next())

    @property
    def air(self) -> tuple[float, float]:
        """The true wind [m/s], and where it comes from [rad]."""
        return max(self._water.wind_speed + self._gust, 0.0), self._water.wind_from

    def step(self, time: float, state: BoatState) -> Disturbance:
        """Return what acts on the boat at `time` [s] since the start; to be called once a step."""
        water, swell_noise = self._water, self._swell_noise
        if not (water.has_swell or water.has_wind or water.has_waves):
            return self._calm
        if water.has_swell:
            self._swell = weather.wave_step(water.swell, self._swell, swell_noise.next(), swell_noise.next())
        if water.has_wind:
            self._gust = weather.gust_step(water.gust, self._gust, self._dt, self._wind_noise.next())
        yaw, slope = self._components.at(time, state) if self._components else (0.0, 0.0)
        return acting(water, self._swell.value, self._gust, yaw, slope, state)


Floats = NDArray[np.float64]

AFRESH = 64
LONGEST_TURN = 0.6
"""A phase that moves further than this [rad] in one step is taken anew each step."""


class Surface(NamedTuple):
    """The waves' phases and forces by component, and the force of every degree of heading met so far."""

    cosine: Floats
    sine: Floats
    yaw: Floats
    roll: Floats
    known: NDArray[np.bool_]


class WaterState(NamedTuple):
    """Where the sea is: the swell's state, the gust [m/s], way in the water along the waves [m] at the last step, its
    degree."""

    swell: WaveState
    gust: float
    along: float
    degree: int


def surface_of(components: int) -> Surface:
    """Return room for so many wave components."""
    return Surface(
        np.zeros(components),
        np.zeros(components),
        np.zeros((360, components)),
        np.zeros((360, components)),
        np.zeros(360, dtype=np.bool_),
    )


def water_step(
    water: Water, surface: Surface, before: WaterState, step: int, dt: float, state: BoatState
) -> tuple[WaterState, Disturbance]:
    """Return the sea after step number `step`, and what it does to a boat at `state`."""
    swell, rudder = before.swell, 0.0
    if water.has_swell:
        swell = weather.wave_step(
            water.swell, swell, float(water.swell_noise[2 * step]), float(water.swell_noise[2 * step + 1])
        )
        rudder = swell.value
    yaw, slope, along, degree = 0.0, 0.0, before.along, before.degree
    if water.has_waves:
        degree = whole_degree(state.heading)
        if not surface.known[degree]:
            # not inlined, and handed many numbers: called once a degree
            _meet(water.waves, surface, degree)
        along = _phases(water.waves, surface, before.along, step, dt, state)
        yaw, slope = summed(surface.yaw[degree], surface.roll[degree], surface.cosine, surface.sine)
    gust = before.gust
    if water.has_wind:
        gust = weather.gust_step(water.gust, gust, dt, float(water.wind_noise[step]))
    return WaterState(swell, gust, along, degree), acting(water, rudder, gust, yaw, slope, state)


def _meet(components: IttcWaves, surface: Surface, degree: int) -> None:
    """Work out the forces at this heading [deg]."""
    yaw, roll = wave_forces(components, math.radians(degree))
    surface.yaw[degree, :] = yaw
    surface.roll[degree, :] = roll
    surface.known[degree] = True


def _phases(
    components: IttcWaves, surface: Surface, along_before: float, step: int, dt: float, state: BoatState
) -> float:
    """Bring cosine and sine of every component's phase to this step; return the way along the waves [m]."""
    along = way_along(components, step * dt, state)
    moved = along - along_before
    is_far = abs(moved) * components.number[-1] + dt * components.frequency[-1] > LONGEST_TURN
    if step % AFRESH == 0 or is_far:
        for k in range(len(components.number)):
            theta = components.number[k] * along - components.frequency[k] * (step * dt) + components.phase[k]
            surface.cosine[k] = math.cos(theta)
            surface.sine[k] = math.sin(theta)
    else:
        turned(components.number, components.frequency, moved, dt, surface.cosine, surface.sine)
    return along


def turned(number: Floats, frequency: Floats, moved: float, dt: float, cosine: Floats, sine: Floats) -> None:
    """Turn the phases, in place, by number x `moved` [m] - frequency x `dt` [s]."""
    for k in range(len(number)):
        d = number[k] * moved - frequency[k] * dt
        q = d * d
        s = d * (1.0 + q * (-1 / 6 + q * (1 / 120 + q * (-1 / 5040 + q * (1 / 362880 - q / 39916800)))))
        c = 1.0 + q * (-1 / 2 + q * (1 / 24 + q * (-1 / 720 + q * (1 / 40320 + q * (-1 / 3628800 + q / 479001600)))))
        before = cosine[k]
        cosine[k] = before * c - sine[k] * s
        sine[k] = sine[k] * c + before * s


def summed(yaw: Floats, roll: Floats, cosine: Floats, sine: Floats) -> tuple[float, float]:
    """Return the sums of yaw cos and roll sin over the components."""
    total_yaw = total_roll = 0.0
    for k in range(len(yaw)):
        total_yaw += yaw[k] * cosine[k]
        total_roll += roll[k] * sine[k]
    return total_yaw, total_roll
