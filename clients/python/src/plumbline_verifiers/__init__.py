"""MineCEraft for verifiers: `vf-eval plumbline-verifiers -m MODEL`.

Needs the extra `plumbline-client[verifiers]`. The service is that of `PLUMBLINE_SERVER`, with the key in `PLUMBLINE_KEY`.
"""

from .chat import PlainChat
from .taskset import Conversation, Mineceraft

__all__ = ["Conversation", "Mineceraft", "PlainChat"]
