"""The page in a real browser, with the pilot and its boat behind it: steering, alarms, silence, contrast, keyboard."""

from __future__ import annotations

import contextlib
import itertools
import json
import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from boat_at_sea import Vane
from boats import BOATS, vessel_of
from monitored_boat import BothAlarms, Watched, noted
from page_server import TOKEN, SailingHub, chromium, served

from autopilot.cli.web import PageOfSteps
from autopilot.report.page import Opening, Section, render
from autopilot.signals import AlarmEvent, AlarmSample
from autopilot.supervision.alarms import CATALOGUE
from autopilot.supervision.panel import sentence_of
from autopilot.vessel.schema import Vessel

pytestmark = pytest.mark.real_time
PATIENCE_MS = 40_000.0
PHONE = {"width": 390, "height": 844}
DESKTOP = {"width": 1366, "height": 800}
CONTRAST, TARGETS = ((Path(__file__).parent / name).read_text() for name in ("contrast.js", "targets.js"))
PAGES = ("helm", "chart", "plots", "alarms", "learning", "trials", "parameters", "logs", "more", "begin")


class Helm:
    """One browser window on the page; `errors` is what the page complained of."""

    def __init__(self, browser: Any, address: str, hub: SailingHub, vane: Vane) -> None:
        self.browser, self.address, self.hub, self.sea, self.vane = browser, address, hub, hub.sea, vane
        self.errors: list[str] = []
        self.asked: list[str] = []

    def open(self, token: str = TOKEN, size: dict[str, int] | None = None) -> Any:
        page = self.browser.new_context(viewport=size or PHONE).new_page()
        page.set_default_timeout(PATIENCE_MS)
        page.on("pageerror", lambda error: self.errors.append(str(error)))
        page.on("request", lambda request: self.asked.append(request.url))
        page.goto(f"{self.address}/#token={token}" if token else self.address)
        word(page, "link-word", "live")
        return page


@contextlib.contextmanager
def sailing(browser: Any, folder: Path, vessel: Vessel | None = None) -> Iterator[Helm]:
    """A boat at sea with its page; `vessel` is what its pilot believes."""
    (folder / "one.tlog").write_bytes(b"\xfd" * 5000)
    sea = Watched(folder, learns=True, vessel=vessel)
    vane = Vane(sea)
    vane.is_acknowledged = False
    sea.alarms = BothAlarms(vane, sea.alarms)
    sea.watch(3.0)
    with served(sea, folder) as (address, hub):
        helm = Helm(browser, address, hub, vane)
        yield helm
        assert helm.errors == []


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with chromium() as browser:
        yield browser


@pytest.fixture(scope="module")
def helm(browser: Any, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Helm]:
    with sailing(browser, tmp_path_factory.mktemp("sea")) as helm:
        yield helm


def alarm(helm: Helm, event: AlarmEvent | None, source: str) -> None:
    with helm.hub.lock:
        noted(helm.sea.pilot, AlarmSample(helm.sea.now, event, source))


def until(page: Any, expression: str) -> None:
    """Wait for a condition, asked from outside: the page's own policy forbids evaluating text inside."""
    waited = 0.0
    while not page.evaluate(expression):
        assert waited < PATIENCE_MS, f"{expression}: not so within {waited / 1000:g} s"
        page.wait_for_timeout(50.0)
        waited += 50.0


def word(page: Any, element: str, words: str) -> None:
    until(page, f"document.getElementById({element!r}).textContent.includes({words!r})")


@pytest.mark.parametrize("size", [(390, 844), (360, 640), (640, 360)], ids="{0[0]}x{0[1]}".format)
def test_ten_things_take_at_most_twenty_five_taps_on_a_phone(
    size: tuple[int, int], browser: Any, tmp_path: Path
) -> None:
    real = vessel_of(BOATS["lanxin"])
    wrong = replace(real, model=replace(real.model, K_1_s=0.6 * real.model.K_1_s, T_s=1.3 * real.model.T_s))
    with sailing(browser, tmp_path, wrong) as helm:
        _ten_things(helm, real, {"width": size[0], "height": size[1]})


