"""A firmware that restarts under the pilot, starts while it waits, or has its mode overwritten: in lockstep."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path
from typing import Any

import pytest
from alarm_texts import words_of
from lockstep import BadLine, Lockstep, stick_follows
from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.control.registry import TRIAL_LAW
from autopilot.links.mavlink.codec import MavlinkCodec
from autopilot.links.mavlink.overrides import CHECKED_ON_ENGAGING
from autopilot.runtime.record import replay
from autopilot.signals import Mode, Order
from autopilot.supervision import supervisor
from autopilot.vessel.file import load_vessel
from autopilot.vessel.schema import Vessel

METHODS = ["rc_override", "manual_control", "guided"]
MODE_OF = {"rc_override": "MANUAL", "manual_control": "MANUAL", "guided": "GUIDED"}
GAINS = {"ATC_STR_RAT_FF": 12.0, "ATC_STR_RAT_P": 1.0, "ATC_STR_RAT_I": 1.0, "ATC_STR_ANG_P": 1.0}


def vessel(method: str, reengage: bool = False) -> Vessel:
    boat = load_vessel("lanxin")
    return dataclasses.replace(
        boat,
        helm=dataclasses.replace(boat.helm, method=method),  # type: ignore[arg-type]
        failsafe=dataclasses.replace(boat.failsafe, reengage_after_reboot=reengage),
    )


def bench(method: str, reengage: bool = False, lines: Any = (), log: Path | None = None, **vehicle: Any) -> Lockstep:
    boat = Lockstep(
        vessel(method, reengage),
        law=TRIAL_LAW if method == "guided" else None,
        vehicle={"mode": MODE_OF[method], **vehicle},
        parameters=GAINS,
        lines=lines,
        log=log,
    )
    if method == "guided":
        boat.hooks.append(stick_follows)
    return boat


class Gap:
    """A line on which nothing passes for a while: a flight controller that restarts says nothing."""

    def __init__(self) -> None:
        self.lines = (BadLine(), BadLine())
        self.until = -math.inf
        for line in self.lines:
            line.put = self._put(line.put)  # type: ignore[method-assign]

    def _put(self, put: Any) -> Any:
        return lambda now, data: put(now, data) if now >= self.until else None


def reboot(boat: Lockstep, gap: Gap, silence: float) -> None:
    boat.vehicle.reboots_at = boat.now
    gap.until = boat.now + silence


def engaged_bench(method: str, gap: Gap, reengage: bool, log: Path | None = None) -> Lockstep:
    boat = bench(method, reengage, gap.lines, log)
    boat.engage(40.0)
    assert boat.run(9.0, until=boat.engaged)
    boat.run(12.0)
    assert math.degrees(boat.world.boat.state.heading) == pytest.approx(40.0, abs=2.0)
    return boat


@pytest.mark.parametrize(("method", "silence"), [("rc_override", 6.0), ("manual_control", 0.0), ("guided", 0.0)])
def test_after_a_reboot_the_pilot_stands_by_with_fresh_parameters_until_it_is_engaged(
    method: str, silence: float
) -> None:
    gap = Gap()
    boat = engaged_bench(method, gap, reengage=False)
    boat.firmware.parameters.set("RC1_TRIM", 1540)
    reboot(boat, gap, silence)
    boat.run(silence + 3.0)
    assert boat.tick.mode is Mode.OVERRIDE
    assert boat.firmware.set_armed(True)
    boat.run(10.0)
    assert boat.tick.mode is Mode.OVERRIDE
    assert not boat.firmware.overrides.active(boat.now, 3.0)
    assert boat.firmware.guided.target is None
    boat.engage(60.0)
    assert boat.run(9.0, until=boat.engaged)
    boat.run(12.0)
    assert boat.tick.mode is Mode.ENGAGED
    assert math.degrees(boat.world.boat.state.heading) == pytest.approx(60.0, abs=2.0), "with the trim as it is now"
    channel = boat.link.session._output.channel
    assert channel is not None
    assert channel.rc_trim == 1540


@pytest.mark.parametrize(("method", "silence"), [("rc_override", 0.0), ("rc_override", 25.0), ("guided", 6.0)])
def test_where_the_vessel_file_says_so_it_engages_again_once_the_vehicle_is_armed(
    tmp_path: Path, method: str, silence: float
) -> None:
    gap, log = Gap(), tmp_path / "run.tlog"
    boat = engaged_bench(method, gap, reengage=True, log=log)
    reboot(boat, gap, silence)
    boat.run(silence + 8.0)
    assert boat.tick.mode in (Mode.OVERRIDE, Mode.FAILSAFE)
    assert any("disarmed; arm it" in alarm for alarm in words_of(boat.tick)), words_of(boat.tick)
    assert boat.firmware.set_armed(True)
    assert boat.run(9.0, until=boat.engaged)
    boat.run(12.0)
    assert boat.tick.mode is Mode.ENGAGED
    assert words_of(boat.tick) == ()
    assert math.degrees(boat.world.boat.state.heading) == pytest.approx(40.0, abs=2.0)
    boat.session.close()
    replayed = replay(log)
    assert (replayed.ticks, replayed.identical) == (len(boat.ticks), True), replayed.detail


def test_a_human_s_override_is_no_reboot_though_one_follows() -> None:
    gap = Gap()
    boat = engaged_bench("rc_override", gap, reengage=True)
    boat.firmware.set_mode(4)
    assert boat.run(2.0, until=lambda tick: tick.mode is Mode.OVERRIDE)
    reboot(boat, gap, 0.0)
    boat.run(5.0)
    boat.firmware.set_armed(True)
    boat.run(8.0)
    assert boat.link.session._reason == CHECKED_ON_ENGAGING, "the helm is free again"
    assert boat.tick.mode is Mode.OVERRIDE


def test_standing_by_ends_the_wish_to_engage_again() -> None:
    gap = Gap()
    boat = engaged_bench("rc_override", gap, reengage=True)
    reboot(boat, gap, 0.0)
    boat.run(3.0)
    boat.order = Order(serial=8)
    boat.run(1.0)
    boat.firmware.set_armed(True)
    boat.run(6.0)
    assert boat.tick.mode is Mode.STANDBY


def test_whoever_arms_only_long_after_engages_by_hand(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(supervisor, "REENGAGE_WITHIN", 10.0)
    gap = Gap()
    boat = engaged_bench("rc_override", gap, reengage=True)
    reboot(boat, gap, 0.0)
    boat.run(12.0)
    boat.firmware.set_armed(True)
    boat.run(6.0)
    assert boat.tick.mode is Mode.OVERRIDE


@pytest.mark.parametrize("silence", [6.0, 15.0])
def test_a_lost_line_is_no_reboot(silence: float) -> None:
    gap = Gap()
    boat = engaged_bench("rc_override", gap, reengage=True)
    gap.until = boat.now + silence
    boat.run(silence + 8.0)
    assert boat.link.session._reason == CHECKED_ON_ENGAGING
    assert boat.tick.mode is Mode.OVERRIDE


@pytest.mark.parametrize("method", METHODS)
def test_nothing_is_asked_or_ordered_before_the_firmware_is_up(method: str) -> None:
    boat = bench(method, boot_s=4.0, position_after_s=0.0)
    heard: list[tuple[float, str]] = []
    receive, reader = boat.vehicle.receive, MavlinkCodec()

    def listen(now: float, data: bytes) -> None:
        heard.extend((now, message.get_type()) for message in reader.decode(data))
        receive(now, data)

    boat.vehicle.receive = listen  # type: ignore[method-assign]
    boat.engage(20.0)
    boat.run(15.0)
    early = {kind for time, kind in heard if time < 4.0}
    assert "HEARTBEAT" in early
    assert early <= {"HEARTBEAT", "STATUSTEXT"}, "texts are for ground stations"
    assert {"COMMAND_LONG", "PARAM_REQUEST_READ"} <= {kind for _, kind in heard}
    assert boat.tick.mode is Mode.ENGAGED, words_of(boat.tick)


def test_heading_is_held_long_before_there_is_a_position() -> None:
    boat = bench("rc_override", boot_s=2.0, position_after_s=40.0)
    boat.engage(20.0)
    assert boat.run(8.0, until=boat.engaged)
    boat.run(12.0)
    assert math.degrees(boat.world.boat.state.heading) == pytest.approx(20.0, abs=2.0)
    assert not boat.firmware.has_position(boat.now)


@pytest.mark.parametrize(("method", "switch", "wanted"), [("guided", "MANUAL", 15), ("rc_override", "HOLD", 0)])
def test_a_mode_that_the_radio_s_switch_overwrites_after_the_start_is_not_believed(
    method: str, switch: str, wanted: int
) -> None:
    """Somebody sets the right mode as soon as the firmware answers; a moment later the mode switch is read."""
    boat = bench(method, boot_s=2.0, position_after_s=0.0, mode=switch, armed=False)
    boat.engage(20.0)
    boat.run(2.1)
    assert boat.firmware.set_mode(wanted)
    assert boat.firmware.set_armed(True)
    boat.run(8.0)
    assert boat.tick.mode is not Mode.ENGAGED
    assert f"the vehicle is in mode {switch}" in words_of(boat.tick)[0]
    assert boat.firmware.set_mode(wanted)
    boat.engage(20.0)
    assert boat.run(9.0, until=boat.engaged), "set once more, now that it is armed"


def test_the_mode_counts_as_it_is_after_arming() -> None:
    """Disarmed the mode was right; arming came with a change of it."""
    boat = bench("rc_override", armed=False)
    boat.engage(20.0)
    boat.run(4.0)
    assert words_of(boat.tick) == ("not engaged: the vehicle is disarmed; arm it",)
    boat.firmware.set_mode(4)
    boat.firmware.set_armed(True)
    boat.run(4.0)
    assert boat.tick.mode is Mode.STANDBY
    assert "mode HOLD" in words_of(boat.tick)[0]


def test_a_forced_reboot_is_carried_out_though_armed() -> None:
    boat = bench("rc_override")
    boat.run(1.0)
    sender = MavlinkCodec(255, 190)
    for forced, reboots in ((0.0, False), (20190226.0, True)):
        command = dialect.MAVLink_command_long_message(
            1, 1, dialect.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, 0, 1, 0, 0, 0, 0, forced, 0
        )
        boat.vehicle.receive(boat.now, sender.encode(command))
        boat.run(0.2)
        assert (boat.firmware.time_since_boot(boat.now) < 0.5) is reboots
