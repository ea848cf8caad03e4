"""What APB, RMB, XTE, HTC and HTD mean, from sentences built here by hand, and when they must not lead."""

from __future__ import annotations

import math

import pytest
from station_doubles import Ear

from autopilot.angles import shortest_turn
from autopilot.guidance.plotter import PlotterGuide, PlotterHeading, PlotterInvalid, PlotterLeg, PlotterMessage
from autopilot.links.nmea.link import NmeaSession, NmeaSettings
from autopilot.links.nmea.samples import NmeaReader
from autopilot.links.nmea.sentences import NmeaFramer, format_sentence
from autopilot.signals import SpeedSample


def hear(*bodies: str, variation: float | None = None) -> tuple[list[PlotterMessage], NmeaReader]:
    ear = Ear()
    reader = NmeaReader(variation, guide=ear)
    framer = NmeaFramer()
    for time, body in enumerate(bodies):
        address, *fields = body.split(",")
        for sentence in framer.feed(format_sentence(address[:2], address[2:], fields)):
            sample = reader.read(float(time), sentence)
            assert sample is None or isinstance(sample, SpeedSample)
    return ear.heard, reader


APB = "GPAPB,A,A,0.10,R,N,V,V,011,M,DEST,011,M,011,M"
"""The layout of the sentence in "NMEA Revealed": 0.10 nm to steer right, bearing 11 magnetic, no mode field."""


def test_apb_gives_track_cross_track_error_and_waypoint() -> None:
    (leg,), _ = hear(APB, variation=math.radians(-3.0))
    assert isinstance(leg, PlotterLeg)
    assert math.degrees(leg.track) == pytest.approx(8.0)
    assert leg.cross_track == pytest.approx(-185.2), "steer right: the boat is to port of the track"
    assert leg.step == pytest.approx(18.52)
    assert leg.waypoint == "DEST"


OPENCPN = (
    "ECRMB,A,0.050,L,001,002,5742.000,N,01152.000,E,1.234,045.000,5.000,V",
    "ECRMC,120000,A,5741.000,N,01150.000,E,5.000,045.000,211126,4.000,E",
    "ECAPB,A,A,0.050,L,N,V,V,045.000,T,002,045.000,T,045.000,T",
    "ECXTE,A,A,0.054,L,N",
)
"""What OpenCPN sends of an active route, in its order and with its talker (model/src/autopilot_output.cpp)."""


def test_opencpns_route_leads() -> None:
    heard, _ = hear(*OPENCPN)
    legs = [message for message in heard if isinstance(message, PlotterLeg)]
    assert len(legs) == len(heard) == 3
    assert [leg.cross_track for leg in legs] == pytest.approx([92.6, 92.6, 100.008]), "steer left: to starboard of it"
    assert math.degrees(legs[1].track) == math.degrees(legs[2].track) == pytest.approx(45.0)
    assert legs[1].waypoint == "002"


def test_a_magnetic_bearing_waits_for_a_variation() -> None:
    heard, reader = hear(APB)
    assert (heard, reader.waiting_for_variation) == ([], 1)
    heard, _ = hear("GPRMC,0,A,,,,,5.0,90,010126,4.0,E", APB)
    assert isinstance(heard[0], PlotterLeg)
    assert math.degrees(heard[0].track) == pytest.approx(15.0)


