"""Every reader of files and lines as a fuzzer's target: what it cannot use it refuses with an InputError, else nothing.

The sound inputs that the engines begin with are made here: files that are shipped, and recordings of a simulated boat.
"""

from __future__ import annotations

import contextlib
import functools
import json
import lzma
import math
import os
import sys
import tempfile
import warnings
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as dialect
from starlette.responses import JSONResponse

from autopilot.cli.helm import request_of
from autopilot.cli.log import as_text
from autopilot.cli.log import measures_as_json as measures_json
from autopilot.cli.log import measures_as_text as measures_text
from autopilot.errors import InputError, RefusedError
from autopilot.files.outside import order_object
from autopilot.files.strict_yaml import parse_document
from autopilot.firmware.file import firmware_from
from autopilot.firmware.foreign_files import parse_foreign
from autopilot.guidance.plotter import PlotterGuide
from autopilot.guidance.track import TrackGuide
from autopilot.identification.identified import Question
from autopilot.identification.registry import method_named
from autopilot.identification.residual_tests import residual_tests
from autopilot.identification.rudder_path import rudder_rate_of
from autopilot.identification.runs import Run, run_from_columns
from autopilot.identification.trial_measures import measures_of, record_of
from autopilot.links.ground_station.boat_link import BoatLink
from autopilot.links.ground_station.commands import Commands
from autopilot.links.ground_station.file_server import ACK, HEADER, OPEN, PARAMETERS, READ, metadata_files
from autopilot.links.ground_station.mission import Mission, parse_items
from autopilot.links.ground_station.station_service import ParameterServer
from autopilot.links.mavlink.codec import MavlinkCodec
from autopilot.links.mavlink.frames import checksum
from autopilot.links.mavlink.signing import key_of
from autopilot.links.nmea.samples import NmeaReader
from autopilot.links.nmea.sentences import NmeaFramer
from autopilot.links.nmea.sentences import checksum as nmea_checksum
from autopilot.links.transports import loopback_pair
from autopilot.links.url import parse_url
from autopilot.logs.csv_log import load_column_map
from autopilot.logs.dataflash import read_dataflash
from autopilot.logs.mcap_log import read_mcap, series_entries, write_mcap
from autopilot.logs.n2k_json import read_n2k_json
from autopilot.logs.n2k_text import read_n2k
from autopilot.logs.nmea_text import read_nmea
from autopilot.logs.reading import info_of, load_run, read_recording
from autopilot.logs.series import HEADING, RUDDER, SPEED, Recording, Series
from autopilot.logs.table import RudderSettings, table_of
from autopilot.logs.tlog import read_tlog
from autopilot.logs.ulog import read_ulog
from autopilot.operators.skipper import Skipper
from autopilot.report.identification import Result
from autopilot.report.identification import as_json as identified_json
from autopilot.report.identification import as_text as identified_text
from autopilot.runtime.record import MOST_PIECES, PIECE, Recorder, replay
from autopilot.runtime.tick_codec import HEADER as LOG_HEADER
from autopilot.signalk.messages import BadRequestError, Deltas, answer, line_of, parse
from autopilot.signals import OrderKind
from autopilot.vessel.file import dump_vessel, load_vessel, parse_vessel
from autopilot.vessel.parameters import parameters_of, value_of, with_value
from autopilot.vessel.schema import Vessel
from autopilot.web.hub import Hub
from autopilot.web.journal import alarms_from
from autopilot.web.requests import asked_of
from autopilot.web.screen import screen
from autopilot.web.station import BoatLine, Station, descriptions_from
from autopilot.web.view import NAMED
from sitl.faults import obey
from sitl.scenario import load_scenario, scenario_from
from sitl.serve import chaos_faults
from sitl.world import World

