"""`autopilot gains` as a user calls it: margins shown, a file that may be engaged, refusals with their reason."""

from __future__ import annotations

import json
import math
from argparse import Namespace
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from boats import BOATS, vessel_of

from autopilot.cli.gains import in_hand, write_vessel
from autopilot.cli.main import main
from autopilot.control.backstepping import Backstepping
from autopilot.errors import InputError, RefusedError
from autopilot.models.norrbin import at_speed_ratio
from autopilot.pilot import Pilot
from autopilot.report import gains as report
from autopilot.runtime.build import build_pilot, law_of, model_of, verdict_of
from autopilot.runtime.tuning import GainRequest, designed, holds, spread_of
from autopilot.vessel.file import dump_vessel, load_vessel
from autopilot.vessel.schema import Control, Model, StandardErrors, Vessel


def as_json(capsys: pytest.CaptureFixture[str], *arguments: str) -> dict[str, Any]:
    assert main(["gains", *arguments, "--json"]) == 0
    found: dict[str, Any] = json.loads(capsys.readouterr().out)
    assert set(found.pop("verdict")) == {"grade", "sentence"}
    return found


def test_every_row_has_margins_with_units_in_the_keys(capsys: pytest.CaptureFixture[str]) -> None:
    rows = as_json(capsys, "lanxin")
    assert set(rows) == {
        f"{whose} {law}" for whose in ("designed", "file's") for law in ("backstepping", "pid", "sliding")
    }
    for row in rows.values():
        assert row["stable"] is True
        assert row["refusal"] is None
        assert row["gain_margin"] > 2.0
        assert row["phase_margin_deg"] > 45.0
        assert row["delay_margin_s"] > 0.1
        for filtered in (row["with_heading_filter"], row["with_heading_filter_in_gusts"]):
            assert filtered["stable"]
            assert 0.1 < filtered["delay_margin_s"] < 3.0
            assert 1.0 < filtered["worst_sensitivity"] < 2.3
            assert filtered["K_may_be_smaller_by_factor"] < 0.7
            assert filtered["K_may_be_larger_by_factor"] > 2.0
        assert row["with_heading_filter"]["worst_sensitivity"] < 2.0
    assert rows["file's backstepping"]["gains"]["k1_1_s"] == 2.0


def test_the_papers_gains_are_refused_and_better_ones_offered(capsys: pytest.CaptureFixture[str]) -> None:
    rows = as_json(capsys, "lanxin_paper_gains")
    refused = rows["file's backstepping"]
    assert not refused["stable"]
    assert "20.0 deg/s" in refused["refusal"]
    assert "autopilot gains" in refused["refusal"]
    assert rows["designed backstepping"]["refusal"] is None


