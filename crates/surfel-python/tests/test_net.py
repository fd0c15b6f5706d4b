"""A net under changes that must not change behaviour: pixels, files, notes and messages of the package.

`net.json` holds what the package gave. `SURFEL_NET=write pytest test_net.py` records it anew; `git diff` then shows
what changed, and the commit says why. The command line has a net of its own, in `crates/surfel-cli/tests/net`.
"""

import hashlib
import json
import os
import pathlib
import re

import conftest
import numpy as np
import pytest
import surfel
from conftest import SCENES

EXPECTED = pathlib.Path(__file__).with_name("net.json")


def digest(data):
    """The first half of SHA-256 of bytes or of an array."""
    return hashlib.sha256(data if isinstance(data, bytes) else np.ascontiguousarray(data).tobytes()).hexdigest()[:32]


def drawn(name):
    inputs, opened, rendered = SCENES[name]
    image = surfel.open(*inputs, **opened).render(size=(48, 36), **rendered)
    return {"rgba": digest(image.rgba), "depth": digest(image.depth), "png": digest(image.png(metadata=False)),
            "notes": image.notes}


def made(path):
    return {"file": digest(pathlib.Path(path).read_bytes())}


def film():
    return {"images": [digest(image.rgba) for image in surfel.open("disks.ply").render_many(turntable=3, size=(24, 18))]}


def arrays(**more):
    points, colors = conftest.sphere(500)
    image = surfel.scene(points, colors=colors, **more).render(size=(48, 36))
    return {"rgba": digest(image.rgba), "notes": image.notes}


def converted(source, out, **flags):
    notes = surfel.convert(source, out, force=True, **flags)
    return made(out) | {"notes": [note for note in notes or [] if "hours" not in note]}


CALLS = {
    **{f"open: {name}": lambda name=name: drawn(name) for name in SCENES},
    "planes": lambda: {
        plane: digest(getattr(surfel.open("values.ply").render(
            size=(48, 36), planes=["index", "label", "position"], label="classification"), plane))
        for plane in ("index", "object", "label", "position", "normal", "weight")
    },
    "arrays": arrays,
    "arrays as balls": lambda: arrays(points_as="balls"),
    "arrays coloured by height": lambda: arrays(color_by="height", colormap="turbo"),
    "turntable": film,
    "figure": lambda: {"svg": digest(surfel.figure(["points.ply", "disks.ply"], size=(48, 36)).svg().encode())},
    "convert": lambda: converted("points.ply", "out.ply"),
    "convert to text": lambda: converted("box.ply", "text.ply", splats=100, ascii=True),
    "convert to an octree": lambda: converted("box.ply", "box.surfel", hybrid=True),
    "info": lambda: {"facts": surfel.info("values.ply")},
    "missing file": lambda: surfel.open("missing.ply").render(size=(8, 8)),
    "wrong flag": lambda: surfel.open("points.ply").render(size=(8, 8), shader="none"),
    "unknown flag": lambda: surfel.open("points.ply").render(sise=(8, 8)),
    "flags that contradict": lambda: surfel.open("box.ply", per_vertex=True, per_face=True).render(size=(8, 8)),
    "option without effect": lambda: surfel.open("disks.ply", max_points=5).render(size=(8, 8)),
    "attribute that isn't there": lambda: surfel.open("points.ply", color_by="red").render(size=(8, 8)),
    "empty selection": lambda: surfel.open("points.ply", crop=(8, 8, 8, 9, 9, 9)).render(size=(8, 8)),
    "existing file": lambda: surfel.convert("points.ply", "points.ply"),
    "too little memory": lambda: surfel.open("points.ply", memory=1000).render(size=(8, 8)),
}


def outcome(call):
    """What a call gives: hashes and notes, or the exception."""
    try:
        return call()
    except Exception as error:  # noqa: BLE001 - every exception is an outcome
        message = re.sub(r"/\S*/", "", str(error))
        return {"raises": type(error).__name__, "message": message}


def test_the_package_gives_what_it_gave(data, monkeypatch):
    monkeypatch.chdir(data)
    found = {name: outcome(call) for name, call in CALLS.items()}
    if os.environ.get("SURFEL_NET") == "write":
        EXPECTED.write_text(json.dumps(found, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
        pytest.skip(f"{EXPECTED.name} is written")
    expected = json.loads(EXPECTED.read_text(encoding="utf-8"))
    found = json.loads(json.dumps(found))
    differing = {name: found.get(name) for name in expected.keys() | found.keys() if found.get(name) != expected.get(name)}
    assert not differing, json.dumps(differing, indent=1, ensure_ascii=False)
    assert sum("rgba" in of for of in found.values()) > 10 and sum("raises" in of for of in found.values()) > 5
