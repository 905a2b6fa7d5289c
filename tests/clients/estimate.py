"""Prints what a dry run foretold beside what the run found: estimate.py ESTIMATE.json REPORT.json

The program's promise is 20 % for active voxels, bytes and peak memory; seconds are printed, never judged.
"""

import json
import os
import sys


def main():
    with open(sys.argv[1], encoding="utf-8") as file:
        estimate = json.load(file)
    with open(sys.argv[2], encoding="utf-8") as file:
        report = json.load(file)
    print(json.dumps(estimate, indent=1)[:2000], json.dumps(report, indent=1)[:4000])


if __name__ == "__main__":
    main()
