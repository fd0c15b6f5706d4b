"""Objects of other packages as arrays: meshes, clouds and tables.

An object is recognised by the names of its classes and of the packages that they are from, so that none of these
packages is imported, and none has to be installed.
"""

from __future__ import annotations

import io
import re

from ._arrays import Arrays, array
from ._errors import InputError

# Names of columns that are positions, normals and colours, in the order in which they are looked for.
_POSITIONS = ("x y z", "x_coord y_coord z_coord", "xcoord ycoord zcoord", "coord_x coord_y coord_z",
              "pos_x pos_y pos_z", "position_x position_y position_z", "easting northing elevation",
              "easting northing height",
              "easting northing altitude", "points:0 points:1 points:2", "points_0 points_1 points_2")
_NORMALS = ("nx ny nz", "normal_x normal_y normal_z", "normalx normaly normalz", "normals_x normals_y normals_z",
            "normals:0 normals:1 normals:2")
_COLORS = ("red green blue", "r g b", "color_r color_g color_b", "diffuse_red diffuse_green diffuse_blue",
           "rgb:0 rgb:1 rgb:2")
_COLOR_ARRAY = re.compile(r"(rgba?|colou?rs?)\W*", re.IGNORECASE)
# Smallest cosine of the angle between a face's normal and a corner's at which the two agree, and smallest fraction of
# corners that must agree. At edges whose faces share vertices, as of a box, corners' normals belong to no face.
_ALONG, _SHARE = 0.7, 0.9


def adapted(thing, alone: bool) -> Arrays | bytes | None:
    """Returns the arrays of an object of another package; None for objects of unknown packages.

    If no other arrays are given with the object (`alone`), it may return the bytes of a file of the whole object."""
    for kind in type(thing).__mro__:
        adapter = _ADAPTERS.get((kind.__module__.split(".")[0], kind.__name__))
        if adapter is not None:
            return adapter(thing, alone)
    if getattr(getattr(thing, "dtype", None), "names", None):
        return _table(thing.dtype.names, lambda name: thing[name])
    return None


def _some(values):
    return values if values is not None and len(values) else None


def _face_normals(points, faces):
    """Returns the unit normals of triangles; NaN for triangles without area."""
    import numpy as np

    a, b, c = (points[faces[:, i]] for i in range(3))
    normals = np.cross(b - a, c - a)
    with np.errstate(invalid="ignore", divide="ignore"):
        return normals / np.linalg.norm(normals, axis=1, keepdims=True)


def _suiting(found: Arrays) -> Arrays:
    """Returns a mesh, without its normals if faces share vertices at edges, where one normal can't fit all faces."""
    import numpy as np

    if found.normals is None or found.faces is None:
        return found
    points, faces = np.asarray(found.points, dtype=np.float64), np.asarray(found.faces)
    along = np.einsum("fx,fcx->fc", _face_normals(points, faces), np.asarray(found.normals, dtype=np.float64)[faces])
    along = along[np.isfinite(along)]
    if along.size and np.mean(along > _ALONG) < _SHARE:
        found.normals = None
        found.notes.append("points: left out the mesh's normals, which are far from those of its faces")
    return found


