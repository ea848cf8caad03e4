"""Looks up every pinned dependency among the known weaknesses, and says plainly when that was not possible.

    python .ci/audit.py            # needs the extra `audit`

Ends with 1 where a weakness is known, with 0 otherwise, also where the database could not be asked: that is said.
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

LOCK = Path(__file__).parents[1] / "requirements.lock"
COMMAND = [sys.executable, "-m", "pip_audit", "--format", "json", "--progress-spinner", "off"]
COMMAND += ["--no-deps", "--disable-pip", "--requirement", str(LOCK)]
PATIENCE_S = 60.0


def verdict(report: dict[str, Any]) -> tuple[int, str]:
    """Return the exit code and what to say of pip-audit's report."""
    packages = report.get("dependencies", [])
    audited = [package for package in packages if "skip_reason" not in package]
    weak = [package for package in audited if package.get("vulns")]
    if weak:
        lines = [
            f"{package['name']} {package['version']}: {vuln['id']}, mended in {', '.join(vuln['fix_versions']) or '-'}"
            for package in weak
            for vuln in package["vulns"]
        ]
        return 1, "\n".join(["known weaknesses:", *lines])
    if not audited:
        return 0, "NOT AUDITED: the database of known weaknesses could not be reached from here"
    left = len(packages) - len(audited)
    unknown = f"; {left} could not be looked up" if left else ""
    return 0, f"{len(audited)} pinned packages audited, no weakness known{unknown}"


def main() -> int:
    """Ask, say, return the exit code."""
    try:
        done = subprocess.run(COMMAND, capture_output=True, text=True, timeout=PATIENCE_S, check=False)
        report = json.loads(done.stdout)
    except (subprocess.TimeoutExpired, ValueError):
        report = {}
    code, words = verdict(report)
    print(words)
    return code


if __name__ == "__main__":
    sys.exit(main())
