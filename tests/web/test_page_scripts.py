"""Every script of the page is one that a JavaScript engine reads: one mistake leaves all displays blank."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from pathlib import Path

import pytest

import autopilot.web

PAGE = Path(autopilot.web.__file__).parent / "page"


@pytest.mark.skipif(shutil.which("node") is None, reason="needs Node.js")
@pytest.mark.parametrize("script", sorted(PAGE.glob("*.js")), ids=lambda script: script.name)
def test_the_script_is_read_as_a_module(script: Path) -> None:
    done = subprocess.run(
        ["node", "--check", "--input-type=module"], input=script.read_bytes(), capture_output=True, check=False
    )
    assert done.returncode == 0, done.stderr.decode()


@pytest.mark.skipif(shutil.which("node") is None, reason="needs Node.js")
def test_what_lies_across_the_date_line_is_near_on_the_chart() -> None:
    script = f"""
        import {{ seen }} from "{(PAGE / "chart.js").as_uri()}";
        console.log(JSON.stringify([seen([0, -179.999], [0, 179.999]), seen([0, 11.999], [0, 12])]));
        process.exit(0);
    """
    done = subprocess.run(
        ["node", "--input-type=module", "-e", script], capture_output=True, text=True, timeout=60, check=True
    )
    (across, north), (back, _) = json.loads(done.stdout)
    assert (across, north, back) == (pytest.approx(222.39), 0.0, pytest.approx(-111.195))


def test_the_colours_of_alarms_are_for_alarms_alone() -> None:
    """Red, orange and yellow stand for a priority on a bridge (IEC 62923): no button and no field borrows them."""
    style = re.sub(r"/\*.*?\*/", "", (PAGE / "style.css").read_text(), flags=re.DOTALL)
    used = [
        rule
        for rule, body in re.findall(r"([^{}]+)\{([^{}]*)\}", style)
        if re.search(r"var\(--(danger|warn|cau)", body)
    ]
    assert len(used) > 5
    for rule in used:
        for selector in rule.split(","):
            assert re.match(r"\s*(#bar|#stale|#overboard|\.tag|#alarm-count|\.mode\[data-state=.bad)", selector), (
                selector
            )