ROOT = Path(__file__).parents[1]
SETTINGS, METHOD = RudderSettings(at_full=0.5), method_named("two-stage")
LINE_MOST = 2600
"""Characters of a line that a command prints: a note and what it quotes."""
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
        "CSV numbers": Target(_csv_numbers(logs["csv"][1:]), CSV_EDITS),
        "telemetry log": Target(lambda data: _sound(read_tlog("x.tlog", _sealed_log(data))), logs["tlog"]),
        "own log": Target(_own_log_in_file(), logs["own"]),
        "own log's header": Target(_own_header_in_file(), HEADERS),
        "DataFlash log": Target(lambda data: _sound(read_dataflash("x.bin", data)), logs["dataflash"]),
        "ULog": Target(lambda data: _sound(read_ulog("x.ulg", data)), logs["ulog"]),
        "NMEA log": Target(lambda data: _sound(read_nmea("x.txt", mended(data), 0.1)), logs["nmea"]),
        "NMEA 2000 log": Target(lambda data: _sound(read_n2k("x.log", data, 0.1)), N2K),
        "NMEA 2000 in JSON": Target(lambda data: _sound(read_n2k_json("x.json", data, 0.1)), N2K_JSON),
        "MCAP": Target(lambda data: _sound(read_mcap("x.mcap", data)), logs["mcap"]),
        "any log": Target(
            _in_file(lambda path: _sound(read_recording(path))), [*[log[0] for log in logs.values()], *N2K, *N2K_JSON]
        ),
        "link URL": Target(lambda data: _text(data, parse_url), URLS),
        "signing key": Target(lambda data: _key(data), [b"0123456789abcdef" * 4, bytes(range(32))]),
        "mission file": Target(lambda data: _text(data, _mission), MISSIONS),
        "typed order": Target(lambda data: _text(data, _typed), TYPED),
        "page order": Target(_page_order, ORDERS),
        "Signal K order": Target(lambda data: _signalk_order(data), SIGNALK),
        "alarm list": Target(_alarm_list, ALARM_LISTS),
        "parameter metadata": Target(_metadata, [_described(), lzma.decompress(_described())]),
        "MAVLink of a boat": Target(_boat, _said_by_a_boat()),
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
ALARM_LISTS = [
    b'[{"name":"heading_lost","words":"heading lost: steer by hand","state":"sounding","priority":"alarm",'
    b'"escalated":true},{"name":"","words":"gear hot 5\xc2\xb0","state":"notice","priority":"caution"}]',
    b'[{"name":"roll","words":"heeled","state":"acknowledged","priority":"warning","escalated":false}]',
]
HEADERS = [
    b'{"first": 0, "format": 2, "law": null, "norrbin": "1.0", "part": 1, "run": "1-2", "vessel": "x"}',
    b'{"law": "pid", "part": 1, "vessel": %b}' % json.dumps(dump_vessel(load_vessel("lanxin"))).encode(),
]
N2K_PAYLOADS = (
    (127250, "ff103bff7fcef5fc"),
    (127251, "7d0b7d0200ffffff"),
    (127245, "00f8ff7fa00fffff"),
    (127257, "ff8813ff7fff7fff"),
    (128259, "ff2c01ffff00ffff"),
    (129025, "a07de618c005fbd5"),
    (129026, "fffc10272c01ffff"),
    (130306, "fff401c2d6faffff"),
)
"""Groups and what they hold, after canboat's layouts."""
N2K_FORMS: tuple[Callable[[int, int, bytes], str], ...] = (
    lambda s, g, d: f"2016-02-28T19:57:0{s}.364Z,2,{g},7,255,8,{d.hex(',')}",
    lambda s, g, d: f"({1456689420 + s}.249713) can0 {2 << 26 | g << 8 | 7:08X}#{d.hex().upper()}",
    lambda s, g, d: f"17:33:2{s}.107 R {2 << 26 | g << 8 | 7:08X} {d.hex(' ').upper()}",
    lambda s, g, d: f"A17332{s}.107 07FF2 {g:05X} {d.hex().upper()}",
)
N2K = [
    "\n".join(form(second, group, bytes.fromhex(data)) for second in range(6) for group, data in N2K_PAYLOADS).encode()
    for form in N2K_FORMS
]
N2K_JSON = [
    b"\n".join(
        b'{"timestamp":"2016-02-28T19:57:0%d.364Z","prio":2,"src":7,"dst":255,"pgn":%d,"fields":%b}' % (second, *each)
        for second in range(6)
        for each in (
            (127250, b'{"Heading":151.5,"Variation":3.1,"Reference":{"value":1,"name":"Magnetic"}}'),
            (127251, b'{"rate":0.125}'),
            (127245, b'{"Instance":0,"Direction Order":"Move to port","Angle Order":-5.5,"Position":-4.5}'),
            (128259, b'{"Speed Water Referenced":3.25}'),
            (129025, b'{"Latitude":57.69,"Longitude":11.84}'),
        )
    )
]


