"""How Sphinx builds the documentation: `make docs`, offline, every warning an error."""

import hashlib
import os
import sys
from importlib.metadata import version as installed_version
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


def sources_digest() -> str:
    """Names the cache of executed notebooks: an edit of the program runs them anew."""
    digest = hashlib.sha256()
    for package in ("cradle_env", "identification"):
        for source in sorted((ROOT / package).rglob("*.py")):
            digest.update(source.read_bytes())
    return digest.hexdigest()[:16]


# Extensions of this folder, for Sphinx and for the kernels that run the tutorials.
sys.path.insert(0, str(ROOT / "docs" / "_ext"))
os.environ["PYTHONPATH"] = os.pathsep.join(filter(None, (sys.path[0], os.environ.get("PYTHONPATH"))))

project = "newtons-cradle"
author = "The newtons-cradle authors"
project_copyright = author
version = release = installed_version("newtons-cradle")

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx_copybutton",
    "generated_parts",
    "mathml",
]
exclude_patterns = ["_build", "_ext"]
nitpicky = True
nitpick_ignore_regex = [
    ("py:class", r"(structured |str to )?ndarray|mapping|optional|[A-Z]|\d+")
]  # words of "ndarray of shape (T, N), optional"

myst_enable_extensions = ["amsmath", "colon_fence", "dollarmath"]
myst_heading_anchors = 3
nb_execution_mode = "cache"
nb_execution_in_temp = True
nb_execution_cache_path = str(ROOT / "build" / "notebooks" / sources_digest())
nb_execution_timeout = 1200  # s, of one cell
nb_execution_raise_on_error = True
nb_merge_streams = True
suppress_warnings = ["myst-nb.lexer"]  # cells that were not run, where execution is off

default_role = "code"
autodoc_member_order = "bysource"
autodoc_typehints = "none"
napoleon_google_docstring = False
# Types of parameters are words, as "array of shape (T,)", not references.
napoleon_use_param = False
napoleon_use_rtype = False

html_math_renderer = "mathml"
html_theme = "furo"
html_title = f"newtons-cradle {release}"
html_show_sourcelink = False
copybutton_prompt_text = r">>> |\.\.\. |\$ "
copybutton_prompt_is_regexp = True
