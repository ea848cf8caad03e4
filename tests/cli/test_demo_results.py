"""The demo's table, JSON, figures and page, from a few ticks made by hand; the demo itself runs in the gate."""

from __future__ import annotations

import contextlib
import io
import json
import math
import re
from collections.abc import Callable
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from autopilot.cli import demo_legs
from autopilot.cli.demo_legs import (
    DemoFigures,
    DemoResult,
    Hold,
    Leg,
    TurnMeasures,
    as_json,
    as_text,
    heading_rms,
    travel_rate,
    turn_measures,
    write_demo_report,
)
from autopilot.errors import RefusedError
from autopilot.identification.identified import Identified
from autopilot.identification.residuals import Noise
from autopilot.models.norrbin import Norrbin
from autopilot.report.page import Line, Opening, Panel, Section, render, time_figure
from autopilot.signals import HeadingSample, Mode, NavState, Order, OrderKind, Reference, RudderCommand, Tick
from autopilot.vessel.file import load_vessel

GOAL = math.radians(90.0)


def tick(now: float, heading: float, rudder: float) -> Tick:
    state = NavState(now, heading, 0.1, 4.6, rudder, 0.0, 0.0, True)
    command = RudderCommand(now, rudder, True)
    order = Order(OrderKind.HEADING, GOAL, serial=1)
    return Tick(round(now * 10), now, (), order, state, Reference(GOAL), rudder, command, Mode.ENGAGED, ())


def turned() -> list[Tick]:
    """A turn to 90 deg that overshoots by 3 deg at 4 s and is within 1 deg from 5 s on; rudder out and back."""
    headings = [0.0, 30.0, 60.0, 85.0, 93.0, 90.5, 90.0, 90.0]
    rudders = [0.0, 10.0, 10.0, 0.0, -5.0, 0.0, 0.0, 0.0]
    return [
        tick(float(second), math.radians(degrees), math.radians(rudder))
        for second, (degrees, rudder) in enumerate(zip(headings, rudders, strict=True))
    ]


