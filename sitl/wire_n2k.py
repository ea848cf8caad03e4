"""The boat's NMEA 2000 network: compass, rudder drive, log, GPS, wind vane and chart plotter, each a node of its own.

Out: 127250 compass heading with its variation, 127251, 127257, 127245 rudder position, 128259, 129025, 129026, 129029,
127258, 130306, and with a route in the scenario 129283, 129284, 129285. In: 127245 with a direction moves the rudder,
"no order" or a while of silence releases it; 59904 for 60928 is answered. The network is reached through a gateway of
Yacht Devices (RAW text, with what the other side has sent echoed as T), or it is a CAN bus.

Source: layouts of the messages as in canboat's canboat.json, packed here by hand; Yacht Devices, manual of the YDWG-02,
appendix E.
"""

from __future__ import annotations

import math
import re
import struct
from collections.abc import Callable

from autopilot.angles import wrap_positive
from autopilot.links.n2k.link import CanBus
from autopilot.links.n2k.packets import FAST, Frame, Framing, Message
from sitl.sensors import Reading
from sitl.wire_nmea import ChartPlotter, RudderDrive, compass_of
from sitl.world import World

COMPASS, DRIVE, LOG, GPS, VANE, PLOTTER = 35, 12, 22, 7, 9, 3
CLASSES = {COMPASS: (60, 140), DRIVE: (40, 155), LOG: (60, 155), GPS: (60, 145), VANE: (85, 130), PLOTTER: (60, 130)}
"""Device class and function of each node."""
MAKER = 2046
RATES_HZ = {
    127250: 10.0,
    127251: 10.0,
    127245: 10.0,
    127257: 5.0,
    128259: 1.0,
    129025: 5.0,
    129026: 4.0,
    129029: 1.0,
    127258: 1.0,
    130306: 2.0,
    129285: 0.2,
    129284: 1.0,
    129283: 1.0,
}
OF_SENTENCE = {127251: "ROT", 127245: "RSA", 128259: "VHW", 129025: "RMC", 129026: "VTG", 129029: "RMC", 130306: "MWV"}
"""The NMEA 0183 sentence that a fault silences with each."""
ANGLE, NONE, NONE_SIGNED, NONE_32 = 1.0e4, 0xFFFF, 0x7FFF, 0xFFFFFFFF
DAY_S = 86400
SENT = re.compile(rb"\s*([0-9A-Fa-f]{8})((?: [0-9A-Fa-f]{2}){0,8})\s*")
LINE_MOST = 200


