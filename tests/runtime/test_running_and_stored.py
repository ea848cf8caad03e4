"""Every field counts at once or says that it waits: what runs is what was said to run, and can start again."""

from __future__ import annotations

import contextlib
import dataclasses
import json
import lzma
import math
import typing
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from autopilot.control.registry import filed_laws
from autopilot.errors import InputError, RefusedError
from autopilot.files.typed import hints_of
from autopilot.firmware.file import schema_text
from autopilot.links.ground_station.file_server import PARAMETERS, metadata_files
from autopilot.runtime import build_links
from autopilot.runtime.build import build_pilot, law_of, pilot_config, track_settings_of, wind_settings_of
from autopilot.runtime.vessel_store import VesselStore
from autopilot.signals import HeadingSample, Mode, Order, OrderKind
from autopilot.vessel.file import OF_THRUST, dump_vessel, load_vessel, parse_vessel
from autopilot.vessel.parameters import VesselParameter, counts_of, parameters_of, value_of
from autopilot.vessel.schema import NOW, RESTART, Counts, Drive, Guidance, Limits, Roll, Vessel

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
    assert pilot.mode is Mode.ENGAGED
    texts: list[str] = []
    taken: list[Vessel] = []
    store = VesselStore(FULL, pilot, law, Path("x"), lambda _, text: texts.append(text))
    store.changed = taken.append
    law_at_start, expected, stored = pilot.law.kind, dict(FULL_VALUES), dict(FULL_VALUES)
    for name, value in sequence:
        said = store.set(name, value)
        if "not changed" not in said and not math.isclose(value, stored[name], rel_tol=1e-6):
            stored[name] = store.get(name)
            assert stored[name] == pytest.approx(value, rel=1e-6, abs=1e-9)
            if TABLE[name].counts is NOW:
                expected[name] = stored[name]
            assert said.startswith(f"{name} counts from the next start on") is (stored[name] != expected[name])
        assert {each: value_of(store.running, TABLE[each]) for each in TABLE} == expected
        assert {each: store.get(each) for each in TABLE} == stored
        assert pilot.law.kind is law_at_start
    config = pilot_config(store.running, law)
    assert pilot.config == config._replace(rudder_is_ours=pilot.config.rudder_is_ours)
    assert pilot.law == law_of(store.running, law)
    assert not taken or taken[-1] == store.running
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
    monkeypatch.setattr("autopilot.links.n2k.link.open_bus", lambda *_: "bus")
    monkeypatch.setattr("autopilot.links.n2k.link.BusLine", lambda *_: "bus")
    for name in (
        "mavlink.companion.CompanionLink",
        "nmea.link.NmeaLink",
        "n2k.link.N2kLink",
    ):
        monkeypatch.setattr(f"autopilot.links.{name}", lambda *given: given)
    monkeypatch.setattr(build_links, "DriveLink", lambda *given: given)
    monkeypatch.setattr(build_links, "drive_of", lambda _, given: given)

    def of(vessel: Vessel) -> list[Any]:
        with_links = []
        for url in LINKS:
            link: Any = build_links.build_link(vessel, url, build_links.LinkOptions())
            # sounders are their own: what they are made of counts
            with_links.append([vars(each) if hasattr(each, "__dict__") else each for each in link])
        around = build_links.access_rules_of(vessel), build_links.networks_of(vessel)
        return [with_links, build_links.selection_of(vessel), *around, vessel.control.rate_hz]

    return of


class Field(NamedTuple):
    """A key of the vessel file by its path; `values` might be allowed in place of what it has."""

    path: str
    counts: Counts
    before: Vessel
    values: tuple[Any, ...]

    @property
    def after(self) -> Vessel:
        """The vessel with another value of the key, one that its file may have."""
        if self.path not in CHANGED:
            CHANGED[self.path] = changed(self.before, self.path, self.values)
        return CHANGED[self.path]

    @property
    def parameter(self) -> VesselParameter | None:
        """The same as a parameter, where it is one."""
        return next((each for each in parameters_of(self.before) if each.path == self.path), None)


CHANGED: dict[str, Vessel] = {}
OTHERS: dict[str, Any] = {
    "model.log": ("trial.tlog",),
    "sensors.deviation_deg": ((0.0, 1.5), (90.0, -1.0)),
    "sensors.priority": (("HEHDT", 2.0),),
    "alarms.outputs": ("tune",),
    "helm.servo_us": (1100.0, 1510.0, 1900.0),
    "security.allow_systems": (255,),
    "security.allow_addresses": ("10.0.0.0/24",),
}
"""Values of fields that are no single value."""


