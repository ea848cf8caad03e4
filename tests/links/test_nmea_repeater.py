"""What we tell plotters and displays, read back by an independent parser."""

from __future__ import annotations

import functools
import math
import operator

import pynmea2
import pytest

from autopilot.links.nmea.link import NmeaLink, NmeaRepeater, NmeaSettings, heading_control
from autopilot.links.nmea.sentences import format_sentence
from autopilot.links.transports import loopback_pair
from autopilot.runtime.build_links import LinkOptions, build_link
from autopilot.signals import (
    HelmSample,
    Mode,
    NavState,
    Order,
    OrderKind,
    Reference,
    RollSample,
    RudderCommand,
    RudderSample,
    Sample,
    Tick,
)
from autopilot.vessel.file import load_vessel

ALL = (("HDT", 1.0), ("HDG", 1.0), ("ROT", 1.0), ("RSA", 1.0), ("HTD", 1.0), ("XDR", 1.0))


def tick(now: float, samples: tuple[Sample, ...] = (), mode: Mode = Mode.ENGAGED, heading: float = -0.1) -> Tick:
    return Tick(
        number=0,
        now=now,
        samples=samples,
        order=Order(OrderKind.HEADING, math.radians(-4.0)),
        state=NavState(now, heading, math.radians(-1.5), 4.0, 0.1, math.radians(2.0), 0.1, True),
        reference=Reference(heading),
        demand=0.0,
        command=RudderCommand(now, math.radians(-12.5), mode is Mode.ENGAGED),
        mode=mode,
        alarms=(),
    )


def said(repeater: NmeaRepeater, what: Tick) -> dict[str, pynmea2.NMEASentence]:
    found = {}
    for raw in repeater.due(what):
        # pynmea2 knows no HTD: its fields are read as those of a sentence it keeps as a plain list
        parsed = pynmea2.parse(_as_known(raw), check=True)
        assert parsed.talker == "AG"
        found[raw[3:6].decode()] = parsed
    return found


def _as_known(raw: bytes) -> str:
    text = raw.decode("ascii").strip()
    if text[3:6] != "HTD":
        return text
    assert int(text[-2:], 16) == functools.reduce(operator.xor, text[1:-3].encode())
    body = text[1:-3].replace("HTD", "XDR")
    return f"${body}*{functools.reduce(operator.xor, body.encode()):02X}"


def test_each_sentence_says_what_the_tick_holds() -> None:
    samples = (RudderSample(9.9, math.radians(7.2), False, "IIRSA"), RollSample(9.9, math.radians(-3.0)))
    got = said(NmeaRepeater(ALL, math.radians(-5.0)), tick(10.0, samples))
    assert (got["HDT"].data[0], got["HDT"].data[1]) == ("354.3", "T")
    assert got["HDG"].data == ["359.3", "0.0", "E", "5.0", "W"]
    assert got["ROT"].data == ["-90.0", "A"]
    assert got["RSA"].data[:2] == ["7.2", "A"]
    assert got["XDR"].data[:8] == ["A", "-12.5", "D", "RUDDER_ORDER", "A", "2.0", "D", "RUDDER_BIAS"]
    assert got["XDR"].data[8:] == ["A", "-3.0", "D", "ROLL"]
    htd = got["HTD"].data
    assert len(htd) == 17
    assert htd[:5] == ["V", "12.5", "L", "H", "N"]
    assert (htd[9], htd[12]) == ("356.0", "T")
    assert htd[13:] == ["A", "A", "V", "354.3"]


@pytest.mark.parametrize("variation_deg", [None, -5.0])
def test_magnetic_headings_are_repeated_as_such(variation_deg: float | None) -> None:
    variation = None if variation_deg is None else math.radians(variation_deg)
    got = said(NmeaRepeater(ALL, variation, magnetic=True), tick(10.0))
    assert got["HDG"].data[0] == "354.3"
    assert got["HTD"].data[12] == "M"
    assert ("HDT" in got) is (variation is not None)
    if variation is not None:
        assert got["HDT"].data[0] == "349.3"


def test_standby_is_manual_and_an_old_rudder_is_not_valid() -> None:
    repeater = NmeaRepeater(ALL)
    said(repeater, tick(0.0, (RudderSample(0.0, 0.1),)))
    got = said(repeater, tick(5.0, (RudderSample(5.0, 0.2, True),), Mode.STANDBY))
    assert got["RSA"].data[1] == "V", "what was ordered is no measurement"
    assert got["HTD"].data[:4] == ["V", "", "", "M"]
    assert "HDG" not in got, "no variation is known"
    assert "ROLL" not in got["XDR"].data


def test_each_keeps_its_rate_and_a_stale_heading_is_not_passed_on() -> None:
    repeater = NmeaRepeater((("HDT", 5.0), ("ROT", 2.0)))
    count = {"HDT": 0, "ROT": 0}
    for step in range(1000):
        for name in said(repeater, tick(step * 0.01)):
            count[name] += 1
    assert count == {"HDT": pytest.approx(50, abs=1), "ROT": pytest.approx(20, abs=1)}
    old = tick(20.0)
    assert repeater.due(old._replace(state=old.state._replace(heading_age=3.0))) == []


