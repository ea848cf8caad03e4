"""Which instrument is selected, when another takes over, and when two compasses disagree."""

from __future__ import annotations

import math
import random
from collections.abc import Callable

import pytest
from alarm_texts import words
from hypothesis import given
from hypothesis import strategies as st

from autopilot.angles import wrap
from autopilot.errors import InputError
from autopilot.estimation.sensor_selection import SelectionSettings, SensorSelection, SourceRule
from autopilot.links.mavlink.companion import CompanionLink
from autopilot.links.reconnect import SelectingLink
from autopilot.runtime.build_links import build_links, selection_of
from autopilot.signals import (
    AlarmEvent,
    AlarmSample,
    CompassSample,
    HeadingSample,
    HelmSample,
    RudderSample,
    Sample,
    SpeedSample,
)
from autopilot.vessel.file import dump_vessel, load_vessel, parse_vessel

LINK = "nmea:/dev/ttyUSB1:4800"
Said = list[CompassSample | AlarmSample]


def heading(now: float, source: str, value: float = 0.0) -> list[Sample]:
    return [HeadingSample(now, value, None, source)]


def believed(priority: SensorSelection, now: float, source: str, value: float = 0.0) -> bool:
    return bool([s for s in priority.admit(now, heading(now, source, value), LINK) if isinstance(s, HeadingSample)])


def test_without_a_list_the_first_heard_stays_until_it_is_stale() -> None:
    priority = SensorSelection()
    assert believed(priority, 0.0, "HCHDG")
    assert not believed(priority, 0.1, "HEHDT")
    assert believed(priority, 1.0, "HCHDG")
    assert not believed(priority, 2.9, "HEHDT")
    assert believed(priority, 3.1, "HEHDT"), "2 s of silence"
    assert not believed(priority, 3.2, "HCHDG"), "the old one waits in its turn"
    assert priority.dropped == 3
    assert priority.selected("heading") == f"HEHDT@{LINK}"


def test_the_first_of_the_list_is_believed_and_takes_over_once_it_has_settled() -> None:
    rules = (SourceRule("HEHDT", 1.0), SourceRule("HC*", 3.0))
    priority = SensorSelection(SelectionSettings(rules))
    assert believed(priority, 0.0, "HCHDG")
    assert believed(priority, 0.5, "HEHDT"), "at the start the better one need not wait"
    assert not believed(priority, 0.6, "HCHDG")
    assert believed(priority, 1.6, "HCHDG"), "a gyro silent for 1 s is stale"
    taken = [step for step in range(60) if believed(priority, 5.0 + step * 0.1, "HEHDT")]
    # the compass was last heard at 1.6 s and is stale after 3 s
    assert taken[0] == 0
    priority.reset()
    for step in range(100):
        believed(priority, step * 0.1, "HCHDG")
    times = []
    for step in range(100, 160):
        now = step * 0.1
        if believed(priority, now, "HEHDT"):
            times.append(now)
        believed(priority, now + 0.05, "HCHDG")
    assert times[0] == pytest.approx(13.0, abs=0.2), "back for three seconds, then it takes over"


def test_a_pattern_may_name_the_link() -> None:
    priority = SensorSelection(SelectionSettings((SourceRule("*@nmea-udp:*", 2.0),)))
    assert priority.admit(0.0, heading(0.0, "HCHDG"), LINK)
    assert priority.admit(0.1, heading(0.1, "HCHDG"), "nmea-udp:0.0.0.0:10110")
    assert not priority.admit(0.2, heading(0.2, "HCHDG"), LINK)


def test_kinds_are_chosen_apart_and_the_helm_always_passes() -> None:
    """Speed through the water and over the ground are two kinds: each is compared with the other, neither hides it."""
    priority = SensorSelection()
    samples: list[Sample] = [
        HeadingSample(0.0, 0.0, None, "HCHDG"),
        SpeedSample(0.0, 3.0, False, "VWVHW"),
        SpeedSample(0.0, 3.1, False, "IIVHW"),
        SpeedSample(0.0, 3.5, True, "GPRMC"),
        RudderSample(0.0, 0.1, False, "IIRSA"),
        RudderSample(0.0, 0.1, True, "servo"),
        HelmSample(0.0, False, "a hand on the helm", LINK),
    ]
    kept = priority.admit(0.0, samples, LINK)
    assert [sample for sample in samples if sample not in kept] == [samples[2]]


