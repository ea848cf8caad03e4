"""Pages of the reference, written from the code: commands, vessel file, MAVLink messages, links and logs, exit codes,
measurements.

`python docs/reference_pages.py [FOLDER]` writes them alone; the build of the documentation does it by itself.
"""

from __future__ import annotations

import argparse
import ast
import io
import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parent.parent


def write(folder: Path, beside: tuple[str, ...] = ()) -> None:
    """Write every page of the reference into `folder`, and copies of the records and of pages `beside` the README."""
    from mavlink_reference import mavlink

    folder.mkdir(parents=True, exist_ok=True)
    pages = {
        "commands": commands,
        "vessel_file": vessel_file,
        "mavlink": mavlink,
        "links_and_logs": links_and_logs,
        "exit_codes": exit_codes,
        "measurements": measurements,
    }
    texts = {folder / f"{name}.md": page() for name, page in pages.items()}
    for name in beside:
        text = (ROOT / f"{name}.md").read_text(encoding="utf-8").replace("](docs/", "](../")
        text = text.replace("](benchmarks/results/", "](results/")
        texts[folder / f"{name.lower()}.md"] = text
    (folder / "results").mkdir(exist_ok=True)
    for record in sorted((ROOT / "benchmarks" / "results").glob("*.md")):
        text = record.read_text(encoding="utf-8").replace("](../../docs/", "](../../")
        texts[folder / "results" / record.name] = text
    for path, text in texts.items():
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")


def commands() -> str:
    """Return the page of every command with its options, as `--help` prints them."""
    from autopilot.cli.main import build_parser as autopilot_parser
    from sitl.cli import build_parser as sitl_parser

    page = io.StringIO()
    page.write("# Commands\n\nAs `--help` prints them.\n")
    for name, parser in (("autopilot", autopilot_parser()), ("sitl", sitl_parser())):
        for title, command in _commands(name, parser):
            page.write(f"\n## `{title}`\n\n```text\n{command.format_help().rstrip()}\n```\n")
    return page.getvalue()


def _commands(title: str, parser: argparse.ArgumentParser) -> Iterator[tuple[str, argparse.ArgumentParser]]:
    parser.prog = title
    parser.formatter_class = lambda prog: argparse.RawDescriptionHelpFormatter(prog, width=110)
    yield title, parser
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for name, command in action.choices.items():
                yield from _commands(f"{title} {name}", command)


def vessel_file() -> str:
    """Return the page of every key of the vessel file, from the schema that the reader holds to."""
    schema = json.loads((ROOT / "firmware_params/schemas/vessel.schema.json").read_text(encoding="utf-8"))
    page = io.StringIO()
    page.write(
        "# The vessel file\n\nEvery key, with what is allowed. `firmware_params/schemas/vessel.schema.json` is the "
    )
    page.write(
        "same for editors; `autopilot params check FILE` reads a file by it. The last column is for a number that "
    )
    page.write("changed while the pilot runs, by a ground station or on the helm page.\n")
    top: list[str] = []
    sections: list[tuple[str, dict[str, Any], list[str]]] = [("top level", schema, top)]
    _sections("", schema, sections)
    for title, section, rows in sections:
        page.write(f"\n## {title if section is schema else f'`{title}`'}\n\n")
        if section is not schema and "description" in section:
            page.write(section["description"] + "\n\n")
        required = section.get("required", [])
        page.write("| key | what | allowed | default | a change counts |\n|---|---|---|---|---|\n")
        rows.extend(_row(key, value, key in required) for key, value in section["properties"].items())
        page.write("\n".join(rows) + "\n")
    return page.getvalue()


def _sections(path: str, schema: dict[str, Any], found: list[tuple[str, dict[str, Any], list[str]]]) -> None:
    for key, value in schema["properties"].items():
        nested = next((one for one in value.get("anyOf", [value]) if "properties" in one), None)
        if nested is not None:
            found.append((f"{path}{key}", {"description": value.get("description", ""), **nested}, []))
            _sections(f"{path}{key}.", nested, found)


def _row(key: str, value: dict[str, Any], required: bool) -> str:
    default = "required" if required else _inline(value["default"]) if "default" in value else ""
    what = value.get("description", "").replace("|", "\\|").replace("\n", " ")
    counts = {"now": "at once", "restart": "from the next start on"}.get(value.get("x-counts", ""), "")
    return f"| `{key}` | {what} | {_allowed(value)} | {default} | {counts} |"


