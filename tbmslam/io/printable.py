"""Text from elsewhere, as a terminal may show it: names in bags, of files and from servers can hold anything."""


def printable(text: str) -> str:
    """Return a text in one line, with escapes for characters that control a terminal or are invisible.

    Line ends, control and format characters (such as ESC, or those that turn the direction of writing) and bytes that
    are no text are not printable.
    """
    return "".join(char if char.isprintable() else char.encode("unicode_escape").decode("ascii") for char in text)
