"""NMEA 2000 as canboat's programs decode it, a JSON object a line; the lines are written here after their pages."""

from __future__ import annotations

import contextlib
import json
import math
import random
from datetime import UTC, datetime
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from boat_recordings import EPOCH, every, zigzag_boat
from hypothesis import given, settings
from hypothesis import strategies as st

from autopilot.errors import InputError
from autopilot.identification.identified import Question
from autopilot.identification.identify import identify
from autopilot.logs.n2k_json import read_n2k_json
from autopilot.logs.reading import load_run, read_recording
from autopilot.logs.series import HEADING, LATITUDE, RATE, RUDDER, SPEED

BOAT = zigzag_boat(90.0)
IDENTIFIERS = {"Speed Water Referenced": "speedWaterReferenced", "Data transmit offset": "dataTransmitOffset"}
STD = '{"version":"5.1.2","units":"std","showLookupValues":false}'
SI = '{"version":"5.1.2","units":"si","showLookupValues":true}'


def line(seconds: float, group: int, source: int, fields: dict[str, object]) -> str:
    stamp = datetime.fromtimestamp(EPOCH + seconds, UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")
    return json.dumps(
        {"timestamp": stamp, "prio": 2, "src": source, "dst": 255, "pgn": group, "description": "?", "fields": fields}
    )


def identifiers(fields: dict[str, object]) -> dict[str, object]:
    return {IDENTIFIERS.get(name, name[:1].lower() + name[1:]): value for name, value in fields.items()}


def lines(turn: float, names: bool, words: bool) -> list[str]:
    """turn: what a radian is in the unit of angles; names: fields have canboat's names; words: lookups are pairs."""
    true = {"value": 0, "name": "True"} if words else "True"
    out = []
    for i in every(BOAT, 10.0):
        t, heading = float(BOAT.time[i]), float(BOAT.heading[i] % math.tau)
        steps = (
            (127250, 35, {"Heading": turn * heading, "Reference": true}),
            (127251, 35, {"Rate": turn * BOAT.rate[i]}),
            (127245, 12, {"Instance": 0, "Position": turn * BOAT.rudder[i]}),
            (128259, 12, {"Speed Water Referenced": BOAT.speed[i]}),
            (129025, 7, {"Latitude": 57.69, "Longitude": 11.84}),
            (126993, 9, {"Data transmit offset": 60.0}),
        )
        out += [line(t, group, source, fields if names else identifiers(fields)) for group, source, fields in steps]
    return out


FORMS = {
    "degrees": ([STD], 180.0 / math.pi, True, False),
    "radians, pairs": ([SI], 1.0, True, True),
    "identifiers": ([SI], 1.0, False, False),
    "no units, degrees": ([], 180.0 / math.pi, True, False),
    "no units, radians": ([], 1.0, False, False),
}


@cache
def log_in(form: str) -> list[str]:
    """Return the lines of a log in one of the forms."""
    header, *how = FORMS[form]
    return [*header, *lines(*how)]


@pytest.mark.parametrize("form", FORMS)
def test_decoded_lines_read_as_sailed(tmp_path: Path, form: str) -> None:
    path = tmp_path / "boat.json"
    path.write_text("\n".join(log_in(form)) + "\n")
    recording = read_recording(str(path))
    unit = form.partition("no units, ")[2]
    assert recording.notes == ((f"{path}: does not say its units; its angles are taken for {unit}.",) if unit else ())
    for quantity, truth in ((RATE, BOAT.rate), (RUDDER, BOAT.rudder), (SPEED, BOAT.speed)):
        (series,) = recording.of(quantity)
        np.testing.assert_allclose(series.values, np.interp(series.time, BOAT.time, truth), atol=1e-6)
    (heading,) = recording.of(HEADING)
    np.testing.assert_allclose(
        np.exp(1j * heading.values), np.exp(1j * np.interp(heading.time, BOAT.time, BOAT.heading))
    )
    assert math.degrees(recording.of(LATITUDE)[0].values[0]) == pytest.approx(57.69)
    assert recording.began == pytest.approx(EPOCH, abs=0.01)
    model = identify([load_run(str(path))], Question("nomoto")).model
    assert (model.gain, model.time_constant) == pytest.approx((0.2, 5.0), rel=0.02)


def test_damaged_lines_are_counted_and_too_many_refused() -> None:
    text = [*log_in("degrees")]
    for place in range(7, 600, 30):
        text[place] = text[place][:-9]
    text[4] = text[4].replace("2026", "20?6")
    recording = read_n2k_json("a.json", "\n".join(text).encode())
    assert recording.notes[0].startswith("a.json: 21 of ") and "are damaged and left out" in recording.notes[0]
    with pytest.raises(InputError, match=r"lines are no messages of canboat's; it is damaged"):
        read_n2k_json("a.json", "\n".join([*text, *["INFO"] * len(text)]).encode())
    with pytest.raises(InputError, match="holds no message with a time stamp of those that are read"):
        read_n2k_json("a.json", line(0.0, 126993, 9, {}).encode())


@settings(max_examples=150, deadline=None)
@given(seed=st.integers(0, 1 << 30), noise=st.binary(max_size=60), cut=st.booleans())
def test_damage_raises_nothing_but_a_sentence(seed: int, noise: bytes, cut: bool) -> None:
    chance, data = random.Random(seed), bytearray("\n".join(log_in("radians, pairs")[:60]).encode())
    for _ in range(chance.randrange(1, 8)):
        data[chance.randrange(len(data))] = chance.randrange(256)
    place = chance.randrange(len(data))
    data[place : place + len(noise)] = noise
    with contextlib.suppress(InputError):
        recording = read_n2k_json("a.json", bytes(data[:place] if cut else data))
        assert all(np.isfinite(each.values).all() for each in recording.series)


@pytest.mark.parametrize(
    "value", ["1e999", "true", "null", '"x"', "[]", "{}", "-1", "1e300", '{"value":{}}', "123456789012345678901"]
)
def test_strange_values_are_no_samples(value: str) -> None:
    text = "\n".join(line(t, 127250, 1, {"heading": 1.0, "reference": "True"}) for t in range(9))
    text += "\n" + line(9.0, 127250, 1, {"heading": 77.0, "reference": "True"}).replace("77.0", value)
    (series,) = read_n2k_json("a.json", text.encode()).of(HEADING)
    assert series.time.size == 9