def _mission(text: str) -> None:
    for item in parse_items(text, "x.waypoints"):
        assert math.isfinite(item.waypoint.latitude) and math.isfinite(item.waypoint.longitude)


def _typed(text: str) -> None:
    """A line at the terminal of `run`, and at that of the helm; one may refuse what the other takes."""
    skipper = Skipper(0.6, PlotterGuide(), Mission(TrackGuide()))
    skipper.engage(0.0)
    try:
        request = request_of(text)
    except InputError:
        request = None
    if request is not None:
        asked_of(Station(), request)
    said = skipper.type_line(text)
    assert isinstance(said, str)
    order = skipper(0.0, None)
    assert math.isfinite(order.rudder) and (math.isfinite(order.heading) or order.kind is OrderKind.HEADING)


def _page_order(data: bytes) -> None:
    asked_of(Station(), order_object(data))(0.0, lambda taken, words: None)


def _signalk_order(data: bytes) -> None:
    try:
        request = parse(data, TOKEN).order
    except BadRequestError as error:
        assert answer(error.id, error.status, str(error)).count(b"\n") == 1
        raise
    if request is not None:
        asked_of(Station(), request)


class Display:
    """A helm display on its line to a boat, which has alarms; it wants to know its parameters."""

    def __init__(self) -> None:
        near, self.far = loopback_pair()
        self.station = Station()
        self.line = BoatLine("udpin:127.0.0.1:1", self.station, opens=lambda _: near)
        boat = MavlinkCodec(1, 1)
        kind = dialect.MAV_TYPE_SURFACE_BOAT, dialect.MAV_AUTOPILOT_GENERIC
        self.far.send(boat.encode(dialect.MAVLink_heartbeat_message(*kind, 129, 15, 4, 3)))
        self.far.send(boat.encode(dialect.MAVLink_named_value_float_message(1000, b"alarms", 1.0)))
        self.line.turn(0.0)
        self.station.parameters.read()

    def show(self, now: float) -> None:
        """Show what is known: in a terminal, on the page, in Signal K."""
        for size in ((80, 24), (30, 8)):
            assert all(len(line.text) <= size[0] for line in screen(self.station, now, size))
        assert Hub(self.station, self.line, lambda: now).first().endswith(b"\n\n")
        JSONResponse({"rows": list(self.station.view.history), **self.station.parameters.table()})
        deltas = Deltas().due(self.station, now)
        assert deltas is not None and line_of(deltas).count(b"\n") == 1


def _alarm_list(data: bytes) -> None:
    """A boat's list of alarms; a board that is given one that is none still shows what it knows."""
    display = Display()
    display.station.alarms._take(data)
    display.show(1.0)
    alarms_from(data)


def _metadata(data: bytes) -> None:
    """A boat's description of its parameters, packed or to be packed."""
    packed = data if data.startswith(b"\xfd7zXZ") else lzma.compress(data, preset=0)
    display = Display()
    display.station.parameters._describe(packed)
    display.show(1.0)
    descriptions_from(packed)


def _described() -> bytes:
    """Return the packed metadata of a few parameters of every kind."""
    table = [each for each in parameters_of(load_vessel("lanxin")) if each.name.startswith(("CTL_", "MDL_"))]
    return metadata_files(table, "0.2.0")[PARAMETERS]


def _said_by_a_boat() -> list[bytes]:
    """Return what a boat says to a helm display, a message of every kind that it listens to."""
    codec = MavlinkCodec(1, 1)
    named = (*NAMED, "lrn_state", "lrn_K", "lrn_T")
    list_read = HEADER.pack(1, 1, ACK, 0, OPEN, 0, 0), HEADER.pack(3, 1, ACK, 2, READ, 0, 0) + b"[]"
    return [
        b"".join(codec.encode(dialect.MAVLink_named_value_float_message(1000, name.encode(), 2.0)) for name in named),
        b"".join(
            codec.encode(dialect.MAVLink_file_transfer_protocol_message(0, 255, 190, list(part.ljust(251, b"\0"))))
            for part in list_read
        ),
        b"".join(
            codec.encode(dialect.MAVLink_param_value_message(name, 1.5, 9, count, 2))
            for count, name in enumerate((b"CTL_RATE", b"MDL_K"))
        ),
        b"".join(codec.encode(dialect.MAVLink_statustext_message(4, b"gear hot " * 5, 7, part)) for part in range(3)),
        *(
            codec.encode(message)
            for message in (
                dialect.MAVLink_heartbeat_message(11, 0, 129, 15, 5, 3),
                dialect.MAVLink_attitude_message(1000, 0.0, 0.0, 1.5, 0.0, 0.0, -0.02),
                dialect.MAVLink_vfr_hud_message(0.0, 3.0, 10, 0, 0.0, 0.0),
                dialect.MAVLink_nav_controller_output_message(0.0, 0.0, 10, 20, 300, 0.0, 0.0, 5.0),
                dialect.MAVLink_mission_current_message(2),
                dialect.MAVLink_command_ack_message(400, 0),
                dialect.MAVLink_command_ack_message(31010, 5, 20),
            )
        ),
    ]


