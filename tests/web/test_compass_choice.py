"""The compass that is steered by, chosen on a display: the boat stays on its course, whose number is another."""

from __future__ import annotations

import math
import re
from pathlib import Path

import pytest
from monitored_boat import Watched
from page_server import TOKEN, chromium, served

from autopilot.angles import wrap
from autopilot.errors import InputError
from autopilot.estimation.sensor_selection import SelectionSettings, SensorSelection
from autopilot.runtime.tick_codec import decode_tick, encode_tick
from autopilot.signals import CompassSample, HeadingSample, Sample
from autopilot.vessel.file import load_vessel
from autopilot.web.journal import CompassName, compasses_from

APART_DEG = 8.0


class TwoCompasses(Watched):
    """A boat with a true and a magnetic compass, 8 deg apart, which may come so many samples `late`."""

    def __init__(self, folder: Path) -> None:
        self.selection = SensorSelection(SelectionSettings(heading_stale=0.9, jump=math.radians(20.0), frozen=True))
        super().__init__(folder, compasses=self.selection)
        sense = self.box.sense
        self.magnetic_is_heard = True
        self.late = 0
        sensed: list[HeadingSample] = []

        def both() -> list[Sample]:
            kept: list[Sample] = []
            for sample in sense():
                if not isinstance(sample, HeadingSample):
                    kept.append(sample)
                    continue
                sensed.append(sample)
                old = sensed[-1 - min(self.late, len(sensed) - 1)]
                off = math.radians(APART_DEG + 0.4 * math.sin(137.0 * old.time))
                heard: list[Sample] = [sample._replace(source="HEHDT", rate=None)]
                if self.magnetic_is_heard:
                    heard.append(HeadingSample(old.time, wrap(old.heading + off), None, "HCHDM"))
                kept += self.selection.admit(self.box.time, heard, "nmea:a")
            return kept

        self.box.sense = both  # type: ignore[method-assign]

    def value(self, name: str) -> float | None:
        return self.station.view.value(name)

    def swing(self, seconds: float) -> float:
        """How far [deg] the boat turns from where it is now, at the most."""
        begun, most = self.box.heading, 0.0
        for _ in range(round(seconds / 0.05)):
            self.watch(0.05)
            most = max(most, abs(math.degrees(wrap(self.box.heading - begun))))
        return most


@pytest.fixture
def sea(tmp_path: Path) -> TwoCompasses:
    boat = TwoCompasses(tmp_path)
    boat.watch(6.0)
    return boat


def test_the_page_knows_both_and_the_choice_does_not_turn_the_boat(sea: TwoCompasses, tmp_path: Path) -> None:
    shown = sea.station.compasses.entries
    assert shown == (CompassName("HEHDT", "nmea:a", False), CompassName("HCHDM", "nmea:a", True))
    assert (sea.value("compass"), sea.value("compass_chosen")) == (1.0, 0.0)
    sea.order(do="engage")
    sea.watch(15.0)
    before, usual = sea.value("order"), sea.swing(10.0)
    sea.order(do="dodge", degrees=5.0)
    sea.order(do="back")
    sea.watch(20.0)
    assert before is not None
    assert sea.order(do="compass", number=2) == (True, "")
    assert sea.swing(10.0) < usual + 0.3
    assert (sea.value("compass"), sea.value("compass_chosen")) == (2.0, 2.0)
    assert sea.value("order") == pytest.approx((before + APART_DEG) % 360.0, abs=0.3)
    assert not sea.station.alarms.active
    assert load_vessel(str(tmp_path / "boat.tuned.yaml")).sensors.compass == "HCHDM@nmea:a", "kept for the next start"
    # a course that is ordered now is one by the other compass
    sea.order(do="heading", degrees=before + APART_DEG + 20.0)
    sea.watch(40.0)
    off = math.degrees(sea.box.heading) - before - 20.0
    assert math.remainder(off, 360.0) == pytest.approx(0.0, abs=0.6)
    assert sea.order(do="compass", number=0) == (True, ""), "back to the list, whose best stays the one that steers"
    sea.watch(1.0)
    assert (sea.value("compass"), sea.value("compass_chosen")) == (2.0, 0.0)


@pytest.mark.parametrize("late", [2, 10])
def test_a_compass_whose_headings_come_late_is_chosen_without_a_swing(sea: TwoCompasses, late: int) -> None:
    sea.late = late
    sea.order(do="engage")
    sea.watch(15.0)
    assert sea.order(do="compass", number=2) == (True, "")
    since = len(sea.ticks)
    assert sea.swing(5.0) < 0.2
    assert max(abs(math.degrees(tick.command.angle)) for tick in sea.ticks[since - 40 :]) < 2.0


