"""Step a pilot by hand around a boat of your own: ten lines of physics, no link, no clock."""

import math

from autopilot import HeadingSample, RateSample, SpeedSample, heading_order, load_vessel, pilot_for

vessel = load_vessel("lanxin")
pilot = pilot_for(vessel)
heading, rate, rudder, dt = 0.0, 0.0, 0.0, 0.05

for step in range(1, 801):
    now = step * dt
    # yours to replace: a boat that turns a little less than the file says
    rate += dt * (0.6 * rudder - rate - 3.0 * rate**3) / 0.35
    heading += dt * rate
    samples = (HeadingSample(now, heading), RateSample(now, rate), SpeedSample(now, 4.6))
    tick = pilot.step(now, samples, heading_order(60.0))
    wanted, most = tick.command.angle, math.radians(20.0) * dt
    rudder += min(max(wanted - rudder, -most), most)

turned, laid = math.degrees(heading), math.degrees(rudder)
print(f"after {now:.0f} s: heading {turned:.1f} deg, rudder {laid:.1f} deg, {tick.mode.name}")
