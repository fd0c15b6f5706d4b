"""What the commands `convert`, `ortho`, `info`, `compare` and `backends` do."""

from __future__ import annotations

import json
import os

from . import _flags, _native
from ._errors import UsageError
from ._image import Image


def _paths(things) -> list[str]:
    """Names of files: of one, of several, or of a Scene's."""
    paths = getattr(things, "_paths", None)
    if paths is None:
        paths = [os.fspath(path) for path in ([things] if isinstance(things, (str, os.PathLike)) else things)]
    if not paths:
        raise UsageError("inputs: no file, expected one at least")
    return paths


def _source(thing) -> tuple:
    """The path of a file, and the scene that has its bytes where the path is `-`."""
    paths = _paths(thing)
    if len(paths) != 1:
        raise UsageError(f"a scene of {len(paths)} files, expected one")
    return paths[0], getattr(thing, "_native", None)


def convert(input, output, *, hybrid=False, ascii=False, force=False, **flags) -> list[str]:
    """Makes splats of points or a mesh and writes them to a .ply, with `hybrid` an octree to a .surfel, or sorts points
    of any number of LAZ files by levels into a .copc.laz: the bytes that `surfel convert` writes.

    input: a file, a list of files for a .copc.laz, or a Scene. Other keywords as in `open` that say how files become
    splats, and `threads`. For a .copc.laz `resume=True` keeps what is done in a folder beside it until it is there, and
    goes on with what an interrupted call left; `shard=(i, n)` writes share i of n to a .shard file, and a list of all n
    is put together. Gives what there is to say about it. Raises FileExistsError without `force`, UsageError,
    InputError.
    """
    output = os.fspath(output)
    base = getattr(input, "_base", {})
    given = {name: value for name, value in base.items() if name in _flags.SPLATS}
    given.update(flags)
    endings = (".surfel",) if hybrid else (".ply", ".copc.laz", ".shard")
    if not output.lower().endswith(endings):
        raise UsageError(f"output={output!r}: expected a name that ends in {' or '.join(endings)}")
    given = _flags.texts(given, _flags.CONVERT, "convert")
    return _native.convert(_paths(input), getattr(input, "_native", None), output, given, hybrid, ascii, force)


def ortho(inputs, output=None, *, gsd, dsm=None, normals=None, fill=None, force=False, **flags) -> dict:
    """Draws files, or a Scene, from above, north up, to GeoTIFFs: the bytes that `surfel ortho` writes.

    inputs: a file, a list of files of one ground, or a Scene; z is up. output: a .tif of colours. gsd: side of a pixel
    in the units of x and y. dsm, normals: .tif files of heights and of unit normals. At least one of the three files is
    needed. fill: radius of the largest circle that fits into gaps that are closed by interpolation; a last band marks
    the pixels of these.
    Other keywords are flags of `surfel ortho`: `bounds=(x0, y0, x1, y1)`, `origin=(x, y)`, `size=(width, height)`,
    `crs="EPSG:25832"`, `backend`, `threads`, and those of `open` that say how files become splats.

    Gives what `--stats` prints, and `notes`. Raises FileExistsError without `force`, UsageError, InputError.
    """
    base = getattr(inputs, "_base", {})
    given = {name: value for name, value in base.items() if name in _flags.SPLATS & _flags.ORTHO}
    given.update(flags, gsd=gsd, dsm=dsm, normals=normals, fill=fill)
    given = _flags.texts(given, _flags.ORTHO, "ortho")
    output = None if output is None else os.fspath(output)
    stats, notes = _native.ortho(_paths(inputs), getattr(inputs, "_native", None), output, given, force)
    return {**json.loads(stats), "notes": notes}


def info(input, *, repair=False, allow_outside=False, max_texture=None, columns=None) -> dict:
    """What a file, or a Scene of one or of arrays, holds: the object that `surfel info --json` prints.

    columns: names of a table's columns, as in `open`; those of a Scene where they aren't given.
    """
    path, scene = _source(input)
    columns = _flags.columns_text(getattr(input, "_base", {}).get("columns") if columns is None else columns)
    return json.loads(_native.info(path, scene, repair, allow_outside, max_texture, columns))


def _image(name: str, thing):
    if isinstance(thing, Image):
        return thing._native
    if isinstance(thing, (str, os.PathLike)):
        return os.fspath(thing)
    import numpy as np

    from ._arrays import array as to_array

    array = to_array(name, thing)
    if array.ndim != 3 or array.shape[2] not in (3, 4) or array.dtype.kind != "f":
        raise UsageError(f"{name}: an array of shape {array.shape} and dtype {array.dtype}, expected linear colours:"
                         " floats of shape (height, width, 3 or 4)")
    if array.shape[2] == 3:
        array = np.concatenate([array, np.ones_like(array[:, :, :1])], axis=2)
    return _native.frame_of({"linear": np.array(array, dtype=np.float32, order="C")})


def compare(a, b, *, diff=None, force=False) -> dict:
    """How far image `b` is from the reference `a`: the object that `surfel compare --json` prints, with `max_abs`,
    `rmse`, `psnr`, `flip`, and `planes` that both have.

    a, b: files, Images (positions rounded to float32, as in an EXR), or arrays of linear premultiplied colours, floats
    of shape (height, width, 3 or 4). diff: a .png to write FLIP's error map to. Infinite numbers are float("inf").

    Raises InputError for images of different sizes.
    """
    diff = None if diff is None else os.fspath(diff)
    found = json.loads(_native.compare(_image("a", a), _image("b", b), diff, force))

    def plain(value):
        if isinstance(value, dict):
            return {key: item if key in ("a", "b") else plain(item) for key, item in value.items()}
        return float(value) if value in ("inf", "-inf", "nan") else value

    return plain(found)


def backends() -> list[dict]:
    """What this machine can run: the list that `surfel backends --json` prints."""
    return json.loads(_native.backends())
