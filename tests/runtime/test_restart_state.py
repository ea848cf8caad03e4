"""A process that died leaves word of what it steered; the next goes on only where the file allows."""

from __future__ import annotations

import argparse
import json
import math
import os
import time
from dataclasses import replace
from pathlib import Path

import pytest
from lockstep import Lockstep
from manual_clock import ManualClock

from autopilot.cli.steering import restart_file
from autopilot.errors import RefusedError
from autopilot.estimation.path_delay import NOT_ECHOED
from autopilot.estimation.sensor_selection import SensorSelection
from autopilot.files.saving import save_text
from autopilot.links.base import Link, LinkError
from autopilot.runtime.app import App, Machine, Plan, path_file
from autopilot.runtime.build_links import LinkOptions, to_stderr
from autopilot.runtime.machine import BOOT_ID, PathNote, RealTime, RestartState, ServiceHooks
from autopilot.signals import HeadingSample, Order, Sample
from autopilot.vessel.file import load_vessel

VESSEL = load_vessel("lanxin")


def kept_by(path: Path, run: Lockstep, within: float = 10.0, boot: str = "boot") -> RestartState:
    return RestartState(path, within, save_text, lambda: run.now, boot)


@pytest.fixture
def held(tmp_path: Path) -> tuple[Path, Lockstep]:
    """A note that a run left which held 90 deg at 20 s, and the run."""
    run, path = Lockstep(VESSEL), tmp_path / "held.json"
    keeper = kept_by(path, run)
    run.engage(90.0)
    run.run(20.0, until=lambda tick: bool(keeper.ticked(tick)))
    assert run.engaged(run.tick)
    return path, run


def test_what_was_held_is_found_by_the_next_process(held: tuple[Path, Lockstep]) -> None:
    path, run = held
    note = kept_by(path, run).left()
    assert note is not None and note.heading == pytest.approx(math.radians(90.0))
    run.clock.time += 8.0
    assert kept_by(path, run).left() is not None


def test_it_is_forgotten_after_the_time_the_file_gives(held: tuple[Path, Lockstep]) -> None:
    path, run = held
    run.clock.time += 10.1
    assert kept_by(path, run).left() is None


def test_what_was_held_before_the_computer_slept_is_as_old_as_it_is(
    held: tuple[Path, Lockstep], monkeypatch: pytest.MonkeyPatch
) -> None:
    path, run = held
    keeper = RestartState(path, 10.0, save_text)
    keeper.ticked(run.tick)
    assert RestartState(path, 10.0, save_text).left() is not None
    # CLOCK_MONOTONIC stands still while a machine is suspended
    awake = time.clock_gettime
    monkeypatch.setattr(time, "clock_gettime", lambda clock: awake(clock) + 3600.0)
    assert RestartState(path, 10.0, save_text).left() is None


def test_another_boot_and_a_clock_from_before_know_nothing_of_it(held: tuple[Path, Lockstep]) -> None:
    path, run = held
    assert kept_by(path, run, boot="another").left() is None
    run.clock.time = 1.0
    assert kept_by(path, run).left() is None


def test_the_present_heading_is_noted_as_the_one_that_was_taken(tmp_path: Path) -> None:
    run, path = Lockstep(VESSEL), tmp_path / "held.json"
    keeper = kept_by(path, run)
    run.order = Order(run.order.kind.HEADING, math.nan, serial=1)
    run.run(10.0, until=lambda tick: bool(keeper.ticked(tick)))
    left = kept_by(path, run).left()
    assert left is not None and left.heading == pytest.approx(run.tick.reference.heading, abs=0.01)


def test_standing_by_takes_it_back_at_once(held: tuple[Path, Lockstep]) -> None:
    path, run = held
    keeper = kept_by(path, run)
    keeper.ticked(run.tick)
    run.order = Order(serial=run.order.serial + 1)
    assert run.run(1.0, until=lambda tick: bool(keeper.ticked(tick)) or tick.mode.name == "STANDBY") is True
    keeper.ticked(run.tick)
    assert kept_by(path, run).left() is None


@pytest.mark.parametrize(
    ("error", "resumes"),
    [(None, False), (LinkError, False), (RefusedError, False), (ValueError, True), (MemoryError, True)],
)
def test_only_a_fault_of_ours_is_resumed_from(
    held: tuple[Path, Lockstep], error: type[Exception] | None, resumes: bool, capsys: pytest.CaptureFixture[str]
) -> None:
    path, run = held

    def sail() -> None:
        with ServiceHooks(RealTime(), kept_by(path, run), to_stderr) as hooks:
            hooks.ticked(run.tick)
            if error is not None:
                raise error("it happened")

    if error is None:
        sail()
    else:
        with pytest.raises(error):
            sail()
    assert (kept_by(path, run).left() is not None) is resumes
    assert ("the program failed; the rudder was given back" in capsys.readouterr().err) is resumes


@pytest.mark.parametrize(
    "text", ["", "{", "[]", "null", '{"heading": "x"}', '{"heading": NaN, "since": 1, "boot": "boot"}']
)
def test_a_note_that_is_none_is_no_note(tmp_path: Path, text: str) -> None:
    path = tmp_path / "held.json"
    path.write_text(text)
    assert RestartState(path, 10.0, save_text, lambda: 2.0, "boot").left() is None


