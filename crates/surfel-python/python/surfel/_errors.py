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


def not_built(name: str, feature: str, available: str) -> BackendError:
    """Returns the error for a backend that this installation was built without."""
    return BackendError(
        f"backend '{name}' is not built into this installation, which has {available}: {how_to_build(feature)}"
    )


def how_to_build(feature: str) -> str:
    """Returns how pip installs the package with a feature of Cargo."""
    return (
        "wheels have every backend (pip install surfel --force-reinstall --only-binary surfel); a checkout builds it "
        f"with pip install . --config-settings build-args='--features {feature}'"
    )
