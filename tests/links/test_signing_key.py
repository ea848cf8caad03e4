"""Key files that others may read, keys as ground stations make them, and timestamps that outlive power cuts."""

from __future__ import annotations

import hashlib
import json
import multiprocessing
import os
import time
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from autopilot.errors import InputError
from autopilot.links.mavlink import signing
from autopilot.links.mavlink.signing import TimestampBlocks, clock_timestamp, open_signing, read_key

MINUTE = 6_000_000
BLOCK = 100_000

NOW = 37_000_000_000_000


@pytest.fixture
def key(tmp_path: Path) -> Path:
    path = tmp_path / "signing.key"
    path.write_text("correct horse battery staple\n")
    path.chmod(0o600)
    return path


def test_a_passphrase_is_hashed_as_mavproxy_and_mission_planner_do(key: Path) -> None:
    mavproxy = pytest.importorskip("MAVProxy.modules.mavproxy_signing", reason="MAVProxy is not installed")
    theirs = mavproxy.SigningModule.passphrase_to_key(None, "correct horse battery staple")
    assert read_key(key) == theirs


def test_keys_in_every_form(key: Path) -> None:
    assert read_key(key) == hashlib.sha256(b"correct horse battery staple").digest()
    for text in ("ab" * 32, "AB" * 32 + "\n", "ab" * 32 + "\r\n"):
        key.write_text(text, newline="")
        assert read_key(key) == bytes([0xAB] * 32)
    key.write_text("ab" * 31 + "zz")
    assert read_key(key) == hashlib.sha256(b"ab" * 31 + b"zz").digest()
    key.write_text("  spaces count ")
    assert read_key(key) == hashlib.sha256(b"  spaces count ").digest()


@pytest.mark.parametrize("mode", [0o644, 0o640, 0o604, 0o660, 0o601])
def test_a_key_that_others_may_use_is_refused_with_the_cure(key: Path, mode: int) -> None:
    key.chmod(mode)
    with pytest.raises(InputError, match=f"mode {mode:04o}.*run: chmod 600 {key}"):
        read_key(key)
    key.chmod(0o400)
    assert len(read_key(key)) == 32


@pytest.mark.parametrize("content", [b"", b"\n", b"  \n", b"two\nlines", b"\xff\xfe", b"x" * 2000, b"0" * 64])
def test_a_file_that_holds_no_key_is_refused_without_showing_what_it_holds(key: Path, content: bytes) -> None:
    key.write_bytes(content)
    with pytest.raises(InputError, match="write one line: 64 hexadecimal digits") as caught:
        read_key(key)
    assert str(key) in str(caught.value) and "xx" not in str(caught.value) and "lines\n" not in str(caught.value)


def test_a_key_that_is_not_there_or_no_file(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="No such file"):
        read_key(tmp_path / "none")
    with pytest.raises(InputError, match=str(tmp_path)):
        read_key(tmp_path)


def test_timestamps_grow_over_restarts_though_the_clock_stands_still_or_goes_back(key: Path) -> None:
    last = 0
    for clock in (NOW, NOW, NOW - 500 * MINUTE, 0, NOW + 9 * BLOCK):
        blocks = TimestampBlocks(key, lambda clock=clock: clock)
        for _ in range(5):
            stamp = blocks.next()
            assert stamp > last and stamp > clock
            last = stamp
    assert last == NOW + 9 * BLOCK + 5, "restarts do not run ahead of the clock"


def test_a_block_is_on_disk_before_its_first_timestamp_is_used(key: Path) -> None:
    blocks = TimestampBlocks(key, lambda: NOW)
    file = key.with_name("signing.key.timestamp")
    assert file.stat().st_mode & 0o777 == 0o600
    assert blocks.next() == NOW + 1 <= int(file.read_text())
    blocks._clock = lambda: NOW + 10 * BLOCK
    blocks.renew()
    assert blocks.next() == NOW + 10 * BLOCK + 1 <= int(file.read_text())


