"""The files that make a steering process a system service: unit, user, names of adapters. Text alone; nothing is read.

Sources: systemd.service(5), systemd.exec(5), systemd.resource-control(5), sysusers.d(5), udev(7).
"""

from __future__ import annotations

import re
from typing import NamedTuple

from autopilot.errors import InputError

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
# bad usage and files that cannot be used do not mend by themselves
RestartPreventExitStatus=2

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
