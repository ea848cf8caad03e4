"""Steer for some seconds over a real link: python run_a_link.py udpin:127.0.0.1:14550 10 run.tlog.

For the boat: sitl serve lanxin --mavlink udpout:127.0.0.1:14550
"""

import math
import sys

from autopilot import heading_order, load_vessel, read_ticks, run

if len(sys.argv) != 4:
    raise SystemExit(__doc__)
link, seconds, log = sys.argv[1], float(sys.argv[2]), sys.argv[3]
ticks = run(load_vessel("lanxin"), [link], lambda now, tick: heading_order(40.0), seconds, log)
last = ticks[-1]
heading, rudder = (math.degrees(angle) for angle in (last.state.heading, last.state.rudder))
print(f"{last.mode.name}, heading {heading:.1f} deg, rudder {rudder:.1f} deg")
for alarm in last.alarms:
    print("alarm:", alarm.name)
print(f"{len(read_ticks(log))} ticks in {log}")
