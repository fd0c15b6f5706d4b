"""The package gives what the program gives, to the bit."""

import json
import struct

import conftest
import numpy as np
import pytest
import surfel
from conftest import SCENES, words_of
from surfel import _errors


def chunks(png):
    """A PNG's texts by keyword."""
    at, found = 8, {}
    while at < len(png):
        length, kind = int.from_bytes(png[at : at + 4], "big"), png[at + 4 : at + 8]
        if kind == b"tEXt":
            key, text = png[at + 8 : at + 8 + length].split(b"\0", 1)
            found[key.decode()] = text.decode()
        at += length + 12
    return found


@pytest.mark.parametrize("name", SCENES)
def test_files_are_the_programs_to_the_byte(program, data, name, tmp_path, monkeypatch):
    inputs, opened, rendered = SCENES[name]
    flags = {"size": (160, 120), **opened, **rendered}
    monkeypatch.chdir(data)
    for ending in ("png", "exr"):
        program(data, "render", *inputs, *words_of(flags), "-o", data / f"program.{ending}", "-f")
    image = surfel.open(*inputs, **opened).render(size=(160, 120), **rendered)
    for ending in ("png", "exr"):
        image.save(data / f"package.{ending}", force=True)
        assert (data / f"package.{ending}").read_bytes() == (data / f"program.{ending}").read_bytes(), ending
    # The planes themselves, by the program's own comparison.
    found = surfel.compare(data / "program.exr", data / "package.exr")
    assert found["max_abs"] == 0 and set(found["planes"]) >= {"Z", "normal", "weight"}
    assert all(plane["max_abs"] == 0 for plane in found["planes"].values())
    assert len(np.unique(image.rgba.reshape(-1, 4), axis=0)) > 10, "the image shows something"
    assert np.isfinite(image.depth).any()


def test_planes_are_what_the_exr_holds(data):
    image = surfel.open(data / "disks.ply").render(size=(64, 48))
    covered = np.isfinite(image.depth)
    assert covered.any() and not covered.all()
    lengths = np.linalg.norm(image.normal, axis=2)
    assert np.allclose(lengths[covered], 1, atol=1e-5) and not lengths[~covered].any()
    assert (image.weight[covered] > 0).all() and not image.weight[~covered].any()
    assert image.rgba.dtype == np.uint8 and image.linear.dtype == image.depth.dtype == np.float32
    assert image.linear.shape == (48, 64, 4) and image.normal.shape == (48, 64, 3) and image.size == (64, 48)


def test_arrays_are_the_file_that_holds_them(program, data, tmp_path):
    points, colors = conftest.sphere()
    image = surfel.scene(points + [1e5, 2e5, 3e3], colors=colors).render(size=(160, 120))
    program(data, "colored.ply", "--size=160x120", "-o", tmp_path / "a.png")
    assert np.array_equal(image.rgba, read(tmp_path / "a.png"))
    # Files of splats mostly have y up, arrays of points z.
    disks = surfel.scene(points, normals=points, colors=colors, radii=0.05, up="+y").render(size=(160, 120))
    program(data, "disks.ply", "--up=+y", "--size=160x120", "-o", tmp_path / "b.png")
    assert np.array_equal(disks.rgba, read(tmp_path / "b.png"))
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)])
    faces = np.array([[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6], [0, 2, 6],
                      [0, 6, 4], [1, 5, 7], [1, 7, 3]])
    box = surfel.scene(corners, faces=faces, splats=4000).render(size=(160, 120))
    program(data, "box.ply", "--splats=4000", "--size=160x120", "-o", tmp_path / "c.png")
    assert np.array_equal(box.rgba, read(tmp_path / "c.png"))


def test_radii_are_splats_and_change_no_axis():
    points, _ = conftest.sphere()
    axes = set()
    for radii, normals in [(None, None), (None, points), (0.1, None), (0.1, points), (9.0, None)]:
        notes = surfel.scene(points * [1, 1, 2], normals=normals, radii=radii).render(size=(32, 32)).notes
        axes.add(next(note.split()[2] for note in notes if note.startswith("up is")))
        text = " ".join(notes)
        if normals is None:
            assert ("radii as the file has them" in text) == (radii == 0.1), text
            assert ("left a column" in text) == (radii == 9.0), text
    assert axes == {"+z"}


