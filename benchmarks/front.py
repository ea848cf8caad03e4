"""What `autopilot gains` writes beside peers tuned in the very sea: heading rms against rudder travel.

    python benchmarks/front.py [--boats NAMES] [--timing 20:0.05] [--evaluations 300] [--seeds 3]
                               [--first-seed 20261125] [--instruments NAMES] [--calm] [--out FOLDER]

Boats: K 0.43 1/s and T 3.5 s, and Lanxin, both with a rudder of 15 deg/s and 0.1 s of lag, and plants of the simulator
by the vessel files that were identified from their zigzags: the LQG law is not theirs and is left out. Waves of 1 deg
rms (spectrum of Jiang et al. 2016) and a steady wind of 1.5 deg, as rudder angles. Instruments: heading and rate exact;
0.1 deg and 0.02 deg/s; a compass of 0.3 deg alone. 0, 50 and 100 ms from order to servo, 20 and 50 Hz, in lockstep.

The pilot is designed from model, rudder, noise and path, a front of nine levels, and sees the sea for the first time in
the runs that judge. The peers (`front_peers`) are searched in this sea on seeds of their own, as many settings each,
and judged on the same runs. The LQG law knows everything but the deviates and is searched as they are: what is left to
be had. "LQG, ready" is the same law, ready for as much change of wind as the pilot is at least: what is left to be had
by a pilot that stays so. "LQG, as ours" takes waves and boat for what the pilot does as well: what the pilot's own
equations leave. A ratio is the pilot's rms over the peer's at the travel of each level, where the peer's front reaches
that far; below a peer's line, in brackets, stands the peer's own over that of each of these laws.

With `--calm` there are no waves: a breath of wind comes and goes in a minute, and the peers are searched in that. A
ratio is then the pilot's travel over the peer's at the heading rms of each level, or over that of the peer's quietest
setting where all of his hold the course better: who is quieter.
"""

from __future__ import annotations

import argparse
import copy
import functools
import itertools
import json
import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import front_peers as peers
import numpy as np
import numpy.typing as npt
from front_runs import (
    Boat,
    Drawn,
    Instruments,
    Sea,
    as_known,
    drawn,
    lanxin_boat,
    quick_boat,
    sailed_peer,
    sailed_pilot,
    zoo_boat,
)
from pareto_front import chosen, explore, front

from autopilot.control.margins import RUDDER_IN_USE
from autopilot.estimation.tuning import BIAS_CHANGE_IN_WAVES, BIAS_TIME, MODEL_ERROR, WAVE_DAMPING
from autopilot.runtime.build import gear_of, model_of
from autopilot.runtime.tuning import GainRequest, designed

Floats = npt.NDArray[np.float64]

SEA = Sea(waves=1.0, wind=1.5)
CALM = Sea(wind=0.5, gusts=0.1, gust_time=60.0)
"""Without any push the best helmsman of all is one who is not there."""
INSTRUMENTS = {
    "exact": Instruments(),
    "0.1 deg, 0.02 deg/s": Instruments(heading_deg=0.1, rate_deg_s=0.02),
    "compass 0.3 deg": Instruments(heading_deg=0.3, has_rate=False),
}
TIMING = ((20, 0.0), (20, 0.05), (20, 0.1), (50, 0.0), (50, 0.1))
"""Readings and orders a second, and seconds from order to servo."""
WEIGHTS = np.logspace(-2.5, 1.0, 36)
"""Prices of travel, deg^2 for 1 deg/s."""
TRAINING, TRAINED_S, JUDGED_S, SEARCH = (101, 102, 103), 240.0, 600.0, 42
STARTS = 4
READY = BIAS_CHANGE_IN_WAVES**2 / BIAS_TIME
"""Density [rad^2/s] of the changes of wind that the pilot is always ready for."""
WANDERS_S = 1000.0
"""Gusts that last so long wander about like a wind."""
LQG_LAWS = {"LQG": (0.0, False), "LQG, ready": (READY, False), "LQG, as ours": (READY, True)}
"""The density of the changes of wind that each is ready for, and whether it takes waves and boat for what the pilot
does."""
BOATS: dict[str, tuple[Callable[[], Boat], bool]] = {
    "quick": (quick_boat, True),
    "lanxin": (lanxin_boat, True),
    **{kind: (functools.partial(zoo_boat, kind), False) for kind in ("mmg_tanker", "small_craft")},
}
"""Each boat, and whether it is its model."""


