"""The watched boat, three seconds after the display was switched on."""

from __future__ import annotations

from pathlib import Path

import pytest
from monitored_boat import Watched


@pytest.fixture
def sea(tmp_path: Path) -> Watched:
    boat = Watched(tmp_path)
    boat.watch(3.0)
    return boat
