"""PX4's .ulg and NMEA sentences in text: what is read is what was sailed; what cannot be used is one sentence."""

from __future__ import annotations

import builtins
import contextlib
import io
import math
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pynmea2
import pytest
from boat_recordings import EPOCH, FULL, Boat, every, ulog, zigzag_boat
from hypothesis import given, settings
from hypothesis import strategies as st
from memory import measured
from pyulog import ULog

from autopilot.errors import InputError
from autopilot.identification.identified import Question
from autopilot.identification.identify import identify
from autopilot.links.nmea.sentences import checksum
from autopilot.logs.reading import LogOptions, ReadOptions, info_of, load_run, read_recording
from autopilot.logs.series import (
    HEADING,
    LATITUDE,
    PROPELLER,
    RATE,
    RUDDER,
    SHARE,
    SPEED,
    WIND_DIRECTION,
    WIND_SPEED,
    stamp_of,
)
from autopilot.logs.table import RudderSettings
from autopilot.logs.ulog import read_ulog
from autopilot.models.steering_gear import SteeringGear

BOAT = zigzag_boat(90.0)
GEAR = SteeringGear(angle_max=FULL, rate_max=math.radians(5.0))


def written(folder: Path, data: bytes | str, name: str) -> str:
    path = folder / name
    path.write_bytes(data.encode() if isinstance(data, str) else data)
    return str(path)


def test_a_px4_log_reads_as_sailed(tmp_path: Path) -> None:
    recording = read_recording(written(tmp_path, ulog(BOAT), "boat.ulg"))
    assert recording.notes == ()
    assert recording.began == pytest.approx(EPOCH, abs=0.01)
    heading, rate, share = (recording.of(quantity)[0] for quantity in (HEADING, RATE, SHARE))
    expected = np.interp(heading.time, BOAT.time, BOAT.heading)
    np.testing.assert_allclose(np.unwrap(heading.values), expected, atol=1e-5)
    np.testing.assert_allclose(rate.values, np.interp(rate.time, BOAT.time, BOAT.rate), atol=1e-6)
    assert share.source == "actuator_servos"
    speed = recording.best(SPEED)
    assert speed is not None
    np.testing.assert_allclose(speed.values, 3.0, rtol=1e-5)
    assert math.degrees(recording.of(LATITUDE)[0].values[0]) == pytest.approx(57.69)


def test_pyulog_writes_what_is_read_the_same(tmp_path: Path) -> None:
    """pyulog's own writer makes the file; what it holds comes out of ours unchanged."""
    first = written(tmp_path, ulog(BOAT), "a.ulg")
    second = str(tmp_path / "b.ulg")
    ULog(first).write_ulog(second)
    a, b = read_recording(first), read_recording(second)
    assert [s.source for s in a.series] == [s.source for s in b.series]
    for ours, theirs in zip(a.series, b.series, strict=True):
        np.testing.assert_array_equal(ours.values, theirs.values)


@pytest.mark.parametrize("topics", [("attitude", "rates", "gps", "servos"), ("attitude", "local", "outputs")])
def test_a_px4_boat_is_identified(tmp_path: Path, topics: tuple[str, ...]) -> None:
    path = written(tmp_path, ulog(BOAT, topics), "boat.ulg")
    run = load_run(path, options=LogOptions(rudder=RudderSettings(at_full=FULL, gear=GEAR)))
    if "servos" in topics:
        model = identify([run], Question("nomoto")).model
        assert (model.gain, model.time_constant) == pytest.approx((0.2, 5.0), rel=0.03)
    else:
        # these pulses have their own end points: 1480 +- 360 against PX4's 1000 to 2000
        assert any("actuator_outputs servo 3" in note for note in run.notes)


@pytest.mark.parametrize("keep", [0, 10, 16, 40, 200, 3000, 20000])
def test_a_px4_log_that_is_cut_off_is_used_or_refused_in_one_sentence(
    tmp_path: Path, keep: int, capsys: pytest.CaptureFixture[str]
) -> None:
    path = written(tmp_path, ulog(BOAT)[:keep], "boat.ulg")
    try:
        recording = read_recording(path)
    except InputError as error:
        assert "\n" not in str(error)
        assert path in str(error)
    else:
        assert recording.of(HEADING)[0].time.size > 10
    assert capsys.readouterr().out == ""


