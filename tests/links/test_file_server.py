"""Files over MAVLink FTP: pymavlink's own client, and requests made by hand: lost, repeated, crowded, nonsensical."""

from __future__ import annotations

import json
import lzma
import random
import struct
from collections import deque
from types import SimpleNamespace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink import mavftp
from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.links.ground_station.file_server import (
    DATA_MAX,
    GENERAL,
    PARAMETERS,
    FileServer,
    checksum,
    metadata_files,
    metadata_messages,
)
from autopilot.links.mavlink.codec import MavlinkCodec
from autopilot.links.mavlink.frames import ComponentInformation, ComponentMetadata
from autopilot.vessel.file import load_vessel
from autopilot.vessel.parameters import parameters_of, value_of

BURST_PACKETS = 40
MOST_SESSIONS = 8
PER_TURN = 5

LONG = bytes(random.Random(1).randbytes(30_000))
FILES = {"/general.json": b'{"version":1}', "/long.bin": LONG, "/empty": b"", "/round.bin": LONG[: 80 * 50]}
HEADER = struct.Struct("<HBBBBBBI")


def sum_by_the_bit(content: bytes) -> int:
    """CRC-32 as ArduPilot's crc_crc32(0, ...) and PX4's crc32part do it, written a second time."""
    crc = 0
    for byte in content:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ (0xEDB88320 if crc & 1 else 0)
    return crc


class ClientClock:
    """The time of pymavlink's client, which asks again, and gives up, by the clock: it goes on while it waits."""

    def __init__(self) -> None:
        self.now = 0.0

    def time(self) -> float:
        return self.now

    def sleep(self, seconds: float) -> None:
        self.now += seconds


CLOCK = ClientClock()


@pytest.fixture(autouse=True)
def _client_on_our_clock(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mavftp, "time", CLOCK)


class Master:
    """Looks to mavftp like a mavutil connection; each side's packets may be lost."""

    def __init__(self, server: FileServer, loss: float = 0.0) -> None:
        self.server, self.loss, self.rng = server, loss, random.Random(4)
        self.codec = MavlinkCodec(255, 190)
        self.waiting: deque[Any] = deque()
        self.mav = SimpleNamespace(file_transfer_protocol_send=self.ask)
        self.source_system, self.source_component = 255, 190

    def ask(self, network: int, system: int, component: int, payload: Any) -> None:
        message = dialect.MAVLink_file_transfer_protocol_message(network, system, component, list(payload))
        (arrived,) = self.codec.decode(self.codec.encode(message))
        if self.rng.random() >= self.loss:
            self.on_sample(self.server.take(arrived))

    def on_sample(self, messages: list[Any]) -> None:
        boat = MavlinkCodec(1, 1)
        for message in messages:
            if self.rng.random() >= self.loss:
                self.waiting += boat.decode(boat.encode(message))

    def recv_match(self, type: Any = None, timeout: float = 0.0, **_: Any) -> Any:
        self.on_sample(self.server.due())
        if not self.waiting:
            CLOCK.sleep(timeout)
            return None
        CLOCK.sleep(0.001)
        return self.waiting.popleft()


def fetched(master: Master, path: str) -> tuple[Any, bytes]:
    client = mavftp.MAVFTP(master, 1, 1)
    got: list[bytes] = []
    client.cmd_get([path], callback=lambda file: got.append(file.read() if file else b""))
    result = client.process_ftp_reply("OpenFileRO", timeout=15)
    return result, got[0] if got else b""


@pytest.mark.parametrize("path", ["/general.json", "/long.bin", "/round.bin", "long.bin"])
def test_pymavlinks_client_fetches_every_file(path: str) -> None:
    result, content = fetched(Master(FileServer(FILES)), path)
    assert result.error_code == mavftp.FtpError.Success
    assert content == FILES["/" + path.strip("/")]


def test_pymavlinks_client_fetches_over_a_link_that_loses_a_tenth() -> None:
    _, content = fetched(Master(FileServer({"/a": LONG[:6000]}), loss=0.1), "/a")
    assert content == LONG[:6000]


