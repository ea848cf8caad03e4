"""The page's server: who may order, what is refused, downloads, events to several browsers at once."""

from __future__ import annotations

import asyncio
import contextlib
import importlib.util
import json
import math
import os
import re
import resource
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import httpx2
import pytest
from alarm_texts import other
from monitored_boat import Watched, noted
from page_server import TOKEN, SailingHub, served
from starlette.requests import Request
from starlette.testclient import TestClient

from autopilot import __version__
from autopilot.cli.main import build_parser, main
from autopilot.cli.web import PageOfSteps, listening_address
from autopilot.errors import InputError, NotYetError
from autopilot.links.base import UNSEEN
from autopilot.signals import AlarmSample, Mode
from autopilot.web import page_files
from autopilot.web.hub import BEHIND_MOST, CLIENTS_MOST, Access, Hub, token_of
from autopilot.web.requests import CAME_LATE
from autopilot.web.server import HEADERS, LogIndex, _short_body, build_app, known_hosts

BEARER = {"authorization": f"Bearer {TOKEN}"}


@pytest.fixture
def client(sea: Watched, tmp_path: Path) -> Any:
    folder = tmp_path / "logs"
    folder.mkdir()
    (folder / "one.tlog").write_bytes(b"\x00" * 3000)
    (folder / "key.txt").write_text("no log")
    (tmp_path / "secret.tlog").write_text("outside")
    (folder / "link.tlog").symlink_to(tmp_path / "secret.tlog")
    with TestClient(build_app(SailingHub(sea), Access(TOKEN), LogIndex(folder))) as client:
        yield client


def test_the_page_is_whole_small_and_asks_nobody_else(client: Any) -> None:
    page = client.get("/").text
    first_load = 0
    assert "main.js" in page_files() and "uplot.LICENSE" in page_files()
    assert b"\n/*" not in page_files()["style.css"] and b"/*!" in page_files()["uplot.js"], "only our own comments go"
    assert "://" not in page.replace("http://www.w3.org", "")
    for name in page_files():
        answer = client.get(f"/{name}")
        assert answer.status_code == 200 and answer.content
        if name not in ("index.html", "icon.svg", "dial.js", "uplot.LICENSE"):
            assert b"http://" not in answer.content and b"url(" not in answer.content
        first_load += 0 if name.startswith("uplot") else len(answer.content)
    assert first_load < 115_000, "the plots' library comes when a plot is first shown"
    assert client.get("/").headers["content-security-policy"].startswith("default-src 'self'")
    assert all(client.get("/nothing").headers[name] == value for name, value in HEADERS.items())
    assert client.get("/nothing").status_code == client.get("/..%2fserver.py").status_code == 404


def test_who_has_no_token_looks_and_orders_nothing(client: Any, sea: Watched) -> None:
    for headers in ({}, {"authorization": "Bearer wrong"}, {"authorization": TOKEN}, {"authorization": "Bearer "}):
        assert client.get("/api/may", headers=headers).json() == {"may": False}
        assert client.post("/api/order", json={"do": "engage"}, headers=headers).status_code == 403
        assert client.get("/api/logs", headers=headers).status_code == 403
        assert client.post("/api/logs/one.tlog/ticket", headers=headers).status_code == 403
    assert not sea.commands.armed
    assert client.get("/api/order", headers=BEARER).status_code == 405
    assert client.get("/api/history").json()["columns"][0] == "t"


def test_orders_with_the_token_are_carried_out_and_refusals_say_why(client: Any, sea: Watched) -> None:
    def order(**wanted: Any) -> tuple[int, bool, str]:
        answer = client.post("/api/order", json=wanted, headers=BEARER)
        return answer.status_code, *answer.json().values()

    assert client.get("/api/may", headers=BEARER).json() == {"may": True}
    assert order(do="turn", degrees=10) == (409, False, "engage first: no course is being steered")
    assert order(do="engage") == (200, True, "")
    assert sea.tick is not None and sea.tick.mode.name == "ENGAGED"
    status, taken, words = order(do="route")
    assert (status, taken) == (409, False) and ("route" in words or "mission" in words)
    status, taken, words = order(do="sink")
    assert (status, taken) == (400, False) and "allowed are engage" in words
    assert client.post("/api/order", content=b"{", headers=BEARER).status_code == 400
    assert client.post("/api/order", content=b" " * 5000, headers=BEARER).status_code == 413
    assert order(do="release") == (200, True, "") and not sea.commands.armed
    sea.links = []
    assert order(do="engage") == (409, False, "the boat does not answer")
    sea.station.view.forget()
    assert order(do="engage") == (409, False, "no boat that runs this pilot is heard")


