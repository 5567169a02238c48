"""The site: `make docs` builds it from this folder, without a network, and fails on a warning."""

from __future__ import annotations

import re
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE / "sphinx_parts"))

project = "dvrk_gravity"
author = "dvrk_gravity maintainers"
release = version = re.search(
    r'__version__ = "(.+)"', (HERE.parent / "dvrk_gravity" / "__init__.py").read_text()
)[1]

extensions = ["myst_parser", "autodoc2", "faces", "mathml"]
exclude_patterns = ["README.md", "sphinx_parts", "requirements.*"]  # index.md includes the first
myst_enable_extensions = ["dollarmath", "fieldlist"]
myst_heading_anchors = 4

# Static analysis: no module of the package is imported, and rclpy need not be there.
autodoc2_packages = [{"path": "../dvrk_gravity", "auto_mode": False}]
autodoc2_docstring_parser_regexes = [(".*", "google_docstrings")]
autodoc2_hidden_objects = ["undoc", "dunder", "private", "inherited"]
autodoc2_index_template = None

html_theme = "furo"
html_title = f"dvrk_gravity {version}"
html_static_path = ["sphinx_parts/static"]
html_css_files = ["site.css"]
html_show_sphinx = html_show_copyright = html_show_sourcelink = html_copy_source = False
