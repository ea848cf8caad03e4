"""Heading error against rudder travel: the shipped pilot beside a PID that was tuned as long for the same cost.

    python benchmarks/pareto.py [--quick] [--candidates 50] [--boats lanxin15,coaster] [--out DIR]

Four boats, calm, a breeze and sea states 3 and 5 from five sides, K as modelled, 30 % less and 40 % more, a 10 Hz
compass alone with 0.2 or 0.5 deg of noise. For each boat and helmsman the same number of settings is tried on
training seeds, one for each K; for each weight w the one of least

    cost = mean of heading rms [deg] (10 at most) + w x mean rudder travel [deg/s]

is kept, once over all seas and once for each sea by itself, and sailed on held-out seeds. Fronts are then compared
case by case: rms at equal travel, travel at equal rms; over all seeds together, and on each seed alone, which shows
what is chance. `--out` keeps the points of each boat and helmsman, and the figure; a helmsman whose points lie there
already is not sailed again: delete the pilot's after a change of the pilot.
"""

from __future__ import annotations

import argparse
import itertools
import json
import math
import statistics
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from pareto_front import LEAST, Beside, Explored, beside, chosen, explore, front
from pareto_study import BOATS, SEAS, Helmsman, Ours, Run, Theirs, held_out_runs, training_runs

from autopilot.cli.terminal import ProgressBar

Floats = npt.NDArray[np.float64]

WEIGHTS = np.logspace(-3.0, 1.5, 10)
TRAINING, HELD_OUT, SEARCH_SEED = 100, 7000, 42
LOST_DEG = 10.0
"""A boat that strays further than this, rms, is not held; such cases are counted apart."""
EVERY_SEA = "all"


class Case(NamedTuple):
    """Boat, sea, side [deg off the bow], real K beside the model's, and what the settings were tuned in."""

    boat: str
    sea: str
    side: float
    mismatch: str
    tuned: str


class Compared(NamedTuple):
    """A case with both helmsmen's points (settings, held-out seeds, 2), and what their fronts come to, all seeds taken
    together and each alone."""

    case: Case
    ours: Floats
    theirs: Floats
    beside: Beside
    by_seed: tuple[Beside, ...]

    @property
    def is_held(self) -> bool:
        """Whether anybody holds the boat."""
        return bool(min(together(points)[:, 0].min() for points in (self.ours, self.theirs)) < LOST_DEG)


def costs_over(runs: Sequence[Run]) -> tuple[list[str], Callable[[Floats], Floats]]:
    """Return the groups of runs, all seas first, and the function that gives every group's cost for every weight."""
    groups = [EVERY_SEA, *dict.fromkeys(run.sea for run in runs)]
    masks = [np.array([group in (EVERY_SEA, run.sea) for run in runs]) for group in groups]

    def costs(points: Floats) -> Floats:
        bounded = np.minimum(points[:, 0], LOST_DEG), points[:, 1]
        means = [(bounded[0][mask].mean(), bounded[1][mask].mean()) for mask in masks]
        return np.concatenate([rms + WEIGHTS * travel for rms, travel in means])

    return groups, costs


def fronts(
    helmsman: Helmsman, training: Sequence[Run], held_out: Sequence[Run], count: int, shown: Callable[[], None]
) -> dict[str, Floats]:
    """Return for each group the points (settings, held-out runs, 2) of what was tuned in it; nan where not sailed."""
    groups, costs = costs_over(training)
    found: Explored = explore(
        lambda numbers: helmsman.sailed(numbers, training),
        helmsman.starts,
        helmsman.low,
        helmsman.high,
        costs,
        count,
        SEARCH_SEED,
        shown,
    )
    result = {}
    for place, group in enumerate(groups):
        kept = chosen(found, costs, range(place * len(WEIGHTS), (place + 1) * len(WEIGHTS)))
        sailed = [number for number, run in enumerate(held_out) if group in (EVERY_SEA, run.sea)]
        points = np.full((len(kept), len(held_out), 2), np.nan)
        for row, numbers in enumerate(kept):
            points[row, sailed] = helmsman.sailed(numbers, [held_out[number] for number in sailed])
        result[group] = points
        shown()
    return result


