"""What identification reads of a log that Norrbin wrote itself."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from plant import Plant

from autopilot.cli.main import build_parser
from autopilot.control.registry import TRIAL_LAW
from autopilot.identification.identify import identify
from autopilot.identification.ordered_rudder import slower_rudder, with_rudder_of
from autopilot.logs.reading import load_run, read_recording
from autopilot.logs.series import ORDER, RUDDER, Series
from autopilot.logs.table import LONGEST_HOLD_S, through_gear
from autopilot.models.norrbin import Norrbin
from autopilot.models.steering_gear import SteeringGear
from autopilot.operators.trial_script import TrialScript, steps_of
from autopilot.runtime.build import build_pilot, gear_of, model_of
from autopilot.runtime.record import Recorder
from autopilot.signals import Mode, Order, OrderKind, SpeedSample
from autopilot.vessel.file import dump_vessel, load_vessel

DT = 0.05


class _Kept:
    """A sink of a log that keeps what is written, and has a file of it at the end."""

    part_bytes, lost, dropped, trouble = None, 0, 0, ""

    def __init__(self, path: Path) -> None:
        self.path, self._kept = path, bytearray()

    def write(self, data: bytes, ticks: int = 0) -> None:
        self._kept += data

    def next_part(self) -> None:
        raise AssertionError("one part is enough")

    def close(self) -> None:
        self.path.write_bytes(self._kept)


def _sailed(path: Path, rudder_rate_deg_s: float) -> str:
    """Return the log of a zigzag with Lanxin's file, whose rudder goes 20 deg/s, of a boat six times as slow."""
    filed = load_vessel("lanxin")
    guess = replace(filed, alarms=replace(filed.alarms, reversed_rudder=False))
    boat = Norrbin(0.35, 2.2, 1.2, reference_speed=3.0)
    plant = Plant(boat, gear_of(filed)._replace(rate_max=math.radians(rudder_rate_deg_s)), heading=3.0)
    pilot = build_pilot(guess, TRIAL_LAW)
    options = build_parser().parse_args(["trial", "zigzag", "lanxin", "--duration", "70"])
    script = TrialScript(steps_of(options, filed.rudder.angle_max_deg, model_of(filed)))
    recorder = Recorder(_Kept(path), {"vessel": dump_vessel(guess), "law": TRIAL_LAW}, 0.0)
    tick = None
    while plant.time < 72.0 and not script.is_over:
        samples = (*plant.sense(), SpeedSample(plant.time, 3.0, source="log"))
        tick = pilot.step(plant.time, samples, script(plant.time, tick))
        recorder.record(tick, [])
        plant.step(tick.command.angle if tick.command.engaged else 0.0, DT)
    recorder.close()
    return str(path)


@pytest.mark.parametrize("rudder_rate_deg_s", [5.0, 20.0])
def test_a_boat_that_is_not_its_file_s_is_identified_by_what_was_ordered_not_by_what_the_pilot_believed(
    tmp_path: Path, rudder_rate_deg_s: float
) -> None:
    """The pilot of a trial explains a slow boat by a slow rudder where the model in its file is quick."""
    run = load_run(_sailed(tmp_path / "trial.tlog", rudder_rate_deg_s))
    found = slower_rudder([run], math.radians(20.0))
    sure = found is not None and found.is_sure
    if found is not None and sure:
        run = with_rudder_of(run, found)
    rate = math.radians(20.0) if found is None or not sure else found.rate
    assert rate == pytest.approx(math.radians(rudder_rate_deg_s), rel=0.05)
    model = identify([run]).model
    assert model.gain == pytest.approx(0.35, rel=0.05)
    assert model.time_constant == pytest.approx(2.2, rel=0.1)


def test_a_log_with_a_single_order_is_read(tmp_path: Path) -> None:
    """A run that is killed as it engages has ordered the rudder once."""
    filed, path = load_vessel("lanxin"), tmp_path / "short.tlog"
    plant, pilot = Plant(model_of(filed), gear_of(filed), heading=3.0), build_pilot(filed)
    recorder = Recorder(_Kept(path), {"vessel": dump_vessel(filed), "law": None}, 0.0)
    order = Order(OrderKind.STANDBY, serial=1)
    tick = pilot.step(plant.time, plant.sense(), order)
    while tick.mode is not Mode.ENGAGED:
        recorder.record(tick, [])
        plant.step(0.0, DT)
        order = order if plant.time < 10.0 else Order(OrderKind.HEADING, 3.0, serial=2)
        tick = pilot.step(plant.time, plant.sense(), order)
        assert plant.time < 20.0
    recorder.record(tick, [])
    recorder.close()
    found = {series.quantity: series for series in read_recording(str(path)).series}
    assert found[ORDER].time == pytest.approx([tick.now])
    assert len(found[RUDDER].time) > 100


def test_the_gear_follows_a_single_order_until_it_is_old() -> None:
    moved = through_gear(Series(ORDER, "x", np.array([5.0]), np.array([0.3])), SteeringGear(0.6, 0.1))
    assert (moved.time[0], moved.time[-1]) == (5.0, 5.0 + LONGEST_HOLD_S)
    assert moved.values == pytest.approx(0.3)
