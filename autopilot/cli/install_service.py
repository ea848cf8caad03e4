"""`autopilot install-service`: steer from power-on, as a system service with a watchdog and an ordinary user.

The files that make a steering process a system service: unit, user, names of adapters. Text alone; nothing is read.

Sources: systemd.service(5), systemd.exec(5), systemd.resource-control(5), sysusers.d(5), udev(7).
"""

from __future__ import annotations

import argparse
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from autopilot.cli.options import named_vessel, number
from autopilot.errors import ExitCode, InputError
from autopilot.files.printable import print_file

if TYPE_CHECKING:
    from autopilot.vessel.schema import Vessel

WATCHDOG_MIN_S = 3.0
"""A loop of 1 Hz without a heading shows life every second and a half."""
NAME = re.compile(r"[a-z][a-z0-9-]{0,30}")
ADAPTER_NAME = re.compile(r"[a-z0-9][a-z0-9-]{0,30}")
SERIAL = re.compile(r"[A-Za-z0-9_.:-]{1,64}")
PORT = re.compile(r"\d+-\d+(\.\d+)*")
PLAIN = re.compile(r"[A-Za-z0-9_./:=,@+-]+")


class Adapter(NamedTuple):
    """An adapter /dev/`name`, known by its USB serial number or by the USB port it is in (such as 1-1.2)."""

    name: str
    serial: str = ""
    port: str = ""


class Service(NamedTuple):
    """What is installed: `command` steers; `name` is also that of the unit, of its folders and links."""

    name: str
    user: str
    command: tuple[str, ...]
    adapters: tuple[Adapter, ...] = ()
    watchdog_s: float = 5.0
    priority: int = 40


def adapter_of(text: str) -> Adapter:
    """Return the adapter that NAME=SERIAL or NAME=port:1-1.2 names. Raises InputError."""
    name, equals, key = text.partition("=")
    if not equals or not ADAPTER_NAME.fullmatch(name):
        raise InputError(f"--adapter {text}: write a name of small letters and digits, =, and the USB serial number")
    if key.startswith("port:"):
        port = key.removeprefix("port:")
        if not PORT.fullmatch(port):
            raise InputError(f"--adapter {text}: a USB port is written like port:1-1.2 (see `udevadm info -a`)")
        return Adapter(name, port=port)
    if not SERIAL.fullmatch(key):
        raise InputError(
            f"--adapter {text}: {key!r} is no USB serial number; `udevadm info /dev/ttyUSB0 | grep SERIAL_SHORT` shows "
            f"it, and adapters without one are named by their port: port:1-1.2"
        )
    return Adapter(name, serial=key)


def service_name(text: str) -> str:
    """Return `text` where it can name a unit and a user. Raises InputError."""
    if not NAME.fullmatch(text):
        raise InputError(f"{text!r}: a name of up to 31 small letters, digits and hyphens, a letter first, is allowed")
    return text


def files_of(service: Service) -> dict[str, str]:
    """Return the files by their paths below the root."""
    name = service.name
    files = {
        f"etc/systemd/system/{name}.service": unit_text(service),
        f"etc/sysusers.d/{name}.conf": user_text(service),
    }
    if service.adapters:
        files[f"etc/udev/rules.d/70-{name}.rules"] = rules_text(service)
    return files


