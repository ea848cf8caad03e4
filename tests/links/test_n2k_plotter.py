"""A chart plotter on NMEA 2000: its legs, what it says of itself, waypoints passed without a swing the wrong way."""

from __future__ import annotations

import math
from itertools import permutations

import pytest
from station_doubles import Ear

from autopilot.angles import shortest_turn
from autopilot.guidance.plotter import PlotterGuide, PlotterHeading, PlotterInvalid, PlotterLeg, PlotterMessage
from autopilot.links.n2k.packets import Message, encoded, text
from autopilot.links.n2k.samples import PlotterReader, waypoint_names
from autopilot.links.n2k.session import N2kSession, N2kSettings
from autopilot.links.north import NeedsVariationError, known_as


def navigation(track: float | None, bearing: float | None, distance: float, **more: object) -> Message:
    fields: dict[str, object] = {
        "distanceToWaypoint": distance,
        "courseBearingReference": "True",
        "destinationWaypointNumber": 1,
        **more,
    }
    if track is not None:
        fields["bearingOriginToDestinationWaypoint"] = track % math.tau
    if bearing is not None:
        fields["bearingPositionToDestinationWaypoint"] = bearing % math.tau
    return Message(129284, encoded(129284, fields), 3)


def error(xte: float | None, **more: object) -> Message:
    known = {} if xte is None else {"xte": xte}
    return Message(129283, encoded(129283, {"xteMode": "Autonomous", "navigationTerminated": "No", **known, **more}), 3)


def control(**fields: object) -> Message:
    return Message(127237, encoded(127237, fields), 3)


def reader(variation: float | None = None, magnetic: bool = False) -> PlotterReader:
    return PlotterReader(known_as(variation), magnetic)


def leg_of(message: PlotterMessage | None) -> PlotterLeg:
    assert isinstance(message, PlotterLeg)
    return message


def test_a_leg_has_its_error_by_the_two_bearings() -> None:
    """1000 m off, the waypoint 0.02 rad to port of the leg's bearing: the boat is 20 m to starboard."""
    leg = leg_of(reader().take(5.0, navigation(1.0, 0.98, 1000.0)))
    assert leg[:3] == (5.0, pytest.approx(1.0), pytest.approx(20.0, abs=0.2))
    assert leg.step == pytest.approx(0.11)
    assert leg_of(reader().take(5.0, navigation(1.0, 1.02, 1000.0))).cross_track == pytest.approx(-20.0, abs=0.2)


def test_the_better_error_is_used_when_the_leg_is_named_again() -> None:
    made = reader()
    assert leg_of(made.take(0.0, navigation(1.0, 0.98, 1000.0))).cross_track == pytest.approx(20.0, abs=0.2)
    assert made.take(0.5, error(21.37)) is None
    leg = leg_of(made.take(1.0, navigation(1.0, 0.98, 1000.0)))
    assert (leg.cross_track, leg.step) == (pytest.approx(21.37), 0.01)
    assert leg_of(made.take(2.0, navigation(1.0, 0.98, 1000.0))).cross_track == pytest.approx(21.37)
    assert leg_of(made.take(9.0, navigation(1.0, 0.98, 1000.0))).cross_track == pytest.approx(20.0, abs=0.2), "old"


def test_on_a_long_great_circle_the_error_of_its_own_message_counts() -> None:
    """In the middle of a long leg the bearings differ by the meridians' convergence: 2 deg at 50 km are 1.7 km."""
    made, now = reader(), 0.0
    legs = []
    while now < 10.0:
        legs.append(leg_of(made.take(now, navigation(1.0, 0.965, 50000.0))))
        made.take(now + 0.1, error(12.0))
        now += 1.0
    assert [abs(each.cross_track - 12.0) < 0.1 for each in legs[5:]] == [True] * 5
    joined = reader()
    joined.take(0.0, error(12.0))
    assert leg_of(joined.take(0.5, navigation(1.0, 0.965, 50000.0))).cross_track == pytest.approx(12.0)


@pytest.mark.parametrize(
    ("message", "reason"),
    [
        (navigation(None, None, 100.0), "129284 holds no valid data"),
        (navigation(1.0, 1.0, 100.0, courseBearingReference="Error"), "129284 holds no valid data"),
        (error(None, navigationTerminated="Yes"), "its navigation has ended"),
        (error(1.0, xteMode="Simulator"), "its position is simulator"),
        (error(1.0, xteMode="Estimated"), "its position is estimated"),
        (control(steeringMode="Main Steering"), "its steering mode is manual or rudder control"),
        (control(steeringMode="Follow-Up Device"), "its steering mode is manual or rudder control"),
    ],
)
def test_a_plotter_that_does_not_lead_says_why(message: Message, reason: str) -> None:
    assert reader().take(1.0, message) == PlotterInvalid(1.0, reason)


