"""Vessel files: what is wrong is said with key, value and what is allowed; what is right survives a round trip."""

from __future__ import annotations

import dataclasses
import math
import typing
from pathlib import Path

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from autopilot.control.backstepping import Backstepping
from autopilot.control.pid import Pid
from autopilot.errors import InputError
from autopilot.files.typed import Bounds
from autopilot.vessel import schema as schema_module
from autopilot.vessel.file import dump_vessel, load_vessel, parse_vessel, problems, shipped_vessels
from autopilot.vessel.schema import Vessel

BOAT = """\
schema_version: 2
name: Boat
model:
  K_1_s: 0.7
  T_s: 0.3
  reference_speed_m_s: 4.6
rudder:
  angle_max_deg: 30
  rate_max_deg_s: 20
control:
  law: backstepping
  backstepping: {k1_1_s: 2, k2_1_s: 2}
"""


def sentence_of(text: str) -> str:
    with pytest.raises(InputError) as caught:
        parse_vessel(text, "boat.yaml")
    message = str(caught.value)
    assert message.startswith("boat.yaml, line ")
    assert "\n" not in message
    return message


def test_a_small_file_is_filled_with_defaults() -> None:
    vessel = parse_vessel(BOAT)
    assert vessel.model.n1 == 1.0
    assert vessel.control.rate_hz == 20.0
    assert isinstance(vessel.rudder.angle_max_deg, float)
    assert vessel.failsafe.resume is False


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("rudder:", "ruder:", "line 7, column 1: ruder is not a known key; did you mean rudder?"),
        (
            "  T_s: 0.3",
            "  T_ms: 300",
            "line 5, column 3: model.T_ms is not a known key: the unit is in the key, use T_s.",
        ),
        (
            "angle_max_deg",
            "angle_max_rad",
            "rudder.angle_max_rad is not a known key: the unit is in the key, use angle_max_deg.",
        ),
        ("K_1_s", "K", "model.K is not a known key: the unit is in the key, use K_1_s."),
        ("reference_speed_m_s", "reference_speed_kn", "the unit is in the key, use reference_speed_m_s."),
        (
            "  T_s: 0.3\n",
            "",
            "line 4, column 3: the key model.T_s is missing; give a finite number from 0.01 to 10000",
        ),
        ("0.7", "seven", "model.K_1_s is the text 'seven', needed is a finite number from 1e-05 to 100"),
        ("0.7", "0.7 1/s", "write the bare number, the unit is in the key."),
        ("0.7", "-0.7", "line 4, column 10: model.K_1_s is -0.7, needed is a finite number from 1e-05 to 100"),
        ("0.7", ".nan", "model.K_1_s is nan, needed is a finite number"),
        ("0.7", ".inf", "model.K_1_s is inf, needed is a finite number"),
        ("0.7", "true", "model.K_1_s is true, needed is a finite number"),
        ("0.7", "", "model.K_1_s is null or empty, needed is a finite number"),
        ("0.7", "[1]", "model.K_1_s is a list, needed is a finite number"),
        (
            "schema_version: 2",
            "schema_version: 3",
            "schema_version is 3, a vessel file of this Norrbin has 2; update Norrbin, or",
        ),
        ("schema_version: 2", "schema_version: 1.0", "schema_version is 1, needed is a whole number."),
        ("schema_version: 2\n", "", "the key schema_version is missing"),
        ("name: Boat", "name: 12", "name is 12, needed is text."),
        ("name: Boat", "name: ' '", "name is empty; give the boat a name."),
        ("law: backstepping", "law: backsteping", "allowed are backstepping, pid, sliding, sliding_roll; did you"),
        (
            "  law: backstepping",
            "  law: sliding_roll\n  roll: {rate_gain_s: 0.5}",
            "control.roll stands beside control.law sliding_roll, which damps roll itself; leave one of them out.",
        ),
        (
            "rudder:",
            "limits: {angle_max_deg: 31}\nrudder:",
            "limits.angle_max_deg is 31, allowed is at most rudder.angle_max_deg (30).",
        ),
        ("rudder:", "limits: {rate_max_deg_s: 21}\nrudder:", "limits.rate_max_deg_s is 21, allowed is at most"),
        (
            "rudder:",
            "failsafe: {resume: yes}\nrudder:",
            "failsafe.resume is the text 'yes', needed is true or false; yes, no",
        ),
        (
            "  T_s: 0.3",
            "  T_s: 0.3\n  n1: 0.5",
            "model.n1 is 0.5, allowed are 1 (course-stable) and -1 (course-unstable).",
        ),
        ("  T_s: 0.3", "  T_s: 0.3\n  n1: -1", "a course-unstable boat needs n3 above 0"),
        (
            "rudder:",
            "sensors: {heading_latency_s: 2}\nfailsafe: {heading_timeout_s: 1}\nrudder:",
            "or every heading is stale on arrival.",
        ),
        ("rudder:", "sensors: {deviation_deg: [[10, 1], [5, 1]]}\nrudder:", "headings rise from 0 to below 360."),
        (
            "rudder:",
            "sensors: {deviation_deg: [[10, 1, 2]]}\nrudder:",
            "sensors.deviation_deg[0] has 3 entries, 2 are needed.",
        ),
        (
            "rudder:",
            "sensors: {deviation_deg: [[10, 95]]}\nrudder:",
            "has a deviation of 95 at 10, allowed are -90 to 90.",
        ),
        ("rudder:", "sensors: 5\nrudder:", "sensors is 5, needed is a mapping of keys and values."),
    ],
)
def test_each_mistake_is_one_sentence(old: str, new: str, sentence: str) -> None:
    assert old in BOAT
    assert sentence in sentence_of(BOAT.replace(old, new, 1))


