"""The identification's page: what is on it, and that it stands alone."""

from __future__ import annotations

import re
import shlex
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from zigzag_trials import noisy, zigzag

pytest.importorskip("matplotlib", reason="needs the extra report")
pytest.importorskip("jinja2", reason="needs the extra report")

from autopilot.cli import identify
from autopilot.cli.main import main
from autopilot.identification.registry import METHODS


def recording(path: Path, seed: int, angle_deg: float = 15.0) -> Path:
    table = noisy(zigzag(np.radians(angle_deg), 40.0, 0.1), np.radians(0.1), np.radians(0.2), seed)
    rows = np.stack(list(table.values()), axis=1)
    np.savetxt(path, rows, delimiter=",", header=",".join(table), comments="")
    return path


class Made(NamedTuple):
    """A page and the command that made it."""

    text: str
    typed: str


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Made:
    folder = tmp_path_factory.mktemp("report")
    fit, holdout = recording(folder / "fit.csv", 3), recording(folder / "unseen.csv", 2, 20.0)
    words = ["identify", str(fit), "--holdout", str(holdout), "--report", str(folder / "page.html")]
    assert main(words) == 0
    return Made((folder / "page.html").read_text(encoding="utf-8"), shlex.join(["autopilot", *words]))


def test_the_page_shows_every_run_and_needs_nothing_else(made: Made) -> None:
    for wanted in (
        "fit.csv (fit)",
        "unseen.csv (holdout)",
        "Correlation of the errors",
        "Steady turns",
        "95 % interval",
    ):
        assert wanted in made.text
    assert made.text.count("<svg") >= 4
    assert "the fit never saw it" in made.text
    # nothing is fetched from elsewhere
    assert not re.search(r"<(link|img)\b|<script[^>]|@import|url\((?!#)", made.text)
    assert f"<code>{made.typed}</code>" in made.text.rpartition("Made by")[2], "the command, whole"


def test_the_page_shows_how_each_recursive_method_converged(made: Made) -> None:
    shown = made.text.partition("Recursive methods")[2]
    for method in METHODS:
        assert (f">{method.name}<" in shown or f"<!-- {method.name} -->" in shown) is (method.name != "output-error")


def test_the_interval_on_the_page_holds_the_truth(made: Made) -> None:
    row = re.search(r"<td>K</td><td>1/s</td><td>[^<]*</td><td>[^<]*</td><td>([^<]*)</td><td>([^<]*)</td>", made.text)
    assert row is not None
    low, high = (float(part) for part in row[1].split("…"))
    assert low < 0.701 < high
    # nobody can be surer than the bound allows: half an interval is 1.96 standard errors
    assert (high - low) / 2.0 / 1.96 > 0.9 * float(row[2])


def test_a_folder_that_is_not_there_is_one_sentence_before_anything_is_worked_out(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def worked_out(*given: object) -> None:
        raise AssertionError("the fit was begun")

    monkeypatch.setattr(identify, "_identify", worked_out)
    fit = recording(tmp_path / "fit.csv", 1)
    for option in ("--report", "--out"):
        assert main(["identify", str(fit), option, str(tmp_path / "no" / "page.html")]) == 2
        assert "cannot be written" in capsys.readouterr().err
