"""The nouns: a model, time series, spatial values and errors. Reads no file, knows no Numba."""
