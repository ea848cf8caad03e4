"""What a vehicle says of its own parameters: fetched from one that serves it as PX4 does, believed within bounds."""

from __future__ import annotations

import argparse
import json
import lzma
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from parameter_vehicle import FTP, GENERAL_URI, PARAMETERS_URI, BadLink, ParameterVehicle, converse
from pymavlink.dialects.v20 import ardupilotmega as dialect
from served_vehicle import ServedVehicle
from two_processes import free_port

from autopilot.cli import params as command
from autopilot.firmware import session
from autopilot.firmware.journal import Journal, write_journal
from autopilot.firmware.metadata import (
    EXPANDED_MOST,
    FETCH_MOST_S,
    PX4_WAIT_S,
    WAIT_S,
    Kept,
    Marks,
    MetadataDownload,
    kept_by_firmware,
)
from autopilot.firmware.protocol import Target
from autopilot.firmware.upload import Change
from autopilot.links.ground_station.file_server import FileServer, checksum, metadata_files
from autopilot.vessel.file import load_vessel
from autopilot.vessel.parameters import parameters_of

INT32, REAL32 = 6, 9
GENERAL, PARAMETERS = "/etc/extras/component_general.json.xz", "/etc/extras/parameters.json.xz"
TARGET = Target(1, 1, True)
DESCRIBED: list[dict[str, Any]] = [
    {"name": "RO_SPEED_LIM", "type": "Float", "default": -1.0, "group": "Rover", "category": "Standard"},
    {"name": "COM_HOURS", "type": "Int32", "default": 0, "volatile": True},
    {"name": "CAL_MAG0_XOFF", "type": "Float", "volatile": True, "category": "System"},
    {"name": "CAL_MAG0_YOFF", "type": "Float", "volatile": True, "readOnly": True},
    {"name": "FUSE{n}_SET", "type": "Int32", "readOnly": True, "volatile": False},
    {"name": "LONG", "longDesc": "metadata of real size: " + "".join(str(number**7) for number in range(4000))},
]
MARKS = Marks(
    frozenset({"COM_HOURS", "CAL_MAG0_XOFF", "CAL_MAG0_YOFF"}),
    frozenset({"CAL_MAG0_YOFF", "FUSE{n}_SET"}),
)


def described(parameters: list[dict[str, Any]] = DESCRIBED) -> ParameterVehicle:
    vehicle = ParameterVehicle({}, bytewise=True)
    vehicle.describe(parameters)
    return vehicle


def heard(
    vehicle: ParameterVehicle, wait_s: float = WAIT_S, limit_s: float = 60.0, **line: Any
) -> tuple[MetadataDownload, float]:
    """Return what was understood, and after how many seconds."""
    client = MetadataDownload(TARGET, wait_s)
    lines = (BadLink(seed, **{"loss": 0.0, **line}) for seed in (1, 2))
    return client, converse(client, vehicle, *lines, limit_s=limit_s)


def general(*types: Any, **others: Any) -> bytes:
    return json.dumps({"version": 1, "metadataTypes": list(types), **others}).encode()


def test_what_px4_marks_is_understood_and_its_one_session_closed() -> None:
    vehicle = described()
    client, seconds = heard(vehicle)
    assert (client.marks, client.trouble, client.is_offered) == (MARKS, "", True)
    assert vehicle.ftp.opened == [GENERAL, PARAMETERS] and vehicle.ftp.open is None
    assert len(vehicle.ftp.files[PARAMETERS]) > 20_000 and seconds < 3.0


@pytest.mark.parametrize("loss", [0.1, 0.3])
def test_a_bad_link_costs_time_and_nothing_else(loss: float) -> None:
    vehicle = described()
    client, _ = heard(vehicle, PX4_WAIT_S, loss=loss, repeat=0.1, delay_s=(0.01, 0.1))
    assert (client.marks, client.trouble) == (MARKS, "")
    assert vehicle.ftp.open is None


def test_metadata_is_found_by_the_older_component_message_too() -> None:
    vehicle = described()
    vehicle.uri = {395: GENERAL_URI}
    client, _ = heard(vehicle)
    assert client.marks == MARKS


