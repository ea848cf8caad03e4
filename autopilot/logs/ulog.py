"""PX4's .ulg logs through pyulog (extra `ulog`): heading, yaw rate, speed, position and steering of a rover or boat.

Topics, by PX4's message definitions (msg/): vehicle_attitude q (body to earth, north-east-down),
vehicle_angular_velocity xyz[2] [rad/s], vehicle_local_position vx, vy [m/s], vehicle_gps_position or sensor_gps,
actuator_servos control[0] and, before version 1.14, actuator_controls_0 control[2], -1 to 1, or actuator_outputs pulses
[us] through the PWM_ parameters. Times are microseconds since boot; the receiver's UTC gives the date.
"""

from __future__ import annotations

import contextlib
import io
import math
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from autopilot.errors import InputError
from autopilot.logs.series import (
    HEADING,
    LATITUDE,
    LONGITUDE,
    RATE,
    SHARE,
    SPEED,
    CountedBytes,
    FloatArray,
    LogFormat,
    Progress,
    Recording,
    Series,
    on_one_clock,
    series_of,
    silent,
)
from autopilot.logs.table import Servo, ServoScale, steering_servo

Topic = Mapping[str, FloatArray]
MICRO = 1.0e-6
FIX_2D = 2
MESSAGE_HEAD = 3
"""Bytes of a message's length and kind, which stand before it."""
MOST_ENDS = 100
"""How often a reader may come to the end of a file."""
SERVO_TOPICS = (("actuator_servos", "control[0]"), ("actuator_controls_0", "control[2]"))
GPS_TOPICS = ("vehicle_gps_position", "sensor_gps")
TOPICS = (
    "vehicle_attitude",
    "vehicle_angular_velocity",
    "vehicle_local_position",
    "vehicle_global_position",
    *GPS_TOPICS,
    *(topic for topic, _ in SERVO_TOPICS),
    "actuator_outputs",
)


class _StuckError(Exception):
    """pyulog reads the file's end over and over."""


class _Bounded(CountedBytes):
    """The file as pyulog reads it. pyulog 1.3 goes back and forth for ever at the end of some damaged files."""

    _ends = 0
    is_torn = False
    """Of the last message that was asked for a part is missing."""

    def read(self, size: int | None = -1, /) -> bytes:
        """Return the next `size` bytes. Raises _StuckError when there were none left too often."""
        data = super().read(size)
        is_short = size is not None and len(data) < size
        # where the head of a message would be, a sound file ends
        self.is_torn = is_short and not (size == MESSAGE_HEAD and not data)
        if is_short:
            self._ends += 1
            if self._ends > MOST_ENDS:
                raise _StuckError
        return data


FIELDS_MOST = 4096
"""Fields of a message, with those inside it; the longest of PX4 has some hundred."""
ALL_FIELDS_MOST = 1_000_000
"""Of all messages that are announced together."""


def _fields_of(name: str, formats: Mapping[str, Any], known: dict[str, float]) -> float:
    """Return how many fields message `name` is flattened to; inf where it is inside itself, or is not described."""
    if name not in known:
        known[name] = math.inf
        fields = formats[name].fields if name in formats else ()
        inside = {kind: 1.0 if kind in _plain_kinds() else _fields_of(kind, formats, known) for kind, _, _ in fields}
        known[name] = 1.0 + sum(max(number, 1) * inside[kind] for kind, number, _ in fields)
    return known[name]


def _plain_kinds() -> Mapping[str, Any]:
    from pyulog import ULog

    return ULog._UNPACK_TYPES  # type: ignore[no-any-return]


def _bounded_reader() -> Any:
    """Return pyulog's reader, which refuses messages that a few bytes describe as millions of fields."""
    from pyulog import ULog

    class Announced(ULog._MessageAddLogged):
        total = 0.0

        def _parse_format(self, message_formats: Mapping[str, Any]) -> None:
            number = _fields_of(self.message_name, message_formats, {})
            Announced.total += number
            if number > FIELDS_MOST or Announced.total > ALL_FIELDS_MOST:
                raise _TooManyFieldsError
            super()._parse_format(message_formats)

    class Reader(ULog):
        _MessageAddLogged = Announced

    return Reader


class _TooManyFieldsError(Exception):
    """A message is described as more fields than any has, or as being inside itself."""


HEAD = b"ULog\x01\x12\x35"


def read_ulog(
    path: str, data: bytes, servo: Servo | ServoScale | None = None, progress: Progress = silent
) -> Recording:
    """Return the recording in a .ulg. servo: the steering servo, instead of what the parameters say.

    Raises InputError.
    """
    log, is_corrupt = _load(path, data, progress)
    topics = {topic: _first_of(log, topic) for topic in TOPICS}
    with np.errstate(all="ignore"):  # a damaged number may be anything; what is not finite is left out
        series = [found for read in (_attitude, _rates, _speeds, _positions) for found in read(topics)]
    if not any(found.quantity == HEADING for found in series):
        if topics["vehicle_attitude"]:
            raise InputError(f"{path}: holds vehicle_attitude, but not one heading in it is a number; it is damaged.")
        raise InputError(f"{path}: holds no vehicle_attitude, so no heading; let the logger write it (SDLOG_PROFILE).")
    notes = (f"{path}: is damaged or torn; what pyulog could read is used.",) if is_corrupt else ()
    initial = log.initial_parameters.items()
    parameters = {name: float(value) for name, value in initial if isinstance(value, int | float)}
    with np.errstate(all="ignore"):
        steering = tuple(_steering(path, topics, servo, parameters))
    return on_one_clock(Recording(path, "PX4 log", (*series, *steering), _began(topics), notes))


