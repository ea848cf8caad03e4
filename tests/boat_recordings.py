"""A simulated zigzag as other programs' logs would hold it; the layouts are written out here from their descriptions.

The boat is integrated on its own (no code of the identification). Nothing here is a recording of a real boat.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as dialect

TRIMS = (1120.0, 1480.0, 1910.0)
FULL = math.radians(30.0)
EPOCH = 1_780_000_000.0


class Boat(NamedTuple):
    """time [s], heading [rad] unwrapped, rate [rad/s], order and rudder [rad] (no lag: they are one), speed [m/s]."""

    time: np.ndarray
    heading: np.ndarray
    rate: np.ndarray
    order: np.ndarray
    rudder: np.ndarray
    speed: np.ndarray
    north: np.ndarray
    east: np.ndarray


def zigzag_boat(
    seconds: float = 120.0,
    K: float = 0.2,
    T: float = 5.0,
    angle: float = math.radians(15.0),
    rudder_rate: float = math.radians(5.0),
    speed: float = 3.0,
    straight: float = 5.0,
    dt: float = 0.02,
) -> Boat:
    """Return a zigzag of a Nomoto boat, Heun steps of `dt`; `order` is the command to the steering gear."""
    count = int(seconds / dt) + 1
    rows = np.zeros((count, 8))
    heading, rate, rudder, order, side, north, east = 2.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0
    for i in range(count):
        t = i * dt
        rows[i] = t, heading, rate, order, rudder, speed, north, east
        if t >= straight:
            if side * (heading - 2.0) >= angle:
                side = -side
            order = side * angle
        moved = rudder + float(np.clip(order - rudder, -rudder_rate * dt, rudder_rate * dt))
        slope = (K * rudder - rate) / T
        later = (K * moved - (rate + dt * slope)) / T
        turned = rate + 0.5 * dt * (slope + later)
        middle = heading + 0.25 * dt * (rate + turned)
        north += speed * dt * math.cos(middle)
        east += speed * dt * math.sin(middle)
        heading += 0.5 * dt * (rate + turned)
        rate, rudder = turned, moved
    return Boat(*rows.T)


def pulses(angles: np.ndarray, is_reversed: bool = False) -> np.ndarray:
    """Return servo pulses [us] for rudder angles, asymmetric about the trim."""
    low, trim, high = TRIMS
    share = np.clip(angles / FULL, -1.0, 1.0) * (-1.0 if is_reversed else 1.0)
    return np.round(trim + np.where(share > 0.0, share * (high - trim), share * (trim - low)))


def every(boat: Boat, hertz: float) -> range:
    """Return the rows of the boat at `hertz`."""
    return range(0, boat.time.size, round(1.0 / hertz / (boat.time[1] - boat.time[0])))


def ardupilot_parameters(is_reversed: bool = False) -> dict[str, float]:
    low, trim, high = TRIMS
    return {
        "SERVO1_FUNCTION": 0.0, "SERVO3_FUNCTION": 26.0, "SERVO3_MIN": low, "SERVO3_TRIM": trim, "SERVO3_MAX": high,
        "SERVO3_REVERSED": float(is_reversed), "SERVO1_MIN": 1000.0,
    }  # fmt: skip


def tlog_events(
    boat: Boat, boot: float = 12.0, attitude_hz: float = 10.0, parameters: dict[str, float] | None = None
) -> Iterator[tuple[float, Any]]:
    """Yield (seconds of the boat, message) of an ArduRover boat."""
    values = ardupilot_parameters() if parameters is None else parameters
    yield 0.0, dialect.MAVLink_heartbeat_message(dialect.MAV_TYPE_SURFACE_BOAT, 3, 129, 0, 4, 3)
    for number, (name, value) in enumerate(values.items()):
        yield 0.0, dialect.MAVLink_param_value_message(name.encode(), value, 9, len(values), number)
    servo = pulses(boat.order)
    plan: list[tuple[float, Callable[[int], Any]]] = [
        (attitude_hz, lambda i: _attitude(boat, boot, i)),
        (10.0, lambda i: _servos(boat, boot, i, servo)),
        (5.0, lambda i: _position(boat, boot, i)),
        (2.0, lambda i: dialect.MAVLink_rpm_message(1200.0, 0.0)),
        (2.0, lambda i: dialect.MAVLink_named_value_float_message(_ms(boat, boot, i), b"AppWndSpd", 6.0)),
        (2.0, lambda i: dialect.MAVLink_named_value_float_message(_ms(boat, boot, i), b"AppWndDir", -30.0)),
        (2.0, lambda i: dialect.MAVLink_vfr_hud_message(0.0, boat.speed[i], 0, 50, 0.0, 0.0)),
    ]
    events = [(float(boat.time[i]), make(i)) for hertz, make in plan for i in every(boat, hertz)]
    yield from sorted(events, key=lambda event: event[0])


def _attitude(boat: Boat, boot: float, i: int) -> Any:
    yaw = math.remainder(boat.heading[i], math.tau)
    return dialect.MAVLink_attitude_message(_ms(boat, boot, i), 0.0, 0.0, yaw, 0.0, 0.0, boat.rate[i])


def _servos(boat: Boat, boot: float, i: int, servo: np.ndarray) -> Any:
    outputs = [0, 0, int(servo[i]), 0, 0, 0, 0, 0]
    return dialect.MAVLink_servo_output_raw_message(round((boat.time[i] + boot) * 1.0e6) & 0xFFFFFFFF, 0, *outputs)


def _position(boat: Boat, boot: float, i: int) -> Any:
    latitude = math.radians(57.69) + boat.north[i] / 6_371_000.0
    longitude = math.radians(11.84) + boat.east[i] / 6_371_000.0 / math.cos(math.radians(57.69))
    north, east = boat.speed[i] * math.cos(boat.heading[i]), boat.speed[i] * math.sin(boat.heading[i])
    degrees = [round(math.degrees(angle) * 1.0e7) for angle in (latitude, longitude)]
    velocity = [round(100.0 * value) for value in (north, east)]
    return dialect.MAVLink_global_position_int_message(_ms(boat, boot, i), *degrees, 0, 0, *velocity, 0, 0)


def _ms(boat: Boat, boot: float, i: int) -> int:
    return round((boat.time[i] + boot) * 1000.0)


def tlog(
    events: Iterator[tuple[float, Any]], began: float = EPOCH, system: int = 1, jitter: float = 0.0, v1: bool = False
) -> bytes:
    """Return the bytes of a .tlog: stamped when the ground station heard it, up to `jitter` [s] late."""
    mavlink = dialect.MAVLink(None, srcSystem=system, srcComponent=1)
    random, out, heard = np.random.default_rng(1), [], 0.0
    for seconds, message in events:
        heard = max(heard, began + seconds + jitter * random.random())
        packet = message.pack(mavlink, force_mavlink1=v1)
        mavlink.seq = (mavlink.seq + 1) & 0xFF
        out.append(struct.pack(">Q", round(heard * 1.0e6)) + packet)
    return b"".join(out)


FORMATS = {
    128: ("FMT", "BBnNZ", "Type,Length,Name,Format,Columns"),
    32: ("PARM", "QNff", "TimeUS,Name,Value,Default"),
    33: ("ATT", "QccccCCCCB", "TimeUS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw,ErrRP,ErrYaw,AEKF"),
    34: ("STER", "Qhfffff", "TimeUS,SteerIn,SteerOut,DesLatAcc,LatAcc,DesTurnRate,TurnRate"),
    35: ("GPS", "QBBIHBcLLeffffB", "TimeUS,I,Status,GMS,GWk,NSats,HDop,Lat,Lng,Alt,Spd,GCrs,VZ,Yaw,U"),
    36: ("RCOU", "QHHHHHHHHHHHHHH", "TimeUS," + ",".join(f"C{n}" for n in range(1, 15))),
    37: ("MSG", "QZ", "TimeUS,Message"),
    38: ("WIND", "Qffffff", "TimeUS,DrRaw,DrApp,DrTru,SpdRaw,SpdApp,SpdTru"),
    39: ("RPM", "QBffB", "TimeUS,I,RPM,Qual,H"),
}
STORED = {
    "B": "B", "h": "h", "H": "H", "c": "h", "C": "H", "I": "I", "e": "i", "L": "i", "f": "f", "Q": "Q", "n": "4s",
    "N": "16s", "Z": "64s",
}  # fmt: skip


def flash_record(kind: int, *values: Any) -> bytes:
    """Return one DataFlash message; values as they are stored (c: hundredths, L: 1e-7 degrees)."""
    return b"\xa3\x95" + bytes([kind]) + struct.pack("<" + "".join(STORED[c] for c in FORMATS[kind][1]), *values)


def flash_formats() -> bytes:
    out = []
    for kind, (name, letters, labels) in FORMATS.items():
        length = 3 + struct.calcsize("<" + "".join(STORED[c] for c in letters))
        out.append(flash_record(128, kind, length, name.encode(), letters.encode(), labels.encode()))
    return b"".join(out)


def dataflash(boat: Boat, boot: float = 12.0, with_parameters: bool = True) -> bytes:
    """Return the bytes of an ArduRover .BIN of the boat; week 2400, the boat's time 0 being 100 s into it."""
    out = [flash_formats(), flash_record(37, 1_000_000, b"ArduRover V4.6.0")]
    if with_parameters:
        for name, value in ardupilot_parameters().items():
            out.append(flash_record(32, 1_000_000, name.encode(), value, 0.0))
    servo = pulses(boat.order)
    for i in every(boat, 50.0):
        micros = round((boat.time[i] + boot) * 1.0e6)
        if i % 5 == 0:
            yaw = round(math.degrees(boat.heading[i]) % 360.0 * 100.0) % 36000
            out.append(flash_record(33, micros, 0, 0, 0, 0, 0, yaw, 0, 0, 3))
            rate = math.degrees(boat.rate[i])
            out.append(flash_record(34, micros, 0, boat.order[i] / FULL * 4500.0, 0.0, 0.0, 0.0, rate))
            out.append(flash_record(36, micros, 0, 0, int(servo[i]), *[0] * 11))
        if i % 10 == 0:
            gps = (micros, 0, 3, round(boat.time[i] * 1000.0) + 100_000, 2400, 12, 90, 576900000, 118400000, 0)
            out.append(flash_record(38, micros, 1.0, -30.0, 2.0, 3.0, 6.0, 5.0))
            out.append(flash_record(39, micros, 0, 1200.0, 1.0, 1))
            out.append(flash_record(39, micros, 1, 9.0, 1.0, 1))
            out.append(flash_record(35, *gps, boat.speed[i], 0.0, 0.0, 0.0, 1))
            out.append(flash_record(35, micros, 1, *gps[2:], 77.0, 0.0, 0.0, 0.0, 1))
    return b"".join(out)


