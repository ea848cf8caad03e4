"""NMEA 2000 logs in text: what is read is what was sailed; damage is counted; what cannot be used is one sentence."""

from __future__ import annotations

import contextlib
import math
import random
from pathlib import Path

import numpy as np
import pytest
from boat_recordings import EPOCH, zigzag_boat
from hypothesis import given, settings
from hypothesis import strategies as st

pytest.importorskip("nmea2000", reason="nmea2000 is not installed (extra n2k)")

from n2k_boat import OF_FRAMES, OF_MESSAGES, UNDATED, Sent, lines, sent

from autopilot.errors import InputError
from autopilot.identification.identified import Question
from autopilot.identification.identify import identify
from autopilot.logs.n2k_text import lines_of, read_n2k
from autopilot.logs.reading import load_run, read_recording
from autopilot.logs.series import (
    HEADING,
    LATITUDE,
    ORDER,
    RATE,
    RUDDER,
    SPEED,
    WIND_DIRECTION,
    WIND_SPEED,
    Recording,
)

BOAT = zigzag_boat(90.0)
SENT = list(sent(BOAT))


def written(folder: Path, text: str, name: str = "boat.log") -> str:
    path = folder / name
    path.write_text(text)
    return str(path)


def read(messages: list[Sent], form: str = "candump -L", variation: float | None = None) -> Recording:
    return read_n2k("boat.log", "\n".join(lines(iter(messages), form)).encode(), variation)


@pytest.mark.parametrize("form", [*OF_FRAMES, *OF_MESSAGES])
def test_every_form_reads_as_sailed_and_is_identified(tmp_path: Path, form: str) -> None:
    path = written(tmp_path, "# a comment\n" + "\r\n".join(lines(iter(SENT), form)) + "\r\n")
    recording = read_recording(path)
    assert recording.notes == ()
    for quantity, truth in ((HEADING, BOAT.heading), (RATE, BOAT.rate), (RUDDER, BOAT.rudder)):
        (series,) = recording.of(quantity)
        assert series.time.size == 901
        values = np.unwrap(series.values) if quantity == HEADING else series.values
        expected = np.interp(series.time, BOAT.time, truth)
        np.testing.assert_allclose(np.mod(values - expected + 1.0, math.tau) - 1.0, 0.0, atol=3e-4)
    assert recording.began == pytest.approx(EPOCH, abs=0.01)
    assert recording.of(SPEED)[0].values[0] == pytest.approx(3.0)
    assert recording.of(WIND_SPEED)[0].values[0] == pytest.approx(5.0)
    assert recording.of(WIND_DIRECTION)[0].values[0] == pytest.approx(math.radians(-45.0), abs=1e-4)
    (latitude,) = recording.of(LATITUDE)
    assert latitude.time.size == 91, "fast packets are put together"
    np.testing.assert_allclose(np.degrees(latitude.values), 57.69 + 1e-5 * latitude.time, atol=2e-7)
    model = identify([load_run(path)], Question("nomoto")).model
    assert (model.gain, model.time_constant) == pytest.approx((0.2, 5.0), rel=0.02)


def test_a_candump_without_stamps_is_timed_by_the_moments_in_it(tmp_path: Path) -> None:
    text = "\n".join(line.split(")", 1)[1] for line in lines(iter(SENT), "candump -ta"))
    path = written(tmp_path, text)
    recording = read_recording(path)
    assert recording.notes == (f"{path}: has no time stamps; times are spread between those in its messages.",)
    assert recording.began == pytest.approx(EPOCH, abs=1.0)
    model = identify([load_run(path)], Question("nomoto")).model
    assert (model.gain, model.time_constant) == pytest.approx((0.2, 5.0), rel=0.03)
    without = "\n".join(line for line in text.splitlines() if "09F80507" not in line)
    with pytest.raises(InputError, match=r"candump without time stamps, and 0 messages in it tell the time"):
        read_recording(written(tmp_path, without))


