"""Identify a boat from its log, and write its file with gains: python identify_a_log.py zigzag.tlog boat.yaml."""

import sys

from autopilot import design, identify, load_vessel, read_log, save_vessel, verdict, with_model

if len(sys.argv) != 3:
    raise SystemExit(__doc__)
log, out = sys.argv[1], sys.argv[2]
run = read_log(log)
found = identify(run)
judged = verdict(found, run)
print(judged.sentence)
print(f"K {found.model.gain:.3f} 1/s, T {found.model.time_constant:.3f} s at {found.model.reference_speed:.2f} m/s")
for name, error in found.standard_errors.items():
    if error is not None:
        print(f"  {name}: standard error {error:.3g}")

if judged.grade == "not enough":
    raise SystemExit(f"{out} is not written: sail once more")
# rudder, links and limits are those of a boat like it; the gains are designed for the new model
boat = with_model(load_vessel("lanxin"), found)
save_vessel(design(boat, level=4), out)
print(f"wrote {out}")
