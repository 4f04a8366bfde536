"""The root of every error this project raises on purpose."""


class TbmSlamError(Exception):
    """Something outside the program is wrong: the message names the place, the fact and the remedy.

    Each module defines its own subclass where it raises it. Wrong arguments from code are `ValueError` instead.
    """