def test_files_that_are_not_packed_are_read_too() -> None:
    vehicle = described()
    vehicle.ftp.files = {path: lzma.decompress(content) for path, content in vehicle.ftp.files.items()}
    packed = json.loads(vehicle.ftp.files[GENERAL])["metadataTypes"][1]["fileCrc"]
    client, _ = heard(vehicle)
    assert client.trouble.startswith("its file is damaged: the checksum is") and client.trouble.endswith(f"be {packed}")
    entry = {"type": 1, "uri": f"MFTP://[;comp=1]{PARAMETERS}"}
    vehicle.ftp.files[GENERAL] = general(entry)
    assert heard(vehicle)[0].marks == MARKS
    vehicle.ftp.files[GENERAL] = general({**entry, "uri": "https://px4.invalid/x", "uriFallback": PARAMETERS_URI})
    assert heard(vehicle)[0].marks == MARKS


def test_norrbin_describes_its_own_parameters_and_marks_none() -> None:
    vehicle = ParameterVehicle({})
    vehicle.uri = {397: "mftp:///general.json"}
    server = FileServer(metadata_files(parameters_of(load_vessel("lanxin")), "0.2.0"))

    def answer(raw: bytes) -> bytes:
        (reply,) = server.take(dialect.MAVLink_file_transfer_protocol_message(0, 1, 1, list(raw)))
        return bytes(reply.payload)

    vehicle.ftp.answer = answer  # type: ignore[method-assign]
    client, _ = heard(vehicle)
    assert (client.marks, client.trouble, client.is_offered) == (Marks(), "", True)


@pytest.mark.parametrize(("refuses", "most_s"), [(True, 0.2), (False, 0.5)])
def test_a_vehicle_that_offers_nothing_costs_a_fraction_of_a_second(refuses: bool, most_s: float) -> None:
    vehicle = ParameterVehicle({})
    vehicle.refuses_commands = refuses
    client, seconds = heard(vehicle)
    assert (client.marks, client.trouble, client.is_offered) == (Marks(), "", False)
    assert seconds < most_s
    assert heard(vehicle, PX4_WAIT_S)[1] < PX4_WAIT_S + 0.1


def test_a_link_too_slow_for_it_is_found_out_early_and_the_session_closed() -> None:
    vehicle = described()
    vehicle.ftp.files[PARAMETERS] += bytes(40_000)
    client, seconds = heard(vehicle, PX4_WAIT_S, delay_s=(0.7, 0.7))
    assert client.trouble == f"its metadata take more than {FETCH_MOST_S:g} s on this link"
    assert client.marks == Marks() and seconds < 20.0
    assert vehicle.ftp.open is None


def test_a_file_that_stops_coming_is_given_up() -> None:
    vehicle = described()
    answer = vehicle.ftp.answer

    def stops(raw: bytes) -> bytes:
        return answer(raw) if raw[3] != 5 or int.from_bytes(raw[8:12], "little") < 9000 else b""

    vehicle.ftp.answer = stops  # type: ignore[method-assign]
    client, seconds = heard(vehicle)
    assert client.trouble and client.marks == Marks() and seconds < 15.0
    assert vehicle.ftp.open is None


def test_somebody_else_reads_from_px4_just_now() -> None:
    vehicle = described()
    vehicle.ftp.open = b"a log"
    client, seconds = heard(vehicle)
    assert client.trouble == f"its file {GENERAL} does not come" and seconds < 1.0
    assert vehicle.ftp.open == b"a log", "another's session is left alone"


@pytest.mark.parametrize(
    ("uri", "expected"),
    [
        ("https://px4.invalid/general.json", "its address https://px4.invalid/general.json is none of MAVLink FTP"),
        ("mftp://[;comp=100]/general.json", "its address mftp://[;comp=100]/general.json is another component's"),
        ("", "is none of MAVLink FTP"),
        ("mftp://", "is none of MAVLink FTP"),
        ("mftp://" + 93 * "x", "does not come"),
        ("mftp://a b\x1b", "is none of MAVLink FTP"),
        ("mftp://nowhere", "its file /nowhere does not come"),
    ],
)
def test_a_metadata_address_that_leads_nowhere_is_reported_and_marks_nothing(uri: str, expected: str) -> None:
    vehicle = described()
    vehicle.uri = {397: uri}
    client, seconds = heard(vehicle)
    assert expected in client.trouble and client.trouble.isprintable()
    assert client.marks == Marks() and client.is_offered and seconds < 1.0


