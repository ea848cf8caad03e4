"""The demo's legs: each is a simulator process of its own, as a user would start it, and a session that steers it.

What they found: JSON, tables for the terminal, figures and report.html.
"""

from __future__ import annotations

import itertools
import math
import shutil
import socket
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import IO, Any, NamedTuple

import numpy as np
import numpy.typing as npt

from autopilot.angles import wrap
from autopilot.cli.terminal import columns
from autopilot.control.registry import TRIAL_LAW
from autopilot.errors import InputError, RefusedError
from autopilot.files.printable import aligned, folded, rewrite_line
from autopilot.files.saving import save_text
from autopilot.identification.identified import Identified, Question
from autopilot.identification.identify import identify
from autopilot.interruption import LEFT
from autopilot.links.base import LinkError
from autopilot.logs.reading import load_run
from autopilot.models.norrbin import Norrbin
from autopilot.operators.trial_script import Step, TrialScript, heading, turning, zigzag
from autopilot.report.page import Line, Opening, Panel, Section, render, time_figure
from autopilot.report.steered import FAIR_PAST_DEG, GOOD_PAST_DEG, Verdict
from autopilot.runtime.app import App, Plan
from autopilot.runtime.build import model_of
from autopilot.runtime.build_links import LinkOptions
from autopilot.runtime.log_files import FileSink
from autopilot.runtime.machine import MonotonicClock
from autopilot.runtime.tuning import designed
from autopilot.signals import HeadingSample, Tick
from autopilot.supervision.panel import sentences_of
from autopilot.vessel.file import dump_vessel, load_vessel, model_section
from autopilot.vessel.schema import Model, Vessel

PACES = (4.0, 2.0, 1.0, 0.5)
"""Simulated seconds per second: with the first the whole demo fits into a minute and a half of a small machine. A leg
that a busy machine has disturbed is sailed again at the next: a second taken from us is then fewer seconds at sea. The
vehicle takes its rudder back after 3 s: at the last pace after 6."""
READY_TIMEOUT = 30.0
STALL = 2.0
"""Wall time [s] that a shared machine may take a process away from us."""
FEWEST_TICKS = 0.5
"""A leg of which the machine left out more than this share of the ticks shows the machine, not the law."""
TURN = math.radians(90.0)
HOLD_SECONDS = 90.0
HOLD_SKIP = 20.0
"""The hold is judged after this time [s]: before it the bias is still being learnt."""
FIRST_GUESS = (0.3, 1.0)
"""K [1/s] and T [s] before the trial: off by more than two, as a first guess is."""

FloatArray = npt.NDArray[np.float64]
Progress = Callable[[int, int], None]
SETTLED = math.radians(1.0)
"""A turn is over when the heading stays within this [rad] of the new one."""


class TurnMeasures(NamedTuple):
    """overshoot [rad] past the new heading, settling [s] until within 1 deg for good (nan: never), travel [rad]."""

    overshoot: float
    settling: float
    travel: float


def turn_measures(ticks: Sequence[Tick], begun: float, start: float, target: float) -> TurnMeasures:
    """Return the measures of a turn ordered at `begun` [s] from heading `start` to `target` [rad]."""
    after = [tick for tick in ticks if tick.now >= begun]
    side = math.copysign(1.0, wrap(target - start))
    errors = [wrap(tick.state.heading - target) for tick in after]
    outside = [tick.now for tick, error in zip(after, errors, strict=True) if abs(error) > SETTLED]
    settled = not outside or outside[-1] < after[-1].now
    return TurnMeasures(
        overshoot=max(0.0, max((side * error for error in errors if abs(error) < 0.5 * math.pi), default=0.0)),
        settling=(outside[-1] - begun if outside else 0.0) if settled else math.nan,
        travel=sum(abs(b.command.angle - a.command.angle) for a, b in itertools.pairwise(after)),
    )