def test_an_order_that_was_held_up_on_its_way_is_not_carried_out_but_a_release_is(client: Any, sea: Watched) -> None:
    def order(late: float, **wanted: Any) -> int:
        return int(client.post("/api/order", json={**wanted, "seen": sea.now - late}, headers=BEARER).status_code)

    def turned() -> float:
        assert sea.tick is not None
        return math.degrees(sea.skipper(sea.now, sea.tick).heading)

    sea.watch(10.0)
    assert order(0.1, do="engage") == 200
    sea.watch(1.0)
    assert order(6.0, do="turn", degrees=10) == 409 and turned() == pytest.approx(0.0, abs=1.0)
    assert client.post("/api/order", json={"do": "turn", "degrees": 10, "seen": ""}, headers=BEARER).status_code == 400
    # a page that shows the state of before the boat's computer started anew, and its clock with it
    assert order(-6.0, do="turn", degrees=10) == order(-1.0e12, do="turn", degrees=10) == 409
    assert turned() == pytest.approx(0.0, abs=1.0)
    assert order(4.0, do="turn", degrees=10) == 200 and turned() == pytest.approx(10.0, abs=1.0)
    sea.watch(10.0)
    assert order(0.1, do="zigzag", rudder=10, change=10, duration=300) == 200
    sea.watch(3.0)
    assert sea.commands.running is not None and not sea.commands.running.run.is_over
    assert order(10.0, do="cancel") == 200
    sea.watch(1.0)
    assert sea.commands.running.run.is_over, "to end a trial counts, however late"
    assert order(10.0, do="mob_at", latitude=57.0, longitude=12.0) == 200, "whoever is overboard still is"
    assert order(-1.0e12, do="standby") == 200
    assert order(10.0, do="release") == 200 and not sea.commands.armed


@pytest.mark.parametrize("stop", ["standby", "release"])
def test_who_has_not_seen_that_another_hand_let_the_pilot_stand_by_engages_nothing(
    client: Any, sea: Watched, stop: str
) -> None:
    def order(seen: float, **wanted: Any) -> tuple[int, str]:
        answer = client.post("/api/order", json={**wanted, "seen": seen}, headers=BEARER)
        return answer.status_code, answer.json()["words"]

    sea.watch(10.0)
    assert order(sea.now, do="engage") == (200, "")
    sea.watch(1.0)
    seen = sea.now
    sea.watch(0.5)
    assert order(sea.now, do=stop) == (200, "")
    for wanted in ({"do": "engage"}, {"do": "heading", "degrees": 90.0}, {"do": "wind"}):
        assert order(seen, **wanted) == (409, UNSEEN)
    sea.watch(1.0)
    assert sea.tick is not None and sea.tick.mode is Mode.STANDBY
    assert order(seen, do=stop) == (200, "")
    sea.watch(0.2)
    assert order(sea.now, do="engage") == (200, ""), "who has seen it engages again"


def test_a_page_that_still_shows_the_pilot_at_the_helm_engages_nothing_anew(client: Any, sea: Watched) -> None:
    def order(seen: float, **wanted: Any) -> tuple[int, str]:
        answer = client.post("/api/order", json={**wanted, "seen": seen}, headers=BEARER)
        return answer.status_code, answer.json()["words"]

    sea.watch(10.0)
    for _ in range(4):
        assert order(sea.now, do="engage") == (200, ""), "who has seen it engages again"
        sea.watch(1.3)
        assert order(sea.now, do="standby") == (200, "")
        begun = sea.now
        while sea.station.view.mode_name != "standby":
            assert order(sea.now, do="wind") == order(sea.now, do="engage") == (409, UNSEEN)
            sea.watch(0.1)
        assert sea.now - begun < 0.3, "the heartbeat of standing by does not wait"
        sea.watch(0.1)
    for heard in (1.3, 0.3, 1.3, 0.3):  # 0.3: the boat's next heartbeat has not come
        assert order(sea.now, do="engage") == (200, "")
        sea.watch(heard)
        if heard > 1.0:
            assert order(sea.now, do="turn", degrees=10) == (200, ""), "just behind standing by, too"
        assert order(sea.now, do="standby") == order(sea.now, do="standby") == (200, "")
        sea.watch(0.3)
    assert order(sea.now, do="engage") == (200, "")
    sea.watch(1.3)
    shown = sea.now
    sea.skipper.stand_by()  # at another station
    sea.watch(1.0)
    assert order(shown, do="engage") == (409, UNSEEN) and order(shown, do="acknowledge")[0] == 200
    assert order(sea.now, do="engage") == (200, "")


