"""A recording laid out as columns of one length, as identification and measures take it.

Rows are the moments at which heading or yaw rate was measured, whichever comes oftener: those values stay as they were
recorded. The rarer of the two goes to the row nearest each of its samples. A run to identify has rows with the rudder
alone between them where both come seldom: an order may be over before the next heading. Rudder, speed, position,
propeller and wind are taken between their samples in straight lines, and are blank where those lie apart by more than
a gap.

The rudder is as measured, or what the steering gear makes of the pulses or commands that it was given. Pulses become
shares of full rudder by the parameters in the same log:
ArduPilot: the servo whose SERVOn_FUNCTION is 26 (GroundSteering), with SERVOn_MIN, TRIM, MAX and REVERSED; what is
not in the log has the firmware's default (libraries/SRV_Channel/SRV_Channel.cpp: 1100, 1500, 1900, 0).
PX4: the output whose PWM_MAIN_FUNCn or PWM_AUX_FUNCn is 201 (Servo 1), with MINn, MAXn and a bit in REV
(src/lib/mixer_module); amidships is CENTn where newer versions have it between them, else the middle.
Boats that steer by thrust: steering and throttle of the outputs of two thrusters, as ArduRover mixes them.

A table is written as a file that others read: CSV and Parquet, positions in degrees, each column with its source.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np

from autopilot.errors import InputError
from autopilot.files.saving import why_not, write_new
from autopilot.identification.runs import MOMENTS, Orders, RudderOrigin, gap_limit
from autopilot.links.mavlink.steering import LONGEST_US, SHORTEST_US
from autopilot.logs.series import (
    ANGLES,
    HEADING,
    LATITUDE,
    LONGITUDE,
    ORDER,
    PILOT,
    PROPELLER,
    RATE,
    ROLL,
    RUDDER,
    SHARE,
    SPEED,
    THROTTLE,
    WIND_DIRECTION,
    WIND_SPEED,
    FloatArray,
    ReadOptions,
    Recording,
    Series,
    series_of,
)
from autopilot.models.drives import LEFT, RIGHT, Mixing, moment, unmixed
from autopilot.models.steering_gear import DelayLine, SteeringGear, gear_step

GROUND_STEERING = 26
FIRST_SERVO = 201
SERVOS = range(1, 17)
SHAPE = "NUMBER:MIN:TRIM:MAX, with :reversed behind it where it turns the other way, such as 1:1100:1500:1900"


class Servo(NamedTuple):
    """The steering servo: its number, and pulses [us] at full port, amidships and full starboard, unless reversed."""

    number: int
    low: float = 1100.0
    trim: float = 1500.0
    high: float = 1900.0
    reversed: bool = False

    def check(self, source: str) -> None:
        """Raise InputError where these are no end points of a servo."""
        if not SHORTEST_US <= self.low < self.trim < self.high <= LONGEST_US or self.number not in SERVOS:
            raise InputError(
                f"{source}: the steering servo {self.number} goes from {self.low:g} over {self.trim:g} to "
                f"{self.high:g} us; numbers 1 to 16 and rising pulses from {SHORTEST_US} to {LONGEST_US} us are "
                "allowed: give the right ones with --servo."
            )

    def share(self, pulses: FloatArray) -> FloatArray:
        """Return shares of full rudder, starboard positive, nan where there was no pulse."""
        away = pulses - self.trim
        share = np.clip(np.where(away > 0.0, away / (self.high - self.trim), away / (self.trim - self.low)), -1.0, 1.0)
        return np.where(pulses > 0.0, -share if self.reversed else share, np.nan)


class ServoScale(NamedTuple):
    """Pulses [us] at full rudder to one side, amidships and to the other, where they are not the servo's end points."""

    low: float
    trim: float
    high: float


def steering_servo(source: str, values: Mapping[str, float], chosen: Servo | ServoScale | None = None) -> Servo | None:
    """Return the servo that was chosen, or that of the parameters, on the scale that was chosen; None: not known.

    Raises InputError where the end points in the parameters are impossible.
    """
    if isinstance(chosen, Servo):
        return chosen
    found = servo_from_parameters(source, values)
    return found if found is None or chosen is None else found._replace(**chosen._asdict())


