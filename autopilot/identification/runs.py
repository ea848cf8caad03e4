"""Recordings as the identification sees them: continuous stretches of rudder, speed and measured motion.

Nothing is invented. The rudder and the speed drive the model, so they must be known throughout a stretch: they
are taken to move linearly between neighbouring samples, and where neighbours lie too far apart the record is
cut there. Heading and yaw rate are only compared with, so a blank among them simply does not count.

What instruments write that was never so: spikes, a compass that froze, a rudder in another unit.

A bad sample becomes a blank, never another number; whoever reads the recording gets their number.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from autopilot.errors import InputError

FloatArray = NDArray[np.float64]

WINDOW = 7
"""Samples a value is compared with, itself in the middle: a spike of up to three leaves their median alone."""

LOCAL_SPREAD = 8.0
"""A spike lies this many median deviations of its neighbours off their median ..."""

USUAL_SPREAD, USUAL_SHARE = 3.0, 0.97
"""... and this many times as far as this share of all samples lie off theirs; noise and manoeuvres stay inside."""

RANGE_SHARE, LEAST_HEADING_SPIKE_RAD = 0.5, math.radians(20.0)
"""It also takes this share of the range between the 2.5 and 97.5 per cent quantiles, or for a heading this angle: real
instruments have heavy tails, and a blank for each of them would lose what was measured."""

LARGEST_RUDDER_RAD = math.pi / 2.0
FROZEN_SHORTEST_S = 10.0
FROZEN_SAMPLES = 20
FROZEN_TURN_RAD = math.radians(10.0)
"""A heading is frozen where it stays the very same number while the yaw rate adds up to this turn."""

FROZEN_RUDDER_RAD, FROZEN_UNUSUAL = math.radians(4.0), 10
"""Without a yaw rate it is frozen where it stays the same while the rudder moves this far, and that for this many times
as many samples as it ever does elsewhere: a coarse compass stands for a while on every number."""

FROZEN_SHARE = 0.3
"""Without a yaw rate: the share of the recording through which a heading that stands says too little to go on."""


def without_spikes(values: FloatArray, *, angle: bool = False) -> tuple[FloatArray, int]:
    """Return `values` with isolated outliers blanked (nan), and how many those are.

    A sample is one where it is further off the median of the seven around it than all three limits above (after Hampel
    1974). angle: the values are angles [rad], compared round the circle.
    """
    measured = np.flatnonzero(np.isfinite(values))
    if measured.size < 3 * WINDOW:
        return values, 0
    known = values if measured.size == values.size else values[measured]
    size = np.abs(_off_medians(known, angle))
    least = LEAST_HEADING_SPIKE_RAD if angle else RANGE_SHARE * float(np.ptp(np.quantile(known, (0.025, 0.975))))
    # differences below the last digits of the numbers are rounding
    least = max(least, 1.0e-9 * max(1.0, float(np.max(np.abs(known)))))
    least = max(least, USUAL_SPREAD * float(np.quantile(size, USUAL_SHARE)))
    spikes = np.flatnonzero(size > least)
    if spikes.size:
        usual = np.array([np.median(window) for window in _windows(size)[spikes]])
        spikes = spikes[size[spikes] > LOCAL_SPREAD * usual]
    if not spikes.size:
        return values, 0
    cleaned = values.copy()
    cleaned[measured[spikes]] = np.nan
    return cleaned, int(spikes.size)


TOGETHER = 1 << 16
"""Windows that are looked at together: those of all samples at once would take seven times their memory."""


def _off_medians(values: FloatArray, angle: bool) -> FloatArray:
    """Return how far each value is off the median of those around it; angle: either way round the circle."""
    off, windows = np.empty(values.size), _windows(values)
    for at in range(0, values.size, TOGETHER):
        part, around = values[at : at + TOGETHER], windows[at : at + TOGETHER]
        if angle:
            # how far the neighbours lie from each sample, the shorter way round, knows no seam at north
            turned = around - part[:, np.newaxis]
            off[at : at + TOGETHER] = np.median(np.arctan2(np.sin(turned), np.cos(turned)), axis=1)
        else:
            off[at : at + TOGETHER] = part - np.median(around, axis=1)
    return off


def _windows(values: FloatArray) -> FloatArray:
    return np.lib.stride_tricks.sliding_window_view(np.pad(values, WINDOW // 2, mode="reflect"), WINDOW)


def check_rudder(source: str, rudder: FloatArray) -> None:
    """Raise InputError where the rudder angles [rad] are so large that they must be in another unit."""
    known = rudder[np.isfinite(rudder)]
    if known.size == 0:
        return
    usual = float(np.quantile(np.abs(known), 0.95))
    if usual > LARGEST_RUDDER_RAD:
        raise InputError(
            f"{source}: the rudder lies at {usual:.4g} rad, and none goes beyond {LARGEST_RUDDER_RAD:.2f} rad "
            "(90 degrees); for a column in degrees name it rudder_deg; turn pulse widths into angles first."
        )


ASTERN = 0.5
"""A speed whose mean lies so far below nought, as a share of the mean of its size, is that of a boat going astern."""


def check_speed(source: str, speed: FloatArray) -> None:
    """Raise InputError where the speed [m/s] is that of a boat going astern for most of the recording."""
    known = speed[np.isfinite(speed)]
    if known.size and float(np.mean(known)) < -ASTERN * float(np.mean(np.abs(known))):
        raise InputError(
            f"{source}: the speed is below nought, {float(np.mean(known)):.3g} m/s in the mean; a boat that goes "
            "astern steers otherwise than one that goes ahead. If it went ahead, turn the sign of the speed; if not, "
            "sail the run ahead."
        )


def without_freezes(
    source: str, time: FloatArray, heading: FloatArray, rate: FloatArray, rudder: FloatArray
) -> tuple[FloatArray, int]:
    """Return `heading` blanked where it stands still to the last digit although the yaw rate, or where there is none
    the rudder, says that the boat turns, and how many samples those are. time [s], heading [rad], rate [rad/s], rudder
    [rad]: one length, nan where missing.

    Raises InputError, naming `source`, where there is no yaw rate and a heading stands still for so much of the
    recording that nothing could be identified from it.
    """
    cleaned, blanked = heading, 0
    standing, usual = _standing(time, heading)
    for part in standing:
        known = part[np.isfinite(rate[part])]
        if known.size:
            is_frozen = _has_turned(time[known], rate[known])
        else:
            _check_share(source, time, heading, part)
            moved = rudder[part][np.isfinite(rudder[part])]
            is_moved = moved.size > 0 and float(np.ptp(moved)) > FROZEN_RUDDER_RAD
            is_frozen = is_moved and part.size >= FROZEN_UNUSUAL * usual
        if is_frozen:
            cleaned = heading.copy() if cleaned is heading else cleaned
            cleaned[part] = np.nan
            blanked += part.size
    return cleaned, blanked


def _check_share(source: str, time: FloatArray, heading: FloatArray, part: NDArray[np.intp]) -> None:
    if time[part[-1]] - time[part[0]] > FROZEN_SHARE * (time[-1] - time[0]):
        raise InputError(
            f"{source}: the heading stands at {math.degrees(heading[part[0]]) % 360.0:.1f} degrees from "
            f"{time[part[0]]:g} s to {time[part[-1]]:g} s without changing a digit: the compass froze or the "
            "stream stopped; keep only the part before or after."
        )


def _standing(time: FloatArray, heading: FloatArray) -> tuple[list[NDArray[np.intp]], int]:
    """Return the rows of each long stretch in which the heading stays the same number, and how many samples it stays so
    elsewhere at most."""
    rows = np.flatnonzero(np.isfinite(heading))
    if not rows.size:
        return [], 0
    begins = np.append(0, np.flatnonzero(np.diff(heading[rows]) != 0.0) + 1)
    sizes = np.diff(begins, append=rows.size)
    lasting = time[rows[begins + sizes - 1]] - time[rows[begins]]
    is_long = (sizes >= FROZEN_SAMPLES) & (lasting >= FROZEN_SHORTEST_S)
    usual = int(np.max(sizes[~is_long], initial=0))
    found = zip(begins[is_long].tolist(), sizes[is_long].tolist(), strict=True)
    return [rows[begin : begin + size] for begin, size in found], usual


def _has_turned(time: FloatArray, rate: FloatArray) -> bool:
    turned = abs(float(np.trapezoid(rate, time)))
    return max(turned, float(np.ptp(running(time, rate)))) > FROZEN_TURN_RAD


def running(time: FloatArray, values: FloatArray) -> FloatArray:
    """Return the integral since the first `time` [s], at each, of what moves in straight lines."""
    return np.concatenate(([0.0], np.cumsum(0.5 * (values[1:] + values[:-1]) * np.diff(time))))


TURNS_WINDOW_S = 10.0
TURNS_LEAST_RAD = math.radians(10.0)
TURNS_ALIKE, TURNS_RATIO = 0.3, 2.5
"""Turns over windows of this time, by heading and by yaw rate: where either makes this much, root mean square, the two
must go together (correlation) and be of like size. A rate sensor's scale, its bias, a late compass are far inside."""