def heading_rms(heading: npt.NDArray[np.float64], target: float) -> float:
    """Return the root mean square [rad] of the headings' errors against `target` [rad]."""
    error = np.angle(np.exp(1j * (heading - target)))
    return float(np.sqrt(np.mean(np.square(error))))


def travel_rate(time: npt.NDArray[np.float64], rudder: npt.NDArray[np.float64]) -> float:
    """Return the rudder's way [rad] per second over a record."""
    return float(np.sum(np.abs(np.diff(rudder))) / (time[-1] - time[0]))


class Leg(NamedTuple):
    """One leg: name, law, steps to sail, scenario, and whether it goes over the serial line."""

    name: str
    law: str
    steps: Sequence[Step]
    scenario: str = "calm"
    serial: bool = False


class Sailed(NamedTuple):
    """A leg that has been sailed: its ticks, when each step began [s], and what the boat really did by column."""

    leg: Leg
    ticks: list[Tick]
    begun: list[float]
    truth: dict[str, FloatArray]


class Hold(NamedTuple):
    """Root mean square of the true heading error [rad] and true rudder travel [rad/s] of a hold."""

    rms: float
    travel: float


class DemoResult(NamedTuple):
    """What the demo found."""

    true: Norrbin
    identified: Identified
    vessel: Vessel
    turns: dict[str, TurnMeasures]
    holds: dict[str, Hold]
    legs: dict[str, Sailed]
    seed: int


def sail_demo(out: Path, seed: int, progress: Progress) -> DemoResult:
    """Sail all legs, identify in between, and put the logs together in demo.tlog."""
    true = _patient(load_vessel("lanxin"))
    guess = _first_guess(true)
    trial_steps = [zigzag(math.radians(15.0), math.radians(15.0), 40.0)]
    trial_steps += [turning(math.radians(angle), 5.0) for angle in (5.0, 10.0, 15.0, 20.0, 25.0, -25.0, -15.0, -5.0)]
    progress(0, 5)
    trial = sail(Leg("trial", TRIAL_LAW, trial_steps), guess, out, seed)
    progress(1, 5)
    run = load_run(str(out / "trial.tlog"))
    # nobody measures this rudder: its record runs ahead of the boat by what an order takes on its way
    found = identify([run], Question(reference_speed=true.model.reference_speed_m_s, rudder_train=("delay",)))
    vessel = designed(_with_model(true, found))
    save_text(out / "identified.yaml", dump_vessel(vessel))
    progress(2, 5)
    turn = [heading(0.0, 6.0), heading(TURN, 22.0)]
    hold = [heading(0.0, HOLD_SECONDS)]
    groups = [
        [
            Leg("turn-backstepping", "backstepping", turn),
            Leg("turn-pid", "pid", turn),
            Leg("turn-serial", "backstepping", turn, serial=True),
        ],
        [
            Leg("sea-backstepping", "backstepping", hold, "sea-state-5"),
            Leg("sea-pid", "pid", hold, "sea-state-5"),
        ],
    ]
    legs = {"trial": trial}
    for done, group in enumerate(groups):
        with ThreadPoolExecutor(len(group)) as pool:
            sailed = pool.map(lambda leg: sail(leg, vessel, out, seed), group)
            legs.update({one.leg.name: one for one in sailed})
        progress(3 + done, 5)
    _join(out, list(legs))
    progress(5, 5)
    return DemoResult(
        true=model_of(true),
        identified=found,
        vessel=vessel,
        turns={name: _turn(legs[name]) for name in ("turn-backstepping", "turn-pid", "turn-serial")},
        holds={name: _hold(legs[name]) for name in ("sea-backstepping", "sea-pid")},
        legs=legs,
        seed=seed,
    )


