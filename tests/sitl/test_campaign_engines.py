"""Other engines do the same runs with the same results, and again where a worker is lost."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
import warnings
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from autopilot.errors import ExitCode, InputError
from sitl.campaign import work
from sitl.campaign.study import BoatSection, Job, Study
from sitl.campaign.work import Engine, Row, engine_of, in_order
from sitl.cli import main

JOB = Job(replace(Study(1, "short", {"boat": BoatSection("lanxin")}, runs=6), seconds=3.0, measured_from_s=1.0), ".")
BATCHES = [(run, run + 1) for run in range(6)]
LIBRARY = {"dask": "distributed"}
pytestmark = [
    # the library leaves sockets and loops to the garbage collector
    pytest.mark.filterwarnings("ignore"),
]


def test_ctrl_c_while_a_campaign_compiles_leaves_no_trace(tmp_path: Path) -> None:
    pytest.importorskip("numba", reason="the extra `fast` is not installed")
    words = [sys.executable, "-m", "sitl", "campaign", "front", "--runs", "1", "--out", str(tmp_path / "a.csv")]
    with subprocess.Popen(
        words,
        env={**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)},
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    ) as sailed:
        assert sailed.stderr is not None
        assert sailed.stderr.readline().startswith("compiling")
        # both processes are in one group of the terminal; the compiler has its libraries by then, or not yet
        time.sleep(2.0)
        os.killpg(sailed.pid, signal.SIGINT)
        assert "Traceback" not in sailed.stderr.read()
        assert sailed.wait() == 130


@pytest.fixture(params=LIBRARY)
def engine(request: pytest.FixtureRequest) -> Iterator[Engine]:
    pytest.importorskip(LIBRARY[request.param], reason=f"the extra `{request.param}` is not installed")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield engine_of(request.param)


def dying(job: Job, first: int, last: int, is_compiled: bool = True) -> list[Row]:
    """Do the runs; the worker that gets run 2 dies, the first time."""
    mark = Path(job.folder) / "mark"
    if first == 2 and not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return work.do_runs(job, first, last, is_compiled)


def test_two_workers_give_the_local_results_and_a_lost_one_changes_nothing(
    engine: Engine, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    here = [row for batch in engine_of("local")(JOB, BATCHES, 1, False) for row in batch]
    monkeypatch.setattr("sitl.campaign.work.do_runs", dying)
    job = JOB._replace(folder=str(tmp_path))
    there = [row for batch in in_order(engine(job, BATCHES, 2, False)) for row in batch]
    assert (tmp_path / "mark").exists()
    assert there == here


@pytest.mark.parametrize("name", LIBRARY)
def test_an_engine_that_is_not_installed_is_named(
    name: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(__import__("sys").modules, LIBRARY[name], None)
    with pytest.raises(InputError, match=rf"'\.\[{name}\]'"):
        engine_of(name)
    assert main(["campaign", "front", "--engine", name]) == ExitCode.USAGE
    assert f"--engine {name} needs {name}" in capsys.readouterr().err