def _boat(data: bytes) -> None:
    """What a boat says to a helm display that gives it orders, with the right checksums."""
    display = Display()
    for request in ({"do": "engage"}, {"do": "set", "name": "CTL_RATE", "value": 20}):
        asked_of(display.station, request)(0.0, lambda taken, words: None)
    now = 0.0
    for now, frame in enumerate(_sealed(data)):
        display.line.turn(float(now))
        display.far.send(frame)
        display.far.receive()
        display.line.turn(now + 0.5)
        display.station.view.keep_history(now + 0.5)
    display.show(now + 0.5)


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
        revision = 0

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
        commands = Commands(Skipper(0.6, PlotterGuide(), mission), True, mission)
        boat = BoatLink(near, commands, ParameterServer(Numbers()))
        for frame in _sealed(data):
            far.send(frame)
        boat.receive(0.1)
        boat.poll(0.1)
        boat.receive(2.0)
        boat.poll(2.0)
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


def mended(data: bytes) -> bytes:
    """Return lines with the right checksum behind every sentence, so that damage reaches its fields."""
    lines = []
    for line in data.splitlines():
        prefix, dollar, rest = line.partition(b"$")
        body = rest.partition(b"*")[0]
        lines.append(b"%b$%b*%02X\r\n" % (prefix, body, nmea_checksum(body)) if dollar else line + b"\r\n")
    return b"".join(lines)


def _sealed_log(data: bytes) -> bytes:
    """Return a .tlog with the right checksum on every packet, so that damage reaches its fields."""
    found, place = bytearray(data), data.find(b"\xfd")
    while 0 <= place <= len(found) - 12:
        kind = dialect.mavlink_map.get(int.from_bytes(found[place + 7 : place + 10], "little"))
        end = place + 10 + found[place + 1]
        if kind is not None and end + 2 <= len(found):
            found[end : end + 2] = checksum(bytes(found[place + 1 : end]), kind.crc_extra)
            place = end + 1
        place = found.find(b"\xfd", place + 1)
    return bytes(found)


def _own_log_in_file() -> Callable[[bytes], None]:
    """Return a target for logs of our own, which are read and replayed."""

    def use(path: str) -> None:
        _sound(read_recording(path))
        try:
            replay(Path(path))
        except RefusedError as error:
            raise InputError(str(error)) from error

    take = _in_file(use)
    return lambda data: take(_sealed_log(data))


def _own_header_in_file() -> Callable[[bytes], None]:
    """Return the same, of sound ticks behind a header of any text."""
    take = _own_log_in_file()
    return lambda data: take(_own_log(data[: MOST_PIECES * PIECE - 1]))


def _nmea_line(data: bytes) -> None:
    """A line as instruments send it, every sentence of it with the right checksum."""
    framer, reader = NmeaFramer(), NmeaReader(0.1)
    for line in data.splitlines():
        for sentence in framer.feed(mended(line if b"$" in line else b"$" + line)):
            for sample in (reader.read(1.0, sentence), *reader.take_others()):
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
    found = parse_foreign(data.decode("utf-8", "replace"), "x.params" if b"\t" in data else "x.param")
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
    """Times rise, every value is a number, and what there is to know of it can be shown, measured and identified."""
    assert_short(as_text(info_of(recording, SETTINGS)))
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # what no reader has refused must not trouble the arithmetic
        with contextlib.suppress(InputError):
            _measured(recording)
        with contextlib.suppress(InputError):
            _identified(run_from_columns(recording.source, table_of(recording, SETTINGS).columns))
    for series in recording.series:
        assert series.time.shape == series.values.shape
        assert bool(np.all(np.isfinite(series.time))), series.quantity
        assert bool(np.all(np.diff(series.time) >= 0.0)), series.quantity
        assert bool(np.all(np.isfinite(series.values))), series.quantity