def test_an_order_from_before_the_computer_slept_is_late(
    sea: Watched, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    hub = Hub(sea.station, sea.line)
    seen = hub.clock()
    # CLOCK_MONOTONIC stands still while a machine is suspended
    awake = time.clock_gettime
    monkeypatch.setattr(time, "clock_gettime", lambda clock: awake(clock) + 600.0)
    client = TestClient(build_app(hub, Access(TOKEN), LogIndex(tmp_path)))
    answer = client.post("/api/order", json={"do": "turn", "degrees": 10, "seen": seen}, headers=BEARER)
    assert (answer.status_code, answer.json()["words"]) == (409, CAME_LATE)


@pytest.mark.parametrize(
    "body",
    [
        b'{"do":"turn","degrees":' + b"9" * 400 + b"}",
        b'{"do":"turn","degrees":-' + b"9" * 4000 + b"}",
        b'{"do":"turn","degrees":1e999}',
        b'{"do":"turn","degrees":NaN}',
        b'{"do":"turn","degrees":"\\ud800"}',
        b'{"do":"\\ud800"}',
        b'{"do":"set","name":"\\ud800","value":1}',
        b'{"do":"pattern","number":1,"side":1,"sizes":[' + b"9" * 400 + b"]}",
        b"[" * 4000,
        b'{"do":' * 600,
        b"\xed\xa0\x80",
        b"\xff\xfe{",
        b"",
    ],
)
def test_a_strange_order_is_refused_in_a_short_sentence(client: Any, sea: Watched, body: bytes) -> None:
    answer = client.post("/api/order", content=body, headers=BEARER)
    assert answer.status_code == 400 and len(answer.json()["words"]) < 300
    assert not sea.commands.armed
    assert client.post("/api/order", content=body, headers={"authorization": "Bearer wrong"}).status_code == 403


def test_a_large_body_is_refused_before_it_is_read() -> None:
    def request(*chunks: bytes, **headers: str) -> tuple[Any, list[bytes]]:
        read: list[bytes] = []

        async def receive() -> Any:
            read.append(chunks[len(read)])
            return {"type": "http.request", "body": read[-1], "more_body": len(read) < len(chunks)}

        fields = [(name.replace("_", "-").encode(), value.encode()) for name, value in headers.items()]
        scope = {"type": "http", "method": "POST", "path": "/", "headers": fields, "query_string": b""}
        return asyncio.run(_short_body(Request(scope, receive))), read

    assert request(b"{", b"}", content_length="2") == (b"{}", [b"{", b"}"])
    assert request(b"x" * 65536, content_length="120000000") == (None, [])
    for length in ("-1", "9" * 5000, "\u00b2", ""):
        assert request(b"x", content_length=length) == (None, [])
    body, read = request(*[b"x" * 3000] * 1000)
    assert body is None and len(read) == 2


def test_parameters_are_fetched_when_somebody_looks(client: Any, sea: Watched) -> None:
    assert client.get("/api/parameters").json()["complete"] is False
    sea.watch(10.0)
    table = client.get("/api/parameters").json()
    assert table["complete"] and len(table["rows"]) == len(sea.store.names)


def test_a_log_is_downloaded_with_a_ticket_and_nothing_else_is(client: Any, sea: Watched) -> None:
    listing = client.get("/api/logs", headers=BEARER).json()["logs"]
    assert [row["name"] for row in listing] == ["one.tlog"] and listing[0]["bytes"] == 3000
    href = client.post("/api/logs/one.tlog/ticket", headers=BEARER).json()["href"]
    answer = client.get(href)
    assert answer.content == b"\x00" * 3000 and "one.tlog" in answer.headers["content-disposition"]
    assert client.get(href.replace("one", "two")).status_code == 403
    assert (
        client.get("/api/logs/one.tlog").status_code == client.get("/api/logs/one.tlog?ticket=9.x").status_code == 403
    )
    for name in ("key.txt", "link.tlog", "..%2fsecret.tlog", ".hidden.tlog", "no.tlog"):
        assert client.post(f"/api/logs/{name}/ticket", headers=BEARER).status_code == 404
    sea.watch(130.0)
    assert client.get(href).status_code == 403


def test_a_log_whose_name_is_no_text_hides_no_other(client: Any, tmp_path: Path) -> None:
    (tmp_path / "logs" / os.fsdecode(b"\xff.tlog")).write_bytes(b"\x00")
    listing = client.get("/api/logs", headers=BEARER)
    assert listing.status_code == 200 and [row["name"] for row in listing.json()["logs"]] == ["one.tlog"]


def test_logs_that_are_gone_are_a_short_list_and_no_failure(client: Any, tmp_path: Path) -> None:
    ticket = "/api/logs/{}/ticket"
    href = client.post(ticket.format("one.tlog"), headers=BEARER).json()["href"]
    assert client.post(ticket.format("a" * 300 + ".tlog"), headers=BEARER).status_code == 404
    shutil.rmtree(tmp_path / "logs")
    listing = client.get("/api/logs", headers=BEARER)
    assert listing.status_code == 200 and listing.json()["logs"] == []
    assert client.get(href).status_code == 404
    assert client.post(ticket.format("one.tlog"), headers=BEARER).status_code == 404


def test_a_log_that_goes_as_it_is_asked_for_is_not_found(
    client: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    href = client.post("/api/logs/one.tlog/ticket", headers=BEARER).json()["href"]
    monkeypatch.setattr(LogIndex, "path_of", lambda self, name: tmp_path / "gone" / name)
    answer = client.get(href)
    assert answer.status_code == 404 and "No such file" in answer.json()["words"]


def test_a_log_that_is_being_written_is_downloaded_as_far_as_it_is(tmp_path: Path) -> None:
    log = tmp_path / "now.tlog"
    log.write_bytes(b"a" * 100_000)
    size, pieces = LogIndex(tmp_path).read(log)
    first = next(pieces)
    with log.open("ab") as file:
        file.write(b"b" * 100_000)
    assert size == 100_000 and first + b"".join(pieces) == b"a" * size


def events_of(data: bytes) -> list[tuple[str, Any]]:
    found = []
    for block in data.decode().split("\n\n"):
        lines = dict(line.split(": ", 1) for line in block.splitlines())
        if "event" in lines:
            found.append((lines["event"], json.loads(lines["data"])))
    return found


def run_hub(sea: Watched, play: Callable[[SailingHub], Any]) -> Any:
    return asyncio.run(play(SailingHub(sea)))


def test_every_browser_gets_all_at_first_then_what_changes(sea: Watched) -> None:
    async def play(hub: SailingHub) -> None:
        browsers = [hub.follow(), hub.follow()]
        for browser in browsers:
            first = dict(events_of(await anext(browser)))
            assert {"state", "alarms", "learning", "trial", "dodge"} <= set(first)
            assert first["state"]["heading"] == pytest.approx(math.degrees(sea.box.heading) % 360.0, abs=2.0)
        sea.watch(0.6)
        hub.publish()
        sea.watch(0.1)
        hub.publish()
        seen = [[dict(events_of(await anext(browser))) for _ in range(2)] for browser in browsers]
        assert seen[0] == seen[1]
        assert "row" in seen[0][0] and set(seen[0][1]) == {"state"}
        hub.close()
        assert events_of(b"".join([data async for data in browsers[0]])) == [("end", True)]

    run_hub(sea, play)


def test_a_browser_that_does_not_keep_up_is_let_go_and_holds_nobody_back(sea: Watched) -> None:
    async def play(hub: SailingHub) -> None:
        slow, quick = hub.follow(), hub.follow()
        await anext(slow)
        await anext(quick)
        for _ in range(BEHIND_MOST + 5):
            hub.publish()
            await anext(quick)
        waiting = [data async for data in slow]
        assert len(waiting) == BEHIND_MOST
        hub.publish()
        assert events_of(await anext(quick))

    run_hub(sea, play)


def test_a_server_that_ends_says_so_to_every_browser(sea: Watched) -> None:
    async def play(hub: SailingHub) -> list[tuple[str, Any]]:
        follower = hub.follow()
        assert follower is not None
        first = await anext(follower)
        hub.close()
        return events_of(first + b"".join([data async for data in follower]))

    assert run_hub(sea, play)[-1] == ("end", True)


def test_codes_open_the_page_on_another_display(sea: Watched, tmp_path: Path) -> None:
    pytest.importorskip("segno")
    app = build_app(SailingHub(sea), Access(TOKEN), LogIndex(tmp_path))
    with TestClient(app, base_url="http://192.168.1.7:8080") as client:
        assert client.get("/api/code/steer").status_code == 403
        assert client.get("/api/code/other", headers=BEARER).status_code == 404
        steer, look = (client.get(f"/api/code/{what}", headers=BEARER).json() for what in ("steer", "look"))
        assert steer["svg"].startswith("<svg") and len(steer["svg"]) > len(look["svg"])
        assert look["words"] == "http://192.168.1.7:8080/"
    with TestClient(app, base_url="http://127.0.0.1:8080") as client:
        answer = client.get("/api/code/look", headers=BEARER).json()
        assert answer["svg"] == "" and "--listen" in answer["words"]


def test_the_steps_of_a_new_boat_are_left_and_taken_up_on_the_page(client: Any, sea: Watched, tmp_path: Path) -> None:
    assert client.get("/api/steps").json() == {"steps": None}
    steps, file = PageOfSteps(tmp_path / "boat.yaml"), tmp_path / "boat.commissioning.json"
    with TestClient(build_app(SailingHub(sea), Access(TOKEN), LogIndex(None), steps)) as page:

        def mark(name: Any, done: Any, headers: Any = BEARER) -> Any:
            return page.post("/api/steps", json={"name": name, "done": done}, headers=headers)

        def states() -> list[str]:
            return [step["state"] for step in page.get("/api/steps").json()["steps"]]

        assert states() == ["next", *["later"] * 5]
        assert mark("doctor", True, headers={}).status_code == 403 and not file.exists()
        assert mark("doctor", True).json()["steps"][1]["state"] == "next"
        assert mark("hold", True).status_code == 400 and "rests on" in mark("hold", True).json()["words"]
        assert mark("nowhere", False).status_code == mark(1, True).status_code == mark("rudder", 1).status_code == 400
        mark("rudder", True)
        assert states()[:3] == ["done", "done", "next"]
        assert json.loads(file.read_text())["done"].keys() == {"doctor", "rudder"}, "the terminal goes on from there"
        assert [step["state"] for step in mark("doctor", False).json()["steps"]] == ["next", *["later"] * 5]
        file.write_text("[]")
        assert page.get("/api/steps").status_code == 400


def test_the_page_travels_packed_and_whole(client: Any) -> None:
    packed = sum(
        int(client.get(f"/{name}").headers["content-length"]) for name in page_files() if not name.startswith("uplot")
    )
    plain = client.get("/main.js", headers={"accept-encoding": "identity"})
    assert "content-encoding" not in plain.headers and plain.content == page_files()["main.js"]
    assert client.get("/main.js").content == plain.content and packed < 40_000
    manifest = client.get("/manifest.webmanifest")
    assert manifest.headers["content-type"] == "application/manifest+json"
    for icon in manifest.json()["icons"]:
        assert client.get(f"/{icon['src']}").headers["content-type"] == icon["type"]


def test_who_only_looks_takes_no_place_from_who_has_the_token(sea: Watched) -> None:
    async def play(hub: SailingHub) -> None:
        crowd = [hub.follow("192.0.2.1") for _ in range(CLIENTS_MOST)]
        skipper, guest = hub.follow(), hub.follow("192.0.2.2")
        for newcomer in (skipper, guest):
            assert "state" in dict(events_of(await anext(newcomer)))
        assert [[data async for data in gone] for gone in crowd[:2]] == [[], []], "the oldest of the crowd"
        assert dict(events_of(await anext(crowd[2])))
        crowd += [hub.follow("192.0.2.1") for _ in range(3 * CLIENTS_MOST)]
        hub.publish()
        for each in (skipper, guest, crowd[-1]):
            assert events_of(await anext(each))
        mates = [hub.follow() for _ in range(CLIENTS_MOST - 1)]
        assert hub.follow("192.0.2.3") is None and hub.follow() is None, "all have the token"
        hub.publish()
        assert events_of(await anext(skipper))
        assert [data async for data in guest] == []
        await anext(mates[0])
        await mates[0].aclose()
        assert hub.follow("192.0.2.3") is not None, "one of them has gone"

    run_hub(sea, play)


def looking(stack: contextlib.ExitStack, address: str, headers: dict[str, str] | None = None) -> Any:
    """Return the page's events as a browser gets them, open until the stack ends."""
    limits = httpx2.Limits(max_connections=None)
    client = stack.enter_context(httpx2.Client(base_url=address, timeout=60.0, limits=limits))
    return stack.enter_context(client.stream("GET", "/api/events", headers=headers or {}))


@pytest.mark.real_time
def test_thirty_two_who_only_look_do_not_shut_out_the_skipper(sea: Watched) -> None:
    with served(sea) as (address, _), contextlib.ExitStack() as stack:
        crowd = [looking(stack, address) for _ in range(CLIENTS_MOST)]
        texts = looking(stack, address, BEARER).iter_text()
        seen = "".join(next(texts) for _ in range(20))
        assert seen.count("event: state") >= 15
        assert "event: state" in "".join(crowd[0].iter_text()), "it was let go, and its stream has ended"


PAGE = """
const listed = [];
globalThis.location = { hash: "#token=" + process.argv[2], pathname: "/" };
globalThis.history = { replaceState() {} };
globalThis.localStorage = { setItem() {}, getItem: () => null };
const { fetch } = globalThis;
globalThis.fetch = (path, options) => fetch(process.argv[3] + path, options);
const { boat, connect, learnToken, ask, may } = await import(process.argv[4]);
learnToken();
boat.onState = () => listed.push(boat.state.mode);
connect();
while (listed.length < 10 || !may()) await new Promise((done) => setTimeout(done, 50));
const bad = await ask({ do: "sink" }), not_now = await ask({ do: "turn", degrees: 10 });
const taken = await ask({ do: "engage" });
while (boat.state.mode !== "heading") await new Promise((done) => setTimeout(done, 50));
const { alarms, refused } = boat;
console.log(JSON.stringify({ bad, not_now, taken, mode: listed[0], alarms: alarms.length, refused }));
process.exit(0);
"""
"""The page's own connection to the boat, in a program that is no browser but has what it needs of one."""


@pytest.mark.real_time
@pytest.mark.skipif(shutil.which("node") is None, reason="no node on this machine")
def test_the_page_itself_shows_the_token_where_others_only_look(sea: Watched, tmp_path: Path) -> None:
    (tmp_path / "boat.mjs").write_bytes(page_files()["boat.js"])
    (tmp_path / "page.mjs").write_text(PAGE)
    noted(sea.pilot, AlarmSample(sea.now, other("gear hot: stop the engine"), "gear"))
    with served(sea) as (address, _), contextlib.ExitStack() as stack:
        for _ in range(CLIENTS_MOST):
            looking(stack, address)
        command = ["node", str(tmp_path / "page.mjs"), TOKEN, address, str(tmp_path / "boat.mjs")]
        done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr
    seen = json.loads(done.stdout)
    assert not seen["bad"]["taken"] and "allowed are engage" in seen["bad"]["words"]
    assert seen["not_now"] == {"taken": False, "words": "engage first: no course is being steered"}
    assert seen["taken"] == {"taken": True, "words": ""}
    assert (seen["mode"], seen["alarms"], seen["refused"]) == ("standby", 1, "")


def test_tokens_are_kept_for_their_owner_alone(tmp_path: Path) -> None:
    path = tmp_path / "token"
    token = token_of(path)
    assert len(token) >= 20 and token_of(path) == token and path.stat().st_mode & 0o777 == 0o600
    path.chmod(0o644)
    with pytest.raises(InputError, match="chmod 600"):
        token_of(path)
    path.chmod(0o600)
    path.write_text("short\n")
    with pytest.raises(InputError, match="at least 16"):
        token_of(path)
    with pytest.raises(InputError, match="No such file"):
        token_of(tmp_path / "none" / "token")
    assert token_of(None) != token_of(None)
    assert [each.name for each in tmp_path.iterdir()] == ["token"]


@pytest.mark.parametrize("text", ["8080", "localhost:8080", "127.0.0.1:", "127.0.0.1:70000", "::1:80", "127.0.0.1:-1"])
def test_addresses_that_are_none_are_refused(text: str) -> None:
    assert listening_address("lo:80") == ("127.0.0.1", 80)
    if text == "::1:80":
        assert listening_address("[::1]:80") == ("::1", 80)
        return
    with pytest.raises(InputError, match="--listen"):
        listening_address(text)


@pytest.mark.parametrize(
    ("address", "name"),
    [
        *(("127.0.0.1", "127.0.0.1:8080"), ("::1", "[::1]:8080")),
        *(("127.0.0.2", "127.0.0.2:80"), ("0:0:0:0:0:0:0:1", "[::1]:80")),
    ],
)
def test_on_loopback_no_foreign_name_leads_to_the_page(sea: Watched, address: str, name: str) -> None:
    app = known_hosts(build_app(SailingHub(sea), Access(TOKEN), LogIndex(None)), address)
    for host, status in ((name, 200), ("localhost", 200), ("evil.example:8080", 400), ("", 400)):
        with TestClient(app) as client:
            assert client.get("/api/history", headers={"host": host}).status_code == status


@pytest.mark.real_time
@pytest.mark.parametrize("ending", [signal.SIGINT, signal.SIGTERM])
def test_the_process_serves_and_ends_on_a_signal(ending: signal.Signals, tmp_path: Path) -> None:
    command = [sys.executable, "-m", "autopilot", "web", "--link", "udpin:127.0.0.1:0", "--listen", "127.0.0.1:0"]
    web = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=tmp_path)
    try:
        assert web.stdout is not None
        steer, look = web.stdout.readline(), web.stdout.readline()
        address, token = re.findall(r"(http://127.0.0.1:\d+)/#token=([\w-]{20,})", steer)[0]
        assert look.split()[-1] == f"{address}/"
        with httpx2.Client(base_url=address, timeout=60.0) as client:
            assert "Release helm" in client.get("/").text
            assert client.get("/api/may", headers={"authorization": f"Bearer {token}"}).json() == {"may": True}
            with client.stream("GET", "/api/events") as events:
                first = next(events.iter_text())
                assert "event: state" in first and '"ours":false' in first
                web.send_signal(ending)
        assert web.wait(60.0) == 0
    finally:
        web.kill()
        web.communicate()


def with_few_files() -> None:
    resource.setrlimit(resource.RLIMIT_NOFILE, (400, 400))


def test_connections_that_say_nothing_do_not_shut_out_the_skipper(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "autopilot", "web", "--link", "udpin:127.0.0.1:0", "--listen", "127.0.0.1:0"]
    web = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=tmp_path, preexec_fn=with_few_files)
    silent: list[socket.socket] = []
    try:
        assert web.stdout is not None
        address, token = re.findall(r"(http://127.0.0.1:\d+)/#token=([\w-]{20,})", web.stdout.readline())[0]
        bearer = {"authorization": f"Bearer {token}"}
        with (
            httpx2.Client(base_url=address, timeout=60.0) as client,
            client.stream("GET", "/api/events", headers=bearer) as events,
        ):
            texts = events.iter_text()
            next(texts)
            for _ in range(450):
                silent.append(socket.create_connection(("127.0.0.1", int(address.rpartition(":")[2])), 60.0))
                silent[-1].sendall(b"POST /api/order HTTP/1.1\r\nX: ")
            assert client.get("/api/may", headers=bearer).json() == {"may": True}
            next(texts)
        web.send_signal(signal.SIGTERM)
        assert web.wait(60.0) == 0
    finally:
        for each in silent:
            each.close()
        web.kill()
        web.communicate()


