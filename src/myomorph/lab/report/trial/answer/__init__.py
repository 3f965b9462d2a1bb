"""The answer of a trial: its main result in a sentence, three curves, key poses and one verdict."""