@pytest.mark.parametrize(
    "body",
    [
        "GPAPB,V,A,0.1,R,N,V,V,011,T,D,011,T,011,T,A",
        "GPAPB,A,V,0.1,R,N,V,V,011,T,D,011,T,011,T,A",
        "GPAPB,A,A,0.1,R,N,V,V,011,T,D,011,T,011,T,N",
        "GPAPB,A,A,0.1,R,N,V,V,011,T,D,011,T,011,T,S",
        "GPAPB,A,A,0.1,R,N,V,V,011,T,D,011,T,011,T,E",
        "GPAPB,A,A,,R,N,V,V,011,T,D,011,T,011,T,A",
        "GPXTE,V,A,0.1,L,N",
        "GPRMB,V,0.1,L,A,B,,,,,5.0,011,,V",
        "IIHTC,A,,,H,N,,,,,045.0,,,T",
        "IIHTD,V,,,M,N,,,,,045.0,,,T,A,A,A,040",
        "IIHTD,V,,,R,N,,,,,045.0,,,T,A,A,A,040",
    ],
)
def test_status_mode_and_override_say_that_it_does_not_lead(body: str) -> None:
    heard, reader = hear(body)
    assert [type(message) for message in heard] == [PlotterInvalid]
    assert reader.invalid == 1


@pytest.mark.parametrize(
    "body",
    [
        "GPAPB,A,A,0.1,X,N,V,V,011,T,D,011,T,011,T,A",
        "GPAPB,A,A,0.1,R,Q,V,V,011,T,D,011,T,011,T,A",
        "GPAPB,A,A,0.1,R,N,V,V,411,T,D,011,T,011,T,A",
        "GPAPB,A,A,0.1,R,N,V,V,011,Z,D,011,T,011,T,A",
        "GPAPB,A,A,-0.1,R,N,V,V,011,T,D,011,T,011,T,A",
        "GPAPB,A,A,nan,R,N,V,V,011,T,D,011,T,011,T,A",
        "GPAPB,A,A,0.1,R,N,V,V,011,T,D,011,T,011,T,Q",
        "GPAPB,A,A,900.0,R,N,V,V,011,T,D,011,T,011,T,A",
        "GPAPB",
        "IIHTD,V,,,X,N,,,,,045.0,,,T,A,A,A,040",
        "IIHTD,X,,,H,N,,,,,045.0,,,T,A,A,A,040",
    ],
)
def test_plotter_sentences_with_impossible_values_are_counted_malformed(body: str) -> None:
    heard, reader = hear(body)
    assert (heard, reader.malformed) == ([], 1)


def test_xte_renews_the_error_of_the_leg_and_a_jump_waits_for_apb() -> None:
    apb = "GPAPB,A,A,0.100,R,N,V,V,090.0,T,D,011,T,011,T,A"
    heard, _ = hear(apb, "GPXTE,A,A,0.096,R,N,A", "GPXTE,A,A,0.300,L,N,A")
    assert [round(leg.cross_track, 1) for leg in heard if isinstance(leg, PlotterLeg)] == [-185.2, -177.8]
    assert hear("GPXTE,A,A,0.1,R,N,A")[0] == [], "an error without a track leads nowhere"


def test_rmb_alone_gives_the_track_by_its_geometry() -> None:
    """Boat at (-1852 N, 100 E) of a leg that runs north to the origin: 100 m to starboard."""
    away, bearing = math.hypot(1852.0, 100.0), math.degrees(math.atan2(-100.0, 1852.0)) % 360.0
    rmb = f"GPRMB,A,{100 / 1852:.4f},L,A,B,,,,,{away / 1852:.4f},{bearing:.2f},,V,A"
    (leg,), _ = hear(rmb)
    assert isinstance(leg, PlotterLeg)
    assert math.degrees(leg.track) == pytest.approx(0.0, abs=0.02)
    assert leg.cross_track == pytest.approx(100.0, abs=0.2)
    assert leg.waypoint == "B"
    assert len(hear(APB.replace(",M", ",T"), rmb)[0]) == 1, "APB goes before: the two switch at different moments"
    assert hear("GPRMB,A,0.10,L,A,B,,,,,0.05,011,,V,A")[0] == [], "at the waypoint the geometry says nothing"


def test_htc_and_htd_are_headings_to_steer() -> None:
    heard, _ = hear("IIHTC,V,,,H,N,,,,,350.0,,,M", "IIHTD,V,,,T,N,,,,,,,120.0,T,A,A,A,040", variation=0.1)
    assert isinstance(heard[0], PlotterHeading)
    assert heard[0].heading == pytest.approx(math.radians(-10.0) + 0.1)
    assert isinstance(heard[1], PlotterHeading)
    assert heard[1].heading == pytest.approx(math.radians(120.0)), "the track is the field behind the off-track limit"