def test_a_list_is_no_vessel() -> None:
    assert "the document is a list" in sentence_of("- 1\n- 2\n")


@pytest.mark.parametrize("name", shipped_vessels())
def test_shipped_files_load_and_survive_a_round_trip(name: str) -> None:
    vessel = load_vessel(name)
    assert list(problems(vessel)) == []
    assert parse_vessel(dump_vessel(vessel, "a comment\nof two lines")) == vessel


def test_lanxin_is_the_printed_model_in_radians() -> None:
    model = load_vessel("lanxin").model
    assert (model.K_1_s, model.T_s, model.n1) == (0.701, 0.332, 1.0)
    assert model.n3_s2_rad2 == pytest.approx(0.001 * math.degrees(1.0) ** 2, rel=1e-5)
    assert model.reference_speed_m_s == pytest.approx(9 * 1852 / 3600, rel=1e-3)
    paper = load_vessel("lanxin_paper_gains")
    assert paper.model == model
    assert paper.control.backstepping == Backstepping(35.0, 15.0)
    assert paper.control.pid == Pid(40.0, 0.0, 0.1)


def test_lanxin_pid_has_the_error_dynamics_of_its_backstepping_law() -> None:
    """z'' + (k1 + k2) z' + (1 + k1 k2) z = 0 about a straight course: kp K/T and (1 + kd K)/T."""
    vessel = load_vessel("lanxin")
    gains, pid, model = vessel.control.backstepping, vessel.control.pid, vessel.model
    assert gains is not None
    assert pid is not None
    assert pid.kp * model.K_1_s / model.T_s == pytest.approx(1.0 + gains.k1_1_s * gains.k2_1_s, rel=1e-3)
    assert (1.0 + pid.kd_s * model.K_1_s) / model.T_s == pytest.approx(gains.k1_1_s + gains.k2_1_s, rel=1e-3)


def test_names_and_paths_that_lead_nowhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    shipped = load_vessel("lanxin")
    with pytest.raises(InputError, match=r"^lanxn: neither a file nor shipped; did you mean lanxin\?$"):
        load_vessel("lanxn")
    with pytest.raises(InputError, match=r"did you mean esso_osaka or esso_tanker\?$"):
        load_vessel("esso")
    with pytest.raises(InputError, match="shipped are blueboat"):
        load_vessel("zzz")
    with pytest.raises(InputError, match=r"lanxin\.yaml: no such file here; the shipped file is named lanxin"):
        load_vessel("lanxin.yaml")
    with pytest.raises(InputError, match="no such file"):
        load_vessel("./lanxin")
    (tmp_path / "lanxin.yaml").write_text(BOAT)
    assert load_vessel("lanxin.yaml").name == "Boat"
    (tmp_path / "lanxin").mkdir()
    assert load_vessel("lanxin") == shipped


def values_of(hint: typing.Any, bounds: Bounds | None = None) -> st.SearchStrategy[typing.Any]:
    """Strategy for any type hint of the schema, inside its bounds."""
    origin, arguments = typing.get_origin(hint), typing.get_args(hint)
    if origin is typing.Annotated:
        return values_of(arguments[0], next((each for each in arguments[1:] if isinstance(each, Bounds)), bounds))
    if origin is typing.Literal:
        return st.sampled_from(arguments)
    if origin is tuple:
        return st.just(()) if arguments[-1] is Ellipsis else st.tuples(*map(values_of, arguments))
    if origin is not None:
        return st.one_of(*(values_of(member, bounds) for member in arguments))
    if hint is type(None):
        return st.none()
    if dataclasses.is_dataclass(hint):
        hints = typing.get_type_hints(hint, include_extras=True)
        return st.builds(hint, **{name: values_of(member) for name, member in hints.items()})
    if hint is float:
        return st.floats(
            bounds.low if bounds else None, bounds.high if bounds else None, allow_nan=False, allow_infinity=False
        )
    if hint is int and bounds is not None and bounds.low is not None and bounds.high is not None:
        return st.integers(math.ceil(bounds.low), math.floor(bounds.high))
    return {bool: st.booleans(), int: st.just(schema_module.SCHEMA_VERSION), str: st.text(max_size=20)}[hint]


@settings(max_examples=60, deadline=None)
@given(vessel=values_of(Vessel), comment=st.text(alphabet=st.characters(codec="ascii", categories=("L", "N", "Z"))))
def test_every_vessel_survives_a_round_trip(vessel: Vessel, comment: str) -> None:
    complaints = list(problems(vessel))
    text = dump_vessel(vessel, comment)
    if complaints:
        with pytest.raises(InputError) as caught:
            parse_vessel(text)
        assert complaints[0][1] in str(caught.value)
    else:
        assert parse_vessel(text) == vessel


@settings(max_examples=200, deadline=None)
@given(st.data())
def test_a_damaged_file_raises_nothing_but_input_error(data: st.DataObject) -> None:
    start = data.draw(st.integers(0, len(BOAT) - 1))
    stop = data.draw(st.integers(start, min(len(BOAT), start + 8)))
    damaged = BOAT[:start] + data.draw(st.text(max_size=6)) + BOAT[stop:]
    try:
        parse_vessel(damaged)
    except InputError as error:
        assert "\n" not in str(error)


def test_a_boat_may_be_described_before_its_gains_are_known() -> None:
    """Identified, not yet designed for: the file is read, `gains` fills it, and `run` says what is missing."""
    text = dump_vessel(load_vessel("lanxin"))
    document = yaml.safe_load(text)
    del document["control"]["backstepping"], document["control"]["pid"]
    vessel = parse_vessel(yaml.safe_dump(document))
    assert vessel.control.backstepping is None