SMALLEST_UNIT_RAD, LARGEST_EFFECT_1_S = math.radians(1.2), 3.0
"""A rudder that never goes beyond the first and turns the boat, over the same windows, by more than so many times its
angle a second: radians that stand where degrees should (57 times too small) look so, and no rudder is so effective."""


def check_effect(source: str, time: FloatArray, heading: FloatArray, rate: FloatArray, rudder: FloatArray) -> None:
    """Raise InputError where so small a rudder [rad] turns the boat so far that its angles must be in another unit.

    time [s], heading [rad], rate [rad/s]: as of the rudder, nan where missing.
    """
    turns = _turns_of(time, rate, heading)
    known = np.abs(rudder[np.isfinite(rudder)])
    largest = float(np.quantile(known, 0.99)) if known.size else 0.0
    if turns.size < 2 or not 0.0 < largest < SMALLEST_UNIT_RAD:
        return
    size = float(np.sqrt(np.mean(turns**2)))
    if size > max(TURNS_LEAST_RAD, LARGEST_EFFECT_1_S * TURNS_WINDOW_S * largest):
        raise InputError(
            f"{source}: the rudder goes {math.degrees(largest):.2g} deg to either side, and the boat turns "
            f"{math.degrees(size):.0f} deg in {TURNS_WINDOW_S:.0f} s: no rudder does so much. For a column in "
            "radians name it rudder_rad."
        )


