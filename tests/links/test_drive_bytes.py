"""Each drive's protocol to the byte, the bit and the tenth of a second, against numbers worked out by hand."""

from __future__ import annotations

import math
import struct

import pytest
from alarm_texts import words as shown

from autopilot.links.base import LinkError
from autopilot.links.drives import DriveLink, DriveLinkSettings, DriveSettings, JumpGate, StallWatch
from autopilot.links.drives.jrk import JrkG2
from autopilot.links.drives.maestro import Maestro
from autopilot.links.drives.pypilot_motor import PypilotMotor, packet
from autopilot.links.rudder_order import Release, ReleaseState
from autopilot.links.transports import loopback_pair
from autopilot.signals import AlarmSample, HelmSample, RudderCommand, RudderSample

FULL = math.radians(40.0)
SETTINGS = DriveSettings(angle_at_full=FULL, stop=math.radians(35.0), rate=math.radians(20.0))
SENSOR_MIDDLE, SENSOR_PER_DEG = 32736, 32736 / 40.0


def motion(target: int = 2048, feedback: int = 2048, scaled: int = 2048, duty_target: int = 0, duty: int = 0) -> bytes:
    return struct.pack("<HHHhhh", target, feedback, scaled, 0, duty_target, duty)


def health(halting: int = 0, occurred: int = 0, force: int = 0, supply_mv: int = 12600, current_ma: int = 0) -> bytes:
    return struct.pack("<HHBHH", halting, occurred, force, supply_mv, current_ma)


class Asked:
    """A Jrk or Maestro that is asked once a second, and answered a tenth of a second later."""

    def __init__(self, drive: JrkG2 | Maestro, asking: dict[str, bytes]) -> None:
        self.drive, self._asking = drive, asking
        self.now = 0.0
        self.is_refused = False

    def answers(self, kind: str, answer: bytes) -> list[float]:
        """Ask until `kind` is what is asked for, and answer it."""
        for _ in range(16):
            self.now += 1.0
            if self.drive.ask(self.now) == self._asking[kind]:
                before = self.drive.rejected
                angles = self.drive.feed(self.now + 0.1, answer)
                self.is_refused = self.drive.rejected > before
                return angles
        raise AssertionError(f"{kind} is never asked for")

    def believes(self, kind: str, answer: bytes) -> bool:
        """Return whether an answer counts as heard."""
        self.answers(kind, answer)
        return not self.is_refused


GOOD = {"motion": motion(), "health": health(), "position": struct.pack("<H", 6000), "errors": b"\0\0"}


def jrk(settings: DriveSettings = SETTINGS) -> Asked:
    return Asked(JrkG2(settings), {"motion": b"\xe5\x02\x0c", "health": b"\xe5\x12\x09"})


def maestro(settings: DriveSettings = SETTINGS) -> Asked:
    return Asked(Maestro(settings), {"position": bytes((0x90, settings.channel)), "errors": b"\xa1"})


# what all share


def test_a_stall_is_a_current_above_the_limit_for_a_second_said_once_with_one_figure() -> None:
    watch = StallWatch(8.0)
    watch.take(0.0, 8.0)
    assert watch.warning(5.0) is None, "at the limit is not above it"
    watch.take(10.0, 8.5)
    watch.take(10.5, 9.0)
    assert watch.warning(10.9) is None
    said = shown(watch.warning(11.0))
    assert said == (
        "the rudder motor draws 9.0 A, more than drive.current_max_a (8): look whether the rudder is jammed"
    )
    watch.take(11.5, 12.0)
    assert shown(watch.warning(12.0)) == said
    assert watch.current == 12.0
    watch.take(12.5, 7.9)
    assert watch.warning(12.5) is None
    watch.take(20.0, 9.0)
    assert watch.warning(20.5) is None, "counted anew"
    unlimited = StallWatch(None)
    unlimited.take(0.0, 500.0)
    assert unlimited.warning(100.0) is None


def test_two_degrees_and_what_the_gear_can_move_pass_to_the_bit() -> None:
    gate = JumpGate(DriveSettings(angle_at_full=1.0, rate=math.radians(10.0)))
    assert gate.passes(0.0, 0.0) and gate.passes(0.0, math.radians(2.0))
    assert not gate.passes(0.0, math.radians(4.0001))


def test_a_gate_forgets_what_was_strange_and_does_not_count_backwards() -> None:
    gate = JumpGate(DriveSettings(angle_at_full=1.0, rate=math.radians(10.0)))
    assert gate.passes(0.0, 0.0)
    assert not gate.passes(0.0, 1.0)
    assert gate.passes(0.1, 0.0)
    assert not gate.passes(0.1, 1.0), "the strange one before was forgotten"
    assert gate.passes(0.1, 1.0)
    assert gate.passes(0.0, 1.0 - math.radians(1.9)), "a clock that goes back leaves two degrees"
    assert not gate.passes(-9.0, 1.0 - math.radians(4.1))


