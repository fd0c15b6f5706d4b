"""Widgets: the protocol of the page, without a browser."""

import base64
import json

import pytest
from conftest import sphere

import surfel

pytest.importorskip("anywidget")


@pytest.fixture
def shown():
    """A widget, and what it has sent."""
    points, colors = sphere()
    widget = surfel.scene(points, colors=colors).widget(view="top", backend="cpu", height=100)
    sent = []
    widget.send = lambda content, buffers=None: sent.append((content, buffers))
    return widget, sent


def ask(widget, sent, **message):
    widget._handle_custom_msg(message, [])
    return sent.pop()


def test_pages_begin_with_options_and_state(shown):
    widget, sent = shown
    welcome, buffers = ask(widget, sent, do="begin")
    assert welcome["inputs"] == ["arrays"]
    assert welcome["do"] == "welcome" and welcome["state"]["view"] == "top" and buffers is None
    assert any(row["name"] == "shader" for row in welcome["rows"])
    assert "surfelSource" in widget._page and "http:" not in widget._page.replace("http://www.w3.org", "")


def test_images_at_rest_are_those_of_render_and_set_the_camera(shown):
    widget, sent = shown
    seen = []
    widget.observe(lambda change: seen.append(change["new"]), "camera")
    state = {"view": "top", "backend": "cpu"}
    header, [file] = ask(widget, sent, do="draw", id=1, layer=0, state=state, size=[64, 48])
    length = int.from_bytes(file[:4], "little")
    assert header == json.loads(file[4 : 4 + length]) and header["id"] == 1
    points, colors = sphere()
    image = surfel.scene(points, colors=colors).render(view="top", backend="cpu", size=(64, 48))
    assert file[4 + length :] == image.png()
    assert seen == [header["camera"]] and surfel.Camera.from_dict(widget.camera).size == (64, 48)
    ask(widget, sent, do="draw", id=2, layer=0, state={**state, "eye": "0,0,9"}, size=[32, 24], moving=True)
    assert len(seen) == 1, "moving images change nothing"


def test_picks_can_be_observed(shown):
    widget, sent = shown
    seen = []
    widget.observe(lambda change: seen.append(change["new"]), "picked")
    state = {"view": "top", "backend": "cpu"}
    ask(widget, sent, do="pick", id=3, state=state, size=[64, 48], at=[32, 24])
    assert len(seen) == 1 and seen[0]["position"][2] == pytest.approx(1, abs=0.05)
    ask(widget, sent, do="pick", id=4, state=state, size=[64, 48], at=[0, 0])
    assert widget.picked is None


def test_errors_are_answers(shown):
    widget, sent = shown
    for message in ({"do": "draw", "id": 5, "size": [64, 48], "state": {"shader": "none"}}, {"do": "rename", "id": 5}):
        answer, _ = ask(widget, sent, **message)
        assert answer["do"] == "error" and answer["id"] == 5


def test_a_still_image_stands_in_without_widgets(shown):
    widget, _ = shown
    bundle = widget._repr_mimebundle_()
    data = bundle[0] if isinstance(bundle, tuple) else bundle
    assert base64.b64decode(data["image/png"]).startswith(b"\x89PNG")
    assert "application/vnd.jupyter.widget-view+json" in data


def test_wrong_flags_are_refused():
    points, _ = sphere()
    with pytest.raises(TypeError):
        surfel.scene(points).widget(shadow=True)
    with pytest.raises(surfel.UsageError):
        surfel.scene(points).widget(lights=[])
