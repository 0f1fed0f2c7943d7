"""How ``scripts/docs`` makes the pages: Sphinx, Markdown by MyST, the API from docstrings by numpydoc."""

import importlib.metadata
from pathlib import Path

project = "floatplan"
author = "the floatplan authors"
project_copyright = author
version = release = importlib.metadata.version("floatplan")
extensions = ["myst_parser", "sphinx.ext.autodoc", "numpydoc"]
html_theme = "furo"
html_title = f"floatplan {release}"
html_favicon = "images/favicon.svg"
REPORTS = Path(__file__).parents[1] / "build" / "reports"  # made by scripts/make_reports.py
html_extra_path = [str(REPORTS)] if REPORTS.is_dir() else []
myst_heading_anchors = 3
numpydoc_show_class_members = False  # autodoc has them
autodoc_member_order = "groupwise"
autodoc_typehints = "none"
autodoc_default_options = {"members": True}