def compared(boat: str, held_out: Sequence[Run], ours: dict[str, Floats], theirs: dict[str, Floats]) -> list[Compared]:
    """Return every case of a boat."""
    cases = dict.fromkeys((run.sea, run.side, run.mismatch) for run in held_out)
    found = []
    for tuned in ours:
        for case in cases:
            if tuned not in (EVERY_SEA, case[0]):
                continue
            mask = np.array([(run.sea, run.side, run.mismatch) == case for run in held_out])
            found.append(compared_by(Case(boat, *case, tuned), ours[tuned][:, mask], theirs[tuned][:, mask]))
    return found


def compared_by(case: Case, ours: Floats, theirs: Floats) -> Compared:
    """Return a case with what both helmsmen's points (settings, seeds, 2) come to."""
    alone = tuple(beside(ours[:, seed], theirs[:, seed]) for seed in range(ours.shape[1]))
    return Compared(case, ours, theirs, beside(together(ours), together(theirs)), alone)


def together(points: Floats) -> Floats:
    """Return the points (settings, 2) over all seeds of (settings, seeds, 2)."""
    rms = np.sqrt(np.mean(points[:, :, 0] ** 2, axis=1))
    return np.stack([rms, np.mean(points[:, :, 1], axis=1)], axis=1)


def study(
    boat: str,
    count: int,
    seeds: int,
    shown: Callable[[], None],
    is_quick: bool = False,
    is_plain: bool = False,
    out: Path | None = None,
) -> list[Compared]:
    """Return all cases of one boat; a few where it is to be `is_quick`, without numba where `is_plain`.

    A helmsman's points that lie in `out`, from as many settings and seeds, are not sailed again.
    """
    training, held_out = training_runs(boat, TRAINING), held_out_runs(boat, HELD_OUT, seeds)
    if is_quick:
        training, held_out = training[::15], held_out[::12]
    found = []
    for name, helmsman in (("pilot", Ours(boat, is_plain)), ("pid", Theirs(boat, is_plain))):
        path = out / f"{boat}_{name}_{count}_{len(held_out)}.json" if out is not None else None
        if path is not None and path.exists():
            found.append({group: np.array(points) for group, points in json.loads(path.read_text()).items()})
            continue
        found.append(fronts(helmsman, training, held_out, count, shown))
        if path is not None:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(json.dumps({group: points.round(5).tolist() for group, points in found[-1].items()}))
    return compared(boat, held_out, *found)


def median(values: Sequence[float]) -> float:
    """Return the median of the values that are numbers."""
    kept = [value for value in values if math.isfinite(value)]
    return statistics.median(kept) if kept else math.nan


def table(cases: Sequence[Compared]) -> str:
    """Return medians by boat and sea, a row for each, over sides and mismatches."""
    lines = [
        "tuned in  boat      sea       cases   rms at equal travel   travel at equal rms   won  lost  on every seed"
    ]
    for tuned in (EVERY_SEA, "each sea"):
        ours = [one for one in cases if (one.case.tuned == EVERY_SEA) == (tuned == EVERY_SEA)]
        for boat in dict.fromkeys(one.case.boat for one in ours):
            lines += [_row(tuned, boat, sea, [o for o in ours if o.case[:2] == (boat, sea)]) for sea in SEAS]
        lines.append(_row(tuned, "all", "all", ours))
    return "\n".join(line for line in lines if line)


def _row(tuned: str, boat: str, sea: str, cases: Sequence[Compared]) -> str:
    held = [one for one in cases if one.is_held]
    if not held:
        return f"{tuned:10s}{boat:10s}{sea:9s}{0:4d} of {len(cases):3d}   not held by either" if cases else ""
    rms, travel = (median([getattr(one.beside, name) for one in held]) for name in ("rms", "travel"))
    won = sum(is_won(one.beside) for one in held)
    lost, surely = sum(is_lost(one.beside) for one in held), sum(is_surely_lost(one) for one in held)
    text = f"{tuned:10s}{boat:10s}{sea:9s}{len(held):4d} of {len(cases):3d}{rms:14.2f}{travel:22.2f}"
    return f"{text}{won:12d}{lost:6d}{surely:15d}"


