"""Conversion of keyword arguments to the texts of command-line flags."""

from __future__ import annotations

import json
import numbers
import os

from . import _table
from ._camera import Camera
from ._errors import UsageError

SPLATS = _table.SPLATS
RENDER = _table.RENDER | {"lights"}
CONVERT = _table.CONVERT
ORTHO = _table.ORTHO
FIGURE = _table.FIGURE
PLANES = ("color", "depth", "normal", "weight")
NEAREST = ("index", "object", "label", "position")
GAUSSIANS = ("alpha", "median_depth", "distortion")


def _number(value) -> str:
    if isinstance(value, numbers.Integral):
        return str(int(value))
    number = float(value)
    return str(int(number)) if number.is_integer() and abs(number) < 1e15 else repr(number)


def _text(name: str, value) -> str:
    if isinstance(value, str):
        return value
    if isinstance(value, (bool,)) or type(value).__name__ in ("bool_", "bool"):
        return "on" if value else "off"
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    if name == "columns":
        return columns_text(value)
    try:
        if isinstance(value, numbers.Real) or getattr(value, "ndim", None) == 0:
            return _number(value)
        return _table.SEPARATORS.get(name, ",").join(_number(part) for part in value)
    except (TypeError, ValueError):
        raise TypeError(f"{name}: a {type(value).__name__}, expected text, a number or numbers") from None


def columns_text(value) -> str | None:
    """Returns the names of a table's columns as one text. None in a list skips a column."""
    if value is None or isinstance(value, str):
        return value
    try:
        return ",".join("_" if name is None else name for name in value)
    except TypeError:
        raise TypeError(f"columns: a {type(value).__name__}, expected text such as 'x,y,z,_,r,g,b', or names") from None


def _near(name: str, known: frozenset) -> str | None:
    """Keyword of similar meaning, else of similar spelling."""
    import difflib

    meant = (keyword for synonym, keyword in _table.SYNONYMS if synonym == name and keyword in known)
    return next(meant, None) or next(iter(difflib.get_close_matches(name, known, 1)), None)


def texts(given: dict, known: frozenset, where: str) -> list[tuple[str, str]]:
    """Returns pairs of a flag's name and its text. Arguments that are None are omitted."""
    for name in given:
        if name not in known:
            near = _near(name, known)
            help = f": did you mean {near}?" if near else f", expected some of {', '.join(sorted(known))}"
            raise TypeError(f"{where}() got an unexpected keyword argument '{name}'{help}")
    pairs = []
    for name, value in given.items():
        if value is None:
            continue
        # Each condition and each text is a flag of its own.
        if name in ("where", "text_at") and isinstance(value, (list, tuple)):
            pairs += [(name.replace("_", "-"), _text(name, one)) for one in value if one is not None]
        elif name == "camera" and isinstance(value, (Camera, dict)):
            camera = value if isinstance(value, Camera) else Camera.from_dict(value)
            pairs.append(("camera-object", json.dumps(camera.to_dict())))
        elif name == "lights":
            pairs.append(("lights", _lights(value)))
        else:
            pairs.append((name.replace("_", "-"), _text(name, value)))
    return pairs


def _lights(lights) -> str:
    """Returns lights in the JSON format of a scene file."""
    def plain(value):
        if hasattr(value, "tolist"):  # NumPy
            return value.tolist()
        raise TypeError

    if isinstance(lights, dict):
        lights = [lights]
    try:
        return json.dumps(list(lights), default=plain, allow_nan=False)
    except (TypeError, ValueError):
        expected = '[{"directional": {"direction": [0, 0, -1], "color": [1, 1, 1], "shadow": True}}]'
        what = f"lights: {lights!r}, expected a list of objects as in a scene file, such as {expected}"
        raise UsageError(what) from None


def planes_of(planes) -> list[str]:
    """Returns names of planes. None means all planes but those of the nearest surface and of Gaussians."""
    if planes is None:
        return list(PLANES)
    names = [planes] if isinstance(planes, str) else list(planes)
    for name in names:
        if name not in PLANES + NEAREST + GAUSSIANS:
            raise UsageError(f"planes: {name!r}, expected some of {', '.join(PLANES + NEAREST + GAUSSIANS)}")
    return names
