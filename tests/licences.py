"""Every crate that Druse is built from may be used under a licence of this list.

    cargo metadata --format-version 1 --locked | python licences.py
"""

import json
import re
import sys

ALLOWED = {
    "0BSD", "Apache-2.0", "Apache-2.0 WITH LLVM-exception", "BSD-2-Clause", "BSD-3-Clause", "BSL-1.0", "CC0-1.0",
    "ISC", "MIT", "MIT-0", "MPL-2.0", "Unicode-3.0", "Unlicense", "Zlib", "bzip2-1.0.6",
}  # fmt: skip


def satisfied(expression):
    """Whether an SPDX expression can be met from the list; cargo's old slash means OR."""
    tokens = re.findall(r"\(|\)|[^()\s/]+(?: WITH [^()\s]+)?|/", expression)
    words = {"AND": "and", "OR": "or", "/": "or", "(": "(", ")": ")"}
    return eval(" ".join(words.get(token, str(token in ALLOWED)) for token in tokens), {"__builtins__": {}})


packages = json.load(sys.stdin)["packages"]
bad = [p for p in packages if not (p["license"] and satisfied(p["license"]))]
for package in bad:
    print(f"{package['name']} {package['version']}: {package['license']}", file=sys.stderr)
print(f"{len(packages)} crates, {len(bad)} with a licence that is not on the list")
sys.exit(1 if bad or len(packages) < 2 else 0)
