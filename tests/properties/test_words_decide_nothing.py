"""Every sentence replaced by a random word: the boat is steered, given back, warned of and reported all the same."""

from __future__ import annotations

import json
import random
from collections.abc import Iterator
from functools import cache
from typing import Any, NamedTuple

import pytest
from boat_at_sea import NoParameters
from fault_boat import FaultBoat, bring_into
from fault_cells import ROWS, in_child

from autopilot import tick as one_tick
from autopilot.guidance.manoeuvres import TrialLimits, TrialWatch
from autopilot.links.alarm_outputs import StatusTexts
from autopilot.links.ground_station.boat_link import BoatLink
from autopilot.links.ground_station.commands import Commands
from autopilot.links.ground_station.file_server import alarm_list
from autopilot.links.ground_station.mission import Mission
from autopilot.links.ground_station.station_service import ParameterServer
from autopilot.links.transports import loopback_pair
from autopilot.signals import AlarmEvent, AlarmSample, ConditionSample, HelmSample, Sample, Tick
from autopilot.supervision import panel
from autopilot.supervision.supervisor import waits_to_engage
from autopilot.web.journal import AlarmBoard

WINDOW_S = 9.0
SCENES = {
    ("companion", "heading"): (
        "heading lost",
        "rudder stuck",
        "rudder reversed",
        "rate off by 5 deg/s",
        "pushed by more than the rudder can hold",
        "heels by 35 deg",
        "firmware reboots",
        "somebody chooses HOLD",
        "overrides ignored",
        "another ground station steers",
        "battery low",
        "geofence breached",
        "shallow water",
        "link silent",
        "the law returns no number",
    ),
    ("companion", "trial"): ("heading jumps by 40 deg", "shallow water"),
    ("companion", "track"): ("position lost",),
    ("companion", "override"): ("nothing", "somebody disarms"),
    ("companion", "fail-safe"): ("nothing", "link silent"),
    ("instruments", "heading"): ("rudder stuck, with a rudder sensor", "rudder sensor lost"),
    ("both", "heading"): ("second compass off by 30 deg", "first of two compasses lost"),
}


class Seen(NamedTuple):
    """What a tick comes to, words apart."""

    supervisor: int
    mode: int
    command: tuple[float, bool]
    siren: int
    alarms: tuple[tuple[str, str, bool, bool], ...]
    alarm_states: tuple[int, ...]
    listed: tuple[tuple[str, str, bool], ...]
    shown: tuple[tuple[str, bool, bool], ...]
    ill: int
    ends_trial: str
    waits: bool


@cache
def word_for(sentence: str) -> str:
    """Return a word in place of a sentence: the same each time, and another for another."""
    chance = random.Random(f"norrbin {sentence}")
    return "".join(chance.choices("abcdefghijklmnopqrstuvwxyz", k=chance.randint(6, 30)))


def unworded(sample: Sample) -> Sample:
    """Return a sample of a link with other words."""
    if isinstance(sample, HelmSample) and sample.reason:
        return sample._replace(reason=word_for(sample.reason))
    if isinstance(sample, AlarmSample) and sample.event is not None:
        return sample._replace(event=sample.event._replace(detail=word_for(sample.event.detail)))
    if isinstance(sample, ConditionSample) and sample.detail:
        return sample._replace(detail=word_for(sample.detail))
    return sample


def change_every_sentence(boat: FaultBoat) -> None:
    """From now on nothing is said in the words that anybody wrote."""
    for name, words in panel.WORDS.items():
        changed = words._replace(text=word_for(words.text), remedy=word_for(words.remedy), sentence=word_for(name))
        panel.WORDS[name] = changed
    panel._said = lambda event: word_for(repr(event._replace(is_escalated=False)))  # type: ignore[assignment]
    panel.UNACKNOWLEDGED = word_for(panel.UNACKNOWLEDGED)
    judged = one_tick.judged

    def judged_on(*given: Any) -> Any:
        state, found = judged(*given)
        return state, {
            name: event._replace(detail=word_for(event.detail)) if event.detail else event
            for name, event in found.items()
        }

    one_tick.judged = judged_on
    for link in boat.session._links:
        receive = link.receive
        link.receive = lambda now, receive=receive: [unworded(each) for each in receive(now)]


