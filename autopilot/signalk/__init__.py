"""Signal K: the running pilot's heading, rudder and state as deltas, and orders from Signal K programs.

A process of its own, one more MAVLink client; `plugin/` is what a Signal K server loads to find it.
"""
