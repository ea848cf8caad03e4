"""A simulated boat on an NMEA 2000 bus: its messages as the package nmea2000 encodes them, in the forms of logs.

The forms are written out here from their descriptions. Nothing here is a recording of a real boat.
"""

from __future__ import annotations

import math
from base64 import b64encode
from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from typing import NamedTuple

import nmea2000
from boat_recordings import EPOCH, Boat, every
from nmea2000.input_formats import N2KFormat

FRAMES = nmea2000.create_encoder(N2KFormat.PYTHON_CAN)
WHOLE = nmea2000.create_encoder(N2KFormat.BASIC_STRING)


class Sent(NamedTuple):
    """A message: seconds of the boat, parameter group, source, fields by canboat's names."""

    time: float
    group: int
    source: int
    fields: dict[str, object]

    def message(self) -> nmea2000.NMEA2000Message:
        fields = [nmea2000.NMEA2000Field(id=name, value=value) for name, value in self.fields.items()]
        return nmea2000.NMEA2000Message(PGN=self.group, source=self.source, destination=255, priority=2, fields=fields)

    def frames(self) -> list[tuple[int, bytes]]:
        """Return identifier and data of its frames."""
        return [(frame.arbitration_id, bytes(frame.data)) for frame in FRAMES.encode(self.message())]

    def payload(self) -> bytes:
        return bytes.fromhex("".join(WHOLE.encode(self.message()).split(",")[6:]))


def sent(boat: Boat) -> Iterator[Sent]:
    """Yield what the boat's instruments send: heading, rate and rudder at 10 Hz, the rest at 1 Hz."""
    for i in every(boat, 10.0):
        t, heading = float(boat.time[i]), float(boat.heading[i] % math.tau)
        yield Sent(t, 127250, 35, {"heading": heading, "reference": "True"})
        yield Sent(t + 0.001, 127251, 35, {"rate": float(boat.rate[i])})
        yield Sent(t + 0.002, 127245, 12, {"instance": 0, "position": float(boat.rudder[i])})
        if i % 50 == 0:
            place = {"latitude": 57.69 + 1e-5 * t, "longitude": 11.84}
            wind = {"windSpeed": 5.0, "windAngle": math.radians(315.0), "reference": "Apparent"}
            yield Sent(t + 0.003, 128259, 12, {"speedWaterReferenced": float(boat.speed[i])})
            yield Sent(t + 0.004, 129029, 7, {**place, **_date_and_time(t)})
            yield Sent(t + 0.005, 130306, 9, wind)
            yield Sent(t + 0.006, 126993, 9, {"dataTransmitOffset": 60.0})


def _date_and_time(seconds: float) -> dict[str, object]:
    now = datetime.fromtimestamp(EPOCH + seconds + 0.004, UTC)
    return {"date": now.date(), "time": now.time()}


def _stamp(seconds: float, form: str) -> str:
    return datetime.fromtimestamp(EPOCH + seconds, UTC).strftime(form)[
        : len("2011-11-24T22:42:04.388") if "Y" in form else 12
    ]


def _human(data: bytes) -> str:
    return f"[{len(data)}]  {data.hex(' ').upper()}"


def _canboat(each: Sent, data: bytes, form: str, end: str) -> str:
    return f"{_stamp(each.time, form)}{end},2,{each.group},{each.source},255,{len(data)},{data.hex(',')}"


OF_FRAMES: dict[str, Callable[[Sent, int, bytes], str]] = {
    "canboat frames": lambda m, i, d: _canboat(m, d, "%Y-%m-%d-%H:%M:%S.%f", ""),
    "canboat ISO frames": lambda m, i, d: _canboat(m, d, "%Y-%m-%dT%H:%M:%S.%f", "Z"),
    "candump -L": lambda m, i, d: f"({EPOCH + m.time:.6f}) can0 {i:08X}#{d.hex().upper()}",
    "candump -L, FD": lambda m, i, d: f"({EPOCH + m.time:.6f}) can0 {i:08X}##1{d.hex().upper()}",
    "candump -ta -c": lambda m, i, d: f"\x1b[32m ({EPOCH + m.time:.6f})  can0  {i:08X}   {_human(d)}\x1b[0m",
    "candump -ta": lambda m, i, d: f" ({EPOCH + m.time:.6f})  can0  {i:08X}   {_human(d)}",
    "candump -tA": lambda m, i, d: (
        f" ({datetime.fromtimestamp(EPOCH + m.time, UTC):%Y-%m-%d %H:%M:%S.%f})  can0  {i:08X}   {_human(d)}"
    ),
    "candump -ta -x": lambda m, i, d: f" ({EPOCH + m.time:.6f})  can0  RX - -  {i:08X}   {_human(d)}",
    "Yacht Devices": lambda m, i, d: f"{_stamp(m.time, '%H:%M:%S.%f')} R {i:08X} {d.hex(' ').upper()}",
    "Signal K, Yacht Devices": lambda m, i, d: (
        f"{round(1000 * (EPOCH + m.time))};N;{_stamp(m.time, '%H:%M:%S.%f')} R {i:08X} {d.hex(' ').upper()}"
    ),
}
"""A line for each frame, of message, identifier and data."""
OF_MESSAGES: dict[str, Callable[[Sent, bytes], str]] = {
    "canboat": lambda m, d: _canboat(m, d, "%Y-%m-%d-%H:%M:%S.%f", ""),
    "canboat ISO": lambda m, d: _canboat(m, d, "%Y-%m-%dT%H:%M:%S.%f", "Z"),
    "iKonvert": lambda m, d: (
        f"!PDGY,{m.group},2,{m.source},255,{500 + int(m.time)}.{round(1000 * (m.time % 1.0))},{b64encode(d).decode()}"
    ),
    "iKonvert, no padding": lambda m, d: (
        f"!PDGY,{m.group},2,{m.source},255,{int(m.time)}.{round(1000 * (m.time % 1.0))},"
        f"{b64encode(d).decode().rstrip('=')}"
    ),
    "Actisense": lambda m, d: (
        f"A{_stamp(m.time, '%H:%M:%S.%f').replace(':', '')} {m.source:02X}FF2 {m.group:05X} {d.hex().upper()}"
    ),
}
"""A line for each message, fast packets put together, of message and payload."""
UNDATED = ("Yacht Devices", "Actisense", "iKonvert", "iKonvert, no padding")


def lines(messages: Iterator[Sent], form: str) -> list[str]:
    """Return the lines of a log of `form`."""
    if form in OF_MESSAGES:
        return [OF_MESSAGES[form](each, each.payload()) for each in messages]
    return [OF_FRAMES[form](each, identity, data) for each in messages for identity, data in each.frames()]
