"""The log on a disk that is full, slow, or small; parts that are read as one; nothing of it keeps the loop waiting."""

from __future__ import annotations

import errno
import os
import resource
import threading
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from lockstep import Lockstep

from autopilot.errors import InputError
from autopilot.logs.own_log import read_own
from autopilot.logs.reading import ReadOptions, read_recording
from autopilot.logs.series import ORDER
from autopilot.runtime import log_files
from autopilot.runtime.log_files import FileSink, FolderLimits, FolderSink, ThreadedSink, appended, following_parts
from autopilot.runtime.record import Recorder, is_headless, read_log, read_logs, read_packets, replay
from autopilot.signals import Mode
from autopilot.vessel.file import dump_vessel, load_vessel

# threads and processes that keep to the wall clock
pytestmark = pytest.mark.real_time


@pytest.fixture(autouse=True)
def _closing_takes_its_time(monkeypatch: pytest.MonkeyPatch) -> None:
    """What a test reads is written, however long the machine lets the writer's thread wait."""
    monkeypatch.setattr(log_files, "CLOSING_S", 60.0)


VESSEL = load_vessel("lanxin")
HEADER = {"vessel": dump_vessel(VESSEL), "law": None}
SMALL = FolderLimits(total=100_000, part=15_000, free=0)


def sail(recorder: Recorder, seconds: float = 9.0, hook: Callable[[Lockstep], None] = lambda _: None) -> Lockstep:
    """Sail in lockstep with this log, and close it."""
    run = Lockstep(VESSEL)
    run.session._recorder = recorder
    run.hooks.append(hook)
    run.order = run.order._replace(serial=1)
    run.engage(30.0)
    run.run(seconds)
    run.session.close()
    return run


def await_writer(sink: ThreadedSink, recorder: Recorder) -> None:
    """Wait until all is written: nothing in lockstep gives the writer's thread its share of time."""
    deadline = time.monotonic() + 60.0
    while (recorder.failed or sink._queue.qsize()) and time.monotonic() < deadline:
        time.sleep(0.001)


