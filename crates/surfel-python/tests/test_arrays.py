"""What arrays mean: colours, missing values, attributes of any name, tables; and what messages call them."""

import re

import numpy as np
import pytest
import surfel
from conftest import sphere

SMALL = {"size": (48, 36), "planes": ["color", "depth"], "view": "front", "up": "+y"}
FLAT = {**SMALL, "shader": "unlit", "background": "transparent"}
POINTS, COLORS = sphere(800)
BOX = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
QUADS = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])


def color_of(**given):
    """Linear colour of a sphere whose points have one colour."""
    image = surfel.scene(POINTS, **given).render(**FLAT)
    inside = image.linear[image.linear[..., 3] == 1]
    assert len(inside) > 100 and np.ptp(inside, axis=0).max() < 1e-5
    return inside[0, :3]


def test_floats_are_as_displayed_unless_linear():
    levels = np.tile(np.array([40, 128, 230], np.uint8), (800, 1))
    wanted = color_of(colors=levels)
    for same in (levels / 255, (levels / 255).astype(np.float32), levels.astype(np.uint16) * 257,
                 np.c_[levels / 255, np.ones(800)]):
        assert np.abs(color_of(colors=same) - wanted).max() < 1e-6
    assert np.abs(color_of(colors=levels / 255, linear=True) - levels[0] / 255).max() < 1e-6
    # Disks, whose file has a profile of its own, and meshes: the same rule.
    disks = {"normals": POINTS, "radii": 0.2}
    assert np.abs(color_of(colors=levels / 255, **disks) - wanted).max() < 1e-6
    box = surfel.scene(BOX, faces=QUADS, colors=np.tile(levels[:1] / 255, (8, 1)), splats=2000).render(**FLAT)
    assert np.abs(box.linear[box.linear[..., 3] == 1][0, :3] - wanted).max() < 1e-6
    # Light may be brighter than white, and rounding may go beyond it.
    assert color_of(colors=np.full((800, 3), 1.5), linear=True)[0] > 1.4
    assert color_of(colors=np.full((800, 3), 1 + 1e-7))[0] == 1


def test_whole_numbers_are_levels_by_the_largest_of_them():
    levels = np.tile(np.array([40, 128, 230]), (800, 1))
    wanted = color_of(colors=levels.astype(np.uint8))
    for kind, factor, bits in ((np.int64, 1, 8), (np.uint16, 1, 8), (np.int32, 257, 16)):
        scene = surfel.scene(POINTS, colors=(levels * factor).astype(kind))
        image = scene.render(**FLAT)
        inside = image.linear[image.linear[..., 3] == 1]
        assert np.abs(inside[0, :3] - wanted).max() < 1e-6, kind
        note = f"colors: took {np.dtype(kind)} up to {230 * factor} as levels of {bits} bits"
        assert note in image.notes and note in scene.prepare(view="front"), image.notes
    assert not any(note.startswith("colors") for note in surfel.scene(POINTS, colors=COLORS).render(**FLAT).notes)


def test_points_without_a_place_are_left_out_with_a_note():
    wanted = surfel.scene(POINTS[3:], colors=COLORS[3:]).render(**FLAT)
    missing = POINTS.copy()
    missing[0, 1], missing[1], missing[2, 0] = np.nan, np.inf, -np.inf
    masked = np.ma.array(POINTS, mask=False)
    masked[:3] = np.ma.masked
    nones = POINTS.astype(object)
    nones[:3, 2] = None
    for points in (missing, masked, nones, nones.tolist()):
        image = surfel.scene(points, colors=COLORS).render(**FLAT)
        assert np.array_equal(image.linear, wanted.linear)
        assert any(re.match("points: dropped 3 points", note) for note in image.notes), image.notes
    # Rows count in the array as it was given.
    index = surfel.scene(missing).render(**{**SMALL, "planes": ["index"]}).index
    assert index[index < 2**32 - 1].min() >= 3
    # The values under a mask don't show; attributes have none there.
    values = np.ma.array(POINTS[:, 2].copy(), mask=POINTS[:, 2] > 0)
    values.data[values.mask] = 1e6
    known = np.where(POINTS[:, 2] > 0, np.nan, POINTS[:, 2])
    a, b = (surfel.scene(POINTS, attributes={"e": v}, color_by="e").render(**FLAT) for v in (values, known))
    assert np.array_equal(a.linear, b.linear)


