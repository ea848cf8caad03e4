"""Every reader of files and lines as a fuzzer's target: what it cannot use it refuses with an InputError, else nothing.

The sound inputs that the engines begin with are made here: files that are shipped, and recordings of a simulated boat.
"""

from __future__ import annotations

import functools
import math
import os
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.cli.helm_keys import wish_of
from autopilot.cli.log import as_text
from autopilot.cli.route_skipper import RouteSkipper
from autopilot.errors import InputError
from autopilot.guidance.plotter import PlotterGuide
from autopilot.guidance.track import TrackGuide
from autopilot.links.boat.boat_link import BoatLink
from autopilot.links.boat.commands import Commands
from autopilot.links.boat.mission import Mission
from autopilot.links.boat.mission_items import parse_items
from autopilot.links.boat.parameter_server import ParameterServer
from autopilot.links.mavlink_codec import MavlinkCodec
from autopilot.links.nmea0183 import NmeaFramer
from autopilot.links.nmea0183 import checksum as nmea_checksum
from autopilot.links.nmea_samples import NmeaReader
from autopilot.links.signing import checksum
from autopilot.links.signing_key import key_of
from autopilot.links.transports.memory import loopback_pair
from autopilot.links.url import parse_url
from autopilot.loop.csv_log import load_column_map
from autopilot.loop.logs.dataflash_log import read_dataflash
from autopilot.loop.logs.info import info_of
from autopilot.loop.logs.nmea_text import read_nmea
from autopilot.loop.logs.reading import read_recording
from autopilot.loop.logs.rudder import RudderSettings
from autopilot.loop.logs.series import Recording
from autopilot.loop.logs.tlog import read_tlog
from autopilot.loop.logs.ulog import read_ulog
from autopilot.loop.record import Recorder, read_log
from autopilot.order_values import order_object
from autopilot.params.firmware_file import firmware_from
from autopilot.params.foreign_files import parse_foreign
from autopilot.params.strict_yaml import parse_document
from autopilot.params.vessel import Vessel
from autopilot.params.vessel_file import dump_vessel, load_vessel, parse_vessel
from autopilot.params.vessel_parameters import parameters_of, value_of, with_value
from autopilot.signalk.requests import BadRequestError, answer, parse
from autopilot.signals import OrderKind
from autopilot.web.requests import asked_of
from autopilot.web.station import Station
from sitl.chaos import chaos_faults
from sitl.fault_desk import obey
from sitl.scenario import load_scenario, scenario_from
from sitl.world import World

ROOT = Path(__file__).parents[1]
SECONDS = 4.0
"""Length of the recordings that are damaged: short, so that damage reaches every part of them."""


class Target(NamedTuple):
    """Takes bytes; raises InputError for what it refuses, and nothing else. seeds: sound inputs."""

    take: Callable[[bytes], None]
    seeds: Sequence[bytes]


@functools.cache
def targets() -> dict[str, Target]:
    """Return every target by its name."""
    world = World(load_vessel("lanxin"), load_scenario("calm"))
    logs = _recordings()
    return {
        "vessel YAML": Target(_vessel, _shipped("firmware_params/vessels", "*.yaml")),
        "scenario YAML": Target(_scenario, [*_shipped("sitl/scenarios", "*.yaml"), SCENARIO]),
        "firmware YAML": Target(_firmware, _shipped("firmware_params/firmware", "*.yaml")),
        "parameter files": Target(_foreign, FOREIGN),
        "column map YAML": Target(_in_file(load_column_map), [b"time_s: t\nheading_deg: HDG\nspeed_kn: SOG\n"]),
        "CSV log": Target(_in_file(lambda path: _sound(read_recording(path))), logs["csv"]),
        "telemetry log": Target(lambda data: _sound(read_tlog("x.tlog", data)), logs["tlog"]),
        "own log": Target(_in_file(lambda path: read_log(Path(path))), logs["own"]),
        "DataFlash log": Target(lambda data: _sound(read_dataflash("x.bin", data)), logs["dataflash"]),
        "ULog": Target(lambda data: _sound(read_ulog("x.ulg", data)), logs["ulog"]),
        "NMEA log": Target(lambda data: _sound(read_nmea("x.txt", data, 0.1)), logs["nmea"]),
        "any log": Target(
            _in_file(lambda path: _sound(read_recording(path))), [*[log[0] for log in logs.values()], CANDUMP]
        ),
        "link URL": Target(lambda data: _text(data, parse_url), URLS),
        "signing key": Target(lambda data: _key(data), [b"0123456789abcdef" * 4, bytes(range(32))]),
        "mission file": Target(lambda data: _text(data, _mission), MISSIONS),
        "typed order": Target(lambda data: _text(data, _typed), TYPED),
        "page order": Target(_page_order, ORDERS),
        "Signal K order": Target(lambda data: _signalk_order(data), SIGNALK),
        "MAVLink order": Target(_mavlink_order(), _orders()),
        "NMEA line": Target(_nmea_line, logs["nmea"]),
        "faults and chaos": Target(lambda data: _faults(world, data), [b"loss=0.1,delay=2", b"yaw_push size=3 for=2"]),
    }


