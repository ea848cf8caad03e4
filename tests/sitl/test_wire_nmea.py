"""Instruments and rudder drive on the NMEA line, in lockstep: content, pace, orders, faults, repeatability."""

from __future__ import annotations

import dataclasses
import math
from functools import reduce
from operator import xor
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from autopilot.errors import InputError
from autopilot.vessel.file import load_vessel
from sitl.drives import UartLine
from sitl.scenario import DriveSection, FaultSection, Scenario, SensorsSection, Start, load_scenario
from sitl.wire_nmea import NmeaInstruments, chosen_rates, deviation_of_magnetic
from sitl.world import World

EXACT = SensorsSection(
    heading_noise_deg=0.0,
    rate_noise_deg_s=0.0,
    rudder_noise_deg=0.0,
    speed_noise_m_s=0.0,
    position_noise_m=0.0,
)
ALL = dict.fromkeys(("HDG", "HDM", "HDT", "THS", "ROT", "RSA", "VHW", "VTG", "RMC"), 5.0)


def scenario_with(**sections: Any) -> Scenario:
    return dataclasses.replace(load_scenario("calm"), **sections)


def line(scenario: Scenario, rates: dict[str, float], baud: int = 38400, vessel: Any = None) -> NmeaInstruments:
    return NmeaInstruments(World(vessel or load_vessel("lanxin"), scenario), rates, baud)


def listen(instruments: NmeaInstruments, start: float, seconds: float, step: float = 0.02) -> bytes:
    heard = b""
    for tick in range(1, round(seconds / step) + 1):
        heard += b"".join(instruments.transmit(start + tick * step))
    return heard


def sentences(heard: bytes) -> list[list[str]]:
    """Fields of each sentence, its checksum verified by hand."""
    found = []
    for raw in heard.decode("ascii").split("\r\n"):
        if not raw:
            continue
        body, _, given_sum = raw.removeprefix("$").partition("*")
        assert int(given_sum, 16) == reduce(xor, body.encode()), raw
        found.append(body.split(","))
    return found


def last(heard: bytes, kind: str) -> list[str]:
    return [fields for fields in sentences(heard) if fields[0].endswith(kind)][-1]


def order(degrees: float, status: str = "A") -> bytes:
    body = f"AGROR,{degrees:.2f},{status},,V,B"
    return f"${body}*{reduce(xor, body.encode()):02X}\r\n".encode()


def test_sentences_say_what_the_boat_does() -> None:
    start = Start(heading_deg=359.0, latitude_deg=-33.5, longitude_deg=-70.25)
    variation = dataclasses.replace(EXACT, variation_deg=-4.0)
    instruments = line(scenario_with(sensors=variation, start=start), ALL)
    instruments.receive(0.0, order(10.0))
    heard = listen(instruments, 0.0, 1.5)
    state = instruments.world.boat.state
    assert float(last(heard, "HDT")[1]) == pytest.approx(math.degrees(state.heading) % 360.0, abs=3.0)
    true_heading = float(last(heard, "THS")[1])
    assert last(heard, "THS")[2] == "A"
    magnetic = last(heard, "HDM")
    assert magnetic[2] == "M"
    assert (float(magnetic[1]) - true_heading - 4.0 + 180.0) % 360.0 - 180.0 == pytest.approx(0.0, abs=1.5)
    assert last(heard, "HDG")[4:] == ["4.0", "W"]
    assert float(last(heard, "ROT")[1]) == pytest.approx(math.degrees(state.rate) * 60.0, rel=0.1)
    assert float(last(heard, "ROT")[1]) > 100.0
    assert float(last(heard, "RSA")[1]) == pytest.approx(10.0, abs=0.2)
    assert float(last(heard, "VHW")[5]) == pytest.approx(state.speed * 3600.0 / 1852.0, abs=0.1)
    rmc = last(heard, "RMC")
    assert (rmc[2], rmc[4], rmc[6]) == ("A", "S", "W")
    assert float(rmc[3][:2]) + float(rmc[3][2:]) / 60.0 == pytest.approx(33.5, abs=1e-3)
    assert rmc[9] == "010626"


