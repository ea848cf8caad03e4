"""The page of MAVLink messages and commands, found in the syntax trees of the code that sends, reads and obeys them."""

from __future__ import annotations

import ast
import functools
import io
import re
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.links.mavlink.frames import EXTRA_MESSAGES

AUTOPILOT = Path(__file__).parent.parent / "autopilot"
ROOMS = ("links", "firmware", "vessel", "web", "runtime", "logs")
EXTRA = {kind.__name__: kind for kind in EXTRA_MESSAGES.values()}
"""Messages younger than pymavlink's release, by the name of their class."""
NAMED_ONLY = frozenset(
    {
        "links/ground_station/telemetry",
        "links/mavlink/outgoing",
        "links/mavlink/router",
        "links/mavlink/signing",
        "web/station",
    }
)
"""Numbers of messages stand here to send, ask for or pass them on, not to read them."""
ONE_WAY_ONLY = frozenset({"links/mavlink/guided"})
"""Names of messages stand here in sentences for people."""
LOGS = ("logs/", "runtime/record")
"""What reads logs obeys nobody and is documented with the logs; what writes them sends."""
OBEYING = "links/ground_station/"
ANSWERS = frozenset({"web/view"})
"""Reads what was answered to commands."""
STANDARD_MODE = "MAV_CMD_DO_SET_STANDARD_MODE"
"""In the standard, not in the dialect: a plain number in the code."""
USER_COMMAND = re.compile(r"^((?:SPATIAL_)?USER_\d): (.+)$", re.MULTILINE)
"""How the words beside our constants begin."""
HEAD = """# MAVLink messages and commands

Found in the code: a message that is made in a module is sent by it (`runtime/record` into the log alone), one that is
looked for is read. Logs of others are read for [more](../logs.md). [Ground stations](../ground_stations.md) and
[flight controllers](../flight_controllers.md) say how they are used.

## Messages

| message | sent by | read by | purpose, as MAVLink gives it |
|---|---|---|---|
"""

Found = defaultdict[str, set[str]]


def mavlink() -> str:
    """Return the page of every message and command that the code makes, reads or obeys."""
    sent, read = messages()
    page = io.StringIO()
    page.write(HEAD)
    for name in sorted(sent.keys() | read.keys()):
        page.write(f"| `{name}` | {_modules(sent[name])} | {_modules(read[name])} | {_purpose(name)} |\n")
    page.write("\n## Commands\n\nIn COMMAND_LONG and COMMAND_INT.\n\n| command | sent by | obeyed by | purpose |\n")
    page.write("|---|---|---|---|\n")
    meanings = _meanings()
    for name, modules in sorted(commands().items()):
        obeying = {module for module in modules if module.startswith(OBEYING)}
        row = (_modules(modules - obeying - ANSWERS), _modules(obeying), meanings.get(name, ""))
        page.write(f"| `{name}` | {' | '.join(row)} |\n")
    return page.getvalue()


def messages() -> tuple[Found, Found]:
    """Return the modules that send each message, and those that read it."""
    sent, read = Found(set), Found(set)
    for module, tree in _trees():
        for node in ast.walk(tree):
            for name in filter(None, map(_made, _classes_used(node))):
                sent[name].add(module)
            if not module.startswith(LOGS) and (name := _looked_for(module, node)):
                read[name].add(module)
    return sent, read


def commands() -> Found:
    """Return the modules that name each command, by its name or by a constant of theirs or of another module."""
    constants, found = dict(_constants()), Found(set)
    for module, tree in _trees():
        for node in ast.walk(tree):
            if name := _command(node):
                found[name].add(module)
            elif isinstance(node, ast.ImportFrom) and node.module:
                source = node.module.removeprefix("autopilot.").replace(".", "/")
                imported = (constants.get((source, each.name)) for each in node.names)
                for name in filter(None, imported):
                    found[name].add(module)
    found[STANDARD_MODE].add("links/ground_station/commands")
    return found