def _turns_of(time: FloatArray, rate: FloatArray, heading: FloatArray) -> FloatArray:
    """Return by how much [rad] the boat turns in each window, by its rate, or where that is unknown by its heading."""
    rows = np.flatnonzero(np.isfinite(rate))
    if rows.size >= FROZEN_SAMPLES:
        turned = running(time[rows], rate[rows])
    else:
        rows = np.flatnonzero(np.isfinite(heading))
        turned = np.unwrap(heading[rows])
    if rows.size < FROZEN_SAMPLES:
        return np.zeros(0)
    moments = np.arange(time[rows[0]], time[rows[-1]], TURNS_WINDOW_S)
    return np.diff(np.interp(moments, time[rows], turned))


def check_turns(source: str, time: FloatArray, heading: FloatArray, rate: FloatArray) -> None:
    """Raise InputError where heading [rad] and yaw rate [rad/s] tell of turns that cannot be the same boat's: a sign or
    a unit of one of them is another, or that of the time [s]. nan where missing."""
    both = np.isfinite(heading) & np.isfinite(rate)
    if np.count_nonzero(both) < FROZEN_SAMPLES:
        return
    moments, headings, rates = (each if both.all() else each[both] for each in (time, heading, rate))
    spacing, step = np.diff(moments), np.diff(headings)
    by_rate = 0.5 * (rates[1:] + rates[:-1]) * spacing
    by_heading = np.arctan2(np.sin(step), np.cos(step))
    known = spacing <= gap_limit(moments)
    usual = float(np.median(np.abs(by_rate)))
    if usual > 0.5 * math.pi:
        raise InputError(
            f"{source}: by its yaw rate the boat turns {math.degrees(usual):.3g} deg from one sample to the next, "
            f"{float(np.median(spacing)):.3g} s later; check the units of time and yaw rate."
        )
    window = ((moments[:-1] - moments[0]) / TURNS_WINDOW_S).astype(int)
    if not known.any():
        return
    # the windows that are not empty, numbered
    found = np.append(0, np.cumsum(np.diff(window[known]) > 0))
    turned, headed = (np.bincount(found, turns[known]) for turns in (by_rate, by_heading))
    size_of_rates, size_of_headings = (float(np.sqrt(np.mean(turns**2))) for turns in (turned, headed))
    if max(size_of_rates, size_of_headings) < TURNS_LEAST_RAD:
        return
    alike = float(np.mean(turned * headed)) / max(size_of_rates * size_of_headings, 1.0e-12)
    if alike < TURNS_ALIKE or not 1.0 / TURNS_RATIO < size_of_headings / max(size_of_rates, 1.0e-12) < TURNS_RATIO:
        how = "to the other side" if alike < -TURNS_ALIKE else f"by {math.degrees(size_of_headings):.3g} deg"
        raise InputError(
            f"{source}: heading and yaw rate contradict each other: where the yaw rate turns the boat by "
            f"{math.degrees(size_of_rates):.3g} deg in {TURNS_WINDOW_S:.0f} s, the heading turns {how}; check signs "
            "(both are positive clockwise) and units of both and of the time, or leave one of them out."
        )


