"""Arrays of points and meshes, checked and written as the bytes of a PLY file.

A scene is loaded from these bytes as the program loads a file, so that both give the same image.
"""

from __future__ import annotations

import numbers
import re
from dataclasses import dataclass, field
from typing import Any

from ._errors import InputError, UsageError

_TYPES = {"i1": "char", "u1": "uchar", "i2": "short", "u2": "ushort", "i4": "int", "u4": "uint", "f4": "float",
          "f8": "double"}
# Property names to which the reader of PLY files gives a meaning, so that no attribute may have them.
_RESERVED = frozenset(
    "x y z nx ny nz red green blue alpha r g b a rgb rgba radius radii su sv sw tu tv tw s t u v texture_u texture_v"
    " normal_x normal_y normal_z normalx normaly normalz normals_x normals_y normals_z n_x n_y n_z diffuse_red"
    " diffuse_green diffuse_blue color_r color_g color_b rf gf bf scan_red scan_green scan_blue opacity filter_3d"
    " clip_mode clip_theta1 clip_theta3 clip_u clip_v clip_w packed_position packed_color vertex_indices vertex_index"
    " texnumber texcoord".split()
)
_NUMBERED = re.compile(r"(scale|rot|f_dc|f_rest|clip_line)_?\d+(_[abc])?")
_CHANNELS = ("red", "green", "blue", "alpha")
# Largest excess of a colour over 1 that counts as rounding.
_ROUNDING = 1e-3
# Number of rows whose colours are decoded at once, which limits the memory.
_BLOCK = 1 << 20


@dataclass
class Arrays:
    """Points or a mesh as arrays, with notes on how they were found. Attributes have a row for each point or face, and
    any number of columns."""

    points: Any
    normals: Any = None
    colors: Any = None
    radii: Any = None
    attributes: dict = field(default_factory=dict)
    faces: Any = None
    face_colors: Any = None
    face_attributes: dict = field(default_factory=dict)
    up: str | None = None
    notes: list[str] = field(default_factory=list)


def with_given(arrays: Arrays, given: dict) -> Arrays:
    """Replaces arrays by those in `given`, and returns the result. Attributes are added to points or to faces,
    depending on their number of rows."""
    for name, value in given.items():
        if name != "attributes":
            setattr(arrays, name, value)
    if "faces" in given:
        arrays.face_colors, arrays.face_attributes = None, {}
    if "colors" in given:
        arrays.face_colors = None
    for name, value in dict(given.get("attributes") or {}).items():
        value = array(f"attributes[{name!r}]", value)
        rows = len(value) if value.ndim else None
        is_of_faces = arrays.faces is not None and rows == len(arrays.faces) != len(arrays.points)
        (arrays.face_attributes if is_of_faces else arrays.attributes)[name] = value
    return arrays


def array(name: str, value):
    """Returns the value as an array of real numbers, with any strides. Masked and missing values become NaN."""
    import numpy as np

    if np.ma.isMaskedArray(value):
        if np.ma.is_masked(value):
            # The data under a mask mean nothing.
            kind = value.dtype if value.dtype.kind == "f" else np.float64
            value = value.astype(kind).filled(np.nan)
        else:
            value = value.data
    elif not isinstance(value, np.ndarray):
        value = _unwrapped(value)
    try:
        found = np.asarray(value)
    except (TypeError, ValueError) as error:
        raise TypeError(f"{name}: a {_type(value)} can't become an array: {error}") from None
    if found.dtype.kind == "O" and found.ndim:
        flat = [np.nan if _is_missing(item) else item for item in found.flat]
        if all(isinstance(item, numbers.Real) for item in flat):
            found = np.array(flat, dtype=np.float64).reshape(found.shape)
    if found.dtype.kind not in "biuf":
        what = f"dtype {found.dtype}" if isinstance(value, (np.ndarray, list, tuple)) else f"a {_type(value)}"
        others = ", or a mesh, cloud or table of trimesh, PyVista, Open3D, laspy or pandas" if name == "points" else ""
        raise TypeError(f"{name}: {what}, expected an array of real numbers{others}")
    return found.astype(np.float32) if found.dtype == np.float16 else found