def test_pymavlinks_client_lists_and_is_refused() -> None:
    master = Master(FileServer(FILES))
    client = mavftp.MAVFTP(master, 1, 1)
    client.cmd_list(["/"])
    assert {(entry.name, entry.size_b) for entry in client.list_result} == {(p[1:], len(c)) for p, c in FILES.items()}
    result, content = fetched(master, "/etc/passwd")
    assert result.error_code == mavftp.FtpError.FileNotFound and content == b""


class Peer:
    """Asks by hand."""

    def __init__(self, server: FileServer, system: int = 255) -> None:
        self.server, self.codec, self.sequence = server, MavlinkCodec(system, 190), 0

    def send(self, raw: bytes) -> list[tuple[Any, ...]]:
        message = dialect.MAVLink_file_transfer_protocol_message(0, 1, 1, list(raw + bytes(251 - len(raw))))
        (arrived,) = self.codec.decode(self.codec.encode(message))
        return [self.read(answer) for answer in self.server.take(arrived)]

    @staticmethod
    def read(answer: Any) -> tuple[Any, ...]:
        raw = bytes(answer.payload)
        header = HEADER.unpack_from(raw)
        assert len(raw) == 251 and not any(raw[HEADER.size + header[3] :])
        return (*header, raw[HEADER.size : HEADER.size + header[3]])

    def ask(self, opcode: int, data: bytes = b"", session: int = 0, offset: int = 0, size: int | None = None) -> Any:
        raw = HEADER.pack(self.sequence, session, opcode, len(data) if size is None else size, 0, 0, 0, offset) + data
        self.sequence += 2
        answers = self.send(raw)
        assert len(answers) <= 1
        return answers[0] if answers else None

    def open(self, path: bytes = b"/long.bin") -> int:
        answer = self.ask(4, path)
        assert answer[2] == 128 and answer[3] == 4
        return int(answer[1])

    def refusal(self, *arguments: Any, **more: Any) -> int:
        answer = self.ask(*arguments, **more)
        assert (answer[2], answer[3]) == (129, 1)
        return int(answer[8][0])


def test_a_burst_is_numbered_on_and_its_last_packet_says_so() -> None:
    peer = Peer(FileServer(FILES))
    session = peer.open()
    asked = peer.sequence
    assert peer.ask(15, session=session, size=DATA_MAX) is None
    packets = []
    while turn := peer.server.due():
        assert len(turn) <= PER_TURN
        packets += [peer.read(message) for message in turn]
    assert len(packets) == BURST_PACKETS
    assert [packet[0] for packet in packets] == list(range(asked + 1, asked + 1 + BURST_PACKETS))
    assert [packet[5] for packet in packets] == [0] * (BURST_PACKETS - 1) + [1]
    assert b"".join(packet[8] for packet in packets) == LONG[: BURST_PACKETS * DATA_MAX]
    assert {(packet[1], packet[2], packet[4]) for packet in packets} == {(session, 128, 15)}
    assert peer.refusal(15, session=session, offset=len(LONG), size=DATA_MAX) == 6


def test_an_answer_that_was_lost_is_given_again_and_opens_nothing_anew() -> None:
    peer = Peer(FileServer(FILES))
    raw = HEADER.pack(7, 0, 4, 9, 0, 0, 0, 0) + b"/long.bin"
    first = peer.send(raw)
    assert all(peer.send(raw) == first for _ in range(10))
    assert len(peer.server._open) == 1


