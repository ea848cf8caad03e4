"""The pictures of the README and the docs: the simulated boat, the pilot and the helm page, seen in a real Chromium.

    python benchmarks/screenshots.py [--out docs/images]

Needs the extras `web`, `browser` and `report`, and a Chromium. What is shown is a run made by this command: simulator,
`autopilot run --learn --serve` and `autopilot web` as processes of their own, on free ports of this machine.
"""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import html
import io
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from latency import free_port
from PIL import Image

from autopilot.vessel.file import dump_vessel, load_vessel
from autopilot.web.screen import screen
from autopilot.web.station import BoatLine, Station

CHROMIUM = ["--no-sandbox", "--disable-gpu", "--disable-background-networking", "--disable-sync", "--no-first-run"]
PHONE = {"width": 390, "height": 844}
DESKTOP = {"width": 1280, "height": 800}
PATIENCE_S = 90.0
CALM_S = 20.0
COLOURS = 128
LEARNS_IN_TURNS = (10, -10, -10, 10, 10, -10)
TERMINAL = (84, 24)
INKS = {
    "plain": "#d8dee9",
    "dim": "#7b8794",
    "strong": "#ffffff",
    "on": "#8fd694",
    "alarm": "#f2c14e",
    "bad": "#ff6b6b",
}


@contextlib.contextmanager
def helm(folder: Path, vessel: str = "lanxin", scenario: str = "ittc") -> Iterator[tuple[str, int]]:
    """Run simulator, pilot and page while the block lasts; yield the address with the token, and a port served.

    vessel: what the pilot takes the boat for, which is `lanxin` in that scenario.
    """
    line, served, port, terminal = (free_port() for _ in range(4))
    logs = folder / "logs"
    logs.mkdir()
    with contextlib.ExitStack() as ends:

        def start(*command: str) -> subprocess.Popen[str]:
            process = subprocess.Popen(
                [sys.executable, "-m", *command],
                cwd=folder,
                text=True,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
            )
            ends.callback(process.communicate)
            ends.callback(process.terminate)
            return process

        start("sitl", "serve", "lanxin", "--scenario", scenario, "--mavlink", f"udpout:127.0.0.1:{line}")
        start(
            *("autopilot", "run", vessel, "--as-gcs", "--learn", "--log", str(logs / "tour.tlog"), "--wait", "0"),
            *("--link", f"udpin:127.0.0.1:{line}", "--serve", f"udpout:127.0.0.1:{served}"),
            *("--serve", f"udpout:127.0.0.1:{terminal}"),
        )
        web = start(
            *("autopilot", "web", "--link", f"udpin:127.0.0.1:{served}", "--listen", f"127.0.0.1:{port}"),
            *("--logs", str(logs)),
        )
        assert web.stdout is not None
        for printed in web.stdout:
            if found := re.search(r"http://\S+token=\S+", printed):
                break
        else:
            raise SystemExit("the page did not start")
        yield found.group(0), terminal


def until(page: Any, expression: str) -> None:
    """Wait for a condition of the page."""
    waited = 0.0
    while not page.evaluate(expression):
        if waited > PATIENCE_S:
            raise SystemExit(f"not within {PATIENCE_S:g} s: {expression}")
        page.wait_for_timeout(100.0)
        waited += 0.1


def opened(browser: Any, address: str, size: dict[str, int], theme: str) -> Any:
    """Return a window on the page that hears the boat."""
    context = browser.new_context(viewport=size, device_scale_factor=1.25)
    page = context.new_page()
    page.goto(address)
    until(page, "document.getElementById('link-word').textContent === 'live'")
    while page.evaluate("document.documentElement.dataset.theme") != theme:
        page.click("#theme")
    return page


def is_calm(page: Any) -> bool:
    """Return whether no alarm is on; one that comes from a busy machine is waited for."""
    for _ in range(round(CALM_S)):
        if page.evaluate("document.getElementById('bar')?.hidden ?? true"):
            return True
        page.wait_for_timeout(1000.0)
    return False


def turn_to(page: Any, name: str) -> None:
    """Show one of the pages."""
    page.evaluate(f"location.hash = {name!r}")


def keep(page: Any, path: Path) -> None:
    """Save a small picture of the window: as many colours as such a page has. Not one of an alarm by a busy machine."""
    if not is_calm(page):
        print(f"{path} is left as it is: {page.inner_text('#bar')}", flush=True)
        return
    picture = Image.open(io.BytesIO(page.screenshot())).convert("RGB")
    picture.quantize(COLOURS, dither=Image.Dither.NONE).save(path, optimize=True)
    print(f"{path}  {path.stat().st_size / 1000.0:.0f} kB", flush=True)