def servo_from_text(text: str) -> Servo:
    """Return the servo that `--servo` describes. Raises InputError."""
    number, *rest = text.split(":")
    is_reversed = bool(rest) and rest[-1] == "reversed"
    pulses = rest[:-1] if is_reversed else rest
    if len(pulses) != 3 or not all(word.isascii() and word.isdecimal() and len(word) < 6 for word in (number, *pulses)):
        raise InputError(f"--servo {text!r}: write {SHAPE}")
    low, trim, high = (float(pulse) for pulse in pulses)
    servo = Servo(int(number), low, trim, high, is_reversed)
    servo.check(f"--servo {text}")
    return servo


def servo_from_parameters(source: str, values: Mapping[str, float]) -> Servo | None:
    """Return the steering servo as a flight controller's parameters have it, None where they do not tell.

    Raises InputError where its end points are impossible.
    """
    servo = _output(values, GROUND_STEERING) or _px4(values)
    if servo is not None:
        servo.check(source)
    return servo


def _output(values: Mapping[str, float], function: int) -> Servo | None:
    """Return the output that ArduPilot's parameters give a function, None where they give it to none."""
    for number in SERVOS:
        if values.get(f"SERVO{number}_FUNCTION") == function:
            usual = Servo(number)
            ends = (values.get(f"SERVO{number}_{name}") for name in ("MIN", "TRIM", "MAX"))
            low, trim, high = (default if end is None else end for end, default in zip(ends, usual[1:4], strict=True))
            return Servo(number, low, trim, high, bool(values.get(f"SERVO{number}_REVERSED", 0.0)))
    return None


def _px4(values: Mapping[str, float]) -> Servo | None:
    for group in ("PWM_MAIN", "PWM_AUX"):
        for number in SERVOS:
            if values.get(f"{group}_FUNC{number}") == FIRST_SERVO:
                low, high = values.get(f"{group}_MIN{number}", 1000.0), values.get(f"{group}_MAX{number}", 2000.0)
                centre = values.get(f"{group}_CENT{number}", -1.0)
                trim = centre if low < centre < high else 0.5 * (low + high)
                bits = int(values.get(f"{group}_REV", 0.0))
                return Servo(number, low, trim, high, bool(bits >> (number - 1) & 1))
    return None


RudderChoice = Literal["auto", "measured", "servo", "commands"]

GEAR_STEP_S = 0.02
LONGEST_HOLD_S = 2.0
"""An order older than this, with none since, says nothing about where the rudder is."""


class RudderSettings(NamedTuple):
    """Where the rudder comes from.

    at_full [rad]: rudder at full share, negative where the servo turns the other way, None where not known. gear: the
    steering gear behind servo or commands, None to take the rudder to stand where it is commanded.
    """

    choice: RudderChoice = "auto"
    at_full: float | None = None
    gear: SteeringGear | None = None


class FoundRudder(NamedTuple):
    """The rudder [rad] of a recording, where it comes from in words, and what it is. moments: `Segment.moments` of it,
    where it is known by reports of its orders."""

    series: Series
    words: str
    origin: RudderOrigin
    moments: Series | None = None


def rudder_of(recording: Recording, settings: RudderSettings) -> FoundRudder | None:
    """Return the rudder that the settings choose; None where the recording has none.

    Raises InputError where what was chosen is not there, or a servo's angle is not known.
    """
    choices = ("measured", "commands", "servo") if settings.choice == "auto" else (settings.choice,)
    for choice in choices:
        found = _by_choice(recording, settings, choice)
        if found is not None:
            return found
    if settings.choice != "auto":
        raise InputError(f"{recording.source}: --rudder {settings.choice}: the log holds none; {_offers(recording)}.")
    return None


