"""What surfel raises, besides Python's own FileNotFoundError, FileExistsError, PermissionError and TypeError."""


class Error(Exception):
    """Anything that went wrong."""


class UsageError(Error, ValueError):
    """An argument is out of range, contradicts another, or has nothing to act on."""


class InputError(Error, ValueError):
    """A file or an array is damaged, or isn't what it is used as."""


class BackendError(Error, RuntimeError):
    """The backend isn't here, or doesn't draw what is asked of it."""