def _unwrapped(value):
    """Returns a tensor of torch, TensorFlow, CuPy or Open3D, or a column of pandas, Polars or Arrow, as a NumPy array.
    Other values are returned unchanged."""
    for method in ("detach", "cpu", "resolve_conj", "resolve_neg"):
        if hasattr(value, method) and hasattr(value, "numpy"):
            value = getattr(value, method)()
    if hasattr(value, "numpy"):
        try:
            return value.numpy()
        except TypeError:  # bfloat16 of torch
            return value.float().numpy() if hasattr(value, "float") else value
    if hasattr(value, "__cuda_array_interface__") and hasattr(value, "get"):
        return value.get()
    if hasattr(value, "to_numpy"):
        try:
            return value.to_numpy()
        except Exception:  # noqa: BLE001: Arrow copies only if asked to, and its exceptions are its own
            return value.to_numpy(zero_copy_only=False)
    return value


def _is_missing(value) -> bool:
    return value is None or type(value).__name__ == "NAType"


def _type(value) -> str:
    kind = type(value)
    return kind.__name__ if kind.__module__ == "builtins" else f"{kind.__module__}.{kind.__name__}"


def _kind(dtype) -> str:
    """Returns the NumPy code of the PLY type that stores these numbers; 64-bit integers become double."""
    if dtype.kind == "b":
        return "u1"
    code = f"{dtype.kind}{dtype.itemsize}"
    return code if code in _TYPES else "f8"


def _rows(name: str, value, widths: tuple[int, ...], count: int | None, of: str = "points"):
    found = array(name, value)
    if found.ndim != 2 or found.shape[1] not in widths:
        raise InputError(f"{name}: shape {found.shape}, expected (n, {' or '.join(map(str, widths))})")
    if count is not None and len(found) != count:
        raise InputError(f"{name}: {len(found)} rows, expected {count}, as many as {of}")
    return found


def _first(wrong) -> int:
    """Returns the index of the first row with a true value in `wrong`."""
    import numpy as np

    return int(np.argmax(wrong if wrong.ndim == 1 else wrong.any(axis=1)))


def _expect(name: str, right, values, expected: str) -> None:
    """Raises InputError unless all values are `right`. The message names the first row that isn't."""
    if not right.all():
        row = _first(~right)
        import numpy as np

        text = np.array2string(np.asarray(values[row]), precision=6, separator=", ", threshold=8)
        what = "NaN, infinite or masked" if not np.isfinite(values[row]).all() else text
        raise InputError(f"{name}: row {row} is {what}, expected {expected}")


def _finite(values):
    import numpy as np

    return np.isfinite(values) if values.dtype.kind == "f" else np.ones(values.shape, bool)


def _radii(value, count: int, repair: bool):
    import numpy as np

    found = array("radii", value)
    if found.ndim == 0:
        found = np.broadcast_to(found, (count,))
    if found.ndim == 2 and found.shape[1] == 1:
        found = found[:, 0]
    if found.shape != (count,):
        raise InputError(f"radii: shape {found.shape}, expected ({count},), as many as points, or a number")
    if not repair:
        with np.errstate(invalid="ignore"):
            _expect("radii", _finite(found) & (found > 0), found,
                    "finite numbers greater than 0 (repair=True leaves such points out)")
    return found


def decoded(colors):
    """Returns sRGB-encoded colours from 0 to 1 as linear light, in float32."""
    import numpy as np

    linear = np.empty(colors.shape, np.float32)
    for start in range(0, len(colors), _BLOCK):
        part = np.asarray(colors[start : start + _BLOCK], dtype=np.float64)
        linear[start : start + _BLOCK] = np.where(part <= 0.04045, part / 12.92, ((part + 0.055) / 1.055) ** 2.4)
    return linear


