"""Logs of other programs: what is read is what was sailed, and what is damaged is said or refused in one sentence."""

from __future__ import annotations

import contextlib
import json
import math
import struct
from functools import cache, partial
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from boat_recordings import (
    EPOCH,
    FULL,
    Boat,
    ardupilot_parameters,
    dataflash,
    every,
    pulses,
    tlog,
    tlog_events,
    ulog,
    zigzag_boat,
)
from hypothesis import given
from hypothesis import strategies as st
from memory import measured
from n2k_boat import lines, sent
from pymavlink import DFReader, mavutil
from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.cli.main import main
from autopilot.errors import InputError
from autopilot.identification.identified import Question
from autopilot.identification.identify import identify
from autopilot.identification.ordered_rudder import slower_rudder, with_rudder_of
from autopilot.links.nmea.sentences import checksum
from autopilot.logs.mcap_log import series_entries, write_mcap
from autopilot.logs.reading import MODULES, LogOptions, ReadOptions, load_run, read_recording
from autopilot.logs.series import HEADING, PROPELLER, RATE, SHARE, SPEED, WIND_DIRECTION, WIND_SPEED, Recording
from autopilot.logs.table import (
    RudderSettings,
    Servo,
    ServoScale,
    rudder_of,
    servo_from_parameters,
    servo_from_text,
    steering_servo,
)
from autopilot.models.steering_gear import SteeringGear

BOAT = zigzag_boat()
GEAR = SteeringGear(angle_max=FULL, rate_max=math.radians(5.0))
WITH_GEAR = LogOptions(rudder=RudderSettings(at_full=FULL, gear=GEAR))


def written(folder: Path, data: bytes, name: str) -> str:
    path = folder / name
    path.write_bytes(data)
    return str(path)


@cache
def recorded(seconds: float = 120.0) -> dict[str, bytes]:
    """A boat's log in each format that somebody else writes: format -> file."""
    boat = zigzag_boat(seconds)
    table = "".join(f"{t:.2f},{h:.5f}\n" for t, h in zip(boat.time, boat.heading, strict=True))
    sentences = [f"HEHDT,{math.degrees(boat.heading[i]) % 360.0:.1f},T" for i in every(boat, 10.0)]
    telegrams = [f"{0.1 * at:.1f} ${each}*{checksum(each.encode()):02X}\r\n" for at, each in enumerate(sentences)]
    decoded = [
        {"timestamp": f"2026-07-01T12:{at // 600:02}:{at // 10 % 60:02}.{at % 10}00Z", "prio": 2, "src": 1, "dst": 255}
        | {"pgn": 127250, "fields": {"Heading": math.degrees(boat.heading[i]) % 360.0, "Reference": "True"}}
        for at, i in enumerate(every(boat, 10.0))
    ]
    texts = {
        "csv_log": "time_s,heading_rad\n" + table,
        "nmea_text": "".join(telegrams),
        "n2k_text": "\n".join(lines(sent(boat), "candump -L")),
        "n2k_json": "\n".join(map(json.dumps, decoded)),
    }
    data = {"tlog": tlog(tlog_events(boat)), "dataflash": dataflash(boat), "ulog": ulog(boat)}
    return data | {name: text.encode() for name, text in texts.items()}


@cache
def every_format() -> dict[str, bytes]:
    """The same in each format but our own. What MCAP holds is what the .tlog does."""
    data = recorded()
    with TemporaryDirectory() as folder:
        log, exported = written(Path(folder), data["tlog"], "tlog"), Path(folder, "mcap_log")
        write_mcap(exported, series_entries(read_recording(log)), "tlog")
        return {**data, "mcap_log": exported.read_bytes()}


def in_every_format(folder: Path) -> dict[str, str]:
    """Write it: format -> path."""
    return {name: written(folder, data, name) for name, data in every_format().items()}


