#!/usr/bin/env bash
# The job files of `druse plan --emit` for GNU parallel and Open Job Description, run by those: the
# content hash must be that of the run in memory.
#
#     tests/clients/farm.sh DRUSE DIRECTORY OPENJD
set -euo pipefail
druse=$(realpath "$1")
openjd=$(realpath -s "$3")
mkdir -p "$2"
cd "$2"
rm -rf ./part*
cat >part.toml <<END
druse = 1
unit = "mm"
[cell.strut]
graph = "bcc"
volume_fraction = 0.15
[scaffold]
box = { size = [5, 5, 5], cell_size = 2.5 }
[tiling]
cell = "strut"
[band]
voxel_size = 0.05
[[op]]
mean = 1
[[op]]
keep_largest = true
[[output]]
vdb = "part.vdb"
END
hash_of() { "$druse" info --json "$1" | python3 -c 'import json, sys; print(json.load(sys.stdin)["content_hash"])'; }
"$druse" run part.toml --quiet --out part_whole
wanted=$(hash_of part_whole/part.vdb)
"$druse" plan part.toml -o part.json --bricks 2 --threads 1 --emit openjd --emit parallel
DRUSE=$druse sh part.parallel.sh --jobs 2
[ "$(hash_of part.vdb)" = "$wanted" ]
rm -r part.vdb part.bricks
"$openjd" check part.openjd.json
"$openjd" run part.openjd.json -p "Druse=$druse" | tail -n 5
[ "$(hash_of part.vdb)" = "$wanted" ]
echo "figure: GNU parallel and openjd run, 8 bricks | content hash equal | equal"