def _merged(parts: list[Arrays], what: str) -> Arrays:
    """Returns several meshes as one mesh, or several clouds as one cloud."""
    import numpy as np

    if not parts:
        raise InputError(f"points: the {what} holds nothing to draw, expected meshes or points")
    if len(parts) == 1:
        return parts[0]
    meshes = sum(part.faces is not None for part in parts)
    if 0 < meshes < len(parts):
        raise InputError(f"points: the {what} holds {meshes} meshes and {len(parts) - meshes} clouds of points,"
                         " expected one of both: give each kind to a scene of its own")
    counts = [len(part.points) for part in parts]
    faces = [0 if part.faces is None else len(part.faces) for part in parts]
    notes = [note for part in parts for note in part.notes]

    def joined(name, values, counts, otherwise):
        if all(value is None for value in values):
            return None
        width = next(len(np.shape(value)) > 1 and np.shape(value)[1] for value in values if value is not None)
        width = width or 1
        filled = []
        for value, count in zip(values, counts):
            if value is None:
                value = np.full((count, width), np.nan) if otherwise is None else np.tile(otherwise[:width], (count, 1))
            value = np.asarray(value).reshape(count, -1)
            if value.shape[1] != width:
                # Only some parts have alpha, or vectors have different lengths.
                more = np.full((count, max(width - value.shape[1], 0)), 255 if value.dtype == np.uint8 else 1)
                value = np.concatenate([value, more.astype(value.dtype)], axis=1)[:, :width]
            filled.append(value)
        kinds = {value.dtype for value in filled}
        if name == "colors" and len(kinds) > 1:
            filled = [value / 255.0 if value.dtype == np.uint8 else np.asarray(value, float) for value in filled]
        return np.concatenate(filled)

    def columns(name, counts):
        keys = dict.fromkeys(key for part in parts for key in getattr(part, name))
        return {key: joined(key, [getattr(part, name).get(key) for part in parts], counts, None) for key in keys}

    first = np.cumsum([0, *counts[:-1]])
    some_normals = [part.normals for part in parts]
    return Arrays(
        points=np.concatenate([np.asarray(part.points) for part in parts]),
        # Normals are estimated for all parts or for none.
        normals=np.concatenate(some_normals) if all(n is not None for n in some_normals) else None,
        colors=joined("colors", [part.colors for part in parts], counts, np.full(4, 255, np.uint8)),
        faces=np.concatenate([np.asarray(part.faces) + at for part, at in zip(parts, first)]) if meshes else None,
        face_colors=joined("colors", [part.face_colors for part in parts], faces, np.full(4, 255, np.uint8)),
        attributes=columns("attributes", counts),
        face_attributes=columns("face_attributes", faces),
        notes=list(dict.fromkeys(notes)),
    )


# trimesh


def _trimesh(mesh, alone: bool) -> Arrays | bytes:
    import numpy as np

    if _has_texture(mesh) and alone:
        return _as_glb(mesh)
    found = Arrays(np.asarray(mesh.vertices), faces=np.asarray(mesh.faces), attributes=dict(mesh.vertex_attributes),
                   face_attributes=dict(mesh.face_attributes))
    visual = mesh.visual
    if visual.kind == "face":
        found.face_colors = np.asarray(visual.face_colors)
    elif visual.kind == "vertex":
        found.colors = np.asarray(visual.vertex_colors)
    elif visual.kind == "texture":
        found.colors = np.asarray(visual.to_color().vertex_colors)
        if _has_texture(mesh):
            found.notes.append("points: took the mesh's texture at its vertices alone, since other arrays were given")
    return _flat_where_faceless(found)


def _flat_where_faceless(found: Arrays) -> Arrays:
    if found.faces is not None and len(found.faces) == 0:
        found.faces, found.face_colors, found.face_attributes = None, None, {}
        found.notes.append("points: the mesh has no faces, and its vertices are drawn as points")
    return found


def _has_texture(mesh) -> bool:
    material = getattr(getattr(mesh, "visual", None), "material", None)
    images = (getattr(material, name, None) for name in ("image", "baseColorTexture"))
    return getattr(mesh.visual, "uv", None) is not None and any(image is not None for image in images)


def _as_glb(thing) -> bytes:
    """Returns a mesh or scene as the bytes of a glTF file that contains its textures."""
    thing = thing.copy()
    for mesh in getattr(thing, "geometry", {"": thing}).values():
        material = getattr(getattr(mesh, "visual", None), "material", None)
        # The grey that trimesh gives materials without a colour would darken the texture.
        if getattr(material, "image", None) is not None and list(getattr(material, "diffuse", ())) == [102, 102, 102, 255]:
            material.diffuse = [255, 255, 255, 255]
    return thing.export(file_type="glb")


def _trimesh_cloud(cloud, _alone: bool) -> Arrays:
    import numpy as np

    colors = getattr(cloud, "colors", None)
    return Arrays(np.asarray(cloud.vertices), colors=_some(None if colors is None else np.asarray(colors)))


