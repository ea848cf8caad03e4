"""The list from an empty folder to the first hold: kept, taken up again, and refused where it is not ours."""

from __future__ import annotations

import json
import math
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Sequence
from datetime import datetime
from pathlib import Path

import pytest

from autopilot.cli import new_boat
from autopilot.cli.main import build_parser, main
from autopilot.cli.new_boat import STEPS, Boat, Checklist
from autopilot.cli.web import PageOfSteps
from autopilot.errors import InputError, RefusedError
from autopilot.runtime.record import Recorder
from autopilot.signals import CourseSample, Mode, NavState, Order, OrderKind, Reference, RudderCommand, Tick
from autopilot.vessel.file import dump_vessel, first_model, load_vessel

WHEN = datetime(2026, 11, 24, 12, 0)
NUMBERS = ("--length-m", "7", "--speed-kn", "9", "--rudder-max-deg", "30", "--side-to-side-s", "3")


def test_the_first_model_goes_with_length_and_speed() -> None:
    slow, quick, ship = first_model(7.0, 2.0), first_model(7.0, 4.0), first_model(70.0, 4.0)
    assert quick.K_1_s == pytest.approx(2.0 * slow.K_1_s, rel=1e-3)
    assert quick.T_s == pytest.approx(0.5 * slow.T_s, rel=1e-3)
    assert quick.n3_s2_rad2 == pytest.approx(0.25 * slow.n3_s2_rad2, rel=1e-3)
    assert ship.T_s > 3.0 * quick.T_s and ship.K_1_s < quick.K_1_s / 3.0


def test_the_file_that_is_written_holds_what_was_asked_and_no_gains(tmp_path: Path, commands: list[list[str]]) -> None:
    file = tmp_path / "mine.yaml"
    assert main(["new-boat", str(file), "--link", "udpin:127.0.0.1:1", "--yes", *NUMBERS]) == 4
    boat = load_vessel(file)
    assert boat.length_m == 7.0 and boat.model.reference_speed_m_s == pytest.approx(4.63, abs=0.01)
    assert boat.rudder.angle_max_deg == 30.0 and boat.rudder.rate_max_deg_s == pytest.approx(20.0)
    assert boat.control.backstepping is None and "a guess" in boat.model.source


def test_the_list_is_kept_and_what_rests_on_a_step_is_done_again(tmp_path: Path) -> None:
    file = tmp_path / "mine.yaml"
    checklist = Checklist(file)
    checklist.links = ("--link", "udpin:127.0.0.1:14550")
    for step in STEPS:
        assert checklist.next is step
        checklist.tick_off(step, WHEN)
    checklist.save()
    again = Checklist(file)
    assert again.next is None and again.links == checklist.links
    assert all("done" in line for line in again.lines())
    again.mark("zigzag", is_done=False)
    assert again.next is not None and again.next.name == "zigzag" and set(again.done) == {"doctor", "rudder"}
    checklist.tick_off(STEPS[0], WHEN)
    assert set(checklist.done) == {"doctor"}


@pytest.mark.parametrize(
    "text",
    [
        "",
        "[]",
        "{}",
        '{"links": 3, "done": {}}',
        '{"links": [], "done": {"fly": "x"}}',
        '{"links": [1], "done": {}}',
        '{"links": [], "done": []}',
        "\x00",
    ],
)
def test_a_list_that_is_not_ours_is_refused_by_name(text: str, tmp_path: Path) -> None:
    (tmp_path / "mine.commissioning.json").write_text(text)
    with pytest.raises(InputError, match=r"mine\.commissioning\.json"):
        Checklist(tmp_path / "mine.yaml")


def test_a_step_that_does_not_exist_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="fly: no step; there are doctor, rudder"):
        Checklist(tmp_path / "mine.yaml").mark("fly", is_done=False)


