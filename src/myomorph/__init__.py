"""Models of one body, and the forces inside it, from what a laboratory can measure.

`import myomorph as mm` is the way in. The names of `__init__.pyi` are found here; the module behind
a name is imported when the name is first used, so that the import itself takes no time. All else
may move from version to version.
"""

from myomorph.lazy_names import lazy_names

__version__ = "0.2.0"

__getattr__, __dir__, __all__ = lazy_names(__name__, __file__)
