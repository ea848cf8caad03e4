"""Logs as MCAP, Parquet and CSV, read back by the programs' own readers; and played onto links to look at."""

from __future__ import annotations

import csv
import io
import json
import math
import socket
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pyarrow.parquet as parquet
import pytest
from alarm_texts import words_of
from boat_recordings import dataflash, tlog, tlog_events, zigzag_boat
from lockstep import Lockstep
from manual_clock import ManualClock
from mcap.reader import make_reader
from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.cli.main import main
from autopilot.errors import InputError
from autopilot.links.mavlink.codec import MavlinkCodec
from autopilot.links.mavlink.signing import CountingTimestamps, LinkSigning, Signing
from autopilot.logs.mcap_log import message_entries
from autopilot.logs.replay_onto import replay_onto
from autopilot.runtime.record import read_log
from autopilot.vessel.file import load_vessel


@pytest.fixture(scope="module")
def own(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A log of a boat that engages and turns to 90 degrees."""
    path = tmp_path_factory.mktemp("logs") / "run.tlog"
    steps = Lockstep(load_vessel("lanxin"), log=path)
    steps.engage(90.0)
    steps.run(20.0)
    steps.session.close()
    return path


@pytest.fixture(scope="module")
def foreign(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A log of another program: telemetry, and among it an order."""
    path = tmp_path_factory.mktemp("logs") / "flight.tlog"
    data = tlog(tlog_events(zigzag_boat(20.0)))
    order = dialect.MAVLink_command_long_message(1, 1, dialect.MAV_CMD_COMPONENT_ARM_DISARM, 0, 1, 0, 0, 0, 0, 0, 0)
    stick = dialect.MAVLink_rc_channels_override_message(1, 1, *[1900] * 8)
    codec = MavlinkCodec(255, 190)
    path.write_bytes(data + b"".join(data[:8] + codec.encode(each) for each in (order, stick)))
    return path


def export(log: Path, to: Path, *options: str) -> str:
    assert main(["log", "export", str(log), "--to", str(to), *options]) == 0
    return str(to)


def messages(path: str) -> dict[str, list[tuple[float, dict[str, Any]]]]:
    """Every channel's messages, each checked against its schema."""
    found: dict[str, list[tuple[float, dict[str, Any]]]] = {}
    with Path(path).open("rb") as file:
        for schema, channel, message in make_reader(file).iter_messages():
            assert schema is not None and (schema.encoding, channel.message_encoding) == ("jsonschema", "json")
            content = json.loads(message.data)
            found.setdefault(channel.topic, []).append((message.log_time * 1e-9, content))
            if len(found[channel.topic]) == 1:
                wanted = json.loads(schema.data)
                jsonschema.Draft202012Validator(wanted).validate(content)
                assert set(content) == set(wanted["properties"])
    return found


def test_mcap_holds_every_tick_series_and_message_of_our_own_log(own: Path, tmp_path: Path) -> None:
    found, log = messages(export(own, tmp_path / "run.mcap")), read_log(own)
    ticks = found["/norrbin/tick"]
    assert len(ticks) == len(log.ticks)
    for (_, content), tick in zip(ticks, log.ticks, strict=True):
        assert content["rudder_rad"] == (tick.state.rudder if math.isfinite(tick.state.rudder) else None)
        assert content["mode"] == tick.mode.name and content["alarms"] == list(words_of(tick))
    assert abs(ticks[-1][1]["heading_rad"] - math.pi / 2) < 0.05
    stamps = [stamp for stamp, _ in ticks]
    assert stamps == sorted(stamps) and abs(stamps[-1] - stamps[0] - (log.ticks[-1].now - log.ticks[0].now)) < 1e-3
    yaws = [content["yaw"] for _, content in found["/mavlink/1/1/ATTITUDE"]]
    assert len(yaws) > 100 and abs(yaws[-1] - math.pi / 2) < 0.05
    assert abs(found["/mavlink/1/1/ATTITUDE"][-1][0] - stamps[-1]) < 1.0, "one clock for all"
    assert "/mavlink/1/191/NAMED_VALUE_FLOAT/psi_deg" in found and "/log/heading_rad/attitude" in found
    assert not any("TUNNEL" in topic for topic in found)


def test_parquet_and_csv_hold_the_same_table(own: Path, tmp_path: Path) -> None:
    table = parquet.read_table(export(own, tmp_path / "run.parquet"))
    text = Path(export(own, tmp_path / "run.csv")).read_text()
    rows = list(csv.DictReader(io.StringIO("".join(line for line in text.splitlines(True) if line[0] != "#"))))
    assert table.num_rows == len(rows) > 100 and table.column_names == list(rows[0])
    for name in table.column_names:
        numbers = [float(row[name]) if row[name] else math.nan for row in rows]
        kept = [math.nan if value is None else value for value in table[name].to_pylist()]
        np.testing.assert_allclose(kept, numbers, rtol=1e-9, equal_nan=True)
    assert table.schema.field("heading_rad").metadata[b"source"] == b"attitude"
    assert float(table.schema.metadata[b"began_unix_s"]) > 1.5e9


def test_logs_of_other_programs_are_exported_too(foreign: Path, tmp_path: Path) -> None:
    found = messages(export(foreign, tmp_path / "flight.mcap"))
    assert "/norrbin/tick" not in found and "/mavlink/1/1/SERVO_OUTPUT_RAW" in found
    flash = tmp_path / "flight.BIN"
    flash.write_bytes(dataflash(zigzag_boat(20.0)))
    found = messages(export(flash, tmp_path / "flash.mcap"))
    assert all(topic.startswith("/log/") for topic in found) and any("heading_rad" in topic for topic in found)
    assert parquet.read_table(export(flash, tmp_path / "flash.parquet", "--vessel", "lanxin")).num_rows > 50


def test_a_time_that_is_none_stands_at_the_ends_of_the_calendar(own: Path, tmp_path: Path) -> None:
    changed = bytearray(own.read_bytes())
    changed[:8] = b"\0" + b"\xff" * 7
    log = tmp_path / "stamps.tlog"
    log.write_bytes(changed)
    found = messages(export(log, tmp_path / "stamps.mcap"))
    assert max(stamp for channel in found.values() for stamp, _ in channel) == pytest.approx(1.8e10)


def test_what_json_has_no_number_for_is_null() -> None:
    message = dialect.MAVLink_attitude_message(1, math.nan, math.inf, 0.5, 0, 0, 0)
    files = dialect.MAVLink_file_transfer_protocol_message(0, 1, 1, [1] * 251)
    data = b"".join(bytes(8) + MavlinkCodec(1, 1).encode(each) for each in (message, files))
    attitude, transfer = message_entries(data)
    assert (attitude.content["roll"], attitude.content["pitch"], attitude.content["yaw"]) == (None, None, 0.5)
    assert transfer.content["payload"] == [1] * 251
    json.dumps([attitude.content, transfer.content], allow_nan=False)


@pytest.mark.parametrize(("to", "sentence"), [("x.mp4", "allowed are .mcap"), ("no/x.mcap", "cannot be written")])
def test_where_it_cannot_go_is_one_sentence(own: Path, tmp_path: Path, to: str, sentence: str, capsys: Any) -> None:
    assert main(["log", "export", str(own), "--to", str(tmp_path / to)]) == 2
    assert sentence in capsys.readouterr().err


@pytest.fixture
def ears() -> Any:
    made = [Ear(), Ear()]
    yield made
    for ear in made:
        ear.line.close()


class Ear:
    """Listens at a port, and remembers the messages of each kind."""

    def __init__(self) -> None:
        self.line = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.line.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 22)
        self.line.bind(("127.0.0.1", 0))
        self.line.setblocking(False)
        self.heard: list[bytes] = []

    @property
    def url(self) -> str:
        return f"udpout:127.0.0.1:{self.line.getsockname()[1]}"

    def listen(self) -> bool:
        while True:
            try:
                self.heard.append(self.line.recv(65536))
            except BlockingIOError:
                return False

    def messages(self, codec: MavlinkCodec | None = None) -> list[Any]:
        self.listen()
        codec = codec or MavlinkCodec()
        return [message for data in self.heard for message in codec.decode(data)]


