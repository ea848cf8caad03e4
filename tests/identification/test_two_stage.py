"""The two stages behind the interface of all methods, and their forgetting."""

from __future__ import annotations

import numpy as np
import pytest
from zigzag_trials import run_of, zigzag

from autopilot.cli.main import main
from autopilot.errors import InputError
from autopilot.identification.identified import Question
from autopilot.identification.identify import SteadyTurns
from autopilot.identification.registry import method_named
from autopilot.identification.runs import Run
from autopilot.identification.two_stage import nomoto_at_end, nomoto_path, nomoto_stage

TWO_STAGE = method_named("two-stage")


def sampled(gain: float, seconds: float = 60.0) -> Run:
    return run_of(zigzag(0.26, seconds, 0.02, K=gain, T=1.0, n3=0.0))


def test_with_forgetting_the_latest_run_counts_and_without_it_all_do() -> None:
    light, laden = sampled(0.8), sampled(0.5)
    forgetful = nomoto_stage([light, laden], 5.0, forgetting=0.998)
    faithful = nomoto_stage([light, laden], 5.0)
    assert forgetful is not None and faithful is not None
    assert forgetful.gain == pytest.approx(0.5, rel=0.03)
    assert 0.52 < faithful.gain < 0.78


def test_without_forgetting_the_sums_of_all_equations_end_where_the_recursion_does() -> None:
    runs = [sampled(0.8), sampled(0.5)]
    at_once, in_turn = nomoto_stage(runs, 5.0), nomoto_at_end(nomoto_path(runs, 5.0)[1])
    assert at_once is not None and in_turn is not None
    np.testing.assert_allclose(at_once, in_turn, rtol=1.0e-9)


def test_n3_comes_from_steady_turns_with_the_gain_held() -> None:
    rates = np.array([0.05, 0.1, 0.15, 0.2])
    turns = SteadyTurns((rates + 4.0 * rates**3) / 0.7, rates)
    run = run_of(zigzag(0.1, 60.0, 0.02, K=0.7, T=1.0, n3=4.0))
    found = TWO_STAGE.identify([run], Question(steady_turns=turns, gain=0.7, reference_speed=5.0))
    assert found.model.n3 == pytest.approx(4.0, rel=1.0e-6)
    assert found.standard_errors["n3"] is not None
    bent = SteadyTurns((rates - 0.5 * rates**3) / 0.7, rates)
    held = TWO_STAGE.identify([run], Question(steady_turns=bent, gain=0.7, reference_speed=5.0))
    assert held.model.n3 == 0.0
    assert "bounds no turn" in held.unidentifiable["n3"]


def test_without_steady_turns_n3_is_said_to_be_missing() -> None:
    found = TWO_STAGE.identify([sampled(0.7)], Question())
    assert "steady turns" in found.unidentifiable["n3"]
    assert any("standard errors" in note for note in found.notes)


def test_sampled_too_coarsely_it_says_so() -> None:
    table = zigzag(0.26, 120.0, 0.02, K=0.7, T=0.05, n3=0.0)
    coarse = {name: values[::25] for name, values in table.items()}
    try:
        found = TWO_STAGE.identify([run_of(coarse)], Question("nomoto"))
    except InputError as refused:
        assert "K and T not both positive" in str(refused)
    else:
        assert found.model.time_constant > 0.0


@pytest.mark.parametrize("value", ["0", "-1", "1.1", "nan"])
def test_a_forgetting_factor_outside_zero_to_one_is_a_sentence(value: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["identify", "x.csv", "--method", "two-stage", "--forgetting", value]) == 2
    assert "--forgetting" in capsys.readouterr().err


def test_the_methods_are_listed_and_an_unknown_one_is_a_sentence(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["identify", "--method", "list"]) == 0
    listed = capsys.readouterr().out
    assert listed.startswith("output-error") and "\nintegral " in listed and "\ntwo-stage " in listed
    assert main(["identify", "x.csv", "--method", "magic"]) == 2
    assert "magic" in capsys.readouterr().err
