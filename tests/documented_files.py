"""Files that the commands of the pages name and a reader has of his own: boats, recordings, logs, all simulated."""

from __future__ import annotations

import math
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
from boat_recordings import dataflash, ulog, zigzag_boat
from lockstep import Lockstep

from autopilot.vessel.file import load_vessel

SHIPPED = Path(__file__).parents[1] / "firmware_params" / "vessels" / "lanxin.yaml"


def furnish(folder: Path, lines: list[str]) -> None:
    """Put the files into `folder` that the lines name."""
    named = " ".join(lines).replace("=", " ").split()
    for name, write in FILES.items():
        if name in named:
            write(folder / name)


def _vessel(path: Path) -> None:
    shutil.copyfile(SHIPPED, path)


def _zigzag(path: Path) -> None:
    boat = zigzag_boat(seconds=90.0, angle=math.radians(20.0 if "2" in path.name else 15.0))
    _table(path, np.stack([boat.time, boat.rudder, boat.heading, boat.rate, boat.speed], axis=1)[::10])


def _turn(path: Path) -> None:
    boat = zigzag_boat(seconds=60.0, angle=math.radians(25.0))
    _table(path, np.stack([boat.time, boat.rudder, boat.heading, boat.rate, boat.speed], axis=1)[::10])


def _table(path: Path, rows: np.ndarray) -> None:
    names = "time_s,rudder_rad,heading_rad,yaw_rate_rad_s,speed_m_s"
    np.savetxt(path, rows, delimiter=",", header=names, comments="", fmt="%.9g")


def _steady_turns(path: Path) -> None:
    rudder = np.arange(5.0, 31.0, 5.0)
    rate = [np.roots([0.001, 0.0, 1.0, -0.701 * each]) for each in rudder]
    turns = [float(each[np.abs(each.imag) < 1e-9].real[0]) for each in rate]
    lines = [f"{angle:g},{turn:.6f}" for angle, turn in zip(rudder, turns, strict=True)]
    path.write_text("\n".join(["rudder_deg,yaw_rate_deg_s", *lines]) + "\n")


def _flash(path: Path) -> None:
    path.write_bytes(dataflash(zigzag_boat(seconds=60.0)))


def _ulog(path: Path) -> None:
    path.write_bytes(ulog(zigzag_boat(seconds=90.0)))


def _study(path: Path) -> None:
    head = "schema_version: 1\nname: mine\nboats: {lanxin: {vessel: lanxin}}\nseas: {calm: {}}\n"
    path.write_text(head + "runs: 4\nseconds: 100\nmeasured_from_s: 50\n")


def _run(path: Path) -> None:
    steps = Lockstep(load_vessel("lanxin"), log=path)
    steps.engage(90.0)
    steps.run(20.0)
    steps.session.close()


FILES: dict[str, Callable[[Path], None]] = {
    "boat.yaml": _vessel,
    "my-boat.yaml": _vessel,
    "zigzag1.csv": _zigzag,
    "zigzag2.csv": _zigzag,
    "turn.csv": _turn,
    "table2.csv": _steady_turns,
    "trial.BIN": _flash,
    "trial.ulg": _ulog,
    "study.yaml": _study,
    "run.tlog": _run,
}