def others_of(path: str, value: Any, hint: Any) -> list[Any]:
    """Values that might be allowed in place of `value`."""
    if path in OTHERS:
        return [OTHERS[path]]
    if isinstance(value, bool):
        return [not value]
    if isinstance(value, str):
        return [*(word for each in typing.get_args(hint) for word in typing.get_args(each)), "said by somebody"]
    if isinstance(value, tuple):
        return [(0.99 * value[0], *value[1:])]
    if isinstance(value, int):
        return [value + 1]
    now = 0.0 if value is None else value
    return [*(share * now for share in (0.95, 1.05, 0.5, -1.0)), now + 0.1, now + 1.0, now - 1.0, 5.0, 15.0, 30.0, 5]


def fields_of(vessel: Vessel, section: Any, path: str = "") -> Iterator[Field]:
    hints = hints_of(type(section))
    for name, counts in counts_of(type(section)).items():
        where, value = f"{path}{name}", getattr(section, name)
        if counts is None:
            assert dataclasses.is_dataclass(value) or value is None, where
            yield from fields_of(vessel, value, f"{where}.") if value is not None else ()
        elif where != "schema_version" and (vessel.drive.kind != "rudder" or where not in OF_DRIVES):
            yield Field(where, counts, vessel, tuple(others_of(where, value, hints[name])))


def changed(vessel: Vessel, path: str, values: tuple[Any, ...]) -> Vessel:
    """`vessel` with one of `values`, the first that its file may have."""

    def with_value_at(section: Any, keys: list[str], value: Any) -> Any:
        inner = value if len(keys) == 1 else with_value_at(getattr(section, keys[0]), keys[1:], value)
        return replace(section, **{keys[0]: inner})

    for value in values:
        with contextlib.suppress(InputError):
            other = parse_vessel(dump_vessel(with_value_at(vessel, path.split("."), value)))
            if other != vessel:
                return other
    raise AssertionError(path)


def at(vessel: Any, path: str) -> Any:
    for key in path.split("."):
        vessel = getattr(vessel, key)
    return vessel


OF_DRIVES = {f"model.{name}" for name in OF_THRUST}
PUSHED = load_vessel("outboard")
ROLLING = replace(FULL, control=replace(FULL.control, roll=Roll(0.5, 5.0)))
NAVAL = load_vessel("naval_vessel")
FIELDS = {each.path: each for vessel in (NAVAL, ROLLING) for each in fields_of(vessel, vessel)}
FIELDS |= {each.path: each for each in fields_of(PUSHED, PUSHED) if each.path in OF_DRIVES}
SECTIONS = sorted({path.rpartition(".")[0] for path in FIELDS})
every_section = pytest.mark.parametrize("section", SECTIONS, ids=[section or "top" for section in SECTIONS])


@pytest.fixture(scope="module")
def fields() -> dict[str, list[Field]]:
    """The fields of each section."""
    return {each: [field for path, field in FIELDS.items() if path.rpartition(".")[0] == each] for each in SECTIONS}


@every_section
def test_a_field_runs_at_once_or_waits_for_the_restart_as_it_says(section: str, fields: dict[str, list[Field]]) -> None:
    for field in fields[section]:
        runs_or_waits(field)


def runs_or_waits(field: Field) -> None:
    pilot, texts = build_pilot(field.before), []
    store = VesselStore(field.before, pilot, None, Path("x"), lambda _, text: texts.append(text))
    try:
        assert store.put(field.after) == ""
    except RefusedError as refused:
        assert len(str(refused)) > 20 and (store.running, store.stored, texts) == (field.before, field.before, [])
        return
    new, old = at(field.after, field.path), at(field.before, field.path)
    assert at(store.stored, field.path) == at(parse_vessel(texts[-1]), field.path) == new != old, field.path
    assert at(store.running, field.path) == (new if field.counts is NOW else old), field.path
    assert store.waiting == (() if field.counts is NOW else (field.path,))
    config = pilot_config(store.running)
    assert pilot.config == config._replace(rudder_is_ours=pilot.config.rudder_is_ours), field.path