GAP_SAMPLES = 5.0
"""Neighbouring samples of rudder or speed further apart than this many median spacings make a gap."""

GAP_SHORTEST_S = 0.5
"""No gap is shorter than this, however fast the recording: a rudder moves little in that time."""

AROUND = ("propeller_rps", "wind_speed_m_s", "wind_direction_rad")

MOMENTS = "moments_rad2_s2"
"""The column of `Segment.moments`."""

SHORTEST_SEGMENT_SAMPLES = 8
"""Shorter stretches between gaps tell less than their own initial state costs."""


SHORTEST_SHARE = 0.2
"""A time constant below this share of the time between two samples is not distinguished from none: it is held there, or
it would be taken for ever shorter, and simulated on ever smaller steps."""

NOTHING: FloatArray = np.empty(0)


class Segment(NamedTuple):
    """A stretch without gaps; arrays of one length N.

    time [s] strictly increasing; heading [rad] unwrapped, nan where not measured; rate [rad/s], nan where not
    measured; rudder [rad] and speed [m/s], finite throughout. propeller [1/s], and of the apparent wind Ua from
    direction g off the bow beam_wind Ua^2 sin g and quarter_wind Ua^2 sin 2g [m^2/s^2]: finite throughout, empty
    where the recording has none. moments [rad^2 s^2]: of a rudder known by reports of its orders, the variance of its
    integral over time, since any moment before, for nobody knows when between two reports an order came; empty where
    the rudder is known throughout.
    """

    time: FloatArray
    heading: FloatArray
    rate: FloatArray
    rudder: FloatArray
    speed: FloatArray
    propeller: FloatArray = NOTHING
    beam_wind: FloatArray = NOTHING
    quarter_wind: FloatArray = NOTHING
    moments: FloatArray = NOTHING


RudderOrigin = Literal["measured", "estimated", "ordered"]
"""A sensor's angle; a pilot's estimate, which may be its model of the gear; or what was ordered."""


