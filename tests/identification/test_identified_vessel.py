"""The vessel file that identification writes: the model, the rudder as far as seen, the rest of an old file kept."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from zigzag_trials import rudder_with_play, run_of, zigzag

from autopilot.cli.identify_vessel import ASSUMED_RATE_DEG_S, Given, boat_for, write_vessel
from autopilot.errors import InputError
from autopilot.identification.identified import Identified
from autopilot.identification.residual_tests import predict
from autopilot.identification.residuals import Noise
from autopilot.identification.rudder_path import DIRECT, measured_rate, rudder_rate_of
from autopilot.identification.runs import Segment
from autopilot.models.norrbin import Norrbin
from autopilot.report.identification import Result, as_json, as_text
from autopilot.runtime.build import gear_of
from autopilot.vessel.file import dump_vessel, load_vessel
from autopilot.vessel.schema import Vessel
from sitl.boat import plant_of
from sitl.scenario import Scenario

TABLE = zigzag(math.radians(15.0), 10.0, 0.1)
STOP = Given(end_stop_deg=35.0)
MODEL = Norrbin(0.7, 0.33, 3.2, n0=-0.01, reference_speed=5.0)


def result(table: dict[str, np.ndarray] = TABLE, unknown: str = "n3") -> Result:
    errors = {"gain": 0.01, "time_constant": 0.02, "n3": 0.3, "n1": None, "n0": 0.001}
    run = run_of(table, "folder/trial.csv")
    found = Identified(MODEL, errors, {unknown: f"{unknown}: not determined."}, (Noise(0.01, 0.5), Noise(0.02, 0.9)))
    return Result("norrbin", found, None, [(run, "fit", predict(MODEL, run))], rudder_rate=rudder_rate_of([run]))


def written(path: Path, found: Result, given: Given = STOP) -> tuple[Vessel, list[str]]:
    """Write as the command does and read the file again; also the remarks."""
    boat = boat_for(str(path), [run for run, _, _ in found.predictions], given)
    remarks = write_vessel(str(path), found, boat, given)
    return load_vessel(path), remarks


def test_a_new_file_holds_the_model_the_end_stop_given_and_the_rate_measured(tmp_path: Path) -> None:
    vessel, remarks = written(tmp_path / "boat.yaml", result())
    assert vessel.name == "boat"
    assert (vessel.model.K_1_s, vessel.model.n3_s2_rad2, vessel.model.n0_rad_s) == (0.7, 3.2, -0.01)
    assert vessel.model.standard_errors.T_s == 0.02
    assert (vessel.model.source, vessel.model.log) == ("identified", ("trial.csv",))
    assert vessel.rudder.angle_max_deg == 35.0
    assert vessel.helm.rudder_at_full_pwm_deg == 35.0
    assert vessel.rudder.rate_max_deg_s == pytest.approx(20.0, abs=0.2)
    assert "measured" in vessel.rudder.source
    assert remarks == []


def test_a_new_file_holds_the_noise_that_the_recordings_show(tmp_path: Path) -> None:
    random, rows = np.random.default_rng(20261124), dict(TABLE)
    rows["heading_rad"] = rows["heading_rad"] + math.radians(0.4) * random.standard_normal(rows["time_s"].size)
    rows["yaw_rate_rad_s"] = rows["yaw_rate_rad_s"] + math.radians(0.6) * random.standard_normal(rows["time_s"].size)
    sensors = written(tmp_path / "noisy.yaml", result(rows))[0].sensors
    assert sensors.heading_noise_deg == pytest.approx(0.4, rel=0.25)
    assert sensors.rate_noise_deg_s == pytest.approx(0.6, rel=0.25)
    assert "measured" in sensors.source
    exact = written(tmp_path / "exact.yaml", result())[0].sensors
    assert exact.heading_noise_deg >= 0.05, "no heading aboard is better"


def test_a_new_file_says_whether_the_recordings_have_a_gyro(tmp_path: Path) -> None:
    assert written(tmp_path / "gyro.yaml", result())[0].sensors.gyro
    compass_alone = dict(TABLE) | {"yaw_rate_rad_s": np.full(TABLE["time_s"].size, math.nan)}
    assert not written(tmp_path / "compass.yaml", result(compass_alone))[0].sensors.gyro


def test_the_amplitude_of_a_trial_is_no_end_stop(tmp_path: Path) -> None:
    path = tmp_path / "boat.yaml"
    with pytest.raises(InputError, match=r"needs the rudder's end stop.*--rudder-max-deg DEG, or --vessel FILE"):
        written(path, result(), Given())
    with pytest.raises(InputError, match="the recordings have the rudder at 15 deg"):
        written(path, result(), Given(end_stop_deg=10.0))
    assert not path.exists()


@pytest.mark.parametrize("where", ["given", "in the log"])
def test_the_rudder_of_the_boats_file_is_kept_whole(tmp_path: Path, where: str) -> None:
    lanxin, found = load_vessel("lanxin"), result()
    if where == "in the log":
        runs = [(run._replace(vessel=dump_vessel(lanxin)), *rest) for run, *rest in found.predictions]
        found = found._replace(predictions=runs)
    vessel, _ = written(tmp_path / "boat.yaml", found, Given(lanxin if where == "given" else None))
    assert vessel.rudder == lanxin.rudder
    assert (vessel.sensors, vessel.failsafe, vessel.alarms) == (lanxin.sensors, lanxin.failsafe, lanxin.alarms)
    assert vessel.helm.rudder_at_full_pwm_deg == lanxin.rudder.angle_max_deg
    assert vessel.control.backstepping is None, "gains of another model"
    assert (vessel.name, vessel.model.K_1_s) == ("boat", 0.7)


def test_a_bow_thruster_stays_in_the_file_with_the_speed_below_which_it_steers(tmp_path: Path) -> None:
    boat = load_vessel("bow_thruster")
    vessel, _ = written(tmp_path / "boat.yaml", result(), Given(boat))
    assert vessel.drive.bow_thruster == boat.drive.bow_thruster
    assert vessel.control.steerage_m_s == boat.control.steerage_m_s


def test_an_end_stop_that_is_edited_later_does_not_change_the_servos_scale(tmp_path: Path) -> None:
    path = tmp_path / "boat.yaml"
    written(path, result())
    path.write_text(path.read_text().replace("angle_max_deg: 35.0", "angle_max_deg: 28.0"))
    assert written(path, result(), Given())[0].helm.rudder_at_full_pwm_deg == 35.0


def test_full_steering_as_given_is_the_scale_and_its_sign_the_servos_side(tmp_path: Path) -> None:
    vessel, _ = written(tmp_path / "boat.yaml", result(), Given(full_deg=-40.0))
    assert (vessel.helm.rudder_at_full_pwm_deg, vessel.helm.reversed) == (40.0, True)
    assert vessel.rudder.angle_max_deg == 40.0


def test_an_old_file_keeps_everything_but_the_model(tmp_path: Path) -> None:
    path = tmp_path / "lanxin.yaml"
    written(path, result())
    text = path.read_text()
    path.write_text(text.replace("name: lanxin", "name: My own").replace("angle_max_deg: 35.0", "angle_max_deg: 33.0"))
    other = result()
    vessel, _ = written(path, other._replace(found=other.found._replace(model=MODEL._replace(gain=0.9))), Given())
    assert (vessel.name, vessel.rudder.angle_max_deg, vessel.model.K_1_s) == ("My own", 33.0, 0.9)


def test_a_model_that_no_command_could_read_is_not_written(tmp_path: Path) -> None:
    path, found = tmp_path / "boat.yaml", result()
    ridge = found.found._replace(model=MODEL._replace(gain=220.0, time_constant=757_400.0))
    with pytest.raises(InputError, match=r"boat\.yaml is not written, for no command could read it"):
        written(path, found._replace(found=ridge))
    assert not path.exists()


def with_fitted_play(play_deg: float, **recorded: Any) -> Result:
    """The same result with a play to either side between recorded rudder and boat, and what was recorded otherwise."""
    found = result()
    runs = [(run._replace(**recorded), *rest) for run, *rest in found.predictions]
    train = DIRECT._replace(dead_band=math.radians(play_deg))
    return found._replace(found=found.found._replace(train=train), predictions=runs)


def test_the_play_that_was_found_goes_into_the_file_and_from_there_into_pilot_and_simulator(tmp_path: Path) -> None:
    path = tmp_path / "boat.yaml"
    vessel, remarks = written(path, with_fitted_play(1.0, rudder="ordered"))
    assert vessel.rudder.play_deg == 1.0
    assert any("rudder.play_deg" in each for each in remarks)
    assert gear_of(vessel).play == pytest.approx(math.radians(1.0))
    assert plant_of(vessel, Scenario(1, "calm")).gear.play == pytest.approx(math.radians(1.0))
    # these orders had been through the file's gear, so that what is left comes on top
    again, _ = written(path, with_fitted_play(0.5, rudder="ordered"), Given())
    assert again.rudder.play_deg == 1.5
    assert written(path, result(), Given())[0].rudder.play_deg == 1.5, "nothing found is no proof of none"


def test_a_play_between_order_and_sensor_is_measured(tmp_path: Path) -> None:
    path = tmp_path / "boat.yaml"
    shown = rudder_with_play(2.0, zero_deg=1.0)
    vessel, remarks = written(path, with_fitted_play(0.0, rudder="measured", orders=shown))
    assert vessel.rudder.play_deg == pytest.approx(2.0, abs=0.2)
    assert any("sensor shows +1" in each for each in remarks)
    none, remarks = written(
        tmp_path / "stiff.yaml", with_fitted_play(0.0, rudder="measured", orders=rudder_with_play(0.0))
    )
    assert none.rudder.play_deg == 0.0 and remarks == []


def test_a_rudder_that_jumps_has_no_rate_to_be_read(tmp_path: Path) -> None:
    jumping = {**TABLE, "rudder_rad": np.where(TABLE["rudder_rad"] > 0.0, 0.26, -0.26)}
    assert rudder_rate_of([run_of(jumping)]) is None
    rudder = written(tmp_path / "boat.yaml", result(jumping))[0].rudder
    assert rudder.rate_max_deg_s == ASSUMED_RATE_DEG_S
    assert "assumed" in rudder.source


def test_a_rudder_known_by_its_orders_has_no_rate_to_be_read() -> None:
    run = run_of(TABLE)
    assert rudder_rate_of([run]) is not None
    for origin in ("estimated", "ordered"):
        assert rudder_rate_of([run._replace(rudder=origin)]) is None


def test_a_filed_rate_that_the_rudder_denies_is_remarked(tmp_path: Path) -> None:
    lanxin = load_vessel("lanxin")  # 20 deg/s
    slow = result(zigzag(math.radians(15.0), 60.0, 0.1, rudder_rate=math.radians(2.8)))
    _, remarks = written(tmp_path / "boat.yaml", slow, Given(lanxin))
    assert len(remarks) == 1
    assert "moved at 2.8" in remarks[0] and "is 20" in remarks[0]
    assert written(tmp_path / "other.yaml", result(), Given(lanxin))[1] == []


@pytest.mark.parametrize("rate_deg_s", [2.0, 2.8, 5.0, 10.0, 15.0])
@pytest.mark.parametrize("noise_deg", [0.05, 0.1, 0.3])
def test_the_rudders_rate_is_measured_within_a_tenth_and_knows_its_error(rate_deg_s: float, noise_deg: float) -> None:
    errors, scores = [], []
    for seed in range(12):
        segment = slewing(rate_deg_s, noise_deg, seed)
        found = measured_rate([(segment.time, segment.rudder)])
        assert found is not None
        errors.append(math.degrees(found.rate) / rate_deg_s - 1.0)
        scores.append(math.radians(errors[-1] * rate_deg_s) / found.standard_error)
    assert max(np.abs(errors)) < 0.1
    assert max(np.abs(scores)) < 6.0  # corners leave a little beside the noise: 3 would be by noise alone


@pytest.mark.parametrize("is_held", [True, False])
@pytest.mark.parametrize("sensor_hz", [2.0, 5.0])
@pytest.mark.parametrize("rate_deg_s", [3.0, 5.0])
def test_a_rudder_sensor_slower_than_the_record_shows_the_rate(
    rate_deg_s: float, sensor_hz: float, is_held: bool
) -> None:
    """Neighbours in the record are then one sample, or lie on one line: they do not show the sensor's noise."""
    for seed in range(6):
        shown = slewing(rate_deg_s, 0.3, seed)
        took = shown.time[:: round(10.0 / sensor_hz)]
        angles = shown.rudder[:: round(10.0 / sensor_hz)]
        held = angles[np.searchsorted(took, shown.time, side="right") - 1]
        found = measured_rate([(shown.time, held if is_held else np.interp(shown.time, took, angles))])
        assert found is not None
        assert math.degrees(found.rate) == pytest.approx(rate_deg_s, rel=0.03)


