"""Logs of a day in every format: what reading them takes in memory and processor time.

    python benchmarks/big_logs.py write FOLDER [--megabytes 150] [--only "tlog|own"]
    python benchmarks/big_logs.py measure FOLDER [--only "tlog|own"] [--command "log info"]

A boat that sails zigzags for hours, at 10 to 50 Hz, as the programs write it; the messages of an hour on the bus are
encoded once and stamped anew. Measured is a process of its own for each log: the largest resident memory, beside that
of a process which reads nothing, and processor time. Seconds are this machine's, of this day.
"""

from __future__ import annotations

import argparse
import os
import re
import shlex
import struct
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from itertools import count
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

import boat_recordings
import numpy as np
from boat_recordings import EPOCH, Boat, dataflash, every, flash_record, tlog, tlog_events, ulog, zigzag_boat
from lockstep import Lockstep
from n2k_boat import OF_FRAMES, OF_MESSAGES, Sent, sent

from autopilot.links.mavlink.frames import TlogPackets
from autopilot.links.nmea.sentences import checksum
from autopilot.logs.mcap_log import series_entries, write_mcap
from autopilot.logs.reading import read_recording
from autopilot.logs.series import shifted
from autopilot.runtime.record import PAYLOAD_TYPE, Recorder, read_log
from autopilot.vessel.file import load_vessel

