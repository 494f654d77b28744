"""The exceptions that weldcell raises; each says what was given and what was expected."""


class WeldcellError(Exception):
    """Anything that weldcell refuses, worded for the person who caused it."""


class BadInput(WeldcellError):
    """A file, option or value from outside that cannot be used (exit code 2)."""


class BadGeometry(WeldcellError, ValueError):
    """A transform, camera or plane that is not one: NaN, singular, not a rotation."""


class UnknownFrame(WeldcellError, KeyError):
    """A frame that this cell does not have."""

    def __init__(self, name: str, available: list[str]) -> None:
        self.message = f"UnknownFrame: {name!r} is not a frame of this cell. Available: {', '.join(sorted(available))}"
        super().__init__(self.message)

    def __str__(self) -> str:
        return self.message


class OutOfReach(WeldcellError):
    """A pose that the arm cannot take within its limits, or not without a collision."""


class NotReady(WeldcellError):
    """A sensor or scene asked for something before it was set up."""


class JobFailed(WeldcellError):
    """The job ran, and its own acceptance failed (exit code 1)."""
