"""The command line program ``druse``."""

from __future__ import annotations

import signal
import sys


def main() -> int:
    """Run the program on the arguments of this process and return its exit code."""
    from . import _druse
    from ._child import program

    # The program has handlers of its own, which cancel the work.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    sys.stdout.flush()
    return _druse.main(["druse", *sys.argv[1:]], program())


if __name__ == "__main__":
    sys.exit(main())
