"""What the guess of `hysid init` raises where a file can be read and holds no input and output."""


class NothingDrivenError(Exception):
    """No column drives another, as in the log of one sensor: `str(error)` says why."""
