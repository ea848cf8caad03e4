"""Files that people have beside readable logs: each is named in one sentence that says what to do, and none hangs."""

from __future__ import annotations

import sqlite3
import struct
import zipfile
from pathlib import Path

import numpy as np
import pyarrow
import pyarrow.parquet as parquet
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from autopilot.errors import InputError
from autopilot.logs.reading import BINARY, TEXT, read_recording

GPX = '<?xml version="1.0"?>\n<gpx version="1.1"><trk><trkpt lat="57.1" lon="11.2"><time>2024-05-04T10:00:00Z</time>'
FILES: dict[str, tuple[bytes | str, str]] = {
    "a.pcap": (struct.pack("<IHHiIII", 0xA1B2C3D4, 2, 4, 0, 0, 65535, 227), "a packet capture (.pcap)"),
    "b.pcap": (struct.pack(">IHHiIII", 0xA1B23C4D, 2, 4, 0, 0, 65535, 227), "a packet capture (.pcap)"),
    "a.pcapng": (struct.pack("<III", 0x0A0D0D0A, 28, 0x1A2B3C4D), "a packet capture (.pcapng)"),
    "a.bag": (b"#ROSBAG V2.0\n\x45\0\0\0", "a ROS 1 bag (.bag)"),
    "a.blf": (b"LOGG\x90\0\0\0" + bytes(40), "a Vector CAN log (.blf)"),
    "a.mf4": (b"MDF     4.10    " + bytes(40), "a CAN log in MDF (.mf4)"),
    "00010001.DAT": (
        b"\0\x38\0\0\xff\xff\xff\xffYDVR v05" + bytes(40),
        "a Yacht Devices voyage recorder's file",
    ),
    "a.fit": (b"\x0e\x10\x43\x08\x78\0\0\0.FIT\0\0", "a Garmin activity (.fit)"),
    "a.fsh": (b"RL90 FLASH FILE\0" + bytes(9), "a Raymarine archive of waypoints and tracks (.fsh)"),
    "a.h5": (b"\x89HDF\r\n\x1a\n\0\0", "an HDF5 file"),
    "a.mat": (b"MATLAB 5.0 MAT-file" + bytes(100), "a MATLAB file (.mat)"),
    "a.xls": (b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1" + bytes(40), "a spreadsheet (.xls)"),
    "a.pdf": (b"%PDF-1.7\n%\xe2\xe3\0", "a PDF"),
    "a.png": (b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR", "a picture"),
    "a.jpg": (b"\xff\xd8\xff\xe0\0\x10JFIF", "a picture"),
    "a.gpx": (GPX, "a GPX track"),
    "b.gpx": (GPX.splitlines()[1], "a GPX track"),
    "a.kml": ('<?xml version="1.0"?>\n<kml xmlns="http://www.opengis.net/kml/2.2">', "a KML track"),
    "a.html": ("<!DOCTYPE html><html><body>", "a web page"),
    "a.xml": ('<?xml version="1.0"?><TrainingCenterDatabase>', "an XML file"),
    "exp.csv": ("!Boat,Utc,BSP,AWA\n!boat,0,1,2\n!v12.5.1\n0,45859.15310,1,6.81,2,31.35\n", "an Expedition log"),
    "garmin.csv": (
        "Sequence #,Timestamp,PGN,Name,Manufacturer,Remote Address,Local Address,Priority,Single Frame,Size,Packet\n"
        "0,486942,127508,Battery Status,Garmin,6,255,2,1,8,0x017505FF7FFFFFFF\n",
        "a Garmin CAN log",
    ),
    "can.csv": (
        "timestamp,arbitration_id,extended,remote,error,dlc,data\n1.0,0x9f11223,1,0,0,8,AQI=\n",
        "python-can's CSV",
    ),
    "savvy.csv": (
        "Time Stamp,ID,Extended,Dir,Bus,LEN,D1,D2\n1,09F11223,true,Rx,0,2,1,2,\n",
        "SavvyCAN's CSV of frames",
    ),
    "kvaser.csv": (
        "Time,Channel,ID,Flags,DLC,D0,D1\n0.01000,1,166793763,2,2,1,2\n",
        "a table of CAN frames",
    ),
    "a.trc": (";$FILEVERSION=1.1\n;$STARTTIME=40000.0\n 1) 2.5 Rx 09F11223 8 FF\n", "a PCAN trace (.trc)"),
    "a.asc": ("date Wed Apr 16 09:20:57 am 2014\nbase hex  timestamps absolute\n", "a Vector CAN log (.asc)"),
    "a.alog": ("%%%%%%%%%%%%\n%% LOG FILE:       ./a.alog\n0.1 NAV_X uSim 0\n", "a MOOS log (.alog)"),
    "opencpn.csv": (
        "# timestamp_format: EPOCH_MILLIS\nreceived_at,protocol,msg_type,source,raw_data\n17,NMEA2000,127250,a,0 1\n",
        "an OpenCPN log without NMEA 0183",
    ),
    "seasmart.txt": ("$PCDIN,01F112,0000180C,FF,01983AC800F401FD*27\n", "NMEA 2000 inside NMEA 0183 ($PCDIN, $MXPGN)"),
    "analysed.txt": ("2020-03-04T00:29:58.626 3  19 255 127251 Rate of Turn:  SID = 0;\n", "canboat's text for people"),
    "slcan.txt": (
        "T09F112238001027FF7FFF7FFC\rT09F113238FFFC0000FFFFFFFF\r",
        "what a serial CAN adapter sends (slcan)",
    ),
    "pdgy.txt": ("!PDGY,127250,255,ABAn/3//f/w=\n" * 3, "a text of messages for an iKonvert, without times"),
    "yd.txt": ("09f11223 00 10 27 ff 7f ff 7f fc\n" * 3, "a text of frames without times"),
    "a.igc": ("AXXX001\r\nHFDTE141126\r\nB1106405741400N01150400EA0001200012\r\n", "a glider's track (.igc)"),
    "influx.txt": (
        "navigation.headingTrue,context=self value=1.00000 1795000000000000000\n" * 2,
        "InfluxDB's line protocol",
    ),
    "payloads.txt": ('{"pgn":60928,"payload":[147,19,6,0]}\n', "JSON, but no messages of canboat's"),
    "ais.txt": ("!AIVDM,1,1,,B,177KQJ5000G?tO`K>RA1wUbN0TKH,0*5C\n" * 3, "a log of AIS reports"),
    "sk.log": ('1700000000123;I;{"context":"vessels.self","updates":[{"values":[]}]}\n', "a Signal K log"),
    "sk.json": ('{"updates":[{"values":[{"path":"navigation.headingTrue","value":1.2}]}]}\n', "a Signal K log"),
    "a.geojson": ('{"type": "FeatureCollection", "features": []}', "GeoJSON"),
    "a.json": ('[{"time": 1, "heading": 2}]', "JSON, but no messages of canboat's"),
    "a.ebl": (bytes(range(1, 200)) + b"\0", "an Actisense log (.ebl)"),
    "a.vdr": (bytes(range(1, 200)) + b"\0", "a voyage data recorder's file (.vdr)"),
    "a.sl2": (b"\2\0\0\0" + bytes(40), "a sonar log (.sl2)"),
    "boat.txt": (
        "#" * 60 + "\n# a boat\n\n  #\n" + "#\n" * 200 + "\nschema_version: 1\n",
        "a file of parameters, no log",
    ),
}


@pytest.mark.parametrize("name", FILES)
def test_a_file_of_a_known_kind_is_named_and_no_broken_table(tmp_path: Path, name: str) -> None:
    data, what = FILES[name]
    path = tmp_path / name
    path.write_bytes(data.encode() if isinstance(data, str) else data)
    with pytest.raises(InputError) as refusal:
        read_recording(str(path))
    said = str(refusal.value)
    assert said.startswith(f"{path}: is {what}")
    assert ", which is not read; " in said
    assert "\n" not in said and said.endswith(".") and len(said) < len(str(path)) + 300


def test_files_that_other_programs_write_are_named(tmp_path: Path) -> None:
    """SQLite, zip and Parquet as their own writers make them; a ROS 2 bag is a database with its two tables."""
    names = ("a.db3", "a.db", "a.xlsx", "a.zip", "a.parquet", "can.db")
    bag, other, sheet, zipped, table, frames = (tmp_path / name for name in names)
    can = pytest.importorskip("can", reason="python-can is not installed (extra n2k)")
    with can.SqliteWriter(str(frames)) as log:
        log.on_message_received(can.Message(arbitration_id=0x09F11223, data=bytes(8)))
    with sqlite3.connect(bag) as base:
        base.execute("CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT)")
        base.execute("CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB)")
    base.close()
    with sqlite3.connect(other) as base:
        base.execute("CREATE TABLE track(time REAL, lat REAL)")
    base.close()
    for path, inside in ((sheet, "[Content_Types].xml"), (zipped, "boat.log")):
        with zipfile.ZipFile(path, "w") as archive:
            archive.writestr(inside, "x")
    parquet.write_table(pyarrow.table({"heading": [1.0]}), table)
    expected = {
        bag: "a ROS 2 bag",
        other: "an SQLite database",
        frames: "python-can's database of frames",
        sheet: "a spreadsheet",
        zipped: "packed (zip); unpack it",
    }
    for path, what in {**expected, table: "a Parquet table"}.items():
        with pytest.raises(InputError) as refusal:
            read_recording(str(path))
        assert str(refusal.value).startswith(f"{path}: is {what}")


@pytest.mark.parametrize(
    "text",
    [
        "Dear diary,\ntoday we sailed, and it rained, and then we turned\n",
        "hello\n",
        "a;b;c\n1;2\n3\n",
        "PGN,Name\n127250,Vessel Heading,1,2\n",
    ],
)
def test_a_text_of_no_known_kind_is_called_that(tmp_path: Path, text: str) -> None:
    path = tmp_path / "a.txt"
    path.write_text(text)
    with pytest.raises(InputError) as refusal:
        read_recording(str(path))
    assert str(refusal.value).startswith(f"{path}: is text of no kind known here: its first line, '{text[:5]}")


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(kind=st.sampled_from(sorted(FILES)), seed=st.integers(0, 1 << 30), size=st.integers(1, 8000))
def test_noise_behind_any_beginning_ends_in_a_sentence(tmp_path: Path, kind: str, seed: int, size: int) -> None:
    data, _ = FILES[kind]
    begins = data.encode() if isinstance(data, str) else data
    path = tmp_path / f"noise-{kind}"
    path.write_bytes(begins[: seed % (len(begins) + 1)] + np.random.default_rng(seed).bytes(size))
    with pytest.raises(InputError) as refusal:
        read_recording(str(path))
    assert "\n" not in str(refusal.value)


def test_no_kind_is_slow_to_look_for() -> None:
    """What a pattern could go back and forth over, in the sizes that are looked at."""
    for piece in (
        b"<",
        b"<?xml ",
        b"{",
        b'{"',
        b"date ",
        b"%% ",
        b"#",
        b"# banner\n",
        b"$PCDIN",
        b"received_at",
        b"1234567890123;a;{",
        b"\n",
    ):
        for data in (piece * 70000, piece + b"a" * 70000):
            for kind in (*BINARY, *TEXT):
                assert isinstance(kind.is_it(data), bool)
