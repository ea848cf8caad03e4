"""Runs `autopilot` commands in forked children, so that each starts in milliseconds and can be killed.

Reads one JSON list of arguments a line; answers with the child's pid, and when it has ended with its exit code
(negative: the signal).
"""

import contextlib
import json
import os
import sys
from pathlib import Path

from autopilot.cli import params, params_upload  # noqa: F401 - loaded before the forks
from autopilot.cli.main import build_parser, main
from autopilot.firmware import session, upload

build_parser()  # imports the rest
session.OTHERS_WAIT_S = 0.02
upload.SETTLE_S = 0.02
session.IDENTITY_WAIT_S = 0.02

for line in sys.stdin:
    arguments = json.loads(line)
    child = os.fork()
    if child == 0:
        with (
            Path(arguments[0]).open("w") as output,
            contextlib.redirect_stdout(output),
            contextlib.redirect_stderr(output),
        ):
            code = main(arguments[1:])
        os._exit(code)
    print(child, flush=True)
    print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)
