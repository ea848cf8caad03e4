"""What a command loads: little, because a pilot that has died must steer again within two seconds."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from autopilot.cli.main import SUBCOMMANDS, build_parser

PROBE = """
import sys
sys.argv = ["autopilot", *sys.argv[1:]]
from autopilot.cli.main import main
try:
    main()
except SystemExit:
    pass
print(*(name for name in sys.modules if "." not in name or name.startswith("autopilot")), sep="\\n", file=sys.stderr)
"""
SUMS = """
import contextlib, os
from autopilot.cli.main import main
with contextlib.suppress(SystemExit):
    main(["--help"])
import numpy
numpy.ones((400, 400)) @ numpy.ones((400, 400))
print(len(os.listdir("/proc/self/task")))
"""
PLOT_AND_PAGE = {"matplotlib", "jinja2", "starlette", "uvicorn"}
ENGINES_AND_READERS = {"numba", "distributed", "can", "pyulog", "mcap", "pyarrow", "ruamel"}
OTHER_LINKS = ("links.n2k.link", "links.nmea.link", "links.drives.maestro", "links.ground_station.boat_link")
NOT_ASKED_FOR = (*OTHER_LINKS, "links.mavlink.router", "runtime.record", "runtime.tuning")
"""What speaks other protocols than the links given, serves ground stations, learns or keeps a log."""
HEAVY = {"numpy", "scipy", *PLOT_AND_PAGE, *ENGINES_AND_READERS}


def modules_of(*arguments: str) -> set[str]:
    done = subprocess.run(
        [sys.executable, "-c", PROBE, *arguments], capture_output=True, text=True, timeout=60, check=True
    )
    return set(done.stderr.splitlines()[-400:])


def test_help_loads_no_command() -> None:
    loaded = modules_of("--help")
    assert "autopilot.cli.main" in loaded
    assert not {name for name in loaded if name.startswith("autopilot.cli.")} - {
        "autopilot.cli.main",
        "autopilot.cli.options",
    }
    assert not loaded & {*HEAVY, "yaml", "pymavlink", "serial"}
    assert not loaded & {"typing", "shutil", "json", "pathlib", "autopilot.signals"}, "half of a help's time"


def test_steering_loads_neither_numpy_nor_what_is_heavier() -> None:
    # refused at the link, after vessel, pilot and all that belongs to them
    loaded = modules_of("run", "lanxin", "--link", "udpin:256.0.0.1:1")
    assert {"autopilot.pilot", "autopilot.runtime.session", "pymavlink"} <= loaded
    assert not loaded & HEAVY
    assert not loaded & {f"autopilot.{name}" for name in NOT_ASKED_FOR}


def test_identifying_loads_neither_statistics_nor_filters_that_take_as_long_as_a_fit() -> None:
    rooms = "autopilot.cli.identify_drive_roll, autopilot.identification.registry, autopilot.identification.methods"
    probe = f"import sys, {rooms}\nprint(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", probe], capture_output=True, text=True, timeout=60, check=True)
    assert not {"scipy.signal", "scipy.stats"} & set(done.stdout.split())


def test_the_demo_explains_itself_before_it_loads_what_it_sails_and_identifies_with() -> None:
    assert not modules_of("demo", "--help") & HEAVY


@pytest.mark.parametrize("command", SUBCOMMANDS)
def test_the_help_of_all_says_what_the_commands_own_parser_says(command: str) -> None:
    def said(parser_arguments: list[str]) -> str:
        text = build_parser(parser_arguments).format_help()
        return " ".join(text[text.index("COMMAND") :].split())

    assert said([command]) == said(["--help"])


@pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="counts threads as Linux lists them")
@pytest.mark.skipif((os.cpu_count() or 1) < 2, reason="with one core there is one thread anyway")
def test_sums_are_made_by_one_thread_unless_somebody_asks_for_more() -> None:
    def threads(**asked: str) -> int:
        others = {name: value for name, value in os.environ.items() if name != "OPENBLAS_NUM_THREADS"}
        done = subprocess.run(
            [sys.executable, "-c", SUMS],
            capture_output=True,
            text=True,
            timeout=60,
            check=True,
            env={**others, **asked},
        )
        return int(done.stdout.split()[-1])

    assert threads() == 1
    assert threads(OPENBLAS_NUM_THREADS="2") == 2
