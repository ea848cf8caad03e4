"""`autopilot web`: the live helm page of a running pilot, in its own process."""

from __future__ import annotations

import argparse
import ipaddress
import sys
from pathlib import Path
from typing import Any

from autopilot.errors import ExitCode, InputError


def add_parser(subparsers: argparse._SubParsersAction[Any]) -> None:
    """Add the subcommand."""
    from autopilot.cli.options import add_signing_option, add_waiting_option

    parser = subparsers.add_parser(
        "web",
        help="the helm as a page for phone, tablet and desktop",
        description="Serve the live helm page of a pilot that runs with `autopilot run --serve`. It is one more "
        "MAVLink client in a process of its own; who opens the address with the token may steer, others look.",
    )
    parser.add_argument(
        "--link", required=True, metavar="URL", help="where the pilot serves: udpin:127.0.0.1:14550, tcp:HOST:PORT"
    )
    parser.add_argument(
        "--listen",
        default="127.0.0.1:8080",
        metavar="ADDRESS:PORT",
        help="address for browsers, or an interface: wlan0:8080 (127.0.0.1:8080)",
    )
    parser.add_argument("--logs", type=Path, metavar="DIR", help="offer the logs of this folder for download")
    parser.add_argument(
        "--token-file", type=Path, metavar="FILE", help="keep the token here, so that it stays the same (mode 0600)"
    )
    parser.add_argument(
        "--boat", type=Path, metavar="NAME.yaml", help="show the steps of `autopilot new-boat NAME.yaml` as well"
    )
    add_signing_option(parser)
    add_waiting_option(parser)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Serve until interrupted."""
    from autopilot.web import require_extra

    require_extra()
    from autopilot.cli.new_boat import PageOfSteps
    from autopilot.cli.options import patience_of, signing_of
    from autopilot.web.hub import Access, Hub, token_of
    from autopilot.web.server import LogIndex, build_app, known_hosts, serve
    from autopilot.web.station import BoatLine, Station

    host, port = listening_address(arguments.listen)
    patience = patience_of(arguments)
    logs = patience(lambda: LogIndex(arguments.logs))
    token = token_of(arguments.token_file)
    steps = PageOfSteps(arguments.boat) if arguments.boat is not None else None
    if steps is not None:
        steps.rows()  # a list that cannot be read is said now
    station = Station()
    sock = _bound(host, port)
    try:
        line = patience(lambda: BoatLine(arguments.link, station, signing_of(arguments)))
    except Exception:
        sock.close()
        raise
    hub = Hub(station, line)
    app = build_app(hub, Access(token), logs, steps)
    _announce(host, sock.getsockname()[1], token)
    serve(known_hosts(app, host), sock, hub.close)
    return int(ExitCode.OK)


def listening_address(text: str) -> tuple[str, int]:
    """Return address and port of `127.0.0.1:8080`, `[::1]:8080` or `wlan0:8080`, an interface. Raises InputError."""
    from autopilot.links.transports.sockets import interface_address

    place, _, digits = text.rpartition(":")
    host = place[1:-1] if place.startswith("[") and place.endswith("]") else interface_address(place) or place
    is_port = digits.isascii() and digits.isdecimal() and len(digits) <= 5 and int(digits) <= 65535
    try:
        ipaddress.ip_address(host)
    except ValueError:
        is_port = False
    if not is_port:
        raise InputError(
            f"--listen {text}: write an address of this machine or an interface, and a port, like 127.0.0.1:8080 or "
            "wlan0:8080"
        )
    return host, int(digits)


def _bound(host: str, port: int) -> Any:
    import socket

    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    sock = socket.socket(family, socket.SOCK_STREAM)
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        sock.bind((host, port))
        sock.listen()  # who follows the address at once waits for the answer
    except OSError as error:
        sock.close()
        raise InputError(f"--listen {host}:{port}: {error.strerror}; choose another port or address") from error
    return sock


def _announce(host: str, port: int, token: str) -> None:
    from autopilot.web.codes import is_reachable, text_of

    address = ipaddress.ip_address(host)
    if address.is_unspecified:
        host = _own_address() or host
    base = f"http://[{host}]:{port}/" if ":" in host else f"http://{host}:{port}/"
    print(f"to steer:   {base}#token={token}")
    print(f"to look:    {base}", flush=True)
    if address.is_loopback:
        print("(this machine alone; --listen with an interface, like wlan0:8080, opens it to phones)", flush=True)
        return
    print("the page is not encrypted: use it on a network that is yours alone, or over ssh -L", flush=True)
    if sys.stdout.isatty() and is_reachable(host) and (code := text_of(f"{base}#token={token}")):
        print(f"to steer from a phone, scan:\n{code}", flush=True)


def _own_address() -> str:
    """Return the first address of this machine that others may reach, "" where there is none."""
    import socket

    from autopilot.links.transports.sockets import interface_address

    found = (interface_address(name) for _, name in socket.if_nameindex())
    return next((each for each in found if each and not ipaddress.ip_address(each).is_loopback), "")
