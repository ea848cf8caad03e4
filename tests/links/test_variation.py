"""The magnetic variation: who knows it, who of them counts, and what a model of the earth's field says of it."""

from __future__ import annotations

import builtins
import math
from dataclasses import replace
from datetime import date
from typing import Any

import pytest

from autopilot.errors import InputError
from autopilot.guidance.plotter import PlotterGuide
from autopilot.links.n2k.packets import Message, encoded
from autopilot.links.n2k.session import N2kSession, N2kSettings
from autopilot.links.nmea.link import NmeaSession, NmeaSettings
from autopilot.links.nmea.sentences import encode_hdg, encode_hdm, encode_rmc
from autopilot.links.north import Variation, earth_field, known_as
from autopilot.runtime.build_links import variation_of
from autopilot.signals import AlarmEvent, AlarmSample, HeadingSample, Sample
from autopilot.vessel.file import load_vessel

LANXIN = load_vessel("lanxin")


def headings(samples: list[Sample]) -> list[float]:
    return [math.degrees(each.heading) for each in samples if isinstance(each, HeadingSample)]


def test_the_one_that_is_set_goes_before_the_received_one_and_that_before_the_model_s() -> None:
    made = Variation(None, lambda latitude, longitude: 0.01 * latitude)
    assert made.value is None
    made.move(1.0, 0.2)
    assert made.value == pytest.approx(0.01)
    made.receive(0.0, 0.07)
    assert made.value == 0.07
    fixed = Variation(0.05, lambda *_: 1.0)
    fixed.receive(0.0, 0.07)
    fixed.move(1.0, 1.0)
    assert fixed.value == 0.05
    assert known_as(fixed) is fixed and known_as(0.3).value == 0.3 and known_as(None).value is None


def test_the_model_is_asked_again_only_where_the_boat_has_gone_far() -> None:
    asked: list[tuple[float, float]] = []

    def field(latitude: float, longitude: float) -> float:
        asked.append((latitude, longitude))
        return 0.0

    made = Variation(None, field)
    for step in range(100):
        made.move(1.0, 3.14 + 1e-4 * step)
    assert len(asked) == 5, "every 0.002 rad, over the date line too"


def test_what_one_link_hears_another_steers_by() -> None:
    """A GPS on one line sends RMC, a compass on another HDM, and the network 127258."""
    shared = Variation()
    gps = NmeaSession("gps", NmeaSettings(), variation=shared)
    compass = NmeaSession("compass", NmeaSettings(), variation=shared)
    network = N2kSession("network", N2kSettings(), guide=PlotterGuide(), variation=shared)
    assert headings(compass.receive(0.0, [encode_hdm(1.0)])) == []
    gps.receive(1.0, [encode_rmc(0.0, 3.0, 57.7, 11.8, variation=math.radians(4.0))])
    assert headings(compass.receive(1.1, [encode_hdm(1.0)])) == [pytest.approx(math.degrees(1.0) + 4.0, abs=0.06)]
    network.receive(32.0, [Message(127258, encoded(127258, {"variation": math.radians(6.0)}), 7)])
    assert headings(compass.receive(32.1, [encode_hdm(1.0)])) == [pytest.approx(math.degrees(1.0) + 6.0, abs=0.06)]
    magnetic = encoded(127250, {"heading": 1.0, "reference": "Magnetic"})
    assert headings(network.receive(32.2, [Message(127250, magnetic, 35)])) == [
        pytest.approx(math.degrees(1.0) + 6.0, abs=0.01)
    ]


def test_two_instruments_with_different_variations_do_not_swing_the_heading() -> None:
    """As a GPS does that sends 0 for unknown, beside one that knows."""
    shared = Variation()
    boat = NmeaSession("boat", NmeaSettings(), variation=shared)
    other = NmeaSession("other", NmeaSettings(), variation=shared)
    found: set[int] = set()
    for second in range(60):
        now = float(second)
        boat.receive(now, [encode_rmc(0.0, 3.0, 57.7, 11.8, variation=math.radians(10.0))])
        boat.receive(now, [encode_rmc(0.0, 3.0, 57.7, 11.8, variation=0.0, talker="GN")])
        other.receive(now, [encode_rmc(0.0, 3.0, 57.7, 11.8, variation=math.radians(-5.0))])
        found.update(round(heading) for heading in headings(boat.receive(now + 0.1, [encode_hdm(1.0)])))
    assert found == {67}
    for second in range(60, 100):
        other.receive(float(second), [encode_rmc(0.0, 3.0, 57.7, 11.8, variation=math.radians(-5.0))])
    assert [round(heading) for heading in headings(boat.receive(100.0, [encode_hdm(1.0)]))] == [52], "silent since 59 s"