SCENARIO = b"""schema_version: 1
name: all
seed: 7
faults: [{kind: heading_jump, from_s: 1, to_s: 9, size: 20, ramp_s: 2}, {kind: silence, from_s: 3, every_s: 9}]
waves: {second_order: {frequency_rad_s: 1, damping: 0.1, sigma_deg: 5}}
route: [[0, 0], [500, 0]]
"""
FOREIGN = [
    b"# comment\nRC1_TRIM,1500\nSERVO1_FUNCTION,26\nATC_STR_RAT_P,0.2\n",
    b"RC1_TRIM 1500\nATC_STR_RAT_P 0.200000\n",
    b"# Onboard parameters\n#\n1\t1\tRC1_TRIM\t1500\t4\n1\t1\tATC_STR_RAT_P\t0.2\t9\n",
]
URLS = [b"udpin:127.0.0.1:14550", b"serial:/dev/ttyUSB0:115200", b"nmea:/dev/ttyUSB1:4800?send=HDG:10", b"tcp:h:5760"]


MISSIONS = [b"QGC WPL 110\n0\t1\t3\t16\t0\t5\t0\t0\t59.1\t18.2\t0\t1\n1\t0\t3\t16\t0\t5\t0\t0\t59.2\t18.3\t0\t1\n"]
TYPED = [
    b"e 90",
    b"+10",
    b"r -5",
    b"t 1",
    b"p circle + 60",
    b"p spiral - 60 10",
    b"zigzag 10 10 60",
    b"set CTL_RATE 20",
]
ORDERS = [
    b'{"do":"turn","degrees":-10}',
    b'{"do":"pattern","number":1,"side":1,"sizes":[60,10]}',
    b'{"do":"set","name":"CTL_RATE","value":20}',
    b'{"do":"zigzag","rudder":10,"change":10,"duration":60}',
]
TOKEN = "a-token-of-enough-letters"
SIGNALK = [
    b'{"requestId":"1","token":"%b","put":{"path":"steering.autopilot.actions.%b","value":10}}' % (TOKEN.encode(), word)
    for word in (b"adjustHeading", b"dodge")
]
CANDUMP = b"""(1436509052.249713) can0 09F11200#FFB2A4FF7FFF7FFD
2016-02-28T19:57:02.364Z,2,127250,7,255,8,ff,10,3b,ff,7f,ce,f5,fc
"""


def _mission(text: str) -> None:
    for item in parse_items(text, "x.waypoints"):
        assert math.isfinite(item.waypoint.latitude) and math.isfinite(item.waypoint.longitude)


def _typed(text: str) -> None:
    """A line at the terminal of `run`, and at that of the helm; one may refuse what the other takes."""
    skipper = RouteSkipper(0.6, PlotterGuide(), Mission(TrackGuide()))
    skipper.engage(0.0)
    try:
        wish = wish_of(text)
    except InputError:
        wish = None
    if wish is not None:
        asked_of(Station(), wish)
    said = skipper.type_line(text)
    assert isinstance(said, str)
    order = skipper(0.0, None)
    assert math.isfinite(order.rudder) and (math.isfinite(order.heading) or order.kind is OrderKind.HEADING)


def _page_order(data: bytes) -> None:
    asked_of(Station(), order_object(data))(0.0, lambda taken, words: None)


