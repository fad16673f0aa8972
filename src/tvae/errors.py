"""The root of all errors that a user can mend."""


class TvaeError(ValueError):
    """Something was asked for that cannot be; the message says what was needed and what came."""