def _ten_things(helm: Helm, real: Vessel, size: dict[str, int]) -> None:
    page, sea, taps = helm.open(size=size), helm.sea, 0

    def tap(selector: str) -> None:
        nonlocal taps
        taps += 1
        page.click(selector)

    def enter(selector: str, words: str) -> None:
        tap(selector)
        page.fill(selector, words)

    alarm(helm, None, "gear")
    tap("#engage")
    word(page, "mode-word", "Heading")
    tap("button[data-turn='10']")
    word(page, "last-order", "10° to starboard")
    given, footer = (page.locator(place).bounding_box() for place in ("#last-order", "footer"))
    if size["height"] > 672:  # lower screens have no room for it: the page of logs shows who ordered what
        assert given["y"] + given["height"] <= footer["y"], "who ordered what stands whole above the fold"
    tap("button[data-dodge='20']")
    until(page, "!document.getElementById('back').disabled")
    tap("#back")
    # one that no test before has acknowledged: what comes back within 10 s is the same alarm
    alarm(helm, AlarmEvent("drive_warning", "hot"), "gear")
    tap("#bar button")
    page.wait_for_selector("#bar.seen")
    tap("#standby")
    word(page, "mode-word", "Standby")
    tap(".main-nav a[href='#more']")
    tap(".pages a[href='#trials']")
    enter("#zigzag input[name='duration']", "300")
    tap("#zigzag button")
    tap("#zigzag button")
    word(page, "trial-word", "Zigzag: under way")
    with helm.hub.lock:
        sea.until(lambda: sea.station.view.learning()["lrn_state"] == 2.0, 290.0)
        now = sea.now
    # an order that rests on a picture of minutes ago is not carried out
    until(page, f"import('/boat.js').then(({{ boat }}) => boat.state.t >= {now - 1.0})")
    tap("#cancel")
    word(page, "trial-word", "ended as you asked")
    tap(".main-nav a[href='#more']")
    tap(".pages a[href='#learning']")
    until(page, "!document.getElementById('adopt').disabled")
    for _ in range(2):
        tap("#adopt")
    word(page, "said", "Adopted")
    with helm.hub.lock:
        assert sea.store.running.model.K_1_s == pytest.approx(real.model.K_1_s, rel=0.15)
    tap(".main-nav a[href='#more']")
    tap(".pages a[href='#parameters']")
    enter("#find", "lookahead")
    word(page, "parameters-found", "1 found")
    enter(".parameter:not([hidden]) input", "14")
    tap(".parameter:not([hidden]) form button")
    word(page, "said", "GUI_LOOKAHEAD is 14")
    page.fill("#find", "no such thing")
    word(page, "parameters-found", "Nothing found for")
    tap(".main-nav a[href='#more']")
    tap(".pages a[href='#logs']")
    with page.expect_download() as download:
        tap("#log-rows button[aria-label='Download one.tlog']")
    assert Path(download.value.path()).read_bytes() == b"\xfd" * 5000
    tap("#release")
    until(page, "document.getElementById('mode-more').textContent === 'you steer'")
    with helm.hub.lock:
        sea.until(lambda: not sea.commands.armed)
        assert sea.store.running.guidance.lookahead_s == 14.0
    alarm(helm, None, "gear")
    assert taps <= 25
    page.context.close()


def test_a_touch_engages_and_turns_the_boat_and_a_key_releases_it(helm: Helm) -> None:
    page, sea = helm.open(), helm.sea
    before = math.degrees(sea.box.heading)
    page.click("#engage")
    word(page, "mode-word", "Heading")
    for _ in range(3):
        page.click("button[data-turn='10']")
    page.keyboard.press("ArrowLeft")
    wanted = round(before + 29.0) % 360
    word(page, "order", f"{wanted:03d}")
    until(page, f"Math.abs(Number(document.getElementById('heading').textContent) - {wanted}) <= 1")
    with helm.hub.lock:
        assert math.degrees(sea.box.heading) == pytest.approx(before + 29.0, abs=2.0)
    page.keyboard.press("Escape")
    word(page, "mode-word", "Standby")
    with helm.hub.lock:  # to stand by comes first, and is shown at once
        sea.until(lambda: not sea.commands.armed)
    page.context.close()


def test_who_has_no_token_is_informed_and_moves_nothing(helm: Helm) -> None:
    page = helm.open(token="")
    word(page, "who-word", "view only")
    for steers in ("#engage", "#release", "button[data-turn='10']"):
        page.wait_for_selector(steers, state="hidden")
    page.wait_for_selector("#looking")
    page.keyboard.press("e")
    word(page, "said", "View only")
    with helm.hub.lock:
        assert not helm.sea.commands.armed
    page.context.close()


