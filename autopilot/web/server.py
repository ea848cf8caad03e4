"""The page's server: the page itself, events to look at, orders from who may, parameters and logs.

The logs that can be downloaded: the files of one folder, by their plain names.
"""

from __future__ import annotations

import asyncio
import contextlib
import gzip
import ipaddress
import logging
import os
import signal
import socket
import ssl
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from pathlib import Path
from types import FrameType
from typing import Any, Protocol
from urllib.parse import quote

import uvicorn
from starlette.applications import Starlette
from starlette.datastructures import MutableHeaders
from starlette.middleware.trustedhost import TrustedHostMiddleware
from starlette.requests import ClientDisconnect, Request
from starlette.responses import JSONResponse, Response, StreamingResponse
from starlette.routing import Route
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from uvicorn.protocols.http.auto import AutoHTTPProtocol

from autopilot import __version__
from autopilot.errors import InputError, NotYetError, RefusedError
from autopilot.files.outside import ORDER_MOST, order_object
from autopilot.interruption import print_end
from autopilot.web import is_reachable, page_files, svg_of
from autopilot.web.hub import Access, Hub, makes_room
from autopilot.web.journal import words_of
from autopilot.web.requests import STOPS, GivenStops, asked_of, came_late
from autopilot.web.view import COLUMNS

SUFFIXES = (".tlog", ".html", ".csv", ".yaml")
SHOWN_MOST = 200
ON_BOARD = ("127.0.0.1", "::1")
PIECE = 65536


class LogIndex:
    """`listing` and `path_of` see nothing outside of the folder. None: no folder was given, nothing is listed."""

    def __init__(self, folder: Path | None) -> None:
        if folder is not None and folder.exists() and not folder.is_dir():
            raise InputError(f"--logs {folder}: is no folder; give the folder that `autopilot run --log` writes to")
        if folder is not None and not folder.is_dir():
            raise NotYetError(f"--logs {folder}: no folder there; give the folder that `autopilot run --log` writes to")
        self._folder = folder

    @property
    def is_there(self) -> bool:
        """Whether a folder was given."""
        return self._folder is not None

    def listing(self) -> list[dict[str, Any]]:
        """Return name, size [bytes] and time of change [s since 1970] of each log, the newest first."""
        if self._folder is None:
            return []
        rows: list[dict[str, Any]] = []
        with contextlib.suppress(OSError):  # the folder was removed, its disk was pulled out
            for path in self._folder.iterdir():
                with contextlib.suppress(OSError):  # the log was removed
                    if self._is_log(path):
                        about = path.stat()
                        rows.append({"name": path.name, "bytes": about.st_size, "changed": round(about.st_mtime)})
        rows.sort(key=lambda row: row["changed"], reverse=True)
        return rows[:SHOWN_MOST]

    def path_of(self, name: str) -> Path | None:
        """Return the path of a log by its name, None where there is no such log."""
        if self._folder is None or "/" in name or "\0" in name or name.startswith("."):
            return None
        path = self._folder / name
        try:
            return path if self._is_log(path) else None
        except OSError:  # a name longer than a file system takes
            return None

    def read(self, path: Path) -> tuple[int, Iterator[bytes]]:
        """Return the size [bytes] that a log has now and that much of it, piece by piece: a run may be writing on.

        Raises OSError where it cannot be read.
        """
        log = path.open("rb")
        size = os.fstat(log.fileno()).st_size

        def pieces() -> Iterator[bytes]:
            left = size
            with log as file:
                while left > 0 and (piece := file.read(min(left, PIECE))):
                    left -= len(piece)
                    yield piece

        return size, pieces()

    def _is_log(self, path: Path) -> bool:
        # a name that is no text cannot be reported, nor asked for
        is_name = path.suffix in SUFFIXES and path.name.isprintable() and not path.name.startswith(".")
        return is_name and not path.is_symlink() and path.is_file()


KINDS = {
    ".html": "text/html; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".css": "text/css",
    ".svg": "image/svg+xml",
    ".png": "image/png",
    ".webmanifest": "application/manifest+json",
}
PACKED = (".html", ".js", ".css", ".svg", ".webmanifest")
"""What is sent in gzip, a third of its size, to a browser that takes it: all do."""
UNREACHABLE = (
    "You have opened this page on the boat's own computer, by an address that no other machine reaches. Start "
    "autopilot web with --listen and an interface, like wlan0:8080, and open the address that it prints."
)
NO_CODES = "Codes need the package segno: pip install '.[web]'."
ORDER_S = 5.0
"""Within this time an order has come whole."""
BAD_ORDER, CANNOT_NOW = 400, 409
"""Statuses of an order that is none, and of one that the boat does not carry out as things stand."""
CLOSING = {"connection": "close"}
"""Sent with the refusal of a body that is not read to its end."""
HEADERS = {
    "content-security-policy": "default-src 'self'; style-src 'self' 'unsafe-inline'; "
    "frame-ancestors 'none'; base-uri 'none'",
    "x-content-type-options": "nosniff",
    "referrer-policy": "no-referrer",
    "x-frame-options": "DENY",
}
"""Nothing from elsewhere, nobody puts the helm into a frame of theirs. Styles inline: the plots set their sizes so."""