@settings(max_examples=60)
@given(start=st.integers(0, 20000), noise=st.binary(min_size=1, max_size=80))
def test_damage_to_a_px4_log_raises_nothing_but_a_sentence(start: int, noise: bytes) -> None:
    data = bytearray(SHORT)
    start %= len(data)
    data[start : start + len(noise)] = noise
    with contextlib.suppress(InputError), contextlib.redirect_stdout(io.StringIO()) as printed:
        recording = read_ulog("boat.ulg", bytes(data))
        assert all(np.isfinite(series.values).all() for series in recording.series)
    assert printed.getvalue() == ""


SHORT = ulog(zigzag_boat(6.0))


def test_without_pyulog_the_extra_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    real = builtins.__import__

    def without(name: str, *rest: Any) -> Any:
        if name.startswith("pyulog"):
            raise ImportError(name)
        return real(name, *rest)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(InputError, match=r"pip install '\.\[ulog\]'"):
        read_recording(written(tmp_path, ulog(BOAT), "boat.ulg"))


def sentence(body: str) -> str:
    return f"${body}*{checksum(body.encode()):02X}"


def sentences(boat: Boat, heading: str = "HDT") -> list[tuple[float, str]]:
    """Return (seconds, sentence) as instruments send them: heading, rate and rudder at 10 Hz, RMC and wind at 1 Hz."""
    out = []
    for i in every(boat, 10.0):
        degrees = math.degrees(boat.heading[i]) % 360.0
        fields = {"HDT": f"{degrees:.2f},T", "HDG": f"{degrees:.2f},,,,"}[heading]
        out.append((boat.time[i], sentence(f"HE{heading},{fields}")))
        out.append((boat.time[i] + 0.01, sentence(f"TIROT,{60.0 * math.degrees(boat.rate[i]):.2f},A")))
        out.append((boat.time[i] + 0.02, sentence(f"IIRSA,{math.degrees(boat.rudder[i]):.2f},A,,V")))
        if i % 50 == 0:
            moment = datetime.fromtimestamp(EPOCH + boat.time[i], UTC)
            clock, date = moment.strftime("%H%M%S.00"), moment.strftime("%d%m%y")
            knots = boat.speed[i] * 3600.0 / 1852.0
            out.append(
                (boat.time[i] + 0.03, sentence(f"GPRMC,{clock},A,5741.40,N,01150.40,E,{knots:.2f},90.0,{date},,,A"))
            )
            out.append((boat.time[i] + 0.04, sentence("WIMWV,315.0,R,5.00,M,A")))
            out.append((boat.time[i] + 0.05, sentence("IIRPM,S,1,600,10.0,A")))
    return out


FORMS: dict[str, Callable[[float, str], str]] = {
    "seconds": lambda t, s: f"{EPOCH + t:.3f} {s}",
    "milliseconds": lambda t, s: f"{round(1000 * (EPOCH + t))};I;{s}",
    "iso": lambda t, s: f"{datetime.fromtimestamp(EPOCH + t, UTC).isoformat()[:23]}Z, {s}",
    "of day": lambda t, s: f"[{datetime.fromtimestamp(EPOCH + t, UTC).strftime('%H:%M:%S.%f')[:12]}] {s}",
    "tag block": lambda t, s: f"\\s:gps,c:{round(1000 * (EPOCH + t))}*00\\{s}",
    "from start": lambda t, s: f"{t:.3f},{s}",
    "quoted": lambda t, s: f'{t:.3f},"{s}"',
}


