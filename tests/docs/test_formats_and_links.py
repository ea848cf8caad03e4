"""The pages that say which links are opened and which logs are read say what the code's own tables say."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest

from autopilot.links.drives import DRIVES
from autopilot.links.n2k.packets import LAYOUTS, SYSTEM_TIME
from autopilot.links.nmea.samples import PLOTTER_SENTENCES, NmeaReader
from autopilot.links.north import Variation
from autopilot.links.transports.medium import SENTENCES
from autopilot.links.url import DEFAULTS, EXAMPLES, OPTIONS, SCHEMES, parse_url, split_scheme
from autopilot.logs import reading
from autopilot.logs.reading import FORMATS, MODULES

ROOT = Path(__file__).parents[2]
LINKS, INSTRUMENTS, LOGS = (
    (ROOT / "docs" / f"{name}.md").read_text(encoding="utf-8") for name in ("links", "instruments", "logs")
)
LOG_ROWS = {
    "own_log": "Norrbin's own `.tlog`",
    "tlog": "`.tlog` of any MAVLink vehicle",
    "dataflash": "ArduPilot `.BIN`",
    "ulog": "PX4 `.ulg`",
    "mcap_log": "`.mcap`",
    "n2k_json": "the same as JSON lines",
    "n2k_text": "NMEA 2000 in text",
    "nmea_text": "NMEA 0183 sentences",
    "csv_log": "CSV",
}
"""How the row of each format begins."""
NAMED = re.compile(r"\b(?:[A-Z][A-Z0-9_]{2,}|[a-z]+(?:_[a-z0-9]+)+|1[23]\d{4})\b")
"""Messages, sentences, topics and PGNs in a cell."""
WORDS = {"NMEA", "CSV", "JSON", "RAW", "ASCII", "N2K", "PX4", "BIN", "MAP"}
"""Names of other things that look alike."""


def table(page: str, heading: str) -> list[list[str]]:
    """Return the rows of the table whose head begins with `heading`."""
    found = page[page.index(f"| {heading} |") :].split("\n\n")[0].splitlines()[2:]
    return [[cell.strip() for cell in row.strip("|").split(" | ")] for row in found]


def urls(rows: list[list[str]]) -> Iterator[str]:
    for row in rows:
        yield from re.findall(r"`([^`]+)`", row[0])


def test_every_kind_of_link_is_in_a_table_and_every_link_of_the_tables_can_be_written() -> None:
    shown = [*urls(table(LINKS, "URL")), *urls(table(INSTRUMENTS, "URL"))]
    for url in shown:
        assert parse_url(url.replace("HOST:PORT", "192.168.1.20:60002")).text, url
    kinds = {split_scheme(url)[0] for url in shown}
    assert kinds == set(SCHEMES)


def test_drives_stand_together_in_the_table_of_links() -> None:
    (row,) = [row for row in table(LINKS, "URL") if "pypilot:" in row[0]]
    assert {split_scheme(url)[0] for url in urls([row])} == set(DRIVES)


def test_every_option_of_an_instrument_link_is_explained() -> None:
    explained = {re.match(r"`(\w+)=", row[0]).group(1) for row in table(INSTRUMENTS, "option")}  # type: ignore[union-attr]
    assert explained == {*OPTIONS["nmea"], "allow"}
    send = next(row[1] for row in table(INSTRUMENTS, "option") if row[0].startswith("`send="))
    assert set(re.findall(r"\b[A-Z]{3}\b", send)) == set(SENTENCES)
    for protocol in ("n2k", "ydwg"):
        assert all(f"?{name}=" in INSTRUMENTS for name in OPTIONS[protocol])


def test_the_sentences_that_a_link_reads_are_those_of_its_reader() -> None:
    (row,) = [row for row in table(LINKS, "URL") if row[0].startswith("`nmea:")]
    said = set(re.findall(r"\b[A-Z]{3}\b", row[1].split(" in,")[0])) - {"NMEA"}
    assert said == set(NmeaReader(Variation(None))._readers)
    plotter = {name for row in table(INSTRUMENTS, "sentence") for name in re.findall(r"\b[A-Z]{3}\b", row[0])}
    assert plotter == PLOTTER_SENTENCES


def test_the_pgns_of_the_table_are_those_that_are_laid_out() -> None:
    said = {int(number) for row in table(INSTRUMENTS, "PGN") for number in re.findall(r"\d{5,6}", row[0])}
    assert said >= set(LAYOUTS) - {SYSTEM_TIME}, "what is read or sent is in the table"
    assert str(SYSTEM_TIME) in LOGS, "which logs alone go by"
    known = {
        node.value
        for path in (ROOT / "autopilot/links/n2k").glob("*.py")
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.Constant) and isinstance(node.value, int)
    }
    assert said <= known, "and nothing else is"


def test_every_format_has_its_row() -> None:
    rows = [row[0] for row in table(LOGS, "log")]
    assert set(LOG_ROWS) == set(MODULES)
    for module, beginning in LOG_ROWS.items():
        assert sum(row.startswith(beginning) for row in rows) == 1, module
    assert len(rows) == len(FORMATS)


@pytest.mark.parametrize("module", MODULES)
def test_what_a_row_says_of_a_format_its_reader_looks_for(module: str) -> None:
    (row,) = [row for row in table(LOGS, "log") if row[0].startswith(LOG_ROWS[module])]
    text = "".join(sources(f"autopilot.logs.{module}"))
    named = {name for cell in row[1:] for name in NAMED.findall(cell)} - WORDS
    assert {name for name in named if not re.search(rf"\b{name}\b", text)} == set()


def sources(module: str) -> Iterator[str]:
    """Yield the text of a module and of those of the project that it imports from."""
    names = {module, *re.findall(r"^from (autopilot\.\S+) import", text_of(module), re.MULTILINE)}
    yield from (text_of(name) for name in sorted(names))


def text_of(module: str) -> str:
    spec = find_spec(module)
    assert spec is not None and spec.origin is not None
    return Path(spec.origin).read_text(encoding="utf-8")


@pytest.fixture
def page(monkeypatch: pytest.MonkeyPatch) -> str:
    monkeypatch.syspath_prepend(str(ROOT / "docs"))
    pages: Any = import_module("reference_pages")
    text: str = pages.links_and_logs()
    return text


def test_the_page_of_the_reference_has_every_link_every_format_and_every_file_that_is_named(page: str) -> None:
    assert len(table(page, "URL")) == len(SCHEMES)
    assert set(urls(table(page, "URL"))) == set(EXAMPLES.values())
    assert len(table(page, "format")) == len(FORMATS)
    assert len(table(page, "file")) == len(reading.BINARY) + len(reading.TEXT) + len(reading.ENDINGS)


def test_what_the_page_on_logs_says_is_named_is_named() -> None:
    said = LOGS[LOGS.index("**What is not read is named**") :].split("Of\nan `.mcap`")[0]
    kinds = " ".join([*(kind.what for kind in (*reading.BINARY, *reading.TEXT)), *reading.ENDINGS])
    for ending in re.findall(r"\.[a-z0-9]+\b", said):
        assert ending.lower() in kinds.lower(), ending
    for name in ("$PCDIN", "Expedition", "Signal K", "AIS", "ROS", "GPX", "KML", "MOOS", "SQLite", "MATLAB", "HDF5"):
        assert name in " ".join(said.split()) and name in kinds, name


def test_usual_baud_rates_need_not_be_written() -> None:
    for name in DEFAULTS:
        assert parse_url(EXAMPLES[name]).baud > 0 or parse_url(EXAMPLES[name]).medium != "serial"
