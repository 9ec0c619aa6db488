"""Plant parameters, validated once, and the measured state."""

from bess.system.parse import StringParameters
from bess.system.state import State
from bess.system.system import System, load_system

__all__ = ["State", "StringParameters", "System", "load_system"]