# Jrk


def test_a_jrk_is_asked_for_motion_three_times_and_then_for_its_health() -> None:
    drive = JrkG2(SETTINGS)
    assert [drive.ask(float(second)).hex() for second in range(1, 9)] == 2 * (3 * ["e5020c"] + ["e51209"])
    addressed = JrkG2(SETTINGS._replace(device=11))
    assert addressed.ask(0.0) == bytes((0xAA, 11, 0x65, 0x02, 12))
    assert addressed.order(0.0, 0.0) == bytes((0xAA, 11, 0x40, 64))


def test_a_jrk_is_asked_again_when_it_has_answered_or_is_overdue() -> None:
    drive = JrkG2(SETTINGS)
    assert drive.ask(0.0)
    assert drive.ask(0.34) == b"", "its answer may still come"
    assert drive.rejected == 0
    assert drive.ask(0.36)
    assert drive.rejected == 1
    assert drive.feed(0.66 - 0.001, motion()) == [0.0], "0.3 s after the request"
    assert drive.ask(0.66), "answered: at once again"
    assert drive.feed(0.961, motion()) == []
    assert drive.rejected == 2
    assert drive.feed(0.962, b"") == [] and drive.rejected == 2, "nothing is not an answer"
    late = JrkG2(SETTINGS)
    assert late.ask(0.0)
    assert late.ask(0.35) == b"" and late.feed(0.3, motion()) == [0.0], "both to the bit"


def test_a_jrk_answer_may_come_in_pieces() -> None:
    drive = JrkG2(SETTINGS)
    assert drive.feed(0.0, motion()) == [] and drive.rejected == 1, "not asked for"
    drive.ask(1.0)
    assert drive.feed(1.1, motion()[:11]) == []
    assert drive.feed(1.2, motion()[11:]) == [0.0]
    drive.ask(2.0)
    drive.feed(2.1, motion()[:5])
    drive.ask(3.0)
    assert drive.feed(3.1, motion()) == [0.0], "the five bytes before are gone"
    assert drive.rejected == 2


@pytest.mark.parametrize(("scaled", "deg"), [(2048, 0.0), (4095, 40.0), (1, -40.0), (0, -40.0 * 2048 / 2047)])
def test_the_angle_of_a_jrk_is_its_scaled_feedback(scaled: int, deg: float) -> None:
    assert jrk().answers("motion", motion(100, 200, scaled)) == [pytest.approx(math.radians(deg), abs=1e-12)]
    mirrored = jrk(SETTINGS._replace(reversed=True))
    assert mirrored.answers("motion", motion(100, 200, scaled)) == [pytest.approx(-math.radians(deg), abs=1e-12)]


@pytest.mark.parametrize(
    ("answer", "is_possible"),
    [
        (motion(4095, 4095), True),
        (motion(4096), False),
        (motion(feedback=4096), False),
        (motion(scaled=4096), False),
        (motion(duty=600), True),
        (motion(duty=-600), True),
        (motion(duty=601), False),
        (motion(duty=-601), False),
        (motion(duty_target=700), True),
    ],
)
def test_a_jrk_motion_is_believed_when_every_value_is_possible(answer: bytes, is_possible: bool) -> None:
    assert jrk().believes("motion", answer) is is_possible


@pytest.mark.parametrize(
    ("answer", "is_possible"),
    [
        (health(halting=0x3FFF), True),
        (health(halting=0x4000), False),
        (health(occurred=0x3FFF), True),
        (health(occurred=0x4000), False),
        (health(force=2), True),
        (health(force=3), False),
        (health(force=4), True),
        (health(supply_mv=60000), True),
        (health(supply_mv=60001), False),
    ],
)
def test_a_jrk_health_is_believed_when_every_value_is_possible(answer: bytes, is_possible: bool) -> None:
    assert jrk().believes("health", answer) is is_possible


def test_a_jrk_shows_one_of_the_last_sixteen_targets() -> None:
    bench = jrk()
    for step in range(17):
        for _ in range(2):  # the same again takes no room
            bench.drive.order(0.0, math.radians(2.0 * step - 16.0))
    # 16, 14 and 0 of 40 degrees
    first, second, last = 2048 - 819, 2048 - 716, 2048 + 819
    for target, is_ours in ((first, False), (second, True), (last, True), (2048, True), (2049, False)):
        assert bench.believes("motion", motion(target)) is is_ours