def ulog_message(kind: str, payload: bytes) -> bytes:
    """Return one message of a .ulg."""
    return struct.pack("<HB", len(payload), ord(kind)) + payload


def ulog(boat: Boat, topics: tuple[str, ...] = ("attitude", "rates", "local", "gps", "servos")) -> bytes:
    """Return a .ulg as PX4's logger would write it (layout: docs.px4.io, ULog file format)."""
    formats = {
        "attitude": "vehicle_attitude:uint64_t timestamp;uint64_t timestamp_sample;float[4] q;",
        "rates": "vehicle_angular_velocity:uint64_t timestamp;float[3] xyz;",
        "local": "vehicle_local_position:uint64_t timestamp;float vx;float vy;bool v_xy_valid;",
        "gps": "vehicle_gps_position:uint64_t timestamp;uint64_t time_utc_usec;int32_t lat;int32_t lon;float vel_m_s;"
        "uint8_t fix_type;",
        "servos": "actuator_servos:uint64_t timestamp;float[8] control;",
        "outputs": "actuator_outputs:uint64_t timestamp;float[16] output;",
    }
    out = [b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 0), ulog_message("B", bytes(40))]
    out += [ulog_message("F", formats[topic].encode()) for topic in topics]
    for name, value in {"PWM_MAIN_FUNC3": 201, "PWM_MAIN_MIN3": 1000, "PWM_MAIN_MAX3": 2000}.items():
        key = f"int32_t {name}".encode()
        out.append(ulog_message("P", bytes([len(key)]) + key + struct.pack("<i", value)))
    for number, topic in enumerate(topics):
        name = formats[topic].split(":")[0].encode()
        out.append(ulog_message("A", struct.pack("<BH", 0, number) + name))
    servo = pulses(boat.order)
    for i in every(boat, 50.0):
        now = round((boat.time[i] + 7.0) * 1e6)
        half = 0.5 * boat.heading[i]
        utc = round((EPOCH + boat.time[i]) * 1e6)
        rows: dict[str, bytes] = {
            "attitude": struct.pack("<QQ4f", now + 3000, now, math.cos(half), 0.0, 0.0, math.sin(half)),
            "rates": struct.pack("<Q3f", now, 0.0, 0.0, boat.rate[i]),
            "local": struct.pack("<QffB", now, *_velocity(boat, i), 1),
            "gps": struct.pack("<QQiifB", now, utc, 576900000, 118400000, 3.0, 3),
            "servos": struct.pack("<Q8f", now, boat.order[i] / FULL, *[math.nan] * 7),
            "outputs": struct.pack("<Q16f", now, 0.0, 0.0, servo[i], *[0.0] * 13),
        }
        for number, topic in enumerate(topics):
            if i % (10 if topic in ("gps", "local") else 5) == 0:
                out.append(ulog_message("D", struct.pack("<H", number) + rows[topic]))
    return b"".join(out)


def _velocity(boat: Boat, i: int) -> tuple[float, float]:
    return boat.speed[i] * math.cos(boat.heading[i]), boat.speed[i] * math.sin(boat.heading[i])
