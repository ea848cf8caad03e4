"""What the fit of an hour of recordings and its forecast take, and its simulation beside a loop over time.

    python benchmarks/identification_speed.py [--json]

Five zigzags of twelve minutes at 10 Hz with noise: 36,000 samples. The peer of the simulation is the same Runge-Kutta
step taken one after the other in plain Python, in this process and in turn. Seconds are this machine's, of this day;
fit and forecast are said in such loops, too, and the fit in slopes of the likelihood, which no load changes.
"""

from __future__ import annotations

import argparse
import json
import statistics
import sys
import time
from unittest.mock import patch

import numpy as np
from identification_accuracy import BOATS, SPEED, Boat, noisy

from autopilot.identification import simulation
from autopilot.identification.identified import Question
from autopilot.identification.identify import identify
from autopilot.identification.likelihood_search import Space
from autopilot.identification.output_error import fit_steps
from autopilot.identification.prediction_bands import forecast, gear_of
from autopilot.identification.residuals import typical_rate

RUNS, MINUTES, ROUNDS = 5, 12, 5


def measure(boat: Boat) -> dict[str, object]:
    """Return the seconds of the fit, and the ratio of the loop over time to the simulation of all steps at once."""
    runs = [noisy(boat._replace(seconds=60.0 * MINUTES), seed) for seed in range(RUNS)]
    with patch.object(Space, "slope", autospec=True, side_effect=Space.slope) as slopes:
        begin, cpu = time.perf_counter(), time.process_time()
        found = identify(runs, Question(reference_speed=SPEED))
        wall, cpu = time.perf_counter() - begin, time.process_time() - cpu
    assert found.predictor is not None
    ahead = time.process_time()
    forecast(found.predictor, runs, SPEED, gear_of(runs))
    ahead = time.process_time() - ahead
    segments = [segment for run in runs for segment in run.segments]
    steps = fit_steps(segments, boat.model, typical_rate(segments))
    start, ratios, loops = np.zeros(len(segments)), [], []
    for _ in range(ROUNDS):
        begin = time.process_time()
        at_once = simulation.simulate(boat.model, steps, start)
        middle = time.process_time()
        in_turn = simulation._one_by_one(simulation._drives(boat.model, steps, None), steps, start[None])[0]
        loops.append(time.process_time() - middle)
        ratios.append(loops[-1] / (middle - begin))
    assert np.allclose(at_once.rate, in_turn, atol=1.0e-9)
    return {
        "boat": boat.name,
        "samples": int(sum(segment.time.size for segment in segments)),
        "steps": int(steps.step.size),
        "fit_wall_s": round(wall, 2),
        "fit_cpu_s": round(cpu, 2),
        "slopes": slopes.call_count,
        "fit_over_loop": round(cpu / statistics.median(loops), 1),
        "forecast_over_loop": round(ahead / statistics.median(loops), 1),
        "loop_over_simulation": round(statistics.median(ratios), 1),
        "K": round(found.model.gain, 5),
        "T": round(found.model.time_constant, 5),
    }


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    rows = [measure(boat) for boat in BOATS[:3]]
    if options.json:
        sys.stdout.write(json.dumps(rows, indent=2) + "\n")
        return
    sys.stdout.write("| boat | samples | steps | fit wall s | fit CPU s | slopes | fit / loop | forecast / loop | ")
    sys.stdout.write("loop / simulation | K | T |\n|---|---|---|---|---|---|---|---|---|---|---|\n")
    for r in rows:
        sys.stdout.write("| " + " | ".join(str(value) for value in r.values()) + " |\n")


if __name__ == "__main__":
    main()
