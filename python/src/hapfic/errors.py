"""The error of this package."""


class HapficError(Exception):
    """What was found and what was expected, in one line."""
