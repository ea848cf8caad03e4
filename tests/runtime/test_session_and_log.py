"""The session on a manual clock, its log, and the replay: the same commands, bit for bit."""

from __future__ import annotations

import math
import struct
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from manual_clock import ManualClock
from memory import measured
from plant import Plant
from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.cli.main import main
from autopilot.errors import InputError
from autopilot.links.base import LinkError
from autopilot.links.mavlink.codec import MavlinkCodec
from autopilot.logs.own_log import read_own
from autopilot.logs.series import ReadOptions
from autopilot.logs.table import RudderSettings, table_of
from autopilot.runtime import record
from autopilot.runtime.build import build_pilot, gear_of, model_of
from autopilot.runtime.record import PAYLOAD_TYPE, Recorder, read_log, read_logs, read_packets, replay
from autopilot.runtime.session import Session
from autopilot.runtime.tick_codec import (
    HEADER,
    decode_tick,
    encode_tick,
)
from autopilot.signals import (
    AcknowledgeSample,
    AlarmEvent,
    AlarmSample,
    AlarmState,
    ConditionSample,
    HeadingSample,
    HelmCause,
    HelmSample,
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
    Siren,
    SpeedSample,
    SupervisorState,
    Tick,
    WindSample,
)
from autopilot.supervision.alarms import CATALOGUE
from autopilot.supervision.panel import FORMS
from autopilot.vessel.file import dump_vessel, load_vessel

VESSEL = load_vessel("lanxin")
ENGAGE = Order(OrderKind.HEADING, math.nan, serial=1)


class BoatLink:
    """A link to the boat in a box; `lost_at` makes it break then."""

    name = "boat"

    def __init__(self, lost_at: float = math.inf) -> None:
        self.plant = Plant(model_of(VESSEL), gear_of(VESSEL), heading_noise=0.005, rate_noise=0.003)
        self.lost_at = lost_at
        self.commands: list[RudderCommand] = []
        self.released = 0
        self.closed = False

    def fileno(self) -> int:
        return -1

    def receive(self, now: float) -> list[Sample]:
        if now >= self.lost_at:
            raise LinkError("boat: unplugged; plug it in again and start anew")
        if now > self.plant.time:
            last = self.commands[-1] if self.commands else RudderCommand(0.0, 0.0, False)
            self.plant.step(last.angle if last.engaged else 0.0, now - self.plant.time)
        return [*self.plant.sense(), SpeedSample(now, 4.6), RollSample(now, 0.01), HelmSample(now, True, "", "boat")]

    def send(self, now: float, command: RudderCommand) -> None:
        self.commands.append(command)

    def publish_tick(self, tick: Tick) -> None:
        pass

    def poll(self, now: float) -> None:
        pass

    def release(self, now: float) -> None:
        self.released += 1

    def take_packets(self) -> list[tuple[float, bytes]]:
        return []

    def close(self) -> None:
        self.closed = True


def sail_logged(path: Path, link: BoatLink, seconds: float = 20.0, law: str | None = None) -> Session:
    clock = ManualClock()
    header = {"vessel": dump_vessel(VESSEL), "law": law}
    recorder = Recorder(path, header, clock.now())
    with Session(build_pilot(VESSEL, law), [link], clock, 20.0, lambda now, tick: ENGAGE, recorder) as session:
        session.run(seconds)
    return session


@pytest.mark.parametrize("law", [None, "pid"])
def test_a_log_replays_bit_for_bit(tmp_path: Path, law: str | None) -> None:
    link = BoatLink()
    sail_logged(tmp_path / "a.tlog", link, law=law)
    log = read_log(tmp_path / "a.tlog")
    assert [tick.command for tick in log.ticks] == link.commands
    assert len(log.ticks) > 250
    result = replay(tmp_path / "a.tlog")
    assert result.identical
    assert result.ticks == len(log.ticks)


def test_two_sessions_write_the_same_ticks(tmp_path: Path) -> None:
    for name in ("a", "b"):
        sail_logged(tmp_path / f"{name}.tlog", BoatLink(), 5.0)
    first, second = (read_log(tmp_path / f"{name}.tlog").ticks for name in ("a", "b"))
    assert [encode_tick(tick) for tick in first] == [encode_tick(tick) for tick in second]