@pytest.mark.parametrize(
    ("given", "kind", "said"),
    [
        ({"colors": COLORS / 255.0 - 0.1}, surfel.InputError, r"colors: row \d+ is .*, expected 0 to 1"),
        ({"colors": COLORS * 1.0}, surfel.InputError, "colors: floats up to 255, expected 0 to 1.*uint8.*linear=True"),
        ({"colors": -1 - COLORS.astype(int)}, surfel.InputError, "colors: row 0 is .*expected 0 to 255"),
        ({"colors": COLORS.astype(int) * 999}, surfel.InputError, "colors: up to .*, expected at most"),
        ({"colors": np.where(COLORS > 250, np.nan, 0.5)}, surfel.InputError, "colors: row .* NaN, infinite or masked"),
        ({"colors": np.ma.array(COLORS, mask=COLORS > 250)}, surfel.InputError, "colors: row .* NaN, infinite or"),
        ({"colors": COLORS > 9}, surfel.InputError, "colors: dtype bool"),
        ({"colors": COLORS, "linear": True}, surfel.UsageError, "linear: is for floats"),
        ({"colors": np.full((800, 4), -1.0), "linear": True}, surfel.InputError, "colors: row 0 .*expected 0 or more"),
        ({"colors": np.full((800, 4), 2.0), "linear": True}, surfel.InputError, "colors: alpha: row 0 is 2"),
        ({"normals": POINTS, "radii": np.linspace(-1, 1, 800)}, surfel.InputError, "radii: row 0 is -1.*repair=True"),
        ({"normals": POINTS, "radii": np.nan}, surfel.InputError, "radii: row 0 is NaN"),
        ({"normals": POINTS, "radii": 0}, surfel.InputError, "radii: row 0 is 0, expected finite numbers greater"),
        ({"normals": POINTS * np.nan, "radii": 1.0}, surfel.InputError, "normals: row 0 is NaN"),
        ({"normals": POINTS, "radii": np.ones((800, 2))}, surfel.InputError, "radii: shape"),
        ({"attributes": {"e": POINTS[:9, 0]}}, surfel.InputError, r"attributes\['e'\]: shape \(9,\), expected"),
        ({"attributes": {"e": ["a"] * 800}}, TypeError, r"attributes\['e'\]: dtype <U1"),
        ({"faces": np.zeros((0, 3), int)}, surfel.InputError, "faces: holds no face"),
        ({"faces": [[0.0, 1, 2]]}, surfel.InputError, "faces: dtype float64"),
        ({"faces": [[0, 1, -1]]}, surfel.InputError, "faces: from -1 to 1"),
    ],
)
def test_values_that_mean_nothing_are_refused_by_their_argument(given, kind, said):
    with pytest.raises(kind, match=said):
        surfel.scene(POINTS, **given)


def test_invalid_disks_are_left_out_by_repair():
    radii = np.full(800, 0.1)
    radii[:5] = [-1, 0, np.nan, np.inf, -np.inf]
    image = surfel.scene(POINTS, normals=POINTS, radii=radii, repair=True).render(**FLAT)
    assert any("dropped 5 invalid splats" in note for note in image.notes), image.notes
    assert np.isfinite(image.depth).any()


def test_attributes_have_any_name_and_vectors_a_length():
    values = {"Intensity (dB)": POINTS[:, 0], "radius": POINTS[:, 1], "x": POINTS[:, 2], "red": POINTS[:, 0],
              "velocity": POINTS * [1, 2, 3], "größe": POINTS[:, 1], "8": POINTS[:, 2], "scale_0": POINTS[:, 0]}
    scene = surfel.scene(POINTS, attributes=values)
    assert scene.info()["kind"] == "points"
    draw = lambda name: scene.render(**FLAT, color_by=name).linear  # noqa: E731
    alone = lambda v: surfel.scene(POINTS, attributes={"e": v}).render(**FLAT, color_by="e").linear  # noqa: E731
    for name, value in values.items():
        wanted = np.linalg.norm(value, axis=1) if name == "velocity" else value
        assert np.array_equal(draw(name), alone(wanted)), name
    assert np.array_equal(draw("velocity_y"), alone(2 * POINTS[:, 1]))
    mixed = surfel.scene(POINTS, attributes={"a b": POINTS[:, 0], "a_b": POINTS[:, 1]})
    assert np.array_equal(mixed.render(**FLAT, color_by="a b").linear, alone(POINTS[:, 0]))