def test_without_a_guide_a_plotter_is_ignored_and_so_are_our_own_words() -> None:
    reader = NmeaReader()
    for body in (APB, "AGHDT,010.0,T"):
        address, *fields = body.split(",")
        for sentence in NmeaFramer().feed(format_sentence(address[:2], address[2:], fields)):
            assert reader.read(0.0, sentence) is None
    assert reader.ignored == 2


@pytest.mark.parametrize(("away", "leads"), [(260.0, True), (190.0, False)])
def test_a_waypoint_nearer_than_the_cross_track_error_gives_no_track(away: float, leads: bool) -> None:
    rmb = f"GPRMB,A,{200 / 1852:.4f},L,A,B,,,,,{away / 1852:.4f},40.00,,V,A"
    assert bool(hear(rmb)[0]) is leads


@pytest.mark.parametrize(
    ("field", "error"), [("1.000,L,N", 1852.0), ("1.000,R,N", -1852.0), ("1.50,L,K", 1500.0), ("100.0,R,K", -1e5)]
)
def test_the_error_is_positive_to_starboard_and_its_last_digit_has_a_worth(field: str, error: float) -> None:
    (leg,), _ = hear(f"GPAPB,A,A,{field},V,V,090.0,T,D,011,T,011,T,A")
    assert isinstance(leg, PlotterLeg)
    digits = len(field.split(",")[0].partition(".")[2])
    assert leg.cross_track == pytest.approx(error)
    assert leg.step == pytest.approx({"N": 1852.0, "K": 1000.0}[field[-1]] * 10.0**-digits)


@pytest.mark.parametrize("side", ["L", "R"])
@pytest.mark.parametrize(
    ("first", "second", "is_taken"),
    [("0.100", "0.106", True), ("0.100", "0.107", False), ("0.100", "0.094", True), ("0.100", "0.093", False),
     ("0.1", "0.3", True), ("0.1", "0.4", False), ("0.10", "0.1", True), ("0.100", "0.2", True)],
)  # fmt: skip
def test_an_error_jumps_by_both_steps_and_what_a_boat_goes_at_most(
    first: str, second: str, is_taken: bool, side: str
) -> None:
    """In a second: 2 x 1.85 + 3 + 5 = 11.7 m, 0.0063 nm; with one decimal 185.2 m for each 1.85."""
    heard, _ = hear(f"GPAPB,A,A,{first},{side},N,V,V,090.0,T,D,011,T,011,T,A", f"GPXTE,A,A,{second},{side},N,A")
    assert (len(heard) == 2) is is_taken


@pytest.mark.parametrize("side", ["L", "R"])
def test_the_geometry_of_rmb_is_the_same_to_both_sides(side: str) -> None:
    """Half a mile of error at one mile: the track lies 30 degrees off the bearing."""
    (leg,), _ = hear(f"GPRMB,A,0.500,{side},A,B,,,,,1.000,40.0,,V,A")
    assert isinstance(leg, PlotterLeg)
    assert math.degrees(leg.track) == pytest.approx(70.0 if side == "L" else 10.0)
    assert (leg.cross_track, leg.step) == pytest.approx((926.0 if side == "L" else -926.0, 1.852))


@pytest.mark.parametrize(
    ("error", "away", "leads"),
    [("0.100", "0.100", False), ("0.100", "0.101", True), ("0.0", "0.10", False), ("0.0", "0.11", True),
     ("0.000", "999.9", True)],
)  # fmt: skip
def test_rmb_leads_farther_off_than_the_error_and_its_last_digit(error: str, away: str, leads: bool) -> None:
    assert bool(hear(f"GPRMB,A,{error},L,A,B,,,,,{away},40.0,,V,A")[0]) is leads