def _by_choice(recording: Recording, settings: RudderSettings, choice: str) -> FoundRudder | None:
    if choice == "measured":
        return _measured(recording, settings.choice == "auto")
    if choice == "commands":
        orders = recording.best(ORDER)
        return None if orders is None else _moved(orders, settings.gear, "commanded")
    shares = recording.best(SHARE)
    if shares is None:
        return None
    if settings.at_full is None:
        raise InputError(
            f"{recording.source}: the rudder is known as a share of its full angle ({shares.source}), not as an angle; "
            "give --vessel FILE, or the angle at full steering with --rudder-at-full-deg."
        )
    angles, gear = shares._replace(values=shares.values * settings.at_full), settings.gear
    found = _moved(angles if gear is None else _between_reports(angles, gear), gear, "by")
    return found._replace(moments=_unknown_moments(angles, gear))


def _measured(recording: Recording, with_estimate: bool) -> FoundRudder | None:
    sensor = recording._replace(series=tuple(s for s in recording.series if not _by_pilot(s))).best(RUDDER)
    series = recording.best(RUDDER) if with_estimate else sensor
    if series is None:
        return None
    # where there is a sensor, the pilot's estimate follows it
    origin: RudderOrigin = "estimated" if sensor is None else "measured"
    if _by_pilot(series):
        return FoundRudder(series, "the pilot's estimate (sensor or steering gear)", origin)
    return FoundRudder(series, f"measured ({series.source})", origin)


def orders_of(recording: Recording) -> Orders | None:
    """Return what was ordered of a rudder beside what its sensor showed; None where the recording lacks one of them."""
    order, sensors = recording.best(ORDER), tuple(s for s in recording.series if not _by_pilot(s))
    seen = recording._replace(series=sensors).best(RUDDER)
    return None if order is None or seen is None else Orders(order.time, order.values, seen.time, seen.values)


def _by_pilot(series: Series) -> bool:
    """Return whether the pilot's estimator made the series; merging puts the file's name before the source."""
    return series.source.rpartition(": ")[2] == PILOT


def _moved(orders: Series, gear: SteeringGear | None, word: str) -> FoundRudder:
    how = f"{word} {orders.source}" if word == "by" else f"as {word}"
    if gear is None:
        return FoundRudder(orders._replace(quantity=RUDDER), f"{how}, taken to stand where it was ordered", "ordered")
    return FoundRudder(through_gear(orders, gear), f"{how}, through the steering gear of the vessel file", "ordered")


def _between_reports(orders: Series, gear: SteeringGear) -> Series:
    """Return orders that were looked at now and then, at every GEAR_STEP_S between the reports.

    A change is seen at the first report after it, half a spacing late on average; a straight line from the report
    before is right on average. What jumps by more than the gear does in that time jumps half way: on a line the gear
    would begin with the report before, whenever the order came.
    """
    spacing = np.diff(orders.time)
    jumps = np.flatnonzero(_jumped(orders) > gear.rate_max * spacing)
    middle = orders.time[jumps] + 0.5 * spacing[jumps]
    moments = np.concatenate([orders.time, middle - JUMP_S, middle + JUMP_S])
    place = np.argsort(moments)
    known = np.concatenate([orders.values, orders.values[jumps], orders.values[jumps + 1]])[place]
    pauses = np.flatnonzero(spacing > max(LONGEST_HOLD_S, 5.0 * orders.spacing)) + 1
    stretches = np.split(orders.time, pauses)
    times = np.concatenate(
        [np.arange(part[0], max(part[-1], part[0] + GEAR_STEP_S), GEAR_STEP_S) for part in stretches]
    )
    return orders._replace(time=times, values=np.interp(times + 0.5 * GEAR_STEP_S, moments[place], known))


JUMP_S = 1.0e-6
"""Half of how long a jump lasts."""


def _jumped(orders: Series) -> FloatArray:
    """Return by how much [rad] orders may have jumped between each two reports: by what they changed, less what goes on
    as between the two reports before or behind. A pilot that orders no faster than its gear goes has no jumps."""
    spacing = np.diff(orders.time)
    speed = np.concatenate([[0.0], np.diff(orders.values) / spacing, [0.0]])
    bend = np.abs(np.diff(speed))
    return np.asarray(np.minimum(np.abs(speed[1:-1]), np.minimum(bend[:-1], bend[1:])) * spacing)


