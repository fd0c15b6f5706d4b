"""Makes flat Gaussians (2DGS) of a splat file, as a stand-in for a trained radiance field.

    surfel convert assets/spot/spot.obj --splats 4000 --ascii -o spot.ply
    python3 assets/tutorial/gaussians.py spot.ply > assets/generated/spot-gaussians.ply

Reads the ASCII splat files of `surfel convert`, of disks with 8-bit or linear colours. A disk of radius r becomes a
Gaussian of the standard deviation r / 2, with an opacity of 0.9 and without higher harmonics.
"""

import math
import sys

FIRST_HARMONIC = 0.28209479177387814
OPACITY = math.log(0.9 / 0.1)  # before the sigmoid


def encoded(linear):
    """Encodes linear light as sRGB."""
    return 12.92 * linear if linear <= 0.0031308 else 1.055 * linear ** (1 / 2.4) - 0.055


def rotation(normal):
    """Returns the quaternion (w, x, y, z) that turns the z axis to a normal."""
    length = math.sqrt(sum(n * n for n in normal))
    x, y, z = (n / length for n in normal)
    if z < -0.999999:
        return 0.0, 1.0, 0.0, 0.0
    w = math.sqrt((1 + z) / 2)
    return w, -y / (2 * w), x / (2 * w), 0.0


lines = iter(open(sys.argv[1], encoding="utf-8"))
properties = []
for line in lines:
    words = line.split()
    if words[0] == "property":
        properties.append((words[-1], words[-2]))
    if words[0] == "end_header":
        break
names = [name for name, _ in properties]
is_linear = dict(properties)["red"] == "float"
rows = [dict(zip(names, map(float, line.split()))) for line in lines]

print(f"ply\nformat ascii 1.0\nelement vertex {len(rows)}")
columns = "x y z f_dc_0 f_dc_1 f_dc_2 opacity scale_0 scale_1 rot_0 rot_1 rot_2 rot_3".split()
print("\n".join(f"property float {name}" for name in columns) + "\nend_header")
for row in rows:
    colors = [row[name] for name in ("red", "green", "blue")]
    colors = [encoded(c) if is_linear else c / 255 for c in colors]
    harmonics = [(c - 0.5) / FIRST_HARMONIC for c in colors]
    if "radius" in row:
        normal, scale = (row["nx"], row["ny"], row["nz"]), row["radius"] / 2
    else:
        s, t = ([row[axis + c] for c in "uvw"] for axis in "st")
        normal = (s[1] * t[2] - s[2] * t[1], s[2] * t[0] - s[0] * t[2], s[0] * t[1] - s[1] * t[0])
        scale = math.sqrt(math.hypot(*s) * math.hypot(*t)) / 2
    values = [row["x"], row["y"], row["z"], *harmonics, OPACITY, math.log(scale), math.log(scale), *rotation(normal)]
    print(" ".join(f"{value:.6g}" for value in values))