@functools.cache
def _trees() -> list[tuple[str, ast.Module]]:
    paths = sorted(path for room in ROOMS for path in (AUTOPILOT / room).rglob("*.py"))
    named = [(path.relative_to(AUTOPILOT).with_suffix("").as_posix(), path) for path in paths]
    return [
        (module, ast.parse(path.read_text(encoding="utf-8")))
        for module, path in named
        if module != "links/mavlink/messages"
    ]


def _classes_used(node: ast.AST) -> list[ast.expr]:
    """Return what is called here, or derived from."""
    return [node.func] if isinstance(node, ast.Call) else node.bases if isinstance(node, ast.ClassDef) else []


def _made(kind: ast.expr) -> str:
    """Return the name of the message that this class is."""
    if isinstance(kind, ast.Attribute) and (found := re.fullmatch(r"MAVLink_(\w+)_message", kind.attr)):
        return found[1].upper()
    return str(EXTRA[kind.id].msgname) if isinstance(kind, ast.Name) and kind.id in EXTRA else ""


def _looked_for(module: str, node: ast.AST) -> str:
    """Return the name of the message whose number or name this is."""
    if isinstance(node, ast.Attribute) and node.attr.startswith("MAVLINK_MSG_ID_"):
        return "" if module in NAMED_ONLY else node.attr.removeprefix("MAVLINK_MSG_ID_")
    if module in ONE_WAY_ONLY or not (isinstance(node, ast.Constant) and isinstance(node.value, str)):
        return ""
    is_known = hasattr(dialect, f"MAVLINK_MSG_ID_{node.value}") or node.value in {k.msgname for k in EXTRA.values()}
    return node.value if node.value and is_known else ""


def _constants() -> Iterator[tuple[tuple[str, str], str]]:
    """Yield the modules' own names for commands: ZIGZAG, TURNING = int(dialect.MAV_CMD_USER_1), ..."""
    for module, tree in _trees():
        for node in (node for node in tree.body if isinstance(node, ast.Assign)):
            names = [each.id for each in ast.walk(node.targets[0]) if isinstance(each, ast.Name)]
            named = [name for each in ast.walk(node.value) if (name := _command(each))]
            if len(names) == len(named):
                yield from zip(((module, name) for name in names), named, strict=True)


def _command(node: ast.AST) -> str:
    return node.attr if isinstance(node, ast.Attribute) and node.attr.startswith("MAV_CMD_") else ""


def _meanings() -> dict[str, str]:
    """Return what each command is for: MAVLink's words, for those left to users the words beside our constants."""
    entries = dialect.enums["MAV_CMD"].values()
    meanings = {entry.name: _cell(entry.description) for entry in entries if hasattr(entry, "description")}
    meanings[STANDARD_MODE] = "Set a mode by what it does, whatever number the vehicle gives it."
    for _, tree in _trees():
        texts = (text for node in tree.body if (text := _text(node)))
        for name, meaning in (found for text in texts for found in USER_COMMAND.findall(text)):
            meanings[f"MAV_CMD_{name}"] = meaning.removesuffix(".")
    return meanings


def _text(node: ast.stmt) -> str:
    if not (isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)):
        return ""
    return node.value.value if isinstance(node.value.value, str) else ""


def _modules(names: set[str]) -> str:
    return ", ".join(f"`{name}`" for name in sorted(names))


def _purpose(name: str) -> str:
    kind = getattr(dialect, f"MAVLink_{name.lower()}_message", None)
    others = {each.msgname: each.__doc__ or "" for each in EXTRA.values()}
    return _cell((kind.__doc__ or "") if kind is not None else others.get(name, ""))


def _cell(text: str) -> str:
    words = " ".join(text.split()).replace("|", "\\|").replace("<", "&lt;").replace("[", "(").replace("]", ")")
    # a sentence ends before a capital: "e.g. position" goes on
    return re.split(r"(?<=[.;])\s+(?=[A-Z])", words)[0]