class Peer(NamedTuple):
    """Bounds of a peer's numbers, in logarithms, and the helmsman that they make, his memory and his step."""

    low: Floats
    high: Floats
    made: Callable[[Floats], Any]
    first: Any
    step: Callable[..., Any]


def ardurover(boat: Boat, has_rate: bool) -> Peer:
    """Return ArduRover's steering with bounds about the boat's own numbers."""
    model, gear = model_of(boat.vessel), gear_of(boat.vessel)
    unit, t = 1.0 / (model.gain * gear.angle_max), model.time_constant
    low = [
        0.05 / t**0.5,
        0.01 * unit,
        0.001 * unit,
        1e-4 * unit * t,
        0.01 * unit,
        0.02,
        0.002,
        0.002,
        0.002,
        0.02,
        0.02,
    ]
    high = [6 / t**0.5, 10 * unit * max(t, 1), 5 * unit * max(t, 1), 2 * unit * t, 3 * unit, 1, 3, 3, 3, 2, 5]
    rudder = peers.Rudder(gear.angle_max, gear.rate_max)
    if not has_rate:
        low, high = [*low, 0.01], [*high, 10.0]

    def made(numbers: Floats) -> peers.ArduRover:
        values = np.exp(numbers).tolist()
        return peers.ArduRover(*values[:11], values[11] if len(values) > 11 else 0.1, rudder)

    return Peer(np.log(low), np.log(high), made, peers.ARDUROVER_BEGINS, peers.ardurover_step)


def pid(boat: Boat, has_rate: bool) -> Peer:
    """Return the study's PID."""
    model, gear = model_of(boat.vessel), gear_of(boat.vessel)
    rudder, unit, t = peers.Rudder(gear.angle_max, gear.rate_max), 1.0 / model.gain, model.time_constant
    low = [0.02 * unit, 1e-4 * unit, 0.01 * unit * t, 0.002, 0.002, 1e-5, 1e-5]
    high = [20 * unit / t**0.5, 2 * unit, 20 * unit * max(t, 0.3), 3.0, 10.0, 0.02, 0.03]
    return Peer(
        np.log(low),
        np.log(high),
        lambda numbers: peers.Pid(*np.exp(numbers).tolist(), rudder),
        peers.PID_BEGINS,
        peers.pid_step,
    )


def kalman_pid(boat: Boat, has_rate: bool) -> Peer:
    """Return the PID behind an observer of constant gains."""
    model, gear = model_of(boat.vessel), gear_of(boat.vessel)
    rudder, unit, t = peers.Rudder(gear.angle_max, gear.rate_max), 1.0 / model.gain, model.time_constant
    low = [0.005, 0.001, 1e-5, 1e-3, 0.02 * unit, 0.01 * unit * t, 0.005]
    high = [1.0, 2.0, 0.5, 1.0, 20 * unit / t**0.5, 20 * unit * max(t, 0.3), 20.0]

    def made(numbers: Floats) -> peers.KalmanPid:
        return peers.KalmanPid(model.gain / t, model.n1 / t, *np.exp(numbers).tolist(), rudder)

    return Peer(np.log(low), np.log(high), made, peers.KALMAN_PID_BEGINS, peers.kalman_pid_step)


PEERS: dict[str, Callable[[Boat, bool], Peer]] = {"ArduRover": ardurover, "PID": pid, "Kalman PID": kalman_pid}


def together(points: Sequence[tuple[float, float]]) -> tuple[float, float]:
    """Return rms and travel over several runs."""
    both = np.array(points)
    return float(np.sqrt(np.mean(np.minimum(both[:, 0], 1.0e3) ** 2))), float(both[:, 1].mean())


def costs(points: Floats) -> Floats:
    """Return the cost for each weight of what a setting came to in each run (runs, 2).

    Of mean square and travel, which both add up over time, so that the best law's front is convex; its rms is not where
    little rudder is used, and no weight on the rms ever picks a setting from there.
    """
    return np.asarray(np.mean(np.minimum(points[:, 0], 10.0) ** 2) + WEIGHTS * points[:, 1].mean())


