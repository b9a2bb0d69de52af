# SPDX-License-Identifier: Apache-2.0
"""Configuration of the documentation site: Sphinx with MyST and the PyData theme."""

import sys
from importlib import metadata
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE))

import generate  # noqa: E402  (beside this file)

project = "MWD telemetry on ROS 2"
author = "MWD telemetry maintainers"
version = release = metadata.version("mwd_surface")
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx.ext.viewcode"]
source_suffix = {".md": "markdown"}
exclude_patterns = ["_build", "**/*.ipynb"]
myst_enable_extensions = ["dollarmath", "colon_fence", "deflist"]
myst_heading_anchors = 3
autodoc_default_options = {"members": True, "member-order": "bysource"}
autodoc_typehints = "description"
napoleon_google_docstring = False
napoleon_use_ivar = True
# Docstrings are written for readers of the code; MyST's own warnings (links, headings) stay errors.
suppress_warnings = ["docutils", "autodoc", "ref.python", "myst.xref_ambiguous"]
html_theme = "pydata_sphinx_theme"
html_theme_options = {"show_toc_level": 2, "navigation_with_keys": False, "secondary_sidebar_items": ["page-toc"]}
html_title = project


def setup(app):
    """Write the generated pages before Sphinx reads the sources."""
    app.connect("builder-inited", lambda _app: generate.write_all(HERE))
