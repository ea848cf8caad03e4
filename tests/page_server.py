"""The page served over a real socket by a thread, its boat sailing on the simulated clock whenever the hub turns."""

from __future__ import annotations

import contextlib
import shutil
import socket
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import uvicorn
from monitored_boat import Watched

from autopilot.web.hub import Access, Hub
from autopilot.web.server import LogIndex, Steps, build_app

TOKEN = "a-token-of-many-letters"
CHROMIUM_OPTIONS = (
    *("--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking"),
    *("--disable-component-update", "--disable-sync"),
)


class SailingHub(Hub):
    """A hub on the simulated clock: the boat sails on whenever the line is turned. `lock` it to touch the boat."""

    def __init__(self, sea: Watched) -> None:
        super().__init__(sea.station, sea.line, lambda: sea.now)
        self.sea = sea
        self.lock = sea.lock
        sea.keeps_history = False

    def _turn(self) -> None:
        with self.lock:
            self.sea.watch(0.05)


class Served(uvicorn.Server):
    """Tells when it is up."""

    def __init__(self, config: uvicorn.Config) -> None:
        super().__init__(config)
        self.up = threading.Event()

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        await super().startup(sockets)
        self.up.set()


@contextlib.contextmanager
def served(sea: Watched, logs: Path | None = None, steps: Steps | None = None) -> Iterator[tuple[str, SailingHub]]:
    """Serve the page of `sea` while the block lasts; yield its address and the hub."""
    hub = SailingHub(sea)
    config = uvicorn.Config(
        build_app(hub, Access(TOKEN), LogIndex(logs), steps),
        log_level="warning",
        ws="none",
        timeout_graceful_shutdown=1,
    )
    server = Served(config)
    with socket.create_server(("127.0.0.1", 0)) as sock:
        thread = threading.Thread(target=server.run, kwargs={"sockets": [sock]})
        thread.start()
        try:
            assert server.up.wait(60.0)
            yield f"http://127.0.0.1:{sock.getsockname()[1]}", hub
        finally:
            server.should_exit = True
            thread.join(30.0)


@contextlib.contextmanager
def chromium() -> Iterator[Any]:
    """A headless Chromium, where this machine has one; else the test is skipped, and says so."""
    program = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    if program is None:
        pytest.skip("no Chromium on this machine: the page is not tried in a browser")
    api = pytest.importorskip("playwright.sync_api", reason="the extra `browser` (playwright) is not installed")
    with api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=program, args=list(CHROMIUM_OPTIONS))
        try:
            yield browser
        finally:
            browser.close()
