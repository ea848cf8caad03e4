"""All that Norrbin says on NMEA 2000 as canboatjs decodes it, without a warning; and what canboatjs encodes, heard.

It runs where NORRBIN_INTEROP and NORRBIN_SIGNALK are set (see `test_outside_readers.py`): a Signal K server brings the
package @canboat/canboatjs with it. Its decoder and encoder share nothing with ours.
"""

from __future__ import annotations

import dataclasses
import json
import math
import shutil
import subprocess
from typing import Any

import pytest
from outside_programs import SIGNALK, WANTED
from station_doubles import Ear, Skipper

from autopilot.angles import wrap
from autopilot.guidance.current import Place
from autopilot.guidance.plotter import PlotterHeading, PlotterInvalid, PlotterLeg, PlotterMessage
from autopilot.links.n2k.link import FORMS, Form, framed
from autopilot.links.n2k.node import Device
from autopilot.links.n2k.packets import EVERYBODY, Message
from autopilot.links.n2k.session import READ, N2kSession, N2kSettings
from autopilot.signals import (
    AcknowledgeSample,
    AlarmEvent,
    AlarmState,
    CourseSample,
    HeadingSample,
    Mode,
    NavState,
    Order,
    OrderKind,
    PositionSample,
    RateSample,
    Reference,
    RollSample,
    RudderCommand,
    RudderSample,
    Sample,
    SpeedSample,
    Tick,
    WindSample,
)
from autopilot.supervision.panel import sentence_of
from autopilot.vessel.file import load_vessel
from sitl.scenario import load_scenario
from sitl.wire_n2k import RATES_HZ, N2kNetwork
from sitl.world import World

PACKAGE = SIGNALK.parents[2] / "@canboat" / "canboatjs"
HAS_CANBOAT = WANTED and (PACKAGE / "package.json").is_file() and shutil.which("node") is not None
pytestmark = pytest.mark.skipif(not HAS_CANBOAT, reason="set NORRBIN_INTEROP=1 and NORRBIN_SIGNALK: see above")

PROGRAM = """
const canboat = require(process.argv[2])
const given = JSON.parse(require('fs').readFileSync(0))
const said = []
const parser = new canboat.FromPgn({ returnNulls: false, useCamel: true, checkForInvalidFields: true })
parser.on('warning', (pgn, text) => said.push('warning ' + pgn.pgn + ' ' + text))
parser.on('error', (pgn, text) => said.push('error ' + (pgn && pgn.pgn) + ' ' + text))
const decoded = given.lines.map(line => parser.parseString(line)).filter(each => each)
const encoded = given.messages.map(each => [].concat(canboat[each.form](each)))
console.log(JSON.stringify({ decoded, said, encoded }))
"""


def canboat(lines: list[str], messages: list[dict[str, Any]]) -> dict[str, Any]:
    """Return what canboatjs decodes of `lines`, what it says of them, and the lines of `messages`."""
    given = json.dumps({"lines": lines, "messages": messages}, default=str)
    program = ["node", "-e", PROGRAM, "", str(PACKAGE)]
    done = subprocess.run(program, input=given, capture_output=True, text=True, timeout=120, check=True)
    found: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return found


def session(orders: bool = True) -> tuple[N2kSession, Ear, Skipper]:
    guide, skipper = Ear(), Skipper()
    settings = N2kSettings(rudder_limit=math.radians(30.0), device=Device(0x12345, "0.9"), takes_orders=orders)
    made = N2kSession("bus", settings, True, guide, skipper)  # type: ignore[arg-type]
    made.poll(-0.6)
    made.poll(-0.3)
    return made, guide, skipper


TICK = Tick(
    number=0,
    now=1.0,
    samples=(),
    order=Order(OrderKind.HEADING, -0.5),
    state=NavState(1.0, 0.25, 0.0, 4.0, 0.0, 0.0, 0.1, True),
    reference=Reference(0.0),
    demand=0.2,
    command=RudderCommand(1.0, -0.2, True),
    mode=Mode.ENGAGED,
    alarms=(),
)
ASKED = (60928, 126464, 126993, 126996, 126998, 127233, 127237, 127245)