def test_a_compass_may_keep_its_variation_to_itself() -> None:
    silent = dataclasses.replace(EXACT, variation_deg=-4.0, compass_sends_variation=False)
    heard = listen(line(scenario_with(sensors=silent, start=Start(heading_deg=100.0)), {"HDG": 5.0}), 0.0, 1.0)
    assert last(heard, "HDG")[1:] == ["104.0", "", "", "", ""]
    unknown = listen(line(scenario_with(sensors=EXACT), {"HDG": 5.0}), 0.0, 1.0)
    assert last(unknown, "HDG")[4:] == ["0.0", "E"]


def test_order_turns_the_rudder_and_status_v_releases_it() -> None:
    instruments = line(scenario_with(), {"RSA": 5.0})
    instruments.receive(0.0, order(-12.0))
    instruments.advance(1.5)
    assert math.degrees(instruments.world.boat.state.rudder) == pytest.approx(-12.0, abs=0.01)
    assert instruments.world.boat.state.rate < 0.0
    instruments.receive(1.5, order(-12.0, "V"))
    instruments.advance(3.0)
    assert math.degrees(instruments.world.boat.state.rudder) == pytest.approx(0.0, abs=0.01)


@pytest.mark.parametrize(("released", "angle"), [("amidships", 0.0), ("hold", 15.0)])
def test_silence_releases_as_the_scenario_says(released: Any, angle: float) -> None:
    instruments = line(scenario_with(drive=DriveSection(silence_s=2.0, released=released)), {"RSA": 5.0})
    instruments.receive(0.0, order(15.0))
    instruments.advance(1.9)
    assert math.degrees(instruments.world.boat.state.rudder) == pytest.approx(15.0, abs=0.01)
    instruments.advance(5.0)
    assert math.degrees(instruments.world.boat.state.rudder) == pytest.approx(angle, abs=0.02)


@pytest.mark.parametrize(
    "body", ["AGROR,abc,A,,V,B", "AGROR,120.0,A,,V,B", "AGROR,5.0,X,,V,B", "AGROR,nan,A,,V,B", "AGROR,5.0"]
)
def test_orders_that_make_no_sense_are_refused_and_counted(body: str) -> None:
    instruments = line(scenario_with(), {"RSA": 5.0})
    instruments.receive(0.0, f"${body}*{reduce(xor, body.encode()):02X}\r\n".encode())
    instruments.advance(1.0)
    assert (instruments.drive.accepted, instruments.drive.refused) == (0, 1)
    assert instruments.world.boat.state.rudder == 0.0


def test_orders_with_a_wrong_checksum_do_nothing() -> None:
    instruments = line(scenario_with(), {"RSA": 5.0})
    instruments.receive(0.0, order(10.0).replace(b"10.00", b"20.00"))
    instruments.advance(1.0)
    assert instruments.drive.accepted == 0
    assert instruments.framer.counts.checksum_errors == 1


def test_4800_baud_is_480_bytes_a_second_and_no_more() -> None:
    instruments = line(scenario_with(), {"RMC": 20.0, "HDG": 20.0}, 4800)
    heard = listen(instruments, 0.0, 10.0)
    assert 4700 <= len(heard) <= 4800
    assert instruments.skipped > 0, "what does not fit is skipped whole, it does not queue for ever"
    sentences(heard.rpartition(b"\r\n")[0])


def test_a_heading_is_as_late_as_its_line_is_slow() -> None:
    """26 bytes at 4800 baud take 54 ms: the sentence is not complete a moment before."""
    instruments = line(scenario_with(), {"HDG": 1.0}, 4800)
    heard, complete = b"", 0.0
    for tick in range(1, 200):
        heard += b"".join(instruments.transmit(tick * 0.001))
        if heard.endswith(b"\r\n") and not complete:
            complete = tick * 0.001
    assert complete == pytest.approx(0.01 + len(heard) * 10.0 / 4800.0, abs=0.0015)


