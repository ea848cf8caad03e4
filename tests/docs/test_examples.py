"""The example scripts run as they are printed, and hold what the page says of them."""

from __future__ import annotations

import json
import math
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from boat_recordings import dataflash, zigzag_boat
from two_processes import free_port, simulator

import autopilot
import autopilot.api
import sitl
from autopilot.cli.main import main
from autopilot.identification.residuals import Noise
from autopilot.models.norrbin import Norrbin
from autopilot.signals import Mode

EXAMPLES = Path(__file__).parents[2] / "docs" / "examples"
LINES_MOST = 40


def said(name: str, *arguments: str, folder: Path) -> str:
    done = subprocess.run(
        [sys.executable, "-W", "error", str(EXAMPLES / name), *arguments],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_every_example_is_short() -> None:
    scripts = sorted(EXAMPLES.glob("*.py"))
    assert len(scripts) == 5
    assert all(len(script.read_text(encoding="utf-8").splitlines()) <= LINES_MOST for script in scripts)


def test_a_run_in_lockstep_is_logged_and_replays(tmp_path: Path) -> None:
    assert "deg rms" in said("sail_in_lockstep.py", "run.tlog", folder=tmp_path)
    replayed = subprocess.run([sys.executable, "-m", "autopilot", "replay", "run.tlog"], cwd=tmp_path, check=False)
    assert replayed.returncode == 0


@pytest.fixture(scope="module")
def zigzag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    log = tmp_path_factory.mktemp("zigzag") / "zigzag.tlog"
    order = autopilot.Order(autopilot.OrderKind.ZIGZAG, rudder=0.26, heading_change=0.26, serial=1)
    sitl.simulate(autopilot.load_vessel("lanxin"), lambda now, tick: order, 45.0, log=log)
    return log


def test_a_log_is_identified_and_its_file_written(zigzag: Path, tmp_path: Path) -> None:
    text = said("identify_a_log.py", str(zigzag), "boat.yaml", folder=tmp_path)
    assert text.splitlines()[0] and "wrote boat.yaml" in text
    found, truth = autopilot.load_vessel(tmp_path / "boat.yaml"), autopilot.load_vessel("lanxin")
    assert found.model.K_1_s == pytest.approx(truth.model.K_1_s, rel=0.1)
    assert found.control.backstepping is not None


def test_no_model_is_judged_without_its_logs() -> None:
    model = Norrbin(1.0, 1.0)
    with pytest.raises(autopilot.InputError, match="verdict needs the logs"):
        autopilot.verdict(autopilot.Identified(model, {}, {}, (Noise(0.0, 1), Noise(0.0, 1))))


def test_a_verdict_is_that_of_the_command(zigzag: Path, capsys: pytest.CaptureFixture[str]) -> None:
    found = autopilot.identify(zigzag)
    assert main(["identify", str(zigzag), "--json"]) == 0
    command = json.loads(capsys.readouterr().out)
    assert autopilot.verdict(found, zigzag)._asdict() == command["verdict"]
    assert found.model.gain == command["parameters"]["K"]["value"]


def test_a_pilot_steps_around_a_boat_of_your_own(tmp_path: Path) -> None:
    text = said("your_own_plant.py", folder=tmp_path)
    heading = float(text.partition("heading ")[2].partition(" ")[0])
    assert heading == pytest.approx(60.0, abs=2.0) and "ENGAGED" in text


def test_quicker_levels_hold_better_and_work_more(tmp_path: Path) -> None:
    rows = [line.split() for line in said("compare_levels.py", folder=tmp_path).splitlines()[1:]]
    assert [row[0] for row in rows] == ["2", "5", "8"]
    assert float(rows[0][3]) < float(rows[2][3])


@pytest.mark.real_time
def test_a_link_is_steered_and_logged(tmp_path: Path) -> None:
    port = free_port()
    with simulator(1.0, "--mavlink", f"udpout:127.0.0.1:{port}"):
        text = said("run_a_link.py", f"udpin:127.0.0.1:{port}", "12", "run.tlog", folder=tmp_path)
    assert text.startswith(Mode.ENGAGED.name) and "ticks in run.tlog" in text


def test_the_names_of_the_interface_are_there_and_no_others() -> None:
    for name in autopilot.api.__all__:
        assert getattr(autopilot, name) is getattr(autopilot.api, name)
    with pytest.raises(AttributeError, match="its public names"):
        autopilot.fly  # noqa: B018


def test_the_same_scenario_sails_the_same() -> None:
    vessel = autopilot.load_vessel("lanxin")

    def turn(now: float, tick: object) -> autopilot.Order:
        return autopilot.heading_order(30.0)

    first, again = (sitl.simulate(vessel, turn, 6.0, scenario="sea-state-5") for _ in range(2))
    assert [tick.command for tick in first] == [tick.command for tick in again]


@pytest.mark.parametrize("level", [0, 10])
def test_a_level_that_is_none_is_refused(level: int) -> None:
    with pytest.raises(autopilot.InputError, match="allowed is 1 to 9"):
        autopilot.design(autopilot.load_vessel("lanxin"), level)


def test_a_log_without_rudder_angles_is_read_by_the_vessel_s_servo(tmp_path: Path) -> None:
    log = tmp_path / "trial.BIN"
    log.write_bytes(dataflash(zigzag_boat(seconds=40.0)))
    boat = autopilot.load_vessel("lanxin")
    with pytest.raises(autopilot.InputError, match="give --vessel"):
        autopilot.read_log(log)
    (segment,) = autopilot.read_log(log, vessel=boat).segments
    # recorded are 1300 to 1700 us, of the file's 1000 to 2000 for 30 degrees to either side
    assert max(segment.rudder) == pytest.approx(math.radians(12.0), rel=0.05)
    assert autopilot.identify(log, vessel=boat).model.gain > 0.0


def test_a_table_is_read_by_names_of_its_own(tmp_path: Path) -> None:
    log = tmp_path / "log.csv"
    rows = "".join(f"{step * 0.1:.1f},{step % 20},{step},4\n" for step in range(100))
    log.write_text("t,helm,course,log\n" + rows)
    columns = {"time_s": "t", "rudder_deg": "helm", "heading_deg": "course", "speed_kn": "log"}
    assert autopilot.read_log(log, columns=columns).segments[0].speed[0] == pytest.approx(4.0 * 1852.0 / 3600.0)
    with pytest.raises(autopilot.InputError, match="rudder is not a quantity with its unit"):
        autopilot.read_log(log, columns={"rudder": "helm"})


def nothing(now: float, tick: object) -> autopilot.Order:
    return autopilot.Order()


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda boat: autopilot.heading_order(math.nan), "a number of degrees"),
        (lambda boat: autopilot.pilot_for(boat, "magic"), "there are backstepping"),
        (lambda boat: autopilot.run(boat, "udpin:127.0.0.1:0", nothing, 1.0), "write a list"),
        (lambda boat: autopilot.run(boat, ["udpin:127.0.0.1:0"], nothing, -1.0), "above 0"),
        (lambda boat: sitl.simulate(boat, nothing, math.nan), "above 0"),
        (lambda boat: autopilot.design(boat, "5"), "level '5'"),
    ],
    ids=["heading", "law", "links", "duration", "seconds", "level"],
)
def test_a_value_that_cannot_be_used_is_refused(call: Callable[[autopilot.Vessel], object], said: str) -> None:
    with pytest.raises(autopilot.InputError, match=said):
        call(autopilot.load_vessel("lanxin"))