def _trimesh_scene(scene, alone: bool) -> Arrays | bytes:
    parts, textured, others = [], False, {}
    for node in scene.graph.nodes_geometry:
        transform, name = scene.graph[node]
        part = scene.geometry[name]
        if not hasattr(part, "vertices") or not hasattr(part, "apply_transform") or hasattr(part, "entities"):
            others[type(part).__name__] = None
            continue
        textured |= hasattr(part, "faces") and _has_texture(part)
        parts.append(part.copy().apply_transform(transform))
    if textured and alone and not others:
        return _as_glb(scene)
    found = _merged([adapted(part, False) for part in parts], "trimesh scene")
    if others:
        found.notes.append(f"points: left out what is no surface in the trimesh scene: {', '.join(others)}")
    return found


# Open3D


def _numpy(tensor):
    return tensor.cpu().numpy()


def _open3d_extras(found: dict, known: tuple) -> dict:
    """Returns those attributes of Open3D's tensors that have numbers for each row."""
    return {name: _numpy(found[name]) for name in found if name not in known and len(found[name].shape) <= 2}


def _open3d_cloud(cloud, _alone: bool) -> Arrays:
    import numpy as np

    if hasattr(cloud, "point"):
        point = cloud.point
        known = ("positions", "normals", "colors")
        get = lambda name: _numpy(point[name]) if name in point else None  # noqa: E731
        if "positions" not in point:
            raise InputError("points: the Open3D cloud has no positions")
        return Arrays(*map(get, known), attributes=_open3d_extras(point, known))
    return Arrays(np.asarray(cloud.points), normals=_some(np.asarray(cloud.normals)),
                  colors=_some(np.asarray(cloud.colors)))


def _open3d_mesh(mesh, _alone: bool) -> Arrays:
    import numpy as np

    notes = []
    if hasattr(mesh, "vertex"):
        vertex, triangle = mesh.vertex, mesh.triangle
        of = lambda found, name: _numpy(found[name]) if name in found else None  # noqa: E731
        if "positions" not in vertex or "indices" not in triangle:
            raise InputError("points: the Open3D mesh has no positions, or no triangles")
        known = ("positions", "normals", "colors", "indices", "texture_uvs")
        found = Arrays(of(vertex, "positions"), normals=of(vertex, "normals"), colors=of(vertex, "colors"),
                       faces=of(triangle, "indices"), face_colors=of(triangle, "colors"),
                       attributes=_open3d_extras(vertex, known), face_attributes=_open3d_extras(triangle, known))
        textured = "texture_uvs" in triangle or "texture_uvs" in vertex
    else:
        found = Arrays(np.asarray(mesh.vertices), normals=_some(np.asarray(mesh.vertex_normals)),
                       colors=_some(np.asarray(mesh.vertex_colors)), faces=np.asarray(mesh.triangles))
        textured = mesh.has_textures()
    if textured:
        notes.append("points: left out the Open3D mesh's textures: save the mesh and give its file to surfel.open")
    found.notes += notes
    return _suiting(_flat_where_faceless(found))


# PyVista and VTK


def _vtk(thing, alone: bool) -> Arrays:
    try:
        import pyvista
    except ImportError:
        raise InputError(f"points: a {type(thing).__name__} of VTK is read by PyVista, which isn't here: pip install"
                         " pyvista") from None
    return adapted(pyvista.wrap(thing), alone)


def _columns(data, count: int) -> dict:
    """Returns PyVista's arrays with a row for each of `count` points or cells, except arrays that VTK itself adds."""
    return {name: data[name] for name in data.keys() if len(data[name]) == count and not name.startswith("vtk")}


def _take_colors(columns: dict, active: str | None, notes: list[str]):
    """Removes and returns the array of colours: levels of 8 bits, or floats whose name means colours. None without."""
    import numpy as np

    def score(name) -> int:
        values = np.asarray(columns[name])
        if values.ndim != 2 or values.shape[1] not in (3, 4):
            return 0
        named = _COLOR_ARRAY.fullmatch(name) is not None
        if values.dtype == np.uint8:
            return 4 + 2 * named + (name == active)
        in_range = values.dtype.kind == "f" and values.size and values.min() >= 0 and values.max() <= 1
        return 3 + (name == active) if named and in_range else 0

    best = max(columns, key=score, default=None)
    if best is None or score(best) == 0:
        return None
    notes.append(f"colors: the array {best!r}")
    return np.asarray(columns.pop(best))


