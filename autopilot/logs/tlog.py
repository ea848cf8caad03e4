"""Telemetry logs (.tlog) of any MAVLink vehicle: heading, yaw rate, speed, position, and the steering servo's pulses.

All times are the vehicle's own: ATTITUDE and GLOBAL_POSITION_INT carry its time since boot, SERVO_OUTPUT_RAW the lower
32 bits of it in microseconds, and what carries none (VFR_HUD) is given the newest time heard. The radio's delay and
the ground station's clock do not matter but for joining the parts before and after a reboot.

A .tlog is a row of (8-byte big-endian time in microseconds since 1970, MAVLink packet); Mission Planner, MAVProxy and
QGroundControl write it alike.
"""

from __future__ import annotations

import math
from array import array
from collections import Counter, defaultdict
from collections.abc import Callable
from operator import attrgetter

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.errors import InputError
from autopilot.firmware.protocol import BYTEWISE_AUTOPILOTS, decode
from autopilot.links.mavlink.codec import MavlinkCodec, Message, message_id
from autopilot.links.mavlink.frames import MAGIC_V1, MAGIC_V2, STAMP, TlogPackets
from autopilot.logs.series import (
    HEADING,
    LATITUDE,
    LONGITUDE,
    PROPELLER,
    RATE,
    ROLL,
    SPEED,
    WIND_DIRECTION,
    WIND_SPEED,
    FloatArray,
    Gathered,
    LogFormat,
    ReadOptions,
    Recording,
    Series,
    on_one_clock,
    series_of,
    without_zeros,
)
from autopilot.logs.table import steering_series

REBOOT_S = 1.0
"""Boot time this much behind the newest is a reboot; less is a message that came out of order."""
USEC_WRAP_S = 2.0**32 * 1.0e-6
SAME_CLOCK_S = 5.0
"""A servo's time further than this off the attitude's is on another clock."""
FIX_2D = 2
DAMAGED_SHARE = 0.2
"""A file with a larger share of bytes in no packet is refused."""

APPARENT_WIND = {"AppWndSpd": (WIND_SPEED, 1.0), "AppWndDir": (WIND_DIRECTION, math.pi / 180.0)}
"""What ArduPilot sends of its wind vane (libraries/AP_WindVane/AP_WindVane.cpp, send_wind)."""

OUTPUTS = tuple(f"servo{number}_raw" for number in range(1, 17))
pulses_in = attrgetter(*OUTPUTS)
NO_PULSE = 65535
"""As 0, what an output without a pulse has."""

Handler = Callable[[Message], None]
Sender = tuple[int, int]
"""System and component."""
BOOT = 2.0**24
"""Keys of samples are boot number * BOOT + seconds since boot: half a year fits, and microseconds stay."""


