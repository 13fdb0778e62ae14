"""The error of a recording that cannot be used."""


class RecordingError(ValueError):
    """A recording that cannot be used; the text names the file or column, and the remedy."""
