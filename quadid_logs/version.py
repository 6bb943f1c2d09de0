"""The version, where every layer can read it without importing the public API."""

from typing import Final

__version__: Final = "0.1.0"