def all_that_is_said() -> list[Message]:
    """Return every kind of message that Norrbin sends."""
    made, _, skipper = session()
    said = made.due(0.0)
    ticks = [
        TICK,
        TICK._replace(mode=Mode.STANDBY),
        TICK._replace(mode=Mode.OVERRIDE),
        TICK._replace(order=Order(OrderKind.HEADING, 1.0, is_led=True)),
        TICK._replace(order=Order(OrderKind.RUDDER, rudder=0.1)),
        TICK._replace(order=Order(OrderKind.HEADING, math.nan), demand=0.9),
        TICK._replace(alarms=(AlarmEvent("off_course", "12 deg"),), alarm_states=(AlarmState.SOUNDING,)),
        TICK._replace(alarms=(AlarmEvent("off_course", "13 deg"),), alarm_states=(AlarmState.ACKNOWLEDGED,)),
        TICK,
    ]
    assert skipper.overboard is not None
    skipper.overboard.place = Place(1.0, -0.3)
    for number, tick in enumerate(ticks):
        made.on_tick(tick._replace(now=1.0 + number))
    for number, angle in enumerate((0.2, -0.3, 0.0)):
        made.send(10.0 + number, RudderCommand(10.0 + number, angle, True))
    said += made.release(13.0)
    made.poll(13.0)
    asked = [Message(59904, group.to_bytes(3, "little"), 35, 204) for group in (*ASKED, 130306)]
    asked += [Message(126208, bytes((3, *(127237).to_bytes(3, "little"), 255, 255, 0, 0, 1)), 35, 204)]
    asked += [Message(126208, bytes((1, *(127237).to_bytes(3, "little"), 0xF8, 1, 5, 0xFC)), 35, 204)]
    made.receive(14.0, asked)
    return said + made.due(14.0)


def as_lines(form: Form, messages: list[Message]) -> list[str]:
    """Return the messages as a gateway would show them: with time and direction."""
    lines = "".join(form.encode(each).decode() for each in messages).splitlines()
    return lines if lines[0].startswith("A") else [f"12:00:00.000 R {line}" for line in lines]


@pytest.fixture(scope="module")
def understood() -> list[dict[str, Any]]:
    found = canboat(as_lines(FORMS["n2k-ascii"](), all_that_is_said()), [])
    assert found["said"] == []
    decoded: list[dict[str, Any]] = found["decoded"]
    return decoded


def test_everything_that_is_sent_decodes_without_a_warning(understood: list[dict[str, Any]]) -> None:
    said = all_that_is_said()
    assert [each["pgn"] for each in understood] == [each.group for each in said]
    assert {each["pgn"] for each in understood} == {59392, 59904, 126208, 126983, 126985, *ASKED}
    assert {each["src"] for each in understood} == {204, 254}


def test_the_same_in_frames() -> None:
    said = all_that_is_said()
    found = canboat(as_lines(FORMS["ydwg"](), said), [])
    assert found["said"] == []
    assert [each["pgn"] for each in found["decoded"]] == [each.group for each in said]


def test_the_simulated_boat_s_network_decodes_without_a_warning_to_what_was_measured() -> None:
    scenario = dataclasses.replace(load_scenario("sea-state-5"), route=((0.0, 0.0), (500.0, 300.0)))
    world = World(load_vessel("lanxin"), scenario)
    network = N2kNetwork(world)
    lines = [line.decode().strip() for step in range(60) for line in network.transmit(0.1 * step)]
    found = canboat(lines, [])
    assert found["said"] == []
    fields = {each["pgn"]: each["fields"] for each in found["decoded"]}
    assert set(fields) == {60928, *RATES_HZ}
    truth = world.boat.state
    assert abs(wrap(fields[127250]["heading"] + fields[127250].get("variation", 0.0) - truth.heading)) < 0.1
    assert fields[128259]["speedWaterReferenced"] == pytest.approx(truth.speed, abs=0.6)
    assert (fields[129029]["method"], fields[130306]["reference"]) == ("GNSS fix", "Apparent")
    assert fields[129284]["bearingOriginToDestinationWaypoint"] == pytest.approx(math.atan2(300.0, 500.0), abs=1e-3)
    assert fields[129284]["calculationType"] == "Rhumbline"
    assert [each["wpName"] for each in fields[129285]["list"]] == ["WP0", "WP1"]
    latitude = fields[129284]["destinationLatitude"] - scenario.start.latitude_deg
    assert latitude * 111_195.0 == pytest.approx(500.0, abs=2.0)
    assert fields[129283]["xteMode"] == "Autonomous" and abs(fields[129283]["xte"]) < 60.0


