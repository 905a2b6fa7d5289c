"""Effective properties and designed cells, against closed forms and the command line."""

import json
import logging
import os
import pickle
import signal
import subprocess
import sys
import threading
import time

import numpy as np
import pytest

import druse

TARGET = {"maximise": "bulk", "starts": 1, "evaluations": 12, "voxels": 10}


def test_tensors_have_cubic_form_and_keep_the_bounds():
    cell = druse.Cell.surface("schwarz_p", element="hex").with_volume_fraction(0.4)
    found = cell.homogenize(16)
    c = found["stiffness"]
    assert c.shape == (6, 6) and np.allclose(c, c.T)
    assert np.allclose(np.diag(c), [c[0, 0]] * 3 + [c[3, 3]] * 3)
    assert found["conductivity"].shape == (3, 3) and found["permeability"].shape == (3, 3)
    assert found["volume_fraction"] == pytest.approx(0.4, abs=2e-3)
    # Hashin and Shtrikman's upper bound of the bulk modulus, void almost without stiffness.
    bulk, shear, share = 1 / (3 * 0.4), 1 / 2.6, found["volume_fraction"]
    weak = 1e-4 * bulk
    bound = bulk + (1 - share) / (1 / (weak - bulk) + 3 * share / (3 * bulk + 4 * shear))
    assert found["bounds"]["bulk"][1] == pytest.approx(bound, rel=1e-9)
    own = (c[0, 0] + 2 * c[0, 1]) / 3
    assert found["over_bounds"]["bulk"] == pytest.approx(own / bound) and own < bound
    # Units of the solid: the stiffness scales with its modulus.
    scaled = cell.homogenize(16, young=110e3, kappa=7, only=["stiffness", "conductivity"])
    assert np.allclose(scaled["stiffness"] / 110e3, c, rtol=1e-4) and scaled["permeability"] is None
    assert np.allclose(scaled["conductivity"] / 7, found["conductivity"], rtol=1e-4)


def test_a_laminate_has_its_closed_form():
    """Layers across z: conductivities in series across them, in parallel along them."""
    cell = druse.Cell.formula("0.3 - cos(2*pi*z)", element="hex", group="D4h", band_limit=2)
    found = cell.homogenize(32, void=0.5, only="conductivity", sharp=True)
    share, k = found["volume_fraction"], found["conductivity"]
    assert 0.2 < share < 0.6
    assert k[2, 2] == pytest.approx(1 / (share + (1 - share) / 0.5), rel=1e-6)
    assert k[1, 1] == pytest.approx(share + 0.5 * (1 - share), rel=1e-6)


@pytest.mark.parametrize("arguments, make", [
    (["schwarz_p", "--element", "hex", "--volume-fraction", "0.3"],
     lambda: druse.Cell.surface("schwarz_p", element="hex", volume_fraction=0.3)),
    (["octet", "--element", "hex", "--radius", "0.12"], lambda: druse.Cell.graph("octet", element="hex", radius=0.12)),
])
def test_the_numbers_are_those_of_the_command_line(arguments, make):
    program = [os.environ["DRUSE"]] if "DRUSE" in os.environ else [sys.executable, "-m", "druse"]
    command = [*program, "cell", "homogenize", *arguments, "--resolution", "16", "--json"]
    shown = json.loads(subprocess.run(command, check=True, capture_output=True).stdout)
    found = make().homogenize(16)
    for name in ("stiffness", "conductivity", "permeability"):
        assert np.array_equal(np.array(shown[name]), found[name]), name
    assert found["period"] == shown["period"]


def test_struts_are_round_unless_the_series_is_wanted(caplog):
    cell = druse.Cell.graph("octet", element="hex", radius=0.05, band_limit=4)
    with caplog.at_level(logging.WARNING, logger="druse"):
        round_beams = cell.homogenize(16, only="conductivity")
    assert any("voxels wide" in record.getMessage() for record in caplog.records)
    fitted = cell.homogenize(16, only="conductivity", fitted=True)
    assert not np.array_equal(round_beams["conductivity"], fitted["conductivity"])
    wanted = cell.with_volume_fraction(0.3).homogenize(24, only="conductivity")
    assert wanted["volume_fraction"] == pytest.approx(0.3, abs=0.005)


