"""Every crate that Druse is built from may be used under a licence of this list, and has no known advisory.

    cargo metadata --format-version 1 --locked | python licences.py

Advisories are those of RustSec's database where it is at hand: the folder that ADVISORY_DB names, else the one that
`cargo audit` keeps. Without one, the few of data/advisories.json count.
"""

import datetime
import json
import os
import pathlib
import re
import subprocess
import sys

ALLOWED = {
    "0BSD", "Apache-2.0", "Apache-2.0 WITH LLVM-exception", "BSD-2-Clause", "BSD-3-Clause", "BSL-1.0", "CC0-1.0",
    "ISC", "MIT", "MIT-0", "MPL-2.0", "Unicode-3.0", "Unlicense", "Zlib", "bzip2-1.0.6",
}  # fmt: skip
OWN_LIST = pathlib.Path(__file__).parent / "data" / "advisories.json"


def satisfied(expression):
    """Whether an SPDX expression can be met from the list; cargo's old slash means OR."""
    tokens = re.findall(r"\(|\)|[^()\s/]+(?: WITH [^()\s]+)?|/", expression)
    words = {"AND": "and", "OR": "or", "/": "or", "(": "(", ")": ")"}
    return eval(" ".join(words.get(token, str(token in ALLOWED)) for token in tokens), {"__builtins__": {}})


def numbers(version):
    """A version as numbers; what precedes a release is less than it."""
    release, _, before = version.partition("+")[0].partition("-")
    parts = [int(n) for n in re.findall(r"\d+", release)]
    return (parts + [0, 0, 0])[:3] + [0 if before else 1]


def within(version, bounds):
    """Whether a version lies in a range of cargo, as in ">= 1.2.0, < 1.3.0" or "^0.4.1"."""
    for bound in bounds.split(","):
        sign, end = re.fullmatch(r"\s*(>=|<=|>|<|=|\^|~)?\s*([^\s]+)\s*", bound).groups()
        own, other = numbers(version), numbers(end)
        if sign == "^":
            # Up to the next version of the first number that is not 0.
            first = next((n for n in range(2) if other[n]), 2)
            fits = own >= other and own[: first + 1] == other[: first + 1]
        elif sign == "~":
            fits = own >= other and own[:2] == other[:2]
        else:
            fits = {">=": own >= other, "<=": own <= other, ">": own > other, "<": own < other}.get(sign, own == other)
        if not fits:
            return False
    return True


def advisory_of(text):
    """Name, id and unaffected ranges of an advisory of the database; None for a withdrawn or an informational one."""
    if re.search(r"^(withdrawn|informational)\s*=", text, re.M):
        return None
    word = {key: re.search(rf'^{key}\s*=\s*"([^"]+)"', text, re.M) for key in ["id", "package", "date"]}
    if not word["id"] or not word["package"]:
        return None
    ranges = []
    for key in ["patched", "unaffected"]:
        found = re.search(rf"^{key}\s*=\s*\[(.*?)\]", text, re.M | re.S)
        ranges += re.findall(r'"([^"]+)"', found.group(1)) if found else []
    return {"id": word["id"].group(1), "package": word["package"].group(1), "safe": ranges}


def database():
    """The folder of the database, and the day of its last change."""
    home = pathlib.Path(os.environ.get("CARGO_HOME", pathlib.Path.home() / ".cargo"))
    named = os.environ.get("ADVISORY_DB")
    folder = pathlib.Path(named) if named else home / "advisory-db"
    if not (folder / "crates").is_dir():
        if named:
            sys.exit(f"ADVISORY_DB = {named}: found no folder crates in it; expected RustSec's advisory-db")
        return None, None
    log = subprocess.run(["git", "-C", folder, "log", "-1", "--format=%cs"], capture_output=True, text=True)
    return folder, log.stdout.strip() or None


def advisories(names):
    """The advisories of some crates, and a sentence on the list."""
    folder, day = database()
    if folder is None:
        own = json.loads(OWN_LIST.read_text())
        return own["advisories"], f"{age(own['date'])}; no database of advisories is at hand (ADVISORY_DB)"
    files = [f for name in sorted(names) for f in sorted((folder / "crates" / name).glob("*.md"))]
    found = [advisory_of(f.read_text()) for f in files]
    return [a for a in found if a], age(day)


def age(day):
    if day is None:
        return "the list of advisories has no date"
    days = (datetime.date.today() - datetime.date.fromisoformat(day)).days
    return f"the list of advisories is of {day}, {days} days old"


def main():
    packages = json.load(sys.stdin)["packages"]
    bad = [p for p in packages if not (p["license"] and satisfied(p["license"]))]
    for package in bad:
        print(f"{package['name']} {package['version']}: {package['license']}", file=sys.stderr)
    known, list_words = advisories({p["name"] for p in packages})
    hit = [
        (p, a)
        for p in packages
        for a in known
        if a["package"] == p["name"] and not any(within(p["version"], r) for r in a["safe"])
    ]
    for package, advisory in hit:
        safe = " or ".join(advisory["safe"]) or "none"
        print(f"{package['name']} {package['version']}: {advisory['id']}; expected {safe}", file=sys.stderr)
    print(f"{len(packages)} crates, {len(bad)} with a licence that is not on the list, {len(hit)} known advisories")
    print(list_words)
    sys.exit(1 if bad or hit or len(packages) < 2 else 0)


if __name__ == "__main__":
    main()