@pytest.mark.parametrize(
    ("body", "fate"),
    [
        ("GPRMB,A,0.0,L,A,B,,,,,1000.0,40.0,,V,A", "malformed"),
        ("GPRMB,A,100.1,L,A,B,,,,,200.0,40.0,,V,A", "malformed"),
        ("GPXTE,A,A,0.1,S,N,A", "malformed"),
        ("GPXTE,A,A,0.1,L,M,A", "malformed"),
        ("GPAPB,A,A,0.1,L,N,V,V,090.0,X,D,011,T,011,T,A", "malformed"),
        *((f"GPAPB,A,A,0.1,L,N,V,V,090.0,T,D,011,T,011,T,{mode}", "invalid") for mode in "EMNSV"),
        *((f"GPAPB,A,A,0.1,L,N,V,V,090.0,T,D,011,T,011,T,{mode}", "") for mode in ("F", "P", "R")),
        ("GPAPB,A,A,0.00,,N,V,V,090.0,T,D,011,T,011,T,A", ""),
        *((f"GPAPB,A,A,0.1,L,N,V,V,090.0,T,D,011,T,011,T,{mode}", "") for mode in ("", "A", "D")),
        ("GPAPB,V,A,0.1,L,N,V,V,090.0,T,D,011,T,011,T,A", "invalid"),
        ("GPAPB,A,V,0.1,L,N,V,V,090.0,T,D,011,T,011,T,A", "invalid"),
        ("IIHTC,A,,,H,N,,,,,350.0,,,T", "invalid"),
        *((f"IIHTC,V,,,{mode},N,,,,,350.0,,,T", "invalid") for mode in "MR"),
        *((f"IIHTC,V,,,{mode},N,,,,,350.0,,,T", "") for mode in "SHT"),
    ],
)
def test_which_sentences_lead_which_say_that_they_do_not_and_which_cannot_be(body: str, fate: str) -> None:
    heard, reader = hear(body)
    found = "malformed" if reader.malformed else "invalid" if reader.invalid else ""
    assert (found, len(heard)) == (fate, 0 if fate == "malformed" else 1)


def hear_at(*timed: tuple[float, str]) -> list[PlotterMessage]:
    ear = Ear()
    reader, framer = NmeaReader(guide=ear), NmeaFramer()
    for time, body in timed:
        address, *fields = body.split(",")
        for sentence in framer.feed(format_sentence(address[:2], address[2:], fields)):
            reader.read(time, sentence)
    return ear.heard


@pytest.mark.parametrize(("mode", "course", "track", "heading"), [
    ("T", "", "120.0", 120.0), ("T", "350.0", "120.0", 350.0), ("H", "350.0", "120.0", 350.0),
    ("S", "350.0", "", 350.0), ("S", "", "120.0", None), ("H", "", "120.0", None), ("T", "", "", None),
])  # fmt: skip
def test_a_track_is_steered_only_in_track_mode_and_where_no_heading_is_given(
    mode: str, course: str, track: str, heading: float | None
) -> None:
    (message,), _ = hear(f"IIHTD,V,,,{mode},N,,,,,{course},,{track},T,A,A,A,040")
    if heading is None:
        assert isinstance(message, PlotterInvalid)
    else:
        assert isinstance(message, PlotterHeading)
        assert math.degrees(message.heading) % 360.0 == pytest.approx(heading)


@pytest.mark.parametrize(("later", "by_apb"), [(0.1, True), (8.0, True), (8.1, False)])
@pytest.mark.parametrize("body", ["IIHTD,V,,,H,N,,,,,045.0,,,T", "GPRMB,A,0.1,L,A,B,,,,,5.0,45.0,,V,A"])
def test_eight_seconds_after_apb_fell_silent_the_plotter_s_other_sentences_lead(
    body: str, later: float, by_apb: bool
) -> None:
    apb = "GPAPB,A,A,0.10,R,N,V,V,090.0,T,D,011,T,011,T,A"
    heard = hear_at((100.0, apb), (100.0 + later, body))
    assert len(heard) == (1 if by_apb else 2)