def test_an_alarm_says_what_to_do_and_is_acknowledged_for_all(helm: Helm) -> None:
    here, there = helm.open(), helm.open(token="", size=DESKTOP)
    alarm(helm, AlarmEvent("motor_current", "12 A"), "gear")
    alarm(helm, AlarmEvent("shallow"), "depth")
    for page in (here, there):
        page.wait_for_selector("#bar.alarm .tag.blinks")
        assert page.inner_text("#bar .tag").upper() == "▲ ALARM"
        assert page.inner_text("#bar small")
        assert page.inner_text("#alarm-count") == "2"
    here.click("#bar button")
    for page in (here, there):
        page.wait_for_selector("#bar.warning")
        word(page, "bar", "motor")
    here.click(".main-nav a[href='#alarms']")
    here.click("#alarm-rows button")
    for page in (here, there):
        page.wait_for_selector("#bar.seen")
    alarm(helm, None, "gear")
    alarm(helm, None, "depth")
    there.wait_for_selector("#bar", state="hidden")
    here.context.close()
    there.evaluate("location.hash = 'alarms'")
    until(there, "document.querySelectorAll('#history-rows li').length >= 2")
    newest = there.inner_text("#history-rows li:first-child")
    assert "raised" in newest and "--" not in newest, "raised, acknowledged and cleared have their times"
    there.context.close()


def test_silence_is_shown_and_all_comes_back_by_itself(helm: Helm) -> None:
    page, sea = helm.open(), helm.sea
    with helm.hub.lock:
        links, sea.links = sea.links, []
    word(page, "stale", "No data from the boat")
    page.wait_for_selector(".dial.stale")
    word(page, "heading-age", "s old")
    with helm.hub.lock:
        sea.links = links
    word(page, "link-word", "live")
    page.wait_for_selector(".dial:not(.stale)")
    page.context.set_offline(True)
    # what is under way goes on: only a new connection is refused
    page.evaluate("window.stop()")
    word(page, "stale", "lost its server")
    page.context.set_offline(False)
    word(page, "link-word", "live")
    page.context.close()


def test_every_text_of_every_page_has_contrast_in_every_light(helm: Helm) -> None:
    page = helm.open(size=DESKTOP)
    poor: list[str] = []
    seen = 0
    page.evaluate("location.hash = 'parameters'")
    page.wait_for_selector("#parameter-groups details")
    for _ in range(3):
        theme = page.evaluate("document.documentElement.dataset.theme")
        for name in PAGES:
            page.evaluate(f"location.hash = '{name}'")
            page.evaluate("document.querySelectorAll('details').forEach((each) => { each.open = true; })")
            found = page.evaluate(CONTRAST)
            seen += found["seen"]
            poor += [f"{theme} {name}: {each}" for each in found["poor"]]
        page.click("#theme")
    assert poor == []
    assert seen > 500
    page.context.close()


def test_everything_is_reached_by_the_keyboard_and_nothing_is_fetched_from_elsewhere(helm: Helm) -> None:
    page = helm.open(size=DESKTOP)
    reached, ringless = set(), []
    for _ in range(60):
        page.keyboard.press("Tab")
        where = page.evaluate(
            "(() => { const at = document.activeElement, style = getComputedStyle(at);"
            " return [at.id || at.dataset.turn || at.hash || at.tagName, style.outlineStyle, style.outlineWidth]; })()"
        )
        reached.add(where[0])
        if where[1] == "none" and where[0] != "BODY":
            ringless.append(where)
    assert {"release", "engage", "standby", "route", "theme", "calmer", "quicker", "-10", "-1", "1", "10"} <= reached
    assert {"#chart", "#plots", "#alarms", "#learning", "#trials", "#parameters", "#logs", "#more"} <= reached
    assert ringless == []
    assert all(url.startswith((helm.address, "data:")) for url in helm.asked)
    page.context.close()


def test_a_zigzag_is_started_seen_and_ended_and_a_log_is_downloaded(helm: Helm) -> None:
    page = helm.open(size=DESKTOP)
    page.click(".main-nav a[href='#trials']")
    for _ in range(2):
        page.click("#zigzag button")
    word(page, "trial-word", "Zigzag: under way")
    page.wait_for_selector("#plot-trial canvas")
    page.click("#cancel")
    word(page, "trial-word", "ended as you asked")
    page.click(".main-nav a[href='#logs']")
    with page.expect_download() as download:
        page.click("#log-rows button[aria-label='Download one.tlog']")
    assert Path(download.value.path()).read_bytes() == b"\xfd" * 5000
    page.keyboard.press("Escape")
    word(page, "mode-word", "Standby")
    page.context.close()