def _inline(value: object) -> str:
    return f"`{json.dumps(value)}`"


def _allowed(value: dict[str, Any]) -> str:
    if "anyOf" in value:
        return " or ".join(dict.fromkeys(_allowed(one) for one in value["anyOf"]))
    if "enum" in value:
        return ", ".join(_inline(one) for one in value["enum"])
    if "properties" in value:
        return "a section"
    kind = value.get("type", "")
    words = {"number": "number", "integer": "whole number", "string": "text", "boolean": "true, false", "array": "list"}
    text = words.get(kind, str(kind))
    if "minimum" in value and "maximum" in value:
        return f"{text} {value['minimum']:g} to {value['maximum']:g}"
    if "minimum" in value:
        return f"{text} from {value['minimum']:g}"
    return text


def exit_codes() -> str:
    """Return the page of what each exit code says, from the text that `--help` prints and the names in the code."""
    from autopilot.cli.main import EXIT_CODES
    from autopilot.errors import ExitCode

    names = {code.value: code.name for code in ExitCode}
    page = io.StringIO()
    page.write("# Exit codes\n\nOf `autopilot`, and of `sitl` where it can end so.\n\n")
    page.write("| code | name | meaning |\n|---|---|---|\n")
    for line in EXIT_CODES.splitlines()[1:]:
        code, meaning = line.split(maxsplit=1)
        name = names.get(int(code))
        page.write(f"| {code} | {f'`{name}`' if name else ''} | {meaning} |\n")
    return page.getvalue()


def links_and_logs() -> str:
    """Return the page of every kind of link, of every format of logs, and of what is known and not read."""
    from autopilot.links.url import EXAMPLES, FORWARD_OPTIONS, MEDIA, OPTIONS, SCHEMES
    from autopilot.logs.reading import BINARY, ENDINGS, FORMATS, MODULES, TEXT

    page = io.StringIO()
    page.write("# Links and logs\n\nWhat is opened and read, from the code's own tables. [Links](../links.md) and ")
    page.write("[logs](../logs.md) say what is in them.\n\n## Links\n\n")
    page.write(
        f"With `--forward` a MAVLink link also takes {' and '.join(f'`{name}`' for name in FORWARD_OPTIONS)}.\n\n"
    )
    page.write("| URL | speaks | over | options behind `?` |\n|---|---|---|---|\n")
    for name, (protocol, medium) in SCHEMES.items():
        options = (*OPTIONS.get(protocol, ()), *(("allow",) if MEDIA[medium].listens else ()))
        page.write(f"| `{EXAMPLES[name]}` | {protocol} | {medium} | {', '.join(f'`{each}`' for each in options)} |\n")
    page.write("\n## Logs that are read\n\nA file is asked in this order whether it is of a format.\n\n")
    page.write("| format | known by | ending that promises it |\n|---|---|---|\n")
    for module, each in zip(MODULES, FORMATS, strict=True):
        known = "its text" if each.is_text else "its bytes"
        page.write(f"| {each.example or OF_A_KIND[module]} | {known} | {each.ending and f'`{each.ending}`'} |\n")
    page.write("\n## Files that are named and not read\n\n| file | what to do |\n|---|---|\n")
    for what, advice in [*((kind.what, kind.advice) for kind in (*BINARY, *TEXT)), *ENDINGS.values()]:
        page.write(f"| {what} | {advice} |\n")
    return page.getvalue()


OF_A_KIND = {"own_log": "Norrbin's own .tlog", "n2k_json": "NMEA 2000 in canboat's JSON"}
"""Formats whose example is another's."""


def measurements() -> str:
    """Return the page of every measurement: what it shows and its command, from the head of its file."""
    page = io.StringIO()
    page.write("# Measurements\n\nEvery figure in these pages comes from a command of this list. ")
    page.write("They run in a checkout with the package installed.\n")
    for path in sorted((ROOT / "benchmarks").glob("*.py")):
        head = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or ""
        if f"python benchmarks/{path.name}" in head:
            title, _, rest = head.partition("\n")
            page.write(f"\n## {path.stem}\n\n{title}\n{rest}\n")
    return page.getvalue()


if __name__ == "__main__":
    sys.path.insert(0, str(ROOT))
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", nargs="?", type=Path, default=Path(__file__).parent / "reference")
    write(parser.parse_args().folder)