def unit_text(service: Service) -> str:
    """Return the unit: restarted when it fails or hangs, an ordinary user with few rights, real time allowed."""
    name = service.name
    return f"""\
# Written by `autopilot install-service`; changes of yours belong into `systemctl edit {name}`.
[Unit]
Description=Norrbin boat autopilot
After=network.target
# a boat needs its autopilot however often it has failed
StartLimitIntervalSec=0

[Service]
Type=notify
NotifyAccess=main
ExecStart={" ".join(map(_word, service.command))}
WatchdogSec={service.watchdog_s:g}
TimeoutStartSec=60
TimeoutStopSec=10
TimeoutAbortSec=5
Restart=on-failure
RestartSec=200ms
# usage, a link that is none, files that cannot be used, and boats that cannot be steered by them do not mend
RestartPreventExitStatus=2 4

User={service.user}
Group={service.user}
SupplementaryGroups=dialout
StateDirectory={name}
WorkingDirectory=/var/lib/{name}
LogsDirectory={name}
RuntimeDirectory={name}
RuntimeDirectoryPreserve=restart
Environment=PYTHONUNBUFFERED=1

LimitRTPRIO={service.priority}
LimitMEMLOCK=infinity
OOMScoreAdjust=-900
MemoryMax=512M
TasksMax=64

NoNewPrivileges=yes
CapabilityBoundingSet=
ProtectSystem=strict
ProtectHome=read-only
PrivateTmp=yes
ProtectClock=yes
DeviceAllow=char-* rw
ProtectHostname=yes
ProtectKernelLogs=yes
ProtectKernelModules=yes
ProtectKernelTunables=yes
ProtectControlGroups=yes
LockPersonality=yes
RestrictNamespaces=yes
RestrictSUIDSGID=yes
RestrictAddressFamilies=AF_UNIX AF_INET AF_INET6 AF_NETLINK AF_CAN
SystemCallArchitectures=native

[Install]
WantedBy=multi-user.target
"""


def user_text(service: Service) -> str:
    """Return the user of the service, for systemd-sysusers: no shell, no password, may use serial lines."""
    return f"""\
# Written by `autopilot install-service`.
u {service.user} - "Norrbin boat autopilot" /var/lib/{service.name}
m {service.user} dialout
"""


def rules_text(service: Service) -> str:
    """Return the udev rules by which adapters keep their names, wherever and in whatever order they are plugged in."""
    lines = ["# Written by `autopilot install-service`."]
    for adapter in service.adapters:
        known = f'ATTRS{{serial}}=="{adapter.serial}"' if adapter.serial else f'KERNELS=="{adapter.port}"'
        lines.append(f'SUBSYSTEM=="tty", {known}, SYMLINK+="{adapter.name}", GROUP="dialout", MODE="0660"')
    return "\n".join(lines) + "\n"


def _word(text: str) -> str:
    """Return one word of a command line as ExecStart= reads it. Raises InputError."""
    if any(ord(character) < 32 for character in text):
        raise InputError(f"{text!r}: control characters cannot be in a service's command")
    escaped = text.replace("\\", "\\\\").replace('"', '\\"').replace("%", "%%").replace("$", "$$")
    return escaped if PLAIN.fullmatch(text) else f'"{escaped}"'