def test_programs_that_share_a_key_share_no_timestamp(key: Path) -> None:
    one, other = (TimestampBlocks(key, lambda: NOW) for _ in range(2))
    used = [blocks.next() for _ in range(100) for blocks in (one, other)]
    one.renew()
    used += [blocks.next() for _ in range(100) for blocks in (one, other)]
    assert len(set(used)) == 400


def _take(key: Path, count: int) -> str:
    stamps = []
    for _ in range(count):
        blocks = TimestampBlocks(key, lambda: NOW)
        stamps += [blocks.next(), blocks.next()]
    return json.dumps(stamps)


def test_programs_that_start_at_once_share_none_either(key: Path) -> None:
    with multiprocessing.get_context("spawn").Pool(2) as pool:
        taken = pool.starmap(_take, [(key, 20)] * 2)
    stamps = [stamp for text in taken for stamp in json.loads(text)]
    assert len(set(stamps)) == 80


def test_a_peer_that_is_ahead_is_followed_and_kept(key: Path) -> None:
    blocks = TimestampBlocks(key, lambda: NOW)
    blocks.next()
    blocks.saw(NOW + 20 * MINUTE)
    assert blocks.current == NOW + 20 * MINUTE and blocks._wanted.is_set()
    blocks.renew()
    assert blocks.next() > NOW + 20 * MINUTE
    assert TimestampBlocks(key, lambda: NOW).next() > NOW + 20 * MINUTE, "after a restart too"