def test_a_jrk_reports_supply_and_current_in_thousandths() -> None:
    bench = jrk(SETTINGS._replace(current_max=8.0))
    bench.answers("health", health(supply_mv=12600, current_ma=8001))
    drive = bench.drive
    assert isinstance(drive, JrkG2)
    assert drive.supply == 12.6
    assert drive.warning(bench.now + 1.0) is None
    assert "draws 8.0 A, more than" in shown(drive.warning(bench.now + 1.2))
    bench.answers("health", health(current_ma=8000))
    assert drive.warning(bench.now + 9.0) is None


def test_a_jrk_that_jumps_is_believed_the_second_time() -> None:
    bench = jrk()
    assert bench.answers("motion", motion()) == [0.0]
    far = 2048 + 2047
    bench.now -= 0.9  # a tenth of a second on
    assert bench.answers("motion", motion(scaled=far)) == []
    assert bench.is_refused
    bench.now -= 0.9
    assert bench.answers("motion", motion(scaled=far)) == [pytest.approx(FULL)]


@pytest.mark.parametrize(
    ("bit", "words"),
    list(
        enumerate(
            [
                "",
                "it has no motor power; switch it on",
                "its motor driver reports an error",
                "its input is invalid",
                "its input is disconnected",
                "its feedback is disconnected",
                "its motor drew too much current",
                "the serial line is noisy",
                "its serial buffer overran",
                "its serial buffer was full",
                "commands came without the checksum",
                "it received commands it does not know; check drive.device",
                "it heard no command in time",
                "its motor drew far too much current",
            ]
        )
    ),
)
def test_each_error_of_a_jrk_has_its_sentence_a_while_after_the_first_order(bit: int, words: str) -> None:
    bench = jrk()
    stopped = "the Jrk motor controller has stopped: "
    bench.answers("health", health(halting=1 << bit))
    heard = bench.now + 0.1
    assert bench.drive.fault(heard) == "", "nothing was ordered"
    bench.drive.order(heard - 1.4, 0.0)
    assert bench.drive.fault(heard + 0.05) == "", "it may be older than our order"
    said = bench.drive.fault(heard + 0.2)
    assert said.startswith(stopped + words) if words else said == ""
    bench.drive.order(heard + 0.19, 0.0)
    assert bench.drive.fault(heard + 0.2) == said, "the first order counts"
    bench.drive.release(heard + 0.2)
    assert bench.drive.fault(heard + 0.2) == ""


def test_of_several_errors_of_a_jrk_the_lowest_is_said() -> None:
    bench = jrk()
    bench.drive.order(0.0, 0.0)
    bench.answers("health", health(halting=0x0023))
    assert "has no motor power" in bench.drive.fault(bench.now + 1.0)


@pytest.mark.parametrize("make", [jrk, maestro])
def test_an_asked_drive_is_silent_after_a_second_and_a_half(make: object) -> None:
    assert callable(make)
    bench: Asked = make()
    assert "does not answer; check its power, line, baud rate and drive.device" in bench.drive.fault(0.0)
    for kind in bench._asking:
        bench.answers(kind, GOOD[kind])
        heard = bench.now + 0.1
        assert bench.drive.fault(heard + 1.49) == ""
        assert "does not answer; check its power" in bench.drive.fault(heard + 1.51)


# Maestro


@pytest.mark.parametrize(
    ("deg", "quarters"), [(0.0, 6000), (35.0, 7750), (-35.0, 4250), (50.0, 7750), (10.0, 6500), (-20.0, 5000)]
)
def test_a_maestro_pulse_is_in_quarters_of_a_microsecond(deg: float, quarters: int) -> None:
    settings = SETTINGS._replace(channel=5)
    order = Maestro(settings).order(0.0, math.radians(deg))
    assert order == bytes((0x84, 5, quarters & 127, quarters >> 7))
    mirrored = Maestro(settings._replace(reversed=True)).order(0.0, -math.radians(deg))
    assert mirrored == order
    bench = maestro(settings)
    bench.drive.order(0.0, math.radians(deg))
    held = min(max(deg, -35.0), 35.0)
    assert bench.answers("position", struct.pack("<H", quarters)) == [pytest.approx(math.radians(held), abs=1e-12)]


@pytest.mark.parametrize(("later", "is_silent"), [(1.5, False), (1.501, True)])
def test_an_asked_drive_is_silent_after_more_than_a_second_and_a_half(later: float, is_silent: bool) -> None:
    for drive, answer in ((JrkG2(SETTINGS), motion()), (Maestro(SETTINGS), b"\x70\x17")):
        drive.ask(0.0)
        drive.feed(0.0, answer)
        assert ("does not answer" in drive.fault(later)) is is_silent


