"""What was computed, for people: charts, pictures, scenes and HTML pages. Changes no result and
computes none.
"""