def assert_short(text: str) -> None:
    """What is printed holds no number that has no end."""
    assert max(map(len, text.splitlines())) < LINE_MOST, text


def _measured(recording: Recording) -> None:
    measures = measures_of(record_of(recording.source, table_of(recording, SETTINGS).columns))
    assert_short(measures_text(recording.source, measures, 10.0, recording.notes))
    json.loads(measures_json(recording.source, measures, None, recording.notes), parse_constant=_no_constant)


def _identified(run: Run) -> None:
    """The cheapest method, as the command has it."""
    found = METHOD.identify([run], Question("nomoto"))
    predictions = [(run, "fit", found.predict(run))]
    tests = residual_tests([run], found.model)
    result = Result("nomoto", found, None, predictions, tests, None, rudder_rate_of([run]))
    assert_short(identified_text(result))
    json.loads(identified_json(result), parse_constant=_no_constant)


def _no_constant(word: str) -> None:
    raise AssertionError(f"{word} is no JSON")


def _shipped(folder: str, pattern: str) -> list[bytes]:
    return [path.read_bytes() for path in sorted((ROOT / folder).glob(pattern))]


def _recordings() -> dict[str, list[bytes]]:
    """Return short sound logs of every kind."""
    sys.path[:0] = [str(ROOT / "tests"), str(ROOT / "tests" / "logs")]
    from boat_recordings import dataflash, tlog, tlog_events, zigzag_boat
    from test_px4_and_nmea_logs import ulog

    boat = zigzag_boat()
    short = type(boat)(*(column[: round(SECONDS / (boat.time[1] - boat.time[0]))] for column in boat))
    rows = [
        f"{t:.2f},{math.degrees(h):.2f},{v:.2f}" for t, h, v in zip(short.time, short.heading, short.speed, strict=True)
    ]
    return {
        "csv": ["\n".join(["time_s,heading_deg,speed_m_s", *rows[::10]]).encode(), *_manoeuvres()],
        "tlog": [tlog(tlog_events(short))],
        "own": [_own_log()],
        "dataflash": [dataflash(short)],
        "ulog": [ulog(short)],
        "mcap": [_mcap()],
        "nmea": [_nmea(), *(_every_sentence(stamp) for stamp in STAMPS)],
    }


CSV_NUMBERS = (0, -1, 5e-324, 1e-300, 1e-100, 1e-9, 1e-3, 0.5, 1, 90, 359.999, 1e4, 1e9, 99999999999, -1e11, math.nan)
CSV_EDITS = [bytes([table, 0, 0, 0, 0]) for table in (0, 1)]


