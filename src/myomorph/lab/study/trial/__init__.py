"""The steps of one trial, from its files to its results and its report."""
