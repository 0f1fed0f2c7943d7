"""How ``scripts/docs`` makes the pages: Sphinx, Markdown by MyST, the API from numpydoc docstrings by Napoleon."""

import importlib.metadata
from pathlib import Path

project = "floatplan"
author = "the floatplan authors"
project_copyright = author
version = release = importlib.metadata.version("floatplan")
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
html_theme = "furo"
html_title = f"floatplan {release}"
REPORTS = Path(__file__).parents[1] / "build" / "reports"  # made by scripts/make_reports.py
html_extra_path = [str(REPORTS)] if REPORTS.is_dir() else []
myst_heading_anchors = 3
napoleon_google_docstring = False
napoleon_use_ivar = True
autodoc_member_order = "groupwise"
autodoc_typehints = "none"
autodoc_default_options = {"members": True, "undoc-members": False}
