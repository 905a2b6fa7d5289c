"""Recipes from Python, beside the command line."""

import json
import logging
import os
import pathlib
import pickle
import shutil
import subprocess
import sys

import pytest

import druse

EXAMPLES = pathlib.Path(__file__).resolve().parents[2] / "examples"
BALL = {"druse": 1, "band": {"voxel_size": 0.25}, "op": [{"union": {"sphere": {"radius": 5}}}]}


def program():
    """The command line: the one that DRUSE names, or that of the package."""
    return [os.environ["DRUSE"]] if "DRUSE" in os.environ else [sys.executable, "-m", "druse"]


def test_a_mapping_is_a_recipe():
    part = druse.run(BALL)
    assert part.volume == pytest.approx(4 / 3 * 3.14159265 * 125, rel=0.005)
    assert part.report["solid"]["volume"] == pytest.approx(part.volume, rel=0.01)
    finer = druse.run(BALL, set={"band.voxel_size": 0.5, "op.0.union.sphere.radius": "4mm"})
    assert finer.voxel_size == 0.5 and finer.report["solid"]["volume"] < 300


def test_a_recipe_is_a_mapping_again():
    recipe = druse.Recipe(BALL)
    assert recipe.to_dict() == BALL
    assert druse.Recipe(recipe.to_dict()).to_dict() == BALL
    assert druse.Recipe.parse(recipe.text).to_dict() == BALL
    for path in sorted(EXAMPLES.glob("*.toml")):
        own = druse.Recipe(path)
        assert druse.Recipe.parse(own.text).to_dict() == own.to_dict()
    again = pickle.loads(pickle.dumps(druse.Recipe(BALL, set={"band.voxel_size": 0.5})))
    assert again.run().voxel_size == 0.5
    assert recipe.estimate()["active_voxels"] > 0


@pytest.mark.parametrize("name", ["schwarz_block", "strut_block"])
def test_the_same_content_hash_as_the_command_line(name, tmp_path):
    recipe = EXAMPLES / f"{name}.toml"
    druse.run(recipe, set={"band.voxel_size": 0.4}, out=tmp_path / "python")
    command = [*program(), "run", str(recipe), "--set", "band.voxel_size=0.4", "--out", str(tmp_path / "program")]
    subprocess.run([*command, "--quiet"], check=True)
    (made,) = (tmp_path / "program").glob("*.vdb")

    def content_hash(path):
        shown = subprocess.run([*program(), "info", "--json", str(path)], check=True, capture_output=True)
        return json.loads(shown.stdout)["content_hash"]

    assert content_hash(made) == content_hash(tmp_path / "python" / made.name)


def test_errors_have_places_and_advice(tmp_path):
    path = tmp_path / "wrong.toml"
    path.write_text("druse = 1\n[band]\nvoxel_sise = 0.2\n")
    with pytest.raises(druse.RecipeError) as caught:
        druse.run(path)
    error = caught.value
    assert (error.line, error.file) == (3, str(path)) and error.hint == 'did you mean "voxel_size"?'
    said = subprocess.run([*program(), "run", str(path)], capture_output=True, text=True)
    assert said.returncode == 65 and error.message in said.stderr and error.hint in said.stderr
    assert f"{path}:3" in str(error)
    again = pickle.loads(pickle.dumps(error))
    assert again.line == 3 and str(again) == str(error)
    with pytest.raises(druse.RecipeError) as caught:
        druse.run({"druse": 1, "bnad": {}})
    assert caught.value.hint == 'did you mean "band"?'
    with pytest.raises(druse.RecipeError) as caught:
        druse.Cell.graph("octet", raduis=0.1)
    assert caught.value.hint == 'did you mean "radius"?'
    with pytest.raises(druse.FileError):
        druse.run(tmp_path / "none.toml")
    with pytest.raises(druse.FileError):
        druse.Scaffold.read(tmp_path / "none.msh")
    with pytest.raises(druse.ArgumentError, match="expected numbers"):
        druse.run({**BALL, "x": object()})


def test_warnings_go_to_the_logger(caplog):
    ball = {"sphere": {"radius": 2, "centre": [20, 0, 0]}}
    with caplog.at_level(logging.INFO, logger="druse"):
        part = druse.run({**BALL, "op": [*BALL["op"], {"union": ball}]})
    assert part.report["solid"]["components"] == 2
    warnings = [r for r in caplog.records if r.levelno == logging.WARNING]
    assert any("W106" in r.getMessage() for r in warnings), caplog.text
    assert all(r.name == "druse" for r in caplog.records)


def test_progress_is_a_function():
    seen = []
    druse.run(BALL, set={"band.voxel_size": 0.04}, progress=lambda *stage: seen.append(stage))
    assert seen and all(len(s) == 3 and isinstance(s[0], str) for s in seen)
    with pytest.raises(ZeroDivisionError):
        druse.run(BALL, set={"band.voxel_size": 0.02}, progress=lambda *_: 1 // 0)


def test_the_program_comes_with_the_package():
    version = subprocess.run([sys.executable, "-m", "druse", "--version"], capture_output=True, text=True, check=True)
    assert version.stdout.split() == ["druse", druse.__version__]
    assert subprocess.run([sys.executable, "-m", "druse", "nothing"], capture_output=True).returncode == 2
    entry = shutil.which("druse", path=os.path.dirname(sys.executable))
    assert entry and subprocess.run([entry, "--version"], capture_output=True, text=True).stdout == version.stdout


def test_the_schema_is_that_of_the_program():
    assert druse.schema()["title"] == "Druse recipe"


def test_decisions_go_to_the_logger(caplog):
    with caplog.at_level(logging.DEBUG, logger="druse"):
        druse.run(BALL)
    shown = {r.name: r.getMessage() for r in caplog.records}
    assert shown["druse.run"] == "run in memory: the prediction fits", shown


def test_unmet_requirements_are_logged(caplog):
    recipe = {
        "druse": 1, "band": {"voxel_size": 0.5}, "op": [{"union": {"sphere": {"radius": 5}}}],
        "require": {"least_wall": 50},
    }
    with caplog.at_level("WARNING", "druse"):
        part = druse.run(recipe)
    assert "require least_wall" in caplog.text and not part.report["requirements"][0]["met"]
    with pytest.raises(druse.ArgumentError, match="mapping"):
        druse.run(recipe, set="a=1")
