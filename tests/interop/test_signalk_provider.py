"""A real signalk-server with our plugin steers the boat: both its APIs, who may, and who may not, and what is lost.

It runs where NORRBIN_INTEROP and NORRBIN_SIGNALK are set; see `test_outside_readers.py`.
"""

from __future__ import annotations

import contextlib
import math
import signal
import socket
import sys
from pathlib import Path
from typing import Any

import pytest
from outside_programs import HAS_SIGNALK, SIGNALK, program, until
from signalk_boat import TOKEN, Server, config_folder
from two_processes import free_port, patient_vessel, provoke, simulator

from autopilot.errors import InputError
from autopilot.runtime.record import read_log
from autopilot.signals import AlarmState, Mode

pytestmark = pytest.mark.skipif(not HAS_SIGNALK, reason="set NORRBIN_INTEROP=1 and NORRBIN_SIGNALK: see above")
GOAL_DEG = 60.0
SPEEDUP = 2


def near(value: Any, degrees: float, within: float = 2.0) -> bool:
    return value is not None and abs(math.remainder(math.degrees(value) - degrees, 360.0)) < within


def test_signal_k_programs_steer_the_boat_and_strangers_do_not(tmp_path: Path) -> None:
    web, bridge = free_port(socket.SOCK_STREAM), free_port(socket.SOCK_STREAM)
    sim, serve, log = free_port(), free_port(), tmp_path / "run.tlog"
    (tmp_path / "token").write_text(TOKEN + "\n")
    (tmp_path / "token").chmod(0o600)
    config = config_folder(tmp_path, web, bridge, TOKEN)
    pilot = [sys.executable, "-m", "autopilot", "run", str(patient_vessel(tmp_path)), "--as-gcs"]
    pilot += ["--link", f"udpin:127.0.0.1:{sim}", "--serve", f"udpout:127.0.0.1:{serve}", "--engage", str(GOAL_DEG)]
    pilot += ["--speedup", str(SPEEDUP), "--log", str(log)]
    between = [sys.executable, "-m", "autopilot", "signalk", "--link", f"udpin:127.0.0.1:{serve}"]
    between += ["--listen", f"127.0.0.1:{bridge}", "--token-file", str(tmp_path / "token")]
    node = ["node", "--require", str(config / "loopback.cjs"), str(SIGNALK)]
    server, pilots = Server(web), "v2/api/vessels/self/autopilots"
    (tmp_path / "a").mkdir()
    (tmp_path / "b").mkdir()
    with (
        simulator(SPEEDUP, "--mavlink", f"udpout:127.0.0.1:{sim}", "--armed"),
        program(tmp_path, *node, SIGNALK_NODE_CONFIG_DIR=str(config)),
        program(tmp_path / "a", *pilot),
    ):
        with program(tmp_path / "b", *between) as bridging:
            until("the course held", lambda: near(server.value("navigation/headingTrue"), GOAL_DEG))
            assert until("the state", lambda: server.value("steering/autopilot/state")) == "auto"
            status, data = server.ask(f"{pilots}/norrbin")
            assert status == 200 and data["engaged"] is True and near(data["target"], GOAL_DEG)
            assert {state["name"] for state in data["options"]["states"]} >= {"auto", "route", "standby"}
            # who is not signed in changes nothing
            for path, method, value in (
                (f"{pilots}/norrbin/target/adjust", "PUT", 30),
                (f"{pilots}/norrbin/disengage", "POST", None),
                ("v1/api/vessels/self/steering/autopilot/state", "PUT", "standby"),
            ):
                status, _ = server.ask(path, value, method, user=False)
                assert status in (401, 403), (path, status)
            assert server.value("steering/autopilot/state") == "auto"
            # +10 by the autopilot API, as Freeboard-SK does; -20 by a PUT of version 1, as KIP does
            assert server.ask(f"{pilots}/_default/target/adjust", 10, "PUT")[0] == 200
            until("the turn to starboard", lambda: near(server.value("navigation/headingTrue"), GOAL_DEG + 10))
            v1 = "v1/api/vessels/self/steering/autopilot"
            assert server.ask(f"{v1}/actions/adjustHeading", -20, "PUT")[0] in (200, 202)
            until("the turn to port", lambda: near(server.value("navigation/headingTrue"), GOAL_DEG - 10))
            assert near(server.ask(f"{pilots}/norrbin/target")[1]["value"], GOAL_DEG - 10)
            assert server.ask(f"{pilots}/norrbin/target", 80, "PUT")[0] == 200
            until("the heading ordered", lambda: near(server.value("navigation/headingTrue"), 80))
            assert server.ask(f"{pilots}/norrbin/tack/port", None, "POST")[0] == 409
            assert server.ask(f"{pilots}/norrbin/state", "wind", "PUT")[0] == 409
            assert server.ask(f"{pilots}/norrbin/disengage", None, "POST")[0] == 200
            until("standby", lambda: server.value("steering/autopilot/state") == "standby")
            # refused at first: so soon a dashboard may not have shown the standby
            until("engaging", lambda: server.ask(f"{pilots}/norrbin/engage", None, "POST")[0] == 200)
            until("engaged again", lambda: server.value("steering/autopilot/state") == "auto")
            # a bridge that stands still: the order fails, and is not carried out when it goes on
            before = until("a target again", lambda: server.ask(f"{pilots}/norrbin/target")[1]["value"])
            bridging.send_signal(signal.SIGSTOP)
            assert server.ask(f"{pilots}/norrbin/target", 200, "PUT")[0] in (503, 504)
            until("a bridge that is silent", lambda: server.value("steering/autopilot/state") == "off-line")
            bridging.send_signal(signal.SIGCONT)
            until("the bridge that goes on", lambda: server.value("steering/autopilot/state") == "auto")
            assert near(server.ask(f"{pilots}/norrbin/target")[1]["value"], math.degrees(before), 0.5)
        # the bridge is gone: said, and orders are refused with the reason; the boat steers on
        until("off-line", lambda: server.value("steering/autopilot/state") == "off-line")
        status, words = server.ask(f"{pilots}/norrbin/target/adjust", 10, "PUT")
        assert status == 503 and "not there" in words
        with program(tmp_path / "b", *between):
            until("the bridge again", lambda: server.value("steering/autopilot/state") == "auto")
    assert read_log(log).ticks[-1].mode is Mode.ENGAGED