def test_a_leg_that_a_busy_machine_disturbs_is_sailed_slower_and_slower(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The machine stands still for 4 s, once a leg; the vehicle waits for 3 s of its own time."""

    def held_up(leg: Leg, vessel: object, out: Path, seed: int, pace: float) -> float:
        if 4.0 * pace > 3.0:
            raise RefusedError("stood still")
        return pace

    monkeypatch.setattr(demo_legs, "_sail_once", held_up)
    assert demo_legs.sail(Leg("turn", "pid", ()), load_vessel("lanxin"), tmp_path, 1) == 0.5  # type: ignore[comparison-overlap]
    assert capsys.readouterr().err.count("stood still: sailed again, slower, as for a busy machine\n") == 3


class Screen(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_what_disturbs_a_leg_is_not_written_behind_the_progress(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def held_up(leg: Leg, vessel: object, out: Path, seed: int, pace: float) -> float:
        if pace == demo_legs.PACES[0]:
            raise RefusedError("the loop stood still")
        return pace

    screen = Screen()
    monkeypatch.setattr(demo_legs, "_sail_once", held_up)
    monkeypatch.setattr("sys.stderr", screen)
    demo_legs.sail(Leg("turn", "pid", ()), load_vessel("lanxin"), tmp_path, 1)
    assert screen.getvalue() == "\rthe loop stood still: sailed again, slower, as for a busy machine\033[K\n"


def stalled(seconds: float) -> list[Tick]:
    """Twenty headings a second of a boat that turns by 10 deg/s, and none for so long from 2 s on."""
    moments = [0.05 * step for step in range(160) if not 2.0 < 0.05 * step < 2.0 + seconds]
    return [
        tick(now, 0.0, 0.0)._replace(
            samples=(HeadingSample(now, 0.0),), state=NavState(now, 0.0, math.radians(10.0), 4.6, 0.0, 0.0, 0.0, True)
        )
        for now in moments
    ]


@pytest.mark.parametrize(
    ("sailed", "words"),
    [
        (turned(), "left most of the ticks out"),
        (stalled(0.8), "held up the loop in a turn"),
        ([each._replace(samples=()) for each in stalled(0.1)], ""),
        (stalled(0.5), ""),
    ],
    ids=["most left out", "held up in the turn", "no heading", "held up for a moment"],
)
def test_a_leg_in_which_the_machine_held_up_the_loop_is_sailed_slower(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, sailed: list[Tick], words: str
) -> None:
    class Shown:
        def __init__(self, *anything: object) -> None:
            pass

        def __enter__(self) -> Shown:
            return self

        def __exit__(self, *anything: object) -> None:
            pass

        def run(self, longest: float, watch: Callable[[Tick], bool]) -> None:
            for each in sailed:
                watch(each)

    class Script:
        is_over, is_complete, begun_at = False, True, (0.0, 1.0)

    for name, stand_in in (("App", Shown), ("TrialScript", lambda steps: Script())):
        monkeypatch.setattr(demo_legs, name, stand_in)
    boat = load_vessel("lanxin")
    with pytest.raises(RefusedError, match=words) if words else contextlib.nullcontext():
        demo_legs._steer(Leg("turn", "pid", ()), boat, "udpin:127.0.0.1:0", tmp_path / "turn.tlog", 4.0)
    slowest = demo_legs.PACES[-1]
    ticks, _ = demo_legs._steer(Leg("turn", "pid", ()), boat, "udpin:127.0.0.1:0", tmp_path / "turn.tlog", slowest)
    assert len(ticks) == len(sailed)


def test_the_verdict_is_that_of_the_worse_turn_of_the_designed_law(result: DemoResult) -> None:
    summary = as_json(result._replace(turns={**result.turns, "turn-serial": TurnMeasures(0.9, math.nan, 0.5)}))
    said = demo_legs.verdict_of_demo(summary)
    assert said.grade == "fair" and "does not settle, 51.6 deg past" in said.sentence


def test_a_turn_is_measured() -> None:
    found = turn_measures(turned(), 1.0, 0.0, GOAL)
    assert math.degrees(found.overshoot) == pytest.approx(3.0)
    assert found.settling == pytest.approx(3.0)
    assert math.degrees(found.travel) == pytest.approx(20.0)


def test_a_turn_to_port_overshoots_to_port() -> None:
    mirrored = [tick(row.now, -row.state.heading, -row.command.angle) for row in turned()]
    assert math.degrees(turn_measures(mirrored, 1.0, 0.0, -GOAL).overshoot) == pytest.approx(3.0)


def test_a_turn_that_never_settles_says_so() -> None:
    assert math.isnan(turn_measures(turned()[:5], 0.0, 0.0, GOAL).settling)


def test_a_hold_is_measured_across_north() -> None:
    around_north = np.radians([359.0, 1.0, 359.0, 1.0])
    assert math.degrees(heading_rms(around_north, 0.0)) == pytest.approx(1.0)
    assert travel_rate(np.array([0.0, 1.0, 2.0]), np.array([0.0, 0.2, -0.2])) == pytest.approx(0.3)


@pytest.fixture
def result() -> DemoResult:
    boat = load_vessel("lanxin")
    true = Norrbin(gain=0.7, time_constant=0.3, n3=3.0, n1=1.0, n0=0.0, reference_speed=4.6)
    found = Identified(
        true._replace(gain=0.77, n3=0.0),
        {"gain": 0.01, "time_constant": 0.02, "n3": None, "n0": 0.0005},
        {"n3": "n3 cannot be distinguished from these runs."},
        (Noise(0.0, 0.0), Noise(0.0, 0.0)),
    )
    return DemoResult(
        true,
        found,
        boat,
        {"turn-backstepping": turn_measures(turned(), 1.0, 0.0, GOAL), "turn-pid": TurnMeasures(0.1, math.nan, 0.5)},
        {"sea-backstepping": Hold(math.radians(0.5), math.radians(2.0))},
        {},
        7,
    )


def test_the_table_holds_what_was_found(result: DemoResult) -> None:
    text = as_text(as_json(result))
    gain = next(line for line in text.splitlines() if line.startswith("K "))
    assert gain.split() == ["K", "1/s", "0.7000", "0.7700", "0.0100", "+10.0", "%"]
    cubic = next(line for line in text.splitlines() if line.startswith("n3 "))
    assert cubic.split()[-3:] == ["-", "-100.0", "%"], "no standard error where nothing was fitted"
    assert "n3 cannot be distinguished from these runs." in text
    assert "3.00 deg" in text
    assert "0.50 deg" in text
    assert "never" in text


def test_the_json_is_the_table(result: DemoResult) -> None:
    found = json.loads(json.dumps(as_json(result), allow_nan=False))
    assert found["seed"] == 7
    assert found["parameters"]["K"] == {"true": 0.7, "identified": 0.77, "std": 0.01, "unit": "1/s"}
    assert found["parameters"]["n3"]["std"] is None
    assert found["turn_90_deg_calm"]["backstepping, UDP"]["overshoot_deg"] == pytest.approx(3.0)
    assert found["turn_90_deg_calm"]["PID, UDP"]["settling_s"] is None, "never settled: JSON knows no nan"
    assert found["hold_sea_state_5"]["backstepping"]["heading_rms_deg"] == pytest.approx(0.5)


def test_the_report_is_one_file_that_needs_no_other(tmp_path: Path, result: DemoResult) -> None:
    shown = DemoFigures(turned(), {"backstepping": turned(), "pid": turned()}, {"backstepping": turned()})
    write_demo_report(tmp_path, shown, as_json(result))
    assert sorted(path.name for path in tmp_path.iterdir()) == ["hold.svg", "report.html", "trial.svg", "turn.svg"]
    page = (tmp_path / "report.html").read_text()
    assert page.count("<figure ") == 3
    assert not re.search(r"(src|href)=\"https?:", page)
    assert "0.7700" in page
    assert "never" in page
    assert "nan" not in page
    assert "autopilot demo --seed 7" in page


def test_a_figure_is_xml_with_its_labels_and_the_same_each_time() -> None:
    time = np.linspace(0.0, 1.0, 5)
    panels = [Panel("heading [deg]", [Line("reference", time, time, wanted=True), Line("PID", time, time**2)])]
    svg = time_figure(panels)
    assert ElementTree.fromstring(svg).tag.endswith("svg")
    assert all(word in svg for word in ("heading [deg]", "time [s]", "reference", "PID"))
    assert time_figure(panels) == svg


def test_the_page_escapes_texts_and_keeps_figures() -> None:
    opening = Opening("a < b", "lead & more", Section("", figure="<svg>1</svg>"), ("not enough", "not enough: <b>"))
    page = render(opening, [Section("s", [("<i>",), ("x",)], ("1 < 2",), "<svg></svg>")], "cmd")
    assert (
        page.index("<svg>1") < page.index('<p class="verdict not-enough">not enough: &lt;b&gt;') < page.index("<table")
    )
    assert "a &lt; b" in page
    assert "&lt;i&gt;" in page
    assert "1 &lt; 2" in page
    assert "<svg></svg>" in page
