"""The page of `surfel view` in a notebook. The kernel draws; messages take the notebook's own channel."""

from __future__ import annotations

import functools
import json
import os
import pathlib

from . import _flags, _native
from ._errors import UsageError


def _packed(answer):
    """Splits an answer to a header and its file's bytes, or None."""
    if isinstance(answer, str):
        return json.loads(answer), None
    length = int.from_bytes(answer[:4], "little")
    return json.loads(answer[4 : 4 + length]), answer


@functools.cache
def _widget_class():
    try:
        import anywidget
        import traitlets
    except ImportError:
        raise ImportError("a widget needs the package anywidget: pip install 'surfel[widget]'") from None

    class Widget(anywidget.AnyWidget):
        """A scene to look around in, in Jupyter and VS Code.

        Attributes
        ----------
        camera : dict or None
            The camera of the newest exact image, as in a scene file: `surfel.Camera.from_dict` takes it.
        picked : dict or None
            What was picked last: position, normal, row, and values of the attributes.

        Both can be observed: `widget.observe(function, "picked")`.
        """

        _esm = pathlib.Path(__file__).with_name("widget.js")
        _page = traitlets.Unicode().tag(sync=True)
        height = traitlets.Int(500).tag(sync=True)
        camera = traitlets.Dict(allow_none=True, default_value=None, read_only=True)
        picked = traitlets.Dict(allow_none=True, default_value=None, read_only=True)

        def __init__(self, scene, flags, threads, still, height):
            super().__init__(_page=_native.widget_page(), height=height)
            self._painter = _native.Painter(scene, flags, threads)
            self._still = still
            self.on_msg(self._answer)

        def _answer(self, _widget, message, _buffers):
            if message.get("do") == "begin":
                welcome = json.loads(self._painter.welcome())
                # Arrays have no name.
                welcome["inputs"] = ["arrays" if name == "-" else name for name in welcome["inputs"]]
                return self.send(welcome)
            header, file = _packed(self._painter.answer(json.dumps(message)))
            # The page learns of an image before the program does.
            self.send(header, buffers=None if file is None else [file])
            if header.get("do") == "image" and not header["moving"] and not header["layer"]:
                self.set_trait("camera", header["camera"])
            elif header.get("do") == "picked":
                self.set_trait("picked", header["picked"])

        def _repr_mimebundle_(self, **kwargs):
            bundle = super()._repr_mimebundle_(**kwargs)
            data, *metadata = bundle if isinstance(bundle, tuple) else (bundle,)
            # What hosts without widgets show, and files of notebooks hold.
            data = {**(data or {}), "image/png": self._still()}
            return (data, *metadata) if metadata else data

    return Widget


def widget(scene, height: int, flags: dict):
    """Returns the widget of a scene: see `Scene.widget`."""
    for name in ("lights", "camera"):
        value = flags.get(name, scene._base.get(name))
        if value is not None and not isinstance(value, (str, os.PathLike)):
            raise UsageError(f"{name}: a widget takes no {name} of Python: view, eye and target move the camera")
    texts = scene._texts(flags, "widget")
    threads = int(dict(texts).get("threads", 0))
    flags_of_page = [(name, text) for name, text in texts if name != "threads"]

    def still() -> str:
        import base64

        size = flags.get("size", scene._base.get("size", (height * 8 // 5, height)))
        return base64.b64encode(scene.render(**{**flags, "size": size}).png()).decode()

    return _widget_class()(scene._native, flags_of_page, threads, still, height)