DESCRIPTION = """\
Write the files of a systemd service that runs `autopilot run`: unit with watchdog, user, and udev rules that name the
USB adapters. A vessel file that is there already is kept."""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.description = DESCRIPTION
    parser.add_argument("vessel", metavar="VESSEL.yaml", nargs="?", help="vessel file, or the name of a shipped one")
    parser.add_argument("--link", action="append", default=[], metavar="URL", help="as for `autopilot run`; repeatable")
    parser.add_argument(
        "--adapter",
        action="append",
        default=[],
        metavar="NAME=SERIAL",
        help="name the adapter with this USB serial number /dev/NAME (NAME=port:1-1.2: the one in this USB port)",
    )
    parser.add_argument("--name", default="norrbin", help="of the service and its folders (default norrbin)")
    parser.add_argument("--user", help="user to run as, created if missing (default: the name)")
    parser.add_argument(
        "--python", default=sys.executable, metavar="FILE", help="Python to run with (default: this one)"
    )
    parser.add_argument(
        "--watchdog-s",
        action=number(WATCHDOG_MIN_S, 600.0),
        default=5.0,
        metavar="S",
        help="restart a loop that is silent for this long",
    )
    parser.add_argument("--root", type=Path, default=Path("/"), metavar="DIR", help="write below DIR and run nothing")
    parser.add_argument("--dry-run", action="store_true", help="print the files and change nothing")
    parser.add_argument("--uninstall", action="store_true", help="remove the files; vessel, logs and user stay")
    parser.add_argument(
        "--run-with",
        action="append",
        default=[],
        metavar="OPTION",
        help="another option for `autopilot run`, such as --run-with=--as-gcs; repeatable",
    )
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Install, show or remove the service."""
    name = service_name(arguments.name)
    if arguments.uninstall:
        return _uninstall(name, arguments.root)
    wanted = _service_of(arguments, name)
    vessel = named_vessel(arguments.vessel)
    files = files_of(wanted)
    if arguments.dry_run:
        for path, text in files.items():
            print_file(f"# /{path}\n{text}\n")
        return int(ExitCode.OK)
    copied = _put_vessel(arguments.vessel, vessel, _home(arguments.root, name) / "boat.yaml")
    for path, text in files.items():
        _write(arguments.root / path, text)
        print(f"wrote {arguments.root / path}")
    print(copied)
    if arguments.root == Path("/"):
        _run_system(["systemd-sysusers", f"/etc/sysusers.d/{name}.conf"])
        _reload()
        print(f"start it now and at every power-on: systemctl enable --now {name}")
        print(f"what it says: journalctl -fu {name}")
    return int(ExitCode.OK)


def _service_of(arguments: argparse.Namespace, name: str) -> Service:
    from autopilot.links.url import parse_url

    if arguments.vessel is None or not arguments.link:
        raise InputError("install-service: give the vessel file and at least one --link (or --uninstall)")
    links = [word for url in arguments.link for word in ("--link", parse_url(url).text)]
    command = [
        str(Path(arguments.python).absolute()), "-m", "autopilot", "run", f"/var/lib/{name}/boat.yaml", *links,
        "--reconnect", "--wait", "0", "--realtime", "--log-dir", f"/var/log/{name}", *arguments.run_with,
    ]  # fmt: skip
    _check_run(command[3:])
    user = service_name(arguments.user or name)
    adapters = tuple(map(adapter_of, arguments.adapter))
    return Service(name, user, tuple(command), adapters, arguments.watchdog_s)


def _check_run(command: list[str]) -> None:
    """Let `autopilot run` read its command line now: at the next power-on nobody is there to see the mistake."""
    from autopilot.cli.main import build_parser

    build_parser(command).parse_args(command)


def _put_vessel(source: str, vessel: Vessel, target: Path) -> str:
    """Copy the vessel file to where the service reads it; one that is there stays. Raises InputError."""
    from autopilot.files.strict_yaml import text_of
    from autopilot.vessel.file import dump_vessel

    if target.exists():
        return f"kept {target}: remove it first to have {source} in its place"
    own = Path(source)
    _write(target, text_of(own) if own.is_file() else dump_vessel(vessel))
    return f"wrote {target}, the vessel file of the service"


def _uninstall(name: str, root: Path) -> int:
    if root == Path("/"):
        _run_system(["systemctl", "disable", "--now", f"{name}.service"])
    asked = Service(name, name, (), (Adapter("any", "any"),))
    there = [root / path for path in files_of(asked) if (root / path).exists()]
    for path in there:
        try:
            path.unlink()
        except OSError as error:
            raise _cannot(path, error) from None
        print(f"removed {path}")
    if root == Path("/"):
        _reload()
    print(
        f"{'left' if there else 'nothing was installed;'} {_home(root, name)}, {root / 'var/log' / name} and the user"
    )
    return int(ExitCode.OK)


def _home(root: Path, name: str) -> Path:
    return root / "var/lib" / name


def _write(path: Path, text: str) -> None:
    from autopilot.files.saving import replace_file

    try:
        if path.exists() and not path.is_file():
            raise InputError(f"{path}: is no file, as where systemd is set to leave it out; remove it first")
        path.parent.mkdir(parents=True, exist_ok=True)
        replace_file(path, text)
    except OSError as error:
        raise _cannot(path, error) from None


def _cannot(path: Path, error: OSError) -> InputError:
    return InputError(f"{path}: {error.strerror}; run it as root (sudo), or below another folder with --root")


def _reload() -> None:
    _run_system(["systemctl", "daemon-reload"])
    _run_system(["udevadm", "control", "--reload"])
    _run_system(["udevadm", "trigger", "--subsystem-match=tty"])


def _run_system(command: list[str]) -> None:
    """Run a command of the system; where it fails, say what is left to do by hand."""
    found = shutil.which(command[0])
    done = subprocess.run([found, *command[1:]], capture_output=True, text=True, check=False) if found else None
    if done is None or done.returncode != 0:
        why = "not found" if done is None else (done.stderr.strip().splitlines() or ["failed"])[-1]
        print(f"not done: {' '.join(command)} ({why})", file=sys.stderr)
