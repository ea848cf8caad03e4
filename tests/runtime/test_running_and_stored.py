"""Every parameter counts at once or says that it waits: what runs is what was said to run, and can start again."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from autopilot.links.ground_station.file_server import PARAMETERS, metadata_files
from autopilot.runtime import build_links
from autopilot.runtime.build import build_pilot, law_of, pilot_config, track_settings_of
from autopilot.runtime.vessel_in_force import VesselInForce
from autopilot.signals import HeadingSample, Mode, Order, OrderKind
from autopilot.vessel.file import load_vessel, parse_vessel
from autopilot.vessel.parameters import VesselParameter, parameters_of, value_of, with_value
from autopilot.vessel.schema import Drive, Guidance, Limits, Vessel

LANXIN = load_vessel("lanxin")
FULL: Vessel = replace(
    LANXIN,
    sensors=replace(LANXIN.sensors, variation_deg=3.0),
    limits=Limits(angle_max_deg=25.0, rate_max_deg_s=10.0),
    guidance=Guidance(turn_rate_max_deg_s=5.0, turn_radius_m=20.0),
    estimator=replace(LANXIN.estimator, bias_time_s=20.0),
    control=replace(LANXIN.control, steerage_m_s=0.2),
    failsafe=replace(LANXIN.failsafe, action="firmware"),
    helm=replace(LANXIN.helm, rudder_at_full_pwm_deg=30.0),
    drive=Drive(angle_at_full_deg=35.0, current_max_a=5.0, device=1),
)
"""With a value for all that a file may leave out."""
TABLE = {each.name: each for each in parameters_of(FULL)}
LINKS = ("udpin:127.0.0.1:1", "nmea:/dev/none:4800", "n2k:socketcan:can0", "pypilot:/dev/none:38400")


def values_for(parameter: VesselParameter) -> st.SearchStrategy[float]:
    """Values in its range and near the one it has, and some that nobody may set."""
    now = value_of(FULL, parameter)
    if parameter.choices:
        return st.integers(-1, len(parameter.choices)).map(float)
    low = parameter.low if parameter.low is not None else -1e6
    high = parameter.high if parameter.high is not None else 1e6
    return st.one_of(
        st.sampled_from([0.8, 0.95, 1.1, 1.5]).map(lambda share: now * share),
        st.floats(low, high, width=32) if low == high else st.sampled_from([low, high, 0.5 * (low + high)]),
        st.sampled_from([math.nan, math.inf, -math.inf, -1e9, 1e30]),
    )


changes = st.sampled_from(sorted(TABLE)).flatmap(lambda name: st.tuples(st.just(name), values_for(TABLE[name])))


@settings(max_examples=60, deadline=None)
@given(st.lists(changes, min_size=1, max_size=25), st.sampled_from([None, "pid", "sliding"]))
def test_what_runs_is_what_was_said_to_run(sequence: list[tuple[str, float]], law: str | None) -> None:
    pilot = build_pilot(FULL, law)
    for step in range(1, 40):
        now = 0.05 * step
        pilot.step(now, (HeadingSample(now, 0.0, 0.0),), Order(OrderKind.HEADING, 0.1, serial=1))
    assert pilot.supervisor.mode is Mode.ENGAGED
    texts: list[str] = []
    told: list[Vessel] = []
    store = VesselInForce(FULL, pilot, law, Path("x"), lambda _, text: texts.append(text))
    store.changed = told.append
    law_at_start, expected, stored = type(pilot.law), dict(FULL_VALUES), dict(FULL_VALUES)
    for name, value in sequence:
        said = store.set(name, value)
        if "not changed" not in said and not math.isclose(value, stored[name], rel_tol=1e-6):
            assert (said == f"{name} counts from the next start on") is TABLE[name].waits
            stored[name] = store.get(name)
            assert stored[name] == pytest.approx(value, rel=1e-6, abs=1e-9)
            if not TABLE[name].waits:
                expected[name] = stored[name]
        assert {each: value_of(store.running, TABLE[each]) for each in TABLE} == expected
        assert {each: store.get(each) for each in TABLE} == stored
        assert type(pilot.law) is law_at_start
    config = pilot_config(store.running, law)
    assert pilot.config == config._replace(rudder_is_ours=pilot.config.rudder_is_ours)
    assert vars(pilot.law).get("gains") == vars(law_of(store.running, law)).get("gains")
    assert not told or told[-1] == store.running
    if texts:
        again = parse_vessel(texts[-1])
        assert {each: value_of(again, TABLE[each]) for each in TABLE} == stored
        build_pilot(again, law)
        build_pilot(again)


FULL_VALUES = {name: value_of(FULL, each) for name, each in TABLE.items()}


@pytest.fixture
def opened(monkeypatch: pytest.MonkeyPatch) -> Any:
    """What every kind of link, and what chooses among them, is set up with for a vessel."""
    monkeypatch.setattr(build_links, "open_transport", lambda *_: "line")
    monkeypatch.setattr(build_links, "open_bus", lambda *_: "bus")
    for name in ("CompanionLink", "NmeaLink", "N2kLink", "DriveLink"):
        monkeypatch.setattr(build_links, name, lambda *given: given)
    for drive in list(build_links.DRIVES):
        monkeypatch.setitem(build_links.DRIVES, drive, lambda given: given)

    def of(vessel: Vessel) -> list[Any]:
        with_links = []
        for url in LINKS:
            link: Any = build_links.build_link(vessel, url, build_links.LinkOptions())
            # sounders are their own: what they are made of counts
            with_links.append([vars(each) if hasattr(each, "__dict__") else each for each in link])
        return [with_links, build_links.selection_of(vessel), vessel.control.rate_hz]

    return of


def changed_value(parameter: VesselParameter) -> Vessel:
    """FULL with another value of the parameter that its file may have."""
    now = value_of(FULL, parameter)
    choices = [float(number) for number in range(len(parameter.choices))]
    for value in (*choices, 0.9 * now, 1.1 * now, now + 1.0, now - 1.0, 0.5 * now, now + 0.1, -now):
        try:
            changed = with_value(FULL, parameter, value)
        except ValueError:
            continue
        if changed != FULL:
            return changed
    raise AssertionError(parameter)


@pytest.mark.parametrize("parameter", list(TABLE.values()), ids=list(TABLE))
def test_what_counts_at_once_is_nothing_that_a_link_was_opened_with(parameter: VesselParameter, opened: Any) -> None:
    if not parameter.waits:
        assert opened(changed_value(parameter)) == opened(FULL)


@pytest.mark.parametrize("parameter", list(TABLE.values()), ids=list(TABLE))
def test_what_counts_at_once_reaches_the_pilot_and_what_waits_some_part(
    parameter: VesselParameter, opened: Any
) -> None:
    """No parameter is answered and does nothing: it is the pilot's, the course's, or a link's."""
    changed = changed_value(parameter)
    laws = ("backstepping", "pid", "sliding")
    configs = [[pilot_config(each, law) for law in laws] for each in (FULL, changed)]
    gains = [[vars(law_of(each, law)) for law in laws] for each in (FULL, changed)]
    differs = configs[0] != configs[1] or gains[0] != gains[1] or track_settings_of(FULL) != track_settings_of(changed)
    elsewhere = {"control.loop_delay_s", "control.law", "failsafe.reengage_after_restart_s"}
    assert differs or (parameter.waits and opened(changed) != opened(FULL)) or parameter.path in elsewhere


def test_metadata_says_the_same() -> None:
    import json
    import lzma

    table = json.loads(lzma.decompress(metadata_files(list(TABLE.values()), "0.2.0")[PARAMETERS]))["parameters"]
    assert {each["name"] for each in table if each.get("rebootRequired")} == {
        name for name, each in TABLE.items() if each.waits
    }
    waiting = {name for name, each in TABLE.items() if each.waits}
    assert {"CTL_LAW", "CTL_RATE", "SNS_VARIATION", "SNS_HDG_LATENCY", "RUD_ANGLE_MAX", "HELM_METHOD"} <= waiting
    assert {
        "BS_K1",
        "LIM_ANGLE_MAX",
        "GUI_RUDDER_SHARE",
        "SNS_HDG_NOISE",
        "MDL_K",
        "FS_RELEASE_AFTER",
    } & waiting == set()
