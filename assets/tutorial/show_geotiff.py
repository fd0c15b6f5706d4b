"""Shows the GeoTIFF files of images.sh as PNG images: colours as they are, heights as a shaded relief.

    python3 assets/tutorial/show_geotiff.py FOLDER docs/images
"""

import sys

import numpy as np
import tifffile
from PIL import Image

NO_DATA = -9999.0


def relief(heights, pixel=0.25):
    """Returns a shaded relief: grey for slopes, lit from the north-west, and white where there is no data."""
    is_data = heights > NO_DATA
    z = np.where(is_data, heights, heights[is_data].min())
    down, right = np.gradient(z, pixel)
    lit = (1.0 - 0.5 * right - 0.5 * down) / np.sqrt(1.0 + right**2 + down**2) / 1.25
    return np.where(is_data, 255.0 * np.clip(0.12 + 0.8 * lit, 0.0, 0.95), 255.0).astype(np.uint8)


def first_band(path):
    """Returns the first band of the full image, whichever of its axes counts the bands."""
    image = tifffile.TiffFile(path).pages[0].asarray()
    if image.ndim == 2:
        return image
    return image[..., 0] if image.shape[-1] < 8 else image[0]


folder, images = sys.argv[1:]
color = tifffile.TiffFile(f"{folder}/rgb.tif").pages[0].asarray()
Image.fromarray(color[..., :3]).save(f"{images}/ortho-rgb.png", optimize=True)
for name in ("dsm", "open", "filled"):
    Image.fromarray(relief(first_band(f"{folder}/{name}.tif"))).save(f"{images}/ortho-{name}.png", optimize=True)
