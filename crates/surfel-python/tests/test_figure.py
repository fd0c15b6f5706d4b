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
    assert width > 360 and 90 < height < 180 and figure.rgba.shape == (height, width, 4)
    svg = figure.svg()
    assert all(f">{words}<" in svg for words in ("truth", "ours", "Spheres", "distance [m]", "CD 0.0100 m"))
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
    with pytest.raises(surfel.InputError, match=r"inputs\[1\]: points: shape \(300, 2\)"):
        surfel.figure([points, points[:, :2]])
    with pytest.raises(surfel.InputError, match=r"^inputs\[0\]: the point cloud has no points"):
        surfel.figure([np.full((4, 3), np.nan)])
    with pytest.raises(TypeError, match=r"inputs\[0\]: points: dtype"):
        surfel.figure([np.array(["chair"])])
    with pytest.raises(surfel.UsageError, match="annotate=scales: expected some of scale, axes, north"):
        surfel.figure([points], annotate=["scales"])
    with pytest.raises(surfel.UsageError, match="titles"):
        surfel.figure([points], titles=["a", "b"])
    with pytest.raises(TypeError, match="error_row"):
        surfel.figure([points], error_rows=True)


def test_figures_read_arrays_as_scenes_do():
    points, _ = sphere(900)
    masked = np.ma.masked_array(points, mask=np.repeat(points[:, 2:] > 0.5, 3, axis=1))
    integers = np.rint(points * 1000).astype(np.int64)
    table = np.rec.fromarrays(points.T, names="x,y,z")
    figure = surfel.figure([points, masked, integers, table], **SMALL)
    hidden = int((points[:, 2] > 0.5).sum())
    assert f"inputs[1]: dropped {hidden} points whose coordinates are not finite" in figure.notes
    assert any(note.startswith(f"inputs[1]: a point cloud: {900 - hidden} splats") for note in figure.notes)
    assert any(note.startswith("inputs[3]: a point cloud: 900 splats") for note in figure.notes)
    assert not any("surfel-" in note for note in figure.notes), "no name of a temporary folder"