def test_alarms_are_acknowledged_on_board_from_signal_k(tmp_path: Path) -> None:
    web, bridge = free_port(socket.SOCK_STREAM), free_port(socket.SOCK_STREAM)
    sim, serve, control = free_port(), free_port(), free_port()
    (tmp_path / "token").write_text(TOKEN + "\n")
    (tmp_path / "token").chmod(0o600)
    config = config_folder(tmp_path, web, bridge, TOKEN)
    pilot = [sys.executable, "-m", "autopilot", "run", str(patient_vessel(tmp_path)), "--as-gcs"]
    pilot += ["--link", f"udpin:127.0.0.1:{sim}", "--serve", f"udpout:127.0.0.1:{serve}", "--engage", str(GOAL_DEG)]
    pilot += ["--speedup", str(SPEEDUP), "--log", str(tmp_path / "run.tlog")]
    between = [sys.executable, "-m", "autopilot", "signalk", "--link", f"udpin:127.0.0.1:{serve}"]
    between += ["--listen", f"127.0.0.1:{bridge}", "--token-file", str(tmp_path / "token")]
    node = ["node", "--require", str(config / "loopback.cjs"), str(SIGNALK)]
    server = Server(web)
    (tmp_path / "a").mkdir()
    (tmp_path / "b").mkdir()

    def alarm(path: str = "batteryLow") -> dict[str, Any]:
        return server.value(f"notifications/steering/autopilot/norrbin/{path}") or {}

    def sounds(path: str = "batteryLow") -> bool:
        return "sound" in alarm(path).get("method", [])

    def on_board() -> bool:
        with contextlib.suppress(InputError, OSError):
            return any(
                AlarmState.ACKNOWLEDGED in tick.alarm_states for tick in read_log(tmp_path / "run.tlog").ticks[-20:]
            )
        return False

    with (
        simulator(SPEEDUP, "--mavlink", f"udpout:127.0.0.1:{sim}", "--armed", "--control", f"127.0.0.1:{control}"),
        program(tmp_path, *node, SIGNALK_NODE_CONFIG_DIR=str(config)),
        program(tmp_path / "a", *pilot),
        program(tmp_path / "b", *between),
    ):
        until("the course held", lambda: near(server.value("navigation/headingTrue"), GOAL_DEG))
        provoke(control, "battery_low")
        until("the alarm", sounds)
        # the notifications API knows no sign-in, so that nobody may acknowledge there
        for user in (False, True):
            status, words = server.ask(f"v2/api/notifications/{alarm()['id']}/acknowledge", None, "POST", user)
            assert status == 400 and "cannot be acknowledged" in words
        v1 = "v1/api/vessels/self"
        path = f"{v1}/notifications/steering/autopilot/norrbin/batteryLow/method"
        assert server.ask(path, ["visual"], "PUT", user=False)[0] in (401, 403)
        server.ask(path, ["visual", "sound"], "PUT")
        assert sounds() and not on_board()
        # silenced by a PUT, as KIP does
        assert server.ask(path, ["visual"], "PUT")[0] in (200, 202)
        until("acknowledged on board", on_board)
        until("silence", lambda: alarm().get("method") == ["visual"])
        provoke(control, "clear")
        until("the end of the alarm", lambda: alarm().get("state") == "normal")
        provoke(control, "shallow")
        until("another alarm", lambda: sounds("shallow"))
        assert server.ask(f"{v1}/steering/autopilot/actions/acknowledge", True, "PUT")[0] in (200, 202)
        until("acknowledged on board again", lambda: on_board() and not sounds("shallow"))
        # a man overboard whom a chart program reports sounds on board, and has the place that it says
        status, raised = server.send("v2/api/notifications/mob", {"message": "Man overboard"}, "POST")
        assert status == 200

        def overboard() -> str:
            return (server.value("notifications/mob") or {}).get("message", "")

        until("the man overboard on board", lambda: "man overboard" in overboard().lower())
        assert server.send(f"v2/api/notifications/{raised['id']}", None, "DELETE")[0] == 200
        assert "man overboard" in overboard().lower(), "it is ended on board alone"


