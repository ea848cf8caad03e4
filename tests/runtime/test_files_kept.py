"""What was written once is not lost: no log, record or backup replaces another, and what is being written is locked."""

from __future__ import annotations

import errno
import os
import stat
from collections.abc import Callable
from pathlib import Path

import pytest
from lockstep import Lockstep

from autopilot.cli.main import main
from autopilot.errors import InputError
from autopilot.files import saving
from autopilot.files.saving import (
    BackgroundSaver,
    check_folder,
    create_unused,
    replace_file,
    save_page,
    save_text,
    save_unused,
    unused_folder,
)
from autopilot.runtime import log_files
from autopilot.runtime.log_files import FileSink, FolderLimits, FolderSink, log_file
from autopilot.vessel.file import load_vessel
from sitl.cli import main as sitl


def test_a_log_takes_the_next_free_name_and_leaves_the_ones_that_are_there(tmp_path: Path) -> None:
    path = tmp_path / "zigzag.tlog"
    path.write_bytes(b"a sea trial")
    second, third = FileSink(path), FileSink(path)
    second.write(b"2")
    third.write(b"3")
    second.close()
    third.close()
    assert [each.path.name for each in (second, third)] == ["zigzag-2.tlog", "zigzag-3.tlog"]
    assert [(tmp_path / f"zigzag{number}.tlog").read_bytes() for number in ("", "-2", "-3")] == [
        b"a sea trial",
        b"2",
        b"3",
    ]


@pytest.mark.parametrize(
    "write",
    [
        lambda path: save_text(path, "schema_version: 2\n"),
        lambda path: save_page(path, "<!doctype html>"),
        lambda path: main(["log", "export", str(path.with_name("trial.tlog")), "--to", str(path), "--overwrite"]),
    ],
    ids=["text", "page", "export"],
)
def test_a_log_in_use_is_replaced_by_no_other_writer(
    tmp_path: Path, write: Callable[[Path], object], capsys: pytest.CaptureFixture[str]
) -> None:
    run = Lockstep(load_vessel("lanxin"), log=tmp_path / "trial.tlog")
    run.engage(90.0)
    run.run(10.0)
    run.session.close()
    sink = FileSink(tmp_path / "run.csv")
    try:
        code = write(sink.path)
    except InputError as error:
        code, said = 2, str(error)
    else:
        said = capsys.readouterr().err
    assert code == 2
    assert "run.csv: cannot be written" in said
    assert "a running program writes it" in said
    sink.write(b"still the log")
    sink.close()
    assert sink.path.read_bytes() == b"still the log"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["run.csv", "trial.tlog"]


def test_a_folder_of_logs_keeps_the_part_that_another_run_is_writing(tmp_path: Path) -> None:
    limits = FolderLimits(total=3_000, part=1_000, free=0)
    first = FolderSink(tmp_path, limits)
    first.write(bytes(2_500))
    others = []
    for _ in range(4):
        sink = FolderSink(tmp_path, limits)
        sink.write(bytes(1_500))
        sink.close()
        others.append(sink.path)
    assert first.path.stat().st_size == 2_500
    assert not others[0].exists()  # the folder is kept below its size by what nobody writes
    first.close()


def test_two_runs_that_begin_together_have_logs_of_their_own(tmp_path: Path) -> None:
    sinks = [FolderSink(tmp_path) for _ in range(3)]
    assert [log_files.run_number(sink.path) for sink in sinks] == [1, 2, 3]
    for sink in sinks:
        sink.close()


