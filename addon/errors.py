"""The two errors that reach a user."""


class NacreError(Exception):
    """A user's mistake or a broken file; the text is one line: what was wrong and what to do."""


class Cancelled(NacreError):
    """Long work was stopped on request; nothing half-written was left."""

    def __init__(self) -> None:
        super().__init__("cancelled")