SIZES = pytest.mark.parametrize("size", [(320, 568), (667, 375), (390, 844), (1280, 800)], ids="{0[0]}x{0[1]}".format)


@SIZES
@pytest.mark.parametrize("token", [TOKEN, ""], ids=["steers", "looks"])
def test_nothing_is_covered_cut_off_or_too_small_even_under_an_alarm(
    helm: Helm, size: tuple[int, int], token: str
) -> None:
    page = helm.open(token, {"width": size[0], "height": size[1]})
    until(page, f"document.body.dataset.may === {'yes' if token else 'no'!r}")
    for is_on in (False, True):
        alarm(helm, AlarmEvent("battery_low", "11.2 V") if is_on else None, "battery")
        page.wait_for_selector("#bar", state="visible" if is_on else "hidden")
        for name in PAGES:
            page.evaluate(f"location.hash = '{name}'")
            until(page, f"document.body.dataset.page === {name!r}")
            found = page.evaluate(TARGETS)
            assert found["poor"] == [] and found["seen"] > 5, (name, is_on)
    alarm(helm, None, "battery")
    page.context.close()


MEASURE = """async (all) => { for (let frame = 0; frame < 2; frame++) await new Promise(requestAnimationFrame);
  return Object.fromEntries(all.map((selector) => {
  const at = document.querySelector(selector), { top, bottom, width, height } = at.getBoundingClientRect();
  const letters = parseFloat(getComputedStyle(at).fontSize);
  return [selector, { top, bottom, width, height, letters, stands_out: at.scrollWidth > at.clientWidth }];
})); }"""
SMALL = ((320, 568), (568, 320), (640, 360), (667, 375), (390, 844), (844, 390), (1280, 800))
SMALL += ((800, 600), (1000, 600), (1023, 540))
ALL_THAT_STEERS = ["button[data-turn='-10']", "button[data-turn='10']", "#engage", "#route", "#standby"]
ALL_THAT_STEERS += ["button[data-dodge='-20']", "#back", "button[data-dodge='20']"]


@pytest.mark.parametrize("mode", ["standby", "wind"])
def test_what_steers_is_in_reach_on_small_screens_under_an_alarm_too(helm: Helm, mode: str) -> None:
    page, wanted = helm.open(), [*ALL_THAT_STEERS, "#release", "#mob"]
    if mode == "wind":
        helm.vane.wind_from = helm.sea.box.heading + math.radians(60.0)  # a dodge of 20 deg does not tack the boat
        helm.vane.is_acknowledged = True
        until(page, "!document.getElementById('hold-wind').hidden && !document.getElementById('hold-wind').disabled")
        page.click("#hold-wind")
        word(page, "mode-word", "Wind")
        page.wait_for_selector("#tack")
        wanted += ["#hold-wind", "#tack", "#gybe"]
    # an order acknowledges what sounds: the alarm comes after it
    alarm(helm, AlarmEvent("rudder_stuck") if mode == "standby" else AlarmEvent("vehicle_failed"), mode)
    page.wait_for_selector("#bar:not(.seen) button")
    for is_overboard in (False, True):
        if is_overboard:
            page.click("#mob")
            page.wait_for_selector("#overboard")
        tops = ["#bar", "#bar button", *(["#overboard", "#mob-off"] if is_overboard else [])]
        for width, height in SMALL:
            page.set_viewport_size({"width": width, "height": height})
            found = page.evaluate(MEASURE, [*wanted, *tops, "#bar small", "footer"])
            below, footer = max(found[top]["bottom"] for top in tops), found["footer"]["top"]
            advice, bar = found["#bar small"], found["#bar"]
            assert advice["height"] > 10.0 and advice["bottom"] <= bar["bottom"], "what to do stands in the bar"
            for button in wanted + tops[1::2]:
                box, where = found[button], f"{button}, {width}x{height}, {is_overboard=}"
                if button not in (*tops, "#release", "#mob"):
                    assert box["top"] >= below and box["bottom"] <= footer, where
                assert box["bottom"] <= height and box["height"] >= 44 and box["width"] >= 44, where
                assert not box["stands_out"], f"{where}: its words stand out of it"
                assert box["letters"] >= 13.5, f"{where}: {box['letters']:.1f} px"
            page.evaluate("location.hash = 'chart'")
            until(page, "document.body.dataset.page === 'chart'")
            chart = page.evaluate(MEASURE, ["#sea", ".zoom", *tops, "footer"])
            below = max(chart[top]["bottom"] for top in tops)
            for part in ("#sea", ".zoom"):
                where = f"{part} under the alarms, {width}x{height}, {is_overboard=}"
                assert below <= chart[part]["top"] and chart[part]["bottom"] <= chart["footer"]["top"], where
            page.evaluate("location.hash = 'helm'")
            until(page, "document.body.dataset.page === 'helm'")
    for _ in range(2):
        page.click("#mob-off")
    page.wait_for_selector("#overboard", state="hidden")
    if mode == "wind":
        page.click("button[data-dodge='20']")
        until(page, "/^Back to \\d+° (port|stb)$/.test(document.getElementById('back').textContent)")
        page.click("#standby")
        word(page, "mode-word", "Standby")
        helm.vane.is_acknowledged = False
    alarm(helm, None, mode)
    page.context.close()