def test_the_zigzag_lasts_for_the_boat(tmp_path: Path) -> None:
    zigzag = next(step for step in STEPS if step.name == "zigzag")

    def seconds(name: str) -> float:
        command = zigzag.command(Boat(tmp_path / "mine.yaml", (), load_vessel(name)))
        return float(command[command.index("--duration") + 1])

    assert seconds("lanxin") == 40.0 < seconds("mariner") <= 1800.0


def test_at_the_dock_the_stops_that_were_typed_are_come_to_in_steps(tmp_path: Path) -> None:
    rudder = next(step for step in STEPS if step.name == "rudder")

    def angles(name: str) -> list[float]:
        command = rudder.command(Boat(tmp_path / "mine.yaml", (), load_vessel(name)))
        return [float(angle) for angle in command[command.index("--rudder-deg") + 1].split(",")]

    lanxin = angles("lanxin")
    assert lanxin == [10.0, -10.0, 0.0, 20.0, 25.0, 30.0, 0.0, -20.0, -25.0, -30.0, 0.0]
    assert angles("twin_thruster") == [10.0, -10.0, 0.0], "two thrusters have no stop, and tear at their lines"


def test_a_boat_of_two_thrusters_is_asked_for_no_rudder(tmp_path: Path, commands: list[list[str]]) -> None:
    file = tmp_path / "mine.yaml"
    given = ["--drive", "two_thrusters", "--link", "udpin:127.0.0.1:1", "--yes", *NUMBERS[:4]]
    assert main(["new-boat", str(file), *given]) == 4
    boat = load_vessel(file)
    assert boat.drive.kind == "two_thrusters" and boat.rudder.angle_max_deg == 30.0
    assert boat.guidance.rudder_share == 1.0
    assert boat.helm.rudder_at_full_pwm_deg == 30.0 and "by definition" in boat.helm.source
    assert [command[0] for command in commands] == ["doctor", "trial", "trial", "identify", "gains"]


def test_a_log_never_takes_a_name_that_is_there(tmp_path: Path) -> None:
    boat = Boat(tmp_path / "mine.yaml", (), load_vessel("lanxin"))
    (tmp_path / "mine-hold.tlog").write_text("")
    assert boat.log("hold") == str(tmp_path / "mine-hold-2.tlog")
    for name in ("mine-hold-3.tlog", "mine-hold-10.tlog", "mine-hold-3-larger.tlog", "mine-holding.tlog"):
        (tmp_path / name).write_text("")
    (tmp_path / "mine-hold.tlog").unlink()
    assert [*boat.logs("hold")] == [3, 10]
    assert boat.log("hold") == str(tmp_path / "mine-hold-11.tlog"), "a freed name would be older than those after it"


@pytest.fixture
def commands(monkeypatch: pytest.MonkeyPatch) -> list[list[str]]:
    """Commands that are not run but noted; a zigzag leaves its log."""
    noted: list[list[str]] = []

    def noting(command: Sequence[str]) -> int:
        noted.append(list(command[3:]))
        if "zigzag" in command:
            Path(command[command.index("--log") + 1]).write_text("")
        return int(command[3] == "gains")

    monkeypatch.setattr(new_boat, "run_child", noting)
    return noted


