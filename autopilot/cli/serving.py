"""`autopilot run --serve`: the running pilot as a MAVLink boat for ground stations, its numbers tuned from there."""

from __future__ import annotations

import argparse
import sys
from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import NamedTuple

from autopilot import __version__
from autopilot.cli.option_numbers import SYSTEM_ID
from autopilot.errors import InputError
from autopilot.files.outside import read_regular
from autopilot.files.saving import save_text
from autopilot.guidance.track import TrackGuide
from autopilot.guidance.wind_vane import WindGuide
from autopilot.links.base import Link
from autopilot.links.ground_station.access import LOOKING_ONLY, AccessPolicy
from autopilot.links.ground_station.boat_link import BoatLink
from autopilot.links.ground_station.commands import Commands, Helmsman, Tuner
from autopilot.links.ground_station.file_server import metadata_files
from autopilot.links.ground_station.mission import Mission, MissionItem, dump_items, parse_items
from autopilot.links.ground_station.station_service import ParameterServer
from autopilot.links.mavlink.signing import Signing
from autopilot.links.reconnect import GuideAlarms, ReconnectingLink
from autopilot.links.url import open_transport, parse_url
from autopilot.runtime.build import track_settings_of
from autopilot.runtime.build_links import networks_of
from autopilot.runtime.vessel_store import VesselStore
from autopilot.vessel.parameters import parameters_of
from autopilot.vessel.schema import Vessel

ROUTE_MOST_BYTES = 1 << 20


class Serving(NamedTuple):
    """What `--serve` asks for: where, under which system id, and who carries out what is ordered there.

    `mission` is the route, whose guide leads the helmsman; so does `wind`.
    `reconnect`: lines that are lost, or not there yet, are opened again.
    """

    urls: tuple[str, ...]
    system: int
    helmsman: Helmsman
    mission: Mission
    armed: bool
    wind: WindGuide | None = None
    reconnect: bool = False


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


def serving_of(arguments: argparse.Namespace, helmsman: Helmsman, mission: Mission, armed: bool) -> Serving:
    """Return what the options ask for. Raises InputError."""
    for url in arguments.serve:
        if parse_url(url).protocol != "mavlink":
            raise InputError(f"--serve {url}: ground stations speak MAVLink; write it like udpout:127.0.0.1:14550")
    serving = Serving(tuple(arguments.serve), arguments.system, helmsman, mission, armed)
    return serving._replace(reconnect=arguments.reconnect)


class BackgroundSaver:
    """Saves files from a thread of its own: flushing to a memory card takes longer than a tick. Call it to save."""

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
        print(f"a change is not kept: {error}", file=sys.stderr)


def open_boat_links(
    serving: Serving,
    store: VesselStore,
    vessel_path: str,
    saver: BackgroundSaver,
    signing: Signing | None = None,
    policy: AccessPolicy | None = None,
    tuner: Tuner | None = None,
) -> list[Link]:
    """Return the opened links to ground stations, over which the vessel in force is tuned. Raises LinkError.

    The first are to nobody: they bring the alarms of those who lead.
    """
    mission, path = serving.mission, mission_file(vessel_path)
    networks, policy = networks_of(store.running), policy or AccessPolicy()

    def keep_course_settings(vessel: Vessel) -> None:
        mission.guide.settings = track_settings_of(vessel)

    store.changed = keep_course_settings
    keep_course_settings(store.running)
    mission.keep = lambda items: saver(path, dump_items(items))
    files = metadata_files(parameters_of(store.stored), __version__)
    commands = Commands(serving.helmsman, serving.armed, mission, tuner)
    links: list[Link] = [GuideAlarms(mission.guide, "track")]
    if serving.wind is not None:
        links.append(GuideAlarms(serving.wind, "wind"))

    def opened(url: str) -> BoatLink:
        transport = open_transport(url, networks)
        ours = signing.link() if signing is not None else None
        server = ParameterServer(store)
        served = BoatLink(transport, commands, server, serving.system, ours, files, policy.link())
        if not served.takes_orders:
            print(f"--serve {url}: {LOOKING_ONLY}", file=sys.stderr)
        return served

    try:
        for url in serving.urls:
            opener = partial(opened, url)
            links.append(ReconnectingLink(url, False, opener) if serving.reconnect else opener())
    except BaseException:
        for link in links:
            link.close()
        raise
    return links


def mission_file(vessel_path: str) -> Path:
    """Return the file in which the route is kept: boat.yaml, boat.mission.waypoints."""
    path = Path(vessel_path)
    return path.with_name(f"{path.stem}.mission.waypoints")


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
