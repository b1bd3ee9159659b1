"""`plumbline-client evaluate`: from a model to a finished run, in one command.

A *plan* says what is evaluated; a *journal* keeps every answer of the model, so that an interrupted evaluation resumes
where it stopped and nothing is paid for twice.
"""

from .plan import Plan
from .runner import Outcome, evaluate

__all__ = ["Outcome", "Plan", "evaluate"]
