"""People judge recorded rollouts, without seeing what the evaluator says of them."""

from .ledger import Ledger
from .sample import sample
from .server import Server, serve
from .session import Session

__all__ = ["Ledger", "Server", "Session", "sample", "serve"]