@pytest.mark.parametrize(("later", "is_taken"), [(0.1, True), (8.0, True), (8.1, False)])
def test_xte_renews_no_leg_older_than_eight_seconds_and_makes_none_younger(later: float, is_taken: bool) -> None:
    apb, xte = "GPAPB,A,A,0.100,R,N,V,V,090.0,T,D,011,T,011,T,A", "GPXTE,A,A,0.097,R,N,A"
    heard = hear_at((100.0, apb), (100.0 + later, xte))
    assert [message.time for message in heard] == ([100.0, 100.0] if is_taken else [100.0])
    assert len(hear_at((100.0, apb), (104.0, xte), (100.0 + later, xte))) == (3 if is_taken else 2)


def test_a_plotter_in_manual_mode_is_counted_as_invalid() -> None:
    heard, reader = hear(*["IIHTD,V,,,H,N,,,,,045.0,,,T"] * 3, *["IIHTD,V,,,M,N,,,,,045.0,,,T"] * 2)
    assert [type(message) for message in heard] == [PlotterHeading] * 3 + [PlotterInvalid] * 2
    assert (reader.invalid, reader.malformed, reader.ignored) == (2, 0, 0)


def test_apa_is_read_as_apb_is() -> None:
    (leg,), _ = hear("GPAPA,A,A,0.10,R,N,V,V,011,T,DEST")
    assert isinstance(leg, PlotterLeg)
    assert (math.degrees(leg.track), leg.name) == (pytest.approx(11.0), "DEST")


BWC = "GPBWC,120000,5742.0,N,01152.0,E,011.0,T,007.0,M,{range},N,DEST"


def test_range_and_bearing_with_an_error_are_a_leg_where_neither_apb_nor_rmb_comes() -> None:
    xte, bwc = "GPXTE,A,A,0.100,L,N", BWC.format(range="1.000")
    heard, _ = hear(xte, bwc)
    (leg,) = heard
    assert isinstance(leg, PlotterLeg)
    assert math.degrees(leg.track) == pytest.approx(11.0 + math.degrees(math.asin(0.1)))
    assert (leg.cross_track, leg.waypoint) == (pytest.approx(185.2), "DEST")
    assert hear(bwc)[0] == [], "without an error it is no leg"
    magnetic = bwc.replace("011.0", "")
    assert math.degrees(hear(xte, magnetic, variation=math.radians(5.0))[0][0].track) == pytest.approx(  # type: ignore[union-attr]
        12.0 + math.degrees(math.asin(0.1))
    )
    rmb = "GPRMB,A,0.100,L,A,B,,,,,1.000,011.0,,V,A"
    assert len(hear(xte, rmb, bwc)[0]) == 1
    assert hear(xte, bwc.replace("N,DEST", "K,DEST"))[1].malformed == 1
    assert hear_at((0.0, xte), (3.1, bwc)) == []
    assert hear(xte, bwc + ",N")[0] == [PlotterInvalid(1.0, "BWC holds no valid data", " GP")]


@pytest.mark.parametrize(
    ("body", "passed"),
    [
        ("GPAPB,A,A,0.1,R,N,V,V,011,T,D,011,T,011,T,A", False),
        ("GPAPB,A,A,0.1,R,N,A,V,011,T,D,011,T,011,T,A", False),
        ("GPAPB,A,A,0.1,R,N,A,A,011,T,D,011,T,011,T,A", True),
        ("GPRMB,A,0.1,L,A,B,,,,,5.0,45.0,3.0,A,A", False),
        ("GPRMB,A,0.1,L,A,B,,,,,5.0,45.0,-3.0,V,A", False),
        ("GPRMB,A,0.1,L,A,B,,,,,5.0,45.0,-3.0,A,A", True),
    ],
)
def test_a_waypoint_abeam_or_astern_is_passed(body: str, passed: bool) -> None:
    (leg,), _ = hear(body)
    assert isinstance(leg, PlotterLeg) and leg.passed is passed


