"""A recording on the nodes of a grid that suits the boat: what is compared with at nodes, what drives between them.

What besides its rudder turns a boat, in the likelihood of a recording: the propeller's race and wind
(`models.weather`).

    r' = a delta - b r - d r^3 - e + c1 Ua^2 sin g + c2 Ua^2 sin 2g + gusts + noise

a, b, d and e are scaled with the flow past the rudder, W/W0, in place of U/U0. Beforehand wind is about as strong as
the rudder, and the race doubles the rudder's force, within a factor of some: what the runs show is nearly theirs alone,
and what they do not show keeps its doubt, in K and T too.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.fft import dct, idct
from scipy.linalg.blas import dtbsv

from autopilot.identification.residuals import instrument_noise
from autopilot.identification.rudder_path import DIRECT, RudderTrain, means_behind, noise_over, with_corners
from autopilot.identification.runs import FloatArray, Segment, running
from autopilot.models.drives import BEYOND, RUDDER_LAW, DriveLaw
from autopilot.models.norrbin import SPEED_FLOOR_RATIO
from autopilot.models.weather import RaceAndWind, inflow_ratio, wind_acceleration

SUBSTEP, MOST_SUBSTEPS = 0.3, 128
"""Steps of the integration, as a share of the time constant at most; and how many there are from node to node."""
NODE_SHARE, LONGEST_NODE_S, MOST_NODES = 0.1, 1.0, 3000
"""Samples are averaged over this share of the time constant, at most so long, unless there are more than so many."""
PIN = 1.0e8
"""A heading that is nowhere measured is held by so much, at what it is."""
RACE_DOUBT = 1.5
"""The race cannot be below 0 and is searched for by its logarithm: the deviation of that, before a record is known."""
USUAL_RACE = 0.5
"""Of the speed's square: what a race usually adds to the flow past the rudder at the mean revolutions."""

IntArray = NDArray[np.intp]


class Form(NamedTuple):
    """How the terms of the turning go. law: with speed, at one throttle. power: of the rate with which the damping d
    goes that is not linear, 3 as Norrbin has it, or 2, r|r|, as the drag of a flow across a hull or past a keel has it.
    """

    law: DriveLaw = RUDDER_LAW
    power: int = 3


NORRBIN = Form()
"""A rudder in the flow, and n3."""


class Scales(NamedTuple):
    """How many times what it is at the reference speed each term of the turning is: what steers (and its zero), the
    linear damping and that of the higher power."""

    steering: FloatArray
    linear: FloatArray
    higher: FloatArray


def scales_of(form: Form, ratio: FloatArray) -> Scales:
    """Return the scales at speeds of `ratio` to the reference, elementwise: of a rudder those of `models.norrbin`, of
    thrust at one throttle those of `models.drives`."""
    law = form.law
    if law.is_rudder:
        # the prime system of SNAME: every term is made dimensionless with U and L
        return Scales(ratio * ratio, ratio, ratio ** (2.0 - form.power))
    seen = np.clip(ratio, law.slowest, BEYOND * law.fastest)
    linear = 1.0 + law.damping_share * (seen - 1.0)
    return Scales(seen**law.speed_exponent, linear, np.ones_like(ratio))


class Record(NamedTuple):
    """Segments, one after the other, on N nodes with M steps between them, each of S substeps.

    begin: the node at which each step begins, shape (M,). first: of each segment. step [s], shape (M,). rate [rad/s]
    and heading [rad], shape (N,), 0 where not measured, and how many samples each is the mean of. scales: at the
    speed of each substep, shape (S, M); push [rad/s^2]: what else is known to turn the boat there, likewise; power:
    `Form.power`. edges: per segment the times [s] of the substeps' ends; paths: its rudder. rough: by how much gusts
    are stronger at each node than in all, shape (N,). moments [rad^2 s]: the white noise in the rudder that the unknown
    moments of its orders are worth, shape (M,). blur [rad^2/s^3]: the white push that noise left in rudder, speed and
    wind makes, in all or in each step. smoothed [rad/s]: what a smoothed rate is off the model's besides
    (`smoothing_of`). usual_step [s]: the median one.
    """

    begin: IntArray
    first: IntArray
    step: FloatArray
    rate: FloatArray
    heading: FloatArray
    rate_count: FloatArray
    heading_count: FloatArray
    scales: Scales
    push: FloatArray
    power: int
    edges: tuple[FloatArray, ...]
    paths: tuple[tuple[FloatArray, FloatArray], ...]
    rough: FloatArray
    moments: FloatArray
    blur: FloatArray | float = 0.0
    smoothed: float = 0.0
    usual_step: float = math.nan

    def segment_of(self, nodes: IntArray) -> IntArray:
        """Return in which segment nodes lie."""
        return np.asarray(np.searchsorted(self.first, nodes, side="right") - 1)

    @property
    def nodes(self) -> int:
        """N."""
        return int(self.rate.size)

    @property
    def substeps(self) -> int:
        """S."""
        return int(self.scales.steering.shape[0])

    @property
    def pins(self) -> FloatArray:
        """What holds the first heading of each segment in which none is measured, shape (S,)."""
        headed = np.add.reduceat(self.heading_count, self.first)
        return np.where(headed > 0.0, 0.0, PIN)

    @property
    def rates_known(self) -> int:
        """At how many nodes a rate was measured."""
        return int(np.count_nonzero(self.rate_count))

    @property
    def headings_known(self) -> int:
        """At how many nodes a heading was measured."""
        return int(np.count_nonzero(self.heading_count))