@pytest.mark.parametrize("seed", [1, 2])
def test_two_compasses_that_part_by_a_degree_a_minute_are_one_alarm(seed: int) -> None:
    priority, noise = SensorSelection(SelectionSettings(disagree=math.radians(15.0))), random.Random(seed)
    alarms = []
    for step in range(5 * 600):
        now = step * 0.2
        off = math.radians(12.0 + now / 60.0)
        for source, value in (("HEHDT", 0.0), ("HCHDG", off)):
            shown = value + math.radians(noise.gauss(0.0, 0.3))
            kept = priority.admit(now, heading(now, source, shown), LINK)
            alarms += [now for sample in kept if isinstance(sample, AlarmSample)]
    assert len(alarms) == 1 and 150.0 < alarms[0] < 240.0


def test_two_compasses_that_disagree_for_long_are_one_alarm_and_it_is_taken_back() -> None:
    priority = SensorSelection(SelectionSettings(disagree=math.radians(15.0)))
    alarms = []
    for step in range(600):
        now = step * 0.1
        off = math.radians(22.0 + math.sin(now)) if 50 <= step < 400 else 0.0
        for source, value in (("HEHDT", math.radians(359.0)), ("HCHDG", math.radians(359.0) + off)):
            kept = priority.admit(now, heading(now, source, value), LINK)
            alarms += [(now, words(sample.event)) for sample in kept if isinstance(sample, AlarmSample)]
    assert [bool(text) for _, text in alarms] == [True, False]
    assert alarms[0][0] == pytest.approx(8.0, abs=0.2)
    assert alarms[1][0] == pytest.approx(40.0, abs=0.2)
    assert "heading monitor: two compasses disagree by 2" in alarms[0][1]
    assert "HEHDT 359.0, HCHDG 02" in alarms[0][1]
    assert "sensors.priority" in alarms[0][1]


