"""Debian packages and an OCI image of a built wheel: `.ci/release` calls this.

A package holds a virtual environment in /opt/norrbin for the Python of one Debian release, with wheels of the package
index for one architecture, the commands in /usr/bin, completions, manual pages, and a systemd unit that is not enabled.
Nothing is compiled, so that arm64 is made on amd64. The same wheel, lock file and time give the same bytes.
"""

from __future__ import annotations

import argparse
import gzip
import hashlib
import io
import json
import os
import shutil
import subprocess
import sys
import tarfile
import tempfile
from collections.abc import Iterable, Iterator
from pathlib import Path

from autopilot import __version__
from autopilot.cli.install_service import Service, unit_text, user_text

ROOT = Path(__file__).parent.parent
HOME = "opt/norrbin"
MACHINES = {"amd64": "x86_64", "arm64": "aarch64"}
GLIBC = ("2_17", "2_24", "2_26", "2_27", "2_28")
"""Debian 12 has 2.36, so that each of these runs there."""
DIALECT = "v20/ardupilotmega.py"
"""The only MAVLink dialect that is imported; pymavlink's others weigh a quarter of all that is installed."""
NOT_IN_IMAGE = ("DEBIAN", "var/cache/apt/", "var/lib/apt/lists/", "var/log/", "proc/", "sys/", "dev/", "run/", "tmp/")
UNIT_ARGUMENTS = "NORRBIN_ARGUMENTS_PLACE"
CONTROL = """\
Package: norrbin
Version: {version}
Architecture: {architecture}
Maintainer: the Norrbin developers <norrbin@localhost>
Depends: python{python}
Section: misc
Priority: optional
Installed-Size: {size}
Description: turns a sea trial into a boat autopilot
 Record a zigzag, identify the boat, design its gains with their margins, and steer it from a companion computer over
 MAVLink or plain serial.
"""
POSTINST = """\
#!/bin/sh
set -e
if [ "$1" = configure ]; then
    # the service's user cannot write there, and would compile at every start
    /opt/norrbin/bin/python3 -m compileall -q /opt/norrbin/lib || true
    command -v systemd-sysusers > /dev/null && systemd-sysusers norrbin.conf || true
    [ -d /run/systemd/system ] && systemctl daemon-reload || true
    echo "norrbin: begin with 'autopilot new-boat my-boat.yaml'; steer from power-on: /etc/default/norrbin"
fi
"""
PRERM = """\
#!/bin/sh
set -e
if [ "$1" = remove ] && [ -d /run/systemd/system ]; then
    systemctl stop norrbin || true
fi
if [ "$1" = remove ] && command -v systemctl > /dev/null; then
    systemctl --quiet disable norrbin || true
fi
find /opt/norrbin -type d -name __pycache__ -prune -exec rm -rf {} +
"""
POSTRM = """\
#!/bin/sh
set -e
[ -d /run/systemd/system ] && systemctl daemon-reload || true
"""
DEFAULTS = """\
# The arguments of `autopilot run` when the service steers: systemctl enable --now norrbin.
# Put your boat's file at /var/lib/norrbin/boat.yaml first, and name its links here.
NORRBIN_ARGUMENTS="/var/lib/norrbin/boat.yaml --link serial:/dev/serial0:57600 --as-gcs --reconnect --wait 0 \\
--realtime --log-dir /var/log/norrbin"
"""