def test_a_maestro_is_addressed_in_the_pololu_protocol() -> None:
    drive = Maestro(SETTINGS._replace(channel=5, device=12))
    assert [drive.ask(float(second)).hex() for second in range(1, 9)] == 7 * ["aa0c1005"] + ["aa0c21"]
    assert drive.release(0.0) == bytes((0xAA, 12, 0x04, 5, 0, 0))


def test_a_maestro_is_asked_again_when_it_has_answered_or_is_overdue() -> None:
    drive = Maestro(SETTINGS)
    assert drive.feed(0.0, b"\0\0") == [] and drive.rejected == 1, "not asked for"
    assert drive.ask(0.0)
    assert drive.ask(0.34) == b"" and drive.rejected == 1
    assert drive.ask(0.36) and drive.rejected == 2
    assert drive.feed(0.5, b"\x70") == []
    drive.feed(0.659, b"\x17")
    assert drive.rejected == 2
    assert drive.fault(2.1) == "", "heard in two pieces, 0.3 s after the request"
    assert drive.ask(0.66)
    drive.feed(0.97, b"\x70\x17")
    assert drive.rejected == 3, "too late"
    assert drive.feed(0.98, b"") == [] and drive.rejected == 3
    drive.ask(2.0)
    assert drive.rejected == 4, "never answered"
    drive.feed(2.1, b"\x70\x17\x00")
    assert drive.rejected == 5, "too long"
    drive.ask(3.0)
    drive.feed(3.1, b"\x70")
    drive.ask(4.0)
    drive.feed(4.1, b"\x70\x17")
    assert drive.rejected == 6, "the one that was not answered whole"
    assert drive.fault(5.6) == "", "and the byte of it was dropped"
    late = Maestro(SETTINGS)
    assert late.ask(0.0) and late.ask(0.35) == b""
    late.feed(0.3, b"\x70\x17")
    assert late.rejected == 0, "both to the bit"


@pytest.mark.parametrize(
    ("value", "is_possible"), [(0, True), (255, False), (256, True), (16383, True), (16384, False)]
)
def test_a_free_maestro_may_give_any_pulse_or_none(value: int, is_possible: bool) -> None:
    bench = maestro()
    assert bench.believes("position", struct.pack("<H", value)) is is_possible
    assert bench.answers("position", struct.pack("<H", 6000)) == [], "not ours: it says nothing of the rudder"


@pytest.mark.parametrize(
    ("value", "is_possible"), [(0, True), (5999, False), (6000, True), (6250, True), (6500, True), (6501, False)]
)
def test_a_steering_maestro_is_between_its_targets(value: int, is_possible: bool) -> None:
    bench = maestro()
    bench.drive.order(0.0, 0.0)
    bench.drive.order(0.0, math.radians(10.0))
    assert bench.believes("position", struct.pack("<H", value)) is is_possible


def test_a_maestro_on_its_way_is_where_it_was_seen_last() -> None:
    bench = maestro()
    bench.drive.order(0.0, math.radians(10.0))
    assert bench.answers("position", struct.pack("<H", 0)) == [], "the pulses have not begun"
    bench.drive.release(0.0)
    bench.answers("position", struct.pack("<H", 5000))
    bench.drive.order(0.0, math.radians(10.0))
    assert bench.answers("position", struct.pack("<H", 4999)) == []
    assert bench.answers("position", struct.pack("<H", 5500)) == [pytest.approx(math.radians(-10.0))]
    assert bench.answers("position", struct.pack("<H", 5400)) == [], "it does not go back"


def test_a_maestro_keeps_sixty_four_targets() -> None:
    bench = maestro()
    bench.answers("position", struct.pack("<H", 6000))
    bench.drive.order(0.0, math.radians(-10.0))
    for _ in range(63):
        bench.drive.order(0.0, 0.0)
    assert bench.answers("position", struct.pack("<H", 5500)) == [pytest.approx(math.radians(-10.0))]
    bench.answers("position", struct.pack("<H", 6000))
    bench.drive.order(0.0, 0.0)
    assert bench.answers("position", struct.pack("<H", 5500)) == []


