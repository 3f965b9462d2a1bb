"""Charts as SVG: axes, marks and the kinds of chart that pages use.

A chart takes numbers and names; it knows no trial and computes no result.
"""
