"""Cross-validation on the recordings of a real free-running model ship; prints one table.

    python benchmarks/esso_crossvalidation.py [FOLDER]

FOLDER holds the recordings `zigzag*.csv` and `turn*.csv` (NAOE-5thLab/FRT-DS-ESSO, CC BY-NC 4.0; not part of this
project); without it, `frt_ds_esso` in the folder named by NORRBIN_DATA or in `../shared/data`. Each run is foretold
over its whole length from its rudder and speed alone: by the fit to all runs, by the fit to the zigzags, and by
fits that have not seen it.
"""

from __future__ import annotations

import math
import os
import statistics
import sys
from collections.abc import Sequence
from pathlib import Path

from autopilot.identification.identify import identify
from autopilot.identification.prediction import predict
from autopilot.identification.runs import Run
from autopilot.loop.recordings import load_run
from autopilot.models.norrbin import Norrbin

COLUMNS = {
    "time_s": "t [s]",
    "heading_rad": "psi_hat [rad]",
    "yaw_rate_rad_s": "r_angvelo [rad/s]",
    "rudder_rad": "delta_rudder [rad]",
    "speed_m_s": "u_velo [m/s]",
}


def main() -> int:
    """Print the table; 2 where the recordings are not there."""
    root = Path(os.environ.get("NORRBIN_DATA", Path(__file__).resolve().parents[1] / ".." / "shared" / "data"))
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else root / "frt_ds_esso"
    paths = sorted(folder.glob("zigzag*.csv")) + sorted(folder.glob("turn*.csv"))
    if not paths:
        print(f"{folder}: no zigzag*.csv or turn*.csv there; give the folder of the recordings.", file=sys.stderr)
        return 2
    runs = [load_run(str(path), COLUMNS) for path in paths]
    zigzags = [run for run in runs if Path(run.source).name.startswith("zigzag")]
    everything, from_zigzags = _fitted(runs), _fitted(zigzags)
    print("R2 of yaw rate and rms heading error (deg), open loop from rudder and speed alone\n")
    print(f"{'run':36} {'all runs':>14} {'the zigzags':>14} {'all but it':>14} {'zigzags but it':>14}")
    unseen: dict[bool, list[float]] = {True: [], False: []}
    for run in runs:
        is_zigzag = run in zigzags
        without = _fitted([other for other in runs if other is not run])
        unseen[is_zigzag].append(predict(without, run).yaw_rate_r2 or 0.0)
        cells = [_score(model, run) for model in (everything, from_zigzags, without)]
        if is_zigzag:
            cells.append(_score(_fitted([other for other in zigzags if other is not run]), run))
        print(f"{Path(run.source).name:36} " + " ".join(f"{cell:>14}" for cell in cells), flush=True)
    for is_zigzag, name in ((True, "zigzags"), (False, "turns")):
        if unseen[is_zigzag]:
            print(f"\nmedian R2 on {name} left out: {statistics.median(unseen[is_zigzag]):.3f}", end="")
    print(f"\n\nall runs: K {everything.gain:.4g} 1/s, T {everything.time_constant:.3g} s at ", end="")
    print(f"{everything.reference_speed:.3f} m/s, n3 {everything.n3:.3g}, n0 {everything.n0:.2g} rad/s")
    return 0


def _fitted(runs: Sequence[Run]) -> Norrbin:
    return identify(runs).model


def _score(model: Norrbin, run: Run) -> str:
    prediction = predict(model, run)
    return f"{prediction.yaw_rate_r2:.3f} / {math.degrees(prediction.heading_rms or 0.0):.0f}"


if __name__ == "__main__":
    sys.exit(main())