def test_the_chosen_one_falls_silent_and_returns_and_the_boat_keeps_its_course(sea: TwoCompasses) -> None:
    sea.order(do="engage")
    sea.watch(10.0)
    begun, before = sea.box.heading, sea.value("order")
    assert before is not None
    sea.order(do="compass", number=2)
    for is_heard, turned in ((False, 0.0), (True, APART_DEG)):
        sea.magnetic_is_heard = is_heard
        assert sea.swing(8.0) < 0.4
        assert abs(math.remainder((sea.value("order") or 0.0) - before - turned, 360.0)) < 0.4
    assert abs(math.degrees(wrap(sea.box.heading - begun))) < 0.4
    assert (sea.value("compass"), sea.value("compass_chosen")) == (2.0, 2.0)


def test_a_boat_that_starts_again_numbers_its_compasses_anew(sea: TwoCompasses) -> None:
    board = sea.station.compasses
    assert len(board.entries) == 2
    sea.station._watch_start(sea.now, 1000.0)
    sea.station._watch_start(sea.now + 1.0, 1.0)
    assert board.entries == ()
    sea.watch(3.0)
    assert len(board.entries) == 2


@pytest.mark.real_time
def test_it_is_chosen_on_the_page(sea: TwoCompasses) -> None:
    with chromium() as browser, served(sea) as (address, hub):
        page = browser.new_page()
        page.goto(f"{address}/#token={TOKEN}")
        page.goto(f"{address}/#more")
        page.get_by_text(re.compile(r"^HEHDT [\d.]+° steers; HCHDM [\d.]+°$")).wait_for()
        page.select_option("#compass", label="HCHDM magnetic, nmea:a")
        page.get_by_text(re.compile(r"^HEHDT [\d.]+°; HCHDM [\d.]+° steers$")).wait_for()
        page.close()
        assert hub.sea.selection.chosen == "HCHDM@nmea:a"


def test_a_choice_is_refused_with_the_reason(sea: TwoCompasses) -> None:
    assert sea.order(do="compass", number=3) == (False, "there is no compass 3 among 2")
    sea.magnetic_is_heard = False
    sea.watch(4.0)
    assert sea.value("compass_2") is None and sea.value("compass_1") is not None
    assert sea.order(do="compass", number=2) == (False, "HCHDM is not heard")
    sea.magnetic_is_heard = True
    sea.watch(1.0)
    assert "has not been heard for 3 s" in sea.order(do="compass", number=2)[1]
    sea.watch(4.0)
    sea.order(do="zigzag", rudder=10.0, change=10.0, duration=60.0)
    sea.watch(2.0)
    assert "what leads goes by the present compass" in sea.order(do="compass", number=2)[1]
    sea.order(do="standby")
    sea.watch(20.0)
    assert sea.order(do="compass", number=2) == (True, ""), "in standby there is nothing to be turned"
    sea.watch(1.0)
    assert sea.value("heading") == pytest.approx((math.degrees(sea.box.heading) + APART_DEG) % 360.0, abs=1.5)


def test_a_choice_that_is_kept_goes_before_the_list() -> None:
    selection = SensorSelection(SelectionSettings(compass="HCHDM@a"))
    for step in range(20):
        now = 0.1 * step
        samples: list[Sample] = [HeadingSample(now, 0.0, None, "HEHDT"), HeadingSample(now, 0.1, None, "HCHDM")]
        kept = selection.admit(now, samples, "a")
    assert [each.source for each in kept] == ["HCHDM"]


def test_the_turn_to_another_compass_is_logged(sea: TwoCompasses) -> None:
    sea.order(do="compass", number=2)
    sea.watch(0.5)
    (tick,) = [tick for tick in sea.ticks if any(isinstance(each, CompassSample) for each in tick.samples)]
    assert decode_tick(encode_tick(tick)).samples == tick.samples


@pytest.mark.parametrize(
    "content", [b"{}", b"[1]", b'[{"name":"a","link":"b"}]', b'[{"name":1,"link":"b","magnetic":true}]']
)
def test_a_list_that_is_none_is_left_alone(content: bytes) -> None:
    with pytest.raises(InputError, match="the boat's compasses"):
        compasses_from(content)