def test_what_is_said_is_what_is_meant(understood: list[dict[str, Any]]) -> None:
    def of(group: int) -> list[dict[str, Any]]:
        return [each["fields"] for each in understood if each["pgn"] == group]

    claim = of(60928)[0]
    assert (claim["uniqueNumber"], claim["deviceFunction"]) == (0x12345, 150)
    assert claim["deviceClass"] == "Steering and Control surfaces" and claim["arbitraryAddressCapable"] == "Yes"
    product = of(126996)[0]
    assert (product["nmea2000Version"], product["modelId"], product["softwareVersionCode"]) == (2.1, "Norrbin", "0.9")
    assert product["loadEquivalency"] == 0
    assert of(126998)[0]["manufacturerInformation"] == "Norrbin, an open-source autopilot"
    assert (
        of(126993)[0]["dataTransmitOffset"] in (60, "00:01:00") and of(126993)[0]["controller1State"] == "Error Active"
    )
    sent, read = of(126464)
    assert {each["pgn"] for each in sent["list"]} == {59392, 59904, 126208, 126983, 126985, *ASKED}
    assert {each["pgn"] for each in read["list"]} == READ
    assert of(59392) == [{"control": "NAK", "pgn": 130306}]
    control = of(127237)
    modes = [each["steeringMode"] for each in control[:6]]
    assert modes == [
        "Heading Control",
        "Main Steering",
        "Main Steering",
        "Track Control",
        "Follow-Up Device",
        "Follow-Up Device",
    ]
    first = control[0]
    assert first["headingToSteerCourse"] == pytest.approx(math.tau - 0.5, abs=1e-4)
    assert first["commandedRudderAngle"] == pytest.approx(-0.2, abs=1e-4)
    assert (first["commandedRudderDirection"], first["headingReference"]) == ("Move to port", "True")
    assert (first["vesselHeading"], first["rudderLimit"]) == (0.25, pytest.approx(math.radians(30.0), abs=1e-4))
    assert [each["override"] for each in control[:6]] == ["No", "No", "Yes", "No", "No", "No"]
    assert control[5]["rudderLimitExceeded"] == "Yes" and "headingToSteerCourse" not in control[1]
    alerts = [(each["alertType"], each["alertState"], each["acknowledgeStatus"]) for each in of(126983)]
    assert alerts == [("Warning", "Active", "No"), ("Warning", "Acknowledged", "Yes"), ("Warning", "Normal", "No")]
    overboard = of(127233)
    assert overboard == [overboard[0]] * 3, "at once, five seconds later, and when asked"
    assert (overboard[0]["mobEmitterId"], overboard[0]["positionSource"]) == (
        0x12345,
        "Position estimated by the vessel",
    )
    assert overboard[0]["manOverboardStatus"] == "Manual on-board MOB Button Activation"
    place = math.radians(overboard[0]["latitude"]), math.radians(overboard[0]["longitude"])
    assert place == pytest.approx((1.0, -0.3), abs=2e-9)
    (words,) = of(126985)
    assert words["alertId"] == of(126983)[0]["alertId"] and words["languageId"] == "English (UK)"
    assert words["alertTextDescription"] == sentence_of(AlarmEvent("off_course", "12 deg"))
    rudder = [(each["directionOrder"], each.get("angleOrder")) for each in of(127245)]
    assert rudder[:3] == [("Move to starboard", 0.2), ("Move to port", -0.3), ("Move to starboard", 0)]
    assert rudder[3:8] == [("No Order", None)] * 5
    refused, commanded = of(126208)
    assert (refused["functionCode"], refused["pgnErrorCode"]) == ("Acknowledge", "Read or Write not supported")
    assert (commanded["pgnErrorCode"], commanded["list"]) == ("Acknowledge", [{"parameter": "Acknowledge"}])


