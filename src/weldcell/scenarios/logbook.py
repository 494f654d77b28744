"""What a run leaves for review; this one keeps nothing."""


class Logbook:
    """Takes every event and forgets it."""

    def __getattr__(self, name):
        return lambda *a, **k: None