def tuned(boat: Boat, peer: Peer, training: Sequence[Drawn], judged: Sequence[Drawn], count: int) -> Floats:
    """Return the front of a peer that was searched with `count` settings."""
    random = np.random.default_rng(SEARCH)
    starts = peer.low + (peer.high - peer.low) * random.uniform(0.3, 0.7, (STARTS, len(peer.low)))

    def sailed(numbers: Floats, runs: Sequence[Drawn]) -> Floats:
        helm = peer.made(numbers)
        # what a law writes in place begins anew in each run
        return np.array([sailed_peer(boat, helm, copy.deepcopy(peer.first), peer.step, run) for run in runs])

    found = explore(lambda numbers: sailed(numbers, training), starts, peer.low, peer.high, costs, count, SEARCH)
    kept = chosen(found, costs, range(len(WEIGHTS)))
    return front(np.array([together(sailed(numbers, judged).tolist()) for numbers in kept]))


def knowing(boat: Boat, path: float, instruments: Instruments, law: str) -> Peer:
    """Return one of the LQG_LAWS, gains and play about those of the linear laws; by the pilot's beliefs the gains are
    theirs."""
    density, believes = LQG_LAWS[law]
    model, gear = model_of(boat.vessel), gear_of(boat.vessel)
    sea = SEA._replace(gusts=math.degrees(math.sqrt(0.5 * density * WANDERS_S)), gust_time=WANDERS_S)
    doubt = (MODEL_ERROR * RUDDER_IN_USE * model.gain / model.time_constant) ** 2
    beliefs = peers.Beliefs(WAVE_DAMPING, doubt) if believes else None
    rudder = peers.Rudder(gear.angle_max, gear.rate_max)
    laws = peers.lqg_laws((model, gear.lag, path), sea, instruments, rudder, beliefs)
    bound = 0.0 if believes else 1.0
    low, high = [0.0, *[-bound] * 4, -4.0], [len(laws) - 1.0, *[bound] * 4, 1.4]
    # the wind is known, too: its orders count from the rudder that holds against it
    first = np.zeros(len(laws[0].move)), np.zeros(2)
    first[0][[peers.RUDDER, *range(peers.ORDER, len(first[0]))]] = math.radians(SEA.wind)
    return Peer(np.array(low), np.array(high), lambda numbers: peers.lqg_between(laws, numbers), first, peers.lqg_step)


def ours(boat: Boat, path: float, instruments: Instruments, judged: Sequence[Drawn]) -> Floats:
    """Return what each level of `autopilot gains` comes to."""
    vessel = as_known(boat.vessel, instruments, path)
    levels = [designed(vessel, GainRequest(level)) for level in range(1, 10)]
    return np.array([together([sailed_pilot(boat, one, run) for run in judged]) for one in levels])


def beside(levels: Floats, peer: Floats) -> Floats:
    """Return the levels' rms over the peer's at equal travel; nan where the peer's front does not reach."""
    logs = np.log(np.maximum(peer, 1.0e-4))
    at = np.interp(np.log(levels[:, 1]), logs[:, 1], logs[:, 0])
    ratio = levels[:, 0] / np.exp(at)
    return np.where(levels[:, 1] < peer[:, 1].min(), math.nan, ratio)


def quieter(levels: Floats, peer: Floats) -> Floats:
    """Return the levels' travel over the peer's at equal rms; nan where the peer never holds its course so well."""
    by_rms = np.log(np.maximum(peer[np.argsort(peer[:, 0])], 1.0e-4))
    at = np.interp(np.log(levels[:, 0]), by_rms[:, 0], by_rms[:, 1])
    return np.where(levels[:, 0] < peer[:, 0].min(), math.nan, levels[:, 1] / np.exp(at))