def test_tables_of_numpy_are_taken_by_their_columns():
    wanted = surfel.scene(POINTS, colors=COLORS).render(**FLAT)
    kinds = [("Z", "f8"), ("X [m]", "f8"), ("Y", "f8"), ("B", "u1"), ("g", "u1"), ("r", "u1"), ("gps time", "f4")]
    table = np.zeros(800, kinds)
    for name, values in zip(["X [m]", "Y", "Z", "r", "g", "B", "gps time"], [*POINTS.T, *COLORS.T, POINTS[:, 0]]):
        table[name] = values
    for same in (table, table.view(np.recarray)):
        assert np.array_equal(surfel.scene(same).render(**FLAT).linear, wanted.linear)
    timed = surfel.scene(table, color_by="gps time").render(**FLAT).linear
    alone = surfel.scene(POINTS, attributes={"t": POINTS[:, 0].astype("f4")}, color_by="t").render(**FLAT)
    assert np.array_equal(timed, alone.linear)
    # What is given besides takes the place of the table's own.
    other = surfel.scene(table, colors=COLORS[::-1]).render(**FLAT)
    assert np.array_equal(other.linear, surfel.scene(POINTS, colors=COLORS[::-1]).render(**FLAT).linear)
    with pytest.raises(surfel.InputError, match="no columns x, y and z; it has a, b"):
        surfel.scene(np.zeros(9, [("a", "f4"), ("b", "f4")]))
    words = np.array([(1.0, 2.0, 3.0, "tree"), (2.0, 2.0, 3.5, "house"), (1.0, 2.5, 3.0, "tree")],
                     [("x", "f8"), ("y", "f8"), ("z", "f8"), ("kind", "U9")])
    assert any("hold no numbers: kind" in note for note in surfel.scene(words).prepare())


def test_quads_and_triangles_are_the_same_mesh():
    triangles = np.concatenate([QUADS[:, :3], QUADS[:, [0, 2, 3]]])
    a, b = (surfel.scene(BOX, faces=faces, splats=2000).render(size=(48, 36)) for faces in (QUADS, triangles))
    covered = [np.isfinite(image.depth) for image in (a, b)]
    assert covered[0].sum() > 200 and np.abs(covered[0].astype(int) - covered[1]).sum() < 10


def test_messages_and_notes_name_arguments_and_not_files():
    scene = surfel.scene(np.where(np.arange(2400).reshape(800, 3) == 7, np.nan, POINTS), attributes={"e": POINTS[:, 0]})
    told = []
    for flags in ({"splats": 9}, {"color_by": "heat"}, {"texture": "fit"}, {"where": "heat>1"},
                  {"composite": "over"}, {"sort": "pixel"}, {"label": "heat"}, {"crop": (9, 9, 9, 10, 10, 10)},
                  {"error": 0.1}, {"returns": "last"}, {"classes": [2]}):
        with pytest.raises(surfel.Error) as caught:
            scene.render(**{**SMALL, **flags})
        told.append(str(caught.value))
    told += scene.render(size=(16, 16)).notes + scene.render(size=(16, 16), color_by="e").notes
    told += surfel.scene(POINTS, normals=POINTS, radii=0.1).render(size=(16, 16), radius_scale=2).notes
    assert len(told) > 15 and any(text.startswith("points: ") for text in told)
    for text in told:
        assert "stdin" not in text and not re.search(r"(^|\s|')-(:|\s|$)", text) and "--" not in text, text


def test_notes_on_arrays_come_with_pickles_and_conversions(tmp_path):
    import pickle

    scene = surfel.scene(POINTS, colors=COLORS.astype(int))
    note = "colors: took int64 up to 255 as levels of 8 bits"
    for other in (scene, pickle.loads(pickle.dumps(scene))):
        assert note in other.render(size=(8, 8)).notes and note in other.prepare(size=(8, 8))
        assert note in other.save(tmp_path / "a.ply", force=True)
