"""Figures: panels in, pixels, SVG and PDF out."""

import numpy as np
import pytest
import surfel
from conftest import sphere

SMALL = {"size": (120, 90), "view": "front", "up": "+y", "backend": "cpu"}


def test_figures_of_arrays_have_their_titles_and_an_error_row():
    points, _ = sphere(900)
    clouds = {"truth": points, "ours": points * 1.01}
    figure = surfel.figure(clouds, error_row=True, unit="m", title="Spheres", **SMALL)
    width, height = figure.size
    assert width > 240 and height > 180 and figure.rgba.shape == (height, width, 4)
    svg = figure.svg()
    assert all(f">{words}<" in svg for words in ("truth", "ours", "Spheres", "distance [m]", "mean 0.0100 m"))
    assert figure.pdf().startswith(b"%PDF") and figure._repr_png_().startswith(b"\x89PNG")
    assert np.array_equal(np.asarray(figure), figure.rgba)


def test_figures_are_saved_and_wrong_ones_refused(tmp_path):
    points, _ = sphere(300)
    figure = surfel.figure([points], annotate=["scale", "axes"], text_at=["0,1,0=top"], **SMALL)
    figure.save(tmp_path / "a.pdf")
    with pytest.raises(FileExistsError):
        figure.save(tmp_path / "a.pdf")
    with pytest.raises(surfel.UsageError, match="pdf"):
        figure.save(tmp_path / "a.tif")
    with pytest.raises(surfel.UsageError, match="at least two"):
        surfel.figure([points], error_row=True)
    with pytest.raises(surfel.UsageError, match="shape"):
        surfel.figure([points[:, :2]])
    with pytest.raises(surfel.UsageError, match="titles"):
        surfel.figure([points], titles=["a", "b"])
    with pytest.raises(TypeError, match="error_row"):
        surfel.figure([points], error_rows=True)
