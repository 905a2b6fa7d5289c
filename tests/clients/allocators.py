"""What the program takes with other allocators in the place of the C library's: allocators.py DRUSE DIRECTORY [ROUNDS].

Makes a part in memory, one in bricks and one of bent elements, in turn with each allocator that Debian's libraries
offer, put before the C library's through LD_PRELOAD, so that both languages use it. Prints the median processor time of
the rounds, of which in the system, the wall time and the greatest peak of memory, each with its ratio to the C
library's. Nothing fails here but a run: it is a measurement, by which the allocator was chosen.

    apt-get install libmimalloc2.0 libjemalloc2 libtcmalloc-minimal4 libtbbmalloc2
"""

import os
import pathlib
import statistics
import subprocess
import sys
import time

LIBRARIES = pathlib.Path("/usr/lib/x86_64-linux-gnu")
ALLOCATORS = {
    "C library": None,
    "mimalloc": "libmimalloc.so.2",
    "tcmalloc": "libtcmalloc_minimal.so.4",
    "jemalloc": "libjemalloc.so.2",
    "tbbmalloc": "libtbbmalloc_proxy.so.2",
}
RUNS = {
    "in memory": ["examples/large_block.toml", "--memory", "4G", "--set", "band.voxel_size=0.5"],
    "in bricks": ["examples/large_block.toml", "--memory", "256M", "--set", "band.voxel_size=0.4"],
    "bent": ["examples/bracket/bracket.toml"],
}


def cost(command, allocator):
    """Seconds of the processor, of them in the system, on the wall, and MiB at the peak."""
    environment = dict(os.environ)
    if allocator:
        environment["LD_PRELOAD"] = str(LIBRARIES / allocator)
    start = time.monotonic()
    process = subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL)
    _, status, used = os.wait4(process.pid, 0)
    if status:
        sys.exit(f"{allocator}: {' '.join(command)} ended with status {status}")
    return used.ru_utime + used.ru_stime, used.ru_stime, time.monotonic() - start, used.ru_maxrss / 1024


def main():
    druse, directory, *rounds = sys.argv[1:]
    rounds = int(rounds[0]) if rounds else 3
    here = {name: file for name, file in ALLOCATORS.items() if file is None or (LIBRARIES / file).exists()}
    for name in ALLOCATORS.keys() - here.keys():
        print(f"{name}: {LIBRARIES / ALLOCATORS[name]} is not there, left out")
    for run, arguments in RUNS.items():
        command = [druse, "run", *arguments, "--quiet", "--out", directory]
        found = {name: [] for name in here}
        for _ in range(rounds):
            for name, file in here.items():
                found[name].append(cost(command, file))
        base = None
        for name, costs in found.items():
            *times, peak = zip(*costs)
            all_of_it = [*map(statistics.median, times), max(peak)]
            base = base or all_of_it
            parts = zip(("processor", "system", "wall"), all_of_it, base)
            text = "  ".join(f"{what} {value:6.2f} s ({value / first:.2f})" for what, value, first in parts)
            print(f"figure: {run:10} {name:10} {text}  peak {all_of_it[3]:5.0f} MiB ({all_of_it[3] / base[3]:.2f})", flush=True)


main()
