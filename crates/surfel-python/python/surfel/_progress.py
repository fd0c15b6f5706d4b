"""Progress of long work: one line of a terminal or of a notebook's cell, erased at the end."""

import sys

# Text of the line that is shown; empty if none is.
_line = ""


def _shown() -> bool:
    stream = sys.stderr
    return stream is not None and ((hasattr(stream, "isatty") and stream.isatty()) or "ipykernel" in sys.modules)


def show(stage: str, share: float) -> None:
    """Writes the stage and its progress, from 0 to 1, if the line changes."""
    global _line
    line = f"surfel: {stage or 'drawing'} {share:4.0%}"
    # A notebook that is executed to a file would store every version of the line.
    if line != _line and _shown():
        sys.stderr.write("\r" + line.ljust(len(_line)))
        sys.stderr.flush()
        _line = line


def clear() -> None:
    """Erases the line."""
    global _line
    if _shown() and _line:
        sys.stderr.write("\r" + " " * len(_line) + "\r")
        sys.stderr.flush()
    _line = ""