def _pyvista(data, _alone: bool) -> Arrays:
    import numpy as np

    notes = []
    surface = _surface(data, notes)
    # The order of cells, and of their values: vertices, lines, polygons, strips.
    others = surface.GetNumberOfVerts() + surface.GetNumberOfLines()
    triangles, cells = _triangles(surface)
    if len(triangles) and others:
        notes.append("points: left out the lines and lone vertices beside the faces")
    elif surface.GetNumberOfLines():
        notes.append("points: left out the lines, and drew their points")
    columns = _columns(surface.point_data, surface.n_points)
    normals = columns.pop(surface.point_data.active_normals_name or "Normals", None)
    columns.pop(surface.point_data.active_texture_coordinates_name, None)
    found = Arrays(np.asarray(surface.points), normals=normals, notes=notes)
    if len(triangles):
        found.faces = triangles
        of_cells = _columns(surface.cell_data, surface.n_cells)
        of_cells.pop(surface.cell_data.active_normals_name or "Normals", None)
        of_cells = {name: np.asarray(values)[others + cells] for name, values in of_cells.items()}
        found.face_colors = _take_colors(of_cells, data.active_scalars_name, notes)
        found.face_attributes = of_cells
    found.colors = _take_colors(columns, data.active_scalars_name, notes)
    if found.colors is not None:
        found.face_colors = None
    found.attributes = columns
    return _suiting(found)


def _triangles(surface):
    """Returns the triangles of polygons and strips, and the index of the polygon or strip of each triangle."""
    import numpy as np
    import pyvista

    triangles, cells = [np.empty((0, 3), int)], [np.empty(0, int)]
    polygons, strips = surface.GetNumberOfPolys(), surface.GetNumberOfStrips()
    if polygons:
        # Polygons alone: beside lines, VTK mixes up values of cells.
        alone = pyvista.PolyData(surface.points, faces=surface.faces)
        alone.cell_data["polygon"] = np.arange(polygons)
        cut = alone.triangulate()
        triangles.append(cut.regular_faces)
        cells.append(np.asarray(cut.cell_data["polygon"]))
    flat, at = surface.strips, 0
    for strip in range(strips):
        corners = np.asarray(flat[at + 1 : at + 1 + flat[at]])
        at += 1 + flat[at]
        found = np.stack([corners[:-2], corners[1:-1], corners[2:]], axis=1)
        # Every other one turns the other way.
        found[1::2] = found[1::2, [1, 0, 2]]
        triangles.append(found)
        cells.append(np.full(len(found), polygons + strip))
    return np.concatenate(triangles), np.concatenate(cells)


def _surface(data, notes: list[str]):
    """Returns the faces, lines and vertices of a data set; of solid cells only the outer faces."""
    import warnings

    import pyvista

    if hasattr(data, "GetNumberOfPolys"):
        return data
    if data.n_cells == 0 or data.get_cell(0).dimension == 0 and _only_vertices(data):
        cloud = pyvista.PolyData(data.points)
        for name in data.point_data:
            cloud.point_data[name] = data.point_data[name]
        return cloud
    if data.get_cell(0).dimension == 3:
        notes.append(f"points: took the outer surface of the {type(data).__name__}'s cells")
    with warnings.catch_warnings():
        # PyVista warns about defaults that later versions change.
        warnings.simplefilter("ignore")
        return data.extract_surface(pass_pointid=False, pass_cellid=False)


def _only_vertices(data) -> bool:
    """True if all cells are vertices, or cells of several vertices."""
    return set(map(int, set(getattr(data, "celltypes", [])))) <= {0, 1, 2}


def _multiblock(blocks, alone: bool) -> Arrays:
    """Returns all blocks as one mesh or cloud, without blocks that have no points, such as tables."""
    some = [block for block in blocks if getattr(block, "n_points", 0) or getattr(block, "n_blocks", 0)]
    return _merged([adapted(block, alone) for block in some], "MultiBlock")


# laspy


