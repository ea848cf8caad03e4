"""The pages docs/supervisor.md and docs/alarms.md, from the very tables that the pilot obeys.

python docs/supervisor_pages.py
"""

from __future__ import annotations

from collections.abc import Iterable
from itertools import groupby
from pathlib import Path

from alarm_conditions import CONDITIONS

from autopilot.signals import Mode, SupervisorState
from autopilot.supervision.alarms import CATALOGUE, SOUNDS, AlarmKind, Priority, Response
from autopilot.supervision.panel import WORDS
from autopilot.supervision.states import MODES, TABLE, Action, Event, Row, Says

COMMAND = "python docs/supervisor_pages.py"
MEANING = {
    SupervisorState.STANDBY: "the rudder is released; nothing is asked of the pilot",
    SupervisorState.HEADING: "the law holds the heading ordered",
    SupervisorState.TRACK: "the law holds the heading that a route, a pattern or a chart plotter leads to",
    SupervisorState.TRIAL: "the rudder goes where a trial puts it: a held angle, a zigzag",
    SupervisorState.DEGRADED: "the law steers on, though something it rests on is in doubt",
    SupervisorState.OVERRIDE: "a human or the firmware has taken the helm; the rudder is released",
    SupervisorState.FAILSAFE: (
        "steering has ended for a trouble; the rudder does what the vessel file says, and is released in the end"
    ),
    SupervisorState.FAULT: (
        "a command was not fit to leave: the pilot itself is in doubt; the rudder is held, then released"
    ),
}


def supervisor_page() -> str:
    """Return docs/supervisor.md."""
    parts = [
        "# The supervisor",
        "Who has the rudder, drawn from the table in `autopilot/supervision/states.py` by\n"
        f"`{COMMAND}`. A pair of state and event that is in none of the rows below\n"
        "changes nothing.",
        _between(),
        "## States",
        _rows(("State", "Mode", "Meaning"), ((_name(s), MODES[s].name, MEANING[s]) for s in SupervisorState)),
        "## Events",
        "In a tick the helm comes first, then troubles, then orders; what is said further up goes before what is said\n"
        "below.",
        _rows(("Event", "When"), ((event.name.lower(), event.value) for event in Event)),
        "## The table",
        _transitions(),
        "## Actions",
        _rows(("Action", "What is done"), ((action.name.lower(), action.value) for action in Action)),
        "What each alarm does, and where its limit stands: [alarms.md](alarms.md).",
    ]
    return "\n\n".join(parts) + "\n"


def alarms_page() -> str:
    """Return docs/alarms.md."""
    kinds = sorted(CATALOGUE.values(), key=lambda kind: list(Response).index(kind.response))
    parts = [
        "# Alarms",
        "An alarm is shown and logged for as long as it lasts. It sounds until it is acknowledged or over. An\n"
        "alarm that ends steering sounds until it is acknowledged. After 30 s without an acknowledgement an alarm\n"
        "is repeated, louder.",
        "If a lost heading or a silent vehicle has ended the steering and has been back for 2 s, its alarm says\n"
        "`(ended)`. Once acknowledged, it goes; the mode still shows that nothing is steered. If it is lost again,\n"
        "that is a new alarm.",
        "Priorities are those of bridge alert management (IMO MSC.302(87), IEC 62923):",
        _rows(
            ("Priority", "What it asks", "On the displays", "Heard until acknowledged"),
            (
                (name.lower(), asks, shown, _heard(Priority[name]))
                for name, asks, shown in (
                    ("EMERGENCY", "nobody steers, and the rudder may not be free: take the helm now", "red, blinks"),
                    ("ALARM", "act at once: most end steering", "red, blinks"),
                    ("WARNING", "steering goes on; look, before it becomes an alarm", "orange, blinks"),
                    ("CAUTION", "read it", "yellow, steady"),
                )
            ),
        ),
        "An acknowledged alarm stays on the displays, steady, until it is over. A warning that nobody\n"
        "acknowledges within 30 s sounds like an alarm. The page and the terminal helm keep a history of when\n"
        "each alarm was raised, acknowledged and cleared. The page's history lasts as long as `autopilot web`\n"
        "runs, with or without an open page.",
        "To acknowledge alarms:",
        _rows(
            ("Where", "One alarm", "All alarms"),
            (
                ("the page", "*Acknowledge* beside it", "*Acknowledge all*, or any order"),
                ("the terminal helm", "`A`", "`a`, or any order"),
                ("the pilot's own terminal", "", "`a`, or any order"),
                (
                    "MAVLink command SPATIAL_USER_5 (31009)",
                    "parameter 1: the lowest 24 bits of the CRC-32 of the alarm's name",
                    "parameter 1: 0",
                ),
            ),
        ),
        "The list of alarms can be read over MAVLink FTP (`/alarms.json`). Alarms are also sent as STATUSTEXT and as\n"
        "unhealthy subsystems in SYS_STATUS.",
        "`alarms.outputs` in the vessel file sets where alarms are heard:",
        _rows(
            ("Output", "What sounds"),
            (
                ("`bell`", "the terminal's bell"),
                ("`tune`", "the vehicle's buzzer (PLAY_TUNE)"),
                ("`relay:N`", "the vehicle's relay N (DO_SET_RELAY)"),
                ("`file:PATH`", "1 is written while an alarm sounds, else 0: the value of a GPIO in sysfs"),
            ),
        ),
    ]
    for response, group in groupby(kinds, key=lambda kind: kind.response):
        parts += [f"## {response.value[0].upper()}{response.value[1:]}", _alarm_table(group)]
    source = "`autopilot/supervision/alarms.py` and `panel.py`"
    parts.append(f"This page is generated from {source} by `{COMMAND}`.")
    return "\n\n".join(parts) + "\n"


