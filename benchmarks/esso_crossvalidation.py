"""Cross-validation on the recordings of a real free-running model ship; prints one table.

    python benchmarks/esso_crossvalidation.py [FOLDER]

FOLDER holds the recordings `zigzag*.csv` and `turn*.csv` (NAOE-5thLab/FRT-DS-ESSO, CC BY-NC 4.0; not part of this
project); without it, `frt_ds_esso` in the folder named by NORRBIN_DATA or in `../shared/data`. Each run is foretold
over its whole length, once from its rudder and speed alone and once from propeller and wind too: by the fit to all
runs, by the fit to the zigzags, and by fits that have not seen it.
"""

from __future__ import annotations

import math
import os
import statistics
import sys
from collections.abc import Sequence
from pathlib import Path

from autopilot.identification.identified import Identified
from autopilot.identification.identify import identify
from autopilot.identification.runs import Run
from autopilot.loop.recordings import load_run

COLUMNS = {
    "time_s": "t [s]",
    "heading_rad": "psi_hat [rad]",
    "yaw_rate_rad_s": "r_angvelo [rad/s]",
    "rudder_rad": "delta_rudder [rad]",
    "speed_m_s": "u_velo [m/s]",
}


WITH_WIND = {
    **COLUMNS,
    "propeller_rps": "n_prop [rps]",
    "wind_speed_m_s": "wind_velo_relative_mid [m/s]",
    "wind_direction_rad": "wind_dir_relative_mid [rad]",
}


def main() -> int:
    """Print the table; 2 where the recordings are not there."""
    root = Path(os.environ.get("NORRBIN_DATA", Path(__file__).resolve().parents[1] / ".." / "shared" / "data"))
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else root / "frt_ds_esso"
    paths = sorted(folder.glob("zigzag*.csv")) + sorted(folder.glob("turn*.csv"))
    if not paths:
        print(f"{folder}: no zigzag*.csv or turn*.csv there; give the folder of the recordings.", file=sys.stderr)
        return 2
    for title, columns in (("rudder and speed alone", COLUMNS), ("rudder, speed, propeller and wind", WITH_WIND)):
        print(f"R2 of yaw rate and rms heading error (deg), open loop from {title}\n")
        _table([load_run(str(path), columns) for path in paths])
    return 0


def _table(runs: Sequence[Run]) -> None:
    zigzags = [run for run in runs if Path(run.source).name.startswith("zigzag")]
    everything, from_zigzags = identify(runs), identify(zigzags)
    print(f"{'run':36} {'all runs':>14} {'the zigzags':>14} {'all but it':>14} {'zigzags but it':>14}")
    unseen: dict[bool, list[float]] = {True: [], False: []}
    for run in runs:
        is_zigzag = run in zigzags
        without = identify([other for other in runs if other is not run])
        unseen[is_zigzag].append(without.foretell(run).yaw_rate_r2 or 0.0)
        cells = [_score(found, run) for found in (everything, from_zigzags, without)]
        if is_zigzag:
            cells.append(_score(identify([other for other in zigzags if other is not run]), run))
        print(f"{Path(run.source).name:36} " + " ".join(f"{cell:>14}" for cell in cells), flush=True)
    for is_zigzag, name in ((True, "zigzags"), (False, "turns")):
        if unseen[is_zigzag]:
            print(f"\nmedian R2 on {name} left out: {statistics.median(unseen[is_zigzag]):.3f}", end="")
    model, around, errors = everything.model, everything.around, everything.standard_errors
    print(
        f"\n\nall runs: K {model.gain:.4g} 1/s, T {model.time_constant:.3g} s at {model.reference_speed:.3f} m/s, ",
        end="",
    )
    print(f"n3 {model.n3:.3g} s^2/rad^2, n0 {model.n0:.2g} rad/s")
    if around is not None:
        print(
            f"race c {around.race:.2g} +- {errors['race']:.1g} m^2 at {around.reference_propeller:.1f} 1/s, wind c1 ",
            end="",
        )
        print(f"{around.wind_beam:.2g} +- {errors['wind_beam']:.1g}, c2 {around.wind_quarter:.2g} +- ", end="")
        print(f"{errors['wind_quarter']:.1g} rad/m^2")
    print(flush=True)


def _score(found: Identified, run: Run) -> str:
    prediction = found.foretell(run)
    return f"{prediction.yaw_rate_r2:.3f} / {math.degrees(prediction.heading_rms or 0.0):.0f}"


if __name__ == "__main__":
    sys.exit(main())
