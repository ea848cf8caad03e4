"""A campaign's runs are those of the full simulator, whoever does them."""

from __future__ import annotations

import csv
import json
import multiprocessing
import os
import signal
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from autopilot.angles import wrap
from autopilot.control import registry
from autopilot.control.law import Law, LawInput, LoopGains
from autopilot.errors import ExitCode, InputError
from autopilot.files.strict_yaml import parse_document
from autopilot.supervision.rudder_answer import Evidence, evidence_step
from autopilot.vessel.file import dump_vessel, load_vessel
from autopilot.vessel.schema import Limits
from sitl.campaign import study, work
from sitl.campaign.compiled_run import Figures, figures, run_compiled
from sitl.campaign.results import COLUMNS
from sitl.campaign.setting import measured_every, run_reference, setting_of, workspace_of
from sitl.campaign.study import (
    BoatSection,
    Job,
    LawName,
    MismatchSection,
    SeaSection,
    Study,
    TurnSection,
    case_and_seed,
    cases_of,
    load_study,
    number_of_runs,
    study_from,
)
from sitl.campaign.work import Row, batches_of, do_runs, done_compiled, end_with_parent, in_order, local
from sitl.cli import main
from sitl.registry import FaultKind
from sitl.scenario import FaultSection, IttcSection, SecondOrderSection, SensorsSection, WavesSection, WindSection
from sitl.world import STEP

SEAS = {
    "calm": SeaSection(),
    "swell": SeaSection(WavesSection(second_order=SecondOrderSection(0.6, 0.3, 1.0))),
    "sea": SeaSection(WavesSection(ittc=IttcSection(0.88, 7.5)), WindSection(7.0, gust_m_s=1.0)),
}
STUDY = Study(
    1,
    "short",
    {"boat": BoatSection("lanxin")},
    runs=2,
    seconds=12.0,
    measured_from_s=2.0,
    gain_factors=(0.5,),
    turn=TurnSection(40.0, 3.0),
    mismatches={"more": MismatchSection(1.3, 0.9, 0.01)},
)


def faulty(*faults: tuple[FaultKind, float, float, float]) -> Study:
    """The study with faults: kind, from, to, size."""
    return replace(STUDY, faults={"some": tuple(FaultSection(*fault) for fault in faults)})


STUDIES = {
    "backstepping": replace(STUDY, seas={"sea": SEAS["sea"]}),
    "pid": replace(STUDY, laws=("pid",), seas={"swell": SEAS["swell"]}, speed_shares=(0.6,)),
    "sliding": replace(STUDY, laws=("sliding",), heading_hz=20),
    "late, coarse compass": replace(STUDY, instruments={"late": SensorsSection(latency_s=0.25, heading_step_deg=0.1)}),
    "two thrusters": replace(STUDY, boats={"boat": BoatSection("twin_thruster")}, gain_factors=(1.0,)),
    "compass alone": replace(STUDY, gyro=False, seas={"sea": SEAS["sea"]}),
}


@pytest.fixture(params=STUDIES)
def job(request: pytest.FixtureRequest) -> Job:
    return Job(STUDIES[request.param], ".")


def sailed_alike(job: Job, run: int) -> Figures:
    """Sail a run by the loop as it is compiled and by the full simulator: both must give these figures."""
    setting = setting_of(job, run)
    assert setting is not None
    score, is_whole = run_compiled(setting, workspace_of(setting, plain=True))
    assert is_whole
    full = run_reference(job, run)
    assert figures(score, measured_every(job.study) * STEP, 1.0) == pytest.approx(full, rel=0.0, abs=1.0e-9)
    return full


def test_the_loop_as_it_is_compiled_gives_the_full_simulators_numbers(job: Job) -> None:
    assert sailed_alike(job, 1).travel_deg_s > 0.5


class ToyGains(NamedTuple):
    heading: float
    rate: float


def toy_step(gains: ToyGains, turned: float, given: LawInput) -> tuple[float, float]:
    """A law that remembers: half of what it asks for now, half of what it asked for before."""
    state, reference = given.state, given.reference
    asked = -gains.heading * wrap(state.heading - reference.heading) - gains.rate * (state.rate - reference.rate)
    return 0.5 * (asked + turned) - state.bias, asked


