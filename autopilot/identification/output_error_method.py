"""The output-error fit behind the interface of all methods."""

from __future__ import annotations

from collections.abc import Sequence

from autopilot.identification.identified import Identified
from autopilot.identification.identify import identify
from autopilot.identification.methods import Question
from autopilot.identification.runs import Run


class OutputErrorMethod:
    """Simulate with the recorded rudder, minimise the residuals of heading and rate: the estimate that ships."""

    name = "output-error"
    summary = "simulates the model with the recorded rudder and fits heading and rate; with standard errors"

    def identify(self, runs: Sequence[Run], question: Question) -> Identified:
        """Return `identification.identify.identify` of the runs."""
        return identify(
            runs,
            question.kind,
            question.reference_speed,
            steady_turns=question.steady_turns,
            gain=question.gain,
            course_unstable=question.course_unstable,
            rudder_train=question.rudder_train,
            weighting=question.weighting,
            quadratic=question.quadratic,
            trim=question.trim,
            progress=question.progress,
        )