@pytest.mark.parametrize("form", FORMS)
def test_sentences_with_time_stamps_read_as_sailed(tmp_path: Path, form: str) -> None:
    text = "\n".join(FORMS[form](t, s) for t, s in sentences(BOAT))
    recording = read_recording(written(tmp_path, text, "boat.txt"))
    assert recording.notes == ()
    for quantity, truth in ((HEADING, BOAT.heading), (RATE, BOAT.rate), (RUDDER, BOAT.rudder)):
        series = recording.of(quantity)[0]
        values = np.unwrap(series.values) if quantity == HEADING else series.values
        np.testing.assert_allclose(values, np.interp(series.time, BOAT.time, truth), atol=2e-3)
    if form not in ("from start", "quoted"):
        assert recording.began == pytest.approx(EPOCH, abs=0.01)
    assert recording.of(WIND_SPEED)[0].values[0] == 5.0
    assert recording.of(WIND_DIRECTION)[0].values[0] == pytest.approx(math.radians(-45.0))
    assert recording.of(PROPELLER)[0].values[0] == 10.0
    model = identify([load_run(str(tmp_path / "boat.txt"))], Question("nomoto")).model
    assert (model.gain, model.time_constant) == pytest.approx((0.2, 5.0), rel=0.02)


def test_stamps_of_whole_seconds_mark_times_that_lie_between(tmp_path: Path) -> None:
    """Ten headings a second became one, half a second late, without a word."""
    text = "\n".join(f"\\s:gps,c:{int(EPOCH + t)}*00\\{s}" for t, s in sentences(BOAT))
    path = written(tmp_path, text, "boat.txt")
    recording = read_recording(path)
    assert recording.notes == (f"{path}: its time stamps are whole seconds; times are spread between them.",)
    for quantity, truth in ((HEADING, BOAT.heading), (RATE, BOAT.rate), (RUDDER, BOAT.rudder)):
        series = recording.of(quantity)[0]
        assert series.time.size > 890
        values = np.unwrap(series.values) if quantity == HEADING else series.values
        apart = values - np.interp(series.time, BOAT.time, truth)
        assert np.sqrt(np.mean(apart**2)) < math.radians(0.5)


def test_sentences_once_a_second_stay_at_their_stamps(tmp_path: Path) -> None:
    bows = [(t, f"HEHDT,{60.0 + t:.1f},T") for t in range(40)]
    both = [f"{EPOCH + t:.0f} {sentence(body)}" for t, heading in bows for body in (heading, "IIRSA,5.0,A,,V")]
    recording = read_recording(written(tmp_path, "\n".join(both), "boat.txt"))
    assert recording.notes == ()
    for quantity in (HEADING, RUDDER):
        np.testing.assert_array_equal(recording.of(quantity)[0].time % 1.0, 0.0)


@pytest.mark.parametrize(("body", "angle", "speed"), [
    ("IIVWR,45.0,L,9.7,N,5.0,M,18.0,K", -45.0, 4.99), ("IIVWR,120.5,R,,,5.0,M,,", 120.5, 5.0),
])  # fmt: skip
def test_the_wind_of_older_instruments_is_read(tmp_path: Path, body: str, angle: float, speed: float) -> None:
    said = [f"{t:.1f} {sentence(each)}" for t in range(1, 40) for each in ("HEHDT,60.0,T", body)]
    recording = read_recording(written(tmp_path, "\n".join(said), "boat.txt"))
    assert recording.of(WIND_SPEED)[0].values == pytest.approx(speed, abs=0.01)
    assert recording.of(WIND_DIRECTION)[0].values == pytest.approx(math.radians(angle))


@pytest.mark.parametrize("before", ["from start", "seconds of 1970"])
def test_sentences_whose_stamps_jump_are_read_in_two_stretches(tmp_path: Path, before: str) -> None:
    """A logger without a clock of its own, until the network tells it the time."""
    early = {"from start": lambda t, s: f"{t:.3f} {s}", "seconds of 1970": FORMS["iso"]}[before]
    shift = 0.0 if before == "from start" else -EPOCH + 30.0
    lines = [early(t + shift, s) if t < 40.0 else FORMS["iso"](t, s) for t, s in sentences(BOAT)]
    path = written(tmp_path, "\n".join(lines), "boat.txt")
    recording, run = read_recording(path), load_run(path)
    (note,) = recording.notes
    assert note.startswith(f"{path}: its clock jumps by 20602 days, from ") and note in run.notes
    heading = recording.of(HEADING)[0]
    assert heading.longest_gap == pytest.approx(60.0, abs=0.2)
    assert heading.time[-1] == pytest.approx(150.0, abs=0.2)
    assert recording.began is not None, "the clock that was set is right"
    assert recording.began + heading.time[-1] == pytest.approx(EPOCH + 90.0, abs=0.2)
    assert len(run.segments) == 2
    model = identify([run], Question("nomoto")).model
    assert (model.gain, model.time_constant) == pytest.approx((0.2, 5.0), rel=0.03)


