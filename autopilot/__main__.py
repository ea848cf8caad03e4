"""`python -m autopilot` is the `autopilot` command."""

import sys

from autopilot.cli.main import main

sys.exit(main())
