"""People judge recorded rollouts, without seeing what the evaluator says of them."""

from .label_sample import sample
from .ledger import Ledger
from .server import Server
from .session import Session

__all__ = ["Ledger", "Server", "Session", "sample"]