def test_a_pipe_without_a_reader_is_said_and_one_with_a_reader_is_written(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    with pytest.raises(InputError, match=r"log .*pipe: nobody reads this pipe; give another place with --log"):
        FileSink(pipe)
    reader = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    sink = FileSink(pipe)
    sink.write(b"log")
    assert os.read(reader, 10) == b"log"
    os.close(reader)
    sink.write(b"log")
    assert sink.trouble == "log stopped: nobody reads the pipe any more; start its reader again"
    sink.close()


def test_a_full_disk_leaves_the_old_file_and_says_that_freeing_it_is_the_cure(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "boat.yaml"
    path.write_text("good")

    def full(_: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", full)
    for write in (save_text, save_unused):
        with pytest.raises(InputError, match=r"No space left on device\); free the disk, or give a file on another"):
            write(path, "half")
    assert {each.name: each.read_text() for each in tmp_path.iterdir()} == {"boat.yaml": "good"}


def test_a_folder_that_takes_nothing_is_said_before_the_work(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    check_folder(tmp_path / "new.yaml")
    with pytest.raises(InputError, match=r"is a folder; give the name of a file"):
        check_folder(tmp_path)
    monkeypatch.setattr(os, "access", lambda path, _: Path(path) != tmp_path)
    with pytest.raises(InputError, match=r"new\.yaml: cannot be written \(Permission denied\); give another file"):
        check_folder(tmp_path / "new.yaml")
    check_folder("/dev/null")


def test_a_folder_that_is_gone_under_us_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    gone = tmp_path / "gone"
    gone.mkdir()
    monkeypatch.chdir(gone)
    gone.rmdir()
    with pytest.raises(InputError, match=r"new\.yaml: cannot be written"):
        check_folder("new.yaml")


@pytest.mark.parametrize("make", [lambda path: FileSink(path / "run.tlog"), FolderSink], ids=["file", "folder"])
def test_a_disk_that_is_full_from_the_start_is_waited_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, make: Callable[[Path], FileSink | FolderSink]
) -> None:
    really, is_full = os.open, True

    def opened(path: str | Path, flags: int, *rest: int) -> int:
        if is_full and flags & os.O_CREAT:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return really(path, flags, *rest)

    monkeypatch.setattr(os, "open", opened)
    sink = make(tmp_path)
    assert sink.trouble == "log stopped: No space left on device; free the disk"
    sink.write(b"lost")
    assert sink.trouble.startswith("log stopped: No space left on device; free the disk")
    is_full = False
    sink.write(b"kept")
    assert sink.trouble == ""
    sink.close()
    assert sink.path.read_bytes() == b"kept"
    assert sink.dropped == 1


def test_a_backup_takes_the_next_free_name(tmp_path: Path) -> None:
    names = [save_unused(tmp_path / "backup.yaml", str(number)).name for number in range(3)]
    assert names == ["backup.yaml", "backup-2.yaml", "backup-3.yaml"]
    assert [(tmp_path / name).read_text() for name in names] == ["0", "1", "2"]


def test_a_folder_of_results_is_not_written_into_again(tmp_path: Path) -> None:
    first = unused_folder(tmp_path / "demo")
    (first / "report.html").write_text("kept")
    assert [unused_folder(tmp_path / "demo").name for _ in range(2)] == ["demo-2", "demo-2"]


def test_a_name_that_leads_nowhere_is_not_followed(tmp_path: Path) -> None:
    (tmp_path / "run.tlog").symlink_to(tmp_path / "elsewhere")
    descriptor, found = create_unused(tmp_path / "run.tlog")
    os.close(descriptor)
    assert found.name == "run-2.tlog"


def test_a_report_replaces_a_page_and_nothing_else(tmp_path: Path) -> None:
    page, log = tmp_path / "page.html", tmp_path / "run.tlog"
    for text in ("<!doctype html>1", "<!doctype html>2"):
        save_page(page, text)
    assert page.read_text().endswith("2")
    log.write_bytes(bytes(100))
    with pytest.raises(InputError, match="exists already and is no page of a report"):
        save_page(log, "<!doctype html>")
    assert log.read_bytes() == bytes(100)


def test_a_table_replaces_another_only_when_ordered_to(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run = Lockstep(load_vessel("lanxin"), log=tmp_path / "run.tlog")
    run.engage(90.0)
    run.run(10.0)
    run.session.close()
    before = (tmp_path / "run.tlog").read_bytes()
    for to in ("run.tlog", "run.csv", "run.csv"):
        code = main(["log", "csv", str(tmp_path / "run.tlog"), "--out", str(tmp_path / to)])
        said = capsys.readouterr().err
        assert (code == 0) is (to == "run.csv" and not said)
    assert said.startswith(f"autopilot: {tmp_path}/run.csv: exists already; give another name, or --overwrite")
    assert main(["log", "csv", str(tmp_path / "run.tlog"), "--out", str(tmp_path / "run.csv"), "--overwrite"]) == 0
    assert (tmp_path / "run.tlog").read_bytes() == before


def test_the_records_of_the_simulated_boat_are_kept(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    serve = ["serve", "lanxin", "--mavlink", "udpout:127.0.0.1:9", "--duration", "0.2"]
    for _ in range(2):
        assert sitl([*serve, "--truth", str(tmp_path / "truth.csv")]) == 0
    assert {path.name for path in tmp_path.iterdir()} == {"truth.csv", "truth-2.csv"}
    said = capsys.readouterr().out
    assert f"{tmp_path}/truth.csv exists and is kept: the truth goes to {tmp_path}/truth-2.csv" in said


def test_a_full_disk_ends_the_record_of_the_truth_and_not_the_boat(capsys: pytest.CaptureFixture[str]) -> None:
    serve = ["serve", "lanxin", "--mavlink", "udpout:127.0.0.1:9", "--duration", "20", "--speedup", "40"]
    assert sitl([*serve, "--truth", "/dev/full"]) == 0
    assert capsys.readouterr().err.count("/dev/full ends before its time: No space left on device") == 1


def test_a_log_makes_no_folder_where_a_disk_may_not_be_mounted(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = tmp_path / "stick" / "x.tlog"
    command = ["trial", "zigzag", "lanxin", "--link", "udpin:127.0.0.1:0", "--wait", "0.5", "--log", str(log)]
    assert main(command) == 2
    error = capsys.readouterr().err
    assert f"there is no folder {log.parent}" in error
    assert f"mkdir -p {log.parent}" in error
    assert not log.parent.exists()


@pytest.mark.parametrize("name", ["x.csv", "x.BIN", "boat.yaml"])
def test_a_log_named_like_a_file_of_another_kind_is_refused(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ["run", "lanxin", "--link", "udpin:127.0.0.1:0", "--wait", "0.5", "--log", str(tmp_path / name)]
    assert main(command) == 2
    assert f"{name}: a log is a .tlog; name it so" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
    for name in ("20260504 10.15", "pipe", "RUN.TLOG"):
        log_file(tmp_path / name).close()


@pytest.mark.parametrize("number", [errno.EINVAL, errno.ENOTSUP])
def test_a_disk_without_modes_or_flushed_folders_takes_a_file(
    number: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(descriptor: int, mode: int = 0) -> None:
        if mode or stat.S_ISDIR(os.fstat(descriptor).st_mode):
            raise OSError(number, os.strerror(number))

    monkeypatch.setattr("os.fsync", refuse)
    monkeypatch.setattr("os.fchmod", refuse)
    save_text(tmp_path / "boat.yaml", "on a share")
    assert [path.read_text() for path in tmp_path.iterdir()] == ["on a share"]
    with pytest.raises(OSError, match=os.strerror(number)):  # a key is for its owner alone, or is not written
        replace_file(tmp_path / "signing.key", "secret", private=True)


def test_what_cannot_be_written_is_tried_again_soon_and_then_once_a_minute(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, tried = tmp_path / "boat.yaml", list[tuple[int, str]]()

    def write(_: Path, text: str, **__: bool) -> None:
        tried.append((now, text))
        raise OSError(errno.EROFS, os.strerror(errno.EROFS))

    now = 0
    monkeypatch.setattr(saving, "replace_file", write)
    saver = BackgroundSaver(lambda _: None)
    for now in range(400):
        if now in (0, 250):
            saver(path, "second" if now else "first")
        saver._worker.submit(int).result()
        saver.retry(float(now))
        saver._worker.submit(int).result()
    times = [time for time, _ in tried]
    assert times == [0, 1, 3, 7, 15, 31, 63, 123, 183, 243, 250, 303, 363]
    assert {text for time, text in tried if time < 250} == {"first"}
    assert {text for time, text in tried if time >= 250} == {"second"}
    saver.close()


def test_what_cannot_be_written_is_known_and_tried_again_though_it_cannot_be_said_either(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Standard error goes to a file on the same full disk."""
    full = OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    def refuse(*_: object, **__: bool) -> None:
        raise full

    path, saver = tmp_path / "boat.yaml", BackgroundSaver(refuse)
    with monkeypatch.context() as disk:
        disk.setattr(saving, "replace_file", refuse)
        saver(path, "text")
        saver._worker.submit(int).result()
        assert saver.alarm is not None
        saver.retry(0.0)
    saver.retry(1.0)
    saver._worker.submit(int).result()
    assert saver.alarm is None and path.read_text() == "text"
    monkeypatch.setattr(saving, "replace_file", refuse)
    saver(path, "lost")
    saver.close()
    assert saver.alarm is not None, "the rest of the end follows, where the rudder is given back"
