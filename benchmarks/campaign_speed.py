"""Boat-steps a second of the whole closed loop on one core: compiled, the same plain, and the full simulator.

    python benchmarks/campaign_speed.py [--seconds 300] [--repeats 15] [--json]

A boat-step is one step of 10 ms of boat and steering gear; with it go sensors, estimator, law and limits at 10 Hz and
sea and wind at 20 Hz. Timed is the CPU time of the process, the best of the repeats, with the drawing of the run's
random numbers and without. The plain loops sail the first part of the same runs.
"""

from __future__ import annotations

import argparse
import json
import math
import time
from collections.abc import Callable
from typing import Any

from autopilot.control.design import DESIGNED
from sitl.campaign.compiled_run import run_compiled
from sitl.campaign.setting import run_reference, setting_of, workspace_of
from sitl.campaign.study import BoatSection, Job, SeaSection, Study
from sitl.campaign.work import compiled_loop, done_compiled
from sitl.scenario import IttcSection, SecondOrderSection, WavesSection, WindSection
from sitl.world import STEP

PLAIN_S, PLAIN_REPEATS = 20.0, 6
SEAS = {
    "calm": SeaSection(),
    "swell (shaping filter)": SeaSection(WavesSection(second_order=SecondOrderSection(0.6, 0.3, 1.0))),
    "wind and gusts": SeaSection(wind=WindSection(7.0, gust_m_s=1.0)),
    "60 waves, wind, gusts": SeaSection(WavesSection(ittc=IttcSection(0.88, 7.5)), WindSection(7.0, gust_m_s=1.0)),
}


def study_in(sea: str, seconds: float) -> Job:
    """Return a study of one run in this sea."""
    asked = Study(
        1, sea, {"lanxin": BoatSection("lanxin")}, runs=1, seconds=seconds, measured_from_s=1.0, seas={sea: SEAS[sea]}
    )
    return Job(asked, ".")


def best(function: Callable[[], Any], repeats: int) -> float:
    """Return the least CPU time [s] of a call."""
    least = math.inf
    for _ in range(repeats):
        begun = time.process_time()
        function()
        least = min(least, time.process_time() - begun)
    return least


def measured(sea: str, seconds: float, repeats: int) -> dict[str, float]:
    """Return steps a second: compiled loop alone, whole compiled run, the same loop plain, full simulator."""
    quick = compiled_loop(DESIGNED)
    assert quick is not None
    job, short = study_in(sea, seconds), study_in(sea, PLAIN_S)
    setting, part = setting_of(job, 0), setting_of(short, 0)
    assert setting is not None
    assert part is not None
    steps, few = seconds / STEP, PLAIN_S / STEP
    quick(setting, workspace_of(setting))
    return {
        "loop": steps / best(lambda: quick(setting, workspace_of(setting)), repeats),
        "run": steps / best(lambda: done_compiled(job, 0), repeats),
        "plain": few / best(lambda: run_compiled(part, workspace_of(part, plain=True)), PLAIN_REPEATS),
        "full": few / best(lambda: run_reference(short, 0), PLAIN_REPEATS),
    }


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seconds", type=float, default=300.0)
    parser.add_argument("--repeats", type=int, default=15)
    parser.add_argument("--json", action="store_true")
    asked = parser.parse_args()
    found = {sea: measured(sea, asked.seconds, asked.repeats) for sea in SEAS}
    if asked.json:
        print(json.dumps(found))
        return
    print("                          million boat-steps a second          times as quick as")
    print("                          loop   whole run   plain   full      plain loop   full simulator")
    for sea, row in found.items():
        loop, run, plain, full = (row[name] for name in ("loop", "run", "plain", "full"))
        print(
            f"{sea:24s}{loop / 1e6:6.2f}{run / 1e6:10.2f}{plain / 1e6:10.4f}{full / 1e6:8.4f}"
            f"{loop / plain:13.0f}{loop / full:14.0f}"
        )


if __name__ == "__main__":
    main()
