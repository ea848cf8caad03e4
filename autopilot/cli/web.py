"""`autopilot web` and `autopilot signalk`: the live helm page of a running pilot, and the pilot in Signal K.

Each serves in a process of its own, as one more MAVLink client.
"""

from __future__ import annotations

import argparse
import ipaddress
import sys
from pathlib import Path
from typing import Any

from autopilot.errors import ExitCode, InputError
from autopilot.files.saving import check_folder


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the subcommand."""
    from autopilot.cli.options import add_signing_option, add_waiting_option

    parser.description = (
        "Serve the live helm page of a pilot that runs with `autopilot run --serve`. It is one more "
        "MAVLink client in a process of its own; who opens the address with the token may steer, others look."
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
    parser.add_argument(
        "--cert",
        type=Path,
        metavar="FILE.crt",
        help="serve over https, with this certificate (PEM) of the boat's computer",
    )
    parser.add_argument("--key", type=Path, metavar="FILE.key", help="its key, where the certificate's file has it not")
    add_signing_option(parser)
    add_waiting_option(parser)
    parser.set_defaults(run=run)


class PageOfSteps:
    """The list of a new boat's file as the page shows and marks it; read each time, for the terminal writes too."""

    def __init__(self, file: Path) -> None:
        self._file = file

    def rows(self) -> list[dict[str, str]]:
        """Return each step: its name, title, what to do before it, the command, what is good enough, what to do
        otherwise, the question that only the operator can answer, its state (done, next or later), and when. Raises
        InputError where the list cannot be read."""
        from autopilot.cli.new_boat import STEPS, Checklist

        checklist = Checklist(self._file)
        return [
            {
                **{key: getattr(step, key) for key in ("name", "title", "before", "good", "otherwise", "question")},
                "command": f"autopilot new-boat {self._file}",
                "state": checklist.state(step),
                "when": checklist.done.get(step.name, "").replace("T", " "),
            }
            for step in STEPS
        ]

    def check(self) -> None:
        """Say now what is not there, or cannot be read. Raises InputError."""
        self.rows()
        check_folder(self._file)
        if not self._file.exists():
            print(f"{self._file} is not there yet; autopilot new-boat {self._file} begins it", flush=True)

    def mark(self, name: str, *, is_done: bool) -> None:
        """Note the next step as done, or one and those after it as not done. Raises InputError; RefusedError while a
        terminal goes through the steps."""
        from autopilot.cli.new_boat import Checklist, alone_with

        with alone_with(self._file):
            Checklist(self._file).mark(name, is_done=is_done)


def run(arguments: argparse.Namespace) -> int:
    """Serve until interrupted."""
    from autopilot.web import require_extra

    require_extra()
    from autopilot.cli.options import patience_of, signing_of
    from autopilot.web import context_of, doubts
    from autopilot.web.hub import Access, Hub, token_of
    from autopilot.web.server import LogIndex, build_app, known_hosts, serve
    from autopilot.web.station import BoatLine, Station

    host, port = listening_address(arguments.listen)
    shown = (_own_address() or host) if ipaddress.ip_address(host).is_unspecified else host
    if arguments.key is not None and arguments.cert is None:
        raise InputError(f"--key {arguments.key}: give the certificate that it belongs to, --cert")
    secure = context_of(arguments.cert, arguments.key, shown) if arguments.cert is not None else None
    patience = patience_of(arguments)
    logs = patience(lambda: LogIndex(arguments.logs))
    token = token_of(arguments.token_file)
    steps = PageOfSteps(arguments.boat) if arguments.boat is not None else None
    if steps is not None:
        steps.check()
    station = Station()
    sock = _bound(host, port)
    try:
        line = patience(lambda: BoatLine(arguments.link, station, signing_of(arguments)))
    except Exception:
        sock.close()
        raise
    hub = Hub(station, line)
    access = Access(token)
    app = build_app(hub, access, logs, steps)
    _announce(shown, sock.getsockname()[1], token, is_secure=secure is not None)
    if secure is not None and (words := doubts(secure, arguments.cert, shown)):
        print(words, flush=True)
    serve(known_hosts(app, host), access, sock, hub.close, secure)
    return int(ExitCode.OK)


def listening_address(text: str) -> tuple[str, int]:
    """Return address and port of `127.0.0.1:8080`, `[::1]:8080` or `wlan0:8080`, an interface. Raises InputError."""
    from autopilot.links.transports.medium import interface_address

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


def _announce(host: str, port: int, token: str, *, is_secure: bool) -> None:
    from autopilot.web import is_reachable, text_of

    base = f"http{'s' if is_secure else ''}://{f'[{host}]' if ':' in host else host}:{port}/"
    print(f"to steer:   {base}#token={token}")
    print(f"to look:    {base}", flush=True)
    if ipaddress.ip_address(host).is_loopback:
        print("(this machine alone; --listen with an interface, like wlan0:8080, opens it to phones)", flush=True)
        return
    if not is_secure:
        print(
            "the page is not encrypted: use it on a network that is yours alone, with --cert and --key, or over ssh -L",
            flush=True,
        )
    if sys.stdout.isatty() and is_reachable(host) and (code := text_of(f"{base}#token={token}")):
        print(f"to steer from a phone, scan:\n{code}", flush=True)


def _own_address() -> str:
    """Return the first address of this machine that others may reach, "" where there is none."""
    import socket

    from autopilot.links.transports.medium import interface_address

    found = (interface_address(name) for _, name in socket.if_nameindex())
    return next((each for each in found if each and not ipaddress.ip_address(each).is_loopback), "")


PLUGIN = "plugin"


def add_signalk_options(parser: argparse.ArgumentParser) -> None:
    """Add the subcommand."""
    from autopilot.cli.options import add_signing_option, add_waiting_option

    parser.description = (
        "Tell a Signal K server what a pilot does that runs with `autopilot run --serve`, and carry out "
        "what Signal K programs order. One more MAVLink client in a process of its own; see docs/howto/signalk.md."
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
    parser.set_defaults(run=run_signalk)


def run_signalk(arguments: argparse.Namespace) -> int:
    """Serve until interrupted."""
    if arguments.plugin:
        import autopilot.signalk

        print(Path(autopilot.signalk.__file__).parent / PLUGIN)
        return int(ExitCode.OK)
    if arguments.link is None:
        raise InputError("--link is missing; give the link at which the pilot serves, such as udpin:127.0.0.1:14551")
    return _serve_signalk(arguments)


def _serve_signalk(arguments: argparse.Namespace) -> int:
    import select

    from autopilot.cli.options import patience_of, signing_of
    from autopilot.interruption import stop_on_signal
    from autopilot.runtime.machine import running_time
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
    is_stopped = stop_on_signal()
    try:
        while not is_stopped():
            select.select(bridge.descriptors, (), (), 0.05)
            bridge.turn(running_time())
    finally:
        bridge.close()
    return int(ExitCode.OK)
