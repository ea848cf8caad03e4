"""The pages that are written from the code name what really travels, and every exit code there is."""

from __future__ import annotations

import re
from collections import defaultdict
from pathlib import Path
from typing import Any

import pytest
from monitored_boat import Watched

from autopilot.errors import ExitCode
from autopilot.links.mavlink.codec import MavlinkCodec
from autopilot.links.transports import LoopbackTransport

ROOT = Path(__file__).parents[2]


@pytest.fixture
def mavlink(monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.syspath_prepend(str(ROOT / "docs"))
    import mavlink_reference

    return mavlink_reference


def test_every_message_and_command_that_pilot_and_page_exchange_is_in_the_table(
    mavlink: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    codec, names, commands = MavlinkCodec(9, 9), defaultdict(set), set()
    send = LoopbackTransport.send

    def listened(line: LoopbackTransport, data: bytes) -> bool:
        for message in codec.decode(data):
            names[message.get_srcSystem()].add(message.get_type())
            if message.get_type() == "COMMAND_LONG":
                commands.add(int(message.command))
        return send(line, data)

    monkeypatch.setattr(LoopbackTransport, "send", listened)
    sea = Watched(tmp_path)
    sea.watch(1.0)
    for wanted in (
        {"do": "engage"},
        {"do": "turn", "degrees": 5},
        {"do": "zigzag", "rudder": 10, "change": 10, "duration": 30},
        {"do": "cancel"},
        {"do": "acknowledge"},
        {"do": "release"},
    ):
        sea.order(**wanted)
        sea.watch(1.5 if wanted["do"] == "engage" else 0.2)
    sea.station.parameters.read()
    sea.watch(1.0)
    sent, read = mavlink.messages()
    assert len(names) == 2 and sum(map(len, names.values())) > 15
    for said in names.values():
        assert said <= sent.keys()
    assert {"COMMAND_CANCEL", "FILE_TRANSFER_PROTOCOL", "PARAM_REQUEST_LIST"} <= read.keys()
    known = {int(getattr(mavlink.dialect, name)) for name in mavlink.commands() if hasattr(mavlink.dialect, name)}
    assert len(commands) > 5 and commands <= known
    assert "zigzag" in mavlink.mavlink() and "User defined" not in mavlink.mavlink()
    assert all(sent[name] or read[name] for name in sent.keys() | read.keys())


def test_every_exit_code_is_on_its_page_and_beside_the_answers_to_failures(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ROOT / "docs"))
    import reference_pages

    rows = re.findall(r"^\| (\d+) \| (?:`(\w+)`)? *\| (.+) \|$", reference_pages.exit_codes(), re.MULTILINE)
    assert [int(code) for code, _, _ in rows] == [*range(7), 129, 130, 143]
    assert {name: int(code) for code, name, _ in rows if name} == {code.name: code.value for code in ExitCode}
    page = (ROOT / "docs" / "safety.md").read_text(encoding="utf-8")
    assert re.findall(r"^\| (\d+) \| .+ \|$", page, re.MULTILINE) == [code for code, _, _ in rows]