def test_a_log_takes_few_times_the_memory_of_its_file(tmp_path: Path) -> None:
    """150 MB of a day, on a computer of 1 GB that steers beside it: lists of objects took eight to ten times as much.

    What three times more of the same takes: modules and blocks that are loaded once do not count. Of MCAP both would be
    one chunk, which is packed and looked at whole.
    """
    peaks: dict[str, list[tuple[int, int]]] = {}
    for seconds in (120.0, 360.0):
        for name, data in recorded(seconds).items():
            path = written(tmp_path, data, name)
            if name not in peaks:
                read_recording(path)
            recording, taken = measured(partial(read_recording, path))
            peaks.setdefault(name, []).append((taken.peak, Path(path).stat().st_size))
            assert recording.best(HEADING)
    times = {name: (large - small) / (more - less) for name, ((small, less), (large, more)) in peaks.items()}
    assert {name for name, each in times.items() if each > 4.0} == set(), [*times.items()]


def test_every_format_says_how_much_of_a_file_is_read(tmp_path: Path) -> None:
    paths = in_every_format(tmp_path)
    assert set(paths) == {*MODULES} - {"own_log"}
    for name, path in paths.items():
        shown: list[tuple[int, int]] = []
        assert read_recording(path, ReadOptions(progress=lambda done, total, to=shown: to.append((done, total)))).series
        shares = [done / total for done, total in shown]
        assert shares == sorted(shares) and len(shares) > 20, name
        assert shares[0] < 0.1 and shares[-1] > 0.95, (name, shares[0], shares[-1])


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "utf-32", "utf-16-le"])
def test_every_text_is_the_same_in_another_encoding_of_unicode(tmp_path: Path, encoding: str) -> None:
    paths = in_every_format(tmp_path)
    for name in ("n2k_json", "n2k_text", "nmea_text", "csv_log"):
        ours, path = read_recording(paths[name]), Path(paths[name])
        path.write_bytes(path.read_text(encoding="utf-8").encode(encoding))
        theirs = read_recording(str(path))
        assert (theirs.kind, theirs.notes) == (ours.kind, ours.notes)
        for one, other in zip(ours.series, theirs.series, strict=True):
            assert one.quantity == other.quantity and (one.values == other.values).all()


