#!/usr/bin/env bash
# A sequence of the twisting bar: velocities through pyopenvdb, the USD scene through pxr, and GNU parallel with the same
# content hashes.
#
#     tests/clients/film.sh DRUSE DIRECTORY PYTHON_WITH_USD [FRAMES]
set -euo pipefail
druse=$(realpath "$1")
usd=$(realpath -s "$3")
last=${4:-3}
here=$(realpath "$(dirname "$0")")
rm -rf "$2" && mkdir -p "$2"
cp "$here/../../examples/twisting_bar/bar.toml" "$2"
cd "$2"
hash_of() { "$druse" info --json "$1" | python3 -c 'import json, sys; print(json.load(sys.stdin)["content_hash"])'; }
"$druse" run bar.toml --quiet --set band.voxel_size=1 --out whole --frames "1-$last"
"$druse" run bar.toml --quiet --set band.voxel_size=1 --out whole --frames "1-$last" | tail -n 1 | grep "0 frames made"
/usr/bin/python3 "$here/film_pyopenvdb.py" whole 1 "$last"
"$usd" "$here/usda_sequence.py" whole/bar.usda 1 "$last" 24
"$druse" plan bar.toml --set band.voxel_size=1 --quiet --out farm --frames "1-$last" -o bar.json --emit parallel
DRUSE=$druse sh bar.parallel.sh --jobs 2 >/dev/null
for frame in 1 "$last"; do
    name=$(printf 'bar.%04d.vdb' "$frame")
    [ "$(hash_of "whole/$name")" = "$(hash_of "farm/$name")" ]
done
cmp whole/bar.usda farm/bar.usda
echo "figure: GNU parallel, $last frames | content hashes equal | equal"
