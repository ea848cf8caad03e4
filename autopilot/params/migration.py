"""Older files brought to the newest schema as they are read; newer ones refused with what to do.

A step takes the root of a file of one version to the next and touches nothing else, so that every value keeps its
place for the sentences about it. Version 2 of vessel files names the recordings of a model apart from its source;
version 2 of firmware files has `include`, `leave_out`, and ranges, units and types of parameters.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

from autopilot.params.strict_yaml import Node

Step = Callable[[Node], Node]

IDENTIFIED_FROM = "identified from "


def _name_recordings(root: Node) -> Node:
    """Vessel 1 -> 2: `model.source: identified from a.csv, b.csv` becomes `model.log: [a.csv, b.csv]` and a source."""
    model = root.at("model")
    source = model.at("source")
    if source is model or not isinstance(source.value, str) or not source.value.startswith(IDENTIFIED_FROM):
        return root
    names = source.value.removeprefix(IDENTIFIED_FROM).split(", ")
    log = source._replace(value=[source._replace(value=name, path="model.log") for name in names], path="model.log")
    return _with(root, "model", _with(_with(model, "source", source._replace(value="identified")), "log", log))


VESSEL_STEPS: Mapping[int, Step] = {1: _name_recordings}
FIRMWARE_STEPS: Mapping[int, Step] = {1: lambda root: root}


def newest(steps: Mapping[int, Step]) -> int:
    """Return the version that the last step leads to."""
    return max(steps) + 1


def migrated(root: Node, steps: Mapping[int, Step]) -> Node:
    """Return the document as the newest version has it; raises InputError where it is of no known version."""
    version = root.at("schema_version")
    if version is root or not isinstance(version.value, int) or isinstance(version.value, bool):
        return root  # the schema's own sentence about a missing key or a wrong type is the right one
    known = newest(steps)
    if not 1 <= version.value <= known:
        advice = "update Norrbin to read this file" if version.value > known else f"write {known}"
        raise version.fault(f"schema_version is {version.value}, this version of Norrbin reads 1 to {known}; {advice}.")
    for number in range(version.value, known):
        root = steps[number](root)
    return _with(root, "schema_version", version._replace(value=known))


def _with(node: Node, key: str, child: Node) -> Node:
    assert isinstance(node.value, dict)
    return node._replace(value={**node.value, key: child})