def test_a_law_that_is_registered_is_sailed_alike(monkeypatch: pytest.MonkeyPatch) -> None:
    toy = Law(
        "toy",
        "Toy",
        "TOY",
        None,
        ToyGains,
        lambda section, boat: ToyGains(2.4, 0.5),
        toy_step,
        lambda gains, model: LoopGains(gains.heading, 0.0, gains.rate),
        first=lambda gains, rudder: rudder,
    )
    monkeypatch.setattr(registry, "LAWS", {**registry.LAWS})
    monkeypatch.setattr(registry, "_STEPS", {**registry._STEPS})
    registry.register(toy)
    monkeypatch.setattr("autopilot.runtime.build.LAWS", registry.LAWS)
    found = sailed_alike(Job(replace(STUDY, laws=("toy",)), "."), 1)
    assert found.travel_deg_s > 0.5 and found.settled_s < 9.0


def test_a_spared_rudder_gives_the_full_simulators_numbers_too(tmp_path: Path) -> None:
    vessel = load_vessel("lanxin")
    gains = replace(vessel.control.backstepping, smoothing_s=0.3) if vessel.control.backstepping else None
    spared = replace(vessel, control=replace(vessel.control, backstepping=gains), limits=Limits(dead_band_deg=0.3))
    (tmp_path / "spared.yaml").write_text(dump_vessel(spared))
    asked = replace(STUDY, seas={"sea": SEAS["sea"]}, boats={"boat": BoatSection("spared.yaml")}, speed_shares=(0.8,))
    job = Job(asked, str(tmp_path))
    full = sailed_alike(job, 0)
    rough = replace(asked, boats={"boat": BoatSection("lanxin")})
    assert full.travel_deg_s < run_reference(Job(rough, "."), 0).travel_deg_s


def test_waves_that_are_met_give_the_full_simulators_numbers_too(tmp_path: Path) -> None:
    vessel, law = load_vessel("lanxin"), "backstepping"
    gains = replace(vessel.control.backstepping, course_rad_s=1.5) if vessel.control.backstepping else None
    control = replace(vessel.control, backstepping=gains)
    (tmp_path / "meeting.yaml").write_text(dump_vessel(replace(vessel, control=control)))
    # waves are met when they have been watched for some seconds
    asked = replace(STUDY, laws=(law,), seas={"swell": SEAS["swell"]}, seconds=24.0)
    asked = replace(asked, boats={"boat": BoatSection("meeting.yaml")})
    full = sailed_alike(Job(asked, str(tmp_path)), 0)
    alone = replace(asked, boats={"boat": BoatSection("lanxin")})
    assert full.travel_deg_s != pytest.approx(run_reference(Job(alone, "."), 0).travel_deg_s, rel=0.02)


@pytest.mark.parametrize("law", ["backstepping", "pid"])
def test_a_dead_band_gives_the_full_simulators_numbers_too(tmp_path: Path, law: LawName) -> None:
    vessel = load_vessel("lanxin")
    (tmp_path / "resting.yaml").write_text(dump_vessel(replace(vessel, limits=Limits(dead_band_deg=0.7))))
    asked = replace(STUDY, laws=(law,), seas={"sea": SEAS["sea"]}, boats={"boat": BoatSection("resting.yaml")})
    job = Job(asked, str(tmp_path))
    sailed_alike(job, 0)


def test_a_preset_radius_gives_the_full_simulators_numbers_too(tmp_path: Path) -> None:
    vessel = load_vessel("lanxin")
    preset = replace(vessel, guidance=replace(vessel.guidance, turn_radius_m=60.0))
    (tmp_path / "preset.yaml").write_text(dump_vessel(preset))
    turning = replace(STUDY, speed_shares=(0.7,), gain_factors=(1.0,))
    job = Job(replace(turning, boats={"boat": BoatSection("preset.yaml")}), str(tmp_path))
    full = sailed_alike(job, 0)
    assert full.travel_deg_s < 0.8 * run_reference(Job(turning, "."), 0).travel_deg_s, "a wide turn takes little rudder"


