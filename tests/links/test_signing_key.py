"""Key files that others may read, keys as ground stations make them, and timestamps that outlive power cuts."""

from __future__ import annotations

import hashlib
import json
import multiprocessing
import time
from pathlib import Path

import pytest

from autopilot.errors import InputError
from autopilot.links import signing_key
from autopilot.links.signing import MINUTE
from autopilot.links.signing_key import BLOCK, TimestampBlocks, open_signing, read_key

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


def test_a_disk_that_fails_meanwhile_is_told_and_stops_nothing(key: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    blocks = TimestampBlocks(key, lambda: NOW)
    first = blocks.next()

    def full(path: Path, text: str, *, private: bool) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(signing_key, "replace_file", full)
    told: list[str] = []
    blocks.keep_renewing(told.append)
    blocks._wanted.set()
    for _ in range(200):
        if told:
            break
        time.sleep(0.02)
    assert "No space left on device" in told[0] and told[0] == blocks.complaint
    assert blocks.next() == first + 1
    with pytest.raises(InputError, match=r"cannot be kept in .*signing.key.timestamp \(No space left"):
        TimestampBlocks(key)


@pytest.mark.parametrize("text", ["", "soon", "-5", "9" * 30, "٣"])
def test_a_damaged_timestamp_file_is_refused(key: Path, text: str) -> None:
    key.with_name("signing.key.timestamp").write_text(text)
    with pytest.raises(InputError, match="holds no timestamp"):
        open_signing(key)


def test_timestamps_that_are_used_up_are_refused(key: Path) -> None:
    key.with_name("signing.key.timestamp").write_text(str(2**48 - 10))
    with pytest.raises(InputError, match="used up; make a new key"):
        TimestampBlocks(key)
