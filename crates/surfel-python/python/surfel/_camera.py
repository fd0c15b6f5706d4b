"""Cameras as objects, which several scenes can share."""

from __future__ import annotations

import json
import numbers

from . import _arrays
from ._errors import InputError, UsageError


def _numbers(name: str, values, count: int) -> tuple[float, ...]:
    try:
        found = tuple(float(value) for value in values)
    except (TypeError, ValueError):
        raise UsageError(f"{name}: {values!r}, expected {count} numbers") from None
    if len(found) != count:
        raise UsageError(f"{name}: {len(found)} numbers, expected {count}")
    return found


def _matrix(what: str, value, shapes):
    import numpy as np

    found = np.asarray(_arrays.array(what, value), dtype=np.float64)
    if found.shape not in shapes:
        raise InputError(f"{what}: shape {found.shape}, expected {' or '.join(map(str, shapes))}")
    if not np.isfinite(found).all():
        raise InputError(f"{what}: holds numbers that are not finite")
    return found


def opencv(K, world_from_camera, size, name=None) -> dict:
    """Returns a camera with OpenCV's axes in the JSON format of `--cameras`."""
    K = _matrix("K", K, [(3, 3)])
    T = _matrix("world_from_camera", world_from_camera, [(4, 4), (3, 4)])
    R = T[:3, :3].T
    camera = {"K": K.tolist(), "R": R.tolist(), "t": (-R @ T[:3, 3]).tolist()}
    if size is not None:
        camera["size"] = whole_size(size)
    if name is not None:
        camera["name"] = str(name)
    return camera


def whole_size(size) -> list[int]:
    """Returns width and height in pixels. Raises UsageError for other values."""
    try:
        sides = list(size)
        if len(sides) == 2 and all(isinstance(side, numbers.Real) and side == int(side) > 0 for side in sides):
            return [int(side) for side in sides]
    except (TypeError, ValueError, OverflowError):
        pass
    raise UsageError(f"size: {size!r}, expected (width, height) in pixels")