def test_compiled_it_gives_the_full_simulators_numbers(job: Job) -> None:
    pytest.importorskip("numba", reason="the extra `fast` is not installed")
    quick = done_compiled(job, 0)
    assert quick is not None
    # a loop near its margin, as with the late compass, carries the last digits on
    assert quick == pytest.approx(run_reference(job, 0), rel=1.0e-9, abs=1.0e-9)


def lively(times: float) -> Job:
    """A minute in a sea with a boat that answers its rudder so many times as much as its file says."""
    mismatches = {"lively": MismatchSection(times, 0.5, 0.01)}
    return Job(replace(STUDY, seconds=60.0, seas={"sea": SEAS["sea"]}, mismatches=mismatches, gain_factors=(1.0,)), ".")


def test_another_boat_that_is_found_out_is_left_to_the_full_simulator() -> None:
    """The pilot lets go of a boat that turns twelve times as well as its file; of one that is half as lively again it
    notices nothing."""
    job = lively(12.0)
    setting = setting_of(job, 0)
    assert setting is not None
    assert not run_compiled(setting, workspace_of(setting))[1] and run_reference(job, 0).engaged < 1.0
    assert sailed_alike(lively(1.5), 0).engaged == 1.0


def test_the_evidence_of_the_loop_as_it_is_compiled_is_the_monitors(monkeypatch: pytest.MonkeyPatch) -> None:
    job, kept = lively(1.5), list[Evidence]()

    def keeping(*given: Any) -> Evidence:
        kept.append(evidence_step(*given))
        return kept[-1]

    monkeypatch.setattr("sitl.campaign.compiled_tick.evidence_step", keeping)
    sailed_alike(job, 0)
    loop, kept = kept, []
    monkeypatch.setattr("autopilot.supervision.rudder_answer.evidence_step", keeping)
    run_reference(job, 0)
    assert len(loop) == len(kept) > 500
    for one, other in zip(loop, kept, strict=True):
        assert numbers_of(one) == pytest.approx(numbers_of(other), rel=1.0e-6, abs=1.0e-9, nan_ok=True)
    assert max(each.response.stuck for each in loop) > 0.0


def numbers_of(value: Any) -> list[float]:
    """All numbers of a nested record, one after the other."""
    return [number for each in value for number in numbers_of(each)] if isinstance(value, tuple) else [float(value)]


@pytest.mark.parametrize("times", [1.5, 12.0])
def test_compiled_it_is_found_out_at_the_same_tick(times: float) -> None:
    pytest.importorskip("numba", reason="the extra `fast` is not installed")
    job = lively(times)
    setting, quick = setting_of(job, 0), work.compiled_loop("backstepping")
    assert setting is not None and quick is not None
    plain, compiled = run_compiled(setting, workspace_of(setting)), quick(setting, workspace_of(setting))
    assert compiled[1] is plain[1] is (times < 2.0)
    assert tuple(compiled[0]) == pytest.approx(tuple(plain[0]), rel=1.0e-9, abs=1.0e-9)


@pytest.mark.parametrize(
    "instruments",
    [
        SensorsSection(heading_step_deg=10.0, heading_noise_deg=0.0),
        SensorsSection(heading_noise_deg=20.0),
        SensorsSection(rate_noise_deg_s=30.0),
        SensorsSection(latency_s=1.5),
    ],
    ids=["frozen", "jumps", "rate apart", "late"],
)
def test_what_is_more_than_steering_is_left_to_the_full_simulator(instruments: SensorsSection) -> None:
    setting = setting_of(Job(replace(STUDY, instruments={"poor": instruments}), "."), 0)
    assert setting is not None
    assert not run_compiled(setting, workspace_of(setting, plain=True))[1]


@pytest.mark.parametrize("kind", ["heading_dropout", "heading_frozen", "rudder_stuck", "speed_lost"])
def test_faults_are_left_to_the_full_simulator(kind: FaultKind) -> None:
    assert setting_of(Job(faulty((kind, 5.0, 8.0, 1.0)), "."), 0) is None


def test_a_lost_compass_ends_the_engagement_in_the_results() -> None:
    job = Job(faulty(("heading_dropout", 5.0, 12.0, 1.0)), ".")
    (row,) = do_runs(job, 0, 1, is_compiled=False)
    assert row.done_by == "full"
    assert 0.4 < row.figures.engaged < 0.6