def sail(leg: Leg, vessel: Vessel, out: Path, seed: int) -> Sailed:
    """Sail a leg, and again, slower, where a busy machine has held up one of the processes for seconds."""
    for pace in PACES[:-1]:
        try:
            return _sail_once(leg, vessel, out, seed, pace)
        except RefusedError as error:
            said = f"{error}: sailed again, slower, as for a busy machine"
            if sys.stderr.isatty():  # over the progress bar
                rewrite_line(sys.stderr, folded(said, columns()), "\n")
            else:
                print(said, file=sys.stderr)
    return _sail_once(leg, vessel, out, seed, PACES[-1])


def _sail_once(leg: Leg, vessel: Vessel, out: Path, seed: int, pace: float) -> Sailed:
    """Start a simulator, steer it through the leg, and stop it. Raises LinkError or RefusedError."""
    folder = Path(tempfile.mkdtemp(prefix="norrbin-"))
    try:
        if leg.serial:
            line = folder / "instruments"
            address = ["--nmea", f"{line}:38400", "--sentences", "HDG:10,ROT:10,RSA:5,VHW:1"]
            url = f"nmea:{line}:38400"
        else:
            port = _free_port()
            address = ["--mavlink", f"udpout:127.0.0.1:{port}"]
            url = f"udpin:127.0.0.1:{port}"
        truth = folder / "truth.csv"
        command = [sys.executable, "-m", "sitl", "serve", "lanxin", *address, "--scenario", leg.scenario]
        command += ["--speedup", f"{pace}", "--seed", f"{seed}", "--truth", str(truth)]
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as simulator:
            LEFT.append(lambda: _leave(simulator, folder))
            try:
                _await_ready(simulator)
                ticks, begun = _steer(leg, vessel, url, out / f"{leg.name}.tlog", pace)
            finally:
                simulator.terminate()
                simulator.communicate()
        return Sailed(leg, ticks, begun, _read_truth(truth))
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _leave(simulator: subprocess.Popen[str], folder: Path) -> None:
    """Leave nothing behind where the demo is ended at once."""
    if simulator.poll() is None:
        simulator.kill()
    shutil.rmtree(folder, ignore_errors=True)


def _steer(leg: Leg, vessel: Vessel, url: str, log: Path, pace: float) -> tuple[list[Tick], list[float]]:
    script = TrialScript(leg.steps)
    ticks: list[Tick] = []
    log.unlink(missing_ok=True)  # of this leg, sailed at a pace that was too quick for this machine
    options, place = LinkOptions(as_gcs=True), partial(FileSink, log)
    plan = Plan(vessel, script, law=leg.law, urls=(url,), options=options, log=place)

    def watch(tick: Tick) -> bool:
        ticks.append(tick)
        return script.is_over

    longest = READY_TIMEOUT * pace + sum(step.duration for step in leg.steps)
    with App(plan, MonotonicClock(pace)) as app:
        app.run(longest, watch)
    if not script.is_complete:
        why = next((said for tick in reversed(ticks) for said in sentences_of(tick.alarms)), "time is up")
        if any(event.name == "disk_full" for tick in ticks for event in tick.alarms):
            raise InputError(f"demo leg {leg.name}: {why}")  # sailed slower it would be no better
        raise RefusedError(f"demo leg {leg.name} ended early: {why}")
    sailed = [tick for tick in ticks if tick.now >= script.begun_at[0]]
    if pace > PACES[-1]:
        if len(sailed) < FEWEST_TICKS * vessel.control.rate_hz * (ticks[-1].now - script.begun_at[0]):
            raise RefusedError(f"demo leg {leg.name}: the machine left most of the ticks out")
        if turned_unseen(sailed) > math.radians(FAIR_PAST_DEG):
            raise RefusedError(f"demo leg {leg.name}: the machine held up the loop in a turn")
    return ticks, script.begun_at


