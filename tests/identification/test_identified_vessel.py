"""The vessel file that identification writes: the model, the rudder as far as seen, the rest of an old file kept."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
from zigzag_trials import run_of, zigzag

from autopilot.cli.identify_report import Result, as_json, as_text
from autopilot.cli.identify_vessel import ASSUMED_RATE_DEG_S, recorded_rudder_rate, write_vessel
from autopilot.errors import InputError
from autopilot.identification.identified import Identified
from autopilot.identification.noise import Noise
from autopilot.identification.prediction import predict
from autopilot.models.norrbin import Norrbin
from autopilot.params.vessel_file import load_vessel

TABLE = zigzag(math.radians(15.0), 10.0, 0.1)
MODEL = Norrbin(0.7, 0.33, 3.2, n0=-0.01, reference_speed=5.0)


def result(table: dict[str, np.ndarray] = TABLE, untold: str = "n3") -> Result:
    errors = {"gain": 0.01, "time_constant": 0.02, "n3": 0.3, "n1": None, "n0": 0.001}
    run = run_of(table, "folder/trial.csv")
    found = Identified(MODEL, errors, {untold: f"{untold}: not told."}, (Noise(0.01, 0.5), Noise(0.02, 0.9)))
    return Result("norrbin", found, None, [(run, "fit", predict(MODEL, run))])


def test_a_new_file_holds_the_model_and_the_rudder_seen(tmp_path: Path) -> None:
    path = tmp_path / "boat.yaml"
    write_vessel(str(path), result())
    vessel = load_vessel(path)
    assert vessel.name == "boat"
    assert (vessel.model.K_1_s, vessel.model.n3_s2_rad2, vessel.model.n0_rad_s) == (0.7, 3.2, -0.01)
    assert vessel.model.standard_errors.T_s == 0.02
    assert (vessel.model.source, vessel.model.log) == ("identified", ("trial.csv",))
    assert vessel.rudder.angle_max_deg == pytest.approx(15.0)
    assert vessel.rudder.rate_max_deg_s == pytest.approx(20.0, abs=0.2)
    assert "recordings" in vessel.rudder.source


def test_an_old_file_keeps_everything_but_the_model(tmp_path: Path) -> None:
    path = tmp_path / "lanxin.yaml"
    write_vessel(str(path), result())
    text = path.read_text()
    path.write_text(text.replace("name: lanxin", "name: My own").replace("angle_max_deg: 15.0", "angle_max_deg: 33.0"))
    other = result()
    changed = other.found._replace(model=MODEL._replace(gain=0.9))
    write_vessel(str(path), other._replace(found=changed))
    vessel = load_vessel(path)
    assert (vessel.name, vessel.rudder.angle_max_deg, vessel.model.K_1_s) == ("My own", 33.0, 0.9)


def test_a_rudder_that_jumps_has_no_rate_to_be_read(tmp_path: Path) -> None:
    jumping = {**TABLE, "rudder_rad": np.where(TABLE["rudder_rad"] > 0.0, 0.26, -0.26)}
    assert recorded_rudder_rate(run_of(jumping).segments) is None
    assert recorded_rudder_rate(run_of(TABLE).segments) == pytest.approx(math.radians(20.0), rel=0.01)
    path = tmp_path / "boat.yaml"
    write_vessel(str(path), result(jumping))
    rudder = load_vessel(path).rudder
    assert rudder.rate_max_deg_s == ASSUMED_RATE_DEG_S
    assert "assumed" in rudder.source


def test_the_table_for_people_names_every_parameter_in_both_units() -> None:
    text = as_text(result())
    for part in ("K ", "T ", "n3", "n0", "s^2/deg^2", "trial.csv", "fit", "n3: not told."):
        assert part in text
    assert "held" in text  # n1 has no standard error


@pytest.mark.parametrize("untold", ["K", "T"])
def test_what_the_runs_do_not_determine_is_named_and_not_printed_or_written(tmp_path: Path, untold: str) -> None:
    path, found = tmp_path / "boat.yaml", result(untold=untold)
    with pytest.raises(InputError, match=f"boat.yaml is not written, for it needs K and T: {untold}: not told."):
        write_vessel(str(path), found)
    assert not path.exists()
    row = next(line for line in as_text(found).splitlines() if line.startswith(f"{untold} "))
    assert "not determined" in row and f"{MODEL.gain if untold == 'K' else MODEL.time_constant:g} " not in row
    told = json.loads(as_json(found))
    assert told["parameters"][untold]["value"] is None
    assert told["unidentifiable"] == [untold]
    assert told["parameters"]["n3"]["value"] == MODEL.n3
