"""The uncertainty of measurement and model: sources of error, drawn inputs, spread of results.

Here live how large each source is taken to be, random inputs (a model, markers, forces) around
those of a study, and the statistics of draws. A step of the chain itself never stands here:
`lab/study/trial` runs it on what is drawn here.
"""

from myomorph.lazy_names import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__, __file__)
