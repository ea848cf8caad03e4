"""KIP's own autopilot widget, in a browser, engages the pilot of a simulated boat, turns it, holds the wind and tacks.

It runs where NORRBIN_INTEROP and NORRBIN_SIGNALK are set and @mxtommy/kip is beside signalk-server; see
`test_outside_readers.py`.
"""

from __future__ import annotations

import json
import math
import shutil
from pathlib import Path
from typing import Any

import pytest
import signalk_boat
from outside_programs import HAS_SIGNALK, SIGNALK, until
from page_server import chromium
from signalk_boat import Server, sailing_in_a_wind, signed_in

KIP = SIGNALK.parents[2] / "@mxtommy" / "kip"
pytestmark = pytest.mark.skipif(
    not (HAS_SIGNALK and KIP.is_dir()), reason="set NORRBIN_INTEROP=1, NORRBIN_SIGNALK; KIP"
)
WIDGET = "d1d58e6f-f8b4-4a72-9597-7f92aa6776fc"


PLAIN = signalk_boat.config_folder


def with_kip(folder: Path, *given: Any) -> Path:
    """The server's folder with KIP in it."""
    config = PLAIN(folder, *given)
    (config / "node_modules" / "@mxtommy").mkdir()
    shutil.copytree(KIP, config / "node_modules" / "@mxtommy" / "kip")
    packages = {"signalk-norrbin": "0.2.0", "@mxtommy/kip": "4"}
    (config / "package.json").write_text(json.dumps({"name": "config", "dependencies": packages}))
    return config


def put_on_the_dashboard(page: Any, modes: list[str]) -> None:
    """Store a dashboard that is the widget alone, as KIP's own settings do."""
    pilot = {"apiVersion": "v2", "instanceId": "norrbin", "pluginId": "signalk-norrbin", "modes": modes}
    pilot |= {"invertRudder": True, "headingDirectionTrue": True, "courseDirectionTrue": True}
    widget = {"type": "widget-autopilot", "uuid": WIDGET, "config": {"filterSelfPaths": True, "autopilot": pilot}}
    place = {"w": 24, "h": 24, "x": 0, "y": 0, "id": WIDGET, "selector": "widget-host2"}
    board = {"id": WIDGET[::-1], "name": "Helm", "icon": "dashboard-dashboard", "collapseSplitShell": True}
    board["configuration"] = [{**place, "input": {"widgetProperties": widget}}]
    page.evaluate("board => { localStorage.dashboardsConfig = board }", json.dumps([board]))
    page.evaluate(
        "() => { const app = JSON.parse(localStorage.appConfig); app.splitShellEnabled = false;"
        " localStorage.appConfig = JSON.stringify(app) }"
    )
    page.reload()


def near(value: Any, degrees: float, within: float = 3.0) -> bool:
    return value is not None and abs(math.remainder(math.degrees(value) - degrees, 360.0)) < within


def steer(page: Any, server: Server) -> None:
    """Press the widget's buttons, and see what the boat does."""

    def press(words: str, number: int = 0) -> None:
        page.get_by_text(words, exact=True).nth(number).click()

    def pilot(name: str) -> Any:
        return server.value(f"steering/autopilot/{name}")

    def target() -> Any:
        return server.ask("v2/api/vessels/self/autopilots/norrbin/target")[1]["value"]

    press("Engage")
    until("engaged", lambda: (pilot("state"), pilot("engaged")) == ("auto", True))
    # what is held is heard a moment later than that something is
    until("the course", lambda: target() is not None)
    before = math.degrees(target())
    for step, turned in (("+10°", 10.0), ("+10°", 20.0), ("-1°", 19.0), ("-10°", 9.0)):
        press(step)
        until("the turn", lambda turned=turned: near(server.value("navigation/headingTrue"), before + turned, 0.6))
    page.get_by_text("Mode Compass").click()
    press("Wind")
    until("the wind hold", lambda: (pilot("state"), pilot("mode")) == ("wind", "wind"))
    held = until("the angle held", lambda: pilot("target/windAngleApparent"))
    page.get_by_text("Wind Hold").wait_for()
    # asked once by KIP, and tacked at the second touch
    for _ in range(2):
        press("Tack", 1)
    until("the other tack", lambda: near(pilot("target/windAngleApparent"), -math.degrees(held), 0.1))
    until(
        "the turn through the wind",
        lambda: near(server.value("environment/wind/angleApparent"), -math.degrees(held), 4.0),
    )
    press("Disengage")
    until("standby", lambda: (pilot("state"), pilot("engaged")) == ("standby", False))


def test_kip_steers_the_boat(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(signalk_boat, "config_folder", with_kip)
    with sailing_in_a_wind(tmp_path, 2.0) as server, chromium() as browser:
        until("the pilot", lambda: server.value("steering/autopilot/state") == "standby")
        until("the wind", lambda: server.value("environment/wind/angleTrueWater") is not None)
        context = browser.new_context(viewport={"width": 1200, "height": 800})
        context.add_cookies([{"name": "JAUTHENTICATION", "value": signed_in(), "url": server.root}])
        page = context.new_page()
        refused: list[str] = []
        page.on("response", lambda got: refused.append(f"{got.status} {got.url}") if got.status >= 400 else None)
        page.goto(f"{server.root}/@mxtommy/kip/")
        page.wait_for_function("() => 'appConfig' in localStorage && 'dashboardsConfig' in localStorage")
        put_on_the_dashboard(page, server.ask("v2/api/vessels/self/autopilots/norrbin/options")[1]["modes"])
        page.get_by_text("Engage", exact=True).wait_for()
        steer(page, server)
        assert not [each for each in refused if "/autopilots/" in each]
