"""Gains tuned over a campaign: better on seeds that the search has not seen, and never without margins."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from autopilot.cli.main import main
from autopilot.errors import ExitCode, RefusedError
from autopilot.runtime.build import verdict_of
from autopilot.vessel.file import load_vessel
from sitl.campaign.study import BoatSection, Job, SeaSection, Study
from sitl.campaign.tuning import REFUSED_COST, Search, Trial, tune, with_gains
from sitl.scenario import WindSection

STUDY = Study(
    1,
    "short",
    {"boat": BoatSection("lanxin")},
    runs=2,
    seconds=20.0,
    measured_from_s=5.0,
    seas={"breeze": SeaSection(wind=WindSection(5.0, gust_m_s=0.7))},
)


def test_tuned_gains_are_better_on_held_out_seeds_and_have_margins() -> None:
    pytest.importorskip("numba", reason="the extra `fast` is not installed")
    vessel, shown = load_vessel("lanxin"), []
    found = tune(
        Job(STUDY, "."), vessel, Search("backstepping", 1.0, 3), 1, lambda done, total: shown.append((done, total))
    )
    assert shown == [(1, 3), (2, 3), (3, 3)]
    assert found.tuned.cost < 0.9 * found.before.cost
    assert found.training.cost != found.tuned.cost
    assert not verdict_of(found.vessel, "backstepping").refusal
    assert replace(found.vessel, control=vessel.control) == vessel


def test_gains_without_margins_are_never_sailed() -> None:
    vessel = load_vessel("lanxin")
    trial = Trial(Job(STUDY, "."), vessel, "pid", 1.0)
    assert trial.judged(with_gains(vessel, "pid", (200.0, 1.0, 50.0))).cost == REFUSED_COST


def test_a_law_without_gains_has_nothing_to_begin_with() -> None:
    vessel = load_vessel("lanxin")
    vessel = replace(vessel, control=replace(vessel.control, sliding=None))
    with pytest.raises(RefusedError, match="no gains for the law 'sliding'"):
        tune(Job(STUDY, "."), vessel, Search("sliding", 1.0, 1), 1, lambda done, total: None)


def test_the_command_writes_the_tuned_vessel(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("numba", reason="the extra `fast` is not installed")
    study, out = tmp_path / "study.yaml", tmp_path / "tuned.yaml"
    study.write_text(
        "schema_version: 1\nname: s\nboats: {b: {vessel: lanxin}}\nruns: 1\nseconds: 8\nmeasured_from_s: 2\n"
    )
    options = ["--tune", "--law", "backstepping", "--weight", "2", "--generations", "1", "--study", str(study)]
    assert main(["gains", "lanxin", *options, "--out", str(out), "--json"]) == 0
    printed = json.loads(capfd.readouterr().out)
    assert printed["gains"].items() <= vars(load_vessel(out).control.backstepping).items()
    assert set(printed["held_out"]) == {"tuned", "before"}


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (["--weight", "2"], "--weight goes with --tune"),
        (["--tune", "--level", "3"], "--level is for the design"),
        (["--tune", "--weight", "-1"], "allowed is 0"),
        (["--tune", "--study", "nowhere"], "neither a file nor a shipped study"),
    ],
)
def test_wrong_options_are_reported(options: list[str], sentence: str, capfd: pytest.CaptureFixture[str]) -> None:
    assert main(["gains", "lanxin", *options]) == ExitCode.USAGE
    assert sentence in capfd.readouterr().err
