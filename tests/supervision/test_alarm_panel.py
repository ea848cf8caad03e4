"""What sounds, until when, and how it is heard: terminal, file, vehicle, ground station."""

from __future__ import annotations

import dataclasses
import io
import math
from pathlib import Path
from typing import Any

import pytest
from alarm_texts import other, words, words_of
from hypothesis import given
from hypothesis import strategies as st
from watches import ENDS_STEERING

from autopilot.errors import InputError
from autopilot.guidance.plotter import PlotterGuide
from autopilot.guidance.track import TrackGuide
from autopilot.links.alarm_outputs import Acknowledgements, Bell, SwitchFile, VehicleSounder, severity_of
from autopilot.links.ground_station.mission import Mission
from autopilot.operators.skipper import Skipper
from autopilot.runtime.build import build_pilot
from autopilot.runtime.build_links import alarm_outputs_of
from autopilot.signals import (
    AcknowledgeSample,
    AlarmEvent,
    AlarmState,
    HeadingSample,
    Mode,
    NavState,
    Order,
    OrderKind,
    Reference,
    RudderCommand,
    Siren,
    Tick,
)
from autopilot.supervision.alarms import CATALOGUE, Priority, Severity
from autopilot.supervision.panel import AlarmPanel, sentence_of
from autopilot.vessel.file import load_vessel

COURSE = Order(OrderKind.HEADING, 1.0, serial=1)
OFF = {"off_course": AlarmEvent("off_course")}


def tick(now: float, siren: Siren) -> Tick:
    state = NavState(now, 0.0, 0.0, 4.0, 0.0, 0.0, 0.0, True)
    command = RudderCommand(now, 0.0, False)
    return Tick(0, now, (), COURSE, state, Reference(0.0), 0.0, command, Mode.ENGAGED, (), siren=siren)


def test_an_alarm_sounds_escalates_after_half_a_minute_and_is_silent_when_heard() -> None:
    panel = AlarmPanel()
    assert panel.update(0.0, OFF, (), COURSE) == ((OFF["off_course"],), Siren.SOUNDING)
    for second in (*range(1, 30), 29.95):
        assert panel.update(float(second), OFF, (), COURSE)[1] is Siren.SOUNDING
    texts, siren = panel.update(30.0, OFF, (), COURSE)
    assert siren is Siren.ESCALATED
    assert texts == (OFF["off_course"]._replace(is_escalated=True),)
    assert panel.states == (AlarmState.SOUNDING,)
    assert panel.update(31.0, OFF, (AcknowledgeSample(31.0),), COURSE) == ((OFF["off_course"],), Siren.QUIET)
    assert panel.states == (AlarmState.ACKNOWLEDGED,)
    assert panel.update(500.0, OFF, (), COURSE)[1] is Siren.SOUNDING, "forgotten for so long it is another one"


def test_another_alarm_sounds_though_one_was_heard() -> None:
    panel = AlarmPanel()
    panel.update(0.0, OFF, (), COURSE)
    heard = (AcknowledgeSample(1.0, "off_course"),)
    assert panel.update(1.0, OFF, heard, COURSE)[1] is Siren.QUIET
    assert panel.update(2.0, {**OFF, "roll": AlarmEvent("roll")}, (), COURSE)[1] is Siren.SOUNDING
    assert panel.update(3.0, {**OFF, "roll": AlarmEvent("roll")}, (AcknowledgeSample(3.0, "other"),), COURSE)[1]


def test_one_that_comes_and_goes_is_the_same_and_escalates() -> None:
    panel = AlarmPanel()
    for second in range(0, 29, 4):
        panel.update(float(second), OFF if second % 8 == 0 else {}, (), COURSE)
    assert panel.update(32.0, OFF, (), COURSE)[1] is Siren.ESCALATED


LOST = {"heading_lost": AlarmEvent("heading_lost")}
PAST = LOST["heading_lost"]._replace(is_past=True)


