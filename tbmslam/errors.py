"""The base of all errors of this project, and text that is safe to print in their messages."""


class TbmSlamError(Exception):
    """An error outside of the program. The message states the place, the problem and the remedy.

    Each module defines its own subclass where it raises it. Wrong arguments from code are `ValueError` instead.
    """


def printable(text: str) -> str:
    """Return a text in one line, with escapes for characters that control a terminal or are invisible.

    Line ends, control and format characters (such as ESC, or those that turn the direction of writing) and bytes that
    are no text are not printable.
    """
    return "".join(char if char.isprintable() else char.encode("unicode_escape").decode("ascii") for char in text)