def test_examples_of_the_formats_own_pages_are_read() -> None:
    """Lines from canboat's and Yacht Devices' documentation: group, source and length."""
    heading = lines_of(b"2016-02-28T19:57:02.364Z,2,127250,7,255,8,ff,10,3b,ff,7f,ce,f5,fc\n")
    rate = lines_of(b"2011-11-24-22:42:04.388,2,127251,36,255,8,7d,0b,7d,02,00,ff,ff,ff\n")
    assert (heading.kind, heading.good, heading.bad) == ("canboat log", 1, 0)
    sent_by = [
        [(g, source, len(data)) for g, source, data in zip(*each.frames, strict=True)] for each in (heading, rate)
    ]
    assert sent_by == [[(127250, 7, 8)], [(127251, 36, 8)]]
    raw = lines_of(
        b"17:33:21.141 R 09F80115 A0 7D E6 18 C0 05 FB D5\n17:33:21.107 R 19F51323 01 2F 30 70 00 2F 30 70\n"
    )
    assert (raw.kind, raw.good, raw.bad) == ("Yacht Devices RAW log", 2, 0)
    assert ([*raw.frames.groups], [*raw.frames.sources]) == ([129025], [0x15])
    assert lines_of(b"A173321.107 23FF7 1F513 012F3070002F30709F\n")[-2:] == (1, 0)
    shop = lines_of(b"!PDGY,127250,2,3,255,482.36,2y20AAAAAAE=\n$PDGY,000000,3,,5,482,1,0\n!PDGY,127250,2,3")
    assert (shop.kind, shop.good, shop.bad) == ("iKonvert log", 1, 1)
    assert [*shop.stamps] == [482.036]
    assert [*zip(*shop.frames, strict=True)] == [(127250, 3, bytes.fromhex("db2db40000000001"))]
    for line in (b"<0x18eeff01> [8] 05 a0 be 1c 00 a0 a0 c0", b"can0 123#1122", b"(1.0) can0 123#R8", b"can0 123 [0]"):
        assert lines_of(line).bad == (line == b"can0 123#1122"), line


def test_times_of_day_go_on_over_midnight() -> None:
    day = [each._replace(time=each.time - EPOCH % 86400.0 - 45.0) for each in SENT]
    recording = read(day, "Yacht Devices")
    heading = recording.of(HEADING)[0]
    assert heading.time[-1] == pytest.approx(90.0, abs=0.01)
    assert heading.longest_gap < 0.11


def test_undated_logs_take_the_date_from_their_messages() -> None:
    for form in UNDATED:
        undated = [each for each in SENT if each.group != 129029]
        assert read(undated, form).began is None
        assert read(SENT, form).began == pytest.approx(EPOCH, abs=0.01)


def test_a_clock_that_is_set_by_days_leaves_two_stretches_and_one_set_back_is_refused() -> None:
    ahead = [each._replace(time=each.time + 1e7 * (each.time > 40.0)) for each in SENT]
    recording = read(ahead, "candump -L")
    assert any("its clock jumps by 115.74 days" in note for note in recording.notes)
    assert recording.of(HEADING)[0].longest_gap == pytest.approx(60.0, abs=0.2)
    back = [each._replace(time=each.time - 3600.0 * (each.time > 40.0)) for each in SENT]
    with pytest.raises(InputError, match=r"step back by 3600.0 s at message \d+: the clock was set"):
        read(back, "candump -L")
    # in steps too small for that: backwards, as a log that is printed with the newest on top
    backwards = [each._replace(time=-each.time) for each in SENT]
    with pytest.raises(InputError, match=r"step back by 1\.\d s at message \d+: the clock was set"):
        read(backwards, "candump -L")


