"""What `run --serve` keeps of a route over a restart, and the parameters a route is followed with."""

from __future__ import annotations

import dataclasses
import errno
import os
from pathlib import Path
from typing import Any

import pytest
from boat_at_sea import item, place
from manual_clock import ManualClock
from two_processes import free_port

from autopilot.cli.run import load_mission
from autopilot.errors import InputError
from autopilot.files import saving
from autopilot.guidance.plotter import PlotterGuide
from autopilot.links.ground_station.mission import dump_items, from_message
from autopilot.operators.skipper import Skipper
from autopilot.runtime.app import App, Plan, mission_file
from autopilot.runtime.build import limits_of
from autopilot.runtime.build_links import Stations
from autopilot.vessel.file import load_vessel

VESSEL = load_vessel("lanxin")


class Start:
    """One start of the program, as far as ground stations are concerned."""

    def __init__(self, folder: Path, route: Path | None = None) -> None:
        path = str(folder / "boat.yaml")
        self.mission = load_mission(path, route)
        self.track = self.mission.guide
        self.skipper = Skipper(limits_of(VESSEL).angle_max, PlotterGuide(), self.mission)
        stations = Stations((f"udpout:127.0.0.1:{free_port()}",))
        self.clock = ManualClock()
        self.app = App(Plan(VESSEL, self.skipper, path, skipper=self.skipper, stations=stations), self.clock)
        assert self.app.store is not None
        self.store = self.app.store

    def end(self) -> None:
        with self.app:
            pass


def items() -> list[Any]:
    return [from_message(item(number, waypoint)) for number, waypoint in enumerate([place(10, 0), place(20, 5)])]


