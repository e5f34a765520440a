"""Functions of the engine that only compiled code can call, made callable from tests."""

from functools import cache

import numba


@cache
def callable_(function):
    @numba.njit(error_model="numpy")
    def call(*arguments):
        return function(*arguments)

    return call


class Compiled:
    """A module whose compiled functions can be called; other names are handed through."""

    def __init__(self, module):
        self._module = module

    def __getattr__(self, name):
        value = getattr(self._module, name)
        return callable_(value) if isinstance(value, numba.core.dispatcher.Dispatcher) else value
