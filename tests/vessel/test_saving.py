"""A link is followed, a pipe or device is written into or refused; none of them is ever replaced by a file."""

from __future__ import annotations

import errno
import os
import stat
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from lockstep import Lockstep

from autopilot.cli.main import main
from autopilot.errors import InputError
from autopilot.files.saving import refuse_existing, replace_file, save_page, save_schema, save_text, save_unused
from autopilot.runtime.log_files import FileSink
from autopilot.vessel.file import load_vessel
from autopilot.web.hub import token_of
from sitl.campaign.results import open_results
from sitl.campaign.study import Job, load_study
from sitl.campaign.work import UNKNOWN, Row

ROOT = Path(__file__).parents[2]
PAGE, SCHEMA = "<!doctype html>", '{"$schema": 1}'
WRITERS: dict[str, tuple[Callable[[Path, str], object], str]] = {
    "text": (save_text, "text"),
    "page": (save_page, PAGE),
    "schema": (save_schema, SCHEMA),
}
EACH = pytest.mark.parametrize(("save", "text"), WRITERS.values(), ids=WRITERS)


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a log of ours."""
    path = tmp_path_factory.mktemp("log") / "run.tlog"
    steps = Lockstep(load_vessel("lanxin"), log=path)
    steps.engage(90.0)
    steps.run(10.0)
    steps.session.close()
    return path


def node(path: Path, major: int, minor: int, kind: int = stat.S_IFCHR) -> Path:
    """Make a device of our own, never to be tried on those of the machine."""
    try:
        os.mknod(path, 0o600 | kind, os.makedev(major, minor))
        if kind == stat.S_IFCHR:
            os.close(os.open(path, os.O_WRONLY))
    except OSError as error:
        pytest.skip(f"no device can be made here: {error}")
    return path


@EACH
def test_a_link_stays_and_its_target_is_replaced(save: Callable[..., object], text: str, tmp_path: Path) -> None:
    (tmp_path / "far").mkdir()
    target, link = tmp_path / "far" / "target", tmp_path / "link"
    link.symlink_to(Path("far") / "target")
    for _ in range(2):  # a target that is to be made, and one that is there
        save(link, text)
        assert link.is_symlink() and target.read_text() == text and not target.is_symlink()
    assert [path.name for path in target.parent.iterdir()] == ["target"]


@EACH
def test_what_replaces_a_file_is_its_owners_where_it_may_be(
    save: Callable[..., object], text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "mine"
    save(path, text)
    path.chmod(0o640)
    if os.geteuid() == 0:
        os.chown(path, 4711, 4712)
    before = path.stat()
    save(path, text)
    after = path.stat()
    assert after.st_ino != before.st_ino
    assert (after.st_uid, after.st_gid, after.st_mode) == (before.st_uid, before.st_gid, before.st_mode)

    asked = []

    def refused(_: int, owner: int, group: int) -> None:
        asked.append((owner, group))
        if owner != -1:
            raise PermissionError(errno.EPERM, os.strerror(errno.EPERM))

    monkeypatch.setattr(os, "fchown", refused)
    save(path, text)
    assert asked == [(before.st_uid, before.st_gid), (-1, before.st_gid)], "the group at least"
    assert path.stat().st_mode == before.st_mode, "and nobody else may read it"


@pytest.mark.skipif(os.geteuid() != 0, reason="only root gives files away")
def test_a_private_file_stays_that_of_the_folders_owner_and_of_nobody_else(tmp_path: Path) -> None:
    path = tmp_path / "key"
    for folder, owner in ((0, 0), (4711, 4711)):
        path.write_text("of somebody")
        os.chown(path, 4711, 4712)
        os.chown(tmp_path, folder, 0)
        replace_file(path, "secret", private=True)
        assert (path.stat().st_uid, path.stat().st_mode & 0o777) == (owner, 0o600)


@EACH
def test_a_pipe_with_a_reader_gets_the_text(save: Callable[..., object], text: str, tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    reader = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    save(pipe, text)
    assert os.read(reader, 1000).decode() == text
    os.close(reader)
    assert stat.S_ISFIFO(pipe.stat().st_mode)


@EACH
def test_a_pipe_without_a_reader_is_refused_and_stays(save: Callable[..., object], text: str, tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    with pytest.raises(InputError, match=r"pipe: cannot be written \(nobody reads this pipe\)"):
        save(pipe, text)
    assert stat.S_ISFIFO(pipe.stat().st_mode)


@EACH
def test_devices_are_written_into_and_stay(save: Callable[..., object], text: str, tmp_path: Path) -> None:
    null, full = node(tmp_path / "null", 1, 3), node(tmp_path / "full", 1, 7)
    save(null, text)
    with pytest.raises(InputError, match="No space left on device"):
        save(full, text)
    assert all(stat.S_ISCHR(path.stat().st_mode) for path in (null, full))


@EACH
def test_a_disk_a_folder_and_links_in_a_ring_are_refused(
    save: Callable[..., object], text: str, tmp_path: Path
) -> None:
    disk, ring, folder = node(tmp_path / "disk", 7, 250, stat.S_IFBLK), tmp_path / "ring", tmp_path / "folder"
    ring.symlink_to(ring)
    folder.mkdir()
    for path, why in (
        (disk, "a disk or a socket"),
        (ring, os.strerror(errno.ELOOP)),
        (folder, os.strerror(errno.EISDIR)),
    ):
        with pytest.raises(InputError, match=why):
            save(path, text)
    assert stat.S_ISBLK(disk.stat().st_mode) and ring.is_symlink() and folder.is_dir()


def test_a_backup_removes_no_pipe_and_no_device_that_takes_it_or_fails(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    reader = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    assert save_unused(pipe, "values") == pipe and os.read(reader, 10) == b"values"
    os.close(reader)
    full = node(tmp_path / "full", 1, 7)
    with pytest.raises(InputError, match="No space left on device"):
        save_unused(full, "values")
    assert stat.S_ISFIFO(pipe.stat().st_mode) and stat.S_ISCHR(full.stat().st_mode)


def test_a_secret_goes_into_a_file_alone(tmp_path: Path) -> None:
    link, target, pipe = tmp_path / "token", tmp_path / "kept", tmp_path / "pipe"
    link.symlink_to(target)
    assert token_of(link) == target.read_text().strip() and link.is_symlink()
    assert stat.S_IMODE(target.stat().st_mode) == 0o600
    os.mkfifo(pipe)
    reader = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    with pytest.raises(OSError, match="Not a file but a pipe"):
        replace_file(pipe, "secret", private=True)
    assert os.read(reader, 10) == b"" and stat.S_ISFIFO(pipe.stat().st_mode)
    os.close(reader)


def test_only_what_would_be_lost_needs_overwrite(tmp_path: Path) -> None:
    pipe, file = tmp_path / "pipe", tmp_path / "file"
    os.mkfifo(pipe)
    refuse_existing(pipe)
    refuse_existing(tmp_path / "none")
    file.write_text("kept")
    with pytest.raises(InputError, match="exists already"):
        refuse_existing(file)
    with pytest.raises(InputError, match="is a folder"):
        refuse_existing(tmp_path)


@pytest.mark.parametrize("words", [["csv", "LOG", "--out"], ["export", "LOG", "--to"]], ids=["csv", "export"])
def test_a_table_over_a_link_or_a_pipe(
    log: Path, words: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ["log", *(str(log) if word == "LOG" else word for word in words)]
    link, pipe = tmp_path / "link.csv", tmp_path / "pipe.csv"
    link.symlink_to(tmp_path / "table.csv")
    os.mkfifo(pipe)
    assert main([*command, str(link)]) == 0
    assert main([*command, str(link), "--overwrite"]) == 0
    assert link.is_symlink() and "heading_rad" in (tmp_path / "table.csv").read_text()
    assert main([*command, str(pipe), "--overwrite"]) == 2
    assert "nobody reads this pipe" in capsys.readouterr().err
    with subprocess.Popen(["cat", str(pipe)], stdout=subprocess.PIPE) as reader:
        while main([*command, str(pipe)]) != 0:  # until the reader has opened it
            assert reader.poll() is None
        assert reader.communicate(timeout=60)[0] == (tmp_path / "table.csv").read_bytes()


@pytest.mark.parametrize("ending", ["csv", "parquet"])
def test_the_results_of_a_campaign_spare_links_pipes_and_what_is_in_use(ending: str, tmp_path: Path) -> None:
    job = Job(load_study("front")[0], "")
    link, pipe, sink = tmp_path / f"link.{ending}", tmp_path / f"pipe.{ending}", FileSink(tmp_path / f"log.{ending}")
    link.symlink_to(tmp_path / "target")
    (tmp_path / "target").write_text("x" * 1_000_000)
    results = open_results(link, job)
    results.write([Row(0, 1, "full", UNKNOWN)])
    results.close()
    assert link.is_symlink() and 0 < (tmp_path / "target").stat().st_size < 100_000
    os.mkfifo(pipe)
    with pytest.raises(InputError, match="nobody reads this pipe"):
        open_results(pipe, job)
    sink.write(b"the log")
    with pytest.raises(InputError, match="a running program writes it"):
        open_results(sink.path, job)
    sink.close()
    assert sink.path.read_bytes() == b"the log"


def test_an_empty_file_of_a_program_that_was_killed_holds_nothing_to_lose(tmp_path: Path) -> None:
    path = tmp_path / "killed.csv"
    path.touch()
    save_text(path, "results", overwrite=False)
    assert path.read_text() == "results"
    with pytest.raises(InputError, match="exists already"):
        save_text(path, "others", overwrite=False)
    path.write_text("")
    results = open_results(path, Job(load_study("front")[0], ""))
    with pytest.raises(InputError, match="a running program writes it"):
        save_text(path, "others", overwrite=False)
    results.close()


@pytest.mark.parametrize("ending", ["csv", "parquet"])
def test_the_results_of_a_campaign_replace_nothing_before_the_first_row(ending: str, tmp_path: Path) -> None:
    job = Job(load_study("front")[0], "")
    old, new = tmp_path / f"old.{ending}", tmp_path / f"new.{ending}"
    old.write_text("an hour's work")
    for path in (old, new):
        results = open_results(path, job)
        with pytest.raises(InputError, match="a running program writes it"):
            open_results(path, job)
        results.close()
    assert old.read_text() == "an hour's work" and not new.exists()


def test_a_link_to_results_that_never_came_stays_and_what_it_names_goes(tmp_path: Path) -> None:
    link = tmp_path / "link.csv"
    link.symlink_to(tmp_path / "target")
    open_results(link, Job(load_study("front")[0], "")).close()
    assert link.is_symlink() and not (tmp_path / "target").exists()


def test_a_table_on_the_standard_output_is_the_table_alone(log: Path, tmp_path: Path) -> None:
    command = f"{sys.executable} -m autopilot log csv {log} --out /dev/stdout"
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    shell = f"{command} > before; {command} | cat > piped; echo kept > after; {command} >> after"
    subprocess.run(["bash", "-ec", shell], cwd=tmp_path, env=environment, check=True, stderr=subprocess.DEVNULL)
    before, piped, after = ((tmp_path / name).read_text() for name in ("before", "piped", "after"))
    assert before.startswith("# from ") and before.splitlines()[-1].count(",") > 2
    assert piped == before and after == f"kept\n{before}"


def test_the_files_of_a_service_go_into_no_device(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    unit = tmp_path / "etc" / "systemd" / "system" / "norrbin.service"
    unit.parent.mkdir(parents=True)
    unit.symlink_to(node(tmp_path / "null", 1, 3))
    command = ["install-service", "lanxin", "--link", "udpin:127.0.0.1:14550", "--root", str(tmp_path)]
    assert main(command) == 2
    assert "norrbin.service: is no file" in capsys.readouterr().err
    assert unit.is_symlink()
