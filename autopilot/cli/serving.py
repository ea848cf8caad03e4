"""`autopilot run --serve` and `--route`: the options, and the route that is followed when it is ordered."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from autopilot.cli.options import SYSTEM_ID
from autopilot.errors import InputError
from autopilot.files.outside import read_regular
from autopilot.guidance.track import TrackGuide
from autopilot.links.ground_station.mission import Mission, MissionItem, parse_items
from autopilot.links.url import parse_url
from autopilot.runtime.app import mission_file
from autopilot.runtime.build_links import Stations

ROUTE_MOST_BYTES = 1 << 20


def add_serving_options(parser: argparse.ArgumentParser) -> None:
    """Add `--serve` and `--system`."""
    parser.add_argument(
        "--serve",
        action="append",
        default=[],
        metavar="URL",
        help="be a MAVLink surface boat for ground stations: udpout:127.0.0.1:14550, tcpin:127.0.0.1:5762; repeatable",
    )
    parser.add_argument(
        "--system", action=SYSTEM_ID, default=1, metavar="ID", help="Norrbin's system id for --serve (default 1)"
    )


def stations_of(arguments: argparse.Namespace) -> Stations:
    """Return the ground stations that the options name. Raises InputError."""
    for url in arguments.serve:
        if parse_url(url).protocol != "mavlink":
            raise InputError(f"--serve {url}: ground stations speak MAVLink; write it like udpout:127.0.0.1:14550")
    return Stations(tuple(arguments.serve), arguments.system)


def load_mission(vessel_path: str, route: Path | None) -> Mission:
    """Return the route of a file, or as an earlier run has left it; it is followed only when that is ordered.

    Raises InputError where the file named is none; one that was left is said and not used.
    """
    kept = mission_file(vessel_path)
    items: tuple[MissionItem, ...] = ()
    if route is not None:
        items = _read(route)
    elif kept.exists():
        try:
            items = _read(kept)
        except InputError as error:
            print(f"the route of an earlier run is not used: {error}", file=sys.stderr)
    if items:
        print(f"route of {len(items)} waypoints from {route or kept}; followed when `t` is typed or mode AUTO is set")
    return Mission(TrackGuide(), items)


def _read(path: Path) -> tuple[MissionItem, ...]:
    try:
        return parse_items(read_regular(path, ROUTE_MOST_BYTES).decode(), str(path))
    except OSError as error:
        raise InputError(f"route {path}: {error.strerror}; give a waypoint file that can be read") from error
    except UnicodeDecodeError:
        raise InputError(f"route {path}: not a text; give a waypoint file") from None
