"""A boat identified from what its flight controller and its pilot logged: the servo's delay is found, not asked for.

In lockstep, with the steering gear that the vessel file describes between servo value and rudder.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from boat_recordings import Boat, dataflash
from lockstep import Lockstep
from scipy.stats import chi2

from autopilot.cli.main import main
from autopilot.identification.identified import Identified, Question
from autopilot.identification.identify import identify
from autopilot.logs.reading import LogOptions, load_run
from autopilot.logs.table import RudderSettings
from autopilot.signals import Order, OrderKind
from autopilot.vessel.file import load_vessel

LANXIN = Path(__file__).resolve().parents[2] / "firmware_params" / "vessels" / "lanxin.yaml"
DELAY_S, LAG_S, ANGLE_RAD, FULL_DEG = 0.12, 0.1, math.radians(20.0), 30.0
HEADING_NOISE_DEG, RATE_NOISE_DEG_S = 0.3, 0.2
"""As in Lanxin's file."""
LOGS = ("firmware.tlog", "own.tlog", "firmware.BIN")


class Truth(NamedTuple):
    """K [1/s], T [s], n3 [s^2/rad^2] at 4.63 m/s."""

    gain: float = 0.43
    time_constant: float = 3.5
    n3: float = 6.0


def vessel_file(folder: Path) -> Path:
    """Return the file of a boat with gains of its own and a servo that is late."""
    text = LANXIN.read_text(encoding="utf-8")
    changes = {
        "K_1_s: 0.701": f"K_1_s: {Truth().gain}",
        "T_s: 0.332": f"T_s: {Truth().time_constant}",
        "n3_s2_rad2: 3.2828": f"n3_s2_rad2: {Truth().n3}",
        "  lag_s: 0.1\n  delay_s: 0.05": f"  lag_s: {LAG_S}\n  delay_s: {DELAY_S}",
    }
    for old, new in changes.items():
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    path = folder / "boat.yaml"
    path.write_text(text, encoding="utf-8")
    assert main(["gains", str(path), "--out", str(path)]) == 0
    return path


def sailed(vessel: Path, side: int, folder: Path) -> None:
    """Sail a 20/20 zigzag and write the three logs of it into `folder`."""
    folder.mkdir()
    run = Lockstep(load_vessel(vessel), log=folder / "own.tlog")
    heard, rows, transmit = bytearray(), [], run.vehicle.transmit

    def transmit_and_keep(now: float) -> list[bytes]:
        datagrams = transmit(now)
        for datagram in datagrams:
            heard.extend(struct.pack(">Q", round((1.7e9 + now) * 1.0e6)) + datagram)
        state = run.world.boat.state
        order = (run.firmware.servos[0] - 1500.0) / 500.0 * math.radians(FULL_DEG)
        rows.append((now, state.heading, state.rate, order, state.rudder, state.speed, state.north, state.east))
        return datagrams

    run.vehicle.transmit = transmit_and_keep  # type: ignore[method-assign]
    run.engage(0.0)
    assert run.run(20.0, run.engaged)
    run.run(5.0)
    run.order = Order(OrderKind.ZIGZAG, 0.0, side * ANGLE_RAD, ANGLE_RAD, serial=run.order.serial + 1)
    run.run(90.0)
    (folder / "firmware.tlog").write_bytes(bytes(heard))
    table = np.array(rows)
    time = np.arange(table[0, 0], table[-1, 0], 0.02)
    boat = Boat(time, *(np.interp(time, table[:, 0], column) for column in table.T[1:]))
    held = table[np.searchsorted(table[:, 0], time, side="right") - 1, 3]
    # a flight controller's log is no truth: it has the noise of the instruments that the other two logs have
    noise = np.random.default_rng(20261124 + side).normal(size=(2, time.size))
    boat = boat._replace(
        heading=boat.heading + math.radians(HEADING_NOISE_DEG) * noise[0],
        rate=boat.rate + math.radians(RATE_NOISE_DEG_S) * noise[1],
    )
    (folder / "firmware.BIN").write_bytes(dataflash(boat._replace(order=held)))


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Identified]:
    """What a kind of log gives, without any option but the angle that the servo's full travel is worth."""
    folder = tmp_path_factory.mktemp("trial")
    vessel, options = vessel_file(folder), LogOptions(rudder=RudderSettings(at_full=math.radians(FULL_DEG)))
    for side, name in ((1, "starboard"), (-1, "port")):
        sailed(vessel, side, folder / name)

    @cache
    def of(log: str) -> Identified:
        return identify(
            [load_run(str(folder / side / log), options=options) for side in ("starboard", "port")], Question()
        )

    return of


@pytest.mark.parametrize("log", LOGS)
def test_the_boat_is_found_with_intervals_that_hold(found: Callable[[str], Identified], log: str) -> None:
    model, errors = found(log).model, found(log).standard_errors
    ratio = model.reference_speed / 4.63
    truth = Truth(Truth().gain * ratio, Truth().time_constant / ratio, Truth().n3 / ratio**2)
    squares = 0.0
    for name, share in (("gain", 0.03), ("time_constant", 0.03), ("n3", 0.15)):
        value, true, error = getattr(model, name), getattr(truth, name), errors[name]
        assert value == pytest.approx(true, rel=share), name
        assert error is not None, name
        squares += ((value - true) / error) ** 2
    # of one draw each 95 % interval misses once in twenty: the three together lie where 99 % of draws do
    assert squares < chi2.ppf(0.99, 3)


@pytest.mark.parametrize("log", ["firmware.tlog", "firmware.BIN"])
def test_a_servo_value_is_known_to_be_an_order_and_how_late_the_rudder_is(
    found: Callable[[str], Identified], log: str
) -> None:
    late = found(log).train.delay + found(log).train.lag
    assert late == pytest.approx(DELAY_S + LAG_S, abs=0.05)
