"""What a command loads: little, because a pilot that has died must steer again within two seconds."""

from __future__ import annotations

import subprocess
import sys

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
PLOT_AND_PAGE = {"matplotlib", "jinja2", "starlette", "uvicorn"}
ENGINES_AND_READERS = {"numba", "ray", "distributed", "can", "pyulog", "mcap", "pyarrow", "ruamel"}
HEAVY = {"numpy", "scipy", *PLOT_AND_PAGE, *ENGINES_AND_READERS}


def modules_of(*arguments: str) -> set[str]:
    done = subprocess.run(
        [sys.executable, "-c", PROBE, *arguments], capture_output=True, text=True, timeout=60, check=True
    )
    return set(done.stderr.splitlines()[-400:])


def test_help_loads_no_command() -> None:
    loaded = modules_of("--help")
    assert "autopilot.cli.main" in loaded
    assert not {name for name in loaded if name.startswith("autopilot.cli.")} - {"autopilot.cli.main"}
    assert not loaded & {*HEAVY, "yaml", "pymavlink", "serial"}


def test_steering_loads_neither_numpy_nor_what_is_heavier() -> None:
    # refused at the link, after vessel, pilot and all that belongs to them
    loaded = modules_of("run", "lanxin", "--link", "udpin:256.0.0.1:1")
    assert {"autopilot.pilot", "autopilot.loop.session", "pymavlink"} <= loaded
    assert not loaded & HEAVY


@pytest.mark.parametrize("command", SUBCOMMANDS)
def test_the_help_of_all_says_what_the_commands_own_parser_says(command: str) -> None:
    def said(parser_arguments: list[str]) -> str:
        text = build_parser(parser_arguments).format_help()
        return " ".join(text[text.index("COMMAND") :].split())

    assert said([command]) == said(["--help"])