def test_a_plugin_without_the_token_only_looks_and_a_plain_connection_reads_along(tmp_path: Path) -> None:
    web, bridge, serve = free_port(socket.SOCK_STREAM), free_port(socket.SOCK_STREAM), free_port()
    (tmp_path / "token").write_text(TOKEN + "\n")
    (tmp_path / "token").chmod(0o600)
    config = config_folder(tmp_path, web, bridge, "another-token-of-letters", also_plain=True)
    between = [sys.executable, "-m", "autopilot", "signalk", "--link", f"udpin:127.0.0.1:{serve}"]
    between += ["--listen", f"127.0.0.1:{bridge}", "--token-file", str(tmp_path / "token")]
    node = ["node", "--require", str(config / "loopback.cjs"), str(SIGNALK)]
    server = Server(web)
    with program(tmp_path, *node, SIGNALK_NODE_CONFIG_DIR=str(config)), program(tmp_path, *between):
        until("the state", lambda: server.value("steering/autopilot/state") == "off-line")

        def refused() -> bool:
            status, words = server.ask("v2/api/vessels/self/autopilots/norrbin/disengage", None, "POST")
            return status == 401 and "no valid token" in words

        until("the refusal", refused)

        def read_along() -> bool:
            _, found = server.ask("v1/api/vessels/self/steering/autopilot/state")
            sources = found.get("values", {}) if isinstance(found, dict) else {}
            return any(source.startswith("plain") and each["value"] == "off-line" for source, each in sources.items())

        until("the plain connection's values", read_along)
