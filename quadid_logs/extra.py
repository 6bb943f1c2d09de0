"""Libraries that an installation may lack: imported where they are needed, else one clear line."""

from __future__ import annotations

import importlib
from types import MappingProxyType
from typing import Any, Final

from quadid_logs.errors import SettingsError

#: What installs a library, where it is not called as the library is imported.
_PACKAGES: Final = MappingProxyType({"serial": "pyserial"})


def load(name: str, extra: str = "") -> Any:
    """Import a library that an installation may lack.

    Parameters
    ----------
    name : str
        The module, as it is imported.
    extra : str
        The extra of this package that installs it; "" for what every installation should have, which the
        packaging of a system may leave out.

    Raises
    ------
    SettingsError
        If it is not installed; the hint says how to install it.
    """
    try:
        return importlib.import_module(name)
    except ImportError as error:
        package = name.partition(".")[0]
        how = f"pip install {_PACKAGES.get(package, package)}"
        if extra:
            how = f"pip install '.[{extra}]' in the source folder of quadid-logs"
        raise SettingsError(
            f"{error.name or name} is not installed.", hint=f"Install it with: {how}"
        ) from error
