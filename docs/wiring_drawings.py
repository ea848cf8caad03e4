"""The wiring drawings of docs/setups.md: `python docs/wiring_drawings.py` writes docs/images/wiring-NAME.svg.

A drawing is a table: boxes on a grid of columns and rows, and wires between them with what runs on each.
"""

from __future__ import annotations

from html import escape
from pathlib import Path
from textwrap import wrap
from typing import NamedTuple

BOX, PITCH, EDGE = (152.0, 88.0), (242.0, 142.0), 12.0
"""Of the boxes, across and down. Two of them beside one another are as wide as a phone."""
IN_BOX, ON_WIRE = 19, 12
"""Letters of a line, at most."""
FILLS = {"norrbin": "#dbe9ff", "boat": "#f1f3f5", "hand": "#fff3d6"}


class Box(NamedTuple):
    """A device: its column and row, its name, what it does here, and its kind (a key of `FILLS`)."""

    column: int
    row: int
    name: str
    does: str
    kind: str = "boat"


class Wire(NamedTuple):
    """A line from one box to another, with the words on it; both_ways: data goes back too."""

    start: str
    end: str
    words: str
    both_ways: bool = False


class Drawing(NamedTuple):
    """Boxes by a short name, and the wires between them."""

    title: str
    boxes: dict[str, Box]
    wires: tuple[Wire, ...]


DRAWINGS = {
    "ardurover": Drawing(
        "Companion of a flight controller: ArduRover moves the rudder, Norrbin says where",
        {
            "sensors": Box(0, 0, "GPS and compass", "as ArduPilot wants them"),
            "radio": Box(1, 0, "RC receiver", "the hand: mode switch, throttle", "hand"),
            "controller": Box(0, 1, "flight controller", "ArduRover, mode MANUAL"),
            "rudder": Box(0, 2, "steering servo", "rudder"),
            "computer": Box(1, 1, "Raspberry Pi", "autopilot run, autopilot web", "norrbin"),
            "phone": Box(1, 2, "phone, ground station", "WiFi", "hand"),
        },
        (
            Wire("sensors", "controller", "GPS, I2C"),
            Wire("radio", "controller", "SBUS, CRSF"),
            Wire("controller", "rudder", "SERVO1, PWM"),
            Wire("controller", "computer", "TELEM2: TX to pin 10, RX to pin 8, GND to 6", True),
            Wire("computer", "phone", "HTTP, MAVLink", True),
        ),
    ),
    "nmea0183": Drawing(
        "Stand-alone: compass in, rudder drive out",
        {
            "compass": Box(0, 0, "compass", "HDG, HDM, HDT, ROT"),
            "plotter": Box(1, 0, "chart plotter", "APB, RMB, XTE: optional", "hand"),
            "computer": Box(0, 1, "Raspberry Pi", "autopilot run, autopilot web", "norrbin"),
            "phone": Box(1, 1, "phone", "WiFi", "hand"),
            "drive": Box(0, 2, "Jrk G2, pypilot, Maestro", "motor or servo, rudder sensor"),
            "rudder": Box(1, 2, "rudder", "with a clutch, or a switch", "hand"),
        },
        (
            Wire("compass", "computer", "RS-422 to USB"),
            Wire("plotter", "computer", "RS-422, TCP"),
            Wire("computer", "drive", "USB", True),
            Wire("drive", "rudder", "motor, feedback", True),
            Wire("computer", "phone", "HTTP", True),
        ),
    ),
    "nmea2000": Drawing(
        "On an NMEA 2000 backbone",
        {
            "compass": Box(0, 0, "compass, rudder sensor", "127250, 127251, 127245"),
            "interface": Box(0, 1, "CAN interface", "socketcan, 250 kbit/s"),
            "drive": Box(0, 2, "rudder drive", "obeys 127245, or has its own line"),
            "computer": Box(1, 1, "Raspberry Pi", "autopilot run, extra n2k", "norrbin"),
            "phone": Box(1, 2, "phone", "WiFi", "hand"),
        },
        (
            Wire("compass", "interface", "backbone"),
            Wire("interface", "drive", "backbone"),
            Wire("interface", "computer", "USB, SPI", True),
            Wire("computer", "phone", "HTTP", True),
        ),
    ),
}


