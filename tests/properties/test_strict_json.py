"""JSON from outside: what is sound is read as Python reads it, all else is refused in one short sentence."""

from __future__ import annotations

import json
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from autopilot.errors import InputError
from autopilot.files.outside import DEEPEST, parse_json
from autopilot.runtime.tick_codec import decode_header

whole_text = st.text(st.characters(exclude_categories=["Cs"]))
scalars = st.none() | st.booleans() | st.integers(-(10**17), 10**17) | whole_text
scalars |= st.floats(allow_nan=False, allow_infinity=False)
documents = st.recursive(scalars, lambda inside: st.lists(inside) | st.dictionaries(whole_text, inside), max_leaves=8)


@given(documents)
def test_what_is_sound_is_read(found: Any) -> None:
    for text in (json.dumps(found), json.dumps(found, ensure_ascii=False)):
        assert parse_json(text.encode(), "here", 1 << 20) == found


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"", "no JSON"),
        (b"{", "no JSON"),
        (b"\xff", "no JSON in UTF-8"),
        (b"\xed\xa0\x80", "no JSON in UTF-8"),
        (b"\xef\xbb\xbf{}", "no JSON"),
        (b"NaN", "NaN is no number"),
        (b"[-Infinity]", "-Infinity is no number"),
        (b'{"a":[1e999]}', "too large"),
        (b"9" * 400, "too large"),
        (b'"\\ud800"', "half of a character"),
        (b'{"a\\udfff":1}', "half of a character"),
        (b"[" * 100_000, "nested deeper than 32"),
        (b'{"a":' * 100_000, "nested deeper than 32"),
        (b"[" * (DEEPEST + 1) + b"]" * (DEEPEST + 1), "nested deeper than 32"),
        (b" " * 1_000_001, "1000001 bytes, at most 1000000"),
    ],
)
def test_what_is_not_sound_is_one_short_sentence(data: bytes, words: str) -> None:
    with pytest.raises(InputError, match=r"^here: ") as caught:
        parse_json(data, "here", 1_000_000)
    assert words in str(caught.value) and len(str(caught.value)) < 120


def test_a_pair_of_halves_is_a_character_and_the_depth_allowed_is_read() -> None:
    assert parse_json(b'"\\ud83d\\ude00"', "here", 99) == "\N{GRINNING FACE}"
    assert parse_json(b"[" * DEEPEST + b"1" + b"]" * DEEPEST, "here", 99) is not None


@pytest.mark.parametrize("text", [b"[" * 30_000, b'{"vessel":"\\ud800"}', b'{"part":NaN}', b"[]", b"\xff"])
def test_a_log_s_header_that_is_none_is_one_sentence(text: bytes) -> None:
    with pytest.raises(InputError, match="the log's header is damaged"):
        decode_header(b"\x01" + text)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("part", "x"),
        ("part", None),
        ("part", 0),
        ("part", 1.5),
        ("part", 1 << 40),
        ("first", -1),
        ("vessel", 3),
        ("law", []),
    ],
)
def test_a_log_s_header_that_holds_something_else_is_one_sentence(name: str, value: object) -> None:
    message = f"the log's header is damaged: {name} is .* is allowed; give another log"
    with pytest.raises(InputError, match=message) as caught:
        decode_header(b"\x01" + json.dumps({name: value}).encode())
    assert len(str(caught.value)) < 150