class N2kNetwork:
    """The nodes of the network, and what is sent to them. is_text: through a gateway; else frames, 4 bytes before data.

    Attributes:
        drive: the rudder drive.  heard: messages of the other side.
    """

    def __init__(self, world: World, is_text: bool = True) -> None:
        self.world, self.drive = world, RudderDrive(world)
        self.heard: list[Message] = []
        self._is_text = is_text
        self._plotter = ChartPlotter(world.scenario) if world.scenario.route else None
        self._framings = {node: Framing(FAST, frozenset()) for node in CLASSES}
        self._ours = Framing(FAST, FAST | {127245, 59904, 60928})
        self._rest = b""
        self._out: list[bytes] = []
        self._sid = 0
        self._due = {group: world.time + 0.007 * place for place, group in enumerate(RATES_HZ)}
        self._compose: dict[int, tuple[int, Callable[[Reading], bytes]]] = {
            127250: (COMPASS, self._heading),
            127251: (COMPASS, lambda it: struct.pack("<BiBH", self._sid, round(it.rate / 3.125e-8), 255, NONE)),
            127257: (
                COMPASS,
                lambda it: struct.pack("<BhhhB", self._sid, NONE_SIGNED, NONE_SIGNED, _angle(it.roll), 255),
            ),
            127245: (DRIVE, lambda it: struct.pack("<BBhhH", 0, 0xFF, NONE_SIGNED, _angle(it.rudder), NONE)),
            128259: (
                LOG,
                lambda it: struct.pack("<BHHBH", self._sid, round(100.0 * max(it.water_speed, 0.0)), NONE, 255, NONE),
            ),
            129025: (GPS, lambda it: struct.pack("<ii", round(it.latitude * 1e7), round(it.longitude * 1e7))),
            129026: (GPS, self._over_ground),
            129029: (GPS, self._fix),
            127258: (
                GPS,
                lambda _: struct.pack("<BBHhH", self._sid, 0xF8, NONE, _angle(world.sensors.variation), NONE),
            ),
            130306: (VANE, self._wind),
        }
        if self._plotter is not None:
            self._compose |= {
                129283: (PLOTTER, self._cross_track),
                129284: (PLOTTER, self._leg),
                129285: (PLOTTER, self._route),
            }
        for node in CLASSES:
            self._claim(node)
        world.watchers.append(self._after_step)

    def receive(self, now: float, data: bytes) -> None:
        """Take lines, or a frame, that arrived at `now` [s]."""
        self.world.advance(now)
        if not self._is_text:
            self._take(Frame(int.from_bytes(data[:4], "big"), data[4:]))
            return
        *lines, rest = (self._rest + data).split(b"\n")
        self._rest = rest if len(rest) <= LINE_MOST else b""
        for line in lines:
            parts = SENT.fullmatch(line)
            if parts is not None and int(parts[1], 16) < 1 << 29:
                frame = Frame(int(parts[1], 16), bytes.fromhex(parts[2].decode()))
                self._put(frame, "T")
                self._take(frame)

    def advance(self, now: float) -> None:
        """Move the world on to `now` [s]."""
        self.world.advance(now)

    def transmit(self, now: float) -> list[bytes]:
        """Return what has left by `now` [s]: a line, or a frame, each."""
        self.world.advance(now)
        leaving, self._out = self._out, []
        return leaving

    def command(self, data: bytes, group: int = 126208, to: int = 204) -> None:
        """Have the plotter send a message, such as a command, to a node."""
        self._send(PLOTTER, Message(group, data, PLOTTER, to, 3))

    def _take(self, frame: Frame) -> None:
        message = self._ours.take(self.world.time, frame)
        if message is None:
            return
        self.heard.append(message)
        data = message.data
        if message.group == 127245 and len(data) >= 4:
            side, angle = data[1] & 7, struct.unpack_from("<h", data, 2)[0] / ANGLE
            if side in (1, 2) and abs(angle) <= 0.5 * math.pi:
                self.drive.order(abs(angle) if side == 1 else -abs(angle), self.world.time)
            elif side == 0:
                self.drive.order(None, self.world.time)
        elif message.group == 59904 and data == b"\x00\xee\x00":
            for node in CLASSES if message.destination == 255 else {message.destination} & set(CLASSES):
                self._claim(node)

    def _after_step(self, time: float) -> None:
        sensors = self.world.sensors
        for group, due in self._due.items():
            if due > time + 1.0e-9 or group not in self._compose:
                continue
            period = 1.0 / RATES_HZ[group]
            self._due[group] = due + period if due + period > time else time + period
            reading = sensors.second(time)
            if reading is None or sensors.is_silent(time):
                continue
            if group == 127250 and not sensors.has_heading(time, "second"):
                continue
            if group in OF_SENTENCE and self.world.faults.silences(OF_SENTENCE[group], time):
                continue
            node, compose = self._compose[group]
            if node == PLOTTER and self._plotter is not None:
                self._plotter.update(reading)
            self._sid = (self._sid + 1) % 253
            self._send(node, Message(group, compose(reading), node, priority=2))

    def _claim(self, node: int) -> None:
        kind, function = CLASSES[node]
        name = 1 << 63 | 4 << 60 | kind << 49 | function << 40 | MAKER << 21 | node
        self._send(node, Message(60928, struct.pack("<Q", name), node))

    def _send(self, node: int, message: Message) -> None:
        for frame in self._framings[node].frames(message):
            self._put(frame, "R")

    def _put(self, frame: Frame, direction: str) -> None:
        if not self._is_text:
            self._out.append(frame.identifier.to_bytes(4, "big") + frame.data)
            return
        clock = (self.world.scenario.start.unix_time_s + self.world.time) % DAY_S
        minutes, seconds = divmod(clock, 60.0)
        stamp = f"{int(minutes // 60):02d}:{int(minutes % 60):02d}:{min(seconds, 59.999):06.3f}"
        self._out.append(f"{stamp} {direction} {frame.identifier:08X} {frame.data.hex(' ').upper()}\r\n".encode())

    def _heading(self, it: Reading) -> bytes:
        shown, sent = compass_of(self.world, it)
        variation = NONE_SIGNED if sent is None else _angle(sent)
        return struct.pack("<BHhhB", self._sid, _course(shown), NONE_SIGNED, variation, 0xFD)

    def _over_ground(self, it: Reading) -> bytes:
        return struct.pack("<BBHHH", self._sid, 0xFC, _course(it.course), round(100.0 * it.ground_speed), NONE)

    def _fix(self, it: Reading) -> bytes:
        day, second = divmod(self.world.scenario.start.unix_time_s + it.time, DAY_S)
        place = (round(it.latitude * 1e16), round(it.longitude * 1e16), 0)
        return struct.pack(
            "<BHIqqqBBBhhiB", self._sid, int(day), round(second * 1e4), *place, 0x10, 0xFC, 8, 100, 150, 0, 0
        )

    def _wind(self, it: Reading) -> bytes:
        angle = wrap_positive(it.wind_angle)
        return struct.pack("<BHHBH", self._sid, round(100.0 * it.wind_speed), _course(angle), 0xFA, NONE)

    def _cross_track(self, it: Reading) -> bytes:
        assert self._plotter is not None
        if self._plotter.is_over:
            return struct.pack("<BBiH", self._sid, 0x70, 0x7FFFFFFF, NONE)
        error = self._plotter.bearings(it)[3]
        return struct.pack("<BBiH", self._sid, 0x30, round(100.0 * error), NONE)

    def _leg(self, it: Reading) -> bytes:
        assert self._plotter is not None
        if self._plotter.is_over:
            return b"\xff" * 24 + b"\xff\xff\xff\x7f" * 2 + b"\xff\x7f"
        track, bearing, distance, _ = self._plotter.bearings(it)
        latitude, longitude = self._plotter.waypoint(self._plotter.leg + 1)
        return struct.pack(
            "<BIBIHHHIIiih",
            *(self._sid, round(100.0 * distance), 0x40, NONE_32, NONE),
            *(_course(math.radians(track)), _course(math.radians(bearing))),
            *(self._plotter.leg, self._plotter.leg + 1, round(latitude * 1e7), round(longitude * 1e7), NONE_SIGNED),
        )

    def _route(self, it: Reading) -> bytes:
        assert self._plotter is not None
        numbers = [number for number in (self._plotter.leg, self._plotter.leg + 1) if number < self._plotter.count]
        data = struct.pack("<HHHHB", 0, len(numbers), 1, 1, 0xE0) + _text("Route") + b"\xff"
        for number in numbers:
            latitude, longitude = self._plotter.waypoint(number)
            place = struct.pack("<ii", round(latitude * 1e7), round(longitude * 1e7))
            data += struct.pack("<H", number) + _text(f"WP{number}") + place
        return data


def _angle(angle: float) -> int:
    return round(angle * ANGLE)


def _course(angle: float) -> int:
    return round(wrap_positive(angle) * ANGLE)


def _text(words: str) -> bytes:
    return bytes((len(words) + 2, 1)) + words.encode("ascii")


class BusTransport(CanBus):
    """A CAN bus of python-can as a `Transport`: a chunk is a frame, its identifier in 4 bytes before its data."""

    is_stream = False
    is_local = True

    def receive(self) -> list[bytes]:
        """Return the frames that wait."""
        return [frame.identifier.to_bytes(4, "big") + frame.data for frame in self.frames()]

    def send(self, data: bytes) -> bool:
        """Send a frame; False where the bus does not take it."""
        return self.put(Frame(int.from_bytes(data[:4], "big"), data[4:]))