def lost_cases(cases: Sequence[Compared]) -> str:
    """Return the cases that are lost on every seed, each with its ratios on all seeds and on each: rms/travel."""
    lines = [f"{'tuned in':10s}{'boat':10s}{'sea':9s}{'side':>5s}  {'K':7s}{'together':>12s}   each seed"]
    for one in cases:
        if not (one.is_held and is_surely_lost(one)):
            continue
        boat, sea, side, mismatch, tuned = one.case
        ratios = [f"{found.rms:5.2f}/{found.travel:4.2f}" for found in (one.beside, *one.by_seed)]
        tuned = tuned if tuned == EVERY_SEA else "each sea"
        lines.append(
            f"{tuned:10s}{boat:10s}{sea:9s}{side:5.0f}  {mismatch:7s}{ratios[0]:>12s}   {'  '.join(ratios[1:])}"
        )
    return "\n".join(lines)


def draw(cases: Sequence[Compared], path: Path) -> None:
    """Draw every case's two fronts, of settings tuned in its sea: a panel for each boat and sea."""
    import matplotlib as mpl

    mpl.use("agg")
    from matplotlib import pyplot

    boats = list(dict.fromkeys(one.case.boat for one in cases))
    with mpl.rc_context({"font.size": 8}):
        size = (9.0, 2.1 * len(boats))
        drawn, axes = pyplot.subplots(len(boats), len(SEAS), squeeze=False, figsize=size, layout="constrained")
        for (row, boat), (column, sea) in itertools.product(enumerate(boats), enumerate(SEAS)):
            axis = axes[row, column]
            for name, colour in (("theirs", "#c8501e"), ("ours", "#0b5fa5")):
                for one in cases:
                    if one.case.tuned == sea and one.case.boat == boat and one.case.sea == sea and one.is_held:
                        rms, travel = front(np.maximum(together(getattr(one, name)), LEAST)).T
                        axis.loglog(travel, rms, color=colour, linewidth=0.7, marker=".", markersize=2.5, alpha=0.7)
            # where all rest there is next to nothing to see, and no scale by itself
            axis.set_xlim(0.8 * LEAST[1], max(1.0, axis.get_xlim()[1]))
            axis.set_ylim(0.8 * LEAST[0], max(1.0, axis.get_ylim()[1]))
            axis.set_title(f"{boat}, {sea}", fontsize=8)
            axis.set_xlabel("travel [deg/s]" if row == len(boats) - 1 else "")
            axis.set_ylabel("" if column else "rms [deg]")
        drawn.savefig(path, dpi=80, metadata={"Software": None})
        pyplot.close(drawn)


def is_won(found: Beside) -> bool:
    """Return whether the case meets the aim: 0.8 of the rms, or 0.6 of the travel."""
    return found.rms <= 0.8 or found.travel <= 0.6


def is_lost(found: Beside) -> bool:
    """Return whether the peer is better."""
    return found.rms > 1.0 and not found.travel <= 1.0


def is_surely_lost(one: Compared) -> bool:
    """Return whether the peer is better on all seeds together and on each of them alone."""
    return is_lost(one.beside) and all(is_lost(found) for found in one.by_seed)


def main() -> None:
    """Study the boats and print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="few candidates, a few runs of the first boat")
    parser.add_argument("--candidates", type=int, default=50, help="settings tried, for each helmsman and boat")
    parser.add_argument("--seeds", type=int, default=3, help="seeds held out")
    parser.add_argument("--boats", default=",".join(BOATS))
    parser.add_argument("--out", type=Path, help="folder for the points of each boat and helmsman, and pareto.png")
    asked = parser.parse_args()
    boats, count = asked.boats.split(","), asked.candidates
    if unknown := set(boats) - set(BOATS):
        parser.error(f"--boats {','.join(sorted(unknown))}: known are {', '.join(BOATS)}")
    if asked.quick:
        boats, count = boats[:1], 9
    done, total = 0, len(boats) * 2 * (count + 1 + len(SEAS))
    cases: list[Compared] = []
    with ProgressBar("settings") as bar:

        def shown() -> None:
            nonlocal done
            done += 1
            bar.update(done, total)

        for boat in boats:
            cases += study(boat, count, asked.seeds, shown, asked.quick, out=asked.out)
    print(table(cases), lost_cases(cases), sep="\n\n")
    if asked.out is not None:
        draw(cases, asked.out / "pareto.png")


if __name__ == "__main__":
    main()
