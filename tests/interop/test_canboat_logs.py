"""Logs that canboat's own JavaScript encoder writes, from a boat that was sailed here: read, and identified.

It runs where NORRBIN_INTEROP and NORRBIN_SIGNALK are set (see `test_outside_readers.py`): a Signal K server brings the
package @canboat/canboatjs with it. Its encoder and decoder share nothing with the package nmea2000 or with ours.
"""

from __future__ import annotations

import json
import math
import shutil
import subprocess
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
from boat_recordings import EPOCH, every, zigzag_boat
from outside_programs import SIGNALK, WANTED

from autopilot.identification.identified import Question
from autopilot.identification.identify import identify
from autopilot.logs.reading import load_run, read_recording
from autopilot.logs.series import HEADING, LATITUDE, LONGITUDE, ORDER, RATE, RUDDER, SPEED, WIND_DIRECTION, WIND_SPEED

PACKAGE = SIGNALK.parents[2] / "@canboat" / "canboatjs"
HAS_CANBOAT = WANTED and (PACKAGE / "package.json").is_file() and shutil.which("node") is not None
pytestmark = pytest.mark.skipif(not HAS_CANBOAT, reason="set NORRBIN_INTEROP=1 and NORRBIN_SIGNALK: see above")
BOAT = zigzag_boat(90.0)

PROGRAM = """
const canboat = require(process.argv[2])
const [messages, form] = JSON.parse(require('fs').readFileSync(0))
const parser = new canboat.FromPgn({ returnNulls: false, useCamel: true })
for (const [place, message] of messages.entries()) {
  const lines = form === 'json'
    ? [JSON.stringify(parser.parseString(canboat.toActisenseSerialFormat(message.pgn, canboat.toPgn(message),
        message.dst, message.src, message.prio)))]
    : [].concat(canboat[form](message))
  for (const line of lines) console.log(place + ' ' + line)
}
"""


def messages() -> Iterator[tuple[float, dict[str, object]]]:
    """Yield seconds and messages as canboat has them: heading, rate and rudder at 10 Hz, the rest at 1 Hz."""
    for i in every(BOAT, 10.0):
        t, heading = float(BOAT.time[i]), float(BOAT.heading[i])
        magnetic = {"heading": (heading - 0.05 + 0.02) % math.tau, "deviation": -0.02, "variation": 0.05}
        rudder = float(BOAT.rudder[i])
        side = "Move to starboard" if rudder > 0.0 else "Move to port"
        orders = {"instance": 0, "directionOrder": side, "angleOrder": rudder, "position": rudder}
        yield _message(t, 127250, 35, {**magnetic, "reference": "Magnetic"})
        yield _message(t + 0.001, 127251, 35, {"rate": float(BOAT.rate[i])})
        yield _message(t + 0.002, 127245, 12, orders)
        if i % 50 == 0:
            moment = datetime.fromtimestamp(EPOCH + t + 0.004, UTC)
            when = {"date": moment.strftime("%Y.%m.%d"), "time": moment.strftime("%H:%M:%S.%f")}
            place = {"latitude": 57.69 + 1e-5 * t, "longitude": -11.84}
            yield _message(t + 0.003, 128259, 12, {"speedWaterReferenced": 3.0})
            yield _message(t + 0.004, 129029, 7, {**place, **when})
            yield _message(t + 0.005, 129026, 7, {"cogReference": "True", "cog": 1.0, "sog": 2.5})
            yield _message(t + 0.006, 130306, 9, {"windSpeed": 5.0, "windAngle": 5.5, "reference": "Apparent"})


