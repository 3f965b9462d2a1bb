"""What every page has: head, sections, verdicts, references, and the HTML around them; it knows no
kind of page.
"""