def main() -> None:
    """Sail and print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--evaluations", type=int, default=300, help="settings tried for each peer and case")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--first-seed", type=int, default=20261125, help="of the runs that judge: the date")
    parser.add_argument("--out", type=Path, help="folder for front.json and front.png")
    parser.add_argument("--boats", nargs="+", choices=BOATS, default=list(BOATS))
    parser.add_argument("--timing", nargs="+", default=[f"{hz}:{path:g}" for hz, path in TIMING], help="Hz:path_s")
    parser.add_argument("--instruments", nargs="+", choices=INSTRUMENTS, default=list(INSTRUMENTS))
    parser.add_argument("--calm", action="store_true", help="no waves: travel at equal rms")
    asked = parser.parse_args()
    sea, compared, of_what = (CALM, quieter, "travel") if asked.calm else (SEA, beside, "rms")
    record: dict[str, Any] = {}
    timing = [(int(hz), float(path)) for hz, path in (each.split(":") for each in asked.timing)]
    column = f"{of_what} over the peer's at levels 1 to 9"
    print(f"{'boat':22s}{'instruments':22s}{'Hz':>3s}{'path':>6s}  peer         {column}")
    for made, is_model in (BOATS[name] for name in asked.boats):
        boat = made()
        for (hz, path), name in itertools.product(timing, asked.instruments):
            case = INSTRUMENTS[name]._replace(hz=hz)
            training = [drawn(boat, sea, case, path, (seed, TRAINED_S)) for seed in TRAINING]
            seeds = range(asked.first_seed, asked.first_seed + asked.seeds)
            judged = [drawn(boat, sea, case, path, (seed, JUDGED_S)) for seed in seeds]
            fronts = {"pilot": ours(boat, path, case, judged)}
            if is_model and not asked.calm:
                for law in LQG_LAWS:
                    fronts[law] = tuned(boat, knowing(boat, path, case, law), training, judged, asked.evaluations)
            for peer, of in PEERS.items():
                fronts[peer] = tuned(boat, of(boat, case.has_rate), training, judged, asked.evaluations)
            ratios = {peer: compared(fronts["pilot"], fronts[peer]) for peer in list(fronts)[1:]}
            for peer, ratio in ratios.items():
                print(f"{boat.vessel.name:22s}{name:22s}{hz:3d}{path:6.2f}  {peer:12s} {row(ratio)}", flush=True)
                for law in LQG_LAWS if "LQG" in ratios and peer in PEERS else ():
                    print(f"{f'(over {law})':>65s} {row(ratios[law] / ratio)}", flush=True)
            record[f"{boat.vessel.name} | {name} | {hz} Hz | {path:g} s"] = {
                key: points.round(4).tolist() for key, points in fronts.items()
            }
            keep(record, asked.out)


def row(ratios: Floats) -> str:
    """Return them in a row."""
    return " ".join(f"{each:5.2f}" for each in ratios)


def keep(record: dict[str, Any], out: Path | None) -> None:
    """Write what has been sailed so far, and draw it."""
    if out is not None:
        out.mkdir(parents=True, exist_ok=True)
        (out / "front.json").write_text(json.dumps(record, indent=1))
        draw(record, out / "front.png")


def draw(record: dict[str, Any], path: Path) -> None:
    """Draw the fronts at 20 Hz with 50 ms of path: a panel for each boat and set of instruments."""
    import matplotlib as mpl

    mpl.use("agg")
    from matplotlib import pyplot

    shown = {key: value for key, value in record.items() if key.endswith("20 Hz | 0.05 s")}
    rows = max(1, -(-len(shown) // 3))
    drawn_, axes = pyplot.subplots(rows, 3, figsize=(9.0, 2.8 * rows), layout="constrained", squeeze=False)
    if not shown:
        return
    colours = {"pilot": "#0b5fa5", "ArduRover": "#c8501e", "PID": "#7a7a7a", "Kalman PID": "#3a9a3a"}
    colours |= {"LQG": "#000000", "LQG, ready": "#8a4a8a", "LQG, as ours": "#b08a30"}
    for axis, (key, fronts) in zip(axes.flat, shown.items(), strict=False):
        for name, colour in ((name, colours[name]) for name in fronts):
            rms, travel = np.array(fronts[name]).T
            style = {"linestyle": ":"} if name.startswith("LQG") else {"marker": ".", "markersize": 4}
            axis.loglog(travel, rms, color=colour, linewidth=1.0, label=name, **style)
        axis.set_title(" | ".join(key.split(" | ")[:2]), fontsize=8)
        axis.set_xlabel("rudder travel [deg/s]", fontsize=8)
        axis.set_ylabel("heading rms [deg]", fontsize=8)
        axis.set_xlim(0.01, 5.0)
    axes[0, 0].legend(fontsize=7)
    drawn_.savefig(path, dpi=80, metadata={"Software": None})
    pyplot.close(drawn_)


if __name__ == "__main__":
    main()