def test_a_changed_command_is_found(tmp_path: Path) -> None:
    sail_logged(tmp_path / "a.tlog", BoatLink(), 5.0)
    log = read_log(tmp_path / "a.tlog")
    recorder = Recorder(tmp_path / "b.tlog", log.header, 0.0)
    for tick in log.ticks:
        command = tick.command
        if tick.number == 50:
            command = command._replace(angle=math.nextafter(command.angle, 1.0))
        recorder.record(tick._replace(command=command), [])
    recorder.close()
    result = replay(tmp_path / "b.tlog")
    assert not result.identical
    assert result.first_difference == 50


def test_logs_put_together_replay_each_from_its_header(tmp_path: Path) -> None:
    sail_logged(tmp_path / "a.tlog", BoatLink(), 3.0)
    sail_logged(tmp_path / "b.tlog", BoatLink(), 3.0, "pid")
    joined = tmp_path / "ab.tlog"
    joined.write_bytes((tmp_path / "a.tlog").read_bytes() + (tmp_path / "b.tlog").read_bytes())
    assert [log.header["law"] for log in read_logs(joined)] == [None, "pid"]
    assert replay(joined).identical


STRANGE_HEADERS = {
    "brackets": "[" * 6000,
    "objects": '{"a":' * 3000,
    "digits": '{"part": ' + "9" * 5000 + "}",
    "no object": "[1]",
    "no text": b"\xff\xfe",
    "endless part": '{"part": 1e400}',
    "part in words": '{"part": "x"}',
    "no part": '{"part": null}',
    "part of 4000 digits": '{"part": ' + "9" * 4000 + "}",
    "part nought": '{"part": 0}',
    "true part": '{"part": true}',
    "broken part": '{"part": 2.0}',
    "listed law": '{"law": []}',
    "listed vessel": '{"vessel": ["x"]}',
    "no vessel": '{"vessel": null}',
    "endless first": '{"first": Infinity}',
    "run of brackets": '{"run": [[[]]]}',
}