def slewing(rate_deg_s: float, noise_deg: float, seed: int) -> Segment:
    """Return 200 s of a rudder that goes from 15 deg to one side to 15 deg to the other at its rate, at 10 Hz."""
    random = np.random.default_rng(seed)
    time = np.arange(0.0, 200.0, 0.1)
    corners, angle = [(0.0, 15.0)], 15.0
    while corners[-1][0] < time[-1]:
        rest = corners[-1][0] + random.uniform(1.0, 8.0)
        corners += [(rest, angle), (rest + 30.0 / rate_deg_s, -angle)]
        angle = -angle
    rudder = np.interp(time, *np.array(corners).T) + noise_deg * random.standard_normal(time.size)
    unknown = np.full(time.size, np.nan)
    return Segment(time, unknown, unknown, np.radians(rudder), np.ones(time.size))


def test_the_table_for_people_names_every_parameter_in_both_units() -> None:
    text = as_text(result())
    for part in ("K ", "T ", "n3", "n0", "s^2/deg^2", "trial.csv", "fit", "n3: not determined."):
        assert part in text
    assert "held" in text  # n1 has no standard error


@pytest.mark.parametrize("unknown", ["K", "T"])
def test_what_the_runs_do_not_determine_is_named_and_not_printed_or_written(tmp_path: Path, unknown: str) -> None:
    path, found = tmp_path / "boat.yaml", result(unknown=unknown)
    with pytest.raises(InputError, match=f"boat.yaml is not written, for it needs K and T: {unknown}: not determined."):
        written(path, found)
    assert not path.exists()
    row = next(line for line in as_text(found).splitlines() if line.startswith(f"{unknown} "))
    assert "not determined" in row and f"{MODEL.gain if unknown == 'K' else MODEL.time_constant:g} " not in row
    printed = json.loads(as_json(found))
    assert printed["parameters"][unknown]["value"] is None
    assert printed["unidentifiable"] == [unknown]
    assert printed["parameters"]["n3"]["value"] == MODEL.n3