def test_stamps_that_cannot_be_times_are_refused(tmp_path: Path) -> None:
    lines = [f"0.{i:0200d} {s}" for i, (_, s) in enumerate(sentences(BOAT)[:200])]
    with pytest.raises(InputError, match=r"samples in 1.98e-198 s, 3e-200 s apart for the most part") as refusal:
        read_recording(written(tmp_path, "\n".join(lines), "boat.txt"))
    assert len(str(refusal.value)) < 400


def test_without_time_stamps_the_times_are_spread_between_the_utc_inside(tmp_path: Path) -> None:
    path = written(tmp_path, "\r\n".join(s for _, s in sentences(BOAT)), "boat.nmea")
    recording = read_recording(path)
    assert recording.notes == (f"{path}: has no time stamps; times are spread between the UTC in its sentences.",)
    assert recording.began == pytest.approx(EPOCH, abs=1.0)
    model = identify([load_run(path)], Question("nomoto")).model
    assert (model.gain, model.time_constant) == pytest.approx((0.2, 5.0), rel=0.03)


def test_pynmea2_finds_the_same_sentences(tmp_path: Path) -> None:
    lines = [s for _, s in sentences(BOAT)]
    peers = [pynmea2.parse(line, check=True) for line in lines]
    headings = [math.radians(float(peer.heading)) for peer in peers if peer.sentence_type == "HDT"]
    path = written(tmp_path, "\n".join(f"{i} {line}" for i, line in enumerate(lines)), "boat.txt")
    found = read_recording(path).of(HEADING)[0].values
    np.testing.assert_allclose(np.exp(1j * found), np.exp(1j * np.array(headings)))


def test_a_magnetic_compass_without_variation_is_used_and_said(tmp_path: Path) -> None:
    path = written(tmp_path, "\n".join(f"{t} {s}" for t, s in sentences(BOAT, "HDG")), "boat.txt")
    magnetic = read_recording(path)
    assert "headings are magnetic" in magnetic.notes[0]
    true = read_recording(path, ReadOptions(variation=math.radians(5.0)))
    assert true.notes == ()
    apart = np.unwrap(true.of(HEADING)[0].values) - np.unwrap(magnetic.of(HEADING)[0].values)
    np.testing.assert_allclose(apart, math.radians(5.0), atol=1e-9)


@pytest.mark.parametrize(
    ("lines", "expected"),
    [
        (
            lambda: [s for _, s in sentences(BOAT) if "RMC" not in s],
            "when its sentences came cannot be determined: 0 of",
        ),
        (
            lambda: [f"{t} {s}" for t, s in sentences(BOAT)[:50]] + [f"{t} {s}" for t, s in sentences(BOAT)[:9]],
            "step back by",
        ),
        (
            lambda: [FORMS["of day"](t - 3600.0 * (t > 45.0), s) for t, s in sentences(BOAT)],
            r"step back by 3600.0 s at sentence \d+: the clock was set",
        ),
        (
            lambda: [f"{t} {s[:-1]}0" for t, s in sentences(BOAT)[:90]] + ["99 " + sentence("HEHDT,1.0,T")],
            "wrong checksum or form",
        ),
        (lambda: [f"{t} {sentence('GPGSV,1,1,00')}" for t in range(20)], "holds no heading, rate, rudder or speed"),
    ],
)
def test_sentences_that_cannot_be_used_are_one_sentence(
    tmp_path: Path, lines: Callable[[], list[str]], expected: str
) -> None:
    path = written(tmp_path, "\n".join(lines()), "boat.txt")
    with pytest.raises(InputError, match=expected) as refusal:
        read_recording(path)
    assert "\n" not in str(refusal.value)