def test_reads_sums_and_refusals() -> None:
    peer = Peer(FileServer(FILES))
    session = peer.open()
    assert peer.ask(5, session=session, offset=100, size=50)[8] == LONG[100:150]
    assert peer.ask(5, session=session, offset=len(LONG) - 10, size=200)[8] == LONG[-10:]
    for path, content in FILES.items():
        assert int.from_bytes(peer.ask(14, path.encode())[8], "little") == sum_by_the_bit(content) == checksum(content)
    assert peer.ask(0)[2] == 128
    assert peer.refusal(5, session=session, offset=len(LONG), size=10) == 6
    assert peer.refusal(5, session=3, size=10) == 4 and peer.refusal(15, session=3, size=10) == 4
    assert [peer.refusal(opcode, b"/x") for opcode in (6, 7, 8, 9, 10, 11, 12, 13)] == [9] * 8
    assert peer.refusal(99) == 7 and peer.refusal(3, b"/folder") == 10 and peer.refusal(3, b"/", offset=9) == 6
    assert peer.refusal(4, b"../../etc/passwd") == 10 and peer.refusal(4, b"x", size=250) == 3
    assert peer.ask(1, session=session)[2] == 128
    assert peer.refusal(1, session=session) == 4 and peer.refusal(5, session=session, size=1) == 4
    assert peer.ask(128) is None and peer.ask(129) is None, "answers of others are not answered: no ping-pong"


def test_sessions_are_each_peers_own_numbered_by_it_and_a_forgotten_one_makes_room() -> None:
    server = FileServer(FILES)
    one, other = Peer(server, 255), Peer(server, 254)
    assert one.open() == 0 and one.ask(4, b"/general.json", session=22)[1] == 22
    assert one.ask(5, session=22, size=9)[8] == FILES["/general.json"][:9]
    assert one.ask(5, session=0, size=9)[8] == LONG[:9]
    assert other.refusal(5, session=0, size=1) == 4 and other.refusal(1, session=22) == 4
    for number in range(3 * MOST_SESSIONS):
        other.ask(4, b"/long.bin", session=number)
    assert len(server._open) == MOST_SESSIONS
    assert one.refusal(5, session=22, size=1) == 4
    other.ask(2)
    assert len(server._open) == 0


def test_answers_are_numbered_on_and_repeat_what_was_asked() -> None:
    peer = Peer(FileServer(FILES))
    peer.sequence = 0xFFFF
    opened = peer.ask(4, b"/long.bin", session=3)
    # sequence, session, acknowledged, size, asked for, not a burst, padding, offset, the file's length
    assert opened == (0, 3, 128, 4, 4, 0, 0, 0, (30_000).to_bytes(4, "little"))
    peer.sequence = 10
    assert peer.ask(5, session=3, offset=100, size=2) == (11, 3, 128, 2, 5, 0, 0, 100, LONG[100:102])
    assert peer.ask(5, session=3, offset=30_000, size=2) == (13, 3, 129, 1, 5, 0, 0, 30_000, b"\x06")
    assert peer.ask(14, b"/empty") == (15, 0, 128, 4, 14, 0, 0, 0, bytes(4))
    assert peer.ask(0) == (17, 0, 128, 0, 0, 0, 0, 0, b"")
    assert peer.ask(99) == (19, 0, 129, 1, 99, 0, 0, 0, b"\x07")
    assert peer.ask(1, session=3) == (21, 3, 128, 0, 1, 0, 0, 0, b"")


def test_a_read_is_as_long_as_asked_for_and_at_most_239_bytes() -> None:
    peer = Peer(FileServer(FILES))
    peer.open()
    for size, length in ((1, 1), (238, 238), (239, 239), (240, 239), (255, 239), (0, 239)):
        assert peer.ask(5, size=size)[8] == LONG[:length]
    assert peer.ask(5, offset=29_999, size=9)[8] == LONG[-1:]
    assert peer.refusal(5, offset=30_000, size=9) == 6
    for opcode in (3, 4, 14):
        assert peer.refusal(opcode, b"/long.bin", size=240) == 3
    assert peer.ask(4, b"/long.bin", size=239)[2] == 128, "what is behind the name is nothing"
    assert peer.ask(4, b"/long.bin\0/empty")[8] == (30_000).to_bytes(4, "little"), "a name ends at a zero"


