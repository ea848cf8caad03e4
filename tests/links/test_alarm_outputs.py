"""Where alarms are heard, and texts to people: what is sent when, how often, until when."""

from __future__ import annotations

import io
import os
import threading
from pathlib import Path
from typing import Any

import pytest
from alarm_texts import other, words

from autopilot.links.alarm_outputs import (
    Acknowledgements,
    Bell,
    StatusTexts,
    SwitchFile,
    VehicleSounder,
    severity_of,
)
from autopilot.links.base import GuideAlarms
from autopilot.signals import (
    AcknowledgeSample,
    AlarmEvent,
    AlarmSample,
    Mode,
    NavState,
    Order,
    OrderKind,
    Reference,
    RudderCommand,
    Siren,
    Tick,
)


def tick(now: float, siren: Siren) -> Tick:
    state = NavState(now, 0.0, 0.0, 4.0, 0.0, 0.0, 0.1, True)
    command = RudderCommand(now, 0.0, False)
    order = Order(OrderKind.STANDBY)
    return Tick(0, now, (), order, state, Reference(0.0), 0.0, command, Mode.STANDBY, (), siren=siren)


def rung(*sirens: tuple[Siren, int]) -> list[int]:
    """Return at which eighths of a second the bell rings; each siren for so many of them."""
    terminal, times, step = io.StringIO(), [], 0
    bell = Bell(terminal)
    for siren, eighths in sirens:
        for _ in range(eighths):
            before = terminal.tell()
            bell.publish_tick(tick(0.125 * step, siren))
            times += [step] * (terminal.tell() - before)
            step += 1
    assert set(terminal.getvalue()) <= {"\a"}
    return times


def test_a_bell_rings_every_other_second_and_twice_a_second_once_escalated() -> None:
    bell = Bell(io.StringIO())
    assert (bell.fileno(), bell.receive(0.0), bell.take_packets()) == (-1, [], [])
    assert rung((Siren.QUIET, 50)) == []
    assert rung((Siren.SOUNDING, 50)) == [0, 16, 32, 48]
    assert rung((Siren.ESCALATED, 13)) == [0, 4, 8, 12]
    assert rung((Siren.SOUNDING, 3), (Siren.QUIET, 2), (Siren.SOUNDING, 3)) == [0, 5]


def test_a_terminal_that_is_gone_rings_no_more_and_stops_nothing() -> None:
    terminal = io.StringIO()
    bell = Bell(terminal)
    terminal.close()
    for step in range(9):
        bell.publish_tick(tick(float(step), Siren.ESCALATED))


def test_the_output_file_is_1_while_an_alarm_sounds(tmp_path: Path) -> None:
    path = tmp_path / "value"
    output = SwitchFile(path)
    for siren, text in ((Siren.QUIET, "0\n"), (Siren.SOUNDING, "1\n"), (Siren.ESCALATED, "1\n"), (Siren.QUIET, "0\n")):
        output.publish_tick(tick(0.0, siren))
        assert path.read_text() == text
    path.write_text("?")
    output.publish_tick(tick(0.0, Siren.QUIET))
    assert path.read_text() == "?", "only a change is written"
    output.publish_tick(tick(0.0, Siren.SOUNDING))
    output.close()
    assert path.read_text() == "0\n"
    assert output.receive(0.0) == []
    broken = SwitchFile(tmp_path / "none" / "value")
    broken.publish_tick(tick(0.0, Siren.SOUNDING))
    (alarm,) = broken.receive(3.0)
    assert isinstance(alarm, AlarmSample)
    assert (alarm.time, alarm.source) == (3.0, f"alarm output {tmp_path / 'none' / 'value'}")
    assert words(alarm.event).startswith("the alarm output cannot be written (")
    assert broken.receive(4.0) == []
    (tmp_path / "none").mkdir()
    broken.publish_tick(tick(5.0, Siren.QUIET))
    assert [words(sample.event) for sample in broken.receive(5.0)] == [""]  # type: ignore[union-attr]


def test_a_switch_that_is_a_pipe_without_a_reader_is_an_alarm_and_keeps_nobody_waiting(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "relay")
    output = SwitchFile(tmp_path / "relay")
    switching = threading.Thread(target=output.publish_tick, args=(tick(0.0, Siren.SOUNDING),), daemon=True)
    switching.start()
    switching.join(30.0)
    is_done = not switching.is_alive()
    reader = os.open(tmp_path / "relay", os.O_RDONLY | os.O_NONBLOCK)  # lets go of who waits
    assert is_done and len(output.receive(0.0)) == 1
    output.publish_tick(tick(1.0, Siren.QUIET))
    assert os.read(reader, 10) == b"0\n"
    os.close(reader)


def test_an_acknowledgement_is_passed_on_once() -> None:
    class Skipper:
        acknowledged: list[str] = [""]  # noqa: RUF012

    skipper = Skipper()
    link = Acknowledgements(skipper)
    assert link.receive(2.0) == [AcknowledgeSample(2.0, "", "skipper")]
    assert link.receive(3.0) == [] and skipper.acknowledged == []


def test_what_a_guide_says_is_passed_on_when_it_changes() -> None:
    class Guide:
        alarm: AlarmEvent | None = None

    guide = Guide()
    link = GuideAlarms(guide, "route")
    assert (link.fileno(), link.receive(0.0)) == (-1, [])
    guide.alarm = other("off the track")
    assert link.receive(1.0) == [AlarmSample(1.0, other("off the track"), "route")]
    assert link.receive(2.0) == []
    guide.alarm = None
    assert link.receive(3.0) == [AlarmSample(3.0, None, "route")]