@pytest.mark.parametrize("order", [("APB", "XTE"), ("XTE", "APB")])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_at_a_waypoint_neither_sentence_leads_the_wrong_way(order: tuple[str, str], side: float) -> None:
    """The next leg lies 70 deg to one side; XTE may speak of it before APB does, or of the last one after it."""
    guide = PlotterGuide()
    guide.follow()
    reader, framer = NmeaReader(0.0, guide=guide), NmeaFramer()
    north, east, heading, leg, courses = -80.0, 2.0, 0.0, 0, []
    for step in range(500):
        now = 0.1 * step
        leg = max(leg, int(north > -20.0))
        track = math.radians(70.0) * leg
        error = side * (east * math.cos(track) - north * math.sin(track))
        if step % 10 == 0:
            letter = "L" if error > 0.0 else "R"
            bearing = f"{math.degrees(side * track) % 360.0:05.1f}"
            bodies = {
                "XTE": ["A", "A", f"{abs(error) / 1852.0:.3f}", letter, "N", "A"],
                "APB": [
                    "A",
                    "A",
                    f"{abs(error) / 1852.0:.3f}",
                    letter,
                    "N",
                    "V",
                    "V",
                    bearing,
                    "T",
                    f"W{leg}",
                    "0",
                    "T",
                ],
            }
            for place, kind in enumerate(order):
                for sentence in framer.feed(format_sentence("GP", kind, bodies[kind])):
                    reader.read(now + 0.05 * place, sentence)
        courses.append(side * guide.course(now + 0.08, side * heading, 3.0))
        heading += min(max(shortest_turn(heading, courses[-1]), -0.03), 0.03)
        north, east = north + 0.3 * math.cos(heading), east + 0.3 * math.sin(heading)
    settled = courses[60:]
    assert min(settled) > math.radians(-15.0)
    assert max(settled) < math.radians(90.0)
    assert settled[-1] == pytest.approx(math.radians(70.0), abs=0.1)


def test_plotters_on_two_lines_are_distinguished() -> None:
    ear = Ear()
    for name in ("nmea:/dev/a", "nmea:/dev/b"):
        address, *fields = APB.split(",")
        session = NmeaSession(name, NmeaSettings(variation=0.0), guide=ear)
        session.receive(1.0, [format_sentence(address[:2], address[2:], fields)])
    assert [each.source for each in ear.heard] == ["nmea:/dev/a GP", "nmea:/dev/b GP"]


def led(seconds: int, *said: tuple[float, str]) -> tuple[float, str]:
    """Return the course [deg] and the alarm after `seconds` on north, with these sentences so long [s] behind each."""
    guide = PlotterGuide()
    guide.follow()
    reader = NmeaReader(guide=guide)
    framer = NmeaFramer()
    course = 0.0
    for second in range(seconds):
        for late, body in said:
            address, *fields = body.split(",")
            for sentence in framer.feed(format_sentence(address[:2], address[2:], fields)):
                reader.read(second + late, sentence)
            course = guide.course(second + late, 0.0, 5.0)
    return math.degrees(course), "" if guide.alarm is None else guide.alarm.detail


LEG = "GPAPB,A,A,0.00,L,N,V,V,030.0,T,A,030.0,T,030.0,T,A"


@pytest.mark.parametrize(
    "idle",
    [
        "IIAPB,V,V,0.00,L,N,V,V,000.0,T,,000.0,T,000.0,T,N",
        "IIRMB,V,0.00,L,,,,,,,,,,V,N",
        "IIXTE,V,V,0.00,L,N,N",
    ],
)
@pytest.mark.parametrize("leg", [LEG, "GPRMB,A,0.00,L,A,B,,,,,2.000,030.0,5.0,V,A"])
def test_a_second_device_without_a_route_keeps_no_plotter_from_leading(idle: str, leg: str) -> None:
    assert led(12, (0.0, leg), (0.5, idle)) == (pytest.approx(30.0), "")