def in_a_terminal(browser: Any, port: int, path: Path) -> None:
    """Show what `autopilot helm` draws: the lines of its screen, in the inks of a dark terminal."""
    station = Station()
    line = BoatLine(f"udpin:127.0.0.1:{port}", station)
    until_s = time.monotonic() + 12.0
    while time.monotonic() < until_s:
        line.turn(time.monotonic())
        station.view.keep_history(time.monotonic())
        time.sleep(0.02)
    rows = screen(station, time.monotonic(), TERMINAL)
    line.close()
    text = "\n".join(f'<span style="color:{INKS[row.style]}">{html.escape(row.text)}</span>' for row in rows)
    page = browser.new_page(viewport={"width": 800, "height": 420})
    page.set_content(f'<body style="margin:0;background:#11161c"><pre style="margin:12px;font-size:14px">{text}</pre>')
    keep(page, path)


def report(browser: Any, folder: Path, path: Path) -> None:
    """Show the page that `autopilot gains --report` writes."""
    written = folder / "gains.html"
    command = [sys.executable, "-m", "autopilot", "gains", "lanxin", "--report", str(written)]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    page = browser.new_page(viewport={"width": 1000, "height": 640})
    page.goto(written.as_uri())
    keep(page, path)


def tour(browser: Any, address: str, port: int, out: Path) -> None:
    """Engage, turn, sail a zigzag, and take pictures on the way."""
    phone = opened(browser, address, PHONE, "day")
    phone.click("#engage")
    until(phone, "document.getElementById('mode-word').textContent === 'Heading'")
    phone.wait_for_timeout(8000.0)
    for _ in range(4):
        phone.click("button[data-turn='10']")
    until(phone, "Math.abs(parseFloat(document.getElementById('t-rudder').textContent)) > 8")
    keep(phone, out / "helm-day.png")
    desktop = opened(browser, address, DESKTOP, "dusk")
    desktop.wait_for_timeout(9000.0)
    turn_to(desktop, "plots")
    desktop.click("button[data-turn='-10']")
    desktop.wait_for_timeout(12000.0)
    keep(desktop, out / "helm-plots.png")
    turn_to(desktop, "chart")
    desktop.wait_for_timeout(2000.0)
    keep(desktop, out / "helm-chart.png")
    turn_to(desktop, "trials")
    for _ in range(2):
        desktop.click("#zigzag button")
    until(desktop, "document.getElementById('trial-progress').value >= 40")
    keep(desktop, out / "helm-trial.png")
    desktop.click("#cancel")
    desktop.wait_for_timeout(3000.0)
    phone.click("#engage")
    night = opened(browser, address, PHONE, "night")
    until(night, "document.getElementById('mode-word').textContent === 'Heading'")
    night.wait_for_timeout(6000.0)
    keep(night, out / "helm-night.png")
    while night.evaluate("document.documentElement.dataset.theme") != "day":
        night.click("#theme")
    turn_to(night, "parameters")
    night.wait_for_timeout(3000.0)
    keep(night, out / "helm-parameters.png")
    # last, for a display that leaves is a caution on the others
    in_a_terminal(browser, port, out / "helm-terminal.png")
    night.click("#release")


def learnt(browser: Any, folder: Path, path: Path) -> None:
    """Show what is learnt in flat water by a pilot whose file has K 30 % too small: a zigzag, then turns."""
    boat = load_vessel("lanxin")
    off = dataclasses.replace(boat, model=dataclasses.replace(boat.model, K_1_s=round(0.7 * boat.model.K_1_s, 3)))
    (folder / "off.yaml").write_text(dump_vessel(off))
    with helm(folder, "off.yaml", "calm") as (address, _):
        phone = opened(browser, address, PHONE, "day")
        while phone.inner_text("#mode-word") != "Heading":
            # not taken while the pilot still listens for what the flight controller is set to
            phone.click("#engage")
            phone.wait_for_timeout(2000.0)
        turn_to(phone, "trials")
        phone.fill("#zigzag [name=rudder]", "20")
        phone.fill("#zigzag [name=change]", "20")
        for _ in range(2):
            phone.click("#zigzag button")
        until(phone, "document.getElementById('trial-progress').value >= 95")
        turn_to(phone, "helm")
        for turn in LEARNS_IN_TURNS:
            for _ in range(5):
                phone.click(f"button[data-turn='{turn}']")
            phone.wait_for_timeout(8000.0)
        turn_to(phone, "learning")
        until(phone, "document.querySelectorAll('#learning-rows tr').length >= 3")
        phone.wait_for_timeout(3000.0)
        keep(phone, path)
        phone.context.close()


def main() -> None:
    """Make the pictures."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("docs/images"), help="folder (docs/images)")
    arguments = parser.parse_args()
    program = shutil.which("chromium") or shutil.which("google-chrome")
    if program is None:
        raise SystemExit("no Chromium here: install one (Debian: apt install chromium)")
    from playwright.sync_api import sync_playwright

    arguments.out.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as name, helm(Path(name)) as (address, port), sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=program, args=CHROMIUM)
        tour(browser, address, port, arguments.out)
        report(browser, Path(name), arguments.out / "report.png")
        browser.close()
    with tempfile.TemporaryDirectory() as name, sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=program, args=CHROMIUM)
        learnt(browser, Path(name), arguments.out / "helm-learning.png")
        browser.close()


if __name__ == "__main__":
    main()