def test_what_is_over_is_said_as_past_until_it_is_acknowledged() -> None:
    panel = AlarmPanel()
    over = ("heading_lost",)
    assert panel.update(0.0, LOST, (), COURSE) == ((LOST["heading_lost"],), Siren.SOUNDING)
    assert panel.update(5.0, LOST, (), COURSE, over) == ((PAST,), Siren.SOUNDING)
    assert sentence_of(PAST).startswith("heading lost (ended): ")
    for second in range(6, 601):
        shown = panel.update(float(second), LOST, (), COURSE, over)
    assert shown == ((PAST._replace(is_escalated=True),), Siren.ESCALATED)
    assert panel.update(601.0, LOST, (AcknowledgeSample(601.0, "heading_lost"),), COURSE, over) == ((), Siren.QUIET)
    assert panel.states == ()
    for second in range(602, 661):
        assert panel.update(float(second), LOST, (), COURSE, over) == ((), Siren.QUIET)
    assert panel.update(661.0, LOST, (), COURSE) == ((LOST["heading_lost"],), Siren.SOUNDING), "lost again"


def test_an_acknowledged_alarm_ends_and_soon_after_counts_as_the_same() -> None:
    panel = AlarmPanel()
    panel.update(0.0, LOST, (AcknowledgeSample(0.0),), COURSE)
    assert panel.update(1.0, LOST, (AcknowledgeSample(1.0),), COURSE) == ((LOST["heading_lost"],), Siren.QUIET)
    assert panel.update(2.0, LOST, (), COURSE, ("heading_lost",)) == ((), Siren.QUIET)
    assert panel.update(4.0, LOST, (), COURSE) == ((LOST["heading_lost"],), Siren.QUIET)


def test_the_alarm_of_a_pilot_follows_the_headings() -> None:
    """Lost for 5 s and back for ten minutes: the fail-safe stands, and the alarm says how it is."""
    pilot = build_pilot(load_vessel("lanxin"))
    said: list[str] = []
    serial, lost_at, back_at = 1, 10.0, 15.0
    texts: tuple[str, ...] = ()
    for step in range(1, 20 * 660):
        now = 0.05 * step
        heard: tuple[Any, ...] = () if lost_at < now < back_at else (HeadingSample(now, 0.0, 0.0),)
        if 640.0 <= now < 640.05:
            heard = (*heard, AcknowledgeSample(now, "heading_lost"))
        tick = pilot.step(now, heard, Order(OrderKind.HEADING, 0.0, serial=serial))
        if words_of(tick) != texts:
            said.append(f"{now:.0f} {'; '.join(words_of(tick)).split(':')[0]}")
            texts = words_of(tick)
    assert tick.mode is Mode.FAILSAFE
    assert said[-5:] == ["11 heading lost", "17 heading lost (ended)", "41 NOT ACKNOWLEDGED", "640 "]


def test_whoever_gives_an_order_has_heard() -> None:
    panel = AlarmPanel()
    assert panel.update(0.0, OFF, (), COURSE)[1] is Siren.SOUNDING
    assert panel.update(1.0, OFF, (), COURSE._replace(heading=2.0))[1] is Siren.SOUNDING, "a route moves the heading"
    assert panel.update(2.0, OFF, (), COURSE._replace(serial=2))[1] is Siren.QUIET


@pytest.mark.parametrize("name", ["cannot_engage", "waiting_heading", "clock_stepped"])
def test_what_only_waits_makes_no_noise(name: str) -> None:
    panel = AlarmPanel()
    assert panel.update(100.0, {name: AlarmEvent(name)}, (), COURSE)[1] is Siren.QUIET
    assert panel.states == (AlarmState.NOTICE,)


