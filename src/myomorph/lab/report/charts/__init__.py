"""Charts as SVG: axes, marks, kinds of chart.

They take numbers and names, know no trial and compute no result.
"""