def test_every_combination_is_a_case_and_cases_share_seeds() -> None:
    job = Job(replace(STUDY, laws=("pid", "sliding"), seas=SEAS, sides_deg=(45.0, 90.0)), ".")
    # the calm has one side
    assert len(set(cases_of(job))) == len(cases_of(job)) == 2 * (1 + 2 + 2)
    assert number_of_runs(job) == 20
    assert [case_and_seed(job, run)[1] for run in range(4)] == [1, 2, 1, 2]
    assert case_and_seed(job, 19)[0].law == "sliding"


def test_batches_cover_the_runs_once_and_come_in_order() -> None:
    batches = batches_of(Job(STUDY, "."), 10_001)
    assert [first for first, _ in batches[1:]] == [last for _, last in batches[:-1]]
    rows = [[Row(run, 0, "", work.UNKNOWN) for run in range(*batch)] for batch in batches]
    assert [one.run for batch in in_order(reversed(rows)) for one in batch] == list(range(10_001))


def test_gains_without_margins_are_refused_not_sailed() -> None:
    (row,) = do_runs(Job(replace(STUDY, gain_factors=(20.0,)), "."), 0, 1)
    assert row.done_by == "refused"
    assert row.figures.travel_deg_s != row.figures.travel_deg_s


def kill_once(job: Job, first: int, last: int, is_compiled: bool) -> list[Row]:
    """A worker that dies at its second batch, the first time."""
    mark = Path(os.environ["NORRBIN_TEST_MARK"])
    if first == 1 and not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return [Row(run, run, "full", Figures(*[float(run)] * len(Figures._fields))) for run in range(first, last)]