CUT_OFF = """async (all) => {
  const { boat } = await import("/boat.js"), { drawAlarms } = await import("/alarms.js"), cut = [];
  for (const [name, priority, words] of all) {
    boat.alarms = [{ name, priority, words, sounds: true, acknowledged: false, since: 0 }];
    drawAlarms();
    for (const at of document.querySelectorAll("#bar :is(.words, .wrong, small)"))
      if (at.scrollHeight > at.clientHeight + 2) cut.push(name);
  }
  return cut;
}"""


def test_each_advice_is_whole_on_phones_with_a_man_overboard(helm: Helm) -> None:
    page = helm.open()
    until(page, "document.body.dataset.may === 'yes'")
    kinds = [kind for kind in CATALOGUE.values() if kind.sounds]
    said = [(kind.name, kind.priority.name.lower(), sentence_of(AlarmEvent(kind.name))) for kind in kinds]
    assert len(said) > 50
    for is_overboard in (False, True):
        if is_overboard:
            page.click("#mob")
            page.wait_for_selector("#overboard")
        lying = ((640, 360), (667, 375), (740, 360), (844, 390), (1023, 540))
        smallest = () if is_overboard else ((320, 568),)
        for width, height in ((390, 844), (375, 667), (360, 640), *lying, *smallest):
            page.set_viewport_size({"width": width, "height": height})
            found = page.evaluate(CUT_OFF, said)
            assert found == [], f"{width}x{height}, {is_overboard=}"
    for _ in range(2):
        page.click("#mob-off")
    page.wait_for_selector("#overboard", state="hidden")
    page.context.close()


def test_what_steers_by_the_wind_is_whole_on_low_screens(helm: Helm) -> None:
    page, wanted = helm.open(), [*ALL_THAT_STEERS, "#hold-wind", "#tack", "#gybe"]
    helm.vane.is_acknowledged = True
    until(page, "!document.getElementById('hold-wind').hidden && !document.getElementById('hold-wind').disabled")
    page.click("#hold-wind")
    word(page, "mode-word", "Wind")
    page.wait_for_selector("#tack")
    for width, height in (*SMALL, (360, 640), (640, 360), (740, 360), (800, 360)):
        page.set_viewport_size({"width": width, "height": height})
        found = page.evaluate(MEASURE, [*wanted, ".top", "footer"])
        for button in wanted:
            where = f"{button}, {width}x{height}"
            assert found[".top"]["bottom"] <= found[button]["top"], where
            assert found[button]["bottom"] <= found["footer"]["top"], where
    page.click("#standby")
    word(page, "mode-word", "Standby")
    helm.vane.is_acknowledged = False
    page.context.close()


def test_on_the_smallest_phone_lying_down_the_advice_is_whole_and_the_pages_stand_apart(helm: Helm) -> None:
    page = helm.open(size={"width": 568, "height": 320})
    alarm(helm, AlarmEvent("deadline_missed", "3 ticks late by up to 0.76 s"), "loop")
    page.wait_for_selector("#bar")
    hidden = page.evaluate(
        "(() => { const at = document.querySelector('#bar .words'); return at.scrollHeight - at.clientHeight; })()"
    )
    assert hidden <= 1, f"{hidden} px of what to do are cut off"
    spans = page.evaluate("""[...document.querySelectorAll('.main-nav a')].filter((a) => a.checkVisibility())
      .map((a) => {
      const words = document.createRange(); words.selectNodeContents(a.firstChild);
      const { left, right } = words.getBoundingClientRect(); return [left, right]; })""")
    assert len(spans) == 5
    gaps = [after[0] - before[1] for before, after in itertools.pairwise(spans)]
    assert min(gaps) >= 6.0, f"names of pages run together: {gaps}"
    alarm(helm, None, "loop")
    page.context.close()


