"""What a run is judged by: overshoot, settling time, heading error and rudder travel, from its ticks or a record."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from autopilot.angles import wrap
from autopilot.signals import Tick

SETTLED = math.radians(1.0)


class TurnMeasures(NamedTuple):
    """overshoot [rad] past the new heading, settling [s] until within 1 deg for good (nan: never), travel [rad]."""

    overshoot: float
    settling: float
    travel: float


def turn_measures(ticks: Sequence[Tick], begun: float, start: float, target: float) -> TurnMeasures:
    """Return the measures of a turn ordered at `begun` [s] from heading `start` to `target` [rad]."""
    after = [tick for tick in ticks if tick.now >= begun]
    side = math.copysign(1.0, wrap(target - start))
    errors = [wrap(tick.state.heading - target) for tick in after]
    outside = [tick.now for tick, error in zip(after, errors, strict=True) if abs(error) > SETTLED]
    settled = not outside or outside[-1] < after[-1].now
    return TurnMeasures(
        overshoot=max(0.0, max((side * error for error in errors if abs(error) < 0.5 * math.pi), default=0.0)),
        settling=(outside[-1] - begun if outside else 0.0) if settled else math.nan,
        travel=sum(abs(b.command.angle - a.command.angle) for a, b in itertools.pairwise(after)),
    )


def heading_rms(heading: npt.NDArray[np.float64], target: float) -> float:
    """Return the root mean square [rad] of the headings' errors against `target` [rad]."""
    error = np.angle(np.exp(1j * (heading - target)))
    return float(np.sqrt(np.mean(np.square(error))))


def travel_rate(time: npt.NDArray[np.float64], rudder: npt.NDArray[np.float64]) -> float:
    """Return the rudder's way [rad] per second over a record."""
    return float(np.sum(np.abs(np.diff(rudder))) / (time[-1] - time[0]))
