"""What each level costs on a boat that is not its model: heading rms and rudder travel in sea state 5."""

import math
from itertools import pairwise

from autopilot import Mode, design, heading_order, load_vessel
from sitl import simulate

boat = load_vessel("lanxin")
print("level  heading rms  rudder travel")
for level in (2, 5, 8):
    ticks = simulate(design(boat, level), lambda now, tick: heading_order(0.0), 60.0, boat=boat, scenario="sea-state-5")
    held = [tick for tick in ticks if tick.mode is Mode.ENGAGED and tick.now > 20.0]
    square = sum(math.remainder(tick.state.heading, math.tau) ** 2 for tick in held) / len(held)
    travel = sum(abs(b.command.angle - a.command.angle) for a, b in pairwise(held)) / 40.0
    print(f"{level:5d}  {math.degrees(math.sqrt(square)):7.2f} deg  {math.degrees(travel):8.2f} deg/s")