def test_what_no_boat_sends_is_not_drawn_and_what_is_old_promises_nothing(helm: Helm) -> None:
    bare = helm.browser.new_context(java_script_enabled=False).new_page()
    bare.goto(helm.address)
    for mark in ("awa-mark", "twa-mark"):
        assert bare.get_attribute(f"#{mark}", "visibility") == "hidden", "no wind has been heard"
    bare.context.close()
    page, sea = helm.open(), helm.sea
    page.set_viewport_size({"width": 844, "height": 390})
    links = page.locator(".main-nav a").evaluate_all("(all) => all.map((a) => a.clientWidth).filter((w) => w > 0)")
    assert len(links) == 5 and min(links) >= 44, "on a phone that lies down the others stand under More"
    page.click("#mob")
    page.wait_for_selector("#overboard")
    with helm.hub.lock:
        before, sea.links = sea.links, []
    word(page, "stale", "No data from the boat")
    assert page.inner_text("#who-word") == "" and page.inner_text("#mode-more") == ""
    page.wait_for_timeout(3000)
    assert page.is_visible("#overboard"), "the place of a man overboard is kept while nothing comes"
    with helm.hub.lock:
        sea.links = before
    word(page, "who-word", "you may steer")
    for _ in range(2):
        page.click("#mob-off")
    page.wait_for_selector("#overboard", state="hidden")
    with helm.hub.lock:
        sea.links = []
    word(page, "stale", "No data from the boat")
    assert not page.is_visible("#overboard"), "who is back on board does not go overboard again in a silence"
    with helm.hub.lock:
        sea.links = before
    word(page, "who-word", "you may steer")
    page.context.close()


SLOW_DRAWS = """async () => {
  const { boat } = await import("/boat.js"), clock = performance.now, drawn = [];
  boat.state = { ...boat.state, mode: "standby", armed: true, ages: { ...boat.state.ages, beat: 2 } };
  for (let late = 0; late < 1200; late += 20) {
    let now = boat.received + late;
    performance.now = () => (now += 20);
    boat.onState();
    drawn.push([!document.getElementById("stale").hidden, document.getElementById("mode-more").textContent]);
  }
  performance.now = clock;
  return drawn;
}"""


def test_one_draw_tells_of_one_moment_however_long_it_takes(helm: Helm) -> None:
    page = helm.open()
    drawn = page.evaluate(SLOW_DRAWS)
    assert [False, "ready, you steer"] in drawn and [True, ""] in drawn
    assert [True, "ready, you steer"] not in drawn, "what is old promises nothing"
    page.context.close()


WIDEST = """async () => {
  const { boat } = await import("/boat.js"), { drawDial } = await import("/dial.js"), cut = [];
  for (const value of [-0.4, -9.94, -9.96, -34.9, -123.4]) {
    boat.state = { ...boat.state, mode: "route", rudder: value, xte: value };
    drawDial();
    for (const id of ["t-rudder", "t-xte"]) {
      const at = document.getElementById(id), { width } = at.parentElement.getBoundingClientRect();
      if (at.parentElement.scrollWidth > Math.ceil(width)) cut.push(at.textContent);
    }
  }
  return cut;
}"""


def test_the_side_of_rudder_and_track_is_whole_on_the_smallest_phones(helm: Helm) -> None:
    page = helm.open()
    for width, height in ((320, 568), (360, 740), (390, 844)):
        page.set_viewport_size({"width": width, "height": height})
        assert page.is_visible("#t-rudder") and page.evaluate(WIDEST) == [], width
    page.context.close()


def test_plots_are_held_and_saved_and_the_chart_is_drawn(helm: Helm) -> None:
    page = helm.open(size=DESKTOP)
    until(page, "document.getElementById('sea').getAttribute('aria-label').includes('m across')")
    across = page.get_attribute("#sea", "aria-label")
    page.click("#further")
    until(page, f"document.getElementById('sea').getAttribute('aria-label') !== {across!r}")
    page.click(".main-nav a[href='#plots']")
    page.wait_for_selector("#plot-heading canvas")
    with page.expect_download() as download:
        page.click("#csv")
    head, *rows = Path(download.value.path()).read_text().splitlines()
    assert head.startswith("time_s,heading_deg,") and len(rows) > 3 and rows[-1].startswith("0.00,")
    page.click("#hold")
    page.wait_for_selector("#hold[aria-pressed='true']")
    page.context.close()


