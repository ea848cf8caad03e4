"""The Pareto study of benchmarks/pareto.py: its fronts, its peer, and a small version of itself."""

from __future__ import annotations

import importlib
import itertools
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from autopilot.control.limits import Rest, RudderLimits
from autopilot.control.pid import PidGains, PidMemory
from sitl.scenario import HullSection

BENCHMARKS = Path(__file__).resolve().parents[2] / "benchmarks"
NAMES = ("pareto_front", "pareto_peer", "pareto_study", "pareto", "pareto_lost")
LIMITS = RudderLimits(0.5, 0.3)


@pytest.fixture
def modules(monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """The benchmarks' modules, with runs of the first boat as short as can be."""
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    found = {name: importlib.import_module(name) for name in NAMES}
    short = found["pareto_study"].BoatPlan(HullSection(), 12.0, 4.0)
    monkeypatch.setitem(found["pareto_study"].BOATS, "lanxin15", short)
    return found


def test_fronts_are_what_nothing_beats(modules: dict[str, Any]) -> None:
    points = np.random.default_rng(3).uniform(0.2, 3.0, (200, 2))
    kept = modules["pareto_front"].front(points)
    assert 2 < len(kept) < 40
    for point in points:
        assert any(np.all(best <= point) for best in kept)
    for best in kept:
        assert not any(np.all(point < best) for point in points)


def test_a_front_beside_itself_and_beside_one_of_twice_the_error(modules: dict[str, Any]) -> None:
    beside = modules["pareto_front"].beside
    travel = np.geomspace(0.1, 10.0, 9)
    ours, theirs = np.stack([1.0 / travel, travel], 1), np.stack([2.0 / travel, travel], 1)
    assert beside(ours, ours) == pytest.approx((1.0, 1.0, 1.0))
    assert beside(ours, theirs) == pytest.approx((0.5, 0.5, 0.5))
    # a front that ends before the other begins keeps its best
    assert beside(ours[:1], theirs[-1:]).rms == pytest.approx(ours[0, 0] / theirs[-1, 0])


def peer_after(modules: dict[str, Any], peer: Any, headings: Any) -> Any:
    """The peer's state after headings [rad] at 10 Hz, on course north."""
    module = modules["pareto_peer"]
    mind = module.PeerState(0.0, 0.0, PidMemory(0.0, math.nan), Rest(0.0, 0.0, False))
    for heading in headings:
        mind = module.peer_tick(peer, LIMITS, mind, 0.1, heading, 0.0)
    return mind


def test_the_peers_derivative_is_filtered_and_its_bands_keep_the_rudder_still(modules: dict[str, Any]) -> None:
    peer = modules["pareto_peer"].Peer(PidGains(1.0, 0.1, 2.0), 0.3, 0.7, 0.0, 0.0)
    ramp = peer_after(modules, peer, 0.002 * np.arange(100))
    assert ramp.rate == pytest.approx(0.02, rel=1.0e-3)
    assert 0.1 * 0.02 < 0.198 - ramp.heading < 5.0 * 0.02
    assert ramp.rest.command < 0.0, "a boat that turns to starboard is met with port rudder"
    jump = peer_after(modules, peer, [0.0, 0.02])
    assert 0.0 < jump.rate < 0.2 * 0.02 / 0.1
    bands = peer._replace(weather=0.03, gains=PidGains(1.0, 0.1, 0.0))
    assert peer_after(modules, bands, [0.02] * 50).rest.command == 0.0
    assert peer_after(modules, bands, [0.2] * 50).rest.command < -0.15
    assert peer_after(modules, peer._replace(dead_band=0.2), [0.02] * 5).rest.command == 0.0


def test_a_small_study_holds_the_course_better_than_nobody(modules: dict[str, Any], tmp_path: Path) -> None:
    study = modules["pareto_study"]
    training, held_out = study.training_runs("lanxin15", 100), study.held_out_runs("lanxin15", 7000, 1)
    assert len(training) == len(held_out) == 60
    assert {run[:4] for run in training} == {run[:4] for run in held_out}
    assert {run.mismatch for run in held_out} == {"K", "0.7 K", "1.4 K"}
    noises = [run.setting.instruments.deviates[:50, 0] for run in (training[0], held_out[0])]
    assert not np.allclose(*noises), "held-out seeds are others"
    blown = [run for run in held_out if run.sea == "breeze" and run.side == 60.0]
    ours, theirs = study.Ours("lanxin15", plain=True), study.Theirs("lanxin15", plain=True)
    nobody = [study._point(study.run_peer(run.setting, run.workspace, idle(modules)), run.setting) for run in blown]
    for helmsman in (ours, theirs):
        found = helmsman.sailed(helmsman.starts[0], blown)
        assert np.all(found[:, 0] < 0.5 * np.array(nobody)[:, 0])
        assert np.all(found[:, 1] > 0.0)
    cases = modules["pareto"].study("lanxin15", 2, 1, lambda: None, is_quick=True, is_plain=True, out=tmp_path)
    again = modules["pareto"].study("lanxin15", 2, 1, pytest.fail, is_quick=True, is_plain=True, out=tmp_path)
    for before, after in zip(cases, again, strict=True):
        assert before.case == after.case
        assert np.allclose(before.ours, after.ours, atol=1.0e-5)
        assert np.allclose(before.theirs, after.theirs, atol=1.0e-5)
    assert {case.case.tuned for case in cases} == {"all", *study.SEAS}
    for case in cases:
        assert case.is_held
        assert case.beside.rms > 0.0
        assert case.beside.worst_rms >= case.beside.rms
    printed = modules["pareto"].table(cases)
    assert printed.count("lanxin15") == 8
    assert "nan" not in printed.splitlines()[-1]


def test_full_knowledge_is_a_yardstick_for_a_lost_case(modules: dict[str, Any]) -> None:
    lost, study = modules["pareto_lost"], modules["pareto_study"]
    case = modules["pareto"].Case("lanxin15", "breeze", 60.0, "1.4 K", "")
    (_, fine), (_, coarse) = (lost.linear_in(case, compass) for compass in study.COMPASSES)
    for points in (fine, coarse):
        assert all(after.rms_deg >= before.rms_deg * 0.999 for before, after in itertools.pairwise(points))
        assert all(after.travel_deg_s <= before.travel_deg_s for before, after in itertools.pairwise(points))
    assert min(coarse).rms_deg > 1.2 * min(fine).rms_deg, "a worse compass, a worse course"
    run = next(run for run in lost.runs_in(case, "0.2 deg", 7000, 1))
    assert (run.sea, run.side, run.mismatch, run.compass) == ("breeze", 60.0, "1.4 K", "0.2 deg")
    knowing = lost.lqg_front(case, "0.2 deg", 1, is_plain=True)
    # a linear boat on a straight course: what is sailed is near what was worked out
    assert knowing[0, 0] == pytest.approx(fine[0].rms_deg, rel=0.5)
    assert knowing[:, 1] == pytest.approx([point.travel_deg_s for point in fine[::2]], rel=0.6, abs=0.02)
    sailed = study.Theirs("lanxin15", plain=True).sailed(study.Theirs("lanxin15").starts[0], [run])
    one = modules["pareto"].compared_by(case, sailed[None], 2.0 * sailed[None])
    at = lost.beside_lqg(one, knowing)
    assert at.lqg < at.ours < at.theirs
    row = lost.table([one], {case: one}, {case: knowing}).splitlines()[-1]
    assert row.split()[:5] == ["each", "sea", "lanxin15", "breeze", "60"]


def idle(modules: dict[str, Any]) -> Any:
    """A PID without gains."""
    return modules["pareto_peer"].Peer(PidGains(0.0, 0.0, 0.0), 0.0, 0.0, 0.0, 0.0)