def test_the_runs_of_a_lost_worker_are_done_again(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("NORRBIN_TEST_MARK", str(tmp_path / "mark"))
    monkeypatch.setattr("sitl.campaign.work.do_runs", kill_once)
    batches = [(run, run + 1) for run in range(9)]
    rows = [row.run for batch in in_order(local(Job(STUDY, "."), batches, 2, False)) for row in batch]
    assert (tmp_path / "mark").exists()
    assert rows == list(range(9))


@pytest.mark.skipif(sys.platform != "linux", reason="processes learn of their parent's end on Linux alone")
def test_a_worker_whose_study_ended_before_it_began_ends_too() -> None:
    """Forked a moment before a signal ended the study, it waited for work for ever."""
    worker = multiprocessing.get_context("fork").Process(target=end_with_parent, args=(os.getpid() + 1,))
    worker.start()
    worker.join(60.0)
    assert worker.exitcode == 1
    ours = multiprocessing.get_context("fork").Process(target=end_with_parent, args=(os.getpid(),))
    ours.start()
    ours.join(60.0)
    assert ours.exitcode == 0


@pytest.fixture
def study_file(tmp_path: Path) -> Iterator[Path]:
    path = tmp_path / "study.yaml"
    path.write_text(
        "schema_version: 1\nname: two\nboats: {boat: {vessel: lanxin}}\nruns: 2\nseconds: 4\nmeasured_from_s: 1\n"
        "gain_factors: [0.5, 1]\n"
    )
    return iter([path])


def test_the_command_writes_the_same_results_with_one_worker_and_with_two(
    study_file: Iterator[Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = next(study_file)
    one, two, page = tmp_path / "one.csv", tmp_path / "two.csv", tmp_path / "page.html"
    assert main(["campaign", str(path), "--plain", "--workers", "1", "--out", str(one), "--report", str(page)]) == 0
    assert "2 cases, 4 full, seed 1" in capsys.readouterr().out
    assert main(["campaign", str(path), "--plain", "--workers", "2", "--out", str(two), "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert one.read_text() == two.read_text()
    with one.open() as file:
        rows = list(csv.DictReader(file))
    assert tuple(rows[0]) == COLUMNS
    assert [row["seed"] for row in rows] == ["1", "2", "1", "2"]
    low, high = sorted(float(row["heading_rms_deg"]) for row in rows[:2])
    assert low < printed["cases"][0]["heading_rms_deg"]["median"] < high
    html = page.read_text()
    assert "<svg" in html
    assert "http" not in html.replace("http://www.w3.org", "").replace("http://purl.org", "").replace(
        "http://creativecommons.org", ""
    )


def test_a_run_is_replayed(study_file: Iterator[Path], capsys: pytest.CaptureFixture[str]) -> None:
    path = next(study_file)
    assert main(["campaign", str(path), "--plain", "--replay", "3", "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert (printed["seed"], printed["gain_factor"]) == (2, 1)
    study, folder = load_study(str(path))
    assert printed["heading_rms_deg"] == run_reference(Job(study, folder), 3).heading_rms_deg
    assert main(["campaign", str(path), "--replay", "4"]) == ExitCode.USAGE
    assert "the study has runs 0 to 3" in capsys.readouterr().err


def test_that_a_minute_is_spent_on_compiling_is_said_once_and_into_a_pipe_too(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(work, "compiled_loop", lambda law: None if law == "no numba" else law)
    monkeypatch.setattr(work, "is_kept", lambda loop: loop == "on disk")
    work.announce.cache_clear()
    for law in ("no numba", "on disk", "new", "new"):
        work.announce(law)
    work.announce.cache_clear()
    assert capsys.readouterr() == ("", "compiling, which takes a minute or two; the next campaign finds it on disk\n")


def test_without_numba_it_says_so(
    study_file: Iterator[Path], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "numba", None)
    work.compiled_loop.cache_clear()
    try:
        assert main(["campaign", str(next(study_file)), "--workers", "1", "--runs", "1"]) == 0
    finally:
        work.compiled_loop.cache_clear()
    assert "pip install '.[fast]'" in capsys.readouterr().out


def test_results_in_parquet(study_file: Iterator[Path], tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet", reason="the extra `export` is not installed")
    out = tmp_path / "runs.parquet"
    assert main(["campaign", str(next(study_file)), "--plain", "--workers", "1", "--out", str(out)]) == 0
    found = parquet.read_table(out).to_pydict()
    assert tuple(found) == COLUMNS
    assert found["run"] == [0, 1, 2, 3]
    assert all(value > 0.0 for value in found["travel_deg_s"])


@pytest.mark.parametrize("name", study.STUDIES.names())
def test_shipped_studies_can_be_read(name: str) -> None:
    study, folder = load_study(name)
    assert number_of_runs(Job(study, folder)) > 0


GOOD = "schema_version: 1\nname: x\nboats: {b: {vessel: lanxin}}\n"


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("schema_version: 1\nname: x\n", "the key boats is missing"),
        (GOOD.replace("version: 1", "version: 9"), "of this Norrbin has 1"),
        (GOOD + "law: [pid]\n", "did you mean laws?"),
        (GOOD + "laws: [lqg]\n", "allowed are backstepping, pid, sliding"),
        (GOOD + "laws: [sliding_roll]\n", "laws[0] is the text 'sliding_roll', allowed are backstepping, pid, sliding"),
        (GOOD + "laws: []\n", "laws is empty"),
        (GOOD + "heading_hz: 30\n", "divisors of 100"),
        (GOOD + "seconds: 20\nmeasured_from_s: 20\n", "must be more than measured_from_s"),
        (GOOD + "faults: {f: [{kind: silence, from_s: 9, to_s: 3}]}\n", "must end after from_s"),
        (GOOD + "faults: {f: [{kind: gremlin, from_s: 9, to_s: 3}]}\n", "gremlin"),
        (GOOD + "runs: 0\n", "from 1 to 1e+06"),
        (GOOD + "mismatches: {a: {K: nought}}\n", "K is the text 'nought'"),
    ],
)
def test_mistakes_are_named(text: str, sentence: str) -> None:
    with pytest.raises(InputError, match=r"study\.yaml") as caught:
        study_from(parse_document(text, "study.yaml"))
    assert sentence in str(caught.value)


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["campaign", "frnt"], "did you mean front?"),
        (["campaign", "front", "--out", "runs.txt"], ".csv or .parquet"),
        (["campaign", "front", "--address", "a:1"], "goes with --engine"),
        (["campaign", "front", "--runs", "1000000"], "split the study"),
    ],
)
def test_a_wrong_command_is_reported(arguments: list[str], sentence: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(arguments) == ExitCode.USAGE
    assert sentence in capsys.readouterr().err
