"""The command that starts the program anew, to read untrusted files within limits."""

from __future__ import annotations

import sys

from . import _druse

# The extension alone, without numpy, whose threads take address space that the limits count.
_CODE = """
import importlib.util, sys
spec = importlib.util.spec_from_file_location("_druse", sys.argv[1])
module = importlib.util.module_from_spec(spec)
spec.loader.exec_module(module)
sys.exit(module.main(["druse", *sys.argv[2:]], []))
"""


def program() -> list[str]:
    """Return the words of the command."""
    return [sys.executable, "-I", "-S", "-c", _CODE, _druse.__file__]