def test_the_range_of_a_wind_is_an_angle_off_the_bow_however_often_the_vane_has_gone_round(tmp_path: Path) -> None:
    """Four recorded hours with light airs were shown as -38 to 923 deg."""
    bows = [sentence(f"WIMWV,{60.0 * t % 360.0:.1f},R,5.00,M,A") for t in range(40)]
    lines = [f"{t} {each}" for t, each in enumerate(bows)] + [f"{t} {sentence('HEHDT,10.0,T')}" for t in range(40, 50)]
    info = info_of(read_recording(written(tmp_path, "\n".join(lines), "boat.txt")), RudderSettings())
    (wind,) = (each for each in info.series if each.quantity == WIND_DIRECTION)
    assert max(abs(wind.low), abs(wind.high)) <= math.pi and wind.high - wind.low > math.radians(200.0)


def test_a_few_wrong_checksums_are_left_out_and_reported(tmp_path: Path) -> None:
    lines = [f"{t} {s}" for t, s in sentences(BOAT)]
    lines[7::100] = [line.replace(",", ";", 1) for line in lines[7::100]]
    recording = read_recording(written(tmp_path, "\n".join(lines), "boat.txt"))
    assert recording.notes[0].endswith("sentences with a wrong checksum or form are left out.")


@pytest.mark.parametrize(
    ("date", "is_known"),
    [("01,06,2026", True), ("1,6,2026", True), ("31,02,2026", False), ("1,1,99999999999999999999", False),
     ("1,1,0000", False), ("01,06,26", False), ("01,,2026", False)],
)  # fmt: skip
def test_impossible_zda_dates_give_no_beginning_and_lose_no_heading(date: str, is_known: bool, tmp_path: Path) -> None:
    lines = [sentence(f"GPZDA,1200{second:02d},{date},00,00") for second in range(10)]
    lines = [line for second, zda in enumerate(lines) for line in (zda, sentence(f"HEHDT,{second}.0,T"))]
    recording = read_recording(written(tmp_path, "\n".join(lines), "boat.nmea"))
    assert recording.of(HEADING)[0].time.size == 10
    assert (recording.began is not None) == is_known


def test_times_of_day_count_on_over_midnight(tmp_path: Path) -> None:
    lines = [
        f"{'23:59:58.5' if t < 1.0 else f'00:00:0{t - 1.0:.1f}'} {s}"
        for t, s in sentences(BOAT)[:100]
        if t in (0.0, 1.0, 2.0)
    ]
    heading = read_recording(written(tmp_path, "\n".join(lines), "boat.txt")).of(HEADING)[0]
    np.testing.assert_allclose(heading.time, [0.0, 1.5, 2.5])


@pytest.mark.parametrize(
    ("prefix", "seconds"),
    [
        ("", None),
        ("NMEA: ", None),
        ("1700000000 ", 1.7e9),
        ("1700000000123 ", 1.700000000123e9),
        ("12.5;", 12.5),
        ("2023-11-14T22:13:20.5Z ", 1.7000000005e9),
        ("2023-11-14 22:13:20 ", 1.7e9),
        ("2023-11-15T00:13:20+02:00 ", 1.7e9),
        ("2023-99-14T22:13:20Z ", None),
        ("22:13:20.25 ", 80000.25),
        ("23:59:60.5 ", 86400.5),
        ("24:00:00 ", None),
        ("22:60:00 ", None),
    ],
)
def test_nmea_time_stamps_of_every_kind_are_read(prefix: str, seconds: float | None) -> None:
    found = stamp_of(prefix)
    assert (found is None) == (seconds is None)
    if found is not None:
        assert found[0] == pytest.approx(seconds, abs=1e-3)


def test_sentences_take_few_times_the_memory_of_their_file(tmp_path: Path) -> None:
    """A day of them is 100 MB and more: a list of all, taken apart, was twenty-five times as large."""
    body = [f"{0.1 * at:.1f} {sentence(f'HEHDT,{at % 360}.5,T')}\r\n" for at in range(20_000)]
    text = "".join(body)
    path = written(tmp_path, text, "long.nmea")
    read_recording(path)
    recording, taken = measured(lambda: read_recording(path))
    assert recording.series[0].time.size == 20_000
    assert taken.peak < 8 * len(text)