def _signalk_order(data: bytes) -> None:
    try:
        wish = parse(data, TOKEN).wish
    except BadRequestError as error:
        assert answer(error.id, error.status, str(error)).count(b"\n") == 1
        raise
    if wish is not None:
        asked_of(Station(), wish)


def _orders() -> list[bytes]:
    """Return a message of every kind that a ground station may send, as MAVLink 2."""
    codec = MavlinkCodec(255, 190)
    numbers = [each.name for each in parameters_of(load_vessel("lanxin"))]
    item = (1, 1, 0, 3, 16, 0, 1, 0.0, 5.0, 0.0, 0.0, 590000000, 180000000, 0.0)
    commands = (400, 176, 115, 21, 192, 300, 224, 31010, 31011, 31012, 31013, 31014, 31009, 511, 512)
    return [
        *(codec.encode(dialect.MAVLink_command_long_message(1, 1, n, 0, 1, 1, 1, 0, 0, 0, 0)) for n in commands),
        *(codec.encode(dialect.MAVLink_command_int_message(1, 1, 0, n, 0, 0, 1, 1, 0, 0, 1, 1, 0)) for n in commands),
        *(codec.encode(dialect.MAVLink_param_set_message(1, 1, name.encode(), 1.0, 9)) for name in numbers),
        codec.encode(dialect.MAVLink_param_request_read_message(1, 1, b"CTL_RATE", -1)),
        codec.encode(dialect.MAVLink_set_mode_message(1, 1, 15)),
        codec.encode(dialect.MAVLink_mission_count_message(1, 1, 1, 0)),
        codec.encode(dialect.MAVLink_mission_item_int_message(*item)),
        codec.encode(dialect.MAVLink_mission_set_current_message(1, 1, 1)),
    ]


def _mavlink_order() -> Callable[[bytes], None]:
    """Return a target that takes packets whose payload is damaged and whose checksum is right."""
    vessel = load_vessel("lanxin")

    table = {each.name: each for each in parameters_of(vessel)}

    class Numbers:
        """The vessel's numbers, checked and not kept."""

        names = tuple(table)

        def get(self, name: str) -> float:
            return value_of(vessel, table[name])

        def set(self, name: str, value: float) -> str:
            try:
                with_value(vessel, table[name], value)
            except ValueError as error:
                return str(error)
            return ""

    def take(data: bytes) -> None:
        near, far = loopback_pair()
        mission = Mission(TrackGuide())
        commands = Commands(RouteSkipper(0.6, PlotterGuide(), mission), True, mission)
        boat = BoatLink(near, commands, ParameterServer(Numbers()))
        for frame in _sealed(data):
            far.send(frame)
        boat.receive(0.1)
        boat.keep(0.1)
        boat.receive(2.0)
        boat.keep(2.0)
        for packet in far.receive():
            assert len(packet) <= 280

    return take


def _sealed(data: bytes) -> Iterator[bytes]:
    """Yield the MAVLink 2 frames in `data`, whatever was done to their payloads, each with the right checksum."""
    place = data.find(b"\xfd")
    while place >= 0 and place + 12 <= len(data):
        identity = int.from_bytes(data[place + 7 : place + 10], "little")
        kind = dialect.mavlink_map.get(identity)
        end = place + 10 + data[place + 1]
        if kind is not None and end <= len(data):
            body = bytes([data[place + 1], 0, 0]) + data[place + 4 : end]
            yield b"\xfd" + body + checksum(body, kind.crc_extra)
        place = data.find(b"\xfd", place + 1)


def _nmea_line(data: bytes) -> None:
    """A line as instruments send it, every sentence of it with the right checksum."""
    framer, reader = NmeaFramer(), NmeaReader(0.1)
    for line in data.splitlines():
        body = line[line.find(b"$") + 1 :].partition(b"*")[0]
        for sentence in framer.feed(b"$%b*%02X\r\n" % (body, nmea_checksum(body))):
            for sample in (reader.read(1.0, sentence), reader.take_position()):
                values = [] if sample is None else [value for value in sample if isinstance(value, float)]
                assert all(map(math.isfinite, values)), sample
    framer.feed(data)


def _text(data: bytes, use: Callable[[str], object]) -> None:
    use(data.decode("utf-8", "replace"))


