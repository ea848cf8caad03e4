"""The links: whether headings come, how often, how evenly, and whether the helm would be ours. Nothing is steered."""

from __future__ import annotations

import itertools
from collections import defaultdict
from collections.abc import Callable, Sequence
from typing import NamedTuple

from autopilot.alarm_words import sentences_of
from autopilot.doctor.finding import Finding, Verdict, share_below
from autopilot.doctor.firmware import firmware_findings
from autopilot.links.base import Link, LinkError, parted
from autopilot.links.mavlink_companion import CompanionLink
from autopilot.loop.clock import Clock
from autopilot.params.vessel import Vessel
from autopilot.signals import AlarmEvent, AlarmSample, HeadingSample, HelmSample

SLOW_HZ = 4.0
PACE_S = 0.05


class Heard(NamedTuple):
    """When headings arrived [s] and how old they were [s], by their sources; the last word on the helm, and alarms."""

    arrivals: dict[str, list[float]]
    ages: dict[str, list[float]]
    helm: dict[str, str]
    alarms: dict[str, AlarmEvent | None]
    seconds: float


def listen(links: Sequence[Link], clock: Clock, seconds: float) -> Heard:
    """Listen for so long. Raises LinkError where a link is lost."""
    heard = Heard(defaultdict(list), defaultdict(list), {}, {}, seconds)
    end = clock.now() + seconds
    while (now := clock.now()) < end:
        for link in links:
            for sample in link.receive(now):
                _take(heard, now, sample)
            link.keep(now)
        clock.wait([fd for fd in (link.fileno() for link in links) if fd >= 0], min(end, now + PACE_S))
    return heard


def _take(heard: Heard, now: float, sample: object) -> None:
    if isinstance(sample, HeadingSample):
        heard.arrivals[sample.source].append(now)
        heard.ages[sample.source].append(now - sample.time)
    elif isinstance(sample, HelmSample):
        heard.helm[sample.source] = "" if sample.available else sample.reason
    elif isinstance(sample, AlarmSample):
        heard.alarms[sample.source] = sample.event


def nothing_known() -> str:
    """Return '': what came over the lines is not known."""
    return ""


def judged(heard: Heard, timeout: float, came: Callable[[], str] = nothing_known) -> list[Finding]:
    """Return what was heard as findings; `timeout` [s] is the fail-safe's patience with a silent compass."""
    findings = [_heading(source, heard, timeout) for source in sorted(heard.arrivals)]
    if not findings:
        cure = came() or "check that the compass or vehicle is on, its wiring, and the baud rate"
        findings.append(Finding("heading", Verdict.NO_GO, f"none came in {heard.seconds:.0f} s", cure))
    for source, reason in heard.helm.items():
        verdict = Verdict.NO_GO if reason else Verdict.GO
        findings.append(Finding("helm", verdict, f"{source}: {reason or 'obeys us'}", "as it says; see --as-gcs"))
    said = sentences_of(event for event in heard.alarms.values() if event is not None)
    findings += [Finding("alarm", Verdict.WARN, text, "as it says") for text in said]
    return findings


def _heading(source: str, heard: Heard, timeout: float) -> Finding:
    arrivals = heard.arrivals[source]
    gaps = [later - sooner for sooner, later in itertools.pairwise(arrivals)]
    if not gaps:
        cure = "check the compass and its wiring"
        return Finding(f"heading {source}", Verdict.NO_GO, f"one in {heard.seconds:.0f} s", cure)
    rate = len(gaps) / (arrivals[-1] - arrivals[0]) if arrivals[-1] > arrivals[0] else float("inf")
    usual, longest = share_below(gaps, 0.5), max(gaps)
    jitter = share_below([abs(gap - usual) for gap in gaps], 0.95)
    age = share_below(heard.ages[source], 0.5)
    figures = {"rate_hz": rate, "jitter_ms": jitter * 1e3, "longest_gap_ms": longest * 1e3, "age_ms": age * 1e3}
    found = (
        f"{rate:.1f} Hz, 95 % within {jitter * 1e3:.0f} ms of even, longest gap {longest * 1e3:.0f} ms, "
        f"{age * 1e3:.0f} ms old"
    )
    name = f"heading {source}"
    if longest > timeout:
        cure = (
            f"the fail-safe acts after failsafe.heading_timeout_s = {timeout:g}: mend the line, or the rate asked for"
        )
        return Finding(name, Verdict.NO_GO, found, cure, figures)
    verdict = Verdict.WARN if rate < SLOW_HZ or longest > 0.5 * timeout else Verdict.GO
    return Finding(name, verdict, found, "a quicker compass, a higher baud rate, or fewer other sentences", figures)


def examine(
    open_links: Callable[[], list[Link]],
    clock: Clock,
    seconds: float,
    timeout: float,
    vessel: Vessel | None = None,
    came: Callable[[], str] = nothing_known,
) -> list[Finding]:
    """Open links, listen, close them again, and return the findings; of the servo's scale where `vessel` is given.

    `came` says what came over the links where no heading did.
    """
    try:
        links = open_links()
    except LinkError as error:
        return [Finding("link", Verdict.NO_GO, *parted(str(error)))]
    try:
        findings = judged(listen(links, clock, seconds), timeout, came)
        for link in links:
            if isinstance(link, CompanionLink):
                findings += firmware_findings(link.vehicle_parameters, vessel)
        return findings
    except LinkError as error:
        return [Finding("link", Verdict.NO_GO, *parted(str(error)))]
    finally:
        for link in links:
            link.release(clock.now())
            link.close()