def test_without_the_leg_s_own_bearing_the_way_leads_straight_to_the_waypoint() -> None:
    leg = leg_of(reader().take(0.0, navigation(None, 0.98, 1000.0)))
    assert (leg.track, leg.cross_track) == (pytest.approx(0.98), 0.0)


def test_a_heading_to_steer_leads_where_no_leg_is_named() -> None:
    made = reader()
    order = control(steeringMode="Heading Control", headingReference="True", headingToSteerCourse=2.0)
    assert made.take(0.0, order) == PlotterHeading(0.0, pytest.approx(2.0))
    assert made.take(0.0, control(steeringMode="Heading Control")) is None
    assert made.take(0.0, control(headingReference="True", headingToSteerCourse=2.0)) is None
    ear = Ear()
    session = N2kSession("bus", guide=ear)
    session.receive(1.0, [navigation(1.0, 1.0, 500.0)])
    session.receive(2.0, [order, order._replace(source=9)])
    assert len(ear.heard) == 1, "neither its own nor another's"
    session.receive(10.0, [order])
    assert ear.heard[1:] == [PlotterHeading(10.0, pytest.approx(2.0), "bus, address 3")]


def test_magnetic_bearings_take_the_variation_or_that_is_said() -> None:
    magnetic = navigation(1.0, 0.98, 1000.0, courseBearingReference="Magnetic")
    with pytest.raises(NeedsVariationError):
        reader().take(0.0, magnetic)
    assert leg_of(reader(0.1).take(0.0, magnetic)).track == pytest.approx(1.1)
    assert leg_of(reader(0.1, True).take(0.0, magnetic)).track == pytest.approx(1.0)
    assert leg_of(reader(0.1, True).take(0.0, navigation(1.0, 1.0, 100.0))).track == pytest.approx(0.9)
    guide = PlotterGuide()
    guide.follow()
    session = N2kSession("bus", guide=guide)
    for second in range(12):
        session.receive(float(second), [magnetic, error(20.0)])
        guide.course(float(second), 0.5, 5.0)
    assert guide.alarm is not None and "set sensors.variation_deg" in guide.alarm.detail
    for second in range(12, 40):
        session.receive(float(second), [error(20.0)])
        guide.course(float(second), 0.5, 5.0)
    assert guide.alarm is not None and "129283 alone names no leg" in guide.alarm.detail


def two_devices(first: Message, second: Message) -> PlotterGuide:
    """Return the guide after 12 s on a heading of 0.5, the second device half a second behind the first."""
    guide = PlotterGuide()
    guide.follow()
    session = N2kSession("bus", guide=guide)
    for second_ in range(12):
        session.receive(float(second_), [first])
        session.receive(second_ + 0.5, [second._replace(source=9)])
        guide.course(second_ + 0.5, 0.5, 5.0)
    return guide


@pytest.mark.parametrize("idle", [navigation(None, None, 0.0), error(None, navigationTerminated="Yes")])
@pytest.mark.parametrize("is_first", [True, False])
def test_a_display_without_a_route_keeps_no_plotter_from_leading(idle: Message, is_first: bool) -> None:
    leg = navigation(1.0, 1.0, 5000.0)
    guide = two_devices(idle, leg) if is_first else two_devices(leg, idle)
    assert (guide.course(12.0, 0.5, 5.0), guide.alarm) == (pytest.approx(1.0), None)


def test_of_two_plotters_that_lead_different_ways_from_the_first_none_leads() -> None:
    guide = two_devices(navigation(1.0, 1.0, 5000.0), navigation(2.0, 2.0, 5000.0))
    assert guide.course(12.0, 0.5, 5.0) == 0.5
    assert guide.alarm is not None and "two plotters lead different ways" in guide.alarm.detail
    assert two_devices(navigation(1.0, 1.0, 5000.0), navigation(1.01, 1.01, 5000.0)).alarm is None


