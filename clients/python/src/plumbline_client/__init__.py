"""Client of plumbline, which grades what AI agents build as construction engineers in Minecraft.

`Client` and `AsyncClient` have the whole API by resource; `models` has its bodies, `errors` what may be raised.
"""

from . import errors, models
from .async_client import AsyncClient
from .calls import Retries
from .client import Client
from .coalescer import Coalescer
from .errors import PlumblineError

__all__ = ["AsyncClient", "Client", "Coalescer", "PlumblineError", "Retries", "errors", "models"]
__version__ = "0.1.0"
