"""Checks and conversions of arguments."""

from __future__ import annotations

import logging
import operator
from collections.abc import Callable, Iterable
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from ._errors import ArgumentError

Floats = npt.NDArray[np.float64]
Progress = Callable[[str, int, "int | None"], object]
"""Called with the stage, the units of work done and their number, if it is known."""

logger = logging.getLogger("druse")
logger.addHandler(logging.NullHandler())
T = TypeVar("T", bound=np.generic)

_NUMBERS = "biuf"


def numeric(values: object, name: str, dtype: type[T]) -> npt.NDArray[T]:
    """Return a contiguous array of `dtype`; a copy only if the argument is not one already."""
    try:
        array = np.asarray(values)
    except (ValueError, TypeError) as error:
        raise ArgumentError(f"{name} is no array: {error}") from error
    if array.dtype.kind not in _NUMBERS:
        raise ArgumentError(f"{name} has the type {array.dtype}; expected real numbers")
    if np.issubdtype(dtype, np.integer) and array.dtype.kind == "f":
        raise ArgumentError(f"{name} has the type {array.dtype}; expected integers")
    if np.issubdtype(dtype, np.integer) and array.size:
        limits = np.iinfo(dtype)  # type: ignore[type-var]
        low, high = int(array.min()), int(array.max())
        if low < limits.min or high > limits.max:
            worst = low if low < limits.min else high
            raise ArgumentError(f"{name} holds {worst}; expected {limits.min} to {limits.max}")
    return np.require(array, dtype=dtype, requirements=["C_CONTIGUOUS", "ALIGNED"])


def points_of(points: object, name: str = "points") -> tuple[Floats, tuple[int, ...]]:
    """Return points [..., 3] as [n, 3], and the shape without the last axis."""
    array = numeric(points, name, np.float64)
    if array.ndim == 0 or array.shape[-1] != 3:
        raise ArgumentError(f"{name} has the shape {list(array.shape)}; expected [..., 3]")
    return array.reshape(-1, 3), array.shape[:-1]


def shaped(values: npt.NDArray[T], shape: tuple[int, ...]) -> Any:
    """Return values in the shape of the points; a scalar for one point."""
    return values[0] if shape == () else values.reshape(shape)


def finite(value: object, name: str) -> float:
    """Return a finite number."""
    try:
        number = float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError) as error:
        raise ArgumentError(f"{name} is {value!r}; expected a number") from error
    if not np.isfinite(number):
        raise ArgumentError(f"{name} is {number}; expected a finite number")
    return number


def positive(value: object, name: str) -> float:
    """Return a finite number above 0."""
    number = finite(value, name)
    if number <= 0:
        raise ArgumentError(f"{name} is {number}; expected a number above 0")
    return number


# Limits of a band's half width, voxels, as in recipes; builders take less than 1.5 too.
_HALF_WIDTHS = (1.0, 64.0)


def half_width_of(value: object) -> float:
    """Return a half width of a band in voxels."""
    number = finite(value, "half_width")
    low, high = _HALF_WIDTHS
    if not low <= number <= high:
        raise ArgumentError(f"half_width is {number} voxels; expected {low:g} to {high:g}")
    return number


def count(value: object, name: str) -> int:
    """Return an integer from 0 to 2^31 - 1."""
    try:
        number = operator.index(value)  # type: ignore[arg-type]
    except TypeError as error:
        raise ArgumentError(f"{name} is {value!r}; expected an integer") from error
    if not 0 <= number < 1 << 31:
        raise ArgumentError(f"{name} is {number}; expected 0 to 2147483647")
    return number


def box(bounds: object, name: str = "bounds") -> list[list[float]]:
    """Return a box as [[x, y, z], [x, y, z]]."""
    array = numeric(bounds, name, np.float64)
    if array.shape != (2, 3):
        raise ArgumentError(f"{name} has the shape {list(array.shape)}; expected [2, 3]")
    if not np.isfinite(array).all() or (array[0] > array[1]).any():
        raise ArgumentError(f"{name} is {array.tolist()}; expected two finite corners, the lower one first")
    corners: list[list[float]] = array.tolist()
    return corners


def vector(values: object, name: str) -> list[float]:
    """Return three finite numbers."""
    array = numeric(values, name, np.float64)
    if array.shape != (3,) or not np.isfinite(array).all():
        raise ArgumentError(f"{name} is {array.tolist()}; expected three finite numbers")
    numbers: list[float] = array.tolist()
    return numbers


def checked_function(function: Callable[[Floats], object], name: str) -> Callable[[Floats], Floats]:
    """Return the function with a check of the shape and the type of its values."""
    if not callable(function):
        raise ArgumentError(f"{name} is {function!r}; expected a function of points [n, 3]")

    def call(points: Floats) -> Floats:
        values = numeric(function(points), f"the value of {name}", np.float64)
        if values.shape != (len(points),):
            raise ArgumentError(
                f"the value of {name} has the shape {list(values.shape)}; expected [{len(points)}], one for each point"
            )
        return values

    return call


def read_only(array: npt.NDArray[T]) -> npt.NDArray[T]:
    """Return the array, closed to writing."""
    array.flags.writeable = False
    return array


def log(level: int, prefix: str, messages: Iterable[str]) -> None:
    """Pass messages to the logger `druse`."""
    for message in messages:
        logger.log(level, "%s: %s", prefix, message)