def test_a_plot_that_was_hidden_while_the_screen_turned_fills_it(helm: Helm) -> None:
    page = helm.open(size={"width": 360, "height": 640})
    page.evaluate("location.hash = 'plots'")
    page.wait_for_selector("#plot-heading canvas")
    page.evaluate("location.hash = 'helm'")
    page.set_viewport_size({"width": 640, "height": 360})
    page.evaluate("location.hash = 'plots'")
    place, plot = (page.locator(at) for at in ("#plot-heading", "#plot-heading .uplot"))
    until(page, "document.querySelector('#plot-heading .uplot').clientWidth > 500")
    assert plot.bounding_box()["width"] == pytest.approx(place.bounding_box()["width"], abs=0.5), "whole pixels"
    page.context.close()


def test_what_is_empty_says_so_once(helm: Helm) -> None:
    page = helm.open()
    page.evaluate("location.hash = 'logs'")
    assert page.locator("#order-rows li").count() >= 1
    page.evaluate("location.hash = 'alarms'")
    until(page, "document.body.dataset.page === 'alarms'")
    assert page.is_hidden("#alarm-rows + .hint") is (page.locator("#alarm-rows li").count() == 0)
    page.context.close()


RULES = {
    "runOnly": ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22aa", "best-practice"],
    "rules": {"target-size": {"enabled": True}, "page-has-heading-one": {"enabled": True}},
    "resultTypes": ["violations"],
}


def test_axe_finds_nothing_on_any_page_in_any_state_and_light(helm: Helm) -> None:
    axe = pytest.importorskip("axe_playwright_python.base", reason="the extra `browser` (axe) is not installed")
    found: list[str] = []
    runs = 0

    def violations(page: Any) -> list[str]:
        result = page.evaluate(f"axe.run({json.dumps(RULES)})")
        return [f"{each['id']}: {node['target']}" for each in result["violations"] for node in each["nodes"]]

    def check(page: Any, state: str, pages: tuple[str, ...]) -> None:
        nonlocal runs
        for size in ((320, 568), (844, 390), (1280, 800)):
            page.set_viewport_size({"width": size[0], "height": size[1]})
            for name in pages:
                page.evaluate(f"location.hash = '{name}'")
                until(page, f"document.body.dataset.page === {name!r}")
                for theme in ("day", "dusk", "night") if size == (320, 568) else ("day",):
                    assert page.evaluate("document.documentElement.dataset.theme") == theme
                    found.extend(f"{state}, {name}, {theme}, {size[0]}x{size[1]}: {each}" for each in violations(page))
                    runs += 1
                    if size == (320, 568):
                        page.click("#theme")

    def opened(token: str = TOKEN) -> Any:
        page = helm.open(token)
        page.evaluate(axe.AXE_SCRIPT)
        return page

    page, sea = opened(), helm.sea
    check(page, "calm", PAGES)
    page.evaluate("document.querySelectorAll('details').forEach((each) => { each.open = true; })")
    check(page, "all unfolded", ("helm", "parameters"))
    looks = opened("")
    check(looks, "looks only", PAGES)
    helm.vane.is_acknowledged = True
    page.evaluate("location.hash = 'helm'")
    until(page, "!document.getElementById('hold-wind').hidden && !document.getElementById('hold-wind').disabled")
    page.click("#hold-wind")
    word(page, "mode-word", "Wind")
    check(page, "wind", ("helm", "chart", "more"))
    assert "the boat steers true ones, until sensors.magnetic" in (page.text_content("#device-word") or "")
    for source, name in (("axe", "vehicle_failed"), ("axe too", "battery_low")):
        alarm(helm, AlarmEvent(name, "axe"), source)
    page.wait_for_selector("#bar.emergency button")
    page.click("#mob")
    page.wait_for_selector("#overboard")
    check(page, "emergency with a man overboard", ("helm", "chart", "alarms"))
    check(looks, "emergency, looks only", ("helm", "alarms"))
    page.evaluate("location.hash = 'helm'")
    page.click("#mob-off")
    page.wait_for_selector("#mob-off.sure")
    check(page, "asked once more", ("helm",))
    page.keyboard.press("a")
    page.wait_for_selector("#bar.seen")
    check(page, "acknowledged", ("helm", "alarms"))
    page.evaluate("location.hash = 'trials'")
    for _ in range(2):
        page.click("#zigzag button")
    word(page, "trial-word", "Zigzag")
    check(page, "trial", ("helm", "trials", "plots"))
    with helm.hub.lock:
        links, sea.links = sea.links, []
    word(page, "stale", "No data from the boat")
    check(page, "silent boat", ("helm", "chart"))
    page.context.set_offline(True)
    page.evaluate("window.stop()")
    word(page, "stale", "lost its server")
    check(page, "no server", ("helm", "parameters"))
    with helm.hub.lock:
        sea.links = links
    page.context.close()
    assert found == [] and runs > 150
    looks.evaluate("document.querySelector('h1').remove()")
    small = "min-height: 0; flex: none; gap: 0; height: 9px; width: 9px"
    looks.evaluate(f"document.querySelectorAll('.main-nav a').forEach((at) => {{ at.style = '{small}'; }})")
    assert {each.partition(":")[0] for each in violations(looks)} >= {"page-has-heading-one", "target-size"}
    looks.context.close()