def test_two_devices_that_lead_different_ways_from_the_first_lead_nowhere_and_that_is_said() -> None:
    other = LEG.replace("GP", "EC").replace("030.0", "060.0")
    course, alarm = led(12, (0.0, LEG), (0.5, other))
    assert course == 0.0 and "two plotters lead different ways" in alarm
    alike = LEG.replace("GP", "EC").replace("030.0", "031.0")
    assert led(12, (0.0, LEG), (0.5, alike)) == (pytest.approx(30.0), "")


@pytest.mark.parametrize(
    ("body", "why"),
    [
        (LEG.replace(",T", ",M"), "set sensors.variation_deg"),
        (LEG.replace("030.0", "361.0"), "APB holds what cannot be"),
        (BWC.format(range="1.000"), "BWC alone names no leg"),
        ("GPXTE,A,A,0.100,L,N", "XTE alone names no leg"),
    ],
)
def test_what_comes_and_cannot_be_led_along_is_not_called_silence(body: str, why: str) -> None:
    course, alarm = led(12, (0.0, body))
    assert course == 0.0 and why in alarm


IDLE = "IIXTE,V,V,0.00,L,N,N"
OTHER = LEG.replace("GP", "EC").replace("030.0", "090.0")


def test_what_an_idle_device_says_of_itself_is_no_alarm_beside_a_plotter_that_leads() -> None:
    assert led(1, (0.0, LEG), (0.5, IDLE)) == (0.0, "")
    assert "two plotters lead different ways" in led(12, (0.0, LEG), (0.3, OTHER), (0.5, IDLE))[1]


@pytest.mark.parametrize(
    ("leg", "part", "why"),
    [
        (LEG.replace(",T", ",M"), "GPXTE,A,A,0.000,L,N", "set sensors.variation_deg"),
        ("GPRMB,A,0.05,L,A,B,,,,,0.020,030.0,5.0,V,A", BWC.format(range="1.000"), "for 8 s or more"),
    ],
)
def test_nobody_asks_for_a_leg_that_is_named_and_cannot_be_led_along(leg: str, part: str, why: str) -> None:
    course, alarm = led(12, (0.0, leg), (0.5, part))
    assert course == 0.0 and why in alarm


def test_a_plotter_that_falls_silent_is_called_so_though_it_sent_parts_of_a_leg_too() -> None:
    guide, framer = PlotterGuide(), NmeaFramer()
    guide.follow()
    reader, said = NmeaReader(guide=guide), set()
    for step in range(300):
        for body in ("GPRMB,A,0.00,L,A,B,,,,,2.000,030.0,5.0,V,A", "GPXTE,A,A,0.000,L,N"):
            address, *fields = body.split(",")
            if step % 10 == 2 * (address == "GPXTE") and step < 100:
                for sentence in framer.feed(format_sentence(address[:2], address[2:], fields)):
                    reader.read(0.1 * step, sentence)
        guide.course(0.1 * step, 0.0, 5.0)
        said.add("" if guide.alarm is None else guide.alarm.name)
    assert said == {"", "plotter_silent"}


def test_a_sentence_that_is_lost_settles_no_contest_of_two_plotters() -> None:
    guide = PlotterGuide()
    guide.follow()
    for second in range(40):
        if second % 2 == 0 and second != 20:
            guide.take(PlotterLeg(float(second), 0.5, 0.0, source="one"))
        guide.take(PlotterLeg(second + 0.5, 1.5, 0.0, source="other"))
        assert guide.course(second + 0.5, 0.0, 5.0) == 0.0
    for second in range(40, 50):
        guide.take(PlotterLeg(second + 0.5, 1.5, 0.0, source="other"))
        led_to = guide.course(second + 0.5, 0.0, 5.0)
    assert led_to == pytest.approx(1.5), "the other has fallen silent"
