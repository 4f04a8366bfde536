"""How Sphinx builds the site: the pages of docs, and the library's names from their docstrings (`make site`)."""

import importlib.metadata

project = "tbmslam"
author = "The tbmslam authors"
copyright = "the tbmslam authors"  # noqa: A001 - Sphinx's name
release = importlib.metadata.version("tbmslam")
extensions = ["sphinx.ext.autodoc", "sphinx.ext.viewcode", "numpydoc", "myst_parser"]
root_doc = "index"
exclude_patterns = ["site/_build", "figures"]
html_theme = "furo"
html_title = f"tbmslam {release}"
html_static_path: list[str] = []

autodoc_default_options = {"members": True, "show-inheritance": False}
autodoc_typehints = "signature"
autodoc_member_order = "bysource"
numpydoc_show_class_members = False
numpydoc_xref_param_type = False

myst_heading_anchors = 3
# Pages link to files of the repository, and draw with Mermaid, as GitHub shows them.
suppress_warnings = ["myst.xref_missing", "misc.highlighting_failure"]
