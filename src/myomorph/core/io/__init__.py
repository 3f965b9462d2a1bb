"""Files to nouns and nouns to files: the only place of millimetres, degrees, XML and axis swaps."""