def _load(path: str, data: bytes, progress: Progress) -> tuple[Any, bool]:
    try:
        from pyulog.core import ULogException

        reader = _bounded_reader()
    except ImportError as error:
        raise InputError(f"{path}: reading PX4 logs needs pyulog; install it with pip install '.[ulog]'.") from error
    printed, file = io.StringIO(), _Bounded(data, progress)
    try:
        # pyulog prints what it thinks of a damaged file
        with contextlib.redirect_stdout(printed):
            log = reader(file, list(TOPICS))
    except ULogException as error:
        raise InputError(f"{path}: is no PX4 log that can be read: {error}.") from error
    except _TooManyFieldsError:
        raise InputError(
            f"{path}: is damaged beyond use: it describes a message of more than {FIELDS_MOST} fields, or one that is "
            "inside itself."
        ) from None
    except Exception as error:
        raise InputError(f"{path}: is damaged beyond use (pyulog: {type(error).__name__}).") from error
    return log, bool(log.file_corruption or file.is_torn or printed.getvalue().strip())


def _first_of(log: Any, topic: str) -> Topic:
    """Return the columns of the first instance of a topic; empty where there is none."""
    found = [data for data in log.data_list if data.name == topic and data.data.get("timestamp", np.empty(0)).size]
    return min(found, key=lambda data: int(data.multi_id)).data if found else {}


def _time(topic: Topic) -> FloatArray:
    """Return when the values were sampled [s since boot]."""
    stamp, sampled = topic["timestamp"], topic.get("timestamp_sample")
    use_sampled = sampled is not None and np.all(sampled > 0)
    return np.asarray(sampled if use_sampled else stamp, dtype=np.float64) * MICRO


def _has(topic: Topic, *names: str) -> bool:
    return all(name in topic for name in names)


def _attitude(topics: Mapping[str, Topic]) -> Iterator[Series]:
    topic = topics["vehicle_attitude"]
    if _has(topic, *(f"q[{i}]" for i in range(4))):
        w, x, y, z = (np.asarray(topic[f"q[{i}]"], dtype=np.float64) for i in range(4))
        yaw = np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
        yield from series_of(HEADING, "vehicle_attitude", _time(topic), yaw)
        # until version 1.10 the rates came with the attitude
        if "yawspeed" in topic:
            yield from series_of(RATE, "vehicle_attitude", _time(topic), topic["yawspeed"])


def _rates(topics: Mapping[str, Topic]) -> Iterator[Series]:
    topic = topics["vehicle_angular_velocity"]
    if "xyz[2]" in topic:
        yield from series_of(RATE, "vehicle_angular_velocity", _time(topic), topic["xyz[2]"])


def _speeds(topics: Mapping[str, Topic]) -> Iterator[Series]:
    local = topics["vehicle_local_position"]
    if _has(local, "vx", "vy"):
        speed = np.hypot(local["vx"], local["vy"]).astype(np.float64)
        if "v_xy_valid" in local:
            speed = np.where(local["v_xy_valid"] > 0, speed, np.nan)
        yield from series_of(SPEED, "vehicle_local_position", _time(local), speed)
    for name in GPS_TOPICS:
        gps = topics[name]
        if _has(gps, "vel_m_s", "fix_type"):
            speed = np.where(gps["fix_type"] >= FIX_2D, gps["vel_m_s"], np.nan)
            yield from series_of(SPEED, name, _time(gps), speed)


def _positions(topics: Mapping[str, Topic]) -> Iterator[Series]:
    for name in ("vehicle_global_position", *GPS_TOPICS):
        topic = topics[name]
        known = topic.get("fix_type", np.full(1, FIX_2D)) >= FIX_2D if topic else np.full(1, False)
        for quantity, field, old in ((LATITUDE, "latitude_deg", "lat"), (LONGITUDE, "longitude_deg", "lon")):
            values = topic.get(field, topic.get(old))
            if values is not None:
                # receivers gave whole numbers of 1e-7 degrees until version 1.15
                degrees = values * (1.0e-7 if np.issubdtype(values.dtype, np.integer) else 1.0)
                yield from series_of(quantity, name, _time(topic), np.where(known, degrees * (math.pi / 180.0), np.nan))


def _steering(
    path: str, topics: Mapping[str, Topic], servo: Servo | ServoScale | None, parameters: Mapping[str, float]
) -> Iterator[Series]:
    if not isinstance(servo, Servo):
        for name, field in SERVO_TOPICS:
            topic = topics[name]
            if field in topic:
                yield from series_of(SHARE, name, _time(topic), np.clip(topic[field], -1.0, 1.0))
    known, outputs = steering_servo(path, parameters, servo), topics["actuator_outputs"]
    if known is not None and f"output[{known.number - 1}]" in outputs:
        pulses = np.asarray(outputs[f"output[{known.number - 1}]"], dtype=np.float64)
        yield from series_of(SHARE, f"actuator_outputs servo {known.number}", _time(outputs), known.share(pulses))


def _began(topics: Mapping[str, Topic]) -> float | None:
    """Return the Unix time of the boot by the receiver's UTC, None where it never knew it."""
    for name in GPS_TOPICS:
        topic = topics[name]
        if _has(topic, "time_utc_usec"):
            known = np.flatnonzero(topic["time_utc_usec"] > 0)
            if known.size:
                at = known[0]
                return float(topic["time_utc_usec"][at]) * MICRO - float(topic["timestamp"][at]) * MICRO
    return None


FORMAT = LogFormat(
    "a PX4 .ulg",
    lambda data: data.startswith(HEAD),
    lambda path, data, options: read_ulog(path, data, options.servo, options.progress),
    ".ulg",
    "does not begin as a PX4 log does: this is no .ulg, or it is damaged there",
)
