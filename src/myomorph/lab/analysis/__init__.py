"""What a motion and a study show: strides, cycles, correlations, groups compared. It draws nothing,
opens no file.
"""
