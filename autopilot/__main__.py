"""`python -m autopilot` is the `autopilot` command."""

from autopilot.entry import autopilot

if __name__ == "__main__":
    autopilot()