def tree(wheel: Path, folder: Path, architecture: str, python: str) -> None:
    """Lay out what the package installs below `folder`."""
    site = folder / HOME / "lib" / f"python{python}" / "site-packages"
    machine = MACHINES[architecture]
    platforms = [f"manylinux_{glibc}_{machine}" for glibc in GLIBC] + [f"manylinux2014_{machine}"]
    command = [sys.executable, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--no-compile"]
    command += ["--only-binary=:all:", "--python-version", python, "--implementation", "cp", "--target", str(site)]
    command += [word for platform in platforms for word in ("--platform", platform)]
    command += ["--constraint", str(ROOT / "requirements.lock"), f"{wheel}[web,edit]"]
    subprocess.run(command, check=True)
    shutil.rmtree(site / "bin", ignore_errors=True)
    prune(site)
    home = folder / HOME
    (home / "bin").mkdir()
    (home / "pyvenv.cfg").write_text(f"home = /usr/bin\ninclude-system-site-packages = false\nversion = {python}\n")
    for name in ("python", "python3"):
        (home / "bin" / name).symlink_to(f"/usr/bin/python{python}")
    commands = folder / "usr/bin"
    commands.mkdir(parents=True)
    for name, call in (
        ("autopilot", "from autopilot.__main__ import autopilot as main"),
        ("sitl", "from sitl.__main__ import main"),
    ):
        script = home / "bin" / name
        script.write_text(f"#!/{HOME}/bin/python3\n{call}\n\nif __name__ == '__main__':\n    main()\n")
        script.chmod(0o755)
        (commands / name).symlink_to(f"/{HOME}/bin/{name}")
    helps(folder)
    service(folder)


def prune(site: Path) -> None:
    """Leave out what no command loads: the numerical libraries' own tests, and the MAVLink dialects but DIALECT.

    Raises FileNotFoundError where that dialect is not where it is kept: nothing is left out by a wrong guess.
    """
    dialects = site / "pymavlink/dialects"
    kept = {dialects / "__init__.py", dialects / "v20/__init__.py", dialects / DIALECT}
    for path in kept:
        path.stat()
    for path in sorted(dialects.rglob("*")):
        if path.is_file() and path not in kept:
            path.unlink()
    shutil.rmtree(dialects / "v10")
    for library in ("numpy", "scipy"):
        for tests in sorted((site / library).rglob("tests")):
            shutil.rmtree(tests)


def helps(folder: Path) -> None:
    """Write completions and manual pages."""
    for program in ("autopilot", "sitl"):
        for shell, place in (
            ("bash", f"usr/share/bash-completion/completions/{program}"),
            ("zsh", f"usr/share/zsh/vendor-completions/_{program}"),
            ("fish", f"usr/share/fish/vendor_completions.d/{program}.fish"),
        ):
            said = subprocess.run([sys.executable, "-m", program, "completion", shell], capture_output=True, check=True)
            save(folder / place, said.stdout)
    for title, text in manuals():
        save(folder / f"usr/share/man/man1/{title}.1.gz", gzip.compress(text.encode(), mtime=0))


def manuals() -> Iterator[tuple[str, str]]:
    """Yield the manual page of every command by its name, autopilot, autopilot-run and so on: its help as it stands."""
    from autopilot.cli.main import build_parser as autopilot_parser
    from sitl.cli import build_parser as sitl_parser

    os.environ["COLUMNS"] = "75"  # of 80, man leaves seven free on the left
    for program, summary, parser in (
        ("autopilot", "turns a sea trial into a boat autopilot", autopilot_parser()),
        ("sitl", "the simulated boat", sitl_parser()),
    ):
        for name, said, command in _commands(program, summary, parser):
            text = command.format_help().replace("\\", "\\e").replace("-", "\\-")
            lines = [f"\\&{line}" if line.startswith((".", "'")) else line for line in text.splitlines()]
            yield (
                name,
                "\n".join(
                    [
                        f'.TH {name.upper()} 1 "" "norrbin {__version__}" "Norrbin"',
                        *(".SH NAME", f"{name} \\- {said}", ".SH DESCRIPTION", ".nf", *lines, ".fi"),
                        *(".SH SEE ALSO", f".BR {program} (1)", ""),
                    ]
                ),
            )


def _commands(
    name: str, summary: str, parser: argparse.ArgumentParser
) -> Iterator[tuple[str, str, argparse.ArgumentParser]]:
    yield name, summary, parser
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            said = {each.dest: each.help for each in action._choices_actions}
            for word, command in action.choices.items():
                yield from _commands(f"{name}-{word}", said.get(word) or summary, command)


def service(folder: Path) -> None:
    """Write the unit, its user and its arguments; udev rules are each boat's own (`autopilot install-service`)."""
    boat = Service("norrbin", "norrbin", ("/usr/bin/autopilot", "run", UNIT_ARGUMENTS))
    unit = unit_text(boat).replace(UNIT_ARGUMENTS, "$NORRBIN_ARGUMENTS")
    unit = unit.replace(
        "[Service]\n",
        "ConditionPathExists=/var/lib/norrbin/boat.yaml\n\n[Service]\nEnvironmentFile=/etc/default/norrbin\n",
    )
    # below usr: a folder /lib in the image would take the place of the root's link of that name, and all its libraries
    save(folder / "usr/lib/systemd/system/norrbin.service", unit.encode())
    save(folder / "usr/lib/sysusers.d/norrbin.conf", user_text(boat).encode())
    save(folder / "etc/default/norrbin", DEFAULTS.encode())
    rules = 'SUBSYSTEM=="tty", SUBSYSTEMS=="usb", GROUP="dialout", MODE="0660"\n'
    save(folder / "usr/lib/udev/rules.d/70-norrbin.rules", rules.encode())


def save(path: Path, data: bytes) -> None:
    """Write a file and the folders above it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data)


def deb(folder: Path, out: Path, architecture: str, python: str, epoch: int) -> Path:
    """Build the package of a laid out tree; return its path."""
    size = sum(path.stat().st_size for path in folder.rglob("*") if path.is_file() and not path.is_symlink()) // 1024
    control = CONTROL.format(version=__version__, architecture=architecture, python=python, size=size)
    save(folder / "DEBIAN/control", control.encode())
    save(folder / "DEBIAN/conffiles", b"/etc/default/norrbin\n")
    for name, script in (("postinst", POSTINST), ("prerm", PRERM), ("postrm", POSTRM)):
        save(folder / "DEBIAN" / name, script.encode())
        (folder / "DEBIAN" / name).chmod(0o755)
    for path in (folder, *folder.rglob("*")):
        os.utime(path, (epoch, epoch), follow_symlinks=False)
    place = out / f"norrbin_{__version__}_python{python}_{architecture}.deb"
    environment = {**os.environ, "SOURCE_DATE_EPOCH": str(epoch)}
    command = ["dpkg-deb", "--root-owner-group", "-Zxz", "--build", str(folder), str(place)]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, env=environment)
    return place


def layer(folder: Path, epoch: int) -> bytes:
    """Return a folder as a compressed layer of an image, its files in order, root's, and of one time."""
    packed = io.BytesIO()

    def plain(info: tarfile.TarInfo) -> tarfile.TarInfo | None:
        """Leave out control files, devices, and what belongs to the machine that made the root."""
        info.uid = info.gid = 0
        info.uname = info.gname = ""
        info.mtime = epoch
        return None if info.name.startswith(NOT_IN_IMAGE) or info.isdev() else info

    with tarfile.open(fileobj=packed, mode="w", format=tarfile.GNU_FORMAT) as archive:
        for path in sorted(folder.rglob("*")):
            archive.add(path, str(path.relative_to(folder)), recursive=False, filter=plain)
    return packed.getvalue()


def image(folders: Iterable[Path], out: Path, architecture: str, epoch: int, published_at: str = "") -> Path:
    """Write an OCI image whose layers are `folders`, the lowest first; return its path.

    Source: OCI image format 1.1 (image-layout, manifest, config).
    """
    blobs: dict[str, bytes] = {}

    def blob(data: bytes, kind: str) -> dict[str, object]:
        digest = hashlib.sha256(data).hexdigest()
        blobs[f"blobs/sha256/{digest}"] = data
        return {"mediaType": f"application/vnd.oci.image.{kind}", "digest": f"sha256:{digest}", "size": len(data)}

    layers, differences = [], []
    for folder in folders:
        packed = layer(folder, epoch)
        differences.append(f"sha256:{hashlib.sha256(packed).hexdigest()}")
        layers.append(blob(gzip.compress(packed, 6, mtime=0), "layer.v1.tar+gzip"))
    labels = {
        "org.opencontainers.image.title": "norrbin",
        "org.opencontainers.image.version": __version__,
        "org.opencontainers.image.licenses": "MIT",
        **blueos_labels(published_at),
    }
    config = {
        "architecture": architecture,
        "os": "linux",
        "config": {
            "Entrypoint": ["/usr/bin/autopilot"],
            "Env": ["PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin", "LANG=C.UTF-8"],
            "Cmd": PAGE.split(),
            "WorkingDir": "/var/lib/norrbin",
            "Labels": labels,
        },
        "rootfs": {"type": "layers", "diff_ids": differences},
    }
    manifest = {
        "schemaVersion": 2,
        "mediaType": "application/vnd.oci.image.manifest.v1+json",
        "config": blob(json.dumps(config, sort_keys=True).encode(), "config.v1+json"),
        "layers": layers,
    }
    described = blob(json.dumps(manifest, sort_keys=True).encode(), "manifest.v1+json")
    described["annotations"] = {"org.opencontainers.image.ref.name": f"norrbin:{__version__}"}
    index = {"schemaVersion": 2, "manifests": [described]}
    place = out / f"norrbin-{__version__}-{architecture}.oci.tar"
    with tarfile.open(place, "w", format=tarfile.GNU_FORMAT) as archive:
        for name, data in {
            "oci-layout": b'{"imageLayoutVersion": "1.0.0"}',
            "index.json": json.dumps(index, sort_keys=True).encode(),
            **dict(sorted(blobs.items())),
        }.items():
            info = tarfile.TarInfo(name)
            info.size, info.mtime = len(data), epoch
            archive.addfile(info, io.BytesIO(data))
    return place


PAGE = (
    "web --link udpin:127.0.0.1:14551 --listen 0.0.0.0:8080 --logs /var/lib/norrbin "
    "--token-file /var/lib/norrbin/web.token --boat /var/lib/norrbin/boat.yaml"
)
"""What the image does where nobody says: the page, with the steps to a boat's file, for a pilot that sends there."""


def blueos_labels(published_at: str = "") -> dict[str, str]:
    """Return what BlueOS reads of an extension's image: version, permissions, kind, who made it, and, where the project
    is published at an address, its links and README.

    Source: bluerobotics/BlueOS-Extensions-Repository, README and `extension.py`.
    """
    links = {
        "website": published_at,
        "documentation": f"{published_at}/tree/main/docs",
        "support": f"{published_at}/issues",
    }
    published = {"links": json.dumps(links), "readme": f"{published_at}/raw/{{tag_name}}/README.md"}
    permissions = {
        "ExposedPorts": {"8080/tcp": {}},
        "HostConfig": {
            "NetworkMode": "host",
            "Binds": ["/usr/blueos/extensions/norrbin:/var/lib/norrbin"],
        },
    }
    return {
        "version": __version__,
        "type": "device-integration",
        "tags": '["autopilot", "boat"]',
        "permissions": json.dumps(permissions, sort_keys=True),
        "requirements": "core >= 1.1",
        "authors": json.dumps([{"name": "the Norrbin developers", "email": ""}]),
        "company": json.dumps({"name": "Norrbin", "about": "Turns a sea trial into a boat autopilot.", "email": ""}),
        **(published if published_at else {}),
    }


def main() -> int:
    """Build what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("wheel", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--architecture", choices=MACHINES, action="append")
    parser.add_argument("--python", default="3.11", help="of Debian 12: 3.11, of Debian 13: 3.13 (3.11)")
    parser.add_argument("--rootfs", type=Path, help="a Debian root with that Python: makes an OCI image upon it, too")
    parser.add_argument("--published-at", default="", metavar="URL", help="where the project is: links of the image")
    chosen = parser.parse_args()
    chosen.out.mkdir(parents=True, exist_ok=True)
    epoch = int(os.environ.get("SOURCE_DATE_EPOCH", "0"))
    for architecture in chosen.architecture or MACHINES:
        with tempfile.TemporaryDirectory() as folder:
            root = Path(folder) / "root"
            root.mkdir()
            tree(chosen.wheel.resolve(), root, architecture, chosen.python)
            print(deb(root, chosen.out, architecture, chosen.python, epoch))
            if chosen.rootfs is not None and architecture == "amd64":
                print(image((chosen.rootfs, root), chosen.out, architecture, epoch, chosen.published_at))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
