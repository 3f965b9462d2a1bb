"""From files to steps to results: study files, trials, subjects, runs and summaries.

It holds no science.
"""