def test_magnetic_headings_take_the_variation_that_the_log_knows() -> None:
    def headings(**fields: object) -> list[Sent]:
        return [
            each._replace(fields={"heading": each.fields["heading"], "reference": "Magnetic", **fields})
            for each in SENT
            if each.group == 127250
        ]

    def first(messages: list[Sent], variation: float | None = None) -> tuple[float, int]:
        recording = read(messages, variation=variation)
        return float(recording.of(HEADING)[0].values[0]), len(recording.notes)

    assert first(headings()) == (pytest.approx(2.0, abs=1e-4), 1), "magnetic, and a note says so"
    assert first(headings(), variation=0.1) == (pytest.approx(2.1, abs=1e-4), 0)
    assert first(headings(variation=0.05, deviation=-0.02)) == (pytest.approx(2.03, abs=1e-4), 0)
    sent = [Sent(50.0, 127258, 35, {"variation": -0.07})]
    assert first(sorted([*headings(), *sent])) == (pytest.approx(1.93, abs=1e-4), 0)


def test_several_sources_stay_apart_and_the_most_complete_one_is_used() -> None:
    other = [
        each._replace(source=99, time=each.time + 0.05, fields={"heading": 1.0, "reference": "True"})
        for each in SENT[::7]
        if each.group == 127250
    ]
    recording = read(sorted([*SENT, *other], key=lambda each: each.time))
    best, rest = recording.of(HEADING)
    assert (best.source, rest.source) == ("N2K127250.35", "N2K127250.99")
    assert recording.best(HEADING) is best
    assert recording.notes == (
        f"boat.log: heading_rad is that of N2K127250.35 (901 samples), not of N2K127250.99 ({rest.time.size}).",
    )


def test_speed_through_the_water_comes_before_that_over_the_ground_and_a_heading_before_yaw() -> None:
    more = [Sent(float(t), 129026, 7, {"cogReference": "True", "cog": 1.0, "sog": 2.0}) for t in range(90)]
    more += [Sent(float(t), 127257, 7, {"yaw": 0.5, "roll": 0.01 * t}) for t in range(90)]
    more += [Sent(float(t), 127257, 8, {"yaw": 0.01 * t}) for t in range(90)]
    recording = read(sorted([*SENT, *more], key=lambda each: each.time))
    assert [each.source for each in recording.of(SPEED)] == ["N2K128259.12", "N2K129026.7"]
    assert [each.source for each in recording.of(HEADING)] == ["N2K127250.35", "N2K127257.8"]


def test_the_roll_of_an_attitude_is_read_also_where_it_has_no_yaw() -> None:
    more = [Sent(float(t), 127257, 7, {"roll": 0.01 * t - 0.4}) for t in range(90)]
    (roll,) = read(sorted([*SENT, *more], key=lambda each: each.time)).of("roll_rad")
    assert roll.source == "N2K127257.7"
    assert roll.values == pytest.approx([0.01 * t - 0.4 for t in range(90)], abs=1e-4)


@pytest.mark.parametrize(
    ("direction", "angle", "order"),
    [
        ("Move to starboard", 0.2, 0.2),
        ("Move to port", -0.2, -0.2),
        ("Move to port", 0.2, -0.2),
        (None, -0.2, -0.2),
        ("No Order", 0.2, None),
    ],
)
def test_rudder_orders_are_read_by_their_direction(direction: str | None, angle: float, order: float | None) -> None:
    fields = {"instance": 0, "angleOrder": angle, "position": 0.1}
    if direction is not None:
        fields["directionOrder"] = direction
    recording = read([Sent(float(t), 127245, 12, dict(fields)) for t in range(5)])
    found = recording.of(ORDER)
    assert [each.values[0] for each in found] == ([] if order is None else [pytest.approx(order)])
    assert recording.of(RUDDER)[0].values[0] == pytest.approx(0.1)