def read(path):
    """A PNG's pixels, read by the package's own reader by way of a comparison with nothing else at hand."""
    import zlib

    png = path.read_bytes()
    width, height = struct.unpack(">II", png[16:24])
    at, packed = 8, b""
    while at < len(png):
        length, kind = int.from_bytes(png[at : at + 4], "big"), png[at + 4 : at + 8]
        packed += png[at + 8 : at + 8 + length] if kind == b"IDAT" else b""
        at += length + 12
    rows = np.frombuffer(zlib.decompress(packed), np.uint8).reshape(height, 1 + 4 * width)
    image = np.zeros((height + 1, width + 1, 4), int)
    for y in range(height):
        kind, line = rows[y, 0], rows[y, 1:].reshape(width, 4).astype(int)
        up, corner = image[y, 1:], image[y, :-1]
        for x in range(width):
            left = image[y + 1, x]
            if kind == 0:
                guess = 0
            elif kind == 1:
                guess = left
            elif kind == 2:
                guess = up[x]
            elif kind == 3:
                guess = (left + up[x]) // 2
            else:
                p = left + up[x] - corner[x]
                a, b, c = abs(p - left), abs(p - up[x]), abs(p - corner[x])
                guess = np.where((a <= b) & (a <= c), left, np.where(b <= c, up[x], corner[x]))
            image[y + 1, x + 1] = (line[x] + guess) & 255
    return image[1:, 1:].astype(np.uint8)


def test_planes_of_what_is_nearest_are_the_programs(program, data, tmp_path):
    flags = {"size": (96, 72), "label": "classification"}
    names = ["index", "object", "label", "position"]
    for ending in ("npz", "exr"):
        words = [*words_of(flags), "--planes=index,object,label,position", "-o", f"program.{ending}"]
        program(tmp_path, data / "values.ply", data / "points.ply", *words)
        image = surfel.open(data / "values.ply", data / "points.ply").render(
            planes=["color", "depth", "normal", "weight", *names], **flags)
        image.save(tmp_path / f"package.{ending}")
    assert (tmp_path / "program.npz").read_bytes() == (tmp_path / "package.npz").read_bytes()
    held = np.load(tmp_path / "program.npz")
    for name in ("index", "object", "label"):
        plane = getattr(image, name)
        assert plane.dtype == np.uint32 and plane.shape == (72, 96) and np.array_equal(plane, held[name]), name
    assert image.position.dtype == np.float64
    assert np.array_equal(image.position, np.stack([held[f"position.{axis}"] for axis in "XYZ"], axis=2))
    assert np.array_equal(image.depth, held["Z"]) and np.array_equal(image.linear[..., 2], held["B"])
    covered = np.isfinite(image.depth)
    assert covered.any() and not covered.all()
    assert (image.index[covered] < 3000).all() and (image.index[~covered] == 2**32 - 1).all()
    assert (image.object[~covered] == 2**32 - 1).all() and set(np.unique(image.object[covered])) <= {0, 1}
    first = covered & (image.object == 0)
    assert np.array_equal(image.label[first], image.index[first] % 7), "the file's classes are rows modulo 7"
    assert np.isinf(image.position[~covered]).all() and (np.abs(image.position[covered]) < 1.2).all()
    # By the program's own comparison, and against what was drawn.
    wanted = {"Z", "index", "object", "label", "position.X", "position.Y", "position.Z"}
    for b in (tmp_path / "package.exr", image):
        found = surfel.compare(tmp_path / "program.exr", b)["planes"]
        assert wanted <= set(found) and all(plane["differing"] == 0 for plane in found.values()), found
    other = surfel.open(data / "values.ply", data / "points.ply").render(
        planes=["color", *names], **{**flags, "view": "back"})
    found = surfel.compare(image, other)["planes"]
    assert set(names[:3]) | {"position.X"} <= set(found) and all(plane["differing"] > 0 for plane in found.values())