def record_of(
    segments: Sequence[Segment], reference_speed: float, time_constant: float, form: Form = NORRBIN
) -> Record:
    """Return the segments on nodes fit for a boat of about that time constant [s]."""
    motions = [_motion(segment) for segment in segments]
    total = sum(motion.time.size for motion in motions)
    parts, begins, firsts, at = [], [], [], 0
    for motion in motions:
        spacing = float(np.median(np.diff(motion.time)))
        wanted = min(NODE_SHARE * time_constant, LONGEST_NODE_S)
        averaged = max(1, int(wanted / spacing))
        apart = max(averaged, -(-total // MOST_NODES) if total > MOST_NODES * averaged else 1)
        while motion.time.size < 8 * apart and apart > 1:
            apart -= 1
        part = _averaged(motion, apart, min(averaged, apart))
        parts.append(part)
        count = part[0].size
        firsts.append(at)
        begins.append(at + np.arange(count - 1))
        at += count
    step = np.concatenate([np.diff(part[0]) for part in parts])
    substeps = int(np.clip(math.ceil(float(np.median(step)) / (SUBSTEP * time_constant)), 1, MOST_SUBSTEPS))
    edges, ratios, paths = [], [], []
    for segment, part in zip(segments, parts, strict=True):
        times = part[0]
        share = np.arange(substeps + 1) / substeps
        grid = times[:-1, None] + np.diff(times)[:, None] * share
        edges.append(np.append(grid[:, :-1].ravel(), times[-1]))
        middle = 0.5 * (grid[:, :-1] + grid[:, 1:])
        speed = np.interp(middle, segment.time, without_noise(np.abs(segment.speed)))
        ratios.append(np.maximum(speed / reference_speed, SPEED_FLOOR_RATIO).T)
        paths.append(with_corners(segment.time, rudder_without_noise(segment.time, segment.rudder)))
    ratio = np.concatenate(ratios, axis=1)
    joined = [np.concatenate([part[i] for part in parts]) for i in range(1, 5)]
    return Record(
        np.concatenate(begins),
        np.array(firsts),
        step,
        np.nan_to_num(joined[0]),
        np.nan_to_num(joined[1]),
        joined[2],
        joined[3],
        scales_of(form, ratio),
        np.zeros_like(ratio),
        form.power,
        tuple(edges),
        tuple(paths),
        np.ones(at),
        _moments(segments, edges, substeps, step) * (ratio * ratio).mean(axis=0) ** 2,
        smoothed=smoothing_of(segments),
        usual_step=float(np.median(step)),
    )


def _moments(segments: Sequence[Segment], edges: Sequence[FloatArray], substeps: int, step: FloatArray) -> FloatArray:
    """Return `Record.moments`, the flow past the rudder left out."""
    grown = [
        np.diff(np.interp(edge[::substeps], segment.time, segment.moments))
        if segment.moments.size
        else np.zeros((edge.size - 1) // substeps)
        for segment, edge in zip(segments, edges, strict=True)
    ]
    return np.asarray(np.concatenate(grown) / step)


def smoothing_of(segments: Sequence[Segment]) -> float:
    """Return by how much [rad/s] a rate that was smoothed, or differentiated from smoothed headings, is off what the
    model would turn at in any sample; 0 of a gyro's own.

    A rate that shows less white noise than any gyro has does not tell each sample anew. Taken for exact, it shows with
    which fraction of a second the hull's answer differs from the model's, and those would make known what the rudder
    does: nothing, beside waves that explain each turn.
    """
    noises = [size for size in (instrument_noise(segment.rate) for segment in segments) if math.isfinite(size)]
    if not noises or math.sqrt(float(np.mean(np.square(noises)))) >= LEAST_NOISE:
        return 0.0
    rates = np.abs(np.concatenate([segment.rate[np.isfinite(segment.rate)] for segment in segments]))
    return SMOOTHED * float(np.quantile(rates, 0.98))


def white_noise(values: FloatArray) -> float:
    """Return the white noise of evenly sampled `values`, in their unit: what second differences have in common, for a
    gear that moves at its rate, or stands, has none; 0 of too few to tell."""
    if values.size < SHORTEST_CLEANED:
        return 0.0
    return noise_over(values, 1)


def level_of(values: FloatArray, share: float) -> FloatArray:
    """Return a level that begins with the first of `values`, of shape (N) or (N, M), and goes a `share` of the way to
    each later one."""
    bands = np.full((2, len(values)), share - 1.0, order="F")
    driven = share * values
    driven[0] = values[0]
    # solve_banded does the same, and takes more than twice as long over some hundred rows
    columns = [dtbsv(1, bands, column, lower=1, diag=1) for column in np.atleast_2d(driven.T)]
    return np.asarray(columns[0] if values.ndim == 1 else np.stack(columns, axis=1))


def without_noise(values: FloatArray) -> FloatArray:
    """Return evenly sampled `values` less their white noise: their best linear estimate (Wiener's), by frequencies.

    Each coefficient of the cosine transform is kept as far as its neighbourhood stands out of the noise. What drives
    a boat must be known so: white noise left in it draws the boat's answer towards 0, while what the best estimate
    misses does not go with the estimate, and is one more push among others (regression calibration, Carroll et al.
    2006). A record without noise stays as it is.
    """
    coefficients, kept = _kept(values)
    return np.asarray(idct(kept * coefficients, norm="ortho")) if kept.size else values


def noise_left(values: FloatArray) -> float:
    """Return the white noise that `without_noise` leaves where the signal is, in the unit of `values`: at frequencies
    that stand out of the noise it is as large as it was."""
    coefficients, kept = _kept(values)
    power = coefficients[1:] ** 2
    return white_noise(values) * math.sqrt(float(kept[1:] @ power / power.sum())) if kept.size else 0.0


def speed_changes(segments: Sequence[Segment]) -> bool:
    """Return whether the speed changes by more than the noise that `without_noise` leaves in it: the log's noise at a
    constant speed tells of no power of it."""
    known = [np.abs(segment.speed) for segment in segments]
    left = sum(white_noise(values) ** 2 * float(np.square(_kept(values)[1][1:]).sum()) for values in known)
    cleaned = np.concatenate([without_noise(values) for values in known])
    return float(np.var(cleaned)) * cleaned.size > OUT_OF_NOISE * left


OUT_OF_NOISE = 10.0
"""Times the variance of the noise left: at a constant speed what seems to change is one to two times that, and what a
tenth of the change is noise of draws a power by a tenth."""


def _kept(values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the coefficients of the cosine transform and the share of each that is no noise; empty where there is
    none."""
    noise = white_noise(values)
    if noise <= NO_NOISE * float(np.ptp(values)):
        return np.empty(0), np.empty(0)
    coefficients = np.asarray(dct(values, norm="ortho"))
    total = np.concatenate([[0.0], np.cumsum(coefficients**2)])
    index = np.arange(values.size)
    reach = np.maximum(NEIGHBOURS, (NEIGHBOURHOOD * index).astype(np.intp))
    low, high = np.maximum(index - reach, 0), np.minimum(index + reach + 1, values.size)
    power = (total[high] - total[low]) / (high - low)
    kept = np.maximum(1.0 - noise * noise / np.maximum(power, noise * noise), 0.0)
    # the mean is no noise
    kept[0] = 1.0
    return coefficients, kept


def rudder_without_noise(time: FloatArray, rudder: FloatArray) -> FloatArray:
    """Return a recorded `rudder` [rad] less its white noise, where it can be distinguished from its motion.

    A hand or a pilot that answers a noisy compass moves the rudder from sample to sample as noise would. Sampled
    quickly that motion is smooth; seldom, or larger than any sensor's noise, it is taken for what it looks like: a
    rudder that moves.
    """
    return without_noise(rudder) if _is_smooth(time, rudder) else rudder


def _is_smooth(time: FloatArray, rudder: FloatArray) -> bool:
    """Return whether what is rough of a recorded rudder is its noise."""
    return white_noise(rudder) <= LARGEST_RUDDER_NOISE and float(np.median(np.diff(time))) <= SMOOTH_WITHIN_S


def _unseen_between(values: FloatArray) -> float:
    """Return the noise of a mean over a sample of evenly sampled `values`, in their unit: their white noise, and what
    lies between two samples of a walk.

    Second differences of white noise are alike at every spacing, those of a walk grow with it; a walk strays from the
    straight line between two samples by a twelfth of what it goes (Brownian bridge), in the mean's variance.
    """
    near, far = white_noise(values), white_noise(values[::2])
    walk = max(3.0 * (far * far - near * near), 0.0)
    return math.sqrt(max(2.0 * near * near - far * far, 0.0) + walk / 12.0)


def blur_of(
    segments: Sequence[Segment], gain: float, reference_speed: float, form: Form, around: RaceAndWind | None
) -> float:
    """Return `Record.blur` for a boat whose rudder turns it by `gain` [1/s^2] at the reference speed [m/s], in the wind
    of `around`, where there is any; none where thrust steers.

    What noise leaves in what drives the boat no fit can part from a push, and there it stands as one of a size that is
    known (errors in variables, Carroll et al. 2006).
    """
    total, lasts = 0.0, 0.0
    wind = (0.0, 0.0) if around is None else (around.wind_beam, around.wind_quarter)
    for segment in segments if form.law.is_rudder else ():
        spacing, speed = float(np.median(np.diff(segment.time))), np.abs(segment.speed)
        usual = max(float(np.mean(speed)), SPEED_FLOOR_RATIO * reference_speed)
        rudder = noise_left(segment.rudder) if _is_smooth(segment.time, segment.rudder) else 0.0
        # the rudder's force goes with the square of the speed
        by_speed = 2.0 * noise_left(speed) / usual * float(np.std(segment.rudder))
        pushes = [gain * (usual / reference_speed) ** 2 * math.hypot(rudder, by_speed)]
        for each, blown in zip(wind, (segment.beam_wind, segment.quarter_wind), strict=True):
            pushes.append(each * _unseen_between(blown))
        total += segment.time.size * spacing**2 * float(np.square(pushes).sum())
        lasts += segment.time.size * spacing
    return total / lasts if lasts > 0.0 else 0.0


def blurred(record: Record, blur: float, gain: float) -> Record:
    """Return the record with its `blur`, and what its orders' moments are worth for a boat of such a `gain` [1/s^2]."""
    return record._replace(blur=blur + gain**2 * record.moments)


LARGEST_RUDDER_NOISE = np.radians(0.5)
"""No rudder sensor that works is noisier [rad]."""
SMOOTH_WITHIN_S = 0.2
"""A steering gear's motion is smooth over two samples of this spacing [s]: lag and rate see to that."""
SHORTEST_CLEANED, NO_NOISE = 32, 1.0e-4
"""Fewer samples, or with noise of less than this share of their range, are left alone; median of a normal
distribution's absolute deviations."""
NEIGHBOURS, NEIGHBOURHOOD = 4, 0.05
"""To either side of a frequency so many others, or this share of it, tell what the signal has there."""


class _Motion(NamedTuple):
    """Of a segment: times [s], rate [rad/s] and heading [rad] there, nan where not measured."""

    time: FloatArray
    rate: FloatArray
    heading: FloatArray


def _motion(segment: Segment) -> _Motion:
    """Return the motion in the rows of a segment; where most of these hold rudder and speed alone, at the moments that
    are measured, and as far apart as these where some are missing."""
    known = np.flatnonzero(np.isfinite(segment.rate) | np.isfinite(segment.heading))
    apart = np.diff(segment.time[known])
    spacing = float(np.median(apart))
    if spacing < SELDOM * float(np.median(np.diff(segment.time))):
        return _Motion(segment.time, segment.rate, segment.heading)
    counts = np.maximum(np.rint(apart / spacing), 1.0).astype(np.intp)
    at = np.concatenate([[0], np.cumsum(counts)])
    time = np.interp(np.arange(float(at[-1] + 1)), at, segment.time[known])
    rate, heading = np.full((2, time.size), np.nan)
    rate[at], heading[at] = segment.rate[known], segment.heading[known]
    return _Motion(time, rate, heading)


SELDOM = 1.5
"""A motion whose samples lie so many rows apart is no sample for each row that lost some."""


def _averaged(segment: _Motion, apart: int, together: int) -> tuple[FloatArray, ...]:
    """Return times, rates, headings and how many samples each is the mean of: of so many `together` in the middle of
    blocks of samples so many `apart`.

    A mean over n samples lies off what is in its middle by (n^2 - 1)/24 of the second difference, which the means
    beside it show: a boat that is seen to turn less sharply than it does has a weaker rudder.
    """
    count = segment.time.size // apart
    middle = slice((apart - together) // 2, (apart - together) // 2 + together)

    def of_blocks(values: FloatArray) -> FloatArray:
        return np.asarray(values[: count * apart].reshape(count, apart)[:, middle])

    time, flattened = of_blocks(segment.time).mean(axis=1), (together**2 - 1) / (24.0 * apart**2)
    means, counts = [], []
    for values in (segment.rate, segment.heading):
        block = of_blocks(values)
        # where some are missing the rest is off the middle: such a mean is left out
        whole = np.asarray(np.isfinite(block).all(axis=1))
        mean = np.where(whole, block.mean(axis=1), np.nan)
        if together > 1 and whole.any():
            known = np.isfinite(values)
            smooth = without_noise(np.interp(segment.time, segment.time[known], values[known]))
            # beside a gap nobody measured how it bends
            between = whole[:-2] & whole[2:]
            mean[1:-1] -= np.where(between, flattened * np.diff(of_blocks(smooth).mean(axis=1), 2), 0.0)
        means.append(mean)
        counts.append(np.where(whole, float(together), 0.0))
    return time, means[0], means[1], counts[0], counts[1]


def rudder_on(record: Record, train: RudderTrain = DIRECT) -> tuple[FloatArray, FloatArray]:
    """Return mean and rise [rad] of the rudder over each substep, shape (S, M) each, behind `train`."""
    mean, rise, _ = moved_on(record, train)
    return mean, rise


def moved_on(record: Record, train: RudderTrain) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return what `rudder_on` does, and by how much the rudder's speed [rad/s] rises over each substep."""
    parts = [means_behind(train, *path, edges) for edges, path in zip(record.edges, record.paths, strict=True)]
    mean, rise, bend = (_by_substep(each, record.substeps) for each in zip(*parts, strict=True))
    return mean, rise, bend


def _by_substep(parts: Sequence[FloatArray], substeps: int) -> FloatArray:
    return np.ascontiguousarray(np.concatenate(parts).reshape(-1, substeps).T)


def instruments(segments: Sequence[Segment]) -> tuple[float, float]:
    """Return the white noise of gyro [rad/s] and compass [rad], from the second differences of the record."""
    result = []
    for rows in ([segment.rate for segment in segments], [segment.heading for segment in segments]):
        known = [size for size in map(instrument_noise, rows) if math.isfinite(size)]
        result.append(math.hypot(float(np.sqrt(np.mean(np.square(known)))), LEAST_NOISE) if known else 1.0)
    return result[0], result[1]


LEAST_NOISE = 1.0e-4
"""No instrument is better [rad, rad/s]; what is recorded from a simulation may be, and would leave no digits."""
SMOOTHED = 0.02
"""Of the largest rate: tuned. K/T of a real ship's zigzag is the same to 0.001 of itself for 0.01 to 0.04, a fortieth
of that for 0. Halves of another one lie a third to two fifths too low for 0.01, up to a fifth for 0.02."""


def usual_race(reference_speed: float, reference_propeller: float) -> float:
    """Return the race that is usual at the reference speed [m/s] and revolutions [1/s]."""
    return USUAL_RACE * (reference_speed / max(reference_propeller, 1.0e-9)) ** 2


class Surroundings(NamedTuple):
    """names: of the fields of `start`, what is searched for, beginning there: of race and wind, or of the law of thrust
    that steers, of which `usual` is what is known beforehand, at a throttle of each segment of so many times the
    reference, `shares`."""

    names: tuple[str, ...]
    start: RaceAndWind | DriveLaw
    usual: DriveLaw = RUDDER_LAW
    shares: tuple[float, ...] = ()


class Beside(NamedTuple):
    """Surroundings on the substeps of a record. units: of each number that is searched for, as it stands in a
    covariance; before: its middle and deviation in those, before a record is known. turning: how the boat goes, and the
    push [rad/s^2] on it, shape (S, M), in such surroundings."""

    names: tuple[str, ...]
    start: RaceAndWind | DriveLaw
    units: FloatArray
    before: tuple[tuple[float, float], ...]
    turning: Callable[[RaceAndWind | DriveLaw], tuple[Scales, FloatArray]]

    def opened(self, z: Mapping[str, float]) -> RaceAndWind | DriveLaw:
        """Return what the numbers that are searched for stand for."""
        values: dict[str, Any] = {
            name: math.exp(min(max(z[name], -WIDE), WIDE)) if name == "race" else z[name] * unit
            for name, unit in zip(self.names, self.units.tolist(), strict=True)
        }
        return self.start._replace(**values)

    def closed(self) -> list[float]:
        """Return the numbers that stand for the start."""
        values = [float(getattr(self.start, name)) for name in self.names]
        return [
            math.log(value) if name == "race" else value / unit
            for name, value, unit in zip(self.names, values, self.units.tolist(), strict=True)
        ]

    def changes(self, z: Mapping[str, float], by: float) -> list[tuple[Scales, FloatArray]]:
        """Return how scales and push change with each of the numbers, by differences."""
        found = []
        for name in self.names:
            (more, push), (less, pull) = (self.turning(self.opened({**z, name: z[name] + d})) for d in (by, -by))
            scales = Scales(*((one - other) / (2.0 * by) for one, other in zip(more, less, strict=True)))
            found.append((scales, (push - pull) / (2.0 * by)))
        return found


WIDE = 40.0
"""Logarithms beyond this are held."""
LAW_DOUBT = 1.0
"""Of the powers with which thrust steers, and of the share of the damping that goes with the speed, one deviation."""


def beside_of(
    record: Record,
    segments: Sequence[Segment],
    surroundings: Surroundings,
    reference_speed: float,
    moment: float,
    form: Form,
) -> Beside:
    """Return the surroundings on the record's substeps; moment [rad/s^2]: the rudder's largest."""
    names, start, usual, shares = surroundings
    columns: list[list[FloatArray]] = [[], [], [], []]
    for segment, edges in zip(segments, record.edges, strict=True):
        speed = np.maximum(without_noise(np.abs(segment.speed)) / reference_speed, SPEED_FLOOR_RATIO)
        ahead = np.maximum(segment.propeller, 0.0)
        for column, values in zip(columns, (speed, ahead, segment.beam_wind, segment.quarter_wind), strict=True):
            column.append(_means(edges, segment.time, values, record.substeps))
    ratio, propeller, beam, quarter = (np.concatenate(column, axis=1) for column in columns)
    if isinstance(start, DriveLaw):
        share = np.array(shares)[record.segment_of(record.begin)]

        def by_thrust(law: Any) -> tuple[Scales, FloatArray]:
            scales = scales_of(form._replace(law=law), ratio)
            return scales._replace(steering=scales.steering * share**law.throttle_exponent), record.push

        known = tuple((float(getattr(usual, name)), LAW_DOUBT) for name in names)
        return Beside(names, start, np.ones(len(names)), known, by_thrust)

    def in_flow(around: Any) -> tuple[Scales, FloatArray]:
        flow = inflow_ratio(around, reference_speed, ratio, propeller)
        return scales_of(form, flow), wind_acceleration(around, beam, quarter)

    # wind that turns the boat as the rudder does [rad/m^2]
    unit = moment / max(float(np.sqrt(np.mean(np.square([beam, quarter])))), NO_WIND)
    race = math.log(usual_race(reference_speed, start.reference_propeller)) if "race" in names else 0.0
    units = np.array([1.0 if name == "race" else unit for name in names])
    known = tuple((race, RACE_DOUBT) if name == "race" else (0.0, 1.0) for name in names)
    return Beside(names, start, units, known, in_flow)


NO_WIND = 1.0e-9
"""A wind whose speed's square [m^2/s^2] is less is none."""


def _means(edges: FloatArray, time: FloatArray, values: FloatArray, substeps: int) -> FloatArray:
    """Return the means over the substeps, shape (S, M), of what is recorded; zeros where nothing is."""
    if not values.size:
        return np.zeros((substeps, (edges.size - 1) // substeps))
    grid = np.union1d(time, edges)
    there = np.interp(grid, time, values)
    area = running(grid, there)
    return np.asarray((np.diff(area[np.searchsorted(grid, edges)]) / np.diff(edges)).reshape(-1, substeps).T)