def _las(las, alone: bool) -> Arrays | bytes:
    import numpy as np

    if alone:
        file = io.BytesIO()
        las.write(file)
        return file.getvalue()
    names = list(las.point_format.dimension_names)
    found = Arrays(np.stack([np.asarray(las[axis], dtype=np.float64) for axis in "xyz"], axis=1), up="+z")
    if {"red", "green", "blue"} <= set(names):
        colors = np.stack([np.asarray(las[name]) for name in ("red", "green", "blue")], axis=1)
        # Sensors without colours write zeros.
        found.colors = colors if colors.any() else None
    others = [name for name in names if name not in ("X", "Y", "Z", "red", "green", "blue")]
    found.attributes = {name: np.asarray(las[name]) for name in others}
    return found


def _las_points(points, alone: bool) -> Arrays | bytes:
    import laspy

    if not hasattr(points, "scales"):
        raise InputError("points: laspy's raw record has no scale, expected LasData or its points")
    header = laspy.LasHeader(point_format=points.point_format)
    header.scales, header.offsets = points.scales, points.offsets
    return _las(laspy.LasData(header, points=points), alone)


# Tables


def _plain(name) -> str:
    """Returns a column's name in lower case and without its unit."""
    return re.sub(r"\s*[\[(][^\])]*[\])]\s*$", "", str(name)).strip().lower()


def _table(names, get) -> Arrays:
    """Returns a table as points. Names of columns decide which are positions, normals, colours or attributes."""
    import numpy as np

    columns = {name: get(name) for name in names}
    by_plain = {}
    for name in columns:
        by_plain.setdefault(_plain(name), name)
    used = set()

    def take(sets):
        for candidates in sets:
            found = [by_plain.get(word) for word in candidates.split()]
            if None not in found:
                used.update(found)
                return np.stack([array(f"points[{name!r}]", columns[name]) for name in found], axis=1)
        return None

    points = take(_POSITIONS)
    if points is None:
        listed = ", ".join(map(str, list(columns)[:12])) or "none"
        raise InputError(f"points: the table has no columns x, y and z; it has {listed}: rename its columns, or give"
                         " arrays")
    normals, colors = take(_NORMALS), take(_COLORS)
    alpha = next((by_plain[name] for name in ("alpha", "a") if name in by_plain), None)
    if colors is not None and alpha is not None:
        used.add(alpha)
        colors = np.concatenate([colors, array(f"points[{alpha!r}]", columns[alpha])[:, None]], axis=1)
    found = Arrays(points, normals=normals, colors=colors)
    words = []
    for name, column in columns.items():
        if name in used:
            continue
        try:
            found.attributes[str(name)] = array(f"points[{name!r}]", column)
        except TypeError:
            words.append(str(name))
    radius = next((str(name) for plain, name in by_plain.items() if plain in ("radius", "radii")), None)
    if radius is not None:
        found.radii = found.attributes.pop(radius, None)
    if words:
        found.notes.append(f"points: left out the columns that hold no numbers: {', '.join(words)}")
    return found


def _data_frame(table, _alone: bool) -> Arrays:
    names = list(table.columns)
    if len(set(names)) < len(names):
        raise InputError("points: several columns of the table have the same name, expected different ones")
    return _table(names, lambda name: table[name])


def _arrow(table, _alone: bool) -> Arrays:
    return _table(table.column_names, lambda name: table[name].to_numpy())


# Functions that read objects, by the package and the name of the object's class or of a base class.
_ADAPTERS = {
    ("trimesh", "Trimesh"): _trimesh,
    ("trimesh", "PointCloud"): _trimesh_cloud,
    ("trimesh", "Scene"): _trimesh_scene,
    ("open3d", "PointCloud"): _open3d_cloud,
    ("open3d", "TriangleMesh"): _open3d_mesh,
    ("pyvista", "DataSet"): _pyvista,
    ("pyvista", "MultiBlock"): _multiblock,
    ("vtkmodules", "vtkDataSet"): _vtk,
    ("vtkmodules", "vtkMultiBlockDataSet"): _vtk,
    ("laspy", "LasData"): _las,
    ("laspy", "PackedPointRecord"): _las_points,
    ("pandas", "DataFrame"): _data_frame,
    ("polars", "DataFrame"): _data_frame,
    ("pyarrow", "Table"): _arrow,
}