@pytest.mark.parametrize(
    ("bit", "words"),
    list(
        enumerate(
            [
                "the serial line is noisy",
                "its serial buffer overran",
                "its serial buffer was full",
                "commands came without the checksum",
                "it received commands it does not know; check drive.device and drive.channel",
                "it heard no command in time",
                "its script ran over its stack",
                "its script called too deep",
                "its script left its memory",
            ]
        )
    ),
)
def test_each_error_of_a_maestro_has_its_sentence_until_it_is_gone(bit: int, words: str) -> None:
    bench = maestro()
    bench.drive.order(0.0, 0.0)
    assert bench.answers("errors", struct.pack("<H", 1 << bit)) == []
    assert shown(bench.drive.warning(bench.now)).startswith(f"Maestro servo controller: {words}")
    bench.answers("errors", struct.pack("<H", 0b110000000))
    assert "its script called too deep" in shown(bench.drive.warning(bench.now)), "the lowest"
    bench.answers("errors", b"\0\0")
    assert bench.drive.warning(bench.now) is None
    assert bench.believes("errors", struct.pack("<H", 0x1FF))
    assert not bench.believes("errors", struct.pack("<H", 0x200))


def test_a_maestro_has_released_when_it_gives_no_pulse_and_not_before() -> None:
    bench = maestro()
    assert not bench.drive.has_released()
    bench.drive.order(0.0, 0.0)
    bench.answers("position", b"\0\0")
    assert not bench.drive.has_released(), "it is ordered"
    bench.drive.release(0.0)
    assert not bench.drive.has_released()
    bench.answers("errors", b"\0\0")
    assert not bench.drive.has_released(), "that is no pulse"
    bench.answers("position", struct.pack("<H", 6000))
    assert not bench.drive.has_released()
    bench.answers("position", b"\0\0")
    assert bench.drive.has_released()
    bench.drive.release(0.0)
    assert not bench.drive.has_released(), "since then nothing was heard"


# pypilot


def listening(settings: DriveSettings = SETTINGS) -> PypilotMotor:
    """Return a controller's host that is in step with it."""
    motor = PypilotMotor(settings)
    motor.feed(-100.0, packet(0xB3, 1260) * 2)
    return motor


def sensor(deg: float) -> bytes:
    """Return a rudder report; starboard positive, and a rising reading is to port."""
    return packet(0xA7, round(SENSOR_MIDDLE - deg * SENSOR_PER_DEG))


@pytest.mark.parametrize("code", [0x1C, 0xB3, 0xF9, 0x48, 0xA7, 0x8F, 0x9A])
def test_each_report_of_the_pypilot_controller_is_heard_from_the_third_in_a_row(code: int) -> None:
    motor = PypilotMotor(SETTINGS)
    for _ in range(2):
        motor.feed(0.0, packet(code, 0))
        assert "does not answer; check its power, line and baud rate" in motor.fault(0.0)
    motor.feed(0.0, packet(code, 0))
    assert "does not answer" not in motor.fault(1.5)
    assert "does not answer" in motor.fault(1.51)
    assert motor.rejected == 0
    motor.feed(0.1, packet(0x1D, 0))
    motor.feed(0.1, packet(code, 0))
    assert motor.rejected == 4, "no report of it: every byte is tried as a beginning"


def test_a_wrong_checksum_begins_the_count_anew() -> None:
    motor = listening()
    assert motor.feed(0.0, sensor(0.0)) == [0.0]
    wrong = bytearray(sensor(0.0))
    wrong[3] ^= 1
    assert motor.feed(0.1, bytes(wrong)) == []
    assert motor.rejected == 1, "the first byte; the others may be a beginning"
    assert [len(motor.feed(0.2, sensor(0.0))) for _ in range(3)] == [0, 0, 1]
    assert motor.rejected == 4
    first = sensor(0.0)
    assert motor.feed(0.3, first[:3]) == []
    assert motor.feed(0.4, first[3:] + sensor(0.0)) == [0.0, 0.0], "cut in two"


@pytest.mark.parametrize(("raw", "deg"), [(0, 40.0), (65472, -40.0), (32736, 0.0), (16368, 20.0), (49104, -20.0)])
def test_a_rising_reading_is_a_rudder_going_to_port(raw: int, deg: float) -> None:
    assert listening().feed(0.0, packet(0xA7, raw)) == [pytest.approx(math.radians(deg), abs=1e-12)]
    mirrored = listening(SETTINGS._replace(reversed=True))
    assert mirrored.feed(0.0, packet(0xA7, raw)) == [pytest.approx(-math.radians(deg), abs=1e-12)]


def test_a_reading_beyond_the_scale_is_none_and_65535_is_no_sensor() -> None:
    motor = listening()
    motor.feed(0.0, sensor(0.0))
    assert motor.feed(0.1, packet(0xA7, 65473)) == []
    assert motor.feed(0.1, packet(0xA7, 65534)) == []
    assert motor.fault(0.1) == "", "passed over"
    assert motor.feed(0.1, packet(0xA7, 65535)) == []
    assert "reports no rudder angle" in motor.fault(0.1)
    assert motor.order(0.1, 0.5)[-4:] == packet(0xC7, 1000), "nothing to position the rudder by"