@every_section
def test_a_parameter_that_waits_says_so_when_it_is_set(section: str, fields: dict[str, list[Field]]) -> None:
    for field in fields[section]:
        if field.parameter is not None:
            says_that_it_waits(field, field.parameter)


def says_that_it_waits(field: Field, parameter: VesselParameter) -> None:
    store = VesselStore(field.before, build_pilot(field.before), None, Path("x"), lambda *_: None)
    said = store.set(parameter.name, value_of(field.after, parameter))
    if said.startswith(f"{parameter.name} not changed: "):
        assert store.stored == field.before
    else:
        assert said == ("" if field.counts is NOW else f"{parameter.name} counts from the next start on")
        assert store.set(parameter.name, value_of(field.before, parameter)) == "", "as it runs: nothing waits"


@every_section
def test_what_counts_at_once_is_nothing_that_a_link_was_opened_with(
    section: str, fields: dict[str, list[Field]], opened: Any
) -> None:
    for field in fields[section]:
        if field.counts is NOW:
            assert opened(field.after) == opened(field.before), field.path


WORDS = ("name", "description", "source", "date", "log")
ELSEWHERE = {
    "control.loop_delay_s": "the margins go by it",
    "control.law": "the pilot is built with it",
    "failsafe.reengage_after_restart_s": "the note of a held heading is kept for it",
    "length_m": "identify expects by it what other boats do",
    "sensors.gyro": "gains are designed by it",
    "sensors.earth_field": "it is asked where no variation is set, see tests/links/test_variation.py",
}


@every_section
def test_a_field_reaches_the_pilot_or_what_waits_for_the_restart(
    section: str, fields: dict[str, list[Field]], opened: Any
) -> None:
    """No number is taken and does nothing: it is the pilot's, the course's, or a link's."""
    for field in fields[section]:
        if field.path.rpartition(".")[2] not in WORDS and section != "model.standard_errors":
            assert reaches(field, opened) or field.path in ELSEWHERE, field.path


def reaches(field: Field, opened: Any) -> bool:
    laws = [law for law in filed_laws() if getattr(field.before.control, law) is not None]
    configs = [[pilot_config(each, law) for law in laws] for each in (field.before, field.after)]
    gains = [[repr(law_of(each, law).gains) for law in laws] for each in (field.before, field.after)]
    tracks = [(track_settings_of(each), wind_settings_of(each)) for each in (field.before, field.after)]
    differs = configs[0] != configs[1] or gains[0] != gains[1] or tracks[0] != tracks[1]
    waits = field.counts is RESTART and opened(field.after) != opened(field.before)
    return differs or waits


def test_metadata_and_schema_say_the_same() -> None:
    table = json.loads(lzma.decompress(metadata_files(list(TABLE.values()), "0.2.0")[PARAMETERS]))["parameters"]
    waiting = {each["name"] for each in table if each.get("rebootRequired")}
    assert waiting == {name for name, each in TABLE.items() if each.counts is RESTART}
    assert {"CTL_LAW", "CTL_RATE", "SNS_VARIATION", "SNS_HDG_LATENCY", "RUD_ANGLE_MAX", "HELM_METHOD"} <= waiting
    assert not {"BS_K1", "LIM_ANGLE_MAX", "GUI_RUDDER_SHARE", "SNS_HDG_NOISE", "MDL_K", "FS_RELEASE_AFTER"} & waiting
    properties = json.loads(schema_text("vessel"))["properties"]
    for field in FIELDS.values():
        *sections, key = field.path.split(".")
        held = properties
        for name in sections:
            held = next(one for one in held[name].get("anyOf", [held[name]]) if "properties" in one)["properties"]
        assert held[key]["x-counts"] == field.counts.value


@pytest.mark.parametrize("value", [7.0e-45, 1.0e-20, -1.0e-20, 3.0e38], ids="{:g}".format)
def test_no_number_of_a_station_ends_the_run(value: float, tmp_path: Path) -> None:
    """Such as the bits of a whole number, written as REAL32: it is taken or refused in a sentence."""
    store = VesselStore(LANXIN, build_pilot(LANXIN), None, tmp_path / "kept.yaml", save=lambda path, text: None)
    for name in store.names:
        was = store.get(name)
        said = store.set(name, value)
        assert (store.get(name) == was) == ("not changed" in said) or was == value, name
        store.set(name, was)
    assert "a regulator of 7.01e-45 rad/s does nothing" in store.set("BS_COURSE", 7.0e-45)
    assert store.stored == LANXIN