def test_what_is_written_may_be_engaged(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(RefusedError):
        build_pilot(load_vessel("lanxin_paper_gains"))
    out = tmp_path / "better.yaml"
    assert main(["gains", "lanxin_paper_gains", "--out", str(out)]) == 0
    assert str(out) in capsys.readouterr().out
    written = load_vessel(out)
    build_pilot(written)
    assert written.model == load_vessel("lanxin_paper_gains").model
    assert main(["gains", str(out), "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)
    assert rows["file's backstepping"]["gains"] == rows["designed backstepping"]["gains"]
    assert main(["gains", str(out)]) == 0
    said = capsys.readouterr().out
    assert said.count("designed backstepping, the file's, by speed") == 1
    assert "\nfile's backstepping" not in said, "what is the same is said once"


def test_a_tired_rudder_still_steers_a_boat_that_is_steady_by_itself(tmp_path: Path) -> None:
    """A calm loop keeps the boat's own damping instead of cancelling it, and then margins are left."""
    vessel = load_vessel("lanxin")
    tired = designed(replace(vessel, rudder=replace(vessel.rudder, lag_s=0.5, delay_s=0.2)))
    verdict = verdict_of(tired, "backstepping")
    # the usual limit, Astrom and Murray 2021
    assert verdict.margins.sensitivity <= 2.0
    gains = tired.control.backstepping
    assert gains is not None
    assert gains.k1_1_s + gains.k2_1_s >= 1.0 / vessel.model.T_s - 1.0e-4


def test_levels_go_from_calm_to_quick_and_calm_is_safer(capsys: pytest.CaptureFixture[str]) -> None:
    found = [as_json(capsys, "lanxin", "--level", str(level))["designed backstepping"] for level in (1, 3, 5, 7, 9)]
    crossovers = [row["crossover_rad_s"] for row in found]
    assert crossovers == sorted(crossovers)
    assert crossovers[-1] > 3.0 * crossovers[0]
    assert all(row["worst_sensitivity"] <= 2.0 for row in found)
    assert found[0]["worst_sensitivity"] < 1.4 < found[-1]["worst_sensitivity"]
    assert found[2] == as_json(capsys, "lanxin")["designed backstepping"]


def test_a_bandwidth_is_taken_as_it_is_and_judged(capsys: pytest.CaptureFixture[str]) -> None:
    row = as_json(capsys, "lanxin", "--bandwidth-rad-s", "2")["designed backstepping"]
    assert row["gains"]["course_rad_s"] == 2.0
    assert main(["gains", "lanxin", "--bandwidth-rad-s", "60"]) == 4
    assert "refused" in capsys.readouterr().err
    assert main(["gains", "lanxin", "--level", "12"]) == 2
    assert main(["gains", "lanxin", "--level", "4", "--bandwidth-rad-s", "2"]) == 2


@pytest.mark.parametrize("asked", ["0", "-1", "1e-320", "1e-100", "1e-6", "0.0903", "302", "1e6"])
def test_a_bandwidth_that_is_none_for_this_boat_is_one_sentence(asked: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["gains", "lanxin", f"--bandwidth-rad-s={asked}"]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and ": allowed for 'Lanxin' is 0.0904 to 301, " in said


def test_the_calmest_bandwidth_of_a_boat_is_judged(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    vessel, path = load_vessel("lanxin"), tmp_path / "boat.yaml"
    path.write_text(dump_vessel(replace(vessel, control=Control(rate_hz=1.0, loop_delay_s=0.05))))
    row = as_json(capsys, str(path), "--bandwidth-rad-s", "0.0905")["designed backstepping"]
    assert row["stable"] and row["crossover_rad_s"] > 0.0


@pytest.mark.parametrize(("gain", "time_constant"), [(0.02, 300.0), (0.001, 1000.0)])
def test_a_slow_ship_gets_gains_with_all_their_digits_that_can_be_read(
    gain: float, time_constant: float, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    boat, ship = load_vessel("lanxin"), tmp_path / "ship.yaml"
    boat = replace(boat, model=replace(boat.model, K_1_s=gain, T_s=time_constant, n3_s2_rad2=0.0))
    gains = designed(boat).control.backstepping
    assert gains is not None
    assert gains.gamma_1_s2 == pytest.approx(0.25 * gains.k1_1_s**2, rel=1.0e-5)
    ship.write_text(dump_vessel(designed(boat)))
    assert load_vessel(ship).control.backstepping == gains


def test_no_file_is_written_that_no_command_could_read(tmp_path: Path) -> None:
    boat, out = load_vessel("lanxin"), tmp_path / "better.yaml"
    heavy = designed(replace(boat, model=replace(boat.model, K_1_s=1.0e-5, T_s=1.0e4)))
    with pytest.raises(
        InputError, match=r"better\.yaml is not written, for no command could read it: .* control\.pid\.kp"
    ):
        write_vessel(Namespace(out=str(out), vessel="lanxin", overwrite=False, json=True), heavy)
    assert not out.exists()


def test_a_level_moves_the_regulator_alone_and_the_front_says_what_it_costs(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "calm.yaml"
    assert main(["gains", "lanxin", "--level", "3", "--out", str(path)]) == 0
    assert "* 3" in capsys.readouterr().out, "the front marks the level that was chosen"
    calm, middle = load_vessel(path).control.backstepping, designed(load_vessel("lanxin")).control.backstepping
    assert calm is not None and middle is not None
    assert 0.0 < calm.course_rad_s < middle.course_rad_s
    assert replace(calm, course_rad_s=0.0) == replace(middle, course_rad_s=0.0), "turns stay as they are"
    front = as_json(capsys, str(path))["designed backstepping"]["front"]
    assert [row["level"] for row in front] == list(range(1, 10))
    assert front[2]["bandwidth_rad_s"] == pytest.approx(calm.course_rad_s, rel=1.0e-3)
    headings, travels = ([row[key] for row in front] for key in ("heading_rms_deg", "rudder_travel_deg_s"))
    assert headings == sorted(headings, reverse=True)
    assert travels == sorted(travels)
    assert all(row["worst_boat_heading_rms_deg"] <= 1.6 * row["heading_rms_deg"] for row in front)


def test_blueboat_turns_well_with_all_of_its_steering(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The boat turns on by degrees while an order is on its way: what is planned is when it has come."""
    shipped = load_vessel("blueboat")
    for share in (1.0, 0.4):
        boat = tmp_path / f"boat{share}.yaml"
        boat.write_text(dump_vessel(replace(shipped, guidance=replace(shipped.guidance, rudder_share=share))))
        assert main(["gains", str(boat)]) == 0
        assert "good: turns 90 deg" in capsys.readouterr().out


def test_who_leads_past_in_turns_is_advised_to_plan_with_less(monkeypatch: pytest.MonkeyPatch) -> None:
    boat = report.judged(designed(load_vessel("blueboat")), "backstepping")
    monkeypatch.setattr(report, "turned", lambda *_: report.Turned(math.radians(8.0), 9.0))
    said = report.verdict_of_gains(boat, None).sentence
    assert "turns lead past" in said and "guidance.rudder_share below 1)" in said


def test_large_errors_and_the_worst_boat_are_reported(capsys: pytest.CaptureFixture[str]) -> None:
    good = as_json(capsys, "lanxin")["file's backstepping"]
    assert [row["corrected"] for row in good["large_errors"]] == [True] * 4
    assert good["large_errors"][0]["overshoot_deg"] < 1.0
    assert good["worst_boat"]["stable"]
    assert good["worst_boat"]["worst_sensitivity"] >= good["worst_sensitivity"]
    assert "assumed" in good["worst_boat"]["spread"]
    paper = as_json(capsys, "lanxin_paper_gains")["file's backstepping"]
    assert not any(row["corrected"] for row in paper["large_errors"])
    assert paper["large_errors"][0]["swings_at_the_end_deg"] > 10.0


def test_standard_errors_in_the_file_set_the_spread(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    vessel = load_vessel("lanxin")
    known = replace(vessel.model, standard_errors=replace(vessel.model.standard_errors, K_1_s=0.007, T_s=0.01))
    path = tmp_path / "known.yaml"
    path.write_text(dump_vessel(replace(vessel, model=known)))
    row = as_json(capsys, str(path))["file's backstepping"]
    assert "2 standard errors" in row["worst_boat"]["spread"]
    assumed = as_json(capsys, "lanxin")["file's backstepping"]
    assert row["worst_boat"]["worst_sensitivity"] < assumed["worst_boat"]["worst_sensitivity"]


def test_the_report_shows_the_loop(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib", reason="needs the extra report")
    page = tmp_path / "gains.html"
    assert main(["gains", "lanxin", "--report", str(page)]) == 0
    text = page.read_text(encoding="utf-8")
    assert text.count("<svg") >= 3
    for wanted in (
        "Response levels",
        "Large-signal response",
        "delay margin",
        "By speed: designed",
        "150 % = 6.95 m/s",
        "<li>with the heading filter: ",
    ):
        assert wanted in text


def test_every_row_has_the_gains_in_force_by_speed(capsys: pytest.CaptureFixture[str]) -> None:
    rows = as_json(capsys, "lanxin")
    for name, row in rows.items():
        speeds = row["speeds"]
        assert [each["speed_percent"] for each in speeds] == [20, 50, 75, 100, 125, 150]
        at_trial = speeds[3]
        for key in ("gain_margin", "phase_margin_deg", "delay_margin_s", "stable"):
            assert at_trial[key] == row[key]
        assert at_trial["gains"] == row["gains"]
        assert all(each["stable"] and each["refusal"] is None and not each["below_steerage"] for each in speeds), name
        delays = [each["delay_margin_s"] for each in speeds]
        if "pid" not in name:
            assert delays == sorted(delays, reverse=True), "a quick boat forgives less delay"
    slow = rows["file's backstepping"]["speeds"][1]
    assert slow["speed_m_s"] == pytest.approx(0.5 * 4.63)
    assert slow["K_1_s"] == pytest.approx(0.5 * 0.701)
    assert slow["T_s"] == pytest.approx(2.0 * 0.332)
    gains = {"k1_1_s": 1.0, "k2_1_s": 1.0, "gamma_1_s2": 0.25, "smoothing_s": 0.0, "course_rad_s": 0.0}
    assert slow["gains"] == pytest.approx(gains)
    sliding = [each["gains"] for each in rows["file's sliding"]["speeds"]]
    assert sliding[1] == pytest.approx({"slope_1_s": 1.0, "reach_deg_s2": 63.3 / 4.0, "boundary_deg_s": 31.7 / 2.0})
    assert len({tuple(each["gains"].values()) for each in rows["file's pid"]["speeds"]}) == 1


def test_the_margins_by_speed_are_those_of_a_boat_identified_at_that_speed() -> None:
    """The same boat and the gains that it has at half the speed, written down as a file of their own."""
    vessel = load_vessel("lanxin")
    half = at_speed_ratio(model_of(vessel), 0.5)
    model = replace(
        vessel.model,
        K_1_s=half.gain,
        T_s=half.time_constant,
        n3_s2_rad2=half.n3,
        reference_speed_m_s=half.reference_speed,
    )
    law, gains = law_of(vessel, "backstepping")
    control = replace(vessel.control, backstepping=Backstepping(*law.at(gains, 0.5).gains))
    alone = verdict_of(replace(vessel, model=model, control=control), "backstepping").margins
    assert verdict_of(vessel, "backstepping", 0.5).margins == pytest.approx(alone)


def test_speeds_that_are_not_steered_or_not_stable_are_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    vessel = load_vessel("lanxin_paper_gains")
    path = tmp_path / "waits.yaml"
    path.write_text(dump_vessel(replace(vessel, control=replace(vessel.control, steerage_m_s=2.0))))
    assert main(["gains", str(path)]) == 0
    designed_rows, files_rows = capsys.readouterr().out.split("by speed\n")[1:]
    assert designed_rows.count("below steerage") == 1
    assert "unstable" not in designed_rows
    assert "20 % = 0.93 m/s" in designed_rows
    assert files_rows.count("unstable") == files_rows.count("not to be engaged") == 5


def test_the_file_s_own_gains_stand_beside_the_designed_ones(capsys: pytest.CaptureFixture[str]) -> None:
    """They were left out as if they were the same."""
    assert main(["gains", "lanxin_paper_gains"]) == 0
    said = capsys.readouterr().out
    assert "designed backstepping" in said
    assert "file's backstepping" in said


def test_a_slower_rudder_gets_gentler_gains() -> None:
    quick = load_vessel("lanxin")
    slow = replace(quick, rudder=replace(quick.rudder, lag_s=0.2, delay_s=0.1))
    gains = [designed(vessel).control.backstepping for vessel in (quick, slow)]
    assert gains[0] is not None
    assert gains[1] is not None
    assert gains[1].k1_1_s < gains[0].k1_1_s
    assert not verdict_of(designed(slow), "backstepping").refusal


def test_a_rudder_too_slow_for_the_boat_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    vessel = load_vessel("lanxin")
    path = tmp_path / "tired.yaml"
    unsteady, tired = replace(vessel.model, n1=-1.0), replace(vessel.rudder, lag_s=0.5, delay_s=0.2)
    path.write_text(dump_vessel(replace(vessel, model=unsteady, rudder=tired)))
    out = tmp_path / "better.yaml"
    assert main(["gains", str(path), "--out", str(out)]) == 4
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1
    assert "steering gear is too slow" in lines[0]
    assert not out.exists()


@pytest.mark.parametrize(
    ("arguments", "parts"),
    [
        (["lanxim"], ("lanxim", "lanxin")),
        (["nowhere.yaml"], ("nowhere.yaml",)),
        (["lanxin", "--out", "/proc/none/boat.yaml"], ("/proc/none/boat.yaml", "cannot be written")),
    ],
)
def test_bad_input_is_one_sentence(
    arguments: list[str], parts: tuple[str, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["gains", *arguments]) == 2
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1
    assert all(part in lines[0] for part in parts)


def test_unknown_gains_name_their_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "boat.yaml"
    text = dump_vessel(load_vessel("lanxin"))
    path.write_text(text.replace("k1_1_s:", "k1:"))
    line = next(number for number, row in enumerate(path.read_text().splitlines(), 1) if "k1:" in row)
    assert main(["gains", str(path)]) == 2
    complaint = capsys.readouterr().err.strip()
    assert "boat.yaml" in complaint
    assert f"line {line}" in complaint
    assert "k1_1_s" in complaint
    assert "\n" not in complaint


@pytest.mark.parametrize(
    ("request_", "is_in_hand"), [(GainRequest(1), True), (GainRequest(9), True), (GainRequest(bandwidth=0.1), False)]
)
def test_too_slow_a_loop_loses_an_unstable_boat_with_a_weaker_rudder(
    request_: GainRequest, is_in_hand: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By the pilot itself, simulated: no level is such a loop, a bandwidth that is asked for may be."""
    monkeypatch.setattr(report, "SEEDS", (2,))
    assert report.survives(designed(vessel_of(BOATS["unstable"]), request_)) is is_in_hand


def test_a_turn_that_is_over_is_not_simulated_any_longer(monkeypatch: pytest.MonkeyPatch) -> None:
    """A boat that is all but neutral settles by its loop: its own time constant is no measure."""
    ticks = []
    step = Pilot.step
    monkeypatch.setattr(Pilot, "step", lambda *given: ticks.append(given[1]) or step(*given))
    neutral = replace(vessel_of(BOATS["unstable"]), model=Model(8.0, 40.0, 2.0, -1.0, 400.0))
    assert report.survives(designed(neutral))
    # a turn of 15 s, once
    assert max(ticks) < 60.0
    assert len(ticks) < 60.0 * neutral.control.rate_hz


def test_a_level_that_would_lose_the_boat_is_refused_or_raised(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    least = designed(vessel_of(BOATS["unstable"]), GainRequest(7)).control.backstepping
    assert least is not None

    def from_seven_on(vessel: Vessel) -> bool:
        gains = vessel.control.backstepping
        return gains is not None and gains.k1_1_s >= least.k1_1_s

    monkeypatch.setattr(report, "survives", from_seven_on)
    path, out = tmp_path / "unsteady.yaml", tmp_path / "better.yaml"
    path.write_text(dump_vessel(vessel_of(BOATS["unstable"])))
    assert main(["gains", str(path), "--level", "5", "--out", str(out)]) == 4
    message = capsys.readouterr().err.strip()
    assert "at level 5 a turn of 90 deg with a rudder 30 % weaker" in message
    assert "--level 7 bears it" in message
    assert "\n" not in message
    assert not out.exists()
    assert main(["gains", str(path), "--bandwidth-rad-s", "0.2"]) == 4
    assert "ask for more --bandwidth-rad-s" in capsys.readouterr().err
    assert in_hand(vessel_of(BOATS["unstable"]), GainRequest(), is_chosen=False).control.backstepping == least
    assert "level 7 in place of 5" in capsys.readouterr().err


@pytest.mark.parametrize("command", [["gains", "lanxin"], ["gains", "lanxin", "--tune"], ["identify", "a.csv"]])
def test_no_file_takes_the_place_of_a_shipped_boat(
    command: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main([*command, "--out", "lanxin"]) == 2
    assert "write lanxin.yaml, or ./lanxin" in capsys.readouterr().err
    assert not any(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("path_delay", "said"), [(0.12, "s of the delay margin are left"), (1.0, "beyond the delay margin")]
)
def test_a_path_that_was_measured_takes_of_the_delay_margin(path_delay: float, said: str) -> None:
    lanxin = load_vessel("lanxin")
    vessel = replace(lanxin, control=replace(lanxin.control, path_delay_s=path_delay))
    each = report.judged(vessel, "backstepping")
    (found,) = [sentence for sentence in report.sentences(each) if "orders were measured to come" in sentence]
    assert said in found
    left = report.as_json(each)["delay_margin_left_by_measured_path_s"]
    assert left == pytest.approx(each.output_feedback.delay - path_delay + 0.05)
    assert math.isnan(report.left_by_path(report.judged(lanxin, "backstepping")))


def test_gains_serve_boats_of_either_stability_near_them() -> None:
    """Of a boat with n1/T near 0 its regulator holds both ends, and a slow one loses the one that falls off."""
    cyber = load_vessel("small_craft")

    def boat(rate: float) -> Vessel:
        time, errors = 1.0 / abs(rate), StandardErrors(K_1_s=0.02 / abs(rate))
        section = replace(cyber.model, K_1_s=0.1 * time, T_s=time, n1=math.copysign(1.0, rate), n3_s2_rad2=18.0 * time)
        return replace(cyber, model=replace(section, standard_errors=errors))

    between = designed(boat(-0.14))
    assert spread_of(between)[0].gain == pytest.approx(0.4) and "T" in spread_of(between)[1]
    assert holds(between, boat(-0.28)) and holds(between, boat(0.28))
    loop = between.control.backstepping
    assert loop is not None
    slow = replace(between, control=replace(between.control, backstepping=replace(loop, course_rad_s=0.05)))
    assert holds(slow, boat(0.28)) and not holds(slow, boat(-0.28))