def _colors(name: str, value, count: int, linear: bool, notes: list[str], of: str = "points"):
    """Checks colours. Returns them as a PLY file stores them (levels or linear floats), and their type."""
    import numpy as np

    found = _rows(name, value, (3, 4), count, of)
    _expect(name, _finite(found), found, "numbers: leave such points out, or give them a colour")
    kind, most = found.dtype.kind, float(found.max(initial=0))
    if kind == "f":
        least = "0 or more" if linear else "0 to 1"
        _expect(name, found >= 0, found, least)
        if not linear and most > 1 + _ROUNDING:
            raise InputError(f"{name}: floats up to {most:g}, expected 0 to 1, as displayed: give 0 to 255 as uint8,"
                             " 0 to 65535 as uint16, or light with linear=True")
        if found.shape[1] == 4:
            _expect(f"{name}: alpha", found[:, 3] <= 1 + _ROUNDING, found[:, 3], "0 to 1")
            alpha = np.minimum(found[:, 3:], 1).astype(np.float32)
        rgb = found[:, :3].astype(np.float32) if linear else decoded(np.minimum(found[:, :3], 1))
        return (rgb if found.shape[1] == 3 else np.concatenate([rgb, alpha], axis=1)), "f4"
    if linear:
        raise UsageError(f"linear: is for floats, and {name} are {found.dtype}, which are sRGB-encoded: leave it out")
    if kind == "b":
        raise InputError(f"{name}: dtype bool, expected uint8 or uint16, or floats from 0 to 1")
    _expect(name, found >= 0, found, "0 to 255 or 0 to 65535")
    if most > 65535:
        raise InputError(f"{name}: up to {most:.0f}, expected at most 255 or 65535")
    if found.dtype == np.uint8:
        return found, "u1"
    bits = 8 if most <= 255 else 16
    if found.dtype != np.uint16 or 0 < most <= 255:
        notes.append(f"{name}: took {found.dtype} up to {most:.0f} as levels of {bits} bits")
    return (found.astype(np.uint8), "u1") if bits == 8 else (found.astype(np.uint16), "u2")


def _attributes(name: str, given, count: int, taken: set[str], of: str):
    """Returns the columns of attributes, with their names and types in the file. An attribute of several numbers
    becomes a column for their length, and a column for each number."""
    import numpy as np

    columns = []

    def add(key, values):
        word = re.sub(r"\W+", "_", str(key)).strip("_") or "attribute"
        if not word.isidentifier():
            word = f"_{word}"
        # The reader finds an attribute by its name's letters and digits, whatever stands between them.
        while word.lower() in taken or word.lower() in _RESERVED or _NUMBERED.fullmatch(word.lower()):
            word += "_"
        taken.add(word.lower())
        columns.append((word, _kind(values.dtype), values))

    for key, value in given.items():
        values = array(f"{name}[{key!r}]", value)
        if values.ndim == 0 or len(values) != count:
            raise InputError(f"{name}[{key!r}]: shape {values.shape}, expected ({count},), as many as {of}")
        values = values.reshape(count, -1)
        if values.shape[1] == 1:
            add(key, values[:, 0])
        elif values.shape[1] > 1:
            add(key, np.linalg.norm(values.astype(np.float64), axis=1))
            parts = "xyz" if values.shape[1] == 3 else range(values.shape[1])
            for i, part in enumerate(parts):
                add(f"{key}_{part}", values[:, i])
    return columns


