"""Parser of Google-style docstrings for autodoc2, which reads them without importing the code."""

from __future__ import annotations

from docutils import nodes
from docutils.parsers import rst
from sphinx.ext.napoleon import Config, GoogleDocstring

SECTIONS = [("Class attributes", "params_style")]
CONFIG = Config(napoleon_use_ivar=True, napoleon_use_rtype=False, napoleon_custom_sections=SECTIONS)


class Parser(rst.Parser):
    """reStructuredText with Google's sections."""

    def parse(self, inputstring: str, document: nodes.document) -> None:
        """Parse a docstring; its sections become field lists, and |x| is an absolute value."""
        parts = inputstring.split("``")
        parts[::2] = [part.replace("|", r"\|") for part in parts[::2]]
        super().parse(str(GoogleDocstring("``".join(parts), CONFIG)), document)
