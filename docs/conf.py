"""Sphinx configuration. `make docs` builds with warnings as errors."""

import importlib.metadata
import json
from pathlib import Path

project = "bess"
author = "The bess developers"
project_copyright = "2026, The bess developers"
release = version = importlib.metadata.version("bess-powersplit")

extensions = [
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.mathjax",
    "sphinx.ext.viewcode",
    "numpydoc",
    "myst_parser",
]
source_suffix = {".md": "markdown", ".rst": "restructuredtext"}
exclude_patterns = ["_build", "_cases"]  # _cases: what pages include
myst_enable_extensions = ["dollarmath", "amsmath", "deflist", "substitution"]
# Numbers within sentences come from `make cases`, as those of tables do: {{ name }}.
myst_substitutions = json.loads((Path(__file__).parent / "_cases" / "words.json").read_text("utf-8"))
myst_heading_anchors = 3

autodoc_typehints = "none"
autosummary_generate = True
numpydoc_show_class_members = False
# The package registries are the only network a build may need: no inventories of other projects are fetched.

html_theme = "pydata_sphinx_theme"
html_theme_options = {
    "show_toc_level": 2,
    "navigation_with_keys": False,
    "secondary_sidebar_items": ["page-toc"],
}
html_title = f"bess {release}"
html_static_path = ["_static"]
