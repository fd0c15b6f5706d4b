"""Exceptions of Surfel. Python's own FileNotFoundError, FileExistsError, PermissionError and TypeError are raised, too.
"""


class Error(Exception):
    """Base class of Surfel's exceptions."""


class UsageError(Error, ValueError):
    """An argument is out of range, contradicts another, or has no effect."""


class InputError(Error, ValueError):
    """A file or an array is damaged, or has the wrong kind of content."""


class BackendError(Error, RuntimeError):
    """The backend is unavailable, or doesn't draw what is requested."""