class Orders(NamedTuple):
    """Rudder angles [rad] as ordered, and as a sensor showed them, each at times [s] of its own on one clock."""

    order_time: FloatArray
    order: FloatArray
    time: FloatArray
    angle: FloatArray


class Run(NamedTuple):
    """One recording: where it came from, its segments in order of time, and a sentence for each kind of bad sample
    that was left out; what its rudder is, and the text of the vessel file of the pilot that recorded it, if one did.
    late: how long after a heading that pilot's order came to the rudder [s], nan where none shows or nobody asked.
    throttle: its mean, share of full, where that was recorded. orders: beside a sensor on the rudder, where both were.
    compass_late [s]: by how much the compass was later than the gyro; the headings are at the gyro's time.
    """

    source: str
    segments: tuple[Segment, ...]
    notes: tuple[str, ...] = ()
    rudder: RudderOrigin = "measured"
    vessel: str = ""
    late: float = math.nan
    throttle: float = math.nan
    orders: Orders | None = None
    compass_late: float = 0.0


def has_propeller(runs: Sequence[Run]) -> bool:
    """Return whether every segment of `runs` knows the propeller's revolutions."""
    return all(segment.propeller.size for run in runs for segment in run.segments)


def has_wind(runs: Sequence[Run]) -> bool:
    """Return whether every segment of `runs` knows the wind."""
    return all(segment.beam_wind.size for run in runs for segment in run.segments)


def seconds(run: Run) -> float:
    """Return the recorded time [s] inside the run's segments."""
    return float(sum(segment.time[-1] - segment.time[0] for segment in run.segments))


def mean_speed(runs: Sequence[Run]) -> float:
    """Return the mean speed [m/s] over the runs' recorded time: the reference at which parameters are stated."""
    way = [float(np.trapezoid(np.abs(s.speed), s.time)) for run in runs for s in run.segments]
    time = [float(s.time[-1] - s.time[0]) for run in runs for s in run.segments]
    return sum(way) / sum(time)


def spacing_of(segments: Sequence[Segment]) -> float:
    """Return how far apart [s] samples are on average."""
    steps = sum(segment.time.size - 1 for segment in segments)
    return float(sum(segment.time[-1] - segment.time[0] for segment in segments)) / steps


def shortest_time_constant(segments: Sequence[Segment]) -> float:
    """Return the shortest time constant [s] that samples so far apart can tell."""
    return SHORTEST_SHARE * spacing_of(segments)


def run_from_columns(source: str, columns: Mapping[str, FloatArray]) -> Run:
    """Return the Run in `columns`: arrays of one length under the keys `time_s`, `rudder_rad`, `speed_m_s`,
    and `heading_rad` or `yaw_rate_rad_s` or both; nan where a value is missing. `propeller_rps`, and
    `wind_speed_m_s` with `wind_direction_rad` (off the bow, as felt on board), are taken where they are.

    Rows without a time are dropped; spikes and a frozen heading become blanks and are reported in `notes`. Raises
    InputError, naming `source`, where a needed column is missing, time does not increase, the rudder is in another
    unit, the boat goes astern, the heading never moves, heading and yaw rate contradict each other, or no stretch is
    long enough.
    """
    _require(source, columns)
    columns, notes = _without_bad_samples(source, columns)
    known = np.isfinite(columns["time_s"])
    if not known.all():
        columns = {name: values[known] for name, values in columns.items()}
    time = columns["time_s"]
    if time.size == 0:
        raise InputError(f"{source}: no row has a time, so there is nothing to identify from.")
    backwards = np.flatnonzero(np.diff(time) <= 0.0)
    if backwards.size:
        at = int(backwards[0])
        raise InputError(
            f"{source}: time goes from {time[at]:g} s to {time[at + 1]:g} s between samples {at + 1} and {at + 2}; "
            "it must increase from sample to sample."
        )
    nothing = np.full(time.size, np.nan)
    heading = columns.get("heading_rad", nothing)
    rate = columns.get("yaw_rate_rad_s", nothing)
    check_turns(source, time, heading, rate)
    check_effect(source, time, heading, rate, columns["rudder_rad"])
    rudder, rudder_known = _bridge(time, columns["rudder_rad"])
    speed, speed_known = _bridge(time, columns["speed_m_s"])
    around = _around(time, {name: values for name, values in columns.items() if name in AROUND})
    table = Segment(time, heading, rate, rudder, speed, *around, columns.get(MOMENTS, NOTHING))
    segments = [
        _tidy(_rows(table, part))
        for stretch in _stretches(time, rudder_known & speed_known)
        for part in _parts(stretch, time, heading, rate)
    ]
    useful = tuple(segment for segment in segments if _measured(segment) >= SHORTEST_SEGMENT_SAMPLES)
    if not useful:
        empty = [name for name in ("rudder_rad", "speed_m_s") if not np.isfinite(columns[name]).any()]
        if time.size < SHORTEST_SEGMENT_SAMPLES:
            cure = f"it has {time.size} samples in all: record a zigzag of some minutes."
        elif empty:
            cure = f"no sample of {' and '.join(empty)} is a number."
        else:
            cure = "check that the columns overlap in time."
        raise InputError(
            f"{source}: no stretch of {SHORTEST_SEGMENT_SAMPLES} samples has rudder, speed and heading or yaw rate "
            f"together; {cure}"
        )
    return Run(source, useful, notes)