class VehicleLog:
    """Gathers what one vehicle said. Series come out by `series`."""

    def __init__(self) -> None:
        self._parameters: dict[str, tuple[float, bytes, int]] = {}
        self._is_bytewise = False
        self.starts: list[float] = []
        """Stamp [s since 1970] of the vehicle's time zero, one for each boot."""
        self._samples = Gathered[tuple[str, str]]()
        self._servo_keys, self._servo_pulses = array("d"), array("H")
        self._ages = array("d")
        self._boot = -math.inf
        self._boots = 0
        self._stamp = 0.0
        self._has_fix = True
        self._handlers: dict[int, Handler] = {
            dialect.MAVLINK_MSG_ID_ATTITUDE: self._attitude,
            dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: self._position,
            dialect.MAVLINK_MSG_ID_VFR_HUD: self._hud,
            dialect.MAVLINK_MSG_ID_GPS_RAW_INT: self._gps,
            dialect.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW: self._servos,
            dialect.MAVLINK_MSG_ID_RPM: self._rpm,
            dialect.MAVLINK_MSG_ID_NAMED_VALUE_FLOAT: self._named,
            dialect.MAVLINK_MSG_ID_PARAM_VALUE: self._parameter,
            dialect.MAVLINK_MSG_ID_HEARTBEAT: self._heartbeat,
        }

    def take(self, stamp: float, message: Message) -> None:
        """Take a message of the vehicle, logged at `stamp` [s since 1970]."""
        self._stamp = stamp
        handler = self._handlers.get(message._header.msgId)
        if handler is not None:
            handler(message)

    def close(self) -> None:
        """Call after the last message."""
        self._end_boot()

    @property
    def parameters(self) -> dict[str, float]:
        """The vehicle's parameters as far as they were reported."""
        return {
            name: float(decode(value, raw, kind, self._is_bytewise))
            for name, (value, raw, kind) in self._parameters.items()
        }

    def series(self) -> list[Series]:
        """Return every series but the steering servo's, on the first boot's clock."""
        return [
            one
            for key, (keys, values) in self._samples.items()
            for one in series_of(*key, self._on_one_clock(np.asarray(keys)), values)
        ]

    def pulses(self) -> Callable[[int], tuple[FloatArray, FloatArray]] | None:
        """Return what gives times [s] since the first boot and pulses [us] of an output by its number; None where no
        output had any."""
        table, keys = np.asarray(self._servo_pulses).reshape(-1, len(OUTPUTS)), np.asarray(self._servo_keys)
        is_pulse = (table != 0) & (table != NO_PULSE)
        if not is_pulse.any():
            return None

        def of_output(number: int) -> tuple[FloatArray, FloatArray]:
            rows = np.flatnonzero(is_pulse[:, number - 1])
            return self._on_one_clock(keys[rows]), table[rows, number - 1].astype(np.float64)

        return of_output

    def _on_one_clock(self, keys: FloatArray) -> FloatArray:
        """Return times [s] since the first boot of samples whose keys are boot number * BOOT + seconds."""
        boots, seconds = np.divmod(keys, BOOT)
        starts = np.array(self.starts) - self.starts[0] if self.starts else np.zeros(1)
        return np.asarray(seconds + starts[boots.astype(int)])

    def _now(self, boot: float) -> float:
        """Return the key of a time [s] since boot that a message carries."""
        if boot < self._boot - REBOOT_S:
            self._end_boot()
        self._boot = max(self._boot, boot)
        self._ages.append(self._stamp - boot)
        return self._boots * BOOT + boot

    def _newest(self) -> float | None:
        return None if self._boot == -math.inf else self._boots * BOOT + self._boot

    def _end_boot(self) -> None:
        if self._ages:
            self.starts.append(float(np.median(self._ages)))
            self._boots += 1
        self._ages, self._boot = array("d"), -math.inf

    def _put(self, quantity: str, source: str, key: float, value: float) -> None:
        self._samples.put((quantity, source), key, value)

    def _attitude(self, message: Message) -> None:
        key = self._now(message.time_boot_ms * 1.0e-3)
        self._put(HEADING, "ATTITUDE", key, message.yaw)
        self._put(RATE, "ATTITUDE", key, message.yawspeed)
        self._put(ROLL, "ATTITUDE", key, message.roll)

    def _position(self, message: Message) -> None:
        key = self._now(message.time_boot_ms * 1.0e-3)
        if self._has_fix and (message.lat or message.lon):
            source = "GLOBAL_POSITION_INT"
            self._put(LATITUDE, source, key, math.radians(message.lat * 1.0e-7))
            self._put(LONGITUDE, source, key, math.radians(message.lon * 1.0e-7))
            self._put(SPEED, source, key, math.hypot(message.vx, message.vy) * 0.01)

    def _hud(self, message: Message) -> None:
        key = self._newest()
        if key is not None and self._has_fix:
            self._put(SPEED, "VFR_HUD", key, message.groundspeed)

    def _gps(self, message: Message) -> None:
        # before the first fix the vehicle sends zeros, which would pass for a boat at rest
        self._has_fix = message.fix_type >= FIX_2D
        key = self._newest()
        if key is not None and self._has_fix and message.vel != 65535:
            self._put(SPEED, "GPS_RAW_INT", key, message.vel * 0.01)

    def _rpm(self, message: Message) -> None:
        key = self._newest()
        if key is not None:
            self._put(PROPELLER, "RPM", key, message.rpm1 / 60.0)

    def _named(self, message: Message) -> None:
        meaning = APPARENT_WIND.get(message.name)
        if meaning is not None:
            self._put(meaning[0], message.name, self._now(message.time_boot_ms * 1.0e-3), message.value * meaning[1])

    def _servos(self, message: Message) -> None:
        key = self._newest()
        if key is None or message.port != 0:
            return
        seconds = message.time_usec * 1.0e-6
        seconds += round((self._boot - seconds) / USEC_WRAP_S) * USEC_WRAP_S
        if abs(seconds - self._boot) < SAME_CLOCK_S and seconds >= 0.0:
            key = self._boots * BOOT + seconds
        self._servo_keys.append(key)
        self._servo_pulses.extend(pulses_in(message))

    def _parameter(self, message: Message) -> None:
        packet = bytes(message.get_msgbuf())
        start = 10 if packet[0] == MAGIC_V2 else 6
        raw = packet[start : start + 4]
        self._parameters[message.param_id] = (message.param_value, raw, message.param_type)

    def _heartbeat(self, message: Message) -> None:
        self._is_bytewise = message.autopilot in BYTEWISE_AUTOPILOTS