def test_the_vessel_file_decides_and_the_service_gives_the_place(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    arguments = argparse.Namespace(state=None)
    allowed = replace(VESSEL, failsafe=replace(VESSEL.failsafe, reengage_after_restart_s=600.0))
    monkeypatch.delenv("RUNTIME_DIRECTORY", raising=False)
    assert restart_file(arguments) is None
    monkeypatch.setenv("RUNTIME_DIRECTORY", f"{tmp_path}:/other")
    place = restart_file(arguments)
    assert place == tmp_path / "held-heading.json"
    held = {"heading": 1.0, "since": time.monotonic(), "boot": BOOT_ID.read_text().strip()}
    place.write_text(json.dumps(held))
    for vessel, machine, resumed in (
        (VESSEL, Machine(restart_file=place), []),
        (allowed, Machine(), []),
        (allowed, Machine(restart_file=place), [1.0]),
    ):
        headings: list[float] = []
        plan = Plan(vessel, lambda now, tick: Order(), machine=machine, resume=headings.append)
        app = App(plan, ManualClock())
        assert headings == resumed and len(app.notices) == len(resumed)
        app.session.close()


@pytest.mark.parametrize(("steers", "resumed"), [("HCHDM", True), ("HEHDT", False)])
def test_a_number_held_by_one_compass_is_not_steered_by_another(tmp_path: Path, steers: str, resumed: bool) -> None:
    place, link = tmp_path / "held-heading.json", "HCHDM@nmea:a"
    vessel = replace(VESSEL, failsafe=replace(VESSEL.failsafe, reengage_after_restart_s=5.0))
    keeper = RestartState(place, 5.0, save_text, compass=lambda: link)
    run, said, headings = Lockstep(VESSEL), list[str](), list[float]()
    run.engage(90.0)
    run.run(20.0, until=lambda tick: bool(keeper.ticked(tick)))
    selection = SensorSelection()

    class Compass(Link):
        name = "nmea:a"

        def receive(self, now: float) -> list[Sample]:
            return selection.admit(now, [HeadingSample(now, 1.4, None, steers)], self.name)

    options, machine = LinkOptions(selection=selection, warn=said.append), Machine(restart_file=place)
    plan = Plan(vessel, lambda now, tick: Order(), links=(Compass(),), options=options, machine=machine)
    app = App(plan._replace(resume=headings.append), ManualClock())
    assert app.notices[-1].endswith("held 090 deg: engaging on it again when HCHDM steers") and not headings
    app.run(6.0, lambda tick: False)
    app.session.close()
    assert headings == ([pytest.approx(math.radians(90.0))] if resumed else [])
    not_again = "not engaged again on 090 deg, which was held by HCHDM: HEHDT steers; give a heading"
    assert said == ([] if resumed else [not_again])


@pytest.mark.parametrize(
    "content",
    [
        "[" * 4000,
        '{"heading": ' + "9" * 400 + ', "since": 0.0, "boot": "boot"}',
        None,
    ],
    ids=["deep", "digits", "pipe"],
)
def test_a_note_that_is_none_is_none_and_holds_nothing_up(tmp_path: Path, content: str | None) -> None:
    path = tmp_path / "held.json"
    if content is None:
        os.mkfifo(path)
    else:
        path.write_text(content)
    assert kept_by(path, Lockstep(VESSEL)).left() is None


def test_a_path_that_was_measured_is_known_to_the_next_run_over_the_same_links(tmp_path: Path) -> None:
    path = tmp_path / "boat.path.json"
    links = ["udpin:127.0.0.1:14550"]
    note = PathNote(path, links, None, save_text)
    assert note.left() is None
    note.kept = 0.05
    for delay, late in ((math.nan, 0.3), (0.08, 0.0), (0.14, 0.0)):
        note.steered_by(NOT_ECHOED._replace(delay=delay, late=late), 0.05)
    assert not path.exists(), "what is not steered by is not noted"
    note.steered_by(NOT_ECHOED._replace(delay=0.63, late=0.57), 0.05)
    assert PathNote(path, links, None, save_text).left() == 0.62
    assert PathNote(path, links, 0.3, save_text).left() is None, "the skipper has written another since"
    assert PathNote(path, ["serial:/dev/ttyUSB0:57600"], None, save_text).left() is None
    note.steered_by(NOT_ECHOED._replace(delay=1.18, late=1.13), 0.05)
    assert note.left() == pytest.approx(1.1)


@pytest.mark.parametrize("text", ["", "[1]", "NaN", "3"])
def test_a_path_that_can_be_none_is_not_believed(tmp_path: Path, text: str) -> None:
    text = f'{{"links": [], "filed_s": null, "path_delay_s": {text}}}' if text.isalnum() else text
    (tmp_path / "x.json").write_text(text)
    assert PathNote(tmp_path / "x.json", [], None, save_text).left() is None


def test_a_run_begins_with_what_was_noted_and_its_log_says_so(tmp_path: Path) -> None:
    place = str(tmp_path / "boat.yaml")
    path_file(place).write_text('{"links": [], "filed_s": null, "path_delay_s": 0.85}')
    app = App(Plan(VESSEL, lambda now, tick: Order(), place, machine=Machine()), ManualClock())
    assert app.pilot.state.estimate.path.late == pytest.approx(0.8)
    assert app.notices == ["an earlier run measured a path delay of 0.85 s over these links: it counts"]
    app.session.close()
    written = replace(VESSEL, control=replace(VESSEL.control, path_delay_s=0.3))
    app = App(Plan(written, lambda now, tick: Order(), place, machine=Machine()), ManualClock())
    assert app.pilot.state.estimate.path.late == pytest.approx(0.25), "what the skipper has written since wins"
    app.session.close()