@pytest.mark.parametrize("heading", [-1e-9, 0.0, math.radians(359.96), math.pi])
def test_north_is_000_and_never_360(heading: float) -> None:
    got = said(NmeaRepeater((("HTD", 1.0), ("HDT", 1.0))), tick(0.0, heading=heading))
    assert 0.0 <= float(got["HDT"].data[0]) < 360.0
    assert 0.0 <= float(got["HTD"].data[16]) < 360.0


def test_a_slow_line_carries_the_rudder_order_first() -> None:
    near, far = loopback_pair()
    link = NmeaLink(near, NmeaSettings(baud=4800, sends=(("HTD", 10.0), ("HDT", 10.0))))
    for step in range(200):
        now = tick(step * 0.05)
        link.send(now.now, now.command)
        link.publish_tick(now)
        link.poll(now.now)
    got = b"".join(far.receive()).decode().split()
    assert sum(len(line) + 2 for line in got) <= 480 * 10 + 100
    orders = sum(line.startswith("$AGROR") for line in got)
    assert orders >= 60, "several orders a second on a line that cannot carry all"
    assert any(line.startswith("$AGHTD") for line in got)


def test_another_talker_is_sent_and_not_read_back_on_the_same_link() -> None:
    near, far = loopback_pair()
    link = NmeaLink(near, NmeaSettings(sends=tuple((name, 1.0) for name, _ in ALL), talker="II", variation=0.1))
    link.publish_tick(tick(0.0, (RudderSample(0.0, 0.1, True, "x"),)))
    for step in range(20):
        link.poll(0.1 * step)
    sent = far.receive()
    said_as = {line[1:3] for line in b"".join(sent).decode().split() if line[3:6] != "ROR"}
    assert said_as == {"II"} and len(sent) >= len(ALL)
    for data in sent:
        far.send(data)
    assert [sample for sample in link.receive(3.0) if not isinstance(sample, HelmSample)] == []
    far.send(format_sentence("HE", "HDT", ("90.0", "T")))
    assert [type(sample).__name__ for sample in link.receive(4.0)] == ["HeadingSample"]


def test_a_url_says_what_is_sent() -> None:
    vessel = load_vessel("lanxin")
    link = build_link(vessel, "nmea-udpout:127.0.0.1:10119?steer=no&send=HDT:5,HTD", LinkOptions())
    try:
        assert isinstance(link, NmeaLink)
        assert link.session.settings.sends == (("HDT", 5.0), ("HTD", 1.0))
        assert not link.session.settings.steers
    finally:
        link.close()


def test_a_sentence_that_is_not_due_holds_no_other_up() -> None:
    repeater = NmeaRepeater((("ROT", 0.5), ("HDT", 10.0)))
    names = [raw[3:6].decode() for step in range(100) for raw in repeater.due(tick(0.1 * step + 1e-6 * step))]
    assert (names.count("ROT"), names.count("HDT")) == (5, 100)


def test_after_a_pause_nothing_is_made_up_for() -> None:
    repeater = NmeaRepeater((("HDT", 1.0),))
    times = [now for now in (0.0, 0.5, 0.95, 1.05, 1.9, 2.0, 9.0, 9.9, 10.0, 10.9, 11.0) if repeater.due(tick(now))]
    assert times == [0.0, 1.05, 2.0, 9.0, 10.0, 11.0]
    late = NmeaRepeater((("HDT", 1.0),))
    assert [now for now in (0.0, 2.0, 2.5, 3.0) if late.due(tick(now))] == [0.0, 2.0, 3.0], "a whole period late"


@pytest.mark.parametrize(("age", "is_fresh"), [(2.0, True), (2.1, False)])
def test_what_is_older_than_two_seconds_is_not_said_as_measured(age: float, is_fresh: bool) -> None:
    repeater = NmeaRepeater(ALL)
    got = said(repeater, tick(age, (RudderSample(0.0, 0.1), RollSample(0.0, 0.2))))
    assert (got["RSA"].data[1], "ROLL" in got["XDR"].data) == ("A" if is_fresh else "V", is_fresh)
    old = tick(10.0)
    state = old.state._replace(heading_age=age)
    assert bool(repeater.due(old._replace(state=state))) is is_fresh
    assert not NmeaRepeater(ALL).due(old._replace(state=state._replace(valid=False)))


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize(("off", "is_on"), [(9.9, "A"), (10.1, "V")])
def test_heading_control_says_side_mode_and_whether_the_heading_is_kept(off: float, is_on: str, side: float) -> None:
    heading = math.radians(100.0)
    what = tick(0.0, heading=heading)._replace(
        reference=Reference(heading + side * math.radians(off)), command=RudderCommand(0.0, side * 0.1, True)
    )
    fields = heading_control(what).decode()[1:-5].split(",")
    rudder = "R" if side > 0.0 else "L"
    assert fields == [
        *("AGHTD", "V", "5.7", rudder, "H", "N", "", "", "", "", "356.0", "", "", "T", "A", is_on, "V", "100.0")
    ]
    by_rudder = heading_control(what._replace(order=Order(OrderKind.RUDDER))).decode()[1:-5].split(",")
    assert (by_rudder[4], by_rudder[10], by_rudder[14:16]) == ("R", "", ["A", "A"])
    by_hand = heading_control(what._replace(mode=Mode.STANDBY), "II", magnetic=True).decode()[1:-5].split(",")
    assert by_hand == [
        *("IIHTD", "V", "", "", "M", "N", "", "", "", "", "", "", "", "M", "V", "A", "V", "100.0")
    ]  # fmt: skip
