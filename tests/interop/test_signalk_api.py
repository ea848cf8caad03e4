"""Every path of the server's own OpenAPI of autopilots, on a boat that sails in a wind: as it says, and any values.

It runs where NORRBIN_INTEROP and NORRBIN_SIGNALK are set; see `test_outside_readers.py`.
"""

from __future__ import annotations

import json
import math
import os
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from outside_programs import HAS_SIGNALK, SIGNALK, until
from signalk_boat import Server, sailing_in_a_wind

pytestmark = pytest.mark.skipif(not HAS_SIGNALK, reason="set NORRBIN_INTEROP=1 and NORRBIN_SIGNALK: see above")
SPEEDUP = 4
PILOTS = "v2/api/vessels/self/autopilots"
PILOT = f"{PILOTS}/norrbin"
OPENAPI = SIGNALK.parents[1] / "dist" / "api" / "autopilot" / "openApi.json"
EXAMPLES = 20 if "NORRBIN_SLOW" in os.environ else 5
"""Of each path and method."""


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Any:
    with sailing_in_a_wind(tmp_path_factory.mktemp("wind"), SPEEDUP) as made:
        until("the pilot", lambda: made.value("steering/autopilot/state") == "standby")
        until("the wind", lambda: made.value("environment/wind/angleTrueWater") is not None)
        yield made


def near(value: Any, degrees: float, within: float = 3.0) -> bool:
    return value is not None and abs(math.remainder(math.degrees(value) - degrees, 360.0)) < within


def put(server: Server, path: str, value: Any, **more: Any) -> int:
    return server.send(f"{PILOT}/{path}", {"value": value, **more}, "PUT")[0]


def post(server: Server, path: str) -> int:
    return server.send(f"{PILOT}/{path}", None, "POST")[0]


def pilot(server: Server) -> dict[str, Any]:
    status, data = server.ask(PILOT)
    assert status == 200
    return dict(data)


def test_every_path_is_answered_as_it_says(server: Server) -> None:
    assert server.ask(PILOTS) == (200, {"norrbin": {"provider": "signalk-norrbin", "isDefault": True}})
    assert server.ask(f"{PILOTS}/_providers/_default") == (200, {"id": "norrbin"})
    assert server.send(f"{PILOTS}/_providers/_default/norrbin", None, "POST")[0] == 200
    assert server.send(f"{PILOTS}/_providers/_default/another", None, "POST")[0] == 400
    assert server.value("steering/autopilot/defaultPilot") == "norrbin"
    found = pilot(server)
    assert (found["state"], found["mode"], found["engaged"], found["target"]) == ("standby", "compass", False, None)
    assert server.ask(f"{PILOT}/options") == (200, found["options"])
    assert found["options"]["modes"] == ["compass", "wind", "true wind", "route"]
    # nothing is steered: what needs that is refused
    for path, value in (("target", 1.0), ("target/adjust", 0.1), ("dodge", 0.1)):
        assert put(server, path, value) == 409
    for path in ("dodge", "tack/port", "gybe/starboard", "courseCurrentPoint", "courseNextPoint"):
        assert post(server, path) == 409
    assert put(server, "state", "sail") == 400 and put(server, "mode", "gps") == 400
    # a mode is chosen, then engaged in, as KIP does
    assert put(server, "mode", "true wind") == 200 and pilot(server)["engaged"] is False
    assert put(server, "state", "enabled") == 200
    until("the wind hold", lambda: (pilot(server)["state"], pilot(server)["mode"]) == ("wind", "true wind"))
    until("the mode", lambda: server.value("steering/autopilot/mode") == "true wind")
    assert put(server, "target", 50, units="deg") == 200
    until("50 deg", lambda: near(server.value("environment/wind/angleTrueWater"), 50.0))
    assert near(server.ask(f"{PILOT}/target")[1]["value"], 50.0, 0.1)
    assert put(server, "target/adjust", math.radians(10.0)) == 200
    until("the turn to starboard", lambda: near(server.ask(f"{PILOT}/target")[1]["value"], 40.0, 0.1))
    available = server.value("steering/autopilot/availableActions")
    assert available == ["dodge", "tack", "gybe", "courseCurrentPoint"]
    assert post(server, "tack/port") == 409, "through the wind it goes to starboard"
    assert post(server, "tack/starboard") == 200
    until("the other tack", lambda: near(server.value("environment/wind/angleTrueWater"), -40.0))
    assert near(server.value("steering/autopilot/target/windAngleTrueWater"), -40.0, 0.1)
    until("the end of the turn", lambda: put(server, "target", -130, units="deg") == 200)
    until("130 deg", lambda: near(server.value("environment/wind/angleTrueWater"), -130.0))
    assert post(server, "gybe/port") == 409 and post(server, "gybe/starboard") == 200
    until("the other gybe", lambda: near(server.value("environment/wind/angleTrueWater"), 130.0))
    # another mode while it steers, and dodging there
    assert put(server, "mode", "compass") == 200
    until("the compass", lambda: pilot(server)["mode"] == "compass")
    before = pilot(server)["target"]
    assert post(server, "dodge") == 200 and put(server, "dodge", -10, units="deg") == 200
    until("the step aside", lambda: near(pilot(server)["target"], math.degrees(before) - 10.0, 0.5))
    assert server.send(f"{PILOT}/dodge", None, "DELETE")[0] == 200
    until("the way back", lambda: near(pilot(server)["target"], math.degrees(before), 0.5))
    assert post(server, "disengage") == 200
    until("standby", lambda: pilot(server)["state"] == "standby")
    until("engaging", lambda: post(server, "engage") == 200)
    until("engaged", lambda: server.value("steering/autopilot/engaged") is True)
    # and version 1
    v1 = "v1/api/vessels/self/steering/autopilot"
    for path, value, low in (
        ("state", "wind", 200),
        ("target/windAngleApparent", 0.7, 200),
        ("actions/adjustHeading", 10, 200),
        ("actions/tack", "starboard", 200),
        ("state", "auto", 200),
    ):
        status, words = server.ask(f"{v1}/{path}", value, "PUT")
        assert status in (low, 202), (path, status, words)
    assert server.ask(f"{v1}/actions/advanceWaypoint", "1", "PUT")[0] in (202, 409)


