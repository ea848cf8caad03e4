"""Norrbin beside canboatjs's own node on one network: they want the same address, and ask each other who they are.

It runs where NORRBIN_INTEROP and NORRBIN_SIGNALK are set (see `test_outside_readers.py`). The network is a pipe: frames
as a Yacht Devices gateway shows them.
"""

from __future__ import annotations

import math
import os
import select
import shutil
import subprocess
import time

import pytest
from outside_programs import SIGNALK, WANTED

from autopilot.links.n2k.link import FORMS
from autopilot.links.n2k.node import Device
from autopilot.links.n2k.session import N2kSession, N2kSettings

PACKAGE = SIGNALK.parents[2] / "@canboat" / "canboatjs"
HAS_CANBOAT = WANTED and (PACKAGE / "package.json").is_file() and shutil.which("node") is not None
pytestmark = pytest.mark.skipif(not HAS_CANBOAT, reason="set NORRBIN_INTEROP=1 and NORRBIN_SIGNALK: see above")
PATIENCE_S = 60.0
APART_S = 0.6
"""canboatjs takes no part in a fight in the first 0.3 s after its claim."""

PROGRAM = """
const canboat = require(process.argv[2])
const { N2kDevice } = require(process.argv[2] + '/dist/n2kDevice')
class Node extends N2kDevice {
  getPersistedData() { return undefined }
  savePersistedData() {}
  sendPGN(pgn, src) {
    const lines = canboat.pgnToYdgwFullRawFormat({ ...pgn, src: src || this.address })
    for (const line of [].concat(lines)) console.log(line)
  }
}
const node = new Node({
  preferredAddress: 204, uniqueNumber: 7, addressClaimDetectionTime: 300,
  addressClaim: { fields: { uniqueNumber: 7, manufacturerCode: 999, deviceFunction: 130,
    deviceClass: Number(process.argv[3]), deviceInstanceLower: 0, deviceInstanceUpper: 0, systemInstance: 0,
    industryGroup: 4, arbitraryAddressCapable: 'Yes' } },
  productInfo: { fields: { nmea2000Version: 2100, productCode: 1, modelId: 'canboat' } }
}, 'test')
const parser = new canboat.FromPgn({ returnNulls: false, useCamel: true })
parser.on('warning', (pgn, text) => console.log('# warning ' + pgn.pgn + ' ' + text))
parser.on('error', (pgn, text) => console.log('# error ' + text))
require('readline').createInterface({ input: process.stdin }).on('line', (line) => {
  const pgn = parser.parseString(line)
  if (!pgn) return
  if (pgn.pgn === 126996) console.log('# product ' + pgn.src + ' ' + pgn.fields.modelId)
  if (pgn.pgn === 59392) console.log('# refused ' + pgn.fields.pgn)
  node.n2kMessage(pgn)
}).on('close', () => process.exit(0))
node.start()
setTimeout(() => {
  for (const pgn of [126996, 130306])
    node.sendPGN({ pgn: 59904, dst: Number(process.argv[4]), prio: 6, fields: { pgn } })
}, 5000)
"""


@pytest.mark.parametrize(("device_class", "ours", "theirs"), [(25, 128, 204), (85, 204, 205)])
def test_of_two_that_want_an_address_the_lower_name_gets_it_and_each_answers_the_other(
    device_class: int, ours: int, theirs: int
) -> None:
    """A gateway (class 25) has a lower NAME than an autopilot (40), a weather instrument (85) a higher one. Neither
    hears the other until both have the address."""
    command = ["node", "-e", PROGRAM, "", str(PACKAGE), str(device_class), str(ours)]
    form, session = FORMS["ydwg"](), N2kSession("pipe", N2kSettings(device=Device(9, "1.0")))
    assert session.node is not None
    said: list[str] = []
    apart_until, to_them, to_us = math.inf, b"", b""
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as other:
        assert other.stdin is not None and other.stdout is not None
        begun = time.monotonic()
        while (now := time.monotonic() - begun) < PATIENCE_S and len(said) < 2:
            session.poll(now)
            to_them += b"".join(
                b"12:00:00.000 R " + line + b"\n"
                for message in session.due(now)
                for line in form.encode(message).splitlines()
            )
            if select.select([other.stdout], [], [], 0.02)[0]:
                lines = os.read(other.stdout.fileno(), 65536).splitlines(keepends=True)
                said += [line.decode().strip() for line in lines if line.startswith(b"#")]
                to_us += b"".join(line for line in lines if not line.startswith(b"#"))
                if b"18eeffcc" in to_us:
                    apart_until = min(apart_until, now + APART_S)
            if now > apart_until:
                other.stdin.write(to_them)
                other.stdin.flush()
                session.receive(now, form.feed(now, to_us))
                to_them = to_us = b""
        other.stdin.close()
        other.wait(timeout=10.0)
    assert said == [f"# product {ours} Norrbin", "# refused 130306"]
    assert session.node.address == ours
    heard = {name >> 49 & 127: address for address, name in session.node.known.items()}
    assert heard == {device_class: theirs}
