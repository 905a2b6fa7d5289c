"""Exceptions, with the words, the place and the advice that the command line shows."""

from __future__ import annotations


class Error(Exception):
    """An error of Druse.

    Attributes
    ----------
    message : str
        What was found and what was expected.
    file : str or None
        The file at fault.
    line, column : int or None
        The place in it, from 1.
    element : int or None
        The element or item at fault, in the file's numbering.
    hint : str or None
        What to do.
    """

    def __init__(
        self,
        message: str,
        file: str | None = None,
        line: int | None = None,
        column: int | None = None,
        element: int | None = None,
        hint: str | None = None,
    ) -> None:
        super().__init__(message, file, line, column, element, hint)
        self.message = message
        self.file = file
        self.line = line
        self.column = column
        self.element = element
        self.hint = hint

    def __str__(self) -> str:
        place = ":".join(str(p) for p in (self.file, self.line, self.column) if p is not None)
        lines = [self.message]
        if self.file is not None or self.line is not None:
            lines.append(f"  --> {place}")
        if self.element is not None:
            lines.append(f"  --> element {self.element}")
        if self.hint is not None:
            lines.append(f"  hint: {self.hint}")
        return "\n".join(lines)


class RecipeError(Error):
    """A recipe that is not valid; `line` and `column` are places in its text."""


class FileError(Error, OSError):
    """A file that cannot be read or written; `filename` is `file`."""

    @property
    def filename(self) -> str | None:  # type: ignore[override]
        return self.file

    def __str__(self) -> str:
        return Error.__str__(self)


class ArgumentError(Error, ValueError):
    """An argument that cannot be used: its shape, its type or its value."""


_KINDS: dict[str, type[Error]] = {
    "error": Error,
    "recipe": RecipeError,
    "file": FileError,
    "argument": ArgumentError,
}


def make(
    kind: str,
    message: str,
    file: str | None,
    line: int | None,
    column: int | None,
    element: int | None,
    hint: str | None,
) -> Error:
    """Make the exception of a kind; the extension module calls this."""
    return _KINDS[kind](message, file, line, column, element, hint)