def _vertex_columns(arrays: Arrays, linear: bool, repair: bool):
    points = _rows("points", arrays.points, (3,), None)
    count = len(points)
    if count == 0:
        raise InputError("points: holds no point, expected one at least")
    columns = [(axis, "f4" if points.dtype == "f4" else "f8", points[:, i]) for i, axis in enumerate("xyz")]
    if arrays.normals is not None:
        normals = _rows("normals", arrays.normals, (3,), count)
        if arrays.radii is not None and not repair:
            _expect("normals", _finite(normals), normals, "directions (repair=True leaves such points out)")
        kind = "f8" if normals.dtype.itemsize == 8 else "f4"
        columns += [(f"n{axis}", kind, normals[:, i]) for i, axis in enumerate("xyz")]
    if arrays.colors is not None:
        colors, kind = _colors("colors", arrays.colors, count, linear, arrays.notes)
        columns += [(name, kind, column) for name, column in zip(_CHANNELS, colors.T)]
    if arrays.radii is not None:
        radii = _radii(arrays.radii, count, repair)
        columns.append(("radius", "f8" if radii.dtype.itemsize == 8 else "f4", radii))
    return columns + _attributes("attributes", arrays.attributes, count, set(), "points"), count


def _face_columns(arrays: Arrays, count: int, linear: bool):
    import numpy as np

    faces = _rows("faces", arrays.faces, (3, 4), None)
    if faces.dtype.kind not in "iu":
        raise InputError(f"faces: dtype {faces.dtype}, expected whole numbers")
    if len(faces) == 0:
        raise InputError("faces: holds no face, expected one at least: leave them out for points")
    if int(faces.min()) < 0 or int(faces.max()) >= count:
        raise InputError(f"faces: from {faces.min()} to {faces.max()}, expected rows of points, 0 to {count - 1}")
    columns = []
    if arrays.face_colors is not None:
        colors, kind = _colors("face_colors", arrays.face_colors, len(faces), linear, arrays.notes, "faces")
        columns += [(name, kind, column) for name, column in zip(_CHANNELS, colors.T)]
    columns += _attributes("attributes", arrays.face_attributes, len(faces), set(), "faces")
    return faces.astype(np.int32, copy=False), columns


def to_ply(arrays: Arrays, linear: bool = False, repair: bool = False):
    """Copies the arrays to a PLY file. Returns its bytes as an array of uint8, and the number of points."""
    import numpy as np

    columns, count = _vertex_columns(arrays, linear, repair)
    header = [f"element vertex {count}", *(f"property {_TYPES[kind]} {name}" for name, kind, _ in columns)]
    vertex = np.dtype([(name, "<" + kind) for name, kind, _ in columns])
    faces, face_columns, face = (), [], np.dtype([])
    if arrays.faces is not None:
        faces, face_columns = _face_columns(arrays, count, linear)
        header += [f"element face {len(faces)}", "property list uchar int vertex_indices"]
        header += [f"property {_TYPES[kind]} {name}" for name, kind, _ in face_columns]
        lists = [("corners", "u1"), ("corner", "<i4", faces.shape[1])]
        face = np.dtype(lists + [(f"property {name}", "<" + kind) for name, kind, _ in face_columns])
    # Whole numbers are sRGB-encoded whatever a comment says.
    comments = ["comment colors linear"] if ("red", "f4") in ((c[0], c[1]) for c in columns + face_columns) else []
    # Radii don't change which axis is up.
    comments += ["comment made of points"] if arrays.faces is None else []
    comments += [] if arrays.up is None else [f"comment up {arrays.up}"]
    head = "\n".join(["ply", "format binary_little_endian 1.0", *comments, *header, "end_header\n"]).encode()
    end = len(head) + count * vertex.itemsize
    data = np.empty(end + len(faces) * face.itemsize, np.uint8)
    data[: len(head)] = np.frombuffer(head, np.uint8)
    table = data[len(head) : end].view(vertex)
    for name, _, values in columns:
        table[name] = values
    if len(faces):
        rows = data[end:].view(face)
        rows["corners"], rows["corner"] = faces.shape[1], faces
        for name, _, values in face_columns:
            rows[f"property {name}"] = values
    return data, count