HEARD: list[tuple[int, dict[str, Any], list[Sample]]] = [
    (127250, {"heading": 1.0, "reference": "True"}, [HeadingSample(0.0, 1.0)]),
    (
        127250,
        {"heading": 1.0, "deviation": -0.02, "variation": 0.05, "reference": "Magnetic"},
        [HeadingSample(0.0, 1.03)],
    ),
    (127251, {"rate": -0.05}, [RateSample(0.0, -0.05)]),
    (127245, {"instance": 0, "position": -0.15}, [RudderSample(0.0, -0.15)]),
    (127257, {"yaw": 1.0, "pitch": 0.1, "roll": -0.25}, [RollSample(0.0, -0.25)]),
    (128259, {"speedWaterReferenced": 3.25}, [SpeedSample(0.0, 3.25)]),
    (
        129025,
        {"latitude": 57.69, "longitude": -11.84},
        [PositionSample(0.0, math.radians(57.69), math.radians(-11.84))],
    ),
    (
        129026,
        {"cogReference": "True", "cog": 6.0, "sog": 2.5},
        [SpeedSample(0.0, 2.5, True), CourseSample(0.0, 6.0 - math.tau)],
    ),
    (
        129029,
        {"latitude": 57.69, "longitude": -11.84, "method": "GNSS fix"},
        [PositionSample(0.0, math.radians(57.69), math.radians(-11.84))],
    ),
    (130306, {"windSpeed": 5.0, "windAngle": 5.5, "reference": "Apparent"}, [WindSample(0.0, 5.5 - math.tau, 5.0)]),
]
NAVIGATION = {
    "distanceToWaypoint": 1000.0,
    "courseBearingReference": "True",
    "perpendicularCrossed": "No",
    "arrivalCircleEntered": "No",
    "calculationType": "Rhumbline",
    "bearingOriginToDestinationWaypoint": 1.0,
    "bearingPositionToDestinationWaypoint": 0.98,
    "originWaypointNumber": 3,
    "destinationWaypointNumber": 4,
    "destinationLatitude": 57.7,
    "destinationLongitude": 11.9,
    "waypointClosingVelocity": 2.5,
}
LED: list[tuple[int, dict[str, Any], type[PlotterMessage] | None]] = [
    (
        129285,
        {
            "startRps": 0,
            "nitems": 2,
            "databaseId": 1,
            "routeId": 1,
            "routeName": "Home",
            "list": [
                {"wpId": 3, "wpName": "Buoy", "wpLatitude": 57.6, "wpLongitude": 11.8},
                {"wpId": 4, "wpName": "Harbour", "wpLatitude": 57.7, "wpLongitude": 11.9},
            ],
        },
        None,
    ),
    (129284, NAVIGATION, PlotterLeg),
    (129283, {"xteMode": "Autonomous", "navigationTerminated": "No", "xte": 21.5}, None),
    (129284, NAVIGATION, PlotterLeg),
    (129283, {"xteMode": "Autonomous", "navigationTerminated": "Yes"}, PlotterInvalid),
    (
        127237,
        {"steeringMode": "Heading Control", "headingReference": "True", "headingToSteerCourse": 2.0},
        PlotterHeading,
    ),
]


def encoded(messages: list[tuple[int, dict[str, Any]]], destination: int = EVERYBODY) -> list[str]:
    """Return the lines of a gateway for messages that canboatjs encodes."""
    given = [
        {"form": "pgnToYdgwFullRawFormat", "pgn": pgn, "prio": 2, "src": 35, "dst": destination, "fields": fields}
        for pgn, fields in messages
    ]
    return ["\r\n".join(lines) + "\r\n" for lines in canboat([], given)["encoded"]]


def test_every_measurement_that_canboat_encodes_is_heard_as_it_was() -> None:
    form = FORMS["ydwg"]()
    for (group, fields, expected), lines in zip(HEARD, encoded([each[:2] for each in HEARD]), strict=True):
        north = ":M" if group == 127250 and fields["reference"] == "Magnetic" else ""
        made, _, _ = session()
        made.receive(0.0, [])
        found = made.receive(0.0, form.feed(0.0, lines.encode()))
        assert [type(each) for each in found] == [type(each) for each in expected], group
        for one, other in zip(found, expected, strict=True):
            assert one[1:-1] == pytest.approx(other[1:-1], abs=2e-4)
            assert one.source == f"N2K{group}.35{north}"
    assert form.damaged == 0


def test_a_route_that_canboat_encodes_leads() -> None:
    form, (made, guide, _) = FORMS["ydwg"](), session()
    for now, ((group, _, kind), lines) in enumerate(zip(LED, encoded([each[:2] for each in LED]), strict=True)):
        before = len(guide.heard)
        made.receive(float(now), form.feed(float(now), lines.encode()))
        assert [type(each) for each in guide.heard[before:]] == ([] if kind is None else [kind]), group
    leg, nearer, _, heading = guide.heard
    assert isinstance(leg, PlotterLeg) and isinstance(nearer, PlotterLeg) and isinstance(heading, PlotterHeading)
    assert (leg.track, leg.name) == (pytest.approx(1.0), "Harbour")
    assert leg.cross_track == pytest.approx(1000.0 * math.sin(0.02), abs=0.2)
    assert (nearer.track, nearer.cross_track) == (pytest.approx(1.0), pytest.approx(21.5))
    assert heading.heading == pytest.approx(2.0)


