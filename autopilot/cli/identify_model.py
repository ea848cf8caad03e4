"""Which model `autopilot identify` is asked for, and the table of candidates where it shall choose."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Sequence
from typing import Any

from autopilot.errors import InputError
from autopilot.identification.identified import Identified
from autopilot.identification.identify import identify, mean_speed
from autopilot.identification.methods import Question
from autopilot.identification.model_choice import FORMS, Candidate, Choice, Form, choose
from autopilot.identification.runs import Run

HEADINGS = ("candidate", "parameters", "held-out R2", "BIC less the least", "")


def form_of(arguments: argparse.Namespace) -> Form:
    """Return the form that --model, --course-unstable, --fit-rudder and --trim ask for; of auto, that of norrbin."""
    from autopilot.cli.identify import rudder_train

    named = FORMS[
        "nomoto1" if arguments.model == "nomoto" else arguments.model if arguments.model in FORMS else "norrbin"
    ]
    train = (*named.rudder_train, *(name for name in rudder_train(arguments) if name not in named.rudder_train))
    return named._replace(course_unstable=arguments.course_unstable, rudder_train=train, trim=arguments.trim)


def check_model(arguments: argparse.Namespace) -> None:
    """Raise InputError where --model or --trim do not go with the other options."""
    asked = f"--model {arguments.model}" if arguments.model in ("auto", "nomoto2", "norrbin-n2") else ""
    asked = asked or ("--trim per-run" if arguments.trim == "per-run" else "")
    if asked and arguments.method != "output-error":
        raise InputError(
            f"{asked} goes with --method output-error, not with {arguments.method}; leave one of them out."
        )
    if asked and arguments.weighting == "prediction-error":
        raise InputError(f"{asked} and --weighting prediction-error exclude each other; leave one of them out.")
    if arguments.model == "auto" and (
        arguments.course_unstable or arguments.steady_turns or arguments.fit_rudder or arguments.trim == "per-run"
    ):
        raise InputError(
            "--model auto chooses by itself: leave out --course-unstable, --steady-turns, --fit-rudder and --trim."
        )


def chosen(runs: Sequence[Run], question: Question, progress: Callable[[int, int], None]) -> Choice:
    """Return the candidates fitted to the runs, stated at one speed, and the one to take."""
    speed = mean_speed(runs) if question.reference_speed is None else question.reference_speed

    def fit(some: Sequence[Run], form: Form) -> Identified:
        return identify(
            some,
            form.kind,
            speed,
            course_unstable=form.course_unstable,
            rudder_train=form.rudder_train,
            quadratic=form.quadratic,
            trim=form.trim,
        )

    return choose(runs, fit, progress)


def choice_rows(choice: Choice) -> list[tuple[str, ...]]:
    """Return the table of candidates, the chosen one marked."""
    least = min(candidate.bic for candidate in choice.candidates)
    return [HEADINGS, *(_row(candidate, choice.chosen, least) for candidate in choice.candidates)]


def _row(candidate: Candidate, chosen_one: str, least: float) -> tuple[str, ...]:
    if candidate.found is None:
        return candidate.name, "-", "-", "-", candidate.reason
    score = f"{candidate.held_out:.4f}" if math.isfinite(candidate.held_out) else "-"
    mark = "chosen" if candidate.name == chosen_one else ""
    return candidate.name, str(candidate.parameters), score, f"{candidate.bic - least:.1f}", mark


def choice_sentence(choice: Choice) -> str:
    """Return how the candidates were compared, and what was chosen."""
    if choice.folds < 2:
        return f"Chosen: {choice.chosen}, by BIC alone: the record is too short to hold parts of it back."
    parts = f"{choice.folds} blocks of the run" if choice.by_blocks else f"{choice.folds} runs"
    return (
        f"Chosen: {choice.chosen}. Each of {parts} was foretold by a fit that had not seen it; of the candidates that "
        "do so equally well the one with the least BIC is taken."
    )


def choice_document(choice: Choice) -> dict[str, Any]:
    """Return the comparison for JSON; null where a number was not found."""
    return {
        "chosen": choice.chosen,
        "left_out": {"count": choice.folds, "of": "blocks" if choice.by_blocks else "runs"},
        "candidates": [
            {
                "name": candidate.name,
                "parameters": candidate.parameters if candidate.found else None,
                "held_out_r2": candidate.held_out if math.isfinite(candidate.held_out) else None,
                "bic": candidate.bic if math.isfinite(candidate.bic) else None,
                "reason": candidate.reason,
            }
            for candidate in choice.candidates
        ],
    }
