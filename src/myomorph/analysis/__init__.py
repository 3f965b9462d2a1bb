"""What a motion and a study show: strides, phases, cycles, periods, correlations, groups and conditions compared.

Values in, values out. It draws nothing, writes no text for pages and opens no file.
"""
