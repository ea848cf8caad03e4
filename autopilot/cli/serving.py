"""`autopilot run --serve`: the running pilot as a MAVLink boat for ground stations, its numbers tuned from there."""

from __future__ import annotations

import argparse
import sys
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple

from autopilot.errors import InputError
from autopilot.links.base import Link
from autopilot.links.boat.boat_link import BoatLink
from autopilot.links.boat.commands import Commands, Helmsman
from autopilot.links.boat.parameter_server import ParameterServer
from autopilot.links.signing import Signing
from autopilot.links.url import open_transport, parse_url
from autopilot.loop.vessel_in_force import VesselInForce, tuned_file
from autopilot.params.saving import save_text
from autopilot.params.vessel import Vessel
from autopilot.pilot import Pilot

SYSTEM_MAX = 255


class Serving(NamedTuple):
    """What `--serve` asks for: where, under which system id, and who carries out what is ordered there."""

    urls: tuple[str, ...]
    system: int
    helmsman: Helmsman
    armed: bool


def add_serving_options(parser: argparse.ArgumentParser) -> None:
    """Add `--serve` and `--system`."""
    parser.add_argument(
        "--serve",
        action="append",
        default=[],
        metavar="URL",
        help="be a MAVLink surface boat for ground stations: udpout:127.0.0.1:14550, tcpin:127.0.0.1:5762; repeatable",
    )
    parser.add_argument("--system", type=int, default=1, metavar="ID", help="our system id for --serve (default 1)")


def serving_of(arguments: argparse.Namespace, helmsman: Helmsman, armed: bool) -> Serving:
    """Return what the options ask for. Raises InputError."""
    if not 1 <= arguments.system <= SYSTEM_MAX:
        raise InputError(f"--system {arguments.system}: a system id from 1 to {SYSTEM_MAX} is allowed")
    for url in arguments.serve:
        if parse_url(url).protocol != "mavlink":
            raise InputError(f"--serve {url}: ground stations speak MAVLink; write it like udpout:127.0.0.1:14550")
    return Serving(tuple(arguments.serve), arguments.system, helmsman, armed)


class BackgroundSaver:
    """Saves files from a thread of its own: flushing to a memory card takes longer than a tick."""

    def __init__(self) -> None:
        self._pool = ThreadPoolExecutor(1, thread_name_prefix="save")

    def __call__(self, path: Path, text: str) -> None:
        """Save soon; what goes wrong is said on the terminal."""
        self._pool.submit(save_text, path, text).add_done_callback(_complain)

    def close(self) -> None:
        """Wait until everything is saved."""
        self._pool.shutdown()


def _complain(done: Future[None]) -> None:
    error = done.exception()
    if error is not None:
        print(f"changed parameters are not kept: {error}", file=sys.stderr)


def open_boat_links(
    serving: Serving,
    vessel: Vessel,
    vessel_path: str,
    pilot: Pilot,
    law: str | None,
    saver: BackgroundSaver,
    signing: Signing | None = None,
) -> tuple[list[Link], VesselInForce]:
    """Return the opened links to ground stations, and the vessel that is tuned over them. Raises LinkError."""
    in_force = VesselInForce(vessel, pilot, law, tuned_file(vessel_path), saver)
    commands = Commands(serving.helmsman, serving.armed)
    links: list[Link] = []
    try:
        for url in serving.urls:
            transport = open_transport(url)
            ours = signing.link() if signing is not None else None
            links.append(BoatLink(transport, commands, ParameterServer(in_force), serving.system, ours))
    except BaseException:
        for link in links:
            link.close()
        raise
    return links, in_force