def _without_bad_samples(
    source: str, columns: Mapping[str, FloatArray]
) -> tuple[Mapping[str, FloatArray], tuple[str, ...]]:
    """Return the columns with blanks for what was never so, and a sentence for each kind of it."""
    cleaned, notes = dict(columns), []
    check_rudder(source, cleaned["rudder_rad"])
    check_speed(source, cleaned["speed_m_s"])
    if "heading_rad" in cleaned:
        rate = cleaned.get("yaw_rate_rad_s", np.full(cleaned["time_s"].size, np.nan))
        cleaned["heading_rad"], frozen = without_freezes(
            source, cleaned["time_s"], cleaned["heading_rad"], rate, cleaned["rudder_rad"]
        )
        if frozen:
            notes.append(f"{source}: {frozen} headings are left out: the compass stood still while the boat turned.")
    for name in ("heading_rad", "yaw_rate_rad_s", "rudder_rad", "speed_m_s"):
        if name in cleaned:
            cleaned[name], spikes = without_spikes(cleaned[name], angle=name == "heading_rad")
            if spikes:
                notes.append(f"{source}: {spikes} of {cleaned[name].size} values of {name} left out as spikes.")
    return cleaned, tuple(notes)


def _around(time: FloatArray, columns: Mapping[str, FloatArray]) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return propeller, beam wind and quarter wind without blanks: between samples, and beyond them, what was last
    and will be next is close enough for what only modifies the motion."""
    propeller = columns.get("propeller_rps", NOTHING)
    speed, direction = columns.get("wind_speed_m_s", NOTHING), columns.get("wind_direction_rad", NOTHING)
    square = speed**2 if direction.size and speed.size else NOTHING
    winds = (square * np.sin(direction), square * np.sin(2.0 * direction)) if square.size else (NOTHING, NOTHING)
    return _filled(time, propeller), _filled(time, winds[0]), _filled(time, winds[1])


def _filled(time: FloatArray, values: FloatArray) -> FloatArray:
    measured = np.isfinite(values)
    return np.interp(time, time[measured], values[measured]) if measured.any() else NOTHING


def _require(source: str, columns: Mapping[str, FloatArray]) -> None:
    for name in ("time_s", "rudder_rad", "speed_m_s"):
        if name not in columns:
            raise InputError(f"{source}: {name} is missing; time, rudder and speed are all needed.")
    if "heading_rad" not in columns and "yaw_rate_rad_s" not in columns:
        raise InputError(f"{source}: neither heading nor yaw rate is there; at least one of them is needed.")


def _bridge(time: FloatArray, values: FloatArray) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Return `values` with short blanks bridged linearly, and where they are known that way."""
    measured = np.flatnonzero(np.isfinite(values))
    if measured.size in (0, 1, values.size):
        return values, np.isfinite(values)
    moments = time[measured]
    longest = gap_limit(moments)
    after = np.searchsorted(moments, time, side="left")
    inside = (after < moments.size) & (time >= moments[0])
    right = np.minimum(after, moments.size - 1)
    left = np.maximum(right - 1, 0)
    exact = np.isfinite(values)
    known = exact | (inside & (moments[right] - moments[left] <= longest))
    return np.where(known, np.interp(time, moments, values[measured]), np.nan), known