def test_what_is_no_request_for_a_page_is_no_line_on_the_terminal(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "autopilot", "web", "--link", "udpin:127.0.0.1:0", "--listen", "127.0.0.1:0"]
    web = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=tmp_path)
    try:
        assert web.stdout is not None
        port = int(re.findall(r"http://127.0.0.1:(\d+)/", web.stdout.readline())[0])
        web.stdout.readline()
        head = f"GET /api/may HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nConnection: Upgrade\r\nUpgrade: websocket\r\n\r\n"
        for said in (head.encode(), b"\x16\x03\x01\r\n\r\n"):
            with socket.create_connection(("127.0.0.1", port), 60.0) as line:
                line.sendall(said)
                assert line.recv(9) == b"HTTP/1.1 "
        web.send_signal(signal.SIGTERM)
        said_of_us = ("link ", "autopilot: ended")
        assert [line for line in web.communicate(timeout=60.0)[1].splitlines() if not line.startswith(said_of_us)] == []
        assert web.returncode == 0
    finally:
        web.kill()
        web.communicate()


def test_a_request_whose_end_two_readers_would_see_in_two_places_is_refused_whole(sea: Watched) -> None:
    """RFC 9112, 6.1: a proxy that goes by the length would let the second order pass as the first one's body."""
    order = b'{"do":"engage"}'
    head = f"POST /api/order HTTP/1.1\r\nHost: 127.0.0.1\r\nAuthorization: Bearer {TOKEN}\r\n".encode()
    inner = head + b"Content-Length: %d\r\n\r\n" % len(order) + order
    outer = b"0\r\n\r\n" + inner
    with (
        served(sea) as (address, _),
        socket.create_connection(("127.0.0.1", int(address.rpartition(":")[2].strip("/"))), 60.0) as line,
    ):
        line.sendall(head + b"Content-Length: %d\r\nTransfer-Encoding: chunked\r\n\r\n" % len(outer) + outer)
        heard = b"".join(iter(lambda: line.recv(65536), b""))
    assert heard.startswith(b"HTTP/1.1 400 ") and heard.count(b"HTTP/1.1 ") == 1
    assert not sea.station.journal.entries


