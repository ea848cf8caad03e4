"""Every reader ends, and refuses in one short sentence, whatever stands where a number should."""

from __future__ import annotations

import os
import random
import re
from pathlib import Path
from typing import Any

import pytest
from fuzz_everything import NUMBER, REFUSALS, STRANGE_NUMBERS, STRANGE_TEXTS, STRANGE_WORDS, must_end
from fuzz_file_targets import SENTENCES, targets
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from memory import measured

from autopilot.cli.main import main
from autopilot.files.outside import read_regular
from autopilot.links.nmea.sentences import checksum
from autopilot.logs.series import MILLISECONDS_FROM, stamp_of

BINARY = ("telemetry log", "own log", "DataFlash log", "ULog", "MCAP", "MAVLink order")
EDITS = "CSV numbers"
"""Its inputs say which numbers to put where: no file."""
PLACES = 4
"""In each input; `.ci/slow readers` changes thousands."""
SECONDS = 2
"""Of a log in which each sentence comes once a second."""


def refused_or_taken(take: Any, data: bytes) -> None:
    with must_end(60):
        try:
            take(data)
        except REFUSALS as error:
            assert len(str(error)) < 2500, "a refusal is short"


@pytest.mark.parametrize("name", [name for name in targets() if name not in (*BINARY, EDITS)])
def test_a_strange_number_in_any_place_of_a_text_is_read_or_refused(name: str) -> None:
    target, rng = targets()[name], random.Random(name)
    for misfit in (*STRANGE_NUMBERS, *STRANGE_TEXTS):
        seed = rng.choice(target.seeds)
        found = list(NUMBER.finditer(seed))
        for number in rng.sample(found, min(PLACES, len(found))):
            refused_or_taken(target.take, seed[: number.start()] + misfit + seed[number.end() :])
        every = NUMBER.sub(lambda _, misfit=misfit: misfit, seed[:2000])
        refused_or_taken(target.take, every)


@pytest.mark.parametrize("name", BINARY)
def test_a_strange_number_in_any_place_of_a_binary_file_is_read_or_refused(name: str) -> None:
    target, rng = targets()[name], random.Random(name)
    for word in STRANGE_WORDS:
        seed = rng.choice(target.seeds)
        for _ in range(PLACES):
            place = rng.randrange(max(1, len(seed) - len(word)))
            refused_or_taken(target.take, seed[:place] + word + seed[place + len(word) :])


@pytest.mark.parametrize("sentence", SENTENCES, ids=lambda sentence: sentence[2:5].decode())
def test_a_strange_number_in_any_field_of_a_sentence_is_read_or_refused(sentence: bytes) -> None:
    target = targets()["NMEA log"]
    for seed in target.seeds:
        target.take(seed)
    seed = b"".join(target.seeds[1].splitlines(keepends=True)[: SECONDS * len(SENTENCES)])
    numbers = [each for each in STRANGE_NUMBERS if len(each) < 60]
    address, *fields = sentence.replace(b"%d", b"0").split(b",")
    whole = b",".join([address, *fields])
    assert whole in seed
    for place in range(len(fields)):
        for misfit in numbers[place % 3 :: 3]:
            changed = b",".join([address, *fields[:place], misfit, *fields[place + 1 :]])
            refused_or_taken(target.take, seed.replace(whole, changed))


@given(st.from_regex(rb"[0-9eE+\-.,:\\c* TZ\x1b]{0,400}", fullmatch=True), st.sampled_from(sorted(targets())))
@settings(max_examples=100, suppress_health_check=[HealthCheck.too_slow], deadline=None)
def test_digits_and_signs_in_any_order_are_read_or_refused(data: bytes, name: str) -> None:
    target = targets()[name]
    refused_or_taken(target.take, data)
    refused_or_taken(target.take, target.seeds[0][:300] + data + target.seeds[0][300:])


def hdt(prefix: bytes, heading: float) -> bytes:
    body = b"HCHDT,%.1f,T" % heading
    return prefix + b"$%b*%02X\r\n" % (body, checksum(body))


@pytest.mark.parametrize(
    "stamp", [b"9" * 310, b"9" * 20000, b"1e999", b"-1", b"0", b"\\c:" + b"9" * 400 + b"\\", b"\\c:1" * 20000]
)
def test_a_time_without_end_ends(stamp: bytes, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "log.txt"
    path.write_bytes(b"".join(hdt(stamp + b" ", heading) for heading in range(10)))
    with must_end(60):
        main(["log", "info", str(path)])
    shown = capsys.readouterr()
    assert len(shown.out + shown.err) < 3000


@given(st.from_regex(r"[0-9]{1,400}(\.[0-9]{0,40})?", fullmatch=True))
def test_a_stamp_is_a_time_of_a_calendar_or_none(digits: str) -> None:
    stamp = stamp_of(f"{digits} ")
    assert stamp is None or 0.0 <= stamp[0] <= MILLISECONDS_FROM


def test_seconds_milliseconds_micro_and_nanoseconds_are_the_same_time() -> None:
    for digits in ("1780308000", "1780308000000", "1780308000000000", "1780308000000000000"):
        stamp = stamp_of(f"{digits} ")
        assert stamp is not None and stamp[0] == pytest.approx(1780308000.0, rel=1e-12)


def test_a_table_of_a_million_columns_is_refused_in_a_short_sentence(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "wide.csv"
    header = ",".join(f"column{number}" for number in range(1_000_000))
    path.write_text(f"{header}\n{'1,' * 999_999}1\n")
    assert main(["log", "info", str(path)]) == 2
    refusal = capsys.readouterr().err
    assert len(refusal) < 1000 and "and 999970 more" in refusal


def test_reading_a_file_takes_no_more_memory_than_the_file(tmp_path: Path) -> None:
    path = tmp_path / "small.csv"
    path.write_bytes(b"time_s,heading_deg\n" * 1000)
    read_regular(path)
    read, taken = measured(lambda: read_regular(path))
    assert read == path.read_bytes() and taken.peak < 1 << 20


def test_a_file_that_tells_no_size_is_read() -> None:
    assert b"MemTotal" in read_regular("/proc/meminfo")


@pytest.mark.parametrize(
    "command",
    [
        ["log", "info", "PIPE"],
        ["log", "info", "PIPE.csv"],
        ["log", "info", "PIPE.tlog"],
        ["identify", "PIPE"],
        ["replay", "PIPE.tlog"],
        ["params", "check", "PIPE.yaml"],
        ["params", "check", "PIPE.param"],
        ["gains", "PIPE.yaml"],
        ["run", "lanxin", "--link", "udpin:127.0.0.1:0", "--route", "PIPE", "--wait", "1"],
        ["run", "lanxin", "--link", "udpin:127.0.0.1:0", "--signing-key", "PIPE", "--wait", "1"],
        ["web", "--link", "udpin:127.0.0.1:0", "--token-file", "PIPE", "--listen", "127.0.0.1:0"],
    ],
    ids=" ".join,
)
def test_a_pipe_that_nobody_writes_to_is_refused(
    command: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    given_to = []
    for word in command:
        if word.startswith("PIPE"):
            word = str(tmp_path / word)
            os.mkfifo(word, 0o600)
        given_to.append(word)
    with must_end(60):
        assert main(given_to) == 2
    assert re.search("not a file but a pipe", capsys.readouterr().err, re.I)
