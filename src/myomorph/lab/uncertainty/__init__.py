"""What measurement and model leave uncertain: sources of error, inputs drawn with them, the spread
of what comes out.

Here live how large each source is taken to be, random inputs (a model, markers, forces) around
those that were given, and the statistics of draws. Never a step of the chain itself:
`lab/study/trial` runs it on what is drawn here.
"""

from myomorph.lazy_names import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__, __file__)
