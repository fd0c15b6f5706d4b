"""Writes a sequence of scans of a swinging sheet that doesn't exist: 24 files of points as text, with speeds.

    python3 assets/tutorial/swing.py assets/generated

Every file has other random points of the surface, and a column `speed` in m/s. Python's standard library is enough,
and every run writes the same bytes.
"""

import math
import random
import sys

FRAMES, POINTS = 24, 12000


def surface(u, v, time):
    """Height of the sheet at a place from 0 to 1, and its speed."""
    wave = 2 * math.pi * (1.5 * u + 0.4 * math.sin(2 * v) - time)
    height = 0.16 * u * math.sin(wave) + 0.05 * math.sin(2 * math.pi * (v + time))
    speed = 2 * math.pi * abs(-0.16 * u * math.cos(wave) + 0.05 * math.cos(2 * math.pi * (v + time)))
    return height, speed


def main():
    for frame in range(FRAMES):
        rng = random.Random(frame)
        with open(f"{sys.argv[1]}/swing-{frame:02}.csv", "w", encoding="ascii") as file:
            file.write("x,y,z,speed\n")
            for _ in range(POINTS):
                u, v = rng.random(), rng.random()
                height, speed = surface(u, v, frame / FRAMES)
                file.write(f"{1.6 * u:.4f},{v:.4f},{height:.4f},{speed:.3f}\n")


main()
