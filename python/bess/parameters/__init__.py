"""What is known about a plant before it runs: parameters, validated once, and state, apart from them."""

from bess.parameters.parse import StringParameters
from bess.parameters.state import State
from bess.parameters.system import System, load_system

__all__ = ["State", "StringParameters", "System", "load_system"]
