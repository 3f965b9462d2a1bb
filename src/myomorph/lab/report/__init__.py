"""Reports for people: charts, pictures, scenes and HTML pages of what was computed.

It changes no result and computes none.
"""
