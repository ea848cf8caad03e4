"""The roll model against an independent simulator: Runge and Kutta, in calm and in waves, and what is refused."""

from __future__ import annotations

import json
import math
import struct
from pathlib import Path

import numpy as np
import pytest

from autopilot.cli.main import main
from autopilot.errors import InputError
from autopilot.identification.roll import PARAMETERS, identify_roll
from autopilot.logs.nmea_text import read_nmea
from autopilot.runtime.build import law_of
from autopilot.vessel.file import load_vessel

DEG = math.pi / 180.0
TRUTH = {"frequency": 1.1, "damping": 0.09, "rudder": 0.15, "yaw": -1.1}
SPEED = 7.7


def sailed(
    seed: int, waves_deg: float = 0.0, seconds: float = 600.0, hz: float = 10.0, *, rolls: float = 1.0
) -> dict[str, np.ndarray]:
    """Return columns of a boat in a 15/10 zigzag whose roll answers rudder and yaw; waves move both together."""
    rng = np.random.default_rng(seed)
    count, inner = int(seconds * hz), 2
    dt = 1.0 / hz / inner
    time = np.arange(count * inner * 2 + 2) * (0.5 * dt)
    # so many, and unevenly apart, that the sea does not repeat itself within the record
    omega = np.sort(rng.uniform(0.5, 1.8, 300))
    density = np.exp(-(((omega - 0.95) / 0.2) ** 2))
    size, phase = np.sqrt(density / density.sum()), rng.uniform(0.0, 2.0 * math.pi, omega.size)
    push, aside = np.zeros(time.size), np.zeros(time.size)
    for frequency, amplitude, shift in zip(omega, size, phase, strict=True):
        push += amplitude * np.sin(frequency * time + shift)
        aside += amplitude * np.sin(frequency * time + shift + 0.7)
    w, z = TRUTH["frequency"], TRUTH["damping"]
    scale = 0.0
    if waves_deg:
        reply = 1.0 / np.abs(w**2 - omega**2 + 2j * z * w * omega)
        scale = waves_deg * DEG / math.sqrt(float(np.sum((size * reply) ** 2) / 2.0))
    K, T, speed = 0.2, 5.0, SPEED

    def slope(x: np.ndarray, delta: float, at: int) -> np.ndarray:
        r, _, phi, p = x
        roll = rolls * (TRUTH["rudder"] * delta + TRUTH["yaw"] * r)
        yaw = (K * delta - r) / T + 0.1 * scale * aside[at]
        return np.array((yaw, r, p, -2.0 * z * w * p - w * w * phi + roll + scale * push[at]))

    x, delta, side = np.zeros(4), 0.0, 1.0
    rows = np.empty((count, 5))
    for i in range(count * inner):
        if i % inner == 0:
            rows[i // inner] = (*x, delta)
        if side * x[1] > 10.0 * DEG:
            side = -side
        after = delta + min(max(side * 15.0 * DEG - delta, -10.0 * DEG * dt), 10.0 * DEG * dt)
        middle = 0.5 * (delta + after)
        k1 = slope(x, delta, 2 * i)
        k2 = slope(x + 0.5 * dt * k1, middle, 2 * i + 1)
        k3 = slope(x + 0.5 * dt * k2, middle, 2 * i + 1)
        k4 = slope(x + dt * k3, after, 2 * i + 2)
        delta = after
        x = x + dt / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
    noise = rng.normal(size=(4, count))
    return {
        "time_s": np.arange(count) / hz,
        "roll_rad": rows[:, 2] + 0.1 * DEG * noise[0] + 1.0 * DEG,
        "heading_rad": np.angle(np.exp(1j * (rows[:, 1] + 0.3 * DEG * noise[1]))),
        "yaw_rate_rad_s": rows[:, 0] + 0.1 * DEG * noise[2],
        "rudder_rad": rows[:, 4] + 0.1 * DEG * noise[3],
        "speed_m_s": np.full(count, speed),
    }


@pytest.mark.parametrize(("waves", "seeds"), [(0.0, 4), (5.0, 6)])
def test_the_intervals_hold_the_truth(waves: float, seeds: int) -> None:
    """Of 95 % intervals, one in so few may miss."""
    models = [identify_roll("log", sailed(seed, waves), SPEED) for seed in range(seeds)]
    for name in PARAMETERS:
        held = [model.interval(name)[0] <= TRUTH[name] <= model.interval(name)[1] for model in models]
        assert sum(held) >= seeds - 1, name
    if waves:
        assert math.degrees(models[0].left_rms) == pytest.approx(waves, rel=0.3)


def test_intervals_are_narrow_enough_to_steer_by() -> None:
    model = identify_roll("log", sailed(1), SPEED)
    for name in PARAMETERS:
        assert getattr(model, name) == pytest.approx(TRUTH[name], rel=0.02)
    low, high = identify_roll("log", sailed(1, 5.0), SPEED).interval("rudder")
    assert 0.5 * TRUTH["rudder"] < low < high < 1.5 * TRUTH["rudder"]


def test_a_rudder_that_does_not_move_roll_is_refused() -> None:
    with pytest.raises(InputError, match="the rudder does not move roll"):
        identify_roll("log", sailed(2, 5.0, rolls=0.0), SPEED)


def test_what_is_missing_is_one_sentence() -> None:
    columns = sailed(2, seconds=80.0)
    with pytest.raises(InputError, match="holds no roll"):
        identify_roll("log", {name: values for name, values in columns.items() if name != "roll_rad"})
    with pytest.raises(InputError, match="the rudder hardly moves"):
        identify_roll("log", {**columns, "rudder_rad": 0.0 * columns["rudder_rad"]})
    with pytest.raises(InputError, match="60 s are needed"):
        identify_roll("log", {name: values[:300] for name, values in columns.items()})


def test_the_command_writes_a_file_that_steers(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    columns, log, out = sailed(3), tmp_path / "roll.csv", tmp_path / "boat.yaml"
    names = list(columns)
    table = np.column_stack([columns[name] for name in names])
    np.savetxt(log, table, delimiter=",", header=",".join(names), comments="")
    assert main(["identify", "--roll", str(log), "--vessel", "naval_vessel", "--out", str(out)]) == 0
    assert "natural frequency" in capsys.readouterr().out
    vessel = load_vessel(out)
    assert vessel.control.law == "sliding_roll"
    row = vessel.control.sliding_roll.roll_row
    assert row[3] == pytest.approx(-(TRUTH["frequency"] ** 2), rel=0.02)
    assert row[1] == pytest.approx(-2.0 * TRUTH["damping"] * TRUTH["frequency"], rel=0.05)
    assert law_of(vessel).name == "sliding_roll"
    assert main(["identify", "--roll", str(log), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["roll_row"][4] == pytest.approx(TRUTH["rudder"], rel=0.02)
    assert main(["identify", "--roll", str(log), "--out", str(tmp_path / "new.yaml")]) == 2
    assert "give --vessel FILE" in capsys.readouterr().err


def test_a_roll_model_comes_from_an_nmea_2000_log(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """candump -L of headings, rudder, speed and attitude, packed here by hand."""
    columns, log, lines = sailed(3), tmp_path / "can.log", []

    def put(time: float, group: int, data: bytes) -> None:
        lines.append(f"({1.6e9 + time:.6f}) can0 {2 << 26 | group << 8 | 35:08X}#{data.hex().upper()}\n")

    for t, psi, phi, delta, speed in zip(
        *(columns[name] for name in ("time_s", "heading_rad", "roll_rad", "rudder_rad", "speed_m_s")), strict=True
    ):
        put(t, 127250, struct.pack("<BHhhB", 1, round(psi % math.tau * 1e4), 0x7FFF, 0x7FFF, 0xFC))
        put(t, 127257, struct.pack("<BhhhB", 1, 0x7FFF, 0x7FFF, round(phi * 1e4), 255))
        put(t, 127245, struct.pack("<BBhhH", 0, 0xF8, 0x7FFF, round(delta * 1e4), 0xFFFF))
        put(t, 128259, struct.pack("<BHHBH", 1, round(speed * 100), 0xFFFF, 0, 0xFFFF))
    log.write_text("".join(lines))
    assert main(["identify", "--roll", str(log), "--vessel", "naval_vessel", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["roll_row"][4] == pytest.approx(TRUTH["rudder"], rel=0.03)


@pytest.mark.parametrize(
    "form", ["IIXDR,C,20.0,C,AIR,A,{:.1f},D,ROLL", "PASHR,120000.00,1.0,T,{:.1f},1.0,0.0,0.1,0.1,0.1,1,1"]
)
def test_roll_comes_from_nmea_sentences(form: str) -> None:
    lines = []
    for second in range(20):
        for body in (f"IIHDT,{10.0 + second:.1f},T", form.format(second - 10)):
            check = 0
            for letter in body:
                check ^= ord(letter)
            lines.append(f"{second}.0 ${body}*{check:02X}\r\n")
    recording = read_nmea("log", "".join(lines).encode())
    roll = recording.best("roll_rad")
    assert roll is not None
    assert np.degrees(roll.values) == pytest.approx(np.arange(-10.0, 10.0))
