"""A hung tick under the real systemd: the unit of `autopilot install-service`, its watchdog, and the next process.

Runs a systemd of its own for one unit, in namespaces of its own (root is needed for these), stops the steering process
as a hung loop would stand still, and reads from systemd when it noticed and when the next process was ready. Where the
namespaces are not allowed it says so and ends.

    python benchmarks/systemd_watchdog.py
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
from pathlib import Path

from autopilot.cli.install_service import Service, unit_text

# What needs a system manager or a user that does not exist here; the rest of the unit is as it is installed.
NOT_FOR_A_USER_MANAGER = (
    "User=", "Group=", "SupplementaryGroups=", "StateDirectory=", "WorkingDirectory=", "LogsDirectory=",
    "OOMScoreAdjust=", "LimitRTPRIO=", "CapabilityBoundingSet=", "Protect", "Private", "DeviceAllow=", "Restrict",
    "LockPersonality=", "SystemCall", "NoNewPrivileges=", "MemoryMax=",
)  # fmt: skip
SCRIPT = r"""
set -e
mount -t tmpfs tmpfs /run && mkdir -p /run/systemd/system
umount -R /sys/fs/cgroup && mount -t cgroup2 none /sys/fs/cgroup && mkdir -p /sys/fs/cgroup/own
echo $$ > /sys/fs/cgroup/own/cgroup.procs
/lib/systemd/systemd --user --unit=norrbin.service > "$HERE/manager" 2>&1 &
value() { systemctl --user show norrbin.service --value -p "$1"; }
await() { for _ in $(seq 400); do [ "$(value "$1" 2>/dev/null)" = "$2" ] && return; sleep 0.1; done
          echo "never $1=$2"; cat "$HERE/manager" "$HERE/said" | tail -20; exit 1; }
seconds() { awk '{print $1}' /proc/uptime; }
await SubState running
echo "ready after $(( ($(value ActiveEnterTimestampMonotonic) - $(value ExecMainStartTimestampMonotonic)) / 1000 )) ms"
sleep 2
kill -STOP "$(value MainPID)"; stopped=$(seconds)
await NRestarts 1
await SubState running
echo "stopped at $stopped s"
echo "started again at $(( $(value ExecMainStartTimestampMonotonic) / 1000 )) ms"
echo "ready again at $(( $(value ActiveEnterTimestampMonotonic) / 1000 )) ms"
kill -KILL "$(value MainPID)"; killed=$(seconds)
await NRestarts 2
await SubState running
echo "killed at $killed s"
echo "ready after the kill at $(( $(value ActiveEnterTimestampMonotonic) / 1000 )) ms"
systemctl --user stop norrbin.service
echo "stopped: $(value Result)"
grep -m1 -o "Fatal Python error: Aborted" "$HERE/said"
"""


def main() -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--watchdog-s", type=float, default=5.0, help="WatchdogSec of the unit")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        here = Path(name)
        here.chmod(0o700)
        command = (sys.executable, "-m", "autopilot", "run", "lanxin", "--link", "udpin:127.0.0.1:0", "--wait", "0")
        unit = unit_text(Service("norrbin", "norrbin", command, watchdog_s=arguments.watchdog_s))
        kept = [line for line in unit.splitlines() if not line.startswith(NOT_FOR_A_USER_MANAGER)]
        where = f"StandardOutput=null\nStandardError=append:{here}/said\nEnvironment=PYTHONPATH={Path.cwd()}"
        text = "\n".join(kept).replace("[Service]", f"[Service]\n{where}")
        (here / "norrbin.service").write_text(text)
        environ = {
            **os.environ,
            "HERE": name,
            "XDG_RUNTIME_DIR": name,
            "SYSTEMD_UNIT_PATH": f"{name}:/usr/lib/systemd/user",
            "SYSTEMD_LOG_TARGET": "console",
        }
        isolated = ["unshare", "--mount", "--pid", "--fork", "--kill-child", "--mount-proc", "--cgroup", "bash", "-c"]
        done = subprocess.run([*isolated, SCRIPT], env=environ, timeout=180, check=False)
    sys.exit(done.returncode)


if __name__ == "__main__":
    main()
