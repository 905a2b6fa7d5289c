"""What a dry run foretells beside what the run finds: estimate.py DRUSE DIRECTORY RECIPE[@KEY=VALUE]...

Runs each recipe twice, dry and in earnest, below the directory, and prints one line for each quantity. Active voxels,
leaves, bytes and memory are to be within 20 %, seconds within a factor of 2, and the dry run is to take 5 % of the run's
time or 5 s beyond reading the inputs. Only what nothing but the part decides (voxels, leaves, bytes) can fail here:
memory and seconds depend on the machine.
"""

import json
import pathlib
import subprocess
import sys
import time

WITHIN = 0.20
COUNTS = ("active_voxels", "leaves", "disk_bytes")


def answer(command):
    start = time.monotonic()
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    return done.stdout, time.monotonic() - start


def compare(druse, directory, recipe):
    path, *settings = recipe.split("@")
    name = pathlib.Path(path).stem
    command = [druse, "run", path, "--json", "--quiet", "--out", str(directory / name)]
    for setting in settings:
        command += ["--set", setting]
    text, dry = answer([*command, "--dry-run"])
    estimate = json.loads(text)
    answer(command)
    with open(directory / name / "report.json", encoding="utf-8") as file:
        report = json.load(file)
    stages = {stage["name"]: stage["seconds"] for stage in report["stages"]}
    found = {
        "active_voxels": report["band"]["active_voxels"],
        "leaves": report["band"]["leaves"],
        "disk_bytes": sum(output["bytes"] for output in report["outputs"]),
        "peak_memory_bytes": report["peak_memory_bytes"],
        "seconds": sum(stages.values()),
    }
    wrong = []
    for key, value in found.items():
        off = estimate[key] / value - 1
        print(f"{name:18} {key:18} foretold {estimate[key]:>12.4g}  found {value:>12.4g}  {100 * off:+.1f} %")
        if abs(off) > WITHIN and key in COUNTS:
            wrong.append(f"{name}: {key} is off by {100 * off:+.1f} %, more than {100 * WITHIN:.0f} %")
    beyond = dry - stages.get("inputs", 0.0)
    print(f"{name:18} dry run {dry:.1f} s, of which {beyond:.1f} s are not reading the inputs; run {found['seconds']:.1f} s")
    return wrong


def main():
    druse, directory, *recipes = sys.argv[1:]
    wrong = [line for recipe in recipes for line in compare(druse, pathlib.Path(directory), recipe)]
    sys.exit("\n".join(wrong) if wrong else 0)


if __name__ == "__main__":
    main()