DEEP = 100_000
WRONG_GENERAL = [
    (b"", "its file: no JSON in UTF-8"),
    (b"[]", "no object of JSON"),
    (b'{"a":' * DEEP, "its file: nested deeper than 32"),
    (b'{"a":' + b"[" * 40 + b"]" * 40 + b"}", "its file: nested deeper than 32"),
    (b'{"version": NaN}', "no JSON in UTF-8"),
    (b'\xff{"version": 1}', "no JSON in UTF-8"),
    (b"{}", "version None"),
    (b'{"version": true, "metadataTypes": []}', "version True"),
    (b'{"version": 1e999, "metadataTypes": []}', "a number in it is too large"),
    (b'{"version": 4, "metadataTypes": []}', "version 4; 1 to 3"),
    (b'{"version": 1}', "'metadataTypes' in its file is no list"),
    (general("parameters"), "is no list of objects"),
    (general(), "does not describe parameters"),
    (general({"type": True, "uri": PARAMETERS_URI}), "does not describe parameters"),
    (general({"type": 1}), "address None is none of MAVLink FTP"),
    (general({"type": 1, "uri": 7}), "address 7 is none"),
    (general({"type": 1, "uri": "mftp://\ud800"}), "half of a character in it"),
    (general({"type": 1, "uri": "https://a.invalid", "uriFallback": "https://b.invalid"}), "nothing else is fetched"),
    (general({"type": 1, "uri": "mftp://[;comp=2]x"}), "another component's"),
    (general({"type": 1, "uri": GENERAL_URI}), "'parameters' in its file is no list"),
    (general({"type": 1, "uri": PARAMETERS_URI, "fileCrc": 1}), "its file is damaged: the checksum"),
    (general({"type": 1, "uri": PARAMETERS_URI, "fileCrc": "1"}), "fileCrc 1: a whole number"),
    (general({"type": 1, "uri": PARAMETERS_URI, "fileCrc": -1}), "fileCrc -1"),
    (general({"type": 1, "uri": PARAMETERS_URI, "fileCrc": 10**30}), "fileCrc 1e+30"),
    (lzma.compress(general())[:-9], "cut off"),
    (lzma.compress(general())[:20] + bytes(40), "damaged"),
    (lzma.compress(bytes(EXPANDED_MOST + 1), preset=0), "more than 8000000 bytes when expanded"),
]


@pytest.mark.parametrize(("content", "expected"), WRONG_GENERAL, ids=range(len(WRONG_GENERAL)))
def test_a_general_file_that_cannot_be_used(content: bytes, expected: str) -> None:
    vehicle = described()
    vehicle.ftp.files[GENERAL] = content
    client, _ = heard(vehicle, limit_s=200.0)
    assert expected in client.trouble and client.trouble.isprintable() and len(client.trouble) < 400
    assert client.marks == Marks() and vehicle.ftp.open is None


@pytest.mark.parametrize(
    ("entry", "expected"),
    [
        (7, "'parameters' in its file is no list of objects"),
        ({}, "None is no name of a parameter"),
        ({"name": 7}, "7 is no name"),
        ({"name": "A" * 17}, "AAAAAAAAAAAAAAAAA is no name"),
        ({"name": "\ud800"}, "half of a character in it"),
        ({"name": "\x1b[2J"}, "is no name"),
        ({"name": "A", "volatile": "yes"}, "A: volatile yes: true or false is allowed"),
        ({"name": "A", "volatile": 1}, "A: volatile 1"),
        ({"name": "A", "readOnly": None}, "A: readOnly None"),
        ({"name": "A", "readOnly": {"volatile": True}}, "A: readOnly {"),
    ],
)
def test_a_description_with_one_wrong_entry_is_not_believed_at_all(entry: Any, expected: str) -> None:
    client, _ = heard(described([{"name": "COM_HOURS", "volatile": True}, entry]))
    assert expected in client.trouble and client.trouble.isprintable()
    assert client.marks == Marks()


def test_a_server_that_lies_is_left() -> None:
    for path, size in ((GENERAL, 1_000_001), (GENERAL, 0xFFFFFFFF), (PARAMETERS, 10), (PARAMETERS, 90_000)):
        vehicle = described()
        vehicle.ftp.sizes[path] = size
        client, seconds = heard(vehicle)
        assert client.trouble and client.marks == Marks() and seconds < 5.0
        assert vehicle.ftp.open is None
    vehicle = described()
    vehicle.ftp.piece_most = 100
    assert heard(vehicle)[0].trouble == f"its file {GENERAL} does not come"
    vehicle = described()
    vehicle.ftp.sizes[GENERAL] = 0
    assert "no JSON in UTF-8" in heard(vehicle)[0].trouble


