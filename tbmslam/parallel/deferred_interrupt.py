"""What a signal raises, raised where nothing is held that others wait for."""

import signal
import threading
from collections.abc import Callable
from functools import partial
from types import FrameType
from typing import Self

_ENDING = (signal.SIGINT, signal.SIGTERM)


class DeferredInterrupt:
    """A block at whose end is raised what a signal's handler raised in it.

    Python runs a handler between any two steps of the main thread. If it raises in `threading.Condition.__enter__`, the
    lock stays taken, and another thread that has to end before this one waits for it for ever.

    Parameters
    ----------
    hurry
        Asked, when the signal has come, to have the block end soon. A second signal is raised there and then.

    Attributes
    ----------
    came
        What was raised, while it waits to be raised again.
    """

    def __init__(self, hurry: Callable[[], object]) -> None:
        self.came: BaseException | None = None
        self._hurry = hurry
        self._usual: dict[signal.Signals, Callable[[int, FrameType | None], object]] = {}

    def __enter__(self) -> Self:
        """Take the place of the handlers there are; only a main thread has any."""
        if threading.current_thread() is threading.main_thread():
            for number in _ENDING:
                usual = signal.getsignal(number)
                if callable(usual):
                    self._usual[number] = usual
                    signal.signal(number, partial(self._heard, usual))
        return self

    def __exit__(self, *_: object) -> None:
        """Give the handlers back their place, and raise what came."""
        for number, usual in self._usual.items():
            signal.signal(number, usual)
        self.give_way()

    def give_way(self) -> None:
        """Raise what came, if anything did, where nothing is held."""
        came, self.came = self.came, None
        if came is not None:
            raise came from None

    def _heard(self, usual: Callable[[int, FrameType | None], object], number: int, frame: FrameType | None) -> None:
        if self.came is not None:
            usual(number, frame)
            return
        try:
            usual(number, frame)
        except BaseException as error:  # noqa: BLE001 - raised again at the end of the block
            self.came = error
            self._hurry()
