"""How far long work has come: one line of a terminal or of a notebook's cell, taken away at the end."""

import sys

_width = 0


def _shown() -> bool:
    stream = sys.stderr
    return stream is not None and ((hasattr(stream, "isatty") and stream.isatty()) or "ipykernel" in sys.modules)


def show(stage: str, share: float) -> None:
    """Says the stage and its share, from 0 to 1."""
    global _width
    if _shown():
        line = f"surfel: {stage or 'drawing'} {share:4.0%}"
        sys.stderr.write("\r" + line.ljust(_width))
        sys.stderr.flush()
        _width = len(line)


def clear() -> None:
    """Takes the line away."""
    global _width
    if _shown() and _width:
        sys.stderr.write("\r" + " " * _width + "\r")
        sys.stderr.flush()
    _width = 0