def sounded(sounder: VehicleSounder, *sirens: tuple[Siren, float]) -> list[tuple[float, Any]]:
    found, step = [], 0
    for siren, seconds in sirens:
        for _ in range(round(4 * seconds)):
            now = 0.25 * step
            sounder.publish_tick(tick(now, siren))
            found += [(now, message) for message in sounder.due(now, 7)]
            step += 1
    return found


def test_a_tune_is_played_every_four_seconds_and_an_escalated_one_every_one_and_a_half() -> None:
    played = sounded(VehicleSounder(True, None), (Siren.QUIET, 5.0), (Siren.SOUNDING, 9.0), (Siren.ESCALATED, 4.0))
    assert [now for now, _ in played] == [5.0, 9.0, 13.0, 14.0, 15.5, 17.0]
    assert {(message.get_type(), message.target_system, message.target_component) for _, message in played} == {
        ("PLAY_TUNE", 7, 1)
    }
    assert [message.tune for _, message in played] == ["MFT200L8AAP4"] * 3 + ["MFT240L16ECECEC"] * 3


def test_a_relay_is_switched_at_once_again_every_five_seconds_and_off_once() -> None:
    switched = sounded(
        VehicleSounder(False, 0), (Siren.QUIET, 2.0), (Siren.SOUNDING, 6.0), (Siren.ESCALATED, 1.0), (Siren.QUIET, 20.0)
    )
    assert [(now, message.param2) for now, message in switched] == [(2.0, 1.0), (7.0, 1.0), (8.0, 1.0), (9.0, 0.0)]
    assert {(m.get_type(), m.target_system, m.target_component, m.command, m.confirmation, m.param1)
            for _, m in switched} == {("COMMAND_LONG", 7, 1, 181, 0, 0.0)}  # fmt: skip


def sent(texts: StatusTexts, seconds: float, start: float = 0.0) -> list[tuple[float, Any]]:
    return [(now, text) for step in range(round(seconds * 20)) for now in [start + 0.05 * step]
            for text in texts.due(now)]  # fmt: skip


def test_a_text_leaves_in_pieces_of_fifty_a_fifth_of_a_second_apart() -> None:
    texts = StatusTexts()
    texts.send_text(0.0, 4, "a" * 50)
    texts.send_text(0.0, 3, "b" * 50 + "c" * 50 + "d")
    texts.send_text(0.0, 2, "e" * 51)
    found = sent(texts, 3.0)
    assert [now for now, _ in found] == pytest.approx([0.0, 0.2, 0.4, 0.6, 0.8, 1.0], abs=0.06)
    assert [(text.severity, text.text, text.id, text.chunk_seq) for _, text in found] == [
        (4, "a" * 50, 0, 0),
        (3, "b" * 50, 1, 0),
        (3, "c" * 50, 1, 1),
        (3, "d", 1, 2),
        (2, "e" * 50, 2, 0),
        (2, "e", 2, 1),
    ]
    assert texts.dropped == 0


def test_a_fifth_of_a_second_to_the_bit_is_enough_between_two_texts() -> None:
    texts = StatusTexts()
    for text in "ab":
        texts.send_text(0.0, 4, text)
    assert [len(texts.due(now)) for now in (0.0, 0.1999, 0.2)] == [1, 0, 1]


def test_the_same_text_is_said_again_after_ten_seconds() -> None:
    texts = StatusTexts()
    said = []
    for now, text in ((0.0, "a"), (9.9, "a"), (10.0, "a"), (19.9, "a"), (19.95, "b"), (19.99, "a")):
        texts.send_text(now, 4, text)
        said += [(now, text.text) for _, text in sent(texts, 0.05, now)]
    assert said == [(0.0, "a"), (10.0, "a"), (19.95, "b")], "the last waits for its turn"
    assert [text.text for _, text in sent(texts, 1.0, 21.0)] == ["a"]


def test_of_more_than_forty_pieces_the_newest_are_dropped() -> None:
    texts = StatusTexts()
    texts.send_text(0.0, 4, "")
    assert texts.dropped == 0 and sent(texts, 1.0) == []
    for number in range(39):
        texts.send_text(0.0, 4, f"{number}")
    texts.send_text(0.0, 4, "x" * 51)
    assert texts.dropped == 1
    texts.send_text(0.0, 4, "last")
    texts.send_text(0.0, 4, "too many")
    assert texts.dropped == 2
    assert [text.text for _, text in sent(texts, 20.0, 1.0)] == [*map(str, range(39)), "last"]


def test_the_id_of_a_text_in_pieces_is_never_0() -> None:
    texts = StatusTexts()
    texts._identity = 65534
    for number in range(3):
        texts.send_text(0.0, 4, f"{number}" * 60)
    assert [text.id for _, text in sent(texts, 5.0)] == [65535, 65535, 1, 1, 2, 2]


def test_an_alarm_is_as_severe_as_its_kind_and_never_less_than_usual() -> None:
    assert severity_of(other("words that are in no catalogue"), 4) == 4
    assert severity_of(other("x")._replace(is_escalated=True), 4) == 1
    assert severity_of(other("x")._replace(is_escalated=True), 0) == 0