@pytest.mark.parametrize("size", [(320, 640), (390, 844), (844, 390), (1366, 800)], ids=["320", "390", "wide", "desk"])
def test_the_next_step_of_a_new_boat_is_in_view(size: tuple[int, int], browser: Any, tmp_path: Path) -> None:
    steps = PageOfSteps(tmp_path / "boat.yaml")
    for name in ("doctor", "rudder"):
        steps.mark(name, is_done=True)
    silent = Watched(tmp_path)
    with served(silent, steps=steps) as (address, _):
        page = browser.new_context(viewport=dict(zip(("width", "height"), size, strict=True))).new_page()
        page.goto(f"{address}/#token={TOKEN}")
        page.evaluate("location.hash = 'begin'")
        # the rows are drawn anew, with their buttons, once the page knows that it may order
        page.wait_for_selector("#step-rows > .next button")
        page.evaluate("document.querySelector('#step-rows > .next').kept = true")
        assert page.is_hidden("#stale"), "a boat that is being set up has no pilot yet"
        title, nav = (page.locator(at).first.bounding_box() for at in ("#step-rows > .next b", "nav.main-nav"))
        assert title["y"] >= 0.0 and title["y"] + title["height"] <= nav["y"]
        assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
        with page.expect_response("**/api/steps"):
            page.evaluate("location.hash = 'helm'; location.hash = 'begin'")
        page.wait_for_timeout(100)
        assert page.evaluate("document.querySelector('#step-rows > .next').kept"), "looked at again it stands as it is"
        button = page.locator("#step-rows > .next button")
        button.scroll_into_view_if_needed()
        assert button.bounding_box()["y"] + button.bounding_box()["height"] <= nav["y"]
        button.click()
        page.wait_for_selector("#step-rows > .next b:has-text('your boat')")
        until(page, "document.activeElement.matches('#step-rows > .next')")
        page.keyboard.press("Enter")
        page.context.close()
    assert "identify" not in (tmp_path / "boat.commissioning.json").read_text(), "a second press marks no other step"
    assert "zigzag" in (tmp_path / "boat.commissioning.json").read_text()


@pytest.mark.parametrize("light", ["light", "dark"])
def test_axe_finds_nothing_in_a_report_in_either_light(light: str, browser: Any, tmp_path: Path) -> None:
    axe = pytest.importorskip("axe_playwright_python.base", reason="the extra `browser` (axe) is not installed")
    wide = "<svg role='img' aria-label='a curve' viewBox='0 0 90 20'></svg>"
    said = [("The law", ("it is calm", "it is quick"))]
    shown = Section("Heading", (("", "rms"), ("held", "0.3 deg")), ("A paragraph.",), wide, "what was held", said)
    opening = Opening("A hold", "What it is about.", shown, ("good", "good: held"))
    (tmp_path / "report.html").write_text(render(opening, [shown], "autopilot log compare"))
    for size in ((360, 640), (1280, 800)):
        page = browser.new_context(
            color_scheme=light, viewport=dict(zip(("width", "height"), size, strict=True))
        ).new_page()
        page.goto((tmp_path / "report.html").as_uri())
        page.evaluate(axe.AXE_SCRIPT)
        result = page.evaluate(f"axe.run({json.dumps(RULES)})")
        found = [f"{each['id']}: {node['target']}" for each in result["violations"] for node in each["nodes"]]
        assert found == []
        page.context.close()
