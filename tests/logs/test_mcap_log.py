"""MCAP read back: what was exported comes in unchanged; what others write is named by topic and schema."""

from __future__ import annotations

import builtins
import contextlib
import io
import json
import struct
from functools import partialmethod
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from boat_recordings import EPOCH, FULL, tlog, tlog_events, zigzag_boat
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.data_stream import RecordBuilder
from mcap.reader import make_reader
from mcap.records import Chunk, Footer, Header
from mcap.stream_reader import StreamReader, get_chunk_data_stream
from mcap.writer import CompressionType, Writer

from autopilot.cli.main import main
from autopilot.errors import InputError
from autopilot.identification.identified import Question
from autopilot.identification.identify import identify
from autopilot.logs import mcap_log
from autopilot.logs.mcap_log import read_mcap, series_entries, write_mcap
from autopilot.logs.reading import LogOptions, load_run, read_recording
from autopilot.logs.series import HEADING
from autopilot.logs.table import RudderSettings


@pytest.fixture(scope="module")
def both(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A log of another program, and what `log export` makes of it."""
    folder = tmp_path_factory.mktemp("mcap")
    log, exported = folder / "boat.tlog", folder / "boat.mcap"
    log.write_bytes(tlog(tlog_events(zigzag_boat(90.0))))
    assert main(["log", "export", str(log), "--to", str(exported)]) == 0
    return log, exported


def test_what_is_exported_comes_in_as_it_was(both: tuple[Path, Path]) -> None:
    before, after = read_recording(str(both[0])), read_recording(str(both[1]))
    assert after.began == pytest.approx(before.began, abs=1e-3)
    assert [(s.quantity, s.time.size) for s in after.series] == [(s.quantity, s.time.size) for s in before.series]
    for one, other in zip(before.series, after.series, strict=True):
        np.testing.assert_allclose(other.time, one.time, atol=2e-6)
        np.testing.assert_array_equal(other.values, one.values)
    (note,) = after.notes
    assert "other topics nothing is read: /mavlink/1/1/" in note
    assert "(mavlink." in note and ", json)" in note


def test_messages_lie_in_the_file_in_order_of_time_and_chunks_overlap_nowhere(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Writer, "__init__", partialmethod(Writer.__init__, chunk_size=1 << 16))
    log, exported = tmp_path / "boat.tlog", tmp_path / "boat.mcap"
    log.write_bytes(tlog(tlog_events(zigzag_boat(90.0))))
    assert main(["log", "export", str(log), "--to", str(exported)]) == 0
    reader = make_reader(io.BytesIO(exported.read_bytes()))
    summary = reader.get_summary()
    assert summary is not None and len(summary.chunk_indexes) > 3
    for before, after in pairwise(summary.chunk_indexes):
        assert before.message_end_time <= after.message_start_time
    times = [message.log_time for _, _, message in reader.iter_messages(log_time_order=False)]
    assert times == sorted(times)
    topics = [channel.topic for _, channel, _ in reader.iter_messages(log_time_order=False)]
    assert {topic.split("/")[1] for topic in topics[:200]} == {"log", "mavlink"}, "side by side, not one behind another"


@pytest.mark.parametrize("compression", CompressionType)
def test_of_a_first_chunk_that_is_cut_off_what_is_whole_is_read(
    both: tuple[Path, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, compression: CompressionType
) -> None:
    monkeypatch.setattr(
        Writer, "__init__", partialmethod(Writer.__init__, chunk_size=64 << 20, compression=compression)
    )
    whole = read_recording(str(both[0]))
    path = tmp_path / "whole.mcap"
    write_mcap(path, series_entries(whole), "boat")
    data = path.read_bytes()
    chunk = ends = len(mcap_log.HEAD)
    while ends == chunk or data[chunk] != 6:
        chunk, ends = ends, ends + 9 + int.from_bytes(data[ends + 1 : ends + 9], "little")
    cut = read_mcap("cut.mcap", data[: ends - (ends - chunk) // 10])
    for one, was in zip(cut.series, whole.series, strict=True):
        assert one.values.size > 0.8 * was.values.size, "the last blocks are lost, of zstd's of 128 KB"
        np.testing.assert_array_equal(one.values, was.values[: one.values.size])
    assert "is damaged or cut off (of a chunk of " in cut.notes[0] and " are missing); what comes" in cut.notes[0]
    with pytest.raises(InputError, match=r"without topics, damaged \(of a chunk of \d+ bytes the last \d+ are missing"):
        read_mcap("cut.mcap", data[: chunk + 60])


def test_records_of_kinds_that_are_not_known_are_passed_over(both: tuple[Path, Path], tmp_path: Path) -> None:
    """The format keeps opcodes from 0x80 on for what other programs write; also behind a chunk's last message."""
    whole = read_recording(str(both[0]))
    path = tmp_path / "whole.mcap"
    write_mcap(path, series_entries(whole), "boat")
    private, made = struct.pack("<BQ4s", 0x90, 4, b"mine"), [mcap_log.HEAD]
    for record in StreamReader(io.BytesIO(path.read_bytes()), emit_chunks=True).records:
        out = RecordBuilder()
        if isinstance(record, Chunk):
            inside, size = get_chunk_data_stream(record)
            data = inside.read(size) + private
            Chunk("", data, record.message_end_time, record.message_start_time, 0, len(data)).write(out)
            made.append(private)
        elif isinstance(record, Header | Footer):
            record.write(out)
        made.append(out.end())
    found = read_mcap("made.mcap", b"".join(made) + mcap_log.HEAD)
    assert (found.notes, len(found.series)) == ((), len(whole.series))
    at = made.index(private) + 1
    cut = read_mcap("cut.mcap", b"".join(made[:at]) + made[at][: len(made[at]) // 2])
    assert len(cut.series) > 2 and "of a chunk of " in cut.notes[0], "the first chunk, behind such a record"


def test_an_exported_log_is_identified_as_the_log_itself(both: tuple[Path, Path]) -> None:
    options = LogOptions(rudder=RudderSettings(at_full=FULL))
    found = [identify([load_run(str(path), options=options)], Question("nomoto")).model for path in both]
    assert found[1].gain == pytest.approx(found[0].gain, rel=1e-4)
    assert found[1].time_constant == pytest.approx(found[0].time_constant, rel=1e-4)


def foreign(path: Path, compression: CompressionType = CompressionType.ZSTD, samples: int = 0) -> bytes:
    """A robot's file: CDR messages of ROS, beside `samples` of ours."""
    with path.open("wb") as file:
        writer = Writer(file, compression=compression)
        writer.start(profile="ros2", library="other")
        imu = writer.register_schema("sensor_msgs/msg/Imu", "ros2msg", b"float64 x")
        ours = writer.register_schema("norrbin.Sample", "jsonschema", b"{}")
        channels = writer.register_channel("/imu/data", "cdr", imu), writer.register_channel("/x", "json", 0)
        heading = writer.register_channel("/log/heading_rad/compass", "json", ours) if samples else 0
        for second in range(20):
            when = int((EPOCH + second) * 1e9)
            writer.add_message(channels[0], when, b"\0\1\0\0" + bytes(8), when)
            writer.add_message(channels[1], when, b"{}", when)
            if second < samples:
                value = {"value": 0.1 * second if second != 3 else None}
                content = b"?" if second == 5 else json.dumps(value).encode()
                writer.add_message(heading, when, content, when)
        writer.finish()
    return path.read_bytes()


def test_another_programs_file_is_named_by_its_topics(tmp_path: Path) -> None:
    foreign(tmp_path / "robot.mcap")
    with pytest.raises(InputError) as refusal:
        read_recording(str(tmp_path / "robot.mcap"))
    said = str(refusal.value)
    assert "is an MCAP file without /log topics of norrbin.Sample, which alone are read" in said
    assert "/imu/data (sensor_msgs/msg/Imu, cdr), /x (no schema, json)" in said
    assert "\n" not in said


@pytest.mark.parametrize("compression", list(CompressionType))
def test_every_packing_is_read_and_what_is_no_number_is_counted(tmp_path: Path, compression: CompressionType) -> None:
    path = tmp_path / "robot.mcap"
    foreign(path, compression, samples=20)
    recording = read_recording(str(path))
    (series,) = recording.of(HEADING)
    assert series.source == "compass"
    np.testing.assert_allclose(series.time, [t for t in range(20) if t not in (3, 5)])
    np.testing.assert_allclose(series.values, 0.1 * series.time)
    assert recording.notes[0] == f"{path}: 1 samples are no numbers and are left out."
    assert recording.began == pytest.approx(EPOCH)


def test_a_file_that_is_cut_off_is_used_up_to_there(both: tuple[Path, Path], tmp_path: Path) -> None:
    data, path = both[1].read_bytes(), tmp_path / "torn.mcap"
    whole = read_recording(str(both[1])).of(HEADING)[0].time.size
    path.write_bytes(data[: len(data) - 400])
    assert read_recording(str(path)).of(HEADING)[0].time.size == whole
    path.write_bytes(data[:200])
    with pytest.raises(InputError, match=r"is an MCAP file without topics, damaged \("):
        read_recording(str(path))


def test_a_chunk_does_not_unpack_to_more_than_is_allowed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mcap_log, "CHUNK_MOST", 200)
    for compression in CompressionType:
        data = foreign(tmp_path / "big.mcap", compression, samples=20)
        if compression is not CompressionType.NONE:
            with pytest.raises(InputError, match=r"damaged \(a chunk of \d+ bytes\)"):
                read_mcap("big.mcap", data)


@pytest.mark.parametrize("compression", [each for each in CompressionType if each is not CompressionType.NONE])
def test_a_chunk_does_not_unpack_to_more_than_it_announces(tmp_path: Path, compression: CompressionType) -> None:
    data = bytearray(foreign(tmp_path / "big.mcap", compression, samples=20))
    chunk = data.index(compression.name.lower().encode()) - 16
    data[chunk : chunk + 8] = (100).to_bytes(8, "little")
    with pytest.raises(InputError, match=r"damaged \(a chunk that does not unpack to its 100 bytes\)"):
        read_mcap("big.mcap", bytes(data))


def test_what_only_calls_itself_mcap_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "a.mcap"
    path.write_bytes(bytes(range(256)))
    with pytest.raises(InputError, match="is no MCAP file, or its beginning is lost"):
        read_recording(str(path))
    real = builtins.__import__

    def without(name: str, *rest: Any) -> Any:
        if name.startswith("mcap"):
            raise ModuleNotFoundError(name)
        return real(name, *rest)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(InputError, match=r"reading MCAP needs mcap; install it with pip install '\.\[export\]'"):
        read_mcap("a.mcap", mcap_log.HEAD)


@settings(max_examples=150, deadline=None)
@given(place=st.integers(0, 1 << 20), noise=st.binary(min_size=1, max_size=40), cut=st.booleans())
def test_damage_raises_nothing_but_a_sentence(
    tmp_path_factory: pytest.TempPathFactory, place: int, noise: bytes, cut: bool
) -> None:
    if not SEEDS:
        folder = tmp_path_factory.mktemp("seeds")
        SEEDS.extend(foreign(folder / "a.mcap", each, samples=20) for each in CompressionType)
    data = bytearray(SEEDS[place % len(SEEDS)])
    at = place % len(data)
    data[at : at + len(noise)] = noise
    with contextlib.suppress(InputError):
        recording = read_mcap("a.mcap", bytes(data[:at] if cut else data))
        assert all(np.isfinite(each.values).all() for each in recording.series)


SEEDS: list[bytes] = []
