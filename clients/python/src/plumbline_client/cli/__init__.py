"""The command `plumbline-client`."""

from .main import main

__all__ = ["main"]