def turned_unseen(ticks: Sequence[Tick]) -> float:
    """Return by how much [rad] the boat turned, at most, from one heading that came to the next.

    So far past its course it goes where that is when its turn should be checked.
    """
    seen = [tick for tick in ticks if any(isinstance(sample, HeadingSample) for sample in tick.samples)]
    turned = ((b.now - a.now) * max(abs(a.state.rate), abs(b.state.rate)) for a, b in itertools.pairwise(seen))
    return max(turned, default=0.0)


def _patient(vessel: Vessel) -> Vessel:
    """The heading may be as old as a busy machine makes it, in simulated time that runs the quicker."""
    return replace(vessel, failsafe=replace(vessel.failsafe, heading_timeout_s=STALL * PACES[0]))


def _first_guess(true: Vessel) -> Vessel:
    gain, time_constant = FIRST_GUESS
    model = Model(gain, time_constant, true.model.reference_speed_m_s, source="a first guess, before any trial")
    return replace(true, model=model)


def _with_model(vessel: Vessel, found: Identified) -> Vessel:
    section = model_section(found.model, found.standard_errors, "autopilot demo: identified from trial.tlog", "")
    return replace(vessel, name=f"{vessel.name} (identified)", model=section)


def _await_ready(simulator: subprocess.Popen[str]) -> None:
    stdout: IO[str] | None = simulator.stdout
    line = stdout.readline() if stdout is not None else ""
    if not line.startswith("ready"):
        simulator.kill()
        _, complaint = simulator.communicate()
        raise LinkError(f"the simulator did not start: {complaint.strip() or line.strip() or 'it said nothing'}")


def _free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def _read_truth(path: Path) -> dict[str, FloatArray]:
    with path.open(encoding="utf-8") as file:
        names = file.readline().strip().split(",")
    table = np.genfromtxt(path, delimiter=",", skip_header=1, invalid_raise=False)
    return {name: table[:, index] for index, name in enumerate(names)}


def _turn(sailed: Sailed) -> TurnMeasures:
    return turn_measures(sailed.ticks, sailed.begun[1], 0.0, TURN)


def _hold(sailed: Sailed) -> Hold:
    """Measure the truth at the end: it ends when the session ended, whatever the start-up took."""
    time = sailed.truth["time_s"]
    part = time >= time[-1] - (HOLD_SECONDS - HOLD_SKIP)
    return Hold(
        heading_rms(sailed.truth["heading_rad"][part], 0.0),
        travel_rate(time[part], sailed.truth["rudder_rad"][part]),
    )


def _join(out: Path, names: Sequence[str]) -> None:
    with (out / "demo.tlog").open("wb") as joined:
        for name in names:
            part = out / f"{name}.tlog"
            joined.write(part.read_bytes())


PARAMETERS = (("K", "gain", "1/s"), ("T", "time_constant", "s"), ("n3", "n3", "s^2/rad^2"), ("n0", "n0", "rad/s"))
TURNS = {
    "turn-backstepping": "backstepping, UDP",
    "turn-pid": "PID, UDP",
    "turn-serial": "backstepping, serial compass",
}
OURS = (TURNS["turn-backstepping"], TURNS["turn-serial"])
MODEL_FORM = (
    "Standard errors know the instruments' noise alone. The speed in the log is that over the ground, slip included; "
    "it makes K 1 % and n3 10 % too large, more than they say."
)
HOLDS = {"sea-backstepping": "backstepping", "sea-pid": "PID"}


