"""A controller without a solver, distilled from closed loops; as a policy, as C99 and as structured text.

The decision itself is :mod:`bess.control.explicit`; this package fits its weights and translates it.
"""

from bess.edge.distil.distillation import distil, distil_runs
from bess.edge.distil.training import GENERATIONS

__all__ = ["GENERATIONS", "distil", "distil_runs"]