def test_waypoints_are_called_by_their_names() -> None:
    places = [struct_waypoint(1, "Buoy"), struct_waypoint(2, "Hålö"), struct_waypoint(3, "")]
    data = bytes(9) + text("Home") + b"\xff" + b"".join(places)
    assert waypoint_names(data) == {1: "Buoy", 2: "Hålö"}
    made = reader()
    made.take(0.0, Message(129285, data, 3))
    leg = leg_of(made.take(0.1, navigation(1.0, 1.0, 100.0, destinationWaypointNumber=2)))
    assert (leg.name, leg.waypoint) == ("Hålö", "2.0@,")
    for size in range(len(data)):
        waypoint_names(data[:size])


def struct_waypoint(number: int, name: str) -> bytes:
    letters = name.encode("utf-16-le") if not name.isascii() else name.encode()
    return number.to_bytes(2, "little") + bytes((len(letters) + 2, int(name.isascii()))) + letters + bytes(8)


TURN = 1.2


def batch(north: float, east: float, leg: int) -> tuple[Message, Message]:
    """Return 129284 and 129283 of a boat that is there; leg 0 leads north to the waypoint, leg 1 on by TURN."""
    track, start = (0.0, (-500.0, 0.0)) if leg == 0 else (TURN, (0.0, 0.0))
    end = start[0] + 500.0 * math.cos(track), start[1] + 500.0 * math.sin(track)
    to = end[0] - north, end[1] - east
    xte = (east - start[1]) * math.cos(track) - (north - start[0]) * math.sin(track)
    said = {"destinationWaypointNumber": leg + 1, "destinationLatitude": 1.0 + leg, "destinationLongitude": 0.2}
    return navigation(track, math.atan2(to[1], to[0]), math.hypot(*to), **said), error(xte)


@pytest.mark.parametrize("lag", [0, 1])
@pytest.mark.parametrize("order", list(permutations((0, 1))))
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_at_a_waypoint_the_course_never_goes_the_wrong_way(lag: int, order: tuple[int, int], side: float) -> None:
    """Whichever of the two messages comes first, and if the error is one message late: the next leg is to starboard (or
    to port, mirrored), and from leg to leg the course goes there and nowhere else."""
    session, guide = N2kSession("bus", N2kSettings(), guide=(plotter := PlotterGuide())), plotter
    guide.follow()
    courses = []
    errors: list[Message] = []
    north, east, heading, leg = -80.0, 2.0, 0.0, 0
    for step in range(400):
        now = 0.1 * step
        leg = max(leg, int(north > -20.0))
        if step % 10 == 0:
            said, xte = batch(north, east, leg)
            errors.append(xte)
            late = errors[-1 - lag] if len(errors) > lag else errors[0]
            pair = [mirrored(each, side) for each in (said, late)]
            for number, which in enumerate(order):
                session.receive(now + 0.03 * number, [pair[which]])
        courses.append(side * guide.course(now + 0.05, side * heading, 3.0))
        turn = shortest_turn(heading, courses[-1])
        heading += min(max(turn, -0.03), 0.03)
        north, east = north + 0.3 * math.cos(heading), east + 0.3 * math.sin(heading)
    settled = courses[40:]
    assert min(settled) > -0.2, "nothing to the other side"
    assert max(settled) < TURN + 0.3
    assert settled[-1] == pytest.approx(TURN, abs=0.1), "the next leg is taken"


def mirrored(message: Message, side: float) -> Message:
    from autopilot.links.n2k.packets import decoded

    if side > 0.0:
        return message
    fields = dict(decoded(message.group, message.data))
    for name in ("bearingOriginToDestinationWaypoint", "bearingPositionToDestinationWaypoint"):
        if name in fields:
            fields[name] = -float(str(fields[name])) % math.tau
    if "xte" in fields:
        fields["xte"] = -float(str(fields["xte"]))
    return Message(message.group, encoded(message.group, fields), message.source)


def test_another_pilot_s_heading_control_leads_nobody() -> None:
    """Its claim says that it is an autopilot: its 127237 is what it does itself."""
    session, guide = N2kSession("bus", N2kSettings(), guide=(plotter := PlotterGuide())), plotter
    guide.follow()
    session.poll(-0.6)
    session.poll(-0.3)
    order = control(steeringMode="Heading Control", headingReference="True", headingToSteerCourse=2.0)
    pilot = 1 << 63 | 4 << 60 | 40 << 49 | 150 << 40 | 1857 << 21 | 7
    session.receive(0.1, [Message(60928, pilot.to_bytes(8, "little"), 3)])
    session.receive(0.2, [order, order])
    assert guide.course(0.3, 0.5, 3.0) == 0.5
    session.receive(0.4, [order._replace(source=4)] * 2)
    assert guide.course(0.5, 0.5, 3.0) == pytest.approx(2.0)