def _unknown_moments(orders: Series, gear: SteeringGear | None) -> Series:
    """Return `Segment.moments` of a rudder behind orders [rad] that were looked at now and then.

    An order that jumps by D at a moment uniform in the time h between two reports is worth D (moment - h/2) in the
    rudder's integral beside the line that is right on average: a variance of D^2 h^2/12. So is, on average, an order
    that walks from one report to the other (Brownian bridge); one that goes on evenly is known. It comes about while
    the order may jump, and while the gear goes over behind it.
    """
    spacing, change = np.diff(orders.time), _jumped(orders)
    seen = (spacing <= max(LONGEST_HOLD_S, 5.0 * orders.spacing)) & (change > 0.0)
    begin, h, jump = orders.time[:-1][seen], spacing[seen], change[seen]
    late, over = (0.0, 0.0 * jump) if gear is None else (gear.delay, jump / gear.rate_max)
    lasts = h + over
    grows = jump**2 * h**2 / 12.0 / lasts
    times = np.concatenate([begin, begin + lasts]) + late
    place = np.argsort(times, kind="stable")
    times, speed = times[place], np.cumsum(np.concatenate([grows, -grows])[place])
    total = np.concatenate([[0.0, 0.0], np.cumsum(speed[:-1] * np.diff(times))])[: times.size + 1]
    return orders._replace(quantity=MOMENTS, time=np.concatenate([orders.time[:1], times]), values=total)


def through_gear(orders: Series, gear: SteeringGear) -> Series:
    """Return where `gear` takes the rudder under `orders` [rad], each held until the next; it starts at the first.

    Behind an order that nothing follows for LONGEST_HOLD_S (or five spacings) the series has a gap.
    """
    spacing = orders.spacing if orders.time.size > 1 else LONGEST_HOLD_S
    hold = max(LONGEST_HOLD_S, 5.0 * spacing)
    line = DelayLine(gear.delay, float(orders.values[0]))
    angle, now = float(orders.values[0]), float(orders.time[0])
    times, angles = [now], [angle]
    ends = np.minimum(np.append(orders.time[1:], orders.time[-1] + spacing), orders.time + hold)
    for start, order, end in zip(orders.time, orders.values, ends, strict=True):
        now = float(start)
        line.give(now, float(order))
        steps = max(1, math.ceil((end - now) / GEAR_STEP_S - 1.0e-9))
        for step in range(1, steps + 1):
            until = now + (float(end) - now) * step / steps
            angle = gear_step(gear, angle, line.effective(until - 1.0e-9), until - times[-1])
            times.append(until)
            angles.append(angle)
    return Series(RUDDER, orders.source, *_rising(np.array(times), np.array(angles)))


