"""From a study file of specimens to its results: files, steps, tables.

What is computed lies in the rooms beside; nothing here draws a page.
"""
