"""The supervisor's table, as data: every cell, the ways through it, and its pages."""

from __future__ import annotations

from operator import attrgetter
from pathlib import Path

import pytest
from alarm_texts import text_of
from hypothesis import given
from hypothesis import strategies as st

from autopilot.signals import SupervisorState
from autopilot.supervision.alarms import CATALOGUE, Response
from autopilot.supervision.panel import WORDS
from autopilot.supervision.states import (
    ENDED,
    ENDINGS,
    ENGAGED,
    MODES,
    ORDERS,
    RETURNS,
    TABLE,
    Action,
    Event,
    Says,
)
from autopilot.vessel.file import load_vessel

DOCS = Path(__file__).parents[2] / "docs"
states = st.sampled_from(SupervisorState)
events = st.sampled_from(Event)


@given(states, events)
def test_every_state_and_event_has_its_row(state: SupervisorState, event: Event) -> None:
    row = TABLE[state, event]
    assert row.next in MODES
    # an end that nobody hears of is none
    assert row.says is not Says.NOTHING or row.next not in ENDED or row.next is state


def test_the_table_has_nothing_else() -> None:
    assert len(TABLE) == len(SupervisorState) * len(Event)


@given(states, st.lists(events, max_size=30))
def test_from_wherever_one_comes_an_order_to_stand_by_releases(state: SupervisorState, way: list[Event]) -> None:
    for event in way:
        state = TABLE[state, event].next
    row = TABLE[state, Event.RELEASE]
    assert row.next is SupervisorState.STANDBY
    assert Action.RELEASE in row.actions


@given(states, st.lists(events, max_size=30))
def test_who_takes_the_helm_has_it(state: SupervisorState, way: list[Event]) -> None:
    for event in way:
        state = TABLE[state, event].next
    row = TABLE[state, Event.HELM_TAKEN]
    assert row.next in (SupervisorState.OVERRIDE, SupervisorState.STANDBY)
    assert row.next is state or {Action.RELEASE, Action.SPEND} <= set(row.actions)


@given(st.sampled_from((SupervisorState.STANDBY, *ENDED)), st.lists(events, max_size=40))
def test_nothing_but_an_order_engages_or_what_the_file_allows(state: SupervisorState, way: list[Event]) -> None:
    for event in way:
        following = TABLE[state, event].next
        if state not in ENGAGED and following in ENGAGED:
            assert event in (*ORDERS, *RETURNS)
            assert Action.TAKE_HELM in TABLE[state, event].actions
        state = following


@given(st.sampled_from(ENDED), st.lists(events.filter(lambda e: e not in (*ORDERS, *RETURNS)), max_size=40))
def test_without_an_order_and_a_file_that_allows_it_steering_never_begins_again(
    state: SupervisorState, way: list[Event]
) -> None:
    for event in way:
        state = TABLE[state, event].next
        assert state not in ENGAGED


def test_a_fault_heals_by_nothing_but_an_order() -> None:
    for event in RETURNS:
        assert TABLE[SupervisorState.FAULT, event].next is SupervisorState.FAULT


@pytest.mark.parametrize("event", ENDINGS)
@pytest.mark.parametrize("state", ENGAGED)
def test_what_ends_an_engagement_spends_the_order_and_says_so(state: SupervisorState, event: Event) -> None:
    row = TABLE[state, event]
    assert row.next in ENDED
    assert Action.SPEND in row.actions
    assert row.says in (Says.OVERRIDDEN, Says.UNFIT, Says.MONITOR)


@pytest.mark.parametrize("name", CATALOGUE)
def test_every_alarm_says_what_to_do(name: str) -> None:
    words = WORDS[name]
    assert words.text
    assert len(words.remedy.split()) >= 3
    text = text_of(name, "17 deg")
    if "{remedy}" in words.sentence:
        assert text.index("17 deg") < text.index(words.remedy)
    # STATUSTEXT is ASCII, and people read it in pieces of fifty characters
    assert text.isascii()
    assert len(text) <= 200


def test_alarms_that_end_steering_are_critical() -> None:
    for kind in CATALOGUE.values():
        if kind.response in (Response.FAILSAFE, Response.LET_GO, Response.FAULT):
            assert kind.severity <= 2, kind.name


def test_every_alarm_has_its_condition_and_keys_of_the_vessel_file(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(DOCS))
    from alarm_conditions import CONDITIONS

    vessel = load_vessel("bow_thruster")
    assert WORDS.keys() == CATALOGUE.keys() == CONDITIONS.keys()
    for name, condition in CONDITIONS.items():
        assert condition.limit
        for key in filter(None, condition.key.split(", ")):
            section, entry = key.rsplit(".", 1)
            assert hasattr(attrgetter(section)(vessel), entry), f"{name}: {key}"


@pytest.mark.parametrize("name", ["supervisor", "alarms"])
def test_the_pages_are_as_the_tables_are(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(DOCS))
    import supervisor_pages

    page = getattr(supervisor_pages, f"{name}_page")()
    written = (DOCS / f"{name}.md").read_text(encoding="utf-8")
    assert written == page, "write them anew: python docs/supervisor_pages.py"