def read_tlog(path: str, data: bytes, options: ReadOptions = ReadOptions()) -> Recording:  # noqa: B008 - immutable
    """Return the recording of one vehicle in a .tlog: that of the id in the options, or the one
    with the most attitudes. Raises InputError.
    """
    packets = TlogPackets(data)
    vehicles: defaultdict[Sender, VehicleLog] = defaultdict(VehicleLog)
    attitudes: Counter[Sender] = Counter()
    codec = MavlinkCodec()
    done = 0
    for stamp, identity, packet in packets:
        done += STAMP + len(packet)
        options.progress(done, len(data))
        if identity not in USED:
            continue
        for message in codec.decode(packet):
            sender = (message.get_srcSystem(), message.get_srcComponent())
            # not `identity`: after a damaged packet another message may end in this one
            kind = message_id(message)
            if kind not in USED:
                continue
            if kind == dialect.MAVLINK_MSG_ID_HEARTBEAT and message.autopilot == dialect.MAV_AUTOPILOT_INVALID:
                continue
            attitudes[sender] += kind == dialect.MAVLINK_MSG_ID_ATTITUDE
            vehicles[sender].take(stamp, message)
    sound = without_zeros(data)
    if packets.skipped - (len(data) - sound) > DAMAGED_SHARE * sound:
        raise InputError(
            f"{path}: {packets.skipped} of {len(data)} bytes belong to no MAVLink packet; it is no .tlog, or damaged "
            "beyond use."
        )
    chosen = _choose(path, attitudes, options.system)
    vehicle = vehicles[chosen]
    vehicle.close()
    notes = _damage(path, packets, codec.bad)
    others = sorted({number for number, _ in +attitudes} - {chosen[0]})
    if others and options.system is None:
        also = ", ".join(str(number) for number in others)
        notes.append(f"{path}: system {chosen[0]} is read; it has attitudes of {also} too: choose with --system.")
    steering, steering_note = _steering(path, vehicle, options)
    recording = Recording(
        path,
        "MAVLink telemetry log",
        (*vehicle.series(), *steering),
        vehicle.starts[0] if vehicle.starts and vehicle.starts[0] > MILLENNIUM_S else None,
        (*notes, *steering_note),
    )
    return on_one_clock(recording)


USED = frozenset(VehicleLog()._handlers)
MILLENNIUM_S = 946_684_800.0


def _choose(path: str, attitudes: Counter[Sender], system: int | None) -> Sender:
    heard = +attitudes
    if system is not None:
        theirs = Counter({sender: count for sender, count in heard.items() if sender[0] == system})
        if not theirs:
            known = ", ".join(str(number) for number in sorted({number for number, _ in heard})) or "none"
            raise InputError(f"{path}: holds no ATTITUDE of system {system}; it has them of {known}.")
        return theirs.most_common(1)[0][0]
    if not heard:
        raise InputError(
            f"{path}: holds no ATTITUDE of any vehicle, so no heading; have the vehicle send it "
            "(MAV_CMD_SET_MESSAGE_INTERVAL, message 30) while the ground station records."
        )
    return heard.most_common(1)[0][0]


def _damage(path: str, packets: TlogPackets, bad: int) -> list[str]:
    notes = []
    if packets.skipped or bad:
        notes.append(
            f"{path}: {packets.skipped} bytes and {bad} packets are damaged and left out; the rest of the log is used."
        )
    if packets.torn:
        notes.append(f"{path}: the last {packets.torn} bytes are a torn record and left out.")
    return notes


def _steering(path: str, vehicle: VehicleLog, options: ReadOptions) -> tuple[tuple[Series, ...], list[str]]:
    of_output = vehicle.pulses()
    if of_output is None:
        return (), []
    found = steering_series(path, vehicle.parameters, options, of_output, "SERVO_OUTPUT_RAW")
    if found is not None:
        return found, []
    return (), [
        f"{path}: SERVO_OUTPUT_RAW is there, but no parameter in the log says which servo steers "
        "(SERVOn_FUNCTION 26); say it with --servo NUMBER:MIN:TRIM:MAX."
    ]


def is_tlog(data: bytes) -> bool:
    """Return whether a file begins as a .tlog does: eight bytes of time, then a MAVLink packet."""
    return len(data) > 8 and data[8] in (MAGIC_V1, MAGIC_V2) and data[0] == 0


FORMAT = LogFormat(
    "a .tlog",
    is_tlog,
    lambda path, data, options: read_tlog(path, data, options),
    ".tlog",
    "no MAVLink packet at byte 8: this is not a .tlog, or it is damaged there",
    packets=True,
)