def test_our_own_log_is_shown_as_the_boat_that_was_and_takes_no_orders(own: Path, ears: list[Ear]) -> None:
    ear, log, clock = ears[0], read_log(own), ManualClock()
    arm = dialect.MAVLink_command_long_message(1, 1, dialect.MAV_CMD_COMPONENT_ARM_DISARM, 0, 1, 0, 0, 0, 0, 0, 0)
    tune = dialect.MAVLink_param_set_message(1, 1, b"BS_K1", 9.0, 9)
    station, peer = MavlinkCodec(255, 190), []

    def stop() -> bool:
        if not peer and ear.heard == []:
            try:
                data, sender = ear.line.recvfrom(65536)
            except BlockingIOError:
                return False
            ear.heard.append(data)
            peer.append(sender)
            for order in (arm, tune):
                ear.line.sendto(station.encode(order), sender)
        return ear.listen()

    said = replay_onto(own, [ear.url], clock, stop)
    assert said == f"{len(log.ticks)} ticks shown"
    span = log.ticks[-1].now - log.ticks[0].now
    assert clock.now() == pytest.approx(span, abs=0.2), "at the log's own pace"
    heard = ear.messages()
    beats = [message for message in heard if message.get_type() == "HEARTBEAT"]
    assert len(beats) == pytest.approx(span, abs=3) and beats[-1].system_status == dialect.MAV_STATE_POWEROFF
    yaws = [message.yaw for message in heard if message.get_type() == "ATTITUDE"]
    assert len(yaws) > 3.5 * span and abs(yaws[-1] - log.ticks[-1].state.heading) < 0.02
    acks = [message for message in heard if message.get_type() == "COMMAND_ACK"]
    assert [each.result for each in acks] == [dialect.MAV_RESULT_DENIED]
    values = [message.param_value for message in heard if message.get_type() == "PARAM_VALUE"]
    assert values == [pytest.approx(load_vessel("lanxin").control.backstepping.k1_1_s)]  # type: ignore[union-attr]
    assert any("this is a recording" in m.text for m in heard if m.get_type() == "STATUSTEXT")