class Disk:
    """Stands for os.write on the log: refuses while `full`, with `error`, and can hang."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.full = False
        self.error: Exception = OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        self.goes_on = threading.Event()
        self.goes_on.set()
        self._write = os.write
        monkeypatch.setattr(log_files.os, "write", self)

    def __call__(self, file: int, data: bytes) -> int:
        self.goes_on.wait(30.0)
        if self.full:
            raise self.error
        return self._write(file, data)


def test_parts_are_read_alone_and_replayed_as_one(tmp_path: Path) -> None:
    run = sail(Recorder(FolderSink(tmp_path, SMALL._replace(total=10**9)), HEADER, 0.0))
    parts = sorted(tmp_path.iterdir())
    assert len(parts) > 3
    assert following_parts(parts[0]) == parts
    (whole,) = read_logs(*parts)
    assert [tick.number for tick in whole.ticks] == [tick.number for tick in run.ticks]
    assert replay(parts[0])[:2] == (len(run.ticks), True)
    for part in parts:
        assert 14_000 < part.stat().st_size < 25_000 or part == parts[-1]
        assert read_log(part).header["vessel"] == HEADER["vessel"]
    progress: list[tuple[int, int]] = []
    replay(parts[0], lambda done, total: progress.append((done, total)))
    read, size = [done for done, total in progress if total == parts[0].stat().st_size], parts[0].stat().st_size
    assert read == sorted(read) and read[0] < 0.1 * size and 0.9 * size < read[-1] <= size
    assert progress[-1] == (len(run.ticks) - 1, len(run.ticks)), "the ticks are counted after what was read"
    listed = progress.copy()
    read_recording(str(parts[0]), ReadOptions(progress=lambda done, total: listed.append((done, total))))
    assert listed[len(progress) :] == [each for each in progress if each[1] == size], "an own log is read just so"
    first = read_log(parts[1]).ticks[0].number
    with pytest.raises(
        InputError, match=rf"begins with tick {first} of its run, .* a replay starts with the first part"
    ):
        replay(parts[1])


def test_a_change_of_the_vessel_holds_over_the_parts(tmp_path: Path) -> None:
    recorder = Recorder(FolderSink(tmp_path, SMALL._replace(total=10**9)), HEADER, 0.0)
    changed = HEADER["vessel"] + "# changed\n"  # type: ignore[operator]

    def change(run: Lockstep) -> None:
        if run.now == 6.0:
            recorder.keep_vessel(changed)

    sail(recorder, hook=change)
    parts = sorted(tmp_path.iterdir())
    assert read_log(parts[-1]).header["vessel"] == changed
    (whole,) = read_logs(*parts)
    assert list(whole.changes.values()) == [changed]


@pytest.mark.parametrize("hours", [9.0, -9.0])
def test_a_change_of_the_vessel_is_stamped_as_its_ticks_whatever_the_wall_clock_does(
    hours: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    recorder = Recorder(tmp_path / "run.tlog", HEADER, 0.0)
    clock = time.time

    def change(run: Lockstep) -> None:
        if run.now == 2.0:
            monkeypatch.setattr("time.time", lambda: clock() + 3600.0 * hours)
            recorder.keep_vessel("name: changed\n")

    sail(recorder, 4.0, hook=change)
    stamps = [stamp for stamp, _ in read_packets(tmp_path / "run.tlog")]
    assert max(stamps) - min(stamps) < 5.0


def test_a_folder_stays_below_its_size_and_other_files_are_left_alone(tmp_path: Path) -> None:
    (tmp_path / "holiday.tlog").write_bytes(bytes(150_000))
    for _ in range(4):
        sail(Recorder(FolderSink(tmp_path, SMALL), HEADER, 0.0), 6.0)
        kept = sorted(tmp_path.glob("norrbin-*"))
        assert sum(path.stat().st_size for path in kept) <= SMALL.total + 10_000  # a part ends with its tick
    assert (tmp_path / "holiday.tlog").stat().st_size == 150_000
    assert kept[-1].name.startswith("norrbin-00004-")
    assert kept[0].name > "norrbin-00002"


def test_a_link_to_a_log_that_is_gone_keeps_no_log_from_being_written(tmp_path: Path) -> None:
    folder, outside = tmp_path / "logs", tmp_path / "outside.tlog"
    folder.mkdir()
    outside.write_bytes(b"x" * 3000)
    for number, to in enumerate(("a stick that is out", str(outside)), 1):
        (folder / f"norrbin-{number:05d}-20260101T000000Z.001.tlog").symlink_to(to)
    sink = FolderSink(folder, FolderLimits(total=1500, part=1000, free=0))
    sink.write(b"y" * 900)
    sink.next_part()
    sink.write(b"z" * 900)
    sink.close()
    assert sink.trouble == "" and sink.path.read_bytes() == b"z" * 900
    assert outside.read_bytes() == b"x" * 3000


def test_a_restart_never_touches_an_earlier_log(tmp_path: Path) -> None:
    sail(Recorder(FolderSink(tmp_path), HEADER, 0.0), 3.0)
    (first,) = tmp_path.iterdir()
    content = first.read_bytes()
    sail(Recorder(FolderSink(tmp_path), HEADER, 0.0), 3.0)
    assert len(list(tmp_path.iterdir())) == 2
    assert first.read_bytes() == content


@pytest.mark.parametrize("in_parts", [False, True])
def test_when_the_disk_has_room_again_the_log_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, in_parts: bool
) -> None:
    disk = Disk(monkeypatch)
    path = tmp_path / "a.tlog"
    recorder = Recorder(FolderSink(tmp_path) if in_parts else FileSink(path), HEADER, 0.0)
    said = set()

    def fill(run: Lockstep) -> None:
        disk.full = 4.0 <= run.now < 6.5
        said.add(recorder.failed)

    run = sail(recorder, hook=fill)
    assert run.tick.mode is Mode.ENGAGED
    assert said == {"", "log stopped: No space left on device; free the disk"}
    (path,) = tmp_path.iterdir()
    before, after = read_logs(path)
    assert is_headless(after)
    assert not is_headless(before)
    numbers = [tick.number for tick in (*before.ticks, *after.ticks)]
    assert recorder.dropped == len(run.ticks) - len(numbers) > 25
    assert after.header["first"] == after.ticks[0].number == before.ticks[-1].number + recorder.dropped + 1
    assert replay(path)[:2] == (len(before.ticks), True)
    whole = read_own(str(path))
    (order,) = [each for each in whole.series if each.quantity == ORDER]
    assert order.time[0] < 2.0 and order.time[-1] > 8.9, "a log with a gap is read whole"
    assert order.longest_gap > 2.0 and f"missing in it: {recorder.dropped};" in whole.notes[0]


def test_a_record_that_fits_only_in_part_leaves_nothing_behind(tmp_path: Path) -> None:
    file = os.open(tmp_path / "a", os.O_WRONLY | os.O_CREAT | os.O_APPEND)
    assert appended(file, b"whole") is None
    before = os.write

    def filling(file: int, data: bytes) -> int:
        if data != b"torn":
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return before(file, data[:3])

    try:
        log_files.os.write = filling  # type: ignore[assignment]
        error = appended(file, b"torn")
        assert error is not None and error.errno == errno.ENOSPC
    finally:
        log_files.os.write = before  # type: ignore[assignment]
    assert appended(file, b"again") is None
    os.close(file)
    assert (tmp_path / "a").read_bytes() == b"wholeagain"


def test_a_limit_of_a_file_s_size_is_said_and_the_log_goes_on_in_another_file(tmp_path: Path) -> None:
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    try:
        sink = FileSink(tmp_path / "run.tlog")
        resource.setrlimit(resource.RLIMIT_FSIZE, (1000, hard))
        said = ""
        for number in range(5):
            sink.write(bytes([number]) * 300)
            said = said or sink.trouble
        sink.write(b"new")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    sink.close()
    assert "ulimit -f" in said and "space" not in said
    assert sink.path != tmp_path / "run.tlog" and sink.path.read_bytes().endswith(b"new")
    assert (tmp_path / "run.tlog").stat().st_size == 900, "whole records"


def test_a_limit_that_no_record_fits_in_makes_one_file_not_one_a_record(tmp_path: Path) -> None:
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    try:
        sink = FileSink(tmp_path / "run.tlog")
        resource.setrlimit(resource.RLIMIT_FSIZE, (100, hard))
        for _ in range(20):
            sink.write(bytes(300))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert "ulimit -f" in sink.trouble
    sink.write(b"again")
    sink.close()
    assert [each.read_bytes() for each in tmp_path.iterdir()] == [b"again"]


@pytest.mark.parametrize("call", ["write", "fdatasync"])
def test_a_stick_that_was_pulled_and_is_back_gets_another_file(
    call: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sink = FileSink(tmp_path / "a.tlog")
    sink.write(b"before")

    def gone(*_: object) -> None:
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    with monkeypatch.context() as pulled:
        pulled.setattr(log_files.os, call, gone)
        if call == "write":
            sink.write(b"lost")
        sink.sync()
    assert sink.trouble == "log stopped: Input/output error; look after the disk"
    assert sink.lost == (call == "write")
    sink.write(b"after")
    sink.close()
    assert (sink.trouble, sink.path.name) == ("", "a-2.tlog")
    assert ((tmp_path / "a.tlog").read_bytes(), sink.path.read_bytes()) == (b"before", b"after")


def test_a_disk_that_hangs_keeps_nobody_waiting(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    disk = Disk(monkeypatch)
    sink = ThreadedSink(FileSink(tmp_path / "a.tlog"), waiting_max=20)
    recorder = Recorder(sink, HEADER, 0.0)
    said = set()

    def hang(run: Lockstep) -> None:
        # a loop that waited for this disk would never come to the second of these
        if run.now == 3.0:
            disk.goes_on.clear()
        elif run.now >= 8.0:
            disk.goes_on.set()
            await_writer(sink, recorder)
        said.add(recorder.failed)

    run = sail(recorder, hook=hang)
    assert "log has a gap: the disk is too slow; use a faster card, or log elsewhere" in said
    logs = read_logs(tmp_path / "a.tlog")
    # one part before the gap and one behind it; more where the writer's thread fell behind before the disk hung
    assert len(logs) >= 2
    written = [tick.number for log in logs for tick in log.ticks]
    assert recorder.dropped == len(run.ticks) - len(written) > 50
    assert written == sorted(written)
    assert written[-1] == run.tick.number


@pytest.mark.parametrize("threaded", [False, True])
def test_packets_that_a_full_disk_refuses_are_no_missing_ticks(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, threaded: bool
) -> None:
    disk = Disk(monkeypatch)
    sink = FileSink(tmp_path / "a.tlog")
    recorder = Recorder(ThreadedSink(sink) if threaded else sink, HEADER, 0.0)
    run = sail(recorder, 3.0, lambda run: setattr(disk, "full", run.now > 2.9))
    missing = recorder.dropped
    assert missing == len(run.ticks) - len(read_log(tmp_path / "a.tlog").ticks)
    again = Recorder(
        ThreadedSink(FileSink(tmp_path / "b.tlog")) if threaded else FileSink(tmp_path / "b.tlog"), HEADER, 0.0
    )
    again.keep_packets([(0.0, bytes(20))])
    again.close()
    assert again.failed
    assert again.dropped == 0


def test_a_disk_that_never_answers_does_not_keep_the_end_waiting(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(log_files, "CLOSING_S", 0.1)
    disk = Disk(monkeypatch)
    recorder = Recorder(ThreadedSink(FileSink(tmp_path / "a.tlog")), HEADER, 0.0)
    disk.goes_on.clear()
    recorder.keep_packets([(0.0, bytes(20)), (0.0, bytes(20))])
    recorder.close()
    disk.goes_on.set()


@pytest.mark.parametrize(
    ("error", "said"),
    [
        (OSError(errno.ENOSPC, os.strerror(errno.ENOSPC)), "log stopped: No space left on device; free the disk"),
        (MemoryError(), "log stopped: out of memory; end other programs"),
        (RuntimeError("a mistake of ours"), "log stopped: a mistake of ours"),
    ],
)
def test_a_log_that_failed_in_its_thread_is_said_and_tried_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: Exception, said: str
) -> None:
    disk = Disk(monkeypatch)
    sink = ThreadedSink(FileSink(tmp_path / "a"), retry=0.05)
    disk.full, disk.error = True, error
    sink.write(b"lost")
    deadline = time.monotonic() + 60.0
    while not sink.trouble and time.monotonic() < deadline:
        time.sleep(0.005)
    assert sink.trouble == said
    disk.full = False
    while sink.trouble and time.monotonic() < deadline:
        sink.write(b"x")
        time.sleep(0.005)
    sink.close()
    assert set((tmp_path / "a").read_bytes()) == {ord("x")}
    assert sink.dropped >= 1


@pytest.mark.parametrize("in_parts", [False, True])
@pytest.mark.parametrize("harm", [Path.unlink, lambda path: os.truncate(path, 0)], ids=["removed", "cut"])
def test_a_log_that_is_removed_or_cut_while_steering_is_said_and_begun_anew(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, harm: Callable[[Path], None], in_parts: bool
) -> None:
    monkeypatch.setattr(log_files, "SYNC_S", 0.0)
    sink = ThreadedSink(FolderSink(tmp_path) if in_parts else FileSink(tmp_path / "a.tlog"), retry=600.0)
    recorder = Recorder(sink, HEADER, 0.0)
    deadline = time.monotonic() + 60.0
    said, begun = set(), sink.path

    def rob(run: Lockstep) -> None:
        if run.now >= 2.0 and not said - {""}:
            while not begun.stat().st_size:
                assert time.monotonic() < deadline, "nothing is written"
                time.sleep(0.005)
            harm(begun)
            while not recorder.failed and time.monotonic() < deadline:
                sink.write(b"x", 0)
                time.sleep(0.005)
            said.add(recorder.failed)
            while sink._queue.qsize() and time.monotonic() < deadline:
                time.sleep(0.005)  # what was put there before is lost with it
            sink._refused_until = 0.0
        elif said:
            await_writer(sink, recorder)

    sail(recorder, 4.0, rob)
    assert said == {log_files.REMOVED}
    assert in_parts or sink.path == (begun if harm is Path.unlink else tmp_path / "a-2.tlog")
    log = read_log(sink.path)
    assert log.header["vessel"] == HEADER["vessel"] and log.ticks[-1].now > 3.9


def test_a_log_that_grows_beyond_its_size_after_it_was_cut_is_found_out(tmp_path: Path) -> None:
    sink = FileSink(tmp_path / "a.tlog")
    sink.write(bytes(1000))
    os.truncate(sink.path, 0)
    sink.write(bytes(900))
    sink.sync()
    assert sink.trouble == log_files.REMOVED


def test_a_part_that_no_memory_was_left_for_leaves_no_gap(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    sink = FolderSink(tmp_path)
    created = FolderSink._created
    sink.write(b"first")
    sink.next_part()
    monkeypatch.setattr(FolderSink, "_created", lambda *_: (_ for _ in ()).throw(MemoryError))
    with pytest.raises(MemoryError):
        sink.write(b"lost")
    monkeypatch.setattr(FolderSink, "_created", created)
    sink.write(b"second")
    sink.close()
    (first, second) = following_parts(min(tmp_path.iterdir()))
    assert (first.read_bytes(), second.read_bytes()) == (b"first", b"second")


def test_the_log_folder_that_cannot_be_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match=r"log folder .*file: .*; give another one with --log-dir"):
        FolderSink(tmp_path / "file")
