"""The decks of Debian's calculix-ccx-test: Druse's elements against a parser of twenty lines.

    python3 decks.py DRUSE [DIRECTORY]

The package is unpacked below DIRECTORY, not installed. A deck must be read with the elements
that its *ELEMENT lines say, or be refused for a reason of the table below. Prints a table; fails where counts
differ, where a refusal has another reason, or where an element type of the decks is never read.
"""

import collections
import concurrent.futures
import json
import pathlib
import re
import subprocess
import sys
import tempfile

from foreign_meshes import plain, unpack

KINDS = {  # nodes of an element, ours
    "C3D4": (4, "Tet4"), "C3D10": (10, "Tet10"), "C3D8": (8, "Hex8"), "C3D8R": (8, "Hex8"), "C3D8I": (8, "Hex8"),
    "F3D8": (8, "Hex8"), "C3D20": (20, "Hex20"), "C3D20R": (20, "Hex20"), "C3D6": (6, "Wedge6"),
    "C3D15": (15, "Wedge15"), "S3": (3, "Tri3"), "S6": (6, "Tri6"), "CAX6": (6, "Tri6"), "S4": (4, "Quad4"),
    "CPS4": (4, "Quad4"), "CPE4": (4, "Quad4"), "S8": (8, "Quad8"), "S8R": (8, "Quad8"), "CPS8": (8, "Quad8"),
    "CPS8R": (8, "Quad8"), "CPE8": (8, "Quad8"), "CPE8R": (8, "Quad8"), "CAX8": (8, "Quad8"), "CAX8R": (8, "Quad8"),
}
SOLID = ("Tet", "Hex", "Wedge", "Pyramid")
LEFT_OUT = {"D", "B31", "B32", "B32R", "T3D2", "SPRINGA", "DASHPOTA", "GAPUNI", "DCOUP3D"}
REASONS = {  # what a refusal says
    "only lines and points": r"found only \d+ elements without volume or surface",
    "no elements of its own": r"found no elements",
    "an include that is not there": r"found no such file",
    "more nodes than the type has": r"found 10 nodes",
}


def lines(path):
    for line in path.read_text(errors="replace").splitlines():
        line = line.strip()
        if line and not line.startswith("**"):
            yield line


def expected(path):
    """Elements at different places by kind: the solids if there are any, else the faces; and all types."""
    found, types, kind, pending, nodes, places = {}, set(), None, [], False, {}
    for line in lines(path):
        if line.startswith("*"):
            kind, pending = None, []
            nodes = bool(re.match(r"\*NODE\s*(,|$)", line, re.I))
            if re.match(r"\*ELEMENT\s*,", line, re.I):
                name = re.search(r"TYPE\s*=\s*([^\s,]+)", line, re.I).group(1).upper()
                types.add(name)
                kind = KINDS.get(name)
        elif nodes:
            words = line.split(",")
            places[int(words[0])] = tuple(float(w or 0) for w in map(str.strip, words[1:4]))
        elif kind:
            pending += [int(w) for w in line.split(",") if w.strip()]
            if len(pending) == kind[0] + 1:
                found[frozenset(places.get(n, n) for n in pending[1:])] = kind[1]
                pending = []
    counts = dict(collections.Counter(found.values()))
    solids = {k: n for k, n in counts.items() if k.startswith(SOLID)}
    return solids or counts, types


def ours(druse, path):
    run = subprocess.run([druse, "scaffold", "info", "--json", path], capture_output=True, text=True)
    answer = json.loads(run.stdout or run.stderr)
    if run.returncode == 0:
        return answer, ""
    return None, answer.get("error", answer).get("message", "?")


def main(druse, directory=None):
    outcomes, wrong, met, read_types = collections.Counter(), [], set(), set()
    with tempfile.TemporaryDirectory() as work:
        work = pathlib.Path(work)
        package = pathlib.Path(directory) if directory else work
        package.mkdir(parents=True, exist_ok=True)
        packed = sorted(unpack(package, "calculix-ccx-test").rglob("*.inp*"))
        decks = [plain(path, work) for path in packed if path.suffix in (".gz", ".inp")]
        with concurrent.futures.ThreadPoolExecutor(4) as pool:
            answers = list(pool.map(lambda deck: ours(druse, deck), decks))
        for deck, (answer, message) in zip(decks, answers):
            counts, types = expected(deck)
            met |= types
            if answer is None:
                reason = next((r for r, text in REASONS.items() if re.search(text, message)), None)
                outcomes[f"refused: {reason}"] += 1
                if reason is None or (counts and reason.startswith(("only", "no"))):
                    wrong.append(f"{deck.name}: {message}")
                continue
            read_types |= types
            outcomes["read: a surface" if answer["kind"] == "surface" else "read: solids"] += 1
            if answer["elements"] != counts:
                wrong.append(f"{deck.name}: {answer['elements']}, not {counts}")
            if any("unknown keyword" in w for w in answer["warnings"]):
                wrong.append(f"{deck.name}: {answer['warnings']}")
    for outcome, count in sorted(outcomes.items()):
        print(f"{count:5}  {outcome}")
    print(f"       types met: {' '.join(sorted(met))}")
    unread = met - read_types - LEFT_OUT
    wrong += [f"no deck with {name} was read" for name in sorted(unread)]
    print("\n".join(wrong))
    if wrong or len(decks) < 300:
        sys.exit(f"{len(wrong)} faults in {len(decks)} decks")


if __name__ == "__main__":
    main(*sys.argv[1:])