def _vessel(data: bytes) -> None:
    vessel = parse_vessel(data.decode("utf-8", "replace"), "x.yaml")
    assert isinstance(vessel, Vessel)
    # what is taken can be written and read again, and is the same
    assert parse_vessel(dump_vessel(vessel)) == vessel


def _scenario(data: bytes) -> None:
    scenario_from(parse_document(data.decode("utf-8", "replace"), "x.yaml"))


def _firmware(data: bytes) -> None:
    firmware_from(parse_document(data.decode("utf-8", "replace"), "x.yaml"))


def _foreign(data: bytes) -> None:
    found = parse_foreign(data.decode("utf-8", "replace"), "x.param")
    assert all(math.isfinite(each.value) for each in found.values)


def _key(data: bytes) -> None:
    assert len(key_of(data, Path("x.key"))) == 32


def _faults(world: World, data: bytes) -> None:
    text = data.decode("utf-8", "replace")
    world.faults.clear(0.0)
    assert obey(world, text).partition(" ")[0] in ("ok", "error")
    for fault in chaos_faults(text):
        assert math.isfinite(fault.size)


def _in_file(use: Callable[[str], object]) -> Callable[[bytes], None]:
    """Return a target for a reader that wants a path; the file is in memory where the system has such a folder."""
    folder = "/dev/shm" if os.access("/dev/shm", os.W_OK) else None
    handle, path = tempfile.mkstemp(suffix=".log", dir=folder)
    Path(path).unlink()
    place = f"/proc/self/fd/{handle}"

    def take(data: bytes) -> None:
        os.ftruncate(handle, 0)
        os.pwrite(handle, data, 0)
        use(place)

    return take


def _sound(recording: Recording) -> None:
    """Times rise, every value is a number, and what there is to know of it can be shown."""
    assert as_text(info_of(recording, RudderSettings()))
    for series in recording.series:
        assert series.time.shape == series.values.shape
        assert bool(np.all(np.isfinite(series.time))), series.quantity
        assert bool(np.all(np.diff(series.time) >= 0.0)), series.quantity
        assert bool(np.all(np.isfinite(series.values))), series.quantity


def _shipped(folder: str, pattern: str) -> list[bytes]:
    return [path.read_bytes() for path in sorted((ROOT / folder).glob(pattern))]


def _recordings() -> dict[str, list[bytes]]:
    """Return short sound logs of every kind."""
    sys.path[:0] = [str(ROOT / "tests"), str(ROOT / "tests" / "loop")]
    from boat_recordings import dataflash, tlog, tlog_events, zigzag_boat
    from test_px4_and_nmea_logs import ulog

    boat = zigzag_boat()
    short = type(boat)(*(column[: round(SECONDS / (boat.time[1] - boat.time[0]))] for column in boat))
    rows = [
        f"{t:.2f},{math.degrees(h):.2f},{v:.2f}" for t, h, v in zip(short.time, short.heading, short.speed, strict=True)
    ]
    return {
        "csv": ["\n".join(["time_s,heading_deg,speed_m_s", *rows[::10]]).encode()],
        "tlog": [tlog(tlog_events(short))],
        "own": [_own_log()],
        "dataflash": [dataflash(short)],
        "ulog": [ulog(short)],
        "nmea": [_nmea(short)],
    }


def _own_log() -> bytes:
    from autopilot.build import build_pilot
    from autopilot.signals import HeadingSample, Order, OrderKind

    vessel = load_vessel("lanxin")
    pilot = build_pilot(vessel)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "own.tlog"
        recorder = Recorder(path, {"vessel": dump_vessel(vessel), "law": None}, 0.0)
        for step in range(40):
            now = 0.05 * step
            order = Order(OrderKind.HEADING, 0.3, serial=1)
            recorder.record(pilot.step(now, (HeadingSample(now, 0.1, 0.0),), order), [])
        recorder.close()
        return path.read_bytes()


def _nmea(boat: object) -> bytes:
    from autopilot.links import nmea_encoders as encode

    lines = []
    for step in range(40):
        stamp = f"12:00:{step / 10:06.3f} ".encode()
        lines += [
            stamp + encode.encode_hdt(0.02 * step),
            stamp + encode.encode_rot(0.1),
            stamp + encode.encode_rsa(0.05),
        ]
    return b"".join(lines)
