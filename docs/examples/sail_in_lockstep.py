"""Sail a turn and a hold in sea state 5 without waiting: python sail_in_lockstep.py run.tlog."""

import math
import sys
from itertools import pairwise

from autopilot import Mode, heading_order, load_vessel
from sitl import simulate

if len(sys.argv) != 2:
    raise SystemExit(__doc__)


def orders(now, tick):
    """Hold 20 deg, and 110 deg from 20 s on: one intention, whose heading changes."""
    return heading_order(20.0 if now < 20.0 else 110.0)


ticks = simulate(load_vessel("lanxin"), orders, 60.0, scenario="sea-state-5", log=sys.argv[1])
held = [tick for tick in ticks if tick.mode is Mode.ENGAGED and tick.now > 40.0]
errors = [math.remainder(tick.state.heading - math.radians(110.0), math.tau) for tick in held]
rms = math.degrees(math.sqrt(sum(error * error for error in errors) / len(errors)))
travel = sum(abs(b.command.angle - a.command.angle) for a, b in pairwise(held))
print(f"{len(ticks)} ticks; heading {rms:.2f} deg rms, rudder {math.degrees(travel) / 20.0:.2f} deg/s")