def as_json(result: DemoResult) -> dict[str, Any]:
    """Return the result in SI units and degrees where the key says so."""
    found = result.identified
    return {
        "seed": result.seed,
        "parameters": {
            symbol: {
                "true": getattr(result.true, name),
                "identified": getattr(found.model, name),
                "std": found.standard_errors.get(name),
                "unit": unit,
            }
            for symbol, name, unit in PARAMETERS
        },
        "rudder_delay_s": found.train.delay,
        "rudder_delay_std_s": found.standard_errors.get("delay"),
        "unidentifiable": found.unidentifiable,
        "model_form": MODEL_FORM,
        "turn_90_deg_calm": {
            TURNS[name]: {
                "overshoot_deg": math.degrees(turn.overshoot),
                "settling_s": turn.settling if math.isfinite(turn.settling) else None,
                "rudder_travel_deg": math.degrees(turn.travel),
            }
            for name, turn in result.turns.items()
        },
        "hold_sea_state_5": {
            HOLDS[name]: {
                "heading_rms_deg": math.degrees(hold.rms),
                "rudder_travel_deg_s": math.degrees(hold.travel),
            }
            for name, hold in result.holds.items()
        },
    }


SHOWN_HOLD = 60.0
WELL_FOUND = 0.15
"""K and T this near the simulated boat's, relative, are well found: it also drifts and loses speed in turns."""


class DemoFigures(NamedTuple):
    """The ticks to draw: the trial, turns and holds by name."""

    trial: Sequence[Tick]
    turns: dict[str, Sequence[Tick]]
    holds: dict[str, Sequence[Tick]]


def write_demo_report(out: Path, shown: DemoFigures, summary: dict[str, Any]) -> None:
    """Write trial.svg, turn.svg, hold.svg and report.html into the folder `out`."""
    figures = {
        "trial": _trial(shown.trial),
        "turn": _compared(shown.turns, math.inf),
        "hold": _compared(shown.holds, SHOWN_HOLD),
    }
    for name, svg in figures.items():
        save_text(out / f"{name}.svg", svg)
    lead = (
        "A simulated boat sailed a trial over real links; its model was identified from the log, gains were designed "
        "from it, and it steered: over UDP as a MAVLink vehicle, and over a serial line as compass and rudder drive."
    )
    hero = Section("", figure=figures["turn"], caption="a turn of 90 deg in calm water: heading, and rudder ordered")
    page = render(
        Opening("Norrbin demo: from a sea trial to an autopilot", lead, hero, verdict_of_demo(summary)),
        _sections(figures, summary),
        f"autopilot demo --seed {summary['seed']}",
    )
    save_text(out / "report.html", page)


Rows = list[tuple[str, ...]]


def tables_of(summary: dict[str, Any]) -> tuple[Rows, Rows, Rows]:
    """Return what was identified, the turns and the holds as tables, their heads first."""
    parameters: Rows = [("identified", "unit", "true", "found", "standard error", "off by")]
    for name, row in summary["parameters"].items():
        error = "-" if row["std"] is None else f"{row['std']:.4f}"
        off = f"{100.0 * (row['identified'] / row['true'] - 1.0):+.1f} %" if row["true"] else "-"
        parameters.append((name, row["unit"], f"{row['true']:.4f}", f"{row['identified']:z.4f}", error, off))
    turns: Rows = [("turn of 90 deg, calm", "overshoot", "settling to 1 deg", "rudder travel")]
    for name, row in summary["turn_90_deg_calm"].items():
        settling = "never" if row["settling_s"] is None else f"{row['settling_s']:.1f} s"
        turns.append((name, f"{row['overshoot_deg']:.2f} deg", settling, f"{row['rudder_travel_deg']:.1f} deg"))
    holds: Rows = [("hold, sea state 5", "true heading rms", "rudder travel")]
    for name, row in summary["hold_sea_state_5"].items():
        holds.append((name, f"{row['heading_rms_deg']:.2f} deg", f"{row['rudder_travel_deg_s']:.2f} deg/s"))
    return parameters, turns, holds


