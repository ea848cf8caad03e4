"""The page in a real browser, with the pilot and its boat behind it: steering, alarms, silence, contrast, keyboard."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from alarm_texts import other
from monitored_boat import Watched, noted
from page_server import TOKEN, SailingHub, chromium, served

from autopilot.signals import AlarmSample

pytestmark = pytest.mark.real_time
PATIENCE_MS = 40_000.0
PHONE = {"width": 390, "height": 844}
DESKTOP = {"width": 1366, "height": 800}
CONTRAST = (Path(__file__).parent / "contrast.js").read_text()


class Helm:
    """One browser window on the page; `errors` is what the page complained of."""

    def __init__(self, browser: Any, address: str, hub: SailingHub) -> None:
        self.browser, self.address, self.hub, self.sea = browser, address, hub, hub.sea
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


@pytest.fixture(scope="module")
def helm(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Helm]:
    folder = tmp_path_factory.mktemp("sea")
    (folder / "one.tlog").write_bytes(b"\xfd" * 5000)
    sea = Watched(folder, learns=True)
    sea.watch(3.0)
    with chromium() as browser, served(sea, folder) as (address, hub):
        helm = Helm(browser, address, hub)
        yield helm
        assert helm.errors == []


def until(page: Any, expression: str) -> None:
    """Wait for a condition, asked from outside: the page's own policy forbids evaluating text inside."""
    waited = 0.0
    while not page.evaluate(expression):
        assert waited < PATIENCE_MS, f"{expression}: not so within {waited / 1000:g} s"
        page.wait_for_timeout(50.0)
        waited += 50.0


def word(page: Any, element: str, words: str) -> None:
    until(page, f"document.getElementById({element!r}).textContent.includes({words!r})")


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
    with helm.hub.lock:
        assert not sea.commands.armed
    page.context.close()


def test_who_has_no_token_is_informed_and_moves_nothing(helm: Helm) -> None:
    page = helm.open(token="")
    word(page, "who-word", "only looking")
    page.click("#engage")
    word(page, "said", "Only looking")
    with helm.hub.lock:
        assert not helm.sea.commands.armed
    page.context.close()


def test_an_alarm_says_what_to_do_and_is_acknowledged_for_all(helm: Helm) -> None:
    here, there = helm.open(), helm.open(token="", size=DESKTOP)
    with helm.hub.lock:
        noted(helm.sea.pilot, AlarmSample(helm.sea.now, other("gear hot: stop the engine"), "gear"))
    for page in (here, there):
        word(page, "alarms", "gear hot")
        assert page.inner_text("#alarms small") == "stop the engine"
    here.click("#alarms button")
    for page in (here, there):
        page.wait_for_selector("#alarms.seen")
    with helm.hub.lock:
        noted(helm.sea.pilot, AlarmSample(helm.sea.now, None, "gear"))
    there.wait_for_selector("#alarms", state="hidden")
    here.context.close()
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
        for name in ("plots", "learning", "trials", "parameters", "logs"):
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
    assert {"#plots", "#learning", "#trials", "#parameters", "#logs"} <= reached
    assert ringless == []
    assert all(url.startswith((helm.address, "data:")) for url in helm.asked)
    page.context.close()


def test_a_zigzag_is_started_seen_and_ended_and_a_log_is_downloaded(helm: Helm) -> None:
    page = helm.open(size=DESKTOP)
    page.click("nav a[href='#trials']")
    for _ in range(2):
        page.click("#zigzag button")
    word(page, "trial-word", "Zigzag: under way")
    page.wait_for_selector("#plot-trial canvas")
    page.click("#cancel")
    word(page, "trial-word", "ended as you asked")
    page.click("nav a[href='#logs']")
    with page.expect_download() as download:
        page.click("#log-rows button")
    assert Path(download.value.path()).read_bytes() == b"\xfd" * 5000
    page.keyboard.press("Escape")
    word(page, "mode-word", "Standby")
    page.context.close()


@pytest.mark.parametrize("size", [(320, 568), (667, 375), (390, 844)], ids="{0[0]}x{0[1]}".format)
def test_what_steers_is_in_reach_on_small_screens(helm: Helm, size: tuple[int, int]) -> None:
    width, height = size
    page = helm.open(size={"width": width, "height": height})
    until(page, "!document.getElementById('engage').disabled")
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    footer = page.locator("footer").bounding_box()["y"]
    for button in ("button[data-turn='-10']", "button[data-turn='10']", "#engage", "#route", "#standby"):
        box = page.locator(button).bounding_box()
        assert box["x"] >= 0 and box["x"] + box["width"] <= width, button
        assert box["y"] >= 0 and box["y"] + box["height"] <= footer, button
        assert box["height"] >= 40, button