PART_S = 600.0
OTHERS = {
    64: ("IMU", "QBffffffIIfBBHH", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ,EG,EA,T,GH,AH,GHz,AHz"),
    65: ("XKF1", "QBccCfffffffccce", "TimeUS,C,Roll,Pitch,Yaw,VN,VE,VD,dPD,PN,PE,PD,GX,GY,GZ,OH"),
}
"""What an ArduRover writes oftenest, beside what boat_recordings has."""


def parts() -> Iterator[Boat]:
    """Yield the boat's sailing, ten minutes at a time, without end."""
    once = zigzag_boat(PART_S)
    lasts = once.time[-1] + once.time[1]
    for number in count():
        yield once._replace(time=once.time + number * lasts)


def of_tlog(boat: Boat) -> Iterator[bytes]:
    """Yield a ground station's log: attitude at 50 Hz."""
    yield tlog(tlog_events(boat, attitude_hz=50.0))


def of_own() -> Iterator[bytes]:
    """Yield our own log: ten minutes of a pilot that turns to and fro, over and over."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run.tlog"
        steps = Lockstep(load_vessel("lanxin"), log=path)
        for turn in range(20):
            steps.engage(90.0 + 30.0 * (turn % 2))
            steps.run(30.0)
        steps.session.close()
        log, packets = read_log(path), list(TlogPackets(path.read_bytes()))
    other = [(stamp, packet) for stamp, _, packet in packets if PAYLOAD_TYPE.to_bytes(2, "little") not in packet[10:12]]
    lasts = log.ticks[-1].now - log.ticks[0].now + 0.05
    share = len(other) // len(log.ticks)
    sink = Gathering()
    recorder = Recorder(sink, log.header, log.ticks[0].now)
    for number in count():
        for at, tick in enumerate(log.ticks):
            later = number * lasts
            samples = tuple(sample._replace(time=sample.time + later) for sample in tick.samples)
            beside = [(tick.now + later, packet) for _, packet in other[at * share : (at + 1) * share]]
            recorder.record(
                tick._replace(number=number * len(log.ticks) + at, now=tick.now + later, samples=samples), beside
            )
        yield sink.taken()


class Gathering:
    """A log's bytes, kept until they are taken."""

    trouble, part_bytes, lost, dropped, path = "", None, 0, 0, Path("own")

    def __init__(self) -> None:
        self._data: list[bytes] = []

    def write(self, data: bytes, ticks: int = 1) -> None:
        """Append."""
        self._data.append(data)

    def next_part(self) -> None:
        """There is one."""

    def close(self) -> None:
        """Nothing is open."""

    def taken(self) -> bytes:
        """Return what came since the last time."""
        data, self._data = b"".join(self._data), []
        return data


def of_dataflash(boat: Boat) -> Iterator[bytes]:
    """Yield a .BIN: two IMUs at 50 Hz and two estimators at 25 beside the rest."""
    boat_recordings.FORMATS.update(OTHERS)
    yield dataflash(boat)
    for i in every(boat, 50.0):
        micros = round((boat.time[i] + 12.0) * 1.0e6)
        for which in (0, 1):
            rest = (0.0, 0.0, -9.8, 0, 0, 20.0, 1, 1, 400, 400)
            yield flash_record(64, micros, which, 0.0, 0.0, boat.rate[i], *rest)
            if i % 2 == 0:
                yield flash_record(65, micros, which, *[0] * 14)


def of_ulog(boat: Boat) -> Iterator[bytes]:
    """Yield a .ulg; but for the first part, without its head."""
    data = ulog(boat)
    if boat.time[0] == 0.0:
        yield data
        return
    place = 16
    while data[place + 2] != ord("D"):
        place += 3 + struct.unpack_from("<H", data, place)[0]
    yield data[place:]


def of_nmea(boat: Boat) -> Iterator[bytes]:
    """Yield sentences with time stamps: heading, rate and rudder at 10 Hz, speed at 1."""
    for at, i in enumerate(every(boat, 10.0)):
        degrees = np.degrees([boat.heading[i] % (2.0 * np.pi), 60.0 * boat.rate[i], boat.rudder[i]])
        bodies = [f"HEHDT,{degrees[0]:.1f},T", f"TIROT,{degrees[1]:.2f},A", f"ERRSA,{degrees[2]:.2f},A,,"]
        bodies += ["VWVHW,,T,,M,5.83,N,10.8,K"] if at % 10 == 0 else []
        for body in bodies:
            yield f"{EPOCH + boat.time[i]:.3f} ${body}*{checksum(body.encode()):02X}\r\n".encode()


def of_bus(form: str) -> Callable[[Boat], Iterator[bytes]]:
    """Return what yields a log of NMEA 2000 in one of its forms."""
    encoded: list[tuple[Sent, list[tuple[int, bytes]], bytes]] = []

    def written(boat: Boat) -> Iterator[bytes]:
        if not encoded:
            encoded.extend((each, each.frames(), each.payload()) for each in sent(boat))
        for each, frames, payload in encoded:
            now = each._replace(time=each.time + float(boat.time[0]))
            if form in OF_MESSAGES:
                yield (OF_MESSAGES[form](now, payload) + "\n").encode()
            else:
                yield b"".join((OF_FRAMES[form](now, *frame) + "\n").encode() for frame in frames)

    return written


KINDS: dict[str, Callable[[Boat], Iterator[bytes]]] = {
    "vehicle.tlog": of_tlog,
    "vehicle.BIN": of_dataflash,
    "px4.ulg": of_ulog,
    "nmea.txt": of_nmea,
    "candump.log": of_bus("candump -L"),
    "canboat.log": of_bus("canboat"),
    "yacht_devices.log": of_bus("Yacht Devices"),
}


def write(path: Path, size: int) -> None:
    """Write a log of `size` bytes."""
    if path.suffix == ".mcap":
        _write_mcap(path, size)
        return
    made = of_own() if path.name == "own.tlog" else (data for boat in parts() for data in KINDS[path.name](boat))
    with path.open("wb") as file:
        while file.tell() < size:
            file.write(next(made))


def _write_mcap(path: Path, size: int) -> None:
    with tempfile.TemporaryDirectory() as folder:
        once = Path(folder) / "once.tlog"
        once.write_bytes(tlog(tlog_events(zigzag_boat(PART_S), attitude_hz=50.0)))
        recording = read_recording(str(once))
        packed = write_mcap(Path(folder) / "once.mcap", series_entries(recording), "once")
        rounds = size // (Path(folder) / "once.mcap").stat().st_size + 1
        print(f"{rounds} times {packed} samples")
    hours = (shifted(recording, PART_S * number)._replace(began=recording.began) for number in range(rounds))
    write_mcap(path, (entry for each in hours for entry in series_entries(each)), "a day")


def measure(words: list[str]) -> tuple[float, float, int]:
    """Return peak memory [MB] and processor time [s] of `autopilot` with these words in a process of its own, and its
    exit code."""
    code = "import sys; from autopilot.cli.main import main; sys.exit(main(sys.argv[1:]))"
    child = subprocess.Popen([sys.executable, "-c", code, *words], stdout=subprocess.DEVNULL)
    _, status, usage = os.wait4(child.pid, 0)
    return usage.ru_maxrss / 1024.0, usage.ru_utime + usage.ru_stime, os.waitstatus_to_exitcode(status)


def main() -> None:
    """Write the logs, or measure what reading them takes."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("action", choices=("write", "measure"))
    parser.add_argument("folder", type=Path)
    parser.add_argument("--megabytes", type=float, default=150.0)
    parser.add_argument("--only", default="")
    parser.add_argument("--command", default="log info")
    arguments = parser.parse_args()
    arguments.folder.mkdir(exist_ok=True)
    for name in filter(re.compile(arguments.only).search, ("own.tlog", "day.mcap", *KINDS)):
        path = arguments.folder / name
        if arguments.action == "write":
            write(path, round(arguments.megabytes * 1.0e6))
        elif path.exists():
            memory, seconds, code = measure([*shlex.split(arguments.command), str(path)])
            size = path.stat().st_size / 1.0e6
            print(f"{name:20} {size:7.1f} MB {memory:8.0f} MB resident {seconds:8.1f} s  exit code {code}", flush=True)


if __name__ == "__main__":
    main()