def test_meshes_are_coloured_by_their_own_attributes(tmp_path):
    i, j = np.divmod(np.arange(36), 6)
    points = np.stack([i, j, 0 * i], axis=1).astype(np.float32)
    a = (np.arange(36).reshape(6, 6)[:5, :5]).ravel()
    faces = np.concatenate([np.stack([a, a + 6, a + 7], 1), np.stack([a, a + 7, a + 1], 1)])
    flags = {"size": (40, 40), "view": "top", "up": "+z", "ortho": True, "shader": "unlit"}
    s = surfel.scene(points, faces=faces, attributes={"n": points[:, 0], "side": (np.arange(50) >= 25).astype("u1")})
    image = s.render(color_by="n", range=(0, 5), **flags)
    assert any("coloured by n by viridis from 0 to 5" in note for note in image.notes), image.notes
    sides = s.render(label="side", planes=["label"], **flags)
    assert set(np.unique(sides.label)) <= {0, 1, 2**32 - 1} and {0, 1} <= set(np.unique(sides.label))
    both = surfel.scene(points, attributes={"n": points[:, 0]}, **flags)
    few = both.render(where=["n>=1 or y<1", "not n=5"], color_by="n")
    assert any("chose 25 of 36 points" in note for note in few.notes), few.notes


def test_tiles_are_rows_of_the_whole(program, data, tmp_path):
    scene = surfel.open(data / "disks.ply", size=(64, 50))
    whole = scene.render()
    for i in range(4):
        scene.render(tile=(i, 4)).save(tmp_path / f"{i}.exr", exr_f32=True)
        program(data, "disks.ply", "--size=64x50", f"--tile={i}/4", "--exr-f32", "-o", tmp_path / f"p{i}.exr")
        assert (tmp_path / f"{i}.exr").read_bytes() == (tmp_path / f"p{i}.exr").read_bytes()
    rows = np.concatenate([scene.render(tile=f"{i}/4").linear for i in range(4)])
    assert np.array_equal(rows, whole.linear)
    program(tmp_path, "stitch", *[f"{i}.exr" for i in range(4)], "-o", "whole.exr")
    assert surfel.compare(tmp_path / "whole.exr", whole)["max_abs"] == 0
    with pytest.raises(surfel.UsageError, match="tile=5/4: expected I/N"):
        scene.render(tile=(5, 4))
    with pytest.raises(surfel.UsageError, match="region"):
        scene.render(tile=(0, 4), region=(0, 0, 8, 8))


