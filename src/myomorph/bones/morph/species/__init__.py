"""Muscles of one species on the skeleton of another.

Lives here: the table of counterparts (bodies, coordinates, landmarks), fused and split bones, the
maps between them and the whole transfer. Never here: the tables themselves, which are in
`bones/morph/data/`, and what one species needs alone.
"""
