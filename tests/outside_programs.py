"""Programs that others wrote, run while a test lasts: started, waited for, kept on loopback."""

from __future__ import annotations

import contextlib
import os
import shutil
import subprocess
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

WANTED = "NORRBIN_INTEROP" in os.environ
SIGNALK = Path(os.environ.get("NORRBIN_SIGNALK", "")) / "node_modules" / "signalk-server" / "bin" / "signalk-server"
HAS_SIGNALK = WANTED and SIGNALK.is_file() and shutil.which("node") is not None
PATIENCE_S = 90.0
# every socket of the server on loopback alone: by itself it listens on all interfaces
LOOPBACK = """
const net = require('net'), dgram = require('dgram')
const listen = net.Server.prototype.listen
net.Server.prototype.listen = function (port, ...rest) {
  const options = typeof port === 'object' ? port : { port: Number(port) }
  return listen.call(this, { ...options, host: '127.0.0.1' }, rest.find((each) => typeof each === 'function'))
}
const bind = dgram.Socket.prototype.bind
dgram.Socket.prototype.bind = function (port, ...rest) {
  const number = typeof port === 'object' ? port.port : port
  return bind.call(this, { port: Number(number) || 0, address: '127.0.0.1' }, rest.find((e) => typeof e === 'function'))
}
"""


@contextlib.contextmanager
def program(folder: Path, *command: str, **environment: str) -> Iterator[subprocess.Popen[str]]:
    """Run a program while the block lasts; what it says is in a file named after it."""
    with (folder / f"{Path(command[0]).name}.txt").open("w") as output:
        process = subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=output,
            text=True,
            env={**os.environ, **environment},
        )
        try:
            yield process
        finally:
            process.terminate()
            process.wait(20)


def until(what: str, look: Callable[[], Any]) -> Any:
    end = time.monotonic() + PATIENCE_S
    while not (found := look()):
        assert time.monotonic() < end, f"{what} did not come"
        time.sleep(0.2)
    return found