def test_orthoimages_are_the_programs(program, data, tmp_path):
    x, y = np.meshgrid(np.arange(0, 10, 0.25), np.arange(0, 8, 0.25))
    ground = np.stack([x, y, np.sin(x) + 100], axis=-1).reshape(-1, 3) + [500_000, 5_400_000, 0]
    conftest.ply(tmp_path / "ground.ply", ground, attributes=[("classification", np.arange(len(ground)) % 3)])
    flags = {"gsd": 0.5, "crs": "EPSG:25832", "bounds": (500001, 5400001, 500008, 5400006.5)}
    files = ["-o", "p.tif", "--dsm=pd.tif", "--normals=pn.tif", "--stats"]
    told = json.loads(program(tmp_path, "ortho", "ground.ply", *words_of(flags), *files))
    output = {"dsm": tmp_path / "d.tif", "normals": tmp_path / "n.tif"}
    found = surfel.ortho(tmp_path / "ground.ply", tmp_path / "a.tif", **output, **flags)
    for mine, its in (("a", "p"), ("d", "pd"), ("n", "pn")):
        assert (tmp_path / f"{mine}.tif").read_bytes() == (tmp_path / f"{its}.tif").read_bytes(), its
    same = ("size", "bounds", "gsd", "pixels", "covered", "splats")
    assert {key: found[key] for key in same} == {key: told[key] for key in same}
    assert found["size"] == [14, 11] and found["covered"] == 14 * 11 and any("colour" in n for n in found["notes"])
    # Heights alone, with closed gaps.
    program(tmp_path, "ortho", "ground.ply", *words_of(flags), "--fill=2", "--dsm=pf.tif")
    filled = surfel.ortho(tmp_path / "ground.ply", dsm=tmp_path / "f.tif", fill=2, **flags)
    assert filled["filled"] == 0 and (tmp_path / "f.tif").read_bytes() == (tmp_path / "pf.tif").read_bytes()
    with pytest.raises(surfel.UsageError, match="what to write"):
        surfel.ortho(tmp_path / "ground.ply", **flags)
    # Arrays, and files of which some points are chosen.
    surfel.ortho(surfel.scene(ground), tmp_path / "b.tif", **flags)
    program(tmp_path, "ortho", "ground.ply", *words_of(flags), "--classes=1", "-o", "q.tif")
    surfel.ortho([tmp_path / "ground.ply"], tmp_path / "c.tif", classes=[1], **flags)
    assert (tmp_path / "c.tif").read_bytes() == (tmp_path / "q.tif").read_bytes() != (tmp_path / "a.tif").read_bytes()
    with pytest.raises(FileExistsError, match="force=True"):
        surfel.ortho(tmp_path / "ground.ply", tmp_path / "a.tif", gsd=1)
    surfel.ortho(tmp_path / "ground.ply", tmp_path / "a.tif", gsd=1, force=True)
    for wrong, what in [({"gsd": 0}, "gsd=0"), ({"gsd": 1, "crs": "25832"}, "EPSG:25832"),
                        ({"gsd": 1, "bounds": (0, 0, 1, 1), "size": (4, 4)}, "bounds"),
                        ({"gsd": 1, "dsm": tmp_path / "e.tif"}, "file, too"), ({"gsd": 1, "fill": 1000}, "fill"), ({"gsd": 1, "threads": 0}, "threads=0")]:
        with pytest.raises(surfel.UsageError, match=what):
            surfel.ortho(tmp_path / "ground.ply", tmp_path / "e.tif", **wrong)
    with pytest.raises(TypeError, match="did you mean"):
        surfel.ortho(tmp_path / "ground.ply", tmp_path / "e.tif", gsd=1, bound=(0, 0, 1, 1))
    with pytest.raises(surfel.UsageError, match=".tif"):
        surfel.ortho(tmp_path / "ground.ply", tmp_path / "e.png", gsd=1)
    assert not (tmp_path / "e.tif").exists()


def test_cameras_are_the_programs(program, data, tmp_path):
    K = [[200.0, 0, 79.5], [0, 210.0, 59.5], [0, 0, 1]]
    poses = []
    for angle in (0.0, 0.7, 1.4):
        c, s = np.cos(angle), np.sin(angle)
        T = np.eye(4)
        T[:3, :3] = np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]]).T
        T[:3, 3] = -4 * T[:3, 2]
        poses.append(T)
    listed = [{"K": K, "R": T[:3, :3].T.tolist(), "t": (-T[:3, :3].T @ T[:3, 3]).tolist(), "size": [160, 120],
               "name": f"{i:04}"} for i, T in enumerate(poses)]
    (tmp_path / "cameras.json").write_text(json.dumps(listed))
    program(data, "disks.ply", f"--cameras={tmp_path / 'cameras.json'}", "-o", tmp_path / "{name}.png")
    scene = surfel.open(data / "disks.ply", size=(160, 120))
    many = list(scene.render_many([(K, T) for T in poses]))
    again = list(scene.render_many(tmp_path / "cameras.json", planes=["color"]))
    assert [image.name for image in many] == [image.name for image in again] == ["0000", "0001", "0002"]
    for i, T in enumerate(poses):
        wanted = read(tmp_path / f"{i:04}.png")
        one = scene.render(K=K, world_from_camera=T, planes=["color", "depth"])
        for image in (many[i], again[i], one):
            assert np.array_equal(image.rgba, wanted), i
        assert np.array_equal(one.depth, many[i].depth)
    assert not np.array_equal(many[0].rgba, many[1].rgba)