def verdict_of_demo(summary: dict[str, Any]) -> Verdict:
    """Return how near the identified model is, how the worse of the designed law's turns went with it, and its hold."""
    off = max(
        abs(summary["parameters"][name]["identified"] / summary["parameters"][name]["true"] - 1.0)
        for name in ("K", "T")
    )
    ours = [row for name, row in summary["turn_90_deg_calm"].items() if name in OURS]
    turn = max(ours, key=lambda row: (row["settling_s"] is None, row["overshoot_deg"]))
    hold = next(iter(summary["hold_sea_state_5"].values()))
    settled = turn["settling_s"]
    said = (
        f"K and T found within {max(math.ceil(100.0 * off), 1)} %; a turn of 90 deg "
        f"{'does not settle' if settled is None else f'in {settled:.0f} s'}, {turn['overshoot_deg']:.1f} deg past the "
        f"course; held within {hold['heading_rms_deg']:.1f} deg rms in sea state 5"
    )
    is_good = off <= WELL_FOUND and settled is not None and turn["overshoot_deg"] <= GOOD_PAST_DEG
    return Verdict("good", f"good: {said}") if is_good else Verdict("fair", f"fair: {said}")


def as_text(summary: dict[str, Any]) -> str:
    """Return the tables for a terminal."""
    parameters, turns, holds = (aligned(rows, right=range(1, len(rows[0]))) for rows in tables_of(summary))
    delay, said = summary["rudder_delay_s"], [*summary["unidentifiable"].values(), summary["model_form"]]
    if delay > 0.0:
        said.insert(
            0,
            f"rudder's delay {delay:.3f} s +- {summary['rudder_delay_std_s'] or 0.0:.3f} s: orders on their way, at "
            "four times the pace",
        )
    verdict = verdict_of_demo(summary).sentence
    return "\n".join([verdict, "", *parameters, *(f"  {sentence}" for sentence in said), "", *turns, "", *holds])


def _sections(figures: dict[str, str], summary: dict[str, Any]) -> list[Section]:
    parameters, turns, holds = tables_of(summary)
    note = (
        "Standard errors tell what sensor noise and sea leave open. The simulated boat also loses speed and drifts in "
        "turns, which the model leaves out: the difference to the true values holds that too.",
    )
    return [
        Section("Identified from the trial", parameters, (*summary["unidentifiable"].values(), *note)),
        Section("The trial", figure=figures["trial"], caption="15/15 zigzag, then turns at eight rudder angles"),
        Section("Turn of 90 deg in calm water", turns),
        Section(
            "Hold in sea state 5",
            holds,
            ("The PID has the same proportional and rate gains, and an integral term.",),
            figures["hold"],
            f"the last {SHOWN_HOLD:.0f} s",
        ),
    ]


def _trial(ticks: Sequence[Tick]) -> str:
    time = np.array([tick.now for tick in ticks])
    return time_figure(
        [
            Panel("heading [deg]", [Line("heading", time, _unwrapped_deg([tick.state.heading for tick in ticks]))]),
            Panel("rate [deg/s]", [Line("yaw rate", time, np.degrees([tick.state.rate for tick in ticks]))]),
            Panel("rudder [deg]", [Line("rudder", time, np.degrees([tick.state.rudder for tick in ticks]))]),
        ]
    )


def _compared(legs: dict[str, Sequence[Tick]], last: float) -> str:
    headings: list[Line] = []
    rudders: list[Line] = []
    for name, ticks in legs.items():
        end = ticks[-1].now
        part = [tick for tick in ticks if end - tick.now <= last and tick.command.engaged]
        time = np.array([tick.now for tick in part]) - part[0].now
        if not headings:
            wanted = _unwrapped_deg([tick.reference.heading for tick in part])
            headings.append(Line("reference", time, wanted, wanted=True))
        headings.append(Line(name, time, _unwrapped_deg([tick.state.heading for tick in part])))
        rudders.append(Line(name, time, np.degrees([tick.command.angle for tick in part])))
    return time_figure([Panel("heading [deg]", headings), Panel("rudder [deg]", rudders)])


def _unwrapped_deg(headings: Sequence[float]) -> np.ndarray[Any, np.dtype[np.float64]]:
    return np.degrees(np.unwrap(np.asarray(headings)))