@pytest.mark.parametrize("header", STRANGE_HEADERS.values(), ids=STRANGE_HEADERS)
def test_a_strange_header_is_refused_in_a_short_sentence(
    header: str | bytes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "a.tlog"
    text = header if isinstance(header, bytes) else header.encode()
    monkeypatch.setattr(record, "encode_header", lambda fields: bytes([HEADER]) + text)
    sail_logged(path, BoatLink(), 1.0)
    log = str(path)
    for command in (["replay", log], ["replay", log, "--link", "udpout:127.0.0.1:9"], ["log", "info", log]):
        assert main(command) == 2
        refusal = capsys.readouterr().err
        assert refusal.startswith(f"autopilot: {path}: the log's header is damaged: ")
        assert refusal.count("\n") == 1 and len(refusal) < 200 + len(str(path))


@pytest.mark.parametrize("later", [math.nan, math.inf, -1.4e306, 1e300, 0.2])
def test_a_tick_whose_time_the_loop_s_clock_cannot_show_is_refused(
    later: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.tlog"
    damaged = lambda tick: encode_tick(tick._replace(now=later) if tick.number == 10 else tick)  # noqa: E731
    monkeypatch.setattr(record, "encode_tick", damaged)
    sail_logged(path, BoatLink(), 1.0)
    with pytest.raises(InputError, match=r"a tick in the log is damaged: number 1\d at .* s comes behind .* s; give"):
        replay(path)


def test_an_empty_record_is_passed_over(tmp_path: Path) -> None:
    path = tmp_path / "a.tlog"
    sail_logged(path, BoatLink(), 1.0)
    empty = dialect.MAVLink_tunnel_message(0, 0, PAYLOAD_TYPE, 4, [7, 0, 0, 1] + [0] * 124)
    path.write_bytes(path.read_bytes() + bytes(8) + MavlinkCodec(1, 191).encode(empty))
    assert replay(path).identical


def test_a_torn_log_keeps_every_whole_tick(tmp_path: Path) -> None:
    sail_logged(tmp_path / "a.tlog", BoatLink(), 3.0)
    whole = (tmp_path / "a.tlog").read_bytes()
    count = len(read_log(tmp_path / "a.tlog").ticks)
    torn = tmp_path / "torn.tlog"
    for cut in range(1, 700, 13):
        torn.write_bytes(whole[:-cut])
        assert count - 3 <= len(read_log(torn).ticks) < count
        assert replay(torn).identical


@pytest.mark.parametrize(
    ("content", "sentence"),
    [(b"", "is empty"), (b"hello, this is no log at all", "not a .tlog"), (bytes(8) + b"\xfd", "no Norrbin ticks")],
)
def test_what_is_no_log_is_refused_with_a_sentence(tmp_path: Path, content: bytes, sentence: str) -> None:
    path = tmp_path / "x.tlog"
    path.write_bytes(content)
    with pytest.raises(InputError, match=sentence):
        read_log(path)


@pytest.mark.parametrize("harm", ["zeros behind", "zeros within", "one bit"])
def test_what_a_power_cut_or_a_bad_card_leaves_is_read_and_accuses_no_pilot(tmp_path: Path, harm: str) -> None:
    path = tmp_path / "a.tlog"
    sail_logged(path, BoatLink(), 5.0)
    whole, data = read_log(path).ticks, path.read_bytes()
    half = data.rindex(b"\xfd", 0, len(data) // 2)
    behind = {
        "zeros behind": bytes(4096),
        "zeros within": bytes(4096) + data[half + 4096 :],
        "one bit": data[half : half + 20] + bytes([data[half + 20] ^ 1]) + data[half + 21 :],
    }
    path.write_bytes(data[:half] + behind[harm])
    logs = read_logs(path)
    kept = [tick.number for log in logs for tick in log.ticks]
    assert kept[0] == whole[0].number
    assert harm == "zeros behind" or kept[-1] == whole[-1].number
    result = replay(path)
    assert result.identical and result.ticks >= 0.3 * len(whole)
    assert result.ticks + result.left_out == len(kept)


def test_a_missing_log_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"nowhere\.tlog: No such file"):
        read_log(tmp_path / "nowhere.tlog")


@settings(max_examples=60, deadline=None)
@given(st.binary(max_size=300))
def test_no_bytes_make_the_reader_stumble(tmp_path_factory: pytest.TempPathFactory, content: bytes) -> None:
    path = tmp_path_factory.mktemp("fuzz") / "x.tlog"
    path.write_bytes(struct.pack(">Q", 1) + content)
    try:
        read_log(path)
    except InputError as error:
        assert str(path) in str(error)


def test_a_lost_link_releases_the_rudder_and_leaves_the_log_whole(tmp_path: Path) -> None:
    link = BoatLink(lost_at=4.0)
    with pytest.raises(LinkError, match="unplugged"):
        sail_logged(tmp_path / "a.tlog", link)
    assert link.released == 1
    assert link.closed
    ticks = read_log(tmp_path / "a.tlog").ticks
    assert ticks[-1].command == link.commands[-1]
    assert ticks[-1].now > 3.8


def test_a_full_disk_stops_the_log_and_not_the_boat(tmp_path: Path) -> None:
    clock, link = ManualClock(), BoatLink()
    recorder = Recorder(Path("/dev/full"), {"vessel": "x"}, 0.0)
    with Session(build_pilot(VESSEL), [link], clock, 20.0, lambda now, tick: ENGAGE, recorder) as session:
        session.run(2.0)
    assert len(link.commands) > 20
    assert "No space left" in recorder.failed


def test_the_session_notices_silence() -> None:
    """No heading any more: the timer goes on ticking and the supervisor acts."""
    link = BoatLink()
    clock = ManualClock()
    with Session(build_pilot(VESSEL), [link], clock, 20.0, lambda now, tick: ENGAGE) as session:
        session.run(3.0)
        assert session.tick is not None
        assert session.tick.mode is Mode.ENGAGED
        link.receive = lambda now: []  # type: ignore[method-assign]
        session.run(5.0)
        assert session.tick.mode is Mode.FAILSAFE
        assert session.tick.now > 4.9
    assert link.released == 1


def test_a_log_is_a_table_for_identification(tmp_path: Path) -> None:
    sail_logged(tmp_path / "a.tlog", BoatLink(), 5.0)
    table, uses, _ = table_of(read_own(str(tmp_path / "a.tlog")), RudderSettings())
    assert uses["rudder_rad"].startswith("the pilot's estimate")
    assert set(table) == {"time_s", "heading_rad", "yaw_rate_rad_s", "roll_rad", "rudder_rad", "speed_m_s"}
    assert all(len(column) == len(table["time_s"]) > 50 for column in table.values())
    assert (table["time_s"][1:] > table["time_s"][:-1]).all()


def test_a_system_that_has_sent_nothing_of_a_log_is_refused_with_those_that_have(tmp_path: Path) -> None:
    path = str(tmp_path / "a.tlog")
    sail_logged(tmp_path / "a.tlog", BoatLink(), 5.0)
    assert read_own(path, ReadOptions(system=1)).series
    with pytest.raises(InputError, match=r"a\.tlog: holds no message of system 99; it has them of 1\."):
        read_own(path, ReadOptions(system=99))


def test_the_ticks_of_a_log_take_no_more_memory_than_its_file(tmp_path: Path) -> None:
    path = tmp_path / "a.tlog"
    sail_logged(path, BoatLink(), 20.0)
    read_log(path)
    log, taken = measured(lambda: read_log(path))
    assert taken.kept < path.stat().st_size + 50_000
    assert [tick.number for tick in log.ticks] == [*range(log.ticks[0].number, log.ticks[0].number + len(log.ticks))]
    assert repr(log.ticks[-2:]) == repr([*log.ticks][-2:])


number = st.floats(allow_nan=True, allow_infinity=True)
text = st.text(max_size=40)
plain = st.builds(
    AlarmEvent,
    st.sampled_from(sorted(CATALOGUE)),
    text,
    st.sampled_from(["", *FORMS]),
    st.none(),
    st.booleans(),
    st.booleans(),
)
events = st.builds(lambda event, because: event._replace(because=because), plain, st.one_of(st.none(), plain))
samples = st.one_of(
    st.builds(HeadingSample, number, number, st.one_of(st.none(), number), text),
    st.builds(RateSample, number, number, text),
    st.builds(RudderSample, number, number, st.booleans(), text),
    st.builds(SpeedSample, number, number, st.booleans(), text),
    st.builds(RollSample, number, number, st.one_of(st.none(), number), text),
    st.builds(HelmSample, number, st.booleans(), text, text, st.sampled_from(HelmCause)),
    st.builds(AlarmSample, number, st.one_of(st.none(), events), text),
    st.builds(PositionSample, number, number, number, text),
    st.builds(ConditionSample, number, text, st.booleans(), text, text),
    st.builds(AcknowledgeSample, number, text, text),
    st.builds(WindSample, number, number, number, text),
)


def states_of(alarms: tuple[AlarmEvent, ...]) -> st.SearchStrategy[tuple[AlarmState, ...]]:
    """The state of each alarm, or nothing."""
    return st.one_of(st.just(()), st.tuples(*[st.sampled_from(AlarmState)] * len(alarms)))


ticks = st.builds(
    Tick,
    st.integers(0, 2**32 - 1),
    number,
    st.lists(samples, max_size=5).map(tuple),
    st.builds(Order, st.sampled_from(OrderKind), number, number, number, st.integers(0, 2**32 - 1), st.booleans()),
    st.builds(NavState, *[number] * 7, st.booleans(), *[number] * 4),
    st.builds(Reference, number, number, number),
    number,
    st.builds(RudderCommand, number, number, st.booleans()),
    st.sampled_from(Mode),
    st.lists(events, max_size=3).map(tuple),
    st.sampled_from(SupervisorState),
    st.sampled_from(Siren),
).flatmap(lambda tick: st.builds(lambda alarm_states: tick._replace(alarm_states=alarm_states), states_of(tick.alarms)))


STATE = NavState(0.0, 0.0, 0.0, 4.0, 0.0, 0.0, 0.0, True)


@given(ticks)
def test_a_tick_comes_back_with_every_bit(tick: Tick) -> None:
    tick = tick._replace(command=tick.command._replace(time=tick.now))
    assert repr(decode_tick(encode_tick(tick))) == repr(tick)
    assert encode_tick(decode_tick(encode_tick(tick))) == encode_tick(tick)


@given(ticks, st.integers(1, 200))
def test_a_damaged_tick_is_one_sentence(tick: Tick, cut: int) -> None:
    record = encode_tick(tick)
    try:
        decode_tick(record[: max(1, len(record) - cut)])
    except InputError as error:
        assert "damaged" in str(error)


def test_pymavlink_opens_the_log(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MAVLINK20", "1")
    from pymavlink import mavutil

    sail_logged(tmp_path / "a.tlog", BoatLink(), 5.0)
    log = mavutil.mavlink_connection(str(tmp_path / "a.tlog"))
    names = set()
    while (message := log.recv_match(type="NAMED_VALUE_FLOAT")) is not None:
        names.add(message.name)
    log.close()
    assert names == {"psi_deg", "psi_d_deg", "rudcmd_deg", "rud_deg", "bias_deg", "mode"}
    packets = [packet for _, packet in read_packets(tmp_path / "a.tlog")]
    assert len(packets) > 100
    for packet in packets:
        peer = mavutil.mavlink.MAVLink(None, srcSystem=packet[5], srcComponent=packet[6])
        peer.seq = packet[4]
        assert peer.decode(bytearray(packet)).pack(peer) == packet