def test_turntable_is_the_programs(program, data, tmp_path):
    program(data, "colored.ply", "--size=96x64", "--frames=3", "--turntable", "-o", tmp_path / "{frame}.png")
    frames = list(surfel.open(data / "colored.ply").render_many(frames=3, size=(96, 64)))
    assert len(frames) == 3
    for i, image in enumerate(frames):
        assert np.array_equal(image.rgba, read(tmp_path / f"{i:04}.png")), i


def test_info_compare_convert_and_backends_are_the_programs(program, data, tmp_path):
    for name in ("values.ply", "box.ply", "disks.ply"):
        assert surfel.info(data / name) == json.loads(program(data, "info", "--json", data / name))
    arrays = surfel.scene(conftest.sphere()[0]).info()
    assert arrays["kind"] == "points" and arrays["points"] == 3000
    a, b = (surfel.open(data / "disks.ply").render(size=(80, 60), preset=p) for p in ("fast", "reference"))
    a.save(tmp_path / "a.exr", exr_f32=True)
    b.save(tmp_path / "b.exr", exr_f32=True)
    told = program(tmp_path, "compare", "a.exr", "b.exr", "--json", "--diff=d.png").replace(b'"inf"', b"Infinity")
    found = surfel.compare(a, b, diff=tmp_path / "e.png")
    assert {**json.loads(told), "a": "a", "b": "b"} == found
    assert (tmp_path / "d.png").read_bytes() == (tmp_path / "e.png").read_bytes()
    assert surfel.compare(a.linear, b.linear)["rmse"] == found["rmse"] > 0
    assert surfel.compare(a, a)["psnr"] == float("inf")
    program(tmp_path, "convert", data / "box.ply", "--splats=500", "--cull=none", "-o", "p.ply")
    surfel.convert(data / "box.ply", tmp_path / "q.ply", splats=500, cull="none")
    assert (tmp_path / "p.ply").read_bytes() == (tmp_path / "q.ply").read_bytes()
    program(tmp_path, "convert", data / "box.ply", "--hybrid", "-o", "p.surfel")
    surfel.open(data / "box.ply").save(tmp_path / "q.surfel", hybrid=True)
    assert (tmp_path / "p.surfel").read_bytes() == (tmp_path / "q.surfel").read_bytes()
    named = {backend["name"]: backend for backend in surfel.backends()}
    assert named["cpu"]["available"] and named["reference"]["available"]


def test_backends_that_are_not_built_in_are_explained_in_words_of_pip():
    text = str(_errors.not_built("wgpu", "gpu", "cpu, reference"))
    assert "'wgpu' is not built into this installation, which has cpu, reference" in text
    assert "pip install surfel --force-reinstall --only-binary surfel" in text
    assert "--config-settings build-args='--features gpu'" in text and "cargo" not in text
    for backend in surfel.backends():
        if "not built in" in (backend["reason"] or ""):
            with pytest.raises(surfel.BackendError, match="pip install"):
                surfel.scene([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]).render(size=(8, 8), backend=backend["name"])