def test_an_order_arrives_at_the_pace_of_the_line_too() -> None:
    instruments = line(scenario_with(), {"RSA": 1.0}, 4800)
    message = order(20.0)
    instruments.receive(0.0, message)
    passage = len(message) * 10.0 / 4800.0
    instruments.advance(passage - 0.005)
    assert instruments.drive.accepted == 0
    instruments.advance(passage + 0.011)
    assert instruments.drive.accepted == 1


def test_drop_out_silences_the_compass_and_ths_says_so() -> None:
    faults = (FaultSection("heading_dropout", 1.0, 2.0),)
    instruments = line(scenario_with(faults=faults), {"HDG": 10.0, "THS": 10.0, "ROT": 10.0})
    before, during, after = (listen(instruments, start, 0.9) for start in (0.05, 1.05, 2.05))
    assert b"HDG" in before
    assert b"HDG" not in during[60:]
    assert last(during, "THS")[2] == "V"
    assert b"ROT" in during
    assert b"HDG" in after


def test_deviation_card_is_in_the_compass() -> None:
    """Compass + deviation(compass) = magnetic: what a pilot adds back gives the true heading."""
    table = ((0.0, 2.0), (90.0, -5.0), (180.0, 4.0), (270.0, -1.0))
    for degree in range(0, 360, 7):
        magnetic = math.radians(degree)
        deviation = math.degrees(deviation_of_magnetic(table, magnetic))
        compass = (degree - deviation) % 360.0
        index = int(compass // 90.0)
        low, high = table[index][1], table[(index + 1) % 4][1]
        assert deviation == pytest.approx(low + (high - low) * (compass - 90.0 * index) / 90.0, abs=1e-6)
    assert deviation_of_magnetic((), 1.0) == 0.0


def test_rates_are_shared_out_on_a_slow_line() -> None:
    slow, fast = chosen_rates("HDG,ROT,RSA,VHW", 4800), chosen_rates("HDG,ROT,RSA,VHW", 38400)
    assert fast["HDG"] == 10.0
    assert slow["HDG"] < 10.0
    load = 26 * slow["HDG"] + 20 * slow["ROT"] + 22 * slow["RSA"] + 46 * slow["VHW"]
    assert load == pytest.approx(0.8 * 480.0)
    assert chosen_rates("HDG:7,ROT", 4800)["HDG"] == 7.0


@pytest.mark.parametrize("text", ["HDG,XYZ", "", "HDG,HDG", "HDG:fast", "HDG:0", "HDG:nan"])
def test_bad_sentence_lists_are_one_sentence(text: str) -> None:
    with pytest.raises(InputError, match="--sentences"):
        chosen_rates(text, 4800)


def test_same_seed_same_bytes() -> None:
    def heard(seed: int) -> bytes:
        world = World(load_vessel("lanxin"), load_scenario("ittc"), seed)
        instruments = NmeaInstruments(world, chosen_rates("HDG,ROT,RSA,VHW", 4800), 4800)
        for turn in range(50):
            instruments.receive(0.1 * turn, order(5.0 * math.sin(turn)))
        return listen(instruments, 5.0, 5.0, step=0.037)

    assert heard(3) == heard(3)
    assert heard(3) != heard(4)


@given(
    pieces=st.lists(st.binary(max_size=40), max_size=10),
    gaps=st.lists(st.floats(0.0, 0.5), min_size=10, max_size=10),
    baud=st.sampled_from([300, 4800, 38400, 921600]),
)
def test_a_line_loses_nothing_keeps_order_and_never_hurries(pieces: list[bytes], gaps: list[float], baud: int) -> None:
    uart = UartLine(baud)
    time, heard, sent = 0.0, b"", b""
    for piece, gap in zip(pieces, gaps, strict=False):
        uart.put(time, piece)
        sent += piece
        time += gap
        heard += uart.take(time)
        assert len(heard) <= time * baud / 10.0 + 1e-3
        assert sent.startswith(heard)
    assert heard + uart.take(time + uart.backlog(time) + 1.0) == sent