def test_compass_differences_in_turns_or_from_a_lost_compass_raise_no_alarm() -> None:
    priority = SensorSelection(SelectionSettings(disagree=math.radians(15.0)))

    def turned(time: float) -> float:
        """A turn of 120 deg at 20 deg/s in every 20 s."""
        return math.radians(120.0) * (time // 20.0) + math.radians(20.0) * min(time % 20.0, 6.0)

    for step in range(1200):
        now = step * 0.1
        swing = math.radians(40.0) if step % 50 < 25 else 0.0
        late = turned(now) if step < 400 else turned(now - 0.9)
        kept = priority.admit(now, heading(now, "HEHDT", turned(now)), LINK)
        if step < 1000:
            kept += priority.admit(now, heading(now, "HCHDG", late + (swing if step < 400 else 0.0)), LINK)
        assert not any(isinstance(sample, AlarmSample) for sample in kept), now


def test_a_compass_that_drifts_from_the_other_is_reported_before_it_is_20_deg_off() -> None:
    priority = SensorSelection(SelectionSettings(disagree=math.radians(15.0)))
    for step in range(200):
        now = step * 0.1
        kept = priority.admit(now, heading(now, "HEHDT", 1.0), LINK)
        kept += priority.admit(now, heading(now, "HCHDG", 1.0 + math.radians(1.0) * now), LINK)
        if any(isinstance(sample, AlarmSample) for sample in kept):
            return
    raise AssertionError("not reported")


@given(
    st.lists(st.tuples(st.floats(0.0, 5.0), st.text(max_size=8), st.floats(-10.0, 10.0)), max_size=80),
)
def test_never_two_at_a_time_and_memory_stays_small(heard: list[tuple[float, str, float]]) -> None:
    priority = SensorSelection(SelectionSettings(disagree=0.2))
    now = 0.0
    for gap, source, value in heard:
        now += gap
        kept = [s for s in priority.admit(now, heading(now, source, value), LINK) if isinstance(s, HeadingSample)]
        if kept:
            assert priority.selected("heading") == f"{source}@{LINK}"
    assert len(priority._received.get("heading", {})) <= 32


def test_the_vessel_file_says_it() -> None:
    text = dump_vessel(load_vessel("lanxin"))
    assert "priority" not in text
    text = text.replace("sensors:\n", 'sensors:\n  priority: [[HEHDT, 1.0], ["HC*", 3]]\n', 1)
    vessel = parse_vessel(text)
    assert vessel.sensors.priority == (("HEHDT", 1.0), ("HC*", 3.0))
    assert parse_vessel(dump_vessel(vessel)) == vessel
    settings = selection_of(vessel)
    assert settings.rules[1] == SourceRule("HC*", 3.0)
    assert settings.disagree == pytest.approx(math.radians(15.0))
    with pytest.raises(InputError, match=r"sensors\.priority has \[HEHDT, 0\]; needed are the name"):
        parse_vessel(text.replace("[HEHDT, 1.0]", "[HEHDT, 0]"))


def test_links_share_one_choice_and_a_lone_vehicle_none() -> None:
    vessel = load_vessel("lanxin")
    links = build_links(vessel, ["nmea-udp:127.0.0.1:0", "udpin:127.0.0.1:0"])
    assert all(isinstance(link, SelectingLink) for link in links)
    assert len({id(link._selection) for link in links if isinstance(link, SelectingLink)}) == 1
    for link in links:
        link.close()
    (link,) = build_links(vessel, ["udpin:127.0.0.1:0"])
    assert isinstance(link, CompanionLink)
    link.close()


def test_a_compass_that_jumped_and_is_well_again_is_not_said_to_jump_any_more() -> None:
    settings = SelectionSettings(disagree=math.radians(5.0), jump=math.radians(15.0))
    priority, said = SensorSelection(settings), {}
    for step in range(600):
        now = step * 0.1
        # 8 deg off is near enough to be well and too far to agree; for a while it jumps to 30
        off = 30.0 if 200 <= step < 250 else 8.0 if step < 400 else 1.0
        for source, value in (("HEHDT", 0.0), ("HCHDG", math.radians(off) + 1.0e-4 * (step % 3))):
            for sample in priority.admit(now, heading(now, source, value), LINK):
                if isinstance(sample, AlarmSample):
                    said[now] = words(sample.event)
    texts = [text.partition(";")[0] for text in said.values()]
    apart = "heading monitor: two compasses disagree by 8 deg: HEHDT 000.0, HCHDG 008.0"
    assert texts == [apart, "heading monitor: two compasses disagree: HCHDG jumps, HEHDT steers", apart, ""]


def test_the_speeds_through_the_water_and_over_the_ground_are_two_things() -> None:
    """A log and a GPS are no rivals; two logs are, and two GPS are."""
    priority = SensorSelection()
    for kept, sample in (
        (True, SpeedSample(0.0, 2.0, False, "VWVHW")),
        (True, SpeedSample(0.0, 3.0, True, "GPVTG")),
        (False, SpeedSample(0.1, 3.0, True, "VWVTG")),
        (False, SpeedSample(0.1, 2.0, False, "GPVHW")),
        (True, SpeedSample(0.2, 2.0, False, "VWVHW")),
        (True, SpeedSample(0.2, 3.0, True, "GPVTG")),
    ):
        assert (priority.admit(sample.time, [sample], LINK) == [sample]) is kept
    assert priority.selected("speed") == f"VWVHW@{LINK}"
    assert priority.selected("speed over ground") == f"GPVTG@{LINK}"


def test_compasses_that_differ_again_alarm_after_three_seconds() -> None:
    priority, said = SensorSelection(SelectionSettings(disagree=math.radians(15.0))), []
    for step in range(200):
        now = 0.125 * step
        off = 0.0 if step in (60, 61) else 20.0 if step < 60 else 30.0
        for source, value in (("HEHDT", 0.0), ("HCHDG", math.radians(off))):
            kept = priority.admit(now, heading(now, source, value), LINK)
            said += [(now, words(it.event).partition(": H")[0]) for it in kept if isinstance(it, AlarmSample)]
    apart = "heading monitor: two compasses disagree by {} deg"
    assert said == [(3.0, apart.format(20)), (7.5, ""), (7.75 + 3.0, apart.format(30))]


@pytest.mark.parametrize(("gap", "alarmed_at"), [(0.5, 3.0), (1.0, 3.0), (1.5, 4.5)])
def test_between_two_headings_no_more_than_a_second_counts_as_apart(gap: float, alarmed_at: float) -> None:
    priority, now, alarmed = SensorSelection(SelectionSettings(disagree=0.2)), 0.0, math.nan
    while math.isnan(alarmed):
        samples = [*heading(now, "HEHDT", 0.0), *heading(now, "HCHDG", 1.0)]
        if any(isinstance(sample, AlarmSample) for sample in priority.admit(now, samples, LINK)):
            alarmed = now
        now += gap
    assert alarmed == alarmed_at


@pytest.mark.parametrize(("apart_deg", "is_alarm"), [(24.9, False), (25.1, True)])
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_in_a_turn_compasses_may_be_apart_by_what_the_boat_turns_in_a_second(
    side: float, apart_deg: float, is_alarm: bool
) -> None:
    """15 degrees of the file, and a turn of 10 deg/s as it was over the last 3 s."""
    priority, alarmed = SensorSelection(SelectionSettings(disagree=math.radians(15.0))), False
    for step in range(120):
        now = 0.125 * step
        turned = side * math.radians(10.0) * now
        off = math.radians(apart_deg) if now >= 4.0 else 0.0
        samples = [*heading(now, "HEHDT", turned), *heading(now, "HCHDG", turned + off)]
        alarmed |= any(isinstance(sample, AlarmSample) for sample in priority.admit(now, samples, LINK))
    assert alarmed is is_alarm


@pytest.mark.parametrize(("silence", "taken"), [(2.0, False), (2.125, True)], ids=["just not stale", "stale"])
def test_a_source_is_stale_when_it_is_older_than_its_rule_says(silence: float, taken: bool) -> None:
    priority = SensorSelection()
    assert believed(priority, 0.0, "HEHDT")
    assert believed(priority, silence, "HCHDG") is taken
    ruled = SensorSelection(SelectionSettings((SourceRule("HE*", 9.0),), heading_stale=2.0))
    assert believed(ruled, 0.0, "HEHDT"), "a heading's own limit counts where it is the narrower"
    assert believed(ruled, silence, "HCHDG") is taken
    speeds = SensorSelection(SelectionSettings((SourceRule("V*", 2.0),), heading_stale=0.5))
    assert speeds.admit(0.0, [SpeedSample(0.0, 1.0, False, "VWVHW")], LINK)
    assert bool(speeds.admit(silence, [SpeedSample(silence, 1.0, False, "IIVHW")], LINK)) is taken


@pytest.mark.parametrize(("heard_for", "takes_over"), [(2.875, False), (3.0, True)])
def test_a_better_source_settles_for_three_seconds(heard_for: float, takes_over: bool) -> None:
    priority = SensorSelection(SelectionSettings((SourceRule("HEHDT", 2.0),)))
    for step in range(80):
        assert believed(priority, 0.125 * step, "HCHDG")
    for step in range(round(heard_for / 0.125)):
        assert not believed(priority, 10.0 + 0.125 * step, "HEHDT")
        assert believed(priority, 10.0 + 0.125 * step, "HCHDG")
    assert believed(priority, 10.0 + heard_for, "HEHDT") is takes_over


@pytest.mark.parametrize(("after", "takes_over"), [(2.875, True), (3.0, False)])
def test_in_the_first_three_seconds_of_the_worse_one_the_better_need_not_settle(after: float, takes_over: bool) -> None:
    priority = SensorSelection(SelectionSettings((SourceRule("HEHDT", 2.0),)))
    for step in range(round(after / 0.125)):
        assert believed(priority, 0.125 * step, "HCHDG")
    assert believed(priority, after, "HEHDT") is takes_over


def test_it_is_said_for_a_minute_that_a_compass_is_silent() -> None:
    priority, said = SensorSelection(SelectionSettings(disagree=0.2)), []
    for step in range(600):
        now = 0.125 * step
        kept = priority.admit(now, heading(now, "HEHDT") if now < 4.0 else [], LINK)
        kept += priority.admit(now, heading(now, "HCHDG"), LINK)
        said += [(now, words(it.event)) for it in kept if isinstance(it, AlarmSample)]
    # heard last at 3.875 s, stale after 2 s, taken the place of at 6 s
    assert [at for at, _ in said] == [6.0, 66.125]
    assert said[0][1].startswith("one of two compasses is silent: HEHDT; HCHDG steers") and said[1][1] == ""


def test_of_one_kind_thirty_two_sources_are_known_and_no_more() -> None:
    priority = SensorSelection(SelectionSettings((SourceRule("LAST", 2.0),)))
    for number in range(31):
        believed(priority, 0.0, f"A{number}")
    assert believed(priority, 0.0, "LAST"), "the thirty-second is heard, and the best"
    full = SensorSelection(SelectionSettings((SourceRule("LAST", 2.0),)))
    for number in range(32):
        believed(full, 0.0, f"A{number}")
    assert not believed(full, 0.0, "LAST")
    assert full.dropped == 32
    assert full.admit(0.0, [SpeedSample(0.0, 1.0, False, "LAST")], LINK), "of another kind it is the first"


def sail(selection: SensorSelection, span: tuple[float, float], headings: dict[str, Callable[[float], float]]) -> Said:
    """What comes out of ten headings a second [rad] by their sources from one time [s] to another: turns and alarms."""
    begin, end = span
    said: Said = []
    for number in range(round(10.0 * (end - begin))):
        now = begin + 0.1 * number
        samples: list[Sample] = [HeadingSample(now, wrap(of(now)), None, source) for source, of in headings.items()]
        admitted = selection.admit(now, samples, LINK)
        said += [each for each in admitted if isinstance(each, CompassSample | AlarmSample)]
    return said


def steady(degrees: float) -> Callable[[float], float]:
    return lambda now: math.radians(degrees)


def turning(degrees: float) -> Callable[[float], float]:
    return lambda now: math.radians(degrees + 8.0 * now)


@pytest.mark.parametrize("disagree", [math.inf, math.radians(15.0)])
def test_no_compass_is_chosen_in_a_turn_whether_or_not_they_are_compared(disagree: float) -> None:
    selection = SensorSelection(SelectionSettings(disagree=disagree))
    sail(selection, (0.0, 6.0), {"HEHDT": turning(0.0), "HCHDM": turning(8.0)})
    with pytest.raises(InputError, match="turning"):
        selection.choose(6.0, f"HCHDM@{LINK}")


@pytest.mark.parametrize("after", [1.0, 3.0, 10.0])
def test_behind_a_change_that_came_by_itself_a_choice_turns_by_what_lies_between(after: float) -> None:
    selection = SensorSelection(SelectionSettings(heading_stale=1.2, disagree=math.radians(15.0)))
    others = {"HCHDM": steady(14.0), "HCHDG": steady(2.0)}
    sail(selection, (0.0, 10.0), {"HEHDT": steady(0.0), **others})
    said = sail(selection, (10.0, 11.3 + after), others)
    turns = [each for each in said if isinstance(each, CompassSample)]
    assert [each.source for each in turns] == [f"HCHDM@{LINK}"]
    assert math.degrees(turns[0].turn) == pytest.approx(14.0)
    selection.choose(11.3 + after, f"HCHDG@{LINK}")
    chosen, *_ = selection.admit(11.3 + after, [], LINK)
    assert isinstance(chosen, CompassSample) and math.degrees(chosen.turn) == pytest.approx(-12.0)


def taking_turns(names: tuple[str, str], seconds: float = 120.0) -> tuple[float, list[str]]:
    """How far what is held is turned in the end [deg], and each change of alarm, two compasses 20 deg apart and with
    0.3 deg of noise being heard for 2.2 s each in turns."""
    selection, dice = SensorSelection(SelectionSettings(heading_stale=0.6)), random.Random(5)
    turned, said = 0.0, list[str]()
    for index in range(round(10.0 * seconds)):
        now = 0.1 * index
        turn = int(now / 2.2) % 2
        shown = math.radians(20.0 * turn + dice.gauss(0.0, 0.3))
        for sample in selection.admit(now, heading(now, names[turn], shown), LINK):
            if isinstance(sample, CompassSample):
                turned += math.degrees(sample.turn)
            elif isinstance(sample, AlarmSample):
                said.append("" if sample.event is None else sample.event.detail)
    return turned, said


def test_two_compasses_that_take_turns_are_one_alarm_and_turn_nothing_in_the_long_run() -> None:
    """108 changes of alarm in two minutes, and 3 deg by the noise of each change."""
    turned, said = taking_turns(("HEHDT", "HCHDG"))
    assert abs(turned) < 0.1 or abs(turned) == pytest.approx(20.0, abs=1.5)
    assert said == ["HEHDT; HCHDG steers", "", "HCHDG and HEHDT take turns"]


def test_one_that_comes_and_goes_is_one_alarm_until_it_has_stayed_for_a_minute() -> None:
    rules = (SourceRule("HEHDT", 1.0), SourceRule("HC*", 1.0))
    selection, said = SensorSelection(SelectionSettings(rules, heading_stale=0.6)), list[tuple[float, str]]()
    for index in range(1200):
        now = 0.1 * index
        for name in ("HEHDT", "HCHDG"):
            if name == "HEHDT" and now % 10.0 > 8.0 and now < 30.0:
                continue
            samples = selection.admit(now, heading(now, name), LINK)
            said += [(now, s.event.detail if s.event else "") for s in samples if isinstance(s, AlarmSample)]
    assert [text for _, text in said] == ["HEHDT; HCHDG steers", "", "HEHDT comes and goes", ""]
    assert said[-1][0] == pytest.approx(28.7 + 60.0, abs=0.5)


def test_a_compass_that_falls_silent_in_a_turn_leaves_what_lies_between_as_it_was() -> None:
    selection = SensorSelection(SelectionSettings(heading_stale=1.2))
    sail(selection, (0.0, 10.0), {"HEHDT": turning(0.0), "HCHDM": turning(8.0)})
    (turn,) = [each for each in sail(selection, (10.0, 15.0), {"HCHDM": turning(8.0)}) if type(each) is CompassSample]
    assert math.degrees(turn.turn) == pytest.approx(8.0, abs=0.1)


def test_a_heading_that_is_no_number_is_none() -> None:
    selection = SensorSelection()
    headings = {"HEHDT": steady(0.0), "HCHDM": steady(8.0)}
    sail(selection, (0.0, 5.0), headings)
    assert selection.admit(5.0, [HeadingSample(5.0, math.nan, None, "HCHDM")], LINK) == []
    sail(selection, (5.1, 8.0), headings)
    selection.choose(8.0, f"HCHDM@{LINK}")
    (chosen,) = selection.admit(8.0, [], LINK)
    assert isinstance(chosen, CompassSample) and math.degrees(chosen.turn) == pytest.approx(8.0)


def test_a_chosen_compass_that_is_not_there_is_mentioned_until_it_is() -> None:
    selection = SensorSelection(SelectionSettings(compass="HCHDM@nmea:/dev/ttyUSB0"))
    (said,) = sail(selection, (0.0, 100.0), {"HEHDT": steady(0.0)})
    assert isinstance(said, AlarmSample) and said.event is not None and 10.0 < said.time < 10.2
    assert said.event == AlarmEvent("compass_silent", "HCHDM, the chosen one; HEHDT steers")
    selection.choose(100.0, "")
    (said,) = sail(selection, (100.0, 101.0), {"HEHDT": steady(0.0)})
    assert isinstance(said, AlarmSample) and said.event is None
