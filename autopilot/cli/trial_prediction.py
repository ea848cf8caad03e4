"""`autopilot trial KIND --predict`: how nearly a trial would tell the boat at best, before it is sailed."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from autopilot.angles import wrap
from autopilot.cli.trial_design import accuracy_in_words
from autopilot.identification.runs import Run, Segment
from autopilot.identification.trial_design import Helm, InstrumentNoise, cramer_rao, planned, track_of, zigzag_helm
from autopilot.operators.trial_script import TrialScript
from autopilot.runtime.build import gear_of, model_of
from autopilot.signals import Mode, NavState, Order, OrderKind, Reference, RudderCommand, Tick

if TYPE_CHECKING:
    from autopilot.vessel.schema import Vessel

SPACING_S = 0.1


def predicted_accuracy(script: TrialScript, vessel: Vessel) -> str:
    """Return, in words, the least standard errors of K, T and n3 that any estimate from the trial can have, and the
    time and water that it takes: sailed in thought by the vessel file's model, gear and sensor noise, ten samples a
    second, at the model's reference speed, without wind and current. The script is used up."""
    model, sensors = model_of(vessel)._replace(n0=0.0), vessel.sensors
    run = sailed(script, vessel)
    free = ("gain", "time_constant", *(("n3",) if model.n3 > 0.0 else ()), "n0")
    noise = InstrumentNoise(math.radians(sensors.rate_noise_deg_s), math.radians(sensors.heading_noise_deg))
    accuracy = accuracy_in_words(cramer_rao([run], model, free, noise), model)
    segment = run.segments[0]
    ahead, abeam = (float(np.ptp(axis)) for axis in track_of(segment))
    return (
        f"At best (Cramer and Rao) this trial tells {accuracy}: one standard error, with the vessel file's model, gear "
        f"and sensor noise.\nIt takes {segment.time[-1]:.0f} s and {ahead:.0f} x {abeam:.0f} m, along the course at "
        "the beginning and across it, without wind and current."
        + (f"\nIt would end before its time: {script.reason}." if script.reason else "")
    )


def sailed(script: TrialScript, vessel: Vessel) -> Run:
    """Return the run that a script would be, from rest in yaw to its end."""
    model = model_of(vessel)._replace(n0=0.0)
    helm = _Helmsman(script, model.reference_speed)
    run = planned(model, gear_of(vessel), helm, script.left, SPACING_S, model.reference_speed)
    segment = run.segments[0]
    rows = max(int(np.searchsorted(segment.time, helm.ended, side="right")), 2)
    return Run(run.source, (Segment(*(array[:rows] if array.size else array for array in segment)),))


class _Helmsman:
    """Turns a script's orders into rudder angles for `planned`. Attributes: ended [s], when the script was over."""

    def __init__(self, script: TrialScript, speed: float) -> None:
        self._script, self._speed, self._before = script, speed, (-SPACING_S, 0.0)
        self._zigzag: tuple[Order, Helm] | None = None
        self.ended = math.inf

    def __call__(self, time: float, heading: float) -> float:
        """Return the order [rad] at a time [s] and heading [rad, unwrapped]."""
        since, last = self._before
        rate, self._before = (heading - last) / (time - since), (time, heading)
        order = self._script(time, _tick(time, heading, rate, self._speed))
        if self._script.is_over:
            self.ended = min(self.ended, time)
            return 0.0
        if order.kind is not OrderKind.ZIGZAG:
            return order.rudder
        if self._zigzag is None or not self._zigzag[0].is_same(order):
            # a zigzag swings about the heading that it begins on
            swing, begun = zigzag_helm(order.rudder, order.heading_change), heading
            self._zigzag = order, lambda now, angle: swing(now, angle - begun)
        return self._zigzag[1](time, heading)


def _tick(time: float, heading: float, rate: float, speed: float) -> Tick:
    """Return as much of a tick as a script looks at."""
    state = NavState(time, wrap(heading), rate, speed, 0.0, 0.0, 0.0, True)
    command = RudderCommand(time, 0.0, True)
    return Tick(0, time, (), Order(), state, Reference(heading), 0.0, command, Mode.ENGAGED, ())