def test_the_files_are_listed_by_name_with_their_length_from_the_entry_asked_for() -> None:
    peer = Peer(FileServer(FILES))
    entries = [b"Fempty\t0\0", b"Fgeneral.json\t13\0", b"Flong.bin\t30000\0", b"Fround.bin\t4000\0"]
    for path in (b"/", b""):
        for offset in range(4):
            assert peer.ask(3, path, offset=offset)[8] == b"".join(entries[offset:])
    assert peer.refusal(3, b"/", offset=4) == 6
    # "F", a name, a tab, "1" and a zero: 239 bytes hold 23 entries of ten and no more, or one of 239
    for length, count in ((6, 23), (235, 1)):
        many = Peer(FileServer({f"/{number:0{length}d}": b"x" for number in range(30)}))
        assert len(many.ask(3, b"/")[8]) == count * (length + 4)
    assert Peer(FileServer({"/" + 236 * "a": b"x"})).refusal(3, b"/") == 6


def test_a_file_made_anew_is_the_same_while_it_is_open() -> None:
    made = iter((b"first", b"second"))
    peer = Peer(FileServer({"/now": lambda: next(made)}))
    assert peer.ask(4, b"/now")[8] == (5).to_bytes(4, "little")
    assert peer.ask(5, size=9)[8] == peer.ask(5, size=9)[8] == b"first"
    assert peer.ask(4, b"/now")[8] == (6).to_bytes(4, "little")
    assert peer.ask(5, size=9)[8] == b"second"


def bursts(peer: Peer) -> list[list[tuple[Any, ...]]]:
    turns = []
    while turn := peer.server.due():
        turns.append([peer.read(message) for message in turn])
    return turns


def test_a_burst_is_forty_packets_five_a_turn_from_where_it_was_asked_for() -> None:
    peer = Peer(FileServer(FILES))
    peer.open()
    peer.sequence = 0xFFFE
    assert peer.ask(15, offset=1000, size=100) is None
    turns = bursts(peer)
    packets = [packet for turn in turns for packet in turn]
    assert [len(turn) for turn in turns] == [5] * 8
    assert [packet[0] for packet in packets] == [0xFFFF, *range(39)]
    assert [packet[7] for packet in packets] == list(range(1000, 5000, 100))
    assert {packet[3] for packet in packets} == {100}
    peer.sequence = 2
    assert peer.ask(15, offset=29_800, size=100) is None
    (turn,) = bursts(peer)
    assert [(packet[7], packet[5]) for packet in turn] == [(29_800, 0), (29_900, 1)], "the end of the file ends it"
    peer.ask(15, offset=29_900, size=0)
    assert [packet[3] for packet in bursts(peer)[0]] == [100]
    peer.ask(15, offset=0, size=255)
    assert {packet[3] for turn in bursts(peer) for packet in turn} == {239}


def test_a_burst_ends_with_its_session_and_begins_again_when_it_is_asked_for_again() -> None:
    peer = Peer(FileServer(FILES))
    for ending, is_over in ((1, True), (2, True), (4, True), (0, False)):
        peer.open()
        peer.ask(15, size=100)
        peer.server.due()
        peer.ask(ending, b"/long.bin" if ending == 4 else b"")
        assert (bursts(peer) == []) is is_over
    raw = HEADER.pack(77, 0, 15, 100, 0, 0, 0, 0)
    peer.open()
    for _ in range(2):
        assert peer.send(raw) == []
        assert len(bursts(peer)) == 8
    peer.ask(15, size=100)
    assert peer.refusal(15, offset=30_000, size=100) == 6
    assert bursts(peer) == [], "asked beyond the end"


def test_eight_sessions_are_kept_and_the_one_not_read_for_longest_goes() -> None:
    server = FileServer(FILES)
    peer = Peer(server)
    for session in range(8):
        peer.ask(4, b"/long.bin", session=session)
    peer.ask(15, session=1, size=100)
    peer.ask(5, session=0, size=1)
    peer.ask(4, b"/empty", session=8)
    assert peer.ask(5, session=0, size=1)[2] == 128, "read of late"
    peer.ask(4, b"/empty", session=9)
    assert [session for session in range(10) if (255, 190, session) not in server._open] == [2, 3]
    peer.ask(4, b"/empty", session=10)
    other = Peer(server, 254)
    other.ask(4, b"/long.bin", session=11)
    peer.ask(2)
    assert list(server._open) == [(254, 190, 11)], "a reset ends the sessions of who asks"
    assert bursts(peer) == []


