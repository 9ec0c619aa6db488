"""Study files: definitions of runs, validated before a simulation."""

from bess.study.scenarios import expand
from bess.study.study import Study, bundled_studies, load_study

__all__ = ["Study", "bundled_studies", "expand", "load_study"]
