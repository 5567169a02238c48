"""Command line: ``python -m dvrk_gravity VERB …``; each verb also runs as ``ros2 run``."""

from __future__ import annotations

import signal
import sys
from collections.abc import Sequence

if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # no traceback from the imports that follow

from dvrk_gravity.command_line import VERBS, VERSION, run


def main(argv: Sequence[str] | None = None) -> int:
    """Dispatch to a verb and return its exit status."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    if not arguments or arguments[0] in ("-h", "--help"):
        print("usage: python -m dvrk_gravity VERB … (VERB --help shows an example; --version)\n")
        for verb, (_, summary) in VERBS.items():
            print(f"  {verb:<14}{summary}")
        return 0 if arguments else 2
    verb = arguments[0]
    if verb == "--version":
        print(VERSION)
        return 0
    if verb not in VERBS:
        known = ", ".join(VERBS)
        print(f"dvrk_gravity: no verb {verb!r}, expected one of: {known}", file=sys.stderr)
        return 2
    return run(VERBS[verb][0], arguments[1:])


if __name__ == "__main__":
    sys.exit(main())