def test_a_file_in_the_place_of_the_folder_of_logs_is_refused_at_once(tmp_path: Path) -> None:
    log = tmp_path / "run.tlog"
    log.touch()
    with pytest.raises(InputError, match=r"run\.tlog: is no folder") as refused:
        LogIndex(log)
    assert not isinstance(refused.value, NotYetError), "waiting makes no folder of it"


def test_the_command_ends_with_a_sentence(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    cases = [
        (["--link", "nmea:/dev/null:4800"], 2, "MAVLink"),
        (["--link", "udpin:127.0.0.1:0", "--logs", str(tmp_path / "none"), "--link-wait", "0"], 2, "no folder there"),
        (["--link", "udpin:127.0.0.1:0", "--listen", "192.0.2.1:80"], 2, "choose another"),
    ]
    for arguments, code, words in cases:
        assert main(["web", *arguments]) == code
        assert words in capsys.readouterr().err


def test_blueos_finds_the_page_by_what_it_asks_for(client: Any) -> None:
    """The fields of its ServiceMetadata, and their kinds; a page that nobody may frame opens in one of its own."""
    found = client.get("/register_service").json()
    texts = ("name", "description", "icon", "company", "version", "webpage", "api")
    assert all(isinstance(found[field], str) for field in texts)
    assert found["new_page"] is True
    assert found["version"] == __version__


@pytest.fixture
def packages() -> Any:
    place = Path(__file__).parents[2] / ".ci" / "packages.py"
    spec = importlib.util.spec_from_file_location("packages", place)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_every_command_has_a_manual_page_with_its_options(packages: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    pages = dict(packages.manuals())
    assert {"autopilot", "autopilot-run", "autopilot-log-compare", "autopilot-new-boat", "sitl-serve"} <= pages.keys()
    assert "\\-\\-engage" in pages["autopilot-run"] and "new\\-boat" in pages["autopilot"]
    for name, text in pages.items():
        head, heading, said, *rest = text.splitlines()
        assert head.startswith(f".TH {name.upper()} 1 ") and heading == ".SH NAME", name
        assert said.startswith(f"{name} \\- ") and len(said) > len(name) + 8, name
        assert max(len(line.replace("\\", "")) for line in rest) <= 73, name
        macros = {line for line in rest if line.startswith((".", "'"))}
        assert macros == {".SH DESCRIPTION", ".nf", ".fi", ".SH SEE ALSO", f".BR {name.partition('-')[0]} (1)"}, name


def test_the_image_starts_the_page_and_has_the_labels_that_blueos_reads(packages: Any) -> None:
    """`{tag_name}` is what the repository of extensions puts the image's tag in for; permissions are Docker's."""
    labels = packages.blueos_labels("https://example.org/norrbin")
    assert labels["type"] == "device-integration"
    assert json.loads(labels["permissions"])["HostConfig"]["NetworkMode"] == "host"
    assert all(set(author) == {"name", "email"} for author in json.loads(labels["authors"]))
    assert set(json.loads(labels["company"])) == {"name", "about", "email"}
    assert json.loads(labels["links"])["support"] == "https://example.org/norrbin/issues"
    assert labels["readme"] == "https://example.org/norrbin/raw/{tag_name}/README.md"
    assert all(tag.replace("-", "").isalnum() for tag in json.loads(labels["tags"]))
    assert not {"links", "readme"} & set(packages.blueos_labels()), "an address that nobody gave is none"
    assert build_parser().parse_args(packages.PAGE.split()).listen == "0.0.0.0:8080"


def test_a_package_leaves_out_other_dialects_and_the_libraries_tests(packages: Any, tmp_path: Path) -> None:
    kept = {f"pymavlink/dialects/{name}" for name in ("__init__.py", "v20/__init__.py", "v20/ardupilotmega.py")}
    kept |= {"numpy/testing/__init__.py", "scipy/linalg/blas.py", "autopilot/tests/a.py"}
    left_out = {"pymavlink/dialects/v10/common.py", "pymavlink/dialects/v20/common.py", "scipy/linalg/tests/a.py"}
    for name in kept | left_out:
        packages.save(tmp_path / name, b"")
    packages.prune(tmp_path)
    assert {str(path.relative_to(tmp_path)) for path in tmp_path.rglob("*") if path.is_file()} == kept