def test_points_by_levels_are_the_programs(program, tmp_path):
    x, y = np.meshgrid(np.arange(0, 10, 0.2), np.arange(0, 8, 0.2))
    ground = np.stack([x, y, np.sin(x)], axis=-1).reshape(-1, 3)
    conftest.las(tmp_path / "a.las", ground)
    conftest.las(tmp_path / "b.las", ground + [10, 0, 0])
    program(tmp_path, "convert", "a.las", "b.las", "-o", "p.copc.laz")
    told = surfel.convert([tmp_path / "a.las", tmp_path / "b.las"], tmp_path / "q.copc.laz", threads=1)
    assert (tmp_path / "p.copc.laz").read_bytes() == (tmp_path / "q.copc.laz").read_bytes()
    assert any(f"{2 * len(ground)} points" in note for note in told)
    surfel.open(tmp_path / "a.las", tmp_path / "b.las").save(tmp_path / "r.copc.laz")
    assert (tmp_path / "p.copc.laz").read_bytes() == (tmp_path / "r.copc.laz").read_bytes()
    shares = [tmp_path / f"{i}.shard" for i in range(3)]
    for i, share in enumerate(shares):
        surfel.convert([tmp_path / "a.las", tmp_path / "b.las"], share, shard=(i, 3), resume=True)
    surfel.convert(shares, tmp_path / "t.copc.laz", resume=False)
    assert (tmp_path / "p.copc.laz").read_bytes() == (tmp_path / "t.copc.laz").read_bytes()
    assert not any(path.suffix == ".resume" for path in tmp_path.iterdir())
    with pytest.raises(surfel.UsageError, match="writes a name that ends in .shard"):
        surfel.convert(tmp_path / "a.las", tmp_path / "u.copc.laz", shard="0/2")
    with pytest.raises(surfel.UsageError, match="are of names that end in"):
        surfel.convert(tmp_path / "a.las", tmp_path / "u.ply", resume=True)
    with pytest.raises(surfel.UsageError, match="2 inputs, expected one"):
        surfel.convert([tmp_path / "a.las", tmp_path / "b.las"], tmp_path / "q.ply")
    with pytest.raises(surfel.UsageError, match="takes the points as they are"):
        surfel.convert(tmp_path / "a.las", tmp_path / "s.copc.laz", classes=[2])
    with pytest.raises(FileExistsError, match="force=True"):
        surfel.convert(tmp_path / "a.las", tmp_path / "q.copc.laz")


def test_pictures_are_repeated_by_the_program(program, data, tmp_path):
    image = surfel.open(data / "colored.ply").render(size=(96, 64), view="top", edge_aa=True)
    image.save(tmp_path / "a.png")
    program(tmp_path, "again", "a.png", "-o", "b.png")
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
    assert image.scene_file["camera"]["size"] == [96, 64]
    assert np.array_equal(surfel.again(tmp_path / "a.png").linear, image.linear)
    image.save(tmp_path / "c.png", metadata=False)
    with pytest.raises(surfel.InputError, match="carries no scene"):
        surfel.again(tmp_path / "c.png")
    assert "surfel:scene" not in chunks((tmp_path / "c.png").read_bytes())
    # Arrays have no file: the program reads the same bytes from stdin.
    scene = surfel.scene(conftest.sphere()[0])
    scene.render(size=(96, 64)).save(tmp_path / "d.png")
    assert json.loads(chunks((tmp_path / "d.png").read_bytes())["surfel:inputs"])[0]["path"] == "-"
    program(tmp_path, "again", "d.png", "-o", "e.png", data=scene._native.data())
    assert (tmp_path / "d.png").read_bytes() == (tmp_path / "e.png").read_bytes()


def test_columns_name_those_of_tables(program, tmp_path):
    rows = np.zeros((400, 4), np.float32)
    rows[:, 0], rows[:, 1], rows[:, 3] = np.arange(400) % 20, np.arange(400) // 20, np.arange(400)
    rows.tofile(tmp_path / "000000.bin")
    np.savetxt(tmp_path / "t.txt", rows[:, [3, 1, 0, 2]], "%g")
    for name, columns in (
        ("000000.bin", "f4:x,y,z,intensity"),
        ("t.txt", "_,y,x,z"),
        ("t.txt", [None, "y", "x", "z"]),
        ("t.txt", ("_", "y", "x", "z")),
    ):
        words = columns if isinstance(columns, str) else "_,y,x,z"
        facts = surfel.info(tmp_path / name, columns=columns)
        assert facts == json.loads(program(tmp_path, "info", "--json", tmp_path / name, "--columns", words))
        assert facts["bounds"] == [[0, 0, 0], [19, 19, 0]]
        assert surfel.open(tmp_path / name, columns=columns).info() == facts
        image = surfel.open(tmp_path / name, columns=columns).render(size=(32, 32), view="top", up="+z")
        assert np.isfinite(image.depth).any()
    with pytest.raises(surfel.InputError, match="columns"):
        surfel.info(tmp_path / "000000.bin")
    with pytest.raises(surfel.UsageError, match="the type 'f3'"):
        surfel.info(tmp_path / "000000.bin", columns="f3:x,y,z")
    with pytest.raises(TypeError, match="columns: a int"):
        surfel.open(tmp_path / "t.txt", columns=3)
