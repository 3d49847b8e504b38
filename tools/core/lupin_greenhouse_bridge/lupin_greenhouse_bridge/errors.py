"""What can go wrong, in words for the person who reads the log."""


class BridgeError(Exception):
    """An error whose text is one printable line: what, where, what would be right."""

    def __init__(self, message: str):
        super().__init__(printable(' '.join(message.split()), 1000))


class StartUpError(BridgeError):
    """The bridge cannot serve what it was told to serve."""


class ReadingError(BridgeError):
    """The simulator gave no usable reading for a tag that it has loaded."""


def printable(text: str, longest: int) -> str:
    """Return text cut to `longest` characters, with control characters (new lines too) escaped."""
    shown = ''.join(c if c.isprintable() else c.encode('unicode_escape').decode() for c in text[:longest])
    return shown if len(text) <= longest else f'{shown}...'