def test_a_signed_link_and_a_plotter_see_it_too(own: Path, ears: list[Ear]) -> None:
    key, (ear, plotter) = bytes(range(32)), ears
    nmea = plotter.url.replace("udpout", "nmea-udpout") + "?send=HDT:5,RSA:2"
    signing = Signing(key, CountingTimestamps(10**9))

    def stop() -> bool:
        return ear.listen() or plotter.listen()

    replay_onto(own, [ear.url, nmea], ManualClock(), stop, signing)
    judge = LinkSigning(Signing(key, CountingTimestamps()), 9)
    assert len(ear.messages(MavlinkCodec(signing=judge))) > 100
    headings = [data for data in plotter.heard if data.startswith(b"$AGHDT")]
    assert abs(float(headings[-1].split(b",")[1]) - 90.0) < 3.0
    assert not [data for data in plotter.heard if b"ROR" in data]


def test_of_another_log_what_was_for_everybody_is_sent_as_it_was(foreign: Path, ears: list[Ear]) -> None:
    ear, clock = ears[0], ManualClock()
    said = replay_onto(foreign, [ear.url], clock, ear.listen)
    heard = ear.messages()
    kinds = {message.get_type() for message in heard}
    assert {"ATTITUDE", "SERVO_OUTPUT_RAW"} <= kinds and not kinds & {"COMMAND_LONG", "RC_CHANNELS_OVERRIDE"}
    assert said == f"{len(heard)} messages sent; 2 that were addressed to somebody were left out"
    assert clock.now() == pytest.approx(20.0, abs=1.0)


@pytest.mark.parametrize(
    ("url", "sentence"),
    [
        ("nmea-udpout:127.0.0.1:9", "say what to send"),
        ("jrk:/dev/null:9600", "MAVLink and NMEA 0183 links only"),
    ],
)
def test_what_a_log_cannot_be_played_onto_is_one_sentence(own: Path, url: str, sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        replay_onto(own, [url], ManualClock(), lambda: False)


def test_other_logs_are_not_played_as_nmea(foreign: Path, tmp_path: Path, capsys: Any) -> None:
    with pytest.raises(InputError, match="only our own logs"):
        replay_onto(foreign, ["nmea-udpout:127.0.0.1:9?send=HDT"], ManualClock(), lambda: False)
    table = tmp_path / "table.csv"
    table.write_text("time_s,heading_rad\n0,1\n")
    assert main(["replay", str(table), "--link", "udpout:127.0.0.1:9"]) == 2
    assert main(["replay", str(foreign), "--link", "udpout:127.0.0.1:9", "--speed", "0"]) == 2
    assert "is no .tlog" in capsys.readouterr().err
