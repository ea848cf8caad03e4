"""The documentation's build: `sphinx-build -W docs build/docs` (extra `docs`); writes the reference from the code."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent))
sys.path.insert(0, str(Path(__file__).parent.parent))

import reference_pages

BESIDE = ("CHANGELOG", "CONTRIBUTING", "SECURITY")
"""Pages beside the README of which the site has copies."""

project = "Norrbin"
author = "the Norrbin developers"
project_copyright = f"{author}, MIT licence"
extensions = ["myst_parser", "sphinx_copybutton", "sphinx.ext.autodoc"]
source_suffix = {".md": "markdown"}
exclude_patterns = ["README.md"]
html_theme = "furo"
html_title = "Norrbin"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_js_files = ["site.js"]
html_baseurl = ""
myst_heading_anchors = 4
myst_enable_extensions = ["dollarmath", "amsmath"]
# offline: no address outside is asked for, formulas are left to the reader's browser as text
html_math_renderer = "mathjax"
nitpicky = True
# types in the signatures of the Python interface have no pages of their own
nitpick_ignore_regex = [("py:.*", ".*")]


def _to_records(_app: Any, _page: str, source: list[str]) -> None:
    """Let links to `benchmarks/results` lead to the copies within the site."""
    source[0] = source[0].replace("](../../benchmarks/results/", "](../reference/results/")
    source[0] = source[0].replace("](../benchmarks/results/", "](reference/results/")
    for name in BESIDE:
        source[0] = source[0].replace(f"](../{name}.md)", f"](reference/{name.lower()}.md)")


def setup(app: Any) -> None:
    """Write the pages of the reference before the sources are read."""
    app.connect("source-read", _to_records)
    app.connect("config-inited", lambda *_: reference_pages.write(Path(__file__).parent / "reference", BESIDE))