class Watcher:
    """A ground station's link, a trial's watch and the page's board, looking at every tick."""

    def __init__(self, boat: FaultBoat) -> None:
        self.said: list[tuple[float, int]] = []
        say = StatusTexts.send_text

        def note(texts: StatusTexts, now: float, severity: int, text: str) -> None:
            self.said.append((now, severity))
            say(texts, now, severity, text)

        StatusTexts.send_text = note  # type: ignore[method-assign]
        near, self._far = loopback_pair()
        commands = Commands(boat.skipper, False, Mission(boat.track))
        self._link = BoatLink(near, commands, ParameterServer(NoParameters()))
        self._trial = TrialWatch(TrialLimits())
        self._board = AlarmBoard(None)  # type: ignore[arg-type]

    def see(self, tick: Tick) -> Seen:
        self._link.publish_tick(tick)
        self._far.receive()
        status = self._link._telemetry._status(tick)[0]
        content = alarm_list(tick.alarms, tick.alarm_states)
        self._board._take(content)
        reason = self._trial.reason(tick)
        return Seen(
            supervisor=int(tick.supervisor),
            mode=int(tick.mode),
            command=(tick.command.angle, tick.command.engaged),
            siren=int(tick.siren),
            alarms=tuple((event.name, event.form, event.is_past, event.is_escalated) for event in tick.alarms),
            alarm_states=tuple(map(int, tick.alarm_states)),
            listed=tuple((each["name"], each["state"], each["escalated"]) for each in json.loads(content)),
            shown=tuple((each["name"], each["sounds"], each["acknowledged"]) for each in self._board.active),
            ill=status.onboard_control_sensors_enabled & ~status.onboard_control_sensors_health,
            ends_trial=reason.name if isinstance(reason, AlarmEvent) else reason,
            waits=waits_to_engage(tick),
        )


def sailed(boat: FaultBoat, row: Any, is_changed: bool) -> tuple[list[Seen], list[tuple[float, int]], set[str]]:
    """Return what is seen of the boat with the fault of a row, what severities were sent, and what was shown."""
    if is_changed:
        change_every_sentence(boat)
    watcher, first = Watcher(boat), len(boat.moments)
    row.inject(boat)
    boat.run(0.6 * WINDOW_S)
    boat.type_line("e 100")
    boat.run(0.4 * WINDOW_S)
    ticks = [moment.tick for moment in boat.moments[first:]]
    words = {said for tick in ticks for said in panel.sentences_of(tick.alarms)}
    return [watcher.see(tick) for tick in ticks], watcher.said, words


def scenes() -> Iterator[Any]:
    for (method, state), names in SCENES.items():
        yield pytest.param(method, state, names, id=f"{method}-{state}")


@pytest.mark.parametrize(("method", "state", "names"), list(scenes()))
def test_other_words_change_nothing(method: str, state: str, names: tuple[str, ...]) -> None:
    rows = {row.name: row for row in ROWS}
    boat = FaultBoat(method)
    bring_into(boat, state)
    kinds: set[str] = set()
    for name in names:
        seen: Any = in_child(lambda name=name: sailed(boat, rows[name], False))()
        other: Any = in_child(lambda name=name: sailed(boat, rows[name], True))()
        for number, (one, two) in enumerate(zip(seen[0], other[0], strict=True)):
            assert one == two, f"{name}, tick {number}"
        assert seen[1] == other[1], f"{name}: other severities"
        assert not seen[2] & other[2], f"{name}: a sentence that was not changed"
        kinds |= {alarm[0] for tick in seen[0] for alarm in tick.alarms}
    assert kinds, "something was said"
