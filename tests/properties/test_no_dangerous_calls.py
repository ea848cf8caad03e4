"""What an attacker would look for in the sources: unsafe loading, shells, and listening on every network by default."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SOURCES = sorted(path for room in ("autopilot", "sitl", "firmware_params") for path in (ROOT / room).rglob("*.py"))
CODE_FROM_DATA = {"eval", "exec", "compile", "__import__"}
FORBIDDEN_MODULES = {"pickle", "cPickle", "dill", "shelve", "marshal", "jsonpickle", "joblib", "telnetlib", "ftplib"}
FORBIDDEN_CALLS = {
    *("yaml.load", "yaml.load_all", "yaml.unsafe_load", "yaml.unsafe_load_all", "yaml.full_load", "yaml.full_load_all"),
    *("os.system", "os.popen", "subprocess.getoutput", "subprocess.getstatusoutput", "tempfile.mktemp"),
    *("numpy.fromfile", "pty.spawn", "json.load", "json.loads", "json.JSONDecoder"),
}
SAFE_LOADERS = {"SafeLoader", "CSafeLoader"}
OURS_ALONE = ("firmware/journal", "cli/gains")
LET_BE = {
    "autopilot/vessel/file.py": ["calls yaml.load"],
    "autopilot/files/outside.py": ["calls json.loads"],
    **{f"autopilot/{name}.py": ["calls json.loads"] for name in OURS_ALONE},
}
"""ruamel.yaml's round trip, which keeps comments: it builds no objects of a document's choosing. JSON from outside is
read by `autopilot.files.outside`; the rest is our own, where a parameter may well be NaN."""


def dangers(source: str) -> list[str]:
    """Return what is dangerous in a module's source, each with its line."""
    found: list[str] = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import | ast.ImportFrom):
            names = [alias.name for alias in node.names]
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            found += [f"{node.lineno}: imports {name}" for name in names if name.split(".")[0] in FORBIDDEN_MODULES]
        if isinstance(node, ast.Call):
            found += dangerous_call(node)
        if isinstance(node, ast.ClassDef):
            bases = [ast.unparse(base) for base in node.bases]
            found += [f"{node.lineno}: {base}" for base in bases if base.endswith("Loader") and not is_safe(base)]
        if isinstance(node, ast.Constant) and node.value in ("0.0.0.0", "::"):
            found.append(f"{node.lineno}: listens on every network")
    return found


def is_safe(loader: str) -> bool:
    return loader.rsplit(".", 1)[-1] in SAFE_LOADERS


def dangerous_call(call: ast.Call) -> list[str]:
    name = ast.unparse(call.func)
    found = [f"{call.lineno}: calls {name}"] if name in CODE_FROM_DATA | FORBIDDEN_CALLS else []
    for keyword in call.keywords:
        value = keyword.value
        if keyword.arg == "shell" and not (isinstance(value, ast.Constant) and value.value is False):
            found.append(f"{call.lineno}: a shell")
        if keyword.arg == "allow_pickle" and not (isinstance(value, ast.Constant) and value.value is False):
            found.append(f"{call.lineno}: pickled arrays")
        if keyword.arg == "Loader" and name != "yaml.parse" and not is_safe(ast.unparse(value)):
            found.append(f"{call.lineno}: YAML with {ast.unparse(value)}")
    if name.endswith((".bind", "create_server")) and call.args:
        first = call.args[0]
        host = first.elts[0] if isinstance(first, ast.Tuple) and first.elts else first
        if isinstance(host, ast.Constant) and host.value == "":
            found.append(f"{call.lineno}: listens on every network")
    return found


def test_the_sources_were_found() -> None:
    assert len(SOURCES) > 150


@pytest.mark.parametrize("room", ["autopilot", "sitl", "firmware_params"])
def test_no_source_loads_unsafely_or_runs_a_shell(room: str) -> None:
    found = {
        str(path.relative_to(ROOT)): [what.partition(": ")[2] for what in dangers(path.read_text())]
        for path in SOURCES
        if path.relative_to(ROOT).parts[0] == room
    }
    assert {path: what for path, what in found.items() if what and what != LET_BE.get(path)} == {}


@pytest.mark.parametrize(
    "source",
    [
        "import yaml\nyaml.load(text)",
        "import yaml\nyaml.load_all(text, Loader=yaml.Loader)",
        "class Mine(yaml.FullLoader): pass",
        "subprocess.run(line, shell=True)",
        "subprocess.run(line, shell=wanted)",
        "os.system('ls')",
        "eval(text)",
        "from pickle import loads",
        "numpy.load(path, allow_pickle=True)",
        "json.loads(content)",
        "sock.bind(('', 14550))",
        "serve('0.0.0.0')",
    ],
)
def test_the_search_finds_what_it_looks_for(source: str) -> None:
    assert dangers(source)


def test_the_search_lets_the_safe_ways_be() -> None:
    assert dangers("class Strict(yaml.SafeLoader): pass\nyaml.parse(text, Loader=yaml.CSafeLoader)") == []
    assert dangers("subprocess.run([program, '--flag'], shell=False)\nsock.bind((host, port))") == []