def _message(t: float, group: int, source: int, fields: dict[str, object]) -> tuple[float, dict[str, object]]:
    stamp = datetime.fromtimestamp(EPOCH + t, UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")
    return t, {"pgn": group, "prio": 2, "src": source, "dst": 255, "timestamp": stamp, "fields": fields}


SENT = list(messages())


def encoded(form: str) -> list[tuple[float, str]]:
    """Return what canboatjs writes of the boat's messages, with the seconds of each line."""
    program = ["node", "-e", PROGRAM, "", str(PACKAGE)]
    given = json.dumps([[message for _, message in SENT], form])
    done = subprocess.run(program, input=given, capture_output=True, text=True, timeout=120, check=True)
    lines = [line.split(" ", 1) for line in done.stdout.splitlines()]
    return [(SENT[int(place)][0], line) for place, line in lines]


def clock(seconds: float, form: str) -> str:
    return datetime.fromtimestamp(EPOCH + seconds, UTC).strftime(form)[:-3]


FORMS = {
    "canboat": ("pgnToActisenseSerialFormat", lambda t, s: clock(t, "%Y-%m-%dT%H:%M:%S.%f") + "Z" + s[s.index(",") :]),
    "Actisense": ("pgnToActisenseN2KAsciiFormat", lambda t, s: f"A{clock(t, '%H%M%S.%f')}" + s[s.index(" ") :]),
    "Yacht Devices": ("pgnToYdgwFullRawFormat", lambda t, s: clock(t, "%H:%M:%S.%f") + s[s.index(" ") :]),
    "candump log": ("pgnToCandump3", lambda t, s: s),
    "candump -ta": ("pgnToCandump2", lambda t, s: f" ({EPOCH + t:.6f})  {s}"),
    "candump": ("pgnToCandump2", lambda t, s: s),
    "old candump": ("pgnToCandump1", lambda t, s: s),
    "JSON": ("json", lambda t, s: json.dumps({**json.loads(s), "timestamp": clock(t, "%Y-%m-%dT%H:%M:%S.%f") + "Z"})),
}
"""Its function, and the line with the boat's time, which is put in where the encoder has its own clock or none."""
SPREAD = ("candump", "old candump")


@pytest.mark.parametrize("form", FORMS)
def test_what_canboat_encodes_reads_as_sailed_and_is_identified(form: str, tmp_path: Path) -> None:
    function, timed = FORMS[form]
    path = tmp_path / "boat.log"
    path.write_text("\n".join(timed(t, line) for t, line in encoded(function)) + "\n")
    recording = read_recording(str(path))
    is_spread = form in SPREAD
    assert len(recording.notes) == (is_spread or form == "JSON"), recording.notes
    assert recording.began == pytest.approx(EPOCH, abs=1.0 if is_spread else 0.01)
    for quantity, truth in ((HEADING, BOAT.heading), (RATE, BOAT.rate), (RUDDER, BOAT.rudder), (ORDER, BOAT.rudder)):
        series = recording.of(quantity)[0]
        assert series.time.size == 901, quantity
        expected = truth[::5]
        values = np.exp(1j * series.values) if quantity == HEADING else series.values
        np.testing.assert_allclose(values, np.exp(1j * expected) if quantity == HEADING else expected, atol=2.5e-4)
    speeds = [(each.source, each.values[0]) for each in recording.of(SPEED)]
    assert speeds == [("N2K128259.12", pytest.approx(3.0)), ("N2K129026.7", pytest.approx(2.5))]
    place = [np.degrees(recording.of(each)[0].values) for each in (LATITUDE, LONGITUDE)]
    np.testing.assert_allclose(place[0], 57.69 + 1e-5 * np.arange(91.0), atol=1e-7)
    np.testing.assert_allclose(place[1], -11.84, atol=1e-7)
    wind = [recording.of(each)[0].values[0] for each in (WIND_SPEED, WIND_DIRECTION)]
    assert wind == [pytest.approx(5.0), pytest.approx(5.5 - math.tau, abs=1e-4)]
    model = identify([load_run(str(path))], Question("nomoto")).model
    assert (model.gain, model.time_constant) == pytest.approx((0.2, 5.0), rel=0.03)