def _rising(time: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    last = np.append(np.diff(time) > 0.0, True)
    return time[last], values[last]


def _offers(recording: Recording) -> str:
    kinds = {RUDDER: "measured", ORDER: "commands", SHARE: "servo"}
    there = [name for quantity, name in kinds.items() if recording.of(quantity)]
    return f"it has {' and '.join(there)}" if there else "it has no rudder of any kind"


BESIDE = (ROLL, SPEED, THROTTLE, LATITUDE, LONGITUDE, PROPELLER, WIND_SPEED, WIND_DIRECTION)
ALIKE = 1.5
"""Two series whose spacings differ by less than this factor are sampled alike: one is taken between its samples."""


class Table(NamedTuple):
    """columns: arrays of one length under SI names, nan where blank; uses: where each column comes from, in words;
    rudder: what the rudder is."""

    columns: dict[str, FloatArray]
    uses: dict[str, str]
    rudder: RudderOrigin = "measured"


def table_of(recording: Recording, settings: RudderSettings, *, between_motions: bool = False) -> Table:
    """Return the recording as a table. Raises InputError where it has neither heading nor yaw rate.

    between_motions: where these come seldom, rows with the rudder alone stand between them, and how far the moments of
    orders are known has a column.
    """
    heading, rate = recording.best(HEADING), recording.best(RATE)
    motions = [series for series in (heading, rate) if series is not None]
    if not motions:
        raise InputError(f"{recording.source}: holds no two headings or yaw rates; nothing can be made of it.")
    often = oftener = min(motions, key=lambda series: series.spacing)
    rudder = rudder_of(recording, settings)
    if between_motions and rudder is not None:
        often = _rows_between(rudder.series, often)
    rows = often.time
    columns, uses = {"time_s": rows}, {}
    for series in motions:
        columns[series.quantity] = often.values if series is oftener else _beside(series, often)
        uses[series.quantity] = series.source
    if rudder is not None:
        columns[RUDDER], uses[RUDDER] = between(rudder.series, rows), rudder.words
        if between_motions and rudder.moments is not None:
            columns[MOMENTS] = np.interp(rows, rudder.moments.time, rudder.moments.values)
    for quantity in BESIDE:
        known = recording.best(quantity)
        if known is not None:
            columns[quantity], uses[quantity] = between(known, rows), known.source
    return Table(columns, uses, "measured" if rudder is None else rudder.origin)


def _rows_between(rudder: Series, motion: Series) -> Series:
    """Return at whose moments the rows are: those of a rudder, thinned, that is known oftener than a motion which comes
    too seldom to show how the rudder moved between; else the motion's."""
    thinned = max(1, round(BETWEEN_S / rudder.spacing))
    if motion.spacing <= SELDOM_S or motion.spacing < 2.0 * thinned * rudder.spacing:
        return motion
    rows = rudder.time[::thinned]
    right = np.clip(np.searchsorted(motion.time, rows), 1, motion.time.size - 1)
    away = np.minimum(np.abs(rows - motion.time[right - 1]), np.abs(motion.time[right] - rows))
    time = np.sort(np.concatenate([motion.time, rows[away > 0.25 * thinned * rudder.spacing]]))
    values = np.full(time.size, np.nan)
    values[np.searchsorted(time, motion.time)] = motion.values
    return motion._replace(time=time, values=values)


SELDOM_S, BETWEEN_S = 0.2, 0.1
"""Between the samples of a motion that lie farther apart stand rows with the rudder alone, so far apart [s]: a steering
gear moves smoothly over 0.2 s."""


def between(series: Series, rows: FloatArray) -> FloatArray:
    """Return the series at the times `rows` [s], in straight lines between samples; nan in gaps and outside."""
    time, values = series.time, series.values
    if time.size < 2:
        return np.full(rows.size, np.nan)
    if time is rows and series.quantity not in ANGLES:
        return values
    unwrapped = np.unwrap(values) if series.quantity in ANGLES else values
    found = np.interp(rows, time, unwrapped)
    right = np.clip(np.searchsorted(time, rows), 1, time.size - 1)
    inside = (rows >= time[0]) & (rows <= time[-1]) & (time[right] - time[right - 1] <= gap_limit(time))
    inside |= (time[right] == rows) | (time[right - 1] == rows)
    found = np.where(inside, found, np.nan)
    return np.angle(np.exp(1j * found)) if series.quantity in ANGLES else found


def _beside(series: Series, often: Series) -> FloatArray:
    """Return the rarer series at the rows of the other: between samples, or only at the row nearest each sample."""
    values = between(series, often.time)
    if series.spacing < ALIKE * often.spacing:
        return values
    rows = often.time
    right = np.clip(np.searchsorted(rows, series.time), 1, rows.size - 1)
    nearest = np.where(series.time - rows[right - 1] < rows[right] - series.time, right - 1, right)
    kept = np.zeros(rows.size, dtype=bool)
    kept[nearest] = True
    return np.where(kept, values, np.nan)


MOTOR = 70
"""SERVOn_FUNCTION of the one throttle."""
Pulses = Callable[[int], tuple[FloatArray, FloatArray] | None]
"""Times [s] and pulses [us] of an output, by its number; None where the log has none."""


def thrust_series(path: str, values: Mapping[str, float], thrusters: Mixing, pulses: Pulses) -> tuple[Series, ...]:
    """Return the throttle, and of a skid-steered frame the steering, as shares of full; empty where there are none.

    thrusters: what the vessel file says of the two thrusters; how the firmware mixes stands in its parameters.
    """
    left, right = _output(values, LEFT), _output(values, RIGHT)
    if left is None or right is None:
        motor = _output(values, MOTOR)
        found = None if motor is None else pulses(motor.number)
        if motor is None or found is None:
            return ()
        return series_of(THROTTLE, f"servo {motor.number}", found[0], motor.share(found[1]))
    of_left, of_right = pulses(left.number), pulses(right.number)
    if of_left is None or of_right is None:
        return ()
    (time, port), (other, starboard) = of_left, of_right
    shares = left.share(port), np.interp(time, other, right.share(starboard)) if other.size else port * np.nan
    mixing = thrusters._replace(
        asymmetry=values.get("MOT_THST_ASYM", thrusters.asymmetry),
        expo=values.get("MOT_THST_EXPO", thrusters.expo),
        priority=values.get("MOT_STR_THR_MIX", thrusters.priority),
    )
    pairs = list(zip(*(each.tolist() for each in shares), strict=True))
    steering = np.array([moment(mixing, *pair) for pair in pairs])
    throttle = np.array([unmixed(mixing, *pair)[1] for pair in pairs])
    source = f"servos {left.number} and {right.number}, two thrusters"
    return (*series_of(SHARE, source, time, steering), *series_of(THROTTLE, source, time, throttle))


def steering_series(
    path: str, values: Mapping[str, float], options: ReadOptions, pulses: Pulses, source: str
) -> tuple[Series, ...] | None:
    """Return steering and throttle by the outputs of `source`; None where nothing says which output steers, or it has
    no pulses. Raises InputError."""
    thrust = thrust_series(path, values, options.thrusters, pulses)
    known = steering_servo(path, values, options.servo)
    if known is None:
        return thrust if any(series.quantity == SHARE for series in thrust) else None
    found = pulses(known.number)
    if found is None:
        return None
    return (*series_of(SHARE, f"{source} servo {known.number}", found[0], known.share(found[1])), *thrust)


EXTRA = "pip install '.[export]'"


def shown_columns(table: Table) -> dict[str, FloatArray]:
    """Return the columns under the names and in the units in which they are written: SI, positions in degrees."""
    shown = {}
    for name, values in table.columns.items():
        other = name.replace("tude_rad", "tude_deg")
        shown[other] = values if other == name else values * (180.0 / math.pi)
    return shown


def write_csv(path: Path, table: Table, source: str) -> int:
    """Write a table with where its columns come from as comments; return the rows. Raises InputError."""
    shown = shown_columns(table)
    head = [f"# from {source}", *(f"# {name}: {table.uses[name]}" for name in table.columns if name in table.uses)]
    head.append(",".join(shown))

    def write(new: Path) -> None:
        with new.open("w", encoding="utf-8") as file:
            file.writelines(f"{line}\n" for line in head)
            for row in zip(*(map(float, column) for column in shown.values()), strict=True):
                file.write(",".join("" if value != value else f"{value:.10g}" for value in row) + "\n")

    save(path, write)
    return next(iter(shown.values())).size


def write_parquet(path: Path, table: Table, source: str, began: float | None) -> int:
    """Write a table as Parquet: blanks are null, each column's source is in its metadata; return the rows.

    began: Unix time [s] of the clock's zero, kept in the file's metadata. Raises InputError, also without the extra.
    """
    try:
        import pyarrow as arrow
        import pyarrow.parquet as parquet
    except ModuleNotFoundError:
        raise InputError(f"{path}: writing Parquet needs pyarrow; install it with {EXTRA}.") from None
    shown = shown_columns(table)
    fields, columns = [], []
    for (name, values), original in zip(shown.items(), table.columns, strict=True):
        uses = table.uses.get(original)
        fields.append(arrow.field(name, arrow.float64(), metadata={"source": uses} if uses else None))
        columns.append(arrow.array(values, mask=np.isnan(values)))
    metadata = {"source": source, **({} if began is None else {"began_unix_s": repr(began)})}
    whole: Any = arrow.Table.from_arrays(columns, schema=arrow.schema(fields, metadata=metadata))
    save(path, lambda new: parquet.write_table(whole, new, compression="zstd"))
    return int(whole.num_rows)


def save(path: Path, write: Callable[[Path], object]) -> None:
    """Let `write` fill a file, which has the name `path` once it is whole. Raises InputError where that fails."""
    try:
        write_new(path, write)
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {why_not(error)}; give another place.") from error