def gap_limit(moments: FloatArray) -> float:
    """Return the longest spacing [s] of samples at `moments` [s] that still counts as continuous."""
    return max(GAP_SAMPLES * float(np.median(np.diff(moments))), GAP_SHORTEST_S)


def _stretches(time: FloatArray, known: NDArray[np.bool_]) -> list[slice]:
    """Return the slices of rows that are known throughout and nowhere further apart than a gap."""
    rows = np.flatnonzero(known)
    if rows.size < 2:
        return []
    apart = np.diff(time[rows]) > gap_limit(time[rows])
    cuts = np.flatnonzero(apart | (np.diff(rows) > 1)) + 1
    return [slice(int(part[0]), int(part[-1]) + 1) for part in np.split(rows, cuts)]


def _rows(table: Segment, part: slice) -> Segment:
    return Segment(*(array[part] if array.size else array for array in table))


def _parts(stretch: slice, time: FloatArray, heading: FloatArray, rate: FloatArray) -> list[slice]:
    """Return the stretch in parts, cut where headings are blank for so long that a boat without measured rates may
    have turned half round meanwhile: nobody could say which way."""
    time, heading, rate = time[stretch], heading[stretch], rate[stretch]
    rows = np.flatnonzero(np.isfinite(heading))
    if rows.size < SHORTEST_SEGMENT_SAMPLES or np.isfinite(rate).any():
        return [stretch]
    moments = time[rows]
    spacing = np.diff(moments)
    seconds_ = np.arange(moments[0], moments[-1], max(1.0, float(np.median(spacing))))
    turned = np.diff(np.interp(seconds_, moments, np.unwrap(heading[rows]))) / np.diff(seconds_)
    fastest = float(np.quantile(np.abs(turned), 0.95)) if turned.size else 0.0
    blanks = np.flatnonzero(spacing * fastest > math.pi)
    if not blanks.size:
        return [stretch]
    first = stretch.start
    begins = [first, *(first + rows[blanks + 1]).tolist()]
    ends = [*(first + rows[blanks] + 1).tolist(), stretch.stop]
    return [slice(begin, end) for begin, end in zip(begins, ends, strict=True)]


def _tidy(segment: Segment) -> Segment:
    """Return the segment with its heading unwrapped over the samples that have one."""
    heading = segment.heading.copy()
    measured, known = np.isfinite(heading), np.isfinite(segment.rate)
    heading[measured] = np.unwrap(heading[measured])
    if known.any():
        # over a blank the boat may have turned round, which the rate has seen
        rates = np.interp(segment.time, segment.time[known], segment.rate[known])
        steps = 0.5 * (rates[1:] + rates[:-1]) * np.diff(segment.time)
        turned = np.concatenate(([0.0], np.cumsum(steps)))[measured]
        missed = np.rint((np.diff(turned) - np.diff(heading[measured])) / (2.0 * math.pi))
        if missed.any():
            heading[measured] += 2.0 * math.pi * np.concatenate(([0.0], np.cumsum(missed)))
    return segment._replace(heading=heading, rate=np.where(known, segment.rate, np.nan))


def _measured(segment: Segment) -> int:
    return int(np.count_nonzero(np.isfinite(segment.heading) | np.isfinite(segment.rate)))