def test_what_canboat_asks_of_us_is_answered_and_commands_are_carried_out() -> None:
    form, (made, _, skipper) = FORMS["ydwg"](), session()
    control = {"functionCode": "Command", "pgn": 127237, "priority": "Leave unchanged"}
    asked: list[tuple[int, dict[str, Any]]] = [
        (59904, {"pgn": 126996}),
        (59904, {"pgn": 60928}),
        (126208, {**control, "numberOfParameters": 1, "list": [{"parameter": 5, "value": 0}]}),
        (
            126208,
            {
                **control,
                "numberOfParameters": 3,
                "list": [
                    {"parameter": 5, "value": "Heading Control"},
                    {"parameter": 7, "value": "True"},
                    {"parameter": 11, "value": 1.5},
                ],
            },
        ),
        (126208, {**control, "pgn": 130306, "numberOfParameters": 2, "list": [{"parameter": 2, "value": 1.0}] * 2}),
    ]
    made.on_tick(TICK._replace(mode=Mode.STANDBY))
    made.due(2.0)
    for lines in encoded(asked, 204):
        made.receive(2.0, form.feed(2.0, lines.encode()))
    said = made.due(2.0)
    assert [each.group for each in said] == [126996, 60928, 126208, 126208, 126208]
    assert skipper.orders == [("stand by", None), ("engage", pytest.approx(1.5))]
    answers = [(each.data[4] & 15, each.data[5]) for each in said[2:]]
    assert answers == [(0, 1), (0, 3), (1, 2)], "done, done, group not supported"


def test_packets_that_canboat_makes_for_the_ngt_1_are_read_alike() -> None:
    """canboatjs packs what is sent (94); the gateway's own kind (93) has time and source besides, put in here."""
    form = FORMS["actisense"]()
    for group, fields, expected in HEARD:
        given = [{"form": "toPgn", "pgn": group, "fields": fields}]
        (whole,) = canboat([], given)["encoded"]
        data = bytes(whole[0]["data"] if isinstance(whole[0], dict) else whole)
        head = bytes((2, *group.to_bytes(3, "little"), 255, 35, 1, 2, 3, 16, len(data)))
        made, _, _ = session()
        found = made.receive(0.0, form.feed(0.0, framed(0x93, head + data)))
        assert [type(each) for each in found if not hasattr(each, "available")] == [type(each) for each in expected]


def test_a_display_s_acknowledgement_that_canboat_encodes_silences_the_alarm() -> None:
    form, (made, _, _) = FORMS["ydwg"](), session()
    made.on_tick(TICK._replace(alarms=(AlarmEvent("off_course"),), alarm_states=(AlarmState.SOUNDING,)))
    (alert,) = [each.data for each in made.due(1.0) if each.group == 126983]
    answer = {
        "alertType": "Warning",
        "alertCategory": "Navigational",
        "alertSystem": 0,
        "alertSubSystem": 0,
        "alertId": int.from_bytes(alert[3:5], "little"),
        "dataSourceNetworkIdName": int.from_bytes(alert[5:13], "little"),
        "dataSourceInstance": 0,
        "dataSourceIndexSource": 0,
        "alertOccurrenceNumber": 1,
        "acknowledgeSourceNetworkIdName": 12345,
        "responseCommand": "Acknowledge",
    }
    heard = [
        made.receive(2.0, form.feed(2.0, lines.encode()))
        for lines in encoded([(126984, {**answer, "dataSourceNetworkIdName": name}) for name in NAMES])
    ]
    said = [[each for each in samples if isinstance(each, AcknowledgeSample)] for samples in heard]
    assert made.node is not None
    assert [bool(each) for each in said] == [int(name) == made.node.name for name in NAMES]
    assert said[0] == [AcknowledgeSample(2.0, "off_course", "N2K126984.35")]


NAMES = (str(1 << 63 | 4 << 60 | 40 << 49 | 150 << 40 | 2046 << 21 | 0x12345), "7")