def _csv_numbers(tables: Sequence[bytes]) -> Callable[[bytes], None]:
    """Return a target that puts other numbers into sound tables, each of five bytes: what to do, column, row, number.

    Such tables are taken by the reader more often than those with other damage, and so reach what reads behind it.
    """

    def use(path: str) -> None:
        _sound(read_recording(path))
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            _identified(load_run(path))

    take = _in_file(use)

    def edited(data: bytes) -> None:
        header, *lines = tables[data[0] % len(tables) if data else 0].decode().splitlines()
        columns = np.array([[float(cell) for cell in line.split(",")] for line in lines]).T
        for place in range(1, len(data) - 4, 5):
            what, column, row = data[place] % 6, data[place + 1] % len(columns), data[place + 2] * len(lines) // 256
            number = CSV_NUMBERS[data[place + 3] % len(CSV_NUMBERS)]
            rows = slice(row, row + 1 + data[place + 4] * (len(lines) - row) // 256)
            if what == 0:
                columns[column, row] = number
            elif what == 1:
                columns[column, rows] = number
            elif what == 2:
                columns[column, rows] *= number
            elif what == 3:
                columns[column, rows] += number
            elif what == 4:
                columns[:, rows] = columns[:, rows][:, ::-1] if column else columns[:, rows.start : rows.start + 1]
            else:
                columns[0, row:] += number
        rows_ = [",".join(f"{cell!r}" for cell in row) for row in columns.T.tolist()]
        take("\n".join([header, *rows_]).encode())

    return edited


def _manoeuvres() -> list[bytes]:
    """Return tables with a zigzag, and with a turning circle and a pull-out, at 2 Hz."""
    from boat_recordings import every, zigzag_boat

    boat = zigzag_boat(50.0, straight=1.0)
    columns = [boat.time, np.degrees(boat.heading), np.degrees(boat.rudder), boat.speed]
    rows = [",".join(f"{column[i]:.3f}" for column in columns) for i in every(boat, 2.0)]
    zigzag = "\n".join(["time_s,heading_deg,rudder_deg,speed_m_s", *rows])
    rate, heading, turn = 0.0, 0.0, []
    for step in range(180):
        rudder = 30.0 if 10 <= step < 140 else 0.0
        turn.append(f"{0.5 * step},{heading:.3f},{rate:.3f},{rudder},3,57.{step:04d},11.{step:04d}")
        rate += 0.5 * (0.2 * rudder - rate) / 5.0
        heading += 0.5 * rate
    circle = "\n".join(["time_s,heading_deg,yaw_rate_deg_s,rudder_deg,speed_m_s,latitude_deg,longitude_deg", *turn])
    return [zigzag.encode(), circle.encode()]


def _own_log(header: bytes | None = None) -> bytes:
    """Return a short log of our own, with another text in the place of its header's."""
    from autopilot.runtime.build import build_pilot
    from autopilot.signals import HeadingSample, Order, OrderKind

    vessel = load_vessel("lanxin")
    pilot = build_pilot(vessel)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "own.tlog"
        recorder = Recorder(path, {"vessel": dump_vessel(vessel), "law": None}, 0.0)
        if header is not None:
            path.write_bytes(recorder._tunnel(0.0, bytes([LOG_HEADER]) + header))
        for step in range(40 if header is None else 4):
            now = 0.05 * step
            order = Order(OrderKind.HEADING, 0.3, serial=1)
            recorder.record(pilot.step(now, (HeadingSample(now, 0.1, 0.0),), order), [])
        recorder.close()
        return path.read_bytes()


def _mcap() -> bytes:
    """Return a short export."""
    times = np.arange(0.0, 20.0, 0.5)
    series = tuple(Series(name, "a", times, 0.1 * times) for name in (HEADING, RUDDER, SPEED))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "x.mcap"
        write_mcap(path, series_entries(Recording("x", "x", series, 1.78e9)), "x")
        return path.read_bytes()


def _nmea() -> bytes:
    from autopilot.links.nmea import sentences as encode

    lines = []
    for step in range(40):
        stamp = f"12:00:{step / 10:06.3f} ".encode()
        lines += [
            stamp + encode.encode_hdt(0.02 * step),
            stamp + encode.encode_rot(0.1),
            stamp + encode.encode_rsa(0.05),
        ]
    return b"".join(lines)


SENTENCES = (
    b"GPZDA,12000%d.00,01,06,2026,00,00",
    b"GPRMC,12000%d.00,A,5741.400,N,01150.400,E,5.8,114.6,010626,3.1,E,A",
    b"GPGGA,12000%d.00,5741.400,N,01150.400,E,1,12,0.9,3.0,M,36.0,M,,",
    b"GPGLL,5741.400,N,01150.400,E,12000%d.00,A,A",
    b"HCHDG,11%d.0,1.0,W,3.1,E",
    b"HCHDM,11%d.0,M",
    b"HEHDT,11%d.0,T",
    b"HETHS,11%d.0,A",
    b"TIROT,6%d.0,A",
    b"IIRSA,%d.5,A,,V",
    b"VWVHW,114.0,T,111.0,M,5.%d,N,10.0,K",
    b"GPVTG,114.6,T,111.5,M,5.%d,N,10.7,K,A",
    b"WIMWV,35.%d,R,12.0,N,A",
    b"IIRPM,S,1,120%d.0,10.0,A",
)
"""One of every kind that a log is read from; the digit is the second."""
STAMPS = (b"", b"178030800%d ", b"2026-06-01T12:00:0%dZ ", b"\\c:178030800%d000*00\\")


def _every_sentence(stamp: bytes) -> bytes:
    """Return three seconds of a line with every sentence, each behind its time stamp; '' has the UTC inside alone."""
    seconds = range(3)
    return mended(b"\n".join((stamp + b"$" + each).replace(b"%d", b"%d" % s) for s in seconds for each in SENTENCES))