def test_a_rudder_angle_older_than_a_second_and_a_half_is_a_fault() -> None:
    motor = listening()
    motor.feed(0.0, sensor(0.0))
    motor.feed(1.5, packet(0xB3, 1260))
    assert motor.fault(1.5) == ""
    assert motor.order(1.5, 0.5)[-4:] != packet(0xC7, 1000)
    assert "reports no rudder angle; it cannot be steered without" in motor.fault(1.51)
    assert motor.order(1.51, 0.5)[-4:] == packet(0xC7, 1000)


@pytest.mark.parametrize(
    ("order_deg", "speed"),
    [
        (0.39, 1000),  # inside the dead band
        (0.4, 1000 - 235),  # the slowest that moves: 100 + 0.15 * 900
        (1.2, 1000 - 235),
        (2.0, 1000 - 325),  # a quarter of 8 degrees, which 20 deg/s takes 0.4 s for
        (4.0, 1000 - 550),
        (8.0, 0),
        (30.0, 0),
    ],
)
def test_the_motor_slows_down_before_the_rudder_is_there(order_deg: float, speed: int) -> None:
    for side in (1.0, -1.0):
        for is_reversed in (False, True):
            motor = listening(SETTINGS._replace(reversed=is_reversed))
            motor.feed(0.0, sensor(0.0))
            signed = side * (-1.0 if is_reversed else 1.0)
            assert motor.order(0.0, side * math.radians(order_deg))[-4:] == packet(
                0xC7, round(1000 + signed * (speed - 1000))
            )


def test_the_motor_stops_at_the_end_stop_and_uses_the_scale_without_a_rate() -> None:
    for side in (1.0, -1.0):
        motor = listening()
        motor.feed(0.0, sensor(side * 33.0))
        motor.feed(0.0, sensor(side * 33.0))
        # two degrees are left to the stop at 35
        assert motor.order(0.0, side * 1.5)[-4:] == packet(0xC7, round(1000 - side * 325))
    unknown = listening(DriveSettings(angle_at_full=FULL))
    unknown.feed(0.0, sensor(0.0))
    # 40 degrees a second: 16 degrees take 0.4 s
    assert unknown.order(0.0, math.radians(8.0))[-4:] == packet(0xC7, 1000 - 550)


def test_the_controller_is_reset_at_engaging_and_given_its_end_stops_and_its_current() -> None:
    settings = SETTINGS._replace(current_max=8.0)
    neutral, reset = packet(0xC7, 1000), packet(0xE7, 0)
    # 35 of 40 degrees: 0.0625 and 0.9375 of 65472
    limits = packet(0x2B, 4092) + packet(0x4D, 61380)
    motor = PypilotMotor(settings)
    assert motor.order(0.0, 0.0) == reset + limits + packet(0x1E, 800) + neutral
    assert motor.order(0.0, 0.0) == neutral
    assert motor.release(0.0) == packet(0x68, 0)
    assert motor.order(0.0, 0.0) == reset + limits + packet(0x1E, 800) + neutral
    shifted = SETTINGS._replace(amidships=0.1)
    # -0.775 and 0.975 of the scale
    limits = packet(0x2B, 7366) + packet(0x4D, 64654)
    for is_reversed in (False, True):
        assert PypilotMotor(shifted._replace(reversed=is_reversed)).order(0.0, 0.0) == reset + limits + neutral


def test_a_controller_that_is_not_steering_is_spoken_to_by_a_disengage() -> None:
    motor = PypilotMotor(SETTINGS)
    assert motor.ask(0.0) == packet(0x68, 0)
    motor.order(0.0, 0.0)
    assert motor.ask(0.0) == b""
    motor.release(0.0)
    assert motor.ask(0.0) == packet(0x68, 0)


@pytest.mark.parametrize(
    ("flags", "words"),
    [
        (0x0002, "it is too hot; let it cool"),
        (0x0004, "its motor drew too much current; look whether the rudder is jammed"),
        (0x0080, "its supply voltage is out of range; check battery and wiring"),
    ],
)
def test_a_flag_of_the_pypilot_controller_is_a_fault_while_it_steers(flags: int, words: str) -> None:
    motor = listening()
    motor.feed(0.0, sensor(0.0) + packet(0x8F, flags | 0x0008))
    assert motor.fault(0.0) == ""
    motor.order(0.0, 0.0)
    assert motor.fault(0.0) == f"the pypilot motor controller has stopped: {words}"
    assert motor.warning(0.0) is None
    motor.feed(0.1, packet(0x8F, 0xFFFF & ~(0x0002 | 0x0004 | 0x0080)))
    assert motor.fault(0.1) == ""


