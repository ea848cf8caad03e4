"""The helm as lines of text: what a terminal of a given size shows, and what each line is like. Pure."""

from __future__ import annotations

import math
from collections.abc import Sequence
from textwrap import wrap
from typing import Any, Literal, NamedTuple

from autopilot.angles import compass_text
from autopilot.web.station import Station
from autopilot.web.view import MODE_NAMES

Style = Literal["plain", "dim", "strong", "on", "alarm", "bad"]

DIGITS = {
    "0": ("█▀█", "█ █", "█▄█"), "1": ("▀█ ", " █ ", "▄█▄"), "2": ("▀▀█", "█▀▀", "█▄▄"), "3": ("▀▀█", " ▀█", "▄▄█"),
    "4": ("█ █", "▀▀█", "  █"), "5": ("█▀▀", "▀▀█", "▄▄█"), "6": ("█▀▀", "█▀█", "█▄█"), "7": ("▀▀█", "  █", "  █"),
    "8": ("█▀█", "█▀█", "█▄█"), "9": ("█▀█", "▀▀█", "▄▄█"), "-": ("   ", "▀▀▀", "   "),
}  # fmt: skip
CARDINALS = {0: "N", 90: "E", 180: "S", 270: "W"}
RUDDER_SHOWN_DEG = 40.0
DEG_PER_CELL = 2.0
STALE_S = {"beat": 3.0, "attitude": 1.5, "rudder": 2.0, "speed": 3.0, "navigation": 3.0, "wind": 5.0}
BLINK_S = 0.6
ALARM_LINES = 3
NOT_TAKEN = "not taken"
SPARKS = "▁▂▃▄▅▆▇█"
KEYS = (
    " Esc RELEASE  ←→ 1°  ⇧←→ 10°  e heading  w W wind  t route  s standby  d D dodge",
    " 1-9 response  b back  k tack g gybe y n  M overboard  a A l alarms  : more  q leave",
)
KEYS_LOOKING = (" view only  l history  q leave",)
STATES = {5: "FAIL-SAFE", 6: "FAULT"}
PROPOSALS = {1.0: "proposed, being tried", 2.0: "proved: :adopt steers with it"}


class Line(NamedTuple):
    """One line of the screen and what it is like."""

    text: str
    style: Style = "plain"


def screen(
    station: Station, now: float, size: tuple[int, int], trouble: str = "", said: str = "", may: bool = True
) -> list[Line]:
    """Return the lines at `now` [s] for a terminal of `size` (columns, rows); never longer, never wider.

    `trouble`: why the link is down.  `said`: what was answered last, or what is being typed.
    """
    width, height = size
    shown = station.view.snapshot(now)
    lines = [*_head(shown, trouble, station), *_overboard(shown), *_alarms(station, now, width)]
    lines += _middle(shown, width) if width >= 40 else _narrow(shown)
    lines += [*_tape(shown, width), *_rudder(shown, width), *_wind(shown), *_trends(station, width)]
    lines += [*_trial(station), *_learning(station)]
    foot = [Line(f" {said}", "strong"), *(Line(keys, "dim") for keys in (KEYS if may else KEYS_LOOKING))]
    room = max(0, height - len(foot))
    lines = [*lines[:room], *[Line("")] * (room - len(lines)), *foot][-height:]
    return [Line(line.text[:width], line.style) for line in lines]


def _head(shown: dict[str, Any], trouble: str, station: Station) -> list[Line]:
    age = shown["ages"].get("beat")
    if trouble:
        return [Line(f" LINK DOWN  {trouble}", "bad")]
    if age is None:
        return [Line(" NO BOAT YET  is autopilot run --serve started, towards this machine?", "alarm")]
    if age > STALE_S["beat"]:
        return [Line(f" NO DATA for {age:.0f} s: what you see is old", "bad")]
    if not shown["ours"]:
        return [Line(" another kind of autopilot: view only", "alarm")]
    mode = STATES.get(shown["status"], shown["mode"].upper())
    steers = shown["mode"] != "standby"
    before, back = station.course.before, ""
    if before is not None:
        side = "P" if before < 0.0 else "S"
        angle = f"{abs(before):.0f}°{side}" if shown["mode"] == "wind" else f"{_course(before)}°"
        back = f"   back to {angle}: b"
    style: Style = "bad" if shown["status"] in STATES else "on" if steers else "strong"
    return [Line(f" {mode} {'' if steers else ' you steer'}{back}", style)]


def _alarms(station: Station, now: float, width: int) -> list[Line]:
    """The alarms, the most urgent first; what sounds is lit up by turns."""
    lines = []
    for each in station.alarms.active:
        style: Style
        style, mark, after = "dim" if each["acknowledged"] else "plain", "  ", ""
        if each["acknowledged"]:
            after = "  (acknowledged)"
        elif each["sounds"]:
            lit: Style = "alarm" if each["priority"] == "warning" else "bad"
            style, mark = (lit if int(now / BLINK_S) % 2 == 0 else "strong"), " !"
        words = wrap(f"{each['priority'].upper()} {each['words']}{after}", max(10, width - 4))
        lines += [
            Line(f"{mark if place == 0 else '  '} {part}", style) for place, part in enumerate(words[:ALARM_LINES])
        ]
    return lines