def test_of_eight_sessions_the_last_answer_is_kept() -> None:
    server = FileServer({"/now": lambda: next(made)})
    made = iter(b"%d" % number for number in range(99))
    peer = Peer(server)
    requests = [HEADER.pack(5, session, 14, 4, 0, 0, 0, 0) + b"/now" for session in range(9)]
    first = [peer.send(raw) for raw in requests]
    assert [peer.send(raw) for raw in reversed(requests[1:])] == first[:0:-1], "eight are known"
    assert peer.send(requests[0]) != first[0], "the ninth was forgotten, and the file is another by now"


def test_bursts_of_several_take_turns() -> None:
    server = FileServer(FILES)
    peers = [Peer(server, system) for system in (250, 251, 252)]
    for peer in peers:
        peer.open()
        peer.ask(15, size=80)
    got: dict[int, int] = {}
    for _ in range(6):
        for message in server.due():
            got[message.target_system] = got.get(message.target_system, 0) + 1
    assert set(got) == {250, 251, 252} and max(got.values()) - min(got.values()) <= 1


@given(st.lists(st.binary(min_size=12, max_size=251), max_size=30))
def test_nonsense_is_answered_or_not_but_never_raises(requests: list[bytes]) -> None:
    server = FileServer(FILES)
    for number, raw in enumerate(requests):
        Peer(server, 1 + number % 20).send(raw)
        assert len(server.due()) <= PER_TURN
    assert len(server._open) <= MOST_SESSIONS
    assert len(server._answers) <= MOST_SESSIONS and len(server._bursts) <= MOST_SESSIONS


def test_the_metadata_describes_every_parameter_as_the_protocols_schema_asks() -> None:
    vessel = load_vessel("lanxin")
    parameters = parameters_of(vessel)
    files = metadata_files(parameters, "0.2.0.dev1")
    general = json.loads(files[GENERAL])
    assert general["version"] == 1 and general["firmwareVersion"] == "0.2.0"
    (entry,) = general["metadataTypes"]
    assert entry == {"type": 1, "uri": f"mftp://{PARAMETERS}", "fileCrc": sum_by_the_bit(files[PARAMETERS])}
    table = json.loads(lzma.decompress(files[PARAMETERS]))
    assert set(table) == {"version", "parameters"} and table["version"] == 1
    allowed = {"name", "type", "shortDesc", "longDesc", "units", "group", "min", "max", "values", "decimalPlaces"}
    for described, parameter in zip(table["parameters"], parameters, strict=True):
        assert set(described) <= {*allowed, "rebootRequired"} and described["type"] == "Float"
        assert described["name"] == parameter.name and len(parameter.name) <= 16
        assert described["shortDesc"] and parameter.path in described["longDesc"] and described["group"]
        value = value_of(vessel, parameter)
        low, high = described.get("min"), described.get("max")
        assert (low is None or value >= low - 1e-6) and (high is None or value <= high + 1e-6)
        if "values" in described:
            assert value in [each["value"] for each in described["values"]]
    by_name = {each["name"]: each for each in table["parameters"]}
    assert by_name["BS_K1"]["units"] == "1/s" and by_name["BS_K1"]["min"] > 0.0
    assert by_name["CTL_LAW"]["rebootRequired"] and "rebootRequired" not in by_name["BS_K1"]
    assert len(files[PARAMETERS]) < 5000, "a few seconds over a telemetry radio"


@pytest.mark.parametrize("kind", [ComponentMetadata, ComponentInformation])
def test_the_messages_say_where_the_general_file_is_and_what_it_sums_to(kind: Any) -> None:
    (message,) = metadata_messages(kind.id, b"{}")
    packet = MavlinkCodec(1, 1).encode(message)
    assert f"mftp://{GENERAL}".encode() in packet
    assert int.from_bytes(packet[14:18], "little") == sum_by_the_bit(b"{}")
    assert metadata_messages(kind.id, None) == []