@pytest.mark.parametrize("name", ["route_ended", "place_reached"])
def test_having_arrived_is_a_notice_and_never_escalates(name: str) -> None:
    panel = AlarmPanel()
    said = {"note of track": AlarmEvent(name, "holding 040.0 deg")}
    for second in range(100):
        texts, siren = panel.update(float(second), said, (), COURSE)
        assert siren is Siren.QUIET
        assert not texts[0].is_escalated
    assert panel.states == (AlarmState.NOTICE,)


def test_what_links_say_in_their_own_words_sounds() -> None:
    assert AlarmPanel().update(0.0, {"note of drive": other("9 A")}, (), COURSE) == ((other("9 A"),), Siren.SOUNDING)


@given(st.lists(st.tuples(st.floats(allow_nan=True), st.sampled_from(["", "roll", "x"]), st.integers(0, 2))))
def test_no_time_and_no_name_makes_it_stumble(steps: list[tuple[float, str, int]]) -> None:
    panel = AlarmPanel()
    for now, name, serial in steps:
        texts, siren = panel.update(now, OFF, (AcknowledgeSample(now, name),), COURSE._replace(serial=serial))
        assert len(texts) == 1
        assert siren in Siren


@pytest.mark.parametrize("name", CATALOGUE)
def test_a_status_text_is_as_bad_as_the_table_says(name: str) -> None:
    assert severity_of(AlarmEvent(name), 6) == min(6, CATALOGUE[name].severity)
    assert severity_of(AlarmEvent(name, is_escalated=True), 6) == Severity.ALERT


def test_the_terminal_rings_and_rings_faster() -> None:
    terminal = io.StringIO()
    bell = Bell(terminal)
    for step in range(40):
        bell.publish_tick(tick(0.1 * step, Siren.SOUNDING))
    assert terminal.getvalue() == "\a\a"
    for step in range(40):
        bell.publish_tick(tick(4.0 + 0.1 * step, Siren.ESCALATED))
    assert len(terminal.getvalue()) >= 2 + 7
    rung = len(terminal.getvalue())
    bell.publish_tick(tick(9.0, Siren.QUIET))
    assert len(terminal.getvalue()) == rung
    terminal.close()
    bell.publish_tick(tick(10.0, Siren.SOUNDING))


def test_a_file_is_switched_and_a_file_that_cannot_be_is_reported(tmp_path: Path) -> None:
    pin = tmp_path / "value"
    switch = SwitchFile(pin)
    switch.publish_tick(tick(0.0, Siren.QUIET))
    assert pin.read_text() == "0\n"
    switch.publish_tick(tick(1.0, Siren.SOUNDING))
    assert pin.read_text() == "1\n"
    switch.close()
    assert pin.read_text() == "0\n"
    broken = SwitchFile(tmp_path / "no" / "such" / "pin")
    broken.publish_tick(tick(0.0, Siren.SOUNDING))
    (sample,) = broken.receive(0.0)
    assert "alarms.outputs" in words(sample.event)  # type: ignore[union-attr]
    assert broken.receive(1.0) == []


def test_the_vehicle_plays_and_switches_until_it_is_over() -> None:
    sounder = VehicleSounder(True, 2)
    sounder.publish_tick(tick(0.0, Siren.SOUNDING))
    tune, relay = sounder.due(0.0, 7)
    assert (tune.get_type(), tune.target_system) == ("PLAY_TUNE", 7)
    assert (relay.command, relay.param1, relay.param2) == (181, 2.0, 1.0)
    assert [getattr(relay, f"param{number}") for number in range(3, 8)] == [0.0] * 5, "reserved: nothing of ours"
    assert sounder.due(0.1, 7) == []
    sounder.publish_tick(tick(1.0, Siren.ESCALATED))
    louder, again = sounder.due(1.0, 7)
    assert louder.tune != tune.tune
    assert again.param2 == 1.0
    sounder.publish_tick(tick(2.0, Siren.QUIET))
    (off,) = sounder.due(2.0, 7)
    assert off.param2 == 0.0
    assert sounder.due(60.0, 7) == []


