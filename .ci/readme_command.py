"""Print the README's copy-paste command of the given name, so that the gate runs what newcomers are told to run."""

from __future__ import annotations

import re
import sys
from pathlib import Path


def command(name: str) -> str:
    """Return the first shell block after the marker `<!-- command: NAME -->`."""
    readme = (Path(__file__).parent.parent / "README.md").read_text(encoding="utf-8")
    found = re.search(rf"<!-- command: {re.escape(name)} -->\s*```sh\n(.*?)\n```", readme, re.DOTALL)
    if found is None:
        raise SystemExit(f"README.md has no command marked {name!r}")
    return found.group(1)


if __name__ == "__main__":
    print(command(sys.argv[1]))
