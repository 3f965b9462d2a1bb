"""The terms of the tension problem: muscles, actuators, contacts, measured forces, EMG.

A term says what it adds (`term.Term`); the problem adds terms up and solves. What a term never does
is solve, or know of another term that it was not given.
"""
