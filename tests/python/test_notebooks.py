"""The notebooks run from top to bottom; those whose packages are not installed are skipped."""

import importlib.util
import json
import os
import pathlib
import subprocess
import sys

import pytest

FOLDER = pathlib.Path(__file__).resolve().parents[2] / "examples" / "notebooks"
NOTEBOOKS = sorted(FOLDER.glob("*.ipynb"))


def test_there_are_three():
    assert len(NOTEBOOKS) == 3


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda p: p.stem)
def test_a_notebook_runs(path, tmp_path):
    notebook = json.loads(path.read_text())
    for name in notebook["metadata"]["druse"]["needs"]:
        if importlib.util.find_spec(name) is None:
            pytest.skip(f"{name} is not installed")
    cells = ["".join(c["source"]) for c in notebook["cells"] if c["cell_type"] == "code"]
    assert all(not c.get("outputs") for c in notebook["cells"]), "outputs stay out of the repository"
    # A notebook shows the last value of a cell; its pictures are made here too.
    lines = ["import ast, os", f"cells = {cells!r}", "space = {}"]
    lines += [
        "for cell in cells:",
        "    tree = ast.parse(cell)",
        "    last = tree.body.pop() if tree.body and isinstance(tree.body[-1], ast.Expr) else None",
        "    exec(compile(tree, 'cell', 'exec'), space)",
        "    if last is not None:",
        "        value = eval(compile(ast.Expression(last.value), 'cell', 'eval'), space)",
        "        getattr(value, '_repr_png_', lambda: None)(), getattr(value, '_repr_html_', lambda: None)()",
    ]
    (tmp_path / "bracket").symlink_to(FOLDER.parent / "bracket")
    work = tmp_path / "notebooks"
    work.mkdir()
    environment = {**os.environ, "PYVISTA_OFF_SCREEN": "true"}
    done = subprocess.run([sys.executable, "-c", "\n".join(lines)], cwd=work, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-3000:]
