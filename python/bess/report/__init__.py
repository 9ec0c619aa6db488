"""Figures and the self-contained HTML page of a run, a scenario set or a sweep."""
