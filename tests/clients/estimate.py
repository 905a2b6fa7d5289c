"""What a dry run foretold beside what the run found: estimate.py ESTIMATE.json REPORT.json

Active voxels, bytes and memory are to be within 20 %, and the dry run is to take 5 % of the run's time or 5 s; the
lines say by how much they are off. Only what nothing but the part decides (voxels, bytes) can fail here: memory and
seconds depend on the machine.
"""

import json
import sys

WITHIN = 0.20


def main():
    with open(sys.argv[1], encoding="utf-8") as file:
        estimate = json.load(file)
    with open(sys.argv[2], encoding="utf-8") as file:
        report = json.load(file)
    found = {
        "active_voxels": report["band"]["active_voxels"],
        "disk_bytes": sum(output["bytes"] for output in report["outputs"]),
        "peak_memory_bytes": report["peak_memory_bytes"],
        "seconds": sum(stage["seconds"] for stage in report["stages"]),
    }
    wrong = []
    for key, value in found.items():
        off = estimate[key] / value - 1
        print(f"{key:18} foretold {estimate[key]:>14.6g}  found {value:>14.6g}  {100 * off:+.1f} %")
        if abs(off) > WITHIN and key in ("active_voxels", "disk_bytes"):
            wrong.append(f"{key} is off by {100 * off:+.1f} %, more than {100 * WITHIN:.0f} %")
    touched, held = report["band"]["leaves_touched"], report["band"]["leaves_kept"]
    print(f"leaves evaluated   {touched} for {held} that hold active voxels: {touched / held:.2f}")
    sys.exit("\n".join(wrong) if wrong else 0)


if __name__ == "__main__":
    main()