def test_two_rudders_of_one_source_are_two_series() -> None:
    messages = [Sent(t + 0.1 * n, 127245, 12, {"instance": n, "position": 0.1 * n}) for t in range(9) for n in (0, 1)]
    assert [each.source for each in read(messages).of(RUDDER)] == ["N2K127245.12", "N2K127245.12:1"]


def test_fast_packets_that_lost_a_frame_are_left_out_and_counted() -> None:
    text = lines(iter(SENT), "candump -L")
    fast = [place for place, line in enumerate(text) if "09F80507" in line]
    del text[fast[3]]
    recording = read_n2k("boat.log", "\n".join(text).encode())
    assert recording.notes == ("boat.log: 1 messages of several frames lack one and are left out.",)
    assert recording.of(LATITUDE)[0].time.size == 90


def test_damaged_lines_are_left_out_and_counted_up_to_a_fifth() -> None:
    text = lines(iter(SENT), "canboat ISO")
    for place in range(3, len(text), 50):
        text[place] = text[place][:-4]
    text[101] = text[101].replace("2026", "2096", 1)
    recording = read_n2k("boat.log", "\n".join(text).encode())
    damaged = len(range(3, len(text), 50)) + 1
    assert recording.notes == (f"boat.log: {damaged} of {len(text)} lines are damaged and left out.",)
    np.testing.assert_allclose(recording.of(RATE)[0].time[-1], 90.0, atol=0.01)
    with pytest.raises(InputError, match=r"of \d+ lines are none of a canboat log; it is damaged"):
        read_n2k("boat.log", "\n".join([*text, *["?"] * len(text)]).encode())


def test_stamps_since_the_line_before_are_refused_with_what_to_do() -> None:
    """`candump -td`: of another bus's lines between them nothing is kept, so that they cannot be added up."""
    text, before = [], 0.0
    for each in SENT:
        for identity, data in each.frames():
            text.append(
                f" ({each.time - before:010.6f})  can0  {identity:08X}   [{len(data)}]  {data.hex(' ').upper()}"
            )
            before = each.time
    with pytest.raises(InputError, match=r"candump -td.*record with candump -L"):
        read_n2k("boat.log", "\n".join(text).encode())


def test_a_log_without_anything_that_is_read_is_refused() -> None:
    with pytest.raises(InputError, match=r"boat.log: is a candump log without any of the messages that are read"):
        read([each for each in SENT if each.group == 126993])
    with pytest.raises(InputError, match=r"holds none of the NMEA 2000 messages that are read: heading 127250"):
        read([Sent(float(t), 127258, 35, {"variation": 0.1}) for t in range(9)])


SEEDS = {
    form: "\n".join(lines(iter(SENT[:40]), form)).encode()
    for form in ("candump -L", "canboat", "Yacht Devices", "Actisense")
}


@settings(max_examples=150, deadline=None)
@given(
    form=st.sampled_from(sorted(SEEDS)), seed=st.integers(0, 1 << 30), cut=st.booleans(), noise=st.binary(max_size=60)
)
def test_damage_raises_nothing_but_a_sentence(form: str, seed: int, cut: bool, noise: bytes) -> None:
    chance, data = random.Random(seed), bytearray(SEEDS[form])
    for _ in range(chance.randrange(1, 6)):
        data[chance.randrange(len(data))] = chance.randrange(256)
    place = chance.randrange(len(data))
    data[place : place + chance.randrange(1, 200)] = noise
    data = data[: chance.randrange(len(data))] if cut else data
    with contextlib.suppress(InputError):
        recording = read_n2k("boat.log", bytes(data))
        for series in recording.series:
            assert np.isfinite(series.values).all() and (np.diff(series.time) > 0.0).all()


@settings(max_examples=100, deadline=None)
@given(st.text("0123456789abcdefABCDEF,.#:()[]RTZ- \t\n", max_size=400))
def test_any_text_of_their_letters_is_survived(text: str) -> None:
    with contextlib.suppress(InputError):
        read_n2k("boat.log", text.encode())
