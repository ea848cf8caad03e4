"""Files changed in place keep comments, order and everything that does not change."""

from __future__ import annotations

import dataclasses
import importlib
from importlib import resources
from pathlib import Path
from typing import Any

import pytest

from autopilot.cli.main import main
from autopilot.control.pid import Pid
from autopilot.errors import InputError
from autopilot.vessel.file import (
    dump_vessel,
    edited_text,
    load_vessel,
    parse_vessel,
    text_for,
    updated_vessel_text,
)

LANXIN = (resources.files("firmware_params") / "vessels" / "lanxin.yaml").read_text(encoding="utf-8")


def changed_lines(before: str, after: str) -> list[str]:
    return [line for line in after.splitlines() if line not in before.splitlines()]


def test_one_changed_gain_changes_one_line() -> None:
    vessel = parse_vessel(LANXIN)
    assert vessel.control.backstepping is not None
    gains = dataclasses.replace(vessel.control.backstepping, k1_1_s=1.25)
    other = dataclasses.replace(vessel, control=dataclasses.replace(vessel.control, backstepping=gains))
    text = updated_vessel_text(LANXIN, other, "lanxin.yaml")
    assert [line.strip() for line in changed_lines(LANXIN, text)] == ["k1_1_s: 1.25"]
    assert parse_vessel(text) == other


def test_new_and_removed_keys() -> None:
    vessel = parse_vessel(LANXIN)
    control = dataclasses.replace(vessel.control, pid=None)
    limits = dataclasses.replace(vessel.limits, angle_max_deg=25.0)
    other = dataclasses.replace(vessel, control=control, limits=limits)
    text = updated_vessel_text(LANXIN, other, "lanxin.yaml")
    assert parse_vessel(text) == other
    assert "# ASSUMED, all four" in text
    back = updated_vessel_text(
        text, dataclasses.replace(other, control=dataclasses.replace(control, pid=Pid(1.0))), "x"
    )
    assert parse_vessel(back).control.pid == Pid(1.0)


def test_nothing_changed_leaves_every_byte() -> None:
    assert updated_vessel_text(LANXIN, parse_vessel(LANXIN), "lanxin.yaml") == LANXIN
    assert edited_text(LANXIN, {}, {}, "x") == LANXIN


def without_ruamel(monkeypatch: pytest.MonkeyPatch) -> None:
    real = importlib.import_module

    def missing(name: str, package: str | None = None) -> Any:
        if name.startswith("ruamel"):
            raise ModuleNotFoundError(name)
        return real(name, package)

    monkeypatch.setattr(importlib, "import_module", missing)


def test_without_the_extra_comments_are_never_lost_silently(monkeypatch: pytest.MonkeyPatch) -> None:
    without_ruamel(monkeypatch)
    vessel = dataclasses.replace(load_vessel("lanxin"), name="Other")
    with pytest.raises(InputError, match=r"needs ruamel\.yaml; install it with pip install '\.\[edit\]'"):
        updated_vessel_text(LANXIN, vessel, "lanxin.yaml")
    own = dump_vessel(load_vessel("lanxin"))
    assert updated_vessel_text(own, vessel, "own.yaml") == dump_vessel(vessel)


def test_a_file_of_ours_that_was_edited_by_hand_needs_no_extra(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """What the README asks for after `identify`: look over the rudder section, then `gains FILE --out FILE`."""
    without_ruamel(monkeypatch)
    path = tmp_path / "boat.yaml"
    own = dump_vessel(load_vessel("lanxin"))
    path.write_text(
        own.replace("angle_max_deg: 30.0", "angle_max_deg:   28").replace("  lag_s: 0.1", "\n  lag_s: 0.15")
    )
    assert main(["gains", str(path), "--out", str(path)]) == 0
    rudder = load_vessel(path).rudder
    assert (rudder.angle_max_deg, rudder.lag_s) == (28.0, 0.15)
    path.write_text(own.replace("angle_max_deg: 30.0", "angle_max_deg: 30.0  # measured on the slip"))
    assert main(["gains", str(path), "--out", str(path)]) == 2
    assert "# measured on the slip" in path.read_text()


def test_gains_of_one_boat_do_not_replace_another_boats_file(tmp_path: Path) -> None:
    path = tmp_path / "boat.yaml"
    path.write_text("name: my only boat")
    assert main(["gains", "lanxin", "--out", str(path)]) == 2
    assert path.read_text() == "name: my only boat"
    assert main(["gains", "lanxin", "--out", str(path), "--overwrite"]) == 0
    assert load_vessel(path).name == "Lanxin"


def test_gains_into_the_same_file_keeps_its_comments(tmp_path: Path) -> None:
    path = tmp_path / "boat.yaml"
    path.write_text(LANXIN)
    assert main(["gains", str(path), "--out", str(path)]) == 0
    text = path.read_text()
    assert "# ASSUMED: a small attitude and heading reference system." in text
    assert text != LANXIN


def test_a_file_in_another_encoding_is_edited_in_its_place(tmp_path: Path) -> None:
    file = tmp_path / "boat.yaml"
    file.write_text(dump_vessel(load_vessel("lanxin")), encoding="utf-16")
    assert text_for(file, load_vessel("mariner")) == dump_vessel(load_vessel("mariner"))
