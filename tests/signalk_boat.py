"""A boat in a wind with its pilot, the bridge, and a real signalk-server with our plugin, while a test lasts."""

from __future__ import annotations

import base64
import contextlib
import hashlib
import hmac
import json
import shutil
import socket
import sys
import urllib.error
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from outside_programs import LOOPBACK, SIGNALK, program
from two_processes import free_port, patient_vessel, simulator

import autopilot.signalk

SECRET = "0123456789abcdef" * 4
TOKEN = "a-token-of-enough-letters"
WIND = """schema_version: 1
name: wind
start: {heading_deg: 20.0}
wind: {speed_m_s: 8.0, from_deg: 65.0, rudder_deg_per_m2_s2: 0.0, leeway: 0.0}
"""


def config_folder(folder: Path, web: int, bridge: int, token: str, also_plain: bool = False) -> Path:
    """A server's folder with our plugin in it, and one user who may write; also a plain data connection."""
    options = {"type": "tcp", "host": "127.0.0.1", "port": bridge}
    plain = {"type": "providers/simple", "options": {"logging": False, "type": "SignalK", "subOptions": options}}
    config = folder / "signalk"
    shutil.copytree(Path(autopilot.signalk.__file__).parent / "plugin", config / "node_modules" / "signalk-norrbin")
    off = ("appstore", "playground", "nmea-tcp", "tcp", "mfd_webapp")
    files = {
        "settings.json": {
            "interfaces": dict.fromkeys(off, False),
            "mdns": False,
            "ssl": False,
            "port": web,
            "pipedProviders": [{"id": "plain", "enabled": True, "pipeElements": [plain]}] if also_plain else [],
            "security": {"strategy": "./tokensecurity"},
        },
        "security.json": {
            "allow_readonly": True,
            "secretKey": SECRET,
            "users": [{"username": "skipper", "type": "readwrite", "password": "none"}],
        },
        "package.json": {"name": "config", "dependencies": {"signalk-norrbin": "0.2.0"}},
        "plugin-config-data/signalk-norrbin.json": {"enabled": True, "configuration": {"port": bridge, "token": token}},
    }
    for name, content in files.items():
        (config / name).parent.mkdir(exist_ok=True)
        (config / name).write_text(json.dumps(content))
        (config / name).chmod(0o600)
    (config / "loopback.cjs").write_text(LOOPBACK)
    return config


def signed_in() -> str:
    """The token (JWT, HS256) that the server would give the skipper."""

    def part(content: bytes) -> str:
        return base64.urlsafe_b64encode(content).rstrip(b"=").decode()

    said = part(b'{"alg":"HS256","typ":"JWT"}') + "." + part(b'{"id":"skipper"}')
    return said + "." + part(hmac.new(SECRET.encode(), said.encode(), hashlib.sha256).digest())


class Server:
    """Asks a server, as its user or as nobody."""

    def __init__(self, port: int) -> None:
        self.root = f"http://127.0.0.1:{port}"

    def ask(self, path: str, value: Any = None, method: str = "GET", user: bool = True) -> tuple[int, Any]:
        """Return status and answer; a value is sent with its unit."""
        body = None if method == "GET" else {"value": value} | ({"units": "deg"} if "v2" in path else {})
        return self.send(path, body, method, user)

    def send(self, path: str, body: Any, method: str, user: bool = True) -> tuple[int, Any]:
        """Return status and answer to a body as it is."""
        data = None if body is None else json.dumps(body).encode()
        request = urllib.request.Request(f"{self.root}/signalk/{path}", data, method=method)
        request.add_header("Content-Type", "application/json")
        if user:
            request.add_header("Authorization", f"Bearer {signed_in()}")
        try:
            with urllib.request.urlopen(request, timeout=20) as answer:
                return answer.status, json.loads(answer.read() or b"null")
        except urllib.error.HTTPError as error:
            return error.code, error.read().decode()
        except OSError as error:
            return 0, str(error)

    def value(self, path: str) -> Any:
        """Return the value at a path, None where there is none."""
        status, found = self.ask(f"v1/api/vessels/self/{path}")
        return found.get("value") if status == 200 else None


@contextlib.contextmanager
def sailing_in_a_wind(folder: Path, speedup: float, *run: str) -> Iterator[Server]:
    """A server whose boat sails in 8 m/s of wind; `run`: more options of `autopilot run`."""
    web, bridge = free_port(socket.SOCK_STREAM), free_port(socket.SOCK_STREAM)
    sim, vane, serve = free_port(), free_port(), free_port()
    (folder / "token").write_text(TOKEN + "\n")
    (folder / "token").chmod(0o600)
    (folder / "wind.yaml").write_text(WIND)
    config = config_folder(folder, web, bridge, TOKEN)
    pilot = [sys.executable, "-m", "autopilot", "run", str(patient_vessel(folder)), "--as-gcs"]
    pilot += ["--link", f"udpin:127.0.0.1:{sim}", "--link", f"nmea-udp:127.0.0.1:{vane}"]
    pilot += [
        "--serve",
        f"udpout:127.0.0.1:{serve}",
        "--speedup",
        str(speedup),
        "--log",
        str(folder / "run.tlog"),
        *run,
    ]
    between = [sys.executable, "-m", "autopilot", "signalk", "--link", f"udpin:127.0.0.1:{serve}"]
    between += ["--listen", f"127.0.0.1:{bridge}", "--token-file", str(folder / "token")]
    node = ["node", "--require", str(config / "loopback.cjs"), str(SIGNALK)]
    boat = ["--mavlink", f"udpout:127.0.0.1:{sim}", "--armed", "--scenario", str(folder / "wind.yaml")]
    boat += ["--nmea", f"nmea-udpout:127.0.0.1:{vane}", "--sentences", "MWV:4,VHW:2"]
    (folder / "a").mkdir()
    (folder / "b").mkdir()
    with (
        simulator(speedup, *boat),
        program(folder, *node, SIGNALK_NODE_CONFIG_DIR=str(config)),
        program(folder / "a", *pilot),
        program(folder / "b", *between),
    ):
        yield Server(web)