@pytest.mark.parametrize(
    ("flags", "words"),
    [
        (0x0020, "the port limit switch is pressed"),
        (0x0040, "the starboard limit switch is pressed"),
        (0x0100, "the rudder sensor is at the low end stop"),
        (0x0200, "the rudder sensor is at the high end stop"),
    ],
)
def test_a_stop_of_the_pypilot_controller_is_a_warning(flags: int, words: str) -> None:
    motor = listening()
    motor.feed(0.0, packet(0x8F, flags))
    assert shown(motor.warning(0.0)) == f"pypilot motor controller: {words}"
    motor.feed(0.0, packet(0x8F, 0xFFFF & ~(0x0020 | 0x0040 | 0x0100 | 0x0200)))
    assert motor.warning(0.0) is None


def test_the_pypilot_controller_reports_volts_and_amperes_in_hundredths() -> None:
    motor = listening(SETTINGS._replace(current_max=8.0))
    motor.feed(0.0, packet(0xB3, 1260) + packet(0x1C, 801))
    assert motor.voltage == 12.6
    assert motor.warning(0.9) is None
    assert "draws 8.0 A, more than drive.current_max_a (8)" in shown(motor.warning(1.0))
    motor.feed(1.1, packet(0x1C, 800))
    assert motor.warning(3.0) is None


def test_the_pypilot_controller_has_released_when_its_clutch_opens_and_not_before() -> None:
    motor = listening()
    motor.order(0.0, 0.0)
    motor.feed(0.0, packet(0x8F, 0x0000))
    assert not motor.has_released(), "it is ordered"
    motor.release(0.0)
    assert not motor.has_released()
    motor.feed(0.1, packet(0x8F, 0x0008))
    assert not motor.has_released()
    motor.feed(0.2, packet(0x8F, 0xFFF7))
    assert motor.has_released()
    motor.release(0.3)
    assert not motor.has_released(), "since then nothing was heard"


# the link


def test_a_drive_link_sends_orders_at_its_rate_and_asks_when_the_line_is_free() -> None:
    near, far = loopback_pair()
    link = DriveLink(near, JrkG2(SETTINGS), DriveLinkSettings(baud=1280, rate=8.0))
    sent: list[tuple[int, str]] = []
    for turn in range(64):
        now = turn / 128.0
        link.send(now, RudderCommand(now, 0.0, True))
        link.poll(now)
        sent += [(turn, data.hex()) for data in far.receive()]
    # ten bits a byte: an order of two bytes takes 2/128 s, a request of three 3/128 s; an answer is waited for 0.35 s
    assert [turn for turn, data in sent if data == "c040"] == [0, 16, 32, 50]
    assert [turn for turn, data in sent if data == "e5020c"] == [2, 47]


def test_a_drive_link_keeps_to_38400_baud_and_twenty_orders_a_second_unless_set() -> None:
    assert DriveLinkSettings()[:2] == (38400, 20.0)


def test_a_release_is_said_five_times_and_those_the_line_did_not_take_again() -> None:
    near, far = loopback_pair()
    link = DriveLink(near, JrkG2(SETTINGS))
    link.send(0.0, RudderCommand(0.0, 0.0, True))
    taken = near.send
    said = []
    for turn in range(1, 256):
        now = turn / 128.0
        near.send = taken if not 20 <= turn <= 60 else lambda data: False  # type: ignore[method-assign]
        link.send(now, RudderCommand(now, 0.0, False))
        link.poll(now)
        said += [turn for data in far.receive() if data == b"\xff"]
    # every tenth of a second, 12.8 turns; what was due while the line was full is said when it is not
    assert len(said) == 5 and said[:2] == [1, 14] and said[2] > 60


@pytest.mark.parametrize("kind", [JrkG2, Maestro, PypilotMotor])
def test_of_a_drive_that_was_never_heard_nothing_is_known(kind: type[JrkG2 | Maestro | PypilotMotor]) -> None:
    drive = kind(SETTINGS)
    assert (drive.has_released(), drive.rejected, drive.warning(0.0)) == (False, 0, None)
    assert [getattr(drive, name, 0) for name in ("errors", "flags", "supply", "voltage")] == [0, 0, 0, 0]