def test_a_new_block_is_asked_for_before_the_old_one_is_used_up(key: Path) -> None:
    blocks = TimestampBlocks(key, lambda: NOW)
    for _ in range(BLOCK // 2):
        blocks.next()
    assert not blocks._wanted.is_set()
    blocks.next()
    assert blocks._wanted.is_set()


def test_a_disk_that_fails_meanwhile_is_reported_and_stops_nothing(key: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    blocks = TimestampBlocks(key, lambda: NOW)
    first = blocks.next()

    def full(path: Path, text: str, *, private: bool) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(signing, "replace_file", full)
    reported: list[str] = []
    blocks.keep_renewing(reported.append)
    blocks._wanted.set()
    end = time.monotonic() + 60.0
    while not reported:
        assert time.monotonic() < end, "the thread that renews says nothing"
        time.sleep(0.02)
    assert "No space left on device" in reported[0] and reported[0] == blocks.complaint
    assert blocks.next() == first + 1
    with pytest.raises(InputError, match=r"cannot be kept in .*signing.key.timestamp \(No space left"):
        TimestampBlocks(key)


def test_another_key_in_the_file_is_said_once_and_the_first_goes_on(key: Path) -> None:
    blocks = TimestampBlocks(key, key=signing.read_key(key))
    assert not blocks.is_changed
    key.write_text("another passphrase\n")
    reported: list[str] = []
    blocks.keep_renewing(reported.append)
    end = time.monotonic() + 60.0
    while not reported:
        blocks._wanted.set()
        assert time.monotonic() < end, "the thread that renews says nothing"
        time.sleep(0.02)
    assert "another key is in the file since the start" in reported[0] and "start again" in reported[0]
    key.chmod(0o644)
    assert not blocks.is_changed, "what cannot be read is no other key"


@pytest.mark.parametrize("text", ["", "soon", "-5", "9" * 30, "٣"])
def test_a_damaged_timestamp_file_is_refused(key: Path, text: str) -> None:
    key.with_name("signing.key.timestamp").write_text(text)
    with pytest.raises(InputError, match="holds no timestamp"):
        open_signing(key)


@pytest.mark.parametrize("ending", ["", "\n", "\r\n"])
def test_the_longest_timestamp_of_an_editor_s_file_is_read(key: Path, ending: str) -> None:
    file = key.with_name("signing.key.timestamp")
    file.write_bytes(str(2**48 - 1 - BLOCK).encode() + ending.encode())
    assert TimestampBlocks(key, lambda: NOW).next() > NOW


def test_timestamps_that_are_used_up_are_refused(key: Path) -> None:
    """They have 48 bits: a block must end within them, and the last one may."""
    file = key.with_name("signing.key.timestamp")
    for reserved in (2**48 - 10, 2**48 - BLOCK, 2**48 - 1):
        file.write_text(str(reserved))
        with pytest.raises(InputError, match="used up; make a new key"):
            TimestampBlocks(key, lambda: NOW)
    file.write_text(str(2**48))
    with pytest.raises(InputError, match="holds no timestamp"):
        TimestampBlocks(key, lambda: NOW)
    file.write_text(str(2**48 - 1 - BLOCK))
    assert TimestampBlocks(key, lambda: NOW).next().to_bytes(6, "little")
    assert int(file.read_text()) == 2**48 - 1


def test_the_clock_counts_units_of_ten_microseconds_since_2015(monkeypatch: pytest.MonkeyPatch) -> None:
    """As https://mavlink.io/en/guide/message_signing.html has it: 1 January 2015 GMT is 0."""
    since = datetime(2015, 1, 1, tzinfo=UTC)
    for days, units in ((0, 0), (1, 86_400 * 100_000), (-1, 0), (4000, 4000 * 86_400 * 100_000)):
        monkeypatch.setattr(signing.time, "time", lambda days=days: (since + timedelta(days)).timestamp())
        assert clock_timestamp() == units
    monkeypatch.setattr(signing.time, "time", lambda: since.timestamp() + 0.25)
    assert clock_timestamp() == 25_000


def test_two_programs_with_one_key_reserve_different_timestamps(key: Path) -> None:
    """A block is a second of timestamps: a hundred restarts in a minute come no further ahead than 100 s."""
    blocks = [TimestampBlocks(key, lambda: NOW) for _ in range(3)]
    assert [each.current for each in blocks] == [NOW, NOW + 100_000, NOW + 200_000]
    assert [each.next() for each in blocks] == [NOW + 1, NOW + 100_001, NOW + 200_001]
    assert [each.current for each in blocks] == [NOW + 1, NOW + 100_001, NOW + 200_001]


def test_the_first_packet_hears_of_no_block_of_its_own_before_it_sent_any(key: Path) -> None:
    blocks = TimestampBlocks(key, lambda: NOW)
    blocks.saw(NOW - 5)
    assert blocks.current == NOW, "what is behind us changes nothing"
    blocks.saw(NOW + 5)
    assert blocks.current == NOW + 5 and blocks.next() > NOW


def test_the_clock_jumps_to_a_peer_half_a_minute_ahead(key: Path) -> None:
    for ahead, is_wanted in ((3_000_000, False), (3_000_001, True)):
        blocks = TimestampBlocks(key, lambda: NOW)
        first = blocks.next()
        blocks.saw(first + ahead)
        blocks.saw(first + 1)
        assert blocks._wanted.is_set() is is_wanted
        assert blocks.current == first + ahead


def test_a_key_file_may_have_1024_bytes(key: Path) -> None:
    key.write_text("x" * 1024)
    assert read_key(key) == hashlib.sha256(b"x" * 1024).digest()
    for content in ("x" * 1025, "x" * 1024 + "\n"):
        key.write_text(content)
        with pytest.raises(InputError, match="longer than 1024 bytes"):
            read_key(key)
    key.write_text("a\r\n")
    assert read_key(key) == hashlib.sha256(b"a").digest()


def test_programs_that_run_at_once_sign_under_different_numbers(key: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    numbers = []
    for process in (4000, 4001, 4002):
        monkeypatch.setattr(signing.os, "getpid", lambda process=process: process)
        numbers.append(open_signing(key).link().link_id)
    assert len(set(numbers)) == 3 and all(64 <= number <= 255 for number in numbers)


@pytest.mark.parametrize("content", ["9" * 5000, None], ids=["digits", "pipe"])
def test_a_timestamp_file_that_is_none_is_refused_and_holds_nothing_up(key: Path, content: str | None) -> None:
    path = key.with_name(key.name + ".timestamp")
    if content is None:
        os.mkfifo(path)
    else:
        path.write_text(content)
    with pytest.raises(InputError, match=r"\.timestamp"):
        TimestampBlocks(key)
