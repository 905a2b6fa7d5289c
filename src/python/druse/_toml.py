"""Python values as TOML, the language of recipes."""

from __future__ import annotations

import json
import math
import os
import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ._errors import ArgumentError

_BARE_KEY = re.compile("[A-Za-z0-9_-]+")


def _key(key: object) -> str:
    if not isinstance(key, str):
        raise ArgumentError(f"found the key {key!r}; expected a string")
    return key if _BARE_KEY.fullmatch(key) else value(key)


def value(item: Any) -> str:
    """Return a value as TOML; tables are inline."""
    if isinstance(item, (bool, np.bool_)):
        return "true" if item else "false"
    if isinstance(item, (int, np.integer)):
        return str(int(item))
    if isinstance(item, (float, np.floating)):
        number = float(item)
        if math.isnan(number):
            return "nan"
        return repr(number) if math.isfinite(number) else ("inf" if number > 0 else "-inf")
    if isinstance(item, os.PathLike):
        return value(os.fspath(item))
    if isinstance(item, str):
        # JSON escapes DEL and surrogates in a way that TOML does not read.
        if "\x7f" in item or any(0xD800 <= ord(c) < 0xE000 for c in item):
            raise ArgumentError(f"found the text {item!r}; expected printable characters")
        return json.dumps(item, ensure_ascii=False)
    if isinstance(item, Mapping):
        return "{ " + ", ".join(f"{_key(k)} = {value(v)}" for k, v in item.items()) + " }" if item else "{}"
    if isinstance(item, np.ndarray):
        return value(item.tolist())
    if isinstance(item, Sequence) and not isinstance(item, (bytes, bytearray)):
        return "[" + ", ".join(value(v) for v in item) + "]"
    raise ArgumentError(
        f"found {item!r} of type {type(item).__name__}; expected numbers, texts, lists and mappings"
    )


def table(keys: Mapping[str, Any]) -> str:
    """Return a mapping as the text of a TOML document; keys without a value (None) are left out."""
    lines = [f"{_key(k)} = {value(v)}\n" for k, v in keys.items() if v is not None]
    return "".join(lines)


def document(keys: Mapping[str, Any]) -> str:
    """Return a recipe as a TOML document: sections as tables, so that errors have useful lines."""
    plain = {k: v for k, v in keys.items() if not _is_section(v)}
    text = table(plain)
    for name, section in keys.items():
        if not _is_section(section):
            continue
        if isinstance(section, Mapping):
            nested = {k: v for k, v in section.items() if isinstance(v, Mapping) and name in ("cell", "crystal")}
            own = {k: v for k, v in section.items() if k not in nested}
            if own or not nested:
                text += f"\n[{_key(name)}]\n{table(own)}"
            for key, entry in nested.items():
                text += f"\n[{_key(name)}.{_key(key)}]\n{table(entry)}"
        else:
            for entry in section:
                text += f"\n[[{_key(name)}]]\n{table(entry)}"
    return text


def _is_section(item: Any) -> bool:
    if isinstance(item, Mapping):
        return True
    return isinstance(item, (list, tuple)) and len(item) > 0 and all(isinstance(v, Mapping) for v in item)
