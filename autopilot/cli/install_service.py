"""`autopilot install-service`: steer from power-on, as a system service with a watchdog and an ordinary user."""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

from autopilot.cli import service_files as service
from autopilot.cli.option_numbers import number
from autopilot.errors import ExitCode, InputError

DESCRIPTION = """\
Write the files of a systemd service that runs `autopilot run`: unit with watchdog, user, and udev rules that name the
USB adapters. A vessel file that is there already is kept."""


def add_parser(subparsers: argparse._SubParsersAction[Any]) -> None:
    """Add the subcommand."""
    parser = subparsers.add_parser(
        "install-service", help="steer from power-on: a system service with watchdog and user", description=DESCRIPTION
    )
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
    parser.add_argument("--user", help="user that it runs as, made where missing (default: the name)")
    parser.add_argument(
        "--python", default=sys.executable, metavar="FILE", help="Python to run with (default: this one)"
    )
    parser.add_argument(
        "--watchdog-s",
        action=number(service.WATCHDOG_MIN_S, 600.0),
        default=5.0,
        metavar="S",
        help="a loop silent for this is restarted",
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
    name = service.service_name(arguments.name)
    if arguments.uninstall:
        return _uninstall(name, arguments.root)
    wanted = _service_of(arguments, name)
    files = service.files_of(wanted)
    if arguments.dry_run:
        for path, text in files.items():
            print(f"# /{path}\n{text}")
        return int(ExitCode.OK)
    vessel = _put_vessel(arguments.vessel, _home(arguments.root, name) / "boat.yaml")
    for path, text in files.items():
        _write(arguments.root / path, text)
        print(f"wrote {arguments.root / path}")
    print(vessel)
    if arguments.root == Path("/"):
        _tell_system(["systemd-sysusers", f"/etc/sysusers.d/{name}.conf"])
        _reload()
        print(f"start it now and at every power-on: systemctl enable --now {name}")
        print(f"what it says: journalctl -fu {name}")
    return int(ExitCode.OK)


def _service_of(arguments: argparse.Namespace, name: str) -> service.Service:
    from autopilot.links.url import parse_url

    if arguments.vessel is None or not arguments.link:
        raise InputError("install-service: give the vessel file and at least one --link (or --uninstall)")
    links = [word for url in arguments.link for word in ("--link", parse_url(url).text)]
    command = [
        str(Path(arguments.python).absolute()), "-m", "autopilot", "run", f"/var/lib/{name}/boat.yaml", *links,
        "--reconnect", "--wait", "0", "--realtime", "--log-dir", f"/var/log/{name}", *arguments.run_with,
    ]  # fmt: skip
    _check_run(command[3:])
    user = service.service_name(arguments.user or name)
    adapters = tuple(map(service.adapter_of, arguments.adapter))
    return service.Service(name, user, tuple(command), adapters, arguments.watchdog_s)


def _check_run(command: list[str]) -> None:
    """Let `autopilot run` read its command line now: at the next power-on nobody is there to see the mistake."""
    from autopilot.cli.main import build_parser

    build_parser(command).parse_args(command)


def _put_vessel(source: str, target: Path) -> str:
    """Copy the vessel file to where the service reads it; one that is there stays. Raises InputError."""
    from autopilot.params.vessel_file import dump_vessel, load_vessel

    vessel = load_vessel(source)
    if target.exists():
        return f"kept {target}: remove it first to have {source} in its place"
    own = Path(source)
    _write(target, own.read_text() if own.is_file() else dump_vessel(vessel))
    return f"wrote {target}, the vessel file of the service"


def _uninstall(name: str, root: Path) -> int:
    if root == Path("/"):
        _tell_system(["systemctl", "disable", "--now", f"{name}.service"])
    asked = service.Service(name, name, (), (service.Adapter("any", "any"),))
    there = [root / path for path in service.files_of(asked) if (root / path).exists()]
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
    from autopilot.params.saving import replace_file

    try:
        if path.exists() and not path.is_file():
            raise InputError(f"{path}: is no file, as where systemd is told to leave it out; remove it first")
        path.parent.mkdir(parents=True, exist_ok=True)
        replace_file(path, text)
    except OSError as error:
        raise _cannot(path, error) from None


def _cannot(path: Path, error: OSError) -> InputError:
    return InputError(f"{path}: {error.strerror}; run it as root (sudo), or below another folder with --root")


def _reload() -> None:
    _tell_system(["systemctl", "daemon-reload"])
    _tell_system(["udevadm", "control", "--reload"])
    _tell_system(["udevadm", "trigger", "--subsystem-match=tty"])


def _tell_system(command: list[str]) -> None:
    """Run a command of the system; where it fails, say what is left to do by hand."""
    found = shutil.which(command[0])
    done = subprocess.run([found, *command[1:]], capture_output=True, text=True, check=False) if found else None
    if done is None or done.returncode != 0:
        why = "not found" if done is None else (done.stderr.strip().splitlines() or ["failed"])[-1]
        print(f"not done: {' '.join(command)} ({why})", file=sys.stderr)