def test_it_goes_on_where_it_was_left(
    commands: list[list[str]], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "mine.yaml"
    file.write_text(dump_vessel(load_vessel("lanxin")))
    given = ["new-boat", str(file), "--link", "udpin:127.0.0.1:1", "--as-gcs", "--yes"]
    assert main(given) == 4
    said, error = capsys.readouterr()
    assert "step 5 (the gains) is not done" in error and "Good enough is: the margins are kept" in said
    assert "If not:\n  - the sentence says which margin is missing" in said
    assert [command[0] for command in commands] == ["doctor", "trial", "trial", "identify", "gains"]
    assert all(command[2:5] == ["--link", "udpin:127.0.0.1:1", "--as-gcs"] for command in commands[:1])
    kept = json.loads((tmp_path / "mine.commissioning.json").read_text())
    assert list(kept["done"]) == ["doctor", "rudder", "zigzag", "identify"]
    commands.clear()
    assert main(["new-boat", str(file), "--yes"]) == 4
    assert [command[0] for command in commands] == ["gains"]
    assert main(["new-boat", str(file), "--list"]) == 0
    assert "5. next  the gains" in capsys.readouterr().out


def test_a_file_that_was_removed_is_begun_from_the_first_step(commands: list[list[str]], tmp_path: Path) -> None:
    file = tmp_path / "mine.yaml"
    checklist = Checklist(file)
    for step in STEPS:
        checklist.tick_off(step, WHEN)
    checklist.links = ("--link", "udpin:127.0.0.1:1")
    checklist.save()
    assert main(["new-boat", str(file), "--yes", *NUMBERS]) == 4
    assert commands[0][0] == "doctor" and load_vessel(file).control.backstepping is None


def test_numbers_of_no_boat_leave_no_file_behind(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    given = ["new-boat", str(tmp_path / "mine.yaml"), "--link", "udpin:127.0.0.1:1", "--yes", "--length-m", "0.2"]
    assert main([*given, "--speed-kn", "60", *NUMBERS[4:]]) == 2
    assert "nothing was written: no boat is 0.2 m long and sails 60 kn" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_unusual_numbers_are_said_before_the_first_step(
    commands: list[list[str]], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "mine.yaml"
    given = ["new-boat", str(file), "--link", "udpin:127.0.0.1:1", "--yes", "--length-m", "1.2", "--speed-kn", "27"]
    assert main([*given, *NUMBERS[4:]]) == 4
    assert f"typed wrong: press Ctrl-C, remove {file}, and begin again" in capsys.readouterr().out


def test_a_larger_zigzag_that_ended_early_is_sailed_again(
    commands: list[list[str]], monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def ending_early(command: Sequence[str]) -> int:
        commands.append(list(command[3:]))
        if "--log" in command:
            Path(command[command.index("--log") + 1]).write_text("")
        return 4 if command[3] == "identify" or "larger" in Path(command[-1]).name else 0

    monkeypatch.setattr(new_boat, "run_child", ending_early)
    file = tmp_path / "mine.yaml"
    for more in (NUMBERS, ()):
        assert main(["new-boat", str(file), "--link", "udpin:127.0.0.1:1", "--yes", *more]) == 4
        said = capsys.readouterr().out
        assert "The larger zigzag is not done; it is asked for again.\nIf not:\n  - it ended early" in said
    assert [command[-1] for command in commands if "larger" in Path(command[-1]).name] == [
        str(tmp_path / "mine-zigzag-larger.tlog"),
        str(tmp_path / "mine-zigzag-larger-2.tlog"),
    ]


def test_a_simulator_that_runs_faster_is_met_at_its_pace(commands: list[list[str]], tmp_path: Path) -> None:
    given = ["new-boat", str(tmp_path / "mine.yaml"), "--link", "udpin:127.0.0.1:1", "--yes", "--speedup", "10"]
    assert main([*given, *NUMBERS]) == 4
    on_links = [command for command in commands if "--link" in command]
    assert [command[0] for command in on_links] == ["doctor", "trial", "trial"]
    assert all(command[command.index("--speedup") + 1] == "10" for command in on_links), "overrides lapse by its clock"


def test_a_step_that_was_done_by_hand_is_gone_past(
    commands: list[list[str]], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "mine.yaml"
    file.write_text(dump_vessel(load_vessel("lanxin")))
    checklist = Checklist(file)
    for step in STEPS[:3]:
        checklist.tick_off(step, WHEN)
    checklist.save()
    assert main(["new-boat", str(file), "--list", "--done", "gains"]) == 2
    assert "gains: not the next step" in capsys.readouterr().err
    assert main(["new-boat", str(file), "--link", "udpin:127.0.0.1:1", "--yes", "--done", "identify"]) == 4
    assert [command[0] for command in commands] == ["gains"]


@pytest.mark.parametrize("refusals", [1, 2, 3, 4])
def test_what_one_zigzag_does_not_tell_larger_ones_or_the_hold_do(
    refusals: int, commands: list[list[str]], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def refusing(command: Sequence[str]) -> int:
        commands.append(list(command[3:]))
        if "--log" in command:
            Path(command[command.index("--log") + 1]).write_text("")
        is_refused = command[3] == "identify" and sum(each[0] == "identify" for each in commands) <= refusals
        return 4 if is_refused else int(command[3] == "gains")

    monkeypatch.setattr(new_boat, "run_child", refusing)
    file = tmp_path / "mine.yaml"
    assert main(["new-boat", str(file), "--link", "udpin:127.0.0.1:1", "--yes", *NUMBERS]) == 4
    said = [command[:2] if command[0] == "trial" else command[:1] for command in commands[2:]]
    assert said[:4] == [["trial", "zigzag"], ["identify"], ["trial", "zigzag"], ["identify"]]
    larger = [["trial", "zigzag"], ["identify"]]
    assert (
        said[4:]
        == [[["gains"]], [*larger, ["gains"]], [*larger, ["identify"], ["gains"]], [*larger, ["identify"]]][
            refusals - 1
        ]
    )
    sets = [command[1 : command.index("--vessel")] for command in commands if command[0] == "identify"]
    logs = [str(tmp_path / f"mine-zigzag{name}.tlog") for name in ("", "-larger", "-larger-2")]
    assert sets == [logs[:1], logs[:2], logs, logs][: len(sets)]
    asked = ["--at-least" in command for command in commands if command[0] == "identify"]
    assert asked == [True, True, True, False][: len(sets)]
    assert main(["new-boat", str(file), "--yes", "--redo", "zigzag"]) == 4
    assert next(each for each in reversed(commands) if each[0] == "identify")[1:3] == [
        str(tmp_path / "mine-zigzag-2.tlog"),
        "--vessel",
    ], "what was sailed beside another zigzag may be of another rudder"


def test_nothing_moves_where_nobody_is_there_to_watch(
    commands: list[list[str]], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    given = ["new-boat", str(tmp_path / "mine.yaml"), "--link", "udpin:127.0.0.1:1", *NUMBERS]
    assert main(given) == 2 and not commands
    assert "with --yes" in capsys.readouterr().err
    given[3] = "udpinn:127.0.0.1:1"
    assert main([*given, "--yes"]) == 2 and not commands
    assert Checklist(tmp_path / "mine.yaml").links[1] == "udpin:127.0.0.1:1", "a link that is none is not kept"


def test_a_second_one_at_once_is_refused_and_may_look(
    commands: list[list[str]], monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "mine.yaml"
    file.write_text(dump_vessel(load_vessel("lanxin")))
    codes: list[int] = []

    def second(command: Sequence[str]) -> int:
        codes.extend(main(["new-boat", str(file), *more]) for more in (("--yes",), ("--redo", "doctor"), ("--list",)))
        with pytest.raises(RefusedError):
            PageOfSteps(file).mark("doctor", is_done=True)
        return 4

    monkeypatch.setattr(new_boat, "run_child", second)
    assert main(["new-boat", str(file), "--link", "udpin:127.0.0.1:1", "--yes"]) == 4
    assert codes == [4, 4, 0]
    assert f"another autopilot new-boat goes through its steps in the folder of {file}" in capsys.readouterr().err


def test_who_leaves_is_shown_where_it_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def left(command: Sequence[str]) -> int:
        raise KeyboardInterrupt

    file = tmp_path / "mine.yaml"
    file.write_text(dump_vessel(load_vessel("lanxin")))
    monkeypatch.setattr(new_boat, "run_child", left)
    with pytest.raises(KeyboardInterrupt):
        main(["new-boat", str(file), "--link", "udpin:127.0.0.1:1", "--yes"])
    said = capsys.readouterr().out
    assert "Left before step 1 was done: this computer and the links." in said
    assert "If something was wrong:\n  - do what stands behind each arrow" in said
    assert f"To carry on here: autopilot new-boat {file}" in said


@pytest.mark.parametrize("given", [(), ("--drive", "rudder", "--length-m", "7"), ("--drive", "rudder", *NUMBERS)])
def test_a_terminal_that_closes_at_a_question_leaves_without_a_trace(given: Sequence[str], tmp_path: Path) -> None:
    file, (ours, its) = tmp_path / "mine.yaml", os.openpty()
    command = [sys.executable, "-m", "autopilot", "new-boat", str(file), "--link", "udpin:127.0.0.1:1", *given]
    os.write(ours, b"\x04")
    ended = subprocess.run(command, stdin=its, capture_output=True, text=True, check=False, timeout=60)
    assert ended.stderr == "autopilot: ended by the terminal's end\n" and ended.returncode == 128 + signal.SIGHUP
    assert file.exists() == ("To carry on here: autopilot new-boat" in ended.stdout) == (NUMBERS[-1] in given)
    os.close(ours)
    os.close(its)


def test_a_step_whose_link_fell_silent_asks_for_the_link_not_for_the_rudder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(new_boat, "run_child", lambda command: 3 if "trial" in command else 0)
    file = tmp_path / "mine.yaml"
    assert main(["new-boat", str(file), "--link", "udpin:127.0.0.1:1", "--yes", *NUMBERS]) == 3
    said = capsys.readouterr().err
    assert "step 2 (proof of control, sign and end stops) is not done: the links did not bring" in said
    assert f"then: autopilot new-boat {file}" in said and "reverse it" not in said


def hold(path: Path, off_deg: float, mode: Mode, beside_deg: float) -> None:
    """Write the log of a minute on a course, swinging about it once in 8 s, and over the ground so far beside it."""
    order, recorder = Order(OrderKind.HEADING, 1.0), Recorder(path, {}, 0.0)
    for number in range(600):
        now = 0.1 * number
        heading = 1.0 + math.radians(off_deg) * math.sin(math.tau * now / 8.0)
        state = NavState(now, heading, 0.0, 3.0, 0.0, 0.0, 0.0, True)
        command = RudderCommand(now, 0.0, True)
        ground = (CourseSample(now, heading + math.radians(beside_deg), "gps"),)
        recorder.record(Tick(number, now, ground, order, state, Reference(1.0), 0.0, command, mode, ()), [])
    recorder.close()


def holding(off_deg: float, mode: Mode = Mode.ENGAGED, beside_deg: float = 30.0) -> Callable[[Sequence[str]], int]:
    """Return a child that does every step, and whose hold is such a one."""

    def child(command: Sequence[str]) -> int:
        if "run" in command:
            hold(Path(command[command.index("--log") + 1]), off_deg, mode, beside_deg)
        elif "--log" in command:
            Path(command[command.index("--log") + 1]).write_text("")
        return 0

    return child


@pytest.mark.parametrize(
    ("off_deg", "mode", "beside_deg", "said"),
    [
        (20.0, Mode.ENGAGED, 0.0, "is not done: poor: held it within 20"),
        (0.0, Mode.STANDBY, 180.0, "is not done: no course was held"),
        (0.0, Mode.ENGAGED, 180.0, "is not done: over the ground the boat went 180 deg to"),
    ],
)
def test_a_hold_that_swings_is_not_ticked_off(
    off_deg: float,
    mode: Mode,
    beside_deg: float,
    said: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    file = tmp_path / "mine.yaml"
    file.write_text(dump_vessel(load_vessel("lanxin")))
    monkeypatch.setattr(new_boat, "run_child", holding(off_deg, mode, beside_deg))
    assert main(["new-boat", str(file), "--link", "udpin:127.0.0.1:1", "--yes"]) == 4
    out, error = capsys.readouterr()
    assert said in error and "Good enough is: its last lines say good or fair" in out
    assert "  - its model is good, and it swings" in out
    assert "hold" not in Checklist(file).done


def test_a_hold_that_left_no_log_is_not_judged_by_an_older_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "mine.yaml"
    file.write_text(dump_vessel(load_vessel("lanxin")))
    hold(tmp_path / "mine-hold.tlog", 1.0, Mode.ENGAGED, 0.0)
    monkeypatch.setattr(new_boat, "run_child", lambda command: 0)
    boat = Checklist(file)
    for step in STEPS[:-1]:
        boat.tick_off(step, WHEN)
    boat.save()
    assert main(["new-boat", str(file), "--link", "udpin:127.0.0.1:1", "--yes"]) == 4
    assert "mine-hold-2.tlog is not there" in capsys.readouterr().err
    assert "hold" not in Checklist(file).done


def test_at_its_end_stand_the_commands_of_every_day(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "mine.yaml"
    file.write_text(dump_vessel(load_vessel("lanxin")))
    monkeypatch.setattr(new_boat, "run_child", holding(1.0))
    assert main(["new-boat", str(file), "--link", "serial:/dev/pixhawk:115200", "--as-gcs", "--yes"]) == 0
    said = capsys.readouterr().out
    assert f"autopilot replay {tmp_path / 'mine-hold.tlog'}" in said
    service = said.partition("From power-on: autopilot ")[2].partition("\n")[0].split()
    assert build_parser().parse_args(service).link == ["serial:/dev/pixhawk:115200"]


def test_where_nobody_answers_the_option_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["new-boat", str(tmp_path / "mine.yaml"), "--yes", *NUMBERS[2:]]) == 2
    assert "--length-m is needed where nobody answers" in capsys.readouterr().err
    assert main(["new-boat", str(tmp_path / "mine.yaml"), "--list"]) == 2
    assert "not there yet" in capsys.readouterr().err
    assert main(["new-boat", "lanxin", "--yes"]) == 2
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("typed", ["", "long", "7,5", "7.5 m", "0", "1e9"])
def test_what_is_no_length_is_answered_with_what_one_is(
    typed: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    asked: list[str] = []
    answers = iter([typed, "7.5"])

    def answer(words: str) -> str:
        asked.append(words)
        return next(answers)

    monkeypatch.setattr("builtins.input", answer)
    monkeypatch.setattr("sys.stdin.isatty", lambda: True)
    arguments = build_parser().parse_args(["new-boat", str(tmp_path / "mine.yaml"), "--drive", "rudder", *NUMBERS[2:]])
    new_boat.write_boat(arguments, new_boat.Talk(silent=False))
    assert asked == ["Length of the waterline in metres (0.2 to 500): "] * 2
    said = capsys.readouterr().out
    assert "write a number from 0.2 to 500, such as 7.5" in said and "''" not in said
    assert load_vessel(tmp_path / "mine.yaml").length_m == 7.5


def test_what_to_prepare_is_not_cut_within_a_word(
    tmp_path: Path, commands: list[list[str]], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("COLUMNS", "60")
    assert main(["new-boat", str(tmp_path / "mine.yaml"), "--link", "udpin:127.0.0.1:1", "--yes", *NUMBERS]) == 4
    said = capsys.readouterr().out
    before = said[said.index("At the dock") : said.index("autopilot trial turning")].splitlines()
    assert len(before) > 3 and max(map(len, before)) <= 60 and " ".join(before) == STEPS[1].before
    assert any(len(line) > 60 for line in said.splitlines() if line.startswith("autopilot ")), "commands stay whole"
