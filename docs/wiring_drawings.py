"""The wiring drawings of docs/setups.md: `python docs/wiring_drawings.py` writes docs/images/wiring-NAME.svg.

A drawing is a table: boxes on a grid of columns and rows, and wires between them with what runs on each.
"""

from __future__ import annotations

from html import escape
from pathlib import Path
from typing import NamedTuple

COLUMN, ROW, BOX_WIDTH, BOX_HEIGHT, EDGE = 330.0, 104.0, 206.0, 60.0, 12.0
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
            "radio": Box(0, 1, "RC receiver", "the hand: mode switch, throttle", "hand"),
            "controller": Box(1, 0, "flight controller", "ArduRover, mode MANUAL"),
            "rudder": Box(2, 0, "steering servo", "rudder"),
            "computer": Box(1, 1, "Raspberry Pi", "autopilot run, autopilot web", "norrbin"),
            "phone": Box(2, 1, "phone, ground station", "WiFi", "hand"),
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
            "plotter": Box(0, 1, "chart plotter", "APB, RMB, XTE: optional", "hand"),
            "computer": Box(1, 0, "Raspberry Pi", "autopilot run, autopilot web", "norrbin"),
            "phone": Box(1, 1, "phone", "WiFi", "hand"),
            "drive": Box(2, 0, "Jrk G2, pypilot, Maestro", "motor or servo, rudder sensor"),
            "rudder": Box(2, 1, "rudder", "with a clutch, or a switch", "hand"),
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
            "interface": Box(1, 0, "CAN interface", "socketcan, 250 kbit/s"),
            "drive": Box(2, 0, "rudder drive", "obeys 127245, or has its own line"),
            "computer": Box(1, 1, "Raspberry Pi", "autopilot run, extra n2k", "norrbin"),
            "phone": Box(2, 1, "phone", "WiFi", "hand"),
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
    columns = 1 + max(box.column for box in drawing.boxes.values())
    rows = 1 + max(box.row for box in drawing.boxes.values())
    width = (columns - 1) * COLUMN + BOX_WIDTH + 2 * EDGE
    height = (rows - 1) * ROW + BOX_HEIGHT + 2 * EDGE
    parts = [_wire(drawing, wire) for wire in drawing.wires] + [_box(box) for box in drawing.boxes.values()]
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:.0f} {height:.0f}" role="img" '
        f'aria-label="{escape(drawing.title)}" font-family="system-ui, sans-serif">\n'
        '<defs><marker id="tip" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="7" markerHeight="7" '
        'orient="auto-start-reverse"><path d="M0 0 8 4 0 8z" fill="#4a5664"/></marker></defs>\n'
        f'<rect width="{width:.0f}" height="{height:.0f}" fill="#ffffff" rx="8"/>\n' + "\n".join(parts) + "\n</svg>\n"
    )


def _place(box: Box) -> tuple[float, float]:
    return EDGE + box.column * COLUMN, EDGE + box.row * ROW


def _box(box: Box) -> str:
    left, top = _place(box)
    middle = left + BOX_WIDTH / 2
    return (
        f'<rect x="{left:.0f}" y="{top:.0f}" width="{BOX_WIDTH:.0f}" height="{BOX_HEIGHT:.0f}" rx="6" '
        f'fill="{FILLS[box.kind]}" stroke="#8793a1"/>'
        f'<text x="{middle:.0f}" y="{top + 26:.0f}" text-anchor="middle" font-size="14" font-weight="600" '
        f'fill="#1f2933">{escape(box.name)}</text>'
        f'<text x="{middle:.0f}" y="{top + 45:.0f}" text-anchor="middle" font-size="11" fill="#4a5664">'
        f"{escape(box.does)}</text>"
    )


def _wire(drawing: Drawing, wire: Wire) -> str:
    start, end = drawing.boxes[wire.start], drawing.boxes[wire.end]
    (x1, y1), (x2, y2) = _place(start), _place(end)
    back = ' marker-start="url(#tip)"' if wire.both_ways else ""
    if start.column == end.column:
        x1 = x2 = x1 + BOX_WIDTH / 2
        y1, y2 = y1 + BOX_HEIGHT, y2
        at = f'x="{x1 + 8:.0f}" y="{(y1 + y2) / 2 + 4:.0f}"'
    else:
        # into the side of the next box, at a height of its own for wires that come from another row
        x1, y1, y2 = x1 + BOX_WIDTH, y1 + BOX_HEIGHT / 2, y2 + BOX_HEIGHT / 2 + 10 * (start.row - end.row)
        at = f'x="{(x1 + x2) / 2:.0f}" y="{(y1 + y2) / 2 - 6:.0f}" text-anchor="middle"'
    words = (
        f'<text {at} font-size="11" fill="#1f2933" stroke="#ffffff" stroke-width="4" paint-order="stroke">'
        f"{escape(wire.words)}</text>"
    )
    return (
        f'<line x1="{x1:.0f}" y1="{y1:.0f}" x2="{x2:.0f}" y2="{y2:.0f}" stroke="#4a5664" stroke-width="1.6" '
        f'marker-end="url(#tip)"{back}/>{words}'
    )


if __name__ == "__main__":
    for name, drawing in DRAWINGS.items():
        path = Path(__file__).parent / "images" / f"wiring-{name}.svg"
        path.write_text(drawn(drawing), encoding="utf-8")
        print(f"wrote {path}")
