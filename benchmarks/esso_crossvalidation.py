"""Cross-validation on the recordings of a real free-running model ship; prints one table.

    python benchmarks/esso_crossvalidation.py [FOLDER]

FOLDER holds the recordings `zigzag*.csv` and `turn*.csv` (NAOE-5thLab/FRT-DS-ESSO, CC BY-NC 4.0; not part of this
project); without it, `frt_ds_esso` in the folder named by NORRBIN_DATA or in `../shared/data`. Each run is predicted
over its whole length, once from its rudder and speed alone and once from propeller and wind too: by the fit to all
runs, by the fit to the zigzags, and by fits that have not seen it. Last, the run left out until its propeller stops for
good and the boat is fetched in, and windows of 120 s of it, every 60 s, the model starting afresh in each.
"""

from __future__ import annotations

import math
import os
import statistics
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from autopilot.identification.identified import Identified
from autopilot.identification.identify import identify
from autopilot.identification.runs import Run, Segment
from autopilot.logs.reading import load_run

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

WINDOW_S = 120.0


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
    windows: list[float] = []
    driven: dict[bool, list[float]] = {True: [], False: []}
    for run in runs:
        is_zigzag = run in zigzags
        without = identify([other for other in runs if other is not run])
        unseen[is_zigzag].append(without.predict(run).yaw_rate_r2 or 0.0)
        windows += [r2 for part in _windows(run) if (r2 := without.predict(part).yaw_rate_r2) is not None]
        driven[is_zigzag].append(without.predict(_driven(run)).yaw_rate_r2 or 0.0)
        cells = [_score(found, run) for found in (everything, from_zigzags, without)]
        if is_zigzag:
            cells.append(_score(identify([other for other in zigzags if other is not run]), run))
        print(f"{Path(run.source).name:36} " + " ".join(f"{cell:>14}" for cell in cells), flush=True)
    for is_zigzag, name in ((True, "zigzags"), (False, "turns")):
        if unseen[is_zigzag]:
            print(f"\nmedian R2 on {name} left out: {statistics.median(unseen[is_zigzag]):.3f}", end="")
            print(f"; until the propeller stops {statistics.median(driven[is_zigzag]):.3f}", end="")
    print(f"\nmedian R2 on {len(windows)} windows of {WINDOW_S:g} s left out: {statistics.median(windows):.3f}", end="")
    model, around, errors = everything.model, everything.around, everything.standard_errors
    print(
        f"\n\nall runs: K {model.gain:.4g} 1/s, T {model.time_constant:.3g} s at {model.reference_speed:.3f} m/s, ",
        end="",
    )
    print(f"n3 {model.n3:.3g} s^2/rad^2, n0 {model.n0:.2g} rad/s")
    if around is not None:
        print(
            f"race w2 {around.steady_race:.2g} m^2/s^2, drift {around.drift:.2g} within {around.drift_time:.2g} s, by "
            f"wind {around.drift_wind:.2g} rad/m^2"
        )
    if around is not None and around.race > 0.0:
        print(
            f"race c {around.race:.2g} +- {errors['race']:.1g} m^2 at {around.reference_propeller:.1f} 1/s, wind c1 ",
            end="",
        )
        print(f"{around.wind_beam:.2g} +- {errors['wind_beam']:.1g}, c2 {around.wind_quarter:.2g} +- ", end="")
        print(f"{errors['wind_quarter']:.1g} rad/m^2")
    print(flush=True)


def _windows(run: Run) -> list[Run]:
    """Return the windows of a run, by what is left of its first to its last sample."""
    begin, end = run.segments[0].time[0], run.segments[-1].time[-1]
    starts = np.arange(begin, end - WINDOW_S + 1.0, 0.5 * WINDOW_S)
    return [_between(run, start, start + WINDOW_S) for start in starts]


def _driven(run: Run) -> Run:
    """Return a run until its propeller stops for good; all of it where nobody recorded that."""
    turning = [segment.time[segment.propeller > 0.5][-1] for segment in run.segments if np.any(segment.propeller > 0.5)]
    return _between(run, run.segments[0].time[0], turning[-1]) if turning else run


def _between(run: Run, start: float, end: float) -> Run:
    parts = []
    for segment in run.segments:
        inside = (segment.time >= start) & (segment.time <= end)
        if np.count_nonzero(inside) > 1:
            parts.append(Segment(*(values[inside] if values.size else values for values in segment)))
    return run._replace(segments=tuple(parts))


def _score(found: Identified, run: Run) -> str:
    prediction = found.predict(run)
    return f"{prediction.yaw_rate_r2:.3f} / {math.degrees(prediction.heading_rms or 0.0):.0f}"


if __name__ == "__main__":
    sys.exit(main())
