"""Strict reading: every trap of ordinary YAML readers is a sentence with its place, or the right value."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from autopilot.errors import InputError
from autopilot.files import strict_yaml
from autopilot.files.strict_yaml import parse_document, plain, read_document


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1e3", 1000.0),
        ("1.5", 1.5),
        ("-.5", -0.5),
        ("12.", 12.0),
        ("0", 0),
        ("-7", -7),
        ("0x1F", 31),
        ("no", "no"),
        ("yes", "yes"),
        ("off", "off"),
        ("true", True),
        ("False", False),
        ("null", None),
        ("~", None),
        ("", None),
        ("1:30", "1:30"),
        ("1_000", "1_000"),
        ("2016-03-01", "2016-03-01"),
        ("'010'", "010"),
        ('"true"', "true"),
        ("nan", "nan"),
        (".inf", math.inf),
        ("[1, 2.5, a]", [1, 2.5, "a"]),
    ],
)
def test_plain_values_mean_what_yaml_1_2_says(text: str, value: object) -> None:
    result = plain(parse_document(f"key: {text}"))["key"]
    assert result == value
    assert type(result) is type(value)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("a: 1\na: 2", "f.yaml, line 2, column 1: the key a is given twice, first on line 1; keep one of them."),
        (
            "a: {b: 1, b: 2}",
            "f.yaml, line 1, column 11: the key a.b is given twice, first on line 1; keep one of them.",
        ),
        ("a: 010", "f.yaml, line 1, column 4: a: 010 begins with a zero"),
        ("a: 1e999", "f.yaml, line 1, column 4: a: the number 1e999 is too large"),
        ("a: " + "9" * 61, "has more than 60 characters"),
        ("a: &x 1", "f.yaml, line 1, column 4: the anchor or alias 'x' at a is not allowed; write the value out."),
        ("a: &x [1]\nb: *x", "the anchor or alias 'x' at a is not allowed"),
        ("<<: {a: 1}", "'<<' stands as a key; a key is one word."),
        ("a: !!python/object/apply:os.system [ls]", "the tag 'tag:yaml.org,2002:python/object/apply:os.system' at a"),
        ("a: !!str 1", "the tag 'tag:yaml.org,2002:str' at a is not allowed"),
        ("? [1]\n: 2", "a list or mapping stands as a key; a key is one word."),
        ("a: 1\n---\nb: 2", "f.yaml, line 2, column 1: a second document begins; one file holds one document."),
        ("", "f.yaml: empty; it must hold keys and values."),
        ("# only a comment", "f.yaml: empty"),
        ("a: [1", "not valid YAML"),
        ("a:\n\tb: 1", "f.yaml, line 2, column 1: not valid YAML: there is a tab; indent with spaces."),
        ("a: \x07", "f.yaml: holds characters that YAML does not allow"),
        ("a: " + "[" * 30 + "]" * 30, "nested deeper than 20 levels"),
    ],
)
def test_what_misleads_is_refused_with_its_place(text: str, sentence: str) -> None:
    with pytest.raises(InputError) as caught:
        parse_document(text, "f.yaml")
    assert sentence in str(caught.value)
    assert "\n" not in str(caught.value)


def test_aliases_cannot_expand_without_bound() -> None:
    laughs = "a: &a [x, x, x]\n" + "".join(
        f"{b}: &{b} [*{a}, *{a}, *{a}]\n" for a, b in zip("abcdef", "bcdefg", strict=True)
    )
    with pytest.raises(InputError, match="anchor or alias"):
        parse_document(laughs)


def test_a_sentence_stays_one_line_whatever_it_quotes() -> None:
    with pytest.raises(InputError) as caught:
        parse_document('"a\\nb": 1\n"a\\nb": 2')
    assert "the key a b is given twice" in str(caught.value)


def test_size_and_number_of_values_are_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(strict_yaml, "VALUES_MAX", 50)
    with pytest.raises(InputError, match="more than 50 values"):
        parse_document("a: [" + "1, " * 60 + "]")
    monkeypatch.setattr(strict_yaml, "SIZE_MAX_BYTES", 100)
    with pytest.raises(InputError, match="larger than 100"):
        parse_document("a: " + "x" * 200)


def test_every_yaml_value_knows_its_line_column_and_path() -> None:
    root = parse_document("a: 1\nb:\n  c: [5, 6]\n", "f.yaml")
    assert (root.at("b", "c").line, root.at("b", "c").column, root.at("b", "c").key_column) == (3, 6, 3)
    assert root.at("b", "c").path == "b.c"
    assert root.at("b", "nowhere").path == "b"


def test_unreadable_files_are_one_sentence(tmp_path) -> None:
    with pytest.raises(InputError, match=r"nofile\.yaml: no such file"):
        read_document(tmp_path / "nofile.yaml")
    with pytest.raises(InputError, match="this is a folder"):
        read_document(tmp_path)
    latin = tmp_path / "latin.yaml"
    latin.write_bytes(b"a: 1\nname: b\xe5t\n")
    with pytest.raises(InputError, match=r"latin\.yaml, line 2: byte 12 is not UTF-8"):
        read_document(latin)
    with pytest.raises(InputError):
        read_document("a\0b.yaml")


YAML_LIKE = st.text(alphabet=":-[]{}#&*!|>'\"%@`,?\n\t aAbB01.eEx~<=\\\u2028\ufeff\x85", max_size=60)


@settings(max_examples=400, deadline=None)
@given(st.one_of(st.text(max_size=80), YAML_LIKE))
@example("? ? ? a")
@example("\ud800")
@example("- - - -")
def test_no_text_raises_anything_but_input_error(text: str) -> None:
    try:
        parse_document(text)
    except InputError as error:
        assert "\n" not in str(error)


@settings(max_examples=200, deadline=None)
@given(st.binary(max_size=80))
def test_no_file_content_raises_anything_but_input_error(tmp_path_factory, data: bytes) -> None:
    path = tmp_path_factory.getbasetemp() / "fuzz.yaml"
    path.write_bytes(data)
    try:
        read_document(path)
    except InputError:
        return


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "utf-32", "utf-16-le", "utf-16-be"])
def test_a_file_in_another_encoding_of_unicode_is_the_same(tmp_path: Path, encoding: str) -> None:
    path = tmp_path / "wide.yaml"
    path.write_bytes("name: Lanxín\nlength_m: 7.0\n".encode(encoding))
    assert plain(read_document(path)) == {"name": "Lanxín", "length_m": 7.0}


def test_zeros_in_a_text_and_halves_of_its_characters_are_named(tmp_path: Path) -> None:
    path = tmp_path / "wide.yaml"
    path.write_bytes("name: x\n".encode("utf-16") + b"\x00\xd8\x41\x00")
    with pytest.raises(InputError, match=r"wide\.yaml, line 2: byte 18 is not UTF-16.* text; save the file as UTF-8"):
        read_document(path)
