"""What Inspect finds by name; the entry point of the group `inspect_ai` loads this module."""

from .scorers import criteria, passes
from .solvers import one_shot, turn_by_turn
from .tasks import mineceraft, mineceraft_hidden, mineceraft_lite

__all__ = ["criteria", "mineceraft", "mineceraft_hidden", "mineceraft_lite", "one_shot", "passes", "turn_by_turn"]
