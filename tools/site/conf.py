"""The documentation as HTML: guides of docs/, C headers (through Doxygen), the Python package, one search. `make docs` runs it; a warning is an error."""
import os

project = "tensormass"
author = "the authors of tensormass"
release = version = os.environ["TM_VERSION"]
extensions = ["myst_parser", "breathe", "autoapi.extension"]
myst_heading_anchors = 4
breathe_projects = {"tensormass": os.environ["TM_DOXYGEN"]}
breathe_default_project = "tensormass"
breathe_domain_by_extension = {"h": "c"}
# Parsed, not imported: the pages need no build of the library.
autoapi_dirs = [os.environ["TM_PYTHON"]]
autoapi_root = "python-api"
autoapi_options = ["members", "undoc-members", "show-module-summary"]
autoapi_add_toctree_entry = False
autoapi_keep_files = False
# The package imports itself, which the parser reports; an example with an ellipsis is not valid C, which the highlighter reports.
suppress_warnings = ["misc.highlighting_failure", "autoapi.python_import_resolution"]
html_theme = "furo"
html_title = f"tensormass {version}"
html_static_path = ["static"]
html_css_files = ["site.css"]
html_show_sourcelink = False
html_show_copyright = False


def private(app, what, name, obj, skip, options):
    """Skips the package's private members: modules and names with an underscore."""
    return skip or any(part.startswith("_") and not part.startswith("__init__") for part in name.split(".")) or None


def setup(app):
    app.connect("autoapi-skip-member", private)
