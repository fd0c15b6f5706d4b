"""From arrays to the bytes of a PLY file, which is what a scene is loaded from: as by the program."""

from __future__ import annotations

from ._errors import InputError, UsageError

_TYPES = {"i1": "char", "u1": "uchar", "i2": "short", "u2": "ushort", "i4": "int", "u4": "uint", "f4": "float",
          "f8": "double"}


def _array(name: str, value):
    """The value as an array of NumPy, of any strides."""
    import numpy as np

    if hasattr(value, "detach"):  # torch
        value = value.detach().cpu()
    if hasattr(value, "numpy") and not isinstance(value, np.ndarray):
        value = value.numpy()
    try:
        array = np.asarray(value)
    except (TypeError, ValueError) as error:
        raise TypeError(f"{name}: can't become an array: {error}") from None
    if array.dtype.kind not in "biuf":
        raise TypeError(f"{name}: dtype {array.dtype}, expected real numbers")
    if array.dtype.kind == "f" and array.dtype.itemsize == 2:
        array = array.astype(np.float32)
    return array


def _kind(dtype) -> str:
    """The number type of PLY that holds these numbers: 64-bit whole numbers become double."""
    if dtype.kind == "b":
        return "u1"
    code = f"{dtype.kind}{dtype.itemsize}"
    return code if code in _TYPES else "f8"


def _rows(name: str, value, widths: tuple[int, ...], count: int | None):
    array = _array(name, value)
    shape = f"(n, {' or '.join(map(str, widths))})"
    if array.ndim != 2 or array.shape[1] not in widths:
        raise InputError(f"{name}: shape {array.shape}, expected {shape}")
    if count is not None and len(array) != count:
        raise InputError(f"{name}: {len(array)} rows, expected {count}, as many as points")
    return array


def _column(name: str, value, count: int, what: str = "points"):
    array = _array(name, value)
    if array.ndim == 0 and name == "radii":
        import numpy as np

        array = np.broadcast_to(array, (count,))
    if array.ndim == 2 and array.shape[1] == 1:
        array = array[:, 0]
    if array.shape != (count,):
        raise InputError(f"{name}: shape {array.shape}, expected ({count},), as many as {what}")
    return array


def _attributes(attributes, taken: set, count: int, faces: int | None):
    """Columns of the points, and of the faces: an attribute is of what there are as many of, first of the points."""
    of_points, of_faces = [], []
    for name, value in (attributes or {}).items():
        if not name.isidentifier() or name in taken:
            raise UsageError(f"attributes: {name!r} can't be the name of one, expected a word that is not taken")
        shown, array = f"attributes[{name!r}]", _array(f"attributes[{name!r}]", value)
        length = len(array) if array.ndim else None
        if faces is not None and length == faces and length != count:
            array = _column(shown, array, faces, "faces")
            of_faces.append((name, _kind(array.dtype), array))
            continue
        if faces is not None and length != count:
            raise InputError(f"{shown}: shape {array.shape}, expected ({count},), as many as points, or ({faces},), "
                             "as many as faces")
        array = _column(shown, array, count)
        of_points.append((name, _kind(array.dtype), array))
    return of_points, of_faces


def _ply_columns(points, normals, colors, radii):
    points = _rows("points", points, (3,), None)
    count = len(points)
    if count == 0:
        raise InputError("points: holds no point, expected one at least")
    columns = []

    def add(names, array, kind):
        columns.extend((name, kind, array[:, i]) for i, name in enumerate(names))

    add("xyz", points, "f4" if points.dtype.kind == "f" and points.dtype.itemsize == 4 else "f8")
    if normals is not None:
        normals = _rows("normals", normals, (3,), count)
        add(("nx", "ny", "nz"), normals, "f8" if normals.dtype.itemsize == 8 else "f4")
    elif radii is not None:
        raise UsageError("radii: need normals: give both for disks, or neither, so that both are estimated")
    if colors is not None:
        colors = _rows("colors", colors, (3, 4), count)
        kind = _kind(colors.dtype)
        if kind not in ("u1", "u2"):
            if colors.dtype.kind != "f":
                raise InputError(f"colors: dtype {colors.dtype}, expected uint8 or uint16 (sRGB) or floats (linear)")
            kind = "f4"
        add(("red", "green", "blue", "alpha")[: colors.shape[1]], colors, kind)
    if radii is not None:
        radii = _column("radii", radii, count)
        columns.append(("radius", "f8" if radii.dtype.itemsize == 8 else "f4", radii))
    return columns, count


