"""The README's moving picture: the demo's own logs, drawn as an SVG that plays in a browser.

    autopilot demo --out demo && python benchmarks/moving_picture.py demo [--out docs/images/demo.svg]

Three panels, beside one another, and for a phone one below the other in a second picture (demo-narrow.svg): the zigzag
as recorded, the identified model's yaw rate over the recorded one, and the turn and hold that follow from it. All lines
are ticks of the demo's logs, thinned out; the model's rate is integrated here from the recorded rudder. It begins with
the finished picture, each panel of which stays until it is drawn again. Readers who prefer no motion see that alone.
"""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

from autopilot.files.saving import save_text
from autopilot.models.norrbin import Norrbin, at_speed, yaw_acceleration
from autopilot.runtime.build import model_of
from autopilot.runtime.record import read_log
from autopilot.signals import Tick
from autopilot.vessel.file import load_vessel

PANEL, GAP, TOP, HEIGHT = 300.0, 20.0, 64.0, 150.0
SHOWN_S = 40.0
POINTS = 220
CYCLE_S = 12.0
COLOURS = {"heading": "#2f6fdb", "rudder": "#d2691e", "reference": "#7a8699", "recorded": "#9aa5b1", "model": "#c2255c"}

Points = list[tuple[float, float]]


class Trace(NamedTuple):
    """A line of a panel: what it shows, its points (time [s], value), and the unit, of which each has one scale."""

    name: str
    points: Points
    unit: str


class Scene(NamedTuple):
    """A panel: its heading, the sentence below it, its lines (drawn over one another, with one scale a unit), and when
    in the cycle it is drawn [shares]."""

    title: str
    caption: str
    traces: tuple[Trace, ...]
    begins: float
    ends: float


def part_of(ticks: Sequence[Tick], begins: float, lasts: float) -> list[Tick]:
    """Return the engaged ticks from `begins` [s] after the first engaged one, for `lasts` [s]."""
    engaged = [tick for tick in ticks if tick.command.engaged]
    first = engaged[0].now + begins
    return [tick for tick in engaged if first <= tick.now <= first + lasts]


