"""Lets these tests import the vehicle that stands in for a flight controller."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