def to_ply(points, normals=None, colors=None, radii=None, attributes=None, faces=None):
    """A copy of the arrays as the bytes of a PLY file, an array of uint8."""
    import numpy as np

    columns, count = _ply_columns(points, normals, colors, radii)
    if faces is not None:
        faces = _rows("faces", faces, (3,), None)
    taken = {name for name, _, _ in columns} | {"radius", "vertex_indices"}
    of_points, of_faces = _attributes(attributes, taken, count, None if faces is None else len(faces))
    columns += of_points
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {count}"]
    header += [f"property {_TYPES[kind]} {name}" for name, kind, _ in columns]
    vertex = np.dtype([(name, "<" + kind) for name, kind, _ in columns])
    # Names that no attribute can have.
    face = np.dtype([(".n", "u1"), (".i", "<i4", 3), *((name, "<" + kind) for name, kind, _ in of_faces)])
    if faces is not None:
        if faces.dtype.kind not in "iu":
            raise InputError(f"faces: dtype {faces.dtype}, expected whole numbers")
        if len(faces) and (int(faces.min()) < 0 or int(faces.max()) >= count):
            raise InputError(f"faces: from {faces.min()} to {faces.max()}, expected rows of points, 0 to {count - 1}")
        header += [f"element face {len(faces)}", "property list uchar int vertex_indices"]
        header += [f"property {_TYPES[kind]} {name}" for name, kind, _ in of_faces]
    head = "\n".join([*header, "end_header\n"]).encode()
    end = len(head) + count * vertex.itemsize
    data = np.empty(end + (0 if faces is None else len(faces) * face.itemsize), np.uint8)
    data[: len(head)] = np.frombuffer(head, np.uint8)
    table = data[len(head) : end].view(vertex)
    for name, _, values in columns:
        table[name] = values
    if faces is not None:
        lists = data[end:].view(face)
        lists[".n"], lists[".i"] = 3, faces
        for name, _, values in of_faces:
            lists[name] = values
    return data


def _srgb16(colors):
    """Colours from 0 to 1, sRGB-encoded, in 16 bits: how Open3D keeps them."""
    import numpy as np

    colors = np.asarray(colors, dtype=np.float64)
    return np.rint(np.clip(colors, 0.0, 1.0) * 65535.0).astype(np.uint16) if len(colors) else None


def _some(array):
    return array if array is not None and len(array) else None


def of_object(thing) -> dict | None:
    """The arrays of an object of laspy, trimesh, Open3D or PyVista; None for what is an array itself."""
    import numpy as np

    if hasattr(thing, "point_format") and hasattr(thing, "x"):  # laspy
        names = [name for name in thing.point_format.dimension_names if name not in ("X", "Y", "Z")]
        found = {"points": np.stack([np.asarray(thing[axis], dtype=np.float64) for axis in "xyz"], axis=1)}
        if {"red", "green", "blue"} <= set(names):
            colors = np.stack([np.asarray(thing[name]) for name in ("red", "green", "blue")], axis=1)
            # Some files keep 8 bits in these 16.
            found["colors"] = colors if colors.max(initial=0) > 255 else colors.astype(np.uint8)
        others = [name for name in names if name not in ("red", "green", "blue") and name.isidentifier()]
        values = {name: np.asarray(thing[name]) for name in others}
        found["attributes"] = {name: value for name, value in values.items() if value.ndim == 1}
        return found
    if hasattr(thing, "triangles") and hasattr(thing, "vertices"):  # Open3D's meshes
        return {"points": np.asarray(thing.vertices), "faces": np.asarray(thing.triangles),
                "normals": _some(np.asarray(thing.vertex_normals)), "colors": _srgb16(thing.vertex_colors)}
    if hasattr(thing, "vertices"):  # trimesh
        visual = getattr(thing, "visual", None)
        colored = getattr(visual, "kind", None) in ("vertex", "face")
        colors = visual.vertex_colors if colored else getattr(thing, "colors", None)
        faces = getattr(thing, "faces", None)
        return {"points": np.asarray(thing.vertices), "faces": faces if faces is None else np.asarray(faces),
                "colors": _some(None if colors is None else np.asarray(colors))}
    point = getattr(thing, "point", None)
    if point is not None and "positions" in point:  # Open3D's tensors
        colors = point["colors"].numpy() if "colors" in point else None
        if colors is not None and colors.dtype.kind == "f":
            colors = _srgb16(colors)
        return {"points": point["positions"].numpy(), "colors": colors,
                "normals": point["normals"].numpy() if "normals" in point else None}
    if hasattr(thing, "points") and not hasattr(thing, "dtype"):
        open3d = hasattr(thing, "has_colors")
        return {"points": np.asarray(thing.points), "normals": _some(np.asarray(thing.normals)) if open3d else None,
                "colors": _srgb16(thing.colors) if open3d else None}
    return None