@given(
    st.binary(max_size=300)
    | st.recursive(st.none() | st.booleans() | st.floats() | st.text(), st.lists).map(json.dumps),
    st.booleans(),
    st.booleans(),
)
def test_whatever_it_serves_costs_no_more_than_the_table(content: bytes | str, packed: bool, is_general: bool) -> None:
    raw = content if isinstance(content, bytes) else b'{"version":1,"parameters":' + content.encode() + b"}"
    vehicle = described([])
    vehicle.ftp.files[GENERAL] = general({"type": 1, "uri": PARAMETERS_URI})
    vehicle.ftp.files[GENERAL if is_general else PARAMETERS] = lzma.compress(raw) if packed else raw
    client, _ = heard(vehicle)
    assert client.marks == Marks() and vehicle.ftp.open is None
    assert client.trouble or json.loads(raw)["parameters"] == []


def test_answers_to_others_are_not_taken_for_ours() -> None:
    vehicle, client = described(), MetadataDownload(TARGET)
    answer = vehicle.ftp.answer

    def and_others(raw: bytes) -> bytes:
        number = int.from_bytes(raw[:2], "little")
        for source, sequence, session_given in ((1, number + 2, 0), (1, number + 1, 3), (2, number + 1, 0)):
            head = FTP.pack(sequence, session_given, 128, 239, 5, 0, 0)
            other = dialect.MAVLink_file_transfer_protocol_message(0, 255, 0, list(head + bytes(239)))
            other._header.srcSystem, other._header.srcComponent = 1, source
            client.receive(0.0, other)
        return answer(raw)

    vehicle.ftp.answer = and_others  # type: ignore[method-assign]
    converse(client, vehicle, BadLink(1, 0.0), BadLink(2, 0.0), 60.0)
    assert client.marks == MARKS


def test_the_table_goes_before_the_mark() -> None:
    """PX4 marks every calibration as volatile; --with-calibration writes it all the same."""
    kept = {
        name: kept_by_firmware("px4", name, MARKS)
        for name in (
            "CAL_MAG0_XOFF",
            "CAL_MAG0_YOFF",
            "CAL_MAG0_ID",
            "COM_HOURS",
            "FUSE12_SET",
            "FUSE_SET",
            "RO_SPEED_LIM",
        )
    }
    assert list(kept.values()) == [
        Kept.CALIBRATION,
        Kept.READ_ONLY,
        Kept.DEVICE,
        Kept.STATE,
        Kept.READ_ONLY,
        None,
        None,
    ]
    assert kept_by_firmware("px4", "COM_HOURS") is None


class Moving(ParameterVehicle):
    """A PX4 with a counter that no table knows, which goes on each time it is looked at, and a fuse."""

    def __init__(self) -> None:
        table = {
            "COM_HOURS": (7, INT32),
            "RO_SPEED_LIM": (2.5, REAL32),
            "FUSE1_SET": (1, INT32),
            "CAL_MAG0_XOFF": (0.5, REAL32),
            "SYS_AUTOSTART": (50000, INT32),
        }
        super().__init__(table, bytewise=True)
        self.read_only = {"FUSE1_SET"}
        self.set_names: list[str] = []

    def packet(self, name: str, index: int) -> bytes:
        if name == "COM_HOURS":
            self.table[name][0] += 1
        return super().packet(name, index)

    def set(self, message: Any) -> None:
        self.set_names.append(message.param_id)
        super().set(message)


@pytest.fixture(autouse=True)
def own_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("NORRBIN_STATE", str(tmp_path / "state"))
    monkeypatch.setattr(session, "OTHERS_WAIT_S", 0.05)
    monkeypatch.setattr("autopilot.firmware.upload.SETTLE_S", 0.05)
    monkeypatch.setattr(session, "IDENTITY_WAIT_S", 0.05)


@pytest.fixture
def px4() -> Iterator[ServedVehicle]:
    served = ServedVehicle(free_port(), dialect.MAV_AUTOPILOT_PX4)
    served.vehicle = Moving()
    served.vehicle.describe(DESCRIBED)
    served.start()
    yield served
    served.stop.set()
    served.join()


def call(served: ServedVehicle, *words: str) -> int:
    parser = argparse.ArgumentParser()
    command.add_options(parser.add_subparsers().add_parser("params"))
    arguments = parser.parse_args(["params", *words, "--link", f"udpin:127.0.0.1:{served.address[1]}"])
    return int(arguments.run(arguments))


def sets(served: ServedVehicle) -> list[str]:
    assert isinstance(served.vehicle, Moving)
    return served.vehicle.set_names


