"""The order of a trial's steps, and that a human at the helm ends it for good."""

from __future__ import annotations

import math

import pytest

from autopilot.cli.main import main
from autopilot.operators.trial_script import Step, TrialScript, heading, turning, zigzag
from autopilot.signals import Mode, NavState, Order, OrderKind, Reference, RudderCommand, Tick


def ticked(now: float, mode: Mode) -> Tick:
    state = NavState(now, 0.0, 0.0, 4.6, 0.0, 0.0, 0.0, True)
    return Tick(0, now, (), Order(), state, Reference(0.0), 0.0, RudderCommand(now, 0.0, False), mode, ())


def sail(script: TrialScript, modes: list[tuple[float, Mode]]) -> list[Order]:
    return [script(now, ticked(now, mode)) for now, mode in modes]


def engaged(*times: float) -> list[tuple[float, Mode]]:
    return [(now, Mode.ENGAGED) for now in times]


STEPS: list[Step] = [zigzag(0.2, 0.3, 10.0), turning(-0.1, 5.0), heading(1.0, 2.0)]


def test_steps_follow_each_other_from_the_moment_of_engagement() -> None:
    script = TrialScript(STEPS)
    assert script(0.0, None).kind is OrderKind.ZIGZAG
    orders = sail(script, [(3.0, Mode.STANDBY), *engaged(4.0, 13.9, 14.0, 18.9, 19.0, 20.9)])
    kinds = [OrderKind.ZIGZAG] * 3 + [OrderKind.RUDDER] * 2 + [OrderKind.HEADING] * 2
    assert [order.kind for order in orders] == kinds
    assert {order.serial for order in orders} == {1}
    assert script.begun_at == [4.0, 14.0, 19.0]
    assert not script.is_over
    assert script(21.0, ticked(21.0, Mode.ENGAGED)) == Order()
    assert script.is_over
    assert script.is_complete


def test_orders_hold_what_the_step_was_given() -> None:
    first = TrialScript(STEPS)(0.0, None)
    assert math.isnan(first.heading)
    assert (first.rudder, first.heading_change) == (0.2, 0.3)


@pytest.mark.parametrize("mode", [Mode.OVERRIDE, Mode.FAILSAFE, Mode.STANDBY])
def test_whoever_takes_the_helm_ends_it(mode: Mode) -> None:
    script = TrialScript(STEPS)
    orders = sail(script, [*engaged(0.0, 1.0), (2.0, mode), *engaged(3.0, 30.0)])
    assert [order.kind for order in orders[2:]] == [OrderKind.STANDBY] * 3, "and nothing begins again by itself"
    assert script.is_over
    assert not script.is_complete


def test_progress_goes_from_none_to_all() -> None:
    script = TrialScript(STEPS)
    shares = []
    for now in (0.0, 10.0, 15.0, 17.0):
        script(now, ticked(now, Mode.ENGAGED))
        shares.append(script.progress)
    assert shares == pytest.approx([0.0, 1 / 3, 2 / 3, 1.0])


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["zigzag", "--rudder-deg", "31"], ("--rudder-deg 31", "1 to 30")),
        (["zigzag", "--rudder-deg", "-5"], ("--rudder-deg -5", "1 to 30")),
        (["zigzag", "--rudder-deg", "nan"], ("--rudder-deg nan", "a number")),
        (["zigzag", "--heading-deg", "0"], ("--heading-deg 0", "1 to 90")),
        (["zigzag", "--duration", "inf"], ("--duration inf", "1 to 36000")),
        (["turning", "--rudder-deg", "10,-40"], ("--rudder-deg -40", "-30 to 30")),
        (["turning", "--rudder-deg", "10;20"], ("--rudder-deg '10;20'", "10,20,-10,-20")),
        (["turning", "--rudder-deg", ""], ("an argument is empty (--rudder-deg=)", "--help")),
        (["turning", "--each", "0"], ("--each 0", "1 to 36000")),
    ],
)
def test_a_trial_that_no_boat_should_sail_is_one_sentence(
    arguments: list[str], named: tuple[str, str], capsys: pytest.CaptureFixture[str]
) -> None:
    kind, *rest = arguments
    # `--rudder-deg=-5`, as a user must write it: argparse takes a lone -5 for an option
    options = [f"{name}={value}" for name, value in zip(rest[::2], rest[1::2], strict=True)]
    assert main(["trial", kind, "lanxin", "--link", "udpin:127.0.0.1:0", *options]) == 2
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1
    assert all(part in lines[0] for part in named)
