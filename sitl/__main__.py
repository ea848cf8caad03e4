"""`python -m sitl` is the `sitl` command."""

import sys

from sitl.cli import main

sys.exit(main())
