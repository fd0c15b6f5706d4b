"""The commands `convert`, `ortho`, `info`, `compare` and `backends`."""

from __future__ import annotations

import json
import os

from . import _flags, _native
from ._errors import UsageError
from ._image import Image


def _paths(things) -> list[str]:
    """Returns file names: of one file, of several, or of a Scene."""
    paths = getattr(things, "_paths", None)
    if paths is None:
        paths = [os.fspath(path) for path in ([things] if isinstance(things, (str, os.PathLike)) else things)]
    if not paths:
        raise UsageError("inputs: no file, expected one at least")
    return paths


def _source(thing) -> tuple:
    """Returns a file's path and the scene that holds its bytes (if the path is `-`)."""
    paths = _paths(thing)
    if len(paths) != 1:
        raise UsageError(f"a scene of {len(paths)} files, expected one")
    return paths[0], getattr(thing, "_native", None)


def convert(input, output, *, hybrid=False, ascii=False, force=False, **flags) -> list[str]:
    """Converts points or a mesh to splats and writes them, as `surfel convert` does.

    Parameters
    ----------
    input : path-like, list of path-like, or Scene
        A file or a scene. For a .copc.laz output also a list of files; for shards, the list of all .shard files.
    output : path-like
        A name that ends in .ply (splats), .surfel (an octree, with `hybrid`), .copc.laz or .shard (points by level of
        detail).
    hybrid : bool
        True writes an octree.
    ascii : bool
        True writes a PLY as text.
    force : bool
        True overwrites an existing file.
    threads : int
        Number of threads; all cores by default.
    resume : bool
        For a .copc.laz: True keeps finished work in a folder beside the output, and continues an interrupted call.
    shard : tuple of int
        For a .shard: (i, n) writes shard i of n.
    **flags
        The keywords of `open` that control how files become splats.

    Returns
    -------
    list of str
        Notes, as the program prints them.

    Raises
    ------
    FileExistsError
        The output exists and `force` is False.
    UsageError, InputError
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
    """Draws files or a scene from above, north up, to GeoTIFFs, as `surfel ortho` does.

    At least one of `output`, `dsm` and `normals` is needed.

    Parameters
    ----------
    inputs : path-like, list of path-like, or Scene
        Files of the same area, or a scene; z is up.
    output : path-like, optional
        A .tif for colours.
    gsd : float
        Side of a pixel, in the units of x and y.
    dsm, normals : path-like, optional
        A .tif for heights, and one for unit normals.
    fill : float, optional
        Radius, in the units of x and y, of the largest circle that fits into a gap that is interpolated. The last
        band of a file marks interpolated pixels.
    force : bool
        True overwrites existing files.
    **flags
        Flags of `surfel ortho`: `bounds=(x0, y0, x1, y1)`, `origin=(x, y)`, `size=(width, height)`, `crs="EPSG:25832"`,
        `backend`, `threads`, and the keywords of `open` that control how files become splats.

    Returns
    -------
    dict
        Statistics, as `--stats` prints them, and `notes`.

    Raises
    ------
    FileExistsError
        A file exists and `force` is False.
    UsageError, InputError
    """
    base = getattr(inputs, "_base", {})
    given = {name: value for name, value in base.items() if name in _flags.SPLATS & _flags.ORTHO}
    given.update(flags, gsd=gsd, dsm=dsm, normals=normals, fill=fill)
    given = _flags.texts(given, _flags.ORTHO, "ortho")
    output = None if output is None else os.fspath(output)
    stats, notes = _native.ortho(_paths(inputs), getattr(inputs, "_native", None), output, given, force)
    return {**json.loads(stats), "notes": notes}


def info(input, *, repair=False, allow_outside=False, max_texture=None, columns=None) -> dict:
    """Describes the content of a file or a scene, as `surfel info --json` does.

    Parameters
    ----------
    input : path-like or Scene
        A file, or a scene of one file or of arrays.
    repair, allow_outside, max_texture
        As in `open`.
    columns : str or list of str, optional
        Names of a table's columns, as in `open`; those of the scene by default.

    Returns
    -------
    dict
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
    """Compares image `b` with the reference `a`, as `surfel compare --json` does.

    Parameters
    ----------
    a, b : path-like, Image or array
        Images, files, or floats of shape (height, width, 3 or 4): linear colours, premultiplied by alpha. Positions
        of an Image are rounded to float32, as in an EXR.
    diff : path-like, optional
        A .png for FLIP's error map.
    force : bool
        True overwrites an existing error map.

    Returns
    -------
    dict
        `max_abs`, `rmse`, `psnr` (dB), `flip`, and `planes` with the planes of both images. Infinite values are
        float("inf").

    Raises
    ------
    InputError
        The sizes differ, or a file isn't an image.
    """
    diff = None if diff is None else os.fspath(diff)
    found = json.loads(_native.compare(_image("a", a), _image("b", b), diff, force))

    def plain(value):
        if isinstance(value, dict):
            return {key: item if key in ("a", "b") else plain(item) for key, item in value.items()}
        return float(value) if value in ("inf", "-inf", "nan") else value

    return plain(found)


def backends() -> list[dict]:
    """Lists the backends and whether this machine can run them, as `surfel backends --json` does."""
    return json.loads(_native.backends())