def history(station: Station, now: float, size: tuple[int, int]) -> list[Line]:
    """Return what has happened, the newest first: alarms with their times, then orders and who gave them."""
    width, height = size
    head = Line(" alarms: raised, acknowledged, cleared", "strong")
    lines = [
        Line(
            f" {_ago(now, each.raised)} {_ago(now, each.acknowledged)} {_ago(now, each.cleared)}  "
            f"{each.priority.upper()} {each.words}",
            "dim" if each.cleared is not None else "plain",
        )
        for each in reversed(station.alarms.history)
    ]
    given = [
        Line(
            f" {_ago(now, each.time)}  {each.who}: {each.what}{'' if each.taken else f'  {NOT_TAKEN} {each.words}'}",
            "plain" if each.taken else "dim",
        )
        for each in reversed(station.journal.entries)
    ]
    half = max(2, (height - 1) // 2)
    lines = [head, *(lines or [Line(" none", "dim")])][:half]
    lines += [Line(" orders", "strong"), *(given or [Line(" none", "dim")])][: max(0, height - 1 - len(lines))]
    lines += [Line("")] * (height - 1 - len(lines)) + [Line(" l back to the helm", "dim")]
    return [Line(line.text[:width], line.style) for line in lines[-height:]]


def _ago(now: float, time: float | None) -> str:
    """How long ago a time [s] was, in eight characters."""
    if time is None:
        return "      --"
    seconds = max(0.0, now - time)
    return (
        f"{seconds:4.0f} s -" if seconds < 100.0 else f"{seconds / 60.0:2.0f} min -" if seconds < 6000.0 else " earlier"
    )


def _facts(shown: dict[str, Any]) -> list[str]:
    steers = shown["mode"] in (MODE_NAMES[15], MODE_NAMES[10], MODE_NAMES[1])
    order = shown.get("order") if steers else None
    rate, rudder, ordered = shown.get("rate"), shown.get("rudder"), shown.get("rudder_order")
    ticks, gap = shown.get("hz"), shown.get("gap")
    xte = shown.get("xte") if shown["mode"] == MODE_NAMES[10] else None
    facts = [
        f"order    {_course(order, 1)}°" if order is not None else "order     --",
        f"turn    {rate:+5.1f}°/s" if rate is not None else "turn      --",
        f"rudder  {_sided(rudder)}   ordered {_sided(ordered)}",
        f"speed   {shown['speed']:5.1f} kn" if shown.get("speed") is not None else "speed     --",
    ]
    facts[1] += f"    off track {_sided(xte)} m" if xte is not None else ""
    facts[3] += f"    loop {ticks:.0f} Hz, longest gap {gap:.0f} ms" if ticks is not None and gap is not None else ""
    old = [f"{group} {age:.0f} s old" for group, age in shown["ages"].items() if age > STALE_S.get(group, math.inf)]
    return [*facts, "  ".join(old)]


def _course(degrees: float | None, decimals: int = 0) -> str:
    return "---" if degrees is None else compass_text(math.radians(degrees), decimals)


def _overboard(shown: dict[str, Any]) -> list[Line]:
    """Where somebody went overboard: kept while nothing comes, not once the boat has spoken without it."""
    age = shown["ages"].get("mob", math.inf)
    if age - shown["ages"].get("beat", 0.0) > STALE_S["navigation"]:
        return []
    bearing, distance, since = (shown.get(f"mob_{name}") for name in ("bearing", "distance", "since"))
    seen = f"{_course(bearing)}°  {_whole(distance)} m  {_whole(since)} s ago"
    old = " (old)" if age > STALE_S["navigation"] else ""
    return [Line(f" MAN OVERBOARD  {seen}{old}  (:mob_off ends it)", "bad")]


def _wind(shown: dict[str, Any]) -> list[Line]:
    """The wind off the bow, true where it is known, and the angle of it that is held."""
    if shown["ages"].get("wind", math.inf) > STALE_S["wind"] or shown.get("awa") is None:
        return []
    kind = "true" if shown.get("wind_true") else "apparent"
    held = f"  held {_sided(shown['wind_angle'])} {kind}" if shown.get("wind_angle") is not None else ""
    true = f"  true {_sided(shown['twa'])} {_whole(shown.get('tws'))} kn" if shown.get("twa") is not None else ""
    return [
        Line(f" wind {_sided(shown['awa'])} {_whole(shown.get('aws'))} kn{true}{held}", "strong" if held else "plain")
    ]


def _middle(shown: dict[str, Any], width: int) -> list[Line]:
    heading = shown.get("heading")
    digits = _course(heading)
    stale = shown["ages"].get("attitude", math.inf) > STALE_S["attitude"]
    facts = _facts(shown)
    rows = [" ".join(DIGITS[digit][row] for digit in digits) for row in range(3)]
    style: Style = "dim" if stale else "strong"
    blank = " " * len(rows[0])
    return [
        Line(""),
        *(Line(f"  {row}    {fact}", style) for row, fact in zip(rows, facts[:3], strict=True)),
        Line(f"  {blank}    {facts[3]}", style),
        Line(f"  {facts[4]}", "alarm" if facts[4] else "plain"),
    ]


def _narrow(shown: dict[str, Any]) -> list[Line]:
    heading = shown.get("heading")
    first = f" heading {_course(heading, 1)}°" if heading is not None else " heading --"
    return [Line(first, "strong"), *(Line(f" {fact}") for fact in _facts(shown) if fact)]


def _tape(shown: dict[str, Any], width: int) -> list[Line]:
    """A strip of the compass card under the lubber line, with the order on it."""
    heading, order = shown.get("heading"), shown.get("order")
    cells, half = max(1, width - 2), max(1, width - 2) // 2
    if heading is None:
        return []
    card, marks = [" "] * cells, [" "] * cells
    for angle in range(0, 360, 10):
        place = half + round(math.remainder(angle - heading, 360.0) / DEG_PER_CELL)
        label = CARDINALS.get(angle, f"{angle:03d}" if angle % 30 == 0 else "·")
        for offset, letter in enumerate(label, -(len(label) // 2)):
            if 0 <= place + offset < cells:
                card[place + offset] = letter
    marks[half] = "┃"
    if order is not None and shown["mode"] != "standby":
        place = half + round(math.remainder(order - heading, 360.0) / DEG_PER_CELL)
        marks[min(max(place, 0), cells - 1)] = "▼"
    return [Line(f" {''.join(marks)}", "strong"), Line(f" {''.join(card)}")]


def _rudder(shown: dict[str, Any], width: int) -> list[Line]:
    rudder, ordered = shown.get("rudder"), shown.get("rudder_order")
    half = max(1, (width - 12) // 2)
    if rudder is None:
        return []

    def place(angle: float) -> int:
        return half + round(min(max(angle / RUDDER_SHOWN_DEG, -1.0), 1.0) * half)

    bar = ["─"] * (2 * half + 1)
    low, high = sorted((half, place(rudder)))
    bar[low : high + 1] = "█" * (high - low + 1)
    bar[half] = "┼" if low == high else "█"
    if ordered is not None:
        bar[place(ordered)] = "▲"
    return [Line(""), Line(f" port {''.join(bar)} stb")]


def _trends(station: Station, width: int) -> list[Line]:
    """The last minutes of rudder and heading error, one sign for each half second."""
    rows = list(station.view.history)[-max(1, width - 12) :]
    if len(rows) < 2:
        return []
    errors = [
        math.remainder(row[1] - row[3], 360.0) if row[1] is not None and row[3] is not None else None for row in rows
    ]
    lines = [Line(""), Line(f" rudder    {_sparks([row[4] for row in rows], 5.0)}", "dim")]
    if any(error is not None for error in errors):
        lines.append(Line(f" off order {_sparks(errors, 2.0)}", "dim"))
    return lines


def _sparks(values: Sequence[float | None], least: float) -> str:
    most = max([least, *(abs(value) for value in values if value is not None)])
    top = len(SPARKS) - 1
    return "".join(" " if value is None else SPARKS[round((value / most + 1.0) / 2.0 * top)] for value in values)


def _trial(station: Station) -> list[Line]:
    trial = station.view.trial
    if trial is None:
        return []
    under_way = trial.result == 5
    words = f"{trial.percent} %   (:cancel ends it)" if under_way else "done" if trial.result == 0 else "ended early"
    return [Line(f" trial: {words}", "on" if under_way else "dim")]


def _learning(station: Station) -> list[Line]:
    learnt = station.view.learning()
    if not learnt:
        return []
    words = PROPOSALS.get(learnt.get("lrn_state") or 0.0, "learning")
    gain, time = learnt.get("lrn_K"), learnt.get("lrn_T")
    numbers = f"   K {gain:.3g} 1/s, T {time:.3g} s" if gain is not None and time is not None else ""
    return [Line(f" model: {words}{numbers}", "dim")]


def _whole(value: float | None) -> str:
    """A number whose message may have been lost, of several that belong together."""
    return "--" if value is None else f"{value:.0f}"


def _sided(value: float | None) -> str:
    if value is None:
        return "  --  "
    return f"{abs(value):4.1f}{' ' if abs(value) < 0.05 else 'P' if value < 0.0 else 'S'}"