def test_a_drive_link_says_what_it_sees_once() -> None:
    near, far = loopback_pair()
    link = DriveLink(near, PypilotMotor(SETTINGS._replace(current_max=1.0)))
    name = "pypilot motor controller"
    assert link.receive(0.0) == [HelmSample(0.0, False, f"waiting for the {name} to answer", "loopback:a")]
    assert link.receive(0.1) == []
    far.send(2 * packet(0xB3, 1260) + sensor(0.0) + packet(0x1C, 200))
    assert link.receive(1.0) == [RudderSample(1.0, 0.0, False, name), HelmSample(1.0, True, "", "loopback:a")]
    far.send(sensor(0.0))
    (seen, alarm) = link.receive(2.0)
    assert isinstance(seen, RudderSample) and isinstance(alarm, AlarmSample)
    assert (alarm.time, alarm.source) == (2.0, "loopback:a") and "draws 2.0 A" in shown(alarm.event)
    far.send(packet(0x1C, 100))
    assert link.receive(2.1) == [AlarmSample(2.1, None, "loopback:a")]
    assert (link.fileno(), link.take_packets()) == (-1, [])


@pytest.mark.parametrize("kind", [JrkG2, Maestro, PypilotMotor])
def test_a_drive_that_was_just_spoken_to_may_yet_answer(kind: type[JrkG2 | Maestro | PypilotMotor]) -> None:
    link = DriveLink(loopback_pair()[0], kind(SETTINGS))
    (first,) = link.receive(7.0)
    assert isinstance(first, HelmSample) and first.reason == f"waiting for the {kind.name} to answer"
    assert not first.available and link.receive(8.5) == []
    (silent,) = link.receive(8.51)
    assert isinstance(silent, HelmSample) and "does not answer; check its power" in silent.reason


def test_a_release_of_a_drive_is_reported_unconfirmed_or_lost() -> None:
    near, far = loopback_pair()
    link = DriveLink(near, JrkG2(SETTINGS))
    link.send(0.0, RudderCommand(0.0, 0.1, False))
    link.release(0.0)
    assert link.release_result(9.0) == Release("loopback:a", ReleaseState.NOT_HELD)
    link.send(10.0, RudderCommand(10.0, 0.1, True))
    far.receive()
    link.release(10.0)
    assert far.receive() == 5 * [b"\xff"]
    assert link.release_result(10.1) is None
    assert far.receive() == [b"\xe5\x02\x0c"], "asked meanwhile"
    assert link.release_result(10.2) is None
    assert far.receive() == [], "until it answers"
    assert link.release_result(11.0) is None
    lapse = "it holds the last target, or lets go after the serial timeout in its settings"
    gone = link.release_result(11.25)
    assert gone == Release("loopback:a", ReleaseState.UNCONFIRMED, waited=1.25, lapse=lapse)
    link.release(20.0)
    far.close()
    assert link.release_result(20.1) is None, "the line is asked, and found to be gone"
    assert link.release_result(20.2) == Release("loopback:a", ReleaseState.LOST, lapse=lapse)
    assert link.release_result(99.0) == Release("loopback:a", ReleaseState.LOST, lapse=lapse)


def test_a_busy_line_is_not_asked_what_became_of_the_rudder() -> None:
    near, far = loopback_pair()
    link = DriveLink(near, JrkG2(SETTINGS), DriveLinkSettings(baud=1280, rate=8.0))
    link.send(0.0, RudderCommand(0.0, 0.0, True))
    link.release(0.0)
    far.receive()
    # ten bits a byte: the order takes 2/128 s
    assert link.release_result(1.0 / 128.0) is None and far.receive() == []
    assert link.release_result(2.0 / 128.0) is None and far.receive() == [b"\xe5\x02\x0c"]


def test_a_line_that_is_gone_is_not_tried_again() -> None:
    near, _ = loopback_pair()
    link = DriveLink(near, JrkG2(SETTINGS))
    link.send(0.0, RudderCommand(0.0, 0.0, True))
    tried = []

    def gone(data: bytes) -> bool:
        tried.append(data)
        raise LinkError("gone")

    near.send = gone  # type: ignore[method-assign]
    link.release(0.1)
    assert tried == [b"\xff"]


@pytest.mark.parametrize("way", ["release", "receive"])
def test_a_line_that_is_gone_is_known_from_either_direction(way: str) -> None:
    near, far = loopback_pair()
    link = DriveLink(near, JrkG2(SETTINGS))
    link.send(0.0, RudderCommand(0.0, 0.0, True))
    far.close()
    if way == "release":
        link.release(0.1)
    else:
        with pytest.raises(LinkError):
            link.receive(0.1)
    result = link.release_result(0.2)
    assert result is not None and result.state is ReleaseState.LOST
