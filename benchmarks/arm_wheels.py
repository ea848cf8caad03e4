"""Is there a wheel of every dependency for the boards that boats carry? Asks the package index, builds nothing.

python benchmarks/arm_wheels.py
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path

BOARDS = {
    "Debian 12, Raspberry Pi OS 12 (64 bit)": ("3.11", ("manylinux_2_36_aarch64", "manylinux_2_28_aarch64")),
    "Debian 13, Raspberry Pi OS 13 (64 bit)": ("3.13", ("manylinux_2_41_aarch64", "manylinux_2_28_aarch64")),
}
OLDER = ("manylinux_2_27_aarch64", "manylinux_2_17_aarch64", "manylinux2014_aarch64")
EXTRAS = ("", "report", "fast", "n2k", "field", "ulog", "web")


def requirements(extra: str) -> list[str]:
    """Return what an extra needs beside the core; the core itself for ''."""
    project = tomllib.loads(Path("pyproject.toml").read_text())["project"]
    return list(project["optional-dependencies"].get(extra, []) if extra else project["dependencies"])


def download(python: str, platforms: tuple[str, ...], wanted: list[str]) -> tuple[list[str], float, str]:
    """Return the wheels that one set of requirements comes down to, their megabytes, and pip's complaint."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "pip", "download", "-q", "--disable-pip-version-check", "-d", folder]
        command += ["--only-binary=:all:", "--implementation", "cp", "--python-version", python]
        command += [word for platform in (*platforms, *OLDER) for word in ("--platform", platform)]
        done = subprocess.run([*command, *wanted], capture_output=True, text=True, check=False)
        wheels = sorted(Path(folder).glob("*.whl"))
        complaint = (done.stderr.strip().splitlines() or [""])[-1] if done.returncode else ""
        return [wheel.name for wheel in wheels], sum(wheel.stat().st_size for wheel in wheels) / 1e6, complaint


def main() -> None:
    """Ask and print a table; exit code 1 where a wheel of the core is missing."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--list", action="store_true", help="name the wheels")
    arguments = parser.parse_args()
    is_missing = False
    print("| board | Python | what | wheels | MB | missing |\n|---|---|---|---|---|---|")
    for board, (python, platforms) in BOARDS.items():
        for extra in EXTRAS:
            wanted = requirements(extra)
            if not wanted:
                continue
            wheels, size, complaint = download(python, platforms, wanted)
            is_missing |= bool(complaint) and not extra
            name = f"`[{extra}]`" if extra else "core"
            print(f"| {board} | {python} | {name} | {len(wheels)} | {size:.0f} | {complaint or 'none'} |", flush=True)
            if arguments.list:
                print("\n".join(f"    {wheel}" for wheel in wheels))
    sys.exit(is_missing)


if __name__ == "__main__":
    main()