class Camera:
    """A camera, as in a scene file. `image.camera` is one, and `Scene.render(camera=...)` accepts one, so that several
    scenes can share it. Cameras are immutable, and can be compared and pickled.

    Exactly one of `fov_y`, `height` and `focal` is needed.

    Parameters
    ----------
    eye, target : sequence of 3 floats
        Position of the eye and the point that it looks at, in world units.
    size : tuple of int
        Width and height in pixels.
    up : sequence of 3 floats
        Direction that appears upward in the image.
    fov_y : float, optional
        Vertical field of view in degrees.
    height : float, optional
        Height of the visible region of a parallel projection, in world units.
    focal, principal : tuple of float, optional
        Focal lengths (fx, fy), and the principal point (cx, cy) from the upper left corner of the image, in pixels.
    near : float, optional
        Depth in front of which nothing is drawn, in world units. None fits the plane to each scene.
    far : float, optional
        Depth behind which a parallel projection draws nothing, in world units. None fits the plane to each scene.

    Raises
    ------
    UsageError
        A number is out of range, or the projection is missing or ambiguous.
    """

    def __init__(
        self,
        eye,
        target,
        size,
        *,
        up=(0, 1, 0),
        fov_y=None,
        height=None,
        focal=None,
        principal=None,
        near=None,
        far=None,
    ):
        said = [name for name, value in (("fov_y", fov_y), ("height", height), ("focal", focal)) if value is not None]
        if len(said) != 1 or (focal is None) != (principal is None):
            raise UsageError(f"Camera: {' and '.join(said) or 'no projection'}, expected one of fov_y, height, or focal"
                             " with principal")
        number = lambda name, value: _numbers(name, [value], 1)[0]  # noqa: E731
        if fov_y is not None:
            projection = {"perspective": {"fov_y_deg": number("fov_y", fov_y)}}
        elif height is not None:
            projection = {"orthographic": {"height": number("height", height)}}
        else:
            (fx, fy), (cx, cy) = _numbers("focal", focal, 2), _numbers("principal", principal, 2)
            projection = {"intrinsics": {"fx": fx, "fy": fy, "cx": cx, "cy": cy}}
        data = {"eye": _numbers("eye", eye, 3), "target": _numbers("target", target, 3), "up": _numbers("up", up, 3),
                "projection": projection, "size": tuple(whole_size(size))}
        data.update((name, number(name, value)) for name, value in (("near", near), ("far", far)) if value is not None)
        self._data = data

    @classmethod
    def from_dict(cls, camera) -> Camera:
        """Creates a camera from the `camera` object of a scene file."""
        data = dict(camera)
        try:
            eye, target, size, projection = (data.pop(key) for key in ("eye", "target", "size", "projection"))
            (kind, lens), = projection.items()
        except KeyError as missing:
            raise UsageError(f"camera: has no {missing}, expected eye, target, size and projection") from None
        except (AttributeError, TypeError, ValueError):
            raise UsageError(f"camera: the projection {projection!r}, expected one of perspective, orthographic and"
                             " intrinsics, as in a scene file") from None
        lenses = {"perspective": {"fov_y_deg"}, "orthographic": {"height"}, "intrinsics": {"fx", "fy", "cx", "cy"}}
        if not isinstance(lens, dict) or lenses.get(kind) != set(lens):
            raise UsageError(f"camera: the projection {projection!r}, expected one of {lenses}")
        unknown = set(data) - {"up", "near", "far"}
        if unknown:
            raise UsageError(f"camera: unknown keys {sorted(map(str, unknown))}, expected eye, target, up, projection,"
                             " near, far and size")
        if kind == "intrinsics":
            data.update(focal=(lens["fx"], lens["fy"]), principal=(lens["cx"], lens["cy"]))
        else:
            data["fov_y" if kind == "perspective" else "height"] = next(iter(lens.values()))
        return cls(eye, target, size, **data)

    @classmethod
    def from_matrices(cls, K, world_from_camera, size, *, near=None) -> Camera:
        """Creates a camera from a matrix K and a pose, as in `Scene.render`.

        Parameters
        ----------
        K : array of shape (3, 3)
            Focal lengths and principal point, in pixels from the centre of the first pixel.
        world_from_camera : array of shape (4, 4) or (3, 4)
            Pose of a camera that looks along its +z with y down.
        size : tuple of int
            Width and height in pixels.
        near : float, optional
            Depth in front of which nothing is drawn, in world units.

        Raises
        ------
        InputError
            K has a skew, or the pose isn't a rotation and a translation.
        """
        import numpy as np

        K = _matrix("K", K, [(3, 3)])
        T = _matrix("world_from_camera", world_from_camera, [(4, 4), (3, 4)])
        if abs(K[0, 1]) > 1e-9 * abs(K[0, 0]) or np.any(K[2] != [0, 0, 1]) or K[1, 0] != 0:
            raise InputError("K: has a skew or another last row, expected [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]")
        R, eye = T[:3, :3], T[:3, 3]
        if not np.allclose(R @ R.T, np.eye(3), atol=1e-4) or np.linalg.det(R) < 0:
            raise InputError("world_from_camera: turns no rotation, expected one: it stretches or mirrors")
        # Far enough for the direction to keep its digits.
        target = eye + R[:, 2] * max(1.0, np.abs(eye).max())
        return cls(eye, target, size, up=-R[:, 1], focal=(K[0, 0], K[1, 1]),
                   principal=(K[0, 2] + 0.5, K[1, 2] + 0.5), near=near)

    @property
    def eye(self) -> tuple[float, float, float]:
        """Position of the eye, in world units."""
        return self._data["eye"]

    @property
    def target(self) -> tuple[float, float, float]:
        """Point that the camera looks at, in world units."""
        return self._data["target"]

    @property
    def up(self) -> tuple[float, float, float]:
        """Direction that appears upward in the image."""
        return self._data["up"]

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the image in pixels."""
        return self._data["size"]

    @property
    def projection(self) -> dict:
        """Projection, as in a scene file."""
        return {kind: dict(lens) for kind, lens in self._data["projection"].items()}

    @property
    def near(self) -> float | None:
        """Depth in front of which nothing is drawn, in world units; None fits it to each scene."""
        return self._data.get("near")

    @property
    def far(self) -> float | None:
        """Depth behind which a parallel projection draws nothing, in world units; None fits it to each scene."""
        return self._data.get("far")

    @property
    def K(self):
        """Focal lengths and principal point, of shape (3, 3), in pixels from the centre of the first pixel.

        None for a parallel projection.
        """
        import numpy as np

        (kind, lens), = self._data["projection"].items()
        width, height = self.size
        if kind == "orthographic":
            return None
        if kind == "perspective":
            focal = 0.5 * height / np.tan(0.5 * np.radians(lens["fov_y_deg"]))
            lens = {"fx": focal, "fy": focal, "cx": 0.5 * width, "cy": 0.5 * height}
        return np.array([[lens["fx"], 0, lens["cx"] - 0.5], [0, lens["fy"], lens["cy"] - 0.5], [0, 0, 1]])

    @property
    def world_from_camera(self):
        """Pose of shape (4, 4) of a camera that looks along its +z with y down, as in OpenCV."""
        import numpy as np

        unit = lambda v: v / np.linalg.norm(v)  # noqa: E731
        eye = np.array(self.eye)
        forward = unit(np.array(self.target) - eye)
        right = unit(np.cross(forward, self.up))
        pose = np.eye(4)
        pose[:3] = np.stack([right, np.cross(forward, right), forward, eye], axis=1)
        return pose

    def to_dict(self) -> dict:
        """Returns the `camera` object of a scene file. It omits near and far planes that are fitted to each scene."""
        return json.loads(json.dumps(self._data))

    def with_size(self, width: int, height: int) -> Camera:
        """Returns the same camera for images of another size, in pixels.

        Focal lengths and the principal point in pixels scale with the height.
        """
        data = self.to_dict()
        lens = data["projection"].get("intrinsics")
        if lens is not None:
            scale = height / self.size[1]
            lens.update(fx=lens["fx"] * scale, fy=lens["fy"] * scale, cy=lens["cy"] * scale,
                        cx=0.5 * width + (lens["cx"] - 0.5 * self.size[0]) * scale)
        data["size"] = (width, height)
        return Camera.from_dict(data)

    def __eq__(self, other) -> bool:
        return isinstance(other, Camera) and self._data == other._data

    def __hash__(self) -> int:
        return hash(json.dumps(self._data, sort_keys=True))

    def __repr__(self) -> str:
        (kind, _), = self._data["projection"].items()
        text = lambda place: ", ".join(f"{x:g}" for x in place)  # noqa: E731
        width, height = self.size
        return f"<surfel.Camera {kind} {width}x{height}: eye ({text(self.eye)}), target ({text(self.target)})>"
