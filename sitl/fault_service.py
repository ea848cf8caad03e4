"""Faults by command while the boat sails: `sitl fault` sends a line of text, the served boat answers with one.

    rudder_slow size=0.2 for=10 ramp=2    begins now, and ends after 10 simulated seconds; without `for`, never
    heading_frozen source=first           of one of two compasses alone, first or second
    clear [KIND]                          ends what is at work and what is to come
    list                                  names what is at work

UDP on the loopback interface alone: whoever may start processes on this machine may break the simulated boat.
"""

from __future__ import annotations

import difflib
import math
import socket

from autopilot.errors import InputError
from autopilot.files.outside import typed_number
from autopilot.links.base import LinkError, NotThereError
from sitl.faults import Fault
from sitl.registry import KINDS, SOURCES, FaultKind, Source, wrong_size, wrong_source
from sitl.world import World

ANSWER_S = 3.0
LONGEST = 4096
WORDS = ("size", "for", "ramp", "after")


def service_address(text: str) -> tuple[str, int]:
    """Return host and port of `HOST:PORT`, a loopback address. Raises InputError."""
    host, _, digits = text.rpartition(":")
    is_port = digits.isascii() and digits.isdigit() and len(digits) <= 5 and 1 <= int(digits) <= 65535
    if host not in ("127.0.0.1", "localhost") or not is_port:
        raise InputError(f"--control {text}: write 127.0.0.1:PORT, with a port from 1 to 65535.")
    return "127.0.0.1", int(digits)


class FaultService:
    """Listens for faults at a loopback address. Raises LinkError where it cannot."""

    def __init__(self, world: World, address: str) -> None:
        self._world = world
        place = service_address(address)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        try:
            self._socket.bind(place)
        except OSError as error:
            self._socket.close()
            raise LinkError(f"--control {address}: {error.strerror}; choose another port") from error

    def fileno(self) -> int:
        """Return the descriptor to wait on."""
        return self._socket.fileno()

    def serve(self) -> None:
        """Answer every line that waits."""
        while True:
            try:
                data, sender = self._socket.recvfrom(LONGEST)
            except (BlockingIOError, ConnectionError):
                return
            answer = obey(self._world, data.decode("utf-8", "replace"))
            try:
                self._socket.sendto(answer.encode(), sender)
            except OSError:
                continue  # who asked does not wait for the answer

    def close(self) -> None:
        """Give the port back."""
        self._socket.close()


def obey(world: World, line: str) -> str:
    """Do what a line says, now; return the answer, which begins with `ok` or `error`."""
    words = line.split()
    try:
        return f"ok {_obey(world, words)}"
    except InputError as error:
        return f"error {error}"


def _obey(world: World, words: list[str]) -> str:
    time = world.time
    if words == ["list"]:
        return ", ".join(f"{fault.kind} since {fault.begin:.2f} s" for fault in world.faults.at_work(time)) or "none"
    if words[:1] == ["clear"] and len(words) <= 2:
        kind = _kind(words[1]) if len(words) == 2 else None
        return f"{world.faults.clear(time, kind)} ended at {time:.2f} s"
    if not words:
        raise InputError("an empty line; write a fault such as rudder_stuck for=10, or list, or clear.")
    kind = _kind(words[0])
    source, rest = _source(words[1:])
    values = _values(rest)
    size = values.get("size")
    if wrong := wrong_size(kind, size) or wrong_source(kind, source):
        raise InputError(wrong)
    begin = time + values.get("after", 0.0)
    end = begin + values.get("for", math.inf)
    size = KINDS[kind].size if size is None else size
    world.faults.add(Fault(kind, begin, end, size, values.get("ramp", 0.0), source))
    until = f"to {end:.2f} s" if math.isfinite(end) else "until it is cleared"
    return f"{kind} from {begin:.2f} s {until}"


def _kind(name: str) -> FaultKind:
    if name not in KINDS:
        near = difflib.get_close_matches(name, KINDS, 1)
        hint = f"did you mean {near[0]}?" if near else "`sitl fault --kinds` lists them."
        raise InputError(f"{name}: no such fault; {hint}")
    return name


def _source(words: list[str]) -> tuple[Source, list[str]]:
    """Return which compass the words name, and the other words."""
    named = [word for word in words if word.startswith("source=")]
    rest = [word for word in words if not word.startswith("source=")]
    if not named:
        return "both", rest
    name = named[0].removeprefix("source=")
    if len(named) > 1 or name not in SOURCES:
        raise InputError(f"{' '.join(named)}: write source=first, source=second or source=both, once.")
    return name, rest


def _values(words: list[str]) -> dict[str, float]:
    values: dict[str, float] = {}
    for word in words:
        name, _, text = word.partition("=")
        try:
            number = typed_number(text)
        except ValueError:
            number = math.nan
        if name not in WORDS or name in values or not math.isfinite(number) or (name != "size" and number < 0.0):
            raise InputError(
                f"{word}: write {', '.join(f'{each}=NUMBER' for each in WORDS)} or source=NAME, each once."
            )
        values[name] = number
    return values


def kinds_table() -> str:
    """Return every fault with its size as a Markdown table."""
    rows = ["| fault | what | default size | allowed |", "|---|---|---|---|"]
    for name, kind in KINDS.items():
        size, allowed = (f"{kind.size:g} {kind.unit}", f"{kind.low:g} to {kind.high:g}") if kind.unit else ("", "")
        rows.append(f"| `{name}` | {kind.what} | {size} | {allowed} |")
    return "\n".join(rows)


def ask(address: str, line: str) -> str:
    """Send a line to the service at `address` and return its answer. LinkError where nobody answers."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as asker:
        asker.settimeout(ANSWER_S)
        try:
            asker.connect(service_address(address))
            asker.send(line.encode())
            return asker.recv(LONGEST).decode("utf-8", "replace")
        except ConnectionRefusedError as error:
            raise NotThereError(f"{address}: no answer; start `sitl serve` with --control {address}") from error
        except OSError as error:
            raise LinkError(f"{address}: no answer; start `sitl serve` with --control {address}") from error