Answer = Callable[[Request], Awaitable[Response]]


class Steps(Protocol):
    """The steps to a new boat's first hold, for the page."""

    def rows(self) -> list[dict[str, str]]:
        """Return them. Raises InputError."""

    def mark(self, name: str, *, is_done: bool) -> None:
        """Note one as done, or as to be done again. Raises InputError; RefusedError while a terminal does them."""


class SafeHeaders:
    """Adds HEADERS to every answer; a request whose end two readers would see in two places is refused whole."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass on, headers added."""

        async def sent(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                for name, value in HEADERS.items():
                    headers.setdefault(name, value)
            await send(message)

        named = {name for name, _ in scope.get("headers", ())}
        if named >= {b"content-length", b"transfer-encoding"}:
            await _refusal(400, "give the length of a request once", CLOSING)(scope, receive, sent)
        else:
            await self._app(scope, receive, sent)


class Page:
    """The answers to a browser's requests."""

    def __init__(self, hub: Hub, access: Access, logs: LogIndex, steps: Steps | None = None) -> None:
        self._hub, self._access, self._logs, self._steps = hub, access, logs, steps
        self._stops = GivenStops(hub.station.view)
        self._assets = page_files()
        self._packed = {
            name: gzip.compress(content) for name, content in self._assets.items() if _ending(name) in PACKED
        }

    def routes(self) -> list[Route]:
        """Return the routes."""
        return [
            Route("/", self.asset),
            Route("/register_service", self.registration),
            Route("/{name:str}", self.asset),
            Route("/api/events", self.events),
            Route("/api/history", self.history),
            Route("/api/order", self.order, methods=["POST"]),
            Route("/api/may", self.may),
            Route("/api/code/{what:str}", self.code),
            Route("/api/steps", self.steps, methods=["GET", "POST"]),
            Route("/api/parameters", self.parameters),
            Route("/api/logs", self.logs),
            Route("/api/logs/{name:str}/ticket", self.ticket, methods=["POST"]),
            Route("/api/logs/{name:str}", self.log),
        ]

    async def asset(self, request: Request) -> Response:
        """The page and what it needs."""
        name = request.path_params.get("name", "index.html")
        content = self._assets.get(name)
        if content is None:
            return _refusal(404, "there is no such page")
        headers = {"cache-control": "no-cache", "vary": "accept-encoding"}
        if name in self._packed and "gzip" in request.headers.get("accept-encoding", ""):
            content, headers["content-encoding"] = self._packed[name], "gzip"
        return Response(content, media_type=KINDS.get(_ending(name), "text/plain; charset=utf-8"), headers=headers)

    async def registration(self, _: Request) -> Response:
        """What BlueOS asks each page on its machine for, to list it beside its own.

        Source: BlueOS, `core/services/helper`, ServiceMetadata; in a page of its own, for ours lets nobody frame it.
        """
        return JSONResponse(
            {
                "name": "Norrbin",
                "description": "The helm of a boat autopilot: courses, alarms, trials, parameters.",
                "icon": "mdi-ship-wheel",
                "company": "Norrbin",
                "version": __version__,
                "webpage": "",
                "api": "",
                "new_page": True,
            }
        )

    async def events(self, request: Request) -> Response:
        """What is known of the boat, ten times a second, as server-sent events; who has the token goes first."""
        events = self._hub.follow("" if self._may(request) else _address_of(request))
        if events is None:
            return _refusal(503, "all places are taken by displays that may steer: close one of them")
        return StreamingResponse(events, media_type="text/event-stream", headers={"cache-control": "no-store"})

    async def history(self, _: Request) -> Response:
        """The last minutes for the plots, column by column."""
        track = list(self._hub.track.points)
        return JSONResponse({"columns": COLUMNS, "rows": list(self._hub.station.view.history), "track": track})

    async def may(self, request: Request) -> Response:
        """Whether the token that comes with the request lets its bearer give orders."""
        return JSONResponse({"may": self._may(request)})

    async def code(self, request: Request) -> Response:
        """The QR code with which another display opens this page, `steer` or `look`, for who may give orders."""
        what = request.path_params["what"]
        if not self._may(request):
            return _refusal(403, "codes are for who may give orders")
        if what not in ("steer", "look"):
            return _refusal(404, "there are two codes: steer and look")
        base = request.base_url
        if not is_reachable(base.hostname or ""):
            return JSONResponse({"svg": "", "words": UNREACHABLE})
        svg = svg_of(f"{base}#token={self._access.token}" if what == "steer" else str(base))
        return JSONResponse({"svg": svg, "words": str(base) if svg else NO_CODES})

    async def order(self, request: Request) -> Response:
        """An order for the boat, from who may."""
        if not self._may(request):
            return _refusal(403, "view only: open the page with the address that `autopilot web` has printed")
        body = await _body_of(request)
        if isinstance(body, Response):
            return body
        try:
            wanted = order_object(body)
            now = self._hub.clock()
            late = came_late(wanted, now, self._stops.seen_since(now))
            asked = asked_of(self._hub.station, wanted)
        except InputError as error:
            return _refusal(BAD_ORDER, str(error))
        if late:
            return _refusal(CANNOT_NOW, late)
        if self._hub.station.target is None:
            return _refusal(CANNOT_NOW, "no boat that runs this pilot is heard")
        stops = wanted["do"] in STOPS
        if stops:
            self._stops.begin(now)
        try:
            taken, words = await self._hub.ask(asked, (_display_of(request), words_of(wanted)))
        finally:
            if stops:
                self._stops.end(self._hub.clock())
        return JSONResponse({"taken": True, "words": words}) if taken else _refusal(CANNOT_NOW, words)

    async def steps(self, request: Request) -> Response:
        """The steps to the first hold, where --boat names a vessel file; marked by who may give orders."""
        if self._steps is None:
            return JSONResponse({"steps": None})
        try:
            if request.method == "POST":
                if not self._may(request):
                    return _refusal(403, "steps are marked by who may give orders")
                body = await _body_of(request)
                if isinstance(body, Response):
                    return body
                wanted = order_object(body)
                if not (isinstance(wanted.get("name"), str) and isinstance(wanted.get("done"), bool)):
                    return _refusal(BAD_ORDER, "give the name of a step, and whether it is done")
                self._steps.mark(wanted["name"], is_done=wanted["done"])
            return JSONResponse({"steps": self._steps.rows()})
        except (InputError, RefusedError) as error:
            return _refusal(BAD_ORDER if isinstance(error, InputError) else CANNOT_NOW, str(error))

    async def parameters(self, _: Request) -> Response:
        """The boat's parameters as far as they have come; asked for, they are fetched."""
        self._hub.station.parameters.read()
        return JSONResponse(self._hub.station.parameters.table())

    async def logs(self, request: Request) -> Response:
        """The list of logs, for who may give orders: a log says where the boat has been."""
        if not self._may(request):
            return _refusal(403, "logs are for who may give orders")
        return JSONResponse({"folder": self._logs.is_there, "logs": self._logs.listing()})

    async def ticket(self, request: Request) -> Response:
        """The address of one log, good for two minutes, that a browser can download by itself."""
        if not self._may(request):
            return _refusal(403, "logs are for who may give orders")
        name = request.path_params["name"]
        if self._logs.path_of(name) is None:
            return _refusal(404, "there is no such log")
        ticket = self._access.ticket(name, self._hub.clock())
        return JSONResponse({"href": f"/api/logs/{quote(name)}?ticket={ticket}"})

    async def log(self, request: Request) -> Response:
        """One log, to who has a ticket for it."""
        name = request.path_params["name"]
        if not self._access.admits(request.query_params.get("ticket", ""), name, self._hub.clock()):
            return _refusal(403, "the address of this download is no longer good: list the logs again")
        path = self._logs.path_of(name)
        if path is None:
            return _refusal(404, "there is no such log")
        try:
            size, pieces = self._logs.read(path)
        except OSError as error:
            return _refusal(404, f"this log cannot be read: {error.strerror}")
        headers = {"content-length": str(size), "content-disposition": f"attachment; filename*=utf-8''{quote(name)}"}
        return StreamingResponse(pieces, headers=headers, media_type="application/octet-stream")

    def _may(self, request: Request) -> bool:
        return self._access.allows(request.headers.get("authorization", ""))


class Server(uvicorn.Server):
    """Ends on SIGINT and SIGTERM as asked, where uvicorn would die of the signal once more."""

    leave: Callable[[], None]

    @contextlib.contextmanager
    def capture_signals(self) -> Iterator[None]:
        """Take the signals while the block lasts."""
        before = {number: signal.signal(number, self.handle_exit) for number in (signal.SIGINT, signal.SIGTERM)}
        try:
            yield
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        """End, and say so."""
        print_end(sig)
        super().handle_exit(sig, frame)

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """Let every browser go, which would else be waited for; what is cut off now is no mistake to report."""
        self.leave()
        logging.getLogger("uvicorn.error").setLevel(logging.CRITICAL)
        await super().shutdown(sockets)


CONNECTIONS_MOST = 256
"""Open at once, however little each has said: the system lets a process have 1024 files."""


def limited(access: Access, most: int = CONNECTIONS_MOST) -> type[asyncio.Protocol]:
    """Return uvicorn's side of a connection, of which no more than `most` are open: who has not shown the token goes
    before who has, so that nobody who opens connections and leaves them shuts out the skipper."""
    opened: dict[Any, str] = {}

    def has_shown(connection: Any) -> bool:
        headers = dict(connection.headers or ())
        return access.allows(headers.get(b"authorization", b"").decode("latin-1"))

    class Limited(AutoHTTPProtocol):  # type: ignore[valid-type, misc]
        def connection_made(self, transport: Any) -> None:
            super().connection_made(transport)
            goes = None
            if len(opened) >= most:
                goes = makes_room({each: address for each, address in opened.items() if not has_shown(each)}) or self
                goes.transport.abort()
                opened.pop(goes, None)
            if goes is not self:
                opened[self] = self.client[0] if self.client else ""

        def connection_lost(self, exc: Exception | None) -> None:
            opened.pop(self, None)
            super().connection_lost(exc)

    return Limited


def serve(
    app: ASGIApp, access: Access, sock: socket.socket, leave: Callable[[], None], secure: ssl.SSLContext | None = None
) -> None:
    """Serve on a bound socket until a signal comes; `leave` lets go of who follows the boat. secure: over https."""
    config = uvicorn.Config(
        app, http=limited(access), log_level="error", access_log=False, timeout_graceful_shutdown=2, ws="none"
    )
    config.load()
    config.ssl = secure
    server = Server(config)
    server.leave = leave
    server.run(sockets=[sock])


def known_hosts(app: ASGIApp, address: str) -> ASGIApp:
    """Return the application, refusing on a loopback `address` what was asked of another name.

    A foreign page whose name is made to lead to this machine could otherwise read what is shown here.
    """
    place = ipaddress.ip_address(address)
    if not place.is_loopback:
        return app
    address = str(place)  # as a browser writes it
    # before starlette 1.0, "[" is all that is read of [::1]:8080
    return TrustedHostMiddleware(app, allowed_hosts=[address, f"[{address}]", "[", "localhost"], www_redirect=False)


def build_app(hub: Hub, access: Access, logs: LogIndex, steps: Steps | None = None) -> ASGIApp:
    """Return the application; the hub runs as long as it does. steps: of a new boat, where there is one."""

    @contextlib.asynccontextmanager
    async def lifespan(_: Starlette) -> AsyncIterator[None]:
        task = asyncio.create_task(hub.run())
        try:
            yield
        finally:
            hub.close()
            task.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await task

    return SafeHeaders(Starlette(routes=Page(hub, access, logs, steps).routes(), lifespan=lifespan))


async def _body_of(request: Request) -> bytes | Response:
    """Return the body of an order, or the refusal of one that is too long or does not come to its end."""
    try:
        async with asyncio.timeout(ORDER_S):
            body = await _short_body(request)
    except TimeoutError:
        return _refusal(408, "the order did not come to its end", CLOSING)
    except ClientDisconnect:
        return _refusal(400, "the order did not come to its end", CLOSING)
    return body if body is not None else _refusal(413, f"an order is at most {ORDER_MOST} bytes long", CLOSING)


async def _short_body(request: Request) -> bytes | None:
    """Return the body of a request; None, and no more of it is read, where it is longer than an order may be."""
    length = request.headers.get("content-length", "0")
    if not (length.isascii() and length.isdecimal() and len(length) < 10 and int(length) <= ORDER_MOST):
        return None
    body = b""
    async for chunk in request.stream():
        body += chunk
        if len(body) > ORDER_MOST:
            return None
    return body


def _ending(name: str) -> str:
    return name[name.rfind(".") :]


def _address_of(request: Request) -> str:
    return request.client.host if request.client is not None else "unknown"


def _display_of(request: Request) -> str:
    address = _address_of(request)
    return "on board" if address in ON_BOARD else f"page at {address}"


def _refusal(status: int, words: str, headers: dict[str, str] | None = None) -> Response:
    content: dict[str, Any] = {"taken": False, "words": words}
    return JSONResponse(content, status_code=status, headers=headers)
