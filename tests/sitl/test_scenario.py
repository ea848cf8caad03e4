"""Scenario files: what ships loads, what is wrong is one sentence with its place."""

from __future__ import annotations

import pytest

from autopilot.errors import InputError
from autopilot.files.strict_yaml import parse_document
from sitl.scenario import Scenario, load_scenario, scenario_from, shipped_scenarios

HEAD = "schema_version: 1\nname: x\n"


def parse(text: str) -> Scenario:
    return scenario_from(parse_document(HEAD + text, "x.yaml"))


@pytest.mark.parametrize("name", shipped_scenarios())
def test_every_shipped_scenario_loads_under_its_name(name: str) -> None:
    scenario = load_scenario(name)
    assert scenario.name == name
    assert scenario.description


def test_the_expected_scenarios_ship() -> None:
    assert {"calm", "jiang", "ittc", "sea-state-3", "sea-state-5"} <= set(shipped_scenarios())


def test_defaults_are_a_calm_sea() -> None:
    scenario = parse("")
    assert scenario.waves.ittc is None
    assert scenario.waves.second_order is None
    assert scenario.wind.speed_m_s == 0.0
    assert scenario.vehicle.armed
    assert scenario == load_scenario("calm").__class__(schema_version=1, name="x")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("wnd: {speed_m_s: 3}", ["wnd", "wind", "line 3"]),
        ("wind: {speed_kn: 3}", ["speed_kn", "speed_m_s"]),
        ("wind: {speed_m_s: -1}", ["wind.speed_m_s", "-1", "0 to 60"]),
        ("wind: {speed_m_s: fast}", ["wind.speed_m_s", "'fast'", "number"]),
        ("waves: {ittc: {significant_height_m: 2}}", ["peak_period_s"]),
        ("waves: {second_order: {frequency_rad_s: 1, damping: 1.5, sigma_deg: 1}}", ["damping", "1.5"]),
        ("faults: [{kind: heading_droput, from_s: 1, to_s: 2}]", ["heading_droput", "heading_dropout"]),
        ("faults: [{kind: silence, from_s: 5, to_s: 5}]", ["faults[0]", "to_s 5", "after from_s"]),
        ("vehicle: {mode: AUTO}", ["AUTO", "MANUAL"]),
        ("vehicle: {armed: yes}", ["vehicle.armed", "true or false"]),
        ("seed: -1", ["seed", "-1"]),
    ],
)
def test_what_is_wrong_is_said_in_one_sentence(text: str, words: list[str]) -> None:
    with pytest.raises(InputError) as caught:
        parse(text)
    message = str(caught.value)
    assert "\n" not in message
    assert message.startswith("x.yaml")
    for word in words:
        assert word in message, message


def test_another_schema_version_is_refused() -> None:
    with pytest.raises(InputError, match="schema_version is 2"):
        scenario_from(parse_document("schema_version: 2\nname: x\n", "x.yaml"))


def test_unknown_names_are_met_with_the_nearest() -> None:
    with pytest.raises(InputError, match="did you mean jiang"):
        load_scenario("jang")
    with pytest.raises(InputError, match=r"nowhere\.yaml"):
        load_scenario("nowhere.yaml")
