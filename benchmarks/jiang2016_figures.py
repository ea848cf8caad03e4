"""Paper 1's figures 3 to 7 drawn anew from this product's own numbers, beside what the paper prints; one picture.

    python benchmarks/jiang2016_figures.py --out docs/images/jiang2016.png

Figure 2 shows a convergence on a zigzag of which six rows are printed, so that it cannot be drawn again.
Source: Jiang et al. 2016, table 2 and figures 3 to 7; runs and rudders of `jiang2016_heading_control.py`.
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import Any

import numpy as np
from jiang2016_heading_control import (
    KNOT,
    PLANT_HZ,
    SEED,
    TABLE_2_DEG,
    Trial,
    curves,
    sea_of,
    sine,
)

from autopilot.control.backstepping import BacksteppingGains
from autopilot.control.pid import PidGains
from autopilot.models.norrbin import Norrbin, rate_step, steady_rudder
from autopilot.models.steering_gear import SteeringGear
from autopilot.runtime.build import gear_of, model_of
from autopilot.vessel.file import load_vessel

SHOWN_S = 120.0
EVERY = PLANT_HZ // 10


def turning_circle(model: Norrbin, rudder_deg: float, speed_kn: float) -> tuple[list[float], list[float]]:
    """Return north and east [m] of a turn from rest in yaw, the speed held."""
    rudder, speed, dt = math.radians(rudder_deg), speed_kn * KNOT, 0.05
    north, east, heading, rate = [0.0], [0.0], 0.0, 0.0
    for _ in range(round(110.0 / dt)):
        before, rate = rate, rate_step(model, rate, rudder, dt)
        heading += 0.5 * dt * (before + rate)
        north.append(north[-1] + speed * dt * math.cos(heading))
        east.append(east[-1] + speed * dt * math.sin(heading))
    return north, east


def drawn(model: Norrbin, gear: SteeringGear) -> Any:
    """Return the figure."""
    import matplotlib as mpl

    mpl.use("agg")
    from matplotlib import pyplot

    with mpl.rc_context({"font.size": 8}):
        figure, axes = pyplot.subplots(5, 1, figsize=(8.0, 12.0), layout="constrained")
        _steady_turns(axes[0], model)
        _circle(axes[1], model)
        sea = sea_of(SEED)
        axes[2].plot(np.arange(len(sea))[::EVERY] / PLANT_HZ, np.degrees(sea[::EVERY]), color="#444444", linewidth=0.8)
        axes[2].set(title="figure 5: the sea of eq. (31) as a rudder angle", xlim=(0.0, SHOWN_S), ylabel="deg")
        _curves(axes[3], axes[4], model, gear, sea)
    return figure


def _steady_turns(axis: Any, model: Norrbin) -> None:
    rudder, rate = np.array(TABLE_2_DEG, dtype=float).T
    fine = np.linspace(0.0, 19.0, 96)
    fitted = [math.degrees(steady_rudder(model, math.radians(value))) for value in fine]
    axis.plot(fitted, fine, color="#0b5fa5", label="K 0.701 1/s, n3 0.001 (s/deg)^2")
    axis.plot(rudder, rate, "o", color="#c8501e", label="table 2")
    axis.set(title="figure 3: steady turns", xlabel="rudder [deg]", ylabel="yaw rate [deg/s]")
    axis.legend()


def _circle(axis: Any, model: Norrbin) -> None:
    north, east = turning_circle(model, 4.9, 9.65)
    axis.plot(east, north, color="#0b5fa5", label="model, 9.65 kn, 4.9 deg")
    angle = np.linspace(0.0, 2.0 * math.pi, 200)
    middle = 0.5 * (max(east) + min(east)), 0.5 * (max(north) + min(north))
    axis.plot(
        middle[0] + 84.97 * np.cos(angle),
        middle[1] + 84.97 * np.sin(angle),
        "--",
        color="#c8501e",
        label="a circle of the boat's 84.97 m",
    )
    axis.set(title="figure 4: the turn", xlabel="east [m]", ylabel="north [m]", aspect="equal")
    axis.legend(loc="center")


def _curves(headings: Any, rudders: Any, model: Norrbin, gear: SteeringGear, sea: list[float]) -> None:
    ideal = SteeringGear(gear.angle_max, math.inf)
    pid, paper, calm = PidGains(40.0, 0.0, 0.1), BacksteppingGains(35.0, 15.0), BacksteppingGains(2.0, 2.0)
    rows = (
        (Trial("paper's PID, ideal rudder", "pid", pid, 200, ""), ideal, "#c8501e"),
        (Trial("paper's k1 35, k2 15, ideal rudder", "backstepping", paper, 200, ""), ideal, "#2a8a3a"),
        (Trial("k1 2, k2 2, rudder of 20 deg/s, lag, delay", "backstepping", calm, 20, ""), gear, "#0b5fa5"),
    )
    time = np.arange(len(sea))[::EVERY] / PLANT_HZ
    wanted = np.degrees([sine(now).heading for now in time])
    for trial, steered_by, colour in rows:
        heading, rudder = (np.degrees(values)[::EVERY] for values in curves(trial, model, steered_by, sea))
        headings.plot(time, heading - wanted, color=colour, linewidth=0.8, label=trial.name)
        rudders.plot(time, rudder, color=colour, linewidth=0.8, label=trial.name)
    headings.set(title="figure 6: heading less the sine of 30 deg, 60 s, in that sea", xlim=(60.0, 180.0), ylabel="deg")
    headings.set_ylim(-0.4, 0.4)
    rudders.set(title="figure 7: the rudder that does it", xlabel="s", xlim=(60.0, 180.0), ylabel="deg")
    headings.legend()
    rudders.legend()


def main() -> None:
    """Draw."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("jiang2016.png"))
    asked = parser.parse_args()
    vessel = load_vessel("lanxin")
    drawn(model_of(vessel), gear_of(vessel)).savefig(asked.out, dpi=80)


if __name__ == "__main__":
    main()