def test_derivatives_agree_with_differences():
    cell = druse.Cell.surface("schwarz_p", element="hex").with_volume_fraction(0.4)
    parts = {entry["part"]: entry for entry in cell.homogenize(16, gradient=True)["gradient"]}
    step = 1e-3
    low, high = (cell.with_level(cell.level + d).homogenize(16, only="conductivity") for d in (-step, step))
    slope = (high["volume_fraction"] - low["volume_fraction"]) / (2 * step)
    assert parts["level"]["volume_fraction"] == pytest.approx(slope, rel=0.05)


def test_bad_arguments_of_homogenize():
    cell = druse.Cell.surface("schwarz_p", element="hex")
    for keys, words in [
        ({"resolution": 15}, "even number"),
        ({"resolution": 1 << 20}, "expected an even number"),
        ({"resolution": 2.5}, "expected an integer"),
        ({"poisson": 0.5}, "0.5"),
        ({"young": -1}, "above 0"),
        ({"young": float("nan")}, "finite"),
        ({"void": 1}, "below 1"),
        ({"residual": 0}, "residual"),
        ({"only": "strength"}, "strength"),
        ({"only": 3}, "names of properties"),
        ({"tets": "fcc"}, "bcc or kuhn"),
    ]:
        with pytest.raises(druse.ArgumentError, match=words):
            cell.homogenize(**{"resolution": 8, **keys})
    with pytest.raises(druse.ArgumentError, match="Nyquist"):
        druse.Cell.graph("octet", element="hex", band_limit=6).homogenize(8, fitted=True)
    with pytest.raises(druse.Error, match="hex, a quad or a tet"):
        druse.Cell.graph("edges", element="wedge", band_limit=4).homogenize(16)


def test_a_target_makes_a_cell():
    cell = druse.design(TARGET, volume_fraction=0.3, band_limit=2.3)
    assert cell.volume_fraction == pytest.approx(0.3, abs=1e-4)
    design = cell.report["design"]
    assert design["complete"] and design["properties"][0]["bulk_over_bound"] > 0.3
    again = druse.design(TARGET, volume_fraction=0.3, band_limit=2.3, resume=cell)
    assert len(again.report["design"]["history"]) > len(design["history"])
    assert pickle.loads(pickle.dumps(cell)) == cell
    plain = druse.Cell.surface("schwarz_p", element="hex").with_volume_fraction(0.25)
    met = druse.design(TARGET, volume_fraction=0.4, band_limit=3.2, match=plain)
    points = np.random.default_rng(1).uniform(-0.5, 0.5, (50, 3))
    points[:, 0] = 0.5
    assert np.abs(met(points) - plain(points)).max() < 1e-9


def test_bad_targets():
    for target, keys, words in [
        ("bluk", {}, "bulk"),
        ("bulk", {"volume_fraction": 1.5}, "1.5"),
        ("bulk", {"element": "wedge"}, "wedge"),
        ({"poisson": 0.7}, {}, "0.5"),
        ("bulk", {"band_limit": 40}, "Nyquist|128"),
        ("bulk", {"start": "nothing"}, "nothing"),
        ("bulk", {"level": 0}, "expected one of band_limit"),
        ("bulk", {"solid": "above"}, "above"),
        ("bulk", {"match": [3]}, "expected cells"),
    ]:
        with pytest.raises(druse.Error, match=words):
            druse.design(target, **{"volume_fraction": 0.3, **keys})


def test_an_interrupted_search_leaves_its_best_cell(tmp_path):
    begun = threading.Event()

    def progress(stage, done, total):
        if done >= 40:
            begun.set()

    def interrupt():
        begun.wait(60)
        time.sleep(0.1)
        os.kill(os.getpid(), signal.SIGINT)

    timer = threading.Thread(target=interrupt)
    timer.start()
    target = {**TARGET, "starts": 4, "evaluations": 4000, "voxels": 16}
    with pytest.raises(KeyboardInterrupt):
        druse.design(target, volume_fraction=0.3, save=tmp_path / "best.cell", progress=progress)
    timer.join()
    best = druse.Cell.load(tmp_path / "best.cell")
    assert not best.report["design"]["complete"] and best.volume_fraction == pytest.approx(0.3, abs=1e-4)
