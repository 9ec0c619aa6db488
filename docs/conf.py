"""Sphinx configuration. `make docs` builds with warnings as errors."""

import importlib.metadata
import json
import os
import sys
import tomllib
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

import tables
from pydantic import BaseModel

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
    "myst_nb",
]
source_suffix = {".rst": "restructuredtext", ".md": "myst-nb", ".ipynb": "myst-nb"}
exclude_patterns = ["_build", "_cases", "_generated"]  # the latter two: what pages include
templates_path = ["_templates"]
myst_enable_extensions = ["dollarmath", "amsmath", "deflist", "substitution"]
# Numbers within sentences come from `make cases`, as those of tables do: {{ name }}.
myst_substitutions = json.loads((Path(__file__).parent / "_cases" / "words.json").read_text("utf-8"))
myst_heading_anchors = 3

# The notebooks are kept without results and run by every build; an error in one fails it.
nb_execution_mode = "force"
nb_execution_raise_on_error = True
nb_execution_timeout = 300
nb_merge_streams = True

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
# Only manuals that stand side by side offer each other; one that is built here loads nothing from elsewhere.
if shown := os.environ.get("DOCS_VERSION"):
    project_file = (Path(__file__).parents[1] / "pyproject.toml").read_text("utf-8")
    home = tomllib.loads(project_file)["project"]["urls"]["Documentation"]
    html_theme_options |= {
        "switcher": {"json_url": f"{home}switcher.json", "version_match": shown},
        "navbar_end": ["version-switcher", "theme-switcher", "navbar-icon-links"],
        "check_switcher": False,
    }
html_title = f"bess {release}"
html_static_path = ["_static"]
html_css_files = ["manual.css"]

tables.write()


def _without_fields(app, what, name, thing, options, signature, returns):
    """A model's fields with all their defaults are no signature that anybody could read."""
    if what == "class" and isinstance(thing, type) and issubclass(thing, BaseModel):
        return "", None
    return None


def setup(app):
    app.connect("autodoc-process-signature", _without_fields)
