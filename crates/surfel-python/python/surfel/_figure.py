"""The command `figure`: panels of several clouds with titles, legend and marks."""

from __future__ import annotations

import contextlib
import os
import tempfile

from . import _adapters, _arrays, _flags, _native
from ._errors import Error, InputError, UsageError


class Figure:
    """A figure that has been drawn. Notebooks display it.

    Attributes
    ----------
    notes : list of str
        Notes that the program prints on stderr.
    """

    def __init__(self, native, notes):
        self._native = native
        self._rgba = None
        self.notes = notes

    @property
    def size(self) -> tuple[int, int]:
        """Width and height in pixels."""
        width, height = self._native.size
        return width, height

    @property
    def dpi(self) -> float:
        """Pixels per inch of saved files."""
        return self._native.dpi

    @property
    def rgba(self):
        """Pixels as in a PNG: uint8 of shape (height, width, 4). RGB is sRGB-encoded, alpha is straight."""
        if self._rgba is None:
            self._rgba = self._native.rgba()
        return self._rgba

    def __array__(self, dtype=None, copy=None):
        import numpy as np

        return np.array(self.rgba, dtype=dtype) if copy or dtype is not None else self.rgba

    def save(self, path, *, force=False) -> None:
        """Writes the figure.

        Parameters
        ----------
        path : path-like
            A name that ends in .pdf or .svg, with words as text, or .png.
        force : bool
            True overwrites an existing file.

        Raises
        ------
        FileExistsError
            The file exists and `force` is False.
        UsageError
        """
        self._native.save(os.fspath(path), force)

    def png(self) -> bytes:
        """Returns the figure as PNG."""
        return self._native.bytes("png")

    def svg(self) -> str:
        """Returns the figure as SVG."""
        return self._native.bytes("svg").decode()

    def pdf(self) -> bytes:
        """Returns the figure as PDF."""
        return self._native.bytes("pdf")

    def _repr_png_(self) -> bytes:
        return self.png()

    def __repr__(self) -> str:
        width, height = self.size
        return f"<surfel.Figure {width}x{height}>"


def figure(inputs, **flags) -> Figure:
    """Draws clouds beside one another under one camera, one light and one colour range, as `surfel figure` does.

    Parameters
    ----------
    inputs : list or dict of path-like, array-like or object
        Files, point arrays of shape (n, 3), or objects that `scene` accepts, a panel for each. The keys of a dict are
        the panels' titles. A single file may be a scene file.
    **flags
        Flags of `surfel figure`, such as `title="Completion"`, `titles=["truth", "ours"]`, `error_row=True`,
        `annotate=["scale", "axes"]`, `width="174mm"`; also those of `Scene.render` for camera, light and colours.

    Returns
    -------
    Figure

    Raises
    ------
    UsageError, InputError, OSError

    Examples
    --------
    >>> surfel.figure({"truth": xyz, "ours": predicted}, error_row=True, unit="m").save("figure.pdf")
    """
    if isinstance(inputs, dict):
        flags.setdefault("titles", list(inputs))
        inputs = list(inputs.values())
    elif isinstance(inputs, (str, os.PathLike)):
        inputs = [inputs]
    else:
        inputs = list(inputs)
    if not inputs:
        raise UsageError("inputs: no file, expected one at least")
    for name in ("titles", "row_titles"):
        flags[name] = _list(name, flags.get(name))
    if isinstance(flags.get("annotate"), (list, tuple)):
        flags["annotate"] = ",".join(flags["annotate"])
    if flags.get("error_row") is True:
        flags["error_row"] = "viridis"
    elif flags.get("error_row") is False:
        flags["error_row"] = None
    given = _flags.texts(flags, _flags.FIGURE, "figure")
    with tempfile.TemporaryDirectory(prefix="surfel-") as folder:
        notes: list[str] = []
        paths = [_path(item, i, folder, notes) for i, item in enumerate(inputs)]
        with named(paths, folder) as name:
            native = _native.figure(paths, given)
            return Figure(native, [*notes, *map(name, native.notes)])


@contextlib.contextmanager
def named(paths: list[str], folder: str):
    """Names temporary files after their inputs, in messages of errors and by the function that it returns."""

    def name(text: str) -> str:
        for i, path in enumerate(paths):
            if os.path.dirname(path) == folder:
                text = text.replace(path, f"inputs[{i}]")
        return text

    try:
        yield name
    except Error as error:
        raise type(error)(name(str(error))) from None


def _list(name: str, titles) -> str | None:
    if titles is None or isinstance(titles, str):
        return titles
    titles = [str(title) for title in titles]
    if any("," in title for title in titles):
        raise UsageError(f"{name}: {titles!r}, expected titles without commas")
    return ",".join(titles)


def _path(item, i: int, folder: str, notes: list[str]) -> str:
    """Returns the path of a file, or of a file that points or an object are written to."""
    if isinstance(item, (str, os.PathLike)):
        return os.fspath(item)
    try:
        found = _adapters.adapted(item, alone=True)
        if not isinstance(found, bytes):
            arrays = found or _arrays.Arrays(item)
            found, _ = _arrays.to_ply(arrays)
            notes += arrays.notes
    except (InputError, TypeError) as error:
        raise type(error)(f"inputs[{i}]: {error}") from None
    # The name without its extension is the panel's title, unless a title is given.
    path = os.path.join(folder, f"{i + 1}.points")
    with open(path, "wb") as file:
        file.write(found)
    return path
