"""The root of all errors that a user can mend, and the one that several layers raise."""


class TvaeError(ValueError):
    """Something was asked for that cannot be; the message says what was needed and what came."""


class ModelError(TvaeError):
    """A model, or what belongs to it, that cannot be loaded; the message says why."""
