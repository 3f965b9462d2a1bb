"""Analysis of motions and studies: strides, cycles, correlations, comparisons of groups.

It draws nothing and opens no file.
"""