def _alarm_table(kinds: Iterable[AlarmKind]) -> str:
    return _rows(
        ("Name", "Priority", "Alarm", "What to do", "Raised when", "Vessel file", "Severity", "Who watches"),
        (
            (
                f"`{kind.name}`",
                kind.priority.name.lower(),
                words.text,
                words.remedy,
                condition.limit,
                ", ".join(f"`{key}`" for key in condition.key.split(", ")) if condition.key else "",
                kind.severity.name.lower(),
                condition.watcher.value,
            )
            for kind, words, condition in ((kind, WORDS[kind.name], CONDITIONS[kind.name]) for kind in kinds)
        ),
    )


def _heard(priority: Priority) -> str:
    sound = SOUNDS.get(priority)
    return f"{sound.tones} tones every {sound.every:g} s" if sound is not None else "nothing"


def _between() -> str:
    """Return which events lead from a mode, down the side, to another, along the top."""
    rows = []
    for start in Mode:
        cells: dict[Mode, list[str]] = {mode: [] for mode in Mode}
        for event in Event:
            leaving = (state for state in SupervisorState if MODES[state] is start)
            for follows in sorted({MODES[TABLE[state, event].next] for state in leaving} - {start}):
                cells[follows].append(event.name.lower())
        rows.append((f"**{start.name}**", *("<br>".join(cells[mode]) for mode in Mode)))
    return _rows(("from, to", *(mode.name for mode in Mode)), rows)


def _transitions() -> str:
    """One line for each event and outcome, the states with the same outcome together."""
    lines = []
    for event in Event:
        outcomes: dict[tuple[str, tuple[Action, ...], Says], list[str]] = {}
        for state in SupervisorState:
            row = TABLE[state, event]
            if row != Row(state):
                following = "stays" if row.next is state else _name(row.next)
                outcomes.setdefault((following, row.actions, row.says), []).append(_name(state))
        for (following, actions, says), states in outcomes.items():
            done = ", ".join(action.name.lower() for action in actions)
            lines.append((event.name.lower(), ", ".join(states), following, done, says.value))
    return _rows(("Event", "In", "Next", "Actions", "Said"), lines)


def _rows(head: tuple[str, ...], lines: Iterable[tuple[str, ...]]) -> str:
    ruled = [head, tuple("---" for _ in head), *lines]
    return "\n".join(f"| {' | '.join(line)} |" for line in ruled)


def _name(state: SupervisorState) -> str:
    return state.name.lower()


if __name__ == "__main__":
    for name, page in (("supervisor.md", supervisor_page), ("alarms.md", alarms_page)):
        Path(__file__).with_name(name).write_text(page(), encoding="utf-8")