def outputs(*names: str) -> Any:
    vessel = load_vessel("lanxin")
    return alarm_outputs_of(
        dataclasses.replace(vessel, alarms=dataclasses.replace(vessel.alarms, outputs=names)), io.StringIO()
    )


def test_the_vessel_file_chooses_where_alarms_are_heard() -> None:
    links, sounder = outputs("bell", "file:/tmp/pin", "tune", "relay:3")
    assert [type(link) for link in links] == [Bell, SwitchFile]
    sounder.publish_tick(tick(0.0, Siren.SOUNDING))
    assert len(sounder.due(0.0, 1)) == 2


@pytest.mark.parametrize("bad", ["", "horn", "relay:", "relay:16", "relay:x", "file:"])
def test_an_output_that_cannot_be_is_one_sentence(bad: str) -> None:
    with pytest.raises(InputError, match="allowed are bell, tune"):
        outputs(bad)


def test_the_skipper_s_key_reaches_the_pilot_once() -> None:
    skipper = Skipper(math.radians(30.0), PlotterGuide(), Mission(TrackGuide()))
    heard = Acknowledgements(skipper)
    assert heard.receive(0.0) == []
    assert "silent" in skipper.type_line("a")
    assert heard.receive(1.0) == [AcknowledgeSample(1.0, "", "skipper")]
    assert heard.receive(2.0) == []


@pytest.mark.parametrize(("gone", "state"), [(10.0, AlarmState.ACKNOWLEDGED), (10.1, AlarmState.SOUNDING)])
def test_an_alarm_that_is_back_within_ten_seconds_is_the_same_one(gone: float, state: AlarmState) -> None:
    panel = AlarmPanel()
    panel.update(0.0, OFF, (AcknowledgeSample(0.0),), COURSE)
    panel.update(1.0, OFF, (AcknowledgeSample(1.0),), COURSE)
    panel.update(1.0 + 0.5 * gone, {}, (), COURSE)
    panel.update(1.0 + gone, OFF, (), COURSE)
    assert panel.states == (state,)
    past = AlarmPanel()
    past.update(0.0, LOST, (AcknowledgeSample(0.0),), COURSE)
    past.update(1.0, LOST, (AcknowledgeSample(1.0),), COURSE)
    for share in (0.0, 0.5, 0.99):
        past.update(1.0 + share * gone, LOST, (), COURSE, ("heading_lost",))
    past.update(1.0 + gone, LOST, (), COURSE)
    assert past.states == (state,), "and one that was past, too"


def test_every_alarm_has_a_priority_and_only_cautions_are_silent() -> None:
    priorities = {name: kind.priority for name, kind in CATALOGUE.items()}
    assert all((priorities[name] is Priority.CAUTION) != kind.sounds for name, kind in CATALOGUE.items())
    for kind in CATALOGUE.values():
        if kind.response in ENDS_STEERING:
            assert kind.priority <= Priority.ALARM, kind.name
    chosen = ("envelope", "rudder_stuck", "off_course", "line_lost", "variation_unknown", "cannot_engage")
    assert [priorities[name] for name in chosen] == [
        *(Priority.EMERGENCY, Priority.ALARM, Priority.WARNING, Priority.WARNING, Priority.CAUTION, Priority.CAUTION)
    ]


def test_alarms_of_one_name_are_acknowledged_and_others_sound_on() -> None:
    panel = AlarmPanel()
    both = {"port, line": AlarmEvent("line_lost", "a"), "stern, line": AlarmEvent("line_lost", "b")}
    raised = {**both, "roll": AlarmEvent("roll")}
    panel.update(0.0, raised, (), COURSE)
    panel.update(1.0, raised, (AcknowledgeSample(1.0, "line_lost"),), COURSE)
    assert panel.states == (AlarmState.ACKNOWLEDGED, AlarmState.ACKNOWLEDGED, AlarmState.SOUNDING)