def test_a_route_is_there_after_a_restart_and_followed_by_nobody(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    first = Start(tmp_path)
    assert first.mission.items == ()
    first.mission.replace(items())
    first.end()
    second = Start(tmp_path)
    assert repr(second.mission.items) == repr(tuple(items()))
    assert not second.mission.is_followed and not second.track.following
    assert "route of 2 waypoints from" in capsys.readouterr().out
    second.mission.replace([])
    second.end()
    third = Start(tmp_path)
    assert third.mission.items == ()
    third.end()


def test_a_change_that_cannot_be_kept_is_an_alarm_until_it_can(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "boat"
    folder.mkdir()
    start = Start(folder)

    def saved() -> None:
        start.app._saver._worker.submit(int).result()

    def alarms() -> list[tuple[str, str]]:
        saved()
        for now in (start.clock.now() + 1.0, start.clock.now() + 2.0):
            start.clock.advance(1.0)
            start.app.session.poll(now)
        tick = start.app.session.tick
        assert tick is not None
        return [(alarm.name, alarm.detail) for alarm in tick.alarms if alarm.name == "change_not_kept"]

    with start.app:
        assert alarms() == []
        folder.rename(tmp_path / "pulled out")
        start.mission.replace(items())
        ((_, detail),) = alarms()
        assert detail == f"{folder}/boat.mission.waypoints: cannot be written (No such file or directory)"
        start.mission.replace(items())
        assert len(alarms()) == 1
        assert start.store.set("GUI_LOOKAHEAD", 20.0) == ""
        saved()
        (tmp_path / "pulled out").rename(folder)
        start.mission.replace(items())
        ((_, detail),) = alarms()
        assert "boat.tuned.yaml: cannot be written" in detail, "what is not kept yet"
        start.store.set("GUI_LOOKAHEAD", 21.0)
        assert alarms() == []
    assert capsys.readouterr().err.count("boat.mission.waypoints: cannot be written") == 1


def test_what_could_not_be_kept_is_written_by_itself_as_it_was_changed_last(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    start, is_full = Start(tmp_path), True

    def write(path: Path, text: str, **_: bool) -> None:
        if is_full:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        path.write_text(text)

    monkeypatch.setattr(saving, "replace_file", write)

    def alarms() -> set[str]:
        start.app._saver._worker.submit(int).result()
        start.app.run(0.5, lambda _: False)
        tick = start.app.session.tick
        assert tick is not None
        return {alarm.name for alarm in tick.alarms} & {"change_not_kept"}

    with start.app:
        start.store.set("GUI_LOOKAHEAD", 20.0)
        start.mission.replace(items())
        assert alarms() == {"change_not_kept"}
        start.store.set("GUI_LOOKAHEAD", 21.0)
        start.store.set("GUI_WP_RADIUS", 15.0)
        assert alarms() == {"change_not_kept"}
        is_full = False
        assert [alarms() for _ in range(8)][-1] == set()
        kept = load_vessel(str(tmp_path / "boat.tuned.yaml")).guidance
        assert (kept.lookahead_s, kept.waypoint_radius_m) == (21.0, 15.0)
        assert mission_file(str(tmp_path / "boat.yaml")).exists()
        is_full = True
        start.store.set("GUI_LOOKAHEAD", 22.0)
        assert alarms() == {"change_not_kept"}
        is_full = False
    assert load_vessel(str(tmp_path / "boat.tuned.yaml")).guidance.lookahead_s == 22.0, "tried once more at the end"
    said = capsys.readouterr().err
    assert said.count("kept now") == 3 and "is lost" not in said


def test_what_cannot_be_kept_to_the_end_is_said_to_be_lost(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "boat"
    folder.mkdir()
    start = Start(folder)
    with start.app:
        folder.rename(tmp_path / "pulled out")
        start.store.set("GUI_LOOKAHEAD", 20.0)
    assert "a change is lost: " in capsys.readouterr().err


@pytest.mark.parametrize("damage", [b"QGC WPL 110\n0\t0\t3\t16", b"\xff\xfe", b""])
def test_a_damaged_route_is_said_and_left_alone(
    damage: bytes, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = mission_file(str(tmp_path / "boat.yaml"))
    path.write_bytes(damage)
    start = Start(tmp_path)
    start.end()
    assert start.mission.items == ()
    assert "the route of an earlier run is not used" in capsys.readouterr().err
    assert path.read_bytes() == damage


def test_what_a_route_is_followed_with_is_set_while_under_way(tmp_path: Path) -> None:
    start = Start(tmp_path)
    settings = start.track.settings
    assert (settings.lookahead, settings.radius, settings.alarm_distance) == (4.0, 10.0, 50.0)
    assert settings.turn_radius == pytest.approx(28.0, abs=1.0), "Lanxin with 0.75 of the turn of 0.7 of its rudder"
    for name, value in (("GUI_LOOKAHEAD", 20.0), ("GUI_WP_RADIUS", 15.0), ("GUI_XTRACK_ALARM", 30.0)):
        assert start.store.set(name, value) == ""
    assert start.store.set("GUI_LOOKAHEAD", 1.0).startswith("GUI_LOOKAHEAD not changed")
    settings = start.track.settings
    assert (settings.lookahead, settings.radius, settings.alarm_distance) == (20.0, 15.0, 30.0)
    start.end()
    kept = load_vessel(str(tmp_path / "boat.tuned.yaml"))
    assert kept.guidance == dataclasses.replace(
        VESSEL.guidance, lookahead_s=20.0, waypoint_radius_m=15.0, off_track_alarm_m=30.0
    )


def test_a_file_named_is_the_route_and_a_bad_one_is_refused(tmp_path: Path) -> None:
    way = tmp_path / "way.txt"
    way.write_text(dump_items(items()))
    start = Start(tmp_path, way)
    assert repr(start.mission.items) == repr(tuple(items()))
    with pytest.raises(InputError, match="no position"):
        start.skipper.type_line("t")
    with pytest.raises(InputError, match="there is no waypoint 2 in a route of 2"):
        start.skipper.type_line("t 2")
    with pytest.raises(InputError, match="give the number of a waypoint"):
        start.skipper.type_line("t -1")
    start.end()
    assert not mission_file(str(tmp_path / "boat.yaml")).exists(), "only what has changed is kept"
    for name, says in (("none.txt", "No such file"), ("boat.bin", "not a text")):
        (tmp_path / "boat.bin").write_bytes(b"\xff\xfe")
        with pytest.raises(InputError, match=says):
            load_mission("boat.yaml", tmp_path / name)