def drawn(drawing: Drawing) -> str:
    """Return the drawing as SVG."""
    right = max(_place(box)[0] for box in drawing.boxes.values()) + BOX[0] + EDGE
    bottom = max(_place(box)[1] for box in drawing.boxes.values()) + BOX[1] + EDGE
    parts = [_wire(drawing, wire) for wire in drawing.wires] + [_box(box) for box in drawing.boxes.values()]
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {right:.0f} {bottom:.0f}" role="img" '
        f'aria-label="{escape(drawing.title)}" font-family="system-ui, sans-serif">\n'
        '<defs><marker id="tip" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="7" markerHeight="7" '
        'orient="auto-start-reverse"><path d="M0 0 8 4 0 8z" fill="#4a5664"/></marker></defs>\n'
        f'<rect width="{right:.0f}" height="{bottom:.0f}" fill="#ffffff" rx="8"/>\n' + "\n".join(parts) + "\n</svg>\n"
    )


def _place(box: Box) -> tuple[float, float]:
    return EDGE + box.column * PITCH[0], EDGE + box.row * PITCH[1]


def _text(lines: list[str], x: float, y: float, size: float, style: str) -> str:
    """Return lines of text, the middle of them all at y."""
    first = y + 0.35 * size - 0.6 * size * (len(lines) - 1)
    spans = (
        f'<tspan x="{x:.0f}" y="{first + 1.2 * size * at:.0f}">{escape(line)}</tspan>' for at, line in enumerate(lines)
    )
    return f'<text font-size="{size:g}" fill="#1f2933" {style}>{"".join(spans)}</text>'


def _box(box: Box) -> str:
    left, top = _place(box)
    (width, height), middle = BOX, left + BOX[0] / 2
    return (
        f'<rect x="{left:.0f}" y="{top:.0f}" width="{width:.0f}" height="{height:.0f}" rx="6" '
        f'fill="{FILLS[box.kind]}" stroke="#8793a1"/>'
        + _text(wrap(box.name, IN_BOX), middle, top + 0.34 * height, 14, 'text-anchor="middle" font-weight="600"')
        + _text(wrap(box.does, IN_BOX), middle, top + 0.7 * height, 12.5, 'text-anchor="middle"')
    )


def _wire(drawing: Drawing, wire: Wire) -> str:
    start, end = drawing.boxes[wire.start], drawing.boxes[wire.end]
    (x1, y1), (x2, y2) = _place(start), _place(end)
    words, style = wrap(wire.words, ON_WIRE), 'stroke="#ffffff" stroke-width="4" paint-order="stroke"'
    if start.row == end.row:
        y1 = y2 = y1 + BOX[1] / 2
        x1 += BOX[0]
        # above the wire; of several lines half stands below
        said = _text(words, (x1 + x2) / 2, y1 - (10 if len(words) == 1 else 0), 12.5, f'text-anchor="middle" {style}')
    else:
        # into the top of the next box, at a place of its own for wires that come from another column
        x1, y1 = x1 + BOX[0] / 2, y1 + BOX[1]
        x2 += BOX[0] / 2 + 10 * (start.column - end.column)
        if x1 == x2:
            said = _text(words, x1 + 8, (y1 + y2) / 2, 12.5, style)
        else:
            # where it comes from it lies apart from the others
            x, y = x1 + (x2 - x1) / 4, y1 + (y2 - y1) / 4
            said = _text([wire.words], x, y, 12.5, f'text-anchor="middle" {style}')
    back = ' marker-start="url(#tip)"' if wire.both_ways else ""
    return (
        f'<line x1="{x1:.0f}" y1="{y1:.0f}" x2="{x2:.0f}" y2="{y2:.0f}" stroke="#4a5664" stroke-width="1.6" '
        f'marker-end="url(#tip)"{back}/>{said}'
    )


if __name__ == "__main__":
    for name, drawing in DRAWINGS.items():
        path = Path(__file__).parent / "images" / f"wiring-{name}.svg"
        path.write_text(drawn(drawing), encoding="utf-8")
        print(f"wrote {path}")
