"""Common parts of the tests of the Python package."""

import signal

import numpy as np
import pytest

import druse

# A shell's background job ignores it, and so would the tests of interrupts.
signal.signal(signal.SIGINT, signal.default_int_handler)


def ball_distance(points, radius=4.0):
    """Signed distance of a ball about the origin."""
    return np.linalg.norm(points, axis=1) - radius


@pytest.fixture(scope="session")
def schwarz():
    return druse.Cell.surface("schwarz_p", element="hex")


@pytest.fixture(scope="session")
def block():
    return druse.Scaffold.box([10, 10, 10], [2, 2, 2])


@pytest.fixture()
def ball():
    return druse.LevelSet.from_function(ball_distance, [[-4, -4, -4], [4, 4, 4]], 0.25)


@pytest.fixture(scope="session")
def cube_mesh():
    corners = np.array([[x, y, z] for x in (0, 2) for y in (0, 2) for z in (0, 2)], dtype=float)
    quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    faces = [t for q in quads for t in ([q[0], q[1], q[2]], [q[0], q[2], q[3]])]
    return druse.Mesh(corners, faces)
