"""`autopilot signalk`: a running pilot in Signal K, in its own process."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from autopilot.errors import ExitCode, InputError

PLUGIN = "plugin"


def add_parser(subparsers: argparse._SubParsersAction[Any]) -> None:
    """Add the subcommand."""
    from autopilot.cli.options import add_signing_option, add_waiting_option

    parser = subparsers.add_parser(
        "signalk",
        help="the running pilot in Signal K: its state as deltas, orders from Signal K programs",
        description="Tell a Signal K server what a pilot does that runs with `autopilot run --serve`, and carry out "
        "what Signal K programs order. One more MAVLink client in a process of its own; see docs/howto/signalk.md.",
    )
    parser.add_argument("--link", metavar="URL", help="where the pilot serves: udpin:127.0.0.1:14551, tcp:HOST:PORT")
    parser.add_argument(
        "--listen",
        default="127.0.0.1:8376",
        metavar="ADDRESS:PORT",
        help="address for the plugin (%(default)s)",
    )
    parser.add_argument(
        "--token-file",
        type=Path,
        metavar="FILE",
        help="take orders with the token in FILE (mode 0600; made if missing)",
    )
    parser.add_argument("--plugin", action="store_true", help="print the plugin's folder, for npm install, and end")
    add_signing_option(parser)
    add_waiting_option(parser)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Serve until interrupted."""
    if arguments.plugin:
        import autopilot.signalk

        print(Path(autopilot.signalk.__file__).parent / PLUGIN)
        return int(ExitCode.OK)
    if arguments.link is None:
        raise InputError("--link is missing; give the link at which the pilot serves, such as udpin:127.0.0.1:14551")
    return _serve(arguments)


def _serve(arguments: argparse.Namespace) -> int:
    import select
    import signal
    import time

    from autopilot.cli.options import patience_of, signing_of
    from autopilot.cli.web import listening_address
    from autopilot.interruption import print_end
    from autopilot.signalk.bridge import Bridge, LineClients
    from autopilot.signalk.messages import LINE_MOST
    from autopilot.web.hub import token_of
    from autopilot.web.station import BoatLine, Station

    host, port = listening_address(arguments.listen)
    token = token_of(arguments.token_file) if arguments.token_file is not None else ""
    signing, station = signing_of(arguments), Station()
    clients = LineClients(host, port, LINE_MOST)
    try:
        line = patience_of(arguments)(lambda: BoatLine(arguments.link, station, signing))
    except BaseException:
        clients.close()
        raise
    bridge = Bridge(station, line, clients, token, lambda news: print(news, flush=True))
    orders = f"orders need the token in {arguments.token_file}" if token else "orders are not taken: no --token-file"
    print(f"ready: Signal K plugin at {host}:{clients.port}; {orders}", flush=True)
    stopped: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda number, _: stopped.append(number))
    try:
        while not stopped:
            select.select(bridge.descriptors, (), (), 0.05)
            bridge.turn(time.monotonic())
    finally:
        bridge.close()
    print_end(stopped[0])
    return int(ExitCode.OK)