def jumped(samples: list[Sample]) -> list[str]:
    events = [each.event for each in samples if isinstance(each, AlarmSample)]
    return [f"{event.name} {event.detail}" if event else "over" for event in events]


def test_a_variation_that_changes_its_sign_turns_no_boat_and_is_an_alarm_while_it_lasts() -> None:
    twelve = math.radians(12.0)
    boat = NmeaSession("boat", NmeaSettings(), variation=Variation())
    rmc = [encode_rmc(0.0, 3.0, 57.7, 11.8, variation=sign * twelve) for sign in (1.0, -1.0)]
    hdg = [encode_hdg(1.0, 0.0, sign * twelve) for sign in (1.0, -1.0)]
    assert jumped(boat.receive(0.0, [rmc[0], hdg[0]])) == []
    said: list[str] = []
    for step in range(1, 400):
        samples = boat.receive(0.2 * step, [rmc[1], hdg[1], encode_hdm(1.0)])
        said += jumped(samples)
        assert headings(samples) == [pytest.approx(math.degrees(1.0) + 12.0, abs=0.06)] * 2
    assert said == ["variation_jumped 12.0 E to 12.0 W"]
    assert jumped(boat.receive(81.0, [rmc[0], hdg[0]])) == ["over"]


def test_a_variation_that_changes_its_sign_on_nmea_2000_turns_no_boat() -> None:
    network = N2kSession("network", N2kSettings(), guide=PlotterGuide(), variation=Variation())

    def heard(now: float, degrees: float) -> list[Sample]:
        fields = {"heading": 1.0, "reference": "Magnetic", "variation": math.radians(degrees)}
        return network.receive(now, [Message(127250, encoded(127250, fields), 35)])

    assert jumped(heard(0.0, 12.0)) == []
    samples = heard(0.1, -12.0)
    assert jumped(samples) == ["variation_jumped 12.0 E to 12.0 W"]
    assert headings(samples) == [pytest.approx(math.degrees(1.0) + 12.0, abs=0.01)]
    assert jumped(heard(0.2, 12.1)) == ["over"]


def test_a_right_variation_after_a_wrong_one_is_taken_when_the_boat_is_not_steered() -> None:
    """A GPS that had kept the last port's place: no restart is needed, and no steered boat turns for it."""
    known = Variation()

    def said(now: float, degrees: float) -> float:
        return math.degrees(known.receive(now, math.radians(degrees), "gps"))

    known.on_tick(0.0, False)
    assert said(0.0, -3.0) == pytest.approx(-3.0)
    known.on_tick(1.0, True)
    assert {round(said(1.0 + second, 14.0)) for second in range(60)} == {-3}, "while it is steered"
    known.on_tick(61.0, False)
    assert [round(said(61.0 + second, 14.0)) for second in range(12)] == [-3] * 9 + [14] * 3
    assert known.alarm("gps") is None and math.degrees(known.value or 0.0) == pytest.approx(14.0)
    assert {round(said(80.0 + second, 0.0)) for second in range(60)} == {14}, "some say 0 that have lost their place"
    assert {round(said(150.0 + second, 40.0 * (second % 2))) for second in range(60)} == {14}, "it does not stand"


def test_a_steered_boat_does_not_turn_for_a_variation_that_was_0() -> None:
    known = Variation()
    known.receive(0.0, 0.0, "gps")
    known.on_tick(1.0, True)
    assert known.receive(2.0, 0.2, "gps") == 0.0
    assert known.alarm("gps") == AlarmEvent("variation_jumped", "0.0 E to 11.5 E")
    known.on_tick(3.0, False)
    assert known.receive(4.0, 0.2, "gps") == 0.2 and known.alarm("gps") is None


