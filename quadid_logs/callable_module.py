"""Modules that are called as the function they are named after.

`quadid_logs.simulate` is a package and a verb. Importing it anywhere sets the attribute of `quadid_logs`, so
the attribute cannot be the function; a module may have a class of its own [1]_, and that one can be called:
``quadid_logs.simulate("sysid-quad-x")`` beside ``quadid_logs.simulate.Simulation``.

References
----------
.. [1] The Python Language Reference, 3.3.2.1, "Customizing module attribute access".
"""

from __future__ import annotations

import inspect
import sys
from collections.abc import Callable
from types import ModuleType
from typing import Any


def call_as(module: str, function: Callable[..., Any]) -> None:
    """Make a module callable.

    Parameters
    ----------
    module : str
        Its ``__name__``; it is being imported.
    function : callable
        What a call of the module calls; signature and docstring are taken from it.
    """

    class CallableModule(ModuleType):
        __signature__ = inspect.signature(function)

        def __call__(self, *args: Any, **kwargs: Any) -> Any:
            return function(*args, **kwargs)

    sys.modules[module].__class__ = CallableModule
    # What `help` and a notebook's question mark show.
    sys.modules[module].__doc__ = function.__doc__
