"""BLAS held to one thread while floatplan computes: a sum shared among threads has other last bits."""

from __future__ import annotations

import functools
import threading
from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar

P = ParamSpec("P")
R = TypeVar("R")

_lock = threading.Lock()
_here = threading.local()  # ``held``: whether this thread is in such a call already
_calls = 0  # under way, in all threads of this process: BLAS has one number of threads for all of them
_held: list[tuple[Any, int]] = []  # libraries, and the threads that each had before


@functools.cache
def _libraries() -> tuple[Any, ...]:
    """NumPy's BLAS, and what else is loaded when floatplan first computes; looking for them takes milliseconds."""
    import numpy as np  # noqa: F401 - so that its library is there
    from threadpoolctl import ThreadpoolController

    return tuple(ThreadpoolController().select(user_api="blas").lib_controllers)


class _OneThread:
    """Holds from the first call that begins to the last one that ends; costs microseconds, as threads come and go."""

    def __enter__(self) -> None:
        global _calls
        with _lock:
            if _calls == 0:
                _held[:] = [(library, library.num_threads) for library in _libraries()]
                for library, threads in _held:
                    if threads != 1:
                        library.set_num_threads(1)
            _calls += 1

    def __exit__(self, *_: object) -> None:
        global _calls
        with _lock:
            _calls -= 1
            if _calls == 0:
                for library, threads in _held:
                    if threads != 1:
                        library.set_num_threads(threads)


_ONE_THREAD = _OneThread()


def one_thread(function: Callable[P, R]) -> Callable[P, R]:
    """Let a function compute the same bits whatever the number of threads that BLAS may use, and put that back."""

    @functools.wraps(function)
    def held(*args: P.args, **kwargs: P.kwargs) -> R:
        if getattr(_here, "held", False):
            return function(*args, **kwargs)
        with _ONE_THREAD:
            _here.held = True
            try:
                return function(*args, **kwargs)
            finally:
                _here.held = False

    return held