def test_an_instrument_that_is_silent_is_no_alarm() -> None:
    known = Variation()
    known.on_tick(0.0, True)
    known.receive(0.0, 0.1, "gps")
    known.receive(1.0, 0.2, "gps")
    known.on_tick(31.0, True)
    assert known.alarm("gps") is not None
    known.on_tick(31.1, True)
    assert known.alarm("gps") is None


def test_a_variation_goes_with_the_voyage_and_from_0_to_any() -> None:
    known = Variation()
    for step in range(200):
        known.receive(float(step), math.radians(0.1 * step), "gps")
    assert math.degrees(known.value or 0.0) == pytest.approx(19.9) and known.alarm("gps") is None
    late = Variation()
    for degrees in (0.0, 0.0, 14.0):
        late.receive(0.0, math.radians(degrees), "gps")
    assert math.degrees(late.value or 0.0) == pytest.approx(14.0) and late.alarm("gps") is None
    assert late.receive(1.0, 0.0, "gps") == pytest.approx(math.radians(14.0))
    assert late.alarm("gps") == AlarmEvent("variation_jumped", "14.0 E to 0.0 E")


def test_who_steers_by_magnetic_courses_needs_no_word_of_it() -> None:
    boat = NmeaSession("boat", NmeaSettings(magnetic=True), variation=Variation())
    for degrees in (12.0, -12.0):
        assert jumped(boat.receive(0.0, [encode_hdg(1.0, 0.0, math.radians(degrees))])) == []


@pytest.mark.parametrize("by_nmea", [True, False])
def test_a_position_has_the_model_give_the_variation(by_nmea: bool) -> None:
    shared = Variation(None, lambda latitude, _: math.radians(5.0) if latitude > 0.0 else math.nan)
    compass = NmeaSession("compass", NmeaSettings(), variation=shared)
    if by_nmea:
        compass.receive(0.0, [encode_rmc(0.0, 3.0, 57.7, 11.8)])
    else:
        place = encoded(129025, {"latitude": math.radians(57.7), "longitude": math.radians(11.8)})
        N2kSession("network", N2kSettings(), variation=shared).receive(0.0, [Message(129025, place, 7)])
    assert headings(compass.receive(1.0, [encode_hdm(1.0)])) == [pytest.approx(math.degrees(1.0) + 5.0, abs=0.06)]


@pytest.mark.parametrize(
    ("place", "degrees"),
    [((51.5, 0.0), 1.0), ((47.6, -122.3), 15.0), ((-33.9, 151.2), 12.8), ((57.69, 11.84), 5.2)],
)
def test_the_model_has_what_charts_have(place: tuple[float, float], degrees: float) -> None:
    """London, Seattle, Sydney and Gothenburg as charts of the decade show it, to half a degree."""
    pytest.importorskip("pygeomag", reason="pygeomag is not installed (extra field)")
    made = earth_field(date(2026, 6, 1))
    assert made.year == pytest.approx(2026.41, abs=0.01)
    assert math.degrees(made(*map(math.radians, place))) == pytest.approx(degrees, abs=0.5)


@pytest.mark.parametrize("today", [date(1970, 1, 1), date(2044, 1, 1)])
def test_a_date_that_no_edition_serves_is_refused_by_name(today: date) -> None:
    pytest.importorskip("pygeomag", reason="pygeomag is not installed (extra field)")
    with pytest.raises(InputError, match=f"no edition of the model serves {today.isoformat()}, this machine's date"):
        earth_field(today)


def test_without_the_package_a_sentence_names_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    real = builtins.__import__

    def missing(name: str, *rest: Any, **more: Any) -> Any:
        if name.split(".")[0] == "pygeomag":
            raise ImportError(name)
        return real(name, *rest, **more)

    monkeypatch.setattr(builtins, "__import__", missing)
    with pytest.raises(InputError, match=r"needs the package pygeomag; install .* pip install '\.\[field\]'"):
        variation_of(replace(LANXIN, sensors=replace(LANXIN.sensors, earth_field=True)))
    fixed = replace(LANXIN.sensors, earth_field=True, variation_deg=3.0)
    assert variation_of(replace(LANXIN, sensors=fixed)).value == pytest.approx(math.radians(3.0)), "it is not needed"
    assert variation_of(LANXIN).value is None
