"""The identification's page: what is on it, and that it stands alone."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import numpy as np
import pytest
from zigzag_trials import noisy, zigzag

pytest.importorskip("matplotlib", reason="needs the extra report")
pytest.importorskip("jinja2", reason="needs the extra report")

from autopilot.cli.main import main


def recording(path: Path, seed: int, angle_deg: float = 15.0) -> Path:
    table = noisy(zigzag(np.radians(angle_deg), 40.0, 0.1), np.radians(0.1), np.radians(0.2), seed)
    rows = np.stack(list(table.values()), axis=1)
    np.savetxt(path, rows, delimiter=",", header=",".join(table), comments="")
    return path


def test_the_page_shows_every_run_and_needs_nothing_else(tmp_path: Path) -> None:
    fit, holdout = recording(tmp_path / "fit.csv", 1), recording(tmp_path / "unseen.csv", 2, 20.0)
    page = tmp_path / "page.html"
    assert main(["identify", str(fit), "--holdout", str(holdout), "--report", str(page)]) == 0
    text = page.read_text(encoding="utf-8")
    for wanted in (
        "fit.csv (fit)",
        "unseen.csv (holdout)",
        "Correlation of the errors",
        "Steady turns",
        "95 % interval",
    ):
        assert wanted in text
    assert text.count("<svg") >= 4
    assert "the fit never saw it" in text
    # nothing is fetched from elsewhere
    assert not re.search(r"<(link|img)\b|<script[^>]|@import|url\((?!#)", text)
    typed = shlex.join(["autopilot", "identify", str(fit), "--holdout", str(holdout), "--report", str(page)])
    assert f"<code>{typed}</code>" in text.rpartition("Made by")[2], "the command, whole"


def test_the_interval_on_the_page_holds_the_truth(tmp_path: Path) -> None:
    fit, page = recording(tmp_path / "fit.csv", 3), tmp_path / "page.html"
    assert main(["identify", str(fit), "--report", str(page)]) == 0
    row = re.search(
        r"<td>K</td><td>1/s</td><td>[^<]*</td><td>[^<]*</td><td>([^<]*)</td><td>([^<]*)</td>", page.read_text()
    )
    assert row is not None
    low, high = (float(part) for part in row[1].split("…"))
    assert low < 0.701 < high
    # nobody can be surer than the bound allows: half an interval is 1.96 standard errors
    assert (high - low) / 2.0 / 1.96 > 0.9 * float(row[2])


def test_a_folder_that_is_not_there_is_one_sentence(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    fit = recording(tmp_path / "fit.csv", 1)
    assert main(["identify", str(fit), "--report", str(tmp_path / "no" / "page.html")]) == 2
    assert "cannot be written" in capsys.readouterr().err