def test_what_the_vehicle_marks_is_neither_written_back_nor_compared(
    px4: ServedVehicle, capsys: pytest.CaptureFixture[str]
) -> None:
    assert call(px4, "backup") == 0
    printed = capsys.readouterr()
    assert "a restore leaves 3 to the firmware: moves by itself (COM_HOURS), read only (FUSE1_SET)" in printed.out
    assert "metadata" not in printed.err and "table alone" not in printed.err
    path = str(next(Path().glob("backup-*.yaml")))
    px4.vehicle.table["FUSE1_SET"][0], px4.vehicle.table["RO_SPEED_LIM"][0] = 2, 3.5
    px4.vehicle.table["CAL_MAG0_XOFF"][0] = 0.75
    assert call(px4, "verify", path) == 6, "the speed differs"
    assert call(px4, "restore", path) == 0
    assert sets(px4) == ["RO_SPEED_LIM"]
    assert call(px4, "verify", path) == 0
    assert call(px4, "upload", path, "--dry-run") == 0
    assert "2 unchanged" in capsys.readouterr().out
    assert call(px4, "restore", path, "--with-calibration") == 0
    assert sets(px4) == ["RO_SPEED_LIM", "CAL_MAG0_XOFF"] and px4.vehicle.table["CAL_MAG0_XOFF"][0] == 0.5
    assert px4.vehicle.ftp.open is None


def test_a_journal_with_what_the_vehicle_marks_is_settled(px4: ServedVehicle) -> None:
    """An upload that could not fetch the metadata put a counter into its journal."""
    journal = Path("state") / "upload-1-1.json"
    changes = Change("COM_HOURS", INT32, 3, 4), Change("RO_SPEED_LIM", REAL32, 2.5, 3.5)
    write_journal(journal, Journal("cut.params", "yesterday", 1, "px4", "", "", changes))
    assert call(px4, "restore") == 0
    assert not sets(px4) and not journal.exists()


@pytest.mark.parametrize(
    ("uri", "expected"),
    [
        ({}, "it offers no metadata"),
        ({397: "https://px4.invalid/general.json"}, "its address https://px4.invalid/general.json is none of MAVLink"),
        ({397: "mftp://nowhere"}, "its file /nowhere does not come"),
    ],
)
def test_a_px4_without_usable_metadata_is_reported_in_one_line(
    px4: ServedVehicle, uri: dict[int, str], expected: str, capsys: pytest.CaptureFixture[str]
) -> None:
    px4.vehicle.uri = uri
    Path("mine.yaml").write_text(
        "schema_version: 2\nfirmware: px4\nframe: boat\ngroups:\n  all:\n    parameters:\n"
        "      RO_SPEED_LIM: 1.5\n      CAL_MAG0_XOFF: 9.0\n      LND_FLIGHT_T_LO: 1\n"
    )
    assert call(px4, "upload", "mine.yaml", "--no-backup") == 0
    output = capsys.readouterr()
    (line,) = (line for line in output.err.splitlines() if "move by themselves" in line)
    assert expected in line and line.endswith("the built-in table alone does.")
    assert "2 left to the firmware: moves by itself (LND_FLIGHT_T_LO), calibration (CAL_MAG0_XOFF)" in output.out
    assert sets(px4) == ["RO_SPEED_LIM"]


def test_an_ardupilot_without_metadata_is_not_reported(px4: ServedVehicle, capsys: pytest.CaptureFixture[str]) -> None:
    px4.autopilot, px4.vehicle.bytewise, px4.vehicle.uri = dialect.MAV_AUTOPILOT_ARDUPILOTMEGA, False, {}
    Path("mine.parm").write_text("RO_SPEED_LIM 1.5\n")
    assert call(px4, "upload", "mine.parm", "--no-backup") == 0
    assert "move by themselves" not in capsys.readouterr().err
    assert px4.vehicle.ftp.opened == []


def test_the_checksum_is_the_protocols() -> None:
    """As the file lies on the vehicle, or unpacked; both are met."""
    vehicle = described()
    unpacked = lzma.decompress(vehicle.ftp.files[PARAMETERS])
    for crc in (checksum(unpacked), checksum(vehicle.ftp.files[PARAMETERS])):
        vehicle.ftp.files[GENERAL] = general({"type": 1, "uri": PARAMETERS_URI, "fileCrc": crc})
        assert heard(vehicle)[0].marks == MARKS