@pytest.mark.parametrize("seed", range(3))
def test_of_a_log_that_a_power_cut_ended_all_there_is_is_read(tmp_path: Path, seed: int) -> None:
    """Cut anywhere, and with the zeros that a file system leaves: never a crash, never less than there was before."""
    random, path = np.random.default_rng(seed), tmp_path / "cut"
    for name, data in every_format().items():
        path.write_bytes(data)
        whole = sum(series.time.size for series in read_recording(str(path)).series)
        for at in random.integers(len(data) // 4, len(data), 4).tolist():
            path.write_bytes(data[:at] + bytes(int(random.choice([0, 0, 100, 9000]))))
            if name == "mcap_log":  # of a chunk that is not whole nothing is
                with contextlib.suppress(InputError):
                    read_recording(str(path))
                continue
            read = sum(series.time.size for series in read_recording(str(path)).series)
            assert read > 0.97 * whole * at / len(data) - 20, (name, at)


@pytest.mark.parametrize("lost", [3, 5, 9])
def test_a_torn_end_is_said(tmp_path: Path, lost: int) -> None:
    path = tmp_path / "cut"
    for name, data in every_format().items():
        path.write_bytes(data)
        before = read_recording(str(path)).notes
        path.write_bytes(data[:-lost] if name != "csv_log" else data.rstrip(b"\n").rpartition(b",")[0])
        notes = [note for note in read_recording(str(path)).notes if note not in before]
        assert len(notes) == 1 and any(word in notes[0] for word in ("torn", "cut off", "damaged", "wrong")), (
            name,
            notes,
        )


def assert_sailed(recording: Recording, boat: Boat, tolerance: float) -> None:
    """Heading, rate and steering lie on the boat's, each at its own time."""
    for quantity, truth in ((HEADING, boat.heading), (RATE, boat.rate), (SHARE, boat.order / FULL)):
        series = recording.best(quantity)
        assert series is not None
        values = np.unwrap(series.values) if quantity == HEADING else series.values
        expected = np.interp(series.time, boat.time, truth)
        turns = math.tau * round((expected[0] - values[0]) / math.tau)
        late = series.time > 6.0
        # an order that changes between two samples of the simulation is off for that long
        wrong = np.abs(values - expected + turns * (quantity == HEADING)) > tolerance
        assert np.mean(wrong[late]) < 0.01


@pytest.mark.parametrize("v1", [False, True])
def test_a_telemetry_log_reads_as_sailed_whatever_the_radio_delays(tmp_path: Path, v1: bool) -> None:
    path = written(tmp_path, tlog(tlog_events(BOAT), jitter=0.4, v1=v1), "trial.tlog")
    recording = read_recording(path)
    assert recording.notes == ()
    assert recording.began == pytest.approx(EPOCH, abs=0.5)
    assert_sailed(recording, BOAT, 0.004)
    speed = recording.best(SPEED)
    assert speed is not None
    assert speed.source == "GLOBAL_POSITION_INT"
    np.testing.assert_allclose(speed.values, 3.0, atol=0.01)


def test_mavutil_reads_the_same_attitudes(tmp_path: Path) -> None:
    path = written(tmp_path, tlog(tlog_events(BOAT), jitter=0.4), "trial.tlog")
    peer = mavutil.mavlink_connection(path)
    found = []
    while (message := peer.recv_match(type="ATTITUDE")) is not None:
        found.append((message.time_boot_ms * 1.0e-3, message.yaw))
    peer.close()
    series = read_recording(path).of(HEADING)[0]
    np.testing.assert_allclose(series.values, [yaw for _, yaw in found])
    np.testing.assert_allclose(np.diff(series.time), np.diff([boot for boot, _ in found]), atol=1e-9)


def test_dfreader_reads_the_same_dataflash(tmp_path: Path) -> None:
    path = written(tmp_path, dataflash(BOAT), "trial.BIN")
    peer = DFReader.DFReader_binary(path)
    yaws, rates, servos = [], [], []
    while (message := peer.recv_msg()) is not None:
        if message.get_type() == "ATT":
            yaws.append(message.Yaw)
        elif message.get_type() == "STER":
            rates.append(message.TurnRate)
        elif message.get_type() == "RCOU":
            servos.append(message.C3)
    peer.close()
    recording = read_recording(path)
    np.testing.assert_allclose(np.degrees(recording.of(HEADING)[0].values), yaws)
    np.testing.assert_allclose(np.degrees(recording.of(RATE)[0].values), rates, rtol=1e-6)
    np.testing.assert_array_equal(pulses(recording.of(SHARE)[0].values * FULL), servos)
    assert recording.began == pytest.approx(315_964_800 + 2400 * 604_800 + 100 - 18, abs=0.01)


def test_a_dataflash_log_reads_as_sailed(tmp_path: Path) -> None:
    recording = read_recording(written(tmp_path, dataflash(BOAT), "trial.BIN"))
    assert recording.notes == ()
    assert_sailed(recording, BOAT, 0.004)
    speed = recording.best(SPEED)
    assert speed is not None
    assert set(speed.values) == {3.0}, "the second receiver's speed stays out"


@pytest.mark.parametrize("kind", ["tlog", "BIN"])
def test_the_boat_is_identified_from_a_servo_log_through_the_steering_gear(tmp_path: Path, kind: str) -> None:
    data = tlog(tlog_events(BOAT), jitter=0.2) if kind == "tlog" else dataflash(BOAT)
    run = load_run(written(tmp_path, data, f"trial.{kind}"), options=WITH_GEAR)
    assert any("through the steering gear of the vessel file" in note for note in run.notes)
    model = identify([run], Question("nomoto")).model
    assert model.gain == pytest.approx(0.2, rel=0.02)
    assert model.time_constant == pytest.approx(5.0, rel=0.03)


def test_without_the_steering_gear_the_log_gives_a_slower_boat_and_says_so(tmp_path: Path) -> None:
    path = written(tmp_path, tlog(tlog_events(BOAT)), "trial.tlog")
    run = load_run(path, options=LogOptions(rudder=RudderSettings(at_full=FULL)))
    assert any("taken to stand where it was ordered" in note for note in run.notes)
    assert identify([run], Question("nomoto")).model.time_constant > 5.5


def test_headings_come_seldomer_than_the_rudder_s_orders_and_the_orders_all_count(tmp_path: Path) -> None:
    """Over a radio attitudes come twice a second, and the rudder has gone over before the next one."""
    boat = zigzag_boat(K=0.35, T=2.0, rudder_rate=math.radians(12.0))
    path = written(tmp_path, tlog(tlog_events(boat, attitude_hz=2.0)), "seldom.tlog")
    run = load_run(path, options=LogOptions(rudder=RudderSettings(at_full=FULL)))
    found = slower_rudder([run], math.inf)
    assert found is not None
    assert found.rate == pytest.approx(math.radians(12.0), rel=0.1)
    model = identify([with_rudder_of(run, found)]).model
    assert model.gain == pytest.approx(0.35, rel=0.02)
    assert model.time_constant == pytest.approx(2.0, rel=0.05)


def test_a_reversed_servo_is_turned_round_by_its_parameter(tmp_path: Path) -> None:
    values = ardupilot_parameters(is_reversed=True)
    path = written(tmp_path, tlog(tlog_events(BOAT, parameters=values)), "trial.tlog")
    share = read_recording(path).of(SHARE)[0]
    straight = read_recording(written(tmp_path, tlog(tlog_events(BOAT)), "b.tlog")).of(SHARE)[0]
    np.testing.assert_allclose(share.values, -straight.values)


def test_a_px4_vehicle_tells_its_servo_bytewise(tmp_path: Path) -> None:
    def bytewise(value: int) -> float:
        return float(struct.unpack("<f", struct.pack("<i", value))[0])

    parameters = {"PWM_MAIN_FUNC3": 201, "PWM_MAIN_MIN3": 1000, "PWM_MAIN_MAX3": 2000, "PWM_MAIN_REV": 0b100}

    def events() -> object:
        yield 0.0, dialect.MAVLink_heartbeat_message(dialect.MAV_TYPE_SURFACE_BOAT, 12, 129, 0, 4, 3)
        for name, value in parameters.items():
            kind = dialect.MAV_PARAM_TYPE_INT32
            yield 0.0, dialect.MAVLink_param_value_message(name.encode(), bytewise(value), kind, 4, 0)
        yield from (event for event in tlog_events(BOAT, parameters={}) if event[1].get_type() != "HEARTBEAT")

    share = read_recording(written(tmp_path, tlog(events()), "px4.tlog")).of(SHARE)[0]  # type: ignore[arg-type]
    expected = -(pulses(np.interp(share.time, BOAT.time, BOAT.order)) - 1500.0) / 500.0
    assert np.mean(np.abs(share.values - expected) > 1.0e-9) < 0.01


def test_a_servo_that_no_parameter_names_is_asked_for(tmp_path: Path) -> None:
    path = written(tmp_path, tlog(tlog_events(BOAT, parameters={})), "trial.tlog")
    with pytest.raises(InputError, match=r"no parameter in the log says which servo steers.*--servo"):
        load_run(path)
    servo = servo_from_text("3:1120:1480:1910")
    run = load_run(path, options=WITH_GEAR._replace(reading=ReadOptions(servo=servo)))
    assert identify([run], Question("nomoto")).model.gain == pytest.approx(0.2, rel=0.02)


def test_a_share_needs_the_angle_at_full_steering(tmp_path: Path) -> None:
    path = written(tmp_path, tlog(tlog_events(BOAT)), "trial.tlog")
    with pytest.raises(InputError, match="give --vessel FILE, or the angle at full steering with --rudder-at-full-deg"):
        load_run(path)
    with pytest.raises(InputError, match="--rudder measured: the log holds none; it has servo"):
        rudder_of(read_recording(path), RudderSettings("measured"))


@pytest.mark.parametrize("kind", ["tlog", "BIN"])
def test_wind_off_the_bow_and_the_first_propeller_are_read(tmp_path: Path, kind: str) -> None:
    data = tlog(tlog_events(BOAT)) if kind == "tlog" else dataflash(BOAT)
    recording = read_recording(written(tmp_path, data, f"wind.{kind}"))
    assert set(recording.of(WIND_SPEED)[0].values) == {6.0}
    np.testing.assert_allclose(recording.of(WIND_DIRECTION)[0].values, math.radians(-30.0))
    assert set(recording.of(PROPELLER)[0].values) == {20.0}
    run = load_run(str(tmp_path / f"wind.{kind}"), options=WITH_GEAR)
    assert run.segments[0].propeller.size == run.segments[0].time.size == run.segments[0].beam_wind.size


@pytest.mark.parametrize(("centre", "trim"), [(None, 1500.0), (-1.0, 1500.0), (1450.0, 1450.0), (2500.0, 1500.0)])
def test_the_centre_of_a_px4_servo_is_its_own_where_it_has_one(centre: float | None, trim: float) -> None:
    values = {"PWM_AUX_FUNC2": 201.0, "PWM_AUX_MIN2": 1000.0, "PWM_AUX_MAX2": 2000.0, "PWM_AUX_REV": 0.0}
    if centre is not None:
        values["PWM_AUX_CENT2"] = centre
    assert servo_from_parameters("log", values) == Servo(2, 1000.0, trim, 2000.0, False)


def test_a_reboot_goes_on_behind_what_was_before(tmp_path: Path) -> None:
    first = tlog(tlog_events(zigzag_boat(40.0), boot=500.0))
    second = tlog(tlog_events(zigzag_boat(30.0), boot=3.0), began=EPOCH + 60.0)
    heading = read_recording(written(tmp_path, first + second, "trial.tlog")).of(HEADING)[0]
    assert heading.time[-1] == pytest.approx(90.0, abs=0.2)
    assert heading.longest_gap == pytest.approx(20.0, abs=0.2)


def test_a_ground_station_whose_clock_is_set_does_not_matter(tmp_path: Path) -> None:
    events = list(tlog_events(BOAT))
    half = len(events) // 2
    data = tlog(iter(events[:half])) + tlog(iter(events[half:]), began=EPOCH - 3600.0)
    recording = read_recording(written(tmp_path, data, "set.tlog"))
    assert_sailed(recording, BOAT, 0.004)
    assert recording.of(HEADING)[0].longest_gap < 0.11


def test_a_reboot_behind_which_the_ground_station_s_clock_was_set_is_reported(tmp_path: Path) -> None:
    first = tlog(tlog_events(zigzag_boat(40.0), boot=500.0), began=86400.0 * 365.0 * 40.0)
    second = tlog(tlog_events(zigzag_boat(30.0), boot=3.0))
    path = written(tmp_path, first + second, "trial.tlog")
    recording = read_recording(path)
    (note,) = recording.notes
    assert note.startswith(f"{path}: its clock jumps by 6001.")
    heading = recording.of(HEADING)[0]
    assert heading.time[-1] == pytest.approx(130.0, abs=0.4)
    assert recording.began is not None
    assert recording.began + heading.time[-1] == pytest.approx(EPOCH + 30.0, abs=0.4)


def test_messages_of_another_time_are_left_out_and_counted(tmp_path: Path) -> None:
    data = bytearray(dataflash(BOAT))
    places = [place for place in range(len(data)) if data[place : place + 3] == b"\xa3\x95\x21"]
    for place in places[5:8]:
        data[place + 3 : place + 11] = struct.pack("<Q", 10**18 + place)
    path = written(tmp_path, bytes(data), "boat.BIN")
    recording = read_recording(path)
    assert recording.notes[0].startswith(f"{path}: 6 of "), "heading and roll of three messages"
    assert_sailed(recording, BOAT, 0.01)


def test_two_attitudes_are_too_few_and_said(tmp_path: Path) -> None:
    events = [event for event in tlog_events(BOAT) if event[0] < 0.11]
    path = written(tmp_path, tlog(iter(events)), "short.tlog")
    with pytest.raises(InputError, match="holds no two speeds; merge them in from another log"):
        load_run(path, options=WITH_GEAR)


def test_a_rudder_that_turns_the_wrong_way_is_refused_by_name(tmp_path: Path) -> None:
    path = written(tmp_path, tlog(tlog_events(BOAT)), "trial.tlog")
    swapped = LogOptions(rudder=RudderSettings(at_full=-FULL, gear=GEAR))
    with pytest.raises(InputError, match=r"--reverse-rudder|opposite"):
        identify([load_run(path, options=swapped)], Question("nomoto"))


def test_a_message_with_fields_newer_than_the_reader_is_stepped_over(tmp_path: Path) -> None:
    future = b"\xa3\x95\x80" + struct.pack("<BB4s16s64s", 77, 12, b"NEW", b"Q\x7f", b"TimeUS,Odd")
    record = b"\xa3\x95" + bytes([77]) + bytes(9)
    recording = read_recording(written(tmp_path, future + record * 3 + dataflash(BOAT), "future.BIN"))
    assert recording.notes == ()
    assert_sailed(recording, BOAT, 0.004)


def test_of_several_vehicles_the_most_talkative_or_the_chosen_one_is_read(tmp_path: Path) -> None:
    mine, other = tlog(tlog_events(BOAT), system=7), tlog(tlog_events(zigzag_boat(30.0)), system=2)
    path = written(tmp_path, other + mine, "fleet.tlog")
    recording = read_recording(path)
    assert recording.of(HEADING)[0].time[-1] == pytest.approx(120.0, abs=0.2)
    assert any("system 7 is read; it has attitudes of 2 too" in note for note in recording.notes)
    chosen = read_recording(path, ReadOptions(system=2))
    assert chosen.of(HEADING)[0].time[-1] == pytest.approx(30.0, abs=0.2)
    with pytest.raises(InputError, match=r"no ATTITUDE of system 9; it has them of 2, 7\."):
        read_recording(path, ReadOptions(system=9))


def test_messages_that_nobody_knows_are_stepped_over(tmp_path: Path) -> None:
    unknown = struct.pack(">Q", int(EPOCH * 1e6)) + b"\xfd\x03\x00\x00\x00\x01\x01\xff\xfe\xfd" + b"abc" + b"\x00\x00"
    data = tlog(tlog_events(zigzag_boat(20.0)))
    half = data.index(struct.pack(">Q", round((EPOCH + 10.0) * 1e6)))
    recording = read_recording(written(tmp_path, data[:half] + unknown * 5 + data[half:], "new.tlog"))
    assert recording.notes == ()
    assert recording.of(HEADING)[0].longest_gap < 0.11


@pytest.mark.parametrize("kind", ["tlog", "BIN"])
def test_damage_in_the_middle_is_left_out_and_reported(tmp_path: Path, kind: str) -> None:
    data = bytearray(tlog(tlog_events(BOAT)) if kind == "tlog" else dataflash(BOAT))
    middle = len(data) // 2
    data[middle : middle + 300] = np.random.default_rng(2).bytes(300)
    recording = read_recording(written(tmp_path, bytes(data), f"hurt.{kind}"))
    assert len(recording.notes) == 1
    assert "damaged and left out" in recording.notes[0]
    assert recording.of(HEADING)[0].longest_gap < 2.0
    assert_sailed(recording, BOAT, 0.004)


@pytest.mark.parametrize("kind", ["tlog", "BIN"])
def test_a_torn_end_is_left_out_and_reported(tmp_path: Path, kind: str) -> None:
    data = tlog(tlog_events(BOAT)) if kind == "tlog" else dataflash(BOAT)
    recording = read_recording(written(tmp_path, data[:-5], f"torn.{kind}"))
    assert "torn" in recording.notes[0]
    assert_sailed(recording, BOAT, 0.004)


@pytest.mark.parametrize(
    ("data", "sentence"),
    [
        (b"", "is empty"),
        (b"\x89PNG\r\n\x1a\n\x00\x00\x00\rIHDR", "is a picture, which is not read"),
        (b"\x1f\x8b\x08\x00rest", r"is packed \(gzip\)"),
        (b"PK\x03\x04rest", r"is packed \(zip\)"),
        (b"FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns\r\n", "give the .BIN that it was made from"),
        (dialect.MAVLink_heartbeat_message(11, 3, 0, 0, 4, 3).pack(dialect.MAVLink(None)) * 9, "without time stamps"),
        (tlog(iter([(0.0, dialect.MAVLink_heartbeat_message(11, 3, 0, 0, 4, 3))])), "holds no ATTITUDE of any vehicle"),
        (b"\xa3\x95\x80", "holds no ATT"),
        (b"\xa3\x95\x80" + bytes(86), "does not agree with itself|holds no ATT"),
        (b"\xa3\x95" + np.random.default_rng(0).bytes(4000), "belong to no message"),
        (struct.pack(">Q", int(EPOCH * 1e6)) + b"\xfd" + np.random.default_rng(0).bytes(4000), "belong to no MAVLink"),
    ],
)
def test_what_is_no_log_is_one_sentence(tmp_path: Path, data: bytes, sentence: str) -> None:
    path = written(tmp_path, data, "odd.log")
    with pytest.raises(InputError, match=sentence) as refusal:
        read_recording(path)
    assert str(refusal.value).startswith(path)
    assert "\n" not in str(refusal.value)


SHORT = {"tlog": tlog(tlog_events(zigzag_boat(8.0))), "BIN": dataflash(zigzag_boat(8.0))}


@given(
    kind=st.sampled_from(["tlog", "BIN"]),
    cut=st.tuples(st.integers(0, 20000), st.integers(1, 20000)),
    noise=st.binary(max_size=60),
)
def test_no_damage_raises_anything_but_a_sentence(
    tmp_path_factory: pytest.TempPathFactory, kind: str, cut: tuple[int, int], noise: bytes
) -> None:
    whole = SHORT[kind]
    start, length = cut[0] % len(whole), cut[1]
    path = written(tmp_path_factory.getbasetemp(), whole[:start] + noise + whole[start + length :], f"fuzz.{kind}")
    try:
        recording = read_recording(path)
    except InputError as error:
        assert "\n" not in str(error)
    else:
        assert all(np.isfinite(series.values).all() for series in recording.series)


@pytest.mark.parametrize(
    "text", ["", "3", "3:1:2", "3:1900:1500:1100", "x:1100:1500:1900", "17:1100:1500:1900", "3:0:5:9"]
)
def test_a_servo_that_cannot_be_is_refused(text: str) -> None:
    with pytest.raises(InputError, match=r"--servo|steering servo"):
        servo_from_text(text)


def test_info_tells_people_and_programs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = written(tmp_path, tlog(tlog_events(BOAT)), "trial.tlog")
    assert main(["log", "info", path, "--rudder-at-full-deg", "30"]) == 0
    printed = capsys.readouterr().out
    assert "MAVLink telemetry log, 120.0 s" in printed
    assert "Identification can use 11" in printed or "Identification can use 120" in printed
    assert "SERVO_OUTPUT_RAW servo 3" in printed
    assert main(["log", "info", path, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert "--rudder-at-full-deg" in found["missing"]
    attitude = next(s for s in found["series"] if s["quantity"] == "heading_rad")
    assert attitude["rate_hz"] == pytest.approx(10.0, rel=0.01)


def test_a_log_as_csv_identifies_to_the_same_model(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path, out = written(tmp_path, dataflash(BOAT), "trial.BIN"), tmp_path / "trial.csv"
    assert main(["log", "csv", path, "--rudder-at-full-deg", "30", "--out", str(out)]) == 0
    assert "Wrote 1201 rows" in capsys.readouterr().out
    direct = identify(
        [load_run(path, options=LogOptions(rudder=RudderSettings(at_full=FULL)))], Question("nomoto")
    ).model
    table = identify([load_run(str(out))], Question("nomoto")).model
    assert table.gain == pytest.approx(direct.gain, rel=1e-6)
    assert table.time_constant == pytest.approx(direct.time_constant, rel=1e-6)


def test_a_servo_s_pulses_are_read_on_the_scale_of_the_vessel_file() -> None:
    """With end points of 1100 and 1900 us, 1900 is 0.8 of a rudder that was measured at 2000."""
    logged = {"SERVO1_FUNCTION": 26.0, "SERVO1_MIN": 1100.0, "SERVO1_MAX": 1900.0, "SERVO1_REVERSED": 1.0}
    own, scaled = steering_servo("log", logged), steering_servo("log", logged, ServoScale(1000.0, 1500.0, 2000.0))
    assert own is not None
    assert scaled is not None
    pulses = np.array([1100.0, 1500.0, 1900.0])
    assert own.share(pulses) == pytest.approx([1.0, 0.0, -1.0])
    assert scaled.share(pulses) == pytest.approx([0.8, 0.0, -0.8])
    assert steering_servo("log", logged, Servo(3)) == Servo(3)
    assert steering_servo("log", {}, ServoScale(1000.0, 1500.0, 2000.0)) is None