def trace(name: str, unit: str, ticks: Sequence[Tick], values: Sequence[float]) -> Trace:
    """Return a line, thinned out to about `POINTS` points; angles in degrees."""
    every = max(1, len(ticks) // POINTS)
    points = [(tick.now - ticks[0].now, value) for tick, value in zip(ticks, values, strict=True)]
    return Trace(name, [(time, math.degrees(value)) for time, value in points[::every]], unit)


def unwrapped(angles: Sequence[float]) -> list[float]:
    """Return headings [rad] without jumps at north."""
    smooth = [angles[0]]
    for angle in angles[1:]:
        smooth.append(smooth[-1] + math.remainder(angle - smooth[-1], math.tau))
    return smooth


def modelled(model: Norrbin, ticks: Sequence[Tick]) -> list[float]:
    """Return the yaw rate [rad/s] that the model makes of the recorded rudder and speed, from the first tick's rate."""
    rates = [ticks[0].state.rate]
    for tick, after in pairwise(ticks):
        here = at_speed(model, tick.state.speed)
        rates.append(rates[-1] + (after.now - tick.now) * yaw_acceleration(here, rates[-1], tick.state.rudder))
    return rates


def scenes_of(folder: Path) -> tuple[Scene, ...]:
    """Return the panels of a demo's folder."""
    found = json.loads((folder / "demo.json").read_text(encoding="utf-8"))
    zigzag = part_of(read_log(folder / "trial.tlog").ticks, 0.0, SHOWN_S)
    model = model_of(load_vessel(folder / "identified.yaml"))
    turn = part_of(read_log(folder / "turn-backstepping.tlog").ticks, 0.0, 20.0)
    summary = found["turn_90_deg_calm"]["backstepping, UDP"]
    hold = found["hold_sea_state_5"]["backstepping"]
    return (
        Scene(
            "1  Sail a zigzag",
            f"{SHOWN_S:.0f} s of a 15/15 zigzag, over MAVLink",
            (
                trace("heading", "heading", zigzag, unwrapped([tick.state.heading for tick in zigzag])),
                trace("rudder", "rudder", zigzag, [tick.state.rudder for tick in zigzag]),
            ),
            0.10,
            0.32,
        ),
        Scene(
            "2  Identify the boat",
            f"K {model.gain:.3f} 1/s, T {model.time_constant:.3f} s, n3 {model.n3:.2f} s²/rad²",
            (
                trace("recorded", "rate", zigzag, [tick.state.rate for tick in zigzag]),
                trace("model", "rate", zigzag, modelled(model, zigzag)),
            ),
            0.36,
            0.56,
        ),
        Scene(
            "3  Let it steer",
            f"90° turn: {summary['overshoot_deg']:.1f}° past; sea state 5: {hold['heading_rms_deg']:.1f}° rms",
            (
                trace("reference", "heading", turn, unwrapped([tick.reference.heading for tick in turn])),
                trace("heading", "heading", turn, unwrapped([tick.state.heading for tick in turn])),
                trace("rudder", "rudder", turn, [tick.command.angle for tick in turn]),
            ),
            0.60,
            0.86,
        ),
    )


def drawn(scene: Scene, place: tuple[float, float], number: int) -> str:
    """Return the panel as SVG, its corner at `place`."""
    lasts = max(point[0] for each in scene.traces for point in each.points)
    scales = {}
    for unit in {each.unit for each in scene.traces}:
        values = [value for each in scene.traces if each.unit == unit for _, value in each.points]
        low, high = min(values), max(values)
        # the rudder keeps to the lower third where a heading is above it
        if unit == "rudder":
            bottom, top = TOP + HEIGHT, TOP + 0.64 * HEIGHT
        else:
            bottom, top = TOP + (0.58 if len({each.unit for each in scene.traces}) > 1 else 0.95) * HEIGHT, TOP
        scales[unit] = (low, (bottom - top) / max(high - low, 1e-6), bottom)
    parts = [
        f'<text y="26" class="title">{scene.title}</text>',
        f'<text y="46" class="caption">{scene.caption}</text>',
        f'<rect y="{TOP - 6:.0f}" width="{PANEL:.0f}" height="{HEIGHT + 12:.0f}" class="panel"/>',
    ]
    for at, each in enumerate(scene.traces):
        low, scale, bottom = scales[each.unit]
        line = " ".join(
            f"{6 + (PANEL - 12) * time / lasts:.1f},{bottom - scale * (value - low):.1f}" for time, value in each.points
        )
        colour = COLOURS[each.name]
        parts.append(f'<polyline points="{line}" pathLength="1" class="line s{number}" stroke="{colour}"/>')
        parts.append(
            f'<text x="{8 + 84 * at}" y="{TOP + HEIGHT + 24:.0f}" class="name" fill="{colour}">{each.name}</text>'
        )
    return "\n".join([f'<g transform="translate({place[0]:.0f} {place[1]:.0f})">', *parts, "</g>"])


def picture(scenes: Sequence[Scene], *, narrow: bool) -> str:
    """Return the whole picture; narrow: one panel below the other."""
    step = (0.0, TOP + HEIGHT + 34) if narrow else (PANEL + GAP, 0.0)
    width, height = PANEL + 2.0 * step[0], TOP + HEIGHT + 34 + 2.0 * step[1]
    moves = "\n".join(
        f"@keyframes draw{number} {{ 0%, {100 * scene.begins:.0f}% {{ stroke-dashoffset: 0 }} "
        f"{100 * scene.begins + 0.01:.2f}% {{ stroke-dashoffset: 1 }} "
        f"{100 * scene.ends:.0f}%, 100% {{ stroke-dashoffset: 0 }} }}\n"
        f".s{number} {{ animation: draw{number} {CYCLE_S:.0f}s linear infinite }}"
        for number, scene in enumerate(scenes)
    )
    panels = "\n".join(
        drawn(scene, (number * step[0], number * step[1]), number) for number, scene in enumerate(scenes)
    )
    return f"""<svg xmlns="http://www.w3.org/2000/svg" viewBox="-6 0 {width + 12:.0f} {height:.0f}" role="img"
  aria-label="A zigzag is sailed, the model identified from it, and the boat turned and held">
<style>
text {{ font-family: system-ui, "Segoe UI", sans-serif }}
.title {{ font-size: 17px; font-weight: 600; fill: #39424e }}
.caption, .name {{ font-size: 12.5px }}
.caption {{ fill: #5b6675 }}
.panel {{ fill: #f6f8fa; stroke: #d5dbe3 }}
.line {{ fill: none; stroke-width: 2; stroke-linejoin: round; stroke-dasharray: 1 }}
{moves}
@media (prefers-color-scheme: dark) {{
  .title {{ fill: #e6edf3 }} .caption {{ fill: #a6b1bd }} .panel {{ fill: #161b22; stroke: #30363d }} }}
@media (prefers-reduced-motion: reduce) {{ .line {{ animation: none }} }}
</style>
{panels}
</svg>
"""


def main() -> None:
    """Draw it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="what `autopilot demo --out` wrote")
    parser.add_argument("--out", type=Path, default=Path("docs/images/demo.svg"))
    chosen = parser.parse_args()
    scenes = scenes_of(chosen.folder)
    narrow_out = chosen.out.with_name(f"{chosen.out.stem}-narrow.svg")
    for out in (chosen.out, narrow_out):
        text = picture(scenes, narrow=out is narrow_out)
        save_text(out, text)
        print(f"wrote {out}: {len(text) / 1000:.0f} kB")


if __name__ == "__main__":
    main()