JSON = st.recursive(
    st.none() | st.booleans() | st.floats(allow_nan=False, allow_infinity=False) | st.integers() | st.text(max_size=9),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=5,
)
WORDS = st.sampled_from(
    ["auto", "wind", "route", "standby", "trial", "off-line", "enabled", "disabled", "compass", "true wind", "gps"]
)
ANGLE = st.floats(-10.0, 10.0) | st.floats(-400.0, 400.0) | st.sampled_from([0, 1e308, -1e308, 5e-324, 10, -10])
BODY = (
    st.fixed_dictionaries({"value": ANGLE | WORDS | JSON}, optional={"units": st.sampled_from(["deg", "rad"]) | JSON})
    | st.dictionaries(st.text(max_size=5), JSON, max_size=3)
    | st.lists(JSON, max_size=3)
)


def operations() -> list[tuple[str, str]]:
    paths = json.loads(OPENAPI.read_text())["paths"]
    methods = ("get", "put", "post", "delete")
    return [(path, method) for path, found in paths.items() for method in methods if method in found]


def test_no_request_that_is_json_is_an_error_of_the_server(server: Server) -> None:
    """Known pilots only: signalk-server itself answers another name, and what is no JSON, with 500."""
    assert len(operations()) >= 20
    statuses = set()

    @settings(max_examples=EXAMPLES, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))
    @given(st.sampled_from(["norrbin", "_default"]), BODY | st.none())
    def fuzz(path: str, method: str, name: str, body: Any) -> None:
        where = f"{PILOTS}{path.replace('{id}', name)}".rstrip("/")
        status, answer = server.send(where, None if method in ("get", "delete") else body, method.upper())
        statuses.add(status)
        assert status in (200, 400, 404, 409), (path, method, name, body, status, answer)
        if status != 200:
            said = json.loads(answer)
            assert said["state"] == "FAILED" and said["statusCode"] == status and said["message"]

    for path, method in operations():
        fuzz(path, method)
    assert statuses >= {200, 400, 409}
    assert pilot(server)["state"] in ("auto", "wind", "standby")


def test_a_stranger_changes_nothing_by_any_path(server: Server) -> None:
    # from standby, where there is no target: what is read next is this heading and none from before
    assert put(server, "state", "standby") == 200
    until("standby", lambda: pilot(server)["state"] == "standby")
    until("engaging", lambda: put(server, "state", "auto") == 200)
    until("the heading held", lambda: (pilot(server)["state"], pilot(server)["mode"]) == ("auto", "compass"))
    held = until("the heading", lambda: pilot(server)["target"])
    assert put(server, "dodge", 10, units="deg") == 200
    until("the step aside", lambda: near(pilot(server)["target"], math.degrees(held) + 10.0, 0.5))
    before = pilot(server)
    for path, method in operations():
        if method != "get":
            where = f"{PILOTS}{path.replace('{id}', 'norrbin')}"
            for value in (0.2, "standby", "wind"):
                status, _ = server.send(where, {"value": value}, method.upper(), user=False)
                assert status in (401, 403), (path, method, status)
    assert pilot(server) == before
    assert server.send(f"{PILOT}/dodge", None, "DELETE")[0] == 200
